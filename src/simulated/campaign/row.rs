//! What one flight of a campaign came to, as it is kept.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// How a flight ended, by the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// On the floor, disarmed, whole, and inside all the time.
    Landed,
    /// Never off the floor, and whole.
    NotTakenOff,
    /// Outside the fence before anything else went wrong.
    Left,
    /// Off the floor again after it was down.
    Again,
    /// Hit the floor too fast or leaning, or tumbled.
    Crashed,
    /// Still armed or in the air at the limit.
    Unfinished,
    /// The program panicked.
    Panicked,
}

impl Outcome {
    /// Every one, best first.
    pub const ALL: [Outcome; 7] = [
        Outcome::Landed,
        Outcome::NotTakenOff,
        Outcome::Unfinished,
        Outcome::Left,
        Outcome::Again,
        Outcome::Crashed,
        Outcome::Panicked,
    ];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Outcome::Landed => "landed",
            Outcome::NotTakenOff => "did not take off",
            Outcome::Left => "left the volume",
            Outcome::Again => "left the floor again",
            Outcome::Crashed => "crashed",
            Outcome::Unfinished => "unfinished",
            Outcome::Panicked => "panicked",
        }
    }
}

/// One flight. Times count from the start of the mission, s, unless they say otherwise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Number of the flight.
    pub index: u64,
    /// Seed of all its random numbers.
    pub seed: u64,
    /// Drawn values by key.
    pub drawn: BTreeMap<String, serde_json::Value>,
    /// How it ended.
    pub outcome: Outcome,
    /// What happened, in words; empty after a landing.
    pub why: String,
    /// When it crashed.
    pub crashed_s: Option<f64>,
    /// When it left the fence.
    pub left_s: Option<f64>,
    /// When it left the floor again after it was down.
    pub again_s: Option<f64>,
    /// Farthest outside the fence, m.
    pub outside_m: f64,
    /// When the fault came.
    pub fault_s: Option<f64>,
    /// Mode that it met.
    pub fault_mode: String,
    /// From the fault to the next change of mode.
    pub reacted_after_s: Option<f64>,
    /// Items of its mission.
    pub items: u64,
    /// Of those flown, in whatever order.
    pub items_flown: u64,
    /// Length of the flight.
    pub flown_s: f64,
    /// Of that in the air.
    pub airborne_s: f64,
    /// Mean distance of estimate and truth in the air, m.
    pub estimate_mean_m: Option<f64>,
    /// Largest, m.
    pub estimate_worst_m: Option<f64>,
    /// Mean distance of truth and setpoint under position control in the air, m.
    pub tracking_mean_m: Option<f64>,
    /// Largest, m.
    pub tracking_worst_m: Option<f64>,
    /// Largest tilt, degrees.
    pub tilt_worst_deg: f64,
    /// Hardest contact with the floor: speed downwards, m/s.
    pub contact_mps: f64,
    /// Contacts with the floor after lift-off.
    pub contacts: u64,
    /// Lowest supply under load, V.
    pub lowest_supply_v: f64,
    /// Modes gone through, in order.
    pub modes: String,
    /// What the companion threw away, by reason, all links.
    pub drops: BTreeMap<String, u64>,
    /// What the companion said last.
    pub said: Vec<String>,
}

impl Row {
    /// Whether it ended whole, inside, or never off the floor.
    pub fn is_safe(&self) -> bool {
        matches!(self.outcome, Outcome::Landed | Outcome::NotTakenOff)
    }

    /// Whether its mission was flown to the end.
    pub fn flew_mission(&self) -> bool {
        self.items > 0 && self.items_flown == self.items
    }

    /// Whether it was outside, whatever came first.
    pub fn left(&self) -> bool {
        self.left_s.is_some()
    }

    /// Whether it broke, whatever came first.
    pub fn crashed(&self) -> bool {
        self.crashed_s.is_some()
    }

    /// Whether it left the floor again, whatever came first.
    pub fn left_floor_again(&self) -> bool {
        self.again_s.is_some()
    }

    /// A flight whose program panicked.
    pub fn panicked(
        index: u64,
        seed: u64,
        drawn: BTreeMap<String, serde_json::Value>,
        why: String,
    ) -> Self {
        Self { outcome: Outcome::Panicked, why, ..Self::blank(index, seed, drawn) }
    }

    /// Nothing has happened yet.
    pub fn blank(index: u64, seed: u64, drawn: BTreeMap<String, serde_json::Value>) -> Self {
        Self {
            index,
            seed,
            drawn,
            outcome: Outcome::NotTakenOff,
            why: String::new(),
            crashed_s: None,
            left_s: None,
            again_s: None,
            outside_m: 0.0,
            fault_s: None,
            fault_mode: String::new(),
            reacted_after_s: None,
            items: 0,
            items_flown: 0,
            flown_s: 0.0,
            airborne_s: 0.0,
            estimate_mean_m: None,
            estimate_worst_m: None,
            tracking_mean_m: None,
            tracking_worst_m: None,
            tilt_worst_deg: 0.0,
            contact_mps: 0.0,
            contacts: 0,
            lowest_supply_v: 0.0,
            modes: String::new(),
            drops: BTreeMap::new(),
            said: Vec::new(),
        }
    }

    /// How bad it was, for lists of the worst: larger is worse. By the outcome, then by whether the mission was flown,
    /// then by the number that is given in words.
    pub fn badness(&self) -> (f64, String) {
        let rank = Outcome::ALL.iter().position(|o| *o == self.outcome).unwrap_or_default();
        let short = f64::from(u8::from(!self.flew_mission()));
        let estimate_m = self.estimate_worst_m.unwrap_or_default();
        let tracking_m = self.tracking_worst_m.unwrap_or_default();
        let numbers = [
            (1e3 * self.outside_m, format!("{:.2} m outside", self.outside_m)),
            (10.0 * estimate_m, format!("estimate off by {estimate_m:.2} m")),
            (tracking_m, format!("{tracking_m:.2} m from the setpoint")),
        ];
        let worst = numbers.into_iter().filter(|n| n.0 > 0.0).max_by(|a, b| a.0.total_cmp(&b.0));
        let (most, words) = worst.unwrap_or_default();
        (1e6 * rank as f64 + 1e5 * short + most, words)
    }
}
