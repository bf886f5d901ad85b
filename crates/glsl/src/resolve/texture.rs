//! Texture functions of all GLSL versions.

use glsl_lang::ast::Expr;
use naga::{BinaryOperator as O, DerivativeAxis, DerivativeControl, MathFunction, Span};

use super::effect::after;
use super::expression::Ex;
use super::fold::Folds;
use super::{Pair, Resolver};
use crate::constant;
use crate::errors::{unsupported, wrong};
use crate::functions::Meaning;
use crate::interface::handles;
use crate::textures::{Level, Sampling, TextureFunction};
use crate::tree::{Case, Gather, GlobalKind, Kind, Node, Statement, StatementKind};
use crate::ty::{Component, Ty};
use crate::version::Dialect;
use shader_text::error::Error;
use shader_text::unsupported;

/// Maximum elements of a sampler array that nested `?` select. Older versions lack `switch`, and
/// their devices have no more textures.
const CHAIN: usize = 16;

/// The shape of a texture.
struct TextureShape<'a> {
    combined: &'a str,
    component: Component,
    shadow: bool,
    layered: bool,
    /// Number of coordinates, without the layer.
    coordinates: u8,
}

impl<'a> TextureShape<'a> {
    fn of(combined: &'a str) -> Self {
        Self {
            combined,
            component: match combined.chars().next() {
                Some('i') => Component::Int,
                Some('u') => Component::Uint,
                _ => Component::Float,
            },
            shadow: combined.ends_with("Shadow"),
            layered: combined.contains("Array"),
            coordinates: match combined {
                c if c.contains("1D") => 1,
                c if c.contains("2D") => 2,
                _ => 3,
            },
        }
    }

    /// The result type of a texture function.
    fn result(&self, function: TextureFunction) -> Ty {
        match function {
            TextureFunction::Size => {
                let size = if self.combined.contains("Cube") {
                    2
                } else {
                    self.coordinates
                };
                Ty::vector(Component::Int, size + u8::from(self.layered))
            }
            TextureFunction::Levels => Ty::INT,
            TextureFunction::Sample(_) if self.shadow => Ty::FLOAT,
            _ => Ty::Vector(self.component, 4),
        }
    }

    /// Whether a function takes these arguments after the sampler (GLSL 4.60, 8.9): `Some` if so,
    /// with whether the last is a bias.
    fn takes(&self, function: TextureFunction, rest: &[Ex]) -> Option<bool> {
        let multi = self.combined.contains("2DMS");
        let cube = self.combined.contains("Cube");
        let n = self.coordinates;
        let layers = u8::from(self.layered);
        let float = |n| Ty::vector(Component::Float, n);
        let int = |n| Ty::vector(Component::Int, n);
        let (wanted, bias) = match function {
            TextureFunction::Size if multi => (Vec::new(), false),
            TextureFunction::Size => (vec![Ty::INT], false),
            TextureFunction::Levels => (Vec::new(), false),
            TextureFunction::Fetch { has_offset: false } if !cube && !self.shadow => {
                (vec![int(n + layers), Ty::INT], false)
            }
            TextureFunction::Sample(of) if !multi => {
                let (projects, offset) = (of.projects, of.has_offset);
                let (lod, grad) = (of.level == Level::Exact, of.level == Level::Gradient);
                let is_flat = !self.layered && !cube;
                if projects && !is_flat || offset && cube {
                    return None;
                }
                let mut size = match (self.shadow, projects) {
                    (true, true) => 4,
                    (true, false) => n.max(2) + 1 + layers,
                    (false, true) => n + 1,
                    (false, false) => n + layers,
                };
                let mut wanted = Vec::new();
                if size > 4 {
                    if lod || grad || offset || projects {
                        return None;
                    }
                    size = 4;
                    wanted.push(Ty::FLOAT);
                }
                // A projected position may have four components.
                if projects && rest.first().is_some_and(|p| p.ty == float(4)) {
                    size = 4;
                }
                wanted.insert(0, float(size));
                if lod {
                    if self.shadow && self.layered && n == 2 {
                        return None;
                    }
                    wanted.push(Ty::FLOAT);
                }
                if grad {
                    wanted.extend([float(n), float(n)]);
                }
                if offset {
                    wanted.push(int(n));
                }
                (wanted, !lod && !grad)
            }
            _ => return None,
        };
        let given = rest.iter().map(|ex| &ex.ty);
        let fits = given
            .clone()
            .zip(&wanted)
            .all(|(given, wanted)| given == wanted);
        let is_bias = rest.len() == wanted.len() + 1 && bias;
        let last = rest.last().map(|ex| &ex.ty);
        let is_whole = rest.len() == wanted.len() || is_bias && last == Some(&Ty::FLOAT);
        (fits && is_whole).then_some(is_bias)
    }

    /// Adds 0.5 to the layer: GLSL rounds it to the nearest (4.60, 8.9), the IR truncates it.
    fn round_layer(&self, coordinates: &mut Ex) {
        let Ty::Vector(Component::Float, n) = coordinates.ty else {
            return;
        };
        if self.layered && self.coordinates < n {
            let half = |i: u8| Node::float(if i == self.coordinates { 0.5 } else { 0.0 });
            let halves = Node::construct(&coordinates.ty, (0..n).map(half).collect());
            let node = Node::binary(O::Add, coordinates.node.clone(), halves);
            *coordinates = Ex::new(node, coordinates.ty.clone());
        }
    }
}

impl Resolver<'_, '_> {
    /// A call of a texture function with the arguments `rest` after the sampler.
    pub(super) fn sample(
        &mut self,
        author: &str,
        mut function: TextureFunction,
        sampler: Ex,
        rest: Vec<Ex>,
        arguments: &[Expr],
        whole: &Expr,
    ) -> Result<Ex, Error> {
        let place = self.place(whole.span);
        // An opaque type is a separate texture, which only fetches and size queries take.
        let (Ty::Combined(combined) | Ty::Opaque(combined)) = &sampler.ty else {
            let message = format!("`{author}` takes a sampler, not a {}", sampler.ty.name());
            return Err(unsupported(message, place));
        };
        unsupported::refuse(author, place)?;
        let shape = TextureShape::of(combined);
        let result = shape.result(function);
        let fetches = function.fetches();
        // Offsets and the arguments of fetches are integers.
        let offset = function.offset();
        let kind = |i: usize, ty: &Ty| match (ty.kind(), fetches) {
            (Some(Component::Half), _) => Some(Component::Float),
            (Some(Component::Uint), true) => Some(Component::Int),
            (Some(Component::Int | Component::Uint), false) if offset != Some(i) => {
                Some(Component::Float)
            }
            _ => None,
        };
        let rest = rest.into_iter().enumerate();
        let mut rest: Vec<Ex> = rest
            .map(|(i, v)| {
                let kind = kind(i, &v.ty);
                self.coerce_kind(v, kind)
            })
            .collect();
        if !fetches && let Some(coordinates) = rest.first_mut() {
            shape.round_layer(coordinates);
        }
        if function == TextureFunction::Gather {
            return self.gathered(author, &shape, &sampler, rest, arguments, place);
        }
        if !fetches && shape.component != Component::Float {
            return Err(unsupported(
                format!(
                    "`{author}` of `{combined}` is not supported: WebGPU's samplers read no integers"
                ),
                place,
            )
            .note("read a texel by `texelFetch`, with integer coordinates within `textureSize`"));
        }
        if let Some(at) = offset {
            let is_constant = arguments
                .get(1 + at)
                .is_none_or(|e| self.stage.fixed(e).is_some());
            if !is_constant && rest.get(at).is_some_and(|ex| ex.folds == Folds::No) {
                let message = format!("the offset of `{author}` must be a constant");
                return Err(wrong(message, place));
            }
            self.name_offsets(&mut rest, arguments);
        }
        if function == (TextureFunction::Fetch { has_offset: true }) && rest.len() == 3 {
            add_fetch_offset(&mut rest);
            function = TextureFunction::Fetch { has_offset: false };
        }
        let Some(has_bias) = shape.takes(function, &rest) else {
            let message = format!("no `{author}` takes these arguments");
            return Err(wrong(message, place));
        };
        self.check_level(author, function, &shape, has_bias, arguments, place)?;
        let mut first = Vec::new();
        if let TextureFunction::Sample(of) = &mut function {
            if shape.shadow && of.projects {
                first.extend(self.project(&mut rest));
                of.projects = false;
            }
            if self.is_vertex() && of.level == Level::Implicit {
                use_base_level(&shape, &mut rest);
                of.level = Level::Exact;
            }
        }
        let (before, ex) = self.select_sampler(function, &sampler, &rest, result, place)?;
        first.splice(0..0, before);
        Ok(after(first, ex))
    }

    /// Rejects levels and biases that the stage or WebGPU lacks.
    fn check_level(
        &self,
        author: &str,
        function: TextureFunction,
        shape: &TextureShape<'_>,
        has_bias: bool,
        arguments: &[Expr],
        place: Option<Span>,
    ) -> Result<(), Error> {
        if has_bias && self.is_vertex() {
            let message = format!("`{author}` takes a bias only in a fragment stage");
            return Err(wrong(message, place));
        }
        let TextureFunction::Sample(Sampling { level, .. }) = function else {
            return Ok(());
        };
        let is_zero = |at: usize| {
            let known = arguments.get(at).and_then(|e| self.stage.fixed(e));
            known.is_some_and(|value| constant::is_zero(&value))
        };
        let what = match level {
            _ if !shape.shadow => return Ok(()),
            Level::Implicit if has_bias => "a bias",
            Level::Exact if !is_zero(2) => "a level other than 0.0",
            // Without a gradient the level is the first, which is how level 0.0 of a cube is written.
            Level::Gradient if !(is_zero(2) && is_zero(3)) => "gradients other than 0.0",
            _ => return Ok(()),
        };
        let message = format!(
            "`{author}` of `{}` with {what} is not supported",
            shape.combined
        );
        Err(unsupported(message, place).note("WebGPU's comparisons take neither levels nor biases"))
    }

    /// Makes literal offsets named constants, as naga's GLSL writer requires.
    fn name_offsets(&mut self, rest: &mut [Ex], arguments: &[Expr]) {
        for (offset, argument) in rest.iter_mut().zip(arguments.iter().skip(1)).skip(1) {
            let known = self.stage.fixed(argument).and_then(constant::integers);
            let (Ty::Vector(Component::Int, _), Some(parts)) = (&offset.ty, known) else {
                continue;
            };
            let at = self.offsets.iter().position(|(known, _)| *known == parts);
            let id = match at {
                Some(at) => self.offsets[at].1,
                None => {
                    let name = self.helper_name(&format!("offset_{}", self.offsets.len()));
                    let all = parts.iter().map(|n| Node::int(*n)).collect();
                    let kind = GlobalKind::Constant {
                        init: Node::construct(&offset.ty, all),
                        ty: offset.ty.clone(),
                    };
                    let (id, _) = self.global_node(Some(name), kind, None);
                    self.offsets.push((parts, id));
                    id
                }
            };
            *offset = Ex::new(Node::new(Kind::Global(id)), offset.ty.clone());
        }
    }

    /// Divides three coordinates by the fourth, because the IR's comparisons do not project.
    fn project(&mut self, rest: &mut [Ex]) -> Option<Node> {
        let coordinates = rest.first_mut()?;
        let (before, held) = self.once(coordinates);
        let (xyz, w) = (held.node.swizzle(0..3), held.node.component(3));
        let ty = Ty::Vector(Component::Float, 3);
        *coordinates = Ex::new(Node::binary(O::Divide, xyz, w), ty);
        before
    }

    /// The call. For a dynamically indexed sampler array, one call per element. Also returns the
    /// assignment that evaluates the index.
    fn select_sampler(
        &mut self,
        function: TextureFunction,
        sampler: &Ex,
        rest: &[Ex],
        result: Ty,
        place: Option<Span>,
    ) -> Result<(Option<Node>, Ex), Error> {
        let call = |sampler: Node| {
            let rest = rest.iter().map(|r| r.node.clone());
            Node::texture(function, [sampler].into_iter().chain(rest).collect()).at(place)
        };
        let Some((index, pairs)) = &sampler.choice else {
            return Ok((None, Ex::new(call(sampler.node.clone()), result)));
        };
        let Some(first) = pairs.first() else {
            return Err(unsupported(
                "an array of samplers without a length is not supported",
                place,
            )
            .note(
                "give it a length, or compile both files with `glslangValidator -V` and give \
                     the .spv files",
            ));
        };
        let combined = first.combined.as_str();
        let gradients =
            self.stage.unit.is_nonuniform && function.is_implicit() && !self.is_vertex();
        let has_gradients = matches!(function, TextureFunction::Sample(of) if of.level == Level::Implicit && !of.projects)
            && !combined.ends_with("Shadow");
        let is_large = pairs.len() > CHAIN;
        if (gradients && has_gradients || !gradients && is_large && self.has_switch())
            && let Some(ex) = self.switched(function, index, pairs, rest, &result, gradients)
        {
            return Ok((None, ex));
        }
        if gradients {
            return Err(unsupported(
                format!(
                    "`{}` of a {combined} that `nonuniformEXT` selects is not supported: the \
                     invocations would derive its level apart",
                    function.name()
                ),
                place,
            )
            .note("use `textureLod` or `textureGrad`"));
        }
        // GLSL requires a dynamically uniform index, so this control flow is uniform.
        let (before, index) = self.once(index);
        if before.is_none() && self.temporaries.is_none() && !index.node.is_pure() {
            return Err(unsupported(
                "a call that selects a sampler must be in a function",
                place,
            ));
        }
        let calls: Vec<Node> = pairs.iter().map(|pair| call(pair.node())).collect();
        let index = &index.node;
        let node = match calls.split_last() {
            Some((last, others)) if !is_large => {
                let others = others.iter().enumerate().rev();
                others.fold(last.clone(), |rest, (i, call)| {
                    let is_it = Node::binary(O::Equal, index.clone(), Node::int(i as i32));
                    Node::choose(is_it, call.clone(), rest)
                })
            }
            _ => halved(index, 0, &calls),
        };
        Ok((before, Ex::new(node, result)))
    }

    fn has_switch(&self) -> bool {
        let Dialect { version, es } = self.stage.unit.dialect;
        version >= if es { 300 } else { 130 }
    }

    /// A call of a helper function that selects the sampler by a `switch`. With `gradients`,
    /// derivatives are computed before it. `None` if the samplers are parameters, or a type is
    /// unknown.
    fn switched(
        &mut self,
        mut function: TextureFunction,
        index: &Ex,
        pairs: &[Pair],
        rest: &[Ex],
        result: &Ty,
        gradients: bool,
    ) -> Option<Ex> {
        let first = pairs.first()?;
        let shape = TextureShape::of(&first.combined);
        let Kind::Global(texture) = *first.texture.kind else {
            return None;
        };
        // Offsets must stay constants.
        let offset_of = |this: &Self, r: &Ex| match *r.node.kind {
            Kind::Global(id) if this.offsets.iter().any(|(_, of)| *of == id) => {
                this.out.globals[id.0].name.clone()
            }
            _ => None,
        };
        let array = self.out.globals[texture.0].name.clone().unwrap_or_default();
        let type_of = |r: &Ex| offset_of(self, r).unwrap_or_else(|| r.ty.base_name());
        let types: Vec<String> = rest.iter().map(type_of).collect();
        let array = array.trim_end_matches("_0");
        let wanted = format!("{}_{array}_{}", function.name(), types.join("_"));
        let mut helper = self.helper(&wanted, result);
        let which = helper.parameter("which", &Ty::INT);
        let mut given = vec![Node::convert(&Ty::INT, index.node.clone())];
        let mut inner = Vec::new();
        for (i, r) in rest.iter().enumerate() {
            inner.push(match offset_of(self, r) {
                Some(_) => r.node.clone(),
                None => {
                    given.push(r.node.clone());
                    helper.parameter(&format!("a{i}"), &r.ty)
                }
            });
        }
        if let (true, TextureFunction::Sample(sampling)) = (gradients, &mut function) {
            let coordinates = Ty::vector(Component::Float, shape.coordinates);
            let of = match rest.first()?.ty == coordinates {
                true => inner.first()?.clone(),
                false => inner.first()?.swizzle(0..u32::from(shape.coordinates)),
            };
            let has_offset = usize::from(sampling.has_offset);
            // A bias multiplies the gradients (GLSL 4.60, 8.9).
            let bias = inner
                .last()
                .filter(|_| inner.len() > 1 + has_offset)
                .cloned();
            inner.truncate(1 + has_offset);
            for (at, axis) in ["dx", "dy"].into_iter().enumerate() {
                let along = [DerivativeAxis::X, DerivativeAxis::Y][at];
                let derivative = Meaning::Derivative(along, DerivativeControl::None);
                let mut value = Node::built_in(derivative, vec![of.clone()]);
                if let Some(bias) = &bias {
                    let factor = Node::math(MathFunction::Exp2, vec![bias.clone()]);
                    value = Node::binary(O::Multiply, value, factor);
                }
                let local = self.add_local(axis, coordinates.clone());
                inner.insert(1 + at, helper.declare(local, Some(value)));
            }
            sampling.level = Level::Gradient;
        }
        let chosen = self.add_local("chosen", result.clone());
        let chosen = helper.declare(chosen, None);
        let cases = pairs.iter().enumerate().map(|(i, pair)| {
            let all = [pair.node()].into_iter().chain(inner.iter().cloned());
            let call = Node::texture(function, all.collect());
            Case {
                value: (i + 1 < pairs.len()).then_some(i as i64),
                body: vec![
                    Statement::evaluate(Node::assign(&chosen, call)),
                    Statement::new(StatementKind::Break),
                ],
            }
        });
        helper.switch(which, cases.collect());
        helper.returns(chosen);
        let id = self.add_helper(helper);
        Some(Ex::new(Node::new(Kind::Call(id, given)), result.clone()))
    }

    /// `textureGather` and `textureGatherOffset`: calls a helper for each kind of gather.
    fn gathered(
        &mut self,
        author: &str,
        shape: &TextureShape<'_>,
        sampler: &Ex,
        rest: Vec<Ex>,
        arguments: &[Expr],
        place: Option<Span>,
    ) -> Result<Ex, Error> {
        let Some(pair) = &sampler.pair else {
            return Err(unsupported(
                format!("`{author}` needs a named sampler"),
                place,
            ));
        };
        let has_offset = author == "textureGatherOffset";
        let n = shape.coordinates;
        if rest.len() > 2 + usize::from(has_offset) || shape.layered || has_offset && n == 3 {
            return Err(unsupported(
                format!("`{author}` of `{}` is not supported", shape.combined),
                place,
            )
            .note("use textures without layers, or fetch the four texels"));
        }
        let taken = if shape.shadow { 2 } else { 1 };
        let mut others = arguments.iter().skip(1 + taken);
        let offset = match has_offset {
            true => {
                let known = others.next().and_then(|e| self.stage.fixed(e));
                let known = known.and_then(constant::integers);
                let known = known.and_then(|parts| <[i32; 2]>::try_from(parts).ok());
                // WGSL allows no other offsets.
                let known = known.filter(|parts| parts.iter().all(|part| (-8..8).contains(part)));
                Some(known.ok_or_else(|| {
                    unsupported(
                        format!("`{author}`'s offset must be constant, from -8 to 7"),
                        place,
                    )
                    .note("fetch the four texels")
                })?)
            }
            false => None,
        };
        let component = match others.next() {
            Some(e) => self.stage.fixed_integer(e),
            None => Some(0),
        };
        let component = component
            .and_then(|n| u32::try_from(n).ok())
            .ok_or_else(|| {
                unsupported(format!("`{author}`'s component must be a number"), place)
            })?;
        let combined = shape.combined;
        let by = offset.map(|[x, y]| format!("_by_{x}_{y}").replace('-', "m"));
        let by = by.unwrap_or_default();
        let result = Ty::Vector(shape.component, 4);
        let mut helper = self.helper(&format!("gather_{combined}_{component}{by}"), &result);
        let [texture, of] = handles(combined);
        let gather = Gather {
            texture: helper.handle("t", texture),
            sampler: helper.handle("s", of),
            coordinates: helper.parameter("p", &Ty::vector(Component::Float, n)),
            depth: shape.shadow.then(|| helper.parameter("depth", &Ty::FLOAT)),
            component,
            offset,
        };
        helper.returns(Node::new(Kind::Gather(gather)));
        let id = self.add_helper(helper.plain());
        let mut all = vec![pair.texture.clone(), pair.sampler.clone()];
        all.extend(rest.iter().take(taken).map(|r| r.node.clone()));
        Ok(Ex::new(Node::new(Kind::Call(id, all)), result))
    }
}

/// Selects one of `calls`, the first of which has the index `first`, by nested halves.
fn halved(index: &Node, first: usize, calls: &[Node]) -> Node {
    if let [call] = calls {
        return call.clone();
    }
    let (low, high) = calls.split_at(calls.len() / 2);
    let middle = first + low.len();
    let is_low = Node::binary(O::Less, index.clone(), Node::int(middle as i32));
    let (low, high) = (halved(index, first, low), halved(index, middle, high));
    Node::choose(is_low, low, high)
}

/// Adds the offset of a `texelFetchOffset` to its coordinates.
fn add_fetch_offset(rest: &mut Vec<Ex>) {
    let [p, _, offset] = &rest[..] else {
        return;
    };
    let by = offset.node.clone();
    let by = match (&p.ty, &offset.ty) {
        (Ty::Vector(_, n), Ty::Vector(_, m)) if n > m => {
            Node::construct(&Ty::Vector(Component::Int, *n), vec![by, Node::int(0)])
        }
        _ => by,
    };
    rest[0] = Ex::new(Node::binary(O::Add, p.node.clone(), by), p.ty.clone());
    rest.truncate(2);
}

/// Without derivatives, GLSL samples the base level (4.60, 8.9).
fn use_base_level(shape: &TextureShape<'_>, rest: &mut Vec<Ex>) {
    // The reference of an array of cubes is a separate argument.
    let level = 1 + usize::from(shape.shadow && shape.layered && shape.coordinates == 3);
    rest.insert(level, Ex::new(Node::float(0.0), Ty::FLOAT));
}
