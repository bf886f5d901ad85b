//! The id pass: position, coverage and depth, and the id of triangle and instance.
//!
//! ```text
//! @vertex   fn vs_visible_ids(..)  -> VertexOutput_ids      the author's outputs (or position alone), and `visible_id_of(instance_index)`, flat
//! @fragment fn fs_visible_ids(..)  -> vec2<u32>             discards as the author does; the id, and the triangle with its side
//! ```

use naga::{
    Binding, BuiltIn, EntryPoint, Expression, Function, FunctionArgument, FunctionResult, Handle,
    Interpolation, Module, Sampling, Scalar, ShaderStage, Span, Statement, StructMember, Type,
    TypeInner, VectorSize,
};
use naga_edit::interface;
use preshade_plan::draw_table::Words;

use super::text::{self, Slots};
use crate::corner::{Author, corner};
use naga_edit::interface::Io;
use preshade_dataflow::graph::FunctionId;
use preshade_passes::rebuild::outline::as_function;
use preshade_passes::rebuild::place::{self, CodeBuilder, Rewrite};
use preshade_passes::rebuild::snippet::{Linked, ours, word};
use preshade_plan::geometry::Formats;
use preshade_plan::plan::AttributeUse;

pub(crate) const VERTEX: &str = "vs_visible_ids";
pub(crate) const FRAGMENT: &str = "fs_visible_ids";

/// How a resolve determines the facing of a pixel's triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Facing {
    /// It is not needed, or only front faces are visible.
    Front,
    /// Only back faces are visible.
    Back,
    /// From the id. Computing it from the corners would not match the rasteriser, which snaps
    /// vertices.
    Written,
}

/// How a fragment determines its triangle.
pub(crate) enum Triangles<'a> {
    /// From the builtin `primitive_index`.
    PrimitiveIndex,
    /// From a flat varying of unshared vertices: the attributes to fetch and their bindings.
    Unindexed(&'a [AttributeUse], Formats),
}

/// An entry point as a function, with its inputs and outputs.
struct IdStage {
    function: Handle<Function>,
    arguments: Vec<FunctionArgument>,
    result: Option<FunctionResult>,
    outputs: Vec<Io>,
}

impl IdStage {
    /// Converts the named entry point to a function.
    fn take(module: &mut Module, stage: ShaderStage, name: &str) -> Option<Self> {
        let at = module
            .entry_points
            .iter()
            .position(|e| e.stage == stage && e.name == name)?;
        let entry = module.entry_points.remove(at);
        let outputs = interface::outputs(module, &entry.function);
        let (arguments, result) = (
            entry.function.arguments.clone(),
            entry.function.result.clone(),
        );
        let function = as_function(module, entry.function, name);
        Some(Self {
            function: module.functions.append(function, Span::UNDEFINED),
            arguments,
            result,
            outputs,
        })
    }

    /// The outputs in a call's result.
    fn parts(
        &self,
        build: &mut CodeBuilder<'_>,
        value: Handle<Expression>,
    ) -> Vec<Handle<Expression>> {
        let is_bare = self.result.as_ref().is_some_and(|r| r.binding.is_some());
        (0..self.outputs.len() as u32)
            .map(|index| match is_bare {
                true => value,
                false => build.expression(Expression::AccessIndex { base: value, index }),
            })
            .collect()
    }

    fn call(&self, build: &mut CodeBuilder<'_>) -> Option<Handle<Expression>> {
        build.call_with_inputs(self.function, &self.arguments)
    }
}

/// `module` with the id pass's entry points in place of the depth-only ones with these names.
///
/// # Errors
/// The reason as text: our own WGSL does not parse or link, or an input has no source.
pub(crate) fn add(
    module: Module,
    vertex: &str,
    fragment: Option<&str>,
    triangles: &Triangles<'_>,
    slots: Slots,
    (words, facing): (Words, Facing),
) -> Result<Module, String> {
    let mut wgsl = text::entry(
        slots,
        match triangles {
            Triangles::PrimitiveIndex => 0,
            Triangles::Unindexed(attributes, _) => attributes.len(),
        },
    );
    wgsl.push_str(&text::ids(words, facing));
    if let Triangles::Unindexed(attributes, formats) = triangles {
        wgsl.push_str(&text::vertices(slots, attributes, *formats));
    }
    let Linked {
        mut module,
        ours: by_name,
    } = Linked::new(module, &wgsl)?;
    let id_of = ours(&by_name, "visible_id_of")?;
    let written = ours(&by_name, "visible_written")?;
    let word = word(&mut module);
    let vertex = IdStage::take(&mut module, ShaderStage::Vertex, vertex)
        .ok_or("there is no depth-only vertex stage")?;
    let fragment =
        fragment.and_then(|name| IdStage::take(&mut module, ShaderStage::Fragment, name));
    let (id_type, pulled) = match triangles {
        Triangles::PrimitiveIndex => (word, None),
        Triangles::Unindexed(attributes, _) => {
            let mut fetch = Vec::new();
            for attribute in *attributes {
                let name = format!("visible_{}_", attribute.location);
                fetch.push((attribute.location, ours(&by_name, &name)?));
            }
            let given = vertex.result.as_ref().map(|r| r.ty);
            let author = Author {
                function: vertex.function,
                given: given.ok_or("the vertex stage gives nothing")?,
                inputs: &vertex.arguments,
            };
            let name = VERTEX;
            let (with_corner, pulled) = corner(module, name, &author, &fetch)?;
            module = with_corner;
            let pair = vec2(&mut module);
            (pair, Some((pulled, ours(&by_name, "visible_corner")?)))
        }
    };
    let location = free_location(&vertex.outputs);
    let flat = Binding::Location {
        location,
        interpolation: Some(Interpolation::Flat),
        // All vertices of a triangle have the same value.
        sampling: Some(Sampling::Either),
        blend_src: None,
        per_primitive: false,
    };
    let result = vertex_result(&mut module, &vertex, id_type, &flat);
    let at = new_entry(
        &mut module,
        ShaderStage::Vertex,
        VERTEX,
        Some((result, None)),
    );
    let mut failed = false;
    module = place::rewritten(&module, FunctionId::EntryPoint(at), |build| {
        let (position, id) = match pulled {
            None => {
                let position = vertex.call(build);
                let instance = Binding::BuiltIn(BuiltIn::InstanceIndex);
                let instance = build.input("instance", word, &instance);
                (position, build.call(id_of, vec![instance]))
            }
            Some((pulled, corner_of)) => {
                unindexed(build, [word, id_type], [pulled, corner_of, id_of])
            }
        };
        let (Some(position), Some(id)) = (position, id) else {
            failed = true;
            return Rewrite::default();
        };
        let mut components = vertex.parts(build, position);
        components.push(id);
        let value = build.expression(Expression::Compose {
            ty: result,
            components,
        });
        build.statement(Statement::Return { value: Some(value) });
        Rewrite::default()
    });
    if failed {
        return Err("the vertex stage gives nothing".to_owned());
    }
    Ok(fragment_entry(
        module,
        fragment.as_ref(),
        (id_type, &flat),
        (word, written),
        facing,
    ))
}

/// The position and the id of a vertex drawn without indices: vertex `3 n + k` is corner `k` of
/// triangle `n`.
fn unindexed(
    build: &mut CodeBuilder<'_>,
    [word, id_type]: [Handle<Type>; 2],
    [pulled, corner_of, id_of]: [Handle<Function>; 3],
) -> (Option<Handle<Expression>>, Option<Handle<Expression>>) {
    let inputs = [
        ("vertex", BuiltIn::VertexIndex),
        ("instance", BuiltIn::InstanceIndex),
    ];
    let [index, instance] = inputs.map(|(n, b)| build.argument(n, word, Some(Binding::BuiltIn(b))));
    let three = build.literal(naga::Literal::U32(3));
    let operators = [naga::BinaryOperator::Divide, naga::BinaryOperator::Modulo];
    let [triangle, corner] = operators.map(|op| {
        build.expression(Expression::Binary {
            op,
            left: index,
            right: three,
        })
    });
    build.name(triangle, "triangle");
    let called = build.call(corner_of, vec![triangle, corner]);
    let position = called.and_then(|v| build.call(pulled, vec![v, instance]));
    let id = build.call(id_of, vec![instance]).map(|id| {
        build.expression(Expression::Compose {
            ty: id_type,
            components: vec![id, triangle],
        })
    });
    (position, id)
}

fn vec2(module: &mut Module) -> Handle<Type> {
    let inner = TypeInner::Vector {
        size: VectorSize::Bi,
        scalar: Scalar::U32,
    };
    module
        .types
        .insert(Type { name: None, inner }, Span::UNDEFINED)
}

fn free_location(outputs: &[Io]) -> u32 {
    let is_taken = |free: u32| {
        outputs.iter().any(
            |o| matches!(o.binding, Some(Binding::Location { location, .. }) if location == free),
        )
    };
    (0..).find(|l| !is_taken(*l)).unwrap_or_default()
}

/// The vertex stage's outputs followed by the id.
fn vertex_result(
    module: &mut Module,
    vertex: &IdStage,
    id_type: Handle<Type>,
    flat: &Binding,
) -> Handle<Type> {
    let mut members: Vec<StructMember> = vertex
        .outputs
        .iter()
        .map(|o| StructMember {
            name: Some(o.name.clone().unwrap_or_else(|| "position".to_owned())),
            ty: o.ty,
            binding: o.binding.clone(),
            offset: 0,
        })
        .collect();
    members.push(StructMember {
        name: Some("id".to_owned()),
        ty: id_type,
        binding: Some(flat.clone()),
        offset: 0,
    });
    place::io_struct(module, Some("VisibleVertex".to_owned()), members)
}

/// Appends an empty entry point and returns its index.
pub(crate) fn new_entry(
    module: &mut Module,
    stage: ShaderStage,
    name: &str,
    result: Option<(Handle<Type>, Option<Binding>)>,
) -> usize {
    module.entry_points.push(EntryPoint {
        name: name.to_owned(),
        stage,
        early_depth_test: None,
        workgroup_size: [0; 3],
        workgroup_size_overrides: None,
        function: Function {
            name: Some(name.to_owned()),
            result: result.map(|(ty, binding)| FunctionResult { ty, binding }),
            ..Function::default()
        },
        mesh_info: None,
        task_payload: None,
        incoming_ray_payload: None,
    });
    module.entry_points.len() - 1
}

/// Discards and writes depth as the author does, and writes the id.
fn fragment_entry(
    mut module: Module,
    decides: Option<&IdStage>,
    (id_type, flat): (Handle<Type>, &Binding),
    (word, written): (Handle<Type>, Handle<Function>),
    facing: Facing,
) -> Module {
    let pair = vec2(&mut module);
    let stored = module.functions[written].result.as_ref();
    let stored = stored.map_or(pair, |r| r.ty);
    let target = Binding::Location {
        location: 0,
        interpolation: None,
        sampling: None,
        blend_src: None,
        per_primitive: false,
    };
    let depth = decides.and_then(|d| d.outputs.first());
    let result = match depth {
        None => (stored, Some(target)),
        Some(depth) => {
            let member = |name: &str, ty, binding| StructMember {
                name: Some(name.to_owned()),
                ty,
                binding,
                offset: 0,
            };
            let members = vec![
                member("id", stored, Some(target)),
                member("depth", depth.ty, depth.binding.clone()),
            ];
            let ty = place::io_struct(&mut module, Some("VisibleFragment".to_owned()), members);
            (ty, None)
        }
    };
    let ty = result.0;
    let at = new_entry(&mut module, ShaderStage::Fragment, FRAGMENT, Some(result));
    place::rewritten(&module, FunctionId::EntryPoint(at), |build| {
        let depth = decides.and_then(|d| {
            let value = d.call(build)?;
            d.parts(build, value).first().copied()
        });
        let id = build.argument("id", id_type, Some(flat.clone()));
        let id = match id_type == word {
            false => id,
            true => {
                let builtin = Binding::BuiltIn(BuiltIn::PrimitiveIndex);
                let triangle = build.input("triangle", word, &builtin);
                build.expression(Expression::Compose {
                    ty: pair,
                    components: vec![id, triangle],
                })
            }
        };
        let mut passed = vec![id];
        if facing == Facing::Written {
            let ty = build.ty(TypeInner::Scalar(Scalar::BOOL));
            let side = Binding::BuiltIn(BuiltIn::FrontFacing);
            passed.push(build.input("front", ty, &side));
        }
        let id = build.call(written, passed).unwrap_or(id);
        let value = match depth {
            None => id,
            Some(depth) => build.expression(Expression::Compose {
                ty,
                components: vec![id, depth],
            }),
        };
        build.statement(Statement::Return { value: Some(value) });
        Rewrite::default()
    })
}
