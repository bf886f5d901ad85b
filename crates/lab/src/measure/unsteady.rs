//! Pixels of a captured frame that differ when the original is drawn twice. They are no evidence
//! about a variant, so they are left out of its comparison, and counted.

use std::cell::OnceCell;
use std::sync::Arc;

use super::promises_by_material::only;
use super::record::Picture;
use super::{Error, Subject, View};
use preshade_draw::render::Rendered;
use preshade_draw::scene::{Frame, Scene};

/// How often the original is drawn again before a variant is called broken.
const REDRAWS: usize = 8;

/// If a larger part of the pixels differs, none is left out, and the frame is not measured.
const MOST: f64 = 0.01;

/// The original's picture of a view, and where it differs from itself.
pub(crate) struct Original {
    pub picture: Rendered,
    /// By sample: whether the pixel was the same in all pictures. `None`: every difference counts.
    steady: Option<Vec<bool>>,
    samples: usize,
    is_redrawn: bool,
    /// Its first colours, which reports of all variants share.
    shown: OnceCell<Option<Arc<Picture>>>,
}

impl Original {
    /// A picture without a second one so far. In a scene that a user wrote, every difference
    /// counts.
    pub fn new(picture: Rendered, scene: &Scene) -> Self {
        let depth = picture.depth.as_ref();
        let samples = depth.map_or(1, |d| d.samples.max(1) as usize);
        let steady = scene.is_captured().then(|| {
            let color = picture.colors.iter().flatten().next().map(|c| c.size);
            let [width, height] = color.or(depth.map(|d| d.size)).unwrap_or([0, 0]);
            vec![true; width as usize * height as usize * samples]
        });
        Self {
            picture,
            steady,
            samples,
            is_redrawn: false,
            shown: OnceCell::new(),
        }
    }

    /// As an 8-bit picture.
    pub fn shown(&self) -> Option<Arc<Picture>> {
        let shown = || Picture::of(&self.picture).map(Arc::new);
        self.shown.get_or_init(shown).clone()
    }

    /// Pixels that are left out.
    pub fn unsteady(&self) -> u64 {
        match self.leaves_out() {
            true => self.differing(),
            false => 0,
        }
    }

    fn differing(&self) -> u64 {
        let samples = self.steady.iter().flatten().filter(|steady| !**steady);
        (samples.count() / self.samples) as u64
    }

    fn leaves_out(&self) -> bool {
        self.steady.as_ref().is_some_and(|steady| {
            let pixels = steady.len() / self.samples;
            self.differing() as f64 <= MOST * pixels as f64
        })
    }

    /// Marks the pixels in which another picture of the original differs. Returns it without the
    /// differences that are left out.
    pub fn repeated(&mut self, again: Rendered) -> Rendered {
        let Some(steady) = &mut self.steady else {
            return again;
        };
        for (i, pixel) in steady.chunks_mut(self.samples).enumerate() {
            let mut colors = self.picture.colors.iter().zip(&again.colors);
            let colors = colors.all(|pair| match pair {
                (Some(a), Some(b)) => a.texel(i) == b.texel(i),
                _ => true,
            });
            let range = i * self.samples..(i + 1) * self.samples;
            let depths = |picture: &Rendered| -> Option<Vec<u32>> {
                let depth = picture.depth.as_ref()?;
                let values = depth.values.get(range.clone())?;
                Some(values.iter().map(|value| value.to_bits()).collect())
            };
            if !colors || depths(&self.picture) != depths(&again) {
                pixel.fill(false);
            }
        }
        self.steadied(again)
    }

    /// A picture with the original's bits in the pixels that are left out.
    pub fn steadied(&self, picture: Rendered) -> Rendered {
        match &self.steady {
            Some(steady) if self.leaves_out() && self.differing() > 0 => {
                only(steady, [&self.picture, &picture])
            }
            _ => picture,
        }
    }

    /// The picture of a variant, to compare with the first. Before the variant is blamed, the
    /// original is drawn several times more: an original that repeats itself only most of the time
    /// proves nothing.
    pub(crate) fn of_variant(
        &mut self,
        original: &mut Subject<'_>,
        variant: &mut Subject<'_>,
        (view, frame): (&View, &Frame),
        picture: Rendered,
    ) -> Result<Rendered, Error> {
        let picture = self.steadied(picture);
        if self.is_redrawn || !variant.breaks((view, frame), &self.picture, &picture)? {
            return Ok(picture);
        }
        self.is_redrawn = true;
        for _ in 0..REDRAWS {
            let Some(again) = original.draw(frame, view.order)? else {
                break;
            };
            let again = self.repeated(again);
            let error = original.judge((view, frame), &self.picture, &again)?;
            if !error.is_exact() {
                break;
            }
        }
        Ok(self.steadied(picture))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use preshade_draw::render::ColorImage;

    /// 20 x 20 pixels, black but for `white`.
    fn picture(white: &[usize]) -> Rendered {
        let mut bytes = vec![0; 4 * 400];
        for i in white {
            bytes[4 * i..4 * i + 4].fill(255);
        }
        let image = ColorImage {
            size: [20, 20],
            format: wgpu::TextureFormat::Rgba8Unorm,
            bytes,
        };
        Rendered {
            colors: vec![Some(image)],
            depth: None,
        }
    }

    fn original(is_captured: bool) -> Original {
        Original {
            picture: picture(&[]),
            steady: is_captured.then(|| vec![true; 400]),
            samples: 1,
            is_redrawn: false,
            shown: OnceCell::new(),
        }
    }

    #[test]
    fn unsteady_pixels_of_a_captured_frame_are_left_out_and_counted() {
        let mut first = original(true);
        assert_eq!(first.repeated(picture(&[7])), first.picture);
        assert_eq!(first.unsteady(), 1);
        // Other differences are the variant's.
        assert_eq!(first.steadied(picture(&[7, 9])), picture(&[9]));
        // Another pixel in the next picture.
        assert_eq!(first.repeated(picture(&[8])), first.picture);
        assert_eq!(first.unsteady(), 2);
    }

    #[test]
    fn more_than_a_hundredth_is_too_many() {
        let mut first = original(true);
        let many = picture(&[1, 2, 3, 4, 5]);
        assert_eq!(first.repeated(many.clone()), many);
        assert_eq!(first.unsteady(), 0);
        assert_eq!(first.steadied(picture(&[1])), picture(&[1]));
    }

    #[test]
    fn every_difference_of_a_users_scene_counts() {
        let mut first = original(false);
        assert_eq!(first.repeated(picture(&[7])), picture(&[7]));
        assert_eq!(first.unsteady(), 0);
    }
}
