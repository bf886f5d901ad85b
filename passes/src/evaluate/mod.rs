//! A small interpreter of naga IR on the CPU: one invocation, 32-bit scalars. It is what the slicer is tested against: running a slice gives
//! the sliced value, bit for bit.
//!
//! It is generic over what it takes for a float, a [`Number`]: `f32`; `f64`; both side by side ([`Shadowed`]), which tells how far rounding has led from the truth; intervals
//! and affine numbers, which stand for all of a triangle ([`mod@crate::bound`]); terms, which stand for every number there is ([`mod@crate::validate`]).
//!
//! `discard` is a demotion, as in WGSL: the invocation is marked and runs on. A dynamic index out of bounds is clamped. Atomics and subgroup operations have no meaning for one
//! invocation alone. What textures and derivatives give is the caller's to say: they are inputs.

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

use naga::{
    AddressSpace, Block, Expression, Function, GlobalVariable, Handle, Module, SampleLevel,
    Statement, SwitchValue,
};

mod bits;
mod flips;
mod layout;
mod math;
mod matrix;
mod number;
mod shadow;
mod value;

pub use layout::{RUNTIME_ELEMENTS, from_bytes, scalars};
pub use number::Number;
pub use shadow::{Shadowed, ulps};
pub use value::{OverrideValue, Scalar, Value, constant};

/// Why an evaluation came to no end.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Stuck {
    /// Something the interpreter does not do.
    #[error("not supported: {0}")]
    Unsupported(String),
    /// The step limit was reached.
    #[error("the step limit was reached")]
    Steps,
    /// A value of the wrong type: the module or an argument is not valid.
    #[error("type mismatch: {0}")]
    Type(String),
    /// What to do next rests on a number that is several.
    #[error("it rests on a number that is not one: {0}")]
    Undecided(String),
    /// An expression was used that no `Emit` before it evaluates.
    #[error("expression {0} is used before it is evaluated")]
    Unevaluated(usize),
}

/// A texture access.
#[derive(Clone, Debug)]
pub struct Lookup<'a, F = f32> {
    /// Group and binding of the texture.
    pub binding: Option<(u32, u32)>,
    /// Coordinates, array index, sample or level if one is named, depth reference: in this order, those there are.
    pub coordinates: &'a [F],
    /// What else decides the level: a bias, or both gradients. Empty where the level is implicit or named.
    pub footprint: &'a [F],
    /// How the texture is looked up.
    pub sampling: Sampling,
}

/// How a texture is looked up, beside where: what an access says with words and constants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sampling {
    /// Group and binding of the sampler; `None`: a load, which has none.
    pub sampler: Option<(u32, u32)>,
    /// Texels beside the place; 0 where the access says nothing.
    pub offset: [i32; 3],
    /// It takes the level that its neighbours call for.
    pub implicit: bool,
    /// It stays half a texel away from the edge (`textureSampleBaseClampToEdge`).
    pub clamped: bool,
}

/// A derivative (`dpdx`, `fwidthFine`) of one component.
#[derive(Clone, Copy, Debug)]
pub struct Derivative<F = f32> {
    /// Along which axis; `Width` is `abs(dpdx) + abs(dpdy)`, which the caller is asked for as such.
    pub axis: naga::DerivativeAxis,
    /// How fine.
    pub control: naga::DerivativeControl,
    /// Of what.
    pub of: F,
}

/// A value that was computed on the way.
#[derive(Clone, Debug)]
pub struct Traced<F = f32> {
    /// The author's text for it.
    pub span: naga::Span,
    /// What kind of expression or statement it is, in naga's word: spans of an expression and its operand may be one.
    pub kind: &'static str,
    /// The value: of an expression, or stored.
    pub value: Value<F>,
}

/// What surrounds an invocation.
pub struct Environment<'a, F = f32> {
    /// Contents of uniforms and buffers by group and binding. Runs share them: what a run writes to is copied, once.
    pub resources: Arc<BTreeMap<(u32, u32), Value<F>>>,
    /// The texel a lookup gives.
    pub texture: &'a dyn Fn(&Lookup<'_, F>) -> [F; 4],
    /// What a derivative gives; `None`: it stops the evaluation.
    pub derivative: Option<&'a dyn Fn(Derivative<F>) -> F>,
    /// Where to write down what is computed on the way, if anywhere.
    pub trace: Option<&'a RefCell<Vec<Traced<F>>>>,
    /// Statements and expressions evaluated before the interpreter gives up. A value of more scalars than a 4x4 matrix counts a step for each of those beyond it.
    pub steps: u64,
}

/// What an invocation did.
#[derive(Clone, Debug)]
pub struct Outcome<F = f32> {
    /// What it returned.
    pub result: Option<Value<F>>,
    /// Whether it was discarded.
    pub discarded: bool,
    /// What storage buffers that it may write hold at its end, by group and binding.
    pub stored: BTreeMap<(u32, u32), Value<F>>,
    /// Comparisons and conversions that would have come out otherwise had nothing been rounded, component by component: of numbers that know their truth ([`Number::truth`]).
    pub flips: u64,
    /// Steps it took.
    pub steps: u64,
}

/// Scalars of private and of local memory that a run may have: each takes many bytes here, and is copied with what holds it.
const MOST_SCALARS: u32 = 1 << 16;

/// Scalars of all values that a run may hold at a time, arguments among them.
const MOST_VALUES: usize = 1 << 20;

/// Scalars that a value may have for one step: those of a matrix.
const FREE: usize = 16;

/// Runs an entry point.
///
/// # Errors
/// [`Stuck`].
pub fn entry_point<F: Number>(
    module: &Module,
    entry: usize,
    arguments: &[Value<F>],
    environment: &Environment<'_, F>,
) -> Result<Outcome<F>, Stuck> {
    let function = &module.entry_points[entry].function;
    run(module, function, arguments, environment)
}

/// Runs a function, of a module or of an entry point of it, with globals as they are at the beginning.
///
/// # Errors
/// [`Stuck`].
pub fn run<F: Number>(
    module: &Module,
    function: &Function,
    arguments: &[Value<F>],
    environment: &Environment<'_, F>,
) -> Result<Outcome<F>, Stuck> {
    let globals = module.global_variables.len();
    let mut machine = Machine {
        module,
        environment,
        memory: vec![Cow::Owned(Value::Composite(Vec::new())); globals],
        globals: vec![None; globals],
        discarded: false,
        flips: 0,
        steps: 0,
        of_globals: 0,
        of_locals: 0,
        held: 0,
    };
    let result = machine.call(function, arguments.to_vec())?;
    let mut stored = BTreeMap::new();
    for (handle, global) in module.global_variables.iter() {
        let (Some(at), AddressSpace::Storage { access }) = (&global.binding, global.space) else {
            continue;
        };
        if !access.contains(naga::StorageAccess::STORE) {
            continue;
        }
        // One that was not touched holds what it held.
        let value = match machine.globals[handle.index()] {
            Some(there) => there.then(|| machine.memory[handle.index()].clone()),
            None => machine.initial(handle).ok().flatten(),
        };
        stored.extend(value.map(|v| ((at.group, at.binding), v.into_owned())));
    }
    Ok(Outcome {
        stored,
        result,
        discarded: machine.discarded,
        flips: machine.flips,
        steps: machine.steps,
    })
}

struct Machine<'a, F: Number> {
    module: &'a Module,
    environment: &'a Environment<'a, F>,
    /// Variables: the module's by their index, then those of the functions that run.
    memory: Vec<Cow<'a, Value<F>>>,
    /// Whether each of the module's variables has a value; `None`: nothing has asked for it yet.
    globals: Vec<Option<bool>>,
    discarded: bool,
    flips: u64,
    steps: u64,
    /// Scalars of the module's variables so far, and of those of the functions that run.
    of_globals: u32,
    of_locals: u32,
    /// Scalars of the values that there are now.
    held: usize,
}

struct Frame<'f, F> {
    function: &'f Function,
    arguments: Vec<Value<F>>,
    /// Address of the first local variable.
    locals: usize,
    values: Vec<Option<Value<F>>>,
    /// Scalars of the values and arguments.
    held: usize,
}

enum Flow<F> {
    Next,
    Break,
    Continue,
    Return(Option<Value<F>>),
}

impl<'a, F: Number> Machine<'a, F> {
    /// The scalars of a variable of this type, ahead of what they take.
    fn take(&self, ty: Handle<naga::Type>) -> Result<u32, Stuck> {
        let more = layout::scalars(self.module, ty);
        let all = self.of_globals.saturating_add(self.of_locals);
        match all.saturating_add(more) <= MOST_SCALARS {
            true => Ok(more),
            false => Err(Stuck::Unsupported(format!(
                "more than {MOST_SCALARS} numbers in private and local memory"
            ))),
        }
    }

    /// Fails where so many scalars more are too many, ahead of what they take.
    fn room(&self, scalars: usize) -> Result<(), Stuck> {
        match self.held.saturating_add(scalars) <= MOST_VALUES {
            true => Ok(()),
            false => Err(Stuck::Unsupported(format!(
                "values of more than {MOST_VALUES} numbers"
            ))),
        }
    }

    /// Counts what a value of so many scalars costs to make or copy.
    fn work(&mut self, scalars: usize) -> Result<(), Stuck> {
        self.steps = self
            .steps
            .saturating_add(scalars.saturating_sub(FREE) as u64);
        match self.steps > self.environment.steps {
            true => Err(Stuck::Steps),
            false => Ok(()),
        }
    }

    /// Keeps the value of an expression.
    fn keep(
        &mut self,
        frame: &mut Frame<'a, F>,
        e: Handle<Expression>,
        value: Value<F>,
    ) -> Result<(), Stuck> {
        let scalars = value.scalars();
        self.room(scalars)?;
        self.work(scalars)?;
        let before = frame.values[e.index()].replace(value);
        let before = before.map_or(0, |v| v.scalars());
        frame.held = frame.held + scalars - before;
        self.held = self.held + scalars - before;
        Ok(())
    }

    /// What a variable of the module begins with; `None` where it has no value here. What is bound is not copied.
    fn initial(
        &mut self,
        handle: Handle<GlobalVariable>,
    ) -> Result<Option<Cow<'a, Value<F>>>, Stuck> {
        let (module, environment) = (self.module, self.environment);
        let global = &module.global_variables[handle];
        if global.space == AddressSpace::Handle {
            return Ok(None);
        }
        let given = global.binding.as_ref();
        let given = given.and_then(|at| environment.resources.get(&(at.group, at.binding)));
        if let Some(given) = given {
            return Ok(Some(Cow::Borrowed(given)));
        }
        match &global.binding {
            None => self.of_globals += self.take(global.ty)?,
            Some(_) => {
                let scalars = layout::scalars(module, global.ty) as usize;
                self.room(scalars)?;
                self.held += scalars;
            }
        }
        match global.init.filter(|_| global.binding.is_none()) {
            Some(init) => Ok(Some(Cow::Owned(value::default_constant(module, init)?))),
            // A type that has none, say.
            None => Ok(Value::zero(module, global.ty).ok().map(Cow::Owned)),
        }
    }

    /// A variable of the module, made when it is first asked for.
    fn global(&mut self, handle: Handle<GlobalVariable>) -> Result<Value<F>, Stuck> {
        let address = handle.index();
        let there = match self.globals[address] {
            Some(there) => there,
            None => {
                let value = self.initial(handle)?;
                let there = value.is_some();
                self.globals[address] = Some(there);
                if let Some(value) = value {
                    self.memory[address] = value;
                }
                there
            }
        };
        Ok(match there {
            true => Value::Pointer {
                address,
                path: Vec::new(),
            },
            false => Value::Resource(handle),
        })
    }

    fn step(&mut self) -> Result<(), Stuck> {
        self.steps += 1;
        if self.steps > self.environment.steps {
            return Err(Stuck::Steps);
        }
        Ok(())
    }

    fn call(
        &mut self,
        function: &'a Function,
        arguments: Vec<Value<F>>,
    ) -> Result<Option<Value<F>>, Stuck> {
        let (locals, of_locals) = (self.memory.len(), self.of_locals);
        for (_, variable) in function.local_variables.iter() {
            self.of_locals += self.take(variable.ty)?;
        }
        let held = arguments.iter().map(Value::scalars).sum();
        self.room(held)?;
        self.work(held)?;
        self.held += held;
        let mut frame = Frame {
            function,
            arguments,
            locals,
            values: vec![None; function.expressions.len()],
            held,
        };
        for (_, variable) in function.local_variables.iter() {
            let value = match variable.init {
                Some(init) => self.constant(&mut frame, init)?,
                None => Value::zero(self.module, variable.ty)?,
            };
            self.memory.push(Cow::Owned(value));
        }
        let flow = self.block(&function.body, &mut frame)?;
        self.memory.truncate(locals);
        self.of_locals = of_locals;
        self.held -= frame.held;
        match flow {
            Flow::Return(value) => Ok(value),
            _ => Ok(None),
        }
    }

    /// An initialiser: a constant expression outside any `Emit`.
    fn constant(
        &mut self,
        frame: &mut Frame<'a, F>,
        e: Handle<Expression>,
    ) -> Result<Value<F>, Stuck> {
        for operand in crate::graph::operands::of_expression(&frame.function.expressions[e]) {
            let value = self.constant(frame, operand)?;
            self.keep(frame, operand, value)?;
        }
        self.evaluate(frame, e)
    }

    fn block(&mut self, block: &'a Block, frame: &mut Frame<'a, F>) -> Result<Flow<F>, Stuck> {
        for statement in block {
            self.step()?;
            match self.statement(statement, frame)? {
                Flow::Next => {}
                flow => return Ok(flow),
            }
        }
        Ok(Flow::Next)
    }

    fn statement(
        &mut self,
        statement: &'a Statement,
        frame: &mut Frame<'a, F>,
    ) -> Result<Flow<F>, Stuck> {
        match statement {
            Statement::Emit(range) => {
                for e in range.clone() {
                    self.step()?;
                    let value = self.evaluate(frame, e)?;
                    if let Some(trace) = self.environment.trace {
                        trace.borrow_mut().push(Traced {
                            span: frame.function.expressions.get_span(e),
                            kind: kind(&frame.function.expressions[e]),
                            value: value.clone(),
                        });
                    }
                    self.keep(frame, e, value)?;
                }
            }
            Statement::Block(block) => return self.block(block, frame),
            Statement::If {
                condition,
                accept,
                reject,
            } => {
                let taken = self.get(frame, *condition)?.truth()?;
                return self.block(if taken { accept } else { reject }, frame);
            }
            Statement::Switch { selector, cases } => {
                let selector = self.get(frame, *selector)?.scalar()?;
                let matches = |value: &SwitchValue| match (value, selector) {
                    (SwitchValue::I32(a), Scalar::I32(b)) => *a == b,
                    (SwitchValue::U32(a), Scalar::U32(b)) => *a == b,
                    _ => false,
                };
                let start = cases
                    .iter()
                    .position(|c| matches(&c.value))
                    .or_else(|| cases.iter().position(|c| c.value == SwitchValue::Default));
                let Some(start) = start else {
                    return Ok(Flow::Next);
                };
                for case in &cases[start..] {
                    match self.block(&case.body, frame)? {
                        Flow::Next if case.fall_through => {}
                        Flow::Next | Flow::Break => break,
                        flow => return Ok(flow),
                    }
                }
            }
            Statement::Loop {
                body,
                continuing,
                break_if,
            } => loop {
                self.step()?;
                match self.block(body, frame)? {
                    Flow::Next | Flow::Continue => {}
                    Flow::Break => break,
                    flow @ Flow::Return(_) => return Ok(flow),
                }
                self.block(continuing, frame)?;
                if let Some(condition) = break_if
                    && self.get(frame, *condition)?.truth()?
                {
                    break;
                }
            },
            Statement::Break => return Ok(Flow::Break),
            Statement::Continue => return Ok(Flow::Continue),
            Statement::Return { value } => {
                let value = value.map(|v| self.get(frame, v)).transpose()?;
                return Ok(Flow::Return(value));
            }
            Statement::Kill => self.discarded = true,
            Statement::Store { pointer, value } => {
                let value = self.get(frame, *value)?;
                let pointer = self.get(frame, *pointer)?;
                *self.place(&pointer)? = value;
            }
            Statement::Call {
                function,
                arguments,
                result,
            } => {
                let arguments = arguments
                    .iter()
                    .map(|a| self.get(frame, *a))
                    .collect::<Result<_, _>>()?;
                let returned = self.call(&self.module.functions[*function], arguments)?;
                if let (Some(result), Some(returned)) = (result, returned) {
                    self.keep(frame, *result, returned)?;
                }
            }
            other => return Err(Stuck::Unsupported(format!("{other:?}"))),
        }
        Ok(Flow::Next)
    }

    /// What a pointer leads to, to be read.
    fn read(&self, pointer: &Value<F>) -> Result<&Value<F>, Stuck> {
        let (address, path) = target(pointer)?;
        let mut at = self.memory.get(address).ok_or_else(nowhere)?.as_ref();
        for step in path {
            at = part(at, *step)?;
        }
        Ok(at)
    }

    /// What a pointer leads to, to be written: a run's own from now on.
    fn place(&mut self, pointer: &Value<F>) -> Result<&mut Value<F>, Stuck> {
        let (address, path) = target(pointer)?;
        let variable = self.memory.get(address).ok_or_else(nowhere)?;
        if matches!(variable, Cow::Borrowed(_)) {
            self.work(variable.scalars())?;
        }
        let mut at = self.memory.get_mut(address).ok_or_else(nowhere)?.to_mut();
        for step in path {
            let Value::Composite(parts) = at else {
                return Err(Stuck::Type("a path into a scalar".to_owned()));
            };
            let last = parts.len().saturating_sub(1);
            at = parts
                .get_mut((*step).min(last))
                .ok_or_else(|| Stuck::Type("a path into nothing".to_owned()))?;
        }
        Ok(at)
    }

    /// The value of an operand.
    fn get(&mut self, frame: &mut Frame<'a, F>, e: Handle<Expression>) -> Result<Value<F>, Stuck> {
        self.need(frame, e)?;
        let value = known(frame, e)?;
        self.work(value.scalars())?;
        Ok(value.clone())
    }

    /// Evaluates an operand that no `Emit` does, where that was not done yet.
    fn need(&mut self, frame: &mut Frame<'a, F>, e: Handle<Expression>) -> Result<(), Stuck> {
        if frame.values[e.index()].is_some() {
            return Ok(());
        }
        if !frame.function.expressions[e].needs_pre_emit() {
            return Err(Stuck::Unevaluated(e.index()));
        }
        let value = self.evaluate(frame, e)?;
        self.keep(frame, e, value)
    }

    /// Fails where a value of this type is too much, ahead of it.
    fn room_for(&self, ty: Handle<naga::Type>) -> Result<(), Stuck> {
        self.room(layout::scalars(self.module, ty) as usize)
    }

    fn evaluate(
        &mut self,
        frame: &mut Frame<'a, F>,
        e: Handle<Expression>,
    ) -> Result<Value<F>, Stuck> {
        let function = frame.function;
        Ok(match &function.expressions[e] {
            Expression::Literal(l) => Value::literal(l)?,
            Expression::Constant(c) => {
                let constant = &self.module.constants[*c];
                self.room_for(constant.ty)?;
                value::default_constant(self.module, constant.init)?
            }
            Expression::Override(o) => match self.module.overrides[*o].init {
                Some(init) => value::default_constant(self.module, init)?,
                None => return Err(Stuck::Unsupported("an override without a value".to_owned())),
            },
            Expression::ZeroValue(ty) => {
                self.room_for(*ty)?;
                Value::zero(self.module, *ty)?
            }
            Expression::Compose { ty, components } => {
                self.room_for(*ty)?;
                let parts = components
                    .iter()
                    .map(|c| self.get(frame, *c))
                    .collect::<Result<_, _>>()?;
                value::compose(self.module, *ty, parts)
            }
            Expression::Access { base, index } => {
                let index = self.get(frame, *index)?.index()?;
                self.need(frame, *base)?;
                access(known(frame, *base)?, index)?
            }
            Expression::AccessIndex { base, index } => {
                self.need(frame, *base)?;
                access(known(frame, *base)?, *index as usize)?
            }
            Expression::Splat { size, value } => {
                Value::Composite(vec![self.get(frame, *value)?; *size as usize])
            }
            Expression::Swizzle {
                size,
                vector,
                pattern,
            } => {
                let vector = self.get(frame, *vector)?;
                let parts = vector.parts()?;
                Value::Composite(
                    pattern[..*size as usize]
                        .iter()
                        .map(|c| parts[*c as usize].clone())
                        .collect(),
                )
            }
            Expression::FunctionArgument(i) => frame.arguments[*i as usize].clone(),
            Expression::GlobalVariable(g) => self.global(*g)?,
            Expression::LocalVariable(v) => Value::Pointer {
                address: frame.locals + v.index(),
                path: Vec::new(),
            },
            Expression::Load { pointer } => {
                let pointer = self.get(frame, *pointer)?;
                let place = self.read(&pointer)?;
                self.room(place.scalars())?;
                place.clone()
            }
            Expression::Unary { op, expr } => math::unary(*op, &self.get(frame, *expr)?)?,
            expression @ Expression::Binary { op, left, right } => {
                let (left, right) = (self.get(frame, *left)?, self.get(frame, *right)?);
                let value = math::binary(*op, &left, &right)?;
                self.flips += flips::of(expression, &[&left, &right], &value);
                value
            }
            Expression::Select {
                condition,
                accept,
                reject,
            } => {
                let condition = self.get(frame, *condition)?;
                let (accept, reject) = (self.get(frame, *accept)?, self.get(frame, *reject)?);
                match condition {
                    Value::Scalar(_) if condition.truth()? => accept,
                    Value::Scalar(_) => reject,
                    _ => Value::zip(&[&condition, &accept, &reject], &mut |s| match s {
                        [Scalar::Bool(true), a, _] => Ok(*a),
                        [Scalar::Bool(false), _, r] => Ok(*r),
                        other => Err(Stuck::Type(format!("select of {other:?}"))),
                    })?,
                }
            }
            expression @ Expression::Relational { fun, argument } => {
                let argument = self.get(frame, *argument)?;
                let value = math::relational(*fun, &argument)?;
                self.flips += flips::of(expression, &[&argument], &value);
                value
            }
            Expression::Derivative {
                axis,
                ctrl,
                expr: of,
            } => {
                let Some(derivative) = self.environment.derivative else {
                    return Err(Stuck::Unsupported(format!("Derivative of {axis:?}")));
                };
                self.get(frame, *of)?.map(&mut |of| match of {
                    Scalar::F32(of) => Ok(Scalar::F32(derivative(Derivative {
                        axis: *axis,
                        control: *ctrl,
                        of,
                    }))),
                    other => Err(Stuck::Type(format!("a derivative of {other:?}"))),
                })?
            }
            expression @ Expression::Math {
                fun,
                arg,
                arg1,
                arg2,
                arg3,
            } => {
                let arguments = [Some(*arg), *arg1, *arg2, *arg3]
                    .into_iter()
                    .flatten()
                    .map(|a| self.get(frame, a))
                    .collect::<Result<Vec<_>, _>>()?;
                let arguments: Vec<&Value<F>> = arguments.iter().collect();
                let value = math::call(*fun, &arguments)?;
                self.flips += flips::of(expression, &arguments, &value);
                value
            }
            expression @ Expression::As {
                expr,
                kind,
                convert,
            } => {
                let of = self.get(frame, *expr)?;
                let value = math::cast(*kind, *convert, &of)?;
                self.flips += flips::of(expression, &[&of], &value);
                value
            }
            Expression::ImageSample {
                image,
                sampler,
                coordinate,
                array_index,
                offset,
                level,
                depth_ref,
                gather: None,
                clamp_to_edge,
            } => {
                let mut sampling = Sampling {
                    implicit: matches!(level, SampleLevel::Auto | SampleLevel::Bias(_)),
                    clamped: *clamp_to_edge,
                    ..Sampling::default()
                };
                if let Value::Resource(sampler) = self.get(frame, *sampler)? {
                    sampling.sampler = self.binding(sampler);
                }
                if let Some(offset) = offset {
                    let offset = self.constant(frame, *offset)?;
                    let parts = match &offset {
                        Value::Composite(parts) => &parts[..],
                        one => std::slice::from_ref(one),
                    };
                    for (to, part) in sampling.offset.iter_mut().zip(parts) {
                        if let Value::Scalar(Scalar::I32(texels)) = part {
                            *to = *texels;
                        }
                    }
                }
                let mut operands = vec![*coordinate];
                operands.extend(array_index);
                let mut footprint = Vec::new();
                match level {
                    SampleLevel::Auto | SampleLevel::Zero => {}
                    SampleLevel::Exact(l) => operands.push(*l),
                    SampleLevel::Bias(l) => footprint.push(*l),
                    SampleLevel::Gradient { x, y } => footprint.extend([*x, *y]),
                }
                operands.extend(depth_ref);
                let texel = self.lookup(frame, *image, &operands, (&footprint, sampling))?;
                match depth_ref {
                    Some(_) => Value::number(texel[0]),
                    None => self.texel(*image, function, texel)?,
                }
            }
            Expression::ImageLoad {
                image,
                coordinate,
                array_index,
                sample,
                level,
            } => {
                let mut operands = vec![*coordinate];
                operands.extend([array_index, sample, level].into_iter().flatten());
                let how = (&[][..], Sampling::default());
                let texel = self.lookup(frame, *image, &operands, how)?;
                self.texel(*image, function, texel)?
            }
            Expression::ArrayLength(array) => {
                let pointer = self.get(frame, *array)?;
                Value::u32(self.read(&pointer)?.parts()?.len() as u32)
            }
            other => return Err(Stuck::Unsupported(kind(other).to_owned())),
        })
    }

    /// A texel as the texture's class gives it: depth as one float, integers as the whole part of what the caller gave.
    fn texel(
        &self,
        image: Handle<Expression>,
        function: &Function,
        texel: [F; 4],
    ) -> Result<Value<F>, Stuck> {
        use naga::{ImageClass, ScalarKind};
        let class = match function.expressions[image] {
            Expression::GlobalVariable(g) => {
                match self.module.types[self.module.global_variables[g].ty].inner {
                    naga::TypeInner::Image { class, .. } => Some(class),
                    _ => None,
                }
            }
            _ => None,
        };
        let kind = match class {
            Some(ImageClass::Depth { .. }) => return Ok(Value::number(texel[0])),
            Some(ImageClass::Sampled { kind, .. }) => kind,
            Some(ImageClass::Storage { format, .. }) => naga::Scalar::from(format).kind,
            _ => ScalarKind::Float,
        };
        let texel = Value::composite(&texel);
        match kind {
            ScalarKind::Sint | ScalarKind::Uint => math::cast(kind, Some(4), &texel),
            _ => Ok(texel),
        }
    }

    fn lookup(
        &mut self,
        frame: &mut Frame<'a, F>,
        image: Handle<Expression>,
        operands: &[Handle<Expression>],
        (footprint, sampling): (&[Handle<Expression>], Sampling),
    ) -> Result<[F; 4], Stuck> {
        let Value::Resource(texture) = self.get(frame, image)? else {
            return Err(Stuck::Type("a lookup in no texture".to_owned()));
        };
        let coordinates = self.numbers(frame, operands)?;
        let footprint = self.numbers(frame, footprint)?;
        Ok((self.environment.texture)(&Lookup {
            binding: self.binding(texture),
            coordinates: &coordinates,
            footprint: &footprint,
            sampling,
        }))
    }

    fn binding(&self, global: Handle<GlobalVariable>) -> Option<(u32, u32)> {
        let binding = self.module.global_variables[global].binding.as_ref();
        binding.map(|b| (b.group, b.binding))
    }

    /// The components of operands as floats, one after the other.
    fn numbers(
        &mut self,
        frame: &mut Frame<'a, F>,
        operands: &[Handle<Expression>],
    ) -> Result<Vec<F>, Stuck> {
        let mut numbers = Vec::new();
        for operand in operands {
            let value = self.get(frame, *operand)?;
            let floats = math::cast(naga::ScalarKind::Float, Some(4), &value)?;
            numbers.extend(floats.floats()?);
        }
        Ok(numbers)
    }
}

/// The name of an expression's kind.
fn kind(expression: &Expression) -> &'static str {
    match expression {
        Expression::Compose { .. } => "Compose",
        Expression::Access { .. } => "Access",
        Expression::AccessIndex { .. } => "AccessIndex",
        Expression::Splat { .. } => "Splat",
        Expression::Swizzle { .. } => "Swizzle",
        Expression::Load { .. } => "Load",
        Expression::ImageSample { .. } => "ImageSample",
        Expression::ImageLoad { .. } => "ImageLoad",
        Expression::Unary { .. } => "Unary",
        Expression::Binary { .. } => "Binary",
        Expression::Select { .. } => "Select",
        Expression::Derivative { .. } => "Derivative",
        Expression::Relational { .. } => "Relational",
        Expression::Math { .. } => "Math",
        Expression::As { .. } => "As",
        Expression::ImageQuery { .. } => "the size of a texture (ImageQuery)",
        Expression::AtomicResult { .. } => "AtomicResult",
        _ => "expression",
    }
}

/// The value of an expression that was evaluated.
fn known<'v, F>(frame: &'v Frame<'_, F>, e: Handle<Expression>) -> Result<&'v Value<F>, Stuck> {
    let value = frame.values[e.index()].as_ref();
    value.ok_or(Stuck::Unevaluated(e.index()))
}

fn nowhere() -> Stuck {
    Stuck::Type("a pointer to nothing".to_owned())
}

/// The variable that a pointer is to, and where in it.
fn target<F: Number>(pointer: &Value<F>) -> Result<(usize, &[usize]), Stuck> {
    match pointer {
        Value::Pointer { address, path } => Ok((*address, path)),
        other => Err(Stuck::Type(format!("{other:?} where a pointer belongs"))),
    }
}

/// A part of a composite; the last one past its end.
fn part<F: Number>(of: &Value<F>, index: usize) -> Result<&Value<F>, Stuck> {
    let Value::Composite(parts) = of else {
        return Err(Stuck::Type("a path into a scalar".to_owned()));
    };
    let last = parts.len().saturating_sub(1);
    let part = parts.get(index.min(last));
    part.ok_or_else(|| Stuck::Type("a path into nothing".to_owned()))
}

fn access<F: Number>(base: &Value<F>, index: usize) -> Result<Value<F>, Stuck> {
    match base {
        Value::Pointer { address, path } => Ok(Value::Pointer {
            address: *address,
            path: path.iter().copied().chain([index]).collect(),
        }),
        Value::Composite(_) => part(base, index).cloned(),
        other => Err(Stuck::Type(format!("an access into {other:?}"))),
    }
}
