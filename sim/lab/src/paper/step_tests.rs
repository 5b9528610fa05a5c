//! Table 3 and figure 10: steps of 1 m and 2 m in x, y and z, version `raw` against `modified` with
//! the same gains, position and velocity; what limits of the vehicle leave at best, and what else was tried.

use anyhow::{Context, Result};
use haltere::report::svg::{Mark, Plot, Series, Tone};
use haltere::report::verdict::Check;
use haltere_core::control::{ControlConfig, Version};
use haltere_model::lockstep::Flight;

use super::bench::Bench;
use super::beside::Beside;
use super::limits::{FULLEST_V, limits};
use super::results::{Claim, Figure, Line, Row, Section, Sense, Source, Spread, Table};
use super::source;
use super::table_3::{
    Cell, Flown, Quantity, WINDOWS_S, error, fly, gain, gain_of_source, misfit, spread,
};
use super::worlds::{WORLDS, World};
use crate::compare::{CENTRE_NE_M, in_plant};
use crate::steps::{AXES, REST_S, SIZES_M, begins};

/// Simulated time of the whole programme, s.
const FLIGHT_S: f64 = 145.0;
/// What was asked for: `raw` over `modified`, position and velocity, in x, y and z.
const LEAST_GAIN: [[f64; 3]; 2] = [[1.5, 1.5, 1.1], [2.0, 2.0, 1.1]];
/// The same in the other world, position in x and y.
const LEAST_GAIN_BESIDE: f64 = 1.3;
/// Plotted before the step, s: the source's figure steps at 1 s.
const LEAD_S: f64 = 1.0;
const PLOT_PX: [f64; 2] = [540.0, 220.0];
const VERSIONS: [Version; 2] = [Version::Raw, Version::Modified];

/// The steps of `raw`, which choose the window: flown once for all experiments that need them.
pub struct Raw {
    /// By repetition.
    pub flown: Vec<Flown>,
    /// The first flight.
    first: Flight,
    /// By its place in [`WINDOWS_S`].
    pub window: usize,
}

/// Simulated seconds of [`Raw`].
pub fn cost_of_raw(repetitions: u64) -> u64 {
    repetitions * FLIGHT_S as u64
}

/// Flies them.
pub fn fly_raw(bench: &Bench) -> Result<Raw> {
    let flights = bench.each(&[(World::Nominal, Version::Raw)], FLIGHT_S, |case, seed| {
        let (flown, flight) = one(bench, *case, seed)?;
        Ok((flown, (seed == bench.seed).then_some(flight)))
    })?;
    let (flown, kept): (Vec<Flown>, Vec<Option<Flight>>) = flights.into_iter().flatten().unzip();
    let first = kept.into_iter().flatten().next().context("no repetition was flown")?;
    let window = super::table_3::chosen(&flown)?;
    Ok(Raw { flown, first, window })
}

fn one(bench: &Bench, (world, version): (World, Version), seed: u64) -> Result<(Flown, Flight)> {
    let (plant, pilot) = world.build(bench, seed)?;
    let control = ControlConfig { version, ..pilot.control.clone() };
    fly(&mut in_plant(&pilot, &control, plant)?)
        .with_context(|| format!("{version:?}, {}, seed {seed}", world.name()))
}

/// All but [`Raw`].
fn cases() -> Vec<(World, Version)> {
    let all = WORLDS.iter().flat_map(|w| VERSIONS.map(|v| (*w, v)));
    all.filter(|case| *case != (World::Nominal, Version::Raw)).collect()
}

/// Simulated seconds of a repetition.
pub fn seconds() -> u64 {
    cases().len() as u64 * FLIGHT_S as u64
}

/// What was flown in every world, and what the cells are compared in.
struct All<'a> {
    by_world: Vec<[&'a [Flown]; 2]>,
    window: usize,
    beside: Option<&'a Beside>,
    control: &'a ControlConfig,
}

impl All<'_> {
    fn world(&self, world: World) -> [&[Flown]; 2] {
        let at = WORLDS.iter().position(|w| *w == world).unwrap_or_default();
        self.by_world[at]
    }

    fn window_s(&self) -> f64 {
        WINDOWS_S[self.window] as f64
    }

    fn limits(&self, cell: Cell) -> [(String, f64); 2] {
        let [_, modified] = self.world(World::Nominal);
        limits(self.control, modified, cell, self.window_s())
    }

    fn gain(&self, world: World, of: Quantity, axis: usize) -> Spread {
        let [raw, modified] = self.world(world);
        gain(raw, modified, of, axis, self.window)
    }
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    let raw = bench.raw()?;
    let cases = cases();
    let flown = bench.each(&cases, FLIGHT_S, |case, seed| {
        let (flown, flight) = one(bench, *case, seed)?;
        Ok((flown, (case.0 == World::Nominal && seed == bench.seed).then_some(flight)))
    })?;
    let by_case: Vec<Vec<Flown>> =
        flown.iter().map(|f| f.iter().map(|(s, _)| s.clone()).collect()).collect();
    let of = |world: World, version: Version| -> &[Flown] {
        match cases.iter().position(|c| *c == (world, version)) {
            Some(at) => &by_case[at],
            None => &raw.flown,
        }
    };
    let all = All {
        by_world: WORLDS.iter().map(|w| VERSIONS.map(|v| of(*w, v))).collect(),
        window: raw.window,
        beside: bench.beside.as_ref(),
        control: &bench.pilot.control,
    };
    let window_s = all.window_s();
    let mut section = Section {
        method: format!(
            "From hover at 1.2 m, out and back by 1 m and 2 m along each axis, the setpoint jumping. Error: mean |truth \
             \u{2212} command| and |velocity \u{2212} velocity setpoint| along the stepped axis over a window from the jump \
             on. The source states no window: {window_s} s is the whole second from {} to {} with the least sum of squared \
             log ratios of ours to the source's over the twelve cells of `raw`, and serves all cells. Gains are the same in \
             both versions, found by a search for `raw` on other seeds (`haltere-lab tune`).",
            WINDOWS_S[0],
            WINDOWS_S[WINDOWS_S.len() - 1],
        ),
        ..Section::default()
    };
    cells(&mut section, &all);
    gains(&mut section, &all);
    let [raw_s, modified_s] = all.world(World::Nominal);
    let mean = |size: usize, axes: &[usize]| {
        Spread::of(modified_s.iter().map(|f| {
            let cells = axes.iter().map(|axis| Cell { of: Quantity::Position, axis: *axis, size });
            cells.map(|c| f.of(c).mean[all.window]).sum::<f64>() / axes.len() as f64
        }))
    };
    for (what, axes, beside) in [
        ("modified, 1 m, position, mean of x and y", &[0, 1][..], source::LEVEL_M),
        ("modified, 1 m, position, z", &[2][..], source::HEIGHT_M),
    ] {
        let cell = |axis: usize| Cell { of: Quantity::Position, axis, size: 0 };
        let row = Row::new(what, "m", 3, mean(0, axes), beside, Sense::Less);
        let mut row = tried(row, &all, |[_, modified]| {
            let cells = axes.iter().map(|axis| spread(modified, cell(*axis), all.window).mean);
            cells.sum::<f64>() / axes.len() as f64
        });
        let at = |k: usize| {
            let each = axes.iter().map(|axis| all.limits(cell(*axis))[k].1);
            each.sum::<f64>() / axes.len() as f64
        };
        let hard = at(0);
        row.limit = Some(if row.source.difference(hard) > 0.0 {
            ("full thrust, tilt limit, and the error at rest".into(), hard)
        } else {
            (
                "the position gains at full thrust and tilt limit, and the error at rest".into(),
                at(1),
            )
        });
        section.rows.push(row);
    }
    for (axis, name) in AXES.iter().enumerate().take(2) {
        let cell = Cell { of: Quantity::Velocity, axis, size: 1 };
        let smaller = |[raw, modified]: [&[Flown]; 2]| {
            Spread::of(
                raw.iter().zip(modified).map(|(r, m)| 1.0 - m.of(cell).peak / r.of(cell).peak),
            )
        };
        let what = format!("peaks of the velocity error, {name} 2 m: smaller by");
        let row = Row::new(what, "", 2, smaller([raw_s, modified_s]), source::PEAKS, Sense::More);
        section.rows.push(tried(row, &all, |world| smaller(world).mean));
    }
    windows(&mut section, &all);
    lines(&mut section, &all);
    let modified_first = flown.iter().flatten().find_map(|(_, flight)| flight.as_ref());
    if let Some(modified) = modified_first {
        section.figures.push(figure(&raw.first, modified));
    }
    findings(&mut section, &all);
    Ok(section)
}

/// With every world that changes one thing.
fn tried(mut row: Row, all: &All<'_>, value: impl Fn([&[Flown]; 2]) -> f64) -> Row {
    for world in WORLDS.into_iter().skip(1) {
        row = row.tried(world.name(), value(all.world(world)));
    }
    row
}

/// With what limits leave of a cell: the vehicle's where it lies above the source's number, else the law's.
fn limited(mut row: Row, all: &All<'_>, cell: Cell) -> Row {
    let [hard, law] = all.limits(cell);
    row.limit = Some(if row.source.difference(hard.1) > 0.0 { hard } else { law });
    row
}

/// The 24 cells, and what `modified` must reach.
fn cells(section: &mut Section, all: &All<'_>) {
    for (version, name) in ["raw", "modified"].into_iter().enumerate() {
        for cell in Cell::all() {
            let source = Source::number(cell.source()[version], "table 3");
            let of = |world: [&[Flown]; 2]| spread(world[version], cell, all.window);
            let sense = if version == 0 { Sense::Equal } else { Sense::Less };
            let what = format!("{name}, {}", cell.name());
            let ours = of(all.world(World::Nominal));
            let row = Row::new(what, cell.of.unit(), 3, ours, source, sense);
            let mut row = tried(row, all, |world| of(world).mean);
            let longest = spread(all.world(World::Nominal)[version], cell, WINDOWS_S.len() - 1);
            row = row.tried("the longest window", longest.mean);
            row.other = all.beside.map(|b| of(b.versions()));
            let [hard, _] = all.limits(cell);
            if version == 0 {
                row.limit = Some(hard);
            } else {
                row = limited(row, all, cell);
                let most = source.range[1];
                let mut check = Check::at_most(&row.what, Some(row.ours.mean), most, row.unit);
                if row.ours.mean > most && hard.1 > most {
                    check = Check {
                        allowed: format!(
                            "{}; the limit is {:.3}: {}",
                            check.allowed, hard.1, hard.0
                        ),
                        ..Check::that(&row.what, true, check.found)
                    };
                }
                section.targets.push(check);
            }
            section.rows.push(row);
        }
    }
}

/// `raw` over `modified` by quantity and axis, and what it must reach.
fn gains(section: &mut Section, all: &All<'_>) {
    let mut least = |name: String, found: f64, least: f64| {
        section.targets.push(Check {
            allowed: format!("at least {least:.2}"),
            ..Check::that(name, found >= least, format!("{found:.2}"))
        });
    };
    let mut rows = Vec::new();
    for of in Quantity::ALL {
        for axis in 0..AXES.len() {
            let what = format!("raw over modified, {}, {}", AXES[axis], of.name());
            let ours = all.gain(World::Nominal, of, axis);
            least(what.clone(), ours.mean, LEAST_GAIN[of as usize][axis]);
            let source = Source::number(gain_of_source(of, axis), "table 3, mean of both sizes");
            let row = Row::new(what, "", 2, ours, source, Sense::More);
            let mut row =
                tried(row, all, |[raw, modified]| gain(raw, modified, of, axis, all.window).mean);
            let [raw, _] = all.world(World::Nominal);
            let sizes = (0..SIZES_M.len()).map(|size| {
                let cell = Cell { of, axis, size };
                let [hard, law] = all.limits(cell);
                spread(raw, cell, all.window).mean / hard.1.max(law.1)
            });
            let at_best = sizes.sum::<f64>() / SIZES_M.len() as f64;
            row.limit =
                Some(("raw over what the limits of these gains leave modified".into(), at_best));
            row.other = all.beside.map(|b| {
                let [raw, modified] = b.versions();
                gain(raw, modified, of, axis, all.window)
            });
            rows.push(row);
        }
    }
    let overall = |[raw, modified]: [&[Flown]; 2], axes: usize| {
        let of = |axis| gain(raw, modified, Quantity::Position, axis, all.window).values;
        let each: Vec<Vec<f64>> = (0..axes).map(of).collect();
        Spread::of((0..each[0].len()).map(|i| each.iter().map(|a| a[i]).sum::<f64>() / axes as f64))
    };
    let ours = overall(all.world(World::Nominal), AXES.len());
    let row =
        Row::new("raw over modified, position, overall", "", 2, ours, source::GAIN, Sense::More);
    let mut row = tried(row, all, |world| overall(world, AXES.len()).mean);
    row.other = all.beside.map(|b| overall(b.versions(), AXES.len()));
    rows.push(row);
    if let Some(beside) = all.beside {
        let level = overall(beside.versions(), 2).mean;
        least(
            "raw over modified in the other world, position, x and y".into(),
            level,
            LEAST_GAIN_BESIDE,
        );
    }
    section.rows.extend(rows);
}

/// Table 3 in every window.
fn windows(section: &mut Section, all: &All<'_>) {
    let mut columns = vec!["cell".to_owned(), "source".into()];
    columns.extend(
        WINDOWS_S
            .iter()
            .enumerate()
            .map(|(k, w)| format!("{w} s{}", if k == all.window { " \u{2190}" } else { "" })),
    );
    let each = |at: &dyn Fn(usize) -> String| (0..WINDOWS_S.len()).map(at).collect::<Vec<_>>();
    let mut rows: Vec<Vec<String>> = Vec::new();
    let nominal = all.world(World::Nominal);
    for (version, name) in ["raw", "modified"].into_iter().enumerate() {
        for cell in Cell::all() {
            let mut row = vec![
                format!("{name}, {}, {}", cell.name(), cell.of.unit()),
                format!("{:.3}", cell.source()[version]),
            ];
            row.extend(each(&|w| format!("{:.3}", spread(nominal[version], cell, w).mean)));
            rows.push(row);
        }
    }
    for of in Quantity::ALL {
        for (axis, name) in AXES.iter().enumerate() {
            let mut row = vec![
                format!("raw over modified, {name}, {}", of.name()),
                format!("{:.2}", gain_of_source(of, axis)),
            ];
            row.extend(each(&|w| format!("{:.2}", gain(nominal[0], nominal[1], of, axis, w).mean)));
            rows.push(row);
        }
    }
    let mut row = vec!["sum of squared log ratios, raw".to_owned(), String::new()];
    row.extend(each(&|w| format!("{:.2}", misfit(nominal[0], w))));
    rows.push(row);
    section.tables.push(Table {
        title: "Table 3 in every window".into(),
        columns,
        rows: rows
            .into_iter()
            .map(|r| r.into_iter().map(super::results::Cell::from).collect())
            .collect(),
        note: "The arrow marks the window of the rule; its last row is the rule.".into(),
    });
}

/// Its three lines of the summary.
fn lines(section: &mut Section, all: &All<'_>) {
    let of =
        |start: &str| section.rows.iter().filter(|r| r.what.starts_with(start)).collect::<Vec<_>>();
    let cells: Vec<&Row> =
        of("modified").into_iter().filter(|r| r.source.origin == "table 3").collect();
    let below = |quantity: Quantity| {
        let cells: Vec<&&Row> =
            cells.iter().filter(|r| r.what.ends_with(quantity.name())).collect();
        let at_most = cells.iter().filter(|r| r.ours.mean <= r.source.range[1]).count();
        format!("{at_most} of {} cells of {}", cells.len(), quantity.name())
    };
    let gain = |of: Quantity| {
        let axes = (0..AXES.len()).map(|axis| {
            let ours = all.gain(World::Nominal, of, axis).mean;
            format!("{} {ours:.2} ({:.2})", AXES[axis], gain_of_source(of, axis))
        });
        axes.collect::<Vec<_>>().join(", ")
    };
    let lines = vec![
        Line::new(
            Claim::of(cells.iter().copied()),
            format!(
                "Table 3, errors of modified: at or below the source's in {} and {}, in one window of {} s for all.",
                below(Quantity::Position),
                below(Quantity::Velocity),
                all.window_s()
            ),
        ),
        Line::new(
            Claim::of(of("raw over modified").into_iter().filter(|r| r.what.ends_with("position"))),
            format!("Table 3, raw over modified, position: {}.", gain(Quantity::Position)),
        ),
        Line::new(
            Claim::of(
                of("raw over modified")
                    .into_iter()
                    .chain(of("peaks"))
                    .filter(|r| !r.what.contains("position")),
            ),
            format!(
                "Table 3 and figure 10, raw over modified, velocity: {}; peaks smaller by {} (0.75).",
                gain(Quantity::Velocity),
                of("peaks").iter().map(|r| r.ours.text(2)).collect::<Vec<_>>().join(" and ")
            ),
        ),
    ];
    let beside = match all.beside {
        None => Line::new(
            Claim::NotFlown,
            "Other world: not given; `haltere-lab beside FILE` flies it, `--beside FILE` sets it beside ours.",
        ),
        Some(beside) => {
            let [raw, modified] = beside.versions();
            let of = |of, axis| gain_text(raw, modified, of, axis, all.window);
            let level = (0..2)
                .map(|axis| {
                    super::table_3::gain(raw, modified, Quantity::Position, axis, all.window).mean
                })
                .sum::<f64>()
                / 2.0;
            Line::new(
                if level >= LEAST_GAIN_BESIDE { Claim::Reproduced } else { Claim::Partly },
                format!(
                    "In another world, where no gain was tuned, raw over modified: position x {}, y {}, z {}; velocity x \
                     {}, y {}, z {}.",
                    of(Quantity::Position, 0),
                    of(Quantity::Position, 1),
                    of(Quantity::Position, 2),
                    of(Quantity::Velocity, 0),
                    of(Quantity::Velocity, 1),
                    of(Quantity::Velocity, 2),
                ),
            )
        }
    };
    section.lines = lines;
    section.lines.push(beside);
}

fn gain_text(
    raw: &[Flown],
    modified: &[Flown],
    of: Quantity,
    axis: usize,
    window: usize,
) -> String {
    format!("{:.2}", gain(raw, modified, of, axis, window).mean)
}

fn findings(section: &mut Section, all: &All<'_>) {
    let gains = |world: World| {
        let of = |of, axis| all.gain(world, of, axis).mean;
        format!(
            "position x {:.2}, y {:.2}, z {:.2}; velocity x {:.2}, y {:.2}, z {:.2}",
            of(Quantity::Position, 0),
            of(Quantity::Position, 1),
            of(Quantity::Position, 2),
            of(Quantity::Velocity, 0),
            of(Quantity::Velocity, 1),
            of(Quantity::Velocity, 2)
        )
    };
    let each = WORLDS.map(|world| format!("{}: {}", world.name(), gains(world)));
    section.findings.push(format!(
        "Raw over modified with one thing changed. {}. What the enhancements take out is drag, and how much of it is left to \
         them depends on the integral action of `raw`: the search gave it much, the public firmware little.",
        each.join(". ")
    ));
    section.findings.push(format!(
        "Limits: z with full and least thrust at {FULLEST_V} V, x and y at the tilt limit, from rest to rest without lag \
         and drag, velocity with the setpoint that the gain makes of the position; error at rest: what is left over the last {REST_S:.0} s of 10, for position the bias of ranging, for \
         velocity what noise of the estimate moves setpoint and vehicle."
    ));
    section.findings.push(
        "The 4.9 cm in z of the abstract is the cell of `raw` (0.0496 m); `modified` has 0.043 m. Of twelve ratios the \
         source's table has 1.82 on average, of the six of position 1.48."
            .into(),
    );
}

/// Figure 10: velocity error after the first step of 2 m out in x and y.
fn figure(raw: &Flight, modified: &Flight) -> Figure {
    let plots = (0..2)
        .map(|axis| {
            let cell = Cell { of: Quantity::Velocity, axis, size: 1 };
            let of = |flight: &Flight, name: &str, tone| {
                let begins = begins(flight, CENTRE_NE_M);
                let step =
                    begins.iter().find(|(leg, _)| leg.axis == axis && leg.size_m == SIZES_M[1]);
                let points = step.map_or_else(Vec::new, |(leg, start)| {
                    let lead = (LEAD_S * 100.0) as usize;
                    let from = start.saturating_sub(lead);
                    let error = error(flight, cell, from, leg.to_E_m[axis]);
                    error.into_iter().enumerate().map(|(i, e)| [i as f64 * 0.01, e]).collect()
                });
                Series { name: name.into(), tone, mark: Mark::Line, points }
            };
            Plot {
                title: format!("Velocity error, {} 2 m", AXES[axis]),
                x_label: "s".into(),
                y_label: "m/s".into(),
                series: vec![
                    of(raw, "raw", Tone::Command),
                    of(modified, "modified", Tone::Estimate),
                ],
                size_px: PLOT_PX,
                ..Plot::default()
            }
        })
        .collect();
    Figure {
        name: "Figure 10",
        caption: "|velocity \u{2212} velocity setpoint|, step of 2 m at 1 s, first repetition."
            .into(),
        plots,
    }
}
