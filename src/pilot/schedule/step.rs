//! One control step: what is looked at before, what flies in each mode, what is recorded and what links are due after.

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;

use haltere_core::control::{Command, Handover};
use haltere_core::estimate::Health;
use haltere_core::frames::{B, E, Rot};
use haltere_core::time::HostTime;
use haltere_core::topics::{HealthRecord, Topic};

use super::act::Act;
use crate::flight::guidance::Now;
use crate::flight::hover;
use crate::flight::modes::{Event, Mode, transition};
use crate::navigation::floor::TURN_SHARE;
use crate::out::voice::Severity;
use crate::stations::streams::Streams;
use crate::view::{around, view};

/// Share of the base thrust at the end of the spool: close to hover, but not off the floor.
const SPOOL_SHARE: f64 = 0.85;
/// Climbing so fast, m/s, and so high, m, in the spool-up: it has lifted off already.
const LIFTED_MPS: f64 = 0.3;
const LIFTED_M: f64 = 0.15;
/// Thrust acts this long after the motors' own spool-up, s: filters of the board and the link.
const SPOOL_MARGIN_S: f64 = 0.3;
/// The board has this long after that to show the thrust it was sent, s.
const SPOOL_WAIT_S: f64 = 1.5;
/// A link that carries the beginning of a frame and then nothing for so long will not complete
/// it, µs: several frames at the slowest radio. Until then a false marker holds back what follows.
const QUIET_US: i64 = 200_000;

impl Act<'_> {
    /// Looks at what came in since the last step, before anything is decided.
    pub(super) fn look(&mut self, at: HostTime, dt_s: f64) {
        let view = view!(self, at);
        let (navigation, out) = (&mut *self.navigation, &mut *self.out);
        navigation.watch_left_out(&view, out);
        if navigation.watch_health(&view, out) {
            self.flight.guidance.home_is_here(view.estimate.pos_E_m);
        }
        navigation.follow_north(&view, dt_s, out);
        navigation.watch_lift(&view, dt_s);
        navigation.watch_slip(&view, dt_s);
        navigation.watch_scale(&view, dt_s);
        self.flight.watch_speed(&view);
        navigation.watch_room(&view, self.clock.control_steps, dt_s);
        let remedies = navigation.estimator.counts().remedies;
        navigation.evidence.note_remedies(at, remedies);
        navigation.check_survey(&view, out);
        navigation.watch_lying(&view, dt_s);
        self.watch_floor(at, dt_s);
    }

    /// A vehicle that came to stand without being asked to lands, where it is felt for the floor, and disarms.
    fn watch_floor(&mut self, at: HostTime, dt_s: f64) {
        let watched = transition(self.flight.mode, Event::FloorCarries).is_some();
        let heard = self.sight(at).imu_is_alive() && !self.navigation.is_numb();
        if self.navigation.watch_floor(&view!(self, at), [watched, heard], dt_s) {
            self.fire(at, Event::FloorCarries);
            // Whatever the landing's estimate says from here on, it does not lift off again.
            self.navigation.touch.low_frac =
                Some(TURN_SHARE * self.flight.control.thrust_base_frac);
        }
    }

    pub(super) fn control_step(&mut self, at: HostTime, dt_s: f64) {
        let held =
            self.flight.mode.has_thrust() || matches!(self.flight.mode, Mode::Idle | Mode::Yielded);
        self.board.link.hold_control(held);
        self.board.link.leave_to_itself(self.flight.mode == Mode::Disarmed);
        match self.flight.mode {
            // Nor into one that does not obey us: it would take them for our will as soon as it did.
            Mode::Yielded if !self.board.link.is_retaking() => {}
            Mode::Yielded => {
                let command = self.stay_command();
                let output =
                    self.flight.run_controller(&around!(self, at), &command, dt_s, true, None);
                self.flight.control = output.record;
                self.send(at, output.R_EB, output.thrust_frac);
            }
            // No setpoints into a board that we have not armed.
            Mode::Disarmed if self.config.flight.shadow => {
                self.flight.follow_flyer(&around!(self, at), self.out, self.wishes);
                self.grant(at);
                self.flight.shadow_step(&around!(self, at), dt_s, self.out);
            }
            Mode::Disarmed => {}
            Mode::Arming | Mode::Idle | Mode::Disarming => self.send_idle(at),
            Mode::Spool => self.spool_step(at, dt_s),
            Mode::Descend => self.descend_step(at, dt_s),
            _ => self.guided_step(at, dt_s),
        }
    }

    /// The motors spool up, and the vehicle stands yet.
    fn spool_step(&mut self, at: HostTime, dt_s: f64) {
        let command = self.stay_command();
        let output = self.flight.run_controller(&around!(self, at), &command, dt_s, true, None);
        self.flight.control = output.record;
        let share = at.seconds_since(self.flight.mode_since) / self.config.flight.spool_s;
        let thrust_frac = self.flight.hover_thrust_frac(self.config) * SPOOL_SHARE * share.min(1.0);
        let yaw_rad = self.estimate.R_EB.yaw_rad();
        // The loops take over from what the vehicle was last told.
        self.flight.controller.reset(Some(&Handover {
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rad,
            thrust_frac,
        }));
        self.send(at, Rot::from_euler_rad(0.0, 0.0, yaw_rad), thrust_frac);
        if self.board.link.shows_our_thrust(at) {
            self.navigation.estimator.set_airborne(true);
        }
        self.end_spool(at);
    }

    /// A descent without an estimate.
    fn descend_step(&mut self, at: HostTime, dt_s: f64) {
        let command = self.stay_command();
        let output = self.flight.run_controller(&around!(self, at), &command, dt_s, true, None);
        self.flight.control = output.record;
        self.flight.supervisor.descent.late = self.navigation.obeys_late(&self.board.state());
        let Some(share) = self.flight.supervisor.descent.step(dt_s) else {
            self.fire(at, Event::TouchDown);
            self.send_idle(at);
            return;
        };
        // Level in the board's own frame: our attitude is what cannot be trusted.
        let yaw_rad = self.board.attitude.map_or(0.0, |a| a.attitude.yaw_rad());
        let level = Rot::from_euler_rad(0.0, 0.0, yaw_rad);
        let share = share.min(self.flight.most_share(at, self.navigation));
        let thrust_frac = self.navigation.bounded_frac(
            self.flight.hover_thrust_frac(self.config) * share,
            self.flight.control.thrust_base_frac,
        );
        self.flight.control.thrust_frac = thrust_frac;
        self.navigation.lying.asked(&level);
        self.board.link.send_setpoint(at, level, thrust_frac, &mut self.out.outbox);
    }

    /// A step by the guidance, inside of the fence.
    fn guided_step(&mut self, at: HostTime, dt_s: f64) {
        let fence = &self.flight.plans.fence;
        let supply_v = self.board.supply_v(at);
        let hurries = self.flight.supervisor.unhealthy.contains(S::MAV_SYS_STATUS_SENSOR_BATTERY);
        let return_mps = if hurries { self.config.control.sustained_mps() } else { 0.0 };
        let now = Now { estimate: self.estimate, supply_v, at, dt_s, fence, return_mps };
        let (mut command, news) =
            self.flight.guidance.step(self.flight.mode, &self.flight.mission, &now);
        if let Some(event) =
            self.flight.keep_inside_fence(at, self.estimate, &mut command, self.out)
        {
            self.fire(at, event);
        }
        // Nor while the board flies something else.
        let frozen =
            (self.flight.mode == Mode::Takeoff && self.is_on_floor()) || !self.board.link.obeys();
        let mut output =
            self.flight.run_controller(&around!(self, at), &command, dt_s, frozen, news.held);
        if let Some((doublet, elapsed_s)) = news.doublet {
            doublet.add(elapsed_s, &self.config.control.limits, &mut output);
        }
        self.flight.control = output.record;
        self.learn_hover(at, dt_s, frozen || news.doublet.is_some() || news.held.is_some());
        self.send(at, output.R_EB, output.thrust_frac);
        if let Some(seq) = news.reached {
            self.tell_reached(at, seq);
        }
        if let Some(text) = news.warning {
            self.out.say(at, Severity::Warning, text);
        }
        if let Some(event) = news.event
            && !(event == Event::HeightReached && self.begin_next(at))
        {
            self.fire(at, event);
        }
    }

    /// Thrust is up when its time is over, the motors have spooled up and the board shows the thrust
    /// that it was sent.
    fn end_spool(&mut self, at: HostTime) {
        let elapsed_s = at.seconds_since(self.flight.mode_since);
        // A vehicle that hovers with less than was thought is in the air: the loops must have it.
        let up_mps = -self.estimate.vel_E_mps().z();
        if up_mps > LIFTED_MPS && self.height_above_floor_m() > LIFTED_M {
            self.fire(at, Event::SpoolDone);
            return;
        }
        let least_s = self.config.flight.spool_s.max(self.board.link.spool_s() + SPOOL_MARGIN_S);
        if !self.board.link.firmware().is_real() {
            if elapsed_s >= self.config.flight.spool_s {
                self.fire(at, Event::SpoolDone);
            }
        } else if elapsed_s >= least_s && self.board.link.shows_our_thrust(at) {
            self.fire(at, Event::SpoolDone);
        } else if elapsed_s
            > least_s + self.board.link.firmware().held_after_arming_s() + SPOOL_WAIT_S
        {
            self.fire(at, Event::SetpointsIgnored);
        }
    }

    /// Learns the hover thrust from a step that was flown under position control.
    fn learn_hover(&mut self, at: HostTime, dt_s: f64, disturbed: bool) {
        let estimate = &*self.estimate;
        let vel_down_mps = estimate.vel_E_mps().z();
        let cos_tilt = estimate.R_EB.matrix()[(2, 2)];
        let control = &self.flight.control;
        // Near the floor the ground effect carries, and a landing ends there.
        let calm = !matches!(self.flight.mode, Mode::Takeoff | Mode::Land);
        let observable = !disturbed
            && calm
            && !self.navigation.estimate_is_contradicted(&view!(self, at))
            && estimate.health == Health::Good
            && self.height_above_floor_m() > hover::CLEAR_M
            && vel_down_mps.abs() < hover::SLOW_MPS
            && cos_tilt > hover::LEVEL_COS
            && self.navigation.touch.ceiling_frac.is_none()
            && !control.saturation.thrust_high
            && !control.saturation.thrust_low
            && self.board.supply_v(at).is_some();
        let base_frac = control.thrust_base_frac * control.ground_factor;
        let step = hover::Step {
            at,
            vel_down_mps,
            share: control.thrust_frac * cos_tilt / base_frac.max(0.05),
        };
        self.flight.hover.step(observable.then_some(step), dt_s);
    }

    /// Integrators must not fill while the floor carries the vehicle.
    fn is_on_floor(&self) -> bool {
        self.height_above_floor_m() < 0.1
    }

    /// Height of the landing gear above the floor by the estimate, m.
    pub(crate) fn height_above_floor_m(&self) -> f64 {
        self.config.flight.height_above_floor_m(self.estimate)
    }

    fn stay_command(&self) -> Command {
        Command::hold(self.estimate.pos_E_m, self.estimate.R_EB.yaw_rad())
    }

    fn send_idle(&mut self, at: HostTime) {
        let yaw_rad = self.board.attitude.map_or(0.0, |a| a.attitude.yaw_rad());
        let level = Rot::from_euler_rad(0.0, 0.0, yaw_rad);
        self.flight.control.at = at;
        self.flight.control.thrust_frac = 0.0;
        self.board.link.send_setpoint(at, level, 0.0, &mut self.out.outbox);
    }

    /// The one place where a setpoint is turned into the board's frame.
    fn send(&mut self, at: HostTime, attitude: Rot<E, B>, thrust_frac: f64) {
        self.flight.control.yaw_board_offset_rad = self.navigation.north.offset_rad();
        self.flight.control.hover_factor = self.flight.hover.factor();
        self.flight.control.thrust_frac = thrust_frac;
        let for_board = self.navigation.north.setpoint_for_board(attitude);
        self.navigation.lying.asked(&for_board);
        self.board.link.send_setpoint(at, for_board, thrust_frac, &mut self.out.outbox);
    }

    pub(super) fn record_step(&mut self, at: HostTime) {
        let mut estimate = *self.estimate;
        estimate.at = at;
        self.out.record(|| Topic::Estimate(estimate));
        if self.flight.mode.has_thrust() {
            let control = self.flight.control;
            self.out.record(|| Topic::Control(control));
        }
    }

    pub(super) fn record_health(&mut self, at: HostTime) {
        if !self.out.with_topics {
            return;
        }
        let drops = self.out.losses_for_log(&self.navigation.estimator);
        let record = HealthRecord {
            at,
            drops,
            deadline_misses: self.clock.deadline_misses,
            control_steps: self.clock.control_steps,
            uwb_age_s: self.navigation.last_fused.map(|t| at.seconds_since(t)),
            imu_age_s: self.navigation.last_imu.map(|t| at.seconds_since(t)),
            std_board_clock_s: self.board.link.std_clock_s(),
            left_out: self.navigation.estimator.left_out_bits(),
        };
        self.out.record(|| Topic::Health(record));
    }

    /// Frames that will not be completed must not hold back what stands behind their marker.
    pub(super) fn flush_quiet_links(&mut self, at: HostTime) {
        let quiet_s = QUIET_US as f64 * 1e-6;
        if self.board.splitter.pending() > 0 && at.seconds_since(self.board.bytes_at) > quiet_s {
            self.board.splitter.flush();
            self.board_frames(at);
        }
        for n in 0..self.stations.grounds.len() {
            let ground = &mut self.stations.grounds[n];
            if ground.splitter.pending() > 0 && at.seconds_since(ground.heard_at) > quiet_s {
                ground.splitter.flush();
                self.ground_frames(at, n);
            }
        }
    }

    /// Ground endpoints: the streams that are due.
    pub(super) fn serve_grounds(&mut self, at: HostTime) {
        self.stations.soothe_askers(at, self.out);
        self.tell_mode(at);
        for n in 0..self.stations.grounds.len() {
            let link = self.stations.grounds[n].link;
            if !self.out.is_open(link) {
                continue;
            }
            self.stations.tell_misaddressed(at, n, self.out);
            self.stations.grounds[n].streams.begin(at);
            // Answers first: they are booked before any stream.
            self.stations.settle(n, self.out);
            for turn in 0..Streams::TURNS {
                if let Some(msg_id) = self.stations.grounds[n].streams.due(turn, at)
                    && self.send_telemetry(at, link, msg_id)
                {
                    self.stations.settle(n, self.out);
                }
            }
        }
    }
}
