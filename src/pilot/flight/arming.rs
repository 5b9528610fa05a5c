//! Whether a flight may begin: the table of what is known at rest (`at_rest`), row by row, and how its older rows are
//! looked at.

use haltere_core::estimate::Health;
use haltere_core::estimator::STANDING_S;
use haltere_core::time::HostTime;

use super::Flight;
use super::at_rest::{AT_REST, BOARD, ESTIMATE, Look, Quantity, is};
use super::ending::ENDS;
use super::modes::Mode;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::view::{Around, Sight};

/// Tilt beyond which the vehicle does not stand on its gear, rad.
pub(crate) const ARM_TILT_RAD: f64 = 0.35;
/// Newest UWB, IMU and battery may be this old to arm, s.
const ARM_AGE_S: f64 = 0.5;
const ARM_BATTERY_AGE_S: f64 = 3.0;

/// What is answered to whoever wants a shadow to fly.
pub(crate) const SHADOW_WORDS: &str = "haltere only watches (flight.shadow): arm by whoever flies";

impl Sight<'_> {
    /// Whether arming may be asked of the board; the error is the first reason why not.
    pub(crate) fn may_arm(&self) -> Result<(), String> {
        if self.flight.ending.is_some() {
            return Err(ENDS.to_owned());
        }
        if self.flight.mode != Mode::Disarmed {
            return Err(format!("already {}", self.flight.mode.name()));
        }
        AT_REST.iter().try_for_each(|row| self.refusal(row).map_or(Ok(()), Err))
    }

    /// Whether the motors may turn: armed, and everything still holds that armed it. Between arming and
    /// take-off a vehicle may be carried away, or lose what it knows.
    pub(crate) fn may_lift_off(&self) -> Result<(), String> {
        if self.board.link.lateness().is_late() {
            return Err("link to the board is late".to_owned());
        }
        // For a moment the estimate may be less than good; it may not be none.
        let passes = |row: &Quantity| {
            is(row, &BOARD) || is(row, &ESTIMATE) && self.view.estimate.health == Health::Degraded
        };
        let mut rows = AT_REST.iter().filter(|row| !passes(row));
        rows.try_for_each(|row| self.refusal(row).map_or(Ok(()), Err))
    }

    /// Why a row lets nothing take off, with the way out.
    pub(crate) fn refusal(&self, row: &Quantity) -> Option<String> {
        match (row.look)(self) {
            Look::Refused(why) if row.way_out.is_empty() => Some(why),
            Look::Refused(why) => Some(format!("{why}: {}", row.way_out)),
            _ => None,
        }
    }
}

impl Flight {
    /// Tells whoever arms what was found at rest, and what should be known of it.
    pub(crate) fn tell_at_rest(&self, around: &Around<'_>, out: &mut Out) {
        let mut found = Vec::new();
        for row in &AT_REST {
            match (row.look)(&around.sight(self, out)) {
                Look::Told(what) => {
                    out.say(around.at, Severity::Warning, format!("arming {what}"));
                }
                Look::Fits(what) if !what.is_empty() => found.push(what),
                _ => {}
            }
        }
        out.say(around.at, Severity::Info, format!("at rest: {}", found.join(", ")));
    }
}

pub(crate) fn or_refused(result: Result<(), String>) -> Look {
    result.map_or_else(Look::Refused, |()| Look::Fits(String::new()))
}

pub(crate) fn board(sight: &Sight<'_>) -> Look {
    if let Err(misplaced) = sight.board.check_lines(sight.view.config.tag_protocol) {
        return Look::Refused(misplaced);
    }
    if sight.board.link.is_armed() {
        return Look::Refused("board is already armed, but not by us: disarm it first".to_owned());
    }
    match sight.board.link.silence_s(sight.view.at) {
        Some(s) if s <= sight.view.config.limits.board_loss_s => {}
        silent_s => return Look::Refused(sight.board.missing(sight.view.at, silent_s)),
    }
    if let Some(second) = sight.board.second(sight.view.at) {
        return Look::Refused(format!(
            "{second}: give each vehicle a port or a number of its own, or switch one off"
        ));
    }
    or_refused(sight.board.link.refusal(sight.view.at).map_or(Ok(()), Err))
}

pub(crate) fn imu(sight: &Sight<'_>) -> Look {
    or_refused(if !is_fresh(sight.navigation.last_imu, sight.view.at) {
        Err("no IMU data from the board".to_owned())
    } else if sight.navigation.estimator.standing().is_none() {
        Err(format!("has not stood for {STANDING_S:.0} s yet: keep the vehicle still"))
    } else {
        Ok(())
    })
}

pub(crate) fn uwb(sight: &Sight<'_>) -> Result<(), String> {
    let (heard, needed) = (sight.navigation.anchors_alive(&sight.view), sight.anchors_needed());
    if !is_fresh(sight.navigation.last_fused, sight.view.at) {
        Err("no UWB measurements".to_owned())
    } else if heard < needed {
        let all = sight.view.survey.ids().len();
        Err(format!("{heard} of {all} anchors heard, {needed} needed"))
    } else {
        Ok(())
    }
}

pub(crate) fn estimate(sight: &Sight<'_>) -> Result<(), String> {
    match sight.view.estimate.health {
        Health::Good => Ok(()),
        Health::NotAligned => Err(format!(
            "estimator not aligned: {} of {} anchors heard, keep the vehicle still and level",
            sight.navigation.tag.engine.anchors_heard().count(),
            sight.view.survey.ids().len()
        )),
        health => {
            let word = if health == Health::Lost { "lost" } else { "degraded" };
            let why = sight
                .navigation
                .estimator
                .misgiving(sight.view.at)
                .map_or(String::new(), |w| format!(": {w}"));
            Err(format!("estimate {word}{why}"))
        }
    }
}

pub(crate) fn attitude(sight: &Sight<'_>) -> Result<(), String> {
    let [roll, pitch, _] = sight.view.estimate.R_EB.euler_rad();
    if roll.abs().max(pitch.abs()) <= ARM_TILT_RAD {
        return Ok(());
    }
    Err(format!(
        "tilted: roll {:.0}, pitch {:.0} deg, at most {:.0}",
        roll.to_degrees(),
        pitch.to_degrees(),
        ARM_TILT_RAD.to_degrees()
    ))
}

pub(crate) fn battery(sight: &Sight<'_>) -> Look {
    let fresh = |t: HostTime| sight.view.at.seconds_since(t) < ARM_BATTERY_AGE_S;
    let Some(b) = sight.board.battery.filter(|b| fresh(b.received_at)) else {
        return Look::Refused("no battery voltage from the board".to_owned());
    };
    let (least_v, pack) =
        (sight.view.config.limits.battery_low_v, &sight.view.config.control.voltage);
    let (supply_v, cell_v) = (b.supply_v, b.supply_v / f64::from(pack.cells.max(1)));
    if !pack.is_plausible(supply_v) {
        let cells = pack.cells;
        Look::Refused(format!(
            "battery at {supply_v:.2} V: {cells} cells do not have {cell_v:.2} V each"
        ))
    } else if supply_v < least_v {
        Look::Refused(format!("battery at {supply_v:.2} V, at least {least_v:.2} V needed"))
    } else {
        Look::Fits(format!("{cell_v:.2} V a cell"))
    }
}

pub(crate) fn log(sight: &Sight<'_>) -> Look {
    match sight.out.recording_misses() {
        None => Look::Fits(String::new()),
        Some(why) if sight.view.config.flight.log_required => {
            Look::Refused(format!("{why}: make room, or set flight.log_required = false"))
        }
        Some(why) => Look::Told(why),
    }
}

fn is_fresh(newest: Option<HostTime>, at: HostTime) -> bool {
    newest.is_some_and(|t| at.seconds_since(t) < ARM_AGE_S)
}
