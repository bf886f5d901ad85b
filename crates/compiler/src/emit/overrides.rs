//! Overrides in targets without them: specialisation constants where the language has those,
//! defaults elsewhere.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap};

use naga::back::PipelineConstants;
use naga::back::pipeline_constants::{PipelineConstantError, process_overrides};
use naga::valid::ModuleInfo;
use naga::{
    ArraySize, Expression, Function, GlobalVariable, Handle, Literal, Module, Override,
    ShaderStage, Span, Statement, TypeInner,
};
use naga_edit::copy::{CopyFunction, Copying};
use naga_edit::interface;
use naga_edit::variable::private;
use naga_edit::writer::FunctionWriter;
use naga_interp::overrides::overrides_of;
use preshade_plan::plan::Plan;
use preshade_plan::program::Program;
use shader_text::source::{Invalid, Language};

use super::{EmitError, reduce};
use crate::wgsl::constants;
use preshade_plan::plan_file::{SpecConstant, StageFile, Target};

pub(super) struct Settled {
    pub(super) module: Module,
    pub(super) info: ModuleInfo,
}

/// Replaces every override by its default; `None` if there is none.
pub(super) fn settle(
    program: &Program,
    stage: ShaderStage,
    entry: &str,
    file: &str,
    target: Target,
) -> Result<Option<Settled>, EmitError> {
    let none = PipelineConstants::default();
    settle_with(program, (stage, entry), &none, file, target)
}

/// Replaces every override by its value or default; `None` if there is none.
fn settle_with(
    program: &Program,
    entry: (ShaderStage, &str),
    values: &PipelineConstants,
    file: &str,
    target: Target,
) -> Result<Option<Settled>, EmitError> {
    if program.module().overrides.is_empty() {
        return Ok(None);
    }
    let invalid = |invalid: Box<Invalid>| EmitError::Writer {
        file: file.to_owned(),
        target,
        message: invalid.to_string(),
    };
    // naga evaluates expressions of overrides alone, and refuses an infinite value.
    let hidden = match program.language() {
        Language::Wgsl => None,
        Language::Glsl | Language::SpirV => constants::hide(program),
    };
    let hidden = hidden.map(|module| program.with_module(module));
    let hidden = hidden.transpose().map_err(invalid)?;
    let program = hidden.as_ref().unwrap_or(program);
    let module = program.module();
    match process_overrides(module, program.info(), Some(entry), values) {
        Ok((module, info)) => Ok(Some(Settled {
            module: module.into_owned(),
            info: info.into_owned(),
        })),
        Err(PipelineConstantError::MissingValue(name)) => Err(EmitError::Inexpressible {
            file: file.to_owned(),
            target,
            what: format!("the override `{name}` has no default"),
            remedy:
                "give it one in the source: this target has no overrides and uses their defaults"
                    .to_owned(),
        }),
        Err(PipelineConstantError::ConstantEvaluatorError(e)) => {
            let names = module.overrides.iter().filter_map(|(_, o)| o.name.as_ref());
            let names: Vec<String> = names.map(|name| format!("`{name}`")).collect();
            Err(EmitError::Inexpressible {
                file: file.to_owned(),
                target,
                what: format!(
                    "a value that the defaults of the overrides ({}) decide cannot be computed: {e}",
                    names.join(", ")
                ),
                remedy: "give them other defaults, or emit WGSL, where the host gives their values"
                    .to_owned(),
            })
        }
        Err(e) => Err(EmitError::Writer {
            file: file.to_owned(),
            target,
            message: e.to_string(),
        }),
    }
}

impl Settled {
    /// The defaults of the overrides that the stage reads, for
    /// [`StageFile::overrides`](preshade_plan::plan_file::StageFile::overrides).
    pub(super) fn values(&self, program: &Program) -> BTreeMap<String, f64> {
        let overrides = program.module().overrides.iter().map(|(_, o)| o);
        overrides
            .filter_map(|o| Some((key(o)?, number(self.literal(o)?)?)))
            .collect()
    }

    fn literal(&self, of: &Override) -> Option<Literal> {
        let mut constants = self.module.constants.iter().map(|(_, c)| c);
        let constant = constants.find(|c| c.name.is_some() && c.name == of.name)?;
        match self.module.global_expressions[constant.init] {
            Expression::Literal(literal) => Some(literal),
            Expression::ZeroValue(ty) => Literal::zero(self.module.types[ty].inner.scalar()?),
            _ => None,
        }
    }
}

/// The key of WebGPU's pipeline constants: the id or else the name.
fn key(of: &Override) -> Option<String> {
    match of.id {
        Some(id) => Some(id.to_string()),
        None => of.name.clone(),
    }
}

fn number(literal: Literal) -> Option<f64> {
    match literal {
        Literal::F64(v) => Some(v),
        Literal::F32(v) => Some(f64::from(v)),
        Literal::F16(v) => Some(v.to_f64()),
        Literal::I32(v) => Some(f64::from(v)),
        Literal::U32(v) => Some(f64::from(v)),
        Literal::Bool(v) => Some(f64::from(u8::from(v))),
        _ => None,
    }
}

/// The id and the author's name of each override, by its name. The id is the author's, or else the
/// lowest free one. All programs of a material share them.
pub(super) struct SpecIds(BTreeMap<String, (u32, String)>);

impl SpecIds {
    pub(super) fn of(plan: &Plan) -> Self {
        // The author's first, so that a variant has the ids of its original.
        let original = plan.original.as_deref();
        let plans = original.into_iter().chain([plan]);
        let programs = plans.flat_map(|p| p.programs.values());
        let all: Vec<&Override> = programs
            .flat_map(|p| p.module().overrides.iter().map(|(_, o)| o))
            .collect();
        let mut taken: BTreeSet<u32> = all.iter().filter_map(|o| o.id).map(u32::from).collect();
        let declared = plan.programs.values().map(Program::declared);
        let apart = declared.flat_map(|d| &d.constants);
        let mut ids: BTreeMap<String, (u32, String)> = apart
            .map(|c| (c.name.clone(), (c.id, c.own.clone())))
            .collect();
        for of in all {
            let Some(name) = of.name.clone() else {
                continue;
            };
            ids.entry(name.clone()).or_insert_with(|| match of.id {
                Some(id) => (u32::from(id), name),
                None => {
                    let free = (0..).find(|id| taken.insert(*id));
                    (free.unwrap_or_default(), name)
                }
            });
        }
        Self(ids)
    }
}

/// The first id of a constant that a pass brings into a stage where its own is taken. Authors may
/// use lower ones for constants that the IR no longer has.
const MOVED_IDS: u32 = 1000;

/// A private variable that stands for a specialisation constant. Its initial value is the default.
#[derive(Clone, Debug)]
pub(super) struct Variable {
    /// Its name, which occurs nowhere else.
    pub(super) marker: String,
    key: String,
    pub(super) constant: SpecConstant,
}

impl Variable {
    /// A variable for a constant that the host sets by its id.
    #[cfg(feature = "glsl")]
    pub(super) fn new(marker: String, constant: SpecConstant) -> Self {
        let key = constant.id.to_string();
        Self {
            marker,
            key,
            constant,
        }
    }
}

/// A stage whose overrides are variables, for naga's writers, which refuse overrides. The target
/// then declares these variables as specialisation constants.
///
/// An override whose default depends on others is computed where it is read. An override that a
/// type or an initialiser needs has its default.
pub(super) struct Specialised<'p> {
    program: Cow<'p, Program>,
    settled: Option<Settled>,
    pub(super) variables: Vec<Variable>,
    /// The names of overrides that are computed.
    computed: Vec<String>,
    notes: Vec<String>,
}

impl<'p> Specialised<'p> {
    pub(super) fn of(
        program: &'p Program,
        (stage, entry): (ShaderStage, &str),
        ids: &SpecIds,
        file: &str,
        target: Target,
    ) -> Result<Self, EmitError> {
        let mut out = Self {
            program: Cow::Borrowed(program),
            settled: None,
            variables: Vec::new(),
            computed: Vec::new(),
            notes: Vec::new(),
        };
        if program.module().overrides.is_empty() {
            return Ok(out);
        }
        let invalid = |invalid: Box<Invalid>| EmitError::Writer {
            file: file.to_owned(),
            target,
            message: invalid.to_string(),
        };
        let own = reduce::to_stage(program, stage, entry).map_err(invalid)?;
        let module = own.module();
        let without = module.overrides.iter().filter(|(_, o)| o.init.is_none());
        let zeros = without.filter_map(|(_, o)| Some((key(o)?, 0.0))).collect();
        let defaults = settle_with(&own, (stage, entry), &zeros, file, target)?;
        let mut changed = module.clone();
        let mut sources = HashMap::new();
        let stem = free_stem(module, "preshade_constant");
        let fixed = fixed(module);
        for (handle, of) in module.overrides.iter().filter(|(h, _)| !fixed.contains(h)) {
            let default = defaults.as_ref().and_then(|d| d.literal(of));
            let (Some(default), Some(name), Some(key)) = (default, &of.name, key(of)) else {
                continue;
            };
            if let Some(init) = of.init.filter(|e| !overrides_of(module, *e).is_empty()) {
                sources.insert(handle, OverrideSource::Computed(init));
                out.computed.push(name.clone());
                continue;
            }
            let Some((own_id, own_name)) = ids.0.get(name).cloned() else {
                continue;
            };
            // A pass may bring the constants of both stages into one.
            let is_taken = |id: u32| out.variables.iter().any(|v| v.constant.id == id);
            let is_known = |id: u32| ids.0.values().any(|(known, _)| *known == id);
            let mut free = (MOVED_IDS..).filter(|id| !is_taken(*id) && !is_known(*id));
            let id = match is_taken(own_id) {
                true => free.next().unwrap_or(own_id),
                false => own_id,
            };
            if id != own_id {
                out.notes.push(format!(
                    "{file}: the constant `{own_name}` has the id {id}, as another one of this \
                     stage has its own, {own_id}"
                ));
            }
            let marker = format!("{stem}{id}x");
            let global = variable(&mut changed, &marker, of, default);
            sources.insert(handle, OverrideSource::Variable(global));
            let constant = SpecConstant {
                id,
                name: own_name,
                ty: interface::wgsl_type(module, of.ty),
                default: of.init.and_then(|_| number(default)),
            };
            out.variables.push(Variable {
                marker,
                key,
                constant,
            });
        }
        for (handle, function) in module.functions.iter() {
            changed.functions[handle] = OverrideReads::rewrite(module, &sources, function);
        }
        for (to, entry) in changed.entry_points.iter_mut().zip(&module.entry_points) {
            to.function = OverrideReads::rewrite(module, &sources, &entry.function);
        }
        let changed = own.with_module(changed).map_err(invalid)?;
        let changed = reduce::to_stage(&changed, stage, entry).map_err(invalid)?;
        out.settled = settle(&changed, stage, entry, file, target)?;
        out.program = Cow::Owned(changed);
        Ok(out)
    }

    /// The program, whose other overrides have their defaults in [`Specialised::module`].
    #[cfg(feature = "glsl")]
    pub(super) fn program(&self) -> &Program {
        &self.program
    }

    #[cfg(feature = "spirv")]
    pub(super) fn module(&self) -> (&Module, &ModuleInfo) {
        match &self.settled {
            Some(Settled { module, info }) => (module, info),
            None => (self.program.module(), self.program.info()),
        }
    }

    /// The overrides, as the host must set them.
    pub(super) fn stage_file(&self, file: &str, entry: &str) -> StageFile {
        let constants = self.variables.iter();
        let note = |name: &String| {
            format!("`{file}` computes the override `{name}` from others: it cannot be set there")
        };
        StageFile {
            overrides: self
                .settled
                .as_ref()
                .map(|s| s.values(&self.program))
                .unwrap_or_default(),
            constants: constants
                .map(|v| (v.key.clone(), v.constant.clone()))
                .collect(),
            notes: self
                .computed
                .iter()
                .map(note)
                .chain(self.notes.iter().cloned())
                .collect(),
            ..StageFile::new(file, entry)
        }
    }
}

/// `stem` or a longer one that no name of the module contains.
pub(super) fn free_stem(module: &Module, stem: &str) -> String {
    let mut names: Vec<&str> = Vec::new();
    for (_, ty) in module.types.iter() {
        names.extend(ty.name.as_deref());
    }
    let globals = module.global_variables.iter();
    names.extend(globals.filter_map(|(_, g)| g.name.as_deref()));
    let functions = module.functions.iter().map(|(_, f)| f);
    for f in functions.chain(module.entry_points.iter().map(|e| &e.function)) {
        names.extend(f.name.as_deref());
        names.extend(f.arguments.iter().filter_map(|a| a.name.as_deref()));
        let locals = f.local_variables.iter();
        names.extend(locals.filter_map(|(_, l)| l.name.as_deref()));
        names.extend(f.named_expressions.values().map(String::as_str));
    }
    let mut stem = stem.to_owned();
    while names.iter().any(|n| n.contains(&stem)) {
        stem.push('x');
    }
    stem
}

/// The overrides whose values types, initialisers and workgroup sizes need.
fn fixed(module: &Module) -> BTreeSet<Handle<Override>> {
    let mut fixed = BTreeSet::new();
    for (_, ty) in module.types.iter() {
        if let TypeInner::Array { size, .. } | TypeInner::BindingArray { size, .. } = ty.inner
            && let ArraySize::Pending(length) = size
        {
            fixed.insert(length);
        }
    }
    let globals = module.global_variables.iter().filter_map(|(_, g)| g.init);
    let sizes = module
        .entry_points
        .iter()
        .filter_map(|e| e.workgroup_size_overrides);
    for expression in globals.chain(sizes.flatten().flatten()) {
        fixed.extend(overrides_of(module, expression));
    }
    // A default refers to earlier overrides only.
    let all: Vec<_> = module.overrides.iter().collect();
    for (handle, of) in all.into_iter().rev() {
        if let (true, Some(init)) = (fixed.contains(&handle), of.init) {
            fixed.extend(overrides_of(module, init));
        }
    }
    fixed
}

/// Adds the variable of an override.
fn variable(
    module: &mut Module,
    marker: &str,
    of: &Override,
    default: Literal,
) -> Handle<GlobalVariable> {
    let expressions = &mut module.global_expressions;
    let init = expressions.append(Expression::Literal(default), Span::UNDEFINED);
    private(module, marker, of.ty, Some(init))
}

/// Where the value of an override comes from.
enum OverrideSource {
    Variable(Handle<GlobalVariable>),
    /// From its default, a global expression.
    Computed(Handle<Expression>),
}

/// Copies a function that reads overrides. The copy reads their sources at its start.
struct OverrideReads<'a> {
    copying: Copying<'a>,
    module: &'a Module,
    sources: &'a HashMap<Handle<Override>, OverrideSource>,
    values: HashMap<Handle<Override>, Handle<Expression>>,
    /// The original's expressions that depend on an override.
    dependent: BTreeSet<Handle<Expression>>,
}

impl<'a> OverrideReads<'a> {
    fn rewrite(
        module: &'a Module,
        sources: &'a HashMap<Handle<Override>, OverrideSource>,
        function: &'a Function,
    ) -> Function {
        let mut reads = Self {
            copying: Copying::new(function, FunctionWriter::like(function)),
            module,
            sources,
            values: HashMap::new(),
            dependent: BTreeSet::new(),
        };
        for (e, expression) in function.expressions.iter() {
            let operands = naga_operands::of_expression(expression);
            let mut dependent = operands.iter().any(|o| reads.dependent.contains(o));
            if let Expression::Override(of) = expression {
                reads.value(*of);
                dependent = true;
            }
            if dependent {
                reads.dependent.insert(e);
            }
        }
        reads.copying.writer.flush(Span::UNDEFINED);
        reads.copying.initialisers();
        reads.unevaluated();
        reads.assign();
        reads.copying.writer.flush(Span::UNDEFINED);
        reads.block(&function.body);
        reads.copying.finish()
    }

    /// The value of an override, evaluated at the start of the function.
    fn value(&mut self, of: Handle<Override>) -> Handle<Expression> {
        if let Some(value) = self.values.get(&of) {
            return *value;
        }
        let value = match self.sources.get(&of) {
            Some(OverrideSource::Variable(global)) => {
                let writer = &mut self.copying.writer;
                let pointer = writer.expression(Expression::GlobalVariable(*global));
                writer.expression(Expression::Load { pointer })
            }
            Some(OverrideSource::Computed(init)) => self.global(*init),
            None => self.copying.writer.expression(Expression::Override(of)),
        };
        self.values.insert(of, value);
        value
    }

    /// A global expression, evaluated at the start of the function.
    fn global(&mut self, e: Handle<Expression>) -> Handle<Expression> {
        let module = self.module;
        match &module.global_expressions[e] {
            Expression::Override(of) => self.value(*of),
            other => {
                let mut copy = other.clone();
                naga_operands::map_expression(&mut copy, &mut |o| *o = self.global(*o));
                self.copying.writer.expression(copy)
            }
        }
    }

    /// An initialiser, evaluated at the start of the function.
    fn initial(&mut self, e: Handle<Expression>) -> Handle<Expression> {
        match &self.copying.original.expressions[e] {
            Expression::Override(of) => self.value(*of),
            other => {
                let mut copy = other.clone();
                naga_operands::map_expression(&mut copy, &mut |o| *o = self.initial(*o));
                self.copying.writer.expression(copy)
            }
        }
    }

    /// Stores the initial values that depend on overrides: an initialiser is constant.
    fn assign(&mut self) {
        let original = self.copying.original;
        for (handle, local) in original.local_variables.iter() {
            let Some(init) = local.init.filter(|e| self.dependent.contains(e)) else {
                continue;
            };
            let value = self.initial(init);
            let writer = &mut self.copying.writer;
            writer.function.local_variables[handle].init = None;
            let pointer = writer.expression(Expression::LocalVariable(handle));
            writer.statement(Statement::Store { pointer, value }, Span::UNDEFINED);
        }
    }
}

impl<'a> CopyFunction<'a> for OverrideReads<'a> {
    fn copying(&mut self) -> &mut Copying<'a> {
        &mut self.copying
    }

    fn expression(&mut self, e: Handle<Expression>) {
        match &self.copying.original.expressions[e] {
            Expression::Override(of) => {
                let value = self.value(*of);
                self.copying.copies.insert(e, value);
            }
            other => {
                let copy = self.copying.copies.with_operands(other);
                self.copying.append(e, copy);
            }
        }
    }

    fn unevaluated(&mut self) {
        let original = self.copying.original;
        let mut evaluated = BTreeSet::new();
        naga_operands::evaluated(&original.body, &mut |e| {
            evaluated.insert(e);
        });
        for (e, expression) in original.expressions.iter() {
            if evaluated.contains(&e) {
                continue;
            }
            match expression {
                // It needed no evaluation as long as it was constant.
                other if self.dependent.contains(&e) && !other.needs_pre_emit() => {
                    let copy = self.copying.copies.with_operands(other);
                    let copy = self.copying.writer.expression(copy);
                    self.copying.copies.insert(e, copy);
                }
                _ => {
                    self.copying.writer.flush(Span::UNDEFINED);
                    self.expression(e);
                }
            }
        }
    }
}
