//! Whether the floor is near, and carries: what is felt of it on the way down, where estimate and barometer may both be
//! wrong about it.

use haltere_core::frames::G_MPS2;
use haltere_core::time::HostTime;

use super::Navigation;
use crate::clock::CONTROL_PERIOD_US;
use crate::flight::modes::Mode;
use crate::view::{BoardState, View};

/// No touch-down is looked for right after the landing began, s.
const TOUCH_NOT_BEFORE_S: f64 = 1.0;
/// Sinking slower than this share of what is asked is a reason to feel for the floor …
const TOUCH_SPEED_SHARE: f64 = 0.6;
/// … if thrust is below this share of the base: either the ground effect or the floor carries …
const TOUCH_THRUST_SHARE: f64 = 0.82;
/// … and both hold for this long, s.
pub(crate) const TOUCH_FOR_S: f64 = 0.15;
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
/// A landing that has taken this much longer than it should stands on the floor and leans against the wind,
/// or its estimate is wrong, s: the floor is felt for whatever speed and thrust say.
const OVERDUE_S: f64 = 5.0;
/// Something holds a descent up for this long before the floor is felt for, s.
pub(crate) const HELD_UP_FOR_S: f64 = 1.0;
/// The floor is expected below this height by the estimate, m: near it multipath biases the height
/// by up to half a metre (INTERFACES.md section 1; 0.5 m seen in lockstep).
pub(crate) const NEAR_FLOOR_M: f64 = 0.8;
/// The floor is not there yet where estimate and barometer both say more than this, m.
const CLEAR_M: f64 = 0.5;
/// An estimate is back only where UWB is as new as this, s.
const UWB_BACK_S: f64 = 0.5;
/// An accelerometer that repeats itself for this long shows no fall any more, s: a dozen samples, and long before it
/// counts as frozen.
const FEEL_BLIND_S: f64 = 0.05;

/// How far the way down has come beside the floor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WayDown {
    pub mode_since: HostTime,
    /// Descents in this flight.
    pub descents: i32,
}

/// A reason to feel for the floor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reason {
    /// The floor is expected there.
    pub low: bool,
    /// There is a reason now …
    pub is_one: bool,
    /// … and must have been for so long, s.
    pub for_s: f64,
    /// Sinking speed, m/s, where it is known.
    pub sink_mps: Option<f64>,
}

/// What a step of feeling for the floor came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Felt {
    Nothing,
    /// It falls: there is no floor.
    Fall,
    /// It stands.
    Floor,
}

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

    /// Whether the accelerometer has felt more of a fall lately than of what stopped it.
    pub fn sinks_still(&self) -> bool {
        self.up_mps < 0.0
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

impl Navigation {
    /// What stands near the floor, or may, is not lifted off again.
    pub(crate) fn stay_down_near_floor(&mut self, view: &View<'_>) {
        if self.is_near_floor(view) {
            self.touch.low_frac = Some(TURN_SHARE * view.thrust.base_frac);
        }
    }

    /// Near the floor a landing goes on with no more thrust than it had.
    pub(crate) fn hold_thrust_near_floor(&mut self, view: &View<'_>) {
        if self.touch.turn_frac.is_none() && self.is_near_floor(view) {
            let least_frac = TURN_SHARE * view.thrust.base_frac;
            if self.is_numb() {
                // Nothing tells whether it stands already.
                self.touch.low_frac = Some(least_frac);
            }
            let last = self.is_in_last_second(view);
            let most_frac = if last { TURN_MOST_SHARE * view.thrust.base_frac } else { 1.0 };
            self.touch.turn_frac = Some(self.touch.thrust_frac.max(least_frac).min(most_frac));
        }
    }

    /// Whether a landing is about to end, as estimate and barometer have it: one of them alone may be wrong, and the vehicle
    /// fall.
    fn is_in_last_second(&self, view: &View<'_>) -> bool {
        self.touch.is_last && self.is_low_by_baro(view)
    }

    /// Most thrust of the loops.
    pub(crate) fn thrust_ceiling_frac(&self, view: &View<'_>) -> f64 {
        let last = view.mode == Mode::Land && self.is_in_last_second(view);
        let most_frac = if last { LAST_SHARE * view.thrust.hover_frac } else { 1.0 };
        self.bounded_frac(most_frac, view.thrust.base_frac)
    }

    /// A thrust, held below what was found, and below what carries while it is asked whether it stands, or lies.
    pub(crate) fn bounded_frac(&self, thrust_frac: f64, base_frac: f64) -> f64 {
        let asked_share = self.carried.most_share().unwrap_or(f64::INFINITY);
        let asked_share = if self.lying.is_asked() { 0.0 } else { asked_share };
        self.touch.bounded(thrust_frac.min(asked_share * base_frac))
    }

    /// Without an accelerometer a descent that something holds up near the floor has found it: from here on thrust only
    /// sinks, or the cushion of the floor would throw it up again.
    pub(crate) fn take_hold_of_floor(&mut self, at: HostTime, held_up: bool) {
        if self.touch.turn_frac.is_some() || !held_up {
            self.touch.since = None;
        } else if at.seconds_since(*self.touch.since.get_or_insert(at)) > HELD_UP_FOR_S {
            self.touch.turn_frac = Some(self.touch.thrust_frac);
        }
    }

    /// No accelerometer tells of the floor.
    pub(crate) fn sink_blindly(&mut self, view: &View<'_>) -> Felt {
        let base_frac = view.thrust.base_frac;
        let lower_frac = TURN_PER_S * base_frac * CONTROL_PERIOD_US as f64 * 1e-6;
        let turn_frac = self.touch.turn_frac.map(|frac| frac - lower_frac);
        self.touch = Touch { turn_frac, since: self.touch.since, ..self.touch.restarted() };
        let is_down = turn_frac.is_some_and(|frac| frac < FEEL_SHARE * base_frac);
        if is_down { Felt::Floor } else { Felt::Nothing }
    }

    /// Whether a way down is so far that nobody may call it off.
    pub(crate) fn is_touching_down(&self, mode: Mode) -> bool {
        let down = matches!(mode, Mode::Land | Mode::Descend);
        down && (self.touch.is_last || self.touch.stands || self.touch.ceiling_frac.is_some())
    }

    /// Height and speed near the floor are biased by multipath, so the floor is told by what it
    /// does: it carries. When the vehicle seems to sink too slowly, thrust is taken away; in the
    /// air the accelerometer shows at once that it falls, on the floor it shows nothing.
    pub(crate) fn watch_touch_down(&mut self, view: &View<'_>, way: &WayDown, from_m: f64) -> Felt {
        let at = view.at;
        // Near the floor an estimate that nothing measures, or that flies by a sample that repeats itself, is not climbed by.
        if self.is_numb() || !self.is_uwb_fresh(at) {
            self.hold_thrust_near_floor(view);
        }
        // The shares were tuned on the configured base. With the learned one the floor was found up to 4 s
        // late where that is smaller, and felt for in mid-air where a load had been set down (X2).
        let base_frac = view.thrust.base_frac;
        let sink_mps = view.estimate.vel_E_mps().z();
        let light = view.thrust.sent_frac < TOUCH_THRUST_SHARE * base_frac;
        let slow = sink_mps < TOUCH_SPEED_SHARE * view.config.flight.land_slow_speed_mps;
        let low = self.is_near_floor(view);
        let for_s = match low {
            true if self.is_clear_of_floor(view) => TOUCH_CLEAR_FOR_S,
            true => TOUCH_FOR_S,
            false => TOUCH_ANYWHERE_FOR_S,
        };
        let flight = &view.config.flight;
        let longest_s = from_m / flight.land_slow_speed_mps.max(0.05) + OVERDUE_S;
        if at.seconds_since(way.mode_since) > longest_s {
            self.feel_for_floor(
                view,
                way,
                &Reason { low, is_one: true, for_s: TOUCH_FOR_S, sink_mps: None },
            )
        } else {
            let sink_mps = Some(sink_mps);
            self.feel_for_floor(view, way, &Reason { low, is_one: light && slow, for_s, sink_mps })
        }
    }

    /// How fast thrust may be taken away, share of the base per second: with a fall that is seen later it is
    /// to be no larger when it is seen.
    fn feel_per_s(&self, view: &View<'_>) -> f64 {
        FEEL_PER_S * FEEL_FILTER_S / (FEEL_FILTER_S + self.obeyed_after_s(&view.board))
    }

    /// Takes thrust away as soon as there has been a reason for so long.
    pub(crate) fn feel_for_floor(
        &mut self,
        view: &View<'_>,
        way: &WayDown,
        reason: &Reason,
    ) -> Felt {
        let at = view.at;
        let Reason { low, is_one, for_s, sink_mps } = *reason;
        let base_frac = view.thrust.base_frac;
        self.touch.is_last |= view.height_above_floor_m() < LAST_M;
        self.watch_contact(view);
        self.stay_down(view, low, way.descents);
        if self.touch.ceiling_frac.is_none() {
            let began = self.touch.down_since.unwrap_or(way.mode_since);
            let early = at.seconds_since(began) < TOUCH_NOT_BEFORE_S
                || self.touch.fell_at.is_some_and(|t| at.seconds_since(t) < self.touch.pause_s());
            if early || !is_one {
                self.touch.since = None;
            } else if at.seconds_since(*self.touch.since.get_or_insert(at)) > for_s {
                self.touch.ceiling_frac = Some(view.thrust.sent_frac);
            }
            return Felt::Nothing;
        }
        let fast_mps = 2.0 * view.config.flight.land_slow_speed_mps;
        // A speed by the estimate counts where the accelerometer leans the same way, and not after the estimate was once
        // lost: on the floor it says what it likes, and whoever believed it took off again.
        let believed = way.descents == 0 && self.is_uwb_fresh(at);
        let sinks = believed && sink_mps.is_some_and(|sink_mps| sink_mps > fast_mps);
        let short_mps2 = self.touch.acc_z_mps2 + G_MPS2;
        // Half a wing beat alone is a fall to a filter that has only begun.
        let felt = self.touch.felt_s > FEEL_FILTER_S;
        if felt && (short_mps2 > FALLING_MPS2 || (short_mps2 > SINKING_MPS2 && sinks)) {
            let falls = self.touch.falls;
            self.touch = self.touch.restarted();
            (self.touch.fell_at, self.touch.falls) = (Some(at), falls + 1);
            if self.touch.is_last {
                // What says that it falls may be an accelerometer that says anything, and a loop that believes it lifts off.
                self.touch.low_frac = Some(TURN_SHARE * base_frac);
            }
            Felt::Fall
        } else if !self.is_numb() || self.touch.stands {
            self.lower_thrust(view)
        } else {
            // Nobody could say whether it falls now: one that stuck just here had thrust taken away at 0.5 m.
            Felt::Nothing
        }
    }

    /// What was stopped near the floor goes on without the thrust that would lift it off again. Where it was a gust it
    /// falls, which shows at once. Whoever has no estimate, or had none, keeps below hover thrust even then: a hop of a
    /// centimetre ends with a fall as well.
    fn stay_down(&mut self, view: &View<'_>, low: bool, descents: i32) {
        let base_frac = view.thrust.base_frac;
        if !self.is_numb() && descents > 0 && self.touch.is_stopped(low) {
            self.touch.up_mps = 0.0;
            if low {
                self.touch.low_frac = Some(TURN_SHARE * base_frac);
            }
            // A fall that is seen late is to be a slow one.
            let share = if self.obeys_late(&view.board) { TURN_SHARE } else { DOWN_SHARE };
            self.touch.ceiling_frac = Some(self.touch.bounded(share * base_frac));
        }
    }

    /// Whether the floor carries already, whatever the estimate says of height and speed.
    fn watch_contact(&mut self, view: &View<'_>) {
        let (at, base_frac) = (view.at, view.thrust.base_frac);
        let near = self.is_near_floor(view);
        if !near || self.is_numb() || !self.touch.is_carried(base_frac) {
            self.touch.carried_since = None;
            return;
        }
        let since = *self.touch.carried_since.get_or_insert(at);
        if at.seconds_since(since) >= CARRIED_FOR_S && !self.touch.stands {
            self.touch.stands = true;
            let most_frac = CARRIED_SHARE * base_frac;
            self.touch.ceiling_frac = Some(self.touch.bounded(most_frac));
        }
    }

    /// A step less thrust, down to none.
    pub(crate) fn lower_thrust(&mut self, view: &View<'_>) -> Felt {
        let at = view.at;
        let base_frac = view.thrust.base_frac;
        let Some(ceiling_frac) = self.touch.ceiling_frac else { return Felt::Nothing };
        let felt_for_s = at.seconds_since(*self.touch.feels_since.get_or_insert(at));
        if ceiling_frac < FEEL_SHARE * base_frac {
            let least_s = FEEL_FOR_S + self.obeyed_after_s(&view.board);
            if felt_for_s > least_s {
                return Felt::Floor;
            }
        } else {
            let lower_frac = self.feel_per_s(view) * base_frac * CONTROL_PERIOD_US as f64 * 1e-6;
            self.touch.ceiling_frac = Some(ceiling_frac - lower_frac);
        }
        Felt::Nothing
    }

    pub(crate) fn is_uwb_fresh(&self, at: HostTime) -> bool {
        self.last_fused.is_some_and(|t| at.seconds_since(t) < UWB_BACK_S)
    }

    /// Whether estimate or barometer say that the floor is near.
    pub(crate) fn is_near_floor(&self, view: &View<'_>) -> bool {
        Self::is_low_by_estimate(view) || self.is_low_by_baro(view)
    }

    /// Whether estimate and barometer, each by itself, say that the floor is not there yet.
    pub(crate) fn is_clear_of_floor(&self, view: &View<'_>) -> bool {
        view.height_above_floor_m() > CLEAR_M
            && self.baro_above_floor_m(view).is_some_and(|m| m > CLEAR_M)
    }

    fn is_low_by_estimate(view: &View<'_>) -> bool {
        view.height_above_floor_m() < NEAR_FLOOR_M
    }

    /// Whether the barometer, whose zero was the floor, says that it is near.
    pub(crate) fn is_low_by_baro(&self, view: &View<'_>) -> bool {
        self.baro_above_floor_m(view).is_some_and(|m| m < NEAR_FLOOR_M)
    }

    /// How long what is sent takes to be seen, s; 0 where it is not late.
    pub(crate) fn obeyed_after_s(&self, board: &BoardState) -> f64 {
        board.latency_s.max(self.touch.lag_s)
    }

    /// Whether what is sent is obeyed too late for a loop that is closed over it.
    pub(crate) fn obeys_late(&self, board: &BoardState) -> bool {
        board.is_late || self.touch.lag_s > 0.0
    }

    /// Whether the accelerometer has repeated itself for so long that it shows no fall.
    pub(crate) fn is_numb(&self) -> bool {
        self.repetition.acc_s > FEEL_BLIND_S
    }

    pub(crate) fn imu_age_s(&self, at: HostTime) -> f64 {
        self.last_imu.map_or(f64::INFINITY, |t| at.seconds_since(t))
    }
}
