//! A shader program: one validated naga module with a material's stages, and the author's text that
//! messages point into.

use std::sync::{Arc, OnceLock};

use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};

use crate::features;
use naga_edit::declared::Declared;
use naga_operands::calls;
use shader_text::source::{Invalid, Language, SourceMap};

/// A validated module and its source. No invalid one can be constructed, and none can be changed in
/// place: a transform builds another module and validates it by [`Program::new`].
#[derive(Clone, Debug)]
pub struct Program {
    module: Arc<naga::Module>,
    info: Arc<ModuleInfo>,
    sources: Arc<SourceMap>,
    language: Language,
    declared: Arc<Declared>,
    /// Its needs beyond every device's; computed on first use, unless known to be none.
    capabilities: Arc<OnceLock<Capabilities>>,
    /// No transform has touched it.
    as_written: bool,
}

impl Program {
    /// Validates `module`.
    ///
    /// # Errors
    ///
    /// If the call depth exceeds [`calls::MOST`], or naga's validator fails with all of
    /// WebGPU's optional capabilities allowed: the plan's `features` handle the adapter's
    /// capabilities.
    pub fn new(
        module: naga::Module,
        sources: Arc<SourceMap>,
        language: Language,
    ) -> Result<Self, Box<Invalid>> {
        // Most modules need no optional capability: then we know at once.
        let (info, capabilities) = match validate(&module, Allowed::Core) {
            Ok(info) => (info, OnceLock::from(Capabilities::empty())),
            Err(_) => (validate(&module, Allowed::All)?, OnceLock::new()),
        };
        if let Some(function) = calls::too_deep(&module) {
            return Err(Box::new(too_deep(&module, function)));
        }
        Ok(Self {
            module: Arc::new(module),
            info: Arc::new(info),
            sources,
            language,
            declared: Arc::default(),
            capabilities: Arc::new(capabilities),
            as_written: true,
        })
    }

    /// The program with the declarations of its author's text.
    #[must_use]
    pub fn with_declared(mut self, declared: Declared) -> Self {
        self.declared = Arc::new(declared);
        self
    }

    /// The program with a new validated module: the result of a transform.
    ///
    /// # Errors
    ///
    /// As [`Program::new`]; the transform that built `module` has a bug.
    pub fn with_module(&self, module: naga::Module) -> Result<Self, Box<Invalid>> {
        let program = Self::new(module, Arc::clone(&self.sources), self.language)?;
        Ok(Self {
            declared: Arc::clone(&self.declared),
            as_written: false,
            ..program
        })
    }

    pub fn module(&self) -> &naga::Module {
        &self.module
    }

    /// The validator's results.
    pub fn info(&self) -> &ModuleInfo {
        &self.info
    }

    /// The capabilities it needs beyond every WebGPU device's.
    pub fn capabilities(&self) -> Capabilities {
        *self
            .capabilities
            .get_or_init(|| features::needed(&self.module))
    }

    /// The author's own text, if it is one file and no transform has touched the program.
    pub fn author_text(&self) -> Option<&str> {
        match self.sources.files() {
            [file, imported @ ..] if self.as_written && imported.iter().all(|f| f.is_imported) => {
                Some(&file.text)
            }
            _ => None,
        }
    }

    /// Whether no transform has touched it.
    pub fn is_as_written(&self) -> bool {
        self.as_written
    }

    pub fn sources(&self) -> &Arc<SourceMap> {
        &self.sources
    }

    pub fn language(&self) -> Language {
        self.language
    }

    /// Declarations of the author's text that the module can't express.
    pub fn declared(&self) -> &Declared {
        &self.declared
    }

    /// The entry point of that name, with its index (names are unique within a stage only).
    pub fn entry_point(
        &self,
        stage: naga::ShaderStage,
        name: &str,
    ) -> Option<(usize, &naga::EntryPoint)> {
        self.module
            .entry_points
            .iter()
            .enumerate()
            .find(|(_, e)| e.stage == stage && e.name == name)
    }
}

/// The capabilities the validator permits.
#[derive(Clone, Copy)]
enum Allowed {
    /// Those of every WebGPU device.
    Core,
    All,
}

fn validate(module: &naga::Module, allowed: Allowed) -> Result<ModuleInfo, Box<Invalid>> {
    let mut validator = match allowed {
        Allowed::Core => Validator::new(ValidationFlags::all(), features::core()),
        Allowed::All => Validator::new(ValidationFlags::all(), Capabilities::all()),
    };
    if let Allowed::All = allowed {
        validator
            .subgroup_stages(naga::valid::ShaderStages::all())
            .subgroup_operations(naga::valid::SubgroupOperationSet::all());
    }
    validator.validate(module).map_err(|e| {
        let mut message = e.as_inner().to_string();
        let mut source = std::error::Error::source(e.as_inner());
        while let Some(s) = source {
            message.push_str(": ");
            message.push_str(&s.to_string());
            source = s.source();
        }
        Box::new(Invalid {
            message,
            labels: e.spans().cloned().collect(),
        })
    })
}

fn too_deep(module: &naga::Module, function: naga::Handle<naga::Function>) -> Invalid {
    let name = module.functions[function].name.as_deref();
    Invalid {
        message: format!(
            "functions call one another in a chain of more than {} calls, up to `{}`",
            calls::MOST,
            name.unwrap_or("a function")
        ),
        labels: vec![(
            module.functions.get_span(function),
            "this call chain is too deep".to_owned(),
        )],
    }
}
