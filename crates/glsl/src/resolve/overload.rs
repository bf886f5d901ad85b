//! Overload resolution (GLSL 4.60, 6.1).

use naga::Span;

use super::Resolver;
use crate::errors::wrong;
use crate::stage::{Signature, Storage};
use crate::ty::{Component, Ty};
use shader_text::error::Error;

/// The conversion of an argument.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Conversion {
    Exact,
    FloatToDouble,
    IntToFloat,
    IntToDouble,
    Other,
}

impl Conversion {
    /// Whether it is a better match for the same argument. GLSL ranks no other pairs.
    fn beats(self, other: Self) -> bool {
        use Conversion::{Exact, FloatToDouble, IntToDouble, IntToFloat};
        match (self, other) {
            (a, b) if a == b => false,
            (Exact, _) => true,
            (_, Exact) => false,
            (FloatToDouble, _) => true,
            (_, FloatToDouble) => false,
            (IntToFloat, IntToDouble) => true,
            _ => false,
        }
    }
}

/// Whether the types are equal. An unsized array equals any length.
pub(super) fn is_same(a: &Ty, b: &Ty) -> bool {
    match (a, b) {
        (Ty::Array(a, n), Ty::Array(b, m)) => {
            (n == m || n.is_none() || m.is_none()) && is_same(a, b)
        }
        _ => a == b,
    }
}

/// The implicit conversion between two types (4.60, 4.1.10).
pub(super) fn conversion(from: &Ty, to: &Ty, implicit: bool) -> Option<Conversion> {
    if is_same(from, to) {
        return Some(Conversion::Exact);
    }
    let (a, b) = (from.kind()?, to.kind()?);
    if !implicit || from.with_kind(b) != *to {
        return None;
    }
    match (a, b) {
        (Component::Float, Component::Double) => Some(Conversion::FloatToDouble),
        (Component::Int | Component::Uint, Component::Float) => Some(Conversion::IntToFloat),
        (Component::Int | Component::Uint, Component::Double) => Some(Conversion::IntToDouble),
        (Component::Int, Component::Uint)
        | (Component::Int | Component::Uint, Component::Half)
        | (Component::Half, Component::Float | Component::Double) => Some(Conversion::Other),
        _ => None,
    }
}

/// The conversion of each argument, if the signature fits.
fn conversions(signature: &Signature, given: &[&Ty], implicit: bool) -> Option<Vec<Conversion>> {
    if signature.parameters.len() != given.len() {
        return None;
    }
    let each = signature.parameters.iter().zip(given);
    each.map(|((storage, to), from)| match storage {
        Storage::Out => conversion(to, from, implicit),
        // In both directions.
        Storage::InOut => conversion(from, to, implicit).filter(|c| *c == Conversion::Exact),
        _ => conversion(from, to, implicit),
    })
    .collect()
}

/// The result of overload resolution.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum OverloadChoice {
    One(usize),
    None,
    /// Several fit, and none is best.
    Several(Vec<usize>),
}

/// Finds the signature that fits best.
pub(super) fn choose(signatures: &[Signature], given: &[&Ty], implicit: bool) -> OverloadChoice {
    let fits: Vec<(usize, Vec<Conversion>)> = signatures
        .iter()
        .enumerate()
        .filter_map(|(i, s)| Some((i, conversions(s, given, implicit)?)))
        .collect();
    let beats = |a: &[Conversion], b: &[Conversion]| {
        let each = || a.iter().zip(b);
        each().any(|(a, b)| a.beats(*b)) && !each().any(|(a, b)| b.beats(*a))
    };
    let best = fits.iter().find(|(i, a)| {
        let mut others = fits.iter().filter(|(j, _)| j != i);
        others.all(|(_, b)| beats(a, b))
    });
    match (best, &fits[..]) {
        (Some((i, _)), _) => OverloadChoice::One(*i),
        (None, []) => OverloadChoice::None,
        (None, several) => OverloadChoice::Several(several.iter().map(|(i, _)| *i).collect()),
    }
}

/// A signature for messages: `f(float, out vec3)`.
fn shown(name: &str, signature: &Signature) -> String {
    let each = signature.parameters.iter().map(|(storage, ty)| {
        let word = match storage {
            Storage::Out => "out ",
            Storage::InOut => "inout ",
            _ => "",
        };
        format!("{word}{}", ty.name())
    });
    format!("`{name}({})`", each.collect::<Vec<_>>().join(", "))
}

impl Resolver<'_, '_> {
    /// Whether the dialect has implicit conversions. GLSL ES does not (3.20 only by extension).
    pub(super) fn is_implicit(&self) -> bool {
        !self.stage.unit.dialect.es
    }

    /// Index of the signature that a call selects.
    pub(super) fn overload(
        &self,
        name: &str,
        signatures: &[Signature],
        given: &[Ty],
        place: Option<Span>,
    ) -> Result<usize, Error> {
        let given: Vec<&Ty> = given.iter().collect();
        let list = |which: &[usize]| {
            let all = which.iter().filter_map(|i| signatures.get(*i));
            let all: Vec<String> = all.map(|s| shown(name, s)).collect();
            all.join(", ")
        };
        let called = || {
            let types: Vec<String> = given.iter().map(|t| t.name()).collect();
            types.join(", ")
        };
        let implicit = self.is_implicit();
        match choose(signatures, &given, implicit) {
            OverloadChoice::One(i) => Ok(i),
            OverloadChoice::Several(which) => Err(wrong(
                format!(
                    "`{name}` with ({}) is ambiguous: {}",
                    called(),
                    list(&which)
                ),
                place,
            )
            .note("convert an argument, so that one of them fits best")),
            OverloadChoice::None => {
                let all: Vec<usize> = (0..signatures.len()).collect();
                let error = wrong(format!("no `{name}` takes ({})", called()), place)
                    .note(format!("there is {}", list(&all)));
                let would = !implicit && choose(signatures, &given, true) != OverloadChoice::None;
                Err(match would {
                    true => error.note(
                        "GLSL ES has no implicit conversions: convert explicitly, as in `float(i)`",
                    ),
                    false => error,
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(signatures: &[&[&str]], given: &[&str], implicit: bool) -> OverloadChoice {
        let signatures: Vec<Signature> = signatures
            .iter()
            .map(|types| Signature {
                parameters: types
                    .iter()
                    .map(|t| match t.strip_prefix("out ") {
                        Some(t) => (Storage::Out, Ty::named(t)),
                        None => (Storage::In, Ty::named(t)),
                    })
                    .collect(),
                result: Ty::Void,
                declared: 0,
                has_body: true,
            })
            .collect();
        let given: Vec<Ty> = given.iter().map(|t| Ty::named(t)).collect();
        choose(&signatures, &given.iter().collect::<Vec<_>>(), implicit)
    }

    #[test]
    fn the_better_of_two_is_chosen_as_the_specification_has_it() {
        let three: &[&[&str]] = &[
            &["vec4", "out vec4"],
            &["vec4", "out uvec4"],
            &["ivec4", "out dvec4"],
        ];
        assert_eq!(
            chosen(three, &["vec4", "vec4"], true),
            OverloadChoice::One(0)
        );
        assert_eq!(
            chosen(three, &["vec4", "uvec4"], true),
            OverloadChoice::One(1)
        );
        // Out arguments convert in reverse: from float to double rather than from uint.
        assert_eq!(
            chosen(three, &["vec4", "dvec4"], true),
            OverloadChoice::One(0)
        );
        assert_eq!(
            chosen(three, &["ivec4", "vec4"], true),
            OverloadChoice::One(0)
        );
        assert_eq!(
            chosen(three, &["uvec4", "ivec4"], true),
            OverloadChoice::None
        );
    }

    #[test]
    fn conversions_have_ranks_and_es_has_none() {
        let floats: &[&[&str]] = &[&["double"], &["float"]];
        assert_eq!(chosen(floats, &["int"], true), OverloadChoice::One(1));
        assert_eq!(chosen(floats, &["int"], false), OverloadChoice::None);
        assert_eq!(chosen(floats, &["float"], false), OverloadChoice::One(1));
        let mixed: &[&[&str]] = &[&["uint"], &["float"]];
        assert_eq!(
            chosen(mixed, &["int"], true),
            OverloadChoice::Several(vec![0, 1])
        );
        let crossed: &[&[&str]] = &[&["float", "int"], &["int", "float"]];
        let several = OverloadChoice::Several(vec![0, 1]);
        assert_eq!(chosen(crossed, &["int", "int"], true), several);
        assert_eq!(
            chosen(crossed, &["int", "float"], true),
            OverloadChoice::One(1)
        );
        assert_eq!(
            chosen(&[&["bool"], &["int"]], &["float"], true),
            OverloadChoice::None
        );
    }
}
