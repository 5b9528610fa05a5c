//! The plant: everything outside the companion, in lockstep. Bytes in, bytes out, truth on the side.
//!
//! One step of 2 ms: wind → board → actuators → battery → thrust → force and moment → floor → body →
//! sensors → links → anchors. What an effect does to a stage is decided by [`Bank`] alone; with an
//! empty [`EffectSet`] the plant is a rigid body with exact actuators and sensors.

use nalgebra::{UnitQuaternion, Vector3};

use crate::board::crazyflie::ANCHORS;
use crate::board::{Board, BoardRequests, BoardSettings, Outside, Readings};
use crate::body::Body;
use crate::effects::{
    ATTITUDE_PERIOD_S, AttitudeError, Bank, CLOCK_PERIOD_S, Cargo, Delivery, EffectSet, ImuReading,
    STEP_S, State, Supply,
};
use crate::faults::CrazyflieFault;
use crate::magnetometer::Magnetometer;
use crate::room::Room;
use crate::rotorcraft::Rotorcraft;
use crate::tag::{Anchors, Port, TagProtocol};
use crate::truth::Truth;
use crate::vehicle::Vehicle;
use crate::wings::{Actuation, ActuatorCommand};
use haltere_core::checks::Problems;
use haltere_core::frames::{E, G_MPS2, Rot, U, Vec3, survey_from_earth};
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;

use broken::Broken;

use contact::Contact;
use rotors::Rotors;
use wires::Wires;

/// Length of a step, µs.
pub const STEP_US: u64 = (STEP_S * 1e6) as u64;
const ATTITUDE_STEPS: u64 = (ATTITUDE_PERIOD_S / STEP_S) as u64;
const CLOCK_STEPS: u64 = (CLOCK_PERIOD_S / STEP_S) as u64;
/// The IMU is read at every second step: 250 Hz.
const IMU_STEPS: u64 = 2;

/// Supply of a cell when no battery is simulated, V.
const FIXED_CELL_V: f64 = 3.7;
/// Pressure at the floor, Pa, and its fall with height near the ground, Pa/m (ISA).
const FLOOR_PRESSURE_PA: f64 = 101_325.0;
const PRESSURE_PA_PER_M: f64 = 12.0;
/// On the floor with little thrust for this long: landed, s.
const LANDED_S: f64 = 0.5;

/// What to simulate.
#[derive(Debug, Clone)]
pub struct PlantConfig {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// Where the anchors stand, as the companion is told.
    pub survey: Survey,
    /// Effects that are on.
    pub effects: EffectSet,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Foot of the landing gear at the start, Earth frame, m; on the floor when z = 0.
    pub start_E_m: Vec3<E>,
    /// Heading at the start from room north, rad.
    pub start_yaw_rad: f64,
    /// The room.
    pub room: Room,
    /// What the tag speaks.
    pub protocol: TagProtocol,
    /// The board.
    pub board: BoardSettings,
}

impl PlantConfig {
    /// The nominal vehicle in the hall of the source, anchors in its corners.
    pub fn hall(seed: u64) -> Self {
        // Eight corners of a box are a survey that can be flown on.
        let survey = Survey::new(&Room::default().corner_anchors());
        Self::new(survey.unwrap_or_else(|problems| unreachable!("{problems}")), seed)
    }

    /// The nominal vehicle on the floor in the middle of the default room.
    pub fn new(survey: Survey, seed: u64) -> Self {
        Self {
            vehicle: Vehicle::default(),
            survey,
            effects: EffectSet::nominal(),
            seed,
            start_E_m: Vec3::new(5.0, 5.0, 0.0),
            start_yaw_rad: 0.0,
            room: Room::default(),
            protocol: TagProtocol::default(),
            board: BoardSettings::default(),
        }
    }
}

/// Vehicle, board, tag and room.
pub struct Plant {
    vehicle: Vehicle,
    room: Room,
    /// Effects that are on.
    bank: Bank,
    body: Body,
    board: Board,
    anchors: Anchors,
    port: Port,
    ids: Vec<u8>,
    surveyed_E_m: Vec<Vector3<f64>>,
    antenna_B_m: Vector3<f64>,
    state: State,
    actuation: Actuation,
    supply: Supply,
    imu: ImuReading,
    imu_alive: [bool; 3],
    magnetometer: Option<Magnetometer>,
    wind_E_mps: Vector3<f64>,
    broken: Broken,
    requests: BoardRequests,
    /// What an inner loop outside of the plant tells the actuators, where one flies it.
    steered: Option<ActuatorCommand>,
    seed: u64,
    steps: u64,
    landed_s: f64,
    crashed: bool,
    /// Too broken for motors to run.
    wrecked: bool,
    contact: Contact,
    /// In the place of wings and servos, where the vehicle is a quadrotor.
    rotors: Option<Rotors>,
    /// Bytes that were produced in this step.
    scratch: Vec<u8>,
    wires: Wires,
}

impl Plant {
    /// Builds it. Refuses what cannot be simulated, all reasons at once.
    pub fn new(config: PlantConfig) -> Result<Self, Problems> {
        let PlantConfig {
            mut vehicle,
            survey,
            effects,
            seed,
            start_E_m,
            start_yaw_rad,
            room,
            protocol,
            mut board,
        } = config;
        let mut problems = Problems::new();
        vehicle.check("vehicle", &mut problems);
        board.check("board", &mut problems);
        room.check("room", &mut problems);
        problems.range("start.z", start_E_m.z(), -room.ceiling_m..=0.0, "m");
        problems.range("start.yaw", start_yaw_rad, -7.0..=7.0, "rad");
        for (axis, value) in [("x", start_E_m.x()), ("y", start_E_m.y())] {
            problems.range(format_args!("start.{axis}"), value, -200.0..=200.0, "m");
        }
        problems.into_result()?;

        let ids: Vec<u8> = survey.ids().iter().map(|AnchorId(id)| *id).collect();
        let surveyed_E_m: Vec<Vector3<f64>> = survey
            .ids()
            .iter()
            .filter_map(|id| survey.position_E_m(*id))
            .map(|p| p.raw())
            .collect();
        let mut sites_E_m = surveyed_E_m.clone();
        let nominal = vehicle.clone();
        let bank = Bank::new(&effects, seed, &mut vehicle, &mut board, &room, &mut sites_E_m);
        let anchors = Anchors::new(protocol, &ids, &sites_E_m, seed)?;

        let pos_E_m = start_E_m.raw() - Vector3::new(0.0, 0.0, vehicle.body.gear_m);
        let q_EB = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), start_yaw_rad);
        let supply = Supply {
            volt: FIXED_CELL_V * vehicle.battery.cells,
            current_a: 0.0,
            charge_frac: vehicle.battery.charge_frac,
        };
        let mut tag_out = Vec::with_capacity(4096);
        let magnetometer = Magnetometer::new(&board.magnetometer, seed);
        let board_baud = board.manners.baud;
        // The board knows the vehicle of the file, not what has become of it; its loops are its own.
        let known = Vehicle { inner_loop: vehicle.inner_loop.clone(), ..nominal };
        let mut board = Board::new(board, &known).with_deck(said_positions(&survey), seed);
        let mut port = Port::new(protocol, &mut tag_out);
        if board.has_deck() {
            port.silent = true;
            tag_out.clear();
            board.inject(0, &CrazyflieFault::Tdoa3(protocol == TagProtocol::Tdoa3));
        }
        let mut plant = Self {
            body: Body::new(pos_E_m, q_EB, Vector3::from(vehicle.body.inertia_kgm2)),
            board,
            port,
            antenna_B_m: Vector3::from(vehicle.body.tag_B_m) - Vector3::from(vehicle.body.cg_B_m),
            anchors,
            ids,
            surveyed_E_m,
            state: State::default(),
            actuation: Actuation::default(),
            supply,
            imu: ImuReading {
                acc_B_mps2: Vector3::new(0.0, 0.0, -G_MPS2),
                rate_B_radps: Vector3::zeros(),
                pressure_pa: FLOOR_PRESSURE_PA,
            },
            imu_alive: [true; 3],
            magnetometer,
            wind_E_mps: Vector3::zeros(),
            broken: Broken::new(seed),
            requests: BoardRequests::default(),
            steered: None,
            seed,
            steps: 0,
            landed_s: LANDED_S,
            crashed: false,
            wrecked: false,
            contact: Contact::new(&vehicle),
            rotors: None,
            scratch: Vec::with_capacity(4096),
            wires: Wires::new(seed, board_baud, tag_out),
            vehicle,
            room,
            bank,
        };
        plant.state.acc_B_mps2 = Vector3::new(0.0, 0.0, -G_MPS2);
        plant.state.supply_v = supply.volt;
        plant.observe();
        plant.slow_stages();
        Ok(plant)
    }

    /// Simulates up to and including the last whole step at or before `t_us`.
    pub fn advance_to(&mut self, t_us: u64) {
        while (self.steps + 1) * STEP_US <= t_us {
            self.step();
        }
        let now_us = self.t_us();
        self.wires.from_tag.receive(now_us, &mut self.wires.tag_out);
        self.wires.from_board.receive(now_us, &mut self.wires.board_out);
    }

    /// Time, µs: whole steps.
    pub fn t_us(&self) -> u64 {
        self.steps * STEP_US
    }

    /// Bytes that the tag has sent; the caller drains them.
    pub fn tag_output(&mut self) -> &mut Vec<u8> {
        &mut self.wires.tag_out
    }

    /// Bytes for the tag.
    pub fn tag_input(&mut self, bytes: &[u8]) {
        self.scratch.clear();
        self.port.command(bytes, &mut self.scratch);
        if !self.scratch.is_empty() {
            self.wires.from_tag.send(self.t_us(), 0.0, &self.scratch);
        }
    }

    /// The host has opened the tag's port: on a rising edge of DTR the node shows its boot text again.
    pub fn tag_opened(&mut self) {
        self.scratch.clear();
        self.port.opened(&mut self.scratch);
        if !self.scratch.is_empty() {
            self.wires.from_tag.send(self.t_us(), 0.0, &self.scratch);
        }
    }

    /// Bytes that the board has sent; the caller drains them.
    pub fn board_output(&mut self) -> &mut Vec<u8> {
        &mut self.wires.board_out
    }

    /// Bytes for the board.
    pub fn board_input(&mut self, bytes: &[u8]) {
        if bytes.is_empty() {
            return;
        }
        let mut delivery = Delivery { cargo: Cargo::ToBoard, delay_s: 0.0, lost: false };
        self.bank.link(&self.state, &mut delivery);
        delivery.delay_s += self.companion_line_delay_s(bytes.len());
        if !delivery.lost && self.board_link_up() && self.to_board_up() {
            self.wires.to_board.send(self.t_us(), delivery.delay_s, bytes);
        }
    }

    /// What really happens.
    pub fn truth(&self) -> Truth {
        let s = &self.state;
        Truth {
            t_us: self.t_us(),
            pos_E_m: Vec3::from_raw(s.pos_E_m),
            vel_E_mps: Vec3::from_raw(s.vel_E_mps),
            R_EB: Rot::from_raw(s.q_EB),
            rate_B_radps: Vec3::from_raw(s.rate_B_radps),
            acc_B_mps2: Vec3::from_raw(s.acc_B_mps2),
            wind_E_mps: Vec3::from_raw(self.wind_E_mps),
            height_m: s.height_m,
            flap_hz: s.flap_hz,
            dihedral_rad: self.actuation.dihedral_rad,
            yaw_servo_rad: self.actuation.yaw_servo_rad,
            thrust_n: s.thrust_n[0] + s.thrust_n[1],
            supply_v: s.supply_v,
            current_a: s.current_a,
            charge_frac: s.charge_frac,
            board_north_rad: self.board.north_rad(),
            on_ground: s.on_ground,
            landed: self.landed_s >= LANDED_S,
            armed: self.board.armed(),
            crashed: self.crashed,
        }
    }

    /// From now on another inner loop than the plant's own board flies the vehicle, such as a real firmware:
    /// what it tells the actuators, kept until it says something else. Loops, link delays and setpoint
    /// effects of the own board act no more.
    pub fn steer(&mut self, command: ActuatorCommand) {
        self.steered = Some(command);
    }

    /// From now on a Crazyflie's firmware in another program is the board: on wings, or on these rotors, of which the vehicle
    /// is ([`Rotorcraft::as_vehicle`]). Refused where the board plays no Crazyflie.
    pub fn fly_by(
        &mut self,
        firmware: Box<dyn Outside>,
        rotors: Option<Rotorcraft>,
    ) -> Result<(), Problems> {
        self.rotors = rotors.map(Rotors::new);
        self.board.be(firmware)
    }

    /// What an inertial sensor read last, 250 times a second: with the effects and faults of this flight.
    pub fn imu(&self) -> &ImuReading {
        &self.imu
    }

    /// The board, for what truth there is about it.
    pub fn board(&self) -> &Board {
        &self.board
    }

    /// The vehicle with what the deviations made of it.
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    fn step(&mut self) {
        let start_us = self.t_us();
        self.steps += 1;
        let now_us = self.t_us();

        self.hear_companion(start_us);
        self.fly();
        self.observe();
        if self.steps.is_multiple_of(ATTITUDE_STEPS) {
            self.slow_stages();
        }
        let imu_step = self.steps.is_multiple_of(IMU_STEPS);
        if imu_step {
            self.read_imu();
        }

        // The board measures what it runs on, a broken cell included.
        let mut reported = Supply { volt: self.state.supply_v, ..self.supply };
        self.bank.battery_report(&self.state, &mut reported);
        let said = self.broken.battery.of(&Vector3::new(reported.volt, reported.current_a, 0.0));
        (reported.volt, reported.current_a) = (said.x, said.y);
        self.scratch.clear();
        let (pos_E_m, R_EB) = (self.state.pos_E_m, self.state.R_EB);
        let field_B_ut = match &mut self.magnetometer {
            Some(magnetometer) if imu_step => Some(magnetometer.read(&pos_E_m, &R_EB)),
            _ => None,
        };
        let readings = Readings {
            t_us: now_us,
            field_B_ut,
            state: &self.state,
            imu: &self.imu,
            imu_alive: self.imu_alive,
            supply: &reported,
        };
        self.board.send(&readings, imu_step, &mut self.scratch);
        self.post_from_board(now_us);
        if let Some(second) = &mut self.broken.second_board {
            self.scratch.clear();
            second.send(now_us, imu_step, &mut self.scratch);
            self.post_from_board(now_us);
        }

        self.scratch.clear();
        let (anchors, port, scratch) = (&mut self.anchors, &mut self.port, &mut self.scratch);
        let board = &mut self.board;
        let until_us = now_us + STEP_US;
        anchors.advance(now_us, until_us, &self.state, self.antenna_B_m, &mut self.bank, |r| {
            board.hear(&r);
            port.write(&r, scratch);
        });
        if !self.scratch.is_empty() {
            let mut delivery = Delivery { cargo: Cargo::FromTag, delay_s: 0.0, lost: false };
            self.bank.link(&self.state, &mut delivery);
            if !delivery.lost {
                // What is heard in the coming step leaves at its end: causal at step resolution.
                self.wires.from_tag.send(until_us, delivery.delay_s, &self.scratch);
            }
        }
    }

    /// Stages that need no 500 Hz.
    fn slow_stages(&mut self) {
        let [_, _, yaw] = Rot::<E, E>::from_raw(self.state.q_EB).euler_rad();
        self.state.yaw_rad = yaw;
        let mut error = AttitudeError::default();
        self.bank.attitude(&self.state, &mut error);
        self.board.set_attitude_error(error);
        if self.steps.is_multiple_of(CLOCK_STEPS) {
            self.anchors.update_clocks(self.t_us(), &self.state, &mut self.bank);
        }
    }

    fn read_imu(&mut self) {
        let s = &self.state;
        let height_m = -s.pos_E_m.z;
        let mut reading = ImuReading {
            acc_B_mps2: s.acc_B_mps2,
            rate_B_radps: s.rate_B_radps,
            pressure_pa: FLOOR_PRESSURE_PA - PRESSURE_PA_PER_M * height_m,
        };
        self.bank.imu(s, &mut reading);
        let mut pressure = Vector3::new(reading.pressure_pa, 0.0, 0.0);
        let b = &mut self.broken;
        self.imu_alive = [
            b.accelerometer.apply(s.t_s, &mut reading.acc_B_mps2),
            b.gyroscope.apply(s.t_s, &mut reading.rate_B_radps),
            b.barometer.apply(s.t_s, &mut pressure),
        ];
        reading.pressure_pa = pressure.x;
        self.imu = reading;
    }
}

/// Where anchors say that they stand, by id: in their own world, z up, m.
fn said_positions(survey: &Survey) -> [Option<[f32; 3]>; ANCHORS] {
    std::array::from_fn(|id| {
        let at_E_m = survey.position_E_m(AnchorId(id as u8))?;
        let at: Vec3<U> = survey_from_earth(at_E_m);
        Some(at.to_array().map(|axis| axis as f32))
    })
}

mod broken;
mod contact;
#[cfg(test)]
mod deck_tests;
mod flight;
mod rotors;
mod second_board;
mod wires;

#[cfg(test)]
mod lies_tests;
#[cfg(test)]
pub(crate) mod rig;
#[cfg(test)]
mod tests;
