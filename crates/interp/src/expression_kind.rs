//! Names of expressions in messages.

use naga::Expression;

/// The name of an expression's kind.
pub(crate) fn kind(expression: &Expression) -> &'static str {
    match expression {
        Expression::Compose { .. } => "Compose",
        Expression::Access { .. } => "Access",
        Expression::AccessIndex { .. } => "AccessIndex",
        Expression::Splat { .. } => "Splat",
        Expression::Swizzle { .. } => "Swizzle",
        Expression::Load { .. } => "Load",
        Expression::ImageSample { .. } => "ImageSample",
        Expression::ImageLoad { .. } => "ImageLoad",
        Expression::Unary { .. } => "Unary",
        Expression::Binary { .. } => "Binary",
        Expression::Select { .. } => "Select",
        Expression::Derivative { .. } => "Derivative",
        Expression::Relational { .. } => "Relational",
        Expression::Math { .. } => "Math",
        Expression::As { .. } => "As",
        Expression::ImageQuery { .. } => "the size of a texture (ImageQuery)",
        Expression::AtomicResult { .. } => "AtomicResult",
        _ => "expression",
    }
}
