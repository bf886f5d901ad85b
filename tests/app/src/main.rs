//! A grove of swaying leaves, drawn as its author wrote it and with what preshade's build script
//! made of it.
//!
//! `preshade-example` opens a window; the space bar changes between the two.
//! `preshade-example --headless` draws both into textures and compares every pixel.

mod grove;
mod headless;
mod window;

/// What the build script made of `shaders/leaf.wgsl`.
mod leaf {
    preshade::include_variant!("leaf");
}

/// What it made of `shaders/ground.wgsl`, for which it was asked nothing. It draws with the leaf's
/// types where both are in one frame; here it is only built.
mod ground {
    preshade::include_variant!("ground");
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    match std::env::args().nth(1).as_deref() {
        Some("--headless") => headless::run(),
        None => window::run(),
        Some(other) => Err(format!("unknown argument {other}: there is --headless").into()),
    }
}
