//! Textures and glTF files come out as their formats say.

use glam::{Mat4, Vec3};
use preshade_draw::scene::image::{Pattern, Recipe, mip_chain};
use preshade_draw::scene::{Image, SceneError, Stream};
use preshade_scenes::asset::mesh::Gltf;
use preshade_scenes::image::{Reading, decode};
use preshade_scenes::mesh::positions;
use shader_text::limits::Limits;

fn decoded(name: &str, bytes: &[u8]) -> Result<Image, SceneError> {
    let reading = Reading::of(&Recipe::default());
    decode(name, bytes, reading, &Limits::default(), &|_| Ok(()))
}

#[test]
fn mips_average_light_and_not_its_encoding() {
    let black_and_white = [[0, 0, 0, 0], [255, 255, 255, 255]].concat();
    let linear = mip_chain([2, 1], black_and_white.clone(), false);
    assert_eq!(linear[1], [128, 128, 128, 128]);
    // Half the light of white is 188 in sRGB; alpha is never encoded.
    let srgb = mip_chain([2, 1], black_and_white, true);
    assert_eq!(srgb[1], [188, 188, 188, 128]);
}

#[test]
fn mip_chains_reach_one_texel_from_any_size() {
    let levels = mip_chain([5, 3], vec![77; 5 * 3 * 4], true);
    let sizes: Vec<usize> = levels.iter().map(Vec::len).collect();
    assert_eq!(sizes, [60, 2 * 4, 4]);
    assert!(levels.iter().flatten().all(|b| *b == 77));
}

#[test]
fn patterns_are_the_same_every_time_and_cutouts_have_holes() {
    for pattern in [Pattern::Leaf, Pattern::Chain, Pattern::Lace] {
        let recipe = Recipe {
            pattern: Some(pattern),
            size: 64,
            ..Recipe::default()
        };
        let image = recipe.generate();
        assert_eq!(image, recipe.generate());
        let opaque = image.levels[0].chunks(4).filter(|t| t[3] == 255).count();
        assert!(
            (64 * 64 / 10..64 * 64 * 9 / 10).contains(&opaque),
            "{pattern:?} {opaque}"
        );
    }
}

#[test]
fn png_files_are_srgb_unless_told_otherwise() {
    let mut png = Vec::new();
    let texels = [10, 20, 30, 255, 40, 50, 60, 0];
    image::write_buffer_with_format(
        &mut std::io::Cursor::new(&mut png),
        &texels,
        2,
        1,
        image::ColorType::Rgba8,
        image::ImageFormat::Png,
    )
    .unwrap();
    let read = decoded("two.png", &png).unwrap();
    assert_eq!(
        (read.size, read.format.is_srgb(), &read.levels[0][..]),
        ([2, 1], true, &texels[..])
    );
    let broken = decoded("two.png", &png[..20]).unwrap_err();
    assert!(broken.to_string().contains("`two.png`"), "{broken}");
}

/// One row of texels of a format.
fn read(format: wgpu::TextureFormat, bytes: &[u8]) -> Vec<[f32; 4]> {
    let texel = format.block_copy_size(None).unwrap() as usize;
    let size = [(bytes.len() / texel) as u32, 1];
    let image = Image {
        format,
        ..Image::rgba8(size, 1, false, vec![bytes.to_vec()])
    };
    image.texels().unwrap().all().collect()
}

#[test]
fn texels_of_all_kinds_of_formats_are_read() {
    use wgpu::TextureFormat as F;
    assert_eq!(read(F::R8Unorm, &[255, 0])[0], [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(read(F::Bgra8Unorm, &[0, 0, 255, 0]), [[1.0, 0.0, 0.0, 0.0]]);
    assert_eq!(read(F::Rg8Snorm, &[0x80, 127]), [[-1.0, 1.0, 0.0, 1.0]]);
    let half = half::f16::from_f32(1.5).to_le_bytes();
    assert_eq!(read(F::R16Float, &half), [[1.5, 0.0, 0.0, 1.0]]);
    assert_eq!(read(F::R32Float, &2.5_f32.to_le_bytes())[0][0], 2.5);
    let word = (1023_u32 | 3 << 30).to_le_bytes();
    assert_eq!(read(F::Rgb10a2Unorm, &word), [[1.0, 0.0, 0.0, 1.0]]);
    // 1 as a float of 11 and of 10 bits, and with a shared exponent.
    let word = (15_u32 << 6 | 15 << (11 + 6) | 15 << (22 + 5)).to_le_bytes();
    assert_eq!(read(F::Rg11b10Ufloat, &word), [[1.0, 1.0, 1.0, 1.0]]);
    let word = (256_u32 | 128 << 9 | 16 << 27).to_le_bytes();
    assert_eq!(read(F::Rgb9e5Ufloat, &word), [[1.0, 0.5, 0.0, 1.0]]);
    let compressed = Image {
        format: F::Bc7RgbaUnorm,
        ..Image::rgba8([5, 5], 1, false, vec![vec![0; 64]])
    };
    assert!(compressed.texels().is_none());
    assert_eq!(compressed.rows(0), Some([32, 2]));
}

#[test]
fn a_volume_has_fewer_slices_in_each_level() {
    let volume = Image {
        layers: 4,
        dimension: wgpu::TextureDimension::D3,
        format: wgpu::TextureFormat::R8Uint,
        ..Image::rgba8([4, 2], 1, false, vec![(0..32).collect(), vec![9; 4]])
    };
    let texels = volume.texels().unwrap();
    assert_eq!(texels.at(0, [1, 1, 2]).unwrap()[0], 21.0);
    assert_eq!(volume.extent(1), [2, 1, 2]);
    assert_eq!(texels.at(1, [1, 0, 1]).unwrap()[0], 9.0);
    assert_eq!(texels.at(1, [0, 0, 2]), None);
}

/// A KTX2 file of one level: Vulkan's format, the colour model, the transfer function, the scheme of
/// compression, and the level as stored.
fn ktx2(of: [u32; 4], size: u32, stored: &[u8], length: usize) -> Vec<u8> {
    let [format, model, transfer, scheme] = of;
    let mut out = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    let mut words = |words: &[u32]| out.extend(words.iter().flat_map(|w| w.to_le_bytes()));
    words(&[format, 1, size, size, 0, 0, 1, 1, scheme]);
    // The descriptor follows the index of the one level; there is no other metadata.
    let (descriptor, data) = (80 + 24, 80 + 24 + 44);
    words(&[descriptor, 44, 0, 0, 0, 0, 0, 0]);
    words(&[data, 0, stored.len() as u32, 0, length as u32, 0]);
    words(&[44, 0, 2 | 40 << 16, model | 1 << 8 | transfer << 16]);
    words(&[0, 16, 0, 127 << 16, 0, 0, u32::MAX]);
    out.extend(stored);
    out
}

#[test]
fn ktx2_files_have_their_own_formats() {
    let decode = |bytes: &[u8]| decoded("a.ktx2", bytes);
    // R8_UNORM, as it is, and in a frame of Zstandard with one raw block.
    let plain = decode(&ktx2([9, 1, 1, 0], 2, &[1, 2, 3, 4], 4)).unwrap();
    assert_eq!(plain.format, wgpu::TextureFormat::R8Unorm);
    assert_eq!(plain.levels, [[1, 2, 3, 4]]);
    let frame = [0x28, 0xb5, 0x2f, 0xfd, 0x20, 4, 0x21, 0, 0, 1, 2, 3, 4];
    let packed = decode(&ktx2([9, 1, 1, 2], 2, &frame, 4)).unwrap();
    assert_eq!(packed.levels, plain.levels);
    let etc1s = decode(&ktx2([0, 163, 2, 1], 4, &[0; 16], 0)).unwrap_err();
    assert!(etc1s.to_string().contains("ETC1S"), "{etc1s}");
    // A block of UASTC.
    let block = [
        219, 166, 131, 66, 15, 38, 152, 255, 67, 200, 81, 217, 98, 234, 115, 251,
    ];
    let uastc = decode(&ktx2([0, 166, 2, 0], 4, &block, 16));
    match cfg!(feature = "basis") {
        true => {
            let uastc = uastc.unwrap();
            assert_eq!(uastc.format, wgpu::TextureFormat::Bc7RgbaUnormSrgb);
            assert_eq!(uastc.levels[0].len(), 16);
        }
        false => assert!(uastc.unwrap_err().to_string().contains("`basis`")),
    }
}

/// A triangle bound to one joint that has moved up by 5 since it was bound at y = 2, under a node
/// that must not move it.
fn glb() -> Vec<u8> {
    let mut bin: Vec<u8> = Vec::new();
    let mut floats = |v: &[f32]| bin.extend(v.iter().flat_map(|f| f.to_le_bytes()));
    floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0.]);
    floats(&[1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0.]);
    floats(&Mat4::from_translation(Vec3::new(0., -2., 0.)).to_cols_array());
    bin.extend([0_u8; 12]);
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1]}}],
        "nodes":[{{"mesh":0,"skin":0,"translation":[9,9,9]}},{{"translation":[0,7,0]}}],
        "skins":[{{"joints":[1],"inverseBindMatrices":2}}],
        "meshes":[{{"name":"tri","primitives":[{{"attributes":{{"POSITION":0,"WEIGHTS_0":1,"JOINTS_0":3}}}}]}}],
        "buffers":[{{"byteLength":{}}}],
        "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":48}},
            {{"buffer":0,"byteOffset":84,"byteLength":64}},{{"buffer":0,"byteOffset":148,"byteLength":12}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
            {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC4"}},
            {{"bufferView":2,"componentType":5126,"count":1,"type":"MAT4"}},
            {{"bufferView":3,"componentType":5121,"count":3,"type":"VEC4"}}]}}"#,
        bin.len()
    );
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut out = b"glTF".to_vec();
    let word = |n: usize| (n as u32).to_le_bytes();
    out.extend(word(2));
    out.extend(word(12 + 8 + json.len() + 8 + bin.len()));
    out.extend(word(json.len()));
    out.extend(b"JSON");
    out.extend(&json);
    out.extend(word(bin.len()));
    out.extend(b"BIN\0");
    out.extend(&bin);
    out
}

#[test]
fn gltf_skins_keep_the_files_pose() {
    let gltf = |mesh: Option<&str>| Gltf {
        file: "tri.glb".to_owned(),
        mesh: mesh.map(str::to_owned),
        ..Gltf::default()
    };
    let rigged = gltf(None).load("tri", &|_| Ok(glb())).unwrap();
    let at: Vec<Vec3> = positions(&rigged.mesh).collect();
    assert_eq!(at, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert_eq!(
        *rigged.joints,
        [Mat4::from_translation(Vec3::new(0., 5., 0.))]
    );
    assert_eq!(
        rigged.mesh.streams["joints"],
        Stream::Uint {
            components: 4,
            data: vec![0; 12]
        }
    );
    // Without normals in the file, they come from the triangles.
    assert_eq!(
        rigged.mesh.streams["normal"],
        Stream::Float {
            components: 3,
            data: [0., 0., 1.].repeat(3)
        }
    );
    let wrong = gltf(Some("try")).load("tri", &|_| Ok(glb())).unwrap_err();
    assert_eq!(
        wrong.to_string(),
        "`tri.glb`: there is no mesh `try` (did you mean `tri`?)"
    );
    let cut = gltf(None)
        .load("tri", &|_| Ok(glb()[..80].to_vec()))
        .unwrap_err();
    assert!(cut.to_string().contains("no glTF 2.0"), "{cut}");
}
