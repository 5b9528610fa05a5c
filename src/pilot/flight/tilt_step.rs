//! Angle steps: one tilt held for a while, height held meanwhile, ended before the fence.
//!
//! What a vehicle does with a constant lean tells its drag: it gathers speed until drag balances the
//! lean. The horizontal position loop is open on the tilted axis only, so the step knows at every
//! moment whether it could still stop inside the volume, and ends when it could only just.
//!
//! **Equations.** Speed after t seconds of a lean θ: `v = v_f·(1 − e^(−k·t))`, v_f from the drag law
//! of `control.drag`, `k = g·tan θ/v_f`. Way to stop from v: `s = v·t_r + v²/(2·a)`, with the time
//! t_r that attitude and wings need to lean the other way and the deceleration a. Thrust that
//! carries the weight at rest under that lean: `base(V)/cos θ`; 52° needs 1.62 of the hover.

use haltere_core::control::TiltAxis;
use haltere_core::control::config::ControlConfig;
use haltere_core::control::drag::{DragConfig, TESTED_LEAN_DEG};
use haltere_core::control::voltage::BaseThrust;
use haltere_core::estimate::Health;
use haltere_core::frames::{E, G_MPS2, Vec3};
use haltere_core::time::HostTime;

use super::fence::Fence;
use super::guidance::Now;
use super::mission::Volume;
use crate::config::PilotConfig;

/// Least angle of a step, degrees: below it the loops' own wander is larger.
const LEAST_DEG: f64 = 1.0;
/// Shortest and longest step, s: attitude alone needs 0.2 s; 10 s at 1 m/s is a room.
const HOLD_S: [f64; 2] = [0.3, 10.0];
/// Time until a lean the other way decelerates, s: attitude and wings (`val_steps_stop_inside` flies
/// every angle up to 52° in the simulated hall and measures what is left).
const REACT_S: f64 = 0.35;
/// Deceleration that is counted on from then, m/s²: half of what a tilt of 45° gives; drag helps.
const BRAKE_MPS2: f64 = 5.0;
/// The step ends where stopping would leave this much to the fence, m: the error of the estimate
/// near a wall, three sigma of 0.1 m, and half a wing span.
const MARGIN_M: f64 = 0.5;
/// A step that the room ends sooner than this tells little about drag, s: about two time constants
/// forward, one and a half sideways.
const USEFUL_S: f64 = 0.8;
/// Speed under which a step may begin, m/s, for how long, and how long it is waited for, s. The
/// estimate of version `raw` alone wanders by 0.3 m/s at rest.
const REST_MPS: f64 = 0.5;
const REST_FOR_S: f64 = 0.5;
const REST_WITHIN_S: f64 = 6.0;
/// Height may change by this much before the step is broken off, m: beyond, the thrust reserve was
/// not there.
const HEIGHT_LOST_M: f64 = 0.6;
/// Braking aims this far ahead of the speed, s: the lag of the velocity loop.
const AIM_S: f64 = 0.4;
/// Longest braking, s.
const BRAKE_S: f64 = 5.0;

/// One angle step, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltStep {
    /// About which axis.
    pub axis: TiltAxis,
    /// Roll positive right side down, pitch positive nose up, rad.
    pub angle_rad: f64,
    /// How long, s.
    pub duration_s: f64,
    /// Ends when this far from where it began, m.
    pub distance_m: Option<f64>,
    /// Whether it may go beyond `control.limits.tilt_deg`.
    pub beyond_limit: bool,
}

/// What steps are checked against: the room and what the vehicle can do.
#[derive(Debug, Clone, PartialEq)]
pub struct Envelope {
    /// Where setpoints may lie.
    pub volume: Volume,
    tilt_limit_rad: f64,
    thrust_max_frac: f64,
    base: BaseThrust,
    full_v: f64,
    drag: DragConfig,
    /// Below this voltage the vehicle lands, V.
    pub battery_critical_v: f64,
}

impl Envelope {
    /// Largest lean of position control, `control.limits.tilt_deg`, degrees.
    pub fn tilt_limit_deg(&self) -> f64 {
        self.tilt_limit_rad.to_degrees()
    }

    /// For this volume under this configuration.
    pub fn new(volume: Volume, control: &ControlConfig, battery_critical_v: f64) -> Self {
        Self {
            volume,
            tilt_limit_rad: control.limits.tilt_deg.to_radians(),
            thrust_max_frac: control.limits.thrust_max_frac,
            base: BaseThrust::new(&control.voltage),
            full_v: control.voltage.highest_v(),
            drag: control.drag,
            battery_critical_v,
        }
    }

    /// The same for a configuration and its anchors.
    pub fn of(config: &PilotConfig, survey: &haltere_core::survey::Survey) -> Self {
        let volume = config.limits.volume(survey);
        Self::new(volume, &config.control, config.limits.battery_critical_v)
    }

    /// Speed that a lean ends at and the rate at which it is approached, by the drag law.
    pub fn approach(&self, axis: TiltAxis, lean_rad: f64) -> (f64, f64) {
        let heading_axis = usize::from(axis == TiltAxis::Roll);
        let final_mps = self.drag.speed_mps(heading_axis, lean_rad.abs()).clamp(0.05, 20.0);
        (final_mps, G_MPS2 * lean_rad.abs().tan() / final_mps)
    }

    /// Way that a step of this length takes from rest to rest, fence margins not counted, m.
    pub fn way_m(&self, axis: TiltAxis, lean_rad: f64, hold_s: f64) -> f64 {
        let (final_mps, rate) = self.approach(axis, lean_rad);
        let share = 1.0 - (-rate * hold_s).exp();
        final_mps * (hold_s - share / rate) + stopping_m(final_mps * share)
    }
}

/// Way to stop from this speed, m.
pub fn stopping_m(speed_mps: f64) -> f64 {
    speed_mps * REACT_S + speed_mps * speed_mps / (2.0 * BRAKE_MPS2)
}

impl TiltStep {
    /// From the numbers of a mission item: axis 0 roll, 1 pitch; angle in degrees; longest time in s;
    /// flag 1: beyond the tilt limit; distance in m, none if it is not positive.
    pub fn from_params(
        [axis, angle_deg, duration_s, flag]: [f64; 4],
        distance_m: f64,
    ) -> Result<Self, String> {
        let axis = if axis == 0.0 {
            TiltAxis::Roll
        } else if axis == 1.0 {
            TiltAxis::Pitch
        } else {
            return Err(format!("axis = {axis}, allowed 0 roll, 1 pitch"));
        };
        if !(LEAST_DEG..=TESTED_LEAN_DEG).contains(&angle_deg.abs()) {
            return Err(format!(
                "angle = {angle_deg}, allowed {LEAST_DEG} to {TESTED_LEAN_DEG} deg to either side"
            ));
        }
        let [shortest, longest] = HOLD_S;
        if !(shortest..=longest).contains(&duration_s) {
            return Err(format!("duration = {duration_s}, allowed {shortest} to {longest} s"));
        }
        let beyond_limit = if flag == 1.0 {
            true
        } else if flag == 0.0 || flag.is_nan() {
            false
        } else {
            return Err(format!("flag = {flag}, allowed 0, or 1 for beyond the tilt limit"));
        };
        Ok(Self {
            axis,
            angle_rad: angle_deg.to_radians(),
            duration_s,
            distance_m: (distance_m > 0.0).then_some(distance_m),
            beyond_limit,
        })
    }

    /// As people call it.
    pub fn name(&self) -> String {
        let axis = match self.axis {
            TiltAxis::Roll => "roll",
            TiltAxis::Pitch => "pitch",
        };
        format!("{axis} {:+.1} deg", self.angle_deg())
    }

    fn angle_deg(&self) -> f64 {
        self.angle_rad.to_degrees()
    }

    /// Whether this vehicle can fly it in this room at all: full battery, the longer side of the
    /// room. The error is a sentence.
    pub fn check(&self, envelope: &Envelope) -> Result<(), String> {
        let volume = &envelope.volume;
        let side = |[low, high]: [f64; 2]| high - low;
        let room_m = side(volume.north_m).max(side(volume.east_m)) - 2.0 * MARGIN_M;
        self.check_limit(envelope)?;
        self.check_way(envelope, room_m, "the longer side of the volume less margins")?;
        self.check_thrust(envelope, envelope.full_v)
    }

    /// Whether the way to the fence in the direction of flight, m, is enough.
    pub fn check_from(&self, envelope: &Envelope, way_m: f64) -> Result<(), String> {
        self.check_way(envelope, way_m - MARGIN_M, "the way to the fence less margin")
    }

    fn check_limit(&self, envelope: &Envelope) -> Result<(), String> {
        let limit_rad = envelope.tilt_limit_rad;
        if self.angle_rad.abs() > limit_rad + 1e-9 && !self.beyond_limit {
            return Err(format!(
                "{:.1} deg is beyond control.limits.tilt_deg = {:.1}; `beyond_limit` allows up to \
                 {TESTED_LEAN_DEG} deg for this step alone",
                self.angle_deg(),
                limit_rad.to_degrees()
            ));
        }
        Ok(())
    }

    fn check_way(&self, envelope: &Envelope, way_m: f64, what: &str) -> Result<(), String> {
        let hold_s = self.duration_s.min(USEFUL_S);
        let needed_m = envelope.way_m(self.axis, self.angle_rad, hold_s);
        if needed_m > way_m {
            return Err(format!(
                "{:.1} deg for {hold_s:.1} s and braking take {needed_m:.1} m, {what}: {way_m:.1} m; \
                 begin farther from the fence, or fly a smaller angle",
                self.angle_deg()
            ));
        }
        Ok(())
    }

    fn check_thrust(&self, envelope: &Envelope, supply_v: f64) -> Result<(), String> {
        let factor = self.angle_rad.cos().recip();
        let needed_frac = envelope.base.at_frac(supply_v) * factor;
        if needed_frac > envelope.thrust_max_frac {
            return Err(format!(
                "{:.1} deg needs {factor:.2} times the hover thrust, {needed_frac:.3} of full \
                 throttle at {supply_v:.2} V, control.limits.thrust_max_frac allows {:.3}; fuller \
                 battery, smaller angle, or a higher limit",
                self.angle_deg(),
                envelope.thrust_max_frac
            ));
        }
        Ok(())
    }
}

/// What a step asks for in one control step.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Progress {
    /// Stay at the carrot.
    Wait,
    /// Hold the tilt; the carrot is where stopping would end.
    Hold(Vec3<E>),
    /// Brake towards this point.
    Brake(Vec3<E>),
    /// Done.
    Done,
    /// Not flown, for this reason.
    Refused(String),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Settle { since: HostTime, calm_since: Option<HostTime> },
    Hold { since: HostTime, from_E_m: Vec3<E> },
    Brake { since: HostTime },
}

/// A step under way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TiltRun {
    phase: Phase,
}

/// Why a hold ended before its time.
pub(crate) type EndedBecause = Option<String>;

impl TiltRun {
    pub fn new(at: HostTime) -> Self {
        Self { phase: Phase::Settle { since: at, calm_since: None } }
    }

    /// Where the hold began, north and east, m.
    pub fn start_NE_m(&self) -> Option<[f64; 2]> {
        match self.phase {
            Phase::Hold { from_E_m, .. } => Some([from_E_m.x(), from_E_m.y()]),
            _ => None,
        }
    }

    /// One control step. `supply_v` is the newest voltage, if there is one.
    pub fn step(
        &mut self,
        step: &TiltStep,
        envelope: &Envelope,
        now: &Now<'_>,
    ) -> (Progress, EndedBecause) {
        let Now { estimate, at, fence, .. } = *now;
        let vel = estimate.vel_E_mps();
        let speed_mps = vel.x().hypot(vel.y());
        let pos = estimate.pos_E_m;
        let aim = |z_m: f64| {
            let ahead = pos + vel * AIM_S;
            envelope.volume.clamp(Vec3::new(ahead.x(), ahead.y(), z_m))
        };
        match self.phase {
            Phase::Settle { since, mut calm_since } => {
                if speed_mps > REST_MPS {
                    calm_since = None;
                }
                let calm_s = at.seconds_since(*calm_since.get_or_insert(at));
                self.phase = Phase::Settle { since, calm_since };
                if calm_s < REST_FOR_S {
                    if at.seconds_since(since) > REST_WITHIN_S {
                        let why = format!(
                            "still {speed_mps:.2} m/s after {REST_WITHIN_S} s, at most {REST_MPS}"
                        );
                        return (Progress::Refused(why), None);
                    }
                    return (Progress::Wait, None);
                }
                if let Err(why) = step.may_begin(envelope, now) {
                    return (Progress::Refused(why), None);
                }
                self.phase = Phase::Hold { since: at, from_E_m: pos };
                (Progress::Hold(aim(pos.z())), None)
            }
            Phase::Hold { since, from_E_m } => {
                let gone = pos - from_E_m;
                let gone_m = gone.x().hypot(gone.y());
                let way_m = way_to_fence_m(&envelope.volume, fence, pos, [vel.x(), vel.y()]);
                let because = if at.seconds_since(since) >= step.duration_s
                    || step.distance_m.is_some_and(|most_m| gone_m >= most_m)
                {
                    Some(None)
                } else if way_m - MARGIN_M <= stopping_m(speed_mps) {
                    Some(Some(format!(
                        "ended by the fence after {:.2} s, {gone_m:.1} m, at {speed_mps:.1} m/s",
                        at.seconds_since(since)
                    )))
                } else if gone.z().abs() > HEIGHT_LOST_M {
                    Some(Some(format!(
                        "broken off: height changed by {:.2} m, at most {HEIGHT_LOST_M} m",
                        -gone.z()
                    )))
                } else if !matches!(estimate.health, Health::Good | Health::Degraded) {
                    Some(Some("broken off: no good estimate".to_owned()))
                } else {
                    None
                };
                let Some(because) = because else {
                    return (Progress::Hold(aim(from_E_m.z())), None);
                };
                self.phase = Phase::Brake { since: at };
                (Progress::Brake(aim(from_E_m.z())), because)
            }
            Phase::Brake { since } => {
                let braking_s = at.seconds_since(since);
                let calm = braking_s > REST_FOR_S && speed_mps < REST_MPS;
                (if calm || braking_s > BRAKE_S { Progress::Done } else { Progress::Wait }, None)
            }
        }
    }
}

impl TiltStep {
    fn may_begin(&self, envelope: &Envelope, now: &Now<'_>) -> Result<(), String> {
        let Now { estimate, supply_v, fence, .. } = *now;
        self.check_limit(envelope)?;
        let supply_v = supply_v.ok_or("no battery voltage: thrust reserve unknown")?;
        self.check_thrust(envelope, supply_v)?;
        let towards = self.direction(estimate.R_EB.yaw_rad());
        self.check_from(
            envelope,
            way_to_fence_m(&envelope.volume, fence, estimate.pos_E_m, towards),
        )
    }

    /// Direction of flight in the room for a heading, north and east.
    pub fn direction(&self, yaw_rad: f64) -> [f64; 2] {
        let (sin_yaw, cos_yaw) = yaw_rad.sin_cos();
        let side = self.angle_rad.signum();
        match self.axis {
            TiltAxis::Pitch => [-side * cos_yaw, -side * sin_yaw],
            TiltAxis::Roll => [-side * sin_yaw, side * cos_yaw],
        }
    }
}

/// Way along a horizontal direction to the edge of the volume or to what the fence forbids, m; infinite
/// without a direction.
fn way_to_fence_m(volume: &Volume, fence: &Fence, pos_E_m: Vec3<E>, towards: [f64; 2]) -> f64 {
    let length = towards[0].hypot(towards[1]);
    if length.is_nan() || length <= 1e-6 {
        return f64::INFINITY;
    }
    let mut way_m = f64::INFINITY;
    for (axis, part) in towards.into_iter().enumerate() {
        let share = part.abs() / length;
        if share > 1e-3 {
            way_m = way_m.min(volume.way_to_edge_m(axis, pos_E_m[axis], part) / share);
        }
    }
    fence.way_m([pos_E_m.x(), pos_E_m.y()], towards.map(|part| part / length), way_m)
}
