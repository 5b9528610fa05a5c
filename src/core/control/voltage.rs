//! Base thrust over battery voltage: a sagging battery needs more throttle for the same weight.
//!
//! **Equation.** `base(V) = c0 + c1·x + c2·x² + c3·x³`, `x = V − 3.7 V · n`, V the low-passed pack
//! voltage, n the number of cells.
//!
//! **Source.** Recorded hover flights: throttle counts (0 to 65535) times volts = 310 000 within
//! 1.5 % from 7.9 to 7.1 V, exponent −1.01. That is `base = 310000/65535/V = 4.730/V`. The default
//! coefficients are least-squares fits of it over 6.0 to 8.4 V, for each order; the tests derive
//! them again. Largest error: order 1 0.014, order 2 0.0014, order 3 0.0001 (of full throttle).
//!
//! **Validity.** 3.0 V (critical) to 4.2 V (full) a cell; held at the ends. **Other packs.** Where the default
//! coefficients are left, those of n cells are the same law of the voltage of a cell. **Left out.**
//! Sag within the filter's time constant, temperature, age of the pack.

use crate::checks::Problems;
use crate::control::filter::LowPass;

/// Cells of the vehicle that the defaults are of.
const USUAL_CELLS: u8 = 2;
/// Most cells in series: what a vehicle file may say.
pub const MOST_CELLS: u8 = 6;
/// Centre of the polynomial: nominal voltage of a cell, V.
const CELL_V: f64 = 3.7;
/// Voltage of a cell at which the polynomial is used, V: critical to full.
const CELL_RANGE_V: [f64; 2] = [3.0, 4.2];
/// A limit of the battery below this empties a cell for good, V a cell: lithium polymer suffers below 3.0 at rest, and what
/// is measured in flight sags.
const CELL_LEAST_LIMIT_V: f64 = 2.8;
/// A measured voltage of a cell outside of this cannot be one in flight, V.
const CELL_PLAUSIBLE_V: [f64; 2] = [2.5, 4.5];
/// Least-squares fits of 4.730/V of order 1, 2 and 3: frac, frac/V, frac/V², frac/V³.
pub const FITS: [[f64; 4]; 3] = [
    [0.644662, -0.092813, 0.0, 0.0],
    [0.638897, -0.087619, 0.012985, 0.0],
    [0.639199, -0.086254, 0.011895, -0.001816],
];
/// Plausible base thrust at any voltage of the range: the flapping wings of this class hover
/// between a third and nearly all of their throttle.
const PLAUSIBLE_BASE_FRAC: std::ops::RangeInclusive<f64> = 0.2..=0.95;

crate::keys! {
    /// Parameters of the base thrust, key `control.voltage`.
    pub struct VoltageConfig {
        /// Cells of the pack in series.
        ///
        /// Voltages of 2.5 to 4.5 V a cell are believed. nominal_v, battery_low_v and battery_critical_v of `[limits]`
        /// belong to it.
        cells: u8 = USUAL_CELLS, [1.0..=MOST_CELLS as f64], VLT_CELLS(105, OnFloor);
        /// Coefficients of (V − 3.7 · cells) to the power 0, 1, 2, 3: two to four numbers, order 1 to 3. Thrust from 0
        /// to 1 per V to that power. The default stands for the same law of the voltage of a cell, however many there
        /// are.
        base_coefficients_frac: Vec<f64> = FITS[2].to_vec(), ~[-5.0..=5.0],
            VLT_BASE_0(101, OnFloor, "Base thrust is a polynomial of (V - 3.7 a cell): the coefficient of this power."),
            VLT_BASE_1(102, OnFloor, "Base thrust is a polynomial of (V - 3.7 a cell): the coefficient of this power."),
            VLT_BASE_2(103, OnFloor, "Base thrust is a polynomial of (V - 3.7 a cell): the coefficient of this power."),
            VLT_BASE_3(104, OnFloor, "Base thrust is a polynomial of (V - 3.7 a cell): the coefficient of this power.");
        /// Voltage assumed until one is known. 3.0 to 4.2 a cell.
        nominal_v: f64 = f64::from(USUAL_CELLS) * CELL_V, ~[3.0..=4.2 * MOST_CELLS as f64, "V"], VLT_NOMINAL(106, OnFloor);
        /// Time constant of the low-pass on the measured voltage.
        // Slower than the sag of a thrust burst (so that burst and sag do not chase each
        // other), faster than the discharge, which takes minutes.
        filter_s: f64 = 3.0, [0.0..=60.0, "s"], VLT_FILTER_T(107, OnFloor);
    } rules plausible;
}

impl VoltageConfig {
    /// Centre of the polynomial: nominal voltage of the pack, V.
    pub fn centre_v(&self) -> f64 {
        self.of_pack(CELL_V)
    }

    /// Lowest voltage the polynomial is used at, V: critical.
    pub fn lowest_v(&self) -> f64 {
        self.of_pack(CELL_RANGE_V[0])
    }

    /// Highest voltage the polynomial is used at, V: full.
    pub fn highest_v(&self) -> f64 {
        self.of_pack(CELL_RANGE_V[1])
    }

    /// Whether a measured voltage can be that of this pack in flight.
    pub fn is_plausible(&self, supply_v: f64) -> bool {
        let [low, high] = CELL_PLAUSIBLE_V;
        (self.of_pack(low)..=self.of_pack(high)).contains(&supply_v)
    }

    /// Voltages that a limit of this pack can have, V.
    pub fn limits_v(&self) -> std::ops::RangeInclusive<f64> {
        self.of_pack(CELL_LEAST_LIMIT_V)..=self.highest_v()
    }

    fn of_pack(&self, cell_v: f64) -> f64 {
        f64::from(self.cells) * cell_v
    }

    fn plausible(&self, key: &str, problems: &mut Problems) {
        if !(1..=MOST_CELLS).contains(&self.cells) {
            return;
        }
        let (lowest_v, highest_v) = (self.lowest_v(), self.highest_v());
        problems.range(format!("{key}.nominal_v"), self.nominal_v, lowest_v..=highest_v, "V");
        let key = format!("{key}.base_coefficients_frac");
        let count = self.base_coefficients_frac.len();
        if !(2..=4).contains(&count) {
            problems.say(format!("{key} has {count} numbers, allowed 2 to 4 (order 1 to 3)"));
            return;
        }
        let law = BaseThrust::new(self);
        let mut before = f64::INFINITY;
        for step in 0..=24 {
            let v = lowest_v + (highest_v - lowest_v) * f64::from(step) / 24.0;
            let base = law.at_frac(v);
            if !PLAUSIBLE_BASE_FRAC.contains(&base) {
                problems.say(format!(
                    "{key} give a base thrust of {base:.3} at {v:.1} V, allowed {} to {}",
                    PLAUSIBLE_BASE_FRAC.start(),
                    PLAUSIBLE_BASE_FRAC.end()
                ));
                return;
            }
            if base > before {
                problems.say(format!(
                    "{key} give more base thrust at {v:.1} V ({base:.4}) than at a lower voltage \
                     ({before:.4}); it must fall from {lowest_v} to {highest_v} V"
                ));
                return;
            }
            before = base;
        }
    }
}

/// The polynomial, ready for use without allocation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaseThrust {
    coefficients: [f64; 4],
    centre_v: f64,
    range_v: [f64; 2],
}

impl BaseThrust {
    /// From the configuration.
    pub fn new(config: &VoltageConfig) -> Self {
        let mut coefficients = [0.0; 4];
        for (slot, c) in coefficients.iter_mut().zip(&config.base_coefficients_frac) {
            *slot = *c;
        }
        if config.base_coefficients_frac == FITS[2] {
            let per_volt = f64::from(USUAL_CELLS) / f64::from(config.cells.max(1));
            coefficients.iter_mut().zip(0..).for_each(|(c, k)| *c *= per_volt.powi(k));
        }
        let range_v = [config.lowest_v(), config.highest_v()];
        Self { coefficients, centre_v: config.centre_v(), range_v }
    }

    /// Base thrust at this voltage, held beyond the ends of the range.
    pub fn at_frac(&self, supply_v: f64) -> f64 {
        let [low_v, high_v] = self.range_v;
        let x = supply_v.clamp(low_v, high_v) - self.centre_v;
        let [c0, c1, c2, c3] = self.coefficients;
        c0 + x * (c1 + x * (c2 + x * c3))
    }
}

/// Where the voltage in use comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SupplyQuality {
    /// A plausible measurement of this step.
    Measured,
    /// Missing or absurd in this step: the last good, filtered value is held.
    Held,
    /// Never a good one: the configured nominal voltage.
    #[default]
    Nominal,
}

/// Low-passed battery voltage that survives missing and absurd readings.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SupplyFilter {
    filter: LowPass<1>,
}

impl SupplyFilter {
    /// Takes the reading of this step; gives the voltage to use, V, and its quality.
    pub fn step(
        &mut self,
        config: &VoltageConfig,
        supply_v: Option<f64>,
        dt_s: f64,
    ) -> (f64, SupplyQuality) {
        match supply_v {
            Some(v) if config.is_plausible(v) => {
                (self.filter.step([v], config.filter_s, dt_s)[0], SupplyQuality::Measured)
            }
            _ => match self.filter.value() {
                Some([held]) => (held, SupplyQuality::Held),
                None => (config.nominal_v, SupplyQuality::Nominal),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    /// Recorded hover: counts times volts, over the counts of full throttle.
    fn recorded_law_frac(supply_v: f64) -> f64 {
        310_000.0 / 65_535.0 / supply_v
    }

    #[test]
    fn val_coefficients_are_least_squares_fits_of_the_recorded_law() {
        let volts: Vec<f64> = (0..=240).map(|i| 6.0 + 0.01 * f64::from(i)).collect();
        for (fit, max_error) in FITS.iter().zip([0.0140, 0.0014, 0.00014]) {
            let order = FITS.iter().position(|f| f == fit).expect("listed") + 1;
            let a = DMatrix::from_fn(volts.len(), order + 1, |r, c| {
                (volts[r] - 7.4).powi(i32::try_from(c).expect("small"))
            });
            let b = DVector::from_fn(volts.len(), |r, _| recorded_law_frac(volts[r]));
            let normal = (a.transpose() * &a).lu();
            let x = normal.solve(&(a.transpose() * b)).expect("regular");
            for (stored, derived) in fit.iter().zip(x.iter()) {
                assert!((stored - derived).abs() < 1e-6, "order {order}: {stored} {derived}");
            }
            let law = of_two_cells(*fit);
            let worst = volts
                .iter()
                .map(|v| (law.at_frac(*v) - recorded_law_frac(*v)).abs())
                .fold(0.0, f64::max);
            assert!(worst < max_error, "order {order}: {worst}");
        }
    }

    fn of_two_cells(coefficients: [f64; 4]) -> BaseThrust {
        BaseThrust { coefficients, ..BaseThrust::new(&VoltageConfig::default()) }
    }

    #[test]
    fn prop_one_cell_and_three_have_the_law_of_two_by_the_cell() {
        let two = BaseThrust::new(&VoltageConfig::default());
        for cells in [1, 3] {
            let nominal_v = 3.7 * f64::from(cells);
            let config = VoltageConfig { cells, nominal_v, ..Default::default() };
            let mut problems = Problems::new();
            config.check("v", &mut problems);
            assert!(problems.is_empty(), "{problems}");
            let law = BaseThrust::new(&config);
            for cell_v in [2.9, 3.0, 3.3, 3.7, 4.2, 4.3] {
                let of = |law: &BaseThrust, cells: u8| law.at_frac(cell_v * f64::from(cells));
                assert!((of(&law, cells) - of(&two, 2)).abs() < 1e-12, "{cells} {cell_v}");
            }
            let mut supply = SupplyFilter::default();
            let (used_v, quality) = supply.step(&config, Some(7.4), 0.01);
            assert_eq!(
                (used_v, quality),
                (nominal_v, SupplyQuality::Nominal),
                "two cells are none of {cells}"
            );
        }
        let mut problems = Problems::new();
        VoltageConfig { cells: 1, ..Default::default() }.check("v", &mut problems);
        assert_eq!(problems.lines(), ["v.nominal_v = 7.4, allowed 3 to 4.2 V"]);
    }

    #[test]
    fn val_hover_counts_of_the_recordings() {
        let law = BaseThrust::new(&VoltageConfig::default());
        for (v, counts) in [(7.9, 39_200.0), (7.1, 43_700.0)] {
            assert!((law.at_frac(v) * 65_535.0 / counts - 1.0).abs() < 0.015);
        }
    }

    #[test]
    fn prop_every_order_passes_its_check() {
        for (i, fit) in FITS.iter().enumerate() {
            let config = VoltageConfig {
                base_coefficients_frac: fit[..i + 2].to_vec(),
                ..Default::default()
            };
            let mut problems = Problems::new();
            config.check("v", &mut problems);
            assert!(problems.is_empty(), "{problems}");
        }
    }

    #[test]
    fn prop_absurd_coefficients_are_refused() {
        for broken in [
            vec![],
            vec![0.64],
            vec![0.64, -0.09, 0.0, 0.0, 0.0],
            vec![0.64, 0.09],
            vec![0.64, -0.5],
            vec![64.0, -9.0],
            vec![f64::NAN, -0.09],
            vec![0.64, -0.09, f64::INFINITY],
        ] {
            let mut problems = Problems::new();
            let said = format!("{broken:?}");
            VoltageConfig { base_coefficients_frac: broken, ..Default::default() }
                .check("v", &mut problems);
            assert!(!problems.is_empty(), "{said}");
        }
    }

    #[test]
    fn prop_missing_or_absurd_voltage_holds_the_last_good_one() {
        let config = VoltageConfig::default();
        let mut supply = SupplyFilter::default();
        let absurd = [None, Some(f64::NAN), Some(0.0), Some(4.99), Some(9.01), Some(f64::INFINITY)];
        for v in absurd {
            assert_eq!(supply.step(&config, v, 0.01), (7.4, SupplyQuality::Nominal));
        }
        // The first good one counts at once: no ramp from nominal.
        assert_eq!(supply.step(&config, Some(8.1), 0.01), (8.1, SupplyQuality::Measured));
        for v in absurd {
            assert_eq!(supply.step(&config, v, 0.01), (8.1, SupplyQuality::Held));
        }
    }

    #[test]
    fn prop_filter_has_its_time_constant() {
        let config = VoltageConfig::default();
        let mut supply = SupplyFilter::default();
        supply.step(&config, Some(8.0), 0.01);
        let mut v = 8.0;
        for _ in 0..300 {
            (v, _) = supply.step(&config, Some(7.0), 0.01);
        }
        assert!((v - 7.0 - (-1.0f64).exp()).abs() < 0.002, "{v}");
    }

    proptest! {
        #[test]
        fn prop_base_thrust_falls_with_voltage(v in 5.0..9.0f64, up in 0.0..4.0f64) {
            for coefficients in FITS {
                let law = of_two_cells(coefficients);
                prop_assert!(law.at_frac(v) >= law.at_frac(v + up));
                prop_assert!((0.5..0.8).contains(&law.at_frac(v)));
            }
        }
    }
}
