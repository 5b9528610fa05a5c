//! Things that stand or walk between the anchors and the tag: metal cabinets, and people.
//!
//! A cabinet of 0.6 × 0.6 × 1.8 m stands 1 to 3 m from an anchor, aside of the line to the middle of the room, where vehicles start; a
//! path through it is `ρ -> ρ + e min(1, l/0.3 m) + σ n`, `l` the length inside (m), `e` of the cabinet: a reflection
//! is taken for the direct path, at full signal. A person, a column of 0.22 m radius and 1.75 m height, walks round the
//! middle of the room at 1 m/s and does the same with less. Source: UTIL: metal box in flight 0.8 to 2.6 m (README of
//! the recordings, `const4-trial3`), static with metal 0.22 m, with a wooden cabinet 0.03 m (`ident`); no
//! recording at hand holds a person, who is taken between those two. Left out: paths between anchors.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use crate::effects::{Block, Build, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::random::Stream;
use crate::tag::air::Packet;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N20",
    name: "clutter",
    block: Block::Uwb,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "cabinets",
            "",
            Kind::Size,
            0.0,
            0.0,
            [0.0, 8.0],
            "metal cabinets, one before an anchor each",
        ),
        ParameterSpec::new("people", "", Kind::Size, 0.0, 0.0, [0.0, 4.0], "people who walk"),
        ParameterSpec::new(
            "least",
            "m",
            Kind::Shape,
            0.8,
            0.8,
            [0.1, 2.0],
            "added by a cabinet, least",
        ),
        ParameterSpec::new(
            "most",
            "m",
            Kind::Shape,
            2.6,
            2.6,
            [0.1, 4.0],
            "added by a cabinet, most",
        ),
    ],
    off: "an empty room",
    source: "UTIL, flights with a metal box and static tests",
    equation: "ρ -> ρ + e min(1, l/0.3) + σ n",
    build: |b| Box::new(Clutter::new(b)),
};

/// Half width and height of a cabinet, m.
const HALF_M: f64 = 0.3;
const CABINET_M: f64 = 1.8;
/// How far from its anchor and aside of the line to the middle of the room it stands, m: who starts in the middle sees
/// every anchor.
const AWAY_M: [f64; 2] = [1.0, 3.0];
const ASIDE_M: [f64; 2] = [0.5, 1.5];
/// Length inside from which a path is blocked altogether, m.
const THROUGH_M: f64 = 0.3;
/// More noise of a blocked path, one sigma: what metal and the wooden cabinet of the static tests have more than free
/// sight, by their 5th and 95th percentiles, m.
const STD_M: f64 = 0.04;
/// A person: radius, height, added path (between wooden cabinet and metal of the static tests), speed and distance from
/// the middle of the room.
const PERSON_M: [f64; 2] = [0.22, 1.75];
const PERSON_ADDS_M: [f64; 2] = [0.03, 0.22];
const WALK_MPS: f64 = 1.0;
const WALK_M: [f64; 2] = [2.0, 3.5];

struct Cabinet {
    middle_E_m: [f64; 2],
    adds_m: f64,
}

struct Person {
    radius_m: f64,
    phase: f64,
    adds_m: f64,
}

struct Clutter {
    cabinets: Vec<Cabinet>,
    people: Vec<Person>,
    middle_E_m: [f64; 2],
    rng: Stream,
}

impl Clutter {
    fn new(b: Build<'_>) -> Self {
        let mut rng = b.rng;
        let middle_E_m = [b.room.north_m, b.room.east_m].map(|[low, high]| 0.5 * (low + high));
        // Whoever has no wish for a place draws none: low anchors first, in an order of chance.
        let mut order: Vec<(bool, f64, usize)> = (0..b.sites_E_m.len())
            .map(|i| (-b.sites_E_m[i].z > CABINET_M, rng.uniform(), i))
            .collect();
        order.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
        let cabinets = order.iter().take(b.value[0].round() as usize).map(|(_, _, anchor)| {
            let site = b.sites_E_m[*anchor];
            let [to_n, to_e] = [middle_E_m[0] - site.x, middle_E_m[1] - site.y];
            let far_m = to_n.hypot(to_e).max(1e-6);
            let away_m = rng.between(AWAY_M[0], AWAY_M[1]).min(0.5 * far_m);
            let side = if rng.uniform() < 0.5 { -1.0 } else { 1.0 };
            let aside_m = side * rng.between(ASIDE_M[0], ASIDE_M[1]);
            Cabinet {
                middle_E_m: [
                    site.x + (to_n * away_m - to_e * aside_m) / far_m,
                    site.y + (to_e * away_m + to_n * aside_m) / far_m,
                ],
                adds_m: rng.between(b.value[2], b.value[3].max(b.value[2])),
            }
        });
        let cabinets = cabinets.collect();
        let widest_m = [b.room.north_m, b.room.east_m].map(|[low, high]| 0.5 * (high - low));
        let most_m = (widest_m[0].min(widest_m[1]) - PERSON_M[0]).max(0.0);
        let people = (0..b.value[1].round() as usize)
            .map(|_| Person {
                radius_m: rng.between(WALK_M[0], WALK_M[1]).min(most_m),
                phase: rng.between(0.0, TAU),
                adds_m: rng.between(PERSON_ADDS_M[0], PERSON_ADDS_M[1]),
            })
            .collect();
        Self { cabinets, people, middle_E_m, rng }
    }
}

/// Length of the path from `from` to `to` inside a box that stands on the floor, m.
fn inside_m(
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    middle_E_m: [f64; 2],
    half_m: f64,
    high_m: f64,
) -> f64 {
    let along = to - from;
    let low = [middle_E_m[0] - half_m, middle_E_m[1] - half_m, -high_m];
    let high = [middle_E_m[0] + half_m, middle_E_m[1] + half_m, 0.0];
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for axis in 0..3 {
        let [one, other] = [low[axis], high[axis]].map(|side| (side - from[axis]) / along[axis]);
        if one.is_finite() && other.is_finite() {
            enter = enter.max(one.min(other));
            leave = leave.min(one.max(other));
        } else if from[axis] < low[axis] || from[axis] > high[axis] {
            return 0.0;
        }
    }
    (leave - enter).max(0.0) * along.norm()
}

impl Effect for Clutter {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Air]
    }
    fn air(&mut self, s: &State, packet: &mut Packet) {
        let noise = self.rng.normal();
        let (from, to) = (packet.from_E_m, packet.tag_E_m);
        let mut block = |middle_E_m, half_m, high_m, adds_m: f64| {
            let share = (inside_m(&from, &to, middle_E_m, half_m, high_m) / THROUGH_M).min(1.0);
            packet.tag_extra_m += share * (adds_m + STD_M * noise);
        };
        for cabinet in &self.cabinets {
            block(cabinet.middle_E_m, HALF_M, CABINET_M, cabinet.adds_m);
        }
        for person in &self.people {
            let angle = person.phase + WALK_MPS * s.t_s / person.radius_m.max(0.1);
            let [north, east] = self.middle_E_m;
            let at = [north + person.radius_m * angle.cos(), east + person.radius_m * angle.sin()];
            block(at, PERSON_M[0], PERSON_M[1], person.adds_m);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_a_path_is_blocked_where_it_goes_through() {
        let at = |x, y, z| Vector3::new(x, y, z);
        let inside = |from, to| inside_m(&from, &to, [2.0, 2.0], 0.3, 1.8);
        assert!((inside(at(0.0, 2.0, -1.0), at(4.0, 2.0, -1.0)) - 0.6).abs() < 1e-9);
        assert_eq!(inside(at(0.0, 2.0, -2.0), at(4.0, 2.0, -2.0)), 0.0);
        assert_eq!(inside(at(0.0, 2.0, -1.0), at(1.5, 2.0, -1.0)), 0.0);
        assert_eq!(inside(at(0.0, 0.0, -1.0), at(4.0, 1.0, -1.0)), 0.0);
    }

    #[test]
    fn prop_cabinets_add_what_was_measured_and_an_empty_room_nothing() {
        let mut empty = probe::build(&SPEC, &[]);
        let mut full = probe::build(&SPEC, &[("cabinets", 8.0)]);
        let mean = |effect: &mut Box<dyn Effect>, from| {
            // Over the places of the room: the cabinet shades some of them.
            (0..400)
                .map(|k| {
                    let place = Vector3::new(
                        3.0 + 0.2 * f64::from(k / 20),
                        3.0 + 0.2 * f64::from(k % 20),
                        -1.0,
                    );
                    let mut p = probe::packet(from, place);
                    effect.air(&probe::hover(), &mut p);
                    p.tag_extra_m
                })
                .sum::<f64>()
                / 400.0
        };
        assert_eq!(mean(&mut empty, 0), 0.0);
        let low: Vec<f64> = (0..4).map(|from| mean(&mut full, from)).collect();
        assert!(
            low.iter().all(|m| (0.0..2.6).contains(m)) && low.iter().any(|m| *m > 0.1),
            "{low:?}"
        );
        // High anchors look over it.
        assert!(mean(&mut full, 7).abs() < 0.05);
    }
}
