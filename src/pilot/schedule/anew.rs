//! Whether a core may end here and another begin in its place: so begins a new log, which replays by itself.
//!
//! Nobody is to notice. So the vehicle stands, nothing is under way for a station, and nothing was asked that
//! neither the configuration nor the store brings back: rates of streams, home, a program by its name, a mission
//! that was left half-way. What was set goes on with [`settings`].

use haltere_core::geo::LocalOrigin;
use haltere_core::time::HostTime;

use crate::config::PilotConfig;
use crate::flight::modes::Mode;
use crate::stations::Stations;
use crate::stations::endpoint::OriginConfig;
use crate::view::Sight;

/// The vehicle stands for so long, s: as long as the recorder goes on after a flight.
const STANDS_S: f64 = 10.0;
/// An IMU that was not heard for so long says nothing about rest, s.
const IMU_SILENT_S: f64 = 1.0;

/// Whether another core may take the place of the one that is looked at.
pub(crate) fn may_begin(sight: &Sight<'_>, stations: &Stations) -> bool {
    let now = sight.view.at;
    let is_quiet = stations.askers.is_empty() && stations.services.is_quiet(now);
    stands_long(sight) && is_quiet && all_is_kept(sight, stations)
}

/// The configuration as stations have set it, for the core that comes next.
pub(crate) fn settings(stations: &Stations, origin: &LocalOrigin) -> PilotConfig {
    let mut settings = stations.services.settings().clone();
    if *origin != settings.origin.in_force() {
        let place = origin.place();
        settings.origin = OriginConfig {
            latitude_deg: place.lat_rad.to_degrees(),
            longitude_deg: place.lon_rad.to_degrees(),
            altitude_m: place.alt_m,
            north_deg: origin.room_north_rad().to_degrees(),
        };
    }
    settings
}

fn stands_long(sight: &Sight<'_>) -> bool {
    let (now, flight, navigation) = (sight.view.at, sight.flight, sight.navigation);
    let heard = |at: HostTime| now.seconds_since(at) < IMU_SILENT_S;
    flight.mode == Mode::Disarmed
        && now.seconds_since(flight.mode_since) >= STANDS_S
        && !sight.board.link.is_armed()
        && !flight.lift_off_asked
        && flight.ending.is_none()
        && navigation.last_imu.is_some_and(heard)
        && navigation.estimator.rested_s() >= STANDS_S
}

fn all_is_kept(sight: &Sight<'_>, stations: &Stations) -> bool {
    let flight = sight.flight;
    let item = usize::from(flight.guidance.current_item);
    sight.view.config.store
        && stations.services.program_in_force(flight.mission.id).is_none()
        && !flight.guidance.home_is_set()
        && (item == 0 || item >= flight.mission.items.len())
        && stations.grounds.iter().all(|ground| ground.streams.are_default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pilot;
    use crate::flight::mission::{MissionItem, StoredItem};
    use crate::input::{Input, LinkId};
    use haltere_core::frames::Vec3;
    use haltere_core::geo::Geodetic;
    use haltere_core::measure::AnchorId;
    use haltere_core::survey::Survey;

    /// On the floor, board and IMU heard, disarmed for a minute: as far as the core is asked for it.
    fn standing() -> Pilot {
        let corner = |i: u8| {
            let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
        };
        let survey = Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        let config = PilotConfig { store: true, ..PilotConfig::default() };
        let mut pilot = Pilot::new(config, survey, HostTime::from_us(0));
        let sample = |at| haltere_core::measure::ImuSample {
            valid_at: at,
            received_at: at,
            acc_B_mps2: Vec3::new(0.0, 0.0, -haltere_core::frames::G_MPS2),
            rate_B_radps: Vec3::zero(),
        };
        for step in 0..=6000 {
            let at = HostTime::from_us(step * 10_000);
            pilot.clock.now = at;
            pilot.navigation.estimator.imu(&sample(at));
            pilot.navigation.last_imu = Some(at);
        }
        pilot
    }

    type Change = fn(&mut Pilot);

    #[test]
    fn prop_what_a_station_would_miss_keeps_the_core() {
        assert!(standing().may_begin_anew());
        let link = LinkId::Ground(0);
        let changes: [(&str, Change); 9] = [
            ("flies", |p| p.flight.mode = Mode::Hold),
            ("stood for 9 s", |p| p.flight.mode_since = p.clock.now.offset_us(-9_000_000)),
            ("lifts off", |p| p.flight.lift_off_asked = true),
            ("ends", |p| p.handle(p.clock.now, Input::EndAsked)),
            ("does not know whether it rests", |p| {
                p.navigation.last_imu = Some(p.clock.now.offset_us(-1_000_000))
            }),
            ("keeps nothing", |p| p.config.store = false),
            ("home by hand", |p| p.flight.guidance.set_home(Vec3::zero())),
            ("stream by hand", |p| {
                p.stations.grounds[0].streams.set_interval(32, 1e5, p.clock.now);
            }),
            ("half of a mission", |p| {
                let item = StoredItem { wire: Default::default(), item: MissionItem::Home };
                p.flight.mission.items = vec![item; 2];
                p.flight.guidance.current_item = 1;
            }),
        ];
        for (name, change) in changes {
            let mut pilot = standing();
            change(&mut pilot);
            assert!(!pilot.may_begin_anew(), "{name}");
        }
        // A station that goes takes its wishes along.
        let mut pilot = standing();
        pilot.handle(pilot.clock.now, Input::LinkUp { link });
        pilot.stations.grounds[0].streams.set_interval(32, 1e5, pilot.clock.now);
        pilot.handle(pilot.clock.now, Input::LinkDown { link });
        assert!(pilot.may_begin_anew());
    }

    #[test]
    fn prop_what_stations_have_set_goes_on() {
        let mut pilot = standing();
        assert_eq!(pilot.settings(), *pilot.stations.services.settings());
        let place = Geodetic::from_deg(48.1, 11.6, 520.0).unwrap();
        pilot.origin = LocalOrigin::new(place, 0.0).unwrap();
        let origin = pilot.settings().origin;
        assert!((origin.latitude_deg - 48.1).abs() < 1e-9, "{origin:?}");
        assert!((origin.longitude_deg - 11.6).abs() < 1e-9, "{origin:?}");
        assert_eq!(origin.altitude_m, 520.0);
    }
}
