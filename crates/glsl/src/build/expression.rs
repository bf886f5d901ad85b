//! Expressions: variables, members, conditionals and stores.

use naga::{
    AddressSpace, Expression, Handle, Literal, LocalVariable, Span, Statement, SwizzleComponent,
    Type, TypeInner,
};

use super::types::size;
use super::{Body, Declared, Value, refused};
use crate::tree::{GlobalId, Kind, Node};
use shader_text::error::Error;

/// The purpose of an expression's evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Position {
    Value,
    /// The pointer for a store.
    Target,
    /// The base of an element or member access. `constant`: whether the index is constant.
    Base {
        constant: bool,
    },
}

impl Position {
    /// The position of an index's base.
    fn of_base(self, constant: bool) -> Self {
        match self {
            Self::Target | Self::Base { constant: false } => self,
            _ => Self::Base { constant },
        }
    }

    /// Whether the position needs a pointer. Others accept a value.
    fn is_target(self) -> bool {
        self == Self::Target
    }
}

impl<'s> Body<'_, 's> {
    pub(super) fn value(&mut self, node: &'s Node) -> Result<Value, Error> {
        self.expect(node, Position::Value)
    }

    /// Evaluates an expression to a pointer.
    pub(super) fn target(&mut self, node: &'s Node) -> Result<Value, Error> {
        self.expect(node, Position::Target)
    }

    fn expect(&mut self, node: &'s Node, at: Position) -> Result<Value, Error> {
        let span = self.place(node);
        self.evaluate(node, at)?
            .ok_or_else(|| refused("this returns nothing, but a value is expected", span))
    }

    /// The span of a node, or of the enclosing node.
    pub(super) fn place(&self, node: &Node) -> Span {
        match node.span.is_defined() {
            true => node.span,
            false => self.span,
        }
    }

    /// Evaluates an expression that may have no value.
    pub(super) fn evaluate(
        &mut self,
        node: &'s Node,
        at: Position,
    ) -> Result<Option<Value>, Error> {
        let span = self.place(node);
        let around = std::mem::replace(&mut self.span, span);
        let evaluated = self.evaluate_at(node, at);
        self.span = around;
        evaluated
    }

    fn evaluate_at(&mut self, node: &'s Node, at: Position) -> Result<Option<Value>, Error> {
        let found = match &*node.kind {
            Kind::Local(id) => {
                let local = self.locals.get(id).copied();
                let local = local.ok_or_else(|| self.refused("this is not declared"))?;
                self.read(local, true, at)?
            }
            Kind::Parameter(i) => {
                let (e, is_pointer) = self.parameters[*i];
                self.read(e, is_pointer, at)?
            }
            Kind::Global(id) => self.global(*id, at)?,
            Kind::BuiltIn(own) => {
                let pointer = self.own.get(own.first_name()).copied();
                let pointer = pointer.ok_or_else(|| self.refused("this must be in a function"))?;
                self.read(pointer, true, at)?
            }
            Kind::Element(base, index) => self.element(base, index, at)?,
            Kind::Field(base, name) => self.field(base, name, at)?,
            Kind::Swizzle(base, components) => self.swizzle(base, components, at)?,
            _ if at.is_target() => return Err(self.refused("this cannot be assigned to")),
            Kind::Literal(literal) => self.literal(*literal)?,
            Kind::Unary(op, of) => {
                let of = self.value(of)?;
                self.unary(*op, of)?
            }
            Kind::Binary(op, a, b) => {
                let (a, b) = (self.value(a)?, self.value(b)?);
                self.binary(*op, a, b)?
            }
            Kind::Choose(condition, accept, reject) => self.choose(condition, accept, reject)?,
            Kind::Assign(to, value) => {
                let pointer = self.target(to)?;
                let value = self.value(value)?;
                self.store(pointer, value)?;
                value
            }
            Kind::Step { op, postfix, of } => self.step(*op, *postfix, of)?,
            Kind::Construct(ty, parts) => self.construct(ty, parts)?,
            Kind::Combine { .. } => return Err(self.refused("a sampler is no value")),
            Kind::Call(id, arguments) => return self.call(*id, arguments),
            Kind::BuiltInCall(meaning, arguments) => {
                return self.built_in_call(*meaning, arguments);
            }
            Kind::TextureCall(function, arguments) => {
                return self.texture_call(*function, arguments);
            }
            Kind::Length(of) => {
                let array = self.expect(of, Position::Base { constant: true })?;
                let length = self.add(Expression::ArrayLength(array))?;
                self.cast(length, naga::Scalar::I32)?
            }
            Kind::Sequence(all) => {
                let mut last = None;
                for node in all {
                    last = self.evaluate(node, Position::Value)?;
                }
                return Ok(last);
            }
            Kind::Gather(of) => self.gather(of)?,
            Kind::Subgroup {
                of,
                value,
                lane,
                result,
            } => self.subgroup(*of, value, lane.as_ref(), result)?,
            Kind::Atomic { of, target, value } => self.atomic(*of, target, value)?,
            Kind::ImageAtomic {
                of,
                image,
                at,
                value,
            } => {
                self.image_atomic(*of, [image, at, value])?;
                return Ok(None);
            }
        };
        Ok(Some(found))
    }

    /// Loads a variable, unless its pointer is needed.
    fn read(&mut self, e: Value, is_pointer: bool, at: Position) -> Result<Value, Error> {
        match at {
            Position::Value if is_pointer => self.load(e),
            _ => Ok(e),
        }
    }

    fn global(&mut self, id: GlobalId, at: Position) -> Result<Value, Error> {
        let declared = self.builder.globals.get(&id).copied();
        let declared = declared.ok_or_else(|| self.refused("this is not declared"))?;
        match declared {
            Declared::Constant(constant, _) if self.is_const => {
                return self.add(Expression::Constant(constant));
            }
            Declared::Override(of) if self.is_const => {
                return self.add(Expression::Override(of));
            }
            // A dynamic index needs a pointer, which a constant does not have.
            Declared::Constant(constant, ty) if at == (Position::Base { constant: false }) => {
                let init = self.add_at(Expression::Constant(constant), Span::UNDEFINED)?;
                return self.local(None, ty, Some(init), Span::UNDEFINED);
            }
            _ => {}
        }
        let e = self.globals.get(&id).copied();
        let e = e.ok_or_else(|| self.refused("this must be in a function"))?;
        let is_pointer = match declared {
            Declared::Variable(global) => {
                let space = self.builder.module.global_variables[global].space;
                space != AddressSpace::Handle
            }
            _ => false,
        };
        self.read(e, is_pointer, at)
    }

    /// Adds a local variable, and returns the pointer to it.
    pub(super) fn local(
        &mut self,
        name: Option<String>,
        ty: Handle<Type>,
        init: Option<Value>,
        span: Span,
    ) -> Result<Value, Error> {
        let variable = LocalVariable { name, ty, init };
        let locals = &mut self.writer.function.local_variables;
        let local = locals.append(variable, span);
        self.add_at(Expression::LocalVariable(local), span)
    }

    fn element(&mut self, base: &'s Node, index: &'s Node, at: Position) -> Result<Value, Error> {
        // The base is evaluated first, which matters only if it has effects.
        let first = match base.writes(&|_| true) {
            false => None,
            true => Some(self.expect(base, at.of_base(index.index().is_some()))?),
        };
        let index = self.value(index)?;
        let constant = match at {
            // The pointer leads to a variable in any case.
            Position::Target => None,
            _ => self.constant_index(index),
        };
        let base = match first {
            Some(base) => base,
            None => self.expect(base, at.of_base(constant.is_some()))?,
        };
        let element = match constant {
            Some(index) => Expression::AccessIndex { base, index },
            None => Expression::Access { base, index },
        };
        let pointer = self.add(element)?;
        match at == Position::Value && self.ty(pointer)?.pointer_space().is_some() {
            true => self.load(pointer),
            false => Ok(pointer),
        }
    }

    /// The value of an expression as an index, if it is constant.
    fn constant_index(&self, e: Value) -> Option<u32> {
        let module = &self.builder.module;
        let mut expression = self.expression(e);
        if let Expression::Constant(constant) = expression {
            expression = &module.global_expressions[module.constants[*constant].init];
        }
        match *expression {
            Expression::Literal(Literal::U32(n)) => Some(n),
            Expression::Literal(Literal::I32(n)) => u32::try_from(n).ok(),
            Expression::ZeroValue(_) => Some(0),
            _ => None,
        }
    }

    /// A member, which is loaded without the rest.
    fn field(&mut self, base: &'s Node, name: &'s str, at: Position) -> Result<Value, Error> {
        if let Kind::Global(id) = *base.kind
            && let Some(member) = self.members.get(&(id, name)).copied()
        {
            return self.read(member, true, at);
        }
        let base_at = match at {
            Position::Target => Position::Target,
            _ => Position::Base { constant: true },
        };
        let base = self.expect(base, base_at)?;
        self.resolve(base)?;
        let module = &self.builder.module;
        let (ty, is_pointer) = match *self.known_ty(base) {
            TypeInner::Pointer { base, .. } => (&module.types[base].inner, true),
            ref ty => (ty, false),
        };
        let TypeInner::Struct { members, .. } = ty else {
            return Err(self.refused("this type has no members"));
        };
        let index = members.iter().position(|m| m.name.as_deref() == Some(name));
        let Some(index) = index else {
            return Err(self.refused(&format!("there is no member `{name}`")));
        };
        let member = self.part(base, index as u32)?;
        self.read(member, is_pointer, at)
    }

    fn swizzle(
        &mut self,
        base: &'s Node,
        components: &[u32],
        at: Position,
    ) -> Result<Value, Error> {
        let mut vector = self.expect(base, at)?;
        let mut pattern = [SwizzleComponent::X; 4];
        for (to, component) in pattern.iter_mut().zip(components) {
            *to = SwizzleComponent::XYZW[(*component).min(3) as usize];
        }
        // Combine swizzles of swizzles into one.
        if let Expression::Swizzle {
            vector: inner,
            pattern: chosen,
            ..
        } = *self.expression(vector)
        {
            vector = inner;
            pattern = pattern.map(|component| chosen[component as usize]);
        }
        let is_pointer = self.ty(vector)?.pointer_space().is_some();
        if let [_] = components {
            return self.part(vector, pattern[0] as u32);
        }
        // A store to a swizzle needs the pointer behind the load.
        if is_pointer {
            vector = self.load(vector)?;
        }
        let swizzle = Expression::Swizzle {
            size: size(components.len() as u8),
            vector,
            pattern,
        };
        self.add(swizzle)
    }

    /// An `if` that stores one of two values in a variable.
    fn choose(
        &mut self,
        condition: &'s Node,
        accept: &'s Node,
        reject: &'s Node,
    ) -> Result<Value, Error> {
        let condition = self.value(condition)?;
        let enclosing = self.open();
        let accept_span = self.place(accept);
        let accepted = self.value(accept)?;
        let mut accept = self.close(enclosing);
        let enclosing = self.open();
        let reject_span = self.place(reject);
        let rejected = self.value(reject)?;
        let mut reject = self.close(enclosing);
        let ty = self.ty_handle(accepted)?;
        let pointer = self.local(None, ty, None, self.span)?;
        let store = |value| Statement::Store { pointer, value };
        accept.push(store(accepted), accept_span);
        reject.push(store(rejected), reject_span);
        let choice = Statement::If {
            condition,
            accept,
            reject,
        };
        self.push(choice);
        self.load(pointer)
    }

    pub(super) fn cast(&mut self, value: Value, to: naga::Scalar) -> Result<Value, Error> {
        let cast = Expression::As {
            expr: value,
            kind: to.kind,
            convert: Some(to.width),
        };
        self.add(cast)
    }

    /// Stores a value. Stores to a swizzle component by component.
    pub(super) fn store(&mut self, pointer: Value, value: Value) -> Result<(), Error> {
        let Expression::Swizzle {
            size,
            vector,
            pattern,
        } = *self.expression(pointer)
        else {
            self.store_at(pointer, value);
            return Ok(());
        };
        let vector = match *self.expression(vector) {
            Expression::Load { pointer } => pointer,
            _ => vector,
        };
        for (component, index) in pattern.iter().zip(0..size as u32) {
            let pointer = self.part(vector, *component as u32)?;
            let value = self.part(value, index)?;
            self.store_at(pointer, value);
        }
        Ok(())
    }
}
