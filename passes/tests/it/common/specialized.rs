//! Materials specialised, and their fragment stages run.

use std::collections::BTreeMap;

use naga::ShaderStage;
use naga_interp::{Environment, Stuck, Value};
use preshade_passes::transforms::specialize::{Specialize, SpecializeParams};
use preshade_plan::guard::{Assumed, Bounds, Place, ScalarType};
use preshade_plan::pass::{Constant, Facts, Pass};
use preshade_plan::plan::Plan;
use preshade_plan::state::MaterialState;

/// The plan of a material with the entry points `vs` and `fs`.
pub fn original(source: &str) -> Plan {
    let program = super::program(source);
    Plan::original("test", program, "vs", Some("fs"), &MaterialState::default())
}

/// Values to assume.
pub fn set(values: &str) -> SpecializeParams {
    SpecializeParams {
        set: Some(values.to_owned()),
        ..SpecializeParams::default()
    }
}

/// The plan, or why not.
pub fn specialized(plan: &Plan, params: &SpecializeParams) -> Result<Plan, String> {
    specialized_with(plan, &Facts::default(), params)
}

/// The plan with what is known of its material, or why not.
pub fn specialized_with(
    plan: &Plan,
    facts: &Facts,
    params: &SpecializeParams,
) -> Result<Plan, String> {
    match Specialize::run(plan, facts, params) {
        Ok(done) => Ok(done.plan),
        Err(refused) => Err(refused.first().to_string()),
    }
}

/// A texture of group 0 whose every red is `value`.
pub fn facts_of_texture(binding: u32, value: f64) -> Facts {
    let value = Assumed {
        name: "texture.r".to_owned(),
        place: Place::Texture {
            group: 0,
            binding,
            channel: 0,
        },
        ty: ScalarType::F32,
        bounds: Bounds::one(value),
    };
    Facts {
        constants: vec![Constant {
            material: "test".to_owned(),
            value,
        }],
        ..Facts::default()
    }
}

/// The plan's program as WGSL, which must parse.
pub fn text(plan: &Plan) -> String {
    super::wgsl(plan.program(plan.main().unwrap()).unwrap())
}

/// What a fragment stage writes whose one argument is `p`, with this content of the uniform of
/// group 0 and binding 0.
pub fn ran(plan: &Plan, uniform: &Value, p: [f32; 4]) -> Result<Option<Value>, Stuck> {
    let program = plan.program(plan.main().unwrap()).unwrap();
    let (entry, point) = program.entry_point(ShaderStage::Fragment, "fs").unwrap();
    let p = Value::Composite(p.map(Value::f32).to_vec());
    let arguments = vec![p; point.function.arguments.len()];
    let environment = Environment {
        resources: BTreeMap::from([((0, 0), uniform.clone())]).into(),
        texture: &|_| [0.0; 4],
        derivative: None,
        trace: None,
        steps: 200_000,
    };
    naga_interp::entry_point(program.module(), entry, &arguments, &environment).map(|o| o.result)
}
