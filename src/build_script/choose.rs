//! Which plans a material is built as: the lock's, or what is asked for and needs no scene.

use std::path::PathBuf;

use preshade_passes::contract::{Assumption, Contract};
use preshade_passes::pass::{Facts, Refusal};
use preshade_passes::plan::Plan;

use super::generate::Drawn;
use super::{Asked, Builder, Error};
use crate::emit::{self, File, Target};
use crate::front;
use crate::lock::{Inputs, Lock, Locked, Mismatch};
use crate::recipe::{Recipe, Step};

/// The variants of a material for which nothing is asked: what needs no scene.
pub(super) const BY_DEFAULT: [(&str, &str); 3] = [
    ("depth_prepass", "depth-prepass:form=biased"),
    ("early_discard", "early-discard:quad=vote"),
    ("shadow", "shadow"),
];

/// What a material is built as.
pub(super) struct Chosen {
    /// The original, the material's own variant, then those with names of their own.
    pub drawn: Vec<Drawn>,
    /// Files that its own include.
    pub included: Vec<PathBuf>,
}

/// Chooses the plans of a material.
pub(super) fn choose(
    builder: &Builder,
    name: &str,
    sources: &[front::Source],
    lock: Option<&Lock>,
    warnings: &mut Vec<String>,
) -> Result<Chosen, Error> {
    let Asked { own, named } = builder.recipes()?;
    let locked = lock.and_then(|lock| lock.materials.get(name));
    // The pipeline state and the entry points are no part of the shader: what the lock says of them holds also where the shader was edited.
    let state = builder.state.clone();
    let state = state.or(locked.map(|l| l.inputs.state.clone()));
    let state = state.unwrap_or_default();
    let parsed = parse(sources, &builder.options, locked)?;
    let inputs = Inputs::of(&parsed, &builder.options.defines, &state);
    let included = parsed.program.sources().files().iter().skip(sources.len());
    let mut included: Vec<PathBuf> = included.map(|f| PathBuf::from(&f.name)).collect();
    // Both stages may include it.
    included.sort();
    included.dedup();
    let fragment = parsed.fragment.as_deref();
    let original = Plan::original(name, parsed.program, &parsed.vertex, fragment, &state);

    let obeyed = lock.map(|lock| lock.check(name, &inputs)?.apply(&original));
    let variant = match obeyed {
        Some(Ok(plan)) => (plan, Vec::new()),
        // No lock, or one of other materials.
        None | Some(Err(Mismatch::NoMaterial { .. })) => {
            let others = lock.map(|lock| lock.same_files(name, &inputs));
            if let Some([first, ..]) = others.as_deref() {
                let why = format!(
                    "preshade.lock says nothing of `{name}`, but of `{first}`, which is of the same file: to obey it say `.name(\"{first}\")`"
                );
                warnings.push(warning(sources, &why));
            }
            without_scene(&original, &own.unwrap_or_default(), sources, warnings)
        }
        Some(Err(mismatch)) => {
            let why = format!("{mismatch}; run `preshade plan --lock` again");
            warnings.push(warning(sources, &format!("{why}. The original is shipped")));
            (original.clone(), vec![why])
        }
    };
    let mut plans = vec![
        ("original".to_owned(), (original.clone(), Vec::new())),
        ("variant".to_owned(), variant),
    ];
    for (name, recipe) in named {
        plans.push((name, without_scene(&original, &recipe, sources, warnings)));
    }
    let drawn = plans
        .into_iter()
        .map(|(name, (plan, left_out))| emitted(builder, name, plan, left_out, sources, warnings))
        .collect::<Result<_, _>>()?;
    Ok(Chosen { drawn, included })
}

/// The shader, with the entry points that are asked for, or else those of the lock where the shader still has them.
fn parse(
    sources: &[front::Source],
    options: &front::Options,
    locked: Option<&Locked>,
) -> Result<front::Parsed, Error> {
    if let Some(Locked { inputs, .. }) = locked {
        let vertex = options.vertex.clone().or(Some(inputs.vertex.clone()));
        let as_locked = front::Options {
            vertex,
            fragment: options.fragment.clone().or(inputs.fragment.clone()),
            ..options.clone()
        };
        if let Ok(parsed) = front::parse(sources, &as_locked) {
            return Ok(parsed);
        }
    }
    front::parse(sources, options).map_err(Error::Shader)
}

/// The steps of `recipe` that apply and need no scene; why others are left out.
fn without_scene(
    original: &Plan,
    recipe: &Recipe,
    sources: &[front::Source],
    warnings: &mut Vec<String>,
) -> (Plan, Vec<String>) {
    let (mut plan, mut left_out) = (original.clone(), Vec::new());
    for step in &recipe.steps {
        let one = Recipe {
            steps: vec![step.clone()],
        };
        let why = match one.apply(&plan, &Facts::default()) {
            Err(refusal) => {
                warnings.push(refused(sources, &refusal));
                refusal.to_string()
            }
            Ok(next) => match needs_scene(step, &next.contract) {
                None => {
                    plan = next;
                    continue;
                }
                Some(why) => {
                    warnings.push(warning(sources, &why));
                    why
                }
            },
        };
        left_out.push(why);
    }
    (plan, left_out)
}

/// Why a promise cannot be relied on before a scene was measured, if it cannot.
fn needs_scene(step: &Step, contract: &Contract) -> Option<String> {
    let of_a_scene = [Assumption::NoDepthTies, Assumption::NumbersOfTheScene];
    let given = contract.given().iter().find(|a| of_a_scene.contains(a));
    let why = match (contract.budgets().first(), given) {
        (Some(budget), _) => format!("it promises no more than {budget}"),
        (None, Some(Assumption::NoDepthTies)) => "it rests on there being no depth ties".to_owned(),
        (None, Some(_)) => "it rests on the numbers of a scene".to_owned(),
        (None, None) => return None,
    };
    Some(format!(
        "`{step}` is left out: {why}, which only a scene can show; `preshade plan --lock` measures and keeps the choice in preshade.lock"
    ))
}

fn refused(sources: &[front::Source], refusal: &Refusal) -> String {
    let Refusal {
        pass,
        code,
        reason,
        remedy,
        location,
    } = refusal;
    let text = format!("{pass} does not apply [{code}]: {reason}; to make it legal: {remedy}");
    match location {
        Some(at) => one_line(&format!("{}:{}:{}: {text}", at.file, at.line, at.column)),
        None => warning(sources, &text),
    }
}

fn warning(sources: &[front::Source], text: &str) -> String {
    let file = sources.first().map_or("", |s| s.name.as_str());
    one_line(&format!("{file}: {text}"))
}

/// Cargo's protocol ends a message at the end of the line.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Emits a plan in WGSL, and in each other target that can say it.
fn emitted(
    builder: &Builder,
    name: String,
    plan: Plan,
    left_out: Vec<String>,
    sources: &[front::Source],
    warnings: &mut Vec<String>,
) -> Result<Drawn, Error> {
    let options = emit::Options::default();
    let mut targets = vec![Target::Wgsl];
    targets.extend(builder.targets.iter().filter(|t| **t != Target::Wgsl));
    // Once for all of them; one by one only where that fails, to tell by whom.
    let files: Vec<File> = match emit::emit(&plan, &targets, &options) {
        Ok(files) => files,
        Err(error) if targets == [Target::Wgsl] => return Err(Error::Emit(error)),
        Err(_) => {
            targets.retain(|target| match emit::emit(&plan, &[*target], &options) {
                Err(error) if *target != Target::Wgsl => {
                    let text = format!("{target} is left out of `{name}`: {error}");
                    warnings.push(warning(sources, &text));
                    false
                }
                _ => true,
            });
            emit::emit(&plan, &targets, &options)?
        }
    };
    Ok(Drawn {
        name,
        plan,
        files,
        left_out,
    })
}
