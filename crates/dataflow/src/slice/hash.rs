//! A canonical form of a slice and its hash.

use std::collections::BTreeMap;
use std::fmt::{self, Write};

use naga::{Expression, Handle, LocalVariable, Module, Statement, Type, TypeInner};

use super::Slice;
use crate::graph::{FunctionGraph, Graph, StmtId};

/// FNV-1a, 64 bits, over the text written to it: stable across platforms and releases. The text
/// itself is not stored, because it has tens of kilobytes for a large material.
struct Fnv(u64);

impl Write for Fnv {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0 = text.bytes().fold(self.0, |h, b| {
            (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3)
        });
        Ok(())
    }
}

/// Hashes the functions of a slice in order to 16 hex digits. Expressions are numbered by first
/// evaluation, variables by first use, globals by binding, and types by structure. Names and spans
/// do not count.
pub(crate) fn canonical(graph: &Graph<'_>, slice: &Slice) -> String {
    let mut hash = Fnv(0xcbf2_9ce4_8422_2325);
    // Writing to a hash cannot fail, here and below.
    let _ = writeln!(hash, "{:?} {:?}", slice.stage, slice.outputs);
    for part in &slice.parts {
        let f = graph.function(part.function);
        let mut writer = Writer {
            module: graph.module(),
            f,
            numbers: vec![None; f.function.expressions.len()],
            numbered: 0,
            locals: BTreeMap::new(),
            block_ends: BTreeMap::new(),
            debug: String::new(),
            hash,
        };
        let _ = writeln!(writer.hash, "fn {:?}", part.demand.result);
        for (id, node) in f.statements.iter() {
            if part.kept.statements[id.index()] {
                let depth = f.statements.ancestors(id).count();
                let callee = part.calls.get(&id).copied();
                writer.statement(id, node.statement, depth, callee, part);
            }
        }
        hash = writer.hash;
    }
    format!("{:016x}", hash.0)
}

struct Writer<'a, 'p> {
    module: &'a Module,
    f: &'a FunctionGraph<'p>,
    /// Number of each expression, by its handle's index.
    numbers: Vec<Option<usize>>,
    numbered: usize,
    locals: BTreeMap<Handle<LocalVariable>, usize>,
    /// Where each block of a statement ends, by the statement's number.
    block_ends: BTreeMap<usize, Vec<usize>>,
    /// Reused buffer for debug text.
    debug: String,
    hash: Fnv,
}

impl Writer<'_, '_> {
    /// The index of the parent's block that a statement is in: it may be in either arm of an `If`.
    fn block_of(&mut self, parent: StmtId, id: StmtId) -> usize {
        let statements = &self.f.statements;
        let ends = self.block_ends.entry(parent.index()).or_insert_with(|| {
            let mut at = parent.index() + 1;
            let blocks = naga_operands::blocks(statements.get(parent).statement);
            let end = |block: &&naga::Block| {
                for _ in block.iter() {
                    at = statements.get(StmtId::from(at)).end.index();
                }
                at
            };
            blocks.iter().map(end).collect()
        });
        ends.partition_point(|end| *end <= id.index())
    }

    fn statement(
        &mut self,
        id: StmtId,
        statement: &Statement,
        depth: usize,
        callee: Option<usize>,
        part: &super::Part,
    ) {
        let kept = |e: Handle<Expression>| part.kept.expressions[e.index()].is_some();
        if let Statement::Emit(range) = statement {
            for e in range.clone() {
                if kept(e) {
                    self.number(e);
                }
            }
            return;
        }
        // Recipes pin hashes, so this form must not change.
        let parent = self.f.statements.get(id).parent;
        let in_block = parent.map(|p| Some(self.block_of(p, id)));
        let operands = naga_operands::of_statement(statement);
        for e in &operands {
            if kept(*e) {
                self.number(*e);
            }
        }
        let _ = write!(self.hash, "{depth} {in_block:?} ");
        match statement {
            Statement::Switch { cases, .. } => {
                let cases: Vec<_> = cases.iter().map(|c| (c.value, c.fall_through)).collect();
                let _ = write!(self.hash, "Switch {cases:?}");
            }
            Statement::Return { .. } => self.word("Return"),
            other => self.without_handles(format_args!("{:?}", naga_operands::shell(other))),
        }
        self.word(" [");
        for (i, e) in operands.iter().enumerate() {
            self.word(if i == 0 { "\"" } else { ", \"" });
            match self.numbers[e.index()].filter(|_| kept(*e)) {
                Some(n) => {
                    let _ = write!(self.hash, "{n}");
                }
                None => self.word("_"),
            }
            self.word("\"");
        }
        let _ = writeln!(self.hash, "] {callee:?}");
        if let Some(result) = naga_operands::result(statement) {
            self.name(result);
        }
    }

    /// Gives `e` the next number.
    fn name(&mut self, e: Handle<Expression>) -> usize {
        let n = self.numbered;
        if self.numbers[e.index()].replace(n).is_none() {
            self.numbered += 1;
        }
        n
    }

    fn number(&mut self, e: Handle<Expression>) -> usize {
        if let Some(n) = self.numbers[e.index()] {
            return n;
        }
        let (module, function) = (self.module, self.f.function);
        let expression = &function.expressions[e];
        let operands = naga_operands::of_expression(expression);
        for o in &operands {
            self.number(*o);
        }
        let init = match expression {
            Expression::LocalVariable(v) => {
                let next = self.locals.len();
                self.locals.entry(*v).or_insert(next);
                function.local_variables[*v].init.map(|i| self.number(i))
            }
            _ => None,
        };
        let n = self.name(e);
        let _ = write!(self.hash, "{n} = ");
        match expression {
            Expression::Constant(c) => self.constant(*c),
            Expression::Override(o) => {
                let _ = write!(self.hash, "override {:?}", module.overrides[*o].id);
            }
            Expression::ZeroValue(ty) => self.typed("zero ", *ty),
            Expression::Compose { ty, .. } => self.typed("compose ", *ty),
            Expression::GlobalVariable(g) => {
                let global = &module.global_variables[*g];
                let _ = write!(self.hash, "global {:?} {:?} ", global.space, global.binding);
                self.ty(global.ty);
            }
            Expression::LocalVariable(v) => {
                let _ = write!(self.hash, "local {} ", self.locals[v]);
                self.ty(function.local_variables[*v].ty);
                let _ = write!(self.hash, " {init:?}");
            }
            Expression::AtomicResult { ty, .. }
            | Expression::WorkGroupUniformLoadResult { ty }
            | Expression::SubgroupOperationResult { ty } => self.typed("result ", *ty),
            Expression::CallResult(_) => self.word("call"),
            other => self.without_handles(format_args!("{other:?}")),
        }
        self.word(" [");
        for (i, o) in operands.iter().enumerate() {
            let comma = if i == 0 { "" } else { ", " };
            let _ = write!(self.hash, "{comma}{}", self.numbers[o.index()].unwrap_or(n));
        }
        self.word("]\n");
        n
    }

    fn word(&mut self, text: &str) {
        let _ = self.hash.write_str(text);
    }

    fn typed(&mut self, what: &str, ty: Handle<Type>) {
        self.word(what);
        self.ty(ty);
    }

    /// Debug text without its handles (`[12]`): the variant and its constants.
    fn without_handles(&mut self, debug: fmt::Arguments<'_>) {
        self.debug.clear();
        let _ = self.debug.write_fmt(debug);
        let mut rest = self.debug.as_str();
        while let Some(open) = rest.find('[') {
            let _ = self.hash.write_str(&rest[..=open]);
            rest = &rest[open + 1..];
            let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
            if rest[digits..].starts_with(']') {
                rest = &rest[digits..];
            }
        }
        let _ = self.hash.write_str(rest);
    }

    fn constant(&mut self, constant: Handle<naga::Constant>) {
        let module = self.module;
        let mut stack = vec![module.constants[constant].init];
        while let Some(e) = stack.pop() {
            let expression = &module.global_expressions[e];
            match expression {
                Expression::Constant(c) => self.constant(*c),
                Expression::ZeroValue(ty) => self.ty(*ty),
                other => self.without_handles(format_args!("{other:?}")),
            }
            stack.extend(naga_operands::of_expression(expression));
        }
    }

    fn ty(&mut self, ty: Handle<Type>) {
        let module = self.module;
        match &module.types[ty].inner {
            TypeInner::Struct { members, .. } => {
                for (i, m) in members.iter().enumerate() {
                    let before = if i == 0 { "{" } else { ", " };
                    let _ = write!(self.hash, "{before}{:?} ", m.binding);
                    self.ty(m.ty);
                }
                self.word("}");
            }
            TypeInner::Array { base, size, .. } => {
                let _ = write!(self.hash, "array {size:?} ");
                self.ty(*base);
            }
            TypeInner::BindingArray { base, size } => {
                let _ = write!(self.hash, "binding array {size:?} ");
                self.ty(*base);
            }
            TypeInner::Pointer { base, space } => {
                let _ = write!(self.hash, "ptr {space:?} ");
                self.ty(*base);
            }
            inner => {
                let _ = write!(self.hash, "{inner:?}");
            }
        }
    }
}
