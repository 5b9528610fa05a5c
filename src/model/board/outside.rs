//! The board as a Crazyflie's firmware in another program: the plant is its sensors, its anchors and its motors, and its
//! time passes with the plant's alone.

use haltere_core::checks::Problems;
use haltere_dialect::crtp::ToBoard;
use haltere_dialect::crtp::supervisor::SupervisorRequest;

use crate::board::Board;
use crate::board::crazyflie::ANCHORS;
use crate::effects::{ImuReading, STEP_S};
use crate::faults::CrazyflieFault;
use crate::tag::Reception;
use crate::wings::ActuatorCommand;

/// Share of the pitch servo's stroke that the Flapper's mixer uses (`pitch_ampl`, power_distribution_flapper.c): with it
/// the wings are at the end of their travel.
pub(super) const PITCH_STROKE_FRAC: f64 = 0.4;
/// A motor that is told less than this stands.
const STANDS_FRAC: f64 = 0.01;

/// Such a firmware, running.
pub trait Outside: Send {
    /// Takes bytes of its client: packets behind their lengths, cut anywhere.
    fn receive(&mut self, bytes: &[u8]);
    /// Takes a frame that its deck hears, and where the sender says that it stands, in the anchors' world, z up, m.
    fn hear(&mut self, r: &Reception<'_>, said_m: Option<[f32; 3]>);
    /// Its UWB chip dies or comes back.
    fn chip(&mut self, dead: bool);
    /// Runs it for a step of 2 ms. What it says goes to `out`, each packet behind its length; its outputs m1 to m4, 0 to 1.
    fn step(&mut self, imu: &ImuReading, volt: f64, out: &mut Vec<u8>) -> [f64; 4];
}

/// It, and what it last told its motors.
pub(super) struct Outer {
    program: Box<dyn Outside>,
    anchors_m: [Option<[f32; 3]>; ANCHORS],
    outputs_frac: [f64; 4],
    wrecked: bool,
    /// Steps in which nothing passes between it and its client.
    silent_steps: u64,
}

impl Outer {
    /// Whether a motor turns that lifts: all that shows from outside of its being armed.
    pub fn lifts(&self) -> bool {
        let [_, left, _, right] = self.outputs_frac;
        !self.wrecked && left.max(right) > STANDS_FRAC
    }

    /// The airframe is broken: whatever it says, no motor turns.
    pub fn wreck(&mut self) {
        self.wrecked = true;
    }

    pub fn receive(&mut self, bytes: &[u8]) {
        if self.silent_steps == 0 {
            self.program.receive(bytes);
        }
    }

    pub fn hear(&mut self, r: &Reception<'_>) {
        let said_m = self.anchors_m.get(usize::from(r.source)).copied().flatten();
        self.program.hear(r, said_m);
    }

    pub fn step(&mut self, imu: &ImuReading, volt: f64, out: &mut Vec<u8>) {
        let before = out.len();
        self.outputs_frac = self.program.step(imu, volt, out);
        if self.silent_steps > 0 {
            self.silent_steps -= 1;
            out.truncate(before);
        }
    }

    /// Breaks or mends it. `false`: this cannot be done from outside.
    pub fn inject(&mut self, fault: &CrazyflieFault) -> bool {
        let order = match fault {
            CrazyflieFault::ChipDead(dead) => {
                self.program.chip(*dead);
                None
            }
            CrazyflieFault::Fade { for_s } => {
                self.silent_steps = (for_s / STEP_S) as u64;
                None
            }
            CrazyflieFault::Disarm => Some(SupervisorRequest::Arm(false)),
            CrazyflieFault::Lock => Some(SupervisorRequest::EmergencyStop),
            _ => return false,
        };
        // As another client would.
        if let Some(packet) = order.and_then(|order| ToBoard::Supervisor(order).encode()) {
            self.program.receive(&[packet.bytes().len() as u8]);
            self.program.receive(packet.bytes());
        }
        true
    }

    /// Outputs m1 to m4, 0 to 1.
    pub fn outputs_frac(&self) -> [f64; 4] {
        if self.wrecked { [0.0; 4] } else { self.outputs_frac }
    }

    /// Outputs of the Flapper's mixer, revision D: pitch servo, left motor, yaw servo, right motor. More is nose up, and of
    /// the yaw servo nose left; `limits_rad` is the travel of dihedral and wing roots.
    pub fn wings(&self, limits_rad: [f64; 2]) -> ActuatorCommand {
        if self.wrecked {
            return ActuatorCommand::default();
        }
        let [pitch, left, yaw, right] = self.outputs_frac;
        let travel = |share: f64, limit_rad: f64| share.clamp(-1.0, 1.0) * limit_rad;
        ActuatorCommand {
            flap_frac: [left, right],
            dihedral_rad: travel((2.0 * pitch - 1.0) / PITCH_STROKE_FRAC, limits_rad[0]),
            yaw_servo_rad: travel(1.0 - 2.0 * yaw, limits_rad[1]),
        }
    }
}

impl Board {
    /// From now on this firmware is the board, in the place of the Crazyflie that was played. Refused where it plays none.
    pub(crate) fn be(&mut self, program: Box<dyn Outside>) -> Result<(), Problems> {
        let Some(played) = self.crazyflie.take() else {
            return Err(Problems::one(
                "board.firmware: not a Crazyflie, which this firmware is of",
            ));
        };
        let anchors_m = played.anchors_m();
        let outputs_frac = [0.5, 0.0, 0.5, 0.0];
        self.outside =
            Some(Outer { program, anchors_m, outputs_frac, wrecked: false, silent_steps: 0 });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::Firmware;
    use crate::{Plant, PlantConfig};

    /// Says what it hears, gives the same outputs all the time.
    struct Constant([f64; 4]);

    impl Outside for Constant {
        fn receive(&mut self, _: &[u8]) {}
        fn hear(&mut self, _: &Reception<'_>, said_m: Option<[f32; 3]>) {
            assert!(said_m.is_some());
        }
        fn chip(&mut self, _: bool) {}
        fn step(&mut self, imu: &ImuReading, volt: f64, out: &mut Vec<u8>) -> [f64; 4] {
            assert!(imu.acc_B_mps2.norm() > 0.1 && volt > 6.0);
            out.extend([1, 0x5C]);
            self.0
        }
    }

    fn flown(outputs: [f64; 4], for_us: u64) -> Plant {
        let mut config = PlantConfig::hall(1);
        config.board.firmware = Firmware::Crazyflie;
        let mut plant = Plant::new(config).unwrap();
        plant.fly_by(Box::new(Constant(outputs)), None).unwrap();
        plant.advance_to(for_us);
        plant
    }

    #[test]
    fn prop_outputs_of_the_flappers_mixer_turn_the_vehicle_their_way() {
        let rates = |outputs: [f64; 4]| {
            let plant = flown(outputs, 600_000);
            plant.truth().rate_B_radps.raw()
        };
        assert!(rates([0.53, 0.8, 0.5, 0.8]).y > 0.01, "more of m1 is nose up");
        assert!(rates([0.5, 0.8, 0.45, 0.8]).z > 0.01, "less of m3 is nose right");
        assert!(rates([0.5, 0.82, 0.5, 0.78]).x > 0.01, "more of m2 is right side down");
    }

    #[test]
    fn prop_it_is_heard_armed_while_its_motors_turn_and_refused_by_other_boards() {
        let mut plant = flown([0.5, 0.0, 0.5, 0.0], 100_000);
        assert!(!plant.truth().armed && plant.board_output().len() > 50);
        assert!(flown([0.5, 0.7, 0.5, 0.7], 100_000).truth().armed);
        let mut other = Plant::new(PlantConfig::hall(1)).unwrap();
        assert!(other.fly_by(Box::new(Constant([0.0; 4])), None).is_err());
        assert!(plant.inject(crate::Fault::Crazyflie(CrazyflieFault::ChipDead(true))).is_ok());
        assert!(plant.inject(crate::Fault::Crazyflie(CrazyflieFault::MainReset)).is_err());
    }
}
