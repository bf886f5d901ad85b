//! Links two naga modules into one: appends the second's arenas to the first's, remaps handles and
//! moves spans.
//!
//! Declarations that both files share appear once: types by naga's own `UniqueArena`; resources by
//! group and binding; constants, overrides and functions by name and content. Other clashes are
//! renamed after the second module's stage. If the host uses the clashing name or binding, linking
//! fails.

use std::collections::{HashMap, HashSet};

use naga::{
    AddressSpace, Arena, ArraySize, Block, Constant, EntryPoint, Expression, Function,
    GlobalVariable, Handle, Module, Override, ShaderStage, Span, Statement, Type, TypeInner,
};

mod layout;

use layout::Longer;
pub use layout::Member;

use crate::declared::SpecConstant;

/// Two modules that can't be linked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct LinkError {
    /// Text of the error.
    pub message: String,
    /// Its places, in the address space of the source map.
    pub labels: Vec<(Span, String)>,
    /// The first members that differ between two structs, the second module's first: naga has no
    /// spans for members.
    pub members: Vec<Member>,
    pub note: Option<&'static str>,
}

impl LinkError {
    fn new(message: impl Into<String>) -> Box<Self> {
        Box::new(Self {
            message: message.into(),
            labels: Vec::new(),
            members: Vec::new(),
            note: None,
        })
    }

    fn label(mut self: Box<Self>, span: Span, text: impl Into<String>) -> Box<Self> {
        self.labels.push((span, text.into()));
        self
    }

    fn note(mut self: Box<Self>, note: &'static str) -> Box<Self> {
        self.note = Some(note);
        self
    }
}

/// A linked module, and the new handles of the second module's functions.
#[derive(Clone, Debug)]
pub struct Linked {
    pub module: Module,
    /// The second module's functions in it, in their order.
    pub functions: Vec<Handle<Function>>,
    /// The second module's overrides that got another name or id.
    pub constants: Vec<SpecConstant>,
}

/// Adds `second`, whose spans start at `base` in the source map, to `first`, whose spans start at
/// 0. Clashing names of `second` get `suffix`.
///
/// # Errors
///
/// If both declare a binding, an override or an entry point differently.
pub fn link(
    first: Module,
    second: &Module,
    base: u32,
    suffix: &str,
) -> Result<Linked, Box<LinkError>> {
    let mut linker = Linker {
        names: names(&first),
        known: Known::of(&first),
        shared: first.functions.iter().map(|(h, _)| h).collect(),
        module: first,
        second,
        base,
        suffix,
        types: HashMap::new(),
        expressions: HashMap::new(),
        constants: HashMap::new(),
        overrides: HashMap::new(),
        apart: Vec::new(),
        globals: HashMap::new(),
        functions: HashMap::new(),
        filters: HashMap::new(),
    };
    let lengthened = linker.share_resource_types()?;
    linker.types()?;
    linker.globals()?;
    linker.filters();
    linker.functions()?;
    linker.entry_points()?;
    let functions = second
        .functions
        .iter()
        .filter_map(|(h, _)| linker.functions.get(&h).copied())
        .collect();
    linker.drop_types(&lengthened);
    Ok(Linked {
        module: linker.module,
        functions,
        constants: linker.apart,
    })
}

/// Moves `span` by `base`; an undefined span is unchanged.
pub fn offset(span: Span, base: u32) -> Span {
    match span.to_range() {
        Some(range) => Span::new(range.start as u32 + base, range.end as u32 + base),
        None => span,
    }
}

struct Linker<'a> {
    /// The result so far, which starts as the first module.
    module: Module,
    second: &'a Module,
    base: u32,
    /// Appended to names that clash.
    suffix: &'a str,
    /// Names of functions, entry points and variables in `module`.
    names: HashSet<String>,
    known: Known,
    /// Functions of the first module, candidates for sharing.
    shared: Vec<Handle<Function>>,
    // The second module's handles to those in `module`.
    types: HashMap<Handle<Type>, Handle<Type>>,
    expressions: HashMap<Handle<Expression>, Handle<Expression>>,
    constants: HashMap<Handle<Constant>, Handle<Constant>>,
    overrides: HashMap<Handle<Override>, Handle<Override>>,
    apart: Vec<SpecConstant>,
    globals: HashMap<Handle<GlobalVariable>, Handle<GlobalVariable>>,
    functions: HashMap<Handle<Function>, Handle<Function>>,
    filters: HashMap<
        Handle<naga::diagnostic_filter::DiagnosticFilterNode>,
        Handle<naga::diagnostic_filter::DiagnosticFilterNode>,
    >,
}

/// The global expressions and constants of a module, by content.
#[derive(Default)]
struct Known {
    expressions: HashMap<String, Handle<Expression>>,
    constants: HashMap<String, Handle<Constant>>,
}

impl Known {
    fn of(module: &Module) -> Self {
        let mut known = Self::default();
        for (handle, expression) in module.global_expressions.iter() {
            known.expressions.entry(key(expression)).or_insert(handle);
        }
        for (handle, constant) in module.constants.iter() {
            known.constants.entry(key(constant)).or_insert(handle);
        }
        known
    }
}

/// A key that is equal for equal content. `==` would treat -0 as 0, but `1 / x` does not.
fn key(of: &impl std::fmt::Debug) -> String {
    format!("{of:?}")
}

fn names(module: &Module) -> HashSet<String> {
    let functions = module.functions.iter().filter_map(|(_, f)| f.name.clone());
    let globals = module
        .global_variables
        .iter()
        .filter_map(|(_, g)| g.name.clone());
    let entries = module.entry_points.iter().map(|e| e.name.clone());
    functions.chain(globals).chain(entries).collect()
}

impl Linker<'_> {
    fn span(&self, span: Span) -> Span {
        offset(span, self.base)
    }

    /// Where both files declare a resource with the same layout under different type names, uses
    /// the first file's names: authors write `Camera` in one file and `CameraUniform` in the other.
    /// Where one declares more members at the end, its declaration holds for both. Returns the
    /// first file's types that a longer one replaces.
    fn share_resource_types(&mut self) -> Result<Vec<Handle<Type>>, Box<LinkError>> {
        let mut lengthened = Vec::new();
        for (_, theirs) in self.second.global_variables.iter() {
            let Some(handle) = self.same_binding(theirs) else {
                continue;
            };
            let ours = self.module.global_variables[handle].ty;
            if let Some(pairs) = layout::same(&self.module, ours, self.second, theirs.ty) {
                self.types.extend(pairs);
                continue;
            }
            // Each stage has its own part of the immediate data, with a range of its own.
            if theirs.space == AddressSpace::Immediate {
                continue;
            }
            match layout::longer(&self.module, ours, self.second, theirs.ty) {
                Some((Longer::First, pairs)) => {
                    self.types.extend(pairs);
                    self.types.insert(theirs.ty, ours);
                }
                Some((Longer::Second, pairs)) => {
                    self.types.extend(pairs);
                    self.module.global_variables[handle].ty = self.ty(theirs.ty)?;
                    lengthened.push(ours);
                }
                None => {}
            }
        }
        Ok(lengthened)
    }

    /// Drops those of `types` that are no longer used. Leaves an invalid module, which compaction
    /// does not accept, unchanged for the validator's message.
    fn drop_types(&mut self, types: &[Handle<Type>]) {
        use naga::compact::{KeepUnused, compact};
        use naga::valid::{Capabilities, ValidationFlags, Validator};
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
        if types.is_empty() || validator.validate(&self.module).is_err() {
            return;
        }
        for handle in types {
            // Compaction keeps named types.
            let inner = self.module.types[*handle].inner.clone();
            let unnamed = Type { name: None, inner };
            if self.module.types.get(&unnamed).is_none() {
                self.module.types.replace(*handle, unnamed);
            }
        }
        compact(&mut self.module, KeepUnused::Yes);
    }

    fn types(&mut self) -> Result<(), Box<LinkError>> {
        for (handle, _) in self.second.types.iter() {
            self.ty(handle)?;
        }
        let theirs = &self.second.special_types;
        for (key, ty) in &theirs.predeclared_types {
            let ty = self.ty(*ty)?;
            self.module
                .special_types
                .predeclared_types
                .insert(key.clone(), ty);
        }
        let map =
            |slot: &mut Option<Handle<Type>>, ty: Option<Handle<Type>>, types: &HashMap<_, _>| {
                if let Some(ty) = ty {
                    *slot = types.get(&ty).copied();
                }
            };
        let ours = &mut self.module.special_types;
        map(&mut ours.ray_desc, theirs.ray_desc, &self.types);
        map(
            &mut ours.ray_intersection,
            theirs.ray_intersection,
            &self.types,
        );
        map(
            &mut ours.ray_vertex_return,
            theirs.ray_vertex_return,
            &self.types,
        );
        map(
            &mut ours.external_texture_params,
            theirs.external_texture_params,
            &self.types,
        );
        map(
            &mut ours.external_texture_transfer_function,
            theirs.external_texture_transfer_function,
            &self.types,
        );
        Ok(())
    }

    fn ty(&mut self, handle: Handle<Type>) -> Result<Handle<Type>, Box<LinkError>> {
        if let Some(done) = self.types.get(&handle) {
            return Ok(*done);
        }
        let mut ty = self.second.types[handle].clone();
        match &mut ty.inner {
            TypeInner::Pointer { base, .. } => *base = self.ty(*base)?,
            TypeInner::Array { base, size, .. } | TypeInner::BindingArray { base, size } => {
                *base = self.ty(*base)?;
                if let ArraySize::Pending(value) = size {
                    *value = self.override_(*value)?;
                }
            }
            TypeInner::Struct { members, .. } => {
                for member in members {
                    member.ty = self.ty(member.ty)?;
                }
            }
            _ => {}
        }
        let span = self.span(self.second.types.get_span(handle));
        let mapped = self.module.types.insert(ty, span);
        self.types.insert(handle, mapped);
        Ok(mapped)
    }

    /// A global expression. Equal ones are shared, so constants can be compared by their
    /// initialiser's handle.
    fn expression(
        &mut self,
        handle: Handle<Expression>,
    ) -> Result<Handle<Expression>, Box<LinkError>> {
        if let Some(done) = self.expressions.get(&handle) {
            return Ok(*done);
        }
        let mut expression = self.second.global_expressions[handle].clone();
        let mut failed = None;
        naga_operands::map_expression(&mut expression, &mut |operand| match self
            .expression(*operand)
        {
            Ok(mapped) => *operand = mapped,
            Err(e) => failed = Some(e),
        });
        if let Some(error) = failed {
            return Err(error);
        }
        self.module_handles(&mut expression)?;
        let span = self.span(self.second.global_expressions.get_span(handle));
        let arena = &mut self.module.global_expressions;
        let known = self.known.expressions.entry(key(&expression));
        let mapped = *known.or_insert_with(|| arena.append(expression, span));
        self.expressions.insert(handle, mapped);
        Ok(mapped)
    }

    fn constant(&mut self, handle: Handle<Constant>) -> Result<Handle<Constant>, Box<LinkError>> {
        if let Some(done) = self.constants.get(&handle) {
            return Ok(*done);
        }
        let theirs = self.second.constants[handle].clone();
        let constant = Constant {
            name: theirs.name,
            ty: self.ty(theirs.ty)?,
            init: self.expression(theirs.init)?,
        };
        let span = self.span(self.second.constants.get_span(handle));
        let arena = &mut self.module.constants;
        let known = self.known.constants.entry(key(&constant));
        let mapped = *known.or_insert_with(|| arena.append(constant, span));
        self.constants.insert(handle, mapped);
        Ok(mapped)
    }

    /// The host sets an override by name or id. Two different overrides with one id stay separate,
    /// because each stage has its own constants. Two with one name and no id must be equal.
    fn override_(&mut self, handle: Handle<Override>) -> Result<Handle<Override>, Box<LinkError>> {
        if let Some(done) = self.overrides.get(&handle) {
            return Ok(*done);
        }
        let theirs = self.second.overrides[handle].clone();
        let mut mapped = Override {
            name: theirs.name,
            id: theirs.id,
            ty: self.ty(theirs.ty)?,
            init: theirs.init.map(|e| self.expression(e)).transpose()?,
        };
        let span = self.span(self.second.overrides.get_span(handle));
        let expressions = &self.module.global_expressions;
        let value = |o: &Override| o.init.map(|init| expressions[init].clone());
        let is_same = |o: &Override| {
            (&o.name, o.id, o.ty) == (&mapped.name, mapped.id, mapped.ty)
                && value(o) == value(&mapped)
        };
        let same = self.module.overrides.iter().find(|(_, o)| is_same(o));
        if let Some((same, _)) = same {
            self.overrides.insert(handle, same);
            return Ok(same);
        }
        let clash = self
            .module
            .overrides
            .iter()
            .find(|(_, o)| o.name == mapped.name || (o.id.is_some() && o.id == mapped.id));
        if let (Some(_), Some(id), Some(own)) = (clash, mapped.id, mapped.name.clone()) {
            let name = self.free_override_name(&own);
            mapped.id = self.free_id();
            mapped.name = Some(name.clone());
            let id = u32::from(id);
            self.apart.push(SpecConstant { name, own, id });
        } else if let Some((ours, _)) = clash {
            return Err(LinkError::new(format!(
                "the two files declare the override `{}` differently",
                mapped.name.as_deref().unwrap_or("")
            ))
            .label(span, "here")
            .label(self.module.overrides.get_span(ours), "and here"));
        }
        let mapped = self.module.overrides.fetch_or_append(mapped, span);
        self.overrides.insert(handle, mapped);
        Ok(mapped)
    }

    /// `name`, or a similar one that no override has.
    fn free_override_name(&self, name: &str) -> String {
        let both = [&self.module.overrides, &self.second.overrides];
        let is_taken = |name: &str| {
            let mut all = both.iter().flat_map(|o| o.iter());
            all.any(|(_, o)| o.name.as_deref() == Some(name))
        };
        let mut free = format!("{name}_{}", self.suffix);
        while is_taken(&free) {
            free.push('x');
        }
        free
    }

    /// The lowest id that no override has.
    fn free_id(&self) -> Option<u16> {
        let both = [&self.module.overrides, &self.second.overrides];
        let is_taken = |id: u16| {
            let mut all = both.iter().flat_map(|o| o.iter());
            all.any(|(_, o)| o.id == Some(id))
        };
        (0..u16::MAX).find(|id| !is_taken(*id))
    }

    fn globals(&mut self) -> Result<(), Box<LinkError>> {
        // Unused overrides of the second module are still part of its interface.
        for (handle, _) in self.second.overrides.iter() {
            self.override_(handle)?;
        }
        for (handle, _) in self.second.constants.iter() {
            self.constant(handle)?;
        }
        for (handle, theirs) in self.second.global_variables.iter() {
            let mut global = theirs.clone();
            global.ty = self.ty(global.ty)?;
            global.init = global.init.map(|e| self.expression(e)).transpose()?;
            let span = self.span(self.second.global_variables.get_span(handle));
            let mapped = match self.same_binding(&global) {
                // Each stage has its own part of the immediate data.
                Some(ours)
                    if global.space == AddressSpace::Immediate
                        && self.module.global_variables[ours].ty != global.ty =>
                {
                    global.name = global.name.map(|n| self.unique(&n));
                    self.module.global_variables.append(global, span)
                }
                Some(ours) => {
                    let declared = &self.module.global_variables[ours];
                    if declared.ty != global.ty || declared.space != global.space {
                        return Err(self.binding_clash(ours, &global, span));
                    }
                    ours
                }
                None => {
                    global.name = global.name.map(|n| self.unique(&n));
                    self.module.global_variables.append(global, span)
                }
            };
            self.globals.insert(handle, mapped);
        }
        Ok(())
    }

    fn same_binding(&self, global: &GlobalVariable) -> Option<Handle<GlobalVariable>> {
        let one_place = |g: &GlobalVariable| match global.space {
            AddressSpace::Immediate => g.space == AddressSpace::Immediate,
            _ => global.binding.is_some() && g.binding == global.binding,
        };
        self.module
            .global_variables
            .iter()
            .find(|(_, g)| one_place(g))
            .map(|(h, _)| h)
    }

    fn binding_clash(
        &self,
        ours: Handle<GlobalVariable>,
        theirs: &GlobalVariable,
        span: Span,
    ) -> Box<LinkError> {
        let declared = &self.module.global_variables[ours];
        let at = theirs.binding.map_or("immediate data".to_owned(), |b| {
            format!("group {} binding {}", b.group, b.binding)
        });
        let name = |g: &GlobalVariable| g.name.clone().unwrap_or_default();
        let ours_span = self.module.global_variables.get_span(ours);
        let mut error = LinkError::new(format!("the two files declare {at} differently"))
            .label(span, format!("`{}` here", name(theirs)))
            .label(ours_span, format!("`{}` here", name(declared)))
            .note("give one of them another binding, or both the same type and access");
        if let Some((theirs, ours)) =
            layout::members_that_differ(&self.module, (theirs.ty, span), (declared.ty, ours_span))
        {
            error.members = vec![theirs, ours];
        }
        error
    }

    fn filters(&mut self) {
        for (handle, node) in self.second.diagnostic_filters.iter() {
            let mut node = node.clone();
            node.parent = node.parent.and_then(|p| self.filters.get(&p).copied());
            let span = self.span(self.second.diagnostic_filters.get_span(handle));
            let mapped = self.module.diagnostic_filters.append(node, span);
            self.filters.insert(handle, mapped);
        }
    }

    fn functions(&mut self) -> Result<(), Box<LinkError>> {
        for (handle, function) in self.second.functions.iter() {
            let mut mapped = self.function(function)?;
            let text = content(&mapped);
            let twin = self.shared.iter().copied().find(|h| {
                let ours = &self.module.functions[*h];
                ours.name == mapped.name && content(ours) == text
            });
            let new = match twin {
                Some(twin) => twin,
                None => {
                    mapped.name = mapped.name.map(|n| self.unique(&n));
                    let span = self.span(self.second.functions.get_span(handle));
                    self.module.functions.append(mapped, span)
                }
            };
            self.functions.insert(handle, new);
        }
        Ok(())
    }

    fn entry_points(&mut self) -> Result<(), Box<LinkError>> {
        for entry in &self.second.entry_points {
            let twice = |e: &&EntryPoint| e.stage == entry.stage;
            if let Some(first) = self.module.entry_points.iter().find(twice)
                && matches!(entry.stage, ShaderStage::Vertex | ShaderStage::Fragment)
                && first.name == entry.name
            {
                let stage = format!("{:?}", entry.stage).to_lowercase();
                return Err(LinkError::new(format!(
                    "both files have a {stage} entry point `{}`",
                    entry.name
                )));
            }
            let mut mapped = entry.clone();
            mapped.function = self.function(&entry.function)?;
            mapped.name = self.unique(&entry.name);
            if let Some(global) = mapped.task_payload.as_mut() {
                *global = self.global(*global)?;
            }
            self.module.entry_points.push(mapped);
        }
        Ok(())
    }

    /// The function with its module-level handles mapped. Handles into its own arenas stay valid,
    /// because those keep their order.
    fn function(&mut self, theirs: &Function) -> Result<Function, Box<LinkError>> {
        let mut function = theirs.clone();
        for argument in &mut function.arguments {
            argument.ty = self.ty(argument.ty)?;
        }
        if let Some(result) = &mut function.result {
            result.ty = self.ty(result.ty)?;
        }
        // Not `clear`, which keeps the spans of what it removes (naga 30).
        function.local_variables = Arena::new();
        for (handle, local) in theirs.local_variables.iter() {
            let mut local = local.clone();
            local.ty = self.ty(local.ty)?;
            let span = self.span(theirs.local_variables.get_span(handle));
            function.local_variables.append(local, span);
        }
        function.expressions = Arena::new();
        for (handle, expression) in theirs.expressions.iter() {
            let mut expression = expression.clone();
            self.module_handles(&mut expression)?;
            let span = self.span(theirs.expressions.get_span(handle));
            function.expressions.append(expression, span);
        }
        self.block(&mut function.body)?;
        function.diagnostic_filter_leaf = function
            .diagnostic_filter_leaf
            .and_then(|f| self.filters.get(&f).copied());
        Ok(function)
    }

    /// Maps the module-level handles that an expression itself holds.
    fn module_handles(&mut self, expression: &mut Expression) -> Result<(), Box<LinkError>> {
        match expression {
            Expression::Constant(handle) => *handle = self.constant(*handle)?,
            Expression::Override(handle) => *handle = self.override_(*handle)?,
            Expression::GlobalVariable(handle) => *handle = self.global(*handle)?,
            Expression::CallResult(handle) => *handle = self.callee(*handle)?,
            Expression::ZeroValue(ty)
            | Expression::Compose { ty, .. }
            | Expression::AtomicResult { ty, .. }
            | Expression::WorkGroupUniformLoadResult { ty }
            | Expression::SubgroupOperationResult { ty } => *ty = self.ty(*ty)?,
            _ => {}
        }
        Ok(())
    }

    fn block(&mut self, block: &mut Block) -> Result<(), Box<LinkError>> {
        let base = self.base;
        for (statement, span) in block.span_iter_mut() {
            if let Some(span) = span {
                *span = offset(*span, base);
            }
            if let Statement::Call { function, .. } = statement {
                *function = self.callee(*function)?;
            }
            for block in naga_operands::blocks_mut(statement) {
                self.block(block)?;
            }
        }
        Ok(())
    }

    fn global(
        &self,
        handle: Handle<GlobalVariable>,
    ) -> Result<Handle<GlobalVariable>, Box<LinkError>> {
        self.globals.get(&handle).copied().ok_or_else(dangling)
    }

    fn callee(&self, handle: Handle<Function>) -> Result<Handle<Function>, Box<LinkError>> {
        self.functions.get(&handle).copied().ok_or_else(dangling)
    }

    /// `name`, with the stage appended if the first module uses it.
    fn unique(&mut self, name: &str) -> String {
        let mut unique = name.to_owned();
        while !self.names.insert(unique.clone()) {
            unique = format!("{unique}_{}", self.suffix);
        }
        unique
    }
}

/// A function's content without spans. naga's IR has no equality; its debug form shows everything.
fn content(function: &Function) -> String {
    fn forget_spans(block: &mut Block) {
        for (statement, span) in block.span_iter_mut() {
            if let Some(span) = span {
                *span = Span::UNDEFINED;
            }
            naga_operands::blocks_mut(statement)
                .into_iter()
                .for_each(forget_spans);
        }
    }
    let mut function = function.clone();
    forget_spans(&mut function.body);
    format!("{function:?}")
}

/// The error for a front end that breaks naga's rule that handles only refer backward.
fn dangling() -> Box<LinkError> {
    LinkError::new("the parsed module refers to an item before declaring it")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use naga::{Literal, Scalar};

    use super::*;

    /// A quadratic algorithm would not finish.
    #[test]
    fn many_constants_are_shared() {
        let many = 50_000;
        let numbered = |from: u32| {
            let mut module = Module::default();
            let float = Type {
                name: None,
                inner: TypeInner::Scalar(Scalar::F32),
            };
            let ty = module.types.insert(float, Span::UNDEFINED);
            for n in from..from + many {
                let literal = Expression::Literal(Literal::F32(n as f32));
                let init = module.global_expressions.append(literal, Span::UNDEFINED);
                let name = Some(format!("n{n}"));
                let constant = Constant { name, ty, init };
                module.constants.append(constant, Span::UNDEFINED);
            }
            module
        };
        let (first, second) = (numbered(0), numbered(many / 2));
        let module = link(first, &second, 0, "_b").unwrap().module;
        let all = (many + many / 2) as usize;
        assert_eq!(module.global_expressions.len(), all);
        assert_eq!(module.constants.len(), all);
    }

    #[test]
    fn zeros_of_two_signs_stay_two() {
        let zero = |n: f32| {
            let mut module = Module::default();
            let literal = Expression::Literal(Literal::F32(n));
            module.global_expressions.append(literal, Span::UNDEFINED);
            let float = Type {
                name: None,
                inner: TypeInner::Scalar(Scalar::F32),
            };
            let ty = module.types.insert(float, Span::UNDEFINED);
            let init = module.global_expressions.iter().next().unwrap().0;
            let name = Some("zero".to_owned());
            let constant = Constant { name, ty, init };
            module.constants.append(constant, Span::UNDEFINED);
            module
        };
        let module = link(zero(0.0), &zero(-0.0), 0, "_b").unwrap().module;
        assert_eq!(module.global_expressions.len(), 2);
    }
}
