//! The plugin's derivation over Bevy's own shader modules, without Bevy: its packages are unpacked, and
//! not built.
#![cfg(all(feature = "naga-oil", feature = "wesl"))]

// Both are the plugin's.
#[allow(dead_code)]
#[path = "../../hosts/bevy/src/derive.rs"]
mod derive;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use derive::{Composed, Wanted, derive};
use naga::ShaderStage;
use naga::compact::{KeepUnused, compact};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga_edit::interface;

use crate::dialects::{bevys_definitions, wgsl};

/// The folders of the packages that the plugin depends on, as its lock file names them.
pub fn packages() -> Vec<PathBuf> {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("hosts/bevy/Cargo.toml");
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--locked",
            "--format-version",
            "1",
            "--manifest-path",
        ])
        .arg(manifest)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let all: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let manifests = all["packages"].as_array().unwrap().iter();
    let manifests = manifests.filter_map(|p| p["manifest_path"].as_str());
    let folders = manifests.filter_map(|m| Path::new(m).parent());
    let is_bevys = |folder: &&Path| {
        let name = folder.file_name().and_then(|n| n.to_str());
        name.is_some_and(|n| n.starts_with("bevy_"))
    };
    folders.filter(is_bevys).map(Path::to_owned).collect()
}

/// One stage of a module as text.
fn stage(module: &naga::Module, of: ShaderStage, path: &Path) -> Composed {
    let mut module = module.clone();
    module.entry_points.retain(|e| e.stage == of);
    compact(&mut module, KeepUnused::No);
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
    let info = validator.validate(&module).unwrap();
    let flags = naga::back::wgsl::WriterFlags::empty();
    Composed {
        text: naga::back::wgsl::write_string(&module, &info, flags).unwrap(),
        entry: module.entry_points[0].name.clone(),
        path: path.display().to_string(),
    }
}

/// What a derived shader is and reads, in a few lines.
fn interface(vertex: &Composed, fragment: &Composed, wanted: Wanted) -> String {
    let derived = match derive(vertex, fragment, wanted) {
        Ok(derived) => derived,
        Err(refused) => return format!("  refused [{}] {}\n", refused.code, refused.reason),
    };
    let module = naga::front::wgsl::parse_str(&derived.text)
        .unwrap_or_else(|e| panic!("{}", e.emit_to_string(&derived.text)));
    let mut lines = format!("  {}", derived.vertex);
    if let Some(fragment) = &derived.fragment {
        let _ = write!(lines, ", {fragment}");
    }
    lines.push('\n');
    let fragment = module
        .entry_points
        .iter()
        .find(|e| e.stage == ShaderStage::Fragment);
    let outputs = fragment.map_or_else(Vec::new, |f| interface::outputs(&module, &f.function));
    for output in outputs {
        if let Some(naga::Binding::Location { location, .. }) = output.binding {
            let name = output.name.as_deref().unwrap_or("only");
            let _ = writeln!(lines, "  location {location}: {name}");
        }
    }
    let mut bindings: Vec<_> = module
        .global_variables
        .iter()
        .filter_map(|(_, v)| Some((v.binding?, v.name.clone()?)))
        .collect();
    bindings.sort_by_key(|(at, _)| (at.group, at.binding));
    for (at, name) in bindings {
        let _ = writeln!(lines, "  {}:{} {name}", at.group, at.binding);
    }
    lines
}

#[test]
fn prepasses_are_derived_over_bevys_modules() {
    let packages = packages();
    let is_pbr = |p: &&PathBuf| p.join("src/render/mesh.wgsl").is_file();
    let mesh = packages.iter().find(is_pbr).unwrap();
    let mesh = mesh.join("src/render/mesh.wgsl");
    let mut options = bevys_definitions();
    options.include = packages;
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("hosts/bevy/tests/shaders");
    let mut all = String::new();
    for (name, extra) in [
        ("grass", ""),
        ("fence", ""),
        ("jelly", ""),
        ("skin", "SKINNED"),
        ("morph", "MORPH_TARGETS"),
        ("sign", ""),
        ("bubble", ""),
        ("leaf", ""),
        ("lit", ""),
    ] {
        let own = folder.join(format!("{name}.wgsl"));
        let text = std::fs::read_to_string(&own).unwrap();
        let files = match text.contains("@vertex") {
            true => vec![own.clone()],
            false => vec![mesh.clone(), own.clone()],
        };
        let mut options = options.clone();
        if !extra.is_empty() {
            options.defines.push((extra.to_owned(), "true".to_owned()));
        }
        let text = wgsl(&files, &options)
            .unwrap_or_else(|e| panic!("{}", e.render(shader_text::error::Color::Never)));
        let module = naga::front::wgsl::parse_str(&text).unwrap();
        let vertex = stage(&module, ShaderStage::Vertex, &files[0]);
        let fragment = stage(&module, ShaderStage::Fragment, &own);
        let depth = Wanted {
            alpha_covers: name == "leaf",
            ..Wanted::default()
        };
        let everything = Wanted {
            normal: true,
            motion: true,
            previous_skin: extra == "SKINNED",
            previous_morph: extra == "MORPH_TARGETS",
            ..depth
        };
        let _ = writeln!(all, "{name}: depth");
        all += &interface(&vertex, &fragment, depth);
        let motion = Wanted {
            normal: false,
            ..everything
        };
        let _ = writeln!(all, "{name}: depth and motion");
        all += &interface(&vertex, &fragment, motion);
        let _ = writeln!(all, "{name}: depth, normals and motion");
        all += &interface(&vertex, &fragment, everything);
    }
    insta::assert_snapshot!(all);
}
