//! Integers that must be known while rewriting: the lengths of arrays, locations and bindings.

use std::collections::HashMap;

use glsl_lang::ast::{BinaryOpData as B, Expr, ExprData, FunIdentifierData, UnaryOpData};

/// Constants by name, as far as they are integers.
pub(super) type Constants = HashMap<String, i64>;

/// What a constant expression may be on its way to an integer, in the 32 bits that GLSL gives each (4.60, 4.1).
#[derive(Clone, Copy, Debug, PartialEq)]
enum Value {
    Int(i32),
    Uint(u32),
    Float(f32),
    Bool(bool),
}

use Value::{Bool, Float, Int, Uint};

/// The value of an integer constant expression, `None` for any other.
pub(super) fn evaluate(expr: &Expr, constants: &Constants) -> Option<i64> {
    match value(expr, constants)? {
        Int(n) => Some(i64::from(n)),
        Uint(n) => Some(i64::from(n)),
        Bool(b) => Some(i64::from(b)),
        Float(_) => None,
    }
}

fn value(expr: &Expr, constants: &Constants) -> Option<Value> {
    let of = |e: &Expr| value(e, constants);
    match &expr.content {
        ExprData::IntConst(i) => Some(Int(*i)),
        ExprData::UIntConst(u) => Some(Uint(*u)),
        ExprData::BoolConst(b) => Some(Bool(*b)),
        ExprData::FloatConst(f) => Some(Float(*f)),
        ExprData::Variable(name) => {
            let n = *constants.get(name.as_str())?;
            let signed = i32::try_from(n).map(Int);
            signed.or_else(|_| u32::try_from(n).map(Uint)).ok()
        }
        ExprData::Unary(op, a) => match (&op.content, of(a)?) {
            (UnaryOpData::Add, a) => Some(a),
            (UnaryOpData::Minus, Int(a)) => Some(Int(a.wrapping_neg())),
            (UnaryOpData::Minus, Uint(a)) => Some(Uint(a.wrapping_neg())),
            (UnaryOpData::Minus, Float(a)) => Some(Float(-a)),
            (UnaryOpData::Not, Bool(a)) => Some(Bool(!a)),
            (UnaryOpData::Complement, Int(a)) => Some(Int(!a)),
            (UnaryOpData::Complement, Uint(a)) => Some(Uint(!a)),
            _ => None,
        },
        ExprData::Binary(op, a, b) => binary(&op.content, of(a)?, of(b)?),
        ExprData::Ternary(c, a, b) => match of(c)? {
            Bool(true) => of(a),
            Bool(false) => of(b),
            _ => None,
        },
        ExprData::FunCall(name, arguments) => {
            let name = match &name.content {
                FunIdentifierData::TypeSpecifier(ty) => super::stage::spelled(&ty.ty),
                FunIdentifierData::Expr(_) => name.as_ident()?.to_string(),
            };
            let values: Option<Vec<Value>> = arguments.iter().map(of).collect();
            call(&name, values?.as_slice())
        }
        _ => None,
    }
}

/// Converted to one type, where GLSL does so without being asked.
fn alike(a: Value, b: Value) -> Option<(Value, Value)> {
    let real = |v: Value| match v {
        Int(n) => Some(Float(n as f32)),
        Uint(n) => Some(Float(n as f32)),
        Float(_) => Some(v),
        Bool(_) => None,
    };
    let unsigned = |v: Value| match v {
        Int(n) => Uint(n as u32),
        other => other,
    };
    match (a, b) {
        (Float(_), _) | (_, Float(_)) => Some((real(a)?, real(b)?)),
        (Uint(_), Int(_)) | (Int(_), Uint(_)) => Some((unsigned(a), unsigned(b))),
        _ => Some((a, b)),
    }
}

fn binary(op: &B, a: Value, b: Value) -> Option<Value> {
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

fn compared<T: PartialOrd>(op: &B, a: &T, b: &T) -> Option<Value> {
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

fn call(name: &str, values: &[Value]) -> Option<Value> {
    Some(match (name, values) {
        ("int", [v]) => Int(match *v {
            Int(n) => n,
            Uint(n) => n as i32,
            Float(x) => x as i32,
            Bool(b) => i32::from(b),
        }),
        ("uint", [v]) => Uint(match *v {
            Int(n) => n as u32,
            Uint(n) => n,
            Float(x) => x as u32,
            Bool(b) => u32::from(b),
        }),
        ("float", [v]) => Float(match *v {
            Int(n) => n as f32,
            Uint(n) => n as f32,
            Float(x) => x,
            Bool(b) => f32::from(b),
        }),
        ("bool", [v]) => Bool(match *v {
            Int(n) => n != 0,
            Uint(n) => n != 0,
            Float(x) => x != 0.0,
            Bool(b) => b,
        }),
        ("floor", [Float(x)]) => Float(x.floor()),
        ("ceil", [Float(x)]) => Float(x.ceil()),
        ("abs", [Float(x)]) => Float(x.abs()),
        ("abs", [Int(n)]) => Int(n.wrapping_abs()),
        ("min" | "max", [a, b]) => {
            let (a, b) = alike(*a, *b)?;
            let less = match binary(&B::Lt, b, a)? {
                Bool(less) => less,
                _ => return None,
            };
            match less == (name == "min") {
                true => b,
                false => a,
            }
        }
        _ => return None,
    })
}
