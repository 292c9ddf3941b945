//! Large bodies: cut into blocks that are solved side by side.

use bevy::ecs::change_detection::Tick;
use bevy::ecs::system::SystemChangeTick;
use bevy::prelude::*;
use bevy::tasks::ComputeTaskPool;
use polpo_solver::{Constraints, Executor, Share, Shares, Turning};

use crate::particles::Awake;
use crate::stiffness::shares_of;
use crate::{
    DistanceConstraints, EdgeStiffness, Edges, Frozen, ImplicitGroups, ParticleStiffness, Particles, Plasticity, ShapeMatching,
    SubstepTime, Torsion,
};

/// The groups and edges of a body of [`LARGE`](Self::LARGE) particles and more, cut into blocks that threads solve side by side. Comes with every such body, and with no other.
///
/// Such a body's [`ShapeMatching`], [`DistanceConstraints`] and [`Torsion`] are solved together, block by block, with the same result for any number of threads; whatever else it has works as in a small one. It is the number of
/// particles alone that decides: a body of one particle less is solved in another order, which shows as another numbering of its particles would.
#[derive(Component, Debug, Clone, Default)]
pub struct Blocks {
    blocks: polpo_solver::Blocks,
    /// What of groups and edges has changed later than this the blocks do not know yet.
    seen: Tick,
}

impl Blocks {
    /// How many particles make a body large.
    pub const LARGE: usize = polpo_solver::Blocks::LARGE;

    /// How many blocks there are.
    pub fn len(&self) -> usize {
        self.blocks.len()
    }

    /// Whether there are none: before the first step, and while the body has neither [`ImplicitGroups`] nor [`Edges`].
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }
}

/// Bevy's threads; without any, the one that calls.
struct Pool;

impl Executor for Pool {
    fn each<T: Send>(&self, tasks: &mut [T], work: impl Fn(&mut T) + Send + Sync) {
        match ComputeTaskPool::try_get() {
            Some(pool) if pool.thread_num() > 1 && tasks.len() > 1 => {
                let work = &work;
                pool.scope(|scope| tasks.iter_mut().for_each(|task| scope.spawn(async move { work(task) })));
            }
            _ => tasks.iter_mut().for_each(work),
        }
    }
}

/// In phase `Prepare`, when groups and edges are there: large bodies are cut.
pub(crate) fn build_blocks(
    ticks: SystemChangeTick,
    mut bodies: Query<(&Particles, &mut Blocks, Option<&ImplicitGroups>, Option<&Edges>), Without<Frozen>>,
) {
    for (particles, mut blocks, groups, edges) in &mut bodies {
        let something = groups.is_some_and(|g| !g.is_empty()) || edges.is_some_and(|e| !e.is_empty());
        if blocks.is_empty() && something {
            let (no_groups, no_edges) = default();
            let new = polpo_solver::Blocks::new(particles, groups.map_or(&no_groups, |g| &g.0), edges.map_or(&no_edges, |e| &e.0));
            *blocks = Blocks { blocks: new, seen: ticks.this_run() };
        }
    }
}

/// Blocks go with the groups and edges that they were made from: they are cut anew when those come, go or are replaced.
pub(crate) fn watch_sources(app: &mut App) {
    app.add_observer(cut_anew::<Insert, ImplicitGroups>)
        .add_observer(cut_anew::<Remove, ImplicitGroups>)
        .add_observer(cut_anew::<Insert, Edges>)
        .add_observer(cut_anew::<Remove, Edges>);
}

fn cut_anew<E: EntityEvent, T: Component>(event: On<E, T>, mut blocks: Query<&mut Blocks>) {
    if let Ok(mut blocks) = blocks.get_mut(event.event_target()) {
        *blocks = Blocks::default();
    }
}

fn off<'a>() -> Shares<'a> {
    Share::default().into()
}

/// At the start of phase `Substeps`, as for bodies in one piece.
pub(crate) fn forget_rotations(mut bodies: Query<(&Particles, &mut Blocks), Awake>) {
    for (particles, mut blocks) in &mut bodies {
        polpo_solver::forget_block_rotations(&mut blocks.blocks, particles, &Pool);
    }
}

/// In phase `SolveConstraints`, in every iteration, in place of what solves shapes, distances and torsion of bodies in one piece.
pub(crate) fn solve_blocks(
    time: Res<SubstepTime>,
    ticks: SystemChangeTick,
    mut bodies: Query<
        (
            &mut Particles,
            &mut Blocks,
            Option<Mut<ImplicitGroups>>,
            Option<Ref<Edges>>,
            (Option<&ShapeMatching>, Option<&DistanceConstraints>, Option<&Torsion>),
            (Option<&mut ParticleStiffness>, Option<&mut EdgeStiffness>),
            Has<Plasticity>,
        ),
        Awake,
    >,
) {
    let sweep = time.sweep();
    let (now, dt) = (ticks.this_run(), sweep.dt);
    for (mut particles, mut cut, mut groups, edges, (matching, distance, torsion), (mut each_group, mut each_edge), plastic) in &mut bodies
    {
        let Blocks { blocks, seen } = &mut *cut;
        let newer = |changed: Option<Tick>| changed.is_some_and(|tick| tick.is_newer_than(*seen, now));
        if newer(groups.as_ref().map(|g| g.last_changed())) || newer(edges.as_ref().map(|e| e.last_changed())) {
            let (no_groups, no_edges) = default();
            blocks.follow(groups.as_ref().map_or(&no_groups, |g| &g.0), edges.as_ref().map_or(&no_edges, |e| &e.0));
        }
        *seen = now;
        let each_group = each_group.as_mut().map(|each| &mut each.bypass_change_detection().0);
        let each_edge = each_edge.as_mut().map(|each| each.bypass_change_detection());
        let (each_tension, each_compression, each_torsion) =
            each_edge.map_or((None, None, None), |each| (each.tension.as_mut(), each.compression.as_mut(), each.torsion.as_mut()));
        let constraints = Constraints {
            shapes: matching.map_or_else(off, |m| shares_of(each_group, m.stiffness, dt)),
            turning: matching.map_or(Turning::default(), |m| m.turning),
            tension: distance.map_or_else(off, |d| shares_of(each_tension, d.tension, dt)),
            compression: distance.map_or_else(off, |d| shares_of(each_compression, d.compression, dt)),
            torsion: torsion.map_or_else(off, |t| shares_of(each_torsion, t.stiffness, dt)),
        };
        polpo_solver::solve_blocks(blocks, &mut particles, &constraints, sweep, &Pool);
        if plastic && let Some(groups) = &mut groups {
            blocks.tell_rotations(groups.bypass_change_detection());
        }
    }
}
