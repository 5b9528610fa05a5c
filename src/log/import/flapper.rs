//! Reader of recorded flights in the layout of `flapper_swarm3d` (`.csv.gz`, 100 Hz, motion capture).
//!
//! Columns: `timeTick` (ms); `roll`, `pitch` (deg, on board: right side down, nose up); `thrust`
//! (0 to 65535); `vbat` (V); where there, `accX…accZ` (g, forward, left, up); `otX0…otZ0` (m, z up); `otRoll0…otYaw0` (deg, heading counter-clockwise).
//! Tilt is taken from the vehicle, heading and position from motion capture. Here, and nowhere else,
//! the recording's z-up, nose-up, counter-clockwise signs become our NED and FRD.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;

use flate2::read::GzDecoder;

use super::bounded::Bounded;
use super::recording::{Error, Recording, Row, Skipped};
use haltere_core::frames::{
    B, G_MPS2, Vec3, attitude_from_heading_ccw, body_from_flu, earth_from_survey,
};

/// Full scale of the thrust command, counts (README of the recordings).
const FULL_COUNTS: f64 = 65_535.0;
/// Tilt by motion capture and on board may differ by this, deg; more is a flipped rigid body.
const TILT_APART_DEG: f64 = 20.0;
/// Pack voltages that can be, V: two cells from empty to full with margin.
const SUPPLY_V: std::ops::RangeInclusive<f64> = 5.0..=9.0;

/// Reads a `.csv.gz`.
pub fn read(path: &Path) -> Result<Recording, Error> {
    let io = |source| Error::Io { path: path.into(), source };
    let file = crate::intake::open(path).map_err(io)?;
    parse(BufReader::new(Bounded::new(GzDecoder::new(file))), path)
}

const NEEDED: [&str; 11] = [
    "timeTick", "roll", "pitch", "thrust", "vbat", "otX0", "otY0", "otZ0", "otRoll0", "otPitch0",
    "otYaw0",
];

/// Reads the text of a recording; `path` is for its name and for errors.
pub fn parse(reader: impl BufRead, path: &Path) -> Result<Recording, Error> {
    let io = |source| Error::Io { path: path.into(), source };
    let mut lines = reader.lines();
    let header = lines.next().transpose().map_err(io)?.unwrap_or_default();
    let columns: BTreeMap<&str, usize> =
        header.split(',').enumerate().map(|(i, name)| (name.trim(), i)).collect();
    let mut place = [0; NEEDED.len()];
    for (slot, column) in place.iter_mut().zip(NEEDED) {
        *slot = *columns.get(column).ok_or(Error::Column { path: path.into(), column })?;
    }
    let mut rows: Vec<Row> = Vec::new();
    let mut skipped = Skipped::default();
    // Not needed by a force balance, and not in every file.
    let acc_at = ["accX", "accY", "accZ"].map(|name| columns.get(name).copied());
    for line in lines {
        let line = line.map_err(io)?;
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let mut value = [0.0; NEEDED.len()];
        let whole = cells.len() == columns.len()
            && value.iter_mut().zip(place).all(|(value, at)| {
                cells.get(at).and_then(|c| c.parse().ok()).is_some_and(|v: f64| {
                    *value = v;
                    v.is_finite()
                })
            });
        if !whole {
            skipped.unreadable += 1;
            continue;
        }
        let [tick_ms, roll, pitch, thrust, vbat, x, y, z, ot_roll, ot_pitch, ot_yaw] = value;
        if !SUPPLY_V.contains(&vbat) {
            skipped.no_voltage += 1;
            continue;
        }
        if (ot_roll - roll).abs() > TILT_APART_DEG || (ot_pitch - pitch).abs() > TILT_APART_DEG {
            skipped.reference_flipped += 1;
            continue;
        }
        let t_s = tick_ms * 1e-3;
        if rows.last().is_some_and(|last| t_s <= last.t_s) {
            skipped.time_backwards += 1;
            continue;
        }
        rows.push(Row {
            t_s,
            pos_E_m: earth_from_survey(Vec3::new(x, y, z)),
            R_EB: attitude_from_heading_ccw(
                roll.to_radians(),
                pitch.to_radians(),
                ot_yaw.to_radians(),
            ),
            thrust_frac: thrust / FULL_COUNTS,
            supply_v: vbat,
            tilt_apart_rad: [(ot_roll - roll).to_radians(), (ot_pitch - pitch).to_radians()],
            acc_B_mps2: acceleration(&acc_at, &cells),
            rate_B_radps: None,
            setpoint_rad: None,
        });
    }
    let file = crate::log_file::shown_name(path);
    Ok(Recording { name: file.trim_end_matches(".csv.gz").to_owned(), rows, skipped })
}

/// Accelerometer of a row, from g along forward, left and up.
fn acceleration(places: &[Option<usize>; 3], cells: &[&str]) -> Option<Vec3<B>> {
    let of = |axis: usize| -> Option<f64> {
        let g: f64 = cells.get(places[axis]?)?.parse().ok()?;
        g.is_finite().then_some(g * G_MPS2)
    };
    Some(body_from_flu(of(0)?, of(1)?, of(2)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "timeTick, roll, pitch, yaw, thrust, vbat, otX0, otY0, otZ0, otRoll0, \
                        otPitch0, otYaw0\n";

    fn parsed(body: &str) -> Recording {
        parse(format!("{HEAD}{body}").as_bytes(), Path::new("a/b.csv.gz")).unwrap()
    }

    #[test]
    fn prop_rows_come_in_our_frames() {
        let recording = parsed("1000, 0, 10, 3, 32767.5, 7.5, 1, 2, 3, 0, 10, 90\n");
        assert_eq!(recording.name, "b");
        let row = recording.rows[0];
        assert_eq!(row.pos_E_m.to_array(), [2.0, 1.0, -3.0]);
        assert_eq!((row.t_s, row.thrust_frac, row.supply_v), (1.0, 0.5, 7.5));
        // Heading a quarter turn counter-clockwise from x is along y, our north; nose up.
        let ahead = (row.R_EB * Vec3::<B>::new(1.0, 0.0, 0.0)).to_array();
        assert!(ahead[0] > 0.98 && ahead[1].abs() < 1e-12 && ahead[2] < -0.17);
    }

    #[test]
    fn prop_what_is_left_out_is_counted() {
        let recording = parsed(
            "1000, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0\n\
             1010, 0, 0, 0, 1, 7.5, 0, 0, 0, 0, 0, 0\n\
             1010, 0, 0, 0, 1, 7.5, 0, 0, 0, 0, 0, 0\n\
             1020, 0, 0, 0, 1, 7.5, 0, 0, 0, 0, 178, 0\n\
             1030, 0, 0, 0, 1, 7.\n\
             1040, 0, 0, 0, 1, 7.5, x, 0, 0, 0, 0, 0\n",
        );
        let want = Skipped {
            unreadable: 2,
            no_voltage: 1,
            reference_flipped: 1,
            time_backwards: 1,
            ..Skipped::default()
        };
        assert_eq!((recording.rows.len(), recording.skipped), (1, want));
    }

    #[test]
    fn prop_a_missing_column_is_named() {
        let error = parse("timeTick, roll\n".as_bytes(), Path::new("x.csv.gz")).unwrap_err();
        assert!(error.to_string().contains("no column `pitch`"), "{error}");
    }
}
