@vertex fn vs() -> @builtin(position) vec4<f32> { return vec4<f32>(); }
@fragment @early_depth_test(force) fn fs(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    if at.x < 8.0 { discard; }
    return vec4<f32>(1.0);
}
