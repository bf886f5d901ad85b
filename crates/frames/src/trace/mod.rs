//! A frame folder from a trace that wgpu wrote: the folder of `wgpu::Trace::Directory`.
//!
//! 1. `elements` splits `trace.ron` into actions; `version` finds which wgpu wrote them;
//! 2. `recorder` simulates them with `objects`, `shaders`, `submit` and `passes`. Objects get numbers, commands become
//!    those of a frame folder, and data stays in its files (`data`);
//! 3. `slice` finds the commands before the frames that decide what the frames read;
//! 4. `start` turns the first writes among them into contents, and `folder` writes the rest.
//!
//! This needs no GPU, executes nothing, and opens no file outside of the trace.

mod data;
mod elements;
mod folder;
mod ids;
mod objects;
mod passes;
mod paths;
mod recorder;
mod shaders;
mod slice;
mod start;
mod submit;
mod version;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use std::rc::Rc;

pub use version::Version;

use super::file::{Api, CapturedFrame, Refused, SCHEMA, Source, Unknown};
use data::Store;
use elements::Elements;
use recorder::{Mark, Recorder, TraceAction};
use shader_text::limits::{Exceeded, Limits};
use shader_text::read_limited::ReadError;

/// The file that makes a folder a trace.
pub const TRACE: &str = "trace.ron";

/// How to record a trace that this reader accepts.
const REMEDY: &str = "record it with wgpu 29 or 30 (docs/guides/capture-wgpu.md)";

/// Why the content of a buffer without writes is unknown and not zero.
const UNWRITTEN: &str = "nothing in the trace writes the buffer: wgpu's traces lack `Queue::write_buffer_with` \
                         (docs/guides/capture-wgpu.md)";

/// Why a trace was not converted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TraceError {
    /// The trace cannot be opened or read.
    #[error("cannot read `{TRACE}`: {0}")]
    Io(io::Error),
    /// A file of the trace cannot be opened.
    #[error("cannot read `{}`: {error}", file.display())]
    Open {
        /// Path of the file.
        file: PathBuf,
        /// The system's error.
        error: io::Error,
    },
    /// The folder holds no trace.
    #[error("no trace of wgpu: {0}; {REMEDY}")]
    NoTrace(&'static str),
    /// Another version of wgpu wrote it.
    #[error("the trace is of another wgpu than 29 and 30, which this version reads: {0}; {REMEDY}")]
    Version(String),
    /// The action is unknown to this version of wgpu.
    #[error(
        "{TRACE}:{line}: the action `{action}` is none of wgpu 29 or 30, which this version reads: {why}; {REMEDY}"
    )]
    Action {
        /// The action's name.
        action: String,
        /// Line in the file, from 1.
        line: usize,
        /// The parser's message.
        why: String,
    },
    /// A data file is missing or too large.
    #[error("cannot read the trace's `{name}`: {error}")]
    Data {
        /// Name in the folder.
        name: String,
        /// Cause of the failure.
        error: ReadError,
    },
    /// A data file is shorter than the size that the action gives.
    #[error("the trace's `{name}` has {has} bytes, and {needed} are written from it")]
    Short {
        /// Name in the folder.
        name: String,
        /// Bytes in the file.
        has: u64,
        /// Bytes that the action writes.
        needed: u64,
    },
    /// A data file is outside of the folder.
    #[error("the trace names the data `{0}`, which is no file of its folder")]
    DataName(String),
    /// The trace contradicts itself.
    #[error("the trace is broken: {0}")]
    Broken(String),
    /// A limit is exceeded.
    #[error(transparent)]
    Limit(#[from] Exceeded),
    /// The trace holds no frame, or not the requested one.
    #[error("{0}")]
    NoFrame(String),
    /// The folder cannot be written.
    #[error("cannot write the capture: {0}")]
    Write(io::Error),
}

/// An object of the trace, or why it was left out.
type OrRefusal<T> = Result<T, Refusal>;

/// The name of a part that was left out, and why.
type Refusal = Rc<(String, String)>;

fn refusal(what: &str, why: &str) -> Refusal {
    Rc::new((what.to_owned(), paths::stripped(why)))
}

/// The event that ends a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FramesBy {
    /// The app presents a texture to a window.
    Present,
    /// The app submits a render pass. A submission without one belongs to the next frame.
    Submit,
}

/// Which frames of a trace to write.
#[derive(Clone, Copy, Debug)]
pub struct FrameChoice {
    /// How many consecutive frames.
    pub frames: usize,
    /// The first one, from 0. `None`: the last `frames` of the trace.
    pub from: Option<usize>,
    /// The event that ends a frame. `None`: presents, or submissions if the app has no window.
    pub by: Option<FramesBy>,
}

/// Summary of a converted trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TraceSummary {
    /// Version of wgpu that wrote the trace.
    pub version: Version,
    /// Whole frames in the trace.
    pub frames: usize,
    /// The first frame that was written, from 0.
    pub first: usize,
    /// How many frames were written.
    pub written: usize,
    /// The event that ends a frame.
    pub by: FramesBy,
    /// Whether the app did not end its device, because it was still running or was stopped.
    pub is_cut: bool,
}

/// Writes frames of a trace to a folder that [`super::browser::prepare`] accepts, in place of an earlier capture.
///
/// # Errors
/// [`TraceError`].
pub fn convert(
    trace: &Path,
    out: &Path,
    wanted: &FrameChoice,
    limits: &Limits,
) -> Result<TraceSummary, TraceError> {
    let path = trace.join(TRACE);
    let opened = std::fs::metadata(&path).and_then(|about| Ok((about, File::open(&path)?)));
    let (about, opened) = opened.map_err(|error| TraceError::Open { file: path, error })?;
    if !about.is_file() {
        return Err(TraceError::NoTrace("`trace.ron` is no file"));
    }
    let input = BufReader::new(opened);
    let mut elements = Elements::new(input, limits);
    let nothing = TraceError::NoTrace("it is empty, or was cut off in its first action");
    let init = elements.next()?.ok_or(nothing)?;
    let version = version::of(&init.text)?;
    let mut recorder = Recorder::new(Store::new(trace, limits), version);
    while let Some(element) = elements.next()? {
        if let Some(action) = action(&element, version)? {
            recorder.act(action)?;
        }
    }
    let is_cut = !elements.is_closed;
    let (by, marks) = frames(&recorder.marks, wanted)?;
    let (first, last) = window(marks.len(), wanted)?;
    recorder.file.schema = SCHEMA.to_owned();
    recorder.file.source = Source {
        api: Api::Wgpu,
        adapter: backend(&init.text),
        writer: format!("preshade capture, trace of wgpu {}", version.number()),
        ..Source::default()
    };
    write(recorder, &marks, first..last, out, limits)?;
    Ok(TraceSummary {
        version,
        frames: marks.len(),
        first,
        written: last - first,
        by,
        is_cut,
    })
}

/// Parses an action. `None` for drops and destructions, which need no work.
fn action(
    element: &elements::Element,
    version: Version,
) -> Result<Option<TraceAction>, TraceError> {
    let text = element.text.as_str();
    let name = text.split(|c: char| !c.is_alphanumeric()).next();
    let name = name.unwrap_or_default();
    if ["Drop", "Destroy", "Free"]
        .iter()
        .any(|p| name.starts_with(p))
    {
        return Ok(None);
    }
    let text = match version {
        Version::V30 => text.into(),
        Version::V29 => {
            let is_pipeline = matches!(
                name,
                "CreateComputePipeline" | "CreateGeneralRenderPipeline"
            );
            let text = match is_pipeline {
                true => version::with_number(text),
                false => Some(text.into()),
            };
            let Some(text) = text else { return Ok(None) };
            std::borrow::Cow::Owned(version::as_30(&text))
        }
    };
    // wgpu 29 has fewer optional fields: the reader takes a plain value for `Some`.
    let options = ron::Options::default();
    let options = options.with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    let read = options.from_str(&text).map_err(|e| TraceError::Action {
        action: name.to_owned(),
        line: element.line + e.span.start.line.saturating_sub(1),
        why: e.code.to_string(),
    });
    read.map(Some)
}

/// The backend that the app used. Empty if it is not found.
fn backend(init: &str) -> String {
    let (_, rest) = init.rsplit_once("backend:").unwrap_or_default();
    let name = rest.trim().trim_end_matches([')', ',', '\n', ' ']);
    let is_word = name.chars().all(|c| c.is_alphanumeric());
    if is_word {
        name.to_owned()
    } else {
        String::new()
    }
}

/// The ends of all frames in the trace, and the event that ends them.
fn frames(all: &[Mark], wanted: &FrameChoice) -> Result<(FramesBy, Vec<Mark>), TraceError> {
    let of = |by: FramesBy| -> Vec<Mark> { all.iter().copied().filter(|m| m.by == by).collect() };
    let by = wanted.by.unwrap_or(match of(FramesBy::Present).is_empty() {
        true => FramesBy::Submit,
        false => FramesBy::Present,
    });
    let marks = of(by);
    if !marks.is_empty() {
        return Ok((by, marks));
    }
    let why = match wanted.by {
        Some(FramesBy::Present) if !all.is_empty() => {
            "the app presents none to a window, but `--frames-by submit` has some"
        }
        _ => "the app presents none, and submits no render pass",
    };
    Err(TraceError::NoFrame(format!(
        "the trace holds no whole frame: {why}"
    )))
}

/// The frames to write, as a half-open range.
fn window(count: usize, wanted: &FrameChoice) -> Result<(usize, usize), TraceError> {
    match wanted.from {
        None => Ok((count.saturating_sub(wanted.frames), count)),
        Some(from) if from.saturating_add(wanted.frames) <= count => {
            Ok((from, from + wanted.frames))
        }
        Some(from) => Err(TraceError::NoFrame(format!(
            "the trace holds {count} whole frames, counted from 0, and {} from {from} on are asked for",
            wanted.frames
        ))),
    }
}

fn write(
    recorder: Recorder,
    marks: &[Mark],
    window: std::ops::Range<usize>,
    out: &Path,
    limits: &Limits,
) -> Result<(), TraceError> {
    let Recorder {
        file,
        mut store,
        steps,
        ..
    } = recorder;
    let start = window
        .start
        .checked_sub(1)
        .map_or(0, |before| marks[before].end);
    let end = marks[window.end - 1].end;
    let (earlier, chosen) = (&steps[..start], &steps[start..end]);
    let before = slice::before(&file, &store, earlier, chosen);
    let kept = before.kept.into_iter().map(|index| &earlier[index]);
    let mut refused: BTreeMap<&(String, String), u64> = BTreeMap::new();
    for why in kept.clone().chain(chosen).flat_map(|step| &step.refused) {
        *refused.entry(why).or_default() += 1;
    }
    let refused = refused.into_iter().map(|((what, why), count)| Refused {
        what: what.clone(),
        why: why.clone(),
        count,
    });
    let refused = refused.collect();
    let mut frames = Vec::new();
    let mut first = start;
    for mark in &marks[window] {
        let commands = steps[first..mark.end].iter();
        let size = mark
            .canvas
            .and_then(|c| file.textures.get(c))
            .map(|t| t.size.0);
        let [width, height, _] = size.unwrap_or([1; 3]);
        frames.push(CapturedFrame {
            time: 0.0,
            size: [width, height],
            canvas: mark.canvas,
            alpha_mode: mark.alpha_mode,
            commands: commands.filter_map(|s| s.command.clone()).collect(),
            picture: None,
        });
        first = mark.end;
    }
    let setup = kept.filter_map(|step| step.command.clone()).collect();
    let unknown = before.unwritten.into_iter().map(|buffer| Unknown {
        buffer: Some(buffer),
        texture: None,
        aspect: None,
        as_captured: false,
        why: UNWRITTEN.to_owned(),
    });
    let mut made = folder::compact(&file, setup, frames, unknown.collect());
    made.refused = refused;
    // Checked before anything of that size is allocated.
    super::folder::check(&made, limits).map_err(|error| match error {
        super::error::Error::Limit(exceeded) => TraceError::Limit(exceeded),
        other => TraceError::Broken(other.to_string()),
    })?;
    start::fold(&mut made, &mut store)?;
    folder::write(&mut made, &store, out, limits)
}
