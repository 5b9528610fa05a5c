//! The schedule: the control step at 100 Hz, and what is due beside it.

pub(crate) mod act;
pub(crate) mod anew;
mod change;
mod clients;
mod commands;
mod grant;
mod home;
mod links;
mod motion;
mod news;
pub(crate) mod ordered;
mod plan_force;
mod plans;
mod programs;
mod routing;
pub(crate) mod said;
mod services;
mod settings;
mod shown;
mod step;
mod supervise;

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use crate::clock::CONTROL_PERIOD_US;
use crate::input::LinkId;
use crate::view::view;

use act::Act;

/// Control steps of the first second, in which tag and board are being found.
const FIRST_STEPS: u64 = 1_000_000 / CONTROL_PERIOD_US.cast_unsigned();
/// A step that begins later than this is a deadline miss, s: half a period.
const MISS_S: f64 = 0.5e-6 * CONTROL_PERIOD_US as f64;

impl Act<'_> {
    /// What is due at this time: at most one step.
    pub(super) fn wake(&mut self, at: HostTime) {
        if at < self.clock.next_tick {
            return;
        }
        let late_s = at.seconds_since(self.clock.next_tick);
        if late_s > MISS_S {
            self.clock.deadline_misses += 1;
        }
        // Steps that were slept through are not caught up: they would act on nothing new.
        let late_us = at.as_us().saturating_sub(self.clock.next_tick.as_us());
        let ahead_us =
            CONTROL_PERIOD_US.cast_unsigned() - late_us % CONTROL_PERIOD_US.cast_unsigned();
        self.clock.next_tick = at.offset_us(ahead_us.cast_signed());
        let pause_s = self.clock.last_tick.map_or(0.01, |t| at.seconds_since(t));
        let dt_s = pause_s.clamp(0.001, 0.05);
        let longest_s = self.config.supervisor.loop_gap_s;
        self.flight.supervisor.punctuality.step(at, pause_s, late_s > MISS_S, longest_s);
        self.note_pause(at, pause_s);
        self.flight.supervisor.punctuality.board_clock(at, self.board.link.clock_restarts());
        self.clock.last_tick = Some(at);
        self.clock.control_steps += 1;
        self.out.is_starting = self.clock.control_steps < FIRST_STEPS;

        self.flush_quiet_links(at);
        self.navigation.ask_for_binary(&view!(self, at), self.out);
        *self.estimate = self.navigation.estimator.estimate();
        self.look(at, dt_s);
        self.supervise(at);
        self.control_step(at, dt_s);
        self.navigation.touch.sent(self.flight.control.thrust_frac, dt_s);
        self.record_step(at);

        self.board.tick(at, self.out);
        self.take_board_news(at);
        let withheld = self.out.take_withheld();
        self.out.lose(LinkId::Board, DropReason::NotPermitted, withheld);
        self.serve_grounds(at);
        self.service_tick(at);
        if at >= self.clock.next_health {
            self.clock.next_health = at.offset_us(1_000_000);
            self.record_health(at);
        }
    }
}
