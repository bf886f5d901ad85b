//! Reads a frame folder. Opens only `frame.json` and the files in `data` that are named by a hash.

use std::cell::{OnceCell, RefCell};
use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::Error;
use super::file::{CaptureFile, Command, DataName, DrawCommand, Resource, SCHEMA};
use super::ranges;
use shader_text::limits::Limits;
use shader_text::read_limited;

/// The file that makes a folder a frame folder.
pub(crate) const FILE: &str = "frame.json";

pub(super) const PACKED: &str = "frame.json.gz";

/// Memory for data files that were read. Buffers and shaders are read repeatedly, textures once.
const KEPT_BYTES: usize = 256 << 20;

/// Whether a path is a frame folder.
pub fn is_folder(path: &Path) -> bool {
    file_of(path).is_file()
}

/// Path of the folder's `frame.json` or `frame.json.gz`. If both exist, the uncompressed one
/// counts.
pub fn file_of(folder: &Path) -> PathBuf {
    let (plain, packed) = (folder.join(FILE), folder.join(PACKED));
    match !plain.is_file() && packed.is_file() {
        true => packed,
        false => plain,
    }
}

/// Whether a path ends in `frame.json` or `frame.json.gz`.
pub fn is_file(path: &Path) -> bool {
    path.file_name().is_some_and(|n| n == FILE || n == PACKED)
}

/// An open frame folder. Reads data files on demand.
#[derive(Debug)]
pub struct Capture {
    folder: PathBuf,
    limits: Limits,
    /// BLAKE3 of the text of `frame.json`, in hexadecimal.
    hash: String,
    /// Content of `frame.json`.
    pub file: CaptureFile,
    /// Data files that were read. The contents stay in memory up to [`KEPT_BYTES`].
    data: RefCell<BTreeMap<DataName, Option<Arc<[u8]>>>>,
    has_whole_depth_range: OnceCell<bool>,
}

impl Capture {
    /// Opens a frame folder.
    ///
    /// # Errors
    /// `frame.json` is missing, has another version, is no JSON of this form, or exceeds a limit.
    pub fn open(folder: &Path, limits: &Limits) -> Result<Self, Error> {
        let path = file_of(folder);
        let text = match path.ends_with(PACKED) {
            true => unpacked(&path, limits, "file-bytes").and_then(read_limited::decode),
            false => read_limited::text(&path, limits, "file-bytes"),
        };
        let text = text.map_err(|error| Error::Read {
            file: path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            error,
        })?;
        let file = read(&text)?;
        check(&file, limits)?;
        Ok(Self {
            folder: folder.to_owned(),
            limits: *limits,
            hash: blake3::hash(text.as_bytes()).to_hex().to_string(),
            file,
            data: RefCell::default(),
            has_whole_depth_range: OnceCell::new(),
        })
    }

    /// The folder's name, for messages and material names.
    pub fn name(&self) -> String {
        let whole = self.folder.canonicalize();
        let folder = whole.as_deref().unwrap_or(&self.folder);
        let name = folder.file_name().map(|n| n.to_string_lossy().into_owned());
        name.unwrap_or_else(|| "frame".to_owned())
    }

    /// Path of the folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// BLAKE3 of the text of `frame.json`, in hexadecimal.
    pub fn hash(&self) -> &str {
        &self.hash
    }

    /// BLAKE3 of each data file that was read so far, in hexadecimal.
    ///
    /// # Errors
    /// As [`Self::data`].
    pub fn hashed(&self) -> Result<BTreeMap<DataName, String>, Error> {
        let names: Vec<DataName> = self.data.borrow().keys().cloned().collect();
        let hash = |name: DataName| {
            let hash = blake3::hash(&self.data(&name)?).to_hex().to_string();
            Ok((name, hash))
        };
        names.into_iter().map(hash).collect()
    }

    /// The limits that were given to [`Self::open`].
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Paths of `frame.json` and of the data files that were read so far.
    pub fn files(&self) -> Vec<PathBuf> {
        let data = self.data.borrow();
        let data = data.keys().map(|name| self.path(name));
        std::iter::once(file_of(&self.folder)).chain(data).collect()
    }

    fn path(&self, name: &DataName) -> PathBuf {
        self.folder.join("data").join(name.file())
    }

    /// The content of a file in `data`. Caches up to 256 MiB.
    ///
    /// # Errors
    /// The file is missing or too large.
    pub fn data(&self, name: &DataName) -> Result<Arc<[u8]>, Error> {
        if let Some(Some(known)) = self.data.borrow().get(name) {
            return Ok(Arc::clone(known));
        }
        let bytes = read_limited::bytes(&self.path(name), &self.limits, "file-bytes");
        let bytes: Arc<[u8]> = bytes
            .map_err(|error| Error::Read {
                file: format!("data/{}", name.file()),
                error,
            })?
            .into();
        let mut data = self.data.borrow_mut();
        let kept: usize = data.values().flatten().map(|b| b.len()).sum();
        let is_kept = kept + bytes.len() <= KEPT_BYTES;
        data.insert(name.clone(), is_kept.then(|| Arc::clone(&bytes)));
        Ok(bytes)
    }

    /// Whether the depth range of every draw is 0 to 1.
    pub fn has_whole_depth_range(&self) -> bool {
        *self.has_whole_depth_range.get_or_init(|| {
            let commands = self.file.frames.iter().flat_map(|f| &f.commands);
            let mut commands = commands.flat_map(|command| match command {
                Command::RenderPass { commands, .. } => commands.as_slice(),
                _ => &[],
            });
            commands.all(|command| match command {
                DrawCommand::SetViewport {
                    min_depth,
                    max_depth,
                    ..
                } => [*min_depth, *max_depth] == [0.0, 1.0],
                _ => true,
            })
        })
    }

    /// The text of a shader.
    ///
    /// # Errors
    /// As [`Self::data`], or it is no text.
    pub fn text(&self, shader: usize) -> Result<String, Error> {
        let of = get(&self.file.shaders, shader, "shader", "a pipeline")?;
        let bytes = self.data(&of.data)?;
        read_limited::decode(bytes.to_vec()).map_err(|error| Error::Read {
            file: format!("data/{}", of.data.file()),
            error,
        })
    }
}

/// The entry `index` of one of the file's lists. The error names `what` and `place`.
pub fn get<'a, T>(list: &'a [T], index: usize, what: &str, place: &str) -> Result<&'a T, Error> {
    list.get(index).ok_or_else(|| {
        Error::broken(
            place,
            match list.len() {
                0 => format!("there is no {what} {index}: it has none"),
                n => format!("there is no {what} {index}: the last is {}", n - 1),
            },
        )
    })
}

/// Only the version: it is checked before keys that another version may lack.
#[derive(serde::Deserialize)]
struct Version {
    schema: Option<String>,
}

fn read(text: &str) -> Result<CaptureFile, Error> {
    let wrong = |e: serde_json::Error| Error::File(e.to_string());
    let version: Version = serde_json::from_str(text).map_err(wrong)?;
    match version.schema.as_deref() {
        Some(SCHEMA) => serde_json::from_str(text).map_err(wrong),
        Some(other) => Err(Error::File(format!(
            "its schema is `{other}`, and this version reads `{SCHEMA}`"
        ))),
        None => Err(Error::File("it has no `schema`".to_owned())),
    }
}

/// Checks sizes before anything is allocated for them.
pub(super) fn check(file: &CaptureFile, limits: &Limits) -> Result<(), Error> {
    if file.frames.is_empty() {
        return Err(Error::File("it has no frame".to_owned()));
    }
    limits.check("frames", file.frames.len() as u64, "the number of frames")?;
    let mut bytes: u64 = 0;
    for buffer in &file.buffers {
        bytes = bytes.saturating_add(buffer.size);
    }
    for (index, texture) in file.textures.iter().enumerate() {
        let [width, height, layers] = texture.size.0;
        let side = u64::from(width.max(height).max(layers));
        limits.check("texture-size", side, format_args!("texture {index}"))?;
        if texture.mip_level_count == 0 || u64::from(texture.mip_level_count) > levels(side) {
            let why = format!(
                "it has {} mip levels, and its size allows {}",
                texture.mip_level_count,
                levels(side)
            );
            return Err(Error::broken(format!("texture {index}"), why));
        }
        let block = u64::from(texture.format.block_copy_size(None).unwrap_or(8));
        let (across, down) = texture.format.block_dimensions();
        let texels = u64::from(width.div_ceil(across))
            .saturating_mul(u64::from(height.div_ceil(down)))
            .saturating_mul(u64::from(layers))
            .saturating_mul(u64::from(texture.sample_count));
        bytes = bytes.saturating_add(texels.saturating_mul(block));
    }
    limits.check("scene-bytes", bytes, "the bytes of buffers and textures")?;
    ranges::check(file)?;
    for start in &file.start.textures {
        level(file, start.texture, start.mip_level, "its start")?;
    }
    for group in &file.bind_groups {
        for entry in &group.entries {
            if let Resource::Texture(view) = &entry.resource {
                level(file, view.texture, view.view.base_mip_level, "a bind group")?;
            }
        }
    }
    let named = file.named.iter().flat_map(|n| n.textures.values());
    for texture in named.flat_map(|t| t.all()) {
        let view = &texture.texture;
        level(file, view.texture, view.view.base_mip_level, "a draw")?;
    }
    for command in (file.setup.iter()).chain(file.frames.iter().flat_map(|f| &f.commands)) {
        let Command::RenderPass { descriptor, .. } = command else {
            continue;
        };
        let colors = descriptor.color_attachments.iter().flatten();
        let colors = colors.flat_map(|c| std::iter::once(&c.view).chain(&c.resolve_target));
        let depth = descriptor.depth_stencil_attachment.iter();
        for view in colors.chain(depth.map(|d| &d.view)) {
            level(file, view.texture, view.view.base_mip_level, "a pass")?;
        }
    }
    Ok(())
}

/// The most mip levels of a texture whose longest side has `side` texels.
fn levels(side: u64) -> u64 {
    u64::from(side.max(1).ilog2()) + 1
}

/// Refuses a mip level that the texture lacks. A missing texture is an error where it is used.
fn level(file: &CaptureFile, texture: usize, level: u32, what: &str) -> Result<(), Error> {
    match file.textures.get(texture) {
        Some(of) if level >= of.mip_level_count => Err(Error::broken(
            format!("texture {texture}"),
            format!(
                "{what} names mip level {level}, and it has {}",
                of.mip_level_count
            ),
        )),
        _ => Ok(()),
    }
}

/// Reads a file that gzip compressed. The limit holds for both sizes.
///
/// # Errors
/// [`ReadError`].
pub(super) fn unpacked(
    path: &Path,
    limits: &Limits,
    limit: &'static str,
) -> Result<Vec<u8>, read_limited::ReadError> {
    let packed = read_limited::bytes(path, limits, limit)?;
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(packed.as_slice())
        .take(limits.of(limit).saturating_add(1))
        .read_to_end(&mut bytes)?;
    let what = format_args!("the bytes in {}", path.display());
    limits.check(limit, bytes.len() as u64, what)?;
    Ok(bytes)
}
