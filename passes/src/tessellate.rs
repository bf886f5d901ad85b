//! `tessellate`: (in progress) new vertices for what was hoisted.

pub mod pattern;
