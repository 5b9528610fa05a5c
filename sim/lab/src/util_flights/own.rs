//! The filter on flights of one's own: a log of the companion lives again, and its estimate is held against a truth.
//!
//! What the filter is told is what it was told in flight: bytes of tag and board, through the same core. The truth is a
//! table of motion capture (`import/truth.rs`) or of the simulator, or motion capture that the companion recorded. It is
//! assumed in the frame of the anchors and of the vehicle's centre; how else it would fit is told and never applied.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use serde::Serialize;

use super::clock::{self, Clock, Frames, Misnamed, NoClock};
use super::flown::Flown;
use super::score::Score;
use super::{FlightReport, Took};
use haltere_core::checks::Problems;
use haltere_core::estimate::{Estimate, Health};
use haltere_core::estimator::Motion;
use haltere_core::measure::ReferencePose;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_log::import::truth::{self, PositionNames, TruthError, Unused};
use haltere_log::log_file::{has_log_ending, shown_name};
use haltere_log::record::{LogError, LogReader};
use haltere_log::replay::{ReplayError, live_again, recorded_config};

/// What the truth of a log is called that lies beside it.
pub const ENDING: &str = "truth.csv";
/// An estimate of the newest IMU sample is carried on to the time of a pose for so long at most, s: the sample comes some
/// ten milliseconds late.
const CARRIED_S: f64 = 0.05;
/// What an estimate was held against.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Beside {
    /// File, or log with motion capture.
    pub source: String,
    /// Poses in it.
    pub poses: u64,
    /// Rows that hold none.
    pub unused: Unused,
    /// What leads to the companion's clock; nothing where it is that clock.
    pub clock: Option<Clock>,
    /// How the truth would fit what flew best. Never applied.
    pub frames: Frames,
    /// Inputs that the log has lost.
    pub lost_inputs: u64,
}

/// Why a log has no row.
#[derive(Debug, thiserror::Error)]
pub enum NotScored {
    /// The log.
    #[error(transparent)]
    Log(#[from] LogError),
    /// Its configuration.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// The configuration that was told.
    #[error("{log}: {problems}")]
    Told {
        /// For which log.
        log: PathBuf,
        /// What is refused.
        problems: Problems,
    },
    /// The truth.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// There is none.
    #[error("{log}: no truth: there is no {looked}, and the log holds no motion capture")]
    Without {
        /// Which log.
        log: PathBuf,
        /// Where it was looked for.
        looked: String,
    },
    /// The truth stands on a clock that cannot be laid over the companion's.
    #[error("{truth}: {why}")]
    Clock {
        /// Which truth.
        truth: String,
        /// Why not.
        why: NoClock,
    },
    /// The filter has seen it.
    #[error(
        "{log}: estimator.fuse_reference = true: the filter is told the motion capture that it is held against; add \
         --set estimator.fuse_reference=false"
    )]
    Fused {
        /// Which log.
        log: PathBuf,
    },
    /// No pose while there was an estimate.
    #[error(
        "{truth}: no pose at a time at which {log} holds an estimate ({poses} poses); is the truth of this flight?"
    )]
    NothingBeside {
        /// Which truth.
        truth: String,
        /// Which log.
        log: PathBuf,
        /// Poses in it.
        poses: u64,
    },
    /// No metres, or other axes.
    #[error("{truth}: {misnamed}")]
    Misnamed {
        /// Which truth.
        truth: String,
        /// What its columns hold.
        misnamed: Box<Misnamed>,
    },
}

/// The logs of a folder in the order of their names, or one log.
pub fn logs(dir: &Path) -> std::io::Result<Vec<PathBuf>> {
    if !dir.is_dir() {
        return Ok(vec![dir.to_owned()]);
    }
    let entries = std::fs::read_dir(dir)?.collect::<Result<Vec<_>, _>>()?;
    let mut logs: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    logs.retain(|path| has_log_ending(path));
    logs.sort();
    Ok(logs)
}

/// Runs the filter that `told` makes of the log on it, and holds it against its truth. `place`: a truth file, or the folder
/// that holds `STEM.truth.csv` or `STEM.csv`; without one it lies beside the log.
pub fn run_log(
    path: &Path,
    place: Option<&Path>,
    told: impl FnOnce(&LogReader) -> Result<Flown, Problems>,
) -> Result<(FlightReport, Flown), NotScored> {
    let log = LogReader::open(path)?;
    let recorded = recorded_config(&log)?;
    let flown =
        told(&log).map_err(|problems| NotScored::Told { log: path.to_owned(), problems })?;
    if flown.estimator.fuse_reference {
        return Err(NotScored::Fused { log: path.to_owned() });
    }
    let (flight, captured) = as_flown(&log, recorded.pilot());
    let truth = Truth::find(path, place, captured, &flight, log.session().pilot_started_at)?;
    let frames = truth.frames(&flight, log.session().pilot_started_at).ok_or_else(|| {
        let (truth, poses) = (truth.source.clone(), truth.poses.len() as u64);
        NotScored::NothingBeside { truth, log: path.to_owned(), poses }
    })?;
    let pairs = truth.beside(&flight, log.session().pilot_started_at);
    if let Some(misnamed) = Misnamed::of(pairs, &truth.names) {
        return Err(NotScored::Misnamed { truth: truth.source, misnamed: misnamed.into() });
    }
    let mut score = Score::default();
    let mut poses = truth.poses.iter().peekable();
    let mut took = Took::default();
    let lost_inputs = live_again(&log, flown.pilot_on(recorded.pilot()), |until, pilot| {
        let estimator = pilot.estimator();
        while let Some(pose) = poses.next_if(|pose| pose.valid_at < until) {
            let estimate = estimator
                .is_aligned()
                .then(|| carried(estimator.estimate_at(pose.valid_at), pose.valid_at));
            score.add(pose.valid_at, pose, estimate.zip(estimator.cov_pos_E_m2()));
        }
        took = Took::of(estimator);
        pilot.drain_topics(|topic| {
            if let Topic::Uwb(record) = topic {
                score.innovation(&record);
            }
        });
    });
    let name = shown_name(&path.with_extension(""));
    let aided_by_imu = flown.estimator.motion == Motion::Inertial;
    let mut report = FlightReport::of(name, score, took, aided_by_imu);
    report.truth = Some(Beside {
        source: truth.source,
        poses: truth.poses.len() as u64,
        unused: truth.unused,
        clock: truth.clock,
        frames,
        lost_inputs,
    });
    Ok((report, flown))
}

/// Where what flew had the vehicle, by this build, and the motion capture that the companion heard.
fn as_flown(
    log: &LogReader,
    config: haltere_pilot::PilotConfig,
) -> (Vec<clock::Flown>, Vec<ReferencePose>) {
    let start = log.session().pilot_started_at;
    let (mut flight, mut captured) = (Vec::<clock::Flown>::new(), Vec::<ReferencePose>::new());
    live_again(log, config, |_, pilot| {
        pilot.drain_topics(|topic| match topic {
            Topic::Estimate(estimate) if estimate.health != Health::NotAligned => {
                let at_s = estimate.at.seconds_since(start);
                // An estimate of the same IMU sample comes again with the next step.
                if flight.last().is_none_or(|last| last.at_s < at_s) {
                    let speed_mps = estimate.vel_B_mps.raw().norm();
                    flight.push(clock::Flown { at_s, pos_E_m: estimate.pos_E_m.raw(), speed_mps });
                }
            }
            Topic::Reference(pose) => captured.push(pose),
            _ => {}
        });
    });
    captured.sort_by_key(|pose| pose.valid_at);
    (flight, captured)
}

/// The estimate at a time shortly after that of its newest IMU sample.
fn carried(mut estimate: Estimate, to: HostTime) -> Estimate {
    let late_s = to.seconds_since(estimate.at).clamp(-CARRIED_S, CARRIED_S);
    estimate.pos_E_m += estimate.vel_E_mps() * late_s;
    estimate
}

/// The truth of a log, on the companion's clock.
struct Truth {
    source: String,
    poses: Vec<ReferencePose>,
    unused: Unused,
    clock: Option<Clock>,
    names: PositionNames,
}

impl Truth {
    fn find(
        log: &Path,
        place: Option<&Path>,
        captured: Vec<ReferencePose>,
        flight: &[clock::Flown],
        start: HostTime,
    ) -> Result<Self, NotScored> {
        let Some(file) = candidates(log, place).into_iter().find(|path| path.exists()) else {
            if captured.is_empty() {
                let looked = candidates(log, place).into_iter().map(|p| p.display().to_string());
                let looked = looked.collect::<Vec<_>>().join(" or ");
                return Err(NotScored::Without { log: log.to_owned(), looked });
            }
            let source = format!("motion capture in {}", log.display());
            let (unused, names) = (Unused::default(), PositionNames::default());
            return Ok(Self { source, poses: captured, unused, clock: None, names });
        };
        let source = file.display().to_string();
        let track = truth::read(&file)?;
        if track.on_companion_clock {
            let host = |t_s: f64| HostTime::from_us((t_s * 1e6).round().max(0.0) as u64);
            let poses = track.poses.iter().map(|pose| clock::reference(pose, host(pose.t_s)));
            let poses = poses.filter(|pose| pose.valid_at >= start).collect();
            let (unused, names) = (track.unused, track.names);
            return Ok(Self { source, poses, unused, clock: None, names });
        }
        match clock::find(flight, &track.poses, &track.names) {
            Ok(found) => {
                let poses = track.poses.iter().filter_map(|pose| found.pose(pose, start)).collect();
                let (unused, names) = (track.unused, track.names);
                Ok(Self { source, poses, unused, clock: Some(found), names })
            }
            Err(why) => Err(NotScored::Clock { truth: source, why }),
        }
    }

    /// What flew beside it.
    fn beside<'a>(
        &'a self,
        flight: &'a [clock::Flown],
        start: HostTime,
    ) -> impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> + Clone + 'a {
        self.poses.iter().filter_map(move |pose| {
            let at_s = pose.valid_at.seconds_since(start);
            let after = flight.partition_point(|f| f.at_s < at_s);
            let (b, a) = (flight.get(after)?, flight.get(after.checked_sub(1)?)?);
            let apart_s = b.at_s - a.at_s;
            let part = (at_s - a.at_s) / apart_s;
            (apart_s <= clock::GAP_S)
                .then(|| (a.pos_E_m + (b.pos_E_m - a.pos_E_m) * part, pose.pos_E_m.raw()))
        })
    }

    /// How it lies to what flew.
    fn frames(&self, flight: &[clock::Flown], start: HostTime) -> Option<Frames> {
        let floor_z_m = self.poses.first()?.pos_E_m.z();
        let pairs = self.beside(flight, start).collect();
        let pairs = clock::aloft(pairs, |(_, pose)| Some(floor_z_m - pose.z));
        Frames::between(pairs.iter().copied())
    }
}

/// Where the truth of a log may lie.
fn candidates(log: &Path, place: Option<&Path>) -> Vec<PathBuf> {
    let beside = log.with_extension(ENDING);
    match place {
        None => vec![beside],
        Some(place) if place.is_dir() => {
            let name = |path: &Path| path.file_name().map(|name| place.join(name));
            [name(&beside), name(&log.with_extension("csv"))].into_iter().flatten().collect()
        }
        Some(file) => vec![file.to_owned()],
    }
}
