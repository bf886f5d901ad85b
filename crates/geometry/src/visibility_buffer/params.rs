//! The parameters of a visibility buffer.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::differences::Taken;
use super::{refusals, refuse};
use preshade_passes::analysis::opaque::Opaque;
use preshade_passes::rebuild::depth_only::{Invariance, VertexStage};
use preshade_plan::draw_table::Words;
use preshade_plan::geometry::Formats;
use preshade_plan::pass::{Facts, Refusal};
use preshade_plan::rasterizer::{Corners, Neighbours, Rasterizer};

/// How the id pass knows a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Ids {
    /// From the builtin `primitive_index`, which needs an adapter feature.
    #[default]
    PrimitiveIndex,
    /// From unshared vertices that are fetched from storage buffers: works on any adapter.
    Unindexed,
}

/// How a draw's resolve skips the pixels of other draws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Select {
    /// By the depth test: one pass writes each pixel's draw number as depth, and a draw's resolve
    /// compares EQUAL with its number.
    #[default]
    Depth,
    /// By reading the id in the fragment stage: no extra pass, for frames with few draws.
    Id,
    /// By a list of tiles per draw, which a compute pass creates; within a tile by reading the id.
    Tiles,
}

/// Where pixels are shaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ShadingForm {
    /// In the fragment stage of a full-screen pass.
    #[default]
    Fragment,
    /// In a full-screen compute pass that writes a storage texture.
    Compute,
    /// As `compute`, over pixels sorted by instance: adjacent invocations fetch the same instance's
    /// data.
    Binned,
}

/// The source of the vertex results at a triangle's corners.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Vertices {
    /// Each pixel refetches the vertices and runs the vertex stage.
    #[default]
    Refetched,
    /// A compute pass runs the vertex stage once per vertex and instance before the frame and
    /// stores the results: for expensive stages and few vertices.
    Kept,
}

/// Parameters. A user decides the first four. The others are for tests, for devices without a
/// feature, and to override what was measured of the adapter ([`Facts::rasterizer`]); listings
/// mention them apart.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct VisibilityParams {
    /// Largest allowed difference of a channel (`max_abs`), 0 to 1. Without it the contract is
    /// rounding: a step of 8 bits.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub budget: Option<f64>,
    /// Where pixels are shaded.
    pub form: ShadingForm,
    /// How a draw's resolve skips the pixels of other draws. Default: `depth`, or `id` with
    /// `form=compute`, which has no depth test. Not with `form=binned`, which lists the draw's own
    /// pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub select: Option<Select>,
    /// The source of the vertex results at a triangle's corners.
    pub vertices: Vertices,
    /// How the id pass knows a triangle.
    #[schemars(extend("x-expert" = true))]
    pub ids: Ids,
    /// Words per id.
    #[schemars(extend("x-expert" = true))]
    pub words: Words,
    /// Allowed storage formats of vertex attributes.
    #[schemars(extend("x-expert" = true))]
    pub formats: Formats,
    /// Vertex stage of the id pass: the author's whole stage with the id added, or its slice.
    /// Default: `sliced` if the author's position is `@invariant`, otherwise `same`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub vertex: Option<VertexStage>,
    /// Whether to add `@invariant` to the id pass's position. Default: `as-written` with
    /// `vertex=same`, `add` with `vertex=sliced`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub invariant: Option<Invariance>,
    /// Where a triangle's corners are when the resolve interpolates. Default: the measured
    /// behaviour of the adapter, otherwise `held`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub corners: Option<Corners>,
    /// The neighbours for `dpdx`, `dpdy` and `fwidth`. Default: as measured, otherwise the pixel's
    /// `own`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub derivatives: Option<Neighbours>,
    /// The neighbours for `dpdxCoarse`, `dpdyCoarse` and `fwidthCoarse`. Default: as measured,
    /// otherwise the `quad`'s first pixel's.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub coarse: Option<Neighbours>,
    /// The neighbours for a texture sample's implicit level, without cubes. Default: as measured,
    /// otherwise the `quad`'s first pixel's.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub samples: Option<Neighbours>,
    /// The neighbours for the implicit level of a cube sample. Default: as measured, otherwise the
    /// `quad`'s first pixel's.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-expert" = true))]
    pub cubes: Option<Neighbours>,
}

impl VisibilityParams {
    /// Fills in the open choices from the measured adapter.
    pub(super) fn resolved(&self, facts: &Facts) -> Result<Self, Box<Refusal>> {
        let select = match (self.form, self.select) {
            (ShadingForm::Fragment, select) => Some(select.unwrap_or_default()),
            (ShadingForm::Compute, None) => Some(Select::Id),
            (ShadingForm::Compute, Some(Select::Depth)) => {
                return Err(Box::new(refuse(
                    &refusals::SELECT,
                    "form=compute has no depth test that could tell draws apart",
                    "leave select out, or set select=tiles",
                )));
            }
            (ShadingForm::Compute, select) => select,
            (ShadingForm::Binned, None) => None,
            (ShadingForm::Binned, Some(_)) => {
                return Err(Box::new(refuse(
                    &refusals::SELECT,
                    "form=binned already lists the pixels of each draw",
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

    /// Removes choices without effect: corners if nothing is interpolated, neighbours that the
    /// stage does not use.
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

    /// Choices that contradict the measured adapter: `parameter=choice` and the measured behaviour.
    pub(super) fn contradicting(&self, seen: &Rasterizer) -> Vec<[String; 2]> {
        // `held` also uses the given corners.
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

    /// The selection; `form=binned` lists only its own pixels.
    pub(super) fn select(&self) -> Select {
        self.select.unwrap_or_default()
    }

    /// The rasteriser behaviour that the resolve reproduces.
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

    /// Two texts of one position have equal bits only under `@invariant`. Without it the author's
    /// stage stays whole, so that as much as possible is the same.
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

/// A choice in recipe syntax.
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
            let params = VisibilityParams {
                corners: Some(said),
                ..VisibilityParams::default()
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
