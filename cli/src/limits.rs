//! How much of what others wrote is taken on.

use preshade::limits::Limits;
use preshade::scene::{Access, Outside};

/// Limits on what is read.
#[derive(Clone, clap::Args)]
pub struct LimitArgs {
    /// Refuse what is larger than this: default, strict (for what strangers wrote; each variant then gets a process of its own, and so many seconds) or none, and NAME=NUMBER
    /// over them. docs/reference/limits.md lists the names.
    #[arg(long, value_name = "SET,NAME=N,..", value_parser = Limits::parse)]
    limits: Option<Limits>,
    /// Let a scene's files lie outside of its root folder.
    #[arg(long)]
    allow_outside: bool,
}

impl LimitArgs {
    /// Those in force.
    pub fn limits(&self) -> Limits {
        self.limits.unwrap_or_default()
    }

    /// What a scene may reach and ask for.
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
