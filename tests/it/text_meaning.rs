//! Every written text means what its program means, in each language.

use std::collections::BTreeMap;

use preshade_compiler::emit::{self, EmitError, Meaning};
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use preshade_validate::Effort;
use rayon::prelude::*;
use shader_text::files::File;
use shader_text::options::Options;

use crate::agree::{fixtures, read};
use crate::fixtures_support::root;

const GLSL: [Target; 3] = [Target::Glsl450, Target::GlslVulkan, Target::GlslEs300];

/// Compares on more inputs than `rewrite` does, and texts of any length.
const THOROUGH: Meaning = Meaning {
    effort: Effort {
        inputs: 24,
        seed: 0,
        steps: 20_000,
        paths: 16,
    },
    most_bytes: usize::MAX,
};

/// The files, and a sentence on each that was not compared.
fn emitted(plan: &Plan, target: Target) -> Result<(Vec<File>, Vec<String>), EmitError> {
    emit::emit_compared(plan, &[target], &emit::Options::default(), THOROUGH)
}

/// What is not compared is told, and the bytes are those of a host that compares nothing.
#[test]
fn a_text_that_is_not_compared_is_told_and_changes_no_byte() {
    let plan = material("", "return vec4(v.uv, u.f, 1.0);");
    let options = emit::Options::default();
    let short = Meaning {
        most_bytes: 100,
        ..THOROUGH
    };
    let of = |meaning| emit::emit_compared(&plan, &[Target::Glsl450], &options, meaning).unwrap();
    let (files, uncompared) = of(short);
    let told: Vec<bool> = uncompared
        .iter()
        .map(|what| what.contains("m.main.frag") && what.contains("over the 100 to compare"))
        .collect();
    assert_eq!(told, [true], "{uncompared:?}");
    assert_eq!(of(THOROUGH), (files.clone(), Vec::new()));
    assert_eq!(
        emit::emit(&plan, &[Target::Glsl450], &options).unwrap(),
        files
    );
}

/// A WGSL material whose fragment stage has this body, with declarations ahead of it.
fn material(declarations: &str, body: &str) -> Plan {
    let text = format!(
        "struct U {{ mvp: mat4x4<f32>, k: i32, l: i32, n: u32, m: u32, k2: vec2<i32>, l2: vec2<i32>, f: f32 }}
         @group(0) @binding(0) var<uniform> u: U;
         struct V {{ @builtin(position) position: vec4<f32>, @location(0) uv: vec2<f32> }}
         @vertex fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> V {{
             return V(u.mvp * vec4(position, 1.0), uv);
         }}
         {declarations}
         @fragment fn fs(v: V) -> @location(0) vec4<f32> {{ {body} }}"
    );
    let parsed = front::parse(&[Source::new("m.wgsl", text)], &Options::default());
    let parsed = parsed.unwrap_or_else(|e| panic!("{body}: {e}"));
    parsed.plan("m", &MaterialState::default())
}

/// The fragment stage in GLSL, compared with its program.
fn fragment(plan: &Plan, target: Target) -> Result<String, EmitError> {
    let (files, uncompared) = emitted(plan, target)?;
    assert_eq!(uncompared, [""; 0], "{target}");
    let file = files.into_iter().find(|f| f.name.ends_with(".frag"));
    Ok(String::from_utf8(file.unwrap().bytes).unwrap())
}

#[test]
fn cases_of_texts_that_meant_something_else_are_mended() {
    let cases = root().join("fixtures/cases");
    for (name, has, lacks) in [
        ("glsl-out-break-if-let.wgsl", &["kept = ("][..], &[][..]),
        (
            "glsl-out-continuing-swap.wgsl",
            &["old = kept"],
            &["(a * 0.5)"],
        ),
        (
            "glsl-out-divide-by-zero.wgsl",
            &["max(y, 1u)"],
            &["% y", "/ y"],
        ),
        (
            "glsl-out-float-to-int-saturates.wgsl",
            &["uint(clamp(", "int(clamp("],
            &[],
        ),
        ("glsl-out-pack-and.wgsl", &["(word & 255u)"], &[]),
        ("glsl-out-remainder-of-negative.wgsl", &["/ 3) * 3"], &["%"]),
        ("glsl-out-atomic-sub-negative.wgsl", &["(0 - -1)"], &["--"]),
        (
            "glsl-out-member-named-like-struct.wgsl",
            &["own_Light"],
            &[],
        ),
    ] {
        let plan = read(&[cases.join(name)]).unwrap();
        for target in GLSL {
            let text = match (name, target) {
                // Neither ES has storage buffers, nor our reader atomics.
                ("glsl-out-atomic-sub-negative.wgsl", Target::GlslEs300) => continue,
                ("glsl-out-atomic-sub-negative.wgsl", _) => {
                    let (files, _) = emitted(&plan, target).unwrap();
                    let file = files.into_iter().find(|f| f.name.ends_with(".frag"));
                    String::from_utf8(file.unwrap().bytes).unwrap()
                }
                _ => fragment(&plan, target).unwrap(),
            };
            for part in has {
                assert!(text.contains(part), "{name} lacks {part}:\n{text}");
            }
            for part in lacks {
                assert!(!text.contains(part), "{name} has {part}:\n{text}");
            }
        }
    }
}

/// What `continuing` and `break if` read of the body, whatever it is and however deep.
#[test]
fn continuing_reads_the_values_of_the_body() {
    for (declarations, body) in [
        // Values of values.
        (
            "",
            "loop { let x = a + b; let y = x * a; a += 0.3; i += 1; continuing { b = y - x; \
             break if y > 2.0 || i > 4; } }",
        ),
        // Vectors, matrices and arrays.
        (
            "",
            "var w = v.uv; loop { let p = w; w += vec2(0.2); i += 1; continuing { w = p.yx \
             * 0.9; break if i > 3; } } a = w.x; b = w.y;",
        ),
        (
            "",
            "var w = mat2x2(v.uv, v.uv.yx); loop { let p = w; w = w * 0.5; i += 1; \
             continuing { w = transpose(p); break if i > 2; } } a = w[0].x; b = w[1].x;",
        ),
        (
            "",
            "var w = array(a, b, 0.3); loop { let p = w; w[1] = a; a += 0.1; i += 1; \
             continuing { w[0] = p[1]; w[2] = p[0]; break if i > 3; } } a = w[0]; b = w[2];",
        ),
        (
            "struct P { x: f32, y: f32 }",
            "var w = P(a, b); loop { let p = w; w.x = w.y + 0.1; i += 1; continuing { w.y = \
             p.x; break if i > 3; } } a = w.x; b = w.y;",
        ),
        // A pointer to an element whose index changes.
        (
            "",
            "var w = array(0.1, 0.2, 0.3, 0.4); loop { let p = &w[i]; i += 1; continuing { \
             *p = a; a += 0.1; break if i > 2; } } a = w[0]; b = w[1] + w[2];",
        ),
        // The result of a call.
        (
            "fn half(x: f32) -> f32 { if x > 0.7 { return x; } return x * 0.5; }",
            "loop { let h = half(a); a += 0.4; i += 1; continuing { b += h; break if i > 3; \
             } }",
        ),
        // A loop in the body, and in `continuing`.
        (
            "",
            "loop { let x = a; var j = 0; loop { let y = a; a += 0.1; j += 1; continuing { \
             b = y + x; break if j > 2; } } i += 1; continuing { a = x * 0.9; break if i > \
             2; } }",
        ),
        (
            "",
            "loop { let x = a; a += 0.2; i += 1; continuing { for (var j = 0; j < 3; j++) { \
             b += x * 0.1; } break if i > 2; } }",
        ),
        // `continue` out of a switch that naga writes as a loop.
        (
            "",
            "loop { let x = a; a = a * 0.8 + 0.1; i += 1; switch i { default: { if a > 0.5 \
             { continue; } b += 0.01; } } b += 0.1; continuing { b = b * 0.5 + x; break if \
             i > 3; } }",
        ),
        // A boolean, a comparison and a discard.
        (
            "",
            "loop { let big = a > 0.4; let next = select(b, a, big); a = b; i += 1; \
             continuing { b = next * 0.9; break if (big && i > 2) || i > 5; } }",
        ),
        // Rotation by phis, as an optimiser writes it.
        (
            "",
            "var d = 0.3; loop { if i >= 4 { break; } let x = a; let y = b; let z = d; i += \
             1; continuing { a = y + 0.01; b = z; d = x * 0.9; } } b += d;",
        ),
    ] {
        let body = format!(
            "var a = v.uv.x; var b = v.uv.y; var i = 0; {body}
             if a + b > 1.7 {{ discard; }} return vec4(a, b, 0.0, 1.0);"
        );
        let plan = material(declarations, &body);
        for target in GLSL {
            let text = fragment(&plan, target).unwrap_or_else(|e| panic!("{body}: {e}"));
            assert!(text.contains("kept"), "{body}:\n{text}");
        }
    }
}

/// WGSL's rules of integers where GLSL has none, and GLSL's plain operator where both agree.
#[test]
fn integers_keep_the_rules_of_wgsl() {
    let plain: &[&str] = &[];
    for (body, has, lacks) in [
        ("let r = u.k % 3;", &["/ 3) * 3"][..], &["%"][..]),
        ("var r = u.k; r %= 3;", &["/ 3) * 3"], &["%"]),
        ("let r = u.k % u.l;", &["== 0", "-2147483647"], &["%"]),
        ("let r = u.k / u.l;", &["== 0", "-2147483647"], &[]),
        ("let r = (u.k2 % u.l2).x;", &["equal(", "lessThan("], &["%"]),
        ("let r = (u.k2 / vec2(-1, 2)).x;", &["lessThan("], &["%"]),
        ("let r = u.n % u.m;", &["max("], &[]),
        ("let r = (vec2(u.n) / vec2(u.m, 3u)).y;", &["max("], &[]),
        ("let r = u.k << u.n;", &["& 31u"], &[]),
        (
            "let r = (vec2(u.n) >> vec2(u.m, 1u)).x;",
            &["& uvec2(31u)"],
            &[],
        ),
        ("let r = u32(u.f);", &["clamp("], &[]),
        ("let r = vec2<i32>(v.uv * u.f).x;", &["clamp("], &[]),
        ("let r = abs(u.n);", &[], &["abs("]),
        // Whatever is known of the operands.
        ("let r = u.k / 3;", &["/ 3)"], &["*", "=="]),
        ("let r = u.n % 7u;", &["% 7u)"], &["max("]),
        ("let r = clamp(u.k, 0, 9) % 4;", &["% 4)"], &["/ 4"]),
        ("let r = (u.k & 15) % 4;", &["% 4)"], &["/ 4"]),
        ("let r = u.n << 3u;", &["<< 3u)"], &["31u"]),
        ("let r = u.n >> (u.m & 7u);", plain, &["31u"]),
        (
            "let r = i32(fract(u.f) * 8.0);",
            plain,
            &["clamp(", "min(", "max("],
        ),
        (
            "let r = u32(saturate(u.f) * 255.0 + 0.5);",
            plain,
            &["clamp((", "min(", "max("],
        ),
        (
            "let r = u32(u.k & 255) / ((u.n & 3u) | 4u);",
            plain,
            &["max("],
        ),
        (
            "var r = 0; for (var i = 0; i < u.k; i++) { r += i % 3; }",
            &["% 3)"],
            &["/ 3"],
        ),
        (
            "var r = 0; for (var i = 2; i < 9; i++) { if i % 2 == 0 { continue; } r += i; }",
            &["% 2)"],
            &["/ 2"],
        ),
        // A counter that begins below 0, or does not only count.
        (
            "var r = 0; for (var i = -4; i < u.k; i++) { r += i % 3; }",
            &["/ 3) * 3"],
            &["%"],
        ),
        (
            "var r = 0; for (var i = 0; i < u.k; i++) { r += i % 3; i -= u.l; }",
            &["/ 3) * 3"],
            &["%"],
        ),
        (
            "var r = 0; for (var i = 0; i <= u.k; i++) { r += i % 3; if r > 9 { break; } }",
            &["/ 3) * 3"],
            &["%"],
        ),
    ] {
        let plan = material("", &format!("{body} return vec4(f32(r));"));
        for target in GLSL {
            let text = fragment(&plan, target).unwrap_or_else(|e| panic!("{body}: {e}"));
            let (_, text) = text.split_once("void main").unwrap();
            for part in has {
                assert!(text.contains(part), "{body} lacks {part}:\n{text}");
            }
            for part in lacks {
                assert!(!text.contains(part), "{body} has {part}:\n{text}");
            }
        }
    }
}

/// A GLSL author's `%` is GLSL's own.
#[test]
fn an_authors_glsl_keeps_its_operators() {
    let vertex = "#version 450\nlayout(location=0) in vec3 p; layout(location=0) out vec2 v;\n\
                  void main() { v = p.xy; gl_Position = vec4(p, 1.0); }";
    let fragment = "#version 450\nlayout(location=0) in vec2 v; layout(location=0) out vec4 o;\n\
                    void main() { int a = int(v.x); int b = int(v.y); o = vec4(a % b, a / b, a << b, 1); }";
    let sources = [
        Source::new("m.vert", vertex),
        Source::new("m.frag", fragment),
    ];
    let parsed = front::parse(&sources, &Options::default()).unwrap();
    let plan = parsed.plan("m", &MaterialState::default());
    for target in GLSL {
        let text = self::fragment(&plan, target).unwrap();
        for part in [" % ", " / ", " << "] {
            assert!(text.contains(part), "{text}");
        }
        assert!(!text.contains("clamp("), "{text}");
    }
}

/// Operators around what naga writes without parentheses.
#[test]
fn packed_words_are_operands() {
    for expression in [
        "pack4xU8(w) & 255u",
        "pack4xU8(w) * 3u",
        "pack4xU8Clamp(w) >> 8u",
        "7u - pack4xU8Clamp(w)",
        "~pack4xU8(w) ^ pack4xU8(w.wzyx)",
        "pack4xI8(vec4<i32>(w)) & 511u",
        "pack4xI8Clamp(vec4<i32>(w)) | 1u",
        "select(pack4xU8(w), 4u, u.n > 2u) & 15u",
        "dot4U8Packed(pack4xU8(w), 3u) + 1u",
        "countLeadingZeros(u.n) * 2u",
        "countLeadingZeros(pack4xU8(w)) & 6u",
        "u32(countLeadingZeros(u.k)) + u32(countLeadingZeros(u.k2).y)",
    ] {
        let body = format!(
            "let w = vec4<u32>(v.uv.xyxy * 400.0); let r = {expression}; return vec4(f32(r));"
        );
        let plan = material("", &body);
        for target in GLSL {
            // GLSL ES 3.00 has no bitfieldExtract.
            if !(expression.starts_with("dot4") && target == Target::GlslEs300) {
                fragment(&plan, target).unwrap_or_else(|e| panic!("{expression}: {e}"));
            }
        }
    }
}

/// The loops of WebGL 1's appendix A.
#[test]
fn webgl_1_has_the_loops_of_its_appendix() {
    let vertex = std::fs::read_to_string(root().join("fixtures/cases/plain.es100.vert")).unwrap();
    let written = |fragment: &str| {
        let sources = [
            Source::new("m.vert", vertex.as_str()),
            Source::new("m.frag", fragment),
        ];
        let parsed = front::parse(&sources, &Options::default()).unwrap();
        let plan = parsed.plan("m", &MaterialState::default());
        self::fragment(&plan, Target::GlslEs100)
    };
    for name in ["es100-bound-is-a-constant.frag", "es100-float-counter.frag"] {
        let text = std::fs::read_to_string(root().join("fixtures/cases").join(name)).unwrap();
        written(&text).unwrap();
    }
    for (head, turns) in [
        ("int i = 0; i < N; i++", 5),
        ("int i = 0; i < N - 1; i++", 4),
        ("int i = 3; i >= 0; i--", 5),
        ("int i = 3; i > -1; --i", 5),
        ("int i = 0; i != N; ++i", 5),
        ("int i = 6; i > 0; i -= 2", 4),
        ("int i = 0; i <= 6; i += STEP", 5),
        ("int i = 0; N > i; i++", 5),
        ("int i = 0; i == 0; i++", 2),
        ("float i = 0.0; i < 4.0; i += 1.0", 6),
        ("float i = T; i > 0.0; i -= 0.5", 11),
        ("float i = 0.0; i <= 1.0; i += 0.25", 7),
    ] {
        let index = if head.starts_with("int") { "i" } else { "0" };
        let text = format!(
            "precision highp float; varying vec2 vUv; uniform vec4 lights[8];
             const int N = 4; const int STEP = 2; const float T = 4.0;
             void main() {{ float r = 0.0; for ({head}) {{ r += lights[{index}].x + float(i); }}
             gl_FragColor = vec4(r, vUv, 1.0); }}"
        );
        let text = written(&text).unwrap_or_else(|e| panic!("{head}: {e}"));
        let bound = format!("turn_1<{turns}");
        assert!(text.replace(' ', "").contains(&bound), "{head}:\n{text}");
    }
    for head in [
        "int i = 0; i != 3; i += 2",
        "float i = 0.0; i < vUv.x; i += 0.1",
    ] {
        let text = format!(
            "precision highp float; varying vec2 vUv;
             void main() {{ float r = 0.0; for ({head}) r += 0.1; gl_FragColor = vec4(r); }}"
        );
        let refused = written(&text).unwrap_err().to_string();
        assert!(refused.contains("constant bound"), "{head}: {refused}");
    }
}

/// A layer below 0 is the first, whether a text rounds it as GLSL does or not.
#[test]
fn a_signed_layer_is_clamped() {
    let images = [
        ("texture_2d_array<f32>", "textureSample(t, s, v.uv, u.k)"),
        (
            "texture_2d_array<f32>",
            "textureSampleLevel(t, s, v.uv, u.k, 0.0)",
        ),
        (
            "texture_cube_array<f32>",
            "textureSample(t, s, v.uv.xyx, u.k - 3)",
        ),
    ];
    for (image, sample) in images {
        let declarations =
            format!("@group(0) @binding(1) var t: {image}; @group(0) @binding(2) var s: sampler;");
        let plan = material(&declarations, &format!("return {sample};"));
        for target in [Target::Wgsl, Target::Spirv].into_iter().chain(GLSL) {
            let written = emitted(&plan, target).map(|(_, uncompared)| uncompared);
            let is_left_out = image.contains("cube") && target == Target::GlslEs300;
            match written {
                Ok(uncompared) => assert_eq!(uncompared, [""; 0], "{sample} in {target}"),
                Err(error) => assert!(is_left_out, "{sample} in {target}: {error}"),
            }
        }
    }
}

/// Passes share a text: one may have no fragment stage.
#[test]
fn a_pass_without_a_fragment_stage_means_the_same() {
    let plan = material("", "return vec4(v.uv, u.f, 1.0);");
    let recipe = Recipe::parse_list("depth-prepass:form=equal").unwrap();
    let plan = recipe.apply(&plan, &Facts::without_ties()).unwrap();
    assert!(plan.passes.iter().any(|pass| pass.fragment.is_none()));
    for target in [
        Target::Wgsl,
        Target::Spirv,
        Target::Glsl450,
        Target::GlslVulkan,
    ] {
        emitted(&plan, target).unwrap_or_else(|e| panic!("{target}: {e}"));
    }
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    /// Each fixture as written in every language, and one variant in one language.
    #[test]
    fn every_fixture_means_the_same_in_each_language() {
        let recipes = [
            "depth-prepass",
            "depth-prepass:form=equal",
            "early-discard",
            "preamble",
            "hoist",
            "specialize",
            "shadow",
        ];
        let targets = [
            Target::Wgsl,
            Target::Spirv,
            Target::Glsl450,
            Target::GlslVulkan,
            Target::GlslEs300,
            Target::GlslEs100,
        ];
        let mut all = Vec::new();
        fixtures(&root().join("fixtures"), &mut all);
        all.sort();
        let results: Vec<(String, Target, Result<Vec<String>, String>)> = all
            .par_iter()
            .enumerate()
            .filter_map(|(i, files)| Some((i, files, read(files)?)))
            .flat_map_iter(|(i, files, original)| {
                let name = files[0].file_name().unwrap().to_string_lossy().into_owned();
                let mut plans: Vec<_> = targets.iter().map(|t| (*t, original.clone())).collect();
                let recipe = Recipe::parse_list(recipes[i % recipes.len()]).unwrap();
                if let Ok(variant) = recipe.apply(&original, &Facts::without_ties()) {
                    plans.push((targets[i / recipes.len() % targets.len()], variant));
                }
                plans
                    .into_iter()
                    .filter_map(move |(target, plan)| match emitted(&plan, target) {
                        Ok((_, uncompared)) => Some((name.clone(), target, Ok(uncompared))),
                        Err(e @ EmitError::Differs { .. }) => {
                            Some((name.clone(), target, Err(e.to_string())))
                        }
                        Err(_) => None,
                    })
            })
            .collect();
        let mut counts: BTreeMap<(&str, &str), usize> = BTreeMap::new();
        let (mut differ, mut uncompared) = (Vec::new(), Vec::new());
        for (name, target, result) in &results {
            let word = match result {
                Ok(lines) if lines.is_empty() => "same",
                Ok(lines) => {
                    uncompared.push(format!("{name}, {target}: {}", lines.join(" ")));
                    "not compared"
                }
                Err(e) => {
                    differ.push(format!("{name}, {target}: {e}"));
                    "differs"
                }
            };
            *counts.entry((target.name(), word)).or_default() += 1;
        }
        eprintln!("{counts:#?}\n{}", uncompared.join("\n"));
        assert!(differ.is_empty(), "{}", differ.join("\n"));
        assert!(results.len() > 600, "{}", results.len());
        assert!(
            uncompared.len() * 10 < results.len(),
            "{} of {}",
            uncompared.len(),
            results.len()
        );
    }
}
