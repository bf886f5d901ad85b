//! Scalars of any type of float.

/// A scalar. `F` is the float type.
#[derive(Clone, Copy, Debug)]
pub enum Scalar<F = f32> {
    /// `f32`.
    F32(F),
    /// `i32`.
    I32(i32),
    /// `u32`.
    U32(u32),
    /// `bool`.
    Bool(bool),
}
