//! The one place that compiles shaders without wgpu's injected run-time checks.
#![allow(unsafe_code)]

use wgpu::{Device, ShaderModule, ShaderModuleDescriptor, ShaderRuntimeChecks};

/// Compiles a shader with no injected bounds checks, loop bounds or division checks.
///
/// The checks cost some shaders more than the transforms under measurement gain, and native hosts do not have them. The original and
/// all its variants are compiled this one way, so that a comparison is never between two settings.
pub(super) fn compile(device: &Device, descriptor: ShaderModuleDescriptor<'_>) -> ShaderModule {
    // SAFETY: wgpu asks that the shaders read and write within their bindings, end their loops and obey the ray query protocol. The
    // shaders are the ones that the user of this process passed it to be run on this very machine, or slices of them: this is the trust an
    // engine puts in its own materials. No third party's shader comes here. Every buffer bound is as long as the type in the shader
    // says (`scene::bind` lays it out from that type), wgpu-core still validates the module, and an access past the end of a
    // runtime-sized array stays inside the device's memory under the robustness that wgpu-hal enables where a driver has it.
    unsafe { device.create_shader_module_trusted(descriptor, ShaderRuntimeChecks::unchecked()) }
}
