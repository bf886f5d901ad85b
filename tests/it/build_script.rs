//! What a `build.rs` gets: only what differs is written, only what was read is told, a lock is
//! obeyed or the original is shipped, and nothing depends on what was refused.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use preshade_compiler::build_script::{BuildConfig, BuildError, Built, configure};
use preshade_compiler::front::{Source, parse};
use preshade_compiler::lock::{Inputs, Lock, Locked};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::state::{Blend, ColorTarget, CompareFunction, DepthFormat, MaterialState};
use shader_text::options::Options;

const SHADER: &str = include_str!("../../fixtures/shaders/toon.wgsl");

/// A package's folder: shaders, and what cargo gives for output.
struct Package(PathBuf);

impl Package {
    fn new(name: &str) -> Self {
        let root = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("build-{name}"));
        let _ = fs::remove_dir_all(&root);
        fs::create_dir_all(root.join("out")).unwrap();
        fs::write(root.join("toon.wgsl"), SHADER).unwrap();
        Self(root)
    }

    fn build(&self, builder: BuildConfig) -> Result<Built, BuildError> {
        let shader = self.0.join("toon.wgsl");
        builder.out_dir(self.0.join("out")).build(&[&shader])
    }

    fn module(&self) -> String {
        fs::read_to_string(self.0.join("out/toon.rs")).unwrap()
    }

    fn names(&self, variant: &str) -> Vec<String> {
        let folder = fs::read_dir(self.0.join("out/toon").join(variant)).unwrap();
        let mut names: Vec<String> = folder
            .map(|f| f.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    /// Every file for output, with its time.
    fn output(&self) -> BTreeMap<PathBuf, (Vec<u8>, SystemTime)> {
        fn walk(folder: &Path, all: &mut BTreeMap<PathBuf, (Vec<u8>, SystemTime)>) {
            for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
                match entry.path() {
                    path if path.is_dir() => walk(&path, all),
                    path => {
                        let modified = entry.metadata().unwrap().modified().unwrap();
                        all.insert(path.clone(), (fs::read(&path).unwrap(), modified));
                    }
                }
            }
        }
        let mut all = BTreeMap::new();
        walk(&self.0.join("out"), &mut all);
        all
    }

    /// Writes a lock of `recipe` for the shader as it is now.
    fn lock(&self, recipe: &[&str], facts: &Facts) {
        let (options, state) = (Options::default(), MaterialState::default());
        let text = fs::read_to_string(self.0.join("toon.wgsl")).unwrap();
        let sources = [Source::new("toon.wgsl", text)];
        let parsed = parse(&sources, &options).unwrap();
        let inputs = Inputs::of(&parsed, &options.defines, &state);
        let fragment = parsed.fragment.as_deref();
        let plan = Plan::original("toon", parsed.program, &parsed.vertex, fragment, &state);
        let recipe = Recipe::parse(recipe).unwrap();
        let locked = Locked::resolve(&plan, &recipe, facts, inputs, None).unwrap();
        let lock = Lock {
            materials: BTreeMap::from([("toon".to_owned(), locked)]),
            ..Lock::default()
        };
        assert!(lock.write(&self.0.join("preshade.lock")).unwrap());
    }
}

#[test]
fn a_pass_that_needs_no_scene_is_made() {
    let package = Package::new("pass");
    let built = package.build(configure().pass("depth-prepass")).unwrap();
    assert_eq!(built.warnings, [""; 0]);
    assert_eq!(built.read, [package.0.join("toon.wgsl")]);
    assert_eq!(
        package.names("variant"),
        ["toon.main.wgsl", "toon.plan.json", "toon.prepass.wgsl"]
    );
    assert_eq!(
        package.names("original"),
        ["toon.main.wgsl", "toon.plan.json"]
    );
    let module = package.module();
    assert!(module.contains("pub static PREPASS: Pass"));
    assert!(module.contains("pub use variant::*;"));
    // Nothing of this machine, and nothing of cargo: the module finds its files from where it lies.
    assert!(module.contains("include_str!(\"toon/variant/toon.prepass.wgsl\")"));
    assert!(!module.contains("OUT_DIR"));
    assert!(!module.contains(env!("CARGO_TARGET_TMPDIR")));
}

#[test]
fn nothing_is_written_twice_and_the_bytes_are_the_same_everywhere() {
    let package = Package::new("twice");
    let make = || configure().pass("depth-prepass").emit(Target::Wgsl);
    let first = package.build(make()).unwrap();
    assert!(first.written.len() > 4);
    let before = package.output();
    assert!(package.build(make()).unwrap().written.is_empty());
    assert_eq!(package.output(), before);
    // Without the stamp all is made anew, to the same bytes.
    fs::remove_file(package.0.join("out/toon/preshade.stamp")).unwrap();
    assert!(package.build(make()).unwrap().written.is_empty());
    let elsewhere = Package::new("elsewhere");
    elsewhere.build(make()).unwrap();
    let names = |p: &Package| -> Vec<(PathBuf, Vec<u8>)> {
        let all = p.output().into_iter();
        let all = all.filter(|(path, _)| !path.ends_with("preshade.stamp"));
        let below = |path: &Path| path.strip_prefix(&p.0).unwrap().to_owned();
        all.map(|(path, (bytes, _))| {
            // The text names the file by the path that was given, which is relative in a build
            // script.
            let text = String::from_utf8_lossy(&bytes).replace(&p.0.display().to_string(), "");
            (below(&path), text.into_bytes())
        })
        .collect()
    };
    assert_eq!(names(&package), names(&elsewhere));
    // A file that was lost is made again.
    fs::remove_file(package.0.join("out/toon/variant/toon.prepass.wgsl")).unwrap();
    assert_eq!(package.build(make()).unwrap().written.len(), 1);
}

#[test]
fn without_a_pass_there_is_what_needs_no_scene() {
    let package = Package::new("default");
    let built = package.build(configure()).unwrap();
    assert_eq!(built.warnings, [""; 0]);
    let module = package.module();
    let tests = |name: &str| {
        let of = module.split(&format!("pub mod {name} {{")).nth(1).unwrap();
        of.split("SELF_TEST: Option<SelfTest> = ")
            .nth(1)
            .unwrap()
            .starts_with("Some(")
    };
    assert!(tests("depth_prepass") && !tests("original"));
    // Nothing that a host could draw at load tells whether these hold: their passes say why.
    assert!(!tests("early_discard") && !tests("shadow"));
    for (name, recipe) in [
        ("original", "as its author wrote it"),
        ("variant", "as its author wrote it"),
        ("depth_prepass", "depth-prepass:"),
        ("early_discard", "early-discard:"),
        ("shadow", "shadow:"),
    ] {
        let at = module.find(&format!("pub mod {name} {{")).unwrap();
        let after = &module[at..];
        let said = after.split("RECIPE: &str = \"").nth(1).unwrap();
        assert!(said.starts_with(recipe), "{name}: {}", &said[..40]);
    }
}

#[test]
fn an_early_discard_under_a_read_only_attachment_has_a_self_test() {
    let package = Package::new("readonly");
    package.lock(&[], &Facts::without_ties());
    let readonly = ["early-discard:attachment=readonly"];
    let built = package.build(configure().variant("readonly", readonly));
    assert_eq!(built.unwrap().warnings, [""; 0]);
    let module = package.module();
    let of = module.split("pub mod readonly {").nth(1).unwrap();
    let test = of.split("SELF_TEST: Option<SelfTest> = ").nth(1).unwrap();
    let test = test.lines().next().unwrap();
    assert!(test.starts_with("Some("), "{test}");
    // The pre-pass lays what the main pass samples; then it must nowhere lie in front of what the
    // main pass leaves.
    let draws: Vec<&str> = test.split("TestDraw { pass: &").skip(1).collect();
    let passes: Vec<&str> = draws.iter().map(|d| d.split(',').next().unwrap()).collect();
    assert_eq!(passes, ["PREPASS", "MAIN", "PREPASS"]);
    assert!(draws[2].contains("must_pass: false"), "{test}");
}

#[test]
fn what_needs_a_scene_is_left_out_and_told() {
    let package = Package::new("scene");
    let asked = configure()
        .pass("depth-prepass:form=equal")
        .variant("moved", ["hoist:budget=0.05"]);
    let built = package.build(asked.clone()).unwrap();
    let [equal, moved] = &built.warnings[..] else {
        panic!("{:?}", built.warnings);
    };
    assert!(
        equal.contains(
            "toon.wgsl: `depth-prepass:form=equal` is left out of `variant`: it depends on there \
             being no depth ties"
        ),
        "{equal}"
    );
    assert!(
        moved.contains("is left out of `moved`: it promises no more than flip_mean at most 0.05"),
        "{moved}"
    );
    // What no lock can bring is not advised.
    assert!(moved.contains("keeps one recipe a material"), "{moved}");
    assert_eq!(
        package.names("variant"),
        ["toon.main.wgsl", "toon.plan.json"]
    );
    // Told again by a build that had nothing to do.
    let again = package.build(asked).unwrap();
    assert_eq!((again.written.len(), again.warnings), (0, built.warnings));
}

#[test]
fn a_refusal_is_a_warning_in_one_line_and_the_names_stay() {
    let package = Package::new("refused");
    let mut target = ColorTarget::opaque("rgba8unorm");
    target.blend = Some(Blend::ALPHA);
    let state = MaterialState {
        targets: vec![Some(target)],
        ..MaterialState::default()
    };
    let built = package.build(configure().state(state).pass("depth-prepass"));
    let [warning] = &built.unwrap().warnings[..] else {
        panic!("one warning");
    };
    assert!(
        warning.contains("depth-prepass does not apply [blended]"),
        "{warning}"
    );
    assert!(!warning.contains('\n'));
    let module = package.module();
    let variant = module.split("pub mod variant {").nth(1).unwrap();
    assert!(variant.contains("pub static MAIN: Pass") && !variant.contains("pub static PREPASS"));
    assert!(
        variant.contains("LEFT_OUT: &[&str] = &[\"depth-prepass[blended]"),
        "{variant}"
    );
}

#[test]
fn a_lock_is_obeyed() {
    let package = Package::new("locked");
    package.lock(&["depth-prepass:form=equal"], &Facts::without_ties());
    let built = package.build(configure().pass("early-discard")).unwrap();
    assert_eq!(built.warnings, [""; 0]);
    assert_eq!(
        built.read,
        [package.0.join("toon.wgsl"), package.0.join("preshade.lock")]
    );
    let variant = package.module();
    let variant = variant.split("pub mod variant {").nth(1).unwrap();
    assert!(variant.contains("depth-prepass:") && variant.contains("form=equal"));
    assert!(variant.contains("wgpu::CompareFunction::Equal"));
}

#[test]
fn what_a_lock_knows_of_a_scene_holds_for_variants_with_names() {
    let package = Package::new("facts");
    let asked = || configure().variant("equal", ["depth-prepass:form=equal"]);
    assert_eq!(package.build(asked()).unwrap().warnings.len(), 1);
    package.lock(&[], &Facts::without_ties());
    assert_eq!(package.build(asked()).unwrap().warnings, [""; 0]);
    let module = package.module();
    let equal = module.split("pub mod equal {").nth(1).unwrap();
    assert!(equal.contains("wgpu::CompareFunction::Equal"));
}

#[test]
fn a_comment_or_other_line_ends_leave_a_lock_fresh() {
    let package = Package::new("comment");
    package.lock(&["depth-prepass"], &Facts::default());
    let edited = SHADER.replace("discard;", "discard; // edited");
    for text in [
        edited.replace('\n', "\r\n"),
        format!("// c\n\n{edited}// c"),
    ] {
        fs::write(package.0.join("toon.wgsl"), text).unwrap();
        let built = package.build(configure()).unwrap();
        assert_eq!(built.warnings, [""; 0]);
        assert!(
            package
                .names("variant")
                .contains(&"toon.prepass.wgsl".into())
        );
    }
}

#[test]
fn a_lock_of_a_later_preshade_ships_the_original() {
    let package = Package::new("later");
    package.lock(&["depth-prepass"], &Facts::default());
    let path = package.0.join("preshade.lock");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("preshade.lock.v1", "preshade.lock.v2")).unwrap();
    let built = package.build(configure().pass("depth-prepass")).unwrap();
    let [warning] = &built.warnings[..] else {
        panic!("{:?}", built.warnings);
    };
    assert!(
        warning.contains("written by another preshade (preshade.lock.v2)")
            && warning
                .ends_with("`preshade plan SCENE --one --lock` again. The original is shipped"),
        "{warning}"
    );
    assert_eq!(
        package.names("variant"),
        ["toon.main.wgsl", "toon.plan.json"]
    );
}

#[test]
fn a_lock_of_a_later_preshade_still_says_how_the_material_is_drawn() {
    let package = Package::new("later-state");
    package.lock(&["depth-prepass"], &Facts::default());
    let path = package.0.join("preshade.lock");
    // Two vertex entry points, of which the lock says one; no culling.
    let vertex = SHADER.split("@vertex").nth(1).unwrap();
    let vertex = vertex.split("\n}\n").next().unwrap();
    let second = vertex.replacen("fn vs_main", "fn vs_other", 1);
    fs::write(
        package.0.join("toon.wgsl"),
        format!("{SHADER}\n@vertex{second}\n}}\n"),
    )
    .unwrap();
    let text = fs::read_to_string(&path).unwrap();
    let mut lock: serde_json::Value = serde_json::from_str(&text).unwrap();
    lock["materials"]["toon"]["inputs"]["state"]["primitive"]["cull"] = "none".into();
    let own = lock.clone();
    let write = |lock: &serde_json::Value| fs::write(&path, lock.to_string()).unwrap();
    let drawn = || {
        let module = package.module();
        assert!(module.contains("vertex: \"vs_main\"") && !module.contains("vs_other"));
        assert!(module.contains("cull_mode: None") && !module.contains("cull_mode: Some"));
    };
    lock["schema"] = "preshade.lock.v2".into();
    write(&lock);
    assert_eq!(package.build(configure()).unwrap().warnings.len(), 1);
    drawn();
    // Of a state with what is not known here nothing is guessed.
    lock["materials"]["toon"]["inputs"]["state"]["primitive"]["cull"] = "both".into();
    write(&lock);
    let error = package.build(configure()).unwrap_err();
    assert!(matches!(error, BuildError::State(_)), "{error}");
    let said = configure()
        .state(MaterialState::default())
        .vertex("vs_main");
    assert_eq!(package.build(said).unwrap().warnings.len(), 1);
    // Nor of what is no state of this material's.
    lock["materials"] = serde_json::json!([]);
    write(&lock);
    assert!(matches!(
        package.build(configure()),
        Err(BuildError::State(_))
    ));
    // A key of a material that a later preshade wrote is nothing to the others.
    let mut mixed = own.clone();
    let mut other = own["materials"]["toon"].clone();
    other["inputs"]["tool"] = "preshade 99.0.0".into();
    other["later"] = true.into();
    mixed["materials"]["stone"] = other.clone();
    write(&mixed);
    let built = package.build(configure()).unwrap();
    assert!(
        built.warnings[0].contains("toon.wgsl was edited"),
        "{:?}",
        built.warnings
    );
    drawn();
    mixed["materials"]["toon"] = other;
    write(&mixed);
    let built = package.build(configure()).unwrap();
    assert!(built.warnings[0].contains("written by another preshade (preshade 99.0.0)"));
    drawn();
}

#[test]
fn a_lock_holds_for_the_only_entry_points_by_their_names_too() {
    let package = Package::new("entry");
    package.lock(&["depth-prepass"], &Facts::default());
    let builder = configure().vertex("vs_main").fragment("fs_main");
    assert_eq!(package.build(builder).unwrap().warnings, [""; 0]);
    let variant = package.module();
    let variant = variant.split("pub mod variant {").nth(1).unwrap();
    assert!(variant.contains("pub static PREPASS"));
    // An entry point that was renamed is an edit like others.
    let renamed = SHADER.replace("vs_main", "vertex");
    fs::write(package.0.join("toon.wgsl"), renamed).unwrap();
    let built = package.build(configure()).unwrap();
    assert!(built.warnings[0].contains("toon.wgsl was edited"));
}

#[test]
fn a_lock_of_the_same_file_by_another_name_is_told() {
    let package = Package::new("renamed");
    package.lock(&["depth-prepass"], &Facts::default());
    let built = package.build(configure().name("cel")).unwrap();
    let [warning] = &built.warnings[..] else {
        panic!("{:?}", built.warnings);
    };
    assert!(
        warning.ends_with(
            "preshade.lock says nothing of `cel`, but of `toon`, which is of the same file: to \
             obey it say `.name(\"toon\")`"
        ),
        "{warning}"
    );
    // Of another file it is none of its business.
    fs::write(package.0.join("other.wgsl"), SHADER).unwrap();
    let builder = configure().out_dir(package.0.join("out"));
    let built = builder.build(&[&package.0.join("other.wgsl")]).unwrap();
    assert_eq!(built.warnings, [""; 0]);
}

#[test]
fn a_lock_holds_for_what_the_shader_was_preprocessed_with() {
    let package = Package::new("defines");
    let lock = |defines: &[(&str, &str)]| {
        package.lock(&["depth-prepass"], &Facts::default());
        let path = package.0.join("preshade.lock");
        let mut lock = Lock::read(&path).unwrap().unwrap();
        let own = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
        lock.materials.get_mut("toon").unwrap().inputs.defines = defines.iter().map(own).collect();
        lock.write(&path).unwrap();
    };
    lock(&[("FOG", "1")]);
    let built = package.build(configure().define("FOG", "1")).unwrap();
    assert_eq!(built.warnings, [""; 0]);
    let built = package.build(configure().define("FOG", "2")).unwrap();
    assert!(built.warnings[0].contains("other definitions (FOG)"));
}

#[test]
fn what_holds_for_some_values_alone_is_no_ones_default() {
    let package = Package::new("guard");
    let step = "let rim = step(toon.rim, 1.0 - max(dot(n, v), 0.0));";
    let branch =
        "var rim = 0.0; if toon.rim > 0.0 { rim = step(toon.rim, 1.0 - max(dot(n, v), 0.0)); }";
    assert!(SHADER.contains(step));
    fs::write(package.0.join("toon.wgsl"), SHADER.replace(step, branch)).unwrap();
    package.lock(&["specialize:set=toon.rim=0"], &Facts::default());
    let still = ["specialize:set=toon.rim=0"];
    let built = package
        .build(configure().variant("rimless", still))
        .unwrap();
    assert_eq!(built.warnings, [""; 0]);
    let module = package.module();
    let of = |name: &str| {
        let after = module.split(&format!("pub mod {name} {{")).nth(1).unwrap();
        after
            .split("\n/// The material ")
            .next()
            .unwrap()
            .to_owned()
    };
    for name in ["variant", "rimless"] {
        let text = of(name);
        assert!(
            text.contains(
                "pub const GUARD: &[Assumed] = &[Assumed { \
                 name: \"toon.rim\", place: NumberPlace::Uniform { \
                 group: 1, binding: 0, offset: 20 }, ty: ScalarType::F32, low: 0.0, high: 0.0 }];"
            ),
            "{text}"
        );
        assert!(text.contains("\nstatic PASSES") && text.contains("\nstatic MAIN"));
        assert!(!text.contains("pub static PASSES") && !text.contains("pub static MAIN"));
        assert!(text.contains("CHOICES: &[&Variant] = &[&VARIANT, &super::original::VARIANT]"));
    }
    assert!(of("original").contains("pub static PASSES"));
    assert!(of("original").contains("GUARD: &[Assumed] = &[]"));
    assert!(!module.contains("pub use variant::*"));
    assert!(module.contains("pub use original::*;"));
    assert!(
        module.contains("pub use variant::{CHOICES, CONSTANTS, GUARD, guard_holds, variant_for};")
    );
}

#[test]
fn compute_passes_have_the_constants_and_immediate_data_of_the_material() {
    let package = Package::new("compute");
    let text = "
override gain: f32;
@id(7) override bias: f32 = 0.5;
var<immediate> tint: vec4<f32>;
@group(0) @binding(0) var<uniform> object: mat4x4<f32>;
struct Out { @builtin(position) clip: vec4<f32>, @location(0) @interpolate(flat) color: vec4<f32> }
@vertex fn vs(@location(0) p: vec4<f32>, @location(1) c: vec4<f32>) -> Out { \
    return Out(object * p, c); }
@fragment fn fs(in: Out) -> @location(0) vec4<f32> { return in.color * gain + bias * tint; }";
    fs::write(package.0.join("toon.wgsl"), text).unwrap();
    let resolved = ["visibility-buffer:form=compute"];
    let built = package
        .build(configure().variant("resolved", resolved))
        .unwrap();
    assert_eq!(built.warnings, [""; 0]);
    let module = package.module();
    let of = module.split("pub mod resolved {").nth(1).unwrap();
    let compute = of.split("static COMPUTE: &[Compute] = ").nth(1).unwrap();
    let compute = compute.lines().next().unwrap();
    let shades: Vec<&str> = compute
        .split("Compute {")
        .filter(|c| c.contains("resolve"))
        .collect();
    for said in [
        "immediate_size: 16, overrides: &[Override { key: \"gain\", is_needed: true }, Override { \
         key: \"7\", is_needed: false }], unread_overrides: &[], guard: GUARD",
        "wgpu::Features::IMMEDIATES",
        "limits.max_immediate_size = limits.max_immediate_size.max(16)",
    ] {
        assert!(shades.iter().any(|c| c.contains(said)), "{said}\n{compute}");
    }
    // What reads none of them says so.
    let others = compute.split("Compute {").skip(1);
    let others = others.filter(|c| c.contains(" overrides: &[], "));
    others.for_each(|c| {
        assert!(
            c.contains("immediate_size: 0, overrides: &[], unread_overrides: &[\"7\", \"gain\"]"),
            "{c}"
        );
    });
}

/// Constants that a pipeline may set, of which some decide others.
const OVERRIDES: &str = "
override K: f32 = 0.5;
override FANCY: bool = false;
@id(7) override N: u32 = 4u;
override M: u32 = N * 2u;
@group(0) @binding(0) var<uniform> u: vec4<f32>;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {
    var c = u * K;
    if FANCY { c += p; }
    for (var i = 0u; i < M; i++) { c *= 2.0; }
    return c;
}";

#[test]
fn constants_that_a_variant_has_decided_are_told_and_checked() {
    let package = Package::new("constants");
    fs::write(package.0.join("toon.wgsl"), OVERRIDES).unwrap();
    let one = ["specialize:set=N=1+K=0.75+FANCY=false"];
    let built = package.build(configure().variant("one", one)).unwrap();
    assert_eq!(built.warnings, [""; 0]);
    let module = package.module();
    let one = module.split("pub mod one {").nth(1).unwrap();
    for said in [
        "name: \"K\", place: NumberPlace::Override { key: \"K\", is_default: false }, ty: \
         ScalarType::F32, low: 0.75, high: 0.75",
        // What follows from them needs not be said, nor what is the default.
        "name: \"M\", place: NumberPlace::Override { key: \"M\", is_default: true }, ty: \
         ScalarType::U32, low: 2.0, high: 2.0",
        "name: \"FANCY\", place: NumberPlace::Override { key: \"FANCY\", is_default: true }",
        "name: \"N\", place: NumberPlace::Override { key: \"7\", is_default: false }",
        "CONSTANTS: &[(&str, f64)] = &[(\"K\", 0.75), (\"FANCY\", 0.0), (\"7\", 1.0), (\"M\", \
         2.0)];",
    ] {
        assert!(one.contains(said), "{said}\n{one}");
    }
    let main = one.split("static MAIN: Pass = ").nth(1).unwrap();
    assert!(main.lines().next().unwrap().contains("guard: GUARD"));
    let original = module.split("pub mod original {").nth(1).unwrap();
    assert!(original.contains("CONSTANTS: &[(&str, f64)] = &[];"));
}

#[test]
fn constants_that_are_computed_of_others_are_written() {
    let package = Package::new("computed");
    let text = "
@id(7) override N: u32 = 4u;
override M: u32 = N * 2u;
override EDGE: f32 = clamp(select(-0.5, f32(M + 1u) / 16.0, N > 3u) - 0.25, 0.0, 1.0);
override SOLID: bool = !(N > 2u && EDGE < 1.0);
var<private> most: f32 = EDGE * 2.0;
var<private> least: f32 = 0.25;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {
    if !SOLID && fract(p.x * f32(M)) < EDGE + most + least { discard; }
    return p;
}";
    fs::write(package.0.join("toon.wgsl"), text).unwrap();
    let built = package.build(configure()).unwrap();
    assert_eq!(built.warnings, [""; 0]);
    assert!(package.module().contains("LEFT_OUT: &[&str] = &[];"));
    for file in [
        "depth_prepass/toon.prepass.wgsl",
        "early_discard/toon.main.wgsl",
    ] {
        let written = fs::read_to_string(package.0.join("out/toon").join(file)).unwrap();
        for line in [
            "@id(7) override N: u32 = 4u;",
            "override M: u32 = N * 2u;",
            "override EDGE: f32 = clamp((select(-0.5f, (f32((M + 1u)) / 16f), (N > 3u)) - 0.25f), \
             0f, 1f);",
            "var<private> most: f32 = EDGE * 2f;",
            "var<private> least: f32 = 0.25f;",
        ] {
            assert!(written.contains(line), "{line}\n{written}");
        }
        assert!(written.contains("override SOLID: bool = !("), "{written}");
        assert!(!written.contains("preshade_initialiser"), "{written}");
    }
}

#[test]
fn two_materials_of_one_name_are_an_error() {
    let package = Package::new("same-name");
    for folder in ["a", "b"] {
        fs::create_dir_all(package.0.join(folder)).unwrap();
        fs::write(package.0.join(folder).join("lit.wgsl"), SHADER).unwrap();
    }
    let builder = configure().out_dir(package.0.join("out"));
    builder.compile(package.0.join("a/lit.wgsl")).unwrap();
    // Again is no other material.
    builder.compile(package.0.join("a/lit.wgsl")).unwrap();
    let other = builder.compile(package.0.join("b/lit.wgsl")).unwrap_err();
    let said = other.to_string();
    assert!(said.starts_with("`lit` is compiled twice, of "), "{said}");
    assert!(said.contains("a/lit.wgsl") && said.contains("b/lit.wgsl"));
    let shadow = builder.clone().pass("shadow");
    let otherwise = shadow.compile(package.0.join("a/lit.wgsl")).unwrap_err();
    assert!(matches!(otherwise, BuildError::Taken { .. }), "{otherwise}");
    builder
        .name("lit_b")
        .compile(package.0.join("b/lit.wgsl"))
        .unwrap();
}

#[test]
fn included_files_are_read_and_told() {
    let package = Package::new("included");
    let path = |name: &str| package.0.join(name);
    let vertex =
        "#version 450\nlayout(location = 0) in vec4 p;\nvoid main() { gl_Position = p; }\n";
    let fragment = "#version 450\n#extension GL_GOOGLE_include_directive : require\n\
                    #include \"tint.glsl\"\nlayout(location = 0) out vec4 color;\n\
                    void main() { color = vec4(TINT); }\n";
    fs::write(path("lit.vert"), vertex).unwrap();
    fs::write(path("lit.frag"), fragment).unwrap();
    // A macro alone: no word of the file itself is left in the program.
    fs::write(path("tint.glsl"), "#define TINT 0.25\n").unwrap();
    let build = || {
        let builder = configure().out_dir(path("out"));
        builder
            .build(&[&path("lit.vert"), &path("lit.frag")])
            .unwrap()
    };
    let first = build();
    let tint = path("tint.glsl").canonicalize().unwrap();
    let lit = [path("lit.vert"), path("lit.frag"), tint];
    assert_eq!(first.read, lit);
    let second = build();
    assert_eq!((second.written.len(), &second.read), (0, &first.read));
    fs::write(path("tint.glsl"), "#define TINT 0.75\n").unwrap();
    assert!(!build().written.is_empty());
    // In a folder that is given, likewise.
    fs::create_dir(path("lib")).unwrap();
    fs::rename(path("tint.glsl"), path("lib/tint.glsl")).unwrap();
    let build = || {
        let builder = configure().include(path("lib")).out_dir(path("out"));
        builder.build(&[&path("lit.vert"), &path("lit.frag")])
    };
    let tint = path("lib/tint.glsl").canonicalize().unwrap();
    assert_eq!(
        build().unwrap().read,
        [path("lit.vert"), path("lit.frag"), tint]
    );
    assert!(build().unwrap().written.is_empty());
    fs::write(path("lib/tint.glsl"), "#define TINT 0.5\n").unwrap();
    assert!(!build().unwrap().written.is_empty());
    // One that goes before it now that it is there.
    fs::write(path("tint.glsl"), "#define TINT 1.0\n").unwrap();
    let built = build().unwrap();
    assert!(!built.written.is_empty());
    assert_eq!(built.read[2], path("tint.glsl").canonicalize().unwrap());
}

#[test]
fn imported_modules_are_read_and_told() {
    let package = Package::new("imported");
    let path = |name: &str| package.0.join(name);
    let light = |value: &str| {
        format!("#define_import_path lib::light\nfn dim(x: f32) -> f32 {{ return x * {value}; }}\n")
    };
    let lit = "#import lib::light\n@vertex fn vs(@location(0) p: vec4<f32>) -> \
               @builtin(position) vec4<f32> { return p; }\n\
               @fragment fn fs() -> @location(0) vec4<f32> { \
               return vec4<f32>(light::dim(0.3)); }\n";
    fs::create_dir(path("aaa")).unwrap();
    fs::create_dir(path("target")).unwrap();
    fs::write(path("lit.wgsl"), lit).unwrap();
    fs::write(path("light.wgsl"), light("0.5")).unwrap();
    // Farther away, and what cargo made of it once.
    fs::write(path("aaa/old.wgsl"), light("9.0")).unwrap();
    fs::write(path("target/CACHEDIR.TAG"), "").unwrap();
    fs::write(path("target/light.wgsl"), light("7.0")).unwrap();
    let build = || {
        let builder = configure().pass("shadow").out_dir(path("out"));
        builder.build(&[&path("lit.wgsl")])
    };
    let first = build().unwrap();
    assert_eq!(first.read, [path("lit.wgsl"), path("light.wgsl")]);
    let made = || fs::read_to_string(path("out/lit/original/lit.main.wgsl")).unwrap();
    assert!(made().contains("0.5f"), "{}", made());
    assert!(build().unwrap().written.is_empty());
    fs::write(path("light.wgsl"), light("0.25")).unwrap();
    assert!(!build().unwrap().written.is_empty());
    assert!(made().contains("0.25f"), "{}", made());
    // Two in one folder are not chosen between, whatever was built before the second was there.
    fs::write(path("lamp.wgsl"), light("0.75")).unwrap();
    let said = build().unwrap_err().to_string();
    assert!(said.contains("are both `lib::light`"), "{said}");
    // Two that say the same are one, until one of them is edited.
    fs::write(path("lamp.wgsl"), light("0.25")).unwrap();
    build().unwrap();
    fs::write(path("lamp.wgsl"), light("0.5")).unwrap();
    assert!(build().is_err());
    // One that is nearer goes before it.
    fs::remove_file(path("lamp.wgsl")).unwrap();
    fs::rename(path("light.wgsl"), path("aaa/light.wgsl")).unwrap();
    fs::remove_file(path("aaa/old.wgsl")).unwrap();
    build().unwrap();
    assert!(made().contains("0.25f"), "{}", made());
    fs::write(path("light.wgsl"), light("0.125")).unwrap();
    let nearer = build().unwrap();
    assert!(made().contains("0.125f"), "{}", made());
    assert_eq!(nearer.read, [path("lit.wgsl"), path("light.wgsl")]);
    // A file that is no module is none of its business.
    fs::write(path("other.wgsl"), "fn f() {}\n").unwrap();
    let stamp = || {
        fs::metadata(path("out/lit/preshade.stamp"))
            .unwrap()
            .modified()
            .unwrap()
    };
    let before = stamp();
    build().unwrap();
    assert_eq!(stamp(), before);
}

#[test]
fn wesls_modules_are_read_and_told() {
    let package = Package::new("wesl");
    let path = |name: &str| package.0.join(name);
    let main = "import package::util::dim;\n@vertex fn vs(@location(0) p: vec4f) -> \
                @builtin(position) vec4f { return p; }\n@fragment fn fs() -> @location(0) vec4f { \
                return vec4f(dim(0.3)); }\n";
    fs::write(path("lit.wesl"), main).unwrap();
    fs::write(
        path("util.wesl"),
        "fn dim(x: f32) -> f32 { return x * 0.5; }\n",
    )
    .unwrap();
    let build = || {
        let builder = configure().pass("shadow").out_dir(path("out"));
        builder.build(&[&path("lit.wesl")]).unwrap()
    };
    assert_eq!(build().read, [path("lit.wesl"), path("util.wesl")]);
    assert!(build().written.is_empty());
    fs::write(
        path("util.wesl"),
        "fn dim(x: f32) -> f32 { return x * 0.25; }\n",
    )
    .unwrap();
    assert!(!build().written.is_empty());
    // Another package's folder with a version that goes before the one that was found.
    let other = main.replace("package::util", "lamps::util");
    fs::write(path("lit.wesl"), other).unwrap();
    let package = |version: &str, value: &str| {
        let folder = path("lib").join(version).join("src");
        fs::create_dir_all(&folder).unwrap();
        let text = format!("fn dim(x: f32) -> f32 {{ return x * {value}; }}\n");
        fs::write(folder.join("util.wesl"), text).unwrap();
    };
    let build = || {
        let builder = configure().pass("shadow").include(path("lib"));
        let builder = builder.out_dir(path("out"));
        builder.build(&[&path("lit.wesl")]).unwrap()
    };
    package("lamps-0.21", "0.5");
    build();
    assert!(build().written.is_empty());
    package("lamps-0.20", "0.75");
    let built = build();
    assert!(!built.written.is_empty());
    assert_eq!(built.read[1], path("lib/lamps-0.20/src/util.wesl"));
}

/// A material whose resources and constants a host has to be told of.
const SURE: &str = "
override gain: f32;
@id(7) override bias: f32 = 0.5;
@group(0) @binding(0) var<uniform> object: mat4x4<f32>;
@group(0) @binding(1) var map: texture_2d<f32>;
@group(0) @binding(2) var near: sampler;
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return object * p; }
@fragment fn fs() -> @location(0) vec4<f32> { return textureSample(map, near, vec2<f32>(bias)) * \
    gain; }
";

#[test]
fn what_the_host_says_is_in_the_layouts_and_constants_are_listed() {
    let package = Package::new("said");
    fs::write(package.0.join("toon.wgsl"), SURE).unwrap();
    let builder = configure()
        .pass("depth-prepass")
        .dynamic_offset(0, 0)
        .unfilterable(0, 1)
        .unfilterable(0, 2);
    assert_eq!(package.build(builder).unwrap().warnings, [""; 0]);
    let module = package.module();
    assert!(module.contains("has_dynamic_offset: true"));
    assert!(!module.contains("has_dynamic_offset: false"));
    assert!(module.contains("SamplerBindingType::NonFiltering"));
    assert!(module.contains("Float { filterable: false }"));
    assert!(module.contains(
        "overrides: &[Override { key: \"gain\", is_needed: true }, Override { \
         key: \"7\", is_needed: false }], unread_overrides: &[]"
    ));
    let prepass = module.split("static PREPASS: Pass").nth(1).unwrap();
    let prepass = prepass.lines().next().unwrap();
    assert!(
        prepass.contains("overrides: &[], unread_overrides: &[\"7\", \"gain\"]"),
        "{prepass}"
    );
    for builder in [
        configure().dynamic_offset(0, 1),
        configure().unfilterable(0, 0),
        configure().unfilterable(3, 0),
    ] {
        let error = package.build(builder).unwrap_err();
        assert!(matches!(error, BuildError::Module { .. }), "{error}");
    }
}

/// A budget is shown by a scene, and its pass needs a viewport, which the module does not set: the original is shipped.
#[test]
fn half_rate_is_left_out() {
    let package = Package::new("half-rate");
    let text = include_str!("../../fixtures/shaders/deferred.wgsl");
    fs::write(package.0.join("toon.wgsl"), text).unwrap();
    let mut state = MaterialState {
        depth_compare: Some(CompareFunction::Always),
        ..MaterialState::default()
    };
    state.depth_write = false;
    let recipe = ["half-rate:budget=0.01"];
    let built = package.build(configure().state(state).variant("halved", recipe));
    let warnings = built.unwrap().warnings;
    let told = |w: &String| w.contains("`half-rate:budget=0.01` is left out of `halved`");
    assert!(warnings.iter().any(told), "{warnings:?}");
}

#[test]
fn features_are_complete_and_what_cannot_be_said_is_refused() {
    let package = Package::new("features");
    let vertex =
        "@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }\n";
    let state = |format: &str, count: u32| {
        let mut state = MaterialState {
            targets: vec![Some(ColorTarget::opaque(format))],
            ..MaterialState::default()
        };
        state.multisample.count = count;
        state
    };
    let features = |before: &str, value: &str, state: MaterialState| {
        let text = format!(
            "{before}\n{vertex}@fragment fn fs() -> @location(0) vec4<f32> {{ {value} }}\n"
        );
        fs::write(package.0.join("toon.wgsl"), text).unwrap();
        let built = package.build(configure().state(state).variant("own", ["shadow"]));
        built.map(|_| {
            let module = package.module();
            let main = module.split("static MAIN: Pass").nth(1).unwrap();
            let main = main.lines().next().unwrap();
            let of = main.split(", features: wgpu::Features::empty()").nth(1);
            let of = of.unwrap().split(", raise_limits").next().unwrap();
            (
                of.replace(".union(wgpu::Features::", "").replace(')', " "),
                main.to_owned(),
            )
        })
    };
    let one = "return vec4<f32>(1.0);";
    let said = |before, value, state| features(before, value, state).unwrap().0;
    assert_eq!(said("", one, state("rgba8unorm", 4)), "");
    assert_eq!(
        said("", one, state("rg11b10ufloat", 1)),
        "RG11B10UFLOAT_RENDERABLE "
    );
    let adapter = "TEXTURE_ADAPTER_SPECIFIC_FORMAT_FEATURES ";
    assert_eq!(said("", one, state("rgba8unorm", 8)), adapter);
    let mut blended = state("rgba32float", 1);
    blended.targets[0].as_mut().unwrap().blend = Some(Blend::ALPHA);
    assert_eq!(said("", one, blended), "FLOAT32_BLENDABLE ");
    let mut stencil = state("rgba8unorm", 1);
    stencil.depth_format = DepthFormat::Depth32floatStencil8;
    assert_eq!(said("", one, stencil), "DEPTH32FLOAT_STENCIL8 ");
    let plain = || state("rgba8unorm", 1);
    let sum = "return vec4<f32>(subgroupAdd(1.0));";
    assert_eq!(said("", sum, plain()), "SUBGROUP ");
    let picture = "@group(0) @binding(0) var t: texture_storage_2d<rgba8unorm, read_write>;";
    let load = "return textureLoad(t, vec2<i32>(0));";
    assert_eq!(said(picture, load, plain()), adapter);
    let texture = |ty: &str| format!("@group(0) @binding(0) var t: {ty};");
    let store = "textureStore(t, vec2<i32>(0), vec4<f32>(1.0)); return vec4<f32>(1.0);";
    let narrow = texture("texture_storage_2d<r8unorm, write>");
    assert_eq!(said(&narrow, store, plain()), adapter);
    let wide = texture("texture_storage_2d<rgba16float, write>");
    assert_eq!(said(&wide, store, plain()), "");
    let video = "return textureLoad(t, vec2<u32>(0u));";
    let film = texture("texture_external");
    assert_eq!(said(&film, video, plain()), "EXTERNAL_TEXTURE ");
    let counted = texture("texture_storage_2d<r32uint, atomic>");
    let max = "textureAtomicMax(t, vec2<i32>(0), 1u); return vec4<f32>(1.0);";
    let (atomic, main) = features(&counted, max, plain()).unwrap();
    assert_eq!(atomic, "TEXTURE_ATOMIC ");
    assert!(main.contains("StorageTextureAccess::Atomic"), "{main}");
    for (value, needed) in [
        ("return vec4<f32>(f32(f64(x) + 1.0lf));", "SHADER_F64 "),
        ("return vec4<f32>(f32(i64(x) + 1li));", "SHADER_INT64 "),
    ] {
        assert_eq!(said("var<private> x: f32 = 0.5;", value, plain()), needed);
    }
    // Immediate data is said, binding arrays are refused.
    let (said, main) =
        features("var<immediate> tint: vec4<f32>;", "return tint;", plain()).unwrap();
    assert_eq!(said, "IMMEDIATES ");
    assert!(main.contains("immediate_size: 16"), "{main}");
    assert!(
        main.contains("limits.max_immediate_size = limits.max_immediate_size.max(16)"),
        "{main}"
    );
    let array = "enable wgpu_binding_array;\n@group(0) \
                 @binding(0) var all: binding_array<texture_2d<f32>, 4>;";
    let load = "return textureLoad(all[1], vec2<i32>(0), 0);";
    let error = features(array, load, plain()).unwrap_err().to_string();
    assert!(error.contains("`all` is a binding array"), "{error}");
    // So is a number that there is no word for, wherever it stands.
    for number in [f32::INFINITY, f32::NAN] {
        let mut state = plain();
        state.depth_bias.slope_scale = number;
        let error = features("", one, state).unwrap_err();
        assert!(matches!(error, BuildError::Module { .. }), "{error}");
        let said = format!("the slope scale of the depth bias is {number}");
        assert!(error.to_string().contains(&said), "{error}");
    }
    // So are formats that there are not.
    let error = features("", one, state("rgba8unorm_srgb", 1)).unwrap_err();
    let said = "no colour format `rgba8unorm_srgb` that can be drawn to, in WebGPU's spelling; \
                did you mean `rgba8unorm-srgb`?";
    assert!(error.to_string().contains(said), "{error}");
}

#[test]
fn names_that_break_a_module_or_leave_the_folder_are_refused() {
    let package = Package::new("names");
    for name in [
        "static",
        "wgpu",
        "std",
        "u32",
        "self",
        "preshade_generated",
        "gen",
    ] {
        let error = package
            .build(configure().variant(name, ["shadow"]))
            .unwrap_err();
        assert!(
            matches!(&error, BuildError::Name(n) if n == name),
            "{error}"
        );
    }
    let twice = configure()
        .variant("a", ["shadow"])
        .variant("a", ["early-discard"]);
    assert!(matches!(
        package.build(twice).unwrap_err(),
        BuildError::Twice(_)
    ));
    for name in ["..", ".", "lit.rs", "a/b", "a\\b", "a:b", "", "lit."] {
        let error = package.build(configure().name(name)).unwrap_err();
        assert!(
            matches!(&error, BuildError::Name(n) if n == name),
            "{error}"
        );
    }
    let builder = configure().out_dir(package.0.join("out"));
    let shader = package.0.join("toon.wgsl");
    builder.clone().name("grass").compile(&shader).unwrap();
    let other = builder.name("Grass").compile(&shader).unwrap_err();
    assert!(matches!(other, BuildError::Taken { .. }), "{other}");
}

#[test]
fn nothing_is_told_of_variants_that_nobody_asked_for() {
    let package = Package::new("unasked");
    let mut state = MaterialState::default();
    let mut target = ColorTarget::opaque("rgba8unorm");
    target.blend = Some(Blend::ALPHA);
    state.targets = vec![Some(target)];
    let built = package.build(configure().state(state)).unwrap();
    assert_eq!(built.warnings, [""; 0]);
    assert!(
        package
            .module()
            .contains("LEFT_OUT: &[&str] = &[\"depth-prepass[blended]")
    );
}

/// The generated modules through rustc, against the wgpu that these tests were linked with, with
/// every lint that a host may deny, clippy's too.
#[test]
fn generated_modules_compile_without_a_warning() {
    let package = Package::new("rustc");
    fs::write(package.0.join("sure.wgsl"), SURE).unwrap();
    let build = |name: &str, builder: BuildConfig| {
        let builder = builder.out_dir(package.0.join("out"));
        builder.build(&[&package.0.join(name)]).unwrap()
    };
    build("toon.wgsl", configure().variant("early", ["early-discard"]));
    let sure = configure().types("super::toon").wgpu("crate::gfx::wgpu");
    build("sure.wgsl", sure.pass("depth-prepass").dynamic_offset(0, 0));
    let host = "#![forbid(missing_docs)]\n#![deny(warnings, unused, unreachable_pub, \
                unused_qualifications)]\n//! A host.\n\
                /// Where wgpu is.\npub mod gfx { pub use ::wgpu; }\n\
                /// A material.\npub mod toon { include!(\"out/toon.rs\"); }\n\
                mod sure { include!(\"out/sure.rs\"); }\n\
                /// Its passes.\npub fn passes() -> usize { \
                sure::original::PASSES.len() + sure::PASSES.len() }\n\
                /// With what is known late.\npub fn pipeline(device: &wgpu::Device, format: \
                wgpu::TextureFormat) -> Result<wgpu::RenderPipeline, toon::Unfit> {\n\
                let options = toon::PipelineOptions { formats: &[Some(format)], samples: Some(4), \
                constants: &[(\"gain\", 2.0)], ..Default::default() };\n\
                sure::MAIN.pipeline_with(device, &[sure::INTERLEAVED], &options)\n}\n";
    fs::write(package.0.join("host.rs"), host).unwrap();
    let deps = std::env::current_exe().unwrap();
    let deps = deps.parent().unwrap();
    let is_wgpu = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy();
        name.starts_with("libwgpu-") && name.ends_with(".rlib")
    };
    let all = fs::read_dir(deps).unwrap().map(|e| e.unwrap().path());
    // Builds of other features may lie beside it: the last is this one's, or one like it.
    let wgpu = all
        .filter(is_wgpu)
        .max_by_key(|path| fs::metadata(path).unwrap().modified().unwrap())
        .unwrap();
    let rustc = std::env::var_os("RUSTC").unwrap_or("rustc".into());
    let compiled = |compiler: &std::ffi::OsStr, host: &str, edition: &str, lints: &[String]| {
        let ran = std::process::Command::new(compiler)
            .current_dir(&package.0)
            .args([
                host,
                "--crate-type=lib",
                "--emit=metadata",
                "--edition",
                edition,
            ])
            .args(lints)
            .arg("--extern")
            .arg(format!("wgpu={}", wgpu.display()))
            .arg("-L")
            .arg(format!("dependency={}", deps.display()))
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success() && said.is_empty(), "{said}");
    };
    for edition in ["2021", "2024"] {
        compiled(&rustc, "host.rs", edition, &[]);
    }
    // Every lint of rustc's that is allowed where nobody says otherwise; of clippy, all there are.
    // A lint that may be forbidden is not allowed either.
    let plain = "#![forbid(unsafe_code, missing_docs, clippy::unwrap_used, clippy::panic)]\n\
                 //! A host.\n/// A material.\npub mod toon { include!(\"out/toon.rs\"); }\n";
    fs::write(package.0.join("plain.rs"), plain).unwrap();
    let told = |args: &[&str]| {
        let ran = std::process::Command::new(&rustc).args(args).output();
        String::from_utf8(ran.unwrap().stdout).unwrap()
    };
    let help = told(&["-W", "help"]);
    let silent = help.lines().filter_map(|line| {
        let mut words = line.split_whitespace();
        let name = words.next()?;
        // Those that are unstable are unknown without a feature.
        (words.next() == Some("allow")).then(|| format!("-D{name}"))
    });
    let known = ["-Aunknown-lints".to_owned()];
    let silent: Vec<String> = known.into_iter().chain(silent).collect();
    assert!(silent.len() > 30, "{silent:?}");
    compiled(&rustc, "plain.rs", "2024", &silent);
    let bin = PathBuf::from(told(&["--print", "sysroot"]).trim()).join("bin");
    let clippy = bin.join(format!("clippy-driver{}", std::env::consts::EXE_SUFFIX));
    if clippy.is_file() {
        let groups = ["all", "pedantic", "nursery", "restriction"];
        let mut groups: Vec<String> = groups.map(|g| format!("-Dclippy::{g}")).to_vec();
        // What is said of saying so, and of the host's own few lines.
        groups.push("-Aclippy::blanket_clippy_restriction_lints".to_owned());
        compiled(clippy.as_os_str(), "plain.rs", "2024", &groups);
    }
}

#[test]
fn a_target_is_written_beside_the_others() {
    let package = Package::new("targets");
    let builder = configure().pass("depth-prepass").emit(Target::Spirv);
    assert_eq!(package.build(builder).unwrap().warnings, [""; 0]);
    let names = package.names("variant");
    let binaries = names.iter().filter(|n| n.ends_with(".spv")).count();
    assert!(
        binaries > 1 && names.contains(&"toon.main.wgsl".to_owned()),
        "{names:?}"
    );
}

#[test]
fn a_lock_that_no_longer_fits_ships_the_original() {
    let package = Package::new("stale");
    package.lock(&["depth-prepass"], &Facts::default());
    let builder = || configure().pass("depth-prepass");
    assert_eq!(package.build(builder()).unwrap().warnings, [""; 0]);
    let shader = package.0.join("toon.wgsl");
    fs::write(&shader, SHADER.replace("discard;", "discard; ;")).unwrap();
    let built = package.build(builder()).unwrap();
    let [warning] = &built.warnings[..] else {
        panic!("{:?}", built.warnings);
    };
    assert!(
        warning.ends_with(
            "toon.wgsl was edited after preshade.lock was written; \
             run `preshade plan SCENE --one --lock` again. The original is shipped"
        ),
        "{warning}"
    );
    // The state of the lock is that of a build that says none; another is a mismatch.
    fs::write(&shader, SHADER).unwrap();
    let mut state = MaterialState::default();
    state.multisample.count = 4;
    let built = package.build(builder().state(state)).unwrap();
    let said = "another pipeline state: multisample.count is 4, and was 1";
    assert!(built.warnings[0].contains(said), "{:?}", built.warnings);
}

#[test]
fn what_ends_a_build_reads_well() {
    let package = Package::new("errors");
    let said = |builder: BuildConfig| format!("{:?}", package.build(builder).unwrap_err());
    assert!(said(configure().pass("depth-prepas")).contains("did you mean `depth-prepass`?"));
    assert!(said(configure().variant("Early", ["shadow"])).contains("`Early`"));
    assert!(said(configure().lock(package.0.join("none.lock"))).contains("none.lock"));
    fs::write(package.0.join("toon.wgsl"), "@vertex fn").unwrap();
    let parse = said(configure());
    assert!(
        parse.contains("error[parse]") && parse.contains("toon.wgsl:1:"),
        "{parse}"
    );
    fs::write(package.0.join("preshade.lock"), "{}").unwrap();
    assert!(said(configure()).contains("preshade.lock: not a lock file"));
}
