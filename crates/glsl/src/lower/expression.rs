//! Prints expressions with minimal parentheses, and tracks their types.

use glsl_lang::ast::{
    self, AssignmentOpData as A, BinaryOpData as B, Expr, ExprData, InitializerData, UnaryOpData,
};

use super::super::built_ins;
use super::super::constant::{self, ConstantValue};
use super::super::interface::SplitSampler;
use super::super::source_marks::unmarked;
use super::super::stage::{initial_length, unsupported};
use super::super::ty::{Component, MemoryLayout, Ty};
use super::declaration::output_of;
use super::effect::{after, is_literal};
use super::fold::Folds;
use super::{Lower, Var, check};
use preshade_text::error::{Code, Error};
use preshade_text::unsupported;

/// Maximum elements compared one by one.
const COMPARED: u64 = 1 << 12;

/// Binding strength of printed text; higher binds tighter.
pub(super) mod level {
    pub const PRIMARY: u8 = 17;
    pub const POSTFIX: u8 = 16;
    pub const UNARY: u8 = 15;
    pub const TERNARY: u8 = 3;
    pub const ASSIGNMENT: u8 = 2;
    pub const COMMA: u8 = 1;
}

/// A printed expression.
#[derive(Clone, Debug)]
pub(super) struct Ex {
    pub text: String,
    pub ty: Ty,
    pub level: u8,
    /// Its layout in a block. [`Lower::value`] converts it to a value.
    pub lay: MemoryLayout,
    /// Assignment targets by component, where naga cannot assign to it: `m[1].xy`, a column of a
    /// row-major matrix.
    pub parts: Option<Vec<String>>,
    /// The vector of which it is a swizzle, and the components.
    pub swizzle: Option<(Box<Ex>, Vec<usize>)>,
    /// It is a column of a matrix.
    pub column: bool,
    /// The row-major matrix and the index of which it is a column.
    pub turned: Option<(String, String)>,
    /// Where its samplers are in [`Lower::pairs`].
    pub path: Option<String>,
    /// It is a combined sampler.
    pub pair: Option<SplitSampler>,
    /// It is an element of a sampler array with a dynamic index.
    pub choice: Option<(Box<Ex>, Vec<SplitSampler>)>,
    pub folds: Folds,
}

impl Ex {
    pub(super) fn new(text: impl Into<String>, ty: Ty, level: u8) -> Self {
        Self {
            text: text.into(),
            ty,
            level,
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

    pub(super) fn primary(text: impl Into<String>, ty: Ty) -> Self {
        Self::new(text, ty, level::PRIMARY)
    }

    /// The text, in parentheses if it binds looser than `level`.
    pub(super) fn at(&self, level: u8) -> String {
        match self.level >= level {
            true => self.text.clone(),
            false => format!("({})", self.text),
        }
    }
}

impl Lower<'_, '_> {
    /// Prints an expression as a value, converted from its stored type.
    pub(super) fn expr(&mut self, expr: &Expr) -> Result<Ex, Error> {
        let mut first = Vec::new();
        let is_place = matches!(expr.content, ExprData::Dot(..) | ExprData::Bracket(..));
        if is_place && self.held(expr).is_none() && self.has_effect(expr) {
            let looked = self.look(expr)?;
            let is_whole = matches!(looked.ty, Ty::Matrix(..) | Ty::Array(..) | Ty::Struct(_));
            if is_whole && looked.is_converted {
                // The value has several parts, and each repeats the target.
                first = self.settle(expr)?;
            }
        }
        let ex = self.raw(expr)?;
        Ok(after(first, self.value(ex)))
    }

    /// Prints an expression with its stored type.
    pub(super) fn raw(&mut self, expr: &Expr) -> Result<Ex, Error> {
        if let Some(held) = self.held(expr) {
            return Ok(held);
        }
        let place = self.place(expr.span);
        let is_literal = matches!(
            expr.content,
            ExprData::IntConst(_)
                | ExprData::UIntConst(_)
                | ExprData::BoolConst(_)
                | ExprData::FloatConst(_)
        );
        let mark = match is_literal {
            true => self.mark(expr.span),
            false => String::new(),
        };
        let mut ex = match &expr.content {
            ExprData::Variable(name) => {
                let mark = self.mark(expr.span);
                let mut ex = self.variable(name.as_str(), expr)?;
                ex.text = mark + &ex.text;
                ex
            }
            ExprData::IntConst(i) => {
                let text = match *i < 0 {
                    true => format!("int({}u)", *i as u32),
                    false => i.to_string(),
                };
                Ex::primary(text, Ty::INT).folding(Folds::To(ConstantValue::Int(*i)))
            }
            ExprData::UIntConst(u) => {
                Ex::primary(format!("{u}u"), Ty::UINT).folding(Folds::To(ConstantValue::Uint(*u)))
            }
            ExprData::BoolConst(b) => {
                Ex::primary(b.to_string(), Ty::BOOL).folding(Folds::To(ConstantValue::Bool(*b)))
            }
            ExprData::FloatConst(f) => {
                let folds = Folds::To(ConstantValue::Float(finite(*f)));
                Ex::primary(float(*f), Ty::FLOAT).folding(folds)
            }
            // naga's front end has no 64-bit literals.
            ExprData::DoubleConst(d) if f64::from(*d as f32) == *d => Ex::primary(
                format!("double({})", float(*d as f32)),
                Ty::Scalar(Component::Double),
            ),
            ExprData::DoubleConst(d) => {
                return Err(unsupported(
                    format!("the 64-bit literal {d:?} is too precise for naga"),
                    place,
                ));
            }
            ExprData::Unary(op, of) => self.unary(op, of, place)?,
            ExprData::Binary(op, a, b) => self.binary(&op.content, a, b, place)?,
            ExprData::Ternary(condition, a, b) => {
                let of = self.place(condition.span);
                let condition = self.expr(condition)?;
                self.check_condition(&condition, of)?;
                let (a, b) = (self.expr(a)?, self.expr(b)?);
                if a.ty == Ty::Void || b.ty == Ty::Void {
                    return Err(unsupported(
                        "`?` selects between values, and this has none",
                        place,
                    )
                    .note("write an `if`"));
                }
                if !check::meet(&a.ty, &b.ty) {
                    let message = format!(
                        "`?` selects between {} and {}",
                        check::a(&a.ty),
                        check::a(&b.ty)
                    );
                    return Err(Error::new(Code::Parse, message).label_if(place));
                }
                let ty = match (a.ty.kind(), b.ty.kind()) {
                    (Some(x), Some(y)) if x.power() < y.power() => b.ty.clone(),
                    _ => a.ty.clone(),
                };
                let (a, b) = (self.coerce(a, &ty), self.coerce(b, &ty));
                let text = format!("{} ? {} : {}", condition.at(4), a.at(4), b.at(4));
                Ex::new(text, ty, level::TERNARY)
            }
            ExprData::Assignment(to, op, from) => {
                self.assignment(to, assignment(&op.content), from)?
            }
            ExprData::Bracket(of, index) => self.index(of, index, expr)?,
            ExprData::FunCall(name, arguments) => {
                let mark = self.mark(expr.span);
                let mut ex = self.call(name, arguments, expr)?;
                ex.text = mark + &ex.text;
                self.mark_end(&mut ex, ")", expr);
                ex
            }
            ExprData::Dot(of, name) => {
                let mut ex = self.dot(of, name.as_str(), expr)?;
                self.mark_end(&mut ex, &format!(".{name}"), expr);
                ex
            }
            ExprData::PostInc(of) => self.stepped(of, "++", true)?,
            ExprData::PostDec(of) => self.stepped(of, "--", true)?,
            ExprData::Comma(a, b) => {
                let (a, b) = (self.expr(a)?, self.expr(b)?);
                if a.ty == Ty::Void || b.ty == Ty::Void {
                    return Err(unsupported(
                        "a call that returns nothing cannot be part of this expression",
                        place,
                    )
                    .note("make it a statement of its own"));
                }
                let text = format!("{}, {}", a.text, b.at(level::ASSIGNMENT));
                Ex::new(text, b.ty, level::COMMA).folding(b.folds)
            }
        };
        ex.text.insert_str(0, &mark);
        Ok(ex)
    }

    /// Marks the end of an expression, by which naga's spans begin or end.
    fn mark_end(&mut self, ex: &mut Ex, end: &str, expr: &Expr) {
        if let Some(before) = ex.text.strip_suffix(end) {
            ex.text = format!("{before}{}{end}", self.mark(expr.span));
        }
    }

    fn variable(&mut self, name: &str, expr: &Expr) -> Result<Ex, Error> {
        if let Some(var) = self.lookup(name).cloned() {
            return Ok(self.of_var(&var));
        }
        if name.starts_with("gl_") {
            return self.own_variable(name, expr);
        }
        Err(Error::new(
            preshade_text::error::Code::Parse,
            format!("`{name}` is not declared"),
        )
        .label_if(self.place(expr.span)))
    }

    pub(super) fn of_var(&self, var: &Var) -> Ex {
        let level = match var.text.contains('.') {
            true => level::POSTFIX,
            false => level::PRIMARY,
        };
        let mut ex = Ex::new(var.text.clone(), var.ty.clone(), level);
        ex.folds = var.folds.clone();
        ex.lay = var.lay;
        ex.path = var.path.clone();
        self.with_pair(ex)
    }

    /// Adds the texture and sampler of a combined sampler.
    fn with_pair(&self, mut ex: Ex) -> Ex {
        if let (Ty::Combined(name), Some(path)) = (&ex.ty, &ex.path)
            && let Some(pair) = self.pairs.get(path)
        {
            ex.text = format!("{name}({}, {})", pair.texture, pair.sampler);
            ex.level = level::PRIMARY;
            ex.pair = Some(pair.clone());
        }
        ex
    }

    /// A built-in variable.
    fn own_variable(&mut self, name: &str, expr: &Expr) -> Result<Ex, Error> {
        let place = self.place(expr.span);
        let vec4 = || Ty::Vector(Component::Float, 4);
        let fragment = !self.is_vertex();
        Ok(match name {
            "gl_Position" if !fragment => Ex::primary(name, vec4()),
            "gl_FragCoord" if fragment => Ex::primary(name, vec4()),
            "gl_FrontFacing" if fragment => Ex::primary(name, Ty::BOOL),
            "gl_FragDepth" | "gl_FragDepthEXT" if fragment => {
                Ex::primary("gl_FragDepth", Ty::FLOAT)
            }
            "gl_VertexID" | "gl_VertexIndex" if !fragment => {
                Ex::primary("int(gl_VertexIndex)", Ty::INT)
            }
            "gl_InstanceID" | "gl_InstanceIndex" | "gl_InstanceIDARB" if !fragment => {
                Ex::primary("int(gl_InstanceIndex)", Ty::INT)
            }
            "gl_SampleID" if fragment => Ex::primary("int(gl_SampleID)", Ty::INT),
            "gl_PrimitiveID" if fragment => Ex::primary("int(gl_PrimitiveID)", Ty::INT),
            "gl_BaseVertex" | "gl_BaseVertexARB" if !fragment => {
                Ex::primary("int(gl_BaseVertex)", Ty::INT)
            }
            "gl_BaseInstance" | "gl_BaseInstanceARB" if !fragment => {
                Ex::primary("int(gl_BaseInstance)", Ty::INT)
            }
            "gl_DrawID" | "gl_DrawIDARB" if !fragment => Ex::primary("int(gl_DrawID)", Ty::INT),
            "gl_PointSize" if !fragment => {
                Ex::primary(self.standin("gl_PointSize", "PointSize"), Ty::FLOAT)
            }
            "gl_FragColor" if fragment => {
                Ex::primary(self.standin("gl_FragColor", "FragColor"), vec4())
            }
            "gl_MaxDrawBuffers" => Ex::primary("8", Ty::INT),
            "gl_MaxVertexAttribs" => Ex::primary("16", Ty::INT),
            "gl_MaxTextureImageUnits"
            | "gl_MaxCombinedTextureImageUnits"
            | "gl_MaxVertexTextureImageUnits" => Ex::primary("16", Ty::INT),
            "gl_MaxVaryingVectors"
            | "gl_MaxVertexUniformVectors"
            | "gl_MaxFragmentUniformVectors" => Ex::primary("16", Ty::INT),
            "gl_FragData" => {
                return Err(unsupported(
                    "`gl_FragData` can only be indexed by a constant here",
                    place,
                ));
            }
            _ if built_ins::variable(name, self.stage.kind).is_some() => self.built_in(name),
            _ => {
                unsupported::refuse(name, place)?;
                return Err(unsupported(
                    format!("`{name}` is not supported: WebGPU has no equivalent"),
                    place,
                ));
            }
        })
    }

    /// A built-in that is declared as an input or output of ours. Arrays keep their index.
    fn built_in(&mut self, name: &str) -> Ex {
        let Some(variable) = built_ins::variable(name, self.stage.kind) else {
            return Ex::primary(name, Ty::Unknown);
        };
        let of = variable.first_name();
        let text = self.standin(of, of.trim_start_matches("gl_"));
        if variable.is_output {
            self.helper_name(&output_of(of));
        }
        let array = |of: Ty, n: u32| Ty::Array(Box::new(of), Some(n.into()));
        match of {
            // Its only element: WebGPU has at most 32 samples.
            "gl_SampleMaskIn" => Ex::primary(format!("int({text})"), Ty::INT),
            _ if name == "gl_ViewIndex" => Ex::primary(format!("int({text})"), Ty::INT),
            "gl_SampleMask" => Ex::primary(text, array(Ty::INT, 1)),
            "gl_ClipDistance" => {
                let n = self.stage.clip_distances.unwrap_or(8);
                Ex::primary(text, array(Ty::FLOAT, n))
            }
            _ => Ex::primary(text, Ty::named(variable.ty)),
        }
    }

    pub(super) fn standin(&mut self, of: &'static str, wanted: &str) -> String {
        if let Some(name) = self.standins.get(of) {
            return name.clone();
        }
        let name = self.fresh(wanted);
        self.standins.insert(of, name.clone());
        name
    }

    fn unary(
        &mut self,
        op: &ast::UnaryOp,
        of: &Expr,
        place: Option<naga::Span>,
    ) -> Result<Ex, Error> {
        let word = match op.content {
            UnaryOpData::Inc => return self.stepped(of, "++", false),
            UnaryOpData::Dec => return self.stepped(of, "--", false),
            UnaryOpData::Add => return self.expr(of),
            UnaryOpData::Minus => "-",
            UnaryOpData::Not => "!",
            UnaryOpData::Complement => "~",
        };
        let of = self.expr(of)?;
        self.check_sign(word, &of.ty, place)?;
        let folds = of.folds.map(|v| constant::unary(&op.content, v));
        if word == "-" && of.ty.kind() == Some(Component::Uint) {
            // WGSL negates no unsigned numbers.
            let zero = match &of.ty {
                Ty::Scalar(_) => "0u".to_owned(),
                vector => format!("{}(0u)", vector.name()),
            };
            let text = format!("{zero} - {}", of.at(14));
            return Ok(Ex::new(text, of.ty, 13).folding(folds));
        }
        let mut text = of.at(level::UNARY);
        if unmarked(&text).starts_with(['-', '+']) {
            text = format!("({text})");
        }
        Ok(Ex::new(format!("{word}{text}"), of.ty, level::UNARY).folding(folds))
    }

    fn binary(
        &mut self,
        op: &B,
        a: &Expr,
        b: &Expr,
        place: Option<naga::Span>,
    ) -> Result<Ex, Error> {
        // naga evaluates both sides.
        if matches!(op, B::And | B::Or) && self.has_effect(b) {
            let (a, b) = (self.expr(a)?, self.expr(b)?);
            self.check_operator(op, operator(op).0, [&a.ty, &b.ty], place)?;
            let tighter = level::TERNARY + 1;
            let text = match op {
                B::And => format!("{} ? {} : false", a.at(tighter), b.at(tighter)),
                _ => format!("{} ? true : {}", a.at(tighter), b.at(tighter)),
            };
            return Ok(Ex::new(text, Ty::BOOL, level::TERNARY));
        }
        let (a, b) = (self.expr(a)?, self.expr(b)?);
        let (word, level) = operator(op);
        self.check_operator(op, word, [&a.ty, &b.ty], place)?;
        if *op == B::Xor {
            let text = format!("({}) != ({})", a.text, b.text);
            return Ok(Ex::new(text, Ty::BOOL, 10));
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
        let ty = match op {
            B::Or | B::And | B::Equal | B::NonEqual | B::Lt | B::Gt | B::Lte | B::Gte => Ty::BOOL,
            B::Mult => product(&a.ty, &b.ty),
            _ if shift => a.ty.clone(),
            _ => wider(&a.ty, &b.ty),
        };
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
            && let Some((first, text)) = self.compared(&a, &b)
        {
            let text = match op {
                B::Equal => text,
                _ => format!("!({text})"),
            };
            return Ok(after(first, Ex::primary(format!("({text})"), Ty::BOOL)));
        }
        let (first, b, folds) = self.operand_to_fold(op, &a, b);
        let text = format!("{} {word} {}", a.at(level), b.at(level + 1));
        Ok(after(first, Ex::new(text, ty, level).folding(folds)))
    }

    /// Compares structs and arrays by parts: naga has no operator for them.
    fn compared(&mut self, a: &Ex, b: &Ex) -> Option<(Vec<String>, String)> {
        if !matches!(a.ty, Ty::Struct(_) | Ty::Array(..) | Ty::Matrix(..)) {
            return None;
        }
        let ((first, a), (second, b)) = (self.once(a), self.once(b));
        let (a, b) = (&a, &b);
        let mut leaves = Vec::new();
        self.stage.structs.leaves(&a.ty, "", &mut leaves);
        let part = |e: &Ex, ending: &str| format!("{}{ending}", e.at(level::POSTFIX));
        let parts: Vec<String> = leaves
            .iter()
            .map(|(ending, _)| format!("{} == {}", part(a, ending), part(b, ending)))
            .collect();
        let first = first.into_iter().chain(second).collect();
        (!parts.is_empty()).then(|| (first, parts.join(" && ")))
    }

    fn index(&mut self, of: &Expr, index: &Expr, whole: &Expr) -> Result<Ex, Error> {
        let place = self.place(whole.span);
        let known = constant::evaluate(index, &self.stage.constants);
        if let ExprData::Variable(name) = &of.content
            && name.as_str() == "gl_FragData"
        {
            let Some(n) = known.and_then(|n| u32::try_from(n).ok()) else {
                return Err(unsupported(
                    "`gl_FragData` can only be indexed by a constant here",
                    place,
                ));
            };
            self.targets.insert(n);
            return Ok(Ex::primary(
                self.target_name(n),
                Ty::Vector(Component::Float, 4),
            ));
        }
        if let ExprData::Variable(name) = &of.content
            && name.as_str() == "gl_SampleMaskIn"
        {
            return self.raw(of);
        }
        if let ExprData::Variable(name) = &of.content
            && name.as_str() == "gl_ClipDistance"
        {
            let n = known.and_then(|n| u32::try_from(n).ok());
            self.clip_distances = self
                .clip_distances
                .max(n.map_or(8, |n| n.saturating_add(1)));
        }
        let base = self.raw(of)?;
        let index = self.expr(index)?;
        if self.stage.structs.has_samplers(&base.ty) {
            return self.index_samplers(base, &index, known, place);
        }
        self.check_index(&base.ty, &index.ty, place)?;
        let of_columns = matches!(base.ty, Ty::Matrix(..))
            && base.lay.rows
            && base.lay.stored(&base.lay.turned(&base.ty)) != base.lay.turned(&base.ty);
        if of_columns && self.writes(of) {
            return Err(unsupported(
                "this index has side effects and selects a value with several parts",
                place,
            )
            .note("assign the index to a variable first"));
        }
        let folds = match (&base.folds, &index.folds) {
            (Folds::No, _) | (_, Folds::No) => Folds::No,
            (value, Folds::To(at)) => value.map(|v| constant::indexed(v, at)),
            _ => Folds::Unknown,
        };
        let index = match index.ty.kind() {
            Some(Component::Float | Component::Bool) => format!("int({})", index.text),
            _ => index.text,
        };
        Ok(self.element_of(base, &index).folding(folds))
    }

    /// An element of an array that contains samplers.
    fn index_samplers(
        &mut self,
        base: Ex,
        index: &Ex,
        known: Option<i64>,
        place: Option<naga::Span>,
    ) -> Result<Ex, Error> {
        let Ty::Array(of, length) = base.ty.clone() else {
            return Ok(base);
        };
        let path = base.path.clone().unwrap_or_default();
        let mut ex = element(&base, &index.text);
        if let Some(n) = known {
            ex.path = Some(format!("{path}[{n}]"));
            return Ok(self.with_pair(ex));
        }
        if !matches!(*of, Ty::Combined(_)) {
            return Err(unsupported(
                "structs with samplers can only be indexed by a constant here",
                place,
            ));
        }
        let pairs = (0..length.map_or(0, |length| length.n))
            .map(|i| self.pairs.get(&format!("{path}[{i}]")).cloned())
            .collect::<Option<Vec<_>>>()
            .ok_or_else(|| unsupported("these samplers cannot be resolved", place))?;
        ex.choice = Some((Box::new(index.clone()), pairs));
        Ok(ex)
    }

    fn dot(&mut self, of: &Expr, name: &str, whole: &Expr) -> Result<Ex, Error> {
        // A member of a block with an instance name.
        if let ExprData::Variable(instance) = &of.content
            && self.lookup(instance.as_str()).is_none()
            && let Some(var) = self
                .lookup(&format!("{}.{name}", instance.as_str()))
                .cloned()
        {
            let mark = self.mark(whole.span);
            let mut ex = self.of_var(&var);
            ex.text = mark + &ex.text;
            return Ok(ex);
        }
        // A member of an element of an array of blocks.
        if let ExprData::Bracket(array, index) = &of.content
            && let ExprData::Variable(instance) = &array.content
            && let instance = instance.as_str()
            && self.lookup(instance).is_none()
            && let Some(var) = self.lookup(&format!("{instance}[].{name}")).cloned()
        {
            let mark = self.mark(whole.span);
            let index = self.expr(index)?;
            let mut ex = self.of_var(&var);
            let (array, member) = var.text.rsplit_once('.').unwrap_or((&var.text, name));
            ex.text = format!("{mark}{array}[{}].{member}", index.text);
            ex.level = level::POSTFIX;
            return Ok(ex);
        }
        // A member of `gl_PerVertex` through its instance.
        if let ExprData::Variable(instance) = &of.content
            && name.starts_with("gl_")
            && self.lookup(instance.as_str()).is_none()
        {
            return self.own_variable(name, whole);
        }
        let (of_expr, base) = (of, self.raw(of)?);
        let folds = base.folds.map(|v| constant::swizzled(v, name));
        let ex = match base.ty.clone() {
            Ty::Struct(of) => {
                let member = self
                    .stage
                    .structs
                    .get(&of)
                    .and_then(|s| s.members.iter().find(|m| m.name == name).cloned());
                let Some(member) = member else {
                    return Err(Error::new(
                        preshade_text::error::Code::Parse,
                        format!("the struct `{of}` has no member `{name}`"),
                    )
                    .label_if(self.place(whole.span)));
                };
                let mut ex = Ex::new(
                    format!("{}.{name}", base.at(level::POSTFIX)),
                    member.ty,
                    level::POSTFIX,
                );
                ex.lay = self.stage.structs.member_lay(&of, base.lay);
                ex.path = base.path.map(|p| format!("{p}.{name}"));
                self.with_pair(ex)
            }
            Ty::Scalar(kind) => {
                let base = self.value(base);
                let n = name.len().min(4) as u8;
                match n {
                    1 => base,
                    _ => Ex::primary(
                        format!("{}({})", Ty::Vector(kind, n).name(), base.text),
                        Ty::Vector(kind, n),
                    ),
                }
            }
            Ty::Vector(..) => self.components_of(base, of_expr, name, self.place(whole.span))?,
            _ => Ex::new(
                format!("{}.{name}", base.at(level::POSTFIX)),
                Ty::Unknown,
                level::POSTFIX,
            ),
        };
        Ok(ex.folding(folds))
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
        let bare = unmarked(&ex.text);
        if from == Component::Int
            && to == Component::Float
            && bare.bytes().all(|b| b.is_ascii_digit())
        {
            let folds = ex.folds.map(|v| constant::call("float", &[v]));
            return Ex::primary(format!("{}.0", ex.text), Ty::FLOAT).folding(folds);
        }
        let ty = ex.ty.with_kind(to);
        let folds = ex.folds.map(|v| constant::call(&ty.name(), &[v]));
        Ex::primary(format!("{}({})", ty.name(), ex.text), ty).folding(folds)
    }

    /// An initialiser of type `ty`.
    pub(super) fn initial(&mut self, init: &ast::Initializer, ty: &Ty) -> Result<String, Error> {
        match &init.content {
            InitializerData::Simple(e) => {
                let ex = self.expr(e)?;
                self.check_given(&ex.ty, ty, self.place(e.span))?;
                Ok(self.coerce(ex, ty).at(level::ASSIGNMENT))
            }
            InitializerData::List(list) => {
                let parts: Vec<Ty> = match ty {
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
                for (part, ty) in list.iter().zip(&parts) {
                    values.push(self.initial(part, ty)?);
                }
                let name = match ty {
                    Ty::Array(of, None) => Ty::Array(of.clone(), initial_length(init)).name(),
                    other => other.name(),
                };
                Ok(format!("{name}({})", values.join(", ")))
            }
        }
    }

    /// Whether naga can evaluate a global's initialiser.
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

/// Converts a scalar next to a vector to a vector.
pub(super) fn splat(ex: Ex, to: &Ty) -> Ex {
    match (&ex.ty, to) {
        (Ty::Scalar(_), Ty::Vector(..)) => {
            let folds = ex.folds.map(|v| constant::call(&to.name(), &[v]));
            Ex::primary(format!("{}({})", to.name(), ex.text), to.clone()).folding(folds)
        }
        _ => ex,
    }
}

/// An element of an array, a column or a component, in its stored type.
pub(super) fn element(base: &Ex, index: &str) -> Ex {
    let text = format!("{}[{index}]", base.at(level::POSTFIX));
    let (ty, ending) = match &base.ty {
        Ty::Array(of, _) => {
            // Padded to four components.
            let ending = match (&**of, base.lay.is_padded()) {
                (Ty::Scalar(_), true) => ".x",
                (Ty::Vector(_, 2), true) => ".xy",
                _ => "",
            };
            ((**of).clone(), ending)
        }
        Ty::Matrix(k, _, rows) => {
            let padded = base.lay.is_padded() && *rows == 2;
            let ending = if padded { ".xy" } else { "" };
            (Ty::Vector(*k, *rows), ending)
        }
        Ty::Vector(k, _) => (Ty::Scalar(*k), ""),
        _ => (Ty::Unknown, ""),
    };
    let mut ex = Ex::new(text + ending, ty, level::POSTFIX);
    ex.lay = base.lay;
    ex.column = matches!(base.ty, Ty::Matrix(..));
    ex
}

/// What a literal is that no float holds: the largest.
fn finite(f: f32) -> f32 {
    f.min(f32::MAX)
}

/// A GLSL literal with all digits.
fn float(f: f32) -> String {
    let text = format!("{:?}", finite(f));
    match text.contains(['.', 'e']) {
        true => text,
        false => text + ".0",
    }
}

fn operator(op: &B) -> (&'static str, u8) {
    match op {
        B::Or => ("||", 4),
        B::Xor => ("^^", 5),
        B::And => ("&&", 6),
        B::BitOr => ("|", 7),
        B::BitXor => ("^", 8),
        B::BitAnd => ("&", 9),
        B::Equal => ("==", 10),
        B::NonEqual => ("!=", 10),
        B::Lt => ("<", 11),
        B::Gt => (">", 11),
        B::Lte => ("<=", 11),
        B::Gte => (">=", 11),
        B::LShift => ("<<", 12),
        B::RShift => (">>", 12),
        B::Add => ("+", 13),
        B::Sub => ("-", 13),
        B::Mult => ("*", 14),
        B::Div => ("/", 14),
        B::Mod => ("%", 14),
    }
}

fn assignment(op: &A) -> &'static str {
    match op {
        A::Equal => "=",
        A::Mult => "*=",
        A::Div => "/=",
        A::Mod => "%=",
        A::Add => "+=",
        A::Sub => "-=",
        A::LShift => "<<=",
        A::RShift => ">>=",
        A::And => "&=",
        A::Xor => "^=",
        A::Or => "|=",
    }
}

fn wider(a: &Ty, b: &Ty) -> Ty {
    match (a, b) {
        (Ty::Unknown, _) | (_, Ty::Unknown) => Ty::Unknown,
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
