//! The textures that a frame draws to.

use std::collections::BTreeMap;

use preshade_plan::frame::{ColorAttachments, FramePass, FramePlan};
use preshade_plan::plan::{
    Attachment, AttachmentFormat, BindingSource, ClearValue, GpuPass, SCENE_COLOR,
};
use preshade_plan::state::DepthFormat;

use super::gpu::Gpu;
use super::shader::Variant;
use super::{Error, readback, state};
use crate::scene::bind::Area;

/// The same part of an attachment with this divisor ([`Attachment`]).
pub(super) fn divided(area: Area, divisor: u32) -> Area {
    if divisor <= 1 {
        return area;
    }
    let n = divisor as f32;
    let first = 0.5 - 0.5 / n;
    let [x, y, w, h, near, far] = area.viewport;
    let [left, top, width, height] = area.scissor;
    let end = |from: u32, length: u32| (from + length).div_ceil(divisor);
    let (x0, y0) = (left / divisor, top / divisor);
    Area {
        viewport: [x / n + first, y / n + first, w / n, h / n, near, far],
        scissor: [x0, y0, end(left, width) - x0, end(top, height) - y0],
        of: area.of.map(|length| length.div_ceil(divisor)),
    }
}

pub(super) struct DepthTarget {
    pub texture: wgpu::Texture,
    /// All aspects, for attaching.
    pub view: wgpu::TextureView,
    /// The depth aspect, for binding. `None` unless the plan marks it as sampled.
    pub sampled_view: Option<wgpu::TextureView>,
    pub format: DepthFormat,
    pub samples: u32,
    pub clear: f32,
}

/// A plan's own colour attachment.
pub(super) struct NamedColor {
    texture: wgpu::Texture,
    pub view: wgpu::TextureView,
    pub clear: wgpu::Color,
    /// As [`Attachment::divisor`].
    pub divisor: u32,
    sampled: bool,
}

impl NamedColor {
    pub fn format(&self) -> wgpu::TextureFormat {
        self.texture.format()
    }

    pub fn samples(&self) -> u32 {
        self.texture.sample_count()
    }
}

/// An attachment that a pass binds as a texture.
pub(super) struct Sampled<'a> {
    pub view: &'a wgpu::TextureView,
    pub samples: u32,
    pub sample_type: wgpu::TextureSampleType,
}

/// A colour attachment, with its resolve target if it is multisampled and its format resolves.
pub(super) struct ColorTarget {
    pub format: wgpu::TextureFormat,
    pub drawn: wgpu::Texture,
    pub view: wgpu::TextureView,
    /// The storage texture view, in the texture's own format.
    pub stored: wgpu::TextureView,
    pub resolved: Option<(wgpu::Texture, wgpu::TextureView)>,
}

/// All targets of a frame.
pub(super) struct Targets {
    depths: BTreeMap<String, DepthTarget>,
    named: BTreeMap<String, NamedColor>,
    /// Targets by location; `None` if no pass writes the location.
    pub colors: Vec<Option<ColorTarget>>,
}

impl Targets {
    /// Creates the attachments of `variant`'s frame.
    pub fn new(gpu: &Gpu, variant: &Variant, size: [u32; 2]) -> Result<Self, Error> {
        let limit = gpu.device.limits().max_texture_dimension_2d;
        if size.iter().any(|s| *s == 0 || *s > limit) {
            return Err(Error::Size(size[0], size[1]));
        }
        Ok(Self {
            depths: depths(gpu, variant.frame(), size)?,
            named: named(gpu, variant.frame(), size)?,
            colors: colors(gpu, variant, size)?,
        })
    }

    /// Bytes of all attachments with all samples; a `depth24plus` sample counts as 4.
    pub fn bytes(&self) -> u64 {
        self.each().values().sum()
    }

    /// Bytes of each attachment by name and format.
    pub fn each(&self) -> BTreeMap<String, u64> {
        let bytes = |texture: &wgpu::Texture| {
            let texel = texture.format().block_copy_size(None).unwrap_or(4);
            u64::from(texture.width())
                * u64::from(texture.height())
                * u64::from(texture.sample_count())
                * u64::from(texel)
        };
        let one = |name: &str, texture: &wgpu::Texture| {
            let key = format!("{name} ({:?})", texture.format());
            (key, bytes(texture))
        };
        let depths = self.depths.iter().map(|(n, d)| one(n, &d.texture));
        let named = self.named.iter().map(|(n, c)| one(n, &c.texture));
        let colors = self.colors.iter().enumerate();
        let colors = colors.filter_map(|(location, c)| Some((location, c.as_ref()?)));
        let colors = colors.map(|(location, c)| {
            let (key, drawn) = one(&format!("scene-color-{location}"), &c.drawn);
            (
                key,
                drawn + c.resolved.as_ref().map_or(0, |(t, _)| bytes(t)),
            )
        });
        depths.chain(named).chain(colors).collect()
    }

    pub fn depth(&self, name: &str) -> Option<&DepthTarget> {
        self.depths.get(name)
    }

    pub fn named(&self, name: &str) -> Option<&NamedColor> {
        self.named.get(name)
    }

    /// The divisor of the attachments that a pass draws to.
    pub fn divisor(&self, pass: &FramePass) -> u32 {
        let mut named = pass.colors.names().filter_map(|name| self.named(name));
        named.next().map_or(1, |color| color.divisor)
    }

    /// The scene's colour at a location, as a storage texture.
    ///
    /// # Errors
    /// The reason as text: there is none.
    pub fn stored(
        &self,
        location: u32,
    ) -> Result<(&wgpu::TextureView, wgpu::TextureFormat), &'static str> {
        match self.colors.get(location as usize) {
            Some(Some(target)) if target.resolved.is_none() => {
                Ok((&target.stored, target.drawn.format()))
            }
            Some(Some(_)) => Err("which has several samples"),
            _ => Err("which no pass draws to"),
        }
    }

    /// The named attachment as a texture.
    ///
    /// # Errors
    /// The reason as text: it does not exist, or the plan does not mark it as sampled.
    pub fn sampled(&self, name: &str) -> Result<Sampled<'_>, &'static str> {
        const UNMARKED: &str = "which the plan does not mark as sampled";
        if let Some(depth) = self.depths.get(name) {
            return Ok(Sampled {
                view: depth.sampled_view.as_ref().ok_or(UNMARKED)?,
                samples: depth.samples,
                sample_type: wgpu::TextureSampleType::Depth,
            });
        }
        match self.named.get(name) {
            Some(color) if color.sampled => Ok(Sampled {
                view: &color.view,
                samples: color.texture.sample_count(),
                sample_type: match color.format().sample_type(None, None) {
                    // Multisampled textures are never filtered.
                    Some(wgpu::TextureSampleType::Float { filterable }) => {
                        wgpu::TextureSampleType::Float {
                            filterable: filterable && color.texture.sample_count() == 1,
                        }
                    }
                    other => other.ok_or("whose format cannot be bound")?,
                },
            }),
            Some(_) => Err(UNMARKED),
            None => Err("which is no attachment"),
        }
    }
}

fn extent(size: [u32; 2]) -> wgpu::Extent3d {
    wgpu::Extent3d {
        width: size[0],
        height: size[1],
        depth_or_array_layers: 1,
    }
}

fn depths(
    gpu: &Gpu,
    frame: &FramePlan,
    size: [u32; 2],
) -> Result<BTreeMap<String, DepthTarget>, Error> {
    frame
        .attachments
        .iter()
        .filter_map(|a| Some((a, a.format.depth()?)))
        .map(|(a, format)| {
            let what = format!("the attachment `{}`", a.name);
            if format == DepthFormat::Depth32floatStencil8 {
                gpu.require(&what, "depth32float-stencil8")?;
            }
            let ClearValue::Depth(clear) = a.clear else {
                return Err(wrong_clear(a));
            };
            let copyable = readback::is_copyable(format, a.samples);
            let mut usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
            usage.set(wgpu::TextureUsages::COPY_DST, a.samples == 1);
            usage.set(wgpu::TextureUsages::COPY_SRC, copyable);
            usage.set(wgpu::TextureUsages::TEXTURE_BINDING, a.sampled || !copyable);
            let texture = gpu.checked(&what, || {
                gpu.device.create_texture(&wgpu::TextureDescriptor {
                    label: Some(&a.name),
                    size: extent(a.size(size)),
                    mip_level_count: 1,
                    sample_count: a.samples,
                    dimension: wgpu::TextureDimension::D2,
                    format: state::depth_format(format),
                    usage,
                    view_formats: &[],
                })
            })?;
            let sampled_view = a.sampled.then(|| {
                texture.create_view(&wgpu::TextureViewDescriptor {
                    aspect: wgpu::TextureAspect::DepthOnly,
                    ..Default::default()
                })
            });
            let target = DepthTarget {
                view: texture.create_view(&Default::default()),
                sampled_view,
                texture,
                format,
                samples: a.samples,
                clear,
            };
            Ok((a.name.clone(), target))
        })
        .collect()
}

fn named(
    gpu: &Gpu,
    frame: &FramePlan,
    size: [u32; 2],
) -> Result<BTreeMap<String, NamedColor>, Error> {
    let mut out = BTreeMap::new();
    for a in &frame.attachments {
        let AttachmentFormat::Color(name) = &a.format else {
            continue;
        };
        let format = state::color_format(name).ok_or_else(|| Error::Attachment {
            name: a.name.clone(),
            message: format!("`{name}` is not a format preshade's renderer draws to"),
        })?;
        let ClearValue::Color([r, g, b, alpha]) = a.clear else {
            return Err(wrong_clear(a));
        };
        let mut usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
        usage.set(wgpu::TextureUsages::TEXTURE_BINDING, a.sampled);
        let texture = gpu.checked(&format!("the attachment `{}`", a.name), || {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(&a.name),
                size: extent(a.size(size)),
                mip_level_count: 1,
                sample_count: a.samples,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        })?;
        let color = NamedColor {
            view: texture.create_view(&Default::default()),
            texture,
            clear: wgpu::Color { r, g, b, a: alpha },
            divisor: a.divisor,
            sampled: a.sampled,
        };
        out.insert(a.name.clone(), color);
    }
    Ok(out)
}

fn wrong_clear(a: &Attachment) -> Error {
    Error::Attachment {
        name: a.name.clone(),
        message: format!("{:?} cannot be cleared to {:?}", a.format, a.clear),
    }
}

/// The frame's passes with the scene's colour attachments, and their materials.
fn color_passes(variant: &Variant) -> impl Iterator<Item = (&str, &GpuPass)> {
    let frame = variant.frame();
    frame
        .passes
        .iter()
        .filter(|p| p.colors == ColorAttachments::Scene)
        .flat_map(|p| &p.members)
        .filter_map(|(material, index)| {
            let plan = variant.plans().iter().find(|p| p.material == *material)?;
            Some((plan.material.as_str(), plan.passes.get(*index)?))
        })
}

/// One colour target for each location that a pass writes. Materials with fewer outputs leave the
/// others unchanged.
fn colors(gpu: &Gpu, variant: &Variant, size: [u32; 2]) -> Result<Vec<Option<ColorTarget>>, Error> {
    let mut formats: Vec<Option<(&str, &str)>> = Vec::new();
    let mut samples = 1;
    for (material, pass) in color_passes(variant) {
        samples = samples.max(pass.multisample.count);
        for (location, target) in pass.targets.iter().enumerate() {
            if formats.len() <= location {
                formats.resize(location + 1, None);
            }
            let Some(target) = target else { continue };
            match formats[location] {
                None => formats[location] = Some((&target.format, material)),
                Some((format, first)) if format != target.format => {
                    return Err(Error::Plan {
                        material: material.to_owned(),
                        message: format!(
                            "its colour target {location} is {}, that of material `{first}` is \
                             {format}",
                            target.format
                        ),
                    });
                }
                Some(_) => {}
            }
        }
    }
    formats
        .into_iter()
        .enumerate()
        .map(|(location, slot)| {
            let Some((name, material)) = slot else {
                return Ok(None);
            };
            let format = state::color_format(name).ok_or_else(|| Error::Plan {
                material: material.to_owned(),
                message: format!("`{name}` is not a format preshade's renderer draws to"),
            })?;
            let stored = is_stored(variant, location as u32);
            color(gpu, location, format, samples, size, stored).map(Some)
        })
        .collect()
}

/// Texture usages for writing the scene's colour at a location.
fn is_stored(variant: &Variant, location: u32) -> wgpu::TextureUsages {
    let mut bindings = variant
        .plans()
        .iter()
        .flat_map(|p| &p.compute)
        .flat_map(|c| &c.bindings);
    match bindings.any(|b| b.source == BindingSource::SceneColor { location }) {
        true => wgpu::TextureUsages::STORAGE_BINDING,
        false => wgpu::TextureUsages::empty(),
    }
}

fn color(
    gpu: &Gpu,
    location: usize,
    format: wgpu::TextureFormat,
    samples: u32,
    size: [u32; 2],
    stored: wgpu::TextureUsages,
) -> Result<ColorTarget, Error> {
    let name = match location {
        0 => SCENE_COLOR.to_owned(),
        n => format!("{SCENE_COLOR}-{n}"),
    };
    // Storage writes do not encode sRGB, so the format must not either.
    let made = match stored.is_empty() {
        true => format,
        false => format.remove_srgb_suffix(),
    };
    let views = [format];
    let create = |samples: u32, usage: wgpu::TextureUsages| {
        gpu.checked(&format!("the colour attachment `{name}`"), || {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(&name),
                size: extent(size),
                mip_level_count: 1,
                sample_count: samples,
                dimension: wgpu::TextureDimension::D2,
                format: made,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: match made == format {
                    true => &[],
                    false => &views,
                },
            })
        })
    };
    if samples == 1 {
        let texture = create(
            1,
            wgpu::TextureUsages::COPY_SRC
                | wgpu::TextureUsages::COPY_DST
                | wgpu::TextureUsages::TEXTURE_BINDING
                | stored,
        )?;
        return Ok(ColorTarget {
            format,
            view: texture.create_view(&wgpu::TextureViewDescriptor {
                format: Some(format),
                usage: Some(wgpu::TextureUsages::RENDER_ATTACHMENT),
                ..Default::default()
            }),
            stored: texture.create_view(&Default::default()),
            resolved: None,
            drawn: texture,
        });
    }
    let resolves = format
        .guaranteed_format_features(gpu.device.features())
        .flags
        .contains(wgpu::TextureFormatFeatureFlags::MULTISAMPLE_RESOLVE);
    let drawn = create(samples, wgpu::TextureUsages::TEXTURE_BINDING)?;
    let resolved = match resolves {
        true => {
            let texture = create(1, wgpu::TextureUsages::COPY_SRC)?;
            let view = texture.create_view(&Default::default());
            Some((texture, view))
        }
        false => None,
    };
    Ok(ColorTarget {
        format,
        view: drawn.create_view(&Default::default()),
        stored: drawn.create_view(&Default::default()),
        drawn,
        resolved,
    })
}
