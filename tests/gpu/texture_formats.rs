//! Images of every kind reach the shader as their formats say.

use std::sync::Arc;

use glam::{Mat4, Vec3};
use preshade_draw::render::{Error, SceneInputs};
use preshade_draw::scene::bind::{self, TextureContent};
use preshade_draw::scene::{Filter, Image, Material};
use wgpu::{TextureDimension, TextureFormat};

use crate::render_support::*;

/// A material that shows `body`, with `image` bound as `declared`.
fn showing(declared: &str, body: &str, image: Image) -> Material {
    let source = FLAT.replace(
        "@fragment fn fs() -> @location(0) vec4<f32> { return object.tint; }",
        &format!(
            "@group(1) @binding(1) var image: {declared};
@group(1) @binding(2) var smooth_sampler: sampler;
@fragment fn fs() -> @location(0) vec4<f32> {{ return {body} * object.tint; }}"
        ),
    );
    let mut material = material("shown", &source);
    material
        .textures
        .insert("image".to_owned(), Arc::new(image));
    material
}

/// The colour of a square with this material.
fn shown(declared: &str, body: &str, image: Image) -> [u8; 4] {
    let material = showing(declared, body, image);
    let tint = draw("all", Mat4::IDENTITY, [1.0; 4]);
    let out = render(gpu(), &scene([4, 4], vec![material], vec![tint]));
    let color = out.colors[0].as_ref().unwrap();
    color.texel(0).try_into().unwrap()
}

fn image(format: TextureFormat, size: [u32; 2], layers: u32, levels: Vec<Vec<u8>>) -> Image {
    Image {
        format,
        ..Image::rgba8(size, layers, false, levels)
    }
}

#[test]
fn an_image_of_any_format_is_drawn_as_it_is() {
    use TextureFormat as F;
    let floats = |n: &[f32]| n.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
    let sampled = "textureSampleLevel(image, smooth_sampler, vec2(0.5), 0.0)";
    let r32 = image(F::R32Float, [2, 1], 1, vec![floats(&[0.2, 0.6])]);
    let loaded = "vec4(textureLoad(image, vec2(1, 0), 0).rrr, 1.0)";
    assert_eq!(shown("texture_2d<f32>", loaded, r32), [153, 153, 153, 255]);
    let half = |n: f32| half::f16::from_f32(n).to_le_bytes();
    let rgba16 = [half(0.2), half(0.4), half(0.6), half(1.0)].concat();
    let rgba16 = image(F::Rgba16Float, [1, 1], 1, vec![rgba16]);
    assert_eq!(
        shown("texture_2d<f32>", sampled, rgba16),
        [51, 102, 153, 255]
    );
    // Red in BC1, in two blocks and a level of less than one.
    if lacks("texture-compression-bc", F::Bc1RgbaUnorm).is_none() {
        let block = [0x00, 0xf8, 0x00, 0xf8, 0, 0, 0, 0];
        let levels = vec![block.repeat(2), block.to_vec(), block.to_vec()];
        let bc1 = image(F::Bc1RgbaUnorm, [8, 4], 1, levels);
        assert_eq!(shown("texture_2d<f32>", sampled, bc1), [255, 0, 0, 255]);
    }
    let second = "vec4(vec3(f32(textureLoad(image, vec2(0, 0), 1, 0).r) / 255.0), 1.0)";
    let layers = image(F::R8Uint, [1, 1], 2, vec![vec![7, 51]]);
    assert_eq!(
        shown("texture_2d_array<u32>", second, layers),
        [51, 51, 51, 255]
    );
    let volume = Image {
        dimension: TextureDimension::D3,
        ..image(F::R8Unorm, [2, 2], 2, vec![vec![0; 8], vec![102]])
    };
    let level = "vec4(textureSampleLevel(image, smooth_sampler, vec3(0.5), 1.0).rrr, 1.0)";
    assert_eq!(
        shown("texture_3d<f32>", level, volume),
        [102, 102, 102, 255]
    );
    for (format, bytes) in [
        (F::Depth32Float, floats(&[0.2, 0.6])),
        (
            F::Depth16Unorm,
            [13107_u16, 39321].map(u16::to_le_bytes).concat(),
        ),
    ] {
        let stored = image(format, [2, 1], 1, vec![bytes]);
        let loaded = "vec4(vec3(textureLoad(image, vec2(1, 0), 0)), 1.0)";
        assert_eq!(
            shown("texture_depth_2d", loaded, stored),
            [153, 153, 153, 255]
        );
    }
    let faces = (0..6).map(|face| face as f32 / 10.0).collect::<Vec<f32>>();
    let cube = image(F::Depth32Float, [1, 1], 6, vec![floats(&faces)]);
    let down =
        "vec4(vec3(textureSampleLevel(image, smooth_sampler, vec3(0.0, -1.0, 0.0), 0)), 1.0)";
    // The fourth face is -y.
    assert_eq!(shown("texture_depth_cube", down, cube)[0], 76);
}

/// Two layouts for one material: a picture through a filter, and a depth without.
#[test]
fn draws_of_one_material_filter_what_they_read_or_not() {
    let body = "vec4(textureSampleLevel(image, smooth_sampler, vec2(0.5), 0.0).rrr, 1.0)";
    let picture = Image::rgba8([1, 1], 1, false, vec![vec![51, 0, 0, 255]]);
    let half = |x: f32| {
        Mat4::from_translation(Vec3::new(x, 0.0, 0.0)) * Mat4::from_scale(Vec3::new(0.5, 1.0, 1.0))
    };
    let mut scene = scene(
        [4, 4],
        vec![showing("texture_2d<f32>", body, picture)],
        vec![
            draw("left", half(-0.5), [1.0; 4]),
            draw("right", half(0.5), [1.0; 4]),
        ],
    );
    let pass = originals(&scene)[0].main().unwrap().clone();
    let frame = &scene.cameras[0].frames[0];
    let bound = bind::draw(&scene, &scene.materials[0], &pass, &scene.draws[1], frame);
    let mut bound = bound.unwrap();
    let depth = vec![0.6_f32.to_le_bytes().to_vec()];
    let depth = image(TextureFormat::Depth32Float, [1, 1], 1, depth);
    bound.textures[0].content = TextureContent::Image(Arc::new(depth));
    bound.samplers[0].sampler.filter = Filter::Nearest;
    scene.draws[1].captured = Some(Arc::new(bound));
    let out = render(gpu(), &scene);
    let color = out.colors[0].as_ref().unwrap();
    assert_eq!(color.texel(0), [51, 51, 51, 255]);
    assert_eq!(color.texel(3), [153, 153, 153, 255]);
}

/// Why a scene with this image cannot be drawn.
fn refused(declared: &str, image: Image) -> Option<Error> {
    let source = format!(
        "{FLAT}@group(1) @binding(1) var image: {declared};
@fragment fn read() -> @location(0) vec4<f32> {{
    return vec4(f32(textureLoad(image, vec2(0, 0), 0).r)) * object.tint;
}}"
    );
    let mut material = material("refused", &source);
    material.fragment = Some("read".to_owned());
    material
        .textures
        .insert("image".to_owned(), Arc::new(image));
    let tint = draw("all", Mat4::IDENTITY, [1.0; 4]);
    let scene = scene([4, 4], vec![material], vec![tint]);
    SceneInputs::new(gpu(), &scene).err()
}

/// The error of an adapter without a compressed format, which must name the feature.
fn lacks(feature: &str, format: TextureFormat) -> Option<Error> {
    let block = vec![0; format.block_copy_size(None).unwrap() as usize];
    let error = refused("texture_2d<f32>", image(format, [4, 4], 1, vec![block]))?;
    let Error::Unsupported { feature: named, .. } = &error else {
        panic!("{error}");
    };
    assert_eq!(named, feature);
    Some(error)
}

#[test]
fn an_image_that_the_shader_cannot_read_is_an_error() {
    let told = |declared, image| refused(declared, image).unwrap().to_string();
    let floats = image(TextureFormat::R32Float, [1, 1], 1, vec![vec![0; 4]]);
    let message = told("texture_2d<u32>", floats);
    assert!(
        message.contains("Uint") && message.contains("R32Float"),
        "{message}"
    );
    let short = image(TextureFormat::R32Float, [2, 1], 1, vec![vec![0; 4]]);
    let message = told("texture_2d<f32>", short);
    assert!(message.contains("has 4 bytes, and needs 8"), "{message}");
    lacks("texture-compression-etc2", TextureFormat::Etc2Rgb8Unorm);
    lacks(
        "texture-compression-astc",
        TextureFormat::Astc {
            block: wgpu::AstcBlock::B4x4,
            channel: wgpu::AstcChannel::Unorm,
        },
    );
}
