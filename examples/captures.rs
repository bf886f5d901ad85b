//! Replays captured frames and compares each with the picture that its page showed:
//!
//! ```sh
//! cargo run --release --all-features --example captures -- [--adapter TEXT] [--pictures DIR] FOLDER..
//! ```
//!
//! A line of JSON for each folder. The exit status is 1 if a frame differs or could not be replayed.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use preshade_draw::render::{AdapterChoice, Gpu};
use preshade_frames::folder::Capture;
use preshade_lab::measure::record::Picture;
use preshade_scenes::capture::{self, Choice, check};
use serde_json::{Value, json};
use shader_text::limits::Limits;

fn main() -> ExitCode {
    let (mut adapter, mut pictures, mut folders) = (AdapterChoice::Best, None, Vec::new());
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--adapter" => {
                adapter = AdapterChoice::Matching(arguments.next().unwrap_or_default());
            }
            "--pictures" => pictures = arguments.next().map(PathBuf::from),
            folder => folders.push(PathBuf::from(folder)),
        }
    }
    let gpu = match Gpu::new(&adapter) {
        Ok(gpu) => gpu,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::from(2);
        }
    };
    let mut is_same = true;
    for folder in &folders {
        let (line, same) = match one(folder, &gpu, pictures.as_deref()) {
            Ok(found) => found,
            Err(error) => (json!({ "error": error.to_string() }), false),
        };
        is_same &= same;
        println!(
            "{}",
            json!({ "folder": folder, "adapter": gpu.adapter().name, "found": line })
        );
    }
    match is_same {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}

fn one(folder: &Path, gpu: &Gpu, pictures: Option<&Path>) -> Result<(Value, bool), capture::Error> {
    let capture = Capture::open(folder, &Limits::default())?;
    let found = check(&capture, gpu)?;
    if let Some(to) = pictures {
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        for (frame, picture) in found.pictures.iter().enumerate() {
            let picture = Picture {
                size: picture.size,
                rgba: picture.to_rgba8(),
            };
            let written = picture.file(&format!("{name}.{frame}.png"));
            match written {
                Ok(file) => {
                    let path = to.join(&file.name);
                    if let Err(error) = std::fs::write(&path, &file.bytes) {
                        eprintln!("{}: {error}", path.display());
                    }
                }
                Err(error) => eprintln!("{name}: {error}"),
            }
        }
    }
    let passes: Vec<Value> = preshade_frames::pass::passes(&capture, 0)?
        .iter()
        .map(|p| json!({ "kind": p.kind.name(), "draws": p.draws.len() }))
        .collect();
    let left_out: Vec<Value> = found
        .left_out
        .iter()
        .map(|(left, count)| json!({ "what": left.what, "why": left.why, "count": count }))
        .collect();
    let scene = match capture::scene(&capture, Choice::default(), Some(gpu)) {
        Ok(made) => json!({
            "materials": made.materials.iter().map(|m| &m.name).collect::<Vec<_>>(),
            "draws": made.draws.len(),
            "notes": made.notes,
        }),
        Err(error) => json!({ "error": error.to_string() }),
    };
    let same = found.left_out.is_empty() && found.frames.iter().all(|f| f.by_more == 0);
    let line = json!({
        "api": format!("{:?}", capture.file.source.api),
        "frames": found.frames,
        "passes": passes,
        "left out": left_out,
        "refused": capture.file.refused.iter().map(|r| &r.what).collect::<Vec<_>>(),
        "scene": scene,
    });
    Ok((line, same))
}
