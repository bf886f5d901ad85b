//! Compares two results by a promise's rule.

use naga::BuiltIn;

use super::stage::{POSITION, Ran, Slot};
use naga_interp::{Number, Scalar, Value};
use preshade_plan::state::DepthDirection;

/// The promise about a variant's colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Colors {
    Bits,
    /// Equal numbers: 0 is -0.
    Numbers,
    /// At most this far off, in each channel.
    Within(f64),
    /// Not compared.
    Ignored,
    /// The alpha of location 0 is bitwise equal, because it decides coverage.
    Alpha,
}

/// The permitted differences between the discards of variant and original.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Discards {
    Same,
    /// Another pass has discarded these fragments already, and this one compares for EQUAL.
    LeftToEqual,
    /// The variant may also discard fragments strictly behind the present depth.
    Hidden {
        /// The fragment's depth.
        own: f32,
        /// The depth in the buffer.
        other: f32,
        /// Which way depth grows.
        direction: DepthDirection,
    },
}

/// The promise about depths that a fragment stage writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Depths {
    /// The same bits.
    Same,
    NotNearer(DepthDirection),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Positions {
    Bits,
    /// Equal numbers: 0 is -0.
    Numbers,
}

/// The promise about memory writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stores {
    /// The same bits.
    Same,
    /// Not compared: another pass writes it.
    Ignored,
}

/// The parts that must be equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Rule {
    /// The vertex outputs that rasterisation uses.
    Vertices(Positions),
    Fragments {
        colors: Colors,
        discards: Discards,
        depths: Depths,
        stores: Stores,
    },
}

/// A difference, with both values as text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Difference {
    pub output: String,
    /// The original's value.
    pub original: String,
    /// The variant's value.
    pub variant: String,
}

/// The first difference that a rule forbids.
pub(crate) fn difference<F: Number>(
    rule: Rule,
    original: &Ran<F>,
    variant: &Ran<F>,
) -> Option<Difference> {
    match rule {
        Rule::Vertices(positions) => vertices(original, variant, positions),
        Rule::Fragments {
            colors,
            discards,
            depths,
            stores,
        } => fragment(original, variant, discards)
            .map_or_else(|| memory(original, variant, stores), Some)
            .or_else(|| {
                // A discarded fragment is invisible.
                let is_seen = !original.discarded && !variant.discarded;
                is_seen
                    .then(|| colors_and_depth(original, variant, colors, depths))
                    .flatten()
            }),
    }
}

fn differ(
    output: impl ToString,
    original: impl ToString,
    variant: impl ToString,
) -> Option<Difference> {
    Some(Difference {
        output: output.to_string(),
        original: original.to_string(),
        variant: variant.to_string(),
    })
}

fn slot_differs<F: Number>(
    slot: Slot,
    original: &Ran<F>,
    variant: &Ran<F>,
    same: &dyn Fn(&Value<F>, &Value<F>) -> bool,
) -> Option<Difference> {
    match (original.outputs.get(&slot), variant.outputs.get(&slot)) {
        (None, None) => None,
        (Some(a), Some(b)) if same(a, b) => None,
        (a, b) => {
            let said = |v: Option<&Value<F>>| v.map_or("nothing".to_owned(), text);
            differ(slot, said(a), said(b))
        }
    }
}

fn vertices<F: Number>(
    original: &Ran<F>,
    variant: &Ran<F>,
    positions: Positions,
) -> Option<Difference> {
    let same = |a: &Value<F>, b: &Value<F>| match positions {
        Positions::Bits => same_bits(a, b),
        Positions::Numbers => near(a, b, 0.0),
    };
    let builtins = original.outputs.keys().copied();
    let builtins = builtins.filter(|slot| matches!(slot, Slot::BuiltIn(_)));
    // A vertex stage always has a position.
    builtins
        .chain([POSITION])
        .find_map(|slot| slot_differs(slot, original, variant, &same))
}

/// Compares whether a fragment survives.
fn fragment<F: Number>(
    original: &Ran<F>,
    variant: &Ran<F>,
    discards: Discards,
) -> Option<Difference> {
    let said = |discarded| if discarded { "discarded" } else { "kept" };
    let is_allowed = match (original.discarded, variant.discarded, discards) {
        (true, false, Discards::LeftToEqual) => true,
        (
            false,
            true,
            Discards::Hidden {
                own,
                other,
                direction,
            },
        ) => {
            // The shader's depth is clamped.
            let written = original.outputs.get(&FRAG_DEPTH);
            let written = written.and_then(|v| v.float().ok()?.single());
            let own = written.map_or(own, |depth| depth.clamp(0.0, 1.0));
            // A NaN depth is neither behind nor before anything.
            own.is_nan()
                || match direction {
                    DepthDirection::Forward => own > other,
                    DepthDirection::Reversed => own < other,
                }
        }
        (original, variant, _) => original == variant,
    };
    match is_allowed {
        true => None,
        false => differ(
            "the fragment",
            said(original.discarded),
            said(variant.discarded),
        ),
    }
}

fn memory<F: Number>(original: &Ran<F>, variant: &Ran<F>, stores: Stores) -> Option<Difference> {
    if stores == Stores::Ignored || original.discarded != variant.discarded {
        return None;
    }
    original
        .stored
        .iter()
        .find_map(|(at, value)| match variant.stored.get(at) {
            Some(other) if same_bits(value, other) => None,
            other => differ(
                format!("buffer {at:?}"),
                text(value),
                other.map_or("nothing".to_owned(), text),
            ),
        })
}

fn colors_and_depth<F: Number>(
    original: &Ran<F>,
    variant: &Ran<F>,
    colors: Colors,
    depths: Depths,
) -> Option<Difference> {
    let depth = |a: &Value<F>, b: &Value<F>| match depths {
        Depths::Same => same_bits(a, b),
        Depths::NotNearer(direction) => not_nearer(a, b, direction),
    };
    if let Some(found) = slot_differs(FRAG_DEPTH, original, variant, &depth) {
        return Some(found);
    }
    if colors == Colors::Ignored {
        return None;
    }
    let others = original.outputs.keys().copied();
    let others = others.filter(|slot| *slot != FRAG_DEPTH);
    others
        .filter(|slot| colors != Colors::Alpha || *slot == Slot::Location(0, None))
        .find_map(|slot| {
            slot_differs(slot, original, variant, &|a, b| match (slot, colors) {
                (Slot::BuiltIn(_), _) | (_, Colors::Bits) => same_bits(a, b),
                (_, Colors::Alpha) => same_bits(&alpha(a), &alpha(b)),
                (_, Colors::Numbers) => near(a, b, 0.0),
                (_, Colors::Within(most)) => near(a, b, most),
                (_, Colors::Ignored) => true,
            })
        })
}

const FRAG_DEPTH: Slot = Slot::BuiltIn(BuiltIn::FragDepth);

fn alpha<F: Number>(color: &Value<F>) -> Value<F> {
    match color {
        Value::Composite(parts) if parts.len() == 4 => parts[3].clone(),
        other => other.clone(),
    }
}

/// Whether two values are bitwise equal, where any two NaNs are equal: no operation promises NaN
/// bits.
pub(crate) fn same_bits<F: Number>(a: &Value<F>, b: &Value<F>) -> bool {
    let is_nan = |x: F| x.single().is_some_and(f32::is_nan);
    every(a, b, &|a, b| match (a, b) {
        (Scalar::F32(a), Scalar::F32(b)) => a.is_same(b) || (is_nan(a) && is_nan(b)),
        (a, b) => a == b,
    })
}

fn near<F: Number>(a: &Value<F>, b: &Value<F>, most: f64) -> bool {
    every(a, b, &|a, b| match (a, b) {
        (Scalar::F32(a), Scalar::F32(b)) => match (a.single(), b.single()) {
            (Some(a), Some(b)) if a.is_finite() => (f64::from(a) - f64::from(b)).abs() <= most,
            (Some(_), Some(_)) => true,
            _ => a.is_same(b),
        },
        (a, b) => a == b,
    })
}

fn not_nearer<F: Number>(a: &Value<F>, b: &Value<F>, direction: DepthDirection) -> bool {
    every(a, b, &|a, b| match (a, b) {
        (Scalar::F32(a), Scalar::F32(b)) => match (a.single(), b.single()) {
            // A depth is clamped before the comparison.
            (Some(a), Some(b)) => {
                let away = b.clamp(0.0, 1.0) - a.clamp(0.0, 1.0);
                a.is_nan() || away * direction.away() >= 0.0
            }
            _ => a.is_same(b),
        },
        (a, b) => a == b,
    })
}

/// Whether two values in twice the digits are one, but for rounding: no component differs by more
/// than `most` of the largest, or of 1.
pub(super) fn is_close(a: &Value<f64>, b: &Value<f64>, most: f64) -> bool {
    fn flat(value: &Value<f64>, all: &mut Vec<f64>) -> bool {
        match value {
            Value::Scalar(Scalar::F32(x)) => all.push(*x),
            Value::Composite(parts) => return parts.iter().all(|p| flat(p, all)),
            _ => return false,
        }
        true
    }
    let (mut x, mut y) = (Vec::new(), Vec::new());
    if !(flat(a, &mut x) && flat(b, &mut y)) || x.len() != y.len() {
        return *a == *b;
    }
    let largest = x.iter().fold(1.0_f64, |most, v| most.max(v.abs()));
    x.iter()
        .zip(&y)
        .all(|(a, b)| (a - b).abs() <= largest * most)
}

fn every<F: Number>(
    a: &Value<F>,
    b: &Value<F>,
    same: &dyn Fn(Scalar<F>, Scalar<F>) -> bool,
) -> bool {
    match (a, b) {
        (Value::Scalar(a), Value::Scalar(b)) => same(*a, *b),
        (Value::Composite(a), Value::Composite(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| every(a, b, same))
        }
        (a, b) => a == b,
    }
}

/// A value as text; a long one is cut.
pub(crate) fn text<F: Number>(value: &Value<F>) -> String {
    const MOST: usize = 160;
    fn write<F: Number>(value: &Value<F>, out: &mut String) {
        if out.len() > MOST {
            return;
        }
        match value {
            Value::Scalar(Scalar::F32(x)) => match x.single() {
                Some(x) => out.push_str(&format!("{x:?}")),
                None => out.push_str(&format!("{x:?}")),
            },
            Value::Scalar(Scalar::I32(x)) => out.push_str(&x.to_string()),
            Value::Scalar(Scalar::U32(x)) => out.push_str(&format!("{x}u")),
            Value::Scalar(Scalar::Bool(x)) => out.push_str(&x.to_string()),
            Value::Composite(parts) => {
                out.push('(');
                for (i, part) in parts.iter().enumerate() {
                    if i > 0 {
                        out.push_str(", ");
                    }
                    write(part, out);
                }
                out.push(')');
            }
            other => out.push_str(&format!("{other:?}")),
        }
    }
    let mut out = String::new();
    write(value, &mut out);
    if out.len() > MOST {
        let end = out.floor_char_boundary(MOST);
        out.truncate(end);
        out.push_str(" ..");
    }
    out
}
