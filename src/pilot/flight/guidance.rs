//! Guidance: what the controller is asked for, from mode, mission and setpoints of clients.

mod carrot;
mod enter;
mod held_tilt;
mod items;

use haltere_core::control::{AxisCommand, Command, HeldTilt};
use haltere_core::estimate::Estimate;
use haltere_core::frames::{E, Vec3, wrap_pi_rad};
use haltere_core::time::HostTime;

use super::awaited::{Climb, Next};
use super::excitation::Doublet;
use super::fence::Fence;
use super::landing_ramp::LandingRamp;
use super::mission::{Mission, Volume};
use super::modes::{Event, Mode};
use super::setpoint::{Setpoint, rests_at_E_m};
use super::tilt_step::{Envelope, TiltRun};
use crate::config::FlightConfig;
use carrot::Carrot;

/// Height error at which a take-off is done, m: the size of the UWB error at that height.
const TAKEOFF_DONE_M: f64 = 0.20;
/// A take-off whose setpoint has arrived is over after this time in any case, s.
const TAKEOFF_PATIENCE_S: f64 = 4.0;
/// How far above the estimate the point of a take-off may be, m: with the position gain of 1.5 1/s some 0.08 m/s beside
/// the speed of the point.
const CLIMB_LEAD_M: f64 = 0.05;
/// Time constant of the position loop, s: the default gain of 1.5 1/s, rounded down.
const POSITION_LOOP_S: f64 = 0.6;

/// What a step of guidance has to tell besides the command.
#[derive(Debug, Default, Clone, PartialEq)]
pub(crate) struct News {
    /// Something that may change the mode.
    pub event: Option<Event>,
    /// Mission items that were reached.
    pub reached: Option<u16>,
    /// A doublet under way, and the time since its start, s.
    pub doublet: Option<(Doublet, f64)>,
    /// A tilt that is held instead of what the position loop wants.
    pub held: Option<HeldTilt>,
    /// For people.
    pub warning: Option<String>,
}

/// What a step of guidance depends on besides mode and mission.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Now<'a> {
    pub estimate: &'a Estimate,
    /// Battery voltage, if a fresh one is known, V.
    pub supply_v: Option<f64>,
    pub at: HostTime,
    pub dt_s: f64,
    /// Where the vehicle may be.
    pub fence: &'a Fence,
    /// Least speed of a return, m/s.
    pub return_mps: f64,
}

/// Guidance state.
#[derive(Debug)]
pub(crate) struct Guidance {
    config: FlightConfig,
    /// Volume, and what angle steps are checked against.
    pub envelope: Envelope,
    /// At or above this speed the setpoint jumps, m/s.
    jump_speed_mps: f64,
    carrot: Carrot,
    ramp: LandingRamp,
    /// Speed on legs, m/s.
    leg_speed_mps: f64,
    yaw_rad: f64,
    /// Place of take-off, Earth frame, m.
    home_E_m: Vec3<E>,
    /// Home was set by hand: take-offs leave it.
    home_is_set: bool,
    entered_at: HostTime,
    arrived_at: Option<HostTime>,
    takeoff_height_m: f64,
    /// What follows the take-off.
    pub next: Next,
    /// Index of the item in force.
    pub current_item: u16,
    item_started: bool,
    /// The item after which the mission ends, where a client named one.
    pub last_item: Option<u16>,
    /// The item in force is a landing, or a return, that is under way: done when the vehicle stands.
    pub landing: bool,
    /// The item in force was jumped to: the leg under way belongs to another one.
    jumped: bool,
    tilt: Option<TiltRun>,
    /// Since when a voltage is waited for.
    wait_since: HostTime,
    /// Average of that voltage, V.
    waited_v: Option<f64>,
    /// The item in force was refused in flight.
    refused: bool,
    /// Places to return to beside home, N and E, m.
    rally_NE_m: Vec<[f64; 2]>,
    /// The return that began found no place to go to.
    no_way_home: bool,
    /// Jumps of the mission that were made: index of the item, how often.
    jumps_made: Vec<(u16, u32)>,
    /// What a client wants in Offboard mode.
    pub setpoint: Option<Setpoint>,
    /// The climb by rate that is under way.
    pub climb: Option<Climb>,
    /// What a joystick wants in Manual mode.
    pub sticks: Option<Setpoint>,
}

impl Guidance {
    pub fn new(
        config: FlightConfig,
        envelope: Envelope,
        velocity_limit_mps: f64,
        at: HostTime,
    ) -> Self {
        Self {
            leg_speed_mps: config.cruise_speed_mps,
            takeoff_height_m: config.takeoff_height_m,
            config,
            envelope,
            jump_speed_mps: velocity_limit_mps,
            carrot: Carrot::resting(Vec3::zero()),
            ramp: LandingRamp::default(),
            yaw_rad: 0.0,
            home_E_m: Vec3::zero(),
            home_is_set: false,
            entered_at: at,
            arrived_at: None,
            next: Next::Nothing,
            current_item: 0,
            item_started: false,
            last_item: None,
            landing: false,
            jumped: false,
            tilt: None,
            wait_since: at,
            waited_v: None,
            refused: false,
            rally_NE_m: Vec::new(),
            no_way_home: false,
            jumps_made: Vec::new(),
            setpoint: None,
            climb: None,
            sticks: None,
        }
    }

    pub fn volume(&self) -> &Volume {
        &self.envelope.volume
    }

    /// Height of the next take-off, m.
    pub fn set_takeoff_height(&mut self, height_m: f64) {
        self.takeoff_height_m = height_m.clamp(0.3, self.envelope.volume.height_m);
    }

    /// Height of the take-off that is under way or comes next, m.
    pub fn takeoff_height_m(&self) -> f64 {
        self.takeoff_height_m
    }

    /// Starts a leg to a point.
    pub fn fly_to(&mut self, pos_E_m: Vec3<E>, yaw_rad: Option<f64>) {
        let target_E_m = self.envelope.volume.clamp(pos_E_m);
        self.carrot.target_E_m = target_E_m;
        if self.leg_speed_mps >= self.jump_speed_mps {
            self.carrot = Carrot::resting(target_E_m);
        }
        self.arrived_at = None;
        if let Some(yaw_rad) = yaw_rad {
            self.yaw_rad = wrap_pi_rad(yaw_rad);
        }
    }

    /// Speed on the legs that follow; `None`: the configured one.
    pub fn set_leg_speed(&mut self, speed_mps: Option<f64>) {
        self.leg_speed_mps = speed_mps.unwrap_or(self.config.cruise_speed_mps);
    }

    /// Where the vehicle returns to, on the floor.
    pub fn home_E_m(&self) -> Vec3<E> {
        self.home_E_m
    }

    /// Home by hand.
    pub fn set_home(&mut self, home_E_m: Vec3<E>) {
        self.home_E_m = Vec3::new(home_E_m.x(), home_E_m.y(), 0.0);
        self.home_is_set = true;
    }

    /// Whether home was set by hand.
    pub fn home_is_set(&self) -> bool {
        self.home_is_set
    }

    /// Home is where the vehicle stands, unless it was set by hand.
    pub fn home_is_here(&mut self, pos_E_m: Vec3<E>) {
        if !self.home_is_set {
            self.home_E_m = Vec3::new(pos_E_m.x(), pos_E_m.y(), 0.0);
        }
    }

    /// Where the leg under way ends, or what is held.
    pub fn goal_E_m(&self) -> Vec3<E> {
        self.carrot.target_E_m
    }

    /// Yaw setpoint from room north, rad.
    pub fn set_yaw(&mut self, yaw_rad: f64) {
        self.yaw_rad = wrap_pi_rad(yaw_rad);
    }

    /// The configuration changed: legs go on, with the new speeds.
    pub fn reconfigure(
        &mut self,
        config: FlightConfig,
        envelope: Envelope,
        velocity_limit_mps: f64,
    ) {
        if self.leg_speed_mps == self.config.cruise_speed_mps {
            self.leg_speed_mps = config.cruise_speed_mps;
        }
        self.config = config;
        self.envelope = envelope;
        self.jump_speed_mps = velocity_limit_mps;
    }

    /// Places to return to beside home, N and E, m.
    pub fn set_rally_points(&mut self, rally_NE_m: Vec<[f64; 2]>) {
        self.rally_NE_m = rally_NE_m;
    }

    /// Another mission is in force: from its first item.
    pub fn new_mission(&mut self) {
        self.jumps_made.clear();
        self.last_item = None;
        self.set_current_item(0);
    }

    /// Of home and the rally points the nearest to which a straight way leads that the fence allows, N and E,
    /// m. `None`: there is none.
    pub fn nearest_refuge_NE_m(&self, from_E_m: Vec3<E>, fence: &Fence) -> Option<[f64; 2]> {
        let from = [from_E_m.x(), from_E_m.y()];
        let far = |[north, east]: [f64; 2]| (north - from[0]).hypot(east - from[1]);
        self.refuges_NE_m().fold(None, |nearest, place| {
            let is_nearer = nearest.is_none_or(|found| far(place) < far(found));
            if is_nearer && fence.allows_way(from, place) { Some(place) } else { nearest }
        })
    }

    /// Home and the rally points, N and E, m; a vehicle that stood outside of the volume returns to its edge.
    pub fn refuges_NE_m(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        let home = self.envelope.volume.clamp(self.home_E_m);
        std::iter::once([home.x(), home.y()]).chain(self.rally_NE_m.iter().copied())
    }

    /// Jumps within the mission.
    pub fn set_current_item(&mut self, index: u16) {
        if index == 0 {
            // From the start: jumps count anew.
            self.jumps_made.clear();
        }
        self.current_item = index;
        self.item_started = false;
        self.landing = false;
        self.jumped = true;
    }

    /// The landing of the mission is over: its item, which is done. `None`: the landing is not the mission's.
    pub fn landed(&mut self) -> Option<u16> {
        let item = self.current_item;
        std::mem::take(&mut self.landing).then(|| {
            self.current_item = item.saturating_add(1);
            item
        })
    }

    /// Distance from the point that is held or that moves along its leg, m. `None` where the setpoint
    /// jumps, or none is followed.
    pub fn off_course_m(&self, estimate: &Estimate) -> Option<f64> {
        let follows = self.leg_speed_mps < self.jump_speed_mps && self.tilt.is_none();
        follows.then(|| (estimate.pos_E_m - self.carrot.pos_E_m).norm())
    }

    fn is_far_from_carrot(&self, estimate: &Estimate) -> bool {
        (estimate.pos_E_m - self.carrot.pos_E_m).norm() > 2.0 * self.config.acceptance_radius_m
    }

    /// One control step: the command, and what happened.
    pub fn step(&mut self, mode: Mode, mission: &Mission, now: &Now<'_>) -> (Command, News) {
        let Now { estimate, at, dt_s, .. } = *now;
        let mut news = News::default();
        match mode {
            Mode::Takeoff => {
                let vel = self.carrot.advance(self.config.takeoff_speed_mps, 1.0, dt_s);
                if self.carrot.has_arrived() {
                    let since = self.arrived_since_s(at);
                    let error_m = (estimate.pos_E_m.z() - self.carrot.pos_E_m.z()).abs();
                    let is_up = error_m < TAKEOFF_DONE_M;
                    if since > TAKEOFF_PATIENCE_S && error_m > 0.5 * self.takeoff_height_m {
                        news.event = Some(Event::NotLifted);
                    } else if is_up || since > TAKEOFF_PATIENCE_S {
                        news.event =
                            Some(if self.next != Next::Mission || mission.items.is_empty() {
                                Event::HeightReached
                            } else {
                                Event::HeightReachedWithMission
                            });
                    }
                }
                (self.climb_command(vel, estimate), news)
            }
            Mode::Mission => {
                self.mission_step(mission, now, &mut news);
                let vel = self.advance_leg(dt_s);
                let mut command = self.position_command(vel);
                if let Some(held) = news.held {
                    self.keep_line(&mut command, held, estimate);
                }
                (command, news)
            }
            Mode::Return => {
                self.leg_speed_mps = self.leg_speed_mps.max(now.return_mps);
                let vel = self.advance_leg(dt_s);
                let over_home = self.carrot.has_arrived() && !self.is_far_from_carrot(estimate);
                if self.no_way_home {
                    news.event = Some(Event::NoWayHome);
                } else if over_home && self.arrived_since_s(at) > 1.0 {
                    news.event = Some(Event::HomeReached);
                }
                (self.position_command(vel), news)
            }
            Mode::Land => {
                let height_m = -estimate.pos_E_m.z() - self.config.gear_height_m;
                let sink_mps = if height_m > self.config.land_slow_height_m {
                    self.ramp.rest();
                    self.config.land_speed_mps
                } else {
                    self.ramp.sink_mps(height_m, self.config.land_slow_speed_mps, dt_s)
                };
                let mut command = self.position_command(Vec3::zero());
                command.axes[2] = AxisCommand::Velocity_mps(sink_mps);
                (command, news)
            }
            Mode::Offboard | Mode::Manual => {
                let manual = mode == Mode::Manual;
                // Silence is the supervisor's matter.
                let followed = if manual { &self.sticks } else { &self.setpoint };
                let Some(setpoint) = followed else {
                    return (self.position_command(Vec3::zero()), news);
                };
                let command =
                    setpoint.command(estimate, &self.envelope.volume, &mut self.yaw_rad, dt_s);
                // Where Hold would stay.
                self.carrot = Carrot::resting(self.envelope.volume.clamp(rests_at_E_m(estimate)));
                (command, news)
            }
            _ => {
                let vel = self.advance_leg(dt_s);
                (self.position_command(vel), news)
            }
        }
    }

    fn arrived_since_s(&mut self, at: HostTime) -> f64 {
        at.seconds_since(*self.arrived_at.get_or_insert(at))
    }

    fn advance_leg(&mut self, dt_s: f64) -> Vec3<E> {
        self.carrot.advance(self.leg_speed_mps, self.config.cruise_acceleration_mps2, dt_s)
    }

    /// The command of a take-off: to the point that climbs, and no faster than that point climbs. Near the
    /// floor, where low anchors are hidden, height and speed are estimated late; who hurries after the point
    /// then climbs twice as fast, and no board catches that when setpoints stop.
    fn climb_command(&self, vel_ff_E_mps: Vec3<E>, estimate: &Estimate) -> Command {
        let mut command = self.position_command(vel_ff_E_mps);
        // What of the speed the point does not have itself, the position loop may ask for.
        let spare_mps = (self.config.takeoff_speed_mps + vel_ff_E_mps.z()).max(0.0);
        let highest_z_m = estimate.pos_E_m.z() - CLIMB_LEAD_M - spare_mps * POSITION_LOOP_S;
        command.axes[2] = AxisCommand::Position_m(self.carrot.pos_E_m.z().max(highest_z_m));
        command
    }

    fn position_command(&self, vel_ff_E_mps: Vec3<E>) -> Command {
        let pos = self.carrot.pos_E_m;
        Command {
            axes: [
                AxisCommand::Position_m(pos.x()),
                AxisCommand::Position_m(pos.y()),
                AxisCommand::Position_m(pos.z()),
            ],
            vel_ff_E_mps,
            yaw_rad: self.yaw_rad,
        }
    }
}
