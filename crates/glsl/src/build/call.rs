//! Calls of functions of the module.

use naga::{AddressSpace, Expression, Handle, Statement, Type, TypeInner};

use super::{Body, Value};
use crate::tree::{FunctionId, Node};
use shader_text::error::Error;

/// A store after a call, from the variable that it wrote.
struct Written {
    to: Value,
    from: Value,
}

impl<'s> Body<'_, 's> {
    pub(super) fn call(
        &mut self,
        id: FunctionId,
        arguments: &'s [Node],
    ) -> Result<Option<Value>, Error> {
        let stage = self.builder.stage;
        let callee = stage.functions.get(id.0).and_then(Option::as_ref);
        let handle = self.builder.functions.get(&id).copied();
        let (Some(callee), Some(function)) = (callee, handle) else {
            return Err(self.refused("this function is not defined before its call"));
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
                None => self.out_argument(argument, parameter.is_in, &mut written)?,
            });
        }
        let has_result = self.builder.module.functions[function].result.is_some();
        let result = match has_result {
            true => Some(self.unevaluated(Expression::CallResult(function))),
            false => None,
        };
        self.push(Statement::Call {
            function,
            arguments: values,
            result,
        });
        for Written { to, from } in written {
            let value = self.load(from)?;
            self.store_at(to, value);
        }
        Ok(result)
    }

    /// The pointer that the call writes through. Functions of the IR only take pointers to local
    /// variables, so other targets are copied before and after the call.
    fn out_argument(
        &mut self,
        argument: &'s Node,
        is_in: bool,
        written: &mut Vec<Written>,
    ) -> Result<Value, Error> {
        let target = self.target(argument)?;
        let Some(ty) = self.ty_to_copy(target)? else {
            return Ok(target);
        };
        let value = match is_in {
            true => Some(self.load(target)?),
            false => None,
        };
        let copy = self.local(None, ty, None, self.span)?;
        if let Some(value) = value {
            self.store_at(copy, value);
        }
        written.push(Written {
            to: target,
            from: copy,
        });
        Ok(copy)
    }

    /// The type of the copy that a target needs. `None` if it needs none.
    fn ty_to_copy(&mut self, target: Value) -> Result<Option<Handle<Type>>, Error> {
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
