//! Maps values of glTF materials to bindings of a shader, by name and role.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::{Expression, ImageDimension, TypeInner};

use super::material::{Look, Pictures, Use};
use preshade_draw::scene::globals::{Global, globals};
use preshade_draw::scene::semantic::normalise;
use preshade_draw::scene::{Image, Material, SceneError, Value, layout};

/// The source of a binding's value.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Mapped {
    /// Name of the texture, sampler, variable or member.
    pub binding: String,
    /// The source: a name in glTF, or a description of a made-up value.
    pub from: String,
}

/// A numeric property of a glTF material.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Factor {
    BaseColor,
    Metallic,
    Roughness,
    Emissive,
    EmissiveStrength,
    NormalScale,
    OcclusionStrength,
    AlphaCutoff,
    Transform(Use),
}

/// Suffixes that carry no information about a texture's role.
const ENDINGS: [&str; 7] = ["texture", "tex", "map", "sampler", "image", "smp", "view"];

/// A name in normalised form, without prefixes and suffixes.
fn bare(name: &str) -> String {
    let whole = normalise(name);
    let mut rest = whole
        .strip_prefix("t")
        .filter(|_| name.starts_with("t_"))
        .unwrap_or(&whole);
    rest = rest
        .strip_prefix("s")
        .filter(|_| name.starts_with("s_"))
        .unwrap_or(rest);
    while let Some(shorter) = ENDINGS.iter().find_map(|end| rest.strip_suffix(end)) {
        rest = shorter;
    }
    rest.to_owned()
}

/// A texture's role, by its name.
fn use_of(name: &str) -> Option<Use> {
    Some(match bare(name).as_str() {
        "basecolor" | "basecolour" | "albedo" | "diffuse" | "color" | "colour" | "base" | "" => {
            Use::BaseColor
        }
        "metallicroughness"
        | "roughnessmetallic"
        | "metalrough"
        | "metalroughness"
        | "mr"
        | "orm"
        | "arm"
        | "rma"
        | "roughness"
        | "rough"
        | "metallic"
        | "metalness"
        | "metal"
        | "occlusionroughnessmetallic" => Use::MetallicRoughness,
        "normal" | "normals" | "bump" => Use::Normal,
        "occlusion" | "ao" | "ambientocclusion" => Use::Occlusion,
        "emissive" | "emission" | "glow" => Use::Emissive,
        _ => return None,
    })
}

/// Words that mark names of variables, members and types outside of materials. Their colours and
/// strengths do not come from glTF.
const NOT_MATERIAL: [&str; 14] = [
    "light",
    "lamp",
    "sun",
    "sky",
    "fog",
    "ambient",
    "env",
    "camera",
    "shadow",
    "scene",
    "frame",
    "probe",
    "atmosphere",
    "post",
];

/// Whether a name belongs to something other than a material, such as `pointLights` or `SkyParams`.
fn is_of_scene(name: &str) -> bool {
    let name = normalise(name);
    let is_material = ["material", "surface"].iter().any(|w| name.contains(w));
    !is_material && NOT_MATERIAL.iter().any(|word| name.contains(word))
}

/// The material property that a variable or member holds, by its name.
fn factor_of(path: &str) -> Option<Factor> {
    let last = path.rsplit('.').next().unwrap_or(path);
    let name = normalise(last);
    for end in [
        "uvtransform",
        "textransform",
        "texturetransform",
        "transform",
        "uvmatrix",
    ] {
        if let Some(of) = name.strip_suffix(end)
            && !of.is_empty()
            && let Some(of) = use_of(of)
        {
            return Some(Factor::Transform(of));
        }
    }
    Some(match name.strip_suffix("factor").unwrap_or(&name) {
        "basecolor" | "basecolour" | "albedo" | "albedocolor" | "diffuse" | "diffusecolor"
        | "color" | "colour" | "tint" => Factor::BaseColor,
        "metallic" | "metalness" | "metal" => Factor::Metallic,
        "roughness" | "rough" | "perceptualroughness" => Factor::Roughness,
        "emissive" | "emission" | "emissivecolor" => Factor::Emissive,
        "emissivestrength" | "emissiveintensity" => Factor::EmissiveStrength,
        "normalscale" | "bumpscale" => Factor::NormalScale,
        "occlusionstrength" | "aostrength" | "aointensity" | "aomapintensity" => {
            Factor::OcclusionStrength
        }
        "alphacutoff" | "alphatest" | "cutoff" | "alphathreshold" => Factor::AlphaCutoff,
        _ => return None,
    })
}

impl Factor {
    fn name(self) -> String {
        match self {
            Self::BaseColor => "baseColorFactor".to_owned(),
            Self::Metallic => "metallicFactor".to_owned(),
            Self::Roughness => "roughnessFactor".to_owned(),
            Self::Emissive => "emissiveFactor".to_owned(),
            Self::EmissiveStrength => "emissiveStrength".to_owned(),
            Self::NormalScale => "normalTexture.scale".to_owned(),
            Self::OcclusionStrength => "occlusionTexture.strength".to_owned(),
            Self::AlphaCutoff => "alphaCutoff".to_owned(),
            Self::Transform(of) => format!("{}'s KHR_texture_transform", of.name()),
        }
    }

    fn numbers(self, look: &Look, has_strength: bool) -> Vec<f64> {
        let one = |n: f32| vec![f64::from(n)];
        match self {
            Self::BaseColor => look.base_color.map(f64::from).to_vec(),
            Self::Metallic => one(look.metallic),
            Self::Roughness => one(look.roughness),
            Self::Emissive => {
                // A shader with its own strength gets the bare factor.
                let by = match has_strength && look.emissive_strength > 0.0 {
                    true => look.emissive_strength,
                    false => 1.0,
                };
                look.emissive.map(|n| f64::from(n / by)).to_vec()
            }
            Self::EmissiveStrength => one(look.emissive_strength),
            Self::NormalScale => one(look.normal_scale),
            Self::OcclusionStrength => one(look.occlusion_strength),
            // No alpha is below 0, so nothing is discarded.
            Self::AlphaCutoff if look.alpha != gltf::material::AlphaMode::Mask => vec![0.0],
            Self::AlphaCutoff => one(look.alpha_cutoff),
            Self::Transform(of) => {
                let moved = look.slots.get(&of).and_then(|slot| slot.transform);
                let still = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
                moved.unwrap_or(still).to_vec()
            }
        }
    }
}

/// Fills the inputs that the author left open with values of a glTF material. Returns the source of
/// each.
///
/// # Errors
/// A texture cannot be read.
pub(crate) fn fill(
    target: &mut Material,
    look: &Look,
    pictures: &Pictures<'_>,
) -> Result<Vec<Mapped>, SceneError> {
    let mut mapped = Vec::new();
    let program = target.program.clone();
    let module = program.module();
    let globals: Vec<_> = globals(&program).collect();
    for global in globals.iter().filter(|g| !g.is_buffer) {
        let is_flat = matches!(
            module.types[global.ty].inner,
            TypeInner::Image {
                dim: ImageDimension::D2,
                arrayed: false,
                class: naga::ImageClass::Sampled { .. },
            }
        );
        let Some(of) = use_of(global.name).filter(|_| is_flat) else {
            continue;
        };
        if target.textures.contains_key(global.name) {
            continue;
        }
        let (image, from) = match look.slots.get(&of) {
            Some(slot) => (pictures.of(slot)?, of.name().to_owned()),
            None => (
                neutral(of),
                format!("made up: the material has no {}", of.name()),
            ),
        };
        target.textures.insert(global.name.to_owned(), image);
        mapped.push(Mapped {
            binding: global.name.to_owned(),
            from,
        });
    }
    samplers(target, look, &globals, &mut mapped);
    let buffers = globals.iter().filter(|g| g.is_buffer && !g.is_storage);
    let paths: Vec<String> = buffers
        .flat_map(|g| layout::paths(module, g.name, g.ty))
        .collect();
    let has_strength = paths
        .iter()
        .any(|p| factor_of(p) == Some(Factor::EmissiveStrength));
    for path in paths {
        let Some(factor) = factor_of(&path).filter(|_| !target.values.contains_key(&path)) else {
            continue;
        };
        let Some(size) = numbers_of(&program, &path) else {
            continue;
        };
        let mut numbers = factor.numbers(look, has_strength);
        // The shader's colour has an alpha channel that the property lacks.
        if numbers.len() == 3 && size == 4 {
            numbers.push(1.0);
        }
        if numbers.len() < size {
            continue;
        }
        numbers.truncate(size);
        target.values.insert(path.clone(), Value::Numbers(numbers));
        mapped.push(Mapped {
            binding: path,
            from: factor.name(),
        });
    }
    Ok(mapped)
}

/// Gives each sampler the settings of its texture, found by name or by first use.
fn samplers(target: &mut Material, look: &Look, globals: &[Global<'_>], mapped: &mut Vec<Mapped>) {
    let program = target.program.clone();
    let module = program.module();
    let mut used: BTreeMap<String, Use> = BTreeMap::new();
    let functions = module.functions.iter().map(|(_, f)| f);
    for function in functions.chain(module.entry_points.iter().map(|e| &e.function)) {
        for (_, expression) in function.expressions.iter() {
            let Expression::ImageSample { image, sampler, .. } = *expression else {
                continue;
            };
            let name = |e| match function.expressions[e] {
                Expression::GlobalVariable(g) => module.global_variables[g].name.clone(),
                _ => None,
            };
            if let (Some(image), Some(sampler)) = (name(image), name(sampler))
                && let Some(of) = use_of(&image)
            {
                used.entry(sampler).or_insert(of);
            }
        }
    }
    for global in globals {
        let is_plain = matches!(
            module.types[global.ty].inner,
            TypeInner::Sampler { comparison: false }
        );
        if !is_plain || target.samplers.contains_key(global.name) {
            continue;
        }
        let of = used
            .get(global.name)
            .copied()
            .or_else(|| use_of(global.name));
        let Some(slot) = of.and_then(|of| look.slots.get(&of)) else {
            continue;
        };
        let of = of.map_or("", Use::name);
        target.samplers.insert(global.name.to_owned(), slot.sampler);
        mapped.push(Mapped {
            binding: global.name.to_owned(),
            from: format!("the sampler of {of}"),
        });
    }
}

/// Number of scalars in the scalar, vector or matrix at a path. `None` if there is none, or if the
/// path leads through something that is no material, such as a light.
fn numbers_of(program: &preshade_plan::program::Program, path: &str) -> Option<usize> {
    let module = program.module();
    let mut names: Vec<&str> = path.split('.').collect();
    let buffer = |name: &str| globals(program).find(|g| g.is_buffer && g.name == name);
    let mut ty = match buffer(names[0]) {
        Some(global) => global.ty,
        // A member of an unnamed block.
        None => {
            names.insert(0, "");
            buffer("")?.ty
        }
    };
    for pair in names.windows(2) {
        let type_name = module.types[ty].name.as_deref().unwrap_or("");
        if is_of_scene(pair[0]) || is_of_scene(type_name) {
            return None;
        }
        let TypeInner::Struct { members, .. } = &module.types[ty].inner else {
            return None;
        };
        ty = members
            .iter()
            .find(|m| m.name.as_deref() == Some(pair[1]))?
            .ty;
    }
    let (columns, rows, _) = layout::leaf_shape(&module.types[ty].inner)?;
    Some((columns * rows) as usize)
}

/// A texture that has no effect in this role.
fn neutral(of: Use) -> Arc<Image> {
    Arc::new(Image::rgba8([1, 1], 1, false, vec![of.neutral().to_vec()]))
}

/// Notes for the report: each binding once per shader, with its source and the number of materials.
pub(crate) fn told(all: &[(String, Vec<Mapped>)]) -> Vec<String> {
    let mut by_shader: BTreeMap<&str, BTreeMap<&Mapped, usize>> = BTreeMap::new();
    for (shader, mapped) in all {
        let of = by_shader.entry(shader).or_default();
        mapped.iter().for_each(|m| *of.entry(m).or_default() += 1);
    }
    // A shader without values from the file gets no note.
    let fed = by_shader.into_iter().filter(|(_, rows)| !rows.is_empty());
    let shaders = fed.map(|(shader, rows)| {
        let materials = all.iter().filter(|(s, _)| s == shader).count();
        let width = rows.keys().map(|m| m.binding.len()).max().unwrap_or(0);
        let lines = rows.iter().map(|(m, n)| {
            let some = match *n == materials {
                true => String::new(),
                false => format!(" ({n} of {materials} materials)"),
            };
            format!("\n  {:<width$}  {}{some}", m.binding, m.from)
        });
        format!(
            "`{shader}` gets from the file:{}",
            lines.collect::<String>()
        )
    });
    shaders.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shader_that_the_file_feeds_nothing_is_not_told() {
        let fed = Mapped {
            binding: "tint".to_owned(),
            from: "`baseColorFactor`".to_owned(),
        };
        let all = [
            ("dark.wgsl".to_owned(), Vec::new()),
            ("lit.wgsl".to_owned(), vec![fed]),
        ];
        let notes = told(&all);
        let expected = "`lit.wgsl` gets from the file:\n  tint  `baseColorFactor`";
        assert_eq!(notes, [expected]);
    }
}
