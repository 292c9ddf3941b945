//! NaN and infinity put anywhere at run time: refused by name or quarantined with an event, and the other bodies never know.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{
    EdgeStiffness, Frozen, Material, ParameterRefused, ParticleStiffness, Particles, RodSolve, Rods, Section, Stillness, state_hash,
};
use polpo_rapier::RapierWorld;
use polpo_tests::{lattice, simulation, steps};
use rapier3d::prelude::*;

#[derive(Resource, Default, Clone, PartialEq, Debug)]
struct Told {
    frozen: Vec<(Entity, String)>,
    refused: Vec<String>,
}

/// A culprit on a floor with everything there is, between two others; one of them touches a ball that will be spoiled, too.
struct Lab {
    app: App,
    culprit: Entity,
    others: [Entity; 2],
    ball: ColliderHandle,
    moving: RigidBodyHandle,
}

impl Lab {
    fn new() -> Self {
        let mut app = simulation();
        app.init_resource::<Told>()
            .add_observer(|frozen: On<BodyFrozen>, mut told: ResMut<Told>| told.frozen.push((frozen.entity, frozen.reason.to_string())))
            .add_observer(|refused: On<ParameterRefused>, mut told: ResMut<Told>| told.refused.push(refused.to_string()));
        let mut rapier = app.world_mut().resource_mut::<RapierWorld>();
        rapier.insert_fixed(ColliderBuilder::halfspace(rapier3d::na::Unit::new_unchecked(Vec3::Y)));
        let ball = rapier.insert_fixed(ColliderBuilder::ball(0.2).translation(Vec3::new(5.0, 0.1, 0.0)));
        let moving =
            rapier.bodies.insert(RigidBodyBuilder::kinematic_velocity_based().translation(Vec3::new(5.0, 0.0, 0.3)).angvel(Vec3::Y));
        let RapierWorld { bodies, colliders, .. } = &mut *rapier;
        colliders.insert_with_parent(ColliderBuilder::cuboid(0.1, 0.05, 0.1), moving, bodies);
        let mut spawn = |x: f32| {
            let awake = Sleep { time: f32::INFINITY, ..default() };
            app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(x, 0.3, 0.0), awake)).id()
        };
        let (culprit, others) = (spawn(5.0), [spawn(0.0), spawn(2.0)]);
        app.world_mut().entity_mut(others[1]).insert(AirDrag::default());
        let material = Material { youngs_modulus: 1e5, poissons_ratio: 0.4, density: 1000.0 };
        app.world_mut().entity_mut(culprit).insert((
            Rods { solve: RodSolve::Sweep { spin_radius: 0.05 }, ..Rods::new(material, Section::circle(0.02)) },
            AirDrag::default(),
            GravityScale(1.0),
            Grab { particle: 3, target: Vec3::new(5.0, 0.3, 0.0), stiffness: Stiffness::hertz(3.0) },
            Pins { list: vec![Pin::at(1, Vec3::new(5.0, 0.3, 0.0)).breaking_at(1e3)] },
            ParticleStiffness::new(vec![Stiffness::hertz(20.0); 27]),
            EdgeStiffness::new(Some(vec![Stiffness::hertz(20.0); 90]), None, None),
        ));
        steps(&mut app, 20);
        assert_eq!(app.world().resource::<Told>(), &Told::default());
        Self { app, culprit, others, ball, moving }
    }

    fn others(&self) -> u64 {
        let world = self.app.world();
        state_hash(self.others.iter().map(|&b| (world.get::<Transform>(b).unwrap(), world.get::<Particles>(b).unwrap())))
    }
}

/// What a culprit must lead to.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Fate {
    /// The body is frozen, and the reason names this.
    Frozen(&'static str),
    /// The resource keeps its value, and the event names it.
    Refused(&'static str),
    /// The number has a meaning that is documented, or whoever has it is left out: the body goes on, finite.
    GoesOn,
}
use Fate::{Frozen as Freezes, GoesOn, Refused};

type Spoil = fn(&mut World, &Lab2, f32);

/// Whom a row of the table may spoil.
#[derive(Clone, Copy)]
struct Lab2 {
    culprit: Entity,
    ball: ColliderHandle,
    moving: RigidBodyHandle,
}

fn particles(world: &mut World, lab: &Lab2, spoil: impl FnOnce(&mut polpo_solver::Particles)) {
    spoil(&mut world.get_mut::<Particles>(lab.culprit).unwrap());
}

fn with<T: Component<Mutability = bevy::ecs::component::Mutable>>(world: &mut World, lab: &Lab2, spoil: impl FnOnce(&mut T)) {
    spoil(&mut world.get_mut::<T>(lab.culprit).unwrap());
}

fn collider(world: &mut World, lab: &Lab2, spoil: impl FnOnce(&mut Collider)) {
    spoil(world.resource_mut::<RapierWorld>().colliders.get_mut(lab.ball).unwrap());
}

fn rigid(world: &mut World, lab: &Lab2, spoil: impl FnOnce(&mut RigidBody)) {
    spoil(world.resource_mut::<RapierWorld>().bodies.get_mut(lab.moving).unwrap());
}

const CULPRITS: &[(&str, Fate, Spoil)] = &[
    ("position", Freezes("position"), |w, l, x| particles(w, l, |p| p.position[7].y = x)),
    ("velocity", Freezes("velocity"), |w, l, x| particles(w, l, |p| p.velocity[7].y = x)),
    ("spin", Freezes("angular_velocity"), |w, l, x| particles(w, l, |p| p.angular_velocity[7].y = x)),
    ("rotation", Freezes("rotation"), |w, l, x| particles(w, l, |p| p.rotation[7].w = x)),
    ("zero rotation", Freezes("rotation"), |w, l, _| particles(w, l, |p| p.rotation[7] = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0))),
    ("previous position", GoesOn, |w, l, x| particles(w, l, |p| p.previous_position[7].y = x)),
    ("mass", Freezes("mass"), |w, l, x| particles(w, l, |p| p.mass[7] = x)),
    ("inverse mass", Freezes("inverse_mass"), |w, l, x| particles(w, l, |p| p.inverse_mass[7] = x)),
    ("inertia", Freezes("inertia"), |w, l, x| particles(w, l, |p| p.inertia[7] = x)),
    ("inverse inertia", Freezes("inverse_inertia"), |w, l, x| particles(w, l, |p| p.inverse_inertia[7] = x)),
    ("rest position", Freezes("rest_position"), |w, l, x| particles(w, l, |p| p.rest_position[7].y = x)),
    ("frame", Freezes("frame"), |w, l, x| particles(w, l, |p| p.frame[7].x = x)),
    ("radii", Freezes("radii"), |w, l, x| particles(w, l, |p| p.radii[7].y = x)),
    ("few positions", Freezes("position has 3"), |w, l, _| particles(w, l, |p| p.position.truncate(3))),
    ("no velocities", Freezes("velocity has 0"), |w, l, _| particles(w, l, |p| p.velocity.clear())),
    ("many rotations", Freezes("rotation has 28"), |w, l, _| particles(w, l, |p| p.rotation.push(Quat::IDENTITY))),
    ("few masses", Freezes("mass has 5"), |w, l, _| particles(w, l, |p| p.mass.truncate(5))),
    ("few radii", Freezes("radii has 5"), |w, l, _| particles(w, l, |p| p.radii.truncate(5))),
    ("few frames", Freezes("frame has 5"), |w, l, _| particles(w, l, |p| p.frame.truncate(5))),
    ("few rest positions", Freezes("rest_position has 5"), |w, l, _| particles(w, l, |p| p.rest_position.truncate(5))),
    ("no particles", Freezes("position has 0"), |w, l, _| particles(w, l, |p| *p = default())),
    ("translation", Freezes("translation"), |w, l, x| with::<Transform>(w, l, |t| t.translation.z = x)),
    ("turn", Freezes("rotation"), |w, l, x| with::<Transform>(w, l, |t| t.rotation.z = x)),
    ("scale", Freezes("scale"), |w, l, x| with::<Transform>(w, l, |t| t.scale.z = x)),
    ("gravity scale", Freezes("position"), |w, l, x| with::<GravityScale>(w, l, |g| g.0 = x)),
    ("shape matching", GoesOn, |w, l, x| with::<ShapeMatching>(w, l, |s| s.stiffness = Stiffness::damped(x, x))),
    ("fraction", GoesOn, |w, l, x| with::<ShapeMatching>(w, l, |s| s.stiffness = Stiffness::Fraction(x))),
    ("tension", GoesOn, |w, l, x| with::<DistanceConstraints>(w, l, |s| s.tension = Stiffness::damped(x, x))),
    ("torsion", GoesOn, |w, l, x| with::<Torsion>(w, l, |s| s.stiffness = Stiffness::damped(x, x))),
    ("particle stiffness", GoesOn, |w, l, x| with::<ParticleStiffness>(w, l, |s| s.get_mut()[7] = Stiffness::hertz(x))),
    ("edge stiffness", GoesOn, |w, l, x| {
        with::<EdgeStiffness>(w, l, |s| *s = EdgeStiffness::new(None, None, Some(vec![Stiffness::damped(x, x); 9])));
    }),
    ("damping", GoesOn, |w, l, x| with::<Damping>(w, l, |d| *d = Damping { drag: x, internal: x })),
    ("friction", GoesOn, |w, l, x| with::<Collision>(w, l, |c| c.friction = x)),
    ("push speed", GoesOn, |w, l, x| with::<Collision>(w, l, |c| c.push_speed = x)),
    ("grab", GoesOn, |w, l, x| with::<Grab>(w, l, |g| g.target.y = x)),
    ("grab's stiffness", GoesOn, |w, l, x| with::<Grab>(w, l, |g| g.stiffness = Stiffness::hertz(x))),
    ("pin", GoesOn, |w, l, x| with::<Pins>(w, l, |p| p.list.push(Pin::at(5, Vec3::splat(x))))),
    ("pin's force", GoesOn, |w, l, x| with::<Pins>(w, l, |p| p.list.push(Pin::at(5, Vec3::Y).breaking_at(x)))),
    ("pin's entity", GoesOn, |w, l, x| {
        let hand = w.spawn((Transform::from_xyz(x, 0.0, 0.0), GlobalTransform::default())).id();
        with::<Pins>(w, l, |p| p.list.push(Pin::to_entity(5, hand, Vec3::ZERO)));
    }),
    ("air drag", GoesOn, |w, l, x| with::<AirDrag>(w, l, |d| *d = AirDrag { density: x, coefficient: x })),
    ("rods", GoesOn, |w, l, x| with::<Rods>(w, l, |r| r.material.youngs_modulus = x)),
    ("rods' spin", GoesOn, |w, l, x| with::<Rods>(w, l, |r| r.solve = RodSolve::Sweep { spin_radius: x })),
    ("sleep", GoesOn, |w, l, x| with::<Sleep>(w, l, |s| *s = Sleep { speed: x, time: x })),
    ("stillness", GoesOn, |w, l, x| with::<Stillness>(w, l, |s| s.0 = x)),
    ("gravity", Refused("Gravity"), |w, _, x| w.insert_resource(Gravity(Vec3::new(0.0, x, 0.0)))),
    ("wind", Refused("Wind"), |w, _, x| w.insert_resource(Wind(Vec3::new(x, 0.0, 0.0)))),
    ("collider's place", GoesOn, |w, l, x| collider(w, l, |c| c.set_translation(Vec3::splat(x)))),
    ("collider's turn", GoesOn, |w, l, x| collider(w, l, |c| c.set_rotation(Rotation::from_xyzw(x, 0.0, 0.0, 1.0)))),
    ("collider's friction", GoesOn, |w, l, x| collider(w, l, |c| c.set_friction(x))),
    ("collider's radius", GoesOn, |w, l, x| collider(w, l, |c| c.set_shape(SharedShape::ball(x)))),
    ("cuboid", GoesOn, |w, l, x| collider(w, l, |c| c.set_shape(SharedShape::cuboid(0.2, x, 0.2)))),
    ("capsule", GoesOn, |w, l, x| collider(w, l, |c| c.set_shape(SharedShape::capsule_y(x, 0.1)))),
    ("triangle", GoesOn, |w, l, x| collider(w, l, |c| c.set_shape(SharedShape::triangle(Vec3::X, Vec3::NEG_X, Vec3::splat(x))))),
    ("driven velocity", GoesOn, |w, l, x| rigid(w, l, |b| b.set_linvel(Vec3::splat(x), true))),
    ("driven spin", GoesOn, |w, l, x| rigid(w, l, |b| b.set_angvel(Vec3::splat(x), true))),
    ("rigid body's place", GoesOn, |w, l, x| rigid(w, l, |b| b.set_translation(Vec3::splat(x), true))),
];

#[test]
fn one_bad_number_is_one_bodys_business() {
    let mut good = Lab::new();
    steps(&mut good.app, 12);
    let expected = good.others();
    let mut failures = Vec::new();
    for &(name, fate, spoil) in CULPRITS {
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let found = std::panic::catch_unwind(|| {
                let mut lab = Lab::new();
                let whom = Lab2 { culprit: lab.culprit, ball: lab.ball, moving: lab.moving };
                spoil(lab.app.world_mut(), &whom, x);
                steps(&mut lab.app, 12);
                let world = lab.app.world();
                let told = world.resource::<Told>().clone();
                let body = world.get::<Particles>(lab.culprit).unwrap();
                let finite = body.is_finite() && world.get::<Transform>(lab.culprit).unwrap().is_finite();
                (lab.others() == expected, finite, told, world.get::<Frozen>(lab.culprit).is_some(), lab.culprit)
            });
            let Ok((same, finite, told, frozen, culprit)) = found else {
                failures.push(format!("{name} {x}: panicked"));
                continue;
            };
            let fits = match fate {
                Freezes(what) => frozen && told.frozen.len() == 1 && told.frozen[0].0 == culprit && told.frozen[0].1.contains(what),
                Refused(what) => !frozen && told.refused.len() == 1 && told.refused[0].starts_with(what),
                GoesOn => !frozen && told == Told::default(),
            };
            if !(fits && same && finite) {
                failures.push(format!("{name} {x}: fits {fits}, others the same {same}, finite {finite}, frozen {frozen}, {told:?}"));
            }
        }
    }
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

#[test]
fn a_frozen_body_that_is_put_right_goes_on() {
    let mut lab = Lab::new();
    let good = lab.app.world().get::<Particles>(lab.culprit).unwrap().0.clone();
    lab.app.world_mut().get_mut::<Particles>(lab.culprit).unwrap().radii.truncate(3);
    steps(&mut lab.app, 3);
    // Thawed as it is, it freezes again.
    lab.app.world_mut().entity_mut(lab.culprit).remove::<Frozen>();
    steps(&mut lab.app, 3);
    assert_eq!(lab.app.world().resource::<Told>().frozen.len(), 2);
    lab.app.world_mut().get_mut::<Particles>(lab.culprit).unwrap().radii = good.radii;
    lab.app.world_mut().entity_mut(lab.culprit).remove::<Frozen>();
    steps(&mut lab.app, 3);
    assert!(lab.app.world().get::<Frozen>(lab.culprit).is_none());
    assert_ne!(lab.app.world().get::<Particles>(lab.culprit).unwrap().velocity[0], Vec3A::ZERO);
}
