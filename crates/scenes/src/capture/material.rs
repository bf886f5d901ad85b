//! Makes a material of a captured pipeline: program and state.

use std::collections::BTreeMap;

use naga_edit::declared::ROW_NOTES;
use naga_interp::overrides;
use preshade_plan::state::{
    Blend, BlendComponent, ColorTarget, DepthBias, FrontFace, MaterialState, Multisample,
    PrimitiveState, StencilFace, StencilState,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::reader::{Left, Reader};
use super::{draw_id, points};
use preshade_compiler::front::{self, Source};
use preshade_draw::scene::{Material, Rows};
use preshade_frames::file::{self, Cull, RenderPipeline, ShaderLanguage};
use preshade_frames::folder::{Capture, get};
use shader_text::options;

/// Converts between two enums that share WebGPU's names.
pub(super) fn same<T: DeserializeOwned>(of: impl Serialize) -> Result<T, String> {
    let text = serde_json::to_value(of).map_err(|e| e.to_string())?;
    let shown = text.to_string();
    serde_json::from_value(text).map_err(|_| format!("preshade has no {shown}"))
}

pub(super) fn read(
    capture: &Capture,
    of: &RenderPipeline,
    name: &str,
    reader: Reader,
) -> Result<Material, Left> {
    let rows = reader.rows(capture);
    let vertex = &of.vertex.stage;
    let fragment = of.fragment.as_ref().map(|f| &f.stage);
    let mut constants = vertex.constants.clone();
    for (name, value) in fragment.iter().flat_map(|f| &f.constants) {
        if constants
            .insert(name.clone(), *value)
            .is_some_and(|other| other != *value)
        {
            let why = format!("its pipeline sets the constant `{name}` to two values");
            return Err(Left::Out(why));
        }
    }
    let mut modules = vec![vertex.module];
    modules.extend(fragment.map(|f| f.module).filter(|m| *m != vertex.module));
    let is_points = of.primitive.topology == file::Topology::PointList;
    let mut is_sized = false;
    let mut sources = Vec::new();
    for module in modules {
        let shader = get(&capture.file.shaders, module, "shader", name)?;
        let ending = match shader.language {
            ShaderLanguage::Wgsl => "wgsl",
            ShaderLanguage::SpirV => "spv",
            ShaderLanguage::GlslEs100 | ShaderLanguage::GlslEs300 if sources.is_empty() => "vert",
            ShaderLanguage::GlslEs100 | ShaderLanguage::GlslEs300 => "frag",
        };
        let mut bytes = capture.data(&shader.data)?.to_vec();
        if ending == "vert" || ending == "frag" {
            let mut text = String::from_utf8_lossy(&bytes).into_owned();
            // The text itself may test for ES.
            if shader.language == ShaderLanguage::GlslEs100 && !text.contains("#version") {
                text.insert_str(0, "#version 100\n");
            }
            if ending == "vert" {
                is_sized = is_points && points::are_sized(&text);
            }
            if capture.has_whole_depth_range() {
                for (name, value) in [("near", "0.0"), ("far", "1.0"), ("diff", "1.0")] {
                    text = text.replace(&format!("gl_DepthRange.{name}"), value);
                }
            }
            text = match (is_sized, ending) {
                (true, "vert") => points::vertex(&text, reader),
                (true, _) => points::fragment(&text, reader),
                (false, _) => text,
            };
            if ending == "vert" && text.contains(draw_id::NAME) {
                text = draw_id::as_uniform(&text);
            }
            if rows == Rows::FromBottom && ending == "vert" {
                let negated = "gl_Position.y = -gl_Position.y;";
                text = points::after_main(&text, "preshade_upright_main", negated);
            }
            bytes = text.into_bytes();
        }
        let source = Source::from_bytes(format!("{name}.{ending}"), bytes);
        sources.push(source.map_err(|e| Left::Out(e.to_string()))?);
    }
    // If both modules have an entry point `main`, linking renames the second.
    let wanted = fragment.and_then(|f| f.entry_point.clone());
    let options = options::Options {
        vertex: vertex.entry_point.clone(),
        fragment: wanted.filter(|f| sources.len() == 1 || vertex.entry_point.as_ref() != Some(f)),
        clip_space: of.clip_space,
        limits: *capture.limits(),
        ..shader_text::options::Options::default()
    };
    let parsed = front::parse(&sources, &options).map_err(|e| Left::Out(e.to_string()))?;
    let mut state = state(of).map_err(Left::Out)?;
    let mut program = parsed.program;
    if !constants.is_empty() {
        let module = overrides::with_defaults(program.module(), &constants);
        let set = program.with_module(module);
        program = set.map_err(|e| Left::Out(format!("with its pipeline's constants: {e}")))?;
    }
    if rows == Rows::FromBottom {
        state.primitive.front_face = match state.primitive.front_face {
            FrontFace::Ccw => FrontFace::Cw,
            FrontFace::Cw => FrontFace::Ccw,
        };
        let mut declared = program.declared().clone();
        declared
            .notes
            .retain(|note| !ROW_NOTES.contains(&note.as_str()));
        program = program.with_declared(declared);
    }
    if is_sized {
        if reader == Reader::Scene {
            program = points::with_flat_varyings(&program).map_err(Left::Out)?;
        }
        state.primitive.topology = preshade_plan::state::Topology::TriangleList;
        state.primitive.cull = preshade_plan::state::CullMode::None;
    }
    Ok(Material {
        name: name.to_owned(),
        file: None,
        vertex: parsed.vertex,
        fragment: fragment.and(parsed.fragment),
        program,
        defines: BTreeMap::new(),
        state,
        values: BTreeMap::new(),
        textures: BTreeMap::new(),
        samplers: BTreeMap::new(),
        attributes: BTreeMap::new(),
        attribute_roles: BTreeMap::new(),
        value_roles: BTreeMap::new(),
        part_of: None,
    })
}

fn state(of: &RenderPipeline) -> Result<MaterialState, String> {
    let p = &of.primitive;
    let mut state = MaterialState {
        primitive: PrimitiveState {
            // Fans and loops are drawn with generated indices.
            topology: same(topology(p.topology))?,
            cull: match p.cull_mode {
                Cull::None => preshade_plan::state::CullMode::None,
                Cull::Front => preshade_plan::state::CullMode::Front,
                Cull::Back => preshade_plan::state::CullMode::Back,
            },
            front_face: same(p.front_face)?,
            unclipped_depth: p.unclipped_depth,
        },
        multisample: Multisample {
            count: of.multisample.count,
            mask: of.multisample.mask,
            alpha_to_coverage: of.multisample.alpha_to_coverage_enabled,
        },
        ..MaterialState::default()
    };
    if let Some(depth) = &of.depth_stencil {
        let compare = depth.depth_compare.unwrap_or(wgpu::CompareFunction::Always);
        state.depth_compare = Some(same(compare)?);
        state.depth_write = depth.depth_write_enabled.unwrap_or(false);
        state.depth_format = same(depth.format)?;
        state.depth_bias = DepthBias {
            constant: depth.depth_bias,
            slope_scale: depth.depth_bias_slope_scale,
            clamp: depth.depth_bias_clamp,
        };
        state.stencil = stencil(depth)?;
    } else {
        state.depth_compare = Some(preshade_plan::state::CompareFunction::Always);
        state.depth_write = false;
    }
    for target in of.fragment.iter().flat_map(|f| &f.targets) {
        state
            .targets
            .push(target.as_ref().map(color_target).transpose()?);
    }
    Ok(state)
}

pub(super) fn has_stencil(of: &file::DepthStencil) -> bool {
    let plain = file::StencilFace::default();
    of.stencil_front != plain || of.stencil_back != plain
}

fn stencil(of: &file::DepthStencil) -> Result<Option<StencilState>, String> {
    if !has_stencil(of) {
        return Ok(None);
    }
    let face = |f: file::StencilFace| -> Result<StencilFace, String> {
        Ok(StencilFace {
            compare: same(f.compare)?,
            fail: same(f.fail_op)?,
            depth_fail: same(f.depth_fail_op)?,
            pass: same(f.pass_op)?,
        })
    };
    Ok(Some(StencilState {
        front: face(of.stencil_front)?,
        back: face(of.stencil_back)?,
        read_mask: of.stencil_read_mask,
        write_mask: of.stencil_write_mask,
        reference: 0,
    }))
}

fn color_target(of: &file::ColorTarget) -> Result<ColorTarget, String> {
    let component = |c: file::BlendComponent| -> Result<BlendComponent, String> {
        Ok(BlendComponent {
            src: same(c.src_factor)?,
            dst: same(c.dst_factor)?,
            operation: same(c.operation)?,
        })
    };
    let blend = of.blend.as_ref().map(|b| {
        Ok::<_, String>(Blend {
            color: component(b.color)?,
            alpha: component(b.alpha)?,
        })
    });
    let mut target = ColorTarget::opaque(same::<String>(of.format)?);
    target.blend = blend.transpose()?;
    target.write_mask = (of.write_mask & 0xf) as u8;
    Ok(target)
}

/// The topology of WebGL's fans and loops with generated indices.
pub(super) fn topology(of: file::Topology) -> wgpu::PrimitiveTopology {
    match of {
        file::Topology::PointList => wgpu::PrimitiveTopology::PointList,
        file::Topology::LineList => wgpu::PrimitiveTopology::LineList,
        file::Topology::LineStrip | file::Topology::LineLoop => wgpu::PrimitiveTopology::LineStrip,
        file::Topology::TriangleList | file::Topology::TriangleFan => {
            wgpu::PrimitiveTopology::TriangleList
        }
        file::Topology::TriangleStrip => wgpu::PrimitiveTopology::TriangleStrip,
    }
}
