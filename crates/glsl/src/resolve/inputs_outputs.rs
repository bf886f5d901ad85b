//! Resolves inputs and outputs, and the globals that replace built-in variables.

use naga::{Binding, Interpolation, Sampling};

use super::expression::Ex;
use super::{Resolver, Var};
use crate::built_in_variables;
use crate::errors::unsupported;
use crate::interface::{flat, index};
use crate::stage::Variable;
use crate::tree::{GlobalId, GlobalKind, Kind, Node, Statement};
use crate::ty::{Component, Ty, ValueLeaf};
use shader_text::error::Error;

/// A location without an interpolation.
fn at_location(location: u32) -> Binding {
    Binding::Location {
        location,
        interpolation: None,
        sampling: None,
        blend_src: None,
        per_primitive: false,
    }
}

impl Resolver<'_, '_> {
    pub(super) fn varyings(&mut self) -> Result<(), Error> {
        let at = index(self.stage.kind);
        for variable in self.stage.inputs.clone() {
            let location = self.interface.inputs[at].get(&variable.key()).copied();
            let used = self.stage.used.contains(variable.used_as());
            self.varying(&variable, location.filter(|_| used), false)?;
        }
        for variable in self.stage.outputs.clone() {
            let location = self.interface.outputs[at].get(&variable.key()).copied();
            let read = self.interface.inputs[1].contains_key(&variable.key());
            let used = self.stage.used.contains(variable.used_as()) || at == 0 && read;
            self.varying(&variable, location.filter(|_| used), true)?;
        }
        Ok(())
    }

    fn varying(
        &mut self,
        variable: &Variable,
        location: Option<u32>,
        is_output: bool,
    ) -> Result<(), Error> {
        let name = variable.emitted();
        let leaves = self.stage.structs.leaf_paths(&variable.ty);
        let is_whole = matches!(&leaves[..], [leaf] if leaf.path.is_empty());
        let target = !self.is_vertex() && is_output;
        let is_narrow = target && variable.ty.components().is_some_and(|n| n < 4);
        let node = match location {
            None => self.unused(&name, variable),
            Some(location) if is_whole && is_narrow => self.narrow(&name, variable, location)?,
            Some(location) if is_whole => {
                let kind = self.port(variable, location, &variable.ty, is_output, &name)?;
                self.declare(Some(name), kind, variable.place)
            }
            Some(location) => self.parts(&name, variable, location, is_output, &leaves)?,
        };
        let fixed = (!is_output).then_some("an input");
        let var = Var::plain(node, variable.ty.clone()).fixed(fixed);
        match &variable.block {
            Some((_, Some(instance))) => self.bind(&format!("{instance}.{}", variable.name), var),
            _ => self.bind(&variable.name, var),
        }
        Ok(())
    }

    /// A varying that no function uses.
    fn unused(&mut self, name: &str, variable: &Variable) -> Node {
        let ty = variable.ty.clone();
        let kind = GlobalKind::Variable { ty, init: None };
        self.global_node(Some(name.to_owned()), kind, variable.place)
            .1
    }

    /// A target with fewer than four components. WebGPU needs all four. OpenGL leaves the others
    /// undefined; we write opaque black.
    fn narrow(&mut self, name: &str, variable: &Variable, location: u32) -> Result<Node, Error> {
        let rgba = Ty::Vector(variable.ty.kind().unwrap_or(Component::Float), 4);
        let leaf = self.fresh(&format!("{name}_rgba"));
        let kind = self.port(variable, location, &rgba, true, &leaf)?;
        let leaf = self.declare(Some(leaf), kind, variable.place);
        let node = self.variable_of(name, &variable.ty);
        let given = usize::from(variable.ty.components().unwrap_or(1));
        let black = [0, 0, 0, 1].map(Node::int).into_iter().skip(given);
        let whole = Node::construct(&rgba, [node.clone()].into_iter().chain(black).collect());
        let written = Statement::evaluate(Node::assign(&leaf, whole));
        self.epilogue.push(written);
        Ok(node)
    }

    /// A varying with several locations: a global variable, and one varying per part.
    fn parts(
        &mut self,
        name: &str,
        variable: &Variable,
        location: u32,
        is_output: bool,
        leaves: &[ValueLeaf],
    ) -> Result<Node, Error> {
        let mut declared = Vec::new();
        for (leaf, i) in leaves.iter().zip(0..) {
            let own = self.fresh(&format!("{name}{}", flat(&leaf.ending())));
            let at = location.saturating_add(i);
            let kind = self.port(variable, at, &leaf.ty, is_output, &own)?;
            declared.push(self.declare(Some(own), kind, variable.place));
        }
        let node = self.variable_of(name, &variable.ty);
        let parts = self.leaves(Ex::new(node.clone(), variable.ty.clone()));
        for (own, part) in declared.into_iter().zip(parts) {
            match is_output {
                false => self
                    .prologue
                    .push(Statement::evaluate(Node::assign(&part.node, own))),
                true => self.epilogue.push(Statement::evaluate(Node::assign(
                    &own,
                    self.value(part).node,
                ))),
            }
        }
        Ok(node)
    }

    /// A global variable that the author's text does not have.
    fn variable_of(&mut self, name: &str, ty: &Ty) -> Node {
        let ty = ty.clone();
        let kind = GlobalKind::Variable { ty, init: None };
        self.declare(Some(name.to_owned()), kind, None)
    }

    /// An input or output of type `ty` for a varying or a part of it.
    fn port(
        &self,
        variable: &Variable,
        location: u32,
        ty: &Ty,
        is_output: bool,
        name: &str,
    ) -> Result<GlobalKind, Error> {
        if ty.kind() == Some(Component::Bool) {
            return Err(unsupported(
                "a bool cannot be an input or an output",
                variable.place,
            ));
        }
        let travels = self.is_vertex() == is_output;
        let [how, at] = match travels {
            true => self
                .interface
                .interpolation
                .get(&variable.key())
                .copied()
                .unwrap_or_default(),
            false => [None, None],
        };
        let integer = matches!(ty.kind(), Some(Component::Int | Component::Uint));
        let how = match travels && integer {
            true => Some("flat"),
            false => how,
        };
        // Flat values come from one vertex, so the sampling position does not matter.
        let at = at.filter(|_| how != Some("flat"));
        let interpolation = match how {
            Some("flat") => Some(Interpolation::Flat),
            Some("noperspective") => Some(Interpolation::Linear),
            _ => at.map(|_| Interpolation::Perspective),
        };
        let sampling = at.map(|at| match at {
            "sample" => Sampling::Sample,
            _ => Sampling::Centroid,
        });
        // In the IR, both sources of a blend have an index; GLSL's default is 0. Index 0 alone
        // means nothing.
        let is_second = |v: &Variable| v.qualifiers.number("index").is_some_and(|n| n > 0);
        let blends = is_output && self.stage.outputs.iter().any(is_second);
        let binding = Binding::Location {
            location,
            interpolation,
            sampling,
            blend_src: blends.then(|| variable.qualifiers.number("index").unwrap_or(0)),
            per_primitive: false,
        };
        Ok(GlobalKind::Port {
            ty: ty.clone(),
            is_output,
            binding,
            name: name.to_owned(),
        })
    }

    /// The global that replaces a built-in.
    pub(super) fn standin(&mut self, of: &'static str, wanted: &str) -> Ex {
        let (id, ty) = match self.standins.get(of) {
            Some(known) => known.clone(),
            None => {
                let name = self.fresh(wanted);
                let (ty, kind) = self.standin_kind(of, &name);
                let (id, _) = self.global_node(Some(name), kind, None);
                self.standins.insert(of, (id, ty.clone()));
                (id, ty)
            }
        };
        Ex::new(Node::new(Kind::Global(id)), ty)
    }

    fn standin_kind(&self, of: &'static str, name: &str) -> (Ty, GlobalKind) {
        let array = |of: Ty, n: u32| Ty::Array(Box::new(of), Some(n.into()));
        let (ty, init, port) = match (of, built_in_variables::declared(of, self.stage.kind)) {
            ("gl_FragColor", _) => {
                let ty = Ty::Vector(Component::Float, 4);
                (ty, None, Some((true, at_location(0))))
            }
            ("gl_SampleMask", _) => {
                let ty = array(Ty::INT, 1);
                let init = Node::construct(&ty, vec![Node::int(-1)]);
                (ty, Some(init), None)
            }
            ("gl_ClipDistance", _) => (array(Ty::FLOAT, 1), None, None),
            (_, Some(own)) => {
                let binding = Binding::BuiltIn(own.built_in);
                (own.ty.clone(), None, Some((false, binding)))
            }
            (_, None) => (Ty::FLOAT, None, None),
        };
        let kind = match port {
            Some((is_output, binding)) => GlobalKind::Port {
                ty: ty.clone(),
                is_output,
                binding,
                name: name.to_owned(),
            },
            None => GlobalKind::Variable {
                ty: ty.clone(),
                init,
            },
        };
        (ty, kind)
    }

    /// The output in addition to the array of a built-in.
    pub(super) fn output_of(&mut self, of: &'static str) -> Node {
        let name = self.helper_name(&format!("{}_out", of.trim_start_matches("gl_")));
        let known = self.out.globals.iter();
        if let Some(at) = known.clone().position(|g| g.name.as_ref() == Some(&name)) {
            return Node::new(Kind::Global(GlobalId(at)));
        }
        let built_in = built_in_variables::declared(of, self.stage.kind);
        let kind = GlobalKind::Port {
            ty: Ty::UINT,
            is_output: true,
            binding: built_in.map_or(at_location(0), |own| Binding::BuiltIn(own.built_in)),
            name: name.clone(),
        };
        let name = Some(name);
        self.global_node(name, kind, None).1
    }

    /// The globals for `gl_FragColor` and other names that the IR lacks.
    pub(super) fn standins_declared(&mut self) -> Vec<GlobalId> {
        let mut out = Vec::new();
        for (of, (id, _)) in self.standins.clone() {
            out.push(id);
            match of {
                "gl_SampleMask" => {
                    if let Kind::Global(id) = *self.output_of(of).kind {
                        out.push(id);
                    }
                }
                "gl_ClipDistance" => {
                    let used = self.clip_distances.max(1);
                    let n = self.stage.clip_distances.unwrap_or(used);
                    let name = self.helper_name("ClipDistance_out");
                    // The array itself is the output.
                    self.out.globals[id.0].kind = GlobalKind::Port {
                        ty: Ty::Array(Box::new(Ty::FLOAT), Some(n.into())),
                        is_output: true,
                        binding: Binding::BuiltIn(naga::BuiltIn::ClipDistances),
                        name,
                    };
                }
                _ => {}
            }
        }
        out.extend(self.targets.values());
        out
    }

    /// An output of `gl_FragData`.
    pub(super) fn target(&mut self, target: u32) -> Ex {
        let ty = Ty::Vector(Component::Float, 4);
        let id = match self.targets.get(&target) {
            Some(id) => *id,
            None => {
                let mut name = format!("FragData_{target}");
                while self.stage.unit.names.contains(&name) {
                    name.push('_');
                }
                let kind = GlobalKind::Port {
                    ty: ty.clone(),
                    is_output: true,
                    binding: at_location(target),
                    name: name.clone(),
                };
                let name = Some(name);
                let (id, _) = self.global_node(name, kind, None);
                self.targets.insert(target, id);
                id
            }
        };
        Ex::new(Node::new(Kind::Global(id)), ty)
    }
}
