//! How much GLSL of other people's is read: over the folders named, a table of what is accepted and
//! why the rest is refused.
//!
//! ```text
//! cargo run --release --example glsl-corpus --features glsl,spirv -- [--verbose] [--limit SECONDS] [--include DIR] [--write DIR] FOLDER..
//! cargo run --release --example glsl-corpus --features glsl,spirv -- --print FILE [FILE]
//! cargo run --release --example glsl-corpus --features glsl,spirv -- --time FILE [FILE]
//! ```
//!
//! A pair is two files of one name, `.vert` and `.frag` or `.vs` and `.fs`; a fragment shader by
//! itself is given a vertex stage that writes what it reads, and a file with `#pragma stage` lines
//! is a pair. A material that takes longer than 30 seconds (`--limit`) hangs; each hundred of them
//! is told on stderr, with the slowest. `--write` keeps what is emitted, for other compilers to
//! look at. Accepted is what parses, validates, is emitted as WGSL that reads back as the same
//! program, and as GLSL 4.50 or ES 3.00 that is read in again.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a tool that ends with a message"
)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use preshade::unstable::emit::{self, Target};
use preshade::unstable::front::{self, Code, Options, Source};
use preshade::unstable::passes::plan::Plan;
use preshade::unstable::passes::state::MaterialState;

/// What takes longer hangs, unless `--limit` says otherwise.
const LIMIT: Duration = Duration::from_secs(30);

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Outcome {
    Accepted,
    Refused(String),
    Panicked(String),
    Hung,
}

/// One material's files.
struct Case {
    name: String,
    paths: Vec<PathBuf>,
}

fn main() {
    let mut folders = Vec::new();
    let mut include = Vec::new();
    let mut write = None;
    let mut limit = LIMIT;
    let (mut verbose, mut print, mut time) = (false, false, false);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--verbose" => verbose = true,
            "--print" => print = true,
            "--time" => time = true,
            "--write" => write = arguments.next().map(PathBuf::from),
            "--limit" => {
                let seconds = arguments.next().and_then(|n| n.parse().ok());
                limit = seconds.map_or(LIMIT, Duration::from_secs);
            }
            "--include" => include.extend(arguments.next().map(PathBuf::from)),
            _ => folders.push(PathBuf::from(argument)),
        }
    }
    assert!(!folders.is_empty(), "name a folder or more");
    if time {
        return timed(&folders, include);
    }
    if print {
        return normalised(&folders, include);
    }
    for folder in &folders {
        table(folder, &include, write.as_deref(), limit, verbose);
    }
}

/// How long one material takes, the parser's share apart; each the least of twenty.
fn timed(paths: &[PathBuf], include: Vec<PathBuf>) {
    let options = Options {
        include,
        ..Options::default()
    };
    let read = |p: &PathBuf| Source::new(p.to_string_lossy(), std::fs::read_to_string(p).unwrap());
    let sources: Vec<Source> = paths.iter().map(read).collect();
    let least = |run: &dyn Fn()| {
        let once = |_| {
            let begun = Instant::now();
            run();
            begun.elapsed()
        };
        (0..20).map(once).min().unwrap_or_default()
    };
    let parser = least(&|| drop(front::glsl_syntax(&sources, &options)));
    let rewritten = least(&|| drop(front::normalised_glsl(&sources, &options)));
    let whole = least(&|| drop(front::parse(&sources, &options)));
    let out = front::parse(&sources, &options).ok().map(|parsed| {
        let fragment = parsed.fragment.as_deref();
        let state = MaterialState::default();
        let plan = Plan::original("material", parsed.program, &parsed.vertex, fragment, &state);
        let choices = emit::Options::default();
        least(&|| drop(emit::emit(&plan, &[Target::GlslEs300], &choices)))
    });
    println!("preprocessed and parsed: {parser:.1?}");
    println!("rewritten: {:.1?}", rewritten.saturating_sub(parser));
    println!(
        "by naga, validated and linked: {:.1?}",
        whole.saturating_sub(rewritten)
    );
    println!("in all: {whole:.1?}");
    if let Some(out) = out {
        println!("out again as GLSL ES 3.00, read back and compared: {out:.1?}");
    }
}

/// Shows what naga's front end is given for one material.
fn normalised(paths: &[PathBuf], include: Vec<PathBuf>) {
    let options = Options {
        include,
        ..Options::default()
    };
    let read = |p: &PathBuf| Source::new(p.to_string_lossy(), std::fs::read_to_string(p).unwrap());
    let sources: Vec<Source> = paths.iter().map(read).collect();
    match front::normalised_glsl(&sources, &options) {
        Ok(stages) => stages.iter().for_each(|(_, text)| println!("{text}")),
        Err(error) => println!("{}", error.render(front::Color::Never)),
    }
    if let Err(error) = front::parse(&sources, &options) {
        println!("{}", error.render(front::Color::Never));
    }
}

fn table(folder: &Path, include: &[PathBuf], write: Option<&Path>, limit: Duration, verbose: bool) {
    let mut files = Vec::new();
    walk(folder, &mut files);
    let (cases, others) = cases(&files);
    let mut counted: BTreeMap<Outcome, Vec<String>> = BTreeMap::new();
    let begun = Instant::now();
    let mut slowest = (Duration::ZERO, "");
    for (i, case) in cases.iter().enumerate() {
        let began = Instant::now();
        let outcome = limited(case, include, write, limit);
        slowest = slowest.max((began.elapsed(), case.name.as_str()));
        if (i + 1) % 100 == 0 {
            let (all, seconds) = (cases.len(), begun.elapsed().as_secs_f64());
            let (longest, name) = (slowest.0.as_secs_f64(), slowest.1);
            eprintln!(
                "{} of {all} in {seconds:.0} s; slowest {longest:.1} s: {name}",
                i + 1
            );
        }
        if verbose && outcome != Outcome::Accepted {
            println!("{}: {outcome:?}", case.name);
        }
        let outcome = match outcome {
            Outcome::Refused(why) => Outcome::Refused(general(&why)),
            other => other,
        };
        counted.entry(outcome).or_default().push(case.name.clone());
    }
    let accepted = counted.get(&Outcome::Accepted).map_or(0, Vec::len);
    let panics = counted.keys().filter(|o| matches!(o, Outcome::Panicked(_)));
    let panics: usize = panics.map(|o| counted[o].len()).sum();
    let hung = counted.get(&Outcome::Hung).map_or(0, Vec::len);
    println!("## {}", folder.display());
    println!(
        "| materials | accepted | share | refused | panics | hangs | files of other stages | \
         seconds |\n|---|---|---|---|---|---|---|---|\n\
         | {} | {accepted} | {:.1}% | {} | {panics} | {hung} | {others} | {:.1} |\n",
        cases.len(),
        100.0 * accepted as f64 / cases.len().max(1) as f64,
        cases.len() - accepted - panics - hung,
        begun.elapsed().as_secs_f64(),
    );
    let mut reasons: Vec<(usize, String, &String)> = counted
        .iter()
        .filter_map(|(outcome, names)| match outcome {
            Outcome::Accepted => None,
            Outcome::Refused(why) => Some((names.len(), why.clone(), &names[0])),
            Outcome::Panicked(why) => Some((names.len(), format!("PANIC {why}"), &names[0])),
            Outcome::Hung => Some((names.len(), "HANG".to_owned(), &names[0])),
        })
        .collect();
    reasons.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
    if !reasons.is_empty() {
        println!("| count | reason | first |\n|---|---|---|");
        for (count, why, first) in &reasons {
            println!("| {count} | {} | {first} |", why.replace('|', "\\|"));
        }
        println!();
    }
}

fn walk(path: &Path, out: &mut Vec<PathBuf>) {
    if path.is_file() {
        out.push(path.to_owned());
        return;
    }
    let mut inside: Vec<PathBuf> = std::fs::read_dir(path)
        .into_iter()
        .flatten()
        .filter_map(|e| Some(e.ok()?.path()))
        .collect();
    inside.sort();
    for path in inside {
        walk(&path, out);
    }
}

fn cases(files: &[PathBuf]) -> (Vec<Case>, usize) {
    let mut by_stem: BTreeMap<PathBuf, [Option<PathBuf>; 2]> = BTreeMap::new();
    let mut cases = Vec::new();
    let mut others = 0;
    // A pair with a stage between its two is no pair.
    let between = |file: &Path| {
        let mut stages = ["gs", "geom", "tcs", "tesc"].iter();
        stages.any(|e| file.with_extension(e).is_file())
    };
    for file in files {
        let stage = match file.extension().and_then(|e| e.to_str()) {
            Some("vert" | "vs") => 0,
            Some("frag" | "fs") => 1,
            Some("slang") => {
                cases.push(Case {
                    name: file.display().to_string(),
                    paths: vec![file.clone()],
                });
                continue;
            }
            Some("gs" | "geom" | "cs" | "comp" | "tcs" | "tes" | "tesc" | "tese") => {
                others += 1;
                continue;
            }
            _ => continue,
        };
        if between(file) {
            others += 1;
            continue;
        }
        by_stem.entry(file.with_extension("")).or_default()[stage] = Some(file.clone());
    }
    for (stem, pair) in by_stem {
        cases.push(Case {
            name: stem.display().to_string(),
            paths: pair.into_iter().flatten().collect(),
        });
    }
    cases.sort_by(|a, b| a.name.cmp(&b.name));
    (cases, others)
}

fn limited(case: &Case, include: &[PathBuf], write: Option<&Path>, limit: Duration) -> Outcome {
    let (send, receive) = mpsc::channel();
    let (paths, include) = (case.paths.clone(), include.to_vec());
    // Folders and all, so that two materials of one name stay apart.
    let name = case.name.replace(['/', '\\', '.'], "-");
    let write = write.map(|folder| folder.join(name));
    let spawned = std::thread::Builder::new()
        .stack_size(64 << 20)
        .spawn(move || send.send(judge(&paths, include, write.as_deref())).ok());
    assert!(spawned.is_ok());
    match receive.recv_timeout(limit) {
        Ok(outcome) => outcome,
        Err(mpsc::RecvTimeoutError::Timeout) => Outcome::Hung,
        Err(mpsc::RecvTimeoutError::Disconnected) => {
            Outcome::Panicked("outside of naga".to_owned())
        }
    }
}

fn judge(paths: &[PathBuf], include: Vec<PathBuf>, write: Option<&Path>) -> Outcome {
    let options = Options {
        include,
        ..Options::default()
    };
    let mut sources = Vec::new();
    for path in paths {
        let Ok(bytes) = std::fs::read(path) else {
            return Outcome::Refused("the file cannot be read".to_owned());
        };
        sources.push(Source::new(
            path.to_string_lossy(),
            String::from_utf8_lossy(&bytes),
        ));
    }
    let alone = paths.len() == 1
        && paths[0]
            .extension()
            .is_some_and(|e| e == "frag" || e == "fs");
    if alone {
        match front::vertex_stage_for(&sources[0], &options) {
            Ok(text) => sources.insert(0, Source::new("generated.vert", text)),
            Err(error) => return refused(&error),
        }
    }
    let parsed = match front::parse(&sources, &options) {
        Ok(parsed) => parsed,
        Err(error) => return refused(&error),
    };
    let plan = Plan::original(
        "material",
        parsed.program.clone(),
        &parsed.vertex,
        parsed.fragment.as_deref(),
        &MaterialState::default(),
    );
    // The emitter itself reads WGSL back and compares.
    if let Err(error) = emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()) {
        return Outcome::Refused(error.to_string());
    }
    let mut last = String::new();
    let mut accepted = false;
    for target in [Target::Glsl450, Target::GlslEs300] {
        // The emitter reads GLSL back too, stage by stage; here the stages are linked.
        let files = match emit::emit(&plan, &[target], &emit::Options::default()) {
            Ok(files) => files,
            // Of two languages one is enough.
            Err(error @ emit::EmitError::Inexpressible { .. }) => {
                last = error.to_string();
                continue;
            }
            Err(error) => return Outcome::Refused(error.to_string()),
        };
        if let Some(folder) = write
            && let Err(error) = emit::write(folder, &files)
        {
            return Outcome::Refused(error.to_string());
        }
        let texts: Vec<Source> = files
            .iter()
            .filter(|f| f.name.ends_with(".vert") || f.name.ends_with(".frag"))
            .map(|f| Source::new(&f.name, String::from_utf8_lossy(&f.bytes)))
            .collect();
        if let Err(error) = front::parse(&texts, &Options::default()) {
            let why = format!("read back: {}", error.message());
            return Outcome::Refused(why);
        }
        accepted = true;
    }
    match accepted {
        true => Outcome::Accepted,
        false => Outcome::Refused(last),
    }
}

fn refused(error: &front::Error) -> Outcome {
    match error.code() {
        Code::Panic => Outcome::Panicked(error.notes().first().cloned().unwrap_or_default()),
        code => Outcome::Refused(format!("{}: {}", code.name(), error.message())),
    }
}

/// The message without what is this file's alone: names in quotes and numbers.
fn general(message: &str) -> String {
    let mut out = String::new();
    let mut quoted = None;
    for c in message.chars() {
        match quoted {
            Some(q) if c == q => quoted = None,
            Some(_) => {}
            None if matches!(c, '`' | '"') => {
                quoted = Some(c);
                out.push('_');
            }
            None if c.is_ascii_digit() => {
                if !out.ends_with('#') {
                    out.push('#');
                }
            }
            None => out.push(c),
        }
    }
    out.chars().take(160).collect()
}
