//! Bind group layouts of a pass, derived only from the bindings in its plan. Every resource must
//! fit its planned binding.

use std::collections::BTreeMap;
use std::num::NonZeroU64;

use preshade_plan::plan::{BindingKind, BindingLayout, BindingSource, BindingUse, GeometryPart};

use super::compiled::{self, Compiled};
use super::frame_draw_table::Drawn;
use super::gpu::Gpu;
use super::inputs::{DrawInputs, Resource};
use super::subdivided::{Subdivided, attribute};
use super::targets::Targets;
use super::{Error, state};

/// The resource of a binding.
pub(super) enum Filled<'a> {
    Author(&'a Resource),
    Attachment(&'a wgpu::TextureView, wgpu::BindingType),
    Geometry(&'a wgpu::Buffer, wgpu::BufferBindingType),
}

impl Filled<'_> {
    fn provided(&self) -> wgpu::BindingType {
        match self {
            Self::Author(resource) => resource.provided(),
            Self::Attachment(_, ty) => *ty,
            Self::Geometry(buffer, ty) => wgpu::BindingType::Buffer {
                ty: *ty,
                has_dynamic_offset: false,
                min_binding_size: NonZeroU64::new(buffer.size()),
            },
        }
    }

    fn binding(&self) -> wgpu::BindingResource<'_> {
        match self {
            Self::Author(resource) => resource.binding(),
            Self::Attachment(view, _) => wgpu::BindingResource::TextureView(view),
            Self::Geometry(buffer, _) => buffer.as_entire_binding(),
        }
    }
}

/// A binding: its layout entry and its resource.
pub(crate) struct Bound<'a> {
    pub entry: wgpu::BindGroupLayoutEntry,
    pub filled: Filled<'a>,
}

/// The bindings of a pass by group.
pub(super) type Groups<'a> = BTreeMap<u32, Vec<Bound<'a>>>;

/// Geometry that the renderer made for a pass.
#[derive(Clone, Copy)]
pub(super) enum RendererGeometry<'a> {
    /// Subdivided triangles, and the draw's entry in the draw table.
    Subdivided(&'a Subdivided, &'a Drawn),
    /// The draw's entry in the draw table.
    Drawn(&'a Drawn),
}

impl<'a> RendererGeometry<'a> {
    /// The uniform buffer for a source outside of the author's program.
    fn host(self, source: &BindingSource) -> Option<&'a wgpu::Buffer> {
        match self {
            Self::Subdivided(..) => None,
            Self::Drawn(drawn) => drawn.host(source),
        }
    }

    fn part(
        self,
        b: &BindingUse,
        part: &GeometryPart,
        draw: &'a DrawInputs,
    ) -> Result<(&'a wgpu::Buffer, wgpu::BufferBindingType), String> {
        let drawn = match self {
            Self::Subdivided(_, drawn) if matches!(part, GeometryPart::Frame { .. }) => drawn,
            Self::Subdivided(subdivided, _) => return subdivided.part(b, part, draw),
            Self::Drawn(drawn) => drawn,
        };
        if let Some(found) = drawn.part(b, part) {
            return Ok(found);
        }
        let buffer = match part {
            GeometryPart::Indices => match &draw.indices {
                Some(indices) => &indices.buffer,
                None => drawn.filler(),
            },
            GeometryPart::Attribute(a) => &attribute(draw, a.location)?.0.buffer,
            GeometryPart::Values { buffer } => {
                return Err(format!("the plan has no buffer `{buffer}`"));
            }
            _ => return Err("the pass does not say how its geometry is subdivided".to_owned()),
        };
        let read_only = b.kind == BindingKind::StorageRead;
        Ok((buffer, wgpu::BufferBindingType::Storage { read_only }))
    }
}

/// Fills the bindings of a pass.
///
/// # Errors
/// The reason as text: the plan names a missing binding or attachment, gives no layout for a
/// binding, or a resource does not fit its layout.
pub(super) fn fill<'a>(
    bindings: &'a [BindingUse],
    [draw, previous]: [&'a DrawInputs; 2],
    targets: &'a Targets,
    made: RendererGeometry<'a>,
    limits: &wgpu::Limits,
) -> Result<Groups<'a>, String> {
    let mut groups = Groups::new();
    for b in bindings {
        let filled = match &b.source {
            BindingSource::Author => {
                Filled::Author(draw.resources.get(&(b.group, b.binding)).ok_or_else(|| {
                    format!("{} is not a binding the author's program uses", place(b))
                })?)
            }
            BindingSource::Previous {
                group: Some(group),
                binding: Some(binding),
                ..
            } => Filled::Author(previous.resources.get(&(*group, *binding)).ok_or_else(|| {
                format!(
                    "{} has the content of group {group}, binding {binding}, which the author's \
                     program does not use",
                    place(b)
                )
            })?),
            BindingSource::View { name } => {
                return Err(format!(
                    "{} holds `{name}`, which is another view's",
                    place(b)
                ));
            }
            BindingSource::Previous { .. } | BindingSource::Host { .. } => {
                let buffer = made
                    .host(&b.source)
                    .ok_or_else(|| format!("{} holds what we cannot give it", place(b)))?;
                let ty = match b.kind {
                    BindingKind::StorageRead => {
                        wgpu::BufferBindingType::Storage { read_only: true }
                    }
                    _ => wgpu::BufferBindingType::Uniform,
                };
                Filled::Geometry(buffer, ty)
            }
            BindingSource::Geometry { part } => {
                let (buffer, ty) = made.part(b, part, draw)?;
                check_size(b, buffer.size(), ty, limits)?;
                Filled::Geometry(buffer, ty)
            }
            BindingSource::SceneColor { location } => {
                let (view, format) = targets.stored(*location).map_err(|why| {
                    format!("`{}` writes the scene's colour {location}, {why}", b.name)
                })?;
                Filled::Attachment(
                    view,
                    wgpu::BindingType::StorageTexture {
                        access: wgpu::StorageTextureAccess::WriteOnly,
                        format,
                        view_dimension: wgpu::TextureViewDimension::D2,
                    },
                )
            }
            BindingSource::Attachment { name } => {
                let sampled = targets
                    .sampled(name)
                    .map_err(|why| format!("`{}` reads `{name}`, {why}", b.name))?;
                Filled::Attachment(
                    sampled.view,
                    wgpu::BindingType::Texture {
                        sample_type: sampled.sample_type,
                        view_dimension: wgpu::TextureViewDimension::D2,
                        multisampled: sampled.samples > 1,
                    },
                )
            }
        };
        let bound = Bound {
            entry: entry(b, filled.provided())?,
            filled,
        };
        groups.entry(b.group).or_default().push(bound);
    }
    Ok(groups)
}

/// Fails with a message if a buffer of the draw exceeds the adapter's binding size.
fn check_size(
    b: &BindingUse,
    size: u64,
    ty: wgpu::BufferBindingType,
    limits: &wgpu::Limits,
) -> Result<(), String> {
    let (most, name) = match ty {
        wgpu::BufferBindingType::Uniform => (
            limits.max_uniform_buffer_binding_size,
            "maxUniformBufferBindingSize",
        ),
        wgpu::BufferBindingType::Storage { .. } => (
            limits.max_storage_buffer_binding_size,
            "maxStorageBufferBindingSize",
        ),
    };
    if size <= most {
        return Ok(());
    }
    Err(format!(
        "{} would bind {size} bytes, and the adapter binds {most} at most ({name}): split the draw",
        place(b)
    ))
}

/// Layout and bind group of each group.
///
/// # Errors
/// wgpu refuses one. `what` names them.
pub(super) fn bind(
    gpu: &Gpu,
    compiled: Option<&Compiled>,
    what: &str,
    groups: &Groups<'_>,
) -> Result<Vec<(u32, wgpu::BindGroupLayout, wgpu::BindGroup)>, Error> {
    groups
        .iter()
        .map(|(group, bindings)| {
            let layout = layout(gpu, compiled, what, bindings)?;
            let entries: Vec<_> = bindings
                .iter()
                .map(|b| wgpu::BindGroupEntry {
                    binding: b.entry.binding,
                    resource: b.filled.binding(),
                })
                .collect();
            let bound = gpu.checked(what, || {
                gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: None,
                    layout: &layout,
                    entries: &entries,
                })
            })?;
            Ok((*group, layout, bound))
        })
        .collect()
}

/// The layouts of a pipeline, by group.
pub(super) fn by_group<'l>(
    layouts: &[(u32, &'l wgpu::BindGroupLayout)],
) -> Vec<Option<&'l wgpu::BindGroupLayout>> {
    let count = layouts.iter().map(|(g, _)| *g + 1).max().unwrap_or(0);
    (0..count)
        .map(|g| layouts.iter().find(|(h, _)| *h == g).map(|(_, l)| *l))
        .collect()
}

/// The layout of one group.
fn layout(
    gpu: &Gpu,
    compiled: Option<&Compiled>,
    what: &str,
    bindings: &[Bound<'_>],
) -> Result<wgpu::BindGroupLayout, Error> {
    let entries: Vec<_> = bindings.iter().map(|b| b.entry).collect();
    let make = || {
        gpu.device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: None,
                entries: &entries,
            })
    };
    compiled::shared(
        compiled.map(|c| &c.layouts),
        || entries.clone(),
        || gpu.checked(what, make),
    )
}

/// Describes a binding in messages.
fn place(b: &BindingUse) -> String {
    format!("`{}` (group {}, binding {})", b.name, b.group, b.binding)
}

/// The layout entry of a binding: the plan's, with the relaxation that [`BindingLayout`] allows.
fn entry(
    b: &BindingUse,
    provided: wgpu::BindingType,
) -> Result<wgpu::BindGroupLayoutEntry, String> {
    let layout = b.layout.as_ref().ok_or_else(|| {
        format!(
            "{} has no layout: WebGPU has none for an external texture or an acceleration structure",
            place(b)
        )
    })?;
    let planned = binding_type(layout)
        .ok_or_else(|| format!("{} has a layout that is not WebGPU's: {layout:?}", place(b)))?;
    if b.kind != kind(&planned) {
        return Err(format!(
            "{} is a {:?} in the plan, and laid out as {}",
            place(b),
            b.kind,
            describe(planned)
        ));
    }
    let ty = fitting(planned, provided).ok_or_else(|| {
        format!(
            "{} is {} in the plan; what there is to bind is {}",
            place(b),
            describe(planned),
            describe(provided)
        )
    })?;
    let mut visibility = wgpu::ShaderStages::NONE;
    visibility.set(wgpu::ShaderStages::VERTEX, b.visibility.vertex);
    visibility.set(wgpu::ShaderStages::FRAGMENT, b.visibility.fragment);
    visibility.set(wgpu::ShaderStages::COMPUTE, b.visibility.compute);
    Ok(wgpu::BindGroupLayoutEntry {
        binding: b.binding,
        visibility,
        ty,
        count: None,
    })
}

/// Converts a layout to wgpu's type. `None` if it contains a word that WebGPU lacks.
pub fn binding_type(layout: &BindingLayout) -> Option<wgpu::BindingType> {
    Some(match layout {
        BindingLayout::Buffer {
            ty,
            min_binding_size,
        } => wgpu::BindingType::Buffer {
            ty: match ty.as_str() {
                "uniform" => wgpu::BufferBindingType::Uniform,
                "storage" => wgpu::BufferBindingType::Storage { read_only: false },
                "read-only-storage" => wgpu::BufferBindingType::Storage { read_only: true },
                _ => return None,
            },
            has_dynamic_offset: false,
            min_binding_size: Some(NonZeroU64::new(*min_binding_size)?),
        },
        BindingLayout::Sampler { ty } => wgpu::BindingType::Sampler(match ty.as_str() {
            "filtering" => wgpu::SamplerBindingType::Filtering,
            "non-filtering" => wgpu::SamplerBindingType::NonFiltering,
            "comparison" => wgpu::SamplerBindingType::Comparison,
            _ => return None,
        }),
        BindingLayout::Texture {
            sample_type,
            view_dimension: dimension,
            multisampled,
        } => wgpu::BindingType::Texture {
            sample_type: match sample_type.as_str() {
                "float" => wgpu::TextureSampleType::Float { filterable: true },
                "unfilterable-float" => wgpu::TextureSampleType::Float { filterable: false },
                "depth" => wgpu::TextureSampleType::Depth,
                "sint" => wgpu::TextureSampleType::Sint,
                "uint" => wgpu::TextureSampleType::Uint,
                _ => return None,
            },
            view_dimension: view_dimension(dimension)?,
            multisampled: *multisampled,
        },
        BindingLayout::StorageTexture {
            access,
            format,
            view_dimension: dimension,
        } => wgpu::BindingType::StorageTexture {
            access: match access.as_str() {
                "write-only" => wgpu::StorageTextureAccess::WriteOnly,
                "read-only" => wgpu::StorageTextureAccess::ReadOnly,
                "read-write" => wgpu::StorageTextureAccess::ReadWrite,
                "atomic" => wgpu::StorageTextureAccess::Atomic,
                _ => return None,
            },
            format: state::color_format(format)?,
            view_dimension: view_dimension(dimension)?,
        },
    })
}

fn view_dimension(name: &str) -> Option<wgpu::TextureViewDimension> {
    use wgpu::TextureViewDimension as D;
    Some(match name {
        "1d" => D::D1,
        "2d" => D::D2,
        "2d-array" => D::D2Array,
        "3d" => D::D3,
        "cube" => D::Cube,
        "cube-array" => D::CubeArray,
        _ => return None,
    })
}

/// The kind of resource that a binding of this type holds.
fn kind(ty: &wgpu::BindingType) -> BindingKind {
    use wgpu::BindingType as T;
    match ty {
        T::Buffer { ty, .. } => match ty {
            wgpu::BufferBindingType::Uniform => BindingKind::Uniform,
            wgpu::BufferBindingType::Storage { read_only: true } => BindingKind::StorageRead,
            wgpu::BufferBindingType::Storage { read_only: false } => BindingKind::StorageReadWrite,
        },
        T::Sampler(wgpu::SamplerBindingType::Comparison) => BindingKind::ComparisonSampler,
        T::Sampler(_) => BindingKind::Sampler,
        T::Texture {
            sample_type: wgpu::TextureSampleType::Depth,
            ..
        } => BindingKind::DepthTexture,
        T::StorageTexture { .. } => BindingKind::StorageTexture,
        T::AccelerationStructure { .. } => BindingKind::AccelerationStructure,
        T::Texture { .. } | T::ExternalTexture => BindingKind::Texture,
    }
}

/// A binding type that fits both the plan and the resource: the planned one, with the relaxation
/// that [`BindingLayout`] allows. `None` if the resource does not fit. The size of a provided
/// buffer is its minimum size.
fn fitting(planned: wgpu::BindingType, provided: wgpu::BindingType) -> Option<wgpu::BindingType> {
    use wgpu::{BindingType as T, TextureSampleType as S};
    match (planned, provided) {
        (
            T::Buffer {
                ty,
                min_binding_size: least,
                ..
            },
            T::Buffer {
                ty: is,
                min_binding_size: bytes,
                ..
            },
        ) => (ty == is && least <= bytes).then_some(planned),
        (T::Sampler(wanted), T::Sampler(is)) => match (wanted, is) {
            // A scene or captured app may filter depths: wgpu allows it, browsers do not.
            (
                wgpu::SamplerBindingType::Filtering | wgpu::SamplerBindingType::NonFiltering,
                wgpu::SamplerBindingType::Filtering | wgpu::SamplerBindingType::NonFiltering,
            ) => Some(provided),
            _ => (wanted == is).then_some(planned),
        },
        (
            T::Texture {
                sample_type: wanted,
                view_dimension,
                multisampled,
            },
            T::Texture {
                sample_type: is,
                view_dimension: view,
                multisampled: many,
            },
        ) if (view_dimension, multisampled) == (view, many) => match (wanted, is) {
            // A depth format can be read as an unfilterable float.
            (S::Float { filterable: true }, S::Float { filterable: false } | S::Depth) => {
                Some(T::Texture {
                    sample_type: S::Float { filterable: false },
                    view_dimension,
                    multisampled,
                })
            }
            (S::Float { filterable: false }, S::Float { .. } | S::Depth) => Some(planned),
            _ => (wanted == is).then_some(planned),
        },
        (T::StorageTexture { .. }, T::StorageTexture { .. }) => {
            (planned == provided).then_some(planned)
        }
        _ => None,
    }
}

/// Describes a binding type in messages.
fn describe(ty: wgpu::BindingType) -> String {
    use wgpu::BindingType as T;
    match ty {
        T::Buffer {
            ty,
            min_binding_size,
            ..
        } => {
            let kind = match ty {
                wgpu::BufferBindingType::Uniform => "a uniform buffer",
                wgpu::BufferBindingType::Storage { read_only: true } => {
                    "a read-only storage buffer"
                }
                wgpu::BufferBindingType::Storage { read_only: false } => "a storage buffer",
            };
            let bytes = min_binding_size.map_or(0, NonZeroU64::get);
            format!("{kind} of {bytes} bytes")
        }
        T::Sampler(wgpu::SamplerBindingType::Filtering) => "a filtering sampler".to_owned(),
        T::Sampler(wgpu::SamplerBindingType::NonFiltering) => "a non-filtering sampler".to_owned(),
        T::Sampler(wgpu::SamplerBindingType::Comparison) => "a comparison sampler".to_owned(),
        T::Texture {
            sample_type,
            view_dimension,
            multisampled,
        } => format!(
            "a {}{view_dimension:?} texture of {}",
            if multisampled { "multisampled " } else { "" },
            match sample_type {
                wgpu::TextureSampleType::Float { filterable: true } => "floats",
                wgpu::TextureSampleType::Float { filterable: false } =>
                    "floats that are not filtered",
                wgpu::TextureSampleType::Depth => "depths",
                wgpu::TextureSampleType::Sint => "signed integers",
                wgpu::TextureSampleType::Uint => "unsigned integers",
            }
        ),
        T::StorageTexture { format, .. } => format!("a storage texture of {format:?}"),
        T::AccelerationStructure { .. } => "an acceleration structure".to_owned(),
        T::ExternalTexture => "an external texture".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use wgpu::TextureSampleType::{Depth, Float, Uint};

    use super::*;

    fn texture(sample_type: wgpu::TextureSampleType) -> wgpu::BindingType {
        wgpu::BindingType::Texture {
            sample_type,
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        }
    }

    fn uniform(bytes: u64) -> wgpu::BindingType {
        wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: NonZeroU64::new(bytes),
        }
    }

    #[test]
    fn the_plans_layout_is_taken_but_for_formats_that_cannot_be_filtered() {
        let (filtered, fetched) = (
            texture(Float { filterable: true }),
            texture(Float { filterable: false }),
        );
        let cases = [
            (filtered, filtered, Some(filtered)),
            (filtered, fetched, Some(fetched)),
            (filtered, texture(Depth), Some(fetched)),
            (fetched, filtered, Some(fetched)),
            (texture(Depth), filtered, None),
            (filtered, texture(Uint), None),
            (filtered, uniform(16), None),
        ];
        for (planned, provided, expected) in cases {
            assert_eq!(
                fitting(planned, provided),
                expected,
                "{planned:?} {provided:?}"
            );
        }
    }

    #[test]
    fn a_buffer_larger_than_the_adapter_binds_is_told() {
        let limits = wgpu::Limits::default();
        let b = BindingUse {
            name: "visibility_stream_0_".to_owned(),
            ..BindingUse::new([2, 4], BindingKind::StorageRead, BindingSource::Author)
        };
        let storage = wgpu::BufferBindingType::Storage { read_only: true };
        // 4,000,000 instances of 16 bytes, then of a matrix each.
        assert_eq!(check_size(&b, 64_000_000, storage, &limits), Ok(()));
        let told = check_size(&b, 256_000_000, storage, &limits);
        let says =
            |told: &String| told.contains("binds 134217728 at most (maxStorageBufferBindingSize)");
        assert!(told.as_ref().is_err_and(says), "{told:?}");
    }

    #[test]
    fn a_buffer_has_at_least_the_bytes_that_the_plan_says() {
        assert_eq!(fitting(uniform(80), uniform(96)), Some(uniform(80)));
        assert_eq!(fitting(uniform(80), uniform(64)), None);
    }
}
