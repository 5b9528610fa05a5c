//! Whether a set of gains can fly at all: the loops on the linear model that the gains were designed on.
//!
//! **Equation.** With W the way from velocity to minus the velocity setpoint, each axis is one loop, opened
//! where its output (lean or thrust) goes to the vehicle:
//!
//! ```text
//! W(s) = (K_p + K_i/s)/s + K_d
//! C(s) = P (W + 1) + I/s (F_e W + 1) + D s/(τ s + 1) + k F_f W
//! L(s) = C(s) G(s)
//! G(s) = g A(s)/(s + d)                     horizontal, lean in rad
//! G(s) = g/base(V) e^(−sT)/((T_f s + 1)(s + d))    vertical, thrust 0 to 1
//! A(s) = ω² e^(−sT)/(s² + 2 ζ ω s + ω²)
//! ```
//!
//! The closed loop is stable if 1 + L(jω) turns by n/2 · π from ω = 0 to ∞, n integrators in L (Nyquist, no
//! pole of L to the right). Gain margin: the least |L|, or 1/|L|, where L crosses the negative real axis; phase
//! margin: the least |arg(−L)| where |L| = 1. It *holds* its place if without feed-forward a position is followed
//! by half at least at [`HOLD_RADPS`].
//!
//! **Symbols.** K position gains, P I D velocity gains, τ `vel_d_filter_s`; k slope of the drag feed-forward,
//! rad per m/s, F_f and F_e the low-passes of `drag.filter_s` and `drag.integral_reference_s` (1 in `raw` and `paper`);
//! d drag, 1/s: what the feed-forward is told of the vehicle forward and sideways, 0.65 down; ω 10 rad/s, ζ 0.7, T 30 ms, T_f 0.08 s; base(V) thrust that hovers at a voltage.
//!
//! **Source.** Vehicle and inner loop as in `gains`, VEHICLE.md. Margins of 6 dB and 30 degrees are the least of
//! textbooks (Åström and Murray, *Feedback Systems*, 10.3). **Validity.** Small motions about hover, an estimate that
//! is right. **Left out.** Limits, ground, tilt compensation, coupling of the axes, the filter.

use nalgebra::Complex;

use crate::control::config::ControlConfig;
use crate::control::gains::ControlGains;
use crate::control::voltage::BaseThrust;
use crate::frames::G_MPS2;

type C = Complex<f64>;

/// Least gain margin, dB, and phase margin, deg.
pub const LEAST_GAIN_DB: f64 = 6.0;
/// The second of the two.
pub const LEAST_PHASE_DEG: f64 = 30.0;
/// A place is held against what moves slower than this, rad/s: back within 5 s.
pub const HOLD_RADPS: f64 = 0.2;
/// Share of a movement so slow that is followed at least.
const HOLD_SHARE: f64 = 0.5;
/// Drag down, 1/s, and the least that is taken for the other axes: the lower end of its range (VEHICLE.md). Whoever tells
/// of no drag has not taken it from the vehicle.
const LEAST_DRAG_PER_S: f64 = 0.65;
/// Inner attitude loop: rad/s, damping, and transport, s.
const ATTITUDE_RADPS: f64 = 10.0;
const ATTITUDE_DAMPING: f64 = 0.7;
const TRANSPORT_S: f64 = 0.03;
/// Lag of the flapping, s.
const FLAP_LAG_S: f64 = 0.08;
/// Speed at which the slope of the feed-forward is taken, m/s: the law bends above it.
const SLOPE_AT_MPS: f64 = 0.5;
/// The sweep: from and to, rad/s, and points a decade.
const SWEEP_RADPS: [f64; 2] = [1e-4, 1e3];
const POINTS: f64 = 60.0;
/// Most thrust over the one that hovers with an empty battery, and least with a full one: what is left climbs and
/// sinks at 1 m/s² at least.
const CLIMB_SHARE: f64 = 1.1;
const SINK_SHARE: f64 = 0.9;

/// Axes by name, and the places of their gains among [`ControlGains::TUNABLES`].
const AXES: [(&str, &[usize]); 3] = [
    ("forward", &[0, 4, 6, 7, 8, 15]),
    ("sideways", &[1, 4, 9, 10, 11, 15]),
    ("vertical", &[2, 3, 5, 12, 13, 14, 15]),
];

/// One loop: gains, feed-forward, and the vehicle along its axis.
#[derive(Debug, Clone, Copy)]
struct Loop {
    /// K_p, K_i, K_d.
    pos: [f64; 3],
    /// P, I, D.
    vel: [f64; 3],
    d_filter_s: f64,
    /// k, F_f and F_e.
    ff_rad_per_mps: f64,
    ff_filter_s: f64,
    expected_s: f64,
    drag_per_s: f64,
    /// Hover thrust; `None`: horizontal.
    base_frac: Option<f64>,
}

/// What a sweep shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margins {
    /// Whether the closed loop is stable.
    pub stable: bool,
    /// Gain margin, up or down, dB.
    pub gain_db: f64,
    /// Phase margin, deg.
    pub phase_deg: f64,
    /// Whether a place is held.
    pub holds: bool,
}

impl Margins {
    /// Whether it may be flown.
    pub fn suffice(&self) -> bool {
        self.stable
            && self.holds
            && self.gain_db >= LEAST_GAIN_DB
            && self.phase_deg >= LEAST_PHASE_DEG
    }

    fn words(&self) -> String {
        if !self.stable {
            "is unstable".to_owned()
        } else if !self.holds {
            "does not hold a place".to_owned()
        } else {
            format!(
                "has a margin of {:.1} dB and {:.0} deg, {LEAST_GAIN_DB:.0} dB and \
                 {LEAST_PHASE_DEG:.0} deg needed",
                self.gain_db, self.phase_deg
            )
        }
    }
}

/// Margins of an axis (0 forward, 1 sideways, 2 vertical) at a voltage, V.
pub fn margins(config: &ControlConfig, axis: usize, supply_v: f64) -> Margins {
    Loop::new(config, &config.gains, axis, supply_v).margins()
}

/// Why nothing may fly with this set, for people: the parameter that has to change. `None`: it may.
pub fn refusal(config: &ControlConfig) -> Option<String> {
    thrust_refusal(config).or_else(|| (0..AXES.len()).find_map(|axis| axis_refusal(config, axis)))
}

fn thrust_refusal(config: &ControlConfig) -> Option<String> {
    let base = BaseThrust::new(&config.voltage);
    let limits = &config.limits;
    let voltage = &config.voltage;
    let (empty, full) = (base.at_frac(voltage.lowest_v()), base.at_frac(voltage.highest_v()));
    if limits.thrust_max_frac < CLIMB_SHARE * empty {
        return Some(format!(
            "control.limits.thrust_max_frac = {}: {:.2} needed with an empty battery",
            limits.thrust_max_frac,
            CLIMB_SHARE * empty
        ));
    }
    (limits.thrust_min_frac > SINK_SHARE * full).then(|| {
        format!(
            "control.limits.thrust_min_frac = {}: at most {:.2} sinks with a full battery",
            limits.thrust_min_frac,
            SINK_SHARE * full
        )
    })
}

fn axis_refusal(config: &ControlConfig, axis: usize) -> Option<String> {
    let (full_v, empty_v) = (config.voltage.highest_v(), config.voltage.lowest_v());
    let voltages: &[(f64, &str)] = if axis == 2 {
        &[(full_v, ", full battery"), (empty_v, ", empty battery")]
    } else {
        &[(full_v, "")]
    };
    voltages.iter().find_map(|(supply_v, when)| {
        let found = margins(config, axis, *supply_v);
        if found.suffice() {
            return None;
        }
        let index = culprit(config, axis, *supply_v);
        let value = config.gains.as_vector()[index];
        let usual = ControlGains::default().as_vector()[index];
        Some(format!(
            "control.gains.{} = {value} (default {usual}): the {} loop{when} {}",
            ControlGains::TUNABLES[index].name,
            AXES[axis].0,
            found.words()
        ))
    })
}

/// The gain that makes the loop fly when it alone is put to its default; where none does, the one that is
/// farthest from it.
fn culprit(config: &ControlConfig, axis: usize, supply_v: f64) -> usize {
    let (now, usual) = (config.gains.as_vector(), ControlGains::default().as_vector());
    let changed = AXES[axis].1.iter().copied().filter(|i| now[*i] != usual[*i]);
    let mends = |i: usize| {
        let mut one = now;
        one[i] = usual[i];
        Loop::new(config, &ControlGains::from_vector(one), axis, supply_v).margins().suffice()
    };
    // A gain that is off is as far as can be.
    let far = |i: usize| (now[i] / usual[i]).ln().abs();
    let mending = changed.clone().find(|i| mends(*i));
    let farthest = changed.max_by(|a, b| far(*a).total_cmp(&far(*b)).then(b.cmp(a)));
    mending.or(farthest).unwrap_or(AXES[axis].1[0])
}

impl Loop {
    fn new(config: &ControlConfig, gains: &ControlGains, axis: usize, supply_v: f64) -> Self {
        let g = gains;
        let (pos, vel) = match axis {
            0 => (
                [g.pos_x_p_per_s, 0.0, g.pos_xy_d_frac],
                [g.vel_x_p_rad_per_mps, g.vel_x_i_rad_per_m, g.vel_x_d_rad_per_mps2],
            ),
            1 => (
                [g.pos_y_p_per_s, 0.0, g.pos_xy_d_frac],
                [g.vel_y_p_rad_per_mps, g.vel_y_i_rad_per_m, g.vel_y_d_rad_per_mps2],
            ),
            _ => (
                [g.pos_z_p_per_s, g.pos_z_i_per_s2, g.pos_z_d_frac],
                [g.vel_z_p_frac_per_mps, g.vel_z_i_frac_per_m, g.vel_z_d_frac_per_mps2],
            ),
        };
        let drag = &config.drag;
        let forward = axis < 2 && config.enhancements().drag_feed_forward;
        let [ff_filter_s, expected_s] = config.feed_forward_s();
        let slope = drag.lean_rad(axis.min(1), SLOPE_AT_MPS) / SLOPE_AT_MPS;
        Self {
            pos,
            vel,
            d_filter_s: g.vel_d_filter_s,
            ff_rad_per_mps: if forward { slope } else { 0.0 },
            ff_filter_s,
            expected_s: if forward { expected_s } else { 0.0 },
            // A lean of g⁻¹ d v holds a speed v: the vehicle is the one that the feed-forward was told of.
            drag_per_s: if axis < 2 {
                (G_MPS2 * slope).max(LEAST_DRAG_PER_S)
            } else {
                LEAST_DRAG_PER_S
            },
            base_frac: (axis >= 2)
                .then(|| BaseThrust::new(&config.voltage).at_frac(supply_v).max(0.05)),
        }
    }

    fn without_feed_forward(self) -> Self {
        Self { ff_rad_per_mps: 0.0, expected_s: 0.0, ..self }
    }

    /// G(s): velocity over lean or thrust.
    fn vehicle(&self, s: C) -> C {
        let wait = (-s * TRANSPORT_S).exp();
        let moves = (s + self.drag_per_s).inv() * G_MPS2 * wait;
        match self.base_frac {
            Some(base_frac) => moves / ((s * FLAP_LAG_S + 1.0) * base_frac),
            None => {
                let w = ATTITUDE_RADPS;
                moves * (w * w) / (s * s + s * (2.0 * ATTITUDE_DAMPING * w) + w * w)
            }
        }
    }

    /// Lean or thrust over the velocity setpoint.
    fn of_setpoint(&self, s: C) -> C {
        let [p, i, _] = self.vel;
        let low_pass = |time_s: f64| (s * time_s + 1.0).inv();
        low_pass(self.expected_s) / s * i + low_pass(self.ff_filter_s) * self.ff_rad_per_mps + p
    }

    /// L(s).
    fn open(&self, s: C) -> C {
        let [kp, ki, kd] = self.pos;
        let [p, i, d] = self.vel;
        let w = (s.inv() * ki + kp) / s + kd;
        let own = s.inv() * i + p + s * d / (s * self.d_filter_s + 1.0);
        self.vehicle(s) * (self.of_setpoint(s) * w + own)
    }

    /// Position over a commanded one, by size.
    fn follows(&self, w_radps: f64) -> f64 {
        let s = C::new(0.0, w_radps);
        let [kp, ki, _] = self.pos;
        let ahead = self.vehicle(s) / s * (s.inv() * ki + kp) * self.of_setpoint(s);
        (ahead / (self.open(s) + 1.0)).norm()
    }

    /// Integrators in L.
    fn integrators(&self) -> f64 {
        let [kp, ki, _] = self.pos;
        let [p, i, _] = self.vel;
        let outer = if ki > 0.0 {
            2.0
        } else if kp > 0.0 {
            1.0
        } else {
            0.0
        };
        if i > 0.0 {
            1.0 + outer
        } else if p > 0.0 || self.ff_rad_per_mps > 0.0 {
            outer
        } else {
            0.0
        }
    }

    fn margins(&self) -> Margins {
        let [from, to] = SWEEP_RADPS.map(f64::log10);
        let count = ((to - from) * POINTS) as u32;
        let at = |k: u32| C::new(0.0, 10_f64.powf(from + f64::from(k) / POINTS));
        let mut before = self.open(at(0));
        let n = self.integrators();
        // What lies below the sweep: L is all integrators there.
        let below = C::from_polar(1.0, 0.5 * n * std::f64::consts::PI) * (before + 1.0);
        let (mut turned, mut gain_db, mut phase_deg) = (below.arg(), f64::INFINITY, f64::INFINITY);
        for k in 1..=count {
            let now = self.open(at(k));
            turned += ((now + 1.0) / (before + 1.0)).arg();
            if now.im * before.im <= 0.0 && now.im != before.im {
                let share = before.im / (before.im - now.im);
                let re = before.re + share * (now.re - before.re);
                if re < 0.0 {
                    gain_db = gain_db.min((20.0 * (-re).log10()).abs());
                }
            }
            let [a, b] = [before, now].map(|l| l.norm().ln());
            if a * b <= 0.0 && a != b {
                // A quarter of a decade turns by little: the mean direction where the size is 1.
                let between = before + (now - before) * (a / (a - b));
                phase_deg = phase_deg.min((-between).arg().to_degrees().abs());
            }
            before = now;
        }
        let right_half = 0.5 * n - turned / std::f64::consts::PI;
        Margins {
            stable: right_half.abs() < 0.5,
            gain_db,
            phase_deg,
            holds: self.without_feed_forward().follows(HOLD_RADPS) >= HOLD_SHARE,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::config::Version;

    fn with(change: impl Fn(&mut ControlGains)) -> ControlConfig {
        let mut config = ControlConfig::default();
        change(&mut config.gains);
        config
    }

    #[test]
    fn prop_what_is_delivered_may_fly() {
        for version in [Version::Raw, Version::Modified] {
            for gains in [ControlGains::default(), ControlGains::designed()] {
                let config = ControlConfig { version, gains, ..ControlConfig::default() };
                for (axis, supply_v) in [(0, 8.4), (1, 8.4), (2, 8.4), (2, 7.4), (2, 6.0)] {
                    let m = margins(&config, axis, supply_v);
                    println!("{version:?} {axis} {supply_v} V: {m:?}");
                }
                assert_eq!(refusal(&config), None, "{version:?}");
            }
        }
    }

    /// Another program (a plain sweep in Python with its own complex numbers) on the same equations: raw, defaults.
    #[test]
    fn val_margins_are_those_of_another_program() {
        let raw = ControlConfig { version: Version::Raw, ..ControlConfig::default() };
        for (axis, supply_v, phase_deg, gain_db) in
            [(0, 8.4, 43.8, 11.9), (1, 8.4, 38.5, 9.1), (2, 7.4, 54.9, 15.5)]
        {
            let m = margins(&raw, axis, supply_v);
            assert!((m.phase_deg - phase_deg).abs() < 0.5, "{axis}: {m:?}");
            assert!((m.gain_db - gain_db).abs() < 0.3, "{axis}: {m:?}");
        }
    }

    #[test]
    fn regress_all_gains_off_and_all_at_their_maximum_are_refused_by_name() {
        let off = with(|g| *g = ControlGains::from_vector([0.0; 16]));
        let said = refusal(&off).unwrap();
        assert!(said.contains("control.gains.") && said.contains(" = 0 "), "{said}");
        let most = with(|g| {
            *g = ControlGains::from_vector(ControlGains::TUNABLES.map(|t| t.high));
        });
        let said = refusal(&most).unwrap();
        assert!(said.contains("control.gains.") && said.contains("unstable"), "{said}");
    }

    type Change = fn(&mut ControlGains);

    #[test]
    fn prop_the_gain_that_spoils_it_is_named() {
        let cases: [(&str, Change); 6] = [
            ("vel_x_p_rad_per_mps = 1 ", |g| g.vel_x_p_rad_per_mps = 1.0),
            ("vel_y_p_rad_per_mps = 0.9 ", |g| g.vel_y_p_rad_per_mps = 0.9),
            ("pos_y_p_per_s = 6 ", |g| g.pos_y_p_per_s = 6.0),
            ("pos_x_p_per_s = 0 ", |g| g.pos_x_p_per_s = 0.0),
            ("vel_x_i_rad_per_m = 3 ", |g| g.vel_x_i_rad_per_m = 3.0),
            ("pos_z_p_per_s = 0.02 ", |g| g.pos_z_p_per_s = 0.02),
        ];
        for (name, change) in cases {
            let said = refusal(&with(change)).unwrap_or_else(|| panic!("{name} may fly"));
            assert!(said.starts_with(&format!("control.gains.{name}")), "{said}");
        }
    }

    #[test]
    fn prop_thrust_that_cannot_climb_or_sink_is_refused() {
        let mut config = ControlConfig::default();
        config.limits.thrust_max_frac = 0.6;
        assert!(refusal(&config).unwrap().contains("thrust_max_frac = 0.6"));
        let mut config = ControlConfig::default();
        config.voltage.base_coefficients_frac = vec![0.5, -0.05];
        config.limits.thrust_min_frac = 0.5;
        assert!(refusal(&config).unwrap().contains("thrust_min_frac = 0.5"));
    }

    /// The loop itself in time, by steps of 1 ms: what the sweep calls stable converges, what it calls unstable
    /// does not.
    #[test]
    fn prop_stability_is_that_of_the_loop_in_time() {
        for (p, i, kp) in [
            (0.334, 1.12, 1.54),
            (0.2, 0.3, 1.0),
            (1.0, 1.0, 2.0),
            (0.6, 3.0, 4.0),
            (0.05, 3.0, 6.0),
        ] {
            let config = ControlConfig {
                version: Version::Raw,
                ..with(|g| {
                    (g.vel_x_p_rad_per_mps, g.vel_x_i_rad_per_m, g.pos_x_p_per_s) = (p, i, kp);
                    g.vel_x_d_rad_per_mps2 = 0.0;
                })
            };
            let (mut x, mut v, mut integral) = (1.0_f64, 0.0_f64, 0.0_f64);
            let (mut lean, mut rate) = (0.0, 0.0);
            let mut waiting = std::collections::VecDeque::from(vec![0.0; 30]);
            let mut late_m: f64 = 0.0;
            for step in 0..40_000 {
                let e = -kp * x - v;
                integral += i * e * 1e-3;
                waiting.push_back(p * e + integral);
                let wanted = waiting.pop_front().unwrap();
                rate += 1e-3 * (100.0 * (wanted - lean) - 14.0 * rate);
                lean += 1e-3 * rate;
                v += 1e-3 * (G_MPS2 * lean - 4.2 * v);
                x = (x + 1e-3 * v).clamp(-1e6, 1e6);
                if step > 35_000 {
                    late_m = late_m.max(x.abs());
                }
            }
            let m = margins(&config, 0, 7.4);
            assert_eq!(m.stable, late_m < 0.5, "{p} {i} {kp}: {m:?}, {late_m} m");
        }
    }
}
