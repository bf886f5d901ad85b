//! New programs out of slices and cuts of old ones: everything that writes naga IR.

pub mod bounded;
pub mod color;
pub(crate) mod corner;
pub mod count;
pub mod depth_only;
pub(crate) mod depth_pass;
pub(crate) mod fetch;
pub(crate) mod insert_after;
pub(crate) mod isolate;
pub(crate) mod moved;
pub(crate) mod outline;
pub mod place;
pub(crate) mod prologue;
pub mod quad;
pub(crate) mod remainder;
pub mod snippet;
