//! The draw table: what a host must know of each draw of a frame whose pixels are shaded from ids.
//!
//! An id names an instance of a draw and a triangle of it. `x` is 0 where nothing was drawn, else `1 + first_id + instance_index - first_instance`; `y` is the
//! triangle, counted from 0 in each instance. The first ids of a frame's draws follow each other: that of the first is 0, and each draw takes as many ids as it has
//! instances. All draws of all materials of the frame share the one numbering, in any order that stays the same within the frame.

use crate::geometry::Stream;

/// Most instances that the ids of a frame can tell apart: `x` has 32 bits, and 0 is nothing.
pub const MOST_INSTANCES: u64 = u32::MAX as u64 - 1;

/// One draw's entry, as words of a uniform buffer: what [`crate::plan::GeometryPart::Draw`] holds.
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
    /// Triangles of one instance.
    pub triangles: u32,
    /// The viewport in pixels: x, y, width, height.
    pub viewport: [f32; 4],
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
            self.triangles,
        ];
        words.extend(self.viewport.map(f32::to_bits));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_follow_each_other_and_end() {
        assert_eq!(first_ids([3, 1, 400]), Ok(vec![0, 3, 4]));
        assert_eq!(first_ids([u32::MAX - 1, 0]), Ok(vec![0, u32::MAX - 1]));
        assert_eq!(first_ids([u32::MAX, 1]), Err(1 << 32));
    }
}
