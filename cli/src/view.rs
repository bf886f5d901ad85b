//! `--camera` and `--size`.

use preshade_draw::render::Gpu;
use preshade_draw::scene::Scene;
use preshade_lab::measure::parse_size;

use crate::{Failure, output};

/// Cameras and resolution.
#[derive(clap::Args)]
pub struct ViewArgs {
    /// Draw only these cameras; the first is the headline.
    #[arg(long, value_name = "NAME")]
    camera: Vec<String>,
    /// Resolution, for example `1920x1080`.
    #[arg(long, value_name = "WxH", allow_hyphen_values = true, value_parser = parse_size)]
    size: Option<[u32; 2]>,
}

impl ViewArgs {
    /// The scene with these cameras and this resolution.
    pub fn of(&self, mut scene: Scene) -> Result<Scene, Failure> {
        if let Some(size) = self.size {
            scene = scene.resized(size);
        }
        if self.camera.is_empty() {
            return Ok(scene);
        }
        let all = std::mem::take(&mut scene.cameras);
        for name in &self.camera {
            match all.iter().find(|c| c.name == *name) {
                Some(camera) => scene.cameras.push(camera.clone()),
                None => {
                    let names: Vec<_> = all.iter().map(|c| c.name.as_str()).collect();
                    return Err(Failure::unknown("camera", name, &names));
                }
            }
        }
        Ok(scene)
    }

    pub fn size(&self) -> Option<[u32; 2]> {
        self.size
    }

    /// The scene with about `most` pixels if the adapter is software and no size was given.
    pub fn reduced(&self, scene: Scene, gpu: &Gpu, most: [u32; 2]) -> Scene {
        let most = f64::from(most[0]) * f64::from(most[1]);
        let [w, h] = scene.size.map(f64::from);
        let scale = (most / (w * h)).sqrt();
        if self.size.is_some() || gpu.adapter().kind != "software" || scale >= 1.0 {
            return scene;
        }
        let size = [w, h].map(|side| ((side * scale) as u32).max(1));
        output::message(&format!(
            "note: drawn at {}x{}, since this is a software adapter (--size says another)",
            size[0], size[1]
        ));
        scene.resized(size)
    }

    pub fn is_given(&self) -> bool {
        self.size.is_some() || !self.camera.is_empty()
    }
}
