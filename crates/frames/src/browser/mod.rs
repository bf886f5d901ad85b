//! Records frames of a page in Chromium, headless, by DevTools' protocol.

mod find;
mod process;
mod protocol;
mod site;
pub mod unpack;

use std::collections::BTreeSet;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

pub use find::{VARIABLE, find};
pub use site::Site;
pub use unpack::{UnpackError, prepare, unpack};

use super::codes;
use super::folder::is_folder;
use super::page::RECORDER;
use process::Browser;
use protocol::Client;
use shader_text::limits::Limits;

/// How long a page may take to load, and the default time to wait for its condition.
const LOADING: Duration = Duration::from_secs(120);
/// How long the browser may be silent.
const SILENT: Duration = Duration::from_secs(120);
/// How long a page may draw nothing.
pub(crate) const DRAWING: Duration = Duration::from_secs(30);
/// Time between two evaluations of a condition.
const ASKING: Duration = Duration::from_millis(200);

/// Which page to record, and how.
#[derive(Clone, Debug)]
pub struct Visit<'a> {
    /// The page's address.
    pub url: &'a str,
    /// The browser's program. `None`: see [`find()`].
    pub program: Option<&'a Path>,
    /// How many frames to record.
    pub frames: u32,
    /// Width and height of the window, in pixels.
    pub size: [u32; 2],
    /// Device pixels of a CSS pixel.
    pub scale: f64,
    /// Statements that run in the page once it is loaded.
    pub before: Option<&'a str>,
    /// CSS selectors. After `before`, an element of each is clicked on as soon as it exists.
    pub clicks: &'a [String],
    /// A JavaScript expression. After the clicks, the page is ready once it is true.
    pub condition: Option<&'a str>,
    /// JavaScript that draws a frame of a page that draws on demand.
    pub draw: Option<&'a str>,
    /// Time to wait between the condition and the first frame.
    pub after: Duration,
    /// Whether the machine's GPU draws instead of SwiftShader.
    pub is_hardware: bool,
    /// Additional flags for the browser.
    pub flags: &'a [String],
    /// How long a page may draw nothing (default: 30 s) and how long to wait for conditions
    /// (default: 120 s). The browser may be silent for the same time, but at least 120 s.
    pub patience: Option<Duration>,
}

/// Why a page was not recorded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BrowserError {
    /// No browser is installed.
    #[error(
        "there is no Chromium or Chrome: install one, or name its program by the variable {VARIABLE}"
    )]
    None,
    /// The named browser is not a file.
    #[error("there is no program `{}`, which is named as the browser", .0.display())]
    Missing(PathBuf),
    /// The browser does not start.
    #[error("`{}` does not start: {message}", program.display())]
    Start {
        /// Path of the browser.
        program: PathBuf,
        /// The system's error, or the browser's last line of output.
        message: String,
    },
    /// The connection to the browser broke.
    #[error("the browser ended: {0}")]
    Lost(String),
    /// The browser does not answer.
    #[error("the browser was silent for {} s", .0.as_secs())]
    Silent(Duration),
    /// The browser refuses a call.
    #[error("{method}: {message}")]
    Protocol {
        /// Method of DevTools' protocol.
        method: String,
        /// The browser's message.
        message: String,
    },
    /// The page does not load.
    #[error("`{url}` does not load: {message}")]
    Load {
        /// The page's address.
        url: String,
        /// The browser's message.
        message: String,
    },
    /// A condition did not become true in time.
    #[error("{condition} was waited for in vain for {} s{}", .time.as_secs(), joined(.page))]
    Condition {
        /// The condition as the user wrote it, shortened.
        condition: String,
        /// How long it was waited for.
        time: Duration,
        /// Errors of the page.
        page: Vec<String>,
    },
    /// The recorder failed.
    #[error("{message}{}", joined(.page))]
    Page {
        /// The recorder's message.
        message: String,
        /// Errors of the page.
        page: Vec<String>,
    },
    /// The recorder's stream is no frame folder.
    #[error(transparent)]
    Unpack(#[from] UnpackError),
}

impl BrowserError {
    /// The stable error code.
    pub fn code(&self) -> &'static str {
        match self {
            Self::None
            | Self::Missing(_)
            | Self::Start { .. }
            | Self::Lost(_)
            | Self::Silent(_)
            | Self::Protocol { .. } => codes::BROWSER.code,
            Self::Load { .. } | Self::Condition { .. } | Self::Page { .. } => codes::PAGE.code,
            Self::Unpack(error) => error.code(),
        }
    }
}

fn joined(errors: &[String]) -> String {
    errors
        .iter()
        .map(|error| format!("\n  the page says: {error}"))
        .collect()
}

/// How many errors of the page to report.
const TOLD: usize = 5;

const TOO_LARGE: &str = "it is larger than the limit `scene-bytes` allows";

/// State that the page's events build up: the stream, and the page's own errors.
struct Heard {
    stream: std::fs::File,
    is_whole: bool,
    failed: Option<std::io::Error>,
    /// The first errors of the page, each once.
    errors: Vec<String>,
    /// Bytes that the stream may still grow by.
    room: u64,
    is_loaded: bool,
    /// Execution contexts of the page and of its frames.
    contexts: BTreeSet<i64>,
}

impl Heard {
    fn event(&mut self, method: &str, parameters: &Value) {
        match method {
            "Runtime.bindingCalled" => {
                self.chunk(parameters["payload"].as_str().unwrap_or_default())
            }
            "Runtime.exceptionThrown" => {
                let details = &parameters["exceptionDetails"];
                self.keep_message(&thrown(details));
            }
            "Runtime.consoleAPICalled" if parameters["type"] == "error" => {
                let values = parameters["args"].as_array().into_iter().flatten();
                let values: Vec<String> = values.map(shown).collect();
                self.keep_message(&values.join(" "));
            }
            "Page.loadEventFired" => self.is_loaded = true,
            "Runtime.executionContextCreated" => {
                let context = &parameters["context"];
                if context["auxData"]["isDefault"] == true {
                    self.contexts.extend(context["id"].as_i64());
                }
            }
            "Runtime.executionContextDestroyed" => {
                let gone = parameters["executionContextId"].as_i64();
                self.contexts.retain(|id| Some(*id) != gone);
            }
            "Runtime.executionContextsCleared" => self.contexts.clear(),
            _ => {}
        }
    }

    /// Adds a message to the page's errors, unless it is there already.
    fn keep_message(&mut self, text: &str) {
        let text = shortened(text);
        if !text.is_empty() && self.errors.len() < TOLD && !self.errors.contains(&text) {
            self.errors.push(text);
        }
    }

    /// A failure of the recorder, with the page's errors.
    fn page_error(&mut self, message: String) -> BrowserError {
        let page = std::mem::take(&mut self.errors);
        BrowserError::Page { message, page }
    }

    /// Appends to the stream. An empty chunk ends it.
    fn chunk(&mut self, text: &str) {
        if text.is_empty() {
            self.is_whole = true;
            return;
        }
        let written = STANDARD
            .decode(text)
            .map_err(std::io::Error::other)
            .and_then(|bytes| {
                // Any script of the page may call this.
                let room = self.room.checked_sub(bytes.len() as u64);
                self.room = room.ok_or_else(|| std::io::Error::other(TOO_LARGE))?;
                self.stream.write_all(&bytes)
            });
        if let Err(error) = written {
            self.failed.get_or_insert(error);
        }
    }
}

/// An object's message, or else its members, from the browser's preview of it. `None` if its
/// description is more informative, as for an error.
fn members(value: &Value) -> Option<String> {
    let preview = &value["preview"];
    let is_list = match preview["subtype"].as_str() {
        None => false,
        Some("array") => true,
        Some(_) => return None,
    };
    let properties = preview["properties"].as_array()?.iter();
    let properties =
        properties.filter_map(|p| Some((p["name"].as_str()?, p["value"].as_str()?, p)));
    let mut texts = Vec::new();
    for (name, text, property) in properties {
        let is_text = property["type"] == "string";
        if is_text && name == "message" && !text.is_empty() {
            return Some(text.to_owned());
        }
        let text = match is_text {
            true => format!("{text:?}"),
            false => text.to_owned(),
        };
        texts.push(match is_list {
            true => text,
            false => format!("{name}: {text}"),
        });
    }
    if preview["overflow"] == true {
        texts.push("…".to_owned());
    }
    let inner = texts.join(", ");
    let [open, close] = if is_list { ["[", "]"] } else { ["{", "}"] };
    (!inner.is_empty()).then(|| format!("{open}{inner}{close}"))
}

/// A value that the page threw or printed.
fn shown(value: &Value) -> String {
    if let Some(members) = members(value) {
        return members;
    }
    match (&value["value"], value["description"].as_str()) {
        (Value::String(text), _) => text.clone(),
        (Value::Null, Some(description)) => description.to_owned(),
        (other, description) => description.map_or_else(|| other.to_string(), str::to_owned),
    }
}

/// Text of an exception: an error's own text, or another value after the browser's `Uncaught`.
fn thrown(details: &Value) -> String {
    let exception = &details["exception"];
    let text = details["text"].as_str().unwrap_or_default();
    match exception["subtype"] == "error" {
        true => shown(exception),
        false if exception.is_object() => format!("{text} {}", shown(exception)),
        false => text.to_owned(),
    }
}

/// A message without its stack, cut to 8 lines and 1,000 characters. A shader's log has several
/// lines.
fn shortened(text: &str) -> String {
    let lines = text
        .lines()
        .map(str::trim_end)
        .filter(|line| !line.is_empty());
    let lines = lines.take_while(|line| !line.trim_start().starts_with("at "));
    let lines: Vec<&str> = lines.take(8).collect();
    lines.join("\n    ").chars().take(1000).collect()
}

/// Records a page into `folder`, in place of an earlier capture. Returns the errors of the page.
///
/// If recording fails after some frames, it returns the error. It still writes these frames if the folder holds no
/// earlier capture.
///
/// # Errors
/// [`BrowserError`].
pub fn record(visit: &Visit, folder: &Path, limits: &Limits) -> Result<Vec<String>, BrowserError> {
    let mut browser = Browser::start(visit)?;
    let (port, path) = browser.address()?;
    let patience = visit.patience.unwrap_or(SILENT).max(SILENT);
    let mut client = Client::connect(port, &path, patience)?;
    let mut heard = Heard {
        stream: tempfile::tempfile().map_err(UnpackError::Write)?,
        is_whole: false,
        failed: None,
        errors: Vec::new(),
        // Each file has a header, and frame.json comes several times.
        room: limits.of("scene-bytes").saturating_mul(2),
        is_loaded: false,
        contexts: BTreeSet::new(),
    };
    let recorded = drive(&mut client, visit, &mut heard);
    drop(client);
    drop(browser);
    if let Some(error) = heard.failed {
        return Err(UnpackError::Write(error).into());
    }
    heard
        .stream
        .seek(SeekFrom::Start(0))
        .map_err(UnpackError::Write)?;
    if is_folder(folder)
        && let Err(error) = recorded
    {
        return Err(error);
    }
    let unpacked = unpack(&mut heard.stream, folder, limits);
    recorded?;
    unpacked?;
    Ok(heard.errors)
}

fn drive(client: &mut Client, visit: &Visit, heard: &mut Heard) -> Result<(), BrowserError> {
    client.open_page()?;
    let [width, height] = visit.size;
    let screen = json!({ "width": width, "height": height, "deviceScaleFactor": visit.scale, "mobile": false });
    let set_up = [
        ("Page.enable", json!({})),
        ("Runtime.enable", json!({})),
        ("Emulation.setDeviceMetricsOverride", screen),
        ("Runtime.addBinding", json!({ "name": "preshadeSink" })),
        (
            "Page.addScriptToEvaluateOnNewDocument",
            json!({ "source": RECORDER }),
        ),
    ];
    for (method, parameters) in set_up {
        client.call(method, parameters, &mut |m, p| heard.event(m, p))?;
    }
    load(client, visit, heard)?;
    if let Some(statements) = visit.before {
        let run = format!("(async () => {{ {statements}\n}})()");
        evaluate(client, &run, None, heard)?
            .map_err(|m| heard.page_error(format!("--before: {m}")))?;
    }
    let patience = visit.patience.unwrap_or(LOADING);
    for selector in visit.clicks {
        click(client, selector, patience, heard)?;
    }
    if let Some(condition) = visit.condition {
        wait_for(
            client,
            condition,
            &format!("Boolean({condition})"),
            patience,
            heard,
        )?;
    }
    client.listen(visit.after, &mut |m, p| {
        heard.event(m, p);
        false
    })?;
    let draw = visit
        .draw
        .map_or_else(String::new, |js| format!(", draw: () => {{ {js} }}"));
    let start = format!(
        "preshadeCapture.start({{ frames: {}, patience: {}{draw} }})",
        visit.frames,
        visit.patience.unwrap_or(DRAWING).as_millis()
    );
    let context = largest(client, heard)?;
    let result = evaluate(client, &start, context, heard)?;
    // This call fails too if the page is lost.
    if let Ok(Ok(Value::Array(of_api))) =
        evaluate(client, "preshadeCapture.errors()", context, heard)
    {
        for text in of_api {
            heard.keep_message(text.as_str().unwrap_or_default());
        }
    }
    result.map_err(|message| heard.page_error(message))?;
    if !heard.is_whole {
        client.listen(visit.patience.unwrap_or(SILENT), &mut |m, p| {
            heard.event(m, p);
            heard.is_whole
        })?;
    }
    Ok(())
}

fn load(client: &mut Client, visit: &Visit, heard: &mut Heard) -> Result<(), BrowserError> {
    let url = visit.url;
    let failed = |message: &str| BrowserError::Load {
        url: url.to_owned(),
        message: message.to_owned(),
    };
    let result = client.call("Page.navigate", json!({ "url": url }), &mut |m, p| {
        heard.event(m, p)
    })?;
    if let Some(message) = result["errorText"].as_str() {
        return Err(failed(message));
    }
    let is_loaded = heard.is_loaded
        || client.listen(LOADING, &mut |m, p| {
            heard.event(m, p);
            heard.is_loaded
        })?;
    match is_loaded {
        true => Ok(()),
        false => Err(failed(&format!("no end after {} s", LOADING.as_secs()))),
    }
}

/// Evaluates `asked` until it is neither false nor null. Errors name `what`, the user's own text.
fn wait_for(
    client: &mut Client,
    what: &str,
    asked: &str,
    patience: Duration,
    heard: &mut Heard,
) -> Result<Value, BrowserError> {
    // A long text would hide the reason.
    let what = match what.char_indices().nth(80) {
        Some((end, _)) => format!("`{}..`", &what[..end]),
        None => format!("`{what}`"),
    };
    let end = Instant::now() + patience;
    loop {
        match evaluate(client, asked, None, heard)? {
            Ok(Value::Bool(false) | Value::Null) => {}
            Ok(value) => return Ok(value),
            Err(message) => return Err(heard.page_error(format!("{message}, in {what}"))),
        }
        if Instant::now() >= end {
            return Err(BrowserError::Condition {
                condition: what,
                time: patience,
                page: std::mem::take(&mut heard.errors),
            });
        }
        client.listen(ASKING, &mut |m, p| {
            heard.event(m, p);
            false
        })?;
    }
}

/// Clicks on the middle of an element with real mouse events. Pages start sound and animations only
/// after those.
fn click(
    client: &mut Client,
    selector: &str,
    patience: Duration,
    heard: &mut Heard,
) -> Result<(), BrowserError> {
    let asked = format!(
        "(() => {{ const e = document.querySelector({}); e?.scrollIntoView({{ block: 'center' }});
         const b = e?.getBoundingClientRect(); return b?.width && b.height ? [b.x + b.width / 2, b.y + b.height / 2] : null }})()",
        Value::from(selector)
    );
    let at = wait_for(client, selector, &asked, patience, heard)?;
    for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
        let mouse =
            json!({ "type": kind, "x": at[0], "y": at[1], "button": "left", "clickCount": 1 });
        client.call("Input.dispatchMouseEvent", mouse, &mut |m, p| {
            heard.event(m, p)
        })?;
    }
    Ok(())
}

/// Pixels of the largest canvas of a document.
const LARGEST: &str =
    "Math.max(0, ...Array.from(document.querySelectorAll('canvas'), c => c.width * c.height))";

/// Execution context of the frame with the largest canvas. `None`: the page itself.
fn largest(client: &mut Client, heard: &mut Heard) -> Result<Option<i64>, BrowserError> {
    let mut best = match evaluate(client, LARGEST, None, heard)? {
        Ok(pixels) => (pixels.as_f64().unwrap_or(0.0), None),
        Err(_) => (0.0, None),
    };
    for context in heard.contexts.clone() {
        // The frame may be gone by now.
        let Ok(Ok(pixels)) = evaluate(client, LARGEST, Some(context), heard) else {
            continue;
        };
        let pixels = pixels.as_f64().unwrap_or(0.0);
        if pixels > best.0 {
            best = (pixels, Some(context));
        }
    }
    Ok(best.1)
}

/// Evaluates an expression in the page or in one of its frames. The inner error is the exception's
/// text.
fn evaluate(
    client: &mut Client,
    expression: &str,
    context: Option<i64>,
    heard: &mut Heard,
) -> Result<Result<Value, String>, BrowserError> {
    let mut parameters =
        json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
    if let Some(context) = context {
        parameters["contextId"] = json!(context);
    }
    let mut result = client.call("Runtime.evaluate", parameters, &mut |m, p| {
        heard.event(m, p)
    })?;
    let Some(details) = result.get("exceptionDetails") else {
        return Ok(Ok(result["result"]["value"].take()));
    };
    let text = shortened(&thrown(details));
    Ok(Err(text.trim_start_matches("Error: ").to_owned()))
}
