//! The solver's kernels on a body's state, called by hand in the order in which the plugin's schedule runs them.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Contacts, Edges, ImplicitGroups, Particles};
use polpo_rapier::{ContactDetector, DetectionInput, Obstacles, RapierWorld};
use polpo_solver::{
    FreePositions, PAIR_PASSES, PairFinder, PairRules, PairSearch, Pairs, SelfSearch, Shares, Sides, Stiffness, Sweep, damp_internally,
    find_support, integrate, match_shapes, momentum, predict, restore_angular_momentum, solve_contacts, solve_distances, solve_pairs,
    solve_torsion,
};

use crate::ours::{Ours, STEP, collider};
use crate::scene::floor;
use crate::shape::extent;

/// Gravity's acceleration \[m/s²\].
const GRAVITY: Vec3A = Vec3A::new(0.0, -9.81, 0.0);

/// A body without an ECS.
pub(crate) struct Bare {
    particles: polpo_solver::Particles,
    groups: polpo_solver::ImplicitGroups,
    edges: polpo_solver::Edges,
    contacts: polpo_solver::Contacts,
    planes: Planes,
    own: SelfSearch,
    finder: PairFinder,
    pairs: Pairs,
    support: Vec<Vec3A>,
    components: Components,
    settings: SolverSettings,
}

/// Where the planes come from on which the body lies.
enum Planes {
    /// From the plugin's last step.
    Given(polpo_solver::Contacts),
    /// Found anew in every step, as `polpo_rapier` does.
    Found(Box<Detection>),
}

/// What finding them takes.
struct Detection {
    world: RapierWorld,
    obstacles: Obstacles,
    detector: ContactDetector,
    free: FreePositions,
    origin: Vec3,
}

/// How the body is.
#[derive(Clone, Copy)]
struct Components {
    matching: ShapeMatching,
    distance: DistanceConstraints,
    torsion: Torsion,
    damping: Damping,
    collision: Collision,
    own: SelfContact,
}

impl Bare {
    /// The first body of `ours` as it is now, on planes that stay as they are.
    pub(crate) fn on_given_planes(ours: &Ours) -> Self {
        let contacts = get::<Contacts>(ours).0.clone();
        Self::new(ours, Planes::Given(contacts))
    }

    /// The same, which looks for the floor in every step.
    pub(crate) fn on_floor(ours: &Ours) -> Self {
        let mut world = RapierWorld::default();
        world.insert_fixed(collider(&floor()));
        let (obstacles, detector, free) = <(Obstacles, ContactDetector, FreePositions)>::default();
        let origin = get::<Transform>(ours).translation;
        Self::new(ours, Planes::Found(Box::new(Detection { world, obstacles, detector, free, origin })))
    }

    fn new(ours: &Ours, planes: Planes) -> Self {
        let particles = get::<Particles>(ours).0.clone();
        let own = SelfSearch::new(&particles, &get::<SoftBody>(ours).rig.edges).expect("the body touches itself already");
        Self {
            particles,
            groups: get::<ImplicitGroups>(ours).0.clone(),
            edges: get::<Edges>(ours).0.clone(),
            contacts: default(),
            planes,
            own,
            finder: default(),
            pairs: default(),
            support: Vec::new(),
            components: Components {
                matching: *get(ours),
                distance: *get(ours),
                torsion: *get(ours),
                damping: *get(ours),
                collision: *get(ours),
                own: *get(ours),
            },
            settings: *ours.app.world().resource::<SolverSettings>(),
        }
    }

    /// The plugin's step.
    pub(crate) fn step(&mut self) {
        let search = PairSearch { dt: STEP, gain: GRAVITY.length() * STEP };
        self.own.find(&self.particles, &search, &mut self.finder, &mut self.pairs);
        match &mut self.planes {
            Planes::Given(contacts) => self.contacts.clone_from(contacts),
            Planes::Found(detection) => detection.detect(&self.particles, &self.components.collision, &mut self.contacts),
        }
        self.groups.forget_rotations(&self.particles);
        for _ in 0..self.settings.substeps {
            self.substep(STEP / self.settings.substeps as f32);
        }
        // The planes that are given are where they were; so is the origin.
        if let Planes::Found(detection) = &mut self.planes {
            let shift = self.particles.center_of_mass();
            self.particles.shift_origin(shift);
            detection.origin += Vec3::from(shift);
            detection.free.position.iter_mut().for_each(|x| *x -= Vec3::from(shift));
        }
    }

    fn substep(&mut self, dt: f32) {
        let Self { particles, groups, edges, components: c, .. } = self;
        let share = |stiffness: Stiffness| Shares::One(stiffness.share(dt));
        predict(particles, GRAVITY, dt);
        let before = momentum(particles).angular;
        for index in 0..self.settings.iterations {
            let sweep = Sweep { dt, index, count: self.settings.iterations, deterministic: self.settings.deterministic };
            match_shapes(groups, particles, share(c.matching.stiffness), c.matching.turning, sweep);
            solve_distances(edges, particles, share(c.distance.tension), share(c.distance.compression), sweep);
            solve_torsion(edges, particles, share(c.torsion.stiffness), sweep);
        }
        restore_angular_momentum(particles, before, dt);
        self.support.clear();
        if self.pairs.ask_for_support() {
            find_support(&self.contacts, particles, dt, &mut self.support);
        }
        let rules = PairRules { dt, friction: c.own.friction, push_speed: c.own.push_speed };
        let mut sides = Sides::Within { particles, support: &self.support };
        for pass in 0..PAIR_PASSES {
            solve_pairs(&mut self.pairs, &mut sides, &rules, pass);
        }
        solve_contacts(&mut self.contacts, particles, dt, c.collision.push_speed);
        integrate(particles, dt, c.damping.drag);
        damp_internally(particles, dt, c.damping.internal);
    }

    /// From the lowest particle to the highest \[m\].
    pub(crate) fn height(&self) -> f32 {
        extent(self.particles.position.iter().map(|x| x.y))
    }
}

impl Detection {
    fn detect(&mut self, particles: &polpo_solver::Particles, collision: &Collision, contacts: &mut polpo_solver::Contacts) {
        self.obstacles.gather(&self.world.bodies, &self.world.colliders, STEP);
        let input = DetectionInput {
            particles,
            origin: self.origin,
            acceleration: GRAVITY.into(),
            dt: STEP,
            friction: collision.friction,
            frictions: &[],
            memberships: collision.memberships,
            filter: collision.filter,
        };
        self.detector.detect(&input, &self.obstacles, &self.world.colliders, &mut self.free, contacts);
    }
}

fn get<C: Component>(ours: &Ours) -> &C {
    ours.app.world().get(ours.bodies[0]).expect("a body comes with it")
}
