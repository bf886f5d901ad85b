//! The browser's process: headless, with a profile of its own that is removed with it.

use std::fs;
use std::path::Path;
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

/// A running browser. It ends when this is dropped, and on Unix also when our program ends in any other way.
pub(crate) struct Browser {
    child: Child,
    group: Option<Group>,
    profile: TempDir,
    program: std::path::PathBuf,
}

/// The group of the browser's processes. Leader and guard start first, so that no browser is without its guard.
struct Group {
    /// Does nothing: a group has an id only while a process of it lives.
    leader: Child,
    /// Ends the browser.
    guard: Child,
}

/// Waits until its input ends, which is when our program does. Then it ends the browser, whose processes are the group
/// of its first argument, and removes the profile, its second, and the folder of the socket that the profile links to.
const GUARD: &str = r#"trap '' INT TERM HUP
read -r _
kill -9 "-$1"
socket=$(readlink "$2/SingletonSocket")
case "$socket" in */org.chromium.*/SingletonSocket) rm -rf "${socket%/*}" ;; esac
for try in 1 2 3 4 5 6 7 8 9 10; do rm -rf "$2" && break; sleep 0.1; done"#;

impl Group {
    #[cfg(unix)]
    fn start(profile: &Path) -> std::io::Result<Option<Self>> {
        let shell = |script: &str, arguments: &[&std::ffi::OsStr]| {
            let mut shell = Command::new("/bin/sh");
            shell.args(["-c", script, "preshade"]).args(arguments);
            shell
                .stdin(Stdio::piped())
                .stdout(Stdio::null())
                .stderr(Stdio::null());
            // Ctrl-C in the terminal does not reach a group of its own.
            std::os::unix::process::CommandExt::process_group(&mut shell, 0);
            shell.spawn()
        };
        let leader = shell("read -r _", &[])?;
        let id = leader.id().to_string();
        let guard = shell(GUARD, &[id.as_ref(), profile.as_os_str()])?;
        Ok(Some(Self { leader, guard }))
    }

    #[cfg(not(unix))]
    fn start(_: &Path) -> std::io::Result<Option<Self>> {
        Ok(None)
    }

    /// Lets `command` start in the group.
    fn adopt(&self, command: &mut Command) {
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, self.leader.id() as i32);
        #[cfg(not(unix))]
        let _ = command;
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        // The input of each ends with the wait.
        let _ = self.guard.wait();
        let _ = self.leader.wait();
    }
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
        let group = Group::start(profile.path()).map_err(failed)?;
        if let Some(group) = &group {
            group.adopt(&mut command);
        }
        let child = command.spawn().map_err(failed)?;
        Ok(Self {
            child,
            group,
            profile,
            program,
        })
    }

    /// The port and the path where DevTools' protocol is spoken.
    pub fn address(&mut self) -> Result<(u16, String), BrowserError> {
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
            if let Ok(Some(status)) = self.child.try_wait() {
                return Err(self.not_started(&format!("it ended at once ({status})")));
            }
            sleep(ASKING);
        }
        Err(self.not_started(&format!("it is silent for {} s", STARTING.as_secs())))
    }

    /// With the last line that it wrote.
    fn not_started(&self, why: &str) -> BrowserError {
        let log = fs::read_to_string(self.profile.path().join("log")).unwrap_or_default();
        let last = log.lines().rfind(|line| !line.trim().is_empty());
        BrowserError::Start {
            program: self.program.clone(),
            message: last.map_or(why.to_owned(), |line| format!("{why}: {line}")),
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // Each may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
        drop(self.group.take());
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
