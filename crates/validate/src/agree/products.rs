//! A matrix of one program that stands for a product of the other's: `light_space` for `proj *
//! view`.
//!
//! A mapping may give the product. Without one, we compare the chains of factors before a vertex.
//! If the same matrix follows in both, the parts before it stand for each other. If the vertex
//! itself follows, the names must show that no factor belongs to an object: a pass that forgot the
//! model matrix would agree otherwise.

use std::collections::BTreeMap;

use naga::{
    BinaryOperator, Block, Expression, Function, GlobalVariable, Handle, LocalVariable, Module,
    Statement, TypeInner,
};

use super::Mismatch;
use super::fed::{Cast, Rule};
use super::matching::{By, Lost, Matcher, type_text};
use super::reads::overlap;
use crate::environment::PassStages;
use crate::stage::Stage;
use naga_operands::calls;
use preshade_passes::analysis::view::names;
use preshade_plan::mapping::{self, Equation, MappedPlace, Path};

type Leaf = (Handle<GlobalVariable>, Vec<usize>);

/// Factors from left to right: matrices of buffers, and `None` for anything else.
type Chain = Vec<Option<Leaf>>;

/// One matrix and the factors that it stands for, as they are given.
pub(super) struct Product {
    is_ours: bool,
    one: MappedPlace,
    factors: Vec<MappedPlace>,
}

impl Product {
    /// The part of the second program that another value fills.
    fn theirs(&self) -> &[MappedPlace] {
        match self.is_ours {
            true => &self.factors,
            false => std::slice::from_ref(&self.one),
        }
    }
}

pub(super) fn given(
    [ours, theirs]: [&Module; 2],
    maps: &[Equation],
) -> Result<Vec<Product>, Mismatch> {
    let products = maps.iter().filter(|map| map.plain().is_none());
    let place = |map: &Equation, path: &Path, (module, side): (&Module, &'static str)| {
        path.resolve(module).map_err(|why| Mismatch::Map {
            map: map.to_string(),
            side,
            why: why.to_string(),
        })
    };
    let product = |map: &Equation| {
        let sides = [(ours, "first"), (theirs, "second")];
        let is_ours = map.ours.len() == 1;
        let (one, factors) = match is_ours {
            true => ((&map.ours[0], sides[0]), (&map.theirs, sides[1])),
            false => ((&map.theirs[0], sides[1]), (&map.ours, sides[0])),
        };
        let found = factors.0.iter().map(|path| place(map, path, factors.1));
        let product = Product {
            is_ours,
            one: place(map, one.0, one.1)?,
            factors: found.collect::<Result<_, _>>()?,
        };
        let wanted = &one.1.0.types[product.one.ty].inner;
        let all = product.factors.iter().zip(factors.0);
        let is_square =
            matches!(wanted, TypeInner::Matrix { columns, rows, .. } if columns == rows);
        let mut wrong = all.filter(|(f, _)| !is_square || factors.1.0.types[f.ty].inner != *wanted);
        match wrong.next() {
            None => Ok(product),
            Some((factor, path)) => Err(Mismatch::Map {
                map: map.to_string(),
                side: factors.1.1,
                why: format!(
                    "a product is of square matrices of one size: `{}` is {}, and `{path}` is {}",
                    one.0,
                    type_text(one.1.0, product.one.ty),
                    type_text(factors.1.0, factor.ty)
                ),
            }),
        }
    };
    products.map(product).collect()
}

impl Matcher<'_> {
    /// Whether a mapping gives a part of a variable of theirs as a product, or as a factor of one.
    pub(super) fn parts_of_products(&self, global: Handle<GlobalVariable>) -> Vec<Vec<usize>> {
        let theirs = self.products.iter().flat_map(Product::theirs);
        let place =
            |g: Handle<GlobalVariable>| naga_interp::place(&self.theirs.global_variables[g]);
        let own = theirs.filter(|part| place(part.global) == place(global));
        own.map(|part| part.steps.clone()).collect()
    }

    /// Feeds each product that a mapping gives.
    pub(super) fn feed_products(&mut self) {
        for product in std::mem::take(&mut self.products) {
            let part = |place: &MappedPlace| (place.global, place.steps.clone());
            let factors: Vec<Leaf> = product.factors.iter().map(part).collect();
            self.multiply(product.is_ours, &part(&product.one), &factors, By::Map);
        }
    }

    /// Lays the chains of two vertex stages side by side.
    pub(super) fn guess_products(&mut self, first: PassStages<'_>, second: PassStages<'_>) {
        let [ours, theirs] = [first, second].map(|stages| chains(stages.vertex));
        for their in &theirs {
            for our in &ours {
                let Some([(a, b), (from, to)]) = self.partners(their, our) else {
                    continue;
                };
                let theirs: Vec<Leaf> = their[a..b].iter().flatten().cloned().collect();
                let ours: Vec<Leaf> = our[from..to].iter().flatten().cloned().collect();
                let (is_ours, one, factors) = match (&theirs[..], &ours[..]) {
                    ([one], factors @ [_, _, ..]) => (false, one, factors),
                    (factors @ [_, _, ..], [one]) => (true, one, factors),
                    _ => continue,
                };
                let is_before_a_matrix = their.get(b).is_some_and(Option::is_some);
                if !is_before_a_matrix && !self.is_named_so(is_ours, one, factors) {
                    continue;
                }
                self.multiply(is_ours, one, factors, By::Product);
                let product = factors.iter().map(|f| self.called(usize::from(is_ours), f));
                let product = product.collect::<Vec<_>>().join(" * ");
                let one = self.called(usize::from(!is_ours), one);
                self.notes.push(format!(
                    "`{one}` stands for `{product}`: no name says so, and the positions are compared as \
                     if it did"
                ));
                let at: Vec<_> = theirs
                    .iter()
                    .filter_map(|leaf| self.their_place(leaf))
                    .collect();
                let is_found = |lost: &Lost| {
                    let mut at = at.iter();
                    at.any(|(place, steps)| *place == lost.at && *steps == lost.steps)
                };
                self.lost.retain(|lost| !is_found(lost));
            }
        }
    }

    /// Whether names allow that a matrix stands for a product in front of a vertex.
    fn is_named_so(&self, is_ours: bool, one: &Leaf, factors: &[Leaf]) -> bool {
        let one = self.called(usize::from(!is_ours), one);
        let mut factors = factors.iter().map(|f| self.called(usize::from(is_ours), f));
        names::is_combined(&one) || factors.all(|f| names::is_of_view_alone(&f))
    }

    /// The parts of two chains that stand for each other, if one of them is a single matrix.
    /// Neither has a partner, and equal factors are before and behind both.
    fn partners(&self, their: &Chain, our: &Chain) -> Option<[(usize, usize); 2]> {
        let is_lost = |leaf: &Option<Leaf>| {
            let place = leaf.as_ref().and_then(|leaf| self.their_place(leaf));
            place.is_some_and(|(at, steps)| {
                let mut lost = self.lost.iter();
                lost.any(|l| l.at == at && l.steps == steps)
            })
        };
        let is_free = |leaf: &Option<Leaf>| leaf.as_ref().is_some_and(|l| !self.has_partner(l));
        let start = their.iter().position(is_lost)?;
        let count = their[start..].iter().take_while(|l| is_lost(l)).count();
        let end = start + count;
        let is_same = |a: Option<&Option<Leaf>>, b: Option<&Option<Leaf>>| match (a, b) {
            (Some(Some(theirs)), Some(Some(ours))) => {
                let place = naga_interp::place(&self.ours.global_variables[ours.0]);
                self.our_part(theirs) == place.map(|at| (at, ours.1.clone()))
            }
            (None | Some(None), None | Some(None)) => a.is_none() == b.is_none(),
            _ => false,
        };
        let before = |chain: &Chain, at: usize| at.checked_sub(1).map(|i| chain[i].clone());
        let mut windows = (0..our.len()).flat_map(|from| {
            let free = our[from..].iter().take_while(|l| is_free(l)).count();
            (1..=free).map(move |length| (from, from + length))
        });
        let found = windows.find(|(from, to)| {
            let fits = (count == 1) != (to - from == 1);
            fits && is_same(their.get(end), our.get(*to))
                && is_same(before(their, start).as_ref(), before(our, *from).as_ref())
        });
        Some([(start, end), found?])
    }

    /// Adds the rule of a product, behind those that feed its factors.
    fn multiply(&mut self, is_ours: bool, one: &Leaf, factors: &[Leaf], by: By) {
        let place = |this: &mut Self, is_ours: bool, (global, steps): &Leaf| {
            let at = match is_ours {
                true => naga_interp::place(&this.ours.global_variables[*global]),
                false => Some(this.place_or_own(*global)),
            };
            at.map(|at| (at, steps.clone()))
        };
        let all: Vec<_> = factors
            .iter()
            .filter_map(|factor| place(self, !is_ours, factor))
            .collect();
        let (Some((to, to_steps)), Some(((from, from_steps), times))) =
            (place(self, is_ours, one), all.split_first())
        else {
            return;
        };
        let feeds = |rule: &Rule| {
            let mut all = all.iter();
            all.any(|(at, steps)| *at == rule.to && overlap(steps, &rule.to_steps))
        };
        let at = match is_ours {
            true => self.rules.iter().rposition(feeds).map_or(0, |i| i + 1),
            false => self.rules.len(),
        };
        let rule = Rule {
            to,
            to_steps,
            from: *from,
            from_steps: from_steps.clone(),
            times: times.to_vec(),
            cast: Cast::Same,
            is_of_view: true,
            is_previous: false,
        };
        self.rules.insert(at, rule);
        let product = factors.iter().map(|f| self.called(usize::from(is_ours), f));
        let product = product.collect::<Vec<_>>().join(" * ");
        let one = self.called(usize::from(!is_ours), one);
        match is_ours {
            true => self.found(product, one, by),
            false => self.found(one, product, by),
        }
    }

    /// A part by its name, of our program or of theirs (1). OpenGL's uniforms outside of blocks have
    /// no other.
    pub(super) fn called(&self, program: usize, (global, steps): &Leaf) -> String {
        let module = [self.ours, self.theirs][program];
        let mut path = mapping::name_of(module, *global, steps);
        let binding = module.global_variables[*global].binding;
        if self.programs[program].declared().is_loose(binding) && !path.members.is_empty() {
            path.variable = path.members.remove(0);
        }
        path.to_string()
    }

    /// Where the renamed program has a part of theirs.
    fn their_place(&self, (global, steps): &Leaf) -> Option<((u32, u32), Vec<usize>)> {
        let at = self.bindings.get(global)?;
        Some(((at.group, at.binding), steps.clone()))
    }

    /// The part of ours that a part of theirs has its value from.
    fn our_part(&self, leaf: &Leaf) -> Option<((u32, u32), Vec<usize>)> {
        let (at, steps) = self.their_place(leaf)?;
        let mut rules = self.rules.iter().rev().filter(|rule| rule.times.is_empty());
        let found = rules.find_map(|rule| {
            let rest = steps.strip_prefix(&rule.to_steps[..]);
            let rest = rest.filter(|_| rule.to == at)?;
            let own = rule.cast.steps(rest)?;
            Some((rule.from, [&rule.from_steps[..], &own].concat()))
        });
        found.or_else(|| self.is_taken(at).then_some((at, steps)))
    }

    /// Whether anything of theirs has its value from a part of ours.
    pub(super) fn has_partner(&self, (global, steps): &Leaf) -> bool {
        let Some(at) = naga_interp::place(&self.ours.global_variables[*global]) else {
            return true;
        };
        let mut rules = self.rules.iter();
        self.is_taken(at)
            || rules.any(|rule| {
                let factors = rule.times.iter().map(|(at, steps)| (*at, &steps[..]));
                let mut all = factors.chain([(rule.from, &rule.from_steps[..])]);
                all.any(|(from, part)| from == at && overlap(part, steps))
            })
    }

    /// Products of ours that may stand for a matrix of theirs without a partner.
    pub(super) fn suggested(&self, first: PassStages<'_>) -> Vec<String> {
        let chains = chains(first.vertex);
        let runs = chains.iter().flat_map(|chain| {
            let is_free = |leaf: &Option<Leaf>| leaf.as_ref().is_some_and(|l| !self.has_partner(l));
            let is_of_view = |leaf: &Option<Leaf>| {
                let mut leaves = leaf.iter();
                leaves.all(|leaf| names::is_of_view_alone(&self.called(0, leaf)))
            };
            let runs = chain.split(move |leaf| !is_free(leaf));
            // An object's matrix is no light's.
            let ends = runs.map(
                move |run| match run.iter().position(|leaf| !is_of_view(leaf)) {
                    Some(end) if end > 1 => &run[..end],
                    _ => run,
                },
            );
            ends.filter(|run| run.len() > 1)
        });
        let names = runs.map(|run| {
            let names = run.iter().flatten().map(|leaf| self.called(0, leaf));
            names.collect::<Vec<_>>().join("*")
        });
        let mut names: Vec<String> = names.collect();
        names.sort_unstable();
        names.dedup();
        names
    }
}

/// A variable that a function stores to.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Variable {
    Local(Handle<LocalVariable>),
    Global(Handle<GlobalVariable>),
}

/// The chains of factors of a stage, the longest of each.
fn chains(stage: Stage<'_>) -> Vec<Chain> {
    let module = stage.module();
    let mut all = Vec::new();
    let info = stage.program.info();
    let entry = info.get_entry_point(stage.entry);
    let called = calls::called(module, &stage.function().body);
    let functions = called.iter().map(|f| (&module.functions[*f], &info[*f]));
    for (function, info) in functions.chain([(stage.function(), entry)]) {
        let mut chains = Chains {
            module,
            function,
            info,
            known: BTreeMap::new(),
            stored: BTreeMap::new(),
            all: &mut all,
        };
        chains.block(&function.body);
    }
    // A part of another chain adds nothing.
    let whole = all.clone();
    all.retain(|chain: &Chain| {
        let is_part = |other: &Chain| {
            other.len() > chain.len() && other.ends_with(chain)
                || other.len() > chain.len() && other.starts_with(&chain[..chain.len() - 1])
        };
        chain.len() > 1 && !whole.iter().any(is_part)
    });
    all
}

struct Chains<'m> {
    module: &'m Module,
    function: &'m Function,
    info: &'m naga::valid::FunctionInfo,
    known: BTreeMap<Handle<Expression>, Chain>,
    stored: BTreeMap<Variable, Chain>,
    all: &'m mut Vec<Chain>,
}

impl Chains<'_> {
    fn block(&mut self, block: &Block) {
        for statement in block {
            match statement {
                Statement::Emit(range) => {
                    for e in range.clone() {
                        let chain = self.chain(e);
                        if chain.len() > 1 {
                            self.all.push(chain.clone());
                        }
                        self.known.insert(e, chain);
                    }
                }
                Statement::Store { pointer, value } => {
                    if let Some(variable) = self.variable(*pointer) {
                        let chain = self.factors(*value);
                        self.stored.insert(variable, chain);
                    }
                }
                _ => {}
            }
            for inner in naga_operands::blocks(statement) {
                self.block(inner);
            }
        }
    }

    fn factors(&self, e: Handle<Expression>) -> Chain {
        let known = self.known.get(&e).cloned();
        known.unwrap_or_else(|| vec![None])
    }

    fn chain(&self, e: Handle<Expression>) -> Chain {
        match self.function.expressions[e] {
            Expression::Binary {
                op: BinaryOperator::Multiply,
                left,
                right,
            } if self.is_matrix(left) => [self.factors(left), self.factors(right)].concat(),
            Expression::Load { pointer } => match self.variable(pointer) {
                Some(variable) if self.stored.contains_key(&variable) => {
                    self.stored[&variable].clone()
                }
                _ => vec![self.leaf(pointer).filter(|_| self.is_matrix(e))],
            },
            _ => vec![None],
        }
    }

    fn is_matrix(&self, e: Handle<Expression>) -> bool {
        let inner = self.info[e].ty.inner_with(&self.module.types);
        matches!(inner, TypeInner::Matrix { .. })
    }

    fn variable(&self, pointer: Handle<Expression>) -> Option<Variable> {
        match self.function.expressions[pointer] {
            Expression::LocalVariable(local) => Some(Variable::Local(local)),
            Expression::GlobalVariable(global) => Some(Variable::Global(global)),
            _ => None,
        }
    }

    /// The part of a buffer that a pointer leads to by constant steps.
    fn leaf(&self, pointer: Handle<Expression>) -> Option<Leaf> {
        match self.function.expressions[pointer] {
            Expression::GlobalVariable(global) => {
                let variable = &self.module.global_variables[global];
                naga_interp::place(variable).map(|_| (global, Vec::new()))
            }
            Expression::AccessIndex { base, index } => {
                let (global, mut steps) = self.leaf(base)?;
                steps.push(index as usize);
                Some((global, steps))
            }
            _ => None,
        }
    }
}
