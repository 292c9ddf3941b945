//! Contract: what stands in Bevy's vertex slab is what the CPU mirror computes from the particles, within 1e-5 of the body's size: for every body, any pose, any vertex layout, through spawning,
//! despawning and rebinding; and nothing else in the slab is touched.
//!
//! Needs an adapter (Mesa's lavapipe will do). Without one the tests say so and pass, unless POLPO_REQUIRE_GPU=1.

use std::sync::Arc;
use std::time::Duration;

use bevy::diagnostic::DiagnosticsStore;
use bevy::prelude::*;
use bevy::render::diagnostic::RenderDiagnosticsPlugin;
use bevy::time::TimeUpdateStrategy;
use polpo::render::{PolpoRenderPlugin, SKIN_GPU_TIME, Skin, SkinError, SkinRejected, SkinningBackend, SkinningStats, bevy_mesh};
use polpo::{Particles, RecipeAsset, SoftBody, SoftBodyScene, StepStart};
use polpo_rig::Rig;
use polpo_skinning::cpu::{SkinnedVertices, skin};
use polpo_skinning::{Binding, ParticleTransform, RestMesh};
use polpo_tests::models::{COLORS, Files, dumbbell, glb};
use polpo_tests::render::{
    Random, camera, gpu_or_skip, limb, limb_following, render_app, render_app_of, shake, slab_of, slab_words, start,
};

/// Length of the limb [m].
const SIZE: f32 = 2.0;

fn app(plugin: PolpoRenderPlugin) -> App {
    let mut app = render_app(plugin);
    start(&mut app);
    camera(&mut app, Transform::from_xyz(0.0, 0.0, 20.0));
    app
}

fn spawn(app: &mut App, mesh: &Handle<Mesh>, rig: &Arc<Rig>, transform: Transform) -> Entity {
    let material = app.world_mut().resource_mut::<Assets<StandardMaterial>>().add(Color::WHITE);
    app.world_mut().spawn((SoftBody::new(rig.clone()), Mesh3d(mesh.clone()), MeshMaterial3d(material), transform)).id()
}

fn add_mesh(app: &mut App, mesh: Mesh) -> Handle<Mesh> {
    app.world_mut().resource_mut::<Assets<Mesh>>().add(mesh)
}

/// Position, normal and tangent of every vertex as they must be, from the components alone and with a binding of the test's own.
fn expected(app: &App, body: Entity, source: &polpo_rig::Mesh, tangents: &[[f32; 4]], scale: f32) -> [Vec<[f32; 3]>; 3] {
    let entity = app.world().entity(body);
    let rig = &entity.get::<SoftBody>().expect("a body").rig;
    let (particles, start) = (entity.get::<Particles>().expect("a body"), entity.get::<StepStart>().expect("a body"));
    let fraction = app.world().resource::<Time<Fixed>>().overstep_fraction();
    let arrays = |vectors: &[Vec3]| vectors.iter().map(Vec3::to_array).collect::<Vec<_>>();
    let binding = Binding::new(
        RestMesh { positions: &arrays(&source.positions), normals: &arrays(&source.normals), tangents },
        &rig.particles.iter().map(|particle| particle.position).collect::<Vec<_>>(),
        rig.skin.iter().map(|influences| (influences.particles, influences.weights)),
    )
    .expect("a valid binding");
    let transforms: Vec<ParticleTransform> = (0..particles.len())
        .map(|i| {
            let position = start.position[i].lerp(particles.position[i], fraction);
            let rotation = start.rotation[i].lerp(particles.rotation[i], fraction);
            ParticleTransform::new(position.into(), rotation, scale, binding.rest_particles()[i])
        })
        .collect();
    let count = source.positions.len();
    let (mut positions, mut normals) = (vec![[0.0; 3]; count], vec![[0.0; 3]; count]);
    let mut skinned_tangents = vec![[0.0; 4]; tangents.len()];
    let out = SkinnedVertices { positions: &mut positions, normals: Some(&mut normals), tangents: Some(&mut skinned_tangents) };
    assert!(skin(&binding, &transforms, out));
    [positions, normals, skinned_tangents.iter().map(|&[x, y, z, _]| [x, y, z]).collect()]
}

/// The largest difference between the slab and what must be there, relative to the body's size.
fn error(app: &App, body: Entity, expected: &[Vec<[f32; 3]>; 3], size: f32) -> f32 {
    let skin = app.world().get::<Skin>(body).expect("the body has a skin");
    let layout = skin.layout();
    let words = slab_words(app, skin.instance().id(), layout.stride).expect("the mesh is in a slab");
    assert_eq!(words.len(), expected[0].len() * layout.stride as usize);
    let mut largest = 0.0f32;
    for (vertex, words) in words.chunks_exact(layout.stride as usize).enumerate() {
        let offsets = [Some(layout.position), layout.normal, layout.tangent];
        for ((offset, expected), unit) in offsets.into_iter().zip(expected).zip([size, 1.0, 1.0]) {
            let Some(offset) = offset.map(|offset| offset as usize) else {
                continue;
            };
            for (found, expected) in words[offset..offset + 3].iter().zip(expected[vertex]) {
                assert!(found.is_finite());
                largest = largest.max((found - expected).abs() / unit);
            }
        }
    }
    largest
}

#[test]
fn slab_matches_the_mirror_for_all_bodies_and_layouts() {
    if !gpu_or_skip() {
        return;
    }
    let mut app = app(PolpoRenderPlugin::default());
    let (plain_source, plain_rig) = limb(40, 12, Vec3::ZERO);
    // Far from the mesh's own origin, with tangents, and so in a slab of its own.
    let (tangent_source, tangent_rig) = limb(25, 7, Vec3::new(30.0, -20.0, 10.0));
    let tangents = vec![[1.0, 0.0, 0.0, -1.0]; tangent_source.positions.len()];
    let plain = add_mesh(&mut app, bevy_mesh(&plain_source));
    let tangent = add_mesh(&mut app, bevy_mesh(&tangent_source).with_inserted_attribute(Mesh::ATTRIBUTE_TANGENT, tangents.clone()));
    // A mesh of somebody else's with the same vertex layout.
    let stranger = add_mesh(&mut app, Mesh::from(Cuboid::default()));
    let before = Mesh::from(Cuboid::default()).create_packed_vertex_buffer_data();
    let material = app.world_mut().resource_mut::<Assets<StandardMaterial>>().add(Color::WHITE);
    app.world_mut().spawn((Mesh3d(stranger.clone()), MeshMaterial3d(material)));

    // More than four influences a vertex.
    let (wide_source, wide_rig) = limb_following(18, 9, Vec3::ZERO, 8);
    let wide = add_mesh(&mut app, bevy_mesh(&wide_source));

    let half_turn = Quat::from_xyzw(0.6, 0.0, 0.8, 0.0);
    let bodies = [
        (spawn(&mut app, &plain, &plain_rig, Transform::from_xyz(-3.0, 2.0, 0.0)), &plain_source, &[][..], 1.0),
        (
            spawn(&mut app, &plain, &plain_rig, Transform::from_rotation(half_turn).with_scale(Vec3::splat(0.5))),
            &plain_source,
            &[][..],
            0.5,
        ),
        (spawn(&mut app, &tangent, &tangent_rig, Transform::from_xyz(-32.0, 18.0, -10.0)), &tangent_source, &tangents[..], 1.0),
        (spawn(&mut app, &plain, &plain_rig, Transform::from_xyz(3.0, -2.0, 0.0)), &plain_source, &[][..], 1.0),
        (spawn(&mut app, &wide, &wide_rig, Transform::from_xyz(0.0, 4.0, 0.0)), &wide_source, &[][..], 1.0),
    ];
    let mut random = Random(9);
    let mut worst = 0.0f32;
    for frame in 0..12 {
        // Frames shorter and longer than a fixed step, so that every interpolation fraction comes up.
        let delta = Duration::from_micros(3_000 + 4_700 * (frame % 5));
        app.insert_resource(TimeUpdateStrategy::ManualDuration(delta));
        if frame > 0 {
            for (body, ..) in bodies {
                shake(&mut app, body, &mut random, 0.1);
            }
        }
        app.update();
        for (body, source, tangents, scale) in bodies {
            let expected = expected(&app, body, source, tangents, scale);
            worst = worst.max(error(&app, body, &expected, SIZE * scale));
        }
    }
    let instance = |body: Entity| app.world().get::<Skin>(body).expect("skinned").instance().id();
    let widths = bodies.map(|(body, ..)| app.world().get::<Skin>(body).expect("skinned").binding().more().len());
    assert_eq!(widths, [0, 0, 0, 0, 18 * 16], "the test is about one body with more than four influences a vertex");
    let [a, b, c, d, _] = bodies.map(|(body, ..)| slab_of(&app, instance(body)).expect("in a slab"));
    assert!(a == b && b == d && a != c, "the test is about bodies that share a slab, and one that does not");
    assert_eq!(slab_of(&app, stranger.id()), Some(a));
    let after = slab_words(&app, stranger.id(), 8).expect("the stranger is there");
    assert_eq!(bytemuck::cast_slice::<f32, u8>(&after), before, "a mesh of somebody else's was touched");
    eprintln!("GPU in Bevy against CPU: largest error {worst:e} of the body's size");
    assert!(worst < 1e-5, "largest error {worst}");
}

#[test]
fn despawning_frees_and_respawning_binds_again() {
    if !gpu_or_skip() {
        return;
    }
    let mut app = app(PolpoRenderPlugin::default());
    let (source, rig) = limb(20, 6, Vec3::ZERO);
    let mesh = add_mesh(&mut app, bevy_mesh(&source));
    app.update();
    let meshes_before = app.world().resource::<Assets<Mesh>>().len();
    let mut random = Random(5);
    let mut bodies: Vec<Entity> = (0..5).map(|i| spawn(&mut app, &mesh, &rig, Transform::from_xyz(0.0, i as f32, 0.0))).collect();
    app.update();
    assert_eq!(app.world().resource::<Assets<Mesh>>().len(), meshes_before + 5, "one mesh a body");
    for round in 0..3 {
        let gone = bodies.remove(round);
        let gone_mesh = app.world().get::<Skin>(gone).expect("skinned").instance().id();
        app.world_mut().entity_mut(gone).despawn();
        bodies.push(spawn(&mut app, &mesh, &rig, Transform::from_xyz(1.0, round as f32, 0.0)));
        app.update();
        for &body in &bodies {
            shake(&mut app, body, &mut random, 0.1);
        }
        app.update();
        assert!(slab_of(&app, gone_mesh).is_none(), "a despawned body's mesh is still in its slab");
        for &body in &bodies {
            let expected = expected(&app, body, &source, &[], 1.0);
            assert!(error(&app, body, &expected, SIZE) < 1e-5, "round {round}, {body}");
        }
    }
    assert_eq!(app.world().resource::<SkinningStats>().bodies, 5);
    for body in bodies {
        app.world_mut().entity_mut(body).despawn();
    }
    app.update();
    app.update();
    assert_eq!(app.world().resource::<Assets<Mesh>>().len(), meshes_before, "a despawned body leaves a mesh behind");
    assert_eq!(app.world().resource::<SkinningStats>().bodies, 0);
}

/// How often a mesh was refused, and why last.
#[derive(Resource, Default)]
struct Rejections(usize, Option<SkinError>);

#[test]
fn other_meshes_and_rigs_bind_again_and_wrong_ones_are_refused_once() {
    if !gpu_or_skip() {
        return;
    }
    let mut app = app(PolpoRenderPlugin::default());
    app.init_resource::<Rejections>().add_observer(|event: On<SkinRejected>, mut rejections: ResMut<Rejections>| {
        rejections.0 += 1;
        rejections.1 = Some(event.reason.clone());
    });
    let (small, small_rig) = limb(10, 4, Vec3::ZERO);
    let (large, large_rig) = limb(30, 9, Vec3::ZERO);
    let small_mesh = add_mesh(&mut app, bevy_mesh(&small));
    let large_mesh = add_mesh(&mut app, bevy_mesh(&large));
    let body = spawn(&mut app, &large_mesh, &small_rig, Transform::IDENTITY);
    for _ in 0..4 {
        app.update();
    }
    let rejections = app.world().resource::<Rejections>();
    assert_eq!(rejections.0, 1, "reported once, not every frame");
    assert_eq!(rejections.1, Some(SkinError::VertexCount { mesh: 480, rig: 160 }));
    assert!(app.world().get::<Skin>(body).is_none());
    assert_eq!(app.world().get::<Mesh3d>(body), Some(&Mesh3d(large_mesh.clone())), "the mesh stays as it was");

    // Another mesh, which fits.
    app.world_mut().entity_mut(body).insert(Mesh3d(small_mesh.clone()));
    app.update();
    assert!(error(&app, body, &expected(&app, body, &small, &[], 1.0), SIZE) < 1e-5);

    // Another body and its mesh, on the same entity.
    app.world_mut().entity_mut(body).insert((SoftBody::new(large_rig.clone()), Mesh3d(large_mesh.clone())));
    app.update();
    assert!(error(&app, body, &expected(&app, body, &large, &[], 1.0), SIZE) < 1e-5);
    assert_eq!(app.world().get::<Skin>(body).map(Skin::source), Some(&large_mesh));

    // The mesh asset changes under the body: here it is shifted, and the rig with it would not matter, only the vertices do.
    let shifted = polpo_rig::Mesh { positions: large.positions.iter().map(|x| x * 1.5).collect(), ..large.clone() };
    app.world_mut().resource_mut::<Assets<Mesh>>().insert(&large_mesh, bevy_mesh(&shifted)).expect("the asset is there");
    app.update();
    app.update();
    assert!(error(&app, body, &expected(&app, body, &shifted, &[], 1.0), SIZE) < 1e-5);

    // No body any more: the user's mesh is back.
    app.world_mut().entity_mut(body).remove::<SoftBody>();
    app.update();
    assert!(app.world().get::<Skin>(body).is_none());
    assert_eq!(app.world().get::<Mesh3d>(body), Some(&Mesh3d(large_mesh)));
    assert_eq!(app.world().resource::<Rejections>().0, 1);
}

#[test]
fn the_cpu_writes_the_same_vertices() {
    if !gpu_or_skip() {
        return;
    }
    let mut app = app(PolpoRenderPlugin { backend: SkinningBackend::Cpu, ..default() });
    let (source, rig) = limb(313, 300, Vec3::new(3.0, 0.0, 0.0));
    let mesh = add_mesh(&mut app, bevy_mesh(&source));
    let body = spawn(&mut app, &mesh, &rig, Transform::from_xyz(-3.0, 0.0, 0.0));
    let mut random = Random(77);
    app.update();
    for _ in 0..3 {
        shake(&mut app, body, &mut random, 0.2);
        app.update();
        let expected = expected(&app, body, &source, &[], 1.0);
        assert!(error(&app, body, &expected, SIZE) < 1e-6);
    }
    let stats = app.world().resource::<SkinningStats>();
    eprintln!("skin: {:?} on the CPU, {} vertices, {} particles", stats.cpu_skin_time, source.positions.len(), rig.particles.len());
    assert!(stats.on_cpu && stats.cpu_skin_time > Duration::ZERO);
}

#[test]
fn each_part_of_a_model_wears_its_material_and_matches_the_mirror() {
    if !gpu_or_skip() {
        return;
    }
    let files = Files::default();
    let bytes = glb(&dumbbell(), &COLORS, serde_json::Value::Null);
    let source = polpo_rig::parse_mesh("dumbbell.glb", &bytes).expect("a good model");
    files.write("dumbbell.glb", bytes);
    let mut app = App::new();
    files.serve(&mut app);
    let mut app = render_app_of(app, PolpoRenderPlugin::default());
    start(&mut app);
    camera(&mut app, Transform::from_xyz(0.0, 0.0, 20.0));
    let recipe = polpo_rig::Recipe { influences: 8, ..polpo_rig::Recipe::with_particles(24) };
    let recipe = app.world_mut().resource_mut::<Assets<RecipeAsset>>().add(RecipeAsset(recipe));
    let model = app.world().resource::<AssetServer>().load("dumbbell.glb");
    let scene = SoftBodyScene::new(model).with_recipe(recipe);
    let bodies = [-1.0, 1.0].map(|y| app.world_mut().spawn((scene.clone(), Transform::from_xyz(0.0, y, 0.0))).id());
    let started = std::time::Instant::now();
    while bodies.iter().any(|&body| app.world().get::<Children>(body).is_none()) {
        assert!(started.elapsed() < Duration::from_secs(60), "waited a minute for two bodies");
        std::thread::sleep(Duration::from_millis(1));
        app.update();
    }
    app.update();
    let mut random = Random(11);
    for body in bodies {
        shake(&mut app, body, &mut random, 0.1);
    }
    app.update();
    for body in bodies {
        let whole = expected(&app, body, &source, &[], 1.0);
        let children: Vec<Entity> = app.world().get::<Children>(body).expect("parts").iter().collect();
        assert_eq!(children.len(), 3);
        for ((part, child), (name, color)) in source.parts.iter().zip(children).zip(COLORS) {
            let slice = |list: &Vec<[f32; 3]>| list[part.vertices.start as usize..part.vertices.end as usize].to_vec();
            let expected = [slice(&whole[0]), slice(&whole[1]), Vec::new()];
            let worst = error(&app, child, &expected, SIZE);
            assert!(worst < 1e-5, "{name}: {worst}");
            let material = app.world().get::<MeshMaterial3d<StandardMaterial>>(child).expect("a material");
            let material = app.world().resource::<Assets<StandardMaterial>>().get(&material.0).expect("it is loaded");
            assert_eq!(material.base_color.to_linear().to_f32_array(), color, "{name}");
        }
    }
    assert_eq!(app.world().resource::<SkinningStats>().bodies, 2);
}

#[test]
fn the_pass_reports_its_time() {
    if !gpu_or_skip() {
        return;
    }
    let mut app = render_app(PolpoRenderPlugin::default());
    app.add_plugins(RenderDiagnosticsPlugin);
    start(&mut app);
    camera(&mut app, Transform::from_xyz(0.0, 0.0, 20.0));
    // The size of the paper's octopus: 5000 vertices on 300 particles.
    let (source, rig) = limb(313, 300, Vec3::ZERO);
    let mesh = add_mesh(&mut app, bevy_mesh(&source));
    spawn(&mut app, &mesh, &rig, Transform::IDENTITY);
    for _ in 0..40 {
        app.update();
    }
    let store = app.world().resource::<DiagnosticsStore>();
    let has_timestamps = app.world().resource::<bevy::render::renderer::RenderDevice>().features().contains(
        wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_PASSES | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS,
    );
    if !has_timestamps {
        eprintln!("SKIPPED: the adapter has no timestamps inside passes");
        return;
    }
    let time = store.get(&SKIN_GPU_TIME).and_then(|diagnostic| diagnostic.average()).expect("a span named skin");
    let stats = app.world().resource::<SkinningStats>();
    eprintln!(
        "skin: {time:.3} ms on the GPU, pose {:?} on the CPU, {} vertices, {} particles",
        stats.pose_time,
        source.positions.len(),
        rig.particles.len()
    );
    assert!(time > 0.0 && time < 1000.0);
}
