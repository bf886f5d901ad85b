//! Materials: a program with its values, textures and samplers, checked against the program's
//! declarations.

use std::sync::{Arc, LazyLock};

use naga::{ImageDimension, TypeInner};

use super::globals::globals;
use super::image::{Pattern, Recipe};
use super::{Image, Material, SceneError, value_path};

/// Refuses values, textures, samplers and attributes that the program lacks, because they are
/// misspellings. The error's subject is the key.
pub fn check(material: &Material) -> Result<(), SceneError> {
    let module = material.program.module();
    let (mut textures, mut samplers) = (Vec::new(), Vec::new());
    for g in globals(&material.program) {
        match module.types[g.ty].inner {
            _ if g.is_buffer => {}
            TypeInner::Sampler { .. } => samplers.push(g.name),
            TypeInner::Image {
                dim: ImageDimension::Cube,
                ..
            } => {
                square(material, g.name)?;
                textures.push(g.name);
            }
            _ => textures.push(g.name),
        }
    }
    let unknown = |what: &str, name: &str, known: Vec<&str>| {
        let text = format!(
            "the shader of material `{}` has no {what} `{name}`",
            material.name
        );
        Err(SceneError::new(text).suggest(name, known).about(name))
    };
    value_path::check(material, &material.values)?;
    for name in material.textures.keys() {
        if !textures.contains(&name.as_str()) {
            return unknown("texture", name, textures);
        }
    }
    for name in material.samplers.keys() {
        if !samplers.contains(&name.as_str()) {
            return unknown("sampler", name, samplers);
        }
    }
    let inputs = material
        .program
        .entry_point(naga::ShaderStage::Vertex, &material.vertex)
        .map(|(_, e)| naga_edit::interface::inputs(module, &e.function))
        .unwrap_or_default();
    let names: Vec<&str> = inputs.iter().filter_map(|i| i.name.as_deref()).collect();
    for name in material.attributes.keys() {
        if !names.contains(&name.as_str()) {
            return unknown("vertex attribute", name, names);
        }
    }
    Ok(())
}

/// Refuses an image for a cube that is not square.
fn square(material: &Material, texture: &str) -> Result<(), SceneError> {
    let [width, height] = match material.textures.get(texture) {
        Some(image) => image.size,
        None => return Ok(()),
    };
    match width == height {
        true => Ok(()),
        false => Err(SceneError::new(format!(
            "`{texture}` is a cube texture, which needs a square picture, and this one has \
             {width}x{height} texels"
        ))
        .help("each of the six faces shows the picture: give one face, and no cross or panorama")
        .about(texture)),
    }
}

/// The default image of a texture. Its name determines a normal map, a mask, noise, or a coloured
/// pattern.
pub fn default_texture(name: &str, dim: ImageDimension) -> Arc<Image> {
    static COLOR: LazyLock<Arc<Image>> = LazyLock::new(|| {
        Arc::new(
            Recipe {
                pattern: Some(Pattern::Bricks),
                colors: [[0.62, 0.58, 0.54], [0.95, 0.91, 0.86]],
                srgb: Some(true),
                ..Recipe::default()
            }
            .generate(),
        )
    });
    static NORMAL: LazyLock<Arc<Image>> = LazyLock::new(|| {
        Arc::new(
            Recipe {
                pattern: Some(Pattern::Bricks),
                normal: Some(4.0),
                ..Recipe::default()
            }
            .generate(),
        )
    });
    static NOISE: LazyLock<Arc<Image>> = LazyLock::new(|| {
        Arc::new(
            Recipe {
                pattern: Some(Pattern::Noise),
                ..Recipe::default()
            }
            .generate(),
        )
    });
    static LEAF: LazyLock<Arc<Image>> = LazyLock::new(|| {
        Arc::new(
            Recipe {
                pattern: Some(Pattern::Leaf),
                colors: [[0.42, 0.55, 0.2], [0.8, 0.92, 0.5]],
                srgb: Some(true),
                ..Recipe::default()
            }
            .generate(),
        )
    });
    static CUBE: LazyLock<Arc<Image>> = LazyLock::new(|| {
        let mut image = NOISE.as_ref().clone();
        image.layers = 6;
        for level in &mut image.levels {
            *level = level.repeat(6);
        }
        Arc::new(image)
    });
    let name = name.to_lowercase();
    let has = |words: &[&str]| words.iter().any(|w| name.contains(w));
    Arc::clone(if dim == ImageDimension::Cube {
        &CUBE
    } else if has(&["normal", "bump"]) {
        &NORMAL
    } else if has(&["alpha", "mask", "leaf", "foliage", "cutout", "opacity"]) {
        &LEAF
    } else if has(&[
        "rough",
        "metal",
        "noise",
        "height",
        "occlusion",
        "ao",
        "displace",
    ]) {
        &NOISE
    } else {
        &COLOR
    })
}
