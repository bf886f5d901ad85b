//! `docs/passes/NAME.md` is what a pass's own source says, its parameters, and an example that is
//! run here: `UPDATE_PAGES=1` writes the pages.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use preshade::unstable::emit::{self, Target};
use preshade::unstable::front::{Options, Source, parse};
use preshade::unstable::parameters::parameters;
use preshade::unstable::passes::PASSES;
use preshade::unstable::passes::contract::Contract;
use preshade::unstable::passes::pass::{AnyPass, Facts};
use preshade::unstable::passes::plan::Plan;
use preshade::unstable::passes::state::MaterialState;
use preshade::unstable::recipe::Recipe;

/// A material that every pass has something to do with: cut out by a texture, lit by a wave that
/// bends within a triangle.
const EXAMPLE: &str = "\
@group(0) @binding(0) var<uniform> camera: mat4x4<f32>;
@group(0) @binding(1) var leaf: texture_2d<f32>;
@group(0) @binding(2) var leaf_sampler: sampler;
@group(0) @binding(3) var<uniform> fog: f32;

struct Out {
    @builtin(position) position: vec4<f32>,
    @location(0) world: vec3<f32>,
    @location(1) uv: vec2<f32>,
}

@vertex
fn vs(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> Out {
    return Out(camera * vec4<f32>(position, 1.0), position, uv);
}

@fragment
fn fs(in: Out) -> @location(0) vec4<f32> {
    let texel = textureSample(leaf, leaf_sampler, in.uv);
    if (texel.a < 0.5) {
        discard;
    }
    var wave = 0.0;
    for (var i = 0; i < 4; i++) {
        wave += sin(in.world.x * f32(i + 1)) * cos(in.world.y);
    }
    var color = texel.rgb * wave;
    if (fog > 0.0) {
        color = mix(color, vec3<f32>(0.5), exp(-fog * in.position.w));
    }
    return vec4<f32>(color, 1.0);
}
";

/// One that blends: two sides of a rock, by how much each faces the viewer.
const BLEND: &str = "\
@group(0) @binding(0) var<uniform> camera: mat4x4<f32>;
@group(0) @binding(1) var rock: texture_2d<f32>;
@group(0) @binding(2) var rock_sampler: sampler;

struct Out {
    @builtin(position) position: vec4<f32>,
    @location(0) world: vec3<f32>,
    @location(1) normal: vec3<f32>,
}

@vertex
fn vs(@location(0) position: vec3<f32>, @location(1) normal: vec3<f32>) -> Out {
    return Out(camera * vec4<f32>(position, 1.0), position, normal);
}

@fragment
fn fs(in: Out) -> @location(0) vec4<f32> {
    let sharp = pow(abs(in.normal.xy), vec2<f32>(8.0));
    let weights = sharp / (sharp.x + sharp.y);
    let side = textureSample(rock, rock_sampler, in.world.zy);
    let top = textureSample(rock, rock_sampler, in.world.xz);
    return side * weights.x + top * weights.y;
}
";

/// The example of a pass, and its name.
fn example(name: &str) -> (&'static str, &'static str) {
    match name {
        "skip-taps" => ("rock", BLEND),
        _ => ("leaf", EXAMPLE),
    }
}

/// The command that draws what a pass does to a scene: `scripts/pass-pictures.sh` runs it. What to
/// see there comes second.
fn picture(name: &str) -> (&'static str, &'static str) {
    match name {
        "depth-prepass" => (
            "preshade verify fixtures/scenes/shrine.toml --camera wall --size 256x144 --frames 1 --order front-to-back --pass depth-prepass",
            "a wall that hides a shrine: no pixel differs, and each is shaded once instead of 3.2 times",
        ),
        "early-discard" => (
            "preshade verify fixtures/scenes/late-depth.toml --size 256x144 --frames 1 --order front-to-back --pass early-discard",
            "five layers that write depth, which hardware cannot test early: each pixel is shaded once instead of five times",
        ),
        "shadow" => (
            "preshade verify fixtures/scenes/lit-room.toml --size 256x144 --frames 1 --order front-to-back --pass shadow",
            "the main pass is as it was; what is new is drawn under the light alone",
        ),
        "hoist" => (
            "preshade verify fixtures/scenes/teapot-specular.toml --camera article --size 240x220 --frames 1 --pass hoist:budget=0.05",
            "a highlight computed at the vertices: it is off where it bends within a triangle",
        ),
        "tessellate" => (
            "preshade verify fixtures/scenes/teapot-specular.toml --camera article --size 240x220 --frames 1 --variant hoist:budget=0.05,tessellate:level=4",
            "the highlight of `hoist` at sixteen times the triangles: less is off",
        ),
        "specialize" => (
            "preshade verify fixtures/scenes/museum.toml --size 256x144 --frames 1 --order front-to-back --pass specialize",
            "one shader for all exhibits, a version for each kind: the same picture",
        ),
        "skip-taps" => (
            "preshade verify fixtures/scenes/terrain-triplanar.toml --camera slope --size 256x144 --frames 1 --pass skip-taps:budget=0.01",
            "a slope between two sides of its texture: off by two steps at most where a third one was left out",
        ),
        "trim-loop" => (
            "preshade verify fixtures/scenes/teapot-noise.toml --camera article --size 240x220 --frames 1 --pass trim-loop:budget=0.05",
            "noise without its last octave: fine detail is missing everywhere, by four steps at most",
        ),
        "visibility-buffer" => (
            "preshade verify fixtures/scenes/grass.toml --size 256x144 --frames 1 --order front-to-back --set instances=20000 --pass visibility-buffer:select=id",
            "a meadow: each pixel is shaded once, after it is known which blade it shows",
        ),
        other => panic!("{other} has no picture: name one here and run scripts/pass-pictures.sh"),
    }
}

/// Most bytes of a picture.
const PICTURE: u64 = 60_000;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The steps that show a pass: those it needs before it, and its own.
fn recipe(name: &str) -> Vec<&'static str> {
    match name {
        "specialize" => vec!["specialize:set=fog=0"],
        "skip-taps" => vec!["skip-taps:budget=0.01"],
        "trim-loop" => vec!["trim-loop:budget=0.05"],
        "hoist" => vec!["hoist:budget=0.05"],
        "tessellate" => vec!["hoist:budget=0.05", "tessellate:level=4"],
        "visibility-buffer" => vec!["visibility-buffer:budget=0.02"],
        other => vec![
            PASSES
                .iter()
                .map(|p| p.info().name)
                .find(|n| *n == other)
                .unwrap(),
        ],
    }
}

/// The comment that a pass's file opens with, as Markdown: links into the code are left as code,
/// and left out where they stand in parentheses for readers of the code.
fn comment(name: &str) -> String {
    let file = name.replace('-', "_");
    let folder = root().join("passes/src/transforms");
    let candidates = [
        folder.join(format!("{file}.rs")),
        folder.join(&file).join("mod.rs"),
    ];
    let path = candidates.iter().find(|p| p.is_file()).unwrap();
    let text = fs::read_to_string(path).unwrap();
    let lines = text.lines().take_while(|l| l.starts_with("//!"));
    let lines = lines.map(|l| l.trim_start_matches("//!").strip_prefix(' ').unwrap_or(""));
    let text = lines.collect::<Vec<_>>().join("\n");
    let mut read = String::new();
    let mut rest = &text[..];
    while let Some(at) = rest.find(" ([`") {
        let end = at + rest[at..].find(')').unwrap() + 1;
        let inner = &rest[at + 2..end - 1];
        let links = inner
            .split(", ")
            .all(|l| l.starts_with("[`") && l.ends_with("`]"));
        read.push_str(&rest[..if links { at } else { end }]);
        rest = &rest[end..];
    }
    read.push_str(rest);
    read.replace("[`", "`")
        .replace("`]", "`")
        .replace("[guard](crate::guard::Guard)", "guard")
}

fn promise(contract: &Contract) -> String {
    let given = contract
        .given()
        .iter()
        .map(|a| serde_json::to_value(a).unwrap());
    let given: Vec<String> = given
        .map(|a| format!("`{}`", a.as_str().unwrap()))
        .collect();
    let budgets: Vec<String> = contract.budgets().iter().map(ToString::to_string).collect();
    let off = match budgets.is_empty() {
        true => String::new(),
        false => format!(" ({})", budgets.join(", ")),
    };
    let given = match given.is_empty() {
        true => String::new(),
        false => format!(", given {}", given.join(", ")),
    };
    format!("`{}`{off}{given}", contract.kind())
}

fn page(pass: &dyn AnyPass) -> String {
    let info = pass.info();
    let mut text = format!(
        "<!-- Made of passes/src/transforms by `UPDATE_PAGES=1 cargo test --test it pass_pages`; edits will be lost. -->\n# {}\n\n{}\n\n",
        info.name,
        comment(info.name)
    );
    writeln!(
        text,
        "Take it where {}.\n\nIt hurts {}.\n\nSource: {}.\n",
        info.when.trim_end_matches('.'),
        info.hurts.trim_end_matches('.'),
        info.source.trim_end_matches('.')
    )
    .unwrap();
    let (command, seen) = picture(info.name);
    let file = format!("../images/passes/{}.png", info.name);
    writeln!(
        text,
        "![Original, variant and their difference times 16, and where it matters how often each pixel is shaded: {seen}]({file})\n\n`{command}`: {seen}.\n"
    )
    .unwrap();
    let bytes = fs::metadata(root().join("docs/passes").join(&file))
        .unwrap_or_else(|e| panic!("{file}: {e}: scripts/pass-pictures.sh draws it"))
        .len();
    assert!(bytes <= PICTURE, "{file} has {bytes} bytes");
    text.push_str("## Parameters\n\n");
    for p in parameters(pass) {
        let default = p.default.as_ref().filter(|d| !d.is_null());
        let default = default.map_or(String::new(), |d| {
            format!(
                " Default: `{}`.",
                d.as_str().map_or(d.to_string(), str::to_owned)
            )
        });
        writeln!(
            text,
            "- `{}`: {}{default}",
            p.name,
            p.what.replace('\n', " ")
        )
        .unwrap();
        for choice in &p.choices {
            writeln!(
                text,
                "  - `{}`: {}",
                choice.value,
                choice.what.replace('\n', " ")
            )
            .unwrap();
        }
    }
    let steps = recipe(info.name);
    let (options, state) = (Options::default(), MaterialState::default());
    let (name, source) = example(info.name);
    let file = format!("{name}.wgsl");
    let parsed = parse(&[Source::new(file, source)], &options).unwrap();
    let original = Plan::original(
        name,
        parsed.program,
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &state,
    );
    let applied = Recipe::parse(&steps)
        .unwrap()
        .apply(&original, &Facts::default());
    let plan = applied.unwrap_or_else(|r| panic!("{}: {r}", info.name));
    let flags: Vec<String> = steps.iter().map(|s| format!("--pass {s}")).collect();
    write!(
        text,
        "\n## Example\n\n`preshade rewrite {name}.wgsl {}` of\n\n```wgsl\n{source}```\n\n",
        flags.join(" ")
    )
    .unwrap();
    writeln!(
        text,
        "promises {}; the passes are:\n",
        promise(&plan.contract)
    )
    .unwrap();
    text.push_str(
        "| pass | vertex | fragment | depth compare | writes depth |\n|---|---|---|---|---|\n",
    );
    for p in &plan.passes {
        let depth = p.depth.as_ref();
        writeln!(
            text,
            "| {} | `{}` | {} | {} | {} |",
            p.role.name(),
            p.vertex,
            p.fragment
                .as_ref()
                .map_or("none".to_owned(), |f| format!("`{f}`")),
            depth.map_or("none".to_owned(), |d| format!("{:?}", d.compare)),
            depth.map_or("no", |d| if d.write { "yes" } else { "no" }),
        )
        .unwrap();
    }
    for file in emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()).unwrap() {
        let content = String::from_utf8(file.bytes).unwrap();
        let is_original = content == source;
        if file.name.ends_with(".wgsl") && !is_original {
            write!(
                text,
                "\n<details><summary>{}</summary>\n\n```wgsl\n{content}```\n\n</details>\n",
                file.name
            )
            .unwrap();
        }
    }
    text
}

#[test]
fn each_pass_has_the_page_that_its_source_makes() {
    let folder = root().join("docs/passes");
    let mut expected: Vec<PathBuf> = Vec::new();
    for pass in PASSES {
        let path = folder.join(format!("{}.md", pass.info().name));
        let made = page(*pass);
        if std::env::var_os("UPDATE_PAGES").is_some() {
            fs::create_dir_all(&folder).unwrap();
            fs::write(&path, &made).unwrap();
        }
        let there = fs::read_to_string(&path).unwrap_or_default();
        assert!(
            there == made,
            "{} is not what its source says: UPDATE_PAGES=1 cargo test --test it pass_pages",
            path.display()
        );
        expected.push(path);
    }
    let mut there: Vec<PathBuf> = fs::read_dir(&folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    there.sort();
    expected.sort();
    assert_eq!(there, expected);
}
