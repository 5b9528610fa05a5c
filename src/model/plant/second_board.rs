//! A second board on the line, with the system id of ours: another vehicle of the same lab.
//!
//! It stands level on the floor, disarmed, and hears nobody. Its clock and its sequence numbers are its own.

use nalgebra::Vector3;

use super::FLOOR_PRESSURE_PA;
use crate::board::{Board, BoardSettings, Readings};
use crate::effects::{ImuReading, State, Supply};
use crate::faults::SecondVoice;
use crate::random::Stream;
use crate::vehicle::Vehicle;
use haltere_core::frames::G_MPS2;

/// Noise of its accelerometer and its gyroscope at rest, m/s² and rad/s. Assumed: cheap MEMS parts, motors off.
const STD_ACC_MPS2: f64 = 0.05;
const STD_RATE_RADPS: f64 = 0.003;
/// Time since its boot when it begins to speak, µs: an hour ahead of any of ours.
const BOOT_US: u64 = 3_600_000_000;

/// The board and what it reads.
pub(super) struct SecondBoard {
    board: Board,
    state: State,
    supply: Supply,
    rng: Stream,
}

impl SecondBoard {
    pub fn new(
        voice: SecondVoice,
        ours: &BoardSettings,
        vehicle: &Vehicle,
        supply: Supply,
        seed: u64,
    ) -> Self {
        let mut board = Board::new(BoardSettings { boot_us: BOOT_US, ..ours.clone() }, vehicle);
        if voice == SecondVoice::Everything {
            board.say_everything();
        }
        let (state, rng) = (State::default(), Stream::new(seed, "fault-second-board"));
        Self { board, state, supply, rng }
    }

    /// Appends what it says in this step to `out`.
    pub fn send(&mut self, t_us: u64, imu_step: bool, out: &mut Vec<u8>) {
        let mut noise = |std| Vector3::from_fn(|_, _| std * self.rng.normal());
        let imu = ImuReading {
            acc_B_mps2: Vector3::new(0.0, 0.0, -G_MPS2) + noise(STD_ACC_MPS2),
            rate_B_radps: noise(STD_RATE_RADPS),
            pressure_pa: FLOOR_PRESSURE_PA,
        };
        let readings = Readings {
            t_us,
            state: &self.state,
            imu: &imu,
            imu_alive: [true; 3],
            field_B_ut: None,
            supply: &self.supply,
        };
        self.board.send(&readings, imu_step, out);
    }
}
