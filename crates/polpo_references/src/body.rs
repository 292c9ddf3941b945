//! A body as the plugin steps it, without an ECS: the same kernels in the same order.

use glam::{DVec3, Quat, Vec3A};
use polpo_solver::{
    CalibratedEdges, Contact, Contacts, DirectEdges, Edges, ExplicitGroup, ExplicitGroups, ImplicitGroups, ParticleRest, Particles, Rings,
    Share, Shares, Stiffness, Sweep, Turning, damp_internally, integrate, land_explicit_groups, match_explicit_groups, match_shapes,
    momentum, predict, predict_explicit, restore_angular_momentum, solve_calibrated_edges, solve_contacts_beside, solve_distances,
    solve_rings, solve_torsion,
};

use crate::jacobi::Jacobi;

/// Gravity's acceleration, to the bits that the kernels get \[m/s²\].
pub(crate) const G: f64 = 9.81f32 as f64;

/// A particle that is all but a point.
pub(crate) const POINT: f32 = 1e-3;

/// How shape matching goes over the groups.
#[derive(Clone, Debug)]
pub(crate) enum Matching {
    /// One after the other, each from the result of those before: the plugin's way.
    GaussSeidel(Turning),
    /// All from the same state.
    Jacobi(Jacobi),
}

impl Default for Matching {
    fn default() -> Self {
        Self::GaussSeidel(Turning::default())
    }
}

/// A body and what acts on it. Capabilities that are `None` or zero do nothing.
pub(crate) struct Body {
    pub(crate) particles: Particles,
    /// Where the particles' origin is in the world \[m\]: it follows the centre of mass, as the plugin's does, unless something is pinned.
    pub(crate) origin: DVec3,
    pub(crate) gravity: Vec3A,
    pub(crate) edges: Edges,
    pub(crate) explicit: ExplicitGroups,
    pub(crate) groups: ImplicitGroups,
    /// Of all groups, or of those of the particles listed.
    pub(crate) shape: Stiffness,
    pub(crate) only_groups_of: Option<Vec<u32>>,
    pub(crate) matching: Matching,
    pub(crate) tension: Stiffness,
    pub(crate) compression: Stiffness,
    pub(crate) torsion: Stiffness,
    pub(crate) rods: Option<CalibratedEdges>,
    /// Of the rods, if these are facets.
    pub(crate) rings: Rings,
    /// Solves the rods all at once instead of sweeping them.
    pub(crate) direct: Option<DirectEdges>,
    /// The plane through the world's origin with this normal, and its friction.
    pub(crate) floor: Option<(Vec3A, f32)>,
    pub(crate) contacts: Contacts,
    pub(crate) keep_momentum: bool,
    /// \[1/s\]
    pub(crate) drag: f32,
    /// \[1/s\]
    pub(crate) internal_damping: f32,
    shares: Vec<Share>,
}

impl Body {
    /// Particles at rest, without edges, in no field. The list is the program's own, so a bad one is a mistake in it.
    pub(crate) fn new(rest: &[ParticleRest]) -> Self {
        Self {
            particles: Particles::new(rest).expect("well-formed particles"),
            origin: DVec3::ZERO,
            gravity: Vec3A::ZERO,
            edges: Edges::default(),
            explicit: ExplicitGroups::default(),
            groups: ImplicitGroups::default(),
            shape: Stiffness::OFF,
            only_groups_of: None,
            matching: Matching::default(),
            tension: Stiffness::OFF,
            compression: Stiffness::OFF,
            torsion: Stiffness::OFF,
            rods: None,
            rings: Rings::default(),
            direct: None,
            floor: None,
            contacts: Contacts::default(),
            keep_momentum: true,
            drag: 0.0,
            internal_damping: 0.0,
            shares: Vec::new(),
        }
    }

    /// Balls of 1 kg.
    pub(crate) fn balls(places: impl IntoIterator<Item = Vec3A>, radius: f32) -> Self {
        let rest: Vec<ParticleRest> = places
            .into_iter()
            .map(|position| ParticleRest { position, frame: Quat::IDENTITY, radii: Vec3A::splat(radius), mass: 1.0 })
            .collect();
        Self::new(&rest)
    }

    /// `n` balls of 1 kg in a row along `direction` from the origin, over the length `length` \[m\].
    pub(crate) fn row(n: u32, length: f32, direction: Vec3A, radius: f32) -> Self {
        let mut this = Self::balls((0..n).map(|i| direction * (length * i as f32 / (n - 1) as f32)), radius);
        this.join(&(1..n).map(|i| [i - 1, i]).collect::<Vec<_>>());
        this
    }

    /// Gives it edges, and the groups that they imply.
    pub(crate) fn join(&mut self, pairs: &[[u32; 2]]) {
        self.edges = Edges::new(&self.particles, pairs).expect("well-formed edges");
        self.groups = ImplicitGroups::new(&self.particles, &self.edges);
    }

    /// Makes rigid pieces of it.
    pub(crate) fn make_rigid<'a>(&mut self, groups: impl IntoIterator<Item = &'a [u32]>) {
        let groups: Vec<ExplicitGroup> = groups.into_iter().map(ExplicitGroup::rigid).collect();
        self.explicit = ExplicitGroups::new(&self.particles, &groups).expect("well-formed groups");
    }

    /// Makes every edge a rigid link, with a joint where two meet.
    pub(crate) fn make_links(&mut self) {
        let pairs = self.edges.pairs.clone();
        self.make_rigid(pairs.iter().map(|p| p.as_slice()));
    }

    pub(crate) fn fall(&mut self) {
        self.gravity = Vec3A::Y * -(G as f32);
    }

    /// P, L about the centre of mass with spin, and kinetic energy, without the rounding of sums in `f32`.
    pub(crate) fn carried(&self) -> Carried {
        let p = &self.particles;
        let (mut mass, mut center, mut linear, mut angular, mut energy) = (0.0, DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, 0.0);
        for i in 0..p.len() {
            mass += f64::from(p.mass[i]);
            center += p.position[i].as_dvec3() * f64::from(p.mass[i]);
        }
        center /= mass;
        for i in 0..p.len() {
            let (m, spin, v, w) =
                (f64::from(p.mass[i]), f64::from(p.inertia[i]), p.velocity[i].as_dvec3(), p.angular_velocity[i].as_dvec3());
            linear += v * m;
            angular += (p.position[i].as_dvec3() - center).cross(v) * m + w * spin;
            energy += 0.5 * (m * v.length_squared() + spin * w.length_squared());
        }
        Carried { mass, linear, angular, energy }
    }

    /// Where particle `i` is in the world \[m\].
    pub(crate) fn place(&self, i: usize) -> DVec3 {
        self.origin + self.particles.position[i].as_dvec3()
    }

    /// One step of `dt` \[s\] in `substeps` substeps of `iterations` sweeps each: the plugin's step.
    pub(crate) fn step(&mut self, dt: f64, substeps: u32, iterations: u32) {
        self.detect();
        let dt = (dt / f64::from(substeps)) as f32;
        for _ in 0..substeps {
            self.substep(dt, iterations);
        }
        self.follow();
    }

    fn substep(&mut self, dt: f32, iterations: u32) {
        predict(&mut self.particles, self.gravity, dt);
        predict_explicit(&mut self.explicit, &mut self.particles, dt);
        let before = (self.keep_momentum && !self.is_pinned()).then(|| momentum(&self.particles).angular);
        for index in 0..iterations {
            self.sweep(Sweep { index, count: iterations, ..Sweep::only(dt) });
        }
        if let Some(before) = before {
            restore_angular_momentum(&mut self.particles, before, dt);
        }
        if !self.contacts.list.is_empty() {
            solve_contacts_beside(&self.explicit, &mut self.contacts, &mut self.particles, dt, 3.0);
            land_explicit_groups(&mut self.explicit, &mut self.particles, dt);
        }
        integrate(&mut self.particles, dt, self.drag);
        damp_internally(&mut self.particles, dt, self.internal_damping);
    }

    /// One sweep over the constraints.
    pub(crate) fn sweep(&mut self, sweep: Sweep) {
        let share = |s: Stiffness| Shares::One(s.share(sweep.dt));
        let shape = match &self.only_groups_of {
            None => share(self.shape),
            Some(list) => {
                self.shares.clear();
                self.shares.resize(self.particles.len(), Share::default());
                for &i in list {
                    self.shares[i as usize] = self.shape.share(sweep.dt);
                }
                Shares::Each(&self.shares)
            }
        };
        match &mut self.matching {
            Matching::GaussSeidel(turning) => match_shapes(&mut self.groups, &mut self.particles, shape, *turning, sweep),
            Matching::Jacobi(jacobi) => jacobi.match_shapes(&mut self.groups, &mut self.particles, shape, sweep),
        }
        solve_distances(&mut self.edges, &mut self.particles, share(self.tension), share(self.compression), sweep);
        solve_torsion(&mut self.edges, &mut self.particles, share(self.torsion), sweep);
        if let (Some(rods), 0) = (&self.rods, sweep.index) {
            match &mut self.direct {
                Some(direct) => {
                    direct.solve(rods, &mut self.particles, sweep.dt);
                }
                None => {
                    solve_calibrated_edges(rods, &mut self.particles, sweep);
                    solve_rings(&self.rings, &mut self.particles, sweep.dt);
                }
            }
        }
        match_explicit_groups(&mut self.explicit, &mut self.particles, sweep);
    }

    fn detect(&mut self) {
        self.contacts.list.clear();
        if let Some((normal, friction)) = self.floor {
            let point = (-normal.as_dvec3() * normal.as_dvec3().dot(self.origin)).as_vec3a();
            let (velocity, angular_velocity) = (Vec3A::ZERO, Vec3A::ZERO);
            self.contacts.list.extend((0..self.particles.len() as u32).map(|particle| Contact {
                particle,
                friction,
                point,
                normal,
                velocity,
                angular_velocity,
                impulse: 0.0,
            }));
        }
    }

    fn is_pinned(&self) -> bool {
        self.particles.inverse_mass.contains(&0.0)
    }

    fn follow(&mut self) {
        if self.is_pinned() {
            return;
        }
        let shift = self.particles.center_of_mass();
        self.origin += shift.as_dvec3();
        self.particles.shift_origin(shift);
    }
}

/// What a body carries.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Carried {
    pub(crate) mass: f64,
    pub(crate) linear: DVec3,
    pub(crate) angular: DVec3,
    pub(crate) energy: f64,
}
