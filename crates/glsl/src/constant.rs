//! Evaluates GLSL constant expressions: array lengths, locations, bindings, texture offsets.

use std::cell::RefCell;
use std::collections::{BTreeSet, HashMap};
use std::rc::Rc;

use glsl_lang::ast::{BinaryOpData as B, Expr, ExprData, FunIdentifierData, UnaryOpData};

use super::built_in_variables::limit;
use super::ty::{Component, Ty, spelled};

/// Scalar and vector constants by name, and array lengths by [`length_of`] the array's name.
#[derive(Clone, Debug, Default)]
pub(super) struct Constants {
    known: HashMap<String, ConstantValue>,
    /// Specialisation constants, and constants that depend on them.
    defaults: HashMap<String, (ConstantValue, Specialised)>,
    /// The members of structs, by the struct's name.
    pub(super) members: HashMap<String, Vec<String>>,
    /// Constants that only rename a specialisation constant: `const int M = N;`.
    aliases: HashMap<String, (u32, String)>,
    /// The specialisation constant whose default is taken as one larger. See
    /// [`lengths`](super::lengths).
    raised: Option<u32>,
}

/// Specialisation constants: ids and names.
pub(super) type Specialised = BTreeSet<(u32, String)>;

impl Constants {
    pub(super) fn raising(raised: Option<u32>) -> Self {
        Self {
            raised,
            ..Self::default()
        }
    }

    /// The specialisation constant behind a name, or behind its alias.
    pub(super) fn specialised(&self, name: &str) -> Option<(u32, String)> {
        let (_, from) = self.defaults.get(name)?;
        if let Some(of) = self.aliases.get(name) {
            return Some(of.clone());
        }
        let mut from = from.iter();
        match (from.next(), from.next()) {
            (Some(of), None) if of.1 == name => Some(of.clone()),
            _ => None,
        }
    }

    /// The value of a constant, if it is known and cannot be specialised.
    pub(super) fn value(&self, name: &str) -> Option<ConstantValue> {
        self.known.get(name).cloned()
    }

    /// Whether a constant's value is known and cannot be specialised.
    pub(super) fn is_known(&self, name: &str) -> bool {
        self.known.contains_key(name)
    }
}

/// The value of a constant expression, with GLSL's 32-bit numbers (4.60, 4.1).
#[derive(Clone, Debug, PartialEq)]
pub(super) enum ConstantValue {
    Int(i32),
    Uint(u32),
    Float(f32),
    Bool(bool),
    /// Two to four scalars.
    Vector(Vec<ConstantValue>),
    /// The elements of an array, or the columns of a matrix.
    Array(Rc<[ConstantValue]>),
    /// The members of a struct.
    Struct(Rc<[(String, ConstantValue)]>),
}

use ConstantValue::{Array, Bool, Float, Int, Struct, Uint, Vector};

mod built_in_functions;

pub(super) use built_in_functions::call;

/// The key for an array's length. It is unique, because no name contains brackets.
fn length_of(name: &str) -> String {
    format!("{name}.length()")
}

/// Records a declared variable's array length or constant value, and drops those of a variable that
/// it hides. `id`: of a specialisation constant.
pub(super) fn declare(
    constants: &mut Constants,
    name: &str,
    ty: &Ty,
    value: Option<&Expr>,
    id: Option<u32>,
) {
    // The name is in scope only after its value.
    let alias = value.and_then(|e| alias_of(e, ty, constants));
    let assumed = value.and_then(|e| assume(e, constants));
    constants.aliases.remove(name);
    if let (Some(of), None) = (alias, id) {
        constants.aliases.insert(name.to_owned(), of);
    }
    constants.known.remove(name);
    constants.known.remove(&length_of(name));
    constants.defaults.remove(name);
    constants.defaults.remove(&length_of(name));
    if let Some((value, mut from)) = assumed
        && let Some(value) = match ty {
            Ty::Array(..) | Ty::Matrix(..) | Ty::Struct(_) => Some(value),
            _ => construct(ty, &[value]),
        }
    {
        let value = match (id, value) {
            (Some(id), Int(n)) if constants.raised == Some(id) => Int(n.wrapping_add(1)),
            (Some(id), Uint(n)) if constants.raised == Some(id) => Uint(n.wrapping_add(1)),
            (_, value) => value,
        };
        from.extend(id.map(|id| (id, name.to_owned())));
        match from.is_empty() {
            true => constants.known.insert(name.to_owned(), value).is_some(),
            false => {
                let value = (value, from);
                constants.defaults.insert(name.to_owned(), value).is_some()
            }
        };
    }
    if let Ty::Array(_, Some(length)) = ty
        && let Ok(n) = i32::try_from(length.n)
    {
        let from: Specialised = constants
            .defaults
            .values()
            .flat_map(|(_, from)| from)
            .filter(|(id, _)| Some(*id) == length.constant)
            .cloned()
            .collect();
        let name = length_of(name);
        match from.is_empty() {
            true => constants.known.insert(name, Int(n)).is_some(),
            false => constants.defaults.insert(name, (Int(n), from)).is_some(),
        };
    }
}

/// The specialisation constant that an expression names, if this type needs no conversion.
fn alias_of(e: &Expr, ty: &Ty, constants: &Constants) -> Option<(u32, String)> {
    let ExprData::Variable(name) = &e.content else {
        return None;
    };
    let (value, _) = constants.defaults.get(name.as_str())?;
    let is_same = construct(ty, std::slice::from_ref(value)).as_ref() == Some(value);
    constants.specialised(name.as_str()).filter(|_| is_same)
}

/// Evaluates an integer constant expression. `None` for other expressions.
pub(super) fn evaluate(expr: &Expr, constants: &Constants) -> Option<i64> {
    let known = |name: &str| constants.known.get(name).cloned();
    integer(&value(expr, &constants.members, &known)?)
}

/// Evaluates a constant expression with the defaults of specialisation constants, and lists these.
pub(super) fn assume(expr: &Expr, constants: &Constants) -> Option<(ConstantValue, Specialised)> {
    let from = RefCell::new(Specialised::new());
    let found = value(expr, &constants.members, &|name| {
        constants.known.get(name).cloned().or_else(|| {
            let (value, of) = constants.defaults.get(name)?;
            from.borrow_mut().extend(of.iter().cloned());
            Some(value.clone())
        })
    })?;
    Some((found, from.into_inner()))
}

/// The value as an integer.
pub(super) fn integer(value: &ConstantValue) -> Option<i64> {
    match value {
        Int(n) => Some(i64::from(*n)),
        Uint(n) => Some(i64::from(*n)),
        Bool(b) => Some(i64::from(*b)),
        Float(_) | Vector(_) | Array(_) | Struct(_) => None,
    }
}

/// The components of a constant `ivec`.
pub(super) fn integers(value: ConstantValue) -> Option<Vec<i32>> {
    let Vector(parts) = value else {
        return None;
    };
    let int = |part: ConstantValue| match part {
        Int(n) => Some(n),
        _ => None,
    };
    parts.into_iter().map(int).collect()
}

/// Whether it is 0, or a vector of zeros.
pub(super) fn is_zero(value: &ConstantValue) -> bool {
    match value {
        Float(x) => *x == 0.0,
        Vector(parts) => parts.iter().all(is_zero),
        other => integer(other) == Some(0),
    }
}

/// Whether all floats of a value are finite.
pub(super) fn is_finite(value: &ConstantValue) -> bool {
    match value {
        Float(x) => x.is_finite(),
        Vector(parts) => parts.iter().all(is_finite),
        Array(parts) => parts.iter().all(is_finite),
        Struct(members) => members.iter().all(|(_, value)| is_finite(value)),
        Int(_) | Uint(_) | Bool(_) => true,
    }
}

/// The component, element or column at an index.
pub(super) fn indexed(of: ConstantValue, index: &ConstantValue) -> Option<ConstantValue> {
    let at = usize::try_from(integer(index)?).ok()?;
    match of {
        Vector(parts) => parts.get(at).cloned(),
        Array(parts) => parts.get(at).cloned(),
        _ => None,
    }
}

fn value(
    expr: &Expr,
    members: &HashMap<String, Vec<String>>,
    named: &dyn Fn(&str) -> Option<ConstantValue>,
) -> Option<ConstantValue> {
    let of = |e: &Expr| value(e, members, named);
    match &expr.content {
        ExprData::IntConst(i) => Some(Int(*i)),
        ExprData::UIntConst(u) => Some(Uint(*u)),
        ExprData::BoolConst(b) => Some(Bool(*b)),
        ExprData::FloatConst(f) => Some(Float(*f)),
        ExprData::Variable(name) => named(name.as_str()).or_else(|| limit(name.as_str()).map(Int)),
        ExprData::Unary(op, a) => unary(&op.content, of(a)?),
        ExprData::Binary(op, a, b) => binary(&op.content, of(a)?, of(b)?),
        ExprData::Dot(of_what, parts) => swizzled(of(of_what)?, parts.as_str()),
        ExprData::Bracket(of_what, index) => indexed(of(of_what)?, &of(index)?),
        ExprData::Ternary(c, a, b) => match of(c)? {
            Bool(true) => of(a),
            Bool(false) => of(b),
            _ => None,
        },
        ExprData::FunCall(name, arguments) => {
            let all = || {
                arguments
                    .iter()
                    .map(of)
                    .collect::<Option<Vec<ConstantValue>>>()
            };
            let name = match &name.content {
                FunIdentifierData::TypeSpecifier(ty) => {
                    let name = spelled(&ty.ty);
                    let is_array = ty.array_specifier.is_some();
                    return composed(&name, is_array, members.get(&name), all()?);
                }
                FunIdentifierData::Expr(callee) => match &callee.content {
                    ExprData::Dot(array, method) if method.as_str() == "length" => {
                        let ExprData::Variable(name) = &array.content else {
                            return None;
                        };
                        return named(&length_of(name.as_str()));
                    }
                    _ => name.as_ident()?.to_string(),
                },
            };
            call(&name, &all()?)
        }
        _ => None,
    }
}

/// The value of a constructor. `members`: of the struct, if it is one.
fn composed(
    name: &str,
    is_array: bool,
    members: Option<&Vec<String>>,
    all: Vec<ConstantValue>,
) -> Option<ConstantValue> {
    let ty = Ty::named(name);
    if is_array {
        let element = |v: ConstantValue| construct(&ty, std::slice::from_ref(&v)).unwrap_or(v);
        return Some(Array(all.into_iter().map(element).collect()));
    }
    match (ty, members) {
        (_, Some(members)) => Some(Struct(members.iter().cloned().zip(all).collect())),
        (Ty::Matrix(kind, columns, rows), _) => {
            let scalars = all.into_iter().flat_map(|value| match value {
                Vector(parts) => parts,
                other => vec![other],
            });
            let scalars: Option<Vec<_>> = scalars.map(|part| scalar(kind, &part)).collect();
            let (scalars, rows) = (scalars?, usize::from(rows));
            let is_whole = scalars.len() == usize::from(columns) * rows;
            let columns = scalars.chunks(rows).map(|column| Vector(column.to_vec()));
            is_whole.then(|| Array(columns.collect()))
        }
        (ty, None) => construct(&ty, &all),
    }
}

pub(super) fn unary(op: &UnaryOpData, a: ConstantValue) -> Option<ConstantValue> {
    Some(match (op, a) {
        (_, Vector(parts)) => {
            let parts: Option<_> = parts.into_iter().map(|p| unary(op, p)).collect();
            Vector(parts?)
        }
        (UnaryOpData::Add, a) => a,
        (UnaryOpData::Minus, Int(a)) => Int(a.wrapping_neg()),
        (UnaryOpData::Minus, Uint(a)) => Uint(a.wrapping_neg()),
        (UnaryOpData::Minus, Float(a)) => Float(-a),
        (UnaryOpData::Not, Bool(a)) => Bool(!a),
        (UnaryOpData::Complement, Int(a)) => Int(!a),
        (UnaryOpData::Complement, Uint(a)) => Uint(!a),
        _ => return None,
    })
}

/// A member, or a swizzle such as `v.x` or `v.rg`.
pub(super) fn swizzled(of: ConstantValue, names: &str) -> Option<ConstantValue> {
    let parts = match of {
        Vector(parts) => parts,
        Struct(members) => {
            let mut members = members.iter();
            return members
                .find(|(m, _)| m == names)
                .map(|(_, value)| value.clone());
        }
        _ => return None,
    };
    let part = |name: char| {
        let sets = ["xyzw", "rgba", "stpq"];
        let at = sets.iter().find_map(|s| s.find(name))?;
        parts.get(at).cloned()
    };
    let mut chosen: Vec<ConstantValue> = names.chars().map(part).collect::<Option<_>>()?;
    match chosen.len() {
        1 => chosen.pop(),
        2..=4 => Some(Vector(chosen)),
        _ => None,
    }
}

/// Converts both values to one type, by GLSL's implicit conversions.
fn alike(a: ConstantValue, b: ConstantValue) -> Option<(ConstantValue, ConstantValue)> {
    let real = |v: ConstantValue| match v {
        Int(n) => Some(Float(n as f32)),
        Uint(n) => Some(Float(n as f32)),
        Float(_) => Some(v),
        _ => None,
    };
    let unsigned = |v: ConstantValue| match v {
        Int(n) => Uint(n as u32),
        other => other,
    };
    match (a, b) {
        (a @ Float(_), b) | (a, b @ Float(_)) => Some((real(a)?, real(b)?)),
        (a @ Uint(_), b @ Int(_)) | (a @ Int(_), b @ Uint(_)) => Some((unsigned(a), unsigned(b))),
        (a, b) => Some((a, b)),
    }
}

pub(super) fn binary(op: &B, a: ConstantValue, b: ConstantValue) -> Option<ConstantValue> {
    // Per component; comparing vectors gives one bool.
    let compares = matches!(op, B::Equal | B::NonEqual | B::Lt | B::Gt | B::Lte | B::Gte);
    let all = |pairs: Vec<(ConstantValue, ConstantValue)>| {
        let parts: Option<_> = pairs.into_iter().map(|(a, b)| binary(op, a, b)).collect();
        parts.map(Vector)
    };
    match (a, b) {
        (Vector(_), _) | (_, Vector(_)) if compares => None,
        (Vector(a), Vector(b)) if a.len() == b.len() => all(a.into_iter().zip(b).collect()),
        (Vector(_), Vector(_)) => None,
        (Vector(a), b) => all(a.into_iter().map(|a| (a, b.clone())).collect()),
        (a, Vector(b)) => all(b.into_iter().map(|b| (a.clone(), b)).collect()),
        (a, b) => scalars(op, a, b),
    }
}

fn scalars(op: &B, a: ConstantValue, b: ConstantValue) -> Option<ConstantValue> {
    if let B::LShift | B::RShift = op {
        let by = match b {
            Int(n) => u32::try_from(n).ok()?,
            Uint(n) => n,
            _ => return None,
        };
        return match (op, a) {
            (B::LShift, Int(a)) => a.checked_shl(by).map(Int),
            (_, Int(a)) => a.checked_shr(by).map(Int),
            (B::LShift, Uint(a)) => a.checked_shl(by).map(Uint),
            (_, Uint(a)) => a.checked_shr(by).map(Uint),
            _ => None,
        };
    }
    match alike(a, b)? {
        (Int(a), Int(b)) => Some(match op {
            B::Add => Int(a.wrapping_add(b)),
            B::Sub => Int(a.wrapping_sub(b)),
            B::Mult => Int(a.wrapping_mul(b)),
            B::Div => Int(a.checked_div(b)?),
            B::Mod => Int(a.checked_rem(b)?),
            B::BitAnd => Int(a & b),
            B::BitOr => Int(a | b),
            B::BitXor => Int(a ^ b),
            other => compared(other, &a, &b)?,
        }),
        (Uint(a), Uint(b)) => Some(match op {
            B::Add => Uint(a.wrapping_add(b)),
            B::Sub => Uint(a.wrapping_sub(b)),
            B::Mult => Uint(a.wrapping_mul(b)),
            B::Div => Uint(a.checked_div(b)?),
            B::Mod => Uint(a.checked_rem(b)?),
            B::BitAnd => Uint(a & b),
            B::BitOr => Uint(a | b),
            B::BitXor => Uint(a ^ b),
            other => compared(other, &a, &b)?,
        }),
        (Float(a), Float(b)) => Some(match op {
            B::Add => Float(a + b),
            B::Sub => Float(a - b),
            B::Mult => Float(a * b),
            B::Div => Float(a / b),
            other => compared(other, &a, &b)?,
        }),
        (Bool(a), Bool(b)) => match op {
            B::And => Some(Bool(a && b)),
            B::Or => Some(Bool(a || b)),
            B::Xor | B::NonEqual => Some(Bool(a != b)),
            B::Equal => Some(Bool(a == b)),
            _ => None,
        },
        _ => None,
    }
}

fn compared<T: PartialOrd>(op: &B, a: &T, b: &T) -> Option<ConstantValue> {
    Some(Bool(match op {
        B::Equal => a == b,
        B::NonEqual => a != b,
        B::Lt => a < b,
        B::Gt => a > b,
        B::Lte => a <= b,
        B::Gte => a >= b,
        _ => return None,
    }))
}

/// The value of a scalar or vector constructor: from one scalar, a larger vector, or values with
/// exactly as many components in total (4.60, 5.4.2).
pub(super) fn construct(ty: &Ty, values: &[ConstantValue]) -> Option<ConstantValue> {
    let (kind, n) = match (ty, values) {
        (Ty::Scalar(kind), [value]) => return scalar(*kind, value),
        (Ty::Vector(kind, n), _) => (*kind, usize::from(*n)),
        _ => return None,
    };
    let mut parts: Vec<ConstantValue> = Vec::new();
    for value in values {
        match value {
            Vector(more) => parts.extend(more.iter().cloned()),
            scalar => parts.push(scalar.clone()),
        }
    }
    match values {
        [Vector(_)] => parts.truncate(n),
        [scalar] => parts = vec![scalar.clone(); n],
        _ => {}
    }
    let parts: Option<Vec<ConstantValue>> = parts.iter().map(|part| scalar(kind, part)).collect();
    parts.filter(|p| p.len() == n).map(Vector)
}

fn scalar(kind: Component, value: &ConstantValue) -> Option<ConstantValue> {
    Some(match (kind, value) {
        (Component::Int, Int(n)) => Int(*n),
        (Component::Int, Uint(n)) => Int(*n as i32),
        (Component::Int, Float(x)) => Int(*x as i32),
        (Component::Int, Bool(b)) => Int(i32::from(*b)),
        (Component::Uint, Int(n)) => Uint(*n as u32),
        (Component::Uint, Uint(n)) => Uint(*n),
        (Component::Uint, Float(x)) => Uint(*x as u32),
        (Component::Uint, Bool(b)) => Uint(u32::from(*b)),
        (Component::Float, Int(n)) => Float(*n as f32),
        (Component::Float, Uint(n)) => Float(*n as f32),
        (Component::Float, Float(x)) => Float(*x),
        (Component::Float, Bool(b)) => Float(f32::from(*b)),
        (Component::Bool, Int(n)) => Bool(*n != 0),
        (Component::Bool, Uint(n)) => Bool(*n != 0),
        (Component::Bool, Float(x)) => Bool(*x != 0.0),
        (Component::Bool, Bool(b)) => Bool(*b),
        _ => return None,
    })
}
