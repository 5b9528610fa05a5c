//! The joystick: MANUAL_CONTROL as velocities in a mode that holds its place when it is let go.

use haltere_dialect::mav::haltere::MANUAL_CONTROL_DATA;

use super::Flight;
use super::modes::Mode;
use super::setpoint::{Owner, Setpoint};
use crate::out::Out;
use crate::view::View;

/// Full deflection of x, y and r (common.xml, MANUAL_CONTROL).
const FULL: f64 = 1000.0;
/// z in its middle: 0 is full down, full deflection full up, as QGroundControl sends it.
const Z_MIDDLE: f64 = FULL / 2.0;
/// Deflections below this share count as none: worn sticks do not come back to their middle.
const DEAD_SHARE: f64 = 0.08;
/// Fastest climb and sink by stick, m/s: a landing's speed, so that the floor is met gently.
const VERTICAL_MPS: f64 = 0.4;
/// Fastest turn by stick, rad/s: the rate at which the controller lets the yaw setpoint follow.
const YAW_RADPS: f64 = 1.0;
/// A stick that the sender does not have.
const ABSENT: i16 = i16::MAX;

/// Deflection of one stick, -1 to 1, without its dead middle. `None`: a value that cannot be.
fn share(value: f64, full: f64) -> Option<f64> {
    let share = value / full;
    if share.abs() > 1.0 + 1e-9 {
        return None;
    }
    let beyond = (share.abs() - DEAD_SHARE).max(0.0) / (1.0 - DEAD_SHARE);
    Some(beyond.copysign(share))
}

/// Forward, right, up and clockwise, -1 to 1 each.
fn sticks(m: &MANUAL_CONTROL_DATA) -> Result<[f64; 4], String> {
    let stick = |name: &str, value: i16, middle: f64, full: f64| {
        if value == ABSENT {
            return Ok(0.0);
        }
        share(f64::from(value) - middle, full).ok_or_else(|| {
            format!("joystick {name} = {value}, allowed {} to {}", middle - full, middle + full)
        })
    };
    Ok([
        stick("x", m.x, 0.0, FULL)?,
        stick("y", m.y, 0.0, FULL)?,
        stick("z", m.z, Z_MIDDLE, FULL - Z_MIDDLE)?,
        stick("r", m.r, 0.0, FULL)?,
    ])
}

impl Flight {
    /// Takes in what a joystick says. It moves the vehicle in Manual mode only.
    pub(crate) fn manual_control(
        &mut self,
        view: &View<'_>,
        from: Owner,
        m: &MANUAL_CONTROL_DATA,
        out: &mut Out,
    ) {
        let (at, limit_s) = (view.at, view.config.limits.offboard_loss_s);
        let fresh = |s: &&Setpoint| at.seconds_since(s.received_at) < limit_s;
        let last = self.guidance.sticks.as_ref().filter(fresh);
        if self.mode == Mode::Manual && last.is_some_and(|s| s.owner != Some(from)) {
            out.refuse_setpoint(at, from.0, "joystick refused: another station flies".to_owned());
            return;
        }
        let [forward, right, up, clockwise] = match sticks(m) {
            Ok(sticks) => sticks,
            Err(why) => {
                out.refuse_setpoint(at, from.0, why);
                return;
            }
        };
        // Whether this is an order by itself is for the supervisor to say.
        let most = forward.abs().max(right.abs()).max(clockwise.abs());
        self.supervisor.heard.sticks = Some((most, at));
        let speed_mps = view.config.flight.cruise_speed_mps;
        // Before the mode is entered nothing is held.
        let last = last.filter(|_| self.mode == Mode::Manual);
        let mut setpoint = Setpoint::from_sticks(
            [forward * speed_mps, right * speed_mps],
            -up * VERTICAL_MPS,
            clockwise * YAW_RADPS,
            view.estimate,
            last,
            at,
        );
        setpoint.owner = Some(from);
        self.guidance.sticks = Some(setpoint);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn m(x: i16, y: i16, z: i16, r: i16) -> MANUAL_CONTROL_DATA {
        MANUAL_CONTROL_DATA { x, y, z, r, ..Default::default() }
    }

    #[test]
    fn prop_middle_is_still_and_ends_are_full() {
        assert_eq!(sticks(&m(0, 0, 500, 0)), Ok([0.0; 4]));
        assert_eq!(sticks(&m(70, -70, 530, 79)), Ok([0.0, -0.0, 0.0, 0.0]));
        let full = sticks(&m(1000, -1000, 1000, 1000)).unwrap();
        assert!(full.iter().all(|s| (s.abs() - 1.0).abs() < 1e-12), "{full:?}");
        assert!(full[0] > 0.0 && full[1] < 0.0 && full[2] > 0.0);
        assert!((sticks(&m(0, 0, 0, 0)).unwrap()[2] + 1.0).abs() < 1e-12);
    }

    #[test]
    fn prop_absent_sticks_are_still_and_impossible_ones_refused() {
        assert_eq!(sticks(&m(ABSENT, ABSENT, ABSENT, ABSENT)), Ok([0.0; 4]));
        let why = sticks(&m(2000, 0, 500, 0)).unwrap_err();
        assert!(why.contains("x = 2000, allowed -1000 to 1000"), "{why}");
        assert!(sticks(&m(0, 0, -1, 0)).is_err());
    }
}
