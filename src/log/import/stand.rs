//! Reader of thrust-stand tables in the layout of `cf21_thrust_stand`.
//!
//! Columns: `weight[g]` (thrust on the scale), `pwm` (0 to 65535), `vbat[V]`; others are not read. The
//! rows carry no time: they are in the order of measuring.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;

use super::bounded::Bounded;
use super::recording::Error;
use haltere_core::frames::G_MPS2;

/// Full scale of the command, counts (README of the tables).
const FULL_COUNTS: f64 = 65_535.0;

/// One row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandRow {
    /// Thrust, N.
    pub thrust_n: f64,
    /// Command, 0 to 1.
    pub command_frac: f64,
    /// Battery, V.
    pub supply_v: f64,
}

/// A table.
#[derive(Debug, Clone, PartialEq)]
pub struct Stand {
    /// Name of the file.
    pub name: String,
    /// Rows in their order.
    pub rows: Vec<StandRow>,
    /// Rows that could not be read.
    pub skipped: usize,
}

/// Reads a table.
pub fn read(path: &Path) -> Result<Stand, Error> {
    let file =
        crate::intake::open(path).map_err(|source| Error::Io { path: path.into(), source })?;
    parse(BufReader::new(Bounded::new(file)), path)
}

/// Reads the text of a table; `path` is for its name and for errors.
pub fn parse(reader: impl BufRead, path: &Path) -> Result<Stand, Error> {
    let io = |source| Error::Io { path: path.into(), source };
    let mut lines = reader.lines();
    let header = lines.next().transpose().map_err(io)?.unwrap_or_default();
    let columns: BTreeMap<&str, usize> =
        header.split(',').enumerate().map(|(i, name)| (name.trim(), i)).collect();
    let place = |column: &'static str| {
        columns.get(column).copied().ok_or(Error::Column { path: path.into(), column })
    };
    let places = [place("weight[g]")?, place("pwm")?, place("vbat[V]")?];
    let (mut rows, mut skipped) = (Vec::new(), 0);
    for line in lines {
        let line = line.map_err(io)?;
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let value = places.map(|at| cells.get(at).and_then(|c| c.parse::<f64>().ok()));
        match value {
            [Some(grams), Some(counts), Some(supply_v)]
                if [grams, counts, supply_v].iter().all(|v| v.is_finite()) =>
            {
                rows.push(StandRow {
                    thrust_n: grams * 1e-3 * G_MPS2,
                    command_frac: counts / FULL_COUNTS,
                    supply_v,
                });
            }
            _ => skipped += 1,
        }
    }
    let name = crate::log_file::shown_name(path);
    Ok(Stand { name, rows, skipped })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_rows_come_in_our_units_and_losses_are_counted() {
        let text = "weight[g],pwm,vbat[V]\n10.0,32767.5,3.7\nx,1,2\n1,2\n";
        let stand = parse(text.as_bytes(), Path::new("a/b.csv")).unwrap();
        assert_eq!((stand.rows.len(), stand.skipped, stand.name.as_str()), (1, 2, "b.csv"));
        let row = stand.rows[0];
        assert!((row.thrust_n - 0.0980665).abs() < 1e-5 && row.command_frac == 0.5);
        let error = parse("pwm\n".as_bytes(), Path::new("b.csv")).unwrap_err().to_string();
        assert!(error.contains("no column `weight[g]`"), "{error}");
    }
}
