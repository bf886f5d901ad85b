//! Bit functions (WGSL, sections 17.5 and 17.9 to 17.11).

use naga::MathFunction;

use half::f16;

use super::Stuck;
use super::number::{Number, single, truncated};
use super::value::{Scalar, Value};

/// Functions that split, join or count words. `None` for other functions.
///
/// # Errors
///
/// Arguments have other types, or stand for several values.
pub(crate) fn call<F: Number>(
    fun: MathFunction,
    arguments: &[&Value<F>],
) -> Option<Result<Value<F>, Stuck>> {
    use MathFunction as M;
    let snorm = |v, most| scaled(v, -1.0, most);
    let unorm = |v, most| scaled(v, 0.0, most);
    let signed = |v: Scalar<F>| match v {
        Scalar::I32(v) => Ok(v),
        other => Err(Stuck::Type(format!("packing {other:?}"))),
    };
    let unsigned = |v: Scalar<F>| match v {
        Scalar::U32(v) => Ok(v),
        other => Err(Stuck::Type(format!("packing {other:?}"))),
    };
    Some(match fun {
        M::Pack4x8snorm => pack(arguments, 8, &|v| snorm(v, 127.0)),
        M::Pack4x8unorm => pack(arguments, 8, &|v| unorm(v, 255.0)),
        M::Pack2x16snorm => pack(arguments, 16, &|v| snorm(v, 32767.0)),
        M::Pack2x16unorm => pack(arguments, 16, &|v| unorm(v, 65535.0)),
        M::Pack2x16float => pack(arguments, 16, &|v| match v {
            Scalar::F32(v) => Ok(f16::from_f32(single(v)?).to_bits().into()),
            other => Err(Stuck::Type(format!("packing {other:?}"))),
        }),
        M::Pack4xI8 => pack(arguments, 8, &|v| Ok(signed(v)? as u32)),
        M::Pack4xU8 => pack(arguments, 8, &unsigned),
        M::Pack4xI8Clamp => pack(arguments, 8, &|v| Ok(signed(v)?.clamp(-128, 127) as u32)),
        M::Pack4xU8Clamp => pack(arguments, 8, &|v| Ok(unsigned(v)?.min(255))),
        M::Unpack4x8snorm => unpack(arguments, 8, &|bits| {
            normalized(f32::from(bits as i8), 127.0)
        }),
        M::Unpack4x8unorm => unpack(arguments, 8, &|bits| normalized(bits as f32, 255.0)),
        M::Unpack2x16snorm => unpack(arguments, 16, &|bits| {
            normalized(f32::from(bits as i16), 32767.0)
        }),
        M::Unpack2x16unorm => unpack(arguments, 16, &|bits| normalized(bits as f32, 65535.0)),
        M::Unpack2x16float => unpack(arguments, 16, &|bits| {
            Ok(Scalar::F32(F::of(f16::from_bits(bits as u16).into())))
        }),
        M::Unpack4xI8 => unpack(arguments, 8, &|bits| Ok(Scalar::I32(i32::from(bits as i8)))),
        M::Unpack4xU8 => unpack(arguments, 8, &|bits| Ok(Scalar::U32(bits))),
        M::Dot4I8Packed => dot_of_bytes(arguments, |b| i32::from(b as i8)).map(Value::i32),
        M::Dot4U8Packed => dot_of_bytes(arguments, i32::from).map(|n| Value::u32(n as u32)),
        _ => return None,
    })
}

/// Bit functions of each integer. `None` for other functions or types.
pub(crate) fn of_integers<F>(fun: MathFunction, s: &[Scalar<F>]) -> Option<Scalar<F>> {
    use MathFunction as M;
    use Scalar::{I32, U32};
    Some(match (fun, s) {
        (M::CountTrailingZeros, [I32(v)]) => I32(v.trailing_zeros() as i32),
        (M::CountTrailingZeros, [U32(v)]) => U32(v.trailing_zeros()),
        (M::CountLeadingZeros, [I32(v)]) => I32(v.leading_zeros() as i32),
        (M::CountLeadingZeros, [U32(v)]) => U32(v.leading_zeros()),
        (M::CountOneBits, [I32(v)]) => I32(v.count_ones() as i32),
        (M::CountOneBits, [U32(v)]) => U32(v.count_ones()),
        (M::ReverseBits, [I32(v)]) => I32(v.reverse_bits()),
        (M::ReverseBits, [U32(v)]) => U32(v.reverse_bits()),
        // For zero: all bits set.
        (M::FirstTrailingBit, [I32(v)]) => I32(first_trailing(*v as u32) as i32),
        (M::FirstTrailingBit, [U32(v)]) => U32(first_trailing(*v)),
        // For a negative number, the first bit that differs from the sign.
        (M::FirstLeadingBit, [I32(v)]) => I32(first_leading((*v ^ (*v >> 31)) as u32) as i32),
        (M::FirstLeadingBit, [U32(v)]) => U32(first_leading(*v)),
        (M::ExtractBits, [v, U32(offset), U32(count)]) => {
            let (offset, count) = field(*offset, *count);
            let shift = 32 - count;
            match v {
                _ if count == 0 => match v {
                    I32(_) => I32(0),
                    U32(_) => U32(0),
                    _ => return None,
                },
                // Shifting up and down again extends the sign.
                I32(v) => I32((v << (shift - offset)) >> shift),
                U32(v) => U32((v << (shift - offset)) >> shift),
                _ => return None,
            }
        }
        (M::InsertBits, [v, bits, U32(offset), U32(count)]) => {
            let (offset, count) = field(*offset, *count);
            let mask = match count {
                0 => 0,
                n => (u32::MAX >> (32 - n)) << offset,
            };
            let put = |v: u32, bits: u32| match mask {
                0 => v,
                _ => (v & !mask) | ((bits << offset) & mask),
            };
            match (v, bits) {
                (I32(v), I32(bits)) => I32(put(*v as u32, *bits as u32) as i32),
                (U32(v), U32(bits)) => U32(put(*v, *bits)),
                _ => return None,
            }
        }
        _ => return None,
    })
}

/// Clamps a bit field to its word.
fn field(offset: u32, count: u32) -> (u32, u32) {
    let offset = offset.min(32);
    (offset, count.min(32 - offset))
}

fn first_trailing(bits: u32) -> u32 {
    match bits {
        0 => u32::MAX,
        bits => bits.trailing_zeros(),
    }
}

fn first_leading(bits: u32) -> u32 {
    match bits {
        0 => u32::MAX,
        bits => 31 - bits.leading_zeros(),
    }
}

/// Scales a float between `low` and 1 to a whole number of at most `most`.
fn scaled<F: Number>(value: Scalar<F>, low: f32, most: f32) -> Result<u32, Stuck> {
    let Scalar::F32(value) = value else {
        return Err(Stuck::Type(format!("packing {value:?}")));
    };
    let within = [value, F::of(low), F::of(1.0)];
    let whole = || {
        let held = F::call(MathFunction::Clamp, &within)?;
        let half = F::of(0.5);
        F::call(
            MathFunction::Floor,
            &[F::call(MathFunction::Fma, &[held, F::of(most), half])?],
        )
    };
    let whole = whole().ok_or_else(|| Stuck::Unsupported("packing".to_owned()))?;
    Ok(truncated(whole)? as i32 as u32)
}

/// Packs fields of `width` bits into a word, from the lowest.
fn pack<F: Number>(
    arguments: &[&Value<F>],
    width: u32,
    encode: &dyn Fn(Scalar<F>) -> Result<u32, Stuck>,
) -> Result<Value<F>, Stuck> {
    let fields = arguments.first().map_or(Ok(&[][..]), |v| v.parts())?;
    let mask = (1_u32 << width) - 1;
    let mut word = 0;
    for (shift, part) in (0..32).step_by(width as usize).zip(fields) {
        word |= (encode(part.scalar()?)? & mask) << shift;
    }
    Ok(Value::u32(word))
}

/// Unpacks fields of `width` bits from a word, from the lowest, and decodes each.
fn unpack<F: Number>(
    arguments: &[&Value<F>],
    width: u32,
    decode: &dyn Fn(u32) -> Result<Scalar<F>, Stuck>,
) -> Result<Value<F>, Stuck> {
    let word = word(arguments.first())?;
    let fields = (0..32).step_by(width as usize);
    let fields = fields.map(|shift| decode((word >> shift) & ((1 << width) - 1)));
    let fields = fields.map(|field| field.map(Value::Scalar));
    fields.collect::<Result<_, _>>().map(Value::Composite)
}

fn word<F: Number>(value: Option<&&Value<F>>) -> Result<u32, Stuck> {
    match value {
        Some(Value::Scalar(Scalar::U32(word))) => Ok(*word),
        other => Err(Stuck::Type(format!("unpacking {other:?}"))),
    }
}

fn dot_of_bytes<F: Number>(arguments: &[&Value<F>], number: fn(u8) -> i32) -> Result<i32, Stuck> {
    let [a, b] = [word(arguments.first())?, word(arguments.get(1))?].map(u32::to_le_bytes);
    Ok(a.into_iter()
        .zip(b)
        .map(|(a, b)| number(a) * number(b))
        .sum())
}

/// A field as a fraction of its range, at least -1.
fn normalized<F: Number>(field: f32, of: f32) -> Result<Scalar<F>, Stuck> {
    let part = F::binary(naga::BinaryOperator::Divide, F::of(field), F::of(of));
    let held = part.and_then(|part| F::call(MathFunction::Max, &[part, F::of(-1.0)]));
    held.map(Scalar::F32)
        .ok_or_else(|| Stuck::Unsupported("unpacking".to_owned()))
}
