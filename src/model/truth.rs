//! Truth: what really happens. A channel of its own; the companion never sees it.

use haltere_core::frames::{B, E, Rot, Vec3};

/// State of the world at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Time since the start of the simulation, µs.
    pub t_us: u64,
    /// Position of the centre of mass, m.
    pub pos_E_m: Vec3<E>,
    /// Velocity, m/s.
    pub vel_E_mps: Vec3<E>,
    /// Attitude.
    pub R_EB: Rot<E, B>,
    /// Angular rate, rad/s.
    pub rate_B_radps: Vec3<B>,
    /// Specific force, m/s²: at rest (0, 0, -g).
    pub acc_B_mps2: Vec3<B>,
    /// Velocity of the air at the vehicle, m/s.
    pub wind_E_mps: Vec3<E>,
    /// Foot of the landing gear over the floor, m.
    pub height_m: f64,
    /// Flap rate of left and right wing, Hz.
    pub flap_hz: [f64; 2],
    /// Dihedral, rad.
    pub dihedral_rad: f64,
    /// Wing-root angle, rad.
    pub yaw_servo_rad: f64,
    /// Thrust of both wings, N.
    pub thrust_n: f64,
    /// Supply under load, V.
    pub supply_v: f64,
    /// Current, A.
    pub current_a: f64,
    /// Charge left, 0 to 1.
    pub charge_frac: f64,
    /// Angle from room north to the north of the board, rad.
    pub board_north_rad: f64,
    /// Whether the gear touches the floor.
    pub on_ground: bool,
    /// On the floor with little thrust for half a second.
    pub landed: bool,
    /// Whether the board is armed.
    pub armed: bool,
    /// Hit the floor too fast or fell over.
    pub crashed: bool,
}
