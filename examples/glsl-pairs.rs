//! Other people's GLSL drawn on both roads: through preshade on wgpu, and as it is by OpenGL, of
//! the same bytes. Pairs are drawn by lot from the folders named.
//!
//! ```text
//! cargo run --release --example glsl-pairs --features verify -- [--pairs 200] [--seed 1] [--pictures DIR] FOLDER..
//! ```
//!
//! `mediump` and `lowp` are `highp` on both roads. A pair is two files of one name, `.vert` and
//! `.frag` or `.vs` and `.fs`; a fragment shader that reads no varying may stand alone. What OpenGL
//! does not take, or draws nothing of, is no pair, and another is drawn in its place. Each pair has
//! a process of its own, and five minutes.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a tool that ends with a message"
)]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

#[allow(dead_code, reason = "patches and made pairs are the tests'")]
#[path = "../tests/gpu/native/mod.rs"]
mod native;
#[path = "../tests/support/render_support/mod.rs"]
mod render_support;

use native::both;
use native::pair::FirstRow;
use preshade_draw::scene::Value;

/// What takes longer is left. Mesa's compilers alone take 40 s of a core for one of GraphicsFuzz's.
const LIMIT: Duration = Duration::from_secs(300);

/// Width and height of the pictures.
const SIZE: [u32; 2] = [160, 90];

/// Values without which a corpus does not draw: GraphicsFuzz's shaders end where the first is not
/// below the second.
const VALUES: [(&str, &[f32]); 2] = [
    ("injectionSwitch", &[0.0, 1.0]),
    ("resolution", &[160.0, 90.0]),
];

fn main() {
    let mut folders = Vec::new();
    let (mut wanted, mut seed, mut pictures) = (200, 1, None);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut number = || arguments.next().and_then(|n| n.parse().ok());
        match argument.as_str() {
            "--one" => {
                let files: Vec<String> = arguments.collect();
                println!("{}", one(&files));
                return;
            }
            "--pairs" => wanted = number().unwrap_or(wanted),
            "--seed" => seed = number().unwrap_or(seed),
            "--pictures" => pictures = arguments.next(),
            _ => folders.push(PathBuf::from(argument)),
        }
    }
    assert!(!folders.is_empty(), "name a folder or more");
    let mut pairs = Vec::new();
    for folder in &folders {
        let found = pairs_below(folder);
        println!("{}: {} pairs", folder.display(), found.len());
        pairs.extend(found);
    }
    shuffle(&mut pairs, seed as u64);
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let mut compared = 0;
    for pair in &pairs {
        if compared == wanted {
            break;
        }
        let said = limited(pair, pictures.as_deref());
        let (kind, rest) = said.split_once(": ").unwrap_or((&said, ""));
        if kind == "equal" || kind == "differs" || kind == "refused" {
            compared += 1;
        }
        if kind != "equal" {
            println!("{kind}: {}: {rest}", pair.last().unwrap().display());
        }
        *counts.entry(kind.to_owned()).or_default() += 1;
    }
    println!("\n| outcome | pairs |\n|---|---|");
    for (kind, count) in counts {
        println!("| {kind} | {count} |");
    }
}

/// Fisher and Yates's shuffle, by SplitMix64.
fn shuffle<T>(all: &mut [T], seed: u64) {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    for i in (1..all.len()).rev() {
        let j = (next() % (i as u64 + 1)) as usize;
        all.swap(i, j);
    }
}

fn pairs_below(folder: &Path) -> Vec<Vec<PathBuf>> {
    fn walk(path: &Path, out: &mut Vec<PathBuf>) {
        let entries = std::fs::read_dir(path).into_iter().flatten();
        for path in entries.filter_map(|e| Some(e.ok()?.path())) {
            match path.is_dir() {
                true => walk(&path, out),
                false => out.push(path),
            }
        }
    }
    let mut files = Vec::new();
    walk(folder, &mut files);
    let mut stems: BTreeMap<PathBuf, BTreeSet<PathBuf>> = BTreeMap::new();
    for file in files {
        let ending = file.extension().and_then(|e| e.to_str());
        if matches!(
            ending,
            Some("vert" | "frag" | "vs" | "fs" | "gs" | "geom" | "tesc" | "tcs" | "tese" | "tes")
        ) {
            stems
                .entry(file.with_extension(""))
                .or_default()
                .insert(file);
        }
    }
    let is = |p: &PathBuf, endings: [&str; 2]| {
        p.extension()
            .is_some_and(|e| endings.iter().any(|x| e == *x))
    };
    let of = |files: BTreeSet<PathBuf>| {
        let vertex = files.iter().find(|f| is(f, ["vert", "vs"])).cloned();
        let fragment = files.iter().find(|f| is(f, ["frag", "fs"])).cloned();
        match (files.len(), vertex, fragment) {
            (2, Some(v), Some(f)) => Some(vec![v, f]),
            (1, None, Some(f)) => Some(vec![f]),
            _ => None,
        }
    };
    stems.into_values().filter_map(of).collect()
}

/// What a process of its own says of a pair.
fn limited(pair: &[PathBuf], pictures: Option<&str>) -> String {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command
        .arg("--one")
        .args(pair)
        .stderr(Stdio::piped())
        .stdout(Stdio::piped());
    if let Some(folder) = pictures {
        command.env("PRESHADE_PICTURES", folder);
    }
    let mut child = command.spawn().unwrap();
    let begun = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if begun.elapsed() > LIMIT {
            let _ = child.kill();
            let _ = child.wait();
            return "left: it takes more than five minutes".to_owned();
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    match said.trim().lines().next_back() {
        Some(line) => line.to_owned(),
        None => {
            let said = String::from_utf8_lossy(&output.stderr);
            let line = said
                .lines()
                .find(|l| l.contains("panicked"))
                .unwrap_or("it died");
            let more = said.lines().skip_while(|l| !l.contains("panicked")).nth(1);
            format!("failed: {line} {}", more.unwrap_or_default())
        }
    }
}

/// One pair on both roads, in a line.
fn one(files: &[String]) -> String {
    let read = |f: &String| {
        let bytes = std::fs::read(f).unwrap();
        let text = String::from_utf8_lossy(&bytes).into_owned();
        // Where a line begins with it: comments may come first.
        match text.lines().any(|l| l.trim_start().starts_with("#version")) {
            true => text,
            false => format!("#version 100\n{text}"),
        }
    };
    let texts: [String; 2] = match files {
        [vertex, fragment] => [read(vertex), read(fragment)],
        [fragment] => {
            let fragment = read(fragment);
            [vertex_for(&fragment), fragment]
        }
        _ => return "no pair: one file or two".to_owned(),
    };
    let gl = native::Native::new();
    let mut scene = match both::scene("pair", &texts, SIZE) {
        Ok(scene) => scene,
        // Half a pair.
        Err(e) if files.len() == 1 && e.starts_with("error[interface]") => {
            return "no pair: it reads varyings".to_owned();
        }
        Err(e) => return format!("refused: {}", e.lines().next().unwrap_or_default()),
    };
    let module = scene.materials[0].program.module();
    let loose = scene.materials[0].program.declared().loose;
    let block = module.global_variables.iter().map(|(_, g)| g);
    let block = block
        .filter(|g| loose.is_some() && g.binding == loose)
        .find_map(|g| g.name.clone());
    let names: Vec<String> = scene.materials[0]
        .program
        .declared()
        .uniforms
        .iter()
        .map(|u| u.name.clone())
        .collect();
    for (name, value) in VALUES {
        if let Some(block) = &block
            && names.iter().any(|n| n == name)
        {
            let value = Value::Numbers(value.iter().map(|v| f64::from(*v)).collect());
            let values = &mut scene.materials[0].values;
            values.insert(format!("{block}.{name}"), value);
        }
    }
    let [vertex, fragment] = &texts.each_ref().map(|t| in_full_precision(t));
    let drawn = both::draw(&gl, &scene, [vertex, fragment], FirstRow::Highest);
    let pictures = match drawn {
        Ok(pictures) => pictures,
        Err(e) => return format!("not by OpenGL: {}", e.lines().next().unwrap_or_default()),
    };
    let channels = both::channels(fragment);
    let found = pictures.difference(channels);
    let pixels = pictures.native.depth.len();
    if found.seen < pixels / 100 {
        return format!("nothing seen: {} pixels", found.seen);
    }
    let differs = found.apart > 0 || found.edges > pixels / 200;
    if differs && let Some(folder) = std::env::var_os("PRESHADE_PICTURES") {
        let name = files.last().unwrap().replace(['/', '.'], "-");
        pictures.save(Path::new(&folder), &name);
    }
    match differs {
        false => "equal".to_owned(),
        true => format!(
            "differs: {} of {} pixels, by {} of 255 at most; {} at edges",
            found.apart, found.seen, found.most, found.edges
        ),
    }
}

/// A text of GLSL ES with all in `highp`, as preshade reads it: Mesa computes `mediump`, which
/// integers are unless told otherwise, in 16 bits.
fn in_full_precision(text: &str) -> String {
    let is_es = text.lines().any(|l| {
        let l = l.trim();
        l.starts_with("#version") && (l.ends_with("es") || l.ends_with("100"))
    });
    if !is_es {
        return text.to_owned();
    }
    let mut last = text.lines().filter(|l| {
        let l = l.trim_start();
        l.starts_with("#version") || l.starts_with("#extension")
    });
    let last = last.next_back().unwrap_or_default();
    text.replace("mediump", "highp")
        .replace("lowp", "highp")
        .replacen(last, &format!("{last}\nprecision highp int;"), 1)
}

/// A vertex stage for a fragment stage that reads nothing of it, in its dialect.
fn vertex_for(fragment: &str) -> String {
    let version = fragment
        .lines()
        .find(|l| l.trim_start().starts_with("#version"))
        .unwrap_or("#version 100");
    let number: u32 = version
        .split_whitespace()
        .nth(1)
        .and_then(|n| n.parse().ok())
        .unwrap_or(100);
    let word = if number >= 130 { "in" } else { "attribute" };
    format!(
        "{version}\n{word} vec3 position;\nvoid main() {{ \
         gl_Position = vec4(position.xy * 1.5, 0.1 * position.z, 1.0); }}\n"
    )
}
