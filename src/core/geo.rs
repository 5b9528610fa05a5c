//! The room on the globe: local NED to WGS-84 latitude, longitude and height, both ways.
//!
//! Two exact steps by way of Earth-centred, Earth-fixed (ECEF) coordinates, not a flat map:
//!
//! ```text
//! ecef(φ, λ, h) = ( (N+h)·cos φ·cos λ,  (N+h)·cos φ·sin λ,  (N·(1−e²)+h)·sin φ )
//! N = a / √(1 − e²·sin² φ)
//! n = T(φ0, λ0) · (ecef(point) − ecef(origin))      true north, true east, down
//! room = Rz(−ψ) · n                                  room north, room east, down
//! ```
//!
//! Symbols: φ geodetic latitude, λ longitude, rad; h height above the ellipsoid, m; a semi-major
//! axis, m; e² first eccentricity squared; T rotation from ECEF to true north, east, down at the
//! origin; ψ angle from true north to room north, rad, positive clockwise from above.
//! The way back solves φ by Bowring's iteration.
//!
//! Sources: NIMA TR8350.2, "Department of Defense World Geodetic System 1984", third edition,
//! sections 3 and 4 (constants, geodetic to ECEF); B. R. Bowring, "Transformation from spatial to
//! geographical coordinates", Survey Review 23 (1976).
//!
//! Validity: everywhere but within 100 m of a pole. On the wire angles are counted in 1e-7 deg,
//! 1.1 cm of latitude: a round trip over MAVLink is no better than that. Height here is "above the
//! origin plus the origin's height": down is straight, so 100 m from the origin it differs from
//! the ellipsoid's by 0.8 mm. Geoid undulation is left out: the origin's height is whatever its
//! user calls sea level.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::frames::{E, Vec3, wrap_pi_rad};

/// Semi-major axis, m (TR8350.2, table 3.1).
const A_M: f64 = 6_378_137.0;
/// Flattening (TR8350.2, table 3.1: 1/f = 298.257223563).
const F: f64 = 1.0 / 298.257_223_563;
/// First eccentricity squared: f·(2 − f).
const E2: f64 = F * (2.0 - F);
/// MAVLink's unit of angles on the globe: 1e-7 deg.
const E7: f64 = 1e7;
/// Closest that an origin may be to a pole, rad: 100 m. Beyond, east has no direction.
const POLE_RAD: f64 = 100.0 / A_M;
/// Bowring's iteration doubles its digits; from the sphere's latitude three rounds reach 1e-12 rad
/// for all heights up to 100 km. One more costs nothing.
const ROUNDS: usize = 4;

/// A place on the globe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geodetic {
    /// Latitude, rad, north positive.
    pub lat_rad: f64,
    /// Longitude, rad, east positive.
    pub lon_rad: f64,
    /// Height above the ellipsoid (or what its user calls sea level), m.
    pub alt_m: f64,
}

impl Geodetic {
    /// From degrees. `None`: not finite, or not on the globe.
    pub fn from_deg(lat_deg: f64, lon_deg: f64, alt_m: f64) -> Option<Self> {
        let on_globe = (-90.0..=90.0).contains(&lat_deg)
            && (-180.0..=180.0).contains(&lon_deg)
            && alt_m.is_finite();
        on_globe.then(|| Self {
            lat_rad: lat_deg.to_radians(),
            lon_rad: lon_deg.to_radians(),
            alt_m,
        })
    }

    /// From the wire: 1e-7 deg. `None`: not on the globe.
    pub fn from_e7(lat_e7: i32, lon_e7: i32, alt_m: f64) -> Option<Self> {
        Self::from_deg(f64::from(lat_e7) / E7, f64::from(lon_e7) / E7, alt_m)
    }

    /// Latitude and longitude for the wire: 1e-7 deg, rounded to the nearest.
    pub fn to_e7(&self) -> [i32; 2] {
        // A cast from float saturates, and angles on the globe fit.
        [self.lat_rad, self.lon_rad].map(|rad| (rad.to_degrees() * E7).round() as i32)
    }

    fn ecef_m(&self) -> [f64; 3] {
        let (sin_lat, cos_lat) = self.lat_rad.sin_cos();
        let (sin_lon, cos_lon) = self.lon_rad.sin_cos();
        let n_m = A_M / (1.0 - E2 * sin_lat * sin_lat).sqrt();
        let across_m = (n_m + self.alt_m) * cos_lat;
        [across_m * cos_lon, across_m * sin_lon, (n_m * (1.0 - E2) + self.alt_m) * sin_lat]
    }

    fn from_ecef_m([x, y, z]: [f64; 3]) -> Self {
        let across = x.hypot(y);
        let b = A_M * (1.0 - F);
        let e2_second = E2 / (1.0 - E2);
        // Reduced latitude of the sphere through the point, then Bowring.
        let mut beta = (z * A_M).atan2(across * b);
        let mut lat_rad = 0.0;
        for _ in 0..ROUNDS {
            let (s, c) = beta.sin_cos();
            lat_rad = (z + e2_second * b * s * s * s).atan2(across - E2 * A_M * c * c * c);
            let (s, c) = lat_rad.sin_cos();
            beta = ((1.0 - F) * s).atan2(c);
        }
        let (s, c) = lat_rad.sin_cos();
        // Well conditioned at every latitude, unlike across/cos φ − N.
        let alt_m = across * c + z * s - A_M * (1.0 - E2 * s * s).sqrt();
        Self { lat_rad, lon_rad: y.atan2(x), alt_m }
    }
}

/// Where the room's origin lies and which way its north points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalOrigin {
    place: Geodetic,
    room_north_rad: f64,
    ecef_m: [f64; 3],
}

impl LocalOrigin {
    /// `room_north_rad`: from true north to room north, rad, positive clockwise from above.
    /// `None`: not a number, not on the globe, or too near a pole.
    pub fn new(place: Geodetic, room_north_rad: f64) -> Option<Self> {
        let usable = place.lat_rad.abs() <= FRAC_PI_2 - POLE_RAD
            && place.lon_rad.abs() <= PI
            && place.alt_m.abs() <= MOST_ALT_M
            && room_north_rad.is_finite();
        usable.then(|| Self {
            place,
            room_north_rad: wrap_pi_rad(room_north_rad),
            ecef_m: place.ecef_m(),
        })
    }

    /// On the equator, where Greenwich's meridian crosses it: always possible.
    pub fn zero() -> Self {
        let place = Geodetic { lat_rad: 0.0, lon_rad: 0.0, alt_m: 0.0 };
        Self { place, room_north_rad: 0.0, ecef_m: place.ecef_m() }
    }

    /// The place of the origin.
    pub fn place(&self) -> Geodetic {
        self.place
    }

    /// From true north to room north, rad, positive clockwise from above.
    pub fn room_north_rad(&self) -> f64 {
        self.room_north_rad
    }

    /// A place on the globe in the room.
    pub fn to_local(&self, place: &Geodetic) -> Vec3<E> {
        let there = place.ecef_m();
        let d: [f64; 3] = std::array::from_fn(|i| there[i] - self.ecef_m[i]);
        let rows = self.true_ned_rows();
        let [north, east, down] = rows.map(|row| row[0] * d[0] + row[1] * d[1] + row[2] * d[2]);
        let (s, c) = self.room_north_rad.sin_cos();
        Vec3::new(c * north + s * east, c * east - s * north, down)
    }

    /// A position in the room on the globe.
    pub fn to_global(&self, pos_E_m: Vec3<E>) -> Geodetic {
        let true_ned = self.to_true_north(pos_E_m);
        let rows = self.true_ned_rows();
        Geodetic::from_ecef_m(std::array::from_fn(|i| {
            self.ecef_m[i] + (0..3).map(|k| rows[k][i] * true_ned[k]).sum::<f64>()
        }))
    }

    /// A vector of the room, say a velocity, along true north, true east and down.
    pub fn to_true_north(&self, v_E: Vec3<E>) -> [f64; 3] {
        let (s, c) = self.room_north_rad.sin_cos();
        [c * v_E.x() - s * v_E.y(), s * v_E.x() + c * v_E.y(), v_E.z()]
    }

    /// A vector along true north, true east and down in the room.
    pub fn from_true_north(&self, [north, east, down]: [f64; 3]) -> Vec3<E> {
        let (s, c) = self.room_north_rad.sin_cos();
        Vec3::new(c * north + s * east, c * east - s * north, down)
    }

    /// A yaw from room north as one from true north, rad.
    pub fn true_yaw_rad(&self, yaw_rad: f64) -> f64 {
        wrap_pi_rad(yaw_rad + self.room_north_rad)
    }

    /// A yaw from true north as one from room north, rad.
    pub fn room_yaw_rad(&self, true_yaw_rad: f64) -> f64 {
        wrap_pi_rad(true_yaw_rad - self.room_north_rad)
    }

    /// Unit vectors of true north, true east and down at the origin, in ECEF.
    fn true_ned_rows(&self) -> [[f64; 3]; 3] {
        let (sin_lat, cos_lat) = self.place.lat_rad.sin_cos();
        let (sin_lon, cos_lon) = self.place.lon_rad.sin_cos();
        [
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [-sin_lon, cos_lon, 0.0],
            [-cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat],
        ]
    }
}

/// Highest and, negated, lowest origin, m: from the Dead Sea's floor to an airliner, with room.
const MOST_ALT_M: f64 = 20_000.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn origin(lat_deg: f64, lon_deg: f64, alt_m: f64, north_deg: f64) -> LocalOrigin {
        let place = Geodetic::from_deg(lat_deg, lon_deg, alt_m).unwrap();
        LocalOrigin::new(place, north_deg.to_radians()).unwrap()
    }

    /// Axes of the ellipsoid: the equator is 6378137 m from the centre, the pole 6356752.3142 m
    /// (TR8350.2, table 3.3).
    #[test]
    fn val_ellipsoid_axes() {
        let at = |lat, lon| Geodetic::from_deg(lat, lon, 0.0).unwrap().ecef_m();
        assert_eq!(at(0.0, 0.0)[0], A_M);
        assert!((at(90.0, 0.0)[2] - 6_356_752.314_2).abs() < 1e-4);
        assert!((at(0.0, 90.0)[1] - A_M).abs() < 1e-9);
    }

    /// Arcs against the radii of curvature, which the conversion does not use: in the meridian
    /// M = a·(1−e²)/(1−e²·sin²φ)^1.5, in the parallel N·cos φ (TR8350.2, section 4).
    #[test]
    fn prop_arcs_are_as_long_as_the_radii_of_curvature_say() {
        for lat_deg in [0.0_f64, 30.0, 45.0, -60.0, 80.0] {
            let room = origin(lat_deg, 7.0, 0.0, 0.0);
            let place = |lat, lon| room.to_local(&Geodetic::from_deg(lat, lon, 0.0).unwrap());
            let step_rad = 1e-3_f64.to_radians();
            let w = 1.0 - E2 * lat_deg.to_radians().sin().powi(2);
            let north = place(lat_deg + 0.0005, 7.0).x() - place(lat_deg - 0.0005, 7.0).x();
            let meridian = A_M * (1.0 - E2) / w.powf(1.5) * step_rad;
            assert!((north - meridian).abs() < 1e-5, "{lat_deg}: {north} {meridian}");
            let east = place(lat_deg, 7.0005).y() - place(lat_deg, 6.9995).y();
            let parallel = A_M / w.sqrt() * lat_deg.to_radians().cos() * step_rad;
            assert!((east - parallel).abs() < 1e-5, "{lat_deg}: {east} {parallel}");
        }
    }

    #[test]
    fn prop_there_and_back() {
        for (lat, lon, alt, turn) in [
            (47.397_742, 8.545_594, 0.0, 0.0),
            (-33.9, 151.2, 58.0, 33.0),
            (0.0, 0.0, -400.0, -120.0),
            (89.9, 179.999_99, 4000.0, 180.0),
            (-89.9, -180.0, 0.0, 90.0),
        ] {
            let room = origin(lat, lon, alt, turn);
            for p in [[0.0, 0.0, 0.0], [3.0, -4.0, -1.5], [-90.0, 80.0, 0.3], [900.0, 900.0, -50.0]]
            {
                let pos = Vec3::<E>::from_array(p);
                let back = room.to_local(&room.to_global(pos));
                assert!((back - pos).norm() < 1e-8, "{lat} {lon}: {p:?} became {back:?}");
            }
        }
    }

    #[test]
    fn prop_the_wire_costs_less_than_a_centimetre_per_axis() {
        let room = origin(47.4, 8.5, 500.0, 20.0);
        let pos = Vec3::<E>::new(3.21, -1.07, -1.5);
        let place = room.to_global(pos);
        let [lat, lon] = place.to_e7();
        let back = room.to_local(&Geodetic::from_e7(lat, lon, place.alt_m).unwrap());
        assert!((back - pos).norm() < 0.008, "{back:?}");
    }

    #[test]
    fn prop_signs_and_the_turn_of_the_room() {
        // Room north points to true east.
        let room = origin(50.0, 10.0, 0.0, 90.0);
        let ahead = room.to_global(Vec3::new(10.0, 0.0, -2.0));
        assert!(ahead.lon_rad > room.place().lon_rad && (ahead.alt_m - 2.0).abs() < 1e-4);
        assert!((ahead.lat_rad - room.place().lat_rad).abs() < 1e-9);
        let [n, e, d] = room.to_true_north(Vec3::new(1.0, 0.0, 0.5));
        assert!(n.abs() < 1e-12 && (e - 1.0).abs() < 1e-12 && d == 0.5);
        let v = room.from_true_north([n, e, d]);
        assert!((v - Vec3::new(1.0, 0.0, 0.5)).norm() < 1e-12);
        assert!((room.true_yaw_rad(0.0) - FRAC_PI_2).abs() < 1e-12);
        assert!(room.room_yaw_rad(FRAC_PI_2).abs() < 1e-12);
    }

    #[test]
    fn prop_what_is_not_on_the_globe_is_refused() {
        assert!(Geodetic::from_deg(90.1, 0.0, 0.0).is_none());
        assert!(Geodetic::from_deg(0.0, f64::NAN, 0.0).is_none());
        assert!(Geodetic::from_deg(0.0, 0.0, f64::INFINITY).is_none());
        assert!(Geodetic::from_e7(i32::MAX, 0, 0.0).is_none());
        let pole = Geodetic::from_deg(90.0, 0.0, 0.0).unwrap();
        assert!(LocalOrigin::new(pole, 0.0).is_none());
        let here = Geodetic::from_deg(10.0, 0.0, 0.0).unwrap();
        assert!(LocalOrigin::new(here, f64::NAN).is_none());
    }
}
