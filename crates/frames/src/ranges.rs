//! Checks the parts of buffers that commands and bind groups name.

use super::error::Error;
use super::file::{CaptureFile, Command, ComputeCommand, DrawCommand, Resource};

/// Bytes of the arguments of a draw, an indexed draw and a dispatch.
const ARGUMENTS: [u64; 3] = [16, 20, 12];

/// Refuses a part beyond its buffer's end. A missing buffer is an error where it is used. WebGL's
/// vertex and index buffers are not checked: a draw reads the part that exists.
pub(super) fn check(file: &CaptureFile) -> Result<(), Error> {
    let part = |place: &str, what: String, buffer: usize, offset: u64, size: Option<u64>| {
        let Some(of) = file.buffers.get(buffer) else {
            return Ok(());
        };
        // Buffers are created with a whole number of words.
        let has = of.size.next_multiple_of(4);
        let end = offset.checked_add(size.unwrap_or(0));
        match end.is_some_and(|end| end <= has) {
            true => Ok(()),
            false => {
                let bytes = match size {
                    Some(size) => format!("bytes {offset} to {}", offset.saturating_add(size)),
                    None => format!("byte {offset} and on"),
                };
                let why = format!("{what}: {bytes} of buffer {buffer}, which has {}", of.size);
                Err(Error::broken(place, why))
            }
        }
    };
    for (index, group) in file.bind_groups.iter().enumerate() {
        for entry in &group.entries {
            if let Resource::Buffer(range) = &entry.resource {
                let place = format!("bind group {index}");
                let what = format!("binding {}", entry.binding);
                part(&place, what, range.buffer, range.offset, range.size)?;
            }
        }
    }
    let setup = file.setup.iter().enumerate();
    let setup = setup.map(|(index, command)| (format!("setup, command {index}"), command));
    let frames = file.frames.iter().enumerate().flat_map(|(frame, of)| {
        let commands = of.commands.iter().enumerate();
        commands.map(move |(index, command)| (format!("frame {frame}, command {index}"), command))
    });
    for (place, command) in setup.chain(frames) {
        match command {
            Command::CopyBufferToBuffer {
                source,
                source_offset,
                destination,
                destination_offset,
                size,
            } => {
                part(
                    &place,
                    "the source".to_owned(),
                    *source,
                    *source_offset,
                    *size,
                )?;
                let what = "the destination".to_owned();
                part(&place, what, *destination, *destination_offset, *size)?;
            }
            Command::ClearBuffer {
                buffer,
                offset,
                size,
            } => part(&place, "the clear".to_owned(), *buffer, *offset, *size)?,
            Command::RenderPass { commands, .. } if !file.source.api.is_webgl() => {
                for command in commands {
                    let (what, buffer, offset, size) = match command {
                        DrawCommand::SetVertexBuffer {
                            slot,
                            buffer: Some(buffer),
                            offset,
                            size,
                        } => (format!("vertex buffer {slot}"), *buffer, *offset, *size),
                        DrawCommand::SetIndexBuffer {
                            buffer,
                            offset,
                            size,
                            ..
                        } => ("the index buffer".to_owned(), *buffer, *offset, *size),
                        DrawCommand::DrawIndirect { buffer, offset } => (
                            "a draw's arguments".to_owned(),
                            *buffer,
                            *offset,
                            Some(ARGUMENTS[0]),
                        ),
                        DrawCommand::DrawIndexedIndirect { buffer, offset } => (
                            "a draw's arguments".to_owned(),
                            *buffer,
                            *offset,
                            Some(ARGUMENTS[1]),
                        ),
                        _ => continue,
                    };
                    part(&place, what, buffer, offset, size)?;
                }
            }
            Command::ComputePass { commands, .. } => {
                for command in commands {
                    if let ComputeCommand::DispatchWorkgroupsIndirect { buffer, offset } = command {
                        let what = "a dispatch's arguments".to_owned();
                        part(&place, what, *buffer, *offset, Some(ARGUMENTS[2]))?;
                    }
                }
            }
            _ => {}
        }
    }
    Ok(())
}
