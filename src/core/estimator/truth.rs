//! Truth for the tests of the filter: a rigid body by exact kinematics, no relation to the
//! simulator's model. Attitude and thrust are given functions of time; rate follows from them,
//! velocity and position by Runge-Kutta 4.

use nalgebra::{UnitQuaternion, Vector3};

use crate::estimator::tdoa::Geometry;
use crate::frames::{E, G_MPS2, Rot, Vec3};
use crate::measure::{AnchorId, ImuSample, Tdoa};
use crate::survey::Survey;
use crate::time::HostTime;

/// Small seeded generator (SplitMix64) with a normal deviate.
pub struct Noise(pub u64);

impl Noise {
    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
    /// Normal, one sigma.
    pub fn normal(&mut self) -> f64 {
        let r = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        r * (std::f64::consts::TAU * self.uniform()).cos()
    }
    /// Vector of normal deviates.
    pub fn vector(&mut self, scale: f64) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal()) * scale
    }
}

/// A flight: swing in roll, pitch and yaw, thrust that holds height on average.
#[derive(Clone)]
pub struct Truth {
    pub t_s: f64,
    pub x_E: Vector3<f64>,
    pub v_B: Vector3<f64>,
    /// Drag over mass, 1/s.
    pub k_per_s: [f64; 3],
    /// Amplitudes of roll, pitch, yaw, rad.
    pub swing_rad: [f64; 3],
    pub yaw_rad: f64,
    pub p_BT_B: Vector3<f64>,
}

impl Truth {
    pub fn hover(x_E: Vector3<f64>) -> Self {
        Self {
            t_s: 0.0,
            x_E,
            v_B: Vector3::zeros(),
            k_per_s: [0.0; 3],
            swing_rad: [0.0; 3],
            yaw_rad: 0.4,
            p_BT_B: Vector3::zeros(),
        }
    }

    pub fn flying(x_E: Vector3<f64>) -> Self {
        let mut truth = Self::hover(x_E);
        truth.k_per_s = [4.2, 1.8, 0.3];
        truth.swing_rad = [0.15, 0.2, 0.3];
        truth
    }

    pub fn q_EB(&self, t_s: f64) -> UnitQuaternion<f64> {
        let [roll, pitch, yaw] = self.swing_rad;
        UnitQuaternion::from_euler_angles(
            roll * (1.7 * t_s).sin(),
            pitch * (1.1 * t_s).sin(),
            self.yaw_rad + yaw * (0.5 * t_s).sin(),
        )
    }

    /// Body rate by a central difference of the attitude, exact to 1e-9.
    pub fn rate_B(&self, t_s: f64) -> Vector3<f64> {
        let h = 1e-4;
        (self.q_EB(t_s - h).inverse() * self.q_EB(t_s + h)).scaled_axis() / (2.0 * h)
    }

    /// Specific force: drag, and a thrust that carries the weight.
    pub fn force_B(&self, t_s: f64, v_B: &Vector3<f64>) -> Vector3<f64> {
        let up = self.q_EB(t_s).to_rotation_matrix().matrix()[(2, 2)];
        let [kx, ky, kz] = self.k_per_s;
        Vector3::new(-kx * v_B.x, -ky * v_B.y, -G_MPS2 / up - kz * v_B.z)
    }

    fn derivative(&self, t_s: f64, v_B: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let q = self.q_EB(t_s);
        let g_B = q.inverse_transform_vector(&Vector3::new(0.0, 0.0, G_MPS2));
        (q * v_B, self.force_B(t_s, v_B) + g_B - self.rate_B(t_s).cross(v_B))
    }

    /// One step.
    pub fn advance(&mut self, dt_s: f64) {
        let (t, v) = (self.t_s, self.v_B);
        let (x1, v1) = self.derivative(t, &v);
        let (x2, v2) = self.derivative(t + 0.5 * dt_s, &(v + v1 * (0.5 * dt_s)));
        let (x3, v3) = self.derivative(t + 0.5 * dt_s, &(v + v2 * (0.5 * dt_s)));
        let (x4, v4) = self.derivative(t + dt_s, &(v + v3 * dt_s));
        self.x_E += (x1 + x2 * 2.0 + x3 * 2.0 + x4) * (dt_s / 6.0);
        self.v_B += (v1 + v2 * 2.0 + v3 * 2.0 + v4) * (dt_s / 6.0);
        self.t_s += dt_s;
    }

    pub fn at(&self) -> HostTime {
        HostTime::from_us((self.t_s * 1e6).round() as u64 + 1_000_000)
    }

    pub fn imu(&self) -> ImuSample {
        let at = self.at();
        ImuSample {
            valid_at: at,
            received_at: at,
            acc_B_mps2: Vec3::from_raw(self.force_B(self.t_s, &self.v_B)),
            rate_B_radps: Vec3::from_raw(self.rate_B(self.t_s)),
        }
    }

    /// At rest the floor carries the weight.
    pub fn imu_at_rest(&self) -> ImuSample {
        let mut sample = self.imu();
        let q = self.q_EB(self.t_s);
        sample.acc_B_mps2 =
            Vec3::from_raw(q.inverse_transform_vector(&Vector3::new(0.0, 0.0, -G_MPS2)));
        sample.rate_B_radps = Vec3::zero();
        sample
    }

    pub fn tdoa(&self, survey: &Survey, a: u8, b: u8) -> Tdoa {
        let at = self.at();
        let p = self.x_E + self.q_EB(self.t_s) * self.p_BT_B;
        let distance = |id| (p - survey.position_E_m(AnchorId(id)).unwrap().raw()).norm();
        Tdoa {
            valid_at: at,
            received_at: at,
            anchor_a: AnchorId(a),
            anchor_b: AnchorId(b),
            distance_diff_m: distance(b) - distance(a),
            std_m: None,
        }
    }

    pub fn pose(&self) -> (Vec3<E>, Rot<E, crate::frames::B>) {
        (Vec3::from_raw(self.x_E), Rot::from_raw(self.q_EB(self.t_s)))
    }
}

/// Corners of a hall of 10 × 10 × 7 m, slightly moved so that nothing is symmetric.
pub fn hall() -> Survey {
    let anchors: Vec<_> = (0..8u8)
        .map(|i| {
            let far = |bit: u8, size: f64| if i & bit != 0 { size } else { 0.1 * f64::from(i) };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0) - 0.2))
        })
        .collect();
    Survey::new(&anchors).unwrap()
}

/// A geometry of two anchors of the hall.
pub fn geometry(a: u8, b: u8, p_BT_B: Vector3<f64>, ahead_s: f64) -> Geometry {
    let survey = hall();
    let at = |id| survey.position_E_m(AnchorId(id)).unwrap().raw();
    Geometry { a_E: at(a), b_E: at(b), p_BT_B, ahead_s }
}
