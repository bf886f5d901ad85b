//! Resolves expressions: their types, implicit conversions and layouts.

use glsl_lang::ast;
use glsl_lang::ast::{
    AssignmentOpData as A, BinaryOpData as B, Expr, ExprData, InitializerData, UnaryOpData,
};
use naga::{BinaryOperator, Literal, UnaryOperator};

use super::effect::{after, is_literal};
use super::fold::Folds;
use super::overload::is_same;
use super::{Pair, Resolver, Var, check};
use crate::constant::ConstantValue;
use crate::errors::{unsupported, wrong};
use crate::layout::MemoryLayout;
use crate::tree::{Kind, Node};
use crate::ty::{Component, Ty};
use crate::{built_in_variables, constant};
use shader_text::error::{Code, Error};
use shader_text::unsupported;

/// Maximum elements compared one by one.
const COMPARED: u64 = 1 << 12;

#[derive(Clone, Debug)]
pub(super) struct Ex {
    pub node: Node,
    pub ty: Ty,
    /// Its layout in a block. [`Resolver::value`] converts it to a value.
    pub lay: MemoryLayout,
    /// Assignment targets by component, if the IR has no pointer to it: `m[1].xy`, or a column of a
    /// row-major matrix.
    pub parts: Option<Vec<Node>>,
    /// For a swizzle: the vector and the components.
    pub swizzle: Option<(Box<Ex>, Vec<usize>)>,
    /// Whether it is a column of a matrix.
    pub column: bool,
    /// For a column of a row-major matrix: the matrix and the index.
    pub turned: Option<(Node, Node)>,
    /// The path of its samplers in [`Resolver::pairs`].
    pub path: Option<String>,
    /// Set for a combined sampler.
    pub pair: Option<Pair>,
    /// Set for an element of a sampler array with a dynamic index.
    pub choice: Option<(Box<Ex>, Vec<Pair>)>,
    pub folds: Folds,
}

impl Ex {
    pub(super) fn new(node: Node, ty: Ty) -> Self {
        Self {
            node,
            ty,
            lay: MemoryLayout::default(),
            parts: None,
            swizzle: None,
            column: false,
            turned: None,
            path: None,
            pair: None,
            choice: None,
            folds: Folds::No,
        }
    }

    pub(super) fn folding(self, folds: Folds) -> Self {
        Self { folds, ..self }
    }

    /// Converts the value to a type.
    pub(super) fn converted(&self, ty: &Ty) -> Self {
        Self::new(Node::convert(ty, self.node.clone()), ty.clone())
    }
}

impl Resolver<'_, '_> {
    /// Resolves an expression as a value, converted from its stored type.
    pub(super) fn expr(&mut self, expr: &Expr) -> Result<Ex, Error> {
        let mut first = Vec::new();
        let is_place = matches!(expr.content, ExprData::Dot(..) | ExprData::Bracket(..));
        if is_place && self.held(expr).is_none() && self.has_effect(expr) {
            let looked = self.look(expr)?;
            let is_whole = matches!(looked.ty, Ty::Matrix(..) | Ty::Array(..) | Ty::Struct(_));
            if is_whole && looked.is_converted {
                // The value consists of parts, each of which repeats the target.
                first = self.settle(expr)?;
            }
        }
        let ex = self.raw(expr)?;
        Ok(after(first, self.value(ex)))
    }

    /// Resolves an expression with its stored type.
    pub(super) fn raw(&mut self, expr: &Expr) -> Result<Ex, Error> {
        if let Some(held) = self.held(expr) {
            return Ok(held);
        }
        let place = self.place(expr.span);
        let mut ex = match &expr.content {
            ExprData::Variable(name) => self.variable(name.as_str(), expr)?,
            ExprData::IntConst(i) => {
                Ex::new(Node::int(*i), Ty::INT).folding(Folds::To(ConstantValue::Int(*i)))
            }
            ExprData::UIntConst(u) => {
                Ex::new(Node::uint(*u), Ty::UINT).folding(Folds::To(ConstantValue::Uint(*u)))
            }
            ExprData::BoolConst(b) => {
                Ex::new(Node::bool(*b), Ty::BOOL).folding(Folds::To(ConstantValue::Bool(*b)))
            }
            ExprData::FloatConst(f) => {
                let f = finite(*f);
                Ex::new(Node::float(f), Ty::FLOAT).folding(Folds::To(ConstantValue::Float(f)))
            }
            // naga's constants have no 64-bit literals.
            ExprData::DoubleConst(d) if f64::from(*d as f32) == *d => {
                let literal = Ex::new(Node::float(finite(*d as f32)), Ty::FLOAT);
                literal.converted(&Ty::Scalar(Component::Double))
            }
            ExprData::DoubleConst(d) => {
                return Err(unsupported(
                    format!("the 64-bit literal {d:?} is too precise for naga"),
                    place,
                ));
            }
            ExprData::Unary(op, of) => self.unary(op, of, place)?,
            ExprData::Binary(op, a, b) => self.binary(&op.content, a, b, place)?,
            ExprData::Ternary(condition, a, b) => self.ternary(condition, a, b, place)?,
            ExprData::Assignment(to, op, from) => self.assignment(to, &op.content, from)?,
            ExprData::Bracket(of, index) => self.index(of, index, expr)?,
            ExprData::FunCall(name, arguments) => self.call(name, arguments, expr)?,
            ExprData::Dot(of, name) => self.dot(of, name.as_str(), expr)?,
            ExprData::PostInc(of) => self.stepped(of, BinaryOperator::Add, true)?,
            ExprData::PostDec(of) => self.stepped(of, BinaryOperator::Subtract, true)?,
            ExprData::Comma(a, b) => {
                let (a, b) = (self.expr(a)?, self.expr(b)?);
                if a.ty == Ty::Void || b.ty == Ty::Void {
                    return Err(unsupported(
                        "a call that returns nothing cannot be part of this expression",
                        place,
                    )
                    .note("make it a statement of its own"));
                }
                Ex::new(Node::after(vec![a.node], b.node), b.ty).folding(b.folds)
            }
        };
        ex.node = ex.node.at(place);
        Ok(ex)
    }

    /// `condition ? a : b`.
    fn ternary(
        &mut self,
        condition: &Expr,
        a: &Expr,
        b: &Expr,
        place: Option<naga::Span>,
    ) -> Result<Ex, Error> {
        let of = self.place(condition.span);
        let condition = self.expr(condition)?;
        self.check_condition(&condition, of)?;
        let (a, b) = (self.expr(a)?, self.expr(b)?);
        if a.ty == Ty::Void || b.ty == Ty::Void {
            return Err(
                unsupported("`?` selects between values, and this has none", place)
                    .note("write an `if`"),
            );
        }
        if !check::meet(&a.ty, &b.ty) {
            let message = format!(
                "`?` selects between {} and {}",
                check::a(&a.ty),
                check::a(&b.ty)
            );
            return Err(wrong(message, place));
        }
        let ty = match (a.ty.kind(), b.ty.kind()) {
            (Some(x), Some(y)) if x.power() < y.power() => b.ty.clone(),
            _ => a.ty.clone(),
        };
        let (a, b) = (self.coerce(a, &ty), self.coerce(b, &ty));
        Ok(Ex::new(Node::choose(condition.node, a.node, b.node), ty))
    }

    fn variable(&mut self, name: &str, expr: &Expr) -> Result<Ex, Error> {
        self.check_declared(name, expr)?;
        if let Some(var) = self.lookup(name).cloned() {
            return Ok(self.of_var(&var));
        }
        if name.starts_with("gl_") {
            return self.own_variable(name, expr);
        }
        Err(wrong(
            format!("`{name}` is not declared"),
            self.place(expr.span),
        ))
    }

    pub(super) fn of_var(&self, var: &Var) -> Ex {
        self.with_pair(var.ex.clone())
    }

    /// Adds the texture and sampler of a combined sampler.
    pub(super) fn with_pair(&self, mut ex: Ex) -> Ex {
        if let (Ty::Combined(_), Some(path)) = (&ex.ty, &ex.path)
            && let Some(pair) = self.pairs.get(path)
        {
            ex.node = pair.node();
            ex.pair = Some(pair.clone());
        }
        ex
    }

    pub(super) fn own_variable(&mut self, name: &str, expr: &Expr) -> Result<Ex, Error> {
        let place = self.place(expr.span);
        if let Some(n) = built_in_variables::limit(name) {
            let folds = Folds::To(ConstantValue::Int(n));
            return Ok(Ex::new(Node::int(n), Ty::INT).folding(folds));
        }
        match name {
            "gl_PointSize" if self.is_vertex() => {
                return Ok(self.standin("gl_PointSize", "PointSize"));
            }
            "gl_FragColor" if !self.is_vertex() => {
                return Ok(self.standin("gl_FragColor", "FragColor"));
            }
            "gl_FragData" => {
                return Err(unsupported(
                    "`gl_FragData` can only be indexed by a constant here",
                    place,
                ));
            }
            _ => {}
        }
        if let Some(own) = built_in_variables::plain(name, self.stage.kind) {
            let ex = Ex::new(Node::new(Kind::BuiltIn(own)), own.ty.clone());
            return Ok(match own.ty {
                Ty::UINT => ex.converted(&Ty::INT),
                _ => ex,
            });
        }
        if let Some(variable) = built_in_variables::declared(name, self.stage.kind) {
            return Ok(self.built_in(name, variable));
        }
        unsupported::refuse(name, place)?;
        Err(unsupported(
            format!("`{name}` is not supported: WebGPU has no equivalent"),
            place,
        ))
    }

    /// A built-in that we declare as an input or output. Arrays keep their index.
    fn built_in(&mut self, name: &str, variable: &built_in_variables::Variable) -> Ex {
        let of = variable.first_name();
        let mut ex = self.standin(of, of.trim_start_matches("gl_"));
        match of {
            // The array's only element: WebGPU has at most 32 samples.
            "gl_SampleMaskIn" => ex.converted(&Ty::INT),
            _ if name == "gl_ViewIndex" => ex.converted(&Ty::INT),
            "gl_ClipDistance" => {
                let n = self.stage.clip_distances.unwrap_or(8);
                ex.ty = Ty::Array(Box::new(Ty::FLOAT), Some(n.into()));
                ex
            }
            _ => ex,
        }
    }

    fn unary(
        &mut self,
        op: &ast::UnaryOp,
        of: &Expr,
        place: Option<naga::Span>,
    ) -> Result<Ex, Error> {
        let (word, op_of) = match op.content {
            UnaryOpData::Inc => return self.stepped(of, BinaryOperator::Add, false),
            UnaryOpData::Dec => return self.stepped(of, BinaryOperator::Subtract, false),
            UnaryOpData::Add => return self.expr(of),
            UnaryOpData::Minus => ("-", UnaryOperator::Negate),
            UnaryOpData::Not => ("!", UnaryOperator::LogicalNot),
            UnaryOpData::Complement => ("~", UnaryOperator::BitwiseNot),
        };
        let of = self.expr(of)?;
        self.check_sign(word, &of.ty, place)?;
        let folds = of.folds.map(|v| constant::unary(&op.content, v));
        if word == "-" && of.ty.kind() == Some(Component::Uint) {
            // WGSL has no negation of unsigned numbers.
            let zero = match &of.ty {
                Ty::Scalar(_) => Node::uint(0),
                vector => Node::convert(vector, Node::uint(0)),
            };
            let node = Node::binary(BinaryOperator::Subtract, zero, of.node);
            return Ok(Ex::new(node, of.ty).folding(folds));
        }
        Ok(Ex::new(Node::unary(op_of, of.node), of.ty).folding(folds))
    }

    fn binary(
        &mut self,
        op: &B,
        a: &Expr,
        b: &Expr,
        place: Option<naga::Span>,
    ) -> Result<Ex, Error> {
        // The IR's operators evaluate both sides.
        if matches!(op, B::And | B::Or) && self.has_effect(b) {
            let (a, b) = (self.expr(a)?, self.expr(b)?);
            self.check_operator(op, operator(op).0, [&a.ty, &b.ty], place)?;
            let node = match op {
                B::And => Node::choose(a.node, b.node, Node::bool(false)),
                _ => Node::choose(a.node, Node::bool(true), b.node),
            };
            return Ok(Ex::new(node, Ty::BOOL));
        }
        let (a, b) = (self.expr(a)?, self.expr(b)?);
        let (word, of) = operator(op);
        self.check_operator(op, word, [&a.ty, &b.ty], place)?;
        if *op == B::Xor {
            return Ok(Ex::new(Node::binary(of, a.node, b.node), Ty::BOOL));
        }
        let shift = matches!(op, B::LShift | B::RShift);
        let (a, b) = match (a.ty.kind(), b.ty.kind()) {
            _ if shift => (a, b),
            (Some(x), Some(y)) if x.power() < y.power() => (self.coerce_kind(a, Some(y)), b),
            (Some(x), Some(y)) if x.power() > y.power() => {
                let b = self.coerce_kind(b, Some(x));
                (a, b)
            }
            _ => (a, b),
        };
        let ty = result(op, &a.ty, &b.ty);
        let (a, b) = match op {
            B::Mod => (splat(a, &ty), splat(b, &ty)),
            _ => (a, b),
        };
        if matches!(op, B::Equal | B::NonEqual)
            && self.stage.structs.count(&a.ty).elements > COMPARED
        {
            return Err(Error::new(
                Code::TooDeep,
                format!("values of more than {COMPARED} elements cannot be compared"),
            )
            .label_if(place)
            .note("compare them in a loop"));
        }
        if matches!(op, B::Equal | B::NonEqual)
            && let Some((first, equal)) = self.compared(&a, &b)
        {
            let node = match op {
                B::Equal => equal,
                _ => Node::unary(UnaryOperator::LogicalNot, equal),
            };
            return Ok(after(first, Ex::new(node, Ty::BOOL)));
        }
        let (first, b, folds) = self.operand_to_fold(op, &a, b);
        let node = Node::binary(of, a.node, b.node).at(place);
        Ok(after(first, Ex::new(node, ty).folding(folds)))
    }

    /// Compares structs and arrays part by part, because the IR has no operator for them.
    fn compared(&mut self, a: &Ex, b: &Ex) -> Option<(Vec<Node>, Node)> {
        if !matches!(a.ty, Ty::Struct(_) | Ty::Array(..) | Ty::Matrix(..)) {
            return None;
        }
        let mut both = [a.clone(), b.clone()];
        let first = self.hold_in_order(&mut both, |_, of| !of.node.is_path());
        let [a, b] = both.map(|of| self.leaves(of));
        let parts = a.into_iter().zip(b);
        let parts = parts.map(|(a, b)| {
            let [a, b] = [a, b].map(|of| self.value(of).node);
            Node::binary(BinaryOperator::Equal, a, b)
        });
        let whole = parts.reduce(|all, part| Node::binary(BinaryOperator::LogicalAnd, all, part));
        Some((first, whole?))
    }

    /// Implicitly converts an expression to `to`.
    pub(super) fn coerce(&self, ex: Ex, to: &Ty) -> Ex {
        match (&ex.ty, to) {
            (Ty::Scalar(_) | Ty::Vector(..) | Ty::Matrix(..), _)
                if ex.ty != *to && ex.ty.with_kind(to.kind().unwrap_or(Component::Bool)) == *to =>
            {
                self.coerce_kind(ex, to.kind())
            }
            _ => ex,
        }
    }

    pub(super) fn coerce_kind(&self, ex: Ex, kind: Option<Component>) -> Ex {
        let (Some(from), Some(to)) = (ex.ty.kind(), kind) else {
            return ex;
        };
        if from == to || from == Component::Bool || to == Component::Bool {
            return ex;
        }
        if let (Kind::Literal(Literal::I32(n)), Component::Float) = (&*ex.node.kind, to) {
            let folds = ex.folds.map(|v| constant::construct(&Ty::FLOAT, &[v]));
            return Ex::new(Node::float(*n as f32).at(Some(ex.node.span)), Ty::FLOAT)
                .folding(folds);
        }
        let ty = ex.ty.with_kind(to);
        let folds = ex.folds.map(|v| constant::construct(&ty, &[v]));
        ex.converted(&ty).folding(folds)
    }

    /// An initialiser of type `ty`, which gets the lengths of unsized arrays.
    pub(super) fn initial(&mut self, init: &ast::Initializer, ty: &mut Ty) -> Result<Node, Error> {
        let list = match &init.content {
            InitializerData::Simple(e) => {
                let ex = self.expr(e)?;
                self.check_given(&ex.ty, ty, self.place(e.span))?;
                if is_same(&ex.ty, ty) && !matches!(ex.ty, Ty::Array(_, None)) {
                    *ty = ex.ty.clone();
                }
                return Ok(self.coerce(ex, ty).node);
            }
            InitializerData::List(list) => list,
        };
        let mut parts: Vec<Ty> = match &*ty {
            Ty::Array(of, _) => vec![(**of).clone(); list.len()],
            Ty::Vector(k, _) => vec![Ty::Scalar(*k); list.len()],
            Ty::Matrix(k, _, rows) => vec![Ty::Vector(*k, *rows); list.len()],
            Ty::Struct(name) => match self.stage.structs.get(name) {
                Some(of) => of.members.iter().map(|m| m.ty.clone()).collect(),
                None => Vec::new(),
            },
            _ => vec![ty.clone(); list.len()],
        };
        let mut values = Vec::new();
        for (part, ty) in list.iter().zip(&mut parts) {
            values.push(self.initial(part, ty)?);
        }
        if let (Ty::Array(of, n), Some(part)) = (&mut *ty, parts.first()) {
            **of = part.clone();
            *n = n.or(Some((list.len() as u32).into()));
        }
        Ok(Node::construct(ty, values))
    }

    /// Whether a global's initialiser is a constant in the IR.
    pub(super) fn is_simple(&self, init: &ast::Initializer) -> bool {
        match &init.content {
            InitializerData::List(list) => list.iter().all(|i| self.is_simple(i)),
            InitializerData::Simple(e) => self.is_simple_expr(e),
        }
    }

    fn is_simple_expr(&self, e: &Expr) -> bool {
        match &e.content {
            _ if is_literal(e) => true,
            ExprData::Unary(op, of) => {
                matches!(op.content, UnaryOpData::Minus) && self.is_simple_expr(of)
            }
            ExprData::Binary(op, a, b) => {
                matches!(op.content, B::Add | B::Sub | B::Mult | B::Div)
                    && self.is_scalar_literal(a)
                    && self.is_scalar_literal(b)
            }
            ExprData::FunCall(name, arguments) => {
                matches!(name.content, ast::FunIdentifierData::TypeSpecifier(_))
                    && arguments.iter().all(|a| self.is_simple_expr(a))
            }
            _ => false,
        }
    }

    fn is_scalar_literal(&self, e: &Expr) -> bool {
        match &e.content {
            ExprData::IntConst(_) | ExprData::UIntConst(_) | ExprData::FloatConst(_) => true,
            ExprData::Unary(op, of) => {
                matches!(op.content, UnaryOpData::Minus) && self.is_scalar_literal(of)
            }
            ExprData::Binary(op, a, b) => {
                matches!(op.content, B::Add | B::Sub | B::Mult | B::Div)
                    && self.is_scalar_literal(a)
                    && self.is_scalar_literal(b)
            }
            _ => false,
        }
    }
}

/// Turns a scalar operand of a vector into a vector.
pub(super) fn splat(ex: Ex, to: &Ty) -> Ex {
    match (&ex.ty, to) {
        (Ty::Scalar(_), Ty::Vector(..)) => {
            let folds = ex.folds.map(|v| constant::construct(to, &[v]));
            ex.converted(to).folding(folds)
        }
        _ => ex,
    }
}

/// A literal beyond the range of `float` becomes the largest float.
fn finite(f: f32) -> f32 {
    f.min(f32::MAX)
}

/// An operator's token, and its equivalent in the IR.
pub(super) fn operator(op: &B) -> (&'static str, BinaryOperator) {
    use BinaryOperator as O;
    match op {
        B::Or => ("||", O::LogicalOr),
        B::Xor => ("^^", O::NotEqual),
        B::And => ("&&", O::LogicalAnd),
        B::BitOr => ("|", O::InclusiveOr),
        B::BitXor => ("^", O::ExclusiveOr),
        B::BitAnd => ("&", O::And),
        B::Equal => ("==", O::Equal),
        B::NonEqual => ("!=", O::NotEqual),
        B::Lt => ("<", O::Less),
        B::Gt => (">", O::Greater),
        B::Lte => ("<=", O::LessEqual),
        B::Gte => (">=", O::GreaterEqual),
        B::LShift => ("<<", O::ShiftLeft),
        B::RShift => (">>", O::ShiftRight),
        B::Add => ("+", O::Add),
        B::Sub => ("-", O::Subtract),
        B::Mult => ("*", O::Multiply),
        B::Div => ("/", O::Divide),
        B::Mod => ("%", O::Modulo),
    }
}

/// The operator of a compound assignment.
pub(super) fn compound(op: &A) -> Option<B> {
    Some(match op {
        A::Equal => return None,
        A::Mult => B::Mult,
        A::Div => B::Div,
        A::Mod => B::Mod,
        A::Add => B::Add,
        A::Sub => B::Sub,
        A::LShift => B::LShift,
        A::RShift => B::RShift,
        A::And => B::BitAnd,
        A::Xor => B::BitXor,
        A::Or => B::BitOr,
    })
}

/// The result type of an operator.
pub(super) fn result(op: &B, a: &Ty, b: &Ty) -> Ty {
    let kinds = [a.kind(), b.kind()].into_iter().flatten();
    let of_kind = |ty: Ty| match kinds.max_by_key(|k| k.power()) {
        Some(kind) => ty.with_kind(kind),
        None => ty,
    };
    match op {
        B::Or | B::Xor | B::And => Ty::BOOL,
        B::Equal | B::NonEqual | B::Lt | B::Gt | B::Lte | B::Gte => Ty::BOOL,
        B::Mult => of_kind(product(a, b)),
        B::LShift | B::RShift => a.clone(),
        _ => of_kind(wider(a, b)),
    }
}

fn wider(a: &Ty, b: &Ty) -> Ty {
    match (a, b) {
        (Ty::Scalar(_), other) => other.clone(),
        (other, _) => other.clone(),
    }
}

fn product(a: &Ty, b: &Ty) -> Ty {
    match (a, b) {
        (Ty::Matrix(k, _, rows), Ty::Vector(..)) => Ty::Vector(*k, *rows),
        (Ty::Vector(..), Ty::Matrix(k, columns, _)) => Ty::Vector(*k, *columns),
        (Ty::Matrix(k, _, rows), Ty::Matrix(_, columns, _)) => Ty::Matrix(*k, *columns, *rows),
        _ => wider(a, b),
    }
}
