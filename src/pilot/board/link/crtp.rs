//! A Crazyflie on the link: packets in the place of MAVLink, and the same news of them.

use haltere_core::drops::{DropReason, Drops};
use haltere_core::time::HostTime;

use super::armed::Said;
use super::news::BoardNews;
use super::sensors::{PRESSURE_HPA, SUPPLY_RANGE_V};
use super::{BoardLink, pace};
use crate::board::crazyflie::Told;
use crate::out::output::Outbox;

/// A silence that is told when it is over, s.
const SILENCE_S: f64 = 0.5;
/// The only IMU that a Crazyflie has.
const OWN_IMU: u8 = 0;

impl BoardLink {
    /// Whether packets of a Crazyflie come here.
    pub fn is_crazyflie(&self) -> bool {
        self.crtp.board.is_some()
    }

    /// Takes bytes of a Crazyflie in.
    pub fn packets(
        &mut self,
        at: HostTime,
        bytes: &[u8],
        out: &mut Outbox,
        drops: &mut Drops,
        news: &mut Vec<BoardNews>,
    ) {
        if let Some(silent_s) = self.silence_s(at).filter(|s| *s > SILENCE_S) {
            news.push(BoardNews::Back { silent_s });
        }
        self.last_heard = Some(at);
        let Some(crazyflie) = &mut self.crtp.board else { return };
        let bad = crazyflie.hear(at, bytes, out, &mut self.crtp.told);
        drops.add(DropReason::MavUndecodable, bad);
        self.take_told(at, drops, news);
    }

    /// Work that is due at this time.
    pub(super) fn tick_packets(
        &mut self,
        at: HostTime,
        out: &mut Outbox,
        news: &mut Vec<BoardNews>,
    ) {
        let Some(crazyflie) = &mut self.crtp.board else { return };
        crazyflie.tick(at, out, &mut self.crtp.told);
        // Time brings words and answers, no samples that could be bad.
        self.take_told(at, &mut Drops::default(), news);
        self.watch_target(at, news);
    }

    fn take_told(&mut self, at: HostTime, drops: &mut Drops, news: &mut Vec<BoardNews>) {
        let mut told = std::mem::take(&mut self.crtp.told);
        told.drain(..).for_each(|item| self.take_item(at, item, drops, news));
        self.crtp.told = told;
    }

    fn take_item(
        &mut self,
        at: HostTime,
        item: Told,
        drops: &mut Drops,
        news: &mut Vec<BoardNews>,
    ) {
        match item {
            Told::Imu(sample) => self.push_imu(OWN_IMU, sample, drops, news),
            Told::Attitude { valid_at, attitude } => self.attitude(at, valid_at, attitude, news),
            Told::Battery(sample) if SUPPLY_RANGE_V.contains(&sample.supply_v) => {
                news.push(BoardNews::Battery(sample));
            }
            Told::Baro(sample) if PRESSURE_HPA.contains(&(sample.pressure_pa * 0.01)) => {
                news.push(BoardNews::Baro(sample));
            }
            Told::Battery(_) | Told::Baro(_) => drops.add(DropReason::BadValue, 1),
            Told::Servos(servos) => news.push(BoardNews::Servos(servos)),
            Told::Tdoa(tdoa) => news.push(BoardNews::Tdoa(tdoa)),
            Told::Anchors(positions) => {
                news.push(BoardNews::Anchors(positions.map(|of| of.map(|of| of.position_m))));
            }
            Told::Age(age_s) => self.lateness.sample(at, age_s),
            Told::Trip(trip_s) => {
                self.lateness.answered(trip_s);
                self.pace.note(trip_s);
            }
            Told::Target(attitude, thrust_frac) => self.target.heard(at, attitude, thrust_frac),
            Told::Armed(armed) => self.armed_word(at, armed, news),
            Told::ArmAnswer { arm, accepted, why } => {
                if !arm && accepted && self.armed.disarm_acknowledged() {
                    news.push(BoardNews::Armed(false));
                }
                news.push(BoardNews::ArmAnswer { arm, accepted, why });
            }
            Told::Restarted => {
                self.crtp.restarts += 1;
                self.lateness.clock_restarted();
                let text = "board has restarted: it is asked and checked anew".to_owned();
                news.push(BoardNews::Notice { warning: true, text });
            }
            Told::Lost(count) => drops.add(DropReason::MavSequenceGap, count),
            Told::Notice { warning, text } => news.push(BoardNews::Notice { warning, text }),
            Told::Text { severity, text } => news.push(BoardNews::Text { severity, text }),
        }
    }

    fn armed_word(&mut self, at: HostTime, armed: bool, news: &mut Vec<BoardNews>) {
        match self.armed.heartbeat(at, armed) {
            Some(Said::Armed) => news.push(BoardNews::Armed(true)),
            Some(Said::Disarmed) => {
                if let Some(crazyflie) = &mut self.crtp.board {
                    crazyflie.shut();
                }
                news.push(BoardNews::Armed(false));
            }
            Some(Said::Doubt) if !self.was_told_to_disarm() => news.push(BoardNews::Doubt),
            Some(Said::ArmedAgain { denials }) => news.push(BoardNews::ArmedAgain { denials }),
            Some(Said::Doubt) | None => {}
        }
    }

    pub(super) fn slow_radio(&self) -> Option<String> {
        let median_s = self.pace.median_s().filter(|s| *s > pace::SLOW_S)?;
        Some(format!(
            "board answers after {:.0} ms, at most {:.0}: its radio is too slow, go nearer, take another channel or 2M",
            median_s * 1e3,
            pace::SLOW_S * 1e3
        ))
    }
}
