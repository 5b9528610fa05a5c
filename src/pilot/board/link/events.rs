//! Words for PX4's events, which travel as numbers: an event's number is a hash of its name, so the names that
//! matter to a companion are enough. What is not among them is told by its number.

use haltere_core::time::HostTime;

/// Component of the autopilot, in the highest byte of the number.
const AUTOPILOT: u32 = 1 << 24;
/// The same event again within this time is not told again, s: PX4 repeats what fails at each attempt.
const AGAIN_S: f64 = 5.0;

/// Names as in the source of PX4 1.16.1, and what they mean to who stands beside the vehicle.
const KNOWN: [(&str, &str); 34] = [
    ("check_accel_missing", "no accelerometer"),
    ("check_accel_not_calibrated", "accelerometer not calibrated"),
    ("check_baro_missing", "no barometer"),
    ("check_battery_critical", "battery critical"),
    ("check_battery_emergency", "battery nearly empty"),
    ("check_battery_low", "battery low"),
    ("check_battery_missing", "no battery monitor"),
    ("check_battery_unhealthy", "battery unhealthy"),
    ("check_cpuload_too_high", "its processor is overloaded"),
    ("check_estimator_heading_not_stable", "heading not settled"),
    ("check_estimator_high_accel_bias", "accelerometer bias too large"),
    ("check_estimator_high_gyro_bias", "gyroscope bias too large"),
    ("check_estimator_hgt_not_stable", "height not settled"),
    ("check_estimator_mag_interference", "magnetic interference"),
    ("check_gyro_missing", "no gyroscope"),
    ("check_gyro_not_calibrated", "gyroscope not calibrated"),
    ("check_imu_accel_inconsistent", "accelerometers differ"),
    ("check_imu_gyro_inconsistent", "gyroscopes differ"),
    ("check_mag_missing", "no magnetometer"),
    ("check_mag_not_calibrated", "magnetometer not calibrated"),
    ("check_modes_attitude", "no attitude"),
    ("check_modes_global_pos", "its mode needs a place on the map"),
    ("check_modes_local_pos", "its mode needs a position"),
    ("check_modes_manual_control", "no remote control"),
    ("check_modes_offboard_signal", "no setpoints for OFFBOARD yet"),
    ("commander_arm_denied_calibrating", "does not arm: calibrating"),
    ("commander_arm_denied_resolve_failures", "does not arm: its checks fail"),
    ("commander_arm_denied_throttle_high", "does not arm: throttle of the remote control is up"),
    ("commander_disarm_denied_not_landed", "does not disarm: not landed, it thinks"),
    ("commander_failsafe_enter", "failsafe"),
    ("commander_failsafe_enter_crit_low_bat_warn", "failsafe: battery"),
    ("commander_failsafe_enter_generic", "failsafe"),
    ("commander_modeswitch_not_avail", "refuses the mode"),
    ("failsafe_rc_override", "a pilot took over with the sticks"),
];

/// FNV-1a of 32 bits.
const fn hash(name: &str) -> u32 {
    let (bytes, mut hash, mut i) = (name.as_bytes(), 0x811c_9dc5_u32, 0);
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u32).wrapping_mul(0x0100_0193);
        i += 1;
    }
    hash
}

/// The number of an event.
const fn number(name: &str) -> u32 {
    (hash(name) & 0x00ff_ffff) | AUTOPILOT
}

/// What was told last, and when.
#[derive(Debug, Default)]
pub(super) struct Events(Option<(u32, HostTime)>);

impl Events {
    /// Words for an event, unless it was told just now.
    pub fn told(&mut self, at: HostTime, id: u32) -> Option<String> {
        if self.0.is_some_and(|(last, when)| last == id && at.seconds_since(when) < AGAIN_S) {
            return None;
        }
        self.0 = Some((id, at));
        let known = KNOWN.iter().find(|(name, _)| number(name) == id);
        Some(match known {
            Some((_, words)) => (*words).to_owned(),
            None => format!("event {id} (PX4 sends no words for it)"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_numbers_are_those_that_a_real_px4_sent() {
        // PX4 1.16.1 in software-in-the-loop, on the floor without a position, then asked to disarm too early.
        let mut events = Events::default();
        let at = HostTime::from_us;
        let mut told = |us, id| events.told(at(us), id);
        assert_eq!(told(0, 30_612_409).unwrap(), "its mode needs a position");
        assert_eq!(told(1, 26_788_467).unwrap(), "its mode needs a place on the map");
        assert_eq!(told(2, 19_865_031).unwrap(), "no setpoints for OFFBOARD yet");
        assert_eq!(told(3, 17_231_145).unwrap(), "no remote control");
        assert_eq!(told(4, 25_868_725).unwrap(), "does not disarm: not landed, it thinks");
        assert_eq!(told(400_000, 25_868_725), None);
        assert!(told(6_000_000, 25_868_725).is_some());
        assert!(told(7_000_000, 1).unwrap().contains("event 1 "));
    }

    #[test]
    fn prop_no_two_names_share_a_number() {
        let mut numbers: Vec<u32> = KNOWN.iter().map(|(name, _)| number(name)).collect();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), KNOWN.len());
    }
}
