//! Figure 7: throttle in hover against battery voltage, polynomials of order 1 to 3 and their R².
//!
//! **What R² says here.** With a law that is right, R² = 1 − s²/(s² + r²): s the scatter of the
//! throttle about the law, r the spread that the law itself makes over the range of voltages. It
//! measures how calm the hover was and how far the battery was emptied, not how good the law is.

use anyhow::{Context, Result, bail};
use haltere::fit::polynomial::{OverVoltage, fit};
use haltere::report::svg::{Mark, Plot, Series, Tone};
use haltere_core::control::{ControlConfig, Version};
use haltere_dialect::mav::haltere::MavCmd;
use haltere_model::PlantConfig;

use super::bench::{Bench, Plan, leg};
use super::results::{Cell, Claim, Figure, Line, Row, Section, Sense, Spread, Table};
use super::source;
use crate::steps::item;

/// Voltage that the polynomials are about, V: two cells, as the source has.
const CENTRE_V: f64 = 7.4;
/// Height of the hover, m, and what its start leaves out, s.
const HEIGHT_M: f64 = 1.2;
const SETTLE_S: f64 = 5.0;
/// Hovers until this voltage, V: just above the critical 6.0 V.
const UNTIL_V: f64 = 6.1;
/// Longest hover and simulated time of a flight, s.
const LONGEST_S: f64 = 400.0;
const FLIGHT_S: f64 = 300.0;
/// Points are taken this often, in control steps: 10 Hz.
const EVERY: usize = 10;
/// Points that are averaged: none, 0.5 s, which stands for the filter of the source, 1 s, 2 s.
const AVERAGES: [usize; 4] = [1, 5, 10, 20];
const FILTERED: usize = 1;
/// The exponent that recorded flights of this vehicle show.
const RECORDED_EXPONENT: f64 = -1.01;
const PLOT_PX: [f64; 2] = [1100.0, 300.0];
/// Flapping vibration on the IMU.
const VIBRATION: &str = "N9";

/// Simulated seconds of a repetition.
pub fn seconds() -> u64 {
    3 * FLIGHT_S as u64
}

/// Time, s, voltage, V, and throttle, 0 to 1, of one hover.
type Points = Vec<[f64; 3]>;

fn hover(bench: &Bench, plant: PlantConfig, control: &ControlConfig, seed: u64) -> Result<Points> {
    let mut plan = Plan::from_height(HEIGHT_M, LONGEST_S + 60.0);
    let start = plan.step([0.0, 0.0, HEIGHT_M], SETTLE_S);
    let mut wait = item(MavCmd::MAV_CMD_USER_3, [0.0; 3]);
    wait.param1 = UNTIL_V as f32;
    wait.param2 = LONGEST_S as f32;
    plan.items.push(wait);
    let flight = bench.fly_in(plant, control, &plan.land())?;
    let points: Points = leg(&flight, start)
        .iter()
        .skip((SETTLE_S * 100.0) as usize)
        .step_by(EVERY)
        .map(|s| [s.t_us as f64 * 1e-6, s.truth.supply_v, s.control.thrust_frac])
        .collect();
    if points.len() < 100 {
        bail!("seed {seed}: {} points of hover; {}", points.len(), flight.texts.join("; "));
    }
    Ok(points)
}

/// Means of so many points.
fn averaged(points: &Points, count: usize) -> Points {
    let mean =
        |chunk: &[[f64; 3]], k: usize| chunk.iter().map(|p| p[k]).sum::<f64>() / chunk.len() as f64;
    points.chunks_exact(count).map(|c| std::array::from_fn(|k| mean(c, k))).collect()
}

fn fitted(points: &Points) -> Result<OverVoltage> {
    let column = |k: usize| points.iter().map(|p| p[k]).collect::<Vec<f64>>();
    Ok(fit(&column(0), &column(1), &column(2), CENTRE_V)?)
}

fn r_squared(law: &OverVoltage, order: usize) -> f64 {
    law.polynomials.iter().find(|p| p.order == order).map_or(f64::NAN, |p| p.r_squared)
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    // Standard errors over a whole battery take their time: every flight is fitted where it is flown.
    let [printed, shipped] = bench.both(Version::Raw);
    let cases = [(printed, true), (shipped.clone(), true), (shipped, false)];
    let flown = bench.each(&cases, FLIGHT_S, |(control, vibration), seed| {
        let mut plant = PlantConfig::hall(seed);
        if !vibration {
            plant.effects = plant.effects.without(VIBRATION)?;
        }
        let points = hover(bench, plant, control, seed)?;
        let laws = AVERAGES.map(|count| fitted(&averaged(&points, count)));
        Ok((points, laws.into_iter().collect::<Result<Vec<OverVoltage>>>()?))
    })?;
    let [printed, nominal, calm] = &flown[..] else { bail!("three cases were flown") };
    let mut section = Section {
        method: format!(
            "Hover at {HEIGHT_M} m from a full battery down to {UNTIL_V} V, version `raw`; throttle and voltage ten times \
             a second, fitted by the same code as `haltere fit`. The source filters its points, without saying how: averages \
             over 0.5 s stand for it."
        ),
        ..Section::default()
    };
    for order in 1..=3 {
        let of = |flown: &[(Points, Vec<OverVoltage>)], k: usize| {
            Spread::of(flown.iter().map(|(_, laws)| r_squared(&laws[k], order)))
        };
        let what = format!("R\u{b2} of order {order}, points filtered");
        let ours = of(nominal, FILTERED);
        let mut row = Row::new(what, "", 3, ours, source::THRUST_R2, Sense::Equal);
        row.printed = Some(of(printed, FILTERED));
        for (k, count) in AVERAGES.iter().enumerate().filter(|(k, _)| *k != FILTERED) {
            let seconds = (count * EVERY) as f64 * 0.01;
            row = row.tried(format!("points averaged over {seconds} s"), of(printed, k).mean);
        }
        section.rows.push(row.tried("no flapping vibration on the IMU", of(calm, FILTERED).mean));
    }
    let orders = |flown: &[(Points, Vec<OverVoltage>)]| {
        let of = |order| Spread::of(flown.iter().map(|f| r_squared(&f.1[FILTERED], order)));
        [1, 2, 3].map(|order| format!("{:.3}", of(order).mean)).join(", ")
    };
    section.lines.push(Line::new(
        Claim::of(&section.rows),
        format!(
            "Figure 7, throttle over voltage, points filtered: R\u{b2} of orders 1 to 3 is {} as printed, {} as shipped (0.756 \
             each): order does not matter.",
            orders(printed),
            orders(nominal)
        ),
    ));
    let exponent =
        |k: usize| Spread::of(nominal.iter().map(|f| f.1[k].power.exponent.value)).text(2);
    section.findings.push(format!(
        "Throttle goes with the voltage to the power of {} point by point, where every burst of throttle pulls the voltage \
         down with it, and of {} averaged over 2 s (recorded flights of this vehicle, from which the motor law of the simulator \
         was taken: {RECORDED_EXPONENT}). What R\u{b2} leaves is the scatter of the throttle, not the law.",
        exponent(0),
        exponent(AVERAGES.len() - 1),
    ));
    let first = nominal.first().context("no hover was flown")?;
    let law = &first.1[FILTERED];
    section.tables.push(table(law));
    let colours = [Tone::Estimate, Tone::Command, Tone::Family(2)];
    let [low, high] = law.range_v;
    let mut series = vec![Series {
        name: "points, unfiltered".into(),
        tone: Tone::Family(0),
        mark: Mark::Dots,
        points: first.0.iter().map(|p| [p[1], p[2]]).collect(),
    }];
    for (polynomial, tone) in law.polynomials.iter().zip(colours) {
        series.push(Series {
            name: format!("order {}", polynomial.order),
            tone,
            mark: Mark::Line,
            points: (0..=40)
                .map(|i| low + (high - low) * f64::from(i) / 40.0)
                .map(|v| [v, polynomial.at(v)])
                .collect(),
        });
    }
    section.figures.push(Figure {
        name: "Figure 7",
        caption: "Throttle in hover against voltage, first repetition.".into(),
        plots: vec![Plot {
            title: "Hover".into(),
            x_label: "battery, V".into(),
            y_label: "share of full throttle".into(),
            series,
            size_px: PLOT_PX,
            ..Plot::default()
        }],
    });
    Ok(section)
}

fn table(law: &OverVoltage) -> Table {
    let mut rows: Vec<Vec<Cell>> = law
        .polynomials
        .iter()
        .map(|p| {
            let coefficients: Vec<String> = p
                .coefficients
                .iter()
                .map(|c| format!("{:.4} \u{b1} {:.4}", c.value, c.std))
                .collect();
            vec![
                Cell::from(format!("order {}", p.order)),
                Cell::from(coefficients.join(", ")),
                Cell::from(format!("{:.3}", p.r_squared)),
                Cell::from(format!("{:.4}", p.residual)),
            ]
        })
        .collect();
    let power = &law.power;
    rows.push(vec![
        Cell::from("power of V"),
        Cell::from(format!(
            "exponent {:.3} \u{b1} {:.3}, {:.4} \u{b1} {:.4} at {CENTRE_V} V",
            power.exponent.value, power.exponent.std, power.at_centre.value, power.at_centre.std
        )),
        Cell::from(format!("{:.3}", power.r_squared)),
        Cell::from(format!("{:.4}", power.residual)),
    ]);
    Table {
        title: "Laws of the first repetition".into(),
        columns: ["", "coefficients \u{b1} standard error", "R\u{b2}", "left, share of full"]
            .map(String::from)
            .to_vec(),
        rows,
        note: format!(
            "Coefficients of (V \u{2212} {CENTRE_V} V) to the power 0, 1, \u{2026}; {} points from {:.2} to {:.2} V.",
            law.samples, law.range_v[0], law.range_v[1]
        ),
        ..Table::default()
    }
}
