//! Rewords errors of naga's GLSL front end, which print type handles and Rust tokens.

use naga::front::glsl::ErrorKind;

/// Words in messages that are meant for naga's developers.
const INNER: [&str; 12] = [
    "TypeInner",
    "Vector {",
    "Matrix {",
    "Scalar",
    "Pointer {",
    "ValuePointer",
    "Struct {",
    "Array {",
    "Handle(",
    "HirExpr",
    "kind:",
    "Span {",
];

/// The message for an error.
pub(super) fn message(kind: &ErrorKind) -> String {
    match kind {
        ErrorKind::EndOfFile => "unexpected end of the text".to_owned(),
        ErrorKind::InvalidToken(..) | ErrorKind::PreprocessorError(_) => {
            "this is not supported here".to_owned()
        }
        ErrorKind::NotImplemented(what) => format!("{what}: this is not supported here"),
        ErrorKind::UnknownVariable(name) => format!("`{name}` is not declared"),
        ErrorKind::UnknownType(name) => format!("there is no type `{name}`"),
        ErrorKind::UnknownField(name) => format!("there is no member `{name}`"),
        ErrorKind::UnknownLayoutQualifier(name) => format!("the layout `{name}` is not supported"),
        ErrorKind::UnsupportedMatrixWithTwoRowsInStd140 { columns } => {
            format!("a mat{columns}x2 is not supported in this block")
        }
        ErrorKind::VariableAlreadyDeclared(name) => format!("`{name}` is declared twice"),
        ErrorKind::SemanticError(text) => semantic(text),
        other => plain(&other.to_string()),
    }
}

fn semantic(text: &str) -> String {
    let named = |before: &str| Some(text.strip_prefix(before)?.trim_matches(['\'', '"']));
    if let Some(name) = named("Unknown function ") {
        return format!("no `{name}` takes these arguments");
    }
    if let Some(name) = named("Ambiguous best function for ") {
        return format!("`{name}` with these arguments is ambiguous");
    }
    if text.starts_with("Cannot apply operation to ") || text.starts_with("Cannot apply operator ")
    {
        return "this operator does not accept values of these types".to_owned();
    }
    if text.starts_with("Can't lookup field on this type ") {
        return "this type has no members".to_owned();
    }
    if text.contains("cannot be in the left hand side")
        || text == "Variable cannot be used in LHS position"
    {
        return "this cannot be assigned to".to_owned();
    }
    if text.starts_with("swizzle cannot have duplicate components") {
        return "a component appears twice".to_owned();
    }
    let known = match text {
        "Expression returns void" => "this returns nothing, but a value is expected",
        "Expression is not const-expression" => "this must be a constant",
        "Function already defined" => "this function is defined twice",
        "Prototype already defined" => "this function is declared twice",
        "const values must have an initializer" => "a constant needs a value",
        "Case values can only be integers" => "a case must be an integer constant",
        "Constructor: Too many arguments" => "too many values for this constructor",
        "Bad type constructor" => "this type cannot be constructed from that",
        "Bad call" => "a texture function does not accept these arguments",
        "Not a texture" | "Not a valid texture expression" | "Type is not an image" => {
            "this is not a texture"
        }
        "Type can't be void" | "Declaration cannot have void type" => {
            "the type cannot be void here"
        }
        "Increment/decrement only works on scalar/vector/matrix" => {
            "only numbers, vectors and matrices can be incremented or decremented"
        }
        "Invalid struct member type" => "this type cannot be in a block",
        "There must be at least one argument" => "an argument is missing",
        "image types require a format layout qualifier" => {
            "an image needs a format, as in `layout(rgba8)`"
        }
        "last case/default label must be followed by statements" => {
            "the last case has no statement"
        }
        "Array size must be greater than zero" => "an array needs at least one element",
        other => return plain(other),
    };
    known.to_owned()
}

/// The text, unless it is meant for naga's developers.
fn plain(text: &str) -> String {
    let numbered = text.split('[').skip(1).any(|rest| {
        let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
        digits > 0 && rest[digits..].starts_with(']')
    });
    match numbered || INNER.iter().any(|sign| text.contains(sign)) {
        true => "this type is wrong here, or not supported".to_owned(),
        false => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_handle_and_no_rust_comes_through() {
        for (text, says) in [
            (
                "Cannot apply operation to Pointer { base: [43], space: Function } and \
                 Scalar(Scalar { kind: Float, width: 4 })",
                "does not accept values",
            ),
            (
                "Can't resolve type: InvalidAccess { expr: [7], indexed: true }",
                "this type is wrong here",
            ),
            ("Unknown function 'max'", "no `max` takes"),
            (
                "constant_id value 3 is too high (maximum is 2)",
                "constant_id value 3",
            ),
        ] {
            let told = message(&ErrorKind::SemanticError(text.into()));
            assert!(told.contains(says), "{told}");
            assert!(!told.contains(['[', '{', '\'']), "{told}");
        }
    }
}
