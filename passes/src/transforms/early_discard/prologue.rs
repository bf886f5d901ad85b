//! The prologue's text, and its insertion at the start of a fragment entry point.

use naga::{
    Binding, BuiltIn, Expression, Handle, Module, ResourceBinding, Scalar, Statement, TypeInner,
    VectorSize,
};

use super::{DepthTexture, Mode, Quad, gradients, packed};
use crate::rebuild::place;
use crate::rebuild::prologue::Ahead;
use crate::rebuild::quad::{self, HIDDEN};
use crate::rebuild::snippet::{InjectError, link_snippet};
use preshade_plan::state::{DepthDirection, DepthFormat};

/// Name of the depth texture in the emitted module.
pub(crate) const TEXTURE: &str = "prepass_depth";

/// Range of a fragment's depth before it is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DepthRange {
    /// Clipped to 0..1 by the rasteriser.
    Clipped,
    /// Arbitrary, then clamped: the shader writes it, or clipping is off.
    Clamped,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Prologue {
    pub texture: DepthTexture,
    pub samples: u32,
    pub format: DepthFormat,
    pub direction: DepthDirection,
    /// Which lanes of a quad return early.
    pub quad: Quad,
    /// Whether to drop hidden fragments or visible ones.
    pub mode: Mode,
    /// Range of the compared depths.
    pub range: DepthRange,
    /// A fixed tolerance in depth. `None`: it follows from format, depth and slope.
    pub tolerance: Option<f32>,
    pub binding: ResourceBinding,
}

impl Prologue {
    /// The prologue as WGSL: a texture and a function `hidden_by_prepass(position, depth) -> bool`.
    pub fn wgsl(&self) -> String {
        let ResourceBinding { group, binding } = self.binding;
        let multisampled = self.samples > 1;
        let ty = match (self.texture, multisampled) {
            (DepthTexture::Depth, false) => "texture_depth_2d",
            (DepthTexture::Depth, true) => "texture_depth_multisampled_2d",
            (DepthTexture::Float | DepthTexture::Packed, false) => "texture_2d<f32>",
            (DepthTexture::Float | DepthTexture::Packed, true) => "texture_multisampled_2d<f32>",
        };
        // A fragment is hidden if it is behind every sample: compare with the farthest.
        let farther = match self.direction {
            DepthDirection::Forward => "max",
            DepthDirection::Reversed => "min",
        };
        let nearest = (0..self.samples.max(1))
            .map(|s| self.texel(&format!("textureLoad({TEXTURE}, pixel, {s})")))
            .reduce(|a, b| format!("{farther}({a}, {b})"))
            .unwrap_or_default();
        let behind = match self.direction {
            DepthDirection::Forward => "depth > nearest + tolerance",
            DepthDirection::Reversed => "depth < nearest - tolerance",
        };
        let (vote, hidden) = match self.quad {
            Quad::Lane => (String::new(), "behind"),
            Quad::Vote => (quad::vote_wgsl("behind"), "quad > 0.5"),
        };
        let answer = match self.mode {
            Mode::Cull => hidden.to_owned(),
            Mode::Invert => format!("!({hidden})"),
        };
        // A written or unclipped depth is clamped before it is stored. No language defines the
        // result for NaN, so a fragment whose depth is NaN is never behind. A compiler may fold
        // `own != own` to false, but not a comparison of bits.
        let (parameter, clamped, behind) = match self.range {
            DepthRange::Clipped => ("depth", "", behind.to_owned()),
            DepthRange::Clamped => (
                "own",
                "let depth = saturate(own);\n    ",
                format!(
                    "select(false, {behind}, (bitcast<u32>(own) & 0x7fffffffu) <= 0x7f800000u)"
                ),
            ),
        };
        format!(
            "@group({group}) @binding({binding}) var {TEXTURE}: {ty};
fn {HIDDEN}(position: vec4<f32>, {parameter}: f32) -> bool {{
    {clamped}let pixel = vec2<i32>(position.xy);
    let nearest = {nearest};
    {tolerance}
    let behind = {behind};
    {vote}return {answer};
}}
",
            tolerance = self.tolerance_wgsl(),
        )
    }

    /// The depth in a texel.
    fn texel(&self, load: &str) -> String {
        match self.texture {
            DepthTexture::Depth => load.to_owned(),
            DepthTexture::Float => format!("{load}.x"),
            DepthTexture::Packed => {
                let [r, g, b, a] = packed::UNPACK;
                format!("dot({load}, vec4<f32>({r:?}, {g:?}, {b:?}, {a:?}))")
            }
        }
    }

    /// The distance that proves a fragment hidden. It covers the format's rounding, the difference
    /// between two pipelines' positions (a few steps of the mantissa, and 1/64 pixel along the
    /// slope: four of the rasteriser's 1/256 subpixel steps), and with MSAA one pixel along the
    /// slope: no language fixes the point of the pixel to which `position.z` is interpolated. Most
    /// drivers take the centre, SwiftShader takes the first sample. Packing adds its last digit and
    /// the rounding of four bytes, four products and three sums.
    fn tolerance_wgsl(&self) -> String {
        if let Some(fixed) = self.tolerance {
            return format!("let tolerance = f32({fixed:?});");
        }
        let pixels = if self.samples > 1 {
            1.0 + 1.0 / 64.0
        } else {
            1.0 / 64.0
        };
        let (relative, mut absolute) = match self.texture {
            DepthTexture::Depth | DepthTexture::Float => (f32::EPSILON * 8.0, 0.0),
            DepthTexture::Packed => (f32::EPSILON * 16.0, 2.0 * packed::STEP),
        };
        if !self.format.is_float() {
            absolute += 2.0 * self.format.step();
        }
        let mut rounding = format!("max(abs(depth), abs(nearest)) * {relative:?}");
        if absolute > 0.0 {
            rounding.push_str(&format!(" + {absolute:?}"));
        }
        format!(
            "let slope = fwidthFine(depth);\n    let tolerance = {rounding} + slope * {pixels:?};"
        )
    }
}

impl Prologue {
    /// `module` with a call of the prologue at the start of the fragment entry point `entry`.
    /// `depth` computes the material's depth; without it the rasteriser's depth is used. The
    /// derivatives in `taken` ([`gradients::find`]) are evaluated before the prologue.
    ///
    /// # Errors
    /// Our own text does not parse or link.
    pub fn inject(
        &self,
        module: Module,
        entry: usize,
        depth: Option<&Ahead>,
        taken: &[Handle<Expression>],
    ) -> Result<Module, InjectError> {
        let (module, hidden) = link_snippet(module, &self.wgsl())?;
        let author = &module.entry_points[entry].function;
        Ok(place::prologue_replacing(&module, entry, |build| {
            let replacements = gradients::take(build, author, taken);
            let vec4 = build.ty(TypeInner::Vector {
                size: VectorSize::Quad,
                scalar: Scalar::F32,
            });
            let position = build.input(
                "position",
                vec4,
                &Binding::BuiltIn(BuiltIn::Position { invariant: false }),
            );
            let computed = depth.and_then(|d| d.call(build, "own_depth"));
            let depth = computed.unwrap_or_else(|| {
                build.expression(Expression::AccessIndex {
                    base: position,
                    index: 2,
                })
            });
            if let Some(is_hidden) = build.call(hidden, vec![position, depth]) {
                build.name(is_hidden, "hidden");
                build.if_then(is_hidden, |build| build.statement(Statement::Kill));
            }
            replacements
        }))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const PLAIN: Prologue = Prologue {
        texture: DepthTexture::Depth,
        samples: 1,
        format: DepthFormat::Depth32float,
        direction: DepthDirection::Forward,
        quad: Quad::Vote,
        mode: Mode::Cull,
        range: DepthRange::Clipped,
        tolerance: None,
        binding: ResourceBinding {
            group: 2,
            binding: 1,
        },
    };

    #[test]
    fn the_text_of_every_form() {
        let forms = [
            ("default", PLAIN),
            (
                "reversed-lane",
                Prologue {
                    direction: DepthDirection::Reversed,
                    quad: Quad::Lane,
                    ..PLAIN
                },
            ),
            (
                "depth16-float-invert",
                Prologue {
                    texture: DepthTexture::Float,
                    format: DepthFormat::Depth16unorm,
                    mode: Mode::Invert,
                    ..PLAIN
                },
            ),
            (
                "packed",
                Prologue {
                    texture: DepthTexture::Packed,
                    ..PLAIN
                },
            ),
            (
                "clamped",
                Prologue {
                    range: DepthRange::Clamped,
                    ..PLAIN
                },
            ),
            (
                "multisampled-fixed",
                Prologue {
                    samples: 4,
                    tolerance: Some(0.0001),
                    ..PLAIN
                },
            ),
        ];
        for (name, prologue) in forms {
            let text = prologue.wgsl();
            let module = naga::front::wgsl::parse_str(&text).unwrap();
            assert_eq!(module.functions.len(), 1, "{name}");
            insta::assert_snapshot!(name, text);
        }
    }

    #[test]
    fn names_of_the_authors_own_are_left_alone() {
        let author = naga::front::wgsl::parse_str(
            "@group(2) @binding(0) var prepass_depth: texture_2d<f32>;
             fn hidden_by_prepass() -> f32 { return textureLoad(prepass_depth, vec2(0), 0).x; }
             @fragment fn fs() -> @location(0) vec4<f32> { return vec4(hidden_by_prepass()); }",
        )
        .unwrap();
        let module = PLAIN.inject(author, 0, None, &[]).unwrap();
        let names = |names: Vec<&Option<String>>| -> Vec<String> {
            names.into_iter().flatten().cloned().collect()
        };
        let globals = names(
            module
                .global_variables
                .iter()
                .map(|(_, g)| &g.name)
                .collect(),
        );
        let functions = names(module.functions.iter().map(|(_, f)| &f.name).collect());
        assert_eq!(globals, ["prepass_depth", "prepass_depth_preshade"]);
        assert_eq!(
            functions,
            ["hidden_by_prepass", "hidden_by_prepass_preshade"]
        );
    }
}
