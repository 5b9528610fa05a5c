//! Reader of UTIL recordings: columns to events, in our frames and units.
//!
//! Every group of columns is a stream with its own clock column; a row is not one instant, and the
//! shorter streams end in empty cells. The streams are merged by time.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use flate2::read::GzDecoder;
use nalgebra::{Quaternion, UnitQuaternion};

use haltere_core::checks::Problems;
use haltere_core::estimator::standard_pressure_pa;
use haltere_core::frames::{
    B, G_MPS2, Vec3, attitude_from_flu_enu, body_from_flu, earth_from_survey,
};
use haltere_core::measure::{AnchorId, BaroSample, ReferencePose, Tdoa};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_log::import::bounded::Bounded;
use haltere_log::{intake, log_file};

/// Stamps of the recording begin at 0; ours begin here, so that nothing is before the beginning.
const FIRST_US: f64 = 1e6;
/// Later than this is no time in a recording, s.
const LONGEST_S: f64 = 1e5;

/// What can go wrong with a folder of recordings.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file could not be read.
    #[error("{path}: {source}")]
    Io {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file does not hold what its layout says.
    #[error("{path}: line {line}: {what}")]
    Format {
        /// Which.
        path: PathBuf,
        /// Where.
        line: usize,
        /// What was found and what was allowed.
        what: String,
    },
    /// The anchors cannot be flown on.
    #[error("{path}: {constellation}: {problems}")]
    Survey {
        /// Which file.
        path: PathBuf,
        /// Which layout in it.
        constellation: String,
        /// Why not.
        problems: Problems,
    },
    /// Nothing to run on.
    #[error(
        "{0}: no *.csv.gz with TDOA and pose here; expected UTIL, or its folder `full` or `tdoa_pos`"
    )]
    Empty(PathBuf),
}

/// One reading, in our frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sample {
    /// Specific force, m/s².
    Acc(Vec3<B>),
    /// Angular rate, rad/s.
    Gyro(Vec3<B>),
    /// Time difference of arrival.
    Tdoa(Tdoa),
    /// Air pressure.
    Baro(BaroSample),
    /// Motion capture.
    Pose(ReferencePose),
}

/// A reading and its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// When it was taken.
    pub at: HostTime,
    /// What.
    pub sample: Sample,
}

/// One recorded flight.
#[derive(Debug, Clone)]
pub struct Flight {
    /// Name of the file without its endings.
    pub name: String,
    /// Its anchors.
    pub survey: Survey,
    /// Its readings, in the order of time.
    pub events: Vec<Event>,
}

/// Tag on the published vehicle, body frame (forward, right, down), m. Its authors give (-0.01245, 0.00127,
/// 0.0908) m forward, left, up (README of the recordings, from the dataset's own description).
const PUBLISHED_TAG_B_M: [f64; 3] = [-0.01245, -0.00127, -0.0908];

impl Flight {
    /// Tag seen from the vehicle's centre, body frame, m, as its authors give it; nobody wrote it down for
    /// the vehicle of April.
    pub fn p_BT_B_m(&self) -> [f64; 3] {
        let published = self.name.starts_with("jun05") || self.name.starts_with("const");
        if published { PUBLISHED_TAG_B_M } else { [0.0; 3] }
    }

    /// Whether it holds an IMU.
    pub fn has_imu(&self) -> bool {
        self.events.iter().any(|event| matches!(event.sample, Sample::Gyro(_)))
    }

    /// Heading of the first pose, rad.
    pub fn first_yaw_rad(&self) -> Option<f64> {
        self.events.iter().find_map(|event| match &event.sample {
            Sample::Pose(pose) => pose.attitude.map(|R_EB| R_EB.yaw_rad()),
            _ => None,
        })
    }
}

/// Reads a flight, or every flight of a folder, that has TDOA and motion capture, be it of the
/// position alone (then `ReferencePose::attitude` is `None`), in the order of their names. `anchors.csv` lies in the folder or
/// in the one above.
pub fn load_located(path: &Path) -> Result<Vec<Flight>, Error> {
    if path.is_dir() {
        return load_folder(path);
    }
    let anchors = anchors_near(path.parent().unwrap_or(Path::new(".")));
    let flight = load_flight(path, &anchors)?;
    flight.map(|f| vec![f]).ok_or_else(|| Error::Empty(path.into()))
}

fn anchors_near(dir: &Path) -> PathBuf {
    let beside = dir.join("anchors.csv");
    if beside.exists() { beside } else { dir.join("..").join("anchors.csv") }
}

fn load_folder(dir: &Path) -> Result<Vec<Flight>, Error> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(dir)
        .and_then(|entries| entries.map(|e| e.map(|e| e.path())).collect())
        .map_err(|source| Error::Io { path: dir.into(), source })?;
    paths.retain(|p| p.to_string_lossy().ends_with(".csv.gz"));
    paths.sort();
    let anchors = anchors_near(dir);
    let mut flights = Vec::new();
    for path in paths {
        flights.extend(load_flight(&path, &anchors)?);
    }
    if flights.is_empty() {
        return Err(Error::Empty(dir.into()));
    }
    Ok(flights)
}

/// Layout that a flight was flown in, from its name.
fn constellation(name: &str) -> &str {
    match name.split('-').next().unwrap_or(name) {
        // Surveyed two days after the flight; the anchors had not been moved.
        "jun05" => "jun07",
        first => first,
    }
}

/// A flight; `None` when the recording does not hold what is needed.
fn load_flight(path: &Path, anchors: &Path) -> Result<Option<Flight>, Error> {
    let io = |source| Error::Io { path: path.into(), source };
    let packed = intake::open(path).map_err(io)?;
    let mut lines = BufReader::new(Bounded::new(GzDecoder::new(packed))).lines();
    let header = lines.next().transpose().map_err(io)?.unwrap_or_default();
    let columns: Vec<&str> = header.trim().split(',').collect();
    let streams: Vec<(Stream, usize)> = Stream::ALL
        .into_iter()
        .filter(|s| match s {
            Stream::Pose => columns.contains(&"pose_qx"),
            Stream::Position => !columns.contains(&"pose_qx"),
            _ => true,
        })
        .filter_map(|s| columns.iter().position(|c| *c == s.clock()).map(|at| (s, at)))
        .collect();
    let has = |wanted| streams.iter().any(|(s, _)| *s == wanted);
    if !(has(Stream::Tdoa) && (has(Stream::Pose) || has(Stream::Position))) {
        return Ok(None);
    }
    let file = log_file::shown_name(path);
    let name = file.trim_end_matches(".csv.gz").to_owned();
    let survey = load_survey(anchors, constellation(&name))?;
    let mut events = Vec::new();
    let mut values = Vec::new();
    for (index, line) in lines.enumerate() {
        let line = line.map_err(io)?;
        let wrong = |what: String| Error::Format { path: path.into(), line: index + 2, what };
        values.clear();
        for cell in line.trim_end().split(',') {
            values.push(match cell {
                "" => None,
                text => match text.parse::<f64>() {
                    Ok(value) if value.is_finite() => Some(value),
                    _ => return Err(wrong(format!("{text:?}, a finite number expected"))),
                },
            });
        }
        for (stream, at) in &streams {
            let cells = values.get(*at..*at + stream.width()).unwrap_or_default();
            let Some(cells) = cells.iter().copied().collect::<Option<Vec<f64>>>() else { continue };
            let Some((&t_s, rest)) = cells.split_first() else { continue };
            if !(0.0..LONGEST_S).contains(&t_s) {
                return Err(wrong(format!(
                    "{} = {t_s}, allowed 0 to {LONGEST_S} s",
                    stream.clock()
                )));
            }
            let at = HostTime::from_us((t_s * 1e6 + FIRST_US).round() as u64);
            let sample = stream.sample(at, rest).ok_or_else(|| {
                wrong(format!("{}: {rest:?} is no reading of this stream", stream.clock()))
            })?;
            events.push(Event { at, sample });
        }
    }
    // Stable: readings of the same microsecond stay in the order of the columns.
    events.sort_by_key(|event| event.at);
    Ok(Some(Flight { name, survey, events }))
}

fn load_survey(path: &Path, constellation: &str) -> Result<Survey, Error> {
    let text =
        std::fs::read_to_string(path).map_err(|source| Error::Io { path: path.into(), source })?;
    let mut anchors = Vec::new();
    for (index, line) in text.lines().enumerate().skip(1) {
        let cells: Vec<&str> = line.trim().split(',').collect();
        if cells.first() != Some(&constellation) {
            continue;
        }
        let parsed = match cells[..] {
            [_, id, x, y, z] => {
                id.parse().ok().zip(x.parse().ok()).zip(y.parse().ok().zip(z.parse().ok()))
            }
            _ => None,
        };
        let Some(((id, x), (y, z))) = parsed else {
            return Err(Error::Format {
                path: path.into(),
                line: index + 1,
                what: format!("{line:?}, expected constellation,id,x_m,y_m,z_m"),
            });
        };
        anchors.push((AnchorId(id), earth_from_survey(Vec3::new(x, y, z))));
    }
    Survey::new(&anchors).map_err(|problems| Error::Survey {
        path: path.into(),
        constellation: constellation.into(),
        problems,
    })
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stream {
    Tdoa,
    Acc,
    Gyro,
    Baro,
    Pose,
    /// Motion capture without attitude.
    Position,
}

impl Stream {
    const ALL: [Self; 6] =
        [Self::Tdoa, Self::Acc, Self::Gyro, Self::Baro, Self::Pose, Self::Position];

    fn clock(self) -> &'static str {
        match self {
            Self::Tdoa => "t_tdoa",
            Self::Acc => "t_acc",
            Self::Gyro => "t_gyro",
            Self::Baro => "t_baro",
            Self::Pose | Self::Position => "t_pose",
        }
    }

    /// Columns of the stream, its clock included.
    fn width(self) -> usize {
        match self {
            Self::Tdoa | Self::Acc | Self::Gyro | Self::Position => 4,
            Self::Baro => 2,
            Self::Pose => 8,
        }
    }

    fn sample(self, at: HostTime, cells: &[f64]) -> Option<Sample> {
        Some(match (self, cells) {
            (Self::Tdoa, &[a, b, distance_diff_m]) => Sample::Tdoa(Tdoa {
                valid_at: at,
                received_at: at,
                anchor_a: anchor(a)?,
                anchor_b: anchor(b)?,
                distance_diff_m,
                std_m: None,
            }),
            // In g. The authors' 9.81 m/s² is a rounding of the standard value.
            (Self::Acc, &[x, y, z]) => {
                Sample::Acc(body_from_flu(x * G_MPS2, y * G_MPS2, z * G_MPS2))
            }
            (Self::Gyro, &[x, y, z]) => {
                Sample::Gyro(body_from_flu(x.to_radians(), y.to_radians(), z.to_radians()))
            }
            (Self::Baro, &[height_m]) => Sample::Baro(BaroSample {
                valid_at: at,
                received_at: at,
                pressure_pa: standard_pressure_pa(height_m),
            }),
            (Self::Pose, &[x, y, z, qx, qy, qz, qw]) => {
                let q = UnitQuaternion::try_new(Quaternion::new(qw, qx, qy, qz), 0.5)?;
                Sample::Pose(ReferencePose {
                    valid_at: at,
                    received_at: at,
                    pos_E_m: earth_from_survey(Vec3::new(x, y, z)),
                    attitude: Some(attitude_from_flu_enu(q)),
                })
            }
            (Self::Position, &[x, y, z]) => Sample::Pose(ReferencePose {
                valid_at: at,
                received_at: at,
                pos_E_m: earth_from_survey(Vec3::new(x, y, z)),
                attitude: None,
            }),
            _ => return None,
        })
    }
}

fn anchor(id: f64) -> Option<AnchorId> {
    ((0.0..=255.0).contains(&id) && id.fract() == 0.0).then_some(AnchorId(id as u8))
}
