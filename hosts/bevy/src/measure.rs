//! Whether the pre-pass of a material pays on this device.
//!
//! A pre-pass costs vertices, and saves fragments that something hides. Which is more depends on the
//! scene and on the device, so both are drawn and timed: blocks of frames with the pre-pass and
//! without it, in the order A B B A, so that a slow drift of the clock cancels.

use std::any::TypeId;
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bevy_app::{App, Last};
use bevy_camera::visibility::ViewVisibility;
use bevy_core_pipeline::oit::OrderIndependentTransparencySettings;
use bevy_core_pipeline::prepass::{
    DeferredPrepass, DepthPrepass, DepthPrepassDoubleBuffer, MotionVectorPrepass, NormalPrepass,
};
use bevy_diagnostic::DiagnosticsStore;
use bevy_ecs::prelude::*;
use bevy_log::{info, warn};
use bevy_pbr::decal::ForwardDecal;
use bevy_pbr::{ContactShadows, Material, MeshMaterial3d, PreparedMaterial};
use bevy_platform::time::Instant;
use bevy_render::diagnostic::RenderDiagnosticsPlugin;
use bevy_render::erased_render_asset::ErasedRenderAssets;
use bevy_render::occlusion_culling::OcclusionCulling;
use bevy_render::{Extract, ExtractSchedule, RenderApp};

/// Frames after a switch that are not timed: times arrive some frames late.
const SKIPPED: u32 = 8;
/// Frames of a block that are timed.
const TIMED: usize = 8;
/// Each has four blocks. The lowest and the highest of six ratios enclose the median with a
/// probability of 97 %.
const ROUNDS: usize = 6;
/// With and without, in the order of a round.
const ORDER: [bool; 4] = [true, false, false, true];
/// Frames without a time from the GPU until measuring is given up.
const PATIENCE: u32 = 240;
/// From a decision to the next measurement. It doubles each time, up to the second.
const AGAIN: [Duration; 2] = [Duration::from_secs(10), Duration::from_secs(600)];

/// What became of a material's measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Choice {
    /// It was not measured yet. The pre-pass is drawn.
    Waiting,
    /// The pre-pass pays.
    On(Gain),
    /// The pre-pass does not pay, or not by more than the times vary. It is not drawn.
    Off(Gain),
    /// A view needs the pre-pass for more than depth.
    Needed,
    /// The device gives no times. The pre-pass is drawn.
    NotMeasured,
}

/// Time of the passes of a view without the pre-pass, divided by that with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gain {
    /// Lower end of the interval, of 97 %.
    pub low: f64,
    /// The median.
    pub median: f64,
    /// Upper end of the interval.
    pub high: f64,
}

struct Measured {
    material: &'static str,
    choice: Choice,
    wait: Duration,
    due: Instant,
}

impl Measured {
    fn of(material: &'static str) -> Self {
        Self {
            material,
            choice: Choice::Waiting,
            wait: AGAIN[0],
            due: Instant::now(),
        }
    }
}

struct Run {
    of: TypeId,
    block: usize,
    frames: u32,
    times: Vec<f64>,
    /// Medians of blocks.
    blocks: Vec<f64>,
}

impl Run {
    fn of(of: TypeId) -> Self {
        Self {
            of,
            block: 0,
            frames: 0,
            times: Vec::new(),
            blocks: Vec::new(),
        }
    }
}

/// The measurements: of [`crate::PreshadePlugin::measured`].
#[derive(Resource, Default)]
pub struct Measurements {
    all: HashMap<TypeId, Measured>,
    /// One material at a time.
    run: Option<Run>,
}

impl Measurements {
    /// Each material's name, and what became of its measurement.
    pub fn rows(&self) -> impl Iterator<Item = (&'static str, Choice)> {
        self.all.values().map(|of| (of.material, of.choice))
    }

    /// Measures all materials anew, after the scene has changed, say.
    pub fn restart(&mut self) {
        self.run = None;
        let now = Instant::now();
        for of in self.all.values_mut() {
            (of.wait, of.due) = (AGAIN[0], now);
        }
    }

    fn is_on(&self, of: TypeId) -> bool {
        match &self.run {
            Some(run) if run.of == of => ORDER[run.block % ORDER.len()],
            _ => !matches!(self.all.get(&of).map(|of| of.choice), Some(Choice::Off(_))),
        }
    }

    fn decide(&mut self, of: TypeId, choice: Choice) {
        self.run = None;
        let Some(measured) = self.all.get_mut(&of) else {
            return;
        };
        let was = std::mem::replace(&mut measured.choice, choice);
        measured.due = Instant::now() + measured.wait;
        measured.wait = (measured.wait * 2).min(AGAIN[1]);
        let name = measured.material;
        match choice {
            Choice::On(gain) => info!(
                "preshade: the pre-pass of `{name}` pays: {:.2}x [{:.2}, {:.2}]",
                gain.median, gain.low, gain.high
            ),
            Choice::Off(gain) => info!(
                "preshade: the pre-pass of `{name}` does not pay, and is off: {:.2}x [{:.2}, {:.2}]",
                gain.median, gain.low, gain.high
            ),
            Choice::NotMeasured if was != choice => warn!(
                "preshade: the pre-pass of `{name}` is not measured and stays on: this device gives \
                 no times of its passes"
            ),
            _ => {}
        }
    }

    /// Takes the time of a frame, in milliseconds, if there is one.
    fn take(&mut self, time: Option<f64>) {
        let Some(run) = &mut self.run else { return };
        run.frames += 1;
        if run.frames <= SKIPPED {
            return;
        }
        run.times.extend(time);
        if run.times.is_empty() && run.frames > PATIENCE {
            let of = run.of;
            self.decide(of, Choice::NotMeasured);
            return;
        }
        if run.times.len() < TIMED {
            return;
        }
        run.blocks.push(median(&mut run.times));
        run.times.clear();
        (run.block, run.frames) = (run.block + 1, 0);
        if run.blocks.len() < ROUNDS * ORDER.len() {
            return;
        }
        let (of, gain) = (run.of, Gain::of(&run.blocks));
        let choice = match gain.low > 1.0 {
            true => Choice::On(gain),
            false => Choice::Off(gain),
        };
        self.decide(of, choice);
    }
}

impl Gain {
    /// Of the blocks of all rounds.
    fn of(blocks: &[f64]) -> Self {
        let ratio = |round: &[f64]| {
            let sum = |on: bool| -> f64 {
                let pairs = round.iter().zip(ORDER);
                pairs
                    .filter(|(_, is_on)| *is_on == on)
                    .map(|(t, _)| t)
                    .sum()
            };
            sum(false) / sum(true)
        };
        let mut ratios: Vec<f64> = blocks.chunks_exact(ORDER.len()).map(ratio).collect();
        let median = median(&mut ratios);
        Self {
            low: ratios.first().copied().unwrap_or(1.0),
            median,
            high: ratios.last().copied().unwrap_or(1.0),
        }
    }
}

/// Sorts, and returns the middle.
fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() % 2 {
        _ if values.is_empty() => f64::NAN,
        0 => f64::midpoint(values[middle - 1], values[middle]),
        _ => values[middle],
    }
}

/// Whether all shaders are derived and all pipelines are made. The render world tells the main world.
#[derive(Resource, Clone, Default)]
pub struct Quiet(pub Arc<AtomicBool>);

/// Which materials have a pre-pass, in the render world.
#[derive(Resource, Default)]
pub struct Enabled(HashMap<TypeId, bool>);

/// Adds the measurement of a material.
pub fn add<M: Material>(app: &mut App, quiet: &Quiet) {
    if !app.world().contains_resource::<Measurements>() {
        if !app.is_plugin_added::<RenderDiagnosticsPlugin>() {
            app.add_plugins(RenderDiagnosticsPlugin);
        }
        app.init_resource::<Measurements>()
            .insert_resource(quiet.clone())
            .add_systems(Last, time);
        if let Some(render) = app.get_sub_app_mut(RenderApp) {
            render
                .init_resource::<Enabled>()
                .add_systems(ExtractSchedule, extract);
        }
    }
    let material = crate::specialize::short(std::any::type_name::<M>());
    app.world_mut()
        .resource_mut::<Measurements>()
        .all
        .insert(TypeId::of::<M>(), Measured::of(material));
    app.add_systems(Last, start::<M>.before(time));
}

/// A view whose picture of depths more than the main pass's depth test reads, or a thing that reads it.
type Needs = Or<(
    With<NormalPrepass>,
    With<MotionVectorPrepass>,
    With<DeferredPrepass>,
    With<DepthPrepassDoubleBuffer>,
    With<OcclusionCulling>,
    With<ContactShadows>,
    With<OrderIndependentTransparencySettings>,
    With<ForwardDecal>,
)>;

/// Starts the measurement of a material that is due and seen.
fn start<M: Material>(
    mut measurements: ResMut<Measurements>,
    quiet: Res<Quiet>,
    needs: Query<(), Needs>,
    views: Query<(), With<DepthPrepass>>,
    mut had: Local<usize>,
    seen: Query<&ViewVisibility, With<MeshMaterial3d<M>>>,
) {
    let of = TypeId::of::<M>();
    let Some(measured) = measurements.all.get(&of) else {
        return;
    };
    let is_needed = !needs.is_empty();
    if is_needed != (measured.choice == Choice::Needed) {
        let choice = match is_needed {
            true => Choice::Needed,
            false => Choice::Waiting,
        };
        measurements.decide(of, choice);
        measurements.restart();
        return;
    }
    let has = views.iter().count();
    if std::mem::replace(&mut *had, has) != has {
        measurements.restart();
        return;
    }
    let is_due = has > 0 && !is_needed && measured.due <= Instant::now();
    let is_free = measurements.run.is_none() && quiet.0.load(Ordering::Relaxed);
    if is_due && is_free && seen.iter().any(|seen| seen.get()) {
        measurements.run = Some(Run::of(of));
    }
}

fn time(
    mut measurements: ResMut<Measurements>,
    store: Res<DiagnosticsStore>,
    mut last: Local<Option<Instant>>,
) {
    if measurements.run.is_none() {
        return;
    }
    let passes = || {
        store.iter().filter(|of| {
            let path = of.path().as_str();
            // Those inside of another are part of its time.
            path.starts_with("render/")
                && path.ends_with("/elapsed_gpu")
                && path.split('/').count() == 3
        })
    };
    // Those of one frame have one time. A pass that is not drawn keeps its old one.
    let newest = passes()
        .filter_map(|of| of.measurement())
        .map(|m| m.time)
        .max();
    let is_new = newest.is_some() && newest != *last;
    *last = newest;
    let sum = passes()
        .flat_map(|of| of.measurements())
        .filter(|m| Some(m.time) == newest)
        .map(|m| m.value)
        .sum();
    measurements.take(is_new.then_some(sum));
}

fn extract(measurements: Extract<Res<Measurements>>, mut enabled: ResMut<Enabled>) {
    let all = measurements.all.keys();
    enabled.0.clear();
    enabled
        .0
        .extend(all.map(|of| (*of, measurements.is_on(*of))));
}

/// Turns the pre-pass of a material's objects on or off. Returns which; `None`: it is not measured.
pub fn switch<M: Material>(
    materials: &mut ErasedRenderAssets<PreparedMaterial>,
    enabled: &Enabled,
) -> Option<bool> {
    let own = TypeId::of::<M>();
    let is_on = enabled.0.get(&own).copied()? && M::enable_prepass();
    for (id, material) in materials.iter_mut() {
        if id.type_id() == own && material.properties.prepass_enabled != is_on {
            let mut properties = crate::copied(&material.properties);
            properties.prepass_enabled = is_on;
            material.properties = Arc::new(properties);
        }
    }
    Some(is_on)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waiting() -> (Measurements, TypeId) {
        let mut measurements = Measurements::default();
        let of = TypeId::of::<()>();
        measurements.all.insert(of, Measured::of("M"));
        (measurements, of)
    }

    /// The clock becomes slower by a tenth from block to block.
    #[test]
    fn drift_cancels() {
        let blocks = (0..24_u32).map(|i| {
            let time = if ORDER[i as usize % 4] { 2.0 } else { 3.0 };
            time * (1.0 + f64::from(i) * 0.1)
        });
        let gain = Gain::of(&blocks.collect::<Vec<_>>());
        assert!((gain.low - 1.5).abs() < 1e-9, "{gain:?}");
        assert!((gain.high - 1.5).abs() < 1e-9, "{gain:?}");
    }

    #[test]
    fn a_gain_within_the_noise_is_none() {
        let (mut measurements, of) = waiting();
        for (noise, is_on) in [(0.5, false), (0.0, true)] {
            measurements.run = Some(Run::of(of));
            let mut frame = 0_u32;
            while let Some(run) = &measurements.run {
                let time = if ORDER[run.block % 4] { 2.0 } else { 2.1 };
                // Each round has another time without.
                let is_odd = (run.block / 4) % 2 == 1;
                let off = if is_odd && run.block % 4 == 1 {
                    noise
                } else {
                    0.0
                };
                measurements.take(Some(time - off));
                frame += 1;
            }
            assert_eq!(frame, 24 * (SKIPPED + TIMED as u32));
            let choice = measurements.all[&of].choice;
            assert_eq!(matches!(choice, Choice::On(_)), is_on, "{choice:?}");
            assert_eq!(measurements.is_on(of), is_on);
        }
    }

    #[test]
    fn without_times_the_prepass_stays() {
        let (mut measurements, of) = waiting();
        measurements.run = Some(Run::of(of));
        for _ in 0..=PATIENCE {
            measurements.take(None);
        }
        assert_eq!(measurements.all[&of].choice, Choice::NotMeasured);
        assert!(measurements.is_on(of));
    }
}
