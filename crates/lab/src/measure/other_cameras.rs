//! For a report: pictures from the cameras other than the headline's, each where the variant is
//! worst.

use super::unsteady::Original;
use super::{ErrorLadder, View};
use crate::measure::record::{Elsewhere, Picture};
use preshade_draw::render::Rendered;

/// The pictures of a variant by camera, in the order the cameras were first looked through.
#[derive(Default)]
pub(super) struct OtherCameras(Vec<Elsewhere>);

impl OtherCameras {
    /// Keeps the pictures of this view if it is the camera's worst so far, by mean FLIP and then by
    /// changed pixels.
    pub(super) fn look(
        &mut self,
        view: &View,
        error: &ErrorLadder,
        seen: &Original,
        picture: &Rendered,
    ) {
        let key = |e: &ErrorLadder| (e.flip_mean, e.changed_pixels);
        let known = self.0.iter_mut().find(|e| e.camera == view.camera);
        if known.as_ref().is_some_and(|k| key(error) <= key(&k.error)) {
            return;
        }
        let Some(original) = seen.shown() else {
            return;
        };
        let there = Elsewhere {
            camera: view.camera.clone(),
            view: view.described(),
            error: error.clone(),
            variant: Picture::of(picture).filter(|p| *p != *original),
            original,
        };
        match known {
            Some(known) => *known = there,
            None => self.0.push(there),
        }
    }

    pub(super) fn pictures(self) -> Vec<Elsewhere> {
        self.0
    }
}
