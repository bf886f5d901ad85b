//! Calls of constructors.

use glsl_lang::ast::Expr;
use naga::Span;

use super::effect::after;
use super::expression::Ex;
use super::fold::Folds;
use super::{Pair, Resolver};
use crate::constant;
use crate::errors::unsupported;
use crate::layout::{BlockEntry, MemoryLayout};
use crate::tree::Node;
use crate::ty::{Component, Ty};
use shader_text::error::Error;

impl Resolver<'_, '_> {
    pub(super) fn constructor(
        &mut self,
        ty: Ty,
        arguments: &[Expr],
        whole: &Expr,
    ) -> Result<Ex, Error> {
        let place = self.place(whole.span);
        let values = self.values(arguments)?;
        let types: Vec<Ty> = values.iter().map(|v| v.ty.clone()).collect();
        self.check_constructor(&ty, &types, place)?;
        let folds = Folds::of(&values, |values| constant::construct(&ty, values));
        let ex = match (&ty, &values[..]) {
            (Ty::Combined(name), [texture, sampler]) => {
                let pair = Pair {
                    combined: name.clone(),
                    texture: texture.node.clone(),
                    sampler: sampler.node.clone(),
                };
                let mut ex = Ex::new(pair.node(), ty.clone());
                ex.pair = Some(pair);
                ex
            }
            (Ty::Combined(name), _) => {
                let message = format!("`{name}` takes a texture and a sampler");
                return Err(unsupported(message, place));
            }
            (Ty::Struct(name), _) => self.struct_constructor(name, values, place)?,
            (Ty::Array(of, n), _) => {
                // `float[][](..)`: the elements have the inner length.
                let of = match (&**of, types.first()) {
                    (Ty::Array(_, None), Some(first @ Ty::Array(..))) => first,
                    _ => of,
                };
                let ty = Ty::Array(
                    Box::new(of.clone()),
                    Some(n.unwrap_or((values.len() as u32).into())),
                );
                let values: Vec<Ex> = values.into_iter().map(|v| self.coerce(v, of)).collect();
                constructed(&values, ty)
            }
            (Ty::Void | Ty::Opaque(_), _) => constructed(&values, ty),
            (_, [value]) if value.ty == ty => value.clone(),
            // The first component of a vector or matrix.
            (Ty::Scalar(_), [value]) => {
                let node = value.node.clone();
                let first = match &value.ty {
                    Ty::Vector(..) => node.component(0),
                    Ty::Matrix(..) => node.nth(0).component(0),
                    _ => node,
                };
                Ex::new(Node::convert(&ty, first), ty)
            }
            // A longer vector is truncated.
            (Ty::Vector(kind, n), [value]) if value.ty.components().is_some_and(|m| m > *n) => {
                let cut = value.node.swizzle(0..u32::from(*n));
                match value.ty.kind() == Some(*kind) {
                    true => Ex::new(cut, ty),
                    false => Ex::new(Node::convert(&ty, cut), ty),
                }
            }
            (Ty::Vector(kind, n), _) => self.components(&ty, *kind, usize::from(*n), values),
            (Ty::Matrix(kind, columns, rows), _) => {
                let all = usize::from(*columns) * usize::from(*rows);
                match &values[..] {
                    [value] if matches!(value.ty, Ty::Matrix(..)) => resized(value, &ty),
                    [value] if matches!(value.ty, Ty::Vector(..)) => {
                        let (first, value) = self.once(value);
                        let parts = (0..all.min(4) as u32).map(|c| value.node.component(c));
                        after(first, Ex::new(Node::construct(&ty, parts.collect()), ty))
                    }
                    _ => self.components(&ty, *kind, all, values),
                }
            }
            _ => constructed(&values, ty),
        };
        Ok(ex.folding(folds))
    }

    fn struct_constructor(
        &mut self,
        name: &str,
        values: Vec<Ex>,
        place: Option<Span>,
    ) -> Result<Ex, Error> {
        let of = self.stage.structs.get(name).cloned();
        let entries = of.as_ref().map(|of| self.stage.structs.entries(of));
        let lay = self.stage.structs.member_lay(name, MemoryLayout::default());
        let members: Vec<Ty> = of
            .iter()
            .flat_map(|of| &of.members)
            .map(|m| m.ty.clone())
            .collect();
        let values = values.into_iter().zip(&members);
        let mut values: Vec<Ex> = values.map(|(v, ty)| self.coerce(v, ty)).collect();
        let structs = &self.stage.structs;
        let converted: Vec<bool> = members
            .iter()
            .map(|ty| structs.is_converted(ty, lay))
            .collect();
        let is_moving = |i: usize, v: &Ex| converted[i] && !v.node.is_path();
        let first = self.hold_in_order(&mut values, is_moving);
        let mut parts = Vec::new();
        let mut values = values.into_iter();
        for entry in entries.unwrap_or_default() {
            let BlockEntry::Member(member) = entry else {
                parts.push(Node::float(0.0));
                continue;
            };
            let Some(value) = values.next() else {
                break;
            };
            parts.push(self.packed(&value, &member.ty, lay).ok_or_else(|| {
                unsupported("a struct of this shape cannot be constructed", place)
            })?);
        }
        let ty = Ty::Struct(name.to_owned());
        Ok(after(first, Ex::new(Node::construct(&ty, parts), ty)))
    }

    /// A vector or matrix constructor from components: converts each and drops extra ones.
    fn components(&self, ty: &Ty, kind: Component, wanted: usize, mut values: Vec<Ex>) -> Ex {
        let alone = values.len() == 1;
        // If a single scalar fills all components, it is converted first.
        if let [value] = &mut values[..]
            && matches!(value.ty, Ty::Scalar(from) if from != kind)
        {
            *value = value.converted(&Ty::Scalar(kind));
        }
        let mut have = 0;
        let parts: Vec<Node> = values
            .into_iter()
            .map(|mut value| {
                let n = usize::from(value.ty.components().unwrap_or(1));
                // The last argument may have extra components.
                if let Ty::Vector(k, _) = value.ty
                    && have + n > wanted
                    && have < wanted
                {
                    let rest = wanted - have;
                    let node = value.node.swizzle(0..rest as u32);
                    value = Ex::new(node, Ty::vector(k, rest as u8));
                }
                have += n;
                match (value.ty.kind(), kind) {
                    (Some(from), _) if from == kind || alone => value.node,
                    (None, _) => value.node,
                    // Keep a literal a literal.
                    (Some(Component::Int), Component::Float) => {
                        self.coerce_kind(value, Some(kind)).node
                    }
                    _ => value.converted(&value.ty.with_kind(kind)).node,
                }
            })
            .collect();
        Ex::new(Node::construct(ty, parts), ty.clone())
    }
}

/// Converts a matrix to another size, filled up with the identity.
fn resized(value: &Ex, to: &Ty) -> Ex {
    let (Ty::Matrix(_, columns, rows), Ty::Matrix(_, have_columns, have_rows)) = (to, &value.ty)
    else {
        return value.clone();
    };
    let node = &value.node;
    if have_columns >= columns && have_rows >= rows || !node.is_path() {
        return value.converted(to);
    }
    let mut parts = Vec::new();
    for c in 0..*columns {
        for r in 0..*rows {
            parts.push(match c < *have_columns && r < *have_rows {
                true => node.nth(u32::from(c)).nth(u32::from(r)),
                false => Node::float(if c == r { 1.0 } else { 0.0 }),
            });
        }
    }
    Ex::new(Node::construct(to, parts), to.clone())
}

fn constructed(values: &[Ex], ty: Ty) -> Ex {
    let parts = values.iter().map(|v| v.node.clone()).collect();
    Ex::new(Node::construct(&ty, parts), ty)
}
