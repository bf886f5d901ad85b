//! Keeps constants from being evaluated when WGSL is compiled, where their value would be an error
//! (WGSL 16.1): a constant that is infinite, a shift by 32, `clamp` with its bounds turned. In
//! GLSL, in SPIR-V and at run time these are values.
//!
//! The same holds for an override, which WGSL evaluates when a pipeline is made: its value is not
//! known here. An author of WGSL knows that.
//!
//! naga folds constants where it can, so few operations on constants are left. One that WGSL may
//! refuse gets one operand from a variable: `var constant = 0.8; .. clamp(x, constant, 0.2)`.

use std::collections::HashMap;

use naga::proc::TypeResolution;
use naga::valid::FunctionInfo;
use naga::{
    Arena, BinaryOperator as B, Expression, Function, Handle, LocalVariable, MathFunction as M,
    Module, Range, ScalarKind, Span, Type, TypeInner, UniqueArena,
};
use naga_edit::copy::{Copies, CopyFunction, Copying};
use naga_edit::writer::FunctionWriter;
use preshade_plan::program::Program;
use shader_text::source::Language;

/// The module with such operands in variables; `None` if there are none.
pub(crate) fn hide(program: &Program) -> Option<Module> {
    let (module, info) = (program.module(), program.info());
    let functions = module.functions.iter();
    let functions = functions.map(|(h, f)| (Some(h), f, &info[h]));
    let entries = module.entry_points.iter().enumerate();
    let entries = entries.map(|(i, e)| (None, &e.function, info.get_entry_point(i)));
    let found = functions
        .chain(entries)
        .map(|(_, f, info)| operands_to_hide(program, f, info));
    let found: Vec<HashMap<_, _>> = found.collect();
    if found.iter().all(HashMap::is_empty) {
        return None;
    }
    let mut hidden = module.clone();
    let types = &mut hidden.types;
    let functions = hidden.functions.iter_mut().map(|(h, f)| (f, &info[h]));
    let entries = hidden.entry_points.iter_mut().enumerate();
    let entries = entries.map(|(i, e)| (&mut e.function, info.get_entry_point(i)));
    for ((function, info), operands) in functions.chain(entries).zip(found) {
        if !operands.is_empty() {
            *function = Hiding::copy(function, info, types, operands);
        }
    }
    Some(hidden)
}

/// The expressions that WGSL may refuse, and the operand of each that makes it evaluate them later.
fn operands_to_hide(
    program: &Program,
    function: &Function,
    info: &FunctionInfo,
) -> HashMap<Handle<Expression>, Handle<Expression>> {
    let mut constants = Constants {
        module: program.module(),
        are_overrides: program.language() != Language::Wgsl,
        function,
        info,
        is_constant: Vec::with_capacity(function.expressions.len()),
    };
    let mut is_evaluated = vec![false; function.expressions.len()];
    naga_operands::evaluated(&function.body, &mut |e| is_evaluated[e.index()] = true);
    let mut found = HashMap::new();
    for (e, expression) in function.expressions.iter() {
        let operand = constants
            .refused(expression)
            .filter(|_| is_evaluated[e.index()]);
        let is_constant = operand.is_none() && constants.is_constant_of(expression);
        constants.is_constant.push(is_constant);
        found.extend(operand.map(|o| (e, o)));
    }
    found
}

/// Which expressions of a function WGSL evaluates when it is compiled, or a pipeline is made.
struct Constants<'a> {
    module: &'a Module,
    /// Whether overrides are among them.
    are_overrides: bool,
    function: &'a Function,
    info: &'a FunctionInfo,
    is_constant: Vec<bool>,
}

impl Constants<'_> {
    fn is(&self, e: Handle<Expression>) -> bool {
        self.is_constant.get(e.index()) == Some(&true)
    }

    fn is_constant_of(&self, expression: &Expression) -> bool {
        match expression {
            Expression::Literal(_) | Expression::Constant(_) | Expression::ZeroValue(_) => true,
            Expression::Override(_) => self.are_overrides,
            Expression::Compose { .. }
            | Expression::Splat { .. }
            | Expression::Swizzle { .. }
            | Expression::Access { .. }
            | Expression::AccessIndex { .. }
            | Expression::Unary { .. }
            | Expression::Binary { .. }
            | Expression::Select { .. }
            | Expression::Relational { .. }
            | Expression::Math { .. }
            | Expression::As { .. } => {
                let operands = naga_operands::of_expression(expression);
                operands.into_iter().all(|o| self.is(o))
            }
            _ => false,
        }
    }

    fn kind(&self, e: Handle<Expression>) -> Option<ScalarKind> {
        let inner = self.info[e].ty.inner_with(&self.module.types);
        Some(inner.scalar()?.kind)
    }

    /// The operand to hide, if WGSL may refuse the expression.
    fn refused(&self, expression: &Expression) -> Option<Handle<Expression>> {
        match *expression {
            Expression::Binary { op, left, right } => {
                let both = self.is(left) && self.is(right);
                let is_integer = self.kind(right) != Some(ScalarKind::Float);
                let refuses = match op {
                    B::Add | B::Subtract | B::Multiply => both,
                    B::Divide | B::Modulo => {
                        both || is_integer && !self.all(&[right], |n| n[0] != 0.0)
                    }
                    B::ShiftLeft | B::ShiftRight => both || !self.all(&[right], |n| n[0] < 32.0),
                    _ => false,
                };
                (refuses && self.is(right)).then_some(right)
            }
            Expression::As {
                expr,
                kind,
                convert,
            } => {
                let from = self.kind(expr) == Some(ScalarKind::Float);
                let refuses = from || convert.is_none() && kind == ScalarKind::Float;
                (refuses && self.is(expr)).then_some(expr)
            }
            Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                arg3,
            } => {
                let more = [arg1, arg2, arg3].into_iter().flatten();
                let more: Vec<Handle<Expression>> = more.collect();
                let all = self.is(arg) && more.iter().all(|e| self.is(*e));
                // WGSL refuses some arguments whatever the others are.
                let some = match (fun, &more[..]) {
                    (M::Clamp, bounds @ [low, _]) => {
                        let fits = self.all(bounds, |n| n[0] <= n[1]);
                        self.some(bounds, fits).map(|_| *low)
                    }
                    (M::SmoothStep, [high, _]) => {
                        let edges = [arg, *high];
                        self.some(&edges, self.all(&edges, |n| n[0] < n[1]))
                    }
                    (M::Ldexp, [exponent]) => {
                        let exponent = [*exponent];
                        self.some(&exponent, self.all(&exponent, |n| n[0] <= 128.0))
                    }
                    (M::ExtractBits, bits @ [_, _]) | (M::InsertBits, [_, bits @ ..]) => {
                        let constant = bits.iter().copied().filter(|e| self.is(*e));
                        let constant: Vec<Handle<Expression>> = constant.collect();
                        let fits = self.all(&constant, |n| n.iter().sum::<f64>() <= 32.0);
                        self.some(&constant, fits)
                    }
                    _ => None,
                };
                some.or(all.then_some(arg))
            }
            _ => None,
        }
    }

    /// The first of the operands, if all are constant and do not fit.
    fn some(&self, operands: &[Handle<Expression>], fits: bool) -> Option<Handle<Expression>> {
        let is_constant = operands.iter().all(|e| self.is(*e));
        operands.first().copied().filter(|_| is_constant && !fits)
    }

    /// Whether `fits` holds for each component of constants. False where one is not known.
    fn all(&self, of: &[Handle<Expression>], fits: impl Fn(&[f64]) -> bool) -> bool {
        let values = |e: &Handle<Expression>| {
            self.is(*e)
                .then(|| self.values(&self.function.expressions, *e))
                .flatten()
        };
        let Some(values) = of.iter().map(values).collect::<Option<Vec<Vec<f64>>>>() else {
            return false;
        };
        let size = values.iter().map(Vec::len).max().unwrap_or(0);
        (0..size).all(|i| {
            let component = |v: &Vec<f64>| v.get(i).or(v.first()).copied().unwrap_or(f64::NAN);
            fits(&values.iter().map(component).collect::<Vec<f64>>())
        })
    }

    /// The components of a constant scalar or vector.
    fn values(&self, expressions: &Arena<Expression>, e: Handle<Expression>) -> Option<Vec<f64>> {
        use naga::Literal as L;
        Some(match &expressions[e] {
            Expression::Literal(literal) => vec![match *literal {
                L::F64(x) | L::AbstractFloat(x) => x,
                L::F32(x) => x.into(),
                L::F16(x) => x.to_f64(),
                L::U32(n) => n.into(),
                L::I32(n) => n.into(),
                L::Bool(_) | L::U64(_) | L::I64(_) | L::U16(_) | L::I16(_) | L::AbstractInt(_) => {
                    return None;
                }
            }],
            Expression::ZeroValue(ty) => match self.module.types[*ty].inner {
                TypeInner::Scalar(_) | TypeInner::Vector { .. } => vec![0.0],
                _ => return None,
            },
            Expression::Splat { value, .. } => self.values(expressions, *value)?,
            Expression::Compose { components, .. } => {
                let mut all = Vec::new();
                for component in components {
                    all.extend(self.values(expressions, *component)?);
                }
                all
            }
            Expression::Constant(c) => {
                let init = self.module.constants[*c].init;
                self.values(&self.module.global_expressions, init)?
            }
            _ => return None,
        })
    }
}

/// Copies a function, with operands from variables.
struct Hiding<'a> {
    copying: Copying<'a>,
    /// The operand of each expression that is refused.
    operands: HashMap<Handle<Expression>, Handle<Expression>>,
    types: HashMap<Handle<Expression>, Handle<Type>>,
    variables: HashMap<Handle<Expression>, Handle<LocalVariable>>,
}

impl Hiding<'_> {
    fn copy(
        function: &Function,
        info: &FunctionInfo,
        types: &mut UniqueArena<Type>,
        operands: HashMap<Handle<Expression>, Handle<Expression>>,
    ) -> Function {
        let of = |e: Handle<Expression>| match &info[e].ty {
            TypeResolution::Handle(ty) => (e, *ty),
            TypeResolution::Value(inner) => {
                let inner = inner.clone();
                (e, types.insert(Type { name: None, inner }, Span::UNDEFINED))
            }
        };
        let types = operands.values().copied().map(of).collect();
        let mut copy = Hiding {
            copying: Copying::new(function, FunctionWriter::like(function)),
            operands,
            types,
            variables: HashMap::new(),
        };
        copy.unevaluated();
        copy.copying.initialisers();
        copy.block(&function.body);
        copy.copying.finish()
    }

    /// Reads the variable that holds a constant.
    fn read(&mut self, operand: Handle<Expression>) -> Option<Handle<Expression>> {
        let ty = *self.types.get(&operand)?;
        let Copying {
            original, writer, ..
        } = &mut self.copying;
        writer.flush(Span::UNDEFINED);
        let variable = *self.variables.entry(operand).or_insert_with(|| {
            let function = &mut writer.function;
            let init = Copies::of(original).constant(original, operand, function);
            let variable = LocalVariable {
                name: Some("constant".to_owned()),
                ty,
                init: Some(init),
            };
            function.local_variables.append(variable, Span::UNDEFINED)
        });
        let pointer = writer.expression(Expression::LocalVariable(variable));
        Some(writer.expression(Expression::Load { pointer }))
    }
}

impl<'a> CopyFunction<'a> for Hiding<'a> {
    fn copying(&mut self) -> &mut Copying<'a> {
        &mut self.copying
    }

    fn emit(&mut self, range: Range<Expression>, span: Span) {
        for e in range {
            let hidden = self.operands.get(&e).copied();
            let hidden = hidden.and_then(|o| Some((o, self.read(o)?)));
            self.copying.writer.begin();
            let Some((operand, read)) = hidden else {
                self.expression(e);
                continue;
            };
            let mut copy = self.copying.original.expressions[e].clone();
            let copies = &self.copying.copies;
            naga_operands::map_expression(&mut copy, &mut |o| {
                *o = if *o == operand {
                    read
                } else {
                    copies.mapped(*o)
                };
            });
            self.copying.append(e, copy);
        }
        self.copying.writer.flush(span);
    }
}
