//! A stage as `resolve` passes it to `build`: names, types, overloads, layouts of blocks and the
//! order of evaluation are resolved. `build` converts it to IR node by node.
//!
//! `resolve` cannot write IR itself, for three reasons. It resolves some expressions twice, the
//! first time only for their types. The structs and globals of the module are known only when all
//! functions are resolved. The calls of all functions determine which textures compare. The IR
//! needs all of this in advance.

use std::rc::Rc;

use naga::{
    AtomicFunction, BinaryOperator, Binding, Literal, MathFunction, ResourceBinding, Span,
    UnaryOperator,
};

use super::built_in_variables::Variable;
use super::functions::Meaning;
use super::layout::Rules;
use super::operations::Subgroup;
use super::textures::TextureFunction;
use super::ty::Ty;

/// A local variable, by its index in [`Stage::locals`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct LocalId(pub usize);

/// A global, by its index in [`Stage::globals`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct GlobalId(pub usize);

/// A function, by its index in [`Stage::functions`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct FunctionId(pub usize);

/// An expression. Two places that share a node evaluate it twice.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub kind: Rc<Kind>,
    /// If undefined, the span of the enclosing node applies.
    pub span: Span,
    /// Number of nodes in it. Shared nodes count each time.
    pub size: usize,
}

/// The operation of an expression.
#[derive(Debug)]
pub(super) enum Kind {
    Literal(Literal),
    Local(LocalId),
    /// A parameter of the function, by index.
    Parameter(usize),
    Global(GlobalId),
    /// A built-in variable that becomes a global on first use.
    BuiltIn(&'static Variable),
    /// An element of an array, a column or a component.
    Element(Node, Node),
    /// A member of a struct or block.
    Field(Node, String),
    /// One to four components of a vector.
    Swizzle(Node, Vec<u32>),
    Unary(UnaryOperator, Node),
    Binary(BinaryOperator, Node, Node),
    /// `condition ? accept : reject`.
    Choose(Node, Node, Node),
    Assign(Node, Node),
    /// `x++` and the like.
    Step {
        op: BinaryOperator,
        postfix: bool,
        of: Node,
    },
    Construct(Ty, Vec<Node>),
    /// A texture with its sampler.
    Combine {
        texture: Node,
        sampler: Node,
        compares: bool,
    },
    Call(FunctionId, Vec<Node>),
    BuiltInCall(Meaning, Vec<Node>),
    /// A call of a texture or image function.
    TextureCall(TextureFunction, Vec<Node>),
    /// The length of an unsized array.
    Length(Node),
    /// Evaluates all, with the value of the last.
    Sequence(Vec<Node>),
    Gather(Gather),
    Subgroup {
        of: Subgroup,
        value: Node,
        lane: Option<Node>,
        result: Ty,
    },
    Atomic {
        of: AtomicFunction,
        target: Node,
        value: Node,
    },
    ImageAtomic {
        of: AtomicFunction,
        image: Node,
        at: Node,
        value: Node,
    },
}

/// Gathers a component of a texture, at an offset in texels.
#[derive(Debug)]
pub(super) struct Gather {
    pub texture: Node,
    pub sampler: Node,
    pub coordinates: Node,
    pub depth: Option<Node>,
    pub component: u32,
    pub offset: Option<[i32; 2]>,
}

impl Node {
    pub(super) fn new(kind: Kind) -> Self {
        let mut size = 1usize;
        kind.operands(&mut |of| size = size.saturating_add(of.size));
        Self {
            kind: Rc::new(kind),
            span: Span::UNDEFINED,
            size,
        }
    }

    /// The same node with a span, if one is known.
    pub(super) fn at(mut self, place: Option<Span>) -> Self {
        self.span = place.unwrap_or(self.span);
        self
    }

    pub(super) fn literal(literal: Literal) -> Self {
        Self::new(Kind::Literal(literal))
    }

    pub(super) fn int(n: i32) -> Self {
        Self::literal(Literal::I32(n))
    }

    pub(super) fn uint(n: u32) -> Self {
        Self::literal(Literal::U32(n))
    }

    pub(super) fn float(x: f32) -> Self {
        Self::literal(Literal::F32(x))
    }

    pub(super) fn bool(b: bool) -> Self {
        Self::literal(Literal::Bool(b))
    }

    pub(super) fn local(id: LocalId) -> Self {
        Self::new(Kind::Local(id))
    }

    pub(super) fn element(&self, index: Self) -> Self {
        Self::new(Kind::Element(self.clone(), index))
    }

    /// An element with a constant index.
    pub(super) fn nth(&self, index: u32) -> Self {
        self.element(Self::int(index as i32))
    }

    pub(super) fn field(&self, name: impl Into<String>) -> Self {
        Self::new(Kind::Field(self.clone(), name.into()))
    }

    pub(super) fn swizzle(&self, components: impl IntoIterator<Item = u32>) -> Self {
        Self::new(Kind::Swizzle(
            self.clone(),
            components.into_iter().collect(),
        ))
    }

    pub(super) fn component(&self, n: u32) -> Self {
        self.swizzle([n])
    }

    pub(super) fn unary(op: UnaryOperator, of: Self) -> Self {
        Self::new(Kind::Unary(op, of))
    }

    pub(super) fn binary(op: BinaryOperator, a: Self, b: Self) -> Self {
        Self::new(Kind::Binary(op, a, b))
    }

    pub(super) fn choose(condition: Self, accept: Self, reject: Self) -> Self {
        Self::new(Kind::Choose(condition, accept, reject))
    }

    pub(super) fn assign(to: &Self, value: Self) -> Self {
        Self::new(Kind::Assign(to.clone(), value))
    }

    pub(super) fn construct(ty: &Ty, parts: Vec<Self>) -> Self {
        Self::new(Kind::Construct(ty.clone(), parts))
    }

    /// Converts a value to another component type.
    pub(super) fn convert(ty: &Ty, value: Self) -> Self {
        Self::construct(ty, vec![value])
    }

    pub(super) fn built_in(meaning: Meaning, arguments: Vec<Self>) -> Self {
        Self::new(Kind::BuiltInCall(meaning, arguments))
    }

    pub(super) fn math(function: MathFunction, arguments: Vec<Self>) -> Self {
        Self::built_in(Meaning::Math(function), arguments)
    }

    pub(super) fn texture(function: TextureFunction, arguments: Vec<Self>) -> Self {
        Self::new(Kind::TextureCall(function, arguments))
    }

    /// Evaluates `first`, then the node.
    pub(super) fn after(first: Vec<Self>, node: Self) -> Self {
        if first.is_empty() {
            return node;
        }
        let mut all = first;
        all.push(node);
        Self::new(Kind::Sequence(all))
    }

    /// Whether reading it twice is free of effects and cost: a path of variables, members and
    /// numbers.
    pub(super) fn is_path(&self) -> bool {
        match &*self.kind {
            Kind::Literal(_) => true,
            Kind::Local(_) | Kind::Parameter(_) | Kind::Global(_) | Kind::BuiltIn(_) => true,
            Kind::Field(of, _) | Kind::Swizzle(of, _) => of.is_path(),
            Kind::Element(of, index) => of.is_path() && index.is_path(),
            _ => false,
        }
    }

    /// Whether it only reads, and contains no calls.
    pub(super) fn is_pure(&self) -> bool {
        let mut pure = true;
        self.visit(&mut |of| {
            pure &= !matches!(
                &*of.kind,
                Kind::Call(..)
                    | Kind::BuiltInCall(..)
                    | Kind::TextureCall(..)
                    | Kind::Construct(..)
                    | Kind::Assign(..)
                    | Kind::Step { .. }
                    | Kind::Atomic { .. }
                    | Kind::ImageAtomic { .. }
            );
        });
        pure
    }

    /// Whether it changes a variable, an image or an atomic counter. `is_writing`: whether a call of
    /// the function does.
    pub(super) fn writes(&self, is_writing: &dyn Fn(FunctionId) -> bool) -> bool {
        let mut writes = false;
        self.visit(&mut |of| {
            writes |= match &*of.kind {
                Kind::Call(id, _) => is_writing(*id),
                Kind::Assign(..)
                | Kind::Step { .. }
                | Kind::Atomic { .. }
                | Kind::ImageAtomic { .. }
                | Kind::TextureCall(TextureFunction::Store, _) => true,
                _ => false,
            };
        });
        writes
    }

    /// Calls `each` for the node and all nodes in it, outermost first.
    pub(super) fn visit<'n>(&'n self, each: &mut dyn FnMut(&'n Self)) {
        each(self);
        self.kind.operands(&mut |of| of.visit(each));
    }

    /// Whether it is a variable or a literal.
    pub(super) fn is_name(&self) -> bool {
        self.is_path()
            && !matches!(
                &*self.kind,
                Kind::Field(..) | Kind::Swizzle(..) | Kind::Element(..)
            )
    }

    /// The number, if it is a literal index.
    pub(super) fn index(&self) -> Option<usize> {
        match *self.kind {
            Kind::Literal(Literal::I32(n)) => usize::try_from(n).ok(),
            _ => None,
        }
    }
}

impl Kind {
    /// Calls `each` for the operands in textual order.
    fn operands<'n>(&'n self, each: &mut dyn FnMut(&'n Node)) {
        match self {
            Self::Literal(_)
            | Self::Local(_)
            | Self::Parameter(_)
            | Self::Global(_)
            | Self::BuiltIn(_) => {}
            Self::Field(of, _)
            | Self::Swizzle(of, _)
            | Self::Unary(_, of)
            | Self::Step { of, .. }
            | Self::Length(of) => each(of),
            Self::Element(a, b) | Self::Binary(_, a, b) | Self::Assign(a, b) => {
                each(a);
                each(b);
            }
            Self::Choose(a, b, c) => [a, b, c].into_iter().for_each(each),
            Self::Construct(_, all)
            | Self::Call(_, all)
            | Self::BuiltInCall(_, all)
            | Self::TextureCall(_, all)
            | Self::Sequence(all) => all.iter().for_each(each),
            Self::Combine {
                texture, sampler, ..
            } => [texture, sampler].into_iter().for_each(each),
            Self::Gather(of) => {
                [&of.texture, &of.sampler, &of.coordinates]
                    .into_iter()
                    .chain(&of.depth)
                    .for_each(each);
            }
            Self::Subgroup { value, lane, .. } => [value].into_iter().chain(lane).for_each(each),
            Self::Atomic { target, value, .. } => [target, value].into_iter().for_each(each),
            Self::ImageAtomic {
                image, at, value, ..
            } => [image, at, value].into_iter().for_each(each),
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Statement {
    pub kind: StatementKind,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub(super) enum StatementKind {
    Declare(LocalId, Option<Node>),
    Evaluate(Node),
    Block(Vec<Statement>),
    If {
        condition: Node,
        accept: Vec<Statement>,
        reject: Option<Vec<Statement>>,
    },
    Switch {
        selector: Node,
        cases: Vec<Case>,
    },
    While {
        condition: Node,
        body: Vec<Statement>,
    },
    DoWhile {
        body: Vec<Statement>,
        condition: Node,
    },
    For {
        init: Option<Box<Statement>>,
        condition: Option<Node>,
        step: Option<Node>,
        body: Vec<Statement>,
    },
    Break,
    Continue,
    Discard,
    Return(Option<Node>),
}

/// A label of a `switch` with the statements up to the next.
#[derive(Clone, Debug)]
pub(super) struct Case {
    /// `None` for `default`.
    pub value: Option<i64>,
    pub body: Vec<Statement>,
}

impl Statement {
    pub(super) fn new(kind: StatementKind) -> Self {
        Self {
            kind,
            span: Span::UNDEFINED,
        }
    }

    pub(super) fn at(mut self, place: Option<Span>) -> Self {
        self.span = place.unwrap_or(self.span);
        self
    }

    pub(super) fn evaluate(node: Node) -> Self {
        Self::new(StatementKind::Evaluate(node))
    }

    /// Calls `each` for each top-level node, in textual order.
    fn nodes<'s>(&'s self, each: &mut dyn FnMut(&'s Node)) {
        let all = |body: &'s [Statement], each: &mut dyn FnMut(&'s Node)| {
            body.iter().for_each(|s| s.nodes(each));
        };
        match &self.kind {
            StatementKind::Declare(_, init) => init.iter().for_each(each),
            StatementKind::Evaluate(of) => each(of),
            StatementKind::Block(body) => all(body, each),
            StatementKind::If {
                condition,
                accept,
                reject,
            } => {
                each(condition);
                all(accept, each);
                all(reject.as_deref().unwrap_or_default(), each);
            }
            StatementKind::Switch { selector, cases } => {
                each(selector);
                cases.iter().for_each(|case| all(&case.body, each));
            }
            StatementKind::While { condition, body } => {
                each(condition);
                all(body, each);
            }
            StatementKind::DoWhile { body, condition } => {
                all(body, each);
                each(condition);
            }
            StatementKind::For {
                init,
                condition,
                step,
                body,
            } => {
                init.iter().for_each(|s| s.nodes(each));
                condition.iter().chain(step).for_each(&mut *each);
                all(body, each);
            }
            StatementKind::Break | StatementKind::Continue | StatementKind::Discard => {}
            StatementKind::Return(value) => value.iter().for_each(each),
        }
    }

    /// Calls `each` for each node, outermost first.
    pub(super) fn visit<'s>(&'s self, each: &mut dyn FnMut(&'s Node)) {
        self.nodes(&mut |node| node.visit(each));
    }

    /// Whether statements after it are unreachable.
    pub(super) fn leaves(&self) -> bool {
        match &self.kind {
            StatementKind::Break
            | StatementKind::Continue
            | StatementKind::Discard
            | StatementKind::Return(_) => true,
            StatementKind::Block(inner) => inner.iter().any(Self::leaves),
            _ => false,
        }
    }

    /// Number of nodes in it.
    pub(super) fn size(&self) -> usize {
        let mut size = 1usize;
        self.nodes(&mut |node| size = size.saturating_add(node.size));
        size
    }
}

#[derive(Clone, Debug)]
pub(super) struct Local {
    pub name: String,
    pub ty: Ty,
}

/// A parameter of a function.
#[derive(Clone, Debug)]
pub(super) struct Parameter {
    pub name: String,
    pub ty: ParameterTy,
    /// Whether the call writes it.
    pub is_out: bool,
    /// Whether the call reads it.
    pub is_in: bool,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub(super) enum ParameterTy {
    Data(Ty),
    Handle(HandleTy),
}

/// The type of a texture, a sampler or an image.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct HandleTy {
    /// Such as `texture2D`, `sampler` or `iimage3D`.
    pub name: String,
    /// Whether it is sampled with comparisons.
    pub compares: bool,
}

impl HandleTy {
    /// A type with the author's name.
    pub(super) fn plain(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            compares: false,
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Function {
    pub name: String,
    pub parameters: Vec<Parameter>,
    pub result: Ty,
    pub body: Vec<Statement>,
    /// Whether its parameters are only read, so that they need no variables.
    pub is_plain: bool,
    pub span: Span,
}

/// A struct, in the order of declaration.
#[derive(Clone, Debug)]
pub(super) struct StructTy {
    pub name: String,
    /// The rules of the blocks that contain it. `None`: it is only a value.
    pub rules: Option<Rules>,
    pub members: Vec<Member>,
}

/// A member of a struct or block in its stored type.
#[derive(Clone, Debug)]
pub(super) struct Member {
    pub name: String,
    pub ty: Ty,
    pub span: Span,
}

/// A global variable or constant.
#[derive(Clone, Debug)]
pub(super) struct Global {
    pub name: Option<String>,
    pub kind: GlobalKind,
    pub span: Span,
}

#[derive(Clone, Debug)]
pub(super) struct BlockTy {
    pub name: String,
    pub members: Vec<Member>,
    pub rules: Rules,
    pub space: naga::AddressSpace,
    pub binding: Option<ResourceBinding>,
    /// Set for an array of blocks: its length, if it is sized.
    pub length: Option<Option<u32>>,
    /// Whether its members are used without an instance name.
    pub is_open: bool,
}

#[derive(Clone, Debug)]
pub(super) enum GlobalKind {
    Block(BlockTy),
    /// A texture, sampler or image.
    Handle {
        ty: HandleTy,
        /// The lengths of the enclosing arrays, outermost first.
        lengths: Vec<Option<u32>>,
        binding: ResourceBinding,
        format: Option<naga::StorageFormat>,
        access: naga::StorageAccess,
    },
    /// An input or output of the stage.
    Port {
        ty: Ty,
        is_output: bool,
        binding: Binding,
        /// Name in the entry point.
        name: String,
    },
    Variable {
        ty: Ty,
        init: Option<Node>,
    },
    Constant {
        ty: Ty,
        init: Node,
    },
    Override {
        ty: Ty,
        id: u32,
        init: Node,
    },
}

#[derive(Debug, Default)]
pub(super) struct Stage {
    pub structs: Vec<StructTy>,
    /// The declared globals, in order of declaration.
    pub declared: Vec<GlobalId>,
    pub globals: Vec<Global>,
    pub locals: Vec<Local>,
    /// In any order; [`Stage::order`] has the callees first.
    pub functions: Vec<Option<Function>>,
    pub order: Vec<FunctionId>,
    pub main: Option<FunctionId>,
    pub early_fragment_tests: bool,
    /// Whether the position is invariant.
    pub invariant: bool,
}
