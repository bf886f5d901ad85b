//! The draw table: the host's description of each draw in a frame that is shaded from ids.
//!
//! An id identifies an instance of a draw and a triangle of it. `x` is 0 where nothing was drawn,
//! else `1 + first_id + instance_index - first_instance`. `y` is the triangle, counted from 0 in
//! each instance; its highest bit is set where a material that needs its side shows its back. The
//! `first_id` of the first draw is 0, and each draw takes as many ids as it has instances. All
//! draws of all materials share this numbering, in any order that is constant within the frame.
//!
//! One-word ids are `x << bits | y`, where the highest of these bits is the side. The number of
//! bits depends on the frame's draws ([`triangle_bits`]), so the host writes it into each draw's
//! entry and into the first word of the table.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::Stream;
use crate::plan::AttachmentFormat;

/// Most instances in a frame: `x` has 32 bits, and 0 means empty.
pub const MOST_INSTANCES: u64 = u32::MAX as u64 - 1;

/// Name of the attachment of ids.
pub const IDS: &str = "visibility-ids";

/// Words per id.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Words {
    /// `rg32uint`: no practical limit.
    #[default]
    Two,
    /// `r32uint`, divided according to the frame's instances and triangles. A host refuses frames
    /// that do not fit.
    One,
}

impl Words {
    /// Format of the id attachment.
    pub fn format(self) -> AttachmentFormat {
        AttachmentFormat::Color(self.color().to_owned())
    }

    /// The texture format of an id.
    pub fn color(self) -> &'static str {
        match self {
            Self::Two => "rg32uint",
            Self::One => "r32uint",
        }
    }
}

/// Name of the depth attachment of draw numbers, `depth16unorm`. Number `n` ([`Entry::number`]) is
/// the depth `(n + 1.25) / 65535`: however an adapter rounds, it becomes the same step, also after
/// interpolation between three equal depths.
pub const DRAWS: &str = "visibility-draws";

/// Most draws that a 16-bit depth distinguishes ([`DRAWS`]): 0 means empty, and the last step
/// allows for rounding.
pub const MOST_DRAWS: usize = (1 << 16) - 2;

/// The entry of a draw: the words of [`crate::plan::GeometryPart::Draw`].
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Number of instances of the draws before it.
    pub first_id: u32,
    pub instances: u32,
    /// `firstInstance` of the author's draw.
    pub first_instance: u32,
    /// Index of the draw in the table.
    pub number: u32,
    /// First index of the author's draw, or first vertex without indices.
    pub first: u32,
    /// Bytes of an index: 2, 4, or 0 without indices.
    pub index_bytes: u32,
    /// `baseVertex` of the author's draw.
    pub base_vertex: i32,
    /// With one-word ids, the bits of the triangle and its side, the same for all draws of the
    /// frame; else 0.
    pub triangle_bits: u32,
    /// The viewport in pixels: x, y, width, height.
    pub viewport: [f32; 4],
    /// Number of vertices in the vertex buffers: the largest index plus `base_vertex`, plus 1.
    /// Three words of 0 follow.
    pub vertices: u32,
    /// The attributes, in the order of the binding's locations.
    pub streams: Vec<Stream>,
}

impl Entry {
    /// The words. `None` for a format that is not WebGPU's.
    pub fn words(&self) -> Option<Vec<u32>> {
        let mut words = vec![
            self.first_id,
            self.instances,
            self.first_instance,
            self.number,
            self.first,
            self.index_bytes,
            self.base_vertex as u32,
            self.triangle_bits,
        ];
        words.extend(self.viewport.map(f32::to_bits));
        words.extend([self.vertices, 0, 0, 0]);
        for stream in &self.streams {
            words.extend(stream.words()?);
        }
        Some(words)
    }
}

/// The first id of each draw of a frame, from the instance counts.
///
/// # Errors
///
/// The number of instances, if it exceeds [`MOST_INSTANCES`].
pub fn first_ids(instances: impl IntoIterator<Item = u32>) -> Result<Vec<u32>, u64> {
    let mut next = 0_u64;
    let mut first = Vec::new();
    for count in instances {
        first.push(next as u32);
        next += u64::from(count);
    }
    match next {
        0..=MOST_INSTANCES => Ok(first),
        more => Err(more),
    }
}

/// Bits of a triangle and its side in one-word ids, from the instances of each draw and its
/// triangles per instance. `None` if they don't fit.
pub fn triangle_bits(draws: impl IntoIterator<Item = (u32, u32)>) -> Option<u32> {
    let (instances, triangles) = draws
        .into_iter()
        .fold((0_u64, 1_u32), |(sum, most), (instances, triangles)| {
            (sum + u64::from(instances), most.max(triangles))
        });
    let bits = u32::BITS - (triangles - 1).leading_zeros() + 1;
    // 0 means empty.
    let fits = bits < u32::BITS && (instances + 1) << bits <= 1 << u32::BITS;
    fits.then_some(bits)
}

/// The table: the words of [`crate::plan::GeometryPart::DrawTable`].
pub fn table(triangle_bits: u32, first_ids: &[u32]) -> Vec<u32> {
    std::iter::once(triangle_bits)
        .chain(first_ids.iter().copied())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_split_by_the_counts() {
        assert_eq!(triangle_bits([(1, 1)]), Some(1));
        assert_eq!(triangle_bits([(10, 4), (3, 5)]), Some(4));
        // 4 triangles with their sides take 3 bits, which leaves 29 for instances and the empty id.
        assert_eq!(triangle_bits([((1 << 29) - 1, 4)]), Some(3));
        assert_eq!(triangle_bits([(1 << 29, 4)]), None);
        assert_eq!(triangle_bits([(400_000, 4)]), Some(3));
        assert_eq!(triangle_bits([(2, u32::MAX)]), None);
    }

    #[test]
    fn ids_follow_each_other_and_end() {
        assert_eq!(first_ids([3, 1, 400]), Ok(vec![0, 3, 4]));
        assert_eq!(first_ids([u32::MAX - 1, 0]), Ok(vec![0, u32::MAX - 1]));
        assert_eq!(first_ids([u32::MAX, 1]), Err(1 << 32));
    }
}
