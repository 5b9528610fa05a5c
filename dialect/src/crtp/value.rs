//! Types of log variables and parameters, and the numbers in them.

use super::half;

/// How the bytes of a value are meant.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Unsigned,
    Signed,
    Float,
}

/// A type: its width, bytes, and its codes in both tables.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Kind {
    form: Form,
    width: u8,
    log: u8,
    parameter: u8,
}

/// A number of any type.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// Of an integer type.
    Int(i64),
    /// Of a type with a fraction.
    Float(f64),
}

impl Kind {
    /// 8 bits.
    pub const U8: Self = Self::row(Form::Unsigned, 1, 1, 0x08);
    /// 16 bits.
    pub const U16: Self = Self::row(Form::Unsigned, 2, 2, 0x09);
    /// 32 bits.
    pub const U32: Self = Self::row(Form::Unsigned, 4, 3, 0x0A);
    /// 8 bits with sign.
    pub const I8: Self = Self::row(Form::Signed, 1, 4, 0x00);
    /// 16 bits with sign.
    pub const I16: Self = Self::row(Form::Signed, 2, 5, 0x01);
    /// 32 bits with sign.
    pub const I32: Self = Self::row(Form::Signed, 4, 6, 0x02);
    /// Single precision.
    pub const F32: Self = Self::row(Form::Float, 4, 7, 0x06);
    /// Half precision. No variable is stored so, but any can be logged so.
    pub const F16: Self = Self::row(Form::Float, 2, 8, 0x05);

    /// All of them. Codes: crazyflie-firmware 2a18fc29, `src/modules/interface/log.h` and `param.h`; the parameters'
    /// half precision is in `docs/functional-areas/crtp/crtp_parameters.md` only. The 64-bit parameters named there
    /// have no users.
    pub const ALL: [Self; 8] =
        [Self::U8, Self::U16, Self::U32, Self::I8, Self::I16, Self::I32, Self::F32, Self::F16];

    const fn row(form: Form, width: u8, log: u8, parameter: u8) -> Self {
        Self { form, width, log, parameter }
    }

    /// That the table of log variables, or an item of a block, means.
    pub fn of_log(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.log == code)
    }

    /// That the table of parameters means, without the flags that it adds.
    pub fn of_parameter(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.parameter == code)
    }

    /// Its code in the table of log variables.
    pub const fn log(self) -> u8 {
        self.log
    }

    /// Its code in the table of parameters.
    pub const fn parameter(self) -> u8 {
        self.parameter
    }

    /// Bytes of a value.
    pub const fn width(self) -> usize {
        self.width as usize
    }

    /// The value of exactly these bytes; `None`: they are too few or too many.
    pub fn read(self, bytes: &[u8]) -> Option<Value> {
        if bytes.len() != self.width() {
            return None;
        }
        let raw = bytes.iter().rev().fold(0_u32, |raw, byte| raw << 8 | u32::from(*byte));
        let unused = u32::BITS - 8 * u32::from(self.width);
        Some(match self.form {
            Form::Unsigned => Value::Int(raw.into()),
            Form::Signed => Value::Int(((raw << unused).cast_signed() >> unused).into()),
            Form::Float if self.width == 2 => Value::Float(half::to_f64(raw as u16)),
            Form::Float => Value::Float(f32::from_bits(raw).into()),
        })
    }

    /// The bytes of a value, [`width`](Self::width) of them and zeros; `None`: it has no such value. What has a
    /// fraction is rounded.
    pub fn write(self, value: Value) -> Option<[u8; 4]> {
        let raw = match (self.form, value) {
            (Form::Float, value) if self.width == 2 => half::from_f64(value.f64()).into(),
            (Form::Float, value) => (value.f64() as f32).to_bits(),
            (_, Value::Int(value)) => {
                value as u32 & u32::MAX >> (u32::BITS - 8 * u32::from(self.width))
            }
            (_, Value::Float(_)) => return None,
        };
        let bytes = raw.to_le_bytes();
        let again = self.read(bytes.get(..self.width())?)?;
        (self.form == Form::Float || again == value).then_some(bytes)
    }
}

impl std::fmt::Debug for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let form = match self.form {
            Form::Unsigned => 'u',
            Form::Signed => 'i',
            Form::Float => 'f',
        };
        write!(f, "{form}{}", 8 * self.width)
    }
}

impl Value {
    /// As a number with a fraction: exact but for integers beyond 2^53, which no type holds.
    pub fn f64(self) -> f64 {
        match self {
            Self::Int(value) => value as f64,
            Self::Float(value) => value,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn prop_values_are_what_they_were(raw: [u8; 4], n in 0..Kind::ALL.len()) {
            let kind = Kind::ALL[n];
            prop_assert_eq!(Kind::of_log(kind.log()), Some(kind));
            prop_assert_eq!(Kind::of_parameter(kind.parameter()), Some(kind));
            let bytes = &raw[..kind.width()];
            let value = kind.read(bytes).expect("of its width");
            let again = kind.write(value).expect("a value of its own");
            prop_assert!(value.f64().is_nan() || &again[..kind.width()] == bytes);
            prop_assert_eq!(kind.read(&[raw, raw].concat()[..kind.width() + 1]), None);
        }
    }
}
