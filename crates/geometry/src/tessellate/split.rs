//! Splits a hoisted vertex stage into the author's function and the code that `hoist` appended.

use naga::{
    Binding, Block, Expression, Function, FunctionArgument, Handle, Interpolation, Module,
    ScalarKind, Statement, Type, TypeInner,
};
use naga_edit::writer::emit_existing;

/// A vertex stage of the form `rest(author(inputs))`.
#[derive(Clone, Debug)]
pub(crate) struct Split {
    /// The author's stage, from vertex inputs to `given`.
    pub author: Handle<Function>,
    pub given: Handle<Type>,
    /// The rest of the stage as a function of the author's result, not yet in the module.
    pub rest: Function,
    /// The entry point's inputs, which are the author's.
    pub inputs: Vec<FunctionArgument>,
}

/// Splits an entry point. `None` unless it is straight-line code that starts by passing on all its
/// inputs.
pub(crate) fn split(module: &Module, entry: usize) -> Option<Split> {
    let function = &module.entry_points[entry].function;
    let (author, arguments, given) = function.body.iter().find_map(|s| match s {
        Statement::Call {
            function,
            arguments,
            result,
        } => Some((*function, arguments, (*result)?)),
        _ => None,
    })?;
    let all = arguments.len() == function.arguments.len();
    let mut passed = arguments.iter().enumerate();
    let in_order =
        passed.all(|(i, a)| function.expressions[*a] == Expression::FunctionArgument(i as u32));
    if !(all && in_order) {
        return None;
    }
    let ty = module.functions[author].result.as_ref()?.ty;
    let mut rest = Function {
        name: None,
        arguments: vec![FunctionArgument {
            name: Some("author".to_owned()),
            ty,
            binding: None,
        }],
        result: function.result.clone(),
        diagnostic_filter_leaf: function.diagnostic_filter_leaf,
        ..Function::default()
    };
    let mut copies: Vec<Option<Handle<Expression>>> = vec![None; function.expressions.len()];
    for (e, expression) in function.expressions.iter() {
        let expression = match expression {
            Expression::FunctionArgument(_) => continue,
            _ if e == given => Expression::FunctionArgument(0),
            other => {
                let mut copy = other.clone();
                let mut known = true;
                naga_operands::map_expression(&mut copy, &mut |o| match copies[o.index()] {
                    Some(new) => *o = new,
                    None => known = false,
                });
                if !known {
                    return None;
                }
                copy
            }
        };
        let span = function.expressions.get_span(e);
        copies[e.index()] = Some(rest.expressions.append(expression, span));
    }
    rest.body = body(function, &copies, given)?;
    for (e, name) in &function.named_expressions {
        if let Some(new) = copies[e.index()].filter(|_| *e != given) {
            rest.named_expressions.insert(new, name.clone());
        }
    }
    Some(Split {
        author,
        given: ty,
        rest,
        inputs: function.arguments.clone(),
    })
}

/// The origin of a member of a vertex stage's result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// The author's stage: the output with this index, or the whole result.
    Author(Option<u32>),
    Hoisted,
}

impl Split {
    /// The origin of each member of the result. `None` if it is not composed from members.
    pub fn origins(&self) -> Option<Vec<Origin>> {
        let returned = self.rest.body.iter().find_map(|s| match s {
            Statement::Return { value } => *value,
            _ => None,
        })?;
        let expressions = &self.rest.expressions;
        let Expression::Compose { components, .. } = &expressions[returned] else {
            return None;
        };
        let is_author = |e: Handle<Expression>| expressions[e] == Expression::FunctionArgument(0);
        let origin = |e: &Handle<Expression>| match expressions[*e] {
            Expression::AccessIndex { base, index } if is_author(base) => {
                Origin::Author(Some(index))
            }
            _ if is_author(*e) => Origin::Author(None),
            _ => Origin::Hoisted,
        };
        Some(components.iter().map(origin).collect())
    }
}

/// The statements after the author's call.
fn body(
    function: &Function,
    copies: &[Option<Handle<Expression>>],
    given: Handle<Expression>,
) -> Option<Block> {
    let mut body = Block::new();
    for (statement, span) in function.body.span_iter() {
        let statement = match statement {
            Statement::Call {
                result: Some(r), ..
            } if *r == given => continue,
            Statement::Emit(range) => {
                let evaluated = range.clone().filter_map(|e| copies[e.index()]);
                emit_existing(evaluated, &mut body, *span);
                continue;
            }
            Statement::Call { .. } | Statement::Return { .. } => {
                let mut copy = statement.clone();
                if let Some(result) = naga_operands::result_mut(&mut copy) {
                    *result = copies[result.index()]?;
                }
                let mut known = true;
                naga_operands::map_statement(&mut copy, &mut |o| match copies[o.index()] {
                    Some(new) => *o = new,
                    None => known = false,
                });
                if !known {
                    return None;
                }
                copy
            }
            _ => return None,
        };
        body.push(statement, *span);
    }
    Some(body)
}

/// How a new vertex gets an output of the author's stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Carried {
    /// Interpolated, with this many `f32`.
    Blended(u8),
    /// Taken from the first vertex.
    Flat,
}

/// Outputs of the author's stage in order, with the index of the position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Outputs {
    pub carried: Vec<Carried>,
    pub position: usize,
    /// Whether they are members of a struct. Otherwise the position is the only output.
    pub is_struct: bool,
}

impl Outputs {
    /// Examines the author's result type.
    ///
    /// # Errors
    /// Name of an output that cannot be interpolated, and the reason.
    pub fn of(module: &Module, ty: Handle<Type>) -> Result<Self, (String, &'static str)> {
        let TypeInner::Struct { members, .. } = &module.types[ty].inner else {
            return Ok(Self {
                carried: vec![Carried::Blended(4)],
                position: 0,
                is_struct: false,
            });
        };
        let mut position = 0;
        let mut carried = Vec::new();
        for (index, member) in members.iter().enumerate() {
            let name = || member.name.clone().unwrap_or_default();
            let inner = &module.types[member.ty].inner;
            let float = inner.scalar().filter(|s| s.kind == ScalarKind::Float);
            let width = match inner {
                TypeInner::Scalar(_) => 1,
                TypeInner::Vector { size, .. } => *size as u8,
                _ => {
                    return Err((name(), "it is an array"));
                }
            };
            carried.push(match &member.binding {
                Some(Binding::BuiltIn(naga::BuiltIn::Position { .. })) => {
                    position = index;
                    Carried::Blended(4)
                }
                Some(Binding::Location {
                    interpolation: Some(Interpolation::Flat),
                    ..
                }) => Carried::Flat,
                Some(Binding::Location {
                    interpolation: Some(Interpolation::Linear),
                    ..
                }) => {
                    return Err((
                        name(),
                        "it has linear interpolation on the screen, which is undefined behind the viewer",
                    ));
                }
                Some(Binding::Location { .. }) if float.is_some_and(|s| s.width == 4) => {
                    Carried::Blended(width)
                }
                Some(Binding::Location { .. }) if float.is_none() => Carried::Flat,
                _ => return Err((name(), "it does not consist of 32-bit numbers")),
            });
        }
        Ok(Self {
            carried,
            position,
            is_struct: true,
        })
    }

    /// Distinct widths of the interpolated outputs.
    pub fn widths(&self) -> Vec<u8> {
        let blended = self.carried.iter().filter_map(|c| match c {
            Carried::Blended(width) => Some(*width),
            Carried::Flat => None,
        });
        let mut widths: Vec<u8> = blended.collect();
        widths.sort_unstable();
        widths.dedup();
        widths
    }

    /// Whether any output comes from the first vertex.
    pub fn has_flat(&self) -> bool {
        self.carried.contains(&Carried::Flat)
    }
}
