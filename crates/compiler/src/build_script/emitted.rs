//! A plan with its emitted files, and how the generated module names them.

use std::collections::BTreeMap;

use preshade_plan::plan::{BindingSource, BindingUse, Plan};

use shader_text::files::File;

/// One plan of a material, with its emitted files.
#[derive(Clone)]
pub(super) struct EmittedPlan {
    /// Name of its module, and of the folder of its files.
    pub name: String,
    pub plan: Plan,
    /// Its files, named as in `plan.json`.
    pub files: Vec<File>,
    /// The reasons of the skipped steps.
    pub left_out: Vec<String>,
}

impl EmittedPlan {
    /// Replaces the variant by the original. `why` becomes a reason of `LEFT_OUT`.
    pub(super) fn give_up(&mut self, original: &Self, why: String) {
        self.plan = original.plan.clone();
        self.files.clone_from(&original.files);
        self.left_out.push(why);
    }

    /// The overrides that remain in the WGSL of each program.
    pub fn overrides(&self) -> Result<BTreeMap<&str, Vec<Override>>, String> {
        let mut out = BTreeMap::new();
        for (key, program) in &self.plan.programs {
            if program.module().overrides.is_empty() {
                continue;
            }
            let name = format!("{}.{key}.wgsl", self.plan.material);
            let file = self.files.iter().find(|f| f.name == name);
            let text = file.map(|f| String::from_utf8_lossy(&f.bytes));
            // The emitter has read it back before.
            let module = text
                .map(|text| naga::front::wgsl::parse_str(&crate::wgsl::subgroups::without(&text)));
            let Some(Ok(module)) = module else {
                return Err(format!("{name} cannot be read"));
            };
            let of = |o: &naga::Override| Override {
                key: o
                    .id
                    .map(|id| id.to_string())
                    .or(o.name.clone())
                    .unwrap_or_default(),
                is_needed: o.init.is_none(),
            };
            let all: Vec<Override> = module.overrides.iter().map(|(_, o)| of(o)).collect();
            out.insert(key.as_str(), all);
        }
        Ok(out)
    }
}

/// A pipeline-overridable constant of a shader.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Override {
    /// Its number, or its name if it has none.
    pub key: String,
    /// It has no default, so the host must set it.
    pub is_needed: bool,
}

/// Whether the plan works with any sample count: no step depends on it, and no pass reads an
/// attachment that another pass wrote.
pub(super) fn samples_are_free(plan: &Plan) -> bool {
    let known = ["depth-prepass", "shadow"];
    let own = |b: &BindingUse| b.source == BindingSource::Author;
    plan.steps.iter().all(|s| known.contains(&s.pass.as_str()))
        && plan.compute.is_empty()
        && plan.passes.iter().flat_map(|p| &p.bindings).all(own)
}

/// Serialises plain data, which cannot fail.
pub(super) fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

pub(super) fn included(kind: &str, folder: &str, file: &str) -> String {
    let path = format!("{folder}{file}");
    format!("include_{kind}!({path:?})")
}
