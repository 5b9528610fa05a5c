//! A Crazyflie with a Loco deck, as its client sees it over CRTP: packets in, packets out, each behind one byte of its
//! length. What it was seen to do is in the files beside this one.

mod blocks;
mod commander;
mod loco;
mod radio;
mod readings;
mod requests;
mod supervisor;
mod table;

pub use radio::Radio;
pub use supervisor::Build;

use haltere_dialect::crtp::FromBoard;
use haltere_dialect::crtp::packet::{MAX_PACKET, MAX_PAYLOAD, Packet};
use haltere_dialect::crtp::value::Value;
use serde::{Deserialize, Serialize};

use crate::effects::{STEP_S, Setpoint};
use crate::faults::CrazyflieFault;
use crate::tag::Reception;
use haltere_core::checks::Problems;

use blocks::Blocks;
use commander::Commander;
pub use loco::ANCHORS;
use loco::Loco;
use radio::Link;
pub(super) use readings::Sensed;
use supervisor::{Look, Supervisor};

/// A client that is silent for so long has gone, µs: blocks and queue are emptied (`CONFIG_RADIO_ACTIVITY_TIMEOUT_MS`).
const GONE_US: u64 = 1_000_000;
/// Until a restarted board speaks again, µs. Assumed: start and the bias of its gyroscope.
const START_US: u64 = 1_500_000;
/// Until a restarted nRF carries packets again, µs. Assumed.
const NRF_START_US: u64 = 300_000;
/// A second client sends with this period, µs.
const SECOND_CLIENT_US: u64 = 50_000;
/// Rows a second that a congested radio carries.
const CONGESTED_HZ: f64 = 150.0;

/// What it is.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CrazyflieSettings {
    /// Which build.
    pub build: Build,
    /// The way to its client.
    pub radio: Radio,
    /// It is on a USB cable, where no silence counts.
    pub usb: bool,
}

impl CrazyflieSettings {
    pub(super) fn check(&self, key: &str, problems: &mut Problems) {
        self.radio.check(&format!("{key}.radio"), problems);
    }
}

/// The board.
pub struct Crazyflie {
    settings: CrazyflieSettings,
    supervisor: Supervisor,
    commander: Commander,
    blocks: Blocks,
    parameters: Vec<Value>,
    loco: Loco,
    link: Link,
    sensed: Sensed,
    /// Bytes of a packet of which more is to come.
    half: Vec<u8>,
    /// Plant time of its start, and of the last packet that it heard, µs.
    started_us: u64,
    heard_us: u64,
    /// Plant time, µs.
    now_us: u64,
    second_client_us: Option<u64>,
    /// Another build, with other tables.
    other_table: bool,
    /// Firmware before the supervisor's port.
    no_port_9: bool,
    deck_fault: bool,
    dongle_out: bool,
}

impl Crazyflie {
    /// With these anchors around it, in the anchors' world, z up, m.
    pub fn new(
        settings: CrazyflieSettings,
        anchors_m: [Option<[f32; 3]>; ANCHORS],
        seed: u64,
    ) -> Self {
        let mut board = Self {
            supervisor: Supervisor::new(settings.build),
            commander: Commander::default(),
            blocks: Blocks::default(),
            parameters: table::PARAMETERS.iter().map(|p| p.default).collect(),
            loco: Loco::new(anchors_m),
            link: Link::new(settings.radio.clone(), seed),
            sensed: Sensed::default(),
            half: Vec::new(),
            started_us: 0,
            heard_us: 0,
            now_us: 0,
            second_client_us: None,
            other_table: false,
            no_port_9: false,
            deck_fault: false,
            dongle_out: false,
            settings,
        };
        board.greet();
        board
    }

    /// Its own clock, µs.
    fn clock_us(&self) -> u64 {
        self.now_us.saturating_sub(self.started_us)
    }

    /// Where its anchors say that they stand.
    pub(super) fn anchors_m(&self) -> [Option<[f32; 3]>; ANCHORS] {
        self.loco.positions_m
    }

    /// Whether motors may run.
    pub fn armed(&self) -> bool {
        self.supervisor.is_armed() && self.supervisor.can_fly()
    }

    /// It has hit something.
    pub fn crash(&mut self) {
        self.supervisor.crash();
    }

    fn print(&mut self, text: &str) {
        for piece in text.as_bytes().chunks(MAX_PAYLOAD) {
            self.say(&FromBoard::Console(piece));
        }
    }

    fn greet(&mut self) {
        self.print("SYS: Crazyflie (simulated) is up and running!\n");
    }

    fn say(&mut self, message: &FromBoard<'_>) {
        if let Some(packet) = message.encode() {
            self.link.down(packet);
        }
    }

    /// Takes bytes of its client: packets behind their lengths, cut anywhere.
    pub fn receive(&mut self, now_us: u64, bytes: &[u8]) {
        self.half.extend_from_slice(bytes);
        let mut rest = self.half.as_slice();
        while let Some((len, later)) = rest.split_first() {
            let len = usize::from(*len);
            if !(1..=MAX_PACKET).contains(&len) {
                rest = later;
                continue;
            }
            let Some((packet, later)) = later.split_at_checked(len) else { break };
            if let (Ok(packet), false) = (Packet::read(packet), self.dongle_out) {
                self.link.up(now_us, packet);
            }
            rest = later;
        }
        let done = self.half.len() - rest.len();
        self.half.drain(..done);
    }

    /// What it sensed last.
    pub(super) fn sensed(&self) -> &Sensed {
        &self.sensed
    }

    /// A frame of an anchor.
    pub(super) fn hear(&mut self, r: &Reception<'_>) {
        self.loco.hear(self.now_us, r);
    }

    /// One step of 2 ms: what it should fly, `None` with its motors off; what it says goes to `out`.
    pub(super) fn step(
        &mut self,
        now_us: u64,
        sensed: Sensed,
        out: &mut Vec<u8>,
    ) -> Option<Setpoint> {
        self.now_us = now_us;
        self.sensed = sensed;
        if self.is_starting() {
            while self.link.arrived(now_us).is_some() {}
            return None;
        }
        while let Some(packet) = self.link.arrived(now_us) {
            self.heard_us = now_us;
            self.obey(&packet);
        }
        self.second_client();
        let is_gone = !self.settings.usb && now_us.saturating_sub(self.heard_us) >= GONE_US;
        if is_gone && !self.blocks.is_empty() {
            self.blocks.clear();
            self.link.flush();
        }
        let can_fly = self.supervisor.can_fly();
        let level = self.supervisor.is_level();
        let target =
            self.commander.target(can_fly, level, &self.sensed, self.parameters.as_slice());
        self.look();
        self.log();
        if !self.dongle_out {
            self.link.pass(now_us, STEP_S, out);
        }
        target
    }

    fn is_starting(&self) -> bool {
        self.started_us > 0 && self.clock_us() < START_US
    }

    fn look(&mut self) {
        let look = Look {
            now_us: self.clock_us(),
            age_us: self.commander.age_us(self.now_us),
            thrust: self.commander.gives_thrust(),
            up_g: self.sensed.acc_g[2],
            deck_fault: self.has_deck_fault(),
        };
        if self.supervisor.look(&look) {
            self.print("SUP: Locked, reboot required\n");
        }
        self.supervisor.arm_by_itself();
    }

    fn has_deck_fault(&self) -> bool {
        self.deck_fault || self.loco.has_fault(self.now_us)
    }

    fn log(&mut self) {
        let (now_us, mut blocks) = (self.clock_us(), std::mem::take(&mut self.blocks));
        let mut rows = Vec::new();
        blocks.rows(now_us, |id| self.value(id), |packet| rows.push(packet));
        self.blocks = blocks;
        rows.into_iter().for_each(|row| self.link.down(row));
    }

    /// Another client, who begins anew and wants a little thrust.
    fn second_client(&mut self) {
        let Some(due_us) = self.second_client_us else { return };
        if self.now_us >= due_us {
            self.second_client_us = Some(self.now_us + SECOND_CLIENT_US);
            self.commander.attitude(self.now_us, [0.0; 3], 20_000);
        }
    }

    /// Restarts its main processor.
    pub fn restart(&mut self, now_us: u64) {
        self.started_us = now_us.max(1);
        self.supervisor = Supervisor::new(self.settings.build);
        self.commander = Commander::default();
        self.blocks.clear();
        self.link.flush();
        self.parameters = table::PARAMETERS.iter().map(|p| p.default).collect();
        self.loco.restart();
        self.greet();
    }

    /// Breaks or mends.
    pub fn inject(&mut self, now_us: u64, fault: &CrazyflieFault) {
        match *fault {
            CrazyflieFault::Fade { for_s } => self.link.silence(now_us + (for_s * 1e6) as u64),
            CrazyflieFault::ChipDead(dead) => self.loco.dead_since_us = dead.then_some(now_us),
            CrazyflieFault::BlocksGone => self.blocks.clear(),
            CrazyflieFault::MainReset => self.restart(now_us),
            CrazyflieFault::RadioReset => {
                self.link.flush();
                self.link.silence(now_us + NRF_START_US);
            }
            CrazyflieFault::Congested(on) => self.link.congested_hz = on.then_some(CONGESTED_HZ),
            CrazyflieFault::OtherTable => {
                self.other_table = true;
                self.restart(now_us);
            }
            CrazyflieFault::SecondClient(on) => {
                self.second_client_us = on.then_some(now_us);
                if on {
                    self.blocks.clear();
                }
            }
            CrazyflieFault::Disarm => drop(self.supervisor.arm(false)),
            CrazyflieFault::Crash => self.supervisor.crash(),
            CrazyflieFault::Lock => self.supervisor.emergency_stop(),
            CrazyflieFault::DeckFault(on) => self.deck_fault = on,
            CrazyflieFault::Tdoa3(on) => self.loco.is_tdoa3 = on,
            CrazyflieFault::AnchorsOff(off_m) => self.loco.off_m = off_m.map(|off| off as f32),
            CrazyflieFault::DongleOut(out) => self.dongle_out = out,
            CrazyflieFault::NoPort9(on) => self.no_port_9 = on,
        }
    }
}

#[cfg(test)]
mod tests;
