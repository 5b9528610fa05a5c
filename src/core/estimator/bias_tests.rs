//! The biases' blocks against the whole matrix, and what they are for.

use nalgebra::{DMatrix, DVector, Vector3};

use super::bias::{Biases, MOST_ANCHORS, Pair, Wander};
use super::bias_level::BiasLevel;
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
    level_s: 0.0,
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
                hidden_std_m: near_floor.then_some(CONFIG.hidden_std_m),
                anchors_m: &heights_m,
                factors: &factors,
                levels: &[1.0; MOST_ANCHORS],
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
                hidden_std_m: None,
                anchors_m: &[],
                factors: &[],
                levels: &[1.0; MOST_ANCHORS],
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

/// Mean factor that is learned where the biases wander by this, m, and are said to wander by 0.2 m.
fn learned_level(wanders_m: f64, seed: u64) -> f64 {
    const STEP_S: f64 = 0.02;
    const RING: u32 = 8;
    let config = AnchorBias { level_s: 7.0, constant_std_m: 0.0, ..CONFIG };
    let mut noise = Noise(seed);
    let mut state = start(false);
    state.biases = Biases::new(&config, &heights_m(), false);
    state.q_EB = nalgebra::UnitQuaternion::identity();
    state.v_B = Vector3::zeros();
    state.restart_velocity(Vector3::zeros(), 1e-6);
    state.restart_attitude(1e-9);
    state.restart_position(state.x_E, 1e-6);
    let keeps = (-STEP_S / config.correlation_s).exp();
    let mut truth_m = [(); 8].map(|()| wanders_m * noise.normal());
    let mut level = BiasLevel::default();
    let (mut sum, mut count) = (0.0, 0.0);
    for step in 0..20_000u32 {
        for bias_m in &mut truth_m {
            *bias_m = *bias_m * keeps + wanders_m * (1.0 - keeps * keeps).sqrt() * noise.normal();
        }
        let levels = level.factors();
        let wander = Wander {
            dt_s: STEP_S,
            speed_mps: 0.0,
            hidden_std_m: None,
            anchors_m: &heights_m(),
            factors: &[],
            levels: &levels,
            left_out: &[false; MOST_ANCHORS],
        };
        let still = (Vector3::new(0.0, 0.0, -9.80665), Vector3::zeros());
        let F = linearise(&state, STEP_S, &still.0, &still.1, Force::Measured);
        state.biases.propagate(&F, &config, &wander);
        level.learn(&state.biases, &config, &wander);
        let (a, b) = ((step % RING) as usize, ((step + 1 + step / RING % 6) % RING) as usize);
        if a != b {
            let g = geometry(a as u8, b as u8, Vector3::zeros(), 0.0);
            let distance = |from: Vector3<f64>| (state.x_E - from).norm();
            let measured = distance(g.b_E) + truth_m[b] - distance(g.a_E) - truth_m[a];
            let measured = measured + 0.05 * noise.normal();
            let o = tdoa::observe(&state, &g, measured, Some(Pair { a, b }), 0.05 * 0.05).unwrap();
            update::fuse(&mut state, &o);
        }
        if step > 5000 {
            sum += level.factors()[..8].iter().sum::<f64>() / 8.0;
            count += 1.0;
        }
    }
    sum / count
}

#[test]
fn prop_how_much_biases_wander_is_learned_from_above_and_from_below() {
    for (wanders_m, seed) in [(0.1, 1), (0.2, 2), (0.35, 3)] {
        let (found, expected) = (learned_level(wanders_m, seed), (wanders_m / 0.2f64).powi(2));
        println!("{wanders_m} m: factor {found:.2}, true {expected:.2}");
        assert!((0.6..1.5).contains(&(found / expected)), "{wanders_m}: {found} {expected}");
    }
}

#[test]
fn prop_nothing_is_learned_where_the_floor_hides_anchors_from_one_left_out_or_if_not_asked() {
    let mut state = start(false);
    state.biases.set_hidden(&AnchorBias { low_anchor_m: 50.0, ..CONFIG }, &heights_m(), 3.0);
    let mut left_out = [false; MOST_ANCHORS];
    left_out[1] = true;
    // What is found is 3 m where 0.2 m are expected; each has been measured.
    for (a, b) in (0..7).map(|a| (a, a + 1)) {
        let o = observe(&state, a, b, 0.0);
        update::fuse(&mut state, &o);
    }
    let learn = |level_s: f64, near_floor: bool| {
        let mut level = BiasLevel::default();
        let wander = Wander {
            dt_s: 0.02,
            speed_mps: 0.0,
            hidden_std_m: near_floor.then_some(CONFIG.hidden_std_m),
            anchors_m: &heights_m(),
            factors: &[],
            levels: &level.factors(),
            left_out: &left_out,
        };
        level.learn(&state.biases, &AnchorBias { level_s, ..CONFIG }, &wander);
        level.factors()
    };
    let learned = learn(7.0, false);
    assert!(learned[0] > 1.0 && learned[2] > 1.0, "{learned:?}");
    assert_eq!(learned[1], 1.0);
    assert_eq!(learn(7.0, true), [1.0; MOST_ANCHORS]);
    assert_eq!(learn(0.0, false), [1.0; MOST_ANCHORS]);
}
