//! Finds the position of a vertex in the world by its role: the vector that the view's matrix turns
//! into the clip position.

use naga::{BinaryOperator, Binding, BuiltIn, Expression, Handle, Span, TypeInner, VectorSize};

use crate::analysis::authored::{Authored, Place};
use crate::analysis::reach::with_users;
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use crate::analysis::view;
use crate::graph::{Graph, text};

/// A vector of four, and the matrices that turn it into the world, outermost first.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// The vector.
    pub vector: Authored,
    /// The matrices.
    pub matrices: Vec<Authored>,
}

impl World {
    /// The author's code for it.
    pub fn described(&self) -> String {
        let factors = self.matrices.iter().chain([&self.vector]);
        let factors: Vec<&str> = factors.map(|f| f.name.as_str()).collect();
        format!("`{}`", factors.join(" * "))
    }
}

/// Why no position in the world is found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoWorld {
    /// No product with a matrix of the view leads to the position.
    None,
    /// Several do.
    Several,
    /// The matrix of this name turns from an object's own space to the view's at once.
    Combined(String),
}

/// The position in the world. `follows` are the uniforms that follow the viewer
/// ([`view::view_dependent`]).
///
/// # Errors
/// [`NoWorld`].
pub fn position(graph: &Graph<'_>, vertex: usize, follows: &[String]) -> Result<World, NoWorld> {
    let values = Values::new(graph, vertex).map_err(|_| NoWorld::None)?;
    let sources = (0..values.values.len()).filter(|v| view::is_read(&values, *v, follows));
    let search = Search {
        dependent: with_users(&values, sources.collect()),
        values: &values,
    };
    let positions = values
        .outputs()
        .into_iter()
        .filter(|(binding, _)| matches!(binding, Some(Binding::BuiltIn(BuiltIn::Position { .. }))));
    let mut products = Vec::new();
    let mut seen = vec![false; values.values.len()];
    for (_, value) in positions {
        search.below(value, &mut seen, &mut products);
    }
    match products[..] {
        [] => Err(NoWorld::None),
        [product] => search.world(product),
        _ => Err(NoWorld::Several),
    }
}

/// A matrix times a vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Product {
    context: ContextId,
    matrix: Handle<Expression>,
    vector: Handle<Expression>,
}

struct Search<'v, 'g, 'p> {
    values: &'v Values<'g, 'p>,
    /// Whether each value depends on the viewer.
    dependent: Vec<bool>,
}

impl Search<'_, '_, '_> {
    fn is_dependent(&self, context: ContextId, e: Handle<Expression>) -> bool {
        let value = self.values.named(context, e);
        value.is_some_and(|v| self.dependent[v])
    }

    /// The innermost products with matrices of the view that a value is computed from.
    fn below(&self, value: ValueId, seen: &mut [bool], found: &mut Vec<Product>) {
        let mut work = vec![value];
        while let Some(value) = work.pop() {
            if std::mem::replace(&mut seen[value], true) {
                continue;
            }
            let Some(product) = self.product(value) else {
                let operands = self.values.values[value].operands.iter();
                work.extend(operands.filter(|o| self.dependent[**o]));
                continue;
            };
            let mut inner = Vec::new();
            if self.is_dependent(product.context, product.vector)
                && let Some(vector) = self.values.named(product.context, product.vector)
            {
                self.below(vector, seen, &mut inner);
            }
            match inner.is_empty() {
                true => found.push(product),
                false => found.extend(inner),
            }
        }
    }

    /// The product that a value is, if its matrix follows the viewer.
    fn product(&self, value: ValueId) -> Option<Product> {
        let (context, e, _) = self.values.expression(value)?;
        let f = self.values.function(context);
        let Expression::Binary {
            op: BinaryOperator::Multiply,
            left,
            right,
        } = f.function.expressions[e]
        else {
            return None;
        };
        let module = self.values.graph.module();
        let is_product = is_matrix(f.ty(module, left)) && is_vector(f.ty(module, right));
        (is_product && self.is_dependent(context, left)).then_some(Product {
            context,
            matrix: left,
            vector: right,
        })
    }

    fn world(&self, product: Product) -> Result<World, NoWorld> {
        let matrices = self.free(product.context, product.matrix)?;
        let authored = |(context, e)| self.authored(context, e).ok_or(NoWorld::None);
        Ok(World {
            vector: authored((product.context, product.vector))?,
            matrices: matrices
                .into_iter()
                .map(authored)
                .collect::<Result<_, _>>()?,
        })
    }

    /// The factors of a matrix behind the last one that follows the viewer, outermost first.
    fn free(
        &self,
        context: ContextId,
        matrix: Handle<Expression>,
    ) -> Result<Vec<(ContextId, Handle<Expression>)>, NoWorld> {
        let module = self.values.graph.module();
        let (context, matrix) = self.origin(context, matrix);
        let f = self.values.function(context);
        let Expression::Binary {
            op: BinaryOperator::Multiply,
            left,
            right,
        } = f.function.expressions[matrix]
        else {
            let name = text::expression(module, f, matrix);
            return match is_combined(&name) {
                true => Err(NoWorld::Combined(name)),
                false => Ok(Vec::new()),
            };
        };
        if self.is_dependent(context, right) {
            return self.free(context, right);
        }
        let mut factors = self.free(context, left)?;
        factors.push((context, right));
        Ok(factors)
    }

    /// The expression that a variable or a result was given, if it was given one alone.
    fn origin(&self, context: ContextId, e: Handle<Expression>) -> (ContextId, Handle<Expression>) {
        let Some(mut value) = self.values.named(context, e) else {
            return (context, e);
        };
        let mut known = (context, e);
        loop {
            if let Some((context, e, _)) = self.values.expression(value) {
                known = (context, e);
            }
            let is_copy = match &self.values.values[value].node {
                Node::Version(..) => true,
                Node::Expression(context, e, path) if path.is_empty() => {
                    let function = self.values.function(*context).function;
                    matches!(
                        function.expressions[*e],
                        Expression::Load { .. } | Expression::CallResult(_)
                    )
                }
                _ => false,
            };
            match self.values.values[value].operands[..] {
                [one] if is_copy => value = one,
                _ => return known,
            }
        }
    }

    fn authored(&self, context: ContextId, e: Handle<Expression>) -> Option<Authored> {
        let module = self.values.graph.module();
        let id = self.values.contexts[context].function;
        let f = self.values.function(context);
        let place = match f.function.expressions[e] {
            Expression::FunctionArgument(i) => Place::Argument(id, i),
            _ => {
                f.statements.evaluated_at(e)?;
                Place::Expression(id, e)
            }
        };
        Some(Authored {
            name: text::expression(module, f, e),
            function: self.values.graph.name(id),
            place,
            path: Vec::new(),
            inner: f.ty(module, e).clone(),
            span: match place {
                Place::Expression(..) => f.function.expressions.get_span(e),
                _ => Span::UNDEFINED,
            },
        })
    }
}

/// Whether the name of a matrix says that it begins in an object's own space.
fn is_combined(name: &str) -> bool {
    let name = name.to_lowercase().replace('_', "");
    let words = ["model", "mvp", "object", "local", "worldview", "wvp"];
    words.iter().any(|word| name.contains(word))
}

fn is_matrix(inner: &TypeInner) -> bool {
    let TypeInner::Matrix { columns, rows, .. } = inner else {
        return false;
    };
    (*columns, *rows) == (VectorSize::Quad, VectorSize::Quad)
}

fn is_vector(inner: &TypeInner) -> bool {
    matches!(
        inner,
        TypeInner::Vector {
            size: VectorSize::Quad,
            ..
        }
    )
}
