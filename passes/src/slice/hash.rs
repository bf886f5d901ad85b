//! A canonical form of a slice and its hash.

use std::collections::BTreeMap;
use std::fmt::Write;

use naga::{Expression, Handle, LocalVariable, Module, Statement, Type, TypeInner};

use super::Slice;
use crate::graph::{FunctionGraph, Graph, StmtId, operands};

/// FNV-1a, 64 bits: stable across platforms and releases, which is all that is asked of it.
fn fnv(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3)
    })
}

/// 16 hex digits over the functions of a slice in order: expressions numbered as they are first evaluated, variables as they are first used,
/// globals by binding, types by structure; no names, no spans.
pub fn canonical(graph: &Graph<'_>, slice: &Slice) -> String {
    let mut text = format!("{:?} {:?}\n", slice.stage, slice.outputs);
    for part in &slice.parts {
        let mut writer = Writer {
            module: graph.module(),
            f: graph.function(part.function),
            numbers: BTreeMap::new(),
            locals: BTreeMap::new(),
            text: String::new(),
        };
        let _ = writeln!(writer.text, "fn {:?}", part.demand.result);
        for (id, node) in writer.f.statements.iter() {
            if part.kept.statements[id.index()] {
                let depth = writer.f.statements.ancestors(id).count();
                let callee = part.calls.get(&id).copied();
                writer.statement(id, node.statement, depth, callee, part);
            }
        }
        text.push_str(&writer.text);
    }
    format!("{:016x}", fnv(&text))
}

struct Writer<'a, 'p> {
    module: &'a Module,
    f: &'a FunctionGraph<'p>,
    numbers: BTreeMap<Handle<Expression>, usize>,
    locals: BTreeMap<Handle<LocalVariable>, usize>,
    text: String,
}

/// Debug text with the handles (`[12]`) taken out: what is left says which variant with which constants.
fn without_handles(debug: &str) -> String {
    let mut out = String::with_capacity(debug.len());
    let mut rest = debug;
    while let Some(open) = rest.find('[') {
        out.push_str(&rest[..=open]);
        rest = &rest[open + 1..];
        let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
        if rest[digits..].starts_with(']') {
            rest = &rest[digits..];
        }
    }
    out.push_str(rest);
    out
}

impl Writer<'_, '_> {
    fn statement(
        &mut self,
        id: StmtId,
        statement: &Statement,
        depth: usize,
        callee: Option<usize>,
        part: &super::Part,
    ) {
        if let Statement::Emit(range) = statement {
            for e in range.clone() {
                if part.kept.expressions[e.index()].is_some() {
                    self.number(e);
                }
            }
            return;
        }
        let in_block = self.f.statements.get(id).parent.map(|p| {
            // Which of the parent's blocks: one statement may be in either arm of an `If`.
            let mut at = p.index() + 1;
            operands::blocks(self.f.statements.get(p).statement)
                .iter()
                .position(|b| {
                    for _ in b.iter() {
                        at = self.f.statements.get(StmtId::from(at)).end.index();
                    }
                    id.index() < at
                })
        });
        let shell = match statement {
            Statement::Switch { cases, .. } => format!(
                "Switch {:?}",
                cases
                    .iter()
                    .map(|c| (c.value, c.fall_through))
                    .collect::<Vec<_>>()
            ),
            Statement::Return { .. } => "Return".to_owned(),
            other => without_handles(&format!("{:?}", operands::shell(other))),
        };
        let kept: Vec<String> = operands::of_statement(statement)
            .into_iter()
            .map(|e| {
                if part.kept.expressions[e.index()].is_some() {
                    self.number(e).to_string()
                } else {
                    "_".to_owned()
                }
            })
            .collect();
        let _ = writeln!(
            self.text,
            "{depth} {in_block:?} {shell} {kept:?} {callee:?}"
        );
        if let Some(result) = operands::result(statement) {
            let next = self.numbers.len();
            self.numbers.insert(result, next);
        }
    }

    fn number(&mut self, e: Handle<Expression>) -> usize {
        if let Some(n) = self.numbers.get(&e) {
            return *n;
        }
        let expression = &self.f.function.expressions[e];
        let operands: Vec<usize> = operands::of_expression(expression)
            .into_iter()
            .map(|o| self.number(o))
            .collect();
        let what = match expression {
            Expression::Constant(c) => self.constant(*c),
            Expression::Override(o) => format!("override {:?}", self.module.overrides[*o].id),
            Expression::ZeroValue(ty) => format!("zero {}", self.ty(*ty)),
            Expression::Compose { ty, .. } => format!("compose {}", self.ty(*ty)),
            Expression::GlobalVariable(g) => {
                let global = &self.module.global_variables[*g];
                format!(
                    "global {:?} {:?} {}",
                    global.space,
                    global.binding,
                    self.ty(global.ty)
                )
            }
            Expression::LocalVariable(v) => {
                let next = self.locals.len();
                let n = *self.locals.entry(*v).or_insert(next);
                let variable = &self.f.function.local_variables[*v];
                let init = variable.init.map(|i| self.number(i));
                format!("local {n} {} {init:?}", self.ty(variable.ty))
            }
            Expression::AtomicResult { ty, .. }
            | Expression::WorkGroupUniformLoadResult { ty }
            | Expression::SubgroupOperationResult { ty } => format!("result {}", self.ty(*ty)),
            Expression::CallResult(_) => "call".to_owned(),
            other => without_handles(&format!("{other:?}")),
        };
        let n = self.numbers.len();
        let _ = writeln!(self.text, "{n} = {what} {operands:?}");
        self.numbers.insert(e, n);
        n
    }

    fn constant(&self, constant: Handle<naga::Constant>) -> String {
        let mut text = String::new();
        let mut stack = vec![self.module.constants[constant].init];
        while let Some(e) = stack.pop() {
            let expression = &self.module.global_expressions[e];
            match expression {
                Expression::Constant(c) => text.push_str(&self.constant(*c)),
                Expression::ZeroValue(ty) => text.push_str(&self.ty(*ty)),
                other => text.push_str(&without_handles(&format!("{other:?}"))),
            }
            stack.extend(operands::of_expression(expression));
        }
        text
    }

    fn ty(&self, ty: Handle<Type>) -> String {
        match &self.module.types[ty].inner {
            TypeInner::Struct { members, .. } => {
                let members: Vec<String> = members
                    .iter()
                    .map(|m| format!("{:?} {}", m.binding, self.ty(m.ty)))
                    .collect();
                format!("{{{}}}", members.join(", "))
            }
            TypeInner::Array { base, size, .. } => format!("array {size:?} {}", self.ty(*base)),
            TypeInner::BindingArray { base, size } => {
                format!("binding array {size:?} {}", self.ty(*base))
            }
            TypeInner::Pointer { base, space } => format!("ptr {space:?} {}", self.ty(*base)),
            inner => format!("{inner:?}"),
        }
    }
}
