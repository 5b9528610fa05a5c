//! The point of a command, as a point of the room.

use haltere_dialect::mav::haltere::{MavFrame, MavResult};
use haltere_dialect::mav::name_of;

use haltere_core::geo::LocalOrigin;

use super::Stations;
use super::commands::{Refusal, Request};
use super::endpoint::Identity;
use crate::flight::place::{
    Above, Kind, LOCAL_SCALE, Location, WIRE_DEG, Wanted, kind, room_point,
};

impl Stations {
    /// What a command without a frame means: heights above sea level from those who take us for a
    /// PX4, above home from everybody else (STATIONS.md).
    pub(crate) fn kind_of(&self, request: &Request) -> Result<Kind, Refusal> {
        let frame = match request.location {
            Location::Float { frame: None, .. } => {
                return Ok(match self.identity_on(request.link) {
                    Identity::Px4 => Kind::Global(Above::Sea),
                    Identity::Generic => Kind::Global(Above::Floor),
                });
            }
            Location::Float { frame: Some(frame), .. } | Location::Int { frame, .. } => frame,
        };
        kind(frame).ok_or_else(|| {
            (
                MavResult::MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME,
                format!(
                    "frame {} refused: use GLOBAL, GLOBAL_RELATIVE_ALT or LOCAL_NED",
                    name_of::<MavFrame>(frame)
                ),
            )
        })
    }

    /// The point of a command in the room.
    pub(crate) fn wanted(
        &self,
        origin: &LocalOrigin,
        request: &Request,
    ) -> Result<Wanted, Refusal> {
        let kind = self.kind_of(request)?;
        let scale = match kind {
            Kind::Global(_) => WIRE_DEG,
            Kind::Local => LOCAL_SCALE,
        };
        let [x, y, z] = match request.location {
            Location::Float { x, y, z, .. } => [x, y, z],
            Location::Int { x, y, z, .. } => {
                let given = |v: i32| if v == i32::MAX { f64::NAN } else { f64::from(v) * scale };
                [given(x), given(y), z]
            }
        };
        if x.is_infinite() || y.is_infinite() || z.is_infinite() || x.is_nan() != y.is_nan() {
            return Err((
                MavResult::MAV_RESULT_DENIED,
                "point refused: give both horizontal coordinates, or NaN for both".to_owned(),
            ));
        }
        Ok(room_point(origin, kind, [x, y, z]))
    }
}
