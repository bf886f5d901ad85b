//! Declarations of the author's text that the IR cannot express: uniforms outside of blocks,
//! combined samplers, matrix attributes. Emission writes them again. Transforms ignore them; they
//! stay valid as long as bindings and locations keep their numbers.

use naga::{Handle, Module, Override, ResourceBinding};

/// The note for code that loses `precise` or `NoContraction`.
pub const PRECISE_NOTE: &str = "`precise` (`NoContraction`) is kept for the position only: elsewhere a \
                            driver may fuse a multiply and an add";

/// The note on rows of `gl_FragCoord`.
pub const FRAG_COORD_NOTE: &str = "`gl_FragCoord.y` counts rows from the bottom in OpenGL and from the top in WGSL and \
                               SPIR-V: values that depend on it are upside down there";

/// The note on the sign of `dFdy`.
pub const DFDY_NOTE: &str =
    "`dFdy` points up in OpenGL and down in WGSL and SPIR-V: it has the opposite sign there";

/// Notes that do not apply if row 0 of a target is the bottom row.
pub const ROW_NOTES: [&str; 2] = [FRAG_COORD_NOTE, DFDY_NOTE];

/// The author's declarations that the IR can't express. Empty for WGSL.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Declared {
    /// Binding of the block in which we collect loose uniforms, as members with the same names.
    pub loose: Option<ResourceBinding>,
    /// Binding of a copy of that block with the previous frame's values ([`Self::previous_name`]).
    pub previous: Option<ResourceBinding>,
    /// The block of loose uniforms that a pass adds, and that the host fills.
    pub host: Option<ResourceBinding>,
    /// The uniforms outside of blocks, samplers included, in order of declaration.
    pub uniforms: Vec<Declaration>,
    /// The combined samplers among them.
    pub samplers: Vec<CombinedSampler>,
    /// The uniform and storage blocks.
    pub blocks: Vec<Block>,
    /// The members that are `row_major` matrices, or arrays of them: names of struct and member.
    /// The IR declares their transposes, which have the same memory.
    pub rows: Vec<(String, String)>,
    /// The specialisation constants whose overrides have another name or id in the IR.
    pub constants: Vec<SpecConstant>,
    /// The specialisation constants that are array lengths.
    pub lengths: Vec<LengthConstant>,
    /// The specialisation constants without an override in the IR, because their defaults are
    /// final.
    pub finals: Vec<FinalConstant>,
    /// The structs with another name in the IR, where each layout needs a struct of its own: its
    /// name and the author's.
    pub copies: Vec<(String, String)>,
    /// The numbers of `layout(binding = ..)`, which may differ from the IR's.
    pub numbers: Vec<Numbered>,
    /// The inputs of the vertex stage.
    pub attributes: Vec<Located>,
    /// The outputs of the fragment stage.
    pub targets: Vec<Located>,
    /// The depth range of the author's positions, if it isn't the IR's.
    pub depth: Depth,
    /// Whether the author's positions are Vulkan's, with y pointing down.
    pub y_down: bool,
    /// Whether the vertex stage writes a point size. WGSL cannot express it, and the IR drops it.
    pub point_size: bool,
    /// Whether the fragment stage has `layout(origin_upper_left)`: its `gl_FragCoord` counts rows
    /// from the top, as in the IR. OpenGL counts from the bottom by default.
    pub origin_upper_left: bool,
    /// Notes for the host on how the text was read, one sentence each.
    pub notes: Vec<String>,
    /// The stages whose entry point is called `main` in the author's text. The IR renames it,
    /// because both stages share one name space.
    pub mains: Vec<naga::ShaderStage>,
    /// The precisions of floats, by stage. The IR only has full precision.
    pub precisions: Vec<StagePrecision>,
    /// Whether `discard` demotes the invocation to a helper, as in WGSL. Otherwise it ends the
    /// invocation, as in GLSL.
    pub demotes: bool,
}

impl Declared {
    /// Whether a block with this binding stands for loose uniforms.
    pub fn is_loose(&self, binding: Option<ResourceBinding>) -> bool {
        binding.is_some() && [self.loose, self.previous, self.host].contains(&binding)
    }

    /// The name of the loose uniform that has the previous frame's value of `name`.
    pub fn previous_name(&self, name: &str) -> String {
        let mut free = format!("{name}_previous");
        while self.uniforms.iter().any(|u| u.name == free) {
            free.push('_');
        }
        free
    }

    /// A copy with the previous frame's uniforms among the loose ones.
    pub fn with_previous(&self) -> Self {
        let data = self.uniforms.iter().filter(|u| u.ty.has_data());
        let copies = data
            .filter(|_| self.previous.is_some())
            .map(|u| Declaration {
                name: self.previous_name(&u.name),
                ty: u.ty.clone(),
                location: None,
            });
        let copies: Vec<_> = copies.collect();
        let mut all = self.clone();
        all.uniforms.extend(copies);
        all
    }

    /// The name of a variable, or of its block: the variable of an unnamed GLSL block has no name.
    pub fn name_of(&self, variable: &naga::GlobalVariable) -> String {
        let block = || {
            let at = variable.binding?;
            let mut all = self.blocks.iter();
            all.find(|b| b.binding == at).map(|b| b.name.clone())
        };
        let own = variable.name.clone().filter(|name| !name.is_empty());
        own.or_else(block).unwrap_or_default()
    }

    /// The outputs of the fragment stage that Vulkan's GLSL declares with fewer components than the
    /// IR has.
    pub fn widened(&self) -> impl Iterator<Item = &Located> {
        let is_narrow = |l: &&Located| l.components().is_some_and(|n| n < 4);
        let targets = self.targets.iter().filter(|_| self.y_down);
        targets.filter(is_narrow)
    }

    /// Adds the constants of the second stage that have an override of their own.
    pub fn tell_apart(&mut self, constants: Vec<SpecConstant>) {
        let note = |c: &SpecConstant| {
            format!(
                "each stage has a constant {} of its own: the second one's, `{}`, is the override \
                 `{}` in WGSL",
                c.id, c.own, c.name
            )
        };
        self.notes.extend(constants.iter().map(note));
        self.constants.extend(constants);
    }
}

/// The name of a float that fills a gap in a block, for WGSL and naga's GLSL.
pub fn padding(block: &str, at: impl std::fmt::Display) -> String {
    format!("{block}_padding_{at}")
}

/// Whether a member of a block has a name from [`padding`].
pub fn is_padding(block: &str, member: &str) -> bool {
    let rest = member.strip_prefix(block);
    let at = rest.and_then(|rest| rest.strip_prefix("_padding_"));
    at.is_some_and(|at| !at.is_empty() && at.bytes().all(|b| b.is_ascii_digit() || b == b'x'))
}

/// The range of depths between the near and the far plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Depth {
    /// 0 to 1, or as written: the IR holds the author's positions.
    #[default]
    AsWritten,
    /// -1 to 1, as in OpenGL: the IR holds `(z + w) / 2` for the author's `z`.
    OpenGl,
}

/// The precisions that a stage's text gives to floats.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StagePrecision {
    pub stage: naga::ShaderStage,
    /// The default: that of `precision mediump float;`, or else `highp`.
    pub default: Precision,
    /// Those that declarations of variables name.
    pub qualified: Vec<Precision>,
}

/// A precision of GLSL, the most precise first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Precision {
    /// `highp`.
    High,
    /// `mediump`.
    Medium,
    /// `lowp`.
    Low,
}

impl std::fmt::Display for Precision {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::High => "`highp`",
            Self::Medium => "`mediump`",
            Self::Low => "`lowp`",
        })
    }
}

/// A name and its type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Declaration {
    pub name: String,
    pub ty: Type,
    /// `layout(location = ..)` of a loose uniform, if present (OpenGL 4.3).
    pub location: Option<u32>,
}

/// A block, texture, combined sampler or image with a number from its author.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Numbered {
    /// Binding in the IR. For a combined sampler, that of its texture.
    pub binding: ResourceBinding,
    /// `layout(binding = ..)`. For an array element, the array's number plus the element's index.
    pub number: u32,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Type {
    /// A scalar, vector or matrix, by GLSL name.
    Plain(String),
    /// A combined sampler, by GLSL name: `sampler2D`, `usamplerCube`, `sampler2DShadow`.
    Sampler(String),
    /// An array with its length.
    Array(Box<Type>, u32),
    /// A struct: its name and its members.
    Struct(String, Vec<Declaration>),
}

/// A texture and a sampler that form one variable in the author's text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CombinedSampler {
    /// Path in the text: `map`, `maps[2]`, `material.diffuse`.
    pub path: String,
    /// The texture in the IR.
    pub texture: ResourceBinding,
    /// The sampler in the IR.
    pub sampler: ResourceBinding,
}

/// A uniform or storage block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    pub binding: ResourceBinding,
    pub name: String,
    /// The instance name. Without one, the members' names are global.
    pub instance: Option<String>,
}

/// A specialisation constant with another name or id in the IR: an override is shared by both
/// stages, but in Vulkan each stage has its own constants.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpecConstant {
    /// Name in the IR.
    pub name: String,
    /// The author's name.
    pub own: String,
    /// The author's `constant_id`.
    pub id: u32,
}

/// A specialisation constant that is an array length. The IR cannot express such a length outside
/// of workgroup memory. There the arrays have the default length and named types. Targets with
/// specialisation constants restore the constant as the length; others use its default everywhere.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LengthConstant {
    /// The author's `constant_id`, which is the override's.
    pub id: u32,
    /// The author's name.
    pub own: String,
    /// Whether it is an `int`. Otherwise it is a `uint`.
    pub is_signed: bool,
}

/// A specialisation constant whose value had to be known when the text was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FinalConstant {
    /// The author's `constant_id`.
    pub id: u32,
    /// The author's name.
    pub own: String,
    /// Its default, which is its final value. `None` if it is neither an integer nor a boolean.
    pub default: Option<i64>,
}

impl LengthConstant {
    const PREFIX: &str = "preshade_length_";

    /// The name of the array types in the IR.
    pub fn type_name(&self) -> String {
        Self::type_name_of(self.id)
    }

    /// As [`Self::type_name`], for the constant `id`.
    pub fn type_name_of(id: u32) -> String {
        format!("{}{id}", Self::PREFIX)
    }

    /// Whether a type is such an array, whose length a host may change.
    pub fn is_of(ty: &naga::Type) -> bool {
        let name = ty.name.as_deref();
        matches!(ty.inner, naga::TypeInner::Array { .. }) && name.is_some_and(Self::is_type_name)
    }

    /// Whether a type contains an array whose length is a specialisation constant.
    pub fn is_any_in(module: &Module, ty: Handle<naga::Type>) -> bool {
        has_array(module, ty, &Self::is_of)
    }

    /// Whether a type contains an array of this length.
    pub fn is_in(&self, module: &Module, ty: Handle<naga::Type>) -> bool {
        let name = Some(self.type_name());
        has_array(module, ty, &|ty| ty.name == name)
    }

    /// Whether a type name belongs to such arrays.
    pub fn is_type_name(name: &str) -> bool {
        let id = name.strip_prefix(Self::PREFIX);
        id.is_some_and(|id| id.parse::<u32>().is_ok())
    }

    /// Its override, if the module reads its value.
    pub fn override_in(&self, module: &Module) -> Option<Handle<Override>> {
        // Stages may have different constants with one id, and a name that WGSL reserves has a
        // suffix.
        let is_own = |name: &str| {
            let ending = name.strip_prefix(&self.own);
            ending.is_some_and(|ending| ending.trim_matches(['_', '0']).is_empty())
        };
        let mut all = module.overrides.iter();
        let found = all.find(|(_, o)| {
            o.id.map(u32::from) == Some(self.id) && o.name.as_deref().is_some_and(is_own)
        });
        found.map(|(handle, _)| handle)
    }
}

/// Whether a type contains an array for which `is_it` holds.
fn has_array(module: &Module, ty: Handle<naga::Type>, is_it: &dyn Fn(&naga::Type) -> bool) -> bool {
    let ty = &module.types[ty];
    match &ty.inner {
        naga::TypeInner::Array { base, .. } => is_it(ty) || has_array(module, *base, is_it),
        naga::TypeInner::Struct { members, .. } => {
            members.iter().any(|m| has_array(module, m.ty, is_it))
        }
        _ => false,
    }
}

/// An input of the vertex stage, or an output of the fragment stage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Located {
    pub declaration: Declaration,
    /// Its first location in the IR.
    pub location: u32,
    pub chosen: Chosen,
}

impl Located {
    /// Number of components of a scalar or vector.
    pub fn components(&self) -> Option<u32> {
        let Type::Plain(name) = &self.declaration.ty else {
            return None;
        };
        match name.as_str() {
            "float" | "int" | "uint" => Some(1),
            name if name.contains("vec") => name.chars().next_back()?.to_digit(10),
            _ => None,
        }
    }

    /// The name of the four-component vector that replaces it in the IR.
    pub fn widened_name(&self) -> String {
        format!("{}_rgba", self.declaration.name)
    }

    /// Whether a name is [`Self::widened_name`], perhaps with a suffix to make it unique.
    pub fn is_widened_as(&self, name: &str) -> bool {
        name.starts_with(&self.widened_name())
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chosen {
    ByAuthor,
    /// Chosen by us: the author's host queries or sets it by name.
    ByUs,
}

impl Type {
    /// The element type under all array levels.
    pub fn innermost(&self) -> &Self {
        match self {
            Self::Array(of, _) => of.innermost(),
            other => other,
        }
    }

    /// The array lengths in brackets, outermost first. Empty for other types.
    pub fn dimensions(&self) -> String {
        match self {
            Self::Array(of, n) => format!("[{n}]{}", of.dimensions()),
            _ => String::new(),
        }
    }

    pub fn has_samplers(&self) -> bool {
        match self {
            Self::Plain(_) => false,
            Self::Sampler(_) => true,
            Self::Array(of, _) => of.has_samplers(),
            Self::Struct(_, members) => members.iter().any(|m| m.ty.has_samplers()),
        }
    }

    /// Whether it contains anything other than samplers.
    pub fn has_data(&self) -> bool {
        match self {
            Self::Plain(_) => true,
            Self::Sampler(_) => false,
            Self::Array(of, _) => of.has_data(),
            Self::Struct(_, members) => members.iter().any(|m| m.ty.has_data()),
        }
    }
}
