//! Finds the position of a vertex in the world by its role: the vector that the view's matrix turns
//! into the clip position.

use naga::{BinaryOperator, Binding, BuiltIn, Expression, Handle, Literal, TypeInner, VectorSize};

use super::authored::Authored;
use crate::analysis::reach::with_users;
use crate::analysis::values::{ContextId, Node, ValueId, Values};
use crate::analysis::view;
use preshade_dataflow::graph::memory::Origin;
use preshade_dataflow::graph::{Graph, text};

/// A vector of four, and the matrices that turn it into the world, outermost first.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct World {
    pub vector: Authored,
    pub matrices: Vec<Authored>,
    /// Whether the fourth component is the literal 1.
    pub is_point: bool,
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
pub(crate) enum NoWorld {
    /// No product with a matrix of the view leads to the position.
    None,
    Several,
    /// One leads to it on some ways only.
    NotAlways,
    /// The vector of this name depends on the viewer already: it may be relative to the camera.
    Relative(String),
    /// The matrix of this name turns from an object's own space to the view's at once.
    Combined(String),
}

/// The position in the world. `follows` are the uniforms that follow the viewer
/// ([`view::view_dependent`]).
///
/// # Errors
/// [`NoWorld`].
pub(crate) fn position(
    graph: &Graph<'_>,
    vertex: usize,
    follows: &[String],
) -> Result<World, NoWorld> {
    let values = Values::new(graph, vertex).map_err(|_| NoWorld::None)?;
    let dependent = |names: &[String]| {
        let sources = (0..values.values.len()).filter(|v| view::is_read(&values, *v, names));
        with_users(&values, sources.collect())
    };
    // A billboard's axes turn it, and leave it in the world.
    let is_axis = |name: &&String| view::is_axis(name);
    let places: Vec<String> = follows.iter().filter(|n| !is_axis(n)).cloned().collect();
    let search = Search {
        dependent: dependent(follows),
        places: dependent(&places),
        values: &values,
    };
    let positions: Vec<ValueId> = values
        .outputs()
        .into_iter()
        .filter(|(binding, _)| matches!(binding, Some(Binding::BuiltIn(BuiltIn::Position { .. }))))
        .map(|(_, value)| value)
        .collect();
    let mut products = Vec::new();
    let mut seen = vec![false; values.values.len()];
    for value in &positions {
        search.innermost_products(*value, &mut seen, &mut products);
    }
    let [(product, at)] = products[..] else {
        return Err(match products.is_empty() {
            true => NoWorld::None,
            false => NoWorld::Several,
        });
    };
    let through = search.through(at);
    match positions.iter().all(|value| through[*value]) {
        true => search.world(product),
        false => Err(NoWorld::NotAlways),
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
    /// Whether each value depends on more of the viewer than on its axes.
    places: Vec<bool>,
}

impl Search<'_, '_, '_> {
    fn is_dependent(&self, context: ContextId, e: Handle<Expression>) -> bool {
        let value = self.values.named(context, e);
        value.is_some_and(|v| self.dependent[v])
    }

    /// The innermost products with matrices of the view that a value is computed from.
    fn innermost_products(
        &self,
        value: ValueId,
        seen: &mut [bool],
        found: &mut Vec<(Product, ValueId)>,
    ) {
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
                self.innermost_products(vector, seen, &mut inner);
            }
            match inner.is_empty() {
                true => found.push((product, value)),
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

    /// Whether each value is computed from the product `at`, whichever way the program takes.
    fn through(&self, at: ValueId) -> Vec<bool> {
        let all = &self.values.values;
        let mut held = vec![true; all.len()];
        // Values of loops lead to themselves, so all count until one is found not to.
        let mut work: Vec<ValueId> = (0..all.len()).collect();
        while let Some(value) = work.pop() {
            if value == at || !held[value] {
                continue;
            }
            let is_through = match self.choices(value) {
                Some(choices) => choices.iter().all(|v| held[*v]),
                None => {
                    let is_data = |v: &&ValueId| !matches!(all[**v].node, Node::Control(..));
                    let mut operands = all[value].operands.iter().filter(is_data);
                    operands.any(|v| held[*v])
                }
            };
            if !is_through {
                held[value] = false;
                work.extend(&self.values.users()[value]);
            }
        }
        held
    }

    /// The possible values of a value with several definitions or returns.
    fn choices(&self, value: ValueId) -> Option<Vec<ValueId>> {
        let all = &self.values.values;
        match &all[value].node {
            Node::Version(context, version) => {
                let memory = &self.values.function(*context).memory;
                let is_choice = matches!(memory.origin(*version), Origin::Phi { .. });
                is_choice.then(|| all[value].operands.clone())
            }
            Node::Expression(context, e, _) => {
                let function = self.values.function(*context).function;
                match function.expressions[*e] {
                    Expression::CallResult(_) => {
                        let is_data = |v: &&ValueId| !matches!(all[**v].node, Node::Control(..));
                        Some(
                            all[value]
                                .operands
                                .iter()
                                .filter(is_data)
                                .copied()
                                .collect(),
                        )
                    }
                    Expression::Select { accept, reject, .. } => [accept, reject]
                        .into_iter()
                        .map(|e| self.values.named(*context, e))
                        .collect(),
                    _ => None,
                }
            }
            _ => None,
        }
    }

    /// Whether a vector of four ends in the literal 1.
    fn is_point(&self, context: ContextId, e: Handle<Expression>) -> bool {
        let (context, e) = self.origin(context, e);
        let expressions = &self.values.function(context).function.expressions;
        let Expression::Compose { components, .. } = &expressions[e] else {
            return false;
        };
        components
            .last()
            .is_some_and(|last| expressions[*last] == Expression::Literal(Literal::F32(1.0)))
    }

    fn world(&self, product: Product) -> Result<World, NoWorld> {
        let Product {
            context, vector, ..
        } = product;
        let value = self.values.named(context, vector);
        if value.is_some_and(|v| self.places[v]) {
            let f = self.values.function(context);
            let name = text::expression(self.values.graph.module(), f, vector);
            return Err(NoWorld::Relative(name));
        }
        let matrices = self.free(product.context, product.matrix)?;
        let authored = |(context, e)| Authored::at(self.values, context, e).ok_or(NoWorld::None);
        Ok(World {
            is_point: matrices.is_empty() && self.is_point(context, vector),
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
            return match view::names::is_combined(&name) {
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
