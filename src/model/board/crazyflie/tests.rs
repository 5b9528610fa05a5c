//! Each law of the board, in its own time.

use haltere_dialect::crtp::platform::PlatformRequest;
use haltere_dialect::crtp::setpoint::Setpoint as Asked;
use haltere_dialect::crtp::supervisor::SupervisorRequest;
use haltere_dialect::crtp::{FromBoard, ToBoard};

use super::*;

const STEP_US: u64 = 2_000;

struct Rig {
    board: Crazyflie,
    t_us: u64,
    out: Vec<u8>,
    flies: Option<Setpoint>,
    seen: Vec<(u64, u16)>,
}

impl Rig {
    fn new(build: Build) -> Self {
        let radio = Radio { packets_hz: 0.0, ..Radio::default() };
        let settings = CrazyflieSettings { build, radio, usb: false };
        let board = Crazyflie::new(settings, [Some([0.0; 3]); ANCHORS], 1);
        let mut rig = Self { board, t_us: 0, out: Vec::new(), flies: None, seen: Vec::new() };
        rig.run(0.5);
        rig
    }

    fn send(&mut self, message: &ToBoard<'_>) {
        let packet = message.encode().unwrap();
        let mut bytes = vec![packet.bytes().len() as u8];
        bytes.extend_from_slice(packet.bytes());
        self.board.receive(self.t_us, &bytes);
    }

    fn run(&mut self, s: f64) {
        for _ in 0..(s / STEP_S).round() as u64 {
            self.t_us += STEP_US;
            let sensed = Sensed { acc_g: [0.0, 0.0, 1.0], ..Sensed::default() };
            self.flies = self.board.step(self.t_us, sensed, &mut self.out);
            let bits = self.board.supervisor.bits().bits();
            if self.seen.last().is_none_or(|(_, last)| *last != bits) {
                self.seen.push((self.t_us, bits));
            }
        }
    }

    fn stream(&mut self, s: f64, [roll, pitch, yaw]: [f32; 3], thrust: u16) {
        for _ in 0..(s / 0.01).round() as u64 {
            let (roll_deg, pitch_deg) = (roll, pitch);
            self.send(&ToBoard::Setpoint(Asked::Attitude { roll_deg, pitch_deg, yaw, thrust }));
            self.run(0.01);
        }
    }

    fn fly(build: Build) -> Self {
        let mut rig = Self::new(build);
        if build == Build::Bolt {
            rig.send(&ToBoard::Supervisor(SupervisorRequest::Arm(true)));
        }
        rig.stream(0.2, [0.0; 3], 0);
        rig.stream(1.0, [8.0, -3.0, 0.0], 35_000);
        rig
    }

    fn bits(&self) -> u16 {
        self.board.supervisor.bits().bits()
    }

    fn packets(&self) -> Vec<Packet> {
        let (mut rest, mut packets) = (self.out.as_slice(), Vec::new());
        while let Some((len, later)) = rest.split_first() {
            let (packet, later) = later.split_at(usize::from(*len));
            packets.push(Packet::read(packet).unwrap());
            rest = later;
        }
        packets
    }
}

#[test]
fn val_bits_on_the_ground_and_in_the_air_are_those_that_were_seen() {
    for (build, ground, air) in
        [(Build::Cf2, 0x20E, 0x21E), (Build::Flapper, 0x20E, 0x21E), (Build::Bolt, 0x201, 0x21A)]
    {
        assert_eq!(Rig::new(build).bits(), ground, "{build:?}");
        assert_eq!(Rig::fly(build).bits(), air, "{build:?}");
    }
}

#[test]
fn val_silence_levels_at_half_a_second_and_locks_at_two() {
    for build in [Build::Cf2, Build::Bolt, Build::Flapper] {
        let mut rig = Rig::fly(build);
        rig.run(0.45);
        let tilt_deg = |rig: &Rig| rig.board.commander.target_deg;
        assert_eq!(tilt_deg(&rig)[..2], [8.0, -3.0]);
        rig.run(0.11);
        assert_eq!(tilt_deg(&rig), [0.0; 3]);
        assert_eq!(rig.board.commander.thrust, 35_000, "thrust as it was");
        rig.run(1.40);
        assert_eq!(rig.board.commander.thrust, 35_000);
        rig.run(0.10);
        assert!(rig.flies.is_none());
        rig.run(0.06);
        assert_eq!(rig.bits() & 0x40, 0x40);
        rig.stream(1.0, [0.0; 3], 0);
        rig.stream(1.0, [0.0; 3], 30_000);
        assert!(rig.flies.is_none() && rig.bits() & 0x40 != 0, "nothing helps");
    }
}

#[test]
fn val_a_disarm_in_the_air_kills_only_where_arming_is_asked_for() {
    for (build, seen) in
        [(Build::Cf2, vec![0x204, 0x207, 0x206, 0x20E, 0x21E]), (Build::Bolt, vec![0x200, 0x201])]
    {
        for old in [false, true] {
            let mut rig = Rig::fly(build);
            rig.seen.clear();
            let from_us = rig.t_us;
            rig.send(&if old {
                ToBoard::Platform(PlatformRequest::Arm(false))
            } else {
                ToBoard::Supervisor(SupervisorRequest::Arm(false))
            });
            rig.stream(0.5, [0.0; 3], 35_000);
            let changes: Vec<u16> =
                rig.seen.iter().map(|(_, bits)| *bits).filter(|bits| seen.contains(bits)).collect();
            let tail = &changes[changes.len() - seen.len()..];
            assert_eq!(tail, seen, "{build:?}: {:x?}", rig.seen);
            assert!(rig.seen.last().unwrap().0 - from_us <= 260_000);
        }
    }
}

#[test]
fn val_a_zero_unlocks_and_thrust_has_limits() {
    let mut rig = Rig::new(Build::Cf2);
    rig.stream(0.3, [0.0; 3], 30_000);
    assert_eq!(rig.board.commander.thrust, 0);
    rig.stream(0.1, [0.0; 3], 0);
    for (asked, given) in [(900, 0), (65_535, 60_000), (30_000, 30_000)] {
        rig.stream(0.1, [0.0; 3], asked);
        assert_eq!(rig.board.commander.thrust, given);
    }
}

#[test]
fn val_a_yaw_rate_is_clockwise_and_a_yaw_is_not() {
    let mut rig = Rig::fly(Build::Cf2);
    rig.stream(0.5, [0.0, 0.0, 20.0], 30_000);
    assert!((rig.board.commander.yaw_deg + 10.0).abs() < 0.1);
    let kind = haltere_dialect::crtp::value::Kind::U8;
    rig.send(&ToBoard::Parameter(haltere_dialect::crtp::parameter::ParameterRequest::SetByName {
        group: "flightmode",
        name: "stabModeYaw",
        kind,
        value: Value::Int(1),
    }));
    for yaw in [40.0, -60.0] {
        rig.stream(0.1, [0.0, 0.0, yaw], 30_000);
        assert_eq!(rig.board.commander.yaw_deg, f64::from(yaw));
        // Counter-clockwise from east for the board, clockwise from north for the plant.
        let heading_deg = rig.flies.unwrap().q.euler_angles().2.to_degrees();
        let off_deg = (heading_deg + f64::from(yaw) - 90.0 + 180.0).rem_euclid(360.0) - 180.0;
        assert!(off_deg.abs() < 1e-9, "{heading_deg}");
    }
}

#[test]
fn val_a_dead_chip_cuts_after_four_seconds_and_locks() {
    let mut rig = Rig::fly(Build::Bolt);
    rig.board.inject(rig.t_us, &CrazyflieFault::ChipDead(true));
    rig.stream(3.95, [0.0; 3], 35_000);
    assert_eq!(rig.bits(), 0x21A);
    rig.stream(0.15, [0.0; 3], 35_000);
    assert_eq!(rig.bits(), 0xA40);
}

#[test]
fn prop_an_emergency_stop_locks_at_once() {
    let mut rig = Rig::fly(Build::Cf2);
    rig.send(&ToBoard::Supervisor(SupervisorRequest::EmergencyStop));
    rig.stream(0.1, [0.0; 3], 35_000);
    assert_eq!(rig.bits(), 0x244);
    rig.board.inject(rig.t_us, &CrazyflieFault::MainReset);
    rig.run(2.0);
    assert_eq!(rig.bits(), 0x20E, "a restart frees it");
}

#[test]
fn prop_a_slow_radio_makes_rows_old_before_it_loses_any() {
    let mut link = Link::new(Radio { packets_hz: 100.0, ..Radio::default() }, 1);
    let (mut out, packet) = (Vec::new(), FromBoard::Console(b"x").encode().unwrap());
    for step in 0..500_u64 {
        // 500 packets a second are to go through 100.
        link.down(packet);
        link.pass(step * STEP_US, STEP_S, &mut out);
        if step == 200 {
            let waits = link.waiting();
            assert!((151..radio::QUEUE).contains(&waits), "old, none lost: {waits}");
        }
    }
    assert!(link.waiting() >= radio::QUEUE - 1, "the rest is lost");
}

#[test]
fn prop_what_is_asked_is_answered_and_a_fade_is_not() {
    let mut rig = Rig::new(Build::Flapper);
    rig.out.clear();
    rig.send(&ToBoard::Platform(PlatformRequest::Protocol));
    rig.run(0.01);
    let packets = rig.packets();
    let [packet] = packets.as_slice() else { panic!("{packets:?}") };
    let answer = haltere_dialect::crtp::platform::PlatformAnswer::Protocol(12);
    assert_eq!(FromBoard::decode(packet), Ok(FromBoard::Platform(answer)));
    rig.out.clear();
    rig.board.inject(rig.t_us, &CrazyflieFault::Fade { for_s: 0.3 });
    rig.send(&ToBoard::Platform(PlatformRequest::Protocol));
    rig.run(0.5);
    assert!(rig.out.is_empty(), "{:?}", rig.out);
}
