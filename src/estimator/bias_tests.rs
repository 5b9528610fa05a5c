//! The biases' blocks against the whole matrix, and what they are for.

use nalgebra::{DMatrix, DVector, Vector3};

use super::bias::{Biases, MOST_ANCHORS, Pair, Wander};
use super::config::AnchorBias;
use super::predict::{Force, Growth, linearise, propagate_covariance, propagate_nominal};
use super::state::{ATT, POS, STATES, State, VEL};
use super::truth::{Noise, geometry, hall};
use super::update::Observation;
use super::{tdoa, update};

const CONFIG: AnchorBias = AnchorBias {
    estimate: true,
    std_m: 0.2,
    correlation_s: 8.0,
    correlation_m: 0.6,
    constant_std_m: 0.1,
    hidden_std_m: 2.5,
    hidden_s: 0.5,
    hidden_below_m: 0.5,
    low_anchor_m: 0.6,
};

fn heights_m() -> Vec<f64> {
    let survey = hall();
    survey.ids().iter().filter_map(|id| survey.position_E_m(*id)).map(|p| -p.z()).collect()
}

fn start(near_floor: bool) -> State {
    let q = nalgebra::UnitQuaternion::from_euler_angles(0.1, -0.2, 0.7);
    let mut state = State::at_pose(Vector3::new(3.0, 4.0, -2.0), q, 0.5, 0.4, 0.1);
    state.v_B = Vector3::new(0.7, -0.3, 0.1);
    state.biases = Biases::new(&CONFIG, &heights_m(), near_floor);
    state
}

fn observe(state: &State, a: u8, b: u8, innovation: f64) -> Observation {
    let pair = Some(Pair { a: usize::from(a), b: usize::from(b) });
    let g = geometry(a, b, Vector3::new(0.02, 0.01, -0.1), 0.01);
    let mut o = tdoa::observe(state, &g, 0.0, pair, 0.02).unwrap();
    o.innovation = innovation;
    o
}

/// The row of the whole Jacobian.
fn row(o: &Observation, size: usize) -> DVector<f64> {
    let mut h = DVector::zeros(size);
    h.rows_mut(POS, 3).copy_from(&o.h_pos);
    h.rows_mut(VEL, 3).copy_from(&o.h_vel);
    h.rows_mut(ATT, 3).copy_from(&o.h_att);
    let n = heights_m().len();
    if let Some(Pair { a, b }) = o.pair {
        for (i, sign) in [(b, 1.0), (n + b, 1.0), (a, -1.0), (n + a, -1.0)] {
            h[STATES + i] += sign;
        }
    }
    h
}

#[test]
fn prop_blocks_are_the_whole_matrix() {
    let mut noise = Noise(11);
    let heights_m = heights_m();
    let factors = [1.0, 2.0, 0.5, 1.0, 3.0, 1.0, 1.0, 10.0];
    let mut left_out = [false; MOST_ANCHORS];
    for (near_floor, out, gyro) in
        [(false, false, false), (true, false, false), (false, true, false), (false, false, true)]
    {
        left_out[5] = out;
        let mut state = start(near_floor);
        if gyro {
            state.biases.restart_gyro(0.02);
        }
        for step in 0..200u32 {
            let (a, b) = ((step % 8) as u8, ((step * 3 + 1) % 8) as u8);
            if a == b {
                continue;
            }
            // An update, without the turn of the attitude that follows it: no innovation.
            let whole = state.biases.whole(&state.P);
            let o = observe(&state, a, b, 0.0);
            let h = row(&o, whole.nrows());
            let s = (h.transpose() * &whole * &h)[0] + o.var;
            let pht = &whole * &h;
            let expected = &whole - &pht * pht.transpose() / s;
            let projected = update::project(&state, &o);
            assert!((projected.var_predicted + o.var - s).abs() < 1e-9);
            update::fuse(&mut state, &o);
            assert!((state.biases.whole(&state.P) - expected).amax() < 1e-9);

            // A prediction.
            let whole = state.biases.whole(&state.P);
            let (acc, rate) = (noise.vector(3.0), noise.vector(1.0));
            let force = Force::ThrustAxis {
                k_per_s: [4.2, 1.8],
                cop_z_m: 0.03,
                beyond_B_mps2: [0.4, -0.2],
            };
            let F = linearise(&state, 0.01, &acc, &rate, force);
            let growth = Growth { pos: 1e-4, vel: [0.4; 3], att: 1e-4 };
            let wander = Wander {
                dt_s: 0.01,
                speed_mps: 0.8,
                near_floor,
                anchors_m: &heights_m,
                factors: &factors,
                left_out: &left_out,
            };
            let mut big = DMatrix::identity(whole.nrows(), whole.nrows());
            for (r, c, block) in [
                (POS, VEL, F.xv),
                (POS, ATT, F.xd),
                (VEL, VEL, F.vv),
                (VEL, ATT, F.vd),
                (ATT, ATT, F.dd),
            ] {
                big.view_mut((r, c), (3, 3)).copy_from(&block);
            }
            let usual = f64::exp(-0.01 * (1.0 / 8.0 + 0.8 / 0.6));
            let quick = f64::exp(-0.01 / 0.5);
            let mut grown = DVector::zeros(whole.nrows());
            for i in 0..8 {
                let low = heights_m[i] < CONFIG.low_anchor_m;
                let was = whole[(STATES + i, STATES + i)] > 4.0 * 0.04;
                let (phi, q) = match (near_floor && low, was) {
                    // One sigma of 3 m, whatever else holds.
                    _ if left_out[i] => (quick, 9.0 * (1.0 - quick * quick)),
                    (true, _) => (quick, 6.25 * (1.0 - quick * quick)),
                    (false, true) => (quick.min(usual), 0.04 * factors[i] * (1.0 - usual * usual)),
                    (false, false) => (usual, 0.04 * factors[i] * (1.0 - usual * usual)),
                };
                big[(STATES + i, STATES + i)] = phi;
                grown[STATES + i] = q;
            }
            for i in 0..3 {
                grown[POS + i] = growth.pos * 0.01;
                grown[VEL + i] = growth.vel[i] * 0.01;
                grown[ATT + i] = growth.att * 0.01;
            }
            for k in (0..3).filter(|_| gyro) {
                big[(ATT + k, whole.nrows() - 3 + k)] = -0.01;
                grown[whole.nrows() - 3 + k] = 0.003 * 0.003 * 0.01;
            }
            let expected = &big * &whole * big.transpose() + DMatrix::from_diagonal(&grown);
            state.biases.propagate(&F, &CONFIG, &wander);
            propagate_covariance(&mut state.P, &F, 0.01, &growth);
            state.biases.turn_by_gyro(&mut state.P, 0.01, 0.003);
            let off = (state.biases.whole(&state.P) - expected).amax();
            assert!(off < 1e-7, "step {step}: {off}");
        }
        assert!(state.biases.asymmetry() < 1e-12, "{}", state.biases.asymmetry());
        assert!(state.biases.whole(&state.P).symmetric_eigenvalues().min() > -1e-9);
    }
}

#[test]
fn prop_an_anchor_that_is_off_is_found_out() {
    let off_m = 0.35;
    let settle = |estimate: bool| {
        let mut state = start(false);
        state.biases = Biases::new(&AnchorBias { estimate, ..CONFIG }, &heights_m(), false);
        state.q_EB = nalgebra::UnitQuaternion::identity();
        state.v_B = Vector3::zeros();
        state.restart_velocity(Vector3::zeros(), 0.01);
        state.restart_attitude(1e-6);
        let truth = state.x_E;
        for step in 0..4000u32 {
            let (a, b) = ((step % 8) as u8, ((step + 1 + step / 8 % 6) % 8) as u8);
            let pair = Pair { a: usize::from(a), b: usize::from(b) };
            let g = geometry(a, b, Vector3::zeros(), 0.0);
            let distance = |from: Vector3<f64>| (truth - from).norm();
            let bias = |anchor: u8| if anchor == 5 { off_m } else { 0.0 };
            let measured = distance(g.b_E) + bias(b) - distance(g.a_E) - bias(a);
            if a != b {
                let o = tdoa::observe(&state, &g, measured, Some(pair), 0.01).unwrap();
                update::fuse(&mut state, &o);
            }
        }
        (state.biases, (state.x_E - truth).norm())
    };
    let (_, without_m) = settle(false);
    let (biases, with_m) = settle(true);
    // The mean of all is at its prior; where the tag stands still, part of it stays in the position.
    let (five, std) = biases.of(5).unwrap();
    let others = (0..8).filter(|i| *i != 5).map(|i| biases.of(i).unwrap().0).sum::<f64>() / 7.0;
    assert!(five - others > 0.6 * off_m && std < 0.2, "{five} {others} {std}");
    println!("{with_m:.3} m with biases, {without_m:.3} m without");
    assert!(with_m < without_m);
}

#[test]
fn prop_a_gyroscope_that_is_off_is_found_out_where_the_attitude_is_seen() {
    // A vehicle that does not turn, a gyroscope that says it does, and something that shows the attitude.
    let off_B = Vector3::new(0.004, -0.003, 0.008);
    let fly = |estimate: bool| {
        let mut state = start(false);
        state.biases = Biases::default();
        if estimate {
            state.biases.restart_gyro(0.01);
        }
        state.q_EB = nalgebra::UnitQuaternion::identity();
        let growth = Growth { pos: 0.0, vel: [1e-4; 3], att: 1e-6 };
        for step in 0..6000 {
            let (rate, acc) =
                (off_B - state.biases.gyro_B_radps(), Vector3::new(0.0, 0.0, -9.80665));
            let F = propagate_nominal(&mut state, 0.01, &acc, &rate, Force::Measured);
            let still = Wander {
                dt_s: 0.01,
                speed_mps: 0.0,
                near_floor: false,
                anchors_m: &[],
                factors: &[],
                left_out: &[false; MOST_ANCHORS],
            };
            state.biases.propagate(&F, &CONFIG, &still);
            propagate_covariance(&mut state.P, &F, 0.01, &growth);
            state.biases.turn_by_gyro(&mut state.P, 0.01, 1e-4);
            if step % 5 == 0 {
                // The true attitude is the identity: what the estimate is away from it is the innovation.
                let away = -state.q_EB.scaled_axis();
                for k in 0..3 {
                    let h_att = Vector3::ith(k, 1.0);
                    let none = Vector3::zeros();
                    let (innovation, var) = (away[k], 0.05 * 0.05);
                    let o = Observation {
                        innovation,
                        h_pos: none,
                        h_vel: none,
                        h_att,
                        pair: None,
                        var,
                    };
                    update::fuse(&mut state, &o);
                }
            }
        }
        (state.biases.gyro_B_radps(), state.q_EB.angle())
    };
    let (found_B, with_rad) = fly(true);
    let (_, without_rad) = fly(false);
    assert!((found_B - off_B).norm() < 0.1 * off_B.norm(), "{found_B} of {off_B}");
    assert!(with_rad < 0.2 * without_rad, "{with_rad} rad with it, {without_rad} without");
}
