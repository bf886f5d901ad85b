@vertex fn vs() -> @builtin(position) vec4<f32> {
    return vec4<f32>(1.0, 2.0
}
