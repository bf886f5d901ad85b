//! What the author's text declares that the IR has no word for, kept so that it can be written again: uniforms outside of blocks, textures and samplers in one, matrices as
//! attributes. A transform does not look at it; it stays true as long as bindings and locations keep their numbers.

use naga::ResourceBinding;

/// The author's declarations, where they are not the IR's own. Empty for WGSL, which the IR says as it is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Declared {
    /// Where the uniforms outside of blocks lie: a block of ours, whose members have their names.
    pub loose: Option<ResourceBinding>,
    /// The uniforms outside of blocks, samplers among them, in the order of declaration.
    pub uniforms: Vec<Declaration>,
    /// The combined samplers in them.
    pub samplers: Vec<CombinedSampler>,
    /// The uniform and storage blocks.
    pub blocks: Vec<Block>,
    /// What the author's text numbers by `layout(binding = ..)`, whatever the IR has it at.
    pub numbers: Vec<Numbered>,
    /// The inputs of the vertex stage.
    pub attributes: Vec<Located>,
    /// The outputs of the fragment stage.
    pub targets: Vec<Located>,
    /// In which depth the author's positions are, where that is not the IR's.
    pub depth: Depth,
    /// The vertex stage says how large points are, which WGSL has no word for and the IR here does not keep.
    pub point_size: bool,
    /// The fragment stage says `layout(origin_upper_left)`: its `gl_FragCoord` counts rows from the top, as the IR's does, and not from the bottom, as OpenGL's else does.
    pub origin_upper_left: bool,
    /// What a host is to know of how the text was read, a sentence each.
    pub notes: Vec<String>,
}

/// The range of depths between the near and the far plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Depth {
    /// 0 to 1, or whatever the text says: positions in the IR are the author's.
    #[default]
    AsWritten,
    /// -1 to 1, as in OpenGL: in the IR, `(z + w) / 2` stands for the author's `z`.
    OpenGl,
}

/// A name and its type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Declaration {
    /// Name.
    pub name: String,
    /// Type.
    pub ty: Type,
    /// `layout(location = ..)` of a uniform outside of blocks, where the author gave it (OpenGL 4.3).
    pub location: Option<u32>,
}

/// A block, a texture, a combined sampler or an image that its author has numbered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Numbered {
    /// Where it is bound in the IR; of a combined sampler its texture.
    pub binding: ResourceBinding,
    /// `layout(binding = ..)`; of an array's element the array's and the element's own.
    pub number: u32,
}

/// A type as GLSL has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Type {
    /// A scalar, vector or matrix, by GLSL's name.
    Plain(String),
    /// A texture with its sampler, by GLSL's name: `sampler2D`, `usamplerCube`, `sampler2DShadow`.
    Sampler(String),
    /// An array of so many.
    Array(Box<Type>, u32),
    /// A struct: its name and its members.
    Struct(String, Vec<Declaration>),
}

/// A texture and a sampler that the author's text has as one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CombinedSampler {
    /// How the text names it: `map`, `maps[2]`, `material.diffuse`.
    pub path: String,
    /// The texture in the IR.
    pub texture: ResourceBinding,
    /// The sampler in the IR.
    pub sampler: ResourceBinding,
}

/// A uniform or storage block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// Where it is bound.
    pub binding: ResourceBinding,
    /// The block's name.
    pub name: String,
    /// The instance's name; without one, the members' names are global.
    pub instance: Option<String>,
}

/// An input of the vertex stage, or an output of the fragment stage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Located {
    /// Name and type.
    pub declaration: Declaration,
    /// Its first location in the IR.
    pub location: u32,
    /// Who chose that.
    pub chosen: Chosen,
}

/// Who chose a location.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chosen {
    /// The author, in the text.
    ByAuthor,
    /// We did: the author's host asks for it, or sets it, by name.
    ByUs,
}

impl Type {
    /// What is not an array.
    pub fn innermost(&self) -> &Self {
        match self {
            Self::Array(of, _) => of.innermost(),
            other => other,
        }
    }

    /// The lengths of an array in brackets, outermost first; nothing for any other type.
    pub fn dimensions(&self) -> String {
        match self {
            Self::Array(of, n) => format!("[{n}]{}", of.dimensions()),
            _ => String::new(),
        }
    }

    /// Whether there are samplers in it.
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
