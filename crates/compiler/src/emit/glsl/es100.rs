//! Converts GLSL ES 3.00 to GLSL ES 1.00 for WebGL 1, on the syntax tree.
//!
//! | ES 3.00 | ES 1.00 |
//! |---|---|
//! | `in`, `out` | `attribute`, `varying`, `gl_FragColor`, `gl_FragData[n]`; what the output lacks of four components is 0, and alpha 1 |
//! | `texture`, `textureLod`, `textureGrad` | `texture2D`, `textureCube` and their variants |
//! | `texelFetch(map, pixel, 0)` of a texture without a sampler | `texture2D(map, (vec2(pixel) + 0.5) / map_size)`, with a uniform `map_size` |
//! | `while (true)` with a counter | `for` with a constant bound; indices use its variable |
//! | `float[3](..)`, whole-array assignment | element by element |
//!
//! WebGL 1 only guarantees appendix A of the language. Anything else is an error that names the
//! feature: unsigned integers, bit operators, `switch`, blocks, other texture types, flat varyings,
//! loops without a constant bound, and non-constant indices in a fragment stage.

mod expression;
mod loop_bounds;
mod statement;
mod types;

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use glsl_lang::ast;
use glsl_lang::transpiler::glsl::{FormattingState, show_external_declaration};
use naga::ShaderStage;

use crate::front;
use preshade_plan::plan_file::StageFile;

/// A feature that GLSL ES 1.00 lacks.
#[derive(Debug)]
pub(super) struct Lacks(pub String);

type Result<T> = std::result::Result<T, Lacks>;

fn lacks<T>(what: impl Into<String>) -> Result<T> {
    Err(Lacks(what.into()))
}

/// Converts one stage, and adds new uniforms to `stage_file`. `es300` is text that this crate
/// wrote.
pub(super) fn rewritten(
    es300: &str,
    stage: ShaderStage,
    mut stage_file: StageFile,
) -> Result<(String, StageFile)> {
    let tree = front::glsl_tree(es300, stage)
        .map_err(|e| Lacks(format!("a text that does not parse ({e})")))?;
    let fetched = stage_file.textures.iter().filter(|t| t.sampler.is_none());
    let mut rewrite = Es100 {
        stage,
        fetched: fetched.map(|t| t.name.clone()).collect(),
        ..Es100::default()
    };
    rewrite.outputs_of(&tree)?;
    let mut declarations = Vec::new();
    for declaration in tree.0 {
        declarations.extend(rewrite.external(declaration)?);
    }
    let mut body = String::new();
    let mut state = FormattingState::default();
    for declaration in &declarations {
        show_external_declaration(&mut body, declaration, &mut state)
            .map_err(|e| Lacks(format!("a text that cannot be printed ({e})")))?;
    }
    let mut text = "#version 100\n".to_owned();
    for extension in &rewrite.extensions {
        text += &format!("#extension {extension} : require\n");
    }
    for size in rewrite.sizes.values() {
        text += &format!("uniform highp vec2 {size};\n");
    }
    text += body.trim_end();
    text.push('\n');
    for texture in &mut stage_file.textures {
        texture.size = rewrite.sizes.get(&texture.name).cloned();
    }
    for attribute in &mut stage_file.attributes {
        // The language has no `layout`: a host binds the location by name.
        attribute.explicit = false;
    }
    Ok((text, stage_file))
}

/// The texture type of a sampler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sampler {
    Two,
    Cube,
}

/// Information from the text so far. Locals have unique names in a function; later declarations
/// replace earlier ones.
struct Es100 {
    stage: ShaderStage,
    /// Textures that the program reads without a sampler.
    fetched: HashSet<String>,
    /// New names of fragment outputs, with the components that are written.
    outputs: HashMap<String, (ast::ExprData, usize)>,
    samplers: HashMap<String, Sampler>,
    /// Variables, members and functions of type `int`.
    integers: HashSet<String>,
    /// The same for `bool`.
    booleans: HashSet<String>,
    /// Global constants that are numbers.
    constants: HashMap<String, loop_bounds::Number>,
    /// Lengths of arrays, by name.
    arrays: HashMap<String, i32>,
    /// Structs that contain arrays.
    holds_arrays: HashSet<String>,
    /// User functions with the parameters that they write.
    functions: HashMap<String, HashSet<usize>>,
    extensions: BTreeSet<&'static str>,
    /// Size uniforms by texture.
    sizes: BTreeMap<String, String>,
    names: HashSet<String>,
    /// Number of bounded loops so far.
    loops: usize,
    /// How often the current code can run.
    entered: loop_bounds::Entered,
    /// Variables made only of constants and loop counters, as expressions of these.
    indices: HashMap<String, ast::Expr>,
}

impl Default for Es100 {
    fn default() -> Self {
        Self {
            stage: ShaderStage::Fragment,
            fetched: HashSet::new(),
            outputs: HashMap::new(),
            samplers: HashMap::new(),
            integers: HashSet::new(),
            booleans: HashSet::new(),
            constants: HashMap::new(),
            arrays: HashMap::new(),
            holds_arrays: HashSet::new(),
            functions: HashMap::new(),
            extensions: BTreeSet::new(),
            sizes: BTreeMap::new(),
            names: HashSet::new(),
            loops: 0,
            entered: loop_bounds::Entered::Once,
            indices: HashMap::new(),
        }
    }
}

impl Es100 {
    /// Names fragment outputs: a single one at location 0 is `gl_FragColor`.
    fn outputs_of(&mut self, tree: &ast::TranslationUnit) -> Result<()> {
        let mut found: Vec<(String, i32, usize)> = Vec::new();
        for declaration in &tree.0 {
            let ast::ExternalDeclarationData::Declaration(declaration) = &**declaration else {
                continue;
            };
            let ast::DeclarationData::InitDeclaratorList(list) = &**declaration else {
                continue;
            };
            let head = &list.head;
            self.names
                .extend(head.name.iter().map(|n| n.as_str().to_owned()));
            if self.stage != ShaderStage::Fragment || !types::is_output(&head.ty) {
                continue;
            }
            let name = head.name.as_ref().map_or("", |n| n.as_str());
            let components = types::components(&head.ty.ty);
            let components = components.filter(|_| head.array_specifier.is_none());
            let Some(components) = components else {
                return lacks(format!("the output `{name}`, which is no vector of floats"));
            };
            let location = types::location(&head.ty).unwrap_or(0);
            found.push((name.to_owned(), location, components));
        }
        let alone = matches!(found[..], [(_, 0, _)]);
        for (name, location, components) in found {
            let builtin = |name: &str| ast::ExprData::variable(name);
            let expression = match alone {
                true => builtin("gl_FragColor"),
                false => {
                    self.extensions.insert("GL_EXT_draw_buffers");
                    let data = Box::new(builtin("gl_FragData").into());
                    let index = Box::new(ast::ExprData::IntConst(location).into());
                    ast::ExprData::Bracket(data, index)
                }
            };
            self.outputs.insert(name, (expression, components));
        }
        Ok(())
    }

    fn external(
        &mut self,
        mut declaration: ast::ExternalDeclaration,
    ) -> Result<Option<ast::ExternalDeclaration>> {
        match &mut *declaration {
            ast::ExternalDeclarationData::Preprocessor(_) => return Ok(None),
            ast::ExternalDeclarationData::FunctionDefinition(function) => {
                self.function(function)?;
            }
            ast::ExternalDeclarationData::Declaration(inner) => match &mut **inner {
                ast::DeclarationData::Precision(..) | ast::DeclarationData::Invariant(_) => {}
                ast::DeclarationData::FunctionPrototype(prototype) => self.prototype(prototype)?,
                ast::DeclarationData::Block(block) => {
                    return lacks(format!("the block `{}`", block.name.as_str()));
                }
                ast::DeclarationData::TypeOnly(_) => return lacks("a layout of the whole stage"),
                ast::DeclarationData::InitDeclaratorList(list) => {
                    return match self.global(list)? {
                        true => Ok(Some(declaration)),
                        false => Ok(None),
                    };
                }
            },
        }
        Ok(Some(declaration))
    }

    /// Converts a global declaration; returns false if nothing remains.
    fn global(&mut self, list: &mut ast::InitDeclaratorList) -> Result<bool> {
        let name = list.head.name.as_ref().map(|n| n.as_str().to_owned());
        let name = name.unwrap_or_default();
        if self.outputs.contains_key(&name) {
            return Ok(false);
        }
        if let ast::TypeSpecifierNonArrayData::Struct(of) = &mut *list.head.ty.ty.ty {
            self.structure(of)?;
        }
        let head: &mut ast::SingleDeclarationData = &mut list.head;
        if types::is_constant(&head.ty)
            && let Some(initial) = &head.initializer
            && let ast::InitializerData::Simple(value) = &**initial
            && let Some(number) = loop_bounds::Number::of(value)
        {
            self.constants.insert(name.clone(), number);
        }
        types::qualify(&mut head.ty, self.stage, &name)?;
        self.declare(&mut head.ty, &name, head.array_specifier.as_ref())?;
        if let Some(initial) = &mut head.initializer {
            self.initializer(initial, &name)?;
        }
        Ok(true)
    }

    fn structure(&mut self, of: &mut ast::StructSpecifier) -> Result<()> {
        let of: &mut ast::StructSpecifierData = of;
        for field in &mut of.fields {
            types::plain(&mut field.ty)?;
            for one in &field.identifiers {
                self.note(&field.ty, one.ident.as_str());
                let is_array = one.array_spec.is_some();
                if is_array && let Some(name) = &of.name {
                    self.holds_arrays.insert(name.as_str().to_owned());
                }
            }
        }
        Ok(())
    }

    fn prototype(&mut self, prototype: &mut ast::FunctionPrototype) -> Result<()> {
        let name = prototype.name.as_str().to_owned();
        types::plain(&mut prototype.ty.ty)?;
        if prototype.ty.ty.array_specifier.is_some() {
            return lacks(format!("an array as the result of `{name}`"));
        }
        self.note(&prototype.ty.ty, &name);
        let mut written = HashSet::new();
        for (i, parameter) in prototype.parameters.iter_mut().enumerate() {
            let (qualifier, ty) = match &mut **parameter {
                ast::FunctionParameterDeclarationData::Named(qualifier, declarator) => {
                    let declarator = &mut **declarator;
                    let of = declarator.ident.ident.as_str();
                    self.names.insert(of.to_owned());
                    self.note(&declarator.ty, of);
                    match types::length(declarator.ident.array_spec.as_ref())? {
                        Some(n) => self.arrays.insert(of.to_owned(), n),
                        None => self.arrays.remove(of),
                    };
                    (qualifier, &mut declarator.ty)
                }
                ast::FunctionParameterDeclarationData::Unnamed(qualifier, ty) => (qualifier, ty),
            };
            types::plain(ty)?;
            let writes = |q: &ast::TypeQualifierSpec| {
                matches!(&**q, ast::TypeQualifierSpecData::Storage(s)
                    if matches!(**s, ast::StorageQualifierData::Out | ast::StorageQualifierData::InOut))
            };
            if qualifier.iter().flat_map(|q| &q.qualifiers).any(writes) {
                written.insert(i);
            }
        }
        self.functions.insert(name, written);
        Ok(())
    }

    fn function(&mut self, function: &mut ast::FunctionDefinition) -> Result<()> {
        let outside = (
            self.arrays.clone(),
            self.integers.clone(),
            self.booleans.clone(),
        );
        self.prototype(&mut function.prototype)?;
        let name = function.prototype.name.as_str().to_owned();
        let body = std::mem::take(&mut function.statement.statement_list);
        let body = self.statements(body);
        let body = body.map_err(|Lacks(what)| Lacks(format!("{what}, in `{name}`")))?;
        function.statement.statement_list = body;
        let result = (self.integers.contains(&name), self.booleans.contains(&name));
        (self.arrays, self.integers, self.booleans) = outside;
        if result.0 {
            self.integers.insert(name.clone());
        }
        if result.1 {
            self.booleans.insert(name);
        }
        Ok(())
    }

    /// Records a variable and converts its type.
    fn declare(
        &mut self,
        ty: &mut ast::FullySpecifiedType,
        name: &str,
        array: Option<&ast::ArraySpecifier>,
    ) -> Result<()> {
        types::plain(&mut ty.ty)?;
        self.names.insert(name.to_owned());
        self.note(&ty.ty, name);
        match types::length(array)? {
            Some(n) => self.arrays.insert(name.to_owned(), n),
            None => self.arrays.remove(name),
        };
        Ok(())
    }

    fn note(&mut self, ty: &ast::TypeSpecifier, name: &str) {
        use ast::TypeSpecifierNonArrayData as T;
        let set = |of: &mut HashSet<String>, is: bool| match is {
            true => of.insert(name.to_owned()),
            false => of.remove(name),
        };
        let ty = &*ty.ty;
        set(
            &mut self.integers,
            matches!(ty, T::Int | T::IVec2 | T::IVec3 | T::IVec4),
        );
        set(
            &mut self.booleans,
            matches!(ty, T::Bool | T::BVec2 | T::BVec3 | T::BVec4),
        );
        let sampler = match ty {
            T::Sampler2D => Some(Sampler::Two),
            T::SamplerCube => Some(Sampler::Cube),
            _ => None,
        };
        if let Some(sampler) = sampler {
            self.samplers.insert(name.to_owned(), sampler);
        }
    }
}
