//! Assigns groups and bindings: the author's if they are free, otherwise the first free ones.

use std::collections::{HashMap, HashSet};

use super::{BindingSlot, BoundSampler, Interface, flat, refuse_sampler};
use crate::stage::{GlslStage, Qualifiers, Storage};
use shader_text::error::Error;

impl Interface {
    pub(super) fn bindings(&mut self, stages: &[GlslStage<'_>]) -> Result<(), Error> {
        // The author's bindings take precedence.
        let mut claims = Claims::default();
        let mut waiting: Vec<(Waiting, u32)> = Vec::new();
        for (at, stage) in stages.iter().enumerate() {
            self.claim_blocks(at, stage, &mut claims, &mut waiting);
            self.claim_opaque(at, stage, &mut claims, &mut waiting);
            self.claim_samplers(at, stage, &mut claims, &mut waiting)?;
        }
        if !self.uniforms.is_empty() {
            self.uniform_slot = claims.next(0);
        }
        for (what, set) in waiting {
            match what {
                Waiting::Block(name) => {
                    self.blocks.entry(name).or_insert_with(|| claims.next(set));
                }
                Waiting::Opaque(name) => {
                    self.opaque.entry(name).or_insert_with(|| claims.next(set));
                }
                Waiting::Sampler(path) => {
                    if let Some(bound) = self.samplers.get_mut(&path) {
                        if bound.slots[0].0 == u32::MAX {
                            bound.slots[0] = claims.next(set);
                        }
                        bound.slots[1] = claims.next(bound.slots[0].0);
                    }
                }
            }
        }
        Ok(())
    }

    fn claim_blocks(
        &mut self,
        at: usize,
        stage: &GlslStage<'_>,
        claims: &mut Claims,
        waiting: &mut Vec<(Waiting, u32)>,
    ) {
        for block in &stage.blocks {
            if block.qualifiers.says("push_constant") || self.blocks.contains_key(&block.name) {
                continue;
            }
            let set = block.qualifiers.number("set").unwrap_or(0);
            // OpenGL numbers uniform and storage blocks separately.
            let kind = match block.qualifiers.storage {
                Some(Storage::Buffer) => "storage block",
                _ => "uniform block",
            };
            match claims.claim(at, kind, explicit(&block.qualifiers)) {
                Some(slot) => {
                    self.blocks.insert(block.name.clone(), slot);
                }
                None => waiting.push((Waiting::Block(block.name.clone()), set)),
            }
        }
    }

    fn claim_opaque(
        &mut self,
        at: usize,
        stage: &GlslStage<'_>,
        claims: &mut Claims,
        waiting: &mut Vec<(Waiting, u32)>,
    ) {
        for variable in &stage.opaque {
            if self.opaque.contains_key(&variable.name) {
                continue;
            }
            let set = variable.qualifiers.number("set").unwrap_or(0);
            let slot = explicit(&variable.qualifiers);
            match claims.claim(at, &variable.ty.name(), slot) {
                Some(slot) => {
                    self.opaque.insert(variable.name.clone(), slot);
                }
                None => waiting.push((Waiting::Opaque(variable.name.clone()), set)),
            }
        }
    }

    fn claim_samplers(
        &mut self,
        at: usize,
        stage: &GlslStage<'_>,
        claims: &mut Claims,
        waiting: &mut Vec<(Waiting, u32)>,
    ) -> Result<(), Error> {
        for variable in &stage.uniforms {
            let mut found = Vec::new();
            stage
                .structs
                .samplers(&variable.ty, &variable.name, &mut found);
            for (i, (path, combined)) in found.into_iter().enumerate() {
                if self.samplers.contains_key(&path) {
                    continue;
                }
                refuse_sampler(&combined, variable)?;
                let texture = match path == variable.name {
                    true => path.clone(),
                    false => {
                        let flat = flat(&path);
                        self.fresh(&flat)
                    }
                };
                let sampler = self.fresh(&format!("{texture}_sampler"));
                // Array elements have consecutive bindings, as in OpenGL.
                let slot =
                    explicit(&variable.qualifiers).map(|(s, b)| (s, b.saturating_add(i as u32)));
                let set = variable.qualifiers.number("set").unwrap_or(0);
                let claimed = claims.claim(at, &combined, slot);
                let bound = BoundSampler {
                    combined,
                    texture,
                    sampler,
                    slots: [claimed.unwrap_or((u32::MAX, 0)); 2],
                    number: slot.map(|(_, number)| number),
                };
                self.samplers.insert(path.clone(), bound);
                waiting.push((Waiting::Sampler(path), set));
            }
        }
        Ok(())
    }
}

/// The set and binding in the author's text.
pub(super) fn explicit(qualifiers: &Qualifiers) -> Option<BindingSlot> {
    let binding = qualifiers.number("binding")?;
    Some((qualifiers.number("set").unwrap_or(0), binding))
}

/// The slots in use.
#[derive(Default)]
struct Claims {
    taken: HashSet<BindingSlot>,
    /// Stage and kind of resource for the author's own slots.
    kinds: HashMap<BindingSlot, (usize, String)>,
}

impl Claims {
    /// Reserves the author's slot for one resource: the same name in both stages, or the same
    /// binding and kind.
    fn claim(
        &mut self,
        stage: usize,
        kind: &str,
        slot: Option<BindingSlot>,
    ) -> Option<BindingSlot> {
        let slot = slot?;
        match self.kinds.get(&slot) {
            None => {
                self.kinds.insert(slot, (stage, kind.to_owned()));
                self.taken.insert(slot);
                Some(slot)
            }
            Some((other, of)) if *other != stage && of == kind => Some(slot),
            Some(_) => None,
        }
    }

    /// The first free slot of a set.
    fn next(&mut self, set: u32) -> BindingSlot {
        let mut slot = (set, 0);
        while !self.taken.insert(slot) {
            slot.1 += 1;
        }
        slot
    }
}

enum Waiting {
    Block(String),
    Opaque(String),
    Sampler(String),
}
