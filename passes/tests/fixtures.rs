//! Every output of every fixture shader, sliced: the placed slice validates, prints as WGSL that parses again, and costs no more.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use preshade_passes::graph::{FunctionId, Graph};
use preshade_passes::place::{self, PositionInvariance};
use preshade_passes::reflect;
use preshade_passes::slice::{self, Criterion, OutputFilter, Termination};

#[test]
fn every_output_of_every_fixture_can_be_placed() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures");
    let mut files = Vec::new();
    let mut folders = vec![std::path::PathBuf::from(root)];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "wgsl") {
                files.push(path);
            }
        }
    }
    files.sort();
    let mut placed_slices = 0;
    for file in files {
        let source = std::fs::read_to_string(&file).unwrap();
        // Some fixtures are wrong on purpose.
        if naga::front::wgsl::parse_str(&source).is_err() {
            continue;
        }
        let program = common::program(&source);
        let graph = Graph::build(&program);
        assert!(!graph.to_dot().is_empty());
        for (entry, point) in program.module().entry_points.iter().enumerate() {
            let outputs = reflect::outputs(program.module(), &point.function).len();
            let mut criteria: Vec<Vec<Criterion>> = (0..outputs)
                .map(|i| vec![Criterion::Output(OutputFilter::Index(i))])
                .collect();
            criteria.push(vec![Criterion::Discard]);
            criteria.push(vec![
                Criterion::Discard,
                Criterion::Output(OutputFilter::All),
            ]);
            for mut criteria in criteria {
                // A vertex stage without a position is no vertex stage.
                if point.stage == naga::ShaderStage::Vertex {
                    criteria.push(Criterion::Output(OutputFilter::Position));
                }
                for termination in [Termination::Assumed, Termination::Preserved] {
                    let slice = slice::backward_with(&graph, entry, &criteria, termination);
                    assert!(
                        slice.cost <= graph.cost(FunctionId::EntryPoint(entry)) + 1e-6,
                        "{}",
                        file.display()
                    );
                    let module = place::entry_point(
                        &graph,
                        &slice,
                        program.module(),
                        "sliced",
                        "cut",
                        PositionInvariance::Invariant,
                    );
                    let module = place::retain(&module, &[(point.stage, "sliced")]);
                    common::wgsl(&common::validated(&program, module));
                    placed_slices += 1;
                }
            }
        }
    }
    assert!(placed_slices > 10);
}
