//! `--limits` and `--allow-outside`: limits on input from strangers.

use preshade_scenes::{Access, Outside};
use shader_text::limits::Limits;

/// Limits on input.
#[derive(Clone, Default, clap::Args)]
pub struct LimitArgs {
    /// Refuse larger input than this: default, strict (for files from strangers; each variant then
    /// runs in a process of its own, with a time limit) or none, and NAME=NUMBER over them.
    /// docs/reference/limits.md lists the names.
    #[arg(long, value_name = "SET,NAME=N,..", value_parser = Limits::parse)]
    limits: Option<Limits>,
    /// Allow a scene's files outside of its root folder.
    #[arg(long)]
    allow_outside: bool,
}

impl LimitArgs {
    pub fn limits(&self) -> Limits {
        self.limits.unwrap_or_default()
    }

    /// A scene's access to files, and its limits.
    pub fn access(&self) -> Access {
        Access {
            outside: match self.allow_outside {
                true => Outside::Allowed,
                false => Outside::Refused,
            },
            limits: self.limits(),
        }
    }
}
