//! `--camera` and `--size`.

use preshade::unstable::scene::Scene;

use crate::Failure;

/// Cameras and resolution.
#[derive(clap::Args)]
pub struct ViewArgs {
    /// Draw only these cameras; the first is the headline.
    #[arg(long, value_name = "NAME")]
    camera: Vec<String>,
    /// Resolution, for example `1920x1080`.
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
}

impl ViewArgs {
    /// The scene with these cameras and this resolution.
    ///
    /// # Errors
    /// The scene has no camera of that name.
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

    /// The requested resolution.
    pub fn size(&self) -> Option<[u32; 2]> {
        self.size
    }

    /// Whether a resolution is given.
    pub fn is_sized(&self) -> bool {
        self.size.is_some()
    }

    /// Whether anything is given.
    pub fn is_given(&self) -> bool {
        self.size.is_some() || !self.camera.is_empty()
    }
}

/// Reads `WxH`.
pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let (w, h) = text
        .split_once(['x', 'X'])
        .ok_or("expected WxH, 1920x1080 say")?;
    let side = |s: &str| match s.trim().parse::<u32>() {
        Ok(n @ 1..=8192) => Ok(n),
        _ => Err(format!("`{s}` is not a number from 1 to 8192")),
    };
    Ok([side(w)?, side(h)?])
}
