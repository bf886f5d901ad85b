//! Compares a replayed frame with the page's picture.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::Error;
use super::replay::{LeftOut, Replay, Until};
use preshade_draw::render::{ColorImage, Gpu};
use preshade_draw::scene::Image;
use preshade_frames::folder::{Capture, get};

/// Differences between a replayed frame and the page's picture.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Compared {
    /// Frame, from 0.
    pub frame: usize,
    pub pixels: u64,
    pub differ: u64,
    /// Pixels that differ by more than one step of a channel of 8 bits.
    pub by_more: u64,
    /// The largest difference of a channel, in steps of 1/255.
    pub most: u8,
}

impl Compared {
    /// A line for the report. `page` and `here` are the adapters. `noise` names the
    /// driver-dependent computations of the frame's shaders.
    pub fn told(&self, page: &str, here: &str, noise: Option<&str>) -> String {
        match self.differ {
            0 => format!(
                "the replayed frame is the page's, in all {} pixels",
                self.pixels
            ),
            n => {
                let care = match (self.is_off(), noise) {
                    (true, Some(noise)) => {
                        format!(". Drivers differ so in {noise}: look whether the two pictures show the same")
                    }
                    (true, None) => {
                        ". That is more than drivers differ by: this report is about another picture than the page's"
                            .to_owned()
                    }
                    (false, _) => String::new(),
                };
                format!(
                    "the replayed frame differs from the page's picture in {n} of {} pixels, in {} by more \
                     than one step of 255, at most by {} (the page was drawn by {page}, the replay by \
                     {here}){care}",
                    self.pixels, self.by_more, self.most
                )
            }
        }
    }

    /// Whether the difference is larger than drivers explain: more than a fifth of the pixels
    /// differ by more than a step.
    pub fn is_off(&self) -> bool {
        self.by_more * 5 > self.pixels
    }
}

/// The replayed frames of a capture, and their differences.
#[derive(Debug)]
pub struct Check {
    /// Differences of each frame with a picture.
    pub frames: Vec<Compared>,
    /// The replay's picture of each frame with a canvas.
    pub pictures: Vec<ColorImage>,
    /// Parts that the replay left out, and how often.
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

/// The page's picture of a frame, and the replay's. `None` without a picture of the page.
///
/// # Errors
/// As [`check`].
pub fn pictures(
    capture: &Capture,
    gpu: &Gpu,
    frame: usize,
) -> Result<Option<[ColorImage; 2]>, Error> {
    let mut replay = Replay::new(gpu, capture);
    for index in 0..=frame {
        replay.frame(index, Until::End)?;
    }
    let Some((_, ours)) = shown(capture, &mut replay, frame)? else {
        return Ok(None);
    };
    let picture = capture.file.frames[frame].picture.as_ref();
    let bytes = picture.map(|p| capture.data(&p.data)).transpose()?;
    Ok(bytes.map(|bytes| {
        let theirs = ColorImage {
            bytes: bytes.to_vec(),
            ..ours.clone()
        };
        [theirs, ours]
    }))
}

/// Compares a frame that was just replayed with the page's picture. `None` without one.
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
    let place = place.as_str();
    let plain = |format: wgpu::TextureFormat| format.remove_srgb_suffix();
    if shown.size != ours.size
        || theirs.len() != ours.bytes.len()
        || plain(shown.format) != plain(ours.format)
    {
        return Err(Error::broken(
            place,
            format!(
                "the picture is {:?} of {:?} pixels and {} bytes, and the canvas {:?} of {:?} and {}",
                shown.format,
                shown.size,
                theirs.len(),
                ours.format,
                ours.size,
                ours.bytes.len()
            ),
        ));
    }
    let image = |bytes: &[u8]| Image {
        size: ours.size,
        layers: 1,
        dimension: wgpu::TextureDimension::D2,
        format: plain(ours.format),
        levels: vec![bytes.to_vec()],
    };
    let found = compared(index, &image(&ours.bytes), &image(&theirs));
    let unread = || {
        Error::broken(
            place,
            format!("pictures of {:?} are not compared", ours.format),
        )
    };
    Ok(Some((found.ok_or_else(unread)?, ours)))
}

fn compared(frame: usize, ours: &Image, theirs: &Image) -> Option<Compared> {
    let [width, height] = ours.size;
    let mut found = Compared {
        frame,
        pixels: u64::from(width) * u64::from(height),
        differ: 0,
        by_more: 0,
        most: 0,
    };
    let (ours, theirs) = (ours.texels()?, theirs.texels()?);
    for place in (0..height).flat_map(|y| (0..width).map(move |x| [x, y, 0])) {
        let [Some(a), Some(b)] = [&ours, &theirs].map(|of| of.at(0, place)) else {
            continue;
        };
        // NaN equals only NaN.
        let channels = a
            .iter()
            .zip(b)
            .map(|(a, b)| match a.is_nan() && b.is_nan() {
                true => 0.0,
                false => (a - b).abs() * 255.0,
            });
        let most = channels.fold(
            0.0,
            |most: f32, d| if d > most || d.is_nan() { d } else { most },
        );
        if most == 0.0 {
            continue;
        }
        found.differ += 1;
        found.by_more += u64::from(most.is_nan() || most > 1.01);
        let most = if most.is_nan() { 255.0 } else { most.round() };
        found.most = found.most.max(most.clamp(1.0, 255.0) as u8);
    }
    Some(found)
}
