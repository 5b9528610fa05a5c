//! The Fourier transform, for spectra of vibration here and for fits.

use std::f64::consts::PI;

/// Fourier transform in place, radix two (Cooley and Tukey 1965); the length is a power of two.
pub fn transform(re: &mut [f64], im: &mut [f64]) {
    let n = re.len();
    let mut j = 0;
    for i in 1..n {
        let mut bit = n >> 1;
        while j & bit != 0 {
            j ^= bit;
            bit >>= 1;
        }
        j |= bit;
        if i < j {
            re.swap(i, j);
            im.swap(i, j);
        }
    }
    let mut length = 2;
    while length <= n {
        let half = length / 2;
        for start in (0..n).step_by(length) {
            for k in 0..half {
                let (sin, cos) = (-2.0 * PI * k as f64 / length as f64).sin_cos();
                let (a, b) = (start + k, start + k + half);
                let (x, y) = (re[b] * cos - im[b] * sin, re[b] * sin + im[b] * cos);
                (re[b], im[b]) = (re[a] - x, im[a] - y);
                (re[a], im[a]) = (re[a] + x, im[a] + y);
            }
        }
        length *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_it_is_the_sum_that_defines_it() {
        let n = 16;
        let value = |i: usize| ((i * i % 7) as f64, (3 * i % 5) as f64);
        let (mut re, mut im): (Vec<_>, Vec<_>) = (0..n).map(value).unzip();
        transform(&mut re, &mut im);
        for k in 0..n {
            let (mut sum_re, mut sum_im) = (0.0, 0.0);
            for i in 0..n {
                let (s, c) = (-2.0 * PI * (i * k) as f64 / n as f64).sin_cos();
                let (x, y) = value(i);
                (sum_re, sum_im) = (sum_re + x * c - y * s, sum_im + x * s + y * c);
            }
            assert!((re[k] - sum_re).hypot(im[k] - sum_im) < 1e-9, "{k}");
        }
    }
}
