//! A fragment stage without derivatives: the differences between lanes of a quad become inputs.
//!
//! ```text
//! before:  let base = textureSample(albedo, s, in.uv * 4.0);
//!
//! after:   fn gradient_roots(in) -> vec2<f32> { return in.uv * 4.0; }       called for pixels of the quad
//!          let base = textureSampleGrad(albedo, s, in.uv * 4.0, dx, dy);    dx and dy being inputs
//! ```
//!
//! A level contains all derivatives that depend on no other remaining derivative. A dependent read
//! (a coordinate computed from another sample) needs a second level, whose function takes the
//! gradients of the first as inputs.

use std::collections::{BTreeMap, BTreeSet};

use naga::{
    Binding, DerivativeAxis, DerivativeControl, Expression, Handle, ImageClass, ImageDimension,
    Interpolation, MathFunction, Module, SampleLevel, Sampling, Span, Statement, SwizzleComponent,
    TypeInner,
};

use super::refusals;
use preshade_dataflow::graph::effect::{self, Effect};
use preshade_dataflow::graph::{FunctionId, Graph};
use preshade_passes::analysis::reach::with_operands;
use preshade_passes::analysis::refusals as shared;
use preshade_passes::analysis::values::{ContextId, Node, TooLarge, ValueId, Values};
use preshade_passes::rebuild::isolate::{self, isolate};
use preshade_passes::rebuild::outline::{self, Wanted};
use preshade_passes::rebuild::place::{self, CodeBuilder, Replacement, Rewrite};
use preshade_plan::program::Program;
use preshade_plan::rasterizer::{Neighbours, Rasterizer};
use shader_text::refusals::RefusalInfo;

/// First location of gradient inputs, beyond all of the author's.
pub(crate) const GRADIENTS: u32 = 1 << 16;

/// Names of a level's functions.
const NAMES: outline::Names = outline::Names {
    function: "gradient_roots",
    values: "GradientRoots",
};

/// A function whose differences between pixels are gradients.
#[derive(Clone, Debug)]
pub(crate) struct Level {
    /// The function of the fragment stage's inputs.
    pub function: Handle<naga::Function>,
    /// The input for each argument, or for each member of a struct argument.
    pub arguments: Vec<Vec<Binding>>,
    /// Its results: one value, or a struct. The gradients of value `i` are the inputs at `first + 2
    /// i` and `first + 2 i + 1`.
    pub values: Vec<TypeInner>,
    /// Location of the first gradient.
    pub first: u32,
    /// Pixels to evaluate it for.
    pub neighbours: Neighbours,
}

/// A program whose fragment stage has no derivatives.
#[derive(Clone, Debug)]
pub(crate) struct Explicit {
    /// The program, including the functions of the levels.
    pub program: Program,
    /// Levels in call order.
    pub levels: Vec<Level>,
}

/// Why a derivative cannot be computed from neighbouring evaluations.
#[derive(Clone, Debug)]
pub enum Failed {
    /// The author's code prevents it: code, reason and place.
    Refused(&'static RefusalInfo, String, Span),
    /// A bug in preshade.
    Bug(String),
}

impl Failed {
    fn bug(what: impl ToString) -> Self {
        Self::Bug(what.to_string())
    }
}

/// The remedy for a refused derivative.
pub(crate) fn remedy(info: &RefusalInfo) -> &'static str {
    match info.code {
        "gradient-in-loop" => {
            "compute the derivative before the loop; within it, sample with explicit gradients or \
             an explicit level"
        }
        "no-gradient-form" => {
            "use textureSampleCompareLevel, which samples level 0, or sample an explicit level"
        }
        "array-gradient" => {
            "sample it with explicit gradients or an explicit level (`textureGrad` or `textureLod` \
             in GLSL), or declare one texture with layers"
        }
        "gradient-of-gradient" => "sample with explicit gradients or an explicit level",
        _ => "leave it as it is",
    }
}

/// A fragment stage that was sliced to its colours.
pub(crate) struct Shaded<'g, 'p> {
    /// The values of the stage, unless there are too many.
    pub values: Result<Values<'g, 'p>, TooLarge>,
    pub fragment: usize,
    program: &'p Program,
}

impl<'g, 'p> Shaded<'g, 'p> {
    /// The fragment entry point of that index.
    pub fn new(graph: &'g Graph<'p>, fragment: usize) -> Self {
        Self {
            values: Values::new(graph, fragment),
            fragment,
            program: graph.program(),
        }
    }
}

/// Replaces the derivatives of the fragment stage by inputs, for the neighbours that a rasteriser
/// uses.
///
/// # Errors
/// [`Failed`].
pub(crate) fn explicit(shaded: &Shaded<'_, '_>, like: &Rasterizer) -> Result<Explicit, Failed> {
    let entry = shaded.fragment;
    let mut made = Levels {
        levels: Vec::new(),
        read: BTreeSet::new(),
        next: GRADIENTS,
    };
    let mut program = shaded.program.clone();
    // The values of `shaded` remain valid while its program is unchanged.
    let mut is_given = true;
    let mut is_done = false;
    loop {
        if let Some(module) = evaluated(program.module(), entry) {
            program = program.with_module(module).map_err(Failed::bug)?;
            is_given = false;
        }
        if is_done {
            break;
        }
        let round = match (is_given, &shaded.values) {
            (true, Ok(values)) => made.add(&program, values, like)?,
            (true, Err(why)) => return Err(too_large(*why)),
            (false, _) => {
                let graph = Graph::build(&program);
                let values = Values::new(&graph, entry).map_err(too_large)?;
                made.add(&program, &values, like)?
            }
        };
        let Some((module, is_last)) = round else {
            break;
        };
        program = program.with_module(module).map_err(Failed::bug)?;
        (is_given, is_done) = (false, is_last);
    }
    Ok(Explicit {
        program,
        levels: made.levels,
    })
}

fn too_large(why: TooLarge) -> Failed {
    Failed::Refused(&shared::TOO_LARGE, why.to_string(), Span::UNDEFINED)
}

struct Levels {
    levels: Vec<Level>,
    /// Locations of gradients that may differ between pixels of a quad: derivatives (even coarse
    /// ones, as the driver chooses), and samples if the adapter does so. The function of a further
    /// level is called for the pixel's neighbours with this pixel's gradients.
    read: BTreeSet<u32>,
    /// Location of the next gradient.
    next: u32,
}

impl Levels {
    /// Adds the level of the derivatives that depend on no other. Returns the module without them,
    /// and whether no others remain. `None` if there is no derivative.
    fn add(
        &mut self,
        program: &Program,
        values: &Values<'_, '_>,
        like: &Rasterizer,
    ) -> Result<Option<(Module, bool)>, Failed> {
        let Sites { sites, is_all } = sites(values, like)?;
        let Some(neighbours) = sites.first().map(|s| s.neighbours) else {
            return Ok(None);
        };
        let level = Round::new(values, sites, self.next);
        let module = if level.wanted.is_empty() {
            level.rewrite(program.module(), values)
        } else {
            let extracted =
                outline::extract(program, values, &level.wanted, &NAMES).map_err(Failed::bug)?;
            let mut inputs = extracted.arguments.iter().flatten();
            if inputs.any(|b| is_at(&self.read, b)) {
                return Err(level.of_a_gradient(values, &self.read));
            }
            let module = level.rewrite(&extracted.module, values);
            self.levels.push(Level {
                function: extracted.function,
                arguments: extracted.arguments,
                values: level.wanted.iter().map(|w| w.inner.clone()).collect(),
                first: self.next,
                neighbours,
            });
            module
        };
        self.read.extend(level.read());
        self.next += 2 * level.wanted.len() as u32;
        Ok(Some((module, is_all)))
    }
}

/// Whether an input is one of these gradients.
fn is_at(locations: &BTreeSet<u32>, input: &Binding) -> bool {
    matches!(input, Binding::Location { location, .. } if locations.contains(location))
}

/// The module with every derivative's operand evaluated by a statement. A bare argument is not
/// evaluated so. `None` if nothing changes.
fn evaluated(module: &Module, entry: usize) -> Option<Module> {
    let mut out = None;
    let ids = module
        .functions
        .iter()
        .map(|(h, _)| FunctionId::Function(h))
        .chain([FunctionId::EntryPoint(entry)]);
    for id in ids {
        let function = match id {
            FunctionId::Function(h) => &module.functions[h],
            FunctionId::EntryPoint(i) => &module.entry_points[i].function,
        };
        let arguments: BTreeSet<Handle<Expression>> = function
            .expressions
            .iter()
            .filter(|(_, e)| effect::of_expression(e).is_some())
            .flat_map(|(_, e)| roots(e))
            .filter(|r| matches!(function.expressions[*r], Expression::FunctionArgument(_)))
            .collect();
        if arguments.is_empty() {
            continue;
        }
        let types: Vec<_> = arguments
            .iter()
            .filter_map(|a| match function.expressions[*a] {
                Expression::FunctionArgument(i) => {
                    let argument = &function.arguments[i as usize];
                    Some((*a, i, module.types[argument.ty].inner.clone()))
                }
                _ => None,
            })
            .collect();
        out = Some(place::rewritten(
            out.as_ref().unwrap_or(module),
            id,
            |build| Rewrite {
                replacements: types
                    .iter()
                    .map(|(argument, index, inner)| {
                        let value = build.expression(Expression::FunctionArgument(*index));
                        (*argument, Replacement::Value(same(build, value, inner)))
                    })
                    .collect(),
                ..Rewrite::default()
            },
        ));
    }
    out
}

/// The same value as an evaluated expression.
fn same(
    build: &mut CodeBuilder<'_>,
    value: Handle<Expression>,
    inner: &TypeInner,
) -> Handle<Expression> {
    use SwizzleComponent::{W, X, Y, Z};
    build.expression(match inner {
        TypeInner::Vector { size, .. } => Expression::Swizzle {
            size: *size,
            vector: value,
            pattern: [X, Y, Z, W],
        },
        _ => Expression::As {
            expr: value,
            kind: naga::ScalarKind::Float,
            convert: Some(4),
        },
    })
}

/// The operands whose gradients an expression uses, the coordinate first.
fn roots(expression: &Expression) -> Vec<Handle<Expression>> {
    match expression {
        Expression::ImageSample { coordinate, .. } => vec![*coordinate],
        Expression::Derivative { expr, .. } => vec![*expr],
        _ => Vec::new(),
    }
}

/// A derivative, or a sample that needs gradients.
struct Site {
    context: ContextId,
    expression: Handle<Expression>,
    root: Handle<Expression>,
    neighbours: Neighbours,
    /// Whether all pixels of the quad share the gradient. This holds for samples, unless the
    /// adapter gives each pixel its own.
    is_shared: bool,
}

/// The derivatives that depend on no other, with the same kind of neighbours.
struct Sites {
    sites: Vec<Site>,
    /// Whether no other derivatives remain.
    is_all: bool,
}

fn sites(values: &Values<'_, '_>, like: &Rasterizer) -> Result<Sites, Failed> {
    let effect_of = |id: ValueId| match &values.values[id].node {
        Node::Expression(context, e, path) if path.is_empty() => {
            let expression = &values.function(*context).function.expressions[*e];
            effect::of_expression(expression).map(|effect| (*context, *e, effect))
        }
        _ => None,
    };
    let all: Vec<ValueId> = (0..values.values.len())
        .filter(|id| effect_of(*id).is_some())
        .collect();
    let mut found: Vec<Site> = Vec::new();
    for id in &all {
        let Some((context, e, effect)) = effect_of(*id) else {
            continue;
        };
        let f = values.function(context);
        let expression = &f.function.expressions[e];
        let span = f.function.expressions.get_span(e);
        if let Effect::ImplicitLod = effect
            && !has_gradient_form(values.graph.module(), f.function, expression)
        {
            let array = array(values.graph.module(), f.function, expression);
            return Err(match array {
                Some(array) => Failed::Refused(
                    &refusals::ARRAY_GRADIENT,
                    format!("an element of `{array}` is sampled at an implicit level of detail"),
                    span,
                ),
                None => Failed::Refused(
                    &refusals::NO_GRADIENT_FORM,
                    "a texture is sampled at an implicit level of detail, and its type cannot be \
                     sampled with gradients"
                        .to_owned(),
                    span,
                ),
            });
        }
        if repeats(values, context, e) {
            return Err(Failed::Refused(
                &refusals::GRADIENT_IN_LOOP,
                "a derivative is computed within a loop, and it may differ in each iteration"
                    .to_owned(),
                span,
            ));
        }
        let root = roots(expression).first().copied().unwrap_or(e);
        if depends_on(values, *id, &all) {
            continue;
        }
        let neighbours = match expression {
            Expression::ImageSample { image, .. } => {
                match dimension(values.graph.module(), f.function, *image) {
                    Some(ImageDimension::Cube) => like.cubes,
                    _ => like.samples,
                }
            }
            Expression::Derivative { ctrl, .. } => match ctrl {
                DerivativeControl::None => like.derivatives,
                DerivativeControl::Coarse => like.coarse,
                DerivativeControl::Fine => Neighbours::Own,
            },
            _ => Neighbours::Own,
        };
        let is_derivative = matches!(expression, Expression::Derivative { .. });
        found.push(Site {
            context,
            expression: e,
            root,
            neighbours,
            is_shared: neighbours == Neighbours::Quad && !is_derivative,
        });
    }
    if let Some(first) = found.first().map(|s| s.neighbours) {
        found.retain(|s| s.neighbours == first);
    } else if !all.is_empty() {
        return Err(Failed::Refused(
            &refusals::CIRCULAR_GRADIENT,
            "a derivative depends on itself".to_owned(),
            Span::UNDEFINED,
        ));
    }
    Ok(Sites {
        is_all: found.len() == all.len(),
        sites: found,
    })
}

/// Whether a value depends on one of `others` other than itself.
fn depends_on(values: &Values<'_, '_>, id: ValueId, others: &[ValueId]) -> bool {
    let seen = with_operands(values, values.values[id].operands.clone());
    others.iter().any(|o| seen[*o])
}

/// Whether a loop evaluates an expression more than once per fragment.
fn repeats(values: &Values<'_, '_>, mut context: ContextId, e: Handle<Expression>) -> bool {
    let Some(mut at) = values.function(context).statements.evaluated_at(e) else {
        return false;
    };
    loop {
        let statements = &values.function(context).statements;
        let is_loop = |id| matches!(statements.get(id).statement, Statement::Loop { .. });
        if statements.ancestors(at).any(is_loop) {
            return true;
        }
        match values.contexts[context].call {
            Some((caller, call)) => (context, at) = (caller, call),
            None => return false,
        }
    }
}

/// Whether WGSL has `textureSampleGrad` for a sample. It lacks it for comparisons, depth textures
/// and 1D textures.
fn has_gradient_form(module: &Module, function: &naga::Function, sample: &Expression) -> bool {
    let Expression::ImageSample {
        image,
        depth_ref: None,
        clamp_to_edge: false,
        ..
    } = sample
    else {
        return false;
    };
    matches!(
        texture(module, function, *image),
        Some(TypeInner::Image {
            dim: ImageDimension::D2 | ImageDimension::D3 | ImageDimension::Cube,
            class: ImageClass::Sampled { multi: false, .. },
            ..
        })
    )
}

/// The texture array from which a sample reads an element.
fn array<'m>(
    module: &'m Module,
    function: &naga::Function,
    sample: &Expression,
) -> Option<&'m str> {
    let Expression::ImageSample { image, .. } = sample else {
        return None;
    };
    let base = match function.expressions[*image] {
        Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => base,
        _ => return None,
    };
    match function.expressions[base] {
        Expression::GlobalVariable(g) => module.global_variables[g].name.as_deref(),
        _ => None,
    }
}

/// The type of a texture.
fn texture<'m>(
    module: &'m Module,
    function: &naga::Function,
    image: Handle<Expression>,
) -> Option<&'m TypeInner> {
    let ty = match function.expressions[image] {
        Expression::GlobalVariable(g) => module.global_variables[g].ty,
        Expression::FunctionArgument(i) => function.arguments[i as usize].ty,
        _ => return None,
    };
    Some(&module.types[ty].inner)
}

fn dimension(
    module: &Module,
    function: &naga::Function,
    image: Handle<Expression>,
) -> Option<ImageDimension> {
    match texture(module, function, image)? {
        TypeInner::Image { dim, .. } => Some(*dim),
        _ => None,
    }
}

struct Round {
    sites: Vec<Site>,
    wanted: Vec<Wanted>,
    /// Index in `wanted` of each site's root. `None` if the root is the same for all fragments.
    of_site: Vec<Option<usize>>,
    first: u32,
}

impl Round {
    fn new(values: &Values<'_, '_>, sites: Vec<Site>, first: u32) -> Self {
        let mut wanted: Vec<Wanted> = Vec::new();
        let mut of_site = Vec::new();
        for site in &sites {
            let f = values.function(site.context);
            if f.statements.evaluated_at(site.root).is_none() {
                of_site.push(None);
                continue;
            }
            let same = |w: &Wanted| w.context == site.context && w.expression == site.root;
            of_site.push(Some(wanted.iter().position(same).unwrap_or_else(|| {
                wanted.push(Wanted {
                    context: site.context,
                    expression: site.root,
                    inner: f.ty(values.graph.module(), site.root).clone(),
                    name: format!("root_{}", letters(wanted.len())),
                });
                wanted.len() - 1
            })));
        }
        Self {
            sites,
            wanted,
            of_site,
            first,
        }
    }

    /// Locations of the gradients that may differ between pixels.
    fn read(&self) -> impl Iterator<Item = u32> {
        let of_each = self
            .sites
            .iter()
            .zip(&self.of_site)
            .filter_map(|(site, i)| (!site.is_shared).then_some(self.first + 2 * (*i)? as u32));
        of_each.flat_map(|x| [x, x + 1])
    }

    /// The refusal of a level whose function would need its neighbours' gradients, at the first
    /// such derivative.
    fn of_a_gradient(&self, values: &Values<'_, '_>, read: &BTreeSet<u32>) -> Failed {
        let rests = |site: &&Site| {
            let root = values.named(site.context, site.root);
            let seen = with_operands(values, root.into_iter().collect());
            let is_gradient = |id: usize| match values.values[id].node {
                Node::Input(input) => {
                    let binding = values.inputs.get(input).and_then(|i| i.binding.as_ref());
                    binding.is_some_and(|b| is_at(read, b))
                }
                _ => false,
            };
            (0..seen.len()).any(|id| seen[id] && is_gradient(id))
        };
        let span = self.sites.iter().find(rests).map(|site| {
            let function = values.function(site.context).function;
            function.expressions.get_span(site.expression)
        });
        Failed::Refused(
            &refusals::GRADIENT_OF_GRADIENT,
            "a derivative, or an implicit level of detail, depends on another derivative, and that \
             of the neighbours is not available".to_owned(),
            span.unwrap_or(Span::UNDEFINED),
        )
    }

    /// `module` with the gradients as inputs of the fragment entry point, passed on to their uses.
    fn rewrite(&self, module: &Module, values: &Values<'_, '_>) -> Module {
        let contexts: BTreeSet<ContextId> = self.sites.iter().map(|s| s.context).collect();
        let (mut module, copies) = isolate(module, values.entry, values, &contexts);
        let wanted: Vec<ContextId> = self.wanted.iter().map(|w| w.context).collect();
        let below = isolate::reachable_contexts(values, &copies, &wanted);
        for (context, id) in &copies {
            let children = isolate::callees(values, &copies, &below, *context);
            let own = values.function(*context).function;
            module = place::rewritten(&module, *id, |build| {
                let mut gradients: BTreeMap<usize, [Handle<Expression>; 2]> = BTreeMap::new();
                for i in &below[context] {
                    let ty = build.ty(self.wanted[*i].inner.clone());
                    let mut argument = |axis: u32, letter: &str| {
                        let binding = matches!(id, FunctionId::EntryPoint(_))
                            .then(|| input(self.first + 2 * *i as u32 + axis));
                        let name = format!("{}_d{letter}", self.wanted[*i].name);
                        build.argument(&name, ty, binding)
                    };
                    gradients.insert(*i, [argument(0, "x"), argument(1, "y")]);
                }
                let mut rewrite = Rewrite::default();
                for (site, wanted) in self.sites.iter().zip(&self.of_site) {
                    if site.context != *context {
                        continue;
                    }
                    let ends = match wanted {
                        Some(i) => gradients[i],
                        None => {
                            let inner = values
                                .function(*context)
                                .ty(values.graph.module(), site.root);
                            let ty = build.ty(inner.clone());
                            let zero = build.expression(Expression::ZeroValue(ty));
                            [zero, zero]
                        }
                    };
                    let expression = &own.expressions[site.expression];
                    let replacement = self.replacement(build, own, expression, ends);
                    rewrite.replacements.insert(site.expression, replacement);
                }
                rewrite.arguments = children
                    .iter()
                    .map(|(callee, through)| {
                        (*callee, through.iter().flat_map(|i| gradients[i]).collect())
                    })
                    .collect();
                rewrite
            });
        }
        module
    }

    fn replacement(
        &self,
        build: &mut CodeBuilder<'_>,
        own: &naga::Function,
        expression: &Expression,
        [x, y]: [Handle<Expression>; 2],
    ) -> Replacement {
        match expression {
            Expression::Derivative { axis, .. } => Replacement::Value(match axis {
                DerivativeAxis::X => x,
                DerivativeAxis::Y => y,
                DerivativeAxis::Width => {
                    let [x, y] = [x, y].map(|g| math(build, MathFunction::Abs, g));
                    build.expression(Expression::Binary {
                        op: naga::BinaryOperator::Add,
                        left: x,
                        right: y,
                    })
                }
            }),
            // An expression that needs no `Emit` is not available for scaling at the sample.
            Expression::ImageSample {
                level: SampleLevel::Bias(bias),
                ..
            } if matches!(own.expressions[*bias], Expression::Literal(_)) => {
                let bias = match own.expressions[*bias] {
                    Expression::Literal(naga::Literal::F32(bias)) => bias,
                    _ => 0.0,
                };
                let right = build.literal(naga::Literal::F32(bias.exp2()));
                let [x, y] = [x, y].map(|left| {
                    build.expression(Expression::Binary {
                        op: naga::BinaryOperator::Multiply,
                        left,
                        right,
                    })
                });
                Replacement::Gradients { x, y }
            }
            _ => Replacement::Footprint { x, y },
        }
    }
}

fn math(
    build: &mut CodeBuilder<'_>,
    fun: MathFunction,
    arg: Handle<Expression>,
) -> Handle<Expression> {
    build.expression(Expression::Math {
        fun,
        arg,
        arg1: None,
        arg2: None,
        arg3: None,
    })
}

/// The binding of a gradient.
fn input(location: u32) -> Binding {
    Binding::Location {
        location,
        interpolation: Some(Interpolation::Perspective),
        sampling: Some(Sampling::Center),
        blend_src: None,
        per_primitive: false,
    }
}

/// `a`, `b` and so on. naga's writers append their own number to a name that ends in a digit.
fn letters(mut n: usize) -> String {
    let mut out = String::new();
    loop {
        out.insert(0, char::from(b'a' + (n % 26) as u8));
        n /= 26;
        if n == 0 {
            return out;
        }
        n -= 1;
    }
}
