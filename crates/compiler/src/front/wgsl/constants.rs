//! Constant expressions that naga cannot evaluate, such as `bitcast`, `mix` or `transpose` in a
//! `const`. Each is replaced by its value.

use std::collections::BTreeMap;
use std::ops::Range;

use naga::{Expression, Literal, Module, Span, Statement, TypeInner};
use naga_interp::{Environment, Scalar, Value};

use super::tokens::{Kind, Token, tokens};

/// naga's messages about constant expressions that it lacks.
const LACKS: [&str; 3] = [
    "Not implemented as constant expression",
    // naga's message for a call that it leaves to run time, with abstract arguments.
    "failed to convert expression to a concrete type",
    "Cannot apply the binary op",
];

/// Whether naga rejects an expression only because it lacks its evaluation.
pub(super) fn is_lacking(message: &str) -> bool {
    LACKS.iter().any(|lack| message.contains(lack))
}

const NAME: &str = "preshade_value";

/// The constant expression that naga means by `part`, which may be the name of a call alone, and its
/// value as text of the same type.
pub(super) fn value(text: &str, part: Range<usize>) -> Option<(Range<usize>, String)> {
    let part = part.start..end_of_call(text, part.end);
    let member = || {
        // A member of a struct, which no literal expresses.
        let behind = tokens(&text[part.end..]);
        let (dot, name) = (behind.first()?, behind.get(1)?);
        (dot.text == ".").then(|| part.start..part.end + name.range().end)
    };
    let parts = [Some(part.clone()), member()].into_iter().flatten();
    let mut values = parts.filter_map(|part| Some((part.clone(), of_whole(text, part)?)));
    values.next()
}

/// A call of a built-in function that naga has left with abstract numbers: it takes the text, but no
/// validator takes the module.
pub(super) fn unsettled(module: &Module) -> Option<Span> {
    let functions = module.functions.iter().map(|(_, f)| f);
    let mut functions = functions.chain(module.entry_points.iter().map(|e| &e.function));
    functions.find_map(|function| {
        let mut is_abstract = Vec::with_capacity(function.expressions.len());
        for (e, expression) in function.expressions.iter() {
            let operands = naga_operands::of_expression(expression);
            let of_abstract = operands.iter().any(|o| is_abstract[o.index()]);
            match expression {
                Expression::Literal(Literal::AbstractInt(_) | Literal::AbstractFloat(_)) => {
                    is_abstract.push(true);
                }
                Expression::Compose { .. } | Expression::Splat { .. } => {
                    is_abstract.push(of_abstract);
                }
                Expression::Math { .. } if of_abstract => {
                    return Some(function.expressions.get_span(e));
                }
                _ => is_abstract.push(false),
            }
        }
        None
    })
}

/// Where the arguments end that follow a name, or the end of the name.
fn end_of_call(text: &str, name: usize) -> usize {
    let behind = tokens(&text[name..]);
    if behind.first().is_none_or(|t| t.text != "(") {
        return name;
    }
    let mut depth = 0_usize;
    for token in &behind {
        match token.text {
            "(" => depth += 1,
            ")" => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return name + token.range().end;
        }
    }
    name
}

fn of_whole(text: &str, part: Range<usize>) -> Option<String> {
    let call = text.get(part.clone())?;
    let parts = arguments(call);
    if let Some(formula) = parts.as_ref().and_then(|(name, of)| formula(name, of)) {
        return Some(formula);
    }
    let member = &call[call.rfind(')').map_or(call.len(), |n| n + 1)..];
    let [declared, locals] = needed(text, &tokens(text), part)?;
    let blocks = "}".repeat(locals.matches('{').count());
    let body = |lets: &str, call: &str| {
        format!("{declared}fn {NAME}() {{ {locals}{lets}let {NAME} = {call}; {blocks} }}")
    };
    evaluated(&body("", call)).or_else(|| {
        // A `let` makes abstract numbers concrete.
        let (name, of) = parts?;
        let lets = of.iter().enumerate();
        let lets: String = lets
            .map(|(n, a)| format!("let {NAME}{n} = {a}; "))
            .collect();
        let names: Vec<String> = (0..of.len()).map(|n| format!("{NAME}{n}")).collect();
        let call = format!("{name}({}){member}", names.join(", "));
        evaluated(&body(&lets, &call))
    })
}

/// The value of the variable that a text of one function declares last.
fn evaluated(probe: &str) -> Option<String> {
    let module = naga::front::wgsl::parse_str(probe).ok()?;
    let flags = naga::valid::ValidationFlags::all();
    let capabilities = naga::valid::Capabilities::all();
    let info = naga::valid::Validator::new(flags, capabilities)
        .validate(&module)
        .ok()?;
    let mut functions = module.functions.iter();
    let (handle, function) = functions.find(|(_, f)| f.name.as_deref() == Some(NAME))?;
    let mut function = function.clone();
    let named = |(e, name): (&naga::Handle<Expression>, &String)| (name == NAME).then_some(*e);
    let value = function.named_expressions.iter().find_map(named)?;
    // `frexp` and `modf` return structs, which no literal expresses.
    if let TypeInner::Struct { .. } = info[handle][value].ty.inner_with(&module.types) {
        return None;
    }
    // naga ends each function with a `return`.
    if let Some(Statement::Return { value: result }) = function.body.iter_mut().last() {
        *result = Some(value);
    }
    let environment = Environment::<f32> {
        resources: BTreeMap::new().into(),
        texture: &|_| [0.0; 4],
        derivative: None,
        trace: None,
        steps: 10_000,
    };
    let run = naga_interp::run(&module, &function, &[], &environment).ok()?;
    written(&run.result?)
}

/// The name and the arguments of a call.
fn arguments(call: &str) -> Option<(&str, Vec<&str>)> {
    let tokens = tokens(call);
    let open = tokens.iter().position(|t| t.text == "(")?;
    let name = call[..tokens[open].at].trim();
    let mut arguments = Vec::new();
    let (mut depth, mut start) = (0_usize, tokens[open].range().end);
    for token in &tokens[open + 1..] {
        match (token.kind, token.text) {
            (Kind::Open, _) | (_, "(" | "[") => depth += 1,
            (_, ")") if depth == 0 => arguments.push(&call[start..token.at]),
            (Kind::Close, _) | (_, ")" | "]") => depth = depth.checked_sub(1)?,
            (_, ",") if depth == 0 => {
                arguments.push(&call[start..token.at]);
                start = token.range().end;
            }
            _ => {}
        }
    }
    arguments.retain(|a| !a.trim().is_empty());
    Some((name, arguments))
}

/// `mix` and its like as arithmetic, which naga evaluates and which keeps abstract numbers.
fn formula(name: &str, arguments: &[&str]) -> Option<String> {
    match (name, arguments) {
        ("mix", [a, b, c]) => Some(format!("(({a}) * (1.0 - ({c})) + ({b}) * ({c}))")),
        ("smoothstep", [low, high, x]) => {
            // The factor makes integers floats, whose division does not round.
            let t = format!("saturate((({x}) - ({low})) * 1.0 / (({high}) - ({low})))");
            Some(format!("({t} * {t} * (3.0 - 2.0 * {t}))"))
        }
        ("reflect", [a, b]) => Some(format!("(({a}) - 2.0 * dot({b}, {a}) * ({b}))")),
        _ => None,
    }
}

/// A name that is declared in a function, and the declaration of a constant. `None` if its value is
/// known at run time only.
type Local<'t> = (&'t str, Option<Range<usize>>);

/// The text that a part depends on: directives and declarations of the module, and constants of its
/// function, each in a block of its own. `None` if it needs a variable.
fn needed(text: &str, tokens: &[Token<'_>], part: Range<usize>) -> Option<[String; 2]> {
    let mut declared: BTreeMap<&str, Range<usize>> = BTreeMap::new();
    let mut out = String::new();
    // Of each open block around the part, the names so far.
    let mut blocks: Vec<Vec<Local<'_>>> = Vec::new();
    let mut parameters = Vec::new();
    let mut locals = Vec::new();
    for (n, token) in tokens.iter().enumerate() {
        if token.at >= part.start && locals.is_empty() {
            locals = blocks.concat();
        }
        let ends = |sign: &str| {
            let end = tokens[n..].iter().find(|t| t.text == sign)?;
            Some(token.at..end.range().end)
        };
        let name = tokens.get(n + 1).map_or("", |t| t.text);
        match (token.text, blocks.last_mut()) {
            ("{", _) => blocks.push(std::mem::take(&mut parameters)),
            ("}", _) => drop(blocks.pop()),
            ("const", Some(block)) => block.extend(ends(";").map(|r| (name, Some(r)))),
            ("let" | "var", Some(block)) => block.push((name, None)),
            ("const" | "alias", None) => declared.extend(ends(";").map(|r| (name, r))),
            ("struct", None) => declared.extend(ends("}").map(|r| (name, r))),
            ("enable", None) => out.extend(ends(";").map(|r| &text[r])),
            ("fn", None) => parameters.clear(),
            (word, None) if name == ":" => parameters.push((word, None)),
            _ => {}
        }
    }
    let is_local = |range: &Range<usize>| locals.iter().any(|(_, r)| r.as_ref() == Some(range));
    let mut open = vec![(part, true)];
    let mut used: BTreeMap<usize, Range<usize>> = BTreeMap::new();
    while let Some((part, is_inside)) = open.pop() {
        let from = tokens.partition_point(|t| t.at < part.start);
        for token in tokens[from..].iter().take_while(|t| t.at < part.end) {
            // The innermost that is declared ahead.
            let is_ahead = |(name, range): &&Local<'_>| {
                *name == token.text && range.as_ref().is_none_or(|r| r.end <= part.start)
            };
            let local = locals.iter().rfind(is_ahead).filter(|_| is_inside);
            let range = match local {
                Some((_, range)) => Some(range.as_ref()?),
                None => declared.get(token.text),
            };
            let new = range.filter(|r| used.insert(r.start, (*r).clone()).is_none());
            open.extend(new.map(|r| (r.clone(), is_local(r))));
        }
    }
    let mut inside = String::new();
    for range in used.into_values() {
        match is_local(&range) {
            true => inside.push_str(&format!("{} {{ ", &text[range])),
            false => out.push_str(&format!("{}\n", &text[range])),
        }
    }
    Some([out, inside])
}

/// A value as WGSL. `None` if no literal expresses it.
fn written(value: &Value<f32>) -> Option<String> {
    let parts = match value {
        Value::Scalar(scalar) => return number(*scalar),
        Value::Composite(parts) => parts,
        _ => return None,
    };
    let inner: Vec<String> = parts.iter().map(written).collect::<Option<_>>()?;
    let ty = match parts.first()? {
        Value::Scalar(scalar) => format!("vec{}<{}>", parts.len(), type_of(*scalar)),
        Value::Composite(rows) => format!("mat{}x{}<f32>", parts.len(), rows.len()),
        _ => return None,
    };
    Some(format!("{ty}({})", inner.join(", ")))
}

fn type_of(scalar: Scalar<f32>) -> &'static str {
    match scalar {
        Scalar::F32(_) => "f32",
        Scalar::I32(_) => "i32",
        Scalar::U32(_) => "u32",
        Scalar::Bool(_) => "bool",
    }
}

fn number(scalar: Scalar<f32>) -> Option<String> {
    Some(match scalar {
        Scalar::F32(f32::MAX) => "3.40282346e38f".to_owned(),
        Scalar::F32(v) if v.is_finite() => format!("({v:?}f)"),
        Scalar::F32(_) => return None,
        Scalar::I32(v) => format!("i32({v})"),
        Scalar::U32(v) => format!("{v}u"),
        Scalar::Bool(v) => v.to_string(),
    })
}
