//! Edges subdivided by their length on the screen.
//!
//! ```text
//! fn vs(vertex, instance) -> VertexOutput_hoist {
//!     a, b, c = corner(..)                        the author's stage on the three corners
//!     point   = tessellated_adapt(.., a.position, b.position, c.position)
//!     author  = blend(pick(point.order, a, b, c), point.weights)
//!     if point.surplus { return VertexOutput_hoist(author.position, .., 0) }
//!     return rest(author)
//! }
//! ```
//!
//! The pattern has the highest level. A triangle uses as many rows as its longest edge has
//! segments, and snaps the vertices on each edge to the nearest of that edge's points. So both
//! triangles of an edge agree on its points, without cracks or T-junctions. Unused parts of the
//! pattern have no area and skip the hoisted work.

use naga::{Expression, Function, Handle, Module, Statement};

use super::build::{self, access, vertex_inputs};
use super::split::{Carried, Origin, Outputs, Split};
use super::text::Text;
use preshade_dataflow::graph::FunctionId;
use preshade_passes::rebuild::place::{self, CodeBuilder, Rewrite};
use preshade_passes::rebuild::snippet::{Linked, ours, word};

/// `module` with a vertex entry point that draws the pattern.
///
/// # Errors
/// The reason as text: our own WGSL does not parse or link, or the author's stage has an input that
/// no vertex stage has.
pub(crate) fn adaptive(
    module: Module,
    entry: usize,
    split: &Split,
    outputs: &Outputs,
    text: &Text<'_>,
) -> Result<Module, String> {
    let name = module.entry_points[entry].name.clone();
    let Linked {
        module,
        ours: by_name,
    } = Linked::new(module, &text.wgsl())?;
    let place = ours(&by_name, "tessellated_place")?;
    let adapt = ours(&by_name, "tessellated_adapt")?;
    let blend = |width: &u8| {
        Ok(Interpolation {
            width: *width,
            blend: ours(&by_name, &format!("tessellated_blend_{width}_"))?,
            pick: ours(&by_name, &format!("tessellated_pick_{width}_"))?,
        })
    };
    let functions: Vec<Interpolation> = text
        .widths
        .iter()
        .map(blend)
        .collect::<Result<_, String>>()?;
    let fetch = build::fetch(&by_name, text)?;
    let (module, corner) = build::corner(module, &name, split, &fetch)?;
    let (mut module, rest) = build::code_behind(module, &name, split);
    let origins = split
        .origins()
        .ok_or("the vertex stage's result is not put together")?;
    let word = word(&mut module);
    let point = &mut module.entry_points[entry].function;
    let result = point.result.clone();
    *point = Function {
        name: point.name.clone(),
        result: result.clone(),
        ..Function::default()
    };
    let result = result.ok_or("the vertex stage gives nothing")?.ty;
    let members = naga_edit::interface::members(&module, result).unwrap_or_default();
    let mut failed = None;
    let module = place::rewritten(&module, FunctionId::EntryPoint(entry), |build| {
        let inputs = vertex_inputs(build, word);
        let Some(place) = build.call(place, inputs) else {
            return Rewrite::default();
        };
        let all = access(build, place, 0);
        let instance = access(build, place, 2);
        let Some(corners) = corners(build, corner, all, instance) else {
            failed = Some("the author's vertex stage gives nothing");
            return Rewrite::default();
        };
        let mut passed = vec![access(build, place, 1)];
        for given in &corners {
            passed.push(output(build, outputs, *given, outputs.position));
        }
        let Some(point) = build.call(adapt, passed) else {
            return Rewrite::default();
        };
        build.name(point, "point");
        let Some(components) = interpolated(build, outputs, &functions, &corners, point) else {
            failed = Some("a varying has no function that interpolates it");
            return Rewrite::default();
        };
        let author = match components[..] {
            [only] if !outputs.is_struct => only,
            _ => build.expression(Expression::Compose {
                ty: split.given,
                components,
            }),
        };
        build.name(author, "author");
        let surplus = access(build, point, 2);
        build.if_then(surplus, |build| {
            let mut components = Vec::new();
            for (origin, (ty, _)) in origins.iter().zip(&members) {
                components.push(match origin {
                    Origin::Author(Some(of)) => access(build, author, *of),
                    Origin::Author(None) => author,
                    Origin::Hoisted => build.expression(Expression::ZeroValue(*ty)),
                });
            }
            let value = build.expression(Expression::Compose {
                ty: result,
                components,
            });
            build.statement(Statement::Return { value: Some(value) });
        });
        let value = build.call(rest, vec![author]);
        build.statement(Statement::Return { value });
        Rewrite::default()
    });
    match failed {
        None => Ok(module),
        Some(why) => Err(why.to_owned()),
    }
}

/// The functions that interpolate values with this many components.
struct Interpolation {
    width: u8,
    blend: Handle<Function>,
    /// Selects the value of one of the three vertices.
    pick: Handle<Function>,
}

/// An output of the author's stage, whose result is `base`.
fn output(
    build: &mut CodeBuilder<'_>,
    outputs: &Outputs,
    base: Handle<Expression>,
    index: usize,
) -> Handle<Expression> {
    match outputs.is_struct {
        true => access(build, base, index as u32),
        false => base,
    }
}

/// The author's outputs at `point`, from those at the three vertices. `None` if no function has the
/// width of an output.
fn interpolated(
    build: &mut CodeBuilder<'_>,
    outputs: &Outputs,
    functions: &[Interpolation],
    corners: &[Handle<Expression>],
    point: Handle<Expression>,
) -> Option<Vec<Handle<Expression>>> {
    let order = access(build, point, 0);
    let weights = access(build, point, 1);
    let in_order = build.literal(naga::Literal::Bool(false));
    let mut components = Vec::new();
    for (i, carried) in outputs.carried.iter().enumerate() {
        let given = corners.iter().map(|c| output(build, outputs, *c, i));
        let given: Vec<_> = given.collect();
        let Carried::Blended(width) = carried else {
            components.push(given[0]);
            continue;
        };
        let function = functions.iter().find(|f| f.width == *width)?;
        let mut arguments = vec![weights, in_order];
        for place in 0..3 {
            let which = access(build, order, place);
            let from = [vec![which], given.clone()].concat();
            arguments.extend(build.call(function.pick, from));
        }
        components.extend(build.call(function.blend, arguments));
    }
    Some(components)
}

/// The results of the author's stage at the three vertices `all`.
fn corners(
    build: &mut CodeBuilder<'_>,
    corner: Handle<Function>,
    all: Handle<Expression>,
    instance: Handle<Expression>,
) -> Option<Vec<Handle<Expression>>> {
    let mut corners = Vec::new();
    for (index, name) in (0..).zip(["a", "b", "c"]) {
        let vertex = access(build, all, index);
        let given = build.call(corner, vec![vertex, instance])?;
        build.name(given, name);
        corners.push(given);
    }
    Some(corners)
}

/// The functions that place a vertex, for edges of about `edge_pixels` and at most `most` segments.
pub(crate) fn text(edge_pixels: u32, most: u32) -> String {
    format!(
        "{POINT}
/// Segments of an edge: the fewest that are no longer than asked for, in whole numbers, so that
/// both of its triangles find the same. What reaches behind the viewer has the most.
fn tessellated_segments(p: vec4<f32>, q: vec4<f32>, at_p: vec2<i32>, at_q: vec2<i32>) -> u32 {{
    if (p.w <= 0.0 || q.w <= 0.0) {{
        return {most}u;
    }}
    let along = at_q - at_p;
    let square = u32(along.x * along.x) + u32(along.y * along.y);
    var n = clamp(u32(sqrt(f32(square)) / {unit}.0), 2u, {most}u + 1u) - 1u;
    n += u32(n * n * {area}u < square);
    n += u32(n * n * {area}u < square);
    n += u32(n * n * {area}u < square);
    return min(n, {most}u);
}}
{ADAPT}",
        unit = 2 * edge_pixels,
        area = 4 * edge_pixels * edge_pixels,
    )
}

const POINT: &str = "struct TessellatedPoint {
    order: vec3<u32>,
    weights: vec3<f32>,
    surplus: bool,
}
/// Where a position is on the screen, in half pixels.
fn tessellated_pixel(p: vec4<f32>) -> vec2<i32> {
    let at = p.xy / p.w * vec2<f32>(tessellation.viewport.xy);
    return vec2<i32>(round(clamp(at, vec2<f32>(-16384.0), vec2<f32>(16384.0))));
}";

const ADAPT: &str = "\
fn tessellated_adapt(packed: u32, a: vec4<f32>, b: vec4<f32>, c: vec4<f32>) -> TessellatedPoint {
    let at_a = tessellated_pixel(a);
    let at_b = tessellated_pixel(b);
    let at_c = tessellated_pixel(c);
    let ab = tessellated_segments(a, b, at_a, at_b);
    let ac = tessellated_segments(a, c, at_a, at_c);
    let bc = tessellated_segments(b, c, at_b, at_c);
    let inner = max(ab, max(ac, bc));
    let row = min(packed & 255u, inner);
    let column = min(packed >> 8u, row);
    let surplus = (packed & 255u) > inner;
    var ends = vec2<u32>(0u, 1u);
    var p = a;
    var q = b;
    var step = row;
    var segments = ab;
    if (column > 0u) {
        if (column == row) {
            ends = vec2<u32>(0u, 2u);
            q = c;
            step = column;
            segments = ac;
        } else if (row == inner) {
            ends = vec2<u32>(1u, 2u);
            p = b;
            q = c;
            step = column;
            segments = bc;
        } else {
            let all = vec3<f32>(vec3<u32>(inner - row, row - column, column));
            return TessellatedPoint(vec3<u32>(0u, 1u, 2u), all / f32(inner), surplus);
        }
    }
    if (tessellated_precedes(q, p)) {
        ends = ends.yx;
        step = inner - step;
    }
    let nearest = (2u * step * segments + inner) / (2u * inner);
    if (nearest == 0u || nearest == segments) {
        let corner = select(ends.y, ends.x, nearest == 0u);
        return TessellatedPoint(vec3<u32>(corner), vec3<f32>(1.0, 0.0, 0.0), surplus);
    }
    let second = f32(nearest) / f32(segments);
    return TessellatedPoint(ends.xyx, vec3<f32>(1.0 - second, second, 0.0), surplus);
}
";
