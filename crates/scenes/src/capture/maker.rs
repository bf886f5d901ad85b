//! State that the makers of a captured pass's scene share: the frame before the pass, and the
//! objects read so far.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;
use std::sync::Arc;

use preshade_plan::plan::{BindingKind, BindingUse};
use preshade_plan::state::DepthDirection;

use super::reader::{Left, Reader};
use super::replay::{Replay, Until};
use super::{Error, texels};
use preshade_draw::render::Gpu;
use preshade_draw::scene::bind::{
    BufferBinding, Data, SamplerBinding, TextureBinding, TextureContent,
};
use preshade_draw::scene::{Image, Material, Mesh};
use preshade_frames::contents::{Contents, cut};
use preshade_frames::file::View;
use preshade_frames::folder::{Capture, get};
use preshade_frames::pass::{Pass, TexturePart};

pub(super) struct Maker<'c> {
    pub(super) capture: &'c Capture,
    pub(super) pass: &'c Pass<'c>,
    /// Pipelines that are drawn without their unseen alpha blending.
    pub(super) unblended: BTreeSet<usize>,
    /// Earlier passes of the frame.
    pub(super) before: &'c [Pass<'c>],
    pub(super) contents: Contents,
    /// Textures that a frame writes.
    pub(super) written: BTreeSet<usize>,
    pub(super) replay: Option<Replay<'c>>,
    pub(super) gpu: Option<&'c Gpu>,
    pub(super) frame: usize,
    /// Width and height of the target.
    pub(super) size: [u32; 2],
    /// Direction in which depth grows in the pass.
    pub(super) direction: DepthDirection,
    pub(super) buffers: BTreeMap<TexturePart, Data>,
    pub(super) images: BTreeMap<(usize, String), Arc<Image>>,
    pub(super) notes: BTreeSet<String>,
    pub(super) materials: Vec<Material>,
    /// Material by pipeline and stencil reference. `None` if it cannot be read.
    pub(super) by_pipeline: BTreeMap<(usize, u32), Option<usize>>,
    /// The bindings that each material's program reads.
    pub(super) bindings: BTreeMap<usize, Rc<[BindingUse]>>,
    pub(super) meshes: Vec<Mesh>,
}

impl<'c> Maker<'c> {
    /// How to read programs. A scene to draw uses WebGL's row order, because programs may depend on
    /// it. A scene that is only read uses the author's programs.
    pub(super) fn reader(&self) -> Reader {
        match self.gpu {
            Some(_) => Reader::Scene,
            None => Reader::Author,
        }
    }

    /// A part of a buffer. Equal parts share one allocation.
    pub(super) fn part(&mut self, part: TexturePart) -> Result<Data, Left> {
        if let Some(known) = self.buffers.get(&part) {
            return Ok(known.clone());
        }
        let (buffer, offset, size) = part;
        let bytes = match self.contents.is_computed(buffer) {
            false => self.contents.buffer(self.capture, buffer)?,
            true => match self.replayed()? {
                Some(replay) => replay.read_buffer(buffer)?.into(),
                None => self.contents.buffer(self.capture, buffer)?,
            },
        };
        let data = Data::new(cut(&bytes, offset, size).to_vec());
        self.buffers.insert(part, data.clone());
        Ok(data)
    }

    /// The replay, stopped before the pass. `None` without an adapter.
    pub(super) fn replayed(&mut self) -> Result<Option<&mut Replay<'c>>, Error> {
        let Some(gpu) = self.gpu else { return Ok(None) };
        if self.replay.is_none() {
            let mut replay = Replay::new(gpu, self.capture);
            for earlier in 0..self.frame {
                replay.frame(earlier, Until::End)?;
            }
            replay.frame(self.frame, Until::Command(self.pass.command))?;
            for (left, count) in replay.left_out() {
                self.notes.insert(format!(
                    "before the pass, {count} of {} is left out: {}",
                    left.what, left.why
                ));
            }
            self.replay = Some(replay);
        }
        Ok(self.replay.as_mut())
    }

    /// The bindings that a material's program reads.
    pub(super) fn bindings(&mut self, material: usize) -> Rc<[BindingUse]> {
        let of = &self.materials[material];
        let read = || {
            of.plan()
                .main()
                .map_or(Rc::default(), |p| p.bindings.as_slice().into())
        };
        Rc::clone(self.bindings.entry(material).or_insert_with(read))
    }

    pub(super) fn texture(
        &mut self,
        view: &View,
        (group, binding): (u32, u32),
        used: &BindingUse,
    ) -> Result<TextureBinding, Left> {
        let of = get(
            &self.capture.file.textures,
            view.texture,
            "texture",
            "a draw",
        )?;
        if of.sample_count > 1 {
            return Err(Left::Out(format!("`{}` has several samples", used.name)));
        }
        let key = (view.texture, format!("{:?}", view.view));
        let image = match self.images.get(&key) {
            Some(known) => Arc::clone(known),
            None => {
                let image = Arc::new(self.image(view)?);
                self.images.insert(key, Arc::clone(&image));
                image
            }
        };
        let dimension = view.view.dimension.unwrap_or(match of.dimension {
            wgpu::TextureDimension::D1 => wgpu::TextureViewDimension::D1,
            wgpu::TextureDimension::D2 if of.size.0[2] > 1 => wgpu::TextureViewDimension::D2Array,
            wgpu::TextureDimension::D2 => wgpu::TextureViewDimension::D2,
            wgpu::TextureDimension::D3 => wgpu::TextureViewDimension::D3,
        });
        let features = wgpu::Features::all();
        let sample_type = match used.kind {
            BindingKind::DepthTexture => wgpu::TextureSampleType::Depth,
            _ => image
                .format
                .sample_type(view.view.aspect, Some(features))
                .map(|ty| match ty {
                    wgpu::TextureSampleType::Depth => {
                        wgpu::TextureSampleType::Float { filterable: false }
                    }
                    other => other,
                })
                .unwrap_or_default(),
        };
        Ok(TextureBinding {
            group,
            binding,
            content: TextureContent::Image(image),
            view: dimension,
            sample_type,
            multisampled: false,
            is_invented: false,
            is_steady: self.capture.file.is_complete() && !self.written.contains(&view.texture),
        })
    }

    /// The image of a view's levels and layers.
    fn image(&mut self, view: &View) -> Result<Image, Left> {
        if self.contents.is_as_at_start(view.texture) {
            return Ok(texels::at_start(self.capture, view)?);
        }
        let capture = self.capture;
        match self.replayed()? {
            Some(replay) => Ok(replay.read_view(view)?),
            None => Ok(texels::empty(capture, view)?),
        }
    }
}

/// Buffers, textures and samplers of a draw.
pub(crate) type Bound = (Vec<BufferBinding>, Vec<TextureBinding>, Vec<SamplerBinding>);
