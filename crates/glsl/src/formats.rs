//! GLSL's formats of images (4.60, 4.4.7).

use naga::StorageFormat as F;

#[rustfmt::skip]
const FORMATS: &[(&str, F)] = &[
    ("rgba32f", F::Rgba32Float),
    ("rgba16f", F::Rgba16Float),
    ("rg32f", F::Rg32Float),
    ("rg16f", F::Rg16Float),
    ("r11f_g11f_b10f", F::Rg11b10Ufloat),
    ("r32f", F::R32Float),
    ("r16f", F::R16Float),
    ("rgba16", F::Rgba16Unorm),
    ("rgb10_a2ui", F::Rgb10a2Uint),
    ("rgb10_a2", F::Rgb10a2Unorm),
    ("rgba8", F::Rgba8Unorm),
    ("rg16", F::Rg16Unorm),
    ("rg8", F::Rg8Unorm),
    ("r16", F::R16Unorm),
    ("r8", F::R8Unorm),
    ("rgba16_snorm", F::Rgba16Snorm),
    ("rgba8_snorm", F::Rgba8Snorm),
    ("rg16_snorm", F::Rg16Snorm),
    ("rg8_snorm", F::Rg8Snorm),
    ("r16_snorm", F::R16Snorm),
    ("r8_snorm", F::R8Snorm),
    ("rgba32i", F::Rgba32Sint),
    ("rgba16i", F::Rgba16Sint),
    ("rgba8i", F::Rgba8Sint),
    ("rg32i", F::Rg32Sint),
    ("rg16i", F::Rg16Sint),
    ("rg8i", F::Rg8Sint),
    ("r32i", F::R32Sint),
    ("r16i", F::R16Sint),
    ("r8i", F::R8Sint),
    ("rgba32ui", F::Rgba32Uint),
    ("rgba16ui", F::Rgba16Uint),
    ("rgba8ui", F::Rgba8Uint),
    ("r64ui", F::R64Uint),
    ("rg32ui", F::Rg32Uint),
    ("rg16ui", F::Rg16Uint),
    ("rg8ui", F::Rg8Uint),
    ("r32ui", F::R32Uint),
    ("r16ui", F::R16Uint),
    ("r8ui", F::R8Uint),
];

/// The image format with a GLSL name.
pub(super) fn format_named(name: &str) -> Option<F> {
    let found = FORMATS.iter().find(|(word, _)| *word == name);
    found.map(|(_, format)| *format)
}
