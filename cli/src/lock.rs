//! `preshade plan --lock`: writes a decision to `preshade.lock` in the folder of each material's
//! shader, for builds without a GPU.

use std::collections::BTreeMap;
use std::path::PathBuf;

use preshade_compiler::front::Parsed;
use preshade_compiler::lock::{FILE_NAME, Inputs, Lock, LockError, Locked, Measured};
use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::{Material, Scene};
use preshade_lab::search::plan::Decision;
use preshade_plan::pass::Facts;

use crate::{Failure, output};

/// The lock files in the folders of a scene's shaders, as read before anything is measured.
#[derive(Debug, Default)]
pub struct Locks(BTreeMap<PathBuf, Lock>);

impl Locks {
    /// Reads them. A file of another version is reported and will be replaced.
    ///
    /// # Errors
    /// A file cannot be read, or is not a lock file, so that it must not be overwritten.
    pub fn read(scene: &Scene) -> Result<Self, Failure> {
        let mut locks = BTreeMap::new();
        for path in scene.materials.iter().filter_map(beside) {
            if locks.contains_key(&path) {
                continue;
            }
            let lock = match Lock::read(&path) {
                Ok(lock) => lock.unwrap_or_default(),
                Err(foreign @ LockError::Foreign { .. }) => {
                    output::message(&format!(
                        "note: {foreign}; it is written anew, with what is chosen now alone"
                    ));
                    Lock::default()
                }
                Err(error) => {
                    return Err(Failure(format!(
                        "error: {error}\nhelp: mend it, or remove it to have it written anew"
                    )));
                }
            };
            locks.insert(path, lock);
        }
        Ok(Self(locks))
    }
}

/// Writes the first plan of `decision`, and reports changed files. A material that cannot be locked
/// is reported; the others are written.
pub fn keep(
    scene: &Scene,
    facts: &Facts,
    decision: &Decision,
    Locks(mut locks): Locks,
) -> Result<(), Failure> {
    for (index, material) in scene.materials.iter().enumerate() {
        let is_seen = is_seen(decision, index);
        if !is_seen {
            output::message(&format!(
                "note: no camera sees `{}`: it is left as written",
                material.name
            ));
        }
        let Some(path) = beside(material) else {
            output::message(&format!(
                "note: `{}` is no material of a scene file, so nothing is kept of it",
                material.name
            ));
            continue;
        };
        match locked(material, facts, decision, is_seen) {
            Ok(locked) => {
                let lock = locks.entry(path).or_default();
                lock.materials.insert(material.name.clone(), locked);
            }
            Err(Failure(why)) => output::message(&format!(
                "warning: the choice for `{}` is not kept: {why}",
                material.name
            )),
        }
    }
    let mut failed = Vec::new();
    for (path, lock) in &locks {
        let is_new = !path.exists();
        match lock.write(path) {
            Ok(true) => output::message(&format!("wrote {}", path.display())),
            Ok(false) => output::message(&format!("{} is up to date", path.display())),
            // The other files are still written.
            Err(error) => {
                failed.push(format!("error: {error}"));
                continue;
            }
        }
        if is_new {
            output::message(
                "note: cargo does not look for files that were not there: touch the build script \
                 once",
            );
        }
    }
    match failed.is_empty() {
        true => Ok(()),
        false => Err(Failure(failed.join("\n"))),
    }
}

/// The lock file in the folder of a material's first file.
fn beside(material: &Material) -> Option<PathBuf> {
    Some(material.file.as_ref()?.with_file_name(FILE_NAME))
}

/// Whether any view shows the material. If none does, the measurements are no evidence about it.
fn is_seen(decision: &Decision, material: usize) -> bool {
    let mut views = decision.views.iter();
    views.any(|v| v.materials.get(material).is_none_or(|m| m.rasterised > 0.0))
}

fn locked(
    material: &Material,
    facts: &Facts,
    decision: &Decision,
    is_seen: bool,
) -> Result<Locked, Failure> {
    let plan = decision.drawn().first().copied().unwrap_or_default();
    let chosen = decision.plans.get(plan);
    let recipe = chosen.and_then(|p| p.recipes.get(&material.name));
    let recipe = recipe.filter(|_| is_seen);
    let recipe = recipe.map_or(Ok(Recipe::default()), |r| Recipe::parse_list(r))?;
    let parsed = Parsed {
        program: material.program.clone(),
        vertex: material.vertex.clone(),
        fragment: material.fragment.clone(),
    };
    let defines: Vec<(String, String)> = material.defines.clone().into_iter().collect();
    let inputs = Inputs::of(&parsed, &defines, &material.state);
    let measured = measured(decision, plan).filter(|_| is_seen);
    Ok(Locked::resolve(
        &material.plan(),
        &recipe,
        facts,
        inputs,
        measured,
    )?)
}

/// The measurements of a plan in the first view. `None`: nothing was timed.
fn measured(decision: &Decision, plan: usize) -> Option<Measured> {
    let of = |plan: usize| decision.plans.get(plan)?.by_view.first();
    let (original, variant) = (of(0)?.time_ms.as_ref()?, of(plan)?);
    let speedup = variant.speedup.as_ref();
    Some(Measured {
        scene: decision.scene.clone(),
        resolution: decision.resolution,
        adapter: decision.adapter.title(),
        driver: decision.adapter.driver.clone(),
        verdict: decision.plans.get(plan)?.verdict.clone(),
        original_ms: original.median,
        variant_ms: variant.time_ms.as_ref()?.median,
        speedup: speedup.map_or([1.0; 3], |s| [s.low, s.median, s.high]),
    })
}
