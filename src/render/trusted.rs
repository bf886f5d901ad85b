//! The one place that compiles the shaders of plans: with wgpu's injected run-time checks, or without.
#![allow(unsafe_code)]

use wgpu::{Device, ShaderModule, ShaderModuleDescriptor, ShaderRuntimeChecks};

/// Whose shaders a device is given, and so whether wgpu's run-time checks (of indices, loops and divisions) are compiled into them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Trust {
    /// The user's own: no checks. They cost some shaders more than the transforms under measurement gain, and native hosts do not have them.
    #[default]
    Own,
    /// Strangers': all checks, as in a browser. Indices are clamped, loops end, and x / 0 is x, as WGSL has it.
    Strangers,
}

/// Compiles a shader with the checks that `trust` asks for. A device has one trust, so that a comparison is never between two settings.
pub(super) fn compile(
    device: &Device,
    trust: Trust,
    descriptor: ShaderModuleDescriptor<'_>,
) -> ShaderModule {
    match trust {
        Trust::Strangers => device.create_shader_module(descriptor),
        // SAFETY: wgpu asks that the shaders read and write within their bindings, index within their arrays, divide by no 0, end their
        // loops and obey the ray query protocol. Nothing here proves that of them: it is the trust that an engine puts in its own
        // materials, which the user of this process gives by opening the device as `Own`; the command line does so unless its
        // limits say that the shaders may be a stranger's (`Limits::trust`). What lessens a mistake of theirs: every buffer bound is as
        // long as the type in the shader says (`scene::bind` lays it out from that type), wgpu-core still validates the module, and an
        // access past the end of a buffer stays inside the device's memory under the robustness that wgpu-hal enables where a
        // driver has it. That covers no array in registers or on the stack: a software adapter writes past those in this process.
        Trust::Own => unsafe {
            device.create_shader_module_trusted(descriptor, ShaderRuntimeChecks::unchecked())
        },
    }
}
