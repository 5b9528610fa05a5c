//! Whether a core may end here and another begin in its place: so begins a new log, which replays by itself.
//!
//! Nobody is to notice. So the vehicle stands, nothing is under way for a station, and nothing was asked that
//! neither the configuration nor the store brings back: rates of streams, home, a program by its name, a mission
//! that was left half-way. What was set goes on with [`Pilot::settings`].

use haltere_core::time::HostTime;

use crate::Pilot;
use crate::config::PilotConfig;
use crate::flight::modes::Mode;
use crate::stations::endpoint::OriginConfig;

/// The vehicle stands for so long, s: as long as the recorder goes on after a flight.
const STANDS_S: f64 = 10.0;
/// An IMU that was not heard for so long says nothing about rest, s.
const IMU_SILENT_S: f64 = 1.0;

impl Pilot {
    /// Whether another core may take this one's place.
    pub fn may_begin_anew(&self) -> bool {
        self.stands_long(self.clock.now) && self.nothing_is_under_way() && self.all_is_kept()
    }

    /// The configuration as stations have set it, for the core that comes next.
    pub fn settings(&self) -> PilotConfig {
        let mut settings = self.stations.services.settings().clone();
        if self.origin != settings.origin.in_force() {
            let place = self.origin.place();
            settings.origin = OriginConfig {
                latitude_deg: place.lat_rad.to_degrees(),
                longitude_deg: place.lon_rad.to_degrees(),
                altitude_m: place.alt_m,
                north_deg: self.origin.room_north_rad().to_degrees(),
            };
        }
        settings
    }

    fn stands_long(&self, now: HostTime) -> bool {
        let heard = |at: HostTime| now.seconds_since(at) < IMU_SILENT_S;
        self.flight.mode == Mode::Disarmed
            && now.seconds_since(self.flight.mode_since) >= STANDS_S
            && !self.board.link.is_armed()
            && !self.flight.lift_off_asked
            && self.flight.ending.is_none()
            && self.navigation.last_imu.is_some_and(heard)
            && self.navigation.estimator.rested_s() >= STANDS_S
    }

    fn nothing_is_under_way(&self) -> bool {
        self.stations.askers.is_empty() && self.stations.services.is_quiet(self.clock.now)
    }

    fn all_is_kept(&self) -> bool {
        let item = usize::from(self.flight.guidance.current_item);
        self.config.store
            && self.program_in_force().is_none()
            && !self.flight.guidance.home_is_set()
            && (item == 0 || item >= self.flight.mission.items.len())
            && self.stations.grounds.iter().all(|ground| ground.streams.are_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::mission::{MissionItem, StoredItem};
    use crate::input::{Input, LinkId};
    use haltere_core::frames::Vec3;
    use haltere_core::geo::{Geodetic, LocalOrigin};
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
