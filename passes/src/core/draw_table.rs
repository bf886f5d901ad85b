//! The draw table: what a host must know of each draw of a frame whose pixels are shaded from ids.
//!
//! An id names an instance of a draw and a triangle of it. `x` is 0 where nothing was drawn, else `1 + first_id + instance_index - first_instance`; `y` is the
//! triangle, counted from 0 in each instance, its highest bit set where a material that asks for its side shows its back. The first ids of a frame's draws follow each other: that of the first is 0, and each draw takes as many ids as it has
//! instances. All draws of all materials of the frame share the one numbering, in any order that stays the same within the frame.
//!
//! Ids of one word are `x << bits | y`, the highest of these bits being that of the side. How many bits a triangle takes follows from the draws of the frame ([`triangle_bits`]), so that it is the host's to say: in each draw's
//! entry, and in the first word of the table.

use crate::core::geometry::Stream;

/// Most instances that the ids of a frame can tell apart: `x` has 32 bits, and 0 is nothing.
pub const MOST_INSTANCES: u64 = u32::MAX as u64 - 1;

/// Most draws that a depth of 16 bits tells apart ([`crate::transforms::visibility_buffer::DRAWS`]): 0 is nothing, and the last step is left to rounding.
pub const MOST_DRAWS: usize = (1 << 16) - 2;

/// One draw's entry, as words of a uniform buffer: what [`crate::core::plan::GeometryPart::Draw`] holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Instances of the draws before it.
    pub first_id: u32,
    /// Instances.
    pub instances: u32,
    /// `firstInstance` of the author's draw.
    pub first_instance: u32,
    /// Place of the draw in the table.
    pub number: u32,
    /// First index of the author's draw, or first vertex without indices.
    pub first: u32,
    /// Bytes of an index: 2, 4, or 0 without indices.
    pub index_bytes: u32,
    /// `baseVertex` of the author's draw.
    pub base_vertex: i32,
    /// Ids of one word: bits that hold the triangle and its side, the same for all draws of the frame; else 0.
    pub triangle_bits: u32,
    /// The viewport in pixels: x, y, width, height.
    pub viewport: [f32; 4],
    /// Vertices that the vertex buffers hold, one more than the largest index with `base_vertex`; three words of 0 follow.
    pub vertices: u32,
    /// The attributes, in the order the binding lists their locations.
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

/// The first id of each of the draws of a frame, which have so many instances.
///
/// # Errors
/// The number of instances, where it is more than [`MOST_INSTANCES`].
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

/// Bits that a triangle and its side take in ids of one word, of draws with so many instances and triangles an instance. `None` where they do not fit.
pub fn triangle_bits(draws: impl IntoIterator<Item = (u32, u32)>) -> Option<u32> {
    let (instances, triangles) = draws
        .into_iter()
        .fold((0_u64, 1_u32), |(sum, most), (instances, triangles)| {
            (sum + u64::from(instances), most.max(triangles))
        });
    let bits = u32::BITS - (triangles - 1).leading_zeros() + 1;
    // 0 is nothing.
    let fits = bits < u32::BITS && (instances + 1) << bits <= 1 << u32::BITS;
    fits.then_some(bits)
}

/// The table, as words of a storage buffer: what [`crate::core::plan::GeometryPart::DrawTable`] holds.
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
        // 4 triangles and their sides take 3 bits, which leaves 29 for the instances and for nothing.
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
