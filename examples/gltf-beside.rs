//! Draws glTF files beside pictures of them that another renderer made, as a table and a sheet.
//!
//! ```text
//! cargo run --features verify --example gltf-beside -- FOLDER [--most 0.05]
//! ```
//!
//! FOLDER has a picture `NAME.three.png` for each `NAME.glb`. The other pictures, `sheet.png` and
//! `table.md` go there too. With `--most`, the status is 1 if a mean of FLIP is above it.
//! `tests/three/gltf.mjs` makes such a folder with three.js, and runs this.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a tool that ends with a message"
)]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use image::{RgbImage, imageops};
use preshade_draw::render::{AdapterChoice, Gpu};
use preshade_draw::scene::DrawOrder;
use preshade_lab::measure::Session;
use preshade_scenes::ShaderForm;
use preshade_scenes::{Access, Shading, Variables};

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().expect("a folder"));
    let most: Option<f64> = match arguments.next().as_deref() {
        Some("--most") => Some(arguments.next().unwrap().parse().unwrap()),
        _ => None,
    };
    let mut files: Vec<PathBuf> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "glb" || e == "gltf"))
        .filter(|p| p.with_extension("three.png").is_file())
        .collect();
    files.sort();
    let gpu = Gpu::new(&AdapterChoice::Best).unwrap();
    let mut table =
        "| file | draws | materials | FLIP, mean | most |\n|---|--:|--:|--:|--:|\n".to_owned();
    let mut rows = Vec::new();
    let mut is_within = true;
    for file in &files {
        let name = file.file_stem().unwrap().to_string_lossy().into_owned();
        let theirs = image::open(file.with_extension("three.png"))
            .unwrap()
            .to_rgb8();
        let (ours, draws, materials) = match drawn(&gpu, file, [theirs.width(), theirs.height()]) {
            Ok(drawn) => drawn,
            Err(why) => {
                eprintln!("{name}: {why}");
                is_within = false;
                continue;
            }
        };
        ours.save(file.with_extension("preshade.png")).unwrap();
        let flip_image =
            |i: &RgbImage| nv_flip::FlipImageRgb8::with_data(i.width(), i.height(), i.as_raw());
        let map = nv_flip::flip(
            flip_image(&theirs),
            flip_image(&ours),
            nv_flip::DEFAULT_PIXELS_PER_DEGREE,
        );
        let values = map.to_vec();
        let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64;
        let largest = values.iter().copied().fold(0.0, f32::max);
        let _ = writeln!(
            table,
            "| {name} | {draws} | {materials} | {mean:.4} | {largest:.3} |"
        );
        is_within &= most.is_none_or(|most| mean <= most);
        let difference = RgbImage::from_fn(ours.width(), ours.height(), |x, y| {
            let v = values[(y * ours.width() + x) as usize];
            image::Rgb([(v * 255.0) as u8; 3])
        });
        rows.push([theirs, ours, difference]);
    }
    print!("{table}");
    std::fs::write(folder.join("table.md"), &table).unwrap();
    sheet(&rows).save(folder.join("sheet.png")).unwrap();
    match is_within {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}

/// The picture of a file from its first camera, and its numbers of draws and materials.
fn drawn(gpu: &Gpu, file: &Path, size: [u32; 2]) -> Result<(RgbImage, usize, usize), String> {
    let (shading, variables) = (Shading::BuiltIn, Variables::new());
    let scene = preshade_scenes::load_gltf(file, &shading, &variables, Access::default());
    let scene = scene.map_err(|e| e.render())?.resized(size);
    for note in &scene.notes {
        eprintln!("{note}");
    }
    let session = Session::new(gpu, &scene, ShaderForm::Text).map_err(|e| e.to_string())?;
    let prepared = session.prepare(session.originals());
    let mut prepared = prepared.map_err(|e| e.to_string())?;
    let frame = &scene.cameras[0].frames[0];
    let picture = session.draw(&mut prepared, frame, DrawOrder::FrontToBack);
    let picture = picture.map_err(|e| e.to_string())?;
    let color = picture.colors.into_iter().flatten().next();
    let texels = color.ok_or("it draws to no colour")?.to_rgba8();
    let rgb = texels
        .as_chunks::<4>()
        .0
        .iter()
        .flat_map(|t| [t[0], t[1], t[2]]);
    let image = RgbImage::from_raw(size[0], size[1], rgb.collect()).unwrap();
    Ok((image, scene.draws.len(), scene.materials.len()))
}

/// All pictures at half their size: three.js, preshade, and FLIP, twice in a row.
fn sheet(rows: &[[RgbImage; 3]]) -> RgbImage {
    let Some([first, ..]) = rows.first() else {
        return RgbImage::new(1, 1);
    };
    let (w, h) = (first.width() / 2, first.height() / 2);
    let mut sheet = RgbImage::new(w * 6, h * rows.len().div_ceil(2) as u32);
    for (i, row) in rows.iter().enumerate() {
        for (j, picture) in row.iter().enumerate() {
            let small = imageops::resize(picture, w, h, imageops::FilterType::Triangle);
            let column = (i % 2 * 3 + j) as u32;
            let (x, y) = (i64::from(column * w), i64::from(i as u32 / 2 * h));
            imageops::replace(&mut sheet, &small, x, y);
        }
    }
    sheet
}
