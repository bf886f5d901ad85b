//! The prologue's text, and its place at the start of a fragment entry point.

use naga::{
    Binding, BuiltIn, Expression, Handle, Module, Scalar, Statement, TypeInner, VectorSize,
};

use super::{DepthTexture, Mode, Quad, Slot};
use crate::depth_only::{Argument, DepthFunction};
use crate::place::{self, Builder};
use crate::state::{DepthDirection, DepthFormat};

/// Name of the depth texture in the emitted module.
pub const TEXTURE: &str = "prepass_depth";

/// An offset past every file of a source map: our own text has no place in the author's.
const NOWHERE: u32 = u32::MAX / 2;

/// What the prologue must know.
#[derive(Clone, Copy, Debug)]
pub struct Prologue {
    /// Type of the texture.
    pub texture: DepthTexture,
    /// Samples a pixel of it.
    pub samples: u32,
    /// Its format.
    pub format: DepthFormat,
    /// Which way depth grows.
    pub direction: DepthDirection,
    /// Which lanes leave.
    pub quad: Quad,
    /// Drop hidden fragments, or visible ones.
    pub mode: Mode,
    /// A fixed tolerance.
    pub tolerance: Option<f32>,
    /// Where the texture is bound.
    pub slot: Slot,
}

impl Prologue {
    /// The prologue as WGSL: a texture and a function `hidden_by_prepass(position, depth) -> bool`.
    pub fn wgsl(&self) -> String {
        let Slot { group, binding } = self.slot;
        let multisampled = self.samples > 1;
        let ty = match (self.texture, multisampled) {
            (DepthTexture::Depth, false) => "texture_depth_2d",
            (DepthTexture::Depth, true) => "texture_depth_multisampled_2d",
            (DepthTexture::Float, false) => "texture_2d<f32>",
            (DepthTexture::Float, true) => "texture_multisampled_2d<f32>",
        };
        let texel = match self.texture {
            DepthTexture::Depth => "",
            DepthTexture::Float => ".x",
        };
        // Behind every sample: compare with the farthest of them.
        let farther = match self.direction {
            DepthDirection::Forward => "max",
            DepthDirection::Reversed => "min",
        };
        let nearest = (0..self.samples.max(1))
            .map(|s| format!("textureLoad({TEXTURE}, pixel, {s}){texel}"))
            .reduce(|a, b| format!("{farther}({a}, {b})"))
            .unwrap_or_default();
        let behind = match self.direction {
            DepthDirection::Forward => "depth > nearest + tolerance",
            DepthDirection::Reversed => "depth < nearest - tolerance",
        };
        let answer = match (self.mode, self.quad) {
            (Mode::Invert, _) => "return !behind;".to_owned(),
            (Mode::Cull, Quad::Lane) => "return behind;".to_owned(),
            // A fine derivative is the difference of two neighbouring lanes, so a lane's partner is it plus or minus that.
            (Mode::Cull, Quad::Vote) => "let lane = select(0.0, 1.0, behind);
    let row = 2.0 * lane + select(1.0, -1.0, (pixel.x & 1) == 1) * dpdxFine(lane);
    let votes = 2.0 * row + select(1.0, -1.0, (pixel.y & 1) == 1) * dpdyFine(row);
    return votes > 3.5;"
                .to_owned(),
        };
        format!(
            "@group({group}) @binding({binding}) var {TEXTURE}: {ty};
fn hidden_by_prepass(position: vec4<f32>, depth: f32) -> bool {{
    let pixel = vec2<i32>(position.xy);
    let nearest = {nearest};
    {tolerance}
    let behind = {behind};
    {answer}
}}
",
            tolerance = self.tolerance_wgsl(),
        )
    }

    /// How far behind is surely behind: what the format rounds away, what two pipelines may make of one position (a few steps of the mantissa, and 1/64 of a
    /// pixel along the slope: four of the rasteriser's 1/256 subpixel steps), and under MSAA the half pixel between centre and sample.
    fn tolerance_wgsl(&self) -> String {
        if let Some(fixed) = self.tolerance {
            return format!("let tolerance = f32({fixed:?});");
        }
        let pixels = if self.samples > 1 {
            0.5 + 1.0 / 64.0
        } else {
            1.0 / 64.0
        };
        let mut rounding = "max(abs(depth), abs(nearest)) * 9.5367431640625e-7".to_owned();
        if !matches!(
            self.format,
            DepthFormat::Depth32float | DepthFormat::Depth32floatStencil8
        ) {
            rounding.push_str(&format!(" + {:?}", 2.0 * self.format.step()));
        }
        format!(
            "let slope = abs(dpdxFine(depth)) + abs(dpdyFine(depth));\n    let tolerance = {rounding} + slope * {pixels:?};"
        )
    }
}

impl Prologue {
    /// `module` with the prologue called first thing in the fragment entry point `entry`. `depth` computes the depth that the material writes;
    /// without one it is the rasteriser's.
    ///
    /// # Errors
    /// When our own text does not parse or link.
    pub fn inject(
        &self,
        module: Module,
        entry: usize,
        depth: Option<&DepthFunction>,
    ) -> Result<Module, InjectError> {
        let snippet = naga::front::wgsl::parse_str(&self.wgsl())
            .map_err(|e| InjectError(e.message().to_owned()))?;
        let linked = crate::link::link(module, &snippet, NOWHERE, "preshade")
            .map_err(|e| InjectError(e.to_string()))?;
        let [hidden] = linked.functions[..] else {
            return Err(InjectError("the prologue is not one function".to_owned()));
        };
        Ok(place::prologue(&linked.module, entry, |build| {
            let vec4 = build.ty(TypeInner::Vector {
                size: VectorSize::Quad,
                scalar: Scalar::F32,
            });
            let position = build.input(
                "position",
                vec4,
                &Binding::BuiltIn(BuiltIn::Position { invariant: false }),
            );
            let depth = match depth {
                Some(d) => {
                    let arguments = d.arguments.iter().map(|a| argument(build, a)).collect();
                    build.call(d.function, arguments)
                }
                None => Some(build.expression(Expression::AccessIndex {
                    base: position,
                    index: 2,
                })),
            };
            let is_hidden = depth.and_then(|depth| build.call(hidden, vec![position, depth]));
            if let Some(is_hidden) = is_hidden {
                build.if_then(is_hidden, |build| build.statement(Statement::Kill));
            }
        }))
    }
}

fn argument(build: &mut Builder<'_>, argument: &Argument) -> Handle<Expression> {
    match argument {
        Argument::Input(ty, binding) => build.input("input", *ty, binding),
        Argument::Struct(ty, members) => {
            let components = members
                .iter()
                .map(|(ty, binding)| build.input("input", *ty, binding))
                .collect();
            build.expression(Expression::Compose {
                ty: *ty,
                components,
            })
        }
    }
}

/// A snippet of ours that does not parse: a bug.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct InjectError(String);
