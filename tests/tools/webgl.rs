//! WebGL itself judges GLSL ES: headless Chromium compiles and links the two stages of each pass,
//! ES 3.00 with WebGL 2 and ES 1.00 with WebGL 1.
//!
//! Needed: Chromium (`scripts/setup.sh three`), or its path in `CHROMIUM`.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::process::Command;

use preshade_plan::plan_file::{PassFiles, PlanFile, StageFile, Target};
use serde_json::Value;
use shader_text::files::File;

use crate::accept::scratch;

/// What WebGL was shown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Linked {
    /// Programs that WebGL 2 linked.
    pub webgl2: usize,
    /// Programs that WebGL 1 linked.
    pub webgl1: usize,
    /// Programs with an extension that this browser's WebGL lacks, by extension.
    pub lacking: BTreeMap<String, usize>,
}

/// A context and the texts of two stages.
type Program = [String; 3];

/// Has the programs of every pass of every set linked, each once: a set is a label and what
/// `emit::emit` returned. Panics with all that WebGL refuses.
pub fn link(sets: &[(String, Vec<File>)]) -> Linked {
    let mut labels: HashMap<Program, &str> = HashMap::new();
    for (label, files) in sets {
        for program in programs(files) {
            labels.entry(program).or_insert(label);
        }
    }
    let mut programs: Vec<Program> = labels.keys().cloned().collect();
    programs.sort_unstable();
    let mut linked = Linked::default();
    let mut refused = Vec::new();
    for (program, verdict) in programs.iter().zip(verdicts(&programs)) {
        let [context, vertex, fragment] = program;
        match (&verdict, verdict.get("lacks")) {
            (Value::Null, _) if context == "webgl2" => linked.webgl2 += 1,
            (Value::Null, _) => linked.webgl1 += 1,
            (_, Some(name)) => {
                let name = name.as_str().unwrap_or_default().to_owned();
                *linked.lacking.entry(name).or_default() += 1;
            }
            (said, None) => {
                let said = said.as_str().unwrap_or_default();
                let label = labels[program];
                refused.push(format!(
                    "{context} on {label}: {said}\n{vertex}\n{fragment}"
                ));
            }
        }
    }
    let count = programs.len();
    let all = refused.join("\n\n");
    assert!(
        refused.is_empty(),
        "{} of {count} programs were refused\n\n{all}",
        refused.len()
    );
    linked
}

/// The programs of the passes that `plan.json` lists, with the texts of both stages.
fn programs(files: &[File]) -> Vec<Program> {
    let json = files
        .iter()
        .find(|f| f.name.ends_with(".plan.json"))
        .unwrap();
    let plan: PlanFile = serde_json::from_slice(&json.bytes).unwrap();
    let text = |stage: &StageFile| {
        let file = files.iter().find(|f| f.name == stage.file);
        String::from_utf8(file.unwrap().bytes.clone()).unwrap()
    };
    let of_pass = |pass: &PassFiles| {
        let contexts = [(Target::GlslEs300, "webgl2"), (Target::GlslEs100, "webgl")];
        let present = contexts.into_iter().filter_map(|(target, context)| {
            let vertex = pass.vertex.get(&target)?;
            // WebGL links nothing without a fragment stage, so a plan has an empty one.
            let fragment = pass.fragment.get(&target).expect("a fragment stage");
            Some([context.to_owned(), text(vertex), text(fragment)])
        });
        present.collect::<Vec<_>>()
    };
    let original = plan.original.iter().flat_map(|o| &o.files);
    plan.files
        .iter()
        .chain(original)
        .flat_map(of_pass)
        .collect()
}

/// WebGL's verdict on each program: null, what it says, or what it lacks.
fn verdicts(programs: &[Program]) -> Vec<Value> {
    if programs.is_empty() {
        return Vec::new();
    }
    let folder = scratch();
    std::fs::create_dir_all(&folder).unwrap();
    let page = folder.join("page.html");
    let script = include_str!("../accept/webgl.js");
    // HTML ends a script at its end tag, wherever that is, and prints signs as names.
    let texts = serde_json::to_string(programs)
        .unwrap()
        .replace('<', "\\u003c");
    let plain =
        "replace(/[<>&\\u00a0]/g, (c) => '\\\\u' + c.charCodeAt(0).toString(16).padStart(4, '0'))";
    let html = format!(
        "<!doctype html><meta charset=utf-8><body><script>{script}\n\
         document.body.textContent = JSON.stringify(judge({texts})).{plain};</script>"
    );
    std::fs::write(&page, html).unwrap();
    let output = chromium()
        .arg(format!(
            "--user-data-dir={}",
            folder.join("profile").display()
        ))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap_or_else(|e| panic!("Chromium does not start ({e}): scripts/setup.sh three"));
    let printed = String::from_utf8_lossy(&output.stdout);
    let said = printed
        .split_once("<body>")
        .and_then(|(_, rest)| rest.split_once("</body>"));
    let said = said.map_or("", |(said, _)| said);
    let verdicts: Vec<Value> = serde_json::from_str(said).unwrap_or_else(|e| {
        let complained = String::from_utf8_lossy(&output.stderr);
        panic!("Chromium gives no verdict ({e}): {printed}\n{complained}")
    });
    assert_eq!(verdicts.len(), programs.len(), "WebGL judged every program");
    std::fs::remove_dir_all(&folder).unwrap();
    verdicts
}

fn chromium() -> Command {
    const PLACES: [&str; 3] = [
        "/usr/bin/chromium",
        "/usr/bin/chromium-browser",
        "/usr/bin/google-chrome",
    ];
    let named = std::env::var("CHROMIUM").ok();
    let found = PLACES.iter().find(|p| Path::new(p).exists());
    let path = named.or(found.map(|p| (*p).to_owned()));
    let path =
        path.expect("no Chromium: scripts/setup.sh three installs it, or name one by CHROMIUM");
    let mut command = Command::new(path);
    command.args([
        "--headless",
        "--no-sandbox",
        "--disable-dev-shm-usage",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--dump-dom",
    ]);
    command
}
