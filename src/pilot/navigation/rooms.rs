//! In which room the vehicle flies: a bank of hypotheses on how UWB leads where the vehicle leans.
//!
//! **Law.** A lean pushes the vehicle by what is known without UWB: the board's lean, turned by our heading, and drag.
//! In the room as it was told that is seen through a matrix M, which is the unit matrix in a sound room, a rotation
//! where the heading is wrong, and has a negative determinant where the survey is of the wrong hand:
//!
//! ```text
//! dp/dt = v
//! dv/dt = M (g · lean − K M⁻¹ v) + d      K drag along heading x and y, 1/s
//! dd/dt = −d/τ + white noise              d gusts, trim, what lean and drag miss
//! z     = p + noise                       z where UWB has it, north and east, ten times a second
//! ```
//! Each hypothesis is a Kalman filter of p, v, d with its own M; they share one gain (drag taken as its mean). What they
//! did not predict, r, says how likely each is: by Student's distribution, so that one leap of the position counts for
//! little. The likelihoods are multiplied up, and a hypothesis that is wrong about the room loses with every push.
//!
//! **Gusts.** A loop leans against a gust, which looks as if UWB led against the lean. What sets a gust apart is that at
//! its onset no hypothesis has foreseen it, while in a wrong room the right one foresees everything. So the best of all
//! must fit: where it does not, d may be anything, and what was seen so far is forgotten ([`FITS`], [`GUST_MPS2`]).
//!
//! **Decision.** Stopped is for the best wrong room, if it is e^[`AGAINST`] times as likely as the best sound one. No
//! wrong room ever falls below e^−[`MEMORY`] of the best, so that a room that turns wrong in flight is still found.
//! **False alarms.** Of a test by likelihood ratios that starts anew whenever it has nothing to say, the mean time
//! between two is at least e^`AGAINST` decisions (Lorden 1971, theorem 2): a year of flight for each of the [`WRONG`]
//! rooms, if the model is right. Where it is not, gusts are the worst: in 434 flights of the fault campaign with sound
//! rooms, 140 of them in gusts and winds of 0.6 to 4 m/s, the largest ratio was e^6, and e^15 in one more that lands in
//! turbulence of 0.6 m/s.
//!
//! **Validity.** Nearly level flight off the floor; a board whose attitude is not late; gusts whose onset and end are met
//! by leans of the loop, not foreseen: short blows of 2 m/s and more that a lean met within 0.3 s, exactly, would look like
//! a wrong room. The loops here are slower: of 168 flights in gusts, wind and turbulence (fault campaign, seed 77) none was.

use nalgebra::{Matrix2, Matrix3, Rotation2, Vector2, Vector3};

/// One sigma of d, m/s², and the time for which it lasts, s: a trim of 3 degrees, or air that moves by 0.2 m/s at a drag
/// of 3 1/s. These five were tuned with `FITS` on the flights named above: larger ones find a wrong room later, smaller
/// ones take the onset of a wind for evidence.
const STD_DRIFT_MPS2: f64 = 0.5;
const DRIFT_S: f64 = 1.5;
/// White noise of the acceleration, (m/s²)·√s, and how far paths that bend with the place move p, m/√s.
const ACC_NOISE: f64 = 0.15;
/// … and so much more for each m/s² of lean: thrust is not the weight over the cosine while the height is corrected.
const LEAN_NOISE: f64 = 0.1;
const PLACE_NOISE: f64 = 0.05;
/// One sigma of a position by UWB, m.
const STD_POS_M: f64 = 0.05;
/// Degrees of freedom of Student's distribution.
const FREEDOM: f64 = 8.0;
/// The best hypothesis fits if the square of what it missed is at most so many times the variance of one axis …
const FITS: f64 = 1.5;
/// … else d is taken for this uncertain, m/s² (a gust of 1 m/s across wings with a drag of 4 1/s) …
const GUST_MPS2: f64 = 4.0;
/// … and nothing is held against the room for so many decisions: the time in which d is learned.
const GUST_DECISIONS: u32 = 10;
/// Logarithm of the ratio of likelihoods that decides.
pub(crate) const AGAINST: f64 = 20.0;
/// … and below which no wrong room falls. With it each begins.
const MEMORY: f64 = 8.0;
/// Beside being off course so much is enough.
const DOUBT: f64 = 8.0;
/// … even when what was seen is forgotten, for so many decisions: what drives the vehicle away ends in leans and speeds that
/// no hypothesis foresees.
const DOUBT_DECISIONS: u32 = 15;
/// A sound room may fall so far.
const SOUND_LEAST: f64 = -60.0;
/// Words name a fault if the other kind is less likely by this.
const NAMED: f64 = 3.0;

/// Turns with which it is flown, degrees: a compass between steel errs by up to 25, and with 45 the loops still hold.
const SOUND_TURNS_DEG: [f64; 3] = [0.0, 40.0, -40.0];
/// Scales with which it is flown.
const SOUND_SCALES: [f64; 2] = [0.6, 1.6];
/// Turns that drive it away.
const WRONG_TURNS_DEG: [f64; 7] = [90.0, 120.0, 150.0, 180.0, -150.0, -120.0, -90.0];
/// A mirror image is turned by so many of these, degrees: 0 exchanges east and west, 90 north and east.
const MIRROR_DEG: f64 = 45.0;
const MIRRORS: usize = 8;
const SOUND: usize = SOUND_TURNS_DEG.len() + SOUND_SCALES.len();
const WRONG: usize = WRONG_TURNS_DEG.len() + MIRRORS;

/// What a hypothesis says of the room.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Sound,
    Turned { deg: f64 },
    Mirror { deg: f64 },
}

/// One hypothesis.
#[derive(Debug, Clone, Copy)]
struct Room {
    kind: Kind,
    /// M and its inverse.
    leads: Matrix2<f64>,
    back: Matrix2<f64>,
    pos_m: Vector2<f64>,
    vel_mps: Vector2<f64>,
    drift_mps2: Vector2<f64>,
    /// Logarithm of its likelihood over that of the best.
    log: f64,
}

impl Room {
    fn new(kind: Kind, leads: Matrix2<f64>) -> Self {
        let zero = Vector2::zeros();
        // A rotation, a reflection or a scale: none is singular.
        let back = leads.try_inverse().unwrap_or_else(Matrix2::identity);
        Self { kind, leads, back, pos_m: zero, vel_mps: zero, drift_mps2: zero, log: 0.0 }
    }

    fn is_sound(&self) -> bool {
        self.kind == Kind::Sound
    }

    fn least_log(&self) -> f64 {
        if self.is_sound() { SOUND_LEAST } else { -MEMORY }
    }
}

/// The bank.
#[derive(Debug)]
pub(crate) struct Rooms {
    rooms: [Room; SOUND + WRONG],
    /// Covariance of p, v, d along one axis, of all alike.
    cov: Matrix3<f64>,
    is_open: bool,
    /// Decisions for which a gust is still learned.
    gust: u32,
    /// Decisions for which a doubt still counts.
    doubt: u32,
    /// The likeliest turn and mirror image when there was the last doubt: degrees, and the logarithm.
    suspects: [(f64, f64); 2],
}

impl Default for Rooms {
    fn default() -> Self {
        let turned = |deg: f64| Rotation2::new(deg.to_radians()).into_inner();
        let flipped = Matrix2::new(1.0, 0.0, 0.0, -1.0);
        let sound = SOUND_TURNS_DEG
            .map(turned)
            .into_iter()
            .chain(SOUND_SCALES.map(|scale| Matrix2::identity() * scale))
            .map(|leads| Room::new(Kind::Sound, leads));
        let wrong = WRONG_TURNS_DEG.map(|deg| Room::new(Kind::Turned { deg }, turned(deg)));
        let mirrors = (0..MIRRORS).map(|n| {
            let deg = MIRROR_DEG * n as f64;
            Room::new(Kind::Mirror { deg }, turned(deg) * flipped)
        });
        let mut rooms = [Room::new(Kind::Sound, Matrix2::identity()); SOUND + WRONG];
        for (room, new) in rooms.iter_mut().zip(sound.chain(wrong).chain(mirrors)) {
            *room = new;
        }
        Self {
            rooms,
            cov: Matrix3::zeros(),
            is_open: false,
            gust: 0,
            doubt: 0,
            suspects: [(0.0, 0.0); 2],
        }
    }
}

impl Rooms {
    /// Nothing is known any more.
    pub fn close(&mut self) {
        self.is_open = false;
    }

    /// A control step in the air: acceleration by lean, m/s², heading, rad, drag along heading x and y, 1/s, and where
    /// the estimate has it, m and m/s; all north and east.
    pub fn step(
        &mut self,
        lean_E_mps2: Vector2<f64>,
        yaw_rad: f64,
        drag_per_s: [f64; 2],
        [pos_E_m, vel_E_mps]: [Vector2<f64>; 2],
        dt_s: f64,
    ) {
        if !lean_E_mps2.iter().chain(&pos_E_m).chain(&vel_E_mps).all(|x| x.is_finite()) {
            return;
        }
        if !self.is_open {
            self.begin(pos_E_m, vel_E_mps);
        }
        let turn = Rotation2::new(yaw_rad).into_inner();
        let drag = turn * Matrix2::from_diagonal(&Vector2::from(drag_per_s)) * turn.transpose();
        let keep = 1.0 - dt_s / DRIFT_S;
        for room in &mut self.rooms {
            let push = room.leads * (lean_E_mps2 - drag * (room.back * room.vel_mps));
            let acc = push + room.drift_mps2;
            room.pos_m += room.vel_mps * dt_s;
            room.vel_mps += acc * dt_s;
            room.drift_mps2 *= keep;
        }
        let slows = 1.0 - 0.5 * (drag_per_s[0] + drag_per_s[1]) * dt_s;
        let F = Matrix3::new(1.0, dt_s, 0.0, 0.0, slows, dt_s, 0.0, 0.0, keep);
        let drift = 2.0 * STD_DRIFT_MPS2 * STD_DRIFT_MPS2 / DRIFT_S;
        let lean = LEAN_NOISE * LEAN_NOISE * lean_E_mps2.norm_squared();
        let acc = ACC_NOISE * ACC_NOISE + lean;
        let grown = Vector3::new(PLACE_NOISE * PLACE_NOISE, acc, drift) * dt_s;
        self.cov = F * self.cov * F.transpose() + Matrix3::from_diagonal(&grown);
    }

    fn begin(&mut self, pos_E_m: Vector2<f64>, vel_E_mps: Vector2<f64>) {
        for room in &mut self.rooms {
            (room.pos_m, room.vel_mps, room.drift_mps2) = (pos_E_m, vel_E_mps, Vector2::zeros());
        }
        self.forget();
        let var = Vector3::new(0.1 * 0.1, 0.1 * 0.1, STD_DRIFT_MPS2 * STD_DRIFT_MPS2);
        self.cov = Matrix3::from_diagonal(&var);
        (self.is_open, self.gust, self.doubt) = (true, 0, 0);
    }

    /// What was seen so far does not count.
    fn forget(&mut self) {
        for room in &mut self.rooms {
            room.log = if room.is_sound() { 0.0 } else { -MEMORY };
        }
    }

    /// Where UWB has it now.
    pub fn decide(&mut self, pos_E_m: Vector2<f64>) {
        if !self.is_open || !pos_E_m.iter().all(|x| x.is_finite()) {
            return;
        }
        let column = self.cov.column(0).into_owned();
        let var = column[0] + STD_POS_M * STD_POS_M;
        let gain = column / var;
        let mut least = f64::INFINITY;
        for room in &mut self.rooms {
            let r = pos_E_m - room.pos_m;
            let q = r.norm_squared() / var;
            least = least.min(q);
            room.log -= 0.5 * (FREEDOM + 2.0) * (q / FREEDOM).ln_1p();
            // What Student's distribution takes for an outlier moves it less.
            let weight = ((FREEDOM + 2.0) / (FREEDOM + q)).min(1.0);
            room.pos_m += r * (weight * gain[0]);
            room.vel_mps += r * (weight * gain[1]);
            room.drift_mps2 += r * (weight * gain[2]);
        }
        self.cov -= gain * column.transpose();
        if least > FITS {
            self.cov[(2, 2)] += GUST_MPS2 * GUST_MPS2;
            self.gust = GUST_DECISIONS;
        }
        self.doubt = self.doubt.saturating_sub(1);
        if self.gust > 0 {
            self.gust -= 1;
            return self.forget();
        }
        let top = self.rooms.iter().map(|room| room.log).fold(f64::NEG_INFINITY, f64::max);
        for room in &mut self.rooms {
            room.log = (room.log - top).max(room.least_log());
        }
        if self.against() > DOUBT {
            self.doubt = DOUBT_DECISIONS;
            self.suspects = self.likeliest();
        }
    }

    fn best(&self, of: impl Fn(Kind) -> bool) -> Option<&Room> {
        self.rooms.iter().filter(|room| of(room.kind)).max_by(|a, b| a.log.total_cmp(&b.log))
    }

    /// By how much a wrong room is likelier than every sound one, as a logarithm.
    fn against(&self) -> f64 {
        let log = |of: fn(Kind) -> bool| self.best(of).map_or(0.0, |room| room.log);
        if !self.is_open {
            return 0.0;
        }
        log(|kind| kind != Kind::Sound) - log(|kind| kind == Kind::Sound)
    }

    /// Whether the room is wrong.
    pub fn is_wrong(&self) -> bool {
        self.against() > AGAINST
    }

    /// Whether a wrong one is likelier, by enough to be believed with other signs.
    pub fn is_in_doubt(&self) -> bool {
        self.is_open && self.doubt > 0
    }

    /// The likeliest turn and mirror image.
    fn likeliest(&self) -> [(f64, f64); 2] {
        let (mut turned, mut mirror) = ((0.0, f64::NEG_INFINITY), (0.0, f64::NEG_INFINITY));
        for room in &self.rooms {
            match room.kind {
                Kind::Turned { deg } if room.log > turned.1 => turned = (deg, room.log),
                Kind::Mirror { deg } if room.log > mirror.1 => mirror = (deg, room.log),
                _ => {}
            }
        }
        [turned, mirror]
    }

    /// What is wrong, for people.
    pub fn words(&self) -> String {
        let [turned, mirror] = self.suspects;
        let image = match mirror.0 as i32 {
            0 => "east is west",
            180 => "north is south",
            90 => "north and east are exchanged",
            270 => "north is west and east is south",
            _ => "and it is turned",
        };
        let turn = format!("heading is not the room's: UWB leads {:+.0} deg beside it", turned.0);
        if turned.1 > mirror.1 + NAMED {
            turn
        } else if mirror.1 > turned.1 + NAMED {
            format!("survey is a mirror image: {image}")
        } else {
            format!("survey is a mirror image ({image}), or {turn}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A vehicle that is pushed to and fro along both axes for so long, s, in a room that is led by a matrix, and in a
    /// wind that pushes northwards by so much at a time, m/s², and is leant against.
    fn flown(leads: Matrix2<f64>, time_s: f64, wind: impl Fn(f64) -> f64) -> Rooms {
        let drag = [4.2, 1.8];
        let turn = Rotation2::new(0.7).into_inner();
        let k = turn * Matrix2::from_diagonal(&Vector2::from(drag)) * turn.transpose();
        let (mut rooms, dt_s) = (Rooms::default(), 0.01);
        let (mut pos, mut vel) = (Vector2::zeros(), Vector2::<f64>::zeros());
        let mut against = 0.0;
        for n in 0..(time_s / dt_s) as u32 {
            let t = f64::from(n) * dt_s;
            against += (wind(t) - against) * dt_s / 0.3;
            let lean = Vector2::new(0.6 * (1.1 * t).sin() - against, 0.6 * (1.7 * t).cos());
            vel += (lean - k * vel + Vector2::new(wind(t), 0.0)) * dt_s;
            pos += vel * dt_s;
            let noise = Vector2::new((97.0 * t).sin(), (61.0 * t).cos()) * 0.02;
            rooms.step(lean, 0.7, drag, [leads * pos, leads * vel], dt_s);
            if n % 10 == 0 {
                rooms.decide(leads * pos + noise);
            }
            if rooms.is_wrong() {
                break;
            }
        }
        rooms
    }

    fn turned(deg: f64) -> Matrix2<f64> {
        Rotation2::new(deg.to_radians()).into_inner()
    }

    #[test]
    fn prop_each_wrong_room_is_named() {
        let cases = [
            (Matrix2::new(0.0, 1.0, 1.0, 0.0), "mirror image: north and east are exchanged"),
            (Matrix2::new(-1.0, 0.0, 0.0, 1.0), "mirror image: north is south"),
            (Matrix2::new(1.0, 0.0, 0.0, -1.0), "mirror image: east is west"),
            (turned(90.0), "UWB leads +90 deg"),
            (turned(-90.0), "UWB leads -90 deg"),
            (turned(180.0), "180 deg"),
        ];
        for (leads, words) in cases {
            let rooms = flown(leads, 30.0, |_| 0.0);
            assert!(rooms.is_wrong() && rooms.words().contains(words), "{leads} {}", rooms.words());
        }
    }

    #[test]
    fn prop_no_sound_room_is_wrong() {
        for leads in
            [turned(0.0), turned(25.0), turned(-45.0), turned(0.0) * 0.8, turned(0.0) * 1.25]
        {
            let rooms = flown(leads, 300.0, |_| 0.0);
            assert!(!rooms.is_in_doubt(), "{leads} {}", rooms.against());
        }
    }

    #[test]
    fn prop_a_gust_is_no_room() {
        for push_mps2 in [1.0, 2.0, 4.0] {
            for lasts_s in [0.5, 1.0, 2.0, 5.0] {
                let gust = |t: f64| if t % 10.0 > 10.0 - lasts_s { push_mps2 } else { 0.0 };
                let rooms = flown(turned(0.0), 60.0, gust);
                assert!(!rooms.is_wrong(), "{push_mps2} {lasts_s} {}", rooms.against());
            }
        }
    }
}
