//! A unit quaternion in 32 bits, as the log variable `stateEstimateZ.quat` has it.
//!
//! | bits | field |
//! |---|---|
//! | 31-30 | which of x, y, z, w is largest by size; it is left out, and made positive |
//! | 29-0 | the other three in that order: a sign, then nine bits of 511·√2 times the size |
//!
//! Rounding turns it by 0.08° at most for each of the three. Source: crazyflie-firmware 2a18fc29,
//! `src/modules/interface/quatcompress.h`.

use std::f64::consts::FRAC_1_SQRT_2;

/// No other can be larger than 1/√2; it is sent as this many steps.
const STEPS: f64 = 511.0;
const STEP_BITS: u32 = 9;

/// In the order x, y, z, w.
pub fn unpack(bits: u32) -> [f64; 4] {
    let largest = (bits >> 30) as usize;
    let mut quaternion = [0.0; 4];
    let mut rest = bits;
    for (_, part) in quaternion.iter_mut().enumerate().rev().filter(|(n, _)| *n != largest) {
        let size = f64::from(rest & ((1 << STEP_BITS) - 1)) * FRAC_1_SQRT_2 / STEPS;
        *part = if rest >> STEP_BITS & 1 == 0 { size } else { -size };
        rest >>= STEP_BITS + 1;
    }
    let others: f64 = quaternion.iter().map(|part| part * part).sum();
    if let Some(part) = quaternion.get_mut(largest) {
        *part = (1.0 - others).max(0.0).sqrt();
    }
    quaternion
}

/// Of a unit quaternion in the order x, y, z, w, or of its negative, which means the same.
pub fn pack(quaternion: [f64; 4]) -> u32 {
    let (mut largest, mut size) = (0, 0.0);
    for (n, part) in quaternion.iter().enumerate() {
        if part.abs() > f64::abs(size) {
            (largest, size) = (n, *part);
        }
    }
    let others = quaternion.iter().enumerate().filter(|(n, _)| *n != largest);
    others.fold(largest as u32, |bits, (_, part)| {
        let steps = (part.abs() / FRAC_1_SQRT_2 * STEPS).round().min(STEPS) as u32;
        let sign = u32::from((*part < 0.0) != (size < 0.0));
        (bits << 1 | sign) << STEP_BITS | steps
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn prop_a_quaternion_turns_as_before(parts in prop::array::uniform4(-1.0_f64..1.0)) {
            let norm = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
            prop_assume!(norm > 0.1);
            let unit = parts.map(|part| part / norm);
            let again = unpack(pack(unit));
            let cosine = unit.iter().zip(again).map(|(a, b)| a * b).sum::<f64>().abs();
            // Three roundings of half a step each, and what they do to the fourth.
            let angle_deg = 2.0 * cosine.min(1.0).acos().to_degrees();
            prop_assert!(angle_deg < 0.25, "{} {:?} {:?}", angle_deg, unit, again);
            prop_assert_eq!(pack(unit), pack(unit.map(|part| -part)));
        }
    }
}
