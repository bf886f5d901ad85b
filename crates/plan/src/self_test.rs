//! Self-tests in plans: draws that a host makes at load, to check that its driver keeps the plan's
//! promise.
//!
//! They check only whether any sample passed, never how many: WebGPU doesn't promise a count. We
//! therefore compare which pass's fragments are nearer. A pass leaves the nearest fragment of a
//! sample in a depth attachment, so "no fragment of the other pass is nearer" is one query.

use crate::contract::{Contract, Surface};
use crate::plan::{
    ClearValue, Plan, Role, SELF_TEST_DEPTH, SamplesPassed, SelfTest, SelfTestDraw, SelfTestRun,
    Step,
};
use crate::state::{CompareFunction, DepthDirection};

/// For an unchanged main pass over a pre-pass that is biased away from the viewer: over the main
/// pass's own depths, no sample of the pre-pass may hide one of the main pass's. `None` for a plan
/// without a main pass.
///
/// At the far plane both are clamped to the clear depth, where neither passes in the frame. So the
/// test clears one step nearer.
pub fn biased(plan: &Plan) -> Option<SelfTest> {
    let main = plan.main()?.depth.as_ref()?;
    let hides = match main.compare {
        // A tie hides a fragment that must be strictly nearer.
        CompareFunction::Less => CompareFunction::LessEqual,
        CompareFunction::Greater => CompareFunction::GreaterEqual,
        CompareFunction::LessEqual => CompareFunction::Less,
        CompareFunction::GreaterEqual => CompareFunction::Greater,
        _ => return None,
    };
    let format = plan.depth_format(&main.attachment)?;
    let step = match main.compare.direction()? {
        DepthDirection::Forward => -format.step(),
        DepthDirection::Reversed if format.is_float() => f32::MIN_POSITIVE,
        // A format that may be a 24-bit unorm would store the smallest float as 0.
        DepthDirection::Reversed => format.step(),
    };
    let run = SelfTestRun {
        failure:
            "the pre-pass hides samples of the main pass, or covers what the main pass does not"
                .to_owned(),
        draws: vec![
            lays(Role::Main, SELF_TEST_DEPTH, main.compare),
            none_passes(Role::Prepass, hides),
        ],
    };
    let mut test = of(plan, plan, vec![run])?;
    if let ClearValue::Depth(clear) = &mut test.attachment.clear {
        *clear += step;
    }
    Some(test)
}

/// Whether the main pass still discards like its pre-pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MainDiscards {
    /// It does, or neither discards.
    AsPrepass,
    /// It leaves discarding to EQUAL.
    NoMore,
}

/// For a main pass that compares with EQUAL: neither pass may have a fragment nearer than the
/// other's nearest, so the nearest are equal. `compare` is the pre-pass's comparison.
///
/// If the main pass no longer discards, its fragments may be nearer, and only one of the two runs
/// remains. Then the pre-pass alone decides coverage, so it is also compared with the original's
/// main pass.
pub fn equal(plan: &Plan, compare: CompareFunction, discards: MainDiscards) -> Option<SelfTest> {
    let nearer = nearer(compare)?;
    let lies_behind = SelfTestRun {
        failure: "the main pass lies behind what the pre-pass leaves, or does not cover it"
            .to_owned(),
        draws: vec![
            lays(Role::Main, SELF_TEST_DEPTH, compare),
            none_passes(Role::Prepass, nearer),
        ],
    };
    let runs = match discards {
        MainDiscards::AsPrepass => vec![
            lies_behind,
            SelfTestRun {
                failure: "the main pass lies in front of what the pre-pass leaves, or covers more"
                    .to_owned(),
                draws: vec![
                    lays(Role::Prepass, SELF_TEST_DEPTH, compare),
                    none_passes(Role::Main, nearer),
                ],
            },
        ],
        MainDiscards::NoMore => {
            let mut runs = vec![lies_behind];
            runs.extend(
                as_original(plan, Role::Prepass, compare)
                    .into_iter()
                    .flatten(),
            );
            runs
        }
    };
    of(plan, plan, runs)
}

/// For an id pass that replaces the main pass of `original`, the plan before: as [`equal`], against
/// the original's main pass.
pub fn identified(plan: &Plan, original: &Plan) -> Option<SelfTest> {
    let compare = original.main()?.depth.as_ref()?.compare;
    of(
        plan,
        original,
        as_original(original, Role::Ids, compare)?.into(),
    )
}

/// The runs of an earlier step's test, after those of `test`: both must pass.
pub fn with_earlier(test: Option<SelfTest>, earlier: Option<SelfTest>) -> Option<SelfTest> {
    let mut test = test?;
    test.runs.extend(earlier.into_iter().flat_map(|t| t.runs));
    Some(test)
}

/// An earlier step's test of a main pass that now reads the depth of its pre-pass, `produced`: the
/// pre-pass is drawn first.
pub fn after_prepass(
    earlier: Option<SelfTest>,
    compare: CompareFunction,
    produced: &str,
) -> Option<SelfTest> {
    let mut test = earlier?;
    for run in &mut test.runs {
        run.draws.insert(0, lays(Role::Prepass, produced, compare));
    }
    Some(test)
}

/// For a main pass with the author's position in a vertex stage that other code joined or left:
/// as [`equal`], against the original's main pass. `None` if the main pass has no depth.
pub fn same_position(plan: &Plan) -> Option<SelfTest> {
    let compare = plan.main()?.depth.as_ref()?.compare;
    of(plan, plan, as_original(plan, Role::Main, compare)?.into())
}

/// Neither the plan's pass of this role nor the original's main pass may have a fragment nearer than
/// the other's nearest. `None` if a step of `before` may round positions otherwise than the original.
fn as_original(before: &Plan, role: Role, compare: CompareFunction) -> Option<[SelfTestRun; 2]> {
    let is_moved = |step: &Step| match step.contract {
        Contract::Rounding { turned, .. } => turned.is_some_and(|t| t.surface == Surface::Rounded),
        _ => false,
    };
    if before.steps.iter().any(is_moved) {
        return None;
    }
    let nearer = nearer(compare)?;
    let name = match role {
        Role::Prepass => "the pre-pass",
        Role::Ids => "the id pass",
        _ => "the main pass",
    };
    let original = |draw| SelfTestDraw {
        original: true,
        ..draw
    };
    Some([
        SelfTestRun {
            failure: format!("the original lies behind what {name} leaves, or does not cover it"),
            draws: vec![
                original(lays(Role::Main, SELF_TEST_DEPTH, compare)),
                none_passes(role, nearer),
            ],
        },
        SelfTestRun {
            failure: format!("the original lies in front of what {name} leaves, or covers more"),
            draws: vec![
                lays(role, SELF_TEST_DEPTH, compare),
                original(none_passes(Role::Main, nearer)),
            ],
        },
    ])
}

/// For a main pass that both reads the depth of its pre-pass, `produced`, and is tested against it.
/// With that depth bound, the main pass's own depths must never be behind the pre-pass's.
pub fn read_only(plan: &Plan, compare: CompareFunction, produced: &str) -> Option<SelfTest> {
    let run = SelfTestRun {
        failure:
            "the main pass lies behind what the pre-pass leaves, or discards what it should not"
                .to_owned(),
        draws: vec![
            lays(Role::Prepass, produced, compare),
            lays(Role::Main, SELF_TEST_DEPTH, compare),
            none_passes(Role::Prepass, nearer(compare)?),
        ],
    };
    of(plan, plan, vec![run])
}

/// The comparison that only a strictly nearer fragment passes.
fn nearer(compare: CompareFunction) -> Option<CompareFunction> {
    Some(match compare.direction()? {
        DepthDirection::Forward => CompareFunction::Less,
        DepthDirection::Reversed => CompareFunction::Greater,
    })
}

fn lays(role: Role, attachment: &str, compare: CompareFunction) -> SelfTestDraw {
    SelfTestDraw {
        role,
        original: false,
        attachment: attachment.to_owned(),
        compare,
        write: true,
        samples: SamplesPassed::Some,
    }
}

fn none_passes(role: Role, compare: CompareFunction) -> SelfTestDraw {
    SelfTestDraw {
        role,
        original: false,
        attachment: SELF_TEST_DEPTH.to_owned(),
        compare,
        write: false,
        samples: SamplesPassed::None,
    }
}

/// A test with an attachment like the main pass's in `drawn`.
fn of(plan: &Plan, drawn: &Plan, runs: Vec<SelfTestRun>) -> Option<SelfTest> {
    let depth = drawn.main()?.depth.as_ref()?;
    let mut attachment = plan.attachment(&depth.attachment)?.clone();
    attachment.name = SELF_TEST_DEPTH.to_owned();
    attachment.sampled = false;
    Some(SelfTest { attachment, runs })
}
