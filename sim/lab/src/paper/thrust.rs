//! Figure 7: throttle in hover against battery voltage, polynomials of order 1 to 3 and their R².
//!
//! **What R² says here.** With a law that is right, R² = 1 − s²/(s² + r²): s the scatter of the
//! throttle about the law, r the spread that the law itself makes over the range of voltages. It
//! measures how calm the hover was and how far the battery was emptied, not how good the law is.

use anyhow::{Context, Result, bail};
use haltere::fit::polynomial::{OverVoltage, fit};
use haltere::report::svg::{Mark, Plot, Series, Tone};
use haltere_core::control::Version;
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
/// Points that are averaged in trials: 0.5 s, 1 s, 2 s.
const AVERAGES: [usize; 3] = [5, 10, 20];
/// The exponent that recorded flights of this vehicle show.
const RECORDED_EXPONENT: f64 = -1.01;
const PLOT_PX: [f64; 2] = [1100.0, 300.0];
/// Flapping vibration on the IMU.
const VIBRATION: &str = "N9";

/// Simulated seconds of a repetition.
pub fn seconds() -> u64 {
    2 * FLIGHT_S as u64
}

/// Time, s, voltage, V, and throttle, 0 to 1, of one hover.
type Points = Vec<[f64; 3]>;

fn hover(bench: &Bench, plant: PlantConfig, seed: u64) -> Result<Points> {
    let mut plan = Plan::from_height(HEIGHT_M, LONGEST_S + 60.0);
    let start = plan.step([0.0, 0.0, HEIGHT_M], SETTLE_S);
    let mut wait = item(MavCmd::MAV_CMD_USER_3, [0.0; 3]);
    wait.param1 = UNTIL_V as f32;
    wait.param2 = LONGEST_S as f32;
    plan.items.push(wait);
    let flight = bench.fly_in(plant, &bench.version(Version::Raw), &plan.land())?;
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
    let flown = bench.each(&[true, false], FLIGHT_S, |vibration, seed| {
        let mut plant = PlantConfig::hall(seed);
        if !vibration {
            plant.effects = plant.effects.without(VIBRATION)?;
        }
        let points = hover(bench, plant, seed)?;
        let law = fitted(&points)?;
        let mut means = Vec::new();
        if *vibration {
            for count in AVERAGES {
                means.push(fitted(&averaged(&points, count))?);
            }
        }
        Ok((points, law, means))
    })?;
    let [nominal, calm] = &flown[..] else { bail!("two worlds were flown") };
    let mut section = Section {
        method: format!(
            "Hover at {HEIGHT_M} m from a full battery down to {UNTIL_V} V, version `raw`; throttle and voltage ten times \
             a second, fitted by the same code as `haltere fit`. The source samples 50 times a second and filters, without \
             saying how: averages stand beside. Its throttle counts 30 000 to 60 000; ours is a share of full throttle, and \
             R\u{b2} does not depend on that."
        ),
        ..Section::default()
    };
    for order in 1..=3 {
        let ours = Spread::of(nominal.iter().map(|(_, law, _)| r_squared(law, order)));
        let what = format!("R\u{b2} of order {order}");
        let mut row = Row::new(what, "", 3, ours, source::THRUST_R2, Sense::More);
        for (k, count) in AVERAGES.iter().enumerate() {
            let of = Spread::of(nominal.iter().filter_map(|f| Some(r_squared(f.2.get(k)?, order))));
            let seconds = (count * EVERY) as f64 * 0.01;
            row = row.tried(format!("throttle and voltage averaged over {seconds} s"), of.mean);
        }
        let of = Spread::of(calm.iter().map(|(_, law, _)| r_squared(law, order)));
        section.rows.push(row.tried("no flapping vibration on the IMU", of.mean));
    }
    section.lines.push(Line::new(
        Claim::of(&section.rows),
        format!(
            "Figure 7, throttle over voltage: R\u{b2} of orders 1 to 3 is {} (0.756 each): as there, order does not matter.",
            section.rows.iter().map(|r| format!("{:.3}", r.ours.mean)).collect::<Vec<_>>().join(", ")
        ),
    ));
    let exponent = Spread::of(nominal.iter().map(|f| f.1.power.exponent.value));
    let calm_exponent =
        Spread::of(nominal.iter().filter_map(|f| Some(f.2.last()?.power.exponent.value)));
    section.findings.push(format!(
        "Throttle goes with the voltage to the power of {}, and of {} when both are averaged over 2 s (recorded flights of \
         this vehicle: {RECORDED_EXPONENT}): every burst of throttle pulls the voltage down with it, and point by point \
         that counts as law. The motor law of the simulator was taken from those flights. The three orders are alike within {:.3} of \
         R\u{b2}: over this range a line is as good as a cubic, and what is left is not the law but the \
         scatter of the throttle, {:.3} of full throttle rms.",
        exponent.text(2),
        calm_exponent.text(2),
        {
            let of = |order| Spread::of(nominal.iter().map(|f| r_squared(&f.1, order))).mean;
            of(3) - of(1)
        },
        Spread::of(nominal.iter().map(|f| f.1.power.residual)).mean,
    ));
    let first = nominal.first().context("no hover was flown")?;
    section.tables.push(table(&first.1));
    let colours = [Tone::Estimate, Tone::Command, Tone::Family(2)];
    let [low, high] = first.1.range_v;
    let mut series = vec![Series {
        name: "10 Hz".into(),
        tone: Tone::Family(0),
        mark: Mark::Dots,
        points: first.0.iter().map(|p| [p[1], p[2]]).collect(),
    }];
    for (polynomial, tone) in first.1.polynomials.iter().zip(colours) {
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
    }
}
