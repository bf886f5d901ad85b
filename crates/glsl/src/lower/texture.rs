//! Texture functions of all GLSL versions.

use std::iter;

use glsl_lang::ast::Expr;
use naga::Span;

use super::super::constant;
use super::super::interface::{SplitSampler, split_type};
use super::super::placeholders::Placeholder;
use super::super::source_marks::unmarked;
use super::super::stage::unsupported;
use super::super::ty::{Component, Ty};
use super::super::version::Dialect;
use super::Lower;
use super::effect::after;
use super::expression::{Ex, level};
use preshade_text::error::Error;
use preshade_text::unsupported;

/// A texture function.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Function {
    /// Its name in GLSL 4.50.
    pub name: String,
    /// A comparison that returns a vector: `shadow2D`.
    pub compares_to_vector: bool,
}

/// Texture functions of GLSL 4.50.
const FUNCTIONS: &str = "texture textureLod textureGrad textureOffset textureLodOffset \
    textureGradOffset textureProj textureProjLod textureProjGrad textureProjOffset \
    textureProjLodOffset textureProjGradOffset texelFetch texelFetchOffset textureSize \
    textureQueryLevels textureQueryLod textureGather textureGatherOffset textureGatherOffsets \
    textureSamples";

/// Prefixes of texture functions in older versions.
const OLD_PREFIXES: &str =
    "texture2DRect texture1D texture2D texture3D textureCube shadow1D shadow2D";

/// The function of that name in any version.
pub(super) fn function(name: &str) -> Option<Function> {
    if FUNCTIONS.split(' ').any(|f| f == name) {
        return Some(Function {
            name: name.to_owned(),
            compares_to_vector: false,
        });
    }
    let bare = name
        .trim_end_matches("EXT")
        .trim_end_matches("ARB")
        .trim_end_matches("OES");
    let prefix = OLD_PREFIXES.split(' ').find(|p| bare.starts_with(p))?;
    let suffix = &bare[prefix.len()..];
    let known = ["", "Lod", "Grad", "Proj", "ProjLod", "ProjGrad"].contains(&suffix);
    known.then(|| Function {
        name: format!("texture{suffix}"),
        // The `EXT` version of GLSL ES 1.00 returns a float.
        compares_to_vector: prefix.starts_with("shadow") && !name.ends_with("EXT"),
    })
}

/// Maximum elements of a sampler array that are selected by nested `?`. Older versions lack
/// `switch`, and their devices have no more textures.
const CHAIN: usize = 16;

/// Whether the function derives its level in the fragment stage.
fn is_implicit(name: &str) -> bool {
    let explicit = ["Size", "Lod", "Grad", "Query", "Samples", "Gather"];
    name.starts_with("texture") && !explicit.iter().any(|w| name.contains(w))
}

/// The shape of a texture.
struct TextureShape<'a> {
    combined: &'a str,
    component: Component,
    shadow: bool,
    layered: bool,
    /// Number of coordinates without the layer.
    coordinates: u8,
}

impl<'a> TextureShape<'a> {
    fn of(combined: &'a str) -> Self {
        Self {
            combined,
            component: match combined.chars().next() {
                Some('i') => Component::Int,
                Some('u') => Component::Uint,
                _ => Component::Float,
            },
            shadow: combined.ends_with("Shadow"),
            layered: combined.contains("Array"),
            coordinates: match combined {
                c if c.contains("1D") => 1,
                c if c.contains("2D") => 2,
                _ => 3,
            },
        }
    }

    /// The result type of a texture function.
    fn result(&self, function: &str) -> Ty {
        match function {
            "textureSize" => {
                let size = if self.combined.contains("Cube") {
                    2
                } else {
                    self.coordinates
                };
                Ty::vector(Component::Int, size + u8::from(self.layered))
            }
            "textureQueryLevels" | "textureSamples" => Ty::INT,
            name if name.starts_with("textureGather") => Ty::Vector(self.component, 4),
            _ if self.shadow => Ty::FLOAT,
            _ => Ty::Vector(self.component, 4),
        }
    }

    /// Adds 0.5 to the layer: GLSL rounds it to the nearest (4.60, 8.9), naga truncates it.
    fn round_layer(&self, coordinates: &mut Ex) {
        let Ty::Vector(Component::Float, n) = coordinates.ty else {
            return;
        };
        if self.layered && self.coordinates < n {
            let parts: Vec<&str> = (0..n)
                .map(|i| if i == self.coordinates { "0.5" } else { "0.0" })
                .collect();
            let text = format!("{} + vec{n}({})", coordinates.at(12), parts.join(", "));
            *coordinates = Ex::new(text, coordinates.ty.clone(), 12);
        }
    }
}

impl Lower<'_, '_> {
    /// A call of a texture function with the arguments `rest` after the sampler.
    pub(super) fn sample(
        &mut self,
        author: &str,
        function: &Function,
        sampler: Ex,
        rest: Vec<Ex>,
        arguments: &[Expr],
        whole: &Expr,
    ) -> Result<Ex, Error> {
        let place = self.place(whole.span);
        // An opaque type is a separate texture, for a fetch or its size.
        let (Ty::Combined(combined) | Ty::Opaque(combined)) = &sampler.ty else {
            let message = format!("`{author}` takes a sampler, not a {}", sampler.ty.name());
            return Err(unsupported(message, place));
        };
        let mut name = function.name.clone();
        unsupported::refuse(author, place)?;
        let shape = TextureShape::of(combined);
        let result = shape.result(&name);
        let fetches = matches!(
            name.as_str(),
            "texelFetch" | "texelFetchOffset" | "textureSize" | "textureQueryLevels"
        );
        let mut rest: Vec<Ex> = rest
            .into_iter()
            .map(|v| match v.ty {
                Ty::Scalar(Component::Int | Component::Uint) if !fetches => {
                    self.coerce_kind(v, Some(Component::Float))
                }
                _ if v.ty.kind() == Some(Component::Half) => {
                    self.coerce_kind(v, Some(Component::Float))
                }
                _ if fetches && v.ty.kind() == Some(Component::Uint) => {
                    self.coerce_kind(v, Some(Component::Int))
                }
                _ => v,
            })
            .collect();
        if !fetches && let Some(coordinates) = rest.first_mut() {
            shape.round_layer(coordinates);
        }
        if name.starts_with("textureGather") {
            return self.gathered(author, &shape, &sampler, rest, arguments, place);
        }
        if !fetches && shape.component != Component::Float {
            return Err(unsupported(
                format!(
                    "`{author}` of `{combined}` is not supported: WebGPU's samplers read no integers"
                ),
                place,
            )
            .note("read a texel by `texelFetch`, with integer coordinates within `textureSize`"));
        }
        if name.ends_with("Offset") && name.starts_with("texture") {
            self.name_offsets(&mut rest, arguments);
        }
        if name == "texelFetchOffset" && rest.len() == 3 {
            add_fetch_offset(&mut rest);
            name = "texelFetch".to_owned();
        }
        let mut first = Vec::new();
        let projects = matches!(
            name.as_str(),
            "textureProj" | "textureProjLod" | "textureProjGrad" | "textureProjOffset"
        );
        if shape.shadow && projects {
            first.extend(self.project(&mut rest, &mut name));
        }
        if self.is_vertex() {
            use_base_level(&shape, &mut name, &mut rest);
        }
        let (before, mut ex) = self.select_sampler(&name, &sampler, &rest, result, place)?;
        first.splice(0..0, before);
        if function.compares_to_vector {
            let ty = Ty::Vector(Component::Float, 4);
            ex = Ex::primary(format!("vec4({})", ex.text), ty);
        }
        Ok(after(first, ex))
    }

    /// Makes literal offsets named constants, as naga's GLSL writer requires.
    fn name_offsets(&mut self, rest: &mut [Ex], arguments: &[Expr]) {
        for (offset, argument) in rest.iter_mut().zip(arguments.iter().skip(1)).skip(1) {
            let known = self.stage.fixed(argument).and_then(constant::integers);
            let (Ty::Vector(Component::Int, n), Some(parts)) = (&offset.ty, known) else {
                continue;
            };
            let parts: Vec<String> = parts.iter().map(i32::to_string).collect();
            let bare = format!("ivec{n}({})", parts.join(", "));
            let known = self.offsets.iter().position(|o| *o == bare);
            let at = known.unwrap_or_else(|| {
                self.offsets.push(bare.clone());
                self.offsets.len() - 1
            });
            let name = self.helper_name(&format!("offset_{at}"));
            let text = format!("const ivec{n} {name} = {bare};\n");
            self.helpers.insert(name.clone(), text);
            *offset = Ex::primary(name, offset.ty.clone());
        }
    }

    /// Divides three coordinates by the fourth, because naga does not project comparisons.
    fn project(&mut self, rest: &mut [Ex], name: &mut String) -> Option<String> {
        let coordinates = rest.first_mut()?;
        let (before, held) = self.once(coordinates);
        let text = held.at(level::POSTFIX);
        let ty = Ty::Vector(Component::Float, 3);
        *coordinates = Ex::new(format!("{text}.xyz / {text}.w"), ty, 14);
        *name = name.replacen("Proj", "", 1);
        before
    }

    /// Prints the call, for a dynamically indexed sampler array once for each element. Also returns
    /// the statement that evaluates the index.
    fn select_sampler(
        &mut self,
        name: &str,
        sampler: &Ex,
        rest: &[Ex],
        result: Ty,
        place: Option<Span>,
    ) -> Result<(Option<String>, Ex), Error> {
        let call = |sampler: &str| {
            let rest = rest.iter().map(|r| r.at(level::ASSIGNMENT));
            let all: Vec<String> = iter::once(sampler.to_owned()).chain(rest).collect();
            format!("{name}({})", all.join(", "))
        };
        let Some((index, pairs)) = &sampler.choice else {
            return Ok((None, Ex::primary(call(&sampler.text), result)));
        };
        let Some(first) = pairs.first() else {
            return Err(unsupported(
                "an array of samplers without a length is not supported",
                place,
            )
            .note(
                "give it a length, or compile both files with `glslangValidator -V` and give \
                     the .spv files",
            ));
        };
        let combined = first.combined.as_str();
        let gradients = self.stage.unit.is_nonuniform && is_implicit(name) && !self.is_vertex();
        let has_gradients =
            matches!(name, "texture" | "textureOffset") && !combined.ends_with("Shadow");
        let is_large = pairs.len() > CHAIN;
        if (gradients && has_gradients || !gradients && is_large && self.has_switch())
            && let Some(ex) = self.switched(name, index, pairs, rest, &result, gradients)
        {
            return Ok((None, ex));
        }
        if gradients {
            return Err(unsupported(
                format!(
                    "`{name}` of a {combined} that `nonuniformEXT` selects is not supported: the \
                     invocations would derive its level apart"
                ),
                place,
            )
            .note("use `textureLod` or `textureGrad`"));
        }
        // GLSL requires a dynamically uniform index, so this control flow is uniform.
        let (before, index) = self.once(index);
        let bare = unmarked(&index.text);
        if before.is_none() && (bare.contains(['(', '=']) || bare.contains("++")) {
            return Err(unsupported(
                "a call that selects a sampler must be in a function",
                place,
            ));
        }
        let calls = pairs.iter().map(|pair| {
            call(&format!(
                "{}({}, {})",
                pair.combined, pair.texture, pair.sampler
            ))
        });
        let calls: Vec<String> = calls.collect();
        let index = &index.text;
        let text = match calls.split_last() {
            None => String::new(),
            Some(_) if is_large => halved(index, 0, &calls),
            Some((last, others)) => {
                let others = others.iter().enumerate();
                let chain = others.map(|(i, call)| format!("({index}) == {i} ? {call} : "));
                chain.collect::<String>() + last
            }
        };
        Ok((before, Ex::new(text, result, level::TERNARY)))
    }

    fn has_switch(&self) -> bool {
        let Dialect { version, es } = self.stage.unit.dialect;
        version >= if es { 300 } else { 130 }
    }

    /// A call of a helper function that selects the sampler by a `switch`. With `gradients` the
    /// derivatives are taken before it. `None` if the samplers are parameters, or a type is
    /// unknown.
    fn switched(
        &mut self,
        name: &str,
        index: &Ex,
        pairs: &[SplitSampler],
        rest: &[Ex],
        result: &Ty,
        gradients: bool,
    ) -> Option<Ex> {
        let first = pairs.first()?;
        let shape = TextureShape::of(&first.combined);
        let is_global =
            |pair: &SplitSampler| self.interface.samplers.values().any(|b| b.pair == *pair);
        if !is_global(first) || rest.iter().any(|r| r.ty == Ty::Unknown) {
            return None;
        }
        // Offsets must stay constants.
        let is_offset = |r: &Ex| self.helpers.contains_key(&r.text);
        let mut parameters = vec!["int which".to_owned()];
        let mut given = vec![format!("int({})", index.text)];
        let mut inner = Vec::new();
        for (i, r) in rest.iter().enumerate() {
            match is_offset(r) {
                true => inner.push(r.text.clone()),
                false => {
                    inner.push(format!("a{i}"));
                    parameters.push(r.ty.declare(&format!("a{i}")));
                    given.push(r.at(level::ASSIGNMENT));
                }
            }
        }
        let array = first.texture.trim_end_matches("_0");
        let type_of = |r: &Ex| match is_offset(r) {
            true => r.text.clone(),
            false => r.ty.base_name(),
        };
        let types: Vec<String> = rest.iter().map(type_of).collect();
        let wanted = format!("{name}_{array}_{}", types.join("_"));
        let helper = self.helper_name(&wanted);
        let mut head = String::new();
        let mut function = name.to_owned();
        if gradients {
            let coordinates = Ty::vector(Component::Float, shape.coordinates);
            let swizzle = &"xyz"[..usize::from(shape.coordinates)];
            let of = match rest.first()?.ty == coordinates {
                true => "a0".to_owned(),
                false => format!("a0.{swizzle}"),
            };
            let has_offset = usize::from(name.ends_with("Offset"));
            // A bias multiplies the gradients (GLSL 4.60, 8.9).
            let bias = match rest.len() > 1 + has_offset {
                true => format!(" * exp2(a{})", rest.len() - 1),
                false => String::new(),
            };
            inner.truncate(1 + has_offset);
            for (at, axis) in ["dx", "dy"].into_iter().enumerate() {
                let derivative = if at == 0 { "dFdx" } else { "dFdy" };
                let declared = coordinates.declare(axis);
                head += &format!("    {declared} = {derivative}({of}){bias};\n");
                inner.insert(1 + at, axis.to_owned());
            }
            function = name.replacen("texture", "textureGrad", 1);
        }
        let mut body = String::new();
        for (i, pair) in pairs.iter().enumerate() {
            let case = match i + 1 == pairs.len() {
                true => "default".to_owned(),
                false => format!("case {i}"),
            };
            let SplitSampler {
                combined,
                texture,
                sampler,
            } = pair;
            let inner = inner.join(", ");
            body += &format!(
                "        {case}: chosen = {function}({combined}({texture}, {sampler}), {inner}); break;\n"
            );
        }
        let text = format!(
            "{} {helper}({}) {{\n{head}    {};\n    switch (which) {{\n{body}    }}\n    return chosen;\n}}\n",
            result.name(),
            parameters.join(", "),
            result.declare("chosen"),
        );
        self.helpers.insert(helper.clone(), text);
        Some(Ex::primary(
            format!("{helper}({})", given.join(", ")),
            result.clone(),
        ))
    }

    /// `textureGather` and `textureGatherOffset`, which naga's front end lacks: calls a placeholder
    /// function whose body is replaced later.
    fn gathered(
        &mut self,
        author: &str,
        shape: &TextureShape<'_>,
        sampler: &Ex,
        rest: Vec<Ex>,
        arguments: &[Expr],
        place: Option<Span>,
    ) -> Result<Ex, Error> {
        let Some(pair) = &sampler.pair else {
            return Err(unsupported(
                format!("`{author}` needs a named sampler"),
                place,
            ));
        };
        let has_offset = author == "textureGatherOffset";
        let n = shape.coordinates;
        if rest.len() > 2 + usize::from(has_offset) || shape.layered || has_offset && n == 3 {
            return Err(unsupported(
                format!("`{author}` of `{}` is not supported", shape.combined),
                place,
            )
            .note("use textures without layers, or fetch the four texels"));
        }
        let taken = if shape.shadow { 2 } else { 1 };
        let mut others = arguments.iter().skip(1 + taken);
        let offset = match has_offset {
            true => {
                let known = others.next().and_then(|e| self.stage.fixed(e));
                let known = known.and_then(constant::integers);
                let known = known.and_then(|parts| <[i32; 2]>::try_from(parts).ok());
                // WGSL has no others.
                let known = known.filter(|parts| parts.iter().all(|part| (-8..8).contains(part)));
                Some(known.ok_or_else(|| {
                    unsupported(
                        format!("`{author}`'s offset must be constant, from -8 to 7"),
                        place,
                    )
                    .note("fetch the four texels")
                })?)
            }
            false => None,
        };
        let component = match others.next() {
            Some(e) => self.stage.fixed_integer(e),
            None => Some(0),
        };
        let component = component
            .and_then(|n| u32::try_from(n).ok())
            .ok_or_else(|| {
                unsupported(format!("`{author}`'s component must be a number"), place)
            })?;
        let combined = shape.combined;
        let by = offset.map(|[x, y]| format!("_by_{x}_{y}").replace('-', "m"));
        let by = by.unwrap_or_default();
        let helper = self.helper_name(&format!("gather_{combined}_{component}{by}"));
        self.placeholders
            .insert(helper.clone(), Placeholder::Gather { component, offset });
        let [texture, of] = split_type(combined);
        let extra = if shape.shadow { ", float depth" } else { "" };
        let body = match (shape.shadow, n) {
            (false, _) => format!("textureLod({combined}(t, s), p, 0.0)"),
            (true, 3) => format!("vec4(texture({combined}(t, s), vec4(p, depth)))"),
            (true, _) => format!("vec4(textureLod({combined}(t, s), vec3(p, depth), 0.0))"),
        };
        let result = Ty::Vector(shape.component, 4);
        let text = format!(
            "{} {helper}({texture} t, {of} s, {} p{extra}) {{\n    return {body};\n}}\n",
            result.name(),
            Ty::vector(Component::Float, n).name()
        );
        self.helpers.insert(helper.clone(), text);
        let mut all = vec![pair.texture.clone(), pair.sampler.clone()];
        all.extend(rest.iter().take(taken).map(|r| r.at(level::ASSIGNMENT)));
        Ok(Ex::primary(format!("{helper}({})", all.join(", ")), result))
    }
}

/// Selects one of `calls`, the first of which has the index `first`, by nested halves.
fn halved(index: &str, first: usize, calls: &[String]) -> String {
    if let [call] = calls {
        return call.clone();
    }
    let (low, high) = calls.split_at(calls.len() / 2);
    let middle = first + low.len();
    let (low, high) = (halved(index, first, low), halved(index, middle, high));
    format!("({index}) < {middle} ? ({low}) : ({high})")
}

/// Adds the offset of a `texelFetchOffset` to its coordinates, because naga loses it.
fn add_fetch_offset(rest: &mut Vec<Ex>) {
    let [p, _, offset] = &rest[..] else {
        return;
    };
    let offset = match (&p.ty, &offset.ty) {
        (Ty::Vector(_, n), Ty::Vector(_, m)) if n > m => format!("ivec{n}({}, 0)", offset.text),
        _ => offset.at(13),
    };
    rest[0] = Ex::new(format!("{} + {offset}", p.at(12)), p.ty.clone(), 12);
    rest.truncate(2);
}

/// Without derivatives, GLSL samples the base level, and the bias becomes the level (4.60, 8.9).
fn use_base_level(shape: &TextureShape<'_>, name: &mut String, rest: &mut Vec<Ex>) {
    if !is_implicit(name) || shape.combined.starts_with("samplerCube") && shape.shadow {
        return;
    }
    let coordinates = usize::from(name.ends_with("Offset")) + 1;
    if rest.len() == coordinates {
        rest.insert(1, Ex::primary("0.0", Ty::FLOAT));
    } else if coordinates == 2 {
        rest.swap(1, 2);
    }
    *name = match name.strip_suffix("Offset") {
        Some(start) => format!("{start}LodOffset"),
        None => format!("{name}Lod"),
    };
}
