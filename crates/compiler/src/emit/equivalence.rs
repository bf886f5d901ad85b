//! Tests that `tidy` preserves the program. The texts before and after must have the same effects
//! in the same order with the same values. Two loads of a variable are equal only if nothing
//! between them can change it.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use naga::{AddressSpace, Block, Expression, Function, Handle, Module, Statement};
use preshade_plan::program::Program;

use crate::front::{self, Source};
use crate::wgsl::{self, tidy};
use shader_text::error::Color;
use shader_text::options::Options;

/// The effects of a module in order, one line per effect or control flow.
fn effects(module: &Module) -> Vec<String> {
    let functions = module.functions.iter().map(|(_, f)| f);
    let entries = module.entry_points.iter().map(|e| &e.function);
    let mut lines = Vec::new();
    for function in functions.chain(entries) {
        lines.push(format!("fn {:?}", function.name));
        let mut trace = Trace {
            module,
            function,
            values: HashMap::new(),
            lines: &mut lines,
        };
        // Expressions without an `Emit` are available from the start.
        for (handle, _) in function.expressions.iter() {
            trace.evaluate(handle);
        }
        trace.block(&function.body);
    }
    lines
}

struct Trace<'a> {
    module: &'a Module,
    function: &'a Function,
    values: HashMap<Handle<Expression>, u64>,
    lines: &'a mut Vec<String>,
}

impl Trace<'_> {
    /// Hashes an expression from its operands' hashes. A load also hashes the number of preceding
    /// effects.
    fn evaluate(&mut self, handle: Handle<Expression>) {
        let mut expression = self.function.expressions[handle].clone();
        let mut operand_values = Vec::new();
        let (first, _) = self.function.expressions.iter().next().unwrap();
        naga_operands::map_expression(&mut expression, &mut |e| {
            operand_values.push(self.values.get(e).copied());
            // Handles differ between the texts.
            *e = first;
        });
        let mut hasher = DefaultHasher::new();
        operand_values.hash(&mut hasher);
        match &expression {
            Expression::Load { .. } => {
                "load".hash(&mut hasher);
                if !self.reads_constant_memory(handle) {
                    self.lines.len().hash(&mut hasher);
                }
            }
            Expression::LocalVariable(l) => {
                self.function.local_variables[*l].name.hash(&mut hasher);
            }
            Expression::CallResult(_) => "call result".hash(&mut hasher),
            other => format!("{other:?}").hash(&mut hasher),
        }
        self.values.insert(handle, hasher.finish());
    }

    fn reads_constant_memory(&self, load: Handle<Expression>) -> bool {
        let mut at = load;
        loop {
            match &self.function.expressions[at] {
                Expression::Load { pointer: e }
                | Expression::Access { base: e, .. }
                | Expression::AccessIndex { base: e, .. } => at = *e,
                Expression::GlobalVariable(g) => {
                    return self.module.global_variables[*g].space == AddressSpace::Uniform;
                }
                _ => return false,
            }
        }
    }

    fn block(&mut self, block: &Block) {
        for statement in block.iter() {
            let mut statement = statement.clone();
            match &statement {
                Statement::Emit(range) => {
                    range.clone().for_each(|e| self.evaluate(e));
                    continue;
                }
                Statement::Block(inner) => {
                    self.block(inner);
                    continue;
                }
                _ => {}
            }
            let mut values = Vec::new();
            naga_operands::map_statement_and_result(&mut statement, &mut |e| {
                values.push(self.values.get(e).copied())
            });
            let kind = format!("{statement:?}");
            let kind = kind.split([' ', '{', '(']).next().unwrap().to_owned();
            // The continuing block evaluates a loop's `break_if`.
            let before = if kind == "Loop" { Vec::new() } else { values };
            self.lines.push(format!("{kind} {before:?}"));
            if let Statement::Switch { cases, .. } = &statement {
                let labels: Vec<_> = cases.iter().map(|c| (c.value, c.fall_through)).collect();
                self.lines.push(format!("{labels:?}"));
            }
            if let Statement::Call {
                result: Some(result),
                ..
            } = &statement
            {
                let mut hasher = DefaultHasher::new();
                self.lines.len().hash(&mut hasher);
                self.values.insert(*result, hasher.finish());
            }
            for inner in naga_operands::blocks_mut(&mut statement) {
                self.block(inner);
                self.lines.push("end".to_owned());
            }
        }
    }
}

fn prove(name: &str, text: &str) {
    let parsed = front::parse(&[Source::new(name, text)], &Options::default());
    let program: Program = match parsed {
        Ok(parsed) => parsed.program,
        Err(e) if e.code() == shader_text::error::Code::AmbiguousEntryPoint => {
            let module = naga::front::wgsl::parse_str(text).unwrap();
            Program::new(
                module,
                std::sync::Arc::default(),
                shader_text::source::Language::Wgsl,
            )
            .unwrap()
        }
        Err(e) => panic!("{}", e.render(Color::Never)),
    };
    let (program, raw) = wgsl::written(&program).unwrap();
    let tidied = tidy::tidy(program.module(), &raw);
    let read = |text: &str| {
        naga::front::wgsl::parse_str(text)
            .unwrap_or_else(|e| panic!("{}\n{text}", e.emit_to_string(text)))
    };
    // Locals are compared by name, so remove the numbers that `tidy` removes.
    let names = |module: Module| {
        let mut module = module;
        let strip = |function: &mut Function| {
            for (_, local) in function.local_variables.iter_mut() {
                if let Some(name) = &mut local.name
                    && let Some((base, number)) = name.rsplit_once('_')
                    && number.bytes().all(|b| b.is_ascii_digit())
                {
                    *name = base.to_owned();
                }
            }
        };
        module.functions.iter_mut().for_each(|(_, f)| strip(f));
        module
            .entry_points
            .iter_mut()
            .for_each(|e| strip(&mut e.function));
        module
    };
    let (before, after) = (effects(&names(read(&raw))), effects(&names(read(&tidied))));
    assert!(before.len() > 3, "{name} does something");
    for (i, (b, a)) in before.iter().zip(&after).enumerate() {
        assert_eq!(b, a, "{name}: effect {i}\n{raw}\n{tidied}");
    }
    assert_eq!(before.len(), after.len());
}

#[test]
fn loads_stay_before_the_stores_they_precede() {
    prove(
        "order.wgsl",
        "var<private> g: i32 = 1;
        @group(0) @binding(0) var<storage, read_write> buffer: array<i32, 8>;
        @group(0) @binding(1) var<uniform> u: array<vec4<i32>, 4>;
        @group(0) @binding(2) var t: texture_2d<f32>;
        fn bump() -> i32 { g = g + 1; return g; }
        fn both(p: ptr<function, i32>) -> i32 { let old = *p; *p = old + g; return old; }
        @vertex fn vs() -> @builtin(position) vec4<f32> {
            var a = 1;
            var b = 2;
            let swap = a;
            a = b;
            b = swap;
            a += g * bump() + g;
            b = both(&a) + a;
            for (var i = 0; i < u[b & 3].x; i++) {
                let before = g;
                if bump() > u[i & 3].y { continue; }
                buffer[i & 7] = before + buffer[a & 7];
                while g < 10 { g += bump(); if g == 7 { break; } }
            }
            loop { a -= 1; if a < 0 { break; } continuing { b += a; break if b > 9; } }
            let texel = textureLoad(t, vec2(a, b), 0);
            a = 5;
            return texel * f32(a) + f32(b);
        }",
    );
}

#[test]
fn fixtures_are_unchanged_by_tidying() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures");
    let mut proved = 0;
    for folder in ["shaders", "handwritten"] {
        let Ok(entries) = std::fs::read_dir(root.join(folder)) else {
            continue;
        };
        for path in entries.map(|e| e.unwrap().path()) {
            if path.extension().is_some_and(|e| e == "wgsl") {
                let name = path.display().to_string();
                prove(&name, &std::fs::read_to_string(&path).unwrap());
                proved += 1;
            }
        }
    }
    assert!(proved > 0);
}
