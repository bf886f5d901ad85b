//! A glTF file with its buffers. Meshes and whole scenes are both read from it.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use base64::Engine as _;
use glam::Mat4;
use gltf::buffer::Source;

use preshade_draw::scene::SceneError;

/// Extensions that the loader supports.
const READ: [&str; 8] = [
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_basisu",
    "KHR_texture_transform",
];

/// Reads a file by the name that a scene gives it.
pub(crate) type Read<'a> = &'a dyn Fn(&str) -> Result<Vec<u8>, SceneError>;

/// Checks sizes before an allocation. Its arguments are the numbers of vertices and bytes.
pub(crate) type Take<'a> = &'a dyn Fn(u64, u64) -> Result<(), SceneError>;

/// A glTF 2.0 file and the content of its buffers.
pub(crate) struct Asset {
    /// The file's name in the scene.
    pub file: String,
    pub document: gltf::Document,
    /// Whether the file has animations. They are removed from `document`, because nothing reads
    /// them.
    is_animated: bool,
    pub buffers: Vec<Vec<u8>>,
}

/// The nodes of the default scene with their world transforms.
pub(crate) struct Nodes<'g> {
    /// In depth-first order.
    pub all: Vec<Below<'g>>,
    /// World transform by node index.
    pub world: BTreeMap<usize, Mat4>,
}

/// A node of the default scene.
pub(crate) struct Below<'g> {
    pub node: gltf::Node<'g>,
    /// Index in [`Nodes::all`] of the parent, which precedes this node.
    above: Option<usize>,
}

impl<'g> Nodes<'g> {
    /// The nodes with this name and their descendants. Without a name, all nodes.
    pub fn below(&self, name: Option<&str>) -> Vec<&Below<'g>> {
        let mut is_below = Vec::with_capacity(self.all.len());
        for node in &self.all {
            let above = node.above.is_some_and(|above| is_below[above]);
            is_below.push(above || name.is_none_or(|name| node.node.name() == Some(name)));
        }
        let all = self.all.iter().zip(is_below);
        all.filter_map(|(node, is_below)| is_below.then_some(node))
            .collect()
    }
}

/// The JSON of a text or binary file, whether it has animations, and the binary chunk.
///
/// The glTF crate requires members that glTF 2.0 leaves optional: a scene's nodes (section 5.26),
/// which Blender omits from an empty scene, and the node of an animation's target (section 5.4.2),
/// which KHR_animation_pointer omits.
///
/// # Errors
/// The reason as text.
fn parse(bytes: &[u8]) -> Result<(gltf::json::Root, bool, Option<Vec<u8>>), String> {
    let (text, blob) = match bytes.starts_with(b"glTF") {
        true => {
            let parts = gltf::binary::Glb::from_slice(bytes).map_err(|e| e.to_string())?;
            (parts.json, parts.bin.map(Cow::into_owned))
        }
        false => (Cow::Borrowed(bytes), None),
    };
    // RFC 8259 lets a parser ignore a byte order mark.
    let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&text);
    let mut json: serde_json::Value = serde_json::from_slice(text).map_err(|e| e.to_string())?;
    let scenes = json.get_mut("scenes").and_then(|s| s.as_array_mut());
    for scene in scenes.into_iter().flatten() {
        if let Some(scene) = scene.as_object_mut() {
            scene
                .entry("nodes")
                .or_insert_with(|| Vec::<u32>::new().into());
        }
    }
    let animations = json.as_object_mut().and_then(|j| j.remove("animations"));
    let is_animated = animations.is_some_and(|a| a.as_array().is_some_and(|a| !a.is_empty()));
    let root = serde_json::from_value(json).map_err(|e| e.to_string())?;
    Ok((root, is_animated, blob))
}

const DRACO: &str = "KHR_draco_mesh_compression";

/// Gives data to unread accessors that have none: glTF allows them, but the crate does not. Returns
/// whether all accessors that are read have data.
fn without_data(root: &mut gltf::json::Root) -> bool {
    let primitives = root.meshes.iter().flat_map(|m| &m.primitives);
    let mut read: BTreeSet<usize> = primitives
        .flat_map(|p| {
            let targets = p.targets.iter().flatten();
            let morphs =
                targets.flat_map(|t| [t.positions, t.normals, t.tangents].into_iter().flatten());
            p.attributes
                .values()
                .copied()
                .chain(p.indices)
                .chain(morphs)
        })
        .map(|index| index.value())
        .collect();
    read.extend(
        root.skins
            .iter()
            .filter_map(|s| s.inverse_bind_matrices)
            .map(|i| i.value()),
    );
    let has_views = !root.buffer_views.is_empty();
    let mut is_whole = true;
    for (index, accessor) in root.accessors.iter_mut().enumerate() {
        if accessor.buffer_view.is_some() || accessor.sparse.is_some() {
            continue;
        }
        match read.contains(&index) {
            true => is_whole = false,
            false if has_views => accessor.buffer_view = Some(gltf::json::Index::new(0)),
            false => {}
        }
    }
    is_whole
}

impl Asset {
    /// Reads a file and its buffers.
    ///
    /// # Errors
    /// The file is no glTF 2.0, requires an unsupported extension, or lacks a part of a buffer.
    pub fn open(file: &str, read: Read<'_>, take: Take<'_>) -> Result<Self, SceneError> {
        let wrong = |what: String| SceneError::new(format!("`{file}`: {what}"));
        let bytes = read(file)?;
        let (mut root, is_animated, mut blob) =
            parse(&bytes).map_err(|e| wrong(format!("no glTF 2.0: {e}")))?;
        // The crate knows fewer extensions than this loader supports.
        for name in std::mem::take(&mut root.extensions_required) {
            if !READ.contains(&name.as_str()) {
                return Err(unread(
                    wrong(format!("it requires the extension `{name}`")),
                    &name,
                ));
            }
        }
        if !without_data(&mut root) && root.extensions_used.iter().any(|name| name == DRACO) {
            let what = format!("its meshes are compressed by the extension `{DRACO}`");
            return Err(unread(wrong(what), DRACO));
        }
        let document =
            gltf::Document::from_json(root).map_err(|e| wrong(format!("no glTF 2.0: {e}")))?;
        let mut this = Self {
            file: file.to_owned(),
            document,
            is_animated,
            buffers: Vec::new(),
        };
        let mut held = 0;
        for buffer in this.document.buffers() {
            let data = match buffer.source() {
                Source::Bin => blob.take().ok_or_else(|| wrong("no binary chunk".into()))?,
                Source::Uri(uri) => this.uri(uri, read)?,
            };
            // Several buffers may share a file.
            held += data.len() as u64;
            take(0, held)?;
            if data.len() < buffer.length() {
                return Err(wrong(format!(
                    "buffer {} holds {} of {} bytes",
                    buffer.index(),
                    data.len(),
                    buffer.length()
                )));
            }
            this.buffers.push(data);
        }
        Ok(this)
    }

    pub fn wrong(&self, what: impl std::fmt::Display) -> SceneError {
        SceneError::new(format!("`{}`: {what}", self.file))
    }

    /// The bytes of a URI: decoded from a `data:` URI, or read from a file relative to this one.
    pub fn uri(&self, uri: &str, read: Read<'_>) -> Result<Vec<u8>, SceneError> {
        if let Some(rest) = uri.strip_prefix("data:") {
            let data = rest.split_once(";base64,").map(|(_, data)| data);
            let engine = base64::engine::general_purpose::GeneralPurpose::new(
                &base64::alphabet::STANDARD,
                base64::engine::GeneralPurposeConfig::new()
                    .with_decode_padding_mode(base64::engine::DecodePaddingMode::Indifferent),
            );
            let bytes = data.and_then(|data| engine.decode(data).ok());
            return bytes.ok_or_else(|| self.wrong("a data URI that is no base64"));
        }
        if uri.contains("://") {
            return Err(self.wrong(format!("`{uri}` is on the network, and is not fetched")));
        }
        let folder = match self.file.rsplit_once('/') {
            Some((folder, _)) => format!("{folder}/"),
            None => String::new(),
        };
        let name = urlencoding::decode(uri).unwrap_or(Cow::Borrowed(uri));
        read(&format!("{folder}{name}"))
    }

    /// The bytes of a view. `None` if it leaves its buffer.
    pub fn view(&self, view: &gltf::buffer::View<'_>) -> Option<&[u8]> {
        let end = view.offset().checked_add(view.length())?;
        let buffer = self.buffers.get(view.buffer().index())?;
        buffer.get(view.offset()..end)
    }

    /// Whether the file uses KHR_mesh_quantization: attributes may then have 8 or 16 bits.
    pub fn is_quantized(&self) -> bool {
        let mut used = self.document.extensions_used();
        used.any(|name| name == "KHR_mesh_quantization")
    }

    /// Length of each buffer in bytes.
    pub fn lengths(&self) -> Vec<usize> {
        self.buffers.iter().map(Vec::len).collect()
    }

    /// The nodes of the default scene.
    ///
    /// # Errors
    /// A node has two parents.
    pub fn nodes(&self) -> Result<Nodes<'_>, SceneError> {
        let document = &self.document;
        let roots: Vec<_> = match document
            .default_scene()
            .or_else(|| document.scenes().next())
        {
            Some(scene) => scene.nodes().collect(),
            None => document.nodes().collect(),
        };
        let mut out = Nodes {
            all: Vec::new(),
            world: BTreeMap::new(),
        };
        let roots = roots.into_iter().rev();
        let mut stack: Vec<_> = roots.map(|n| (n, Mat4::IDENTITY, None)).collect();
        while let Some((node, parent, above)) = stack.pop() {
            let here = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
            if out.world.insert(node.index(), here).is_some() {
                return Err(self.wrong("a node has two parents"));
            }
            let own = Some(out.all.len());
            let children: Vec<_> = node.children().map(|c| (c, here, own)).collect();
            stack.extend(children.into_iter().rev());
            out.all.push(Below { node, above });
        }
        Ok(out)
    }

    /// The joint matrices of a skin in the file's pose, with the inverse bind pose applied.
    pub fn joints(&self, skin: &gltf::Skin<'_>, world: &BTreeMap<usize, Mat4>) -> Vec<Mat4> {
        let reader = skin.reader(|b| self.buffers.get(b.index()).map(AsRef::as_ref));
        let inverse: Vec<Mat4> = reader
            .read_inverse_bind_matrices()
            .map(|m| m.map(|m| Mat4::from_cols_array_2d(&m)).collect())
            .unwrap_or_default();
        let joints = skin.joints().enumerate().map(|(i, joint)| {
            let pose = world.get(&joint.index()).copied().unwrap_or(Mat4::IDENTITY);
            pose * inverse.get(i).copied().unwrap_or(Mat4::IDENTITY)
        });
        joints.collect()
    }

    /// The parts of the file that are not drawn, one line each.
    pub fn left_out(&self) -> Vec<String> {
        let used = self.document.extensions_used();
        let ignored = used.filter(|name| !READ.contains(name));
        let mut lines: Vec<String> = ignored
            .map(|name| format!("the extension `{name}` is not read, and what it adds is missing"))
            .collect();
        if self.is_animated {
            lines.push("animations are not played: the nodes' own pose is drawn".to_owned());
        }
        if self.document.scenes().len() > 1 {
            lines.push("of its scenes, the default one is drawn".to_owned());
        }
        lines
    }
}

/// Adds help for a required extension that is not supported.
fn unread(error: SceneError, name: &str) -> SceneError {
    let what = match name {
        "KHR_draco_mesh_compression" | "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
            "export the file without mesh compression: `npx @gltf-transform/cli copy` writes one \
             that has none, and exporters have a switch for it"
        }
        "KHR_materials_pbrSpecularGlossiness" => {
            "`npx @gltf-transform/cli metalrough` writes a file without it"
        }
        _ => "export the file without it",
    };
    error.help(what).of_extension()
}
