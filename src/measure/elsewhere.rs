//! What the cameras other than the headline's see of a variant, each where it is most off: pictures for a report.

use std::cell::OnceCell;
use std::sync::Arc;

use super::ErrorLadder;
use crate::render::Rendered;
use crate::report::{Elsewhere, Picture};

/// The pictures of a variant by camera, in the order the cameras were first looked through.
#[derive(Default)]
pub(super) struct OtherCameras(Vec<Elsewhere>);

/// What a view was drawn as: the original, its picture once it is wanted (which the variants share), and the variant.
#[derive(Clone, Copy)]
pub(super) struct Seen<'v> {
    pub(super) reference: &'v Rendered,
    pub(super) shown: &'v OnceCell<Option<Arc<Picture>>>,
    pub(super) picture: &'v Rendered,
}

impl OtherCameras {
    /// Keeps the pictures of a view of `camera`, where no other of that camera is as far off by mean FLIP and then by changed pixels.
    pub(super) fn look(&mut self, camera: &str, view: String, error: &ErrorLadder, seen: Seen<'_>) {
        let key = |e: &ErrorLadder| (e.flip_mean, e.changed_pixels);
        let known = self.0.iter_mut().find(|e| e.camera == camera);
        if known.as_ref().is_some_and(|k| key(error) <= key(&k.error)) {
            return;
        }
        let shown = || Picture::of(seen.reference).map(Arc::new);
        let Some(original) = seen.shown.get_or_init(shown).clone() else {
            return;
        };
        let there = Elsewhere {
            camera: camera.to_owned(),
            view,
            error: error.clone(),
            variant: Picture::of(seen.picture).filter(|p| *p != *original),
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
