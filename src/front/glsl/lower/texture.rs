//! Texture functions of all GLSL versions.

use glsl_lang::ast::Expr;

use super::super::constant;
use super::super::interface::SplitSampler;
use super::super::source_marks::unmarked;
use super::super::stage::unsupported;
use super::super::ty::{Component, Ty};
use super::Lower;
use super::effect::after;
use super::expression::{Ex, level};
use crate::front::error::Error;

/// A texture function.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Function {
    /// Its name in GLSL 4.50.
    pub name: String,
    /// A comparison that returns a vector: `shadow2D`.
    pub compares_to_vector: bool,
}

/// The function of that name in any version.
pub(super) fn function(name: &str) -> Option<Function> {
    let is = |name: &str| Function {
        name: name.to_owned(),
        compares_to_vector: false,
    };
    let modern = [
        "texture",
        "textureLod",
        "textureGrad",
        "textureOffset",
        "textureLodOffset",
        "textureGradOffset",
        "textureProj",
        "textureProjLod",
        "textureProjGrad",
        "textureProjOffset",
        "textureProjLodOffset",
        "textureProjGradOffset",
        "texelFetch",
        "texelFetchOffset",
        "textureSize",
        "textureQueryLevels",
        "textureQueryLod",
        "textureGather",
        "textureGatherOffset",
        "textureGatherOffsets",
        "textureSamples",
    ];
    if modern.contains(&name) {
        return Some(is(name));
    }
    let bare = name
        .trim_end_matches("EXT")
        .trim_end_matches("ARB")
        .trim_end_matches("OES");
    let shapes = [
        "texture2DRect",
        "texture1D",
        "texture2D",
        "texture3D",
        "textureCube",
        "shadow1D",
        "shadow2D",
    ];
    let shape = shapes.iter().find(|s| bare.starts_with(**s))?;
    let what = match &bare[shape.len()..] {
        "" => "texture",
        "Lod" => "textureLod",
        "Grad" => "textureGrad",
        "Proj" => "textureProj",
        "ProjLod" => "textureProjLod",
        "ProjGrad" => "textureProjGrad",
        _ => return None,
    };
    Some(Function {
        name: what.to_owned(),
        // The `EXT` version of GLSL ES 1.00 returns a float.
        compares_to_vector: shape.starts_with("shadow") && !name.ends_with("EXT"),
    })
}

/// Number of coordinates without the layer.
fn coordinates(combined: &str) -> u8 {
    match combined {
        c if c.contains("1D") => 1,
        c if c.contains("2D") => 2,
        _ => 3,
    }
}

impl Lower<'_, '_> {
    pub(super) fn sample(
        &mut self,
        author: &str,
        function: &Function,
        sampler: Ex,
        mut rest: Vec<Ex>,
        arguments: &[Expr],
        whole: &Expr,
    ) -> Result<Ex, Error> {
        let place = self.place(whole.span);
        let combined = match &sampler.ty {
            Ty::Combined(name) => name.clone(),
            // A separate texture, for a fetch or its size.
            Ty::Opaque(name) => name.clone(),
            other => {
                return Err(unsupported(
                    format!("`{author}` takes a sampler, not a {}", other.name()),
                    place,
                ));
            }
        };
        let kind = match combined.chars().next() {
            Some('i') => Component::Int,
            Some('u') => Component::Uint,
            _ => Component::Float,
        };
        let shadow = combined.ends_with("Shadow");
        let texel = match shadow {
            true => Ty::FLOAT,
            false => Ty::Vector(kind, 4),
        };
        let layers = u8::from(combined.contains("Array"));
        let mut result = match function.name.as_str() {
            "textureSize" => Ty::vector(
                Component::Int,
                if combined.contains("Cube") {
                    2
                } else {
                    coordinates(&combined)
                } + layers,
            ),
            "textureQueryLevels" | "textureSamples" => Ty::INT,
            name if name.starts_with("textureGather") => Ty::Vector(kind, 4),
            _ => texel,
        };
        let fetches = matches!(
            function.name.as_str(),
            "texelFetch" | "texelFetchOffset" | "textureSize" | "textureQueryLevels"
        );
        rest = rest
            .into_iter()
            .map(|v| match v.ty.kind() {
                Some(Component::Int | Component::Uint)
                    if !fetches && v.ty.components() == Some(1) =>
                {
                    self.coerce_kind(v, Some(Component::Float))
                }
                Some(Component::Uint) if fetches => self.coerce_kind(v, Some(Component::Int)),
                _ => v,
            })
            .collect();
        let mut name = function.name.clone();
        let mut first = Vec::new();
        // GLSL rounds a layer to the nearest (4.60, 8.9), naga truncates it.
        if layers == 1
            && !fetches
            && let Some(p) = rest.first_mut()
            && let Ty::Vector(Component::Float, n) = p.ty
        {
            let layer = usize::from(coordinates(&combined));
            let parts: Vec<&str> = (0..usize::from(n))
                .map(|i| if i == layer { "0.5" } else { "0.0" })
                .collect();
            if layer < parts.len() {
                let text = format!("{} + vec{n}({})", p.at(12), parts.join(", "));
                *p = Ex::new(text, p.ty.clone(), 12);
            }
        }
        // naga's GLSL writer requires named literals.
        if name.ends_with("Offset") && name.starts_with("texture") {
            let constants = &self.stage.constants;
            let known: Vec<_> = arguments
                .iter()
                .skip(1)
                .map(|e| constant::integers(e, constants))
                .collect();
            for (offset, known) in rest.iter_mut().zip(known).skip(1) {
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
        // naga loses the offset.
        if name == "texelFetchOffset"
            && let [p, _, offset] = &rest[..]
        {
            let offset = match (&p.ty, &offset.ty) {
                (Ty::Vector(_, n), Ty::Vector(_, m)) if n > m => {
                    format!("ivec{n}({}, 0)", offset.text)
                }
                _ => offset.at(13),
            };
            rest[0] = Ex::new(format!("{} + {offset}", p.at(12)), p.ty.clone(), 12);
            rest.truncate(2);
            name = "texelFetch".to_owned();
        }
        match name.as_str() {
            "textureQueryLod" => {
                return Err(unsupported(
                    format!("`{author}` is not supported: WebGPU has no such query"),
                    place,
                )
                .note("compute the level from the coordinates' derivatives"));
            }
            "textureGatherOffsets" => {
                return Err(unsupported(
                    "`textureGatherOffsets` is not supported: WebGPU only gathers a square",
                    place,
                ));
            }
            "textureGatherOffset" => {
                return Err(unsupported(
                    "`textureGatherOffset` is not supported: use `textureGather`, on textures without layers",
                    place,
                ));
            }
            "textureGather" => {
                let component = match arguments.get(2) {
                    Some(e) if !shadow => constant::evaluate(e, &self.stage.constants),
                    _ => Some(0),
                };
                return self.gathered(&combined, &sampler, rest, component, result, place);
            }
            "textureProj" | "textureProjLod" | "textureProjGrad" | "textureProjOffset"
                if shadow =>
            {
                // naga does not project comparisons. Divide three coordinates by the fourth.
                if let Some(p) = rest.first_mut() {
                    let (before, held) = self.once(p);
                    first.extend(before);
                    *p = held;
                    let text = p.at(level::POSTFIX);
                    *p = Ex::new(
                        format!("{text}.xyz / {text}.w"),
                        Ty::Vector(Component::Float, 3),
                        14,
                    );
                    name = name.replacen("Proj", "", 1);
                }
            }
            _ => {}
        }
        // Without derivatives, GLSL samples the base level, and the bias becomes the level (4.60,
        // 8.9).
        let implicit = name.starts_with("texture")
            && !["Size", "Lod", "Grad", "Query", "Samples"]
                .iter()
                .any(|w| name.contains(w));
        let cube_shadow = combined.starts_with("samplerCube") && shadow;
        if self.is_vertex() && implicit && !cube_shadow {
            let coordinates = usize::from(name.ends_with("Offset")) + 1;
            if rest.len() == coordinates {
                rest.insert(1, Ex::primary("0.0", Ty::FLOAT));
            } else if coordinates == 2 {
                rest.swap(1, 2);
            }
            name = match name.strip_suffix("Offset") {
                Some(start) => format!("{start}LodOffset"),
                None => format!("{name}Lod"),
            };
        }
        let call = |pair: Option<&SplitSampler>| {
            let first = match pair {
                Some(pair) => format!("{}({}, {})", pair.combined, pair.texture, pair.sampler),
                None => sampler.text.clone(),
            };
            let mut all = vec![first];
            all.extend(rest.iter().map(|r| r.at(level::ASSIGNMENT)));
            format!("{name}({})", all.join(", "))
        };
        let mut ex = match &sampler.choice {
            None => Ex::primary(call(None), result.clone()),
            Some((index, pairs)) => {
                // GLSL requires a dynamically uniform index, so this control flow is uniform.
                let (before, index) = self.once(index);
                let bare = unmarked(&index.text);
                if before.is_none() && (bare.contains(['(', '=']) || bare.contains("++")) {
                    return Err(unsupported(
                        "a call that selects a sampler must be in a function",
                        place,
                    ));
                }
                first.splice(0..0, before);
                let index = &index.text;
                let Some((last, others)) = pairs.split_last() else {
                    return Err(unsupported("this array of samplers is empty", place));
                };
                let mut text = String::new();
                for (i, pair) in others.iter().enumerate() {
                    text += &format!("({index}) == {i} ? {} : ", call(Some(pair)));
                }
                text += &call(Some(last));
                Ex::new(text, result.clone(), level::TERNARY)
            }
        };
        if function.compares_to_vector {
            result = Ty::Vector(Component::Float, 4);
            ex = Ex::primary(format!("vec4({})", ex.text), result);
        }
        Ok(after(first, ex))
    }

    /// `textureGather`, which naga's front end lacks: calls a placeholder function whose body is
    /// replaced later.
    fn gathered(
        &mut self,
        combined: &str,
        sampler: &Ex,
        rest: Vec<Ex>,
        component: Option<i64>,
        result: Ty,
        place: Option<naga::Span>,
    ) -> Result<Ex, Error> {
        let Some(pair) = &sampler.pair else {
            return Err(unsupported("`textureGather` needs a named sampler", place));
        };
        let shadow = combined.ends_with("Shadow");
        if rest.len() > 2 || combined.contains("Array") {
            return Err(unsupported(
                "`textureGather` is only supported for textures without layers, without an offset",
                place,
            ));
        }
        let component = component
            .and_then(|n| u32::try_from(n).ok())
            .ok_or_else(|| unsupported("`textureGather`'s component must be a number", place))?;
        let helper = self.helper_name(&format!("gather_{combined}_{component}"));
        self.gathers.insert(helper.clone(), component);
        let texture = combined.replacen("sampler", "texture", 1);
        let texture = texture.trim_end_matches("Shadow");
        let n = coordinates(combined);
        let (of, extra, body) = match shadow {
            false => (
                "sampler",
                "",
                format!("textureLod({combined}(t, s), p, 0.0)"),
            ),
            true => {
                let p = if n == 3 {
                    "vec4(p, depth)"
                } else {
                    "vec3(p, depth)"
                };
                let call = if n == 3 {
                    format!("texture({combined}(t, s), {p})")
                } else {
                    format!("textureLod({combined}(t, s), {p}, 0.0)")
                };
                ("samplerShadow", ", float depth", format!("vec4({call})"))
            }
        };
        let text = format!(
            "{} {helper}({texture} t, {of} s, {} p{extra}) {{\n    return {body};\n}}\n",
            result.name(),
            Ty::vector(Component::Float, n).name()
        );
        self.helpers.insert(helper.clone(), text);
        let mut all = vec![pair.texture.clone(), pair.sampler.clone()];
        let taken = if shadow { 2 } else { 1 };
        all.extend(rest.iter().take(taken).map(|r| r.at(level::ASSIGNMENT)));
        Ok(Ex::primary(format!("{helper}({})", all.join(", ")), result))
    }
}
