//! `preshade capture`: records frames of a page, or of an app's trace, into a frame folder.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::builder::NonEmptyStringValueParser;
use preshade_frames::browser::{self, Site, Visit};
use preshade_frames::file::{Api, Refused};
use preshade_frames::folder::{Capture, file_of, is_folder};
use preshade_frames::page::{RECORDER, bookmarklet};
use preshade_frames::pass::passes;
use preshade_frames::trace::{self, FrameChoice, TraceSummary};
use preshade_scenes::capture::{UnknownDepth, unknown_depths};
use serde_json::Value;
use shader_text::limits::Limits;

use crate::limits::LimitArgs;
use crate::{Ending, Failure, output};

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  preshade capture https://example.com/demo --frames 2 -o frame/
  preshade capture page.html --wait-for '#canvas[data-ready]' -o frame/
  preshade capture --script > preshade-capture.js
  preshade capture ~/Downloads/frame.tar -o frame/
  preshade capture --wgpu-trace trace/ --frames 2 -o frame/

The page is drawn by Chromium without a window, in software: by a GPU with --hardware. The variable
CHROMIUM names another program. A captured frame holds other people's shaders, textures and meshes.
docs/guides/capture.md shows what to do with it, and docs/guides/capture-wgpu.md how an app that
draws with wgpu writes a trace.")]
pub struct CaptureArgs {
    /// Address of a page, an HTML file, a folder with index.html, or a frame.tar that the recorder
    /// saved.
    #[arg(required_unless_present_any = ["script", "bookmarklet", "wgpu_trace"])]
    page: Option<String>,
    /// Folder to write.
    #[arg(short, long, value_name = "DIR", default_value = "frame")]
    out: PathBuf,
    /// Frames to record, one after the other.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    frames: u32,
    /// Record so many seconds after the page is loaded and ready.
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = seconds)]
    after: f64,
    /// Wait until the page has an element of this CSS selector, or until a JavaScript expression is
    /// true: `js:scene.isReady()`.
    #[arg(long, value_name = "SELECTOR|js:EXPRESSION", value_parser = NonEmptyStringValueParser::new())]
    wait_for: Option<String>,
    /// JavaScript to run once the page is loaded, before it is waited for: `app.load("lake")`. `await` may be used.
    #[arg(long, value_name = "JS", value_parser = NonEmptyStringValueParser::new())]
    before: Option<String>,
    /// Then click on the element of this CSS selector, once it is there; may be repeated.
    #[arg(long, value_name = "SELECTOR", value_parser = NonEmptyStringValueParser::new())]
    click: Vec<String>,
    /// JavaScript that draws a frame, for a page that draws on demand: `viewer.render()`.
    #[arg(long, value_name = "JS", value_parser = NonEmptyStringValueParser::new())]
    draw: Option<String>,
    /// Size of the window, in CSS pixels.
    #[arg(long, value_name = "WxH", allow_hyphen_values = true, default_value = "1280x720", value_parser = size)]
    size: [u32; 2],
    /// Device pixels of a CSS pixel, from 0.1 to 8: the page's devicePixelRatio.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = scale)]
    scale: f64,
    /// For a page of your disk: the folder that it may read. Without it, the page's own.
    #[arg(long, value_name = "DIR")]
    root: Option<PathBuf>,
    /// Draw with this machine's GPU.
    #[arg(long)]
    hardware: bool,
    /// One more flag for Chromium, as `--flag=--lang=de`; may be repeated.
    #[arg(long, value_name = "FLAG", allow_hyphen_values = true, value_parser = flag)]
    flag: Vec<String>,
    /// Give up when the page draws nothing for so long (default: 30), or --wait-for or --click wait so long (default:
    /// 120).
    #[arg(long, value_name = "SECONDS")]
    patience: Option<u64>,
    /// Read the frames from a trace that wgpu 29 or 30 wrote: a folder with trace.ron.
    #[arg(
        long,
        value_name = "DIR",
        conflicts_with_all = [
            "page", "script", "bookmarklet", "after", "wait_for", "before", "click", "size", "scale", "root", "hardware", "flag", "patience",
        ]
    )]
    wgpu_trace: Option<PathBuf>,
    /// With --wgpu-trace: the first frame to write, from 0. Without it, the last ones are written.
    #[arg(long, value_name = "FRAME", requires = "wgpu_trace")]
    from: Option<usize>,
    /// With --wgpu-trace: what ends a frame. Without it: present, or submit if the app has no window.
    #[arg(long, value_name = "WHAT", requires = "wgpu_trace")]
    frames_by: Option<FramesBy>,
    #[command(flatten)]
    limits: LimitArgs,
    /// Print the recorder, for a script tag before the page's own scripts.
    #[arg(long, conflicts_with_all = ["page", "bookmarklet"])]
    script: bool,
    /// Print the recorder as a bookmarklet.
    #[arg(long, conflicts_with = "page")]
    bookmarklet: bool,
}

/// What ends a frame of a trace.
#[derive(Clone, Copy, clap::ValueEnum)]
enum FramesBy {
    Present,
    Submit,
}

/// Zero or more, and not so many that nobody would wait.
fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.0..=3600.0).contains(&seconds) => Ok(seconds),
        _ => Err("a number from 0 to 3600".to_owned()),
    }
}

fn scale(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(scale) if (0.1..=8.0).contains(&scale) => Ok(scale),
        _ => Err("a number from 0.1 to 8".to_owned()),
    }
}

/// Flags that `capture` sets itself, with the alternative for the user.
const OWN_FLAGS: [(&str, &str); 4] = [
    ("--force-device-scale-factor", "give `--scale 2`"),
    ("--window-size", "give `--size 1920x1080`"),
    ("--user-data-dir", "each capture has a new profile"),
    (
        "--remote-debugging-port",
        "`capture` talks to the browser by a port of its own",
    ),
];

fn flag(text: &str) -> Result<String, String> {
    let name = text.split('=').next().unwrap_or_default();
    match OWN_FLAGS.iter().find(|(own, _)| *own == name) {
        Some((_, instead)) => Err(format!("it has no effect here: {instead}")),
        None => Ok(text.to_owned()),
    }
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let parts = text.split_once('x').map(|(w, h)| (w.parse(), h.parse()));
    match parts {
        Some((Ok(width @ 1..=16384), Ok(height @ 1..=16384))) => Ok([width, height]),
        _ => Err("two numbers from 1 to 16384, as 1280x720".to_owned()),
    }
}

pub fn run(args: &CaptureArgs) -> Result<Ending, Failure> {
    if args.script {
        output::data(RECORDER)?;
        return Ok(Ending::Fine);
    }
    if args.bookmarklet {
        output::data(&bookmarklet())?;
        return Ok(Ending::Fine);
    }
    let page = args.page.as_deref().unwrap_or_default();
    let limits = args.limits.limits();
    browser::prepare(&args.out)?;
    if let Some(folder) = &args.wgpu_trace {
        return traced(folder, args, &limits);
    }
    let had_earlier = is_folder(&args.out);
    let recorded = match Path::new(page) {
        file if file.extension().is_some_and(|e| e == "tar") && file.is_file() => {
            let unpacked = browser::unpack(&mut fs::File::open(file)?, &args.out, &limits);
            unpacked.map(|()| Vec::new()).map_err(Failure::from)
        }
        _ => {
            let condition = args.wait_for.as_deref().map(condition);
            let place = Page::of(page, args.root.as_deref())?;
            let visit = Visit {
                url: place.address(),
                program: None,
                frames: args.frames,
                size: args.size,
                scale: args.scale,
                before: args.before.as_deref(),
                clicks: &args.click,
                condition: condition.as_deref(),
                draw: args.draw.as_deref(),
                after: Duration::from_secs_f64(args.after),
                is_hardware: args.hardware,
                flags: &args.flag,
                patience: args.patience.map(Duration::from_secs),
            };
            let record = || browser::record(&visit, &args.out, &limits);
            let recorded = output::working(format!("recording {}", place.address()), record);
            place.tell_missing();
            recorded.map_err(Failure::from)
        }
    };
    // Files from before a failure stay, and are summarised.
    if is_folder(&args.out) && (recorded.is_ok() || !had_earlier) {
        output::table(&summary(&args.out, &limits)?)?;
    }
    for said in recorded.map_err(|failure| kept(failure, had_earlier, &args.out))? {
        output::message(&format!("warning: the page says: {said}"));
    }
    Ok(Ending::Fine)
}

/// A failure that mentions the earlier capture.
fn kept(Failure(why): Failure, had_earlier: bool, out: &Path) -> Failure {
    match had_earlier {
        true => Failure(format!(
            "{}\n = `{}` keeps its earlier capture",
            why.trim_end(),
            out.display()
        )),
        false => Failure(why),
    }
}

/// Writes frames of a trace.
fn traced(folder: &Path, args: &CaptureArgs, limits: &Limits) -> Result<Ending, Failure> {
    let wanted = FrameChoice {
        frames: args.frames as usize,
        from: args.from,
        by: args.frames_by.map(|by| match by {
            FramesBy::Present => trace::FramesBy::Present,
            FramesBy::Submit => trace::FramesBy::Submit,
        }),
    };
    let had_earlier = is_folder(&args.out);
    let found = trace::convert(folder, &args.out, &wanted, limits);
    let found = found.map_err(|error| kept(error.into(), had_earlier, &args.out))?;
    let mut text = summary(&args.out, limits)?;
    text.push_str(&told(&found));
    output::table(&text)?;
    Ok(Ending::Fine)
}

/// Which frames of the trace were written.
fn told(found: &TraceSummary) -> String {
    let last = found.first + found.written - 1;
    let written = match found.written {
        1 => format!("frame {last}"),
        _ => format!("frames {} to {last}", found.first),
    };
    let ends = match found.by {
        trace::FramesBy::Present => "presented",
        trace::FramesBy::Submit => "submitted, without a window",
    };
    let cut = match found.is_cut {
        true => "; the trace has no end, and what follows the last whole frame is left out",
        false => "",
    };
    format!(
        "The trace of wgpu {} has {} that the app {ends}. This is {written}, counted from 0{cut}.\n",
        found.version.number(),
        output::count(found.frames, "frame"),
    )
}

/// The JavaScript expression of `--wait-for`.
fn condition(text: &str) -> String {
    match text.strip_prefix("js:") {
        Some(expression) => expression.to_owned(),
        None => format!("document.querySelector({})", Value::from(text)),
    }
}

/// Endings of files, where a page without a scheme is no host.
const NO_HOSTS: [&str; 8] = [
    ".html", ".htm", ".glb", ".gltf", ".tar", ".wgsl", ".toml", ".json",
];

/// Refuses a file that is no page, as another command reads it.
fn no_page(file: &Path) -> Result<(), Failure> {
    let ending = file
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    let name = file.display();
    let remedy = match ending.as_str() {
        "html" | "htm" | "xhtml" | "svg" | "" => return Ok(()),
        "glb" | "gltf" | "toml" | "wgsl" | "glsl" | "vert" | "frag" | "spv" => {
            format!("`preshade verify {name}` draws it")
        }
        "js" | "mjs" | "ts" => "give the HTML file that loads it".to_owned(),
        "ron" => format!(
            "for a trace of wgpu, give `--wgpu-trace {}`",
            file.parent().unwrap_or(file).display()
        ),
        _ => "give an HTML file, a folder with index.html, or an address".to_owned(),
    };
    Err(Failure(format!("error: `{name}` is no page: {remedy}")))
}

enum Page {
    Web(String),
    /// A file of this machine, served from a folder.
    Local(Site, String),
}

impl Page {
    /// The page as given: an address, a file or folder, or a host without `http://`.
    fn of(page: &str, root: Option<&Path>) -> Result<Self, Failure> {
        let path = Path::new(page.strip_prefix("file://").unwrap_or(page));
        if path == Path::new(page) && (page.contains("://") || page.starts_with("data:")) {
            return Ok(Self::Web(page.to_owned()));
        }
        let file = match path.is_dir() {
            true => path.join("index.html"),
            false => path.to_path_buf(),
        };
        if !file.is_file() {
            let host = page.split(['/', ':', '?']).next().unwrap_or_default();
            let is_host = host == "localhost"
                || (host.contains('.') && !NO_HOSTS.iter().any(|e| page.ends_with(e)));
            return match is_host && !path.is_dir() {
                true => Ok(Self::Web(format!("http://{page}"))),
                false => Err(Failure(format!(
                    "error: there is no file `{}`",
                    file.display()
                ))),
            };
        }
        no_page(&file)?;
        let own = file.parent().filter(|p| !p.as_os_str().is_empty());
        let root = root.or(own).unwrap_or(Path::new("."));
        let site = Site::open(root)?;
        let address = site.address(&file).ok_or_else(|| {
            Failure(format!(
                "error: --root: `{}` is not below `{}`",
                file.display(),
                root.display()
            ))
        })?;
        Ok(Self::Local(site, address))
    }

    fn address(&self) -> &str {
        match self {
            Self::Web(address) | Self::Local(_, address) => address,
        }
    }

    /// Prints which files a local page lacked.
    fn tell_missing(&self) {
        let Self::Local(site, _) = self else { return };
        let missing = site.missing();
        if !missing.is_empty() {
            output::message(&format!(
                "warning: the page asked for files that are not there: {}. It may read what is below its own folder; \
                 --root names one above",
                missing.join(", ")
            ));
        }
    }
}

/// A line on the draws that may differ from the page because a depth is unknown.
fn told_unknown(depth: &UnknownDepth, frames: usize) -> String {
    let passes: Vec<String> = depth.passes.iter().map(usize::to_string).collect();
    let what = if depth.is_stencil { "stencil" } else { "depth" };
    let frame = match frames {
        1 => String::new(),
        _ => format!(" of frame {}", depth.frame),
    };
    format!(
        "  the {what} of texture {} is unknown when {} of render pass {}{frame} test or read it: they may show something \
         else than the page\n",
        depth.texture,
        output::count(depth.draws, "draw"),
        passes.join(", "),
    )
}

/// The recorded counts, and the parts that were not recorded.
fn summary(folder: &Path, limits: &Limits) -> Result<String, Failure> {
    let capture = Capture::open(folder, limits)?;
    let file = &capture.file;
    let (mut draws, mut all_passes, mut pipelines) = (0, 0, BTreeSet::new());
    for frame in 0..file.frames.len() {
        for pass in passes(&capture, frame)? {
            all_passes += 1;
            draws += pass.draws.len();
            pipelines.extend(pass.draws.iter().map(|d| d.pipeline));
        }
    }
    let mut bytes = fs::metadata(file_of(folder))?.len();
    for entry in fs::read_dir(folder.join("data"))? {
        bytes += entry?.metadata()?.len();
    }
    let size = file.frames.first().map_or(String::new(), |frame| {
        let [width, height] = frame.size;
        format!(" of {width}x{height}")
    });
    let adapter = Some(file.source.adapter.as_str()).filter(|a| !a.is_empty());
    let mut text = format!(
        "{}: {}{size}, {}, {}, {}, {:.1} MiB, by {} on {}\n",
        folder.display(),
        output::count(file.frames.len(), "frame"),
        output::count(draws, "draw"),
        output::count(all_passes, "render pass").replace("passs", "passes"),
        output::count(pipelines.len(), "pipeline"),
        bytes as f64 / f64::from(1 << 20),
        file.source.api.name(),
        adapter.unwrap_or("?"),
    );
    for refused in &file.refused {
        let Refused { what, why, count } = refused;
        text.push_str(&format!("  left out: {what} ({count}): {why}\n"));
    }
    let mut unknown: BTreeMap<&str, usize> = BTreeMap::new();
    // A stencil is listed where a draw tests it: most are cleared, or unused.
    for entry in file.unknown.iter().filter(|entry| !entry.is_stencil()) {
        *unknown.entry(&entry.why).or_default() += 1;
    }
    for (why, count) in unknown {
        text.push_str(&format!("  unknown content ({count}): {why}\n"));
    }
    for depth in unknown_depths(&capture)? {
        text.push_str(&told_unknown(&depth, file.frames.len()));
    }
    let whose = match file.source.api {
        Api::Wgpu => "app",
        _ => "page",
    };
    text.push_str(&format!("It holds the {whose}'s shaders, textures and meshes: ask their owners before you pass it on.\n"));
    Ok(text)
}
