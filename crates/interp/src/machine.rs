//! Executes variables, statements and calls, within limits of steps and memory.

use std::borrow::Cow;
use std::collections::BTreeMap;

use naga::{
    AddressSpace, Block, Expression, Function, GlobalVariable, Handle, Module, Statement,
    SwitchValue,
};

use super::expression_kind::kind;
use super::number::Number;
use super::value::{Scalar, Value};
use super::{
    Environment, RunResult, Stuck, Traced, Undefined, comparison_notes, constants, layout,
};

/// Limit on scalars in private and local memory. Each takes many bytes, and is copied together with
/// its composite.
const MOST_SCALARS: u32 = 1 << 16;

/// Limit on scalars in all values at a time, arguments included.
const MOST_VALUES: usize = 1 << 20;

/// A value with up to this many scalars costs one step: as many as a matrix has.
const FREE: usize = 16;

/// An interpreter during a run.
pub(crate) struct Machine<'a, F: Number> {
    pub(super) module: &'a Module,
    pub environment: &'a Environment<'a, F>,
    /// Values of variables: the module's by index, then those of the running functions.
    memory: Vec<Cow<'a, Value<F>>>,
    /// Whether each module variable has a value. `None` before its first use.
    globals: Vec<Option<bool>>,
    discarded: bool,
    pub flips: u64,
    pub undefined: Option<(Undefined, naga::Span)>,
    steps: u64,
    /// Scalars in the module's variables so far, and in the running functions' variables.
    of_globals: u32,
    of_locals: u32,
    /// Scalars in all current values.
    held: usize,
}

pub(super) struct Activation<'f, F> {
    pub function: &'f Function,
    /// Its handle. `None` for the function with which the run began.
    handle: Option<Handle<Function>>,
    pub arguments: Vec<Value<F>>,
    /// Address of the first local variable.
    pub locals: usize,
    pub values: Vec<Option<Value<F>>>,
    /// Scalars in its values and arguments.
    held: usize,
}

enum BlockEnd<F> {
    Next,
    Break,
    Continue,
    Return(Option<Value<F>>),
}

impl<'a, F: Number> Machine<'a, F> {
    /// A fresh machine with initial globals.
    pub fn new(module: &'a Module, environment: &'a Environment<'a, F>) -> Self {
        let globals = module.global_variables.len();
        Self {
            module,
            environment,
            memory: vec![Cow::Owned(Value::Composite(Vec::new())); globals],
            globals: vec![None; globals],
            discarded: false,
            flips: 0,
            undefined: None,
            steps: 0,
            of_globals: 0,
            of_locals: 0,
            held: 0,
        }
    }

    /// Runs a function and consumes the machine.
    pub fn run(
        mut self,
        function: &'a Function,
        arguments: &[Value<F>],
    ) -> Result<RunResult<F>, Stuck> {
        let result = self.call((None, function), arguments.to_vec())?;
        Ok(RunResult {
            stored: self.stored(),
            result,
            discarded: self.discarded,
            flips: self.flips,
            undefined: self.undefined,
            steps: self.steps,
        })
    }

    /// The final contents of writable storage buffers.
    fn stored(&mut self) -> BTreeMap<(u32, u32), Value<F>> {
        let mut stored = BTreeMap::new();
        for (handle, global) in self.module.global_variables.iter() {
            let (Some(at), AddressSpace::Storage { access }) = (&global.binding, global.space)
            else {
                continue;
            };
            if !access.contains(naga::StorageAccess::STORE) {
                continue;
            }
            // An untouched buffer has its initial content.
            let value = match self.globals[handle.index()] {
                Some(there) => there.then(|| self.memory[handle.index()].clone()),
                None => self.initial(handle).ok().flatten(),
            };
            stored.extend(value.map(|v| ((at.group, at.binding), v.into_owned())));
        }
        stored
    }

    /// Counts the scalars of a variable of this type against the limit, before they are allocated.
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

    /// Fails if this many more scalars exceed the limit, before they are allocated.
    pub fn room(&self, scalars: usize) -> Result<(), Stuck> {
        match self.held.saturating_add(scalars) <= MOST_VALUES {
            true => Ok(()),
            false => Err(Stuck::Unsupported(format!(
                "values of more than {MOST_VALUES} numbers"
            ))),
        }
    }

    /// Counts the cost of making or copying a value with this many scalars.
    pub fn work(&mut self, scalars: usize) -> Result<(), Stuck> {
        self.steps = self
            .steps
            .saturating_add(scalars.saturating_sub(FREE) as u64);
        match self.steps > self.environment.steps {
            true => Err(Stuck::Steps),
            false => Ok(()),
        }
    }

    /// Stores the value of an expression.
    pub fn keep(
        &mut self,
        frame: &mut Activation<'a, F>,
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

    /// The initial value of a module variable, if it has one. Bound resources are not copied.
    fn initial(
        &mut self,
        handle: Handle<GlobalVariable>,
    ) -> Result<Option<Cow<'a, Value<F>>>, Stuck> {
        let (module, environment) = (self.module, self.environment);
        let global = &module.global_variables[handle];
        if global.space == AddressSpace::Handle {
            return Ok(None);
        }
        let given = layout::place(global).and_then(|at| environment.resources.get(&at));
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
            Some(init) => Ok(Some(Cow::Owned(constants::default_constant(module, init)?))),
            // `None` for types without values.
            None => Ok(Value::zero(module, global.ty).ok().map(Cow::Owned)),
        }
    }

    /// A module variable, created on first use.
    pub fn global(&mut self, handle: Handle<GlobalVariable>) -> Result<Value<F>, Stuck> {
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
        (handle, function): (Option<Handle<Function>>, &'a Function),
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
        let mut frame = Activation {
            function,
            handle,
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
            BlockEnd::Return(value) => Ok(value),
            _ => Ok(None),
        }
    }

    /// The value of an initialiser: a constant expression outside of any `Emit`.
    pub fn constant(
        &mut self,
        frame: &mut Activation<'a, F>,
        e: Handle<Expression>,
    ) -> Result<Value<F>, Stuck> {
        for operand in naga_operands::of_expression(&frame.function.expressions[e]) {
            let value = self.constant(frame, operand)?;
            self.keep(frame, operand, value)?;
        }
        self.evaluate(frame, e)
    }

    fn block(
        &mut self,
        block: &'a Block,
        frame: &mut Activation<'a, F>,
    ) -> Result<BlockEnd<F>, Stuck> {
        for statement in block {
            self.step()?;
            match self.statement(statement, frame)? {
                BlockEnd::Next => {}
                flow => return Ok(flow),
            }
        }
        Ok(BlockEnd::Next)
    }

    fn statement(
        &mut self,
        statement: &'a Statement,
        frame: &mut Activation<'a, F>,
    ) -> Result<BlockEnd<F>, Stuck> {
        match statement {
            Statement::Emit(range) => {
                for e in range.clone() {
                    self.step()?;
                    let value = self.evaluate(frame, e)?;
                    if let Some(trace) = self.environment.trace {
                        let compared = self.compared(frame, e)?;
                        trace.borrow_mut().push(Traced {
                            span: frame.function.expressions.get_span(e),
                            kind: kind(&frame.function.expressions[e]),
                            value: value.clone(),
                            at: (frame.handle, e),
                            compared,
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
                let site = *selector;
                let selector = self.get(frame, *selector)?.scalar()?;
                if F::NOTES {
                    comparison_notes::cases(frame.function, site, selector, cases);
                }
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
                    return Ok(BlockEnd::Next);
                };
                for case in &cases[start..] {
                    match self.block(&case.body, frame)? {
                        BlockEnd::Next if case.fall_through => {}
                        BlockEnd::Next | BlockEnd::Break => break,
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
                    BlockEnd::Next | BlockEnd::Continue => {}
                    BlockEnd::Break => break,
                    flow @ BlockEnd::Return(_) => return Ok(flow),
                }
                self.block(continuing, frame)?;
                if let Some(condition) = break_if
                    && self.get(frame, *condition)?.truth()?
                {
                    break;
                }
            },
            Statement::Break => return Ok(BlockEnd::Break),
            Statement::Continue => return Ok(BlockEnd::Continue),
            Statement::Return { value } => {
                let value = value.map(|v| self.get(frame, v)).transpose()?;
                return Ok(BlockEnd::Return(value));
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
                let callee = (Some(*function), &self.module.functions[*function]);
                let returned = self.call(callee, arguments)?;
                if let (Some(result), Some(returned)) = (result, returned) {
                    self.keep(frame, *result, returned)?;
                }
            }
            other => return Err(Stuck::Unsupported(format!("{other:?}"))),
        }
        Ok(BlockEnd::Next)
    }

    /// The operands, if the expression compares scalars.
    fn compared(
        &mut self,
        frame: &mut Activation<'a, F>,
        e: Handle<Expression>,
    ) -> Result<Option<[Value<F>; 2]>, Stuck> {
        use naga::BinaryOperator as B;
        let Expression::Binary { op, left, right } = frame.function.expressions[e] else {
            return Ok(None);
        };
        let is_comparison = matches!(
            op,
            B::Less | B::LessEqual | B::Greater | B::GreaterEqual | B::Equal | B::NotEqual
        );
        if !is_comparison {
            return Ok(None);
        }
        let operands = [self.get(frame, left)?, self.get(frame, right)?];
        let is_scalar = |v: &Value<F>| matches!(v, Value::Scalar(_));
        Ok(operands.iter().all(is_scalar).then_some(operands))
    }

    /// The target of a pointer, for reading.
    pub fn read(&self, pointer: &Value<F>) -> Result<&Value<F>, Stuck> {
        let (address, path) = target(pointer)?;
        let mut at = self.memory.get(address).ok_or_else(nowhere)?.as_ref();
        for step in path {
            at = part(at, *step)?;
        }
        Ok(at)
    }

    /// Reports the scalars of a buffer that a pointer reads.
    pub(super) fn note_read(&self, pointer: &Value<F>, read: &Value<F>) {
        let Ok((address, path)) = target(pointer) else {
            return;
        };
        let mut globals = self.module.global_variables.iter();
        let global = globals.find(|(handle, _)| handle.index() == address);
        if let Some(at) = global.and_then(|(_, global)| layout::place(global)) {
            comparison_notes::read(at, &mut path.to_vec(), read);
        }
    }

    /// The target of a pointer, for writing. Copies a shared variable on the first write.
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
}

fn nowhere() -> Stuck {
    Stuck::Type("a pointer to nothing".to_owned())
}

/// Variable and path of a pointer.
fn target<F: Number>(pointer: &Value<F>) -> Result<(usize, &[usize]), Stuck> {
    match pointer {
        Value::Pointer { address, path } => Ok((*address, path)),
        other => Err(Stuck::Type(format!("{other:?} where a pointer belongs"))),
    }
}

/// A part of a composite. Clamps the index.
pub(crate) fn part<F: Number>(of: &Value<F>, index: usize) -> Result<&Value<F>, Stuck> {
    let Value::Composite(parts) = of else {
        return Err(Stuck::Type("a path into a scalar".to_owned()));
    };
    let last = parts.len().saturating_sub(1);
    let part = parts.get(index.min(last));
    part.ok_or_else(|| Stuck::Type("a path into nothing".to_owned()))
}
