//! `[told]`: what an operator told the companion that is not so, there from the start. The first day in a new
//! room: axes of the wrong hand, feet for metres, a heading that is not the room's.

use haltere_core::checks::Problems;
use haltere_core::frames::{E, Vec3};
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;
use serde::{Deserialize, Serialize};

/// Errors of survey and heading.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Told {
    /// Survey of the wrong hand. Absent: of the right one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mirror: Option<Mirror>,
    /// The survey is turned about the middle of the anchors, clockwise seen from above, degrees.
    pub turn_deg: f64,
    /// Each coordinate of it is so many times what was measured.
    pub scale: f64,
    /// These two anchors are written down as each other.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub swapped: Option<[u8; 2]>,
    /// Added to the angle from room north to the board's north that the companion is told, degrees.
    pub heading_deg: f64,
}

/// How a survey is of the wrong hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mirror {
    /// North and south are exchanged.
    North,
    /// East and west are exchanged.
    East,
    /// Floor and ceiling are exchanged.
    Height,
    /// x and y are exchanged.
    Diagonal,
}

impl Default for Told {
    fn default() -> Self {
        Self { mirror: None, turn_deg: 0.0, scale: 1.0, swapped: None, heading_deg: 0.0 }
    }
}

impl Told {
    /// Says what is out of range.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        problems.range(format_args!("{key}.turn_deg"), self.turn_deg, -180.0..=180.0, "deg");
        problems.range(format_args!("{key}.scale"), self.scale, 0.1..=10.0, "");
        problems.range(format_args!("{key}.heading_deg"), self.heading_deg, -180.0..=180.0, "deg");
    }

    /// The angle from room north to the board's north that the companion is told for this one, degrees.
    pub fn north_offset_deg(&self, true_deg: f64) -> f64 {
        let angle_deg = true_deg + self.heading_deg;
        if angle_deg.abs() <= 180.0 { angle_deg } else { angle_deg - 360.0 * angle_deg.signum() }
    }

    /// What the companion is told of this survey.
    pub fn survey(&self, truth: &Survey) -> Result<Survey, Problems> {
        if *self == (Self { heading_deg: self.heading_deg, ..Self::default() }) {
            return Ok(truth.clone()); // to the last bit
        }
        let mut anchors: Vec<(AnchorId, Vec3<E>)> =
            truth.ids().iter().filter_map(|id| Some((*id, truth.position_E_m(*id)?))).collect();
        let count = anchors.len().max(1) as f64;
        let mean: [f64; 3] =
            std::array::from_fn(|axis| anchors.iter().map(|(_, at)| at[axis]).sum::<f64>() / count);
        for (_, at) in &mut anchors {
            *at = self.place(at.to_array(), mean);
        }
        if let Some(pair) = self.swapped {
            let find = |id: u8| anchors.iter().position(|(a, _)| a.0 == id);
            let [a, b] = pair.map(find);
            let mut problems = Problems::new();
            match (a, b) {
                (Some(a), Some(b)) => {
                    let (at_a, at_b) = (anchors[a].1, anchors[b].1);
                    (anchors[a].1, anchors[b].1) = (at_b, at_a);
                }
                _ => problems.say(format!("told.swapped = {pair:?}: no such anchors")),
            }
            problems.into_result()?;
        }
        Survey::new(&anchors)
    }

    /// Where an anchor is said to be, E, m.
    fn place(&self, at: [f64; 3], mean: [f64; 3]) -> Vec3<E> {
        let mut off: [f64; 3] = std::array::from_fn(|axis| at[axis] - mean[axis]);
        match self.mirror {
            None => {}
            Some(Mirror::North) => off[0] = -off[0],
            Some(Mirror::East) => off[1] = -off[1],
            Some(Mirror::Height) => off[2] = -off[2],
            Some(Mirror::Diagonal) => off.swap(0, 1),
        }
        let (sin, cos) = self.turn_deg.to_radians().sin_cos();
        let [n, e, d] = off;
        let turned = [n * cos - e * sin, n * sin + e * cos, d];
        Vec3::from_array(std::array::from_fn(|axis| self.scale * (mean[axis] + turned[axis])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_model::room::Room;

    fn told(told: Told) -> [f64; 3] {
        let truth = Survey::new(&Room::default().corner_anchors()).unwrap();
        // Anchor 1: north, west, on the floor.
        told.survey(&truth).unwrap().position_E_m(AnchorId(1)).unwrap().to_array()
    }

    #[test]
    fn prop_surveys_are_wrong_as_they_say() {
        let right = Told::default();
        let is = |given: Told, wanted: [f64; 3]| {
            let found = told(given.clone());
            let off = (0..3).map(|i| (found[i] - wanted[i]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-9, "{given:?}: {found:?}, not {wanted:?}");
        };
        let mirror = |mirror| Told { mirror: Some(mirror), ..Told::default() };
        is(right.clone(), [10.0, 0.0, 0.0]);
        is(mirror(Mirror::North), [0.0, 0.0, 0.0]);
        is(mirror(Mirror::East), [10.0, 10.0, 0.0]);
        is(mirror(Mirror::Height), [10.0, 0.0, -7.0]);
        is(mirror(Mirror::Diagonal), [0.0, 10.0, 0.0]);
        is(Told { turn_deg: 90.0, ..right.clone() }, [10.0, 10.0, 0.0]);
        is(Told { scale: 0.5, ..right.clone() }, [5.0, 0.0, 0.0]);
        is(Told { swapped: Some([1, 6]), ..right.clone() }, [0.0, 10.0, -7.0]);
        let truth = Survey::new(&Room::default().corner_anchors()).unwrap();
        assert!(Told { swapped: Some([1, 60]), ..right }.survey(&truth).is_err());
    }
}
