//! The work of a frame, term by term: the columns of the cost model.

use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Term {
    Frames,
    /// Render passes, after the plans of all materials were merged.
    Passes,
    Draws,
    /// Vertex invocations, each vertex of an indexed mesh once.
    Vertices,
    /// Vertex invocations times the static cost of their stage.
    VertexOps,
    /// Counted in each instance.
    Triangles,
    /// Fragments that are rasterised and tested, shaded or not.
    Tested,
    Fragments,
    /// Fragment invocations times their static cost, without texture samples.
    FragmentOps,
    /// As `fragment-ops`, of texture samples alone.
    SampleOps,
    /// Bytes that fragments write to attachments, or read from them.
    Bytes,
    /// Bytes of attachments cleared, loaded and stored as a whole.
    AttachmentBytes,
    /// Compute passes, one for each draw they are run for.
    Dispatches,
    ComputeInvocations,
    /// Compute invocations times their static cost.
    ComputeOps,
}

impl Term {
    /// All terms, in the order of [`Work`].
    pub const ALL: [Self; 15] = [
        Self::Frames,
        Self::Passes,
        Self::Draws,
        Self::Vertices,
        Self::VertexOps,
        Self::Triangles,
        Self::Tested,
        Self::Fragments,
        Self::FragmentOps,
        Self::SampleOps,
        Self::Bytes,
        Self::AttachmentBytes,
        Self::Dispatches,
        Self::ComputeInvocations,
        Self::ComputeOps,
    ];

    /// Its name, as in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Frames => "frames",
            Self::Passes => "passes",
            Self::Draws => "draws",
            Self::Vertices => "vertices",
            Self::VertexOps => "vertex-ops",
            Self::Triangles => "triangles",
            Self::Tested => "tested",
            Self::Fragments => "fragments",
            Self::FragmentOps => "fragment-ops",
            Self::SampleOps => "sample-ops",
            Self::Bytes => "bytes",
            Self::AttachmentBytes => "attachment-bytes",
            Self::Dispatches => "dispatches",
            Self::ComputeInvocations => "compute-invocations",
            Self::ComputeOps => "compute-ops",
        }
    }
}

/// How much of each [`Term`] a frame has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Work([f64; Term::ALL.len()]);

impl Work {
    pub fn add(&mut self, term: Term, amount: f64) {
        self.0[term as usize] += amount;
    }

    /// The amounts, in the order of [`Term::ALL`].
    pub fn amounts(&self) -> &[f64] {
        &self.0
    }

    /// The amount of a term.
    pub fn of(&self, term: Term) -> f64 {
        self.0[term as usize]
    }
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        for (sum, amount) in self.0.iter_mut().zip(other.0) {
            *sum += amount;
        }
    }
}
