//! Runs both on random and adversarial numbers, and finds the first difference between two runs.

use std::cell::RefCell;
use std::collections::BTreeMap;

use super::compare::{self, Colors, text};
use super::environment::{self, PassStages, TestPoint, Texels, World};
use super::inputs::{Inputs, Profile};
use super::made_up_draw::Drawn;
use super::promise::Pair;
use super::stage::{self, Stage};
use super::verdict::{Counterexample, Diverged, Verdict, not_evaluated};
use naga_interp::{Stuck, Traced, Value};
use preshade_plan::guard::Guard;

/// One in this many inputs must terminate.
pub(super) const QUOTA: u64 = 4;

impl Pair<'_> {
    /// Tries this many inputs.
    pub(super) fn tried(&self, places: &[TestPoint], colors: Colors, inputs: u64) -> Verdict {
        let module = self.original.vertex.module();
        if let Some(why) = self.unfilled(places) {
            return not_evaluated(&why);
        }
        let (mut tried, mut agreed, mut compared, mut why) = (0, 0, 0, None);
        for seed in self.effort.seed..self.effort.seed + inputs {
            let inputs =
                Inputs::new(module, self.variant.guard.as_ref(), seed).with_levels(&self.levels);
            if self.folds_floats() && inputs.profile != Profile::Ordinary {
                continue;
            }
            // Rounding bounds hold for ordinary numbers only.
            let asked = color_rule(colors, &inputs);
            tried += 1;
            let (mut ended, mut is_kept) = (true, false);
            for place in places {
                match self.try_one(&inputs, *place, asked) {
                    Tried::Same { discarded } => is_kept |= !discarded,
                    Tried::Differs(found) => return Verdict::Counterexample(found),
                    Tried::Endless => ended = false,
                    Tried::Stuck(stuck) => {
                        // Another input may branch around an unsupported operation.
                        ended = false;
                        why.get_or_insert(stuck.to_string());
                    }
                }
            }
            agreed += u64::from(ended);
            compared += u64::from(ended && is_whole(colors, asked, is_kept));
            // An obstacle for every input, or a loop without an end.
            if agreed == 0 && seed - self.effort.seed > 24 {
                break;
            }
        }
        match (agreed, why) {
            (0, None) => not_evaluated("no input came to an end within the step limit"),
            (0, Some(why)) => Verdict::NotEvaluable { why },
            // A few inputs that avoid an unsupported operation prove little.
            (few, why) if few * QUOTA < tried => Verdict::NotEvaluable {
                why: match why {
                    Some(why) => format!("only {few} of {tried} inputs came to an end: {why}"),
                    None => format!("only {few} of {tried} inputs came to an end"),
                },
            },
            (inputs, _) => of_compared(inputs, compared, 0),
        }
    }

    /// Why no numbers can be tried at these places.
    pub(super) fn unfilled(&self, places: &[TestPoint]) -> Option<String> {
        let is_vertex = places.iter().all(|p| *p == TestPoint::Vertex);
        let fragments = [self.original.fragment, self.other.fragment];
        let fragments = fragments.into_iter().flatten().filter(|_| !is_vertex);
        let stages = [self.original.vertex, self.other.vertex].into_iter();
        let module = self.original.vertex.module();
        unfilled(stages.chain(fragments), module, self.variant.guard.as_ref())
    }

    fn try_one(&self, inputs: &Inputs, place: TestPoint, colors: Colors) -> Tried {
        let (rule, attached) = self.rule(place, colors, Some(inputs));
        let drawn = self.drawn(inputs);
        let mut world = environment::concrete(inputs, &attached, Texels::Waves);
        if let Some(drawn) = &drawn {
            let module = self.other.vertex.module();
            match drawn.resources(&self.pass.bindings, module, drawn.other) {
                Ok(buffers) => world.draw(drawn, buffers),
                Err(why) => return Tried::Stuck(Stuck::Unsupported(why)),
            }
        }
        let original = match world.run(self.original, place, self.effort.steps, None) {
            Ok(original) => original,
            Err(Stuck::Steps) => return Tried::Endless,
            Err(stuck) => return Tried::Stuck(stuck),
        };
        let discarded = original.discarded;
        let found = match world.run(self.other, place, 4 * self.effort.steps, None) {
            Ok(variant) => compare::difference(rule, &original, &variant),
            // A vertex stage with hoisted work runs longer.
            Err(Stuck::Steps) if place == TestPoint::Vertex => return Tried::Endless,
            // If the original terminates, the variant must too.
            Err(Stuck::Steps) => Some(compare::Difference {
                output: "its end".to_owned(),
                original: format!("reached within {} steps", self.effort.steps),
                variant: format!("not within {}", 4 * self.effort.steps),
            }),
            Err(stuck) => return Tried::Stuck(stuck),
        };
        match found {
            None => Tried::Same { discarded },
            Some(found) => {
                let first = self.first_diverging(&world, place);
                let mut said = self.inputs_as_text(inputs, place);
                said.extend(drawn.iter().flat_map(Drawn::as_text));
                Tried::Differs(Box::new(Counterexample {
                    seed: inputs.seed,
                    inputs: said,
                    output: found.output,
                    original: found.original,
                    variant: found.variant,
                    first,
                }))
            }
        }
    }

    pub(super) fn inputs_as_text(
        &self,
        inputs: &Inputs,
        place: TestPoint,
    ) -> Vec<(String, String)> {
        inputs_as_text(self.original, inputs, place)
    }

    /// The first value in the source that both compute differently.
    pub(super) fn first_diverging(
        &self,
        world: &World<'_, f32>,
        place: TestPoint,
    ) -> Option<Diverged> {
        let traced = |stages| {
            let trace = RefCell::new(Vec::new());
            let _ = world.run(stages, place, 4 * self.effort.steps, Some(&trace));
            trace.into_inner()
        };
        let mut of_original: BTreeMap<TraceKey, Vec<Value>> = BTreeMap::new();
        for traced in traced(self.original) {
            if let Some(key) = key(&traced) {
                of_original.entry(key).or_default().push(traced.value);
            }
        }
        let mut seen: BTreeMap<TraceKey, usize> = BTreeMap::new();
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

/// Why no numbers can be tried: a stage reads a buffer of the original that is too long to fill.
pub(super) fn unfilled<'p>(
    stages: impl Iterator<Item = Stage<'p>>,
    original: &naga::Module,
    guard: Option<&Guard>,
) -> Option<String> {
    let left_out = Inputs::new(original, guard, 0).left_out;
    for stage in stages {
        let info = stage.program.info().get_entry_point(stage.entry);
        for (handle, global) in stage.module().global_variables.iter() {
            let at = naga_interp::place(global);
            if at.is_some_and(|at| left_out.contains(&at)) && !info[handle].is_empty() {
                let name = global.name.as_deref().unwrap_or("a buffer");
                return Some(format!("`{name}` is too long to be filled with numbers"));
            }
        }
    }
    None
}

/// The inputs of the original's stages, as text.
pub(super) fn inputs_as_text(
    stages: PassStages<'_>,
    inputs: &Inputs,
    place: TestPoint,
) -> Vec<(String, String)> {
    let mut said = Vec::new();
    let own = inputs.corner();
    let vertex = stages.vertex;
    for io in vertex.inputs() {
        let corners: &[usize] = match place {
            TestPoint::Vertex => std::slice::from_ref(&own),
            TestPoint::Corner(_) | TestPoint::Inside => &[0, 1, 2],
            TestPoint::Anywhere => &[],
        };
        for corner in corners {
            if let Some(value) = inputs.attribute(vertex.module(), &io, *corner) {
                let name = io.name.clone().unwrap_or_default();
                said.push((format!("{name} of vertex {corner}"), text(&value)));
            }
        }
    }
    if place == TestPoint::Inside {
        let fragment = stages.fragment.iter();
        let mut kinds: Vec<_> = fragment
            .flat_map(|f| f.inputs())
            .filter_map(|io| stage::kind(io.binding.as_ref()?))
            .collect();
        kinds.sort_unstable();
        kinds.dedup();
        for kind in kinds {
            let weights = format!("{:?}", inputs.weights(kind));
            said.push((format!("weights of the corners, {kind:?}"), weights));
        }
    }
    if let Some(fragment) = stages.fragment.filter(|_| place != TestPoint::Vertex) {
        for io in fragment.inputs() {
            let is_own = matches!(io.binding, Some(naga::Binding::BuiltIn(_)));
            if !(is_own || place == TestPoint::Anywhere) {
                continue;
            }
            if let Some(value) = inputs.fragment(fragment.module(), &io) {
                said.push((io.name.clone().unwrap_or_default(), text(&value)));
            }
        }
    }
    for (_, global) in vertex.module().global_variables.iter() {
        let is_data = global.space != naga::AddressSpace::Handle;
        let at = naga_interp::place(global).filter(|_| is_data);
        if let Some(value) = at.and_then(|at| inputs.resources.get(&at)) {
            said.push((global.name.clone().unwrap_or_default(), text(value)));
        }
    }
    said
}

/// The colour rule for an input: rounding bounds hold for ordinary numbers only.
pub(super) fn color_rule(colors: Colors, inputs: &Inputs) -> Colors {
    let is_rounded = matches!(colors, Colors::Within(_) | Colors::Numbers);
    match is_rounded && inputs.profile != Profile::Ordinary {
        true => Colors::Ignored,
        false => colors,
    }
}

/// Whether an input compared everything promised, including the colours of a fragment that
/// survives.
pub(super) fn is_whole(promised: Colors, asked: Colors, is_kept: bool) -> bool {
    promised == Colors::Ignored || (asked != Colors::Ignored && is_kept)
}

/// The verdict of agreeing inputs. `compared` of them compared everything promised.
pub(super) fn of_compared(inputs: u64, compared: u64, unsure: u64) -> Verdict {
    match compared {
        0 => Verdict::NotEvaluable {
            why: format!(
                "on {inputs} inputs no colour was compared: fragments were discarded, or numbers \
                 not ordinary"
            ),
        },
        _ => Verdict::Agreed {
            inputs,
            compared,
            unsure,
        },
    }
}

/// A span, and the kind of its expression.
type TraceKey = (usize, usize, &'static str);

fn key(traced: &Traced) -> Option<TraceKey> {
    let range = traced.span.to_range()?;
    Some((range.start, range.end, traced.kind))
}

enum Tried {
    Same {
        /// The original's fragment was discarded; nothing else was compared.
        discarded: bool,
    },
    Differs(Box<Counterexample>),
    /// It exceeds the step limit.
    Endless,
    Stuck(Stuck),
}
