//! GLSL ES 1.00, for WebGL 1: what is written of every fixture is accepted by glslang, or refused by the name of what the language lacks; and the packed prologue draws what the
//! author's text does.
#![cfg(all(feature = "glsl", feature = "spirv"))]
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

mod accept;

use std::collections::BTreeMap;
use std::path::Path;

use preshade::emit::{self, File, PlanFile, Target};
use preshade::front::{self, Color, Options, Source};
use preshade::passes::pass::Facts;
use preshade::passes::plan::Plan;
use preshade::passes::state::MaterialState;
use preshade::recipe::Recipe;

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

fn emitted(plan: &Plan) -> Result<Vec<File>, emit::Error> {
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
                Err(emit::Error::Inexpressible { what, .. }) => {
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

#[test]
fn what_the_language_lacks_is_named() {
    let vertex = "#version 300 es\nin vec3 position;\nuniform int count;\nuniform float table[4];\nout vec3 local;\nvoid main() { local = position; gl_Position = vec4(position, 1.0); }\n";
    let refused = |declared: &str, body: &str| {
        let fragment = format!(
            "#version 300 es\nprecision highp float;\nin vec3 local;\nuniform int count;\nuniform float table[4];\nout vec4 color;\n{declared}\nvoid main() {{ {body} }}\n"
        );
        let sources = [
            Source::new("a.vert", vertex),
            Source::new("a.frag", fragment),
        ];
        match emitted(&original("a", &sources)) {
            Err(emit::Error::Inexpressible { what, .. }) => what,
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
        (
            "",
            "color = vec4(table[count]);",
            "an index that is no constant",
        ),
        (
            "",
            "color = vec4(1.0); for (int i = 0; i < count; i++) color *= local.x;",
            "a loop that is not seen to end",
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
            "texelFetch of `map` beside samples",
        ),
    ] {
        let said = refused(declared, body);
        assert!(said.starts_with(what), "{body}: {said}");
    }
}
