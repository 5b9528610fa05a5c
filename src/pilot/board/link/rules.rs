//! Which of a board's parameters must be right before it is flown by us, and why.
//!
//! Values were flown in software-in-the-loop or are the firmwares' documented meanings; docs/BOARDS.md
//! says which and what follows from a wrong one.

use super::profile::Firmware;

/// What a parameter has to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Demand {
    /// All these bits are set.
    Bits(u32),
    /// Within these bounds; when it is not, and may be set, it becomes the third number.
    Within(f64, f64, f64),
    /// One of these; when it is not, and may be set, it becomes the first.
    OneOf(&'static [f64]),
    /// Only read: something else follows it.
    Known,
}

/// What a wrong value means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Weight {
    /// The board is not armed with it.
    Must,
    /// People are told.
    Should,
    /// Nothing.
    Note,
}

/// One parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rule {
    /// Its names, newest release first.
    pub names: &'static [&'static str],
    pub demand: Demand,
    pub weight: Weight,
    /// What goes wrong otherwise.
    pub why: &'static str,
}

const fn rule(
    names: &'static [&'static str],
    demand: Demand,
    weight: Weight,
    why: &'static str,
) -> Rule {
    Rule { names, demand, weight, why }
}

use Demand::{Bits, Known, OneOf, Within};
use Weight::{Must, Note, Should};

/// Name under which the spool-up time is looked up.
pub(crate) const SPOOL_NAMES: [&str; 2] = ["MOT_SPOOL_TIME", "COM_SPOOLUP_TIME"];

/// Names under which the time-out of setpoints is looked up.
pub(crate) const TIMEOUT_NAMES: [&str; 2] = ["GUID_TIMEOUT", "COM_OF_LOSS_T"];

static ARDUPILOT: &[Rule] = &[
    rule(&["GUID_OPTIONS"], Bits(8), Must, "without bit 3 the thrust is flown as a climb rate"),
    rule(
        &["GUID_TIMEOUT"],
        Within(0.1, 1.0, 0.5),
        Must,
        "the last tilt is held for so long when setpoints stop",
    ),
    rule(
        &["FS_GCS_ENABLE"],
        OneOf(&[5.0]),
        Should,
        "5 lands when the companion's heartbeat stops; else nothing ends such a flight",
    ),
    rule(
        &["FS_GCS_TIMEOUT"],
        Within(1.0, 5.0, 2.0),
        Should,
        "time without the companion's heartbeat until it lands",
    ),
    // The companion takes the board's system id: MAV_GCS_SYSID must be that one.
    rule(
        &["MAV_GCS_SYSID", "SYSID_MYGCS"],
        Known,
        Should,
        "must be the companion's system id, or its heartbeat is not watched",
    ),
    rule(
        &["FS_EKF_ACTION"],
        OneOf(&[0.0]),
        Should,
        "0: a board without a position must not land because it has none",
    ),
    rule(
        &["ATC_ANGLE_BOOST"],
        OneOf(&[0.0]),
        Should,
        "0: the companion raises thrust with tilt itself; else it is raised twice",
    ),
    rule(&["MOT_SPOOL_TIME"], Known, Note, "time in which thrust does not act yet"),
];

static PX4: &[Rule] = &[
    rule(
        &["COM_OF_LOSS_T"],
        Within(0.2, 1.0, 0.3),
        Must,
        "the last tilt is held for so long when setpoints stop",
    ),
    rule(
        &["COM_OBL_RC_ACT"],
        OneOf(&[4.0, 6.0, 7.0]),
        Must,
        "4 lands where it is; 3 and, without a position, 0 were seen to climb to the return height",
    ),
    rule(
        &["COM_RCL_EXCEPT"],
        Bits(4),
        Should,
        "bit 2: no failsafe in OFFBOARD because there is no remote control",
    ),
    rule(
        &["NAV_DLL_ACT"],
        OneOf(&[0.0]),
        Should,
        "0: no failsafe because the board itself hears no ground station",
    ),
    rule(&["COM_SPOOLUP_TIME"], Known, Note, "time in which thrust does not act yet"),
    // Last: setting it shows in the heartbeat after a reboot only.
    rule(
        &["MAV_TYPE"],
        OneOf(&[2.0, 3.0, 4.0, 13.0, 14.0, 15.0]),
        Must,
        "thrust reaches the motors of multirotors and helicopters only; a flapping wing, 16, gets none",
    ),
];

impl Firmware {
    /// What is read, in this order.
    pub fn rules(self) -> &'static [Rule] {
        match self {
            // A Crazyflie's are asked at connecting.
            Firmware::Generic | Firmware::Crazyflie => &[],
            Firmware::Px4 => PX4,
            Firmware::ArduPilot => ARDUPILOT,
        }
    }
}

impl Demand {
    /// Whether this value is right.
    pub fn is_met(self, value: f64) -> bool {
        // A setting of 0.3 comes back as the nearest float.
        let near = |a: f64| (a - value).abs() <= 1e-5 * a.abs().max(1.0);
        match self {
            // The cast saturates; negative numbers have no bits set that we mean.
            Demand::Bits(bits) => value as u32 & bits == bits,
            Demand::Within(low, high, _) => {
                (low..=high).contains(&value) || near(low) || near(high)
            }
            Demand::OneOf(all) => all.iter().any(|a| near(*a)),
            Demand::Known => value.is_finite(),
        }
    }

    /// What it would be set to.
    pub fn remedy(self, value: f64) -> Option<f64> {
        match self {
            Demand::Bits(bits) => Some(f64::from(value as u32 | bits)),
            Demand::Within(_, _, to) => Some(to),
            Demand::OneOf(all) => all.first().copied(),
            Demand::Known => None,
        }
    }

    /// For people.
    pub fn text(self) -> String {
        match self {
            Demand::Bits(bits) => format!("with {bits} in it"),
            Demand::Within(low, high, _) => format!("{low} to {high}"),
            Demand::OneOf(all) => {
                let all: Vec<String> = all.iter().map(f64::to_string).collect();
                all.join(", ")
            }
            Demand::Known => "any".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_every_remedy_is_a_cure() {
        for rule in ARDUPILOT.iter().chain(PX4) {
            for wrong in [-1.0, 0.0, 3.0, 16.0, 99.0] {
                if let Some(right) = rule.demand.remedy(wrong) {
                    assert!(rule.demand.is_met(right), "{:?} {wrong} {right}", rule.names);
                    assert!(rule.demand.is_met(f64::from(right as f32)), "{:?}", rule.names);
                }
            }
            assert!(rule.names.iter().all(|n| n.len() <= 16), "{:?}", rule.names);
        }
    }

    #[test]
    fn prop_bits_are_added_and_others_are_kept() {
        assert!(!Demand::Bits(8).is_met(0.0) && Demand::Bits(8).is_met(12.0));
        assert_eq!(Demand::Bits(8).remedy(3.0), Some(11.0));
    }
}
