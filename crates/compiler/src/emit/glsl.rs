//! Writes an entry point as GLSL 4.50, 4.00, GLSL ES 3.00 or 1.00, with the data that a host needs
//! for its bindings.

mod author;
mod depth;
mod depth_loads;
mod es100;
mod layout;
pub(super) mod lengths;
mod loose_uniforms;
mod meaning;
mod narrow;
mod read_back;
mod reserved_words;
mod separate_textures;
mod text;
mod texture_copies;
pub(super) mod unsupported;
mod vulkan;

use std::collections::HashSet;

use naga::back::glsl::{
    self, BindingMap, Options as WriterOptions, PipelineOptions, Version, Writer, WriterFlags,
};
use naga::proc::BoundsCheckPolicies;
use naga::{
    AddressSpace, GlobalVariable, Handle, ImageClass, Module, ResourceBinding, ShaderStage,
    TypeInner,
};
use naga_edit::declared::Depth;
use preshade_passes::rebuild::quad;
use preshade_plan::budget::Budget;
use preshade_plan::contract::{Assumption, Contract};
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;
use shader_text::source::Invalid;

use self::author::Authored;
use self::text::Dialect;
pub(super) use self::vulkan::Vulkan;
use super::combined::BindingPlace;
use super::overrides::{self, Settled, Specialised};
use super::{ClipSpace, EmitError, Options, reduce};
use crate::wgsl;
use preshade_plan::plan_file::{GlslBlock, GlslTexture, StageFile, Target, WeakerPromise};
use shader_text::tokens::Spelling;

/// Prepares the program to be written with its author's names.
pub(super) fn author(program: &Program, name: &str, target: Target) -> Result<Authored, EmitError> {
    // naga writes two brackets per level, and our front end limits nesting.
    let named = wgsl::deep_expressions::name_deep_expressions(program)
        .and_then(|m| program.with_module(m).ok());
    let program = named.as_ref().unwrap_or(program);
    let floats = depth_loads::as_floats(program);
    let program = floats.as_ref().unwrap_or(program);
    author::prepare(program).map_err(|failed| match failed {
        author::Failed::Layout(what) => EmitError::Inexpressible {
            file: name.to_owned(),
            target,
            what: format!("{what}, which neither std140 nor std430 allows"),
            remedy: "emit WGSL or SPIR-V, or declare it as vec4s".to_owned(),
        },
        author::Failed::Samplers => {
            unsupported::inexpressible(&glsl::Error::ImageMultipleSamplers, name, target)
        }
        author::Failed::Names(what) => EmitError::Writer {
            file: name.to_owned(),
            target,
            message: format!("{what} cannot be written as the author declared it"),
        },
    })
}

/// naga's conversion of a position from WebGPU's clip space, and its replacement for a host with
/// OpenGL's matrices, which restores the author's depth.
const CONVERTED_POSITION: &str =
    "gl_Position.yz = vec2(-gl_Position.y, gl_Position.z * 2.0 - gl_Position.w);";
const OWN_DEPTH: &str = "gl_Position.z = gl_Position.z * 2.0 - gl_Position.w;";

/// Restores the author's depth at each conversion; `None` if there is none or naga's text differs.
fn with_author_depth(text: &str) -> Option<String> {
    let turned = text.matches(CONVERTED_POSITION).count();
    // There must be one conversion per end of the entry point and no other assignment, or the image
    // would be upside down.
    let written = text.matches("gl_Position.yz").count();
    (turned > 0 && turned == written).then(|| text.replace(CONVERTED_POSITION, OWN_DEPTH))
}

/// As [`write`], with the author's names for everything that a host sees.
pub(super) fn write_named(
    authored: &Authored,
    stage: ShaderStage,
    entry: &str,
    name: &str,
    target: Target,
    options: &Options,
) -> Result<(String, StageFile), EmitError> {
    let declared = authored.program.declared();
    let keeps_author_depth =
        declared.depth == Depth::OpenGl && options.glsl_clip_space == ClipSpace::AsWritten;
    let authors_own =
        keeps_author_depth.then(|| depth::as_authored(&authored.program, stage, entry));
    let authors_own = authors_own.flatten();
    let clip_space = options.glsl_clip_space;
    let program = authors_own.as_ref().unwrap_or(&authored.program);
    // Invert the depth conversion if it cannot be removed. This costs the last bits of precision.
    let turned = keeps_author_depth && authors_own.is_none();
    let options = match turned {
        true => Options {
            glsl_clip_space: ClipSpace::OpenGl,
        },
        false => *options,
    };
    let (mut text, mut stage_file) = write(program, program, stage, entry, name, target, &options)?;
    for texture in &mut stage_file.textures {
        let [group, binding] = texture.texture;
        if let Some(author) = authored.twins.get(&ResourceBinding { group, binding }) {
            texture.texture = [author.group, author.binding];
        }
    }
    if turned && stage == ShaderStage::Vertex {
        text = with_author_depth(&text).ok_or_else(|| EmitError::Writer {
            file: name.to_owned(),
            target,
            message: "the position has an unexpected form in naga's text".to_owned(),
        })?;
    }
    let dialect = match target {
        Target::GlslEs300 | Target::GlslEs100 => Dialect::Es,
        _ => Dialect::Desktop,
    };
    let unexpected = |text::Unexpected(what)| EmitError::Writer {
        file: name.to_owned(),
        target,
        message: format!("{what} has an unexpected form in naga's text"),
    };
    let (text, stage_file) =
        text::named(authored, &text, stage, dialect, stage_file).map_err(unexpected)?;
    let counts_from_the_top = declared.origin_upper_left && stage == ShaderStage::Fragment;
    let text = match counts_from_the_top {
        true => with_own_origin(text, clip_space, name, target)?,
        false => text,
    };
    let (text, mut stage_file) = match target {
        Target::GlslEs100 => {
            es100::rewritten(&text, stage, stage_file).map_err(|es100::Lacks(what)| {
                EmitError::Inexpressible {
                    file: name.to_owned(),
                    target,
                    what,
                    remedy: "emit GLSL ES 3.00 (glsl-es), or another target".to_owned(),
                }
            })?
        }
        _ => (text, stage_file),
    };
    if matches!(stage, ShaderStage::Vertex | ShaderStage::Fragment) {
        let read = read_back::read_back(authored, &text, &stage_file, stage, entry);
        stage_file.unread = read.unread(name, target)?;
    }
    Ok((text, stage_file))
}

/// As [`write_named`], for Vulkan. The text is one for OpenGL first, which is read back.
pub(super) fn write_vulkan(
    authored: &Authored,
    vulkan: &Vulkan,
    stage: ShaderStage,
    entry: &str,
    name: &str,
) -> Result<(String, StageFile), EmitError> {
    let target = Target::GlslVulkan;
    let all = &authored.program;
    let specialised = Specialised::of(all, (stage, entry), &vulkan.ids, name, target)?;
    let program = specialised.program();
    let options = Options::default();
    let (text, stage_file) = write(program, all, stage, entry, name, target, &options)?;
    let written = lengths::written(program, &text);
    let unexpected = |text::Unexpected(what)| EmitError::Writer {
        file: name.to_owned(),
        target,
        message: format!("{what} has an unexpected form in naga's text"),
    };
    let (text, stage_file) =
        text::named(authored, &text, stage, Dialect::Desktop, stage_file).map_err(unexpected)?;
    let mut unread = None;
    if stage != ShaderStage::Compute {
        let text = lengths::with_defaults(&text, &written);
        let read = read_back::read_back(authored, &text, &stage_file, stage, entry);
        unread = read.unread(name, target)?;
    }
    let of = specialised.stage_file(name, entry);
    let mut stage_file = StageFile {
        constants: of.constants,
        notes: of.notes,
        unread,
        ..stage_file
    };
    stage_file.notes.extend(vulkan.pairs.notes.iter().cloned());
    // A texture's copy is the author's texture again.
    let place = |b: ResourceBinding| -> BindingPlace {
        let own = authored.twins.get(&b).unwrap_or(&b);
        (own.group, own.binding)
    };
    let numbers = descriptor_map(all.module()).into_iter();
    let immediate = all.entry_point(stage, entry).and_then(|(index, _)| {
        let used = all.info().get_entry_point(index);
        let mut globals = all.module().global_variables.iter();
        let is_it = |g: &GlobalVariable| g.space == AddressSpace::Immediate;
        let (_, global) = globals.find(|(h, g)| is_it(g) && !used[*h].is_empty())?;
        Some((authored.immediate(stage)?, global.ty))
    });
    let mut variables = specialised.variables.clone();
    let text = lengths::with_variables(text, &written, &mut variables, &mut stage_file);
    let resources = vulkan::Resources {
        module: all.module(),
        pairs: &vulkan.pairs,
        immediate,
        variables: &variables,
        numbers: &numbers.map(|(b, n)| (u32::from(n), place(b))).collect(),
        demotes: vulkan.program.declared().demotes,
    };
    let text = vulkan::rewritten(&text, stage, &mut stage_file, &resources);
    let text = text.map_err(|text::Unexpected(what)| EmitError::Inexpressible {
        file: name.to_owned(),
        target,
        what,
        remedy: "emit SPIR-V".to_owned(),
    })?;
    let text = narrow::narrowed(text, &vulkan.program, stage, entry);
    Ok((text, stage_file))
}

/// Redeclares `gl_FragCoord` with its origin at the top, if it is used. A target drawn upside down
/// for WebGPU's clip space has its first row at the bottom, OpenGL's origin.
fn with_own_origin(
    text: String,
    clip_space: ClipSpace,
    name: &str,
    target: Target,
) -> Result<String, EmitError> {
    let is_read =
        shader_text::tokens::tokens(&text).any(|(_, range)| &text[range] == "gl_FragCoord");
    if clip_space == ClipSpace::OpenGl || !is_read {
        return Ok(text);
    }
    if matches!(target, Target::GlslEs300 | Target::GlslEs100) {
        return Err(EmitError::Inexpressible {
            file: name.to_owned(),
            target,
            what: "`layout(origin_upper_left)`".to_owned(),
            remedy: "emit GLSL 4.50, WGSL or SPIR-V".to_owned(),
        });
    }
    let head: usize = text
        .split_inclusive('\n')
        .take_while(|line| line.starts_with('#') || line.trim().is_empty())
        .map(str::len)
        .sum();
    let (head, rest) = text.split_at(head);
    Ok(format!(
        "{head}layout(origin_upper_left) in vec4 gl_FragCoord;\n\n{rest}"
    ))
}

/// Writes the text and its `plan.json` entry. `name` is the file's. Bindings are numbered as in
/// `numbered`, which has all stages of the program.
pub(super) fn write(
    program: &Program,
    numbered: &Program,
    stage: ShaderStage,
    entry: &str,
    name: &str,
    target: Target,
    options: &Options,
) -> Result<(String, StageFile), EmitError> {
    // naga writes the functions of every stage into each.
    let invalid = |invalid: Box<Invalid>| EmitError::Writer {
        file: name.to_owned(),
        target,
        message: invalid.to_string(),
    };
    let program = &reduce::to_stage(program, stage, entry).map_err(invalid)?;
    let kept = meaning::kept(program, target).map_err(invalid)?;
    let program = kept.as_ref().unwrap_or(program);
    let settled = overrides::settle(program, stage, entry, name, target)?;
    let (module, info) = match &settled {
        Some(Settled { module, info }) => (module, info),
        None => (program.module(), program.info()),
    };
    unsupported::refuse_module(module, info, name, target)?;
    let untested = unsupported::without_conservative_test(module, target);
    let module = untested.as_ref().unwrap_or(module);
    let with_lengths = match target {
        Target::GlslVulkan => lengths::numbered(program, module),
        _ => None,
    };
    let module = with_lengths.as_ref().unwrap_or(module);
    let (version, binding_map) = match target {
        Target::GlslEs300 | Target::GlslEs100 => (Version::new_gles(300), BindingMap::default()),
        Target::GlslTess => (Version::Desktop(400), BindingMap::default()),
        Target::GlslVulkan | Target::GlslVulkanTess => {
            (Version::Desktop(450), descriptor_map(numbered.module()))
        }
        _ => (Version::Desktop(450), binding_map(numbered)),
    };
    // Without GL_EXT_texture_shadow_lod, which few drivers have: naga writes gradients of 0 instead.
    let mut writer_flags = WriterFlags::empty();
    if options.glsl_clip_space == ClipSpace::OpenGl {
        writer_flags |= WriterFlags::ADJUST_COORDINATE_SPACE;
    }
    let writer_options = WriterOptions {
        version,
        writer_flags,
        binding_map: binding_map.clone(),
        zero_initialize_workgroup_memory: false,
    };
    let pipeline = PipelineOptions {
        shader_stage: stage,
        entry_point: entry.to_owned(),
        multiview: None,
    };
    let failed = |e: glsl::Error| unsupported::inexpressible(&e, name, target);
    let mut text = String::new();
    let reflection = Writer::new(
        &mut text,
        module,
        info,
        &writer_options,
        &pipeline,
        BoundsCheckPolicies::default(),
    )
    .and_then(|mut writer| writer.write())
    .map_err(failed)?;
    unsupported::refuse_words(&text, name, target)?;
    text = shader_text::tokens::exact_floats(&text, Spelling::Glsl);

    // A struct shared by both stages makes the fragment input invariant too. WGSL allows that, GLSL
    // does not.
    if stage == ShaderStage::Fragment {
        text = text.replace("invariant gl_FragCoord;\n", "");
    }

    let at = |handle: Handle<GlobalVariable>| module.global_variables[handle].binding;
    let slot = |binding: ResourceBinding| binding_map.get(&binding).map(|slot| u32::from(*slot));
    let pair = |b: ResourceBinding| [b.group, b.binding];
    // Each GLSL stage is called `main`.
    let mut stage_file = StageFile {
        overrides: settled
            .as_ref()
            .map(|s| s.values(program))
            .unwrap_or_default(),
        ..StageFile::new(name, "main")
    };
    if untested.is_some() {
        let note = "the bound of the written depth (`layout(depth_greater)` or its like) is left out, \
                    which this GLSL lacks: the picture is the same, and hidden fragments may run";
        stage_file.notes.push(format!("{name}: {note}"));
    }
    for (uniform, mapping) in &reflection.texture_mapping {
        if let Some(texture) = at(mapping.texture) {
            stage_file.textures.push(GlslTexture {
                name: uniform.clone(),
                texture: pair(texture),
                sampler: mapping.sampler.and_then(at).map(pair),
                unit: slot(texture),
                size: None,
            });
        }
    }
    for (handle, block) in &reflection.uniforms {
        if let Some(binding) = at(*handle) {
            stage_file.blocks.push(GlslBlock {
                block: block.clone(),
                binding: pair(binding),
                slot: slot(binding),
            });
        }
    }
    stage_file.textures.sort_by(|a, b| a.name.cmp(&b.name));
    stage_file.blocks.sort_by_key(|b| b.binding);
    Ok((text, stage_file))
}

/// The extensions that a text requires.
pub(super) fn extensions(text: &str) -> Vec<String> {
    let heads = text.lines().filter_map(|l| l.strip_prefix("#extension "));
    let names = heads.filter_map(|head| Some(head.split_once(':')?.0.trim().to_owned()));
    names.collect()
}

/// GLSL ES 3.00 has a single kind of derivative, possibly coarse, and naga writes it for fine ones
/// too. The quad vote of `early-discard` needs fine derivatives: with coarse ones, three lanes may
/// exit although the fourth continues, and its derivatives are then undefined.
pub(super) fn without_fine_derivatives(plan: &Plan) -> Option<WeakerPromise> {
    quad::vote_shields_derivatives(plan).then(|| WeakerPromise {
        // An affected lane can have any colour.
        contract: Contract::Approximate {
            budget: Budget::max_abs(1.0),
            given: vec![Assumption::NotMeasured],
        },
        why:
            "GLSL ES 3.00 has no fine derivatives, so a quad's vote may miss a lane and spoil its \
             level of detail: there is no promise. Leave the pass out for this target, use \
             early-discard:quad=lane with a budget, or measure"
                .to_owned(),
    })
}

/// Assigns `layout(binding = ..)`. OpenGL numbers uniform blocks, storage blocks, textures and
/// images separately, each from 0. The first resource with an author's number keeps it. Others get
/// free numbers in the order of group and binding. All stages of a program share them.
fn binding_map(program: &Program) -> BindingMap {
    let module = program.module();
    let stage_file = &program.declared().numbers;
    let declared = program.declared();
    let is_used = |handle: Handle<GlobalVariable>| {
        let mut entries = 0..module.entry_points.len();
        entries.any(|i| !program.info().get_entry_point(i)[handle].is_empty())
    };
    let mut bound: Vec<(ResourceBinding, u8)> = module
        .global_variables
        .iter()
        // Loose uniforms are not in a block.
        .filter(|(handle, g)| !declared.is_loose(g.binding) || is_used(*handle))
        .filter_map(|(_, g)| {
            let kind = match (g.space, &module.types[g.ty].inner) {
                (naga::AddressSpace::Uniform, _) => 0,
                (naga::AddressSpace::Storage { .. }, _) => 1,
                (
                    _,
                    TypeInner::Image {
                        class: ImageClass::Storage { .. },
                        ..
                    },
                ) => 3,
                (_, TypeInner::Image { .. }) => 2,
                // A sampler is combined into its texture's slot.
                _ => return None,
            };
            Some((g.binding?, kind))
        })
        .collect();
    bound.sort_by_key(|(b, _)| (b.group, b.binding));
    let mut taken: HashSet<(u8, u8)> = HashSet::new();
    let mut map = BindingMap::default();
    for (binding, kind) in &bound {
        let own = stage_file.iter().find(|n| n.binding == *binding);
        let own = own.and_then(|n| u8::try_from(n.number).ok());
        if let Some(own) = own.filter(|own| taken.insert((*kind, *own))) {
            map.insert(*binding, own);
        }
    }
    for (binding, kind) in bound {
        if map.contains_key(&binding) {
            continue;
        }
        let mut all = 0..=u8::MAX;
        let free = all.find(|n| taken.insert((kind, *n)));
        map.insert(binding, free.unwrap_or(u8::MAX));
    }
    map
}

/// Numbers the bindings of one descriptor set in the order of group and binding. All stages of a
/// program share them.
fn descriptor_map(module: &Module) -> BindingMap {
    let bound = module.global_variables.iter().filter_map(|(_, g)| {
        // A sampler is combined into its texture's binding.
        let is_sampler = matches!(module.types[g.ty].inner, TypeInner::Sampler { .. });
        g.binding.filter(|_| !is_sampler)
    });
    let mut bound: Vec<ResourceBinding> = bound.collect();
    bound.sort_by_key(|b| (b.group, b.binding));
    let slots = (0..=u8::MAX).chain(std::iter::repeat(u8::MAX));
    bound.into_iter().zip(slots).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_that_is_turned_in_other_words_is_an_error() {
        let main = |line: &str| {
            format!("void main() {{\n    if (x) {{ {line} return; }}\n    {line}\n}}\n")
        };
        let own = with_author_depth(&main(CONVERTED_POSITION));
        assert_eq!(own, Some(main(OWN_DEPTH)));
        assert_eq!(with_author_depth(&main("gl_Position = vec4(0.0);")), None);
        let other = CONVERTED_POSITION.replace("2.0", "2");
        assert_eq!(
            with_author_depth(&(main(CONVERTED_POSITION) + &other)),
            None
        );
    }
}
