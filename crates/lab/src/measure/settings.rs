//! The views to time, and how long.

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
