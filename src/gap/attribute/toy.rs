//! A made-up world for tests: correlated statistics, curved, collinear, sparse and one-sided
//! effects, effects with a place, pairs, unknown effects, and a foreign null.

use nalgebra::{DMatrix, DVector};

use crate::bank::axis::{Axis, Size as AxisSize};
use crate::bank::{Bank, Draw, EffectDraws};
use haltere_model::effects::Block;
use haltere_model::random::Stream;

/// Sizes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Size {
    pub statistics: usize,
    pub effects: usize,
    pub draws: usize,
    pub seeds: usize,
    pub jitter: usize,
}

/// The library of the issue.
pub(crate) const FULL: Size =
    Size { statistics: 200, effects: 53, draws: 40, seeds: 200, jitter: 300 };
/// Cheap enough for every test run.
pub(crate) const SMALL: Size =
    Size { statistics: 60, effects: 12, draws: 30, seeds: 80, jitter: 120 };

const BLOCKS: [Block; 5] =
    [Block::Thrust, Block::Aerodynamics, Block::Battery, Block::Imu, Block::Uwb];

struct Law {
    a: DVector<f64>,
    b: DVector<f64>,
    kind: usize,
}

/// The world.
pub(crate) struct Toy {
    pub size: Size,
    mix: DMatrix<f64>,
    jitter: DMatrix<f64>,
    units: DVector<f64>,
    laws: Vec<Law>,
    rng: Stream,
}

impl Toy {
    pub fn new(size: Size, seed: u64) -> Self {
        let mut rng = Stream::new(seed, "toy");
        let p = size.statistics;
        let mix = DMatrix::from_fn(p, p, |i, j| match i.cmp(&j) {
            std::cmp::Ordering::Equal => 0.6,
            _ if i.abs_diff(j) < 4 => 0.3 * rng.normal(),
            _ => 0.0,
        });
        // Benign changes: twelve constants, each moving many statistics a little.
        let jitter = DMatrix::from_fn(p, 12, |_, _| 0.45 * rng.normal());
        let units = DVector::from_fn(p, |_, _| 10f64.powf(rng.between(-3.0, 3.0)));
        // Known effects, then unknown ones.
        let mut laws: Vec<Law> = Vec::new();
        for e in 0..size.effects + size.effects / 3 {
            let own = (e * 7) % BLOCKS.len();
            let mut vector = |share: f64| {
                DVector::from_fn(p, |j, _| {
                    let inside = j * BLOCKS.len() / p == own;
                    let there = rng.uniform() < if inside { 2.0 * share } else { 0.4 * share };
                    if there { 2.2 * rng.normal() } else { 0.0 }
                })
            };
            let share = if e % 5 == 4 { 0.12 } else { 0.35 };
            let (mut a, b) = (vector(share), vector(share));
            if e % 9 == 8
                && let Some(twin) = laws.last()
            {
                // Nearly collinear with the one before.
                a = &twin.a * 0.9 + a * 0.25;
            }
            laws.push(Law { a, b, kind: e % 4 });
        }
        Self { size, mix, jitter, units, laws, rng }
    }

    pub fn blocks(&self) -> Vec<Block> {
        let p = self.size.statistics;
        (0..p).map(|j| BLOCKS[j * BLOCKS.len() / p]).collect()
    }

    fn noise(&mut self, jittered: bool) -> DVector<f64> {
        let p = self.size.statistics;
        let heavy = if self.rng.uniform() < 0.05 { 1.6 } else { 1.0 };
        let mut x = &self.mix * DVector::from_fn(p, |_, _| heavy * self.rng.normal());
        if jittered {
            x += &self.jitter * DVector::from_fn(12, |_, _| self.rng.between(-1.7, 1.7));
        }
        x
    }

    /// θ: amplitude of either sign (or positive), and a shape that matters or not.
    pub fn theta(&mut self, e: usize) -> Vec<f64> {
        let size = self.rng.between(0.35, 1.4);
        let sign = if self.rng.uniform() < 0.5 { -1.0 } else { 1.0 };
        match self.laws[e].kind {
            0 => vec![size],
            1 => vec![sign * size],
            2 => vec![size, self.rng.between(0.0, 7.0)],
            _ => vec![sign * size, self.rng.between(-1.0, 1.0)],
        }
    }

    /// What θ ranges over.
    fn axes(&self, e: usize) -> Vec<Axis> {
        let axis = |low, high, size| Axis { low, high, choice: false, size };
        let size = Some(AxisSize::From(0.0));
        let positive = axis(0.35, 1.4, size);
        let signed = axis(-1.4, 1.4, size);
        match self.laws[e].kind {
            0 => vec![positive],
            1 => vec![signed],
            2 => vec![positive, axis(0.0, 7.0, None)],
            _ => vec![signed, axis(-1.0, 1.0, None)],
        }
    }

    /// Mean of effect `e` at θ; `foreign` bends the law as another simulator would.
    fn signature(&self, e: usize, theta: &[f64], foreign: bool) -> DVector<f64> {
        let law = &self.laws[e];
        let t = if foreign { theta[0] * (1.0 + 0.15 * theta[0].abs()) } else { theta[0] };
        let mut x = match law.kind {
            0 => &law.a * t + &law.b * (0.4 * t * t),
            1 => &law.a * t + &law.b * (0.5 * t.abs()),
            2 => &law.a * t * (1.0 + 0.3 * (theta[1]).sin()) + &law.b * (0.3 * t),
            _ => &law.a * t + &law.b * (0.6 * theta[1] * t.abs()),
        };
        if foreign {
            for (j, v) in x.iter_mut().enumerate() {
                *v *= 1.0 + 0.12 * ((j * 31 + e * 17) as f64).sin();
            }
        }
        x
    }

    fn out(&self, x: &DVector<f64>) -> Vec<f64> {
        x.component_mul(&self.units).iter().copied().collect()
    }

    /// One flight: effects with their parameters.
    pub fn flight(
        &mut self,
        effects: &[(usize, Vec<f64>)],
        jittered: bool,
        foreign: bool,
    ) -> Vec<f64> {
        let mut x = self.noise(jittered);
        for (e, theta) in effects {
            x += self.signature(*e, theta, foreign);
        }
        if foreign {
            for (j, v) in x.iter_mut().enumerate() {
                *v += 2.5 * ((j * 13) as f64).sin();
            }
        }
        self.out(&x)
    }

    /// A flight with an effect that is not in the bank.
    pub fn unknown(&mut self, k: usize) -> Vec<f64> {
        let e = self.size.effects + k % (self.size.effects / 3);
        let theta = self.theta(e);
        self.flight(&[(e, theta)], true, false)
    }

    /// A bank, its draws flown as twins of its flights with jitter.
    pub fn bank(&mut self) -> Bank {
        let size = self.size;
        let names = (0..size.statistics).map(|j| format!("s{j}")).collect();
        let seeds = (0..size.seeds).map(|_| self.flight(&[], false, false)).collect();
        let jitter: Vec<_> = (0..size.jitter).map(|_| self.flight(&[], true, false)).collect();
        let mut draw = |e: usize, k: usize| {
            let theta = self.theta(e);
            let off = self.out(&self.signature(e, &theta, false));
            let twin = (e * size.draws + k) % jitter.len();
            let statistics = jitter[twin].iter().zip(off).map(|(v, o)| v + o).collect();
            Draw { theta, seed: k as u64, twin, statistics }
        };
        let draws: Vec<Vec<Draw>> =
            (0..size.effects).map(|e| (0..size.draws).map(|k| draw(e, k)).collect()).collect();
        let effects = draws.into_iter().enumerate().map(|(e, draws)| EffectDraws {
            id: format!("E{e}"),
            axes: self.axes(e),
            draws,
        });
        let effects = effects.collect();
        Bank { names, seeds, jitter, effects }
    }
}
