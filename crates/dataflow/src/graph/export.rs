//! Exports the graph to petgraph, Graphviz and JSON data.

use std::collections::{BTreeMap, BTreeSet};

use naga::{Expression, Handle, ShaderStage, Statement, TypeInner};
use petgraph::graph::{DiGraph, NodeIndex};
use petgraph::visit::EdgeRef;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::memory::{Origin, VersionId};
use super::rate::{self, Fact, Stages};
use super::{FunctionGraph, FunctionId, Graph, Root, StmtId, cells, cost, effect, text};
use naga_edit::interface;

/// Schema of [`GraphData`].
pub(crate) const SCHEMA: &str = "preshade.graph.v1";

/// The kind of a node.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum NodeKind {
    /// An entry input, or an argument of a function.
    Input,
    /// An expression.
    Expression,
    /// A statement.
    Statement,
    /// A variable's cell at entry.
    Initial,
    /// A cell after a write.
    Version,
    /// A cell at a merge of control.
    Phi,
    /// An output of an entry point, or a function's result.
    Output,
}

/// How one node affects another.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum EdgeKind {
    /// Its value is read.
    Data,
    /// It decides whether, or how often, the other runs.
    Control,
    /// Through a variable.
    Memory,
    /// Between a call and what it calls.
    Call,
}

/// A node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Node {
    /// Its function; empty for an unnamed one.
    pub function: String,
    /// Its kind.
    pub kind: NodeKind,
    /// Readable text.
    pub text: String,
    /// The author's name for it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub name: Option<String>,
    /// File and line, from 1, in the author's source.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub line: Option<String>,
    /// Rate by name ([`super::Rate::name`]).
    pub rate: String,
    /// The stages that can compute it: `any`, `vertex`, `fragment` or `none`.
    pub stages: String,
    /// Static cost of evaluating it once.
    pub cost: f64,
    /// How often it runs per run of its function.
    pub times: f64,
    /// Names of its effects.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub effects: Vec<String>,
}

/// An edge, from a node to one that depends on it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Edge {
    /// Index of a node.
    pub from: usize,
    /// Index of a node.
    pub to: usize,
    /// Kind of dependence.
    pub kind: EdgeKind,
}

/// Facts about a function.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FunctionData {
    /// Name.
    pub name: String,
    /// Stage, of an entry point.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub stage: Option<String>,
    /// Static cost of one run, calls included.
    pub cost: f64,
    /// Names of its effects, calls included.
    pub effects: Vec<String>,
}

/// The graph as data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GraphData {
    /// Version of this form.
    pub schema: String,
    /// The functions that entry points reach, callees first.
    pub functions: Vec<FunctionData>,
    /// The nodes, those of one function together.
    pub nodes: Vec<Node>,
    /// The edges, in order of their target.
    pub edges: Vec<Edge>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum NodeKey {
    Argument(usize, u32),
    Expression(usize, Handle<Expression>),
    Statement(usize, StmtId),
    Version(usize, VersionId),
    Output(usize, u32),
}

impl Graph<'_> {
    /// All functions that entry points reach, as one petgraph graph with a deterministic order of
    /// nodes and edges.
    pub fn to_petgraph(&self) -> DiGraph<Node, EdgeKind> {
        let mut out = Export {
            graph: self,
            out: DiGraph::new(),
            nodes: BTreeMap::new(),
            edges: BTreeSet::new(),
        };
        let reached: Vec<usize> = self.reached();
        for index in &reached {
            out.nodes_of(*index);
        }
        for index in &reached {
            out.edges_of(*index);
        }
        out.out
    }

    /// The graph as data, for JSON.
    pub fn to_data(&self) -> GraphData {
        let graph = self.to_petgraph();
        GraphData {
            schema: SCHEMA.to_owned(),
            functions: self
                .reached()
                .into_iter()
                .map(|i| {
                    let id = self.functions()[i].id;
                    FunctionData {
                        name: self.name(id),
                        stage: match id {
                            FunctionId::EntryPoint(e) => Some(
                                match self.module().entry_points[e].stage {
                                    ShaderStage::Vertex => "vertex",
                                    ShaderStage::Fragment => "fragment",
                                    ShaderStage::Compute => "compute",
                                    _ => "other",
                                }
                                .to_owned(),
                            ),
                            FunctionId::Function(_) => None,
                        },
                        cost: self.cost(id),
                        effects: self
                            .effects(id)
                            .iter()
                            .map(|e| e.name().to_owned())
                            .collect(),
                    }
                })
                .collect(),
            edges: graph
                .edge_references()
                .map(|e| Edge {
                    from: e.source().index(),
                    to: e.target().index(),
                    kind: *e.weight(),
                })
                .collect(),
            nodes: graph
                .into_nodes_edges()
                .0
                .into_iter()
                .map(|n| n.weight)
                .collect(),
        }
    }

    fn reached(&self) -> Vec<usize> {
        (0..self.functions().len())
            .filter(|i| {
                let id = self.functions()[*i].id;
                (0..self.module().entry_points.len())
                    .any(|e| self.reaches(FunctionId::EntryPoint(e), id))
            })
            .collect()
    }
}

fn stages_name(stages: Stages) -> &'static str {
    match (stages.vertex, stages.fragment) {
        (true, true) => "any",
        (true, false) => "vertex",
        (false, true) => "fragment",
        (false, false) => "none",
    }
}

struct Export<'g, 'p> {
    graph: &'g Graph<'p>,
    out: DiGraph<Node, EdgeKind>,
    nodes: BTreeMap<NodeKey, NodeIndex>,
    edges: BTreeSet<(NodeIndex, NodeIndex, EdgeKind)>,
}

impl<'g, 'p> Export<'g, 'p> {
    fn f(&self, index: usize) -> &'g FunctionGraph<'p> {
        &self.graph.functions()[index]
    }

    fn line(&self, span: naga::Span) -> Option<String> {
        let at = self.graph.program().sources().locate(span)?;
        Some(format!("{}:{}", at.file, at.line))
    }

    fn node(&mut self, key: NodeKey, node: Node) {
        let index = self.out.add_node(node);
        self.nodes.insert(key, index);
    }

    fn blank(&self, index: usize, kind: NodeKind, text: String, fact: Fact) -> Node {
        Node {
            function: self.graph.name(self.f(index).id),
            kind,
            text,
            name: None,
            line: None,
            rate: fact.rate.name(),
            stages: stages_name(fact.stages).to_owned(),
            cost: 0.0,
            times: 1.0,
            effects: Vec::new(),
        }
    }

    /// Whether an expression is a node: constants and addresses are part of their users' text.
    fn shown(&self, index: usize, e: Handle<Expression>) -> bool {
        let f = self.f(index);
        let Some(at) = f.statements.evaluated_at(e) else {
            return false;
        };
        f.control.is_reachable(at) && f.ty(self.graph.module(), e).pointer_space().is_none()
    }

    fn nodes_of(&mut self, index: usize) {
        let (f, module) = (self.f(index), self.graph.module());
        for (i, argument) in f.function.arguments.iter().enumerate() {
            let members = match &module.types[argument.ty].inner {
                TypeInner::Struct { members, .. } => members.as_slice(),
                _ => &[],
            };
            let name = argument.name.clone().unwrap_or_default();
            if members.is_empty() {
                let fact = match (f.id, &argument.binding) {
                    (FunctionId::EntryPoint(e), Some(binding)) => rate::of_binding(
                        module.entry_points[e].stage,
                        binding,
                        &module.types[argument.ty].inner,
                    ),
                    _ => self.graph.input_fact(index, i as u32, None),
                };
                let mut node = self.blank(index, NodeKind::Input, name.clone(), fact);
                node.text = format!("{name}: {}", interface::wgsl_type(module, argument.ty));
                self.node(NodeKey::Argument(index, (i as u32) << 16), node);
            }
            for (m, member) in members.iter().enumerate() {
                let fact = self.graph.input_fact(index, i as u32, Some(m as u32));
                let member_name = member.name.clone().unwrap_or_else(|| m.to_string());
                let text = format!(
                    "{name}.{member_name}: {}",
                    interface::wgsl_type(module, member.ty)
                );
                let node = self.blank(index, NodeKind::Input, text, fact);
                self.node(NodeKey::Argument(index, (i as u32) << 16 | m as u32), node);
            }
        }
        // The entry value is shown if something reads it, or a write preserves part of it.
        let mut read: Vec<VersionId> = f
            .memory
            .loads
            .values()
            .chain(f.memory.reads.values())
            .flatten()
            .copied()
            .collect();
        for version in &f.memory.versions {
            match &version.origin {
                Origin::Initial => {}
                Origin::Written { over, .. } => read.extend(over),
                Origin::Phi { operands, .. } => read.extend(operands),
            }
        }
        read.sort_unstable();
        read.dedup();
        for version in read {
            if *f.memory.origin(version) == Origin::Initial {
                self.version(index, version);
            }
        }
        for (id, node) in f.statements.iter() {
            if !f.control.is_reachable(id) {
                continue;
            }
            match node.statement {
                Statement::Emit(range) => {
                    for e in range.clone() {
                        if self.shown(index, e) {
                            self.expression(index, e, f.times[id.index()]);
                        }
                    }
                }
                Statement::Block(_) => {}
                _ => {
                    let fact = self.graph.statement_fact(f.id, id);
                    let text = text::statement(module, f, id);
                    let mut shown = self.blank(index, NodeKind::Statement, text, fact);
                    shown.line = self.line(node.span);
                    shown.cost = cost::of_statement(module, f, id);
                    shown.times = f.times[id.index()];
                    shown.effects = effect::of_statement(module, f, id)
                        .iter()
                        .map(|e| e.name().to_owned())
                        .collect();
                    self.node(NodeKey::Statement(index, id), shown);
                    if let Some(result) = naga_operands::result(node.statement) {
                        self.expression(index, result, f.times[id.index()]);
                    }
                    for version in f.memory.writes.get(&id).into_iter().flatten() {
                        self.version(index, *version);
                    }
                }
            }
        }
        for (v, version) in f.memory.versions.iter().enumerate() {
            if matches!(version.origin, Origin::Phi { .. }) {
                self.version(index, VersionId(v as u32));
            }
        }
        if let FunctionId::EntryPoint(_) = f.id {
            for (i, output) in interface::outputs(module, f.function).iter().enumerate() {
                let text = match (&output.name, &output.binding) {
                    (Some(name), _) => name.clone(),
                    (None, Some(naga::Binding::Location { location, .. })) => {
                        format!("@location({location})")
                    }
                    (None, Some(naga::Binding::BuiltIn(b))) => format!("@builtin({b:?})"),
                    (None, None) => "result".to_owned(),
                };
                let fact = self.graph.result_facts(f.id).get(i).copied();
                let fact = fact.unwrap_or_default();
                let node = self.blank(index, NodeKind::Output, text, fact);
                self.node(NodeKey::Output(index, i as u32), node);
            }
        } else if f.function.result.is_some() {
            let members = self.graph.result_facts(f.id).iter().copied();
            let fact = members.reduce(Fact::join).unwrap_or_default();
            let node = self.blank(index, NodeKind::Output, "result".to_owned(), fact);
            self.node(NodeKey::Output(index, 0), node);
        }
    }

    fn expression(&mut self, index: usize, e: Handle<Expression>, times: f64) {
        let (f, module) = (self.f(index), self.graph.module());
        let text = text::expression(module, f, e);
        let mut node = self.blank(index, NodeKind::Expression, text, self.graph.fact(f.id, e));
        node.name = f.function.named_expressions.get(&e).cloned();
        node.line = self.line(f.function.expressions.get_span(e));
        node.cost = cost::of_expression(module, f, e);
        node.times = times;
        node.effects = effect::of_expression(&f.function.expressions[e])
            .iter()
            .map(|e| e.name().to_owned())
            .collect();
        self.node(NodeKey::Expression(index, e), node);
    }

    fn version(&mut self, index: usize, version: VersionId) {
        let (f, module) = (self.f(index), self.graph.module());
        let cell = f.memory.cell(version);
        let mut text = match cell.root {
            Root::Local(v) => f.function.local_variables[v].name.clone(),
            Root::Argument(i) => f.function.arguments[i as usize].name.clone(),
            Root::Global(g) => module.global_variables[g].name.clone(),
        }
        .unwrap_or_else(|| "variable".to_owned());
        for step in cells::path_names(module, f.function, cell) {
            text.push_str(&step);
        }
        let kind = match f.memory.origin(version) {
            Origin::Initial => NodeKind::Initial,
            Origin::Written { .. } => NodeKind::Version,
            Origin::Phi { .. } => NodeKind::Phi,
        };
        let fact = self.graph.version_fact(index, version);
        let node = self.blank(index, kind, text, fact);
        self.node(NodeKey::Version(index, version), node);
    }

    fn edge(&mut self, from: NodeKey, to: NodeKey, kind: EdgeKind) {
        if let (Some(from), Some(to)) = (self.nodes.get(&from), self.nodes.get(&to)) {
            let (from, to) = (*from, *to);
            if from != to && self.edges.insert((from, to, kind)) {
                self.out.add_edge(from, to, kind);
            }
        }
    }

    /// Data edges from an expression's operands, through expressions that are not shown.
    fn data(&mut self, index: usize, from: Handle<Expression>, to: NodeKey) {
        let f = self.f(index);
        if self.nodes.contains_key(&NodeKey::Expression(index, from)) {
            return self.edge(NodeKey::Expression(index, from), to, EdgeKind::Data);
        }
        if let Expression::FunctionArgument(i) = f.function.expressions[from] {
            let members: Vec<NodeKey> = self
                .nodes
                .range(
                    NodeKey::Argument(index, i << 16)..=NodeKey::Argument(index, i << 16 | 0xffff),
                )
                .map(|(k, _)| *k)
                .collect();
            for member in members {
                self.edge(member, to, EdgeKind::Data);
            }
            return;
        }
        for operand in naga_operands::of_expression(&f.function.expressions[from]) {
            self.data(index, operand, to);
        }
    }

    fn edges_of(&mut self, index: usize) {
        let (f, module) = (self.f(index), self.graph.module());
        for (e, expression) in f.function.expressions.iter() {
            let key = NodeKey::Expression(index, e);
            if !self.nodes.contains_key(&key) {
                continue;
            }
            match expression {
                // One member of a struct argument is one input.
                Expression::AccessIndex { base, index: m }
                    if matches!(
                        f.function.expressions[*base],
                        Expression::FunctionArgument(_)
                    ) && matches!(f.ty(module, *base), TypeInner::Struct { .. }) =>
                {
                    if let Expression::FunctionArgument(i) = f.function.expressions[*base] {
                        self.edge(NodeKey::Argument(index, i << 16 | m), key, EdgeKind::Data);
                    }
                }
                _ => {
                    for operand in naga_operands::of_expression(expression) {
                        self.data(index, operand, key);
                    }
                }
            }
            for version in f.memory.loads.get(&e).into_iter().flatten() {
                self.edge(NodeKey::Version(index, *version), key, EdgeKind::Memory);
            }
        }
        for (id, node) in f.statements.iter() {
            let key = NodeKey::Statement(index, id);
            if !self.nodes.contains_key(&key) {
                if let Statement::Emit(range) = node.statement {
                    for predicate in f.control.of(id) {
                        for e in range.clone() {
                            self.edge(
                                NodeKey::Statement(index, *predicate),
                                NodeKey::Expression(index, e),
                                EdgeKind::Control,
                            );
                        }
                    }
                }
                continue;
            }
            for operand in naga_operands::of_statement(node.statement) {
                self.data(index, operand, key);
            }
            for predicate in f.control.of(id) {
                self.edge(
                    NodeKey::Statement(index, *predicate),
                    key,
                    EdgeKind::Control,
                );
            }
            for version in f.memory.reads.get(&id).into_iter().flatten() {
                self.edge(NodeKey::Version(index, *version), key, EdgeKind::Memory);
            }
            for version in f.memory.writes.get(&id).into_iter().flatten() {
                self.edge(key, NodeKey::Version(index, *version), EdgeKind::Memory);
                if let Origin::Written {
                    over: Some(over), ..
                } = f.memory.origin(*version)
                {
                    self.edge(
                        NodeKey::Version(index, *over),
                        NodeKey::Version(index, *version),
                        EdgeKind::Memory,
                    );
                }
            }
            if let Some(result) = naga_operands::result(node.statement) {
                self.edge(key, NodeKey::Expression(index, result), EdgeKind::Data);
            }
            match node.statement {
                Statement::Call {
                    function,
                    arguments: _,
                    result,
                } => {
                    let callee = function.index();
                    let inputs: Vec<NodeKey> = self
                        .nodes
                        .range(NodeKey::Argument(callee, 0)..=NodeKey::Argument(callee, u32::MAX))
                        .map(|(k, _)| *k)
                        .collect();
                    for input in inputs {
                        self.edge(key, input, EdgeKind::Call);
                    }
                    if let Some(result) = result {
                        self.edge(
                            NodeKey::Output(callee, 0),
                            NodeKey::Expression(index, *result),
                            EdgeKind::Call,
                        );
                    }
                }
                Statement::Return { value: Some(value) } => self.returned(index, id, *value),
                _ => {}
            }
        }
        for (v, version) in f.memory.versions.iter().enumerate() {
            let key = NodeKey::Version(index, VersionId(v as u32));
            if let Origin::Phi { at, operands } = &version.origin {
                for operand in operands {
                    self.edge(NodeKey::Version(index, *operand), key, EdgeKind::Memory);
                }
                if let Some(at) = at {
                    self.edge(NodeKey::Statement(index, *at), key, EdgeKind::Control);
                }
            }
        }
    }

    /// Connects a `return` to the outputs: each to its own component, if the returned value is
    /// composed there.
    fn returned(&mut self, index: usize, id: StmtId, value: Handle<Expression>) {
        let f = self.f(index);
        let outputs: Vec<NodeKey> = self
            .nodes
            .range(NodeKey::Output(index, 0)..=NodeKey::Output(index, u32::MAX))
            .map(|(k, _)| *k)
            .collect();
        for (i, output) in outputs.iter().enumerate() {
            self.edge(NodeKey::Statement(index, id), *output, EdgeKind::Control);
            match &f.function.expressions[value] {
                Expression::Compose { components, .. }
                    if outputs.len() > 1 && components.len() == outputs.len() =>
                {
                    self.data(index, components[i], *output);
                }
                _ => self.data(index, value, *output),
            }
        }
    }
}
