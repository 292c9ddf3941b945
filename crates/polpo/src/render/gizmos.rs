//! Drawing what the solver sees: particles, edges, contacts.

use bevy::gizmos::config::GizmoConfigGroup;
use bevy::prelude::*;

use super::Interpolate;
use super::pose::{Pose, fraction};
use crate::{Contacts, Particles, SoftBody, StepStart};

/// What to draw. All off by default; the systems of what is off do not run.
#[derive(Resource, Debug, Clone, PartialEq)]
pub struct PolpoGizmos {
    /// Particles, as their ellipsoids.
    pub particles: bool,
    /// Edges, from centre to centre.
    pub edges: bool,
    /// Contacts, as the surface's normal at the point of contact.
    pub contacts: bool,
    /// Colour of the particles.
    pub particle_color: Color,
    /// Colour of the edges.
    pub edge_color: Color,
    /// Colour of the contacts.
    pub contact_color: Color,
    /// Length of a contact's normal \[m\].
    pub contact_length: f32,
}

impl Default for PolpoGizmos {
    fn default() -> Self {
        Self {
            particles: false,
            edges: false,
            contacts: false,
            particle_color: Color::srgb(1.0, 0.7, 0.2),
            edge_color: Color::srgb(0.5, 0.8, 1.0),
            contact_color: Color::srgb(1.0, 0.2, 0.3),
            contact_length: 0.1,
        }
    }
}

/// Line width, depth bias and the rest: configure it in Bevy's `GizmoConfigStore`.
#[derive(Default, Reflect, GizmoConfigGroup)]
pub struct PolpoGizmoGroup;

/// Adds [`PolpoGizmos`]. Needs Bevy's `GizmoPlugin`, which is in `DefaultPlugins` with the feature `bevy_gizmos`, and to be seen `bevy_gizmos_render`.
///
/// Particles and edges are drawn at the same moment between fixed steps as the mesh; contacts are those of the last step.
#[derive(Debug, Clone, Copy, Default)]
pub struct PolpoGizmosPlugin;

impl Plugin for PolpoGizmosPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<PolpoGizmos>().init_gizmo_group::<PolpoGizmoGroup>().add_systems(
            PostUpdate,
            (
                draw_particles.run_if(|gizmos: Res<PolpoGizmos>| gizmos.particles),
                draw_edges.run_if(|gizmos: Res<PolpoGizmos>| gizmos.edges),
                draw_contacts.run_if(|gizmos: Res<PolpoGizmos>| gizmos.contacts),
            ),
        );
    }
}

/// The moment that is drawn.
#[derive(bevy::ecs::system::SystemParam)]
struct Moment<'w> {
    time: Option<Res<'w, Time<Fixed>>>,
    interpolate: Option<Res<'w, Interpolate>>,
}

impl Moment<'_> {
    /// Without the [`PolpoRenderPlugin`](super::PolpoRenderPlugin) there is no mesh to agree with, and the present is drawn.
    fn fraction(&self) -> f32 {
        self.interpolate.as_deref().map_or(1.0, |interpolate| fraction(interpolate, self.time.as_deref()))
    }
}

type Posed<'a> = (&'a SoftBody, &'a Particles, Option<&'a StepStart>, &'a Transform);

fn draw_particles(mut gizmos: Gizmos<PolpoGizmoGroup>, settings: Res<PolpoGizmos>, moment: Moment, bodies: Query<Posed>) {
    for (_, particles, start, transform) in &bodies {
        let pose = Pose::between(particles, start, moment.fraction());
        for (i, (&frame, &radii)) in particles.frame.iter().zip(&particles.radii).enumerate() {
            let (position, rotation) = pose.particle(i);
            let axes = Mat3::from_quat(rotation * frame);
            let [x, y, z] = [axes.x_axis * radii.x, axes.y_axis * radii.y, axes.z_axis * radii.z];
            let center = transform.translation + Vec3::from(position);
            for (u, v) in [(x, y), (y, z), (z, x)] {
                gizmos.lineloop(CIRCLE.map(|[c, s]| center + u * c + v * s), settings.particle_color);
            }
        }
    }
}

fn draw_edges(mut gizmos: Gizmos<PolpoGizmoGroup>, settings: Res<PolpoGizmos>, moment: Moment, bodies: Query<Posed>) {
    for (body, particles, start, transform) in &bodies {
        let pose = Pose::between(particles, start, moment.fraction());
        let end = |i: u32| transform.translation + Vec3::from(pose.particle(i as usize).0);
        for &[i, j] in &body.rig.edges {
            if i.max(j) < particles.len() as u32 {
                gizmos.line(end(i), end(j), settings.edge_color);
            }
        }
    }
}

fn draw_contacts(mut gizmos: Gizmos<PolpoGizmoGroup>, settings: Res<PolpoGizmos>, bodies: Query<(&Contacts, &Transform)>) {
    for (contacts, transform) in &bodies {
        for contact in &contacts.list {
            let point = transform.translation + Vec3::from(contact.point);
            let normal = Vec3::from(contact.normal) * settings.contact_length;
            gizmos.ray(point, normal, settings.contact_color);
        }
    }
}

/// Cosine and sine at every sixteenth of a turn.
const CIRCLE: [[f32; 2]; 16] = {
    const A: f32 = 0.923_879_5;
    const B: f32 = core::f32::consts::FRAC_1_SQRT_2;
    const C: f32 = 0.382_683_43;
    [
        [1.0, 0.0],
        [A, C],
        [B, B],
        [C, A],
        [0.0, 1.0],
        [-C, A],
        [-B, B],
        [-A, C],
        [-1.0, 0.0],
        [-A, -C],
        [-B, -B],
        [-C, -A],
        [0.0, -1.0],
        [C, -A],
        [B, -B],
        [A, -C],
    ]
};
