//! Test support: a plant and the other end of its board link, flown from the truth.

use haltere_dialect::mav::haltere::{
    AttitudeTargetTypemask, COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult,
    SET_ATTITUDE_TARGET_DATA,
};
use haltere_dialect::mav::known;
use haltere_dialect::mav_stream::{MavSplitter, encode};
use nalgebra::Vector3;

use crate::effects::EffectSet;
use crate::plant::{Plant, PlantConfig};
use crate::truth::Truth;
use haltere_core::frames::{B, E, Rot, Vec3};
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;

/// Anchors in the corners of the hall.
pub fn survey() -> Survey {
    let anchors: Vec<_> = crate::effects::probe::sites()
        .into_iter()
        .enumerate()
        .map(|(i, p)| (AnchorId(i as u8), Vec3::<E>::from_raw(p)))
        .collect();
    Survey::new(&anchors).unwrap()
}

/// Plant and companion's end.
pub struct Rig {
    pub plant: Plant,
    splitter: MavSplitter,
    sequence: u8,
    pub heard: Vec<MavMessage>,
}

impl Rig {
    pub fn new(effects: EffectSet) -> Self {
        Self::with(effects, |_| {})
    }

    pub fn with(effects: EffectSet, edit: impl FnOnce(&mut PlantConfig)) -> Self {
        let mut config = PlantConfig::new(survey(), 7);
        config.effects = effects;
        edit(&mut config);
        let plant = Plant::new(config).unwrap();
        Self { plant, splitter: MavSplitter::new(), sequence: 0, heard: Vec::new() }
    }

    pub fn send(&mut self, message: &MavMessage) {
        let mut bytes = Vec::new();
        encode(&mut bytes, 1, 191, self.sequence, message);
        self.sequence = self.sequence.wrapping_add(1);
        self.plant.board_input(&bytes);
    }

    pub fn command(&mut self, command: MavCmd, p: [f32; 3]) -> Option<MavResult> {
        self.send(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: command as u16,
            param1: p[0],
            param2: p[1],
            param3: p[2],
            target_system: 1,
            target_component: 1,
            ..COMMAND_LONG_DATA::DEFAULT
        }));
        self.heard.clear();
        self.run(0.02);
        self.heard.iter().find_map(|m| match m {
            MavMessage::COMMAND_ACK(ack) if ack.command == command as u16 => known(ack.result),
            _ => None,
        })
    }

    pub fn arm(&mut self) -> Option<MavResult> {
        self.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0])
    }

    pub fn attitude(&mut self, roll_rad: f64, pitch_rad: f64, yaw_rad: f64, thrust: f64) {
        let q = Rot::<E, B>::from_euler_rad(roll_rad, pitch_rad, yaw_rad).to_wxyz();
        self.send(&MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
            q: q.map(|c| c as f32),
            thrust: thrust as f32,
            target_system: 1,
            target_component: 1,
            type_mask: AttitudeTargetTypemask::from_bits_truncate(7),
            ..SET_ATTITUDE_TARGET_DATA::DEFAULT
        }));
    }

    /// Lets time pass without setpoints, collecting what the board says.
    pub fn run(&mut self, seconds: f64) {
        let until = self.plant.t_us() + (seconds * 1e6) as u64;
        self.plant.advance_to(until);
        let mut out = std::mem::take(self.plant.board_output());
        self.splitter.push(&out);
        out.clear();
        *self.plant.board_output() = out;
        while let Some(frame) = self.splitter.next() {
            self.heard.push(frame.unwrap().decode().unwrap());
        }
    }

    /// 100 Hz setpoints of roll, pitch, yaw, thrust from the truth.
    pub fn fly(&mut self, seconds: f64, mut law: impl FnMut(&Truth) -> [f64; 4]) -> Truth {
        for _ in 0..(seconds * 100.0) as usize {
            let truth = self.plant.truth();
            let [roll, pitch, yaw, thrust] = law(&truth);
            self.attitude(roll, pitch, yaw, thrust);
            self.run(0.01);
        }
        self.plant.truth()
    }

    /// Holds a place by the truth, heading north.
    pub fn hover(&mut self, seconds: f64, place_E_m: Vector3<f64>) -> Truth {
        self.fly(seconds, |t| hold(t, place_E_m, [0.0, 0.0]))
    }
}

/// A plain position hold: roll, pitch, yaw, thrust. `lean`: added roll and pitch, rad.
pub fn hold(t: &Truth, place_E_m: Vector3<f64>, lean: [f64; 2]) -> [f64; 4] {
    let e = place_E_m - t.pos_E_m.raw();
    let v = (e * 1.0).map(|v| v.clamp(-1.0, 1.0)) - t.vel_E_mps.raw();
    let thrust = 4.73 / t.supply_v * (1.0 - 0.25 * v.z);
    [0.15 * v.y + lean[0], -0.15 * v.x + lean[1], 0.0, thrust.clamp(0.1, 0.95)]
}
