//! Which variants a command draws: `--pass`, `--variant`, and older spellings of both.

use preshade_compiler::sweep::{self, Sweep};

use crate::{Failure, output};

/// The variants to draw.
#[derive(clap::Args)]
pub struct VariantArgs {
    /// A pass of one variant; several are applied in order, as `rewrite` does. Ranges are allowed.
    #[arg(long = "pass", value_name = "NAME[:k=v,..]")]
    passes: Vec<String>,
    /// A variant: its passes, separated by commas. Repeat the flag for several variants. Ranges are
    /// allowed.
    #[arg(long = "variant", value_name = "NAME[:k=v,..],NAME..")]
    variants: Vec<String>,
    /// The old name of --variant.
    #[arg(long = "recipe", value_name = "NAME[:k=v,..],NAME..", hide = true)]
    recipes: Vec<String>,
}

impl VariantArgs {
    pub fn is_empty(&self) -> bool {
        self.passes.is_empty() && self.variants.is_empty() && self.recipes.is_empty()
    }

    /// The variants, those with ranges as sweeps. Notes on stderr give the new form of older
    /// spellings.
    pub fn sweeps(&self) -> Result<Vec<Sweep>, Failure> {
        let mut sweeps = Vec::new();
        if let Some(steps) = sweep::completed(&self.passes) {
            let variant = steps.join(",");
            output::message(&format!(
                "note: these --pass are drawn as --variant {variant}; \
                 please write it so: a --pass without \
                 the parameters that a sweep needs is deprecated"
            ));
            sweeps.push(Sweep::parse_steps(&steps)?);
        } else if !self.passes.is_empty() {
            sweeps.push(Sweep::parse_steps(&self.passes)?);
            if self.passes.len() > 1 {
                let apart: Vec<String> = self
                    .passes
                    .iter()
                    .map(|p| format!("--variant {p}"))
                    .collect();
                output::message(&format!(
                    "note: several --pass are one variant, applied in order; \
                     for a variant each, write {}",
                    apart.join(" ")
                ));
            }
        }
        if !self.recipes.is_empty() {
            output::message("note: --recipe is deprecated: it is called --variant now");
        }
        for list in self.variants.iter().chain(&self.recipes) {
            sweeps.push(Sweep::parse_list(list)?);
        }
        Ok(sweeps)
    }
}
