//! Contract: a body is drawn where its particles are, with the game's own material, and is not culled by where it was at rest.

use bevy::camera::primitives::Aabb;
use bevy::core_pipeline::prepass::{DepthPrepass, NormalPrepass};
use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::render::{PolpoGizmos, PolpoGizmosPlugin, PolpoRenderPlugin, SkinningBackend, bevy_mesh};
use polpo::{Particles, SoftBody, StepStart};
use polpo_tests::render::{PICTURE, camera, gpu_or_skip, limb, picture, render_app, start};

/// A red limb at the origin, and cameras that look at it and at the place 40 m to the right.
struct Scene {
    app: App,
    body: Entity,
    at_rest: Handle<Image>,
    far_away: Handle<Image>,
}

/// Half of what a camera sees at a distance of 1 m: the tangent of half its field of view of 45°.
const HALF_VIEW: f32 = 0.414_213_57;

const FAR: Vec3 = Vec3::new(40.0, 0.0, 0.0);

fn scene(backend: SkinningBackend) -> Scene {
    let mut app = render_app(PolpoRenderPlugin { backend, interpolate: false });
    app.add_plugins(PolpoGizmosPlugin);
    start(&mut app);
    let eye = Vec3::new(0.0, 0.0, 4.0);
    let at_rest = camera(&mut app, Transform::from_translation(eye));
    let far_away = camera(&mut app, Transform::from_translation(eye + FAR));
    let body = red_limb(&mut app);
    Scene { app, body, at_rest, far_away }
}

fn red_limb(app: &mut App) -> Entity {
    let (mesh, rig) = limb(20, 6, Vec3::ZERO);
    let mesh = app.world_mut().resource_mut::<Assets<Mesh>>().add(bevy_mesh(&mesh));
    let material = StandardMaterial { base_color: Color::srgb(1.0, 0.0, 0.0), unlit: true, cull_mode: None, ..default() };
    let material = app.world_mut().resource_mut::<Assets<StandardMaterial>>().add(material);
    app.world_mut().spawn((SoftBody::new(rig), Mesh3d(mesh), MeshMaterial3d(material))).id()
}

impl Scene {
    /// Moves the particles as a rigid body away from rest; the entity stays.
    fn place(&mut self, rotation: Quat, offset: Vec3) {
        let mut entity = self.app.world_mut().entity_mut(self.body);
        let mut particles = entity.take::<Particles>().expect("a body");
        for i in 0..particles.len() {
            particles.0.position[i] = rotation * particles.rest_position[i] + Vec3A::from(offset);
            particles.0.rotation[i] = rotation;
        }
        let start = StepStart { position: particles.position.clone(), rotation: particles.rotation.clone(), ..default() };
        entity.insert((particles, start));
    }

    /// Whether the pixel `x`, `y` of a picture (0 to 1 from the left and the top) is the body's red.
    fn is_red(&self, image: &Handle<Image>, x: f32, y: f32) -> bool {
        let [column, row] = [x, y].map(|at| (at * PICTURE as f32) as usize);
        let [r, g, b, _] = picture(&self.app, image)[row * PICTURE as usize + column];
        assert!(!(5..=250).contains(&r) && g < 5 && b < 5, "pixel {r} {g} {b} is neither red nor black");
        r > 250
    }
}

fn body_is_drawn_where_its_particles_are(backend: SkinningBackend) {
    if !gpu_or_skip() {
        return;
    }
    let mut scene = scene(backend);
    scene.app.update();
    scene.app.update();
    // At rest: a bar across the middle, from −1 to 1 m where ±1.66 m are seen.
    assert!(scene.is_red(&scene.at_rest, 0.5, 0.5));
    assert!(scene.is_red(&scene.at_rest, 0.25, 0.5));
    assert!(!scene.is_red(&scene.at_rest, 0.5, 0.2));
    assert!(!scene.is_red(&scene.far_away, 0.5, 0.5));

    // Stood on end by its particles, while the entity stays as it is.
    let half = core::f32::consts::FRAC_1_SQRT_2;
    scene.place(Quat::from_xyzw(0.0, 0.0, half, half), Vec3::ZERO);
    scene.app.update();
    assert!(scene.is_red(&scene.at_rest, 0.5, 0.25));
    assert!(!scene.is_red(&scene.at_rest, 0.25, 0.5), "the body is still drawn at rest");

    // Far from the rest pose, where the camera does not see the rest mesh's box.
    scene.place(Quat::IDENTITY, FAR);
    scene.app.update();
    assert!(scene.is_red(&scene.far_away, 0.5, 0.5), "the body was culled by its box at rest");
    assert!(!scene.is_red(&scene.at_rest, 0.5, 0.5));
    let aabb = scene.app.world().get::<Aabb>(scene.body).expect("a box");
    assert!((Vec3::from(aabb.center) - FAR).length() < 0.01 && (aabb.half_extents.x - 1.0).abs() < 0.4, "{aabb:?}");

    // Out of every view and back: a body that nobody sees is not skinned, and must be when it is seen again.
    scene.place(Quat::IDENTITY, Vec3::Y * 500.0);
    scene.app.update();
    assert!(!scene.is_red(&scene.far_away, 0.5, 0.5) && !scene.is_red(&scene.at_rest, 0.5, 0.5));
    scene.place(Quat::IDENTITY, Vec3::ZERO);
    scene.app.update();
    assert!(scene.is_red(&scene.at_rest, 0.5, 0.5));
}

#[test]
fn body_is_drawn_where_its_particles_are_by_the_gpu() {
    body_is_drawn_where_its_particles_are(SkinningBackend::Auto);
}

#[test]
fn body_is_drawn_where_its_particles_are_by_the_cpu() {
    body_is_drawn_where_its_particles_are(SkinningBackend::Cpu);
}

#[test]
fn shadow_and_prepass_follow_the_particles() {
    if !gpu_or_skip() {
        return;
    }
    let mut app = render_app(PolpoRenderPlugin { interpolate: false, ..default() });
    app.add_plugins(PolpoGizmosPlugin);
    start(&mut app);
    // From above: the picture's top is −z. With a depth prepass the main pass draws only what the prepass drew too, so a prepass of the undeformed mesh would hide the body.
    let above = camera(&mut app, Transform::from_xyz(0.0, 5.0, 0.0).looking_at(Vec3::ZERO, Vec3::NEG_Z));
    let mut cameras = app.world_mut().query_filtered::<Entity, With<Camera3d>>();
    let eye = cameras.single(app.world()).expect("one camera");
    app.world_mut().entity_mut(eye).insert((DepthPrepass, NormalPrepass));
    // Light at 45° towards −z: a shadow on the floor, 1 m below, lies 1 m further in −z.
    let light = DirectionalLight { shadow_maps_enabled: true, illuminance: 2_000.0, ..default() };
    app.world_mut().spawn((light, Transform::default().looking_to(Vec3::new(0.0, -1.0, -1.0), Vec3::Y)));
    let floor = app.world_mut().resource_mut::<Assets<Mesh>>().add(Plane3d::new(Vec3::Y, Vec2::splat(20.0)));
    let white = app.world_mut().resource_mut::<Assets<StandardMaterial>>().add(Color::WHITE);
    app.world_mut().spawn((Mesh3d(floor), MeshMaterial3d(white), Transform::from_xyz(0.0, -1.0, 0.0)));
    let (at_rest, body) = (above.clone(), red_limb(&mut app));
    let mut scene = Scene { app, body, at_rest, far_away: above.clone() };
    // Where z = `at` is seen on the floor, and in the plane of the body.
    let on_floor = |at: f32| 0.5 + at / (2.0 * 6.0 * HALF_VIEW);
    let on_body = |at: f32| 0.5 + at / (2.0 * 5.0 * HALF_VIEW);
    let pixel = |scene: &Scene, y: f32| {
        let row = (y * PICTURE as f32) as usize;
        picture(&scene.app, &above)[row * PICTURE as usize + PICTURE as usize / 2].map(i32::from)
    };
    let is_red = |[r, g, b, _]: [i32; 4]| r > 250 && g < 5 && b < 5;

    scene.app.update();
    scene.app.update();
    let (shadow, floor) = (pixel(&scene, on_floor(-1.0)), pixel(&scene, on_floor(1.0)));
    assert!(is_red(pixel(&scene, on_body(0.0))));
    assert!(shadow[1] * 2 < floor[1], "shadow {shadow:?}, floor {floor:?}");

    scene.place(Quat::IDENTITY, Vec3::Z * 1.2);
    scene.app.update();
    let (shadow, floor) = (pixel(&scene, on_floor(0.2)), pixel(&scene, on_floor(-1.0)));
    assert!(is_red(pixel(&scene, on_body(1.2))), "the prepass hides the deformed body");
    assert!(shadow[1] * 2 < floor[1], "the shadow stayed: {shadow:?} against {floor:?}");
}

#[test]
fn gizmos_draw_what_is_switched_on_and_nothing_else() {
    if !gpu_or_skip() {
        return;
    }
    let mut scene = scene(SkinningBackend::Auto);
    let lit = |scene: &Scene| picture(&scene.app, &scene.at_rest).iter().filter(|[r, g, b, _]| r.max(g).max(b) > &40).count();
    scene.app.world_mut().entity_mut(scene.body).remove::<Mesh3d>();
    scene.app.update();
    scene.app.update();
    assert_eq!(lit(&scene), 0, "nothing is on");
    scene.app.world_mut().resource_mut::<PolpoGizmos>().edges = true;
    scene.app.update();
    scene.app.update();
    let edges = lit(&scene);
    // Five edges end to end over 2 m, at about 19 pixels a metre.
    assert!((25..=160).contains(&edges), "{edges} pixels of edges");
    let mut gizmos = scene.app.world_mut().resource_mut::<PolpoGizmos>();
    gizmos.edges = false;
    gizmos.particles = true;
    scene.app.update();
    let particles = lit(&scene);
    assert!(particles > 2 * edges, "{particles} pixels of particles");
    scene.app.world_mut().resource_mut::<PolpoGizmos>().particles = false;
    scene.app.update();
    assert_eq!(lit(&scene), 0, "off again");
}
