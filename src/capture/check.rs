//! Compares a replayed frame with the picture that the page showed.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Error;
use super::folder::{Capture, get};
use super::replay::{LeftOut, Replay, Until};
use crate::render::{ColorImage, Gpu};

/// A replayed frame beside the page's picture.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Compared {
    /// Frame, from 0.
    pub frame: usize,
    /// Pixels of the picture.
    pub pixels: u64,
    /// Pixels that differ.
    pub differ: u64,
    /// Pixels that differ by more than one step of a channel of 8 bits.
    pub by_more: u64,
    /// The largest difference of a channel, in steps.
    pub most: u8,
}

impl Compared {
    /// One line for a reader of a report.
    pub fn told(&self) -> String {
        match self.differ {
            0 => format!(
                "the replayed frame is the page's, in all {} pixels",
                self.pixels
            ),
            n => format!(
                "the replayed frame differs from the page's picture in {n} of {} pixels, in {} by \
                 more than one step of 255 (another driver rounds and samples otherwise)",
                self.pixels, self.by_more
            ),
        }
    }
}

/// The frames of a capture, each replayed and compared.
#[derive(Debug)]
pub struct Check {
    /// A frame without a picture is not among them.
    pub frames: Vec<Compared>,
    /// The pictures of the replay: of each frame with a canvas.
    pub pictures: Vec<ColorImage>,
    /// What the replay left out, and how often.
    pub left_out: BTreeMap<LeftOut, u64>,
}

/// Replays all frames and compares them.
///
/// # Errors
/// The capture is broken, a picture has another size or format than the canvas, or the device is lost.
pub fn check(capture: &Capture, gpu: &Gpu) -> Result<Check, Error> {
    let mut replay = Replay::new(gpu, capture);
    let (mut frames, mut pictures) = (Vec::new(), Vec::new());
    for index in 0..capture.file.frames.len() {
        replay.frame(index, Until::End)?;
        if let Some((found, ours)) = shown(capture, &mut replay, index)? {
            frames.push(found);
            pictures.push(ours);
        } else if capture.file.frames[index].canvas.is_some() {
            pictures.push(replay.picture(index)?);
        }
    }
    Ok(Check {
        frames,
        pictures,
        left_out: replay.left_out().clone(),
    })
}

/// A frame that was just replayed, beside the page's picture of it. `None` without one.
///
/// # Errors
/// The picture has another size or format than the canvas, or the device is lost.
pub(super) fn shown(
    capture: &Capture,
    replay: &mut Replay<'_>,
    index: usize,
) -> Result<Option<(Compared, ColorImage)>, Error> {
    let place = format!("frame {index}");
    let frame = get(&capture.file.frames, index, "frame", &place)?;
    let Some(shown) = &frame.picture else {
        return Ok(None);
    };
    let ours = replay.picture(index)?;
    let theirs = capture.data(&shown.data)?;
    if shown.size != ours.size || theirs.len() != ours.bytes.len() {
        return Err(Error::broken(
            place,
            format!(
                "the picture has {:?} pixels and {} bytes, and the canvas {:?} and {}",
                shown.size,
                theirs.len(),
                ours.size,
                ours.bytes.len()
            ),
        ));
    }
    Ok(Some((compared(index, &ours, &theirs), ours)))
}

fn compared(frame: usize, ours: &ColorImage, theirs: &[u8]) -> Compared {
    let texel = ours.format.block_copy_size(None).unwrap_or(4) as usize;
    let pairs = ours.bytes.chunks(texel).zip(theirs.chunks(texel));
    let mut found = Compared {
        frame,
        pixels: u64::from(ours.size[0]) * u64::from(ours.size[1]),
        differ: 0,
        by_more: 0,
        most: 0,
    };
    for (a, b) in pairs.filter(|(a, b)| a != b) {
        let most = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max();
        let most = most.unwrap_or(0);
        found.differ += 1;
        found.by_more += u64::from(most > 1);
        found.most = found.most.max(most);
    }
    found
}
