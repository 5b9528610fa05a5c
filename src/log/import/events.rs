//! Records of a log that describes itself, kind by kind, and the bytes that they are read from.

/// Records of one kind.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Event {
    /// Its name: `fixedFrequency` on a Crazyflie's card for what is logged at a rate, a topic of PX4, a message of ArduPilot.
    pub name: String,
    /// Names of its variables.
    pub variables: Vec<String>,
    /// Time of each record, s.
    pub time_s: Vec<f64>,
    /// Values, record after record, one of each variable.
    pub values: Vec<f64>,
}

impl Event {
    /// The values of a variable, one a record; `None` if it was not logged.
    pub fn column(&self, variable: &str) -> Option<impl Iterator<Item = f64> + '_> {
        let at = self.variables.iter().position(|name| name == variable)?;
        Some(self.values.chunks_exact(self.variables.len()).map(move |record| record[at]))
    }
}

/// Types of variables, little-endian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl Kind {
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

/// What is left of a log.
#[derive(Clone, Copy)]
pub(super) struct Left<'a> {
    pub body: &'a [u8],
    pub at: usize,
}

impl<'a> Left<'a> {
    pub fn of(body: &'a [u8]) -> Self {
        Self { body, at: 0 }
    }

    pub fn rest(&self) -> &'a [u8] {
        self.body.get(self.at..).unwrap_or_default()
    }

    pub fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let taken = *self.rest().first_chunk()?;
        self.at += N;
        Some(taken)
    }

    pub fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let taken = self.rest().get(..count)?;
        self.at += count;
        Some(taken)
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_le_bytes)
    }

    pub fn value(&mut self, kind: Kind) -> Option<f64> {
        Some(match kind {
            Kind::U8 => u8::from_le_bytes(self.take()?).into(),
            Kind::I8 => i8::from_le_bytes(self.take()?).into(),
            Kind::U16 => u16::from_le_bytes(self.take()?).into(),
            Kind::I16 => i16::from_le_bytes(self.take()?).into(),
            Kind::U32 => u32::from_le_bytes(self.take()?).into(),
            Kind::I32 => i32::from_le_bytes(self.take()?).into(),
            Kind::U64 => u64::from_le_bytes(self.take()?) as f64,
            Kind::I64 => i64::from_le_bytes(self.take()?) as f64,
            Kind::F32 => f32::from_le_bytes(self.take()?).into(),
            Kind::F64 => f64::from_le_bytes(self.take()?),
        })
    }
}

/// Text up to a zero or the end.
pub(super) fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}
