//! Configuration of the pilot core: flight behaviour and limits.

use serde::{Deserialize, Serialize};

use crate::navigation::uwb::UwbConfig;
use haltere_core::checks::Problems;
use haltere_core::control::ControlConfig;
use haltere_core::control::voltage::VoltageConfig;
use haltere_core::estimate::Estimate;
use haltere_core::estimator::{EstimatorConfig, UwbNoise};
use haltere_core::keys::{Key, NoNumber, Range, Row, Section, Told, Value, When};
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

    /// The filter with the enhancements that `[control]` switches on: version `raw` flies on IMU and UWB alone, without
    /// drag term and with constant UWB noise, whatever `[estimator]` says. Learned errors of the UWB
    /// replace what it says of them by default; what it was told stays.
    pub fn estimator_in_force(&self) -> EstimatorConfig {
        let on = self.control.enhancements();
        let mut estimator = self.estimator.clone();
        if on.learned_uwb_errors {
            estimator = estimator.learned_uwb_errors();
        }
        estimator.drag &= on.filter_drag;
        estimator.board_vertical.fuse &= on.filter_aids;
        estimator.baro.fuse &= on.filter_aids;
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

/// Of `[ground]`, since each vehicle of a station has its own.
const SYSTEM_ID: Key = Key {
    name: "system_id",
    text: &[" System that the vehicle is; each of one station has its own."],
    kind: u8::kind,
    range: Some(Range { low: 1.0, high: 250.0, unit: "", checked: true }),
    example: "",
    of_vehicle: false,
    parameters: &[Told { index: 0, name: "MAV_SYS_ID", when: When::Restart, text: "" }],
};

/// What stations know as parameters, under the names that the keys have in files.
macro_rules! told {
    ($($section:ident: $type:ty),+) => {
        impl Section for PilotConfig {
            fn rows(_: &str, tell: &mut dyn FnMut(&str, Row)) {
                tell("ground", Row::Key(&SYSTEM_ID));
                $(<$type>::rows(stringify!($section), tell);)+
            }

            fn value(&self, key: &str) -> Option<&dyn Value> {
                match key.split_once('.')? {
                    ("ground", "system_id") => Some(&self.system_id),
                    $((stringify!($section), inner) => self.$section.value(inner),)+
                    _ => None,
                }
            }

            fn value_mut(&mut self, key: &str) -> Option<&mut dyn Value> {
                match key.split_once('.')? {
                    ("ground", "system_id") => Some(&mut self.system_id),
                    $((stringify!($section), inner) => self.$section.value_mut(inner),)+
                    _ => None,
                }
            }
        }

        impl PilotConfig {
            /// Adds what the checks of these sections say.
            pub fn check(&self, problems: &mut Problems) {
                $(self.$section.check(stringify!($section), problems);)+
            }
        }
    };
}
told! {
    flight: FlightConfig,
    limits: LimitsConfig,
    supervisor: SupervisorConfig,
    uwb: UwbConfig,
    estimator: EstimatorConfig,
    control: ControlConfig
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
    /// A Loco deck on the Crazyflie that is the board: it has no line of its own.
    Crazyflie,
}

impl NoNumber for TagProtocol {}
impl NoNumber for BoardProfile {}

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
    /// A Crazyflie or a Flapper's own board, over CRTP.
    Crazyflie,
}

haltere_core::keys! {
    /// `[flight]`: how the vehicle takes off, moves and lands.
    pub struct FlightConfig {
        /// Height of a take-off that names none.
        takeoff_height_m: f64 = 1.0, [0.3..=20.0, "m"], FLT_TKO_HGT(1, AtOnce);
        /// Speed of the height setpoint in a take-off.
        takeoff_speed_mps: f64 = 0.5, [0.1..=2.0, "m/s"], FLT_TKO_SPD(2, AtOnce);
        /// Time in which thrust rises from nothing to just below hover.
        spool_s: f64 = 1.0, [0.2..=5.0, "s"], FLT_SPOOL_T(3, OnFloor);
        /// Speed of the setpoint along mission legs. At or above the controller's velocity limit the setpoint jumps
        /// instead of moving.
        // A mission may change it.
        cruise_speed_mps: f64 = 0.5, [0.05..=10.0, "m/s"],
            FLT_CRUISE_SPD(4, AtOnce, "Speed along mission legs. At or above CLM_HOR_SPD the setpoint jumps.");
        /// Change of the leg speed at the ends of a leg.
        cruise_acceleration_mps2: f64 = 0.7, [0.05..=5.0, "m/s²"], FLT_CRUISE_ACC(5, AtOnce);
        /// Sinking speed in a landing above land_slow_height_m.
        land_speed_mps: f64 = 0.4, [0.1..=1.5, "m/s"],
            FLT_LAND_SPD(6, AtOnce, "Sinking speed in a landing above FLT_LAND_SLWHGT.");
        /// Sinking speed near the floor.
        land_slow_speed_mps: f64 = 0.25, [0.05..=1.0, "m/s"], FLT_LAND_SLWSPD(7, AtOnce);
        /// Height below which a landing slows down.
        land_slow_height_m: f64 = 0.6, [0.0..=5.0, "m"], FLT_LAND_SLWHGT(8, AtOnce);
        /// Distance at which a waypoint counts as reached when it names none.
        acceptance_radius_m: f64 = 0.30, [0.05..=5.0, "m"], FLT_ACC_RAD(10, AtOnce);
        /// Least height of a return. 0: it flies at the height it has.
        return_height_m: f64 = 0.0, [0.0..=20.0, "m"], FLT_RTN_HGT(9, AtOnce);
        /// Height of the feet below the point that is tracked.
        gear_height_m: f64 = 0.0, [0.0..=0.5, "m"], @vehicle, FLT_GEAR_HGT(11, OnFloor);
        /// Time armed on the floor after which the vehicle disarms.
        idle_disarm_s: f64 = 15.0, [2.0..=600.0, "s"], FLT_IDLE_T(12, AtOnce);
        /// Watch a vehicle that somebody else flies, as `haltere fly --shadow`: estimate, record what would be sent,
        /// send nothing that arms or moves.
        shadow: bool = false;
        /// Whether nothing arms while flights are not recorded, as on a full disk.
        ///
        /// Without, that is told and flown.
        log_required: bool = false, FLT_LOG_REQ(13, AtOnce);
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
}

haltere_core::keys! {
    /// `[limits]`: the volume that setpoints may not leave, and the battery.
    pub struct LimitsConfig {
        /// Lowest and highest room-north coordinate of a setpoint. Left out: 0.45 m inside the anchors' extent, which
        /// are the wings and the way to stop.
        north_m: Option<[f64; 2]> = None, [-100.0..=100.0, "m"], {"[0.0, 5.0]"},
            LIM_NORTH_MIN(14, OnFloor, "Lowest room-north coordinate of a setpoint."),
            LIM_NORTH_MAX(15, OnFloor, "Highest room-north coordinate of a setpoint.");
        /// The same for room east.
        east_m: Option<[f64; 2]> = None, [-100.0..=100.0, "m"], {"[0.0, 5.0]"},
            LIM_EAST_MIN(16, OnFloor, "Lowest room-east coordinate of a setpoint."),
            LIM_EAST_MAX(17, OnFloor, "Highest room-east coordinate of a setpoint.");
        /// Highest height of a setpoint above the floor.
        ///
        /// Left out: 0.35 m below the highest anchor.
        height_m: Option<f64> = None, [0.3..=50.0, "m"], {"3.0"}, LIM_HEIGHT_MAX(18, OnFloor);
        /// Voltage below which a warning is sent and arming refused.
        // 6.4 V for two cells (VEHICLE.md).
        battery_low_v: f64 = 6.4, [3.0..=30.0, "V"], LIM_BAT_LOW(19, AtOnce);
        /// Voltage below which the vehicle lands, 3 V to battery_low_v.
        // 6.0 V for two cells (VEHICLE.md).
        battery_critical_v: f64 = 6.0, ~[3.0..=30.0, "V"],
            LIM_BAT_CRIT(20, AtOnce, "Voltage below which the vehicle lands. At most LIM_BAT_LOW.");
        /// Age of the newest UWB measurement after which the vehicle lands.
        uwb_loss_land_s: f64 = 1.0, [0.2..=10.0, "s"], LIM_UWB_LOSS_T(21, AtOnce);
        /// Silence of the board after which its link counts as lost.
        board_loss_s: f64 = 1.0, [0.2..=10.0, "s"], LIM_BRD_LOSS_T(22, AtOnce);
        /// Silence of an offboard client after which a velocity setpoint ends in Hold.
        offboard_loss_s: f64 = 0.5, [0.1..=5.0, "s"], LIM_OFB_LOSS_T(46, AtOnce);
    } rules joined;
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

    fn joined(&self, key: &str, problems: &mut Problems) {
        for (name, pair) in [("north_m", self.north_m), ("east_m", self.east_m)] {
            if let Some([low, high]) = pair
                && low >= high
            {
                problems.say(format!(
                    "{key}.{name} = [{low}, {high}]: the first must be the smaller one"
                ));
            }
        }
        let allowed_v = 3.0..=self.battery_low_v;
        let critical_v = self.battery_critical_v;
        problems.range(format_args!("{key}.battery_critical_v"), critical_v, allowed_v, "V");
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
