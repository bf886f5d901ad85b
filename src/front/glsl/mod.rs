//! GLSL as people write it, of every version, to naga modules.
//!
//! naga's own front end reads one dialect, that of Vulkan with all bindings and locations said. What it reads as it is stays as it is. Anything else is parsed, understood and
//! printed as that dialect, in the order of these files:
//!
//! `preprocess` does what directives and macros ask; `syntax` parses; `stage` sorts what a stage declares; `interface` gives both stages their bindings and locations; `declared` keeps what they were before; `lower` prints; `marks` know which
//! place of the author's each piece came from; `respan` moves the module's spans back there. `gather` puts in what the dialect cannot say.

mod constant;
mod declared;
mod gather;
mod include;
mod interface;
mod lower;
mod marks;
mod preprocess;
mod respan;
mod stage;
mod syntax;
mod told;
mod ty;
mod writes;

use std::collections::HashMap;
use std::path::Path;

use naga::front::glsl::{Frontend, Options as NagaOptions};
use naga::proc::{Alignment, Layouter};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{AddressSpace, Handle, Module, ShaderStage, Span, Type, TypeInner};
use preshade_passes::declared::Declared;
use preshade_passes::link::offset;
use preshade_passes::program::SourceMap;

use self::interface::Interface;
use self::lower::Given;
use self::marks::Map;
use self::stage::Stage;
use self::syntax::{Dialect, Input};
use super::error::{Code, Error};
use super::{ClipSpace, Options, lend, promote, returns, switch};

/// One stage's text.
pub(super) struct Text<'a> {
    /// The file's name, for what it includes.
    pub name: &'a str,
    pub text: &'a str,
    pub stage: ShaderStage,
    /// Where the file begins in the source map.
    pub base: u32,
}

/// Parses the stages of one material, in the order given. The modules' spans are those of the source map, to which included files are added. Entry points are named
/// `vertex_main` or `fragment_main`: a module has one name space, and both stages arrive as `main`.
pub(super) fn parse(
    texts: &[Text<'_>],
    options: &Options,
    map: &mut SourceMap,
) -> Result<(Vec<Module>, Declared), Error> {
    let as_they_are = || match options.clip_space {
        Some(ClipSpace::OpenGl) => None,
        _ => as_they_are(texts).map(|modules| {
            let declared = Declared {
                numbers: declared::as_bound(&modules),
                ..Declared::default()
            };
            (modules, declared)
        }),
    };
    // Macros are ours to expand, and to count: naga's preprocessor does the latter not.
    let has_macros = !options.defines.is_empty() || texts.iter().any(|t| has_directives(t.text));
    let lost = has_macros || texts.iter().any(|t| is_evaluated_otherwise(t.text));
    if !lost && let Some(read) = as_they_are() {
        return Ok(read);
    }
    let rewritten = rewritten(texts, options, map);
    match lost && !has_macros {
        // What is not rewritten is better read as it is than not at all.
        true => rewritten.or_else(|e| match e.code() {
            Code::Unsupported => as_they_are().ok_or(e),
            _ => Err(e),
        }),
        false => rewritten,
    }
}

/// Whether a text has what naga reads and makes something else of: operators and loops that evaluate less than all, layers, offsets of fetches, and parameters that are written.
fn is_evaluated_otherwise(text: &str) -> bool {
    let marks = ["&&", "||", "Array", "texelFetchOffset"];
    let mut words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
    marks.iter().any(|m| text.contains(m))
        || words.any(|w| w == "do" || w == "inout")
        || writes_parameters(text)
        || does_something_in_an_index(text)
}

/// Whether the preprocessor is asked for more than a version: naga's own hands on what macros come to however deeply it nests.
fn has_directives(text: &str) -> bool {
    text.split('#').skip(1).any(|rest| {
        let rest = rest.trim_start();
        !["version", "extension"].iter().any(|w| rest.starts_with(w))
    })
}

/// Whether a parameter is `out`.
fn writes_parameters(text: &str) -> bool {
    text.match_indices("out ").any(|(at, _)| {
        let before = text[..at].trim_end();
        before.ends_with(['(', ',']) || before.ends_with("const")
    })
}

/// Whether an index is more than a name or a number: naga evaluates that of a target twice.
fn does_something_in_an_index(text: &str) -> bool {
    text.split('[').skip(1).any(|rest| {
        let inside = rest.split(']').next().unwrap_or("");
        inside.contains("++") || inside.contains("--") || inside.contains(['(', '='])
    })
}

fn rewritten(
    texts: &[Text<'_>],
    options: &Options,
    map: &mut SourceMap,
) -> Result<(Vec<Module>, Declared), Error> {
    let (normalised, declared) = normalise(texts, options, map)?;
    let modules: Result<_, Error> = normalised
        .iter()
        .zip(texts)
        .map(|(rewritten, text)| {
            let place = |span: Span| rewritten.map.back(span);
            let mut module = read(&rewritten.text, text.stage, &place, &rewritten.given)?;
            gather::replace(&mut module, &rewritten.gathers);
            rewritten.opened.iter().for_each(|o| o.close(&mut module));
            respan::respan(&mut module, &place);
            finish(&mut module, text.stage);
            Ok(module)
        })
        .collect();
    Ok((modules?, declared))
}

/// Preprocesses and parses the stages, no more.
pub(super) fn parse_alone(
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
        units.push(syntax::parse(
            &Input {
                text: text.text,
                stage: text.stage,
                path: Path::new(text.name),
                base: text.base,
                options,
            },
            map,
        )?);
    }
    Ok(units)
}

/// A stage in naga's dialect.
#[derive(Clone, Debug)]
pub(super) struct Normalised {
    pub text: String,
    map: Map,
    opened: Vec<interface::Opened>,
    given: Vec<Given>,
    /// The functions that stand for a gather, with their components.
    gathers: HashMap<String, u32>,
}

/// Rewrites the stages of one material for naga; with what they declared.
pub(super) fn normalise(
    texts: &[Text<'_>],
    options: &Options,
    map: &mut SourceMap,
) -> Result<(Vec<Normalised>, Declared), Error> {
    let units = units(texts, options, map)?;
    let mut stages = Vec::new();
    for (unit, text) in units.iter().zip(texts) {
        stages.push(Stage::collect(unit, text.stage)?);
    }
    let clip = options.clip_space.unwrap_or_else(|| clip_space(&stages));
    let mut interface = Interface::of(&mut stages)?;
    let declared = declared::declared(&stages, &interface, clip);
    let texts: Result<_, Error> = stages
        .iter_mut()
        .map(|stage| {
            let lowered = lower::lower(stage, &mut interface, clip)?;
            let (text, map) = lowered.marks.settle(&lowered.text);
            Ok(Normalised {
                text,
                map,
                opened: std::mem::take(&mut interface.opened),
                given: lowered.given,
                gathers: lowered.gathers,
            })
        })
        .collect();
    Ok((texts?, declared))
}

/// The clip space that a text of this kind is written for: OpenGL's, unless it is Vulkan's GLSL, which says bindings and locations and has no uniforms outside of blocks.
fn clip_space(stages: &[Stage<'_>]) -> ClipSpace {
    let opengl = stages.iter().any(|s| {
        let Dialect { version, es } = s.unit.dialect;
        let loose = s
            .uniforms
            .iter()
            .any(|u| !matches!(u.ty.innermost(), ty::Ty::Combined(_)));
        let own = ["gl_VertexID", "gl_InstanceID", "gl_FragColor"];
        es || version < 420 || loose || own.iter().any(|w| s.used.contains(*w))
    });
    match opengl {
        true => ClipSpace::OpenGl,
        false => ClipSpace::AsWritten,
    }
}

/// The modules, where naga reads all of the texts, valid, without help.
fn as_they_are(texts: &[Text<'_>]) -> Option<Vec<Module>> {
    let modules: Option<Vec<Module>> = texts
        .iter()
        .map(|text| {
            let Dialect { version, es } = Dialect::of(text.text, Path::new(text.name));
            // What naga passes over in silence, it does not read.
            // And of arrays of arrays it takes the first dimension for the last.
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
            ];
            if es || version < 440 || lost.iter().any(|w| text.text.contains(w)) {
                return None;
            }
            let place = |span: Span| span;
            let read = || read(text.text, text.stage, &place, &[]).ok();
            let mut module =
                std::panic::catch_unwind(std::panic::AssertUnwindSafe(read)).ok()??;
            // It lays structs out by no rules of GLSL's, and storage blocks of std140 are none of WGSL's.
            let is_mixed = ["buffer", "std140"].iter().all(|w| text.text.contains(w));
            if !is_valid(&module) || is_mixed || !is_laid_out(&module) {
                return None;
            }
            respan::respan(&mut module, &|span| offset(span, text.base));
            finish(&mut module, text.stage);
            Some(module)
        })
        .collect();
    modules
}

/// Whether blocks lie where both GLSL and WGSL have them: arrays in steps that WGSL can say, and structs within uniform blocks on 16 bytes, which naga does not see to.
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

/// What naga makes of a text in its dialect; `place` finds its errors in the author's.
fn read(
    text: &str,
    stage: ShaderStage,
    place: &dyn Fn(Span) -> Span,
    given: &[Given],
) -> Result<Module, Error> {
    Frontend::default()
        .parse(&NagaOptions::from(stage), text)
        .map_err(|errors| {
            let mut all = errors.errors.iter();
            let Some(first) = all.next() else {
                return Error::new(Code::Parse, "the GLSL parser gave up without saying why");
            };
            let at = place(first.meta);
            let called = |g: &&Given| {
                let name = format!("`{}`", g.name);
                let meets = g.place.to_range().zip(at.to_range());
                told::told(&first.kind).contains(&name)
                    && meets.is_some_and(|(a, b)| a.start < b.end && b.start < a.end)
            };
            let message = match given.iter().find(called) {
                Some(given) => {
                    let types: Vec<String> = given.types.iter().map(ty::Ty::spelled).collect();
                    format!("no `{}` takes ({})", given.name, types.join(", "))
                }
                None => told::told(&first.kind),
            };
            let error = Error::new(Code::Parse, message).label(at, "");
            all.fold(error, |error, other| {
                error.label(place(other.meta), told::told(&other.kind))
            })
        })
}

/// Makes the module one that the passes know how to read.
fn finish(module: &mut Module, stage: ShaderStage) {
    let name = match stage {
        ShaderStage::Vertex => "vertex_main",
        _ => "fragment_main",
    };
    for entry in &mut module.entry_points {
        entry.name = name.to_owned();
    }
    switch::write_out_fall_through(module);
    // An invalid module stays as it is for the validator's message on it.
    if is_valid(module) {
        lend::lend(module);
        promote::promote(module);
        returns::complete(module);
    }
}

fn is_valid(module: &Module) -> bool {
    Validator::new(ValidationFlags::all(), Capabilities::all())
        .validate(module)
        .is_ok()
}

/// Whether the file holds both stages, told apart by `#pragma stage vertex` and `#pragma stage fragment`, as RetroArch's shaders do.
pub(super) fn has_stages(text: &str) -> bool {
    text.lines()
        .any(|l| stage_pragma(l) == Some(Some(ShaderStage::Vertex)))
}

/// The stage that a `#pragma stage` line begins, if it is such a line.
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

/// The text with all lines blank, at their length, that belong to another stage. The lines that tell them apart stay: what stands behind an `#include` belongs to the stage that the
/// included file ends in.
pub(super) fn stage_of(text: &str, stage: ShaderStage) -> String {
    let mut out = String::with_capacity(text.len());
    let mut ours = true;
    for line in text.split_inclusive('\n') {
        let pragma = stage_pragma(line);
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

/// The syntax tree of a text without macros.
pub(super) fn tree(
    text: &Text<'_>,
    map: &mut SourceMap,
) -> Result<glsl_lang::ast::TranslationUnit, Error> {
    let input = Input {
        text: text.text,
        stage: text.stage,
        path: Path::new(text.name),
        base: text.base,
        options: &Options::default(),
    };
    syntax::parse(&input, map).map(|unit| unit.tree)
}

/// A vertex stage that gives a fragment stage all that it reads, for looking at one without its other half.
pub(super) fn vertex_stage_for(
    text: &Text<'_>,
    options: &Options,
    map: &mut SourceMap,
) -> Result<String, Error> {
    let unit = syntax::parse(
        &Input {
            text: text.text,
            stage: text.stage,
            path: Path::new(text.name),
            base: text.base,
            options,
        },
        map,
    )?;
    let stage = Stage::collect(&unit, ShaderStage::Fragment)?;
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
