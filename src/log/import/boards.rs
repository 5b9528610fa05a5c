//! What the logs of PX4 and ArduPilot hold of a flight: commands of the motors in the order of the board's outputs, and beside each
//! the last height, speed and voltage that were logged before it.

use std::path::Path;

use super::dataflash::{self, DataFlash};
use super::events::Event;
use super::motors::{Dropped, Error, MOTORS, MotorFlight, MotorRow, bytes, refuse};
use super::ulog::{self, ULog};
use crate::log_file::shown_name;

/// Pulses of an output between none and all, µs, where nothing else is told.
const PULSE_US: [f64; 2] = [1000.0, 2000.0];
/// Pulses that no output of another unit has, µs.
const PULSES_US: std::ops::RangeInclusive<f64> = 800.0..=2200.0;
/// Age beyond which a value is none, s: boards log the voltage once or twice a second.
const OLDEST_S: f64 = 5.0;
/// `SERVOn_FUNCTION` of the first motor, and how many outputs have one that is logged in `RCOU`.
const FIRST_MOTOR: f64 = 33.0;
const OUTPUTS: usize = 14;

/// Reads a log of PX4 (`.ulg`), packed by gzip or not.
pub fn read_ulog(path: &Path) -> Result<MotorFlight, Error> {
    of_ulog(&bytes(path)?, &shown_name(path)).map_err(|what| refuse(path, what))
}

/// Reads a log of ArduPilot (`.bin`), packed by gzip or not.
pub fn read_dataflash(path: &Path) -> Result<MotorFlight, Error> {
    of_dataflash(&bytes(path)?, &shown_name(path)).map_err(|what| refuse(path, what))
}

/// Values on a clock of their own.
struct Series {
    time_s: Vec<f64>,
    values: Vec<f64>,
}

impl Series {
    /// Of the records of the first instance of a message (`I` or `Instance` of a battery, `C` of a filter's core).
    fn of(
        event: &Event,
        value: impl Fn(&dyn Fn(&str) -> Option<f64>) -> Option<f64>,
    ) -> Option<Self> {
        let place = |name: &str| event.variables.iter().position(|variable| variable == name);
        let instance = ["I", "Inst", "Instance", "C"].iter().find_map(|name| place(name));
        let mut series = Self { time_s: Vec::new(), values: Vec::new() };
        for (t_s, record) in
            event.time_s.iter().zip(event.values.chunks_exact(event.variables.len().max(1)))
        {
            let of = |name: &str| place(name).map(|at| record[at]);
            let is_first = instance.is_none_or(|at| record[at] == 0.0);
            if let Some(value) = value(&of).filter(|value| value.is_finite() && is_first) {
                series.time_s.push(*t_s);
                series.values.push(value);
            }
        }
        (!series.values.is_empty()).then_some(series)
    }

    /// The last one before this time.
    fn at(&self, t_s: f64) -> Option<f64> {
        let next = self.time_s.partition_point(|at| *at <= t_s);
        let last = next.checked_sub(1)?;
        (t_s - self.time_s[last] <= OLDEST_S).then(|| self.values[last])
    }
}

/// What stands beside the commands.
struct Beside {
    supply_v: Option<Series>,
    height_m: Option<Series>,
    speed_mps: Option<Series>,
}

fn flight(
    name: &str,
    commands: String,
    event: &Event,
    fracs: &[Vec<f64>; MOTORS],
    beside: &Beside,
    unread_bytes: usize,
) -> MotorFlight {
    let dropped = Dropped { unread_bytes, ..Dropped::default() };
    let mut flight = MotorFlight { name: name.into(), commands, rows: Vec::new(), dropped };
    for (k, t_s) in event.time_s.iter().enumerate() {
        let at = |series: &Option<Series>| series.as_ref().and_then(|series| series.at(*t_s));
        flight.push(MotorRow {
            t_s: *t_s,
            // Without a number the motor is told nothing.
            command_frac: [0, 1, 2, 3]
                .map(|m| if fracs[m][k].is_nan() { 0.0 } else { fracs[m][k] }),
            supply_v: at(&beside.supply_v),
            height_m: at(&beside.height_m),
            speed_mps: at(&beside.speed_mps),
            // These boards are calibrated: what is left is none of the board's marks.
            accel_g: [None; 3],
        });
    }
    flight
}

/// Columns of the motors by the name of each.
fn columns(event: &Event, names: [String; MOTORS]) -> Option<[Vec<f64>; MOTORS]> {
    let all: Option<Vec<Vec<f64>>> =
        names.iter().map(|name| event.column(name).map(Iterator::collect)).collect();
    all?.try_into().ok()
}

/// Commands of pulses, 0 to 1.
fn of_pulses(pulses: [Vec<f64>; MOTORS], [least, most]: [f64; 2]) -> [Vec<f64>; MOTORS] {
    pulses.map(|motor| {
        motor.into_iter().map(|us| ((us - least) / (most - least)).clamp(0.0, 1.0)).collect()
    })
}

fn are_pulses(columns: &[Vec<f64>; MOTORS]) -> bool {
    let mut told = columns.iter().flatten().filter(|us| **us != 0.0).peekable();
    told.peek().is_some() && told.all(|us| PULSES_US.contains(us))
}

/// The flight of a log of PX4: `actuator_motors` from version 1.13 on, else outputs that are pulses.
fn of_ulog(bytes: &[u8], name: &str) -> Result<MotorFlight, String> {
    let wanted =
        ["actuator_motors", "actuator_outputs", "battery_status", "vehicle_local_position"];
    let log = ulog::parse(bytes, &wanted).map_err(|why| why.to_string())?;
    let (event, fracs) = px4_motors(&log).ok_or_else(|| {
        format!(
            "neither actuator_motors nor pulses in actuator_outputs of {MOTORS} motors are there, which say what they were told \
             (SDLOG_PROFILE); logged were {}",
            log.topics.join(", ")
        )
    })?;
    if event.column("control[4]").is_some_and(|mut fifth| fifth.any(f64::is_finite)) {
        return Err(format!("actuator_motors has more than {MOTORS} motors; quadrotors are known"));
    }
    let find = |topic: &str| log.events.iter().find(|event| event.name == topic);
    let battery = find("battery_status");
    let position = find("vehicle_local_position");
    let beside = Beside {
        supply_v: battery
            .and_then(|event| Series::of(event, |of| of("voltage_v").filter(|volt| *volt > 0.0))),
        height_m: position.and_then(|event| Series::of(event, |of| Some(-of("z")?))),
        speed_mps: position
            .and_then(|event| Series::of(event, |of| Some(of("vx")?.hypot(of("vy")?)))),
    };
    Ok(flight(name, event.name.clone(), event, &fracs, &beside, log.unread_bytes))
}

fn px4_motors(log: &ULog) -> Option<(&Event, [Vec<f64>; MOTORS])> {
    let named = |field: &str| [0, 1, 2, 3].map(|k| format!("{field}[{k}]"));
    let motors =
        log.events.iter().find(|event| event.name == "actuator_motors" && !event.time_s.is_empty());
    let told = motors.and_then(|event| Some((event, columns(event, named("control"))?)));
    told.or_else(|| {
        let outputs = log.events.iter().filter(|event| event.name.starts_with("actuator_outputs"));
        let pulses = outputs.filter_map(|event| Some((event, columns(event, named("output"))?)));
        let (event, pulses) = pulses.into_iter().find(|(_, columns)| are_pulses(columns))?;
        Some((event, of_pulses(pulses, PULSE_US)))
    })
}

/// The flight of a log of ArduPilot: the outputs whose function is a motor.
fn of_dataflash(bytes: &[u8], name: &str) -> Result<MotorFlight, String> {
    let wanted = ["RCOU", "BAT", "CURR", "XKF1", "NKF1"];
    let log =
        dataflash::parse(bytes, &wanted).ok_or("holds no message of a log of ArduPilot (.bin)")?;
    let find =
        |names: &[&str]| log.events.iter().find(|event| names.contains(&event.name.as_str()));
    let told = find(&["RCOU"]).and_then(|event| {
        let outputs = ardupilot_outputs(&log);
        let named = |prefix: &str| outputs.map(|output| format!("{prefix}{output}"));
        let pulses = columns(event, named("C")).or_else(|| columns(event, named("Ch")))?;
        are_pulses(&pulses).then_some((event, pulses))
    });
    let (event, pulses) = told.ok_or_else(|| {
        format!(
            "no pulses of {MOTORS} motors are there (RCOU, LOG_BITMASK with RCOUT), which say what they were told; logged were {}",
            log.messages.join(", ")
        )
    })?;
    let told = |key: &str, usual: f64| {
        log.parameters.get(key).copied().filter(|us| *us > 0.0).unwrap_or(usual)
    };
    let ends = [told("MOT_PWM_MIN", PULSE_US[0]), told("MOT_PWM_MAX", PULSE_US[1])];
    let ends = if ends[0] < ends[1] { ends } else { PULSE_US };
    let state = find(&["XKF1"]).or_else(|| find(&["NKF1"]));
    let beside = Beside {
        supply_v: find(&["BAT", "CURR"])
            .and_then(|event| Series::of(event, |of| of("Volt").filter(|volt| *volt > 0.0))),
        height_m: state.and_then(|event| Series::of(event, |of| Some(-of("PD")?))),
        speed_mps: state.and_then(|event| Series::of(event, |of| Some(of("VN")?.hypot(of("VE")?)))),
    };
    let outputs = ardupilot_outputs(&log).map(|output| format!(" {output}")).concat();
    let commands = format!("RCOU, outputs{outputs}");
    Ok(flight(name, commands, event, &of_pulses(pulses, ends), &beside, log.unread_bytes))
}

/// Which outputs turn the motors: by their function, or else the first four.
fn ardupilot_outputs(log: &DataFlash) -> [usize; MOTORS] {
    let output = |motor: usize| {
        let is = |output: &usize| {
            let function = log.parameters.get(&format!("SERVO{output}_FUNCTION"));
            function.is_some_and(|function| *function == FIRST_MOTOR + motor as f64)
        };
        (1..=OUTPUTS).find(is)
    };
    let all = [0, 1, 2, 3].map(output);
    if all.iter().all(Option::is_some) { all.map(Option::unwrap_or_default) } else { [1, 2, 3, 4] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(name: &str, variables: &[&str], records: &[(f64, &[f64])]) -> Event {
        Event {
            name: name.into(),
            variables: variables.iter().map(ToString::to_string).collect(),
            time_s: records.iter().map(|record| record.0).collect(),
            values: records.iter().flat_map(|record| record.1.to_vec()).collect(),
        }
    }

    #[test]
    fn prop_the_value_of_a_row_is_the_last_of_the_first_instance_and_not_too_old() {
        let records: [(f64, &[f64]); 3] =
            [(1.0, &[0.0, 11.0]), (1.5, &[1.0, 7.0]), (2.0, &[0.0, 10.0])];
        let battery = event("BAT", &["Instance", "Volt"], &records);
        let series = Series::of(&battery, |of| of("Volt")).unwrap();
        let at = [0.9, 1.7, 2.0, 7.1].map(|t_s| series.at(t_s));
        assert_eq!(at, [None, Some(11.0), Some(10.0), None]);
    }

    #[test]
    fn prop_motors_of_ardupilot_are_the_outputs_with_their_function() {
        let mut log = DataFlash::default();
        assert_eq!(ardupilot_outputs(&log), [1, 2, 3, 4]);
        for (output, motor) in [(9, 33.0), (10, 34.0), (3, 35.0), (4, 36.0), (1, 0.0)] {
            log.parameters.insert(format!("SERVO{output}_FUNCTION"), motor);
        }
        assert_eq!(ardupilot_outputs(&log), [9, 10, 3, 4]);
    }

    #[test]
    fn prop_pulses_become_commands_and_other_units_are_no_pulses() {
        let of = |us: f64| [vec![us, 0.0], vec![us, us], vec![us, us], vec![us, us]];
        assert!(are_pulses(&of(1500.0)) && !are_pulses(&of(0.5)) && !are_pulses(&of(0.0)));
        assert_eq!(of_pulses(of(1500.0), [1000.0, 2000.0])[0], [0.5, 0.0]);
    }

    #[test]
    fn prop_what_is_no_log_is_refused_with_what_is_needed() {
        let why = of_ulog(b"ULog", "a").unwrap_err();
        assert!(why.contains("PX4"), "{why}");
        let head = [&b"ULog\x01\x12\x35\x01"[..], &[0; 8], &[9, 0], b"A\0\x01\0cpuloa"].concat();
        let why = of_ulog(&head, "a").unwrap_err();
        assert!(why.contains("actuator_motors") && why.ends_with("cpuloa"), "{why}");
        let why = of_dataflash(&[7; 99], "a").unwrap_err();
        assert!(why.contains("ArduPilot"), "{why}");
    }
}
