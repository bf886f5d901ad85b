//! `agree`.

use std::collections::BTreeMap;

use preshade_compiler::command::agree::{
    Compared, Cost, FailOn, Side, breaks, compare, parse_class,
};
use preshade_compiler::command::agree_text::{Pair, Report};
use preshade_plan::mapping::Equation;
use preshade_validate::Effort;
use preshade_validate::agree::{Mismatch, Question, Relation};
use shader_text::nearest::unknown;
use shader_text::options::ClipSpace;

use crate::request::{Agree, Shader};
use crate::{Answer, Failure, Format, pretty};

/// Inputs of a promise, by default.
const INPUTS: u64 = 480;

fn relation(name: &str) -> Result<Relation, Failure> {
    let found = Relation::ALL.into_iter().find(|r| r.name() == name);
    found.ok_or_else(|| {
        let names = Relation::ALL.map(Relation::name);
        Failure::usage(unknown("relation", name, &names))
    })
}

/// Holds two programs against each other.
pub fn answer(asked: &Agree) -> Result<Answer<Report>, Failure> {
    let relation = relation(&asked.r#as)?;
    if asked.normal.is_some() && relation != Relation::Normal {
        return Err(Failure::usage("--normal is for `--as normal`"));
    }
    let maps = asked.map.iter().map(|text| text.parse::<Equation>());
    let maps: Result<Vec<Equation>, _> = maps.collect();
    let maps = maps.map_err(|e| Failure::usage(format!("map: {e}")))?;
    let classes = asked.fail_on.as_ref().map(|classes| {
        let classes = classes.iter().map(|class| parse_class(class));
        classes.collect::<Result<Vec<FailOn>, _>>()
    });
    let fail_on = classes.transpose().map_err(Failure::usage)?;
    let inputs = asked.inputs.unwrap_or(INPUTS);
    if !(1..=1_000_000).contains(&inputs) {
        return Err(Failure::usage("inputs is 1 to 1000000"));
    }
    let sides = [&asked.shader, &asked.with];
    let plan = |side: &Shader, clip| side.plan(clip).map_err(|e| e.of(&side.names()));
    let plans = [plan(sides[0], None)?, plan(sides[1], None)?];
    let question = Question {
        relation,
        maps: &maps,
        normal: asked.normal.as_deref(),
    };
    let effort = Effort {
        inputs,
        ..Effort::default()
    };
    let again = |side: usize| -> Result<Side, Failure> {
        let shader = sides[side];
        Ok(Side {
            plan: plan(shader, Some(ClipSpace::AsWritten))?,
            name: shader.names(),
        })
    };
    let told = |e: Mismatch| {
        Failure::usage(e.to_string()).hint(&format!(
            "the first is {}, the second {}",
            sides[0].names(),
            sides[1].names()
        ))
    };
    let is_given = sides.map(Shader::has_clip);
    let Compared {
        agreement,
        plans,
        notes,
        ..
    } = compare(plans, question, &effort, is_given, &again, &told)?;
    let name = format!("{} {}", sides[0].names(), sides[1].names());
    let cost = plans.each_ref().map(Cost::of);
    let mut report = Report::default();
    let names = BTreeMap::from([(name.clone(), true)]);
    report
        .pairs
        .push(Pair::new(name, agreement, notes, cost, Vec::new()));
    report.waive(&[], &names, |class, relation| {
        breaks(fail_on.as_deref(), class, relation)
    });
    let stdout = match asked.format {
        None => None,
        Some(Format::Human) => Some(report.human(asked.verbose)),
        Some(Format::Markdown) => Some(report.markdown()),
        Some(Format::Json) => Some(pretty(&report)?),
    };
    let status = match () {
        () if report.is_broken() => 1,
        () if report.is_partial() => 3,
        () => 0,
    };
    let mut read: Vec<String> = plans.iter().flat_map(crate::rewrite::read).collect();
    read.sort();
    read.dedup();
    Ok(Answer {
        status,
        stdout,
        read,
        ..Answer::new(report)
    })
}
