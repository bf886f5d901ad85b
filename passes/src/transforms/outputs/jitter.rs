//! Where a shader has the offset of temporal antialiasing.

use naga::{Handle, Module, Type, TypeInner};

use super::extend::Member;
use super::extend::without_jitter::{Unsteady, steady};
use super::names::{self, refusal};
use super::{OutputsParams, list, refusals, with_main};
use preshade_plan::mapping;
use preshade_plan::pass::Refusal;
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;

/// Letters of a vector's components.
const LETTERS: [&str; 2] = ["xyzw", "rgba"];

/// The parts of a buffer that a word of `jitter` names: a member, or numbers of a matrix
/// (`camera.proj[2].xy`).
///
/// # Errors
/// There is no such part, or it is or holds a whole matrix: without a matrix there is no position.
pub(crate) fn of(program: &Program, name: &str) -> Result<Vec<Member>, Box<Refusal>> {
    let module = program.module();
    let found = match names::member(program, name) {
        Ok(found) => found,
        Err(refused) => return in_matrix(program, name).ok_or(refused),
    };
    match matrix_in(module, found.ty) {
        None => Ok(vec![found]),
        Some(path) => Err(refusal(
            &refusals::JITTER_MATRIX,
            format!("`{name}{path}` is a matrix, and without it there is no position"),
        )),
    }
}

/// The part with jitter that `WITHOUT=WITH` names, and the one without.
///
/// # Errors
/// One of them does not exist, or they are not of one type.
pub(crate) fn twins(program: &Program, pair: &str) -> Result<[Member; 2], Box<Refusal>> {
    let (without, with) = pair.split_once('=').unwrap_or((pair, pair));
    let [with, without] = [with, without].map(|name| names::member(program, name));
    let (with, without) = (with?, without?);
    if program.module().types[with.ty].inner != program.module().types[without.ty].inner {
        let reason = format!("the two of `{pair}` are not of one type");
        return Err(refusal(&refusals::UNREAD_JITTER, reason));
    }
    Ok([with, without])
}

/// The plan with a main pass whose jitter is 0, for pictures that a light draws; `None`: the
/// parameters name no jitter.
pub(crate) fn without(plan: &Plan, params: &OutputsParams) -> Result<Option<Plan>, Box<Refusal>> {
    let names = list(params.jitter.as_deref());
    let program = plan.main().and_then(|main| plan.program(main));
    let Some(program) = program.filter(|_| params.jitter.is_some()) else {
        return Ok(None);
    };
    let light = || {
        let reason = "a light's matrix is its own, and holds no jitter: bind it";
        refusal(&refusals::UNREAD_JITTER, reason)
    };
    let all = names.map(|name| match name.contains('=') {
        true => Err(light()),
        false => of(program, name),
    });
    let all: Vec<Vec<Member>> = all.collect::<Result<_, _>>()?;
    let all = all.concat();
    let is_in_matrix = |member: &Member| {
        matches!(
            program.module().types[member.ty].inner,
            TypeInner::Matrix { .. }
        )
    };
    if all.iter().any(is_in_matrix) {
        return Err(light());
    }
    let steady = steady(program, &all).map_err(|why| match why {
        Unsteady::Built(why) => Box::new(Refusal::bug(super::NAME, why)),
        Unsteady::Unread(name) => refusal(
            &refusals::UNREAD_JITTER,
            format!("the material does not read `{name}`"),
        ),
        Unsteady::Whole(whole, name) => refusal(
            &refusals::UNREAD_JITTER,
            format!("the material reads `{whole}` as a whole, and never `{name}` alone"),
        ),
    })?;
    Ok(Some(with_main(plan, &steady, None)))
}

/// The numbers of a matrix that a path names: those of a column, some of them, or one.
fn in_matrix(program: &Program, name: &str) -> Option<Vec<Member>> {
    let module = program.module();
    let plain = name.trim().replace('[', ".").replace(']', "");
    let words: Vec<&str> = plain.split('.').map(str::trim).collect();
    (1..words.len()).rev().find_map(|end| {
        let whole = names::member(program, &words[..end].join(".")).ok()?;
        let TypeInner::Matrix { columns, rows, .. } = module.types[whole.ty].inner else {
            return None;
        };
        // Our IR has the transpose of a `row_major` matrix.
        if !program.declared().rows.is_empty() {
            return None;
        }
        let column: usize = words[end].parse().ok()?;
        let rows = match words[end + 1..] {
            [] => (0..rows as usize).collect(),
            [word] => components(word)?,
            _ => return None,
        };
        let is_within =
            column < columns as usize && rows.iter().all(|row| *row < rows_of(module, whole.ty));
        let number = |row: usize| {
            let mut member = whole.clone();
            member.steps.extend([column, row]);
            member
        };
        is_within.then(|| rows.into_iter().map(number).collect())
    })
}

fn rows_of(module: &Module, ty: Handle<Type>) -> usize {
    match module.types[ty].inner {
        TypeInner::Matrix { rows, .. } => rows as usize,
        _ => 0,
    }
}

/// The components of a vector that a word names, by number or by letters.
fn components(word: &str) -> Option<Vec<usize>> {
    if let Ok(row) = word.parse() {
        return Some(vec![row]);
    }
    LETTERS.iter().find_map(|letters| {
        let all = word.chars().map(|letter| letters.find(letter));
        all.collect::<Option<Vec<usize>>>()
    })
}

/// The path to a matrix in a type: empty if it is one.
fn matrix_in(module: &Module, ty: Handle<Type>) -> Option<String> {
    match &module.types[ty].inner {
        TypeInner::Matrix { .. } => Some(String::new()),
        TypeInner::Array { base, .. } => {
            let rest = matrix_in(module, *base)?;
            Some(format!("[0]{rest}"))
        }
        TypeInner::Struct { .. } => {
            let members = mapping::members(module, ty).into_iter();
            let mut paths = members.filter_map(|(name, ty)| {
                let rest = matrix_in(module, ty)?;
                Some(format!(".{name}{rest}"))
            });
            paths.next()
        }
        _ => None,
    }
}
