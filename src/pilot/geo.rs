//! Local coordinates and places on Earth, one into the other.
//!
//! Equations, with the room's north, east and height n, e, h (m, local NED with h = -z), the angle ψ
//! from true north to room north (rad, clockwise), origin latitude φ0, longitude λ0 (rad), altitude
//! a0 (m), semi-major axis a and first eccentricity squared e² of WGS 84:
//!
//! ```text
//!   N = n cos ψ − e sin ψ          E = n sin ψ + e cos ψ
//!   M = a (1 − e²) / (1 − e² sin² φ0)^(3/2)       radius of curvature in the meridian
//!   P = a / (1 − e² sin² φ0)^(1/2)                and in the prime vertical
//!   φ = φ0 + N / (M + a0)     λ = λ0 + E / ((P + a0) cos φ0)     altitude = a0 + h
//! ```
//!
//! Source of M and P: P. A. Misra, P. Enge, "Global Positioning System", 2nd ed., appendix 4.A; the
//! constants are those of NIMA TR8350.2. Range: rooms. 100 m from the origin the error against the
//! geodesic is below 2 mm up to 60 degrees of latitude (tested against GeographicLib's numbers) and
//! grows with the square of the distance; MAVLink's 1e-7 degrees are 1.1 cm.

use crate::frames::{E, Vec3, wrap_pi_rad};

use super::endpoint::OriginConfig;

/// WGS 84 semi-major axis, m (NIMA TR8350.2).
const SEMI_MAJOR_M: f64 = 6_378_137.0;
/// WGS 84 first eccentricity squared (NIMA TR8350.2).
const ECCENTRICITY_2: f64 = 6.694_379_990_141_316e-3;
/// MAVLink counts latitude and longitude in this many degrees.
pub(super) const WIRE_DEG: f64 = 1e-7;

/// A place on Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    pub latitude_deg: f64,
    pub longitude_deg: f64,
    /// Above sea level, m.
    pub altitude_m: f64,
}

impl Place {
    /// Latitude and longitude as MAVLink counts them.
    pub fn wire_deg(&self) -> [i32; 2] {
        // Saturates; longitude is within ±180 and fits.
        [self.latitude_deg, self.longitude_deg].map(|deg| (deg / WIRE_DEG).round() as i32)
    }

    /// Altitude in millimetres.
    pub fn wire_mm(&self) -> i32 {
        (self.altitude_m * 1e3).round() as i32
    }
}

/// Where the room's origin lies, with the lengths that belong to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Origin {
    pub place: Place,
    /// From true north to room north, rad.
    north_rad: f64,
    /// Metres of a radian of latitude and of longitude.
    m_per_rad: [f64; 2],
}

impl Origin {
    pub fn new(config: &OriginConfig) -> Self {
        let place = Place {
            latitude_deg: config.latitude_deg,
            longitude_deg: config.longitude_deg,
            altitude_m: config.altitude_m,
        };
        Self::at(place, config.north_deg.to_radians())
    }

    fn at(place: Place, north_rad: f64) -> Self {
        let (sin, cos) = place.latitude_deg.to_radians().sin_cos();
        let w2 = 1.0 - ECCENTRICITY_2 * sin * sin;
        let meridian_m = SEMI_MAJOR_M * (1.0 - ECCENTRICITY_2) / (w2 * w2.sqrt());
        let vertical_m = SEMI_MAJOR_M / w2.sqrt();
        // Not zero: the pole has no east.
        let cos = cos.max(1e-3);
        let m_per_rad = [meridian_m + place.altitude_m, (vertical_m + place.altitude_m) * cos];
        Self { place, north_rad, m_per_rad }
    }

    /// The same room somewhere else.
    pub fn moved(&self, place: Place) -> Self {
        Self::at(place, self.north_rad)
    }

    /// Where a point of the room lies on Earth.
    pub fn place(&self, pos_E_m: Vec3<E>) -> Place {
        let [north_m, east_m] = self.true_from_room([pos_E_m.x(), pos_E_m.y()]);
        let longitude_deg =
            self.place.longitude_deg + (east_m / self.m_per_rad[1]).to_degrees();
        Place {
            latitude_deg: self.place.latitude_deg + (north_m / self.m_per_rad[0]).to_degrees(),
            longitude_deg: wrap_deg(longitude_deg),
            altitude_m: self.place.altitude_m - pos_E_m.z(),
        }
    }

    /// Where a place lies in the room: room north and east, m.
    pub fn point(&self, latitude_deg: f64, longitude_deg: f64) -> [f64; 2] {
        let north_m = (latitude_deg - self.place.latitude_deg).to_radians() * self.m_per_rad[0];
        let east_m = wrap_deg(longitude_deg - self.place.longitude_deg).to_radians()
            * self.m_per_rad[1];
        self.room_from_true([north_m, east_m])
    }

    /// A horizontal vector of the room, along true north and east.
    pub fn true_from_room(&self, [north, east]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.north_rad.sin_cos();
        [north * cos - east * sin, north * sin + east * cos]
    }

    /// A horizontal vector along true north and east, in the room.
    pub fn room_from_true(&self, [north, east]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.north_rad.sin_cos();
        [north * cos + east * sin, east * cos - north * sin]
    }

    /// Compass heading of a yaw from room north, rad.
    pub fn heading_rad(&self, yaw_rad: f64) -> f64 {
        wrap_pi_rad(yaw_rad + self.north_rad)
    }

    /// Yaw from room north of a compass heading, rad.
    pub fn yaw_rad(&self, heading_rad: f64) -> f64 {
        wrap_pi_rad(heading_rad - self.north_rad)
    }
}

/// Compass course in hundredths of a degree, 0 to 35999.
pub(super) fn centidegrees(angle_rad: f64) -> u16 {
    let degrees = angle_rad.to_degrees().rem_euclid(360.0);
    ((degrees * 100.0).round() as u16) % 36_000
}

fn wrap_deg(angle_deg: f64) -> f64 {
    wrap_pi_rad(angle_deg.to_radians()).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin(latitude_deg: f64, longitude_deg: f64, north_deg: f64) -> Origin {
        Origin::new(&OriginConfig { latitude_deg, longitude_deg, altitude_m: 0.0, north_deg })
    }

    #[test]
    fn val_places_are_those_of_geographiclib() {
        // GeographicLib 2.1 (Python), Geodesic.WGS84.Direct(lat, lon, azimuth, distance), by
        // tests/pymavlink/geodesic.py: origin, azimuth (deg), distance (m), latitude, longitude.
        const ROWS: [([f64; 2], f64, f64, [f64; 2]); 8] = include!("geo_rows.in");
        for ([lat, lon], azimuth_deg, distance_m, [lat2, lon2]) in ROWS {
            let origin = origin(lat, lon, 0.0);
            let (sin, cos) = azimuth_deg.to_radians().sin_cos();
            let place = origin.place(Vec3::new(distance_m * cos, distance_m * sin, -2.0));
            let dlat_m = (place.latitude_deg - lat2).to_radians() * 6.37e6;
            let dlon_m = wrap_deg(place.longitude_deg - lon2).to_radians()
                * 6.37e6
                * lat.to_radians().cos();
            // The square of the distance over twice the radius, times the tangent of the latitude.
            let bound_m = 1e-4 + 1.5e-7 * distance_m * distance_m;
            assert!(
                dlat_m.hypot(dlon_m) < bound_m,
                "{lat} {lon} {azimuth_deg} {distance_m}: {dlat_m} {dlon_m}"
            );
            assert_eq!(place.altitude_m, 2.0);
            let [north_m, east_m] = origin.point(lat2, lon2);
            let error_m =
                (north_m - distance_m * cos).hypot(east_m - distance_m * sin);
            assert!(error_m < bound_m, "{error_m}");
        }
    }

    #[test]
    fn prop_there_and_back() {
        for (lat, lon, north) in [(51.99, 4.37, 0.0), (-33.0, 179.999_999, 77.0), (0.0, -180.0, -135.0)]
        {
            let origin = origin(lat, lon, north);
            let pos = Vec3::new(12.5, -7.25, -3.0);
            let place = origin.place(pos);
            assert!((-180.0..=180.0).contains(&place.longitude_deg));
            let [n, e] = origin.point(place.latitude_deg, place.longitude_deg);
            assert!((n - pos.x()).abs() < 1e-5 && (e - pos.y()).abs() < 1e-5, "{n} {e}");
            // Through the wire: half a unit of 1e-7 degrees each way.
            let [lat, lon] = place.wire_deg().map(|w| f64::from(w) * WIRE_DEG);
            let [n, e] = origin.point(lat, lon);
            assert!((n - pos.x()).abs() < 0.01 && (e - pos.y()).abs() < 0.01, "{n} {e}");
        }
    }

    #[test]
    fn prop_a_turned_room_is_turned_on_the_map() {
        // Room north points east: what lies room-north of the origin lies east of it.
        let origin = origin(50.0, 8.0, 90.0);
        let place = origin.place(Vec3::new(10.0, 0.0, 0.0));
        assert!((place.latitude_deg - 50.0).abs() < 1e-9 && place.longitude_deg > 8.0001);
        assert!((origin.heading_rad(0.0).to_degrees() - 90.0).abs() < 1e-9);
        assert!((origin.yaw_rad(origin.heading_rad(0.3)) - 0.3).abs() < 1e-12);
        assert_eq!(centidegrees(-1e-9), 0);
        assert_eq!(centidegrees(-std::f64::consts::FRAC_PI_2), 27_000);
    }
}
