//! New programs out of slices and cuts of old ones: everything that writes naga IR.

pub mod bounded;
pub mod color;
pub mod count;
pub mod depth_only;
pub mod depth_pass;
pub(crate) mod insert_after;
pub mod isolate;
pub(crate) mod moved;
pub mod outline;
pub mod place;
pub(crate) mod prologue;
pub mod quad;
pub(crate) mod remainder;
pub mod snippet;
