//! A warmed-up step takes no memory, and bodies that come and go leave none behind. One binary of its own, one test: it counts what the whole process asks for.

use std::alloc::{GlobalAlloc, Layout, System};
use std::backtrace::Backtrace;
use std::cell::Cell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicIsize, AtomicUsize, Ordering::Relaxed};

use bevy::app::{TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy};
use bevy::ecs::schedule::SingleThreadedExecutor;
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::prelude::*;
use polpo::{
    BodyPairs, Deformable, Drive, ExplicitGroup, ExplicitGroups, Inflation, Material, Motor, ParticleStiffness, Particles, Plasticity,
    RestPose, Rods, Section,
};
use polpo_rapier::{PushRigidBodies, RapierWorld, TouchedColliders};
use polpo_scenes::{OctopusScene, SimulationPlugins, octopus_asset};
use rapier3d::prelude::*;

/// The system's allocator, which counts: how often it is asked while `COUNTING`, by whom the first times, and how many bytes are out.
struct Counter;

static COUNTING: AtomicBool = AtomicBool::new(false);
static ASKED: AtomicUsize = AtomicUsize::new(0);
static LIVE: AtomicIsize = AtomicIsize::new(0);
static WHO: Mutex<Vec<String>> = Mutex::new(Vec::new());

thread_local! {
    static INSIDE: Cell<bool> = const { Cell::new(false) };
}

fn note(bytes: isize) {
    LIVE.fetch_add(bytes, Relaxed);
    if bytes <= 0 || !COUNTING.load(Relaxed) || INSIDE.get() {
        return;
    }
    ASKED.fetch_add(1, Relaxed);
    INSIDE.set(true);
    let mut who = WHO.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    if who.len() < 20 {
        let trace = Backtrace::force_capture().to_string();
        let ours = trace.lines().filter(|line| line.contains("polpo") || line.contains("rapier3d") || line.contains("parry3d"));
        who.push(ours.take(6).map(str::trim).collect::<Vec<_>>().join(" < "));
    }
    INSIDE.set(false);
}

#[expect(unsafe_code, reason = "there is no other way to count allocations")]
// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counter {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(layout.size() as isize);
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        note(-(layout.size() as isize));
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(place, layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LIVE.fetch_sub(layout.size() as isize, Relaxed);
        note(size as isize);
        // SAFETY: as the caller promised.
        unsafe { System.realloc(place, layout, size) }
    }
}

#[global_allocator]
static COUNTER: Counter = Counter;

/// From before the first system of the step to after `Writeback`, on one thread. Rapier's own step, which comes thereafter, is Rapier's.
fn app(count: usize) -> App {
    let one =
        TaskPoolThreadAssignmentPolicy { min_threads: 1, max_threads: 1, percent: 1.0, on_thread_spawn: None, on_thread_destroy: None };
    let pools = TaskPoolPlugin { task_pool_options: TaskPoolOptions { compute: one, ..default() } };
    let mut app = App::new();
    app.add_plugins((MinimalPlugins.set(pools), SimulationPlugins, OctopusScene { count, seed: 1 }))
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
        .insert_resource(Time::<Fixed>::from_hz(60.0))
        .edit_schedule(FixedPostUpdate, |schedule| {
            schedule.set_executor(SingleThreadedExecutor::new());
        })
        .add_systems(
            FixedPostUpdate,
            (
                (|| COUNTING.store(true, Relaxed)).before(PolpoSystems::Prepare),
                (|| COUNTING.store(false, Relaxed)).after(PolpoSystems::Writeback).before(polpo_rapier::RapierSystems::Step),
            ),
        );
    app.finish();
    app.update();
    app.update();
    app
}

fn bodies(app: &mut App) -> Vec<Entity> {
    let mut bodies: Vec<Entity> = app.world_mut().query_filtered::<Entity, With<SoftBody>>().iter(app.world()).collect();
    bodies.sort_unstable();
    bodies
}

/// How often memory was asked for in `count` steps, and by whom.
fn asked(app: &mut App, count: usize) -> (usize, Vec<String>) {
    ASKED.store(0, Relaxed);
    WHO.lock().unwrap().clear();
    for _ in 0..count {
        app.update();
    }
    (ASKED.load(Relaxed), core::mem::take(&mut *WHO.lock().unwrap()))
}

/// Two rigid pieces with a particle in common, of those nearest to particle 0, with a motor; and one that opens.
fn groups(particles: &Particles) -> ExplicitGroups {
    let mut near: Vec<u32> = (0..particles.len() as u32).collect();
    let from = particles.rest_position[0];
    near.sort_by(|&a, &b| {
        let distance = |i: u32| particles.rest_position[i as usize].distance_squared(from);
        distance(a).total_cmp(&distance(b))
    });
    let motor = Some(Motor { axis: Vec3A::X, drive: Drive::Torque(0.01), against: Some(1) });
    let deformable = Some(Deformable { speed: 1.0, time: 0.1, dent: 0.2 });
    ExplicitGroups {
        list: vec![
            ExplicitGroup { motor, ..ExplicitGroup::rigid(&near[..12]) },
            ExplicitGroup::rigid(&near[11..24]),
            ExplicitGroup { deformable, ..ExplicitGroup::rigid(&near[40..60]) },
        ],
    }
}

/// Gives `body` everything there is that goes together with shape matching.
fn dress(world: &mut World, body: Entity) {
    let p = world.get::<Particles>(body).unwrap();
    let (count, last) = (p.len(), p.len() as u32 - 1);
    let (groups, place) = (groups(p), world.get::<Transform>(body).unwrap().translation + Vec3::from(p.position[last as usize]));
    let hook = world.spawn(Transform::from_translation(place)).id();
    world.entity_mut(body).insert((
        SelfContact::default(),
        groups,
        Pins { list: vec![Pin::to_entity(last, hook, Vec3::ZERO).breaking_at(1e9)] },
        AirDrag::default(),
        Plasticity::default(),
        Inflation::new(1.05),
        RestPose::default(),
        ParticleStiffness::new(vec![Stiffness::hertz(20.0); count]),
        Grab { particle: 3, target: place, stiffness: Stiffness::hertz(5.0) },
        PushRigidBodies,
        TouchedColliders::default(),
    ));
    world.spawn((Transform::default(), ParticleAnchor::new(body, 5)));
}

fn crate_box(app: &mut App) {
    let RapierWorld { bodies, colliders, .. } = &mut *app.world_mut().resource_mut::<RapierWorld>();
    let crate_box = bodies.insert(RigidBodyBuilder::dynamic().translation(Vec3::new(-2.0, 3.5, 0.0)));
    colliders.insert_with_parent(ColliderBuilder::cuboid(0.8, 0.2, 1.5).density(50.0), crate_box, bodies);
}

type Change = (&'static str, fn(&mut App));

/// What a step asks for with three octopuses on the stairs, after two seconds; what it asks for without bodies is Bevy's.
fn a_warmed_up_step_takes_no_memory() {
    let scenes: [Change; 5] = [
        ("body contact", |_| {}),
        ("self-contact", |app| {
            for body in bodies(app) {
                app.world_mut().entity_mut(body).insert(SelfContact::default());
            }
        }),
        ("groups, pins and drag", |app| {
            for body in bodies(app) {
                let p = app.world().get::<Particles>(body).unwrap();
                let (groups, place) = (groups(p), app.world().get::<Transform>(body).unwrap().translation + Vec3::from(p.position[9]));
                let pins = Pins { list: vec![Pin::at(9, place)] };
                app.world_mut().entity_mut(body).insert((groups, pins, AirDrag::default()));
            }
        }),
        ("rods", |app| {
            let material = Material { youngs_modulus: 1e6, poissons_ratio: 0.4, density: 1000.0 };
            let (_, rig) = octopus_asset();
            // The edges of a tree, whose loops direct rods would refuse.
            let mut seen = vec![false; rig.particles.len()];
            seen[0] = true;
            let mut tree = Vec::new();
            for _ in 0..rig.particles.len() {
                for (e, &[i, j]) in (0u32..).zip(&rig.edges) {
                    if seen[i as usize] != seen[j as usize] {
                        (seen[i as usize], seen[j as usize]) = (true, true);
                        tree.push(e);
                    }
                }
            }
            for body in bodies(app) {
                let section = Section::circle(0.02);
                let shape = polpo::RodShape::Section { section, edges: Some(tree.clone()) };
                let rods = Rods { shape, ..Rods::new(material, section) };
                app.world_mut().entity_mut(body).insert(rods);
            }
        }),
        ("everything", |app| {
            crate_box(app);
            for body in bodies(app) {
                dress(app.world_mut(), body);
            }
        }),
    ];
    let mut nobody = app(0);
    asked(&mut nobody, 120);
    let (baseline, _) = asked(&mut nobody, 60);
    println!("nobody: {baseline} in 60 steps");
    let mut faults = Vec::new();
    for (name, change) in scenes {
        let mut app = app(3);
        for body in bodies(&mut app) {
            app.world_mut().entity_mut(body).remove::<Sleep>();
        }
        change(&mut app);
        let (cold, _) = asked(&mut app, 120);
        let (warm, who) = asked(&mut app, 60);
        println!("{name}: {cold} in the first 120 steps, {warm} in the next 60");
        assert!(cold > baseline, "it counts: new bodies take memory");
        assert_eq!(bodies(&mut app).len(), 3);
        if warm > baseline {
            faults.push(format!("{name}: {warm} against {baseline}:\n  {}", who.join("\n  ")));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Bodies with everything come and go for 40 seconds: no pair names one that is gone, and what is out in memory after the last is what was out after the tenth.
fn what_comes_and_goes_leaves_no_memory() {
    let mut app = app(3);
    crate_box(&mut app);
    let (_, rig) = octopus_asset();
    let mut alive = bodies(&mut app);
    for &body in &alive {
        dress(app.world_mut(), body);
    }
    let mut out = Vec::new();
    for round in 0..40 {
        let first = alive.remove(round % 2);
        app.world_mut().despawn(first);
        // What hangs on it is the game's to take away.
        let world = app.world_mut();
        let gone: Vec<Entity> =
            world.query::<(Entity, &ParticleAnchor)>().iter(world).filter(|(_, a)| a.body == first).map(|(e, _)| e).collect();
        gone.into_iter().for_each(|e| {
            world.despawn(e);
        });
        let place = Transform::from_xyz(-2.2 + 0.4 * (round % 4) as f32, 2.6, 0.4 * (round % 3) as f32);
        let body = world.spawn((SoftBody::new(rig.clone()), place)).id();
        dress(world, body);
        alive.push(body);
        for _ in 0..60 {
            app.update();
            for pair in app.world().resource::<BodyPairs>().iter() {
                assert!(pair.bodies().iter().all(|body| alive.contains(body)), "round {round}: a pair with one that is gone");
            }
        }
        assert!(alive.iter().all(|&body| app.world().get::<Particles>(body).unwrap().is_finite()));
        out.push(LIVE.load(Relaxed));
    }
    let most = |range: core::ops::Range<usize>| *out[range].iter().max().unwrap();
    let (early, late) = (most(0..10), most(30..40));
    println!("memory: {} kB at most in rounds 0 … 9, {} kB in 30 … 39", early / 1000, late / 1000);
    assert!(late < early + early / 50, "{early} bytes became {late}");
}

/// What an octopus of 300 particles takes beside others of the same rig, without and with self-contact. Lists of pairs grow by doubling, so that what bodies with self-contact take depends on how they lie: 361 to 382 KiB.
fn a_body_takes_bounded_memory() {
    for (contact, most) in [(false, 180), (true, 400)] {
        let mut app = app(1);
        asked(&mut app, 60);
        // The rig is shared by all bodies, and none of theirs.
        let (_, rig) = octopus_asset();
        let before = LIVE.load(Relaxed);
        for k in 0..10 {
            let place = Transform::from_xyz(20.0 + 2.0 * k as f32, 1.2, 20.0);
            let mut body = app.world_mut().spawn((SoftBody::new(rig.clone()), place));
            if contact {
                body.insert(SelfContact::default());
            }
        }
        asked(&mut app, 120);
        let each = (LIVE.load(Relaxed) - before) / 10 / 1024;
        println!("memory: {each} KiB a body, self-contact {contact}");
        assert!(each > 50 && each < most, "{each} KiB a body, self-contact {contact}");
    }
}

#[test]
fn steps_take_no_memory() {
    a_body_takes_bounded_memory();
    a_warmed_up_step_takes_no_memory();
    what_comes_and_goes_leaves_no_memory();
}
