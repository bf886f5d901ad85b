//! The interface that a host sees in SPIR-V, as `spirv-cross` reflects it.
#![allow(dead_code)]

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// The interface of a stage: a line for each resource, constant, input and push constant.
pub type Interface = BTreeSet<String>;

/// What `spirv-cross` reflects of a file of SPIR-V.
///
/// # Errors
/// `spirv-cross` does not start, or refuses the file.
pub fn reflect(spirv: &Path) -> Result<Value, String> {
    let mut command = Command::new("spirv-cross");
    let output = command.arg(spirv).arg("--reflect").output();
    let output = output.map_err(|e| format!("spirv-cross does not start: {e}"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        return Err(format!("{}: {said}", spirv.display()));
    }
    serde_json::from_slice(&output.stdout).map_err(|e| e.to_string())
}

fn list<'a>(of: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> {
    of[key].as_array().into_iter().flatten()
}

fn number(of: &Value) -> u64 {
    of.as_u64().unwrap_or_default()
}

fn text(of: &Value) -> &str {
    of.as_str().unwrap_or_default()
}

/// The lengths of an array; of one by a specialisation constant, the constant's default.
fn lengths(reflected: &Value, of: &Value) -> Vec<u64> {
    let mut literal = list(of, "array_size_is_literal");
    let constant = |id: u64| {
        let mut all = list(reflected, "specialization_constants");
        let found = all.find(|c| c["variable_id"].as_u64() == Some(id));
        found.map_or(id, |c| number(&c["default_value"]))
    };
    list(of, "array")
        .map(number)
        .map(|n| match literal.next().and_then(Value::as_bool) {
            Some(false) => constant(n),
            _ => n,
        })
        .collect()
}

/// Bytes of a member, with the gaps between its elements and columns.
fn size(reflected: &Value, member: &Value) -> u64 {
    let length: u64 = lengths(reflected, member).iter().product();
    if let Some(stride) = member["array_stride"].as_u64() {
        return stride * length;
    }
    let name = text(&member["type"]);
    if let Some(stride) = member["matrix_stride"].as_u64() {
        let size = name.rsplit("mat").next().unwrap_or_default();
        let mut sizes = size.split('x').filter_map(|n| n.parse::<u64>().ok());
        let columns = sizes.next().unwrap_or_default();
        let rows = sizes.next().unwrap_or(columns);
        let is_row_major = member["row_major"].as_bool() == Some(true);
        return stride * if is_row_major { rows } else { columns };
    }
    match name
        .strip_prefix(['i', 'u', 'b'])
        .unwrap_or(name)
        .strip_prefix("vec")
    {
        Some(n) => 4 * n.parse::<u64>().unwrap_or_default(),
        None if name.starts_with('_') => {
            let members = list(&reflected["types"][name], "members");
            let ends = members.map(|m| number(&m["offset"]) + size(reflected, m));
            ends.max().unwrap_or_default()
        }
        None => 4,
    }
}

/// The members of a block in memory's order: name, first byte and size. A matrix may be stored the other way round
/// and a scalar with the rest of its stride: that is the same memory.
fn members(reflected: &Value, ty: &Value) -> String {
    let ty = &reflected["types"][text(ty)];
    let of = |m: &Value| {
        let (name, offset) = (text(&m["name"]), &m["offset"]);
        let rows = match m["row_major"].as_bool() {
            Some(true) => " by rows",
            _ => "",
        };
        format!("{name} at {offset} of {}{rows}", size(reflected, m))
    };
    // GLSL has no other way to leave bytes out in a struct.
    let is_padding = |m: &&Value| text(&m["name"]).contains("padding_");
    let mut members: Vec<&Value> = list(ty, "members").filter(|m| !is_padding(m)).collect();
    members.sort_by_key(|m| number(&m["offset"]));
    let all: Vec<String> = members.into_iter().map(of).collect();
    format!("{} {{ {} }}", text(&ty["name"]), all.join(", "))
}

/// The number of a type's columns, and the type of one.
fn columns(ty: &str) -> [String; 2] {
    let Some((kind, size)) = ty.split_once("mat") else {
        return ["1".to_owned(), ty.to_owned()];
    };
    let (columns, rows) = size.split_once('x').unwrap_or((size, size));
    [columns.to_owned(), format!("{kind}vec{rows}")]
}

/// The interface of a stage: descriptors, push constants and specialisation constants, and the
/// attributes of a vertex stage.
pub fn interface(reflected: &Value, is_vertex: bool) -> Interface {
    let mut lines = Interface::new();
    for kind in ["textures", "separate_images", "separate_samplers", "images"] {
        for r in list(reflected, kind) {
            let (set, binding) = (&r["set"], &r["binding"]);
            let lengths = lengths(reflected, r);
            lines.insert(format!(
                "set {set} binding {binding}: {kind} {} {lengths:?}",
                r["type"]
            ));
        }
    }
    for kind in ["ubos", "ssbos"] {
        for r in list(reflected, kind) {
            let block = members(reflected, &r["type"]);
            let lengths = lengths(reflected, r);
            lines.insert(format!(
                "set {} binding {}: {kind} {lengths:?} {block}",
                r["set"], r["binding"]
            ));
        }
    }
    for r in list(reflected, "push_constants") {
        lines.insert(format!("push constants {}", members(reflected, &r["type"])));
    }
    for c in list(reflected, "specialization_constants") {
        let (id, ty, default) = (&c["id"], &c["type"], &c["default_value"]);
        lines.insert(format!("constant {id} {}: {ty} = {default}", c["name"]));
    }
    for input in list(reflected, "inputs").filter(|_| is_vertex) {
        let length: u64 = lengths(reflected, input).iter().product();
        let [columns, ty] = columns(text(&input["type"]));
        // A matrix and an array take a location for each column.
        for i in 0..length * columns.parse::<u64>().unwrap_or(1) {
            lines.insert(format!("input {}: {ty}", number(&input["location"]) + i));
        }
    }
    lines
}

/// The first location of the fragment stage's inputs that no output of the vertex stage has.
pub fn unwritten(vertex: &Value, fragment: &Value) -> Option<u64> {
    let start = |of: &Value| number(&of["location"]);
    // A block or an array takes more locations than one.
    let has = |of: &Value, at: u64| {
        let is_large = of.get("array").is_some()
            || text(&of["type"]).starts_with('_')
            || text(&of["type"]).contains("mat");
        start(of) == at || is_large && start(of) < at
    };
    let mut inputs = list(fragment, "inputs").map(start);
    inputs.find(|at| !list(vertex, "outputs").any(|of| has(of, *at)))
}
