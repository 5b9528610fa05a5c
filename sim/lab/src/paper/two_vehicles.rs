//! Figure 6: final speed against lean for two vehicles, and the saturating exponential through it.

use anyhow::{Context, Result};
use haltere::fit::steady::{Form, Law, Point, Steady, fit};
use haltere::report::svg::{Mark, Plot, Series, Tone};
use haltere_model::Vehicle;

use super::angle_steps::{AXES, FLIGHT_S, fly_step};
use super::bench::Bench;
use super::results::{Cell, Claim, Figure, Line, Row, Section, Sense, Source, Spread, Table};
use super::source;

/// The second vehicle.
const NIMBLE: &str = include_str!("../../../vehicles/delfly-nimble.toml");
/// Forms in the order of the table.
const FORMS: [(Form, &str); 4] = [
    (Form::AngleOfVelocity, "exponential, lean of speed"),
    (Form::VelocityOfAngle, "exponential, speed of lean"),
    (Form::Linear, "line"),
    (Form::Quadratic, "parabola"),
];
/// A law that leaves less than a twentieth of the variance fits.
const GOOD_R2: f64 = 0.95;
const PLOT_PX: [f64; 2] = [540.0, 300.0];

/// Simulated seconds of a repetition.
pub fn seconds() -> u64 {
    2 * source::ANGLES_DEG.concat().len() as u64 * FLIGHT_S as u64
}

/// Both vehicles.
fn vehicles() -> Result<[Vehicle; 2]> {
    Ok([Vehicle::default(), Vehicle::from_toml(NIMBLE).context("vehicles/delfly-nimble.toml")?])
}

/// Drag over mass at the flap rate of hover, along a body axis, 1/s: what the law must begin with.
fn drag_per_s(vehicle: &Vehicle, axis: usize) -> f64 {
    vehicle.drag.k_ns_per_m_hz[axis] * 2.0 * vehicle.hover_hz() / vehicle.body.mass_kg
}

/// Lean that a fitted exponential gives at 1 m/s, deg.
fn lean_at_1_mps_deg(law: &Law) -> Option<f64> {
    match law.parameters.iter().map(|p| p.1.value).collect::<Vec<f64>>()[..] {
        [a, b, c] => Some(-(a + b * (-c).exp())),
        _ => None,
    }
}

/// All repetitions of one vehicle and axis, and the laws through them.
struct Curve {
    /// By repetition.
    points: Vec<Vec<Point>>,
    law: Steady,
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    let vehicles = vehicles()?;
    let mut cases = Vec::new();
    for vehicle in 0..vehicles.len() {
        for (axis, angles) in source::ANGLES_DEG.iter().enumerate() {
            cases.extend(angles.iter().map(|angle| (vehicle, axis, *angle)));
        }
    }
    let flown = bench.each(&cases, FLIGHT_S, |(vehicle, axis, angle_deg), seed| {
        let step = fly_step(bench, &vehicles[*vehicle], *axis, *angle_deg, seed)?;
        Ok(step.map(|s| Point { lean_deg: *angle_deg, speed_mps: s.final_mps, std_mps: 0.0 }))
    })?;
    let refused = flown.iter().flatten().filter(|p| p.is_none()).count();
    let curve = |vehicle: usize, axis: usize| -> Result<Curve> {
        let points: Vec<Vec<Point>> = (0..bench.repetitions as usize)
            .map(|i| {
                let of = cases.iter().zip(&flown).filter(|(c, _)| c.0 == vehicle && c.1 == axis);
                of.filter_map(|(_, flown)| *flown.get(i)?).collect()
            })
            .collect();
        let law = fit(&points.concat())
            .with_context(|| format!("{}, {}", vehicles[vehicle].name, AXES[axis]))?;
        Ok(Curve { points, law })
    };
    let mut curves = Vec::new();
    for vehicle in 0..vehicles.len() {
        curves.push([curve(vehicle, 0)?, curve(vehicle, 1)?]);
    }
    let mut section = Section {
        method: format!(
            "Speeds that angle steps end at (as in experiment 3, {} flights, {refused} refused for want of \
             thrust), and four forms through all repetitions, fitted by the same code as `haltere fit`. The second \
             vehicle is one like the 33 cm DelFly Nimble (vehicles/delfly-nimble.toml).",
            flown.len() * bench.repetitions as usize
        ),
        ..Section::default()
    };
    rows(&mut section, &vehicles, &curves);
    for (axis, name) in AXES.iter().enumerate() {
        section.tables.push(table(axis, name, &vehicles, &curves));
    }
    section.figures.push(figure(&vehicles, &curves));
    Ok(section)
}

fn rows(section: &mut Section, vehicles: &[Vehicle; 2], curves: &[[Curve; 2]]) {
    let [a, b, c] = source::DRAG_START;
    let start = Source::number(-(a + b * (-c).exp()), "starting values of the fit");
    let leans =
        |vehicle: usize, axis: usize| {
            Spread::of(curves[vehicle][axis].points.iter().filter_map(|points| {
                lean_at_1_mps_deg(fit(points).ok()?.law(Form::AngleOfVelocity)?)
            }))
        };
    let what = format!("{}, lean in {} at 1 m/s by the law", vehicles[0].name, AXES[0]);
    section.rows.push(
        Row::new(what, "deg", 1, leans(0, 0), start, Sense::Equal)
            .tried("the second vehicle", leans(1, 0).mean),
    );
    section.tables.push(Table {
        title: "Lean at 1 m/s by the exponential, deg".into(),
        columns: std::iter::once("").chain(AXES).map(String::from).collect(),
        rows: vehicles
            .iter()
            .enumerate()
            .map(|(v, vehicle)| {
                let cells = (0..AXES.len()).map(|axis| Cell::Spread(leans(v, axis), 1));
                std::iter::once(Cell::from(vehicle.name.as_str())).chain(cells).collect()
            })
            .collect(),
        note: String::new(),
        ..Table::default()
    });
    let fits: Vec<f64> = curves
        .iter()
        .flatten()
        .filter_map(|curve| Some(curve.law.exponential()?.r_squared))
        .collect();
    let least = fits.iter().copied().fold(f64::INFINITY, f64::min);
    let exponential =
        |c: &&Curve| matches!(c.law.chosen, Form::AngleOfVelocity | Form::VelocityOfAngle);
    let picked = curves.iter().flatten().filter(exponential).count();
    section.lines.push(Line::new(
        if picked == 4 && least > GOOD_R2 { Claim::Reproduced } else { Claim::Partly },
        format!(
            "Figure 6, one exponential for two vehicles, pitch and roll: R\u{b2} {least:.3} at least, picked over line and parabola \
             in {picked} of 4; lean at 1 m/s {} (its starting values, which are no result: {:.1}\u{b0}).",
            leans(0, 0).text(1),
            start.range[0]
        ),
    ));
    let chosen: Vec<String> = vehicles
        .iter()
        .zip(curves)
        .flat_map(|(vehicle, curves)| {
            curves.iter().enumerate().map(|(axis, curve)| {
                let name = FORMS.iter().find(|f| f.0 == curve.law.chosen).map_or("", |f| f.1);
                let law = curve.law.law(Form::AngleOfVelocity);
                let at_rest = law.map_or(f64::NAN, |l| l.drag_per_s.value);
                format!(
                    "{} {}: {name}; {at_rest:.2} 1/s ({:.2})",
                    vehicle.name,
                    AXES[axis],
                    drag_per_s(vehicle, axis)
                )
            })
        })
        .collect();
    section.findings.push(format!(
        "Form with the least AICc, then drag at rest as the exponential \u{201c}lean of speed\u{201d} has it, and in \
         brackets what is simulated at the flap rate of hover: {}. The source's v(\u{3b8}) is to converge towards 90\u{b0}; drag \
         linear in speed has v = g\u{b7}tan \u{3b8}/k, which does not, and neither does our default \u{3b8}(v), whose lean converges \
         instead. As printed flies v(\u{3b8}), its coefficients from 23\u{b0} at 1 and 41\u{b0} at 2 m/s, where both hold the same drag.",
        chosen.join("; ")
    ));
}

fn table(axis: usize, name: &str, vehicles: &[Vehicle; 2], curves: &[[Curve; 2]]) -> Table {
    let mut rows = Vec::new();
    for (vehicle, curves) in vehicles.iter().zip(curves) {
        let steady = &curves[axis].law;
        for (form, label) in FORMS {
            let Some(law) = steady.law(form) else { continue };
            let value =
                |v: &haltere::fit::Value, d: usize| format!("{:.d$} \u{b1} {:.d$}", v.value, v.std);
            let parameters = law
                .parameters
                .iter()
                .map(|(name, v)| {
                    let digits = if v.value.abs() < 0.1 { 5 } else { 3 };
                    format!("{} {}", name.split(' ').next().unwrap_or(name), value(v, digits))
                })
                .collect::<Vec<_>>()
                .join(", ");
            rows.push(vec![
                Cell::from(format!(
                    "{}, {label}{}{}",
                    vehicle.name,
                    if steady.chosen == form { " \u{2190} least AICc" } else { "" },
                    if law.at_bound { " (at the end of its range)" } else { "" }
                )),
                Cell::from(if law.at_bound { String::new() } else { parameters }),
                Cell::from(value(&law.drag_per_s, 2)),
                Cell::from(format!("{:.4}", law.r_squared)),
                Cell::from(format!("{:.3}", law.residual_mps)),
                Cell::from(format!("{:.1}", law.aicc)),
            ]);
        }
    }
    Table {
        title: format!("Laws in {name}"),
        columns: [
            "",
            "parameters \u{b1} standard error",
            "drag at rest, 1/s",
            "R\u{b2}",
            "left, m/s",
            "AICc",
        ]
        .map(String::from)
        .to_vec(),
        rows,
        note: "Lean in degrees, speed in m/s, both counted towards the motion.".into(),
        ..Table::default()
    }
}

fn figure(vehicles: &[Vehicle; 2], curves: &[[Curve; 2]]) -> Figure {
    let plots = (0..AXES.len())
        .map(|axis| {
            let mut series = Vec::new();
            for ((vehicle, curves), tone) in
                vehicles.iter().zip(curves).zip([Tone::Estimate, Tone::Command])
            {
                let curve = &curves[axis];
                if let Some(law) = curve.law.exponential() {
                    let [low, high] = curve.law.tested_lean_deg;
                    series.push(Series {
                        name: vehicle.name.clone(),
                        tone,
                        mark: Mark::Line,
                        points: (0..=40)
                            .map(|i| low + (high - low) * f64::from(i) / 40.0)
                            .map(|lean| [lean, law.speed_mps(lean)])
                            .collect(),
                    });
                }
                series.push(Series {
                    name: String::new(),
                    tone,
                    mark: Mark::Dots,
                    points: curve
                        .points
                        .concat()
                        .iter()
                        .map(|p| [p.lean_deg, p.speed_mps])
                        .collect(),
                });
            }
            if axis == 0 {
                let [a, b, c] = source::DRAG_START;
                series.push(Series {
                    name: "start values".into(),
                    tone: Tone::Truth,
                    mark: Mark::Dashed,
                    points: (0..=40)
                        .map(|i| f64::from(i) * 0.07)
                        .map(|v| [-(a + b * (-c * v).exp()), v])
                        .filter(|p| (12.0..=52.0).contains(&p[0]))
                        .collect(),
                });
            }
            Plot {
                title: format!("Steps in {}", AXES[axis]),
                x_label: "lean, deg".into(),
                y_label: "m/s".into(),
                series,
                size_px: PLOT_PX,
                ..Plot::default()
            }
        })
        .collect();
    Figure {
        name: "Figure 6",
        caption: "Final speed against lean, every repetition, and the exponential through them."
            .into(),
        plots,
    }
}
