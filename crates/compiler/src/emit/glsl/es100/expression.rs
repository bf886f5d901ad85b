//! Converts expressions.

use glsl_lang::ast::{
    self, AssignmentOpData, BinaryOpData, ExprData, FunIdentifierData, TypeSpecifierNonArrayData,
    UnaryOpData,
};
use naga::ShaderStage;

use super::{Es100, Result, Sampler, lacks, types};

/// Float functions that both languages share (GLSL ES 1.00, chapter 8).
const FLOATS: [&str; 33] = [
    "radians",
    "degrees",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "pow",
    "exp",
    "log",
    "exp2",
    "log2",
    "sqrt",
    "inversesqrt",
    "abs",
    "sign",
    "floor",
    "ceil",
    "fract",
    "mod",
    "min",
    "max",
    "clamp",
    "mix",
    "step",
    "smoothstep",
    "length",
    "distance",
    "dot",
    "cross",
    "normalize",
    "faceforward",
];

/// Other functions that both versions have.
const OTHERS: [&str; 12] = [
    "reflect",
    "refract",
    "matrixCompMult",
    "lessThan",
    "lessThanEqual",
    "greaterThan",
    "greaterThanEqual",
    "equal",
    "notEqual",
    "any",
    "all",
    "not",
];

/// Variables that both versions have.
const BUILTINS: [&str; 7] = [
    "gl_Position",
    "gl_PointSize",
    "gl_FragCoord",
    "gl_FrontFacing",
    "gl_PointCoord",
    "gl_FragColor",
    "gl_FragData",
];

const DERIVATIVES: &str = "GL_OES_standard_derivatives";
const LEVELS: &str = "GL_EXT_shader_texture_lod";

impl Es100 {
    pub(super) fn expression(&mut self, expression: &mut ast::Expr) -> Result<()> {
        if let Some(condition) = self.tested(expression) {
            *expression = condition;
        }
        match &mut **expression {
            ExprData::Variable(name) => {
                let name = name.as_str();
                if let Some((output, _)) = self.outputs.get(name) {
                    **expression = output.clone();
                } else if name == "gl_FragDepth" {
                    self.extensions.insert("GL_EXT_frag_depth");
                    **expression = ExprData::variable("gl_FragDepthEXT");
                } else if name.starts_with("gl_") && !BUILTINS.contains(&name) {
                    return lacks(format!("`{name}`"));
                }
            }
            ExprData::IntConst(_) | ExprData::BoolConst(_) | ExprData::FloatConst(_) => {}
            ExprData::UIntConst(_) => return lacks("an unsigned integer"),
            ExprData::DoubleConst(_) => return lacks("a number of double precision"),
            ExprData::Unary(op, of) => {
                if **op == UnaryOpData::Complement {
                    return lacks("the operator ~");
                }
                self.expression(of)?;
            }
            ExprData::Binary(op, left, right) => {
                let missing = match **op {
                    BinaryOpData::BitOr => Some("|"),
                    BinaryOpData::BitXor => Some("^"),
                    BinaryOpData::BitAnd => Some("&"),
                    BinaryOpData::LShift => Some("<<"),
                    BinaryOpData::RShift => Some(">>"),
                    BinaryOpData::Mod => Some("%"),
                    _ => None,
                };
                if let Some(op) = missing {
                    return lacks(format!("the operator {op}"));
                }
                self.expression(left)?;
                self.expression(right)?;
            }
            ExprData::Ternary(condition, accept, reject) => {
                for each in [condition, accept, reject] {
                    self.expression(each)?;
                }
            }
            ExprData::Assignment(to, op, from) => {
                let has = matches!(
                    **op,
                    AssignmentOpData::Equal
                        | AssignmentOpData::Mult
                        | AssignmentOpData::Div
                        | AssignmentOpData::Add
                        | AssignmentOpData::Sub
                );
                if !has {
                    return lacks("a bitwise assignment");
                }
                let components = match &***to {
                    ExprData::Variable(name) => self.outputs.get(name.as_str()).map(|o| o.1),
                    _ => None,
                };
                self.expression(to)?;
                self.expression(from)?;
                if let Some(components) = components
                    && components < 4
                {
                    filled(from, components);
                }
            }
            ExprData::Bracket(of, index) => {
                self.expression(of)?;
                match (self.stage, self.index(index)) {
                    (ShaderStage::Fragment, None) => return lacks("a non-constant index"),
                    (ShaderStage::Fragment, Some(by_turns)) => **index = by_turns,
                    _ => self.expression(index)?,
                }
            }
            ExprData::Dot(of, _) | ExprData::PostInc(of) | ExprData::PostDec(of) => {
                self.expression(of)?;
            }
            ExprData::Comma(first, second) => {
                self.expression(first)?;
                self.expression(second)?;
            }
            ExprData::FunCall(function, arguments) => {
                for argument in arguments.iter_mut() {
                    self.expression(argument)?;
                }
                let name = match &mut **function {
                    FunIdentifierData::TypeSpecifier(ty) => {
                        if ty.array_specifier.is_some() {
                            return lacks("an array constructor");
                        }
                        return types::non_array(&mut ty.ty);
                    }
                    FunIdentifierData::Expr(name) => match &***name {
                        ExprData::Variable(name) => name.as_str().to_owned(),
                        _ => return lacks("a method"),
                    },
                };
                if let Some(called) = self.call(&name, arguments)? {
                    **expression = called;
                }
            }
        }
        Ok(())
    }

    /// The bool in `uint(flag) != 0u`, which naga writes for a bool stored in a block.
    fn tested(&self, expression: &ast::Expr) -> Option<ast::Expr> {
        let ExprData::Binary(op, left, right) = &**expression else {
            return None;
        };
        let ExprData::FunCall(function, arguments) = &***left else {
            return None;
        };
        let FunIdentifierData::TypeSpecifier(ty) = &**function else {
            return None;
        };
        let is_uint = matches!(*ty.ty, TypeSpecifierNonArrayData::UInt);
        let is_asked = **op == BinaryOpData::NonEqual && matches!(***right, ExprData::UIntConst(0));
        match arguments.as_slice() {
            [of] if is_uint && is_asked && self.is_boolean(of) => Some(of.clone()),
            _ => None,
        }
    }

    /// Converts a call whose arguments are already converted; `None` if it stays.
    fn call(&mut self, name: &str, arguments: &[ast::Expr]) -> Result<Option<ExprData>> {
        if self.functions.contains_key(name) || OTHERS.contains(&name) {
            return Ok(None);
        }
        let is_struct = self.names.contains(name) || !name.starts_with(char::is_lowercase);
        if FLOATS.contains(&name) {
            if arguments.iter().any(|a| self.is_integer(a)) {
                return lacks(format!("the function {name} of integers"));
            }
            if name == "mix" && arguments.last().is_some_and(|a| self.is_boolean(a)) {
                return lacks("the function mix with booleans");
            }
            return Ok(None);
        }
        let vertex = self.stage == ShaderStage::Vertex;
        let call = |name: String, arguments: Vec<ast::Expr>| {
            let function = FunIdentifierData::ident(name.as_str());
            Some(ExprData::FunCall(function.into(), arguments))
        };
        match (name, arguments) {
            ("dFdx" | "dFdy" | "fwidth", _) if !vertex => {
                self.extensions.insert(DERIVATIVES);
                Ok(None)
            }
            ("texture", [sampler, ..]) => {
                let stem = self.stem(sampler)?;
                Ok(call(stem.to_owned(), arguments.to_vec()))
            }
            ("textureLod", [sampler, ..]) => {
                let stem = self.stem(sampler)?;
                if !vertex {
                    self.extensions.insert(LEVELS);
                }
                let suffix = if vertex { "" } else { "EXT" };
                Ok(call(format!("{stem}Lod{suffix}"), arguments.to_vec()))
            }
            ("textureGrad", [sampler, ..]) if !vertex => {
                let stem = self.stem(sampler)?;
                self.extensions.insert(LEVELS);
                Ok(call(format!("{stem}GradEXT"), arguments.to_vec()))
            }
            ("texelFetch", [sampler, pixel, level]) => {
                let ExprData::Variable(of) = &**sampler else {
                    return lacks("texelFetch of a texture parameter");
                };
                let of = of.as_str();
                if !matches!(**level, ExprData::IntConst(0)) || !self.fetched.contains(of) {
                    return lacks(format!(
                        "texelFetch of `{of}`, which is also sampled, or of a level other than 0"
                    ));
                }
                let size = self.size(of);
                let half = ExprData::FloatConst(0.5).into();
                let binary = |op: BinaryOpData, a: ast::Expr, b: ast::Expr| -> ast::Expr {
                    ExprData::Binary(op.into(), Box::new(a), Box::new(b)).into()
                };
                let pixel = vec2(pixel.clone());
                let place = binary(BinaryOpData::Add, pixel, half);
                let size = ExprData::variable(size.as_str()).into();
                let place = binary(BinaryOpData::Div, place, size);
                Ok(call("texture2D".to_owned(), vec![sampler.clone(), place]))
            }
            ("textureSize", [sampler, level]) => match (&**sampler, &**level) {
                (ExprData::Variable(of), ExprData::IntConst(0)) => {
                    let size: ast::Expr =
                        ExprData::variable(self.size(of.as_str()).as_str()).into();
                    Ok(Some(constructed(TypeSpecifierNonArrayData::IVec2, size)))
                }
                _ => lacks("textureSize of a level other than 0"),
            },
            _ if is_struct => Ok(None),
            _ => lacks(format!("the function {name}")),
        }
    }

    /// The prefix of functions for this sampler.
    fn stem(&self, sampler: &ast::Expr) -> Result<&'static str> {
        let name = match &**sampler {
            ExprData::Variable(name) | ExprData::Dot(_, name) => name.as_str(),
            ExprData::Bracket(of, _) => return self.stem(of),
            _ => "",
        };
        match self.samplers.get(name) {
            Some(Sampler::Two) => Ok("texture2D"),
            Some(Sampler::Cube) => Ok("textureCube"),
            None => lacks("a sampler other than 2D and cube"),
        }
    }

    /// The uniform for a texture's size.
    fn size(&mut self, texture: &str) -> String {
        if let Some(size) = self.sizes.get(texture) {
            return size.clone();
        }
        let mut size = format!("{texture}_size");
        while self.names.contains(&size) {
            size.push('_');
        }
        self.sizes.insert(texture.to_owned(), size.clone());
        size
    }

    fn is_integer(&self, e: &ast::Expr) -> bool {
        use TypeSpecifierNonArrayData as T;
        let is = |ty: &T| matches!(ty, T::Int | T::IVec2 | T::IVec3 | T::IVec4);
        matches!(**e, ExprData::IntConst(_)) || Self::is_of(e, &self.integers, &is)
    }

    fn is_boolean(&self, e: &ast::Expr) -> bool {
        use TypeSpecifierNonArrayData as T;
        let is = |ty: &T| matches!(ty, T::Bool | T::BVec2 | T::BVec3 | T::BVec4);
        let compares = match &**e {
            ExprData::FunCall(function, _) => {
                let name = function.as_ident().map_or("", |n| n.as_str());
                OTHERS[3..].contains(&name)
            }
            ExprData::BoolConst(_) => true,
            _ => false,
        };
        compares || Self::is_of(e, &self.booleans, &is)
    }

    fn is_of(
        e: &ast::Expr,
        names: &std::collections::HashSet<String>,
        is: &dyn Fn(&TypeSpecifierNonArrayData) -> bool,
    ) -> bool {
        match &**e {
            ExprData::Variable(name) => names.contains(name.as_str()),
            ExprData::Dot(of, member) => {
                // For a vector it is a swizzle.
                let of_vector = Self::is_of(of, names, is);
                let swizzle = member.as_str().chars().all(|c| "xyzwrgbastpq".contains(c));
                of_vector || (!swizzle && names.contains(member.as_str()))
            }
            ExprData::Bracket(of, _) | ExprData::Unary(_, of) => Self::is_of(of, names, is),
            ExprData::Ternary(_, a, b) => Self::is_of(a, names, is) || Self::is_of(b, names, is),
            ExprData::Binary(op, a, b) => {
                let arithmetic = matches!(
                    **op,
                    BinaryOpData::Add | BinaryOpData::Sub | BinaryOpData::Mult | BinaryOpData::Div
                );
                arithmetic && (Self::is_of(a, names, is) || Self::is_of(b, names, is))
            }
            ExprData::FunCall(function, _) => match &**function {
                FunIdentifierData::TypeSpecifier(ty) => is(&ty.ty),
                FunIdentifierData::Expr(_) => {
                    let name = function.as_ident().map_or("", |n| n.as_str());
                    names.contains(name)
                }
            },
            _ => false,
        }
    }
}

fn constructed(ty: TypeSpecifierNonArrayData, of: ast::Expr) -> ExprData {
    let ty = ast::TypeSpecifierData::from(ty);
    let function = FunIdentifierData::TypeSpecifier(Box::new(ty.into()));
    ExprData::FunCall(function.into(), vec![of])
}

/// A `vec4` of fewer components. Missing ones are 0, and alpha is 1.
fn filled(of: &mut ast::Expr, components: usize) {
    let given = std::mem::replace(of, ExprData::FloatConst(1.0).into());
    let mut all = vec![given];
    all.extend((components..3).map(|_| ExprData::FloatConst(0.0).into()));
    all.push(ExprData::FloatConst(1.0).into());
    let ty = ast::TypeSpecifierData::from(TypeSpecifierNonArrayData::Vec4);
    let function = FunIdentifierData::TypeSpecifier(Box::new(ty.into()));
    *of = ExprData::FunCall(function.into(), all).into();
}

fn vec2(of: ast::Expr) -> ast::Expr {
    constructed(TypeSpecifierNonArrayData::Vec2, of).into()
}
