//! Another world to fly the companion in: vehicle, board, tag and room of the sealed suite.
//!
//! It shares no physics with `haltere_model` (a test reads these files to make sure; only the record
//! [`Truth`] is the same), so that a diagnosis built on the nominal simulator is not checked against
//! itself. sim/lab/PROTOCOL.md says how it is used.

pub mod board;
pub mod computer;
pub mod craft;
pub mod dynamics;
pub mod effects;
pub mod law;
pub mod noise;
pub mod radio;
pub mod sensors;
pub mod wire;
pub mod world;

#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::f64::consts::TAU;

use haltere_core::frames::{Rot, Vec3};
use haltere_core::measure::AnchorId;
use haltere_gap::scene::Scene;
use haltere_model::Truth;
use haltere_model::lockstep::World;
use nalgebra::{UnitQuaternion, Vector3};

use board::Pilotage;
use computer::{Busy, Computer};
use craft::Craft;
use dynamics::{Motion, Surroundings};
use effects::{Deviations, Hall};
use law::{Drawn, Moment, Strange};
use noise::Noise;
use radio::{Place, Radio};
use sensors::{Beat, Sensors};
use wire::{Readings, Wire, Wish};

/// Step of the motion: 2 kHz.
const STEP_S: f64 = 0.0005;
/// Motion steps per turn of the inner loops, and turns per reading of the IMU.
const PER_TURN: u64 = 4;
const PER_IMU: u64 = 2;
/// IMU readings per pressure.
const PER_PRESSURE: u64 = 5;
/// Turns of the inner loops between two looks at drawn laws: 100 Hz.
const PER_LAW: u64 = 5;
/// Touching the floor faster than this breaks the vehicle, m/s; so does leaning farther than this
/// cosine.
const CRASH_MPS: f64 = 2.0;
const CRASH_COS: f64 = 0.17;

/// What to simulate.
#[derive(Debug, Clone)]
pub struct Setup {
    /// The vehicle.
    pub craft: Craft,
    /// What deviates once `onset_s` is over; before, the vehicle is healthy.
    pub deviations: Deviations,
    /// Since when, s of simulated time; 0: always.
    pub onset_s: f64,
    /// What deviates by laws of its own, always; then `deviations` are not looked at.
    pub drawn: Drawn,
    /// The computer that the companion runs on.
    pub computer: Computer,
    /// Anchors as the companion is told, Earth, m.
    pub anchors: Vec<(u8, Vector3<f64>)>,
    /// Place of take-off, m.
    pub start_NE_m: [f64; 2],
    /// Seed of what belongs to the room: flights of one day share it.
    pub room_seed: u64,
    /// Seed of all other random numbers.
    pub seed: u64,
}

impl Setup {
    /// The healthy vehicle in a scene.
    pub fn healthy(scene: &Scene, seed: u64) -> Self {
        let antenna_B_m = scene.pilot.estimator.p_BT_B_m;
        let anchors = scene
            .survey
            .ids()
            .iter()
            .filter_map(|id| {
                let AnchorId(number) = *id;
                Some((number, scene.survey.position_E_m(*id)?.raw()))
            })
            .collect();
        Self {
            craft: Craft::healthy(scene.pilot.flight.gear_height_m, antenna_B_m),
            deviations: Deviations::default(),
            onset_s: 0.0,
            drawn: Drawn::default(),
            computer: Computer::default(),
            anchors,
            start_NE_m: scene.start_NE_m,
            room_seed: seed,
            seed,
        }
    }
}

/// Room of a scene, for drawing places.
pub fn hall(scene: &Scene) -> Hall {
    Hall {
        north_m: scene.room.north_m,
        east_m: scene.room.east_m,
        ceiling_m: scene.room.ceiling_m,
        anchors: scene.survey.ids().len(),
    }
}

/// Bytes under way, in order.
#[derive(Debug, Default)]
struct Pipe(VecDeque<(f64, Vec<u8>)>);

impl Pipe {
    fn push(&mut self, due_s: f64, bytes: Vec<u8>) {
        let due_s = self.0.back().map_or(due_s, |(last, _)| due_s.max(*last));
        self.0.push_back((due_s, bytes));
    }
    fn pop(&mut self, now_s: f64) -> Option<Vec<u8>> {
        if self.0.front()?.0 > now_s + 1e-9 {
            return None;
        }
        self.0.pop_front().map(|(_, bytes)| bytes)
    }
}

/// The world.
pub struct Foreign {
    craft: Craft,
    d: Deviations,
    waiting: Option<Deviations>,
    onset_s: f64,
    drawn: Drawn,
    strange: Strange,
    computer: Computer,
    busy: Busy,
    middle_NE_m: [f64; 2],
    start_NE_m: [f64; 2],
    motion: Motion,
    pilotage: Pilotage,
    wire: Wire,
    sensors: Sensors,
    radio: Radio,
    air: Noise,
    links: Noise,
    work: Noise,
    drops: Noise,
    steps: u64,
    imu_count: u64,
    next_poll_s: f64,
    around: Surroundings,
    believed: UnitQuaternion<f64>,
    north_rad: f64,
    idle_s: f64,
    crashed: bool,
    from_tag: Pipe,
    from_board: Pipe,
    to_board: Pipe,
    tag_out: Vec<u8>,
    board_out: Vec<u8>,
}

impl Foreign {
    /// At rest on the floor, just switched on.
    pub fn new(setup: Setup) -> Self {
        let Setup {
            mut craft,
            deviations,
            onset_s,
            drawn,
            computer,
            anchors,
            start_NE_m,
            room_seed,
            seed,
        } = setup;
        let mut rng = Noise::new(seed, "flight");
        // No two packs and no two mornings are alike.
        craft.charge_frac *= rng.between(0.985, 1.0);
        craft.north_rad += 0.01 * rng.laplace().clamp(-3.0, 3.0);
        let phase = [rng.between(0.0, TAU), rng.between(0.0, TAU)];
        let middle = |axis: usize| {
            anchors.iter().map(|(_, at)| at[axis]).sum::<f64>() / anchors.len().max(1) as f64
        };
        let middle_NE_m = [middle(0), middle(1)];
        let (d, waiting) = match onset_s > 0.0 {
            true => (Deviations::default(), Some(deviations)),
            false => (deviations, None),
        };
        Self {
            motion: Motion::new(&craft, start_NE_m[0], start_NE_m[1], phase),
            radio: Radio::new(&anchors, &craft, room_seed, seed),
            sensors: Sensors::new(seed),
            craft,
            d,
            waiting,
            onset_s,
            drawn,
            strange: Strange::default(),
            computer,
            busy: Busy::default(),
            middle_NE_m,
            start_NE_m,
            pilotage: Pilotage::default(),
            wire: Wire::default(),
            air: Noise::new(seed, "air"),
            links: Noise::new(seed, "links"),
            work: Noise::new(seed, "work"),
            drops: Noise::new(seed, "drops"),
            steps: 0,
            imu_count: 0,
            next_poll_s: computer.poll_s,
            around: Surroundings::default(),
            believed: UnitQuaternion::identity(),
            north_rad: 0.0,
            idle_s: 1.0,
            crashed: false,
            from_tag: Pipe::default(),
            from_board: Pipe::default(),
            to_board: Pipe::default(),
            tag_out: Vec::new(),
            board_out: Vec::new(),
        }
    }

    fn now_s(&self) -> f64 {
        self.steps as f64 * STEP_S
    }

    fn line_s(&mut self) -> f64 {
        let [least_s, spread_s] = self.computer.line_s;
        least_s + spread_s * self.links.exponential().min(4.0)
    }

    fn step(&mut self) {
        let t_s = self.now_s();
        if self.steps.is_multiple_of(PER_TURN) {
            self.turn(t_s);
        }
        self.around.t_s = t_s;
        self.motion.step(STEP_S, &self.craft, &self.pilotage.order, &self.around, &self.d);
        let loads = self.motion.loads;
        let mass = self.craft.mass_kg + self.d.inertia.extra_kg(t_s) + self.d.unknown.water_kg(t_s);
        let acc = loads.force_B_n / mass;
        self.sensors.shake(
            STEP_S,
            acc,
            self.motion.rate(),
            &Beat { flap_hz: self.motion.flap_hz(), phase: self.motion.phase() },
            &self.craft,
            &self.d,
        );
        self.steps += 1;
        if loads.touches && self.motion.vel().z > CRASH_MPS
            || (self.motion.attitude() * Vector3::z()).z < CRASH_COS
        {
            self.crashed = true;
            self.pilotage.disarm();
        }
    }

    /// 500 times a second: bytes, air, loops, sensors, radio.
    fn turn(&mut self, t_s: f64) {
        let dt_s = board::PERIOD_S;
        if t_s >= self.onset_s
            && let Some(d) = self.waiting.take()
        {
            self.d = d;
        }
        if self.drawn.any() && (self.steps / PER_TURN).is_multiple_of(PER_LAW) {
            self.by_laws(t_s);
        }
        let clock_us = self.wire.clock_us(t_s, self.d.unknown.clock_s(t_s));
        let loads = self.motion.loads;
        let mut answers = Vec::new();
        while let Some(bytes) = self.to_board.pop(t_s) {
            for wish in
                self.wire.receive(&bytes, clock_us, loads.touches, &mut self.pilotage, &mut answers)
            {
                if let Wish::Fly(setpoint) = wish
                    && !self.d.timing.pauses(t_s, &mut self.drops)
                {
                    self.pilotage.take(setpoint);
                }
            }
        }

        let (pos, vel, q) = (self.motion.pos(), self.motion.vel(), self.motion.attitude());
        self.around.push_B_n = self.strange.force_B_n;
        self.around.twist_B_nm = self.strange.twist_B_nm;
        let acc_E = q * loads.force_B_n / self.craft.mass_kg + Vector3::new(0.0, 0.0, 9.81);
        self.around.wind_E_mps =
            self.d.aero.wind(&pos, dt_s, &mut self.air) + self.d.unknown.wind(&pos, t_s);
        self.around.pull_E_n = self.d.unknown.pull_n(&pos, &acc_E, self.start_NE_m, dt_s);

        (self.believed, self.north_rad) =
            self.sensors.believed(dt_s, t_s, &q, &self.craft, &self.d);
        let rate = self.motion.rate();
        let supply_v = self.motion.supply_v;
        self.pilotage.turn(&self.craft, &self.believed, &rate, supply_v, &self.d);

        let thrusts = loads.thrust_n > 0.7 * self.craft.weight_n();
        self.idle_s = if loads.touches && !thrusts { self.idle_s + dt_s } else { 0.0 };

        if (self.steps / PER_TURN).is_multiple_of(PER_IMU) {
            let (acc, rate) = self.sensors.read(t_s, self.motion.flap_hz(), &self.craft, &self.d);
            let (acc, rate) = (acc + self.strange.acc_mps2, rate + self.strange.rate_radps);
            let fresh = self.imu_count.is_multiple_of(PER_PRESSURE);
            self.imu_count += 1;
            let readings = Readings {
                acc,
                rate,
                pressure_pa: fresh.then(|| self.sensors.pressure_pa(-pos.z)),
                believed: self.believed,
                supply_v,
                current_a: self.motion.current_a,
                charge_frac: self.charge_frac(),
            };
            self.wire.stream(clock_us, &readings, &self.pilotage, &mut answers);
        }
        if !answers.is_empty() {
            let due_s = t_s + self.line_s();
            self.from_board.push(due_s, answers);
        }

        let place = Place { t_s, pos, vel, q };
        self.radio.advance(t_s + dt_s, &place, &self.craft, &mut self.d);
        if t_s + dt_s >= self.next_poll_s {
            self.next_poll_s += self.computer.poll_s;
            if !self.radio.out.is_empty() {
                let due_s = t_s + dt_s + self.d.timing.tag_s(t_s) + self.strange.later_s[1];
                let bytes = std::mem::take(&mut self.radio.out);
                self.from_tag.push(due_s, bytes);
            }
        }
    }

    /// What deviates at this moment.
    fn by_laws(&mut self, t_s: f64) {
        let m = Moment {
            t_s,
            pos_E_m: self.motion.pos(),
            speed_mps: self.motion.vel().norm(),
            yaw_rad: self.motion.attitude().euler_angles().2,
            turn_radps: self.motion.rate().norm(),
            supply_v: self.motion.supply_v,
            flap: 0.5 * self.motion.flap_hz().iter().sum::<f64>() / self.craft.hover_hz,
            middle_NE_m: self.middle_NE_m,
        };
        let dt_s = PER_LAW as f64 * board::PERIOD_S;
        let vehicle = [self.craft.stated_kg, self.craft.wing_m];
        (self.d, self.strange) = self.drawn.at(&m, dt_s, vehicle, &self.d);
    }

    fn charge_frac(&self) -> f64 {
        let capacity = self.d.propulsion.capacity(self.craft.capacity_as);
        (self.craft.charge_frac - self.motion.used_as() / capacity).clamp(0.0, 1.0)
    }
}

impl World for Foreign {
    fn advance_to(&mut self, t_us: u64) {
        while (self.now_s() + STEP_S) * 1e6 <= t_us as f64 + 0.5 {
            self.step();
        }
        let now_s = self.now_s();
        if self.busy.waits(now_s, &self.computer, &mut self.work) {
            return;
        }
        while let Some(bytes) = self.from_tag.pop(now_s) {
            self.tag_out.extend(bytes);
        }
        while let Some(bytes) = self.from_board.pop(now_s) {
            self.board_out.extend(bytes);
        }
    }
    fn tag_output(&mut self) -> &mut Vec<u8> {
        &mut self.tag_out
    }
    fn board_output(&mut self) -> &mut Vec<u8> {
        &mut self.board_out
    }
    fn tag_input(&mut self, bytes: &[u8]) {
        self.radio.command(bytes);
    }
    fn board_input(&mut self, bytes: &[u8]) {
        let t_s = self.now_s();
        let due_s = t_s
            + self.line_s()
            + self.d.timing.board_s(t_s)
            + self.craft.setpoint_delay_s
            + self.strange.later_s[0];
        self.to_board.push(due_s, bytes.to_vec());
    }
    fn truth(&self) -> Truth {
        let m = &self.motion;
        let pos = m.pos();
        let mass = self.craft.mass_kg;
        Truth {
            t_us: (self.now_s() * 1e6).round() as u64,
            pos_E_m: Vec3::from_raw(pos),
            vel_E_mps: Vec3::from_raw(m.vel()),
            R_EB: Rot::from_raw(m.attitude()),
            rate_B_radps: Vec3::from_raw(m.rate()),
            acc_B_mps2: Vec3::from_raw(m.loads.force_B_n / mass),
            wind_E_mps: Vec3::from_raw(self.around.wind_E_mps),
            height_m: -pos.z - self.craft.gear_m,
            flap_hz: m.flap_hz(),
            dihedral_rad: m.servos()[0],
            yaw_servo_rad: m.servos()[1],
            thrust_n: m.loads.thrust_n,
            supply_v: m.supply_v,
            current_a: m.current_a,
            charge_frac: self.charge_frac(),
            board_north_rad: self.north_rad,
            on_ground: m.loads.touches,
            landed: self.idle_s >= 0.5,
            armed: self.pilotage.armed,
            crashed: self.crashed,
        }
    }
}
