//! Metamorphic tests after GraphicsFuzz (Donaldson, Evrard, Lascu and Thomson 2017): what changes nothing is written into the fixture shaders, and still no variant gives anything else.
//!
//! Into the text, as an author would: dead code behind an opaque predicate, statements wrapped into branches and loops that run once, expressions split and returned by name.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::ShaderStage;
use preshade_passes::pass::Facts;
use preshade_passes::pass_named;
use preshade_passes::plan::Plan;
use preshade_passes::program::{Language, Program, SourceMap};
use preshade_passes::state::MaterialState;
use preshade_passes::validate::inputs::Random;
use preshade_passes::validate::{Check, Effort, validate};
use serde_json::json;

/// Private variables: opaque to a transform, which does not know what ran before, and 0 and 1 all the same.
const OPAQUE: &str = "
var<private> meta_zero: f32 = 0.0;
var<private> meta_one: i32 = 1;
var<private> meta_sink: f32;
";

/// A simple statement of a function's body, and where it begins and ends.
#[derive(Clone, Copy, Debug)]
struct Simple {
    start: usize,
    end: usize,
    /// It stands in a fragment entry point itself, where it may be discarded.
    in_fragment: bool,
}

/// The statements that end in a semicolon, outside of headers.
fn statements(text: &str) -> Vec<Simple> {
    let bytes = text.as_bytes();
    let mut found = Vec::new();
    let mut at = 0;
    // Whether each open brace holds statements, and whether the outermost is a fragment entry point's.
    let mut braces: Vec<bool> = Vec::new();
    let (mut parens, mut start, mut in_fragment) = (0, 0, false);
    while at < bytes.len() {
        if text[at..].starts_with("//") {
            let line = text[at..].find('\n').unwrap_or(text.len() - at);
            at += line;
            // A comment ahead of a statement is not of it.
            if text[start..at].trim_start().starts_with("//") {
                start = at;
            }
            continue;
        }
        match bytes[at] {
            b'(' | b'[' => parens += 1,
            b')' | b']' => parens -= 1,
            b'{' => {
                let head = text[start..at].trim();
                if braces.is_empty() {
                    in_fragment = head.starts_with("@fragment");
                }
                let is_function = head.contains("fn ");
                let is_body = match braces.last() {
                    None => is_function,
                    Some(_) => !head.starts_with("switch"),
                };
                braces.push(is_body);
                start = at + 1;
            }
            b'}' => {
                braces.pop();
                start = at + 1;
            }
            b';' if parens == 0 => {
                let begin = start + (text[start..at].len() - text[start..at].trim_start().len());
                if braces.last() == Some(&true) {
                    found.push(Simple {
                        start: begin,
                        end: at + 1,
                        in_fragment,
                    });
                }
                start = at + 1;
            }
            _ => {}
        }
        at += 1;
    }
    found
}

/// What a statement may be written as instead.
fn injected(text: &str, statement: Simple, n: usize, random: &mut Random) -> String {
    let own = &text[statement.start..statement.end];
    let first = own.split(|c: char| !c.is_alphanumeric() && c != '_').next();
    let first = first.unwrap_or_default();
    let body = own.trim_end_matches(';');
    let dead = match random.below(if statement.in_fragment { 4 } else { 3 }) {
        0 => "meta_sink = sin(meta_sink + 1.0);".to_owned(),
        1 => format!("for (var meta_d{n} = 0; meta_d{n} < 3; meta_d{n}++) {{ meta_sink += 1.0; }}"),
        2 => "meta_one = 7; meta_zero = 9.0;".to_owned(),
        _ => "discard;".to_owned(),
    };
    let behind_opaque = format!("if meta_zero > 0.5 {{ {dead} }} {own}");
    if random.below(3) == 0 {
        return behind_opaque;
    }
    match first {
        "let" => {
            let (left, value) = body.split_once('=').unwrap();
            format!("let meta_s{n} = {value}; {left} = meta_s{n};")
        }
        "return" if body.len() > "return ".len() => {
            format!(
                "let meta_r{n} ={}; return meta_r{n};",
                &body["return".len()..]
            )
        }
        "var" | "const" | "return" | "discard" | "break" | "continue" | "const_assert" => {
            behind_opaque
        }
        _ => match random.below(4) {
            0 => format!("if meta_one == 1 {{ {own} }}"),
            1 => format!("for (var meta_i{n} = 0; meta_i{n} < meta_one; meta_i{n}++) {{ {own} }}"),
            2 => format!("loop {{ {own} if meta_one > 0 {{ break; }} }}"),
            _ => {
                format!("switch meta_one {{ case 1: {{ {own} }} default: {{ meta_sink = 3.0; }} }}")
            }
        },
    }
}

/// The shader with about as many injections.
fn injection(text: &str, seed: u64, count: usize) -> String {
    let mut random = Random::new(seed, "metamorphic");
    let all = statements(text);
    let mut out = String::new();
    let mut at = 0;
    for (n, statement) in all.iter().enumerate() {
        if random.below(all.len()) >= count {
            continue;
        }
        out.push_str(&text[at..statement.start]);
        out.push_str(&injected(text, *statement, n, &mut random));
        at = statement.end;
    }
    out.push_str(&text[at..]);
    out + OPAQUE
}

fn plan(name: &str, text: &str) -> Option<Plan> {
    let module = naga::front::wgsl::parse_str(text).ok()?;
    let of = |stage| {
        let mut found = module.entry_points.iter().filter(|e| e.stage == stage);
        found.next().map(|e| e.name.clone())
    };
    let (vertex, fragment) = (of(ShaderStage::Vertex)?, of(ShaderStage::Fragment)?);
    let mut sources = SourceMap::new();
    sources.add(name, text);
    let program = Program::new(module, Arc::new(sources), Language::Wgsl).ok()?;
    let state = MaterialState::default();
    Some(Plan::original(
        name,
        program,
        &vertex,
        Some(&fragment),
        &state,
    ))
}

fn recipes() -> Vec<(&'static str, serde_json::Value)> {
    vec![
        ("depth-prepass", json!({})),
        (
            "depth-prepass",
            json!({"form": "equal", "vertex": "sliced"}),
        ),
        ("early-discard", json!({})),
        ("shadow", json!({})),
        ("hoist", json!({"allow": "exact"})),
        ("hoist", json!({"budget": 0.1, "finite": "assumed"})),
        ("trim-loop", json!({"budget": 0.1})),
    ]
}

fn broken(what: &str, checks: &[Check]) -> Vec<String> {
    let broken = checks.iter().filter(|c| c.verdict.is_broken());
    broken
        .map(|c| format!("{what}: {}: {}: {}", c.role.name(), c.promise, c.verdict))
        .collect()
}

/// As many seeds a shader as `PRESHADE_METAMORPHIC` says; one without it.
#[test]
fn what_changes_nothing_changes_no_variant() {
    let seeds: u64 = std::env::var("PRESHADE_METAMORPHIC")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(1);
    let effort = Effort {
        inputs: 6,
        steps: 40_000,
        paths: 4,
        ..Effort::default()
    };
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/shaders");
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "wgsl"))
        .collect();
    files.sort();
    let facts = Facts::without_ties();
    let (mut wrong, mut injections, mut accepted) = (Vec::new(), 0, BTreeMap::new());
    for file in files {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&file).unwrap();
        let Some(original) = plan(&name, &text) else {
            continue;
        };
        for seed in 0..seeds {
            let changed = injection(&text, seed, 8);
            assert_ne!(changed, text);
            let Some(injected) = plan(&name, &changed) else {
                let why = naga::front::wgsl::parse_str(&changed)
                    .map_or_else(|e| e.emit_to_string(&changed), |_| "invalid".to_owned());
                panic!("{name}, seed {seed}: the injection is wrong: {why}\n{changed}");
            };
            injections += 1;
            let what = format!("{name}, seed {seed}");
            wrong.extend(broken(&what, &validate(&original, &injected, &effort)));
            for (pass, params) in recipes() {
                let found = pass_named(pass).unwrap();
                let sites = found.sites(&injected, &facts, &params).unwrap();
                let Some(site) = sites.sites.first() else {
                    let bug = sites.refusals.iter().find(|r| r.code == "internal");
                    wrong.extend(bug.map(|r| format!("{what}: {r}")));
                    continue;
                };
                match found.apply(&injected, &facts, &site.key, &params) {
                    Ok(variant) => {
                        *accepted.entry(pass).or_insert(0) += 1;
                        let what = format!("{what} by {pass} {params}");
                        wrong.extend(broken(&what, &validate(&original, &variant, &effort)));
                    }
                    Err(refusal) if refusal.code == "internal" => {
                        wrong.push(format!("{what} by {pass}: {refusal}"));
                    }
                    Err(_) => {}
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(injections >= 30, "{injections}");
    assert!(accepted.len() >= 5, "{accepted:?}");
}

/// The injections themselves are seen where they do change something: the tests of the test.
#[test]
fn an_injection_that_is_not_neutral_is_seen() {
    let text = "
@vertex fn vs(@location(0) p: vec4<f32>) -> @builtin(position) vec4<f32> { return p; }
@fragment fn fs(@builtin(position) p: vec4<f32>) -> @location(0) vec4<f32> {
    var x = p.x;
    x = x * 2.0;
    if p.y > 4.0 { x = x + 1.0; }
    let y = x - p.z;
    return vec4(y);
}
";
    let original = plan("test", text).unwrap();
    assert_eq!(statements(text).len(), 6);
    let effort = Effort {
        inputs: 24,
        ..Effort::default()
    };
    let kept = (0..40).map(|seed| injection(text, seed, 3));
    for changed in kept {
        let injected = plan("test", &changed).unwrap_or_else(|| panic!("{changed}"));
        let checks = validate(&original, &injected, &effort);
        assert_eq!(broken("", &checks), Vec::<String>::new(), "{changed}");
        assert!(checks.iter().all(|c| c.verdict.holds()), "{changed}");
    }
    // A predicate that is not what it is taken for.
    let wrong = injection(text, 0, 6).replace("meta_one: i32 = 1", "meta_one: i32 = 2");
    let wrong = wrong.replace("meta_zero: f32 = 0.0", "meta_zero: f32 = 1.0");
    let injected = plan("test", &wrong).unwrap();
    let checks = validate(&original, &injected, &effort);
    assert!(!broken("", &checks).is_empty(), "{wrong}");
}
