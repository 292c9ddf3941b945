//! Pins to rigid bodies: driven ones lead, dynamic ones pull and are pulled.

use bevy::math::{DVec3, Vec3A};
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Particles, PinBroken};
use polpo_rapier::{PushRigidBodies, RapierWorld, RigidBodyFollower};
use polpo_tests::{cube, simulation, simulation_at, steps};
use rapier3d::prelude::*;

fn rapier(app: &mut App) -> Mut<'_, RapierWorld> {
    app.world_mut().resource_mut::<RapierWorld>()
}

/// A rigid body and the entity that follows it. Its collider, a ball, meets nothing.
fn add(app: &mut App, body: RigidBodyBuilder, mass: f32) -> (RigidBodyHandle, Entity) {
    let mut world = rapier(app);
    let world = &mut *world;
    let body = world.bodies.insert(body);
    let collider = ColliderBuilder::ball(0.3).mass(mass).collision_groups(InteractionGroups::none());
    world.colliders.insert_with_parent(collider, body, &mut world.bodies);
    (body, app.world_mut().spawn((Transform::default(), RigidBodyFollower(body))).id())
}

fn place(app: &App, body: Entity, i: usize) -> Vec3 {
    app.world().get::<Transform>(body).unwrap().translation + Vec3::from(app.world().get::<Particles>(body).unwrap().position[i])
}

fn rigid(app: &App, body: RigidBodyHandle) -> &RigidBody {
    &app.world().resource::<RapierWorld>().bodies[body]
}

/// Where a place of the rigid body is.
fn on(app: &App, body: RigidBodyHandle, offset: Vec3) -> Vec3 {
    rigid(app, body).position().transform_point(offset)
}

#[test]
fn a_pin_follows_a_driven_body() {
    for by_velocity in [false, true] {
        let mut app = simulation();
        let body = if by_velocity {
            RigidBodyBuilder::kinematic_velocity_based().linvel(Vec3::new(1.0, 0.0, 0.5)).angvel(Vec3::Y * 3.0)
        } else {
            RigidBodyBuilder::kinematic_position_based()
        };
        let (hook, follower) = add(&mut app, body, 1.0);
        let offset = Vec3::new(0.1, -0.2, 0.0);
        let jelly = app.world_mut().spawn((SoftBody::new(cube(3, 0.3, 1.0)), Transform::from_translation(offset + Vec3::splat(0.1)))).id();
        app.world_mut().entity_mut(jelly).insert(Pins { list: vec![Pin::to_entity(0, follower, offset).clamped()] });
        let mut worst = 0.0f32;
        for k in 0..120 {
            if !by_velocity {
                let turn = Quat::from_rotation_y(0.05 * (k + 1) as f32);
                rapier(&mut app).bodies[hook].set_next_kinematic_position(Pose::from_parts(Vec3::X * (0.02 * (k + 1) as f32), turn));
            }
            steps(&mut app, 1);
            if k > 0 {
                worst = worst.max(place(&app, jelly, 0).distance(on(&app, hook, offset)));
                let turned = app.world().get::<Particles>(jelly).unwrap().rotation[0];
                worst = worst.max(turned.angle_between(*rigid(&app, hook).rotation()) * 0.1);
            }
        }
        println!("by velocity {by_velocity}: {worst:.1e} m");
        // Rapier turns a body by small steps, the pin by the whole one.
        assert!(worst < 2e-4, "{worst} m away");
        let shown = app.world().get::<Transform>(follower).unwrap();
        assert_eq!(shown.translation, rigid(&app, hook).translation());
    }
}

/// Without `PushRigidBodies` a dynamic body leads as a driven one does, and feels nothing.
#[test]
fn a_pin_to_a_dynamic_body_pulls_one_way_unless_asked() {
    let mut app = simulation();
    let (hook, follower) = add(&mut app, RigidBodyBuilder::dynamic().linvel(Vec3::X).gravity_scale(0.0), 1.0);
    let jelly = app.world_mut().spawn((SoftBody::new(cube(3, 0.3, 1.0)), Transform::from_translation(Vec3::splat(0.1)))).id();
    app.world_mut().entity_mut(jelly).insert(Pins { list: vec![Pin::to_entity(0, follower, Vec3::ZERO)] });
    steps(&mut app, 60);
    assert_eq!(rigid(&app, hook).linvel(), Vec3::X);
    assert!(place(&app, jelly, 0).distance(on(&app, hook, Vec3::ZERO)) < 1e-4);
}

/// Asleep on one pin, then one of them is pushed: from the first step on each pulls the other.
#[test]
fn a_pair_on_a_pin_wakes_with_all_its_momentum() {
    for ball_is_pushed in [false, true] {
        let mut app = simulation();
        app.insert_resource(Gravity(Vec3::ZERO));
        let jelly = app.world_mut().spawn((SoftBody::new(cube(3, 0.3, 2.0)), PushRigidBodies)).id();
        let corner = place(&app, jelly, 0);
        let (ball, follower) = add(&mut app, RigidBodyBuilder::dynamic().translation(corner - Vec3::X * 0.3), 3.0);
        app.world_mut().entity_mut(jelly).insert(Pins { list: vec![Pin::to_entity(0, follower, Vec3::X * 0.3)] });
        steps(&mut app, 3);
        app.world_mut().entity_mut(jelly).insert(Sleeping::default());
        steps(&mut app, 3);
        assert!(app.world().entity(jelly).contains::<Sleeping>());
        let momentum = |app: &App| {
            let p = app.world().get::<Particles>(jelly).unwrap();
            let soft: DVec3 = p.velocity.iter().zip(&p.mass).map(|(v, m)| v.as_dvec3() * f64::from(*m)).sum();
            soft + rigid(app, ball).linvel().as_dvec3() * f64::from(rigid(app, ball).mass())
        };
        if ball_is_pushed {
            rapier(&mut app).bodies[ball].set_linvel(Vec3::Z, true);
        } else {
            app.world_mut().get_mut::<Particles>(jelly).unwrap().set_rigid_velocity(Vec3A::Z, Vec3A::ZERO);
        }
        let before = momentum(&app);
        steps(&mut app, 1);
        assert!(!app.world().entity(jelly).contains::<Sleeping>());
        let lost = (momentum(&app) - before).length() / before.length();
        println!("ball pushed {ball_is_pushed}: {lost:.1e}");
        assert!(lost < 1e-5, "ball pushed {ball_is_pushed}: {lost} lost in the step in which they wake");
    }
}

/// In free space a jelly and a ball on one pin turn about each other and lose nothing.
#[test]
fn a_pair_on_a_pin_keeps_momentum() {
    for rate in [30.0, 60.0, 240.0] {
        for clamped in [false, true] {
            let mut app = simulation_at(rate);
            app.insert_resource(Gravity(Vec3::ZERO));
            let start = InitialVelocity { linear: Vec3::new(0.0, 0.0, 2.0), angular: Vec3::ZERO };
            let jelly = app.world_mut().spawn((SoftBody::new(cube(3, 0.3, 2.0)), Transform::default(), start, PushRigidBodies)).id();
            let corner = place(&app, jelly, 0);
            let (ball, follower) = add(&mut app, RigidBodyBuilder::dynamic().translation(corner - Vec3::X * 0.3), 3.0);
            let pin = Pin::to_entity(0, follower, Vec3::X * 0.3);
            app.world_mut().entity_mut(jelly).insert(Pins { list: vec![if clamped { pin.clamped() } else { pin }] });
            let momenta = |app: &App| {
                let p = app.world().get::<Particles>(jelly).unwrap();
                let origin = app.world().get::<Transform>(jelly).unwrap().translation.as_dvec3();
                let body = rigid(app, ball);
                let own = body.linvel().as_dvec3() * f64::from(body.mass());
                let inertia = f64::from(body.mass_properties().local_mprops.principal_inertia().x);
                let mut sum = [own, body.center_of_mass().as_dvec3().cross(own) + body.angvel().as_dvec3() * inertia];
                for i in 0..p.len() {
                    let own: DVec3 = p.velocity[i].as_dvec3() * f64::from(p.mass[i]);
                    sum[0] += own;
                    sum[1] += (origin + p.position[i].as_dvec3()).cross(own) + p.angular_velocity[i].as_dvec3() * f64::from(p.inertia[i]);
                }
                sum
            };
            steps(&mut app, 1);
            let before = momenta(&app);
            let mut worst = 0.0f32;
            for _ in 0..(5.0 * rate) as usize {
                steps(&mut app, 1);
                worst = worst.max(place(&app, jelly, 0).distance(on(&app, ball, Vec3::X * 0.3)));
            }
            let after = momenta(&app);
            let error = [0, 1].map(|k| (after[k] - before[k]).length() / before[0].length());
            println!(
                "{rate} Hz, clamped {clamped}: pin {worst:.1e} m, dP {:.1e}, dL {:.1e}, ball {}",
                error[0],
                error[1],
                rigid(&app, ball).linvel()
            );
            assert!(rigid(&app, ball).linvel().length() > 0.3);
            assert!(worst < 5e-5, "{worst} m");
            assert!(error[0] < 1e-5 && error[1] < 2e-4, "{error:?}");
        }
    }
}

/// A jelly of 2 kg hangs from the end of an arm of 5 kg that swings on a hinge. The pin holds, and at rest all hangs below the hinge.
#[test]
fn a_jelly_hangs_from_a_swinging_arm() {
    for rate in [60.0, 240.0] {
        let mut app = simulation_at(rate);
        let (arm, follower) = {
            let arm = add(&mut app, RigidBodyBuilder::dynamic().translation(Vec3::X * 0.5).angular_damping(0.5), 5.0);
            let mut world = rapier(&mut app);
            let world = &mut *world;
            let post = world.bodies.insert(RigidBodyBuilder::fixed());
            world.impulse_joints.insert(post, arm.0, RevoluteJointBuilder::new(Vec3::Z).local_anchor2(Vec3::X * -0.5), true);
            arm
        };
        let end = Vec3::X * 0.5;
        let jelly =
            app.world_mut().spawn((SoftBody::new(cube(3, 0.3, 2.0)), Transform::from_translation(Vec3::X + 0.1), PushRigidBodies)).id();
        app.world_mut()
            .entity_mut(jelly)
            .insert((Pins { list: vec![Pin::to_entity(0, follower, end)] }, Damping { drag: 0.5, internal: 2.0 }));
        let mut worst = 0.0f32;
        for _ in 0..(12.0 * rate) as usize {
            steps(&mut app, 1);
            worst = worst.max(place(&app, jelly, 0).distance(on(&app, arm, end)));
        }
        let at = rigid(&app, arm).translation();
        println!("{rate} Hz: pin {worst:.1e} m, arm at {at}, {}", rigid(&app, arm).angvel());
        assert!(worst < 0.02, "{worst} m");
        assert!((at - Vec3::Y * -0.5).length() < 0.05, "{at}");
    }
}

#[test]
fn a_pin_to_a_dynamic_body_breaks_at_its_force() {
    #[derive(Resource, Default)]
    struct Broken(Vec<f32>);
    // 1 kg hangs on a heavy ball that nothing pulls down: 9.81 N at rest, less than three times that when it drops onto the pin.
    for (force, breaks) in [(5.0, true), (60.0, false)] {
        let mut app = simulation();
        app.init_resource::<Broken>().add_observer(|broken: On<PinBroken>, mut all: ResMut<Broken>| all.0.push(broken.force));
        let (ball, follower) = add(&mut app, RigidBodyBuilder::dynamic().gravity_scale(0.0).linear_damping(0.0), 1000.0);
        let jelly =
            app.world_mut().spawn((SoftBody::new(cube(3, 0.3, 1.0)), Transform::from_translation(Vec3::splat(0.1)), PushRigidBodies)).id();
        app.world_mut().entity_mut(jelly).insert(Pins { list: vec![Pin::to_entity(0, follower, Vec3::ZERO).breaking_at(force)] });
        steps(&mut app, 120);
        assert_eq!(app.world().resource::<Broken>().0.len(), usize::from(breaks), "{force} N: {:?}", app.world().resource::<Broken>().0);
        // What hangs on it pulls it down: two seconds of 9.81 N on a tonne.
        let speed = rigid(&app, ball).linvel().y;
        assert_eq!((speed + 0.0196).abs() < 2e-3, !breaks, "{speed} m/s");
    }
}
