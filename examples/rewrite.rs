//! Applies a recipe to a WGSL file and writes the variant:
//! `cargo run --example rewrite -- lit.wgsl depth-prepass,hoist out`.

use std::error::Error;
use std::path::Path;

use preshade_compiler::front::Source;
use preshade_compiler::pipeline::{Shader, rewrite};
use preshade_compiler::recipe::Recipe;
use preshade_plan::pass::Facts;
use preshade_plan::plan_file::Target;
use preshade_plan::state::MaterialState;
use shader_text::options::Options;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, recipe, folder] = &arguments[..] else {
        return Err("expected FILE.wgsl RECIPE FOLDER".into());
    };
    let shader = Shader {
        name: "material",
        sources: &[Source::new(file, std::fs::read_to_string(file)?)],
        options: &Options::default(),
        state: &MaterialState::default(),
    };
    let recipe = Recipe::parse_list(recipe)?;
    let output = rewrite(shader, &recipe, &Facts::default(), &[Target::Wgsl])?;
    for skipped in &output.skipped {
        eprintln!("{}: {}", skipped.step, skipped.refusal);
    }
    std::fs::create_dir_all(folder)?;
    for file in &output.files {
        std::fs::write(Path::new(folder).join(&file.name), &file.bytes)?;
    }
    println!("{} steps applied", output.plan.steps.len());
    Ok(())
}
