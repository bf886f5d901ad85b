//! A scene verified: everything that `preshade verify` and a program that calls [`verify`] do alike.

use crate::measure::record::{Chosen, Report};
use crate::measure::{
    self, Error, Session, Settings, Timed, TimingSettings, Variant, Verified, VerifyProgress,
};
use preshade_compiler::parameters::parameters;
use preshade_compiler::recipe::Recipe;
use preshade_draw::render::Gpu;
use preshade_draw::scene::Scene;
use preshade_geometry::pass_named;
use preshade_plan::budget::{Budget, Metric};
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_scenes::ShaderForm;

/// Variants to verify, and how.
#[derive(Clone, Debug)]
pub struct Request {
    pub recipes: Vec<Recipe>,
    /// Steps that a material refuses without a budget get this one, and the fastest variant within it is chosen.
    pub budget: Option<Budget>,
    /// The form in which shaders reach the driver.
    pub form: ShaderForm,
    pub settings: Settings,
}

/// News that a caller may print on the way.
#[derive(Clone, Debug)]
pub enum News {
    Progress(VerifyProgress),
    /// A message, for the user.
    Note(String),
}

/// The result, and the variants with their plans.
#[derive(Clone, Debug)]
pub struct Answer {
    pub verified: Verified,
    /// Empty if other processes drew them.
    pub variants: Vec<Variant>,
}

/// The scene with a material of its own for each draw that needs its own version, if a recipe
/// specialises.
///
/// # Errors
/// A recipe names something that no material has.
pub fn grouped(scene: Scene, recipes: &[Recipe]) -> Result<Scene, Error> {
    let steps = recipes.iter().flat_map(|r| r.steps.clone());
    let all = Recipe {
        steps: steps.collect(),
    };
    all.check_names(&measure::originals(&scene))?;
    Ok(measure::grouped_for(scene, &all)?)
}

/// Draws every view of a [`grouped`] scene with the original and with each variant. Measurement makes the choices
/// that recipes leave to it.
///
/// # Errors
/// The original cannot be drawn.
pub fn request(
    gpu: &Gpu,
    scene: &Scene,
    request: &Request,
    tell: &mut dyn FnMut(News),
) -> Result<Answer, Error> {
    let session = Session::new(gpu, scene, request.form)?;
    let originals = session.originals();
    let mut facts = measure::facts(&session).unwrap_or_else(|e| {
        let why = e.reason();
        tell(News::Note(format!(
            "warning: depth ties were not measured: {why}"
        )));
        Facts::default()
    });
    let recipes = request.recipes.iter().cloned();
    let recipes = recipes.map(|recipe| match request.budget {
        None => recipe,
        Some(budget) => budgeted(recipe, originals, &facts, budget),
    });
    let recipes = recipes.collect();
    let settled = measure::settled(&session, recipes, &mut facts, &mut |done, what| {
        tell(News::Progress(VerifyProgress::at(done, what)));
    })?;
    let each = settled.iter();
    let variants: Vec<Variant> = each.map(|s| s.variant(originals, &facts)).collect();
    for (settled, variant) in settled.iter().zip(&variants) {
        let note = settled.note(variant, &facts);
        note.into_iter().for_each(|note| tell(News::Note(note)));
    }
    let mut verified = measure::verify(&session, &variants, &request.settings, &mut |p| {
        tell(News::Progress(p));
    })?;
    verified.report.chosen = request.budget.map(|budget| {
        Chosen::among(&verified.report.variants, budget).made_by(|name| {
            let drawn = variants.iter().position(|v| v.name == name)?;
            let made = settled[drawn].chosen.as_ref();
            measure::promised(made.unwrap_or(&settled[drawn].asked), budget, &facts)
        })
    });
    Ok(Answer { verified, variants })
}

/// Gives the budget to each step that a material refuses without one.
fn budgeted(recipe: Recipe, originals: &[Plan], facts: &Facts, budget: Budget) -> Recipe {
    let refusals = |recipe: &Recipe| measure::variant(originals, recipe, facts).kept.len();
    let mut recipe = recipe;
    for i in 0..recipe.steps.len() {
        let step = &recipe.steps[i];
        let taken = pass_named(&step.pass).map_or(Vec::new(), parameters);
        let takes = |name: &str| taken.iter().any(|p| p.name == name);
        let is_its_metric = takes("metric") || budget.metric == Metric::FlipMean;
        if !takes("budget") || !is_its_metric || step.params.contains_key("budget") {
            continue;
        }
        let mut within = recipe.clone();
        let params = &mut within.steps[i].params;
        params.insert("budget".to_owned(), budget.limit.into());
        if takes("metric") {
            params.insert("metric".to_owned(), budget.metric.to_string().into());
        }
        if refusals(&within) < refusals(&recipe) {
            recipe = within;
        }
    }
    recipe
}

/// Draws every view of `scene` with the original and with one variant for each recipe. Compares all
/// pixels, and times the first camera. The original is the report's first variant.
///
/// # Errors
/// The original cannot be drawn. A variant that cannot be drawn is reported as not measured.
pub fn verify(gpu: &Gpu, scene: &Scene, recipes: &[Recipe]) -> Result<Report, Error> {
    let asked = Request {
        recipes: recipes.to_vec(),
        budget: None,
        form: ShaderForm::Text,
        settings: Settings {
            timed: Timed::Headline,
            timing: TimingSettings::default(),
            frames_per_camera: 8,
            command: String::new(),
        },
    };
    let scene = grouped(scene.clone(), recipes)?;
    let answer = request(gpu, &scene, &asked, &mut |_| ())?;
    Ok(answer.verified.report)
}
