//! Globals and the entry point.
//!
//! GLSL's inputs, outputs and globals are variables of the whole invocation. The entry point copies
//! its arguments to the inputs, calls `main`, and returns the outputs.

use naga::{
    AddressSpace, Binding, BuiltIn, Constant, EarlyDepthTest, EntryPoint, Expression,
    Function as IrFunction, FunctionArgument, FunctionResult, GlobalVariable, Handle,
    Interpolation, Override, Sampling, ScalarKind, Span, Statement, StructMember, Type, TypeInner,
};
use naga_edit::writer::FunctionWriter;

use super::types::array_size;
use super::{Body, Builder, Declared, Port, Value, refused};
use crate::built_in_variables::{self, Variable};
use crate::tree::{BlockTy, Global, GlobalId, GlobalKind, Node};
use shader_text::error::{Code, Error};

impl<'s> Builder<'s> {
    pub(super) fn globals(&mut self) -> Result<(), Error> {
        if self.stage.invariant
            && let Some(own) = built_in_variables::plain("gl_Position", self.kind)
        {
            self.register(own)?;
            for port in &mut self.ports {
                port.binding = Binding::BuiltIn(BuiltIn::Position { invariant: true });
            }
        }
        for id in &self.stage.declared {
            let global = &self.stage.globals[id.0];
            let declared = self.global(*id, global)?;
            self.globals.insert(*id, declared);
        }
        Ok(())
    }

    fn global(&mut self, id: GlobalId, global: &'s Global) -> Result<Declared, Error> {
        let Global { name, kind, span } = global;
        let span = *span;
        match kind {
            GlobalKind::Block(block) => {
                if let Some(binding) = block.binding {
                    within(binding.group, span)?;
                    within(binding.binding, span)?;
                }
                let ty = self.block(block, span)?;
                let (space, binding) = (block.space, block.binding);
                Ok(self.variable(
                    GlobalVariable {
                        name: name.clone(),
                        space,
                        binding,
                        ..plain(ty)
                    },
                    span,
                ))
            }
            GlobalKind::Handle { .. } => self.resource(id, global),
            GlobalKind::Port {
                ty,
                is_output,
                binding,
                name: port,
            } => {
                let ty = self.ty(ty, span)?;
                let mut binding = binding.clone();
                if let Binding::Location { location, .. } = &binding {
                    within(*location, span)?;
                }
                interpolate(&mut binding, &self.module.types[ty].inner);
                let variable = GlobalVariable {
                    name: name.clone(),
                    ..plain(ty)
                };
                let global = self.module.global_variables.append(variable, span);
                self.ports.push(Port {
                    global,
                    name: port.clone(),
                    binding,
                    is_output: *is_output,
                });
                Ok(Declared::Variable(global))
            }
            GlobalKind::Variable { ty, init } => {
                let ty = self.ty(ty, span)?;
                let init = match init {
                    Some(init) => Some(self.constant(init, span)?),
                    None => None,
                };
                Ok(self.variable(
                    GlobalVariable {
                        name: name.clone(),
                        init,
                        ..plain(ty)
                    },
                    span,
                ))
            }
            GlobalKind::Constant { ty, init } => {
                let ty = self.ty(ty, span)?;
                let init = self.constant(init, span)?;
                let name = name.clone();
                let constant = Constant { name, ty, init };
                let handle = self.module.constants.append(constant, span);
                Ok(Declared::Constant(handle, ty))
            }
            GlobalKind::Override { ty, id, init } => {
                let id = u16::try_from(*id).map_err(|_| {
                    let message = format!(
                        "constant_id value {id} is too high (maximum is {})",
                        u16::MAX
                    );
                    refused(&message, span)
                })?;
                let of = Override {
                    name: name.clone(),
                    id: Some(id),
                    ty: self.ty(ty, span)?,
                    init: Some(self.constant(init, span)?),
                };
                Ok(Declared::Override(self.module.overrides.append(of, span)))
            }
        }
    }

    /// A texture, sampler or image.
    fn resource(&mut self, id: GlobalId, global: &Global) -> Result<Declared, Error> {
        let span = global.span;
        let GlobalKind::Handle {
            ty,
            lengths,
            binding,
            format,
            access,
        } = &global.kind
        else {
            return Err(refused("this is not a texture", span));
        };
        within(binding.group, span)?;
        within(binding.binding, span)?;
        let mut ty = ty.clone();
        ty.compares |= self.comparing.has_global(id);
        if ty.name.contains("image") && format.is_none() {
            let message = "an image needs a format, as in `layout(rgba8)`";
            return Err(refused(message, span));
        }
        let mut ty = self.handle(&ty, *format, *access, span)?;
        for length in lengths.iter().rev() {
            let size = match length {
                Some(n) => array_size(*n, span)?,
                None => naga::ArraySize::Dynamic,
            };
            ty = self.insert(TypeInner::BindingArray { base: ty, size });
        }
        let variable = GlobalVariable {
            name: global.name.clone(),
            space: AddressSpace::Handle,
            binding: Some(*binding),
            ..plain(ty)
        };
        Ok(self.variable(variable, span))
    }

    fn variable(&mut self, variable: GlobalVariable, span: Span) -> Declared {
        Declared::Variable(self.module.global_variables.append(variable, span))
    }

    fn block(&mut self, block: &BlockTy, span: Span) -> Result<Handle<Type>, Error> {
        let base = self.struct_ty(&block.name, &block.members, Some(block.rules))?;
        let size = match block.length {
            None => return Ok(base),
            Some(None) => naga::ArraySize::Dynamic,
            Some(Some(n)) => array_size(n, span)?,
        };
        Ok(self.insert(TypeInner::BindingArray { base, size }))
    }

    /// Evaluates a constant of the module.
    fn constant(&mut self, node: &'s Node, span: Span) -> Result<Value, Error> {
        let mut body = Body::new(self, IrFunction::default());
        body.is_const = true;
        body.span = span;
        body.value(node)
    }

    /// The global for a built-in variable.
    pub(super) fn register(
        &mut self,
        own: &'static Variable,
    ) -> Result<Handle<GlobalVariable>, Error> {
        if let Some((_, known)) = self.own.iter().find(|(of, _)| std::ptr::eq(*of, own)) {
            return Ok(*known);
        }
        let ty = self.ty(&own.ty, Span::UNDEFINED)?;
        let variable = GlobalVariable {
            name: Some(own.first_name().to_owned()),
            ..plain(ty)
        };
        let global = self
            .module
            .global_variables
            .append(variable, Span::UNDEFINED);
        self.own.push((own, global));
        self.ports.push(Port {
            global,
            name: own.first_name().to_owned(),
            binding: Binding::BuiltIn(own.built_in),
            is_output: own.is_output,
        });
        Ok(global)
    }

    pub(super) fn entry_point(&mut self) -> Result<(), Error> {
        let main = self.stage.main.and_then(|main| self.functions.get(&main));
        let Some(main) = main.copied() else {
            return Err(Error::new(Code::Parse, "Missing entry point"));
        };
        let mut writer = FunctionWriter::of(IrFunction::default());
        let none = Span::UNDEFINED;
        for port in self.ports.iter().filter(|port| !port.is_output) {
            let pointer = writer.append(Expression::GlobalVariable(port.global), none);
            let at = writer.function.arguments.len() as u32;
            writer.function.arguments.push(FunctionArgument {
                name: Some(port.name.clone()),
                ty: self.module.global_variables[port.global].ty,
                binding: Some(port.binding.clone()),
            });
            let value = writer.append(Expression::FunctionArgument(at), none);
            writer.statement(Statement::Store { pointer, value }, none);
        }
        let call = Statement::Call {
            function: main,
            arguments: Vec::new(),
            result: None,
        };
        writer.statement(call, none);
        let (mut members, mut components, mut span) = (Vec::new(), Vec::new(), 0);
        for port in self.ports.iter().filter(|port| port.is_output) {
            let ty = self.module.global_variables[port.global].ty;
            members.push(StructMember {
                name: Some(port.name.clone()),
                ty,
                binding: Some(port.binding.clone()),
                offset: span,
            });
            span += self.module.types[ty].inner.size(self.module.to_ctx());
            let pointer = writer.append(Expression::GlobalVariable(port.global), none);
            writer.begin();
            components.push(writer.append(Expression::Load { pointer }, none));
            writer.flush(none);
        }
        let mut value = None;
        if !members.is_empty() {
            let ty = self.insert(TypeInner::Struct { members, span });
            writer.function.result = Some(FunctionResult { ty, binding: None });
            writer.begin();
            value = Some(writer.append(Expression::Compose { ty, components }, none));
        }
        writer.statement(Statement::Return { value }, none);
        self.module.entry_points.push(EntryPoint {
            name: "main".to_owned(),
            stage: self.kind,
            early_depth_test: self
                .stage
                .early_fragment_tests
                .then_some(EarlyDepthTest::Force),
            workgroup_size: [0; 3],
            workgroup_size_overrides: None,
            function: writer.finish(),
            mesh_info: None,
            task_payload: None,
            incoming_ray_payload: None,
        });
        Ok(())
    }
}

/// Refuses numbers beyond the range of `int`.
fn within(number: u32, span: Span) -> Result<(), Error> {
    match i32::try_from(number) {
        Ok(_) => Ok(()),
        Err(_) => Err(refused("int constant overflows", span)),
    }
}

/// Interpolates floats, unless the text specifies otherwise.
fn interpolate(binding: &mut Binding, ty: &TypeInner) {
    if let Binding::Location {
        interpolation: interpolation @ None,
        sampling,
        ..
    } = binding
        && ty.scalar_kind() == Some(ScalarKind::Float)
    {
        *interpolation = Some(Interpolation::Perspective);
        *sampling = Some(Sampling::Center);
    }
}

/// An unnamed private variable.
fn plain(ty: Handle<Type>) -> GlobalVariable {
    GlobalVariable {
        name: None,
        space: AddressSpace::Private,
        binding: None,
        ty,
        init: None,
        memory_decorations: naga::MemoryDecorations::empty(),
    }
}
