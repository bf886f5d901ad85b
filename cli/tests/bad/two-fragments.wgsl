@vertex fn vs() -> @builtin(position) vec4<f32> { return vec4<f32>(); }
@fragment fn lit() -> @location(0) vec4<f32> { return vec4<f32>(1.0); }
@fragment fn flat_color() -> @location(0) vec4<f32> { return vec4<f32>(0.5); }
