//! Which of several like devices of the board is flown on, where messages carry an instance id.
//!
//! A board may have several batteries, inertial sensors and barometers, and send a message for each. Taken for one,
//! a full pack hides an empty one. The choice is made on the floor, told where there is one, and stays in flight.

use haltere_dialect::mav::haltere::MavBatteryFunction as Function;
use haltere_dialect::mav::known;

use haltere_core::time::HostTime;

/// A device that was silent for longer is not there, s: batteries come at 2 Hz or more.
const SILENT_S: f64 = 2.0;
/// Most devices of a kind that are told apart: ids beyond are not flown on.
const MOST: usize = 8;

/// Kinds of devices of which a board may have several.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Battery,
    /// A message that carries an IMU, by its id.
    ImuMessage,
    Imu,
    Barometer,
    Magnetometer,
}

impl Kind {
    pub const COUNT: usize = 5;

    /// Name for people.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Battery => "battery",
            Kind::ImuMessage => "IMU of message",
            Kind::Imu => "IMU",
            Kind::Barometer => "barometer",
            Kind::Magnetometer => "magnetometer",
        }
    }
}

/// What a message of a device is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Use {
    /// It is flown on.
    pub flown: bool,
    /// The choice, or what there is to choose from, is another one than before.
    pub news: bool,
}

/// A device that was heard.
#[derive(Debug, Clone, Copy)]
struct Device {
    id: u8,
    /// The less, the better.
    rank: u8,
    heard_at: HostTime,
}

/// All devices of a kind.
#[derive(Debug, Default)]
pub(super) struct Instances {
    heard: [Option<Device>; MOST],
    chosen: Option<u8>,
}

impl Instances {
    /// A healthy message of a device. The first device is taken, and changed for one of a lower rank, or when it is
    /// silent, while that `may_change`.
    pub fn hear(&mut self, at: HostTime, id: u8, rank: u8, may_change: bool) -> Use {
        let known = self.heard.iter_mut().flatten().find(|device| device.id == id);
        let is_new = known.is_none();
        let device = Device { id, rank, heard_at: at };
        if let Some(known) = known {
            *known = device;
        } else if let Some(free) = self.heard.iter_mut().find(|slot| slot.is_none()) {
            *free = Some(device);
        } else {
            return Use { flown: self.chosen == Some(id), news: false };
        }
        let before = self.chosen;
        let is_better = |chosen: u8| {
            let chosen = self.heard.iter().flatten().find(|device| device.id == chosen);
            chosen.is_none_or(|c| c.rank > rank || at.seconds_since(c.heard_at) > SILENT_S)
        };
        if before.is_none_or(|chosen| chosen != id && may_change && is_better(chosen)) {
            self.chosen = Some(id);
        }
        let several = self.heard.iter().flatten().count() > 1;
        Use { flown: self.chosen == Some(id), news: several && (is_new || self.chosen != before) }
    }

    /// The choice for people: the id that is flown on, and the others.
    pub fn words(&self, kind: &str) -> String {
        let others = self.heard.iter().flatten().map(|device| device.id);
        let mut others: Vec<u8> = others.filter(|id| Some(*id) != self.chosen).collect();
        others.sort_unstable();
        let others: Vec<String> = others.iter().map(u8::to_string).collect();
        let chosen = self.chosen.unwrap_or_default();
        format!("{kind} {chosen} is flown on, not {}", others.join(", "))
    }
}

/// Rank of a battery: what drives the motors before what does not say, and that before what drives something else;
/// then the lowest id.
pub(super) fn battery_rank(function: u8, id: u8) -> u8 {
    let of_function = match known(function) {
        Some(Function::MAV_BATTERY_FUNCTION_ALL | Function::MAV_BATTERY_FUNCTION_PROPULSION) => 0,
        Some(Function::MAV_BATTERY_FUNCTION_UNKNOWN) => 1,
        _ => 2,
    };
    of_function * 64 + id.min(63)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(1_000_000 + ms * 1000)
    }

    fn battery(
        packs: &mut Instances,
        ms: u64,
        id: u8,
        function: Function,
        may_change: bool,
    ) -> Use {
        packs.hear(at(ms), id, battery_rank(function as u8, id), may_change)
    }

    #[test]
    fn prop_the_flight_pack_is_found_by_function_and_id_and_stays_in_flight() {
        use Function as F;
        let mut packs = Instances::default();
        let all = |flown, news| Use { flown, news };
        let avionics = F::MAV_BATTERY_FUNCTION_AVIONICS;
        let unknown = F::MAV_BATTERY_FUNCTION_UNKNOWN;
        let propulsion = F::MAV_BATTERY_FUNCTION_PROPULSION;
        // Alone it is what there is, without a word.
        assert_eq!(battery(&mut packs, 0, 0, avionics, true), all(true, false));
        assert_eq!(battery(&mut packs, 100, 2, unknown, true), all(true, true));
        assert_eq!(battery(&mut packs, 150, 0, avionics, true), all(false, false));
        assert_eq!(battery(&mut packs, 200, 1, unknown, true), all(true, true), "the lower id");
        assert_eq!(battery(&mut packs, 300, 5, propulsion, true), all(true, true));
        assert_eq!(packs.words("battery"), "battery 5 is flown on, not 0, 1, 2");
        // In flight none takes its place, neither a better one nor when it is silent.
        assert_eq!(battery(&mut packs, 400, 4, propulsion, false), all(false, true));
        assert_eq!(battery(&mut packs, 9000, 4, propulsion, false), all(false, false));
        assert_eq!(battery(&mut packs, 9100, 5, propulsion, false), all(true, false));
        // On the floor again the lower id is right.
        assert_eq!(battery(&mut packs, 9200, 4, propulsion, true), all(true, true));
    }

    #[test]
    fn prop_the_first_device_stays_while_it_is_heard() {
        let mut imus = Instances::default();
        assert!(imus.hear(at(0), 1, 0, true).flown);
        for ms in (0..3000).step_by(4) {
            assert!(!imus.hear(at(ms), 0, 0, true).flown && imus.hear(at(ms), 1, 0, true).flown);
        }
        assert!(!imus.hear(at(9000), 0, 0, false).flown, "not in flight");
        assert!(imus.hear(at(9000), 0, 0, true).flown, "silent on the floor");
        for id in 0..=255 {
            imus.hear(at(9001), id, 0, true);
        }
        assert!(imus.hear(at(9002), 0, 0, true).flown);
    }
}
