//! Contract: one component makes a body of a model's file, with the rig that it has, is given, or is made off the main thread where there are others; what changes in a file changes the bodies where they are; what is wrong with one is told by its name
//! and costs nothing else.

use std::sync::Arc;
use std::time::{Duration, Instant};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bevy::asset::RenderAssetUsages;
use bevy::math::Vec3A;
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::prelude::*;
use polpo::render::{PolpoRenderPlugin, Skin, SkinPart, SkinParts, SkinningBackend};
use polpo::{LoadError, Particles, RecipeAsset, RigAsset, SoftBodyModel};
use polpo_rig::{Influences, Mesh as RigMesh, Particle, Recipe, Rig, RigError, parse_mesh};
use polpo_skinning::cpu::{SkinnedVertices, skin};
use polpo_skinning::{Binding, ParticleTransform, RestMesh};
use polpo_tests::models::{COLORS, Files, dumbbell, glb, gltf};
use serde_json::{Value, json};

/// What came of the scenes.
#[derive(Resource, Default)]
struct Told {
    ready: Vec<Entity>,
    /// How many parts each of these had by then.
    parts: Vec<usize>,
    failed: Vec<(Entity, LoadError)>,
}

/// An app that loads from `files`, without weight and without a picture, but with meshes if `drawn`.
fn app(files: &Files, drawn: bool) -> App {
    let mut app = App::new();
    files.serve(&mut app);
    app.add_plugins((MinimalPlugins, AssetPlugin::default(), PolpoPlugin::default())).insert_resource(Gravity(Vec3::ZERO));
    if drawn {
        app.init_asset::<Mesh>().init_asset::<StandardMaterial>();
        app.add_plugins(PolpoRenderPlugin { backend: SkinningBackend::Cpu, interpolate: false });
    } else {
        app.add_plugins(PolpoAssetsPlugin);
    }
    app.init_resource::<Told>()
        .add_observer(|event: On<SoftBodyReady>, parts: Query<&SkinParts>, mut told: ResMut<Told>| {
            told.ready.push(event.entity);
            told.parts.push(parts.get(event.entity).map_or(0, |parts| parts.iter().count()));
        })
        .add_observer(|event: On<SoftBodyLoadFailed>, mut told: ResMut<Told>| told.failed.push((event.entity, event.reason.clone())))
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO));
    app.finish();
    app.cleanup();
    app
}

/// Updates until `done`, for a minute at most.
fn wait(app: &mut App, what: &str, done: impl Fn(&App) -> bool) {
    let started = Instant::now();
    while !done(app) {
        assert!(started.elapsed() < Duration::from_secs(60), "waited a minute for {what}");
        std::thread::sleep(Duration::from_millis(1));
        app.update();
    }
}

fn ready(app: &App) -> usize {
    app.world().resource::<Told>().ready.len()
}

fn spawn(app: &mut App, scene: SoftBodyScene, transform: Transform) -> Entity {
    app.world_mut().spawn((scene, transform)).id()
}

fn load<A: Asset>(app: &App, path: &str) -> Handle<A> {
    app.world().resource::<AssetServer>().load(path.to_owned())
}

fn rig_of(app: &App, entity: Entity) -> Arc<Rig> {
    app.world().get::<SoftBody>(entity).expect("a body").rig.clone()
}

fn model(extras: Value) -> Vec<u8> {
    glb(&dumbbell(), &COLORS, extras)
}

fn mesh() -> RigMesh {
    parse_mesh("dumbbell.glb", &model(json!(null))).expect("a good model")
}

/// A rig made in no time: so many balls in a row, and each vertex on the nearest two.
fn rig_for(mesh: &RigMesh, particles: usize) -> Rig {
    let place = |i: usize| Vec3::X * (-0.9 + 2.3 * i as f32 / (particles - 1) as f32);
    let ball = |i: usize| Particle { position: place(i), frame: Quat::IDENTITY, radii: Vec3::splat(0.1), mass: 1.0 + i as f32 };
    let influences = |vertex: &Vec3| {
        let mut near: Vec<(u32, f64)> = (0..particles).map(|i| (i as u32, 1.0 / f64::from(0.1 + place(i).distance(*vertex)))).collect();
        near.sort_by(|a, b| b.1.total_cmp(&a.1));
        Influences::new(&near[..2])
    };
    Rig {
        mesh_hash: mesh.hash(),
        particles: (0..particles).map(ball).collect(),
        edges: (1..particles as u32).map(|i| [i - 1, i]).collect(),
        skin: mesh.positions.iter().map(influences).collect(),
        ..Rig::default()
    }
}

fn rig(particles: usize) -> Rig {
    rig_for(&mesh(), particles)
}

#[test]
fn a_model_without_a_rig_is_rigged_once_and_never_in_a_frame() {
    let files = Files::default();
    files.write("dumbbell.glb", model(json!(null)));
    files.write("dumbbell.rig.toml", "particles = 30");
    let mut app = app(&files, false);
    let scene = SoftBodyScene::new(load(&app, "dumbbell.glb"));
    let [one, two] = [1.0, 2.0].map(|y| spawn(&mut app, scene.clone(), Transform::from_xyz(0.0, y, 0.0)));
    let coarse = scene.clone().with_recipe(load(&app, "dumbbell.rig.toml"));
    let three = spawn(&mut app, coarse, Transform::IDENTITY);
    // Rigging by the default takes far longer than a frame may, on whatever machine.
    let mut longest = Duration::ZERO;
    let started = Instant::now();
    while ready(&app) < 3 {
        assert!(started.elapsed() < Duration::from_secs(60));
        let frame = Instant::now();
        app.update();
        longest = longest.max(frame.elapsed());
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(longest < started.elapsed() / 3, "a frame took {longest:?} of {:?}", started.elapsed());
    assert!(Arc::ptr_eq(&rig_of(&app, one), &rig_of(&app, two)), "rigged twice");
    assert_eq!(rig_of(&app, one).particles.len(), 300);
    assert_eq!(rig_of(&app, three).particles.len(), 30);
    assert!((app.world().get::<Transform>(two).unwrap().translation.y - 2.0).abs() < 0.2);

    // The next one need not wait.
    let four = spawn(&mut app, scene, Transform::IDENTITY);
    app.update();
    assert!(Arc::ptr_eq(&rig_of(&app, one), &rig_of(&app, four)));

    // Another recipe, and only the body that is made by it changes.
    files.change(&app, "dumbbell.rig.toml", "particles = 20");
    wait(&mut app, "another recipe", |app| rig_of(app, three).particles.len() == 20);
    assert!(Arc::ptr_eq(&rig_of(&app, one), &rig_of(&app, four)));
    assert!(app.world().resource::<Told>().failed.is_empty());
}

#[test]
fn a_rig_comes_from_its_own_file_or_from_the_models() {
    let files = Files::default();
    let (given, inside) = (rig(25), rig(35));
    files.write("one.rig", given.to_postcard().unwrap());
    files.write("one.rig.ron", given.to_ron().unwrap());
    files.write("plain.glb", model(json!(null)));
    files.write("rigged.glb", model(json!({ "other": 1, "polpo_rig": STANDARD.encode(inside.to_postcard().unwrap()) })));
    let (document, blob) = gltf(&dumbbell(), &COLORS, json!(null), json!("buffers/the%20bytes.bin"));
    files.write("models/apart.gltf", document.to_string());
    files.write("models/buffers/the bytes.bin", blob);
    let mut app = app(&files, false);
    let scene = |app: &App, path: &str| SoftBodyScene::new(load(app, path));
    let scenes = [
        (scene(&app, "plain.glb").with_rig(load(&app, "one.rig")), &given),
        (scene(&app, "plain.glb").with_rig(load(&app, "one.rig.ron")), &given),
        (scene(&app, "models/apart.gltf").with_rig(load(&app, "one.rig")), &given),
        (scene(&app, "rigged.glb"), &inside),
        (scene(&app, "rigged.glb").with_rig(load(&app, "one.rig")), &given),
    ];
    let bodies = scenes.map(|(scene, rig)| (spawn(&mut app, scene, Transform::IDENTITY), rig));
    let alone = SoftBodyRig(load(&app, "one.rig"));
    let alone = app.world_mut().spawn(alone).id();
    wait(&mut app, "six bodies", |app| ready(app) >= 6 || !app.world().resource::<Told>().failed.is_empty());
    assert!(app.world().resource::<Told>().failed.is_empty(), "{:?}", app.world().resource::<Told>().failed);
    for (body, rig) in bodies.into_iter().chain([(alone, &given)]) {
        assert_eq!(*rig_of(&app, body), *rig);
    }
}

/// The body's particles as the rig's are, by a rigid motion, and its velocity.
fn place(app: &App, entity: Entity) -> (Vec<Vec3>, Vec3A) {
    let (particles, transform) = (app.world().get::<Particles>(entity).unwrap(), app.world().get::<Transform>(entity).unwrap());
    (particles.position.iter().map(|&x| Vec3::from(x) + transform.translation).collect(), particles.velocity[0])
}

#[test]
fn a_file_that_changes_changes_its_bodies_where_they_are() {
    let files = Files::default();
    files.write("dumbbell.glb", model(json!(null)));
    files.write("dumbbell.rig", rig(20).to_postcard().unwrap());
    let mut app = app(&files, false);
    let there =
        Transform::from_xyz(5.0, -2.0, 1.0).with_rotation(Quat::from_euler(EulerRot::XYZ, 0.4, 2.0, -1.0)).with_scale(Vec3::splat(0.5));
    let handle: Handle<RigAsset> = load(&app, "dumbbell.rig");
    let scene = SoftBodyScene::new(load(&app, "dumbbell.glb")).with_rig(handle.clone());
    let body = spawn(&mut app, scene, there);
    let other = app.world_mut().spawn((SoftBodyRig(handle.clone()), there)).id();
    wait(&mut app, "two bodies", |app| ready(app) == 2);
    // It has turned and moved on since, and goes on moving.
    let (turn, way, velocity) = (Quat::from_rotation_z(1.0), Vec3::new(0.0, 3.0, 0.0), Vec3A::new(1.0, 2.0, 3.0));
    let mut entity = app.world_mut().entity_mut(body);
    let mut particles = entity.get_mut::<Particles>().unwrap();
    for i in 0..particles.len() {
        particles.0.position[i] = turn * particles.position[i];
        particles.0.rotation[i] = turn * particles.rotation[i];
        particles.0.velocity[i] = velocity;
    }
    entity.get_mut::<Transform>().unwrap().translation += way;
    let center = entity.get::<Transform>().unwrap().translation - way;
    let expected = |rig: &Rig| -> Vec<Vec3> { rig.particles.iter().map(|p| turn * (there * p.position - center) + center + way).collect() };

    for (round, particles) in [30, 40].into_iter().enumerate() {
        let rig = rig(particles);
        if round == 0 {
            files.change(&app, "dumbbell.rig", rig.to_postcard().unwrap());
        } else {
            app.world_mut().resource_mut::<Assets<RigAsset>>().insert(&handle, RigAsset::new(rig.clone())).unwrap();
        }
        wait(&mut app, "another rig", |app| [body, other].iter().all(|&entity| rig_of(app, entity).particles.len() == particles));
        let (positions, moving) = place(&app, body);
        for (found, expected) in positions.iter().zip(expected(&rig)) {
            assert!(found.distance(expected) < 2e-5, "{found} instead of {expected}");
        }
        assert!((moving - velocity).length() < 1e-4, "{moving}");
    }

    // The model changes, and the rig is not for it: the body stays.
    let before = ready(&app);
    files.change(&app, "dumbbell.glb", glb(&dumbbell()[..1], &COLORS, json!(null)));
    wait(&mut app, "a complaint", |app| !app.world().resource::<Told>().failed.is_empty());
    assert_eq!((ready(&app), rig_of(&app, body).particles.len()), (before, 40));
    let half = parse_mesh("half.glb", &glb(&dumbbell()[..1], &COLORS, json!(null))).expect("a good model");
    files.change(&app, "dumbbell.rig", rig_for(&half, 10).to_postcard().unwrap());
    wait(&mut app, "a rig for it", |app| [body, other].iter().all(|&entity| rig_of(app, entity).particles.len() == 10));

    // The rig is none any more, or none that can be simulated: the bodies stay, and are told of.
    let mut dust = rig_for(&half, 12);
    dust.particles[3].radii = Vec3::splat(1e-30);
    let before = ready(&app);
    for (bytes, message) in
        [(b"POLPORIG".to_vec(), "dumbbell.rig: not a rig"), (dust.to_postcard().unwrap(), "dumbbell.rig: particle 3: half axes")]
    {
        app.world_mut().resource_mut::<Told>().failed.clear();
        files.change(&app, "dumbbell.rig", bytes);
        // Bevy may be reading the file of before a second time.
        let told =
            |app: &App, of| app.world().resource::<Told>().failed.iter().any(|(e, why)| *e == of && why.to_string().contains(message));
        wait(&mut app, "a complaint for each", |app| told(app, body) && told(app, other));
        for entity in [body, other] {
            assert_eq!(rig_of(&app, entity).particles.len(), 10);
            assert!(app.world().entity(entity).contains::<Particles>());
        }
    }
    assert_eq!(ready(&app), before);
    files.change(&app, "dumbbell.rig", rig_for(&half, 11).to_postcard().unwrap());
    wait(&mut app, "a good rig again", |app| [body, other].iter().all(|&entity| rig_of(app, entity).particles.len() == 11));
}

#[test]
fn a_scene_that_is_replaced_before_it_is_made_is_not_made() {
    let files = Files::default();
    files.write("dumbbell.glb", model(json!(null)));
    files.write("one.rig", rig(10).to_postcard().unwrap());
    files.write("two.rig", rig(20).to_postcard().unwrap());
    let mut app = app(&files, false);
    let scene = |app: &App, rig: &str| SoftBodyScene::new(load(app, "dumbbell.glb")).with_rig(load(app, rig));
    let (one, two) = (scene(&app, "one.rig"), scene(&app, "two.rig"));
    // Both are there at once, and the first has the second be made of another rig.
    let [first, second] = [0, 1].map(|_| spawn(&mut app, one.clone(), Transform::IDENTITY));
    app.add_observer(move |event: On<SoftBodyReady>, mut commands: Commands| {
        if event.entity == first {
            commands.entity(second).insert(two.clone());
        }
    });
    wait(&mut app, "two bodies", |app| ready(app) >= 2);
    for _ in 0..5 {
        app.update();
    }
    assert_eq!(app.world().resource::<Told>().ready, [first, second]);
    assert_eq!([first, second].map(|body| rig_of(&app, body).particles.len()), [10, 20]);
}

#[test]
fn a_model_made_by_a_program_is_checked_too() {
    let mut app = app(&Files::default(), true);
    let bare = RigMesh { normals: Vec::new(), ..mesh() };
    let model = app.world_mut().resource_mut::<Assets<SoftBodyModel>>().add(SoftBodyModel::new(bare, Some(Arc::new(rig(10)))));
    let body = spawn(&mut app, SoftBodyScene::new(model), Transform::IDENTITY);
    wait(&mut app, "a complaint", |app| !app.world().resource::<Told>().failed.is_empty());
    let (entity, reason) = &app.world().resource::<Told>().failed[0];
    assert!(*entity == body && reason.to_string().contains("0 entries in normals"), "{reason}");
    assert!(!app.world().entity(body).contains::<SoftBody>());
}

#[test]
fn what_is_wrong_is_told_by_its_name() {
    let files = Files::default();
    files.write("good.glb", model(json!(null)));
    files.write("good.rig", rig(10).to_postcard().unwrap());
    files.write("no mesh.glb", "what is this");
    let (mut empty, blob) = gltf(&dumbbell(), &COLORS, json!(null), json!("empty.bin"));
    files.write("empty.bin", blob);
    empty["nodes"] = json!([{ "name": "nothing" }]);
    empty["scenes"][0]["nodes"] = json!([0]);
    files.write("empty.gltf", empty.to_string());
    let (document, _) = gltf(&dumbbell(), &COLORS, json!(null), json!("nowhere.bin"));
    files.write("apart.gltf", document.to_string());
    files.write("broken inside.glb", model(json!({ "polpo_rig": "?" })));
    files.write("other.rig", Rig { mesh_hash: polpo_rig::MeshHash(7), ..rig(10) }.to_postcard().unwrap());
    files.write("broken.rig", "POLPORIG");
    files.write("broken.rig.ron", "(version: 2)");
    files.write("broken.rig.toml", "particels = 5");
    let thread = dumbbell().into_iter().map(|(_, primitives)| (Transform::from_scale(Vec3::X), primitives)).collect::<Vec<_>>();
    files.write("thread.glb", glb(&thread, &COLORS, json!(null)));
    let (mut again, mut blob) = gltf(&dumbbell(), &COLORS, json!(null), json!("again.bin"));
    let buffer = again["buffers"][0].clone();
    again["buffers"] = json!(vec![buffer; 60]);
    blob.resize(1 << 20, 0);
    files.write("again.gltf", again.to_string());
    files.write("again.bin", blob);
    let mut app = app(&files, false);
    let scene = |app: &App, path: &str| SoftBodyScene::new(load(app, path));
    let good = |app: &App| scene(app, "good.glb");
    let cases = [
        (scene(&app, "nowhere.glb"), "nowhere.glb"),
        (SoftBodyScene::new(Handle::default()), "its model is the default handle"),
        (scene(&app, "no mesh.glb"), "no mesh.glb: not a readable mesh"),
        (scene(&app, "empty.gltf"), "empty.gltf: the mesh is empty"),
        (scene(&app, "apart.gltf"), "apart.gltf: its buffer nowhere.bin"),
        (scene(&app, "broken inside.glb"), "broken inside.glb: not a rig"),
        (good(&app).with_rig(load(&app, "nowhere.rig")), "nowhere.rig"),
        (good(&app).with_rig(load(&app, "other.rig")), "good.glb: the mesh has hash"),
        (good(&app).with_rig(load(&app, "broken.rig")), "broken.rig: not a rig"),
        (good(&app).with_rig(load(&app, "broken.rig.ron")), "broken.rig.ron: not a rig"),
        (good(&app).with_recipe(load(&app, "broken.rig.toml")), "broken.rig.toml: not a recipe"),
        (scene(&app, "thread.glb"), "thread.glb: none of the"),
        (scene(&app, "again.gltf"), "again.gltf: its buffers name again.bin so often"),
    ];
    let bodies = cases.map(|(scene, message)| (spawn(&mut app, scene, Transform::IDENTITY), message));
    let sound = good(&app).with_rig(load(&app, "good.rig"));
    let sound = spawn(&mut app, sound, Transform::IDENTITY);
    wait(&mut app, "all complaints", |app| app.world().resource::<Told>().failed.len() >= bodies.len() && ready(app) > 0);
    for _ in 0..20 {
        app.update();
    }
    let told = app.world().resource::<Told>();
    assert_eq!((told.failed.len(), &told.ready), (bodies.len(), &vec![sound]), "each is told once");
    for (body, message) in bodies {
        let reason = told.failed.iter().find(|(entity, _)| *entity == body).map(|(_, reason)| reason.to_string()).unwrap();
        assert!(reason.contains(message), "{reason:?} does not say {message:?}");
        assert!(!app.world().entity(body).contains::<SoftBody>());
    }
    let hash = told.failed.iter().find(|(entity, _)| *entity == bodies[7].0).map(|(_, reason)| reason);
    assert!(matches!(hash, Some(LoadError::Rig(error)) if matches!(**error, RigError::MeshHash { .. })), "{hash:?}");

    // What is put right comes to life.
    files.change(&app, "broken.rig", rig(12).to_postcard().unwrap());
    files.change(&app, "no mesh.glb", model(json!({ "polpo_rig": STANDARD.encode(rig(14).to_postcard().unwrap()) })));
    wait(&mut app, "what was put right", |app| ready(app) == 3);
    assert_eq!([bodies[2].0, bodies[8].0].map(|body| rig_of(&app, body).particles.len()), [14, 12]);
}

/// Every vertex of the whole model as the body's particles carry it.
fn expected(app: &App, body: Entity, mesh: &RigMesh, scale: f32) -> Vec<[f32; 3]> {
    let (rig, particles) = (rig_of(app, body), app.world().get::<Particles>(body).unwrap());
    let arrays = |vectors: &[Vec3]| vectors.iter().map(Vec3::to_array).collect::<Vec<_>>();
    let places: Vec<Vec3> = rig.particles.iter().map(|p| p.position).collect();
    let rest = RestMesh { positions: &arrays(&mesh.positions), normals: &arrays(&mesh.normals), tangents: &[] };
    let binding = Binding::new(rest, &places, rig.skin.iter().map(|i| (i.particles, i.weights))).unwrap();
    let transforms: Vec<ParticleTransform> = (0..particles.len())
        .map(|i| ParticleTransform::new(particles.position[i].into(), particles.rotation[i], scale, binding.rest_particles()[i]))
        .collect();
    let mut positions = vec![[0.0; 3]; mesh.positions.len()];
    assert!(skin(&binding, &transforms, SkinnedVertices { positions: &mut positions, normals: None, tangents: None }));
    positions
}

#[test]
fn each_part_is_a_child_that_follows_the_body_and_goes_with_it() {
    let files = Files::default();
    files.write("dumbbell.glb", model(json!(null)));
    files.write("dumbbell.rig", rig(20).to_postcard().unwrap());
    let mut app = app(&files, true);
    let before = app.world().resource::<Assets<Mesh>>().len();
    let scene = SoftBodyScene::new(load(&app, "dumbbell.glb")).with_rig(load(&app, "dumbbell.rig"));
    let there = Transform::from_xyz(1.0, 2.0, 3.0).with_scale(Vec3::splat(0.5));
    let bodies = [0, 1].map(|_| spawn(&mut app, scene.clone(), there));
    wait(&mut app, "two bodies", |app| ready(app) == 2);
    let mesh = mesh();
    assert_eq!(mesh.parts.len(), 3);
    for (round, body) in bodies.into_iter().enumerate() {
        let mut entity = app.world_mut().entity_mut(body);
        let mut particles = entity.get_mut::<Particles>().unwrap();
        for i in 0..particles.len() {
            particles.0.position[i] += Vec3A::new((i + round) as f32, 1.0, 0.0).normalize() * 0.1;
        }
        app.update();
        let expected = expected(&app, body, &mesh, 0.5);
        let children: Vec<Entity> = app.world().get::<Children>(body).unwrap().iter().collect();
        assert_eq!(children.len(), 3);
        for (child, part) in children.into_iter().zip(&mesh.parts) {
            let child = app.world().entity(child);
            assert_eq!(child.get::<SkinPart>(), Some(&SkinPart { body, vertices: part.vertices.clone() }));
            assert_eq!(child.get::<Name>().map(Name::as_str), Some(&*part.node));
            let instance = app.world().resource::<Assets<Mesh>>().get(child.get::<Skin>().unwrap().instance()).unwrap();
            assert_eq!(instance.asset_usage, RenderAssetUsages::all());
            let found = instance.attribute(Mesh::ATTRIBUTE_POSITION).and_then(|values| values.as_float3()).unwrap();
            let expected = &expected[part.vertices.start as usize..part.vertices.end as usize];
            assert_eq!(found.len(), expected.len());
            for (found, expected) in found.iter().zip(expected) {
                assert!(Vec3::from(*found).distance(Vec3::from(*expected)) < 1e-5, "{found:?} instead of {expected:?}");
            }
            assert_eq!(instance.indices().unwrap().len(), 3 * part.triangles.len());
        }
    }
    let [one, two] = bodies;
    // Three meshes of the model, which the bodies share, and three for each.
    assert_eq!(app.world().resource::<Assets<Mesh>>().len(), before + 9);
    app.world_mut().entity_mut(one).despawn();
    app.update();
    app.update();
    assert_eq!(app.world().resource::<Assets<Mesh>>().len(), before + 6);

    // Another rig for the same model: the same children, bound anew. Another model: other children.
    let children: Vec<Entity> = app.world().get::<Children>(two).unwrap().iter().collect();
    files.change(&app, "dumbbell.rig", rig(30).to_postcard().unwrap());
    wait(&mut app, "another rig", |app| rig_of(app, two).particles.len() == 30);
    app.update();
    assert!(app.world().get::<Children>(two).unwrap().iter().eq(children.iter().copied()));
    let found = app.world().get::<Skin>(children[0]).unwrap().binding().rest_particles().len();
    assert_eq!(found, 30);
    // Other vertices than it has are not its own.
    let part = app.world().get::<SkinPart>(children[0]).unwrap().clone();
    let fewer = SkinPart { body: two, vertices: part.vertices.start..part.vertices.end - 1 };
    for (part, fits) in [(fewer, false), (part, true)] {
        app.world_mut().entity_mut(children[0]).insert(part);
        app.update();
        assert_eq!(app.world().entity(children[0]).contains::<Skin>(), fits);
    }
    let half = SoftBodyModel::new(parse_mesh("half.glb", &glb(&dumbbell()[..1], &COLORS, json!(null))).unwrap(), None);
    let model = app.world_mut().resource_mut::<Assets<SoftBodyModel>>().add(half);
    let recipe = app.world_mut().resource_mut::<Assets<RecipeAsset>>().add(RecipeAsset(Recipe::with_particles(15)));
    app.world_mut().entity_mut(two).insert(SoftBodyScene::new(model).with_recipe(recipe));
    wait(&mut app, "another model", |app| rig_of(app, two).particles.len() == 15);
    app.update();
    assert_eq!(app.world().get::<Children>(two).unwrap().len(), 2);
    app.world_mut().entity_mut(two).despawn();
    app.update();
    app.update();
    assert_eq!(app.world().resource::<Assets<Mesh>>().len(), before, "a despawned body leaves a mesh behind");
    assert_eq!(app.world_mut().query::<&SkinPart>().iter(app.world()).count(), 0);
    assert!(app.world().resource::<Told>().failed.is_empty());
    assert_eq!(app.world().resource::<Told>().parts, [3, 3, 3, 2], "a body is ready when its parts are there");
}
