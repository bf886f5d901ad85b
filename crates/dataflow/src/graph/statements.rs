//! Numbers statements in preorder, and finds where each expression is evaluated.

use naga::{Block, Expression, Function, Handle, Span, Statement};

/// A statement of one function, numbered in preorder from 0: a statement before the statements in
/// its blocks, `accept` before `reject`, cases in order, `body` before `continuing`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StmtId(pub(crate) u32);

impl StmtId {
    /// Position in preorder, from 0.
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

impl From<usize> for StmtId {
    fn from(index: usize) -> Self {
        Self(index as u32)
    }
}

/// A statement and its place in the function.
#[derive(Clone, Copy, Debug)]
pub struct StatementNode<'p> {
    pub statement: &'p Statement,
    /// Its span in the author's source.
    pub span: Span,
    /// The statement whose block contains it.
    pub parent: Option<StmtId>,
    /// The first statement after it in preorder that is not inside it.
    pub end: StmtId,
}

/// All statements of a function by [`StmtId`].
#[derive(Clone, Debug)]
pub struct Statements<'p> {
    nodes: Vec<StatementNode<'p>>,
    evaluated_at: Vec<Option<StmtId>>,
}

impl<'p> Statements<'p> {
    /// Numbers the statements of a function.
    pub fn new(function: &'p Function) -> Self {
        let mut this = Self {
            nodes: Vec::new(),
            evaluated_at: vec![None; function.expressions.len()],
        };
        this.block(&function.body, None);
        this
    }

    fn block(&mut self, block: &'p Block, parent: Option<StmtId>) {
        for (statement, span) in block.span_iter() {
            let id = StmtId::from(self.nodes.len());
            self.nodes.push(StatementNode {
                statement,
                span: *span,
                parent,
                end: id,
            });
            if let Statement::Emit(range) = statement {
                for expression in range.clone() {
                    self.evaluated_at[expression.index()] = Some(id);
                }
            }
            if let Some(result) = naga_operands::result(statement) {
                self.evaluated_at[result.index()] = Some(id);
            }
            for inner in naga_operands::blocks(statement) {
                self.block(inner, Some(id));
            }
            self.nodes[id.index()].end = StmtId::from(self.nodes.len());
        }
    }

    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether the function has no statement.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    pub fn get(&self, id: StmtId) -> StatementNode<'p> {
        self.nodes[id.index()]
    }

    /// All statements in preorder.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (StmtId, &StatementNode<'p>)> {
        self.nodes
            .iter()
            .enumerate()
            .map(|(i, n)| (StmtId::from(i), n))
    }

    /// The `Emit`, or the statement that provides the value, at which an expression is evaluated.
    /// `None` for constants, arguments, variables and dead expressions.
    pub fn evaluated_at(&self, expression: Handle<Expression>) -> Option<StmtId> {
        self.evaluated_at[expression.index()]
    }

    /// The statements around `id`, innermost first.
    pub fn ancestors(&self, id: StmtId) -> impl Iterator<Item = StmtId> + '_ {
        std::iter::successors(self.get(id).parent, |p| self.get(*p).parent)
    }
}
