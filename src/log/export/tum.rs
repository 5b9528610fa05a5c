//! Tracks in the text form of the TUM benchmark, which `evo` and others read: one pose a line,
//! `time x y z qx qy qz qw`, in seconds and metres, with blanks between.
//!
//! As everywhere outside, z is up: x is room east, y room north, and the body is forward-left-up. Times are the
//! companion's own clock, as in every table. A pose without an attitude has that of the room.

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use haltere_core::frames::{B, E, Rot, Vec3, attitude_from_flu_enu, survey_from_earth};
use haltere_core::time::HostTime;

use super::{ExportError, Exported, create};
use crate::import::truth;
use crate::record::back::vec3;
use crate::record::{Decoded, Entry, LogEnd, LogReader, pb};
use crate::written::Output;

/// Numbers of a line.
const COLUMNS: usize = 8;

/// Writes the estimate of a log, the reference of motion capture where the log has one, and a truth file where one is
/// named, into `directory`: estimate.tum, reference.tum, truth.tum. Every file is written, or none.
pub fn write_tum(
    log: &LogReader,
    directory: &Path,
    truth: Option<&Path>,
    overwrite: bool,
) -> Result<(Vec<Exported<PathBuf>>, LogEnd), ExportError> {
    let begin = |topic| Track::begin(log, directory, topic, overwrite);
    let [mut estimate, mut reference] = [None, None];
    let mut entries = log.entries();
    for entry in entries.by_ref() {
        let Entry::Decoded(decoded) = entry else { continue };
        match decoded {
            Decoded::Estimate(m) if m.health() != pb::estimate::Health::NotAligned => {
                let track = open(&mut estimate, || begin("estimate"))?;
                track.put(HostTime::from_us(m.at_us), vec3(m.pos_e_m), attitude(m.q_eb))?;
            }
            Decoded::Reference(m) => {
                let track = open(&mut reference, || begin("reference"))?;
                track.put(HostTime::from_us(m.valid_at_us), vec3(m.pos_e_m), attitude(m.q_eb))?;
            }
            _ => {}
        }
    }
    let end = entries.end();
    let estimate = estimate.ok_or(ExportError::NoTopics { path: log.path().to_owned() })?;
    let truth = truth.map(|path| true_track(path, begin("truth")?)).transpose()?;
    let tracks = [Some(estimate), reference, truth].into_iter().flatten();
    Ok((tracks.map(Track::finish).collect::<Result<_, _>>()?, end))
}

/// A track in the making.
struct Track {
    topic: &'static str,
    path: PathBuf,
    out: BufWriter<Output>,
    rows: usize,
}

impl Track {
    fn begin(
        log: &LogReader,
        directory: &Path,
        topic: &'static str,
        overwrite: bool,
    ) -> Result<Self, ExportError> {
        let path = directory.join(format!("{topic}.tum"));
        let out = BufWriter::new(create(log, &path, overwrite)?);
        Ok(Self { topic, path, out, rows: 0 })
    }

    fn put(
        &mut self,
        at: HostTime,
        pos_E_m: Vec3<E>,
        attitude: Option<Rot<E, B>>,
    ) -> Result<(), ExportError> {
        // What motion capture or a filter did not know is no pose.
        if !pos_E_m.is_finite() {
            return Ok(());
        }
        self.rows += 1;
        let line = line(at, pos_E_m, attitude);
        self.out.write_all(line.as_bytes()).map_err(|source| self.failed(source))
    }

    fn failed(&self, source: io::Error) -> ExportError {
        ExportError::Write { path: self.path.clone(), source }
    }

    fn finish(self) -> Result<Exported<PathBuf>, ExportError> {
        let Self { topic, path, out, rows } = self;
        let failed = |source| ExportError::Write { path: path.clone(), source };
        out.into_inner().map_err(|e| failed(e.into_error()))?.finish()?;
        Ok(Exported { topic: topic.to_owned(), rows, columns: COLUMNS, to: path })
    }
}

fn open(
    track: &mut Option<Track>,
    begin: impl FnOnce() -> Result<Track, ExportError>,
) -> Result<&mut Track, ExportError> {
    match track {
        Some(track) => Ok(track),
        none => Ok(none.insert(begin()?)),
    }
}

fn true_track(path: &Path, mut track: Track) -> Result<Track, ExportError> {
    let found = truth::read(path)?;
    if !found.on_companion_clock {
        return Err(ExportError::OtherClock { path: path.to_owned() });
    }
    for pose in found.poses {
        track.put(
            HostTime::from_us((pose.t_s * 1e6).round() as u64),
            pose.pos_E_m,
            pose.attitude,
        )?;
    }
    Ok(track)
}

fn attitude(q: Option<pb::Quaternion>) -> Option<Rot<E, B>> {
    q.and_then(|q| Rot::from_wxyz([q.w, q.x, q.y, q.z]))
}

fn line(at: HostTime, pos_E_m: Vec3<E>, attitude: Option<Rot<E, B>>) -> String {
    let [x, y, z] = survey_from_earth(pos_E_m).to_array();
    // The two half turns between our frames and those with z up undo themselves: the way there is the way back.
    let turned = attitude.map(|a| attitude_from_flu_enu(a.raw()).to_wxyz());
    let [qw, qx, qy, qz] = turned.unwrap_or([1.0, 0.0, 0.0, 0.0]);
    let (s, us) = (at.as_us() / 1_000_000, at.as_us() % 1_000_000);
    format!("{s}.{us:06} {x:.6} {y:.6} {z:.6} {qx:.9} {qy:.9} {qz:.9} {qw:.9}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The form is `timestamp tx ty tz qx qy qz qw` (the benchmark's page on file formats, and `evo`'s reader of it).
    /// A vehicle with its nose to the north, level, has it along y of a frame with x east: a quarter turn about z up.
    #[test]
    fn val_a_line_is_time_place_and_a_quaternion_with_w_last() {
        let level = Rot::from_euler_rad(0.0, 0.0, 0.0);
        let line = line(HostTime::from_us(12_000_034), Vec3::new(1.0, 2.0, -3.0), Some(level));
        let numbers: Vec<f64> = line.split_whitespace().map(|n| n.parse().unwrap()).collect();
        let quarter = std::f64::consts::FRAC_1_SQRT_2;
        let due = [12.000_034, 2.0, 1.0, 3.0, 0.0, 0.0, quarter, quarter];
        assert_eq!(numbers.len(), COLUMNS);
        for (n, due) in numbers.iter().zip(due) {
            assert!((n - due).abs() < 1e-8, "{line}");
        }
    }

    /// What the reader of truth takes for a frame with z up gives the pose that was written.
    #[test]
    fn prop_a_track_is_read_back_as_it_was() {
        let pos = Vec3::new(1.5, -2.25, -0.75);
        let attitude = Rot::from_euler_rad(0.2, -0.3, 2.0);
        let text = format!(
            "timestamp tx ty tz qx qy qz qw\n{}{}",
            line(HostTime::from_us(1_000_000), pos, Some(attitude)),
            line(HostTime::from_us(1_010_000), pos, Some(attitude)),
        );
        let track = truth::parse(text.as_bytes(), Path::new("a.tum")).unwrap();
        assert_eq!(track.poses.len(), 2);
        for pose in &track.poses {
            let [back, was] = [pose.pos_E_m.to_array(), pos.to_array()];
            assert!(back.iter().zip(was).all(|(a, b)| (a - b).abs() < 1e-5), "{back:?}");
            let [back, was] = [pose.attitude.unwrap().to_wxyz(), attitude.to_wxyz()];
            assert!(back.iter().zip(was).all(|(a, b)| (a - b).abs() < 1e-8), "{back:?} {was:?}");
        }
    }
}
