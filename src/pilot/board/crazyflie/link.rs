//! The link: bytes of the board in, what they tell out; questions, setpoints and orders that are due.
//!
//! Whatever it decides on came in as bytes or as a time, so that a log replays bit for bit.

use haltere_dialect::crtp::link::Link;
use haltere_dialect::crtp::log::LogRow;
use haltere_dialect::crtp::packet::Packet;
use haltere_dialect::crtp::platform::PlatformAnswer;
use haltere_dialect::crtp::supervisor::SupervisorAnswer;
use haltere_dialect::crtp::{FromBoard, ToBoard};

use haltere_core::frames::{B, E, Rot};
use haltere_core::measure::{BaroSample, BatterySample, ImuSample, ServoOutput};
use haltere_core::time::{HostTime, TagTime};

use super::arming::Arming;
use super::axes;
use super::blocks::{PERIODS_MS, Row};
use super::board_time::{BoardTime, Stamp};
use super::joined::{Joined, join};
use super::setup::{ANCHORS, FLASH, Setup};
use super::tdoa::LoggedTdoa;
use super::told::Told;
use super::trips::Trips;
use crate::input::LinkId;
use crate::navigation::uwb::TagClock;
use crate::out::output::Outbox;

/// A client that was silent for so long has lost its log blocks, s: the board forgets them after 1 s, and the silence that
/// we see is shorter by the way of a packet.
const FORGOTTEN_S: f64 = 0.95;
/// Without a row of the fast blocks, and of the slow one, while the board speaks, they are gone, s: 15 of 15 packets are
/// not lost by chance.
const NO_ROWS_S: [f64; 3] = [0.15, 0.15, 1.5];
/// It speaks: something came within this, s, five times the period of an echo where half of them are lost.
const SPEAKS_S: f64 = 0.25;
/// A setpoint in force that was told so long ago is none, s: one period of its block.
const OLD_TARGET_S: f64 = 0.1;
/// Battery and outputs are passed on so often, µs.
const SLOW_US: i64 = 100_000;
/// IMU rows in a second: fewer are too few to arm. A radio that loses a tenth of 100 leaves 90.
const LEAST_ROWS: u32 = 80;
const SECOND_US: i64 = 1_000_000;
/// Anchors that have not said where they are, or are not heard yet, are asked so often while nobody flies, µs.
const ANCHORS_US: i64 = 5_000_000;
/// Longest line of the console, bytes.
const MOST_LINE: usize = 200;

/// The link.
#[derive(Debug, Default)]
pub(crate) struct Crazyflie {
    joined: Joined,
    setup: Setup,
    was_done: bool,
    trips: Trips,
    time: BoardTime,
    clock: TagClock,
    tdoa: LoggedTdoa,
    arming: Arming,
    rows_at: [HostTime; 3],
    /// Board time of the newest row of the IMU, ms.
    imu_ms: u64,
    /// Rows of the IMU in this second, those of the last whole one, and when this one ends.
    rows: u32,
    rows_hz: Option<u32>,
    second_at: HostTime,
    is_counting: bool,
    slow_at: HostTime,
    anchors_at: HostTime,
    again_at: HostTime,
    setpoint_at: Option<HostTime>,
    outputs: [f64; 2],
    loco_mode: f64,
    line: Vec<u8>,
}

impl Crazyflie {
    /// The link was opened again.
    pub fn restart(&mut self) {
        let flies = self.arming.flies();
        self.joined = Joined::default();
        self.trips = Trips::default();
        self.clock.reset();
        self.tdoa.forget();
        self.setup.again(flies);
        self.was_done = false;
    }

    /// Takes bytes in; the number of those that are no packets.
    pub fn hear(
        &mut self,
        at: HostTime,
        bytes: &[u8],
        out: &mut Outbox,
        told: &mut Vec<Told>,
    ) -> u64 {
        let mut joined = std::mem::take(&mut self.joined);
        let mut strange = 0;
        let bad = joined.push(bytes, |packet| match FromBoard::decode(packet) {
            Ok(message) => self.message(at, &message, told),
            Err(_) => strange += 1,
        });
        self.joined = joined;
        // The next question, at once: tables have hundreds of names.
        self.ask(at, out);
        bad + strange
    }

    fn message(&mut self, at: HostTime, message: &FromBoard<'_>, told: &mut Vec<Told>) {
        let silent_s = self.trips.heard(at);
        if silent_s.is_finite() && silent_s >= FORGOTTEN_S {
            self.begin_again(at);
        }
        match message {
            FromBoard::Row(row) => self.row(at, row, told),
            FromBoard::Link(Link::Echo(bytes)) => {
                told.extend(self.trips.answered(at, bytes).map(Told::Trip));
            }
            FromBoard::Console(text) => self.console(text, told),
            FromBoard::Supervisor(SupervisorAnswer::Arm { done, .. })
            | FromBoard::Platform(PlatformAnswer::Arm { done, .. }) => self.arming.answered(*done),
            other => self.setup.hear(other),
        }
    }

    /// All is asked again: what the board knew of us may be gone.
    fn begin_again(&mut self, at: HostTime) {
        self.setup.again(self.arming.flies());
        self.tdoa.forget();
        self.again_at = at.offset_us(SECOND_US);
        (self.was_done, self.is_counting, self.rows_hz) = (false, false, None);
    }

    fn row(&mut self, at: HostTime, row: &LogRow<'_>, told: &mut Vec<Told>) {
        let Some(values) = self.setup.ids.read(row) else { return };
        let board_ms = match self.time.unwrap(row.time_ms) {
            Stamp::At(ms) => ms,
            Stamp::Restarted(ms) => {
                self.clock.reset();
                self.arming.forget();
                self.begin_again(at);
                told.push(Told::Armed(false));
                told.push(Told::Restarted);
                ms
            }
        };
        if let Some(rows_at) = self.rows_at.get_mut(usize::from(row.block)) {
            *rows_at = at;
        }
        let stamp = TagTime::from_us(board_ms.saturating_mul(1000));
        self.clock.observe(stamp, at);
        let read_at = self.clock.host(stamp).unwrap_or(at).min(at);
        let age_s = at.seconds_since(read_at);
        let valid_at = read_at.offset_us((-1e6 * self.trips.least_s()) as i64);
        match values {
            Row::Imu { force_g, rates_deg_ps, battery_mv } => {
                told.push(Told::Age(age_s));
                self.count_imu(board_ms, told);
                told.push(Told::Imu(ImuSample {
                    valid_at,
                    received_at: at,
                    acc_B_mps2: axes::specific_force(force_g),
                    rate_B_radps: axes::rates(rates_deg_ps),
                }));
                self.slow(at, battery_mv, told);
            }
            Row::State { attitude, tdoa_m, supervisor, outputs } => {
                told.push(Told::Attitude { valid_at, attitude: axes::attitude(attitude) });
                self.arming.look(at, supervisor, told);
                self.outputs = outputs;
                if self.clock.is_old(stamp, at) {
                    self.tdoa.forget();
                } else {
                    let period_s = f64::from(PERIODS_MS[1]) * 1e-3;
                    let times = [valid_at, at];
                    self.tdoa.row(times, tdoa_m, period_s, |tdoa| told.push(Told::Tdoa(tdoa)));
                }
            }
            Row::Slow {
                setpoint: [roll, pitch, yaw, thrust], loco_mode, pressure_mbar, ..
            } => {
                self.loco_mode = loco_mode;
                // What waited in a silence says nothing about what is in force.
                if self.arming.is_open() && age_s < OLD_TARGET_S {
                    let target = axes::in_force([roll, pitch, yaw]);
                    told.push(Told::Target(target, thrust / axes::FULL));
                }
                if pressure_mbar.is_finite() {
                    let pressure_pa = pressure_mbar * 100.0;
                    told.push(Told::Baro(BaroSample { valid_at, received_at: at, pressure_pa }));
                }
            }
        }
    }

    /// How many rows of the IMU come, and how many are lost.
    fn count_imu(&mut self, board_ms: u64, told: &mut Vec<Told>) {
        let period_ms = u64::from(PERIODS_MS[0]);
        let steps = board_ms.saturating_sub(self.imu_ms) / period_ms;
        // More at once is a pause, not a loss.
        if (2..100).contains(&steps) {
            told.push(Told::Lost(steps - 1));
        }
        self.imu_ms = board_ms;
        self.rows += 1;
    }

    /// What is not needed a hundred times a second.
    fn slow(&mut self, at: HostTime, battery_mv: f64, told: &mut Vec<Told>) {
        if at < self.slow_at {
            return;
        }
        self.slow_at = at.offset_us(SLOW_US);
        if battery_mv.is_finite() {
            told.push(Told::Battery(BatterySample {
                received_at: at,
                supply_v: battery_mv * 1e-3,
                current_a: None,
                remaining_frac: None,
            }));
        }
        // At their places m2 and m4.
        let [m2, m4] = self.outputs.map(|output| output as f32);
        let outputs = ServoOutput::new(at, 0, [f32::NAN, m2, f32::NAN, m4]);
        if !outputs.outputs().is_empty() {
            told.push(Told::Servos(outputs));
        }
    }

    /// Lines that speak of something wrong are passed on.
    fn console(&mut self, text: &[u8], told: &mut Vec<Told>) {
        for byte in text {
            if *byte != b'\n' && self.line.len() < MOST_LINE {
                self.line.push(*byte);
                continue;
            }
            let line = String::from_utf8_lossy(&self.line).trim().to_owned();
            self.line.clear();
            // A count of the radio is no failure: `TDoA2 (rx=472 timeout=0 failed=0)` is all well.
            let lower = line.to_ascii_lowercase().replace("failed=", "");
            if ["error", "fail", "locked", "assert"].iter().any(|word| lower.contains(word)) {
                told.push(Told::Text { severity: 4, text: line });
            }
        }
    }

    /// What is due by time.
    pub fn tick(&mut self, at: HostTime, out: &mut Outbox, told: &mut Vec<Told>) {
        if at >= self.second_at {
            self.second_at = at.offset_us(SECOND_US);
            let rows = std::mem::take(&mut self.rows);
            self.rows_hz = Some(rows).filter(|_| self.is_counting);
            self.is_counting = self.was_done;
        }
        self.look_for_rows(at, told);
        self.tell_setup(at, told);
        send(self.trips.due(at), out);
        self.ask(at, out);
        let turns = self.outputs.iter().any(|output| *output > 0.0);
        let order = self.arming.tick(at, self.setup.protocol, turns, told);
        send(order.and_then(|order| order.encode()), out);
        // Setpoints never pause while it is connected: the first zero unlocks its thrust, and a board that misses them for
        // 2 s locks itself.
        if self.setpoint_at != Some(at) {
            self.setpoint(at, Rot::identity(), 0.0, out);
        }
    }

    /// Rows that do not come though the board speaks are no longer asked for.
    fn look_for_rows(&mut self, at: HostTime, told: &mut Vec<Told>) {
        let speaks = self.trips.silent_s(at) < SPEAKS_S;
        if !(self.was_done && speaks && at >= self.again_at) {
            return;
        }
        // Counted to what was heard last: in a silence nothing has stopped.
        let (since, heard_at) = (self.trips.talks_since(), self.trips.heard_at());
        let blocks = (0..).zip(self.rows_at).zip(NO_ROWS_S);
        let mut made = blocks.filter(|((block, _), _)| self.setup.ids.part(*block, 0).is_some());
        if made.any(|((_, rows_at), most_s)| heard_at.seconds_since(rows_at.max(since)) > most_s) {
            let text = "board's rows have stopped though it speaks: they are asked for again; is another client connected?";
            told.push(Told::warning(text));
            self.begin_again(at);
        }
    }

    fn tell_setup(&mut self, at: HostTime, told: &mut Vec<Told>) {
        told.extend(self.setup.told.drain(..).map(Told::warning));
        if !self.setup.is_done() {
            return;
        }
        if !std::mem::replace(&mut self.was_done, true) {
            self.rows_at = [at; 3];
            self.anchors_at = at.offset_us(ANCHORS_US);
            if self.setup.is_first() {
                told.push(Told::Notice { warning: false, text: self.name() });
            }
            if self.setup.is_old() {
                let firmware = &self.setup.firmware;
                let text = format!(
                    "board has firmware {firmware}, which may lock itself after a landing: {FLASH}"
                );
                told.push(Told::warning(text));
            }
            for (group, name, _) in self.setup.ids.missing().filter(|(_, _, must)| !must) {
                let text = format!("board has no log variable {group}.{name}: flown without");
                told.push(Told::Notice { warning: false, text });
            }
        }
        if at >= self.anchors_at && !self.arming.is_open() {
            self.anchors_at = at.offset_us(ANCHORS_US);
            self.setup.ask_anchors();
        }
        if std::mem::take(&mut self.setup.anchors_read) {
            told.push(Told::Anchors(self.setup.anchors));
        }
    }

    fn name(&self) -> String {
        let protocol = self.setup.protocol.unwrap_or_default();
        let firmware = &self.setup.firmware;
        format!("board found, a Crazyflie with firmware {firmware}, protocol {protocol}")
    }

    fn ask(&mut self, at: HostTime, out: &mut Outbox) {
        send(self.setup.due(at), out);
    }

    /// Sends one setpoint, attitude in the board's own frame; its thrust only where the board is armed by us. What was sent.
    pub fn setpoint(
        &mut self,
        at: HostTime,
        attitude: Rot<E, B>,
        thrust_frac: f64,
        out: &mut Outbox,
    ) -> f64 {
        self.setpoint_at = Some(at);
        let thrust_frac = if self.arming.is_open() { thrust_frac } else { 0.0 };
        if self.arming.may_send() {
            send(ToBoard::Setpoint(axes::setpoint(attitude, thrust_frac)).encode(), out);
        }
        thrust_frac
    }

    /// Asks it to arm or to disarm.
    pub fn command_arm(&mut self, arm: bool, force: bool, at: HostTime) {
        self.arming.begin(arm, force, at);
    }

    /// Whether such an order waits for its end.
    pub fn is_commanding(&self) -> bool {
        self.arming.is_under_way()
    }

    /// It is taken for disarmed.
    pub fn shut(&mut self) {
        self.arming.shut();
    }

    /// Why it must not be armed, for people.
    pub fn refusal(&self) -> Option<String> {
        if let Some((group, name, _)) = self.setup.ids.missing().find(|(_, _, must)| *must)
            && self.setup.is_done()
        {
            return Some(format!(
                "board has no log variable {group}.{name} (firmware {}): {FLASH}",
                self.setup.firmware
            ));
        }
        if !self.setup.is_done() {
            return Some(format!("board is asked what it has: {}", self.setup.progress()));
        }
        if let Some(why) = self.setup.refused.first() {
            return Some(why.clone());
        }
        if let Some(why) = self.arming.refusal() {
            return Some(why.to_owned());
        }
        if self.loco_mode == TDOA3 {
            return Some(
                "anchors speak TDoA3, of which the board tells one pair at a time: set them to TDoA2 with cfclient"
                    .to_owned(),
            );
        }
        if self.loco_mode == TDOA2 && self.setup.anchors.iter().all(Option::is_none) {
            return Some(
                "anchors do not say where they stand, and without that the board makes no time differences: give them \
                 their positions with cfclient"
                    .to_owned(),
            );
        }
        let Some(rows_hz) = self.rows_hz else {
            return Some("board has just begun to send its rows: wait a second".to_owned());
        };
        (rows_hz < LEAST_ROWS).then(|| {
            format!(
                "board sends its IMU at {rows_hz} Hz, at least {LEAST_ROWS} needed: its radio is too slow or too far away"
            )
        })
    }
}

/// `loco.mode`.
const TDOA2: f64 = 2.0;
const TDOA3: f64 = 3.0;

const _: () = assert!(ANCHORS == 8, "blocks.rs names the differences of eight");

fn send(packet: Option<Packet>, out: &mut Outbox) {
    if let Some(packet) = packet {
        join(&packet, |bytes| out.raw(LinkId::Board, bytes));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_dialect::crtp::platform::PlatformRequest;
    use proptest::prelude::*;

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(1_000_000 + 1_000 * ms)
    }

    /// Requests and setpoints that wait to be sent.
    fn sent(out: &mut Outbox) -> Vec<Packet> {
        let mut all = Vec::new();
        out.drain(|_, bytes| {
            Joined::default().push(bytes, |packet| all.push(*packet));
        });
        all
    }

    #[test]
    fn prop_who_does_not_know_the_board_sends_it_no_setpoint() {
        let (mut board, mut out, mut told) = (Crazyflie::default(), Outbox::default(), Vec::new());
        for ms in (0..500).step_by(10) {
            board.setpoint(at(ms), Rot::identity(), 0.5, &mut out);
            board.tick(at(ms), &mut out, &mut told);
        }
        let packets = sent(&mut out);
        let requests: Vec<_> =
            packets.iter().map(|packet| ToBoard::decode(packet).unwrap()).collect();
        assert!(requests.contains(&ToBoard::Platform(PlatformRequest::Protocol)));
        assert!(
            !requests.iter().any(|request| matches!(request, ToBoard::Setpoint(_))),
            "{requests:?}"
        );
        assert_eq!(told, []);
    }

    #[test]
    fn val_what_its_console_says_of_failures_is_passed_on_and_counts_are_not() {
        let (mut board, mut told) = (Crazyflie::default(), Vec::new());
        // As 2026.08 says it, in packets that end anywhere.
        for text in [
            "DWM: Automatic mode: detected TDoA2 (rx=472 time",
            "out=0 failed=0)\nSTORAGE: Storage check [FAIL].\nSUP: Lo",
            "cked, reboot required\nSYS: Self test passed!\n",
        ] {
            board.console(text.as_bytes(), &mut told);
        }
        let warned = |text: &str| Told::Text { severity: 4, text: text.to_owned() };
        let [storage, locked] = ["STORAGE: Storage check [FAIL].", "SUP: Locked, reboot required"];
        assert_eq!(told, [warned(storage), warned(locked)]);
    }

    proptest! {
        #[test]
        fn prop_no_bytes_can_harm(
            packets in prop::collection::vec(prop::collection::vec(any::<u8>(), 1..=31), 0..60),
        ) {
            let (mut board, mut out, mut told) =
                (Crazyflie::default(), Outbox::default(), Vec::new());
            for (ms, packet) in (0..).zip(packets) {
                let mut bytes = vec![packet.len() as u8];
                bytes.extend(packet);
                board.hear(at(7 * ms), &bytes, &mut out, &mut told);
                board.tick(at(7 * ms), &mut out, &mut told);
                board.command_arm(ms % 2 == 0, ms % 3 == 0, at(7 * ms));
            }
        }
    }
}
