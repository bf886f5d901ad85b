//! Compilers that are not ours.

use std::path::{Path, PathBuf};
use std::process::Command;

use preshade_plan::plan_file::Target;

use crate::file_name;
use crate::reflection_support::{self, Interface};

const TOOLS: [&str; 5] = [
    "tint",
    "spirv-val",
    "spirv-opt",
    "glslangValidator",
    "spirv-cross",
];

/// Ends the run if a tool is missing.
pub fn all_there() {
    for tool in TOOLS {
        let started = Command::new(tool).arg("--help").output();
        if let Err(error) = started {
            panic!("`{tool}` does not start ({error}): install it, or leave out --judge");
        }
    }
}

/// What the tool says of a file that it refuses.
fn refusal(command: &mut Command) -> Option<String> {
    let output = command.output().unwrap_or_else(|e| panic!("{e}"));
    if output.status.success() {
        return None;
    }
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said).into_owned();
    let is_telling = |l: &&str| l.to_lowercase().contains("error");
    let first = said.lines().filter(is_telling).take(2).collect::<Vec<_>>();
    match first.is_empty() {
        true => Some(said.trim().chars().take(300).collect()),
        false => Some(first.join(" / ")),
    }
}

fn glslang(path: &Path, include: &[PathBuf]) -> Command {
    let mut command = Command::new("glslangValidator");
    for folder in include {
        command.arg(format!("-I{}", folder.display()));
    }
    command.arg(path);
    command
}

/// Vulkan's versions, the oldest first: what reflection is compared by has the fewest words.
const VULKAN: [&str; 2] = ["vulkan1.1", "vulkan1.3"];

fn compiled(path: &Path, version: &str, out: &Path, include: &[PathBuf]) -> Option<String> {
    let mut command = glslang(path, include);
    command.args(["-V", "--target-env", version, "-o"]).arg(out);
    refusal(&mut command)
}

/// What a judge of its language says of a written file.
pub fn of_written(path: &Path, target: Target) -> Option<String> {
    match target {
        Target::Wgsl => refusal(Command::new("tint").args(["--format", "wgsl"]).arg(path)),
        Target::Spirv => {
            let mut command = Command::new("spirv-val");
            refusal(command.args(["--target-env", "vulkan1.1"]).arg(path))
        }
        Target::GlslVulkan => compiled(path, VULKAN[0], &path.with_extension("judged"), &[]),
        _ => refusal(&mut glslang(path, &[])),
    }
}

/// An author's stage.
#[derive(Debug, Default)]
pub struct Author {
    pub is_legal: bool,
    /// Its SPIR-V for Vulkan, if it is that.
    pub spirv: Option<PathBuf>,
}

/// Judges an author's file: by Vulkan's rules, or else by OpenGL's.
pub fn author(path: &Path, dir: &Path, include: &[PathBuf]) -> Author {
    let extension = path.extension().and_then(|e| e.to_str());
    let legal = |refused: Option<String>| Author {
        is_legal: refused.is_none(),
        spirv: None,
    };
    match extension {
        Some("wgsl") => return legal(of_written(path, Target::Wgsl)),
        Some("spv") => {
            let copy = dir.join(format!("{}.author.spv", file_name(path)));
            let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            std::fs::write(&copy, without_language(bytes)).unwrap();
            let mut command = Command::new("spirv-val");
            let refused = refusal(command.args(["--target-env", "vulkan1.3"]).arg(&copy));
            return Author {
                is_legal: refused.is_none(),
                spirv: Some(copy),
            };
        }
        Some("vs" | "fs") => {
            let stage = if extension == Some("vs") {
                "vert"
            } else {
                "frag"
            };
            return legal(refusal(glslang(path, include).args(["-S", stage])));
        }
        _ => {}
    }
    let out = dir.join(format!("{}.author.spv", file_name(path)));
    let (path, include) = &with_includes(path, dir, include);
    for version in VULKAN {
        if compiled(path, version, &out, include).is_none() {
            return Author {
                is_legal: true,
                spirv: Some(out),
            };
        }
    }
    legal(refusal(&mut glslang(path, include)))
}

/// A module that does not say which language it was made of: older tools do not know Slang.
fn without_language(mut bytes: Vec<u8>) -> Vec<u8> {
    const OP_SOURCE: u16 = 3;
    let mut at = 20;
    while let Some([a, b, c, d]) = bytes.get(at..at + 4) {
        let (op, length) = (u16::from_le_bytes([*a, *b]), u16::from_le_bytes([*c, *d]));
        if let Some(language) = bytes.get_mut(at + 4..at + 8).filter(|_| op == OP_SOURCE) {
            language.fill(0);
        }
        at += 4 * usize::from(length.max(1));
    }
    bytes
}

/// The file, and the folders it includes from. Engines include files themselves, so their texts do
/// not ask for the extension: a copy does.
fn with_includes(path: &Path, dir: &Path, include: &[PathBuf]) -> (PathBuf, Vec<PathBuf>) {
    let mut include = include.to_vec();
    let text = std::fs::read(path).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let extension = "GL_GOOGLE_include_directive";
    if !text.contains("#include") || text.contains(extension) {
        return (path.to_owned(), include);
    }
    let (before, after) = match text.split_once("#version") {
        None => ("", &*text),
        Some((before, _)) => {
            let rest = &text[before.len()..];
            let end = rest.find('\n').map_or(rest.len(), |n| n + 1);
            text.split_at(before.len() + end)
        }
    };
    let copy = dir.join(file_name(path));
    let whole = format!("{before}#extension {extension} : enable\n{after}");
    std::fs::write(&copy, whole).unwrap();
    include.extend(path.parent().map(Path::to_owned));
    (copy, include)
}

/// The interface of a stage in SPIR-V. A block's name is none of it where `is_named` is false: GLSL
/// has no dots in names, and both stages share them.
pub fn interface(spirv: &Path, is_vertex: bool, is_named: bool) -> Result<Interface, String> {
    let reflected = reflection_support::reflect(spirv)?;
    let lines = reflection_support::interface(&reflected, is_vertex);
    let lines = lines.into_iter().map(|l| match is_named {
        true => l,
        // GLSL out declares the transpose of a row-major matrix, which is the same memory.
        false => nameless(&l.replace(" by rows", "")),
    });
    Ok(combined(lines.collect()))
}

/// The line of a block without the block's name.
fn nameless(line: &str) -> String {
    let Some((head, members)) = line.split_once(" { ") else {
        return line.to_owned();
    };
    let head = head.rsplit_once(' ').map_or(head, |(rest, _)| rest);
    format!("{head} {{ {members}")
}

/// A texture and a sampler of one binding, as HLSL has them, are Vulkan's combined image sampler.
fn combined(mut lines: Interface) -> Interface {
    let textures: Vec<String> = lines
        .iter()
        .filter(|l| l.contains(": separate_images "))
        .cloned()
        .collect();
    for texture in textures {
        let Some((place, rest)) = texture.split_once(": separate_images ") else {
            continue;
        };
        let lengths = rest.split_once(' ').map_or("", |(_, lengths)| lengths);
        let sampler = format!("{place}: separate_samplers \"sampler\" {lengths}");
        if lines.remove(&sampler) {
            lines.remove(&texture);
            let rest = rest.replacen("texture", "sampler", 1);
            lines.insert(format!("{place}: textures {rest}"));
        }
    }
    lines
}

/// The words without what no function reads: spirv-opt drops it.
fn used(spirv: &Path) -> Result<PathBuf, String> {
    let out = spirv.with_extension("used.spv");
    let mut command = Command::new("spirv-opt");
    let passes = [
        "--eliminate-dead-functions",
        "--remove-unused-interface-variables",
        "--eliminate-dead-variables",
        "--eliminate-dead-const",
    ];
    command.args(passes);
    match refusal(command.arg(spirv).arg("-o").arg(&out)) {
        Some(said) => Err(said),
        None => Ok(out),
    }
}

/// The interface without what no function reads.
pub fn used_interface(spirv: &Path, is_vertex: bool, is_named: bool) -> Result<Interface, String> {
    interface(&used(spirv)?, is_vertex, is_named)
}

/// Whether the fragment stage reads what the vertex stage does not write: then another stage is
/// between them.
pub fn are_apart(vertex: &Path, fragment: &Path) -> bool {
    let reflect = |path: &Path| reflection_support::reflect(path).ok();
    let fragment = used(fragment).ok().and_then(|path| reflect(&path));
    let both = reflect(vertex).zip(fragment);
    both.is_some_and(|(v, f)| reflection_support::unwritten(&v, &f).is_some())
}

/// The SPIR-V of a written stage: itself, or what glslang makes of it.
pub fn words(path: &Path) -> Result<PathBuf, String> {
    if path.extension().is_some_and(|e| e == "spv") {
        return Ok(path.to_owned());
    }
    let out = path.with_extension("ours.spv");
    match compiled(path, VULKAN[0], &out, &[]) {
        Some(said) => Err(said),
        None => Ok(out),
    }
}
