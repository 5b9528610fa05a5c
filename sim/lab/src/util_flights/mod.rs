//! Estimator on recorded flights, in the UTIL layout and of one's own (`own.rs`), scored against motion capture.
//!
//! Recordings: Zhao, Goudar, Qiao, Schoellig, "UTIL: An ultra-wideband time-difference-of-arrival
//! indoor localization dataset", IJRR 43(10), 2024. They come without a licence: they are read from
//! where they lie and are no part of this repository.
//!
//! What the filter is told: the anchors, and the **heading** at the first instant from motion
//! capture (rest cannot show it). Level, gyroscope bias and position it finds itself from what it
//! rests before the motors start; whether it flies is taken from the accelerometer's unrest. The
//! pose came over the radio some 10 ms late (authors' figure) and is compared as it is stamped.

pub mod airborne;
mod clock;
mod consistency;
pub mod file;
mod flown;
mod own;
mod score;
pub mod table;

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use airborne::Activity;
pub use consistency::Consistency;
use file::{Error, Flight, Sample, load_located};
pub use flown::{Flown, quadrotor};
use haltere_core::drops::DropReason;
use haltere_core::estimate::Estimate;
use haltere_core::estimator::{Counts, Estimator, EstimatorConfig, Motion};
use haltere_core::measure::{ImuSample, ReferencePose};
use haltere_core::time::HostTime;
pub use own::{Beside, logs, run_log};
use score::Score;
pub use table::{print_table, print_truth};

/// One sigma of the told heading, rad: motion capture of a hand-placed vehicle.
const STD_HEADING_RAD: f64 = 0.05;

/// How one flight went.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct FlightReport {
    /// Name of the file.
    pub flight: String,
    /// Root mean square of the 3D error from alignment on, m.
    pub rmse_3d_m: Option<f64>,
    /// The same above 0.5 m and more than 5 s after lift-off, m.
    pub rmse_3d_airborne_m: Option<f64>,
    /// Median of the 3D error, m.
    pub median_m: Option<f64>,
    /// 95th percentile of the 3D error, m.
    pub p95_m: Option<f64>,
    /// Largest 3D error, m.
    pub worst_m: Option<f64>,
    /// Mean error per axis, estimated minus true, Earth frame, m.
    pub bias_m: [f64; 3],
    /// Whether the error was above 2 m for more than 1 s, or no start was found.
    pub diverged: bool,
    /// TDOA fused.
    pub updates: u64,
    /// TDOA rejected by the gate.
    pub rejected: u64,
    /// TDOA refused as impossible: larger than the separation of their anchors.
    pub impossible: u64,
    /// Times the filter doubted itself.
    pub remedies: u64,
    /// Mean squared error over its stated covariance per axis, airborne: 1 is honest.
    pub nees_per_axis: Option<f64>,
    /// The same with the band of an honest filter.
    pub nees_band: Option<Consistency>,
    /// Rms of the error of tilt and heading while airborne, deg.
    pub attitude_deg: Option<[f64; 2]>,
    /// Mean squared innovation over its stated variance, airborne, each at most 25: 1 is honest.
    pub nis: Option<f64>,
    /// The same with the band of an honest filter.
    pub nis_band: Option<Consistency>,
    /// TDOA that were rejected or more than 3 sigma off, by anchor; each counts for both of its anchors.
    pub doubted_by_anchor: Vec<(u8, u64)>,
    /// Time with an error above 1 m during which health was not good, s.
    pub warned_s: f64,
    /// Time with an error above 1 m during which health was good, s.
    pub unwarned_s: f64,
    /// Whether there was an IMU.
    pub aided_by_imu: bool,
    /// Time of one TDOA update, ns, clock reading included; nothing where it was not taken by itself.
    pub ns_per_update: Option<f64>,
    /// What the estimate of a log of one's own was held against.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<Beside>,
}

/// What the filter did with what it was given.
#[derive(Debug, Clone, Copy, Default)]
struct Took {
    counts: Counts,
    impossible: u64,
    aligned: bool,
}

impl Took {
    fn of(estimator: &Estimator) -> Self {
        let impossible = estimator.drops().count(DropReason::UwbImpossible);
        Self { counts: estimator.counts(), impossible, aligned: estimator.is_aligned() }
    }
}

impl FlightReport {
    fn of(flight: String, score: Score, took: Took, aided_by_imu: bool) -> Self {
        let summary = score.summary();
        let Counts { tdoa_fused, tdoa_gated, remedies, .. } = took.counts;
        Self {
            flight,
            rmse_3d_m: summary.rmse_m,
            rmse_3d_airborne_m: summary.rmse_airborne_m,
            median_m: summary.median_m,
            p95_m: summary.p95_m,
            worst_m: summary.worst_m,
            bias_m: summary.bias_m,
            diverged: summary.diverged || !took.aligned,
            updates: tdoa_fused,
            rejected: tdoa_gated,
            impossible: took.impossible,
            remedies,
            nees_per_axis: summary.nees.map(|c| c.mean),
            nees_band: summary.nees,
            attitude_deg: summary.attitude_deg,
            nis: summary.nis.map(|c| c.mean),
            nis_band: summary.nis,
            doubted_by_anchor: summary.doubted_by_anchor,
            warned_s: summary.warned_s,
            unwarned_s: summary.unwarned_s,
            aided_by_imu,
            ns_per_update: None,
            truth: None,
        }
    }
}

/// Flights of a folder in the order of their names; of `full` and `tdoa_pos` in it, if it has those.
pub fn load_all(dir: &Path) -> Result<Vec<Flight>, Error> {
    let parts: Vec<PathBuf> =
        ["full", "tdoa_pos"].iter().map(|part| dir.join(part)).filter(|p| p.is_dir()).collect();
    if parts.is_empty() {
        return load_located(dir);
    }
    let mut flights = Vec::new();
    for part in parts {
        flights.extend(load_located(&part)?);
    }
    Ok(flights)
}

/// Runs one flight, the tag where the recording says.
pub fn run_flight(flight: &Flight, config: &EstimatorConfig) -> FlightReport {
    run_traced(flight, config, |_, _, _| {})
}

/// Runs one flight and shows each pose with the estimate at its time.
pub fn run_traced(
    flight: &Flight,
    config: &EstimatorConfig,
    show: impl FnMut(HostTime, &Estimate, &ReferencePose),
) -> FlightReport {
    // Where the tag is belongs to the vehicle, whatever filter is tried on it.
    let config = EstimatorConfig { p_BT_B_m: flight.p_BT_B_m(), ..config.clone() };
    run_told(flight, config, show)
}

/// The same, the tag where the configuration says.
fn run_told(
    flight: &Flight,
    mut config: EstimatorConfig,
    mut show: impl FnMut(HostTime, &Estimate, &ReferencePose),
) -> FlightReport {
    if !flight.has_imu() {
        config.motion = Motion::Unaided;
    }
    let mut estimator = Estimator::new(config, flight.survey.clone());
    if let Some(yaw_rad) = flight.first_yaw_rad() {
        estimator.set_initial_heading(yaw_rad, STD_HEADING_RAD);
    }
    let mut activity = Activity::default();
    let mut score = Score::default();
    let mut acc_B_mps2 = None;
    let mut spent_ns = 0u128;
    let mut timed = 0u64;
    for event in &flight.events {
        match event.sample {
            Sample::Acc(acc) => {
                activity.add(event.at, &acc);
                estimator.set_airborne(activity.is_airborne());
                acc_B_mps2 = Some(acc);
            }
            Sample::Gyro(rate_B_radps) => {
                if let Some(acc_B_mps2) = acc_B_mps2 {
                    estimator.imu(&ImuSample {
                        valid_at: event.at,
                        received_at: event.at,
                        acc_B_mps2,
                        rate_B_radps,
                    });
                }
            }
            Sample::Tdoa(tdoa) => {
                let begin = Instant::now();
                let record = estimator.tdoa(&tdoa);
                if estimator.is_aligned() {
                    spent_ns += begin.elapsed().as_nanos();
                    timed += 1;
                    score.innovation(&record);
                }
            }
            Sample::Baro(baro) => estimator.baro(&baro),
            Sample::Pose(pose) => {
                let estimate = estimator.is_aligned().then(|| estimator.estimate_at(event.at));
                if let Some(estimate) = &estimate {
                    show(event.at, estimate, &pose);
                }
                score.add(event.at, &pose, estimate.zip(estimator.cov_pos_E_m2()));
            }
        }
    }
    let ns_per_update = Some(if timed == 0 { 0.0 } else { spent_ns as f64 / timed as f64 });
    let took = Took::of(&estimator);
    FlightReport {
        ns_per_update,
        ..FlightReport::of(flight.name.clone(), score, took, flight.has_imu())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(dir: &Path, config: &EstimatorConfig) -> Result<Vec<FlightReport>, Error> {
        Ok(load_all(dir)?.iter().map(|flight| run_flight(flight, config)).collect())
    }

    fn flown() -> EstimatorConfig {
        Flown::by_default().unwrap().estimator
    }

    /// Errors of the UWB learned by anchor, on recorded flights of others: whole flights below the plain filter of the recordings'
    /// README at every sample, which is told its start (with IMU); airborne figures are what docs/ESTIMATOR.md says with
    /// a margin of a tenth.
    #[test]
    fn val_learned_errors_on_recorded_flights() {
        let Some(dir) = crate::recordings::util() else {
            println!("skipped: no data");
            return;
        };
        let reports = run(&dir, &flown()).unwrap();
        let mut table = String::new();
        print_table(&mut table, &reports).unwrap();
        println!("{table}");
        let bounds = [
            ("apr25-traj02-tdoa2", 0.46, 0.22),
            ("apr25-traj17-tdoa3", 0.36, 0.27),
            ("apr26-traj02-tdoa2", 0.30, 0.21),
            ("apr26-traj04-tdoa2-wood", 0.30, 0.19),
            ("apr26-traj11-tdoa2-metal", 0.35, 0.27),
            ("jun05-bolt-test-tdoa2", 0.20, 0.15),
            ("const1-trial1-tdoa2", 0.17, 0.07),
            ("const1-trial1-tdoa3", 0.17, 0.10),
            ("const2-trial3-tdoa2", 0.20, 0.10),
            ("const4-trial1-tdoa2-traj1", 0.17, 0.13),
            ("const4-trial3-tdoa2-traj1", 0.25, 0.18),
            ("const4-trial5-tdoa2-traj1", 0.25, 0.19),
        ];
        assert_eq!(reports.len(), bounds.len());
        for (report, (flight, all_m, airborne_m)) in reports.iter().zip(bounds) {
            assert_eq!(report.flight, flight);
            assert!(!report.diverged, "{flight}");
            assert!(report.rmse_3d_m.unwrap() < all_m, "{flight}");
            assert!(report.rmse_3d_airborne_m.unwrap() < airborne_m, "{flight}");
        }
        // TDOA3 brings values that no geometry allows: refused, not fused.
        assert_eq!(reports[1].impossible, 51);
        for (aided, bound_m) in [(true, 0.205), (false, 0.105)] {
            let of = reports.iter().filter(|r| r.aided_by_imu == aided);
            let median_m = table::median(of.map(|r| r.rmse_3d_airborne_m)).unwrap();
            assert!(median_m < bound_m, "{median_m}");
        }
    }

    #[test]
    fn val_first_reading_is_in_our_frames() {
        let Some(dir) = crate::recordings::util() else {
            println!("skipped: no data");
            return;
        };
        let flights = load_located(&dir.join("full")).unwrap();
        let flight = &flights[0];
        // The vehicle stands level: gravity is felt along -z, and it looks along the survey's x,
        // which is room east.
        let acc = flight.events.iter().find_map(|e| match e.sample {
            Sample::Acc(acc) => Some(acc),
            _ => None,
        });
        let acc = acc.unwrap();
        assert!((acc.z() + haltere_core::frames::G_MPS2).abs() < 0.1 && acc.x().abs() < 0.3);
        assert!((flight.first_yaw_rad().unwrap() - std::f64::consts::FRAC_PI_2).abs() < 0.1);
        assert!(flight.events.is_sorted_by_key(|e| e.at));
    }

    #[test]
    fn prop_a_folder_without_flights_is_an_error_that_says_so() {
        let dir = tempfile::tempdir().unwrap();
        let error = run(dir.path(), &flown()).unwrap_err().to_string();
        assert!(error.contains("no *.csv.gz with TDOA"), "{error}");
        let absent = dir.path().join("absent");
        assert!(matches!(run(&absent, &flown()), Err(Error::Io { .. })));
    }

    #[test]
    fn prop_broken_files_name_line_and_cell() {
        use std::io::Write;
        let dir = tempfile::tempdir().unwrap();
        let anchors = (0..6)
            .map(|i| format!("here,{i},{}.0,{}.0,{}.0\n", i % 2 * 5, i / 2 * 4, i * i % 3))
            .collect::<String>();
        std::fs::write(dir.path().join("anchors.csv"), format!("head\n{anchors}")).unwrap();
        let header = "t_tdoa,idA,idB,tdoa_meas,t_acc,acc_x,acc_y,acc_z,t_gyro,gyro_x,gyro_y,gyro_z,\
                      t_pose,pose_x,pose_y,pose_z,pose_qx,pose_qy,pose_qz,pose_qw\n";
        let good = "0.01,0,1,0.5,0.0,0,0,1,0.0,0,0,0,0.0,1,1,0,0,0,0,1\n";
        let check = |body: &str, says: &str| {
            let file = std::fs::File::create(dir.path().join("here-a.csv.gz")).unwrap();
            let mut out = flate2::write::GzEncoder::new(file, flate2::Compression::fast());
            out.write_all(header.as_bytes()).unwrap();
            out.write_all(good.as_bytes()).unwrap();
            out.write_all(body.as_bytes()).unwrap();
            out.finish().unwrap();
            match run(dir.path(), &flown()) {
                Ok(reports) => assert_eq!(says, "", "{reports:?}"),
                Err(error) => {
                    assert!(!says.is_empty() && error.to_string().contains(says), "{error}")
                }
            }
        };
        check("", "");
        check(",,,,,,,,0.001,0,0,0,,,,,,,,\n", "");
        check("0.02,0", "");
        check("0.02,0,1,x,\n", "line 3: \"x\", a finite number expected");
        check("0.02,0,1,NaN,\n", "line 3: \"NaN\"");
        check("-5,0,1,0.2,\n", "line 3: t_tdoa = -5, allowed 0 to 100000 s");
        check("0.02,0.5,1,0.2,\n", "line 3: t_tdoa: [0.5, 1.0, 0.2] is no reading");
        check(",,,,,,,,,,,,0.1,1,1,0,0,0,0,0\n", "line 3: t_pose");
        std::fs::write(dir.path().join("here-a.csv.gz"), b"no gzip").unwrap();
        assert!(matches!(run(dir.path(), &flown()), Err(Error::Io { .. })));
    }
}
