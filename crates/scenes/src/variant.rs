//! Makes variants for the renderer: emits plans, and analyses their programs for the driver.

use preshade_compiler::emit::{self, partial_pointers};
use preshade_compiler::front;
use preshade_draw::render::shader::{PlannedMaterial, Shaders};
use preshade_draw::render::{Error, SceneInputs, SelfTestPlan, SelfTestResult, Variant};
use preshade_passes::analysis::checks;
use preshade_passes::rebuild::bounded;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::safety::Checks;
use shader_text::files::File;

/// The form in which shaders reach the driver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ShaderForm {
    /// The emitted WGSL, as shipped to users.
    #[default]
    Text,
    /// The IR, through wgpu's `naga-ir`.
    Ir,
}

/// Sends `plans` through JSON and their programs through `form`.
///
/// # Errors
/// [`Error::Plan`] if a plan cannot be emitted or changes in JSON (bugs in preshade),
/// [`Error::Frame`] if the plans do not fit into one frame.
pub fn variant(plans: &[Plan], form: ShaderForm) -> Result<Variant, Error> {
    let materials = plans.iter().map(|plan| material(plan, form));
    Variant::new(materials.collect::<Result<_, _>>()?, bounded::bounded)
}

fn material(plan: &Plan, form: ShaderForm) -> Result<PlannedMaterial<'_>, Error> {
    let failed = |message: String| Error::Plan {
        material: plan.material.clone(),
        message,
    };
    let mut programs = plan.programs.values();
    if let Some(message) = programs.find_map(partial_pointers::find) {
        return Err(failed(message));
    }
    let shaders = match form {
        ShaderForm::Text => {
            // The fallback is not drawn, so its files are not needed.
            let drawn = Plan {
                original: None,
                ..plan.clone()
            };
            let files = emit::emit(&drawn, &[Target::Wgsl], &emit::Options::default());
            Shaders::Emitted(for_naga(files.map_err(|e| failed(e.to_string()))?))
        }
        ShaderForm::Ir => Shaders::Ir,
    };
    let author = plan.original.as_deref().unwrap_or(plan);
    let needed = author.programs.values().map(checks::needed);
    let mut programs = plan.programs.values();
    Ok(PlannedMaterial {
        plan,
        shaders,
        needed: needed.fold(Checks::default(), Checks::or),
        is_open: programs.any(|program| bounded::is_open(program, &|_| false)),
    })
}

/// Reads the files that [`emit::emit`] wrote for each material, with WGSL among the targets.
///
/// # Errors
/// As [`Variant::from_files`].
pub fn from_files(materials: &[Vec<File>]) -> Result<Variant, Error> {
    let materials = materials.iter().cloned().map(for_naga);
    Variant::from_files(materials.collect())
}

/// WGSL files as naga reads them.
fn for_naga(mut files: Vec<File>) -> Vec<File> {
    for file in &mut files {
        if !file.name.ends_with(".json")
            && let Ok(text) = std::str::from_utf8(&file.bytes)
        {
            file.bytes = front::for_naga(text).into_bytes();
        }
    }
    files
}

/// Runs the self-test of `plan` on its material's draws. `None` if the plan has no self-test.
///
/// # Errors
/// As [`variant`], [`SelfTestPlan::of`] and [`SelfTestPlan::run`].
pub fn self_test(
    inputs: &SceneInputs<'_>,
    plan: &Plan,
    form: ShaderForm,
) -> Result<Option<SelfTestResult>, Error> {
    let Some(test) = SelfTestPlan::of(plan)? else {
        return Ok(None);
    };
    let drawn = variant(std::slice::from_ref(&test.plan), form)?;
    test.run(inputs, drawn).map(Some)
}
