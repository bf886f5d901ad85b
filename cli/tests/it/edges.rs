//! The edges of `explain` and `rewrite`: cyclic imports, minified lines, the order of steps, files of
//! earlier runs, functions past any size.

use std::fs;
use std::path::{Path, PathBuf};

use crate::hostile_support::{ended, run};

fn cases() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/cases")
}

/// An empty folder.
fn empty(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("edges")
        .join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// What a run says on stderr, with its exit status.
fn told(folder: &Path, args: &[&str], status: i32) -> String {
    ended(&run(folder, args), status, args)
}

/// The names of a folder's files.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn of_a_minified_line_the_part_around_the_place_is_shown() {
    let folder = cases().join("newcomer");
    let said = told(&folder, &["explain", "minified.wgsl"], 2);
    assert!(said.len() < 2_000, "{} bytes", said.len());
    let here = empty("minified");
    let wgsl = |sum: &str| {
        format!(
            "@vertex fn vs() -> @builtin(position) vec4f {{ return vec4f(0); }} @fragment fn fs() -> \
             @location(0) vec4f {{ var x = 0.0; {sum} let é = nothing_here; {sum} return vec4f(x); }}"
        )
    };
    let sum = "x += 1.0; ".repeat(2_000);
    let vert = "#version 450\nvoid main() { gl_Position = vec4(0.0); }\n";
    let frag = format!(
        "#version 450\nlayout(location = 0) out vec4 c; void main() {{ float x = 0.0; {sum} x = nothing_here; \
         {sum} c = vec4(x); }}"
    );
    fs::write(here.join("a.wgsl"), wgsl(&sum)).unwrap();
    fs::write(here.join("i.wgsl"), format!("#define N 1\n{}", wgsl(&sum))).unwrap();
    fs::write(here.join("a.vert"), vert).unwrap();
    fs::write(here.join("a.frag"), frag).unwrap();
    for files in [&["a.wgsl"][..], &["i.wgsl"], &["a.vert", "a.frag"]] {
        let args = [&["explain"], files].concat();
        let said = told(&here, &args, 2);
        assert!(said.len() < 3_000, "{files:?}: {} bytes", said.len());
        assert!(said.contains("nothing_here"), "{files:?}: {said}");
    }
    // The column is that of the author's file.
    let said = told(&here, &["explain", "a.wgsl"], 2);
    let text = fs::read_to_string(here.join("a.wgsl")).unwrap();
    let at = text.find("nothing_here").unwrap();
    let column = text[..at].chars().count() + 1;
    assert!(
        said.contains(&format!("a.wgsl:1:{column}")),
        "{column}: {said}"
    );
}

#[test]
fn an_order_that_would_do_is_named() {
    let folder = cases().join("newcomer");
    for (first, second, hint) in [
        (
            "depth-prepass",
            "shadow",
            "put `shadow` before `depth-prepass`",
        ),
        ("depth-prepass", "early-discard", ""),
        ("shadow", "depth-prepass", ""),
    ] {
        let out = empty(&format!("order-{first}-{second}"));
        let args = [
            "rewrite",
            "shadow-after-prepass.wgsl",
            "--cull",
            "none",
            "--pass",
            first,
            "--pass",
            second,
            "-o",
            out.to_str().unwrap(),
        ];
        let said = told(&folder, &args, 0);
        assert_eq!(said.contains("put `"), !hint.is_empty(), "{said}");
        assert!(said.contains(hint), "{said}");
    }
}

#[test]
fn a_required_pass_that_is_refused_is_an_error() {
    let out = empty("require");
    let to = out.to_str().unwrap();
    let folder = cases().join("newcomer");
    for (pass, status) in [("depth-prepass", 0), ("half-rate", 2)] {
        let args = [
            "rewrite",
            "stale-files.wgsl",
            "--require",
            "--pass",
            pass,
            "-o",
            to,
        ];
        let said = told(&folder, &args, status);
        assert_eq!(said.contains("--require"), status == 2, "{said}");
    }
}

#[test]
fn files_that_no_plan_names_any_more_are_removed() {
    let out = empty("stale");
    let to = out.to_str().unwrap();
    let folder = cases().join("newcomer");
    let rewrite = |more: &[&str]| {
        let args = [
            "rewrite",
            "stale-files.wgsl",
            "--pass",
            "depth-prepass",
            "-o",
            to,
        ];
        let args = [&args[..], more].concat();
        told(&folder, &args, 0)
    };
    rewrite(&["--name", "other"]);
    rewrite(&["--name", "stale-files.b"]);
    let others = names(&out);
    fs::write(out.join("stale-files.mine.wgsl"), "// mine").unwrap();
    let all = "wgsl,spirv,glsl,glsl-vulkan,glsl-es";
    rewrite(&["--emit", all]);
    assert!(out.join("stale-files.prepass.wgsl").exists());
    // Again, nothing changes.
    let before = names(&out);
    assert!(!rewrite(&["--emit", all]).contains("removed"));
    assert_eq!(names(&out), before);
    let said = rewrite(&["--emit", "wgsl", "--blend", "alpha"]);
    assert!(
        said.contains("stale-files.prepass.wgsl: no plan names it"),
        "{said}"
    );
    let mut left = others.clone();
    left.extend(["main.wgsl", "mine.wgsl", "plan.json"].map(|f| format!("stale-files.{f}")));
    left.sort();
    assert_eq!(names(&out), left);
    let said = rewrite(&["--emit", "glsl"]);
    assert!(
        said.contains("stale-files.main.wgsl: no plan names it"),
        "{said}"
    );
    assert!(out.join("stale-files.mine.wgsl").exists());
    assert!(others.iter().all(|name| out.join(name).exists()));
}

/// Each takes seconds: `make check` skips them.
mod slow {
    use super::*;

    /// No time is measured: what would take long meets a limit first.
    #[test]
    fn functions_past_any_size_meet_a_limit() {
        let here = empty("slow");
        let wgsl = |body: &str| {
            format!(
                "struct V {{ @builtin(position) position: vec4f, @location(0) uv: vec2f }}\n\
             @vertex fn vs(@location(0) p: vec3f) -> V {{ return V(vec4f(p, 1.0), p.xy); }}\n\
             @fragment fn fs(v: V) -> @location(0) vec4f {{ var x = v.uv.x; {body} return vec4f(x); }}\n"
            )
        };
        let case = |n: usize| format!("case {n}: {{ x = {n}.5; }}");
        let cases: String = (0..50_000).map(case).collect();
        let list = vec!["x"; 65_536].join(",");
        for (name, body) in [
            ("statements", "x = x * 1.0001 + 0.1;\n".repeat(100_000)),
            (
                "cases",
                format!("switch (i32(x)) {{ {cases} default: {{}} }}"),
            ),
            (
                "values",
                format!("var a = array<f32, 65536>({list}); x = a[u32(x)];"),
            ),
        ] {
            let file = format!("{name}.wgsl");
            fs::write(here.join(&file), wgsl(&body)).unwrap();
            for command in [&["explain"][..], &["rewrite", "--pass", "depth-prepass"]] {
                let args = [command, &[file.as_str()]].concat();
                let said = told(&here, &args, 2);
                assert!(said.contains("the limit is `statements`"), "{name}: {said}");
            }
        }
        let body = "x = x * 1.0001 + 0.1;\n".repeat(100_000);
        fs::write(
            here.join("a.vert"),
            "#version 450\nvoid main() { gl_Position = vec4(0.0); }\n",
        )
        .unwrap();
        let frag = format!(
            "#version 450\nlayout(location = 0) out vec4 c; void main() {{ float x = 0.0; {body} c = vec4(x); }}"
        );
        fs::write(here.join("a.frag"), frag).unwrap();
        let said = told(&here, &["explain", "a.vert", "a.frag"], 2);
        assert!(said.contains("the limit is `statements`"), "{said}");
        // A list of constants at module scope is no statement.
        let list = vec!["0.5"; 65_536].join(",");
        let text = format!(
            "const A = array<f32, 65536>({list});\n{}",
            wgsl("x = A[u32(x)];")
        );
        fs::write(here.join("table.wgsl"), text).unwrap();
        told(&here, &["explain", "table.wgsl"], 0);
    }

    #[test]
    fn modules_that_import_each_other_are_named_once() {
        let folder = cases().join("newcomer/cyclic-import");
        let said = told(&folder, &["explain", "main.wgsl"], 2);
        let message = "`cyc_a` and `cyc_b` import each other";
        assert_eq!(said.matches(message).count(), 1, "{said}");
        let here = empty("imports");
        let main = |import: &str| {
            format!(
                "#import {import}\n@vertex fn vs() -> @builtin(position) vec4f {{ return vec4f(0); }}\n\
             @fragment fn fs() -> @location(0) vec4f {{ return vec4f(0); }}\n"
            )
        };
        for (file, text) in [
            (
                "own.wgsl",
                "#define_import_path own\n#import own\nfn a() -> f32 { return own::a(); }\n",
            ),
            (
                "a.wgsl",
                "#define_import_path a\n#import b\nfn f() -> f32 { return b::f(); }\n",
            ),
            (
                "b.wgsl",
                "#define_import_path b\n#import c\nfn f() -> f32 { return c::f(); }\n",
            ),
            (
                "c.wgsl",
                "#define_import_path c\n#import a\nfn f() -> f32 { return a::f(); }\n",
            ),
            (
                "fine.wgsl",
                "#define_import_path lib::fine\nfn f() -> f32 { return 1.0; }\n",
            ),
        ] {
            fs::write(here.join(file), text).unwrap();
        }
        for (import, used, status, wanted) in [
            ("own", "own::a()", 2, "`own` imports itself"),
            ("a", "a::f()", 2, "`a` imports itself through `b`, `c`"),
            ("lib::fine", "1.0", 0, ""),
            ("lib::fine::f", "1.0", 0, ""),
            ("lib", "1.0", 0, ""),
            // Unknown, though nothing uses its names.
            ("nothing", "1.0", 2, "there is no module `nothing`"),
            (
                "nothing::here::{a, b}",
                "1.0",
                2,
                "there is no module `nothing::here`",
            ),
            ("library as l", "1.0", 2, "there is no module `library`"),
        ] {
            let text = main(import).replace("return vec4f(0)", &format!("return vec4f({used})"));
            fs::write(here.join("main.wgsl"), text).unwrap();
            let said = told(&here, &["explain", "main.wgsl"], status);
            assert!(said.contains(wanted), "{import}: {said}");
        }
        // Under a condition that does not hold, nothing is asked for.
        let text = format!("#ifdef NO\n#import nothing\n#endif\n{}", main("lib::fine"));
        fs::write(here.join("main.wgsl"), text).unwrap();
        told(&here, &["explain", "main.wgsl"], 0);
    }
}
