//! The versions of wgpu whose traces are read. A trace names no version, but each version has its
//! own set of device limits.

use std::borrow::Cow;
use std::collections::BTreeSet;

use super::TraceError;

/// A version of wgpu whose traces are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Version {
    /// wgpu 29, which Bevy 0.19 uses.
    V29,
    /// wgpu 30.
    V30,
}

impl Version {
    /// The major version.
    pub fn number(self) -> u32 {
        match self {
            Self::V29 => 29,
            Self::V30 => 30,
        }
    }
}

/// Device limits that only wgpu 29 has.
const ONLY_29: [&str; 2] = [
    "maxTaskMeshWorkgroupTotalCount",
    "maxTaskMeshWorkgroupsPerDimension",
];

/// Device limits that only wgpu 30 has.
const ONLY_30: [&str; 8] = [
    "maxBindGroupsPlusVertexBuffers",
    "maxTaskWorkgroupTotalCount",
    "maxTaskWorkgroupsPerDimension",
    "maxMeshWorkgroupTotalCount",
    "maxMeshWorkgroupsPerDimension",
    "maxBuffersAndAccelerationStructuresPerShaderStage",
    "maxRayDispatchCount",
    "maxRayRecursionDepth",
];

/// The version that wrote a trace, inferred from its first action.
///
/// # Errors
/// The action is not `Init`, or its limits belong to another version.
pub(super) fn of(init: &str) -> Result<Version, TraceError> {
    let limits = init
        .strip_prefix("Init")
        .and_then(|rest| rest.split_once("required_limits:"))
        .and_then(|(_, rest)| rest.split_once('('))
        .and_then(|(_, rest)| rest.split_once(')'))
        .ok_or(TraceError::NoTrace(
            "it does not begin with the action `Init`",
        ))?
        .0;
    let fields = limits.split(',').filter_map(|f| f.split_once(':'));
    let found: BTreeSet<String> = fields.map(|(name, _)| name.trim().to_owned()).collect();
    let own = serde_json::to_value(wgpu::Limits::default()).unwrap_or_default();
    let own = own.as_object().into_iter().flatten();
    let own: BTreeSet<String> = own.map(|(name, _)| name.clone()).collect();
    if found == own {
        return Ok(Version::V30);
    }
    let mut older: BTreeSet<String> = own.clone();
    older.retain(|name| !ONLY_30.contains(&name.as_str()));
    older.extend(ONLY_29.map(str::to_owned));
    if found == older {
        return Ok(Version::V29);
    }
    let strange = found
        .iter()
        .find(|n| !own.contains(*n) && !older.contains(*n));
    let missing = older.iter().find(|n| !found.contains(*n));
    Err(TraceError::Version(match (strange, missing) {
        (Some(name), _) => format!("its device has the limit `{name}`, which neither has"),
        (None, Some(name)) => format!("its device has no limit `{name}`, which both have"),
        (None, None) => "its device has limits of both".to_owned(),
    }))
}

/// Words of wgpu 29, and the words of wgpu 30 that replace them. Where 30 has one more field, it
/// precedes the named field.
const WORDS: [(&str, &str); 6] = [
    ("Dispatch", "DispatchWorkgroups"),
    ("DispatchIndirect", "DispatchWorkgroupsIndirect"),
    ("present_mode", "color_space: Auto, present_mode"),
    ("bounds_checks", "int_div_checks: true, bounds_checks"),
    ("num_workgroups", "entry_points: [], num_workgroups"),
    // A type of naga.
    ("ClipDistance", "ClipDistances"),
];

/// A texture flag that was renamed.
const FLAG: (&str, &str) = ("TRANSIENT", "TRANSIENT_ATTACHMENT");

/// Rewrites an action or a module of wgpu 29 in the form of wgpu 30. Fields that became optional
/// need no change: the reader takes a value for `Some`.
pub(super) fn as_30(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 64);
    let mut rest = text;
    let mut last_word = "";
    while let Some(first) = rest.chars().next() {
        let length = if first == '"' {
            string(rest)
        } else if is_word(first) {
            rest.find(|c| !is_word(c)).unwrap_or(rest.len())
        } else {
            first.len_utf8()
        };
        let (part, after) = rest.split_at(length);
        rest = after;
        if first == '"' && last_word == "usage" {
            let flags = part.trim_matches('"').split(" | ");
            let flags: Vec<&str> = flags
                .map(|f| if f == FLAG.0 { FLAG.1 } else { f })
                .collect();
            out.push_str(&format!("\"{}\"", flags.join(" | ")));
            continue;
        }
        if is_word(first) {
            last_word = part;
        }
        let word = WORDS.iter().find(|(old, _)| *old == part);
        out.push_str(word.map_or(part, |(_, new)| new));
    }
    out
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Length of a string in bytes, with its quotes.
fn string(text: &str) -> usize {
    let mut is_escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        match c {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            '"' => return at + 1,
            _ => {}
        }
    }
    text.len()
}

/// Unwraps the number of a pipeline, which is optional in wgpu 29. `None` for a pipeline that
/// failed.
pub(super) fn with_number(text: &str) -> Option<Cow<'_, str>> {
    let Some(start) = text.find("id: ") else {
        return Some(text.into());
    };
    let (before, number) = text.split_at(start + "id: ".len());
    if number.starts_with("None") {
        return None;
    }
    let Some((number, rest)) = number
        .strip_prefix("Some(")
        .and_then(|n| n.split_once("))"))
    else {
        return Some(text.into());
    };
    Some(format!("{before}{number}){rest}").into())
}

#[cfg(test)]
mod tests {
    use super::{FLAG, WORDS, as_30, with_number};

    #[test]
    fn each_word_of_29_becomes_that_of_30() {
        for (old, new) in WORDS {
            let text = format!("(\"{old}\", {old}(1), a_{old}: \"a \\\" {old}\")");
            let expected = format!("(\"{old}\", {new}(1), a_{old}: \"a \\\" {old}\")");
            assert_eq!(as_30(&text), expected);
        }
    }

    #[test]
    fn a_flag_of_29_becomes_that_of_30_where_it_is_a_usage() {
        let [old, new] = [FLAG.0, FLAG.1];
        let text = format!("(label: \"{old}\", usage: \"COPY_SRC | {old}\")");
        let expected = format!("(label: \"{old}\", usage: \"COPY_SRC | {new}\")");
        assert_eq!(as_30(&text), expected);
    }

    #[test]
    fn the_number_of_a_pipeline_is_no_option() {
        let whole = with_number("(\n    id: Some(PointerId(0x1f)),\n    desc: ())");
        assert_eq!(
            whole.as_deref(),
            Some("(\n    id: PointerId(0x1f),\n    desc: ())")
        );
        assert_eq!(with_number("(\n    id: None,\n    desc: ())"), None);
    }
}
