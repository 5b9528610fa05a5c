//! A recorded flight with motion capture, whatever file it came from.

use std::path::PathBuf;

use haltere_core::frames::{B, E, Rot, Vec3};

/// What can go wrong with a recording.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file could not be read.
    #[error("{path}: {source}")]
    Io {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A column that the balance needs is not there.
    #[error(
        "{path}: no column `{column}`; a force balance needs command, voltage, tilt and motion capture"
    )]
    Column {
        /// Which file.
        path: PathBuf,
        /// What is missing.
        column: &'static str,
    },
    /// The file does not keep to its layout.
    #[error("{path}: line {line}: {what}")]
    Layout {
        /// Which file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What was found and what was allowed.
        what: String,
    },
    /// No row could be used.
    #[error("{path}: no usable row of {rows}: {skipped}")]
    Empty {
        /// Which file.
        path: PathBuf,
        /// Rows in it.
        rows: usize,
        /// Why each was left out.
        skipped: Skipped,
    },
}

/// One row, in our frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Time on the vehicle's clock, s.
    pub t_s: f64,
    /// Position by motion capture, m.
    pub pos_E_m: Vec3<E>,
    /// Attitude: tilt from the vehicle, heading from motion capture.
    pub R_EB: Rot<E, B>,
    /// Thrust command, 0 to 1.
    pub thrust_frac: f64,
    /// Battery, V.
    pub supply_v: f64,
    /// Roll and pitch by motion capture less those on board, rad.
    pub tilt_apart_rad: [f64; 2],
    /// Specific force by the accelerometer, if the file has it, m/s².
    pub acc_B_mps2: Option<Vec3<B>>,
    /// Angular rate by the gyroscope, if the file has it, rad/s.
    pub rate_B_radps: Option<Vec3<B>>,
    /// Setpoint of roll, pitch and yaw, if the file has it, rad.
    pub setpoint_rad: Option<[f64; 3]>,
}

/// Rows that were left out, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Skipped {
    /// Cut short or not a number.
    pub unreadable: usize,
    /// More values than columns.
    pub too_long: usize,
    /// Before the first log packet: no voltage yet, or none that can be.
    pub no_voltage: usize,
    /// Motion capture had the vehicle on its head.
    pub reference_flipped: usize,
    /// Time did not advance.
    pub time_backwards: usize,
}

impl std::fmt::Display for Skipped {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let reasons = [
            (self.too_long, "with more values than columns"),
            (self.unreadable, "without a number in each column"),
            (self.no_voltage, "without a voltage that can be"),
            (self.reference_flipped, "with the vehicle on its head"),
            (self.time_backwards, "with the time of the row before"),
        ];
        let words = reasons.iter().filter(|(count, _)| *count > 0);
        let words: Vec<String> = words.map(|(count, why)| format!("{count} {why}")).collect();
        f.write_str(&words.join(", "))
    }
}

impl Skipped {
    /// All of them.
    pub fn total(&self) -> usize {
        let Self { unreadable, too_long, no_voltage, reference_flipped, time_backwards } = self;
        unreadable + too_long + no_voltage + reference_flipped + time_backwards
    }
}

/// One recorded flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Name of the file without its endings.
    pub name: String,
    /// Its rows, in the order of time.
    pub rows: Vec<Row>,
    /// What was left out.
    pub skipped: Skipped,
}
