//! Stores measurements of a frame's replay in its folder, so that later commands need no replay for
//! them.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::Error;
use super::check::Compared;
use super::replay::LeftOut;
use super::share::{Share, Timer};
use preshade_draw::render::Gpu;
use preshade_frames::file::DataName;
use preshade_frames::folder::Capture;

/// Name of the file in the frame's folder.
pub(crate) const FILE: &str = "replay.json";

/// How many measurements to store: the newest, one per frame and adapter.
const KEPT: usize = 16;

/// The measurements of a frame on an adapter.
pub(super) struct Measured<'a> {
    capture: &'a Capture,
    gpu: &'a Gpu,
    pub of: Replayed,
    timer: Option<Timer<'a>>,
    is_new: bool,
}

/// The measurements, with everything that they depend on.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Replayed {
    /// Frame, adapter, program file and limits, as text.
    on: String,
    /// Hash of `frame.json`.
    file: String,
    /// Hashes of the data that the replay read.
    data: BTreeMap<DataName, String>,
    /// The frame's render passes, in order.
    pub shares: Vec<Share>,
    /// By pipeline: the part of the frame's time that goes away without its draws.
    parts: BTreeMap<usize, Option<f64>>,
    pub compared: Option<Compared>,
    /// Parts that the replay left out, and how often.
    pub left_out: Vec<(LeftOut, u64)>,
}

impl<'a> Measured<'a> {
    /// Loads the stored measurements of the frame, or measures it now.
    ///
    /// # Errors
    /// As [`Timer::new`].
    pub fn new(capture: &'a Capture, gpu: &'a Gpu, frame: usize) -> Result<Self, Error> {
        let on = on(capture, gpu, frame);
        let kept = on.as_ref().and_then(|on| {
            let all = read(capture.folder());
            all.into_iter()
                .find(|kept| kept.on == *on && kept.is_of(capture))
        });
        if let Some(of) = kept {
            return Ok(Self {
                capture,
                gpu,
                of,
                timer: None,
                is_new: false,
            });
        }
        let timer = Timer::new(capture, gpu, frame)?;
        let of = Replayed {
            on: on.unwrap_or_default(),
            file: capture.hash().to_owned(),
            data: BTreeMap::new(),
            shares: timer.passes()?,
            parts: BTreeMap::new(),
            compared: timer.compared.clone(),
            left_out: Vec::new(),
        };
        Ok(Self {
            capture,
            gpu,
            of,
            timer: Some(timer),
            is_new: true,
        })
    }

    /// The part of the frame's time that goes away without each pipeline's draws, as
    /// [`Timer::without`].
    ///
    /// # Errors
    /// As [`Timer::without`].
    pub fn without(
        &mut self,
        frame: usize,
        pipelines: &[usize],
    ) -> Result<Vec<Option<f64>>, Error> {
        let mut open = pipelines.iter().filter(|p| !self.of.parts.contains_key(p));
        if open.next().is_some() {
            let timer = match &mut self.timer {
                Some(timer) => timer,
                none => none.insert(Timer::new(self.capture, self.gpu, frame)?),
            };
            let parts = timer.without(pipelines)?;
            self.of.parts.extend(pipelines.iter().copied().zip(parts));
            self.is_new = true;
        }
        let part = |pipeline| self.of.parts.get(pipeline).copied().flatten();
        Ok(pipelines.iter().map(part).collect())
    }

    /// Ends the measurements, and stores them in the frame's folder. A failed write is ignored.
    pub fn keep(mut self) -> Replayed {
        if let Some(timer) = &self.timer {
            let left_out = timer.left_out().iter();
            self.of.left_out = left_out.map(|(l, n)| (l.clone(), *n)).collect();
        }
        if self.is_new
            && !self.of.on.is_empty()
            && let Ok(hashed) = self.capture.hashed()
        {
            self.of.data = hashed;
            let mut all = read(self.capture.folder());
            all.retain(|kept| kept.on != self.of.on);
            all.insert(0, self.of.clone());
            all.truncate(KEPT);
            if let Ok(text) = serde_json::to_string(&all) {
                let _ = std::fs::write(self.capture.folder().join(FILE), text);
            }
        }
        self.of
    }
}

impl Replayed {
    /// Whether all files that the replay read are unchanged.
    fn is_of(&self, capture: &Capture) -> bool {
        self.file == capture.hash()
            && self.data.iter().all(|(name, hash)| {
                capture
                    .data(name)
                    .is_ok_and(|bytes| blake3::hash(&bytes).to_hex().as_str() == hash)
            })
    }
}

fn read(folder: &Path) -> Vec<Replayed> {
    let text = std::fs::read_to_string(folder.join(FILE)).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

/// The key of a measurement, in addition to the files. It includes the limits, because they can
/// leave out draws. `None` if the program's own file cannot be examined.
fn on(capture: &Capture, gpu: &Gpu, frame: usize) -> Option<String> {
    let program = std::env::current_exe().ok()?.metadata().ok()?;
    let program = (program.len(), program.modified().ok()?);
    let adapter = serde_json::to_string(gpu.adapter()).ok()?;
    let limits = capture.limits();
    Some(format!("frame {frame}, {adapter}, {program:?}, {limits:?}"))
}
