//! Handles initialisers that naga's WGSL writer cannot write (it is `unreachable!()`): those of
//! overrides and private variables that depend on overrides.
//!
//! The writer can write them inside of functions. So each becomes the result of a temporary
//! function, and is moved from there into the declaration.

use naga::{
    AddressSpace, Expression, Function, FunctionResult, Handle, Module, Span, Statement, Type,
};
use naga_edit::writer::FunctionWriter;

/// A module without such initialisers, and their targets.
pub(crate) struct Apart {
    /// The module, with one temporary function per initialiser at the end.
    pub module: Module,
    places: Vec<InitialiserOf>,
}

/// The override or private variable of an initialiser.
#[derive(Clone, Copy, PartialEq, Eq)]
enum InitialiserOf {
    Override(usize),
    Private(usize),
}

/// Removes initialisers that the writer cannot write; `None` if there are none.
pub(crate) fn set_apart(module: &Module) -> Option<Apart> {
    let amiss = |init: &Option<Handle<Expression>>| init.filter(|e| !is_writable(module, *e));
    let overrides = module.overrides.iter().enumerate();
    let overrides = overrides.filter_map(|(i, (_, o))| {
        let init = amiss(&o.init)?;
        Some((InitialiserOf::Override(i), init, o.ty))
    });
    let private = |g: &naga::GlobalVariable| g.space == AddressSpace::Private;
    let variables = module.global_variables.iter();
    let variables = variables.filter(|(_, g)| private(g)).enumerate();
    let variables = variables.filter_map(|(i, (_, g))| {
        let init = amiss(&g.init)?;
        Some((InitialiserOf::Private(i), init, g.ty))
    });
    let all: Vec<(InitialiserOf, Handle<Expression>, Handle<Type>)> =
        overrides.chain(variables).collect();
    if all.is_empty() {
        return None;
    }
    let mut apart = module.clone();
    for (_, init, ty) in &all {
        let function = returning(module, *init, *ty);
        apart.functions.append(function, Span::UNDEFINED);
    }
    let places: Vec<InitialiserOf> = all.into_iter().map(|(place, ..)| place).collect();
    for (i, (_, constant)) in apart.overrides.iter_mut().enumerate() {
        constant.init = constant
            .init
            .filter(|_| !places.contains(&InitialiserOf::Override(i)));
    }
    let globals = apart.global_variables.iter_mut().map(|(_, g)| g);
    for (i, global) in globals.filter(|g| private(g)).enumerate() {
        global.init = global
            .init
            .filter(|_| !places.contains(&InitialiserOf::Private(i)));
    }
    Some(Apart {
        module: apart,
        places,
    })
}

/// Whether the writer can write a constant expression.
fn is_writable(module: &Module, e: Handle<Expression>) -> bool {
    let expression = &module.global_expressions[e];
    let has_words = matches!(
        expression,
        Expression::Literal(_)
            | Expression::Constant(_)
            | Expression::Override(_)
            | Expression::ZeroValue(_)
            | Expression::Compose { .. }
            | Expression::Splat { .. }
    );
    let operands = naga_operands::of_expression(expression);
    has_words && operands.into_iter().all(|o| is_writable(module, o))
}

/// A function that returns a constant expression of the module.
fn returning(module: &Module, init: Handle<Expression>, ty: Handle<Type>) -> Function {
    let mut writer = FunctionWriter::of(Function {
        name: Some("preshade_initialiser".to_owned()),
        result: Some(FunctionResult { ty, binding: None }),
        ..Function::default()
    });
    let value = Some(copied(module, init, &mut writer));
    writer.statement(Statement::Return { value }, Span::UNDEFINED);
    writer.finish()
}

/// Copies the expression with its operands, once per use: the writer does not name values that are
/// used once.
fn copied(
    module: &Module,
    e: Handle<Expression>,
    writer: &mut FunctionWriter,
) -> Handle<Expression> {
    let mut expression = module.global_expressions[e].clone();
    naga_operands::map_expression(&mut expression, &mut |o| *o = copied(module, *o, writer));
    writer.expression(expression)
}

impl Apart {
    /// Moves the initialisers from the functions to their declarations.
    pub(crate) fn put_back(&self, text: &str) -> String {
        let own = self.module.functions.len() - self.places.len();
        let mut plain: Vec<&str> = Vec::new();
        let mut returned: Vec<&str> = Vec::new();
        let mut functions = 0;
        let mut lines = text.lines();
        while let Some(line) = lines.next() {
            if !line.starts_with("fn ") {
                plain.push(line);
                continue;
            }
            functions += 1;
            if functions <= own || functions > self.module.functions.len() {
                plain.push(line);
                continue;
            }
            // One statement, and a blank line after the function.
            let mut whole = lines.by_ref().take_while(|l| *l != "}");
            let statement = whole.find_map(|l| l.trim().strip_prefix("return "));
            whole.for_each(drop);
            lines.next();
            returned.extend(statement.and_then(|s| s.strip_suffix(';')));
        }
        let (mut overrides, mut variables) = (0, 0);
        let mut out = String::with_capacity(text.len());
        for line in plain {
            let place = if line.starts_with("override ") || line.starts_with("@id(") {
                overrides += 1;
                Some(InitialiserOf::Override(overrides - 1))
            } else if line.starts_with("var<private> ") {
                variables += 1;
                Some(InitialiserOf::Private(variables - 1))
            } else {
                None
            };
            let at = place.and_then(|place| self.places.iter().position(|p| *p == place));
            let initialiser = at.and_then(|at| returned.get(at));
            match (initialiser, line.strip_suffix(';')) {
                (Some(value), Some(declared)) => {
                    out.push_str(&format!("{declared} = {};", without_parentheses(value)));
                }
                _ => out.push_str(line),
            }
            out.push('\n');
        }
        out
    }
}

/// Removes parentheses around the whole expression.
fn without_parentheses(value: &str) -> &str {
    let inner = value.strip_prefix('(').and_then(|v| v.strip_suffix(')'));
    let closes = |inner: &&str| {
        let mut depth = 0_i32;
        inner.chars().all(|c| {
            depth += i32::from(c == '(') - i32::from(c == ')');
            depth >= 0
        })
    };
    inner.filter(closes).unwrap_or(value)
}
