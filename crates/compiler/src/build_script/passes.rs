//! Writes the passes of a plan as items of a generated module.

use std::collections::{BTreeMap, BTreeSet};

use preshade_plan::plan::{
    Attachment, BindingUse, ClearValue, ComputePass, Draws, GpuPass, Plan, SamplesPassed, SelfTest,
    SelfTestDraw,
};
use preshade_plan::program::Program;
use preshade_plan::state::{AttachmentOps, DepthState, LoadOp};
use preshade_plan::{limits, reflect};

use super::bindings::{PassKind, Shared};
use super::emitted::{EmittedPlan, Override, included, json, samples_are_free};
use super::wgpu_words as words;

/// The items of a plan's passes, with their documentation.
pub(super) fn items(
    drawn: &EmittedPlan,
    folder: &str,
    visible: &str,
    shared: &Shared<'_>,
    keys: &BTreeSet<String>,
) -> Result<Vec<(String, String)>, String> {
    let plan = &drawn.plan;
    if let Some(smaller) = plan.attachments.iter().find(|a| a.divisor > 1) {
        return Err(format!(
            "the attachment `{}`, which is smaller than the scene's colour: its pass needs a viewport \
             that the module does not set (draw it from plan.json, or ship a recipe without \
             `half-rate`)",
            smaller.name
        ));
    }
    let overrides = drawn.overrides()?;
    let wgsl = |program: &str| {
        let file = format!("{}.{program}.wgsl", plan.material);
        included("str", folder, &file)
    };
    let names = pass_names(plan);
    let mut items = Vec::new();
    for (pass, name) in plan.passes.iter().zip(&names) {
        let constants = Constants::of(&overrides, &pass.program, keys);
        let rust = raster(plan, pass, &wgsl(&pass.program), shared, &constants)?;
        items.push((
            format!("The pass `{}`.", pass.role.name()),
            format!("{visible}static {name}: Pass = {rust}"),
        ));
    }
    let mut item = |doc: &str, code: String| items.push((doc.to_owned(), code));
    let all: Vec<String> = names.iter().map(|n| format!("&{n}")).collect();
    item(
        "Its passes, in the order they run.",
        format!("{visible}static PASSES: &[&Pass] = &[{}]", all.join(", ")),
    );
    let compute = plan.compute.iter().map(|c| {
        let constants = Constants::of(&overrides, &c.program, keys);
        compute(plan, c, &wgsl(&c.program), shared, &constants)
    });
    let compute: Vec<String> = compute.collect::<Result<_, _>>()?;
    item(
        "Its compute passes, in the order they run.",
        format!(
            "{visible}static COMPUTE: &[Compute] = &[{}]",
            compute.join(", ")
        ),
    );
    let attachments: Vec<String> = plan.attachments.iter().map(attachment).collect();
    item(
        "Textures that its passes write or read. The scene's depth comes first.",
        format!(
            "{visible}static ATTACHMENTS: &[Attachment] = &[{}]",
            attachments.join(", ")
        ),
    );
    let test = plan.self_test.as_ref().and_then(|t| self_test(plan, t));
    let test = test.map_or("None".to_owned(), |t| format!("Some({t})"));
    item(
        "Run it when you load the material. If it fails, draw `original`.",
        format!("{visible}static SELF_TEST: Option<SelfTest> = {test}"),
    );
    Ok(items)
}

/// A name for each pass: its role, with a number if several passes have the same role.
fn pass_names(plan: &Plan) -> Vec<String> {
    let role = |i: usize| plan.passes[i].role;
    (0..plan.passes.len())
        .map(|i| {
            let name = role(i).name().to_uppercase();
            match (0..i).filter(|j| role(*j) == role(i)).count() {
                0 => name,
                earlier => format!("{name}_{}", earlier + 1),
            }
        })
        .collect()
}

fn raster(
    plan: &Plan,
    pass: &GpuPass,
    wgsl: &str,
    shared: &Shared<'_>,
    constants: &Constants<'_>,
) -> Result<String, String> {
    let program = plan.program(pass);
    no_arrays(program, &pass.bindings)?;
    let immediates = program.map_or(0, |p| limits::immediate_size(p, &pass.stages()));
    let free = !pass.phase.is_of_frame() || samples_are_free(plan);
    let depth = pass.depth.as_ref().map(|d| depth(plan, pass, d));
    let depth = depth.transpose()?.flatten();
    let depth = depth.map_or("None".to_owned(), |d| format!("Some({d})"));
    let mut targets: Vec<String> = Vec::new();
    let mut colors: Vec<String> = Vec::new();
    for target in &pass.targets {
        let Some(target) = target else {
            targets.push("None".to_owned());
            colors.push("None".to_owned());
            continue;
        };
        if let Some(why) = words::no_target(&target.format) {
            return Err(why);
        }
        targets.push(format!("Some({})", words::color_target(target)));
        colors.push(format!(
            "Some(Color {{ attachment: {:?}, ops: {} }})",
            target.attachment,
            ops(target.ops)
        ));
    }
    let attributes: Vec<String> = pass
        .attributes
        .iter()
        .map(|a| {
            let (format, _) = words::vertex_format(&a.ty).ok_or_else(|| {
                format!(
                    "the attribute `{}` is of the type {}, which no vertex format of WebGPU holds",
                    a.name, a.ty
                )
            })?;
            Ok(format!(
                "Attribute {{ location: {}, name: {:?}, format: wgpu::VertexFormat::{format} }}",
                a.location, a.name
            ))
        })
        .collect::<Result<_, String>>()?;
    let draws = match pass.draws {
        Draws::All => "All",
        Draws::Opaque => "Opaque",
        Draws::Once => "Once",
    };
    let geometry = match pass.geometry.is_as_given() {
        true => "as-given".to_owned(),
        false => json(&pass.geometry),
    };
    Ok(format!(
        "Pass {{ role: {:?}, phase: Phase::{:?}, wgsl: {wgsl}, vertex: {:?}, fragment: {:?}, \
         primitive: {}, depth: {depth}, multisample: {}, targets: &[{}], colors: &[{}], groups: \
         {}, attributes: &[{}], features: {}, raise_limits: {}, draws: Draws::{draws}, geometry: \
         {geometry:?}, view_dependent: &{:?}, immediate_size: {immediates}, {}, samples_are_free: \
         {free} }}",
        pass.role.name(),
        pass.phase,
        pass.vertex,
        pass.fragment,
        words::primitive(&pass.primitive),
        words::multisample(&pass.multisample),
        targets.join(", "),
        colors.join(", "),
        shared.groups(&pass.bindings, PassKind::Raster),
        attributes.join(", "),
        words::features(&pass.features)?,
        words::raise_limits(&pass.limits),
        pass.view_dependent,
        constants.fields(),
    ))
}

/// The pipeline-overridable constants of a pass.
struct Constants<'p> {
    /// The constants that its program reads.
    own: &'p [Override],
    /// Keys of all constants of the material.
    keys: &'p BTreeSet<String>,
}

impl<'p> Constants<'p> {
    fn of(
        overrides: &'p BTreeMap<&str, Vec<Override>>,
        program: &str,
        keys: &'p BTreeSet<String>,
    ) -> Self {
        Self {
            own: overrides.get(program).map_or(&[][..], Vec::as_slice),
            keys,
        }
    }

    /// The fields of `Pass` and `Compute` for constants.
    fn fields(&self) -> String {
        let listed: Vec<String> = self
            .own
            .iter()
            .map(|o| {
                format!(
                    "Override {{ key: {:?}, is_needed: {} }}",
                    o.key, o.is_needed
                )
            })
            .collect();
        let unread = self.keys.iter();
        let unread: Vec<&String> = unread
            .filter(|key| !self.own.iter().any(|o| o.key == **key))
            .collect();
        format!(
            "overrides: &[{}], unread_overrides: &{unread:?}, guard: GUARD",
            listed.join(", ")
        )
    }
}

fn no_arrays(program: Option<&Program>, bindings: &[BindingUse]) -> Result<(), String> {
    let array = |b: &&BindingUse| program.is_some_and(|p| reflect::is_array(p.module(), b));
    match bindings.iter().find(array) {
        None => Ok(()),
        Some(array) => Err(format!(
            "`{}` is a binding array, which the generated module has no words for; \
             `preshade rewrite` writes the shaders alone",
            array.name
        )),
    }
}

fn compute(
    plan: &Plan,
    pass: &ComputePass,
    wgsl: &str,
    shared: &Shared<'_>,
    constants: &Constants<'_>,
) -> Result<String, String> {
    let program = plan.programs.get(&pass.program);
    no_arrays(program, &pass.bindings)?;
    let stages = [(naga::ShaderStage::Compute, pass.entry_point.as_str())];
    let immediates = program.map_or(0, |p| limits::immediate_size(p, &stages));
    Ok(format!(
        "Compute {{ wgsl: {wgsl}, entry_point: {:?}, workgroup: {}, geometry: {:?}, when: {:?}, \
         groups: {}, features: {}, raise_limits: {}, immediate_size: {immediates}, {} }}",
        pass.entry_point,
        pass.workgroup,
        json(&pass.geometry),
        json(&pass.when),
        shared.groups(&pass.bindings, PassKind::Compute),
        words::features(&pass.features)?,
        words::raise_limits(&pass.limits),
        constants.fields(),
    ))
}

/// `None` if the attachment is not a depth attachment.
fn depth(plan: &Plan, pass: &GpuPass, depth: &DepthState) -> Result<Option<String>, String> {
    let Some((clear, format)) = plan.attachment(&depth.attachment).and_then(|attachment| {
        let ClearValue::Depth(clear) = attachment.clear else {
            return None;
        };
        Some((clear, attachment.format.depth()?))
    }) else {
        return Ok(None);
    };
    for (what, number) in [
        ("the slope scale of the depth bias", depth.bias.slope_scale),
        ("the clamp of the depth bias", depth.bias.clamp),
        ("what depth is cleared to", clear),
    ] {
        if !number.is_finite() {
            return Err(format!(
                "{what} is {number}, which no pipeline takes: give a finite number"
            ));
        }
    }
    let stencil_ops = depth.stencil_ops;
    Ok(Some(format!(
        "DepthUse {{ attachment: {:?}, state: {}, stencil_reference: {}, read_only: {}, clear: \
         {clear:?}, ops: {}, stencil_ops: {} }}",
        depth.attachment,
        words::depth_stencil(format, depth, pass.stencil.as_ref()),
        pass.stencil.as_ref().map_or(0, |s| s.reference),
        depth.read_only,
        ops(depth.ops),
        stencil_ops.map_or("None".to_owned(), |o| format!("Some({})", ops(o))),
    )))
}

fn ops(ops: AttachmentOps) -> String {
    format!(
        "Ops {{ clear_first: {}, store: wgpu::StoreOp::{:?} }}",
        ops.load == LoadOp::ClearFirst,
        ops.store
    )
}

fn attachment(attachment: &Attachment) -> String {
    let sampled = match attachment.sampled {
        true => ".union(wgpu::TextureUsages::TEXTURE_BINDING)",
        false => "",
    };
    format!(
        "Attachment {{ name: {:?}, format: {}, samples: {}, usage: \
         wgpu::TextureUsages::RENDER_ATTACHMENT{sampled} }}",
        attachment.name,
        words::attachment_format(&attachment.format),
        attachment.samples,
    )
}

/// `None` if it names a pass that does not exist.
fn self_test(plan: &Plan, test: &SelfTest) -> Option<String> {
    let names = pass_names(plan);
    let path = |draw: &SelfTestDraw| {
        let place = |plan: &Plan| plan.passes.iter().position(|p| p.role == draw.role);
        let own = place(plan).filter(|_| !draw.original);
        own.map(|i| names[i].clone()).or_else(|| {
            let original = plan.original.as_ref()?;
            let at = place(original)?;
            Some(format!("super::original::{}", pass_names(original)[at]))
        })
    };
    let attachments = || std::iter::once(&test.attachment).chain(&plan.attachments);
    let clear = |name: &str| match attachments().find(|a| a.name == name)?.clear {
        ClearValue::Depth(clear) => Some(clear),
        _ => None,
    };
    let mut runs = Vec::new();
    for run in &test.runs {
        let mut draws = Vec::new();
        for draw in &run.draws {
            draws.push(format!(
                "TestDraw {{ pass: &{}, attachment: {:?}, compare: wgpu::CompareFunction::{:?}, \
                 write: {}, clear: {:?}, must_pass: {} }}",
                path(draw)?,
                draw.attachment,
                draw.compare,
                draw.write,
                clear(&draw.attachment)?,
                draw.samples == SamplesPassed::Some
            ));
        }
        runs.push(format!(
            "Run {{ failure: {:?}, draws: &[{}] }}",
            run.failure,
            draws.join(", ")
        ));
    }
    let attachments: Vec<String> = attachments().map(attachment).collect();
    Some(format!(
        "SelfTest {{ attachments: &[{}], runs: &[{}] }}",
        attachments.join(", "),
        runs.join(", ")
    ))
}
