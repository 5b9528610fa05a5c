//! What was found of an effect, as a sentence that anybody can read: sizes in percent and in what a ruler or a kitchen scale
//! shows, directions in words.
//!
//! The words stand with the effect ([`haltere_model::effects::Deviation::verdict`]); here the numbers are put into them.

use haltere_core::measure::AnchorId;
use haltere_model::effects::{Axis, Choice, EffectSpec, Kind, ParameterSpec};

/// Winds, clockwise from north, every 45 degrees.
const WINDS: [&str; 8] =
    ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];
/// Walls as they are counted.
const WALLS: [&str; 4] = ["north", "east", "south", "west"];

/// The verdict on an effect as a sentence with what is known of its sizes. `theta`: its parameters, in the
/// order of the specification, with central 90 %; `anchors`: those of the survey, ascending id.
pub fn said(
    spec: &EffectSpec,
    theta: &[f64],
    theta_90: &[[f64; 2]],
    anchors: &[AnchorId],
) -> String {
    let Some(deviation) = spec.deviation() else { return spec.name.to_owned() };
    let found = theta.iter().zip(theta_90);
    let all: Vec<Told<'_>> = spec
        .parameters
        .iter()
        .zip(found)
        .map(|(p, (value, ends))| Told::new(p, *value, *ends))
        .collect();
    let list = if deviation.verdict.contains("{}") { listed(&all) } else { Vec::new() };
    let is_listed = |told: &Told<'_>| list.iter().any(|one| one.p.name == told.p.name);
    let named = |told: &Told<'_>| deviation.verdict.contains(&told.slot());
    // The words of a list may name a place.
    let filled = |text: String| {
        all.iter().fold(text, |text, told| text.replace(&told.slot(), &told.words(anchors)))
    };
    let parts: Vec<String> = list.iter().map(|told| told.words(anchors)).collect();
    let verdict = filled(deviation.verdict.replace("{}", &joined(&parts)));
    let sizes: Vec<&Told<'_>> = all
        .iter()
        .filter(|told| is_listed(told) || (told.p.kind.is_size() && named(told)))
        .collect();
    let ranges: Vec<String> =
        sizes.iter().filter_map(|told| told.range(sizes.len() > 1)).map(filled).collect();
    let known = match ranges.len() {
        0 => String::new(),
        _ => format!(" (90 %: {})", joined(&ranges)),
    };
    let mut letters = verdict.trim_end_matches('.').chars();
    let first = letters.next().map(char::to_uppercase).into_iter().flatten();
    first.chain(letters).chain(known.chars()).chain(['.']).collect()
}

/// A choice by its name: a place in the survey is no number that anybody reads on an anchor.
pub fn chosen(which: Choice, value: f64, anchors: &[AnchorId]) -> String {
    // A cast keeps what is below zero at zero.
    let place = value.round() as usize;
    match which {
        Choice::Anchor(_) => anchors.get(place).map_or_else(
            || format!("the anchor at place {place} of the survey"),
            |id| format!("anchor {}", id.0),
        ),
        Choice::Wall => format!("the {} wall", WALLS[place.min(WALLS.len() - 1)]),
    }
}

/// Parameters with words for both of their sides: those that are something, or the one that is most.
fn listed<'a, 'b>(all: &'b [Told<'a>]) -> Vec<&'b Told<'a>> {
    let with_ways = || all.iter().filter(|told| told.p.ways.is_some());
    let sure: Vec<_> = with_ways().filter(|told| told.low * told.high > 0.0).collect();
    if !sure.is_empty() {
        return sure;
    }
    let share = |told: &Told<'_>| told.value.abs() / (told.times * (told.p.high - told.p.low));
    with_ways().max_by(|a, b| share(a).total_cmp(&share(b))).into_iter().collect()
}

/// A parameter as it is told.
struct Told<'a> {
    p: &'a ParameterSpec,
    /// As found, for places and choices.
    raw: f64,
    /// Beyond "off", and the ends of its interval, in the unit that is told.
    value: f64,
    low: f64,
    high: f64,
    unit: String,
    times: f64,
    digits: usize,
}

impl<'a> Told<'a> {
    fn new(p: &'a ParameterSpec, raw: f64, [low, high]: [f64; 2]) -> Self {
        let is_deviation = matches!(p.kind, Kind::Size | Kind::Component)
            || (p.kind == Kind::Shape && p.ways.is_some());
        let off = if is_deviation { p.off } else { 0.0 };
        let [value, low, high] = [raw, low, high].map(|v| v - off);
        let largest = [value, low, high].into_iter().fold(0.0, |most, v: f64| v.abs().max(most));
        let (unit, times) = unit(p.unit, largest);
        let [value, low, high] = [value, low, high].map(|v| v * times);
        let digits = digits(value.abs(), (high - low).abs());
        Self { p, raw, value, low, high, unit, times, digits }
    }

    /// Where it stands in a sentence.
    fn slot(&self) -> String {
        format!("{{{}}}", self.p.name)
    }

    fn number(&self, value: f64) -> String {
        format!("{:.*}", self.digits, value.abs())
    }

    /// The side of "off" that it is on, with a space before it.
    fn way(&self) -> String {
        let way = self.p.ways.map(|ways| ways[usize::from(self.value >= 0.0)]);
        way.map_or(String::new(), |way| format!(" {way}"))
    }

    fn words(&self, anchors: &[AnchorId]) -> String {
        match self.p.kind {
            Kind::Which(which) => chosen(which, self.raw, anchors),
            Kind::Where(axis) => {
                let [below, above] = match axis {
                    Axis::North => ["south", "north"],
                    Axis::East => ["west", "east"],
                };
                let side = if self.raw < 0.0 { below } else { above };
                format!("{:.1} m {side}", self.raw.abs())
            }
            Kind::Direction if self.p.ways.is_none() => {
                let deg = self.raw.rem_euclid(360.0);
                let wind = WINDS[(deg / 45.0).round() as usize % WINDS.len()];
                format!("towards the {wind} ({deg:.0}°)")
            }
            _ => format!("{}{}{}", self.number(self.value), self.unit, self.way()),
        }
    }

    /// The interval, seen from the side that the value is on.
    fn range(&self, with_way: bool) -> Option<String> {
        let side = if self.value < 0.0 { -1.0 } else { 1.0 };
        let [a, b] = [self.low * side, self.high * side];
        let (low, high) = (a.min(b), a.max(b));
        if !(high - low).is_finite() || high <= low {
            return None;
        }
        let [from, to] = [low, high].map(|end| self.number(end));
        let way = if with_way { self.way() } else { String::new() };
        let unit = &self.unit;
        Some(match (low < 0.0, high < 0.0) {
            (false, _) => format!("{from} to {to}{unit}{way}"),
            (true, false) => format!("up to {to}{unit}{way} or up to {from}{unit} the other way"),
            (true, true) => format!("{to} to {from}{unit} the other way"),
        })
    }
}

/// Unit as a person measures in it, with what stands between it and the number, and what a value is multiplied by.
fn unit(unit: &str, largest: f64) -> (String, f64) {
    const DEG: f64 = 180.0 / std::f64::consts::PI;
    let (told, times) = match unit {
        "" => (" %", 100.0),
        "m" if largest < 1.0 => (" cm", 100.0),
        "m/m" => (" cm per metre", 100.0),
        "s" if largest < 1.0 => (" ms", 1000.0),
        "deg" => ("°", 1.0),
        "deg/min" => ("° per minute", 1.0),
        "rad/s" => ("° per second", DEG),
        "rad per m/s" => ("° per m/s", DEG),
        "m/s² per min" => (" m/s² per minute", 1.0),
        "1/min" => (" per minute", 1.0),
        // Of drag: times speed squared it is an acceleration.
        "1/m" => (" m/s² at 1 m/s", 1.0),
        other => return (format!(" {other}"), 1.0),
    };
    (told.to_owned(), times)
}

/// Digits behind the point: two of the value, and steps no finer than a fiftieth of the interval.
fn digits(value: f64, width: f64) -> usize {
    let of_value = if value > 0.0 { 1.0 - value.log10().floor() } else { 0.0 };
    let of_interval = if width > 0.0 { (5.0 / width).log10().ceil() } else { f64::INFINITY };
    of_value.min(of_interval).clamp(0.0, 3.0) as usize
}

fn joined(parts: &[String]) -> String {
    match parts {
        [all @ .., last] if !all.is_empty() => format!("{} and {last}", all.join(", ")),
        _ => parts.concat(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::library::{find, whole};

    fn anchors() -> Vec<AnchorId> {
        (10..18).map(AnchorId).collect()
    }

    /// Parameters that are not given are at "off", or a choice of the first.
    fn sentence(id: &str, given: &[(&str, [f64; 3])]) -> String {
        let spec = find(id).unwrap();
        let one = |p: &ParameterSpec| {
            let of_name = given.iter().find(|(name, _)| *name == p.name);
            let [low, value, high] = of_name.map_or([p.off; 3], |(_, numbers)| *numbers);
            (value, [low, high])
        };
        let (theta, theta_90): (Vec<_>, Vec<_>) = spec.parameters.iter().map(one).unzip();
        said(spec, &theta, &theta_90, &anchors())
    }

    #[test]
    fn golden_verdicts_are_plain_sentences_with_sizes_and_directions() {
        for (id, given, want) in [
            (
                "P1",
                &[("loss", [0.071, 0.092, 0.113])][..],
                "Thrust is 9.2 % lower than the simulator says (90 %: 7.1 to 11.3 %).",
            ),
            (
                "I2",
                &[("x", [-4.5, -3.3, -2.1]), ("y", [-0.4, 0.1, 0.6])],
                "The centre of mass is off by 3.3 mm to the back (90 %: 2.1 to 4.5 mm).",
            ),
            (
                "I2",
                &[("x", [-4.5, -3.3, -2.1]), ("y", [0.4, 1.0, 1.6])],
                "The centre of mass is off by 3.3 mm to the back and 1.0 mm to the right (90 %: 2.1 to 4.5 mm to the back and 0.4 to 1.6 mm to the right).",
            ),
            (
                "I1",
                &[("extra", [4.0, 6.1, 8.2])],
                "The vehicle is 6.1 g heavier than the simulator says (90 %: 4.0 to 8.2 g).",
            ),
            (
                "L1",
                &[("factor", [0.5, 0.6, 0.7])],
                "The board's attitude loop is 40 % slower than the simulator says (90 %: 30 to 50 %).",
            ),
            (
                "P5",
                &[("ratio", [1.1, 1.15, 1.22])],
                "At the nominal voltage the wings flap no faster than 115 % of their rate in hover (90 %: 110 to 122 %).",
            ),
            (
                "U2",
                &[("bias", [-0.25, -0.21, -0.17]), ("anchor", [5.0; 3])],
                "Distances to anchor 15 come out 21 cm too short, everywhere in the room (90 %: 17 to 25 cm).",
            ),
            (
                "U7",
                &[("north", [-0.1, 0.1, 0.3]), ("down", [-0.4, -0.3, -0.2]), ("anchor", [2.0; 3])],
                "Anchor 12 does not stand where the survey has it, but 30 cm higher (90 %: 20 to 40 cm).",
            ),
            (
                "T3",
                &[("length", [0.25, 0.3, 0.4]), ("rate", [10.0, 14.0, 18.0])],
                "Commands get lost in bursts of 300 ms, 14 per minute (90 %: 250 to 400 ms and 10 to 18 per minute).",
            ),
            (
                "A6",
                &[
                    ("speed", [0.4, 0.6, 0.8]),
                    ("north", [3.2; 3]),
                    ("east", [-1.0; 3]),
                    ("towards", [-88.0; 3]),
                ],
                "A draught of 0.60 m/s blows towards the west (272°) at one place of the room, 3.2 m north and 1.0 m west of the origin (90 %: 0.40 to 0.80 m/s).",
            ),
            (
                "A3",
                &[("c", [0.4, 0.6, 0.9])],
                "Drag has a part that grows with the square of speed and that the simulator lacks: it brakes with 0.6 m/s² at 1 m/s (90 %: 0.4 to 0.9 m/s² at 1 m/s).",
            ),
            (
                "H1",
                &[("angle", [-2.0, 3.0, 8.0])],
                "The board's north is 3° clockwise from that of the room (90 %: up to 8° or up to 2° the other way).",
            ),
        ] {
            assert_eq!(sentence(id, given), want, "{id}");
        }
    }

    /// What is off elsewhere is not told, and of a vector of which nothing is sure its largest component.
    #[test]
    fn prop_what_may_be_nothing_is_told_only_where_there_is_nothing_else() {
        let text = sentence("M1", &[("x", [-0.1, 0.1, 0.3]), ("z", [-0.3, -0.2, 0.1])]);
        assert!(text.contains("upward") && !text.contains("front"), "{text}");
        let text = sentence("H2", &[("zone", [4.0, 8.0, 12.0]), ("north", [5.0; 3])]);
        assert!(text.contains("8° clockwise at the place 5.0 m north"), "{text}");
    }

    #[test]
    fn prop_every_effect_is_told_at_both_ends_of_its_range() {
        for spec in whole() {
            let ends: [fn(&ParameterSpec) -> f64; 3] = [|p| p.low, |p| p.default, |p| p.high];
            for at in ends {
                let theta: Vec<f64> = spec.parameters.iter().map(at).collect();
                let theta_90: Vec<_> = theta.iter().map(|v| [0.9 * v, 1.1 * v]).collect();
                for anchors in [anchors(), Vec::new()] {
                    let text = said(spec, &theta, &theta_90, &anchors);
                    println!("{}: {text}", spec.id);
                    let open = text.contains(['{', '}']) || text.contains("  ");
                    assert!(!open && text.ends_with('.'), "{}: {text}", spec.id);
                    assert!(text.starts_with(|c: char| c.is_uppercase()), "{text}");
                    assert!(text.contains("(90 %: "), "{text}");
                    assert!(!text.contains("NaN") && !text.contains("inf "), "{text}");
                }
            }
        }
    }

    #[test]
    fn prop_without_an_interval_the_sentence_stands_alone() {
        let text = sentence("P1", &[("loss", [f64::NAN, 0.1, f64::NAN])]);
        assert_eq!(text, "Thrust is 10 % lower than the simulator says.");
    }
}
