//! Dead reckoning by lean and accelerometer, held against UWB window by window (`leads` is the law).

use nalgebra::Vector3;

use super::leads::{Leads, MOST_ANCHORS, RIGHT, Seen, TURN_MOST_RAD, Verdict, Window};
use crate::frames::{E, G_MPS2, Vec3};
use crate::measure::Tdoa;
use crate::survey::Survey;
use crate::time::HostTime;

/// Length of a window, s.
const WINDOW_S: f64 = 1.2;
/// Time in which the velocity downwards is forgotten, s.
const FORGET_S: f64 = 2.0;
/// Way up or down within a window from which on UWB has to follow it, m: a bias of 0.5 m/s² makes 0.3.
const RISE_M: f64 = 0.4;

/// How the vehicle is pushed in a control step.
#[derive(Debug, Clone, Copy)]
pub(in crate::pilot) struct Push {
    /// Acceleration by lean, north and east, m/s².
    pub lean_E_mps2: [f64; 2],
    /// Downwards, by the accelerometer, m/s².
    pub down_mps2: f64,
    /// Heading, rad.
    pub yaw_rad: f64,
    /// Where the estimate has it.
    pub pos_E_m: Vec3<E>,
}

/// The state of it.
#[derive(Debug)]
pub(in crate::pilot) struct Lead {
    drag_per_s: [f64; 2],
    /// What the accelerometer read at rest, m/s².
    pub gravity_read_mps2: f64,
    vel_E_mps: Vector3<f64>,
    window: Window,
    open: bool,
    beside: Leads,
    /// What the pushes of this take-off showed; `None`: none is under way.
    pushes: Option<Leads>,
    /// What they came to, and by what.
    pub verdict: Verdict,
    pushed: Option<Seen>,
    /// What is seen now, some time ago at most.
    seen: Option<Seen>,
    seen_at: HostTime,
}

impl Default for Lead {
    fn default() -> Self {
        Self {
            drag_per_s: [0.0; 2],
            gravity_read_mps2: G_MPS2,
            vel_E_mps: Vector3::zeros(),
            window: Window::new(),
            open: false,
            beside: Leads::default(),
            pushes: None,
            verdict: Verdict::Open,
            pushed: None,
            seen: None,
            seen_at: HostTime::default(),
        }
    }
}

/// M is worked out so often, s.
const INTERVAL_S: f64 = 0.05;

impl Lead {
    /// The vehicle stands: nothing is known of the next flight.
    pub fn rest(&mut self) {
        if !self.open && self.verdict == Verdict::Open && self.beside == Leads::default() {
            return;
        }
        self.open = false;
        self.vel_E_mps = Vector3::zeros();
        (self.beside, self.pushes) = (Leads::default(), None);
        (self.verdict, self.pushed, self.seen) = (Verdict::Open, None, None);
    }

    /// A step of flight.
    pub fn step(&mut self, at: HostTime, push: &Push, drag_per_s: [f64; 2], dt_s: f64) {
        self.drag_per_s = drag_per_s;
        if !self.open {
            self.open = true;
            self.window.restart(push.pos_E_m.raw());
        }
        let (sin, cos) = push.yaw_rad.sin_cos();
        let v = self.vel_E_mps;
        let (ahead, right) = (cos * v.x + sin * v.y, cos * v.y - sin * v.x);
        let [k_x, k_y] = self.drag_per_s;
        let drag = [k_x * ahead, k_y * right];
        let acc = Vector3::new(
            push.lean_E_mps2[0] - (cos * drag[0] - sin * drag[1]),
            push.lean_E_mps2[1] - (sin * drag[0] + cos * drag[1]),
            push.down_mps2 - v.z / FORGET_S,
        );
        if acc.iter().all(|a| a.is_finite()) {
            self.vel_E_mps += acc * dt_s;
            self.window.way_E_m += (v + self.vel_E_mps) * (0.5 * dt_s);
        }
        self.window.time_s += dt_s;
        if at.seconds_since(self.seen_at) >= INTERVAL_S {
            self.seen_at = at;
            let mut all = self.beside;
            all.add(&self.window.leads());
            self.seen = Some(all.seen());
        }
        if self.window.time_s >= WINDOW_S && self.pushes.is_none() {
            self.close(push.pos_E_m);
        }
    }

    /// The window is over: what it says is kept.
    fn close(&mut self, pos_E_m: Vec3<E>) {
        let leads = self.window.leads();
        self.beside.fade();
        self.beside.add(&leads);
        if let Some(pushes) = &mut self.pushes {
            pushes.add(&leads);
        }
        self.window.restart(pos_E_m.raw());
    }

    /// A push begins: what was before is not in its window.
    pub fn begin_push(&mut self, pos_E_m: Vec3<E>) {
        self.close(pos_E_m);
        self.pushes.get_or_insert_default();
    }

    /// A round of pushes is over: what all of them say. The last one decides by what is more likely.
    pub fn judge_push(&mut self, pos_E_m: Vec3<E>, last: bool) -> Verdict {
        self.close(pos_E_m);
        let seen = self.pushes.unwrap_or_default().seen();
        let likely = seen.least()[0] > RIGHT && seen.turn()[0].abs() < TURN_MOST_RAD;
        let likely = if likely { Verdict::Right } else { Verdict::Wrong };
        self.verdict = match seen.pushed() {
            Verdict::Open if last => likely,
            verdict => verdict,
        };
        if self.verdict != Verdict::Open {
            self.pushes = None;
            self.pushed = Some(seen);
        }
        self.verdict
    }

    /// A take-off that was broken off leaves its push unjudged.
    pub fn abandon_push(&mut self) {
        self.pushes = None;
    }

    /// A measurement came, and is not yet too old.
    pub fn note(&mut self, tdoa: &Tdoa, survey: &Survey) {
        if !self.open || !tdoa.distance_diff_m.is_finite() {
            return;
        }
        let rank = |id| survey.ids().iter().take(MOST_ANCHORS).position(|known| *known == id);
        let site = |id| survey.position_E_m(id).map(|p| p.raw());
        let (a, b) = (tdoa.anchor_a, tdoa.anchor_b);
        let (Some(a_at), Some(b_at)) = (rank(a), rank(b)) else { return };
        let (Some(a_E), Some(b_E)) = (site(a), site(b)) else { return };
        self.window.note([a_at, b_at], [a_E, b_E], tdoa.distance_diff_m);
    }

    /// What is seen by the way.
    pub fn seen(&self) -> Option<Seen> {
        self.seen
    }

    /// Whether UWB does not follow the accelerometer by as much as matters.
    pub fn rises_apart(&self) -> bool {
        let far = self.window.way_E_m.z.abs() > RISE_M;
        far && self.seen.is_some_and(|seen| seen.is_wrong_down())
    }

    /// What speaks against the room, if anything does: pushes of the take-off, or the way since.
    pub fn against_room(&self) -> Option<Seen> {
        let pushed = self.pushed.filter(|_| self.verdict == Verdict::Wrong);
        // A push that is under way is judged when both axes were pushed: half of it names the wrong fault. After one
        // that was followed the room is no mirror; what leads against the lean then is a gust.
        let proved = self.verdict == Verdict::Right;
        let beside = self.seen.filter(|seen| seen.is_turned() || (!proved && seen.is_opposed()));
        pushed.or(beside.filter(|_| self.pushes.is_none()))
    }
}
