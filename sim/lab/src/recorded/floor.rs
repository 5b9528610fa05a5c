//! The survey check on the floor of the recorded rooms, before the lift-off.

use crate::util_flights::file::{Flight, Sample};
use haltere_core::estimator::{AnchorCheck, AnchorFit};

/// Higher than this over the first pose it flies, m.
const LIFTED_M: f64 = 0.1;
/// Height of the tag on the floor, m.
const FLOOR_M: f64 = 0.03;

/// What the check says of a recording at the last moment before its lift-off.
pub fn floor_check(flight: &Flight) -> Option<AnchorFit> {
    let mut check = AnchorCheck::new(&flight.survey, &[]);
    let mut floor_m = None;
    for event in &flight.events {
        match &event.sample {
            Sample::Tdoa(tdoa) => check.note(tdoa),
            Sample::Pose(pose) => {
                let height_m = -pose.pos_E_m.z();
                if height_m > *floor_m.get_or_insert(height_m) + LIFTED_M {
                    break;
                }
            }
            _ => {}
        }
    }
    check.judge(FLOOR_M)
}

#[cfg(test)]
mod tests {
    use crate::util_flights::load_all;
    use haltere_core::measure::AnchorId;

    use super::*;

    #[test]
    fn val_no_recording_refuses_a_sound_survey_and_metal_beside_an_anchor_is_named() {
        let Some(dir) = crate::recordings::util() else {
            println!("skipped: no data");
            return;
        };
        for flight in load_all(&dir).unwrap() {
            let fit = floor_check(&flight);
            println!("{}: {fit:?}", flight.name);
            let fit = fit.unwrap_or_else(|| panic!("{}: too little heard", flight.name));
            // The two with a metal box near anchor 2 (README of the recordings).
            let metal = ["const4-trial3-tdoa2-traj1", "const4-trial5-tdoa2-traj1"];
            if metal.contains(&flight.name.as_str()) {
                assert!(
                    fit.is_at_fault(0.6) && fit.worst == AnchorId(2),
                    "{}: {fit:?}",
                    flight.name
                );
            } else {
                assert!(!fit.is_at_fault(0.6), "{}: {fit:?}", flight.name);
            }
        }
    }
}
