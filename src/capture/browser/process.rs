//! The browser's process: headless, with a profile of its own that is removed with it.

use std::fs;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::find::find;
use super::{BrowserError, Visit};

/// It may take so long to start.
const STARTING: Duration = Duration::from_secs(60);
const ASKING: Duration = Duration::from_millis(50);

/// Nothing of the user's, nothing in the background, no throttling of a page that nobody sees.
const FLAGS: &[&str] = &[
    "--headless=new",
    "--remote-debugging-port=0",
    "--no-first-run",
    "--no-default-browser-check",
    "--disable-extensions",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-background-timer-throttling",
    "--disable-backgrounding-occluded-windows",
    "--disable-renderer-backgrounding",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--mute-audio",
    "--enable-unsafe-webgpu",
    // Frames of other sites run in the page's process, where the recorder reaches them.
    "--disable-features=IsolateOrigins,site-per-process",
];

/// SwiftShader, for WebGL and WebGPU alike: the same picture on every machine. Without Vulkan,
/// `copyExternalImageToTexture` ends the process that draws.
const SOFTWARE: &[&str] = &[
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--use-webgpu-adapter=swiftshader",
    "--enable-features=Vulkan",
    "--use-vulkan=swiftshader",
    "--disable-vulkan-surface",
];

/// A running browser. It ends when this is dropped.
pub struct Browser {
    child: Child,
    profile: TempDir,
    program: std::path::PathBuf,
}

impl Browser {
    /// Starts it.
    pub fn start(visit: &Visit) -> Result<Self, BrowserError> {
        let program = find(visit.program)?;
        let failed = |e: std::io::Error| BrowserError::Start {
            program: program.clone(),
            message: e.to_string(),
        };
        let profile = tempfile::Builder::new()
            .prefix("preshade-")
            .tempdir()
            .map_err(failed)?;
        let log = fs::File::create(profile.path().join("log")).map_err(failed)?;
        let [width, height] = visit.size;
        let mut command = Command::new(&program);
        command
            .args(FLAGS)
            .args(if visit.is_hardware { &[][..] } else { SOFTWARE })
            .arg(format!("--window-size={width},{height}"))
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .args(is_root().then_some("--no-sandbox"))
            .args(visit.flags)
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log);
        let child = command.spawn().map_err(failed)?;
        Ok(Self {
            child,
            profile,
            program,
        })
    }

    /// The port and the path where DevTools' protocol is spoken.
    pub fn address(&self) -> Result<(u16, String), BrowserError> {
        let file = self.profile.path().join("DevToolsActivePort");
        let end = Instant::now() + STARTING;
        while Instant::now() < end {
            let text = fs::read_to_string(&file).unwrap_or_default();
            let mut lines = text.lines();
            if let (Some(port), Some(path)) = (lines.next(), lines.next())
                && let Ok(port) = port.parse()
            {
                return Ok((port, path.to_owned()));
            }
            sleep(ASKING);
        }
        let log = fs::read_to_string(self.profile.path().join("log")).unwrap_or_default();
        Err(BrowserError::Start {
            program: self.program.clone(),
            message: log.lines().last().unwrap_or("it is silent").to_owned(),
        })
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Chromium runs as root only without its sandbox.
fn is_root() -> bool {
    #[cfg(target_os = "linux")]
    {
        use std::os::unix::fs::MetadataExt as _;
        fs::metadata("/proc/self").is_ok_and(|about| about.uid() == 0)
    }
    #[cfg(not(target_os = "linux"))]
    {
        false
    }
}
