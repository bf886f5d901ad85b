//! Bind groups of a generated material. The author's resources have the same layout in every pass,
//! so that one bind group serves them all.

use std::collections::{BTreeMap, BTreeSet};

use preshade_plan::plan::{BindingLayout, BindingSource, BindingUse, HostValue, Plan};

use super::emitted::json;
use super::wgpu_words as words;

/// Properties of the author's resources that no shader states, by group and binding.
#[derive(Clone, Debug, Default)]
pub(super) struct BindingSettings {
    /// Buffers that are bound at a dynamic offset.
    pub dynamic: BTreeSet<(u32, u32)>,
    /// Unfilterable textures, and non-filtering samplers.
    pub unfilterable: BTreeSet<(u32, u32)>,
}

impl BindingSettings {
    /// `wgpu::BindingType` of a binding, as Rust.
    fn binding_type(&self, binding: &BindingUse) -> String {
        let at = (binding.group, binding.binding);
        let of_author = binding.source == BindingSource::Author;
        words::binding_type(
            binding,
            of_author && self.dynamic.contains(&at),
            of_author && self.unfilterable.contains(&at),
        )
    }

    /// A setting for a binding that does not exist, or has another type.
    fn amiss(&self, used: &BTreeMap<(u32, u32), BindingUse>) -> Option<String> {
        let is = |at: &(u32, u32), fits: fn(&BindingLayout) -> bool| {
            used.get(at)
                .and_then(|b| b.layout.as_ref())
                .is_some_and(fits)
        };
        let buffer = |layout: &BindingLayout| matches!(layout, BindingLayout::Buffer { .. });
        let filtered = |layout: &BindingLayout| match layout {
            BindingLayout::Sampler { ty } => ty != "comparison",
            BindingLayout::Texture { sample_type, .. } => {
                ["float", "unfilterable-float"].contains(&sample_type.as_str())
            }
            _ => false,
        };
        let dynamic = self.dynamic.iter().find(|at| !is(at, buffer));
        if let Some((group, binding)) = dynamic {
            return Some(format!(
                "a dynamic offset is asked for at group {group}, binding {binding}, where the \
                 shader has no buffer"
            ));
        }
        let unfilterable = self.unfilterable.iter().find(|at| !is(at, filtered));
        unfilterable.map(|(group, binding)| {
            format!(
                "no filtering is asked for at group {group}, binding {binding}, where the shader \
                 has no texture of floats and no sampler that may filter"
            )
        })
    }
}

/// The author's resources by group and binding, as all passes of all plans together use them.
pub(super) struct Shared<'s> {
    resources: BTreeMap<(u32, u32), Resource>,
    said: &'s BindingSettings,
}

struct Resource {
    name: String,
    /// A Rust expression of type `wgpu::BindingType`.
    ty: String,
    stages: StageUse,
}

/// StageUse that use a binding.
#[derive(Clone, Copy)]
struct StageUse {
    vertex: bool,
    fragment: bool,
    compute: bool,
}

/// The kind of pass that has the bindings.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum PassKind {
    Raster,
    Compute,
}

impl StageUse {
    fn of(binding: &BindingUse, kind: PassKind) -> Self {
        Self {
            vertex: binding.visibility.vertex,
            fragment: binding.visibility.fragment,
            compute: kind == PassKind::Compute,
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            vertex: self.vertex || other.vertex,
            fragment: self.fragment || other.fragment,
            compute: self.compute || other.compute,
        }
    }

    fn text(self) -> String {
        let all = [
            (self.vertex, "VERTEX"),
            (self.fragment, "FRAGMENT"),
            (self.compute, "COMPUTE"),
        ];
        let seen = all.iter().filter(|(is, _)| *is);
        seen.fold("wgpu::ShaderStages::NONE".to_owned(), |text, (_, stage)| {
            format!("{text}.union(wgpu::ShaderStages::{stage})")
        })
    }
}

impl<'s> Shared<'s> {
    /// Collects the resources of one material's plans.
    ///
    /// # Errors
    /// A setting names a binding that does not exist.
    pub(super) fn of<'p>(
        plans: impl Iterator<Item = &'p Plan>,
        said: &'s BindingSettings,
    ) -> Result<Self, String> {
        let mut used: BTreeMap<(u32, u32), BindingUse> = BTreeMap::new();
        let mut all: BTreeMap<(u32, u32), Resource> = BTreeMap::new();
        for plan in plans {
            let raster = plan.passes.iter().map(|p| (&p.bindings, PassKind::Raster));
            let compute = plan
                .compute
                .iter()
                .map(|c| (&c.bindings, PassKind::Compute));
            for (bindings, kind) in raster.chain(compute) {
                for binding in bindings {
                    if binding.source != BindingSource::Author {
                        continue;
                    }
                    let stages = StageUse::of(binding, kind);
                    let key = (binding.group, binding.binding);
                    used.entry(key).or_insert_with(|| binding.clone());
                    let resource = all.entry(key).or_insert_with(|| Resource {
                        name: binding.name.clone(),
                        ty: said.binding_type(binding),
                        stages,
                    });
                    resource.stages = resource.stages.and(stages);
                }
            }
        }
        match said.amiss(&used) {
            None => Ok(Self {
                resources: all,
                said,
            }),
            Some(why) => Err(why),
        }
    }

    /// The bind groups of a pass that uses `bindings`, as Rust. If a pass uses any binding of a
    /// group, it gets the author's whole group.
    pub(super) fn groups(&self, bindings: &[BindingUse], kind: PassKind) -> String {
        let count = bindings.iter().map(|b| b.group + 1).max().unwrap_or(0);
        let groups: Vec<String> = (0..count)
            .map(|group| self.group(group, bindings, kind))
            .collect();
        format!("&[{}]", groups.join(", "))
    }

    fn group(&self, group: u32, bindings: &[BindingUse], kind: PassKind) -> String {
        let own: Vec<&BindingUse> = bindings.iter().filter(|b| b.group == group).collect();
        if own.is_empty() {
            return "&[]".to_owned();
        }
        let mut entries: BTreeMap<u32, String> = BTreeMap::new();
        for ((_, at), resource) in self.resources.range((group, 0)..=(group, u32::MAX)) {
            let Resource { name, ty, stages } = resource;
            entries.insert(*at, entry(name, "ResourceSource::Author", *at, *stages, ty));
        }
        for binding in own {
            let ty = self.said.binding_type(binding);
            let shared = self.resources.get(&(group, binding.binding));
            let is_shared = binding.source == BindingSource::Author
                && shared.is_some_and(|resource| resource.ty == ty);
            if !is_shared {
                let (at, stages) = (binding.binding, StageUse::of(binding, kind));
                let text = entry(&binding.name, &source(&binding.source), at, stages, &ty);
                entries.insert(at, text);
            }
        }
        let entries: Vec<String> = entries.into_values().collect();
        format!("&[{}]", entries.join(", "))
    }
}

fn entry(name: &str, source: &str, binding: u32, stages: StageUse, ty: &str) -> String {
    format!(
        "Binding {{ name: {name:?}, source: {source}, entry: wgpu::BindGroupLayoutEntry {{ \
         binding: {binding}, visibility: {}, ty: {ty}, count: None }} }}",
        stages.text()
    )
}

fn source(source: &BindingSource) -> String {
    match source {
        BindingSource::Author => "ResourceSource::Author".to_owned(),
        BindingSource::Attachment { name } => format!("ResourceSource::Attachment({name:?})"),
        BindingSource::SceneColor { location } => format!("ResourceSource::SceneColor({location})"),
        BindingSource::Geometry { part } => format!("ResourceSource::Geometry({:?})", json(part)),
        BindingSource::Previous { group, binding, .. } => {
            format!("ResourceSource::Previous({:?})", group.zip(*binding))
        }
        BindingSource::View { name } => format!("ResourceSource::View({name:?})"),
        BindingSource::Host { value } => match value {
            HostValue::DrawId => "ResourceSource::DrawId".to_owned(),
            HostValue::PointLight => "ResourceSource::PointLight".to_owned(),
        },
    }
}
