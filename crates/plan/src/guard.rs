//! The values that a variant assumes, as data, and the check that a host runs before it draws.
//!
//! A variant that `specialize` made for `fog_density = 0` has no fog, and a loop that `hoist` moved
//! ends only if its bound is a sensible number. The plan therefore lists the assumed numbers with
//! their bounds. If a value leaves them, the host draws the original ([`crate::plan::ORIGINAL`]),
//! whose files are emitted together with the variant's.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The type of an assumed scalar.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum ScalarType {
    F32,
    I32,
    U32,
}

impl ScalarType {
    /// The type of naga's `scalar`; `None` if a guard can't hold it.
    pub fn of(scalar: naga::Scalar) -> Option<Self> {
        match (scalar.kind, scalar.width) {
            (naga::ScalarKind::Float, 4) => Some(Self::F32),
            (naga::ScalarKind::Sint, 4) => Some(Self::I32),
            (naga::ScalarKind::Uint, 4) => Some(Self::U32),
            _ => None,
        }
    }

    /// The number in four bytes, little endian.
    pub fn read(self, word: [u8; 4]) -> f64 {
        match self {
            Self::F32 => f64::from(f32::from_le_bytes(word)),
            Self::I32 => f64::from(i32::from_le_bytes(word)),
            Self::U32 => f64::from(u32::from_le_bytes(word)),
        }
    }
}

/// An inclusive range of numbers. `f64` holds every number of the three types. NaN is in no range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Bounds {
    /// Smallest number.
    pub low: f64,
    /// Largest number.
    pub high: f64,
}

impl Bounds {
    /// The range of one number.
    pub const fn one(number: f64) -> Self {
        Self {
            low: number,
            high: number,
        }
    }

    /// Whether a number is in the range.
    pub fn contains(&self, number: f64) -> bool {
        self.low <= number && number <= self.high
    }

    /// Whether no number is in both ranges.
    pub fn is_apart_from(&self, other: &Self) -> bool {
        // NaN bounds make an empty range.
        !(self.low <= other.high && other.low <= self.high)
    }

    /// The smallest range that contains both.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }
}

/// The source of an assumed number.
#[derive(
    Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case", tag = "from")]
pub enum Place {
    /// A scalar of a uniform buffer.
    Uniform {
        /// `@group`.
        group: u32,
        /// `@binding`.
        binding: u32,
        /// Byte offset in the binding.
        offset: u32,
    },
    /// A component of a vertex attribute, the same for every vertex and instance of the draw.
    Attribute {
        /// `@location`.
        location: u32,
        /// Index of the component.
        component: u32,
    },
    /// A channel of a texture, the same in every texel of every level.
    Texture {
        /// `@group`.
        group: u32,
        /// `@binding`.
        binding: u32,
        /// 0 for red to 3 for alpha.
        channel: u32,
    },
    /// A pipeline-overridable constant. The variant's text already contains its value, so only the
    /// original needs it set.
    Override {
        /// Its name.
        name: String,
    },
}

/// A number that a variant assumes to be within bounds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Assumed {
    /// The author's name for it: `material.fog_density`, `lights[1].color.x`.
    pub name: String,
    /// Its source.
    pub place: Place,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: ScalarType,
    /// Its range.
    #[serde(flatten)]
    pub bounds: Bounds,
}

impl std::fmt::Display for Assumed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Bounds { low, high } = self.bounds;
        let number = |n: f64| match self.ty {
            // As short as the type allows.
            ScalarType::F32 => (n as f32).to_string(),
            ScalarType::I32 | ScalarType::U32 => n.to_string(),
        };
        match low == high {
            true => write!(f, "{} = {}", self.name, number(low)),
            false => write!(f, "{} = {}..{}", self.name, number(low), number(high)),
        }
    }
}

/// All assumptions of a variant about the scene's values. Its text form lists them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Guard {
    /// Unique by place and type, and sorted by them.
    pub values: Vec<Assumed>,
}

impl std::fmt::Display for Guard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let values: Vec<String> = self.values.iter().map(ToString::to_string).collect();
        f.write_str(&values.join(", "))
    }
}

impl Guard {
    /// The condition that precedes a description: empty without a guard.
    pub fn condition(of: Option<&Self>) -> String {
        of.map_or_else(String::new, |guard| format!("with {guard}: "))
    }

    /// Adds another guard's assumptions. A number that both assume must be in both ranges.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        for assumed in other.values {
            let same = |a: &&mut Assumed| a.place == assumed.place && a.ty == assumed.ty;
            match self.values.iter_mut().find(same) {
                Some(have) => {
                    have.bounds.low = have.bounds.low.max(assumed.bounds.low);
                    have.bounds.high = have.bounds.high.min(assumed.bounds.high);
                }
                None => self.values.push(assumed),
            }
        }
        self.values
            .sort_by(|a, b| a.place.cmp(&b.place).then(a.ty.cmp(&b.ty)));
        self
    }

    /// Whether the uniforms of a draw match the assumptions; a host checks this whenever it writes
    /// one. `bytes` returns the content of a binding, by group and binding. A missing or short
    /// binding doesn't match. Attributes, textures and overrides are not checked: the host has to
    /// ensure them ([`Self::fixed`]).
    pub fn holds<'b>(&self, bytes: impl Fn(u32, u32) -> Option<&'b [u8]>) -> bool {
        self.violated(bytes).is_none()
    }

    /// The first uniform that doesn't match, as in [`Self::holds`].
    pub fn violated<'b>(&self, bytes: impl Fn(u32, u32) -> Option<&'b [u8]>) -> Option<&Assumed> {
        self.values.iter().find(|assumed| match assumed.place {
            Place::Uniform {
                group,
                binding,
                offset,
            } => {
                let word = bytes(group, binding)
                    .and_then(|b| b.get(offset as usize..)?.first_chunk::<4>().copied());
                !word.is_some_and(|w| assumed.bounds.contains(assumed.ty.read(w)))
            }
            _ => false,
        })
    }

    /// The first value with an empty range: two guards contradict each other.
    pub fn contradicted(&self) -> Option<&Assumed> {
        // NaN bounds make an empty range too.
        let is_empty = |a: &&Assumed| !matches!(a.bounds.low.partial_cmp(&a.bounds.high), Some(o) if o.is_le());
        self.values.iter().find(is_empty)
    }

    /// The assumptions about attributes, textures and overrides. A host that changes one of them
    /// draws the original.
    pub fn fixed(&self) -> impl Iterator<Item = &Assumed> {
        self.values
            .iter()
            .filter(|a| !matches!(a.place, Place::Uniform { .. }))
    }
}

#[cfg(test)]
mod tests {
    use super::{Assumed, Bounds, Guard, Place, ScalarType};

    fn fog(bounds: Bounds) -> Guard {
        Guard {
            values: vec![Assumed {
                name: "fog".to_owned(),
                place: Place::Uniform {
                    group: 1,
                    binding: 2,
                    offset: 4,
                },
                ty: ScalarType::F32,
                bounds,
            }],
        }
    }

    fn bytes(numbers: [f32; 2]) -> Vec<u8> {
        numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
    }

    #[test]
    fn holds_while_the_value_is_within_its_bounds() {
        let guard = fog(Bounds {
            low: 0.0,
            high: 0.5,
        });
        for (numbers, expected) in [
            ([9.0, 0.0], true),
            ([9.0, -0.0], true),
            ([9.0, 0.5], true),
            ([9.0, 0.500_000_06], false),
            ([0.0, -1e-38], false),
            ([0.0, f32::NAN], false),
        ] {
            let content = bytes(numbers);
            let at = |group, binding| ((group, binding) == (1, 2)).then_some(&content[..]);
            assert_eq!(guard.holds(at), expected, "{numbers:?}");
        }
        let short = bytes([0.0, 0.0]);
        assert!(!guard.holds(|_, _| short.get(..7)));
        assert!(!guard.holds(|_, _| None));
    }

    #[test]
    fn two_guards_hold_where_both_do() {
        let both = fog(Bounds {
            low: 0.0,
            high: 0.5,
        })
        .and(fog(Bounds {
            low: 0.25,
            high: 1.0,
        }));
        assert_eq!(both.values.len(), 1);
        assert_eq!(
            both.values[0].bounds,
            Bounds {
                low: 0.25,
                high: 0.5
            }
        );
        assert_eq!(both.contradicted(), None);
        let neither = both.clone().and(fog(Bounds::one(0.75)));
        assert_eq!(neither.contradicted().map(|a| &*a.name), Some("fog"));
        let json = serde_json::to_string(&both).unwrap_or_default();
        assert_eq!(serde_json::from_str::<Guard>(&json).ok(), Some(both));
    }
}
