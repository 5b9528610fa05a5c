//! A diagnosis in the words of somebody who does not know the program: what a person reads first.

use crate::advice::experiments::telling_apart;
use crate::bank::library::find;
use crate::diagnosis::{Diagnosis, Effect, ShrinkResult};
use crate::outcome::Ending;
use crate::places::{LOUD_SIGMA, Part};
use haltere_model::effects::Block;

/// How a diagnosis ends, what it rests on and what to do next: what a person reads first.
pub fn in_words(d: &Diagnosis) -> String {
    match d.outcome {
        Ending::NoGap => no_gap(d),
        Ending::Named | Ending::NamedWithRemainder | Ending::Several => acting(d),
        Ending::OneOf => one_of(d),
        Ending::NotInLibrary => {
            let first = "This flight differs from the simulator, and no known effect explains it.";
            let told = [Some(first.to_owned()), elsewhere(d), rest(d)];
            told.into_iter().flatten().collect::<Vec<_>>().join(" ")
        }
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
    told.extend(elsewhere(d));
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

/// Where the gap is by the residuals of each block alone, whatever its cause: the block that stands out most, unless an
/// effect that is named is one of its own, or leaves nothing of the gap.
fn elsewhere(d: &Diagnosis) -> Option<String> {
    let causes = d.places.iter().filter(|p| p.part == Part::Cause && p.score >= LOUD_SIGMA);
    let loudest = causes.max_by(|a, b| a.score.total_cmp(&b.score))?;
    let own = |e: &Effect| find(&e.id).is_some_and(|spec| spec.block.name() == loudest.block);
    let leaves_nothing = d.explained.as_ref().is_some_and(|it| it.left.share <= 0.0);
    let lies = match d.effects.len() {
        0 => "the gap lies in",
        _ if leaves_nothing || d.effects.iter().any(own) => return None,
        _ => "the gap lies rather in",
    };
    Some(format!(
        "By the residuals alone, without regard to causes, {lies} {}.",
        place(&loudest.block)
    ))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::Explained;
    use crate::outcome::Remainder;
    use crate::places::Where;
    use haltere_model::effects::EffectSpec;

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
    fn golden_the_place_is_said_where_the_name_says_another_one() {
        let said = |outcome, effects: &[(&str, f64, &str)], block: &str, score| {
            let places = vec![Where {
                block: block.into(),
                channel: String::new(),
                anchor: None,
                regime: String::new(),
                score,
                part: Part::Cause,
                probability: 0.0,
            }];
            Diagnosis { places, ..diagnosis(outcome, effects) }
        };
        let mut whole =
            said(Ending::Named, &[("P1", 0.999, "Thrust is 10 % lower.")], "battery", 5.0);
        whole.explained.as_mut().unwrap().left.share = 0.0;
        let said = |outcome, effects, block, score| in_words(&said(outcome, effects, block, score));
        let alone = "By the residuals alone, without regard to causes, the gap lies";
        let one = &[("P1", 0.999, "Thrust is 10 % lower.")][..];
        let other = said(Ending::Named, one, "battery", 5.0);
        assert!(other.contains(&format!("28 %. {alone} rather in the battery. Sure")), "{other}");
        assert!(!said(Ending::Named, one, "thrust", 5.0).contains(alone));
        assert!(!in_words(&whole).contains(alone), "what leaves nothing explains the battery too");
        assert!(!said(Ending::Named, one, "battery", 2.0).contains(alone));
        let unknown = said(Ending::NotInLibrary, &[], "uwb", 5.0);
        assert!(
            unknown.contains(&format!("explains it. {alone} in the UWB measurements. The best")),
            "{unknown}"
        );
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
            assert_eq!(in_words(&diagnosis(outcome, effects)), want);
        }
        let either = in_words(&diagnosis(Ending::OneOf, two));
        let want = format!(
            "Either {thrust_of} (60 %), or {heavy_of} (40 %): this flight does not tell them apart. To tell \
             them apart: "
        );
        assert!(either.starts_with(&want), "{either}");
    }
}
