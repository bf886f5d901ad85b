//! The flags in effect, as words for another process of preshade.

use clap::parser::ValueSource;
use clap::{ArgAction, ArgMatches, Command};

/// Flags about the command line itself.
const OF_THE_COMMAND_LINE: [&str; 4] = ["color", "config", "print-config", "watch"];

/// Each flag that is given, or whose value is not the default of `command`, as `--flag=value`. The environment
/// and the configuration file are in `matches`, and not in `command`.
pub fn words(command: &Command, matches: &ArgMatches) -> Vec<String> {
    let mut words = Vec::new();
    for arg in command.get_arguments() {
        let (Some(long), id) = (arg.get_long(), arg.get_id().as_str()) else {
            continue;
        };
        if OF_THE_COMMAND_LINE.contains(&long) {
            continue;
        }
        if matches!(arg.get_action(), ArgAction::SetTrue) {
            if matches.get_flag(id) {
                words.push(format!("--{long}"));
            }
            continue;
        }
        let Ok(Some(values)) = matches.try_get_raw(id) else {
            continue;
        };
        let is_given = matches.value_source(id) == Some(ValueSource::CommandLine);
        let defaults = arg.get_default_values().iter().map(|v| v.as_os_str());
        if is_given || !values.clone().eq(defaults) {
            words.extend(values.map(|v| format!("--{long}={}", v.to_string_lossy())));
        }
    }
    words
}

/// The words without those of some flags.
pub fn without(words: &[String], flags: &[&str]) -> Vec<String> {
    let is_one = |word: &str| {
        let name = word.trim_start_matches("--");
        let name = name.split_once('=').map_or(name, |(name, _)| name);
        flags.contains(&name)
    };
    words.iter().filter(|w| !is_one(w)).cloned().collect()
}
