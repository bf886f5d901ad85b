//! GLSL ES 1.00, for WebGL 1: what is written of every fixture is accepted by glslang, or refused
//! by the name of what the language lacks; and the packed prologue draws what the author's text
//! does.

use std::collections::BTreeMap;
use std::path::Path;

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::{PlanFile, Target};
use preshade_plan::state::MaterialState;
use shader_text::error::Color;
use shader_text::files::File;
use shader_text::options::Options;

use crate::accept;

fn original(name: &str, sources: &[Source]) -> Plan {
    let parsed = front::parse(sources, &Options::default())
        .unwrap_or_else(|e| panic!("{name}: {}", e.render(Color::Never)));
    Plan::original(
        name,
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    )
}

fn fixture(name: &str) -> Plan {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/glsl/dialects");
    let sources = ["vert", "frag"].map(|e| {
        let name = format!("{name}.{e}");
        Source::new(&name, std::fs::read_to_string(folder.join(&name)).unwrap())
    });
    original(name, &sources)
}

fn emitted(plan: &Plan) -> Result<Vec<File>, emit::EmitError> {
    emit::emit(plan, &[Target::GlslEs100], &emit::Options::default())
}

fn text<'a>(files: &'a [File], name: &str) -> &'a str {
    let file = files.iter().find(|f| f.name.ends_with(name));
    let file = file.unwrap_or_else(|| panic!("no {name}"));
    std::str::from_utf8(&file.bytes).unwrap()
}

/// The prologue, with the depth packed by a pre-pass: what the issue of WebGL 1 is about.
#[test]
fn the_packed_prologue_is_written() {
    let recipe = Recipe::parse(["early-discard:texture=packed"]).unwrap();
    let plan = fixture("seed1-tiling");
    let plan = recipe.apply(&plan, &Facts::default()).unwrap();
    let files = emitted(&plan).unwrap();
    accept::accept(&[("packed".to_owned(), files.clone())]);
    let stages: Vec<String> = ["main.es100.vert", "main.es100.frag", "prepass.es100.frag"]
        .iter()
        .map(|name| format!("// {name}\n{}", text(&files, name)))
        .collect();
    insta::assert_snapshot!("es100_packed", stages.join("\n"));
    let json: PlanFile = serde_json::from_str(text(&files, ".plan.json")).unwrap();
    let main = json.plan.passes.len() - 1;
    let fragment = &json.files[main].fragment[&Target::GlslEs100];
    let depth = fragment.textures.iter().find(|t| t.name == "prepass_depth");
    assert_eq!(depth.unwrap().size.as_deref(), Some("prepass_depth_size"));
}

#[test]
fn fixtures_are_accepted_or_refused_by_name() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let mut sets = Vec::new();
    let mut refused = BTreeMap::new();
    for folder in ["glsl", "glsl/dialects", "shaders"] {
        let mut files: Vec<_> = std::fs::read_dir(root.join(folder))
            .unwrap()
            .map(|e| e.unwrap().path())
            .filter(|p| p.extension().is_some_and(|e| e == "vert" || e == "wgsl"))
            .collect();
        files.sort();
        for path in files {
            let read = |p: &Path| {
                let name = p.file_name().unwrap().to_str().unwrap();
                Source::new(name, std::fs::read_to_string(p).unwrap())
            };
            let mut sources = vec![read(&path)];
            if path.extension().is_some_and(|e| e == "vert") {
                sources.push(read(&path.with_extension("frag")));
            }
            let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
            // A file of several materials has no one to write.
            if front::parse(&sources, &Options::default()).is_err() {
                continue;
            }
            match emitted(&original(&name, &sources)) {
                Ok(files) => sets.push((name, files)),
                Err(emit::EmitError::Inexpressible { what, .. }) => {
                    refused.insert(name, what);
                }
                Err(e) => panic!("{name}: {e}"),
            }
        }
    }
    accept::accept(&sets);
    let accepted: Vec<&str> = sets.iter().map(|(name, _)| name.as_str()).collect();
    let refused: Vec<String> = refused
        .iter()
        .map(|(n, what)| format!("{n}: {what}"))
        .collect();
    insta::assert_snapshot!(
        "es100_fixtures",
        format!("written: {}\n\n{}", accepted.join(", "), refused.join("\n"))
    );
}

/// Appendix A has indices by a loop's own variable, which a counter is where it begins at the same
/// number each time. What is drawn so is `es100-textured`, in GL and in WebGL 1.
#[test]
fn a_counter_is_an_index() {
    let vertex = "attribute vec3 position; varying vec3 local; void main() { local = position; \
                  gl_Position = vec4(position, 1.0); }";
    let texts = |functions: &str, body: &str| {
        let fragment = format!(
            "precision highp float; varying vec3 local; uniform vec4 table[8]; uniform int count; \
             {functions} void main() {{ vec4 sum = vec4(local, 1.0); {body} gl_FragColor = sum; }}"
        );
        [
            Source::new("a.vert", vertex),
            Source::new("a.frag", fragment),
        ]
    };
    // The `for` lines and the indices, in order.
    let told = |functions: &str, body: &str| {
        let files = emitted(&original("a", &texts(functions, body)));
        let files = files.unwrap_or_else(|e| panic!("{body}: {e}"));
        accept::accept(&[("counted".to_owned(), files.clone())]);
        let text = text(&files, "frag").to_owned();
        let mut found = Vec::new();
        for line in text.lines().map(str::trim) {
            if let Some((_, turns)) = line.split_once("; turn_") {
                found.push(turns.split(';').next().unwrap().to_owned());
            }
            for part in line.split("table[").skip(1) {
                let end = part.find(']').unwrap();
                found.push(format!("[{}]", &part[..end]));
            }
        }
        // Its declaration has the length.
        found.retain(|f| f != "[8]");
        found
    };
    for (body, wanted) in [
        (
            "for (int i = 0; i < 8; i++) sum += table[i] * float(i);",
            &["1 < 9", "[turn_1]"][..],
        ),
        (
            "for (int i = 1; i <= 4; i += 2) { if (sum.x > 9.0) continue; sum += table[i + 1]; }",
            &["1 < 3", "[turn_1 * 2 + 1 + 1]"],
        ),
        (
            "for (int i = -2; i < 2; i++) sum += table[3 - (i - 1)];",
            &["1 < 5", "[3 - (turn_1 - 2 - 1)]"],
        ),
        // Begun anew in each turn of the loop around it.
        (
            "for (int i = 0; i < 2; i++) for (int j = 1; j < 4; j++) sum += table[i * 4 + j];",
            &["1 < 3", "2 < 4", "[turn_1 * 4 + (turn_2 + 1)]"],
        ),
        // One counter of two loops.
        (
            "int i; for (i = 1; i < 3; i++) sum += table[i]; for (i = 4; i < 6; \
             i++) sum += table[i];",
            &["1 < 3", "[turn_1 + 1]", "2 < 3", "[turn_2 + 4]"],
        ),
    ] {
        assert_eq!(told("", body), wanted, "{body}");
    }
    // What one function's values are called, another's are too.
    let functions = "vec4 a(float x) { vec4 all = vec4(0.0); for (int i = 0; i < 3; \
                     i++) all += table[i] * x; return all; }
        vec4 b(float x) { int m = 0; if (x > 1.0) m = 5; vec4 all = vec4(0.0); for (int i = 0; \
            i < 3; i++) all += table[i + 1] * float(m); return all; }";
    let wanted = ["1 < 4", "[turn_1]", "2 < 4", "[turn_2 + 1]"];
    assert_eq!(told(functions, "sum += a(sum.x) + b(sum.y);"), wanted);
    let refused = |functions: &str, body: &str, why: &str| {
        let error = emitted(&original("a", &texts(functions, body))).unwrap_err();
        assert!(error.to_string().contains(why), "{body}: {error}");
    };
    let index = "a non-constant index";
    let endless = "a loop without a constant bound on its iterations";
    // One that goes on where it was, that something else sets, or that is read behind its loop.
    for body in [
        "int j = 0; for (int i = 0; i < 2; i++) for (; j < 4; j++) { if (sum.x > float(i)) break; \
         sum += table[j]; }",
        "for (int i = 0; i < 8; i++) { int k = i; if (sum.x > 1.0) k = 0; sum += table[k]; }",
        "int i = 0; for (; i < 3; i++) sum *= 2.0; sum += table[i];",
        "for (int i = 0; i < 8; i++) sum += table[count];",
    ] {
        refused("", body, index);
    }
    let set_in_one =
        "vec4 a(float x) { int k = 3; int m = 0; if (x > 1.0) m = 5; return table[k] * float(m); }
        vec4 b(float x) { int k = 3; int m = 0; if (x > 1.0) m = 5; return table[m] * float(k); }";
    refused(set_in_one, "sum += a(sum.x) + b(sum.y);", index);
    // A test that a turn may not come to ends nothing after a known number of turns; nor does one
    // of a counter that a function writes.
    for body in [
        "for (int i = 0;; i++) { sum.x -= 1.0; if (sum.x > 0.0) continue; if (!(i < 3)) break; \
         sum.y += 1.0; }",
        "for (int i = 0;; i++) { if (!(i < 3)) { sum.x -= 1.0; if (sum.x > 0.0) continue; \
         break; } sum.y += 1.0; }",
    ] {
        refused("", body, endless);
    }
    refused(
        "void back(inout int i) { if (local.x > 0.5) i -= 1; }",
        "for (int i = 0; i < 3; i++) { back(i); sum += table[1]; }",
        endless,
    );
}

/// The same of WGSL, whose `for` naga writes in another form, and whose names may look like those
/// it makes up.
#[test]
fn a_counter_of_wgsl_is_an_index_where_it_is_one() {
    let emitted = |functions: &str, body: &str| {
        let text = format!(
            "@vertex fn vs(@location(0) position: vec3<f32>) -> @builtin(position) vec4<f32> {{ \
             return vec4(position, 1.0); }}
{functions}
@fragment fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {{ \
    var t = array<f32, 4>(at.x, at.y, 2.0, 3.0); var sum = 0.0; {body} return vec4(sum); }}"
        );
        emitted(&original("a", &[Source::new("a.wgsl", text)]))
    };
    let files = emitted("", "for (var i = 0; i < 4; i++) { sum += t[i]; }").unwrap();
    accept::accept(&[("counted".to_owned(), files.clone())]);
    let written = text(&files, "frag");
    assert!(
        written.contains("turn_1 < 5") && written.contains("[turn_1]"),
        "{written}"
    );
    for (functions, body) in [
        // A gate that is an argument.
        (
            "fn f(loop_init: bool, x: f32) -> f32 { var sum = 0.0; var i = 0; loop { \
             if !loop_init { i = i + 1; } if !(i < 3) { break; } sum += 1.0; if sum > x { \
             break; } } return sum; }",
            "sum = f(at.x > 1.0, at.y);",
        ),
        // A limit that is not the counter.
        (
            "",
            "var i = 0; let _e = i; loop { if !(_e < 3) { break; } if sum > at.x { \
             break; } sum += 1.0; continuing { i = i + 1; } }",
        ),
    ] {
        let error = emitted(functions, body).unwrap_err();
        let why = "a loop without a constant bound on its iterations";
        assert!(error.to_string().contains(why), "{body}: {error}");
    }
}

#[test]
fn what_the_language_lacks_is_named() {
    let vertex = "#version 300 es\nin vec3 position;\nuniform int count;\nuniform float table[4];\n\
                  out vec3 local;\nvoid main() { local = position; \
                  gl_Position = vec4(position, 1.0); }\n";
    let refused = |declared: &str, body: &str| {
        let fragment = format!(
            "#version 300 es\nprecision highp float;\nin vec3 local;\nuniform int count;\n\
             uniform float table[4];\nout vec4 color;\n{declared}\nvoid main() {{ {body} }}\n"
        );
        let sources = [
            Source::new("a.vert", vertex),
            Source::new("a.frag", fragment),
        ];
        match emitted(&original("a", &sources)) {
            Err(emit::EmitError::Inexpressible { what, .. }) => what,
            Err(e) => panic!("{body}: {e}"),
            Ok(files) => panic!("{body} is written:\n{}", text(&files, "frag")),
        }
    };
    for (declared, body, what) in [
        (
            "",
            "color = vec4(float(uint(local.x) + 1u));",
            "an unsigned integer",
        ),
        ("", "color = vec4(float(count & 3));", "the operator &"),
        ("", "color = vec4(table[count]);", "a non-constant index"),
        (
            "",
            "color = vec4(1.0); for (int i = 0; i < count; i++) color *= local.x;",
            "a loop without a constant bound on its iterations",
        ),
        (
            "",
            "switch (count) { case 0: color = vec4(1.0); break; default: color = vec4(0.5); }",
            "`switch`",
        ),
        ("", "color = vec4(tanh(local.x));", "the function tanh"),
        (
            "",
            "color = vec4(float(min(count, 3)));",
            "the function min of integers",
        ),
        (
            "uniform sampler3D volume;",
            "color = texture(volume, local);",
            "the type sampler3d",
        ),
        (
            "layout(std140) uniform Block { vec4 tint; };",
            "color = tint;",
            "the block `Block`",
        ),
        (
            "uniform sampler2D map;",
            "color = texelFetch(map, ivec2(1), 0) + texture(map, local.xy);",
            "texelFetch of `map`, which is also sampled",
        ),
    ] {
        let said = refused(declared, body);
        assert!(said.starts_with(what), "{body}: {said}");
    }
}
