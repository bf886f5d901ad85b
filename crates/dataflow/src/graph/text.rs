//! Expressions and statements in source notation, for labels.

use naga::{
    BinaryOperator, Expression, Handle, ImageQuery, Literal, Module, Statement, SwizzleComponent,
    UnaryOperator,
};
use naga_edit::interface;

use super::{FunctionGraph, StmtId};

/// Levels of nesting written out before an ellipsis.
const DEPTH: usize = 3;

/// An expression, by the author's name if it has one. The outermost is always written out.
pub fn expression(module: &Module, f: &FunctionGraph<'_>, e: Handle<Expression>) -> String {
    write(module, f, e, DEPTH)
}

fn named(module: &Module, f: &FunctionGraph<'_>, e: Handle<Expression>, depth: usize) -> String {
    match f.function.named_expressions.get(&e) {
        Some(name) => name.clone(),
        None if depth == 0 && !f.function.expressions[e].needs_pre_emit() => "…".to_owned(),
        None => write(module, f, e, depth),
    }
}

fn write(module: &Module, f: &FunctionGraph<'_>, e: Handle<Expression>, depth: usize) -> String {
    use Expression as E;
    let of = |e: Handle<Expression>| named(module, f, e, depth.saturating_sub(1));
    let list = |es: &[Handle<Expression>]| es.iter().map(|e| of(*e)).collect::<Vec<_>>().join(", ");
    match &f.function.expressions[e] {
        E::Literal(l) => literal(l),
        E::Constant(c) => module.constants[*c]
            .name
            .clone()
            .unwrap_or_else(|| "constant".to_owned()),
        E::Override(o) => module.overrides[*o]
            .name
            .clone()
            .unwrap_or_else(|| "override".to_owned()),
        E::ZeroValue(ty) => format!("{}()", interface::wgsl_type(module, *ty)),
        E::Compose { ty, components } => {
            format!(
                "{}({})",
                interface::wgsl_type(module, *ty),
                list(components)
            )
        }
        E::Access { base, index } => format!("{}[{}]", of(*base), of(*index)),
        E::AccessIndex { base, index } => {
            format!("{}{}", of(*base), member(module, f, *base, *index))
        }
        E::Splat { size, value } => format!("vec{}({})", *size as u8, of(*value)),
        E::Swizzle {
            size,
            vector,
            pattern,
        } => {
            let letters: String = pattern[..*size as usize]
                .iter()
                .map(|c| match c {
                    SwizzleComponent::X => 'x',
                    SwizzleComponent::Y => 'y',
                    SwizzleComponent::Z => 'z',
                    SwizzleComponent::W => 'w',
                })
                .collect();
            format!("{}.{letters}", of(*vector))
        }
        E::FunctionArgument(i) => f.function.arguments[*i as usize]
            .name
            .clone()
            .unwrap_or_else(|| format!("argument {i}")),
        E::GlobalVariable(g) => module.global_variables[*g]
            .name
            .clone()
            .unwrap_or_else(|| "global".to_owned()),
        E::LocalVariable(v) => f.function.local_variables[*v]
            .name
            .clone()
            .unwrap_or_else(|| "local".to_owned()),
        // A load is written as its pointer, as in the source.
        E::Load { pointer } => named(module, f, *pointer, depth),
        E::Unary { op, expr } => {
            let op = match op {
                UnaryOperator::Negate => "-",
                UnaryOperator::LogicalNot => "!",
                UnaryOperator::BitwiseNot => "~",
            };
            format!("{op}{}", of(*expr))
        }
        E::Binary { op, left, right } => {
            format!("({} {} {})", of(*left), operator(*op), of(*right))
        }
        E::As { expr, kind, .. } => format!("{kind:?}({})", of(*expr)).to_lowercase_first(),
        E::CallResult(callee) => format!(
            "{}(…)",
            module.functions[*callee].name.as_deref().unwrap_or("call")
        ),
        E::ImageQuery { image, query } => {
            let what = match query {
                ImageQuery::Size { .. } => "textureDimensions",
                ImageQuery::NumLevels => "textureNumLevels",
                ImageQuery::NumLayers => "textureNumLayers",
                ImageQuery::NumSamples => "textureNumSamples",
            };
            format!("{what}({})", of(*image))
        }
        other => {
            let arguments = naga_operands::of_expression(other);
            format!("{}({})", variant(other), list(&arguments))
        }
    }
}

trait LowercaseFirst {
    fn to_lowercase_first(self) -> String;
}

impl LowercaseFirst for String {
    fn to_lowercase_first(self) -> String {
        let mut letters = self.chars();
        letters
            .next()
            .map(|c| c.to_ascii_lowercase().to_string() + letters.as_str())
            .unwrap_or_default()
    }
}

/// The name of an operation: the function of a `Math` or `Derivative`, else the variant.
fn variant(expression: &Expression) -> String {
    match expression {
        Expression::Math { fun, .. } => format!("{fun:?}").to_lowercase_first(),
        Expression::Relational { fun, .. } => format!("{fun:?}").to_lowercase_first(),
        Expression::Derivative { axis, .. } => format!("derivative{axis:?}"),
        Expression::Select { .. } => "select".to_owned(),
        Expression::ImageSample { level, .. } => match level {
            naga::SampleLevel::Auto => "textureSample".to_owned(),
            naga::SampleLevel::Bias(_) => "textureSampleBias".to_owned(),
            naga::SampleLevel::Gradient { .. } => "textureSampleGrad".to_owned(),
            _ => "textureSampleLevel".to_owned(),
        },
        Expression::ImageLoad { .. } => "textureLoad".to_owned(),
        other => {
            let debug = format!("{other:?}");
            let end = debug
                .find(|c: char| !c.is_alphanumeric())
                .unwrap_or(debug.len());
            debug[..end].to_owned().to_lowercase_first()
        }
    }
}

fn literal(literal: &Literal) -> String {
    match literal {
        Literal::F64(v) => format!("{v:?}"),
        Literal::F32(v) => format!("{v:?}"),
        Literal::F16(v) => format!("{v:?}"),
        Literal::AbstractFloat(v) => format!("{v:?}"),
        Literal::U16(v) => v.to_string(),
        Literal::I16(v) => v.to_string(),
        Literal::U32(v) => format!("{v}u"),
        Literal::I32(v) => v.to_string(),
        Literal::U64(v) => v.to_string(),
        Literal::I64(v) | Literal::AbstractInt(v) => v.to_string(),
        Literal::Bool(v) => v.to_string(),
    }
}

/// A constant access: `.name` for a struct's member, `.x` for a vector's component, `[2]` for
/// anything else.
fn member(module: &Module, f: &FunctionGraph<'_>, base: Handle<Expression>, index: u32) -> String {
    let ty = f.ty(module, base);
    let pointee = match ty {
        naga::TypeInner::Pointer { base, .. } => &module.types[*base].inner,
        other => other,
    };
    match pointee {
        naga::TypeInner::Struct { members, .. } => format!(
            ".{}",
            members[index as usize]
                .name
                .clone()
                .unwrap_or_else(|| index.to_string())
        ),
        naga::TypeInner::Vector { .. } | naga::TypeInner::ValuePointer { .. } => {
            match "xyzw".chars().nth(index as usize) {
                Some(letter) => format!(".{letter}"),
                None => format!("[{index}]"),
            }
        }
        _ => format!("[{index}]"),
    }
}

fn operator(op: BinaryOperator) -> &'static str {
    use BinaryOperator as B;
    match op {
        B::Add => "+",
        B::Subtract => "-",
        B::Multiply => "*",
        B::Divide => "/",
        B::Modulo => "%",
        B::Equal => "==",
        B::NotEqual => "!=",
        B::Less => "<",
        B::LessEqual => "<=",
        B::Greater => ">",
        B::GreaterEqual => ">=",
        B::And => "&",
        B::ExclusiveOr => "^",
        B::InclusiveOr => "|",
        B::LogicalAnd => "&&",
        B::LogicalOr => "||",
        B::ShiftLeft => "<<",
        B::ShiftRight => ">>",
    }
}

/// A statement's own head, without its blocks.
pub fn statement(module: &Module, f: &FunctionGraph<'_>, id: StmtId) -> String {
    use Statement as S;
    let of = |e: Handle<Expression>| named(module, f, e, DEPTH);
    match f.statements.get(id).statement {
        S::If { condition, .. } => format!("if {}", of(*condition)),
        S::Switch { selector, .. } => format!("switch {}", of(*selector)),
        S::Loop {
            break_if: Some(e), ..
        } => format!("loop, break if {}", of(*e)),
        S::Loop { break_if: None, .. } => "loop".to_owned(),
        S::Break => "break".to_owned(),
        S::Continue => "continue".to_owned(),
        S::Return { value: Some(e) } => format!("return {}", of(*e)),
        S::Return { value: None } => "return".to_owned(),
        S::Kill => "discard".to_owned(),
        S::Store { pointer, value } => format!("{} = {}", of(*pointer), of(*value)),
        S::Call {
            function,
            arguments,
            ..
        } => format!(
            "{}({})",
            module.functions[*function]
                .name
                .as_deref()
                .unwrap_or("call"),
            arguments
                .iter()
                .map(|e| of(*e))
                .collect::<Vec<_>>()
                .join(", ")
        ),
        other => {
            let debug = format!("{:?}", naga_operands::shell(other));
            let end = debug
                .find(|c: char| !c.is_alphanumeric())
                .unwrap_or(debug.len());
            let arguments: Vec<String> = naga_operands::of_statement(other)
                .iter()
                .map(|e| of(*e))
                .collect();
            format!(
                "{}({})",
                debug[..end].to_owned().to_lowercase_first(),
                arguments.join(", ")
            )
        }
    }
}
