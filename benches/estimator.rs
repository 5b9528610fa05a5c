//! Time of a prediction and of a TDOA update, best of many rounds: `cargo bench --bench estimator`.

use std::hint::black_box;
use std::time::Instant;

use haltere_core::estimator::{AnchorBias, Estimator, EstimatorConfig, GateConfig, Quality};
use haltere_core::frames::{G_MPS2, Rot, Vec3};
use haltere_core::measure::{AnchorId, ImuSample, Tdoa};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;

/// Rounds of which the fastest counts: the machine is shared.
const ROUNDS: usize = 200;
/// Calls per round.
const CALLS: u64 = 2000;

fn hall() -> Survey {
    let anchors: Vec<_> = (0..8u8)
        .map(|i| {
            let far = |bit: u8, size: f64| if i & bit != 0 { size } else { 0.0 };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
        })
        .collect();
    Survey::new(&anchors).expect("a hall can be flown in")
}

/// The same flight from the same start, round after round.
fn best_ns(start: &Estimator, mut fly: impl FnMut(&mut Estimator)) -> f64 {
    (0..ROUNDS)
        .map(|_| {
            let mut estimator = start.clone();
            let begin = Instant::now();
            fly(&mut estimator);
            begin.elapsed().as_nanos() as f64 / CALLS as f64
        })
        .fold(f64::INFINITY, f64::min)
}

fn main() {
    let survey = hall();
    let position = Vec3::new(4.0, 5.0, -1.5);
    let at = |step: u64| HostTime::from_us(1_000_000 + 4_000 * step);
    // Level hover, TDOA on the ring, some centimetres off.
    let imu = |step: u64| ImuSample {
        valid_at: at(step),
        received_at: at(step),
        acc_B_mps2: Vec3::new(0.3, -0.2, -G_MPS2),
        rate_B_radps: Vec3::new(0.002, -0.001, 0.003),
    };
    let tdoas: Vec<Tdoa> = (0..8u8)
        .map(|a| {
            let b = (a + 1) % 8;
            let distance = |id| {
                survey.position_E_m(AnchorId(id)).map_or(0.0, |anchor| (position - anchor).norm())
            };
            Tdoa {
                valid_at: at(0),
                received_at: at(0),
                anchor_a: AnchorId(a),
                anchor_b: AnchorId(b),
                distance_diff_m: distance(b) - distance(a) + if a % 2 == 0 { 0.05 } else { -0.05 },
                std_m: None,
            }
        })
        .collect();
    let tdoa = |step: u64, turn: u64| Tdoa {
        valid_at: at(step),
        received_at: at(step),
        ..tdoas[(turn % 8) as usize]
    };

    let robust = EstimatorConfig {
        anchor_bias: AnchorBias { estimate: true, ..AnchorBias::default() },
        quality: Quality { learn: true, ..Quality::default() },
        covariance_step_s: 0.01,
        gate: GateConfig { reject: false, ..GateConfig::default() },
        ..EstimatorConfig::default()
    };
    for (name, config) in [("nine states", EstimatorConfig::default()), ("with 8 biases", robust)] {
        run(name, config, &survey, position, at, imu, &tdoa);
    }
}

/// Times one filter.
fn run(
    name: &str,
    config: EstimatorConfig,
    survey: &Survey,
    position: Vec3<haltere_core::frames::E>,
    at: impl Fn(u64) -> HostTime,
    imu: impl Fn(u64) -> ImuSample,
    tdoa: &impl Fn(u64, u64) -> Tdoa,
) {
    let mut start = Estimator::new(config, survey.clone());
    start.set_airborne(true);
    start.align_at(at(0), position, Rot::from_euler_rad(0.0, 0.0, 0.4));
    start.imu(&imu(1));

    let predict_ns = best_ns(&start, |estimator| {
        for step in 0..CALLS {
            estimator.imu(black_box(&imu(step + 2)));
        }
    });
    let mut fused = 0;
    let update_ns = best_ns(&start, |estimator| {
        for step in 0..CALLS {
            fused += u64::from(estimator.tdoa(black_box(&tdoa(1, step))).fused);
        }
    });
    let flight_ns = best_ns(&start, |estimator| {
        for step in 0..CALLS {
            estimator.imu(black_box(&imu(step + 2)));
            for turn in 0..2 {
                fused +=
                    u64::from(estimator.tdoa(black_box(&tdoa(step + 2, 2 * step + turn))).fused);
            }
        }
    });
    let share = fused as f64 / (ROUNDS as u64 * CALLS * 3) as f64;
    println!("estimator, {name}");
    println!("  predict                   {predict_ns:6.0} ns  (target 350)");
    println!("  TDOA update, state level  {update_ns:6.0} ns  (target 500)");
    println!("  predict and two updates   {flight_ns:6.0} ns  (fused {share:.3} of the TDOA)");
}
