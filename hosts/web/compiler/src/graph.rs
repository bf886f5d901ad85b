//! `graph`.

use preshade_dataflow::graph::{Graph, GraphData};

use crate::request::Drawn;
use crate::{Answer, Failure};

/// The dataflow graph of a material's main pass.
pub fn answer(asked: &Drawn) -> Result<Answer<GraphData>, Failure> {
    let plan = asked.shader.plan(None)?;
    let program = plan.main().and_then(|pass| plan.program(pass));
    let program = program
        .ok_or_else(|| Failure::usage(format!("error: `{}` has no program", plan.material)))?;
    Ok(Answer {
        read: crate::rewrite::read(&plan),
        ..Answer::new(Graph::build(program).to_data())
    })
}
