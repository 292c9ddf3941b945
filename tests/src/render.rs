//! An app with a renderer and no window, a limb to skin, and looking into the GPU's memory.

use std::sync::Arc;
use std::time::Duration;

use bevy::app::{PluginGroup, TerminalCtrlCHandlerPlugin};
use bevy::asset::RenderAssetUsages;
use bevy::camera::RenderTarget;
use bevy::diagnostic::FrameCount;
use bevy::log::LogPlugin;
use bevy::math::Vec3A;
use bevy::prelude::*;
use bevy::render::RenderApp;
use bevy::render::RenderPlugin;
use bevy::render::mesh::allocator::MeshAllocator;
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::render::render_asset::RenderAssets;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat, TextureUsages};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::render::texture::GpuImage;
use bevy::time::TimeUpdateStrategy;
use bevy::window::ExitCondition;
use bevy::winit::WinitPlugin;
use polpo::render::PolpoRenderPlugin;
use polpo::{Particles, PolpoPlugin, StepStart};
use polpo_rig::{Influences, Particle, Rig};

/// Width and height of [`camera`]'s picture \[px\]. A row is then 256 bytes, which is what copies out of a texture are aligned to.
pub const PICTURE: u32 = 64;

/// Whether there is a GPU (lavapipe counts). If not: says so on stderr, or fails if the environment has POLPO_REQUIRE_GPU=1.
pub fn gpu_or_skip() -> bool {
    match polpo_skinning::headless::open() {
        Ok(_) => true,
        Err(error) if std::env::var_os("POLPO_REQUIRE_GPU").is_some_and(|value| value == "1") => {
            panic!("POLPO_REQUIRE_GPU=1 and no GPU adapter: {error}")
        }
        Err(error) => {
            eprintln!("SKIPPED: no GPU adapter ({error})");
            false
        }
    }
}

/// `DefaultPlugins` without window, log and threads of its own, with soft bodies. Time stands still until a test sets `TimeUpdateStrategy`.
pub fn render_app(plugin: PolpoRenderPlugin) -> App {
    render_app_of(App::new(), plugin)
}

/// The same from an app in which something was registered before the plugins.
pub fn render_app_of(mut app: App, plugin: PolpoRenderPlugin) -> App {
    app.add_plugins(
        DefaultPlugins
            .set(WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() })
            // A picture is looked at as soon as it is drawn, so no shader may be late.
            .set(RenderPlugin { synchronous_pipeline_compilation: true, ..default() })
            .disable::<PipelinedRenderingPlugin>()
            .disable::<TerminalCtrlCHandlerPlugin>()
            .disable::<LogPlugin>()
            .disable::<WinitPlugin>(),
    )
    .add_plugins((PolpoPlugin::default(), plugin))
    .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO))
    .insert_resource(ClearColor(Color::BLACK));
    app
}

/// Finishes plugins, as a runner would.
pub fn start(app: &mut App) {
    while app.plugins_state() == bevy::app::PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    assert_eq!(app.world().resource::<FrameCount>().0, 0);
}

/// A camera that draws into a picture of its own, [`PICTURE`] pixels square, without tone mapping.
pub fn camera(app: &mut App, transform: Transform) -> Handle<Image> {
    let size = Extent3d { width: PICTURE, height: PICTURE, depth_or_array_layers: 1 };
    let mut image = Image::new_uninit(size, TextureDimension::D2, TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::RENDER_WORLD);
    image.texture_descriptor.usage |= TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
    let image = app.world_mut().resource_mut::<Assets<Image>>().add(image);
    app.world_mut().spawn((
        Camera3d::default(),
        RenderTarget::from(image.clone()),
        bevy::core_pipeline::tonemapping::Tonemapping::None,
        Msaa::Off,
        transform,
    ));
    image
}

/// The picture as it was drawn last: RGBA, row by row from the top.
pub fn picture(app: &App, image: &Handle<Image>) -> Vec<[u8; 4]> {
    let world = app.sub_app(RenderApp).world();
    let gpu_image = world.resource::<RenderAssets<GpuImage>>().get(image).expect("the picture is on the GPU");
    let bytes = read_back(
        world,
        |encoder, copy| {
            encoder.copy_texture_to_buffer(
                gpu_image.texture.as_image_copy(),
                wgpu::TexelCopyBufferInfo {
                    buffer: copy,
                    layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * PICTURE), rows_per_image: None },
                },
                gpu_image.texture_descriptor.size,
            );
        },
        u64::from(4 * PICTURE * PICTURE),
    );
    bytemuck::pod_collect_to_vec(&bytes)
}

/// The words of a mesh in its vertex slab; `None` if it is in none.
pub fn slab_words(app: &App, mesh: AssetId<Mesh>, stride: u32) -> Option<Vec<f32>> {
    let world = app.sub_app(RenderApp).world();
    let slice = world.resource::<MeshAllocator>().mesh_vertex_slice(&mesh)?;
    let bytes_a_vertex = u64::from(stride) * 4;
    let size = slice.range.len() as u64 * bytes_a_vertex;
    let bytes = read_back(
        world,
        |encoder, copy| {
            encoder.copy_buffer_to_buffer(slice.buffer, u64::from(slice.range.start) * bytes_a_vertex, copy, 0, size);
        },
        size,
    );
    Some(bytemuck::pod_collect_to_vec(&bytes))
}

/// Which vertex buffer a mesh lies in, to see whether two share one.
pub fn slab_of(app: &App, mesh: AssetId<Mesh>) -> Option<wgpu::Buffer> {
    let world = app.sub_app(RenderApp).world();
    let slice = world.resource::<MeshAllocator>().mesh_vertex_slice(&mesh)?;
    Some((**slice.buffer).clone())
}

fn read_back(world: &World, record: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer), size: u64) -> Vec<u8> {
    let device = world.resource::<RenderDevice>().wgpu_device();
    let copy = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("read back"),
        size,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    record(&mut encoder, &copy);
    world.resource::<RenderQueue>().submit([encoder.finish()]);
    copy.map_async(wgpu::MapMode::Read, .., |result| result.expect("mapped"));
    device.poll(wgpu::PollType::wait_indefinitely()).expect("the device answers");
    copy.get_mapped_range(..).to_vec()
}

/// A limb along x, 2 m long, its middle at `offset`: a tube of `rings` rings of 16 vertices on a row of `particles`, each vertex on its up to four nearest. Returns the mesh and its rig.
pub fn limb(rings: usize, particles: usize, offset: Vec3) -> (polpo_rig::Mesh, Arc<Rig>) {
    limb_following(rings, particles, offset, 4)
}

/// The same with each vertex on its up to `most` nearest.
pub fn limb_following(rings: usize, particles: usize, offset: Vec3, most: usize) -> (polpo_rig::Mesh, Arc<Rig>) {
    const SIDES: usize = 16;
    let along = |i: usize, n: usize| offset + Vec3::X * (2.0 * i as f32 / (n - 1) as f32 - 1.0);
    let centers: Vec<Vec3> = (0..particles).map(|i| along(i, particles)).collect();
    let mut mesh = polpo_rig::Mesh { name: "limb".into(), ..Default::default() };
    let mut skin = Vec::new();
    for ring in 0..rings {
        for side in 0..SIDES {
            let angle = side as f32 * core::f32::consts::TAU / SIDES as f32;
            let normal = Vec3::new(0.0, angle.cos(), angle.sin());
            let position = along(ring, rings) + 0.25 * normal;
            mesh.positions.push(position);
            mesh.normals.push(normal);
            mesh.uvs.push(Vec2::new(ring as f32 / rings as f32, side as f32 / SIDES as f32));
            skin.push(nearest(position, &centers, most));
            if ring + 1 < rings {
                let (a, b) = ((ring * SIDES + side) as u32, (ring * SIDES + (side + 1) % SIDES) as u32);
                let (c, d) = (a + SIDES as u32, b + SIDES as u32);
                mesh.triangles.extend([[a, b, c], [b, d, c]]);
            }
        }
    }
    let particle = |&position: &Vec3| Particle { position, frame: Quat::IDENTITY, radii: Vec3::new(0.2, 0.25, 0.3), mass: 0.5 };
    let rig = Rig {
        mesh_hash: mesh.hash(),
        particles: centers.iter().map(particle).collect(),
        edges: (1..particles as u32).map(|i| [i - 1, i]).collect(),
        skin,
        ..Rig::default()
    };
    rig.validate().expect("the limb's rig is whole");
    (mesh, Arc::new(rig))
}

fn nearest(position: Vec3, centers: &[Vec3], most: usize) -> Influences {
    let mut order: Vec<u32> = (0..centers.len() as u32).collect();
    let distance = |i: u32| centers[i as usize].distance(position);
    order.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    let near: Vec<(u32, f64)> = order.iter().take(most).map(|&p| (p, 1.0 / f64::from(0.05 + distance(p)))).collect();
    Influences::new(&near)
}

/// xorshift: the same on every machine.
pub struct Random(pub u32);

impl Random {
    /// Uniform in −1..1.
    pub fn signed(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        (self.0 >> 8) as f32 / (1u32 << 23) as f32 - 1.0
    }

    /// A vector in the cube −1..1.
    pub fn vector(&mut self) -> Vec3A {
        Vec3A::new(self.signed(), self.signed(), self.signed())
    }

    /// A rotation by up to about half a turn.
    pub fn rotation(&mut self) -> Quat {
        Quat::from_xyzw(self.signed(), self.signed(), self.signed(), 0.5).normalize()
    }
}

/// Shakes the particles at the start and the end of the last step by up to `spread` \[m\] and any rotation.
pub fn shake(app: &mut App, body: Entity, random: &mut Random, spread: f32) {
    let mut entity = app.world_mut().entity_mut(body);
    let mut particles = entity.take::<Particles>().expect("a body");
    let mut start = entity.take::<StepStart>().expect("a body");
    let center = particles.rest_position.iter().sum::<Vec3A>() / particles.len() as f32;
    for i in 0..particles.len() {
        let rest = particles.rest_position[i] - center;
        particles.0.position[i] = rest + spread * random.vector();
        particles.0.rotation[i] = random.rotation();
        start.position[i] = rest + spread * random.vector();
        start.rotation[i] = random.rotation();
    }
    entity.insert((particles, start));
}
