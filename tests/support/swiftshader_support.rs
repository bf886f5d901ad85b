//! SwiftShader's Vulkan driver, the second driver of the tests: Chromium's package has it. It differs
//! from Mesa's in what no language decides, as where in a pixel a depth is taken under multisampling.

use std::path::{Path, PathBuf};

/// The loader's variable for the only drivers to load.
pub const VARIABLE: &str = "VK_DRIVER_FILES";

const FILE: &str = "vk_swiftshader_icd.json";

/// The driver's description.
///
/// # Panics
/// There is none: a test that needs it fails.
pub fn swiftshader() -> PathBuf {
    let browser = std::env::var_os("CHROMIUM").map(PathBuf::from);
    let beside = browser.as_deref().and_then(Path::parent);
    let folders = [
        "/usr/lib/chromium",
        "/usr/lib/chromium-browser",
        "/usr/lib64/chromium-browser",
        "/opt/google/chrome",
    ];
    let folders = beside.into_iter().chain(folders.map(Path::new));
    let mut files = folders.map(|folder| folder.join(FILE));
    files.find(|file| file.is_file()).unwrap_or_else(|| {
        panic!(
            "{FILE} is not there: install Chromium (scripts/setup.sh swiftshader), or set CHROMIUM \
             to a browser that has it in its folder"
        )
    })
}
