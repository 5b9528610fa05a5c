//! The board as a Crazyflie: where its wire and its deck meet the loops that all boards here have.

use crate::board::crazyflie::{ANCHORS, Crazyflie, Sensed};
use crate::board::{Board, Firmware, Readings};
use crate::faults::CrazyflieFault;
use crate::tag::Reception;

impl Board {
    /// With a Loco deck among these anchors, where it plays a Crazyflie; in the anchors' world, z up, m.
    pub fn with_deck(mut self, anchors_m: [Option<[f32; 3]>; ANCHORS], seed: u64) -> Self {
        self.crazyflie = (self.settings.firmware == Firmware::Crazyflie)
            .then(|| Box::new(Crazyflie::new(self.settings.crazyflie.clone(), anchors_m, seed)));
        self
    }

    /// Whether the tag is a deck of the board, without a line of its own.
    pub fn has_deck(&self) -> bool {
        self.crazyflie.is_some() || self.outside.is_some()
    }

    /// A frame of an anchor, for the deck.
    pub(crate) fn hear(&mut self, r: &Reception<'_>) {
        if let Some(outer) = &mut self.outside {
            outer.hear(r);
        }
        if let Some(crazyflie) = &mut self.crazyflie {
            crazyflie.hear(r);
        }
    }

    /// Breaks or mends what only a Crazyflie has. `false`: it is none, or it is a program where this cannot be done.
    pub(crate) fn inject(&mut self, t_us: u64, fault: &CrazyflieFault) -> bool {
        if let Some(outer) = &mut self.outside {
            return outer.inject(fault);
        }
        let now_us = self.time_us(t_us);
        self.crazyflie.as_mut().map(|crazyflie| crazyflie.inject(now_us, fault)).is_some()
    }

    /// Bytes for a Crazyflie. `false`: it is none.
    pub(super) fn receive_packets(&mut self, t_us: u64, bytes: &[u8]) -> bool {
        if let Some(outer) = &mut self.outside {
            outer.receive(bytes);
            return true;
        }
        let now_us = self.time_us(t_us);
        self.crazyflie.as_mut().map(|crazyflie| crazyflie.receive(now_us, bytes)).is_some()
    }

    /// A Crazyflie looks at its sensors and says what is due. `false`: it is none.
    pub(super) fn send_packets(&mut self, r: &Readings<'_>, out: &mut Vec<u8>) -> bool {
        if let Some(outer) = &mut self.outside {
            outer.step(r.imu, r.supply.volt, out);
            return true;
        }
        let now_us = self.time_us(r.t_us);
        let Some(crazyflie) = &mut self.crazyflie else { return false };
        let travel = self.loops.travel(&self.output);
        let before = crazyflie.sensed();
        let sensed =
            Sensed::new(r.imu, &self.believed, r.supply.volt, &self.output, travel, before);
        self.setpoint = crazyflie.step(now_us, sensed, out);
        self.armed = crazyflie.armed();
        true
    }
}
