//! Origin and home: where the room lies on Earth, and where the vehicle returns to.

use haltere_dialect::mav::haltere::MavResult;

use haltere_core::estimate::Health;
use haltere_core::frames::Vec3;
use haltere_core::geo::{Geodetic, LocalOrigin};
use haltere_core::time::HostTime;

use super::act::Act;
use crate::flight::place::WIRE_DEG;
use crate::input::LinkId;
use crate::out::voice::Severity;
use crate::stations::commands::{Answer, Request, refuse};
use crate::stations::endpoint::{GpsClaim, OriginConfig};

/// Highest and lowest altitude that an origin may have, m: as in the configuration.
const ALTITUDE_M: std::ops::RangeInclusive<f64> = -500.0..=9000.0;

impl Act<'_> {
    /// What only a new station must know: everybody else heard it.
    pub(crate) fn greet(&mut self, at: HostTime, link: LinkId) {
        if *self.origin == OriginConfig::default().in_force()
            && self.stations.endpoint_on(link).gps != GpsClaim::None
        {
            let text =
                "the place on the map is a stand-in: set ground.origin, or the origin from here";
            self.out.say_to(at, link, Severity::Info, text);
        }
        if let Some(text) = self.navigation.survey_check.doubt() {
            self.out.say_to(at, link, Severity::Warning, &text);
        }
    }

    /// SET_GPS_GLOBAL_ORIGIN and MAV_CMD_DO_SET_GLOBAL_ORIGIN: 1e-7 degrees, and metres.
    pub(crate) fn set_origin(&mut self, at: HostTime, lat: i32, lon: i32, alt_m: f64) -> Answer {
        let north_rad = self.origin.room_north_rad();
        let origin = Geodetic::from_e7(lat, lon, alt_m)
            .filter(|_| ALTITUDE_M.contains(&alt_m))
            .and_then(|place| LocalOrigin::new(place, north_rad));
        let [latitude_deg, longitude_deg] = [lat, lon].map(|w| f64::from(w) * WIRE_DEG);
        let Some(origin) = origin else {
            return refuse(
                MavResult::MAV_RESULT_DENIED,
                format!(
                    "origin {latitude_deg:.7} {longitude_deg:.7} {alt_m:.1} m refused: latitude \
                     within 90 and not at a pole, longitude within 180 deg, altitude {} to {} m",
                    ALTITUDE_M.start(),
                    ALTITUDE_M.end()
                ),
            );
        };
        if self.flight.mode.has_thrust() {
            // The goals of a flight in global coordinates would jump.
            return refuse(
                MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                "origin refused in flight: land first",
            );
        }
        *self.origin = origin;
        self.out.say(at, Severity::Info, format!("origin at {latitude_deg:.7} {longitude_deg:.7}"));
        for n in 0..self.stations.grounds.len() {
            let link = self.stations.grounds[n].link;
            if self.out.is_open(link) {
                self.out.message(link, &self.origin_message());
                self.out.message(link, &self.home_message());
            }
        }
        Ok(MavResult::MAV_RESULT_ACCEPTED)
    }

    /// MAV_CMD_DO_SET_HOME: here, or a point. The height of home is the floor's, always.
    pub(crate) fn command_home(&mut self, at: HostTime, request: &Request) -> Answer {
        if request.params[0] == 1.0 {
            if self.estimate.health == Health::NotAligned {
                return refuse(
                    MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                    "home refused: estimator not aligned",
                );
            }
            let here = self.estimate.pos_E_m;
            return self.set_home(at, [here.x(), here.y()]);
        }
        match self.stations.wanted(self.origin, request)?.horizontal_m {
            Some(point) => self.set_home(at, point),
            None => refuse(MavResult::MAV_RESULT_DENIED, "home refused: no point given"),
        }
    }

    /// Sets home by hand: it stays until it is set again, take-offs do not move it.
    pub(crate) fn set_home(&mut self, at: HostTime, [north_m, east_m]: [f64; 2]) -> Answer {
        let home = Vec3::new(north_m, east_m, 0.0);
        let is_inside = self.flight.guidance.volume().contains_over(home)
            && self.flight.plans.fence.contains([north_m, east_m]);
        if !home.is_finite() || !is_inside {
            return refuse(
                MavResult::MAV_RESULT_DENIED,
                format!(
                    "home refused: N {north_m:.2} E {east_m:.2} m is outside the limits or the fence"
                ),
            );
        }
        self.flight.guidance.set_home(home);
        self.out.say(at, Severity::Info, format!("home at N {north_m:.2} E {east_m:.2} m"));
        self.out.tell_all(&self.home_message());
        Ok(MavResult::MAV_RESULT_ACCEPTED)
    }
}
