//! What one stage declares outside of its functions, sorted by what becomes of it.

use std::collections::{HashMap, HashSet};

use glsl_lang::ast::{
    self, ArraySpecifierDimensionData, DeclarationData, ExprData, ExternalDeclarationData,
    InterpolationQualifierData, LayoutQualifierSpecData, NodeSpan, StorageQualifierData,
    TypeQualifierSpecData, TypeSpecifierNonArray, TypeSpecifierNonArrayData,
};
use glsl_lang::transpiler::glsl::{FormattingState, show_type_specifier_non_array};
use glsl_lang::visitor::{Host as _, Visit, Visitor};
use naga::{ShaderStage, Span};

use super::constant::{self, Constants};
use super::syntax::Unit;
use super::ty::{Member, Rules, Struct, Structs, Ty};
use super::writes as writers;
use crate::front::error::{Code, Error};

/// Where a variable lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Storage {
    Const,
    In,
    Out,
    InOut,
    Uniform,
    Buffer,
}

/// What stands before a type.
#[derive(Clone, Debug, Default)]
pub(super) struct Qualifiers {
    pub storage: Option<Storage>,
    pub layout: Vec<(String, Option<i64>)>,
    /// `flat` or `noperspective`.
    pub interpolation: Option<&'static str>,
    /// `centroid` or `sample`.
    pub sampling: Option<&'static str>,
    pub invariant: bool,
    pub precise: bool,
    /// `readonly` and its like, as they are.
    pub memory: Vec<&'static str>,
}

impl Qualifiers {
    /// The number that the layout gives to `key`.
    pub(super) fn number(&self, key: &str) -> Option<u32> {
        let found = self.layout.iter().find(|(k, _)| k == key)?;
        found.1.and_then(|n| u32::try_from(n).ok())
    }

    pub(super) fn says(&self, key: &str) -> bool {
        self.layout.iter().any(|(k, _)| k == key)
    }
}

/// A variable of the stage's interface, or a loose uniform.
#[derive(Clone, Debug)]
pub(super) struct Variable {
    pub name: String,
    pub ty: Ty,
    pub qualifiers: Qualifiers,
    pub place: Option<Span>,
    /// The interface block it is a member of, and the block's instance.
    pub block: Option<(String, Option<String>)>,
}

impl Variable {
    /// What the two stages agree on.
    pub(super) fn key(&self) -> String {
        match &self.block {
            Some((block, _)) => format!("{block}.{}", self.name),
            None => self.name.clone(),
        }
    }

    /// What it is called in the rewritten text.
    pub(super) fn emitted(&self) -> String {
        match &self.block {
            Some((_, Some(instance))) => format!("{instance}_{}", self.name),
            _ => self.name.clone(),
        }
    }
}

/// An initial value that is one expression.
pub(super) fn simple(init: &ast::Initializer) -> Option<&ast::Expr> {
    match &init.content {
        ast::InitializerData::Simple(e) => Some(e),
        _ => None,
    }
}

/// A uniform or storage block, or one of push constants.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub name: String,
    pub instance: Option<String>,
    pub members: Vec<Member>,
    pub qualifiers: Qualifiers,
    pub place: Option<Span>,
}

impl Block {
    /// How its members are laid out. A storage block that says nothing is one of std430, as in Vulkan; naga knows no other layouts.
    pub(super) fn rules(&self) -> Rules {
        rules(&self.qualifiers)
    }
}

fn rules(block: &Qualifiers) -> Rules {
    let storage = block.storage == Some(Storage::Buffer);
    match block.says("push_constant") || storage && !block.says("std140") {
        true => Rules::Std430,
        false => Rules::Std140,
    }
}

/// A global variable or constant of the author's own.
pub(super) struct Global<'u> {
    pub name: &'u ast::Identifier,
    pub ty: Ty,
    pub qualifiers: Qualifiers,
    pub init: Option<&'u ast::Initializer>,
    pub place: Option<Span>,
}

/// Most elements of what is told apart one by one: varyings, and what holds samplers.
const APART: u64 = 1 << 10;
/// Most members of a struct, those of structs in it counted with them.
const MEMBERS: u64 = 1 << 12;

/// What a call must know of a function.
#[derive(Clone, Debug)]
pub(super) struct Signature {
    pub parameters: Vec<(Storage, Ty)>,
    pub result: Ty,
}

/// One stage, sorted.
pub(super) struct Stage<'u> {
    pub unit: &'u Unit,
    pub kind: ShaderStage,
    pub structs: Structs,
    pub constants: Constants,
    pub uniforms: Vec<Variable>,
    /// Textures, samplers and images that are apart.
    pub opaque: Vec<Variable>,
    pub blocks: Vec<Block>,
    pub inputs: Vec<Variable>,
    pub outputs: Vec<Variable>,
    pub globals: Vec<Global<'u>>,
    /// Those that `main` reaches, each after what it calls.
    pub functions: Vec<&'u ast::FunctionDefinition>,
    pub signatures: HashMap<String, Vec<Signature>>,
    /// Functions that write what is not their own.
    pub writers: HashSet<String>,
    /// Names that what `main` reaches uses.
    pub used: HashSet<String>,
    /// The position is declared `invariant`, or something is `precise`.
    pub invariant: bool,
    pub early_fragment_tests: bool,
    /// How blocks lie that do not say it: `layout(row_major) uniform;`, `layout(std140) buffer;`.
    defaults: [OfBlocks; 2],
    /// `gl_FragCoord` counts from the top.
    pub origin_upper_left: bool,
}

/// What `layout(..) uniform;` or `layout(..) buffer;` says of the blocks behind it, each of its own kind (GLSL 4.60, 4.4.5).
#[derive(Clone, Copy, Debug, Default)]
struct OfBlocks {
    row_major: bool,
    rules: Option<&'static str>,
}

/// Which of the defaults is meant: that of uniform blocks or that of storage blocks.
fn of_blocks(q: &Qualifiers) -> Option<usize> {
    match q.storage {
        Some(Storage::Uniform) => Some(0),
        Some(Storage::Buffer) => Some(1),
        _ => None,
    }
}

/// A type's name as it is written, `struct` for one that is defined in place.
pub(super) fn spelled(ty: &TypeSpecifierNonArray) -> String {
    match &ty.content {
        TypeSpecifierNonArrayData::TypeName(name) => name.as_str().to_owned(),
        TypeSpecifierNonArrayData::Struct(_) => "struct".to_owned(),
        _ => {
            let mut name = String::new();
            let shown =
                show_type_specifier_non_array(&mut name, ty, &mut FormattingState::default());
            debug_assert!(shown.is_ok());
            name
        }
    }
}

/// An error of something that is not read, at its place.
pub(super) fn unsupported(what: impl Into<String>, place: Option<Span>) -> Error {
    Error::new(Code::Unsupported, what).label_if(place)
}

impl<'u> Stage<'u> {
    pub(super) fn collect(unit: &'u Unit, kind: ShaderStage) -> Result<Self, Error> {
        let mut stage = Self {
            unit,
            kind,
            structs: Structs::default(),
            constants: Constants::new(),
            uniforms: Vec::new(),
            opaque: Vec::new(),
            blocks: Vec::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            globals: Vec::new(),
            functions: Vec::new(),
            signatures: HashMap::new(),
            writers: HashSet::new(),
            used: HashSet::new(),
            invariant: unit.invariant_all,
            early_fragment_tests: false,
            defaults: [OfBlocks::default(); 2],
            origin_upper_left: false,
        };
        let mut definitions = Vec::new();
        for item in &unit.tree.0 {
            match &item.content {
                ExternalDeclarationData::Preprocessor(_) => {}
                ExternalDeclarationData::Declaration(d) => stage.declaration(d)?,
                ExternalDeclarationData::FunctionDefinition(f) => {
                    stage.prototype(&f.prototype)?;
                    definitions.push(f);
                }
            }
        }
        stage.reach(&definitions)?;
        Ok(stage)
    }

    fn place(&self, span: Option<NodeSpan>) -> Option<Span> {
        self.unit.place(span)
    }

    fn declaration(&mut self, declaration: &'u ast::Declaration) -> Result<(), Error> {
        let place = self.place(declaration.span);
        match &declaration.content {
            DeclarationData::FunctionPrototype(p) => self.prototype(p),
            DeclarationData::Precision(..) => Ok(()),
            DeclarationData::Invariant(name) => {
                self.invariant |= name.as_str() == "gl_Position";
                Ok(())
            }
            DeclarationData::TypeOnly(qualifier) => {
                let q = self.qualifiers(Some(qualifier))?;
                self.early_fragment_tests |= q.says("early_fragment_tests");
                self.invariant |= q.precise;
                // For the blocks that follow.
                if let Some(default) = of_blocks(&q).map(|i| &mut self.defaults[i]) {
                    if q.says("row_major") || q.says("column_major") {
                        default.row_major = q.says("row_major");
                    }
                    let rules = ["std140", "std430"].into_iter().find(|r| q.says(r));
                    default.rules = rules.or(default.rules);
                }
                let tessellation = [
                    "vertices",
                    "triangles",
                    "quads",
                    "isolines",
                    "max_vertices",
                    "local_size_x",
                ];
                if let Some(word) = tessellation.iter().find(|w| q.says(w)) {
                    return Err(unsupported(
                        format!(
                            "`layout({word})` belongs to a stage that a material does not have"
                        ),
                        place,
                    ));
                }
                Ok(())
            }
            DeclarationData::Block(block) => self.block(block),
            DeclarationData::InitDeclaratorList(list) => {
                let head = &list.head;
                let qualifiers = self.qualifiers(head.ty.qualifier.as_ref())?;
                let ty = self.ty(&head.ty.ty, None, place)?;
                let Some(name) = &head.name else {
                    return Ok(());
                };
                let first = self.dimensions(ty.clone(), head.array_specifier.as_ref(), place)?;
                self.variable(name, first, &qualifiers, head.initializer.as_ref(), place)?;
                for other in &list.tail {
                    let place = self.place(other.span);
                    let array = other.ident.array_spec.as_ref();
                    let ty = self.dimensions(ty.clone(), array, place)?;
                    let init = other.initializer.as_ref();
                    self.variable(&other.ident.ident, ty, &qualifiers, init, place)?;
                }
                Ok(())
            }
        }
    }

    fn variable(
        &mut self,
        name: &'u ast::Identifier,
        mut ty: Ty,
        qualifiers: &Qualifiers,
        init: Option<&'u ast::Initializer>,
        place: Option<Span>,
    ) -> Result<(), Error> {
        if let (Ty::Array(of, None), Some(init)) = (&ty, init) {
            ty = Ty::Array(of.clone(), initial_length(init));
        }
        let text = name.as_str().to_owned();
        if text.starts_with("gl_") {
            // A redeclaration: what it adds is `invariant`, or where `gl_FragCoord` counts from.
            self.invariant |= text == "gl_Position" && (qualifiers.invariant || qualifiers.precise);
            self.origin_upper_left |= qualifiers.says("origin_upper_left");
            if qualifiers.says("pixel_center_integer") {
                return Err(unsupported(
                    "`pixel_center_integer` is not read: the centres of WebGPU's pixels lie at halves",
                    place,
                )
                .note("leave it out, and take 0.5 off where `gl_FragCoord` is read"));
            }
            return Ok(());
        }
        self.invariant |= qualifiers.precise;
        let variable = Variable {
            name: text.clone(),
            ty: ty.clone(),
            qualifiers: qualifiers.clone(),
            place,
            block: None,
        };
        let is_apart = match qualifiers.storage {
            Some(Storage::In | Storage::Out) => true,
            Some(Storage::Uniform) => self.structs.has_samplers(&ty),
            _ => false,
        };
        if is_apart {
            self.check_elements(&ty, APART, place)?;
        }
        let fixed = qualifiers.storage == Some(Storage::Const) && !qualifiers.says("constant_id");
        let value = init.filter(|_| fixed).and_then(simple);
        constant::declare(&mut self.constants, &text, &ty, value);
        match qualifiers.storage {
            Some(Storage::In) => self.inputs.push(variable),
            Some(Storage::Out) => self.outputs.push(variable),
            Some(Storage::Uniform | Storage::Buffer) => match ty.innermost() {
                Ty::Opaque(_) => self.opaque.push(variable),
                _ => {
                    // Written twice it is one.
                    if !self.uniforms.iter().any(|u| u.name == text) {
                        self.uniforms.push(variable);
                    }
                }
            },
            Some(Storage::Const | Storage::InOut) | None => {
                self.globals.push(Global {
                    name,
                    ty,
                    qualifiers: qualifiers.clone(),
                    init,
                    place,
                });
            }
        }
        Ok(())
    }

    fn block(&mut self, block: &'u ast::Block) -> Result<(), Error> {
        let place = self.place(block.span);
        let mut qualifiers = self.qualifiers(Some(&block.qualifier))?;
        let default = of_blocks(&qualifiers).map(|i| self.defaults[i]);
        let default = default.unwrap_or_default();
        let rules_said = ["std140", "std430", "shared", "packed", "push_constant"];
        if let (Some(rules), false) = (default.rules, rules_said.iter().any(|r| qualifiers.says(r)))
        {
            qualifiers.layout.push((rules.to_owned(), None));
        }
        let name = block.name.as_str().to_owned();
        if name == "gl_PerVertex" {
            return Ok(());
        }
        let instance = block
            .identifier
            .as_ref()
            .map(|i| i.ident.as_str().to_owned());
        if block
            .identifier
            .as_ref()
            .is_some_and(|i| i.array_spec.is_some())
        {
            return Err(unsupported(
                format!("`{name}` is an array of blocks, which WebGPU has no bindings for"),
                place,
            ));
        }
        let row_major = match qualifiers.says("column_major") {
            true => false,
            false => default.row_major || qualifiers.says("row_major"),
        };
        let mut members = Vec::new();
        let mut member_qualifiers = Vec::new();
        for field in &block.fields {
            let q = self.qualifiers(field.qualifier.as_ref())?;
            for (name, ty, place) in self.fields(field)? {
                members.push(Member {
                    name,
                    ty,
                    row_major: (row_major || q.says("row_major")) && !q.says("column_major"),
                    place,
                });
                member_qualifiers.push(q.clone());
            }
        }
        if let Some(Storage::In | Storage::Out) = qualifiers.storage {
            for member in &members {
                self.check_elements(&member.ty, APART, member.place)?;
            }
        }
        let direction = match qualifiers.storage {
            Some(Storage::In) => Some(&mut self.inputs),
            Some(Storage::Out) => Some(&mut self.outputs),
            _ => None,
        };
        if let Some(list) = direction {
            let mut next = qualifiers.number("location");
            for (member, own) in members.into_iter().zip(member_qualifiers) {
                let mut q = qualifiers.clone();
                q.interpolation = own.interpolation.or(q.interpolation);
                q.sampling = own.sampling.or(q.sampling);
                q.layout = own.layout;
                if let (Some(n), None) = (next, q.number("location")) {
                    q.layout.push(("location".to_owned(), Some(i64::from(n))));
                }
                let mut leaves = Vec::new();
                self.structs.leaves(&member.ty, "", &mut leaves);
                let length = leaves.len() as u32;
                next = q.number("location").map(|n| n.saturating_add(length));
                list.push(Variable {
                    name: member.name,
                    ty: member.ty,
                    qualifiers: q,
                    place: member.place,
                    block: Some((name.clone(), instance.clone())),
                });
            }
            return Ok(());
        }
        let tight = rules(&qualifiers) == Rules::Std430;
        self.refuse_offsets(&members, &member_qualifiers, tight)?;
        self.blocks.push(Block {
            name,
            instance,
            members,
            qualifiers,
            place,
        });
        Ok(())
    }

    /// Refuses offsets that the members do not have without saying so: naga knows no others.
    fn refuse_offsets(
        &self,
        members: &[Member],
        qualifiers: &[Qualifiers],
        tight: bool,
    ) -> Result<(), Error> {
        let mut end = 0u32;
        for (member, own) in members.iter().zip(qualifiers) {
            let (align, size) = match tight {
                true => self.structs.std430_by(&member.ty, member.row_major),
                false => self.structs.std140_by(&member.ty, member.row_major),
            };
            let at = end.next_multiple_of(align);
            let asked = own.number("offset").unwrap_or(at);
            if asked != at || own.number("align").is_some_and(|n| at % n.max(1) != 0) {
                return Err(unsupported(
                    format!(
                        "`{}` is asked to lie elsewhere than at byte {at}, where it comes without being asked",
                        member.name
                    ),
                    member.place,
                )
                .note("put members in their order, with others to fill what is left between"));
            }
            // No buffer is as large; what is, the validator refuses.
            end = at.saturating_add(size).min(1 << 31);
        }
        Ok(())
    }

    fn fields(
        &mut self,
        field: &ast::StructFieldSpecifier,
    ) -> Result<Vec<(String, Ty, Option<Span>)>, Error> {
        let place = self.place(field.span);
        let ty = self.ty(&field.ty, None, place)?;
        field
            .identifiers
            .iter()
            .map(|i| {
                let ty = self.dimensions(ty.clone(), i.array_spec.as_ref(), place)?;
                Ok((i.ident.as_str().to_owned(), ty, place))
            })
            .collect()
    }

    fn prototype(&mut self, prototype: &ast::FunctionPrototype) -> Result<(), Error> {
        let signature = self.signature(prototype)?;
        let all = self.signatures.entry(prototype.name.as_str().to_owned());
        let all = all.or_default();
        if !all.iter().any(|s| {
            s.parameters.len() == signature.parameters.len()
                && s.parameters
                    .iter()
                    .zip(&signature.parameters)
                    .all(|(a, b)| a.1 == b.1)
        }) {
            all.push(signature);
        }
        Ok(())
    }

    /// The parameters, `void` for none left out.
    pub(super) fn signature(
        &mut self,
        prototype: &ast::FunctionPrototype,
    ) -> Result<Signature, Error> {
        use ast::FunctionParameterDeclarationData as P;
        let result = self.ty(&prototype.ty.ty, None, self.place(prototype.span))?;
        let mut parameters = Vec::new();
        for parameter in &prototype.parameters {
            let place = self.place(parameter.span);
            let (qualifier, ty) = match &parameter.content {
                P::Named(q, d) => {
                    let ty = self.ty(&d.ty, d.ident.array_spec.as_ref(), place)?;
                    (q, ty)
                }
                P::Unnamed(q, ty) => (q, self.ty(ty, None, place)?),
            };
            if ty == Ty::Void {
                continue;
            }
            let storage = self.qualifiers(qualifier.as_ref())?.storage;
            let storage = match storage {
                Some(s @ (Storage::Out | Storage::InOut)) => s,
                _ => Storage::In,
            };
            parameters.push((storage, ty));
        }
        Ok(Signature { parameters, result })
    }

    /// The type that `spec` names, with the dimensions that stand at the variable's name.
    pub(super) fn ty(
        &mut self,
        spec: &ast::TypeSpecifier,
        at_name: Option<&ast::ArraySpecifier>,
        place: Option<Span>,
    ) -> Result<Ty, Error> {
        let base = match &spec.ty.content {
            TypeSpecifierNonArrayData::TypeName(name) => Ty::Struct(name.as_str().to_owned()),
            TypeSpecifierNonArrayData::Struct(definition) => {
                let name = match &definition.name {
                    Some(name) => name.as_str().to_owned(),
                    None => String::new(),
                };
                let mut members = Vec::new();
                for field in &definition.fields {
                    for (name, ty, place) in self.fields(field)? {
                        members.push(Member {
                            name,
                            ty,
                            row_major: false,
                            place,
                        });
                    }
                }
                let name = match name.is_empty() {
                    true => self.unnamed(&members),
                    false => name,
                };
                let count = self.structs.count_of(members.iter().map(|m| &m.ty));
                if count.members > MEMBERS || count.elements > self.unit.array_elements {
                    return Err(Error::new(
                        Code::TooDeep,
                        format!(
                            "`{name}` holds {} elements in {} members; at most {} in {MEMBERS} are read",
                            count.elements, count.members, self.unit.array_elements
                        ),
                    )
                    .label_if(place));
                }
                if let Some(old) = self.structs.get(&name) {
                    let same = |a: &Member, b: &Member| a.name == b.name && a.ty == b.ty;
                    let alike = old.members.len() == members.len()
                        && old.members.iter().zip(&members).all(|(a, b)| same(a, b));
                    if !alike {
                        return Err(unsupported(
                            format!("two structs are called `{name}`"),
                            place,
                        ));
                    }
                } else {
                    self.structs.insert(Struct {
                        name: name.clone(),
                        members,
                        hosted: false,
                        tight: false,
                    });
                    self.structs.host_small();
                }
                Ty::Struct(name)
            }
            _ => Ty::named(&spelled(&spec.ty)),
        };
        let inner = self.dimensions(base, spec.array_specifier.as_ref(), place)?;
        self.dimensions(inner, at_name, place)
    }

    /// A name for a struct without one, by what it holds: that of the other stage is another where it holds something else.
    fn unnamed(&self, members: &[Member]) -> String {
        let mut name = "Unnamed".to_owned();
        for member in members {
            let word = member.name.trim_matches('_');
            if name.len() + word.len() < 60 && !word.contains("__") {
                name += "_";
                name += word;
            }
        }
        let taken = |name: &str| {
            let same = |a: &Member, b: &Member| a.name == b.name && a.ty == b.ty;
            let old = self.structs.get(name);
            old.is_some_and(|old| {
                old.members.len() != members.len()
                    || old.members.iter().zip(members).any(|(a, b)| !same(a, b))
            })
        };
        let numbered = (2..).map(|i| format!("{name}_{i}"));
        let mut all = std::iter::once(name.clone()).chain(numbered);
        all.find(|n| !taken(n)).unwrap_or(name)
    }

    pub(super) fn dimensions(
        &self,
        of: Ty,
        array: Option<&ast::ArraySpecifier>,
        place: Option<Span>,
    ) -> Result<Ty, Error> {
        let Some(array) = array else {
            return Ok(of);
        };
        let mut ty = of;
        for dimension in array.dimensions.iter().rev() {
            let length = match &dimension.content {
                ArraySpecifierDimensionData::Unsized => None,
                ArraySpecifierDimensionData::ExplicitlySized(e) => {
                    let n = constant::evaluate(e, &self.constants);
                    let n = n.and_then(|n| u32::try_from(n).ok()).filter(|n| *n > 0);
                    let n = n.ok_or_else(|| {
                        unsupported("the length of this array is not an integer constant above 0 that is known here", place)
                    })?;
                    Some(n)
                }
            };
            ty = Ty::Array(Box::new(ty), length);
            // Samplers are told apart one by one, and others may have to be.
            let most = match ty.innermost() {
                Ty::Combined(_) | Ty::Opaque(_) => APART,
                _ => self.unit.array_elements,
            };
            self.check_elements(&ty, most, place)?;
        }
        Ok(ty)
    }

    /// Refuses a type of more elements than `most`.
    fn check_elements(&self, ty: &Ty, most: u64, place: Option<Span>) -> Result<(), Error> {
        let n = self.structs.count(ty).elements;
        match n > most {
            false => Ok(()),
            true => Err(Error::new(
                Code::TooDeep,
                format!("an array of {n} elements, more than {most}, is not read"),
            )
            .label_if(place)),
        }
    }

    pub(super) fn qualifiers(
        &self,
        qualifier: Option<&ast::TypeQualifier>,
    ) -> Result<Qualifiers, Error> {
        use StorageQualifierData as S;
        let mut out = Qualifiers::default();
        let vertex = self.kind == ShaderStage::Vertex;
        for spec in qualifier.iter().flat_map(|q| &q.qualifiers) {
            let place = self.place(spec.span);
            match &spec.content {
                TypeQualifierSpecData::Storage(s) => match &s.content {
                    S::Const => {
                        out.storage = out.storage.or(Some(Storage::Const));
                    }
                    S::InOut => out.storage = Some(Storage::InOut),
                    S::In | S::Attribute => out.storage = Some(Storage::In),
                    S::Out => out.storage = Some(Storage::Out),
                    S::Varying if vertex => out.storage = Some(Storage::Out),
                    S::Varying => out.storage = Some(Storage::In),
                    S::Uniform => out.storage = Some(Storage::Uniform),
                    S::Buffer => out.storage = Some(Storage::Buffer),
                    S::Centroid => out.sampling = Some("centroid"),
                    S::Sample => out.sampling = Some("sample"),
                    S::ReadOnly => out.memory.push("readonly"),
                    S::WriteOnly => out.memory.push("writeonly"),
                    // Hints that WebGPU has no words for, and that change no value.
                    S::Coherent | S::Volatile | S::Restrict => {}
                    S::Shared => {
                        return Err(unsupported(
                            "`shared` variables belong to compute shaders",
                            place,
                        ));
                    }
                    S::Patch => {
                        return Err(unsupported(
                            "`patch` variables belong to tessellation shaders",
                            place,
                        ));
                    }
                    S::Subroutine(_) => {
                        return Err(unsupported(
                            "subroutines are not read: WebGPU has none",
                            place,
                        ));
                    }
                },
                TypeQualifierSpecData::Layout(layout) => {
                    for id in &layout.ids {
                        if let LayoutQualifierSpecData::Identifier(name, value) = &id.content {
                            let value = match value {
                                Some(e) => {
                                    let n = constant::evaluate(e, &self.constants);
                                    if n.is_none() {
                                        return Err(unsupported(
                                            "a layout's number must be an integer constant",
                                            place,
                                        ));
                                    }
                                    n
                                }
                                None => None,
                            };
                            if name.as_str() == "component" && value != Some(0) {
                                return Err(unsupported(
                                    "`component` packs two variables into one location, which WebGPU cannot",
                                    place,
                                ));
                            }
                            out.layout.push((name.as_str().to_owned(), value));
                        }
                    }
                }
                TypeQualifierSpecData::Interpolation(i) => match i.content {
                    InterpolationQualifierData::Smooth => {}
                    InterpolationQualifierData::Flat => out.interpolation = Some("flat"),
                    InterpolationQualifierData::NoPerspective => {
                        out.interpolation = Some("noperspective");
                    }
                },
                TypeQualifierSpecData::Invariant => out.invariant = true,
                TypeQualifierSpecData::Precise => out.precise = true,
                TypeQualifierSpecData::Precision(_) => {}
            }
        }
        Ok(out)
    }

    /// Orders the functions that `main` reaches, each after what it calls, and notes what they name.
    fn reach(&mut self, definitions: &[&'u ast::FunctionDefinition]) -> Result<(), Error> {
        let names: Vec<HashSet<String>> = definitions.iter().map(|f| words(f)).collect();
        let mut by_name: HashMap<&str, Vec<usize>> = HashMap::new();
        for (i, f) in definitions.iter().enumerate() {
            by_name
                .entry(f.prototype.name.as_str())
                .or_default()
                .push(i);
        }
        let Some(main) = by_name.get("main").map(|all| all[0]) else {
            return Err(Error::new(
                Code::NoEntryPoint,
                "there is no function `main`",
            ));
        };
        let mut done = vec![false; definitions.len()];
        let mut order = Vec::new();
        visit(main, &names, &by_name, &mut done, &mut order);
        // A global's initial value may call functions too.
        for global in &self.globals {
            let mut found = Words::default();
            if let Some(init) = global.init {
                init.visit(&mut found);
            }
            for i in found
                .0
                .iter()
                .flat_map(|w| by_name.get(w.as_str()).into_iter().flatten())
            {
                visit(*i, &names, &by_name, &mut done, &mut order);
            }
            self.used.extend(found.0);
        }
        // `main` last, whatever the globals reached.
        order.retain(|i| *i != main);
        order.push(main);
        for i in &order {
            self.used.extend(names[*i].iter().cloned());
        }
        self.functions = order.into_iter().map(|i| definitions[i]).collect();
        self.writers = writers::writers(&self.functions, &self.signatures);
        Ok(())
    }
}

/// Depth first, what is called before what calls it.
fn visit(
    at: usize,
    names: &[HashSet<String>],
    by_name: &HashMap<&str, Vec<usize>>,
    done: &mut [bool],
    order: &mut Vec<usize>,
) {
    if std::mem::replace(&mut done[at], true) {
        return;
    }
    // In the order of the text, not of the set.
    let mut callees: Vec<usize> = names[at]
        .iter()
        .flat_map(|w| by_name.get(w.as_str()).into_iter().flatten().copied())
        .collect();
    callees.sort_unstable();
    for callee in callees {
        visit(callee, names, by_name, done, order);
    }
    order.push(at);
}

/// Among the words that a stage uses: the second component of `gl_FragCoord`.
pub(super) const FRAG_COORD_Y: &str = "gl_FragCoord.y";

/// The variables and functions that a function names, and [`FRAG_COORD_Y`].
fn words(function: &ast::FunctionDefinition) -> HashSet<String> {
    let mut found = Words::default();
    function.statement.visit(&mut found);
    found.0
}

#[derive(Default)]
struct Words(HashSet<String>);

impl Visitor for Words {
    fn visit_expr(&mut self, expr: &ast::Expr) -> Visit {
        let is_coord = |name: &ast::Identifier| name.as_str() == "gl_FragCoord";
        match &expr.content {
            // Which components are read is known here alone.
            ExprData::Dot(of, components) if matches!(&of.content, ExprData::Variable(name) if is_coord(name)) =>
            {
                self.0.insert("gl_FragCoord".to_owned());
                if components.as_str().contains(['y', 'g', 't']) {
                    self.0.insert(FRAG_COORD_Y.to_owned());
                }
                return Visit::Parent;
            }
            ExprData::Variable(name) => {
                if is_coord(name) {
                    self.0.insert(FRAG_COORD_Y.to_owned());
                }
                self.0.insert(name.as_str().to_owned());
            }
            ExprData::FunCall(name, _) => {
                if let Some(name) = name.as_ident() {
                    self.0.insert(name.as_str().to_owned());
                }
            }
            _ => {}
        }
        Visit::Children
    }
}

/// How many elements an initial value has.
pub(super) fn initial_length(init: &ast::Initializer) -> Option<u32> {
    match &init.content {
        ast::InitializerData::List(list) => Some(list.len() as u32),
        ast::InitializerData::Simple(e) => match &e.content {
            ExprData::FunCall(_, arguments) => Some(arguments.len() as u32),
            _ => None,
        },
    }
}
