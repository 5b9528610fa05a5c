//! Frames: vectors and rotations that carry the frame they are expressed in.
//!
//! * [`E`]: Earth, the room. **NED**, origin of the anchor survey, treated as inertial.
//! * [`B`]: body. **FRD**, origin at the centre of mass.
//! * [`U`]: survey. **ENU-like, z up**, same origin as `E`. Only surveys and foreign recordings
//!   are written in it; [`earth_from_survey`] turns them once, on load.
//!
//! Mixing frames does not compile:
//!
//! ```compile_fail
//! use haltere_core::frames::{B, E, Vec3};
//! let sum = Vec3::<E>::new(0.0, 0.0, 1.0) + Vec3::<B>::new(0.0, 0.0, 1.0);
//! ```
//!
//! ```compile_fail
//! use haltere_core::frames::{B, E, Rot, Vec3};
//! let R_EB = Rot::<E, B>::identity();
//! let wrong = R_EB * Vec3::<E>::new(1.0, 0.0, 0.0);
//! ```
//!
//! Sign flips between frames exist in this file and nowhere else.

use std::marker::PhantomData;
use std::ops::{Add, AddAssign, Index, Mul, Neg, Sub, SubAssign};

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// Standard gravity, m/s² (CGPM 1901).
pub const G_MPS2: f64 = 9.80665;

/// Earth frame: NED.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum E {}
/// Body frame: FRD.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum B {}
/// Survey frame: z up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum U {}

/// A vector expressed in frame `F`. The unit stands in the name of the variable.
pub struct Vec3<F> {
    raw: Vector3<f64>,
    frame: PhantomData<F>,
}

impl<F> Vec3<F> {
    /// From components along the axes of `F`.
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self { raw: Vector3::new(x, y, z), frame: PhantomData }
    }
    /// The zero vector.
    pub const fn zero() -> Self {
        Self::new(0.0, 0.0, 0.0)
    }
    /// Claims that `raw` is expressed in `F`.
    pub const fn from_raw(raw: Vector3<f64>) -> Self {
        Self { raw, frame: PhantomData }
    }
    /// From an array in the order x, y, z.
    pub const fn from_array(a: [f64; 3]) -> Self {
        Self::new(a[0], a[1], a[2])
    }
    /// Opens the box for matrix work.
    pub const fn raw(&self) -> Vector3<f64> {
        self.raw
    }
    /// Components in the order x, y, z.
    pub fn to_array(self) -> [f64; 3] {
        [self.raw.x, self.raw.y, self.raw.z]
    }
    /// First component.
    pub fn x(&self) -> f64 {
        self.raw.x
    }
    /// Second component.
    pub fn y(&self) -> f64 {
        self.raw.y
    }
    /// Third component.
    pub fn z(&self) -> f64 {
        self.raw.z
    }
    /// Length.
    pub fn norm(&self) -> f64 {
        self.raw.norm()
    }
    /// Scalar product.
    pub fn dot(&self, other: Self) -> f64 {
        self.raw.dot(&other.raw)
    }
    /// Vector product.
    pub fn cross(&self, other: Self) -> Self {
        Self::from_raw(self.raw.cross(&other.raw))
    }
    /// Whether no component is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.raw.iter().all(|c| c.is_finite())
    }
}

// Derives would ask `F: Clone` and so on; the frame is only a name.
impl<F> Clone for Vec3<F> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<F> Copy for Vec3<F> {}
impl<F> PartialEq for Vec3<F> {
    fn eq(&self, other: &Self) -> bool {
        self.raw == other.raw
    }
}
impl<F> Default for Vec3<F> {
    fn default() -> Self {
        Self::zero()
    }
}
impl<F> std::fmt::Debug for Vec3<F> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "[{}, {}, {}]", self.raw.x, self.raw.y, self.raw.z)
    }
}
impl<F> Add for Vec3<F> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::from_raw(self.raw + other.raw)
    }
}
impl<F> AddAssign for Vec3<F> {
    fn add_assign(&mut self, other: Self) {
        self.raw += other.raw;
    }
}
impl<F> Sub for Vec3<F> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::from_raw(self.raw - other.raw)
    }
}
impl<F> SubAssign for Vec3<F> {
    fn sub_assign(&mut self, other: Self) {
        self.raw -= other.raw;
    }
}
impl<F> Neg for Vec3<F> {
    type Output = Self;
    fn neg(self) -> Self {
        Self::from_raw(-self.raw)
    }
}
impl<F> Mul<f64> for Vec3<F> {
    type Output = Self;
    fn mul(self, scale: f64) -> Self {
        Self::from_raw(self.raw * scale)
    }
}
impl<F> Index<usize> for Vec3<F> {
    type Output = f64;
    fn index(&self, axis: usize) -> &f64 {
        &self.raw[axis]
    }
}

/// A rotation that takes a `From` vector to `To`: `v_To = R * v_From`.
pub struct Rot<To, From> {
    raw: UnitQuaternion<f64>,
    frames: PhantomData<(To, From)>,
}

impl<To, From> Rot<To, From> {
    /// The frames coincide.
    pub fn identity() -> Self {
        Self::from_raw(UnitQuaternion::identity())
    }
    /// Claims that `raw` turns `From` into `To`. Stored with w ≥ 0.
    pub fn from_raw(raw: UnitQuaternion<f64>) -> Self {
        let raw = if raw.w < 0.0 { UnitQuaternion::new_unchecked(-raw.into_inner()) } else { raw };
        Self { raw, frames: PhantomData }
    }
    /// From w, x, y, z. `None` unless finite and of length 1 within 5 %; then normalised.
    pub fn from_wxyz(q: [f64; 4]) -> Option<Self> {
        let raw = Quaternion::new(q[0], q[1], q[2], q[3]);
        let norm = raw.norm();
        (norm.is_finite() && (norm - 1.0).abs() < 0.05)
            .then(|| Self::from_raw(UnitQuaternion::from_quaternion(raw)))
    }
    /// In the order w, x, y, z, unit, w ≥ 0.
    pub fn to_wxyz(self) -> [f64; 4] {
        [self.raw.w, self.raw.i, self.raw.j, self.raw.k]
    }
    /// Opens the box.
    pub fn raw(&self) -> UnitQuaternion<f64> {
        self.raw
    }
    /// As a matrix: columns are the axes of `From` expressed in `To`.
    pub fn matrix(&self) -> Matrix3<f64> {
        *self.raw.to_rotation_matrix().matrix()
    }
    /// The other way round.
    pub fn inverse(&self) -> Rot<From, To> {
        Rot::from_raw(self.raw.inverse())
    }
    /// Roll about x, then pitch about y, then yaw about z of the `To` frame (Tait-Bryan z-y'-x''), rad.
    pub fn from_euler_rad(roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> Self {
        Self::from_raw(UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, yaw_rad))
    }
    /// Roll, pitch, yaw in rad, each in (-π, π].
    pub fn euler_rad(&self) -> [f64; 3] {
        let (roll, pitch, yaw) = self.raw.euler_angles();
        [roll, pitch, yaw]
    }
    /// Yaw alone, rad, in (-π, π]; positive clockwise seen from above when `To` is NED.
    pub fn yaw_rad(&self) -> f64 {
        let q = self.raw;
        f64::atan2(2.0 * (q.w * q.k + q.i * q.j), 1.0 - 2.0 * (q.j * q.j + q.k * q.k))
    }
}

impl<To, From> Clone for Rot<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<To, From> Copy for Rot<To, From> {}
impl<To, From> PartialEq for Rot<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.raw.into_inner() == other.raw.into_inner()
    }
}
impl<To, From> std::fmt::Debug for Rot<To, From> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?}", self.to_wxyz())
    }
}
impl<To, From> Mul<Vec3<From>> for Rot<To, From> {
    type Output = Vec3<To>;
    fn mul(self, v: Vec3<From>) -> Vec3<To> {
        Vec3::from_raw(self.raw * v.raw)
    }
}
impl<To, Mid, From> Mul<Rot<Mid, From>> for Rot<To, Mid> {
    type Output = Rot<To, From>;
    fn mul(self, other: Rot<Mid, From>) -> Rot<To, From> {
        Rot::from_raw(self.raw * other.raw)
    }
}

/// Gravity in the Earth frame, m/s².
pub const fn gravity_E_mps2() -> Vec3<E> {
    Vec3::new(0.0, 0.0, G_MPS2)
}

/// Turns a z-up survey vector into NED.
///
/// A survey's horizontal axes are x and y in a right-handed frame with z up. Room north is the
/// survey's **y** and room east its **x** when the survey is declared `enu`:
/// `north = y, east = x, down = -z`.
pub fn earth_from_survey(v_U: Vec3<U>) -> Vec3<E> {
    Vec3::new(v_U.y(), v_U.x(), -v_U.z())
}

/// The other way round, for printing and plots.
pub fn survey_from_earth(v_E: Vec3<E>) -> Vec3<U> {
    Vec3::new(v_E.y(), v_E.x(), -v_E.z())
}

/// Attitude of an FLU body (x forward, y left, z up) in a z-up world, as foreign recordings give
/// it, turned into ours: FRD body in NED.
pub fn attitude_from_flu_enu(q_U_flu: UnitQuaternion<f64>) -> Rot<E, B> {
    // E from U is the half turn about (1, 1, 0)/√2; body FRD from FLU the half turn about x.
    let turn_EU = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let turn_flu_frd = Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0);
    let m = turn_EU * q_U_flu.to_rotation_matrix().matrix() * turn_flu_frd;
    Rot::from_raw(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(m)))
}

/// Attitude given as roll (right side down), pitch (nose up) and heading (**counter-clockwise**
/// from the survey's x axis, seen from above), rad, turned into ours.
pub fn attitude_from_heading_ccw(roll_rad: f64, pitch_rad: f64, heading_rad: f64) -> Rot<E, B> {
    // The survey's x axis is room east: a quarter turn from north.
    Rot::from_euler_rad(roll_rad, pitch_rad, std::f64::consts::FRAC_PI_2 - heading_rad)
}

/// A body vector given in FLU axes, in FRD.
pub fn body_from_flu(x: f64, y: f64, z: f64) -> Vec3<B> {
    Vec3::new(x, -y, -z)
}

/// Wraps an angle to (-π, π].
pub fn wrap_pi_rad(angle_rad: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let wrapped = angle_rad - turn * (angle_rad / turn).round();
    if wrapped <= -std::f64::consts::PI { wrapped + turn } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    #[test]
    fn prop_survey_turn_is_its_own_inverse_and_keeps_handedness() {
        let v = Vec3::<U>::new(1.0, 2.0, 3.0);
        assert_eq!(survey_from_earth(earth_from_survey(v)), v);
        let x = earth_from_survey(Vec3::new(1.0, 0.0, 0.0)).raw();
        let y = earth_from_survey(Vec3::new(0.0, 1.0, 0.0)).raw();
        let z = earth_from_survey(Vec3::new(0.0, 0.0, 1.0)).raw();
        assert!((x.cross(&y) - z).norm() < 1e-15);
    }

    #[test]
    fn prop_flu_body_facing_survey_x_looks_east() {
        let R_EB = attitude_from_flu_enu(UnitQuaternion::identity());
        assert!((R_EB.yaw_rad() - FRAC_PI_2).abs() < 1e-12);
        let up = R_EB * body_from_flu(0.0, 0.0, 1.0);
        assert!((up.z() + 1.0).abs() < 1e-12);
    }

    #[test]
    fn prop_counter_clockwise_heading_turns_from_east_to_north() {
        let ahead = |heading| {
            let R_EB = attitude_from_heading_ccw(0.0, 0.0, heading);
            survey_from_earth(R_EB * Vec3::<B>::new(1.0, 0.0, 0.0)).to_array()
        };
        for (heading, [x, y]) in [(0.0, [1.0, 0.0]), (FRAC_PI_2, [0.0, 1.0])] {
            let [ax, ay, _] = ahead(heading);
            assert!((ax - x).abs() < 1e-12 && (ay - y).abs() < 1e-12);
        }
        // Nose up looks up, right side down lets the right wing point down.
        let up = attitude_from_heading_ccw(0.0, 0.1, 0.3) * Vec3::<B>::new(1.0, 0.0, 0.0);
        let down = attitude_from_heading_ccw(0.1, 0.0, 0.3) * Vec3::<B>::new(0.0, 1.0, 0.0);
        assert!(up.z() < -0.09 && down.z() > 0.09);
    }

    #[test]
    fn prop_nose_up_is_positive_pitch() {
        let R_EB = Rot::<E, B>::from_euler_rad(0.0, 0.1, 0.0);
        assert!((R_EB * Vec3::<B>::new(1.0, 0.0, 0.0)).z() < 0.0);
    }

    proptest! {
        #[test]
        fn prop_wrap_is_in_range_and_keeps_the_angle(a in -50.0f64..50.0) {
            let w = wrap_pi_rad(a);
            prop_assert!(w > -PI - 1e-12 && w <= PI + 1e-12);
            prop_assert!((w.sin() - a.sin()).abs() < 1e-9 && (w.cos() - a.cos()).abs() < 1e-9);
        }

        #[test]
        fn prop_rotation_and_inverse_cancel(r in -1.5f64..1.5, p in -1.5f64..1.5, y in -3.0f64..3.0) {
            let R_EB = Rot::<E, B>::from_euler_rad(r, p, y);
            let v = Vec3::<B>::new(0.3, -2.0, 1.1);
            prop_assert!((R_EB.inverse() * (R_EB * v) - v).norm() < 1e-12);
            prop_assert!((R_EB.yaw_rad() - y).abs() < 1e-9);
        }
    }
}
