//! Turns the stages of a material into one compute stage. Each invocation runs them once, on
//! numbers from one buffer, and writes the results to another.
//!
//! The author's functions stay, except where `rewrite` replaces operations that only a draw
//! supports. Uniforms and buffers become members of one buffer's elements, so that each invocation
//! has its own.

use std::collections::BTreeMap;
use std::sync::Arc;

use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{
    AddressSpace, ArraySize, BinaryOperator, Binding, BuiltIn, EntryPoint, Expression, Function,
    FunctionArgument, GlobalVariable, Handle, Interpolation, Literal, Module, ResourceBinding,
    Scalar, ShaderStage, Span, Statement, StorageAccess, StructMember, Type, TypeInner, VectorSize,
};
use naga_edit::interface::{self, Io};
use naga_edit::variable::private;
use naga_interp::RUNTIME_ELEMENTS;
use preshade_passes::rebuild::place;
use preshade_validate::environment::{PassStages, TestPoint};
use preshade_validate::executor::Draw;
use preshade_validate::levels::Levels;
use preshade_validate::stage::{Slot, Stage, VaryingKind, kind};

use super::body::{Body, WORD, ty};
use super::rewrite::{Ours, rewritten};
use super::textures::settled;

/// Name of the entry point.
pub(crate) const ENTRY: &str = "main";

/// A number of an input, by where the words of one draw have it.
#[derive(Debug)]
pub(crate) enum InputNumber {
    /// An attribute of a corner.
    Attribute(Io, usize),
    /// Inputs of a fragment stage besides its varyings.
    Fragment(Io),
    /// Bases and scales of a texture's texels.
    Texture((u32, u32)),
    /// Derivatives of a unit, along x and y.
    Slopes,
    /// Weights of the corners.
    Weights(VaryingKind),
}

/// A compute stage and the layout of its words.
pub(crate) struct Harness {
    /// With an entry point [`ENTRY`] of one invocation a workgroup.
    pub module: Module,
    pub at: TestPoint,
    /// The stages, which the types of inputs and outputs are of.
    pub source: Module,
    /// The layout of a draw's input words.
    pub given: Vec<InputNumber>,
    /// Number of input words of a draw.
    pub words_in: u32,
    /// The uniforms and buffers of a draw, with type and first byte in the struct of all, and the
    /// words of that struct.
    pub buffers: Vec<((u32, u32), Handle<Type>, u32)>,
    pub words_of_buffers: u32,
    /// Whether the stage reads one of them.
    pub reads_buffers: bool,
    /// The layout of a draw's output words after the first, which is 1 if the fragment was
    /// discarded.
    pub outputs: Vec<(Slot, Handle<Type>)>,
    /// Words that a draw leaves.
    pub words_out: u32,
}

/// A harness that is being made.
struct Making {
    made: Module,
    input: Handle<GlobalVariable>,
    output: Handle<GlobalVariable>,
    given: Vec<InputNumber>,
    words_in: u32,
    buffers: Vec<((u32, u32), Handle<Type>, u32)>,
    words_of_buffers: u32,
}

/// Builds the compute stage for a place.
///
/// # Errors
///
/// The operation that a compute stage does not support, in words.
pub(crate) fn harness(
    stages: PassStages<'_>,
    at: TestPoint,
    levels: &Arc<Levels>,
) -> Result<Harness, String> {
    let entry = |stage: Stage<'_>| {
        let entry = &stage.module().entry_points[stage.entry];
        (entry.stage, entry.name.clone())
    };
    let fragment = stages.fragment.filter(|_| at != TestPoint::Vertex);
    let vertex = (at != TestPoint::Anywhere).then_some(stages.vertex);
    let wanted: Vec<_> = vertex.into_iter().chain(fragment).map(entry).collect();
    let wanted: Vec<_> = wanted.iter().map(|(s, n)| (*s, n.as_str())).collect();
    let source = settled(&place::retain(stages.vertex.module(), &wanted))?;
    let info = validated(&source)?;
    let mut making = Making::new(&source)?;
    let ours = making.variables(&source, levels)?;
    for (handle, function) in source.functions.iter() {
        making.made.functions[handle] = rewritten(&source, function, &info[handle], &ours)?;
    }
    let mut stage_of = |kind: ShaderStage, name: &str| -> Result<Option<Stagelike>, String> {
        let mut entries = source.entry_points.iter().enumerate();
        let Some((index, entry)) = entries.find(|(_, e)| e.stage == kind) else {
            return Ok(None);
        };
        let mut function = rewritten(&source, &entry.function, info.get_entry_point(index), &ours)?;
        function.name = Some(name.to_owned());
        let handle = making.made.functions.append(function, Span::UNDEFINED);
        Ok(Some(Stagelike { index, handle }))
    };
    let vertex = stage_of(ShaderStage::Vertex, "vertex_stage")?;
    let fragment = stage_of(ShaderStage::Fragment, "fragment_stage")?;
    let reset = making.reset(&source, &ours)?;
    making.finish(source, (vertex, fragment, reset), &ours, at)
}

fn validated(module: &Module) -> Result<ModuleInfo, String> {
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
    let validated = validator.validate(module);
    validated.map_err(|e| format!("the harness is not valid: {}", e.emit_to_string("")))
}

/// An entry point, and the function that it has become.
#[derive(Clone, Copy)]
struct Stagelike {
    index: usize,
    handle: Handle<Function>,
}

impl Stagelike {
    fn old(self, source: &Module) -> &Function {
        &source.entry_points[self.index].function
    }
}

impl Making {
    fn new(source: &Module) -> Result<Self, String> {
        let mut made = source.clone();
        made.entry_points.clear();
        let word = ty(&mut made, WORD);
        let words = ty(
            &mut made,
            TypeInner::Array {
                base: word,
                size: ArraySize::Dynamic,
                stride: 4,
            },
        );
        let mut buffer = |name: &str, binding, access| {
            let variable = GlobalVariable {
                name: Some(name.to_owned()),
                space: AddressSpace::Storage { access },
                binding: Some(ResourceBinding { group: 0, binding }),
                ty: words,
                init: None,
                memory_decorations: naga::MemoryDecorations::empty(),
            };
            made.global_variables.append(variable, Span::UNDEFINED)
        };
        let input = buffer("given_words", 0, StorageAccess::LOAD);
        let output = buffer("left_words", 1, StorageAccess::LOAD | StorageAccess::STORE);
        Ok(Self {
            made,
            input,
            output,
            given: Vec::new(),
            words_in: 0,
            buffers: Vec::new(),
            words_of_buffers: 0,
        })
    }

    /// Puts the author's uniforms and buffers into one buffer, and adds our variables.
    fn variables(&mut self, source: &Module, levels: &Arc<Levels>) -> Result<Ours, String> {
        let made = &mut self.made;
        let boolean = ty(made, TypeInner::Scalar(Scalar::BOOL));
        let vector = |made: &mut Module, size| {
            let scalar = Scalar::F32;
            ty(made, TypeInner::Vector { size, scalar })
        };
        let (two, four) = (vector(made, VectorSize::Bi), vector(made, VectorSize::Quad));
        let word = ty(made, WORD);
        let counts = |made: &mut Module, size| {
            let scalar = Scalar::U32;
            ty(made, TypeInner::Vector { size, scalar })
        };
        let sizes = [counts(made, VectorSize::Bi), counts(made, VectorSize::Tri)];
        let draw = private(made, "draw", word, None);
        let mut ours = Ours {
            buffers: BTreeMap::new(),
            // Until there is one.
            all_buffers: draw,
            draw,
            sizes,
            killed: private(made, "is_discarded", boolean, None),
            slopes: private(made, "slopes", two, None),
            textures: BTreeMap::new(),
            levels: Arc::clone(levels),
        };
        for (handle, global) in source.global_variables.iter() {
            let at = naga_interp::place(global);
            match (global.space, at) {
                (AddressSpace::Private, _) => {}
                (AddressSpace::Handle, Some(at)) => {
                    if let TypeInner::Image { .. } = source.types[global.ty].inner {
                        let variables = ["bases", "scales"].map(|n| private(made, n, four, None));
                        ours.textures.insert(handle, variables);
                        self.given.push(InputNumber::Texture(at));
                    }
                }
                (AddressSpace::Uniform | AddressSpace::Immediate, Some(at))
                | (
                    AddressSpace::Storage {
                        access: StorageAccess::LOAD,
                    },
                    Some(at),
                ) => {
                    let sized = sized(made, global.ty)?;
                    let end = self.words_of_buffers * 4;
                    let size = made.types[sized].inner.size(made.to_ctx());
                    ours.buffers.insert(handle, self.buffers.len() as u32);
                    self.buffers.push((at, sized, end));
                    self.words_of_buffers = (end + size).next_multiple_of(16) / 4;
                    // Nothing reads it.
                    let variable = &mut made.global_variables[handle];
                    variable.space = AddressSpace::Private;
                    variable.binding = None;
                    variable.ty = word;
                }
                (AddressSpace::Storage { .. }, _) => return Err("it writes memory".to_owned()),
                (space, _) => return Err(format!("it has a variable in {space:?}")),
            }
        }
        if !self.buffers.is_empty() {
            ours.all_buffers = self.all_buffers();
        }
        self.given.push(InputNumber::Slopes);
        Ok(ours)
    }

    /// A buffer with the author's uniforms and buffers of all draws. Reading them where the author
    /// does costs a compiler the same whatever their lengths.
    fn all_buffers(&mut self) -> Handle<GlobalVariable> {
        let members = self.buffers.iter().enumerate();
        let members = members.map(|(i, (_, ty, offset))| StructMember {
            name: Some(format!("buffer{i}")),
            ty: *ty,
            binding: None,
            offset: *offset,
        });
        let span = self.words_of_buffers * 4;
        let base = self.made.types.insert(
            Type {
                name: Some("Buffers".to_owned()),
                inner: TypeInner::Struct {
                    members: members.collect(),
                    span,
                },
            },
            Span::UNDEFINED,
        );
        let of_all = ty(
            &mut self.made,
            TypeInner::Array {
                base,
                size: ArraySize::Dynamic,
                stride: span,
            },
        );
        let variable = GlobalVariable {
            name: Some("buffers".to_owned()),
            space: AddressSpace::Storage {
                access: StorageAccess::LOAD,
            },
            binding: Some(ResourceBinding {
                group: 0,
                binding: 2,
            }),
            ty: of_all,
            init: None,
            memory_decorations: naga::MemoryDecorations::empty(),
        };
        self.made.global_variables.append(variable, Span::UNDEFINED)
    }

    /// A function that sets all variables to their initial values. Its argument is the index of the
    /// draw's first word.
    fn reset(&mut self, source: &Module, ours: &Ours) -> Result<Handle<Function>, String> {
        let word = ty(&mut self.made, WORD);
        let f32s = |made: &mut Module, size| {
            let scalar = Scalar::F32;
            ty(made, TypeInner::Vector { size, scalar })
        };
        let (two, four) = (
            f32s(&mut self.made, VectorSize::Bi),
            f32s(&mut self.made, VectorSize::Quad),
        );
        let textures: BTreeMap<(u32, u32), [Handle<GlobalVariable>; 2]> = ours
            .textures
            .iter()
            .filter_map(|(texture, variables)| {
                let binding = source.global_variables[*texture].binding.as_ref()?;
                Some(((binding.group, binding.binding), *variables))
            })
            .collect();
        let mut to: Vec<(Handle<GlobalVariable>, Handle<Type>)> = Vec::new();
        for given in &self.given {
            match given {
                InputNumber::Texture(at) => {
                    let variables = textures.get(at).into_iter().flatten();
                    to.extend(variables.map(|v| (*v, four)));
                }
                InputNumber::Slopes => to.push((ours.slopes, two)),
                InputNumber::Attribute(..) | InputNumber::Fragment(_) | InputNumber::Weights(_) => {
                }
            }
        }
        let mut body = Body::new(&mut self.made, "reset");
        body.function.arguments.push(FunctionArgument {
            name: Some("base".to_owned()),
            ty: word,
            binding: None,
        });
        let base = body.add(Expression::FunctionArgument(0));
        for (variable, ty) in to {
            let value = body.read((self.input, base), ty, &mut self.words_in)?;
            let pointer = body.add(Expression::GlobalVariable(variable));
            body.push(Statement::Store { pointer, value });
        }
        for (handle, global) in source.global_variables.iter() {
            if global.space != AddressSpace::Private {
                continue;
            }
            let value = match global.init {
                Some(init) => initial(&mut body, source, init)?,
                None => body.add(Expression::ZeroValue(global.ty)),
            };
            let pointer = body.add(Expression::GlobalVariable(handle));
            body.push(Statement::Store { pointer, value });
        }
        let function = body.function;
        Ok(self.made.functions.append(function, Span::UNDEFINED))
    }

    fn finish(
        mut self,
        source: Module,
        (vertex, fragment, reset): (Option<Stagelike>, Option<Stagelike>, Handle<Function>),
        ours: &Ours,
        at: TestPoint,
    ) -> Result<Harness, String> {
        let id = ty(
            &mut self.made,
            TypeInner::Vector {
                size: VectorSize::Tri,
                scalar: Scalar::U32,
            },
        );
        let mut body = Body::new(&mut self.made, ENTRY);
        body.function.arguments.push(FunctionArgument {
            name: Some("id".to_owned()),
            ty: id,
            binding: Some(Binding::BuiltIn(BuiltIn::GlobalInvocationId)),
        });
        let id = body.add(Expression::FunctionArgument(0));
        let draw = body.add(Expression::AccessIndex { base: id, index: 0 });
        let pointer = body.add(Expression::GlobalVariable(ours.draw));
        body.push(Statement::Store {
            pointer,
            value: draw,
        });
        // How many words a draw has is known once all are read.
        let stride = body.u32(0);
        let base = body.binary(BinaryOperator::Multiply, draw, stride);
        let stride_out = body.u32(0);
        let base_out = body.binary(BinaryOperator::Multiply, draw, stride_out);
        let mut writing = Writing {
            body,
            source: &source,
            input: self.input,
            base,
            reset,
            given: &mut self.given,
            words_in: &mut self.words_in,
        };
        let corners: &[usize] = match at {
            TestPoint::Vertex => &[0],
            TestPoint::Corner(_) | TestPoint::Inside => &[0, 1, 2],
            TestPoint::Anywhere => &[],
        };
        let mut ran = Vec::new();
        if let Some(vertex) = vertex {
            for corner in corners {
                ran.push(writing.vertex(vertex, *corner)?);
            }
        }
        let (stage, result) = match (fragment, vertex) {
            (Some(fragment), _) => {
                let result = writing.fragment((fragment, vertex), &ran, at)?;
                (fragment, result)
            }
            (None, Some(vertex)) => (vertex, ran.first().copied().flatten()),
            (None, None) => return Err("there is no stage".to_owned()),
        };
        let outputs = interface::outputs(&source, stage.old(&source));
        let is_struct = is_struct(stage.old(&source));
        let mut body = writing.body;
        let killed = body.add(Expression::GlobalVariable(ours.killed));
        let killed = body.add(Expression::Load { pointer: killed });
        let (mut words_out, mut told) = (0, Vec::new());
        let boolean = ty(body.module, TypeInner::Scalar(Scalar::BOOL));
        body.write((self.output, base_out), (killed, boolean), &mut words_out)?;
        for (index, io) in (0..).zip(&outputs) {
            let (Some(result), Some(binding)) = (result, &io.binding) else {
                continue;
            };
            let value = match is_struct {
                true => body.add(Expression::AccessIndex {
                    base: result,
                    index,
                }),
                false => result,
            };
            body.write((self.output, base_out), (value, io.ty), &mut words_out)?;
            told.push((Slot::of(binding), io.ty));
        }
        body.push(Statement::Return { value: None });
        let mut function = body.function;
        function.expressions[stride] = Expression::Literal(Literal::U32(self.words_in));
        function.expressions[stride_out] = Expression::Literal(Literal::U32(words_out));
        self.made.entry_points.push(EntryPoint {
            name: ENTRY.to_owned(),
            stage: ShaderStage::Compute,
            early_depth_test: None,
            workgroup_size: [1, 1, 1],
            workgroup_size_overrides: None,
            function,
            mesh_info: None,
            task_payload: None,
            incoming_ray_payload: None,
        });
        let info = validated(&self.made)?;
        let is_read = !info.get_entry_point(0)[ours.all_buffers].is_empty();
        Ok(Harness {
            reads_buffers: is_read && !self.buffers.is_empty(),
            module: self.made,
            at,
            source,
            given: self.given,
            words_in: self.words_in,
            buffers: self.buffers,
            words_of_buffers: self.words_of_buffers,
            outputs: told,
            words_out,
        })
    }
}

/// The entry point that is being written.
struct Writing<'a, 'm> {
    body: Body<'m>,
    source: &'a Module,
    input: Handle<GlobalVariable>,
    base: Handle<Expression>,
    reset: Handle<Function>,
    given: &'a mut Vec<InputNumber>,
    words_in: &'a mut u32,
}

impl Writing<'_, '_> {
    fn read(&mut self, given: InputNumber, ty: Handle<Type>) -> Result<Handle<Expression>, String> {
        self.given.push(given);
        self.body.read((self.input, self.base), ty, self.words_in)
    }

    /// A stage, with every variable as at its beginning.
    fn call(
        &mut self,
        stage: Stagelike,
        mut input: impl FnMut(&mut Self, Io) -> Result<Handle<Expression>, String>,
    ) -> Result<Option<Handle<Expression>>, String> {
        let old = stage.old(self.source);
        let mut arguments = Vec::new();
        for argument in &old.arguments {
            let opened = interface::opened(self.source, std::slice::from_ref(argument));
            let members = opened
                .into_iter()
                .map(|io| input(self, io))
                .collect::<Result<Vec<_>, _>>()?;
            let is_struct = argument.binding.is_none()
                && matches!(
                    self.source.types[argument.ty].inner,
                    TypeInner::Struct { .. }
                );
            arguments.push(match (is_struct, &members[..]) {
                (false, [one]) => *one,
                _ => self.body.add(Expression::Compose {
                    ty: argument.ty,
                    components: members,
                }),
            });
        }
        self.body.push(Statement::Call {
            function: self.reset,
            arguments: vec![self.base],
            result: None,
        });
        let result = old.result.as_ref();
        let result = result.map(|_| self.body.add(Expression::CallResult(stage.handle)));
        self.body.push(Statement::Call {
            function: stage.handle,
            arguments,
            result,
        });
        Ok(result)
    }

    fn vertex(
        &mut self,
        stage: Stagelike,
        corner: usize,
    ) -> Result<Option<Handle<Expression>>, String> {
        self.call(stage, |this, io| {
            let ty = io.ty;
            this.read(InputNumber::Attribute(io, corner), ty)
        })
    }

    /// The fragment stage, fed with the vertex stage's outputs at the corners.
    fn fragment(
        &mut self,
        (stage, vertex): (Stagelike, Option<Stagelike>),
        corners: &[Option<Handle<Expression>>],
        at: TestPoint,
    ) -> Result<Option<Handle<Expression>>, String> {
        let outputs = vertex.map_or_else(Vec::new, |v| {
            interface::outputs(self.source, v.old(self.source))
        });
        let is_struct = vertex.is_some_and(|v| is_struct(v.old(self.source)));
        self.call(stage, |this, io| {
            let own = matches!(io.binding, Some(Binding::BuiltIn(_)));
            if own || at == TestPoint::Anywhere {
                let ty = io.ty;
                return this.read(InputNumber::Fragment(io), ty);
            }
            let binding = io.binding.as_ref().ok_or("an input has no binding")?;
            let slot = Slot::of(binding);
            let matching = |o: &Io| o.binding.as_ref().map(Slot::of) == Some(slot);
            let index = outputs.iter().position(matching);
            let index = index.ok_or("its vertex stage does not give an input")?;
            let mut values = Vec::new();
            for corner in corners {
                let base = corner.ok_or("its vertex stage gives nothing")?;
                values.push(match is_struct {
                    true => this.body.add(Expression::AccessIndex {
                        base,
                        index: index as u32,
                    }),
                    false => base,
                });
            }
            let corner = |i: usize| values.get(i).copied().ok_or("there are no corners");
            let is_flat = matches!(
                binding,
                Binding::Location {
                    interpolation: Some(Interpolation::Flat),
                    ..
                }
            );
            match at {
                _ if is_flat => Ok(corner(0)?),
                TestPoint::Corner(i) => Ok(corner(i)?),
                _ => {
                    let kind = kind(binding).ok_or("an input has no kind")?;
                    this.between([corner(0)?, corner(1)?, corner(2)?], kind)
                }
            }
        })
    }

    fn between(
        &mut self,
        corners: [Handle<Expression>; 3],
        kind: VaryingKind,
    ) -> Result<Handle<Expression>, String> {
        let scalar = Scalar::F32;
        let size = VectorSize::Tri;
        let three = ty(self.body.module, TypeInner::Vector { size, scalar });
        let weights = self.read(InputNumber::Weights(kind), three)?;
        let mut sum: Option<Handle<Expression>> = None;
        for (index, corner) in (0..).zip(corners) {
            let weight = self.body.add(Expression::AccessIndex {
                base: weights,
                index,
            });
            let part = self.body.binary(BinaryOperator::Multiply, corner, weight);
            sum = Some(match sum {
                None => part,
                Some(sum) => self.body.binary(BinaryOperator::Add, sum, part),
            });
        }
        sum.ok_or_else(|| "there are no corners".to_owned())
    }
}

fn is_struct(function: &Function) -> bool {
    function
        .result
        .as_ref()
        .is_some_and(|r| r.binding.is_none())
}

/// The type, with runtime-sized arrays as long as the interpreter makes them.
fn sized(module: &mut Module, of: Handle<Type>) -> Result<Handle<Type>, String> {
    let named = module.types[of].clone();
    let inner = match named.inner {
        TypeInner::Array {
            base,
            size: ArraySize::Dynamic,
            stride,
        } => {
            let count = std::num::NonZeroU32::new(RUNTIME_ELEMENTS);
            TypeInner::Array {
                base,
                size: count.map_or(ArraySize::Dynamic, ArraySize::Constant),
                stride,
            }
        }
        TypeInner::Struct { mut members, span } => {
            let Some(last) = members.last_mut() else {
                return Ok(of);
            };
            let new = sized(module, last.ty)?;
            if new == last.ty {
                return Ok(of);
            }
            last.ty = new;
            let longer = match module.types[new].inner {
                TypeInner::Array { stride, .. } => last.offset + stride * RUNTIME_ELEMENTS,
                _ => return Err("it has a buffer within a buffer".to_owned()),
            };
            TypeInner::Struct {
                members,
                span: longer.next_multiple_of(16).max(span),
            }
        }
        _ => return Ok(of),
    };
    Ok(module.types.insert(
        Type {
            name: named.name.map(|name| format!("{name}_sized")),
            inner,
        },
        Span::UNDEFINED,
    ))
}

/// The initial value of a private variable, as an expression.
fn initial(
    body: &mut Body<'_>,
    source: &Module,
    init: Handle<Expression>,
) -> Result<Handle<Expression>, String> {
    Ok(match source.global_expressions[init].clone() {
        Expression::Compose { ty, components } => {
            let components = components
                .into_iter()
                .map(|c| initial(body, source, c))
                .collect::<Result<_, _>>()?;
            body.add(Expression::Compose { ty, components })
        }
        Expression::Splat { size, value } => {
            let value = initial(body, source, value)?;
            body.add(Expression::Splat { size, value })
        }
        plain @ (Expression::Literal(_)
        | Expression::Constant(_)
        | Expression::Override(_)
        | Expression::ZeroValue(_)) => body.add(plain),
        other => return Err(format!("a variable begins with {other:?}")),
    })
}

/// The words of a draw, in the order of [`Harness::given`].
///
/// # Errors
///
/// A number is missing.
pub(crate) fn words(harness: &Harness, draw: &Draw<'_>) -> Result<Vec<u32>, String> {
    use naga_interp::Value;
    let mut words = Vec::new();
    let missing = |what: &str| format!("there are no numbers for {what}");
    for given in &harness.given {
        let value = match given {
            InputNumber::Attribute(io, corner) => {
                let corner = match harness.at {
                    TestPoint::Vertex => draw.inputs.corner(),
                    _ => *corner,
                };
                draw.inputs.attribute(&harness.source, io, corner)
            }
            InputNumber::Fragment(io) => draw.inputs.fragment(&harness.source, io),
            InputNumber::Texture(at) => {
                let [bases, scales] = match draw.attached.get(at) {
                    Some(texel) => [*texel, [0.0; 4]],
                    None => draw.inputs.bases(Some(*at)),
                };
                Some(Value::Composite(vec![
                    Value::vector(&bases),
                    Value::vector(&scales),
                ]))
            }
            InputNumber::Slopes => Some(Value::vector(&draw.inputs.slopes())),
            InputNumber::Weights(kind) => Some(Value::vector(&draw.inputs.weights(*kind))),
        };
        let value = value.ok_or_else(|| missing(&format!("{given:?}")))?;
        push(&value, &mut words)?;
    }
    match words.len() == harness.words_in as usize {
        true => Ok(words),
        false => Err(format!(
            "a draw has {} words instead of {}",
            words.len(),
            harness.words_in
        )),
    }
}

fn push(value: &naga_interp::Value, words: &mut Vec<u32>) -> Result<(), String> {
    use naga_interp::{Scalar, Value};
    match value {
        Value::Scalar(scalar) => words.push(match scalar {
            Scalar::F32(x) => x.to_bits(),
            Scalar::I32(x) => *x as u32,
            Scalar::U32(x) => *x,
            Scalar::Bool(x) => u32::from(*x),
        }),
        Value::Composite(parts) => {
            for part in parts {
                push(part, words)?;
            }
        }
        other => return Err(format!("{other:?} is no number")),
    }
    Ok(())
}

/// The uniforms and buffers of a draw, as [`Harness::buffers`] lays them out.
///
/// # Errors
///
/// A number is missing.
pub(crate) fn buffers(harness: &Harness, draw: &Draw<'_>) -> Result<Vec<u32>, String> {
    let mut words = vec![0; harness.words_of_buffers as usize];
    for (at, ty, offset) in &harness.buffers {
        let value = draw.inputs.resources.get(at);
        let value = value.ok_or_else(|| format!("there are no numbers for {at:?}"))?;
        lay(&harness.module, *ty, value, *offset, &mut words)?;
    }
    Ok(words)
}

/// Writes a value at a byte offset (WGSL 14.4, memory layout).
fn lay(
    module: &Module,
    ty: Handle<Type>,
    value: &naga_interp::Value,
    offset: u32,
    words: &mut [u32],
) -> Result<(), String> {
    use naga_interp::Value;
    let Value::Composite(parts) = value else {
        let mut word = Vec::new();
        push(value, &mut word)?;
        let at = words.get_mut(offset as usize / 4);
        *at.ok_or("a buffer is too short")? = word[0];
        return Ok(());
    };
    for (i, part) in (0..).zip(parts) {
        let (ty, offset) = match &module.types[ty].inner {
            TypeInner::Vector { scalar, .. } if scalar.width == 4 => (ty, offset + 4 * i),
            TypeInner::Matrix { rows, scalar, .. } if scalar.width == 4 => {
                let stride = if *rows == VectorSize::Bi { 8 } else { 16 };
                let Value::Composite(column) = part else {
                    return Err("a matrix has no columns".to_owned());
                };
                for (row, part) in (0..).zip(column) {
                    lay(module, ty, part, offset + stride * i + 4 * row, words)?;
                }
                continue;
            }
            TypeInner::Array { base, stride, .. } => (*base, offset + stride * i),
            TypeInner::Struct { members, .. } => {
                let member = members.get(i as usize).ok_or("a struct is too short")?;
                (member.ty, offset + member.offset)
            }
            other => return Err(format!("it reads a {other:?}")),
        };
        lay(module, ty, part, offset, words)?;
    }
    Ok(())
}

/// A value of a type out of words, which are taken from the front.
pub(crate) fn value(
    module: &mut Module,
    ty: Handle<Type>,
    words: &mut impl Iterator<Item = u32>,
) -> Result<naga_interp::Value, String> {
    use naga::ScalarKind;
    use naga_interp::{Scalar, Value};
    if let TypeInner::Scalar(scalar) = module.types[ty].inner {
        let word = words.next().ok_or("it left too few words")?;
        return Ok(Value::Scalar(match scalar.kind {
            ScalarKind::Sint => Scalar::I32(word as i32),
            ScalarKind::Uint => Scalar::U32(word),
            ScalarKind::Bool => Scalar::Bool(word != 0),
            _ => Scalar::F32(f32::from_bits(word)),
        }));
    }
    let parts = super::body::parts(module, ty)?;
    let parts = parts.into_iter().map(|part| value(module, part, words));
    Ok(Value::Composite(parts.collect::<Result<_, _>>()?))
}
