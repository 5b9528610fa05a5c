//! Guidance: what the controller is asked for, from mode, mission and setpoints of clients.

use crate::control::{AxisCommand, Command};
use crate::estimate::Estimate;
use crate::frames::{E, Vec3, wrap_pi_rad};
use crate::time::HostTime;

use super::config::FlightConfig;
use super::excitation::Doublet;
use super::mission::{Mission, MissionItem, Volume};
use super::modes::{Event, Mode};
use super::setpoint::Setpoint;

/// Height error at which a take-off is done, m: the size of the UWB error at that height.
const TAKEOFF_DONE_M: f64 = 0.20;
/// A take-off whose setpoint has arrived is over after this time in any case, s.
const TAKEOFF_PATIENCE_S: f64 = 4.0;

/// A setpoint that moves along a straight leg with limited speed and acceleration.
#[derive(Debug, Clone, Copy)]
struct Carrot {
    pos_E_m: Vec3<E>,
    target_E_m: Vec3<E>,
    speed_mps: f64,
}

impl Carrot {
    fn resting(pos_E_m: Vec3<E>) -> Self {
        Self { pos_E_m, target_E_m: pos_E_m, speed_mps: 0.0 }
    }

    fn has_arrived(&self) -> bool {
        self.pos_E_m == self.target_E_m
    }

    /// Moves on; the velocity it moves with, Earth frame, m/s.
    fn advance(&mut self, top_speed_mps: f64, acceleration_mps2: f64, dt_s: f64) -> Vec3<E> {
        let way = self.target_E_m - self.pos_E_m;
        let distance_m = way.norm();
        let braking_mps = (2.0 * acceleration_mps2 * distance_m).sqrt();
        let faster_mps = self.speed_mps + acceleration_mps2 * dt_s;
        self.speed_mps = top_speed_mps.min(braking_mps).min(faster_mps);
        let stride_m = self.speed_mps * dt_s;
        if distance_m <= stride_m.max(1e-6) {
            *self = Self::resting(self.target_E_m);
            return Vec3::zero();
        }
        let direction = way * (1.0 / distance_m);
        self.pos_E_m += direction * stride_m;
        direction * self.speed_mps
    }
}

/// What a step of guidance has to tell besides the command.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct News {
    /// Something that may change the mode.
    pub event: Option<Event>,
    /// Mission items that were reached.
    pub reached: Option<u16>,
    /// A doublet under way, and the time since its start, s.
    pub doublet: Option<(Doublet, f64)>,
}

/// Guidance state.
#[derive(Debug)]
pub(super) struct Guidance {
    config: FlightConfig,
    volume: Volume,
    /// At or above this speed the setpoint jumps, m/s.
    jump_speed_mps: f64,
    carrot: Carrot,
    /// Speed on legs, m/s.
    leg_speed_mps: f64,
    yaw_rad: f64,
    /// Place of take-off, Earth frame, m.
    home_E_m: Vec3<E>,
    entered_at: HostTime,
    arrived_at: Option<HostTime>,
    takeoff_height_m: f64,
    /// The mission starts when the take-off is done.
    pub mission_waits: bool,
    /// Index of the item in force.
    pub current_item: u16,
    item_started: bool,
    /// The item in force was jumped to: the leg under way belongs to another one.
    jumped: bool,
    /// What a client wants in Offboard mode.
    pub setpoint: Option<Setpoint>,
}

impl Guidance {
    pub fn new(
        config: FlightConfig,
        volume: Volume,
        velocity_limit_mps: f64,
        at: HostTime,
    ) -> Self {
        Self {
            leg_speed_mps: config.cruise_speed_mps,
            takeoff_height_m: config.takeoff_height_m,
            config,
            volume,
            jump_speed_mps: velocity_limit_mps,
            carrot: Carrot::resting(Vec3::zero()),
            yaw_rad: 0.0,
            home_E_m: Vec3::zero(),
            entered_at: at,
            arrived_at: None,
            mission_waits: false,
            current_item: 0,
            item_started: false,
            jumped: false,
            setpoint: None,
        }
    }

    pub fn volume(&self) -> &Volume {
        &self.volume
    }

    /// Height of the next take-off, m.
    pub fn set_takeoff_height(&mut self, height_m: f64) {
        self.takeoff_height_m = height_m.clamp(0.3, self.volume.height_m);
    }

    /// Starts a leg to a point.
    pub fn fly_to(&mut self, pos_E_m: Vec3<E>, yaw_rad: Option<f64>) {
        let target_E_m = self.volume.clamp(pos_E_m);
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

    /// Yaw setpoint from room north, rad.
    pub fn set_yaw(&mut self, yaw_rad: f64) {
        self.yaw_rad = wrap_pi_rad(yaw_rad);
    }

    /// Jumps within the mission.
    pub fn set_current_item(&mut self, index: u16) {
        self.current_item = index;
        self.item_started = false;
        self.jumped = true;
    }

    /// Called once when a mode begins.
    pub fn enter(&mut self, mode: Mode, estimate: &Estimate, at: HostTime) {
        self.entered_at = at;
        self.arrived_at = None;
        match mode {
            Mode::Spool => {
                self.home_E_m = Vec3::new(estimate.pos_E_m.x(), estimate.pos_E_m.y(), 0.0);
                self.carrot = Carrot::resting(self.home_E_m);
                self.yaw_rad = estimate.R_EB.yaw_rad();
                self.set_leg_speed(None);
            }
            Mode::Takeoff => {
                let mut target = self.carrot.pos_E_m.to_array();
                target[2] = -self.takeoff_height_m;
                self.carrot.target_E_m = Vec3::from_array(target);
            }
            Mode::Hold
                // A leg that has arrived is held where it ends: no step from estimate noise.
                if (!self.carrot.has_arrived() || self.is_far_from_carrot(estimate)) => {
                    self.carrot = Carrot::resting(self.volume.clamp(estimate.pos_E_m));
                }
            Mode::Mission => {
                self.item_started = false;
                self.set_leg_speed(None);
                self.start_from_here(estimate);
            }
            Mode::Goto => self.start_from_here(estimate),
            Mode::Return => {
                self.set_leg_speed(None);
                let height = self.carrot.pos_E_m.z().min(estimate.pos_E_m.z());
                self.carrot = Carrot::resting(self.volume.clamp(estimate.pos_E_m));
                self.fly_to(Vec3::new(self.home_E_m.x(), self.home_E_m.y(), height), None);
            }
            Mode::Land
                if (self.is_far_from_carrot(estimate) || !self.carrot.has_arrived()) => {
                    self.carrot = Carrot::resting(estimate.pos_E_m);
                }
            _ => {}
        }
    }

    /// A leg that begins after a landing or a disturbance begins where the vehicle is.
    fn start_from_here(&mut self, estimate: &Estimate) {
        if self.is_far_from_carrot(estimate) {
            self.carrot = Carrot::resting(self.volume.clamp(estimate.pos_E_m));
        }
    }

    fn is_far_from_carrot(&self, estimate: &Estimate) -> bool {
        (estimate.pos_E_m - self.carrot.pos_E_m).norm() > 2.0 * self.config.acceptance_radius_m
    }

    /// One control step: the command, and what happened.
    pub fn step(
        &mut self,
        mode: Mode,
        mission: &Mission,
        estimate: &Estimate,
        at: HostTime,
        dt_s: f64,
        offboard_loss_s: f64,
    ) -> (Command, News) {
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
                        news.event = Some(if !self.mission_waits || mission.items.is_empty() {
                            Event::HeightReached
                        } else {
                            Event::HeightReachedWithMission
                        });
                    }
                }
                (self.position_command(vel), news)
            }
            Mode::Mission => {
                self.mission_step(mission, estimate, at, &mut news);
                let vel = self.advance_leg(dt_s);
                (self.position_command(vel), news)
            }
            Mode::Return => {
                let vel = self.advance_leg(dt_s);
                let over_home = self.carrot.has_arrived() && !self.is_far_from_carrot(estimate);
                if over_home && self.arrived_since_s(at) > 1.0 {
                    news.event = Some(Event::HomeReached);
                }
                (self.position_command(vel), news)
            }
            Mode::Land => {
                let height_m = -estimate.pos_E_m.z() - self.config.gear_height_m;
                let sink_mps = if height_m > self.config.land_slow_height_m {
                    self.config.land_speed_mps
                } else {
                    self.config.land_slow_speed_mps
                };
                let mut command = self.position_command(Vec3::zero());
                command.axes[2] = AxisCommand::Velocity_mps(sink_mps);
                (command, news)
            }
            Mode::Offboard => {
                let Some(setpoint) = &self.setpoint else {
                    news.event = Some(Event::OffboardSilent);
                    return (self.position_command(Vec3::zero()), news);
                };
                let age_s = at.seconds_since(setpoint.received_at);
                if age_s > offboard_loss_s && setpoint.needs_stream() {
                    news.event = Some(Event::OffboardSilent);
                }
                let command = setpoint.command(estimate, &self.volume, &mut self.yaw_rad, dt_s);
                // Where Hold would stay.
                self.carrot = Carrot::resting(self.volume.clamp(estimate.pos_E_m));
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

    /// Works on the item in force: one item a step.
    fn mission_step(
        &mut self,
        mission: &Mission,
        estimate: &Estimate,
        at: HostTime,
        news: &mut News,
    ) {
        let Some(stored) = mission.items.get(usize::from(self.current_item)) else {
            news.event = Some(Event::MissionDone);
            return;
        };
        let first_look = !self.item_started;
        self.item_started = true;
        if std::mem::take(&mut self.jumped) && !self.carrot.has_arrived() {
            self.carrot = Carrot::resting(self.carrot.pos_E_m);
        }
        let near = |target: Vec3<E>, radius_m: f64| (estimate.pos_E_m - target).norm() < radius_m;
        let default_radius_m = self.config.acceptance_radius_m;
        let done = match stored.item {
            MissionItem::Takeoff { height_m } => {
                if first_look {
                    let here = self.carrot.pos_E_m;
                    self.fly_to(Vec3::new(here.x(), here.y(), -height_m), None);
                }
                self.carrot.has_arrived() && near(self.carrot.target_E_m, default_radius_m)
            }
            MissionItem::Waypoint { pos_E_m, hold_s, acceptance_m, yaw_rad } => {
                if first_look {
                    self.fly_to(pos_E_m, yaw_rad);
                }
                let radius_m = acceptance_m.unwrap_or(default_radius_m);
                let there = self.arrived_at.is_some()
                    || (self.carrot.has_arrived() && near(self.carrot.target_E_m, radius_m));
                if there && self.arrived_at.is_none() {
                    news.reached = Some(self.current_item);
                }
                there && self.arrived_since_s(at) >= hold_s
            }
            MissionItem::Delay { duration_s } => {
                if first_look {
                    self.arrived_at = None;
                }
                self.arrived_since_s(at) >= duration_s
            }
            MissionItem::Speed { speed_mps } => {
                self.set_leg_speed(speed_mps);
                true
            }
            MissionItem::Yaw { yaw_rad } => {
                self.yaw_rad = wrap_pi_rad(yaw_rad);
                true
            }
            MissionItem::Doublet(doublet) => {
                if first_look {
                    self.arrived_at = None;
                }
                let elapsed_s = self.arrived_since_s(at);
                news.doublet = Some((doublet, elapsed_s));
                elapsed_s >= doublet.length_s()
            }
            MissionItem::Return => {
                news.event = Some(Event::ReturnAsked);
                true
            }
            MissionItem::Land { pos_E_m } => {
                if first_look && let Some(pos) = pos_E_m {
                    let height = self.carrot.pos_E_m.z();
                    self.fly_to(Vec3::new(pos.x(), pos.y(), height), None);
                }
                let there = pos_E_m.is_none()
                    || (self.carrot.has_arrived()
                        && near(self.carrot.target_E_m, 2.0 * default_radius_m));
                if there {
                    news.event = Some(Event::LandAsked);
                }
                there
            }
        };
        if done {
            if !matches!(stored.item, MissionItem::Waypoint { .. }) {
                news.reached = Some(self.current_item);
            }
            self.current_item += 1;
            self.item_started = false;
            self.arrived_at = None;
        }
    }
}
