//! The one place that compiles the shaders of plans, with or without wgpu's injected run-time
//! checks.
#![allow(unsafe_code)]

use preshade_plan::safety::Checks;
use shader_text::limits::Trust;
use wgpu::{Device, ShaderModule, ShaderModuleDescriptor, ShaderRuntimeChecks};

/// Compiles a shader with the checks that `trust` demands, and those that it needs. A device has one
/// level of trust, and the texts of a material have the same needs, so comparisons never mix two
/// settings.
pub(super) fn compile(
    device: &Device,
    trust: Trust,
    needed: Checks,
    descriptor: ShaderModuleDescriptor<'_>,
) -> ShaderModule {
    match trust {
        Trust::Strangers => device.create_shader_module(descriptor),
        // SAFETY: wgpu requires that the shaders read and write within their bindings, index within
        // their arrays, do not divide by 0, end their loops and obey the ray query protocol.
        // `needed` has the checks of indices and divisors wherever the author's text does not make
        // them needless, and `bounded` draws loops that may not end in copies first. We do not
        // prove the rest. The user of this process trusts the shaders as an engine trusts
        // its own materials, and opens the device as `Own`; the command line does so unless its
        // limits say that the shaders may be a stranger's (`Limits::trust`). These limit the damage
        // of a mistake: every bound buffer is as long as its type in the shader (`scene::bind` lays
        // it out from that type), wgpu-core still validates the module, and an access beyond a
        // buffer stays inside the device's memory if the driver supports the robustness that
        // wgpu-hal enables. Arrays in registers or on the stack have no such protection: a software
        // adapter writes past those in this process.
        Trust::Own => unsafe {
            let checks = ShaderRuntimeChecks {
                bounds_checks: needed.indices,
                int_div_checks: needed.divisors,
                ..ShaderRuntimeChecks::unchecked()
            };
            device.create_shader_module_trusted(descriptor, checks)
        },
    }
}
