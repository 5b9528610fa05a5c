//! The battery: voltage, and the time that is left against the time home and down.

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;

use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::out::voice::Severity;
use crate::view::Sight;
use haltere_core::time::HostTime;

/// Voltage must be below its limit for this long, s: sag under a throttle step is not empty.
const LOW_FOR_S: f64 = 2.0;
/// A voltage that is older is none, s.
const AGE_S: f64 = 5.0;
/// Interval of the samples of which the discharge is learned, s, and how many are kept.
const EVERY_S: f64 = 1.0;
const KEPT: usize = 31;
/// Time constant of the low-pass before that, s.
const FILTER_S: f64 = 1.0;
/// Flight before the first sample, s: a pack recovers and sags for so long after a change of load.
const SETTLE_S: f64 = 5.0;
/// Slower discharge is none that can be seen over noise, V/s.
const SLOWEST_VPS: f64 = 2e-4;
/// Way home takes this much longer than planned: turning, wind.
const HOME_SHARE: f64 = 1.3;

/// Discharge as it is seen in this flight.
#[derive(Debug, Default)]
pub(crate) struct Discharge {
    slow_v: Option<(f64, HostTime)>,
    flying_since: Option<HostTime>,
    next: HostTime,
    /// Low-passed voltage once a second, the oldest first, and how many there are: in place, because
    /// the control loop asks for no memory.
    samples_v: [f64; KEPT],
    count: usize,
}

impl Discharge {
    /// The lower of the present voltage and the average over the last second, V: thrust that trembles pulls the present
    /// one over a limit and back.
    pub fn lower_v(&self, supply_v: f64) -> f64 {
        self.slow_v.map_or(supply_v, |(slow_v, _)| slow_v.min(supply_v))
    }

    /// A voltage; `flies`: under the load of a flight.
    pub fn note(&mut self, at: HostTime, supply_v: f64, flies: bool) {
        if !flies {
            *self = Self::default();
            return;
        }
        let slow_v = match self.slow_v {
            None => supply_v,
            Some((was_v, t)) => {
                let dt_s = at.seconds_since(t).max(0.0);
                was_v + (supply_v - was_v) * (dt_s / (FILTER_S + dt_s))
            }
        };
        self.slow_v = Some((slow_v, at));
        let since = *self.flying_since.get_or_insert(at);
        if at.seconds_since(since) < SETTLE_S || at < self.next {
            return;
        }
        self.next = at.offset_us((EVERY_S * 1e6) as i64);
        if self.count == KEPT {
            self.samples_v.rotate_left(1);
            self.count -= 1;
        }
        self.samples_v[self.count] = slow_v;
        self.count += 1;
    }

    /// Time until a voltage is reached, s: by the middle one of the three slopes of the last three
    /// times ten seconds, so that a cell that drops out at once does not count as a slope.
    pub fn time_to_s(&self, limit_v: f64) -> Option<f64> {
        if self.count < KEPT {
            return None;
        }
        let last = self.samples_v[KEPT - 1];
        let third = (KEPT - 1) / 3;
        let slope = |k: usize| {
            let (a, b) = (self.samples_v[k * third], self.samples_v[(k + 1) * third]);
            (a - b) / (third as f64 * EVERY_S)
        };
        let mut slopes = [slope(0), slope(1), slope(2)];
        slopes.sort_by(f64::total_cmp);
        let falls_vps = slopes[1];
        (falls_vps > SLOWEST_VPS).then(|| ((last - limit_v) / falls_vps).max(0.0))
    }
}

impl Sight<'_> {
    fn fresh_v(&self) -> Option<f64> {
        let battery = self.board.battery?;
        (self.view.at.seconds_since(battery.received_at) < AGE_S).then_some(battery.supply_v)
    }

    /// Whether the voltage is below a limit, now or on average over the last second.
    fn is_below(&self, limit_v: f64) -> bool {
        self.fresh_v().is_some_and(|v| self.flight.supervisor.discharge.lower_v(v) < limit_v)
    }

    /// Time until the voltage is critical, s, once it can be told.
    pub(crate) fn battery_left_s(&self) -> Option<f64> {
        self.flight.supervisor.discharge.time_to_s(self.view.config.limits.battery_critical_v)
    }

    /// Time to fly home and land, s.
    pub(crate) fn time_home_s(&self) -> f64 {
        let flight = &self.view.config.flight;
        let pos = self.view.estimate.pos_E_m;
        let refuge = self.flight.guidance.nearest_refuge_NE_m(pos, self.fence);
        // Where no way leads home it lands here.
        let away_m = refuge.map_or(0.0, |[n, e]| (pos.x() - n).hypot(pos.y() - e));
        let height_m = self.view.height_above_floor_m().max(flight.return_height_m).max(0.0);
        HOME_SHARE * flight.travel_s(away_m, self.view.config.control.sustained_mps())
            + flight.landing_s(height_m)
    }

    fn is_home_due(&self) -> bool {
        let reserve_s = self.view.config.supervisor.battery_reserve_s;
        self.battery_left_s().is_some_and(|left_s| left_s < self.time_home_s() + reserve_s)
    }
}

fn words_of_voltage(sight: &Sight<'_>, what: &str) -> String {
    let v = sight.board.battery.map_or(0.0, |b| b.supply_v);
    match sight.battery_left_s() {
        Some(left_s) => format!("battery {what}: {v:.2} V, {left_s:.0} s left"),
        None => format!("battery {what}: {v:.2} V"),
    }
}

/// Low.
pub(super) const LOW: Condition = Condition {
    name: "battery_low",
    seen_by: "Voltage below `limits.battery_low_v`, now or averaged over 1 s.",
    numbers: &[Number {
        key: "limits.battery_low_v",
        value: |c| c.limits.battery_low_v,
        unit: "V",
        origin: "3.2 V a cell of two under load",
    }],
    lasts_s: |_| LOW_FOR_S,
    gone_s: 10.0,
    watched: Watched::Always,
    wanted: |c| c.supervisor.battery_low.reaction(),
    because: "battery low",
    over: "",
    health: S::MAV_SYS_STATUS_SENSOR_BATTERY,
    severity: Severity::Warning,
    is_seen: |sight| sight.is_below(sight.view.config.limits.battery_low_v),
    words: |sight| words_of_voltage(sight, "low"),
    ..ROW
};

/// Only just enough to get home.
pub(super) const HOME: Condition = Condition {
    name: "battery_home",
    seen_by: "By the discharge of this flight (middle slope of three times 10 s) the voltage will be critical before \
              the vehicle can fly home, at nine tenths of the speed that `control.limits` allow, be on the floor, and \
              `supervisor.battery_reserve_s` be over. Known from 35 s of flight on.",
    numbers: &[Number {
        key: "supervisor.battery_reserve_s",
        value: |c| c.supervisor.battery_reserve_s,
        unit: "s",
        origin: "derived: the discharge is a straight line here and bends down at its end",
    }],
    lasts_s: |_| LOW_FOR_S,
    latched: true,
    watched: Watched::Air,
    wanted: |c| c.supervisor.battery_home.reaction(),
    because: "battery is needed to get home",
    over: "",
    health: S::MAV_SYS_STATUS_SENSOR_BATTERY,
    severity: Severity::Critical,
    is_seen: |sight| sight.fresh_v().is_some() && sight.is_home_due(),
    words: |sight| {
        format!(
            "battery: {:.0} s left, home and down takes {:.0} s",
            sight.battery_left_s().unwrap_or_default(),
            sight.time_home_s()
        )
    },
    ..ROW
};

/// Empty.
pub(super) const CRITICAL: Condition = Condition {
    name: "battery_critical",
    seen_by: "Voltage below `limits.battery_critical_v`, now or averaged over 1 s.",
    numbers: &[Number {
        key: "limits.battery_critical_v",
        value: |c| c.limits.battery_critical_v,
        unit: "V",
        origin: "3.0 V a cell of two under load",
    }],
    lasts_s: |_| LOW_FOR_S,
    latched: true,
    wanted: |_| Reaction::Land,
    because: "battery empty",
    over: "",
    health: S::MAV_SYS_STATUS_SENSOR_BATTERY,
    severity: Severity::Critical,
    is_seen: |sight| sight.is_below(sight.view.config.limits.battery_critical_v),
    words: |sight| words_of_voltage(sight, "empty"),
    ..ROW
};

/// No voltage comes.
pub(super) const SILENT: Condition = Condition {
    name: "battery_unknown",
    seen_by: "No voltage came from the board for 5 s: neither the voltage nor the time left is watched.",
    numbers: &[Number { key: "", value: |_| AGE_S, unit: "s", origin: "10 samples at 2 Hz" }],
    because: "no battery voltage",
    over: "battery voltage is back",
    health: S::MAV_SYS_STATUS_SENSOR_BATTERY,
    severity: Severity::Error,
    is_seen: |sight| sight.fresh_v().is_none(),
    words: |_| "no battery voltage from the board".to_owned(),
    ..ROW
};

#[cfg(test)]
mod tests {
    use super::*;

    fn at(s: f64) -> HostTime {
        HostTime::from_us(1_000_000 + (s * 1e6) as u64)
    }

    fn fly(discharge: &mut Discharge, seconds: f64, v: impl Fn(f64) -> f64) {
        for i in 0..(seconds * 10.0) as u32 {
            let t = f64::from(i) * 0.1;
            discharge.note(at(t), v(t), true);
        }
    }

    /// A limit was passed only when the voltage was below it for 2 s without a break.
    #[test]
    fn regress_a_voltage_that_trembles_about_its_limit_is_below_it() {
        let trembles_v = |mean_v: f64, t: f64| mean_v + 0.15 * (12.0 * t).sin();
        let below_for_s = |mean_v: f64| {
            let mut discharge = Discharge::default();
            let (mut for_s, mut longest_s) = (0.0, 0.0_f64);
            for i in 0..300 {
                let v = trembles_v(mean_v, f64::from(i) * 0.1);
                discharge.note(at(f64::from(i) * 0.1), v, true);
                for_s = if discharge.lower_v(v) < 6.4 { for_s + 0.1 } else { 0.0 };
                longest_s = longest_s.max(for_s);
            }
            longest_s
        };
        assert!(below_for_s(6.35) > 20.0, "its average is below");
        assert!(below_for_s(6.45) < LOW_FOR_S, "its average is above");
        // On the bench there is no average: what was measured last counts.
        assert_eq!(Discharge::default().lower_v(6.3), 6.3);
    }

    #[test]
    fn prop_a_straight_discharge_is_told_to_the_second() {
        for rate in [0.002, 0.01, 0.02] {
            let mut discharge = Discharge::default();
            fly(&mut discharge, 60.0, |t| 8.0 - rate * t + 0.02 * (7.0 * t).sin());
            let left_s = discharge.time_to_s(6.0).unwrap();
            // The low-pass lags by 1 s.
            let truth_s = (8.0 - rate * 60.0 - 6.0) / rate;
            assert!((left_s - truth_s).abs() < 5.0 + 0.1 * truth_s, "{rate}: {left_s} {truth_s}");
        }
    }

    #[test]
    fn prop_a_step_is_no_slope_and_little_flight_tells_nothing() {
        let mut discharge = Discharge::default();
        fly(&mut discharge, 60.0, |t| if t < 46.0 { 8.0 - 0.003 * t } else { 7.4 - 0.003 * t });
        let left_s = discharge.time_to_s(6.0).unwrap();
        assert!((150.0..500.0).contains(&left_s), "{left_s}");
        let mut short = Discharge::default();
        fly(&mut short, 34.0, |t| 8.0 - 0.05 * t);
        assert_eq!(short.time_to_s(6.0), None);
        // On the floor nothing is learned.
        discharge.note(at(61.0), 7.0, false);
        assert_eq!(discharge.time_to_s(6.0), None);
    }

    #[test]
    fn prop_a_pack_that_does_not_fall_lasts() {
        let mut discharge = Discharge::default();
        fly(&mut discharge, 80.0, |t| 7.5 + 0.001 * t);
        assert_eq!(discharge.time_to_s(6.0), None);
    }
}
