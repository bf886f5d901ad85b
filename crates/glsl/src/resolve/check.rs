//! Checks types and reports errors in GLSL's terms. Types that are unknown here are left to the
//! validator.

use glsl_lang::ast::{BinaryOpData as B, Expr, Initializer, InitializerData};
use naga::Span;

use super::Resolver;
use super::expression::Ex;
use super::overload::{conversion, is_same};
use crate::constant;
use crate::errors::wrong;
use crate::stage::side_effects::Effects;
use crate::stage::start;
use crate::ty::{Component, Ty};
use shader_text::error::Error;

/// The type's name with an article.
pub(super) fn a(ty: &Ty) -> String {
    match ty {
        Ty::Void => "nothing".to_owned(),
        Ty::Array(..) => format!("an array {}", ty.name()),
        Ty::Struct(name) => format!("a struct `{name}`"),
        _ if ty.name().starts_with('i') => format!("an {}", ty.name()),
        _ => format!("a {}", ty.name()),
    }
}

/// Whether the type is unknown here.
fn is_open(ty: &Ty) -> bool {
    match ty {
        Ty::Opaque(_) => true,
        Ty::Array(of, n) => n.is_none() || is_open(of),
        _ => false,
    }
}

/// Whether a value converts implicitly (GLSL 4.60, 4.1.10). Accepts these conversions in GLSL ES
/// too, because their meaning is clear.
pub(super) fn becomes(from: &Ty, to: &Ty) -> bool {
    is_open(from) || is_open(to) || conversion(from, to, true).is_some()
}

fn is_number(ty: &Ty) -> bool {
    ty.kind().is_some_and(|k| k != Component::Bool)
}

fn is_integer(ty: &Ty) -> bool {
    matches!(ty.kind(), Some(Component::Int | Component::Uint)) && !matches!(ty, Ty::Matrix(..))
}

/// Whether both have the same shape, or one is a scalar.
fn is_component_wise(a: &Ty, b: &Ty) -> bool {
    let scalar = |t: &Ty| matches!(t, Ty::Scalar(_));
    scalar(a) || scalar(b) || a.with_kind(Component::Bool) == b.with_kind(Component::Bool)
}

/// Whether the operator accepts these types (GLSL 4.60, 5.9).
pub(super) fn fits(op: &B, a: &Ty, b: &Ty) -> bool {
    if is_open(a) || is_open(b) {
        return true;
    }
    match op {
        B::And | B::Or | B::Xor => *a == Ty::BOOL && *b == Ty::BOOL,
        B::Equal | B::NonEqual => {
            !matches!(a, Ty::Void | Ty::Combined(_)) && (becomes(a, b) || becomes(b, a))
        }
        B::Lt | B::Gt | B::Lte | B::Gte => {
            let scalar = |t: &Ty| matches!(t, Ty::Scalar(_)) && is_number(t);
            scalar(a) && scalar(b)
        }
        B::Add | B::Sub | B::Div => is_number(a) && is_number(b) && is_component_wise(a, b),
        B::Mult => {
            is_number(a)
                && is_number(b)
                && match (a, b) {
                    (Ty::Matrix(_, columns, _), Ty::Vector(_, n)) => columns == n,
                    (Ty::Vector(_, n), Ty::Matrix(_, _, rows)) => n == rows,
                    (Ty::Matrix(_, columns, _), Ty::Matrix(_, _, rows)) => columns == rows,
                    _ => is_component_wise(a, b),
                }
        }
        B::Mod | B::BitAnd | B::BitOr | B::BitXor => {
            is_integer(a) && is_integer(b) && is_component_wise(a, b)
        }
        B::LShift | B::RShift => {
            let whole = matches!(b, Ty::Scalar(_)) || a.components() == b.components();
            is_integer(a) && is_integer(b) && whole
        }
    }
}

impl Resolver<'_, '_> {
    /// Checks that the text declares a global variable before it uses it.
    pub(super) fn check_declared(&self, name: &str, used: &Expr) -> Result<(), Error> {
        let declared = self.stage.declared.get(name);
        match declared.is_some_and(|at| *at > start(used.span)) && !self.is_local(name) {
            true => Err(wrong(
                format!("`{name}` is not declared before this"),
                self.place(used.span),
            )),
            false => Ok(()),
        }
    }

    /// Checks that the initialiser of a global constant is constant (GLSL 4.60, 4.3.3).
    pub(super) fn check_constant(&self, init: &Initializer) -> Result<(), Error> {
        let e = match &init.content {
            InitializerData::Simple(e) => e,
            InitializerData::List(list) => {
                return list.iter().try_for_each(|init| self.check_constant(init));
            }
        };
        let found = Effects::within(e, &self.stage.signatures);
        let is_variable = |name: &String| {
            let of = self.lookup(name);
            of.is_some_and(|v| v.fixed != Some("a constant"))
        };
        let is_open = !found.calls.is_empty() || found.named.iter().any(is_variable);
        match is_open && constant::assume(e, &self.stage.constants).is_none() {
            true => Err(wrong(
                "the initialiser of a global constant must be constant",
                self.place(e.span),
            )),
            false => Ok(()),
        }
    }

    pub(super) fn check_operator(
        &self,
        op: &B,
        word: &str,
        [left, right]: [&Ty; 2],
        place: Option<Span>,
    ) -> Result<(), Error> {
        match fits(op, left, right) {
            true => Ok(()),
            false => Err(wrong(
                format!("`{word}` does not accept {} and {}", a(left), a(right)),
                place,
            )),
        }
    }

    /// Checks that the value converts to `to`.
    pub(super) fn check_given(&self, from: &Ty, to: &Ty, place: Option<Span>) -> Result<(), Error> {
        if becomes(from, to) {
            return Ok(());
        }
        let message = match from {
            Ty::Void => format!("this returns nothing, but {} is expected", a(to)),
            _ => format!("{} is given, but {} is expected", a(from), a(to)),
        };
        let error = wrong(message, place);
        let asked = to.kind().is_some() && from.kind().is_some();
        let smaller = from
            .components()
            .zip(to.components())
            .is_some_and(|(f, t)| f < t && f > 1);
        Err(match asked && !smaller && !matches!(to, Ty::Matrix(..)) {
            true => error.note(format!("convert it explicitly: `{}(..)`", to.name())),
            false => error,
        })
    }

    /// Checks that an expression is a bool.
    pub(super) fn check_condition(&self, of: &Ex, place: Option<Span>) -> Result<(), Error> {
        match is_open(&of.ty) || of.ty == Ty::BOOL {
            true => Ok(()),
            false => Err(wrong(
                format!("a condition must be a bool, but this is {}", a(&of.ty)),
                place,
            )),
        }
    }

    /// Checks the operand of `-`, `!` or `~`.
    pub(super) fn check_sign(&self, word: &str, of: &Ty, place: Option<Span>) -> Result<(), Error> {
        let fits = is_open(of)
            || match word {
                "!" => *of == Ty::BOOL,
                "~" => is_integer(of),
                _ => is_number(of),
            };
        match fits {
            true => Ok(()),
            false => Err(wrong(format!("`{word}` does not accept {}", a(of)), place)),
        }
    }

    /// Checks the operand of `++` or `--`.
    pub(super) fn check_stepped(&self, of: &Ty, place: Option<Span>) -> Result<(), Error> {
        match is_open(of) || is_number(of) {
            true => Ok(()),
            false => Err(wrong(format!("{} has no next value", a(of)), place)),
        }
    }

    pub(super) fn check_index(
        &self,
        of: &Ty,
        index: &Ty,
        place: Option<Span>,
    ) -> Result<(), Error> {
        let has = matches!(of, Ty::Array(..) | Ty::Vector(..) | Ty::Matrix(..));
        let message = match (
            has,
            is_open(index) || *index == Ty::INT || *index == Ty::UINT,
        ) {
            (true, true) => return Ok(()),
            (false, _) => format!("{} has no elements", a(of)),
            _ => format!(
                "an index must be an int or a uint, but this is {}",
                a(index)
            ),
        };
        Err(wrong(message, place))
    }

    /// Checks a constructor's arguments (GLSL 4.60, 5.4).
    pub(super) fn check_constructor(
        &self,
        ty: &Ty,
        given: &[Ty],
        place: Option<Span>,
    ) -> Result<(), Error> {
        let structs = &self.stage.structs;
        let wrong = |why: String| {
            let types: Vec<String> = given.iter().map(Ty::name).collect();
            let message = format!("`{}({})`: {why}", ty.name(), types.join(", "));
            Err(wrong(message, place))
        };
        if given.iter().any(is_open) {
            return Ok(());
        }
        let each = |wanted: &[Ty]| -> Result<(), Error> {
            if wanted.len() != given.len() {
                return wrong(format!("{} values are expected", wanted.len()));
            }
            let not = given.iter().zip(wanted).find(|(g, w)| !becomes(g, w));
            match not {
                None => Ok(()),
                Some((g, w)) => wrong(format!("{} is given, but {} is expected", a(g), a(w))),
            }
        };
        let wanted = match ty {
            Ty::Struct(name) => {
                let Some(of) = structs.get(name) else {
                    return Ok(());
                };
                let types: Vec<Ty> = of.members.iter().map(|m| m.ty.clone()).collect();
                return each(&types);
            }
            Ty::Array(of, n) => {
                return each(&vec![
                    (**of).clone();
                    n.map_or(given.len(), |length| length.n as usize)
                ]);
            }
            Ty::Scalar(_) => 1,
            Ty::Vector(_, n) => usize::from(*n),
            Ty::Matrix(_, columns, rows) => usize::from(*columns) * usize::from(*rows),
            _ => return Ok(()),
        };
        if let Some(other) = given.iter().find(|t| t.kind().is_none()) {
            return wrong(format!("{} is not a number", a(other)));
        }
        if given.is_empty() {
            return wrong("a value is expected".to_owned());
        }
        let matrices = given.iter().any(|t| matches!(t, Ty::Matrix(..)));
        if matrices {
            // A single matrix is resized. The validator checks the others.
            return Ok(());
        }
        if matches!(ty, Ty::Scalar(_)) {
            return match given.len() {
                1 => Ok(()),
                _ => wrong("one value is expected".to_owned()),
            };
        }
        if let [Ty::Scalar(_)] = given {
            return Ok(());
        }
        let sizes = || {
            given
                .iter()
                .map(|t| usize::from(t.components().unwrap_or(1)))
        };
        let have: usize = sizes().sum();
        let before: usize = sizes().take(given.len() - 1).sum();
        match () {
            () if have < wanted => wrong(format!(
                "{wanted} components are expected, but {have} are given"
            )),
            () if before >= wanted => wrong(format!(
                "{wanted} components are already given without the last value"
            )),
            () => Ok(()),
        }
    }
}

/// Whether two branches have a common type.
pub(super) fn meet(x: &Ty, y: &Ty) -> bool {
    is_open(x) || is_open(y) || is_same(x, y) || becomes(x, y) || becomes(y, x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operators_go_between_what_they_go_between() {
        let fits = |op: B, a: &str, b: &str| fits(&op, &Ty::named(a), &Ty::named(b));
        assert!(fits(B::Mult, "mat3", "vec3") && fits(B::Mult, "vec2", "mat3x2"));
        assert!(fits(B::Mult, "mat2x3", "mat4x2") && !fits(B::Mult, "mat2x3", "mat2x3"));
        assert!(!fits(B::Mult, "mat4", "vec3") && !fits(B::Add, "vec2", "vec3"));
        assert!(fits(B::Add, "int", "vec3") && fits(B::Div, "mat4", "float"));
        assert!(!fits(B::Add, "bool", "int") && !fits(B::And, "int", "bool"));
        assert!(fits(B::LShift, "ivec2", "uint") && !fits(B::LShift, "int", "ivec2"));
        assert!(!fits(B::Mod, "float", "float") && fits(B::Mod, "ivec3", "int"));
        assert!(!fits(B::Lt, "vec2", "vec2") && fits(B::Equal, "vec2", "ivec2"));
    }

    #[test]
    fn types_have_articles() {
        assert_eq!(a(&Ty::named("int")), "an int");
        assert_eq!(a(&Ty::named("uvec2")), "a uvec2");
        assert_eq!(
            a(&Ty::Array(Box::new(Ty::FLOAT), Some(3.into()))),
            "an array float[3]"
        );
    }
}
