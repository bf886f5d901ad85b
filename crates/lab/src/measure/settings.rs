//! The views to time, and how long; reads a resolution and a time from text.

use super::{TimingSettings, View};

/// Which views are timed. All views are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timed {
    No,
    /// The first frame of the first camera, in the first order.
    #[default]
    Headline,
    /// The first frame of every camera, in every order.
    FirstFrames,
    /// Every frame of every camera, in every order.
    Everything,
}

#[derive(Clone, Debug)]
pub struct Settings {
    pub timed: Timed,
    /// How long and how often, for each timed view.
    pub timing: TimingSettings,
    /// Most frames of each camera to compare, evenly spaced from its first.
    pub frames_per_camera: usize,
    /// The command to put into the report.
    pub command: String,
}

impl Timed {
    pub(super) fn includes(self, view: &View, is_headline: bool) -> bool {
        match self {
            Self::No => false,
            Self::Headline => is_headline,
            Self::FirstFrames => view.frame == 0,
            Self::Everything => true,
        }
    }
}

/// Reads a resolution: `1920x1080`.
///
/// # Errors
/// It is no such text, or a side is not from 1 to 8192.
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

/// Reads a number of seconds.
///
/// # Errors
/// It is no number from 0 to 3600.
pub fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(n) if (0.0..=3600.0).contains(&n) => Ok(n),
        _ => Err("expected a number of seconds from 0 to 3600".to_owned()),
    }
}
