//! Declarations of the author's text that the IR can't express: uniforms outside of blocks,
//! combined samplers, matrix attributes. Emission writes them again. Transforms ignore them; they
//! stay valid as long as bindings and locations keep their numbers.

use naga::{Handle, Module, Override, ResourceBinding};

/// The note on `precise`, or `NoContraction`, where it is lost.
pub const PRECISE_NOTE: &str = "`precise` (`NoContraction`) is kept for the position only: elsewhere a \
                            driver may fuse a multiply and an add";

/// The note on rows of `gl_FragCoord`.
pub const FRAG_COORD_NOTE: &str = "`gl_FragCoord.y` counts rows from the bottom in OpenGL and from the top in WGSL and \
                               SPIR-V: values that depend on it are upside down there";

/// The note on the sign of `dFdy`.
pub const DFDY_NOTE: &str =
    "`dFdy` points up in OpenGL and down in WGSL and SPIR-V: it has the opposite sign there";

/// Notes that do not hold where a target's first row is the bottom one.
pub const ROW_NOTES: [&str; 2] = [FRAG_COORD_NOTE, DFDY_NOTE];

/// The author's declarations that the IR can't express. Empty for WGSL.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Declared {
    /// Binding of the block that we gather loose uniforms in, as members with their names.
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
    /// The members that are `row_major` matrices, or arrays of them: names of struct and member. The
    /// IR has their transposes, which are the same memory.
    pub rows: Vec<(String, String)>,
    /// The specialisation constants whose overrides have another name or id in the IR.
    pub constants: Vec<SpecConstant>,
    /// The specialisation constants that give the lengths of arrays.
    pub lengths: Vec<LengthConstant>,
    /// The specialisation constants that are no override in the IR: their defaults are final.
    pub finals: Vec<FinalConstant>,
    /// The structs that the IR has under another name, as each layout is a struct of its own: its
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
    /// The author's positions are Vulkan's: their y points down.
    pub y_down: bool,
    /// The vertex stage writes a point size, which WGSL can't express and the IR doesn't keep.
    pub point_size: bool,
    /// The fragment stage has `layout(origin_upper_left)`: its `gl_FragCoord` counts rows from the
    /// top, as the IR does. OpenGL counts from the bottom by default.
    pub origin_upper_left: bool,
    /// Notes for the host on how the text was read, a sentence each.
    pub notes: Vec<String>,
    /// The stages whose entry point the author calls `main`. In the IR it has another name, because
    /// both stages share one name space.
    pub mains: Vec<naga::ShaderStage>,
    /// The precisions of floats, by stage. The IR has full precision alone.
    pub precisions: Vec<StagePrecision>,
    /// `discard` demotes the invocation to a helper, as in WGSL. Otherwise it ends it, as in GLSL.
    pub demotes: bool,
}

impl Declared {
    /// Whether a block of this binding stands for loose uniforms.
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

    /// With the uniforms of the previous frame among the loose ones.
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

    /// The name of a variable, or that of its block: an unnamed GLSL block has no variable's name.
    pub fn name_of(&self, variable: &naga::GlobalVariable) -> String {
        let block = || {
            let at = variable.binding?;
            let mut all = self.blocks.iter();
            all.find(|b| b.binding == at).map(|b| b.name.clone())
        };
        let own = variable.name.clone().filter(|name| !name.is_empty());
        own.or_else(block).unwrap_or_default()
    }

    /// The outputs of the fragment stage that a text of Vulkan's declares with fewer components than
    /// the IR has.
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

/// The name of a float that fills a gap in a block, as WGSL and naga's GLSL need it.
pub fn padding(block: &str, at: impl std::fmt::Display) -> String {
    format!("{block}_padding_{at}")
}

/// Whether a member of a block has such a name.
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
    /// That of `precision mediump float;`, or `highp`.
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
    /// Binding in the IR; of a combined sampler its texture's.
    pub binding: ResourceBinding,
    /// `layout(binding = ..)`; for an array element the sum of the array's number and its index.
    pub number: u32,
}

/// A GLSL type.
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

/// A texture and a sampler that are one variable in the author's text.
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
    /// The block's name.
    pub name: String,
    /// The instance's name. Without one, the members' names are global.
    pub instance: Option<String>,
}

/// A specialisation constant that the IR has under another name or id: an override is one of both
/// stages, and in Vulkan each stage has its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpecConstant {
    /// Name in the IR.
    pub name: String,
    /// The author's name.
    pub own: String,
    /// The author's `constant_id`.
    pub id: u32,
}

/// A specialisation constant that gives the lengths of arrays. The IR can't express such a length
/// outside of workgroups. The arrays have the default length there, and named types. Targets that
/// have specialisation constants give the arrays their constant again; others use its default
/// everywhere.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LengthConstant {
    /// The author's `constant_id`, which is the override's.
    pub id: u32,
    /// The author's name.
    pub own: String,
    /// Whether it is an `int` and not a `uint`.
    pub is_signed: bool,
}

/// A specialisation constant whose value had to be known when the text was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FinalConstant {
    /// The author's `constant_id`.
    pub id: u32,
    /// The author's name.
    pub own: String,
    /// Its default, which is its value; `None` if it is not an integer or a boolean.
    pub default: Option<i64>,
}

impl LengthConstant {
    const PREFIX: &str = "preshade_length_";

    /// The name of the array types in the IR.
    pub fn type_name(&self) -> String {
        Self::type_name_of(self.id)
    }

    /// The same, of the constant `id`.
    pub fn type_name_of(id: u32) -> String {
        format!("{}{id}", Self::PREFIX)
    }

    /// Whether it is such an array: a host may make it longer or shorter.
    pub fn is_of(ty: &naga::Type) -> bool {
        let name = ty.name.as_deref();
        matches!(ty.inner, naga::TypeInner::Array { .. }) && name.is_some_and(Self::is_type_name)
    }

    /// Whether an array of any such length is in a type.
    pub fn is_any_in(module: &Module, ty: Handle<naga::Type>) -> bool {
        has_array(module, ty, &Self::is_of)
    }

    /// Whether an array of this length is in a type.
    pub fn is_in(&self, module: &Module, ty: Handle<naga::Type>) -> bool {
        let name = Some(self.type_name());
        has_array(module, ty, &|ty| ty.name == name)
    }

    /// Whether it is the name of such arrays.
    pub fn is_type_name(name: &str) -> bool {
        let id = name.strip_prefix(Self::PREFIX);
        id.is_some_and(|id| id.parse::<u32>().is_ok())
    }

    /// Its override, if the module reads its value.
    pub fn override_in(&self, module: &Module) -> Option<Handle<Override>> {
        // Stages may have different constants of one id, and a name that WGSL reserves has an ending.
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

/// Whether an array is in a type for which `is_it` holds.
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
    /// Name and type.
    pub declaration: Declaration,
    /// Its first location in the IR.
    pub location: u32,
    /// Who chose it.
    pub chosen: Chosen,
}

impl Located {
    /// The components of a scalar or a vector.
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

    /// The name in the IR of the vector of four that stands for it.
    pub fn widened_name(&self) -> String {
        format!("{}_rgba", self.declaration.name)
    }

    /// Whether it has such a name, with an ending if that was taken.
    pub fn is_widened_as(&self, name: &str) -> bool {
        name.starts_with(&self.widened_name())
    }
}

/// Who chose a location.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chosen {
    ByAuthor,
    /// We did: the author's host queries or sets it by name.
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

    /// The array lengths in brackets, outermost first; empty for other types.
    pub fn dimensions(&self) -> String {
        match self {
            Self::Array(of, n) => format!("[{n}]{}", of.dimensions()),
            _ => String::new(),
        }
    }

    /// Whether it contains samplers.
    pub fn has_samplers(&self) -> bool {
        match self {
            Self::Plain(_) => false,
            Self::Sampler(_) => true,
            Self::Array(of, _) => of.has_samplers(),
            Self::Struct(_, members) => members.iter().any(|m| m.ty.has_samplers()),
        }
    }

    /// Whether anything but samplers is in it.
    pub fn has_data(&self) -> bool {
        match self {
            Self::Plain(_) => true,
            Self::Sampler(_) => false,
            Self::Array(of, _) => of.has_data(),
            Self::Struct(_, members) => members.iter().any(|m| m.ty.has_data()),
        }
    }
}
