//! `preshade adapters`: what can be measured on.

use preshade::render;

use crate::{Failure, Format, Outcome};

/// Arguments of `adapters`.
#[derive(clap::Args)]
pub struct Args {
    /// Output form.
    #[arg(long, value_enum, default_value_t = Format::Human)]
    format: Format,
}

/// Lists the adapters.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let adapters = render::adapters();
    match args.format {
        Format::Json => println!("{}", serde_json::to_string_pretty(&adapters)?),
        Format::Human => {
            for a in &adapters {
                println!("{}", a);
            }
        }
    }
    if adapters.is_empty() {
        return Err(Failure("error: no adapter found; on Debian or Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1".to_owned()));
    }
    Ok(Outcome::Fine)
}
