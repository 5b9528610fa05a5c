//! What is known of a vehicle that stands, as one table: each quantity, what it must be and how well, how long it is
//! looked at, what is said and what follows.
//!
//! Arming, the last look before the motors turn (`arming`), health and events of stations, `haltere check --live` and
//! docs/SAFETY.md are made of it. Alignment looks at the same samples by means of its own, and refuses nothing.

use haltere_core::estimator::{
    FORCE_MOST_SHARE, FORCE_TOLD_SHARE, LARGEST_BIAS_RADPS, STANDING_S, Standing,
};
use haltere_core::frames::G_MPS2;
use haltere_core::time::HostTime;

use super::arming::{
    ARM_TILT_RAD, SHADOW_WORDS, attitude, battery, board, estimate, imu, log, or_refused, uwb,
};
use super::supervisor::Number;
use crate::view::Sight;

/// Scatter of a gyroscope at rest, rad/s, of all axes together: ten times that of a BMI088 (data sheet: 0.014 deg/s/√Hz, over
/// 100 Hz 0.005 rad/s), and a sixth of what the same is when it is read in degrees.
const STD_RATE_MOST_RADPS: f64 = 0.05;
/// An accelerometer that scatters by less rests, m/s².
const STD_FORCE_RESTS_MPS2: f64 = 0.5;
/// What is down by the accelerometer and by the board's attitude differ by so much: it is told, and nothing flies, rad (3 and
/// 5 degrees). Trim of boards is up to 2; from 5 on the vehicle is carried away with 0.9 m/s² until the filter knows.
const LEVEL_TOLD_RAD: f64 = 0.052;
const LEVEL_MOST_RAD: f64 = 0.087;
/// A vehicle stands on a floor or on a table; higher by UWB, the survey is wrong, m. Of 28 flights in a room told 1.25
/// times too large all stood 1.2 to 1.4 m high by UWB (`haltere-lab faults --only "survey: scaled by 1.25"`).
const STANDS_HIGHEST_M: f64 = 1.0;
/// Lower than the floor of the survey nothing stands, m: by UWB, which reads 0 to 0.5 m too much near the floor. In lockstep
/// a vehicle 1 m below it stands 0.5 to 0.7 m below by UWB.
const STANDS_LOWEST_M: f64 = -0.4;
/// A pressure that is older is none, s: ten samples of the slowest.
const BARO_AGE_S: f64 = 2.0;
/// Nothing that stands draws more, A.
const STANDING_MOST_A: f64 = 1.0;

/// What a look at a quantity comes to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Look {
    /// As it must be, and what was found, where it is measured.
    Fits(String),
    /// It can be flown with, and whoever flies should know.
    Told(String),
    /// Nothing takes off.
    Refused(String),
}

/// A row.
pub struct Quantity {
    /// Name in lists and events.
    pub name: &'static str,
    /// What stations call it, and what they say where it is not as it must be.
    pub title: &'static str,
    /// The latter.
    pub failed: &'static str,
    /// What it must be.
    pub must_be: &'static str,
    /// Numbers in that.
    pub numbers: &'static [Number],
    /// How long it is looked at, s; 0: its newest value.
    pub looked_at_s: f64,
    /// What is said where it is not.
    pub said: &'static str,
    /// What follows.
    pub follows: &'static str,
    /// What somebody can do about it, where what is said does not say so.
    pub way_out: &'static str,
    /// It is measured in the vehicle: `haltere check --live` looks at it as well.
    pub is_measured: bool,
    pub(crate) look: fn(&Sight<'_>) -> Look,
}

impl std::fmt::Debug for Quantity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Quantity").field("name", &self.name).finish_non_exhaustive()
    }
}

const ROW: Quantity = Quantity {
    name: "",
    title: "",
    failed: "",
    must_be: "",
    numbers: &[],
    looked_at_s: 0.0,
    said: "",
    follows: "no flight",
    way_out: "",
    is_measured: false,
    look: |_| Look::Fits(String::new()),
};

const fn number(
    value: fn(&crate::config::PilotConfig) -> f64,
    unit: &'static str,
    origin: &'static str,
) -> Number {
    Number { key: "", value, unit, origin }
}

/// Every row, in the order in which they are looked at: what a reading is made of before what is made of it.
pub static AT_REST: [Quantity; 18] = [
    BOARD, IMU, FORCE, GYROSCOPE, LEVEL, ESTIMATE, UWB, FLOOR, ATTITUDE, FENCE, BATTERY, BAROMETER,
    OUTPUTS, ANCHORS, GAINS, SHADOW, KEPT, LOG,
];

/// The row of this name.
pub(crate) fn is(row: &Quantity, other: &Quantity) -> bool {
    row.name == other.name
}

pub(crate) const BOARD: Quantity = Quantity {
    name: "board",
    title: "Inner-loop board",
    failed: "The board is not there, not disarmed, or its streams are missing",
    must_be: "there, speaking within `limits.board_loss_s`, disarmed, streams at their rates, parameters and vehicle \
              type as its firmware needs them, a line that is fast enough (docs/BOARDS.md)",
    said: "tag and board are exchanged, or one speaks on the other's line; no board found on its link; board silent for N \
           s; board is already armed, but not by us: disarm it first; and what docs/BOARDS.md lists",
    look: board,
    ..ROW
};

const IMU: Quantity = Quantity {
    name: "imu",
    title: "Inertial sensors",
    failed: "No IMU data from the board",
    must_be: "a sample within 0.5 s, and 1 s of them while the vehicle stands",
    said: "no IMU data from the board; has not stood for 1 s yet: keep the vehicle still",
    look: imu,
    ..ROW
};

const FORCE: Quantity = Quantity {
    name: "force",
    title: "Accelerometer",
    failed: "The accelerometer does not read gravity",
    must_be: "specific force of the size of gravity. What is told is taken into the filter as a scale",
    numbers: &[
        number(|_| FORCE_TOLD_SHARE, "of gravity, told", "healthy simulated ones are within 0.01"),
        number(
            |_| FORCE_MOST_SHARE,
            "of gravity, refused",
            "a scale of 0.05 and a bias beside it can be flown with",
        ),
    ],
    looked_at_s: STANDING_S,
    said: "accelerometer reads N m/s2 at rest, 9.81 (gravity) is right; arming with an accelerometer that reads N m/s2 at \
           rest: used with a scale of K",
    follows: "no flight; told, and used with that scale",
    way_out: "calibrate it, or mend its unit and scale on the board",
    is_measured: true,
    look: force,
};

const GYROSCOPE: Quantity = Quantity {
    name: "gyroscope",
    title: "Gyroscope",
    failed: "The gyroscope turns while the vehicle rests",
    must_be: "a mean that is a bias and no rotation, and little scatter, while the accelerometer rests",
    numbers: &[
        number(|_| LARGEST_BIAS_RADPS, "rad/s, mean", "the filter starts with less"),
        number(
            |_| STD_RATE_MOST_RADPS,
            "rad/s, scatter",
            "ten times that of the BMI088 over 100 Hz",
        ),
    ],
    looked_at_s: STANDING_S,
    said: "gyroscope reads N rad/s and scatters by M rad/s while the accelerometer rests",
    way_out: "let it stand on what does not turn, or mend the gyroscope's unit (rad/s) on the board",
    is_measured: true,
    look: gyroscope,
    ..ROW
};

const LEVEL: Quantity = Quantity {
    name: "level",
    title: "Level",
    failed: "Accelerometer and board differ about what is down",
    must_be: "down by the accelerometer is down by the board's attitude: axes, signs and mounting of the IMU",
    numbers: &[
        number(
            |_| LEVEL_TOLD_RAD.to_degrees().round(),
            "deg, told",
            "trim of boards is up to 2 deg",
        ),
        number(
            |_| LEVEL_MOST_RAD.to_degrees().round(),
            "deg, refused",
            "carries away with 0.9 m/s²",
        ),
    ],
    looked_at_s: STANDING_S,
    said: "accelerometer and board's attitude differ by N deg about what is down",
    follows: "no flight; told",
    way_out: "wait until the board has settled, else calibrate its level, and mend axes and mounting of its IMU",
    is_measured: true,
    look: level,
};

pub(crate) const ESTIMATE: Quantity = Quantity {
    name: "estimate",
    title: "Position estimate",
    failed: "The estimate is not good",
    must_be: "good: aligned, and within its own limits of age, sigma and doubt. At the take-off \"degraded\" is let pass",
    said: "estimator not aligned: N of M anchors heard, keep the vehicle still and level; estimate degraded or lost, and \
           why: no UWB measurement used for N s; position sigma N m; the floor hides the low anchors, position sigma N m; \
           anchor N does not fit the others; N anchors heard, M needed to find a wrong one; N % of the UWB measurements \
           do not fit; the anchors contradict one another, none of them alone is at fault: N, E or height may be N m off; \
           most anchors read far worse than usual",
    look: |sight| or_refused(estimate(sight)),
    ..ROW
};

const UWB: Quantity = Quantity {
    name: "uwb",
    title: "Ultra-wideband",
    failed: "No UWB measurements",
    must_be: "a fused measurement within 0.5 s, `supervisor.anchors_least` anchors",
    said: "no UWB measurements; N of M anchors heard, K needed",
    look: |sight| or_refused(uwb(sight)),
    ..ROW
};

const FLOOR: Quantity = Quantity {
    name: "floor",
    title: "Floor",
    failed: "The vehicle does not stand at the height of the floor",
    must_be: "height of the gear by UWB alone that of the floor of the survey, or of a table on it: a survey of the wrong \
              scale or with heights from elsewhere shows here",
    numbers: &[
        number(
            |_| STANDS_HIGHEST_M,
            "m, highest",
            "a room told 1.25 times too large has 1.2 to 1.4",
        ),
        number(
            |_| STANDS_LOWEST_M,
            "m, lowest",
            "UWB errs by some tenths of a metre near the floor",
        ),
    ],
    said: "stands N m above (below) the floor by UWB",
    way_out: "put it on the floor, or mend the survey (heights count from the floor; places in metres)",
    is_measured: true,
    look: floor,
    ..ROW
};

const ATTITUDE: Quantity = Quantity {
    name: "attitude",
    title: "Attitude",
    failed: "The vehicle does not stand level",
    must_be: "stands on its gear",
    numbers: &[number(
        |_| ARM_TILT_RAD.to_degrees().round(),
        "deg, roll and pitch",
        "a gear on a slope",
    )],
    said: "tilted: roll R, pitch P deg, at most 20",
    look: |sight| or_refused(attitude(sight)),
    ..ROW
};

const FENCE: Quantity = Quantity {
    name: "fence",
    title: "Fence",
    failed: "The vehicle stands outside the fence",
    must_be: "inside of the fence that a station drew",
    said: "outside the fence at N n E e m",
    look: |sight| or_refused(sight.fence.forbids(sight.view.estimate.pos_E_m).map_or(Ok(()), Err)),
    ..ROW
};

const BATTERY: Quantity = Quantity {
    name: "battery",
    title: "Battery",
    failed: "Battery low, not of this pack, or no voltage from the board",
    must_be: "a voltage within 3 s, at least `limits.battery_low_v`, that `control.voltage.cells` cells can have (2.5 to \
              4.5 V each; what the controller believes)",
    said: "no battery voltage from the board; battery at V V, at least L V needed; battery at V V: N cells do not have \
           U V each",
    way_out: "charge it; or mend control.voltage.cells, or the voltage divider on the board",
    is_measured: true,
    look: battery,
    ..ROW
};

const BAROMETER: Quantity = Quantity {
    name: "barometer",
    title: "Barometer",
    failed: "There is no barometer",
    must_be: "a pressure within 2 s, of 300 to 1200 hPa; the same in pascal is read as such",
    said: "arming without barometer: the board sends no pressure; arming without barometer: the board sends a pressure of N, \
           which is neither hPa nor Pa",
    follows: "told: no condition that has the barometer as witness is looked for",
    way_out: "let the board send HIGHRES_IMU with its pressure in hPa",
    is_measured: true,
    look: barometer,
    ..ROW
};

const OUTPUTS: Quantity = Quantity {
    name: "outputs",
    title: "Current",
    failed: "Motors or servos draw a current while it stands",
    must_be: "hardly a current, where the board tells one",
    numbers: &[number(|_| STANDING_MOST_A, "A", "computer, tag and board together draw less")],
    said: "arming with a current of N A while it stands",
    follows: "told",
    way_out: "see what draws it, or mend the scale of the board's current sensor",
    is_measured: true,
    look: outputs,
    ..ROW
};

const ANCHORS: Quantity = Quantity {
    name: "anchors",
    title: "Anchor survey",
    failed: "An anchor does not fit the others",
    must_be: "no anchor whose time differences miss those of all the others by `supervisor.anchor_misfit_m` along its line \
              of sight; from half of that on it is only told. Looked at with 7 anchors or more, and not where the floor \
              adds more than 1 m to the low ones, which is told; more than 2.5 m is no floor. Nor may another still be \
              off by 0.6 m once the worst is left out, by 1 m where the floor adds more than 1 m",
    looked_at_s: 1.5,
    said: "anchor N does not fit the others: it reads D m too far (or too near); check its place in the survey and its line \
           of sight; the floor adds N m to the low anchors, 2.5 m at most: check which anchors are low; several anchors do \
           not fit one another, whichever is left out",
    is_measured: true,
    look: |sight| or_refused(sight.navigation.survey_check.refusal().map_or(Ok(()), Err)),
    ..ROW
};

const GAINS: Quantity = Quantity {
    name: "gains",
    title: "Control gains",
    failed: "The loops cannot fly with these gains",
    must_be: "gains and limits as a set: each loop of the linear model in `control::margins` is stable, with 6 dB and \
              30 deg to spare, and holds a place, at full and at empty battery; thrust can climb and sink. In the air a \
              parameter that would break this is refused",
    said: "control.gains.NAME = V (default D): the forward (sideways, vertical) loop is unstable, has too small a margin, \
           or does not hold a place; control.limits.thrust_max_frac (thrust_min_frac) = V",
    look: |sight| or_refused(sight.flight.gains_refusal.clone().map_or(Ok(()), Err)),
    ..ROW
};

const SHADOW: Quantity = Quantity {
    name: "shadow",
    title: "Shadow",
    failed: "This companion only watches",
    must_be: "`flight.shadow` is off: a shadow watches and never flies",
    said: SHADOW_WORDS,
    look: |sight| {
        let watches = sight.view.config.flight.shadow;
        or_refused(if watches { Err(SHADOW_WORDS.to_owned()) } else { Ok(()) })
    },
    ..ROW
};

const KEPT: Quantity = Quantity {
    name: "kept",
    title: "Kept files",
    failed: "Kept files are damaged: upload them anew, or clear them",
    must_be: "fence, rally points, mission and parameters that were kept over the restart are whole: a file that is \
              damaged or empty is not none. What is missing is told to every station that comes",
    said: "fence (rally points, mission) not restored: why; upload it, or clear it. parameters not restored: why; set them, \
           or reset them. fence, rally points and mission are still being read",
    look: |sight| or_refused(sight.kept.lost_forbids().map_or(Ok(()), Err)),
    ..ROW
};

pub(crate) const LOG: Quantity = Quantity {
    name: "log",
    title: "Flight log",
    failed: "Flights are not recorded",
    must_be: "the flight will be recorded",
    said: "without log: N MB free in FOLDER, M MB needed: make room, or set flight.log_required = false",
    follows: "no flight with `flight.log_required`, else told",
    look: log,
    ..ROW
};

/// What the IMU reads while the vehicle stands; where that is not known yet, its own row says so.
fn standing(sight: &Sight<'_>, judge: impl FnOnce(&Standing) -> Look) -> Look {
    sight.navigation.estimator.standing().map_or_else(|| Look::Fits(String::new()), judge)
}

fn force(sight: &Sight<'_>) -> Look {
    standing(sight, |standing| {
        let reads_mps2 = standing.acc_B_mps2.norm();
        let off = (reads_mps2 / G_MPS2 - 1.0).abs();
        if off > FORCE_MOST_SHARE {
            Look::Refused(format!(
                "accelerometer reads {reads_mps2:.2} m/s2 at rest, {G_MPS2:.2} (gravity) is right"
            ))
        } else if off > FORCE_TOLD_SHARE {
            Look::Told(format!(
                "with an accelerometer that reads {reads_mps2:.2} m/s2 at rest: used with a scale of {:.3}",
                G_MPS2 / reads_mps2
            ))
        } else {
            Look::Fits(format!("gravity {reads_mps2:.2} m/s2"))
        }
    })
}

fn gyroscope(sight: &Sight<'_>) -> Look {
    standing(sight, |standing| {
        let (mean, scatter) = (standing.rate_B_radps.norm(), standing.std_rate_radps);
        let rests = standing.std_acc_mps2 < STD_FORCE_RESTS_MPS2;
        if rests && (mean > LARGEST_BIAS_RADPS || scatter > STD_RATE_MOST_RADPS) {
            Look::Refused(format!(
                "gyroscope reads {mean:.2} rad/s and scatters by {scatter:.2} rad/s while the accelerometer rests"
            ))
        } else {
            Look::Fits(format!("gyroscope {mean:.3} rad/s"))
        }
    })
}

fn level(sight: &Sight<'_>) -> Look {
    // Where the board sends no attitude, its own row says so.
    let Some(down_B) = sight.board.down.mean_B else { return Look::Fits(String::new()) };
    standing(sight, |standing| {
        let up_B = standing.acc_B_mps2;
        let cos = -up_B.dot(down_B) / (up_B.norm() * down_B.norm()).max(f64::MIN_POSITIVE);
        let off_rad = cos.clamp(-1.0, 1.0).acos();
        let off_deg = off_rad.to_degrees();
        let words = format!(
            "accelerometer and board's attitude differ by {off_deg:.1} deg about what is down"
        );
        match off_rad {
            LEVEL_MOST_RAD.. => Look::Refused(words),
            LEVEL_TOLD_RAD.. => Look::Told(format!("although {words}")),
            _ => Look::Fits(format!("level to {off_deg:.1} deg")),
        }
    })
}

fn floor(sight: &Sight<'_>) -> Look {
    if !sight.navigation.estimator.is_aligned() {
        return Look::Fits(String::new()); // nothing is known, and the estimate's row says so
    }
    let by_uwb_m = sight
        .navigation
        .estimator
        .start_height_by_uwb_m()
        .unwrap_or(-sight.view.estimate.pos_E_m.z());
    let stands_m = by_uwb_m - sight.view.config.flight.gear_height_m;
    let words = if stands_m > STANDS_HIGHEST_M {
        format!("stands {stands_m:.1} m above the floor by UWB, {STANDS_HIGHEST_M:.1} m at most")
    } else if stands_m < STANDS_LOWEST_M {
        format!(
            "stands {:.1} m below the floor by UWB, {:.1} m at most",
            -stands_m, -STANDS_LOWEST_M
        )
    } else {
        return Look::Fits(format!("floor to {stands_m:+.1} m"));
    };
    Look::Refused(words)
}

fn barometer(sight: &Sight<'_>) -> Look {
    let fresh = |t: HostTime| sight.view.at.seconds_since(t) < BARO_AGE_S;
    match (sight.board.pressure_pa, sight.board.link.odd_pressure()) {
        (Some((pa, t)), _) if fresh(t) => Look::Fits(format!("barometer {:.1} hPa", pa * 0.01)),
        (_, Some((raw, t))) if fresh(t) => Look::Told(format!(
            "without barometer: the board sends a pressure of {raw}, which is neither hPa nor Pa"
        )),
        _ => Look::Told("without barometer: the board sends no pressure".to_owned()),
    }
}

fn outputs(sight: &Sight<'_>) -> Look {
    match sight.board.battery.and_then(|battery| battery.current_a) {
        Some(a) if a > STANDING_MOST_A => {
            Look::Told(format!("with a current of {a:.1} A while it stands"))
        }
        _ => Look::Fits(String::new()),
    }
}
