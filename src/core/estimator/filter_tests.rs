//! Tests of the whole filter on its own truth (`truth.rs`).

use nalgebra::{UnitQuaternion, Vector3};

use super::state::{ATT, Cov, State};
use super::truth::{Noise, Truth, geometry, hall};
use super::update;
use super::*;
use crate::frames::{G_MPS2, wrap_pi_rad};
use crate::measure::{BaroSample, ReferencePose, Tdoa};

/// Settings for truth with white noise: nothing of the flapping vehicle's vibration.
pub(super) fn quiet() -> EstimatorConfig {
    EstimatorConfig {
        acc_average_s: 0.0,
        uwb_correlation_s: 0.0,
        process: ProcessNoise {
            std_acc_xy_mps2_rthz: 0.3,
            std_acc_z_mps2_rthz: 0.3,
            std_rate_radps_rthz: 0.01,
            std_pos_m_rts: 0.001,
        },
        ..EstimatorConfig::default()
    }
}

/// What a flight of the truth does to the filter.
pub(super) struct Run {
    pub estimator: Estimator,
    pub truth: Truth,
    survey: Survey,
    noise: Noise,
    pub std_uwb_m: f64,
    steps: usize,
}

impl Run {
    /// 250 Hz of IMU, two TDOA on the ring per sample.
    pub const DT_S: f64 = 0.004;

    pub fn new(config: EstimatorConfig, truth: Truth) -> Self {
        let survey = hall();
        let estimator = Estimator::new(config, survey.clone());
        Self { estimator, truth, survey, noise: Noise(11), std_uwb_m: 0.1, steps: 0 }
    }

    pub fn aligned(config: EstimatorConfig, truth: Truth) -> Self {
        let mut run = Self::new(config, truth);
        run.estimator.set_airborne(true);
        let (pos_E_m, R_EB) = run.truth.pose();
        run.estimator.align_at(run.truth.at(), pos_E_m, R_EB);
        run
    }

    pub fn ring(&mut self, spoil: impl Fn(&mut Tdoa)) {
        for _ in 0..2 {
            let a = (self.steps % 8) as u8;
            self.steps += 1;
            let mut tdoa = self.truth.tdoa(&self.survey, a, (a + 1) % 8);
            tdoa.distance_diff_m += self.std_uwb_m * self.noise.normal();
            spoil(&mut tdoa);
            self.estimator.tdoa(&tdoa);
        }
    }

    pub fn fly_spoiled(&mut self, seconds: f64, spoil: impl Fn(&mut Tdoa)) {
        for _ in 0..(seconds / Self::DT_S) as usize {
            self.truth.advance(Self::DT_S);
            let mut imu = self.truth.imu();
            imu.acc_B_mps2 += Vec3::from_raw(self.noise.vector(0.3));
            imu.rate_B_radps += Vec3::from_raw(self.noise.vector(0.01));
            self.estimator.imu(&imu);
            self.ring(&spoil);
        }
    }

    pub fn fly(&mut self, seconds: f64) {
        self.fly_spoiled(seconds, |_| {});
    }

    fn rest(&mut self, seconds: f64) {
        for _ in 0..(seconds / Self::DT_S) as usize {
            self.truth.t_s += Self::DT_S;
            let mut imu = self.truth.imu_at_rest();
            imu.acc_B_mps2 += Vec3::from_raw(self.noise.vector(0.05));
            imu.rate_B_radps +=
                Vec3::new(0.02, -0.03, 0.01) + Vec3::from_raw(self.noise.vector(0.005));
            self.estimator.imu(&imu);
            self.ring(|_| {});
        }
    }

    pub fn error_m(&self) -> f64 {
        (self.estimator.estimate().pos_E_m.raw() - self.truth.x_E).norm()
    }

    pub fn yaw_error_rad(&self) -> f64 {
        let (_, R_EB) = self.truth.pose();
        wrap_pi_rad(self.estimator.estimate().R_EB.yaw_rad() - R_EB.yaw_rad())
    }
}

pub(super) fn middle() -> Vector3<f64> {
    Vector3::new(5.0, 4.0, -2.0)
}

fn assert_sane(P: &Cov) {
    assert_eq!(*P, P.transpose(), "not symmetric to the last bit");
    assert!(P.symmetric_eigenvalues().min() > 0.0, "not positive");
}

#[test]
fn prop_covariance_stays_symmetric_and_positive() {
    for (i, tail) in [Tail::Gaussian, Tail::Huber, Tail::StudentT].into_iter().enumerate() {
        let gate = GateConfig { tail, ..GateConfig::default() };
        let config = EstimatorConfig { gate, p_BT_B_m: [0.01, 0.02, -0.05], ..quiet() };
        let mut run = Run::aligned(config, Truth::flying(middle()));
        run.noise = Noise(100 + i as u64);
        for round in 0..40 {
            // Rough treatment: wild values, long pauses, aids that are far more certain.
            run.fly_spoiled(0.5, |t| {
                t.distance_diff_m += if t.anchor_a.0 == 3 { 4.0 } else { 0.0 }
            });
            if round % 10 == 5 {
                run.truth.advance(0.3);
            }
            let state = run.estimator.state.as_mut().unwrap();
            for axis in 0..3 {
                let o = reference::observe(state, axis, state.x_E[axis] + 0.01, 1e-8);
                update::fuse(state, &o);
            }
            let state = run.estimator.state.as_ref().unwrap();
            assert_sane(&state.P);
            assert!((state.q_EB.norm() - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn prop_order_of_updates_matters_to_second_order_only() {
    let observe = |state: &State, a: u8, b: u8, innovation: f64| {
        let g = geometry(a, b, Vector3::new(0.02, 0.0, -0.1), 0.0);
        let mut o = tdoa::observe(state, &g, 0.0, None, 0.04).unwrap();
        o.innovation = innovation;
        o
    };
    let start = {
        let mut run = Run::aligned(quiet(), Truth::flying(middle()));
        run.fly(2.0);
        run.estimator.state.unwrap()
    };
    // Innovations are given for the common start; the second update sees what the first left.
    let both = |size: f64, swap: bool| {
        let mut pair = [(0u8, 5u8, size), (3, 6, -0.7 * size)];
        if swap {
            pair.swap(0, 1);
        }
        let mut state = start.clone();
        for (a, b, innovation) in pair {
            let at_start = observe(&start, a, b, 0.0);
            let mut o = observe(&state, a, b, innovation);
            let moved = state.x_E - start.x_E;
            let turned = (start.q_EB.inverse() * state.q_EB).scaled_axis();
            o.innovation -= at_start.h_pos.dot(&moved) + at_start.h_att.dot(&turned);
            update::fuse(&mut state, &o);
        }
        state
    };
    let apart = |size: f64| (both(size, false).x_E - both(size, true).x_E).norm();
    let (large, small) = (apart(0.2), apart(0.1));
    assert!(large < 1e-3, "{large}");
    assert!(small < 0.3 * large + 1e-12, "halving must quarter: {large} {small}");
}

#[test]
fn prop_scalar_after_scalar_is_the_joint_update() {
    let mut noise = Noise(3);
    let mut state = State::at_pose(middle(), UnitQuaternion::identity(), 0.3, 0.3, 0.1);
    let A = Cov::from_fn(|_, _| noise.normal() * 0.1);
    state.P += A * A.transpose();
    let start = state.clone();
    for axis in 0..3 {
        let o = reference::observe(&state, axis, middle()[axis] + 0.1, 0.01);
        assert!(update::fuse(&mut state, &o));
    }
    // Joint: K = P Hᵀ (H P Hᵀ + R)⁻¹ with H = [I 0 0].
    let pht = start.P.fixed_view::<9, 3>(0, 0).into_owned();
    let S = start.P.fixed_view::<3, 3>(0, 0) + nalgebra::Matrix3::identity() * 0.01;
    let K = pht * S.try_inverse().unwrap();
    let delta = K * Vector3::repeat(0.1);
    assert!((state.x_E - middle() - delta.fixed_rows::<3>(0)).norm() < 1e-12);
    assert!((state.v_B - delta.fixed_rows::<3>(3)).norm() < 1e-12);
    let turned = (start.q_EB.inverse() * state.q_EB).scaled_axis();
    assert!((turned - delta.fixed_rows::<3>(ATT)).norm() < 1e-2 * turned.norm() + 1e-9);
    let P = start.P - K * pht.transpose();
    let block = |P: &Cov| P.fixed_view::<6, 6>(0, 0).into_owned();
    assert!((block(&state.P) - block(&P)).amax() < 1e-12);
}

#[test]
fn prop_follows_a_flight() {
    for specific_force in [SpecificForce::ThrustAxis, SpecificForce::Accelerometer] {
        let config = EstimatorConfig { specific_force, cop_z_m: 0.0, ..quiet() };
        let mut run = Run::aligned(config, Truth::flying(middle()));
        let (mut sum_m2, mut sum_mps2) = (0.0, 0.0);
        for _ in 0..60 {
            run.fly(0.25);
            sum_m2 += run.error_m().powi(2) / 60.0;
            let vel_B_mps = run.estimator.estimate().vel_B_mps.raw();
            sum_mps2 += (vel_B_mps - run.truth.v_B).norm_squared() / 60.0;
        }
        // White noise r = 0.1² m² / 500 Hz and a velocity density q = 0.3² give a steady variance
        // of √2 r^¾ q^¼ per axis in position and √2 r^¼ q^¾ in velocity: 0.035 m and
        // 0.21 m/s in three axes.
        assert!(sum_m2.sqrt() < 0.05, "{specific_force:?} {}", sum_m2.sqrt());
        assert!(sum_mps2.sqrt() < 0.25, "{specific_force:?} {}", sum_mps2.sqrt());
        assert_eq!(run.estimator.estimate().health, Health::Good);
    }
}

#[test]
fn prop_errors_are_as_large_as_stated() {
    // Squared error over stated variance, per axis, over many flights: 1 for an honest filter that
    // knows the noise it gets. This one is told more than there is (density 0.3 against 0.019), so
    // below 1; far below 1 would be useless, above 1 dishonest.
    let mut nees = 0.0;
    let flights = 20;
    for i in 0..flights {
        let config = EstimatorConfig {
            cop_z_m: 0.0,
            std_uwb_m: 0.1,
            uwb_noise: UwbNoise::Constant,
            ..quiet()
        };
        let mut run = Run::aligned(config, Truth::flying(middle()));
        run.noise = Noise(500 + i);
        run.fly(4.0);
        let estimate = run.estimator.estimate();
        let off = estimate.pos_E_m.raw() - run.truth.x_E;
        nees += (0..3).map(|k| (off[k] / estimate.std_pos_E_m[k]).powi(2)).sum::<f64>();
    }
    let per_axis = nees / (3 * flights) as f64;
    assert!((0.2..1.5).contains(&per_axis), "{per_axis}");
}

#[test]
fn prop_the_drag_term_pays() {
    let velocity_error = |drag: bool| {
        let config = EstimatorConfig { drag, cop_z_m: 0.0, uwb_correlation_s: 0.2, ..quiet() };
        let mut run = Run::aligned(config, Truth::flying(middle()));
        let mut sum = 0.0;
        for _ in 0..40 {
            run.fly(0.25);
            sum += (run.estimator.estimate().vel_B_mps.raw() - run.truth.v_B).norm_squared();
        }
        (sum / 40.0).sqrt()
    };
    let (with, without) = (velocity_error(true), velocity_error(false));
    assert!(without > 2.0 * with, "with {with}, without {without}");
}

#[test]
fn prop_starts_from_rest() {
    let mut truth = Truth::hover(Vector3::new(3.0, 6.0, -0.05));
    truth.yaw_rad = -2.1;
    let mut run = Run::new(quiet(), truth);
    run.rest(1.5);
    assert_eq!(run.estimator.estimate().health, Health::NotAligned, "nobody told the heading");
    run.estimator.set_initial_heading(-2.1, 0.05);
    run.rest(1.5);
    assert!(run.estimator.is_aligned());
    assert!(run.error_m() < 0.1, "{}", run.error_m());
    assert!(run.yaw_error_rad().abs() < 0.02);
    let bias = run.estimator.gyro_bias_B_radps().raw();
    assert!((bias - Vector3::new(0.02, -0.03, 0.01)).norm() < 0.002, "{bias}");
    assert_eq!(run.estimator.estimate().health, Health::Good);
    // Standing on and on it does not run away.
    run.rest(20.0);
    assert!(run.error_m() < 0.1 && run.estimator.estimate().vel_B_mps.norm() < 0.05);
}

#[test]
fn prop_level_is_found_on_a_slope() {
    let mut run = Run::new(quiet(), Truth::hover(Vector3::new(3.0, 6.0, -0.05)));
    let tilted = UnitQuaternion::from_euler_angles(0.1, -0.15, 0.4);
    run.estimator.set_initial_heading(0.4, 0.05);
    for _ in 0..500 {
        run.truth.t_s += 0.004;
        let mut imu = run.truth.imu();
        imu.rate_B_radps = Vec3::zero();
        imu.acc_B_mps2 =
            Vec3::from_raw(tilted.inverse_transform_vector(&Vector3::new(0.0, 0.0, -G_MPS2)));
        run.estimator.imu(&imu);
        run.ring(|_| {});
    }
    let [roll, pitch, yaw] = run.estimator.estimate().R_EB.euler_rad();
    assert!((roll - 0.1).abs() < 0.01 && (pitch + 0.15).abs() < 0.01 && (yaw - 0.4).abs() < 0.02);
}

#[test]
fn regress_a_gate_does_not_lock_itself_out() {
    // Five metres wrong and sure of itself: every good measurement looks wild.
    let wrong = |gate: GateConfig| {
        let mut run = Run::aligned(EstimatorConfig { gate, ..quiet() }, Truth::flying(middle()));
        let state = run.estimator.state.as_mut().unwrap();
        state.restart_position(middle() + Vector3::new(-4.0, 3.0, 0.5), 0.05);
        run.fly(5.0);
        run
    };
    for tail in [Tail::Gaussian, Tail::Huber, Tail::StudentT] {
        let run = wrong(GateConfig { tail, ..GateConfig::default() });
        assert!(run.error_m() < 0.3, "{tail:?}: {}", run.error_m());
        assert!(run.estimator.counts().remedies > 0);
        assert_eq!(run.estimator.estimate().health, Health::Good);
    }
    // Without the way back it does lock itself out: the test can fail.
    let run = wrong(GateConfig { recover: false, tail: Tail::Gaussian, ..GateConfig::default() });
    assert!(run.error_m() > 1.0, "{}", run.error_m());
}

#[test]
fn prop_finds_itself_in_the_air() {
    let mut run = Run::aligned(quiet(), Truth::flying(middle()));
    run.fly(1.0);
    run.estimator.state.as_mut().unwrap().restart_position(Vector3::new(0.0, 0.0, -6.0), 0.1);
    assert!(run.estimator.realign());
    assert!(run.error_m() < 0.5, "{}", run.error_m());
    run.fly(3.0);
    assert!(run.error_m() < 0.1, "{}", run.error_m());
}

#[test]
fn prop_one_blocked_anchor_does_not_carry_it_away() {
    let mut run = Run::aligned(quiet(), Truth::flying(middle()));
    run.fly(2.0);
    run.fly_spoiled(3.0, |t| {
        t.distance_diff_m += if t.anchor_b.0 == 2 { 1.5 } else { 0.0 };
        t.distance_diff_m -= if t.anchor_a.0 == 2 { 1.5 } else { 0.0 };
    });
    assert!(run.error_m() < 0.3, "{}", run.error_m());
    assert!(run.estimator.counts().tdoa_gated > 0);
}

#[test]
fn prop_absurd_input_is_refused_and_counted() {
    let mut run = Run::aligned(quiet(), Truth::flying(middle()));
    run.fly(1.0);
    let before = run.estimator.state.clone();
    let good = run.truth.tdoa(&run.survey, 0, 1);
    let refused = |run: &mut Run, tdoa: Tdoa, reason: DropReason| {
        let count = run.estimator.drops().count(reason);
        assert!(!run.estimator.tdoa(&tdoa).fused);
        assert_eq!(run.estimator.drops().count(reason), count + 1, "{reason:?}");
    };
    refused(&mut run, Tdoa { distance_diff_m: f64::NAN, ..good }, DropReason::BadValue);
    refused(&mut run, Tdoa { distance_diff_m: 160.0, ..good }, DropReason::UwbImpossible);
    refused(&mut run, Tdoa { anchor_a: AnchorId(77), ..good }, DropReason::UwbUnknownAnchor);
    refused(&mut run, Tdoa { anchor_b: good.anchor_a, ..good }, DropReason::BadValue);
    let old = good.valid_at.offset_us(-1_000_000);
    refused(&mut run, Tdoa { valid_at: old, ..good }, DropReason::UwbTooOld);
    let imu = run.truth.imu();
    for (acc, rate) in [(f64::NAN, 0.0), (0.0, f64::INFINITY), (1e9, 0.0), (0.0, 1e9)] {
        let mut bad = imu;
        bad.valid_at = imu.valid_at.offset_us(4000);
        bad.acc_B_mps2 = Vec3::new(acc, 0.0, -9.8);
        bad.rate_B_radps = Vec3::new(0.0, rate, 0.0);
        run.estimator.imu(&bad);
    }
    run.estimator.imu(&imu); // the same stamp again
    assert_eq!(run.estimator.drops().count(DropReason::ImuOutOfOrder), 1);
    run.estimator.set_initial_heading(f64::NAN, 0.1);
    run.estimator.align_at(imu.valid_at, Vec3::new(f64::NAN, 0.0, 0.0), Rot::identity());
    assert_eq!(run.estimator.state, before, "nothing of this may leave a trace");
}

#[test]
fn prop_a_gap_in_the_imu_widens_and_heals() {
    let mut run = Run::aligned(quiet(), Truth::flying(middle()));
    run.fly(2.0);
    let before = run.estimator.estimate().std_pos_E_m.norm();
    for _ in 0..100 {
        run.truth.advance(0.004);
    }
    run.estimator.imu(&run.truth.imu());
    assert!(run.estimator.estimate().std_pos_E_m.norm() > 2.0 * before);
    run.fly(2.0);
    assert!(run.error_m() < 0.1, "{}", run.error_m());
}

#[test]
fn prop_health_follows_the_age_of_the_uwb() {
    let mut run = Run::aligned(quiet(), Truth::flying(middle()));
    run.fly(1.0);
    let mut seen = vec![];
    for _ in 0..1000 {
        run.truth.advance(0.004);
        run.estimator.imu(&run.truth.imu());
        let health = run.estimator.estimate().health;
        if seen.last() != Some(&health) {
            seen.push(health);
        }
    }
    assert_eq!(seen, [Health::Good, Health::Degraded, Health::Lost]);
    // It settles before it is good again.
    run.fly(3.0);
    assert_eq!(run.estimator.estimate().health, Health::Degraded);
    run.fly(2.5);
    assert_eq!(run.estimator.estimate().health, Health::Good);
}

#[test]
fn prop_heading_is_seen_in_motion_only() {
    let after = |mut truth: Truth| {
        truth.yaw_rad = 0.4;
        let mut run = Run::new(EstimatorConfig { cop_z_m: 0.0, ..quiet() }, truth);
        run.estimator.set_airborne(true);
        run.estimator.set_initial_heading(0.4, 0.4);
        let (pos_E_m, R_EB) = run.truth.pose();
        let wrong = Rot::from_raw(UnitQuaternion::from_euler_angles(0.0, 0.0, 0.3) * R_EB.raw());
        run.estimator.align_at(run.truth.at(), pos_E_m, wrong);
        run.fly(12.0);
        let std = run.estimator.estimate().std_att_B_rad.z();
        (run.yaw_error_rad().abs(), std)
    };
    let (moving, std_moving) = after(Truth::flying(middle()));
    let (hovering, std_hovering) = after(Truth::hover(middle()));
    assert!(moving < 0.06, "{moving}");
    assert!(std_moving < 0.1, "{std_moving}");
    // In hover the heading wanders with the noise; the filter must not claim to see it.
    assert!(std_hovering > 4.0 * std_moving, "{std_hovering}");
    assert!(hovering < 3.0 * std_hovering, "{hovering}");
}

#[test]
fn prop_a_tag_away_from_the_centre_is_accounted_for() {
    let mut truth = Truth::flying(middle());
    truth.p_BT_B = Vector3::new(0.1, -0.05, -0.3);
    let error = |p_BT_B_m| {
        let config = EstimatorConfig { p_BT_B_m, cop_z_m: 0.0, ..quiet() };
        let mut run = Run::aligned(config, truth.clone());
        run.fly(4.0);
        run.error_m()
    };
    assert!(error([0.1, -0.05, -0.3]) < 0.08);
    assert!(error([0.0; 3]) > 0.2);
}

#[test]
fn prop_late_measurements_count_for_when_they_were_true() {
    // Straight flight at 2 m/s; every TDOA comes 80 ms after it was true.
    let error = |honest: bool| {
        let mut truth = Truth::hover(Vector3::new(1.0, 5.0, -2.0));
        truth.yaw_rad = 0.0;
        truth.v_B = Vector3::new(2.0, 0.0, 0.0);
        let config = EstimatorConfig { drag: false, ..quiet() };
        let mut run = Run::aligned(config, truth);
        run.estimator.state.as_mut().unwrap().v_B = Vector3::new(2.0, 0.0, 0.0);
        let mut waiting = std::collections::VecDeque::new();
        for step in 0..750usize {
            run.truth.advance(0.004);
            run.estimator.imu(&run.truth.imu());
            let a = (step % 8) as u8;
            waiting.push_back(run.truth.tdoa(&run.survey, a, (a + 1) % 8));
            if waiting.len() > 20 {
                let mut tdoa = waiting.pop_front().unwrap();
                if !honest {
                    tdoa.valid_at = run.truth.at();
                }
                run.estimator.tdoa(&tdoa);
            }
        }
        run.error_m()
    };
    assert!(error(true) < 0.03, "{}", error(true));
    assert!(error(false) > 0.1, "{}", error(false));
}

#[test]
fn prop_barometer_helps_height_and_reference_is_fused_only_if_asked() {
    let mut run = Run::new(quiet(), Truth::hover(Vector3::new(5.0, 5.0, -1.0)));
    run.estimator.set_initial_heading(0.4, 0.05);
    run.rest(2.0);
    let baro = |run: &Run, height_m: f64| BaroSample {
        valid_at: run.truth.at(),
        received_at: run.truth.at(),
        pressure_pa: standard_pressure_pa(181.0 + height_m),
    };
    run.estimator.baro(&baro(&run, 1.0));
    run.estimator.set_airborne(true);
    let variance = |run: &Run| run.estimator.state.as_ref().unwrap().P[(2, 2)];
    let before = variance(&run);
    run.estimator.baro(&baro(&run, 1.0));
    assert!(variance(&run) < before);
    run.estimator.baro(&BaroSample { pressure_pa: f64::NAN, ..baro(&run, 1.0) });
    assert_eq!(run.estimator.drops().count(DropReason::BadValue), 1);

    let pose = ReferencePose {
        valid_at: run.truth.at(),
        received_at: run.truth.at(),
        pos_E_m: Vec3::new(5.0, 5.5, -1.0),
        attitude: None,
    };
    let before = run.estimator.state.clone();
    run.estimator.reference(&pose);
    assert_eq!(run.estimator.state, before);
    run.estimator.config.fuse_reference = true;
    for _ in 0..200 {
        run.estimator.reference(&pose);
    }
    assert!((run.estimator.estimate().pos_E_m - pose.pos_E_m).norm() < 0.05);
}

#[test]
fn prop_same_input_same_bits() {
    let run = || {
        let mut run = Run::aligned(quiet(), Truth::flying(middle()));
        run.fly(3.0);
        run.estimator.state.unwrap()
    };
    assert_eq!(run(), run());
}
