//! Figure 3: standing at the origin for 8 s, UWB noise constant or by height, error per axis.
//!
//! The same measurements go through filters that differ in the variance of a TDOA alone:
//! R = λ(ẑ)σ² with λ = 1 on the floor and 0.5 from 1 m on, or R = 0.5σ² everywhere, which is what is
//! right in flight. A constant λ = 1 equals the variable one on the floor by the equation; it is
//! flown too, so that this is seen.

use anyhow::Result;
use haltere::control::Version;
use haltere::estimator::{EstimatorConfig, UwbNoise};
use haltere::model::PlantConfig;
use haltere::report::svg::{Mark, Plot, Series, Tone};

use super::bench::Bench;
use super::results::{Cell, Figure, Row, Section, Spread, Table};
use super::standing::Standing;
use crate::steps::AXES;

/// How long it stands, s (source).
const STAND_S: f64 = 8.0;
/// λ of the source at flight heights.
const FLIGHT_LAMBDA: f64 = 0.5;
const PLOT_PX: [f64; 2] = [540.0, 200.0];

/// Simulated seconds.
pub fn cost(bench: &Bench) -> u64 {
    bench.cost(1, STAND_S)
}

/// What one standing showed.
struct Stood {
    /// Mean |error|, by filter and axis, m.
    mae_m: Vec<[f64; 3]>,
    /// Time, s, and error, m, by filter.
    traces: Vec<Vec<(f64, [f64; 3])>>,
}

/// The filters by name.
fn filters(bench: &Bench) -> [(&'static str, EstimatorConfig); 3] {
    let mut pilot = bench.pilot.clone();
    pilot.control = bench.version(Version::Raw);
    let raw = pilot.estimator_in_force();
    let flight_std_m = raw.std_uwb_m * FLIGHT_LAMBDA.sqrt();
    [
        ("constant, \u{3bb} = 0.5", EstimatorConfig { std_uwb_m: flight_std_m, ..raw.clone() }),
        ("variable", EstimatorConfig { uwb_noise: UwbNoise::HeightDependent, ..raw.clone() }),
        ("constant, \u{3bb} = 1", raw),
    ]
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    let filters = filters(bench);
    let stood = bench.each(&[()], STAND_S, |(), seed| {
        let standing = Standing::record(bench, PlantConfig::hall(seed), STAND_S)?;
        let mut stood = Stood { mae_m: Vec::new(), traces: Vec::new() };
        for (_, config) in &filters {
            let states = standing.filter(config)?;
            let errors: Vec<(f64, [f64; 3])> = states
                .iter()
                .map(|e| (standing.since_s(e.at), standing.error_E_m(e).to_array()))
                .collect();
            stood.mae_m.push(std::array::from_fn(|axis| {
                errors.iter().map(|(_, e)| e[axis].abs()).sum::<f64>() / errors.len() as f64
            }));
            stood.traces.push(errors);
        }
        Ok(stood)
    })?;
    let stood = &stood[0];
    let of = |filter: usize, axis: usize| Spread::of(stood.iter().map(|s| s.mae_m[filter][axis]));
    let mut section = Section {
        method: format!(
            "Standing with motors off in the middle of the hall for {STAND_S:.0} s. All filters see \
             the same measurements, start at the true place, and are not told that the vehicle stands \
             (the companion's filter is, and then holds zero velocity). The source does not state the \
             size of its constant noise: taken as what the variable one is in flight, half of what it \
             is on the floor."
        ),
        ..Section::default()
    };
    let mut rows = Vec::new();
    for (k, (name, _)) in filters.iter().enumerate() {
        let mut row = vec![Cell::from(*name)];
        row.extend((0..3).map(|axis| Cell::Spread(of(k, axis), 3)));
        rows.push(row);
    }
    for (axis, name) in AXES.iter().enumerate() {
        let ratio = stood.iter().map(|s| s.mae_m[0][axis] / s.mae_m[1][axis]);
        let what = format!("error in {name}, constant over variable noise");
        section.rows.push(Row::new(what, "", 2, Spread::of(ratio)));
    }
    section.tables.push(Table {
        title: "Mean absolute error while standing, m".into(),
        columns: ["UWB noise", "x", "y", "z"].map(String::from).to_vec(),
        rows,
        note: String::new(),
    });
    let same = stood.iter().all(|s| s.mae_m[1] == s.mae_m[2]);
    section.findings.push(format!(
        "A constant noise of \u{3bb} = 1 {} the variable one on the floor, as the equation says: the \
         gain near the floor is a gain over a filter that is tuned for flight.",
        if same { "equals" } else { "does not exactly equal" }
    ));
    let plots = (0..3)
        .map(|axis| Plot {
            title: format!("Error in {}, first repetition", AXES[axis]),
            x_label: "s".into(),
            y_label: "m".into(),
            series: stood[0].traces[..2]
                .iter()
                .zip(["constant", "variable"])
                .zip([Tone::Command, Tone::Estimate])
                .map(|((trace, name), tone)| Series {
                    name: name.into(),
                    tone,
                    mark: Mark::Line,
                    points: trace.iter().map(|(t, e)| [*t, e[axis]]).collect(),
                })
                .collect(),
            size_px: PLOT_PX,
            least_height: 0.1,
            ..Plot::default()
        })
        .collect();
    section.figures.push(Figure {
        name: "Figure 3",
        caption: "Standing at the origin: error of the estimate with constant and with variable UWB \
                  noise."
            .into(),
        plots,
    });
    Ok(section)
}
