//! `preshade adapters`: the adapters of this machine.

use preshade_draw::render;
use serde::Serialize;

use crate::{Ending, Failure, Format, output};

#[derive(clap::Args)]
#[command(after_help = "\
preshade uses the first one. `preshade verify --adapter TEXT` selects another, by a part of its
name, driver or backend; `--adapter '#2'` the second of this list.")]
pub struct AdaptersArgs {
    /// Output form.
    #[arg(long, value_enum, default_value_t = Format::Human)]
    format: Format,
}

#[derive(Serialize)]
struct Listing<'a> {
    schema: &'static str,
    adapters: &'a [render::AdapterReport],
}

pub fn run(args: &AdaptersArgs) -> Result<Ending, Failure> {
    let adapters = render::adapters();
    match args.format {
        Format::Json => output::json(&Listing {
            schema: "preshade.adapters.v1",
            adapters: &adapters,
        })?,
        Format::Human => {
            for a in &adapters {
                output::data(&a.to_string())?;
            }
        }
    }
    if adapters.is_empty() {
        return Err(render::Error::NoAdapter {
            wanted: None,
            found: Vec::new(),
        }
        .into());
    }
    Ok(Ending::Fine)
}
