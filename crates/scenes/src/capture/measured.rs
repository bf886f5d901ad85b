//! What a replay of a frame measures, kept beside the frame: the next command on it replays nothing for that.

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

/// The file in the folder of a frame.
pub(crate) const FILE: &str = "replay.json";

/// Measurements that are kept: one for each frame and adapter, and the newest of them.
const KEPT: usize = 16;

/// The measurements of a frame on an adapter.
pub(super) struct Measured<'a> {
    capture: &'a Capture,
    gpu: &'a Gpu,
    pub of: Replayed,
    timer: Option<Timer<'a>>,
    is_new: bool,
}

/// What was measured, with all that it depends on.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Replayed {
    /// The frame, the adapter, the program that replayed it, and its limits.
    on: String,
    /// The hash of `frame.json`.
    file: String,
    /// The hashes of the data that the replay read.
    data: BTreeMap<DataName, String>,
    /// Each render pass, in order.
    pub shares: Vec<Share>,
    /// By pipeline, by how much the frame is shorter without its draws.
    parts: BTreeMap<usize, Option<f64>>,
    pub compared: Option<Compared>,
    /// What the replay left out, and how often.
    pub left_out: Vec<(LeftOut, u64)>,
}

impl<'a> Measured<'a> {
    /// What is kept of the frame, or measured now.
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

    /// By how much the frame is shorter without each pipeline's draws, as [`Timer::without`].
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

    /// Ends the measurements, and keeps them beside the frame. A folder that nobody may write to keeps none.
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
    /// Whether every file that the replay read is the same.
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

/// What a measurement depends on beside the files. Limits leave draws out. `None`: the program's own file cannot be
/// asked.
fn on(capture: &Capture, gpu: &Gpu, frame: usize) -> Option<String> {
    let program = std::env::current_exe().ok()?.metadata().ok()?;
    let program = (program.len(), program.modified().ok()?);
    let adapter = serde_json::to_string(gpu.adapter()).ok()?;
    let limits = capture.limits();
    Some(format!("frame {frame}, {adapter}, {program:?}, {limits:?}"))
}
