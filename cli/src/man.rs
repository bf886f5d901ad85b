//! `preshade man`: the manual pages.

use std::path::PathBuf;

use clap_mangen::Man;
use shader_text::files::File;

use crate::{Ending, Failure, output};

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade man | man -l -
  preshade man rewrite | man -l -
  preshade man -o ~/.local/share/man/man1        preshade.1, and preshade-rewrite.1 and so on")]
pub struct ManArgs {
    /// The command whose page goes to stdout; default: the main page.
    #[arg(value_name = "COMMAND", conflicts_with = "out")]
    command: Option<String>,
    /// Folder to write all pages to, one a command.
    #[arg(short, long, alias = "output", value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Prints the page, or writes all of them.
pub fn run(args: &ManArgs, mut command: clap::Command) -> Result<Ending, Failure> {
    command.build();
    let page = |command: clap::Command| -> Result<Vec<u8>, Failure> {
        let mut page = Vec::new();
        Man::new(command).render(&mut page)?;
        Ok(page)
    };
    let of = |sub: &clap::Command| -> Result<File, Failure> {
        let name = format!("preshade-{}", sub.get_name());
        Ok(File {
            name: format!("{name}.1"),
            bytes: page(sub.clone().name(name))?,
        })
    };
    let all = || command.get_subcommands().filter(|c| c.get_name() != "help");
    let Some(folder) = &args.out else {
        let bytes = match &args.command {
            None => page(command)?,
            Some(name) => match all().find(|c| c.get_name() == name) {
                Some(sub) => of(sub)?.bytes,
                None => {
                    let names: Vec<&str> = all().map(clap::Command::get_name).collect();
                    return Err(Failure::unknown("command", name, &names));
                }
            },
        };
        output::data(&String::from_utf8_lossy(&bytes))?;
        return Ok(Ending::Fine);
    };
    let mut pages = vec![File {
        name: "preshade.1".to_owned(),
        bytes: page(command.clone())?,
    }];
    for sub in all() {
        pages.push(of(sub)?);
    }
    for path in shader_text::files::write(folder, &pages)? {
        output::message(&format!("wrote {}", path.display()));
    }
    Ok(Ending::Fine)
}
