//! FP16: IEEE 754 binary16, one sign bit, five of exponent, ten of fraction.

/// The number that these bits mean.
pub fn to_f64(bits: u16) -> f64 {
    let fraction = f64::from(bits & 0x3FF);
    let size = match i32::from(bits >> 10 & 0x1F) {
        0 => fraction * two_to(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        exponent => (1024.0 + fraction) * two_to(exponent - 25),
    };
    if bits & 0x8000 == 0 { size } else { -size }
}

/// The bits of the nearest number, of two as near the even one; infinity beyond 65504.
pub fn from_f64(value: f64) -> u16 {
    let sign = if value.is_sign_negative() { 0x8000 } else { 0 };
    let size = value.abs();
    if size.is_nan() {
        return sign | 0x7E00;
    }
    if size >= 65520.0 {
        return sign | 0x7C00;
    }
    // Below 2^-14 steps are as wide as there.
    let exponent = ((size.to_bits() >> 52) as i32 - 1023).max(-14);
    let steps = (size * two_to(10 - exponent)).round_ties_even();
    // The first 1024 steps are the leading one, which is not sent but counts the exponent up; so does a carry.
    sign | (((exponent + 14) << 10) + steps as i32) as u16
}

/// A power of two, exactly, which `exp2` does not promise; for what a double holds without loss of digits.
fn two_to(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn val_halves_of_ieee_754() {
        let known = [
            (0x0000, 0.0),
            (0x0001, f64::exp2(-24.0)),
            (0x03FF, 1023.0 * f64::exp2(-24.0)),
            (0x0400, f64::exp2(-14.0)),
            (0x3555, 0.333_251_953_125),
            (0x3C00, 1.0),
            (0xC000, -2.0),
            (0x7BFF, 65504.0),
            (0xFC00, f64::NEG_INFINITY),
        ];
        for (bits, value) in known {
            assert_eq!((to_f64(bits), from_f64(value)), (value, bits));
        }
        // Ties go to the even one, also where that is the next power of two.
        assert_eq!(from_f64(2049.0), from_f64(2048.0));
        assert_eq!(from_f64(2047.5), from_f64(2048.0));
        assert_eq!(from_f64(65519.9), 0x7BFF);
        assert_eq!(from_f64(65520.0), 0x7C00);
        assert!(to_f64(from_f64(f64::NAN)).is_nan());
    }

    #[test]
    fn prop_every_half_is_its_own() {
        for bits in 0..=u16::MAX {
            let value = to_f64(bits);
            assert!(value.is_nan() || from_f64(value) == bits, "{bits:04x}");
        }
    }

    proptest! {
        #[test]
        fn prop_halves_are_the_nearest(value in -66000.0_f64..66000.0, down in 0..30) {
            let value = value * f64::exp2(-f64::from(down));
            let bits = from_f64(value);
            let off = (to_f64(bits) - value).abs();
            for other in [bits.wrapping_sub(1), bits.wrapping_add(1)] {
                let other_off = (to_f64(other) - value).abs();
                // NaN and infinity are no neighbours of what is nearer to the largest.
                prop_assert!(off <= other_off || !other_off.is_finite() || !off.is_finite());
            }
        }
    }
}
