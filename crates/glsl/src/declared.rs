//! Records the author's declarations, so that emitted GLSL can reuse their names, types and
//! numbers.

use naga::{ResourceBinding, ShaderStage};
use naga_edit::declared::{
    Block, Chosen, CombinedSampler, Declaration, Declared, Depth, Located, Numbered,
    StagePrecision, Type,
};

use super::interface::{BindingSlot, Interface, index};
use super::stage::{FRAG_COORD_Y, GlslStage, PRECISE, Variable};
use super::ty::{Structs, Ty};
use naga_edit::declared::{DFDY_NOTE, FRAG_COORD_NOTE, PRECISE_NOTE};
use shader_text::options::ClipSpace;

/// Collects the declarations of stages after `interface` has numbered them.
pub(super) fn declared(
    stages: &[GlslStage<'_>],
    interface: &Interface,
    clip: ClipSpace,
    is_vulkan: bool,
) -> Declared {
    let mut out = Declared {
        loose: (!interface.uniforms.is_empty()).then(|| binding(interface.uniform_slot)),
        depth: match clip {
            ClipSpace::AsWritten => Depth::AsWritten,
            ClipSpace::OpenGl => Depth::OpenGl,
        },
        // OpenGL's y points up with either range of depths (`glClipControl`).
        y_down: is_vulkan && clip == ClipSpace::AsWritten,
        point_size: stages
            .iter()
            .any(|s| s.kind == ShaderStage::Vertex && s.used.contains("gl_PointSize")),
        origin_upper_left: stages
            .iter()
            .any(|s| s.kind == ShaderStage::Fragment && s.origin_upper_left),
        notes: notes(stages, clip)
            .into_iter()
            .chain(dropped(stages))
            .collect(),
        ..Declared::default()
    };
    out.precisions = stages
        .iter()
        .map(|stage| StagePrecision {
            stage: stage.kind,
            default: stage.precision,
            qualified: stage.qualified.borrow().iter().copied().collect(),
        })
        .collect();
    for stage in stages {
        for uniform in &stage.uniforms {
            let Some(ty) = ty(&stage.structs, &uniform.ty) else {
                continue;
            };
            if out.uniforms.iter().all(|u| u.name != uniform.name) {
                out.uniforms.push(Declaration {
                    name: uniform.name.clone(),
                    ty,
                    location: uniform.qualifiers.number("location"),
                });
            }
        }
        for block in &stage.blocks {
            if let Some(slot) = interface.blocks.get(&block.name)
                && out.blocks.iter().all(|b| b.name != block.name)
            {
                out.blocks.push(Block {
                    binding: binding(*slot),
                    name: block.name.clone(),
                    instance: block.instance.clone(),
                });
            }
        }
        let (variables, locations, into) = match stage.kind {
            ShaderStage::Vertex => (&stage.inputs, &interface.inputs, &mut out.attributes),
            _ => (&stage.outputs, &interface.outputs, &mut out.targets),
        };
        let locations = &locations[index(stage.kind)];
        into.extend(variables.iter().filter_map(|v| {
            let location = *locations.get(&v.key())?;
            located(&stage.structs, v, location)
        }));
    }
    out.samplers = interface
        .samplers
        .iter()
        .map(|(path, bound)| CombinedSampler {
            path: path.clone(),
            texture: binding(bound.slots[0]),
            sampler: binding(bound.slots[1]),
        })
        .collect();
    out.numbers = numbers(stages, interface);
    out
}

/// Records what the IR has transposed, and its copied and renamed structs. `interface` has the
/// copies that resolving made.
pub(super) fn layouts(stages: &[GlslStage<'_>], interface: &Interface, out: &mut Declared) {
    let copies = interface.struct_copies.iter();
    let copies = copies.map(|((own, rows, _), copy)| (copy, own, *rows));
    for stage in stages {
        for block in &stage.blocks {
            let by_rows = block.members.iter().filter(|m| m.row_major);
            let names = by_rows.map(|m| (block.name.clone(), m.name.clone()));
            out.rows.extend(names);
        }
        for (copy, own, _) in copies.clone().filter(|(.., rows)| *rows) {
            let members = stage.structs.get(own).into_iter().flat_map(|s| &s.members);
            let names = members.map(|m| (copy.clone(), m.name.clone()));
            out.rows.extend(names);
        }
    }
    out.copies = copies
        .map(|(copy, own, _)| (copy.clone(), own.clone()))
        .chain(interface.renamed.iter().cloned())
        .collect();
    out.copies.sort();
    out.rows.sort();
    out.rows.dedup();
}

/// Warnings about code with another meaning in the target.
fn notes(stages: &[GlslStage<'_>], clip: ClipSpace) -> Vec<String> {
    let mut fragment = stages.iter().filter(|s| s.kind == ShaderStage::Fragment);
    let mut out = Vec::new();
    match clip {
        ClipSpace::OpenGl => {
            let uses =
                |s: &GlslStage<'_>, words: &[&str]| words.iter().any(|w| s.used.contains(*w));
            let Some(stage) = fragment.next() else {
                return out;
            };
            if uses(stage, &[FRAG_COORD_Y]) && !stage.origin_upper_left {
                out.push(FRAG_COORD_NOTE.to_owned());
            }
            if uses(stage, &["dFdy", "dFdyFine", "dFdyCoarse"]) {
                out.push(DFDY_NOTE.to_owned());
            }
        }
        ClipSpace::AsWritten if stages.iter().any(|s| s.unit.asks_for_vulkan) => out.push(
            "the text tests `VULKAN`, which is only defined with `--clip zero-to-one`; \
             define it by `--define VULKAN=100`"
                .to_owned(),
        ),
        ClipSpace::AsWritten => {}
    }
    out
}

/// Notes on keywords of Vulkan's GLSL that are dropped.
fn dropped(stages: &[GlslStage<'_>]) -> Vec<String> {
    let mut out = Vec::new();
    if stages.iter().any(|s| s.used.contains("debugPrintfEXT")) {
        out.push("`debugPrintfEXT` is dropped: WebGPU prints nothing".to_owned());
    }
    // An invariant position could get other bits than the author's if the local variable does not
    // affect it.
    if stages.iter().any(|s| s.used.contains(PRECISE)) {
        out.push(PRECISE_NOTE.to_owned());
    }
    if stages.iter().any(|s| s.unit.is_nonuniform) {
        out.push(
            "`nonuniformEXT` is dropped: samplers that differ in a quad are selected by a \
             `switch`, with gradients from before it"
                .to_owned(),
        );
    }
    out
}

/// The author's binding numbers, once for each binding.
fn numbers(stages: &[GlslStage<'_>], interface: &Interface) -> Vec<Numbered> {
    let mut out: Vec<Numbered> = Vec::new();
    let mut add = |slot: Option<&BindingSlot>, number: Option<u32>| {
        if let (Some(slot), Some(number)) = (slot, number)
            && out.iter().all(|n| n.binding != binding(*slot))
        {
            out.push(Numbered {
                binding: binding(*slot),
                number,
            });
        }
    };
    for stage in stages {
        for block in &stage.blocks {
            let number = block.qualifiers.number("binding");
            add(interface.blocks.get(&block.name), number);
        }
        for variable in &stage.opaque {
            let number = variable.qualifiers.number("binding");
            add(interface.opaque.get(&variable.name), number);
        }
    }
    for bound in interface.samplers.values() {
        add(Some(&bound.slots[0]), bound.number);
    }
    out
}

fn binding((group, binding): BindingSlot) -> ResourceBinding {
    ResourceBinding { group, binding }
}

fn located(structs: &Structs, variable: &Variable, location: u32) -> Option<Located> {
    let name = variable.emitted();
    let ty = ty(structs, &variable.ty)?;
    let chosen = match variable.qualifiers.number("location") {
        Some(_) => Chosen::ByAuthor,
        None => Chosen::ByUs,
    };
    Some(Located {
        declaration: Declaration {
            name,
            ty,
            location: None,
        },
        location,
        chosen,
    })
}

/// The declared type. `None` for types that a uniform outside of blocks cannot have.
fn ty(structs: &Structs, of: &Ty) -> Option<Type> {
    Some(match of {
        Ty::Scalar(_) | Ty::Vector(..) | Ty::Matrix(..) => Type::Plain(of.name()),
        Ty::Array(element, n) => Type::Array(Box::new(ty(structs, element)?), (*n)?.n),
        Ty::Combined(name) => Type::Sampler(name.clone()),
        Ty::Struct(name) => {
            let members = structs.get(name)?.members.iter().map(|m| {
                let name = m.name.clone();
                ty(structs, &m.ty).map(|ty| Declaration {
                    name,
                    ty,
                    location: None,
                })
            });
            Type::Struct(name.clone(), members.collect::<Option<_>>()?)
        }
        Ty::Void | Ty::Opaque(_) => return None,
    })
}
