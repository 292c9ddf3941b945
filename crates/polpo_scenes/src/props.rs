//! What stands around in a scene: Rapier colliders that can be seen.

use bevy::asset::RenderAssetUsages;
use bevy::mesh::{Indices, PrimitiveTopology};
use bevy::prelude::*;
use polpo_rapier::RapierWorld;
use rapier3d::prelude::{ColliderBuilder, ColliderHandle, RigidBodyHandle, TypedShape};

/// A collider that is drawn.
#[derive(Component, Debug, Clone, Copy)]
pub struct Prop {
    /// The collider in [`RapierWorld`].
    pub collider: ColliderHandle,
    /// Its paint.
    pub color: Color,
}

/// Puts a collider into the world, on `body` if there is one, and a [`Prop`] that shows it.
pub fn spawn_prop(
    commands: &mut Commands,
    world: &mut RapierWorld,
    collider: ColliderBuilder,
    body: Option<RigidBodyHandle>,
    color: Color,
) -> Entity {
    let collider = match body {
        Some(body) => world.colliders.insert_with_parent(collider, body, &mut world.bodies),
        None => world.colliders.insert(collider),
    };
    commands.spawn((Prop { collider, color }, Transform::default(), Visibility::default())).id()
}

/// Gives new props a mesh made from their collider's shape.
pub(crate) fn dress_props(
    mut commands: Commands,
    world: Res<RapierWorld>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    props: Query<(Entity, &Prop), Without<Mesh3d>>,
) {
    for (entity, prop) in &props {
        let Some(mesh) = world.colliders.get(prop.collider).and_then(|c| mesh_of(c.shape().as_typed_shape())) else {
            continue;
        };
        let material = StandardMaterial { base_color: prop.color, perceptual_roughness: 0.85, ..default() };
        commands.entity(entity).insert((Mesh3d(meshes.add(mesh)), MeshMaterial3d(materials.add(material))));
    }
}

/// Props stand where their colliders do.
pub(crate) fn follow_colliders(world: Res<RapierWorld>, mut props: Query<(&Prop, &mut Transform)>) {
    for (prop, mut transform) in &mut props {
        if let Some(collider) = world.colliders.get(prop.collider) {
            let pose = collider.position();
            let there = Transform::from_translation(pose.translation).with_rotation(pose.rotation);
            transform.set_if_neq(there);
        }
    }
}

fn mesh_of(shape: TypedShape<'_>) -> Option<Mesh> {
    let smooth = matches!(shape, TypedShape::Capsule(_));
    let (vertices, triangles) = match shape {
        TypedShape::Ball(ball) => return Some(Sphere::new(ball.radius).mesh().uv(48, 24)),
        TypedShape::Cuboid(cuboid) => {
            let h = cuboid.half_extents;
            return Some(Cuboid::new(2.0 * h.x, 2.0 * h.y, 2.0 * h.z).into());
        }
        TypedShape::Cylinder(c) => return Some(Cylinder::new(c.radius, 2.0 * c.half_height).mesh().resolution(64).build()),
        TypedShape::Capsule(capsule) => capsule.to_trimesh(48, 16),
        // A half-space has no end; a large square of it is shown.
        TypedShape::HalfSpace(plane) => return Some(Plane3d::new(plane.normal, Vec2::splat(300.0)).into()),
        TypedShape::TriMesh(mesh) => (mesh.vertices().to_vec(), mesh.indices().to_vec()),
        TypedShape::HeightField(field) => field.to_trimesh(),
        TypedShape::ConvexPolyhedron(hull) => hull.to_trimesh(),
        _ => return None,
    };
    let positions: Vec<[f32; 3]> = vertices.iter().map(|v| v.to_array()).collect();
    let indices = triangles.into_iter().flatten().collect();
    let mut mesh = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
        .with_inserted_indices(Indices::U32(indices));
    if smooth {
        mesh.compute_smooth_normals();
    } else {
        mesh.duplicate_vertices();
        mesh.compute_flat_normals();
    }
    Some(mesh)
}
