//! Auxiliary pictures for people to look at.

use super::{Error, alone, covered, frames, pass_of, seen_in};
use crate::measure::record::Picture;
use crate::measure::{Session, Variant};
use preshade_draw::render::{ColorImage, FrameSettings, Prepared, SceneInputs};
use preshade_draw::scene::{DrawOrder, Scene};

/// The auxiliary pictures of a variant from the first camera, each by the end of its attachment's
/// name: `velocity`, `normal`, `id`. `earlier`: the scene's draws in the previous frame.
pub(crate) fn pictures(
    session: &Session<'_>,
    earlier: &Scene,
    variant: &Variant,
) -> Result<Vec<(String, Picture)>, Error> {
    let (gpu, scene) = (session.gpu(), session.scene());
    let camera = scene.cameras.first();
    let pass = variant.plans.iter().find_map(pass_of);
    let (Some((camera, [before, now])), Some(pass)) =
        (camera.and_then(|c| Some((c, frames(c)?))), pass)
    else {
        return Ok(Vec::new());
    };
    let [earlier, scene] =
        [(earlier, before), (scene, now)].map(|(scene, frame)| seen_in(scene, camera, frame));
    let previous = SceneInputs::new(gpu, &earlier)?;
    let inputs = SceneInputs::new(gpu, &scene)?.after(&previous);
    let drawn = preshade_scenes::variant(&alone(&variant.plans), session.form())?;
    let mut prepared = Prepared::new(&inputs, &drawn, &FrameSettings::of(&scene))?;
    prepared.aim(&now, DrawOrder::FrontToBack);
    let drawn = prepared.render()?;
    let mut covered: Vec<bool> = covered(&drawn).collect();
    if !covered.contains(&true) {
        // Its surfaces lie on a plane.
        covered.clear();
    }
    let targets = pass.targets.iter().zip(&drawn.colors);
    let named = targets.filter_map(|(target, image)| {
        let name = target.as_ref()?.attachment.as_deref()?;
        let name = name.strip_prefix("outputs-").unwrap_or(name);
        Some((name.to_owned(), shown(image.as_ref()?, &covered)))
    });
    Ok(named.collect())
}

/// An image as colours, black where nothing is drawn. Numbers of floats lie around grey, with the largest
/// magnitude at the ends. Each integer has a colour of its own, and 0 is black.
fn shown(image: &ColorImage, covered: &[bool]) -> Picture {
    let is_covered = |i: usize| covered.get(i).copied().unwrap_or(true);
    let pixels = 0..image.size[0] as usize * image.size[1] as usize;
    let largest = |i: usize| {
        image.rgba(i)[..3]
            .iter()
            .fold(0.0, |m: f32, v| m.max(v.abs()))
    };
    let drawn = pixels.clone().filter(|i| is_covered(*i));
    let finite = drawn.map(largest).filter(|v| v.is_finite());
    let scale = finite.fold(f32::MIN_POSITIVE, f32::max);
    let texel = |i: usize| match image.integers(i) {
        _ if !is_covered(i) => [0, 0, 0],
        Some([0, 0, 0, 0]) => [0, 0, 0],
        Some(id) => {
            let hash = blake3::hash(&id.map(i64::to_le_bytes).concat());
            let [r, g, b, ..] = *hash.as_bytes();
            [r, g, b]
        }
        None => {
            let [r, g, b, _] = image.rgba(i);
            [r, g, b].map(|v| match image.is_float() {
                true => (127.5 + 127.5 * v / scale).round() as u8,
                false => (255.0 * v).round() as u8,
            })
        }
    };
    Picture {
        size: image.size,
        rgba: pixels
            .flat_map(|i| {
                let [r, g, b] = texel(i);
                [r, g, b, 255]
            })
            .collect(),
    }
}
