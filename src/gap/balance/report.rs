//! What a diagnosis by balance finds: the outcome, what it rests on, and how small a change its references can show.

use std::collections::BTreeMap;

use haltere_model::rotorcraft::MOTORS;
use serde::Serialize;

use super::causes::Kind;
use crate::outcome::{Named, Outcome};

/// Names of the four axes.
pub const AXES: [&str; MOTORS] = ["vertical force", "roll", "pitch", "yaw"];

/// What was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The flight.
    pub flight: String,
    /// Name of the vehicle file.
    pub vehicle: String,
    /// The references that counted.
    pub references: Vec<String>,
    /// The smallest change of each kind that these references can show, at the motor that shows it worst.
    pub can_show: Vec<Smallest>,
    /// The outcome.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// The same in words.
    pub verdict: String,
    /// What has changed, axis by axis.
    pub balance: Vec<AxisChange>,
    /// How many times as much the controller works from row to row.
    pub shaking: Option<f64>,
    /// How far the offsets of the accelerometer lie from those of the references, forward, left, up, g.
    pub accelerometer_g: [Option<f64>; 3],
    /// Probability that nothing has changed.
    pub nothing: f64,
    /// Probability that this is another vehicle.
    pub another_vehicle: f64,
    /// Causes, most probable first; of a weak motor the sizes are losses of 1, of a load kg.
    pub candidates: Vec<Named>,
    /// What was not looked at, and why.
    pub not_checked: Vec<String>,
    /// How far the explanation foretells flights that it was not found on.
    pub held_out: Option<HeldOut>,
    /// The simulator of the user's own that flew what causes do.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulator: Option<Simulator>,
    /// Length of hover that was used, s.
    pub hover_s: f64,
}

/// What a simulator of the user's own has flown.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Simulator {
    /// Flights that were asked of it.
    pub flights: usize,
    /// Why some are not there, and how many.
    pub lost: BTreeMap<String, usize>,
    /// How far its healthy hover lies from the mean of the references, axis by axis, as [`AxisChange::share`].
    pub apart: [f64; MOTORS],
}

/// The smallest size of a kind of cause that can be shown.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Smallest {
    /// Of what.
    pub kind: Kind,
    /// A loss of 1, kg, or times as much shaking; `None`: not even the largest that is tried.
    pub size: Option<f64>,
}

/// One axis of the balance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisChange {
    /// Which.
    pub axis: &'static str,
    /// Change, as a share of the weight, for a moment of the weight at its lever.
    pub share: f64,
    /// Deviation of the next healthy flight, the same.
    pub sigma: f64,
    /// What each reference lies from their mean, the same.
    pub references: Vec<f64>,
    /// What of the change the most probable cause leaves; without one nothing.
    pub left: Option<f64>,
}

/// Flights that the explanation was not found on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HeldOut {
    /// Which.
    pub flights: Vec<String>,
    /// Mean square of vertical force and moments against the references, and with the explanation taken away.
    pub before: f64,
    /// See `before`.
    pub after: f64,
    /// `1 - after/before`.
    pub shrink: f64,
}
