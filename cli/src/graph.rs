//! `preshade graph`: the dataflow graph, as dot or JSON.

use preshade::passes::graph::Graph;

use crate::input::ShaderArgs;
use crate::{Failure, Outcome};

/// Arguments of `graph`.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    shader: ShaderArgs,
    /// Output form.
    #[arg(long, value_enum, default_value_t = GraphFormat::Dot)]
    format: GraphFormat,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum GraphFormat {
    /// Graphviz.
    Dot,
    /// One object: nodes and edges.
    Json,
}

/// Prints the graph.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let parsed = args.shader.parse()?;
    let graph = Graph::build(&parsed.program);
    match args.format {
        GraphFormat::Dot => println!("{}", graph.to_dot()),
        GraphFormat::Json => println!("{}", serde_json::to_string_pretty(&graph.to_data())?),
    }
    Ok(Outcome::Fine)
}
