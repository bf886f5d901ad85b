//! Resolves elements, members and swizzles.

use glsl_lang::ast::{Expr, ExprData};
use naga::Span;

use super::expression::Ex;
use super::fold::Folds;
use super::{Resolver, check};
use crate::constant;
use crate::errors::{unsupported, wrong};
use crate::layout::{MemoryLayout, padded_size};
use crate::tree::{Kind, Node};
use crate::ty::{Component, Ty};
use shader_text::error::Error;

impl Resolver<'_, '_> {
    pub(super) fn index(&mut self, of: &Expr, index: &Expr, whole: &Expr) -> Result<Ex, Error> {
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
            return Ok(self.target(n));
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
            Some(Component::Float | Component::Bool) => Node::convert(&Ty::INT, index.node),
            _ => index.node,
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
        let mut ex = element(&base, &index.node);
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

    pub(super) fn dot(&mut self, of: &Expr, name: &str, whole: &Expr) -> Result<Ex, Error> {
        if let ExprData::Variable(instance) = &of.content {
            self.check_declared(instance.as_str(), of)?;
        }
        // A member of a block with an instance name.
        if let ExprData::Variable(instance) = &of.content
            && self.lookup(instance.as_str()).is_none()
            && let Some(var) = self
                .lookup(&format!("{}.{name}", instance.as_str()))
                .cloned()
        {
            return Ok(self.of_var(&var));
        }
        // A member of an element of an array of blocks.
        if let ExprData::Bracket(array, index) = &of.content
            && let ExprData::Variable(instance) = &array.content
            && let instance = instance.as_str()
            && self.lookup(instance).is_none()
            && let Some(var) = self.lookup(&format!("{instance}[].{name}")).cloned()
        {
            let index = self.expr(index)?;
            let mut ex = self.of_var(&var);
            if let Kind::Field(array, member) = &*var.ex.node.kind {
                ex.node = array.element(index.node).field(member.as_str());
            }
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
                    return Err(wrong(
                        format!("the struct `{of}` has no member `{name}`"),
                        self.place(whole.span),
                    ));
                };
                let mut ex = Ex::new(base.node.field(name), member.ty);
                ex.lay = self.stage.structs.member_lay(&of, base.lay);
                ex.path = base.path.map(|p| format!("{p}.{name}"));
                self.with_pair(ex)
            }
            // Since GLSL 4.20.
            Ty::Scalar(kind) if numbers(name, 1).is_some() => {
                let base = self.value(base);
                match name.len() as u8 {
                    1 => base,
                    n => base.converted(&Ty::Vector(kind, n)),
                }
            }
            Ty::Scalar(_) => {
                let message = format!("{} has no components `{name}`", check::a(&base.ty));
                return Err(wrong(message, self.place(whole.span)));
            }
            Ty::Vector(..) => self.components_of(base, of_expr, name, self.place(whole.span))?,
            _ => {
                return Err(wrong(
                    format!("{} has no members", check::a(&base.ty)),
                    self.place(whole.span),
                ));
            }
        };
        Ok(ex.folding(folds))
    }

    /// An element of an array, a column, or a component.
    pub(super) fn element_of(&self, base: Ex, index: &Node) -> Ex {
        let scalar = || Ty::Scalar(base.ty.kind().unwrap_or(Component::Float));
        if let Some((of, numbers)) = base.swizzle {
            let index = match index.index().and_then(|n| numbers.get(n)) {
                Some(n) => Node::int(*n as i32),
                None => {
                    let all: Vec<Node> = numbers.iter().map(|n| Node::int(*n as i32)).collect();
                    let ty = Ty::Vector(Component::Int, all.len() as u8);
                    Node::construct(&ty, all).element(index.clone())
                }
            };
            return self.element_of(*of, &index);
        }
        if let Some((matrix, column)) = &base.turned {
            let node = matrix.element(index.clone()).element(column.clone());
            return Ex::new(node, scalar());
        }
        match base.ty {
            Ty::Matrix(_, _, rows) if base.lay.rows => {
                let matrix = base.node.clone();
                let parts = (0..u32::from(rows)).map(|r| matrix.nth(r).element(index.clone()));
                let parts = parts.collect();
                let mut ex = element(&self.value(base), index);
                ex.parts = Some(parts);
                ex.turned = Some((matrix, index.clone()));
                ex
            }
            Ty::Vector(..) if base.lay.is_padded() => {
                let mut base = base;
                base.node = of_four(&base.node);
                element(&base, index)
            }
            _ => element(&base, index),
        }
    }

    /// A swizzle: `v.xy`.
    pub(super) fn components_of(
        &self,
        base: Ex,
        of: &Expr,
        name: &str,
        place: Option<Span>,
    ) -> Result<Ex, Error> {
        let Ty::Vector(kind, size) = base.ty else {
            return Ok(base);
        };
        let numbers = numbers(name, size).ok_or_else(|| {
            wrong(
                format!("a {} has no components `{name}`", base.ty.name()),
                place,
            )
        })?;
        if let (Some((inner, chosen)), ExprData::Dot(of, _)) = (&base.swizzle, &of.content) {
            let letters = numbers
                .iter()
                .filter_map(|n| "xyzw".chars().nth(*chosen.get(*n)?));
            let name: String = letters.collect();
            return self.components_of((**inner).clone(), of, &name, place);
        }
        let lay = match kind {
            Component::Bool => base.lay,
            _ => MemoryLayout::default(),
        };
        let whole = match base.lay.is_padded() {
            true => of_four(&base.node),
            false => base.node.clone(),
        };
        let ty = Ty::vector(kind, numbers.len() as u8);
        let part = |number: &usize| match &base.parts {
            Some(parts) => parts.get(*number).cloned(),
            None => Some(whole.nth(*number as u32)),
        };
        let swizzled = || whole.swizzle(numbers.iter().map(|n| *n as u32));
        let node = match (&numbers[..], &of.content) {
            // A component of a column, which the IR can point to.
            ([number], ExprData::Bracket(..)) => part(number),
            ([number], _) if base.parts.is_some() => part(number),
            _ => None,
        };
        let mut ex = Ex::new(node.unwrap_or_else(swizzled), ty);
        if numbers.len() > 1 && (base.column || base.parts.is_some()) {
            ex.parts = Some(numbers.iter().filter_map(part).collect());
        }
        ex.lay = lay;
        if numbers.len() > 1 {
            ex.swizzle = Some((Box::new(base), numbers));
        }
        Ok(ex)
    }
}

/// An element of an array, a column or a component, in its stored type.
pub(super) fn element(base: &Ex, index: &Node) -> Ex {
    let node = base.node.element(index.clone());
    let (ty, padded) = match &base.ty {
        Ty::Array(of, _) => {
            let is_padded = base.lay.is_padded() && padded_size(of).is_some();
            ((**of).clone(), of.components().filter(|_| is_padded))
        }
        Ty::Matrix(k, _, rows) => {
            let column = Ty::Vector(*k, *rows);
            let is_padded = base.lay.is_padded() && padded_size(&column).is_some();
            (column, is_padded.then_some(*rows))
        }
        Ty::Vector(k, _) => (Ty::Scalar(*k), None),
        other => (other.clone(), None),
    };
    let node = match padded {
        Some(n) => node.swizzle(0..u32::from(n)),
        None => node,
    };
    let mut ex = Ex::new(node, ty);
    ex.lay = base.lay;
    ex.column = matches!(base.ty, Ty::Matrix(..));
    ex
}

/// The vec4 of which `node` reads two components.
fn of_four(node: &Node) -> Node {
    match &*node.kind {
        Kind::Swizzle(of, numbers) if numbers[..] == [0, 1] => of.clone(),
        _ => node.clone(),
    }
}

/// The component indices of a swizzle. `None` if it is invalid for a vector of this size.
fn numbers(name: &str, size: u8) -> Option<Vec<usize>> {
    let sets = ["xyzw", "rgba", "stpq"];
    let of = |set: &&str| -> Option<Vec<usize>> { name.chars().map(|c| set.find(c)).collect() };
    let all = sets.iter().find_map(of)?;
    let fits = (1..=4).contains(&all.len()) && all.iter().all(|n| *n < usize::from(size));
    fits.then_some(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_of_one_set_and_there() {
        assert_eq!(numbers("zyx", 3), Some(vec![2, 1, 0]));
        assert_eq!(numbers("q", 4), Some(vec![3]));
        assert_eq!(numbers("z", 2), None);
        assert_eq!(numbers("xg", 4), None);
        assert_eq!(numbers("xxxxx", 4), None);
    }
}
