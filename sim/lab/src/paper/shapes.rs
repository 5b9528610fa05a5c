//! Section 4 of the source: a straight line, a square, a rhombus, a hexagon; error of the estimate
//! on each.

use anyhow::{Result, bail};
use haltere::named_missions::SHAPES;
use haltere::report::svg::{Mark, Plot, Series, Tone};
use haltere::report::verdict::Check;
use haltere_core::control::Version;
use haltere_model::PlantConfig;
use haltere_pilot::PilotConfig;

use super::bench::Bench;
use super::results::{Cell, Claim, Figure, Line, Row, Section, Sense, Spread, Table};
use super::source;
use crate::paths::{PathScore, fly_path, on_path};
use crate::steps::AXES;

/// Simulated time of one shape with start and landing, s.
const FLIGHT_S: f64 = 45.0;
/// Radios: as simulated, and with the errors of recorded rooms. Those of a pair that stay and those that wander are 0.07 and
/// 0.05 m in a clear room, 0.15 and 0.12 m in cluttered ones (docs/RANGING.md); of a path they are smaller by √2.
type Radio = (&'static str, &'static [(&'static str, f64)]);
const RADIOS: [Radio; 3] = [
    ("as simulated", &[]),
    ("radio of a clear recorded room", &[("std", 0.035), ("constant", 0.049)]),
    ("radio of a cluttered recorded room", &[("std", 0.085), ("constant", 0.106)]),
];
/// The versions that are flown: as printed, as shipped.
const VERSIONS: [Version; 2] = [Version::Paper, Version::Modified];
const MAP_PX: [f64; 2] = [270.0, 260.0];

/// Simulated seconds of a repetition.
pub fn seconds() -> u64 {
    (SHAPES.len() * RADIOS.len() * VERSIONS.len()) as u64 * FLIGHT_S as u64
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    // As shipped with the simulated radio first: what is drawn and tabled.
    let mut cases: Vec<(usize, usize, usize)> = Vec::new();
    for radio in 0..RADIOS.len() {
        for version in [1, 0] {
            cases.extend((0..SHAPES.len()).map(|shape| (radio, version, shape)));
        }
    }
    let both = bench.both(Version::Paper);
    let flown = bench.each(&cases, FLIGHT_S, |(radio, version, shape), seed| {
        let mut plant = PlantConfig::hall(seed);
        if *radio > 0 {
            plant.effects = plant.effects.with("N16", RADIOS[*radio].1)?;
        }
        let (name, corners) = SHAPES[*shape];
        let pilot = PilotConfig { control: both[*version].clone(), ..bench.pilot.clone() };
        let (score, flight) = fly_path(&pilot, VERSIONS[*version], corners, plant)?;
        let path = on_path(&flight);
        if score.crashed || path.is_empty() {
            // The source's filter has nothing against a cluttered room; such a flight has no error.
            if *version == 0 {
                return Ok(None);
            }
            bail!("{name}, seed {seed}: not flown to its end; {}", flight.last_words());
        }
        let first = seed == bench.seed && (*radio, *version) == (0, 1);
        let thin = if first { path.iter().step_by(5).map(|s| **s).collect() } else { Vec::new() };
        Ok(Some((score, thin)))
    })?;
    let of = |radio: usize, version: usize, shape: usize| {
        let at = cases.iter().position(|c| *c == (radio, version, shape)).unwrap_or_default();
        let flights = flown[at].iter().flatten();
        Spread::of(flights.map(|(score, _)| score.estimate_m.iter().sum::<f64>() / 3.0))
    };
    let fell = flown.iter().flatten().filter(|f| f.is_none()).count();
    let mut section = Section {
        method: format!(
            "Setpoint along the shape at 0.5 m/s and 1.2 m height. Mean absolute error of estimate against truth from \
                 the first corner to the last, mean of x, y and z. The simulated radio is kinder than recorded ones: beside \
                 it stand radios whose errors are those of recorded rooms, with the bias in space that they have. {fell} flights as printed \
                 fell and are left out."
        ),
        ..Section::default()
    };
    for (radio, (radio_name, _)) in RADIOS.iter().enumerate() {
        for (shape, (name, _)) in SHAPES.iter().enumerate() {
            let what = format!("{name}, {radio_name}");
            let ours = of(radio, 1, shape);
            let mut row = Row::new(what, "m", 3, ours, source::PATHS_M, Sense::Less);
            row.printed = Some(of(radio, 0, shape));
            row.kinder = radio == 0;
            if radio == 0 {
                for (k, (change, _)) in RADIOS.iter().enumerate().skip(1) {
                    row = row.tried(*change, of(k, 0, shape).mean);
                }
            }
            section.rows.push(row);
        }
    }
    let mean = |radio: usize, version: usize| {
        (0..SHAPES.len()).map(|shape| of(radio, version, shape).mean).sum::<f64>()
            / SHAPES.len() as f64
    };
    let recorded = &section.rows[SHAPES.len()..];
    section.lines.push(Line::new(
        Claim::of(recorded),
        format!(
            "Section 4, estimate on four paths (0.08 to 0.10 m): as printed {:.3} m with the radio of a clear recorded room \
             and {:.3} m of a cluttered one, as shipped {:.3} and {:.3}; {:.3} and {:.3} in the kinder world that is simulated.",
            mean(1, 0),
            mean(2, 0),
            mean(1, 1),
            mean(2, 1),
            mean(0, 0),
            mean(0, 1)
        ),
    ));
    let mut rows = Vec::new();
    for ((name, _), flown) in SHAPES.iter().zip(&flown) {
        let mut line = vec![Cell::from(*name)];
        let picks: [fn(&PathScore) -> [f64; 3]; 2] = [|s| s.estimate_m, |s| s.tracking_m];
        for pick in picks {
            for axis in 0..3 {
                let values = flown.iter().flatten().map(|f| pick(&f.0)[axis]);
                line.push(Cell::Spread(Spread::of(values), 3));
            }
        }
        for (axis, axis_name) in AXES.iter().enumerate() {
            let worst = flown.iter().flatten().map(|f| f.0.estimate_m[axis]).fold(0.0, f64::max);
            let name = format!("{name}, estimate in {axis_name}, worst flight");
            section.targets.push(Check::at_most(name, Some(worst), source::PATHS_M.range[1], "m"));
        }
        rows.push(line);
    }
    let columns = ["shape", "est. x", "est. y", "est. z", "track x", "track y", "track z"];
    section.tables.push(Table {
        title:
            "Mean absolute error on the shapes, m: estimate against truth, truth against setpoint"
                .into(),
        columns: columns.map(String::from).to_vec(),
        rows,
        note: String::new(),
        ..Table::default()
    });
    let plots = SHAPES
        .iter()
        .zip(&flown)
        .map(|((name, _), flown)| {
            let path = flown.iter().flatten().next().map_or(&[][..], |f| &f.1);
            let line = |name: &str, tone, mark, pick: &dyn Fn(usize) -> Option<[f64; 2]>| Series {
                name: name.into(),
                tone,
                mark,
                points: (0..path.len()).filter_map(pick).collect(),
            };
            Plot {
                title: (*name).into(),
                x_label: "east, m".into(),
                y_label: "north, m".into(),
                series: vec![
                    line("", Tone::Truth, Mark::Line, &|i| {
                        Some([path[i].truth.pos_E_m.y(), path[i].truth.pos_E_m.x()])
                    }),
                    line("", Tone::Estimate, Mark::Line, &|i| {
                        Some([path[i].estimate.pos_E_m.y(), path[i].estimate.pos_E_m.x()])
                    }),
                    line("", Tone::Command, Mark::Dashed, &|i| {
                        let [north, east, _] = path[i].control.pos_setpoint_E_m;
                        Some([east?, north?])
                    }),
                ],
                equal: true,
                size_px: MAP_PX,
                ..Plot::default()
            }
        })
        .collect();
    section.figures.push(Figure {
        name: "Shapes",
        caption: "From above, first repetition: truth (heavy), estimate, setpoint (dashed).".into(),
        plots,
    });
    Ok(section)
}
