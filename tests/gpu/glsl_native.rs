//! GLSL of every dialect draws through preshade what OpenGL draws of the author's own text: same
//! scene, same values, pictures within 1/255.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use preshade_compiler::emit;
use preshade_compiler::recipe::Recipe;
use preshade_draw::scene::DrawOrder;
use preshade_lab::measure;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::{self, Target};
use preshade_plan::state::{CullMode, MaterialState};
use preshade_scenes::ShaderForm;
use preshade_scenes::synthesise;

use crate::native::both::{self, Both, Difference};
use crate::native::pair::{Draw, FirstRow, Texture};
use crate::native::{Native, Pixels, generate};
use crate::{fixtures_support, render_support};

/// The pairs under `fixtures/glsl/dialects` that are drawn, the `#version` that a host puts before
/// a text without one, and where rows begin: a text that says `origin_upper_left` itself is not
/// turned once more.
const PAIRS: [(&str, &str, FirstRow); 14] = [
    ("es100-textured", "#version 100\n", FirstRow::Highest),
    ("gl120-sampling", "", FirstRow::Highest),
    ("es300-block", "", FirstRow::Highest),
    ("es300-ids", "", FirstRow::Highest),
    ("gl120-arrays", "", FirstRow::Highest),
    ("gl150-window", "", FirstRow::Lowest),
    ("gl330-material", "", FirstRow::Highest),
    ("gl330-functions", "", FirstRow::Highest),
    ("gl330-lent", "", FirstRow::Highest),
    ("gl400-matrices", "", FirstRow::Highest),
    ("gl410-samplers", "", FirstRow::Highest),
    ("seed1-tiling", "#version 100\n", FirstRow::Highest),
    ("seed4-specular", "#version 330\n", FirstRow::Highest),
    ("seed4-noise", "", FirstRow::Highest),
];

fn texts(name: &str) -> [String; 2] {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/glsl/dialects");
    ["vert", "frag"].map(|e| std::fs::read_to_string(folder.join(format!("{name}.{e}"))).unwrap())
}

#[test]
fn pairs_draw_as_opengl_draws_them() {
    let gl = Native::new();
    println!("on {}", gl.renderer());
    let mut wrong = Vec::new();
    for (name, version, first) in PAIRS {
        let texts = texts(name);
        let scene = both::scene(name, &texts, [320, 180]).unwrap_or_else(|e| panic!("{e}"));
        let [vertex, fragment] = &texts;
        let native = [format!("{version}{vertex}"), format!("{version}{fragment}")];
        let pictures = both::draw(&gl, &scene, [&native[0], &native[1]], first);
        let pictures = pictures.unwrap_or_else(|e| panic!("{name}: {e}"));
        if let Some(folder) = std::env::var_os("PRESHADE_PICTURES") {
            pictures.save(Path::new(&folder), name);
        }
        // Of an output of three components OpenGL leaves alpha open.
        let channels = both::channels(fragment);
        let Difference {
            seen, edges, apart, ..
        } = pictures.difference(channels);
        println!("  {name}: {edges} pixels at edges, {apart} of another colour");
        // A picture with nothing in it would prove nothing.
        let pixels = pictures.native.depth.len();
        assert!(seen > pixels / 20, "{name} draws {seen} pixels");
        // Rows are numbered from the other end, so a sample on an edge goes to the other side.
        if apart > 0 || edges > pixels / 500 {
            wrong.push((name, edges, apart));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

/// What GLSL ES 3.00 cannot say, as it is told.
const NOT_IN_ES: [&str; 4] = [
    "`layout(origin_upper_left)`",
    "arrays of arrays",
    "interpolation without perspective (`linear`)",
    "textureGather",
];

/// What is written for OpenGL, of every version, draws there what the author's own text does: the
/// same window, rows from the bottom, no clip control, depth and all.
#[test]
fn what_is_written_for_opengl_draws_as_the_author_s_text() {
    let gl = Native::new();
    let ours = PAIRS.map(|(name, version, _)| {
        let texts = texts(name);
        (name.to_owned(), texts.map(|t| format!("{version}{t}")))
    });
    let made = (0..40).map(|seed| (format!("generated-{seed}"), generate::pair(seed).texts));
    let (mut wrong, mut drawn) = (Vec::new(), [0; 2]);
    for (name, texts) in ours.into_iter().chain(made) {
        let size = match name.starts_with("generated") {
            true => [96, 54],
            false => [320, 180],
        };
        let scene = both::scene(&name, &texts, size).unwrap_or_else(|e| panic!("{name}: {e}"));
        let bound = both::bound(&scene).unwrap();
        let clear = scene.clear_color.map(|c| c as f32);
        let draw = |texts: [&str; 2]| {
            let draws = bound.iter().map(|bound| {
                let mut draw = both::native_draw(&scene, bound);
                let own = draw.uniform;
                // WebGPU's instances are counted from the draw's first, which is 0 here.
                draw.uniform = Box::new(move |path| match path {
                    "naga_vs_first_instance" => Some(vec![0; 16]),
                    _ => own(path),
                });
                draw
            });
            let draws: Vec<Draw<'_>> = draws.collect();
            gl.draw_pair(FirstRow::Lowest, scene.size, clear, texts, &draws)
                .unwrap_or_else(|e| panic!("{name}: {e}\n{}\n{}", texts[0], texts[1]))
        };
        let wanted = draw([&texts[0], &texts[1]]);
        let seen = wanted.depth.iter().filter(|d| **d < 1.0).count();
        assert!(seen > wanted.depth.len() / 20, "{name} draws {seen} pixels");
        // Of an output of three components OpenGL leaves alpha open.
        let channels = both::channels(&texts[1]);
        let original = &measure::originals(&scene)[0];
        for (target, ends) in [
            (Target::Glsl450, ["main.vert", "main.frag"]),
            (Target::GlslEs300, ["main.es.vert", "main.es.frag"]),
        ] {
            let files = match emit::emit(original, &[target], &emit::Options::default()) {
                Ok(files) => files,
                // ES 3.00 has no words for some, and says so.
                Err(emit::EmitError::Inexpressible { what, .. })
                    if target == Target::GlslEs300 && NOT_IN_ES.contains(&what.as_str()) =>
                {
                    continue;
                }
                Err(e) => panic!("{name}: {e}"),
            };
            let texts = ends.map(|end| {
                let file = files.iter().find(|f| f.name.ends_with(end)).unwrap();
                String::from_utf8(file.bytes.clone()).unwrap()
            });
            drawn[usize::from(target == Target::GlslEs300)] += 1;
            let ours = draw([&texts[0], &texts[1]]);
            let shown = (0..ours.color.len()).filter(|i| i % 4 < channels);
            let apart = shown.filter(|i| ours.color[*i].abs_diff(wanted.color[*i]) > 1);
            let apart = apart.count();
            let depths = ours.depth.iter().zip(&wanted.depth);
            let deeper = depths.filter(|(a, b)| a.to_bits() != b.to_bits()).count();
            if apart > 0 || deeper > 0 {
                println!("{name}:\n{}\n{}", texts[0], texts[1]);
                wrong.push(format!(
                    "{name}, {target:?}: {apart} channels of another colour, {deeper} other depths"
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    // All in 4.50, and of ES 3.00 what it has words for.
    assert_eq!(drawn, [54, 29]);
}

/// Fixtures whose pictures by Mesa's two drivers differ for another reason than meaning: instances
/// that share depths, and blades that lie closer than silhouettes are told apart. The adversarial
/// fixtures show the last bits of sums, which the two compilers fuse otherwise.
const NOT_COMPARED: [&str; 2] = ["instanced.wgsl", "grass-opaque.wgsl"];

/// The GLSL written of WGSL draws on OpenGL what the author's WGSL draws on Vulkan: one driver, so a
/// difference is one of meaning.
#[test]
fn glsl_written_of_wgsl_draws_as_its_author_wrote_it() {
    let gl = Native::new();
    let (mut wrong, mut compared) = (Vec::new(), 0);
    let mut left_out: BTreeMap<String, usize> = BTreeMap::new();
    for path in fixtures_support::wgsl_files() {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if NOT_COMPARED.contains(&name.as_str()) || path.parent().unwrap().ends_with("adversarial")
        {
            continue;
        }
        match difference_of_written(&gl, &path) {
            Ok(found) => {
                compared += 1;
                // Rasterisers of one driver may differ by a sample at an edge.
                if found.apart > 0 || found.edges > 96 * 64 / 200 {
                    wrong.push(format!("{}: {found:?}", path.display()));
                }
            }
            Err(why) => *left_out.entry(why).or_default() += 1,
        }
    }
    println!("{compared} compared, left out: {left_out:#?}");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(compared > 40, "{compared} of {left_out:?}");
}

/// An error is why the fixture is not drawn twice.
fn difference_of_written(gl: &Native, path: &Path) -> Result<Difference, String> {
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let parsed = fixtures_support::drawable(path)?;
    let mut state = MaterialState::default();
    state.primitive.cull = CullMode::None;
    let scene = synthesise(parsed, state).resized([96, 64]);
    let original = &measure::originals(&scene)[0];
    let files = emit::emit(original, &[Target::Glsl450], &emit::Options::default());
    let files = match files {
        Ok(files) => files,
        Err(emit::EmitError::Inexpressible { what, .. }) => return Err(what),
        Err(e) => panic!("{name}: {e}"),
    };
    let text = |end: &str| {
        let file = files.iter().find(|f| f.name.ends_with(end));
        file.map(|f| String::from_utf8(f.bytes.clone()).unwrap())
    };
    let (Some(vertex), Some(fragment)) = (text(".main.vert"), text(".main.frag")) else {
        return Err("no fragment stage".to_owned());
    };
    let plan: plan_file::PlanFile = serde_json::from_str(&text(".plan.json").unwrap()).unwrap();
    let needs_more = original.passes[0].features.iter().any(|f| !f.is_empty());
    let targets = &original.passes[0].targets;
    if needs_more || targets.len() != 1 {
        return Err("features or several targets".to_owned());
    }
    let bound = both::bound(&scene)?;
    let draws = bound.iter().map(|b| both::written_draw(b, &plan.files[0]));
    let draws = draws.collect::<Result<Vec<Draw<'_>>, String>>()?;
    let clear = scene.clear_color.map(|c| c as f32);
    let texts = [vertex.as_str(), fragment.as_str()];
    let native = gl
        .draw_pair(FirstRow::WebGpu, scene.size, clear, texts, &draws)
        .unwrap_or_else(|e| panic!("{name}: {e}\n{vertex}\n{fragment}"));
    let ours = render_support::render_as(
        render_support::gpu(),
        &scene,
        std::slice::from_ref(original),
        DrawOrder::AsGiven,
        ShaderForm::Text,
    );
    Ok(Both { ours, native }.difference(4))
}

/// What helpers read of inputs and of what `main` made is theirs as parameters, and keeps no pass
/// from anything. What they write still does.
#[test]
fn what_helpers_read_hinders_no_pass() {
    let stateful = texts("gl330-lent");
    let stateless = stateful.clone().map(|t| t.replace("seen += 0.125;", ""));
    assert_ne!(stateful, stateless);
    // With the most that a channel may differ, of 255.
    for (texts, recipe, most) in [
        (&stateful, "depth-prepass", 0),
        (&stateful, "early-discard:texture=float", 0),
        (&stateful, "hoist:budget=0.1", 25),
        (&stateless, "visibility-buffer:budget=1", 1),
    ] {
        let scene = both::scene("gl330-lent", texts, [160, 90]).unwrap();
        let original = measure::originals(&scene);
        let draw = |plans: &[Plan]| {
            let gpu = render_support::gpu();
            render_support::render_as(gpu, &scene, plans, DrawOrder::AsGiven, ShaderForm::Text)
        };
        let recipe = Recipe::parse([recipe]).unwrap();
        let plan = recipe.apply(&original[0], &Facts::default());
        let plan = plan.unwrap_or_else(|refused| panic!("{refused}"));
        let pictures = [draw(&original), draw(&[plan])];
        let [before, after] = pictures.map(|r| r.colors[0].as_ref().unwrap().bytes.clone());
        let apart = before.iter().zip(&after).map(|(a, b)| a.abs_diff(*b));
        assert!(apart.max().unwrap() <= most, "{recipe:?}");
    }
    let scene = both::scene("gl330-lent", &stateful, [160, 90]).unwrap();
    let recipe = Recipe::parse(["visibility-buffer:budget=1"]).unwrap();
    let refused = recipe.apply(&measure::originals(&scene)[0], &Facts::default());
    let refused = refused.unwrap_err();
    assert_eq!(refused.code, "fragment-state");
    let named = "keeps state in the private variable `seen`, which `lit` uses, and parts";
    assert!(refused.reason.contains(named), "{}", refused.reason);
}

/// What is written for WebGL 1 draws what the author's text does: as it is, and behind a pre-pass
/// that packs its depth.
#[test]
fn what_is_written_in_es_1_00_draws_as_the_author_s_text() {
    let gl = Native::new();
    for (name, version) in [
        ("seed1-tiling", "#version 100\n"),
        ("es100-textured", "#version 100\n"),
        ("seed4-specular", "#version 330\n"),
    ] {
        let [vertex, fragment] = texts(name).map(|t| format!("{version}{t}"));
        let scene = both::scene(name, &[vertex.clone(), fragment.clone()], [160, 90]).unwrap();
        let bound = both::bound(&scene).unwrap();
        let clear = scene.clear_color.map(|c| c as f32);
        let draw = |texts: [&str; 2], clear, depth: Option<&Texture>| {
            let with_depth = |bound| {
                let mut draw = both::native_draw(&scene, bound);
                if let Some(depth) = depth {
                    draw.textures
                        .insert("prepass_depth".to_owned(), depth.clone());
                    let own = draw.uniform;
                    let size: Vec<u8> = scene
                        .size
                        .map(|n| n as f32)
                        .into_iter()
                        .flat_map(f32::to_le_bytes)
                        .collect();
                    draw.uniform = Box::new(move |path| match path {
                        "prepass_depth_size" => Some(size.clone()),
                        _ => own(path),
                    });
                }
                draw
            };
            let draws: Vec<Draw<'_>> = bound.iter().map(with_depth).collect();
            gl.draw_pair(FirstRow::Highest, scene.size, clear, texts, &draws)
                .unwrap_or_else(|e| panic!("{name}: {e}\n{}", texts[1]))
        };
        let channels = both::channels(&fragment);
        let wanted = draw([&vertex, &fragment], clear, None);
        let original = &measure::originals(&scene)[0];
        let written = |plan: &Plan| {
            let files = emit::emit(plan, &[Target::GlslEs100], &emit::Options::default()).unwrap();
            move |end: &str| {
                let file = files.iter().find(|f| f.name.ends_with(end)).unwrap();
                String::from_utf8(file.bytes.clone()).unwrap()
            }
        };
        let same = |drawn: &Pixels, what: &str| {
            // Of an output of three components OpenGL leaves alpha open.
            let shown = |i: &usize| i % 4 < channels;
            let apart = (0..drawn.color.len()).filter(shown);
            let apart = apart.map(|i| drawn.color[i].abs_diff(wanted.color[i]));
            let apart: Vec<u8> = apart.filter(|d| *d > 1).collect();
            assert!(apart.is_empty(), "{name}, {what}: {apart:?}");
            assert!(drawn.depth.iter().filter(|d| **d < 1.0).count() > drawn.depth.len() / 20);
        };

        let as_it_is = written(original);
        let [vertex, fragment] = ["main.es100.vert", "main.es100.frag"].map(&as_it_is);
        same(&draw([&vertex, &fragment], clear, None), "as it is");

        let recipe = Recipe::parse(["early-discard:texture=packed"]).unwrap();
        let packed = written(&recipe.apply(original, &Facts::default()).unwrap());
        let [vertex, fragment] = ["prepass.es100.vert", "prepass.es100.frag"].map(&packed);
        let depth = draw([&vertex, &fragment], [1.0; 4], None);
        let texture = |texels: Vec<u8>| Texture {
            size: scene.size.map(|n| n as i32),
            levels: vec![texels],
            layers: 1,
            srgb: false,
            linear: false,
            clamp: true,
        };
        let [vertex, fragment] = ["main.es100.vert", "main.es100.frag"].map(&packed);
        let behind = draw(
            [&vertex, &fragment],
            clear,
            Some(&texture(depth.color.clone())),
        );
        same(&behind, "behind the packed depth");
        // Behind a pre-pass that says that all is at the near plane nothing is left.
        let near = texture(vec![0; depth.color.len()]);
        let nothing = draw([&vertex, &fragment], clear, Some(&near));
        assert!(nothing.depth.iter().all(|d| *d == 1.0), "{name}");
    }
}

/// Pairs made by a grammar, each of a seed: every dialect and every construct that the front end
/// rewrites.
#[test]
fn generated_pairs_draw_as_opengl_draws_them() {
    let gl = Native::new();
    let mut wrong = Vec::new();
    let mut constructs = BTreeSet::new();
    for seed in 0..80 {
        let pair = generate::pair(seed);
        constructs.extend(pair.constructs.iter().copied());
        let name = format!("generated-{seed}");
        let [vertex, fragment] = &pair.texts;
        let pictures = both::scene(&name, &pair.texts, [96, 54])
            .and_then(|scene| both::draw(&gl, &scene, [vertex, fragment], FirstRow::Highest));
        let found = match &pictures {
            Ok(pictures) => pictures.difference(4),
            Err(e) => {
                println!("seed {seed}: {e}\n{vertex}\n{fragment}");
                wrong.push(format!(
                    "seed {seed}: {}",
                    e.lines().next().unwrap_or_default()
                ));
                continue;
            }
        };
        // A picture with nothing in it would prove nothing.
        if found.seen < 96 * 54 / 20 || found.apart > 0 || found.edges > 96 * 54 / 200 {
            println!("seed {seed}: {found:?}\n{vertex}\n{fragment}");
            wrong.push(format!("seed {seed}: {found:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert_eq!(constructs.len(), generate::CONSTRUCTS, "{constructs:?}");
}

/// What naga's front end evaluates otherwise than GLSL says, or this crate's own rewriting once
/// did: each body ends with a colour that tells.
#[test]
fn each_thing_is_evaluated_as_often_as_glsl_says() {
    let head = "#version 450
layout(location = 0) in vec2 uv;
layout(location = 0) out vec4 color;
int count = 0;
float tick() { count++; return float(count) * 0.05; }
int next() { count++; return count; }
vec4 four() { count++; return vec4(0.1, 0.2, 0.3, 0.4) * float(count); }
mat2 turned(float a) { count++; return mat2(cos(a), -sin(a), sin(a), cos(a)); }
void wrap(inout float p, float size) { p = mod(p + size, size); }
float halved(inout float p) { p *= 0.5; return p; }
void both(inout float a, inout float b) { a += 0.1; b += 0.25; }
void split(float a, out float low, out float high) { low = a * 0.25; high = a * 0.75; }
void swap(inout float a, inout float b) { float t = a; a = b; b = t; }
void turn(inout vec2 v) { v = vec2(0.5 - v.y, v.x); }
void bump(int by, inout int n) { n += by; count += n; }
float sum(float low, inout float a, float high) { a = a * 0.5 + low; return a + high; }
struct Part { float a[2]; vec2 v; bool on; mat2 m; };
void lit(out bool on, inout Part p) { on = p.v.x > 0.5; p.v.y = on ? 0.9 : 0.1; }
void whole(out float x) { x = uv.x * 0.7; }
void number(out int x) { x = int(uv.x * 9.0); }
float kind(int x) { return 0.1; }
float kind(uint x) { return 0.3; }
float kind(float x) { return 0.5; }
float kind(vec2 x) { return 0.7; }
float kind(ivec2 x) { return 0.9; }
float near(float a, int b) { return 0.2; }
float near(float a, float b) { return 0.8; }
float near(ivec2 a, float b) { return 0.4; }
const int N = 1;
int pick(int N) { int t[3] = int[3](2, 3, 5); return t[N]; }
";
    let bodies = [
        "bool b = uv.x > 0.5 && tick() > 0.0; color = vec4(b ? 0.8 : 0.2, float(count) * 0.3, 0.0, \
         1.0);",
        "bool b = uv.x > 0.5 || tick() < 0.0; color = vec4(b ? 0.8 : 0.2, float(count) * 0.3, 0.0, \
         1.0);",
        "int n = 0; while (n < 5 && tick() < uv.x * 0.2) n++; \
         color = vec4(float(n) * 0.1, float(count) * 0.1, 0.0, 1.0);",
        "int i = 0; float s = 0.0; do { i++; if (i == 2) continue; \
         s += 0.1; } while (i < 4 && uv.y >= 0.0); color = vec4(s, float(i) * 0.1, uv.x, 1.0);",
        "float a[4] = float[4](0.1, 0.2, 0.3, 0.4); int i = 0; a[i++] += uv.x * 0.3; \
         a[next()] *= 2.0; a[++i]++; color = vec4(a[0], a[1], float(i + count) * 0.1, a[2] - 1.0);",
        "mat2 m = mat2(four()); bool same = turned(uv.x) == turned(uv.x); \
         mat2 p = matrixCompMult(turned(uv.x), turned(uv.y)); \
         color = vec4(m[1], same ? float(count) * 0.1 : 0.0, p[0].x);",
        "vec3 p = vec3(uv * 3.0, 0.2); wrap(p.x, 0.5); float h = halved(p[1]) + halved(p.y); \
         both(p.z, p.z); color = vec4(p, h);",
        "vec2 p; split(uv.x, p.y, p.x); mat2 m = mat2(0.1); m[1].y = 0.6; m[0].xy = p; \
         color = vec4(m[0], m[1]);",
        "float k = 0.0; { const int N = 0; k += float(pick(N)) * 0.1; } k += float(pick(N + 1)) * \
         0.01; color = vec4(k, uv, 1.0);",
        "const int M = int(0.5 * 4.0); float a[int(1.5 * 2.0)]; a[M] = 0.4; \
         color = vec4(a[2], float(a.length()) * 0.1, 0.6 < 0.5 ? 0.1 : 0.9, float((0u - 1u) >> \
         31));",
        "ivec3 i = ivec3(uv * 9.0, 7) % 3; i %= 2; float w; float f = modf(uv.x * 4.0, w); vec2 v; \
         f += modf(uv.y * 3.0, v.y); color = vec4(vec3(i) * 0.3, f * 0.3 + v.y * 0.1 + w * 0.05);",
        "vec2 v = uv; swap(v.x, v.y); float a[3] = float[3](0.1, 0.4, 0.7); int i = 0; \
         swap(a[i++], a[i++]); swap(a[i], a[0]); color = vec4(v * 0.5, a[0], a[1] + a[2] * 0.1);",
        "float a[3] = float[3](0.1, 0.4, 0.7); int i = 0; \
         float s = sum(float(i++) * 0.2, a[i], 0.3 * float(i)); \
         color = vec4(s, a[1], float(i) * 0.2, sum(a[2], a[2], a[2]) * 0.5);",
        "int a[3] = int[3](2, 3, 4); int i = 1; bump(i, a[i]); bump(a[next() - 3], a[0]); \
         color = vec4(vec3(a[0], a[1], a[2]) * 0.1, float(count) * 0.05);",
        "int i = 1; bump(i++, i); int j = 2; bump(j, j); \
         color = vec4(float(i) * 0.2, float(j) * 0.1, float(count) * 0.05, uv.x);",
        "mat2 m = mat2(0.1, 0.3, uv); turn(m[0]); turn(m[1].yx); swap(m[0].y, m[1][0]); \
         m[1].yx *= 0.5; m[int(uv.x * 1.9)].xy += 0.1; color = vec4(m[0], m[1]);",
        "Part p; p.a = float[2](0.2, uv.y); p.v = uv; p.on = false; \
         p.m = mat2(0.1, 0.2, 0.3, 0.4); swap(p.a[0], p.a[1]); p.a[1] *= 2.0; turn(p.v); \
         lit(p.on, p); turn(p.m[1]); color = vec4(p.a[0], p.v.y, p.on ? 0.9 : p.a[1], p.m[1].x + \
         p.m[0].y);",
        "Part p = Part(float[2](uv.x, 0.4), uv, uv.x > 0.3, mat2(0.3)), q = p; q.m[1].xy = q.v; \
         q.m *= 0.5; q.a[0]++; p.a = q.a; color = vec4(p.a[0] - 1.0, q.m[1], p.on && !q.on ? 0.0 : \
         0.6);",
        "float w; whole(w); vec2 v = uv; whole(v.y); number(w); number(v.x); \
         color = vec4(w * 0.1, v * vec2(0.1, 1.0), 0.5);",
        "color = vec4(kind(1) + kind(1u), kind(1.0), kind(ivec2(uv * 3.0)), kind(uv * 2.0)); \
         color.r += kind(floatBitsToUint(uv.x)) * 0.3; color.g += near(1, 1) * 0.3; \
         color.b *= near(uv.x, 2u); color.a *= near(uv.y, 1) + near(ivec2(1), 1);",
        "float w = 0.6; bool b = uv.x > 0.5 && modf(uv.y * 4.0, w) > 0.5; \
         color = vec4(w * 0.25, b ? 0.8 : 0.2, uv);",
        "vec2 v = vec2(0.1, uv.x); float a[3] = float[3](0.1, 0.4, 0.7); int n = 0; \
         for (swap(v.x, v.y); n < 2; n++, swap(a[0], a[n])) { if (n == 1) continue; \
         v.y += 0.1; } swap(v.x, a[1]), turn(v); color = vec4(v, a[0], a[2]);",
        "color = vec4(uv, 0.3, 1.0); if (uv.x > 0.5) { color.z = tick(); return; \
         color = four(); } for (int i = 0; i < 3; i++) { if (uv.y > 0.5) { color.x = tick(); \
         break; next(); } color.y += tick(); continue; color = four(); } { \
         return; } color = four();",
        "color = vec4(0.2, uv, 1.0); switch (int(uv.x * 4.0)) { case 0: { color.x = tick() * 9.0; \
         break; } case 1: { if (uv.y > 0.5) { color.y = tick() * 6.0; break; } else { \
         color.z = 0.9; return; } } case 2: color.x = 0.7; case 3: color.w = float(next()) * 0.3; \
         break; color = four(); default: { { color = four(); } break; } }",
        "float s = 0.0; for (int i = 0, j = 3; i < j || tick() > 0.9; i++) { s += 0.1; \
         if (s > uv.x) break; } color = vec4(s, float(count) * 0.2, 0.0, 1.0);",
    ];
    let vertex = "#version 450
layout(location = 0) in vec3 position;
layout(location = 0) out vec2 uv;
void main() { uv = position.xy * 0.5 + 0.5; gl_Position = vec4(position.xy, 0.0, 1.0); }
";
    let gl = Native::new();
    let mut wrong = Vec::new();
    for (i, body) in bodies.iter().enumerate() {
        let fragment = format!("{head}void main() {{ {body} }}\n");
        let texts = [vertex.to_owned(), fragment.clone()];
        let drawn = both::scene("body", &texts, [64, 64])
            .and_then(|scene| both::draw(&gl, &scene, [vertex, &fragment], FirstRow::Highest));
        match drawn {
            Ok(pictures) => {
                let found = pictures.difference(4);
                if found.apart > 0 || found.seen < 64 {
                    wrong.push(format!("{i}: {found:?}: {body}"));
                }
            }
            Err(e) => wrong.push(format!("{i}: {body}\n{e}")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
