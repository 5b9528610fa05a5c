//! What the board is asked to stream, and whether it does.
//!
//! An acknowledgement is no proof: every rate is measured, and asked for again when it falls short (a
//! reboot forgets all of them). A refused rate leaves the old one in force, so the next lower one is
//! asked for, then the next message that can carry the same.

use haltere_core::time::HostTime;

use super::profile::Firmware;

/// Length of a measurement, s.
const WINDOW_S: f64 = 1.0;
/// A rate is short below this share of the least: a window cuts off a message at each end.
const SHORT_SHARE: f64 = 0.97;
/// Asked again after this time while the rate stays short, µs.
const AGAIN_US: i64 = 1_500_000;
/// An answer to a request is waited for, s: it does not say which message it is for.
const ANSWER_S: f64 = 0.5;
/// After so many short windows of an accepted rate the next one is tried: boards that decimate give
/// more for one that divides theirs.
const SHORT_WINDOWS: u32 = 3;

/// HIGHRES_IMU, SCALED_IMU, RAW_IMU.
const IMU_IDS: &[u32] = &[105, 26, 27];
/// ArduPilot's SCALED_IMU are other sensors' averages; RAW_IMU is the first one's.
const IMU_IDS_ARDUPILOT: &[u32] = &[105, 27, 26];
/// ATTITUDE_QUATERNION, ATTITUDE.
const ATTITUDE_IDS: &[u32] = &[31, 30];
/// BATTERY_STATUS, SYS_STATUS.
const BATTERY_IDS: &[u32] = &[147, 1];
/// ATTITUDE_TARGET.
const TARGET_IDS: &[u32] = &[83];
/// SERVO_OUTPUT_RAW, ACTUATOR_OUTPUT_STATUS.
const SERVO_IDS: &[u32] = &[36, 375];
/// HEARTBEAT.
const HEARTBEAT_IDS: &[u32] = &[0];

/// What is only wished for is asked for so often, without success, and then left at what it is.
const WISHES: u32 = 5;

/// Whether a message says what motors and servos are told.
pub(super) fn is_servos(msg_id: u32) -> bool {
    SERVO_IDS.contains(&msg_id)
}

/// What motors and servos were told: to look at afterwards, nothing is flown on it.
fn servos() -> Need {
    Need::new(SERVO_IDS, &[10.0], 5.0, 2.0).wish()
}

/// A stream that we need, with the messages that can carry it, best first.
#[derive(Debug)]
struct Need {
    candidates: &'static [u32],
    chosen: usize,
    /// Rates to ask for, best first, Hz.
    rates_hz: &'static [f64],
    rung: usize,
    /// Asked for instead on a line that is too slow, Hz.
    calm_hz: f64,
    least_hz: f64,
    /// Whether arming is refused without it.
    must: bool,
    count: u32,
    rate_hz: f64,
    next_ask: HostTime,
    /// Since when it should come as asked.
    accepted: Option<HostTime>,
    short: u32,
    /// How often it was asked for since it last came as it should.
    asked: u32,
    /// Everything was refused: it is left at what it is.
    given_up: bool,
}

impl Need {
    fn new(
        candidates: &'static [u32],
        rates_hz: &'static [f64],
        calm_hz: f64,
        least_hz: f64,
    ) -> Self {
        Self {
            candidates,
            chosen: 0,
            rates_hz,
            rung: 0,
            calm_hz,
            least_hz,
            must: true,
            count: 0,
            rate_hz: 0.0,
            next_ask: HostTime::default(),
            accepted: None,
            short: 0,
            asked: 0,
            given_up: false,
        }
    }

    fn wish(self) -> Self {
        Self { must: false, ..self }
    }

    fn id(&self) -> u32 {
        self.candidates[self.chosen]
    }

    fn is_short(&self) -> bool {
        self.rate_hz < SHORT_SHARE * self.least_hz
    }

    /// The board refused this rate of this message.
    fn refused(&mut self, at: HostTime) {
        self.next_ask = at;
        if self.rung + 1 < self.rates_hz.len() {
            self.rung += 1;
            return;
        }
        self.rung = 0;
        self.chosen = (self.chosen + 1) % self.candidates.len();
        if self.chosen == 0 {
            // All were refused; it may be booting.
            self.next_ask = at.offset_us(AGAIN_US);
            self.given_up = !self.must;
        }
    }
}

/// All of them.
#[derive(Debug)]
pub(crate) struct Streams {
    needs: Vec<Need>,
    /// What an answer is waited for, and since when.
    asking: Option<(usize, HostTime)>,
    window_start: HostTime,
    calm: bool,
}

/// Rates of INTERFACES.md section 2, IMU 250 Hz first; below that what both firmwares can divide.
const IMU_HZ: &[f64] = &[250.0, 200.0, 125.0];

impl Streams {
    /// Everything that this firmware is to send.
    pub fn new(firmware: Firmware, at: HostTime) -> Self {
        let needs = match firmware {
            // Its log blocks take their place.
            Firmware::Crazyflie => Vec::new(),
            Firmware::Generic => vec![
                Need::new(IMU_IDS, IMU_HZ, 100.0, 100.0),
                Need::new(ATTITUDE_IDS, &[100.0], 50.0, 50.0),
                Need::new(BATTERY_IDS, &[10.0], 2.5, 2.0),
                servos(),
            ],
            // Its IMU comes at 250 Hz, decimated by whole numbers: 200 would give 124 (seen).
            Firmware::Px4 => vec![
                Need::new(IMU_IDS, &[250.0, 125.0], 125.0, 100.0),
                Need::new(ATTITUDE_IDS, &[125.0, 250.0, 100.0], 62.5, 50.0),
                Need::new(BATTERY_IDS, &[5.0], 2.5, 2.0),
                Need::new(TARGET_IDS, &[50.0, 25.0], 12.5, 10.0),
                servos(),
            ],
            // Whole milliseconds, none shorter than its loop: 4 ms (seen).
            Firmware::ArduPilot => vec![
                Need::new(IMU_IDS_ARDUPILOT, &[200.0, 125.0, 100.0], 100.0, 100.0),
                Need::new(ATTITUDE_IDS, &[100.0, 50.0], 50.0, 50.0),
                Need::new(BATTERY_IDS, &[5.0, 2.0], 2.5, 2.0),
                Need::new(TARGET_IDS, &[50.0, 25.0], 12.5, 10.0),
                Need::new(HEARTBEAT_IDS, &[10.0, 5.0], 5.0, 4.0).wish(),
                servos(),
            ],
        };
        Self { needs, asking: None, window_start: at, calm: false }
    }

    /// The board may have forgotten everything: all is asked for again, best first.
    pub fn restart(&mut self, at: HostTime) {
        self.asking = None;
        for need in &mut self.needs {
            need.next_ask = at;
            need.accepted = None;
            need.asked = 0;
            need.given_up = false;
        }
    }

    /// A reboot: what was refused once may be granted now.
    pub fn forget(&mut self, at: HostTime) {
        self.restart(at);
        self.calm = false;
        for need in &mut self.needs {
            (need.chosen, need.rung, need.short) = (0, 0, 0);
        }
    }

    /// The line is too slow for all of this: less of everything.
    pub fn calm_down(&mut self, at: HostTime) {
        if !self.calm {
            self.calm = true;
            self.restart(at);
        }
    }

    /// Counts a message.
    pub fn note(&mut self, msg_id: u32) {
        for need in &mut self.needs {
            if need.id() == msg_id {
                need.count += 1;
            }
        }
    }

    /// Whether a message is one that was asked for.
    pub fn is_ours(&self, msg_id: u32) -> bool {
        self.needs.iter().any(|n| n.id() == msg_id)
    }

    /// What is slower than it must be, as text for people.
    pub fn slow(&self) -> Option<String> {
        let slow = self.needs.iter().find(|need| need.must && need.is_short())?;
        Some(format!(
            "board sends message {} at {:.0} Hz, at least {:.0} needed",
            slow.id(),
            slow.rate_hz,
            slow.least_hz
        ))
    }

    /// The answer to the request that is under way.
    pub fn answered(&mut self, at: HostTime, accepted: bool) {
        let Some((index, _)) = self.asking.take() else { return };
        let Some(need) = self.needs.get_mut(index) else { return };
        if accepted {
            need.accepted.get_or_insert(at);
        } else {
            need.refused(at);
        }
    }

    /// Ends a measurement when its time has come.
    pub fn measure(&mut self, at: HostTime) {
        let window_s = at.seconds_since(self.window_start);
        if window_s < WINDOW_S {
            return;
        }
        let began = self.window_start;
        self.window_start = at;
        for need in &mut self.needs {
            need.rate_hz = f64::from(need.count) / window_s;
            need.count = 0;
            if !need.is_short() {
                (need.short, need.asked) = (0, 0);
                continue;
            }
            if need.accepted.is_some_and(|since| since <= began) {
                need.short += 1;
            }
            if need.next_ask.seconds_since(at) > 1.0 {
                need.next_ask = at;
            }
        }
    }

    /// The next request: message id and interval, µs. One at a time, because an acknowledgement does
    /// not say which message it is for.
    pub fn ask(&mut self, at: HostTime) -> Option<(u32, f64)> {
        if let Some((_, since)) = self.asking {
            if at.seconds_since(since) < ANSWER_S {
                return None;
            }
            self.asking = None;
        }
        let calm = self.calm;
        let due = |n: &Need| at >= n.next_ask && !n.given_up;
        let index = self.needs.iter().position(due)?;
        let need = &mut self.needs[index];
        need.asked = need.asked.saturating_add(1);
        need.given_up = !need.must && need.asked >= WISHES;
        if need.short >= SHORT_WINDOWS && !calm {
            (need.short, need.accepted) = (0, None);
            need.rung = (need.rung + 1) % need.rates_hz.len();
        }
        // `measure` brings it forward when the rate falls short later.
        let again_us = if need.is_short() { AGAIN_US } else { i64::MAX };
        need.next_ask = at.offset_us(again_us);
        self.asking = Some((index, at));
        let rate_hz = if calm { need.calm_hz } else { need.rates_hz[need.rung] };
        Some((self.needs[index].id(), 1e6 / rate_hz))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(1_000_000 + ms * 1000)
    }

    /// Runs against a board that answers `grants(id, interval)` with the rate that it then gives, Hz.
    fn settle(
        streams: &mut Streams,
        from_ms: u64,
        seconds: u64,
        grants: impl Fn(u32, f64) -> Option<f64>,
    ) -> Vec<(u32, f64)> {
        let mut given: Vec<(u32, f64, f64)> = Vec::new();
        let mut asked = Vec::new();
        for ms in (from_ms..from_ms + seconds * 1000).step_by(10) {
            streams.measure(at(ms));
            if let Some((id, interval_us)) = streams.ask(at(ms)) {
                asked.push((id, (1e6 / interval_us).round()));
                let rate = grants(id, interval_us);
                if let Some(rate) = rate {
                    given.retain(|g| g.0 != id);
                    given.push((id, rate, 0.0));
                }
                streams.answered(at(ms), rate.is_some());
            }
            for (id, rate, due) in &mut given {
                *due += *rate * 0.01;
                while *due >= 1.0 {
                    *due -= 1.0;
                    streams.note(*id);
                }
            }
        }
        asked
    }

    #[test]
    fn prop_a_refused_rate_is_lowered_before_another_message_is_taken() {
        let mut streams = Streams::new(Firmware::ArduPilot, at(0));
        // Nothing faster than 5 ms, no HIGHRES_IMU: an older release.
        let asked =
            settle(&mut streams, 0, 6, |id, us| (id != 105 && us >= 7_900.0).then_some(1e6 / us));
        assert_eq!(streams.slow(), None, "{asked:?}");
        assert!(asked.contains(&(105, 200.0)) && asked.contains(&(27, 125.0)), "{asked:?}");
        assert!(!asked.iter().any(|a| a.0 == 26), "{asked:?}");
    }

    #[test]
    fn prop_lost_intervals_are_asked_for_again() {
        let mut streams = Streams::new(Firmware::Px4, at(0));
        settle(&mut streams, 0, 4, |_, us| Some(1e6 / us));
        assert_eq!(streams.slow(), None);
        // Nobody says a word, the streams just end.
        let asked = settle(&mut streams, 4000, 5, |_, us| Some(1e6 / us));
        assert!(asked.len() >= 4, "{asked:?}");
        assert_eq!(streams.slow(), None);
    }

    #[test]
    fn prop_an_accepted_rate_that_is_decimated_too_far_is_asked_for_in_another_way() {
        let mut streams = Streams::new(Firmware::Px4, at(0));
        // 125 Hz gives 31, 250 gives 83.
        let asked = settle(&mut streams, 0, 12, |id, us| {
            Some(if id != 31 {
                1e6 / us
            } else if us > 7000.0 {
                31.0
            } else {
                83.0
            })
        });
        assert!(asked.contains(&(31, 250.0)), "{asked:?}");
        assert_eq!(streams.slow(), None);
    }

    #[test]
    fn prop_a_wish_that_is_refused_is_given_up_and_a_need_is_not() {
        let mut streams = Streams::new(Firmware::ArduPilot, at(0));
        let asked = settle(&mut streams, 0, 10, |id, us| (id != 0 && id != 83).then_some(1e6 / us));
        let count = |id| asked.iter().filter(|a| a.0 == id).count();
        assert_eq!(count(0), 2, "{asked:?}");
        assert!((6..30).contains(&count(83)), "asked on, but not at every turn: {asked:?}");
        assert!(streams.slow().is_some_and(|s| s.contains("message 83")));
    }

    /// A board that answers nothing, or grants and does not send.
    #[test]
    fn prop_what_motors_are_told_is_not_asked_for_without_end() {
        for firmware in [Firmware::Generic, Firmware::Px4, Firmware::ArduPilot] {
            for granted in [false, true] {
                let mut streams = Streams::new(firmware, at(0));
                let grants = |id: u32, us: f64| match is_servos(id) {
                    true => granted.then_some(0.0),
                    false => Some(1e6 / us),
                };
                let asked = settle(&mut streams, 0, 60, grants);
                let count = asked.iter().filter(|a| is_servos(a.0)).count();
                assert!((1..=10).contains(&count), "{firmware:?} {asked:?}");
                assert_eq!(streams.slow(), None, "nothing is refused for it");
                // After a reboot it may be there.
                streams.forget(at(60_000));
                let asked = settle(&mut streams, 60_000, 5, |_, us| Some(1e6 / us));
                assert!(asked.contains(&(36, 10.0)), "{asked:?}");
            }
        }
    }

    #[test]
    fn prop_a_calm_board_is_asked_for_less() {
        let mut streams = Streams::new(Firmware::ArduPilot, at(0));
        settle(&mut streams, 0, 4, |_, us| Some(1e6 / us));
        streams.calm_down(at(4000));
        let asked = settle(&mut streams, 4000, 4, |_, us| Some(1e6 / us));
        assert!(asked.contains(&(105, 100.0)) && asked.contains(&(31, 50.0)), "{asked:?}");
        assert_eq!(streams.slow(), None);
    }
}
