//! Functions of matrices, stored by columns.

use super::Stuck;
use super::number::Number;
use super::value::Value;
use naga::BinaryOperator as B;

type Columns<F> = Vec<Vec<F>>;

fn columns<F: Number>(matrix: &Value<F>) -> Result<Columns<F>, Stuck> {
    let columns = matrix.parts()?.iter().map(Value::floats);
    let columns: Columns<F> = columns.collect::<Result<_, _>>()?;
    match columns.iter().all(|c| c.len() == columns.len()) {
        true => Ok(columns),
        false => Err(Stuck::Type("a matrix that is no square".to_owned())),
    }
}

fn of<F: Number>(op: B, a: F, b: F) -> Result<F, Stuck> {
    F::binary(op, a, b).ok_or_else(|| Stuck::Unsupported(format!("{op:?} of floats")))
}

/// The determinant, along the first column.
pub(crate) fn determinant<F: Number>(matrix: &Value<F>) -> Result<F, Stuck> {
    determinant_of(&columns(matrix)?)
}

fn determinant_of<F: Number>(m: &Columns<F>) -> Result<F, Stuck> {
    if let [one] = &m[..] {
        return Ok(one[0]);
    }
    let mut sum: Option<F> = None;
    for (row, number) in m.first().into_iter().flatten().enumerate() {
        let product = of(B::Multiply, *number, determinant_of(&minor(m, 0, row))?)?;
        sum = Some(match (sum, row % 2) {
            (None, _) => product,
            (Some(sum), 0) => of(B::Add, sum, product)?,
            (Some(sum), _) => of(B::Subtract, sum, product)?,
        });
    }
    sum.ok_or_else(|| Stuck::Type("an empty matrix".to_owned()))
}

/// The matrix without one column and one row.
fn minor<F: Number>(m: &Columns<F>, column: usize, row: usize) -> Columns<F> {
    let others = m.iter().enumerate().filter(|(i, _)| *i != column);
    let without = |c: &Vec<F>| {
        let rows = c.iter().enumerate().filter(|(i, _)| *i != row);
        rows.map(|(_, n)| *n).collect()
    };
    others.map(|(_, c)| without(c)).collect()
}

/// The inverse: cofactors times the reciprocal of the determinant, as naga writes it in WGSL.
pub(crate) fn inverse<F: Number>(matrix: &Value<F>) -> Result<Value<F>, Stuck> {
    let m = columns(matrix)?;
    let whole = of(B::Divide, F::of(1.0), determinant_of(&m)?)?;
    let size = m.len();
    let mut out = Vec::new();
    for column in 0..size {
        let mut numbers = Vec::new();
        for row in 0..size {
            let part = determinant_of(&minor(&m, row, column))?;
            let part = match (row + column) % 2 {
                0 => part,
                _ => part.negated(),
            };
            numbers.push(of(B::Multiply, part, whole)?);
        }
        out.push(Value::composite(&numbers));
    }
    Ok(Value::Composite(out))
}
