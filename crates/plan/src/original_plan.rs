//! Makes plans: the original of a material, and passes with the bindings and limits of their programs.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::ShaderStage;

use crate::contract::Contract;
use crate::geometry::Geometry;
use crate::plan::{
    Attachment, ComputePass, Draws, GpuPass, Phase, Plan, Role, SCENE_DEPTH, SCHEMA,
};
use crate::program::Program;
use crate::reflect;
use crate::state::{ColorTarget, DepthFormat, DepthState, MaterialState, Topology};

impl Plan {
    /// The plan that draws a material as its author wrote it: one pass. `vertex` and `fragment`
    /// name the entry points.
    pub fn original(
        material: &str,
        program: Program,
        vertex: &str,
        fragment: Option<&str>,
        state: &MaterialState,
    ) -> Self {
        let fragment = fragment.map(str::to_owned);
        let targets = if state.targets.is_empty() {
            fragment
                .as_deref()
                .map(|f| default_targets(&program, f))
                .unwrap_or_default()
        } else {
            state.targets.clone()
        };
        let blended = state.is_blended();
        let lost = program.declared().point_size;
        let mut notes = point_size_note(lost, state.primitive.topology);
        notes.extend(program.declared().notes.iter().cloned());
        let mut pass = GpuPass {
            role: Role::Main,
            phase: if blended {
                Phase::Blended
            } else {
                Phase::Opaque
            },
            program: Role::Main.name().to_owned(),
            vertex: vertex.to_owned(),
            fragment,
            primitive: state.primitive,
            depth: Some(DepthState {
                bias: state.depth_bias,
                ..DepthState::new(
                    SCENE_DEPTH,
                    state.depth_format,
                    state.compare(),
                    state.depth_write,
                )
            }),
            stencil: state.stencil.clone(),
            multisample: state.multisample,
            targets,
            bindings: Vec::new(),
            attributes: Vec::new(),
            features: match state.depth_format {
                DepthFormat::Depth32floatStencil8 => {
                    vec![reflect::DEPTH32FLOAT_STENCIL8.to_owned()]
                }
                _ => Vec::new(),
            },
            limits: BTreeMap::new(),
            draws: Draws::All,
            geometry: Geometry::AsGiven,
            view_dependent: Vec::new(),
            left_out: Vec::new(),
        };
        reflect::fill(&mut pass, &program);
        let plan = Self {
            schema: SCHEMA.to_owned(),
            material: material.to_owned(),
            programs: BTreeMap::from([(Role::Main.name().to_owned(), program)]),
            attachments: vec![Attachment::depth(
                SCENE_DEPTH,
                state.depth_format,
                state.depth_direction,
                state.multisample.count,
            )],
            vertex_buffers: Vec::new(),
            draw_buffers: Vec::new(),
            frame_buffers: Vec::new(),
            compute: Vec::new(),
            passes: vec![pass],
            steps: Vec::new(),
            contract: Contract::exact(),
            self_test: None,
            fallback: None,
            guard: None,
            original: None,
            notes,
        };
        Self {
            original: Some(Arc::new(plan.clone())),
            ..plan
        }
    }

    /// Adds a pass and its program, from which the pass takes its bindings and attributes.
    pub fn add_pass(&mut self, mut pass: GpuPass, program: Program) {
        reflect::fill(&mut pass, &program);
        self.programs.insert(pass.program.clone(), program);
        self.passes.push(pass);
    }

    /// Adds a compute pass and its program, from which the pass takes its bindings.
    pub fn add_compute(&mut self, mut pass: ComputePass, program: Program) {
        reflect::fill_compute(&mut pass, &program);
        self.programs.insert(pass.program.clone(), program);
        self.compute.push(pass);
    }
}

/// The note on point sizes, which the IR doesn't keep.
fn point_size_note(is_said: bool, topology: Topology) -> Vec<String> {
    let note = match (is_said, topology) {
        (false, _) => return Vec::new(),
        (true, Topology::PointList) => {
            "`gl_PointSize` is dropped: points come out one pixel large, for WGSL has no word for \
             their size; draw quads in their place"
        }
        (true, _) => {
            "`gl_PointSize` is dropped: that changes no triangle and no line, and a host that \
             draws points with the material gets them one pixel large (`--topology point-list`, or \
             `topology` in a scene, says that it does)"
        }
    };
    vec![note.to_owned()]
}

/// A target for each location that the fragment stage writes: of 8 bits for floats, of 32 for integers.
/// It has no more components than the output, as WebGPU wants.
fn default_targets(program: &Program, fragment: &str) -> Vec<Option<ColorTarget>> {
    let Some((_, entry)) = program.entry_point(ShaderStage::Fragment, fragment) else {
        return Vec::new();
    };
    let mut targets = Vec::new();
    for output in naga_edit::interface::outputs(program.module(), &entry.function) {
        if let Some(naga::Binding::Location { location, .. }) = output.binding {
            let index = location as usize;
            if targets.len() <= index {
                targets.resize(index + 1, None);
            }
            let inner = &program.module().types[output.ty].inner;
            let of_kind = match inner.scalar_kind() {
                Some(naga::ScalarKind::Uint) => ["r32uint", "rg32uint", "rgba32uint"],
                Some(naga::ScalarKind::Sint) => ["r32sint", "rg32sint", "rgba32sint"],
                _ => ["r8unorm", "rg8unorm", "rgba8unorm"],
            };
            let format = match inner {
                naga::TypeInner::Scalar(_) => of_kind[0],
                naga::TypeInner::Vector { size, .. } if *size == naga::VectorSize::Bi => of_kind[1],
                _ => of_kind[2],
            };
            targets[index] = Some(ColorTarget::opaque(format));
        }
    }
    targets
}
