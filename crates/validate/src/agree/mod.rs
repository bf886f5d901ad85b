//! Compares two programs, whoever wrote them: a material's main pass, and a depth, shadow or
//! velocity pass that somebody wrote by hand; or a shader before and after an edit.
//!
//! `matching` renames the second program's resources and attributes to the first's, so that both
//! read one set of inputs. Each relation is a list of promises. A promise is proved as in
//! [validation](super), or tried on inputs; a difference gets a [`Class`], the lines of both
//! authors, and a sentence (`words`).

use std::cell::Cell;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::Effort;
use super::compared_numbers::Numbers;
use super::environment::PassStages;
use super::stage::Stage;
use preshade_plan::mapping::Equation;
use preshade_plan::plan::{GpuPass, Plan, Role};
use shader_text::source::Location;

mod attributes;
mod budget;
mod buffers;
mod causes;
mod differences;
mod draws;
mod early;
mod fed;
mod matched_parts;
mod matching;
mod motion;
mod normals;
mod notes;
mod products;
mod promise_inputs;
mod promises;
mod quote;
mod reads;
mod rename;
mod sampled;
mod solve_by_runs;
mod ties;
mod traced;
mod trial;
mod wording;

pub use matching::{By, Partner};

/// What two programs should have in common.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Relation {
    /// Everything: positions, discards, depths, colours and stores.
    Same,
    /// Positions bit for bit, discards and depths.
    Prepass,
    /// Discards and depths, and positions as functions of the view.
    Shadow,
    /// Positions.
    Position,
    /// Discards and depths.
    Discard,
    /// As a pre-pass; and the velocity is constant if nothing moves, and follows what moves.
    Velocity,
    /// As a pre-pass, and the normal that the first program writes or lights with.
    Normal,
}

impl Relation {
    pub const ALL: [Self; 7] = [
        Self::Same,
        Self::Prepass,
        Self::Shadow,
        Self::Position,
        Self::Discard,
        Self::Velocity,
        Self::Normal,
    ];

    /// The value of `--as`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Same => "same",
            Self::Prepass => "prepass",
            Self::Shadow => "shadow",
            Self::Position => "position",
            Self::Discard => "discard",
            Self::Velocity => "velocity",
            Self::Normal => "normal",
        }
    }

    /// The promises of the relation, in a few words.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Same => "Positions, discards, depths and colours",
            Self::Prepass => "A depth pre-pass: positions bit for bit, discards and depths",
            Self::Shadow => {
                "A shadow pass: discards and depths, positions as functions of the view"
            }
            Self::Position => "Positions alone",
            Self::Discard => "Discards and depths alone",
            Self::Velocity => "A pre-pass whose velocity follows the motion of the main pass",
            Self::Normal => "A pre-pass that writes the normal which the first program writes",
        }
    }

    /// Names of the two programs in messages.
    pub fn names(self) -> [&'static str; 2] {
        let second = match self {
            Self::Same => return ["the first", "the second"],
            Self::Prepass => "the pre-pass",
            Self::Shadow => "the shadow pass",
            Self::Position | Self::Discard => "the other pass",
            Self::Velocity => "the velocity pass",
            Self::Normal => "the normal pass",
        };
        ["the main pass", second]
    }
}

/// The kind of a finding.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Class {
    /// Positions differ.
    Position,
    /// The second keeps what the first discards: depth where nothing is drawn.
    KeepsHidden,
    /// The second discards what the first keeps: drawn without depth.
    Loses,
    /// The depths that the fragment stages write differ.
    Depth,
    /// Colours, or contents of buffers, differ.
    Color,
    /// The velocity of what does not move varies, or it does not follow what moves.
    Moves,
    /// The second reads something that the first does not have.
    Unmatched,
    /// The depth of vertices differs, and nothing else, and always in one direction.
    DepthBias,
    /// They differ in the mip level that they read alone.
    LevelOnly,
    /// They agree if both see the same view, and the discards depend on the view.
    ViewDependent,
    /// They differ as rounding does alone.
    Rounding,
    /// They differ for infinities, NaN and huge numbers alone.
    Extreme,
    /// Depths must be equal, and a GPU may round the two positions differently.
    Variant,
    /// The second computes what GLSL leaves undefined, and the first does not.
    Undefined,
    /// A scene that is drawn with both shows a difference.
    Drawn,
}

impl Class {
    pub const ALL: [Self; 15] = [
        Self::Position,
        Self::KeepsHidden,
        Self::Loses,
        Self::Depth,
        Self::Color,
        Self::Moves,
        Self::Unmatched,
        Self::DepthBias,
        Self::LevelOnly,
        Self::ViewDependent,
        Self::Rounding,
        Self::Extreme,
        Self::Variant,
        Self::Undefined,
        Self::Drawn,
    ];

    /// Its word in options and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::KeepsHidden => "keeps-hidden",
            Self::Loses => "loses",
            Self::Depth => "depth",
            Self::Color => "color",
            Self::Moves => "moves",
            Self::Unmatched => "unmatched",
            Self::DepthBias => "depth-bias",
            Self::LevelOnly => "level-only",
            Self::ViewDependent => "view-dependent",
            Self::Rounding => "rounding",
            Self::Extreme => "extreme",
            Self::Variant => "variant",
            Self::Undefined => "undefined",
            Self::Drawn => "drawn",
        }
    }

    /// Whether such a finding breaks a relation by default. Another rounding matters where depths
    /// are compared for equality, or a picture must not change.
    pub fn breaks(self, relation: Relation) -> bool {
        match self {
            Self::ViewDependent | Self::Extreme | Self::Variant => false,
            // A shadow map has a bias of its own. Other depths are compared with the main pass's.
            Self::DepthBias => relation != Relation::Shadow,
            Self::Rounding => matches!(relation, Relation::Same | Relation::Prepass),
            Self::Undefined => relation == Relation::Same,
            _ => true,
        }
    }
}

/// A line of an author, and its value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Spot {
    /// Its place.
    pub location: Option<Location>,
    /// The author's text.
    pub text: String,
    /// Its value on the inputs of the finding.
    pub value: String,
}

/// A way in which the two programs do not agree.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Finding {
    /// Its kind.
    pub class: Class,
    /// The promise that it breaks.
    pub promise: String,
    /// The finding as a sentence.
    pub words: String,
    /// Where the first program first computes something that the second does not, or decides.
    pub first: Option<Spot>,
    /// The same of the second.
    pub second: Option<Spot>,
    /// The first program's comparison that decides a discard.
    pub first_decides: Option<Spot>,
    /// The same of the second.
    pub second_decides: Option<Spot>,
    /// The differing output: its name, the first's value and the second's.
    pub output: Option<[String; 3]>,
    /// Seed of the inputs.
    pub seed: Option<u64>,
    /// Each input's name and value.
    pub inputs: Vec<(String, String)>,
}

impl Finding {
    /// A finding that is not about one input.
    pub fn general(class: Class, promise: &str, words: String) -> Self {
        Self {
            class,
            promise: promise.to_owned(),
            words,
            first: None,
            second: None,
            first_decides: None,
            second_decides: None,
            output: None,
            seed: None,
            inputs: Vec::new(),
        }
    }
}

/// The result for a promise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Outcome {
    /// Both compute the same operations.
    Proved {
        /// Whether by equal slices; otherwise by terms.
        slices: bool,
        /// Inputs on which both were also run.
        inputs: u64,
    },
    /// Equal on inputs.
    Agreed {
        /// Their number.
        inputs: u64,
        /// The number that was asked for, if more would have been too expensive.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        cut_from: Option<u64>,
    },
    /// The findings say how.
    Differs,
    /// Not checked. Never counts as success.
    NotEvaluated {
        /// The reason.
        why: String,
    },
}

/// A promise and its result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct PromiseResult {
    /// The promise.
    pub promise: String,
    /// The result.
    pub outcome: Outcome,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Agreement {
    pub relation: Relation,
    /// Which resource and attribute is which.
    pub partners: Vec<Partner>,
    pub promises: Vec<PromiseResult>,
    /// Worst first.
    pub findings: Vec<Finding>,
    /// Assumptions, and differences that no input shows, a sentence each.
    #[serde(skip)]
    pub notes: Vec<String>,
}

/// Two programs that cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Mismatch {
    #[error("{side} program has no {stage} stage")]
    Stage {
        /// `the first` or `the second`.
        side: &'static str,
        /// `vertex` or `fragment`.
        stage: &'static str,
    },
    /// A mapping names something that is not there.
    #[error("--map {map}: in the {side} program, {why}")]
    Map {
        map: String,
        /// The program that lacks the name: `first` or `second`.
        side: &'static str,
        why: String,
    },
    /// No resource or attribute has a partner.
    #[error(
        "the two programs have no resource or attribute in common, by number, name or mapping: they \
         are not of one material"
    )]
    Nothing,
    /// The second program is not valid with the first one's numbers.
    #[error("the second program cannot take the first one's bindings: {0}")]
    Renamed(String),
}

/// The relation to check, and the user's help.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a> {
    pub relation: Relation,
    /// Names of the second and the first program that mean one thing.
    pub maps: &'a [Equation],
    /// For [`Relation::Normal`], the value of the first program that is the normal. Default: its
    /// output of that name, or the unit vector that meets a light in a dot product.
    pub normal: Option<&'a str>,
}

impl From<Relation> for Question<'_> {
    fn from(relation: Relation) -> Self {
        Self {
            relation,
            maps: &[],
            normal: None,
        }
    }
}

/// Holds the main pass of `second` against the main pass of `first`.
///
/// # Errors
///
/// The two don't fit together.
pub fn agree(
    first: &Plan,
    second: &Plan,
    question: Question<'_>,
    effort: &Effort,
) -> Result<Agreement, Mismatch> {
    let Question {
        relation,
        maps,
        normal,
    } = question;
    let of_first = first;
    let sides = [(first, "the first"), (second, "the second")];
    let [ours, theirs] = sides.map(|(plan, side)| {
        let pass = plan.main().and_then(|p| Some((p, plan.program(p)?)));
        let (pass, program) = pass.ok_or(Mismatch::Stage {
            side,
            stage: "vertex",
        })?;
        Ok((pass, super::with_overrides(program, None), side))
    });
    let ((ours, our_program, side), (theirs, their_program, other)) = (ours?, theirs?);
    let first = stages(ours, &our_program, side)?;
    let second = stages(theirs, &their_program, other)?;
    if relation == Relation::Discard && first.fragment.is_none() && second.fragment.is_none() {
        return Err(Mismatch::Stage {
            side,
            stage: "fragment",
        });
    }
    let matching = matching::matched(first, second, relation, maps)?;
    let renamed = stages(theirs, &matching.program, other)?;
    let first = match &matching.first {
        Some(program) => stages(ours, program, side)?,
        None => first,
    };
    let derived = match relation {
        Relation::Normal => normals::derived(of_first, first.vertex.program, normal),
        _ => None,
    };
    let budget = budget::Budget::new(effort.steps);
    let undefined = Cell::default();
    let multisample = &ours.multisample;
    let two = trial::Two {
        first,
        second: renamed,
        matching: &matching,
        relation,
        effort: *effort,
        covers_by_alpha: multisample.alpha_to_coverage,
        samples: multisample.count,
        numbers: Arc::new(Numbers::of([first, renamed])),
        components: differences::components([&our_program, &their_program]),
        direction: ours
            .depth
            .as_ref()
            .and_then(|d| d.compare.direction())
            .unwrap_or_default(),
        normal: derived.as_ref().map(|made| of_derived(made, side)),
        budget: &budget,
        undefined: &undefined,
    };
    let (mut promises, mut findings) = two.check_promises();
    findings.extend(notes::variant(&two, &promises));
    let early = early::finding([(ours, &our_program), (theirs, &their_program)], relation);
    if let Some(finding) = early {
        let held = promises.iter_mut().filter(|h| h.promise == finding.promise);
        held.for_each(|h| h.outcome = Outcome::Differs);
        findings.push(finding);
    }
    findings.sort_by_key(|f| f.class);
    Ok(Agreement {
        relation,
        partners: matching.partners.clone(),
        notes: notes::all(&two),
        promises,
        findings,
    })
}

fn stages<'p>(
    pass: &GpuPass,
    program: &'p preshade_plan::program::Program,
    side: &'static str,
) -> Result<PassStages<'p>, Mismatch> {
    use naga::ShaderStage as S;
    let missing = |stage| Mismatch::Stage { side, stage };
    let vertex = Stage::new(program, S::Vertex, &pass.vertex).ok_or(missing("vertex"))?;
    let fragment = pass
        .fragment
        .as_ref()
        .map(|name| Stage::new(program, S::Fragment, name).ok_or(missing("fragment")));
    Ok(PassStages {
        vertex,
        fragment: fragment.transpose()?,
    })
}

/// The stages of the pass that writes the normal.
fn of_derived<'p>(
    made: &'p Result<Plan, String>,
    side: &'static str,
) -> Result<PassStages<'p>, String> {
    let plan = made.as_ref().map_err(Clone::clone)?;
    let pass = plan.passes.iter().find(|p| p.role == Role::Outputs);
    let found = pass.and_then(|pass| stages(pass, plan.program(pass)?, side).ok());
    found.ok_or_else(|| "the pass of its normal has no stages".to_owned())
}

impl Agreement {
    /// Whether every promise was proved or tried, and none is broken.
    pub fn holds(&self) -> bool {
        let mut promises = self.promises.iter();
        let is_held = |h: &PromiseResult| {
            !matches!(h.outcome, Outcome::Differs | Outcome::NotEvaluated { .. })
        };
        let is_note = |f: &Finding| f.class == Class::Variant;
        self.findings.iter().all(is_note) && promises.all(is_held)
    }

    /// The first reason why a promise was not evaluated, leaving out those listed in `accepted`.
    pub fn not_evaluated(&self, accepted: &[&str]) -> Option<&str> {
        let reasons = self.promises.iter().filter_map(|h| match &h.outcome {
            Outcome::NotEvaluated { why } => Some(why.as_str()),
            _ => None,
        });
        let mut reasons = reasons.filter(|why| !accepted.contains(why));
        reasons.next()
    }

    /// Whether no promise that defines the relation was proved or tried. For normals and
    /// velocities, only the promises about them count.
    pub fn is_nothing(&self) -> bool {
        let own = |h: &&PromiseResult| match self.relation {
            Relation::Normal => h.promise == "normals",
            Relation::Velocity => h.promise.starts_with("velocity"),
            _ => true,
        };
        let mut promises = self.promises.iter().filter(own);
        promises.all(|h| matches!(h.outcome, Outcome::NotEvaluated { .. }))
    }
}
