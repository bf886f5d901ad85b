//! The colour channels that a pass writes. Where a fragment leaves a channel unwritten, the colours
//! of earlier draws show through, so hidden surfaces are part of the picture.

use std::collections::BTreeMap;

use naga::{Binding, ShaderStage};

use crate::plan::GpuPass;
use crate::program::Program;
use naga_edit::interface;

/// A colour target of a frame.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Target {
    /// A target of the scene, by location.
    Scene(usize),
    /// An attachment of the plan, by name.
    Attachment(String),
}

/// Written channels by target. Bits: red 1, green 2, blue 4, alpha 8. Unwritten targets are absent.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Channels(BTreeMap<Target, u8>);

/// The channels that the write masks, the formats and the fragment stage's outputs of `pass` all
/// have.
pub fn written(program: &Program, pass: &GpuPass) -> Channels {
    let module = program.module();
    let outputs = pass
        .fragment
        .as_deref()
        .and_then(|name| program.entry_point(ShaderStage::Fragment, name))
        .map(|(_, entry)| interface::outputs(module, &entry.function))
        .unwrap_or_default();
    let is_output = |at: usize| {
        outputs.iter().any(
            |o| matches!(o.binding, Some(Binding::Location { location, .. }) if location as usize == at),
        )
    };
    let bound = pass.targets.iter().enumerate();
    Channels(
        bound
            .filter(|(at, _)| is_output(*at))
            .filter_map(|(at, target)| {
                let target = target.as_ref()?;
                let mask = target.write_mask & of_format(&target.format);
                let key = match &target.attachment {
                    Some(name) => Target::Attachment(name.clone()),
                    None => Target::Scene(at),
                };
                (mask != 0).then_some((key, mask))
            })
            .collect(),
    )
}

/// Whether `pass` has targets and writes every channel of each of them.
pub fn writes_all(program: &Program, pass: &GpuPass) -> bool {
    let written = written(program, pass);
    let masks = pass.targets.iter().flatten().map(|t| of_format(&t.format));
    !pass.targets.is_empty()
        && pass.targets.iter().all(Option::is_some)
        && masks.map(u32::from).map(u32::count_ones).sum::<u32>() == written.count()
}

/// Channels of a colour format, read off its name. An unknown name has all of them.
fn of_format(format: &str) -> u8 {
    let channels = format
        .chars()
        .take_while(|c| "rgba".contains(*c) || c.is_ascii_digit())
        .filter_map(|c| "rgba".find(c))
        .fold(0, |mask, i| mask | 1 << i);
    if channels == 0 { 0b1111 } else { channels }
}

impl Channels {
    fn count(&self) -> u32 {
        self.0.values().map(|mask| mask.count_ones()).sum()
    }

    /// The channels in `self` that `other` does not write.
    #[must_use]
    pub fn left_by(&self, other: &Self) -> Self {
        let left = self.0.iter().filter_map(|(target, mask)| {
            let left = mask & !other.0.get(target).copied().unwrap_or(0);
            (left != 0).then(|| (target.clone(), left))
        });
        Self(left.collect())
    }

    /// Whether no channel is written.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl std::fmt::Display for Channels {
    /// For messages: `red, green of target 0; alpha of attachment NAME`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names = ["red", "green", "blue", "alpha"];
        for (i, (target, mask)) in self.0.iter().enumerate() {
            let channels: Vec<&str> = names
                .iter()
                .enumerate()
                .filter_map(|(bit, name)| (mask >> bit & 1 == 1).then_some(*name))
                .collect();
            let separator = if i == 0 { "" } else { "; " };
            write!(f, "{separator}{} of ", channels.join(", "))?;
            match target {
                Target::Scene(location) => write!(f, "target {location}")?,
                Target::Attachment(name) => write!(f, "attachment `{name}`")?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::of_format;

    #[test]
    fn the_channels_of_a_format_are_those_of_its_name() {
        let table = [
            ("rgba8unorm-srgb", 0b1111),
            ("bgra8unorm", 0b1111),
            ("rgb10a2unorm", 0b1111),
            ("rg11b10ufloat", 0b0111),
            ("rg16float", 0b0011),
            ("r8unorm", 0b0001),
            ("r32uint", 0b0001),
        ];
        for (format, expected) in table {
            assert_eq!(of_format(format), expected, "{format}");
        }
    }
}
