//! `preshade completions`: a script for a shell.

use clap_complete::Shell;

use crate::output;
use crate::{Ending, Failure};

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade completions bash > ~/.local/share/bash-completion/completions/preshade
  preshade completions zsh > ~/.zfunc/_preshade
  preshade completions fish > ~/.config/fish/completions/preshade.fish")]
pub struct CompletionsArgs {
    /// The shell.
    #[arg(value_enum)]
    shell: Shell,
}

pub fn run(args: &CompletionsArgs, mut command: clap::Command) -> Result<Ending, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "preshade", &mut script);
    output::data(&String::from_utf8_lossy(&script))?;
    Ok(Ending::Fine)
}
