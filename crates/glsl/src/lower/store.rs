//! Reads and writes values whose stored type differs: padded arrays, `bool`s, row-major matrices,
//! and structs of these. Also writes targets by component where naga cannot assign to them.

use glsl_lang::ast::{BinaryOpData, Expr, ExprData};
use naga::Span;

use super::super::source_marks::unmarked;
use super::super::stage::unsupported;
use super::super::ty::{BlockEntry, Component, GlslMember, MemoryLayout, Struct, Ty};
use super::Lower;
use super::effect::{after, is_literal};
use super::expression::{Ex, element, level, splat};
use super::fold::Folds;
use preshade_text::error::{Code, Error};
use preshade_text::unsupported;

/// Whether it is a name or a number, so that reading it twice is safe.
fn is_name(text: &str) -> bool {
    unmarked(text)
        .chars()
        .all(|c| c.is_alphanumeric() || c == '_')
}

/// The operator of a compound assignment.
fn compound(word: &str) -> Option<BinaryOpData> {
    Some(match word.strip_suffix('=')? {
        "*" => BinaryOpData::Mult,
        "/" => BinaryOpData::Div,
        "%" => BinaryOpData::Mod,
        "+" => BinaryOpData::Add,
        "-" => BinaryOpData::Sub,
        "<<" => BinaryOpData::LShift,
        ">>" => BinaryOpData::RShift,
        "&" => BinaryOpData::BitAnd,
        "^" => BinaryOpData::BitXor,
        "|" => BinaryOpData::BitOr,
        _ => return None,
    })
}

impl Lower<'_, '_> {
    /// The declared type in this layout, without padding.
    pub(super) fn shape(&mut self, ty: &Ty, lay: MemoryLayout) -> Ty {
        self.copy_structs(ty, lay);
        self.shaped(ty, lay)
    }

    fn shaped(&self, ty: &Ty, lay: MemoryLayout) -> Ty {
        match ty {
            Ty::Array(of, n) => Ty::Array(Box::new(self.shaped(of, lay)), *n),
            Ty::Struct(name) => {
                let twin = self
                    .interface
                    .struct_copies
                    .get(&self.struct_copy_key(name, lay));
                Ty::Struct(twin.unwrap_or(name).clone())
            }
            other => {
                let turned = lay.turned(other);
                match lay.is_std430() {
                    true => lay.stored(&turned),
                    false => turned,
                }
            }
        }
    }

    /// The declared type in this layout.
    fn stored_as(&self, ty: &Ty, lay: MemoryLayout) -> Ty {
        lay.stored(&self.shaped(ty, lay))
    }

    /// A struct's name, and whether its copy is row-major and std430.
    fn struct_copy_key(&self, name: &str, lay: MemoryLayout) -> (String, bool, bool) {
        let structs = &self.stage.structs;
        let ty = Ty::Struct(name.to_owned());
        let rows = lay.rows && structs.has_matrices(&ty);
        let tight = lay.is_std430() && (rows || !structs.is_std430(&ty));
        (name.to_owned(), rows, tight)
    }

    /// Declares the struct copies of a block, with the same names in both stages.
    fn copy_structs(&mut self, ty: &Ty, lay: MemoryLayout) {
        let Ty::Struct(name) = ty.innermost() else {
            return;
        };
        let key = self.struct_copy_key(name, lay);
        let own = self.stage.structs.get(name).cloned();
        let (true, Some(own)) = (key.1 || key.2, own) else {
            return;
        };
        let ending = match (key.1, key.2) {
            (true, true) => "_std430_rows",
            (true, false) => "_rows",
            _ => "_std430",
        };
        let twin = match self.interface.struct_copies.get(&key) {
            Some(twin) => twin.clone(),
            None => {
                let twin = self.interface.fresh(&format!("{name}{ending}"));
                self.interface
                    .struct_copies
                    .insert(key.clone(), twin.clone());
                twin
            }
        };
        if self.stage.structs.get(&twin).is_some() {
            return;
        }
        let inner = self.stage.structs.member_lay(name, lay);
        let members = own.members.into_iter().map(|m| GlslMember {
            ty: self.shape(&m.ty, inner),
            ..m
        });
        let members = members.collect();
        self.stage.structs.insert(Struct {
            name: twin,
            members,
            in_uniform_block: own.in_uniform_block && !key.2,
            tight: key.2,
        });
    }

    /// Converts an expression from its stored type to a value.
    pub(super) fn value(&self, ex: Ex) -> Ex {
        if !self.stage.structs.is_converted(&ex.ty, ex.lay) {
            return Ex {
                lay: MemoryLayout::default(),
                ..ex
            };
        }
        let text = ex.at(level::POSTFIX);
        match &ex.ty {
            Ty::Scalar(Component::Bool) => Ex::new(format!("{text} != 0u"), Ty::BOOL, 10),
            Ty::Vector(Component::Bool, n) => {
                Ex::primary(format!("notEqual({text}, uvec{n}(0u))"), ex.ty.clone())
            }
            Ty::Matrix(..) => {
                let turned = ex.lay.turned(&ex.ty);
                let inner = match ex.lay.stored(&turned) {
                    // Declared as an array of columns.
                    Ty::Array(_, Some(columns)) => {
                        let ending = if ex.lay.is_padded() { ".xy" } else { "" };
                        let columns: Vec<String> = (0..columns.n)
                            .map(|c| format!("{text}[{c}]{ending}"))
                            .collect();
                        format!("{}({})", turned.name(), columns.join(", "))
                    }
                    _ => ex.text.clone(),
                };
                match ex.lay.rows {
                    true => Ex::primary(format!("transpose({inner})"), ex.ty),
                    false => Ex::primary(inner, ex.ty),
                }
            }
            Ty::Array(_, Some(n)) => {
                let parts: Vec<String> = (0..n.n)
                    .map(|i| self.value(element(&ex, &i.to_string())))
                    .map(|part| part.at(level::ASSIGNMENT))
                    .collect();
                Ex::primary(format!("{}({})", ex.ty.name(), parts.join(", ")), ex.ty)
            }
            Ty::Struct(name) => {
                let lay = self.stage.structs.member_lay(name, ex.lay);
                let own = self.stage.structs.member_lay(name, MemoryLayout::default());
                let parts = self.members_of(name, |member| {
                    let mut part = Ex::new(
                        format!("{text}.{}", member.name),
                        member.ty.clone(),
                        level::POSTFIX,
                    );
                    part.lay = lay;
                    self.packed(&self.value(part), &member.ty, own)
                });
                match parts {
                    Some(parts) => {
                        Ex::primary(format!("{name}({})", parts.join(", ")), ex.ty.clone())
                    }
                    None => ex,
                }
            }
            _ => ex,
        }
    }

    /// A struct constructor: `part` for each member, zeros for padding.
    fn members_of(
        &self,
        name: &str,
        part: impl Fn(&GlslMember) -> Option<String>,
    ) -> Option<Vec<String>> {
        let of = self.stage.structs.get(name)?;
        let entries = match of.in_uniform_block {
            true => self.stage.structs.laid_out(&of.members, true),
            false => of.members.iter().map(BlockEntry::Member).collect(),
        };
        entries
            .into_iter()
            .map(|entry| match entry {
                BlockEntry::Member(member) => part(member),
                BlockEntry::Padding => Some("0.0".to_owned()),
            })
            .collect()
    }

    /// Converts a value to its stored type in an expression that repeats the value. `None` where no
    /// expression can, for struct copies and row-major matrices.
    pub(super) fn packed(&self, value: &Ex, ty: &Ty, lay: MemoryLayout) -> Option<String> {
        if !self.stage.structs.is_converted(ty, lay) {
            return Some(value.at(level::ASSIGNMENT));
        }
        let text = value.at(level::POSTFIX);
        Some(match ty {
            Ty::Scalar(Component::Bool) => format!("uint({})", value.text),
            Ty::Vector(Component::Bool, n) => format!("uvec{n}({})", value.text),
            Ty::Matrix(..) => {
                let turned = match lay.rows {
                    true => format!("transpose({})", value.text),
                    false => text,
                };
                match lay.stored(&lay.turned(ty)) {
                    Ty::Array(of, Some(columns)) => {
                        let column = |c: u32| match lay.is_padded() {
                            true => format!("vec4({turned}[{c}], 0.0, 0.0)"),
                            false => format!("{turned}[{c}]"),
                        };
                        let parts: Vec<String> = (0..columns.n).map(column).collect();
                        let of = Ty::Array(of, Some(columns)).name();
                        format!("{of}({})", parts.join(", "))
                    }
                    _ => turned,
                }
            }
            Ty::Array(of, Some(n)) => {
                let zeros = match (&**of, lay.is_padded()) {
                    (Ty::Scalar(_), true) => ", 0, 0, 0",
                    (Ty::Vector(_, 2), true) => ", 0, 0",
                    _ => "",
                };
                let whole = self.stored_as(ty, lay);
                let Ty::Array(element, _) = &whole else {
                    return None;
                };
                let parts: Option<Vec<String>> = (0..n.n)
                    .map(|i| {
                        if !zeros.is_empty() {
                            return Some(format!("{}({text}[{i}]{zeros})", element.name()));
                        }
                        let part = Ex::new(format!("{text}[{i}]"), (**of).clone(), level::POSTFIX);
                        self.packed(&part, of, lay)
                    })
                    .collect();
                format!("{}({})", whole.name(), parts?.join(", "))
            }
            Ty::Struct(name) => {
                let inner = self.stage.structs.member_lay(name, lay);
                let own = self.stage.structs.member_lay(name, MemoryLayout::default());
                let twin = self.stored_as(ty, lay).name();
                let plain = self.stage.structs.get(name)?;
                let parts = self.members_of(&twin, |member| {
                    let member = plain.members.iter().find(|m| m.name == member.name)?;
                    let mut part = Ex::new(
                        format!("{text}.{}", member.name),
                        member.ty.clone(),
                        level::POSTFIX,
                    );
                    part.lay = own;
                    self.packed(&self.value(part), &member.ty, inner)
                });
                format!("{twin}({})", parts?.join(", "))
            }
            _ => return None,
        })
    }

    /// Whether naga can assign to it with the author's operator.
    pub(super) fn is_plain(&self, target: &Ex) -> bool {
        target.parts.is_none() && !self.stage.structs.is_converted(&target.ty, target.lay)
    }

    /// Assigns `value` to a target by parts. Repeats the value.
    pub(super) fn stores(
        &mut self,
        target: &Ex,
        value: &Ex,
        place: Option<Span>,
    ) -> Result<Vec<String>, Error> {
        if let Some(parts) = &target.parts {
            let (first, value) = match is_name(&value.text) {
                true => (None, value.clone()),
                false => self.hold(value, place)?,
            };
            let text = value.at(level::POSTFIX);
            let each = parts.iter().zip("xyzw".chars());
            let stores = each.map(|(part, c)| format!("{part} = {text}.{c}"));
            return Ok(first.into_iter().chain(stores).collect());
        }
        if !self.stage.structs.is_converted(&target.ty, target.lay) {
            let text = format!(
                "{} = {}",
                target.at(level::UNARY),
                value.at(level::ASSIGNMENT)
            );
            return Ok(vec![text]);
        }
        if target.lay.is_std430() && matches!(target.ty.innermost(), Ty::Struct(_)) {
            return self.stores_apart(target, value, place);
        }
        let (first, value) = self.once(value);
        let packed = self.packed(&value, &target.ty, target.lay).ok_or_else(|| {
            unsupported("this part of a block cannot be assigned as a whole", place)
                .note("assign its members one by one")
        })?;
        let store = format!("{} = {packed}", target.at(level::UNARY));
        Ok(first.into_iter().chain([store]).collect())
    }

    /// Assigns by member and element: for naga, a storage block's struct and its constructor's type
    /// differ.
    fn stores_apart(
        &mut self,
        target: &Ex,
        value: &Ex,
        place: Option<Span>,
    ) -> Result<Vec<String>, Error> {
        let mut all = Vec::new();
        match &target.ty {
            Ty::Struct(name) => {
                let members = self.stage.structs.get(name).map(|s| s.members.clone());
                for member in members.unwrap_or_default() {
                    let part = |of: &Ex, lay| {
                        let text = format!("{}.{}", of.at(level::POSTFIX), member.name);
                        let mut part = Ex::new(text, member.ty.clone(), level::POSTFIX);
                        part.lay = lay;
                        part
                    };
                    let structs = &self.stage.structs;
                    let to = part(target, structs.member_lay(name, target.lay));
                    let from = part(value, structs.member_lay(name, MemoryLayout::default()));
                    let from = self.value(from);
                    all.extend(self.stores(&to, &from, place)?);
                }
            }
            Ty::Array(_, Some(n)) => {
                for i in 0..n.n {
                    let i = i.to_string();
                    all.extend(self.stores(&element(target, &i), &element(value, &i), place)?);
                }
            }
            _ => {
                return Err(unsupported(
                    "this part of a block cannot be assigned as a whole",
                    place,
                )
                .note("assign its elements one by one"));
            }
        }
        Ok(all)
    }

    /// Rejects targets that cannot be assigned to.
    pub(super) fn check_written(&self, target: &Expr) -> Result<(), Error> {
        let (name, fixed) = match &target.content {
            ExprData::Variable(name) => {
                let own = name
                    .as_str()
                    .starts_with("gl_")
                    .then(|| match name.as_str() {
                        "gl_Position" | "gl_PointSize" | "gl_FragDepth" | "gl_FragDepthEXT"
                        | "gl_FragColor" | "gl_FragData" | "gl_SampleMask" | "gl_ClipDistance"
                        | "gl_CullDistance" => None,
                        _ => Some("GLSL's own"),
                    });
                if own.flatten().is_some() {
                    unsupported::refuse(name.as_str(), self.place(target.span))?;
                }
                let fixed = self.lookup(name.as_str()).and_then(|v| v.fixed);
                (name.as_str().to_owned(), own.flatten().or(fixed))
            }
            ExprData::Dot(of, member) => {
                let block = match &of.content {
                    ExprData::Variable(block) if self.lookup(block.as_str()).is_none() => {
                        format!("{}.{}", block.as_str(), member.as_str())
                    }
                    _ => return self.check_written(of),
                };
                let fixed = self.lookup(&block).and_then(|v| v.fixed);
                (block, fixed)
            }
            ExprData::Bracket(of, _) => return self.check_written(of),
            _ => {
                return Err(Error::new(Code::Parse, "this cannot be assigned to")
                    .label_if(self.place(target.span)));
            }
        };
        match fixed {
            None => Ok(()),
            Some(what) => Err(Error::new(
                Code::Parse,
                format!("`{name}` is {what} and cannot be assigned to"),
            )
            .label_if(self.place(target.span))),
        }
    }

    /// Holds a value in a temporary, and returns the assignment.
    fn hold(&mut self, value: &Ex, place: Option<Span>) -> Result<(Option<String>, Ex), Error> {
        let name = self.needed(&value.ty, place)?;
        let first = format!("{name} = {}", value.at(level::ASSIGNMENT));
        Ok((Some(first), Ex::primary(name, value.ty.clone())))
    }

    /// A temporary; an error if none can be declared here.
    pub(super) fn needed(&mut self, ty: &Ty, place: Option<Span>) -> Result<String, Error> {
        self.temporary(ty).ok_or_else(|| {
            unsupported("this must be in a function", place).note("move it to the start of `main`")
        })
    }

    /// `to = from`, `to += from` and so on.
    pub(super) fn assignment(&mut self, to: &Expr, word: &str, from: &Expr) -> Result<Ex, Error> {
        let place = self.place(to.span);
        self.check_written(to)?;
        let is_changed = word != "=" && self.may_change(from, to);
        // naga reads and writes the target by separate evaluations.
        let once = word == "=" && (!self.has_effect(to) || self.look(to)?.is_plain);
        let mut all = match (once, is_changed) {
            (true, _) => Vec::new(),
            (false, false) => self.settle(to)?,
            (false, true) => self.settle_where(to, &|_, index| !is_literal(index))?,
        };
        let target = self.raw(to)?;
        let plain = self.is_plain(&target);
        let (of, from) = (self.place(from.span), self.expr(from)?);
        match compound(word) {
            None => self.check_given(&from.ty, &target.ty, of)?,
            Some(op) => self.check_operator(&op, word, [&target.ty, &from.ty], place)?,
        }
        let from = match word {
            "=" => self.coerce(from, &target.ty),
            "<<=" | ">>=" => from,
            "%=" => splat(self.coerce_kind(from, target.ty.kind()), &target.ty),
            _ => self.coerce_kind(from, target.ty.kind()),
        };
        let (hidden, from) = match compound(word) {
            Some(op) => {
                let of = Ex::new("", target.ty.clone(), level::PRIMARY);
                let (hidden, from, _) = self.operand_to_fold(&op, &of, from);
                (hidden, from)
            }
            None => (None, from),
        };
        all.extend(hidden);
        // The target is read when the value is known; naga reads it first.
        let (first, from) = match is_changed && !matches!(from.ty, Ty::Unknown) {
            true => self.hold(&from, of)?,
            false => (None, from),
        };
        all.extend(first);
        if plain {
            let folds = match word {
                "=" => from.folds.clone(),
                _ => Folds::No,
            };
            let text = format!(
                "{} {word} {}",
                target.at(level::UNARY),
                from.at(level::ASSIGNMENT)
            );
            let ex = Ex::new(text, target.ty, level::ASSIGNMENT);
            return Ok(after(all, ex.folding(folds)));
        }
        let value = match word {
            "=" => from,
            _ => {
                let held = self.needed(&target.ty, place)?;
                let before = self.value(target.clone());
                all.push(format!("{held} = {}", before.at(level::ASSIGNMENT)));
                all.push(format!("{held} {word} {}", from.at(level::ASSIGNMENT)));
                Ex::primary(held, target.ty.clone())
            }
        };
        let (first, value) = match is_name(&value.text) {
            true => (None, value),
            false => self.hold(&value, place)?,
        };
        all.extend(first);
        all.extend(self.stores(&target, &value, place)?);
        Ok(after(all, value))
    }

    /// `x++`, `--x`.
    pub(super) fn stepped(&mut self, of: &Expr, word: &str, postfix: bool) -> Result<Ex, Error> {
        let place = self.place(of.span);
        self.check_written(of)?;
        let mut all = self.settle(of)?;
        let target = self.raw(of)?;
        if self.is_plain(&target) {
            let (text, level) = match postfix {
                true => (
                    format!("{}{word}", target.at(level::POSTFIX)),
                    level::POSTFIX,
                ),
                false => (format!("{word}{}", target.at(level::UNARY)), level::UNARY),
            };
            return Ok(after(all, Ex::new(text, target.ty, level)));
        }
        let before = self.value(target.clone());
        let (first, old) = self.hold(&before, place)?;
        all.extend(first);
        let new = match postfix {
            true => {
                let (first, new) = self.hold(&old, place)?;
                all.extend(first);
                new
            }
            false => old.clone(),
        };
        all.push(format!("{}{word}", new.text));
        all.extend(self.stores(&target, &new, place)?);
        Ok(after(all, old))
    }

    /// An element of an array, a column, or a component.
    pub(super) fn element_of(&self, base: Ex, index: &str) -> Ex {
        let scalar = || Ty::Scalar(base.ty.kind().unwrap_or(Component::Float));
        if let Some((of, numbers)) = base.swizzle {
            let number = unmarked(index).trim().parse().ok();
            let index = match number.and_then(|n: usize| numbers.get(n)) {
                Some(n) => n.to_string(),
                None => {
                    let all: Vec<String> = numbers.iter().map(usize::to_string).collect();
                    format!("ivec{}({})[{index}]", all.len(), all.join(", "))
                }
            };
            return self.element_of(*of, &index);
        }
        if let Some((matrix, column)) = &base.turned {
            let text = format!("{matrix}[{index}][{column}]");
            return Ex::new(text, scalar(), level::POSTFIX);
        }
        match base.ty {
            Ty::Matrix(_, _, rows) if base.lay.rows => {
                let matrix = base.at(level::POSTFIX);
                let parts = (0..rows).map(|r| format!("{matrix}[{r}][{index}]"));
                let parts = parts.collect();
                let mut ex = element(&self.value(base), index);
                ex.parts = Some(parts);
                ex.turned = Some((matrix, index.to_owned()));
                ex
            }
            Ty::Vector(..) if base.lay.is_padded() => {
                let mut base = base;
                base.text = of_four(&base.text).to_owned();
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
            Error::new(
                Code::Parse,
                format!("a {} has no components `{name}`", base.ty.name()),
            )
            .label_if(place)
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
        let text = base.at(level::POSTFIX);
        let text = match base.lay.is_padded() {
            true => of_four(&text),
            false => &text,
        };
        let ty = Ty::vector(kind, numbers.len() as u8);
        let part = |number: &usize| match &base.parts {
            Some(parts) => parts.get(*number).cloned().unwrap_or_default(),
            None => format!("{text}[{number}]"),
        };
        let mut ex = match (&numbers[..], &of.content) {
            // naga assigns to a component of a column only by index.
            ([number], ExprData::Bracket(..)) => Ex::new(part(number), ty, level::POSTFIX),
            ([number], _) if base.parts.is_some() => Ex::new(part(number), ty, level::POSTFIX),
            _ => Ex::new(format!("{text}.{name}"), ty, level::POSTFIX),
        };
        if numbers.len() > 1 && (base.column || base.parts.is_some()) {
            ex.parts = Some(numbers.iter().map(part).collect());
        }
        ex.lay = lay;
        if numbers.len() > 1 {
            ex.swizzle = Some((Box::new(base), numbers));
        }
        Ok(ex)
    }
}

/// The four-component vector of which `text` reads two.
fn of_four(text: &str) -> &str {
    text.strip_suffix(".xy").unwrap_or(text)
}

/// The component indices of a swizzle; `None` if it is invalid for a vector of `module_size`.
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
