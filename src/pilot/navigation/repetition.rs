//! What the IMU says of itself: the same again and again, or noise.

use haltere_core::measure::ImuSample;

/// Longest interval between two samples that counts as one of repetition, s.
const LONGEST_S: f64 = 0.1;

/// Time over which noise is told from motion, s: four wing beats, and 70 samples of three axes.
const ROUGH_FILTER_S: f64 = 0.3;
/// For how long it must look like noise, s.
pub(crate) const ROUGH_LASTS_S: f64 = 0.3;
/// Share of white noise that is noise. Over these times 64 whole healthy flights in the other simulator, whose gears
/// shake the board as well, had 0.56 at most, and white noise never less than 0.86 in two minutes.
pub(crate) const ROUGH_RATIO: f64 = 0.7;
/// Noise that matters, m/s² and rad/s, all axes together.
const ROUGH_ACC_MPS2: f64 = 8.0;
const ROUGH_RATE_RADPS: f64 = 1.0;
/// At longer intervals wing beats themselves look like noise, s.
const ROUGH_INTERVAL_S: f64 = 0.006;
/// Weight of the newest interval in the mean.
const INTERVAL_WEIGHT: f64 = 0.02;

/// Whether a signal is noise from sample to sample, by the ratio of von Neumann: mean squared difference of
/// neighbours over twice the variance. White noise has 1; a motion that is sampled often enough has little.
#[derive(Debug, Default, Clone, Copy)]
struct Roughness {
    mean: [f64; 3],
    variance: f64,
    half_step2: f64,
}

impl Roughness {
    fn note(&mut self, now: [f64; 3], was: [f64; 3], dt_s: f64) {
        self.note_over(ROUGH_FILTER_S, now, was, dt_s);
    }

    fn note_over(&mut self, filter_s: f64, now: [f64; 3], was: [f64; 3], dt_s: f64) {
        let weight = dt_s / (filter_s + dt_s);
        let (mut spread, mut step) = (0.0, 0.0);
        for i in 0..3 {
            self.mean[i] += (now[i] - self.mean[i]) * weight;
            spread += (now[i] - self.mean[i]).powi(2);
            step += 0.5 * (now[i] - was[i]).powi(2);
        }
        self.variance += (spread - self.variance) * weight;
        self.half_step2 += (step - self.half_step2) * weight;
    }

    fn is_noise(&self, least_std: f64) -> bool {
        self.variance > least_std * least_std && self.half_step2 > ROUGH_RATIO * self.variance
    }
}

/// How long each triple has repeated itself, and how rough it is.
#[derive(Debug, Default)]
pub(crate) struct Repetition {
    last: Option<ImuSample>,
    /// How long accelerometer and gyroscope have repeated themselves, s.
    pub acc_s: f64,
    pub rate_s: f64,
    rough_acc: Roughness,
    rough_rate: Roughness,
    /// Mean interval, s.
    interval_s: f64,
}

impl Repetition {
    /// A sample came.
    pub fn note(&mut self, sample: &ImuSample) {
        if let Some(last) = &self.last {
            let dt_s = sample.valid_at.seconds_since(last.valid_at).clamp(0.0, LONGEST_S);
            let same = |now: [f64; 3], was: [f64; 3]| now == was;
            let acc = same(sample.acc_B_mps2.to_array(), last.acc_B_mps2.to_array());
            let rate = same(sample.rate_B_radps.to_array(), last.rate_B_radps.to_array());
            // Across a gap neighbours differ as those of noise do.
            if dt_s > 0.0 && dt_s < LONGEST_S {
                self.interval_s += (dt_s - self.interval_s) * INTERVAL_WEIGHT;
                let (now, was) = (sample.acc_B_mps2.to_array(), last.acc_B_mps2.to_array());
                self.rough_acc.note(now, was, dt_s);
                let (now, was) = (sample.rate_B_radps.to_array(), last.rate_B_radps.to_array());
                self.rough_rate.note(now, was, dt_s);
            }
            self.acc_s = if acc { self.acc_s + dt_s } else { 0.0 };
            self.rate_s = if rate { self.rate_s + dt_s } else { 0.0 };
        }
        self.last = Some(*sample);
    }

    /// Which of the two is noise, if the samples come often enough to tell.
    pub fn noise(&self) -> Option<&'static str> {
        if self.interval_s > ROUGH_INTERVAL_S {
            None
        } else if self.rough_acc.is_noise(ROUGH_ACC_MPS2) {
            Some("accelerometer")
        } else if self.rough_rate.is_noise(ROUGH_RATE_RADPS) {
            Some("gyroscope")
        } else {
            None
        }
    }

    pub fn longest_s(&self) -> f64 {
        self.acc_s.max(self.rate_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.004;

    /// White noise of this standard deviation (numbers: splitmix64).
    fn white(std: f64) -> impl FnMut() -> f64 {
        let mut state = 1_u64;
        move || {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = state;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            let unit = ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64;
            std * 12.0_f64.sqrt() * (unit - 0.5)
        }
    }

    /// Shares of white noise over a minute, from the second second on.
    fn shares(mut sample: impl FnMut(f64) -> [f64; 3]) -> (f64, f64) {
        let mut rough = Roughness::default();
        let mut was = sample(0.0);
        let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
        for n in 1..15_000 {
            let t_s = f64::from(n) * DT_S;
            let now = sample(t_s);
            rough.note(now, was, DT_S);
            was = now;
            if t_s > 2.0 {
                let share = rough.half_step2 / rough.variance;
                (least, most) = (least.min(share), most.max(share));
            }
        }
        (least, most)
    }

    /// Wing beats of 13 Hz with their second harmonic, m/s².
    fn beats(t_s: f64) -> f64 {
        let turn = std::f64::consts::TAU * 13.0 * t_s;
        15.0 * turn.sin() + 8.0 * (2.0 * turn).sin()
    }

    /// How long after noise took the place of wing beats it is told, s: in the middle of 200 onsets, and at
    /// worst. Noise of this standard deviation an axis; time of the filter, for how long, share.
    fn told_after_s(std: f64, filter_s: f64, lasts_s: f64, ratio: f64) -> [f64; 2] {
        let mut noise = white(std);
        let mut delays: Vec<f64> = (0..200)
            .map(|n| {
                // Onsets all over a wing beat.
                let onset_s = 2.0 + f64::from(n) * 0.001_3;
                let mut rough = Roughness::default();
                let (mut was, mut since_s) = ([0.0; 3], None);
                for k in 0..2_000 {
                    let t_s = f64::from(k) * DT_S;
                    let now = if t_s < onset_s {
                        [beats(t_s), 0.3 * beats(t_s + 0.01), beats(t_s + 0.02)]
                    } else {
                        std::array::from_fn(|_| noise())
                    };
                    rough.note_over(filter_s, now, was, DT_S);
                    was = now;
                    let seen = rough.variance > ROUGH_ACC_MPS2.powi(2)
                        && rough.half_step2 > ratio * rough.variance;
                    since_s = seen.then(|| since_s.unwrap_or(t_s));
                    if since_s.is_some_and(|since_s| t_s - since_s >= lasts_s) {
                        return t_s - onset_s;
                    }
                }
                f64::INFINITY
            })
            .collect();
        delays.sort_by(f64::total_cmp);
        [delays[100], delays[199]]
    }

    /// The delays that docs/SAFETY.md gives. Printed beside them are those of the limits that the row had when it
    /// brought down healthy vehicles (filter of 0.15 s, 0.1 s long, share of 0.6): a third of these.
    #[test]
    fn golden_noise_is_told_as_soon_as_was_written_down() {
        for (std, found_s) in [(40.0, [0.35, 0.50]), (20.0, [0.43, 0.61]), (10.0, [0.63, 0.91])] {
            let delays_s = told_after_s(std, ROUGH_FILTER_S, ROUGH_LASTS_S, ROUGH_RATIO);
            let before_s = told_after_s(std, 0.15, 0.1, 0.6);
            println!("{std} m/s² an axis: {delays_s:.3?} s; before {before_s:.3?}");
            for (delay_s, found_s) in delays_s.into_iter().zip(found_s) {
                assert!((delay_s - found_s).abs() < 0.02, "{std} m/s²: {delays_s:?} s");
            }
        }
    }

    #[test]
    fn prop_white_noise_is_always_told_from_wing_beats_and_gears() {
        let mut noise = white(10.0);
        let (least, _) = shares(|_| std::array::from_fn(|_| noise()));
        assert!(least > ROUGH_RATIO, "{least}");
        let mut noise = white(2.0);
        let (_, most) = shares(|t_s| {
            let turn = std::f64::consts::TAU * 13.0 * t_s;
            let beat = 15.0 * turn.sin() + 8.0 * (2.0 * turn).sin();
            // What is left of a gear mesh far above half of the rate of samples.
            let gears = 4.0 * (std::f64::consts::TAU * 97.0 * t_s).sin();
            [beat + gears, gears + noise(), beat]
        });
        assert!(most < ROUGH_RATIO, "{most}");
    }
}
