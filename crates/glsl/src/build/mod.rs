//! Converts a resolved stage to IR.
//!
//! `types` makes types, `entry` globals and the entry point, `function` functions and their
//! statements. `expression` handles expressions, with `operator`, `constructor`, `call`,
//! `built_in_functions` and `texture`. All expressions go through [`Body::add`], which folds
//! constants by GLSL's rules.

mod atomic;
mod built_in_functions;
mod call;
mod comparing;
mod constructor;
mod entry;
mod expression;
mod function;
mod operator;
mod texture;
mod types;

use std::collections::HashMap;

use naga::front::Typifier;
use naga::proc::{
    ConstantEvaluator, ExpressionKind, ExpressionKindTracker, Layouter, ResolveContext,
};
use naga::{
    BinaryOperator, Binding, Block, Expression, Function as IrFunction, GlobalVariable, Handle,
    Literal, Module, Scalar, ShaderStage, Span, Statement, Type, TypeInner, VectorSize,
};
use naga_edit::writer::FunctionWriter;

use self::comparing::Comparing;
use super::tree::{FunctionId, GlobalId, LocalId, Stage};
use crate::built_in_variables::Variable;
use crate::errors::wrong;
use crate::ty::Ty;
use shader_text::error::Error;

type Value = Handle<Expression>;

/// The representation of a global in the IR.
#[derive(Clone, Copy, Debug)]
enum Declared {
    Variable(Handle<GlobalVariable>),
    Constant(Handle<naga::Constant>, Handle<Type>),
    Override(Handle<naga::Override>),
}

/// An input or output of the entry point.
#[derive(Clone, Debug)]
struct Port {
    global: Handle<GlobalVariable>,
    name: String,
    binding: Binding,
    is_output: bool,
}

pub(super) struct Builder<'s> {
    stage: &'s Stage,
    kind: ShaderStage,
    module: Module,
    layouter: Layouter,
    /// The kinds and types of the module's constant expressions.
    known: ExpressionKindTracker,
    types: Typifier,
    structs: HashMap<&'s str, Handle<Type>>,
    globals: HashMap<GlobalId, Declared>,
    /// Built-in variables that have been used.
    own: Vec<(&'static Variable, Handle<GlobalVariable>)>,
    ports: Vec<Port>,
    functions: HashMap<FunctionId, Handle<IrFunction>>,
    comparing: Comparing,
    /// The parts of storage blocks that are targets of atomic functions.
    atomics: Vec<atomic::PartOfVariable>,
    /// The images that are targets of atomic functions.
    atomic_images: Vec<Handle<GlobalVariable>>,
}

/// Converts a stage. Its entry point calls `main`.
pub(super) fn build(stage: &Stage, kind: ShaderStage) -> Result<Module, Error> {
    let mut builder = Builder {
        stage,
        kind,
        module: Module::default(),
        layouter: Layouter::default(),
        known: ExpressionKindTracker::new(),
        types: Typifier::new(),
        structs: HashMap::new(),
        globals: HashMap::new(),
        own: Vec::new(),
        ports: Vec::new(),
        functions: HashMap::new(),
        comparing: Comparing::of(stage),
        atomics: Vec::new(),
        atomic_images: Vec::new(),
    };
    builder.structs()?;
    builder.globals()?;
    for id in &stage.order {
        if let Some(Some(function)) = stage.functions.get(id.0) {
            builder.function(*id, function)?;
        }
    }
    builder.entry_point()?;
    builder.atomics()?;
    Ok(builder.module)
}

/// A function under construction, or a constant.
struct Body<'b, 's> {
    builder: &'b mut Builder<'s>,
    writer: FunctionWriter,
    types: Typifier,
    /// The kinds of the function's expressions.
    known: ExpressionKindTracker,
    globals: HashMap<GlobalId, Value>,
    /// Members of blocks without an instance name.
    members: HashMap<(GlobalId, &'s str), Value>,
    own: HashMap<&'static str, Value>,
    locals: HashMap<LocalId, Value>,
    /// The value or pointer of each parameter, and whether it is a pointer.
    parameters: Vec<(Value, bool)>,
    /// Whether a constant of the module is being written.
    is_const: bool,
    in_loop: bool,
    /// The span of the enclosing expression.
    span: Span,
}

impl<'b, 's> Body<'b, 's> {
    fn new(builder: &'b mut Builder<'s>, function: IrFunction) -> Self {
        Self {
            builder,
            writer: FunctionWriter::of(function),
            types: Typifier::new(),
            known: ExpressionKindTracker::new(),
            globals: HashMap::new(),
            members: HashMap::new(),
            own: HashMap::new(),
            locals: HashMap::new(),
            parameters: Vec::new(),
            is_const: false,
            in_loop: false,
            span: Span::UNDEFINED,
        }
    }

    /// Appends an expression. If it is constant, appends its value instead.
    fn add(&mut self, expression: Expression) -> Result<Value, Error> {
        self.add_at(expression, self.span)
    }

    /// As [`Self::add`], with another span.
    fn add_at(&mut self, expression: Expression, span: Span) -> Result<Value, Error> {
        let Builder {
            module,
            layouter,
            known,
            ..
        } = &mut *self.builder;
        let added = match self.is_const {
            true => ConstantEvaluator::for_glsl_module(module, known, layouter)
                .try_eval_and_append(expression, span),
            false => self
                .writer
                .fold(expression, span, module, &mut self.known, layouter),
        };
        added.map_err(|error| refused(&error.to_string(), span))
    }

    fn load(&mut self, pointer: Value) -> Result<Value, Error> {
        self.add(Expression::Load { pointer })
    }

    /// An element, a component or a member, of a value or a pointer.
    fn part(&mut self, base: Value, index: u32) -> Result<Value, Error> {
        self.add(Expression::AccessIndex { base, index })
    }

    fn parts(&mut self, base: Value, n: u32) -> Result<Vec<Value>, Error> {
        (0..n).map(|index| self.part(base, index)).collect()
    }

    fn binary_of(&mut self, op: BinaryOperator, left: Value, right: Value) -> Result<Value, Error> {
        self.add(Expression::Binary { op, left, right })
    }

    fn compose(&mut self, ty: Handle<Type>, components: Vec<Value>) -> Result<Value, Error> {
        self.add(Expression::Compose { ty, components })
    }

    /// An expression whose value comes from a statement.
    fn unevaluated(&mut self, of: Expression) -> Value {
        self.writer.flush(self.span);
        let result = self.writer.append(of, self.span);
        self.known.insert(result, ExpressionKind::Runtime);
        result
    }

    fn push(&mut self, statement: Statement) {
        self.writer.statement(statement, self.span);
    }

    fn store_at(&mut self, pointer: Value, value: Value) {
        self.push(Statement::Store { pointer, value });
    }

    /// Begins a block, and returns the enclosing one.
    fn open(&mut self) -> Block {
        self.writer.open(self.span)
    }

    /// Ends a block, and returns to the enclosing one.
    fn close(&mut self, enclosing: Block) -> Block {
        self.writer.close(enclosing, self.span)
    }

    /// A vector with a scalar in all components.
    fn splat(&mut self, size: VectorSize, value: Value) -> Result<Value, Error> {
        self.add(Expression::Splat { size, value })
    }

    fn literal(&mut self, literal: Literal) -> Result<Value, Error> {
        self.add(Expression::Literal(literal))
    }

    fn glsl_ty(&mut self, ty: &Ty) -> Result<Handle<Type>, Error> {
        self.builder.ty(ty, self.span)
    }

    fn vector_ty(&mut self, size: VectorSize, scalar: Scalar) -> Handle<Type> {
        self.builder.insert(TypeInner::Vector { size, scalar })
    }

    fn refused(&self, text: &str) -> Error {
        refused(text, self.span)
    }

    /// The type of an expression.
    fn ty(&mut self, e: Value) -> Result<&TypeInner, Error> {
        self.resolve(e)?;
        Ok(self.known_ty(e))
    }

    /// The type of an expression that has been resolved.
    fn known_ty(&self, e: Value) -> &TypeInner {
        let types = match self.is_const {
            true => &self.builder.types,
            false => &self.types,
        };
        types.get(e, &self.builder.module.types)
    }

    fn resolve(&mut self, e: Value) -> Result<(), Error> {
        let function = &self.writer.function;
        let Builder { module, types, .. } = &mut *self.builder;
        let locals = &function.local_variables;
        let context = ResolveContext::with_locals(module, locals, &function.arguments);
        let grown = match self.is_const {
            true => types.grow(e, &module.global_expressions, &context),
            false => self.types.grow(e, &function.expressions, &context),
        };
        grown.map_err(|_| refused(WRONG_TYPE, self.span))
    }

    /// The type of an expression as a type of the module.
    fn ty_handle(&mut self, e: Value) -> Result<Handle<Type>, Error> {
        self.resolve(e)?;
        let Builder { module, types, .. } = &mut *self.builder;
        let types = if self.is_const {
            types
        } else {
            &mut self.types
        };
        Ok(types.register_type(e, &mut module.types))
    }

    /// An expression of the current arena.
    fn expression(&self, e: Value) -> &Expression {
        match self.is_const {
            true => &self.builder.module.global_expressions[e],
            false => &self.writer.function.expressions[e],
        }
    }
}

const WRONG_TYPE: &str = "this type is wrong here, or not supported";

/// naga's message as an error. Leaves out messages that are meant for naga's developers.
fn refused(text: &str, span: Span) -> Error {
    let numbered = text.split('[').skip(1).any(|rest| {
        let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
        digits > 0 && rest[digits..].starts_with(']')
    });
    let message = match numbered || text.contains('{') {
        true => WRONG_TYPE,
        false => text,
    };
    wrong(message, span.is_defined().then_some(span))
}
