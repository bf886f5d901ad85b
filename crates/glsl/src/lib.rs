//! Parses GLSL of every version to naga modules.
//!
//! naga's front end only reads Vulkan's dialect with explicit bindings and locations. We pass such
//! texts to naga unchanged if it reads them correctly. All other texts are parsed here and printed
//! in that dialect, in the order of these modules:
//!
//! `preprocess` runs directives and macros; `syntax` parses, with `type_names`; `shadow_samplers` types Vulkan's samplers;
//! `stage` collects a stage's declarations; `interface` assigns bindings and locations to both stages; `declared` records the
//! author's own; `lower` prints; `source_marks` maps the printed text to the source, and
//! `map_spans` applies that map to the module. `member_loads` narrows what naga loads.
//! `placeholders`, `atomics`, `binding_arrays`, `built_ins` and `lengths` add to the IR what naga's
//! front end lacks.
#![warn(missing_docs)]

mod atomics;
mod build;
mod built_ins;
mod compare;
mod constant;
mod declared;
mod formats;
mod include;
mod interface;
mod lengths;
mod lower;
mod member_loads;
mod parser_messages;
mod placeholders;
mod preprocess;
mod resolve;
mod shadow_samplers;
mod source_marks;
mod stage;
mod syntax;
pub mod tree;
mod ty;
mod type_names;
mod version;

use std::path::Path;

use naga::front::glsl::{Frontend, Options as NagaOptions};
use naga::proc::{Alignment, Layouter};
use naga::{
    AddressSpace, ConservativeDepth, EarlyDepthTest, Handle, Module, ShaderStage, Span, Type,
    TypeInner,
};
use preshade_ir::declared::Declared;
use preshade_ir::link::offset;
use preshade_text::source::SourceMap;

use self::constant::Specialised;
use self::interface::Interface;
use self::lower::BuiltinCall;
use self::placeholders::Placeholders;
use self::source_marks::Map;
use self::stage::GlslStage;
use self::syntax::StageText;
use self::version::Dialect;
use preshade_ir::{
    beyond_wgsl, binding_arrays, killed_loops, lengths as length_constants, map_spans, wrapped_main,
};
use preshade_text::error::{Code, Error};
use preshade_text::options::{ClipSpace, Options};
use preshade_text::tokens::without_comments;
use preshade_text::unsupported;

/// One stage's text.
pub struct Text<'a> {
    /// The file's name, for relative includes.
    pub name: &'a str,
    /// The whole text.
    pub text: &'a str,
    /// Its stage.
    pub stage: ShaderStage,
    /// The file's offset in the source map.
    pub base: u32,
}

/// Parses a material's stages in order. The modules' spans refer to the source map, to which
/// included files are added. Entry points become `vertex_main` and `fragment_main`, because a
/// module has one name space.
pub fn parse(
    texts: &[Text<'_>],
    options: &Options,
    map: &mut SourceMap,
) -> Result<(Vec<Module>, Declared), Error> {
    if std::env::var_os("GLSL_COMPARE").is_some() {
        compared(texts, options, map);
    }
    let (mut modules, mut declared) = match std::env::var_os("GLSL_OLD") {
        None => built(texts, options, map)?,
        Some(_) => parsed(texts, options, map)?,
    };
    declared.mains = texts.iter().map(|t| t.stage).collect();
    beyond_wgsl::narrow_storage(&mut modules);
    Ok((modules, declared))
}

fn parsed(
    texts: &[Text<'_>],
    options: &Options,
    map: &mut SourceMap,
) -> Result<(Vec<Module>, Declared), Error> {
    let read_by_naga = || match options.clip_space {
        Some(ClipSpace::OpenGl) => None,
        _ => read_by_naga(texts).map(|modules| {
            let declared = Declared {
                numbers: declared::as_bound(&modules),
                // naga reads Vulkan's GLSL alone.
                y_down: true,
                ..Declared::default()
            };
            (modules, declared)
        }),
    };
    // We expand macros ourselves: naga's preprocessor does not limit the work.
    let has_macros = !options.defines.is_empty() || texts.iter().any(|t| has_directives(t.text));
    let lost = has_macros || texts.iter().any(|t| is_misread_by_naga(t.text));
    if !lost && let Some(read) = read_by_naga() {
        return Ok(read);
    }
    let rewritten = rewritten(texts, options, map);
    match lost && !has_macros {
        // If we cannot rewrite the text, naga's own reading is better than none.
        true => rewritten.or_else(|e| match e.code() {
            Code::Unsupported => read_by_naga().ok_or(e),
            _ => Err(e),
        }),
        false => rewritten,
    }
}

/// Whether naga accepts the text but changes its meaning: short-circuit operators, `do` loops,
/// array layers, fetch offsets, written parameters.
fn is_misread_by_naga(text: &str) -> bool {
    let marks = ["&&", "||", "Array", "texelFetchOffset"];
    let mut words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
    marks.iter().any(|m| text.contains(m))
        || words.any(|w| w == "do" || w == "inout")
        || writes_parameters(text)
        || has_effect_in_index(text)
}

/// Whether the text has directives other than `#version` and `#extension`. naga's preprocessor does
/// not limit nested macros.
fn has_directives(text: &str) -> bool {
    text.split('#').skip(1).any(|rest| {
        let rest = rest.trim_start();
        !["version", "extension"].iter().any(|w| rest.starts_with(w))
    })
}

/// Whether a function has an `out` parameter.
fn writes_parameters(text: &str) -> bool {
    text.match_indices("out ").any(|(at, _)| {
        let before = text[..at].trim_end();
        before.ends_with(['(', ',']) || before.ends_with("const")
    })
}

/// Whether an index has side effects: naga evaluates the index of a target twice.
fn has_effect_in_index(text: &str) -> bool {
    text.split('[').skip(1).any(|rest| {
        let inside = rest.split(']').next().unwrap_or("");
        inside.contains("++") || inside.contains("--") || inside.contains(['(', '='])
    })
}

fn compared(texts: &[Text<'_>], options: &Options, map: &mut SourceMap) {
    let routed = parsed(texts, options, &mut map.clone());
    let old = rewritten(texts, options, &mut map.clone());
    let new = built(texts, options, &mut map.clone());
    compare::compare(texts, options.clip_space, [&routed, &old], &new);
}

/// Reads a material's stages straight to IR.
fn built(
    texts: &[Text<'_>],
    options: &Options,
    map: &mut SourceMap,
) -> Result<(Vec<Module>, Declared), Error> {
    let units = units(texts, options, map)?;
    let resolved = resolve(&units, texts, options, None)?;
    let mut declared = resolved.declared;
    let mut modules = resolved.modules;
    let is_fixed = |(of, _): &lengths::Candidate| {
        let constant = (of.id, of.own.clone());
        resolved.fixed.contains(&constant)
    };
    let mut raised = Vec::new();
    for candidate in resolved.lengths.iter().filter(|c| !is_fixed(c)) {
        if let Ok(again) = resolve(&units, texts, options, Some(candidate.0.id)) {
            raised.push((candidate.clone(), again.modules));
        }
    }
    declared.lengths = lengths::mark(&mut modules, raised);
    let candidates = resolved.lengths.into_iter().map(|(of, _)| of);
    let others = candidates.filter(|of| !declared.lengths.contains(of));
    let mut fixed = resolved.fixed;
    fixed.extend(others.map(|of| (of.id, of.own)));
    for constant in fixed {
        length_constants::fix(&mut modules, constant, &mut declared)?;
    }
    Ok((modules, declared))
}

/// A material's stages as IR.
struct Resolved {
    modules: Vec<Module>,
    declared: Declared,
    /// Specialisation constants that may give lengths of arrays by themselves.
    lengths: Vec<lengths::Candidate>,
    /// Those whose defaults are final.
    fixed: Specialised,
}

/// Resolves and writes the stages. `raised`: the specialisation constant whose default counts as one
/// more.
fn resolve(
    units: &[syntax::Unit],
    texts: &[Text<'_>],
    options: &Options,
    raised: Option<u32>,
) -> Result<Resolved, Error> {
    let mut stages = Vec::new();
    for (unit, text) in units.iter().zip(texts) {
        stages.push(GlslStage::collect(unit, text.stage, raised)?);
    }
    let of_text = clip_space(&stages);
    let clip = options.clip_space.unwrap_or(of_text);
    let mut interface = Interface::of(&mut stages)?;
    let mut declared =
        declared::declared(&stages, &interface, clip, of_text == ClipSpace::AsWritten);
    let mut modules = Vec::new();
    for stage in &mut stages {
        let resolved = resolve::resolve(stage, &mut interface, clip)?;
        let mut module = build::build(&resolved, stage.kind)?;
        if let Some(conservative) = stage.depth.filter(|_| stage.used.contains("gl_FragDepth")) {
            for entry in &mut module.entry_points {
                let bound = EarlyDepthTest::Allow { conservative };
                entry.early_depth_test.get_or_insert(bound);
            }
        }
        finish(&mut module, stage.kind);
        modules.push(module);
    }
    declared::layouts(&stages, &interface, &mut declared);
    declared.demotes = stages.iter().any(|s| s.demotes.get());
    let mut lengths: Vec<lengths::Candidate> = Vec::new();
    for length in stages.iter().flat_map(|s| s.lengths.take()) {
        if !lengths.contains(&length) {
            lengths.push(length);
        }
    }
    Ok(Resolved {
        modules,
        declared,
        lengths,
        fixed: stages.iter().flat_map(|s| s.assumed.take()).collect(),
    })
}

fn rewritten(
    texts: &[Text<'_>],
    options: &Options,
    map: &mut SourceMap,
) -> Result<(Vec<Module>, Declared), Error> {
    let units = units(texts, options, map)?;
    let lowered = lower(&units, texts, options, None)?;
    let mut modules = modules(&lowered, texts)?;
    let mut declared = lowered.declared;
    let is_fixed = |(of, _): &lengths::Candidate| {
        let constant = (of.id, of.own.clone());
        lowered.fixed.contains(&constant)
    };
    let mut raised = Vec::new();
    for candidate in lowered.lengths.iter().filter(|c| !is_fixed(c)) {
        let again = lower(&units, texts, options, Some(candidate.0.id));
        if let Ok(modules) = again.and_then(|lowered| self::modules(&lowered, texts)) {
            raised.push((candidate.clone(), modules));
        }
    }
    declared.lengths = lengths::mark(&mut modules, raised);
    let candidates = lowered.lengths.into_iter().map(|(of, _)| of);
    let others = candidates.filter(|of| !declared.lengths.contains(of));
    let mut fixed = lowered.fixed;
    fixed.extend(others.map(|of| (of.id, of.own)));
    for constant in fixed {
        length_constants::fix(&mut modules, constant, &mut declared)?;
    }
    Ok((modules, declared))
}

/// naga's modules of lowered texts.
fn modules(lowered: &Lowered, texts: &[Text<'_>]) -> Result<Vec<Module>, Error> {
    let stages = lowered.stages.iter().zip(texts);
    stages
        .map(|(lowered, text)| {
            let place = |span: Span| lowered.map.back(span);
            let mut module = read(&lowered.text, text.stage, &place, &lowered.given)?;
            placeholders::replace(&mut module, &lowered.placeholders);
            atomics::replace(&mut module, &lowered.placeholders, &place)?;
            built_ins::replace(&mut module, lowered.clip_distances.as_deref());
            lowered.opened.iter().for_each(|o| o.close(&mut module));
            if let Some(conservative) = lowered.depth {
                for entry in &mut module.entry_points {
                    let bound = EarlyDepthTest::Allow { conservative };
                    entry.early_depth_test.get_or_insert(bound);
                }
            }
            map_spans::map_spans(&mut module, &place);
            finish(&mut module, text.stage);
            Ok(module)
        })
        .collect()
}

/// Preprocesses and parses the stages only.
pub fn parse_alone(
    texts: &[Text<'_>],
    options: &Options,
    map: &mut SourceMap,
) -> Result<(), Error> {
    units(texts, options, map).map(|_| ())
}

fn units(
    texts: &[Text<'_>],
    options: &Options,
    map: &mut SourceMap,
) -> Result<Vec<syntax::Unit>, Error> {
    let mut units = Vec::new();
    for text in texts {
        let mut unit = syntax::parse(
            &StageText {
                text: text.text,
                stage: text.stage,
                path: Path::new(text.name),
                base: text.base,
                options,
            },
            map,
        )?;
        shadow_samplers::settle(&mut unit.tree);
        units.push(unit);
    }
    Ok(units)
}

/// A stage in naga's dialect.
#[derive(Clone, Debug)]
pub struct LoweredStage {
    /// Its text.
    pub text: String,
    map: Map,
    opened: Vec<interface::Opened>,
    given: Vec<BuiltinCall>,
    placeholders: Placeholders,
    /// The array that stands for `gl_ClipDistance`.
    clip_distances: Option<String>,
    /// The bound of `gl_FragDepth`, which naga's front end does not read.
    depth: Option<ConservativeDepth>,
}

/// A material's stages in naga's dialect.
pub struct Lowered {
    /// The stages, in the order of the texts.
    pub stages: Vec<LoweredStage>,
    declared: Declared,
    /// Specialisation constants that may give lengths of arrays by themselves.
    lengths: Vec<lengths::Candidate>,
    /// Those whose defaults are final.
    fixed: Specialised,
}

/// Rewrites a material's stages for naga and records their declarations.
pub fn normalise(
    texts: &[Text<'_>],
    options: &Options,
    map: &mut SourceMap,
) -> Result<Lowered, Error> {
    lower(&units(texts, options, map)?, texts, options, None)
}

/// Lowers the stages. `raised`: the specialisation constant whose default counts as one more.
fn lower(
    units: &[syntax::Unit],
    texts: &[Text<'_>],
    options: &Options,
    raised: Option<u32>,
) -> Result<Lowered, Error> {
    let mut stages = Vec::new();
    for (unit, text) in units.iter().zip(texts) {
        stages.push(GlslStage::collect(unit, text.stage, raised)?);
    }
    let of_text = clip_space(&stages);
    let clip = options.clip_space.unwrap_or(of_text);
    let mut interface = Interface::of(&mut stages)?;
    let mut declared =
        declared::declared(&stages, &interface, clip, of_text == ClipSpace::AsWritten);
    let lowered: Result<Vec<LoweredStage>, Error> = stages
        .iter_mut()
        .map(|stage| {
            let lowered = lower::lower(stage, &mut interface, clip)?;
            let (text, map) = lowered.marks.settle(&lowered.text);
            Ok(LoweredStage {
                text,
                map,
                opened: std::mem::take(&mut interface.opened),
                given: lowered.given,
                placeholders: lowered.placeholders,
                clip_distances: lowered.clip_distances,
                depth: stage.depth.filter(|_| stage.used.contains("gl_FragDepth")),
            })
        })
        .collect();
    let lowered = lowered?;
    declared::layouts(&stages, &interface, &mut declared);
    declared.demotes = stages.iter().any(|s| s.demotes.get());
    let mut lengths: Vec<lengths::Candidate> = Vec::new();
    for length in stages.iter().flat_map(|s| s.lengths.take()) {
        if !lengths.contains(&length) {
            lengths.push(length);
        }
    }
    Ok(Lowered {
        stages: lowered,
        declared,
        lengths,
        fixed: stages.iter().flat_map(|s| s.assumed.take()).collect(),
    })
}

/// Guesses the clip space: OpenGL's, unless the text is Vulkan's GLSL, which has explicit bindings
/// and no loose uniforms. A text of an old version, or of ES, must have words that only Vulkan has.
fn clip_space(stages: &[GlslStage<'_>]) -> ClipSpace {
    let is_opengls = |s: &GlslStage<'_>| {
        let loose = s
            .uniforms
            .iter()
            .any(|u| !matches!(u.ty.innermost(), ty::Ty::Combined(_)));
        let own = ["gl_VertexID", "gl_InstanceID", "gl_FragColor"];
        loose || own.iter().any(|w| s.used.contains(*w))
    };
    let is_old = |s: &GlslStage<'_>| {
        let Dialect { version, es } = s.unit.dialect;
        es || version < 420
    };
    let opengl = stages.iter().any(is_opengls)
        || stages.iter().any(is_old) && !stages.iter().any(GlslStage::says_vulkan);
    match opengl {
        true => ClipSpace::OpenGl,
        false => ClipSpace::AsWritten,
    }
}

/// naga's own modules, if it reads all texts correctly.
fn read_by_naga(texts: &[Text<'_>]) -> Option<Vec<Module>> {
    let modules: Option<Vec<Module>> = texts
        .iter()
        .map(|text| {
            let Dialect { version, es } = Dialect::of(text.text, Path::new(text.name));
            // naga ignores these silently, and swaps the dimensions of arrays of arrays.
            let lost = [
                "precise",
                "outerProduct",
                "isnan",
                "isinf",
                "][",
                "offset=",
                "offset =",
                "align=",
                "align =",
                "origin_upper_left",
                "pixel_center_integer",
                "depth_greater",
                "depth_less",
                "depth_unchanged",
            ];
            let mut words = text.text.split(|c: char| !c.is_alphanumeric() && c != '_');
            // naga reads some that no language has, and others wrongly.
            let is_lost = |w: &str| {
                matches!(w, "sample" | "centroid")
                    || unsupported::absent(w).is_some()
                    || built_ins::variable(w, text.stage).is_some()
            };
            if es
                || version < 440
                || lost.iter().any(|w| text.text.contains(w))
                || words.any(is_lost)
            {
                return None;
            }
            let place = |span: Span| span;
            let read = || read(text.text, text.stage, &place, &[]).ok();
            let mut module =
                std::panic::catch_unwind(std::panic::AssertUnwindSafe(read)).ok()??;
            // naga does not follow GLSL's struct layout, and WGSL has no std140 storage blocks.
            let is_mixed = ["buffer", "std140"].iter().all(|w| text.text.contains(w));
            if !wrapped_main::is_valid(&module) || is_mixed || !is_laid_out(&module) {
                return None;
            }
            map_spans::map_spans(&mut module, &|span| offset(span, text.base));
            finish(&mut module, text.stage);
            Some(module)
        })
        .collect();
    modules
}

/// Whether blocks have the same layout in GLSL and WGSL: array strides that WGSL can express, and
/// 16-byte aligned structs in uniform blocks. naga does not check this.
fn is_laid_out(module: &Module) -> bool {
    fn of(module: &Module, layouter: &Layouter, ty: Handle<Type>, uniform: bool) -> bool {
        match &module.types[ty].inner {
            TypeInner::Array { base, stride, .. } => {
                *stride == layouter[*base].to_stride() && of(module, layouter, *base, uniform)
            }
            TypeInner::Struct { members, .. } => members.iter().all(|m| {
                let layout = layouter[m.ty];
                let is_struct = matches!(module.types[m.ty].inner, TypeInner::Struct { .. });
                let on_16 =
                    layout.alignment >= Alignment::MIN_UNIFORM && layout.size.is_multiple_of(16);
                (on_16 || !(uniform && is_struct)) && of(module, layouter, m.ty, uniform)
            }),
            _ => true,
        }
    }
    let mut layouter = Layouter::default();
    layouter.update(module.to_ctx()).is_ok()
        && module.global_variables.iter().all(|(_, g)| {
            let in_block = matches!(
                g.space,
                AddressSpace::Uniform | AddressSpace::Storage { .. } | AddressSpace::Immediate
            );
            !in_block || of(module, &layouter, g.ty, g.space == AddressSpace::Uniform)
        })
}

/// Parses naga's dialect. `place` maps error spans to the source.
fn read(
    text: &str,
    stage: ShaderStage,
    place: &dyn Fn(Span) -> Span,
    given: &[BuiltinCall],
) -> Result<Module, Error> {
    Frontend::default()
        .parse(&NagaOptions::from(stage), text)
        .map(|mut module| {
            binding_arrays::replace(&mut module);
            member_loads::narrow(&mut module);
            module
        })
        .map_err(|errors| {
            let mut all = errors.errors.iter();
            let Some(first) = all.next() else {
                return Error::new(Code::Parse, "the GLSL parser failed without a message");
            };
            let at = place(first.meta);
            let called = |g: &&BuiltinCall| {
                let name = format!("`{}`", g.name);
                let meets = g.place.to_range().zip(at.to_range());
                parser_messages::message(&first.kind).contains(&name)
                    && meets.is_some_and(|(a, b)| a.start < b.end && b.start < a.end)
            };
            let message = match given.iter().find(called) {
                Some(given) => {
                    let types: Vec<String> = given.types.iter().map(ty::Ty::spelled).collect();
                    format!("no `{}` takes ({})", given.name, types.join(", "))
                }
                None => parser_messages::message(&first.kind),
            };
            let error = Error::new(Code::Parse, message).label(at, "");
            all.fold(error, |error, other| {
                error.label(place(other.meta), parser_messages::message(&other.kind))
            })
        })
}

/// Normalises the module for the passes.
fn finish(module: &mut Module, stage: ShaderStage) {
    let name = match stage {
        ShaderStage::Vertex => "vertex_main",
        _ => "fragment_main",
    };
    for entry in &mut module.entry_points {
        entry.name = name.to_owned();
    }
    killed_loops::end(module);
    wrapped_main::inline(module);
}

/// Whether the file holds both stages, separated by `#pragma stage vertex` and `#pragma stage
/// fragment` (RetroArch).
pub fn has_stages(text: &str) -> bool {
    without_comments(text)
        .lines()
        .any(|l| stage_pragma(l) == Some(Some(ShaderStage::Vertex)))
}

/// The stage of a `#pragma stage` line; `None` for other lines.
fn stage_pragma(line: &str) -> Option<Option<ShaderStage>> {
    let mut words = line
        .trim_start()
        .strip_prefix("#pragma")?
        .split_whitespace();
    (words.next() == Some("stage")).then(|| match words.next() {
        Some("vertex") => Some(ShaderStage::Vertex),
        Some("fragment") => Some(ShaderStage::Fragment),
        _ => None,
    })
}

/// Blanks the lines of the other stage. `#pragma stage` lines stay, because an included file may
/// change the stage too.
pub fn stage_of(text: &str, stage: ShaderStage) -> String {
    let mut out = String::with_capacity(text.len());
    let mut ours = true;
    let told = without_comments(text);
    for (line, told) in text.split_inclusive('\n').zip(told.split_inclusive('\n')) {
        let pragma = stage_pragma(told);
        if let Some(of) = pragma {
            ours = of == Some(stage);
        }
        match ours || pragma.is_some() {
            true => out.push_str(line),
            false => out.extend(line.bytes().map(|b| if b == b'\n' { '\n' } else { ' ' })),
        }
    }
    out
}

/// Parses a text without macros to its syntax tree.
pub fn tree(
    text: &Text<'_>,
    map: &mut SourceMap,
) -> Result<glsl_lang::ast::TranslationUnit, Error> {
    let input = StageText {
        text: text.text,
        stage: text.stage,
        path: Path::new(text.name),
        base: text.base,
        options: &Options::default(),
    };
    syntax::parse(&input, map).map(|unit| unit.tree)
}

/// Builds a vertex stage that writes all inputs of a fragment stage.
pub fn vertex_stage_for(
    text: &Text<'_>,
    options: &Options,
    map: &mut SourceMap,
) -> Result<String, Error> {
    let unit = syntax::parse(
        &StageText {
            text: text.text,
            stage: text.stage,
            path: Path::new(text.name),
            base: text.base,
            options,
        },
        map,
    )?;
    let stage = GlslStage::collect(&unit, ShaderStage::Fragment, None)?;
    let mut out = "#version 450\n".to_owned();
    for name in &stage.structs.order {
        let made = |v: &stage::Variable| matches!(v.ty.innermost(), ty::Ty::Struct(n) if n == name);
        let Some(of) = stage
            .structs
            .get(name)
            .filter(|_| stage.inputs.iter().any(made))
        else {
            continue;
        };
        let members: Vec<String> = of
            .members
            .iter()
            .map(|m| format!("    {};\n", m.ty.declare(&m.name)))
            .collect();
        out += &format!("struct {name} {{\n{}}};\n", members.concat());
    }
    out += "layout(location = 0) in vec4 position;\n";
    let mut blocks: Vec<String> = Vec::new();
    for variable in &stage.inputs {
        let q = &variable.qualifiers;
        let words: String = [q.interpolation, q.sampling]
            .into_iter()
            .flatten()
            .map(|w| format!("{w} "))
            .collect();
        let at = q
            .number("location")
            .map(|n| format!("layout(location = {n}) "))
            .unwrap_or_default();
        let Some((block, instance)) = &variable.block else {
            out += &format!("{at}{words}out {};\n", variable.ty.declare(&variable.name));
            continue;
        };
        if blocks.contains(block) {
            continue;
        }
        blocks.push(block.clone());
        let of_block = stage
            .inputs
            .iter()
            .filter(|v| v.block.as_ref().is_some_and(|b| b.0 == *block));
        let members: Vec<String> = of_block
            .map(|v| format!("    {};\n", v.ty.declare(&v.name)))
            .collect();
        let instance = instance
            .as_deref()
            .map(|i| format!(" {i}_out"))
            .unwrap_or_default();
        out += &format!("{at}out {block} {{\n{}}}{instance};\n", members.concat());
    }
    Ok(out + "void main() { gl_Position = position; }\n")
}

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
