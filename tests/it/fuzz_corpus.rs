//! The targets of `fuzz/` without libFuzzer: a few inputs of each in every run, and what was found
//! stays mended.
//!
//! `PRESHADE_FUZZ=recipes:300 cargo test --test it fuzz_corpus -- --nocapture drive` fuzzes one
//! target for 300 seconds: inputs mutated at random, without coverage to guide it. What panics is
//! kept in `target/tmp/crashes`; cut down, it belongs into `fixtures/crashes`.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::fuzz_support::{glsl, ir, recipes, root, scenes, wgsl};

/// A target: its name, what it does with bytes, and how much of it a test run can bear.
type Target = (&'static str, fn(&[u8]), usize);

const TARGETS: [Target; 6] = [
    ("wgsl", wgsl, 25),
    ("glsl", glsl, 25),
    ("scene", scenes::scene, 40),
    ("plan", scenes::plan, 200),
    (
        "recipes",
        |data| {
            recipes::recipes(data);
        },
        12,
    ),
    (
        "ir",
        |data| {
            ir::ir(data);
        },
        12,
    ),
];

/// Xorshift: the same inputs in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % n.max(1) as u64) as usize
    }
}

/// Inputs to begin with.
fn seeds(target: &str) -> Vec<Vec<u8>> {
    let with = |folder: &str, ending: &str| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(root().join("fixtures").join(folder)).unwrap();
        let mut files: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).collect();
        files.retain(|p| p.extension().is_some_and(|e| e == ending));
        files.sort();
        files
    };
    let read = |path: &PathBuf| std::fs::read(path).unwrap();
    match target {
        "wgsl" => with("shaders", "wgsl").iter().map(read).collect(),
        "glsl" => {
            let both = |path: &PathBuf| {
                let fragment = std::fs::read(path.with_extension("frag")).unwrap_or_default();
                [read(path), vec![0], fragment].concat()
            };
            let folders = ["glsl", "glsl/dialects"];
            let files = folders.iter().flat_map(|f| with(f, "vert"));
            files.map(|p| both(&p)).collect()
        }
        "scene" => with("scenes", "toml").iter().map(read).collect(),
        "plan" => vec![scenes::plan_seed()],
        _ => Vec::new(),
    }
}

/// A text with some of its words, numbers and marks taken out, doubled, swapped or made extreme;
/// bytes where there is none.
fn mutated(seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let Some(text) = seeds.get(random.below(seeds.len())) else {
        return (0..12 + random.below(40))
            .map(|_| random.below(256) as u8)
            .collect();
    };
    let text = String::from_utf8_lossy(text).into_owned();
    let mut pieces: Vec<&str> = Vec::new();
    let mut start = 0;
    let mut before = None;
    for (at, c) in text.char_indices() {
        let class = match c {
            c if c.is_alphanumeric() || c == '_' || c == '.' => 0,
            c if c.is_whitespace() => 1,
            _ => 2,
        };
        if before.is_some_and(|b| b != class || b == 2) {
            pieces.push(&text[start..at]);
            start = at;
        }
        before = Some(class);
    }
    pieces.push(&text[start..]);
    const EXTREME: [&str; 12] = [
        "0",
        "-1",
        "4294967295",
        "1e38",
        "nan",
        "inf",
        "0.0",
        "[]",
        "{}",
        "\"\"",
        "9223372036854775807",
        "1e-45",
    ];
    for _ in 0..1 + random.below(4) {
        let (at, from) = (random.below(pieces.len()), random.below(pieces.len()));
        match random.below(6) {
            0 if pieces.len() > 1 => drop(pieces.remove(at)),
            1 => pieces.insert(at, pieces[from]),
            2 => pieces[at] = pieces[from],
            3 => pieces.swap(at, from),
            // A number where there was one.
            4 => {
                let digit = |p: &&str| p.starts_with(|c: char| c.is_ascii_digit());
                let numbers: Vec<usize> =
                    (0..pieces.len()).filter(|i| digit(&pieces[*i])).collect();
                if let Some(at) = numbers.get(random.below(numbers.len())) {
                    pieces[*at] = EXTREME[random.below(EXTREME.len())];
                }
            }
            _ => pieces[at] = EXTREME[random.below(EXTREME.len())],
        }
    }
    pieces.concat().into_bytes()
}

/// Runs inputs until `goes_on` says no; returns how many, and what panicked.
fn drive(
    (name, run, _): Target,
    seed: u64,
    mut goes_on: impl FnMut(usize) -> bool,
) -> (usize, Vec<(String, Vec<u8>)>) {
    let seeds = seeds(name);
    let mut random = Random(seed);
    let mut found: Vec<(String, Vec<u8>)> = Vec::new();
    let mut runs = 0;
    while goes_on(runs) {
        let data = mutated(&seeds, &mut random);
        let caught = std::panic::catch_unwind(|| run(&data));
        if let Err(panic) = caught {
            let text = panic.downcast_ref::<String>().cloned().unwrap_or_default();
            // One of each kind.
            let kind: String = text.chars().take(60).collect();
            if !found.iter().any(|(t, _)| t.starts_with(&kind)) {
                found.push((text, data));
            }
        }
        runs += 1;
    }
    (runs, found)
}

fn short(name: &str) {
    let target = TARGETS.iter().find(|t| t.0 == name).unwrap();
    let (_, found) = drive(*target, 0x9E37_79B9_7F4A_7C15, |runs| runs < target.2);
    let told: Vec<&String> = found.iter().map(|(text, _)| text).collect();
    assert!(found.is_empty(), "{name}: {told:#?}");
}

#[test]
fn a_few_wgsl_files() {
    short("wgsl");
}

#[test]
fn a_few_glsl_files() {
    short("glsl");
}

#[test]
fn a_few_scenes() {
    short("scene");
}

/// Without it the target would refuse nearly every texture for its size, and find nothing in what
/// makes them.
#[test]
fn scenes_come_to_textures() {
    let texts = seeds("scene")
        .into_iter()
        .map(|s| String::from_utf8(s).unwrap());
    let made = texts.filter(|text| text.contains("pattern =")).map(|text| {
        let smaller = scenes::shrunk(&text).unwrap();
        scenes::load(&text).is_ok() || scenes::load(&smaller).is_ok()
    });
    let made: Vec<bool> = made.collect();
    let of = made.iter().filter(|m| **m).count();
    assert!(of * 2 > made.len(), "{of} of {}", made.len());
}

#[test]
fn a_few_plans() {
    short("plan");
}

#[test]
fn a_few_recipes() {
    short("recipes");
}

#[test]
fn a_few_modules() {
    short("ir");
}

#[test]
fn what_was_found_stays_mended() {
    for (name, run, _) in TARGETS {
        let folder = root().join("fixtures/crashes").join(name);
        let Ok(entries) = std::fs::read_dir(folder) else {
            continue;
        };
        for entry in entries {
            run(&std::fs::read(entry.unwrap().path()).unwrap());
        }
    }
}

/// Long runs, by hand.
#[test]
fn driven_as_long_as_asked() {
    let Ok(asked) = std::env::var("PRESHADE_FUZZ") else {
        return;
    };
    let (name, seconds) = asked.split_once(':').unwrap();
    let target = TARGETS.iter().find(|t| t.0 == name).unwrap();
    let seconds: u64 = seconds.parse().unwrap();
    let start = Instant::now();
    let seed = std::env::var("PRESHADE_FUZZ_SEED").map_or(7, |s| s.parse().unwrap());
    let (runs, found) = drive(*target, seed, |_| {
        start.elapsed() < Duration::from_secs(seconds)
    });
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("crashes");
    std::fs::create_dir_all(&folder).unwrap();
    for (i, (text, data)) in found.iter().enumerate() {
        let file = folder.join(format!("{name}-{seed}-{i}"));
        std::fs::write(&file, data).unwrap();
        println!("{}: {text}", file.display());
    }
    println!(
        "{name}: {runs} inputs in {:.0} s, {} kinds of panics",
        start.elapsed().as_secs_f64(),
        found.len()
    );
}
