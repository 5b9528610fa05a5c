//! Spectrum of the vibration: Welch's method on the inertial measurements, and the line of the wing beat.
//!
//! Segments of [`SEGMENT`] samples that follow one another without a gap, Hann window, half overlapping,
//! mean removed. What is above half the sampling rate is folded onto lower frequencies by the board and
//! cannot be told apart here.

use std::f64::consts::PI;

use super::fourier::transform;
use haltere_core::measure::ImuSample;

/// Samples of a segment, a power of two: 2 s at 250 Hz, so half a hertz of resolution.
const SEGMENT: usize = 512;
/// A step between samples longer than this many usual ones is a gap.
const GAP: f64 = 1.6;
/// Wing beats of this class of vehicle, Hz.
pub(super) const BEAT_HZ: [f64; 2] = [8.0, 25.0];
/// A beat stands out by this much over the middle of the band, in power.
const STANDS_OUT: f64 = 6.0;

/// Amplitude densities by frequency.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Spectrum {
    /// Frequency of each line, Hz.
    pub frequency_hz: Vec<f64>,
    /// Specific force along body x, y, z, m/s²/√Hz.
    pub acc: [Vec<f64>; 3],
    /// Angular rate about body x, y, z, rad/s/√Hz.
    pub rate: [Vec<f64>; 3],
    /// Sampling rate, Hz.
    pub sampling_hz: f64,
    /// Segments that were averaged.
    pub segments: usize,
}

impl Spectrum {
    /// Of samples in the order of time; `None` when no segment is whole.
    pub fn of(samples: &[ImuSample]) -> Option<Self> {
        let mut steps: Vec<f64> =
            samples.windows(2).map(|w| w[1].valid_at.seconds_since(w[0].valid_at)).collect();
        if steps.len() < SEGMENT {
            return None;
        }
        let usual_s = {
            let mut sorted = steps.clone();
            sorted.sort_by(f64::total_cmp);
            sorted[sorted.len() / 2]
        };
        if usual_s <= 0.0 {
            return None;
        }
        // The mean of the steps that are no gap: stamps are whole microseconds.
        let whole = || steps.iter().filter(|s| **s > 0.0 && **s < GAP * usual_s);
        let count = whole().count().max(1);
        let sampling_hz = count as f64 / whole().sum::<f64>();
        steps.push(0.0);
        let window: Vec<f64> =
            (0..SEGMENT).map(|i| (PI * i as f64 / SEGMENT as f64).sin().powi(2)).collect();
        let power_of_window: f64 = window.iter().map(|w| w * w).sum();
        let mut sums = vec![[0.0; 6]; SEGMENT / 2 + 1];
        let mut segments = 0;
        let mut at = 0;
        while at + SEGMENT <= samples.len() {
            let gap =
                steps[at..at + SEGMENT - 1].iter().rposition(|s| *s <= 0.0 || *s >= GAP * usual_s);
            if let Some(gap) = gap {
                at += gap + 1;
                continue;
            }
            let part = &samples[at..at + SEGMENT];
            for channel in 0..6 {
                let column: Vec<f64> = part.iter().map(|s| value(s, channel)).collect();
                let mean = column.iter().sum::<f64>() / SEGMENT as f64;
                let mut re: Vec<f64> =
                    column.iter().zip(&window).map(|(v, w)| (v - mean) * w).collect();
                let mut im = vec![0.0; SEGMENT];
                transform(&mut re, &mut im);
                for (k, sum) in sums.iter_mut().enumerate() {
                    let both = if k == 0 || k == SEGMENT / 2 { 1.0 } else { 2.0 };
                    sum[channel] += both * (re[k] * re[k] + im[k] * im[k]);
                }
            }
            segments += 1;
            at += SEGMENT / 2;
        }
        if segments == 0 || sums.iter().flatten().any(|v| !v.is_finite()) {
            return None;
        }
        let scale = 1.0 / (segments as f64 * sampling_hz * power_of_window);
        let density = |channel: usize| sums.iter().map(|s| (s[channel] * scale).sqrt()).collect();
        Some(Self {
            frequency_hz: (0..sums.len())
                .map(|k| k as f64 * sampling_hz / SEGMENT as f64)
                .collect(),
            acc: [density(0), density(1), density(2)],
            rate: [density(3), density(4), density(5)],
            sampling_hz,
            segments,
        })
    }

    /// Length of a segment, s.
    pub fn segment_s(&self) -> f64 {
        SEGMENT as f64 / self.sampling_hz
    }

    /// Frequency of the wing beat, Hz: the highest line of the force along body z within
    /// [`BEAT_HZ`], if it stands out; between lines by a parabola.
    pub fn beat_hz(&self) -> Option<f64> {
        let power: Vec<f64> = self.acc[2].iter().map(|a| a * a).collect();
        let band: Vec<usize> = (1..power.len().saturating_sub(1))
            .filter(|k| (BEAT_HZ[0]..=BEAT_HZ[1]).contains(&self.frequency_hz[*k]))
            .collect();
        let peak = *band.iter().max_by(|a, b| power[**a].total_cmp(&power[**b]))?;
        let mut sorted: Vec<f64> = band.iter().map(|k| power[*k]).collect();
        sorted.sort_by(f64::total_cmp);
        if power[peak] < STANDS_OUT * sorted[sorted.len() / 2] {
            return None;
        }
        let [a, b, c] = [power[peak - 1], power[peak], power[peak + 1]].map(|p| p.max(1e-30).ln());
        let bend = a - 2.0 * b + c;
        let shift = if bend < 0.0 { (0.5 * (a - c) / bend).clamp(-0.5, 0.5) } else { 0.0 };
        Some((peak as f64 + shift) * self.sampling_hz / SEGMENT as f64)
    }
}

fn value(sample: &ImuSample, channel: usize) -> f64 {
    if channel < 3 { sample.acc_B_mps2[channel] } else { sample.rate_B_radps[channel - 3] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::frames::Vec3;
    use haltere_core::time::HostTime;

    /// 250 Hz; a beat of `hz` and 4 m/s² along z, and white noise of a known density along x.
    fn samples(n: u64, hz: f64) -> Vec<ImuSample> {
        let mut seed = 1_u64;
        (0..n)
            .map(|i| {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let even = (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
                let at = HostTime::from_us(1_000_000 + 4_000 * i);
                let beat = 4.0 * (2.0 * PI * hz * 0.004 * i as f64).sin();
                ImuSample {
                    valid_at: at,
                    received_at: at,
                    acc_B_mps2: Vec3::new(even, 0.0, -9.8 + beat + 0.1 * even),
                    rate_B_radps: Vec3::zero(),
                }
            })
            .collect()
    }

    #[test]
    fn prop_power_is_kept_and_the_beat_is_found() {
        for hz in [9.3, 12.6, 21.0] {
            let spectrum = Spectrum::of(&samples(20_000, hz)).unwrap();
            assert!((spectrum.sampling_hz - 250.0).abs() < 1e-6);
            let found = spectrum.beat_hz().unwrap();
            assert!((found - hz).abs() < 0.1, "{found} for {hz}");
            // Parseval: the integral of the power density is the variance.
            let line_hz = spectrum.sampling_hz / SEGMENT as f64;
            let variance = |density: &[f64]| density.iter().map(|a| a * a * line_hz).sum::<f64>();
            assert!((variance(&spectrum.acc[2]) / 8.0 - 1.0).abs() < 0.02);
            // Evenly distributed over 1 m/s².
            assert!((variance(&spectrum.acc[0]) * 12.0 - 1.0).abs() < 0.03);
        }
    }

    #[test]
    fn prop_gaps_are_left_out_and_noise_is_no_beat() {
        let mut gappy = samples(4_000, 12.0);
        for sample in &mut gappy[1_000..] {
            sample.valid_at = sample.valid_at.offset_us(300_000);
        }
        let spectrum = Spectrum::of(&gappy).unwrap();
        assert!(spectrum.segments >= 12 && spectrum.beat_hz().is_some());
        assert_eq!(Spectrum::of(&gappy[..500]), None);
        let mut still = samples(4_000, 12.0);
        for sample in &mut still {
            sample.acc_B_mps2 = Vec3::new(0.0, 0.0, sample.acc_B_mps2[0]);
        }
        assert_eq!(Spectrum::of(&still).unwrap().beat_hz(), None);
    }
}
