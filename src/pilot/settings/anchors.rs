//! The anchor file: a room as people measure it, turned into the Earth frame once, when it is read.

use serde::Deserialize;

use super::read::{exactly, parse_strictly};
use haltere_core::checks::Problems;
use haltere_core::frames::{E, U, Vec3, earth_from_survey};
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;

/// Farthest an anchor may stand from the origin in the plane, m: beyond it no DWM1000 is heard
/// indoors (Decawave product brief: some 60 m), so the unit slipped.
const PLANE_LIMIT_M: f64 = 100.0;

/// Lowest and highest anchor above the floor, m. The floor is height 0: a little below it stands
/// an anchor in a pit, far above it no hall has a roof.
const HEIGHT_RANGE_M: [f64; 2] = [-2.0, 40.0];

#[derive(Debug, Clone, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct AnchorFile {
    frame: Frame,
    #[serde(default)]
    anchor: Vec<Anchor>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Frame {
    Enu,
    Ned,
}

#[derive(Debug, Clone, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Anchor {
    id: u8,
    #[serde(deserialize_with = "exactly")]
    position_m: [f64; 3],
}

/// An anchor file in memory. `name` stands in messages.
pub fn parse_anchors(name: &str, text: &str) -> Result<Survey, Problems> {
    let file: AnchorFile = parse_strictly(name, text)?;
    let mut problems = Problems::new();
    let [lowest_m, highest_m] = HEIGHT_RANGE_M;
    let (z_low_m, z_high_m) = match file.frame {
        Frame::Enu => (lowest_m, highest_m),
        Frame::Ned => (-highest_m, -lowest_m),
    };
    for Anchor { id, position_m: [x_m, y_m, z_m] } in &file.anchor {
        let plane = -PLANE_LIMIT_M..=PLANE_LIMIT_M;
        let key = |axis| format!("anchor {id}: position_m.{axis}");
        problems.range(key("x"), *x_m, plane.clone(), "m");
        problems.range(key("y"), *y_m, plane, "m");
        problems.range(key("z"), *z_m, z_low_m..=z_high_m, "m");
    }
    let heights = file.anchor.iter().map(|anchor| match file.frame {
        Frame::Enu => anchor.position_m[2],
        Frame::Ned => -anchor.position_m[2],
    });
    if heights.sum::<f64>() < 0.0 {
        let (is, other) = match file.frame {
            Frame::Enu => ("enu", "ned"),
            Frame::Ned => ("ned", "enu"),
        };
        problems.say(format!(
            "frame = \"{is}\": the anchors would hang below the floor; if z was measured the other \
             way, write frame = \"{other}\""
        ));
    }
    let anchors: Vec<(AnchorId, Vec3<E>)> = file
        .anchor
        .iter()
        .map(|Anchor { id, position_m: [x_m, y_m, z_m] }| {
            let pos_E_m = match file.frame {
                Frame::Ned => Vec3::new(*x_m, *y_m, *z_m),
                Frame::Enu => earth_from_survey(Vec3::<U>::new(*x_m, *y_m, *z_m)),
            };
            (AnchorId(*id), pos_E_m)
        })
        .collect();
    let survey = if problems.is_empty() { Survey::new(&anchors) } else { Err(problems) };
    survey.map_err(|problems| {
        let mut named = Problems::new();
        for line in problems.lines() {
            named.say(format!("{name}: {line}"));
        }
        named
    })
}
