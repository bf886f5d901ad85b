//! Draws Bevy's own examples without a pre-pass, with Bevy's, and with the derived one, and compares
//! what the passes drew.
//!
//! ```text
//! export BEVY=../../../../bevy BEVY_ASSET_ROOT=../../../../bevy
//! cargo run --release > results.json             # all examples, each in a process
//! cargo run --release -- NAME [--pictures DIR]   # one
//! cargo run --release -- many derived 1000       # a thousand specialisations
//! ```
//!
//! `BEVY` is a checkout of Bevy 0.19.1: its package has the examples, but not their shaders. Set
//! `BEVY_ASSET_ROOT` to it as well. The examples are as they are. What they see as Bevy is the crate beside: see `bevy/src/lib.rs`.

mod compare;
mod many;

use std::process::{Command, ExitCode};

use bevy::Mode;
use serde_json::{Value, json};

#[allow(warnings, clippy::all)]
mod examples {
    include!(concat!(env!("OUT_DIR"), "/examples.rs"));
}

fn main() -> ExitCode {
    if std::env::var_os("BEVY_ASSET_ROOT").is_none() {
        eprintln!("BEVY_ASSET_ROOT must name the checkout of Bevy, whose assets the examples load");
        return ExitCode::FAILURE;
    }
    let args: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = args.iter().map(String::as_str).collect();
    let row = match words[..] {
        [] => all(),
        ["many", mode, count] => many::row(mode, count),
        [name] => one(name, None),
        [name, "--pictures", folder] => one(name, Some(folder)),
        _ => Err("usage: [NAME [--pictures DIR] | many main|bevy|derived COUNT]".to_owned()),
    };
    match row {
        Ok(row) => {
            println!("{row:#}");
            ExitCode::SUCCESS
        }
        Err(why) => {
            eprintln!("{why}");
            ExitCode::FAILURE
        }
    }
}

/// Each example in a process of its own: one that panics is a row too.
fn all() -> Result<Value, String> {
    let own = std::env::current_exe().map_err(|e| e.to_string())?;
    let row = |name: &str| -> Result<Value, String> {
        eprintln!("{name}");
        let output = Command::new(&own)
            .arg(name)
            .output()
            .map_err(|e| e.to_string())?;
        let failed = || {
            let lines = String::from_utf8_lossy(&output.stderr);
            let why = lines
                .split_once("panicked at")
                .map_or(&*lines, |(_, after)| after);
            let why: Vec<_> = why.lines().take(4).collect();
            json!({ "example": name, "failed": why.join("\n") })
        };
        // Some examples print what their keys do first.
        let text = String::from_utf8_lossy(&output.stdout);
        let own = text.find("{\n").map_or("", |at| &text[at..]);
        Ok(serde_json::from_str(own).unwrap_or_else(|_| failed()))
    };
    let rows: Result<Vec<_>, _> = examples::EXAMPLES
        .iter()
        .map(|(name, _)| row(name))
        .collect();
    Ok(json!({ "bevy": "0.19.1", "examples": rows? }))
}

fn one(name: &str, pictures: Option<&str>) -> Result<Value, String> {
    let Some((name, main)) = examples::EXAMPLES.iter().find(|(of, _)| *of == name) else {
        let names: Vec<_> = examples::EXAMPLES.iter().map(|(of, _)| *of).collect();
        return Err(format!(
            "there is no example {name}; there are {}",
            names.join(", ")
        ));
    };
    let drawn = |mode| bevy::drawn(mode, *main).ok_or(format!("{name} drew nothing"));
    let drawn = [
        drawn(Mode::Main)?,
        drawn(Mode::Bevy)?,
        drawn(Mode::Derived)?,
    ];
    if let Some(folder) = pictures {
        compare::save(name, &drawn, folder.as_ref())?;
    }
    Ok(compare::row(name, &drawn))
}
