//! The range of a mesh that a draw uses.

use super::{Draw, DrawRange, Mesh, SceneError};

/// Checks the range of a draw.
///
/// # Errors
/// The range exceeds the mesh, `base_vertex` moves an index beyond the vertices, or the instances
/// exceed 32 bits.
pub fn check(mesh: &Mesh, draw: &Draw) -> Result<(), SceneError> {
    let DrawRange {
        first,
        count,
        base_vertex,
        first_instance,
    } = draw.range;
    let what = match mesh.indices {
        Some(_) => "indices",
        None => "vertices",
    };
    let indices = mesh.indices.as_deref();
    let there = indices.map_or(mesh.vertex_count as usize, <[u32]>::len) as u64;
    let end = count.map_or(there, |count| u64::from(first) + u64::from(count));
    if end > there || u64::from(first) > end {
        return Err(SceneError::new(format!(
            "draw `{}` takes {what} {first} to {end}, and mesh `{}` has {there}",
            draw.name, mesh.name
        )));
    }
    if let (Some(indices), true) = (indices, base_vertex != 0) {
        let taken = &indices[first as usize..end as usize];
        let moved = |i: &u32| i64::from(*i) + i64::from(base_vertex);
        let held = 0..i64::from(mesh.vertex_count);
        if let Some(wrong) = taken.iter().map(moved).find(|v| !held.contains(v)) {
            return Err(SceneError::new(format!(
                "draw `{}` takes vertex {wrong} of mesh `{}`, which has {}",
                draw.name, mesh.name, mesh.vertex_count
            ))
            .help("base_vertex is added to each index"));
        }
    }
    match first_instance.checked_add(draw.instances) {
        Some(_) => Ok(()),
        None => Err(SceneError::new(format!(
            "draw `{}` ends at instance {}, and an index of instances has 32 bits",
            draw.name,
            u64::from(first_instance) + u64::from(draw.instances)
        ))),
    }
}
