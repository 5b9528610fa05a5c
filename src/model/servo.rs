//! A second-order lag, solved exactly over one simulation step with its input held.

use crate::effects::STEP_S;

/// `x'' = ω² (u - x) - 2 ζ ω x'`.
#[derive(Debug, Clone)]
pub struct SecondOrder {
    x: f64,
    x_dot: f64,
    /// State transition over one step of (x - u, x').
    m: [[f64; 2]; 2],
}

impl SecondOrder {
    /// At rest at zero.
    pub fn new(frequency_radps: f64, damping: f64) -> Self {
        // Stiffer than the step can show: follow at once.
        if frequency_radps * STEP_S > 10.0 {
            return Self { x: 0.0, x_dot: 0.0, m: [[0.0; 2]; 2] };
        }
        // e^(A dt) by scaling and squaring of a fourth-order Taylor series.
        const SQUARINGS: i32 = 10;
        let h = STEP_S / f64::from(1 << SQUARINGS);
        let a = [[0.0, h], [-frequency_radps.powi(2) * h, -2.0 * damping * frequency_radps * h]];
        let mut term = [[1.0, 0.0], [0.0, 1.0]];
        let mut m = term;
        for k in 1..=4 {
            term = multiply(term, a).map(|row| row.map(|c| c / f64::from(k)));
            for (sum, t) in m.iter_mut().flatten().zip(term.as_flattened()) {
                *sum += t;
            }
        }
        for _ in 0..SQUARINGS {
            m = multiply(m, m);
        }
        Self { x: 0.0, x_dot: 0.0, m }
    }

    /// One step towards `u`; returns where it is.
    #[inline]
    pub fn step(&mut self, u: f64) -> f64 {
        let e = self.x - u;
        let [[a, b], [c, d]] = self.m;
        (self.x, self.x_dot) = (u + a * e + b * self.x_dot, c * e + d * self.x_dot);
        self.x
    }
}

fn multiply(a: [[f64; 2]; 2], b: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let at = |i: usize, j: usize| a[i][0] * b[0][j] + a[i][1] * b[1][j];
    [[at(0, 0), at(0, 1)], [at(1, 0), at(1, 1)]]
}
