//! Uniform, storage and push-constant blocks, and blocks of varyings.

use glsl_lang::ast;
use naga::Span;
use naga_edit::declared;

use super::types::APART;
use super::{GlslStage, Qualifiers, Storage, Variable};
use crate::errors::unsupported;
use crate::layout::Rules;
use crate::ty::{Component, GlslMember, Ty};
use shader_text::error::Error;

/// A uniform, storage or push-constant block.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    pub name: String,
    pub instance: Option<String>,
    /// Set for an array of blocks: its length, if it is sized.
    pub array: Option<Option<u32>>,
    pub members: Vec<GlslMember>,
    pub qualifiers: Qualifiers,
    pub place: Option<Span>,
}

impl Block {
    /// Layout rules. As in Vulkan, storage blocks default to std430.
    pub(crate) fn rules(&self) -> Rules {
        rules(&self.qualifiers)
    }
}

/// Limit on unused bytes before a member.
const MOST_PADDING: u32 = 4096;

fn rules(block: &Qualifiers) -> Rules {
    let storage = block.storage == Some(Storage::Buffer);
    match block.says("push_constant") || storage && !block.says("std140") {
        true => Rules::Std430,
        false => Rules::Std140,
    }
}

/// Defaults set by `layout(..) uniform;` or `layout(..) buffer;` for later blocks (GLSL 4.60,
/// 4.4.5).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OfBlocks {
    pub row_major: bool,
    pub rules: Option<&'static str>,
}

/// Index of the defaults for uniform or storage blocks.
pub(super) fn of_blocks(q: &Qualifiers) -> Option<usize> {
    match q.storage {
        Some(Storage::Uniform) => Some(0),
        Some(Storage::Buffer) => Some(1),
        _ => None,
    }
}

impl<'u> GlslStage<'u> {
    pub(super) fn block(&mut self, block: &'u ast::Block) -> Result<(), Error> {
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
            for field in &block.fields {
                for member in self.fields(field)? {
                    self.clip_distance(&member.name, &member.ty);
                }
            }
            return Ok(());
        }
        let instance = block
            .identifier
            .as_ref()
            .map(|i| i.ident.as_str().to_owned());
        // Members count as declared at the start of their block.
        let at = super::start(block.span);
        let members = || block.fields.iter().flat_map(|f| &f.identifiers);
        let names = match &instance {
            Some(instance) => vec![instance.clone()],
            None => members().map(|m| m.ident.as_str().to_owned()).collect(),
        };
        for name in names {
            self.declared.entry(name).or_insert(at);
        }
        let dimensions = block.identifier.as_ref();
        let dimensions = dimensions.and_then(|i| i.array_spec.as_ref());
        // The element type does not matter here, so `int` stands for it.
        let array = match self.dimensions(Ty::INT, dimensions, place)? {
            Ty::Array(of, length) if *of == Ty::INT => Some(length.map(|length| length.n)),
            Ty::Array(..) => {
                let message = format!("`{name}` is an array of arrays of blocks");
                return Err(unsupported(message, place).note("use one index for both"));
            }
            _ => None,
        };
        let is_resource = matches!(qualifiers.storage, Some(Storage::Uniform | Storage::Buffer))
            && !qualifiers.says("push_constant");
        if array.is_some() && !is_resource {
            let message = format!("`{name}` is an array of blocks, which only resources can be");
            return Err(unsupported(message, place));
        }
        let row_major = match qualifiers.says("column_major") {
            true => false,
            false => default.row_major || qualifiers.says("row_major"),
        };
        let mut members = Vec::new();
        let mut member_qualifiers = Vec::new();
        for field in &block.fields {
            let q = self.qualifiers(field.qualifier.as_ref())?;
            let by_rows = (row_major || q.says("row_major")) && !q.says("column_major");
            for member in self.fields(field)? {
                members.push(GlslMember {
                    row_major: by_rows,
                    ..member
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
                let length = self.structs.leaf_paths(&member.ty).len() as u32;
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
        if let Some(half) = members.iter().find(|m| self.structs.has_halves(&m.ty)) {
            return Err(unsupported(
                format!(
                    "`{}` has 16 bits, which blocks do not support here",
                    half.name
                ),
                half.place,
            )
            .note("declare two as a `uint`, and unpack them by `unpackHalf2x16`"));
        }
        let tight = rules(&qualifiers) == Rules::Std430;
        let members = self.padded(&name, members, &member_qualifiers, tight)?;
        self.blocks.push(Block {
            name,
            instance,
            array,
            members,
            qualifiers,
            place,
        });
        Ok(())
    }

    /// Fills the gaps before members with an explicit offset (GLSL 4.60, 4.4.5), because blocks are
    /// laid out only by their rules.
    pub(super) fn padded(
        &self,
        block: &str,
        members: Vec<GlslMember>,
        qualifiers: &[Qualifiers],
        tight: bool,
    ) -> Result<Vec<GlslMember>, Error> {
        let mut out = Vec::new();
        let mut end = 0u32;
        let mut ordered: Vec<(GlslMember, &Qualifiers)> =
            members.into_iter().zip(qualifiers).collect();
        // Members may come in any order if each has an offset.
        if qualifiers.iter().all(|q| q.says("offset")) {
            ordered.sort_by_key(|(_, q)| q.number("offset"));
        }
        for (member, own) in ordered {
            let (natural, size) = self.structs.placed(&member.ty, tight, member.row_major);
            let least = own.number("offset").unwrap_or(end);
            let align = natural.max(own.number("align").unwrap_or(1));
            let at = least.checked_next_multiple_of(align).unwrap_or(u32::MAX);
            if own
                .number("offset")
                .is_some_and(|asked| asked != at || asked < end)
            {
                return Err(unsupported(
                    format!(
                        "`{}` has an offset that is no multiple of {align}, or meets the member \
                         before it, which ends at byte {end}",
                        member.name
                    ),
                    member.place,
                ));
            }
            if at - end > MOST_PADDING {
                return Err(unsupported(
                    format!(
                        "more than {MOST_PADDING} bytes are unused before `{}`",
                        member.name
                    ),
                    member.place,
                ));
            }
            let is_default = end.next_multiple_of(natural) == at;
            for offset in (end..at).step_by(4).filter(|_| !is_default) {
                out.push(GlslMember {
                    name: declared::padding(block, format_args!("x{offset}")),
                    ty: Ty::Scalar(Component::Float),
                    row_major: false,
                    place: None,
                });
            }
            // No buffer is this large. The validator rejects it.
            end = at.saturating_add(size).min(1 << 31);
            out.push(member);
        }
        Ok(out)
    }
}
