//! Reader of our own import layout: plain CSV with units in the names and signs in the head.
//!
//! `docs/IMPORT.md` is the description for users; what stands there is what is read here. In short:
//!
//! ```text
//! # haltere-import 1
//! # signs: ned-frd
//! t_s,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg,thrust_frac,supply_v
//! ```
//!
//! `ned-frd` is ours. `enu-flu` is the other common one: world x, y, z to east, north, up; body
//! forward, left, up; yaw counter-clockwise from east, pitch positive nose **down**, roll positive
//! right side down.

use std::io::{BufRead, BufReader};
use std::path::Path;

use flate2::read::GzDecoder;
use nalgebra::UnitQuaternion;

use super::bounded::Bounded;
use super::recording::{Error, Recording, Row, Skipped};
use crate::intake;
use haltere_core::frames::{
    B, E, Rot, Vec3, attitude_from_flu_enu, body_from_flu, earth_from_survey,
};

/// First line.
const MAGIC: &str = "# haltere-import 1";
/// Columns that every file has.
const NEEDED: [&str; 9] =
    ["t_s", "x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg", "thrust_frac", "supply_v"];
/// Groups that a file may have, whole or not at all.
const GROUPS: [[&str; 3]; 3] = [
    ["acc_x_mps2", "acc_y_mps2", "acc_z_mps2"],
    ["rate_x_radps", "rate_y_radps", "rate_z_radps"],
    ["set_roll_deg", "set_pitch_deg", "set_yaw_deg"],
];
/// Lowest supply voltage that can be, V: one empty cell. Below it nothing was measured yet.
const LEAST_SUPPLY_V: f64 = 2.0;
/// Rows from which on a file has a rate.
const RATED_ROWS: usize = 20;
/// Longest time between rows, s: 50 Hz, with what a clock may wander.
const LONGEST_ROW_S: f64 = 1.0 / 48.0;
/// Angles that never exceed these may be radians: a quarter turn, and half a turn for the heading.
const QUARTER_RAD: f64 = 1.6;
const HALF_RAD: f64 = 3.2;
/// A speed that grows by so much …
const GAINED_MPS: f64 = 0.5;
/// … in this time, s, needs a lean of 5.8 degrees, which no angle below `QUARTER_RAD` degrees is.
const GAINED_IN_S: f64 = 0.5;
/// Time over which such a speed is taken, s.
const SPEED_S: f64 = 0.2;

/// What a column can hold, and what a number beyond it likely is: from this on, that.
struct Holds {
    columns: &'static [&'static str],
    range: [f64; 2],
    unit: &'static str,
    likely: &'static [(f64, &'static str)],
}

const HOLDS: [Holds; 7] = [
    Holds {
        columns: &["x_m", "y_m", "z_m"],
        range: [-100.0, 100.0],
        unit: "m",
        likely: &[(100.0, "centimetres or millimetres"), (1000.0, "millimetres")],
    },
    Holds {
        columns: &["roll_deg", "pitch_deg", "set_roll_deg", "set_pitch_deg"],
        range: [-180.0, 180.0],
        unit: "deg",
        likely: &[(180.0, "hundredths of a degree")],
    },
    Holds {
        columns: &["yaw_deg", "set_yaw_deg"],
        range: [-3600.0, 3600.0],
        unit: "deg",
        likely: &[(3600.0, "hundredths of a degree")],
    },
    Holds {
        columns: &["thrust_frac"],
        range: [-0.01, 1.01],
        unit: "of full thrust",
        likely: &[(1.01, "percent"), (101.0, "a pulse in µs"), (2500.0, "counts of 65535")],
    },
    Holds {
        columns: &["supply_v"],
        range: [f64::NEG_INFINITY, 60.0],
        unit: "V",
        likely: &[(60.0, "millivolts")],
    },
    Holds {
        columns: &["acc_x_mps2", "acc_y_mps2", "acc_z_mps2"],
        range: [-400.0, 400.0],
        unit: "m/s²",
        likely: &[(400.0, "thousandths of g")],
    },
    Holds {
        columns: &["rate_x_radps", "rate_y_radps", "rate_z_radps"],
        range: [-40.0, 40.0],
        unit: "rad/s",
        likely: &[(40.0, "degrees per second")],
    },
];

/// What is wrong with a number of a column.
fn beyond(column: &str, value: f64) -> Option<String> {
    let holds = HOLDS.iter().find(|holds| holds.columns.contains(&column))?;
    let [low, high] = holds.range;
    if (low..=high).contains(&value) {
        return None;
    }
    let likely = holds.likely.iter().rev().find(|(from, _)| value.abs() >= *from);
    let likely = likely.map_or(String::new(), |(_, unit)| format!("; is it in {unit}?"));
    let allowed = match low.is_finite() {
        true => format!("{low} to {high}"),
        false => format!("up to {high}"),
    };
    Some(format!("{column} = {value}, allowed {allowed} {}{likely}", holds.unit))
}

/// Whether times are so far apart that no speed can be had of the positions.
fn too_slow(rows: &[Row]) -> Option<String> {
    if rows.len() < RATED_ROWS {
        return None;
    }
    let mut apart: Vec<f64> = rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
    let (_, middle, _) = apart.select_nth_unstable_by(rows.len() / 2 - 1, f64::total_cmp);
    let apart_s = *middle;
    let likely = match apart_s {
        s if s <= LONGEST_ROW_S => return None,
        s if s >= 1e6 => "; is it in nanoseconds?",
        s if s >= 1000.0 => "; is it in microseconds?",
        s if s >= 1.0 => "; is it in milliseconds?",
        _ => "",
    };
    Some(format!(
        "t_s: rows are {apart_s:.4} apart ({:.1} Hz), 50 Hz is the least that the speed of a position bears{likely}",
        1.0 / apart_s
    ))
}

/// Whether a vehicle gains speed that its lean does not give, were it in degrees.
fn is_radians(rows: &[Row], tilt: f64, yaw: f64) -> Option<String> {
    if tilt > QUARTER_RAD || yaw > HALF_RAD {
        return None;
    }
    let speed_at = |from: usize| {
        let begin = rows.get(from)?;
        let end = rows.get(from..)?.iter().find(|row| row.t_s >= begin.t_s + SPEED_S)?;
        let way = end.pos_E_m - begin.pos_E_m;
        Some(way.x().hypot(way.y()) / (end.t_s - begin.t_s))
    };
    let speeds: Vec<(f64, f64)> =
        (0..rows.len()).map_while(|n| Some((rows.get(n)?.t_s, speed_at(n)?))).collect();
    let mut later = 0;
    for (t_s, speed_mps) in &speeds {
        while speeds.get(later).is_some_and(|(at_s, _)| *at_s < t_s + GAINED_IN_S) {
            later += 1;
        }
        let Some((at_s, then_mps)) = speeds.get(later) else { break };
        let gained_mps = then_mps - speed_mps;
        // Behind a gap in time nothing is known.
        if gained_mps > GAINED_MPS && at_s - t_s < 2.0 * GAINED_IN_S {
            return Some(format!(
                "roll_deg and pitch_deg are never beyond {tilt:.2}, yet at t_s = {t_s} the vehicle gains {gained_mps:.1} m/s \
                 in {GAINED_IN_S} s, which needs a lean of {:.0} degrees; are the angles in radians?",
                (gained_mps / GAINED_IN_S / 9.81).atan().to_degrees()
            ));
        }
    }
    None
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Signs {
    NedFrd,
    EnuFlu,
}

impl Signs {
    fn position(self, [x, y, z]: [f64; 3]) -> Vec3<E> {
        match self {
            Signs::NedFrd => Vec3::new(x, y, z),
            Signs::EnuFlu => earth_from_survey(Vec3::new(x, y, z)),
        }
    }

    fn attitude(self, deg: [f64; 3]) -> Rot<E, B> {
        let [roll, pitch, yaw] = deg.map(f64::to_radians);
        match self {
            Signs::NedFrd => Rot::from_euler_rad(roll, pitch, yaw),
            Signs::EnuFlu => {
                attitude_from_flu_enu(UnitQuaternion::from_euler_angles(roll, pitch, yaw))
            }
        }
    }

    fn body(self, [x, y, z]: [f64; 3]) -> Vec3<B> {
        match self {
            Signs::NedFrd => Vec3::new(x, y, z),
            Signs::EnuFlu => body_from_flu(x, y, z),
        }
    }
}

/// Reads a `.csv` or `.csv.gz`.
pub fn read(path: &Path) -> Result<Recording, Error> {
    let file = intake::open(path).map_err(|source| Error::Io { path: path.into(), source })?;
    if path.extension().is_some_and(|e| e == "gz") {
        parse(BufReader::new(Bounded::new(GzDecoder::new(file))), path)
    } else {
        parse(BufReader::new(Bounded::new(file)), path)
    }
}

/// Reads the text of a file; `path` is for its name and for errors.
pub fn parse(reader: impl BufRead, path: &Path) -> Result<Recording, Error> {
    let bad = |line: usize, what: String| Error::Layout { path: path.into(), line, what };
    let unread = |line, source: std::io::Error| match source.kind() {
        std::io::ErrorKind::InvalidData => {
            bad(line, "no text in UTF-8; save it as such".to_owned())
        }
        _ => Error::Io { path: path.into(), source },
    };
    let mut lines = reader.lines().zip(1..);
    let mut signs = None;
    let mut magic = false;
    let mut names: Option<Vec<String>> = None;
    let mut names_line = 3;
    for (line, number) in lines.by_ref() {
        let line = line.map_err(|source| unread(number, source))?;
        let text = line.trim_start_matches('\u{feff}').trim();
        if number == 1 {
            magic = text == MAGIC;
        }
        if let Some(said) = text.strip_prefix("# signs:") {
            signs = Some(match said.trim() {
                "ned-frd" => Signs::NedFrd,
                "enu-flu" => Signs::EnuFlu,
                other => {
                    let what = format!("signs `{other}`, allowed ned-frd or enu-flu");
                    return Err(bad(number, what));
                }
            });
        } else if !text.starts_with('#') && !text.is_empty() {
            let other = ['"', ';', '\t'].into_iter().find(|other| text.contains(*other));
            if let Some(other) = other {
                let what = format!(
                    "{other:?} among the names; due are commas between columns, a point in numbers, and no quotes"
                );
                return Err(bad(number, what));
            }
            names = Some(text.split(',').map(|n| n.trim().to_owned()).collect());
            names_line = number;
            break;
        }
    }
    if !magic {
        return Err(bad(1, format!("the first line must be `{MAGIC}`")));
    }
    let signs = signs.ok_or_else(|| {
        bad(2, "no line `# signs: ned-frd` or `# signs: enu-flu` before the names".to_owned())
    })?;
    let names = names.unwrap_or_default();
    let place = |name: &str| names.iter().position(|n| n == name);
    let known = |name: &str| NEEDED.contains(&name) || GROUPS.iter().flatten().any(|n| *n == name);
    if let Some(unknown) = names.iter().find(|n| !known(n)) {
        let all = NEEDED.iter().chain(GROUPS.iter().flatten()).copied().collect::<Vec<_>>();
        return Err(bad(names_line, format!("column `{unknown}`, allowed {}", all.join(", "))));
    }
    if let Some(twice) =
        (1..).zip(&names).find(|(n, name)| names.iter().skip(*n).any(|o| o == *name))
    {
        return Err(bad(names_line, format!("column `{}` stands there twice", twice.1)));
    }
    let mut needed = [0; NEEDED.len()];
    for (slot, column) in needed.iter_mut().zip(NEEDED) {
        *slot = place(column).ok_or(Error::Column { path: path.into(), column })?;
    }
    let groups = GROUPS.map(|group| group.map(place));
    for (group, places) in GROUPS.iter().zip(&groups) {
        let there = places.iter().flatten().count();
        if there != 0 && there != 3 {
            let what = format!("of {} either all columns or none", group.join(", "));
            return Err(bad(names_line, what));
        }
    }
    let mut rows: Vec<Row> = Vec::new();
    let mut skipped = Skipped::default();
    let mut count = 0;
    let named: Vec<(usize, &str)> =
        names.iter().enumerate().map(|(at, name)| (at, name.as_str())).collect();
    let (mut tilt, mut heading) = (0.0_f64, 0.0_f64);
    let mut last_line = 0;
    for (line, line_number) in lines {
        let line = line.map_err(|source| unread(line_number, source))?;
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        count += 1;
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let number =
            |at: usize| cells.get(at).and_then(|c| c.parse::<f64>().ok()).filter(|v| v.is_finite());
        // Which of them is whose nobody knows; a comma at the end is none.
        if cells.iter().skip(names.len()).any(|cell| !cell.is_empty()) {
            skipped.too_long += 1;
            continue;
        }
        let values = needed.map(number);
        let [
            Some(t_s),
            Some(x),
            Some(y),
            Some(z),
            Some(roll),
            Some(pitch),
            Some(yaw),
            Some(thrust),
            Some(supply_v),
        ] = values
        else {
            skipped.unreadable += 1;
            continue;
        };
        last_line = line_number;
        let wrong = named.iter().find_map(|(at, name)| beyond(name, number(*at)?));
        if let Some(what) = wrong {
            return Err(bad(line_number, what));
        }
        if supply_v < LEAST_SUPPLY_V {
            skipped.no_voltage += 1;
            continue;
        }
        if let Some(last) = rows.last().filter(|last| t_s < last.t_s) {
            let what = format!(
                "t_s = {t_s} does not advance on {} of the row before: of two takes make two files",
                last.t_s
            );
            return Err(bad(line_number, what));
        }
        tilt = tilt.max(roll.abs()).max(pitch.abs());
        heading = heading.max(yaw.abs());
        if rows.last().is_some_and(|last| t_s <= last.t_s) {
            skipped.time_backwards += 1;
            continue;
        }
        let [acc, rate, set] = groups.map(|places| {
            let [Some(a), Some(b), Some(c)] = places.map(|at| at.and_then(number)) else {
                return None;
            };
            Some([a, b, c])
        });
        rows.push(Row {
            t_s,
            pos_E_m: signs.position([x, y, z]),
            R_EB: signs.attitude([roll, pitch, yaw]),
            thrust_frac: thrust,
            supply_v,
            tilt_apart_rad: [0.0; 2],
            acc_B_mps2: acc.map(|v| signs.body(v)),
            rate_B_radps: rate.map(|v| signs.body(v)),
            setpoint_rad: set.map(|deg| signs.attitude(deg).euler_rad()),
        });
    }
    if rows.is_empty() {
        return Err(Error::Empty { path: path.into(), rows: count, skipped });
    }
    if let Some(what) = too_slow(&rows).or_else(|| is_radians(&rows, tilt, heading)) {
        return Err(bad(last_line, what));
    }
    let file = crate::log_file::shown_name(path);
    let name = file.trim_end_matches(".gz").trim_end_matches(".csv").to_owned();
    Ok(Recording { name, rows, skipped })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(signs: &str, names: &str, body: &str) -> Result<Recording, Error> {
        let text = format!("# haltere-import 1\n# signs: {signs}\n{names}\n{body}");
        parse(text.as_bytes(), Path::new("a/flight.csv"))
    }

    const NAMES: &str = "t_s,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg,thrust_frac,supply_v";

    #[test]
    fn prop_both_sign_conventions_give_one_flight() {
        let ours = file("ned-frd", NAMES, "0.0,2,1,-3,5,10,0,0.5,7.4\n").unwrap();
        // East 1, north 2, up 3; the nose to the north is 90 deg from east; nose up is negative.
        let other = file("enu-flu", NAMES, "0.0,1,2,3,5,-10,90,0.5,7.4\n").unwrap();
        let (a, b) = (ours.rows[0], other.rows[0]);
        assert_eq!(ours.name, "flight");
        assert!((a.pos_E_m - b.pos_E_m).norm() < 1e-12);
        let apart = (a.R_EB.inverse().matrix() * b.R_EB.matrix()).trace();
        assert!((apart - 3.0).abs() < 1e-9, "{apart}");
    }

    #[test]
    fn prop_refusals_name_line_and_column() {
        let says = |error: Result<Recording, Error>, needed: &str| {
            let text = error.unwrap_err().to_string();
            assert!(text.contains(needed), "{text}");
        };
        says(parse("t_s\n".as_bytes(), Path::new("x.csv")), "the first line must be");
        says(file("nwu", NAMES, ""), "signs `nwu`, allowed ned-frd or enu-flu");
        says(file("ned-frd", "t_s,speed", ""), "column `speed`, allowed t_s");
        says(file("ned-frd", "t_s,x_m", ""), "no column `y_m`");
        says(file("ned-frd", &format!("{NAMES},acc_x_mps2"), ""), "either all columns or none");
        says(file("ned-frd", NAMES, "a,b\n0,1,2,3,4,5,6,1,0\n"), "no usable row of 2");
        says(parse("# haltere-import 1\nt_s\n".as_bytes(), Path::new("x.csv")), "no line `# signs");
    }

    /// A vehicle that goes to and fro, with each cell of a row changed by `of`.
    fn flown(rate_hz: f64, of: impl Fn(&mut [f64; 9])) -> Result<Recording, Error> {
        let mut body = String::new();
        for n in 0..400 {
            let t = f64::from(n) / rate_hz;
            let lean_deg = -(1.2 * (2.0 * t).cos() * 4.0 / 9.81).atan().to_degrees();
            let mut row = [t, -1.2 * (2.0 * t).cos(), 0.0, -1.0, 0.0, lean_deg, 0.3, 0.6, 7.4];
            of(&mut row);
            body += &row.map(|v| v.to_string()).join(",");
            body.push('\n');
        }
        file("ned-frd", NAMES, &body)
    }

    #[test]
    fn regress_numbers_in_other_units_are_refused_with_line_and_likely_unit() {
        assert_eq!(flown(100.0, |_| {}).unwrap().rows.len(), 400);
        assert_eq!(flown(50.0, |_| {}).unwrap().rows.len(), 400);
        type Change = fn(&mut [f64; 9]);
        let cases: [(f64, Change, &[&str]); 10] = [
            (100.0, |r| r[7] *= 100.0, &["line 4", "thrust_frac = 60", "percent"]),
            (100.0, |r| r[7] *= 65_535.0, &["thrust_frac = 39321", "65535"]),
            (100.0, |r| r[7] = 1000.0 + 1000.0 * r[7], &["thrust_frac = 1600", "µs"]),
            (100.0, |r| r[8] *= 1000.0, &["supply_v = 7400", "millivolts"]),
            (100.0, |r| r[1] *= 1000.0, &["x_m = -1200", "-100 to 100 m", "millimetres"]),
            (100.0, |r| r[1] *= 100.0, &["x_m = -120", "centimetres"]),
            (100.0, |r| r[0] *= 1e3, &["10.0000 apart", "milliseconds"]),
            (100.0, |r| r[0] *= 1e6, &["microseconds"]),
            (40.0, |_| {}, &["(40.0 Hz)", "50 Hz is the least"]),
            (
                100.0,
                |r| [4, 5, 6].into_iter().for_each(|k| r[k] = r[k].to_radians()),
                &["are the angles in radians?"],
            ),
        ];
        for (rate_hz, change, says) in cases {
            let why = flown(rate_hz, change).unwrap_err().to_string();
            assert!(says.iter().all(|said| why.contains(said)), "{says:?}: {why}");
        }
    }

    #[test]
    fn regress_a_byte_order_mark_is_read_and_time_that_goes_back_is_refused() {
        let text = format!("\u{feff}# haltere-import 1\r\n# signs: ned-frd\r\n{NAMES}\r\n");
        let row = |t: &str| format!("{t},0,0,-1,0,0,0,0.5,7.4\r\n");
        let read = |rows: &[&str]| {
            let text = text.clone() + &rows.iter().map(|t| row(t)).collect::<String>();
            parse(text.as_bytes(), Path::new("x.csv"))
        };
        assert_eq!(read(&["0", "0.01", "0.01", "0.02"]).unwrap().skipped.time_backwards, 1);
        let why = read(&["0", "0.01", "0"]).unwrap_err().to_string();
        assert!(why.contains("line 6: t_s = 0 does not advance on 0.01"), "{why}");
    }

    #[test]
    fn regress_text_of_other_programs_is_refused_in_words_and_rows_too_long_are_counted() {
        let row = "0,0,0,-1,0,0,0,0.5,7.4";
        let rows = format!("{row}\n{row},\n0.01,{row}\n");
        let recording = file("ned-frd", NAMES, &rows).unwrap();
        assert_eq!((recording.skipped.too_long, recording.skipped.total()), (1, 2));
        assert!(recording.skipped.to_string().starts_with("1 with more values than columns"));
        for (from, to, says) in [
            (",", ";", "line 3: ';' among the names; due are commas"),
            (",", "\t", "line 3: '\\t' among the names"),
            ("t_s", "\"t_s\"", "line 3: '\"' among the names"),
            ("y_m", "x_m", "line 3: column `x_m` stands there twice"),
        ] {
            let why = file("ned-frd", &NAMES.replace(from, to), "").unwrap_err().to_string();
            assert!(why.contains(says), "{why}");
        }
        let utf16: Vec<u8> =
            MAGIC.encode_utf16().flat_map(u16::to_le_bytes).chain([0xff]).collect();
        let why = parse(&utf16[..], Path::new("x.csv")).unwrap_err().to_string();
        assert!(why.contains("line 1: no text in UTF-8"), "{why}");
        let why = flown(100.0, |r| r[0] *= 1e9).unwrap_err().to_string();
        assert!(why.contains("nanoseconds"), "{why}");
    }

    proptest::proptest! {
        #[test]
        fn prop_no_text_panics(cells in proptest::collection::vec("[-0-9.eE,#na\n]{0,12}", 0..40)) {
            let _ = file("enu-flu", NAMES, &cells.join(","));
        }
    }

    #[test]
    fn prop_optional_groups_are_read() {
        let names = format!("{NAMES},set_roll_deg,set_pitch_deg,set_yaw_deg");
        let recording = file("ned-frd", &names, "0,0,0,-1,0,0,0,0.5,7.4,10,0,0\n").unwrap();
        let set = recording.rows[0].setpoint_rad.unwrap();
        assert!((set[0].to_degrees() - 10.0).abs() < 1e-9);
        assert!(recording.rows[0].acc_B_mps2.is_none());
    }
}
