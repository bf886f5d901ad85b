//! Exports the graph as Graphviz text.

use std::fmt::Write;

use petgraph::graph::NodeIndex;
use petgraph::visit::EdgeRef;

use super::Graph;
use super::export::{EdgeKind, Node, NodeKind};

impl Graph<'_> {
    /// The graph as Graphviz text, with a cluster per function.
    pub fn to_dot(&self) -> String {
        let graph = self.to_petgraph();
        let mut dot = String::from(
            "digraph preshade {\n  rankdir=TB;\n  node [fontname=\"monospace\", fontsize=10];\n",
        );
        let mut functions: Vec<(&str, Vec<NodeIndex>)> = Vec::new();
        for index in graph.node_indices() {
            let name = graph[index].function.as_str();
            match functions.last_mut() {
                Some((last, nodes)) if *last == name => nodes.push(index),
                _ => functions.push((name, vec![index])),
            }
        }
        for (i, (name, nodes)) in functions.iter().enumerate() {
            let _ = writeln!(
                dot,
                "  subgraph cluster_{i} {{\n    label=\"{}\";",
                escape(name)
            );
            for index in nodes {
                let node = &graph[*index];
                let _ = writeln!(
                    dot,
                    "    n{} [shape={}, label=\"{}\"];",
                    index.index(),
                    shape(node.kind),
                    escape(&label(node))
                );
            }
            dot.push_str("  }\n");
        }
        for edge in graph.edge_references() {
            let style = match edge.weight() {
                EdgeKind::Data => "",
                EdgeKind::Control => " [style=dashed, color=firebrick]",
                EdgeKind::Memory => " [color=steelblue]",
                EdgeKind::Call => " [style=dotted]",
            };
            let _ = writeln!(
                dot,
                "  n{} -> n{}{style};",
                edge.source().index(),
                edge.target().index()
            );
        }
        dot.push_str("}\n");
        dot
    }
}

fn shape(kind: NodeKind) -> &'static str {
    match kind {
        NodeKind::Input | NodeKind::Initial => "invhouse",
        NodeKind::Expression => "ellipse",
        NodeKind::Statement => "box",
        NodeKind::Version => "note",
        NodeKind::Phi => "diamond",
        NodeKind::Output => "house",
    }
}

fn label(node: &Node) -> String {
    let mut label = match &node.name {
        Some(name) => format!("{name} = {}", node.text),
        None => node.text.clone(),
    };
    let _ = write!(label, "\n{}", node.rate);
    if node.stages != "any" {
        let _ = write!(label, ", {} only", node.stages);
    }
    if node.cost > 0.0 {
        let _ = write!(label, ", cost {}", node.cost);
    }
    if node.times > 1.0 {
        let _ = write!(label, " x{}", node.times);
    }
    if !node.effects.is_empty() {
        let _ = write!(label, "\n{}", node.effects.join(", "));
    }
    if let Some(line) = &node.line {
        let _ = write!(label, "\n{line}");
    }
    label
}

fn escape(text: &str) -> String {
    text.replace('\\', "\\\\")
        .replace('"', "\\\"")
        .replace('\n', "\\n")
}
