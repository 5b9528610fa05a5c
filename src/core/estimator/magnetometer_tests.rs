//! Tests of the magnetometer aid: its Jacobian, where it leads the heading, and where a wrong field does not.

use nalgebra::{UnitQuaternion, Vector3};

use super::config::{EstimatorConfig, MagnetometerConfig};
use super::magnetometer::{azimuth_row, observe, seen};
use super::state::{ATT, State};
use super::truth::{Noise, Truth, hall};
use super::{Estimator, Health};
use crate::drops::DropReason;
use crate::frames::{Rot, Vec3, wrap_pi_rad};
use crate::measure::MagSample;
use crate::survey::Survey;

/// Magnetic north lies 20 degrees east of the room's.
fn config() -> MagnetometerConfig {
    MagnetometerConfig { fuse: true, north_deg: 20.0, ..MagnetometerConfig::default() }
}

/// The room's field, Earth frame, T.
fn room_E_tesla() -> Vector3<f64> {
    let c = config();
    let (sin_dip, cos_dip) = c.dip_deg.to_radians().sin_cos();
    let (sin_n, cos_n) = c.north_deg.to_radians().sin_cos();
    Vector3::new(cos_dip * cos_n, cos_dip * sin_n, sin_dip) * (c.strength_ut * 1e-6)
}

fn sample(truth: &Truth, field_E_tesla: Vector3<f64>) -> MagSample {
    let m_B = truth.q_EB(truth.t_s).inverse_transform_vector(&field_E_tesla);
    MagSample { valid_at: truth.at(), received_at: truth.at(), field_B_tesla: Vec3::from_raw(m_B) }
}

#[test]
fn prop_the_row_is_the_derivative_of_the_azimuth() {
    let mut noise = Noise(11);
    for _ in 0..100 {
        let q = UnitQuaternion::from_scaled_axis(noise.vector(0.8));
        let m = noise.vector(3e-5) + q.inverse_transform_vector(&room_E_tesla());
        let row = azimuth_row(&q, &m);
        let h = 1e-6;
        for i in 0..3 {
            let azimuth = |step: f64| {
                let d = Vector3::from_fn(|r, _| if r == i { step } else { 0.0 });
                seen(&(q * UnitQuaternion::from_scaled_axis(d)), &m).azimuth_rad
            };
            let numeric = wrap_pi_rad(azimuth(h) - azimuth(-h)) / (2.0 * h);
            let horizontal = seen(&q, &m).horizontal_tesla / 5e-5;
            assert!((numeric - row[i]).abs() < 1e-6 / horizontal, "{numeric} {}", row[i]);
        }
        // A turn about the vertical turns the azimuth by itself.
        let down_B = q.inverse_transform_vector(&Vector3::z());
        assert!((row.dot(&down_B) - 1.0).abs() < 1e-9);
    }
}

#[test]
fn prop_innovation_is_what_brings_the_heading_right() {
    let mut noise = Noise(5);
    for _ in 0..50 {
        let q = UnitQuaternion::from_scaled_axis(noise.vector(0.5));
        let m = q.inverse_transform_vector(&room_E_tesla());
        let off_rad = 0.3 * noise.normal().clamp(-2.0, 2.0);
        let wrong = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), off_rad) * q;
        let state = State::at_pose(Vector3::zeros(), wrong, 0.3, 0.3, 0.1);
        let o = observe(&state, &m, &config()).unwrap();
        assert!((o.innovation + off_rad).abs() < 1e-9, "{} {off_rad}", o.innovation);
        // The tilt's uncertainty is in it, by the tangent of the dip.
        let std_rad = config().std_deg.to_radians();
        assert!(o.var > std_rad * std_rad + (0.1f64 * 2.0).powi(2));
    }
}

/// A filter in the air, its heading off by `off_rad`, and the truth that it flies.
fn flying(magnetometer: MagnetometerConfig, off_rad: f64) -> (Estimator, Truth, Survey) {
    let survey = hall();
    let truth = Truth::hover(Vector3::new(4.0, 5.0, -1.5));
    let config = EstimatorConfig { magnetometer, ..EstimatorConfig::default() };
    let mut estimator = Estimator::new(config, survey.clone());
    estimator.set_airborne(true);
    estimator.set_initial_heading(0.0, 0.1);
    let (pos, _) = truth.pose();
    let yaw = Rot::from_euler_rad(0.0, 0.0, truth.yaw_rad + off_rad);
    estimator.imu(&truth.imu());
    estimator.align_at(truth.at(), pos, yaw);
    (estimator, truth, survey)
}

/// Flies on with a field of 50 Hz; the error of the heading at the end, rad.
fn fly(
    (estimator, truth, survey): &mut (Estimator, Truth, Survey),
    seconds: f64,
    field_E_tesla: Vector3<f64>,
) -> f64 {
    for i in 0..(seconds * 250.0) as u64 {
        truth.advance(0.004);
        estimator.imu(&truth.imu());
        let a = (i % 8) as u8;
        estimator.tdoa(&truth.tdoa(survey, a, (a + 1) % 8));
        if i % 5 == 0 {
            estimator.mag(&sample(truth, field_E_tesla));
        }
    }
    let yaw = truth.q_EB(truth.t_s).euler_angles().2;
    wrap_pi_rad(estimator.estimate().R_EB.yaw_rad() - yaw)
}

#[test]
fn prop_a_wrong_heading_is_found_in_hover_where_nothing_else_shows_it() {
    let without = MagnetometerConfig { fuse: false, ..config() };
    let lost = fly(&mut flying(without, 0.35), 90.0, room_E_tesla());
    assert!(lost.abs() > 0.3, "hover shows no heading: {lost}");
    let found = fly(&mut flying(config(), 0.35), 90.0, room_E_tesla());
    assert!(found.abs() < 0.05, "{found}");
}

#[test]
fn prop_a_disturbed_field_moves_nothing_and_is_counted() {
    let mut flight = flying(config(), 0.0);
    // As strong as the room's horizontal part, and across it.
    let across = Vector3::new(-room_E_tesla().y, room_E_tesla().x, 0.0) * 1.2;
    let error = fly(&mut flight, 30.0, room_E_tesla() + across);
    assert!(error.abs() < 0.02, "{error}");
    assert_eq!(flight.0.counts().mag_fused, 0);
    assert_eq!(flight.0.drops().count(DropReason::MagDisturbed), 30 * 50);
}

#[test]
fn prop_a_turned_field_pulls_no_faster_than_its_sigma_allows_and_never_tilts() {
    // Strength and dip are right, the direction is off by 60 degrees: nothing shows it.
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_3)
        * room_E_tesla();
    let mut flight = flying(config(), 0.0);
    fly(&mut flight, 20.0, room_E_tesla());
    let mut before = fly(&mut flight, 0.004, room_E_tesla());
    for _ in 0..20 {
        let error = fly(&mut flight, 1.0, turned);
        let rate = wrap_pi_rad(error - before).abs();
        // Tail at 2 sigma of 0.18 rad, time constant of 20 s: 0.02 rad/s.
        assert!(rate < 0.02, "{rate} rad/s");
        let [roll, pitch, _] = flight.0.estimate().R_EB.euler_rad();
        assert!(roll.abs() < 0.02 && pitch.abs() < 0.02, "{roll} {pitch}");
        before = error;
    }
    assert_eq!(flight.0.estimate().health, Health::Good);
}

#[test]
fn prop_off_it_changes_nothing_to_the_last_bit() {
    let off = MagnetometerConfig { fuse: false, ..config() };
    let mut with = flying(off, 0.1);
    fly(&mut with, 3.0, room_E_tesla());
    let mut without = flying(MagnetometerConfig::default(), 0.1);
    fly(&mut without, 3.0, Vector3::new(1e-3, 0.0, 0.0));
    assert_eq!(with.0.estimate(), without.0.estimate());
    assert_eq!(with.0.drops(), without.0.drops());
}

#[test]
fn prop_absurd_fields_are_counted_and_change_nothing() {
    let mut flight = flying(config(), 0.1);
    fly(&mut flight, 1.0, room_E_tesla());
    let before = flight.0.estimate();
    for (i, absurd) in [f64::NAN, f64::INFINITY, 0.0, 1.0].into_iter().enumerate() {
        let mut bad = sample(&flight.1, room_E_tesla());
        bad.valid_at = bad.valid_at.offset_us(1000 * (1 + i as i64));
        bad.field_B_tesla = Vec3::new(absurd, 0.0, 0.0);
        flight.0.mag(&bad);
    }
    flight.0.mag(&sample(&flight.1, room_E_tesla()));
    flight.0.mag(&sample(&flight.1, room_E_tesla()));
    assert_eq!(flight.0.drops().count(DropReason::BadValue), 4);
    assert!(flight.0.drops().count(DropReason::ImuOutOfOrder) >= 1);
    assert_eq!(flight.0.estimate().pos_E_m, before.pos_E_m);
    assert_eq!(flight.0.estimate().health, before.health);
    // Straight down: no heading.
    let mut down = sample(&flight.1, Vector3::new(0.0, 0.0, 4.9e-5));
    down.valid_at = down.valid_at.offset_us(20_000);
    let disturbed = flight.0.drops().count(DropReason::MagDisturbed);
    flight.0.mag(&down);
    assert_eq!(flight.0.drops().count(DropReason::MagDisturbed), disturbed + 1);
    assert!(flight.0.state.as_ref().unwrap().P[(ATT, ATT)] > 0.0);
}

/// Rests on the floor; what heading is told besides.
fn start(magnetometer: MagnetometerConfig, told: Option<f64>, steel: Vector3<f64>) -> Estimator {
    let survey = hall();
    let mut truth = Truth::hover(Vector3::new(4.0, 5.0, -0.1));
    let config = EstimatorConfig { magnetometer, ..EstimatorConfig::default() };
    let mut estimator = Estimator::new(config, survey.clone());
    for i in 0..750u64 {
        truth.t_s += 0.004;
        if let Some(yaw_rad) = told {
            estimator.set_initial_heading(yaw_rad, 0.1);
        }
        estimator.imu(&truth.imu_at_rest());
        if i % 5 == 0 {
            estimator.mag(&sample(&truth, room_E_tesla() + steel));
        }
        let a = (i % 8) as u8;
        estimator.tdoa(&truth.tdoa(&survey, a, (a + 1) % 8));
    }
    estimator
}

#[test]
fn prop_a_start_on_the_floor_takes_the_heading_from_the_field() {
    let yaw = |e: &Estimator| e.estimate().R_EB.yaw_rad();
    // Nobody tells it, or the board tells it wrongly: the field's counts.
    for told in [None, Some(-1.0)] {
        let estimator = start(config(), told, Vector3::zeros());
        assert!(estimator.is_aligned() && (yaw(&estimator) - 0.4).abs() < 0.02);
        let std_rad = estimator.estimate().std_att_B_rad.z();
        assert!((0.1..0.2).contains(&std_rad), "{std_rad}");
        let field = estimator.magnetic_field().unwrap();
        assert!((field.strength_tesla() - 49e-6).abs() < 1e-7);
    }
    // Where steel bends the field, the sigma says so, and beyond a bound the board's word counts.
    let bent = start(config(), Some(-1.0), Vector3::new(0.0, 0.0, 6e-6));
    assert!(bent.estimate().std_att_B_rad.z() > 0.3, "{:?}", bent.estimate().std_att_B_rad);
    let steel = Vector3::new(2e-5, 0.0, 1e-5);
    assert!((yaw(&start(config(), Some(-1.0), steel)) + 1.0).abs() < 0.02);
    assert!(!start(config(), None, steel).is_aligned());
    let without = MagnetometerConfig { fuse: false, ..config() };
    assert!(!start(without, None, Vector3::zeros()).is_aligned());
}
