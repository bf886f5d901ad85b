//! Objects by their address in the trace. If an address is used again, the latest object counts.

use std::collections::BTreeMap;
use std::rc::Rc;

use wgpu_core::device::trace::DataKind;
use wgpu_core::id::{Marker, PointerId, markers};

use super::{OrRefusal, Refusal, refusal};
use crate::file::{DataName, DrawCommand, GroupLayout, View};

/// Commands, and the reasons why others were left out.
#[derive(Clone, Debug)]
pub(super) struct Usable<C> {
    pub commands: Vec<C>,
    pub refused: Vec<Refusal>,
}

impl<C> Default for Usable<C> {
    fn default() -> Self {
        Self {
            commands: Vec::new(),
            refused: Vec::new(),
        }
    }
}

/// Objects by address, or why they were left out.
pub(super) struct Map<M, T> {
    what: &'static str,
    made: BTreeMap<usize, OrRefusal<T>>,
    marker: std::marker::PhantomData<fn(M)>,
}

/// The id's address as a number.
pub(super) fn address<M: Marker>(id: PointerId<M>) -> usize {
    let PointerId::PointerId(address, _) = id;
    address.get()
}

impl<M: Marker, T: Clone> Map<M, T> {
    fn new(what: &'static str) -> Self {
        Self {
            what,
            made: BTreeMap::new(),
            marker: std::marker::PhantomData,
        }
    }

    pub fn set(&mut self, id: PointerId<M>, made: OrRefusal<T>) {
        self.made.insert(address(id), made);
    }

    pub fn get(&self, id: PointerId<M>) -> OrRefusal<T> {
        let made = self.made.get(&address(id)).cloned();
        made.unwrap_or_else(|| Err(refusal(self.what, "the trace does not tell how it is made")))
    }
}

/// A shader whose text may not have been read yet.
#[derive(Clone)]
pub(super) struct Module {
    pub data: DataName,
    pub kind: DataKind,
    pub label: String,
    /// Number in the file's list, once it was read.
    pub number: Option<OrRefusal<usize>>,
}

/// The surface of a window.
#[derive(Clone)]
pub(super) struct Surface {
    pub texture: crate::file::Texture,
    /// `None` if the app left it to the system.
    pub alpha_mode: Option<crate::file::AlphaMode>,
    /// The texture that the app draws to until it presents it.
    pub acquired: Option<usize>,
}

/// Every object that commands can name. Numbers are indices into the lists of the file.
pub(super) struct Ids {
    pub buffers: Map<markers::Buffer, usize>,
    pub textures: Map<markers::Texture, usize>,
    pub views: Map<markers::TextureView, View>,
    pub samplers: Map<markers::Sampler, usize>,
    pub group_layouts: Map<markers::BindGroupLayout, GroupLayout>,
    pub pipeline_layouts: Map<markers::PipelineLayout, usize>,
    pub groups: Map<markers::BindGroup, usize>,
    pub modules: Map<markers::ShaderModule, Module>,
    pub render_pipelines: Map<markers::RenderPipeline, usize>,
    pub compute_pipelines: Map<markers::ComputePipeline, usize>,
    pub bundles: Map<markers::RenderBundle, Rc<Usable<DrawCommand>>>,
    pub surfaces: Map<markers::Surface, Surface>,
}

impl Default for Ids {
    fn default() -> Self {
        Self {
            buffers: Map::new("a buffer"),
            textures: Map::new("a texture"),
            views: Map::new("a view of a texture"),
            samplers: Map::new("a sampler"),
            group_layouts: Map::new("a bind group layout"),
            pipeline_layouts: Map::new("a pipeline layout"),
            groups: Map::new("a bind group"),
            modules: Map::new("a shader"),
            render_pipelines: Map::new("a render pipeline"),
            compute_pipelines: Map::new("a compute pipeline"),
            bundles: Map::new("a render bundle"),
            surfaces: Map::new("a surface"),
        }
    }
}
