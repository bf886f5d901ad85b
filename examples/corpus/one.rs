//! What one material is, and how long it takes to read.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use preshade_compiler::emit;
use preshade_compiler::front::{self, Options, Source};
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;

/// The files' sources. Bytes that are neither text nor SPIR-V are replaced.
pub fn sources(paths: &[PathBuf]) -> Vec<Source> {
    let read = |path: &PathBuf| {
        let (name, bytes) = (path.to_string_lossy(), std::fs::read(path).unwrap());
        let text = String::from_utf8_lossy(&bytes).into_owned();
        Source::from_bytes(name.clone(), bytes).unwrap_or_else(|_| Source::new(name, text))
    };
    paths.iter().map(read).collect()
}

fn options(include: &[PathBuf]) -> Options {
    Options {
        include: include.to_vec(),
        ..Options::default()
    }
}

/// Shows one material as WGSL.
pub fn print(paths: &[PathBuf], include: &[PathBuf]) {
    let (sources, options) = (sources(paths), options(include));
    match front::parse(&sources, &options) {
        Ok(parsed) => {
            let plan = parsed.plan("material", &MaterialState::default());
            match emit::emit(&plan, &[Target::Wgsl], &emit::Options::default()) {
                Ok(files) => files
                    .iter()
                    .for_each(|f| println!("{}", String::from_utf8_lossy(&f.bytes))),
                Err(error) => println!("{error}"),
            }
        }
        Err(error) => println!("{}", error.render(front::Color::Never)),
    }
}

/// How long one material takes, the parser's share apart; each the least of twenty.
pub fn time(paths: &[PathBuf], include: &[PathBuf]) {
    let (sources, options) = (sources(paths), options(include));
    let least = |run: &dyn Fn()| {
        let once = |_| {
            let begun = Instant::now();
            run();
            begun.elapsed()
        };
        (0..20).map(once).min().unwrap_or_default()
    };
    let parser = least(&|| drop(front::glsl_syntax(&sources, &options)));
    let whole = least(&|| drop(front::parse(&sources, &options)));
    let share = |a: Duration, b: Duration| a.saturating_sub(b);
    println!("preprocessed and parsed: {parser:.1?}");
    println!(
        "resolved, written, validated and linked: {:.1?}",
        share(whole, parser)
    );
    println!("in all: {whole:.1?}");
    if let Ok(parsed) = front::parse(&sources, &options) {
        let plan = parsed.plan("material", &MaterialState::default());
        let choices = emit::Options::default();
        let out = least(&|| drop(emit::emit(&plan, &[Target::GlslEs300], &choices)));
        println!("out again as GLSL ES 3.00, read back and compared: {out:.1?}");
    }
}
