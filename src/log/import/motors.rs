//! Flights of other people's multicopters, as what their motors were told: from any file to one neutral form.
//!
//! A file is `usdlog`, a log of PX4 or ArduPilot (`boards.rs`), or a table of text whose columns a file of the user maps
//! (docs/IMPORT.md). What a file does not hold is not made up: it is missing, and who judges the flight says that it was not checked.

use std::io::Read as _;
use std::path::{Path, PathBuf};

use flate2::read::GzDecoder;
use serde::Deserialize;

use super::bounded::Bounded;
use super::events::Event;
use super::usdlog::{self, NoLog, UsdLog};
use crate::intake;
use crate::log_file::shown_name;

/// How many motors are read.
pub const MOTORS: usize = 4;
/// First bytes of what gzip has packed.
const GZIP: [u8; 2] = [0x1F, 0x8B];
/// Most bytes of a file, unpacked: an hour of a thousand records a second, of 70 bytes each.
const MOST_BYTES: u64 = 1 << 28;
/// Full scale of a command in the firmware of the Crazyflie, counts.
const FULL_COUNTS: f64 = 65_535.0;

/// What the motors were told, and what of the vehicle was logged beside it.
#[derive(Debug, Clone, PartialEq)]
pub struct MotorFlight {
    /// Name of the file.
    pub name: String,
    /// The log's own name for the commands.
    pub commands: String,
    /// Rows in the order of time.
    pub rows: Vec<MotorRow>,
    /// What was left out.
    pub dropped: Dropped,
}

/// One instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorRow {
    /// Time, s.
    pub t_s: f64,
    /// Command of each motor, 0 to 1.
    pub command_frac: [f64; MOTORS],
    /// Voltage of the pack, V.
    pub supply_v: Option<f64>,
    /// Height above where the log has its zero, m.
    pub height_m: Option<f64>,
    /// Speed over the ground, m/s.
    pub speed_mps: Option<f64>,
    /// Acceleration forward, left and up by the board's accelerometer, without gravity, g.
    pub accel_g: [Option<f64>; 3],
}

/// What was left out of a file, by the reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Dropped {
    /// Rows without a number for each motor.
    pub unreadable: usize,
    /// Rows that are not later than the row before.
    pub time_backwards: usize,
    /// Bytes that hold no record that can be read.
    pub unread_bytes: usize,
    /// Whether the checksum of the file is not that of its bytes; of files without one never.
    pub checksum_differs: bool,
}

/// Why a file gives no flight.
#[derive(Debug, thiserror::Error)]
#[error("{}: {what}", path.display())]
pub struct Error {
    path: PathBuf,
    what: String,
}

/// Which column of a table is what (`--columns FILE`).
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Columns {
    /// What stands between two values.
    #[serde(default = "comma")]
    pub separator: char,
    /// Time, s.
    pub time_s: Column,
    /// Commands of the motors, 0 to 1, in the order of the vehicle file.
    pub motors_frac: [Column; MOTORS],
    /// Voltage of the pack, V.
    pub supply_v: Option<Column>,
    /// Height, m.
    pub height_m: Option<Column>,
    /// Speed over the ground, m/s.
    pub speed_mps: Option<Column>,
}

/// A column, with what makes the unit that is due of the one that is there: `scale · value + offset`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Column {
    /// Its name in the first line of the table.
    pub column: String,
    /// Factor; negative where the sign is the other one.
    #[serde(default = "one")]
    pub scale: f64,
    /// Added behind it.
    #[serde(default)]
    pub offset: f64,
}

fn comma() -> char {
    ','
}

fn one() -> f64 {
    1.0
}

/// Reads a log of a Crazyflie's memory card, packed by gzip or not.
pub fn read_usdlog(path: &Path) -> Result<MotorFlight, Error> {
    let log = usdlog::parse(&bytes(path)?).map_err(|why: NoLog| refuse(path, why))?;
    of_usdlog(&log, &shown_name(path)).map_err(|what| refuse(path, what))
}

/// Reads a table of text, packed by gzip or not.
pub fn read_table(path: &Path, columns: &Columns) -> Result<MotorFlight, Error> {
    let bytes = bytes(path)?;
    of_table(&String::from_utf8_lossy(&bytes), columns, &shown_name(path))
        .map_err(|what| refuse(path, what))
}

pub(super) fn refuse(path: &Path, what: impl ToString) -> Error {
    Error { path: path.into(), what: what.to_string() }
}

pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, Error> {
    let io = |why: std::io::Error| refuse(path, why);
    let bytes = intake::bytes(path, MOST_BYTES).map_err(io)?;
    if !bytes.starts_with(&GZIP) {
        return Ok(bytes);
    }
    let mut unpacked = Vec::new();
    Bounded::of(GzDecoder::new(&bytes[..]), MOST_BYTES).read_to_end(&mut unpacked).map_err(io)?;
    Ok(unpacked)
}

/// The flight of a log: what each motor was told, or what the controller told the mixer of them.
fn of_usdlog(log: &UsdLog, name: &str) -> Result<MotorFlight, String> {
    let dropped = Dropped {
        unread_bytes: log.unread_bytes,
        checksum_differs: !log.is_whole,
        ..Dropped::default()
    };
    let told = |event: &Event, of: fn(usize) -> String| -> Option<[Vec<f64>; MOTORS]> {
        let columns: Option<Vec<Vec<f64>>> =
            (0..MOTORS).map(|k| event.column(&of(k)).map(Iterator::collect)).collect();
        columns?.try_into().ok()
    };
    let motors = |event: &Event| told(event, |k| format!("motor.m{}", k + 1));
    let mixed = |event: &Event| {
        told(event, |k| format!("controller.cmd_{}", ["thrust", "roll", "pitch", "yaw"][k]))
    };
    let found = log.events.iter().find_map(|event| {
        let counts = motors(event).map(|counts| (counts, "motor.m1 to motor.m4", event));
        counts.or_else(|| {
            Some((mixed(event).map(mix)?, "controller.cmd_*, mixed as for an X", event))
        })
    });
    let (counts, commands, event) = found.ok_or_else(|| {
        let logged: Vec<&str> =
            log.events.iter().flat_map(|event| &event.variables).map(String::as_str).collect();
        format!(
            "neither motor.m1 to motor.m4 nor controller.cmd_thrust, _roll, _pitch, _yaw were logged together, which say what \
             the motors were told; logged were {}",
            logged.join(", ")
        )
    })?;
    let column = |name: &str, scale: f64| -> Option<Vec<f64>> {
        Some(event.column(name)?.map(|value| scale * value).collect())
    };
    let supply_v = column("pm.vbat", 1.0).or_else(|| column("pm.vbatMV", 1e-3));
    let height_m = column("stateEstimate.z", 1.0);
    let velocity = column("stateEstimate.vx", 1.0).zip(column("stateEstimate.vy", 1.0));
    let speed_mps = velocity.map(|(x, y)| x.iter().zip(y).map(|(x, y)| x.hypot(y)).collect());
    let accel_g = accel_g(&column);
    let mut flight =
        MotorFlight { name: name.into(), commands: commands.into(), rows: Vec::new(), dropped };
    for (k, t_s) in event.time_s.iter().enumerate() {
        let at =
            |column: &Option<Vec<f64>>| column.as_ref().and_then(|values| values.get(k)).copied();
        let command_frac = [0, 1, 2, 3].map(|motor| counts[motor][k] / FULL_COUNTS);
        flight.push(MotorRow {
            t_s: *t_s,
            command_frac,
            supply_v: at(&supply_v),
            height_m: at(&height_m),
            speed_mps: at(&speed_mps),
            accel_g: [0, 1, 2].map(|axis| at(&accel_g[axis])),
        });
    }
    Ok(flight)
}

/// Acceleration forward, left and up: the estimate's, which is in the frame of the room, or what was measured.
fn accel_g(column: &dyn Fn(&str, f64) -> Option<Vec<f64>>) -> [Option<Vec<f64>>; 3] {
    let less_g = |up: Option<Vec<f64>>| Some(up?.into_iter().map(|up| up - 1.0).collect());
    let [east, north, up] =
        ["ax", "ay", "az"].map(|of| column(&format!("stateEstimate.{of}"), 1.0));
    let Some((east, north)) = east.zip(north) else {
        let [forward, left] = ["acc.x", "acc.y"].map(|of| column(of, 1.0));
        let measured = column("acc.z", 1.0).or_else(|| column("controller.accelz", 1.0));
        return [forward, left, less_g(measured)];
    };
    let Some(yaw_deg) = column("stateEstimate.yaw", 1.0) else { return [None, None, up] };
    let turned = |of: fn(f64, f64, f64) -> f64| {
        let rows = east.iter().zip(&north).zip(&yaw_deg);
        Some(rows.map(|((east, north), yaw)| of(*east, *north, yaw.to_radians())).collect())
    };
    [
        turned(|x, y, yaw| x * yaw.cos() + y * yaw.sin()),
        turned(|x, y, yaw| y * yaw.cos() - x * yaw.sin()),
        up,
    ]
}

/// The firmware's mixer for an X (`power_distribution_quadrotor.c`): half of roll and pitch, all of yaw.
fn mix([thrust, roll, pitch, yaw]: [Vec<f64>; MOTORS]) -> [Vec<f64>; MOTORS] {
    let signs = [[-0.5, 0.5, 1.0], [-0.5, -0.5, -1.0], [0.5, -0.5, 1.0], [0.5, 0.5, -1.0]];
    signs.map(|[of_roll, of_pitch, of_yaw]| {
        let each = thrust.iter().zip(&roll).zip(pitch.iter().zip(&yaw));
        each.map(|((thrust, roll), (pitch, yaw))| {
            (thrust + of_roll * roll + of_pitch * pitch + of_yaw * yaw).clamp(0.0, FULL_COUNTS)
        })
        .collect()
    })
}

/// The flight of a table. What stands in columns that are not mapped is read over.
fn of_table(text: &str, columns: &Columns, name: &str) -> Result<MotorFlight, String> {
    let mut lines = text.trim_start_matches('\u{feff}').lines();
    let head = lines.find(|line| !line.trim().is_empty() && !line.starts_with('#'));
    let names: Vec<&str> =
        head.unwrap_or_default().split(columns.separator).map(str::trim).collect();
    let place = |wanted: &Column| {
        let at = names.iter().position(|name| *name == wanted.column);
        at.map(|at| (at, wanted.scale, wanted.offset)).ok_or_else(|| {
            format!("no column `{}`; its first line names {}", wanted.column, names.join(", "))
        })
    };
    let time = place(&columns.time_s)?;
    let mut motors = Vec::new();
    for column in &columns.motors_frac {
        motors.push(place(column)?);
    }
    let supply = columns.supply_v.as_ref().map(place).transpose()?;
    let height = columns.height_m.as_ref().map(place).transpose()?;
    let speed = columns.speed_mps.as_ref().map(place).transpose()?;
    let commands: Vec<&str> = columns.motors_frac.iter().map(|c| c.column.as_str()).collect();
    let mut flight = MotorFlight {
        name: name.into(),
        commands: commands.join(", "),
        rows: Vec::new(),
        dropped: Dropped::default(),
    };
    for line in lines.filter(|line| !line.trim().is_empty() && !line.starts_with('#')) {
        let cells: Vec<&str> = line.split(columns.separator).map(str::trim).collect();
        let value = |(at, scale, offset): (usize, f64, f64)| {
            let value: f64 = cells.get(at)?.parse().ok()?;
            Some(scale * value + offset)
        };
        let told: Option<Vec<f64>> = motors.iter().map(|place| value(*place)).collect();
        let Some((t_s, command_frac)) = value(time).zip(told.and_then(|all| all.try_into().ok()))
        else {
            flight.dropped.unreadable += 1;
            continue;
        };
        flight.push(MotorRow {
            t_s,
            command_frac,
            supply_v: supply.and_then(value),
            height_m: height.and_then(value),
            speed_mps: speed.and_then(value),
            accel_g: [None; 3],
        });
    }
    let most = flight.rows.iter().flat_map(|row| row.command_frac).fold(0.0, f64::max);
    if most > 1.01 {
        return Err(format!(
            "a command is {most}, allowed 0 to 1; give the columns of motors_frac a scale, as 1/65535 of counts, or an offset"
        ));
    }
    Ok(flight)
}

impl MotorFlight {
    /// A row more, unless it is none or not later than the last.
    pub fn push(&mut self, row: MotorRow) {
        let is_number = row.t_s.is_finite() && row.command_frac.iter().all(|u| u.is_finite());
        if !is_number {
            self.dropped.unreadable += 1;
        } else if self.rows.last().is_some_and(|last| row.t_s <= last.t_s) {
            self.dropped.time_backwards += 1;
        } else {
            let finite = |value: Option<f64>| value.filter(|value| value.is_finite());
            let [supply_v, height_m, speed_mps] =
                [row.supply_v, row.height_m, row.speed_mps].map(finite);
            let accel_g = row.accel_g.map(finite);
            self.rows.push(MotorRow { supply_v, height_m, speed_mps, accel_g, ..row });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_mixer_is_that_of_the_firmware() {
        // One instant of a recorded flight, with what the motors were told in another at the same trim.
        let mixed = mix([41_243.0, 1594.0, -2763.0, 3522.0].map(|value| vec![value]));
        assert_eq!(mixed.map(|motor| motor[0]), [42_586.5, 38_305.5, 46_943.5, 37_136.5]);
    }

    #[test]
    fn prop_variables_of_a_card_become_commands_and_what_is_missing_is_missing() {
        let names = ["motor.m1", "motor.m2", "motor.m3", "motor.m4", "pm.vbatMV"];
        let event = Event {
            name: "fixedFrequency".into(),
            variables: names.map(String::from).to_vec(),
            time_s: vec![1.0, 0.9, 1.1, 1.2],
            values: [[65_535.0, 0.0, 0.0, 0.0, 3700.0]; 3]
                .concat()
                .into_iter()
                .chain([f64::NAN, 0.0, 0.0, 0.0, 3700.0])
                .collect(),
        };
        let log = UsdLog { events: vec![event], is_whole: true, unread_bytes: 3 };
        let flight = of_usdlog(&log, "a").unwrap();
        assert_eq!(flight.rows.len(), 2);
        assert_eq!(flight.rows[0].command_frac, [1.0, 0.0, 0.0, 0.0]);
        assert_eq!((flight.rows[0].supply_v, flight.rows[0].height_m), (Some(3.7), None));
        let Dropped { unreadable, time_backwards, unread_bytes, checksum_differs } = flight.dropped;
        assert_eq!((unreadable, time_backwards, unread_bytes, checksum_differs), (1, 1, 3, false));
        let none = of_usdlog(&UsdLog::default(), "a").unwrap_err();
        assert!(none.contains("what the motors were told"), "{none}");
    }

    #[test]
    fn prop_a_table_is_read_by_its_map() {
        let map = "separator = \";\"\ntime_s = { column = \"us\", scale = 1e-6 }\n\
                   motors_frac = [{ column = \"a\", scale = 0.001, offset = -1.0 }, { column = \"b\" }, { column = \"b\" }, { column = \"b\" }]\n\
                   height_m = { column = \"down\", scale = -1 }\n";
        let columns: Columns = toml::from_str(map).unwrap();
        let text =
            "# made by hand\nus;a;b;down;else\n1000000;1500;0.4;-1.2;x\n1010000;1500;?;-1.2;x\n";
        let flight = of_table(text, &columns, "a").unwrap();
        assert_eq!(flight.rows.len(), 1);
        let row = flight.rows[0];
        assert_eq!(
            (row.t_s, row.command_frac, row.height_m),
            (1.0, [0.5, 0.4, 0.4, 0.4], Some(1.2))
        );
        assert_eq!((row.supply_v, flight.dropped.unreadable), (None, 1));
        let refused = |text: &str| of_table(text, &columns, "a").unwrap_err();
        assert!(refused("us;a;down\n").contains("no column `b`"));
        assert!(refused("us;a;b;down\n1;1500;40;0\n").contains("a command is 40, allowed 0 to 1"));
    }
}
