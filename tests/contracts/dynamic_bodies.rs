//! Soft bodies and dynamic rigid ones push each other, whatever their masses; without the component nothing is pushed.

use bevy::math::{DVec3, Vec3A};
use bevy::prelude::*;
use polpo::Particles;
use polpo::prelude::*;
use polpo_rapier::{PushRigidBodies, PushState, RapierWorld, TouchedColliders};
use polpo_tests::{cube, simulation, simulation_at, steps};
use rapier3d::prelude::*;

fn rapier(app: &mut App) -> Mut<'_, RapierWorld> {
    app.world_mut().resource_mut::<RapierWorld>()
}

fn floor(app: &mut App) {
    rapier(app).insert_fixed(ColliderBuilder::cuboid(20.0, 0.5, 20.0).translation(Vec3::Y * -0.5).friction(0.6));
}

fn add(app: &mut App, body: RigidBodyBuilder, collider: ColliderBuilder) -> RigidBodyHandle {
    let mut world = rapier(app);
    let world = &mut *world;
    let body = world.bodies.insert(body);
    world.colliders.insert_with_parent(collider.friction(0.6), body, &mut world.bodies);
    body
}

/// A rigid box of these half extents and mass.
fn add_box(app: &mut App, at: Vec3, half: Vec3, mass: f32) -> RigidBodyHandle {
    add(app, RigidBodyBuilder::dynamic().translation(at), ColliderBuilder::cuboid(half.x, half.y, half.z).mass(mass))
}

fn jelly(app: &mut App, rig: polpo_rig::Rig, at: Vec3, velocity: Vec3) -> Entity {
    let start = InitialVelocity { linear: velocity, angular: Vec3::ZERO };
    app.world_mut().spawn((SoftBody::new(rig), Transform::from_translation(at), start, PushRigidBodies)).id()
}

fn rigid(app: &App, body: RigidBodyHandle) -> &RigidBody {
    &app.world().resource::<RapierWorld>().bodies[body]
}

fn soft(app: &App, body: Entity) -> (Vec3, &Particles) {
    (app.world().get::<Transform>(body).unwrap().translation, app.world().get::<Particles>(body).unwrap())
}

fn centers(app: &App, body: Entity) -> impl Iterator<Item = Vec3> + '_ {
    let (origin, particles) = soft(app, body);
    particles.position.iter().map(move |x| origin + Vec3::from(*x))
}

fn mean_velocity(app: &App, body: Entity) -> Vec3 {
    let (_, p) = soft(app, body);
    (p.velocity.iter().zip(&p.mass).map(|(v, m)| *v * *m).sum::<Vec3A>() / p.total_mass()).into()
}

fn penetration(app: &App, body: Entity) -> f32 {
    let (origin, particles) = soft(app, body);
    let world = app.world().resource::<RapierWorld>();
    polpo_rapier::penetration(particles, origin, &world.bodies, &world.colliders)
}

/// P and L, spin included, about the world's origin, of soft bodies and rigid ones.
fn momenta(app: &App, softs: &[Entity], rigids: &[RigidBodyHandle]) -> [DVec3; 2] {
    let mut sum = [DVec3::ZERO; 2];
    for &body in softs {
        let (origin, p) = soft(app, body);
        for i in 0..p.len() {
            let own = p.velocity[i].as_dvec3() * f64::from(p.mass[i]);
            sum[0] += own;
            sum[1] +=
                (origin.as_dvec3() + p.position[i].as_dvec3()).cross(own) + p.angular_velocity[i].as_dvec3() * f64::from(p.inertia[i]);
        }
    }
    for &handle in rigids {
        let body = rigid(app, handle);
        let own = body.linvel().as_dvec3() * f64::from(body.mass());
        let inertia = f64::from(body.mass_properties().local_mprops.principal_inertia().x);
        sum[0] += own;
        sum[1] += body.center_of_mass().as_dvec3().cross(own) + body.angvel().as_dvec3() * inertia;
    }
    sum
}

/// What came of a cube of `n`³ balls, 0.6 m and 1 kg, and a slab of `mass` dropped on it by 2 cm, after four seconds.
struct Crush {
    case: String,
    /// Height of the slab's underside \[m\].
    under: f32,
    /// 1 − cos of its tilt, and how far it went sideways \[m\].
    tilt: f32,
    aside: f32,
    /// Its greatest speed in the last second \[m/s\], and how far it goes \[m\].
    rest: [f32; 2],
    /// How far from the middle a particle came, and is \[m\].
    out: [f32; 2],
    /// How deep a particle was in anything, and is \[m\].
    deep: [f32; 2],
}

/// The slab is flat and wide: a tall box would tip off a jelly whose stiffness against tilting is less than m·g·h, and should.
fn crush(n: usize, stiffness: f32, mass: f32, rate: f32, substeps: u32) -> Crush {
    let mut app = simulation_at(f64::from(rate));
    app.insert_resource(SolverSettings { substeps, iterations: 1, ..default() });
    floor(&mut app);
    let body = jelly(&mut app, cube(n, 0.6, 1.0), Vec3::Y * 0.3, Vec3::ZERO);
    let damped = (ShapeMatching::new(Stiffness::damped(stiffness, 1.0)), Damping { drag: 0.0, internal: 20.0 });
    app.world_mut().entity_mut(body).insert(damped);
    let load = add_box(&mut app, Vec3::Y * 0.72, Vec3::new(0.4, 0.1, 0.4), mass);
    let far = |app: &App| centers(app, body).map(|x| x.x.abs().max(x.z.abs())).fold(0.0, f32::max);
    let (mut rest, mut way, mut out, mut deep) = (0.0f32, 0.0f32, 0.0f32, 0.0f32);
    for k in 0..(4.0 * rate) as usize {
        steps(&mut app, 1);
        assert!(soft(&app, body).1.is_finite());
        out = out.max(far(&app));
        deep = deep.max(penetration(&app, body));
        if k as f32 >= 3.0 * rate {
            let speed = rigid(&app, load).linvel().length();
            (rest, way) = (rest.max(speed), way + speed / rate);
        }
    }
    let place = rigid(&app, load).position();
    let result = Crush {
        case: format!("{n}³, {stiffness} Hz, {mass} kg, {substeps} substeps at {rate} Hz"),
        under: place.translation.y - 0.1,
        tilt: 1.0 - (place.rotation * Vec3::Y).y,
        aside: place.translation.xz().length(),
        rest: [rest, way],
        out: [out, far(&app)],
        deep: [deep, penetration(&app, body)],
    };
    let Crush { case, under, tilt, aside, rest, out, deep } = &result;
    println!(
        "{case}: slab at {under:.5} m, tilt {tilt:.0e}, aside {aside:.4}, {:.0e} m/s and {:.0e} m in the last second, particles out to {out:.3?}, deep {:.1e} then {:.1e}",
        rest[0], rest[1], deep[0], deep[1]
    );
    result
}

/// What the best rival fails at: it throws the cube out. The slab presses it flat, and lies on its particles as on the ground.
#[test]
fn a_soft_cube_stays_under_a_tonne() {
    for n in [3, 5] {
        for mass in [100.0, 1000.0] {
            for rate in [30.0, 60.0, 240.0] {
                let c = crush(n, 2.0, mass, rate, 5);
                let jammed = 0.6 / n as f32;
                assert!((c.under - jammed).abs() < 1e-4 && c.tilt < 1e-6, "{}: at {} {}", c.case, c.under, c.tilt);
                // It lies still to 1e-4 m/s, unless a ball is half under its rim, which lets it tremble by millimetres a second.
                let [fastest, way] = c.rest;
                assert!(fastest < 5e-2 && way < 5e-3 && c.aside < 0.025, "{}: {fastest} m/s, {way} m, {} m aside", c.case, c.aside);
                // The slab reaches out to 0.4 m: a ball may lie half under its rim, none is thrown out. While it is pressed flat at 3 m/s, particles shoot up into the slab that were out of its
                // reach when the step's planes were found: by what slab and particle do in one step.
                let (out, deep) = (if rate < 50.0 { 0.49 } else { 0.44 }, 4.5 / rate);
                assert!(c.out[0] < out, "{}: out to {:?}", c.case, c.out);
                assert!(c.deep[0] < deep && c.deep[1] < 5e-6, "{}: deep {:?}", c.case, c.deep);
            }
        }
    }
}

/// A stiff cube carries 100 kg as a spring does, the same at every step rate if the substeps are the same.
#[test]
fn a_stiff_cube_carries_a_slab() {
    let carried: Vec<Crush> = [(30.0, 80), (60.0, 40), (240.0, 10)].map(|(rate, substeps)| crush(3, 50.0, 100.0, rate, substeps)).into();
    for c in &carried {
        assert!((c.under - carried[2].under).abs() < 1e-3 && c.under > 0.57, "{}: {}", c.case, c.under);
        // The slab bounces at ω = √(g/sag) = 23 rad/s, and springs that are damped critically at 50 Hz, ω₀ = 314 rad/s, damp it by ω²/ω₀ = 1.7/s: of 0.63 m/s, from 2 cm, three seconds leave 3e-3 m/s.
        assert!(c.rest[0] < 1e-2 && c.aside < 2e-3 && c.tilt < 2e-6, "{}: {} m/s, {} m", c.case, c.rest[0], c.aside);
        assert!(c.out[0] < 0.21 && c.deep[0] < 1e-3, "{}: {:?} {:?}", c.case, c.out, c.deep);
    }
}

/// A slab that is too heavy for a soft cube wobbles and tips off it, as a real one would: as a column buckles.
///
/// The cube is a column, clamped below, of the length ℓ = 0.4 m between its lowest and its highest layer's centres, whose springs have the stiffness k_z together and the second moment i² = (2/3)·(0.2 m)² about the middle; the slab's
/// centre of mass is e = 0.2 m above. With EA = k_z·ℓ, Euler gives P_E = x²·EA·i²/ℓ² with x·tan x = ℓ/e, x = 1.0769; shear at ν = ¼ gives P_S = EA/2.5; and 1/P = 1/P_E + 1/P_S (Engesser). So P = k_z·52 mm: a cube that
/// yields by much more than 5 cm under its load lets it tip. k_z is taken from a light slab, which does not know of it.
#[test]
fn a_cube_buckles_as_a_column_does() {
    for stiffness in [25.0, 50.0] {
        let slab = |mass: f32| crush(3, stiffness, mass, 60.0, 20);
        let [light, heavier] = [5.0, 15.0].map(|mass| slab(mass).under);
        let k = 10.0 * 9.81 / (light - heavier);
        let (euler, shear) = (k * 1.0769f32.powi(2) * (0.04 * 2.0 / 3.0) / 0.4, k * 0.4 / 2.5);
        let critical = euler * shear / (euler + shear) / 9.81;
        println!("{stiffness} Hz: {k} N/m, buckles under {critical} kg");
        let (stands, falls) = (slab(0.6 * critical), slab(1.7 * critical));
        assert!(stands.tilt < 1e-5 && stands.aside < 5e-3 && stands.under > 0.55, "{} {} {}", stands.case, stands.tilt, stands.aside);
        assert!(falls.tilt > 0.1 && falls.aside > 0.2, "{} {} {}", falls.case, falls.tilt, falls.aside);
    }
}

#[test]
fn a_jelly_carries_a_light_box() {
    for rate in [30.0, 60.0, 240.0] {
        let mut app = simulation_at(rate);
        floor(&mut app);
        let body = jelly(&mut app, cube(4, 0.8, 50.0), Vec3::Y * 0.4, Vec3::ZERO);
        let load = add_box(&mut app, Vec3::new(0.1, 1.0, 0.05), Vec3::splat(0.15), 1.0);
        steps(&mut app, (3.0 * rate) as usize);
        let mut rest = 0.0f32;
        for _ in 0..rate as usize {
            steps(&mut app, 1);
            rest = rest.max(rigid(&app, load).linvel().length());
        }
        let y = rigid(&app, load).translation().y - 0.15;
        println!("{rate} Hz: box at {y:.4} m, rest {rest:.1e} m/s, {:.1e} m deep", penetration(&app, body));
        assert!(y > 0.72 && y < 0.8, "{rate} Hz: {y}");
        assert!(rest < 2e-3, "{rate} Hz: {rest} m/s");
    }
}

/// Without gravity, a ball of 3 kg with spin hits a jelly of 2 kg off its centre, and a jelly hits a box that rests.
#[test]
fn a_collision_keeps_momentum() {
    for rate in [30.0, 60.0, 240.0] {
        let mut app = simulation_at(rate);
        app.insert_resource(Gravity(Vec3::ZERO));
        let body = jelly(&mut app, cube(3, 0.6, 2.0), Vec3::ZERO, Vec3::new(0.5, 0.0, 0.2));
        let ball =
            RigidBodyBuilder::dynamic().translation(Vec3::new(-1.0, 0.15, 0.1)).linvel(Vec3::X * 4.0).angvel(Vec3::new(2.0, 5.0, -9.0));
        let ball = add(&mut app, ball, ColliderBuilder::ball(0.3).mass(3.0));
        steps(&mut app, 1);
        let before = momenta(&app, &[body], &[ball]);
        steps(&mut app, (2.0 * rate) as usize);
        let after = momenta(&app, &[body], &[ball]);
        let speed = rigid(&app, ball).linvel();
        let error = [0, 1].map(|k| (after[k] - before[k]).length() / before[k].length());
        println!("{rate} Hz: ball {speed}, jelly {}, dP {:.1e}, dL {:.1e}", mean_velocity(&app, body), error[0], error[1]);
        assert!(speed.x < 3.0 && mean_velocity(&app, body).x > speed.x, "{speed}");
        assert!(error[0] < 1e-5 && error[1] < 1e-3, "{error:?}");
    }
}

#[test]
fn a_jelly_pushes_a_free_box() {
    for rate in [30.0, 60.0, 240.0] {
        let mut app = simulation_at(rate);
        app.insert_resource(Gravity(Vec3::ZERO));
        let body = jelly(&mut app, cube(3, 0.6, 2.0), Vec3::X * -0.8, Vec3::X * 3.0);
        app.world_mut().entity_mut(body).insert(Damping { drag: 0.0, internal: 20.0 });
        let load = add_box(&mut app, Vec3::ZERO, Vec3::splat(0.3), 4.0);
        rapier(&mut app).bodies[load].sleep();
        steps(&mut app, (2.0 * rate) as usize);
        let (v, u) = (rigid(&app, load).linvel(), mean_velocity(&app, body));
        // Between a blow that does not bounce, 1 m/s, and one that does, 2 m/s.
        println!("{rate} Hz: box {v}, jelly {u}");
        assert!((2.0 * u.x + 4.0 * v.x - 6.0).abs() < 1e-4, "{u} {v}");
        assert!(v.x > 0.999 && v.x < 2.0 && v.yz().length() < 1e-2, "{v}");
    }
}

/// A jelly that is put on one end of a plank that turns about its middle makes it tip to that side, whichever of Rapier's kinds of joint it hangs on.
#[test]
fn a_seesaw_tips() {
    for (rate, side) in [(60.0, -1.0), (60.0, 1.0), (240.0, -1.0), (240.0, 1.0)] {
        for multibody in [false, true] {
            let mut app = simulation_at(rate);
            let plank = add_box(&mut app, Vec3::Y, Vec3::new(1.5, 0.05, 0.4), 5.0);
            {
                let mut world = rapier(&mut app);
                let world = &mut *world;
                let post = world.bodies.insert(RigidBodyBuilder::fixed().translation(Vec3::Y));
                let hinge = RevoluteJointBuilder::new(Vec3::Z);
                if multibody {
                    let joint = world.multibody_joints.insert(post, plank, hinge, true).expect("a tree");
                    // Rapier damps a multibody's hinges by 0.1 N·m·s.
                    world.multibody_joints.get_mut(joint).expect("it is there").0.damping_mut().fill(0.0);
                } else {
                    world.impulse_joints.insert(post, plank, hinge, true);
                }
            }
            jelly(&mut app, cube(3, 0.4, 2.0), Vec3::new(side, 1.26, 0.0), Vec3::ZERO);
            steps(&mut app, (0.3 * rate) as usize);
            let (_, angle) = rigid(&app, plank).rotation().to_axis_angle();
            let turn = rigid(&app, plank).angvel().z;
            // From rest, with the jelly as a point: torque m·g·x over I_plank + m·(x² + h²).
            let inertia = 5.0 * (3.0f32.powi(2) + 0.1f32.powi(2)) / 12.0 + 2.0 * (1.0 + 0.25f32.powi(2));
            let expected = 2.0 * 9.81 / inertia * 0.3;
            println!("{rate} Hz, {side}, multibody {multibody}: {angle} rad, {turn} rad/s, about {expected}");
            let most = if multibody { 0.015 } else { 0.01 };
            assert!((turn * -side / expected - 1.0).abs() < most, "{turn} against {expected}");
        }
    }
}

/// A crate on the ground with a jelly on it lies as still as it would alone.
#[test]
fn a_crate_under_a_jelly_does_not_jitter() {
    let mut app = simulation();
    floor(&mut app);
    let support = add_box(&mut app, Vec3::Y * 0.25, Vec3::splat(0.25), 2.0);
    let body = jelly(&mut app, cube(3, 0.45, 2.0), Vec3::Y * 0.73, Vec3::ZERO);
    steps(&mut app, 240);
    let (mut fastest, mut moved) = (0.0f32, 0.0f32);
    for _ in 0..120 {
        steps(&mut app, 1);
        fastest = fastest.max(rigid(&app, support).linvel().length());
        moved = moved.max((rigid(&app, support).translation() - Vec3::Y * 0.25).length());
    }
    println!("crate {fastest:.1e} m/s, {moved:.1e} m, jelly {} {:.1e} deep", mean_velocity(&app, body), penetration(&app, body));
    assert!(fastest < 1e-4 && moved < 5e-4, "{fastest} m/s, {moved} m");
    assert!(mean_velocity(&app, body).length() < 1e-4);
    assert!(penetration(&app, body) < 1e-6);
}

/// Three jellies under one plate carry it together, in the same bits every time.
#[test]
fn several_bodies_carry_one() {
    let run = || {
        let mut app = simulation();
        floor(&mut app);
        for (x, z) in [(-0.6, -0.4), (0.6, -0.4), (0.0, 0.6)] {
            jelly(&mut app, cube(3, 0.45, 1.0), Vec3::new(x, 0.225, z), Vec3::ZERO);
        }
        let plate = add_box(&mut app, Vec3::Y * 0.6, Vec3::new(1.0, 0.05, 1.0), 5.0);
        steps(&mut app, 180);
        let body = rigid(&app, plate);
        (body.translation(), *body.rotation(), body.linvel())
    };
    let (at, rotation, velocity) = run();
    println!("{at} {rotation} {velocity}");
    assert!(at.y > 0.3 && at.y < 0.55, "{at}");
    assert!(velocity.length() < 0.05, "{velocity}");
    assert_eq!((at, rotation, velocity), run());
}

#[test]
fn locked_axes_stay_locked_and_sleepers_wake() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let body = RigidBodyBuilder::dynamic().locked_axes(LockedAxes::TRANSLATION_LOCKED_X | LockedAxes::ROTATION_LOCKED).sleeping(true);
    let wall = add(&mut app, body, ColliderBuilder::cuboid(0.1, 1.0, 1.0).mass(1.0));
    jelly(&mut app, cube(3, 0.3, 1.0), Vec3::X * -0.5, Vec3::new(3.0, 1.0, 0.0));
    steps(&mut app, 60);
    let body = rigid(&app, wall);
    assert_eq!(body.translation().x, 0.0);
    assert_eq!(body.angvel(), Vec3::ZERO);
    assert!(!body.is_sleeping() && body.linvel().y > 0.01, "rubbed along: {}", body.linvel());
}

/// Without the component the rigid body goes on as if nothing had been in its way, and no data of it is there.
#[test]
fn nothing_is_pushed_without_the_component() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let body = jelly(&mut app, cube(3, 0.3, 1.0), Vec3::ZERO, Vec3::ZERO);
    app.world_mut().entity_mut(body).remove::<(PushRigidBodies, PushState)>();
    let ball = add(&mut app, RigidBodyBuilder::dynamic().translation(Vec3::X * -1.0).linvel(Vec3::X * 2.0), ColliderBuilder::ball(0.2));
    steps(&mut app, 30);
    assert!(!app.world().entity(body).contains::<PushState>());
    assert!(mean_velocity(&app, body).x > 0.5, "they touched");
    assert_eq!(rigid(&app, ball).linvel(), Vec3::X * 2.0);
}

/// A body that breaks while it pushes does not break what it pushes.
#[test]
fn a_broken_body_breaks_nothing() {
    let mut app = simulation();
    floor(&mut app);
    let body = jelly(&mut app, cube(3, 0.4, 1.0), Vec3::Y * 0.2, Vec3::ZERO);
    let load = add_box(&mut app, Vec3::Y * 0.6, Vec3::splat(0.2), 1.0);
    steps(&mut app, 30);
    app.world_mut().get_mut::<Particles>(body).unwrap().velocity[13] = Vec3A::NAN;
    steps(&mut app, 5);
    let body = rigid(&app, load);
    assert!(body.translation().is_finite() && body.linvel().is_finite() && body.angvel().is_finite());
}

#[test]
fn what_is_touched_is_told() {
    let mut app = simulation();
    floor(&mut app);
    let body = jelly(&mut app, cube(3, 0.4, 1.0), Vec3::Y * 0.2, Vec3::ZERO);
    app.world_mut().entity_mut(body).insert(TouchedColliders::default());
    steps(&mut app, 120);
    let touched = app.world().get::<TouchedColliders>(body).unwrap().list.clone();
    assert_eq!(touched.len(), 1);
    assert!(!touched[0].moves && touched[0].closing < 0.2 && touched[0].body.is_none(), "{touched:?}");
    let ball = RigidBodyBuilder::kinematic_velocity_based().translation(Vec3::new(-1.0, 0.2, 0.0)).linvel(Vec3::X * 2.0);
    let ball = add(&mut app, ball, ColliderBuilder::ball(0.2));
    let mut seen = None;
    for _ in 0..60 {
        steps(&mut app, 1);
        let touched = app.world().get::<TouchedColliders>(body).unwrap();
        seen = seen.or(touched.list.iter().find(|touch| touch.body == Some(ball)).copied());
    }
    let seen = seen.expect("it came");
    assert!(seen.moves && (seen.closing - 2.0).abs() < 0.5, "{seen:?}");
}
