//! `preshade.toml`: values for flags, under the environment and under the flags themselves.
//!
//! A key is a long flag's name. At the top of the file it holds for every command that has the flag, in a table named after a command for that one alone.
//! `PRESHADE_` and the flag's name in capitals is the environment's word for it.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command};
use preshade::nearest::nearest;
use toml::{Table, Value};

use crate::{Failure, unknown, worker};

/// The file that is read where there is one.
const FILE: &str = "preshade.toml";

/// Flags that say how the command line itself is read.
const NOT_KEYS: [&str; 5] = ["config", "print-config", "explain", "help", "version"];

/// Flags that lift a protection: a file that nobody named does not.
const NOT_FOUND: [&str; 1] = ["allow-outside"];

/// Values by command and flag.
#[derive(Debug, Default)]
pub struct Config {
    path: Option<PathBuf>,
    values: BTreeMap<(String, String), Vec<String>>,
}

impl Config {
    /// Reads the file that `--config` or `PRESHADE_CONFIG` names, or `preshade.toml` where there is one, and checks it against what `command` takes.
    ///
    /// # Errors
    /// It cannot be read, has a key that is no flag, or a value that is no text, number, truth or list of those.
    pub fn read(arguments: &[OsString], command: &Command) -> Result<Self, Failure> {
        let path =
            named(arguments).or_else(|| std::env::var_os("PRESHADE_CONFIG").map(PathBuf::from));
        let is_named = path.is_some();
        let path = match path {
            Some(path) => path,
            None if Path::new(FILE).is_file() => PathBuf::from(FILE),
            None => return Ok(Self::default()),
        };
        let failed = |message: String| Failure(format!("error: {}: {message}", path.display()));
        let text = std::fs::read_to_string(&path).map_err(|e| failed(e.to_string()))?;
        let table: Table = text
            .parse()
            .map_err(|e: toml::de::Error| failed(e.to_string()))?;
        let values = values(&table, command).map_err(failed)?;
        // The file of a folder may be a stranger's, as its scenes may.
        let mut keys = values.keys().map(|(_, key)| key);
        if let Some(key) = keys.find(|key| !is_named && NOT_FOUND.contains(&key.as_str())) {
            return Err(failed(format!(
                "`{key}` is not taken from a file that only lies here: give the flag, or name the file with --config"
            )));
        }
        Ok(Self {
            path: Some(path),
            values,
        })
    }

    /// The file that was read, if there is one.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// `command` with the file's values for defaults, and with names in the environment.
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

    /// [`Self::apply`] to the flags of one command; of no name, to those that all have.
    fn apply_to(&self, name: &str, command: Command) -> Command {
        let flags: Vec<(String, String)> = keys(&command)
            .map(|(long, arg)| (long.to_owned(), arg.get_id().to_string()))
            .collect();
        flags.into_iter().fold(command, |command, (long, id)| {
            let value = self.values.get(&(name.to_owned(), long.clone()));
            command.mut_arg(id, |arg| {
                let arg = arg.env(variable(&long)).hide_env(true);
                match value {
                    Some(values) => arg.default_values(values.clone()).hide_default_value(true),
                    None => arg,
                }
            })
        })
    }

    /// The values in force for a command line, as a file that says the same; where each comes from stands behind it.
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
        // A flag that all commands have is told once.
        let own = keys(command).filter(|(_, arg)| name.is_empty() || !arg.is_global_set());
        for (long, arg) in own {
            let id = arg.get_id().as_str();
            let given = matches.get_raw(id).into_iter().flatten();
            let given: Vec<Value> = given.map(|v| scalar(&v.to_string_lossy())).collect();
            let is_in_file = self
                .values
                .contains_key(&(name.to_owned(), long.to_owned()));
            let source = match (matches.value_source(id), &self.path) {
                (Some(ValueSource::CommandLine), _) => "flag".to_owned(),
                (Some(ValueSource::EnvVariable), _) => variable(long),
                (_, Some(path)) if is_in_file => path.display().to_string(),
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

/// The file that `--config` names, looked for ahead of the command line's own reading.
fn named(arguments: &[OsString]) -> Option<PathBuf> {
    let mut arguments = arguments.iter();
    while let Some(argument) = arguments.next() {
        let text = argument.to_string_lossy();
        if text == "--" {
            return None;
        }
        if text == "--config" {
            return arguments.next().map(PathBuf::from);
        }
        if let Some(path) = text.strip_prefix("--config=") {
            return Some(PathBuf::from(path));
        }
    }
    None
}

/// How the names of our variables of the environment begin.
const PREFIX: &str = "PRESHADE_";

/// A warning for each of `names` that begins as our variables do and is none: a slip, or of another version.
pub fn unknown_variables(command: &Command, names: impl Iterator<Item = OsString>) -> Vec<String> {
    let flags = command
        .get_subcommands()
        .flat_map(keys)
        .chain(keys(command));
    let mut known: Vec<String> = flags.map(|(long, _)| variable(long)).collect();
    known.extend([variable("config"), worker::VARIABLE.to_owned()]);
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

/// The flags of a command that can stand in a file.
fn keys(command: &Command) -> impl Iterator<Item = (&str, &Arg)> {
    let flags = command
        .get_arguments()
        .filter_map(|a| Some((a.get_long()?, a)));
    flags.filter(|(long, _)| !NOT_KEYS.contains(long))
}

fn scalar(text: &str) -> Value {
    text.parse::<i64>()
        .map(Value::Integer)
        .unwrap_or_else(|_| Value::String(text.to_owned()))
}

type Values = BTreeMap<(String, String), Vec<String>>;

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
                values.insert((key.clone(), flag.clone()), words(flag, value)?);
            }
            continue;
        }
        if keys(command).any(|(long, _)| long == key) {
            values.insert((String::new(), key.clone()), words(key, value)?);
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
            // What is said of one command goes before what is said of all.
            let words = words(key, value)?;
            if table
                .get(sub.get_name())
                .is_none_or(|own| own.get(key).is_none())
            {
                values.insert(at, words);
            }
        }
    }
    Ok(values)
}

fn words(key: &str, value: &Value) -> Result<Vec<String>, String> {
    let word = |value: &Value| match value {
        Value::String(text) => Ok(text.clone()),
        Value::Integer(number) => Ok(number.to_string()),
        Value::Float(number) => Ok(number.to_string()),
        Value::Boolean(truth) => Ok(truth.to_string()),
        _ => Err(format!(
            "`{key}` is a text, a number, true or false, or a list of those"
        )),
    };
    match value {
        Value::Array(all) => all.iter().map(word).collect(),
        one => Ok(vec![word(one)?]),
    }
}
