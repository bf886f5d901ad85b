//! Compares two normals, however each is encoded.

use super::Class;
use super::promises::named;
use crate::compare::text;
use naga_edit::interface;
use naga_interp::Value;
use preshade_passes::transforms::outputs::{Outputs, OutputsParams};
use preshade_plan::pass::{Facts, Pass, Refused};
use preshade_plan::plan::{Plan, Role};
use preshade_plan::program::Program;

/// The largest difference between the components of equal normals.
const CLOSE: f32 = 1e-4;

/// The material of `program` with a pass that writes its normal: the value of this name, or that of
/// its role. `None` if no value is named and it has an output of that name already.
pub(super) fn derived(
    plan: &Plan,
    program: &Program,
    name: Option<&str>,
) -> Option<Result<Plan, String>> {
    let mut plan = plan.clone();
    plan.passes.retain(|p| p.role == Role::Main);
    let main = plan.main()?;
    let fragment = main.fragment.as_deref()?;
    let (entry, _) = program.entry_point(naga::ShaderStage::Fragment, fragment)?;
    let function = &program.module().entry_points[entry].function;
    let outputs = interface::outputs(program.module(), function);
    if name.is_none() && named(&outputs, &["normal"]).is_some() {
        return None;
    }
    let key = main.program.clone();
    plan.programs.insert(key, program.clone());
    let params = OutputsParams {
        write: "normal".to_owned(),
        normal: name.map(str::to_owned),
        ..OutputsParams::default()
    };
    let why = |refused: Refused| {
        let reasons = refused.refusals.into_iter().map(|r| r.reason);
        let reasons: Vec<String> = reasons.collect();
        format!("the main pass has no normal: {}", reasons.join("; "))
    };
    let made = Outputs::run(&plan, &Facts::default(), &params);
    Some(made.map(|outcome| outcome.plan).map_err(why))
}

/// How a normal may be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Plain,
    /// Scaled from -1..1 to 0..1.
    Halved,
}

/// The encodings of the first and the second program that all normals so far have in common.
#[derive(Clone, Debug)]
pub(super) struct Encodings(Vec<[Encoding; 2]>);

impl Default for Encodings {
    fn default() -> Self {
        let all = [Encoding::Plain, Encoding::Halved];
        Self(all.into_iter().flat_map(|a| all.map(|b| [a, b])).collect())
    }
}

impl Encoding {
    /// The vector that numbers stand for. Two numbers are octahedral.
    fn decoded(self, numbers: &[f32]) -> Option<[f32; 3]> {
        let number = |n: &f32| match self {
            Self::Plain => *n,
            Self::Halved => *n * 2.0 - 1.0,
        };
        let numbers: Vec<f32> = numbers.iter().map(number).collect();
        match numbers[..] {
            [x, y] => {
                let z = 1.0 - x.abs() - y.abs();
                let fold = (-z).max(0.0);
                let unfolded = |a: f32| a - fold.copysign(a);
                let [x, y] = [unfolded(x), unfolded(y)];
                let length = (x * x + y * y + z * z).sqrt();
                Some([x / length, y / length, z / length])
            }
            [x, y, z, ..] => Some([x, y, z]),
            _ => None,
        }
    }
}

/// The two normals, if no encoding explains them and all normals before. Ours is finite. A named
/// value of ours counts as a direction, of any length.
pub(super) fn difference(
    encodings: &mut Encodings,
    (ours, is_named): (&Value, bool),
    theirs: &Value,
) -> Option<(Class, [String; 3])> {
    let (a, b) = (ours.floats().ok()?, theirs.floats().ok()?);
    let is_finite = b.iter().all(|x| x.is_finite());
    let is_close = |[of_ours, of_theirs]: &[Encoding; 2]| {
        let (Some(a), Some(b)) = (of_ours.decoded(&a), of_theirs.decoded(&b)) else {
            return false;
        };
        let length = match is_named {
            true => a.iter().map(|x| x * x).sum::<f32>().sqrt(),
            false => 1.0,
        };
        let mut pairs = a.map(|x| x / length).into_iter().zip(b);
        // A vector without a length has no direction.
        pairs.all(|(a, b)| a.is_nan() || (a - b).abs() <= CLOSE * (1.0 + a.abs()))
    };
    let left = encodings.0.iter().copied();
    let left: Vec<_> = left.filter(|e| is_finite && is_close(e)).collect();
    match left.is_empty() {
        // The ones before stay, and another input shows the same.
        true => {
            let output = ["the normal".to_owned(), text(ours), text(theirs)];
            Some((Class::Color, output))
        }
        false => {
            encodings.0 = left;
            None
        }
    }
}
