//! What is done to a recording: exactly what a sensor would have told, had it been so.

use crate::util_flights::file::{Event, Flight, Sample};
use haltere_core::frames::{E, Vec3};
use haltere_core::measure::AnchorId;
use haltere_core::time::HostTime;
use haltere_log::import::{Recording, Row};
use nalgebra::Vector3;
use serde::Serialize;

/// An effect at a sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Effect {
    /// The anchor at this place of the survey stands so far from where the survey has it, m.
    Moved { anchor: usize, by_E_m: [f64; 3] },
    /// Distances to the anchor are told longer by this, m.
    Constant { anchor: usize, by_m: f64 },
    /// The way to the anchor is longer by this where the tag is beyond a plane: `along · p > from`.
    Cut { anchor: usize, by_m: f64, along_E: [f64; 2], from_m: f64 },
    /// The accelerometer tells so many times as much more.
    Acceleration { share: f64 },
    /// The gyroscope.
    Rate { share: f64 },
    /// The voltage is told higher by this, V.
    Voltage { by_v: f64 },
}

/// Which effect, without its size: what a diagnosis is to name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Moved(usize),
    Constant(usize),
    Cut(usize),
    Acceleration,
    Rate,
    Voltage,
    /// Thrust that is less for the same command and voltage: no sensor's, and what a wrong voltage is taken for.
    Thrust,
}

impl Kind {
    /// Without the anchor.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Moved(_) => "anchor moved",
            Kind::Constant(_) => "constant added",
            Kind::Cut(_) => "line of sight cut",
            Kind::Acceleration => "accelerometer scaled",
            Kind::Rate => "gyroscope scaled",
            Kind::Voltage => "voltage offset",
            Kind::Thrust => "thrust lost",
        }
    }
}

impl Effect {
    pub fn kind(self) -> Kind {
        match self {
            Effect::Moved { anchor, .. } => Kind::Moved(anchor),
            Effect::Constant { anchor, .. } => Kind::Constant(anchor),
            Effect::Cut { anchor, .. } => Kind::Cut(anchor),
            Effect::Acceleration { .. } => Kind::Acceleration,
            Effect::Rate { .. } => Kind::Rate,
            Effect::Voltage { .. } => Kind::Voltage,
        }
    }

    /// The same, so many times as large.
    pub fn times(self, times: f64) -> Self {
        match self {
            Effect::Moved { anchor, by_E_m } => {
                Effect::Moved { anchor, by_E_m: by_E_m.map(|m| times * m) }
            }
            Effect::Constant { anchor, by_m } => Effect::Constant { anchor, by_m: times * by_m },
            Effect::Cut { anchor, by_m, along_E, from_m } => {
                Effect::Cut { anchor, by_m: times * by_m, along_E, from_m }
            }
            Effect::Acceleration { share } => Effect::Acceleration { share: times * share },
            Effect::Rate { share } => Effect::Rate { share: times * share },
            Effect::Voltage { by_v } => Effect::Voltage { by_v: times * by_v },
        }
    }

    /// What the tag, at this place, measures more to the anchor at this place of the survey, m.
    fn longer_m(self, anchor: usize, anchor_E_m: Vec3<E>, tag_E_m: Vec3<E>) -> f64 {
        match self {
            Effect::Moved { anchor: of, by_E_m } if of == anchor => {
                let by = Vec3::from_raw(Vector3::from(by_E_m));
                (tag_E_m - (anchor_E_m + by)).norm() - (tag_E_m - anchor_E_m).norm()
            }
            Effect::Constant { anchor: of, by_m } if of == anchor => by_m,
            Effect::Cut { anchor: of, by_m, along_E: [north, east], from_m }
                if of == anchor && north * tag_E_m.x() + east * tag_E_m.y() > from_m =>
            {
                by_m
            }
            _ => 0.0,
        }
    }

    /// A flight of UTIL with this from a time on. `tag_at`: where the tag was.
    pub fn into_flight(
        self,
        flight: &Flight,
        from: HostTime,
        tag_at: impl Fn(HostTime) -> Option<Vec3<E>>,
    ) -> Flight {
        let ids = flight.survey.ids();
        let longer = |id: AnchorId, tag: Vec3<E>| {
            let anchor = ids.iter().position(|other| *other == id);
            let place = anchor.zip(flight.survey.position_E_m(id));
            place.map_or(0.0, |(anchor, at_E_m)| self.longer_m(anchor, at_E_m, tag))
        };
        let changed = |event: &Event| {
            let mut event = *event;
            if event.at < from {
                return event;
            }
            match (&mut event.sample, self) {
                (Sample::Tdoa(tdoa), _) => {
                    if let Some(tag) = tag_at(event.at) {
                        tdoa.distance_diff_m +=
                            longer(tdoa.anchor_b, tag) - longer(tdoa.anchor_a, tag);
                    }
                }
                (Sample::Acc(acc), Effect::Acceleration { share }) => *acc = *acc * (1.0 + share),
                (Sample::Gyro(rate), Effect::Rate { share }) => *rate = *rate * (1.0 + share),
                _ => {}
            }
            event
        };
        Flight {
            name: flight.name.clone(),
            survey: flight.survey.clone(),
            events: flight.events.iter().map(changed).collect(),
        }
    }

    /// A flight of the Flapper with this from a time on, s of its clock.
    pub fn into_recording(self, flight: &Recording, from_s: f64) -> Recording {
        let changed = |row: &Row| match self {
            Effect::Voltage { by_v } if row.t_s >= from_s => {
                Row { supply_v: row.supply_v + by_v, ..*row }
            }
            _ => *row,
        };
        Recording { rows: flight.rows.iter().map(changed).collect(), ..flight.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_an_effect_at_an_anchor_is_what_geometry_says() {
        let [anchor, tag] = [Vec3::new(3.0, 0.0, 0.0), Vec3::new(0.0, 0.0, 0.0)];
        let longer = |effect: Effect, anchor_at: usize| effect.longer_m(anchor_at, anchor, tag);
        let moved = Effect::Moved { anchor: 2, by_E_m: [0.0, 4.0, 0.0] };
        assert_eq!((longer(moved, 2), longer(moved, 1)), (2.0, 0.0));
        let cut = |from_m| Effect::Cut { anchor: 2, by_m: 0.5, along_E: [1.0, 0.0], from_m };
        assert_eq!((longer(cut(-1.0), 2), longer(cut(1.0), 2)), (0.5, 0.0));
        assert_eq!(longer(Effect::Constant { anchor: 2, by_m: 0.3 }.times(2.0), 2), 0.6);
    }
}
