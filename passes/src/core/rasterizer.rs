//! What an adapter's rasteriser does that no language decides, and which something that does its work again has to do alike.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where the corners of a triangle lie when something is interpolated between them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Corners {
    /// Where the vertex stage puts them, and beyond the triangle where a pixel's centre lies outside of it (coverage is of snapped corners): for rasterisers that interpolate by planes
    /// through unsnapped positions.
    AsGiven,
    /// The same, but a centre outside of the triangle takes its edge's value: for adapters that nobody has looked at. Nothing is made up far from the triangle, whichever they do.
    #[default]
    Held,
    /// On the nearest 1/256 of a pixel, where rasterisers put them (Direct3D asks for 8 bits; Vulkan reports `subPixelPrecisionBits`), if the triangle is not clipped and no
    /// corner is more than 131,072 pixels away: for those that interpolate from there.
    Snapped,
}

/// Which pixels of its quad a pixel's gradients are differences of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Neighbours {
    /// The quad's first pixel and those beside it: one gradient for all four.
    Quad,
    /// The pixel itself and those beside it.
    Own,
}

/// What a rasteriser was seen to do. The default is what most are known to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Rasterizer {
    /// Where corners lie that it interpolates between.
    pub corners: Corners,
    /// Of `dpdx`, `dpdy` and `fwidth`.
    pub derivatives: Neighbours,
    /// Of those that are `Coarse`.
    pub coarse: Neighbours,
    /// Of a sample at an implicit level, but of a cube.
    pub samples: Neighbours,
    /// Of a sample of a cube at an implicit level.
    pub cubes: Neighbours,
}

impl Default for Rasterizer {
    fn default() -> Self {
        Self {
            corners: Corners::Held,
            derivatives: Neighbours::Own,
            coarse: Neighbours::Quad,
            samples: Neighbours::Quad,
            cubes: Neighbours::Quad,
        }
    }
}
