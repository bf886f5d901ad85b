//! Uniformity by WGSL's rules: cases of each of them with what the rules say, and cases of others
//! from a folder.
//!
//! `UNIFORMITY_CASES=FOLDER cargo test -p preshade-passes --test it uniformity -- --nocapture` runs
//! files `NAME.pass.wgsl` and `NAME.fail.wgsl` too, and prints how many verdicts are those of the
//! names. Tint judges the cases here as well: `tests/tools/acceptance.rs`.

use preshade_passes::analysis::uniformity::{Need, non_uniform};

use crate::common;
use crate::uniformity_cases::{CASES, Verdict, text};

#[test]
fn verdicts_are_those_of_the_rules() {
    let mut wrong = Vec::new();
    for case in CASES {
        let program = common::program(&text(case));
        let found = non_uniform(program.module());
        let verdict = match found.is_empty() {
            true => Verdict::Uniform,
            false => Verdict::MayBeNonUniform,
        };
        if verdict != case.verdict {
            wrong.push(format!("{}: {:?}: {found:?}", case.name, case.verdict));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    // Both verdicts are there to be mistaken for the other.
    let uniform = CASES.iter().filter(|c| c.verdict == Verdict::Uniform);
    let uniform = uniform.count();
    assert!(uniform * 3 > CASES.len() && uniform * 3 < 2 * CASES.len());
}

#[test]
fn the_operation_or_the_call_is_told() {
    let source = "fn edge(x: f32) -> f32 { return fwidth(x); }
        @fragment fn fs(@location(0) uv: vec2<f32>) -> @location(0) vec4<f32> {
            var out = 0.0;
            if uv.x > 0.5 { out = edge(uv.y); }
            return vec4(out);
        }";
    let program = common::program(source);
    let [found] = non_uniform(program.module())[..] else {
        panic!("one call is not uniform");
    };
    assert_eq!(found.need, Need::Derivative);
    assert_eq!(&source[found.span.to_range().unwrap()], "edge(uv.y)");
}

/// Soundness on cases of others: what they call non-uniform is not uniform here. Where we are
/// stricter is printed.
#[test]
fn cases_of_others() {
    let Ok(folder) = std::env::var("UNIFORMITY_CASES") else {
        return;
    };
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    files.sort();
    let (mut agreed, mut unread, mut stricter, mut missed) = ([0, 0], 0, Vec::new(), Vec::new());
    for path in files {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let source = std::fs::read_to_string(&path).unwrap();
        let is_uniform = name.ends_with(".pass.wgsl");
        let program = match common::read(&source) {
            Ok(program) => program,
            Err(why) => {
                unread += 1;
                println!(
                    "not read: {name}: {}",
                    why.lines().next().unwrap_or_default()
                );
                continue;
            }
        };
        match (is_uniform, non_uniform(program.module()).is_empty()) {
            (true, true) => agreed[0] += 1,
            (false, false) => agreed[1] += 1,
            (true, false) => stricter.push(name),
            (false, true) => missed.push(name),
        }
    }
    println!(
        "{} uniform and {} not, as they say; {} stricter: {stricter:?}; {} missed: {missed:?}; \
         {unread} that naga does not read",
        agreed[0],
        agreed[1],
        stricter.len(),
        missed.len()
    );
    assert!(missed.is_empty(), "{missed:?}");
}
