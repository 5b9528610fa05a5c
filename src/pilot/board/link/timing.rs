//! The board's time: TIMESYNC both ways, and what a round trip says about the line.

use haltere_dialect::mav::haltere::{MavMessage, TIMESYNC_DATA};

use haltere_core::drops::{DropReason, Drops};
use haltere_core::time::{FcTime, HostTime};

use super::news::BoardNews;
use super::{BOARD_COMPONENT, BoardLink, SECOND_US};
use crate::input::LinkId;
use crate::out::output::{Address, Outbox};

/// TIMESYNC: 10 Hz until locked and in doubt, else 1 Hz (INTERFACES.md section 2).
const SYNC_FAST_US: i64 = 100_000;
const SYNC_SLOW_US: i64 = SECOND_US;

impl BoardLink {
    /// Asks for the board's time when it is due.
    pub(super) fn ask_time(&mut self, at: HostTime, own: Address, out: &mut Outbox) {
        let doubt = self.lateness.is_in_doubt(at);
        if doubt {
            self.sync.next_at = self.sync.next_at.min(self.sync.last_at.offset_us(SYNC_FAST_US));
        }
        if at >= self.sync.next_at {
            let calm = self.clock.is_locked() && !doubt;
            self.sync.next_at = at.offset_us(if calm { SYNC_SLOW_US } else { SYNC_FAST_US });
            self.sync.last_at = at;
            self.lateness.asked(at);
            self.sync.sent_us.rotate_right(1);
            self.sync.sent_us[0] = at.as_us();
            let question = MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: 0,
                ts1: at.as_us().cast_signed().saturating_mul(1000),
                target_system: own.system_id,
                target_component: BOARD_COMPONENT,
            });
            out.message(LinkId::Board, own, &question);
        }
    }

    pub(super) fn timesync(
        &mut self,
        at: HostTime,
        m: &TIMESYNC_DATA,
        out: &mut Outbox,
        drops: &mut Drops,
        news: &mut Vec<BoardNews>,
    ) {
        let Some(own) = self.own_address() else { return };
        if m.tc1 == 0 {
            // A question: echo its time and add ours.
            let answer = MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: at.as_us().cast_signed().saturating_mul(1000),
                ts1: m.ts1,
                target_system: own.system_id,
                target_component: BOARD_COMPONENT,
            });
            out.message(LinkId::Board, own, &answer);
            return;
        }
        // An answer, to one of our last questions.
        let sent_us = u64::try_from(m.ts1 / 1000).unwrap_or(0);
        let board_us = u64::try_from(m.tc1 / 1000).unwrap_or(0);
        match self.sync.sent_us.iter_mut().find(|t| **t == sent_us && sent_us != 0) {
            Some(slot) => {
                *slot = 0;
                let sent = HostTime::from_us(sent_us);
                let restarts = self.clock.restarts();
                self.clock.round_trip(sent, FcTime::from_us(board_us), at);
                self.lateness.answered(at.seconds_since(sent));
                if self.clock.restarts() != restarts {
                    self.lateness.clock_restarted();
                    self.rebooted(at, news);
                }
                if let Some(slow) = self.pace.note(at.seconds_since(sent)) {
                    self.pace_changed(at, slow, news);
                }
            }
            None => drops.add(DropReason::MavIgnored, 1),
        }
    }

    fn pace_changed(&mut self, at: HostTime, slow: bool, news: &mut Vec<BoardNews>) {
        let ms = self.pace.median_s().unwrap_or(0.0) * 1e3;
        let best_ms = self.pace.best_s().unwrap_or(0.0) * 1e3;
        let text = if slow {
            self.streams.calm_down(at);
            format!(
                "board answers after {ms:.0} ms, at best {best_ms:.0}: its line carries less than is \
                 asked for, less is asked for now; use 921600 baud"
            )
        } else {
            format!("board answers within {ms:.0} ms again")
        };
        news.push(BoardNews::Notice { warning: slow, text });
    }
}
