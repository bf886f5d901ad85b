//! Reads GLSL of every version to IR, in the order of these modules:
//!
//! `preprocess` runs directives and macros; `syntax` parses, with `type_names`; `stage` collects a
//! stage's declarations; `interface` assigns bindings and locations to both stages; `declared`
//! records the author's own. `resolve` resolves names, types, overloads, layouts and the order of
//! evaluation into a `tree`, and `build` converts that to IR. `lengths` finds the arrays whose
//! lengths are specialisation constants.
#![warn(missing_docs)]

mod build;
mod built_in_variables;
mod constant;
mod declared;
mod errors;
mod formats;
mod functions;
mod include;
mod interface;
mod layout;
mod lengths;
mod operations;
mod preprocess;
mod resolve;
mod stage;
mod syntax;
mod textures;
mod tree;
mod ty;
mod type_names;
mod version;

use naga::{EarlyDepthTest, Module, ShaderStage};
use naga_edit::declared::Declared;
use shader_text::source::SourceMap;

use self::constant::Specialised;
use self::interface::Interface;
use self::stage::GlslStage;
use self::version::Dialect;
use naga_edit::{beyond_wgsl, killed_loops, lengths as length_constants, wrapped_main};
use shader_text::error::Error;
use shader_text::options::{ClipSpace, Options};
use shader_text::tokens::without_comments;

/// One stage's text.
pub struct Text<'a> {
    /// The file's name, for relative includes.
    pub name: &'a str,
    /// The complete text, before preprocessing.
    pub text: &'a str,
    /// The stage that the text contains.
    pub stage: ShaderStage,
    /// Offset of the file in the source map.
    pub base: u32,
}

/// Parses a material's stages in order. The modules' spans refer to the source map, to which
/// included files are added. Entry points become `vertex_main` and `fragment_main`, because a
/// module has a single name space.
pub fn parse(
    texts: &[Text<'_>],
    options: &Options,
    map: &mut SourceMap,
) -> Result<(Vec<Module>, Declared), Error> {
    let (mut modules, mut declared) = read(texts, options, map)?;
    declared.mains = texts.iter().map(|t| t.stage).collect();
    beyond_wgsl::narrow_storage(&mut modules);
    Ok((modules, declared))
}

fn read(
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
    /// Specialisation constants that may affect only array lengths.
    lengths: Vec<lengths::Candidate>,
    /// Specialisation constants whose defaults are final.
    fixed: Specialised,
}

/// Resolves the stages, and converts them to IR. `raised`: the specialisation constant whose
/// default is taken as one larger.
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
    let all = texts.iter().map(|text| syntax::parse(text, options, map));
    all.collect()
}

/// Guesses the clip space: OpenGL's, unless the text is Vulkan's GLSL, with explicit bindings and
/// no loose uniforms. In an old version or in ES, the text must use a keyword that only Vulkan has.
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

/// The stage of a `#pragma stage` line. `None` for other lines.
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

/// Blanks the lines of the other stage. Keeps `#pragma stage` lines, because an included file may
/// switch the stage too.
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
    syntax::parse(text, &Options::default(), map).map(|unit| unit.tree)
}

/// Builds a vertex stage that writes all inputs of a fragment stage.
pub fn vertex_stage_for(
    text: &Text<'_>,
    options: &Options,
    map: &mut SourceMap,
) -> Result<String, Error> {
    let unit = syntax::parse(text, options, map)?;
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
