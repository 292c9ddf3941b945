//! Blocks: a large body cut into slabs that can be solved side by side.

use std::sync::Arc;

use glam::Vec3A;

use crate::batches::Batches;
use crate::coloring::{color_rows, rank};
use crate::{Edges, ImplicitGroups, Particles};

/// About how much work a block should be, in members of groups and ends of edges.
const WORK: usize = 12_000;
/// More blocks than this help no machine there is.
const MOST: usize = 64;
/// How many reaches a block should be thick at least: with two, every other block has no particle in common.
const THICKNESS: f32 = 2.2;

/// The groups and edges of a large body, cut by place at rest into slabs across the body's longest axis, each a little body of its own.
///
/// Every group and every edge is in one block. A block has copies of the particles that its groups and edges touch, which are its own and some of its neighbours'. Blocks that have a particle in common have different colours,
/// so those of one colour can be solved side by side with the same result to the bit; slabs mostly need two colours. How a body is cut depends on its places at rest, its groups and its edges alone, not on how its particles are
/// numbered and not on threads.
///
/// Blocks are made from groups and edges and have to [`follow`](Self::follow) them: they have rest places, lengths and what rests of their own. The groups' rotations are theirs too, see [`tell_rotations`](Self::tell_rotations). [`solve_blocks`](crate::solve_blocks) does what
/// [`match_shapes`](crate::match_shapes()), [`solve_distances`](crate::solve_distances) and [`solve_torsion`](crate::solve_torsion) do, in another order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Blocks {
    /// Sorted by colour, then along the body.
    pub(crate) list: Vec<Block>,
    /// Where each colour starts in `list`, and the end of the last.
    colors: Vec<u32>,
    /// The masses and inertias that the blocks have copies of, and their inverses.
    pub(crate) masses: [Vec<f32>; 4],
}

/// A part of a body, see [`Blocks`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Block {
    /// Which of the body's particles its groups and edges touch, ascending.
    pub(crate) particles: Vec<u32>,
    /// Copies of these, without what the kernels do not read.
    pub(crate) copies: Particles,
    /// Its groups and edges, on the copies.
    pub(crate) groups: ImplicitGroups,
    pub(crate) edges: Edges,
    /// Which of the body's groups and edges those are.
    pub(crate) group_of: Vec<u32>,
    pub(crate) edge_of: Vec<u32>,
}

impl Blocks {
    /// From so many particles on a body gains by being cut: fewer are not worth the starting of threads.
    pub const LARGE: usize = 5000;

    /// Cuts a body. Without groups and edges there are no blocks; a small body, or one whose edges reach far, is one block.
    ///
    /// # Panics
    ///
    /// If the groups or edges are not those of a body with as many `particles`.
    pub fn new(particles: &Particles, groups: &ImplicitGroups, edges: &Edges) -> Self {
        let slabs = Slabs::of(particles, groups, edges);
        let mut list: Vec<Block> = (0..slabs.count).map(|k| Block::new(particles, groups, edges, &slabs, k)).collect();
        list.retain(|block| !block.particles.is_empty());
        let (order, colors) = color_rows(particles.len(), list.iter().map(|block| block.particles.as_slice()));
        let list = order.iter().map(|&k| core::mem::take(&mut list[k as usize])).collect();
        let mut blocks = Self { list, colors, ..Self::default() };
        blocks.follow(groups, edges);
        blocks
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// How many colours they have.
    pub fn color_count(&self) -> usize {
        self.colors.len().saturating_sub(1)
    }

    /// The blocks of colour `color`, none of which has a particle in common with another.
    ///
    /// # Panics
    ///
    /// If there is no such colour.
    pub fn color(&self, color: usize) -> &[Block] {
        &self.list[self.colors[color] as usize..self.colors[color + 1] as usize]
    }

    pub(crate) fn color_mut(&mut self, color: usize) -> &mut [Block] {
        &mut self.list[self.colors[color] as usize..self.colors[color + 1] as usize]
    }

    /// Takes over what may have changed of the groups and edges that the blocks were made from: rest places and lengths, how they are turned at rest, which of them rest. To be called after [`ImplicitGroups::pose`],
    /// [`ImplicitGroups::rest_where_held`], [`creep_shapes`](crate::creep_shapes) and the like, those of edges too.
    ///
    /// # Panics
    ///
    /// If they are others.
    pub fn follow(&mut self, groups: &ImplicitGroups, edges: &Edges) {
        for block in &mut self.list {
            block.follow(groups, edges);
        }
    }

    /// Gives `groups`, which the blocks were made from, the rotations found last: what [`creep_shapes`](crate::creep_shapes) starts from.
    ///
    /// # Panics
    ///
    /// If they are others.
    pub fn tell_rotations(&self, groups: &mut ImplicitGroups) {
        for block in &self.list {
            for (&g, &rotation) in block.group_of.iter().zip(&block.groups.rotation) {
                groups.rotation[g as usize] = rotation;
            }
        }
    }
}

impl Block {
    fn new(particles: &Particles, groups: &ImplicitGroups, edges: &Edges, slabs: &Slabs, k: usize) -> Self {
        let mine = |slab: &u32| *slab as usize == k;
        let group_list: Vec<u32> = (0..groups.len() as u32).filter(|&g| mine(&slabs.of_group(groups, g as usize))).collect();
        let edge_list: Vec<u32> = (0..edges.len() as u32).filter(|&e| mine(&slabs.of_edge(edges, e as usize))).collect();
        let members = group_list.iter().flat_map(|&g| groups.members(g as usize));
        let ends = edge_list.iter().flat_map(|&e| &edges.pairs[e as usize]);
        let mut touched: Vec<u32> = members.chain(ends).copied().collect();
        touched.sort_unstable();
        touched.dedup();
        let at = |i: &u32| touched.partition_point(|t| t < i) as u32;
        let rows: Vec<Vec<u32>> = group_list.iter().map(|&g| groups.members(g as usize).iter().map(at).collect()).collect();
        let pairs: Vec<[u32; 2]> = edge_list.iter().map(|&e| [0, 1].map(|k| at(&edges.pairs[e as usize][k]))).collect();
        let mut copies = copy(particles, &touched);
        let row_slices: Vec<&[u32]> = rows.iter().map(Vec::as_slice).collect();
        let mut own_groups = ImplicitGroups::of(&copies, &row_slices).expect("groups of a body are sound");
        let mut own_edges = Edges::new(&copies, &pairs).expect("edges of a body are sound");
        // Groups have been put into an order of their own. Two of the same members are as good as each other.
        let mut before: Vec<u32> = (0..rows.len() as u32).collect();
        let mut after = before.clone();
        before.sort_by_key(|&g| &rows[g as usize]);
        after.sort_by(|&a, &b| own_groups.members(a as usize).cmp(own_groups.members(b as usize)));
        let mut group_of = vec![0; rows.len()];
        for (&to, &from) in after.iter().zip(&before) {
            group_of[to as usize] = group_list[from as usize];
        }
        let key = |&g: &u32| groups.keys.get(g as usize).copied().unwrap_or(groups.members(g as usize)[0]);
        own_groups.keys = group_of.iter().map(key).collect();
        let edge_of: Vec<u32> = own_edges.input.iter().map(|&e| edge_list[e as usize]).collect();
        own_edges.input = edge_of.iter().map(|&e| edges.input[e as usize]).collect();
        (copies.rest_position, copies.frame, copies.radii) = Default::default();
        Self { particles: touched, copies, groups: own_groups, edges: own_edges, group_of, edge_of }
    }

    fn follow(&mut self, groups: &ImplicitGroups, edges: &Edges) {
        let Self { particles, groups: own, group_of, .. } = self;
        let rest = Arc::make_mut(&mut own.rest);
        rest.clear();
        rest.extend(group_of.iter().flat_map(|&g| groups.rest(g as usize)));
        Batches::rest(&mut own.batches, &own.rows, &own.rest);
        pick(&mut own.rest_rotation, &groups.rest_rotation, particles);
        pick(&mut own.held, &groups.held, particles);
        pick(&mut own.unoriented, &groups.unoriented, particles);
        let Self { edges: own, edge_of, .. } = self;
        pick(&mut own.rest_length, &edges.rest_length, edge_of);
        pick(&mut own.rest_turn, &edges.rest_turn, edge_of);
        pick(&mut own.held, &edges.held, edge_of);
    }

    /// Which of the body's particles it has copies of, ascending.
    pub fn particles(&self) -> &[u32] {
        &self.particles
    }

    /// Which of the body's groups it has, in the order in which they are solved.
    pub fn groups(&self) -> &[u32] {
        &self.group_of
    }

    /// Which of the body's edges it has, in the order in which they are solved.
    pub fn edges(&self) -> &[u32] {
        &self.edge_of
    }
}

/// The items of `from` at `at`; none if there are none.
fn pick<T: Copy>(to: &mut Vec<T>, from: &[T], at: &[u32]) {
    to.clear();
    if !from.is_empty() {
        to.extend(at.iter().map(|&i| from[i as usize]));
    }
}

/// The particles `at` as a body of their own, as they were made but for their masses.
fn copy(p: &Particles, at: &[u32]) -> Particles {
    let vectors = |from: &[Vec3A]| at.iter().map(|&i| from[i as usize]).collect::<Vec<_>>();
    let numbers = |from: &[f32]| at.iter().map(|&i| from[i as usize]).collect::<Vec<_>>();
    let quats = |from: &[glam::Quat]| at.iter().map(|&i| from[i as usize]).collect::<Vec<_>>();
    Particles {
        position: vectors(&p.position),
        velocity: vectors(&p.velocity),
        rotation: quats(&p.rotation),
        angular_velocity: vectors(&p.angular_velocity),
        mass: numbers(&p.mass),
        inverse_mass: numbers(&p.inverse_mass),
        inertia: numbers(&p.inertia),
        inverse_inertia: numbers(&p.inverse_inertia),
        rest_position: vectors(&p.rest_position),
        frame: quats(&p.frame),
        radii: vectors(&p.radii),
        ..Particles::default()
    }
}

/// Which slab each particle is in.
struct Slabs {
    count: usize,
    slab: Vec<u32>,
    /// The particles' order along the axis.
    along: Vec<u32>,
}

impl Slabs {
    /// Slabs of the same amount of work, across the axis along which the body is longest.
    fn of(p: &Particles, groups: &ImplicitGroups, edges: &Edges) -> Self {
        let x = &p.rest_position;
        let least = x.iter().fold(Vec3A::INFINITY, |a, &b| a.min(b));
        let size = x.iter().fold(Vec3A::NEG_INFINITY, |a, &b| a.max(b)) - least;
        let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0);
        let rank = rank(x);
        let mut order: Vec<u32> = (0..p.len() as u32).collect();
        order.sort_by(|&i, &j| {
            let place = |i: u32| x[i as usize][axis];
            place(i).total_cmp(&place(j)).then(rank[i as usize].cmp(&rank[j as usize]))
        });
        let mut along = vec![0; p.len()];
        for (k, &i) in order.iter().enumerate() {
            along[i as usize] = k as u32;
        }
        let mut slabs = Self { count: 1, slab: vec![0; p.len()], along };

        let mut work = vec![0; p.len()];
        let mut reaches = Vec::with_capacity(groups.member_count() + edges.len());
        let mut note = |[i, j]: [u32; 2]| reaches.push((x[i as usize][axis] - x[j as usize][axis]).abs());
        for g in 0..groups.len() {
            let members = groups.members(g);
            work[members[0] as usize] += members.len();
            members[1..].iter().for_each(|&i| note([members[0], i]));
        }
        for &pair in &edges.pairs {
            work[slabs.first(pair) as usize] += 2;
            note(pair);
        }
        // Of what reaches farther than nearly all the colours take care.
        let most = reaches.len() * 99 / 100;
        let reach = if reaches.is_empty() { 0.0 } else { *reaches.select_nth_unstable_by(most, f32::total_cmp).1 };
        let total: usize = work.iter().sum();
        // Also for a reach of zero, and for what is not finite.
        let room = (size.max_element() / (THICKNESS * reach)).min(MOST as f32) as usize;
        let count = (total / WORK).min(room) & !1;
        if p.len() < Blocks::LARGE || count < 4 {
            return slabs;
        }
        let mut before = vec![0];
        before.extend(order.iter().scan(0, |sum, &i| {
            *sum += work[i as usize];
            Some(*sum)
        }));
        let gap = |k: usize| x[order[k] as usize][axis] - x[order[k - 1] as usize][axis];
        let near = |sum: usize| before.partition_point(|&before| before < sum).min(order.len());
        let window = total / (5 * count);
        let mut start = 0;
        for b in 1..count {
            // In the widest gap near to where it should be, so that a layer of particles is not cut.
            let target = total * b / count;
            let candidates = near(target - window).max(start + 1)..near(target + window);
            start = candidates.reduce(|best, k| if gap(k) > gap(best) { k } else { best }).unwrap_or(start);
            order[start..].iter().for_each(|&i| slabs.slab[i as usize] = b as u32);
        }
        slabs.count = count;
        slabs
    }

    /// The end of an edge that comes first along the axis.
    fn first(&self, [i, j]: [u32; 2]) -> u32 {
        if self.along[i as usize] < self.along[j as usize] { i } else { j }
    }

    fn of_group(&self, groups: &ImplicitGroups, g: usize) -> u32 {
        self.slab[groups.members(g)[0] as usize]
    }

    fn of_edge(&self, edges: &Edges, e: usize) -> u32 {
        self.slab[self.first(edges.pairs[e]) as usize]
    }
}
