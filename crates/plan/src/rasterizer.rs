//! Properties of an adapter's rasteriser that no language defines. A pass that repeats its work has
//! to match them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where the corners of a triangle are for interpolation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Corners {
    /// At the vertex stage's positions, extrapolating where a pixel's centre is outside of the
    /// triangle (coverage uses snapped corners): for rasterisers that interpolate by planes through
    /// unsnapped positions.
    AsGiven,
    /// The same, but a centre outside of the triangle takes its edge's value: for unknown adapters.
    /// Nothing extrapolates far from the triangle.
    #[default]
    Held,
    /// On the nearest 1/256 of a pixel, the rasterisers' grid (Direct3D requires 8 bits; Vulkan
    /// reports `subPixelPrecisionBits`), if the triangle is not clipped and no corner is more than
    /// 131,072 pixels away: for rasterisers that interpolate from there.
    Snapped,
}

/// The pixels of its quad whose differences are a pixel's gradients.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Neighbours {
    /// The quad's first pixel and its neighbours: one gradient for all four.
    Quad,
    /// The pixel itself and its neighbours.
    Own,
}

/// The measured behaviour of a rasteriser. The default is the most common one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Rasterizer {
    /// Where its corners are.
    pub corners: Corners,
    /// For `dpdx`, `dpdy` and `fwidth`.
    pub derivatives: Neighbours,
    /// For the `Coarse` derivatives.
    pub coarse: Neighbours,
    /// For a sample at an implicit level, except of a cube.
    pub samples: Neighbours,
    /// For a sample of a cube at an implicit level.
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
