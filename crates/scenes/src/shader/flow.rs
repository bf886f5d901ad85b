//! The dataflow of a shader stage: the bound variables and inputs behind each value.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use naga::{
    AddressSpace, ArraySize, BinaryOperator, Binding, Expression, GlobalVariable, Handle,
    MathFunction, Module, ScalarKind, Statement, Type, TypeInner,
};
use naga_edit::interface::Io;
use preshade_dataflow::graph::Graph;
use preshade_passes::analysis::values::{ContextId, Node, ValueId, Values};

use preshade_draw::scene::layout::{leaf_shape, runtime_array};
use preshade_draw::scene::{Semantic, bind};

/// The values of one stage.
pub struct StageFlow<'g, 'p> {
    pub values: Values<'g, 'p>,
}

/// A read of a bound variable or of a part of it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct BufferRead {
    pub global: Handle<GlobalVariable>,
    /// The struct members that lead to it. All elements of an array count as one.
    pub members: Vec<u32>,
    /// The type at the end of `members`, without arrays around it.
    pub ty: Handle<Type>,
    /// The component of a vector, if only one is read.
    pub component: Option<u32>,
}

impl BufferRead {
    /// The path in a scene's syntax: `variable.member`.
    pub fn text(&self, module: &Module) -> String {
        self.text_at(module, None)
    }

    /// The path with an index into the runtime-sized array.
    pub fn text_at(&self, module: &Module, index: Option<usize>) -> String {
        let global = &module.global_variables[self.global];
        let mut text = global.name.clone().unwrap_or_default();
        let indexed = |ty: Handle<Type>| match (&module.types[ty].inner, index) {
            (
                TypeInner::Array {
                    size: ArraySize::Dynamic,
                    ..
                },
                Some(i),
            ) => format!("[{i}]"),
            _ => String::new(),
        };
        text.push_str(&indexed(global.ty));
        let mut ty = element(module, global.ty);
        for member in &self.members {
            let TypeInner::Struct { members, .. } = &module.types[ty].inner else {
                break;
            };
            let Some(member) = members.get(*member as usize) else {
                break;
            };
            if !text.is_empty() {
                text.push('.');
            }
            text.push_str(member.name.as_deref().unwrap_or(""));
            text.push_str(&indexed(member.ty));
            ty = element(module, member.ty);
        }
        text
    }

    /// Whether the host sets it, with one value for the whole draw.
    pub fn is_uniform(&self, module: &Module) -> bool {
        let space = module.global_variables[self.global].space;
        matches!(space, AddressSpace::Uniform | AddressSpace::Immediate)
    }

    /// Its made-up value in the scene of a bare shader. `None` if its name has a conventional
    /// meaning.
    pub(super) fn made_up(&self, module: &Module) -> Option<Vec<f64>> {
        bind::made_up(&self.text(module), &module.types[self.ty].inner)
    }

    /// The conventional meaning of its name.
    pub fn semantic(&self, module: &Module) -> Option<Semantic> {
        Semantic::of_path(self.text(module).rsplit('.'))
    }
}

/// The element type of nested arrays. Other types are returned unchanged.
pub(crate) fn element(module: &Module, mut ty: Handle<Type>) -> Handle<Type> {
    while let TypeInner::Array { base, .. } = module.types[ty].inner {
        ty = base;
    }
    ty
}

/// The most names that a value is followed through.
const MOST_NAMES: usize = 64;

/// The values that one value depends on, with the indirectness of each.
#[derive(Default)]
pub struct Nearest {
    /// Indirectness of each value.
    pub cost: BTreeMap<ValueId, u32>,
    /// The user of each value on the most direct path.
    user: BTreeMap<ValueId, ValueId>,
}

impl Nearest {
    /// The values on the path from the root to `value`.
    pub fn way(&self, value: ValueId) -> Vec<ValueId> {
        let mut way = vec![value];
        let mut at = value;
        while let Some(user) = self.user.get(&at) {
            way.push(*user);
            at = *user;
        }
        way.reverse();
        way
    }
}

/// How indirectly a matrix enters its product with a vector or a scalar.
pub(crate) const MATRIX_OF_PRODUCT: u32 = 10;

/// A vertex input that is more indirect than this is not a position.
pub(crate) const MOST_INDIRECT: u32 = 20;

pub(crate) fn location(io: &Io) -> Option<u32> {
    match io.binding {
        Some(Binding::Location { location, .. }) => Some(location),
        _ => None,
    }
}

impl<'g, 'p> StageFlow<'g, 'p> {
    /// `None`: the stage is too large to analyse.
    pub fn new(graph: &'g Graph<'p>, entry: usize) -> Option<Self> {
        let values = Values::new(graph, entry).ok()?;
        Some(Self { values })
    }

    /// The values that a value depends on, including itself.
    pub fn behind(&self, value: ValueId) -> BTreeSet<ValueId> {
        let mut found = BTreeSet::from([value]);
        let mut work = vec![value];
        while let Some(at) = work.pop() {
            let operands = self.values.values[at].operands.iter();
            work.extend(operands.filter(|o| found.insert(**o)));
        }
        found
    }

    /// Index of the entry point's input that a value reads.
    pub fn input(&self, value: ValueId) -> Option<usize> {
        match self.values.values[value].node {
            Node::Input(input) => Some(input),
            _ => None,
        }
    }

    /// The expression of a value, with the struct members that it selects.
    pub fn expression(&self, value: ValueId) -> Option<(ContextId, &'g Expression, &[u32])> {
        match &self.values.values[value].node {
            Node::Expression(context, e, path) => {
                let function = self.values.function(*context).function;
                Some((*context, &function.expressions[*e], path))
            }
            _ => None,
        }
    }

    /// The operands of a product.
    pub fn product(
        &self,
        value: ValueId,
    ) -> Option<(ContextId, Handle<Expression>, Handle<Expression>)> {
        let (context, expression, _) = self.expression(value)?;
        let Expression::Binary {
            op: BinaryOperator::Multiply,
            left,
            right,
        } = *expression
        else {
            return None;
        };
        Some((context, left, right))
    }

    /// The variable that a value loads.
    pub fn read(&self, value: ValueId) -> Option<BufferRead> {
        let (context, Expression::Load { pointer }, path) = self.expression(value)? else {
            return None;
        };
        let (global, mut steps) = self.pointed(context, *pointer)?;
        steps.extend(path.iter().map(|m| Some(*m)));
        let module = self.values.graph.module();
        let mut read = BufferRead {
            global,
            members: Vec::new(),
            ty: module.global_variables[global].ty,
            component: None,
        };
        for step in steps {
            match &module.types[read.ty].inner {
                TypeInner::Array { base, .. } => read.ty = *base,
                TypeInner::Struct { members, .. } => {
                    let member = step?;
                    read.members.push(member);
                    read.ty = members.get(member as usize)?.ty;
                }
                TypeInner::Vector { .. } => read.component = step,
                _ => break,
            }
        }
        read.ty = element(module, read.ty);
        Some(read)
    }

    /// The index with which a value loads an array element.
    pub fn index(&self, value: ValueId) -> Option<ValueId> {
        let (context, Expression::Load { pointer }, _) = self.expression(value)? else {
            return None;
        };
        let mut at = *pointer;
        loop {
            match self.values.function(context).function.expressions[at] {
                Expression::AccessIndex { base, .. } => at = base,
                Expression::Access { index, .. } => return self.values.named(context, index),
                _ => return None,
            }
        }
    }

    /// Follows values that only pass on an operand: a variable's content or a call's result.
    pub fn through(&self, mut value: ValueId) -> ValueId {
        // A loop-carried value would lead back to itself.
        for _ in 0..MOST_NAMES {
            let is_name = match self.expression(value) {
                Some((_, Expression::Load { .. }, _)) => self.read(value).is_none(),
                Some((context, Expression::AccessIndex { base, .. }, _)) => {
                    let f = self.values.function(context);
                    let base = f.ty(self.values.graph.module(), *base);
                    matches!(base, TypeInner::Struct { .. })
                }
                Some((_, e, _)) => {
                    matches!(
                        e,
                        Expression::CallResult(_) | Expression::FunctionArgument(_)
                    )
                }
                None => self.input(value).is_none(),
            };
            let operands = self.values.values[value].operands.iter();
            let mut data = operands.filter(|o| !self.is_condition(**o));
            match (is_name, data.next(), data.next()) {
                (true, Some(only), None) => value = *only,
                _ => break,
            }
        }
        value
    }

    /// The variables that are factors of a value. Conversions and swizzles are looked through.
    pub fn factors(&self, value: ValueId) -> Vec<BufferRead> {
        let (mut found, mut seen) = (Vec::new(), BTreeSet::new());
        let mut work = vec![value];
        while let Some(value) = work.pop() {
            let value = self.through(value);
            if !seen.insert(value) {
                continue;
            }
            if let Some(read) = self.read(value) {
                found.push(read);
                continue;
            }
            let Some((context, expression, _)) = self.expression(value) else {
                continue;
            };
            let parts = match expression {
                Expression::As { expr, .. } | Expression::Unary { expr, .. } => vec![*expr],
                Expression::Splat { value, .. } => vec![*value],
                Expression::AccessIndex { base, .. } => vec![*base],
                Expression::Swizzle { vector, .. } => vec![*vector],
                Expression::Compose { components, .. } => components.clone(),
                Expression::Math {
                    fun: MathFunction::Abs | MathFunction::Clamp | MathFunction::Saturate,
                    arg,
                    ..
                } => vec![*arg],
                Expression::Binary {
                    op: BinaryOperator::Multiply,
                    left,
                    right,
                } => vec![*left, *right],
                _ => continue,
            };
            let parts = parts.into_iter();
            work.extend(parts.filter_map(|e| self.values.named(context, e)));
        }
        found
    }

    fn is_condition(&self, value: ValueId) -> bool {
        matches!(self.values.values[value].node, Node::Control(..))
    }

    /// The values behind `root`, each with its indirectness: 0 for a term of a sum or the vector
    /// that a matrix multiplies, more for a factor, an index or a condition.
    pub fn nearest(&self, root: ValueId) -> Nearest {
        let mut found = Nearest::default();
        let mut work = BinaryHeap::from([Reverse((0, root))]);
        found.cost.insert(root, 0);
        while let Some(Reverse((cost, value))) = work.pop() {
            if found.cost[&value] < cost {
                continue;
            }
            for operand in &self.values.values[value].operands {
                let there = cost + self.distance(value, *operand);
                if found.cost.get(operand).is_none_or(|known| there < *known) {
                    found.cost.insert(*operand, there);
                    found.user.insert(*operand, value);
                    work.push(Reverse((there, *operand)));
                }
            }
        }
        found
    }

    fn distance(&self, value: ValueId, operand: ValueId) -> u32 {
        if self.is_condition(operand) {
            return 50;
        }
        let Some((context, expression, _)) = self.expression(value) else {
            return 0;
        };
        let is = |e: Handle<Expression>| self.values.named(context, e) == Some(operand);
        let f = self.values.function(context);
        let ty = |e| f.ty(self.values.graph.module(), e);
        match *expression {
            Expression::Load { .. } => match self.values.values[operand].node {
                Node::Version(..) => 0,
                _ => 20,
            },
            Expression::Access { index, .. } if is(index) => 20,
            Expression::Select { condition, .. } if is(condition) => 20,
            Expression::Binary { op, left, right } => {
                let other = if is(left) { right } else { left };
                let own = if is(left) { left } else { right };
                match op {
                    BinaryOperator::Add | BinaryOperator::Subtract => 0,
                    BinaryOperator::Multiply => match (ty(own), ty(other)) {
                        (TypeInner::Matrix { .. }, _) => MATRIX_OF_PRODUCT,
                        (_, TypeInner::Matrix { .. }) => 0,
                        (TypeInner::Scalar(_), TypeInner::Vector { .. }) => 8,
                        // A scaled term displaces the other one.
                        _ => 1,
                    },
                    BinaryOperator::Divide if is(left) => 0,
                    _ => 20,
                }
            }
            Expression::Unary { .. } => 0,
            Expression::Math { .. } => 10,
            Expression::ImageSample { .. } | Expression::ImageLoad { .. } => 20,
            _ => 0,
        }
    }

    /// Components and kind of an input.
    pub(crate) fn shape(&self, io: &Io) -> Option<(u32, ScalarKind)> {
        let module = self.values.graph.module();
        let (_, rows, scalar) = leaf_shape(&module.types[io.ty].inner)?;
        Some((rows, scalar.kind))
    }

    /// Whether a value reads an element of a runtime-sized array with scalars of these kinds.
    pub(crate) fn is_array_read(&self, value: ValueId, kinds: &[ScalarKind]) -> bool {
        let module = self.values.graph.module();
        self.read(value).is_some_and(|read| {
            let global = &module.global_variables[read.global];
            let leaf = leaf_shape(&module.types[read.ty].inner);
            matches!(global.space, AddressSpace::Storage { .. })
                && runtime_array(module, global.ty).is_some()
                && leaf.is_some_and(|(columns, _, scalar)| {
                    columns == 1 && kinds.contains(&scalar.kind)
                })
        })
    }

    /// The variable of a pointer, and the path into it. `None` for a dynamic index.
    fn pointed(
        &self,
        mut context: ContextId,
        mut at: Handle<Expression>,
    ) -> Option<(Handle<GlobalVariable>, Vec<Option<u32>>)> {
        let mut steps = Vec::new();
        loop {
            match self.values.function(context).function.expressions[at] {
                Expression::AccessIndex { base, index } => {
                    steps.push(Some(index));
                    at = base;
                }
                Expression::Access { base, .. } => {
                    steps.push(None);
                    at = base;
                }
                Expression::GlobalVariable(global) => {
                    steps.reverse();
                    return Some((global, steps));
                }
                Expression::FunctionArgument(i) => {
                    let (caller, call) = self.values.contexts[context].call?;
                    let outer = self.values.function(caller);
                    let Statement::Call { arguments, .. } = outer.statements.get(call).statement
                    else {
                        return None;
                    };
                    at = *arguments.get(i as usize)?;
                    context = caller;
                }
                _ => return None,
            }
        }
    }
}
