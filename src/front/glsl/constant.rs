//! Integers that must be known while rewriting: the lengths of arrays, locations and bindings.

use std::collections::HashMap;

use glsl_lang::ast::{BinaryOpData as B, Expr, ExprData, FunIdentifierData, UnaryOpData};

/// Constants by name, as far as they are integers.
pub(super) type Constants = HashMap<String, i64>;

/// The value of an integer constant expression, `None` for any other.
pub(super) fn evaluate(expr: &Expr, constants: &Constants) -> Option<i64> {
    let of = |e: &Expr| evaluate(e, constants);
    match &expr.content {
        ExprData::IntConst(i) => Some(i64::from(*i)),
        ExprData::UIntConst(u) => Some(i64::from(*u)),
        ExprData::BoolConst(b) => Some(i64::from(*b)),
        // In a conversion: `int(4.0)`.
        ExprData::FloatConst(f) => Some(*f as i64),
        ExprData::Variable(name) => constants.get(name.as_str()).copied(),
        ExprData::Unary(op, a) => {
            let a = of(a)?;
            match op.content {
                UnaryOpData::Minus => a.checked_neg(),
                UnaryOpData::Add => Some(a),
                UnaryOpData::Not => Some(i64::from(a == 0)),
                UnaryOpData::Complement => Some(!a),
                _ => None,
            }
        }
        ExprData::Binary(op, a, b) => {
            let (a, b) = (of(a)?, of(b)?);
            let shift = || u32::try_from(b).ok();
            match op.content {
                B::Add => a.checked_add(b),
                B::Sub => a.checked_sub(b),
                B::Mult => a.checked_mul(b),
                B::Div => a.checked_div(b),
                B::Mod => a.checked_rem(b),
                B::LShift => a.checked_shl(shift()?),
                B::RShift => a.checked_shr(shift()?),
                B::BitAnd => Some(a & b),
                B::BitOr => Some(a | b),
                B::BitXor => Some(a ^ b),
                B::Equal => Some(i64::from(a == b)),
                B::NonEqual => Some(i64::from(a != b)),
                B::Lt => Some(i64::from(a < b)),
                B::Gt => Some(i64::from(a > b)),
                B::Lte => Some(i64::from(a <= b)),
                B::Gte => Some(i64::from(a >= b)),
                B::And => Some(i64::from(a != 0 && b != 0)),
                B::Or => Some(i64::from(a != 0 || b != 0)),
                B::Xor => Some(i64::from((a != 0) != (b != 0))),
            }
        }
        ExprData::Ternary(c, a, b) => match of(c)? {
            0 => of(b),
            _ => of(a),
        },
        ExprData::FunCall(name, arguments) => {
            let name = match &name.content {
                FunIdentifierData::TypeSpecifier(ty) => super::stage::spelled(&ty.ty),
                FunIdentifierData::Expr(_) => name.as_ident()?.to_string(),
            };
            let values: Option<Vec<i64>> = arguments.iter().map(of).collect();
            match (name.as_str(), values?.as_slice()) {
                ("int" | "uint", [a]) => Some(*a),
                ("min", [a, b]) => Some(*a.min(b)),
                ("max", [a, b]) => Some(*a.max(b)),
                _ => None,
            }
        }
        _ => None,
    }
}
