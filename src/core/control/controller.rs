//! The cascade itself.
//!
//! **Symbols.** e error, v velocity m/s, ψ estimated yaw, lean ℓ = (ℓx, ℓy) rad: tilt of the thrust
//! towards heading x (forward) and y (right). Thrust acts along −z of B, so in the heading frame
//! its horizontal parts are `−T·sin θ·cos φ` and `T·sin φ`: forward is nose **down**, `θ = −ℓx`,
//! and right is right wing down, `φ = +ℓy`.
//!
//! **Decisions.**
//! * Feed-forward takes the velocity *setpoint*, not the estimate. Fed with the estimate it would
//!   cancel the drag that damps the vehicle (positive feedback, delayed by filter and attitude).
//!   It is low-passed by `drag.filter_s`, so that a step of the setpoint arrives as a ramp of
//!   about the speed at which the velocity itself can follow.
//! * With feed-forward the velocity integrators see the setpoint through a low-pass: the lean that
//!   drag takes is already there, and the error while the velocity follows is not theirs to add up.
//!   Without it, integrators tuned for `raw` (where they carry the drag) overshoot in `modified`.
//! * Position gains act along the heading axes, because drag does; at zero yaw that is x and y of E.
//! * The lean is computed in the frame of the *estimated* yaw and turned into the frame of the yaw
//!   *setpoint* before it is sent: the setpoint is a rotation, and its thrust axis must point where
//!   the force is wanted while the yaw is still on its way.
//! * Integrators of the velocity loop live in the heading frame: what they hold (trim, centre of
//!   mass) turns with the body.
//! * The yaw setpoint stays near the present yaw: roll and pitch of an attitude that is turned far away are not
//!   those that carry the vehicle now, and a board that is asked for it leans where nobody wants it. In a turn a
//!   lean that points one way of the room goes round the body as fast as the heading turns, and the attitude
//!   lags behind it: the more it leans, the slower it turns.
//! * Anti-windup is conditional: while an output is cut, its integrator only moves back.

use crate::control::config::{ControlConfig, Enhancements, TiltCompensation};
use crate::control::filter::{Cut, Derivative, Glide, Integrator, LowPass, bounded, shortened};
use crate::control::voltage::{BaseThrust, SupplyFilter};
use crate::control::{
    AxisCommand, ControlInput, ControlOutput, Handover, HeldTilt, SupplyQuality, TiltAxis,
};
use crate::estimate::Estimate;
use crate::frames::{E, Rot, Vec3, wrap_pi_rad};
use crate::topics::ControlRecord;

/// A longer pause between two steps counts as this, s: ten periods. Integrating over more would
/// trust one sample too long.
const MAX_DT_S: f64 = 0.1;
/// Position errors are cut here, m: farther than any room, so only arithmetic is protected.
const MAX_ERROR_M: f64 = 1e4;
/// Velocities are cut here, m/s: far beyond the vehicle, so only arithmetic is protected.
const MAX_SPEED_MPS: f64 = 100.0;
/// Least cosine of tilt that compensation divides by; the limit of the factor acts long before.
const MIN_COS_TILT: f64 = 0.2;
/// The yaw setpoint is ahead of the present yaw by at most this, rad (30 degrees).
const YAW_LEAD_RAD: f64 = std::f64::consts::FRAC_PI_6;
/// In a turn the lean goes round the body no faster than this, rad/s (20 deg/s): an attitude that lags by 0.15 s is then
/// off by 3 degrees, whatever the lean.
const LEAN_SWING_RADPS: f64 = 0.35;
/// Largest lean across a held tilt, rad (10 degrees): enough to keep the line, little beside it.
const MAX_ACROSS_RAD: f64 = 0.175;

/// A yaw setpoint, kept near enough to the present yaw to be followed, rad.
pub fn within_lead_rad(wanted_rad: f64, now_rad: f64) -> f64 {
    wrap_pi_rad(now_rad + bounded(wrap_pi_rad(wanted_rad - now_rad), YAW_LEAD_RAD))
}

/// Kind of command on one axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Position,
    Velocity,
}

/// The finite part of an estimate that control needs.
struct Seen {
    pos_E_m: [f64; 3],
    vel_E_mps: [f64; 3],
    yaw_rad: f64,
    sin_yaw: f64,
    cos_yaw: f64,
    vel_B_mps: [f64; 2],
    /// Third row of R_EB: what the body axes contribute to "down".
    down_B: [f64; 3],
}

impl Seen {
    fn from(estimate: &Estimate) -> Option<Self> {
        let vel_E_mps = estimate.vel_E_mps();
        let R_EB = estimate.R_EB.matrix();
        if !(estimate.pos_E_m.is_finite()
            && vel_E_mps.is_finite()
            && estimate.vel_B_mps.is_finite()
            && R_EB.iter().all(|c| c.is_finite()))
        {
            return None;
        }
        let yaw_rad = estimate.R_EB.yaw_rad();
        let (sin_yaw, cos_yaw) = yaw_rad.sin_cos();
        let v_B = estimate.vel_B_mps;
        Some(Self {
            pos_E_m: estimate.pos_E_m.to_array(),
            vel_E_mps: vel_E_mps.to_array().map(|v| bounded(v, MAX_SPEED_MPS)),
            yaw_rad,
            sin_yaw,
            cos_yaw,
            vel_B_mps: [bounded(v_B.x(), MAX_SPEED_MPS), bounded(v_B.y(), MAX_SPEED_MPS)],
            down_B: [R_EB[(2, 0)], R_EB[(2, 1)], R_EB[(2, 2)]],
        })
    }

    /// Horizontal components, Earth to heading frame.
    fn heading_from_earth(&self, x: f64, y: f64) -> (f64, f64) {
        (self.cos_yaw * x + self.sin_yaw * y, self.cos_yaw * y - self.sin_yaw * x)
    }

    /// Horizontal components, heading to Earth frame.
    fn earth_from_heading(&self, x: f64, y: f64) -> (f64, f64) {
        (self.cos_yaw * x - self.sin_yaw * y, self.cos_yaw * y + self.sin_yaw * x)
    }
}

/// What starts anew with every take-over.
#[derive(Debug, Clone, Default)]
struct Memory {
    kinds: [Option<Kind>; 3],
    vel_setpoint_E_mps: [f64; 3],
    axis_glide: [Glide; 3],
    vertical_integral: Integrator,
    lean_integral: [Integrator; 2],
    thrust_integral: Integrator,
    thrust_cut: Cut,
    ceiling_frac: f64,
    acceleration: Derivative,
    ff_velocity: LowPass<2>,
    expected_velocity: LowPass<2>,
    yaw_setpoint_rad: Option<f64>,
    handover: Option<Handover>,
    lean_glide: [Glide; 2],
    thrust_glide: Glide,
}

/// The cascaded controller. Expects a configuration that passed its check.
#[derive(Debug, Clone)]
pub struct Controller {
    config: ControlConfig,
    on: Enhancements,
    base: BaseThrust,
    supply: SupplyFilter,
    height: LowPass<1>,
    memory: Memory,
}

impl Controller {
    /// From a checked configuration.
    pub fn new(config: ControlConfig) -> Self {
        Self {
            on: config.enhancements(),
            base: BaseThrust::new(&config.voltage),
            supply: SupplyFilter::default(),
            height: LowPass::default(),
            memory: Memory::default(),
            config,
        }
    }

    /// The configuration in force.
    pub fn config(&self) -> &ControlConfig {
        &self.config
    }

    /// Forgets integrators and setpoints. With a handover the next outputs start from it and fade
    /// to the law's own; without, the law speaks at once. Voltage and height are kept: the battery
    /// did not change hands.
    pub fn reset(&mut self, from: Option<&Handover>) {
        let finite = |h: &&Handover| {
            [h.roll_rad, h.pitch_rad, h.yaw_rad, h.thrust_frac].iter().all(|v| v.is_finite())
        };
        let handover = from.filter(finite).copied();
        self.memory = Memory {
            handover,
            ceiling_frac: self.memory.ceiling_frac,
            yaw_setpoint_rad: handover
                .map(|h| wrap_pi_rad(h.yaw_rad - self.config.trims.yaw_deg.to_radians())),
            ..Memory::default()
        };
    }

    /// Another configuration. Integrators stay; with a handover the outputs go on from it and fade to
    /// the new law.
    pub fn retune(&mut self, config: ControlConfig, from: Option<&Handover>) {
        self.on = config.enhancements();
        self.base = BaseThrust::new(&config.voltage);
        self.config = config;
        if let Some(from) = from {
            let finite = [from.roll_rad, from.pitch_rad, from.yaw_rad, from.thrust_frac]
                .iter()
                .all(|v| v.is_finite());
            self.memory.handover = finite.then_some(*from);
        }
    }

    /// Lean that the velocity integrators hold, forward and right, rad: what a trim should take
    /// over.
    pub fn lean_integral_rad(&self) -> [f64; 2] {
        [self.memory.lean_integral[0].value, self.memory.lean_integral[1].value]
    }

    /// One step of the cascade.
    pub fn step(&mut self, input: &ControlInput) -> ControlOutput {
        let dt_s = bounded(input.dt_s, MAX_DT_S).max(0.0);
        let (supply_v, supply) = self.supply.step(&self.config.voltage, input.supply_v, dt_s);
        let base_v =
            if self.on.voltage_base_thrust { supply_v } else { self.config.voltage.nominal_v };
        let mut record = ControlRecord {
            at: input.at,
            thrust_base_frac: self.base.at_frac(base_v),
            ground_factor: self.ground_factor(input.height_above_ground_m, dt_s),
            ..ControlRecord::default()
        };
        let seen = Seen::from(input.estimate);
        let yaw_rad = self.yaw_setpoint_rad(input.command.yaw_rad, seen.as_ref(), dt_s);
        let lean = match &seen {
            Some(seen) => {
                let vel_setpoint = self.position_loop(seen, input, dt_s, &mut record);
                self.velocity_loop(seen, vel_setpoint, yaw_rad, input, dt_s, &mut record)
            }
            None => self.hold_blindly(input.thrust_ceiling_frac, &mut record),
        };
        self.output(lean, yaw_rad, supply, seen.is_none(), record)
    }

    /// Position → velocity setpoint, limited, Earth frame, m/s.
    fn position_loop(
        &mut self,
        seen: &Seen,
        input: &ControlInput,
        dt_s: f64,
        record: &mut ControlRecord,
    ) -> [f64; 3] {
        let (gains, limits) = (&self.config.gains, &self.config.limits);
        let memory = &mut self.memory;
        let mut kinds = [Kind::Velocity; 3];
        let mut error_m = [0.0; 3];
        let mut wanted = [0.0; 3];
        for (axis, command) in input.command.axes.iter().enumerate() {
            match *command {
                AxisCommand::Position_m(p) if p.is_finite() => {
                    kinds[axis] = Kind::Position;
                    error_m[axis] = bounded(p - seen.pos_E_m[axis], MAX_ERROR_M);
                    record.pos_setpoint_E_m[axis] = Some(p);
                }
                AxisCommand::Velocity_mps(v) if v.is_finite() => {
                    wanted[axis] = bounded(v, MAX_SPEED_MPS);
                }
                // A command that is no number asks for nothing: stop on this axis.
                _ => {}
            }
        }
        let changed: [bool; 3] =
            std::array::from_fn(|i| memory.kinds[i].is_some_and(|before| before != kinds[i]));
        if changed[2] {
            memory.vertical_integral = Integrator::default();
        }

        let (e_x, e_y) = seen.heading_from_earth(error_m[0], error_m[1]);
        let (u_x, u_y) =
            seen.earth_from_heading(gains.pos_x_p_per_s * e_x, gains.pos_y_p_per_s * e_y);
        let u_z = gains.pos_z_p_per_s * error_m[2] + memory.vertical_integral.value;
        let damping = [gains.pos_xy_d_frac, gains.pos_xy_d_frac, gains.pos_z_d_frac];
        for (axis, u) in [u_x, u_y, u_z].into_iter().enumerate() {
            if kinds[axis] == Kind::Position {
                wanted[axis] = u + bounded(input.command.vel_ff_E_mps[axis], MAX_SPEED_MPS)
                    - damping[axis] * seen.vel_E_mps[axis];
            }
        }

        let limited = |v: [f64; 3]| {
            let (x, y, cut) = shortened(v[0], v[1], limits.horizontal_mps);
            let z = bounded(v[2], limits.vertical_mps);
            ([x, y, z], cut || z != v[2])
        };
        let (target, cut) = limited(wanted);
        for axis in 0..3 {
            if changed[axis] {
                memory.axis_glide[axis].start(memory.vel_setpoint_E_mps[axis], target[axis]);
            }
        }
        let (setpoint, glide_cut) =
            limited(std::array::from_fn(|i| target[i] + memory.axis_glide[i].offset()));
        record.saturation.velocity = cut || glide_cut;
        record.vel_setpoint_E_mps = Vec3::<E>::from_array(setpoint);

        if kinds[2] == Kind::Position && !input.integrators_frozen {
            // Down is positive here and up in the thrust.
            let cut = match Cut::between(wanted[2], target[2]) {
                Cut::No => memory.thrust_cut.flipped(),
                own => own,
            };
            let increment = gains.pos_z_i_per_s2 * error_m[2] * dt_s;
            memory.vertical_integral.add(increment, cut, limits.vertical_integral_mps);
        }
        for glide in &mut memory.axis_glide {
            glide.fade(self.config.switch_fade_s, dt_s);
        }
        memory.kinds = kinds.map(Some);
        memory.vel_setpoint_E_mps = setpoint;
        setpoint
    }

    /// Velocity setpoint → lean in the frame of the yaw setpoint, rad, and thrust (in the record).
    fn velocity_loop(
        &mut self,
        seen: &Seen,
        vel_setpoint_E_mps: [f64; 3],
        yaw_setpoint_rad: f64,
        input: &ControlInput,
        dt_s: f64,
        record: &mut ControlRecord,
    ) -> (f64, f64) {
        let gains = self.config.gains;
        let limits = self.config.limits;
        let [v_x, v_y, v_z] = seen.vel_E_mps;
        let [sp_x, sp_y, sp_z] = vel_setpoint_E_mps;
        let acc = self.memory.acceleration.step(seen.vel_E_mps, gains.vel_d_filter_s, dt_s);
        let (e_x, e_y) = seen.heading_from_earth(sp_x - v_x, sp_y - v_y);
        let e_up = v_z - sp_z;
        let (acc_x, acc_y) = seen.heading_from_earth(acc[0], acc[1]);

        // Drag feed-forward of the velocity setpoint.
        if self.memory.ff_velocity.value().is_none() {
            self.memory.ff_velocity = LowPass::starting_at([v_x, v_y]);
            self.memory.expected_velocity = LowPass::starting_at([v_x, v_y]);
        }
        let [filter_s, expected_s] = self.config.feed_forward_s();
        let [ff_x, ff_y] = self.memory.ff_velocity.step([sp_x, sp_y], filter_s, dt_s);
        let [exp_x, exp_y] = self.memory.expected_velocity.step([sp_x, sp_y], expected_s, dt_s);
        // What the integrators see.
        let (mut i_x, mut i_y) = (e_x, e_y);
        if self.on.drag_feed_forward {
            let (ff_x, ff_y) = seen.heading_from_earth(ff_x, ff_y);
            record.pitch_ff_rad = self.config.drag.pitch_ff_rad(ff_x);
            record.roll_ff_rad = self.config.drag.roll_ff_rad(ff_y);
            (i_x, i_y) = seen.heading_from_earth(exp_x - v_x, exp_y - v_y);
        }

        let memory = &mut self.memory;
        let law_x = gains.vel_x_p_rad_per_mps * e_x + memory.lean_integral[0].value
            - gains.vel_x_d_rad_per_mps2 * acc_x
            - record.pitch_ff_rad;
        let law_y = gains.vel_y_p_rad_per_mps * e_y + memory.lean_integral[1].value
            - gains.vel_y_d_rad_per_mps2 * acc_y
            + record.roll_ff_rad;
        // Down is positive in acc, up in thrust.
        record.thrust_feedback_frac = gains.vel_z_p_frac_per_mps * e_up
            + memory.thrust_integral.value
            + gains.vel_z_d_frac_per_mps2 * acc[2];
        let most = limits.tilt_compensation_max_frac;
        let (compensation, most) = match input.held {
            None => (self.on.tilt_compensation, most),
            // Height is to be held whatever the version, and the angle was checked by who asks.
            Some(held) => {
                let full = held.angle_rad.cos().max(MIN_COS_TILT).recip();
                (TiltCompensation::DragAware, most.max(full))
            }
        };
        record.tilt_factor = tilt_factor(&self.config, compensation, most, seen);
        let law_thrust = (record.thrust_base_frac + record.thrust_feedback_frac)
            * record.tilt_factor
            * record.ground_factor;

        // From the heading frame to the frame of the yaw setpoint and back.
        let (sin_ahead, cos_ahead) = (seen.yaw_rad - yaw_setpoint_rad).sin_cos();
        if let Some(from) = memory.handover.take() {
            let trims = self.config.trims;
            let x = trims.pitch_deg.to_radians() - from.pitch_rad;
            let y = from.roll_rad - trims.roll_deg.to_radians();
            memory.lean_glide[0].start(cos_ahead * x + sin_ahead * y, law_x);
            memory.lean_glide[1].start(cos_ahead * y - sin_ahead * x, law_y);
            memory.thrust_glide.start(from.thrust_frac, law_thrust);
        }
        let wanted_x = law_x + memory.lean_glide[0].offset();
        let wanted_y = law_y + memory.lean_glide[1].offset();
        let (x, y, cut) = shortened(wanted_x, wanted_y, limits.tilt_deg.to_radians());
        record.saturation.tilt = cut && input.held.is_none();
        if cut || input.held.is_some() {
            // What the setpoint promised cannot happen: expect from where we are.
            memory.expected_velocity = LowPass::starting_at([v_x, v_y]);
        }
        let wanted_thrust = law_thrust + memory.thrust_glide.offset();
        let thrust_cut = memory.limit_thrust(
            wanted_thrust,
            [limits.thrust_min_frac, limits.thrust_max_frac],
            input.thrust_ceiling_frac,
            record,
        );

        if !input.integrators_frozen {
            let limit = limits.lean_integral_deg.to_radians();
            let step_x = gains.vel_x_i_rad_per_m * i_x * dt_s;
            let step_y = gains.vel_y_i_rad_per_m * i_y * dt_s;
            let step_up = gains.vel_z_i_frac_per_m * e_up * dt_s;
            if input.held.is_none() {
                memory.lean_integral[0].add(step_x, Cut::between(wanted_x, x), limit);
                memory.lean_integral[1].add(step_y, Cut::between(wanted_y, y), limit);
            }
            memory.thrust_integral.add(step_up, thrust_cut, limits.thrust_integral_frac);
        }
        let fade_s = self.config.switch_fade_s;
        for glide in memory.lean_glide.iter_mut().chain([&mut memory.thrust_glide]) {
            glide.fade(fade_s, dt_s);
        }
        let lean = (cos_ahead * x - sin_ahead * y, cos_ahead * y + sin_ahead * x);
        let across = |lean_rad| bounded(lean_rad, MAX_ACROSS_RAD);
        match input.held {
            None => lean,
            Some(HeldTilt { axis: TiltAxis::Pitch, angle_rad }) => (-angle_rad, across(lean.1)),
            Some(HeldTilt { axis: TiltAxis::Roll, angle_rad }) => (across(lean.0), angle_rad),
        }
    }

    /// No estimate to steer by: keep what the integrators learned and nothing else.
    fn hold_blindly(&mut self, ceiling_frac: f64, record: &mut ControlRecord) -> (f64, f64) {
        let limits = self.config.limits;
        let memory = &mut self.memory;
        // The next good velocity must not be differentiated against one from before the gap.
        memory.acceleration = Derivative::default();
        record.thrust_feedback_frac = memory.thrust_integral.value;
        let wanted = (record.thrust_base_frac + record.thrust_feedback_frac) * record.ground_factor;
        let range = [limits.thrust_min_frac, limits.thrust_max_frac];
        memory.limit_thrust(wanted, range, ceiling_frac, record);
        let [x, y] = [memory.lean_integral[0].value, memory.lean_integral[1].value];
        let (x, y, cut) = shortened(x, y, limits.tilt_deg.to_radians());
        record.saturation.tilt = cut;
        (x, y)
    }

    fn output(
        &self,
        (lean_x, lean_y): (f64, f64),
        yaw_setpoint_rad: f64,
        supply: SupplyQuality,
        blind: bool,
        mut record: ControlRecord,
    ) -> ControlOutput {
        let trims = self.config.trims;
        record.roll_rad = lean_y + trims.roll_deg.to_radians();
        record.pitch_rad = -lean_x + trims.pitch_deg.to_radians();
        record.yaw_rad = wrap_pi_rad(yaw_setpoint_rad + trims.yaw_deg.to_radians());
        ControlOutput {
            R_EB: Rot::from_euler_rad(record.roll_rad, record.pitch_rad, record.yaw_rad),
            roll_rad: record.roll_rad,
            pitch_rad: record.pitch_rad,
            yaw_rad: record.yaw_rad,
            thrust_frac: record.thrust_frac,
            supply,
            blind,
            record,
        }
    }

    /// Follows the commanded yaw at a limited rate, the short way round, and no farther ahead of the present yaw than
    /// can be followed. Starts at the present yaw.
    fn yaw_setpoint_rad(&mut self, command_rad: f64, seen: Option<&Seen>, dt_s: f64) -> f64 {
        let from = self.memory.yaw_setpoint_rad.or(seen.map(|s| s.yaw_rad));
        let Some(from) = from else { return 0.0 };
        let turn = if command_rad.is_finite() { wrap_pi_rad(command_rad - from) } else { 0.0 };
        let sin_lean = seen.map_or(0.0, |s| s.down_B[0].hypot(s.down_B[1]));
        let most_radps =
            self.config.limits.yaw_rate_degps.to_radians().min(LEAN_SWING_RADPS / sin_lean);
        let wanted = wrap_pi_rad(from + bounded(turn, most_radps * dt_s));
        let yaw = seen.map_or(wanted, |s| within_lead_rad(wanted, s.yaw_rad));
        self.memory.yaw_setpoint_rad = Some(yaw);
        yaw
    }

    /// Ground factor at the low-passed height. A height that is no number changes nothing.
    fn ground_factor(&mut self, height_m: f64, dt_s: f64) -> f64 {
        let ground = &self.config.ground;
        let height = if height_m.is_finite() {
            let bounded_m = bounded(height_m, MAX_ERROR_M);
            Some(self.height.step([bounded_m], ground.filter_s, dt_s))
        } else {
            self.height.value()
        };
        match height {
            Some([h]) if self.on.ground_correction => ground.thrust_factor(h),
            _ => 1.0,
        }
    }
}

impl Memory {
    /// Limits the thrust, writes it and its flags to the record; says on which side it was cut.
    fn limit_thrust(
        &mut self,
        wanted_frac: f64,
        [least_frac, most_frac]: [f64; 2],
        ceiling_frac: f64,
        record: &mut ControlRecord,
    ) -> Cut {
        if ceiling_frac.is_finite() {
            self.ceiling_frac = ceiling_frac.clamp(0.0, 1.0);
        }
        let most = most_frac.min(self.ceiling_frac);
        let thrust = wanted_frac.clamp(least_frac.min(most), most);
        let cut = Cut::between(wanted_frac, thrust);
        record.thrust_frac = thrust;
        record.saturation.thrust_high = cut == Cut::Above;
        record.saturation.thrust_low = cut == Cut::Below;
        self.thrust_cut = cut;
        cut
    }
}

/// Factor on thrust for the present tilt.
///
/// Drag acts along the body axes, so in the balance of the vertical, with `f` for thrust over
/// weight and R for R_EB: `R33·f = 1 − R31·k_x·u/g − R32·k_y·v/g`, where the law of drag gives
/// `k·u/g = tan(lean(u))`. At rest this is the geometric `1/(cos φ·cos θ)`. In steady forward
/// flight it is `cos θ`: a part of the weight then hangs on the drag, and the geometric factor
/// would be a third too large at 30°. Taken at the estimated attitude, which has the lag that
/// the lift has. Vertical drag (0.65 1/s) is left to the feedback.
fn tilt_factor(config: &ControlConfig, kind: TiltCompensation, most: f64, seen: &Seen) -> f64 {
    let [r31, r32, r33] = seen.down_B;
    let hanging = match kind {
        TiltCompensation::Off => return 1.0,
        TiltCompensation::Geometric => 0.0,
        TiltCompensation::DragAware => {
            let [u, v] = seen.vel_B_mps;
            r31 * config.drag.lean_rad(0, u).tan() + r32 * config.drag.lean_rad(1, v).tan()
        }
    };
    let factor = (1.0 - hanging) / r33.max(MIN_COS_TILT);
    if factor.is_nan() { 1.0 } else { factor.clamp(1.0 / most, most) }
}
