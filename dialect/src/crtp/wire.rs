//! Fields of a payload, one after the other: little-endian, without padding.

use super::packet::{CrtpError, Packet, Place};

/// Builds a packet field by field and says at its end whether it fitted.
pub struct Writer {
    packet: Packet,
    fits: bool,
}

impl Writer {
    pub fn to(place: Place) -> Self {
        Self { packet: Packet::new(place), fits: true }
    }

    pub fn bytes(mut self, bytes: &[u8]) -> Self {
        self.fits &= self.packet.push(bytes);
        self
    }

    pub fn u8(self, value: u8) -> Self {
        self.bytes(&[value])
    }

    pub fn u16(self, value: u16) -> Self {
        self.bytes(&value.to_le_bytes())
    }

    pub fn u32(self, value: u32) -> Self {
        self.bytes(&value.to_le_bytes())
    }

    pub fn f32s(self, values: &[f32]) -> Self {
        values.iter().fold(self, |writer, value| writer.bytes(&value.to_le_bytes()))
    }

    /// With the zero that ends it. A name that holds one cannot be sent.
    pub fn name(mut self, name: &str) -> Self {
        self.fits &= !name.contains('\0');
        self.bytes(name.as_bytes()).u8(0)
    }

    /// Another reason not to send it.
    pub fn only_if(mut self, fits: bool) -> Self {
        self.fits &= fits;
        self
    }

    pub fn done(self) -> Option<Packet> {
        self.fits.then_some(self.packet)
    }
}

/// What is left of a payload.
pub struct Reader<'a>(pub &'a [u8]);

impl<'a> Reader<'a> {
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], CrtpError> {
        let (first, rest) = self.0.split_first_chunk().ok_or(CrtpError::BadPayload)?;
        self.0 = rest;
        Ok(*first)
    }

    pub fn u8(&mut self) -> Result<u8, CrtpError> {
        self.array().map(u8::from_le_bytes)
    }

    pub fn u16(&mut self) -> Result<u16, CrtpError> {
        self.array().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Result<u32, CrtpError> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn flag(&mut self) -> Result<bool, CrtpError> {
        Ok(self.u8()? != 0)
    }

    pub fn f32(&mut self) -> Result<f32, CrtpError> {
        self.array().map(f32::from_le_bytes)
    }

    pub fn f32s<const N: usize>(&mut self) -> Result<[f32; N], CrtpError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f32()?;
        }
        Ok(values)
    }

    /// A text up to the zero that ends it.
    pub fn name(&mut self) -> Result<&'a str, CrtpError> {
        let end = self.0.iter().position(|b| *b == 0).ok_or(CrtpError::BadPayload)?;
        let (name, rest) = self.0.split_at_checked(end).ok_or(CrtpError::BadPayload)?;
        self.0 = rest.get(1..).unwrap_or_default();
        std::str::from_utf8(name).map_err(|_| CrtpError::BadPayload)
    }

    pub fn rest(&mut self) -> &'a [u8] {
        std::mem::take(&mut self.0)
    }

    /// A text up to the end of the packet.
    pub fn text(&mut self) -> Result<&'a str, CrtpError> {
        std::str::from_utf8(self.rest()).map_err(|_| CrtpError::BadPayload)
    }

    pub fn end(self) -> Result<(), CrtpError> {
        if self.0.is_empty() { Ok(()) } else { Err(CrtpError::BadPayload) }
    }
}
