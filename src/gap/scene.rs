//! The room in which the diagnostic flights are flown, and what the companion is told of it.

use haltere_dialect::mav::LOCAL_PER_M;
use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame};

use haltere_core::checks::Problems;
use haltere_core::frames::Vec3;
use haltere_core::survey::Survey;
use haltere_model::board::Firmware;
use haltere_model::room::Room;
use haltere_model::{PlantConfig, Vehicle};
use haltere_pilot::{BoardProfile, PilotConfig};

use crate::bank::kept_file::fnv;

/// A room with anchors in its corners, a vehicle on its floor, and a companion configured for both.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Floor, walls and ceiling.
    pub room: Room,
    /// The anchors as the companion is told.
    pub survey: Survey,
    /// Place of take-off, north and east, m.
    pub start_NE_m: [f64; 2],
    /// The vehicle that the nominal simulator flies.
    pub vehicle: Vehicle,
    /// The companion.
    pub pilot: PilotConfig,
    /// How far into the mission flights are looked at, s; `None`: to their landing. A flight that ended early
    /// stands beside the same part of the bank's flights.
    pub until_s: Option<f64>,
}

/// What the user says of a flight beside its log.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Told {
    /// Floor, walls and ceiling; `None`: the box of the anchors.
    pub room: Option<Room>,
    /// The vehicle that the nominal simulator flies.
    pub vehicle: Vehicle,
}

impl Told {
    /// The usual vehicle in this room.
    pub fn of_room(room: &Room) -> Self {
        Self { room: Some(room.clone()), ..Self::default() }
    }
}

/// Side of the laboratory, m, and height of its ceiling, m: a room in which wall and ceiling are
/// near enough to be felt, and dashes of ±2 m are still possible.
const LAB_SIDE_M: f64 = 6.0;
const LAB_CEILING_M: f64 = 3.0;

/// Acceleration of the setpoint on legs, m/s²: twice the default, so that drag and lag are excited
/// and the flight stays short.
const LEG_ACCELERATION_MPS2: f64 = 1.5;

/// Distance from the first place of a mission at which flights start that its bank serves, m. Measured
/// (`val_a_bank_serves_flights_that_start_beside_it`): means of the statistics move by 0.04 sigma of benign jitter at 0.2 m, by
/// 0.14 to 0.33 at 0.5 m; a quarter widens the healthy spread by 3 %.
pub const SERVED_M: f64 = 0.3;

/// First place that a mission flies to, where it is told in the frame of the room.
fn first_place_NE_m(items: &[MISSION_ITEM_INT_DATA]) -> Option<[f64; 2]> {
    let place = items.iter().find(|item| item.command == MavCmd::MAV_CMD_NAV_WAYPOINT as u16)?;
    let local = place.frame == MavFrame::MAV_FRAME_LOCAL_NED as u8;
    local.then(|| [place.x, place.y].map(|counts| f64::from(counts) / LOCAL_PER_M))
}

impl Scene {
    /// Hash of everything that flights of a mission depend on, and of what else tells files apart.
    pub(crate) fn key(&self, items: &[MISSION_ITEM_INT_DATA], rest: &str) -> String {
        // Items are told apart from how they were addressed.
        let items: Vec<_> = items
            .iter()
            .map(|i| (i.command, i.x, i.y, i.z, i.param1, i.param2, i.param3, i.param4))
            .collect();
        // Debug output of numbers is exact; NaN has one spelling.
        let text = format!(
            "{:?} {:?} {:?} {:?} {:?} {:?} {items:?} {rest} {}",
            self.room,
            self.survey,
            self.start_NE_m,
            self.until_s,
            self.vehicle,
            self.pilot,
            crate::BANK_HASH
        );
        format!("{:016x}", fnv(text.as_bytes()))
    }

    /// A laboratory of 6 × 6 × 3 m, eight anchors in its corners.
    pub fn lab() -> Result<Self, Problems> {
        let room = Room {
            north_m: [0.0, LAB_SIDE_M],
            east_m: [0.0, LAB_SIDE_M],
            ceiling_m: LAB_CEILING_M,
        };
        let survey = Survey::new(&room.corner_anchors())?;
        let vehicle = Vehicle::default();
        let mut pilot = PilotConfig::default();
        pilot.flight.gear_height_m = vehicle.body.gear_m;
        pilot.flight.cruise_acceleration_mps2 = LEG_ACCELERATION_MPS2;
        let start_NE_m = [0.5 * LAB_SIDE_M; 2];
        Ok(Self { room, survey, start_NE_m, vehicle, pilot, until_s: None })
    }

    /// The same with the start on a grid of a quarter of a metre: estimates of one start differ by
    /// centimetres and need no bank each.
    pub fn on_grid(mut self) -> Self {
        self.start_NE_m = self.start_NE_m.map(|v| (v * 4.0).round() / 4.0);
        self
    }

    /// The same with the start at the first place of the mission, which is where the vehicle stands for it give or take:
    /// one bank serves the mission wherever it starts within [`SERVED_M`]. A start farther away has a leg that the bank's
    /// flights do not have; its bank is that of the start, [`Scene::on_grid`], as where a mission names no place in the room.
    pub fn for_bank(mut self, items: &[MISSION_ITEM_INT_DATA]) -> Self {
        let served = |place_NE_m: &[f64; 2]| {
            let [north_m, east_m] = self.start_NE_m;
            (place_NE_m[0] - north_m).hypot(place_NE_m[1] - east_m) <= SERVED_M
        };
        match first_place_NE_m(items).filter(served) {
            Some(place_NE_m) => {
                self.start_NE_m = place_NE_m;
                self
            }
            None => self.on_grid(),
        }
    }

    /// The nominal plant in this room.
    pub fn plant(&self, seed: u64) -> PlantConfig {
        let mut plant = PlantConfig::new(self.survey.clone(), seed);
        plant.vehicle = self.vehicle.clone();
        plant.room = self.room.clone();
        plant.start_E_m = Vec3::new(self.start_NE_m[0], self.start_NE_m[1], 0.0);
        if self.pilot.board_profile == BoardProfile::Crazyflie {
            // It speaks what the companion was told to hear: with another board nobody takes off.
            plant.board.firmware = Firmware::Crazyflie;
        }
        plant
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::fly::fly_observed;
    use crate::bank::missions;
    use haltere_pilot::TagProtocol;

    /// Nobody took off, and a log of such a flight was refused.
    #[test]
    fn regress_the_nominal_board_is_a_crazyflie_where_the_flights_was() {
        let mut scene = Scene::lab().unwrap();
        (scene.pilot.board_profile, scene.pilot.tag_protocol) =
            (BoardProfile::Crazyflie, TagProtocol::Crazyflie);
        let plain = missions::plain(&scene);
        let flown = fly_observed(&scene, &plain, scene.plant(5), scene.pilot.clone()).unwrap();
        assert_eq!((flown.landed, flown.crashed), (Some(true), Some(false)));
    }
}
