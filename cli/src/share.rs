//! `--share`: a report without names of this machine's folders.

use std::ffi::OsString;
use std::path::Path;

use crate::{Failure, output};

/// Writes the file of `--share`.
pub fn share(path: Option<&Path>, json: &str) -> Result<(), Failure> {
    let Some(path) = path else {
        return Ok(());
    };
    let json = without_folders(json, std::env::args_os());
    std::fs::write(path, json).map_err(|e| Failure(format!("error: {}: {e}", path.display())))?;
    output::message(&format!("wrote {}", path.display()));
    Ok(())
}

/// A report without folders that were typed as absolute paths, so that it can be shared.
fn without_folders(json: &str, arguments: impl Iterator<Item = OsString>) -> String {
    let mut folders: Vec<String> = arguments
        .filter_map(|argument| {
            let argument = argument.to_str()?;
            let path = argument
                .split_once('=')
                .map_or(argument, |(_, value)| value);
            let folder = Path::new(path)
                .parent()
                .filter(|_| Path::new(path).is_absolute())?;
            let folder = serde_json::to_string(&folder.join("")).ok()?;
            Some(folder.trim_matches('"').to_owned())
        })
        .filter(|folder| folder.len() > 1)
        .collect();
    folders.sort_by_key(|folder| std::cmp::Reverse(folder.len()));
    folders
        .iter()
        .fold(json.to_owned(), |json, folder| json.replace(folder, ""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_shared_names_no_folder_of_the_machine() {
        let json = r#"{"command":"preshade verify /home/ada/shop/a.toml --out=/home/ada/out scenes/b.toml","file":"/home/ada/shop/shaders/a.wgsl"}"#;
        let typed = [
            "verify",
            "/home/ada/shop/a.toml",
            "--out=/home/ada/out",
            "scenes/b.toml",
        ];
        assert_eq!(
            without_folders(json, typed.map(OsString::from).into_iter()),
            r#"{"command":"preshade verify a.toml --out=out scenes/b.toml","file":"shaders/a.wgsl"}"#
        );
    }
}
