//! Configuration of the pilot core: flight behaviour and limits.

use serde::{Deserialize, Serialize};

use crate::navigation::uwb::UwbConfig;
use haltere_core::checks::Problems;
use haltere_core::control::ControlConfig;
use haltere_core::control::voltage::VoltageConfig;
use haltere_core::estimate::Estimate;
use haltere_core::estimator::{EstimatorConfig, UwbNoise};
use haltere_core::survey::Survey;

use crate::flight::mission::{RADIUS_M, Volume};
use crate::flight::supervisor::SupervisorConfig;
use crate::stations::endpoint::{Endpoint, MOST_GROUND_LINKS, OriginConfig, Routing};

/// Everything the pilot core is told at start. The files layer builds it; a replay rebuilds it.
#[derive(Debug, Clone, PartialEq)]
pub struct PilotConfig {
    /// What the tag speaks.
    pub tag_protocol: TagProtocol,
    /// What the board obeys.
    pub board_profile: BoardProfile,
    /// Whether wrong parameters of the board may be set.
    pub board_set_parameters: bool,
    /// Angle from room north to the board's north at start, rad, positive clockwise from above.
    pub board_north_offset_rad: f64,
    /// System that we are to stations.
    pub system_id: u8,
    /// Ground endpoints, in their order.
    pub endpoints: Vec<Endpoint>,
    /// What becomes of frames that are not for us.
    pub routing: Routing,
    /// Where the room lies on Earth.
    pub origin: OriginConfig,
    /// Whether glue answers requests for files.
    pub store: bool,
    /// `[flight]`
    pub flight: FlightConfig,
    /// `[limits]`
    pub limits: LimitsConfig,
    /// `[supervisor]`
    pub supervisor: SupervisorConfig,
    /// `[uwb]`
    pub uwb: UwbConfig,
    /// `[estimator]`
    pub estimator: EstimatorConfig,
    /// `[control]`
    pub control: ControlConfig,
}

impl Default for PilotConfig {
    fn default() -> Self {
        Self {
            tag_protocol: TagProtocol::LpsSniffer,
            board_profile: BoardProfile::Auto,
            board_set_parameters: false,
            board_north_offset_rad: 0.0,
            system_id: 1,
            endpoints: vec![Endpoint::default()],
            routing: Routing::default(),
            origin: OriginConfig::default(),
            store: false,
            flight: FlightConfig::default(),
            limits: LimitsConfig::default(),
            supervisor: SupervisorConfig::default(),
            uwb: UwbConfig::default(),
            estimator: EstimatorConfig::default(),
            control: ControlConfig::default(),
        }
    }
}

impl PilotConfig {
    /// Every link to a station: number of its endpoint, and the endpoint. The links of an endpoint
    /// follow one another, in the order of the endpoints.
    pub fn ground_links(&self) -> impl Iterator<Item = (u8, Endpoint)> + '_ {
        let endpoints = (0..=u8::MAX).zip(&self.endpoints);
        endpoints
            .flat_map(|(number, endpoint)| {
                (0..endpoint.stations.max(1)).map(move |_| (number, *endpoint))
            })
            .take(MOST_GROUND_LINKS)
    }

    /// The filter with the enhancements that `[control]` switches on: version `raw` flies without
    /// drag term and with constant UWB noise, whatever `[estimator]` says. Learned errors of the UWB
    /// replace what it says of them by default; what it was told stays.
    pub fn estimator_in_force(&self) -> EstimatorConfig {
        let on = self.control.enhancements();
        let mut estimator = self.estimator.clone();
        if on.learned_uwb_errors {
            estimator = estimator.learned_uwb_errors();
        }
        estimator.drag &= on.filter_drag;
        if !on.variable_uwb_noise {
            estimator.uwb_noise = UwbNoise::Constant;
        }
        // Who says how high the vehicle stands on its gear has said how high it rests on the floor. Only where the floor's
        // errors are learned as well: held at its height, a filter without them takes them for a place beside, and of 100
        // flights in a corridor 59 did not take off.
        let gear_m = Some(self.flight.gear_height_m).filter(|m| *m > 0.0);
        let learned_gear_m = gear_m.filter(|_| on.learned_uwb_errors);
        estimator.rest_height_m = estimator.rest_height_m.or(learned_gear_m);
        estimator
    }
}

/// Wire format of the tag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TagProtocol {
    /// A Loco Positioning Node that passes on every UWB frame it hears.
    #[default]
    LpsSniffer,
    /// A tag that computes TDOA itself and sends `UWB_TDOA`.
    Mavlink,
}

/// Behaviour of the inner-loop board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BoardProfile {
    /// As its heartbeat says.
    #[default]
    Auto,
    /// Arms on command, obeys attitude targets while armed.
    Generic,
    /// PX4 in OFFBOARD.
    Px4,
    /// ArduPilot's copter in GUIDED_NOGPS.
    Ardupilot,
}

/// `[flight]`: how the vehicle takes off, moves and lands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FlightConfig {
    /// Height of a take-off that names none, m.
    pub takeoff_height_m: f64,
    /// Speed of the height setpoint in a take-off, m/s.
    pub takeoff_speed_mps: f64,
    /// Time in which thrust rises from nothing to just below hover, s.
    pub spool_s: f64,
    /// Speed of the setpoint along mission legs, m/s. A mission may change it; at or above the
    /// velocity limit of the controller the setpoint jumps instead of moving.
    pub cruise_speed_mps: f64,
    /// Change of that speed at the ends of a leg, m/s².
    pub cruise_acceleration_mps2: f64,
    /// Sinking speed in a landing above `land_slow_height_m`, m/s.
    pub land_speed_mps: f64,
    /// Sinking speed near the floor, m/s.
    pub land_slow_speed_mps: f64,
    /// Height below which a landing slows down, m.
    pub land_slow_height_m: f64,
    /// Distance at which a waypoint counts as reached when it names none, m.
    pub acceptance_radius_m: f64,
    /// Least height of a return, m. 0: it flies at the height it has.
    pub return_height_m: f64,
    /// Height of the landing gear's feet below the point that the estimator tracks, m.
    pub gear_height_m: f64,
    /// Time armed on the floor without take-off after which the vehicle disarms, s.
    pub idle_disarm_s: f64,
    /// Watch a vehicle that somebody else flies: estimate, record what would be sent, send nothing that arms or
    /// moves.
    pub shadow: bool,
    /// Nothing arms that would not be recorded.
    pub log_required: bool,
}

impl Default for FlightConfig {
    fn default() -> Self {
        Self {
            takeoff_height_m: 1.0,
            takeoff_speed_mps: 0.5,
            spool_s: 1.0,
            cruise_speed_mps: 0.5,
            cruise_acceleration_mps2: 0.7,
            land_speed_mps: 0.4,
            land_slow_speed_mps: 0.25,
            land_slow_height_m: 0.6,
            acceptance_radius_m: 0.30,
            return_height_m: 0.0,
            gear_height_m: 0.0,
            idle_disarm_s: 15.0,
            shadow: false,
            log_required: false,
        }
    }
}

/// Divisor in place of a speed that is nearly none, m/s: times stay finite whatever is configured.
pub(super) const LEAST_SPEED_MPS: f64 = 0.05;

impl FlightConfig {
    /// Height of the landing gear above the floor by an estimate, m.
    pub(super) fn height_above_floor_m(&self, estimate: &Estimate) -> f64 {
        -estimate.pos_E_m.z() - self.gear_height_m
    }

    /// Time of a landing from this height, s: `(h − h_s) / v + h_s / v_s` with `h_s = min(h, land_slow_height_m)`, `h` m,
    /// speeds `v` above and `v_s` below that height, m/s (`[flight]`). The ramp before the floor is left out.
    pub(super) fn landing_s(&self, height_m: f64) -> f64 {
        let slow_m = height_m.min(self.land_slow_height_m);
        (height_m - slow_m) / self.land_speed_mps.max(LEAST_SPEED_MPS)
            + slow_m / self.land_slow_speed_mps.max(LEAST_SPEED_MPS)
    }

    /// Time of a leg from rest to rest, s: `d/v + v/a`, or `2 √(d/a)` where `d < v²/a` is too short for `v`, with `d` m,
    /// `v` m/s and `a` = `cruise_acceleration_mps2`.
    pub(super) fn travel_s(&self, distance_m: f64, speed_mps: f64) -> f64 {
        let (v, a) = (speed_mps.max(LEAST_SPEED_MPS), self.cruise_acceleration_mps2);
        if distance_m * a > v * v { distance_m / v + v / a } else { 2.0 * (distance_m / a).sqrt() }
    }

    /// Adds what is out of range to `problems`; `key` is the name of the section.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value, low, high, unit| {
            problems.range(format_args!("{key}.{name}"), value, low..=high, unit);
        };
        range("takeoff_height_m", self.takeoff_height_m, 0.3, 20.0, "m");
        range("takeoff_speed_mps", self.takeoff_speed_mps, 0.1, 2.0, "m/s");
        range("spool_s", self.spool_s, 0.2, 5.0, "s");
        range("cruise_speed_mps", self.cruise_speed_mps, 0.05, 10.0, "m/s");
        range("cruise_acceleration_mps2", self.cruise_acceleration_mps2, 0.05, 5.0, "m/s²");
        range("land_speed_mps", self.land_speed_mps, 0.1, 1.5, "m/s");
        range("land_slow_speed_mps", self.land_slow_speed_mps, 0.05, 1.0, "m/s");
        range("land_slow_height_m", self.land_slow_height_m, 0.0, 5.0, "m");
        range("acceptance_radius_m", self.acceptance_radius_m, 0.05, 5.0, "m");
        range("return_height_m", self.return_height_m, 0.0, 20.0, "m");
        range("gear_height_m", self.gear_height_m, 0.0, 0.5, "m");
        range("idle_disarm_s", self.idle_disarm_s, 2.0, 600.0, "s");
    }
}

/// `[limits]`: the volume that setpoints may not leave, and the battery.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LimitsConfig {
    /// Lowest and highest room-north coordinate of a setpoint, m. Absent: 0.45 m inside the anchors' extent.
    pub north_m: Option<[f64; 2]>,
    /// Lowest and highest room-east coordinate of a setpoint, m. Absent: 0.45 m inside the anchors' extent.
    pub east_m: Option<[f64; 2]>,
    /// Highest height of a setpoint above the floor, m. Absent: 0.35 m below the highest anchor.
    pub height_m: Option<f64>,
    /// Voltage below which a warning is sent, V. 6.4 V for two cells (VEHICLE.md).
    pub battery_low_v: f64,
    /// Voltage below which the vehicle lands, V. 6.0 V for two cells (VEHICLE.md).
    pub battery_critical_v: f64,
    /// Age of the newest fused UWB measurement after which the vehicle lands, s.
    pub uwb_loss_land_s: f64,
    /// Silence of a board after which its link counts as lost, s.
    pub board_loss_s: f64,
    /// Silence of an offboard client after which a velocity setpoint ends in Hold, s.
    pub offboard_loss_s: f64,
}

impl Default for LimitsConfig {
    fn default() -> Self {
        Self {
            north_m: None,
            east_m: None,
            height_m: None,
            battery_low_v: 6.4,
            battery_critical_v: 6.0,
            uwb_loss_land_s: 1.0,
            board_loss_s: 1.0,
            offboard_loss_s: 0.5,
        }
    }
}

/// Lowest ceiling of the flight volume, m: a survey with all anchors on the floor still flies.
const LEAST_CEILING_M: f64 = 1.0;

/// What is kept between the point that is tracked and a wall or ceiling that anchors hang on, m: the wings
/// (half a wing span, or what stands above the point) and the way to stop from cruise speed, 0.5 m/s
/// (`stopping_m`: 0.2 m; 0.1 to 0.25 m beyond the setpoint were flown).
const WALL_KEEP_M: f64 = RADIUS_M + 0.2;
const CEILING_KEEP_M: f64 = 0.15 + 0.2;
/// In a room that is small for that the half in the middle is left.
const MOST_KEEP_SHARE: f64 = 0.25;

impl LimitsConfig {
    /// Writes down what was left to the anchors.
    pub fn resolve(&mut self, survey: &Survey) {
        self.fix(self.volume(survey));
    }

    /// The same for the log of a build whose default was the very box of the anchors, and left the volume
    /// unsaid: later ones write it down.
    pub fn resolve_to_anchors(&mut self, survey: &Survey) {
        self.fix(self.or_box(anchor_box(survey)));
    }

    fn fix(&mut self, Volume { north_m, east_m, height_m }: Volume) {
        self.north_m = Some(north_m);
        self.east_m = Some(east_m);
        self.height_m = Some(height_m);
    }

    /// The volume that setpoints may not leave: as configured, else inside of the anchors by what the
    /// vehicle needs, since anchors hang on walls.
    pub(super) fn volume(&self, survey: &Survey) -> Volume {
        let Volume { north_m, east_m, height_m } = anchor_box(survey);
        let inside = |[low, high]: [f64; 2]| {
            let keep_m = WALL_KEEP_M.min(MOST_KEEP_SHARE * (high - low));
            [low + keep_m, high - keep_m]
        };
        self.or_box(Volume {
            north_m: inside(north_m),
            east_m: inside(east_m),
            height_m: (height_m - CEILING_KEEP_M).max(LEAST_CEILING_M),
        })
    }

    fn or_box(&self, default: Volume) -> Volume {
        Volume {
            north_m: self.north_m.unwrap_or(default.north_m),
            east_m: self.east_m.unwrap_or(default.east_m),
            height_m: self.height_m.unwrap_or(default.height_m),
        }
    }

    /// Says which limits of the battery cannot be those of this pack.
    pub fn check_pack(&self, key: &str, pack: &VoltageConfig, problems: &mut Problems) {
        let (cells, allowed_v) = (pack.cells, pack.limits_v());
        let limits = [
            ("battery_low_v", self.battery_low_v),
            ("battery_critical_v", self.battery_critical_v),
        ];
        for (name, volt) in limits.into_iter().filter(|(_, volt)| !allowed_v.contains(volt)) {
            let cell_v = volt / f64::from(cells.max(1));
            problems.say(format!(
                "{key}.{name} = {volt}: {cell_v:.2} V a cell with control.voltage.cells = {cells}, allowed {:.1} to \
                 {:.1} V for that pack",
                allowed_v.start(),
                allowed_v.end()
            ));
        }
    }

    /// Adds what is out of range to `problems`; `key` is the name of the section.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        for (name, pair) in [("north_m", self.north_m), ("east_m", self.east_m)] {
            if let Some([low, high]) = pair {
                problems.range(format_args!("{key}.{name}[0]"), low, -100.0..=100.0, "m");
                problems.range(format_args!("{key}.{name}[1]"), high, -100.0..=100.0, "m");
                if low >= high {
                    problems.say(format!(
                        "{key}.{name} = [{low}, {high}]: the first must be the smaller one"
                    ));
                }
            }
        }
        if let Some(height_m) = self.height_m {
            problems.range(format_args!("{key}.height_m"), height_m, 0.3..=50.0, "m");
        }
        let mut range = |name: &str, value, low, high, unit| {
            problems.range(format_args!("{key}.{name}"), value, low..=high, unit);
        };
        range("battery_low_v", self.battery_low_v, 3.0, 30.0, "V");
        range("battery_critical_v", self.battery_critical_v, 3.0, self.battery_low_v, "V");
        range("uwb_loss_land_s", self.uwb_loss_land_s, 0.2, 10.0, "s");
        range("board_loss_s", self.board_loss_s, 0.2, 10.0, "s");
        range("offboard_loss_s", self.offboard_loss_s, 0.1, 5.0, "s");
    }
}

/// The smallest box around all anchors, from the floor.
fn anchor_box(survey: &Survey) -> Volume {
    let extent = |axis: usize| {
        let of = |id| survey.position_E_m(id).map_or(0.0, |p| p[axis]);
        let ids = || survey.ids().iter().copied();
        [ids().map(of).fold(f64::INFINITY, f64::min), ids().map(of).fold(-f64::INFINITY, f64::max)]
    };
    let height_m = (-extent(2)[0]).max(LEAST_CEILING_M);
    Volume { north_m: extent(0), east_m: extent(1), height_m }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::frames::Vec3;
    use haltere_core::measure::AnchorId;

    fn room(side_m: f64, ceiling_m: f64) -> Survey {
        let at = |i: u8, bit: u8, far: f64| if i & bit != 0 { far } else { 0.0 };
        let corner = |i: u8| Vec3::new(at(i, 1, side_m), at(i, 2, side_m), -at(i, 4, ceiling_m));
        let anchors: Vec<_> = (0..8).map(|i| (AnchorId(i), corner(i))).collect();
        Survey::new(&anchors).unwrap()
    }

    /// The default was the box of the anchors, which hang on the walls.
    #[test]
    fn regress_the_default_volume_keeps_the_wings_off_the_walls() {
        let check = |survey: &Survey, side: [f64; 2], height_m: f64| {
            let mut limits = LimitsConfig::default();
            limits.resolve(survey);
            let found = [limits.north_m, limits.east_m].map(|range| range.unwrap());
            let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
            assert!(found.iter().all(|r| near(r[0], side[0]) && near(r[1], side[1])), "{found:?}");
            assert!(near(limits.height_m.unwrap(), height_m), "{limits:?}");
        };
        check(&room(10.0, 7.0), [0.45, 9.55], 6.65);
        check(&room(1.6, 2.0), [0.4, 1.2], 1.65);
        check(&room(3.0, 0.9), [0.45, 2.55], LEAST_CEILING_M);
        let mut old = LimitsConfig { height_m: Some(2.0), ..LimitsConfig::default() };
        old.resolve_to_anchors(&room(10.0, 7.0));
        assert_eq!((old.north_m, old.height_m), (Some([0.0, 10.0]), Some(2.0)));
    }
}
