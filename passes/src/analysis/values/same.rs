//! Expressions that are one value.

use naga::{Expression, Handle};

use super::{ContextId, Values};
use preshade_dataflow::graph::cells;

impl Values<'_, '_> {
    /// Whether two expressions are one value: the same one, or two loads of the same memory
    /// versions.
    pub(crate) fn is_same(
        &self,
        context: ContextId,
        a: Handle<Expression>,
        b: Handle<Expression>,
    ) -> bool {
        if a == b {
            return true;
        }
        let (Some(x), Some(y)) = (self.named(context, a), self.named(context, b)) else {
            return false;
        };
        x == y
            || (self.loads_same(context, a, b)
                && self.values[x].operands == self.values[y].operands)
    }

    /// Whether two expressions are loads of one place.
    fn loads_same(&self, context: ContextId, a: Handle<Expression>, b: Handle<Expression>) -> bool {
        let function = self.function(context).function;
        let (Expression::Load { pointer: a }, Expression::Load { pointer: b }) =
            (&function.expressions[a], &function.expressions[b])
        else {
            return false;
        };
        let place = |p| cells::place(self.graph.module(), function, p).filter(|p| !p.dynamic);
        a == b || (place(*a).is_some() && place(*a) == place(*b))
    }
}
