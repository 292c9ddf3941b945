//! What stands on the picture: figures and keys.

use bevy::diagnostic::{DiagnosticsStore, FrameTimeDiagnosticsPlugin};
use bevy::prelude::*;
use polpo::render::{PolpoGizmos, SKIN_GPU_TIME, SkinningStats};
use polpo::{Particles, SoftBody, SolverSettings, StepTimings};

/// The overlay of a window: figures at the top, keys at the bottom.
pub(crate) struct OverlayPlugin;

/// One line at the bottom of a picture taken without a window: what is seen.
pub(crate) struct CaptionPlugin;

/// Whether the figures are shown.
#[derive(Resource, Default)]
pub(crate) struct ShowTimings(pub(crate) bool);

#[derive(Component)]
struct Figures;

const KEYS: &str = "drag an octopus: pull   drag beside it: orbit   right drag: pan   wheel: zoom   space: pause   N: one step   1 particles   2 edges   3 contacts   T figures";

impl Plugin for OverlayPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(ShowTimings(true))
            .add_plugins(FrameTimeDiagnosticsPlugin::default())
            .add_systems(Startup, |mut commands: Commands| {
                panel(&mut commands, Val::Px(10.0), Val::Auto, 15.0, Figures);
                let keys = panel(&mut commands, Val::Auto, Val::Px(10.0), 13.0, ());
                commands.entity(keys).insert(Text::new(KEYS));
            })
            .add_systems(Update, write_figures);
    }
}

impl Plugin for CaptionPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(Startup, |mut commands: Commands| {
            panel(&mut commands, Val::Auto, Val::Px(10.0), 15.0, Figures);
        })
        .add_systems(Update, write_caption);
    }
}

fn panel(commands: &mut Commands, top: Val, bottom: Val, size: f32, marker: impl Bundle) -> Entity {
    commands
        .spawn((
            marker,
            Text::default(),
            TextFont { font_size: FontSize::Px(size), ..default() },
            TextColor(Color::WHITE),
            Node {
                position_type: PositionType::Absolute,
                left: Val::Px(10.0),
                top,
                bottom,
                padding: UiRect::axes(Val::Px(9.0), Val::Px(6.0)),
                border_radius: BorderRadius::all(Val::Px(5.0)),
                ..default()
            },
            BackgroundColor(Color::srgba(0.05, 0.07, 0.10, 0.62)),
        ))
        .id()
}

fn counts(bodies: &Query<(&SoftBody, &Particles)>) -> (usize, usize, usize) {
    bodies.iter().fold((0, 0, 0), |(b, p, e), (body, particles)| (b + 1, p + particles.len(), e + body.rig.edges.len()))
}

#[expect(clippy::too_many_arguments, reason = "the overlay shows what stands in as many places")]
fn write_figures(
    show: Res<ShowTimings>,
    timings: Res<StepTimings>,
    settings: Res<SolverSettings>,
    skinning: Res<SkinningStats>,
    diagnostics: Res<DiagnosticsStore>,
    time: Res<Time<Virtual>>,
    gizmos: Option<Res<PolpoGizmos>>,
    bodies: Query<(&SoftBody, &Particles)>,
    mut panel: Single<(&mut Text, &mut Visibility), With<Figures>>,
    mut smooth: Local<Vec<f32>>,
) {
    let (text, visibility) = &mut *panel;
    **visibility = if show.0 { Visibility::Visible } else { Visibility::Hidden };
    if !show.0 {
        return;
    }
    let fresh: Vec<f32> =
        std::iter::once(timings.total()).chain(timings.phases().map(|(_, spent)| spent)).map(|d| 1000.0 * d.as_secs_f32()).collect();
    smooth.resize(fresh.len(), 0.0);
    for (mean, now) in smooth.iter_mut().zip(fresh) {
        *mean += 0.05 * (now - *mean);
    }
    let fps = diagnostics.get(&FrameTimeDiagnosticsPlugin::FPS).and_then(|d| d.smoothed()).unwrap_or(0.0);
    let skin = if skinning.on_cpu {
        Some(1000.0 * skinning.cpu_skin_time.as_secs_f64())
    } else {
        diagnostics.get(&SKIN_GPU_TIME).and_then(|d| d.smoothed())
    };
    let (count, particles, edges) = counts(&bodies);
    let mut lines = format!(
        "{count} bodies   {particles} particles   {edges} edges   {fps:.0} fps{}\nstep {:.2} ms ({} substeps, {} iterations)",
        if time.is_paused() { "   PAUSED" } else { "" },
        smooth[0],
        settings.substeps,
        settings.iterations
    );
    for ((name, _), ms) in timings.phases().zip(&smooth[1..]) {
        lines += &format!("\n  {:<18} {ms:.3} ms", name.replace('_', " "));
    }
    if let Some(ms) = skin {
        lines += &format!("\nskinning {ms:.2} ms on the {}", if skinning.on_cpu { "CPU" } else { "GPU" });
    }
    if let Some(gizmos) = gizmos {
        let shown: Vec<&str> = [(gizmos.particles, "particles"), (gizmos.edges, "edges"), (gizmos.contacts, "contacts")]
            .into_iter()
            .filter_map(|(on, name)| on.then_some(name))
            .collect();
        if !shown.is_empty() {
            lines += &format!("\nshowing {}", shown.join(", "));
        }
    }
    text.0 = lines;
}

fn write_caption(time: Res<Time<Virtual>>, bodies: Query<(&SoftBody, &Particles)>, mut text: Single<&mut Text, With<Figures>>) {
    let (count, particles, edges) = counts(&bodies);
    text.0 = format!("Polpo   {count} bodies   {particles} particles   {edges} edges   {:.2} s", time.elapsed_secs());
}
