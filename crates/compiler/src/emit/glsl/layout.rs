//! Pads the structs of blocks so that std140 or std430 (OpenGL 4.6, 7.6.2.2) gives the IR's
//! offsets. naga writes neither `@align`, `@size` nor offsets.

use std::collections::{HashMap, HashSet};

use naga::{AddressSpace, ArraySize, Handle, Module, ResourceBinding, Type, TypeInner};

use super::text::Unexpected;
use shader_text::tokens as text;

/// The number of floats before each member of a struct, and at its end.
pub(super) type Paddings = HashMap<Handle<Type>, Vec<u32>>;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rules {
    Std140,
    Std430,
}

/// The layouts of a module's blocks.
#[derive(Debug, Default)]
pub(super) struct Layouts {
    pub paddings: Paddings,
    /// Storage blocks in std140 instead of std430, which naga always declares.
    pub std140: HashSet<ResourceBinding>,
}

/// Lays out all blocks except `without`. Errors name a block that cannot have the IR's offsets.
pub(super) fn layouts(
    module: &Module,
    is_without: &dyn Fn(Option<ResourceBinding>) -> bool,
) -> Result<Layouts, String> {
    let mut out = Layouts::default();
    let mut fixed: Vec<(Handle<Type>, Rules)> = Vec::new();
    let name = |global: &naga::GlobalVariable| global.name.clone().unwrap_or("a block".to_owned());
    let globals = || module.global_variables.iter().map(|(_, g)| g);
    for global in globals().filter(|g| g.space == AddressSpace::Uniform) {
        if !is_without(global.binding) {
            padded(
                module,
                global.ty,
                Rules::Std140,
                &name(global),
                &mut out.paddings,
            )?;
            fixed.push((global.ty, Rules::Std140));
        }
    }
    for global in globals().filter(|g| matches!(g.space, AddressSpace::Storage { .. })) {
        // A struct of several blocks needs one padding that fits all.
        let tried = |rules: Rules, fixed: &[(Handle<Type>, Rules)]| {
            let mut paddings = out.paddings.clone();
            padded(module, global.ty, rules, &name(global), &mut paddings)?;
            for (ty, rules) in fixed.iter().chain([&(global.ty, rules)]) {
                check(module, *ty, *rules, &name(global), &paddings)?;
            }
            Ok::<_, String>(paddings)
        };
        let (rules, paddings) = match tried(Rules::Std430, &fixed) {
            Ok(paddings) => (Rules::Std430, paddings),
            Err(tight) => match tried(Rules::Std140, &fixed) {
                Ok(paddings) => (Rules::Std140, paddings),
                Err(_) => return Err(tight),
            },
        };
        fixed.push((global.ty, rules));
        out.paddings = paddings;
        if rules == Rules::Std140 {
            out.std140.extend(global.binding);
        }
    }
    out.paddings
        .retain(|_, floats| floats.iter().any(|n| *n > 0));
    Ok(out)
}

/// Alignment and size of a scalar or vector.
fn vector(n: u32, width: u8) -> (u32, u32) {
    let width = u32::from(width);
    (if n == 3 { 4 } else { n } * width, n * width)
}

/// Alignment and size of a type that is not a struct; `inner` returns those of its element.
fn plain(
    module: &Module,
    ty: Handle<Type>,
    rules: Rules,
    path: &str,
    mut inner: impl FnMut(Handle<Type>) -> Result<(u32, u32), String>,
) -> Result<(u32, u32), String> {
    let least = match rules {
        Rules::Std140 => 16,
        Rules::Std430 => 1,
    };
    Ok(match &module.types[ty].inner {
        TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar) => vector(1, scalar.width),
        TypeInner::Vector { size, scalar } => vector(*size as u32, scalar.width),
        TypeInner::Matrix {
            columns,
            rows,
            scalar,
        } => {
            let own = vector(*rows as u32, scalar.width).0;
            if own < least {
                return Err(format!(
                    "`{path}`, a matrix of two rows, has 8 bytes a column"
                ));
            }
            (own, own * *columns as u32)
        }
        TypeInner::Array { base, size, stride } => {
            let (align, size_of_one) = inner(*base)?;
            let align = align.max(least);
            let n = match size {
                ArraySize::Constant(n) => n.get(),
                // The unsized last member of a storage block.
                ArraySize::Dynamic => 0,
                ArraySize::Pending(_) => {
                    return Err(format!("the length of `{path}` is not known"));
                }
            };
            if size_of_one.next_multiple_of(align) != *stride {
                return Err(format!("an element of `{path}` has {stride} bytes"));
            }
            (align, stride.saturating_mul(n))
        }
        _ => (16, 16),
    })
}

/// Alignment and size in a block. Records the required padding, or the larger one.
fn padded(
    module: &Module,
    ty: Handle<Type>,
    rules: Rules,
    path: &str,
    out: &mut Paddings,
) -> Result<(u32, u32), String> {
    let TypeInner::Struct { members, span } = &module.types[ty].inner else {
        return plain(module, ty, rules, path, |of| {
            padded(module, of, rules, path, out)
        });
    };
    let mut floats = Vec::new();
    let mut end = 0u32;
    let mut align = if rules == Rules::Std140 { 16 } else { 1 };
    for member in members {
        let path = format!("{path}.{}", member.name.as_deref().unwrap_or_default());
        let (own, size) = padded(module, member.ty, rules, &path, out)?;
        align = align.max(own);
        let at = member.offset;
        if at % own != 0 || at < end {
            return Err(format!("`{path}` is at byte {at} of its struct"));
        }
        floats.push(match end.next_multiple_of(own) == at {
            true => 0,
            false => (at - end) / 4,
        });
        end = at + size;
    }
    let open = members
        .last()
        .is_some_and(|m| module.types[m.ty].inner.is_dynamically_sized(&module.types));
    let span = span.next_multiple_of(align).max(end);
    floats.push(match open || end.next_multiple_of(align) == span {
        true => 0,
        false => (span - end) / 4,
    });
    let noted = out.entry(ty).or_insert_with(|| floats.clone());
    for (noted, own) in noted.iter_mut().zip(floats) {
        *noted = own.max(*noted);
    }
    Ok((align, span))
}

/// Alignment and size with these paddings; an error if an offset differs from the IR.
fn check(
    module: &Module,
    ty: Handle<Type>,
    rules: Rules,
    path: &str,
    paddings: &Paddings,
) -> Result<(u32, u32), String> {
    let TypeInner::Struct { members, .. } = &module.types[ty].inner else {
        return plain(module, ty, rules, path, |of| {
            check(module, of, rules, path, paddings)
        });
    };
    let floats = paddings.get(&ty).map(Vec::as_slice).unwrap_or_default();
    // The offset after the padding, which must begin at a multiple of 4.
    let behind = |end: u32, i: usize| match floats.get(i).copied().unwrap_or(0) {
        0 => end,
        n => end.next_multiple_of(4) + 4 * n,
    };
    let mut end = 0u32;
    let mut align = if rules == Rules::Std140 { 16 } else { 1 };
    for (i, member) in members.iter().enumerate() {
        let path = format!("{path}.{}", member.name.as_deref().unwrap_or_default());
        let (own, size) = check(module, member.ty, rules, &path, paddings)?;
        align = align.max(own);
        let at = member.offset;
        if behind(end, i).next_multiple_of(own) != at {
            return Err(format!("`{path}` is at byte {at} of its struct"));
        }
        end = at + size;
    }
    Ok((align, behind(end, members.len()).next_multiple_of(align)))
}

/// Adds padding to a struct's definition. `text` ends in `}` or `};`.
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

/// Adds zeros for padding to struct constructors.
pub(super) fn padded_constructors(text: &str, floats: &HashMap<String, Vec<u32>>) -> String {
    let mut out = String::with_capacity(text.len());
    let mut copied = 0;
    let mut before = "";
    // For each open bracket: the padding of the constructed struct, and the arguments so far.
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
            "struct S {\n    float a;\n    float padding_1_0;\n    vec2 b[2];\n    float c;\n    \
             float padding_3_0;\n    float padding_3_1;\n};"
        );
        let of = HashMap::from([("S".to_owned(), floats)]);
        assert_eq!(
            padded_constructors("x = f(S(a, S[2](p, q)[i], max(b, c)), d);", &of),
            "x = f(S(a, 0.0, S[2](p, q)[i], max(b, c), 0.0, 0.0), d);"
        );
    }
}
