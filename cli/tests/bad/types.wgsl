@vertex fn vs() -> @builtin(position) vec4<f32> {
    let x: f32 = 1u;
    return vec4<f32>(x);
}
@fragment fn fs() -> @location(0) vec4<f32> { return vec4<f32>(1.0); }
