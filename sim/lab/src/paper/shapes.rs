//! Section 4 of the source: a straight line, a square, a rhombus, a hexagon; error of the estimate
//! on each.

use anyhow::{Result, bail};
use haltere::named_missions::SHAPES;
use haltere::report::svg::{Mark, Plot, Series, Tone};
use haltere::report::verdict::Check;
use haltere_core::control::Version;
use haltere_model::PlantConfig;

use super::bench::Bench;
use super::results::{Cell, Claim, Figure, Line, Row, Section, Sense, Spread, Table};
use super::source;
use crate::paths::{PathScore, fly_path, on_path};
use crate::steps::AXES;

/// Simulated time of one shape with start and landing, s.
const FLIGHT_S: f64 = 45.0;
/// Radios of other quality: name, effects with a parameter each. The ends of the plausible ranges.
type Radio = (&'static str, &'static [(&'static str, &'static str, f64)]);
const BIAS: (&str, &str, f64) = ("N16", "std", 0.08);
const NOISE: (&str, &str, f64) = ("U1", "factor", 3.0);
const SURVEY: (&str, &str, f64) = ("U7", "north", 0.25);
const RADIOS: [Radio; 4] = [
    ("UWB path bias of 0.08 m instead of 0.035", &[BIAS]),
    ("UWB noise three times as large", &[NOISE]),
    ("one anchor 0.25 m from where the survey has it", &[SURVEY]),
    ("all three, the worst radio that recorded flights allow", &[BIAS, NOISE, SURVEY]),
];
const MAP_PX: [f64; 2] = [270.0, 260.0];

/// Simulated seconds of a repetition.
pub fn seconds() -> u64 {
    (SHAPES.len() * (1 + RADIOS.len())) as u64 * FLIGHT_S as u64
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    let mut cases: Vec<(Option<usize>, usize)> = (0..SHAPES.len()).map(|s| (None, s)).collect();
    for radio in 0..RADIOS.len() {
        cases.extend((0..SHAPES.len()).map(|s| (Some(radio), s)));
    }
    let flown = bench.each(&cases, FLIGHT_S, |(radio, shape), seed| {
        let mut plant = PlantConfig::hall(seed);
        let effects = radio.and_then(|r: usize| RADIOS.get(r)).map_or(&[][..], |(_, e)| e);
        for (id, name, value) in effects {
            plant.effects = plant.effects.with(id, &[(*name, *value)])?;
        }
        let (name, corners) = SHAPES[*shape];
        let (score, flight) = fly_path(&bench.pilot, Version::Modified, corners, plant)?;
        let path = on_path(&flight);
        if score.crashed || path.is_empty() {
            bail!("{name}, seed {seed}: not flown to its end; {}", flight.last_words());
        }
        let first = seed == bench.seed && radio.is_none();
        let thin = if first { path.iter().step_by(5).map(|s| **s).collect() } else { Vec::new() };
        Ok((score, thin))
    })?;
    let of = |radio: Option<usize>, shape: usize| {
        let at = cases.iter().position(|c| *c == (radio, shape)).unwrap_or_default();
        Spread::of(flown[at].iter().map(|(score, _)| score.estimate_m.iter().sum::<f64>() / 3.0))
    };
    let mut section = Section {
        method: "Setpoint along the shape at 0.5 m/s and 1.2 m height, version `modified`. Mean absolute \
                 error of estimate against truth from the first corner to the last."
            .into(),
        ..Section::default()
    };
    for (shape, (name, _)) in SHAPES.iter().enumerate() {
        let what = format!("{name}: estimate against truth, mean of x, y, z");
        let mut row = Row::new(what, "m", 3, of(None, shape), source::PATHS_M, Sense::Less);
        for (radio, (change, ..)) in RADIOS.iter().enumerate() {
            row = row.tried(*change, of(Some(radio), shape).mean);
        }
        section.rows.push(row);
    }
    section.lines.push(Line::new(
        Claim::of(&section.rows),
        format!(
            "Section 4, estimate on four paths: {} m (0.08 to 0.10); with the worst radio that recorded flights allow {}.",
            section.rows.iter().map(|r| format!("{:.3}", r.ours.mean)).collect::<Vec<_>>().join(", "),
            (0..SHAPES.len())
                .map(|shape| format!("{:.3}", of(Some(RADIOS.len() - 1), shape).mean))
                .collect::<Vec<_>>()
                .join(", ")
        ),
    ));
    let mut rows = Vec::new();
    for ((name, _), flown) in SHAPES.iter().zip(&flown) {
        let mut line = vec![Cell::from(*name)];
        let picks: [fn(&PathScore) -> [f64; 3]; 2] = [|s| s.estimate_m, |s| s.tracking_m];
        for pick in picks {
            for axis in 0..3 {
                line.push(Cell::Spread(Spread::of(flown.iter().map(|f| pick(&f.0)[axis])), 3));
            }
        }
        for (axis, axis_name) in AXES.iter().enumerate() {
            let worst = flown.iter().map(|f| f.0.estimate_m[axis]).fold(0.0, f64::max);
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
    });
    let plots = SHAPES
        .iter()
        .zip(&flown)
        .map(|((name, _), flown)| {
            let path = &flown[0].1;
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
