//! Collects the global declarations of one stage.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeSet, HashMap, HashSet};

use blocks::{OfBlocks, of_blocks};
use glsl_lang::ast;
use glsl_lang::ast::{
    DeclarationData, ExprData, ExternalDeclarationData, NodeSpan, TypeSpecifierNonArrayData,
};
use naga::{ConservativeDepth, ShaderStage, Span};
use naga_edit::declared::{LengthConstant, Precision};
use types::APART;

use super::constant;
use super::constant::{ConstantValue, Constants, Specialised};
use super::lengths::Candidate;
use super::syntax::Unit;
use super::ty::{GlslMember, Length, Structs, Ty};
use crate::errors::{unsupported, wrong};
use shader_text::error::Error;

mod blocks;
mod qualifiers;
mod reachable;
pub(super) mod side_effects;
mod types;

pub(super) use blocks::Block;
pub(super) use qualifiers::{Qualifiers, Storage};
pub(super) use reachable::{FRAG_COORD_Y, PRECISE};

/// An input, an output or a loose uniform.
#[derive(Clone, Debug)]
pub(super) struct Variable {
    pub name: String,
    pub ty: Ty,
    pub qualifiers: Qualifiers,
    pub place: Option<Span>,
    /// The name of its interface block, and the block's instance name.
    pub block: Option<(String, Option<String>)>,
}

impl Variable {
    /// The name by which stages match it.
    pub(super) fn key(&self) -> String {
        match &self.block {
            Some((block, _)) => format!("{block}.{}", self.name),
            None => self.name.clone(),
        }
    }

    /// The name by which its stage uses it: its own, or its block's instance name.
    pub(super) fn used_as(&self) -> &str {
        match &self.block {
            Some((_, Some(instance))) => instance,
            _ => &self.name,
        }
    }

    /// Its name in the IR.
    pub(super) fn emitted(&self) -> String {
        match &self.block {
            Some((_, Some(instance))) => format!("{instance}_{}", self.name),
            _ => self.name.clone(),
        }
    }
}

/// The expression of an initialiser that is not a list.
pub(super) fn simple(init: &ast::Initializer) -> Option<&ast::Expr> {
    match &init.content {
        ast::InitializerData::Simple(e) => Some(e),
        _ => None,
    }
}

/// A global variable or constant.
pub(super) struct Global<'u> {
    pub name: &'u ast::Identifier,
    pub ty: Ty,
    pub qualifiers: Qualifiers,
    pub init: Option<&'u ast::Initializer>,
    pub place: Option<Span>,
}

#[derive(Clone, Debug)]
pub(super) struct Signature {
    pub parameters: Vec<(Storage, Ty)>,
    pub result: Ty,
    /// Where the text first declares it.
    pub declared: u32,
    pub has_body: bool,
}

/// Where a node begins in the preprocessed text.
pub(super) fn start(span: Option<NodeSpan>) -> u32 {
    span.map_or(0, |span| span.range().start().into())
}

pub(super) struct GlslStage<'u> {
    pub unit: &'u Unit,
    pub kind: ShaderStage,
    pub structs: Structs,
    pub constants: Constants,
    /// Specialisation constants whose defaults are final.
    pub assumed: RefCell<Specialised>,
    /// Specialisation constants that may affect only array lengths.
    pub lengths: RefCell<Vec<Candidate>>,
    pub uniforms: Vec<Variable>,
    /// Separate textures, samplers and images.
    pub opaque: Vec<Variable>,
    pub blocks: Vec<Block>,
    pub inputs: Vec<Variable>,
    pub outputs: Vec<Variable>,
    pub globals: Vec<Global<'u>>,
    /// Functions that `main` reaches, callees first.
    pub functions: Vec<&'u ast::FunctionDefinition>,
    /// The overloads of each function, in the order of their declarations.
    pub signatures: HashMap<String, Vec<Signature>>,
    /// Where the text declares each global variable and each member of a block.
    pub declared: HashMap<String, u32>,
    /// Names of functions with side effects.
    pub writers: HashSet<String>,
    /// Whether a `demote` was resolved.
    pub demotes: Cell<bool>,
    /// Names used by reachable functions.
    pub used: HashSet<String>,
    /// Whether the position is `invariant`, or anything is `precise`.
    pub invariant: bool,
    pub early_fragment_tests: bool,
    /// The guarantee on depths that the fragment stage writes, such as `layout(depth_greater)`.
    pub depth: Option<ConservativeDepth>,
    /// Default layouts of uniform and storage blocks: `layout(row_major) uniform;`.
    defaults: [OfBlocks; 2],
    /// Whether `gl_FragCoord` starts at the top.
    pub origin_upper_left: bool,
    /// The precision of floats without a qualifier.
    pub precision: Precision,
    /// The precisions that qualifiers name.
    pub qualified: RefCell<BTreeSet<Precision>>,
    /// The declared length of `gl_ClipDistance`.
    pub clip_distances: Option<u32>,
}

impl<'u> GlslStage<'u> {
    /// Collects a stage's declarations. `raised`: the specialisation constant whose default is
    /// taken as one larger.
    pub(super) fn collect(
        unit: &'u Unit,
        kind: ShaderStage,
        raised: Option<u32>,
    ) -> Result<Self, Error> {
        let mut stage = Self {
            unit,
            kind,
            structs: Structs::default(),
            constants: Constants::raising(raised),
            assumed: RefCell::default(),
            lengths: RefCell::default(),
            uniforms: Vec::new(),
            opaque: Vec::new(),
            blocks: Vec::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            globals: Vec::new(),
            functions: Vec::new(),
            signatures: HashMap::new(),
            declared: HashMap::new(),
            writers: HashSet::new(),
            demotes: Cell::new(false),
            used: HashSet::new(),
            invariant: unit.invariant_all,
            early_fragment_tests: false,
            depth: None,
            defaults: [OfBlocks::default(); 2],
            origin_upper_left: false,
            precision: Precision::High,
            qualified: RefCell::default(),
            clip_distances: None,
        };
        let mut definitions = Vec::new();
        for item in &unit.tree.0 {
            match &item.content {
                ExternalDeclarationData::Preprocessor(_) => {}
                ExternalDeclarationData::Declaration(d) => stage.declaration(d)?,
                ExternalDeclarationData::FunctionDefinition(f) => {
                    stage.prototype(&f.prototype, true)?;
                    definitions.push(f);
                }
            }
        }
        stage.reach(&definitions)?;
        Ok(stage)
    }

    /// Whether the text uses sets, push constants, separate textures or built-ins that only Vulkan
    /// has.
    pub(super) fn says_vulkan(&self) -> bool {
        let variables = self.uniforms.iter().chain(&self.opaque);
        let layouts = variables.map(|v| &v.qualifiers);
        let mut layouts = layouts.chain(self.blocks.iter().map(|b| &b.qualifiers));
        let is_separate = |v: &Variable| {
            let name = v.ty.base_name();
            let bare = name.trim_start_matches(['i', 'u']);
            bare.starts_with("texture") || bare.starts_with("sampler")
        };
        let own = ["gl_VertexIndex", "gl_InstanceIndex"];
        layouts.any(|q| q.says("set") || q.says("push_constant"))
            || self.opaque.iter().any(is_separate)
            || own.iter().any(|w| self.used.contains(*w))
    }

    /// A constant's value where the IR cannot use an override. For a specialisation constant this
    /// is its default, which becomes final.
    pub(super) fn fixed(&self, e: &ast::Expr) -> Option<ConstantValue> {
        let (value, from) = constant::assume(e, &self.constants)?;
        self.assumed.borrow_mut().extend(from);
        Some(value)
    }

    /// The length of an array. If it is a specialisation constant, its default does not become
    /// final yet.
    pub(super) fn length(&self, e: &ast::Expr) -> Option<Length> {
        let constant = match &e.content {
            ast::ExprData::Variable(name) => self.constants.specialised(name.as_str()),
            _ => None,
        };
        let Some((id, own)) = constant else {
            return u32::try_from(self.fixed_integer(e)?).ok().map(Length::from);
        };
        let (value, _) = constant::assume(e, &self.constants)?;
        let default = u32::try_from(constant::integer(&value)?).ok()?;
        let is_signed = matches!(value, ConstantValue::Int(_));
        let candidate = (LengthConstant { id, own, is_signed }, default);
        let mut lengths = self.lengths.borrow_mut();
        if !lengths.contains(&candidate) {
            lengths.push(candidate);
        }
        Some(Length {
            n: default,
            constant: Some(id),
        })
    }

    /// As [`Self::fixed`], for an integer.
    pub(super) fn fixed_integer(&self, e: &ast::Expr) -> Option<i64> {
        constant::integer(&self.fixed(e)?)
    }

    fn place(&self, span: Option<NodeSpan>) -> Option<Span> {
        self.unit.place(span)
    }

    fn declaration(&mut self, declaration: &'u ast::Declaration) -> Result<(), Error> {
        let place = self.place(declaration.span);
        match &declaration.content {
            DeclarationData::FunctionPrototype(p) => self.prototype(p, false),
            DeclarationData::Precision(precision, ty) => {
                if matches!(ty.ty.content, TypeSpecifierNonArrayData::Float) {
                    self.precision = qualifiers::precision(precision);
                }
                Ok(())
            }
            DeclarationData::Invariant(name) => {
                self.invariant |= name.as_str() == "gl_Position";
                Ok(())
            }
            DeclarationData::TypeOnly(qualifier) => {
                let q = self.qualifiers(Some(qualifier))?;
                self.early_fragment_tests |= q.says("early_fragment_tests");
                self.invariant |= q.precise;
                // Applies to later blocks.
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
                        format!("`layout({word})` is not for a vertex or fragment stage"),
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
            // A redeclaration. It may add `invariant`, move the origin of `gl_FragCoord`, or bound
            // `gl_FragDepth`.
            self.invariant |= text == "gl_Position" && (qualifiers.invariant || qualifiers.precise);
            self.origin_upper_left |= qualifiers.says("origin_upper_left");
            self.depth = qualifiers.conservative_depth().or(self.depth);
            self.clip_distance(&text, &ty);
            if qualifiers.says("pixel_center_integer") {
                return Err(unsupported(
                    "`pixel_center_integer` is not supported: WebGPU's pixel centres are at halves",
                    place,
                )
                .note("remove it and subtract 0.5 from `gl_FragCoord`"));
            }
            return Ok(());
        }
        self.invariant |= qualifiers.precise;
        let at = start(name.span);
        self.declared.entry(text.clone()).or_insert(at);
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
        let constant = qualifiers.storage == Some(Storage::Const);
        let value = init.filter(|_| constant).and_then(simple);
        let id = qualifiers.number("constant_id");
        constant::declare(&mut self.constants, &text, &ty, value, id);
        match qualifiers.storage {
            Some(Storage::In) => self.inputs.push(variable),
            Some(Storage::Out) => self.outputs.push(variable),
            Some(Storage::Uniform | Storage::Buffer) => match ty.innermost() {
                Ty::Opaque(_) => self.opaque.push(variable),
                _ => {
                    // A duplicate declaration is allowed.
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

    fn clip_distance(&mut self, name: &str, ty: &Ty) {
        if let ("gl_ClipDistance", Ty::Array(_, length)) = (name, ty) {
            let length = length.map(|length| length.n);
            self.clip_distances = length.or(self.clip_distances);
        }
    }

    /// The members that a field declares. Their matrices are column-major.
    fn fields(&mut self, field: &ast::StructFieldSpecifier) -> Result<Vec<GlslMember>, Error> {
        let place = self.place(field.span);
        let ty = self.ty(&field.ty, None, place)?;
        let member = |i: &ast::ArrayedIdentifier| {
            Ok(GlslMember {
                name: i.ident.as_str().to_owned(),
                ty: self.dimensions(ty.clone(), i.array_spec.as_ref(), place)?,
                row_major: false,
                place,
            })
        };
        field.identifiers.iter().map(member).collect()
    }

    fn prototype(
        &mut self,
        prototype: &ast::FunctionPrototype,
        has_body: bool,
    ) -> Result<(), Error> {
        let signature = Signature {
            has_body,
            ..self.signature(prototype)?
        };
        let name = prototype.name.as_str();
        let place = self.place(prototype.span);
        let all = self.signatures.entry(name.to_owned()).or_default();
        let types = |s: &Signature| s.parameters.iter().map(|p| p.1.clone()).collect::<Vec<_>>();
        let Some(old) = all.iter_mut().find(|s| types(s) == types(&signature)) else {
            all.push(signature);
            return Ok(());
        };
        let is_other = old.result != signature.result || old.parameters != signature.parameters;
        if is_other || old.has_body && has_body {
            let message = match is_other {
                true => format!("`{name}` is declared with another result or other qualifiers"),
                false => format!("`{name}` with these parameters has two bodies"),
            };
            return Err(wrong(message, place));
        }
        old.has_body |= has_body;
        Ok(())
    }

    /// The parameters, except for `void`.
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
        Ok(Signature {
            parameters,
            result,
            declared: start(prototype.span),
            has_body: false,
        })
    }
}

/// The number of elements of a list or a constructor.
pub(super) fn initial_length(init: &ast::Initializer) -> Option<Length> {
    let n = match &init.content {
        ast::InitializerData::List(list) => list.len(),
        ast::InitializerData::Simple(e) => match &e.content {
            ExprData::FunCall(name, arguments)
                if matches!(name.content, ast::FunIdentifierData::TypeSpecifier(_)) =>
            {
                arguments.len()
            }
            _ => return None,
        },
    };
    Some((n as u32).into())
}
