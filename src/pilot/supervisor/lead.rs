//! Whether UWB leads where lean and accelerometer push: the room's axes, its heading, and that it is alive.
//!
//! **Law.** A push moves the vehicle by what is known without UWB: the board's lean, turned by our heading, and
//! the accelerometer along body z. It is integrated over a window of [`WINDOW_S`]:
//!
//! ```text
//! dv/dt = g · lean − k ∘ v          horizontally; k drag along heading x and y, 1/s
//! dv/dt = f_z R₃₃ + g − v/T         downwards; f_z specific force over what it was at rest, T forgets its bias
//! w     = ∫ v dt                    the way by the push, m
//! p     = p₀ + w + u t + ½ c t² + (M − 1) w
//! ```
//! p is where UWB has it. In a sound room M is the unit matrix. Where x and y are exchanged, or one of them points
//! the wrong way, its determinant is negative; a wrong heading makes it a rotation by that angle; ranging that is old
//! makes it zero. Every TDOA is a linear equation of u, c (downwards alone) and M. Of each pair of anchors only the
//! changes count: what a survey, a floor or a wall adds stays the same within a window.
//!
//! u (wind, trim) and c (bias of the accelerometer) are of each window, under priors; M is common to all, so windows
//! are added as information on M once u and c are eliminated (Schur complement).
//!
//! **Source.** Weighted least squares; drag as the filter's (`[estimator] drag_per_s`). **Validity.** Nearly level
//! flight. Gusts under a closed loop are answered by leaning against them, which looks as if UWB led the wrong way:
//! so the take-off pushes without the loop (`pilot/push.rs`), and what is seen by the way counts only beyond what
//! gusts do.

use nalgebra::{Matrix2, Matrix4, SMatrix, SVector, Vector3, Vector4};

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;

use super::super::{Pilot, Severity};
use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::frames::{E, G_MPS2, Vec3, wrap_pi_rad};
use crate::measure::Tdoa;
use crate::survey::Survey;
use crate::time::HostTime;

/// Length of a window, s.
pub(super) const WINDOW_S: f64 = 1.2;
/// One sigma of a TDOA, m, with what neighbouring ones share in it. Over 72 rounds of pushes in 24 sound halls M
/// scattered as this says (`lockstep/tests/liars.rs`).
const STD_TDOA_M: f64 = 0.1;
/// A change of a pair by more than this is another path, not a way, m.
const MOST_CHANGE_M: f64 = 2.0;
/// One sigma of wind and of what trim does, m/s.
const STD_DRIFT_MPS: f64 = 0.5;
/// One sigma of the accelerometer's bias in flight, m/s².
const STD_BIAS_MPS2: f64 = 0.5;
/// Before anything is seen M is unknown to this.
const STD_PRIOR: f64 = 3.0;
/// What paths that bend with the place do to M, one sigma.
const STD_PLACE: f64 = 0.08;
/// Time in which the velocity downwards is forgotten, s.
const FORGET_S: f64 = 2.0;
/// What a window counts after the next: evidence lives for some ten.
const KEEP: f64 = 0.9;
/// Anchors that take part.
const MOST_ANCHORS: usize = 16;

/// UWB follows well enough where M along every axis is at least this …
const RIGHT: f64 = 0.3;
/// … and the turn at most this, rad (30 degrees): a compass between steel errs by up to 25.
const TURN_MOST_RAD: f64 = 0.52;
/// So many sigmas decide.
const SIGMAS: f64 = 2.0;
/// Beside a push more is needed, and M below this: gusts lead it down to there.
const SIGMAS_BESIDE: f64 = 4.0;
const WRONG_BESIDE: f64 = 0.0;

/// Way up or down within a window from which on UWB has to follow it, m: a bias of 0.5 m/s² makes 0.3.
const RISE_M: f64 = 0.4;

/// Unknowns: wind, bias, M as xx, xy, yx, yy, zz.
const SIZE: usize = 9;
const NUISANCE: usize = 4;
const LEADS: usize = 5;

/// What is learned of M.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(in crate::pilot) struct Leads {
    information: SMatrix<f64, LEADS, LEADS>,
    vector: SVector<f64, LEADS>,
}

/// What that comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::pilot) enum Verdict {
    /// UWB follows each push.
    Right,
    /// It leads elsewhere.
    Wrong,
    /// Too little was seen.
    Open,
}

/// M and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::pilot) struct Seen {
    /// North and east.
    pub level: Matrix2<f64>,
    cov: Matrix4<f64>,
    /// Downwards, and one sigma of it.
    pub down: [f64; 2],
}

impl Leads {
    fn add(&mut self, more: &Leads) {
        self.information += more.information;
        self.vector += more.vector;
    }

    fn fade(&mut self) {
        self.information *= KEEP;
        self.vector *= KEEP;
    }

    /// M so far.
    pub fn seen(&self) -> Seen {
        let prior = SMatrix::<f64, LEADS, LEADS>::identity() / (STD_PRIOR * STD_PRIOR);
        let cov = (self.information + prior).try_inverse().unwrap_or(prior * STD_PRIOR.powi(4));
        let m = cov * self.vector;
        Seen {
            level: Matrix2::new(1.0 + m[0], m[1], m[2], 1.0 + m[3]),
            cov: cov.fixed_view::<4, 4>(0, 0).into_owned(),
            down: [1.0 + m[4], cov[(4, 4)].max(0.0).sqrt()],
        }
    }
}

impl Seen {
    fn std_of(&self, f: Vector4<f64>) -> f64 {
        ((f.transpose() * self.cov * f)[0].max(0.0) + STD_PLACE * STD_PLACE).sqrt()
    }

    /// How far UWB follows along the axis along which it follows least, and one sigma of that.
    fn least(&self) -> [f64; 2] {
        let half = 0.5 * (self.level + self.level.transpose());
        let eigen = half.symmetric_eigen();
        let at = usize::from(eigen.eigenvalues[1] < eigen.eigenvalues[0]);
        let e = eigen.eigenvectors.column(at);
        let f = Vector4::new(e[0] * e[0], e[0] * e[1], e[1] * e[0], e[1] * e[1]);
        [eigen.eigenvalues[at], self.std_of(f)]
    }

    /// Angle by which it is turned, rad, and one sigma of it.
    fn turn(&self) -> [f64; 2] {
        let m = &self.level;
        let (sin, cos) = (0.5 * (m[(1, 0)] - m[(0, 1)]), 0.5 * (m[(0, 0)] + m[(1, 1)]));
        let across = self.std_of(Vector4::new(0.0, -0.5, 0.5, 0.0));
        [sin.atan2(cos), across / sin.hypot(cos).max(0.1)]
    }

    /// After a push along both axes.
    pub fn pushed(&self) -> Verdict {
        let ([least, std], [turn_rad, std_turn_rad]) = (self.least(), self.turn());
        if least + SIGMAS * std < RIGHT || turn_rad.abs() - SIGMAS * std_turn_rad > TURN_MOST_RAD {
            Verdict::Wrong
        } else if least - SIGMAS * std > RIGHT && turn_rad.abs() < TURN_MOST_RAD {
            Verdict::Right
        } else {
            Verdict::Open
        }
    }

    /// Whether what was seen by the way says that it leads elsewhere.
    fn is_wrong_beside(&self) -> bool {
        let ([least, std], [turn_rad, std_turn_rad]) = (self.least(), self.turn());
        let sure = SIGMAS_BESIDE * std_turn_rad;
        let turned = least > RIGHT && turn_rad.abs() - sure > TURN_MOST_RAD;
        turned || least + SIGMAS_BESIDE * std < WRONG_BESIDE
    }

    /// Whether UWB does not follow the accelerometer up and down.
    fn is_wrong_down(&self) -> bool {
        let [m, std] = self.down;
        m + SIGMAS_BESIDE * std.hypot(STD_PLACE) < RIGHT
    }

    /// What is wrong, for people.
    pub fn words(&self) -> String {
        let m = &self.level;
        let [turn_rad, _] = self.turn();
        let size = (0.5 * m.norm_squared()).sqrt();
        if size < 0.4 {
            "UWB does not follow the vehicle".to_owned()
        } else if m.determinant() > 0.0 {
            let deg = (turn_rad.to_degrees() / 5.0).round() * 5.0;
            format!("heading is not the room's: UWB leads {deg:+.0} deg beside it")
        } else if m[(0, 1)] + m[(1, 0)] > (m[(0, 0)] - m[(1, 1)]).abs() {
            "survey is a mirror image: north and east are exchanged".to_owned()
        } else if m[(0, 0)] < m[(1, 1)] {
            "survey is a mirror image: north is south".to_owned()
        } else {
            "survey is a mirror image: east is west".to_owned()
        }
    }
}

/// Means of the changes of one pair of anchors.
#[derive(Debug, Clone, Copy, Default)]
struct Pair {
    n: f64,
    features: SVector<f64, SIZE>,
    diff_m: f64,
}

/// One window.
#[derive(Debug)]
struct Window {
    from_E_m: Vector3<f64>,
    time_s: f64,
    way_E_m: Vector3<f64>,
    pairs: Vec<Pair>,
    information: SMatrix<f64, SIZE, SIZE>,
    vector: SVector<f64, SIZE>,
}

impl Window {
    fn new() -> Self {
        Self {
            from_E_m: Vector3::zeros(),
            time_s: 0.0,
            way_E_m: Vector3::zeros(),
            pairs: vec![Pair::default(); MOST_ANCHORS * MOST_ANCHORS],
            information: SMatrix::zeros(),
            vector: SVector::zeros(),
        }
    }

    fn restart(&mut self, from_E_m: Vector3<f64>) {
        self.from_E_m = from_E_m;
        self.time_s = 0.0;
        self.way_E_m = Vector3::zeros();
        self.pairs.fill(Pair::default());
        self.information = SMatrix::zeros();
        self.vector = SVector::zeros();
    }

    /// A TDOA between the anchors of these places in the survey, at these sites.
    fn note(&mut self, [a, b]: [usize; 2], [a_E, b_E]: [Vector3<f64>; 2], diff_m: f64) {
        let w = self.way_E_m;
        let p = self.from_E_m + w;
        let (to_a, to_b) = (p - a_E, p - b_E);
        let (far_a_m, far_b_m) = (to_a.norm(), to_b.norm());
        if far_a_m < 0.1 || far_b_m < 0.1 {
            return;
        }
        let sign = if a < b { 1.0 } else { -1.0 };
        let h = (to_b / far_b_m - to_a / far_a_m) * sign;
        let diff_m = (diff_m - (far_b_m - far_a_m)) * sign;
        let t = self.time_s;
        let features = SVector::<f64, SIZE>::from([
            h.x * t,
            h.y * t,
            h.z * t,
            0.5 * h.z * t * t,
            h.x * w.x,
            h.x * w.y,
            h.y * w.x,
            h.y * w.y,
            h.z * w.z,
        ]);
        let Some(pair) = self.pairs.get_mut(a.min(b) * MOST_ANCHORS + a.max(b)) else { return };
        let (off, off_m) = (features - pair.features, diff_m - pair.diff_m);
        if pair.n > 0.0 && off_m.abs() > MOST_CHANGE_M {
            return;
        }
        // Sums about the mean, one value more (Welford).
        let weight = pair.n / (pair.n + 1.0);
        self.information += off * off.transpose() * weight;
        self.vector += off * (off_m * weight);
        pair.n += 1.0;
        pair.features += off / pair.n;
        pair.diff_m += off_m / pair.n;
    }

    /// What the window says of M, wind and bias eliminated.
    fn leads(&self) -> Leads {
        let var = STD_TDOA_M * STD_TDOA_M;
        let information = self.information / var;
        let vector = self.vector / var;
        let drift = 1.0 / (STD_DRIFT_MPS * STD_DRIFT_MPS);
        let bias = 1.0 / (STD_BIAS_MPS2 * STD_BIAS_MPS2);
        let prior = Matrix4::from_diagonal(&Vector4::new(drift, drift, drift, bias));
        let own = information.fixed_view::<NUISANCE, NUISANCE>(0, 0) + prior;
        let cross = information.fixed_view::<NUISANCE, LEADS>(0, NUISANCE).into_owned();
        let Some(inverse) = own.try_inverse() else { return Leads::default() };
        let through = cross.transpose() * inverse;
        Leads {
            information: information.fixed_view::<LEADS, LEADS>(NUISANCE, NUISANCE)
                - through * cross,
            vector: vector.fixed_rows::<LEADS>(NUISANCE)
                - through * vector.fixed_rows::<NUISANCE>(0),
        }
    }
}

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
    gravity_read_mps2: f64,
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
        let likely = if seen.least()[0] > RIGHT { Verdict::Right } else { Verdict::Wrong };
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
    fn rises_apart(&self) -> bool {
        let far = self.window.way_E_m.z.abs() > RISE_M;
        far && self.seen.is_some_and(|seen| seen.is_wrong_down())
    }

    /// What speaks against the room, if anything does: pushes of the take-off, or the way since.
    fn against_room(&self) -> Option<Seen> {
        let pushed = self.pushed.filter(|_| self.verdict == Verdict::Wrong);
        pushed.or(self.seen.filter(Seen::is_wrong_beside))
    }
}

impl Pilot {
    /// Follows what pushes the vehicle, while it is in the air.
    pub(in crate::pilot) fn watch_lead(&mut self, at: HostTime, dt_s: f64) {
        if !self.mode.is_flying() {
            if let Some(rest_mps2) = self.estimator.rest_force_mps2() {
                self.supervisor.lead.gravity_read_mps2 = rest_mps2;
            }
            self.supervisor.lead.rest();
            return;
        }
        let read = self.supervisor.lead.gravity_read_mps2 / G_MPS2;
        // The board's lean where it tells one: ours has UWB in it.
        let board = self.board_attitude.filter(|a| at.seconds_since(a.received_at) < 0.2);
        let yaw_rad = self.estimate.R_EB.yaw_rad();
        let tilt = board.map_or(self.estimate.R_EB, |a| a.attitude);
        let turn_rad = wrap_pi_rad(yaw_rad - tilt.yaw_rad());
        let m = tilt.matrix();
        // Thrust acts along -z of the body.
        let per_up = G_MPS2 / m[(2, 2)].max(0.5);
        let (x, y) = (-m[(0, 2)] * per_up, -m[(1, 2)] * per_up);
        let (sin, cos) = turn_rad.sin_cos();
        let push = Push {
            lean_E_mps2: [cos * x - sin * y, sin * x + cos * y],
            down_mps2: m[(2, 2)] * self.touch.acc_z_mps2 / read.clamp(0.75, 1.3) + G_MPS2,
            yaw_rad,
            pos_E_m: self.estimate.pos_E_m,
        };
        let [k_x, k_y, _] = self.config.estimator.drag_per_s;
        self.supervisor.lead.step(at, &push, [k_x, k_y], dt_s);
    }
}

/// The axes or the heading are not the room's.
pub(super) const ROOM: Condition = Condition {
    name: "room_differs",
    seen_by: "UWB leads elsewhere than the vehicle is pushed. In the take-off the climb waits at 0.4 m, and the vehicle \
              leans by 10 degrees for 0.4 s forwards, back, to the right and back, unless the way up has shown it \
              already: UWB must follow along every axis, and within 30 degrees of the lean. Undecided after three \
              rounds, the likelier holds. Later the board's lean is held against UWB all the time, over some ten \
              windows of 1.2 s; gusts, which the loop answers, do not reach the four sigmas that are asked for then. \
              A survey that is a mirror image, a heading that is wrong, ranging that is old. The text says which.",
    numbers: &[
        Number {
            key: "",
            value: |_| RIGHT,
            unit: "",
            origin: "chosen: share of the push that UWB follows; a survey too small or too large by a half still flies",
        },
        Number {
            key: "",
            value: |_| TURN_MOST_RAD.to_degrees(),
            unit: "deg",
            origin: "a compass between steel errs by up to 25",
        },
    ],
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: UWB does not lead where the vehicle is pushed",
    over: "",
    latched: true,
    health: S::MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL,
    severity: Severity::Emergency,
    is_seen: |pilot, _| pilot.supervisor.lead.against_room().is_some(),
    words: |pilot, _| pilot.supervisor.lead.against_room().map_or(String::new(), |s| s.words()),
    ..ROW
};

/// UWB does not rise and fall as the accelerometer says.
pub(super) const RISE: Condition = Condition {
    name: "rise_differs",
    seen_by: "UWB does not follow the accelerometer up and down, beyond a bias of 0.5 m/s² and over some ten windows of \
              1.2 s, where it says 0.4 m within one: the accelerometer reads another scale, ranging is old, or floor and ceiling anchors are exchanged.",
    numbers: &[Number {
        key: "",
        value: |_| RIGHT,
        unit: "",
        origin: "share of the way that UWB follows, as in room_differs, with four sigmas",
    }],
    lasts_s: |_| 0.1,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: UWB and accelerometer rise apart",
    over: "",
    latched: true,
    health: S::MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL.union(S::MAV_SYS_STATUS_SENSOR_3D_ACCEL),
    severity: Severity::Emergency,
    is_seen: |pilot, _| pilot.supervisor.lead.rises_apart(),
    words: |pilot, _| {
        let share = pilot.supervisor.lead.seen().map_or(0.0, |seen| seen.down[0]);
        format!(
            "UWB rises {share:.1} times as far as the vertical velocity of the accelerometer says"
        )
    },
    ..ROW
};
