//! Copies of a scene with another depth format, sample count or viewport. The drawn objects stay
//! the same.

use glam::Vec4;
use naga_edit::interface;
use preshade_plan::state::{DepthDirection, DepthFormat};

use super::Scene;

impl Scene {
    /// Whether the scene comes from a captured frame, so that it draws exactly the same as the
    /// frame.
    pub fn is_captured(&self) -> bool {
        self.draws.iter().any(|draw| draw.captured.is_some())
    }

    /// Another depth format and direction. If the direction changes, cameras map depth `z` to
    /// `w - z`.
    #[must_use]
    pub fn with_depth(mut self, format: DepthFormat, direction: DepthDirection) -> Self {
        if direction != self.depth_direction {
            for frame in self.cameras.iter_mut().flat_map(|c| &mut c.frames) {
                let turn =
                    |column: Vec4| Vec4::new(column.x, column.y, column.w - column.z, column.w);
                let p = &mut frame.projection;
                (p.x_axis, p.y_axis, p.z_axis, p.w_axis) = (
                    turn(p.x_axis),
                    turn(p.y_axis),
                    turn(p.z_axis),
                    turn(p.w_axis),
                );
            }
        }
        self.depth_format = format;
        self.depth_direction = direction;
        for material in &mut self.materials {
            let state = &mut material.state;
            if state.depth_direction != direction {
                state.depth_compare = state.depth_compare.map(|c| c.reversed());
                state.depth_bias.constant = -state.depth_bias.constant;
                state.depth_bias.slope_scale = -state.depth_bias.slope_scale;
            }
            state.depth_format = format;
            state.depth_direction = direction;
        }
        self
    }

    /// Another number of samples per pixel, 1 or 4.
    #[must_use]
    pub fn with_samples(mut self, samples: u32) -> Self {
        self.samples = samples;
        for material in &mut self.materials {
            material.state.multisample.count = samples;
        }
        self
    }

    /// Another viewport: x, y, width, height in pixels.
    #[must_use]
    pub fn with_viewport(mut self, viewport: [u32; 4]) -> Self {
        let before = self.aspect();
        self.viewport = Some(viewport);
        let scale = before / self.aspect();
        for frame in self.cameras.iter_mut().flat_map(|c| &mut c.frames) {
            frame.projection.x_axis *= scale;
        }
        self
    }

    /// The scene with the draws of one material alone.
    #[must_use]
    pub fn only(&self, material: usize) -> Self {
        let mut scene = self.clone();
        let own = self.materials.get(material).cloned();
        scene.materials = own.into_iter().collect();
        scene.draws.retain(|draw| draw.material == material);
        scene.draws.iter_mut().for_each(|draw| draw.material = 0);
        scene
    }

    /// Marks every material's position `@invariant`: the second reference for variants.
    #[must_use]
    pub fn with_invariant_positions(mut self) -> Self {
        for material in &mut self.materials {
            let found = material
                .program
                .entry_point(naga::ShaderStage::Vertex, &material.vertex);
            let Some((entry, _)) = found else { continue };
            let marked = interface::with_invariant_position(material.program.module(), entry);
            // Marking a position cannot make a valid module invalid.
            if let Ok(program) = material.program.with_module(marked) {
                material.program = program;
            }
        }
        self
    }
}
