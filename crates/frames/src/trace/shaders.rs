//! Shaders of a trace. WGSL and SPIR-V stay as they are; naga IR is written back as WGSL.

use naga::valid::{Capabilities, ValidationFlags, Validator};
use wgpu_core::device::trace::{Data, DataKind};

use super::version::{self, Version};
use super::{OrRefusal, paths, refusal};
use crate::file::ShaderLanguage;

const WHAT: &str = "a shader";

/// The language of a shader's data. wgpu's own function panics on an unknown name.
pub(super) fn kind(data: &Data) -> Option<DataKind> {
    let name = match data {
        Data::File(name) => name,
        Data::String(kind, _) | Data::Binary(kind, _) => return Some(*kind),
    };
    let (_, ending) = name.rsplit_once('.')?;
    let known = [DataKind::Wgsl, DataKind::Ron, DataKind::Spv, DataKind::Glsl];
    known.into_iter().find(|kind| kind.to_string() == ending)
}

/// The language and bytes that a frame folder stores for a shader.
pub(super) fn read(
    bytes: &[u8],
    kind: DataKind,
    version: Version,
) -> OrRefusal<(ShaderLanguage, Vec<u8>)> {
    let text = || std::str::from_utf8(bytes).map_err(|_| refusal(WHAT, "it is not UTF-8 text"));
    match kind {
        DataKind::Wgsl => {
            let text = paths::in_comments(text()?).into_owned();
            Ok((ShaderLanguage::Wgsl, text.into_bytes()))
        }
        DataKind::Spv => Ok((ShaderLanguage::SpirV, bytes.to_vec())),
        DataKind::Ron => {
            let text = match version {
                Version::V29 => version::as_30(text()?),
                Version::V30 => text()?.to_owned(),
            };
            let written = wgsl(&text).map_err(|why| refusal("a shader in naga's IR", &why))?;
            Ok((ShaderLanguage::Wgsl, written.into_bytes()))
        }
        other => Err(refusal(WHAT, &format!("it is in the language `{other}`"))),
    }
}

/// WGSL for a naga module in RON.
fn wgsl(text: &str) -> Result<String, String> {
    let module: naga::Module = ron::from_str(text).map_err(|e| e.to_string())?;
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
    let info = validator.validate(&module).map_err(|e| e.to_string())?;
    let flags = naga::back::wgsl::WriterFlags::empty();
    naga::back::wgsl::write_string(&module, &info, flags).map_err(|e| e.to_string())
}
