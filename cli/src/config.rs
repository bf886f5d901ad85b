//! `preshade.toml`: default values of flags. Flags come before the environment, and the environment
//! comes before the file.
//!
//! A key is the long name of a flag. At the top of the file it holds for every command that has the
//! flag, in a table named after a command for that command only. The environment variable is
//! `PRESHADE_` and the flag's name in capitals. An empty variable counts as unset, and `;`
//! separates several values. `--FLAG=false` resets a switch. A flag also hides values of flags that
//! conflict with it from the environment and the file.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::path::{Component, Path, PathBuf};

use clap::builder::{BoolishValueParser, TypedValueParser};
use clap::error::{ContextKind, ContextValue};
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command};
use shader_text::limits::Limits;
use shader_text::nearest::nearest;
use shader_text::read_limited;
use toml::{Table, Value};

use crate::{Failure, output, worker};
use shader_text::nearest::unknown;

/// The file that is read if it exists.
pub const FILE: &str = "preshade.toml";

/// Flags about the command line itself.
const NOT_KEYS: [&str; 5] = ["config", "print-config", "explain", "help", "version"];

/// Flags that lift a protection. A file that is found and not named may not set them.
const NOT_FOUND: [&str; 1] = ["allow-outside"];

/// Flags for output paths. A file that is found and not named may only set paths below its own
/// folder.
const WRITTEN: [&str; 5] = ["out", "out-dir", "depfile", "share", "model"];

/// Flags that mean something only with another, where a command has that one.
const ONLY_WITH: [(&str, &str); 2] = [("camera", "scene"), ("size", "scene")];

const JOBS: &str = "jobs";

/// Flags of `verify` about its adapter and its report. A list of jobs has none of them.
const NOT_OF_JOBS: [&str; 4] = ["adapter", "format", "out", "share"];

/// Values by command and flag.
#[derive(Debug, Default)]
pub struct Config {
    path: Option<PathBuf>,
    values: Values,
    /// Switches that the command line sets to `false`.
    taken_back: Vec<String>,
}

/// The source of a value that no flag sets. Later sources take precedence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum From {
    File,
    Environment,
}

/// The values of a flag.
#[derive(Clone, Debug)]
struct FlagValues {
    words: Vec<OsString>,
    from: From,
}

impl Config {
    /// Reads the environment, and the file of `--config` or `PRESHADE_CONFIG`, or else
    /// `preshade.toml` if it exists. Checks both against the flags of `command`.
    ///
    /// # Errors
    /// The file cannot be read, has an unknown key or a value of the wrong type, or sets two flags
    /// that conflict.
    pub fn read(arguments: &Arguments, command: &Command) -> Result<Self, Failure> {
        let mut config = Self::of_flags(arguments);
        if worker::is_job() {
            return Ok(config);
        }
        config.path = path(arguments);
        if let Some(path) = &config.path {
            let failed = |message: String| Failure(format!("error: {}: {message}", path.display()));
            let is_found = asked(arguments).is_none();
            let text = match is_found {
                true => read_limited::text(path, &Limits::default(), "source-bytes")
                    .map_err(|e| failed(e.to_string()))?,
                false => std::fs::read_to_string(path).map_err(|e| failed(e.to_string()))?,
            };
            let table: Table = text
                .parse()
                .map_err(|e: toml::de::Error| failed(e.to_string()))?;
            config.values = values(&table, command).map_err(failed)?;
            // A file that is found may be a stranger's.
            let mut said = config.values.iter();
            if is_found
                && let Some((key, why)) =
                    said.find_map(|((_, key), said)| Some((key, lifts(key, said)?)))
            {
                return Err(failed(format!(
                    "`{key}`{why} is not taken from a file that only lies here: give the flag, or \
                     name the file with --config"
                )));
            }
        }
        config.values.extend(environment(command)?);
        config.settle(arguments, command)?;
        Ok(config)
    }

    /// Only the command line, for commands that must run whatever the file contains.
    pub fn of_flags(arguments: &Arguments) -> Self {
        Self {
            taken_back: arguments.taken_back.clone(),
            ..Self::default()
        }
    }

    /// The file that was read.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// Drops values that conflict with the command line or lack a flag that they are for, and values
    /// of the file that conflict with the environment.
    fn settle(&mut self, arguments: &Arguments, command: &Command) -> Result<(), Failure> {
        self.values
            .retain(|(_, flag), _| !arguments.taken_back.contains(flag));
        // Errors of the command line are reported when it is parsed.
        let look = command
            .clone()
            .ignore_errors(true)
            .try_get_matches_from(&arguments.words);
        let Ok(matches) = look else {
            return Ok(());
        };
        let Some((name, of_it)) = matches.subcommand() else {
            return Ok(());
        };
        let Some(sub) = command.find_subcommand(name) else {
            return Ok(());
        };
        let is_flag = |arg: &Arg| {
            let id = arg.get_id().as_str();
            of_it.value_source(id) == Some(ValueSource::CommandLine)
        };
        let key = |arg: &Arg| {
            let long = arg.get_long()?;
            Some((name.to_owned(), long.to_owned()))
        };
        for (flag, needed) in ONLY_WITH {
            let Some(needed) = sub
                .get_arguments()
                .find(|arg| arg.get_long() == Some(needed))
            else {
                continue;
            };
            let said = key(needed).and_then(|key| self.values.get(&key));
            if !is_flag(needed) && said.is_none_or(|said| said.words == ["false"]) {
                self.values.remove(&(name.to_owned(), flag.to_owned()));
            }
        }
        for one in sub.get_arguments() {
            for other in sub.get_arg_conflicts_with(one) {
                for (one, other) in [(one, other), (other, one)] {
                    if is_flag(one)
                        && let Some(key) = key(other)
                    {
                        self.values.remove(&key);
                    }
                }
                let (Some(one), Some(other)) = (key(one), key(other)) else {
                    continue;
                };
                let from = |key| self.values.get(key).map(|said| said.from);
                match (from(&one), from(&other)) {
                    (Some(a), Some(b)) if a == b => {
                        return Err(Failure(format!(
                            "error: `{}` and `{}` exclude each other, and {} sets both",
                            one.1,
                            other.1,
                            match (a, &self.path) {
                                (From::File, Some(path)) => path.display().to_string(),
                                _ => "the environment".to_owned(),
                            }
                        )));
                    }
                    (Some(a), Some(b)) => {
                        let lower = if a < b { one } else { other };
                        self.values.remove(&lower);
                    }
                    _ => {}
                }
            }
        }
        Ok(())
    }

    /// An error of the argument parser, with the source of the value if it is not a flag.
    pub fn explained(&self, error: &clap::Error, arguments: &Arguments) -> Option<String> {
        let ContextValue::String(flag) = error.get(ContextKind::InvalidArg)? else {
            return None;
        };
        let long = flag.strip_prefix("--")?;
        let long = long.split([' ', '[', '=']).next()?;
        let words = arguments.words.iter().map(|w| w.to_string_lossy());
        let names: Vec<String> = words.map(Cow::into_owned).collect();
        let mut said = self.values.iter().filter(|((command, of), _)| {
            of == long && (command.is_empty() || names.contains(command))
        });
        let ContextValue::String(value) = error.get(ContextKind::InvalidValue)? else {
            return None;
        };
        let is_it = |said: &FlagValues| {
            let words = said.words.iter().map(|w| w.to_string_lossy());
            words.into_iter().any(|w| w.contains(value.as_str()))
        };
        let (_, said) = said.find(|(_, said)| is_it(said))?;
        Some(match (said.from, &self.path) {
            (From::File, Some(path)) => format!("`{long}` of {}", path.display()),
            _ => format!("{} of the environment", variable(long)),
        })
    }

    /// `command` with the file's and the environment's values as defaults.
    pub fn apply(&self, command: Command) -> Command {
        let names: Vec<String> = command
            .get_subcommands()
            .map(|c| c.get_name().to_owned())
            .collect();
        let command = self.apply_to("", command);
        names.into_iter().fold(command, |command, name| {
            command.mut_subcommand(&name, |sub| self.apply_to(&name, sub))
        })
    }

    /// [`Self::apply`] to the flags of one command. An empty name stands for the global flags.
    fn apply_to(&self, name: &str, command: Command) -> Command {
        let flags: Vec<(String, String)> = keys(&command)
            .map(|(long, arg)| (long.to_owned(), arg.get_id().to_string()))
            .collect();
        flags.into_iter().fold(command, |command, (long, id)| {
            let value = self.values.get(&(name.to_owned(), long.clone()));
            command.mut_arg(id, |arg| match value {
                // Help prints no default of a switch, and there is none to hide.
                Some(said) if is_switch(&arg) => arg.default_values(said.words.clone()),
                Some(said) => arg
                    .default_values(said.words.clone())
                    .hide_default_value(true),
                None => arg,
            })
        })
    }

    /// The values in effect, as a configuration file with the source of each value in a comment.
    pub fn print(&self, command: &Command, matches: &ArgMatches) -> String {
        let mut text = self.lines("", command, matches);
        if let Some((name, of_it)) = matches.subcommand()
            && let Some(sub) = command.find_subcommand(name)
        {
            text.push_str(&format!("\n[{name}]\n"));
            text.push_str(&self.lines(name, sub, of_it));
        }
        text
    }

    fn lines(&self, name: &str, command: &Command, matches: &ArgMatches) -> String {
        let mut text = String::new();
        // A global flag is printed once.
        let own = keys(command).filter(|(_, arg)| name.is_empty() || !arg.is_global_set());
        for (long, arg) in own {
            let id = arg.get_id().as_str();
            let given = matches.get_raw(id).into_iter().flatten();
            let given: Vec<Value> = given.map(|v| scalar(&v.to_string_lossy())).collect();
            let key = (name.to_owned(), long.to_owned());
            let is_flag = matches.value_source(id) == Some(ValueSource::CommandLine)
                || self.taken_back.iter().any(|f| f == long);
            let said = self.values.get(&key).filter(|_| !is_flag);
            let source = match (said.map(|s| s.from), &self.path) {
                (Some(From::File), Some(path)) => path.display().to_string(),
                (Some(_), _) => variable(long),
                _ if is_flag => "flag".to_owned(),
                _ => "default".to_owned(),
            };
            let value = match (arg.get_action(), &given[..]) {
                (ArgAction::SetTrue, _) => Value::Boolean(matches.get_flag(id)),
                (_, []) => {
                    text.push_str(&format!("# {long} is not set\n"));
                    continue;
                }
                (ArgAction::Set, [one]) => one.clone(),
                (_, all) => Value::Array(all.to_vec()),
            };
            text.push_str(&format!("{long} = {value} # {source}\n"));
        }
        text
    }
}

/// A command line, without the switches that it resets.
pub struct Arguments {
    /// The words, for the argument parser.
    pub words: Vec<OsString>,
    /// Names of the switches that are given as `--FLAG=false`.
    taken_back: Vec<String>,
}

impl Arguments {
    /// Removes `--FLAG=true` and `--FLAG=false`, since the argument parser only accepts switches
    /// without a value.
    pub fn of(words: &[OsString], command: &Command) -> Self {
        let all = command
            .get_subcommands()
            .flat_map(keys)
            .chain(keys(command));
        let switches: Vec<&str> = all
            .filter(|(_, arg)| is_switch(arg))
            .map(|(long, _)| long)
            .collect();
        let mut arguments = Self {
            words: Vec::new(),
            taken_back: Vec::new(),
        };
        let mut words = words.iter();
        for word in words.by_ref() {
            let text = word.to_str().unwrap_or_default();
            let said = text
                .strip_prefix("--")
                .and_then(|t| t.split_once('='))
                .filter(|(long, _)| switches.contains(long))
                .and_then(|(long, value)| Some((long, truth(value.as_ref())?)));
            match said {
                Some((long, true)) => arguments.words.push(format!("--{long}").into()),
                Some((long, false)) => arguments.taken_back.push(long.to_owned()),
                None => arguments.words.push(word.clone()),
            }
            if text == "--" {
                break;
            }
        }
        arguments.words.extend(words.cloned());
        arguments
    }
}

fn is_switch(arg: &Arg) -> bool {
    matches!(arg.get_action(), ArgAction::SetTrue)
}

/// Reads a boolean: yes, no, true, false, on, off, 1, 0.
fn truth(word: &OsStr) -> Option<bool> {
    let command = Command::new("");
    BoolishValueParser::new()
        .parse_ref(&command, None, word)
        .ok()
}

/// The configuration file, if there is one.
pub fn path(arguments: &Arguments) -> Option<PathBuf> {
    asked(arguments).or_else(|| {
        let file = Path::new(FILE);
        file.is_file().then(|| file.to_owned())
    })
}

/// The configuration file that a flag or the environment names.
fn asked(arguments: &Arguments) -> Option<PathBuf> {
    let variable = || std::env::var_os("PRESHADE_CONFIG").filter(|v| !v.is_empty());
    let flag = early(arguments, "--config");
    flag.or_else(variable).map(PathBuf::from)
}

/// The value of `--color` or its variable, read before the command line is parsed and may fail.
pub fn color(arguments: &Arguments) -> Option<OsString> {
    early(arguments, "--color").or_else(|| std::env::var_os(variable("color")))
}

/// The value of a flag, read before the command line is parsed.
fn early(arguments: &Arguments, flag: &str) -> Option<OsString> {
    let mut words = arguments.words.iter();
    while let Some(word) = words.next() {
        let text = word.to_string_lossy();
        if text == "--" {
            return None;
        }
        if text == flag {
            return words.next().cloned();
        }
        if let Some(value) = text.strip_prefix(flag).and_then(|t| t.strip_prefix('=')) {
            return Some(value.into());
        }
    }
    None
}

const PREFIX: &str = "PRESHADE_";

/// A warning for each of `names` that has our prefix and is unknown: misspelled, or of another
/// version.
pub fn unknown_variables(command: &Command, names: impl Iterator<Item = OsString>) -> Vec<String> {
    let flags = command
        .get_subcommands()
        .flat_map(keys)
        .chain(keys(command));
    let mut known: Vec<String> = flags.map(|(long, _)| variable(long)).collect();
    let others = [worker::VARIABLE, worker::LOCK, output::PROGRESS].map(str::to_owned);
    known.extend(others.into_iter().chain([variable("config")]));
    let names = names.map(|name| name.to_string_lossy().into_owned());
    let mut unknown: Vec<String> = names
        .filter(|name| name.starts_with(PREFIX) && !known.contains(name))
        .collect();
    unknown.sort();
    let warning = |name: String| {
        let bare = known.iter().filter_map(|k| k.strip_prefix(PREFIX));
        let near = nearest(name.trim_start_matches(PREFIX), bare)
            .map(|near| format!(" (did you mean `{PREFIX}{near}`?)"))
            .unwrap_or_default();
        format!("warning: the environment has `{name}`, which is no flag's{near}: nothing reads it")
    };
    unknown.into_iter().map(warning).collect()
}

fn variable(long: &str) -> String {
    format!("{PREFIX}{}", long.replace('-', "_").to_uppercase())
}

/// Commands about preshade itself, which have no output paths for shaders.
pub const OF_ITSELF: [&str; 2] = ["man", "completions"];

/// The flags of a command that a file may set.
fn keys(command: &Command) -> impl Iterator<Item = (&str, &Arg)> {
    let of = match OF_ITSELF.contains(&command.get_name()) {
        true => None,
        false => Some(command),
    };
    let flags = of.into_iter().flat_map(Command::get_arguments);
    let flags = flags.filter_map(|a| Some((a.get_long()?, a)));
    let others: &[&str] = match command.get_name() {
        JOBS => &NOT_OF_JOBS,
        // Elsewhere these are seconds for times.
        "evaluate" => &["seconds"],
        _ => &[],
    };
    flags.filter(move |(long, _)| !NOT_KEYS.contains(long) && !others.contains(long))
}

/// A number if it is written as in TOML. `007` is a string.
fn scalar(text: &str) -> Value {
    match text.parse::<i64>() {
        Ok(number) if number.to_string() == text => Value::Integer(number),
        _ => Value::String(text.to_owned()),
    }
}

type Values = BTreeMap<(String, String), FlagValues>;

/// Separates several values in the environment. Recipes and paths may contain commas and blanks.
const SEPARATOR: char = ';';

/// Values of the environment. A variable holds for every command that has the flag.
fn environment(command: &Command) -> Result<Values, Failure> {
    let mut values = Values::new();
    let of = |name: &str, command: &Command, values: &mut Values| {
        for (long, arg) in keys(command) {
            let variable = variable(long);
            let Some(word) = std::env::var_os(&variable).filter(|w| !w.is_empty()) else {
                continue;
            };
            let words = match (arg.get_action(), word.to_str()) {
                (ArgAction::SetTrue, _) => match truth(&word) {
                    Some(truth) => vec![truth.to_string().into()],
                    None => {
                        return Err(Failure(format!(
                            "error: {variable} of the environment is `{}`, and --{long} is true or \
                             false",
                            word.display()
                        )));
                    }
                },
                (ArgAction::Append, Some(text)) => {
                    let parts = text.split(SEPARATOR).map(str::trim);
                    parts.filter(|p| !p.is_empty()).map(Into::into).collect()
                }
                _ => vec![word],
            };
            let said = FlagValues {
                words,
                from: From::Environment,
            };
            values.insert((name.to_owned(), long.to_owned()), said);
        }
        Ok(())
    };
    of("", command, &mut values)?;
    for sub in command.get_subcommands() {
        of(sub.get_name(), sub, &mut values)?;
    }
    Ok(values)
}

fn values(table: &Table, command: &Command) -> Result<Values, String> {
    let mut values = Values::new();
    let commands: Vec<&Command> = command.get_subcommands().collect();
    let names: Vec<&str> = commands.iter().map(|c| c.get_name()).collect();
    for (key, value) in table {
        if let Value::Table(own) = value {
            let Some(sub) = commands.iter().find(|c| c.get_name() == key) else {
                return Err(unknown("command", key, &names));
            };
            let known: Vec<&str> = keys(sub).map(|(long, _)| long).collect();
            for (flag, value) in own {
                if !known.contains(&flag.as_str()) {
                    return Err(unknown(&format!("key in [{key}]"), flag, &known));
                }
                values.insert((key.clone(), flag.clone()), said(sub, flag, value)?);
            }
            continue;
        }
        if keys(command).any(|(long, _)| long == key) {
            values.insert((String::new(), key.clone()), said(command, key, value)?);
            continue;
        }
        let all = commands.iter().flat_map(|c| keys(c)).chain(keys(command));
        let mut all: Vec<&str> = all.map(|(long, _)| long).collect();
        all.sort_unstable();
        all.dedup();
        if !all.contains(&key.as_str()) {
            return Err(unknown("key", key, &all));
        }
        let with = commands
            .iter()
            .filter(|c| keys(c).any(|(long, _)| long == key));
        for sub in with {
            let at = (sub.get_name().to_owned(), key.clone());
            // A command's own table takes precedence.
            let words = said(sub, key, value)?;
            if table
                .get(sub.get_name())
                .is_none_or(|own| own.get(key).is_none())
            {
                values.insert(at, words);
            }
        }
    }
    // Jobs take the flags of `verify`.
    let own = table.get(JOBS);
    for (long, _) in commands
        .iter()
        .filter(|c| c.get_name() == JOBS)
        .flat_map(|c| keys(c))
    {
        let of_verify = values.get(&("verify".to_owned(), long.to_owned()));
        if let Some(said) = of_verify.filter(|_| own.is_none_or(|own| own.get(long).is_none())) {
            values.insert((JOBS.to_owned(), long.to_owned()), said.clone());
        }
    }
    Ok(values)
}

/// The protection that a found file would lift by this value, in words that follow the flag's name.
fn lifts(key: &str, said: &FlagValues) -> Option<&'static str> {
    let mut words = said.words.iter();
    if NOT_FOUND.contains(&key) {
        return Some("");
    }
    if key == "limits" {
        let is_looser = |word: &OsString| {
            let limits = word.to_str().and_then(|w| Limits::parse(w).ok());
            // Invalid limits are reported by their own error.
            limits.is_some_and(|l| !l.is_no_looser_than_default())
        };
        return words
            .any(is_looser)
            .then_some(", which allows more than the defaults,");
    }
    let is_outside = |word: &OsString| !is_below_here(Path::new(word));
    (WRITTEN.contains(&key) && words.any(is_outside))
        .then_some(", which would write outside of this folder,")
}

/// Whether a path is below the current folder, with links resolved.
fn is_below_here(path: &Path) -> bool {
    let is_plain = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    if !path.components().all(is_plain) {
        return false;
    }
    let (Ok(here), Some(there)) = (
        Path::new(".").canonicalize(),
        path.ancestors()
            .map(|p| {
                if p.as_os_str().is_empty() {
                    Path::new(".")
                } else {
                    p
                }
            })
            .find_map(|p| p.canonicalize().ok()),
    ) else {
        return false;
    };
    there.starts_with(here)
}

/// The file's values for a flag of `command`.
fn said(command: &Command, key: &str, value: &Value) -> Result<FlagValues, String> {
    let word = |value: &Value| match value {
        Value::String(text) => Ok(text.clone()),
        Value::Integer(number) => Ok(number.to_string()),
        Value::Float(number) => Ok(number.to_string()),
        Value::Boolean(truth) => Ok(truth.to_string()),
        _ => Err(format!(
            "`{key}` is a text, a number, true or false, or a list of those"
        )),
    };
    let arg = keys(command).find(|(long, _)| *long == key);
    let is_list = arg.is_some_and(|(_, arg)| matches!(arg.get_action(), ArgAction::Append));
    let words: Vec<String> = match value {
        Value::Array(_) if !is_list => return Err(format!("`{key}` is one value, not a list")),
        Value::Array(all) => all.iter().map(word).collect::<Result<_, _>>()?,
        one => vec![word(one)?],
    };
    Ok(FlagValues {
        words: words.into_iter().map(OsString::from).collect(),
        from: From::File,
    })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::Cli;

    #[test]
    fn the_variables_of_workers_are_no_flags() {
        let command = Cli::command();
        let flags = command
            .get_subcommands()
            .flat_map(keys)
            .chain(keys(&command));
        let variables: Vec<String> = flags.map(|(long, _)| variable(long)).collect();
        for name in [worker::VARIABLE, worker::LOCK] {
            assert!(!variables.iter().any(|v| v == name), "{name}");
        }
    }
}
