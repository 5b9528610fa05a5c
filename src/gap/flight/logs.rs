//! Gate 0: a log is a flight of ours only when what was flown is known.
//!
//! Everything behind this gate rests on "each block's logged inputs": a lost input or another
//! parameter looks like a gap in the physics and is none (GAP.md 2.0). So the replay is
//! not only checked, it also is where the trace comes from. A log of the same source must send the same bytes
//! again. One of another source outlives it: what the diagnosis rests on are the setpoints for the board, and
//! where this build would have sent others, those recorded are judged. Its inputs must fit one another then,
//! since that is all that can still be asked.

use std::path::{Path, PathBuf};

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use serde::Serialize;

use crate::flight::as_flown::AsFlown;
use crate::flight::content::Content;
use crate::flight::trace::Trace;
use crate::scene::{Scene, Told};
use haltere_core::survey::Survey;
use haltere_log::record::{LogFlight, LogReader};
use haltere_log::replay::{
    Differs, ReplayError, Report, Verdict, flights, recorded_config, replay_observed,
};
use haltere_model::room::Room;
use haltere_pilot::settings::Config;
use haltere_pilot::{Mode, PilotConfig};

/// Fewest IMU samples, board attitudes and TDOA a second in the air with which a flight is judged.
/// Residuals lie on a grid of 25 Hz: two IMU samples a point are the least that can be averaged; the
/// other two are judgement, a fifth of what companion and tag usually get.
const LEAST_IMU_HZ: f64 = 50.0;
const LEAST_ATTITUDE_HZ: f64 = 10.0;
const LEAST_TDOA_HZ: f64 = 20.0;

/// What is left out before a mission ended early, s: the fall itself looks the same whatever its cause.
const LAST_MOMENTS_S: f64 = 1.0;
/// Grid of the parts that are compared, s: each part needs a bank of its own, which takes minutes (judgement).
const PART_GRID_S: f64 = 20.0;
/// Least part of a mission that says anything, s: climb and the first hover.
const LEAST_PART_S: f64 = 20.0;

/// What is said of a shadow's log: a block is judged against simulated flights of the same commands, and these are
/// somebody else's.
const SHADOW_LOG: &str = "a shadow's log (flight.shadow): somebody else flew. mission, controller, link, inner_loop, \
     thrust, aerodynamics and actuators cannot be judged, their commands are not in it; imu, uwb, estimator, battery \
     and timing can be looked at with `haltere report`, and what we would have commanded beside what the board \
     flew to with `haltere log export --topic shadow`";

/// A log that was read and replayed.
#[derive(Debug, Clone)]
pub struct Flown {
    /// Which log.
    pub path: PathBuf,
    /// Which flight in it; `None`: it holds none.
    pub flight: Option<LogFlight>,
    /// What the replay came to.
    pub replay: Report,
    /// Everything that the diagnosis may see.
    pub trace: Trace,
    /// As uploaded.
    pub mission: Vec<MISSION_ITEM_INT_DATA>,
    /// The configuration that was flown.
    pub config: Config,
    /// Reasons why this log cannot be judged; empty: it can.
    pub faults: Vec<String>,
    /// What is odd about it, but no reason to stop.
    pub remarks: Vec<String>,
    /// Keys whose value differs from the default configuration, flown against default.
    pub parameters: Vec<ParameterDifference>,
    /// What it is known by in another file.
    content: Content,
}

/// A key of the configuration that is not at its default.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterDifference {
    /// Key with its sections.
    pub key: String,
    /// As flown.
    pub flown: String,
    /// As by default.
    pub default: String,
}

/// Reads and replays a log, and takes its last flight.
pub fn read(path: &Path) -> Result<Flown, ReplayError> {
    read_flight(path, None)
}

/// The same with a flight of that number, from 1; without one the last.
pub fn read_flight(path: &Path, asked: Option<usize>) -> Result<Flown, ReplayError> {
    read_log(&LogReader::open(path)?, asked)
}

/// The same of a log that is open already.
pub fn read_log(log: &LogReader, asked: Option<usize>) -> Result<Flown, ReplayError> {
    let session = log.session();
    let part = flights(log)?.part(log, asked)?;
    let mut trace = Trace::new(session.survey.clone());
    let (replay, mission) = replay_observed(log, &part, |topic| trace.take(topic))?;
    if !replay.same_source && replay.differs == Some(Differs::Setpoints) {
        AsFlown::of(log, &part).put_into(&mut trace);
    }
    let config = recorded_config(log)?;
    let content = Content::of(&trace);
    let mut flown = Flown {
        path: log.path().to_owned(),
        flight: part.flight(),
        parameters: differences(&config, &Config::default()),
        mission: mission.items.iter().map(|item| item.wire.clone()).collect(),
        replay,
        trace,
        config,
        content,
        faults: Vec::new(),
        remarks: Vec::new(),
    };
    flown.examine();
    Ok(flown)
}

impl Flown {
    /// Whether this and another log are of one flight, whatever their files are called and whichever part they hold.
    pub fn is_of_the_flight_of(&self, other: &Self) -> bool {
        self.content.is_of_the_flight_of(&other.content)
    }

    fn examine(&mut self) {
        self.remarks.extend(self.flight.and_then(|flight| flight.words()));
        if self.replay.same_source {
            self.examine_replay();
        } else {
            self.examine_replay_of_another();
        }
        if self.config.flight.shadow {
            self.faults.push(SHADOW_LOG.to_owned());
            return;
        }
        let Some(air_s) = air_s(&self.trace) else {
            self.faults.push("the vehicle was never in the air".to_owned());
            return;
        };
        if let Some(part) = self.trace.mission_part().filter(|part| !part.whole) {
            match comparable_s(part.flown_s) {
                None => self.faults.push(format!(
                    "the mission was flown for {:.0} s only, at least {:.0} s needed",
                    part.flown_s,
                    LEAST_PART_S + LAST_MOMENTS_S
                )),
                Some(until_s) => self.remarks.push(format!(
                    "the mission ended early, after {:.0} s: its first {until_s:.0} s are compared",
                    part.flown_s
                )),
            }
        } else if self.trace.modes.last().is_some_and(|m| m.armed) {
            self.remarks.push("the log ends before the vehicle was disarmed".to_owned());
        }
        let mut rate = |what: &str, count: usize, least_hz: f64| {
            let hz = count as f64 / air_s;
            if hz < least_hz {
                self.faults.push(format!("{what} at {hz:.0} Hz, at least {least_hz:.0} needed"));
            }
        };
        rate("IMU", self.trace.imu.len(), LEAST_IMU_HZ);
        rate("board attitude", self.trace.attitudes.len(), LEAST_ATTITUDE_HZ);
        rate("TDOA", self.trace.uwb.len(), LEAST_TDOA_HZ);
        let backward = self.trace.imu.windows(2).filter(|w| w[1].valid_at < w[0].valid_at).count();
        if backward > 0 {
            self.remarks.push(format!("{backward} IMU stamps run backwards"));
        }
        if !self.replay.log_end.starts_with("complete") {
            self.remarks.push(format!("log {}", self.replay.log_end));
        }
    }

    /// The same source sends the same bytes, or the log is not what was flown.
    fn examine_replay(&mut self) {
        match self.replay.verdict {
            Verdict::Identical | Verdict::WithinTolerance => {}
            Verdict::OnlyToHole | Verdict::NothingToCompare => self.examine_extent(),
            Verdict::Different => self.faults.push(match &self.replay.first_difference {
                // What was sent behind this flight is nothing that it rests on.
                Some(d) if self.is_before(d.time_s) => return self.examine_extent(),
                Some(d) => format!(
                    "the replay does not send what was flown, from {:.2} s on: {}",
                    d.time_s, d.what
                ),
                None => "the replay does not send what was flown".to_owned(),
            }),
        }
    }

    fn examine_replay_of_another(&mut self) {
        self.examine_extent();
        let replay = &self.replay;
        let faults = replay.input_faults.iter();
        self.faults.extend(faults.map(|why| format!("the inputs do not fit one another: {why}")));
        if replay.differs == Some(Differs::Setpoints) {
            self.remarks.push(format!(
                "another build flew this, and this one would have sent other setpoints: {}; those recorded \
                 are judged, the estimate is what this build computes",
                replay.setpoints
            ));
        }
        if let Some(words) = replay.other_traffic_words() {
            self.remarks.push(format!(
                "another build flew this, and this one would have sent other messages beside the setpoints, on \
                 which nothing here rests: {words}"
            ));
        }
    }

    /// Whether this flight was over, and is not the last of its log.
    fn is_before(&self, at_s: f64) -> bool {
        self.flight.is_some_and(|flight| flight.number < flight.of && flight.to_s < at_s)
    }

    /// Holes, and logs without an output.
    fn examine_extent(&mut self) {
        if let Some(hole) = self.replay.holes.first().filter(|hole| !self.is_before(hole.from_s)) {
            self.faults.push(format!(
                "the log has a hole at {:.1} s; what lies behind cannot be replayed",
                hole.from_s
            ));
        } else if self.replay.outputs == 0 {
            self.faults.push("the log holds no output to compare the replay with".to_owned());
        }
    }

    /// The scene of this flight. The room is told, or the extent of its anchors is taken for it.
    pub fn scene(&self, told: &Told) -> Scene {
        let survey = self.trace.survey.clone();
        let room = told.room.clone().unwrap_or_else(|| room_of(&survey));
        let start = self
            .trace
            .estimates
            .iter()
            .zip(self.trace.modes.iter().filter(|m| m.armed).map(|m| m.at).next())
            .find(|(e, armed)| e.at >= *armed)
            .map(|(e, _)| [e.pos_E_m.x(), e.pos_E_m.y()]);
        let start_NE_m = start.unwrap_or_else(|| {
            let middle = |[low, high]: [f64; 2]| 0.5 * (low + high);
            [middle(room.north_m), middle(room.east_m)]
        });
        let part = self.trace.mission_part().filter(|part| !part.whole);
        let until_s = part.and_then(|part| comparable_s(part.flown_s));
        // Simulated flights have one station and keep no files: who listened to the real one is no part of
        // the vehicle, and no reason for another bank.
        let nobody = PilotConfig::default();
        let pilot = PilotConfig {
            endpoints: nobody.endpoints,
            routing: nobody.routing,
            store: false,
            ..self.config.pilot()
        };
        let vehicle = told.vehicle.clone();
        Scene { room, survey, start_NE_m, vehicle, pilot, until_s }
    }
}

/// How much of a mission that ended early is compared, s: without the moments in which it ended, and on a
/// grid, so that flights that ended at about the same time share a bank. `None`: too little.
fn comparable_s(flown_s: f64) -> Option<f64> {
    let until_s = ((flown_s - LAST_MOMENTS_S) / PART_GRID_S).floor() * PART_GRID_S;
    (until_s >= LEAST_PART_S).then_some(until_s)
}

/// Time with thrust in a flying mode, s; `None` if there was none.
fn air_s(trace: &Trace) -> Option<f64> {
    let first = trace.modes.iter().find(|m| m.mode == Mode::Takeoff.name())?.at;
    let last = trace.controls.last()?.at;
    let air_s = last.seconds_since(first);
    (air_s > 1.0).then_some(air_s)
}

/// The box around the anchors.
fn room_of(survey: &Survey) -> Room {
    let mut room = Room {
        north_m: [f64::INFINITY, f64::NEG_INFINITY],
        east_m: [f64::INFINITY, f64::NEG_INFINITY],
        ceiling_m: 2.0,
    };
    for pos in survey.ids().iter().filter_map(|id| survey.position_E_m(*id)) {
        room.north_m = [room.north_m[0].min(pos.x()), room.north_m[1].max(pos.x())];
        room.east_m = [room.east_m[0].min(pos.y()), room.east_m[1].max(pos.y())];
        room.ceiling_m = room.ceiling_m.max(-pos.z());
    }
    room
}

/// Keys that differ, in the order of their names.
fn differences(flown: &Config, default: &Config) -> Vec<ParameterDifference> {
    let flat = |config: &Config| {
        let mut rows = Vec::new();
        if let Ok(value) = toml::Value::try_from(config) {
            flatten("", &value, &mut rows);
        }
        rows
    };
    let (flown, default) = (flat(flown), flat(default));
    let mut keys: Vec<&String> = flown.iter().chain(&default).map(|(key, _)| key).collect();
    keys.sort_unstable();
    keys.dedup();
    let of = |rows: &[(String, String)], key: &str| {
        rows.iter().find(|(k, _)| k == key).map_or("not set".to_owned(), |(_, v)| v.clone())
    };
    keys.into_iter()
        .map(|key| ParameterDifference {
            key: key.clone(),
            flown: of(&flown, key),
            default: of(&default, key),
        })
        .filter(|d| d.flown != d.default)
        .collect()
}

fn flatten(key: &str, value: &toml::Value, rows: &mut Vec<(String, String)>) {
    match value {
        toml::Value::Table(table) => {
            for (name, value) in table {
                let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                flatten(&key, value, rows);
            }
        }
        other => rows.push((key.to_owned(), other.to_string())),
    }
}

#[cfg(test)]
mod other_builds;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_parts_of_missions_lie_on_a_grid() {
        assert_eq!(comparable_s(47.0), Some(40.0));
        assert_eq!(comparable_s(40.5), Some(20.0), "the last second is left out");
        assert_eq!(comparable_s(15.0), None);
        assert_eq!(comparable_s(f64::NAN), None);
    }

    #[test]
    fn prop_of_a_shadow_s_log_every_block_is_named_once() {
        for block in [
            "mission",
            "controller",
            "link",
            "inner_loop",
            "thrust",
            "aerodynamics",
            "battery",
            "imu",
            "uwb",
            "estimator",
            "timing",
            "actuators",
        ] {
            let words = |text: &str| {
                text.split(|c: char| !(c.is_alphanumeric() || c == '_'))
                    .filter(|w| *w == block)
                    .count()
            };
            assert_eq!(words(SHADOW_LOG), 1, "{block}");
        }
    }

    #[test]
    fn prop_only_changed_keys_are_told() {
        let mut flown = Config::default();
        flown.limits.battery_low_v = 6.6;
        let rows = differences(&flown, &Config::default());
        assert_eq!(rows.len(), 1);
        assert_eq!((rows[0].key.as_str(), rows[0].flown.as_str()), ("limits.battery_low_v", "6.6"));
    }
}
