//! Calls of functions of the module.

use naga::proc::ExpressionKind;
use naga::{AddressSpace, Expression, Handle, Span, Statement, Type, TypeInner};

use super::{Body, refused};
use crate::tree::{FunctionId, Node};
use shader_text::error::Error;

/// A store after a call, of what it left in a variable.
struct Written {
    to: Handle<Expression>,
    from: Handle<Expression>,
}

impl<'s> Body<'_, 's> {
    pub(super) fn call(
        &mut self,
        id: FunctionId,
        arguments: &'s [Node],
        span: Span,
    ) -> Result<Option<Handle<Expression>>, Error> {
        let stage = self.builder.stage;
        let callee = stage.functions.get(id.0).and_then(Option::as_ref);
        let handle = self.builder.functions.get(&id).copied();
        let (Some(callee), Some(function)) = (callee, handle) else {
            return Err(refused(
                "this function is not defined before its call",
                span,
            ));
        };
        let mut given = Vec::new();
        for (argument, parameter) in arguments.iter().zip(&callee.parameters) {
            given.push(match parameter.is_out {
                true => None,
                false => Some(self.value(argument)?),
            });
        }
        let (mut values, mut written) = (Vec::new(), Vec::new());
        for ((argument, given), parameter) in arguments.iter().zip(given).zip(&callee.parameters) {
            values.push(match given {
                Some(value) => value,
                None => self.out_argument(argument, parameter.is_in, &mut written, span)?,
            });
        }
        let has_result = self.builder.module.functions[function].result.is_some();
        self.writer.flush(span);
        let result = has_result.then(|| {
            let result = self.writer.append(Expression::CallResult(function), span);
            self.known.insert(result, ExpressionKind::Runtime);
            result
        });
        let call = Statement::Call {
            function,
            arguments: values,
            result,
        };
        self.writer.statement(call, span);
        for Written { to, from } in written {
            let value = self.add(Expression::Load { pointer: from }, span)?;
            let store = Statement::Store { pointer: to, value };
            self.writer.statement(store, span);
        }
        Ok(result)
    }

    /// The pointer that the call writes. The IR's functions only take pointers to local variables,
    /// so that others are copied before and after.
    fn out_argument(
        &mut self,
        argument: &'s Node,
        is_in: bool,
        written: &mut Vec<Written>,
        span: Span,
    ) -> Result<Handle<Expression>, Error> {
        let target = self.target(argument)?;
        let Some(ty) = self.ty_to_copy(target)? else {
            return Ok(target);
        };
        let value = match is_in {
            true => Some(self.add(Expression::Load { pointer: target }, span)?),
            false => None,
        };
        let copy = self.local(None, ty, None, span)?;
        if let Some(value) = value {
            let store = Statement::Store {
                pointer: copy,
                value,
            };
            self.writer.statement(store, span);
        }
        written.push(Written {
            to: target,
            from: copy,
        });
        Ok(copy)
    }

    /// The type of the copy that a target needs.
    fn ty_to_copy(&mut self, target: Handle<Expression>) -> Result<Option<Handle<Type>>, Error> {
        Ok(match *self.ty(target)? {
            TypeInner::Pointer { base, space } if space != AddressSpace::Function => Some(base),
            TypeInner::ValuePointer {
                size,
                scalar,
                space,
            } if space != AddressSpace::Function => Some(self.builder.insert(match size {
                Some(size) => TypeInner::Vector { size, scalar },
                None => TypeInner::Scalar(scalar),
            })),
            _ => None,
        })
    }
}
