//! Checks glTF accessors before they are read: the glTF crate trusts counts, offsets and strides,
//! and panics on wrong ones.

use gltf::accessor::{DataType, Dimensions};
use gltf::{Accessor, Semantic};

use DataType::{F32, I8, I16, U8, U16, U32};
use Dimensions::{Mat4, Scalar, Vec2, Vec3, Vec4};

/// The size of a primitive's data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Cost {
    pub vertices: u64,
    /// Bytes of the data, with 4 bytes per number.
    pub bytes: u64,
}

impl Cost {
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            vertices: self.vertices.saturating_add(other.vertices),
            bytes: self.bytes.saturating_add(other.bytes),
        }
    }
}

/// Checks every accessor of a primitive that the loader reads.
///
/// `buffers` holds the buffer lengths in bytes. `is_quantized`: the file uses
/// KHR_mesh_quantization.
///
/// # Errors
/// The reason as text.
pub(crate) fn of_primitive(
    primitive: &gltf::Primitive<'_>,
    buffers: &[usize],
    is_quantized: bool,
) -> Result<Cost, String> {
    const FRACTIONS: &[DataType] = &[U8, U16, F32];
    const QUANTIZED: &[DataType] = &[I8, U8, I16, U16, F32];
    let floats = match is_quantized {
        true => QUANTIZED,
        false => &[F32],
    };
    let fractions = match is_quantized {
        true => QUANTIZED,
        false => FRACTIONS,
    };
    let mut cost = Cost::default();
    let mut take = |accessor: &Accessor<'_>, types: &[DataType], shapes: &[Dimensions]| {
        check(accessor, types, shapes, buffers)?;
        let numbers = accessor.dimensions().multiplicity() as u64;
        let bytes = (accessor.count() as u64).saturating_mul(4 * numbers);
        cost.bytes = cost.bytes.saturating_add(bytes);
        Ok::<_, String>(accessor.count() as u64)
    };
    let mut vertices = 0;
    for (semantic, accessor) in primitive.attributes() {
        match semantic {
            Semantic::Positions => vertices = take(&accessor, floats, &[Vec3])?,
            Semantic::Normals => _ = take(&accessor, floats, &[Vec3])?,
            Semantic::Tangents => _ = take(&accessor, floats, &[Vec4])?,
            Semantic::Colors(0) => _ = take(&accessor, FRACTIONS, &[Vec3, Vec4])?,
            Semantic::TexCoords(0 | 1) => _ = take(&accessor, fractions, &[Vec2])?,
            Semantic::Joints(0) => _ = take(&accessor, &[U8, U16], &[Vec4])?,
            Semantic::Weights(0) => _ = take(&accessor, FRACTIONS, &[Vec4])?,
            _ => {}
        }
    }
    if let Some(indices) = primitive.indices() {
        take(&indices, &[U8, U16, U32], &[Scalar])?;
    }
    for target in primitive.morph_targets() {
        let all = [target.positions(), target.normals(), target.tangents()];
        for accessor in all.into_iter().flatten() {
            take(&accessor, floats, &[Vec3])?;
        }
    }
    cost.vertices = vertices;
    Ok(cost)
}

/// Checks the accessors of a skin.
///
/// # Errors
/// The reason as text.
pub(crate) fn of_skin(skin: &gltf::Skin<'_>, buffers: &[usize]) -> Result<(), String> {
    let inverse = skin.inverse_bind_matrices();
    inverse.map_or(Ok(()), |a| check(&a, &[F32], &[Mat4], buffers))
}

/// Checks that an accessor has one of these types and fits its buffer (glTF 2.0, sections 3.6.2.2
/// to 3.6.2.4).
pub fn check(
    accessor: &Accessor<'_>,
    types: &[DataType],
    shapes: &[Dimensions],
    buffers: &[usize],
) -> Result<(), String> {
    let wrong = |what: String| format!("accessor {}: {what}", accessor.index());
    let (ty, shape) = (accessor.data_type(), accessor.dimensions());
    if !types.contains(&ty) || !shapes.contains(&shape) {
        return Err(wrong(format!(
            "{ty:?} {shape:?} is nothing that can stand there"
        )));
    }
    let (count, size) = (accessor.count(), accessor.size());
    if count == 0 {
        return Err(wrong("it has no elements".to_owned()));
    }
    if let Some(view) = accessor.view() {
        lies(&view, accessor.offset(), count, size, buffers).map_err(wrong)?;
    }
    if let Some(sparse) = accessor.sparse() {
        let n = sparse.count();
        if n == 0 || n > count {
            return Err(wrong(format!("{n} of {count} elements are sparse")));
        }
        let (indices, values) = (sparse.indices(), sparse.values());
        let index = indices.index_type().size();
        lies(&indices.view(), indices.offset(), n, index, buffers).map_err(wrong)?;
        lies(&values.view(), values.offset(), n, size, buffers).map_err(wrong)?;
    }
    Ok(())
}

/// Checks that the elements lie in the view, and the view in its buffer.
fn lies(
    view: &gltf::buffer::View<'_>,
    offset: usize,
    count: usize,
    size: usize,
    buffers: &[usize],
) -> Result<(), String> {
    let stride = view.stride().unwrap_or(size);
    if stride < size {
        return Err(format!("elements of {size} bytes lie {stride} apart"));
    }
    let end = stride
        .checked_mul(count - 1)
        .and_then(|n| n.checked_add(size)?.checked_add(offset));
    let view_end = view.offset().checked_add(view.length());
    let buffer = buffers.get(view.buffer().index()).copied().unwrap_or(0);
    let fits =
        end.is_some_and(|end| end <= view.length()) && view_end.is_some_and(|end| end <= buffer);
    match fits {
        true => Ok(()),
        false => Err(format!(
            "{count} elements of {size} bytes do not fit into their part of buffer {}",
            view.buffer().index()
        )),
    }
}
