//! Somebody at a station during a flight: starts the mission, and orders what a fault of the catalogue says.
//!
//! Nothing waits: answers are read as they come, while the judge looks at every step. An order is a short
//! script; where it is over and the vehicle still flies by it, it is told to land, so that every flight ends.

use std::collections::VecDeque;

use haltere_dialect::mav::haltere::{
    MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMessage, MavMissionResult,
    MavMissionType, PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use haltere_dialect::mav::{command_int, command_long, known};
use haltere_model::Truth;
use haltere_model::lockstep::{Ground, Lockstep, VEHICLE, local_item};
use haltere_pilot::mission_file::{Command as ItemCommand, Item};

use super::judge::{Fence, Forbidden};
use super::takeoff::{HEIGHT_M, TakeOff};
use crate::simulated::faults::{Order, Shape, Way, failure_number};

/// Numbers of the mode "offboard" as stations write it (PX4's).
const OFFBOARD: [f32; 3] = [1.0, 6.0, 0.0];
/// Positions only, in SET_POSITION_TARGET_LOCAL_NED.
const POSITION_MASK: u16 = 0xDF8;
/// Velocities only.
const VELOCITY_MASK: u16 = 0xDC7;
/// A take-off by a rate climbs so fast, m/s; it is then held for so long before it lands, s.
const CLIMB_MPS: f64 = 0.6;
const STAY_S: f64 = 10.0;
/// A client sends its setpoints so often, µs.
const STREAM_US: u64 = 100_000;
/// It does so for this long before it asks for the mode, s.
const STREAM_FIRST_S: f64 = 0.5;
/// An answer to a fence comes within this time or not at all, µs.
const PATIENCE_US: u64 = 2_000_000;
/// So long an order is watched before the vehicle is told to land, s.
const WATCH_S: f64 = 25.0;
/// Room that a vehicle is left between itself and a fence that is drawn before it, m: more than the estimate errs by.
const CLEAR_M: f64 = 0.5;
/// Largest radius of what is drawn, m.
const RADIUS_M: f64 = 0.8;
/// Smaller ones are not drawn, m.
const LEAST_RADIUS_M: f64 = 0.25;
/// How far a place is that is asked for, m, and how far from the border of the volume.
const AWAY_M: f64 = 3.0;
const FROM_BORDER_M: f64 = 1.0;
/// How far outside a forbidden place is, m.
const BEYOND_M: f64 = 1.5;
/// Time to come to a stop, s.
const STOP_S: f64 = 2.0;
/// Time to get away, s.
const GO_AWAY_S: f64 = 8.0;

/// A place seen from above: room north and east, m.
type Place = [f64; 2];

/// What a client asks for.
#[derive(Debug, Clone, Copy)]
enum Asked {
    Place([f64; 3]),
    Velocity([f64; 3]),
}

/// A step of a script.
#[derive(Debug, Clone)]
enum Step {
    /// Nothing, for so long, s.
    Wait(f64),
    /// A message goes out.
    Send(Box<MavMessage>),
    /// This is drawn as the fence.
    Draw(Forbidden),
    /// A client asks for this place (E, m) or velocity (E, m/s) from now on; `None`: no more.
    Stream(Option<Asked>),
    /// What this order needs next is worked out from where the vehicle then is.
    Go(Order),
}

/// Somebody at a station.
pub struct Operator {
    /// The station.
    pub ground: Ground,
    steps: VecDeque<Step>,
    wait_until_us: u64,
    /// What is being drawn, until the vehicle has answered.
    drawing: Option<Forbidden>,
    streamed: Option<(Asked, u64)>,
    went_away: bool,
}

/// Where the vehicle is and may be.
pub struct Scene<'a> {
    /// What really is.
    pub truth: &'a Truth,
    /// Where it may be.
    pub volume: &'a Fence,
    /// What it flies.
    pub mission: &'a [Item],
    /// Items that are reached.
    pub reached: u16,
    /// Where it took off, E.
    pub home: Place,
}

impl Operator {
    /// One who has ordered nothing.
    pub fn new(ground: Ground) -> Self {
        Self {
            ground,
            steps: VecDeque::new(),
            wait_until_us: 0,
            drawing: None,
            streamed: None,
            went_away: false,
        }
    }

    /// Gives an order.
    pub fn order(&mut self, order: Order) {
        if matches!(order, Order::FenceAcross { .. } | Order::ForbiddenHome) {
            // A fence is not taken while a mission is flown.
            self.send(command(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, &[]));
            self.steps.push_back(Step::Wait(STOP_S));
        }
        self.steps.push_back(Step::Go(order));
    }

    /// Puts the steps of an order behind those that are left.
    fn go(&mut self, order: Order, scene: &Scene<'_>) {
        match order {
            Order::InjectFailure { unit, kind } => {
                let params = [unit.number(), failure_number(kind)];
                self.send(command(MavCmd::MAV_CMD_INJECT_FAILURE, &params));
            }
            Order::FenceAcross { way: Way::Return, .. } if scene.is_home() && !self.went_away => {
                self.went_away = true;
                // From over home there is no way back: first away.
                self.ask_for(Way::Goto, scene.at_height(scene.across()));
                self.steps.push_back(Step::Wait(GO_AWAY_S));
                self.steps.push_back(Step::Go(order));
            }
            Order::FenceAcross { way, shape } => self.draw_across(way, shape, scene),
            Order::Outside { way } => {
                self.ask_for(way, scene.at_height(scene.beyond()));
                self.land_later();
            }
            Order::ForbiddenHome => {
                let home = scene.across();
                self.draw(Shape::Circle, home, RADIUS_M);
                let to = [home[0], home[1], 0.0];
                self.send(at_place(MavCmd::MAV_CMD_DO_SET_HOME, [0.0; 4], to));
                self.send(command(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, &[]));
            }
        }
    }

    /// A fence between the vehicle and where it is sent.
    fn draw_across(&mut self, way: Way, shape: Shape, scene: &Scene<'_>) {
        let here = scene.here();
        let (from, to) = match way {
            Way::Goto | Way::Offboard => (here, scene.across()),
            Way::Mission => scene.longest_leg().unwrap_or((here, scene.home)),
            Way::Return => (here, scene.home),
        };
        let radius_m = (gap(from, to) / 2.0 - CLEAR_M).min(RADIUS_M);
        if radius_m > LEAST_RADIUS_M {
            self.draw(shape, [0, 1].map(|i| (from[i] + to[i]) / 2.0), radius_m);
        }
        match way {
            Way::Goto | Way::Offboard => self.ask_for(way, scene.at_height(to)),
            Way::Return => self.send(command(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, &[])),
            Way::Mission => self.send(command(MavCmd::MAV_CMD_MISSION_START, &[])),
        }
        self.land_later();
    }

    fn draw(&mut self, shape: Shape, centre_m: Place, radius_m: f64) {
        self.steps.push_back(Step::Draw(Forbidden { shape, centre_m, radius_m }));
    }

    fn ask_for(&mut self, way: Way, to_E_m: [f64; 3]) {
        if way == Way::Offboard {
            self.stream(Asked::Place(to_E_m));
        } else {
            let params = [f32::NAN, 1.0, f32::NAN, f32::NAN];
            self.send(at_place(MavCmd::MAV_CMD_DO_REPOSITION, params, to_E_m));
        }
    }

    /// Streams setpoints, and asks for their mode.
    fn stream(&mut self, asked: Asked) {
        self.steps.push_back(Step::Stream(Some(asked)));
        self.steps.push_back(Step::Wait(STREAM_FIRST_S));
        self.send(command(MavCmd::MAV_CMD_DO_SET_MODE, &OFFBOARD));
    }

    /// Takes off in this way from where the vehicle stands, stays, and lands; the mission has been started.
    pub fn take_off(&mut self, way: TakeOff, [north_m, east_m]: Place) {
        let above_E_m = [north_m, east_m, -HEIGHT_M];
        match way {
            TakeOff::Mission => return,
            TakeOff::Command | TakeOff::Point => {
                let params = [0.0, 0.0, 0.0, f32::NAN];
                self.send(at_place(MavCmd::MAV_CMD_NAV_TAKEOFF, params, above_E_m));
                if way == TakeOff::Point {
                    self.steps.push_back(Step::Wait(STREAM_FIRST_S));
                    self.ask_for(Way::Goto, above_E_m);
                }
            }
            TakeOff::Place => self.stream(Asked::Place(above_E_m)),
            TakeOff::Climb => {
                self.stream(Asked::Velocity([0.0, 0.0, -CLIMB_MPS]));
                self.steps.push_back(Step::Wait(HEIGHT_M / CLIMB_MPS));
                self.steps.push_back(Step::Stream(Some(Asked::Velocity([0.0; 3]))));
            }
        }
        self.land_after(STAY_S);
    }

    fn land_later(&mut self) {
        self.land_after(WATCH_S);
    }

    fn land_after(&mut self, wait_s: f64) {
        self.steps.push_back(Step::Wait(wait_s));
        self.send(command(MavCmd::MAV_CMD_NAV_LAND, &[]));
        self.steps.push_back(Step::Stream(None));
    }

    fn send(&mut self, message: MavMessage) {
        self.steps.push_back(Step::Send(Box::new(message)));
    }

    /// Reads what came and goes on with the script. What the vehicle has taken as a fence, when it has.
    pub fn act(&mut self, world: &mut Lockstep, scene: &Scene<'_>) -> Option<Forbidden> {
        self.ground.listen(world);
        let taken = self.answer(world);
        let now_us = world.t_us();
        if self.drawing.is_some() && now_us < self.wait_until_us {
            return taken;
        }
        self.drawing = None;
        while self.drawing.is_none() && now_us >= self.wait_until_us {
            let Some(step) = self.steps.pop_front() else { break };
            match step {
                Step::Wait(s) => self.wait_until_us = now_us + (s * 1e6) as u64,
                Step::Send(message) => self.ground.send(world, &message),
                Step::Go(order) => self.go(order, scene),
                Step::Stream(to) => self.streamed = to.map(|to| (to, now_us)),
                Step::Draw(forbidden) => {
                    self.ground.send(world, &count(fence_items(&forbidden).len()));
                    self.drawing = Some(forbidden);
                    self.wait_until_us = now_us + PATIENCE_US;
                }
            }
        }
        if let Some((to, next_us)) = &mut self.streamed
            && now_us >= *next_us
        {
            *next_us += STREAM_US;
            let message = setpoint(*to);
            self.ground.send(world, &message);
        }
        taken
    }

    /// Answers questions for the fence.
    fn answer(&mut self, world: &mut Lockstep) -> Option<Forbidden> {
        let of_fence = MavMissionType::MAV_MISSION_TYPE_FENCE;
        let forbidden = self.drawing?;
        let items = fence_items(&forbidden);
        while let Some(seq) = self.ground.take(|m| match m {
            MavMessage::MISSION_REQUEST_INT(r) if r.mission_type == of_fence as u8 => Some(r.seq),
            _ => None,
        }) {
            if let Some(item) = items.get(usize::from(seq)) {
                self.ground.send(world, &MavMessage::MISSION_ITEM_INT(item.clone()));
            }
        }
        let result: MavMissionResult = self.ground.take(|m| match m {
            MavMessage::MISSION_ACK(ack) if ack.mission_type == of_fence as u8 => {
                known(ack.mavtype)
            }
            _ => None,
        })?;
        self.drawing = None;
        self.wait_until_us = world.t_us();
        (result == MavMissionResult::MAV_MISSION_ACCEPTED).then_some(forbidden)
    }
}

impl Scene<'_> {
    /// Whether it is over home, or so near that nothing fits between.
    fn is_home(&self) -> bool {
        gap(self.here(), self.home) < 2.0 * (CLEAR_M + LEAST_RADIUS_M)
    }

    fn here(&self) -> Place {
        [self.truth.pos_E_m.x(), self.truth.pos_E_m.y()]
    }

    /// A place at the height of the vehicle, of a low take-off at least, E, m.
    fn at_height(&self, [north_m, east_m]: Place) -> [f64; 3] {
        [north_m, east_m, -self.truth.height_m.max(1.0)]
    }

    /// Ends of the volume by axis.
    fn ends(&self) -> [[f64; 2]; 2] {
        [self.volume.north_m, self.volume.east_m]
    }

    /// A place inside, some metres away on the other side of the middle.
    fn across(&self) -> Place {
        let here = self.here();
        let middle = self.ends().map(|[low, high]| (low + high) / 2.0);
        let off = [0, 1].map(|i| middle[i] - here[i]);
        let length = off[0].hypot(off[1]);
        let along = if length > 0.1 { off.map(|d| d / length) } else { [0.0, 1.0] };
        let to = [0, 1].map(|i| here[i] + AWAY_M * along[i]);
        [0, 1].map(|i| {
            let [low, high] = self.ends()[i];
            to[i].clamp(low + FROM_BORDER_M, high - FROM_BORDER_M)
        })
    }

    /// A place outside, beyond the nearest wall.
    fn beyond(&self) -> Place {
        let here = self.here();
        let walls = [0, 1].into_iter().flat_map(|axis| {
            let [low, high] = self.ends()[axis];
            [(here[axis] - low, axis, low - BEYOND_M), (high - here[axis], axis, high + BEYOND_M)]
        });
        let nearest = walls.min_by(|a, b| a.0.total_cmp(&b.0));
        let mut to = here;
        if let Some((_, axis, at)) = nearest {
            to[axis] = at;
        }
        to
    }

    /// The longest leg of the mission that lies ahead and is clear of the vehicle.
    fn longest_leg(&self) -> Option<(Place, Place)> {
        let mut from = self.home;
        let mut legs = Vec::new();
        for (item, seq) in self.mission.iter().zip(0u16..) {
            let to = match (item.command, item.position_m) {
                (ItemCommand::Waypoint, Some([north_m, east_m, _])) => [north_m, east_m],
                (ItemCommand::Return, _) => self.home,
                _ => continue,
            };
            if seq > self.reached {
                legs.push((from, to));
            }
            from = to;
        }
        legs.into_iter()
            .filter(|(a, b)| {
                let middle = [0, 1].map(|i| (a[i] + b[i]) / 2.0);
                gap(middle, self.here()) > RADIUS_M + CLEAR_M
            })
            .max_by(|a, b| gap(a.0, a.1).total_cmp(&gap(b.0, b.1)))
    }
}

fn gap(a: Place, b: Place) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn command(command: MavCmd, params: &[f32]) -> MavMessage {
    command_long(VEHICLE, command, params, 0)
}

/// With a place, E, m.
fn at_place(command: MavCmd, params: [f32; 4], at: [f64; 3]) -> MavMessage {
    let place = local_item(command, at, 0.0);
    command_int(VEHICLE, command, params, (place.x, place.y, place.z))
}

fn setpoint(asked: Asked) -> MavMessage {
    let (mask, place, velocity) = match asked {
        Asked::Place(to_E_m) => (POSITION_MASK, to_E_m, [0.0; 3]),
        Asked::Velocity(vel_E_mps) => (VELOCITY_MASK, [0.0; 3], vel_E_mps),
    };
    let ([x, y, z], [vx, vy, vz]) = (place.map(|at| at as f32), velocity.map(|speed| speed as f32));
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        target_system: 1,
        target_component: 1,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        type_mask: PositionTargetTypemask::from_bits_truncate(mask),
        x,
        y,
        z,
        vx,
        vy,
        vz,
        ..Default::default()
    })
}

fn count(items: usize) -> MavMessage {
    MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
        count: u16::try_from(items).unwrap_or(u16::MAX),
        target_system: 1,
        target_component: 1,
        mission_type: MavMissionType::MAV_MISSION_TYPE_FENCE as u8,
        opaque_id: 0,
    })
}

fn fence_items(forbidden: &Forbidden) -> Vec<MISSION_ITEM_INT_DATA> {
    let Forbidden { shape, centre_m: [n, e], radius_m: r } = *forbidden;
    let circle = MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION;
    let corner = MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION;
    let items = match shape {
        Shape::Circle => vec![local_item(circle, [n, e, 0.0], r as f32)],
        Shape::Square => [[-r, -r], [-r, r], [r, r], [r, -r]]
            .map(|[dn, de]| local_item(corner, [n + dn, e + de, 0.0], 4.0))
            .to_vec(),
    };
    let numbered = items.into_iter().zip(0u16..);
    let of_fence = |(item, seq)| MISSION_ITEM_INT_DATA {
        seq,
        target_system: 1,
        target_component: 1,
        mission_type: MavMissionType::MAV_MISSION_TYPE_FENCE as u8,
        ..item
    };
    numbered.map(of_fence).collect()
}
