//! What was found, as sentences that anybody can read: sizes in percent and in what a ruler or a kitchen scale shows,
//! directions in words.
//!
//! The words of an effect stand with it ([`haltere_model::effects::Deviation::verdict`]); here the numbers are put into them,
//! and [`first`] says all of a diagnosis that a reader in a hurry needs.

use crate::advice::experiments::telling_apart;
use crate::bank::library::find;
use crate::diagnosis::{Diagnosis, Effect, ShrinkResult};
use crate::outcome::Ending;
use haltere_core::measure::AnchorId;
use haltere_model::effects::{Axis, Block, Choice, EffectSpec, Kind, ParameterSpec};

/// Winds, clockwise from north, every 45 degrees.
const WINDS: [&str; 8] =
    ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];
/// Walls as they are counted.
const WALLS: [&str; 4] = ["north", "east", "south", "west"];

/// How a diagnosis ends, what it rests on and what to do next: what a person reads first.
pub fn first(d: &Diagnosis) -> String {
    match d.outcome {
        Ending::NoGap => no_gap(d),
        Ending::Named | Ending::NamedWithRemainder | Ending::Several => acting(d),
        Ending::OneOf => one_of(d),
        Ending::NotInLibrary => format!(
            "This flight differs from the simulator, and no known effect explains it. {}",
            rest(d).unwrap_or_default()
        )
        .trim_end()
        .to_owned(),
        Ending::Budget => format!(
            "The vehicle is not as its file says: {}. Next: take the constants below into the vehicle file.",
            d.why
        ),
        Ending::NotTestable => format!("This flight cannot be judged: {}.", d.why),
        Ending::Fault => format!("This log cannot be trusted: {}.", d.why),
    }
}

fn no_gap(d: &Diagnosis) -> String {
    let nothing = "This flight is as the simulator says, within what flights without a gap scatter by: \
                   there is nothing to do.";
    match d.not_testable.len() {
        0 => nothing.to_owned(),
        n => format!("{nothing} {n} of the known effects would not have shown on it."),
    }
}

/// Effects that are named, each with its size.
fn acting(d: &Diagnosis) -> String {
    let mut told: Vec<String> = Vec::new();
    if d.outcome == Ending::Several {
        told.push("Several things differ at once.".to_owned());
    }
    told.extend(d.effects.iter().map(|e| e.said.clone()));
    let since = d.picture.as_ref().filter(|p| p.onset.at_s.is_some());
    told.extend(since.map(|p| format!("It is so {}.", p.onset.words())));
    told.extend(d.shrink.as_ref().and_then(|s| closes(d, s)));
    if d.outcome == Ending::NamedWithRemainder {
        told.extend(rest(d));
    }
    let least = d.effects.iter().map(|e| e.probability).fold(1.0, f64::min);
    // No sum over what was tried is surer than this.
    let sure = (100.0 * least).min(99.0);
    told.push(format!("Sure to {sure:.0} %."));
    let both = d.effects.len() > 1;
    let of = |e: &Effect, text: &str| match both {
        true => format!("{}: {text}", e.name),
        false => text.to_owned(),
    };
    let rows: Vec<_> =
        d.effects.iter().filter_map(|e| Some((e, find(&e.id)?.deviation()?))).collect();
    let causes: Vec<String> = rows.iter().map(|(e, row)| of(e, row.causes)).collect();
    let remedies: Vec<String> = rows.iter().map(|(e, row)| of(e, row.remedy)).collect();
    if !rows.is_empty() {
        told.push(format!("Usual causes: {}.", causes.join("; ")));
        told.push(format!(
            "Next: {}; or put it into the simulator with `haltere gap accept`.",
            remedies.join("; ")
        ));
    }
    told.join(" ")
}

/// What other flights say.
fn closes(d: &Diagnosis, s: &ShrinkResult) -> Option<String> {
    let flights = match s.flights {
        0 => return None,
        1 => "one other flight".to_owned(),
        n => format!("{n} other flights"),
    };
    let Some(value) = s.value else {
        return Some(format!("On {flights} there is no gap to close."));
    };
    let percent = |share: f64| format!("{:.0} %", 100.0 * share.clamp(0.0, 1.0));
    // Sums that hold what is named are no rivals of it.
    let others = s.others.iter().filter(|(name, _)| !name.contains('+'));
    let best = others.filter_map(|(id, v)| Some((id, (*v)?))).max_by(|a, b| a.1.total_cmp(&b.1));
    let rival = match best {
        None => String::new(),
        Some((_, other)) if other <= value => {
            format!("; nothing else that was tried closes more than {}", percent(other))
        }
        Some((id, other)) => format!("; but {} closes {}", name(id), percent(other)),
    };
    let once = if d.effects.len() > 1 { "once these are added" } else { "once this is added" };
    Some(format!("On {flights} the gap closes by {} {once}{rival}.", percent(value)))
}

/// Alternatives, and what tells them apart.
fn one_of(d: &Diagnosis) -> String {
    let all: Vec<String> =
        d.effects.iter().map(|e| format!("{} ({:.0} %)", e.name, 100.0 * e.probability)).collect();
    let next = match telling_apart(&d.set).first() {
        Some(e) => format!("{}: {}", e.title, e.how.trim_end_matches('.')),
        None => "`haltere gap advise` looks for the flight that does".to_owned(),
    };
    format!(
        "Either {}: this flight does not tell them apart. To tell them apart: {next}.",
        all.join(", or ")
    )
}

/// How far the best explanation goes, and where the rest shows.
fn rest(d: &Diagnosis) -> Option<String> {
    let explained = d.explained.as_ref()?;
    let by: Vec<&str> = explained.by.iter().map(|id| name(id)).collect();
    let by = if d.effects.is_empty() {
        format!("The best of them, {},", by.join(" and "))
    } else {
        "It".to_owned()
    };
    let share = 100.0 * (1.0 - explained.left.share).clamp(0.0, 1.0);
    let place = place(&explained.left.block);
    Some(format!("{by} explains {share:.0} % of the gap; the rest shows mostly in {place}."))
}

fn name(id: &str) -> &str {
    find(id).map_or(id, |spec| spec.name)
}

/// A block of the chain in words.
fn place(block: &str) -> &str {
    let of_name = Block::CHAIN.into_iter().find(|b| b.name() == block);
    match of_name {
        None => "no single place",
        Some(Block::Mission) => "how the mission was flown",
        Some(Block::Controller) => "what the controller asked for",
        Some(Block::Link) => "the way of the commands to the board",
        Some(Block::InnerLoop) => "the board's attitude loop",
        Some(Block::Actuators) => "the servos",
        Some(Block::Thrust) => "the thrust",
        Some(Block::Aerodynamics) => "the forces of the air",
        Some(Block::Battery) => "the battery",
        Some(Block::Imu) => "the accelerometer and the gyroscope",
        Some(Block::Uwb) => "the UWB measurements",
        Some(Block::Estimator) => "the estimate",
        Some(Block::Timing) => "the times at which messages come",
    }
}

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
        // A cast keeps what is below zero at zero.
        let place = self.raw.round() as usize;
        match self.p.kind {
            Kind::Which(Choice::Anchor(_)) => anchors.get(place).map_or_else(
                || format!("the anchor at place {place} of the survey"),
                |id| format!("anchor {}", id.0),
            ),
            Kind::Which(Choice::Wall) => format!("the {} wall", WALLS[place.min(WALLS.len() - 1)]),
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
    use crate::bank::library::whole;
    use crate::diagnosis::Explained;
    use crate::outcome::Remainder;

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

    fn effect(id: &str, probability: f64, said: &str) -> Effect {
        let name = name(id).to_owned();
        Effect { id: id.into(), name, probability, said: said.into(), parameters: Vec::new() }
    }

    /// A gap of which 26 % is left in the UWB measurements, and three flights on which 73 % closes.
    fn diagnosis(outcome: Ending, effects: &[(&str, f64, &str)]) -> Diagnosis {
        let effects: Vec<_> = effects.iter().map(|(id, p, text)| effect(id, *p, text)).collect();
        let left = Remainder { share: 0.26, block: "uwb".into(), statistics: Vec::new() };
        let explained = Explained { by: vec!["P1".into()], share: 0.74, foretold: 0.6, left };
        let shrink = ShrinkResult {
            value: Some(0.73),
            flights: 3,
            others: vec![
                ("I1".into(), Some(0.28)),
                ("P2".into(), None),
                ("P1 + I1".into(), Some(0.9)),
            ],
            ..ShrinkResult::default()
        };
        Diagnosis {
            outcome,
            set: effects.iter().map(|e| e.id.clone()).collect(),
            effects,
            explained: Some(explained),
            shrink: Some(shrink),
            why: "it never moved".into(),
            ..Diagnosis::default()
        }
    }

    #[test]
    fn golden_every_outcome_is_said_to_anybody() {
        let (thrust, heavy) = ("Thrust is 10 % lower.", "The vehicle is 6 g heavier.");
        let p1 = find("P1").and_then(EffectSpec::deviation).unwrap();
        let i1 = find("I1").and_then(EffectSpec::deviation).unwrap();
        let [thrust_of, heavy_of] = ["P1", "I1"].map(name);
        let one = &[("P1", 0.999, thrust)][..];
        let two = &[("P1", 0.6, thrust), ("I1", 0.4, heavy)][..];
        let closes = "On 3 other flights the gap closes by 73 % once this is added; nothing else that \
                      was tried closes more than 28 %.";
        let left = "explains 74 % of the gap; the rest shows mostly in the UWB measurements.";
        let after = format!(
            "Usual causes: {}. Next: {}; or put it into the simulator with `haltere gap accept`.",
            p1.causes, p1.remedy
        );
        for (outcome, effects, want) in [
            (
                Ending::NoGap,
                &[][..],
                "This flight is as the simulator says, within what flights without a gap scatter by: \
                 there is nothing to do."
                    .to_owned(),
            ),
            (Ending::Named, one, format!("{thrust} {closes} Sure to 99 %. {after}")),
            (
                Ending::NamedWithRemainder,
                one,
                format!("{thrust} {closes} It {left} Sure to 99 %. {after}"),
            ),
            (
                Ending::Several,
                two,
                format!(
                    "Several things differ at once. {thrust} {heavy} {} Sure to 40 %. Usual causes: \
                     {thrust_of}: {}; {heavy_of}: {}. Next: {thrust_of}: {}; {heavy_of}: {}; or put it into \
                     the simulator with `haltere gap accept`.",
                    closes.replace("this is", "these are"),
                    p1.causes,
                    i1.causes,
                    p1.remedy,
                    i1.remedy
                ),
            ),
            (
                Ending::NotInLibrary,
                &[],
                format!(
                    "This flight differs from the simulator, and no known effect explains it. The best of \
                     them, {thrust_of}, {left}"
                ),
            ),
            (
                Ending::Budget,
                &[],
                "The vehicle is not as its file says: it never moved. Next: take the constants below \
                 into the vehicle file."
                    .to_owned(),
            ),
            (Ending::NotTestable, &[], "This flight cannot be judged: it never moved.".to_owned()),
            (Ending::Fault, &[], "This log cannot be trusted: it never moved.".to_owned()),
        ] {
            assert_eq!(first(&diagnosis(outcome, effects)), want);
        }
        let either = first(&diagnosis(Ending::OneOf, two));
        let want = format!(
            "Either {thrust_of} (60 %), or {heavy_of} (40 %): this flight does not tell them apart. To tell \
             them apart: "
        );
        assert!(either.starts_with(&want), "{either}");
    }

    #[test]
    fn prop_without_an_interval_the_sentence_stands_alone() {
        let text = sentence("P1", &[("loss", [f64::NAN, 0.1, f64::NAN])]);
        assert_eq!(text, "Thrust is 10 % lower than the simulator says.");
    }
}
