//! What a user chooses of a visibility buffer.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::jumps::Taken;
use super::refuse;
use crate::analysis::opaque::Opaque;
use crate::core::geometry::Formats;
use crate::core::pass::{Facts, Refusal};
use crate::core::plan::AttachmentFormat;
use crate::core::rasterizer::{Corners, Neighbours, Rasterizer};
use crate::rebuild::depth_only::{Invariance, VertexStage};

/// How the id pass knows a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Ids {
    /// By the builtin `primitive_index`, which is a feature of the adapter.
    #[default]
    PrimitiveIndex,
    /// By vertices that no two triangles share, each fetched out of storage buffers: on any adapter.
    Unindexed,
}

/// Words of an id.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Words {
    /// `rg32uint`: as many instances and triangles as there may be.
    #[default]
    Two,
    /// `r32uint`, split by how many of each the frame has. A host refuses what does not fit.
    One,
}

impl Words {
    /// Format of the attachment of ids.
    pub fn format(self) -> AttachmentFormat {
        AttachmentFormat::Color(self.color().to_owned())
    }

    pub(super) fn color(self) -> &'static str {
        match self {
            Self::Two => "rg32uint",
            Self::One => "r32uint",
        }
    }
}

/// How a draw's resolve passes over the pixels of other draws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Select {
    /// By the depth test: a pass over the frame writes the number of each pixel's draw as a depth, and a draw's resolve compares EQUAL with its own.
    #[default]
    Depth,
    /// By looking at the id, in the fragment stage: no further pass, for frames of one draw or few.
    Id,
    /// By a list of the tiles that show the draw, which a compute pass makes; within a tile by looking at the id.
    Tiles,
}

/// Where pixels are shaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// In the fragment stage of a pass over the screen.
    #[default]
    Fragment,
    /// In a compute pass over the screen, which writes the colour as a storage texture.
    Compute,
    /// As `compute`, over pixels that compute passes have sorted by instance: neighbouring invocations fetch the same instance's data.
    Binned,
}

/// Where a resolve has the vertex stage's results of a triangle's corners from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Vertices {
    /// The vertices are refetched and the stage run for each pixel.
    #[default]
    Refetched,
    /// A compute pass runs the stage once for each vertex of each instance, ahead of the frame, and keeps what it gives: for stages that are dear, and few vertices.
    Kept,
}

/// Parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Params {
    /// Where pixels are shaded.
    pub form: Form,
    /// How the id pass knows a triangle.
    pub ids: Ids,
    /// Words of an id.
    pub words: Words,
    /// How a draw's resolve passes over the pixels of other draws. Default: `depth`; with `form=compute`, which has no depth test, `id`. `form=binned` has a list of the draw's own pixels, and takes none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub select: Option<Select>,
    /// Formats that the attributes of vertices may be stored in.
    pub formats: Formats,
    /// Where the corners of a triangle lie when the resolve interpolates between them. Default: as the adapter was seen to do, else `held`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub corners: Option<Corners>,
    /// Which neighbours `dpdx`, `dpdy` and `fwidth` are taken of. Default: as the adapter was seen to do, else the pixel's `own`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub derivatives: Option<Neighbours>,
    /// Which neighbours `dpdxCoarse`, `dpdyCoarse` and `fwidthCoarse` are taken of. Default: as seen, else the `quad`'s first pixel's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coarse: Option<Neighbours>,
    /// Which neighbours a texture sample's implicit level is taken of, cubes aside. Default: as seen, else the `quad`'s first pixel's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples: Option<Neighbours>,
    /// Which neighbours the implicit level of a cube texture's sample is taken of. Default: as seen, else the `quad`'s first pixel's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cubes: Option<Neighbours>,
    /// Where the resolve has the vertex stage's results from.
    pub vertices: Vertices,
    /// Vertex stage of the id pass: the author's whole one with the id beside its outputs, or its slice. Default: `sliced` where the author's position is `@invariant`, else `same`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertex: Option<VertexStage>,
    /// Whether `@invariant` is added to the id pass's position; default: `as-written` with `vertex=same`, `add` with `vertex=sliced`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub invariant: Option<Invariance>,
    /// The largest difference of a channel (`max_abs`) that is allowed, 0 to 1. Without one the promise is that of rounding: a step of 8 bits.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub budget: Option<f64>,
}

impl Params {
    /// With what is left to choose chosen, by what is known of the adapter.
    pub(super) fn resolved(&self, facts: &Facts) -> Result<Self, Box<Refusal>> {
        let select = match (self.form, self.select) {
            (Form::Fragment, select) => Some(select.unwrap_or_default()),
            (Form::Compute, None) => Some(Select::Id),
            (Form::Compute, Some(Select::Depth)) => {
                return Err(Box::new(refuse(
                    "select",
                    "a compute pass has no depth test to tell draws apart by",
                    "leave select out, or take select=tiles",
                )));
            }
            (Form::Compute, select) => select,
            (Form::Binned, None) => None,
            (Form::Binned, Some(_)) => {
                return Err(Box::new(refuse(
                    "select",
                    "with form=binned each draw has a list of its own pixels, and nothing is left to select",
                    "leave select out",
                )));
            }
        };
        let seen = facts.rasterizer.unwrap_or_default();
        Ok(Self {
            select,
            corners: self.corners.or(Some(seen.corners)),
            derivatives: self.derivatives.or(Some(seen.derivatives)),
            coarse: self.coarse.or(Some(seen.coarse)),
            samples: self.samples.or(Some(seen.samples)),
            cubes: self.cubes.or(Some(seen.cubes)),
            ..self.clone()
        })
    }

    /// With nothing said of corners where nothing is interpolated between them, nor of neighbours that the stage takes nothing of: what a plan says it rests on.
    pub(super) fn of_taken(&self, interpolated: bool, taken: Taken) -> Self {
        let kept = |is_taken: bool, said: Option<Neighbours>| said.filter(|_| is_taken);
        Self {
            corners: self.corners.filter(|_| interpolated),
            derivatives: kept(taken.derivatives, self.derivatives),
            coarse: kept(taken.coarse, self.coarse),
            samples: kept(taken.samples, self.samples),
            cubes: kept(taken.cubes, self.cubes),
            ..self.clone()
        }
    }

    /// What is said of the adapter that was seen to do otherwise, each as `parameter=choice` beside what was seen.
    pub(super) fn contradicting(&self, seen: &Rasterizer) -> Vec<[String; 2]> {
        // `held` has corners as given, too.
        let are_given = |corners: Corners| corners != Corners::Snapped;
        let corners = self.corners.filter(|said| match said {
            Corners::Held => !are_given(seen.corners),
            said => *said != seen.corners,
        });
        let neighbours = [
            ("derivatives", self.derivatives, seen.derivatives),
            ("coarse", self.coarse, seen.coarse),
            ("samples", self.samples, seen.samples),
            ("cubes", self.cubes, seen.cubes),
        ];
        let of_neighbours = neighbours.into_iter().filter_map(|(name, said, seen)| {
            let said = said.filter(|said| *said != seen)?;
            Some([format!("{name}={}", word(said)), word(seen)])
        });
        corners
            .map(|said| [format!("corners={}", word(said)), word(seen.corners)])
            .into_iter()
            .chain(of_neighbours)
            .collect()
    }

    /// Pixels of other draws are not listed by `form=binned`.
    pub(super) fn select(&self) -> Select {
        self.select.unwrap_or_default()
    }

    /// What the resolve does as a rasteriser.
    pub(super) fn rasterizer(&self) -> Rasterizer {
        let usual = Rasterizer::default();
        Rasterizer {
            corners: self.corners.unwrap_or(usual.corners),
            derivatives: self.derivatives.unwrap_or(usual.derivatives),
            coarse: self.coarse.unwrap_or(usual.coarse),
            samples: self.samples.unwrap_or(usual.samples),
            cubes: self.cubes.unwrap_or(usual.cubes),
        }
    }

    /// Two texts of one position are the same bits under `@invariant` alone: without it, the author's stage is left whole, so that as much as can be is alike.
    pub(super) fn vertex(&self, opaque: &Opaque<'_>) -> VertexStage {
        self.vertex
            .unwrap_or(match opaque.has_invariant_position() {
                true => VertexStage::Sliced,
                false => VertexStage::Same,
            })
    }

    pub(super) fn invariant(&self, opaque: &Opaque<'_>) -> Invariance {
        self.invariant
            .unwrap_or_else(|| Invariance::default_for(self.vertex(opaque)))
    }
}

/// A choice as a recipe spells it.
fn word(choice: impl Serialize) -> String {
    match serde_json::to_value(choice) {
        Ok(serde_json::Value::String(word)) => word,
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_interpolates_from_snapped_corners_does_not_do_as_held_says() {
        let told = |said, seen| {
            let params = Params {
                corners: Some(said),
                ..Params::default()
            };
            let seen = Rasterizer {
                corners: seen,
                ..Rasterizer::default()
            };
            !params.contradicting(&seen).is_empty()
        };
        use Corners::{AsGiven, Held, Snapped};
        let contradicted = [(Held, Snapped), (AsGiven, Snapped), (Snapped, AsGiven)];
        for (said, seen) in contradicted {
            assert!(told(said, seen), "{said:?} {seen:?}");
        }
        for (said, seen) in [(Held, AsGiven), (AsGiven, AsGiven), (Snapped, Snapped)] {
            assert!(!told(said, seen), "{said:?} {seen:?}");
        }
    }
}
