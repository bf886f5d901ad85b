//! Constant expressions that naga cannot evaluate, such as `bitcast`, `mix` or `transpose` in a
//! `const`. Each is replaced by its value.

use std::collections::BTreeMap;
use std::ops::Range;

use naga::{Expression, Statement, TypeInner};
use preshade_passes::evaluate::{self, Environment, Scalar, Value};

use super::tokens::{Kind, Token, tokens};

/// naga's messages about constant expressions that it lacks.
const LACKS: [&str; 3] = [
    "Not implemented as constant expression",
    // Of a call that it leaves to run time, with abstract arguments.
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
    Some((part.clone(), of_whole(text, part)?))
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
    let declared = needed(text, &tokens(text), part);
    let body =
        |lets: &str, call: &str| format!("{declared}fn {NAME}() {{ {lets}let {NAME} = {call}; }}");
    evaluated(&body("", call)).or_else(|| {
        // A `let` makes abstract numbers concrete.
        let (name, of) = parts?;
        let lets = of.iter().enumerate();
        let lets: String = lets
            .map(|(n, a)| format!("let {NAME}{n} = {a}; "))
            .collect();
        let names: Vec<String> = (0..of.len()).map(|n| format!("{NAME}{n}")).collect();
        evaluated(&body(&lets, &format!("{name}({})", names.join(", "))))
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
    let run = evaluate::run(&module, &function, &[], &environment).ok()?;
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
            let t = format!("saturate((({x}) - ({low})) / (({high}) - ({low})))");
            Some(format!("({t} * {t} * (3.0 - 2.0 * {t}))"))
        }
        ("reflect", [a, b]) => Some(format!("(({a}) - 2.0 * dot({b}, {a}) * ({b}))")),
        _ => None,
    }
}

/// The directives and the declarations that a part of the text needs: constants and types.
fn needed(text: &str, tokens: &[Token<'_>], part: Range<usize>) -> String {
    let mut declared: BTreeMap<&str, Range<usize>> = BTreeMap::new();
    let mut out = String::new();
    // Of each open block around the part, the constants so far.
    let mut blocks: Vec<Vec<(&str, Range<usize>)>> = Vec::new();
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
            ("{", _) => blocks.push(Vec::new()),
            ("}", _) => drop(blocks.pop()),
            ("const", Some(block)) => block.extend(ends(";").map(|r| (name, r))),
            ("const" | "alias", None) => declared.extend(ends(";").map(|r| (name, r))),
            ("struct", None) => declared.extend(ends("}").map(|r| (name, r))),
            ("enable", None) => out.extend(ends(";").map(|r| &text[r])),
            _ => {}
        }
    }
    declared.extend(locals);
    let mut open = vec![part];
    let mut used: BTreeMap<usize, Range<usize>> = BTreeMap::new();
    while let Some(part) = open.pop() {
        let from = tokens.partition_point(|t| t.at < part.start);
        let inside = tokens[from..].iter().take_while(|t| t.at < part.end);
        for range in inside.filter_map(|t| declared.get(t.text)) {
            if used.insert(range.start, range.clone()).is_none() {
                open.push(range.clone());
            }
        }
    }
    for range in used.into_values() {
        out.push_str(&text[range]);
        out.push('\n');
    }
    out
}

/// A value as WGSL. `None` for what no literal expresses.
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
