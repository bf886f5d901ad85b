//! A copy of a program in which every loop ends, for a GPU that a loop without end would hang.
//!
//! All loops that may not end count their turns together. When an invocation has taken
//! [`MOST_TURNS`], they leave, and the copy writes the number of the first such loop to a buffer.
//! The copy is drawn to detect that, and never shipped. [`cut`] is for programs whose bindings are
//! fixed: it writes nothing, and allows far more turns.

use naga::{
    AddressSpace, AtomicFunction, BinaryOperator, Block, DerivativeAxis, DerivativeControl,
    Expression, Function, GlobalVariable, Handle, Literal, MathFunction, Module, ResourceBinding,
    Scalar, ScalarKind, ShaderStage, Span, Statement, StorageAccess, Type, TypeInner,
};

use naga_edit::variable;
use naga_edit::writer::FunctionWriter;
use preshade_dataflow::graph::counted::{self, Ends};
use preshade_dataflow::graph::{FunctionGraph, FunctionId, Graph, StmtId};
use preshade_plan::program::Program;
use preshade_plan::safety::{Bounded, MOST_TURNS};
use preshade_plan::uniforms::UniformScalar;
use shader_text::source::Invalid;

/// Most turns of a [`cut`] program: far more than a page takes that a browser draws, and about a
/// second of a GPU.
const MOST_TURNS_OF_CUT: u32 = 1 << 20;

/// Whether a program has a loop that may not end, wherever it is called from. `is_small`: whether a
/// loop counts up to this number of a uniform buffer in a short time.
pub fn is_open(program: &Program, is_small: &dyn Fn(&UniformScalar) -> bool) -> bool {
    let module = program.module();
    let functions = module.functions.iter().map(|(_, f)| f);
    let mut bodies = functions
        .chain(module.entry_points.iter().map(|e| &e.function))
        .map(|f| &f.body);
    if !bodies.any(has_loop) {
        return false;
    }
    let graph = Graph::build(program);
    graph
        .functions()
        .iter()
        .any(|f| !open_loops(module, f, is_small).is_empty())
}

fn has_loop(block: &Block) -> bool {
    block.iter().any(|s| {
        matches!(s, Statement::Loop { .. }) || naga_operands::blocks(s).into_iter().any(has_loop)
    })
}

/// The loops of a function that may not end, in preorder.
fn open_loops(
    module: &Module,
    f: &FunctionGraph<'_>,
    is_small: &dyn Fn(&UniformScalar) -> bool,
) -> Vec<StmtId> {
    let may_not_end = |id: StmtId| match counted::ends(module, f, id) {
        Ends::Always => false,
        Ends::Guarded => {
            !counted::uniform_bound(module, f, id).is_some_and(|bound| is_small(&bound))
        }
        Ends::Unknown => true,
    };
    f.statements
        .iter()
        .filter(|(_, node)| matches!(node.statement, Statement::Loop { .. }))
        .map(|(id, _)| id)
        .filter(|id| may_not_end(*id))
        .collect()
}

/// The bounded copy of a program, whose first loop gets the number `first`, from 1. `None`: every
/// loop ends.
///
/// # Errors
/// The copy does not validate: a bug.
pub fn bounded(
    program: &Program,
    first: u32,
    is_small: &dyn Fn(&UniformScalar) -> bool,
) -> Result<Option<Bounded>, Box<Invalid>> {
    if !is_open(program, is_small) {
        return Ok(None);
    }
    let graph = Graph::build(program);
    let original = program.module();
    let mut module = original.clone();
    let counters = Counters::add(&mut module, MOST_TURNS);
    let flag = Flag::add(&mut module);
    let (mut loops, mut reaching) = (Vec::new(), Vec::new());
    for f in graph.functions() {
        let open = open_loops(original, f, is_small);
        if !open.is_empty() {
            reaching.push(f.id);
        }
        let number = first + loops.len() as u32;
        let numbered = open.iter().zip(number..).map(|(id, n)| (id.index(), n));
        for id in &open {
            let at = program.sources().locate(f.statements.get(*id).span);
            loops.push(at.map_or_else(
                || format!("a loop of `{}`", graph.name(f.id)),
                |at| format!("the loop at line {} of `{}`", at.line, at.file),
            ));
        }
        Rewriter {
            counters: &counters,
            open: numbered.collect(),
            next: 0,
            keeps_discards: false,
        }
        .function(function_of(&mut module, f.id));
    }
    for i in 0..module.entry_points.len() {
        let entry = FunctionId::EntryPoint(i);
        if reaching.iter().any(|f| graph.reaches(entry, *f)) {
            report(&mut module, i, &counters, flag.variable);
        }
    }
    Ok(Some(Bounded {
        program: program.with_module(module)?,
        binding: flag.place,
        loops,
    }))
}

/// A copy of a program in which every loop ends, without a binding of its own. `None`: every loop ends.
///
/// # Errors
/// The copy does not validate: a loop around a barrier.
pub fn cut(program: &Program) -> Result<Option<Program>, Box<Invalid>> {
    if !is_open(program, &|_| false) {
        return Ok(None);
    }
    let graph = Graph::build(program);
    let original = program.module();
    let mut module = original.clone();
    let counters = Counters::add(&mut module, MOST_TURNS_OF_CUT);
    for f in graph.functions() {
        let open = open_loops(original, f, &|_| false);
        Rewriter {
            counters: &counters,
            open: open.iter().map(|id| (id.index(), 1)).collect(),
            next: 0,
            keeps_discards: true,
        }
        .function(function_of(&mut module, f.id));
    }
    program.with_module(module).map(Some)
}

fn function_of(module: &mut Module, id: FunctionId) -> &mut Function {
    match id {
        FunctionId::Function(handle) => module.functions.get_mut(handle),
        FunctionId::EntryPoint(i) => &mut module.entry_points[i].function,
    }
}

/// The variables that count the turns of an invocation.
struct Counters {
    /// The turns of this invocation so far. More than `most` once the fragment is discarded.
    turns: Handle<GlobalVariable>,
    /// The loop that did not end; 0: all did.
    met: Handle<GlobalVariable>,
    /// The most turns that all loops take together.
    most: u32,
}

impl Counters {
    fn add(module: &mut Module, most: u32) -> Self {
        let number = Type {
            name: None,
            inner: TypeInner::Scalar(Scalar::U32),
        };
        let ty = module.types.insert(number, Span::UNDEFINED);
        let mut add = |name| variable::private(module, name, ty, None);
        Self {
            turns: add("preshade_turns"),
            met: add("preshade_met"),
            most,
        }
    }
}

/// The buffer that gets the number of a loop that did not end.
struct Flag {
    /// The largest [`Counters::met`] of all invocations.
    variable: Handle<GlobalVariable>,
    place: ResourceBinding,
}

impl Flag {
    fn add(module: &mut Module) -> Self {
        let used: Vec<ResourceBinding> = module
            .global_variables
            .iter()
            .filter_map(|(_, g)| g.binding)
            .collect();
        let group = used.iter().map(|b| b.group).min().unwrap_or(0);
        let is_free = |binding: &u32| {
            !used.contains(&ResourceBinding {
                group,
                binding: *binding,
            })
        };
        let place = ResourceBinding {
            group,
            binding: (0..).find(is_free).unwrap_or(0),
        };
        let atomic = Type {
            name: None,
            inner: TypeInner::Atomic(Scalar::U32),
        };
        let flag = GlobalVariable {
            name: Some("preshade_loop".to_owned()),
            space: AddressSpace::Storage {
                access: StorageAccess::LOAD | StorageAccess::STORE,
            },
            binding: Some(place),
            ty: module.types.insert(atomic, Span::UNDEFINED),
            init: None,
            memory_decorations: naga::MemoryDecorations::empty(),
        };
        Self {
            variable: module.global_variables.append(flag, Span::UNDEFINED),
            place,
        }
    }
}

/// Rewrites a function's statements in preorder.
struct Rewriter<'g> {
    counters: &'g Counters,
    /// The number of a statement that is an open loop, and the number of the loop.
    open: std::collections::BTreeMap<usize, u32>,
    next: usize,
    keeps_discards: bool,
}

impl Rewriter<'_> {
    fn function(&mut self, function: &mut Function) {
        let mut body = std::mem::take(&mut function.body);
        self.block(function, &mut body, false);
        function.body = body;
    }

    /// `continues`: the block is in a loop's `continuing`, which nothing may return from.
    fn block(&mut self, function: &mut Function, block: &mut Block, continues: bool) {
        let mut out = Block::new();
        for (mut statement, span) in std::mem::take(block).span_into_iter() {
            let number = self.open.get(&self.next).copied();
            self.next += 1;
            let is_loop = matches!(statement, Statement::Loop { .. });
            for (i, inner) in naga_operands::blocks_mut(&mut statement)
                .into_iter()
                .enumerate()
            {
                self.block(function, inner, continues || (is_loop && i == 1));
            }
            match (statement, number) {
                // A discard ends the invocation, but its derivatives are still wanted.
                (Statement::Kill, _) if !self.keeps_discards => {
                    self.leave(function, &mut out, continues)
                }
                (
                    Statement::Loop {
                        mut body,
                        continuing,
                        break_if,
                    },
                    Some(number),
                ) => {
                    let mut counted = self.turn(function, number);
                    counted.append(&mut body);
                    let statement = Statement::Loop {
                        body: counted,
                        continuing,
                        break_if,
                    };
                    out.push(statement, span);
                }
                (statement, _) => out.push(statement, span),
            }
        }
        *block = out;
    }

    /// The first statements of an open loop: it counts, or leaves.
    fn turn(&self, function: &mut Function, number: u32) -> Block {
        let mut all = Function::default();
        std::mem::swap(&mut all.expressions, &mut function.expressions);
        let mut w = FunctionWriter::of(all);
        let Counters { turns, met, most } = *self.counters;
        let turns = w.expression(Expression::GlobalVariable(turns));
        let met = w.expression(Expression::GlobalVariable(met));
        let most = w.expression(Expression::Literal(Literal::U32(most)));
        let one = w.expression(Expression::Literal(Literal::U32(1)));
        let zero = w.expression(Expression::Literal(Literal::U32(0)));
        let name = w.expression(Expression::Literal(Literal::U32(number)));
        let now = w.expression(Expression::Load { pointer: turns });
        let before = w.expression(Expression::Load { pointer: met });
        let mut binary = |op, left, right| w.expression(Expression::Binary { op, left, right });
        let over = binary(BinaryOperator::GreaterEqual, now, most);
        let at_end = binary(BinaryOperator::Equal, now, most);
        let is_first = binary(BinaryOperator::Equal, before, zero);
        let tells = binary(BinaryOperator::LogicalAnd, at_end, is_first);
        let enclosing = w.open(Span::UNDEFINED);
        let outer = w.open(Span::UNDEFINED);
        w.statement(store(met, name), Span::UNDEFINED);
        let accept = w.close(outer, Span::UNDEFINED);
        w.statement(when(tells, accept), Span::UNDEFINED);
        w.statement(Statement::Break, Span::UNDEFINED);
        let accept = w.close(enclosing, Span::UNDEFINED);
        w.statement(when(over, accept), Span::UNDEFINED);
        let next = w.expression(Expression::Binary {
            op: BinaryOperator::Add,
            left: now,
            right: one,
        });
        w.statement(store(turns, next), Span::UNDEFINED);
        let mut written = w.finish();
        std::mem::swap(&mut written.expressions, &mut function.expressions);
        written.body
    }

    /// Returns in place of a discard. No open loop turns from then on.
    fn leave(&self, function: &mut Function, out: &mut Block, continues: bool) {
        let mut append = |e| function.expressions.append(e, Span::UNDEFINED);
        let turns = append(Expression::GlobalVariable(self.counters.turns));
        let over = append(Expression::Literal(Literal::U32(self.counters.most + 1)));
        out.push(store(turns, over), Span::UNDEFINED);
        if continues {
            return;
        }
        let result = function.result.as_ref().map(|r| r.ty);
        let value = result.map(|ty| {
            let zero = Expression::ZeroValue(ty);
            function.expressions.append(zero, Span::UNDEFINED)
        });
        out.push(Statement::Return { value }, Span::UNDEFINED);
    }
}

fn store(pointer: Handle<Expression>, value: Handle<Expression>) -> Statement {
    Statement::Store { pointer, value }
}

fn when(condition: Handle<Expression>, accept: Block) -> Statement {
    Statement::If {
        condition,
        accept,
        reject: Block::new(),
    }
}

/// Makes an entry point write its loop that did not end. The lanes of a quad that lie outside of a
/// triangle run the fragment stage too and write nothing: their neighbours detect it by
/// derivatives, and write it for them.
fn report(module: &mut Module, entry: usize, counters: &Counters, flag: Handle<GlobalVariable>) {
    let point = &mut module.entry_points[entry];
    // With it, depths would hide fragments that the stage is to run for.
    point.early_depth_test = None;
    let stage = point.stage;
    let mut whole = std::mem::take(&mut point.function);
    let mut w = FunctionWriter::of(Function {
        name: whole.name.clone(),
        arguments: whole.arguments.clone(),
        result: whole.result.clone(),
        ..Function::default()
    });
    whole.name = Some(format!("{}_bounded", module.entry_points[entry].name));
    for argument in &mut whole.arguments {
        argument.binding = None;
    }
    let mut has_result = false;
    if let Some(result) = &mut whole.result {
        result.binding = None;
        has_result = true;
    }
    let arguments = 0..whole.arguments.len() as u32;
    let called = module.functions.append(whole, Span::UNDEFINED);
    let arguments = arguments.map(|i| w.expression(Expression::FunctionArgument(i)));
    let arguments: Vec<_> = arguments.collect();
    let value = match has_result {
        true => Some(w.call(called, arguments)),
        false => {
            let call = Statement::Call {
                function: called,
                arguments,
                result: None,
            };
            w.statement(call, Span::UNDEFINED);
            None
        }
    };
    let pointer = w.expression(Expression::GlobalVariable(counters.met));
    let mut met = w.expression(Expression::Load { pointer });
    if stage == ShaderStage::Fragment {
        met = of_quad(&mut w, met);
    }
    let zero = w.expression(Expression::Literal(Literal::U32(0)));
    let is_met = w.expression(Expression::Binary {
        op: BinaryOperator::NotEqual,
        left: met,
        right: zero,
    });
    let flag = w.expression(Expression::GlobalVariable(flag));
    let enclosing = w.open(Span::UNDEFINED);
    let write = Statement::Atomic {
        pointer: flag,
        fun: AtomicFunction::Max,
        value: met,
        result: None,
    };
    w.statement(write, Span::UNDEFINED);
    let accept = w.close(enclosing, Span::UNDEFINED);
    w.statement(when(is_met, accept), Span::UNDEFINED);
    w.statement(Statement::Return { value }, Span::UNDEFINED);
    module.entry_points[entry].function = w.finish();
}

/// A number of this lane, or of another one of its quad if this lane has 0.
fn of_quad(w: &mut FunctionWriter, number: Handle<Expression>) -> Handle<Expression> {
    let mut seen = w.expression(Expression::As {
        expr: number,
        kind: ScalarKind::Float,
        convert: Some(4),
    });
    for axis in [DerivativeAxis::X, DerivativeAxis::Y] {
        let slope = w.expression(Expression::Derivative {
            axis,
            ctrl: DerivativeControl::Fine,
            expr: seen,
        });
        let mut math = |fun, arg, arg1| {
            w.expression(Expression::Math {
                fun,
                arg,
                arg1,
                arg2: None,
                arg3: None,
            })
        };
        let far = math(MathFunction::Abs, slope, None);
        seen = math(MathFunction::Max, seen, Some(far));
    }
    w.expression(Expression::As {
        expr: seen,
        kind: ScalarKind::Uint,
        convert: Some(4),
    })
}
