//! Facts that a driver must know about a program that runs without WGSL's run-time checks, and
//! about one whose loops may not end.

use naga::ResourceBinding;

use crate::program::Program;

/// The checks without which a program may do anything.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Checks {
    /// A divisor may be 0, or a quotient overflow.
    pub divisors: bool,
    /// An index may lie beyond an array, vector or matrix.
    pub indices: bool,
}

impl Checks {
    pub const ALL: Self = Self {
        divisors: true,
        indices: true,
    };

    /// The checks that either of two programs needs.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            divisors: self.divisors || other.divisors,
            indices: self.indices || other.indices,
        }
    }
}

/// Most turns that all loops of an invocation take together. llvmpipe leaves a loop by itself after
/// 65,535.
pub const MOST_TURNS: u32 = 1 << 15;

/// A copy of a program in which every loop ends.
#[derive(Clone, Debug)]
pub struct Bounded {
    pub program: Program,
    /// Its `atomic<u32>`, which gets the number of a loop that did not end.
    pub binding: ResourceBinding,
    /// The loops that may not end, in words. The first has the requested number.
    pub loops: Vec<String>,
}
