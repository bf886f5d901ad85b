//! Depth tests that come before the fragment stage.

use super::{Class, Finding, Relation};
use preshade_dataflow::graph::Graph;
use preshade_passes::analysis::coverage;
use preshade_plan::plan::GpuPass;
use preshade_plan::program::Program;

/// The finding if exactly one program forces the early test: it writes the depth of discarded
/// fragments, and ignores the depth that the stage writes.
pub(super) fn finding(sides: [(&GpuPass, &Program); 2], relation: Relation) -> Option<Finding> {
    if relation == Relation::Position {
        return None;
    }
    let decides = sides.map(|(pass, program)| {
        let found = coverage::of_pass(&Graph::build(program), program, pass);
        found.map(|(_, decides)| decides).unwrap_or_default()
    });
    let [first, second] = relation.names();
    let (forced, who, other) = match decides.map(|d| d.is_forced) {
        [true, false] => (decides[0], first, second),
        [false, true] => (decides[1], second, first),
        _ => return None,
    };
    let what = match (forced.discards, forced.depth) {
        (true, true) => {
            "a fragment that it discards writes depth, and the depth that it writes is ignored"
        }
        (true, false) => "a fragment that it discards writes depth",
        (false, true) => "the depth that it writes is ignored",
        (false, false) => return None,
    };
    let words = format!(
        "{who} tests the depth before its fragment stage (`@early_depth_test(force)`, \
         `layout(early_fragment_tests)`), so {what}; {other} tests it afterwards"
    );
    Some(Finding::general(Class::Depth, "discards and depths", words))
}
