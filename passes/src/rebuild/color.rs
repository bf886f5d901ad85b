//! Fragment stages of our own that return a colour, and the depth that a slice of the author's
//! decides.

use naga::{
    Binding, BuiltIn, EntryPoint, Expression, Function, FunctionResult, Handle, Module, Scalar,
    ShaderStage, Span, StructMember, Type, TypeInner, VectorSize,
};

use naga_edit::returns;
use naga_edit::writer::FunctionWriter;

/// An output or a varying at a location.
pub(crate) fn location(location: u32) -> Binding {
    Binding::Location {
        location,
        interpolation: None,
        sampling: None,
        blend_src: None,
        per_primitive: false,
    }
}

/// A fragment stage that does nothing.
pub fn empty_fragment(name: &str) -> EntryPoint {
    EntryPoint {
        name: name.to_owned(),
        stage: ShaderStage::Fragment,
        early_depth_test: None,
        workgroup_size: [0; 3],
        workgroup_size_overrides: None,
        function: Function::default(),
        mesh_info: None,
        task_payload: None,
        incoming_ray_payload: None,
    }
}

/// The colour and the depth that replace the value of a return.
type Outputs<'a> = dyn FnMut(
        &mut FunctionWriter,
        Handle<Type>,
        Option<Handle<Expression>>,
    ) -> Option<(Handle<Expression>, Option<Handle<Expression>>)>
    + 'a;

/// Makes an entry point return a colour at location 0. With a type of `depth` it returns a struct
/// of colour and depth; `names` are those of the struct and its colour. `outputs` gets the type of
/// the colour and the value of each return.
pub fn return_color(
    module: &mut Module,
    entry: usize,
    names: [&str; 2],
    depth: Option<Handle<Type>>,
    outputs: &mut Outputs<'_>,
) {
    let mut insert = |name: Option<&str>, inner| {
        let name = name.map(str::to_owned);
        module.types.insert(Type { name, inner }, Span::UNDEFINED)
    };
    let inner = TypeInner::Vector {
        size: VectorSize::Quad,
        scalar: Scalar::F32,
    };
    let vec4 = insert(None, inner);
    let with_depth = depth.map(|depth| {
        let member = |name: &str, ty, binding, offset| StructMember {
            name: Some(name.to_owned()),
            ty,
            binding: Some(binding),
            offset,
        };
        let members = vec![
            member(names[1], vec4, location(0), 0),
            member("depth", depth, Binding::BuiltIn(BuiltIn::FragDepth), 16),
        ];
        insert(Some(names[0]), TypeInner::Struct { members, span: 32 })
    });
    let function = &mut module.entry_points[entry].function;
    function.result = Some(match with_depth {
        Some(ty) => FunctionResult { ty, binding: None },
        None => FunctionResult {
            ty: vec4,
            binding: Some(location(0)),
        },
    });
    returns::rewrite(function, &mut |writer, returned| {
        let (color, depth) = outputs(writer, vec4, returned)?;
        Some(match (with_depth, depth) {
            (Some(ty), Some(depth)) => writer.expression(Expression::Compose {
                ty,
                components: vec![color, depth],
            }),
            _ => color,
        })
    });
}
