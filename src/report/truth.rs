//! Truth of a simulated flight: one row per 10 ms, as CSV, written and read here.
//!
//! The endpoint writes it beside the flight; the companion never sees it. Times are the host's
//! monotonic clock, the one the flight log uses, so that the two can be laid over each other.

use std::io::{BufRead, Write};

use haltere_core::frames::{B, E, Rot, Vec3};
use haltere_core::time::HostTime;
use haltere_model::Truth;

/// One row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthRow {
    /// Host time.
    pub at: HostTime,
    /// Simulated time since start, s.
    pub t_s: f64,
    /// Position, Earth frame, m.
    pub pos_E_m: Vec3<E>,
    /// Velocity, Earth frame, m/s.
    pub vel_E_mps: Vec3<E>,
    /// Attitude.
    pub R_EB: Rot<E, B>,
    /// Angular rate, body frame, rad/s.
    pub rate_B_radps: Vec3<B>,
    /// Flapping rate, left then right wing pair, Hz.
    pub flap_hz: [f64; 2],
    /// Voltage of the pack under load, V.
    pub supply_v: f64,
    /// Charge left, 0 to 1.
    pub charge_frac: f64,
    /// Thrust of the wings, N.
    pub thrust_n: f64,
    /// Whether the floor carries the vehicle.
    pub on_ground: bool,
    /// Whether the vehicle has hit something.
    pub crashed: bool,
}

impl TruthRow {
    /// Truth as a row of a truth file.
    pub fn of(truth: &Truth, at: HostTime) -> Self {
        Self {
            at,
            t_s: truth.t_us as f64 * 1e-6,
            pos_E_m: truth.pos_E_m,
            vel_E_mps: truth.vel_E_mps,
            R_EB: truth.R_EB,
            rate_B_radps: truth.rate_B_radps,
            flap_hz: truth.flap_hz,
            supply_v: truth.supply_v,
            charge_frac: truth.charge_frac,
            thrust_n: truth.thrust_n,
            on_ground: truth.on_ground,
            crashed: truth.crashed,
        }
    }
}

/// Names of the columns.
pub const HEADER: &str = "host_time_us,t_s,pos_E_x_m,pos_E_y_m,pos_E_z_m,vel_E_x_mps,vel_E_y_mps,\
    vel_E_z_mps,q_EB_w,q_EB_x,q_EB_y,q_EB_z,rate_B_x_radps,rate_B_y_radps,rate_B_z_radps,\
    flap_left_hz,flap_right_hz,supply_v,charge_frac,thrust_n,on_ground,crashed";

/// Columns of a row.
const COLUMNS: usize = 22;

/// Why a truth file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// The file cannot be read.
    #[error("truth: {0}")]
    Io(#[from] std::io::Error),
    /// The first line is not ours.
    #[error("truth: line 1 names other columns than this version writes: {found}")]
    Header {
        /// What stands there.
        found: String,
    },
    /// A line does not parse.
    #[error("truth: line {line}: column {column} holds `{found}`, a number is needed")]
    Number {
        /// Counted from 1.
        line: usize,
        /// Counted from 1.
        column: usize,
        /// What stands there.
        found: String,
    },
    /// A line has too few columns.
    #[error("truth: line {line} has {found} columns, {COLUMNS} are needed")]
    Columns {
        /// Counted from 1.
        line: usize,
        /// How many stand there.
        found: usize,
    },
}

impl TruthRow {
    /// Writes the row as one line.
    pub fn write(&self, out: &mut impl Write) -> std::io::Result<()> {
        let [px, py, pz] = self.pos_E_m.to_array();
        let [vx, vy, vz] = self.vel_E_mps.to_array();
        let [wx, wy, wz] = self.rate_B_radps.to_array();
        let [qw, qx, qy, qz] = self.R_EB.to_wxyz();
        writeln!(
            out,
            "{},{:.4},{px:.5},{py:.5},{pz:.5},{vx:.5},{vy:.5},{vz:.5},{qw:.7},{qx:.7},{qy:.7},{qz:.7},\
             {wx:.4},{wy:.4},{wz:.4},{:.3},{:.3},{:.4},{:.5},{:.5},{},{}",
            self.at.as_us(),
            self.t_s,
            self.flap_hz[0],
            self.flap_hz[1],
            self.supply_v,
            self.charge_frac,
            self.thrust_n,
            u8::from(self.on_ground),
            u8::from(self.crashed),
        )
    }

    fn from_columns(c: &[f64; COLUMNS]) -> Self {
        Self {
            at: HostTime::from_us(c[0].max(0.0) as u64),
            t_s: c[1],
            pos_E_m: Vec3::new(c[2], c[3], c[4]),
            vel_E_mps: Vec3::new(c[5], c[6], c[7]),
            R_EB: Rot::from_wxyz([c[8], c[9], c[10], c[11]]).unwrap_or_else(Rot::identity),
            rate_B_radps: Vec3::new(c[12], c[13], c[14]),
            flap_hz: [c[15], c[16]],
            supply_v: c[17],
            charge_frac: c[18],
            thrust_n: c[19],
            on_ground: c[20] != 0.0,
            crashed: c[21] != 0.0,
        }
    }
}

/// Reads a truth file. A last line cut short is left out: the endpoint may have been killed.
pub fn read(mut from: impl BufRead) -> Result<Vec<TruthRow>, TruthError> {
    let mut text = String::new();
    from.read_line(&mut text)?;
    if text.trim_end() != HEADER {
        return Err(TruthError::Header { found: text.trim_end().chars().take(80).collect() });
    }
    let mut rows = Vec::new();
    for line in 2.. {
        text.clear();
        from.read_line(&mut text)?;
        if !text.ends_with('\n') {
            break;
        }
        let mut columns = [0.0; COLUMNS];
        let mut found = 0;
        for (i, cell) in text.trim_end().split(',').enumerate().take(COLUMNS) {
            columns[i] = cell.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
                TruthError::Number { line, column: i + 1, found: cell.chars().take(20).collect() }
            })?;
            found = i + 1;
        }
        if found < COLUMNS {
            return Err(TruthError::Columns { line, found });
        }
        rows.push(TruthRow::from_columns(&columns));
    }
    Ok(rows)
}

/// Truth at `at`: between two rows it is taken as straight. `None` outside the rows.
pub fn interpolate(rows: &[TruthRow], at: HostTime) -> Option<TruthRow> {
    let after = rows.partition_point(|row| row.at < at);
    let b = rows.get(after)?;
    if b.at == at {
        return Some(*b);
    }
    let a = rows.get(after.checked_sub(1)?)?;
    let span_s = b.at.seconds_since(a.at);
    let part = at.seconds_since(a.at) / span_s;
    let between = |x: Vec3<E>, y: Vec3<E>| x + (y - x) * part;
    Some(TruthRow {
        at,
        t_s: a.t_s + part * (b.t_s - a.t_s),
        pos_E_m: between(a.pos_E_m, b.pos_E_m),
        vel_E_mps: between(a.vel_E_mps, b.vel_E_mps),
        R_EB: Rot::from_raw(a.R_EB.raw().nlerp(&b.R_EB.raw(), part)),
        ..*a
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(at_us: u64, x: f64) -> TruthRow {
        TruthRow {
            at: HostTime::from_us(at_us),
            t_s: at_us as f64 * 1e-6,
            pos_E_m: Vec3::new(x, -2.0, -1.25),
            vel_E_mps: Vec3::new(0.5, 0.0, -0.125),
            R_EB: Rot::from_euler_rad(0.1, -0.2, 0.3),
            rate_B_radps: Vec3::new(0.0, 0.5, 1.0),
            flap_hz: [12.5, 13.0],
            supply_v: 7.6,
            charge_frac: 0.75,
            thrust_n: 1.0,
            on_ground: false,
            crashed: false,
        }
    }

    fn file(rows: &[TruthRow]) -> Vec<u8> {
        let mut out = format!("{HEADER}\n").into_bytes();
        for row in rows {
            row.write(&mut out).unwrap();
        }
        out
    }

    #[test]
    fn prop_rows_come_back_and_a_cut_line_is_left_out() {
        assert_eq!(HEADER.split(',').count(), COLUMNS);
        let bytes = file(&[row(1_000_000, 1.0), row(1_010_000, 2.0)]);
        let back = read(&bytes[..]).unwrap();
        assert_eq!(back.len(), 2);
        assert_eq!(back[1].pos_E_m, Vec3::new(2.0, -2.0, -1.25));
        assert!(back[0].R_EB.raw().angle_to(&row(0, 0.0).R_EB.raw()) < 1e-6);
        assert_eq!(read(&bytes[..bytes.len() - 9]).unwrap().len(), 1);
    }

    #[test]
    fn prop_between_rows_is_straight_and_outside_is_nothing() {
        let rows = [row(1_000_000, 1.0), row(1_010_000, 2.0)];
        let at = |us| interpolate(&rows, HostTime::from_us(us)).map(|r| r.pos_E_m.x());
        assert_eq!(at(1_000_000), Some(1.0));
        assert_eq!(at(1_002_500), Some(1.25));
        assert_eq!(at(1_010_000), Some(2.0));
        assert_eq!(at(1_010_001), None);
        assert_eq!(at(999_999), None);
    }

    #[test]
    fn prop_refusals_say_where() {
        let says = |bytes: &[u8], text: &str| {
            let error = read(bytes).unwrap_err().to_string();
            assert!(error.contains(text), "{error}");
        };
        says(b"a,b\n", "line 1 names other columns");
        let mut bytes = file(&[row(1, 1.0)]);
        bytes.extend_from_slice(b"1,2\n");
        says(&bytes, "line 3 has 2 columns");
        let mut bytes = file(&[]);
        bytes.extend_from_slice(b"1,x\n");
        says(&bytes, "line 2: column 2 holds `x`");
    }
}
