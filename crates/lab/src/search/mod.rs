//! Searches over recipes. [`mod@plan`] decides the recipe of each material of a scene.
//! [`mod@explore`] finds the recipes that no other beats in both error and time. [`candidates`]
//! lists the recipes that both try.

pub mod candidates;
pub mod explore;
pub mod plan;
