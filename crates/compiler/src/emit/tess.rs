//! Writes a hoisted program with tessellation stages: GLSL 4.00 for OpenGL and GLSL 4.50 for Vulkan
//! (GLSL 4.50, 4.4.1.1, 4.4.2.1 and 7.1).
//!
//! ```text
//! .vert   the author's vertex stage                      _vs2fs_locationN
//! .tesc   passes three corners on, sets the levels       _tc2te_locationN
//! .tese   interpolates, runs the hoisted code            _vs2fs_locationN
//! .frag   the remaining fragment stage
//! ```
//!
//! naga writes no tessellation stages. We have it write the evaluation stage as a vertex stage
//! ([`native::Native::evaluation`]), and then turn each input's declaration into a patch input and
//! a global variable. A new `main` sets the globals and calls naga's. Two kinds of names change:
//! naga's `main`, and names with the vertex stage's suffix, which would clash with those of the
//! real vertex stage.
//!
//! There are no cracks: corners keep their bits, and a point on a shared edge is the `precise` sum
//! of two products of coordinates that are equal on both sides (OpenGL 4.0, appendix A.4, rules 3
//! and 5).

use std::collections::BTreeMap;

use naga::{Sampling, Scalar, ScalarKind, ShaderStage, TypeInner};
use preshade_geometry::tessellate::native::{self, Blend, Native, Patch, PatchVarying};
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;

use super::{
    ClipSpace, EmitError, Emitted, EmittedStage, Options, TessellationStage, dedup, extension,
    glsl, written_key,
};
use preshade_plan::plan_file::{StageFile, Target};
use shader_text::files::File;

/// The article's recommended level, for hosts that set none.
const LEVEL: &str = "3.0";

/// Rejects tessellation targets for plans without tessellation.
pub(super) fn check(plan: &Plan, targets: &[Target]) -> Result<(), EmitError> {
    let tessellated = [Target::GlslTess, Target::GlslVulkanTess];
    for target in dedup(targets) {
        if tessellated.contains(&target)
            && let Err(refusal) = native::native(plan)
        {
            return Err(EmitError::Inexpressible {
                file: format!("{}.main.{}tese", plan.material, infix(target)),
                target,
                what: format!("a tessellation stage: {}", refusal.reason),
                remedy: refusal.remedy.clone(),
            });
        }
    }
    Ok(())
}

/// The part of file names before the target's extension.
fn infix(target: Target) -> &'static str {
    match target {
        Target::GlslVulkanTess => "vulkan.",
        _ => "tess.",
    }
}

/// The files of a program. The fallback to the original has no tessellation stages.
pub(super) fn write(
    plan: &Plan,
    program: &Program,
    stages: &[EmittedStage],
    target: Target,
    options: &Options,
) -> Result<Vec<Emitted>, EmitError> {
    // Vulkan's clip space is the author's with y flipped by the viewport, as for SPIR-V.
    let options = match target {
        Target::GlslVulkanTess => &Options {
            glsl_clip_space: ClipSpace::AsWritten,
        },
        _ => options,
    };
    let hoisted = native::native(plan).ok();
    // The author's vertex stage only has some of the resources.
    let all = program;
    let mut files = Vec::new();
    for stage in stages {
        let name = |extension: &str| format!("{}.{}{extension}", stage.stem, infix(target));
        let own = name(extension(stage.stage));
        match &hoisted {
            Some(hoisted) if stage.stage == ShaderStage::Vertex => {
                let corner = Options {
                    // Interpolate the author's positions; the last stage converts them.
                    glsl_clip_space: ClipSpace::AsWritten,
                };
                files.push(plain(&hoisted.corner, all, stage, &own, target, &corner)?);
                let key = |of: TessellationStage| of.key(&stage.entry);
                let control = name("tesc");
                let text = control_text(&hoisted.patch, target, &control)?;
                let stage_file = StageFile::new(&control, "main");
                let stage_file = vec![(key(TessellationStage::Control), stage_file)];
                files.push((file(control, text), stage_file));
                let evaluation = name("tese");
                let (text, stage_file) =
                    evaluation_text(hoisted, all, &stage.entry, target, options, &evaluation)?;
                let stage_file = vec![(key(TessellationStage::Evaluation), stage_file)];
                files.push((file(evaluation, text), stage_file));
            }
            _ => files.push(plain(program, all, stage, &own, target, options)?),
        }
    }
    Ok(files)
}

fn file(name: String, text: String) -> File {
    let bytes = text.into_bytes();
    File { name, bytes }
}

/// A vertex or fragment stage as naga writes it.
fn plain(
    program: &Program,
    numbered: &Program,
    stage: &EmittedStage,
    name: &str,
    target: Target,
    options: &Options,
) -> Result<Emitted, EmitError> {
    let (text, stage_file) = glsl::write(
        program,
        numbered,
        stage.stage,
        &stage.entry,
        name,
        target,
        options,
    )?;
    let stage_file = vec![(written_key(stage.stage, &stage.entry), stage_file)];
    Ok((file(name.to_owned(), text), stage_file))
}

/// GLSL's name for a varying's type.
fn type_name(ty: &TypeInner, target: Target, file: &str) -> Result<String, EmitError> {
    let of = |scalar: Scalar, size: u8| match (scalar.kind, size) {
        (ScalarKind::Float, 1) => Some("float".to_owned()),
        (ScalarKind::Sint, 1) => Some("int".to_owned()),
        (ScalarKind::Uint, 1) => Some("uint".to_owned()),
        (ScalarKind::Float, n) => Some(format!("vec{n}")),
        (ScalarKind::Sint, n) => Some(format!("ivec{n}")),
        (ScalarKind::Uint, n) => Some(format!("uvec{n}")),
        _ => None,
    };
    let name = match ty {
        TypeInner::Scalar(scalar) if scalar.width == 4 => of(*scalar, 1),
        TypeInner::Vector { size, scalar } if scalar.width == 4 => of(*scalar, *size as u8),
        _ => None,
    };
    name.ok_or_else(|| EmitError::Inexpressible {
        file: file.to_owned(),
        target,
        what: "a varying without 32-bit numbers".to_owned(),
        remedy: "declare it f32".to_owned(),
    })
}

/// GLSL 4.00 matches varyings by name and has no locations for them.
fn location(target: Target, location: u32) -> String {
    match target {
        Target::GlslVulkanTess => format!("layout(location = {location}) "),
        _ => String::new(),
    }
}

fn version(target: Target) -> &'static str {
    match target {
        Target::GlslVulkanTess => "#version 450 core\n",
        _ => "#version 400 core\n",
    }
}

/// A corner's varying, in the vertex and in the evaluation stage.
fn corner_name(varying: &PatchVarying) -> (String, String) {
    let at = varying.location;
    (
        format!("_vs2fs_location{at}"),
        format!("_tc2te_location{at}"),
    )
}

/// The qualifier that naga gives the vertex output. GLSL 4.00 drivers require the same on both
/// sides, although neither is interpolated.
fn qualifier(varying: &PatchVarying) -> String {
    let interpolation = match varying.blend {
        Blend::Interpolated => "smooth ",
        Blend::Flat => "flat ",
    };
    let sampling = match varying.sampling {
        Some(Sampling::Centroid) => "centroid ",
        Some(Sampling::Sample) => "sample ",
        _ => "",
    };
    format!("{interpolation}{sampling}")
}

/// The control stage: passes on three corners and sets one level for all edges.
fn control_text(patch: &Patch, target: Target, file: &str) -> Result<String, EmitError> {
    let mut text = version(target).to_owned();
    text += "layout(vertices = 3) out;\n\n";
    text += match target {
        Target::GlslVulkanTess => {
            "layout(constant_id = 0) const float tessellation_level = LEVEL;\n\n"
        }
        _ => "uniform float tessellation_level = LEVEL;\n\n",
    }
    .replace("LEVEL", LEVEL)
    .as_str();
    for varying in &patch.varyings {
        let ty = type_name(&varying.ty, target, file)?;
        let (from, to) = corner_name(varying);
        let (at, how) = (location(target, varying.location), qualifier(varying));
        text += &format!("{at}{how}in {ty} {from}[];\n{at}out {ty} {to}[];\n");
    }
    text += "
void main() {
    gl_out[gl_InvocationID].gl_Position = gl_in[gl_InvocationID].gl_Position;
";
    for varying in &patch.varyings {
        let (from, to) = corner_name(varying);
        text += &format!("    {to}[gl_InvocationID] = {from}[gl_InvocationID];\n");
    }
    text += "    if (gl_InvocationID == 0) {
        gl_TessLevelOuter[0] = tessellation_level;
        gl_TessLevelOuter[1] = tessellation_level;
        gl_TessLevelOuter[2] = tessellation_level;
        gl_TessLevelInner[0] = tessellation_level;
    }
}
";
    Ok(text)
}

/// Converts naga's vertex stage to the evaluation stage.
fn evaluation_text(
    hoisted: &Native,
    numbered: &Program,
    entry: &str,
    target: Target,
    options: &Options,
    file: &str,
) -> Result<(String, StageFile), EmitError> {
    let program = &hoisted.evaluation;
    let (text, mut stage_file) = glsl::write(
        program,
        numbered,
        ShaderStage::Vertex,
        entry,
        file,
        target,
        options,
    )?;
    let written_otherwise = |what: &str| EmitError::Writer {
        file: file.to_owned(),
        target,
        message: format!("{what} has an unexpected form in naga's text"),
    };
    // A name that naga did not use.
    let free = |base: &str| {
        let mut name = base.to_owned();
        while identifiers(&text).any(|word| word == name) {
            name.push('x');
        }
        name
    };
    let (evaluate, between) = (free("evaluate"), free("between"));

    let mut names = BTreeMap::from([("main".to_owned(), evaluate.clone())]);
    for block in &mut stage_file.blocks {
        let Some(stem) = block.block.strip_suffix("Vertex") else {
            return Err(written_otherwise("a block"));
        };
        let name = format!("{stem}TessEvaluation");
        let [group, binding] = block.binding;
        let variable = format!("_group_{group}_binding_{binding}");
        names.insert(format!("{variable}_vs"), format!("{variable}_te"));
        names.insert(std::mem::replace(&mut block.block, name.clone()), name);
    }
    for texture in &mut stage_file.textures {
        let Some(stem) = texture.name.strip_suffix("_vs") else {
            return Err(written_otherwise("a texture"));
        };
        let name = format!("{stem}_te");
        names.insert(std::mem::replace(&mut texture.name, name.clone()), name);
    }

    let rest = text
        .strip_prefix(version(target))
        .ok_or_else(|| written_otherwise("the version"))?;
    let mut lines: Vec<String> = rest.lines().map(|line| renamed(line, &names)).collect();
    // The new `main` sets each of naga's inputs from the corners.
    let mut main = "\nvoid main() {\n".to_owned();
    let position = PatchVarying {
        location: hoisted.patch.position,
        ty: TypeInner::Vector {
            size: naga::VectorSize::Quad,
            scalar: Scalar::F32,
        },
        blend: Blend::Interpolated,
        sampling: None,
    };
    let varyings = hoisted.patch.varyings.iter();
    let mut types = Vec::new();
    for varying in std::iter::once(&position).chain(varyings) {
        let (at, ty) = (varying.location, type_name(&varying.ty, target, file)?);
        let declared = format!("layout(location = {at}) in {ty} _p2vs_location{at};");
        let mut found = lines.iter_mut().filter(|line| **line == declared);
        let line = found.next().ok_or_else(|| written_otherwise("an input"))?;
        let is_position = at == hoisted.patch.position;
        let (_, corner) = corner_name(varying);
        let (corner, member) = match is_position {
            true => ("gl_in", ".gl_Position"),
            false => (corner.as_str(), ""),
        };
        *line = format!("{ty} _p2vs_location{at};");
        if !is_position {
            *line = format!("{}in {ty} {corner}[];\n{line}", location(target, at));
        }
        let [a, b, c] = [0, 1, 2].map(|i| format!("{corner}[{i}]{member}"));
        main += &match varying.blend {
            Blend::Interpolated => {
                if !types.contains(&ty) {
                    types.push(ty.clone());
                }
                format!("    _p2vs_location{at} = {between}({a}, {b}, {c});\n")
            }
            Blend::Flat => format!("    _p2vs_location{at} = {a};\n"),
        };
    }
    main += &format!("    {evaluate}();\n}}\n");

    let mut out = version(target).to_owned();
    out += &format!(
        "layout(triangles, equal_spacing, {}) in;\n",
        winding(target)
    );
    out += lines.join("\n").trim_end();
    out.push('\n');
    for ty in types {
        out += &format!(
            "
{ty} {between}({ty} a, {ty} b, {ty} c) {{
    precise {ty} sum = gl_TessCoord.x * a + gl_TessCoord.y * b + gl_TessCoord.z * c;
    return sum;
}}
"
        );
    }
    Ok((out + &main, stage_file))
}

/// The winding that keeps the patch's orientation. OpenGL's domain has its origin at the lower
/// left, Vulkan's at the upper left.
fn winding(target: Target) -> &'static str {
    match target {
        Target::GlslVulkanTess => "cw",
        _ => "ccw",
    }
}

fn in_identifier(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// The words and numbers of a text without comments or strings.
fn identifiers(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c| !in_identifier(c)).filter(|w| !w.is_empty())
}

fn renamed(text: &str, names: &BTreeMap<String, String>) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find(in_identifier) {
        let (before, word) = rest.split_at(start);
        let end = word.find(|c| !in_identifier(c)).unwrap_or(word.len());
        let (word, after) = word.split_at(end);
        out += before;
        out += names.get(word).map_or(word, String::as_str);
        rest = after;
    }
    out + rest
}
