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

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use flate2::read::GzDecoder;
use nalgebra::UnitQuaternion;

use super::bounded::Bounded;
use super::recording::{Error, Recording, Row, Skipped};
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
/// Supply voltages that can be, V: one to twelve cells.
const SUPPLY_V: std::ops::RangeInclusive<f64> = 2.0..=60.0;

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
    let file = File::open(path).map_err(|source| Error::Io { path: path.into(), source })?;
    if path.extension().is_some_and(|e| e == "gz") {
        parse(BufReader::new(Bounded::new(GzDecoder::new(file))), path)
    } else {
        parse(BufReader::new(Bounded::new(file)), path)
    }
}

/// Reads the text of a file; `path` is for its name and for errors.
pub fn parse(reader: impl BufRead, path: &Path) -> Result<Recording, Error> {
    let io = |source| Error::Io { path: path.into(), source };
    let bad = |line: usize, what: String| Error::Layout { path: path.into(), line, what };
    let mut lines = reader.lines().zip(1..);
    let mut signs = None;
    let mut magic = false;
    let mut names: Option<Vec<String>> = None;
    for (line, number) in lines.by_ref() {
        let line = line.map_err(io)?;
        let text = line.trim();
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
            names = Some(text.split(',').map(|n| n.trim().to_owned()).collect());
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
        return Err(bad(3, format!("column `{unknown}`, allowed {}", all.join(", "))));
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
            return Err(bad(3, what));
        }
    }
    let mut rows: Vec<Row> = Vec::new();
    let mut skipped = Skipped::default();
    let mut count = 0;
    for (line, _) in lines {
        let line = line.map_err(io)?;
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        count += 1;
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let number =
            |at: usize| cells.get(at).and_then(|c| c.parse::<f64>().ok()).filter(|v| v.is_finite());
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
        if !SUPPLY_V.contains(&supply_v) {
            skipped.no_voltage += 1;
            continue;
        }
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
    let file = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
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
        says(file("ned-frd", NAMES, "a,b\n0,1,2,3,4,5,6,7,900\n"), "no usable row of 2");
        says(parse("# haltere-import 1\nt_s\n".as_bytes(), Path::new("x.csv")), "no line `# signs");
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
