//! The work of a `build.rs`, outside of cargo: compiles a shader into a Rust module that depends
//! only on wgpu. `cargo run --example build-script -- lit.wgsl out`.

use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, folder] = &arguments[..] else {
        return Err("expected FILE.wgsl FOLDER".into());
    };
    let built = preshade_compiler::build_script::configure()
        .pass("depth-prepass:form=biased")
        .variant("early_discard", ["early-discard:quad=vote"])
        .out_dir(folder)
        .build(&[Path::new(file)])?;
    for warning in &built.warnings {
        eprintln!("{warning}");
    }
    println!("include!({:?});", built.module);
    Ok(())
}
