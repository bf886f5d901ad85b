//! [`verify`] with default settings, for programs.

use crate::measure::record::Report;
use crate::measure::{self, Error, Session, Settings, Timed, TimingSettings};
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::Gpu;
use preshade_draw::scene::Scene;
use preshade_scenes::ShaderForm;

/// Draws every view of `scene` with the original and with one variant for each recipe. Compares all
/// pixels, and times the first camera. The original is the report's first variant.
///
/// # Errors
/// The original cannot be drawn. A variant that cannot be drawn is reported as not measured.
pub fn verify(gpu: &Gpu, scene: &Scene, recipes: &[Recipe]) -> Result<Report, Error> {
    let session = Session::new(gpu, scene, ShaderForm::Text)?;
    let facts = measure::facts(&session)?;
    let variant = |recipe| measure::variant(session.originals(), recipe, &facts);
    let variants: Vec<_> = recipes.iter().map(variant).collect();
    let settings = Settings {
        timed: Timed::Headline,
        timing: TimingSettings::default(),
        frames_per_camera: 8,
        command: String::new(),
    };
    measure::verify(&session, &variants, &settings, &mut |_| ()).map(|outcome| outcome.report)
}
