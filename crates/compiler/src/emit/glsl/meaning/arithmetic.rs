//! Integer arithmetic by WGSL's rules (sections 8.7 and 15.7.6). GLSL leaves these undefined (GLSL
//! 4.60, sections 4.1.3, 5.4.1 and 5.9): a divisor of 0, the quotient of the least `int` by -1, `%`
//! of a negative number, a shift by 32 bits or more, and an integer made of a float beyond its
//! range. If ranges exclude these cases, the operation stays as it is.

use naga::{
    BinaryOperator, Expression, Handle, Literal, MathFunction, Scalar, ScalarKind, VectorSize,
};
use naga_interp::interval::Interval;
use shader_text::source::Language;

use super::{Keep, shape};

/// The largest floats that are also an `i32` or a `u32`.
const LARGEST_I32: f32 = 2_147_483_520.0;
const LARGEST_U32: f32 = 4_294_967_040.0;
const LEAST_I32: f32 = -2_147_483_648.0;

impl Keep<'_> {
    /// Whether the author's language defines these operations for every operand.
    fn has_wgsl_rules(&self) -> bool {
        self.language == Language::Wgsl
    }

    pub(super) fn operation(
        &mut self,
        op: BinaryOperator,
        left: Handle<Expression>,
        right: Handle<Expression>,
    ) -> Option<Handle<Expression>> {
        use BinaryOperator as B;
        let (shape, scalar) = shape(self.inner(left))?;
        let is_integer = matches!(scalar, Scalar::I32 | Scalar::U32);
        // A GLSL author's `%` is GLSL's, undefined for negative numbers as he wrote it.
        if !is_integer || self.language == Language::Glsl {
            return None;
        }
        let (a, b) = (self.range(left), self.range(right));
        let [dividend, by] = [left, right].map(|e| self.copy_of(e));
        match op {
            B::Divide => {
                let divisor = self.divisor(shape, scalar, (dividend, a), (by, b));
                (divisor != by).then(|| self.binary(op, dividend, divisor))
            }
            B::Modulo => {
                let divisor = self.divisor(shape, scalar, (dividend, a), (by, b));
                if a.low >= 0.0 && b.low >= 0.0 {
                    return (divisor != by).then(|| self.binary(op, dividend, divisor));
                }
                let quotient = self.binary(B::Divide, dividend, divisor);
                let whole = self.binary(B::Multiply, quotient, divisor);
                Some(self.binary(B::Subtract, dividend, whole))
            }
            B::ShiftLeft | B::ShiftRight if self.has_wgsl_rules() && b.high > 31.0 => {
                let most = self.number(shape, Literal::U32(31));
                let by = self.binary(B::And, by, most);
                Some(self.binary(op, dividend, by))
            }
            _ => None,
        }
    }

    /// A divisor that GLSL allows: 1 in place of 0, where WGSL's quotient is the dividend, and in
    /// place of -1 below the least dividend.
    fn divisor(
        &mut self,
        shape: Option<VectorSize>,
        scalar: Scalar,
        (dividend, a): (Handle<Expression>, Interval),
        (by, b): (Handle<Expression>, Interval),
    ) -> Handle<Expression> {
        use BinaryOperator as B;
        let may_be = |number: f64| b.low <= number && number <= b.high;
        if !self.has_wgsl_rules() {
            return by;
        }
        if scalar.kind == ScalarKind::Uint {
            if !may_be(0.0) {
                return by;
            }
            let one = self.number(shape, Literal::U32(1));
            return self.call(MathFunction::Max, &[by, one]);
        }
        let mut divisor = by;
        if may_be(0.0) {
            let zero = self.number(shape, Literal::I32(0));
            let is_zero = self.binary(B::Equal, by, zero);
            let one = self.convert(is_zero, ScalarKind::Sint);
            divisor = self.binary(B::Add, divisor, one);
        }
        if may_be(-1.0) && a.low <= f64::from(i32::MIN) {
            // Not every compiler takes the least `int` as a literal.
            let second = self.number(shape, Literal::I32(i32::MIN + 1));
            let is_least = self.binary(B::Less, dividend, second);
            let minus_one = self.number(shape, Literal::I32(-1));
            let is_minus_one = self.binary(B::Equal, by, minus_one);
            let overflows = self.binary(B::And, is_least, is_minus_one);
            let one = self.convert(overflows, ScalarKind::Sint);
            let two = self.binary(B::Add, one, one);
            divisor = self.binary(B::Add, divisor, two);
        }
        divisor
    }

    /// An integer of a float, which is brought into its range first.
    pub(super) fn integer_of(
        &mut self,
        expr: Handle<Expression>,
        kind: ScalarKind,
    ) -> Option<Handle<Expression>> {
        let (shape, scalar) = shape(self.inner(expr))?;
        if scalar != Scalar::F32 || !self.has_wgsl_rules() {
            return None;
        }
        let (least, most) = match kind {
            ScalarKind::Sint => (LEAST_I32, LARGEST_I32),
            ScalarKind::Uint => (0.0, LARGEST_U32),
            _ => return None,
        };
        let range = self.range(expr);
        // A number above -1 becomes 0.
        let is_low = range.low < f64::from(least) && !(least == 0.0 && range.low > -1.0);
        let is_high = range.high > f64::from(most);
        let value = self.copy_of(expr);
        let bound = |this: &mut Self, number| this.number(shape, Literal::F32(number));
        let bounded = match (is_low, is_high) {
            (false, false) => return None,
            (true, false) => {
                let least = bound(self, least);
                self.call(MathFunction::Max, &[value, least])
            }
            (false, true) => {
                let most = bound(self, most);
                self.call(MathFunction::Min, &[value, most])
            }
            (true, true) => {
                let (least, most) = (bound(self, least), bound(self, most));
                self.call(MathFunction::Clamp, &[value, least, most])
            }
        };
        Some(self.convert(bounded, kind))
    }

    /// The zeros ahead of the first one bit, by halves: GLSL ES 3.00 has no `findMSB`.
    pub(super) fn leading_zeros(
        &mut self,
        shape: Option<VectorSize>,
        scalar: Scalar,
        arg: Handle<Expression>,
    ) -> Handle<Expression> {
        use BinaryOperator as B;
        let value = self.copy_of(arg);
        let mut rest = self.convert(value, ScalarKind::Uint);
        let mut zeros = self.number(shape, Literal::U32(0));
        // The last bit of 0 counts too.
        for bits in [16, 8, 4, 2, 1, 1] {
            // Where the upper bits are 0, the lower ones take their place.
            let bound = self.number(shape, Literal::U32(1 << (32 - bits)));
            let is_empty = self.binary(B::Less, rest, bound);
            let one = self.convert(is_empty, ScalarKind::Uint);
            let bits = self.number(shape, Literal::U32(bits));
            let bits = self.binary(B::Multiply, one, bits);
            rest = self.binary(B::ShiftLeft, rest, bits);
            zeros = self.binary(B::Add, zeros, bits);
        }
        match scalar.kind {
            ScalarKind::Sint => self.convert(zeros, ScalarKind::Sint),
            _ => zeros,
        }
    }

    /// The result of `frexp`, from the bits of its argument: GLSL ES 3.00 has no `frexp`.
    pub(super) fn fraction_and_exponent(
        &mut self,
        e: Handle<Expression>,
        shape: Option<VectorSize>,
        arg: Handle<Expression>,
    ) -> Option<Handle<Expression>> {
        use BinaryOperator as B;
        let ty = self.info[e].ty.handle()?;
        let value = self.copy_of(arg);
        let bits = self.bits_as(value, ScalarKind::Uint);
        let width = self.number(shape, Literal::U32(23));
        let field = self.binary(B::ShiftRight, bits, width);
        let mask = self.number(shape, Literal::U32(0xff));
        let field = self.binary(B::And, field, mask);
        // 0 and subnormal numbers, which a GPU may flush to 0.
        let none = self.number(shape, Literal::U32(0));
        let is_normal = self.binary(B::NotEqual, field, none);
        let one = self.convert(is_normal, ScalarKind::Sint);
        let bias = self.number(shape, Literal::I32(126));
        let exponent = self.convert(field, ScalarKind::Sint);
        let exponent = self.binary(B::Subtract, exponent, bias);
        let exponent = self.binary(B::Multiply, exponent, one);
        let others = self.number(shape, Literal::U32(0x807f_ffff));
        let fraction = self.binary(B::And, bits, others);
        let half = self.number(shape, Literal::U32(0x3f00_0000));
        let fraction = self.binary(B::InclusiveOr, fraction, half);
        let fraction = self.bits_as(fraction, ScalarKind::Float);
        let fraction = self.write(Expression::Select {
            condition: is_normal,
            accept: fraction,
            reject: value,
        });
        let components = vec![fraction, exponent];
        Some(self.write(Expression::Compose { ty, components }))
    }

    fn bits_as(&mut self, expr: Handle<Expression>, kind: ScalarKind) -> Handle<Expression> {
        self.write(Expression::As {
            expr,
            kind,
            convert: None,
        })
    }
}
