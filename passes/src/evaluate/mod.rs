//! A small interpreter of naga IR on the CPU: one invocation, 32-bit scalars. It is what the slicer is tested against: running a slice gives
//! the sliced value, bit for bit.
//!
//! `discard` is a demotion, as in WGSL: the invocation is marked and runs on. A dynamic index out of bounds is clamped. Derivatives,
//! implicit levels of detail, atomics and subgroup operations have no meaning for one invocation alone; the textures are the caller's.

use std::collections::BTreeMap;

use naga::{
    AddressSpace, Block, Expression, Function, GlobalVariable, Handle, Module, SampleLevel,
    Statement, SwitchValue,
};

mod layout;
mod math;
mod number;
mod value;

pub use layout::from_bytes;
pub use number::Number;
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
    /// Coordinates, array index, level or gradients, depth reference: in this order, those there are.
    pub coordinates: &'a [F],
}

/// What surrounds an invocation.
pub struct Environment<'a, F = f32> {
    /// Contents of uniforms and buffers by group and binding.
    pub resources: BTreeMap<(u32, u32), Value<F>>,
    /// The texel a lookup gives.
    pub texture: &'a dyn Fn(&Lookup<'_, F>) -> [F; 4],
    /// Statements and expressions evaluated before the interpreter gives up.
    pub steps: u64,
}

/// What an invocation did.
#[derive(Clone, Debug)]
pub struct Outcome<F = f32> {
    /// What it returned.
    pub result: Option<Value<F>>,
    /// Whether it was discarded.
    pub discarded: bool,
    /// Steps it took.
    pub steps: u64,
}

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
    let mut machine = Machine {
        module,
        environment,
        memory: Vec::new(),
        globals: BTreeMap::new(),
        discarded: false,
        steps: 0,
    };
    for (handle, global) in module.global_variables.iter() {
        let value = match (global.space, &global.binding) {
            (AddressSpace::Handle, _) => continue,
            (_, Some(at)) => environment.resources.get(&(at.group, at.binding)).cloned(),
            (_, None) => global
                .init
                .map(|init| value::default_constant(module, init))
                .transpose()?,
        };
        let value = match value {
            Some(value) => value,
            // A runtime array nobody gave a content, say.
            None => match Value::zero(module, global.ty) {
                Ok(zero) => zero,
                Err(_) => continue,
            },
        };
        machine.globals.insert(handle, machine.memory.len());
        machine.memory.push(value);
    }
    let result = machine.call(function, arguments.to_vec())?;
    Ok(Outcome {
        result,
        discarded: machine.discarded,
        steps: machine.steps,
    })
}

struct Machine<'a, F> {
    module: &'a Module,
    environment: &'a Environment<'a, F>,
    memory: Vec<Value<F>>,
    globals: BTreeMap<Handle<GlobalVariable>, usize>,
    discarded: bool,
    steps: u64,
}

struct Frame<'f, F> {
    function: &'f Function,
    arguments: Vec<Value<F>>,
    /// Address of the first local variable.
    locals: usize,
    values: Vec<Option<Value<F>>>,
}

enum Flow<F> {
    Next,
    Break,
    Continue,
    Return(Option<Value<F>>),
}

impl<'a, F: Number> Machine<'a, F> {
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
        let locals = self.memory.len();
        let mut frame = Frame {
            function,
            arguments,
            locals,
            values: vec![None; function.expressions.len()],
        };
        for (_, variable) in function.local_variables.iter() {
            let value = match variable.init {
                Some(init) => self.constant(&mut frame, init)?,
                None => Value::zero(self.module, variable.ty)?,
            };
            self.memory.push(value);
        }
        let flow = self.block(&function.body, &mut frame)?;
        self.memory.truncate(locals);
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
            frame.values[operand.index()] = Some(value);
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
                    frame.values[e.index()] = Some(value);
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
                if let Some(result) = result {
                    frame.values[result.index()] = returned;
                }
            }
            other => return Err(Stuck::Unsupported(format!("{other:?}"))),
        }
        Ok(Flow::Next)
    }

    fn place(&mut self, pointer: &Value<F>) -> Result<&mut Value<F>, Stuck> {
        let Value::Pointer { address, path } = pointer else {
            return Err(Stuck::Type(format!("{pointer:?} where a pointer belongs")));
        };
        let mut at = &mut self.memory[*address];
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
        if let Some(value) = &frame.values[e.index()] {
            return Ok(value.clone());
        }
        if !frame.function.expressions[e].needs_pre_emit() {
            return Err(Stuck::Unevaluated(e.index()));
        }
        let value = self.evaluate(frame, e)?;
        frame.values[e.index()] = Some(value.clone());
        Ok(value)
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
                value::default_constant(self.module, self.module.constants[*c].init)?
            }
            Expression::Override(o) => match self.module.overrides[*o].init {
                Some(init) => value::default_constant(self.module, init)?,
                None => return Err(Stuck::Unsupported("an override without a value".to_owned())),
            },
            Expression::ZeroValue(ty) => Value::zero(self.module, *ty)?,
            Expression::Compose { ty, components } => {
                let parts = components
                    .iter()
                    .map(|c| self.get(frame, *c))
                    .collect::<Result<_, _>>()?;
                value::compose(self.module, *ty, parts)
            }
            Expression::Access { base, index } => {
                let index = self.get(frame, *index)?.index()?;
                access(self.get(frame, *base)?, index)?
            }
            Expression::AccessIndex { base, index } => {
                access(self.get(frame, *base)?, *index as usize)?
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
            Expression::GlobalVariable(g) => match self.globals.get(g) {
                Some(address) => Value::Pointer {
                    address: *address,
                    path: Vec::new(),
                },
                None => Value::Resource(*g),
            },
            Expression::LocalVariable(v) => Value::Pointer {
                address: frame.locals + v.index(),
                path: Vec::new(),
            },
            Expression::Load { pointer } => {
                let pointer = self.get(frame, *pointer)?;
                self.place(&pointer)?.clone()
            }
            Expression::Unary { op, expr } => math::unary(*op, &self.get(frame, *expr)?)?,
            Expression::Binary { op, left, right } => {
                let left = self.get(frame, *left)?;
                math::binary(*op, &left, &self.get(frame, *right)?)?
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
            Expression::Relational { fun, argument } => {
                math::relational(*fun, &self.get(frame, *argument)?)?
            }
            Expression::Math {
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
                math::call(*fun, &arguments.iter().collect::<Vec<_>>())?
            }
            Expression::As {
                expr,
                kind,
                convert,
            } => math::cast(*kind, *convert, &self.get(frame, *expr)?)?,
            Expression::ImageSample {
                image,
                coordinate,
                array_index,
                level,
                depth_ref,
                gather: None,
                ..
            } => {
                let mut operands = vec![*coordinate];
                operands.extend(array_index);
                match level {
                    SampleLevel::Auto | SampleLevel::Zero => {}
                    SampleLevel::Exact(l) | SampleLevel::Bias(l) => operands.push(*l),
                    SampleLevel::Gradient { x, y } => operands.extend([*x, *y]),
                }
                operands.extend(depth_ref);
                let texel = self.lookup(frame, *image, &operands)?;
                match depth_ref {
                    Some(_) => Value::number(texel[0]),
                    None => self.texel(*image, function, texel),
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
                let texel = self.lookup(frame, *image, &operands)?;
                self.texel(*image, function, texel)
            }
            other => return Err(Stuck::Unsupported(format!("{other:?}"))),
        })
    }

    /// A texel as the texture's class gives it: depth as one float.
    fn texel(&self, image: Handle<Expression>, function: &Function, texel: [F; 4]) -> Value<F> {
        let is_depth = match function.expressions[image] {
            Expression::GlobalVariable(g) => matches!(
                self.module.types[self.module.global_variables[g].ty].inner,
                naga::TypeInner::Image {
                    class: naga::ImageClass::Depth { .. },
                    ..
                }
            ),
            _ => false,
        };
        if is_depth {
            Value::number(texel[0])
        } else {
            Value::composite(&texel)
        }
    }

    fn lookup(
        &mut self,
        frame: &mut Frame<'a, F>,
        image: Handle<Expression>,
        operands: &[Handle<Expression>],
    ) -> Result<[F; 4], Stuck> {
        let Value::Resource(texture) = self.get(frame, image)? else {
            return Err(Stuck::Type("a lookup in no texture".to_owned()));
        };
        let mut coordinates = Vec::new();
        for operand in operands {
            let value = self.get(frame, *operand)?;
            let floats = math::cast(naga::ScalarKind::Float, Some(4), &value)?;
            coordinates.extend(floats.floats()?);
        }
        Ok((self.environment.texture)(&Lookup {
            binding: self.module.global_variables[texture]
                .binding
                .as_ref()
                .map(|b| (b.group, b.binding)),
            coordinates: &coordinates,
        }))
    }
}

fn access<F: Number>(base: Value<F>, index: usize) -> Result<Value<F>, Stuck> {
    match base {
        Value::Pointer { address, mut path } => {
            path.push(index);
            Ok(Value::Pointer { address, path })
        }
        Value::Composite(parts) => {
            let last = parts.len().saturating_sub(1);
            parts
                .into_iter()
                .nth(index.min(last))
                .ok_or_else(|| Stuck::Type("an access into nothing".to_owned()))
        }
        other => Err(Stuck::Type(format!("an access into {other:?}"))),
    }
}
