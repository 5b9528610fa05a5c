//! Motion from motion capture alone: no force model enters.
//!
//! Around each instant a cubic is fitted to the positions within ±`HALF_WINDOW_S`; its value,
//! slope and curvature are place, speed and acceleration. Specific force in body axes:
//! `f_B = R_EB^T (a_E - g_E)`. Attitude and command are averaged over the same window, so that both
//! sides of the balance have about the same bandwidth (some 3 Hz, below the wing beat of 13 Hz).
//! The command enters without the lag of the flap rate: on all three recorded flights the measured
//! force fits the command of the same instant best, and one 0.1 s older by 0.03 to 0.06 m/s² worse;
//! lag is a candidate instead.

use nalgebra::{Matrix4, Matrix4x3, Quaternion, UnitQuaternion, Vector4};

use super::recording::{Recording, Row};
use haltere_core::frames::{B, E, Rot, Vec3, gravity_E_mps2};

/// Half of the window of the cubic, s.
const HALF_WINDOW_S: f64 = 0.15;
/// Half of the window over which command and attitude are averaged, s: a cubic's curvature weighs
/// the middle of its window.
const HALF_AVERAGE_S: f64 = 0.075;
/// Half of the window over which voltage is averaged, s: its reading steps by 20 mV.
const HALF_VOLTAGE_S: f64 = 0.5;
/// Time between samples, s.
const STEP_S: f64 = 0.05;
/// Share of the rows that its rate puts into a window, which must be there …
const LEAST_SHARE: f64 = 0.77;
/// … and least number: 50 Hz, which is the least that the curvature of a position bears.
const LEAST_ROWS: usize = 12;
/// Fastest rate that is asked for, Hz: of more rows a few may be missing.
const FASTEST_HZ: f64 = 100.0;
/// Scatter about the cubic beyond which motion capture had lost the vehicle, m rms.
const SCATTER_M: f64 = 0.01;
/// Lowest height above the floor that counts as flying, m.
const FLYING_M: f64 = 0.4;
/// Least command that counts as flying.
const FLYING_FRAC: f64 = 0.3;

/// Motion, command and battery at one instant of the flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time since the first flying sample, s.
    pub t_s: f64,
    /// Speed, m/s.
    pub vel_B_mps: Vec3<B>,
    /// Specific force: acceleration less gravity, m/s².
    pub force_B_mps2: Vec3<B>,
    /// Attitude.
    pub R_EB: Rot<E, B>,
    /// Height above where it rested, m.
    pub height_m: f64,
    /// Thrust command, 0 to 1.
    pub command_frac: f64,
    /// Its rate, 1/s.
    pub command_rate_per_s: f64,
    /// Battery, V.
    pub supply_v: f64,
    /// Roll and pitch by motion capture less those on board, rad.
    pub tilt_apart_rad: [f64; 2],
}

/// The flight, 20 times a second, and how many instants were left out for bad motion capture.
pub fn samples(recording: &Recording) -> (Vec<Sample>, usize) {
    let rows = &recording.rows;
    let Some(first) = rows.first() else { return (Vec::new(), 0) };
    let rest_z_m = floor_z_m(rows, first);
    let least_rows = least_rows(rows);
    let mut found = Vec::new();
    let mut lost = 0;
    let mut next_s = first.t_s;
    let mut from = 0;
    for row in rows {
        if row.t_s < next_s {
            continue;
        }
        // Half a row less: sums of 10 ms are not exact.
        next_s = row.t_s + STEP_S - 0.005;
        if row.thrust_frac < FLYING_FRAC || rest_z_m - row.pos_E_m.z() < FLYING_M {
            continue;
        }
        let window = |half_s: f64| {
            let begin = from + rows[from..].partition_point(|r| r.t_s < row.t_s - half_s);
            let end = begin + rows[begin..].partition_point(|r| r.t_s <= row.t_s + half_s);
            begin..end
        };
        let (wide, cubic, narrow) =
            (window(HALF_VOLTAGE_S), window(HALF_WINDOW_S), window(HALF_AVERAGE_S));
        from = wide.start;
        let Some((vel_E_mps, acc_E_mps2)) = motion(&rows[cubic], row.t_s, least_rows) else {
            lost += 1;
            continue;
        };
        let R_EB = mean_attitude(&rows[narrow.clone()]);
        let R_BE = R_EB.inverse();
        let near = &rows[narrow];
        let n = near.len().max(1) as f64;
        let mean = |of: fn(&Row) -> f64| near.iter().map(of).sum::<f64>() / n;
        let volts = &rows[wide];
        found.push(Sample {
            t_s: row.t_s,
            vel_B_mps: R_BE * vel_E_mps,
            force_B_mps2: R_BE * (acc_E_mps2 - gravity_E_mps2()),
            R_EB,
            height_m: rest_z_m - row.pos_E_m.z(),
            command_frac: mean(|r| r.thrust_frac),
            command_rate_per_s: command_rate_per_s(near),
            supply_v: volts.iter().map(|r| r.supply_v).sum::<f64>() / volts.len().max(1) as f64,
            tilt_apart_rad: [mean(|r| r.tilt_apart_rad[0]), mean(|r| r.tilt_apart_rad[1])],
        });
    }
    if let Some(begin_s) = found.first().map(|s| s.t_s) {
        found.iter_mut().for_each(|s| s.t_s -= begin_s);
    }
    (found, lost)
}

/// Whether a recording begins in flight, so that its first row is not the floor.
pub fn begins_in_flight(recording: &Recording) -> bool {
    recording.rows.first().is_some_and(|row| row.thrust_frac >= FLYING_FRAC)
}

/// What is likely, where no instant of a recording is in the air.
pub fn why_none_flies(recording: &Recording) -> Option<String> {
    let rows = &recording.rows;
    let floor_z_m = floor_z_m(rows, rows.first()?);
    let beats: Vec<&Row> = rows.iter().filter(|row| row.thrust_frac >= FLYING_FRAC).collect();
    if beats.is_empty() {
        return Some(format!("thrust_frac is never {FLYING_FRAC} or more"));
    }
    let heights = || beats.iter().map(|row| floor_z_m - row.pos_E_m.z());
    let above = heights().filter(|h| *h >= FLYING_M).count();
    let below_m = heights().fold(0.0, f64::min);
    let below = heights().filter(|h| *h <= -FLYING_M).count();
    if above > 0 {
        return None;
    }
    Some(if below * 2 > beats.len() {
        format!(
            "it flies up to {:.2} m below its floor: z_m is up and its signs say down, or the other way round; write \
             `# signs: enu-flu` over x east, y north, z up, and look whether x and y are those of the signs, too \
             (docs/IMPORT.md)",
            -below_m
        )
    } else {
        format!(
            "with thrust_frac of {FLYING_FRAC} or more it is never {FLYING_M} m above where it rests; is z_m in metres?"
        )
    })
}

/// The floor: where the vehicle rests in the first row; of one that flies there already, the lowest place with the
/// wings at rest; of one that never rests, the origin's plane.
fn floor_z_m(rows: &[Row], first: &Row) -> f64 {
    if first.thrust_frac < FLYING_FRAC {
        return first.pos_E_m.z();
    }
    let rests = rows.iter().filter(|row| row.thrust_frac < FLYING_FRAC);
    rests
        .map(|row| row.pos_E_m.z())
        .fold(None, |low: Option<f64>, z| Some(low.map_or(z, |l| l.max(z))))
        .unwrap_or(0.0)
}

/// Rows that a window must hold, by the rate of the recording.
fn least_rows(rows: &[Row]) -> usize {
    let mut apart: Vec<f64> = rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
    if apart.is_empty() {
        return LEAST_ROWS;
    }
    let middle = apart.len() / 2;
    let (_, apart_s, _) = apart.select_nth_unstable_by(middle, f64::total_cmp);
    let there = 2.0 * HALF_WINDOW_S / apart_s.max(1.0 / FASTEST_HZ) + 1.0;
    LEAST_ROWS.max((LEAST_SHARE * there) as usize + 1)
}

/// Slope of the command over the rows.
fn command_rate_per_s(rows: &[Row]) -> f64 {
    let n = rows.len().max(1) as f64;
    let mean_s = rows.iter().map(|r| r.t_s).sum::<f64>() / n;
    let spread: f64 = rows.iter().map(|r| (r.t_s - mean_s).powi(2)).sum();
    let together: f64 = rows.iter().map(|r| (r.t_s - mean_s) * r.thrust_frac).sum();
    if spread > 0.0 { together / spread } else { 0.0 }
}

/// Speed and acceleration at `t_s` by a cubic through the rows; `None` when it does not fit.
fn motion(rows: &[Row], t_s: f64, least_rows: usize) -> Option<(Vec3<E>, Vec3<E>)> {
    if rows.len() < least_rows {
        return None;
    }
    let powers = |row: &Row| {
        let s = (row.t_s - t_s) / HALF_WINDOW_S;
        Vector4::new(1.0, s, s * s, s * s * s)
    };
    let mut normal = Matrix4::zeros();
    let mut right = Matrix4x3::zeros();
    for row in rows {
        let a = powers(row);
        normal += a * a.transpose();
        right += a * row.pos_E_m.raw().transpose();
    }
    let fit = normal.cholesky()?.solve(&right);
    let square: f64 = rows
        .iter()
        .map(|row| (row.pos_E_m.raw() - fit.transpose() * powers(row)).norm_squared())
        .sum();
    if square > SCATTER_M * SCATTER_M * rows.len() as f64 {
        return None;
    }
    let slope = fit.row(1).transpose() / HALF_WINDOW_S;
    let curve = fit.row(2).transpose() * (2.0 / (HALF_WINDOW_S * HALF_WINDOW_S));
    Some((Vec3::from_raw(slope), Vec3::from_raw(curve)))
}

fn mean_attitude(rows: &[Row]) -> Rot<E, B> {
    let mut sum = Quaternion::new(0.0, 0.0, 0.0, 0.0);
    for row in rows {
        let q = row.R_EB.raw().into_inner();
        sum += if sum.dot(&q) < 0.0 { -q } else { q };
    }
    UnitQuaternion::try_new(sum, 1e-6).map_or(Rot::identity(), Rot::from_raw)
}

#[cfg(test)]
mod tests {
    use super::super::recording::Skipped;
    use super::*;
    use haltere_core::frames::G_MPS2;

    /// "0 samples in the air" was all that was said.
    #[test]
    fn regress_a_flight_under_its_floor_names_the_signs() {
        let flight = |height_m: f64, thrust_frac: f64| {
            let row = |i: u32| Row {
                t_s: f64::from(i) * 0.01,
                pos_E_m: Vec3::new(0.0, 0.0, if i < 100 { 0.0 } else { -height_m }),
                R_EB: Rot::identity(),
                thrust_frac: if i < 100 { 0.0 } else { thrust_frac },
                supply_v: 7.4,
                tilt_apart_rad: [0.0; 2],
                acc_B_mps2: None,
                rate_B_radps: None,
                setpoint_rad: None,
            };
            let (rows, skipped) = ((0..1000).map(row).collect(), Skipped::default());
            why_none_flies(&Recording { name: "a".into(), rows, skipped })
        };
        assert_eq!(flight(1.2, 0.6), None);
        let told = flight(-1.2, 0.6).unwrap();
        assert!(told.starts_with("it flies up to 1.20 m below its floor"), "{told}");
        assert!(told.contains("# signs: enu-flu"), "{told}");
        assert!(flight(0.0012, 0.6).unwrap().ends_with("is z_m in metres?"));
        assert!(flight(1.2, 0.1).unwrap().contains("thrust_frac is never 0.3 or more"));
    }

    #[test]
    fn prop_a_banked_circle_is_balanced_by_thrust_alone() {
        // Circle of 1.5 m at 1 rad/s, 1.2 m up, heading along +x of the room all the time.
        let (radius, rate) = (1.5f64, 1.0f64);
        let rows = (0..3000)
            .map(|i| {
                let t_s = f64::from(i) * 0.01;
                let (s, c) = (rate * t_s).sin_cos();
                let height = if i == 0 { 0.0 } else { 1.2 };
                let acc = Vec3::<E>::new(-c, -s, 0.0) * (radius * rate * rate);
                let thrust_E = (acc - gravity_E_mps2()).raw();
                // Body z is against the thrust, the shortest turn from level.
                let down = nalgebra::Vector3::z();
                let q = UnitQuaternion::rotation_between(&down, &-thrust_E).unwrap();
                Row {
                    t_s,
                    pos_E_m: Vec3::new(radius * c, radius * s, -height),
                    R_EB: Rot::from_raw(q),
                    thrust_frac: 0.6,
                    supply_v: 7.4,
                    tilt_apart_rad: [0.0; 2],
                    acc_B_mps2: None,
                    rate_B_radps: None,
                    setpoint_rad: None,
                }
            })
            .collect();
        let recording = Recording { name: "circle".into(), rows, skipped: Skipped::default() };
        let (samples, lost) = samples(&recording);
        assert!(samples.len() > 580 && lost < 8, "{} {lost}", samples.len());
        for s in &samples[10..] {
            let f = s.force_B_mps2;
            assert!(f.x().abs() < 0.02 && f.y().abs() < 0.02, "{f:?}");
            assert!((f.z() + G_MPS2.hypot(radius * rate * rate)).abs() < 0.02, "{f:?}");
            assert!((s.vel_B_mps.norm() - radius * rate).abs() < 0.01);
        }
    }
}
