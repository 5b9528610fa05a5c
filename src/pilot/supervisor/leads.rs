//! Whether UWB leads where lean and accelerometer push: the room's axes, its heading, and that it is alive.
//!
//! **Law.** A push moves the vehicle by what is known without UWB: the board's lean, turned by our heading, and
//! the accelerometer along body z. It is integrated over a window of a second:
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
/// What a window counts after the next: evidence lives for some ten.
const KEEP: f64 = 0.9;
/// Anchors that take part.
pub(super) const MOST_ANCHORS: usize = 16;

/// UWB follows well enough where M along every axis is at least this …
pub(super) const RIGHT: f64 = 0.3;
/// … and the turn at most this, rad (30 degrees): a compass between steel errs by up to 25.
pub(super) const TURN_MOST_RAD: f64 = 0.52;
/// So many sigmas decide.
const SIGMAS: f64 = 2.0;
/// Beside a push more is needed, and M below this: gusts lead it down to there.
const SIGMAS_BESIDE: f64 = 4.0;
const WRONG_BESIDE: f64 = 0.0;

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
    pub fn add(&mut self, more: &Leads) {
        self.information += more.information;
        self.vector += more.vector;
    }

    pub fn fade(&mut self) {
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
    pub fn least(&self) -> [f64; 2] {
        let half = 0.5 * (self.level + self.level.transpose());
        let eigen = half.symmetric_eigen();
        let at = usize::from(eigen.eigenvalues[1] < eigen.eigenvalues[0]);
        let e = eigen.eigenvectors.column(at);
        let f = Vector4::new(e[0] * e[0], e[0] * e[1], e[1] * e[0], e[1] * e[1]);
        [eigen.eigenvalues[at], self.std_of(f)]
    }

    /// Angle by which it is turned, rad, and one sigma of it.
    pub fn turn(&self) -> [f64; 2] {
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
        } else if least - SIGMAS * std > RIGHT && turn_rad.abs() + std_turn_rad < TURN_MOST_RAD {
            Verdict::Right
        } else {
            Verdict::Open
        }
    }

    /// Whether what was seen by the way says that the heading is wrong.
    pub fn is_turned(&self) -> bool {
        let ([least, _], [turn_rad, std_turn_rad]) = (self.least(), self.turn());
        least > RIGHT && turn_rad.abs() - SIGMAS_BESIDE * std_turn_rad > TURN_MOST_RAD
    }

    /// Whether it says that UWB leads against the push.
    pub fn is_opposed(&self) -> bool {
        let [least, std] = self.least();
        least + SIGMAS_BESIDE * std < WRONG_BESIDE
    }

    /// Whether UWB does not follow the accelerometer up and down.
    pub fn is_wrong_down(&self) -> bool {
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
pub(super) struct Window {
    from_E_m: Vector3<f64>,
    /// Time since its beginning, s.
    pub time_s: f64,
    /// Way by the push since then, m.
    pub way_E_m: Vector3<f64>,
    pairs: Vec<Pair>,
    information: SMatrix<f64, SIZE, SIZE>,
    vector: SVector<f64, SIZE>,
}

impl Window {
    /// Closed.
    pub fn new() -> Self {
        Self {
            from_E_m: Vector3::zeros(),
            time_s: 0.0,
            way_E_m: Vector3::zeros(),
            pairs: vec![Pair::default(); MOST_ANCHORS * MOST_ANCHORS],
            information: SMatrix::zeros(),
            vector: SVector::zeros(),
        }
    }

    /// From here, now.
    pub fn restart(&mut self, from_E_m: Vector3<f64>) {
        self.from_E_m = from_E_m;
        self.time_s = 0.0;
        self.way_E_m = Vector3::zeros();
        self.pairs.fill(Pair::default());
        self.information = SMatrix::zeros();
        self.vector = SVector::zeros();
    }

    /// A TDOA between the anchors of these places in the survey, at these sites.
    pub fn note(&mut self, [a, b]: [usize; 2], [a_E, b_E]: [Vector3<f64>; 2], diff_m: f64) {
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
    pub fn leads(&self) -> Leads {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// What a window of pushes shows in a room in which UWB leads by this matrix.
    fn shown(m: Matrix2<f64>) -> Seen {
        let site = |i: usize| {
            let at = |bit: usize, far: f64| if i & bit != 0 { far } else { 0.0 };
            Vector3::new(at(1, 10.0), at(2, 10.0), -at(4, 7.0))
        };
        let mut window = Window::new();
        window.restart(Vector3::new(4.0, 5.0, -0.5));
        for n in 0..120_u32 {
            let t = f64::from(n) * 0.01;
            window.time_s = t;
            window.way_E_m = Vector3::new(0.15 * (6.0 * t).sin(), 0.1 * (9.0 * t).sin(), -0.2 * t);
            let w = window.way_E_m;
            let led = m * nalgebra::Vector2::new(w.x, w.y);
            let p = window.from_E_m + Vector3::new(led.x, led.y, w.z);
            for i in 0..8 {
                let (a, b) = (i, (i + 3) % 8);
                let diff_m = (p - site(b)).norm() - (p - site(a)).norm();
                // What a survey or a floor adds to a pair does not count.
                window.note([a, b], [site(a), site(b)], diff_m + 0.4 * (a.min(b) as f64 - 3.0));
            }
        }
        let mut leads = Leads::default();
        leads.add(&window.leads());
        leads.seen()
    }

    #[test]
    fn prop_each_wrong_room_is_named_by_one_window_of_pushes() {
        let turned = |deg: f64| nalgebra::Rotation2::new(deg.to_radians()).into_inner();
        let cases = [
            (Matrix2::identity(), Verdict::Right, ""),
            (Matrix2::new(0.0, 1.0, 1.0, 0.0), Verdict::Wrong, "north and east are exchanged"),
            (Matrix2::new(-1.0, 0.0, 0.0, 1.0), Verdict::Wrong, "north is south"),
            (Matrix2::new(1.0, 0.0, 0.0, -1.0), Verdict::Wrong, "east is west"),
            (turned(20.0), Verdict::Right, ""),
            (turned(60.0), Verdict::Wrong, "UWB leads +60 deg"),
            (turned(-90.0), Verdict::Wrong, "UWB leads -90 deg"),
            (turned(180.0), Verdict::Wrong, "180 deg"),
            (Matrix2::zeros(), Verdict::Wrong, "does not follow"),
        ];
        for (m, verdict, words) in cases {
            let seen = shown(m);
            assert!((seen.level - m).norm() < 0.1, "{m} {}", seen.level);
            assert_eq!(seen.pushed(), verdict, "{m} {:?} {:?}", seen.least(), seen.turn());
            assert!(verdict == Verdict::Right || seen.words().contains(words), "{}", seen.words());
        }
    }

    #[test]
    fn prop_what_stands_decides_nothing() {
        assert_eq!(Leads::default().seen().pushed(), Verdict::Open);
    }
}
