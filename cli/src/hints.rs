//! Guesses the meaning of a mistaken command line, where clap's guess by spelling would mislead.

use clap::Error;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use preshade_geometry::pass_named;

/// Words that newcomers try, and the command that does it.
const COMMANDS: [(&str, &str); 13] = [
    ("check", "explain"),
    ("lint", "explain"),
    ("build", "rewrite"),
    ("compile", "rewrite"),
    ("convert", "rewrite"),
    ("run", "rewrite"),
    ("transform", "rewrite"),
    ("compare", "verify"),
    ("diff", "verify"),
    ("test", "verify"),
    ("optimise", "plan"),
    ("optimize", "plan"),
    ("tune", "plan"),
];

/// The error without clap's suggestion if a better one is known, and that one as a line.
pub fn of(mut error: Error) -> (Error, String) {
    let Some(hint) = hint(&error) else {
        return (error, String::new());
    };
    error.remove(ContextKind::SuggestedArg);
    error.remove(ContextKind::SuggestedSubcommand);
    error.remove(ContextKind::Suggested);
    error.remove(ContextKind::Usage);
    (error, format!("\n = {hint}"))
}

fn hint(error: &Error) -> Option<String> {
    let of = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.as_str()),
        _ => None,
    };
    match error.kind() {
        ErrorKind::UnknownArgument => {
            let given = of(ContextKind::InvalidArg)?;
            let name = given.trim_start_matches('-');
            let pass = name.split(':').next().unwrap_or(name);
            match name {
                _ if pass_named(pass).is_some() => {
                    Some(format!("a pass is given as --pass {name}"))
                }
                "recipe" | "variant" => Some(
                    "a recipe is given as one --pass for each step: --pass hoist --pass \
                     depth-prepass"
                        .to_owned(),
                ),
                _ => None,
            }
        }
        ErrorKind::InvalidSubcommand => {
            let given = of(ContextKind::InvalidSubcommand)?;
            let (_, command) = COMMANDS.iter().find(|(word, _)| *word == given)?;
            Some(format!("`preshade {command}` does that"))
        }
        _ => None,
    }
}
