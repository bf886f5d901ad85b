//! What the interpreter takes on: values are bounded as variables are, and what is bound is not
//! copied for each run.

use naga_interp::{Environment, RunResult, Stuck, Value};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::Arc;

type Resources = Arc<BTreeMap<(u32, u32), Value>>;

/// Runs the fragment stage of a text.
fn run(text: &str, resources: &Resources, steps: u64) -> Result<RunResult, Stuck> {
    let module = naga::front::wgsl::parse_str(text).unwrap();
    let environment = Environment {
        resources: Arc::clone(resources),
        texture: &|_| [0.0; 4],
        derivative: None,
        trace: None,
        steps,
    };
    naga_interp::entry_point(&module, 0, &[], &environment)
}

fn stuck(text: &str) -> Stuck {
    run(text, &Resources::default(), u64::MAX).unwrap_err()
}

const TOO_MANY: &str = "values of more than 1048576 numbers";

#[test]
fn loads_of_one_large_variable_are_counted() {
    let mut loads = String::new();
    for i in 0..1000 {
        writeln!(loads, "let a{i} = b;").unwrap();
    }
    let text = format!(
        "var<private> b: array<f32, 65536>;
        @fragment fn fs() -> @location(0) f32 {{ {loads} return a0[3] + a999[4]; }}"
    );
    // 2 MiB each.
    assert_eq!(stuck(&text), Stuck::Unsupported(TOO_MANY.to_owned()));
    // Ahead of that each counts as the work that it is.
    let short = run(&text, &Resources::default(), 200_000);
    assert_eq!(short.unwrap_err(), Stuck::Steps);
}

#[test]
fn a_zero_is_counted_before_it_is_made() {
    let large = "array<mat4x4<f32>, 4000000>";
    for (head, value) in [
        ("", format!("{large}()")),
        (&format!("const c = {large}();")[..], "c".to_owned()),
    ] {
        let text = format!(
            "{head} fn first(given: {large}) -> f32 {{ return given[0][0][0]; }}
            @fragment fn fs() -> @location(0) f32 {{ return first({value}); }}"
        );
        assert_eq!(stuck(&text), Stuck::Unsupported(TOO_MANY.to_owned()));
    }
}

#[test]
fn arguments_are_counted_for_as_long_as_they_are_there() {
    // Twenty calls with a value each, one after the other, are no more than one.
    let calls = "at += first(b);".repeat(20);
    let text = format!(
        "var<private> b: array<f32, 60000>;
        fn first(given: array<f32, 60000>) -> f32 {{ return given[0]; }}
        fn several() -> f32 {{ return first(b); }}
        @fragment fn fs() -> @location(0) f32 {{ var at = 0.0; {} return at; }}",
        calls.replace("first(b)", "several()")
    );
    assert!(run(&text, &Resources::default(), u64::MAX).is_ok());
}

#[test]
fn what_is_not_used_is_not_made() {
    let text = "@group(0) @binding(0) var<storage, read_write> big: array<mat4x4<f32>, 4000000>;
        var<private> also: array<mat4x4<f32>, 4000000>;
        @fragment fn fs() -> @location(0) f32 { return 2.0; }";
    let outcome = run(text, &Resources::default(), 100).unwrap();
    assert_eq!(outcome.result, Some(Value::f32(2.0)));
    assert!(outcome.stored.is_empty());
    let used = text.replace("2.0", "big[7][0][0]");
    assert!(matches!(stuck(&used), Stuck::Unsupported(_)));
}

#[test]
fn a_buffer_is_copied_where_it_is_written_and_nowhere_else() {
    const LONG: usize = 100_000;
    let numbers = vec![3.0; LONG];
    let resources = Resources::new(BTreeMap::from([((0, 0), Value::vector(&numbers))]));
    let text = "@group(0) @binding(0) var<storage, read_write> long: array<f32, 100000>;
        @fragment fn fs() -> @location(0) f32 { BODY return long[7]; }";
    let read = run(&text.replace("BODY", ""), &resources, 100).unwrap();
    assert_eq!(read.result, Some(Value::f32(3.0)));
    assert!(read.steps < 20, "{}", read.steps);
    let written = text.replace("BODY", "long[7] = 5.0; long[8] = 6.0;");
    let outcome = run(&written, &resources, u64::MAX).unwrap();
    assert_eq!(outcome.result, Some(Value::f32(5.0)));
    // A step for each number beyond those of a matrix, once.
    let copied = (LONG as u64 - 16)..(LONG as u64 + 100);
    assert!(copied.contains(&outcome.steps), "{}", outcome.steps);
    assert_eq!(outcome.stored[&(0, 0)].parts().unwrap()[7], Value::f32(5.0));
    // The next run finds what the first one found.
    let again = run(&text.replace("BODY", ""), &resources, 100).unwrap();
    assert_eq!(again.result, Some(Value::f32(3.0)));
    assert_eq!(again.stored[&(0, 0)], resources[&(0, 0)]);
}

#[test]
fn a_part_is_taken_without_the_whole() {
    let text = "var<private> b: array<f32, 60000>;
        @fragment fn fs() -> @location(0) f32 {
            let a = b;
            var sum = 0.0;
            for (var i = 0; i < 1000; i++) { sum += a[i]; }
            return sum;
        }";
    let outcome = run(text, &Resources::default(), u64::MAX).unwrap();
    assert!(outcome.steps < 200_000, "{}", outcome.steps);
}
