//! A transform is a pure function from a plan to a new plan, or to the reasons why it does not
//! apply.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use crate::budget::{Difference, or_infinite, unmeasured};
use crate::contract::Assumption;
use crate::guard::{Assumed, Guard};
use crate::plan::{Change, Plan};
use crate::program::Program;
use crate::rasterizer::Rasterizer;
use crate::{refusals, shared_binding};
use shader_text::refusals::RefusalInfo;
use shader_text::source::{Location, SourceMap};

/// The name of a pass and its description.
#[derive(Clone, Copy, Debug)]
pub struct PassInfo {
    /// Name of the pass, of its file and of its flag.
    pub name: &'static str,
    /// The description of the pass in one line.
    pub summary: &'static str,
    /// The paper or article that describes the method.
    pub source: &'static str,
    /// When to take it, and what to take instead; a clause that follows "where".
    pub when: &'static str,
    /// When it costs more than it gains.
    pub hurts: &'static str,
    /// Whether it reads the scene's numbers in [`Facts`].
    pub reads_scene: bool,
}

/// A recipe that shows a pass. Every list of passes or recipes in tests, searches and pages is made
/// of these.
#[derive(Clone, Copy, Debug)]
pub struct Example {
    /// Steps separated by commas, as on the command line. `BUDGET` stands for the user's budget and
    /// metric, `MOST` for the budget alone, of passes that know one metric.
    pub recipe: &'static str,
    pub uses: &'static [Use],
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Use {
    /// Applied to every fixture: the text becomes a snapshot, goes through other compilers, and is
    /// validated.
    Snapshot,
    /// As [`Use::Snapshot`], without the snapshot.
    Compile,
    /// Applied to every fixture and validated.
    Validate,
    /// Applied to fixtures with neutral code injected, and validated.
    Inject,
    /// Applied to a material with `material.fog` and validated.
    Keep,
    /// As [`Use::Keep`], then broken at random: validation has to notice.
    Break,
    /// Draws every scene: no bit may change, whatever ties there are. Refusals have to be expected.
    Exact,
    /// As [`Use::Exact`], without ties; a scene with ties has to be refused.
    ExactWithoutTies,
    /// As [`Use::Exact`], in the scenes that it does not refuse.
    ExactWhereApplied,
    /// Draws scenes with neutral code injected; its promise has to hold in this many pictures.
    Pictures(usize),
    /// Applied to random modules.
    Fuzz,
    /// Compared with the same operations in `f64`.
    Truth,
    /// `plan` tries it.
    Plan,
    /// `plan` tries it if the user gives a budget.
    PlanWithin,
    /// `explore` tries it as a way to shade fewer fragments.
    Cover,
    /// `explore` tries it as a way to compute less in each fragment.
    Simplify,
    /// Useful ahead of other passes: random recipes sort it to this place.
    Ahead(usize),
    /// `verify` draws it if the user names no variant.
    Verify,
    /// Draws one scene after each change of a value of its plan file: one change of each value has
    /// to be refused or to change the picture.
    Mutate,
    /// Timed on made shaders of growing size.
    Growth,
    /// The example of the pass's page, applied to this WGSL file of `fixtures`.
    Page(&'static str),
    /// The picture of the pass's page.
    Picture {
        /// Scene and options of `preshade verify`, without the recipe.
        scene: &'static str,
        /// A sentence about the picture.
        caption: &'static str,
        /// Rows of the sheet to show; the second is the shading count.
        rows: u32,
    },
}

/// The result of a pass that applied.
#[derive(Clone, Debug)]
pub struct Outcome {
    pub plan: Plan,
    pub change: Change,
    /// Candidates that the pass did not take, the most expensive first.
    pub left: Vec<Left>,
}

/// A pass did not apply.
#[derive(Clone, Debug, Default)]
pub struct Refused {
    /// Every reason; there is at least one.
    pub refusals: Vec<Refusal>,
    /// Candidates that the pass looked at, the most expensive first.
    pub left: Vec<Left>,
}

impl Refused {
    pub fn first(self) -> Box<Refusal> {
        let first = self.refusals.into_iter().next();
        Box::new(first.unwrap_or_else(|| {
            Refusal::new(
                "",
                &refusals::REFUSED,
                "the pass does not apply",
                "see `preshade explain`",
            )
        }))
    }
}

impl From<Vec<Refusal>> for Refused {
    fn from(refusals: Vec<Refusal>) -> Self {
        Self {
            refusals,
            left: Vec::new(),
        }
    }
}

impl From<Box<Refusal>> for Refused {
    fn from(refusal: Box<Refusal>) -> Self {
        vec![*refusal].into()
    }
}

impl From<(Box<Refusal>, Vec<Left>)> for Refused {
    fn from((refusal, left): (Box<Refusal>, Vec<Left>)) -> Self {
        Self {
            refusals: vec![*refusal],
            left,
        }
    }
}

/// A candidate that a pass did not take.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Left {
    /// The author's name for it, or a description.
    pub name: String,
    /// Why the pass did not take it.
    pub reason: String,
    /// Static cost of computing it, with everything that it depends on.
    pub cost: f64,
    /// Where it is in the author's source.
    pub location: Option<Location>,
}

/// A pass does not apply. A normal outcome, not an error.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Refusal {
    /// Name of the pass.
    pub pass: String,
    /// Stable code, `blended` say.
    pub code: String,
    /// Why not.
    pub reason: String,
    /// What would make it legal.
    pub remedy: String,
    /// Where in the author's source.
    pub location: Option<Location>,
}

impl Refusal {
    /// A refusal that points at no place.
    pub fn new(
        pass: &str,
        info: &RefusalInfo,
        reason: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self {
            pass: pass.to_owned(),
            code: info.code.to_owned(),
            reason: reason.into(),
            remedy: remedy.into(),
            location: None,
        }
    }

    /// The same refusal, pointing at a span.
    #[must_use]
    pub fn at(mut self, sources: &SourceMap, span: naga::Span) -> Self {
        self.location = sources.locate(span);
        self
    }

    /// The refusal if our own transform built something that does not validate. It is reported as a
    /// bug.
    pub fn bug(pass: &str, what: impl std::fmt::Display) -> Self {
        Self::new(
            pass,
            &refusals::INTERNAL,
            format!("the transform built an invalid program ({what}); this is a bug in preshade"),
            "please report it with the shader; the original is kept",
        )
    }
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}[{}]: {}", self.pass, self.code, self.reason)
    }
}

/// Measured evidence as plain data. A pass reads it, never gathers it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Facts {
    /// Pixels (samples) at which two or more surviving fragments share the winning depth, over
    /// every camera measured; `None`: not measured.
    pub depth_ties: Option<u64>,
    /// The same with fragments counted that the material discards: those that would tie if the
    /// discard were gone.
    #[serde(default)]
    pub undiscarded_depth_ties: Option<u64>,
    /// Pixels (samples) whose final depth is exactly that of the near plane, in the first frame of
    /// every camera.
    #[serde(default)]
    pub near_plane_pixels: Option<u64>,
    /// Vertices shaded for each fragment shaded, over every camera measured.
    #[serde(default)]
    pub vertices_per_fragment: Option<f64>,
    /// Uniforms that follow the camera or the time, or change between the scene's frames in another
    /// way; `None`: not looked at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub changing: Option<Vec<Changing>>,
    /// Between which numbers the varyings and the constants of the draw lie; empty where that was
    /// not looked at.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ranges: Vec<SourceRange>,
    /// Numbers that no frame changes, by material; empty where that was not looked at.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub constants: Vec<Constant>,
    /// What carrying each value of a fragment stage alone does to the picture.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub frequencies: Vec<Frequency>,
    /// What the adapter does that no language decides; `None`: not looked at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rasterizer: Option<Rasterizer>,
    /// Textures that no pass of the frame writes before the material is drawn; empty where that was not looked at.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub steady_textures: Vec<MaterialTexture>,
    /// Textures with a texel that is infinite or NaN; empty where that was not looked at.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub infinite_textures: Vec<MaterialTexture>,
    /// Materials with a draw whose viewport has another depth range than 0 to 1; empty where that was
    /// not looked at.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub narrow_depths: Vec<String>,
    /// Branches with a way that no draw took; `None`: not looked at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub undrawn: Option<Vec<Undrawn>>,
}

impl Facts {
    /// The evidence for a budget: pictures of a scene, or none. A scene that was read but not
    /// drawn, or that preshade made up, is no evidence.
    pub fn evidence(&self) -> Assumption {
        let is_drawn = self.depth_ties.is_some()
            || self.vertices_per_fragment.is_some()
            || !self.frequencies.is_empty();
        match is_drawn && self.undrawn.is_some() {
            true => Assumption::MeasuredScene,
            false => Assumption::NotMeasured,
        }
    }

    /// The ranges of a material's numbers. `is_rebuilt`: an earlier step may have given its varyings
    /// other locations than the author's, which these are.
    pub fn ranges_of(&self, material: &str, is_rebuilt: bool) -> Vec<SourceRange> {
        let own = self.ranges.iter().filter(|r| r.material == material);
        let own = own.filter(|r| !is_rebuilt || !matches!(r.source, Source::Varying { .. }));
        own.cloned().collect()
    }

    /// The values by which the draws of a material took the ways they took.
    pub fn drawn(&self, material: &str) -> Guard {
        let own = self.undrawn.iter().flatten();
        let own = own.filter(|u| u.material == material);
        let each = own.map(|u| Guard {
            values: u.values.clone(),
        });
        each.fold(Guard::default(), Guard::and)
    }
}

/// A branch, switch or loop of a draw whose condition depends on uniforms alone, and of which at
/// least one way was not taken by any draw in any frame. Nothing is known about the picture there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Undrawn {
    /// Name of the material.
    pub material: String,
    /// The author's text of the condition.
    pub condition: String,
    /// Where the statement begins.
    pub location: Option<Location>,
    /// The values that the condition depends on, with bounds within which every draw takes a way
    /// that was drawn.
    pub values: Vec<Assumed>,
}

/// A texture of a material.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
pub struct MaterialTexture {
    /// Name of the material.
    pub material: String,
    /// `@group`.
    pub group: u32,
    /// `@binding`.
    pub binding: u32,
}

/// A uniform, or a member of one, that is not the same in all frames.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
pub struct Changing {
    /// Name of the material.
    pub material: String,
    /// `@group`.
    pub group: u32,
    /// `@binding`.
    pub binding: u32,
    /// Name of the member; `None` where the uniform is no struct.
    pub member: Option<String>,
}

/// A number that is the same, or lies within bounds, in all draws of a material and in every frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Constant {
    /// Name of the material.
    pub material: String,
    /// The number.
    pub value: Assumed,
}

/// Where a fragment stage's numbers come from.
#[derive(
    Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Source {
    /// What the vertex stage writes.
    Varying {
        /// `@location`.
        location: u32,
    },
    /// A uniform or a storage buffer, or a member of one.
    Buffer {
        /// `@group`.
        group: u32,
        /// `@binding`.
        binding: u32,
        /// Name of the member; `None` where the variable is no struct.
        member: Option<String>,
    },
}

/// The least and the largest float of a source, all components together, over the frames of a
/// scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SourceRange {
    /// Name of the material.
    pub material: String,
    /// The source.
    pub source: Source,
    /// The least.
    pub low: f32,
    /// The largest.
    pub high: f32,
    /// The numbers of each component, or of all together where it is neither a number nor a vector;
    /// empty where that was not looked at.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub components: Vec<Numbers>,
}

/// Numbers of one component over the draws and frames of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Numbers {
    /// The least.
    pub low: f32,
    /// The largest.
    pub high: f32,
    /// The one next to 0 that is not 0, without its sign; 0: all are 0.
    pub least: f32,
}

impl Numbers {
    pub fn one(number: f32) -> Self {
        Self {
            low: number,
            high: number,
            least: number.abs(),
        }
    }

    #[must_use]
    pub fn or(self, other: Self) -> Self {
        let least = match (self.least, other.least) {
            (0.0, least) | (least, 0.0) => least,
            (a, b) => a.min(b),
        };
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            least,
        }
    }
}

/// How well one value of a fragment stage is interpolated: the worst of the pictures that were
/// drawn with it, and it alone, carried from the vertices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Frequency {
    /// Name of the material.
    pub material: String,
    /// The value: the id of one of `hoist`'s candidates.
    pub value: String,
    /// The author's name for it, or what it is.
    pub name: String,
    /// Static cost that carrying it would save a fragment, transport apart.
    pub cost: f64,
    /// How far it is from what is interpolated of it, itself, over the scene's triangles; `None`
    /// where that was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interpolation: Option<Interpolation>,
    /// How far it can be, proved; `None` where that was not tried.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bound: Option<Bound>,
    /// Largest difference of a colour channel at the output.
    pub max_abs: f64,
    /// Mean of FLIP over the picture.
    pub flip_mean: f64,
    /// Its 99th percentile.
    pub flip_p99: f64,
    /// Its largest mean over a tile. Infinite where an older version measured.
    #[serde(default = "unmeasured", deserialize_with = "or_infinite")]
    pub flip_tile: f64,
    /// Pixels that are NaN or infinite with it and were not without.
    pub nan_pixels: u64,
    /// Where it is in the author's source.
    pub location: Option<Location>,
}

impl Difference for Frequency {
    fn by_metric(&self) -> [f64; 4] {
        [self.flip_mean, self.flip_p99, self.flip_tile, self.max_abs]
    }
}

impl Frequency {
    /// Whether no measurement found NaN or infinity: not the value itself at a vertex or between
    /// them, and no pixel drawn with it. A target of fixed point shows no such pixel.
    pub fn is_finite(&self) -> bool {
        self.nan_pixels == 0 && self.interpolation.is_none_or(|i| i.not_finite == 0)
    }
}

/// How far a value is from its interpolation over the triangles of a scene's meshes, wherever the
/// camera stands: evaluated by the adapter at the corners and at points between them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Interpolation {
    /// Largest difference of a component, in the value's own unit.
    pub max: f64,
    /// Mean difference of that component.
    pub mean: f64,
    /// Largest less least of that component over all points: what the differences are to be held
    /// against.
    pub range: f64,
    /// Points, corners among them, at which it or its interpolation is NaN or infinite: the
    /// differences are of the others.
    pub not_finite: u64,
    /// Points between corners that were evaluated, in all frames together.
    pub points: u64,
}

/// How far a value can be from its interpolation anywhere in a triangle: see
/// [`mod@naga_interp::bound`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Bound {
    /// By `max` and `roundings` together at most, in the value's own unit, in the frames that were
    /// looked at.
    Proved {
        /// The bound in real numbers.
        max: f64,
        /// What an adapter's roundings, as WGSL allows them, make it more by at most.
        #[serde(default)]
        roundings: f64,
        /// Triangles that it was proved for, in all frames together.
        triangles: u64,
        /// Triangles there are in those frames: where they are more, they were taken evenly.
        of: u64,
        /// Frames it was proved for: the first and the middle one of every camera's path.
        #[serde(default)]
        frames: u64,
    },
    /// No bound was found for some triangle.
    Unbounded {
        /// Why, in words.
        why: String,
    },
}

impl Facts {
    /// The facts of a measured scene without ties.
    pub fn without_ties() -> Self {
        Self {
            depth_ties: Some(0),
            undiscarded_depth_ties: Some(0),
            near_plane_pixels: Some(0),
            ..Self::default()
        }
    }
}

/// A transform from plan to plan.
pub trait Pass {
    type Params: Serialize + DeserializeOwned + JsonSchema + Default;

    const INFO: PassInfo;

    /// Its own refusals; those of shared analyses are in `preshade_passes::analysis::refusals`.
    const REFUSALS: &'static [RefusalInfo];

    /// Recipes that show the pass.
    const EXAMPLES: &'static [Example];

    /// A parameter that names nothing in the material. If no requested material has the name, it is
    /// a mistake of the recipe's author, and not a refusal.
    fn misnamed(_plan: &Plan, _params: &Self::Params) -> Option<Misnamed> {
        None
    }

    /// The facts about the variant that its validation needs in addition to the contract.
    fn expected(_params: &Self::Params) -> Expected {
        Expected::default()
    }

    /// Applies the pass: value in, value out.
    ///
    /// # Errors
    /// Every reason why it does not apply; `plan` is untouched.
    fn run(plan: &Plan, facts: &Facts, params: &Self::Params) -> Result<Outcome, Refused>;
}

/// Facts about a step that `preshade-validate` needs in addition to its contract.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Expected {
    /// The step replaces varyings of the author, so arbitrary numbers cannot stand for them.
    pub replaces_varyings: bool,
    /// The step computes values at vertices and interpolates them: at a vertex they are the
    /// author's.
    pub interpolates: bool,
    /// The step folds float operations: it keeps the values of ordinary numbers only.
    pub folds_floats: bool,
    /// The step approximates the implicit levels of lookups only.
    pub approximates_levels: bool,
    /// The step draws a diagnostic picture, whose colours are others on purpose.
    pub is_diagnostic: bool,
}

/// A name among the parameters that a material lacks, or a value that the named item cannot have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Misnamed {
    /// The mistake, in words.
    pub message: String,
    pub name: String,
    /// The names that exist; empty if the name is not the mistake.
    pub known: Vec<String>,
}

/// Parameters that do not fit a pass.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{pass}: {message}")]
pub struct ParamError {
    pub pass: String,
    /// The parameter that does not fit, with the allowed values.
    pub message: String,
}

/// A [`Pass`] with its parameter type erased to JSON, for recipes, command lines and build scripts.
pub trait AnyPass: Sync {
    fn info(&self) -> &'static PassInfo;
    fn refusals(&self) -> &'static [RefusalInfo];
    fn examples(&self) -> &'static [Example];
    /// JSON schema of its parameters.
    fn schema(&self) -> serde_json::Value;
    /// Parameters in full: those given, defaults for the rest.
    ///
    /// # Errors
    /// Unknown names, values out of range or of another type.
    fn complete(&self, params: &serde_json::Value) -> Result<serde_json::Value, ParamError>;
    /// As [`Pass::misnamed`]; nothing of parameters that do not fit the pass.
    fn misnamed(&self, plan: &Plan, params: &serde_json::Value) -> Option<Misnamed>;
    /// As [`Pass::expected`]; nothing of parameters that do not fit the pass.
    fn expected(&self, params: &serde_json::Value) -> Expected;
    /// As [`Pass::run`]; parameters that do not fit are refused.
    ///
    /// # Errors
    /// As [`Pass::run`].
    fn run(
        &self,
        plan: &Plan,
        facts: &Facts,
        params: &serde_json::Value,
    ) -> Result<Outcome, Refused>;
}

/// Carries a [`Pass`] as a value; the pass itself is only a type.
pub struct Erased<P>(pub std::marker::PhantomData<fn() -> P>);

impl<P: Pass + 'static> Erased<P> {
    pub const NEW: Self = Self(std::marker::PhantomData);

    fn params(params: &serde_json::Value) -> Result<P::Params, ParamError> {
        let params = if params.is_null() {
            serde_json::json!({})
        } else {
            params.clone()
        };
        serde_json::from_value(params).map_err(|e| ParamError {
            pass: P::INFO.name.to_owned(),
            message: e.to_string(),
        })
    }
}

impl<P: Pass + 'static> AnyPass for Erased<P> {
    fn info(&self) -> &'static PassInfo {
        &P::INFO
    }

    fn refusals(&self) -> &'static [RefusalInfo] {
        P::REFUSALS
    }

    fn examples(&self) -> &'static [Example] {
        P::EXAMPLES
    }

    fn schema(&self) -> serde_json::Value {
        schemars::schema_for!(P::Params).to_value()
    }

    fn complete(&self, params: &serde_json::Value) -> Result<serde_json::Value, ParamError> {
        serde_json::to_value(Self::params(params)?).map_err(|e| ParamError {
            pass: P::INFO.name.to_owned(),
            message: e.to_string(),
        })
    }

    fn misnamed(&self, plan: &Plan, params: &serde_json::Value) -> Option<Misnamed> {
        P::misnamed(plan, &Self::params(params).ok()?)
    }

    fn expected(&self, params: &serde_json::Value) -> Expected {
        Self::params(params)
            .map(|params| P::expected(&params))
            .unwrap_or_default()
    }

    fn run(
        &self,
        plan: &Plan,
        facts: &Facts,
        params: &serde_json::Value,
    ) -> Result<Outcome, Refused> {
        let params = Self::params(params).map_err(|e| {
            vec![Refusal::new(
                P::INFO.name,
                &refusals::PARAMETERS,
                e.to_string(),
                format!("see `preshade passes {}`", P::INFO.name),
            )]
        })?;
        let mut outcome = P::run(plan, facts, &params).map_err(|refused| {
            shared_binding(refused, plan, |apart| P::run(apart, facts, &params))
        })?;
        if let Some(value) = outcome.plan.guard.as_ref().and_then(Guard::contradicted) {
            let reason = format!(
                "the plan's guard already excludes the value of `{}` that the pass assumes",
                value.name
            );
            let remedy = "leave one of the steps out, or give values that both allow";
            return Err(vec![Refusal::new(
                P::INFO.name,
                &refusals::CONTRADICTION,
                reason,
                remedy,
            )]
            .into());
        }
        let first = plan.steps.len();
        hold_budgets(&mut outcome.plan, first, facts);
        tell_unguarded(&mut outcome.plan, facts);
        match is_founded(plan, &outcome.plan) {
            true => Ok(outcome),
            false => Err(vec![Refusal::bug(
                P::INFO.name,
                "it promises something of another shader and assumes nothing",
            )]
            .into()),
        }
    }
}

/// Whether each new step assumes something, or leaves the main pass as it was: then there is
/// nothing to assume.
fn is_founded(before: &Plan, after: &Plan) -> bool {
    let mut new = after.steps.iter().skip(before.steps.len());
    let is_same = || match (before.main(), after.main()) {
        (Some(a), Some(b)) => match (before.program(a), after.program(b)) {
            (Some(of_a), Some(of_b)) => a == b && std::ptr::eq(of_a.module(), of_b.module()),
            _ => false,
        },
        _ => false,
    };
    new.all(|step| !step.contract.given().is_empty()) || is_same()
}

/// Bases the budgets of the steps from `first` on the measurements. The guard limits the host to
/// the drawn branches.
fn hold_budgets(plan: &mut Plan, first: usize, facts: &Facts) {
    let new = plan.steps.iter().skip(first);
    if new.clone().all(|step| step.contract.budgets().is_empty()) {
        return;
    }
    let drawn = facts.drawn(&plan.material);
    let guard = plan.guard.clone().unwrap_or_default().and(drawn.clone());
    let mut given = vec![facts.evidence()];
    if guard.contradicted().is_some() {
        // The plan assumes other values than those that were drawn.
        given = vec![Assumption::NotMeasured];
    } else if !drawn.values.is_empty() {
        given.push(Assumption::ValuesOfTheGuard);
        plan.guard = Some(guard);
    }
    plan.contract.base_budgets_on(&given);
    for step in plan.steps.iter_mut().skip(first) {
        step.contract.base_budgets_on(&given);
    }
}

/// Adds a note if a value of the scene is outside the guard in every draw.
fn tell_unguarded(plan: &mut Plan, facts: &Facts) {
    let values = plan.guard.iter().flat_map(|guard| &guard.values);
    let is_outside = |seen: &Assumed, guarded: &Assumed| {
        seen.place == guarded.place
            && seen.ty == guarded.ty
            && seen.bounds.is_apart_from(&guarded.bounds)
    };
    let own = || {
        facts
            .constants
            .iter()
            .filter(|c| c.material == plan.material)
    };
    let found = values.flat_map(|guarded| {
        let outside = own()
            .map(|c| &c.value)
            .filter(|seen| is_outside(seen, guarded));
        outside.map(move |seen| {
            format!("the scene has {seen}, and the guard wants {guarded}: the original is drawn")
        })
    });
    let new: Vec<String> = found.filter(|note| !plan.notes.contains(note)).collect();
    plan.notes.extend(new);
}

/// Names the cause if a variant is invalid because one stage has both variables of a binding or of
/// the immediate data: with separate variables, it is valid.
fn shared_binding(
    mut refused: Refused,
    plan: &Plan,
    run: impl Fn(&Plan) -> Result<Outcome, Refused>,
) -> Refused {
    let is_internal = |r: &Refusal| r.code == refusals::INTERNAL.code;
    let is_bug = |refused: &Refused| refused.refusals.iter().any(is_internal);
    let shared = || {
        let mut programs = plan.programs.values();
        programs.find_map(|p| shared_binding::two_in_one_place(p.module()))
    };
    if !is_bug(&refused) {
        return refused;
    }
    let Some((span, reason, remedy)) = shared() else {
        return refused;
    };
    if run(&shared_binding::separated(plan)).is_err_and(|refused| is_bug(&refused)) {
        return refused;
    }
    for refusal in refused.refusals.iter_mut().filter(|r| is_internal(r)) {
        let code = &refusals::SHARED_BINDING;
        let named = Refusal::new(&refusal.pass, code, reason.clone(), remedy);
        let mut sources = plan.programs.values().map(Program::sources);
        *refusal = match sources.next() {
            Some(sources) => named.at(sources, span),
            None => named,
        };
    }
    refused
}
