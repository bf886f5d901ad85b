//! Copies a function into another, statement by statement. A pass overrides how certain expressions
//! and statements are copied.

use naga::{Block, Expression, Function, Handle, Span, Statement};

use super::writer::FunctionWriter;

/// The copy of each expression of a function.
#[derive(Clone, Debug)]
pub struct Copies(Vec<Option<Handle<Expression>>>);

impl Copies {
    /// Starts without copies.
    pub fn of(original: &Function) -> Self {
        Self(vec![None; original.expressions.len()])
    }

    /// The copy of an expression, if there is one.
    pub fn get(&self, e: Handle<Expression>) -> Option<Handle<Expression>> {
        self.0[e.index()]
    }

    /// The copy of an expression, or the expression itself.
    pub fn mapped(&self, e: Handle<Expression>) -> Handle<Expression> {
        self.get(e).unwrap_or(e)
    }

    /// Sets the copy of an expression.
    pub fn insert(&mut self, e: Handle<Expression>, copy: Handle<Expression>) {
        self.0[e.index()] = Some(copy);
    }

    /// The expression, with its operands replaced by their copies.
    pub fn with_operands(&self, expression: &Expression) -> Expression {
        let mut copy = expression.clone();
        naga_operands::map_expression(&mut copy, &mut |o| *o = self.mapped(*o));
        copy
    }

    /// Copies an expression that needs no evaluation, after its operands.
    pub fn constant(
        &mut self,
        original: &Function,
        e: Handle<Expression>,
        to: &mut Function,
    ) -> Handle<Expression> {
        if let Some(copy) = self.get(e) {
            return copy;
        }
        let expression = &original.expressions[e];
        for operand in naga_operands::of_expression(expression) {
            self.constant(original, operand, to);
        }
        let span = original.expressions.get_span(e);
        let copy = to.expressions.append(self.with_operands(expression), span);
        self.insert(e, copy);
        copy
    }
}

#[derive(Debug)]
pub struct Copying<'a> {
    /// The function that is copied.
    pub original: &'a Function,
    pub copies: Copies,
    /// The function that is written.
    pub writer: FunctionWriter,
}

impl<'a> Copying<'a> {
    /// Starts with no copies of `original`.
    pub fn new(original: &'a Function, writer: FunctionWriter) -> Self {
        Self {
            original,
            copies: Copies::of(original),
            writer,
        }
    }

    /// Appends `copy` as the copy of an expression.
    pub fn append(&mut self, e: Handle<Expression>, copy: Expression) {
        let span = self.original.expressions.get_span(e);
        let copy = self.writer.append(copy, span);
        self.copies.insert(e, copy);
    }

    /// Copies the initialisers of the variables, the first variables of the new function. A
    /// statement may also evaluate an initialiser, as in naga's GLSL front end. The initialiser
    /// must be outside of any `Emit`, so it gets a separate copy.
    pub fn initialisers(&mut self) {
        let mut copies = Copies::of(self.original);
        for (handle, variable) in self.original.local_variables.iter() {
            let to = &mut self.writer.function;
            let init = variable.init;
            let init = init.map(|e| copies.constant(self.original, e, to));
            to.local_variables[handle].init = init;
        }
    }

    /// The new function, with the names of the original's expressions.
    pub fn finish(self) -> Function {
        let mut function = self.writer.finish();
        for (e, name) in &self.original.named_expressions {
            if let Some(copy) = self.copies.get(*e) {
                function.named_expressions.insert(copy, name.clone());
            }
        }
        function
    }
}

/// Copies a function. By default each expression and statement has an equal copy.
pub trait CopyFunction<'a> {
    /// The function that is being copied.
    fn copying(&mut self) -> &mut Copying<'a>;

    /// Copies an expression. An `Emit` is open if a statement evaluates it.
    fn expression(&mut self, e: Handle<Expression>) {
        let copying = self.copying();
        let copy = copying
            .copies
            .with_operands(&copying.original.expressions[e]);
        copying.append(e, copy);
    }

    /// The copy of an expression that a statement reads.
    fn operand(&mut self, e: Handle<Expression>) -> Handle<Expression> {
        self.copying().copies.mapped(e)
    }

    /// Copies the expression whose value a statement provides.
    fn result(&mut self, e: Handle<Expression>) -> Handle<Expression> {
        self.expression(e);
        self.copying().copies.mapped(e)
    }

    /// Copies the expressions of an `Emit`.
    fn emit(&mut self, range: naga::Range<Expression>, span: Span) {
        self.copying().writer.begin();
        range.for_each(|e| self.expression(e));
        self.copying().writer.flush(span);
    }

    /// Copies a statement other than `Emit`.
    fn statement(&mut self, statement: &'a Statement, span: Span) {
        let copy = self.copied(statement, span);
        self.copying().writer.statement(copy, span);
    }

    fn copy(&mut self, statement: &'a Statement, span: Span) {
        match statement {
            Statement::Emit(range) => self.emit(range.clone(), span),
            _ => self.statement(statement, span),
        }
    }

    /// Copies a block's statements to the current block.
    fn block(&mut self, block: &'a Block) {
        for (statement, span) in block.span_iter() {
            self.copy(statement, *span);
        }
    }

    /// The copy of a statement other than `Emit`, with its result and blocks.
    fn copied(&mut self, statement: &'a Statement, span: Span) -> Statement {
        self.copying().writer.flush(span);
        let mut copy = naga_operands::shell(statement);
        if let Some(result) = naga_operands::result_mut(&mut copy) {
            *result = self.result(*result);
        }
        let mut inner = Vec::new();
        for block in naga_operands::blocks(statement) {
            let enclosing = self.copying().writer.open(span);
            self.block(block);
            inner.push(self.copying().writer.close(enclosing, span));
        }
        naga_operands::fill(&mut copy, statement, inner);
        // A loop's `break_if` may read expressions of its blocks, so map operands last.
        naga_operands::map_statement(&mut copy, &mut |o| *o = self.operand(*o));
        copy
    }

    /// Copies the expressions that no statement evaluates.
    fn unevaluated(&mut self) {
        let original = self.copying().original;
        let mut is_evaluated = vec![false; original.expressions.len()];
        naga_operands::evaluated(&original.body, &mut |e| is_evaluated[e.index()] = true);
        for (e, _) in original.expressions.iter() {
            if !is_evaluated[e.index()] {
                self.expression(e);
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    struct PlainCopy<'a>(Copying<'a>);

    impl<'a> CopyFunction<'a> for PlainCopy<'a> {
        fn copying(&mut self) -> &mut Copying<'a> {
            &mut self.0
        }
    }

    fn copy(original: &Function) -> Function {
        let mut copy = PlainCopy(Copying::new(original, FunctionWriter::like(original)));
        copy.unevaluated();
        copy.0.initialisers();
        copy.block(&original.body);
        copy.0.finish()
    }

    fn is_valid(module: &naga::Module) -> bool {
        let flags = naga::valid::ValidationFlags::all();
        let capabilities = naga::valid::Capabilities::all();
        let mut validator = naga::valid::Validator::new(flags, capabilities);
        validator.validate(module).is_ok()
    }

    #[test]
    fn a_copy_is_valid_and_its_copy_is_the_same() {
        let mut module = naga::front::wgsl::parse_str(
            "var<workgroup> count: atomic<u32>;
             fn half(x: f32) -> f32 { if x > 9.0 { return x; } return x * 0.5; }
             fn every(n: i32) -> f32 {
                 var sum: f32;
                 var i: i32;
                 loop {
                     let old = atomicAdd(&count, 1u);
                     sum += half(f32(i)) + f32(old);
                     switch i { case 1, 2: { sum += 1.0; } default: { sum -= 1.0; } }
                     continuing { i += 1; let last = i - n; break if last > 0; }
                 }
                 return sum;
             }",
        )
        .unwrap();
        for (_, function) in module.functions.iter_mut() {
            let first = copy(function);
            assert_eq!(format!("{first:?}"), format!("{:?}", copy(&first)));
            assert_eq!(
                first.named_expressions.values().collect::<Vec<_>>(),
                function.named_expressions.values().collect::<Vec<_>>()
            );
            *function = first;
        }
        assert!(is_valid(&module));
    }

    #[test]
    fn an_initialiser_that_a_statement_evaluates_gets_its_own_copy() {
        let mut module =
            naga::front::wgsl::parse_str("fn f() -> vec2<f32> { var v = vec2(1.0); return v; }")
                .unwrap();
        let (handle, function) = module.functions.iter_mut().next().unwrap();
        // As in naga's GLSL front end, which emits the initialiser too.
        let init = function.local_variables.iter().next().unwrap().1.init;
        let init = init.unwrap();
        let emit = Statement::Emit(naga::Range::new_from_bounds(init, init));
        let body = std::mem::take(&mut function.body);
        function.body.push(emit, Span::UNDEFINED);
        function.body.extend_block(body);
        let copied = copy(function);
        let (_, variable) = copied.local_variables.iter().next().unwrap();
        let mut is_evaluated = false;
        naga_operands::evaluated(&copied.body, &mut |e| {
            is_evaluated |= Some(e) == variable.init
        });
        assert!(variable.init.is_some() && !is_evaluated);
        module.functions[handle] = copied;
        assert!(is_valid(&module));
    }
}
