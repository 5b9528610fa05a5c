//! How a flight begins and ends: the last look before the take-off, the way to the floor, how it is told,
//! and disarming. What goes wrong in between is the `supervisor`'s; what must hold before arming is in
//! `arming`.

use haltere_core::estimate::Health;
use haltere_core::frames::G_MPS2;
use haltere_core::measure::BaroSample;
use haltere_core::time::HostTime;

use super::awaited::Next;
use super::modes::{Event, Mode};
use crate::Pilot;
use crate::navigation::near::NEAR_FLOOR_M;
use crate::out::voice::Severity;
use crate::schedule::CONTROL_PERIOD_US;
use crate::view::view;

/// No touch-down is looked for right after the landing began, s.
const TOUCH_NOT_BEFORE_S: f64 = 1.0;
/// Sinking slower than this share of what is asked is a reason to feel for the floor …
const TOUCH_SPEED_SHARE: f64 = 0.6;
/// … if thrust is below this share of the base: either the ground effect or the floor carries …
const TOUCH_THRUST_SHARE: f64 = 0.82;
/// … and both hold for this long, s.
const TOUCH_FOR_S: f64 = 0.15;
/// … or for this long where estimate and barometer say that it is not there yet, s: what reads as a floor may be an
/// accelerometer that reads too much, which shows after 0.25 s …
const TOUCH_CLEAR_FOR_S: f64 = 0.4;
/// … or for this long where the estimate says that the floor is far, s: it may be wrong, and a
/// table is a floor too.
const TOUCH_ANYWHERE_FOR_S: f64 = 3.0;
/// Feeling for the floor: thrust is lowered by this share of the base per second …
const FEEL_PER_S: f64 = 0.45;
/// … down to this share of the base. Ground effect carries with no less than 0.7 (the model's
/// limit of 0.8 on the thrust, and its root, plus the error of the base).
const FEEL_SHARE: f64 = 0.55;
/// … for this long at least, s: over a link that is late by 0.3 s, and by the filter of the specific force, a fall shows no
/// sooner.
const FEEL_FOR_S: f64 = 0.5;
/// With less thrust than this share of the base, low-passed as the specific force is, nothing in the air is carried
/// near the floor: the ground effect adds a fifth, and drag a tenth at 1.5 m/s.
const CARRIED_SHARE: f64 = 0.62;
/// The floor carries if the specific force is then gravity's to within this, m/s²: an accelerometer that is off by
/// a third is none to tell.
pub(crate) const CARRIED_MPS2: f64 = 1.5;
/// … for this long, s.
const CARRIED_FOR_S: f64 = 0.1;
/// A landing near the floor that cannot believe its estimate any more, or becomes a descent, goes on with the thrust
/// that it had, but no less than this share of the base: with the ground effect it does not lift off, and in free air it
/// sinks with 1.4 m/s at most from the height where the floor is expected …
pub(crate) const TURN_SHARE: f64 = 0.8;
/// … and no more than this in its last second: what it had may be what a wrong reading made of it.
const TURN_MOST_SHARE: f64 = 0.9;
/// In the last second of a landing no more than this share of the hover thrust is needed: it stops the slow sinking within
/// 0.25 s. An accelerometer that says anything is found after 0.4 s; by then full thrust had lifted it off with 1.5 m/s.
const LAST_SHARE: f64 = 1.1;
/// Without an accelerometer to feel for the floor with, so much of the base is taken from it per second: from half a metre
/// it is down after 1.2 s, and the motors are off after 2.5 s.
const TURN_PER_S: f64 = 0.15;
/// Something holds a descent up for this long before the floor is felt for, s.
const HELD_UP_FOR_S: f64 = 1.0;
/// With less than this share of the hover thrust, and hardly sinking, floor or ground effect carry: 0.9 leave 1 m/s²,
/// which drag alone holds up at 1.2 m/s. Where no accelerometer can show that it was wrong thrust is taken away gently,
/// so less is enough: 0.95 would sink with 0.6 m/s.
const HELD_UP_SHARE: f64 = 0.9;
const BLIND_HELD_UP_SHARE: f64 = 0.95;
/// Specific force that is this much short of gravity says that the vehicle falls, m/s². Three
/// times what low-passed flapping leaves.
const FALLING_MPS2: f64 = 1.0;
/// … or this much, where the estimate says that it sinks fast: what low-passed flapping leaves.
const SINKING_MPS2: f64 = 0.3;
/// Time constant of that low-pass, s: two wing beats.
const FEEL_FILTER_S: f64 = 0.15;
/// Stopped: near the floor the accelerometer has felt so much speed upward, m/s, lately. A vehicle that sank has met the
/// floor, or the air over it throws it up, and stays there only with less thrust than carries it.
const STOPPED_MPS: f64 = 0.3;
/// … or so much, where the floor should be far: no descent brakes by as much at once, and a table is a floor too.
const STOPPED_HIGH_MPS: f64 = 0.6;
/// Lately, s: a scale that is 1 % off is 0.1 m/s² and adds up to 0.1 m/s.
const LATELY_S: f64 = 1.0;
/// What it felt on the average in this time before is taken for gravity, s.
const USUAL_S: f64 = 5.0;
/// Thrust that no vehicle lifts off with, as a share of the base: the ground effect adds a fifth, and the base is a tenth
/// off.
pub(crate) const DOWN_SHARE: f64 = 0.7;
/// A longer interval between two samples is a gap, s.
const GAP_S: f64 = 0.1;
/// After a fall has begun the loops have this long to catch it, s.
const FEEL_AGAIN_S: f64 = 0.5;
/// After each search in vain they have so many times longer.
const FEEL_GROWTH: f64 = 1.6;
/// No order leads a landing up again that has come to this height by the estimate, m: at the speed of a landing the floor is
/// one second away, and an order that comes with the touch-down would lift a vehicle off that somebody has seen land.
const LAST_M: f64 = 0.3;
/// The estimate must be good for this long before a blind descent becomes a landing again, s.
const BACK_FOR_S: f64 = 0.3;
/// After each descent of a flight it must be good for so many times longer.
const BACK_GROWTH: f64 = 3.0;
/// A landing that has taken this much longer than it should stands on the floor and leans against the wind,
/// or its estimate is wrong, s: the floor is felt for whatever speed and thrust say.
const OVERDUE_S: f64 = 5.0;
/// A board that refuses to disarm on the floor is forced after this time without thrust, s.
const FORCE_AFTER_S: f64 = 3.0;
/// People are told that a board does not disarm after this time, s …
const INSIST_FIRST_S: f64 = 2.0;
/// … and again after this, s.
const INSIST_TELL_S: f64 = 5.0;
/// State of the search for the floor. It belongs to the way down, not to a mode: what was found of the floor in a landing
/// holds in the descent that it turns into, and the other way round. Only an accelerometer that shows a fall takes
/// it back.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Touch {
    /// When the way down began.
    down_since: Option<HostTime>,
    /// The floor was one second away by the estimate.
    is_last: bool,
    /// Since when there is a reason to feel for the floor.
    since: Option<HostTime>,
    /// Thrust is held below this while it is felt for.
    pub ceiling_frac: Option<f64>,
    /// Since when thrust is taken away.
    feels_since: Option<HostTime>,
    /// Thrust is held below this since a landing near the floor lost its estimate.
    turn_frac: Option<f64>,
    /// Thrust is held below this since something stopped a descent near the floor.
    pub low_frac: Option<f64>,
    /// When it was found that the vehicle is in the air.
    pub fell_at: Option<HostTime>,
    /// Searches in vain so far.
    falls: i32,
    /// Since when the floor seems to carry.
    carried_since: Option<HostTime>,
    /// The floor carries.
    pub stands: bool,
    /// Specific force along body z, low-passed, m/s², and for how long it has been taken in, s.
    pub acc_z_mps2: f64,
    felt_s: f64,
    /// The same over a longer time, while no floor was felt for.
    usual_mps2: Option<f64>,
    /// Speed gained upward by the accelerometer alone, as far as it is recent, m/s.
    up_mps: f64,
    /// Thrust that was sent, low-passed alike.
    pub thrust_frac: f64,
    /// What is sent is obeyed this much later, s, where that was found before the way down.
    pub lag_s: f64,
}

impl Touch {
    /// Begun anew; the filters and the way down go on.
    pub fn restarted(self) -> Self {
        Self {
            down_since: self.down_since,
            is_last: self.is_last,
            acc_z_mps2: self.acc_z_mps2,
            felt_s: self.felt_s,
            low_frac: self.low_frac,
            usual_mps2: self.usual_mps2,
            up_mps: self.up_mps,
            thrust_frac: self.thrust_frac,
            lag_s: self.lag_s,
            ..Self::default()
        }
    }

    /// At a change of mode.
    pub fn in_mode(self, from: Mode, to: Mode, at: HostTime) -> Self {
        let is_down = |mode| matches!(mode, Mode::Land | Mode::Descend);
        if is_down(from) && is_down(to) {
            return self;
        }
        Self {
            down_since: is_down(to).then_some(at),
            is_last: false,
            low_frac: None,
            ..self.restarted()
        }
    }

    /// A thrust, held below what was found.
    pub fn bounded(&self, thrust_frac: f64) -> f64 {
        let most = |bound: Option<f64>| bound.unwrap_or(1.0);
        thrust_frac.min(most(self.ceiling_frac)).min(most(self.turn_frac)).min(most(self.low_frac))
    }

    /// What was felt of a fall is from before a pause.
    pub fn forget_fall(&mut self) {
        self.fell_at = None;
        self.deaf();
    }

    /// Takes the thrust of a control step in.
    pub fn sent(&mut self, thrust_frac: f64, dt_s: f64) {
        self.thrust_frac += (thrust_frac - self.thrust_frac) * (dt_s / (FEEL_FILTER_S + dt_s));
    }

    /// Whether the floor carries, by thrust and specific force alone.
    fn is_carried(&self, base_frac: f64) -> bool {
        self.thrust_frac < CARRIED_SHARE * base_frac
            && (self.acc_z_mps2 + G_MPS2).abs() < CARRIED_MPS2
    }

    /// How long the loops have to catch a fall, s: with every search in vain longer, or a vehicle that needs
    /// little thrust against the wind would never sink in between.
    fn pause_s(&self) -> f64 {
        FEEL_AGAIN_S * FEEL_GROWTH.powi((self.falls - 1).clamp(0, 5))
    }

    /// Takes an IMU sample in.
    pub fn acc_z(&mut self, acc_z_mps2: f64, dt_s: f64) {
        // The first sample after a gap stands for nothing: wing beats shake it by ten times the limit.
        let dt_s = if dt_s < GAP_S { dt_s } else { 0.0 };
        let weight = (dt_s / (FEEL_FILTER_S + dt_s)).clamp(0.0, 1.0);
        self.acc_z_mps2 += (acc_z_mps2 - self.acc_z_mps2) * weight;
        self.felt_s += dt_s;
        let usual_mps2 = self.usual_mps2.get_or_insert(acc_z_mps2);
        if self.ceiling_frac.is_none() {
            *usual_mps2 += (acc_z_mps2 - *usual_mps2) * dt_s / (USUAL_S + dt_s);
        }
        let gained_mps = (*usual_mps2 - acc_z_mps2) * dt_s;
        self.up_mps = (self.up_mps + gained_mps) * (1.0 - dt_s / (LATELY_S + dt_s));
    }

    /// Whether the sinking was stopped by something: near the floor by the floor.
    fn is_stopped(&self, low: bool) -> bool {
        self.up_mps > if low { STOPPED_MPS } else { STOPPED_HIGH_MPS }
    }

    /// An accelerometer that repeats itself says nothing, and half a wing beat in which it stuck is none of a fall.
    pub fn deaf(&mut self) {
        (self.acc_z_mps2, self.felt_s, self.up_mps) = (-G_MPS2, 0.0, 0.0);
    }
}

impl Pilot {
    pub(crate) fn supervise(&mut self, at: HostTime) {
        // The board was never seen armed, or its heartbeat came before we asked: nothing is left
        // to wait for.
        if self.flight.mode == Mode::Disarming
            && !self.board.link.is_armed()
            && !self.board.link.is_commanding()
        {
            self.fire(at, Event::BoardDisarmed);
        }
        self.pursue_next(at);
        if self.flight.mode == Mode::Idle {
            if self.flight.lift_off_asked {
                self.lift_off(at);
            } else if at.seconds_since(self.flight.mode_since) > self.config.flight.idle_disarm_s {
                self.fire(at, Event::IdleTooLong);
            }
        }
        self.pursue_end(at);
        self.watch_resumption(at);
        self.walk_conditions(at);
        if !self.flight.mode.has_thrust() {
            return;
        }
        let usable = matches!(self.estimate.health, Health::Good | Health::Degraded);
        match self.flight.mode {
            Mode::Land => self.watch_touch_down(at),
            Mode::Descend => self.watch_descent(at),
            _ => {}
        }
        // What a descent begins with is what was known before anything was wrong.
        if usable && self.flight.mode != Mode::Descend {
            self.flight.last_height_m = self.height_above_floor_m();
            self.flight.last_sink_mps = self.estimate.vel_E_mps().z();
        }
    }

    /// Nothing takes off with an estimate that is none, however long ago the vehicle was armed.
    pub(crate) fn lift_off(&mut self, at: HostTime) {
        self.flight.lift_off_asked = false;
        if let Err(why) = self.may_lift_off(at) {
            self.flight.guidance.next = Next::Nothing;
            self.out.say(at, Severity::Error, format!("take-off refused: {why}"));
            return;
        }
        self.fire(at, Event::LiftOffAsked);
    }

    /// In a descent without an estimate: whether the floor is there, and whether the estimate is back.
    fn watch_descent(&mut self, at: HostTime) {
        // So near the floor nothing is to be gained by an estimate that was just lost: it is over sooner than that is known.
        let near = self.flight.supervisor.descent.height_m < NEAR_FLOOR_M
            || self.navigation.is_low_by_baro(&view!(self, at));
        let bad =
            !self.navigation.is_uwb_fresh(at) || !self.navigation.estimate_is_back(&self.estimate);
        if near || bad || self.needs_descent() {
            self.flight.good_since = None;
        } else if at.seconds_since(*self.flight.good_since.get_or_insert(at)) > self.back_for_s() {
            self.fire(at, Event::EstimateBack);
            return;
        }
        let numb = self.navigation.is_numb() || !self.imu_is_alive(at);
        self.flight.supervisor.descent.numb = numb;
        if self.imu_is_alive(at) {
            if self.navigation.touch.fell_at.is_none()
                && self.navigation.touch.ceiling_frac.is_none()
            {
                self.navigation.touch.ceiling_frac = self.standing_ceiling_frac();
            }
            let share = self.flight.control.thrust_frac
                / self.flight.hover_thrust_frac(&self.config).max(0.05);
            let low = self.flight.supervisor.descent.is_low()
                || self.navigation.is_low_by_baro(&view!(self, at));
            let held_up = self.flight.supervisor.descent.is_held_up(share, HELD_UP_SHARE);
            let for_s = if low { TOUCH_FOR_S } else { HELD_UP_FOR_S };
            self.feel_for_floor(at, low, low || held_up, for_s, None);
        } else if self.navigation.touch.stands {
            self.lower_thrust(at);
        } else {
            self.take_hold_of_floor(at);
            self.sink_blindly(at);
        }
    }

    /// Near the floor a landing goes on with no more thrust than it had.
    pub(crate) fn hold_thrust_near_floor(&mut self, at: HostTime) {
        if self.navigation.touch.turn_frac.is_none()
            && self.navigation.is_near_floor(&view!(self, at))
        {
            let least_frac = TURN_SHARE * self.flight.control.thrust_base_frac;
            if self.navigation.is_numb() {
                // Nothing tells whether it stands already.
                self.navigation.touch.low_frac = Some(least_frac);
            }
            let last = self.is_in_last_second(at);
            let most_frac =
                if last { TURN_MOST_SHARE * self.flight.control.thrust_base_frac } else { 1.0 };
            self.navigation.touch.turn_frac =
                Some(self.navigation.touch.thrust_frac.max(least_frac).min(most_frac));
        }
    }

    /// Whether a landing is about to end, as estimate and barometer have it: one of them alone may be wrong, and the vehicle
    /// fall.
    fn is_in_last_second(&self, at: HostTime) -> bool {
        self.navigation.touch.is_last && self.navigation.is_low_by_baro(&view!(self, at))
    }

    /// Most thrust of the loops.
    pub(crate) fn thrust_ceiling_frac(&self, at: HostTime) -> f64 {
        let last = self.flight.mode == Mode::Land && self.is_in_last_second(at);
        let most_frac =
            if last { LAST_SHARE * self.flight.hover_thrust_frac(&self.config) } else { 1.0 };
        self.bounded_frac(most_frac)
    }

    /// A thrust, held below what was found, and below what carries while it is asked whether it stands, or lies.
    pub(crate) fn bounded_frac(&self, thrust_frac: f64) -> f64 {
        let asked_share = self.navigation.carried.most_share().unwrap_or(f64::INFINITY);
        let asked_share = if self.navigation.lying.is_asked() { 0.0 } else { asked_share };
        self.navigation
            .touch
            .bounded(thrust_frac.min(asked_share * self.flight.control.thrust_base_frac))
    }

    /// Without an accelerometer a descent that something holds up near the floor has found it: from here on thrust only
    /// sinks, or the cushion of the floor would throw it up again.
    fn take_hold_of_floor(&mut self, at: HostTime) {
        let share =
            self.flight.control.thrust_frac / self.flight.hover_thrust_frac(&self.config).max(0.05);
        let descent = &self.flight.supervisor.descent;
        let low = descent.is_low() || self.navigation.is_low_by_baro(&view!(self, at));
        if self.navigation.touch.turn_frac.is_some()
            || !(low && descent.is_held_up(share, BLIND_HELD_UP_SHARE))
        {
            self.navigation.touch.since = None;
        } else if at.seconds_since(*self.navigation.touch.since.get_or_insert(at)) > HELD_UP_FOR_S {
            self.navigation.touch.turn_frac = Some(self.navigation.touch.thrust_frac);
        }
    }

    /// No accelerometer tells of the floor.
    fn sink_blindly(&mut self, at: HostTime) {
        let base_frac = self.flight.control.thrust_base_frac;
        let lower_frac = TURN_PER_S * base_frac * CONTROL_PERIOD_US as f64 * 1e-6;
        let turn_frac = self.navigation.touch.turn_frac.map(|frac| frac - lower_frac);
        self.navigation.touch = Touch {
            turn_frac,
            since: self.navigation.touch.since,
            ..self.navigation.touch.restarted()
        };
        if turn_frac.is_some_and(|frac| frac < FEEL_SHARE * base_frac) {
            self.fire(at, Event::TouchDown);
        }
    }

    /// How long an estimate must be good to be flown on again, s: what comes and goes would otherwise keep
    /// the vehicle in the air for ever.
    fn back_for_s(&self) -> f64 {
        BACK_FOR_S * BACK_GROWTH.powi((self.flight.supervisor.descents - 1).clamp(0, 6))
    }

    /// Air pressure for whoever does not trust the estimate.
    pub(crate) fn watch_baro(&mut self, sample: &BaroSample) {
        let standing = self.flight.is_standing();
        if standing && self.estimate.health == Health::NotAligned {
            return;
        }
        // The estimate is of the last step.
        let since_s = self.estimate.at.seconds_since(sample.valid_at);
        let known_m = -self.estimate.pos_E_m.z() + self.estimate.vel_E_mps().z() * since_s;
        let dt_s = self.navigation.baro_at.map_or(0.0, |t| sample.valid_at.seconds_since(t));
        self.navigation.baro_at = Some(sample.valid_at);
        let evidence = &mut self.navigation.evidence;
        let Some(height_m) = evidence.note_baro(sample, known_m, standing) else { return };
        self.resume_at_height(sample.valid_at, height_m - self.config.flight.gear_height_m);
        if self.flight.mode == Mode::Descend {
            self.flight.supervisor.descent.baro(height_m, dt_s);
        }
    }

    /// Whether a way down is so far that nobody may call it off.
    pub(crate) fn is_touching_down(&self) -> bool {
        let down = matches!(self.flight.mode, Mode::Land | Mode::Descend);
        down && (self.navigation.touch.is_last
            || self.navigation.touch.stands
            || self.navigation.touch.ceiling_frac.is_some())
    }

    /// Height of the landing gear above the floor by the estimate, m.
    pub(crate) fn height_above_floor_m(&self) -> f64 {
        -self.estimate.pos_E_m.z() - self.config.flight.gear_height_m
    }

    /// The board refuses to disarm, or does not answer. Motors have no thrust by our setpoints;
    /// asking goes on, forced.
    pub(crate) fn insist_on_disarming(&mut self, at: HostTime, why: &str) {
        // A forced disarm works in the air too. The board's land detector may be slow; if it is right
        // and we are not, so much time without thrust has brought the vehicle down anyway.
        let force = at.seconds_since(self.flight.mode_since) > FORCE_AFTER_S;
        self.board.link.command_arm_later(false, force, at);
        // Land detectors take a second to agree.
        let late = at.seconds_since(self.flight.mode_since) > INSIST_FIRST_S;
        if late && self.out.told.insisted_at.is_none_or(|t| at.seconds_since(t) > INSIST_TELL_S) {
            self.out.told.insisted_at = Some(at);
            self.out.say(at, Severity::Critical, format!("disarming failed, still trying: {why}"));
        }
    }

    /// Height and speed near the floor are biased by multipath, so the floor is told by what it
    /// does: it carries. When the vehicle seems to sink too slowly, thrust is taken away; in the
    /// air the accelerometer shows at once that it falls, on the floor it shows nothing.
    fn watch_touch_down(&mut self, at: HostTime) {
        // Near the floor an estimate that nothing measures, or that flies by a sample that repeats itself, is not climbed by.
        if self.navigation.is_numb() || !self.navigation.is_uwb_fresh(at) {
            self.hold_thrust_near_floor(at);
        }
        // The shares were tuned on the configured base. With the learned one the floor was found up to 4 s
        // late where that is smaller, and felt for in mid-air where a load had been set down (X2).
        let base_frac = self.flight.control.thrust_base_frac;
        let sink_mps = self.estimate.vel_E_mps().z();
        let light = self.flight.control.thrust_frac < TOUCH_THRUST_SHARE * base_frac;
        let slow = sink_mps < TOUCH_SPEED_SHARE * self.config.flight.land_slow_speed_mps;
        let low = self.navigation.is_near_floor(&view!(self, at));
        let for_s = match low {
            true if self.navigation.is_clear_of_floor(&view!(self, at)) => TOUCH_CLEAR_FOR_S,
            true => TOUCH_FOR_S,
            false => TOUCH_ANYWHERE_FOR_S,
        };
        let flight = &self.config.flight;
        let longest_s = self.flight.land_from_m / flight.land_slow_speed_mps.max(0.05) + OVERDUE_S;
        if at.seconds_since(self.flight.mode_since) > longest_s {
            self.feel_for_floor(at, low, true, TOUCH_FOR_S, None);
        } else {
            self.feel_for_floor(at, low, light && slow, for_s, Some(sink_mps));
        }
    }

    /// How fast thrust may be taken away, share of the base per second: with a fall that is seen later it is
    /// to be no larger when it is seen.
    fn feel_per_s(&self) -> f64 {
        FEEL_PER_S * FEEL_FILTER_S
            / (FEEL_FILTER_S + self.navigation.obeyed_after_s(&self.board.state()))
    }

    /// Takes thrust away as soon as there has been a reason for so long. `sink_mps`: where it is known.
    fn feel_for_floor(
        &mut self,
        at: HostTime,
        low: bool,
        reason: bool,
        for_s: f64,
        sink_mps: Option<f64>,
    ) {
        let base_frac = self.flight.control.thrust_base_frac;
        self.navigation.touch.is_last |= self.height_above_floor_m() < LAST_M;
        self.watch_contact(at, base_frac);
        self.stay_down(low, base_frac);
        if self.navigation.touch.ceiling_frac.is_none() {
            let began = self.navigation.touch.down_since.unwrap_or(self.flight.mode_since);
            let early = at.seconds_since(began) < TOUCH_NOT_BEFORE_S
                || self
                    .navigation
                    .touch
                    .fell_at
                    .is_some_and(|t| at.seconds_since(t) < self.navigation.touch.pause_s());
            if early || !reason {
                self.navigation.touch.since = None;
            } else if at.seconds_since(*self.navigation.touch.since.get_or_insert(at)) > for_s {
                self.navigation.touch.ceiling_frac = Some(self.flight.control.thrust_frac);
            }
            return;
        }
        let fast_mps = 2.0 * self.config.flight.land_slow_speed_mps;
        // A speed by the estimate counts where the accelerometer leans the same way, and not after the estimate was once
        // lost: on the floor it says what it likes, and whoever believed it took off again.
        let believed = self.flight.supervisor.descents == 0 && self.navigation.is_uwb_fresh(at);
        let sinks = believed && sink_mps.is_some_and(|sink_mps| sink_mps > fast_mps);
        let short_mps2 = self.navigation.touch.acc_z_mps2 + G_MPS2;
        // Half a wing beat alone is a fall to a filter that has only begun.
        let felt = self.navigation.touch.felt_s > FEEL_FILTER_S;
        if felt && (short_mps2 > FALLING_MPS2 || (short_mps2 > SINKING_MPS2 && sinks)) {
            let falls = self.navigation.touch.falls;
            self.navigation.touch = self.navigation.touch.restarted();
            (self.navigation.touch.fell_at, self.navigation.touch.falls) = (Some(at), falls + 1);
            if self.navigation.touch.is_last {
                // What says that it falls may be an accelerometer that says anything, and a loop that believes it lifts off.
                self.navigation.touch.low_frac = Some(TURN_SHARE * base_frac);
            }
            self.flight.supervisor.descent.floor_not_found();
        } else if !self.navigation.is_numb() || self.navigation.touch.stands {
            self.lower_thrust(at);
        }
        // Else nobody could say whether it falls now: one that stuck just here had thrust taken away at 0.5 m.
    }

    /// What was stopped near the floor goes on without the thrust that would lift it off again. Where it was a gust it
    /// falls, which shows at once. Whoever has no estimate, or had none, keeps below hover thrust even then: a hop of a
    /// centimetre ends with a fall as well.
    fn stay_down(&mut self, low: bool, base_frac: f64) {
        if !self.navigation.is_numb()
            && self.flight.supervisor.descents > 0
            && self.navigation.touch.is_stopped(low)
        {
            self.navigation.touch.up_mps = 0.0;
            if low {
                self.navigation.touch.low_frac = Some(TURN_SHARE * base_frac);
            }
            // A fall that is seen late is to be a slow one.
            let share = if self.navigation.obeys_late(&self.board.state()) {
                TURN_SHARE
            } else {
                DOWN_SHARE
            };
            self.navigation.touch.ceiling_frac =
                Some(self.navigation.touch.bounded(share * base_frac));
        }
    }

    /// Whether the floor carries already, whatever the estimate says of height and speed.
    fn watch_contact(&mut self, at: HostTime, base_frac: f64) {
        let near = self.navigation.is_near_floor(&view!(self, at));
        if !near || self.navigation.is_numb() || !self.navigation.touch.is_carried(base_frac) {
            self.navigation.touch.carried_since = None;
            return;
        }
        let since = *self.navigation.touch.carried_since.get_or_insert(at);
        if at.seconds_since(since) >= CARRIED_FOR_S && !self.navigation.touch.stands {
            self.navigation.touch.stands = true;
            let most_frac = CARRIED_SHARE * base_frac;
            self.navigation.touch.ceiling_frac = Some(self.navigation.touch.bounded(most_frac));
        }
    }

    /// A step less thrust, down to none.
    fn lower_thrust(&mut self, at: HostTime) {
        let base_frac = self.flight.control.thrust_base_frac;
        let Some(ceiling_frac) = self.navigation.touch.ceiling_frac else { return };
        let felt_for_s = at.seconds_since(*self.navigation.touch.feels_since.get_or_insert(at));
        if ceiling_frac < FEEL_SHARE * base_frac {
            let least_s = FEEL_FOR_S + self.navigation.obeyed_after_s(&self.board.state());
            if felt_for_s > least_s {
                self.fire(at, Event::TouchDown);
            }
        } else {
            let lower_frac = self.feel_per_s() * base_frac * CONTROL_PERIOD_US as f64 * 1e-6;
            self.navigation.touch.ceiling_frac = Some(ceiling_frac - lower_frac);
        }
    }
}
