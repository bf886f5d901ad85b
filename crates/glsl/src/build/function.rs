//! Functions and statements.

use std::collections::HashSet;

use naga::proc::ensure_block_returns;
use naga::{
    AddressSpace, Block, Expression, Function as IrFunction, FunctionArgument, FunctionResult,
    GlobalVariable, Handle, ScalarKind, Span, Statement as Ir, StorageAccess, SwitchCase,
    SwitchValue, Type, TypeInner, UnaryOperator,
};

use super::expression::Position;
use super::{Body, Builder, Declared, Value};
use crate::built_in_variables::Variable;
use crate::tree::{
    Case, Function, FunctionId, GlobalId, GlobalKind, Kind, LocalId, Node, ParameterTy, Statement,
    StatementKind as S,
};
use crate::ty::Ty;
use shader_text::error::Error;

/// The globals and block members that a function uses.
#[derive(Default)]
struct Used<'s> {
    globals: HashSet<GlobalId>,
    members: HashSet<(GlobalId, &'s str)>,
}

impl<'s> Used<'s> {
    fn add(&mut self, node: &'s Node) {
        match &*node.kind {
            Kind::Global(id) => {
                self.globals.insert(*id);
            }
            Kind::Field(of, name) => {
                if let Kind::Global(id) = *of.kind {
                    self.members.insert((id, name));
                }
            }
            _ => {}
        }
    }
}

impl<'s> Builder<'s> {
    pub(super) fn function(&mut self, id: FunctionId, of: &'s Function) -> Result<(), Error> {
        let span = of.span;
        let result = match &of.result {
            Ty::Void => None,
            ty => Some(FunctionResult {
                ty: self.ty(ty, span)?,
                binding: None,
            }),
        };
        let function = IrFunction {
            name: Some(of.name.clone()),
            result,
            ..IrFunction::default()
        };
        let mut body = Body::new(self, function);
        body.span = span;
        body.declare_globals(of)?;
        body.parameters(id, of)?;
        body.statements(&of.body)?;
        let mut function = body.writer.finish();
        ensure_block_returns(&mut function.body);
        let handle = self.module.functions.append(function, span);
        self.functions.insert(id, handle);
        Ok(())
    }
}

impl<'s> Body<'_, 's> {
    /// Appends pointers to the globals that the function uses.
    fn declare_globals(&mut self, of: &'s Function) -> Result<(), Error> {
        let mut used = Used::default();
        for statement in &of.body {
            statement.visit(&mut |node| used.add(node));
        }
        let stage = self.builder.stage;
        let own = self.builder.own.clone();
        let (before, after) = own.split_at(usize::from(stage.invariant).min(own.len()));
        self.declare_own(before)?;
        for id in stage.declared.iter().filter(|id| used.globals.contains(id)) {
            let Some(declared) = self.builder.globals.get(id).copied() else {
                continue;
            };
            let global = &stage.globals[id.0];
            let e = match declared {
                Declared::Variable(handle) => Expression::GlobalVariable(handle),
                Declared::Constant(handle, _) => Expression::Constant(handle),
                Declared::Override(handle) => Expression::Override(handle),
            };
            let e = self.add_at(e, global.span)?;
            self.globals.insert(*id, e);
            let GlobalKind::Block(block) = &global.kind else {
                continue;
            };
            for (index, member) in (0..).zip(&block.members).filter(|_| block.is_open) {
                let name = member.name.as_str();
                if used.members.contains(&(*id, name)) {
                    let pointer = Expression::AccessIndex { base: e, index };
                    let pointer = self.add_at(pointer, global.span)?;
                    self.members.insert((*id, name), pointer);
                }
            }
        }
        self.declare_own(after)
    }

    fn declare_own(
        &mut self,
        own: &[(&'static Variable, Handle<GlobalVariable>)],
    ) -> Result<(), Error> {
        for (own, global) in own {
            let pointer = Expression::GlobalVariable(*global);
            let pointer = self.add_at(pointer, Span::UNDEFINED)?;
            self.own.insert(own.first_name(), pointer);
        }
        Ok(())
    }

    fn parameters(&mut self, id: FunctionId, of: &'s Function) -> Result<(), Error> {
        for (i, parameter) in of.parameters.iter().enumerate() {
            let span = parameter.span;
            self.span = span;
            let base = match &parameter.ty {
                ParameterTy::Data(ty) => self.glsl_ty(ty)?,
                ParameterTy::Handle(ty) => {
                    let mut ty = ty.clone();
                    ty.compares |= self.builder.comparing.has_parameter(id, i);
                    let access = StorageAccess::LOAD | StorageAccess::STORE;
                    self.builder.handle(&ty, None, access, span)?
                }
            };
            let ty = match parameter.is_out {
                true => self.builder.insert(TypeInner::Pointer {
                    base,
                    space: AddressSpace::Function,
                }),
                false => base,
            };
            self.writer.function.arguments.push(FunctionArgument {
                name: Some(parameter.name.clone()),
                ty,
                binding: None,
            });
            let argument = self.add(Expression::FunctionArgument(i as u32))?;
            let is_value = matches!(parameter.ty, ParameterTy::Data(_)) && !parameter.is_out;
            if !is_value || of.is_plain {
                self.parameters.push((argument, parameter.is_out));
                continue;
            }
            // The function may write the parameter.
            let name = Some(parameter.name.clone());
            let pointer = self.local(name, base, None, span)?;
            self.store_at(pointer, argument);
            self.parameters.push((pointer, true));
        }
        // Statements without a span are not in the author's text.
        self.span = Span::UNDEFINED;
        Ok(())
    }

    /// Creates globals for the built-in variables that first occur here.
    fn register(&mut self, node: &'s Node) -> Result<(), Error> {
        let mut own = Vec::new();
        node.visit(&mut |node| {
            if let Kind::BuiltIn(of) = *node.kind {
                own.push(of);
            }
        });
        for own in own {
            if !self.own.contains_key(own.first_name()) {
                let global = self.builder.register(own)?;
                self.declare_own(&[(own, global)])?;
            }
        }
        Ok(())
    }

    fn root(&mut self, node: &'s Node) -> Result<Value, Error> {
        self.register(node)?;
        self.value(node)
    }

    pub(super) fn statements(&mut self, all: &'s [Statement]) -> Result<(), Error> {
        for statement in all {
            self.statement(statement)?;
            if statement.leaves() {
                break;
            }
        }
        Ok(())
    }

    /// Writes statements to a new block.
    fn block(&mut self, all: &'s [Statement]) -> Result<Block, Error> {
        let enclosing = self.open();
        self.statements(all)?;
        Ok(self.close(enclosing))
    }

    fn statement(&mut self, statement: &'s Statement) -> Result<(), Error> {
        let span = match statement.span.is_defined() {
            true => statement.span,
            false => self.span,
        };
        let around = std::mem::replace(&mut self.span, span);
        self.statement_at(statement)?;
        self.span = around;
        Ok(())
    }

    fn statement_at(&mut self, statement: &'s Statement) -> Result<(), Error> {
        let ir = match &statement.kind {
            S::Declare(local, init) => {
                let of = &self.builder.stage.locals[local.0];
                let ty = self.glsl_ty(&of.ty)?;
                let init = match init {
                    Some(init) => Some(self.root(init)?),
                    None => None,
                };
                // A variable in a loop is initialised in each iteration.
                let is_initial = |e| !self.in_loop && self.known.is_const(e);
                let (initial, late) = match init {
                    Some(e) if is_initial(e) => (Some(e), None),
                    init => (None, init),
                };
                let pointer = self.declare(*local, ty, initial)?;
                match late {
                    Some(value) => Ir::Store { pointer, value },
                    None => return Ok(()),
                }
            }
            S::Evaluate(node) => {
                self.register(node)?;
                self.evaluate(node, Position::Value)?;
                return Ok(());
            }
            S::Block(inner) => Ir::Block(self.block(inner)?),
            S::If {
                condition,
                accept,
                reject,
            } => {
                let condition = self.root(condition)?;
                let accept = self.inner(accept)?;
                let reject = match reject {
                    Some(reject) => self.inner(reject)?,
                    None => Block::new(),
                };
                Ir::If {
                    condition,
                    accept,
                    reject,
                }
            }
            S::Switch { selector, cases } => self.switch(selector, cases)?,
            S::While { condition, body } => {
                let enclosing = self.open();
                self.break_unless(condition)?;
                self.looped(body)?;
                endless(self.close(enclosing), Block::new())
            }
            S::DoWhile { body, condition } => {
                let enclosing = self.open();
                self.looped(body)?;
                if !body.iter().any(Statement::leaves) {
                    self.break_unless(condition)?;
                }
                endless(self.close(enclosing), Block::new())
            }
            S::For {
                init,
                condition,
                step,
                body,
            } => {
                if let Some(init) = init {
                    self.statement(init)?;
                }
                let enclosing = self.open();
                if let Some(condition) = condition {
                    self.break_unless(condition)?;
                }
                let inner = self.close(enclosing);
                let enclosing = self.open();
                if let Some(step) = step {
                    self.register(step)?;
                    self.evaluate(step, Position::Value)?;
                }
                let continuing = self.close(enclosing);
                let enclosing = self.writer.reopen(inner, self.span);
                self.looped(body)?;
                endless(self.close(enclosing), continuing)
            }
            S::Break => Ir::Break,
            S::Continue => Ir::Continue,
            S::Discard => Ir::Kill,
            S::Return(value) => {
                let value = match value {
                    Some(value) => Some(self.root(value)?),
                    None => None,
                };
                Ir::Return { value }
            }
        };
        self.push(ir);
        Ok(())
    }

    fn declare(
        &mut self,
        local: LocalId,
        ty: Handle<Type>,
        init: Option<Value>,
    ) -> Result<Value, Error> {
        let name = self.builder.stage.locals[local.0].name.clone();
        let pointer = self.local(Some(name), ty, init, self.span)?;
        self.locals.insert(local, pointer);
        Ok(pointer)
    }

    /// A nested block, as for braces in the text.
    fn inner(&mut self, all: &'s [Statement]) -> Result<Block, Error> {
        let enclosing = self.open();
        let block = self.block(all)?;
        self.push(Ir::Block(block));
        Ok(self.close(enclosing))
    }

    /// The body of a loop.
    fn looped(&mut self, body: &'s [Statement]) -> Result<(), Error> {
        let around = std::mem::replace(&mut self.in_loop, true);
        let block = self.block(body)?;
        self.push(Ir::Block(block));
        self.in_loop = around;
        Ok(())
    }

    fn break_unless(&mut self, condition: &'s Node) -> Result<(), Error> {
        let span = self.place(condition);
        let expr = self.root(condition)?;
        let op = UnaryOperator::LogicalNot;
        let condition = self.add_at(Expression::Unary { op, expr }, span)?;
        let mut accept = Block::new();
        accept.push(Ir::Break, Span::UNDEFINED);
        let exit = Ir::If {
            condition,
            accept,
            reject: Block::new(),
        };
        self.writer.statement(exit, Span::UNDEFINED);
        Ok(())
    }

    fn switch(&mut self, selector: &'s Node, all: &'s [Case]) -> Result<Ir, Error> {
        let selector = self.root(selector)?;
        let is_uint = self.ty(selector)?.scalar_kind() == Some(ScalarKind::Uint);
        let mut cases = Vec::new();
        for (at, case) in all.iter().enumerate() {
            let value = match case.value {
                None => SwitchValue::Default,
                Some(n) if is_uint => SwitchValue::U32(n as u32),
                Some(n) => SwitchValue::I32(n as i32),
            };
            let last = case.body.iter().position(Statement::leaves);
            let reached = &case.body[..last.map_or(case.body.len(), |last| last + 1)];
            let (reached, breaks) = match reached.split_last() {
                Some((last, before)) if matches!(last.kind, S::Break) => (before, true),
                _ => (reached, false),
            };
            let is_last = at + 1 == all.len();
            // Later cases may use a declaration even if its case is not reached.
            let unreached = &case.body[last.map_or(case.body.len(), |last| last + 1)..];
            let enclosing = self.open();
            for statement in unreached {
                if let S::Declare(local, _) = &statement.kind {
                    let ty = self.glsl_ty(&self.builder.stage.locals[local.0].ty)?;
                    self.declare(*local, ty, None)?;
                }
            }
            self.statements(reached)?;
            cases.push(SwitchCase {
                value,
                body: self.close(enclosing),
                fall_through: !breaks && !is_last,
            });
        }
        if all.iter().all(|case| case.value.is_some()) {
            cases.push(SwitchCase {
                value: SwitchValue::Default,
                body: Block::new(),
                fall_through: false,
            });
        }
        Ok(Ir::Switch { selector, cases })
    }
}

fn endless(body: Block, continuing: Block) -> Ir {
    Ir::Loop {
        body,
        continuing,
        break_if: None,
    }
}
