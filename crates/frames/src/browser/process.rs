//! The browser's process: headless, with a temporary profile that is removed with it.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::find::find;
use super::{BrowserError, Visit};

/// How long the browser may take to start.
const STARTING: Duration = Duration::from_secs(60);
const ASKING: Duration = Duration::from_millis(50);

/// Keeps user data and background work out, and prevents throttling of a page that nobody sees.
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

/// SwiftShader for WebGL and WebGPU: it draws the same picture on every machine. Without Vulkan,
/// `copyExternalImageToTexture` ends the GPU process.
const SOFTWARE: &[&str] = &[
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--use-webgpu-adapter=swiftshader",
    "--enable-features=Vulkan",
    "--use-vulkan=swiftshader",
    "--disable-vulkan-surface",
];

/// A running browser. Dropping it ends the browser. On Unix, the browser also ends when this
/// program dies.
pub(crate) struct Browser {
    child: Child,
    group: Option<Group>,
    profile: TempDir,
    program: std::path::PathBuf,
}

/// The process group of the browser. Leader and guard start before the browser, so that it never
/// runs unguarded.
struct Group {
    /// An idle process. It keeps the group's id valid.
    leader: Child,
    /// Ends the browser when this program dies.
    guard: Child,
}

/// Script of the guard. Its input ends when this program does. It then kills the group `$1`, and
/// removes the profile `$2` and the folder of the socket that the profile links to.
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
            // In a group of its own, Ctrl-C in the terminal does not reach it.
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

    /// Makes `command` start in this group.
    fn adopt(&self, command: &mut Command) {
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, self.leader.id() as i32);
        #[cfg(not(unix))]
        let _ = command;
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        // `wait` closes the input of each, which ends it.
        let _ = self.guard.wait();
        let _ = self.leader.wait();
    }
}

impl Browser {
    /// Starts the browser for a visit.
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

    /// The port and path of DevTools' protocol, once the browser has written them.
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

    /// The error of a failed start, with the last line of the browser's output.
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
        // Either may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
        drop(self.group.take());
    }
}

/// Whether this program runs as root. Chromium then needs `--no-sandbox`.
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
