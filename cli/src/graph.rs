//! `preshade graph`: the dataflow graph, as dot or JSON.

use preshade_compiler::recipe::Recipe;
use preshade_dataflow::graph::Graph;

use crate::input::ShaderArgs;
use crate::{Ending, Failure, output};

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade graph lit.wgsl | dot -Tsvg > lit.svg
  preshade graph lit.wgsl --format json
  preshade graph scene.toml --material floor      one material of a scene")]
pub struct GraphArgs {
    /// Output form.
    #[arg(long, value_enum, default_value_t = GraphFormat::Dot)]
    format: GraphFormat,
    // Last: its help heading applies to the flags after it.
    #[command(flatten)]
    pub shader: ShaderArgs,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum GraphFormat {
    /// Graphviz.
    Dot,
    /// One object with nodes and edges.
    Json,
}

pub fn run(args: &GraphArgs) -> Result<Ending, Failure> {
    let plans = args.shader.plans(&Recipe::default())?.asked;
    let [plan] = &plans[..] else {
        let names: Vec<&str> = plans.iter().map(|p| p.material.as_str()).collect();
        return Err(Failure(format!(
            "error: a graph is of one material: choose one with --material; there are: {}",
            names.join(", ")
        )));
    };
    let Some(program) = plan.main().and_then(|p| plan.program(p)) else {
        return Err(Failure(format!(
            "error: `{}` has no program",
            plan.material
        )));
    };
    let graph = Graph::build(program);
    match args.format {
        GraphFormat::Dot => output::data(&graph.to_dot())?,
        GraphFormat::Json => output::json(&graph.to_data())?,
    }
    Ok(Ending::Fine)
}
