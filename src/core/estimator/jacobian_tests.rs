//! Tests of every Jacobian against central differences, and of the covariance reset.

use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

use super::predict::{Force, Growth, predict, propagate_nominal};
use super::state::{ATT, Cov, POS, STATES, State, StateVec, VEL, reset_jacobian};
use super::truth::{Noise, geometry};
use super::update::Observation;
use super::{height, reference, tdoa, zero_velocity};

const FORCES: [Force; 3] = [
    Force::Measured,
    Force::ThrustAxis { k_per_s: [4.2, 1.8], cop_z_m: 0.03, beyond_B_mps2: [0.4, -0.2] },
    Force::ThrustAxis { k_per_s: [0.0, 0.0], cop_z_m: 0.0, beyond_B_mps2: [0.0; 2] },
];

fn random_state(noise: &mut Noise) -> State {
    let mut state = State::at_pose(
        noise.vector(2.0) + Vector3::new(4.0, 5.0, -2.0),
        UnitQuaternion::from_scaled_axis(noise.vector(0.8)),
        0.3,
        0.4,
        0.1,
    );
    state.v_B = noise.vector(1.5);
    // A full covariance: A Aᵀ plus the diagonal.
    let A = Cov::from_fn(|_, _| noise.normal() * 0.1);
    state.P += A * A.transpose();
    state
}

/// The state moved by an error, by the exact exponential.
fn moved(state: &State, error: &StateVec) -> State {
    let mut other = state.clone();
    other.x_E += error.fixed_rows::<3>(POS);
    other.v_B += error.fixed_rows::<3>(VEL);
    let d: Vector3<f64> = error.fixed_rows::<3>(ATT).into_owned();
    other.q_EB *= UnitQuaternion::from_scaled_axis(d);
    other
}

/// The error that leads from one state to another.
fn between(from: &State, to: &State) -> StateVec {
    let mut error = StateVec::zeros();
    error.fixed_rows_mut::<3>(POS).copy_from(&(to.x_E - from.x_E));
    error.fixed_rows_mut::<3>(VEL).copy_from(&(to.v_B - from.v_B));
    error.fixed_rows_mut::<3>(ATT).copy_from(&(from.q_EB.inverse() * to.q_EB).scaled_axis());
    error
}

fn unit(i: usize, size: f64) -> StateVec {
    let mut error = StateVec::zeros();
    error[i] = size;
    error
}

/// Central differences of a function of the state that returns a prediction.
fn numeric_row(state: &State, prediction: impl Fn(&State) -> f64) -> StateVec {
    let h = 1e-6;
    StateVec::from_fn(|i, _| {
        let plus = prediction(&moved(state, &unit(i, h)));
        let minus = prediction(&moved(state, &unit(i, -h)));
        (plus - minus) / (2.0 * h)
    })
}

fn row(o: &Observation) -> StateVec {
    let mut row = StateVec::zeros();
    row.fixed_rows_mut::<3>(POS).copy_from(&o.h_pos);
    row.fixed_rows_mut::<3>(VEL).copy_from(&o.h_vel);
    row.fixed_rows_mut::<3>(ATT).copy_from(&o.h_att);
    row
}

#[test]
fn prop_transition_is_the_derivative_of_the_prediction() {
    let mut noise = Noise(1);
    for case in 0..60 {
        let state = random_state(&mut noise);
        let (acc, rate) = (noise.vector(6.0), noise.vector(3.0));
        let force = FORCES[case % 3];
        let dt_s = 0.001 + 0.019 * noise.uniform();
        let step = |s: &State| {
            let mut s = s.clone();
            propagate_nominal(&mut s, dt_s, &acc, &rate, force);
            s
        };
        let mut nominal = state.clone();
        let T = propagate_nominal(&mut nominal, dt_s, &acc, &rate, force);
        let mut F = SMatrix::<f64, STATES, STATES>::identity();
        F.fixed_view_mut::<3, 3>(POS, VEL).copy_from(&T.xv);
        F.fixed_view_mut::<3, 3>(POS, ATT).copy_from(&T.xd);
        F.fixed_view_mut::<3, 3>(VEL, VEL).copy_from(&T.vv);
        F.fixed_view_mut::<3, 3>(VEL, ATT).copy_from(&T.vd);
        F.fixed_view_mut::<3, 3>(ATT, ATT).copy_from(&T.dd);
        let h = 1e-6;
        for i in 0..STATES {
            let plus = between(&nominal, &step(&moved(&state, &unit(i, h))));
            let minus = between(&nominal, &step(&moved(&state, &unit(i, -h))));
            let numeric = (plus - minus) / (2.0 * h);
            let off = (numeric - F.column(i)).amax();
            assert!(off < 1e-7, "case {case} column {i}: off by {off}");
        }
        // The block-wise product is the product.
        let growth = Growth { pos: 0.1, vel: [0.2, 0.3, 0.4], att: 0.5 };
        let mut predicted = state.clone();
        predict(&mut predicted, dt_s, &acc, &rate, force, &growth);
        let mut whole = F * state.P * F.transpose();
        for i in 0..3 {
            whole[(POS + i, POS + i)] += growth.pos * dt_s;
            whole[(VEL + i, VEL + i)] += growth.vel[i] * dt_s;
            whole[(ATT + i, ATT + i)] += growth.att * dt_s;
        }
        assert!((predicted.P - whole).amax() < 1e-12);
        assert_eq!(predicted.P, predicted.P.transpose());
    }
}

#[test]
fn prop_tdoa_row_is_the_derivative_of_its_prediction() {
    let mut noise = Noise(2);
    for case in 0..100 {
        let state = random_state(&mut noise);
        let arm = if case % 2 == 0 { Vector3::zeros() } else { noise.vector(0.1) };
        let ahead_s = if case % 3 == 0 { 0.0 } else { 0.02 * noise.normal() };
        let g = geometry((case % 8) as u8, ((case + 3) % 8) as u8, arm, ahead_s);
        let o = tdoa::observe(&state, &g, 0.0, None, 1.0).unwrap();
        // Innovation is measured minus predicted, so with 0 measured the prediction is its negative.
        let numeric =
            numeric_row(&state, |s| -tdoa::observe(s, &g, 0.0, None, 1.0).unwrap().innovation);
        assert!((numeric - row(&o)).amax() < 1e-7, "case {case}");
    }
}

#[test]
fn prop_other_rows_are_the_derivatives_of_their_predictions() {
    let mut noise = Noise(3);
    let mut zero = height::BaroZero::default();
    zero.learn(181.0, 0.2);
    for _ in 0..30 {
        let state = random_state(&mut noise);
        for axis in 0..3 {
            let numeric = numeric_row(&state, |s| -zero_velocity::observe(s, axis).innovation);
            assert!((numeric - row(&zero_velocity::observe(&state, axis))).amax() < 1e-8);
            let numeric =
                numeric_row(&state, |s| -reference::observe(s, axis, 0.0, 1.0).innovation);
            assert!((numeric - row(&reference::observe(&state, axis, 0.0, 1.0))).amax() < 1e-8);
        }
        let numeric = numeric_row(&state, |s| -zero.observe(s, 180.8, 1.0).innovation);
        assert!((numeric - row(&zero.observe(&state, 180.8, 1.0))).amax() < 1e-8);
    }
}

#[test]
fn prop_on_top_of_an_anchor_there_is_no_direction() {
    let mut state = random_state(&mut Noise(4));
    let g = geometry(2, 3, Vector3::zeros(), 0.0);
    state.x_E = g.a_E;
    assert!(tdoa::observe(&state, &g, 1.0, None, 1.0).is_none());
    state.x_E = g.b_E + Vector3::new(0.01, 0.0, 0.0);
    assert!(tdoa::observe(&state, &g, 1.0, None, 1.0).is_none());
}

#[test]
fn val_reset_jacobian_against_the_exact_group() {
    // d' = log(exp(−d̂) exp(d)) for d near d̂, differentiated numerically.
    let mut noise = Noise(5);
    for _ in 0..50 {
        let d_hat = noise.vector(0.05);
        let back = UnitQuaternion::from_scaled_axis(d_hat).inverse();
        let left =
            |e: Vector3<f64>| (back * UnitQuaternion::from_scaled_axis(d_hat + e)).scaled_axis();
        let h = 1e-6;
        let mut exact = Matrix3::zeros();
        for i in 0..3 {
            let mut e = Vector3::zeros();
            e[i] = h;
            exact.set_column(i, &((left(e) - left(-e)) / (2.0 * h)));
        }
        let third = d_hat.norm().powi(3) / 24.0;
        assert!((reset_jacobian(&d_hat) - exact).amax() < third * 1.5 + 1e-9);
    }
}

#[test]
fn val_injection_turns_the_covariance_like_sampled_errors() {
    // Sample true attitudes around an estimate, inject a correction, and compare the covariance of
    // the errors that are left with what the filter says.
    let mut noise = Noise(6);
    let mut state = State::at_pose(Vector3::zeros(), UnitQuaternion::identity(), 0.1, 0.1, 1e-3);
    for (i, std) in [1e-3, 2e-3, 4e-3].into_iter().enumerate() {
        state.P[(ATT + i, ATT + i)] = std * std;
    }
    let d_hat = Vector3::new(0.10, -0.25, 0.15);
    let mut delta = StateVec::zeros();
    delta.fixed_rows_mut::<3>(ATT).copy_from(&d_hat);
    let mut after = state.clone();
    after.inject(&delta);
    let n = 40_000;
    let mut sampled = Matrix3::zeros();
    for _ in 0..n {
        let e = Vector3::new(1e-3, 2e-3, 4e-3).component_mul(&noise.vector(1.0));
        let truth = state.q_EB * UnitQuaternion::from_scaled_axis(d_hat + e);
        let left = (after.q_EB.inverse() * truth).scaled_axis();
        sampled += left * left.transpose() / f64::from(n);
    }
    let said: Matrix3<f64> = after.P.fixed_view::<3, 3>(ATT, ATT).into_owned();
    let uncorrected: Matrix3<f64> = state.P.fixed_view::<3, 3>(ATT, ATT).into_owned();
    let scale = sampled.amax();
    assert!((said - sampled).amax() < 0.02 * scale, "{said}{sampled}");
    // The correction is what makes it so.
    assert!((uncorrected - sampled).amax() > 0.03 * scale);
}

#[test]
fn prop_mirrored_flights_are_mirrored() {
    // Mirror in the x-z plane: y of vectors, x and z of axial vectors change sign.
    let polar = |v: Vector3<f64>| Vector3::new(v.x, -v.y, v.z);
    let axial = |v: Vector3<f64>| Vector3::new(-v.x, v.y, -v.z);
    let mut noise = Noise(7);
    let growth = Growth { pos: 0.0, vel: [1.0; 3], att: 0.01 };
    for case in 0..30 {
        let start = random_state(&mut noise);
        let (acc, rate) = (noise.vector(5.0), noise.vector(2.0));
        let mut signs = StateVec::repeat(1.0);
        for i in [POS + 1, VEL + 1, ATT, ATT + 2] {
            signs[i] = -1.0;
        }
        let mirror = |s: &State| State {
            x_E: polar(s.x_E),
            v_B: polar(s.v_B),
            q_EB: UnitQuaternion::from_scaled_axis(axial(s.q_EB.scaled_axis())),
            P: Cov::from_fn(|i, j| s.P[(i, j)] * signs[i] * signs[j]),
            biases: s.biases.clone(),
        };
        let mut left = start.clone();
        let mut right = mirror(&start);
        let force = FORCES[case % 3];
        predict(&mut left, 0.01, &acc, &rate, force, &growth);
        let mirrored = match force {
            Force::ThrustAxis { k_per_s, cop_z_m, beyond_B_mps2: [x, y] } => {
                Force::ThrustAxis { k_per_s, cop_z_m, beyond_B_mps2: [x, -y] }
            }
            Force::Measured => force,
        };
        predict(&mut right, 0.01, &polar(acc), &axial(rate), mirrored, &growth);
        let expected = mirror(&left);
        assert!(between(&expected, &right).amax() < 1e-12);
        assert!((expected.P - right.P).amax() < 1e-12);
    }
}
