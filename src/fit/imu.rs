//! Inertial sensors: bias and noise at rest, vibration in flight with the line of the wing beat.
//!
//! **At rest.** The gyroscope's mean is its bias. The accelerometer's mean is gravity plus bias plus
//! whatever the vehicle leans: level and horizontal bias are one number, so the horizontal means are
//! given as they are, and only the length of the vector is held against gravity.
//!
//! **In flight.** One-sided spectrum by averaged, overlapping, Hann-windowed pieces (Welch 1967); the
//! wing beat is the largest peak above [`LEAST_LINE_HZ`] that stands out of the median around it. Its
//! frequency is the mean over pieces, its standard error from their scatter with the overlap counted.
//! A line above half of the sample rate folds: the rate is told along.
//!
//! **Units.** m/s², rad/s, Hz; spectra in unit²/Hz.

use std::f64::consts::PI;

use serde::Serialize;

use super::correlated::Noise;
use super::linear::Rows;
use super::value::Value;
use crate::report::fourier::transform;

/// Lowest frequency that can be a wing beat, Hz: loops and body live below.
pub const LEAST_LINE_HZ: f64 = 5.0;
/// A line stands this many times above the median of its spectrum.
const STANDS_OUT: f64 = 6.0;
/// Length of a piece, s: a resolution of 0.5 Hz.
const PIECE_S: f64 = 2.0;
/// Fewest samples in a piece: at 2 Hz nothing above [`LEAST_LINE_HZ`] can be seen.
const LEAST_SIZE: usize = 4;
/// Least rest, s.
pub const LEAST_REST_S: f64 = 2.0;
/// Longest time over which the noise of a sensor at rest lasts, s: its filters. What wanders over
/// minutes is bias.
const LASTS_S: f64 = 0.5;
/// Least flight, s.
pub const LEAST_FLIGHT_S: f64 = 10.0;

/// Bias and noise of one axis at rest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AtRest {
    /// Mean.
    pub mean: Value,
    /// Standard deviation of a sample.
    pub std: f64,
}

/// Line of the wing beat.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Line {
    /// Frequency, Hz.
    pub hz: Value,
    /// Rms of what lies within a resolution of it.
    pub rms: f64,
    /// How far it stands above the median.
    pub stands_out: f64,
}

/// Vibration of one axis in flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Vibration {
    /// Standard deviation of a sample.
    pub std: f64,
    /// Frequency in Hz and density in unit²/Hz.
    pub spectrum: Vec<[f64; 2]>,
    /// The wing beat, if it shows.
    pub line: Option<Line>,
}

/// Bias and noise of one axis. `None`: less than [`LEAST_REST_S`] of it, or no numbers.
pub fn at_rest(times_s: &[f64], values: &[f64]) -> Option<AtRest> {
    let n = values.len();
    let length_s = times_s.last()? - times_s.first()?;
    if length_s < LEAST_REST_S || values.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let mean = values.iter().sum::<f64>() / n as f64;
    let residual: Vec<f64> = values.iter().map(|v| v - mean).collect();
    let ones = Rows::from_fn(n, 1, |_, row| row[0] = 1.0);
    let noise = Noise::learn_within(times_s, &ones, &residual, LASTS_S)?;
    let cov = noise.covariance(times_s, &ones)?;
    let std = (residual.iter().map(|r| r * r).sum::<f64>() / (n - 1) as f64).sqrt();
    Some(AtRest { mean: cov.value(0, mean), std })
}

/// Spectrum of evenly spaced samples. `None`: less than [`LEAST_FLIGHT_S`] of them, or no numbers.
pub fn vibration(rate_hz: f64, values: &[f64]) -> Option<Vibration> {
    let length_s = values.len() as f64 / rate_hz;
    if !(rate_hz > 0.0 && length_s >= LEAST_FLIGHT_S) || values.iter().any(|v| !v.is_finite()) {
        return None;
    }
    // Samples so far apart that a piece holds none show no vibration.
    let size = ((PIECE_S * rate_hz) as usize).next_power_of_two();
    if size < LEAST_SIZE {
        return None;
    }
    let window: Vec<f64> =
        (0..size).map(|i| 0.5 - 0.5 * (2.0 * PI * i as f64 / size as f64).cos()).collect();
    let power = window.iter().map(|w| w * w).sum::<f64>();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let bin_hz = rate_hz / size as f64;
    let mut sum = vec![0.0; size / 2 + 1];
    let mut pieces: Vec<Vec<f64>> = Vec::new();
    for start in (0..values.len().saturating_sub(size - 1)).step_by(size / 2) {
        let piece = &values[start..start + size];
        let own = piece.iter().sum::<f64>() / size as f64;
        let mut re: Vec<f64> = piece.iter().zip(&window).map(|(v, w)| (v - own) * w).collect();
        let mut im = vec![0.0; size];
        transform(&mut re, &mut im);
        let density: Vec<f64> = (0..=size / 2)
            .map(|k| {
                let twice = if k == 0 || k == size / 2 { 1.0 } else { 2.0 };
                twice * (re[k] * re[k] + im[k] * im[k]) / (power * rate_hz)
            })
            .collect();
        sum.iter_mut().zip(&density).for_each(|(s, d)| *s += d);
        pieces.push(density);
    }
    if pieces.is_empty() {
        return None;
    }
    sum.iter_mut().for_each(|s| *s /= pieces.len() as f64);
    let line = line(&sum, &pieces, bin_hz);
    let var = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64;
    let spectrum = sum.iter().enumerate().map(|(k, s)| [k as f64 * bin_hz, *s]).collect();
    Some(Vibration { std: var.sqrt(), spectrum, line })
}

/// The largest peak of the mean spectrum, and its frequency in every piece.
fn line(mean: &[f64], pieces: &[Vec<f64>], bin_hz: f64) -> Option<Line> {
    let first = (LEAST_LINE_HZ / bin_hz).ceil() as usize;
    let peak = (first..mean.len().checked_sub(1)?).max_by(|a, b| mean[*a].total_cmp(&mean[*b]))?;
    let mut sorted = mean.get(first..)?.to_vec();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2)?.max(1e-300);
    let stands_out = mean[peak] / median;
    if stands_out < STANDS_OUT {
        return None;
    }
    // Centre of gravity over the main lobe of the window, in every piece.
    let lobe = peak.saturating_sub(3).max(1)..(peak + 4).min(mean.len());
    let centre = |density: &[f64]| {
        let total: f64 = lobe.clone().map(|k| density[k]).sum();
        lobe.clone().map(|k| k as f64 * density[k]).sum::<f64>() / total * bin_hz
    };
    let each: Vec<f64> = pieces.iter().map(|p| centre(p)).collect();
    let n = each.len() as f64;
    let hz = each.iter().sum::<f64>() / n;
    let std = if each.len() > 1 {
        // Neighbours share half of their samples; with a Hann window that leaves 17 % correlation
        // of power (Welch 1967), and a wander of the beat itself more: pairs count as one.
        let var = each.iter().map(|h| (h - hz).powi(2)).sum::<f64>() / (n - 1.0);
        (var / (0.5 * n).max(1.0)).sqrt()
    } else {
        f64::INFINITY
    };
    let rms = (lobe.map(|k| mean[k]).sum::<f64>() * bin_hz).sqrt();
    let dof = (0.5 * n - 1.0).max(1.0);
    Some(Line { hz: Value { value: hz, std, dof }, rms, stands_out })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row each few seconds: a piece of two seconds held no sample, and pieces did not advance.
    #[test]
    fn regress_samples_seconds_apart_show_no_vibration() {
        for rate_hz in [0.01, 0.2, 0.5, 0.9] {
            assert_eq!(vibration(rate_hz, &[1.0; 40]), None, "{rate_hz} Hz");
        }
        assert!(vibration(20.0, &[1.0; 400]).is_some());
    }
}
