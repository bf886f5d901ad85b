//! Keeps what a program means where naga's GLSL writer writes something else.
//!
//! | the program | naga writes | here |
//! |---|---|---|
//! | `continuing` and `break_if` read a value of the body | the value's expression, ahead of the body, over variables that have changed | a local variable keeps the value |
//! | `/`, `%`, `<<`, `>>` of integers, and floats made integers | GLSL's own, undefined for some operands | WGSL's result by operations that GLSL defines ([`arithmetic`]) |
//! | `pack4xU8` and its like | `a \| b \| c` without parentheses | a temporary |
//! | `atomicSub` | a minus sign ahead of the operand's text | `atomicAdd` of a difference |
//! | `textureSampleBaseClampToEdge` | a plain sample | one whose coordinates are clamped |
//! | `abs` of a `u32` | `abs` of the `int` of its bits | the value |
//! | `countLeadingZeros` and `frexp` in ES, `unpack4x8snorm`, `unpack2x16snorm` where the version lacks them | rounded logarithms; quotients below -1 | exact steps; their maximum with -1 |
//!
//! The text is GLSL's, so a GLSL author's own arithmetic stays as it is.

mod arithmetic;
mod continuing;
mod range;

use std::collections::BTreeMap;

use naga::valid::FunctionInfo;
use naga::{
    AtomicFunction, BinaryOperator, Expression, Function, Handle, ImageQuery, Literal,
    MathFunction, Module, Scalar, ScalarKind, Span, Statement, Type, TypeInner, UniqueArena,
    VectorSize,
};
use naga_edit::copy::{CopyFunction, Copying};
use naga_edit::writer::FunctionWriter;
use naga_interp::interval::Interval;
use preshade_plan::program::Program;
use shader_text::source::{Invalid, Language};

use crate::wgsl::deep_expressions;
use preshade_plan::plan_file::Target;

/// A program whose text by naga means the same as `program`. `None` if that is `program` itself.
///
/// # Errors
/// A bug of ours.
pub(super) fn kept(program: &Program, target: Target) -> Result<Option<Program>, Box<Invalid>> {
    let module = program.module();
    let info = program.info();
    let mut types = module.types.clone();
    let mut out = module.clone();
    let mut is_changed = false;
    let mut rewrite = |function: &Function, info: &FunctionInfo| {
        let mut keep = Keep::new(module, function, info, &mut types);
        keep.language = program.language();
        keep.target = target;
        let written = keep.written()?;
        is_changed = true;
        Some(written)
    };
    for (handle, function) in module.functions.iter() {
        if let Some(written) = rewrite(function, &info[handle]) {
            out.functions[handle] = written;
        }
    }
    for (i, entry) in module.entry_points.iter().enumerate() {
        if let Some(written) = rewrite(&entry.function, info.get_entry_point(i)) {
            out.entry_points[i].function = written;
        }
    }
    out.types = types;
    if !is_changed {
        return Ok(None);
    }
    let kept = program.with_module(out)?;
    // The operations here nest deeper than the program's.
    match deep_expressions::name_deep_expressions(&kept) {
        Some(named) => kept.with_module(named).map(Some),
        None => Ok(Some(kept)),
    }
}

/// A function that is being copied.
struct Keep<'a> {
    copying: Copying<'a>,
    module: &'a Module,
    info: &'a FunctionInfo,
    types: &'a mut UniqueArena<Type>,
    language: Language,
    target: Target,
    /// Whether a statement evaluates each expression.
    is_evaluated: Vec<bool>,
    /// The range of each expression of the original.
    ranges: Vec<Interval>,
    /// The variable of each value that a `continuing` block reads.
    kept: BTreeMap<Handle<Expression>, Handle<Expression>>,
    is_changed: bool,
}

impl<'a> CopyFunction<'a> for Keep<'a> {
    fn copying(&mut self) -> &mut Copying<'a> {
        &mut self.copying
    }

    fn expression(&mut self, e: Handle<Expression>) {
        if self.is_evaluated[e.index()] {
            let rewritten = self.rewritten(e);
            if let Some(copy) = rewritten {
                self.copying.copies.insert(e, copy);
                self.is_changed = true;
                return;
            }
            // An operation of ours may have ended the `Emit`.
            if !self.copying.original.expressions[e].needs_pre_emit() && !self.is_result(e) {
                self.copying.writer.begin();
            }
        }
        let copy = self.copied_expression(e);
        self.copying.append(e, copy);
    }

    fn statement(&mut self, statement: &'a Statement, span: Span) {
        match statement {
            Statement::Loop {
                body,
                continuing,
                break_if,
            } => self.looped(body, continuing, *break_if, span),
            Statement::Atomic {
                fun: AtomicFunction::Subtract,
                value,
                ..
            } => {
                let copy = self.copied(statement, span);
                let copy = self.added(copy, *value);
                self.copying.writer.statement(copy, span);
            }
            _ => {
                let copy = self.copied(statement, span);
                self.copying.writer.statement(copy, span);
            }
        }
    }

    fn copy(&mut self, statement: &'a Statement, span: Span) {
        match statement {
            Statement::Emit(range) => {
                self.emit(range.clone(), span);
                range.clone().for_each(|e| self.keep(e, span));
            }
            _ => {
                self.statement(statement, span);
                if let Some(result) = naga_operands::result(statement) {
                    self.keep(result, span);
                }
            }
        }
    }
}

impl<'a> Keep<'a> {
    fn new(
        module: &'a Module,
        function: &'a Function,
        info: &'a FunctionInfo,
        types: &'a mut UniqueArena<Type>,
    ) -> Self {
        let mut is_evaluated = vec![false; function.expressions.len()];
        naga_operands::evaluated(&function.body, &mut |e| is_evaluated[e.index()] = true);
        Self {
            copying: Copying::new(function, FunctionWriter::like(function)),
            module,
            info,
            types,
            language: Language::Wgsl,
            target: Target::Glsl450,
            is_evaluated,
            ranges: range::of(module, function, info),
            kept: BTreeMap::new(),
            is_changed: false,
        }
    }

    /// The function, if it is another one.
    fn written(mut self) -> Option<Function> {
        self.unevaluated();
        self.copying.initialisers();
        let body = &self.copying.original.body;
        self.block(body);
        self.is_changed.then(|| self.copying.finish())
    }

    fn inner(&self, e: Handle<Expression>) -> &'a TypeInner {
        self.info[e].ty.inner_with(&self.module.types)
    }

    fn is_result(&self, e: Handle<Expression>) -> bool {
        matches!(
            self.copying.original.expressions[e],
            Expression::CallResult(_)
                | Expression::AtomicResult { .. }
                | Expression::WorkGroupUniformLoadResult { .. }
                | Expression::SubgroupBallotResult
                | Expression::SubgroupOperationResult { .. }
                | Expression::RayQueryProceedResult
        )
    }

    fn range(&self, e: Handle<Expression>) -> Interval {
        self.ranges[e.index()]
    }

    /// The expression with copies of its operands.
    fn copied_expression(&self, e: Handle<Expression>) -> Expression {
        let original = &self.copying.original.expressions[e];
        self.copying.copies.with_operands(original)
    }

    fn copy_of(&self, e: Handle<Expression>) -> Handle<Expression> {
        self.copying.copies.mapped(e)
    }

    /// Another expression with the value of `e`.
    fn rewritten(&mut self, e: Handle<Expression>) -> Option<Handle<Expression>> {
        match self.copying.original.expressions[e] {
            Expression::Binary { op, left, right } => self.operation(op, left, right),
            Expression::As {
                expr,
                kind,
                convert: Some(4),
            } => self.integer_of(expr, kind),
            Expression::Math { fun, arg, .. } => self.function(e, fun, arg),
            Expression::ImageSample {
                image,
                coordinate,
                clamp_to_edge: true,
                ..
            } => Some(self.clamped_to_edge(e, image, coordinate)),
            _ => None,
        }
    }

    fn function(
        &mut self,
        e: Handle<Expression>,
        fun: MathFunction,
        arg: Handle<Expression>,
    ) -> Option<Handle<Expression>> {
        use MathFunction as M;
        let (shape, scalar) = shape(self.inner(arg))?;
        let is_es = matches!(self.target, Target::GlslEs300 | Target::GlslEs100);
        match fun {
            M::Pack4xU8 | M::Pack4xU8Clamp => {
                let copy = self.copied_expression(e);
                let copy = self.write(copy);
                let names = &mut self.copying.writer.function.named_expressions;
                names.insert(copy, "word".to_owned());
                Some(copy)
            }
            M::Abs if scalar.kind == ScalarKind::Uint => Some(self.copy_of(arg)),
            M::Frexp if is_es => self.fraction_and_exponent(e, shape, arg),
            M::CountLeadingZeros if is_es => Some(self.leading_zeros(shape, scalar, arg)),
            M::Unpack4x8snorm if is_es => {
                Some(self.not_below_minus_one(fun, arg, VectorSize::Quad))
            }
            M::Unpack2x16snorm if self.target == Target::GlslTess => {
                Some(self.not_below_minus_one(fun, arg, VectorSize::Bi))
            }
            _ => None,
        }
    }

    /// The division by 127 or 32767 that naga writes lacks the bound of WGSL and GLSL.
    fn not_below_minus_one(
        &mut self,
        fun: MathFunction,
        arg: Handle<Expression>,
        size: VectorSize,
    ) -> Handle<Expression> {
        let arg = self.copy_of(arg);
        let unpacked = self.call(fun, &[arg]);
        let least = self.number(Some(size), Literal::F32(-1.0));
        self.call(MathFunction::Max, &[unpacked, least])
    }

    /// A sample half a texel or more within the edges, as `textureSampleBaseClampToEdge` takes it.
    fn clamped_to_edge(
        &mut self,
        e: Handle<Expression>,
        image: Handle<Expression>,
        coordinate: Handle<Expression>,
    ) -> Handle<Expression> {
        let mut sample = self.copied_expression(e);
        let image = self.copy_of(image);
        let query = ImageQuery::Size { level: None };
        let size = self.write(Expression::ImageQuery { image, query });
        let size = self.convert(size, ScalarKind::Float);
        let half = self.number(Some(VectorSize::Bi), Literal::F32(0.5));
        let least = self.binary(BinaryOperator::Divide, half, size);
        let one = self.number(Some(VectorSize::Bi), Literal::F32(1.0));
        let most = self.binary(BinaryOperator::Subtract, one, least);
        let at = self.copy_of(coordinate);
        let at = self.call(MathFunction::Clamp, &[at, least, most]);
        if let Expression::ImageSample {
            coordinate,
            clamp_to_edge,
            ..
        } = &mut sample
        {
            *coordinate = at;
            *clamp_to_edge = false;
        }
        self.write(sample)
    }

    /// `atomicAdd` of 0 less the value, in place of `atomicSub`.
    fn added(&mut self, subtract: Statement, value: Handle<Expression>) -> Statement {
        let Statement::Atomic {
            pointer, result, ..
        } = subtract
        else {
            return subtract;
        };
        let zero = match self.inner(value).scalar() {
            Some(Scalar::U32) => Literal::U32(0),
            Some(Scalar::I32) => Literal::I32(0),
            _ => return subtract,
        };
        let zero = self.number(None, zero);
        let value = self.copy_of(value);
        let value = self.binary(BinaryOperator::Subtract, zero, value);
        self.is_changed = true;
        Statement::Atomic {
            pointer,
            fun: AtomicFunction::Add,
            value,
            result,
        }
    }

    fn write(&mut self, expression: Expression) -> Handle<Expression> {
        self.copying.writer.expression(expression)
    }

    /// A literal, in each component of a vector of this size.
    fn number(&mut self, shape: Option<VectorSize>, literal: Literal) -> Handle<Expression> {
        let value = self.write(Expression::Literal(literal));
        match shape {
            None => value,
            Some(size) => self.write(Expression::Splat { size, value }),
        }
    }

    fn binary(
        &mut self,
        op: BinaryOperator,
        left: Handle<Expression>,
        right: Handle<Expression>,
    ) -> Handle<Expression> {
        self.write(Expression::Binary { op, left, right })
    }

    fn call(&mut self, fun: MathFunction, arguments: &[Handle<Expression>]) -> Handle<Expression> {
        let at = |i: usize| arguments.get(i).copied();
        self.write(Expression::Math {
            fun,
            arg: arguments[0],
            arg1: at(1),
            arg2: at(2),
            arg3: at(3),
        })
    }

    fn convert(&mut self, expr: Handle<Expression>, kind: ScalarKind) -> Handle<Expression> {
        self.write(Expression::As {
            expr,
            kind,
            convert: Some(4),
        })
    }
}

/// The size and the scalar of a vector, or the scalar.
fn shape(inner: &TypeInner) -> Option<(Option<VectorSize>, Scalar)> {
    match *inner {
        TypeInner::Scalar(scalar) => Some((None, scalar)),
        TypeInner::Vector { size, scalar } => Some((Some(size), scalar)),
        _ => None,
    }
}
