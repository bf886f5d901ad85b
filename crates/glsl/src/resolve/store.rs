//! Reads and writes values whose stored type differs: padded arrays, `bool`s, row-major matrices,
//! and structs of these. Also writes targets component by component if the IR has no pointer to
//! them.

use glsl_lang::ast::{AssignmentOpData, BinaryOpData, Expr, ExprData};
use naga::{BinaryOperator, MathFunction, Span};

use super::Resolver;
use super::access::element;
use super::effect::{after, is_literal};
use super::expression::{Ex, compound, operator, result, splat};
use super::fold::Folds;
use crate::errors::{unsupported, wrong};
use crate::functions::Meaning;
use crate::layout::{BlockEntry, MemoryLayout, padded_size};
use crate::tree::{Kind, Node};
use crate::ty::{Component, GlslMember, Struct, Ty};
use shader_text::error::Error;
use shader_text::unsupported;

impl Resolver<'_, '_> {
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
            is_hosted: own.is_hosted && !key.2,
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
        let node = &ex.node;
        let value = |node: Node| Ex::new(node, ex.ty.clone());
        match &ex.ty {
            Ty::Scalar(Component::Bool) => value(Node::binary(
                BinaryOperator::NotEqual,
                node.clone(),
                Node::uint(0),
            )),
            Ty::Vector(Component::Bool, n) => {
                let zero = Node::convert(&Ty::Vector(Component::Uint, *n), Node::uint(0));
                value(Node::built_in(
                    Meaning::Operator(BinaryOperator::NotEqual),
                    vec![node.clone(), zero],
                ))
            }
            Ty::Matrix(..) => {
                let turned = ex.lay.turned(&ex.ty);
                let inner = match ex.lay.stored(&turned) {
                    // It is declared as an array of columns.
                    Ty::Array(_, Some(columns)) => {
                        let column = |c: u32| match ex.lay.is_padded() {
                            true => node.nth(c).swizzle([0, 1]),
                            false => node.nth(c),
                        };
                        Node::construct(&turned, (0..columns.n).map(column).collect())
                    }
                    _ => node.clone(),
                };
                match ex.lay.rows {
                    true => value(Node::math(MathFunction::Transpose, vec![inner])),
                    false => value(inner),
                }
            }
            Ty::Array(_, Some(n)) => {
                let part = |i: u32| self.value(element(&ex, &Node::int(i as i32))).node;
                value(Node::construct(&ex.ty, (0..n.n).map(part).collect()))
            }
            Ty::Struct(name) => {
                let lay = self.stage.structs.member_lay(name, ex.lay);
                let own = self.stage.structs.member_lay(name, MemoryLayout::default());
                let parts = self.members_of(name, |member| {
                    let mut part = Ex::new(node.field(member.name.as_str()), member.ty.clone());
                    part.lay = lay;
                    self.packed(&self.value(part), &member.ty, own)
                });
                match parts {
                    Some(parts) => value(Node::construct(&ex.ty, parts)),
                    None => ex,
                }
            }
            _ => ex,
        }
    }

    /// The scalars and vectors of a value, in the order of `Structs::leaf_paths`, in their stored
    /// types.
    pub(super) fn leaves(&self, ex: Ex) -> Vec<Ex> {
        let elements = |n: u32| {
            let nth = |i: u32| self.leaves(element(&ex, &Node::int(i as i32)));
            (0..n).flat_map(nth).collect()
        };
        match &ex.ty {
            Ty::Array(_, n) => elements(n.map_or(0, |length| length.n)),
            Ty::Matrix(_, columns, _) => elements(u32::from(*columns)),
            Ty::Struct(name) => {
                let members = self.stage.structs.get(name).into_iter();
                let member = |m: &GlslMember| {
                    let mut part = Ex::new(ex.node.field(m.name.as_str()), m.ty.clone());
                    part.lay = self.stage.structs.member_lay(name, ex.lay);
                    self.leaves(part)
                };
                members.flat_map(|s| &s.members).flat_map(member).collect()
            }
            _ => vec![ex],
        }
    }

    /// The parts of a struct constructor: `part` for each member, zeros for padding.
    fn members_of(
        &self,
        name: &str,
        part: impl Fn(&GlslMember) -> Option<Node>,
    ) -> Option<Vec<Node>> {
        let of = self.stage.structs.get(name)?;
        let entries = self.stage.structs.entries(of).into_iter();
        entries
            .map(|entry| match entry {
                BlockEntry::Member(member) => part(member),
                BlockEntry::Padding => Some(Node::float(0.0)),
            })
            .collect()
    }

    /// Converts a value to its stored type with an expression that repeats the value. `None` for
    /// struct copies and row-major matrices, which need statements.
    pub(super) fn packed(&self, value: &Ex, ty: &Ty, lay: MemoryLayout) -> Option<Node> {
        let node = &value.node;
        if !self.stage.structs.is_converted(ty, lay) {
            return Some(node.clone());
        }
        Some(match ty {
            Ty::Scalar(Component::Bool) | Ty::Vector(Component::Bool, _) => {
                Node::convert(&ty.with_kind(Component::Uint), node.clone())
            }
            Ty::Matrix(..) => {
                let turned = match lay.rows {
                    true => Node::math(MathFunction::Transpose, vec![node.clone()]),
                    false => node.clone(),
                };
                match lay.stored(&lay.turned(ty)) {
                    ref of @ Ty::Array(ref column_ty, Some(columns)) => {
                        let zeros = || [Node::float(0.0), Node::float(0.0)];
                        let column = |c: u32| match lay.is_padded() {
                            true => {
                                let parts = [turned.nth(c)].into_iter().chain(zeros());
                                Node::construct(column_ty, parts.collect())
                            }
                            false => turned.nth(c),
                        };
                        Node::construct(of, (0..columns.n).map(column).collect())
                    }
                    _ => turned,
                }
            }
            Ty::Array(of, Some(n)) => {
                let padding = match padded_size(of).filter(|_| lay.is_padded()) {
                    Some(n) => n - of.components().unwrap_or(1),
                    None => 0,
                };
                let whole = self.stored_as(ty, lay);
                let Ty::Array(element, _) = &whole else {
                    return None;
                };
                let parts: Option<Vec<Node>> = (0..n.n)
                    .map(|i| {
                        if padding > 0 {
                            let zeros = (0..padding).map(|_| Node::int(0));
                            let parts = [node.nth(i)].into_iter().chain(zeros).collect();
                            return Some(Node::construct(element, parts));
                        }
                        self.packed(&Ex::new(node.nth(i), (**of).clone()), of, lay)
                    })
                    .collect();
                Node::construct(&whole, parts?)
            }
            Ty::Struct(name) => {
                let inner = self.stage.structs.member_lay(name, lay);
                let own = self.stage.structs.member_lay(name, MemoryLayout::default());
                let twin = self.stored_as(ty, lay);
                let plain = self.stage.structs.get(name)?;
                let parts = self.members_of(&twin.name(), |member| {
                    let member = plain.members.iter().find(|m| m.name == member.name)?;
                    let mut part = Ex::new(node.field(member.name.as_str()), member.ty.clone());
                    part.lay = own;
                    self.packed(&self.value(part), &member.ty, inner)
                });
                Node::construct(&twin, parts?)
            }
            _ => return None,
        })
    }

    /// Whether the author's assignment operator can be used.
    pub(super) fn is_plain(&self, target: &Ex) -> bool {
        target.parts.is_none() && !self.stage.structs.is_converted(&target.ty, target.lay)
    }

    /// Assigns `value` to a target by parts. Repeats the value.
    pub(super) fn stores(
        &mut self,
        target: &Ex,
        value: &Ex,
        place: Option<Span>,
    ) -> Result<Vec<Node>, Error> {
        if let Some(parts) = &target.parts {
            let (first, value) = match value.node.is_name() {
                true => (None, value.clone()),
                false => self.hold(value, place)?,
            };
            let each = parts.iter().zip(0..);
            let stores = each.map(|(part, c)| Node::assign(part, value.node.component(c)));
            return Ok(first.into_iter().chain(stores).collect());
        }
        if !self.stage.structs.is_converted(&target.ty, target.lay) {
            return Ok(vec![Node::assign(&target.node, value.node.clone())]);
        }
        if target.lay.is_std430() && matches!(target.ty.innermost(), Ty::Struct(_)) {
            return self.stores_apart(target, value, place);
        }
        let (first, value) = self.once(value);
        let packed = self.packed(&value, &target.ty, target.lay).ok_or_else(|| {
            unsupported("this part of a block cannot be assigned as a whole", place)
                .note("assign its members one by one")
        })?;
        let store = Node::assign(&target.node, packed);
        Ok(first.into_iter().chain([store]).collect())
    }

    /// Assigns each member and element separately: a storage block's struct and the author's are
    /// distinct types.
    fn stores_apart(
        &mut self,
        target: &Ex,
        value: &Ex,
        place: Option<Span>,
    ) -> Result<Vec<Node>, Error> {
        let mut all = Vec::new();
        match &target.ty {
            Ty::Struct(name) => {
                let members = self.stage.structs.get(name).map(|s| s.members.clone());
                for member in members.unwrap_or_default() {
                    let part = |of: &Ex, lay| {
                        let node = of.node.field(member.name.as_str());
                        let mut part = Ex::new(node, member.ty.clone());
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
                    let i = Node::int(i as i32);
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
                return Err(wrong("this cannot be assigned to", self.place(target.span)));
            }
        };
        match fixed {
            None => Ok(()),
            Some(what) => Err(wrong(
                format!("`{name}` is {what} and cannot be assigned to"),
                self.place(target.span),
            )),
        }
    }

    /// Rejects swizzles that name a component twice.
    pub(super) fn check_swizzle(&self, target: &Ex, place: Option<Span>) -> Result<(), Error> {
        let numbers = target
            .swizzle
            .as_ref()
            .map_or(&[][..], |(_, numbers)| numbers);
        match (1..numbers.len()).any(|i| numbers[i..].contains(&numbers[i - 1])) {
            true => Err(wrong("a component appears twice", place)),
            false => Ok(()),
        }
    }

    /// Stores a value in a temporary, and returns the assignment.
    fn hold(&mut self, value: &Ex, place: Option<Span>) -> Result<(Option<Node>, Ex), Error> {
        let held = self.needed(&value.ty, place)?;
        let first = Node::assign(&held, value.node.clone());
        Ok((Some(first), Ex::new(held, value.ty.clone())))
    }

    /// A temporary. An error if none can be declared here.
    pub(super) fn needed(&mut self, ty: &Ty, place: Option<Span>) -> Result<Node, Error> {
        self.temporary(ty).ok_or_else(|| {
            unsupported("this must be in a function", place).note("move it to the start of `main`")
        })
    }

    /// `to = from`, `to += from` and so on.
    pub(super) fn assignment(
        &mut self,
        to: &Expr,
        op: &AssignmentOpData,
        from: &Expr,
    ) -> Result<Ex, Error> {
        let place = self.place(to.span);
        let op = compound(op);
        self.check_written(to)?;
        // The target is read and written in separate evaluations, or stored in parts.
        let once = op.is_none() && self.look(to)?.is_plain;
        let is_changed = !once && self.may_change(from, to);
        let mut all = match (once, is_changed) {
            (true, _) => Vec::new(),
            (false, false) => self.settle(to)?,
            (false, true) => self.settle_where(to, &|_, index| !is_literal(index))?,
        };
        let target = self.raw(to)?;
        self.check_swizzle(&target, place)?;
        let plain = self.is_plain(&target);
        let (of, from) = (self.place(from.span), self.expr(from)?);
        match &op {
            None => self.check_given(&from.ty, &target.ty, of)?,
            Some(op) => {
                let word = format!("{}=", operator(op).0);
                self.check_operator(op, &word, [&target.ty, &from.ty], place)?;
                self.check_given(&result(op, &target.ty, &from.ty), &target.ty, of)?;
            }
        }
        let from = match op {
            None => self.coerce(from, &target.ty),
            Some(BinaryOpData::LShift | BinaryOpData::RShift) => from,
            Some(BinaryOpData::Mod) => splat(self.coerce_kind(from, target.ty.kind()), &target.ty),
            Some(_) => self.coerce_kind(from, target.ty.kind()),
        };
        let (hidden, from) = match &op {
            Some(op) => {
                let of = Ex::new(target.node.clone(), target.ty.clone());
                let (hidden, from, _) = self.operand_to_fold(op, &of, from);
                (hidden, from)
            }
            None => (None, from),
        };
        all.extend(hidden);
        // The target is read after the value is computed.
        let (first, from) = match is_changed {
            true => self.hold(&from, of)?,
            false => (None, from),
        };
        all.extend(first);
        let changed = |to: &Node, from: &Ex| {
            let value = match &op {
                Some(op) => Node::binary(operator(op).1, to.clone(), from.node.clone()),
                None => from.node.clone(),
            };
            Node::assign(to, value)
        };
        if plain {
            let folds = match op {
                None => from.folds.clone(),
                Some(_) => Folds::No,
            };
            let ex = Ex::new(changed(&target.node, &from), target.ty);
            return Ok(after(all, ex.folding(folds)));
        }
        let value = match op {
            None => from,
            Some(_) => {
                let held = self.needed(&target.ty, place)?;
                let before = self.value(target.clone());
                all.push(Node::assign(&held, before.node));
                all.push(changed(&held, &from));
                Ex::new(held, target.ty.clone())
            }
        };
        let (first, value) = match value.node.is_name() {
            true => (None, value),
            false => self.hold(&value, place)?,
        };
        all.extend(first);
        all.extend(self.stores(&target, &value, place)?);
        Ok(after(all, value))
    }

    /// `x++`, `--x` and the like.
    pub(super) fn stepped(
        &mut self,
        of: &Expr,
        op: BinaryOperator,
        postfix: bool,
    ) -> Result<Ex, Error> {
        let place = self.place(of.span);
        self.check_written(of)?;
        let mut all = self.settle(of)?;
        let target = self.raw(of)?;
        self.check_stepped(&target.ty, place)?;
        self.check_swizzle(&target, place)?;
        let step = |of: Node, postfix| Node::new(Kind::Step { op, postfix, of });
        if self.is_plain(&target) {
            return Ok(after(all, Ex::new(step(target.node, postfix), target.ty)));
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
        all.push(step(new.node.clone(), postfix));
        all.extend(self.stores(&target, &new, place)?);
        Ok(after(all, old))
    }
}
