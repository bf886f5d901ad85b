//! Chromium on this machine.

use std::env;
use std::path::{Path, PathBuf};

use super::BrowserError;

/// Program names to look for on `PATH`, in order of preference.
const NAMES: [&str; 7] = [
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "msedge",
];

/// Where installers for Linux and macOS put the browser.
const PLACES: [&str; 6] = [
    "/usr/bin/chromium",
    "/snap/bin/chromium",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    "/usr/lib/chromium/chromium",
];

/// Where installers for Windows put the browser, relative to the folders for programs.
const WINDOWS: [&str; 3] = [
    r"Google\Chrome\Application\chrome.exe",
    r"Chromium\Application\chrome.exe",
    r"Microsoft\Edge\Application\msedge.exe",
];

/// The environment variable that names the browser's program.
pub const VARIABLE: &str = "CHROMIUM";

/// Finds the browser: the named program, else the one in the variable, else the first installed.
pub fn find(named: Option<&Path>) -> Result<PathBuf, BrowserError> {
    let variable = env::var_os(VARIABLE).filter(|v| !v.is_empty());
    if let Some(path) = named.map(Path::to_path_buf).or(variable.map(PathBuf::from)) {
        return match path.is_file() {
            true => Ok(path),
            false => Err(BrowserError::Missing(path)),
        };
    }
    let folders = env::var_os("PATH").unwrap_or_default();
    let on_path = env::split_paths(&folders).flat_map(|folder| {
        NAMES.map(|name| folder.join(format!("{name}{}", env::consts::EXE_SUFFIX)))
    });
    let programs = ["ProgramFiles", "ProgramFiles(x86)", "LOCALAPPDATA"].into_iter();
    let installed = programs
        .filter_map(env::var_os)
        .flat_map(|folder| WINDOWS.map(|file| Path::new(&folder).join(file)));
    on_path
        .chain(PLACES.map(PathBuf::from))
        .chain(installed)
        .find(|path| path.is_file())
        .ok_or(BrowserError::None)
}
