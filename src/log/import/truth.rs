//! Reader of truth: the track of a vehicle by motion capture or by a simulator, as a table of text.
//!
//! One line names the columns, one row follows for each instant; what stands above that line is read over. Values are
//! separated by commas, semicolons, tabs or blanks. Case, a leading `#`, and how a unit is bracketed do not matter:
//! `x_mm`, `X (mm)` and `x [mm]` are the same. Columns that are not named here are read over.
//!
//! ```text
//! t | time | timestamp, in s (also _ms _us _ns)     a clock of its own, with any beginning
//! x | tx | pos_x, y …, z …, in m (also _cm _mm)     in the frame of the anchors, z up
//! qw, qx, qy, qz (or q_w …), all four or none        body forward-left-up in that frame
//! ```
//!
//! A position may be named with a minus, `-y` or `-z_mm`: the column holds it with the other sign. A frame with y up, of the
//! other hand or with axes exchanged is read so, without another word; its attitude is none, then.
//!
//! The truth of the simulator (`haltere-sim serve --truth`) names `host_time_us`, the companion's own clock,
//! `pos_E_x_m` … and `q_EB_w` …, which are our frames.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use serde::Serialize;

use super::bounded::Bounded;
use crate::intake;
use haltere_core::frames::{B, E, Rot, Vec3, attitude_from_flu_enu, earth_from_survey};

/// Lines above the columns that are read over: heads of motion capture have up to a dozen.
const MOST_HEAD: usize = 40;
/// Most rows: three hours at 300 Hz.
const MOST_ROWS: usize = 3_240_000;
/// A coordinate beyond this is none, m: that of a room in millimetres still is one, so that it can be named.
const FARTHEST_M: f64 = 1e6;
/// Rows farther apart than this at the median show no speed, s.
const SLOWEST_S: f64 = 0.2;
/// Norm of a quaternion that is one, before it is made a unit.
const NORM: std::ops::RangeInclusive<f64> = 0.5..=2.0;

/// Where the vehicle was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruePose {
    /// When, on the clock of the file, s.
    pub t_s: f64,
    /// Position, Earth frame, m.
    pub pos_E_m: Vec3<E>,
    /// Attitude, where it is told.
    pub attitude: Option<Rot<E, B>>,
}

/// Rows that hold no pose, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Unused {
    /// Motion capture had lost the vehicle: a cell of time or position is empty or no finite number.
    pub lost: u64,
    /// A cell of time or position is no number, or no coordinate of a room.
    pub unreadable: u64,
    /// Not later than the row before.
    pub out_of_order: u64,
}

/// A track.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Its poses, later ones last.
    pub poses: Vec<TruePose>,
    /// Rows that hold none.
    pub unused: Unused,
    /// Whether its clock is the companion's.
    pub on_companion_clock: bool,
    /// How its positions are named.
    pub names: PositionNames,
}

/// How the columns of a position are named.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionNames {
    /// What stands before the axis.
    lead: String,
    /// What stands behind it, with the unit.
    unit: String,
    axes: Axes,
    /// Signs with which x, y and z are held.
    signs: [f64; 3],
}

impl Default for PositionNames {
    fn default() -> Self {
        Self { lead: String::new(), unit: String::new(), axes: Axes::Survey, signs: [1.0; 3] }
    }
}

impl PositionNames {
    /// What the columns of x, y and z are to be named where `turn_EE` leads from what was read to what is so, both in the Earth
    /// frame; a unit in place of theirs, where one is told.
    pub fn renamed(&self, turn_EE: &Matrix3<f64>, unit: Option<&str>) -> [String; 3] {
        let of_ours =
            Matrix3::from_columns(&[Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| {
                match self.axes {
                    Axes::Ours => axis,
                    Axes::Survey => earth_from_survey(Vec3::from_raw(axis)).raw(),
                }
            }));
        // Axis of the file's frame as read, in those as they are; the turn of a frame onto itself is undone by its transpose.
        let turn = of_ours.transpose() * turn_EE * of_ours;
        let unit = unit.map_or_else(|| self.unit.clone(), |unit| format!("_{unit}"));
        std::array::from_fn(|read| {
            let is = turn.column(read).iamax();
            let held = turn[(is, read)] * self.signs[read];
            let minus = if held < 0.0 { "-" } else { "" };
            format!("{minus}{}{}{unit}", self.lead, ["x", "y", "z"][is])
        })
    }
}

/// Why there is no track.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// The file could not be read.
    #[error("{path}: {source}")]
    Io {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// No line names the columns.
    #[error(
        "{path}: none of the first {MOST_HEAD} lines names time and position; a line such as \
         `t_s,x_m,y_m,z_m` or `t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz` must stand above the rows (docs/IMPORT.md)"
    )]
    NoColumns {
        /// Which file.
        path: PathBuf,
    },
    /// A column stands there twice.
    #[error(
        "{path}: line {line} names `{column}` twice; keep one, named `{column}`, and name the other otherwise"
    )]
    Twice {
        /// Which file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// Which.
        column: String,
    },
    /// No row could be used.
    #[error("{path}: no pose in {rows} rows: {unused}")]
    NoPose {
        /// Which file.
        path: PathBuf,
        /// Rows below the columns.
        rows: usize,
        /// Why.
        unused: Unused,
    },
    /// Times that show no speed.
    #[error(
        "{path}: rows are {apart_s} s apart at the median, at most {SLOWEST_S} s shows a speed; if `{column}` is in ms, \
         µs or ns, name it `t_ms`, `t_us` or `t_ns`"
    )]
    TooSlow {
        /// Which file.
        path: PathBuf,
        /// Median.
        apart_s: f64,
        /// Name of the time.
        column: String,
    },
    /// More rows than are held.
    #[error(
        "{path}: more than {MOST_ROWS} rows; cut the file to the flight, or keep every tenth row"
    )]
    TooLong {
        /// Which file.
        path: PathBuf,
    },
}

impl std::fmt::Display for Unused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { lost, unreadable, out_of_order } = self;
        write!(f, "{lost} without a position, {unreadable} unreadable, {out_of_order} out of order")
    }
}

impl Unused {
    /// All of them.
    pub fn count(&self) -> u64 {
        self.lost + self.unreadable + self.out_of_order
    }
}

/// The 48 ways to name the axes of a frame after those of another.
pub fn turns() -> impl Iterator<Item = Matrix3<f64>> {
    const ORDERS: [[usize; 3]; 6] =
        [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    ORDERS.into_iter().flat_map(|order| {
        (0..8).map(move |signs| {
            let mut turn = Matrix3::zeros();
            for (row, column) in order.into_iter().enumerate() {
                turn[(row, column)] = if signs >> row & 1 == 0 { 1.0 } else { -1.0 };
            }
            turn
        })
    })
}

/// Reads a track.
pub fn read(path: &Path) -> Result<Track, TruthError> {
    let file = intake::open(path).map_err(|source| TruthError::Io { path: path.into(), source })?;
    parse(BufReader::new(Bounded::new(file)), path)
}

/// Reads the text of a track; `path` is for errors.
pub fn parse(reader: impl BufRead, path: &Path) -> Result<Track, TruthError> {
    let io = |source| TruthError::Io { path: path.into(), source };
    let mut lines = reader.lines();
    let mut columns = None;
    for (index, line) in lines.by_ref().take(MOST_HEAD).enumerate() {
        columns = Columns::named(&line.map_err(io)?).map_err(|column| TruthError::Twice {
            path: path.into(),
            line: index + 1,
            column,
        })?;
        if columns.is_some() {
            break;
        }
    }
    let columns = columns.ok_or_else(|| TruthError::NoColumns { path: path.into() })?;
    let mut poses: Vec<TruePose> = Vec::new();
    let mut unused = Unused::default();
    let mut rows = 0;
    for line in lines {
        let line = line.map_err(io)?;
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        rows += 1;
        match columns.pose(&line) {
            Ok(pose) if poses.last().is_some_and(|last| pose.t_s <= last.t_s) => {
                unused.out_of_order += 1;
            }
            Ok(_) if poses.len() == MOST_ROWS => {
                return Err(TruthError::TooLong { path: path.into() });
            }
            Ok(pose) => poses.push(pose),
            Err(NoPose::Lost) => unused.lost += 1,
            Err(NoPose::Unreadable) => unused.unreadable += 1,
        }
    }
    if poses.is_empty() {
        return Err(TruthError::NoPose { path: path.into(), rows, unused });
    }
    let mut apart: Vec<f64> = poses.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
    let middle = apart.len() / 2;
    if !apart.is_empty() {
        let (_, apart_s, _) = apart.select_nth_unstable_by(middle, f64::total_cmp);
        if *apart_s > SLOWEST_S {
            let (apart_s, column) = (*apart_s, columns.time.clone());
            return Err(TruthError::TooSlow { path: path.into(), apart_s, column });
        }
    }
    let on_companion_clock = columns.time == COMPANION_TIME;
    Ok(Track { poses, unused, on_companion_clock, names: columns.names })
}

/// Name of the companion's clock.
const COMPANION_TIME: &str = "host_time_us";
/// Names of a time on a clock of its own.
const TIMES: [&str; 3] = ["t", "time", "timestamp"];
/// Units of a time, in s.
const TIME_UNITS: [(&str, f64); 7] = [
    ("", 1.0),
    ("_s", 1.0),
    ("_seconds", 1.0),
    ("_ms", 1e-3),
    ("_us", 1e-6),
    ("_µs", 1e-6),
    ("_ns", 1e-9),
];
/// What stands before the axis of a position in the frame of the anchors.
const POSITIONS: [&str; 3] = ["", "t", "pos_"];
/// Units of a length, in m.
const LENGTH_UNITS: [(&str, f64); 4] = [("", 1.0), ("_m", 1.0), ("_cm", 1e-2), ("_mm", 1e-3)];

/// Whether axes are ours or those of a survey.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Axes {
    /// North, east, down; forward, right, down.
    Ours,
    /// x, y and up; forward, left, up.
    Survey,
}

/// Where in a row the values stand.
#[derive(Debug)]
struct Columns {
    separator: Option<char>,
    time: String,
    time_at: (usize, f64),
    position_at: [usize; 3],
    length_m: f64,
    names: PositionNames,
    attitude_at: Option<([usize; 4], Axes)>,
}

enum NoPose {
    Lost,
    Unreadable,
}

impl Columns {
    /// `None`: the line names none. An error: one that stands there twice.
    fn named(line: &str) -> Result<Option<Self>, String> {
        let line = line.trim_start_matches('\u{feff}').trim();
        let separator = [',', ';', '\t'].into_iter().find(|c| line.contains(*c));
        let names: Vec<String> =
            cells(line.trim_start_matches(['#', '%']), separator).map(plain).collect();
        let at = |name: &str| names.iter().position(|n| n == name);
        let held = |name: &str| {
            let minus = || Some((at(&format!("-{name}"))?, -1.0));
            at(name).map(|at| (at, 1.0)).or_else(minus)
        };
        let companion = at(COMPANION_TIME).map(|at| (COMPANION_TIME.to_owned(), (at, 1e-6)));
        let own = || {
            TIMES
                .iter()
                .flat_map(|stem| TIME_UNITS.map(|(unit, s)| (format!("{stem}{unit}"), s)))
                .find_map(|(name, s)| Some((name.clone(), (at(&name)?, s))))
        };
        let all = |lead: &str, unit: &str, axes: Axes| {
            let [x, y, z] = ["x", "y", "z"].map(|axis| held(&format!("{lead}{axis}{unit}")));
            let all = [x?, y?, z?];
            let (lead, unit) = (lead.to_owned(), unit.to_owned());
            let names = PositionNames { lead, unit, axes, signs: all.map(|(_, sign)| sign) };
            Some((all.map(|(at, _)| at), names))
        };
        let ours = || Some((all("pos_e_", "_m", Axes::Ours)?, 1.0));
        let survey = || {
            let spelt =
                POSITIONS.iter().flat_map(|lead| LENGTH_UNITS.map(|(unit, m)| (lead, unit, m)));
            spelt.into_iter().find_map(|(lead, unit, m)| Some((all(lead, unit, Axes::Survey)?, m)))
        };
        let (Some((time, time_at)), Some(((position_at, position_names), length_m))) =
            (companion.or_else(own), ours().or_else(survey))
        else {
            return Ok(None);
        };
        let four = |lead: &str| -> Option<[usize; 4]> {
            let [w, x, y, z] = ["w", "x", "y", "z"].map(|part| at(&format!("{lead}{part}")));
            Some([w?, x?, y?, z?])
        };
        let attitude_at = four("q_eb_")
            .map(|four| (four, Axes::Ours))
            .or_else(|| Some((four("q").or_else(|| four("q_"))?, Axes::Survey)));
        let read = [time_at.0].into_iter().chain(position_at);
        for name in read.chain(attitude_at.iter().flat_map(|(four, _)| *four)).map(|at| &names[at])
        {
            let name = name.trim_start_matches('-');
            if names.iter().filter(|n| n.trim_start_matches('-') == name).count() > 1 {
                return Err(name.to_owned());
            }
        }
        Ok(Some(Self {
            separator,
            time,
            time_at,
            position_at,
            length_m,
            names: position_names,
            attitude_at,
        }))
    }

    fn pose(&self, line: &str) -> Result<TruePose, NoPose> {
        let row: Vec<&str> = cells(line.trim_end(), self.separator).collect();
        let number = |at: usize| match row.get(at).map(|cell| cell.trim_matches('"')) {
            None | Some("") => Err(NoPose::Lost),
            Some(text) => match text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                Ok(_) => Err(NoPose::Lost),
                Err(_) => Err(NoPose::Unreadable),
            },
        };
        let (at, unit_s) = self.time_at;
        let t_s = number(at)? * unit_s;
        let [x, y, z] = self.position_at;
        let [sx, sy, sz] = self.names.signs.map(|sign| sign * self.length_m);
        let p = [number(x)? * sx, number(y)? * sy, number(z)? * sz];
        if p.iter().any(|value| value.abs() > FARTHEST_M) {
            return Err(NoPose::Unreadable);
        }
        let pos_E_m = match self.names.axes {
            Axes::Ours => Vec3::from_array(p),
            Axes::Survey => earth_from_survey(Vec3::from_array(p)),
        };
        // A pose without a readable attitude is a position all the same.
        let mirrors = self.names.signs.iter().any(|sign| *sign < 0.0);
        let attitude = self.attitude_at.filter(|_| !mirrors).and_then(|(four, axes)| {
            let [w, x, y, z] = four.map(|at| number(at).ok());
            let q = Quaternion::new(w?, x?, y?, z?);
            NORM.contains(&q.norm()).then_some(())?;
            match axes {
                Axes::Ours => Rot::from_wxyz([q.w, q.i, q.j, q.k]),
                Axes::Survey => Some(attitude_from_flu_enu(UnitQuaternion::from_quaternion(q))),
            }
        });
        Ok(TruePose { t_s, pos_E_m, attitude })
    }
}

/// Cells of a line; without a separator they are parted by blanks.
fn cells(line: &str, separator: Option<char>) -> impl Iterator<Item = &str> {
    let by_blanks = separator.is_none().then(|| line.split_whitespace());
    let parted = separator.map(|c| line.split(c).map(str::trim));
    by_blanks.into_iter().flatten().chain(parted.into_iter().flatten())
}

/// A name of a column without quotes, brackets and capitals: `Time (Seconds)` is `time_seconds`.
fn plain(name: &str) -> String {
    let lower = name.trim_matches('"').to_lowercase();
    let words = lower.split(|c: char| c.is_whitespace() || "()[]_".contains(c));
    words.filter(|word| !word.is_empty()).collect::<Vec<_>>().join("_")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Track, TruthError> {
        parse(text.as_bytes(), Path::new("a/b.csv"))
    }

    fn refused(text: &str) -> String {
        parsed(text).unwrap_err().to_string()
    }

    #[test]
    fn prop_the_same_track_in_every_spelling_is_the_same() {
        let spelt = [
            "t_s,x_m,y_m,z_m\n0.5,1,2,3\n0.6,1.5,2,3\n",
            "\u{feff}\"Time [s]\";\"X [mm]\";\"Y [mm]\";\"Z [mm]\"\n0.5;1000;2000;3000\n0.6;1500;2000;3000\n",
            "# timestamp tx ty tz\n0.5 1 2 3\n0.6 1.5 2 3\n",
            "CAMERAS\t8\nNO_OF_FRAMES\t2\nFrame\tTime\tX\tY\tZ\n1\t0.5\t1\t2\t3\n2\t0.6\t1.5\t2\t3\n",
            "time_ms, pos_x_cm, pos_y_cm, pos_z_cm, residual\n500,100,200,300,1\n600,150,200,300,1\n",
            "t_ns,pos_E_x_m,pos_E_y_m,pos_E_z_m\n5e8,2,1,-3\n6e8,2,1.5,-3\n",
        ];
        for text in spelt {
            let track = parsed(text).unwrap();
            assert!(!track.on_companion_clock && track.unused.count() == 0, "{text}");
            let [a, b] = track.poses[..] else { panic!("{text}: {track:?}") };
            for (pose, t_s, want) in [(a, 0.5, [2.0, 1.0, -3.0]), (b, 0.6, [2.0, 1.5, -3.0])] {
                assert!((pose.t_s - t_s).abs() < 1e-9, "{text}: {pose:?}");
                let off = pose.pos_E_m.raw() - Vec3::<E>::from_array(want).raw();
                assert!(off.norm() < 1e-9 && pose.attitude.is_none(), "{text}: {pose:?}");
            }
        }
    }

    /// A vehicle that looks along the survey's x looks east, and one that stands level is level.
    #[test]
    fn prop_attitudes_are_turned_into_our_frames() {
        let head = "t_s,x_m,y_m,z_m,qw,qx,qy,qz\n";
        let track = parsed(&format!("{head}0,1,2,3,2,0,0,0\n0.1,1,2,3,0,0,0,0\n")).unwrap();
        let [roll, pitch, yaw] = track.poses[0].attitude.unwrap().euler_rad();
        assert!(roll.abs() < 1e-12 && pitch.abs() < 1e-12);
        assert!((yaw - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!(track.poses[1].attitude, None);
        let ours = "host_time_us,pos_E_x_m,pos_E_y_m,pos_E_z_m,q_EB_w,q_EB_x,q_EB_y,q_EB_z\n";
        let track = parsed(&format!("{ours}7000123,1,2,-3,1,0,0,0\n")).unwrap();
        assert!(track.on_companion_clock);
        assert_eq!((track.poses[0].t_s * 1e6).round(), 7_000_123.0);
        assert!(track.poses[0].attitude.unwrap().yaw_rad().abs() < 1e-12);
    }

    /// A frame that is not that of the anchors is read by the names that are told for it, whichever of the 48 it is.
    #[test]
    fn prop_a_frame_is_read_by_the_names_that_are_told_for_it() {
        let place = [1.0, 2.0, 3.0];
        for (head, unit, factor) in [
            ("x,y,z", None, 1.0),
            ("x,y,z", Some("mm"), 1e3),
            ("pos_E_x_m,pos_E_y_m,pos_E_z_m", None, 1.0),
        ] {
            let row = |head: &str, [a, b, c]: [f64; 3]| {
                parsed(&format!("t,{head},qw,qx,qy,qz\n0,{a},{b},{c},1,0,0,0\n")).unwrap()
            };
            let right = row(head, place);
            let is = right.poses[0].pos_E_m.raw();
            for turn in turns() {
                let names = right.names.renamed(&turn, unit);
                let held = names.each_ref().map(|name| {
                    let axis = name.trim_start_matches('-').trim_start_matches("pos_e_");
                    let axis = "xyz".find(&axis[..1]).unwrap();
                    factor * if name.starts_with('-') { -place[axis] } else { place[axis] }
                });
                let misread = row(head, held);
                let off = turn * misread.poses[0].pos_E_m.raw() / factor - is;
                assert!(off.norm() < 1e-9, "{names:?}: {off}");
                let read = row(&misread.names.renamed(&turn, unit).join(","), held);
                let off = read.poses[0].pos_E_m.raw() - is;
                assert!(off.norm() < 1e-9, "{names:?}: {off}");
                let minus = names.iter().any(|name| name.starts_with('-'));
                assert_eq!(read.poses[0].attitude.is_none(), minus, "{names:?}");
            }
        }
    }

    #[test]
    fn prop_rows_that_hold_no_pose_are_counted_by_reason() {
        let track = parsed(
            "t_s,x_m,y_m,z_m\n0.0,1,1,1\n0.1,,,\n0.2,NaN,1,1\n0.3,1\n0.4,here,1,1\n0.5,1e300,1,1\n\
             0.0,1,1,1\n-1,1,1,1\n\n# a remark\n0.15,1,1,1\n0.15,1,1,1\n",
        )
        .unwrap();
        assert_eq!(track.poses.len(), 2);
        assert_eq!(track.unused, Unused { lost: 3, unreadable: 2, out_of_order: 3 });
    }

    #[test]
    fn prop_refusals_say_what_and_the_way_out() {
        for (text, says) in [
            ("", "names time and position"),
            ("t_s,x_m,y_m\n0,1,2\n", "`t_s,x_m,y_m,z_m`"),
            ("t_s,x_m,y_m,z_m\n", "no pose in 0 rows"),
            ("t_s,x_m,y_m,z_m\n0,,,\n", "no pose in 1 rows: 1 without a position"),
            ("t_s,x_m,y_m,z_m\n0,\"a\",b,c\n", "1 unreadable"),
            ("Frame,Time,X,Y,Z,W,X,Y,Z\n1,0,0,0,0,1,1,1,1\n", "line 1 names `x` twice"),
            ("t,x,y,z,-y\n0,1,2,3,4\n", "line 1 names `y` twice"),
            ("t,x,y,z\n0,1,1,1\n10,1,1,1\n20,1,1,1\n", "rows are 10 s apart"),
        ] {
            let error = refused(text);
            assert!(error.starts_with("a/b.csv: ") && error.contains(says), "{text}: {error}");
        }
    }

    #[test]
    fn prop_no_text_panics() {
        for text in ["\0\u{1}", ",,,,\n,,,\n", "t,x,y,z\n\u{feff}\n;;;\n", "t x y z\n1\n- - - -\n"]
        {
            let _ = parsed(text);
        }
        assert!(parse(&b"t,x,y,z\n\xff\xfe\n"[..], Path::new("b")).is_err());
    }
}
