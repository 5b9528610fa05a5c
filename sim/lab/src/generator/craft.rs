//! Constants of the generator's own healthy vehicle: another description of the same aircraft.
//!
//! Numbers are those of the published vehicle (mass, span, hover command times voltage 310 000
//! counts·V, drag fits of recorded flights, flight time of the pack); the laws they enter are the
//! generator's own. Hover thrust at command × voltage = 4.73 V, slope close to 1.

use haltere_core::frames::G_MPS2;

use super::noise::Noise;

/// Travel of the dihedral servo and of the wing-root servo, rad.
pub const SERVO_LIMIT_RAD: [f64; 2] = [0.314, 0.785];

/// The healthy vehicle.
#[derive(Debug, Clone)]
pub struct Craft {
    /// Mass that the maker states, and that figures in hover refer to, kg.
    pub stated_kg: f64,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Command times supply voltage in hover, V (recorded flights: 310 000 / 65 535).
    pub hover_command_v: f64,
    /// Flap rate in hover, Hz.
    pub hover_hz: f64,
    /// Wing centre from the middle, m.
    pub wing_m: f64,
    /// Moments of inertia, kg·m².
    pub inertia_kgm2: [f64; 3],
    /// Thrust in hover over the nominal weight.
    pub lift: f64,
    /// Exponent of thrust against flap rate.
    pub lift_exponent: f64,
    /// Quadratic friction of the gear train relative to the linear load, in hover.
    pub gear_drag: f64,
    /// Time constant of the motors under load, s: up, down.
    pub motor_s: [f64; 2],
    /// Drag at small speed along the body axes, 1/s.
    pub drag_per_s: [f64; 3],
    /// Speed at which the drag law bends, m/s.
    pub drag_bend_mps: f64,
    /// Damping of rotation, 1/s.
    pub damping_per_s: [f64; 3],
    /// Levers of the drag above the centre of mass, pitch (most of it is compensated by the bending
    /// wings) and roll, m.
    pub drag_lever_m: [f64; 2],
    /// Moment arm of thrust per sine of the dihedral, m, and forward share of thrust.
    pub pitch_arm_m: f64,
    /// Forward share of the thrust per sine of the dihedral.
    pub pitch_push: f64,
    /// Moment arm of thrust per sine of the wing-root angle, m.
    pub yaw_arm_m: f64,
    /// Servos: natural frequency (rad/s) of dihedral and wing root.
    pub servo_radps: [f64; 2],
    /// Servos: damping.
    pub servo_damping: [f64; 2],
    /// Ground effect, Cheeseman-Bennett: (R/4)², m², and height of the wings over the foot, m.
    pub cushion_m2: f64,
    /// See `cushion_m2`.
    pub wing_height_m: f64,
    /// Ohmic and polarisation resistance, Ω.
    pub resistance_ohm: [f64; 2],
    /// Time constant of the polarisation, s.
    pub polarisation_s: f64,
    /// Capacity, A·s.
    pub capacity_as: f64,
    /// Power of both motors in hover and of the electronics, W.
    pub power_w: [f64; 2],
    /// Charge at the start, 0 to 1.
    pub charge_frac: f64,
    /// Board: attitude gain (1/s) of roll, pitch, yaw.
    pub angle_per_s: [f64; 3],
    /// Board: rate gain, 1/s.
    pub rate_per_s: [f64; 3],
    /// Board: gain of its slow integrator over the proportional one, and its leak, s.
    pub hold_gain: f64,
    /// See `hold_gain`.
    pub hold_s: f64,
    /// Board: low-pass on the gyroscope, s: takes the wing beat out.
    pub gyro_s: f64,
    /// Board: lag of the motors that the roll loop leads away, and what is left, s.
    pub lead_s: [f64; 2],
    /// Board: a setpoint waits so long, s.
    pub setpoint_delay_s: f64,
    /// Linkage off: dihedral and wing root, rad.
    pub trim_rad: [f64; 2],
    /// Board: wander of its level, rad, and its correlation, s.
    pub lean_rad: f64,
    /// See `lean_rad`.
    pub lean_s: f64,
    /// Board: north against room north, rad.
    pub north_rad: f64,
    /// Shaking of the sensor mount in hover, m/s², per axis.
    pub shake_mps2: [f64; 3],
    /// Shaking of the gyroscope in hover, rad/s.
    pub shake_radps: f64,
    /// Standard deviation of a UWB reception, m.
    pub uwb_m: f64,
    /// Standard deviation of the place-dependent bias of a path, m.
    pub field_m: f64,
    /// Largest bias of a low anchor on the floor, m.
    pub floor_m: f64,
    /// Height over which that bias fades, m.
    pub floor_height_m: f64,
    /// Share of receptions lost.
    pub loss: f64,
    /// Centre of mass over the foot of the gear, m: as the companion is told.
    pub gear_m: f64,
    /// Antenna from the centre of mass, body, m: as the companion is told.
    pub antenna_B_m: [f64; 3],
}

impl Craft {
    /// The healthy vehicle.
    pub fn healthy(gear_m: f64, antenna_B_m: [f64; 3]) -> Self {
        Self {
            stated_kg: 0.102,
            mass_kg: 0.102,
            hover_command_v: 4.73,
            hover_hz: 12.75,
            wing_m: 0.08,
            inertia_kgm2: [5.6e-4, 3.4e-4, 3.6e-4],
            lift: 1.0,
            lift_exponent: 1.06,
            gear_drag: 0.04,
            motor_s: [0.082, 0.092],
            drag_per_s: [4.2, 1.95, 0.66],
            drag_bend_mps: 4.5,
            damping_per_s: [0.8, 1.0, 7.2],
            drag_lever_m: [0.003, 0.026],
            pitch_arm_m: 0.0706,
            pitch_push: 0.35,
            yaw_arm_m: 0.0288,
            servo_radps: [40.0, 10.5],
            servo_damping: [0.65, 0.72],
            cushion_m2: 0.0487,
            wing_height_m: 0.45,
            resistance_ohm: [0.12, 0.05],
            polarisation_s: 2.5,
            capacity_as: 1080.0,
            power_w: [24.2, 1.1],
            charge_frac: 0.99,
            angle_per_s: [5.0, 5.0, 2.2],
            rate_per_s: [16.5, 16.5, 11.0],
            hold_gain: 3.6,
            hold_s: 1.1,
            gyro_s: 0.005,
            lead_s: [0.078, 0.022],
            setpoint_delay_s: 0.0,
            trim_rad: [0.0; 2],
            lean_rad: 0.006,
            lean_s: 18.0,
            north_rad: 0.07,
            shake_mps2: [4.9, 17.0, 6.2],
            shake_radps: 0.13,
            uwb_m: 0.035,
            field_m: 0.035,
            floor_m: 0.48,
            floor_height_m: 0.2,
            loss: 0.01,
            gear_m,
            antenna_B_m,
        }
    }

    /// Weight of the mass that the maker states, N.
    pub fn weight_n(&self) -> f64 {
        self.stated_kg * G_MPS2
    }

    /// Changes every constant by up to ±5 %; mass and thrust by up to ±1 %, because 5 % of
    /// them would be one of the effects that are looked for.
    pub fn jittered(mut self, seed: u64) -> Self {
        const WIDE: f64 = 0.05;
        const NARROW: f64 = 0.01;
        let mut rng = Noise::new(seed, "jitter");
        let mut shake = |value: &mut f64, width: f64| *value *= 1.0 + rng.between(-width, width);
        for value in [&mut self.mass_kg, &mut self.lift] {
            shake(value, NARROW);
        }
        for value in [
            &mut self.lift_exponent,
            &mut self.gear_drag,
            &mut self.drag_bend_mps,
            &mut self.pitch_arm_m,
            &mut self.yaw_arm_m,
            &mut self.cushion_m2,
            &mut self.wing_height_m,
            &mut self.polarisation_s,
            &mut self.capacity_as,
            &mut self.hold_gain,
            &mut self.hold_s,
            &mut self.lean_rad,
            &mut self.lean_s,
            &mut self.north_rad,
            &mut self.shake_radps,
            &mut self.uwb_m,
            &mut self.field_m,
            &mut self.floor_m,
            &mut self.floor_height_m,
            &mut self.loss,
        ] {
            shake(value, WIDE);
        }
        for value in self
            .inertia_kgm2
            .iter_mut()
            .chain(&mut self.motor_s)
            .chain(&mut self.drag_per_s)
            .chain(&mut self.damping_per_s)
            .chain(&mut self.servo_radps)
            .chain(&mut self.servo_damping)
            .chain(&mut self.resistance_ohm)
            .chain(&mut self.angle_per_s)
            .chain(&mut self.rate_per_s)
            .chain(&mut self.shake_mps2)
        {
            shake(value, WIDE);
        }
        shake(&mut self.power_w[0], WIDE);
        self
    }
}
