//! Clock of one anchor as the tag sees it: predicts arrivals, tells false ones, gives K.
//!
//! # Model
//!
//! A packet sent at X (anchor ticks) arrives at T (tag ticks). Between two packets
//!
//! ```text
//! ΔT = (1 + s) · ΔX + noise          K = 1 + s
//! ```
//!
//! s is the difference of the crystals *plus* v/c, where v is the speed at which tag and anchor
//! part: to the tag both look the same. A two-state Kalman filter follows (phase of T, s); s walks
//! randomly with the accelerations of the vehicle, which also covers warming crystals.
//!
//! | symbol | unit | meaning |
//! |---|---|---|
//! | T, X | ticks of 15.65 ps | arrival in tag time, sending in anchor time, both unwrapped |
//! | s | 1 | rate of the tag's clock over that of the anchor, minus one |
//! | φ | ticks | filtered minus measured T of the last packet |
//!
//! # What an error of K does to d
//!
//! d holds c·δs·(tof + X_n − RX_rn). With pairs of neighbouring slots of TDoA2 the factor is
//! 2.1 ms, at most 14.7 ms: δs = 1e-9 is 0.6 mm, at most 4.4 mm (5 mm at a full frame). One
//! interval of 16.8 ms with 5 cm of arrival noise has δs = 1.4e-8, 9 mm (62 mm); the filter in its
//! steady state 1.1e-9, 0.7 mm (5 mm).
//!
//! The part v/c is wanted. With it, the arrival from n is taken back by v·(T_n − T_r), so that
//! d = |p − p_n| − |p − p_r| holds with *one* position, that of the tag when it heard r. With the
//! bare ratio of the crystals d would mix two positions, v·Δt = 6 mm (44 mm) apart at 3 m/s. So a
//! measurement is valid at T_r; what is left is a lag behind accelerations, about 0.1 s · a · Δt.
//!
//! Source: LPS TDoA2 and TDoA3 protocols (INTERFACES); the filter is standard (Bar-Shalom, Li,
//! Kirubarajan 2001, section 6.2). Valid for |s| up to 250 ppm and gaps below 1 s.

use haltere_dialect::lps::{LIGHT_MPS, TICK_HZ, TICK_M};

/// Largest difference of two crystals. The DW1000 asks for ±20 ppm, cold, warm and cheap ones reach
/// ±100 ppm, two of them 200; a tighter bound would lose warm anchors and gain nothing, since a
/// false time differs by far more.
const MAX_SKEW: f64 = 250e-6;

/// An anchor not heard for longer starts anew, ticks: 1 s.
pub const MAX_GAP_TICKS: i64 = TICK_HZ as i64;

/// Packets that fitted before the clock is used: two make a rate, two confirm it.
const SETTLED: u32 = 4;

/// Consecutive arrivals that contradict the clock but not one another: then the clock is wrong.
const RESTART_AFTER: u32 = 3;

/// One sigma of an arrival, m (DW1000, line of sight, received power not corrected for).
const STD_ARRIVAL_M: f64 = 0.05;

/// Random walk of the radial speed, m²/s³: 1 m/s after half a second. Also admits crystals that
/// warm up by 0.1 ppm/s, with a lag of 11 ppb: 7 mm in neighbouring slots.
const SPEED_WALK_M2PS3: f64 = 2.0;

/// The gate, in sigmas of the innovation, where that is wider than the configured one.
const GATE_SIGMAS: f64 = 5.0;

/// An arrival that passes the gate moves the clock by no more than these sigmas would.
const PULL_SIGMAS: f64 = 3.0;

const VAR_ARRIVAL_TICKS2: f64 = (STD_ARRIVAL_M / TICK_M) * (STD_ARRIVAL_M / TICK_M);
const SKEW_WALK_PER_TICK: f64 = SPEED_WALK_M2PS3 / (LIGHT_MPS * LIGHT_MPS * TICK_HZ);
const WRAP_32: f64 = 4_294_967_296.0;

/// What the clock says to a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fit {
    /// It fits; it was taken in.
    Fits,
    /// It is the last one again.
    Repeated,
    /// It contradicts the clock.
    Jump,
}

/// A packet's times: arrival in unwrapped tag ticks, sending in anchor ticks, low 32 bits.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stamp {
    t: i64,
    x: u32,
}

/// The clock.
#[derive(Debug, Clone, Copy, Default)]
pub struct AnchorClock {
    last: Option<Stamp>,
    fitted: u32,
    phase_ticks: f64,
    skew: f64,
    /// Covariance of (phase, skew): phase variance, covariance, skew variance.
    var: [f64; 3],
    suspect: Option<Stamp>,
    suspects: u32,
}

impl AnchorClock {
    /// Whether K may be used.
    pub fn settled(&self) -> bool {
        self.fitted >= SETTLED
    }

    /// s = K − 1.
    pub fn skew(&self) -> f64 {
        self.skew
    }

    /// Arrival of the last packet that fitted, tag ticks.
    pub fn last_arrival(&self) -> Option<i64> {
        self.last.map(|last| last.t)
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Judges a packet that arrived at `t` and was sent at `x`, and takes it in if it fits.
    pub fn observe(&mut self, t: i64, x: u32, gate_ticks: f64) -> Fit {
        let now = Stamp { t, x };
        let Some(last) = self.last.filter(|last| t - last.t <= MAX_GAP_TICKS) else {
            self.start(now);
            return Fit::Fits;
        };
        let dt = t - last.t;
        let dx = self.sent_between(last, now);
        if dt == 0 || dx == 0 {
            return Fit::Repeated;
        }
        if dt < 0 || dx < 0 {
            return self.contradicted(now);
        }
        if self.fitted == 1 {
            return if plausible(dt, dx, gate_ticks) {
                self.start_with_rate(last, now, dx);
                Fit::Fits
            } else {
                self.start(now);
                Fit::Jump
            };
        }
        let dx_ticks = dx as f64;
        let [p00, p01, p11] = self.var;
        let q = SKEW_WALK_PER_TICK * dx_ticks;
        let p00 = p00 + dx_ticks * (2.0 * p01 + dx_ticks * (p11 + q / 3.0));
        let p01 = p01 + dx_ticks * (p11 + q / 2.0);
        let p11 = p11 + q;
        let var_innovation = p00 + VAR_ARRIVAL_TICKS2;
        let std_innovation = var_innovation.sqrt();
        let innovation = (dt - dx) as f64 - self.phase_ticks - self.skew * dx_ticks;
        if innovation.abs() > gate_ticks.max(GATE_SIGMAS * std_innovation) {
            return self.contradicted(now);
        }
        let pull = PULL_SIGMAS * std_innovation;
        let pulled = innovation.clamp(-pull, pull);
        let (gain_phase, gain_skew) = (p00 / var_innovation, p01 / var_innovation);
        self.phase_ticks = gain_phase * pulled - innovation;
        self.skew = (self.skew + gain_skew * pulled).clamp(-MAX_SKEW, MAX_SKEW);
        self.var = [(1.0 - gain_phase) * p00, (1.0 - gain_phase) * p01, p11 - gain_skew * p01];
        self.last = Some(now);
        self.fitted = self.fitted.saturating_add(1);
        self.suspect = None;
        Fit::Fits
    }

    /// Ticks sent between two packets. Only 32 bits are on the air, the arrivals tell the wraps:
    /// within a gap of 1 s any crystal is good for far less than half a wrap of error.
    fn sent_between(&self, from: Stamp, to: Stamp) -> i64 {
        let low = i64::from(to.x.wrapping_sub(from.x));
        let expected = (to.t - from.t) as f64 * (1.0 - self.skew);
        let wraps = ((expected - low as f64) / WRAP_32).round();
        low + ((wraps as i64) << 32)
    }

    fn start(&mut self, now: Stamp) {
        *self = Self { last: Some(now), fitted: 1, ..Self::default() };
    }

    fn start_with_rate(&mut self, before: Stamp, now: Stamp, dx: i64) {
        let dx_ticks = dx as f64;
        let var = VAR_ARRIVAL_TICKS2;
        *self = Self {
            last: Some(now),
            fitted: 2,
            skew: (now.t - before.t - dx) as f64 / dx_ticks,
            var: [var, var / dx_ticks, 2.0 * var / (dx_ticks * dx_ticks)],
            ..Self::default()
        };
    }

    /// Remembers packets that do not fit: when several in a row fit one another, the clock is
    /// wrong, not they. So no state, however wrong, locks an anchor out.
    fn contradicted(&mut self, now: Stamp) -> Fit {
        let fits_last_suspect = self.suspect.and_then(|suspect| {
            let dt = now.t - suspect.t;
            let dx = self.sent_between(suspect, now);
            (dt > 0 && dt <= MAX_GAP_TICKS && plausible(dt, dx, 0.0)).then_some((suspect, dx))
        });
        match fits_last_suspect {
            Some((suspect, dx)) if self.suspects + 1 >= RESTART_AFTER => {
                self.start_with_rate(suspect, now, dx);
            }
            Some(_) => self.suspects += 1,
            None => self.suspects = 1,
        }
        if self.suspects > 0 {
            self.suspect = Some(now);
        }
        Fit::Jump
    }
}

/// Whether two crystals can differ that much.
fn plausible(dt: i64, dx: i64, gate_ticks: f64) -> bool {
    dx > 0 && ((dt - dx) as f64).abs() <= MAX_SKEW * dx as f64 + gate_ticks
}
