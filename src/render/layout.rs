//! Bind group layouts of a pass, from the bindings its plan lists and nothing else.

use std::collections::BTreeMap;

use preshade_passes::plan::{BindingKind, BindingSource, BindingUse};

use super::inputs::{DrawInputs, Resource};
use super::subdivided::Subdivided;
use super::targets::Targets;

/// What a binding is filled with.
pub(super) enum Filled<'a> {
    Author(&'a Resource),
    Attachment(&'a wgpu::TextureView, wgpu::BindingType),
    Geometry(&'a wgpu::Buffer, wgpu::BufferBindingType),
}

impl Filled<'_> {
    fn layout(&self) -> wgpu::BindingType {
        match self {
            Self::Author(resource) => resource.layout(),
            Self::Attachment(_, ty) => *ty,
            Self::Geometry(_, ty) => wgpu::BindingType::Buffer {
                ty: *ty,
                has_dynamic_offset: false,
                min_binding_size: None,
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

/// The bindings of a pass by group, each with what fills it.
pub(super) type Groups<'a> = BTreeMap<u32, Vec<(&'a BindingUse, Filled<'a>)>>;

/// Fills the bindings of a pass.
///
/// # Errors
/// In words, when the plan names a binding that the author's program does not have, or an attachment that the frame does not have.
pub(super) fn fill<'a>(
    bindings: &'a [BindingUse],
    draw: &'a DrawInputs,
    targets: &'a Targets,
    subdivided: Option<&'a Subdivided>,
) -> Result<Groups<'a>, String> {
    let mut groups = Groups::new();
    for b in bindings {
        let filled = match &b.source {
            BindingSource::Author => {
                Filled::Author(draw.resources.get(&(b.group, b.binding)).ok_or_else(|| {
                    format!(
                        "`{}` (group {}, binding {}) is not a binding the author's program uses",
                        b.name, b.group, b.binding
                    )
                })?)
            }
            BindingSource::Geometry { part } => {
                let (buffer, ty) = subdivided
                    .ok_or("the pass does not say how its geometry is subdivided")?
                    .part(b, part, draw)?;
                Filled::Geometry(buffer, ty)
            }
            BindingSource::Attachment { name } => {
                let sampled = targets
                    .sampled(name)
                    .map_err(|why| format!("`{}` reads `{name}`, {why}", b.name))?;
                Filled::Attachment(
                    sampled.view,
                    wgpu::BindingType::Texture {
                        sample_type: match (b.kind, sampled.is_depth) {
                            (BindingKind::DepthTexture, true) => wgpu::TextureSampleType::Depth,
                            (BindingKind::Texture, _) => {
                                wgpu::TextureSampleType::Float { filterable: false }
                            }
                            (kind, _) => {
                                return Err(format!("`{}` reads `{name}` as {kind:?}", b.name));
                            }
                        },
                        view_dimension: wgpu::TextureViewDimension::D2,
                        multisampled: sampled.samples > 1,
                    },
                )
            }
        };
        groups.entry(b.group).or_default().push((b, filled));
    }
    Ok(groups)
}

/// The kind of pipeline a layout is for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Stages {
    Raster,
    Compute,
}

/// Layout and bind group of each group.
pub(super) fn bind(
    device: &wgpu::Device,
    groups: &Groups<'_>,
    stages: Stages,
) -> Vec<(u32, wgpu::BindGroupLayout, wgpu::BindGroup)> {
    groups
        .iter()
        .map(|(group, bindings)| {
            let layout = layout(device, bindings, stages);
            let entries: Vec<_> = bindings
                .iter()
                .map(|(b, filled)| wgpu::BindGroupEntry {
                    binding: b.binding,
                    resource: filled.binding(),
                })
                .collect();
            let bound = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &layout,
                entries: &entries,
            });
            (*group, layout, bound)
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
    device: &wgpu::Device,
    bindings: &[(&BindingUse, Filled<'_>)],
    stages: Stages,
) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = bindings
        .iter()
        .map(|(b, filled)| {
            let mut visibility = wgpu::ShaderStages::NONE;
            visibility.set(wgpu::ShaderStages::VERTEX, b.visibility.vertex);
            visibility.set(wgpu::ShaderStages::FRAGMENT, b.visibility.fragment);
            visibility.set(wgpu::ShaderStages::COMPUTE, stages == Stages::Compute);
            wgpu::BindGroupLayoutEntry {
                binding: b.binding,
                visibility,
                ty: filled.layout(),
                count: None,
            }
        })
        .collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &entries,
    })
}
