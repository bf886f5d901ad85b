//! The comparison of two programs.

use naga::ShaderStage;
use naga_edit::declared::Depth;
use preshade_dataflow::graph::Graph;
use preshade_plan::plan::Plan;
use preshade_validate::Effort;
use preshade_validate::agree::{self, Agreement, Class, Mismatch, Question, Relation};
use serde::Serialize;

use shader_text::nearest::unknown;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FailOn {
    All,
    Nothing,
    Class(Class),
}

/// Reads `all`, `none`, or a class by its name or a common synonym.
///
/// # Errors
/// There is no such class, as a message with the names.
pub fn parse_class(text: &str) -> Result<FailOn, String> {
    match text {
        "all" => return Ok(FailOn::All),
        "none" => return Ok(FailOn::Nothing),
        _ => {}
    }
    // The words that people use for a class.
    let name = match text {
        "positions" => "position",
        "keeps" => "keeps-hidden",
        "colors" | "colour" | "colours" => "color",
        name => name,
    };
    let found = Class::ALL.into_iter().find(|c| c.name() == name);
    found.map(FailOn::Class).ok_or_else(|| {
        let names: Vec<&str> = Class::ALL.iter().map(|c| c.name()).collect();
        unknown("class", text, &names)
    })
}

/// The class of a waiver.
///
/// # Errors
/// As [`parse_class`]; or it is more than one class.
pub fn class_named(name: &str) -> Result<Class, String> {
    match parse_class(name)? {
        FailOn::Class(class) => Ok(class),
        _ => Err("a waiver is for one class".to_owned()),
    }
}

/// Whether a finding breaks a relation.
pub fn breaks(fail_on: Option<&[FailOn]>, class: Class, relation: Relation) -> bool {
    match fail_on {
        None => class.breaks(relation),
        Some(given) => given.iter().any(|f| match f {
            FailOn::All => true,
            FailOn::Nothing => false,
            FailOn::Class(c) => *c == class,
        }),
    }
}

/// The static cost of each stage, in operations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Cost {
    pub vertex: Option<f64>,
    pub fragment: Option<f64>,
}

impl Cost {
    /// The static cost of a plan's stages.
    pub fn of(plan: &Plan) -> Self {
        let Some((pass, program)) = plan.main().and_then(|p| Some((p, plan.program(p)?))) else {
            return Self::default();
        };
        let graph = Graph::build(program);
        let cost = |stage, name: &str| {
            let (entry, _) = program.entry_point(stage, name)?;
            Some(graph.entry_cost(entry))
        };
        Self {
            vertex: cost(ShaderStage::Vertex, &pass.vertex),
            fragment: pass
                .fragment
                .as_ref()
                .and_then(|f| cost(ShaderStage::Fragment, f)),
        }
    }
}

/// A program that was read again.
pub struct Side {
    pub plan: Plan,
    /// The names of its files, for messages.
    pub name: String,
}

pub struct Compared {
    pub agreement: Agreement,
    /// The programs that were compared.
    pub plans: [Plan; 2],
    /// How the programs were read, a sentence each.
    pub notes: Vec<String>,
    /// The side whose depths were taken as written, against its language's rule.
    pub as_written: Option<usize>,
}

/// Compares two programs. If the positions differ and only one program counts as OpenGL's by its
/// language's rule, `again` reads that one with depths as written. `is_given` is true for a program
/// whose clip space the author gave.
///
/// # Errors
/// The two do not fit together (`told` makes the error), or one cannot be read again.
pub fn compare<E>(
    mut plans: [Plan; 2],
    question: Question<'_>,
    effort: &Effort,
    is_given: [bool; 2],
    again: &dyn Fn(usize) -> Result<Side, E>,
    told: &dyn Fn(Mismatch) -> E,
) -> Result<Compared, E> {
    let compare =
        |plans: &[Plan; 2]| agree::agree(&plans[0], &plans[1], question, effort).map_err(told);
    let mut agreement = compare(&plans)?;
    let mut notes = std::mem::take(&mut agreement.notes);
    let other = of_another_clip_space(&plans, is_given).filter(|_| is_elsewhere(&agreement));
    let mut as_written = None;
    if let Some(side) = other {
        let Side { plan, name } = again(side)?;
        let mut others = plans.clone();
        others[side] = plan;
        let compared = compare(&others)?;
        if !is_elsewhere(&compared) {
            notes.push(format!(
                "positions are compared as written: only with OpenGL's depths, from -1 to 1, does {name} \
                 differ"
            ));
            (agreement, plans, as_written) = (compared, others, Some(side));
        }
    }
    Ok(Compared {
        agreement,
        plans,
        notes,
        as_written,
    })
}

fn is_elsewhere(agreement: &Agreement) -> bool {
    let mut findings = agreement.findings.iter();
    findings.any(|f| f.class == Class::Position)
}

/// The side that counts as OpenGL's by its language's rule, if the other does not. The host's
/// matrices decide, and a text does not show which they are.
fn of_another_clip_space(plans: &[Plan; 2], is_given: [bool; 2]) -> Option<usize> {
    let is_open_gl = |plan: &Plan| {
        let program = plan.main().and_then(|p| plan.program(p));
        program.is_some_and(|p| p.declared().depth == Depth::OpenGl)
    };
    let side = match plans.each_ref().map(is_open_gl) {
        [true, false] => 0,
        [false, true] => 1,
        _ => return None,
    };
    (!is_given[side]).then_some(side)
}
