//! Translation validation (Pnueli, Siegel and Singerman 1998; Necula 2000): what a variant promises of its stages, held against the original's after it was made, without a GPU.
//!
//! Each promise is first tried to be proved: where the slices that decide it have one canonical form, or where both stages, run on terms ([`term`]), end in the same ones. What cannot be proved
//! is run on numbers, random and adversarial ones ([`inputs`]), until it is seen to be broken or has agreed often enough. A counterexample says where the two go apart first.
//!
//! What is held against what follows from the plan: a pass with the author's geometry gives the author's positions; a pre-pass, and a pass that writes ids, keeps and discards the same fragments;
//! the pass that shades gives the same colours, as far as the plan's contract says so: the same bits at the vertices whatever was hoisted, inside a triangle where it is `Exact`, within a step of
//! the target where it is `Rounding`. A budget is about a picture, which nobody draws here: that is `verify`'s to say. A guard's values are as it wants them.
//!
//! Two things are the interpreter's word for an adapter's. An operation has one result, wherever it stands. And a texel is a function of where it is looked up, not of the level that a
//! lookup takes by itself.

use std::cell::RefCell;
use std::collections::BTreeMap;

use naga::{Expression, Literal, ShaderStage, Span};

use crate::contract::Contract;
use crate::evaluate::{Stuck, Traced, Value};
use crate::graph::{FunctionId, Graph};
use crate::guard::{Guard, Place as Assumed};
use crate::hoist;
use crate::place::{self, PositionInvariance};
use crate::plan::{BindingSource, ClearValue, GpuPass, Plan, Role};
use crate::program::Program;
use crate::slice::{self, Criterion, OutputFilter};
use crate::state::{CompareFunction, DepthDirection};

pub mod compare;
pub mod inputs;
pub mod stage;
pub mod term;
mod verdict;
pub mod world;

use compare::{Colors, Depths, Discards, Rule, Stores, text};
use inputs::{Inputs, Profile};
use stage::{POSITION, Slot, Stage};
use world::{Place, Stages, World};

pub use verdict::{Counterexample, Diverged, Proof, Verdict};

/// A promise, and what became of it.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct Check {
    /// Role of the pass.
    pub role: Role,
    /// What is promised, in words.
    pub promise: String,
    /// What became of it.
    pub verdict: Verdict,
}

/// How hard to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Inputs that each promise is tried on.
    pub inputs: u64,
    /// The first of their seeds.
    pub seed: u64,
    /// Steps of the interpreter before it gives up on an input.
    pub steps: u64,
    /// Paths that a proof may have.
    pub paths: u64,
}

impl Default for Effort {
    fn default() -> Self {
        Self {
            inputs: 240,
            seed: 0,
            steps: 100_000,
            paths: 64,
        }
    }
}

/// Holds a variant against the original it was made of.
pub fn validate(original: &Plan, variant: &Plan, effort: &Effort) -> Vec<Check> {
    let mut checks = Vec::new();
    let mut not = |role: Role, promise: &str, why: String| {
        checks.push(Check {
            role,
            promise: promise.to_owned(),
            verdict: Verdict::NotEvaluable { why },
        });
    };
    let Some((main, program)) = original
        .main()
        .and_then(|p| Some((p, original.program(p)?)))
    else {
        not(
            Role::Main,
            "anything",
            "the original has no main pass".to_owned(),
        );
        return checks;
    };
    for pass in &variant.compute {
        let why = "a compute pass is not run by the interpreter; `verify` draws what it makes";
        not(
            Role::Main,
            &format!("`{}`", pass.entry_point),
            why.to_owned(),
        );
    }
    let mut found = Vec::new();
    for pass in &variant.passes {
        match (pass.role, variant.program(pass)) {
            (Role::Classify | Role::Clear, _) => {}
            (Role::Resolve, _) => not(
                pass.role,
                "the colours",
                "it reads ids and buffers of the frame, which the interpreter does not fill; `verify` draws it".to_owned(),
            ),
            (_, None) => not(pass.role, "anything", "it has no program".to_owned()),
            (_, Some(other)) => {
                let other = with_overrides(other, variant.guard.as_ref());
                let own = with_overrides(program, variant.guard.as_ref());
                match Pair::new(variant, (main, &own), (pass, &other), effort) {
                    Ok(pair) => found.extend(pair.checks()),
                    Err(why) => not(pass.role, "positions and colours", why),
                }
            }
        }
    }
    checks.extend(found);
    checks
}

/// The program with values for the overrides that have none: those a guard has, and 1.
fn with_overrides(program: &Program, guard: Option<&Guard>) -> Program {
    let mut module = program.module().clone();
    let handles: Vec<_> = module.overrides.iter().map(|(h, _)| h).collect();
    for handle in handles {
        let name = module.overrides[handle].name.clone().unwrap_or_default();
        let assumed = guard.into_iter().flat_map(|g| &g.values);
        let fixed = assumed
            .filter(|a| a.place == Assumed::Override { name: name.clone() })
            .map(|a| a.bounds.low)
            .next();
        let number = match (fixed, module.overrides[handle].init) {
            (Some(number), _) => number,
            (None, None) => 1.0,
            (None, Some(_)) => continue,
        };
        let literal = match module.types[module.overrides[handle].ty].inner.scalar() {
            Some(naga::Scalar::BOOL) => Literal::Bool(number != 0.0),
            Some(naga::Scalar::I32) => Literal::I32(number as i32),
            Some(naga::Scalar::U32) => Literal::U32(number as u32),
            Some(naga::Scalar::F32) => Literal::F32(number as f32),
            _ => continue,
        };
        let init = module
            .global_expressions
            .append(Expression::Literal(literal), Span::UNDEFINED);
        module.overrides[handle].init = Some(init);
    }
    program
        .with_module(module)
        .unwrap_or_else(|_| program.clone())
}

/// A pass of a variant beside the original's main pass.
struct Pair<'a> {
    variant: &'a Plan,
    pass: &'a GpuPass,
    original: Stages<'a>,
    other: Stages<'a>,
    effort: &'a Effort,
    direction: DepthDirection,
    /// What the attachments that the pass reads are cleared to, by binding.
    attachments: BTreeMap<(u32, u32), ClearValue>,
}

fn stages<'a>(pass: &GpuPass, program: &'a Program) -> Result<Stages<'a>, String> {
    let vertex =
        Stage::new(program, ShaderStage::Vertex, &pass.vertex).ok_or("it has no vertex stage")?;
    let fragment = match &pass.fragment {
        None => None,
        Some(name) => Some(
            Stage::new(program, ShaderStage::Fragment, name).ok_or("it has no fragment stage")?,
        ),
    };
    Ok(Stages { vertex, fragment })
}

impl<'a> Pair<'a> {
    fn new(
        variant: &'a Plan,
        (main, program): (&GpuPass, &'a Program),
        (pass, other): (&'a GpuPass, &'a Program),
        effort: &'a Effort,
    ) -> Result<Self, String> {
        if !pass.geometry.is_as_given() {
            return Err("its vertices are new ones, which the interpreter does not make; `verify` draws them".to_owned());
        }
        let mut attachments = BTreeMap::new();
        for binding in &pass.bindings {
            match &binding.source {
                BindingSource::Author => {}
                BindingSource::Attachment { name } => {
                    let clear = variant.attachment(name).map(|a| a.clear);
                    let clear = clear.ok_or("it reads an attachment that is not there")?;
                    attachments.insert((binding.group, binding.binding), clear);
                }
                _ => return Err("it reads buffers of the draw's geometry, which the interpreter does not fill; `verify` draws it".to_owned()),
            }
        }
        let compare = main.depth.as_ref().map(|d| d.compare);
        Ok(Self {
            variant,
            pass,
            original: stages(main, program)?,
            other: stages(pass, other)?,
            effort,
            direction: compare
                .and_then(CompareFunction::direction)
                .unwrap_or_default(),
            attachments,
        })
    }

    fn checks(&self) -> Vec<Check> {
        let check = |promise: &str, verdict| Check {
            role: self.pass.role,
            promise: promise.to_owned(),
            verdict,
        };
        let mut checks = vec![check(
            "positions",
            self.verdict(&[Place::Vertex], Colors::Ignored),
        )];
        let corners = [Place::Corner(0), Place::Corner(1), Place::Corner(2)];
        if self.pass.role != Role::Main {
            let colors = match self.pass.multisample.alpha_to_coverage {
                true => Colors::Alpha,
                false => Colors::Ignored,
            };
            let places = [&corners[..1], &[Place::Inside]].concat();
            checks.push(check(
                "what it discards, and depths",
                self.verdict(&places, colors),
            ));
            return checks;
        }
        if self.inverts() {
            let why = "`mode=invert` draws what would be dropped, on purpose";
            checks.push(check("colours", not_evaluated(why)));
            return checks;
        }
        let told = |colors: &Result<Colors, String>| match colors {
            Ok(colors) => *colors,
            Err(_) => Colors::Ignored,
        };
        let [at_vertices, inside] = self.colors();
        for (promise, kept, places, colors) in [
            (
                "colours, depths and discards at vertices",
                "depths and discards at vertices",
                &corners[..],
                &at_vertices,
            ),
            (
                "colours, depths and discards inside triangles",
                "depths and discards inside triangles",
                &[Place::Inside][..],
                &inside,
            ),
        ] {
            let promise = if colors.is_ok() { promise } else { kept };
            checks.push(check(promise, self.verdict(places, told(colors))));
            if let Err(why) = colors {
                let what = match places.len() {
                    1 => "colours inside triangles",
                    _ => "colours at vertices",
                };
                checks.push(check(what, not_evaluated(why)));
            }
        }
        if self.has_the_authors_varyings() {
            checks.push(check(
                "the fragment stage, of any varyings",
                self.verdict(&[Place::Anywhere], told(&at_vertices)),
            ));
        }
        checks
    }

    fn steps(&self, pass: &str) -> impl Iterator<Item = &'a crate::plan::Step> {
        self.variant.steps.iter().filter({
            let pass = pass.to_owned();
            move |step| step.pass == pass
        })
    }

    fn stores(&self) -> Stores {
        match self.pass.role {
            Role::Main => Stores::Same,
            _ => Stores::Ignored,
        }
    }

    fn inverts(&self) -> bool {
        self.steps("early-discard")
            .any(|s| s.params.get("mode").and_then(|m| m.as_str()) == Some("invert"))
    }

    /// Whether a varying is what it was in the original, so that any number may stand for it.
    fn has_the_authors_varyings(&self) -> bool {
        let assumed = self.variant.guard.iter().flat_map(|g| &g.values);
        let of_vertices = assumed
            .filter(|a| matches!(a.place, Assumed::Attribute { .. }))
            .count();
        let rebuilt = ["hoist", "tessellate", "visibility-buffer"];
        of_vertices == 0 && rebuilt.iter().all(|pass| self.steps(pass).next().is_none())
    }

    /// What is promised of the colours at vertices and inside triangles, or why that is not looked at.
    fn colors(&self) -> [Result<Colors, String>; 2] {
        let mut promised: [Result<Colors, String>; 2] = [Ok(Colors::Bits), Ok(Colors::Bits)];
        let budget = |metric: &str, budget: f64| {
            Err(format!(
                "they may be off by {budget} ({metric}) in the picture, and nobody draws it here: `verify` does"
            ))
        };
        for step in &self.variant.steps {
            let is_moved = step.pass == "hoist";
            match &step.contract {
                Contract::Exact { .. } => {}
                Contract::Rounding { .. } if is_moved => {
                    let is_srgb = |t: &crate::state::ColorTarget| t.format.ends_with("-srgb");
                    let most = match self.pass.targets.iter().flatten().any(is_srgb) {
                        true => hoist::MOST_ROUNDING / hoist::STEEPEST_SRGB,
                        false => hoist::MOST_ROUNDING,
                    };
                    let of_scene = step
                        .contract
                        .given()
                        .contains(&crate::contract::Assumption::NumbersOfTheScene);
                    promised[1] = match (&promised[1], of_scene) {
                        (Err(why), _) => Err(why.clone()),
                        (Ok(_), true) => {
                            Err("how far they may be off rests on the numbers of a scene"
                                .to_owned())
                        }
                        (Ok(_), false) => Ok(Colors::Within(most)),
                    };
                }
                Contract::Rounding { .. } => {
                    for promised in &mut promised {
                        if *promised == Ok(Colors::Bits) {
                            *promised = Ok(Colors::Numbers);
                        }
                    }
                }
                // Of the level that it takes by itself a texel is not made here.
                Contract::Approximate { .. } if step.pass == "early-discard" => {}
                Contract::Approximate {
                    metric,
                    budget: most,
                    ..
                } => {
                    promised[1] = budget(metric, *most);
                    if !is_moved {
                        promised[0] = budget(metric, *most);
                    }
                }
                Contract::Budgets { .. } => {
                    promised = [budget("several", 0.0), budget("several", 0.0)];
                }
            }
        }
        promised
    }

    fn rule(&self, place: Place, colors: Colors, inputs: Option<&Inputs>) -> (Rule, Attached) {
        if place == Place::Vertex {
            return (Rule::Vertices, Attached::new());
        }
        let mut attached = Attached::new();
        let mut discards = Discards::Same;
        let depth = self.pass.depth.as_ref();
        let is_equal = depth.is_some_and(|d| d.compare == CompareFunction::Equal && !d.write);
        let has_prepass = self.variant.passes.iter().any(|p| p.role == Role::Prepass);
        if self.pass.role == Role::Main && is_equal && has_prepass {
            discards = Discards::LeftToEqual;
        }
        if let Some(inputs) = inputs {
            for (at, clear) in &self.attachments {
                let texel = match clear {
                    ClearValue::Depth(clear) => {
                        let fragment = self.other.fragment.map(|f| (f.module(), f.inputs()));
                        let [own, other] = match &fragment {
                            Some((module, found)) => {
                                let is_position = |io: &&crate::reflect::Io| {
                                    io.binding.as_ref().map(Slot::of) == Some(POSITION)
                                };
                                let io = found.iter().find(is_position);
                                world::depths(inputs, module, io, *clear)
                            }
                            None => [0.5, *clear],
                        };
                        discards = Discards::Hidden {
                            own,
                            other,
                            direction: self.direction,
                        };
                        [other; 4]
                    }
                    // Packed into colours: nothing was drawn there.
                    ClearValue::Color(color) => color.map(|c| c as f32),
                };
                attached.insert(*at, texel);
            }
        }
        let biased = self.pass.role == Role::Prepass
            && self
                .steps("depth-prepass")
                .chain(self.steps("early-discard"))
                .next()
                .is_some();
        let depths = match biased {
            true => Depths::NotNearer(self.direction),
            false => Depths::Same,
        };
        let rule = Rule::Fragments {
            colors,
            discards,
            depths,
            stores: self.stores(),
        };
        (rule, attached)
    }

    fn verdict(&self, places: &[Place], colors: Colors) -> Verdict {
        if places.iter().all(|p| self.slices_are_same(*p, colors)) {
            return Verdict::Proved { by: Proof::Slices };
        }
        // Numbers that a guard leaves open would be fixed.
        let guard = self.variant.guard.as_ref();
        let is_fixed = |g: &Guard| g.values.iter().all(|a| a.bounds.low == a.bounds.high);
        if guard.is_none_or(is_fixed)
            && let Some(paths) = places
                .iter()
                .try_fold(0, |sum, place| Some(sum + self.proved(*place, colors)?))
        {
            return Verdict::Proved {
                by: Proof::Terms { paths },
            };
        }
        self.tried(places, colors)
    }

    /// Whether what decides a promise is one slice in both: of the fragment stage, and of what the vertex stage gives it.
    fn slices_are_same(&self, place: Place, colors: Colors) -> bool {
        let mut vertex = vec![Criterion::Output(OutputFilter::Rasterization)];
        if place != Place::Vertex {
            let mut wanted = match colors {
                Colors::Bits | Colors::Numbers | Colors::Within(_) => {
                    vec![Criterion::Output(OutputFilter::All)]
                }
                Colors::Alpha => vec![
                    Criterion::Output(OutputFilter::FragDepth),
                    Criterion::Component(OutputFilter::Location(0), 3),
                ],
                Colors::Ignored => vec![Criterion::Output(OutputFilter::FragDepth)],
            };
            wanted.push(Criterion::Discard);
            let (Some(a), Some(b)) = (self.original.fragment, self.other.fragment) else {
                return false;
            };
            // A slice to outputs has no stores.
            if self.stores() == Stores::Same && (stores(a) || stores(b)) {
                return false;
            }
            let (Some(first), Some(second)) = (normal(a, &wanted), normal(b, &wanted)) else {
                return false;
            };
            if first != second {
                return false;
            }
            let read = first.read.iter().filter_map(|binding| match binding {
                naga::Binding::Location { location, .. } => Some(*location),
                naga::Binding::BuiltIn(_) => None,
            });
            vertex = read
                .map(|l| Criterion::Output(OutputFilter::Location(l)))
                .collect();
            if place == Place::Anywhere || vertex.is_empty() {
                return true;
            }
            vertex.push(Criterion::Output(OutputFilter::Rasterization));
        }
        let found = normal(self.original.vertex, &vertex);
        found.is_some() && found == normal(self.other.vertex, &vertex)
    }

    /// Over how many paths both give the same of every input; `None` where that is not seen.
    fn proved(&self, place: Place, colors: Colors) -> Option<u64> {
        if !self.attachments.is_empty() && place != Place::Vertex {
            return None;
        }
        let module = self.original.vertex.module();
        let inputs = Inputs::new(module, self.variant.guard.as_ref(), self.effort.seed);
        let (rule, _) = self.rule(place, colors, None);
        term::proved(self.effort.paths, || {
            let mut world = world::symbolic(module, &inputs);
            for assumed in self.variant.guard.iter().flat_map(|g| &g.values) {
                fix(module, &mut world, assumed);
            }
            let original = world.run(self.original, place, self.effort.steps, None)?;
            let variant = world.run(self.other, place, 4 * self.effort.steps, None)?;
            Ok(compare::difference(rule, &original, &variant).is_none())
        })
    }

    /// On numbers.
    fn tried(&self, places: &[Place], colors: Colors) -> Verdict {
        let module = self.original.vertex.module();
        let (mut agreed, mut why) = (0, None);
        for seed in self.effort.seed..self.effort.seed + self.effort.inputs {
            let inputs = Inputs::new(module, self.variant.guard.as_ref(), seed);
            // What a rounding may come to is said of ordinary numbers.
            let is_rounded = matches!(colors, Colors::Within(_) | Colors::Numbers);
            let colors = match is_rounded && inputs.profile != Profile::Ordinary {
                true => Colors::Ignored,
                false => colors,
            };
            let mut ended = true;
            for place in places {
                match self.try_one(&inputs, *place, colors) {
                    Tried::Same => {}
                    Tried::Differs(found) => return Verdict::Counterexample(found),
                    Tried::Endless => ended = false,
                    Tried::Stuck(stuck) => {
                        // What cannot be run for one input may be for another: a branch leads past it.
                        ended = false;
                        why.get_or_insert(stuck.to_string());
                    }
                }
            }
            agreed += u64::from(ended);
            // Something that is in the way of every input.
            if agreed == 0 && why.is_some() && seed - self.effort.seed > 24 {
                break;
            }
        }
        match (agreed, why) {
            (0, None) => not_evaluated("no input came to an end within the step limit"),
            (0, Some(why)) => Verdict::NotEvaluable { why },
            (inputs, _) => Verdict::Agreed { inputs },
        }
    }

    fn try_one(&self, inputs: &Inputs, place: Place, colors: Colors) -> Tried {
        let (rule, attached) = self.rule(place, colors, Some(inputs));
        let world = world::concrete(inputs, &attached);
        let original = match world.run(self.original, place, self.effort.steps, None) {
            Ok(original) => original,
            Err(Stuck::Steps) => return Tried::Endless,
            Err(stuck) => return Tried::Stuck(stuck),
        };
        let found = match world.run(self.other, place, 4 * self.effort.steps, None) {
            Ok(variant) => compare::difference(rule, &original, &variant),
            // What has come to its end comes to it in the variant too.
            Err(Stuck::Steps) => Some(compare::Difference {
                output: "its end".to_owned(),
                original: format!("reached within {} steps", self.effort.steps),
                variant: format!("not within {}", 4 * self.effort.steps),
            }),
            Err(stuck) => return Tried::Stuck(stuck),
        };
        match found {
            None => Tried::Same,
            Some(found) => {
                let first = self.first_diverging(&world, place);
                Tried::Differs(Box::new(Counterexample {
                    seed: inputs.seed,
                    inputs: self.said(inputs, place),
                    output: found.output,
                    original: found.original,
                    variant: found.variant,
                    first,
                }))
            }
        }
    }

    /// The inputs of the original's stages, in words.
    fn said(&self, inputs: &Inputs, place: Place) -> Vec<(String, String)> {
        let mut said = Vec::new();
        let vertex = self.original.vertex;
        for io in vertex.inputs() {
            let corners: &[usize] = match place {
                Place::Vertex => &[0],
                Place::Corner(_) | Place::Inside => &[0, 1, 2],
                Place::Anywhere => &[],
            };
            for corner in corners {
                if let Some(value) = inputs.attribute(vertex.module(), &io, *corner) {
                    let name = io.name.clone().unwrap_or_default();
                    said.push((format!("{name} of vertex {corner}"), text(&value)));
                }
            }
        }
        if place == Place::Inside {
            let weights = inputs.weights();
            said.push(("weights of the corners".to_owned(), format!("{weights:?}")));
        }
        if let Some(fragment) = self.original.fragment.filter(|_| place != Place::Vertex) {
            for io in fragment.inputs() {
                let is_own = matches!(io.binding, Some(naga::Binding::BuiltIn(_)));
                if !(is_own || place == Place::Anywhere) {
                    continue;
                }
                if let Some(value) = inputs.fragment(fragment.module(), &io) {
                    said.push((io.name.clone().unwrap_or_default(), text(&value)));
                }
            }
        }
        for (_, global) in vertex.module().global_variables.iter() {
            let at = global.binding.as_ref().map(|b| (b.group, b.binding));
            if let Some(value) = at.and_then(|at| inputs.resources.get(&at)) {
                said.push((global.name.clone().unwrap_or_default(), text(value)));
            }
        }
        said
    }

    /// The first value that both compute of one place in the source, and not to the same.
    fn first_diverging(&self, world: &World<'_, f32>, place: Place) -> Option<Diverged> {
        let traced = |stages| {
            let trace = RefCell::new(Vec::new());
            let _ = world.run(stages, place, 4 * self.effort.steps, Some(&trace));
            trace.into_inner()
        };
        let mut of_original: BTreeMap<Key, Vec<Value>> = BTreeMap::new();
        for traced in traced(self.original) {
            if let Some(key) = key(&traced) {
                of_original.entry(key).or_default().push(traced.value);
            }
        }
        let mut seen: BTreeMap<Key, usize> = BTreeMap::new();
        for traced in traced(self.other) {
            let Some(key) = key(&traced) else { continue };
            let Some(values) = of_original.get(&key) else {
                continue;
            };
            let at = seen.entry(key).or_default();
            let value = values.get(*at);
            *at += 1;
            let Some(value) = value else { continue };
            if compare::same_bits(value, &traced.value) {
                continue;
            }
            let sources = self.original.vertex.program.sources();
            let file = sources.file_of(traced.span);
            let range = traced.span.to_range();
            let written = file.zip(range).and_then(|(file, range)| {
                let base = file.base as usize;
                file.text.get(range.start - base..range.end - base)
            });
            return Some(Diverged {
                location: sources.locate(traced.span),
                text: written.unwrap_or(traced.kind).to_owned(),
                original: text(value),
                variant: text(&traced.value),
            });
        }
        None
    }
}

/// What the attachments hold that a pass reads.
type Attached = BTreeMap<(u32, u32), [f32; 4]>;

/// A place in the source, and what kind of expression stands there.
type Key = (usize, usize, &'static str);

fn key(traced: &Traced) -> Option<Key> {
    let range = traced.span.to_range()?;
    Some((range.start, range.end, traced.kind))
}

enum Tried {
    Same,
    Differs(Box<Counterexample>),
    /// It takes more steps than it may.
    Endless,
    Stuck(Stuck),
}

fn not_evaluated(why: &str) -> Verdict {
    Verdict::NotEvaluable {
        why: why.to_owned(),
    }
}

/// Puts a number that a guard fixes into a buffer of terms.
fn fix(module: &naga::Module, world: &mut World<'_, term::Term>, assumed: &crate::guard::Assumed) {
    use crate::evaluate::{Number, Scalar};
    use crate::guard::ScalarType;
    let Assumed::Uniform {
        group,
        binding,
        offset,
    } = assumed.place
    else {
        return;
    };
    let at = (group, binding);
    let number = match assumed.ty {
        ScalarType::F32 => Scalar::F32(term::Term::of(assumed.bounds.low as f32)),
        ScalarType::I32 => Scalar::I32(assumed.bounds.low as i32),
        ScalarType::U32 => Scalar::U32(assumed.bounds.low as u32),
    };
    let global = module.global_variables.iter().find(|(_, g)| {
        g.binding
            .as_ref()
            .is_some_and(|b| (b.group, b.binding) == at)
    });
    if let (Some((_, global)), Some(value)) = (global, world.resources.get_mut(&at)) {
        inputs::set(module, global.ty, value, offset, number);
    }
}

/// Whether a stage writes memory.
fn stores(stage: Stage<'_>) -> bool {
    use crate::graph::effect::Effect;
    let graph = Graph::build(stage.program);
    let effects = graph.effects(FunctionId::EntryPoint(stage.entry));
    let writes = [Effect::Store, Effect::ImageStore, Effect::Atomic];
    effects.iter().any(|e| writes.contains(e))
}

/// What a slice is, whatever it was cut out of.
#[derive(PartialEq)]
struct Normal {
    /// Its canonical hash.
    hash: String,
    /// What its inputs are bound to, and how they are interpolated.
    read: Vec<naga::Binding>,
}

/// The slice of a stage. It is placed and sliced again, so that what it was cut out of leaves no trace.
fn normal(stage: Stage<'_>, criteria: &[Criterion]) -> Option<Normal> {
    let graph = Graph::build(stage.program);
    let slice = slice::backward(&graph, stage.entry, criteria);
    let module = place::entry_point(
        &graph,
        &slice,
        stage.module(),
        "preshade_slice",
        "slice",
        PositionInvariance::AsWritten,
    );
    let kind = stage.module().entry_points[stage.entry].stage;
    let module = place::retain(&module, &[(kind, "preshade_slice")]);
    let placed = stage.program.with_module(module).ok()?;
    let stage = Stage::new(&placed, kind, "preshade_slice")?;
    let graph = Graph::build(&placed);
    Some(Normal {
        hash: slice::backward(&graph, stage.entry, criteria).hash,
        read: stage
            .inputs()
            .into_iter()
            .filter_map(|io| io.binding)
            .collect(),
    })
}
