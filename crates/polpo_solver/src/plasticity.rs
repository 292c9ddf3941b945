//! Plasticity: shapes that keep part of what was done to them.

use std::sync::Arc;

use glam::{DMat3, DVec3, Mat3A, Quat, Vec3A};

use crate::batches::Batches;
use crate::{Edges, ExplicitGroups, ImplicitGroups, Particles, RestPose, extract_rotation};

/// How rest shapes give way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plasticity {
    /// Strain above which the shape gives way, 0 … infinity: the root mean square distance of a group's members from their goals over that of their rest offsets, for edges the change of length over
    /// the length. Infinite and NaN: never.
    pub yield_strain: f32,
    /// Rate at which the rest shape then approaches what is there \[1/s\], 0 (never) … infinity (at once). Negative and NaN count as 0.
    pub creep: f32,
    /// Strain of the rest shape against the one it was made in, at most, 0 … infinity. From about 0.5 on neighbouring groups may contradict each other. Negative and NaN count as 0.
    pub maximum: f32,
}

impl Plasticity {
    /// The share of the way that the rest shape goes in `dt` \[s\]; nothing for a strain below the yield.
    fn share(self, strain: f32, dt: f32) -> f32 {
        if self.creep > 0.0 && strain > self.yield_strain { 1.0 - libm::expf(-self.creep * dt) } else { 0.0 }
    }
}

/// Lets the rest shapes of implicit groups creep towards what their members show, in a step or substep of `dt` \[s\].
///
/// Müller et al. (*Meshless Deformations Based on Shape Matching*, 2005) let a matrix S_p creep, S_p ← (I + Δt·c·(S − I))·S_p with S the symmetric part of the best linear fit, and take the rest offsets
/// to S_p·x̄. Here the offsets creep themselves, r ← r + (1 − e^(−cΔt))·(Rᵀ(x − c) − r), of which that is the linear part: three particles in a row, whose linear fit does not know a bend, can be bent
/// for good. The volume of the linear fit of the new offsets to the made ones, spin moments included so that there is one for rows and sheets, is normalised to 1, and the offsets' root mean square distance
/// from the made ones limited.
///
/// The made offsets are those of `pose`, the one that the groups were last given, or the default. Edges have to creep along, or they pull back: [`creep_edges`]. Allocates the first time that something flows.
pub fn creep_shapes(groups: &mut ImplicitGroups, particles: &Particles, pose: &RestPose, plasticity: Plasticity, dt: f32) {
    if plasticity.share(f32::INFINITY, dt) <= 0.0 {
        return;
    }
    let ImplicitGroups { rows, members, rest, rotation, held, rest_rotation, flow, ways, moment, batches, .. } = groups;
    let mut flowed = false;
    for (g, ends) in rows.windows(2).enumerate() {
        let row = ends[0] as usize..ends[1] as usize;
        let group = Group { members: &members[row.clone()], moment, turned: rest_rotation, particles };
        let main = group.members[0];
        if held.get(main as usize).is_some_and(|&held| held) {
            continue;
        }
        let (at_rest, shown) = (&rest[row.clone()], &mut ways[..row.len()]);
        // The rotation that fits best shows the least strain: below the yield by the last one found is below it by any better.
        group.show(at_rest, rotation[g], shown);
        if plasticity.share(group.strain(shown, at_rest), dt) <= 0.0 {
            continue;
        }
        group.show(at_rest, group.fit(at_rest, rotation[g]), shown);
        let share = plasticity.share(group.strain(shown, at_rest), dt);
        if share > 0.0 {
            let rest = &mut Arc::make_mut(rest)[row.clone()];
            for (r, &s) in rest.iter_mut().zip(&*shown) {
                *r += (s - *r) * share;
            }
            let (center, size) = (pose.center(particles, group.members), pose.size(main));
            let made = |i| (pose.place(particles, i) - center) * size;
            group.tame(rest, made, plasticity.maximum);
            flow.resize(members.len(), Vec3A::ZERO);
            let turn = rest_rotation.get(main as usize).copied().unwrap_or(Quat::IDENTITY);
            let back = turn.inverse();
            for ((f, r), &i) in flow[row].iter_mut().zip(&mut *rest).zip(group.members) {
                *f = back * (*r - made(i));
                // To the bit what the pose and the flow make together, so that those two are all there is to know.
                *r = made(i) + turn * *f;
            }
            flowed = true;
        }
    }
    if flowed {
        Batches::rest(batches, rows, rest);
    }
}

/// Lets the rest lengths of edges creep towards their lengths, in a step or substep of `dt` \[s\], within the maximum of what they have in `pose`. Allocates the first time that something flows.
pub fn creep_edges(edges: &mut Edges, particles: &Particles, pose: &RestPose, plasticity: Plasticity, dt: f32) {
    if plasticity.share(f32::INFINITY, dt) <= 0.0 {
        return;
    }
    for e in 0..edges.pairs.len() {
        let pair = edges.pairs[e];
        let rest = &mut edges.rest_length[e];
        if edges.held.get(e).is_some_and(|&held| held) {
            continue;
        }
        let length = particles.position[pair[0] as usize].distance(particles.position[pair[1] as usize]);
        let share = plasticity.share((length - *rest).abs() / *rest, dt);
        let made = pose.length(particles, pair);
        if share > 0.0 && length.is_finite() && made > 0.0 {
            let maximum = plasticity.maximum.max(0.0);
            *rest = (*rest + (length - *rest) * share).clamp(made * (1.0 - maximum).max(0.01), made * (1.0 + maximum));
            edges.flow.resize(edges.pairs.len(), 1.0);
            edges.flow[e] = *rest / made;
            *rest = made * edges.flow[e];
        }
    }
}

impl ImplicitGroups {
    /// What plastic flow has added to each member's place in the rest pose \[m\], in the axes that the group's main particle has there; empty while nothing has flowed.
    pub fn flow(&self) -> &[Vec3A] {
        &self.flow
    }

    /// Sets the [`flow`](Self::flow), to be followed by [`pose`](Self::pose). One that is neither empty nor as long as there are members, or not finite, counts as none.
    pub fn set_flow(&mut self, flow: &[Vec3A]) {
        self.flow.clear();
        if flow.len() == self.members.len() && flow.iter().all(|f| f.is_finite()) {
            self.flow.extend_from_slice(flow);
        }
    }
}

impl Edges {
    /// By how much plastic flow has made each edge longer, as a factor; empty while nothing has flowed.
    pub fn flow(&self) -> &[f32] {
        &self.flow
    }

    /// Sets the [`flow`](Self::flow), to be followed by [`pose`](Self::pose). One that is neither empty nor as long as there are edges, or not positive and finite, counts as none.
    pub fn set_flow(&mut self, flow: &[f32]) {
        self.flow.clear();
        if flow.len() == self.pairs.len() && flow.iter().all(|f| *f > 0.0 && f.is_finite()) {
            self.flow.extend_from_slice(flow);
        }
    }
}

impl ExplicitGroups {
    /// Takes what the members of group `g` show as its rest shape, as far as its dent allows. Called when it closes.
    pub(crate) fn keep_dent(&mut self, g: usize, particles: &Particles) {
        let Some(d) = self.deformable[g] else { return };
        let row = self.row(g);
        let group = Group { members: &self.shape.members[row.clone()], moment: &self.shape.moment, turned: &[], particles };
        let (rest, shown) = (&mut Arc::make_mut(&mut self.shape.rest)[row.clone()], &mut self.shape.ways[..row.len()]);
        let rotation = group.fit(rest, self.shape.rotation[g]);
        group.show(rest, rotation, shown);
        rest.copy_from_slice(shown);
        let (center, scale) = (RestPose::default().center(particles, group.members), self.scale[g]);
        group.tame(rest, |i| (particles.rest_position[i as usize] - center) * scale, d.dent);
    }
}

/// The members of one group, with the moments of all particles and how they are turned in the rest pose.
struct Group<'a> {
    members: &'a [u32],
    moment: &'a [Mat3A],
    turned: &'a [Quat],
    particles: &'a Particles,
}

impl Group<'_> {
    /// Their mass, centre of mass and that of their rest offsets.
    fn centers(&self, rest: &[Vec3A]) -> (f32, Vec3A, Vec3A) {
        let (mut center, mut rest_center, mut mass) = (Vec3A::ZERO, Vec3A::ZERO, 0.0);
        for (&i, &r) in self.members.iter().zip(rest) {
            let m = self.particles.mass[i as usize];
            center += self.particles.position[i as usize] * m;
            rest_center += r * m;
            mass += m;
        }
        (mass, center / mass, rest_center / mass)
    }

    /// The rotation from the rest offsets to where the members are, as in [`match_shapes`](crate::match_shapes).
    fn fit(&self, rest: &[Vec3A], guess: Quat) -> Quat {
        let (_, center, rest_center) = self.centers(rest);
        let p = self.particles;
        let mut a = Mat3A::ZERO;
        for (&i, &r) in self.members.iter().zip(rest) {
            let i = i as usize;
            let (d, r) = ((p.position[i] - center) * p.mass[i], r - rest_center);
            let spin = Mat3A::from_quat(p.rotation[i]) * self.moment[i];
            a += self.turned.get(i).map_or(spin, |&bar| spin * Mat3A::from_quat(bar).transpose());
            a += Mat3A::from_cols(d * r.x, d * r.y, d * r.z);
        }
        extract_rotation(a, guess)
    }

    /// Where the members are about the centre of their rest offsets, turned back by `rotation`.
    fn show(&self, rest: &[Vec3A], rotation: Quat, shown: &mut [Vec3A]) {
        let (_, center, rest_center) = self.centers(rest);
        let back = rotation.inverse();
        for (s, &i) in shown.iter_mut().zip(self.members) {
            *s = back * (self.particles.position[i as usize] - center) + rest_center;
        }
    }

    /// Root mean square distance of `a` from `b` over the size of `b`, by mass. Zero for a group without extent.
    fn strain(&self, a: &[Vec3A], b: &[Vec3A]) -> f32 {
        let (mut way, mut size) = (0.0, 0.0);
        for ((&i, &a), &b) in self.members.iter().zip(a).zip(b) {
            let m = self.particles.mass[i as usize];
            way += m * a.distance_squared(b);
            size += m * b.length_squared();
        }
        if size > 0.0 { (way / size).sqrt() } else { 0.0 }
    }

    /// Gives the rest offsets the volume of the `made` ones, and draws them within `maximum` of those.
    fn tame(&self, rest: &mut [Vec3A], made: impl Fn(u32) -> Vec3A, maximum: f32) {
        // F = (Σ m·r·mᵀ + B)·(Σ m·m·mᵀ + B)⁻¹, in f64 because sheets and rows make both nearly singular.
        let (mut a, mut b) = (DMat3::ZERO, DMat3::ZERO);
        for (&i, r) in self.members.iter().zip(&*rest) {
            let m = f64::from(self.particles.mass[i as usize]);
            let (r, o, spin) = (r.as_dvec3() * m, made(i).as_dvec3(), self.moment[i as usize].as_dmat3());
            a += spin + DMat3::from_cols(r * o.x, r * o.y, r * o.z);
            b += spin + DMat3::from_cols(o * (m * o.x), o * (m * o.y), o * (m * o.z));
        }
        let trace = b.x_axis.x + b.y_axis.y + b.z_axis.z;
        let floor = DMat3::from_diagonal(DVec3::splat(1e-6 * trace));
        let volume = (a + floor).determinant() / (b + floor).determinant();
        // A shape turned inside out, or flattened to a tenth, has no volume to be normalised.
        let size = if volume > 0.1 && volume < 10.0 { 1.0 / libm::cbrt(volume) as f32 } else { 1.0 };
        let (mut way, mut extent) = (0.0, 0.0);
        for (&i, r) in self.members.iter().zip(&mut *rest) {
            *r *= size;
            let (m, made) = (self.particles.mass[i as usize], made(i));
            way += m * r.distance_squared(made);
            extent += m * made.length_squared();
        }
        let limit = maximum.max(0.0);
        let over = if extent > 0.0 { (way / extent).sqrt() } else { 0.0 };
        if over > limit || over.is_nan() {
            let keep = if over.is_finite() { limit / over } else { 0.0 };
            for (&i, r) in self.members.iter().zip(&mut *rest) {
                let made = made(i);
                *r = if keep > 0.0 { made + (*r - made) * keep } else { made };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{blob, line};
    use crate::{Stiffness, Sweep, Turning, integrate, match_shapes, predict};

    /// A plastic beam that has been bent and held stays bent; an elastic one comes back.
    #[test]
    fn a_plastic_row_stays_bent() {
        let dt = 1.0 / 300.0;
        let bend_left = |plasticity: Option<Plasticity>| {
            let mut p = line(5, 0.2, 0.1);
            let mut edges = Edges::new(&p, &[[0, 1], [1, 2], [2, 3], [3, 4]]).unwrap();
            let mut implicit = ImplicitGroups::new(&p, &edges);
            let share = Stiffness::damped(30.0, 0.5).share(dt);
            for k in 0..1200 {
                predict(&mut p, Vec3A::ZERO, dt);
                match_shapes(&mut implicit, &mut p, share.into(), Turning::AllMembers, Sweep::only(dt));
                crate::solve_distances(&mut edges, &mut p, share.into(), share.into(), Sweep::only(dt));
                if k < 300 {
                    for (i, y) in [(0, -0.15), (2, 0.15), (4, -0.15)] {
                        let way = Vec3A::Y * (y - p.position[i].y);
                        p.displace(i, way, 1.0 / dt);
                    }
                }
                if let Some(plasticity) = plasticity {
                    creep_shapes(&mut implicit, &p, &RestPose::default(), plasticity, dt);
                    creep_edges(&mut edges, &p, &RestPose::default(), plasticity, dt);
                }
                integrate(&mut p, dt, 4.0);
            }
            let (a, b) = (p.position[1] - p.position[2], p.position[3] - p.position[2]);
            libm::atan2f(a.cross(b).length(), -a.dot(b))
        };
        let plastic = Plasticity { yield_strain: 0.1, creep: 5.0, maximum: 0.6 };
        let (elastic, bent, capped) = (bend_left(None), bend_left(Some(plastic)), bend_left(Some(Plasticity { maximum: 0.1, ..plastic })));
        println!("bend left: elastic {elastic}, plastic {bent}, capped {capped}");
        assert!(elastic < 0.02 && bent > 0.2 && capped < 0.6 * bent && capped > elastic);
    }

    /// Plastic flow keeps the volume, stays within its maximum and leaves what is below the yield alone.
    #[test]
    fn creep_keeps_volume_and_bounds() {
        let (rest, pairs) = blob();
        let edges = Edges::new(&rest, &pairs).unwrap();
        let mut p = rest.clone();
        for x in &mut p.position {
            *x *= Vec3A::new(1.5, 1.0, 0.8);
        }
        let mut implicit = ImplicitGroups::new(&rest, &edges);
        let before = implicit.clone();
        creep_shapes(&mut implicit, &p, &RestPose::default(), Plasticity { yield_strain: 1.0, creep: 10.0, maximum: 0.5 }, 0.1);
        assert_eq!((&implicit.rest, &implicit.flow), (&before.rest, &Vec::new()));
        for (maximum, expected) in [(0.5, 0.35..0.5), (0.05, 0.045..0.052)] {
            let mut implicit = before.clone();
            for _ in 0..50 {
                creep_shapes(&mut implicit, &p, &RestPose::default(), Plasticity { yield_strain: 0.05, creep: 10.0, maximum }, 0.1);
            }
            let (way, size) = implicit
                .rest
                .iter()
                .zip(before.rest.iter())
                .fold((0.0, 0.0), |(w, s), (a, b)| (w + a.distance_squared(*b), s + b.length_squared()));
            let strain: f32 = (way / size).sqrt();
            println!("creep: {strain} of {maximum}");
            assert!(expected.contains(&strain) || (maximum > 0.1 && strain > 0.15 && strain < 0.5), "{strain}");
        }
        let mut edges = edges;
        let made = edges.rest_length.clone();
        for _ in 0..100 {
            creep_edges(&mut edges, &p, &RestPose::default(), Plasticity { yield_strain: 0.05, creep: 10.0, maximum: 0.2 }, 0.1);
        }
        assert!(edges.rest_length.iter().zip(&made).all(|(a, b)| a / b < 1.2001 && a / b > 0.7999));
        assert!(edges.rest_length.iter().zip(&made).any(|(a, b)| a / b > 1.19));
    }
}
