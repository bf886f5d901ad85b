//! The limits of a device that a plan may need, by WebGPU's names.

/// A limit by WebGPU's name. `None` for limits that plans do not use.
pub(super) fn limit(l: &wgpu::Limits, name: &str) -> Option<u64> {
    Some(match name {
        "maxBindGroups" => l.max_bind_groups.into(),
        "maxBindingsPerBindGroup" => l.max_bindings_per_bind_group.into(),
        "maxColorAttachmentBytesPerSample" => l.max_color_attachment_bytes_per_sample.into(),
        "maxColorAttachments" => l.max_color_attachments.into(),
        "maxComputeInvocationsPerWorkgroup" => l.max_compute_invocations_per_workgroup.into(),
        "maxComputeWorkgroupSizeX" => l.max_compute_workgroup_size_x.into(),
        "maxInterStageShaderVariables" => l.max_inter_stage_shader_variables.into(),
        "maxSampledTexturesPerShaderStage" => l.max_sampled_textures_per_shader_stage.into(),
        "maxSamplersPerShaderStage" => l.max_samplers_per_shader_stage.into(),
        "maxStorageBufferBindingSize" => l.max_storage_buffer_binding_size,
        "maxStorageBuffersPerShaderStage" => l.max_storage_buffers_per_shader_stage.into(),
        "maxStorageTexturesPerShaderStage" => l.max_storage_textures_per_shader_stage.into(),
        "maxUniformBufferBindingSize" => l.max_uniform_buffer_binding_size,
        "maxUniformBuffersPerShaderStage" => l.max_uniform_buffers_per_shader_stage.into(),
        "maxImmediateSize" => l.max_immediate_size.into(),
        "maxVertexAttributes" => l.max_vertex_attributes.into(),
        _ => return None,
    })
}

/// Raises a limit by WebGPU's name to at least `value`. `None` for names unknown to [`limit`].
pub(super) fn raise(l: &mut wgpu::Limits, name: &str, value: u64) -> Option<()> {
    let wide = match name {
        "maxStorageBufferBindingSize" => Some(&mut l.max_storage_buffer_binding_size),
        "maxUniformBufferBindingSize" => Some(&mut l.max_uniform_buffer_binding_size),
        _ => None,
    };
    if let Some(wide) = wide {
        *wide = value.max(*wide);
        return Some(());
    }
    let narrow = match name {
        "maxBindGroups" => &mut l.max_bind_groups,
        "maxBindingsPerBindGroup" => &mut l.max_bindings_per_bind_group,
        "maxColorAttachmentBytesPerSample" => &mut l.max_color_attachment_bytes_per_sample,
        "maxColorAttachments" => &mut l.max_color_attachments,
        "maxComputeInvocationsPerWorkgroup" => &mut l.max_compute_invocations_per_workgroup,
        "maxComputeWorkgroupSizeX" => &mut l.max_compute_workgroup_size_x,
        "maxInterStageShaderVariables" => &mut l.max_inter_stage_shader_variables,
        "maxSampledTexturesPerShaderStage" => &mut l.max_sampled_textures_per_shader_stage,
        "maxSamplersPerShaderStage" => &mut l.max_samplers_per_shader_stage,
        "maxStorageBuffersPerShaderStage" => &mut l.max_storage_buffers_per_shader_stage,
        "maxStorageTexturesPerShaderStage" => &mut l.max_storage_textures_per_shader_stage,
        "maxUniformBuffersPerShaderStage" => &mut l.max_uniform_buffers_per_shader_stage,
        "maxImmediateSize" => &mut l.max_immediate_size,
        "maxVertexAttributes" => &mut l.max_vertex_attributes,
        _ => return None,
    };
    *narrow = u32::try_from(value).unwrap_or(u32::MAX).max(*narrow);
    Some(())
}

/// Workgroups for a number of invocations, in rows of WebGPU's largest dispatch size.
pub(super) fn rows(invocations: u32, workgroup: u32) -> [u32; 2] {
    let groups = invocations.div_ceil(workgroup.max(1));
    let x = groups.min(65_535);
    [x, groups.div_ceil(x.max(1))]
}

#[cfg(test)]
mod tests {
    use super::{limit, raise};

    #[test]
    fn every_limit_a_plan_may_tell_of_is_known() {
        for (name, default) in preshade_plan::limits::DEFAULTS {
            // wgpu's defaults equal WebGPU's.
            assert_eq!(
                limit(&wgpu::Limits::default(), name),
                Some(default),
                "{name}"
            );
            let mut raised = wgpu::Limits::default();
            assert_eq!(raise(&mut raised, name, default + 1), Some(()), "{name}");
            assert_eq!(limit(&raised, name), Some(default + 1), "{name}");
        }
    }
}
