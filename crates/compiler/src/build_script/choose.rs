//! Chooses the plans that a material is built as: the lock's, or the requested ones that need no
//! scene.

use std::path::PathBuf;

use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::pass::{Facts, Refusal};
use preshade_plan::plan::Plan;

use super::emitted::EmittedPlan;
use super::stamp::Trace;
use super::{Asked, BuildConfig, BuildError};
use crate::lock::{Inputs, Left, Lock, LockError, Locked, Mismatch};
use crate::pipeline::{self, Applied, Frame};
use crate::recipe::{Recipe, Step};
use crate::{emit, front};
use preshade_plan::plan_file::Target;
use shader_text::files::File;
use shader_text::options;

/// The default variants, which need no scene.
pub(super) const BY_DEFAULT: [(&str, &str); 3] = [
    ("depth_prepass", "depth-prepass:form=biased"),
    ("early_discard", "early-discard:quad=vote"),
    ("shadow", "shadow"),
];

/// A lock file, as far as it can be read.
pub(super) enum Keeping {
    Nothing,
    /// This version of preshade wrote it.
    Own(Lock),
    /// Another version's. Only entry points and pipeline state are used, if they can be read.
    Foreign(LockError, Option<Left>),
}

/// Chooses the plans of a material: the original, its own variant, then those with names of their
/// own.
pub(super) fn choose(
    builder: &BuildConfig,
    name: &str,
    sources: &[front::Source],
    keeping: &Keeping,
    trace: &mut Trace,
) -> Result<Vec<EmittedPlan>, BuildError> {
    let Asked {
        own,
        named,
        is_default,
    } = builder.recipes()?;
    let lock = match keeping {
        Keeping::Own(lock) => Some(lock),
        Keeping::Nothing | Keeping::Foreign(..) => None,
    };
    let locked = lock.and_then(|lock| lock.materials.get(name));
    // Pipeline state and entry points hold even if the shader was edited, or another version wrote
    // the lock.
    let left = match (keeping, locked) {
        (Keeping::Foreign(_, left), _) => left.clone(),
        (_, locked) => locked.map(|Locked { inputs, .. }| Left {
            vertex: Some(inputs.vertex.clone()),
            fragment: inputs.fragment.clone(),
            state: Some(inputs.state.clone()),
        }),
    };
    let state = match (&builder.state, &left, keeping) {
        (Some(state), ..) => state.clone(),
        (None, Some(Left { state: None, .. }), Keeping::Foreign(error, _)) => {
            return Err(BuildError::State(error.to_string()));
        }
        (None, left, _) => left
            .as_ref()
            .and_then(|l| l.state.clone())
            .unwrap_or_default(),
    };
    let parsed = parse(sources, &builder.options, left.as_ref())?;
    let inputs = Inputs::of(&parsed, &builder.options.defines, &state);
    let map = parsed.program.sources();
    let included = map.files().iter().skip(sources.len());
    let included = included.map(|f| (PathBuf::from(&f.name), f.text.clone()));
    trace.included.extend(included);
    trace.absent.extend(map.absent().iter().map(PathBuf::from));
    trace.searched.extend_from_slice(map.searched());
    let warnings = &mut trace.warnings;
    let original = parsed.plan(name, &state);

    let checked = lock.map(|lock| lock.check(name, &inputs));
    // Facts about the scene hold for all variants of the same shader.
    let facts = match &checked {
        Some(Ok(locked)) => locked.facts.clone(),
        _ => Facts::default(),
    };
    let obeyed = checked.map(|locked| locked?.apply(&original));
    let seen = BuildInputs {
        facts: &facts,
        sources,
    };
    let variant = match (keeping, obeyed) {
        (Keeping::Foreign(error, _), _) => {
            let why = format!(
                "[{}] {error}; run `preshade plan SCENE --one --lock` again",
                error.code()
            );
            warnings.push(warning(sources, &format!("{why}. The original is shipped")));
            (original.clone(), vec![why])
        }
        (_, Some(Ok(plan))) => (plan, Vec::new()),
        // There is no lock, or it is for other materials.
        (_, None | Some(Err(Mismatch::NoMaterial { .. }))) => {
            let others = lock.map(|lock| lock.same_files(name, &inputs));
            if let Some([first, ..]) = others.as_deref() {
                let why = format!(
                    "preshade.lock says nothing of `{name}`, but of `{first}`, which is of the \
                     same file: to obey it say `.name(\"{first}\")`"
                );
                warnings.push(warning(sources, &why));
            }
            seen.plan(&original, "variant", &own.unwrap_or_default(), warnings)
        }
        (_, Some(Err(mismatch))) => {
            let measured = locked.and_then(|l| l.measured.as_ref());
            let scene = measured.map_or(String::new(), |m| {
                format!(" (it was measured on the scene `{}`)", m.scene)
            });
            let why = format!(
                "[{}] {mismatch}; run `preshade plan SCENE --one --lock` again{scene}",
                mismatch.code()
            );
            warnings.push(warning(sources, &format!("{why}. The original is shipped")));
            (original.clone(), vec![why])
        }
    };
    let mut plans = vec![
        ("original".to_owned(), (original.clone(), Vec::new())),
        ("variant".to_owned(), variant),
    ];
    for (name, recipe) in named {
        // Refusals of default variants appear only in `LEFT_OUT`.
        let mut unasked = Vec::new();
        let warnings = match is_default {
            true => &mut unasked,
            false => &mut *warnings,
        };
        let plan = seen.plan(&original, &name, &recipe, warnings);
        plans.push((name, plan));
    }
    made(builder, plans, sources, warnings)
}

/// Emits the plans; the original is the first. A variant that cannot be emitted is reported and
/// replaced by the original.
pub(super) fn made(
    builder: &BuildConfig,
    plans: Vec<(String, (Plan, Vec<String>))>,
    sources: &[front::Source],
    warnings: &mut Vec<String>,
) -> Result<Vec<EmittedPlan>, BuildError> {
    let mut all: Vec<EmittedPlan> = Vec::new();
    for (name, (plan, left_out)) in plans {
        let made = emitted(builder, &name, &plan, sources, warnings);
        let drawn = match (made, all.first()) {
            (Ok(files), _) => EmittedPlan {
                name,
                plan,
                files,
                left_out,
            },
            (Err(error), None) => return Err(error),
            // Only a failure of the original fails the build.
            (Err(error), Some(original)) => {
                let mut drawn = EmittedPlan {
                    name,
                    left_out,
                    ..original.clone()
                };
                give_up(&mut drawn, original, &error.to_string(), sources, warnings);
                drawn
            }
        };
        all.push(drawn);
    }
    Ok(all)
}

/// Replaces a variant that cannot be made by the original, with a warning.
pub(super) fn give_up(
    variant: &mut EmittedPlan,
    original: &EmittedPlan,
    why: &str,
    sources: &[front::Source],
    warnings: &mut Vec<String>,
) {
    let text = format!(
        "`{}` cannot be made: {why}. The original is shipped",
        variant.name
    );
    warnings.push(warning(sources, &text));
    variant.give_up(original, why.to_owned());
}

/// Parses the shader with the requested entry points, or with the lock's if the shader still has
/// them.
fn parse(
    sources: &[front::Source],
    options: &options::Options,
    left: Option<&Left>,
) -> Result<front::Parsed, BuildError> {
    if let Some(left) = left {
        let as_locked = options::Options {
            vertex: options.vertex.clone().or(left.vertex.clone()),
            fragment: options.fragment.clone().or(left.fragment.clone()),
            ..options.clone()
        };
        if let Ok(parsed) = front::parse(sources, &as_locked) {
            return Ok(parsed);
        }
    }
    front::parse(sources, options).map_err(BuildError::Shader)
}

/// The inputs of a build.
struct BuildInputs<'s> {
    /// Facts about the scene, from a lock that matches.
    facts: &'s Facts,
    sources: &'s [front::Source],
}

impl BuildInputs<'_> {
    /// Applies the steps of `recipe` that the known facts suffice for. Returns the reasons of the
    /// skipped steps too. `name` is the variant's.
    fn plan(
        &self,
        original: &Plan,
        name: &str,
        recipe: &Recipe,
        warnings: &mut Vec<String>,
    ) -> (Plan, Vec<String>) {
        let mut left_out: Vec<String> = Vec::new();
        let mut inspect = |step: &Step, _: &Plan, result: &Applied| {
            let after = match left_out.is_empty() {
                true => "",
                false => " (what was to come before it is left out)",
            };
            let (told, why) = match result {
                Err(refusal) => {
                    let of = format!("in `{name}`: ");
                    let told = refused(self.sources, refusal, &of, after);
                    (told, refusal.to_string())
                }
                Ok(next) => match self.needs_scene(step, name, &next.contract) {
                    None => return true,
                    Some(why) => (warning(self.sources, &why), why),
                },
            };
            warnings.push(told);
            left_out.push(why);
            false
        };
        let alone = std::slice::from_ref(original);
        let frame = Frame {
            materials: alone,
            neighbours: alone,
        };
        let (mut plans, _) = pipeline::apply_in(frame, recipe, self.facts, &mut inspect);
        (plans.remove(0), left_out)
    }

    /// The reason why a contract needs a measured scene, if it does.
    fn needs_scene(&self, step: &Step, name: &str, contract: &Contract) -> Option<String> {
        let is_unknown = |a: &&Assumption| match a {
            Assumption::NoDepthTies => self.facts.depth_ties != Some(0),
            Assumption::NumbersOfTheScene => true,
            _ => false,
        };
        let given = contract.given().iter().find(is_unknown);
        let why = match (contract.budgets().first(), given) {
            (Some(budget), _) => format!("it promises no more than {budget}"),
            (None, Some(Assumption::NoDepthTies)) => {
                "it depends on there being no depth ties".to_owned()
            }
            (None, Some(_)) => "it depends on the numbers of a scene".to_owned(),
            (None, None) => return None,
        };
        let remedy = match (name, given) {
            ("variant", _) => {
                "`preshade plan SCENE --one --lock` measures, and keeps in preshade.lock what it \
                 chooses, which need not be this"
            }
            (_, Some(Assumption::NoDepthTies)) if contract.budgets().is_empty() => {
                "a preshade.lock of this material in which no depths tied (`preshade plan SCENE \
                 --one --lock`) would say so"
            }
            _ => {
                "a preshade.lock keeps one recipe a material, for `variant` alone: this one \
                 `preshade rewrite` makes, and `preshade verify` measures"
            }
        };
        Some(format!(
            "`{step}` is left out of `{name}`: {why}, which only a scene can show; {remedy}"
        ))
    }
}

fn refused(sources: &[front::Source], refusal: &Refusal, of: &str, after: &str) -> String {
    let Refusal {
        pass,
        code,
        reason,
        remedy,
        location,
    } = refusal;
    let text =
        format!("{of}{pass} does not apply{after} [{code}]: {reason}; to make it legal: {remedy}");
    match location {
        Some(at) => one_line(&format!("{}:{}:{}: {text}", at.file, at.line, at.column)),
        None => warning(sources, &text),
    }
}

fn warning(sources: &[front::Source], text: &str) -> String {
    let file = sources.first().map_or("", |s| s.name.as_str());
    one_line(&format!("{file}: {text}"))
}

/// Cargo's protocol allows one line a message.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Emits a plan as WGSL, and for each requested target that can express it.
fn emitted(
    builder: &BuildConfig,
    name: &str,
    plan: &Plan,
    sources: &[front::Source],
    warnings: &mut Vec<String>,
) -> Result<Vec<File>, BuildError> {
    let options = emit::Options::default();
    let mut targets = vec![Target::Wgsl];
    targets.extend(builder.targets.iter().filter(|t| **t != Target::Wgsl));
    // All at once. Only if that fails, one by one, to name the target.
    match emit::emit(plan, &targets, &options) {
        Ok(files) => Ok(files),
        Err(error) if targets == [Target::Wgsl] => Err(BuildError::Emit(error)),
        Err(_) => {
            targets.retain(|target| match emit::emit(plan, &[*target], &options) {
                Err(error) if *target != Target::Wgsl => {
                    let text = format!("{target} is left out of `{name}`: {error}");
                    warnings.push(warning(sources, &text));
                    false
                }
                _ => true,
            });
            Ok(emit::emit(plan, &targets, &options)?)
        }
    }
}
