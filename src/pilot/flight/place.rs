//! Points that clients name, in whatever frame, as points of the room.

use haltere_dialect::mav::haltere::MavFrame;
use haltere_dialect::mav::known;

use haltere_core::frames::{E, Vec3};
use haltere_dialect::mav::LOCAL_PER_M;

use haltere_core::geo::{Geodetic, LocalOrigin};

/// One count of a local frame on the wire, m.
pub(crate) const LOCAL_SCALE: f64 = 1.0 / LOCAL_PER_M;

/// MAVLink counts latitude and longitude in this many degrees.
pub(crate) const WIRE_DEG: f64 = 1e-7;

/// What a height is counted from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Above {
    /// Sea level.
    Sea,
    /// The floor, which is home's height and the terrain.
    Floor,
}

/// How a frame writes a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Latitude, longitude, and a height.
    Global(Above),
    /// Local NED.
    Local,
}

/// The frames of STATIONS.md's list and their float and integer twins; `None`: not supported.
pub(crate) fn kind(frame: u8) -> Option<Kind> {
    use MavFrame as F;
    Some(match known(frame)? {
        F::MAV_FRAME_GLOBAL | F::MAV_FRAME_GLOBAL_INT => Kind::Global(Above::Sea),
        F::MAV_FRAME_GLOBAL_RELATIVE_ALT
        | F::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        | F::MAV_FRAME_GLOBAL_TERRAIN_ALT
        | F::MAV_FRAME_GLOBAL_TERRAIN_ALT_INT => Kind::Global(Above::Floor),
        F::MAV_FRAME_LOCAL_NED => Kind::Local,
        _ => return None,
    })
}

/// A point as far as it was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wanted {
    /// Room north and east, m.
    pub horizontal_m: Option<[f64; 2]>,
    /// Above the floor, m.
    pub height_m: Option<f64>,
    /// Angles count from true north.
    pub is_global: bool,
}

/// The three location fields of a command, as they stand in the message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Location {
    /// COMMAND_LONG, or a float MISSION_ITEM: degrees or metres, NaN is "not given". COMMAND_LONG has
    /// no frame: `None`.
    Float { x: f64, y: f64, z: f64, frame: Option<u8> },
    /// COMMAND_INT, MISSION_ITEM_INT: the largest number is "not given".
    Int { x: i32, y: i32, z: f64, frame: u8 },
}

impl Location {
    pub fn z(&self) -> f64 {
        match self {
            Location::Float { z, .. } | Location::Int { z, .. } => *z,
        }
    }

    /// The first two fields where they are no coordinates.
    pub fn plain(&self) -> [f64; 2] {
        match self {
            Location::Float { x, y, .. } => [*x, *y],
            Location::Int { x, y, .. } => [f64::from(*x), f64::from(*y)],
        }
    }
}

/// Room north and east of a place, m. Not a number where there is no such place: no limits hold
/// that.
pub(crate) fn room_from_deg(
    origin: &LocalOrigin,
    latitude_deg: f64,
    longitude_deg: f64,
) -> [f64; 2] {
    let alt_m = origin.place().alt_m;
    let pos = Geodetic::from_deg(latitude_deg, longitude_deg, alt_m)
        .map_or(Vec3::<E>::new(f64::NAN, f64::NAN, 0.0), |place| origin.to_local(&place));
    [pos.x(), pos.y()]
}

/// The same for fields in degrees or metres, NaN where not given.
pub(crate) fn room_point(origin: &LocalOrigin, kind: Kind, [x, y, z]: [f64; 3]) -> Wanted {
    let height_m = match kind {
        Kind::Local => -z,
        Kind::Global(Above::Floor) => z,
        Kind::Global(Above::Sea) => z - origin.place().alt_m,
    };
    let horizontal_m = match kind {
        _ if x.is_nan() || y.is_nan() => None,
        Kind::Local => Some([x, y]),
        Kind::Global(_) => Some(room_from_deg(origin, x, y)),
    };
    Wanted {
        horizontal_m,
        height_m: (!height_m.is_nan()).then_some(height_m),
        is_global: kind != Kind::Local,
    }
}
