//! Whether the draws of a scene can discard a fragment at all.
//!
//! An override or a uniform may switch an alpha test off: no texel of `rgba8unorm` is below 0. Then
//! no picture shows a discarded fragment, and `verify` requires none. `specialize` decides: if the
//! values of the draws, and the ranges of their textures' formats, decide each discard, it leaves
//! none.

use std::collections::BTreeMap;

use preshade_passes::transforms::specialize::{SpecializeParams, Specialized};
use preshade_plan::guard::{Assumed, Bounds, Place, ScalarType};
use preshade_plan::overrides;
use preshade_plan::plan::{GpuPass, Plan};
use preshade_plan::uniforms::{UniformScalar, uniform_scalars};

use super::constants::{as_facts, both};
use preshade_compiler::command::rewrite::stage_may_discard;
use preshade_draw::scene::bind::{self, BufferBinding, TextureBinding, TextureContent};
use preshade_draw::scene::{Scene, SceneError};

/// Whether a draw of the material of `plan` can discard a fragment in any frame. Values and
/// textures that preshade made up decide nothing. Nor do values that cannot be read, and plans that
/// cannot be specialised.
pub(super) fn can_discard(scene: &Scene, plan: &Plan) -> bool {
    let Some(pass) = plan.main() else {
        return false;
    };
    let Ok(values) = values(scene, plan, pass) else {
        return true;
    };
    let specialized =
        Specialized::new(plan, &as_facts(plan, &values), &SpecializeParams::default());
    specialized.map_or(true, |specialized| {
        stage_may_discard(specialized.program(), pass.fragment.as_deref())
    })
}

/// The overrides, and bounds of uniforms and texels over all draws and frames.
fn values(
    scene: &Scene,
    plan: &Plan,
    pass: &GpuPass,
) -> Result<BTreeMap<Place, Assumed>, SceneError> {
    let mut found: Option<BTreeMap<Place, Assumed>> = None;
    let mut program = None;
    for draw in &scene.draws {
        let material = scene.materials.get(draw.material);
        let Some(material) = material.filter(|m| m.name == plan.material) else {
            continue;
        };
        program = Some(&material.program);
        let scalars = uniform_scalars(material.program.module());
        for (i, (_, frame)) in scene.frames().enumerate() {
            let mut here = BTreeMap::new();
            let buffers = bind::uniform_buffers(scene, material, pass, draw, frame)?;
            for value in scalars
                .iter()
                .filter_map(|scalar| uniform(scalar, &buffers))
            {
                here.insert(value.place.clone(), value);
            }
            // A frame changes no texture's format.
            match (i, &found) {
                (1.., Some(before)) => {
                    let texels = before.iter();
                    let texels = texels.filter(|(p, _)| matches!(p, Place::Texture { .. }));
                    here.extend(texels.map(|(place, value)| (place.clone(), value.clone())));
                }
                _ => {
                    let bound = bind::draw(scene, material, pass, draw, frame)?;
                    let texels = bound.textures.iter().flat_map(texels);
                    here.extend(texels.map(|value| (value.place.clone(), value)));
                }
            }
            found = Some(match found {
                None => here,
                Some(before) => both(before, &here),
            });
        }
    }
    let mut found = found.unwrap_or_default();
    let defaults = program.map(|p| overrides::defaults(p.module()));
    let defaults = defaults.into_iter().flatten();
    found.extend(defaults.map(|value| (value.place.clone(), value)));
    Ok(found)
}

/// The number of a uniform that the scene gives.
fn uniform(scalar: &UniformScalar, buffers: &[BufferBinding]) -> Option<Assumed> {
    let at = |b: &&BufferBinding| (b.group, b.binding) == (scalar.group, scalar.binding);
    let buffer = buffers.iter().find(at)?;
    let from = scalar.offset as usize;
    if buffer.is_invented(&(from..from + 4)) {
        return None;
    }
    let number = scalar
        .ty
        .read(*buffer.data.bytes.get(from..)?.first_chunk()?);
    number.is_finite().then(|| Assumed {
        name: scalar.name.clone(),
        place: scalar.place(),
        ty: scalar.ty,
        bounds: Bounds::one(number),
    })
}

/// Bounds of the channels of a texture that the scene gives, by its format. Filtering, borders and
/// reads outside stay within them, too.
fn texels(texture: &TextureBinding) -> Vec<Assumed> {
    let TextureContent::Image(image) = &texture.content else {
        return Vec::new();
    };
    let format = format!("{:?}", image.format);
    let low = match () {
        () if texture.is_invented => return Vec::new(),
        () if !matches!(texture.sample_type, wgpu::TextureSampleType::Float { .. }) => {
            return Vec::new();
        }
        () if format.contains("Unorm") => 0.0,
        () if format.contains("Snorm") => -1.0,
        () => return Vec::new(),
    };
    let (group, binding) = (texture.group, texture.binding);
    let channel = |channel| Assumed {
        name: format!("{group}.{binding}.{channel}"),
        place: Place::Texture {
            group,
            binding,
            channel,
        },
        ty: ScalarType::F32,
        bounds: Bounds { low, high: 1.0 },
    };
    (0..4).map(channel).collect()
}
