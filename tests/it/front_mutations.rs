//! Damaged source never takes the process down: it is a program or an error. And what parses is
//! emitted, read back and equal.

use preshade_compiler::emit;
use preshade_compiler::front::{self, Source};
use preshade_plan::plan::Plan;
use preshade_plan::plan_file::Target;
use preshade_plan::program::Program;
use preshade_plan::state::MaterialState;
use shader_text::options;

const WGSL: &str = include_str!("../materials/everything.wgsl");
const VERTEX: &str = include_str!("../materials/everything.vert");
const FRAGMENT: &str = include_str!("../materials/everything.frag");

/// Xorshift: the same mutations in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % n.max(1) as u64) as usize
    }
}

/// Words, numbers, marks and spaces, so that a mutation is more often a wrong program than broken
/// text. A program that the writer has to write: one that no transform has touched ships as its
/// author's own text.
fn touched(program: &Program) -> Program {
    program.with_module(program.module().clone()).unwrap()
}

fn pieces(text: &str) -> Vec<&str> {
    let mut pieces = Vec::new();
    let mut start = 0;
    let class = |c: char| match c {
        c if c.is_alphanumeric() || c == '_' || c == '.' => 0,
        c if c.is_whitespace() => 1,
        _ => 2,
    };
    let mut last = None;
    for (at, c) in text.char_indices() {
        if last.is_some_and(|l| l != class(c) || l == 2) {
            pieces.push(&text[start..at]);
            start = at;
        }
        last = Some(class(c));
    }
    pieces.push(&text[start..]);
    pieces
}

fn mutate(text: &str, random: &mut Random) -> String {
    let mut pieces = pieces(text);
    for _ in 0..1 + random.below(2) {
        let (at, from) = (random.below(pieces.len()), random.below(pieces.len()));
        match random.below(4) {
            0 => {
                pieces.remove(at);
            }
            1 => pieces.insert(at, pieces[from]),
            2 => pieces[at] = pieces[from],
            _ => pieces.swap(at, from),
        }
    }
    pieces.concat()
}

/// Parses and, where that works, emits; says whether it did.
fn survives(sources: &[Source]) -> bool {
    let Ok(parsed) = front::parse(sources, &options::Options::default()) else {
        return false;
    };
    let plan = Plan::original(
        "m",
        touched(&parsed.program),
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    for target in Target::GENERAL {
        match emit::emit(&plan, &[target], &emit::Options::default()) {
            Ok(_) | Err(emit::EmitError::Inexpressible { .. }) => {}
            Err(e) => {
                let texts: Vec<&str> = sources.iter().map(|s| s.text.as_str()).collect();
                panic!("{e}\n{}", texts.join("\n----\n"));
            }
        }
    }
    true
}

fn rounds() -> usize {
    std::env::var("PRESHADE_MUTATIONS")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(150)
}

#[test]
fn damaged_wgsl() {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let parsed = (0..rounds())
        .filter(|_| survives(&[Source::new("m.wgsl", mutate(WGSL, &mut random))]))
        .count();
    assert!(parsed > 0, "some mutations are programs");
}

#[test]
fn damaged_glsl() {
    let mut random = Random(0xD1B5_4A32_D192_ED03);
    let parsed = (0..rounds())
        .filter(|i| {
            let (vertex, fragment) = match i % 2 {
                0 => (mutate(VERTEX, &mut random), FRAGMENT.to_owned()),
                _ => (VERTEX.to_owned(), mutate(FRAGMENT, &mut random)),
            };
            survives(&[
                Source::new("m.vert", vertex),
                Source::new("m.frag", fragment),
            ])
        })
        .count();
    assert!(parsed > 0, "some mutations are programs");
}
