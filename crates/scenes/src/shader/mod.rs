//! Infers the roles of a shader's inputs from its dataflow, and makes the scene of a bare shader.

mod discards;
mod divisors;
pub(crate) mod flow;
mod loops;
pub(crate) mod roles;
mod skin;
pub(crate) mod synthesise;
mod vertex_pulling;
