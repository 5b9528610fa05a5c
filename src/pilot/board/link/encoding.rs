//! Numbers in PARAM_VALUE and PARAM_SET, which have one field, a 32-bit float, for every type.
//!
//! PX4 puts the bits of an integer there, ArduPilot its value. Which of the two is told by
//! `AUTOPILOT_VERSION.capabilities`, bit 4 (seen: 0xe8ff and 0xfbef). Read the wrong way, an 8 is 1e-44
//! and nobody notices.

use haltere_dialect::mav::haltere::MavParamType;
use haltere_dialect::mav::known;

/// `MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE`.
const BYTEWISE: u64 = 16;

/// How integers stand in the float.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// Their value.
    Numeric,
    /// Their bits, least significant byte first, in the first bytes of the field.
    Bytewise,
}

impl Encoding {
    /// As the board claims.
    pub fn from_capabilities(bits: u64) -> Self {
        if bits & BYTEWISE != 0 { Encoding::Bytewise } else { Encoding::Numeric }
    }

    /// The number in the field. Types of 64 bits have no place in it and are taken as the float.
    pub fn decode(self, field: f32, kind: u8) -> f64 {
        if self == Encoding::Numeric {
            return f64::from(field);
        }
        let bits = field.to_bits();
        let [b0, b1, _, _] = bits.to_le_bytes();
        match known(kind) {
            Some(MavParamType::MAV_PARAM_TYPE_UINT8) => f64::from(b0),
            Some(MavParamType::MAV_PARAM_TYPE_INT8) => f64::from(i8::from_le_bytes([b0])),
            Some(MavParamType::MAV_PARAM_TYPE_UINT16) => f64::from(u16::from_le_bytes([b0, b1])),
            Some(MavParamType::MAV_PARAM_TYPE_INT16) => f64::from(i16::from_le_bytes([b0, b1])),
            Some(MavParamType::MAV_PARAM_TYPE_UINT32) => f64::from(bits),
            Some(MavParamType::MAV_PARAM_TYPE_INT32) => f64::from(bits.cast_signed()),
            _ => f64::from(field),
        }
    }

    /// The field for a number. Numbers beyond the type's range are cut at its ends.
    pub fn encode(self, value: f64, kind: u8) -> f32 {
        if self == Encoding::Numeric {
            return value as f32;
        }
        // The casts saturate; NaN is 0.
        let whole = value.round();
        let bits = match known(kind) {
            Some(MavParamType::MAV_PARAM_TYPE_UINT8) => u32::from(whole as u8),
            Some(MavParamType::MAV_PARAM_TYPE_INT8) => u32::from((whole as i8).cast_unsigned()),
            Some(MavParamType::MAV_PARAM_TYPE_UINT16) => u32::from(whole as u16),
            Some(MavParamType::MAV_PARAM_TYPE_INT16) => u32::from((whole as i16).cast_unsigned()),
            Some(MavParamType::MAV_PARAM_TYPE_UINT32) => whole as u32,
            Some(MavParamType::MAV_PARAM_TYPE_INT32) => (whole as i32).cast_unsigned(),
            _ => return value as f32,
        };
        f32::from_bits(bits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_dialect::mav::haltere::{MavMessage, PARAM_SET_DATA};
    use haltere_dialect::mav_stream::{self, MavSplitter};
    use proptest::prelude::*;

    const BOTH: [Encoding; 2] = [Encoding::Numeric, Encoding::Bytewise];

    /// Over the wire and back: the field must survive as bits, NaN patterns too.
    fn carried(field: f32, kind: MavParamType) -> (f32, u8) {
        let message = MavMessage::PARAM_SET(PARAM_SET_DATA {
            param_value: field,
            param_type: kind as u8,
            ..PARAM_SET_DATA::DEFAULT
        });
        let mut bytes = Vec::new();
        mav_stream::encode(&mut bytes, 1, 191, 0, &message);
        let mut splitter = MavSplitter::new();
        splitter.push(&bytes);
        match splitter.next().unwrap().unwrap().decode().unwrap() {
            MavMessage::PARAM_SET(m) => (m.param_value, m.param_type),
            other => panic!("{other:?}"),
        }
    }

    fn there_and_back(encoding: Encoding, value: f64, kind: MavParamType) -> f64 {
        let (field, kind) = carried(encoding.encode(value, kind as u8), kind);
        encoding.decode(field, kind)
    }

    #[test]
    fn val_the_two_firmwares_are_told_apart() {
        assert_eq!(Encoding::from_capabilities(0xe8ff), Encoding::Bytewise);
        assert_eq!(Encoding::from_capabilities(0xfbef), Encoding::Numeric);
        // An 8 of PX4, read as ArduPilot's, is nearly nothing.
        let int = MavParamType::MAV_PARAM_TYPE_INT32 as u8;
        let field = Encoding::Bytewise.encode(8.0, int);
        assert!(Encoding::Numeric.decode(field, int) < 1e-40);
        assert_eq!(Encoding::Bytewise.decode(field, int), 8.0);
    }

    proptest! {
        #[test]
        fn prop_integers_come_back_in_both(v in any::<i32>(), small in any::<i16>(), byte in any::<u8>()) {
            use MavParamType as T;
            for (value, kind) in [
                (f64::from(v), T::MAV_PARAM_TYPE_INT32),
                (f64::from(v.cast_unsigned()), T::MAV_PARAM_TYPE_UINT32),
            ] {
                prop_assert_eq!(there_and_back(Encoding::Bytewise, value, kind), value);
                // As a value a float holds 24 bits exactly, and beyond that its own precision.
                let numeric = there_and_back(Encoding::Numeric, value, kind);
                prop_assert!((numeric - value).abs() <= value.abs() * 2f64.powi(-24));
            }
            for encoding in BOTH {
                for (value, kind) in [
                    (f64::from(small), T::MAV_PARAM_TYPE_INT16),
                    (f64::from(small.cast_unsigned()), T::MAV_PARAM_TYPE_UINT16),
                    (f64::from(byte), T::MAV_PARAM_TYPE_UINT8),
                    (f64::from(byte.cast_signed()), T::MAV_PARAM_TYPE_INT8),
                ] {
                    prop_assert_eq!(there_and_back(encoding, value, kind), value);
                }
            }
        }

        #[test]
        fn prop_floats_are_the_same_in_both(v in any::<f32>()) {
            prop_assume!(v.is_finite());
            for encoding in BOTH {
                let kind = MavParamType::MAV_PARAM_TYPE_REAL32;
                prop_assert_eq!(there_and_back(encoding, f64::from(v), kind), f64::from(v));
            }
        }

        #[test]
        fn prop_numbers_beyond_the_type_are_cut(v in -1e12f64..1e12) {
            let back = there_and_back(Encoding::Bytewise, v, MavParamType::MAV_PARAM_TYPE_INT8);
            prop_assert!((-128.0..=127.0).contains(&back));
            prop_assert!((back - v.round().clamp(-128.0, 127.0)).abs() < 0.5);
        }
    }
}
