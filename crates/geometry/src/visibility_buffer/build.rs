//! The passes of a split material.

use naga::{Binding, ShaderStage};

use super::binding_sources::parts;
use super::gradients::{self, Failed, Shaded};
use super::ids::{self, Triangles};
use super::lists::{self, Lists};
use super::resolve::{self, Built, Keeps, Resolve, Runs};
use super::text::{self, Slots};
use super::{
    Ids, Select, SplitMaterial, VisibilityBuffer, VisibilityParams, legal, refuse, stored_vertices,
};
use naga_edit::declared::Declared;
use naga_edit::interface;
use preshade_passes::rebuild::place;
use preshade_passes::rebuild::snippet::Linked;
use preshade_plan::draw_table::{DRAWS, IDS};
use preshade_plan::geometry::Geometry;
use preshade_plan::pass::{Pass, Refusal};
use preshade_plan::plan::{
    Attachment, BindingKind, BindingSource, BindingUse, ClearValue, ComputePass, Draws,
    GeometryPart, GpuPass, Phase, Plan, Role, VertexBuffer, When,
};
use preshade_plan::state::{
    AttachmentOps, ColorTarget, CompareFunction, CullMode, DepthDirection, DepthFormat, DepthState,
    PrimitiveState, Topology,
};

impl SplitMaterial<'_> {
    pub(super) fn ids(
        &self,
        plan: &mut Plan,
        params: &VisibilityParams,
        slots: Slots,
    ) -> Result<(), String> {
        let opaque = &self.opaque;
        let invariance = params.invariant(opaque).position();
        let placed = self.depth.place(opaque, "ids", invariance, None);
        let vertex = placed
            .module
            .entry_points
            .iter()
            .find(|e| e.stage == ShaderStage::Vertex && e.name == placed.vertex)
            .ok_or("there is no depth-only vertex stage")?;
        let inputs = interface::inputs(&placed.module, &vertex.function);
        let attributes: Vec<_> = opaque
            .pass
            .attributes
            .iter()
            .filter(|a| {
                inputs.iter().any(|i| {
                    matches!(i.binding, Some(Binding::Location { location, .. }) if location == a.location)
                })
            })
            .cloned()
            .collect();
        let (triangles, geometry) = match params.ids {
            Ids::PrimitiveIndex => (Triangles::PrimitiveIndex, Geometry::AsGiven),
            Ids::Unindexed => (
                Triangles::Unindexed(&attributes, params.formats),
                Geometry::Unindexed,
            ),
        };
        let module = ids::add(
            placed.module.clone(),
            &placed.vertex,
            placed.fragment.as_deref(),
            &triangles,
            slots,
            (params.words, legal::facing(opaque, &self.colors)),
        )?;
        let entries = [
            (ShaderStage::Vertex, ids::VERTEX),
            (ShaderStage::Fragment, ids::FRAGMENT),
        ];
        let program = opaque
            .program
            .with_module(place::retain(&module, &entries))
            .map_err(|e| e.to_string())?;
        let streams = match params.ids {
            Ids::PrimitiveIndex => Vec::new(),
            Ids::Unindexed => attributes,
        };
        let mut bindings = parts(slots, &streams, params.formats);
        bindings.extend(opaque.pass.bindings.iter().cloned());
        let pass = GpuPass {
            role: Role::Ids,
            phase: Phase::Depth,
            program: Role::Ids.name().to_owned(),
            vertex: ids::VERTEX.to_owned(),
            fragment: Some(ids::FRAGMENT.to_owned()),
            targets: vec![Some(ColorTarget {
                attachment: Some(IDS.to_owned()),
                ..ColorTarget::opaque(params.words.color())
            })],
            bindings,
            attributes: Vec::new(),
            draws: Draws::Opaque,
            geometry,
            ..opaque.pass.clone()
        };
        plan.add_pass(pass, program);
        Ok(())
    }

    /// Adds the pass that separates the draws of a frame. All materials share it.
    pub(super) fn classify(
        &self,
        plan: &mut Plan,
        params: &VisibilityParams,
    ) -> Result<(), String> {
        let module = Linked::new(naga::Module::default(), &text::classify(params.words))?.module;
        let program = self
            .opaque
            .program
            .with_module(module)
            .map_err(|e| e.to_string())?;
        // Its bindings reuse the author's numbers for other resources.
        let of_frame = Declared {
            depth: program.declared().depth,
            origin_upper_left: program.declared().origin_upper_left,
            ..Declared::default()
        };
        let program = program.with_declared(of_frame);
        let binding = |binding, source| lists::bound((0, binding), source);
        let ids = BindingSource::Attachment {
            name: IDS.to_owned(),
        };
        let table = BindingSource::Geometry {
            part: GeometryPart::DrawTable,
        };
        let (format, direction) = (DepthFormat::Depth16unorm, DepthDirection::Forward);
        let pass = GpuPass {
            role: Role::Classify,
            phase: Phase::Classify,
            program: Role::Classify.name().to_owned(),
            vertex: "vs_classify".to_owned(),
            fragment: Some("fs_classify".to_owned()),
            depth: Some(DepthState::new(
                DRAWS,
                format,
                CompareFunction::Always,
                true,
            )),
            targets: Vec::new(),
            bindings: vec![
                binding(text::CLASSIFY_IDS, ids),
                binding(text::CLASSIFY_TABLE, table),
            ],
            draws: Draws::Once,
            ..self.full_screen()
        };
        plan.attachments.push(Attachment {
            // Draw numbers start at 1.
            clear: ClearValue::Depth(0.0),
            ..Attachment::depth(DRAWS, format, direction, 1)
        });
        plan.add_pass(pass, program);
        Ok(())
    }

    /// A full-screen pass without stages and bindings.
    fn full_screen(&self) -> GpuPass {
        GpuPass {
            primitive: PrimitiveState {
                topology: Topology::TriangleList,
                cull: CullMode::None,
                ..PrimitiveState::default()
            },
            depth: None,
            stencil: None,
            attributes: Vec::new(),
            geometry: Geometry::FullScreen,
            ..self.opaque.pass.clone()
        }
    }

    fn resolved(
        &self,
        shaded: &Shaded<'_, '_>,
        params: &VisibilityParams,
        slots: Slots,
        runs: Runs,
    ) -> Result<Built, Box<Refusal>> {
        let bug = |why: String| Box::new(Refusal::bug(VisibilityBuffer::INFO.name, why));
        let opaque = &self.opaque;
        let like = params.rasterizer();
        let explicit = gradients::explicit(shaded, &like).map_err(|failed| match failed {
            Failed::Bug(why) => bug(why),
            Failed::Refused(code, reason, span) => Box::new(
                refuse(code, reason, gradients::remedy(code)).at(opaque.program.sources(), span),
            ),
        })?;
        Resolve {
            graph: &opaque.graph,
            explicit,
            fragment: shaded.fragment,
            vertex: opaque.vertex,
            attributes: &opaque.pass.attributes,
            facing: legal::facing(opaque, &self.colors),
            select: params.select(),
            runs,
            formats: params.formats,
            words: params.words,
            corners: like.corners,
            lists: Lists::of(params),
            vertices: params.vertices,
        }
        .build(slots)
        .map_err(bug)
    }

    /// Adds the compute pass that stores vertices, and returns the resolve's bindings for it.
    fn keep(
        &self,
        plan: &mut Plan,
        keeps: &Keeps,
        params: &VisibilityParams,
        slots: Slots,
    ) -> Result<BindingUse, String> {
        let module = place::retain(
            &keeps.module,
            &[(ShaderStage::Compute, stored_vertices::ENTRY)],
        );
        let program = self.opaque.program.with_module(module);
        let program = program.map_err(|e| e.to_string())?;
        let bound = |attributes: usize| {
            let binding = slots.first + Slots::STREAMS + attributes as u32;
            let part = GeometryPart::Vertices {
                buffer: stored_vertices::BUFFER.to_owned(),
            };
            lists::bound((slots.group, binding), BindingSource::Geometry { part })
        };
        let mut bindings = parts(slots, &keeps.attributes, params.formats);
        bindings.push(bound(keeps.attributes.len()));
        bindings.extend(self.opaque.pass.bindings.iter().cloned());
        let geometry = Geometry::Vertices;
        let pass = ComputePass {
            draws: Draws::Opaque,
            bindings,
            ..ComputePass::new(
                "vertices",
                stored_vertices::ENTRY,
                stored_vertices::WORKGROUP,
                geometry,
            )
        };
        plan.add_compute(pass, program);
        plan.vertex_buffers.push(VertexBuffer {
            name: stored_vertices::BUFFER.to_owned(),
            stride: keeps.words * 4,
        });
        Ok(bound(0))
    }

    /// Adds the compute resolve, and the pass that clears its targets.
    pub(super) fn compute(
        &self,
        plan: &mut Plan,
        shaded: &Shaded<'_, '_>,
        params: &VisibilityParams,
        slots: Slots,
    ) -> Result<(), Box<Refusal>> {
        let bug = |why: String| Box::new(Refusal::bug(VisibilityBuffer::INFO.name, why));
        let pass = self.opaque.pass;
        let targets = legal::stored(pass)?;
        let built = self.resolved(shaded, params, slots, Runs::Compute(targets.clone()))?;
        let entries = [(ShaderStage::Compute, resolve::COMPUTE)];
        let with = |module: &naga::Module, entries: &[(ShaderStage, &str)]| {
            let module = place::retain(module, entries);
            let program = self.opaque.program.with_module(module);
            program.map_err(|e| bug(e.to_string()))
        };
        let program = with(&built.module, &entries)?;
        let mut known = parts(slots, &built.attributes, params.formats);
        let mut first = slots.first + Slots::STREAMS + built.attributes.len() as u32;
        if let Some(keeps) = &built.keeps {
            known.push(self.keep(plan, keeps, params, slots).map_err(bug)?);
            first += 1;
        }
        known.extend((first..).zip(&targets).map(|(binding, target)| {
            let location = target.location;
            let source = BindingSource::SceneColor { location };
            BindingUse::new([slots.group, binding], BindingKind::StorageTexture, source)
        }));
        let lists = Lists::of(params);
        known.extend(lists.bindings(slots.group, first + targets.len() as u32));
        known.extend(pass.bindings.iter().cloned());
        let (workgroup, phase) = (resolve::WORKGROUP, Phase::Resolve);
        let name = Role::Resolve.name();
        let resolve = ComputePass {
            when: When::Behind { phase },
            draws: Draws::Opaque,
            bindings: known,
            ..ComputePass::new(name, resolve::COMPUTE, workgroup, lists.geometry())
        };
        plan.add_compute(resolve, program);
        let locations: Vec<u32> = targets.iter().map(|t| t.location).collect();
        let cleared =
            Linked::new(naga::Module::default(), &text::clear(&locations)).map_err(bug)?;
        let entries = [
            (ShaderStage::Vertex, "vs_clear"),
            (ShaderStage::Fragment, "fs_clear"),
        ];
        let program = with(&cleared.module, &entries)?;
        let mut clear = GpuPass {
            role: Role::Clear,
            phase: Phase::Classify,
            program: Role::Clear.name().to_owned(),
            vertex: "vs_clear".to_owned(),
            fragment: Some("fs_clear".to_owned()),
            draws: Draws::Once,
            bindings: Vec::new(),
            ..self.full_screen()
        };
        for target in clear.targets.iter_mut().flatten() {
            target.write_mask = 0;
        }
        plan.add_pass(clear, program);
        Ok(())
    }

    pub(super) fn resolve(
        &self,
        plan: &mut Plan,
        shaded: &Shaded<'_, '_>,
        params: &VisibilityParams,
        slots: Slots,
    ) -> Result<(), Box<Refusal>> {
        let bug = |why: String| Box::new(Refusal::bug(VisibilityBuffer::INFO.name, why));
        let opaque = &self.opaque;
        let built = self.resolved(shaded, params, slots, Runs::Fragment)?;
        let entries = [
            (ShaderStage::Vertex, resolve::VERTEX),
            (ShaderStage::Fragment, resolve::FRAGMENT),
        ];
        let program = opaque
            .program
            .with_module(place::retain(&built.module, &entries))
            .map_err(|e| bug(e.to_string()))?;
        let lists = Lists::of(params);
        let mut bindings = parts(slots, &built.attributes, params.formats);
        let mut first = slots.first + Slots::STREAMS + built.attributes.len() as u32;
        if let Some(keeps) = &built.keeps {
            bindings.push(self.keep(plan, keeps, params, slots).map_err(bug)?);
            first += 1;
        }
        bindings.extend(lists.bindings(slots.group, first));
        bindings.extend(opaque.pass.bindings.iter().cloned());
        let mut pass = GpuPass {
            role: Role::Resolve,
            phase: Phase::Resolve,
            program: Role::Resolve.name().to_owned(),
            vertex: resolve::VERTEX.to_owned(),
            fragment: Some(resolve::FRAGMENT.to_owned()),
            depth: (params.select() == Select::Depth).then(|| {
                let format = DepthFormat::Depth16unorm;
                DepthState::new(DRAWS, format, CompareFunction::Equal, false)
            }),
            bindings,
            draws: Draws::Opaque,
            geometry: lists.geometry(),
            ..self.full_screen()
        };
        for target in pass.targets.iter_mut().flatten() {
            target.ops = AttachmentOps::default();
        }
        plan.add_pass(pass, program);
        Ok(())
    }
}
