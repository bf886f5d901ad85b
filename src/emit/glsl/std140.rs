//! Structs of uniform blocks, laid out by std140's rules where the IR has them (OpenGL 4.6, section 7.6.2.2): where WGSL leaves a gap that GLSL does not, floats of nobody's fill
//! it. naga writes neither WGSL's `@align` and `@size` nor an offset.

use std::collections::HashMap;

use naga::{AddressSpace, ArraySize, Handle, Module, ResourceBinding, Type, TypeInner};

use super::text::Unexpected;
use crate::emit::text;

/// How many floats stand before each member of a struct, and behind the last.
pub(super) type Paddings = HashMap<Handle<Type>, Vec<u32>>;

/// For the structs of all uniform blocks but `without`. An error names what std140 cannot have where the IR has it.
pub(super) fn paddings(
    module: &Module,
    without: Option<ResourceBinding>,
) -> Result<Paddings, String> {
    let mut out = Paddings::new();
    for (_, global) in module.global_variables.iter() {
        if global.space == AddressSpace::Uniform && (without.is_none() || global.binding != without)
        {
            let name = global.name.as_deref().unwrap_or("a uniform");
            layout(module, global.ty, name, &mut out)?;
        }
    }
    out.retain(|_, floats| floats.iter().any(|n| *n > 0));
    Ok(out)
}

/// Alignment and size in a block.
fn layout(
    module: &Module,
    ty: Handle<Type>,
    path: &str,
    out: &mut Paddings,
) -> Result<(u32, u32), String> {
    let vector = |n: u32, width: u32| (if n == 3 { 4 } else { n } * width, n * width);
    Ok(match &module.types[ty].inner {
        TypeInner::Scalar(scalar) => vector(1, scalar.width.into()),
        TypeInner::Vector { size, scalar } => vector(*size as u32, scalar.width.into()),
        TypeInner::Matrix {
            columns,
            rows,
            scalar,
        } => {
            let own = vector(*rows as u32, scalar.width.into()).0;
            if own < 16 {
                return Err(format!(
                    "`{path}`, a matrix of two rows, has 8 bytes a column"
                ));
            }
            (own, own * *columns as u32)
        }
        TypeInner::Array { base, size, stride } => {
            let (align, size_of_one) = layout(module, *base, path, out)?;
            let align = align.max(16);
            let ArraySize::Constant(n) = size else {
                return Err(format!("the length of `{path}` is not known"));
            };
            if size_of_one.next_multiple_of(align) != *stride {
                return Err(format!("an element of `{path}` has {stride} bytes"));
            }
            (align, stride * n.get())
        }
        TypeInner::Struct { members, span } => {
            let mut floats = Vec::new();
            let mut end = 0u32;
            let mut align = 16;
            for member in members {
                let path = format!("{path}.{}", member.name.as_deref().unwrap_or_default());
                let (own, size) = layout(module, member.ty, &path, out)?;
                align = align.max(own);
                let at = member.offset;
                if at % own != 0 || at < end.next_multiple_of(own) {
                    return Err(format!(
                        "`{path}` lies {at} bytes from the beginning of its struct"
                    ));
                }
                floats.push(match end.next_multiple_of(own) == at {
                    true => 0,
                    false => (at - end) / 4,
                });
                end = at + size;
            }
            let span = span.next_multiple_of(align);
            floats.push(match end.next_multiple_of(align) == span {
                true => 0,
                false => (span - end) / 4,
            });
            out.insert(ty, floats);
            (align, span)
        }
        _ => (16, 16),
    })
}

/// A struct's definition with its padding; `text` ends in `}` or `};`.
pub(super) fn padded_struct(text: &str, floats: &[u32]) -> Result<String, Unexpected> {
    let mut out = String::with_capacity(text.len());
    let mut copied = 0;
    let mut member = 0;
    let add = |out: &mut String, member: usize| -> Result<(), Unexpected> {
        let n = floats.get(member).copied();
        let n = n.ok_or_else(|| Unexpected(format!("`{text}`")))?;
        for i in 0..n {
            *out += &format!("\n    float padding_{member}_{i};");
        }
        Ok(())
    };
    for (_, range) in text::tokens(text) {
        let next = match &text[range.clone()] {
            "{" => 0,
            ";" if member + 1 < floats.len() => member + 1,
            _ => continue,
        };
        member = next;
        out.push_str(&text[copied..range.end]);
        copied = range.end;
        add(&mut out, member)?;
    }
    out.push_str(&text[copied..]);
    Ok(out)
}

/// The text with zeros for the padding wherever a struct is constructed.
pub(super) fn padded_constructors(text: &str, floats: &HashMap<String, Vec<u32>>) -> String {
    let mut out = String::with_capacity(text.len());
    let mut copied = 0;
    let mut before = "";
    // Of each open bracket: the padding of what it constructs, and the arguments so far.
    let mut open: Vec<Option<(&[u32], usize)>> = Vec::new();
    let zeros = |floats: &[u32], at: usize, form: &str| {
        form.repeat(floats.get(at).copied().unwrap_or(0) as usize)
    };
    for (_, range) in text::tokens(text) {
        let token = &text[range.clone()];
        let (at, insert) = match token {
            "(" | "[" | "{" => {
                let of = match token {
                    "(" => floats.get(before).map(|f| (f.as_slice(), 0)),
                    _ => None,
                };
                open.push(of);
                (range.end, of.map(|(f, _)| zeros(f, 0, "0.0, ")))
            }
            "," => match open.last_mut() {
                Some(Some((f, n))) => {
                    *n += 1;
                    (range.end, Some(zeros(f, *n, " 0.0,")))
                }
                _ => (range.end, None),
            },
            ")" | "]" | "}" => {
                let of = open.pop().flatten();
                (range.start, of.map(|(f, n)| zeros(f, n + 1, ", 0.0")))
            }
            _ => (range.end, None),
        };
        if let Some(insert) = insert.filter(|i| !i.is_empty()) {
            out.push_str(&text[copied..at]);
            out.push_str(&insert);
            copied = at;
        }
        before = token;
    }
    out.push_str(&text[copied..]);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn padding_goes_where_members_are() {
        let floats = vec![0, 1, 0, 2];
        let text = "struct S {\n    float a;\n    vec2 b[2];\n    float c;\n};";
        let padded = padded_struct(text, &floats).unwrap_or_else(|Unexpected(e)| e);
        assert_eq!(
            padded,
            "struct S {\n    float a;\n    float padding_1_0;\n    vec2 b[2];\n    float c;\n    float padding_3_0;\n    float padding_3_1;\n};"
        );
        let of = HashMap::from([("S".to_owned(), floats)]);
        assert_eq!(
            padded_constructors("x = f(S(a, S[2](p, q)[i], max(b, c)), d);", &of),
            "x = f(S(a, 0.0, S[2](p, q)[i], max(b, c), 0.0, 0.0), d);"
        );
    }
}
