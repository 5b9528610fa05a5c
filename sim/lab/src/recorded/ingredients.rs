//! Every ingredient on and off, on every recorded flight.

use std::fmt::{self, Write};

use serde::Serialize;

use crate::util_flights::file::Flight;
use crate::util_flights::{FlightReport, Flown, run_flight, table};
use haltere_core::estimator::{EstimatorConfig, SpecificForce, Tail, UwbNoise};

/// A filter with something changed.
struct Variant {
    name: &'static str,
    change: fn(&mut EstimatorConfig),
}

/// The whole first, then each ingredient taken out or exchanged, then the older filters.
const VARIANTS: [Variant; 20] = [
    Variant { name: "**what flies**", change: |_| {} },
    Variant { name: "without wandering biases", change: |c| c.anchor_bias.std_m = 1e-4 },
    Variant { name: "without constant biases", change: |c| c.anchor_bias.constant_std_m = 0.0 },
    Variant { name: "without any biases", change: |c| c.anchor_bias.estimate = false },
    Variant { name: "biases wander in time only", change: |c| c.anchor_bias.correlation_m = 1e5 },
    Variant { name: "how much they wander is set", change: |c| c.anchor_bias.level_s = 0.0 },
    Variant { name: "floor hides no anchors", change: |c| c.anchor_bias.low_anchor_m = -50.0 },
    Variant { name: "without learned quality", change: |c| c.quality.learn = false },
    Variant { name: "no anchor left out", change: |c| c.isolation.leave_out = false },
    Variant { name: "Huber tail", change: |c| c.gate.tail = Tail::Huber },
    Variant { name: "normal errors, no tail", change: |c| c.gate.tail = Tail::Gaussian },
    Variant {
        name: "hard gate at 5 sigma",
        change: |c| {
            c.gate.reject = true;
            c.gate.sigma = 5.0;
        },
    },
    Variant { name: "without drag", change: |c| c.drag = false },
    Variant {
        name: "accelerometer on all axes",
        change: |c| c.specific_force = SpecificForce::Accelerometer,
    },
    Variant { name: "what lasts beyond drag", change: |c| c.slow_force_s = 2.0 },
    Variant { name: "with the gyroscope's bias", change: |c| c.gyro_bias.estimate = true },
    Variant { name: "without barometer", change: |c| c.baro.fuse = false },
    Variant {
        name: "constant noise",
        change: |c| {
            c.uwb_noise = UwbNoise::Constant;
            c.std_uwb_m *= FLIGHT_LAMBDA.sqrt();
        },
    },
    Variant { name: "nine states alone", change: |c| c.clone_from(&nine_states()) },
    Variant { name: "nine states of the source", change: |c| *c = source(c) },
];

/// λ of the source above 1 m, where these flights are.
const FLIGHT_LAMBDA: f64 = 0.5;

/// The companion's filter without learned errors of the UWB.
fn nine_states() -> EstimatorConfig {
    // The defaults are no configuration that could be refused.
    Flown::nine_states().map_or_else(|_| EstimatorConfig::default(), |flown| flown.estimator)
}

/// The source's filter as published, for the vehicle of this one.
fn source(vehicle: &EstimatorConfig) -> EstimatorConfig {
    let published = EstimatorConfig::source_raw();
    EstimatorConfig {
        specific_force: vehicle.specific_force,
        acc_average_s: vehicle.acc_average_s,
        align_s: vehicle.align_s,
        rest_height_m: vehicle.rest_height_m,
        ..published
    }
}

/// How each variant went on each flight.
#[derive(Debug, Clone, Serialize)]
pub struct Ingredients {
    /// What was changed.
    pub variant: String,
    /// One for each flight.
    pub reports: Vec<FlightReport>,
}

/// Runs all variants of what flies. `tell` is told how far it is: done, of how many, what.
pub fn ingredients(
    flights: &[Flight],
    flown: &EstimatorConfig,
    mut tell: impl FnMut(usize, usize, &str),
) -> Vec<Ingredients> {
    let mut out = Vec::new();
    for (done, variant) in VARIANTS.iter().enumerate() {
        tell(done, VARIANTS.len(), variant.name);
        let reports = std::thread::scope(|scope| {
            let running: Vec<_> = flights
                .iter()
                .map(|f| scope.spawn(move || run_changed(f, flown, variant)))
                .collect();
            running.into_iter().filter_map(|r| r.join().ok()).collect()
        });
        out.push(Ingredients { variant: variant.name.to_owned(), reports });
    }
    out
}

fn run_changed(flight: &Flight, flown: &EstimatorConfig, variant: &Variant) -> FlightReport {
    let mut config = flown.clone();
    (variant.change)(&mut config);
    run_flight(flight, &config)
}

/// Writes the table as Markdown: airborne 3D rms, m, and the median of the whole flights, of each kind of flights.
pub fn print_ingredients(out: &mut impl Write, rows: &[Ingredients]) -> fmt::Result {
    writeln!(
        out,
        "| | with IMU: median | worst | whole flights | TDOA alone: median | worst | whole flights |\n\
         |---|---|---|---|---|---|---|"
    )?;
    for row in rows {
        write!(out, "| {} |", row.variant)?;
        for aided in [true, false] {
            let of = || row.reports.iter().filter(|r| r.aided_by_imu == aided);
            let airborne = || of().map(|r| r.rmse_3d_airborne_m);
            let worst = airborne()
                .collect::<Option<Vec<f64>>>()
                .and_then(|v| v.into_iter().reduce(f64::max));
            write!(
                out,
                " {} | {}{} | {} |",
                table::metres(table::median(airborne())),
                table::metres(worst),
                if of().any(|r| r.diverged) { " †" } else { "" },
                table::metres(table::median(of().map(|r| r.rmse_3d_m))),
            )?;
        }
        writeln!(out)?;
    }
    Ok(())
}
