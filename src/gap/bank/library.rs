//! The library of the diagnosis, and how values of its effects' parameters are drawn.
//!
//! The effects are the simulator's own files, which say whether they are candidates; what is here is only
//! the prior: uniform over the plausible range of the list, whole numbers for choices of an
//! anchor or a wall, places within the room. Draws are stratified (Latin hypercube), so that a few
//! dozen flights cover the range of every parameter evenly. Every other draw of an effect with several
//! components (the axes of a bias, the servos that are out of trim) has one of them alone: that is how
//! such things come, and a loud component would otherwise hide what a quiet one looks like.

use crate::bank::axis::{Axis, Size};
use haltere_core::checks::Problems;
use haltere_model::Vehicle;
use haltere_model::effects::{self, ALL, Choice, EffectSet, EffectSpec, Kind, ParameterSpec, Role};
use haltere_model::random::Stream;
use haltere_model::room::Room;

/// Distance of a drawn place from the walls, m: where the standard flights come.
const FROM_WALL_M: f64 = 0.5;

/// The standard library, in the order of the list: candidates unless the user says otherwise.
pub fn standard() -> Vec<&'static EffectSpec> {
    ALL.iter().filter(|spec| spec.deviation().is_some_and(|of| of.standard)).collect()
}

/// Every deviation of the list.
pub fn whole() -> Vec<&'static EffectSpec> {
    ALL.iter().filter(|spec| spec.role != Role::Nominal).collect()
}

/// A deviation by its id.
pub fn find(id: &str) -> Option<&'static EffectSpec> {
    whole().into_iter().find(|spec| spec.id == id)
}

/// Units of one kind, as they stand at the end of names, and their size in the first of them.
const UNITS: [&[(&str, f64)]; 3] = [
    &[("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)],
    &[("s", 1.0), ("ms", 1e-3)],
    &[("deg", 1.0), ("rad", 180.0 / std::f64::consts::PI)],
];

/// What a value in the unit `from` is multiplied by to have it in `to`; `None`: they measure different things.
fn in_unit(from: &str, to: &str) -> Option<f64> {
    let size = |kind: &[(&str, f64)], unit: &str| {
        kind.iter().find(|(name, _)| *name == unit).map(|(_, size)| *size)
    };
    UNITS.iter().find_map(|kind| Some(size(kind, from)? / size(kind, to)?))
}

/// What a person writes for an effect: `ID`; `ID=value,…` in the order of its parameters; `ID=name:value,…` or
/// `ID.name=value`. A name may end in a unit of its own kind (`I2.x_mm=3`). Parameters that are not named have their default. `None`: no value was given. Errors say what is
/// wrong, beginning with the effect.
pub fn asked(text: &str) -> Result<(&'static EffectSpec, Option<Vec<f64>>), String> {
    let (left, values) = text.split_once('=').map_or((text, None), |(id, v)| (id, Some(v)));
    let (id, one) = left.split_once('.').map_or((left, None), |(id, name)| (id, Some(name)));
    let Some(spec) = find(id) else {
        let known: Vec<&str> = whole().iter().map(|s| s.id).collect();
        return Err(format!("{id}: no such effect; allowed: {}", known.join(" ")));
    };
    let Some(values) = values else {
        return match one {
            None => Ok((spec, None)),
            Some(_) => Err(format!("{text}: a value is missing; write {text}=0.1")),
        };
    };
    // Place, and what a value in the unit of the name has to be multiplied by.
    let place_of = |name: &str| {
        let fits = |p: &ParameterSpec| match name.trim().strip_prefix(p.name)?.strip_prefix('_') {
            None if p.name == name.trim() => Some(1.0),
            None => None,
            Some(unit) => in_unit(unit, p.unit),
        };
        let mut places = spec.parameters.iter().enumerate();
        places.find_map(|(k, p)| Some((k, fits(p)?))).ok_or_else(|| {
            let known = spec.parameters.iter().map(|p| format!("{} {}", p.name, p.unit));
            let known: Vec<String> = known.map(|text| text.trim_end().to_owned()).collect();
            format!("{id}: no parameter {name}, it has {}", known.join(", "))
        })
    };
    let mut theta: Vec<f64> = spec.parameters.iter().map(|p| p.default).collect();
    for (k, part) in values.split(',').enumerate() {
        let ((place, times), value) = match (one, part.split_once(':')) {
            (Some(name), None) if k == 0 => (place_of(name)?, part),
            (Some(_), _) => return Err(format!("{text}: one value belongs to one parameter")),
            (None, Some((name, value))) => (place_of(name)?, value),
            (None, None) => ((k, 1.0), part),
        };
        let number: f64 = value.trim().parse().map_err(|_| {
            format!("{id}: `{value}` is no number; write {id}=0.1, {id}=name:0.1 or {id}.name=0.1")
        })?;
        let slots = theta.len();
        let slot = theta
            .get_mut(place)
            .ok_or_else(|| format!("{id}: has {slots} parameters, more were given"))?;
        *slot = number * times;
    }
    // Refused here as the simulator would refuse it.
    with_effect(EffectSet::default(), spec, &theta).map_err(|p| format!("{text}: {p}"))?;
    Ok((spec, Some(theta)))
}

/// An effect with the sizes that are plausible on a vehicle, in the order of its parameters.
fn sizes(spec: &EffectSpec, vehicle: &Vehicle) -> Vec<ParameterSpec> {
    spec.parameters.iter().map(|p| p.of(vehicle)).collect()
}

/// `count` sets of values for the parameters of an effect on a vehicle, in their order.
pub fn draws(
    spec: &EffectSpec,
    vehicle: &Vehicle,
    room: &Room,
    anchors: usize,
    count: usize,
    rng: &mut Stream,
) -> Vec<Vec<f64>> {
    let sizes = sizes(spec, vehicle);
    let columns: Vec<Vec<f64>> = sizes
        .iter()
        .map(|p| {
            let strata = shuffled(count, rng);
            let shares = strata.into_iter().map(|k| (k as f64 + rng.uniform()) / count as f64);
            shares.map(|share| at(p, room, anchors, share)).collect()
        })
        .collect();
    let components: Vec<usize> =
        (0..columns.len()).filter(|k| sizes[*k].kind == Kind::Component).collect();
    let row = |k: usize| -> Vec<f64> {
        let mut row: Vec<f64> = columns.iter().map(|column| column[k]).collect();
        if components.len() > 1 && k % 2 == 1 {
            let alone = components[k / 2 % components.len()];
            for other in components.iter().filter(|c| **c != alone) {
                row[*other] = sizes[*other].off;
            }
        }
        row
    };
    (0..count).map(row).collect()
}

/// What draws of the parameters of an effect range over, in their order.
pub fn axes(spec: &EffectSpec, vehicle: &Vehicle, room: &Room, anchors: usize) -> Vec<Axis> {
    let axis = |p: &ParameterSpec| {
        let [a, b] = [0.0, 1.0].map(|share| at(p, room, anchors, share));
        let size = match p.kind {
            Kind::Inverse => Some(Size::Inverse),
            kind => kind.is_size().then_some(Size::From(p.off)),
        };
        Axis { low: a.min(b), high: a.max(b), choice: matches!(p.kind, Kind::Which(_)), size }
    };
    sizes(spec, vehicle).iter().map(axis).collect()
}

/// The value at this share of the range of a parameter.
fn at(p: &ParameterSpec, room: &Room, anchors: usize, share: f64) -> f64 {
    let choice = |count: usize| (share * count as f64).floor().min(count as f64 - 1.0);
    let within = |[low, high]: [f64; 2]| {
        let margin_m = FROM_WALL_M.min(0.25 * (high - low));
        low + margin_m + share * (high - low - 2.0 * margin_m)
    };
    match p.kind {
        Kind::Which(Choice::Anchor(_)) => choice(anchors.max(1)),
        Kind::Which(Choice::Wall) => choice(4),
        Kind::Where(effects::Axis::North) => within(room.north_m),
        Kind::Where(effects::Axis::East) => within(room.east_m),
        Kind::OfTheReceiver => p.default,
        Kind::Size | Kind::Inverse | Kind::Component | Kind::Shape | Kind::Direction => {
            p.low + share * (p.high - p.low)
        }
    }
}

/// Parameters at a share of their size, between "off" (share 0) and what they are. They may leave the
/// plausible range of the list.
pub fn at_share(spec: &EffectSpec, theta: &[f64], share: f64) -> Vec<f64> {
    spec.parameters.iter().zip(theta).map(|(p, value)| sized(p, *value, share)).collect()
}

/// Parameters whose sizes are halfway from what they are to the strong ends of their axes. What is "off" stays so.
pub fn louder(theta: &[f64], axes: &[Axis]) -> Vec<f64> {
    let one = |(value, axis): (&f64, &Axis)| {
        let end = match axis.size {
            None => *value,
            Some(Size::Inverse) if axis.low.abs() < axis.high.abs() => axis.low,
            Some(Size::Inverse) => axis.high,
            Some(Size::From(off)) if *value == off => *value,
            Some(Size::From(off)) if *value > off => axis.high,
            Some(Size::From(_)) => axis.low,
        };
        value + 0.5 * (end - value)
    };
    theta.iter().zip(axes).map(one).collect()
}

fn sized(p: &ParameterSpec, value: f64, share: f64) -> f64 {
    match p.kind {
        Kind::Inverse => value / share,
        kind if kind.is_size() => p.off + share * (value - p.off),
        _ => value,
    }
}

/// 0 to `count` in random order.
fn shuffled(count: usize, rng: &mut Stream) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    for k in (1..count).rev() {
        let other = (rng.uniform() * (k + 1) as f64) as usize;
        order.swap(k, other.min(k));
    }
    order
}

/// An effect on, with all its values.
pub fn with_effect(
    effects: EffectSet,
    spec: &EffectSpec,
    theta: &[f64],
) -> Result<EffectSet, Problems> {
    let values: Vec<(&str, f64)> =
        spec.parameters.iter().map(|p| p.name).zip(theta.iter().copied()).collect();
    effects.with(spec.id, &values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::statistics::ANCHOR_SLOTS;

    #[test]
    fn prop_the_anchor_of_an_effect_shows_in_the_statistics() {
        let slots: Vec<_> = whole().into_iter().filter_map(EffectSpec::anchor_slot).collect();
        assert!(slots.iter().all(|slot| ANCHOR_SLOTS.contains(slot)), "{slots:?}");
        assert!(slots.len() > 3, "{slots:?}");
    }

    #[test]
    fn prop_every_other_draw_of_a_vector_has_one_component_alone() {
        let room = Room { north_m: [0.0, 6.0], east_m: [0.0, 6.0], ceiling_m: 3.0 };
        let rows = |id: &str| {
            let spec = standard().into_iter().find(|s| s.id == id).unwrap();
            draws(spec, &Vehicle::default(), &room, 8, 12, &mut Stream::new(3, id))
        };
        let alone = |id: &str, off: f64, of: usize| {
            let is_alone = |r: &&Vec<f64>| r[..of].iter().filter(|v| **v != off).count() == 1;
            rows(id).iter().filter(is_alone).count()
        };
        assert_eq!((alone("M1", 0.0, 3), alone("L3", 0.0, 2), alone("A1", 1.0, 2)), (6, 6, 6));
        assert!(rows("A6").iter().all(|r| r[1] != 5.0), "places are no components");
        assert!(rows("T3").iter().all(|r| r.iter().all(|v| *v > 0.0)));
    }

    #[test]
    fn prop_louder_goes_to_the_strong_end_and_leaves_what_is_off() {
        let axis = |low, high, size| Axis { low, high, choice: false, size };
        let about_zero = axis(-4.0, 8.0, Some(Size::From(0.0)));
        assert_eq!(louder(&[2.0, -2.0, 0.0], &[about_zero; 3]), [5.0, -3.0, 0.0]);
        let limit = axis(1.0, 3.0, Some(Size::Inverse));
        let factor = axis(0.2, 0.8, Some(Size::From(1.0)));
        assert_eq!(louder(&[2.0, 0.6], &[limit, factor]), [1.5, 0.4]);
        assert_eq!(louder(&[3.0], &[axis(0.0, 7.0, None)]), [3.0], "which anchor is not how much");
    }

    #[test]
    fn prop_draws_cover_every_range_and_stay_inside() {
        let room = Room { north_m: [0.0, 6.0], east_m: [-1.0, 5.0], ceiling_m: 3.0 };
        for spec in whole() {
            let rows = draws(spec, &Vehicle::default(), &room, 8, 40, &mut Stream::new(3, spec.id));
            let axes = axes(spec, &Vehicle::default(), &room, 8);
            for (k, p) in spec.parameters.iter().enumerate() {
                let column: Vec<f64> = rows.iter().map(|r| r[k]).collect();
                assert!(column.iter().all(|v| (p.low..=p.high).contains(v) || p.name == "east"));
                // The axis holds them all, and goes on for no more than a part that a draw is spread over.
                let axis = axes[k];
                let (low, high) = column
                    .iter()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |e, v| (e.0.min(*v), e.1.max(*v)));
                let part = (axis.high - axis.low) / 40.0;
                assert!(axis.is_sound() && axis.low <= low && high <= axis.high, "{}", spec.id);
                // Of a vector every other draw has one component alone: ends may be missing.
                let ends = low - axis.low <= part && axis.high - high <= part;
                assert!(ends || p.kind == Kind::Component, "{} {}", spec.id, p.name);
                if p.name == "anchor" {
                    assert!(column.iter().all(|v| v.fract() == 0.0 && *v < 8.0));
                    assert!((0..8).all(|a| column.contains(&f64::from(a))), "{column:?}");
                }
                if (p.name == "north" || p.name == "east") && spec.id == "U5" {
                    let [low, high] = if p.name == "north" { room.north_m } else { room.east_m };
                    assert!(column.iter().all(|v| (low..=high).contains(v)));
                }
            }
        }
    }

    #[test]
    fn prop_effects_are_read_by_order_and_by_name_and_refused_in_words() {
        assert_eq!(asked("P1").unwrap().1, None);
        assert_eq!(asked("P1=0.08").unwrap().1, Some(vec![0.08]));
        assert_eq!(asked("U2=anchor:3,bias:0.1").unwrap().1, Some(vec![0.1, 3.0]));
        assert_eq!(asked("U2.anchor=3").unwrap().1, asked("U2=anchor:3").unwrap().1);
        let x_mm = |text| asked(text).unwrap().1.unwrap()[0];
        for text in ["I2.x_mm=3", "I2.x_cm=0.3", "I2.x=3", "I2=x:3"] {
            assert!((x_mm(text) - 3.0).abs() < 1e-9, "{text}: {}", x_mm(text));
        }
        for (text, says) in [
            ("I2.x_s=3", "it has x mm, y mm"),
            ("U2.anchor", "a value is missing"),
            ("U2.anchor=3,4", "one value belongs to one parameter"),
            ("U2.ancor=3", "it has bias m, anchor"),
            ("Z9", "no such effect"),
            ("P1=x", "is no number"),
            ("P1=los:0.1", "it has loss"),
            ("P1=0.1,0.2", "1 parameters"),
            ("P1=90", "allowed"),
            ("P1=", "is no number"),
        ] {
            let said = asked(text).unwrap_err();
            assert!(said.contains(says), "{text}: {said}");
        }
    }
}
