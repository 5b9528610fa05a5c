//! The file of a quadrotor from flights that were accepted: what its hover shows of the thrust of its motors.
//!
//! In hover the motors carry the weight, which is declared: so their commands say what thrust they give, and, where the pack empties
//! meanwhile, with which power of the voltage it goes. Nothing else of a file shows in hover, and it stays as it is.

use haltere_core::checks::Problems;
use haltere_log::import::motors::MotorFlight;
use haltere_model::rotorcraft::Rotorcraft;
use serde::Serialize;

use super::hover::{Hover, levels};
use super::weigh::Healthy;
use crate::accept::{EditError, set_key};
use crate::normal::quantile;

/// Fewest flights: of fewer nothing is known of what they scatter by.
pub const LEAST_FLIGHTS: usize = 3;
/// The power of the voltage is shown where its interval is this narrow to each side: half of what tells 1 from 2.
const SHOWN: f64 = 0.5;
/// A file is not changed by less: thrust of one per cent where the voltage is a tenth lower.
const LEAST_CHANGE: f64 = 0.1;

/// A constant of the file as the flights show it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Constant {
    /// Key in the vehicle file.
    pub key: &'static str,
    /// As the file says.
    pub file: f64,
    /// As found, with the central 90 %.
    pub value: f64,
    /// See `value`.
    pub low: f64,
    /// See `value`.
    pub high: f64,
}

/// A file that was filled.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Filled {
    /// Flights that it is from.
    pub flights: usize,
    /// What they show.
    pub constants: Vec<Constant>,
    /// What stays as the file says, and why.
    pub as_the_file: Vec<(&'static str, &'static str)>,
}

/// What flights show of a vehicle whose mass is declared.
pub fn fill(flights: &[MotorFlight], vehicle: &Rotorcraft) -> Result<Filled, Problems> {
    if flights.len() < LEAST_FLIGHTS {
        return Err(Problems::one(format!(
            "{} accepted flights, at least {LEAST_FLIGHTS} are needed",
            flights.len()
        )));
    }
    let mut constants = Vec::new();
    let mut as_the_file = vec![
        ("mass_kg, inertia_kgm2, motor", "hover shows no scale of its own: weigh and measure them"),
        (
            "drag_per_s",
            "hover shows none: `haltere fit drag --import csv` with position and attitude",
        ),
        (
            "thrust.command_exponent, thrust.torque_m",
            "hover is one thrust, and has no torque that is known",
        ),
    ];
    let mut vehicle = vehicle.clone();
    let file = vehicle.thrust.voltage_exponent;
    match voltage_exponent(flights, &vehicle) {
        // What the flights do not contradict is left: the firmware is known better than a slope.
        Some([value, half]) if (value - file).abs() > half.max(LEAST_CHANGE) => {
            vehicle.thrust.voltage_exponent = value.clamp(0.0, 3.0);
            let (low, high) = (value - half, value + half);
            let value = vehicle.thrust.voltage_exponent;
            constants.push(Constant { key: "voltage_exponent", file, value, low, high });
        }
        Some(_) => {
            as_the_file.push(("thrust.voltage_exponent", "the flights do not contradict it"))
        }
        None => as_the_file.push((
            "thrust.voltage_exponent",
            "the voltage did not change enough, or was not logged",
        )),
    }
    let mut hovers = Vec::new();
    for flight in flights {
        let hover = Hover::of(flight, &vehicle);
        hovers.push(hover.map_err(|why| Problems::one(format!("{}: {why}", flight.name)))?);
    }
    let healthy = Healthy::of(&hovers).ok_or_else(|| Problems::one("no flight"))?;
    let each_n = vehicle.weight_n() / vehicle.motor.len() as f64;
    // The balance is the logarithm of the share of the full thrust that carries the weight.
    let at = |sigmas: f64| each_n / (healthy.mean()[0] - sigmas * healthy.sigma()[0]).exp();
    let (file, value) = (vehicle.thrust.full_n, at(0.0));
    let z90 = quantile(0.95);
    let (low, high) = (at(-z90), at(z90));
    constants.insert(0, Constant { key: "full_n", file, value, low, high });
    Ok(Filled { flights: flights.len(), constants, as_the_file })
}

/// The power of the voltage by which thrust goes, with half of its central 90 %: how the commands rise as the pack of a flight
/// empties. What flights differ by among one another does not count, and their own slopes say how well it is known.
///
/// ```text
/// e = -Σ_f P_f / Σ_f Q_f,   P = Σ (x - x̄)(y - ȳ),   Q = Σ (x - x̄)²
/// σ² = n / (n - 1) · Σ_f (P_f + e Q_f)² / (Σ_f Q_f)²
/// ```
/// Over the pieces of a flight f of n: x the logarithm of the voltage over the nominal one, y that of the share of the full thrust,
/// both without unit. σ is the standard error of a slope that is pooled over clusters (Liang and Zeger 1986).
fn voltage_exponent(flights: &[MotorFlight], vehicle: &Rotorcraft) -> Option<[f64; 2]> {
    let sums: Vec<[f64; 2]> = flights
        .iter()
        .map(|flight| {
            let levels = levels(flight, vehicle);
            let n = levels.len().max(1) as f64;
            let mean = |k: usize| levels.iter().map(|level| level[k]).sum::<f64>() / n;
            let [volt, thrust] = [mean(0), mean(1)];
            let product = |k: usize, mean: f64| {
                levels.iter().map(|level| (level[0] - volt) * (level[k] - mean)).sum::<f64>()
            };
            [product(0, volt), -product(1, thrust)]
        })
        .collect();
    let spread: f64 = sums.iter().map(|sum| sum[0]).sum();
    if spread <= 0.0 {
        return None;
    }
    let slope = sums.iter().map(|sum| sum[1]).sum::<f64>() / spread;
    let n = sums.len() as f64;
    let apart: f64 = sums.iter().map(|sum| (sum[1] - slope * sum[0]).powi(2)).sum();
    let half = quantile(0.95) * (apart * n / (n - 1.0)).sqrt() / spread;
    (half < SHOWN).then_some([slope, half])
}

impl Filled {
    /// The text of the vehicle file with these numbers.
    pub fn into_text(&self, text: &str) -> Result<String, EditError> {
        let mut new = text.to_owned();
        for constant in &self.constants {
            // Four digits are more than the flights show.
            let value = format!("{:.3e}", constant.value).parse::<f64>().unwrap_or(constant.value);
            new = set_key(&new, "thrust", constant.key, &format!("{value:?}"))?;
        }
        Rotorcraft::from_toml(&new).map_err(|why| EditError::Value(why.to_string()))?;
        Ok(new)
    }

    /// In words.
    pub fn text(&self) -> String {
        let found = self.constants.iter().map(|c| {
            format!(
                "CONSTANT    thrust.{} = {:.4} (90 %: {:.4} to {:.4}), file {:.4}\n",
                c.key, c.value, c.low, c.high, c.file
            )
        });
        let left = self.as_the_file.iter().map(|(key, why)| format!("AS THE FILE {key}: {why}\n"));
        let head =
            format!("FILLED      from {} accepted flights, by the declared mass\n", self.flights);
        std::iter::once(head).chain(found).chain(left).collect()
    }
}
