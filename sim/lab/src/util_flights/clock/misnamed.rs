//! What the columns of a truth hold where it is not what they are named after: another unit, or other axes.

use std::fmt;

use nalgebra::{Matrix3, Vector3};

use haltere_log::import::truth::{PositionNames, turns};

use super::{ALIKE, Frames};

/// Places that are laid beside one another in 48 ways; more of them show no more (some ten a second of a flight).
const MOST_PAIRS: usize = 5000;
/// Axes that leave more than this share of the spread of the truth are those of no naming: the estimate is wrong (judgement).
const MOST_LEFT: f64 = 0.5;
/// A turn about the vertical beyond this is told as axes that are named otherwise, rad (45 degrees).
const MOST_TURN_RAD: f64 = std::f64::consts::FRAC_PI_4;
/// Of the axes as they are named a turn that is no other naming is none: so near to one of a quarter it must be, rad (3 degrees).
const NEAR_QUARTER_RAD: f64 = 0.05;

/// A truth whose columns are named otherwise than what they hold: in no metres, or along other axes than those of the anchors.
#[derive(Debug, Clone, PartialEq)]
pub struct Misnamed {
    /// How far it spreads, in that of the estimate, and what it is in; nothing where it is in metres.
    pub(super) unit: Option<(f64, &'static str)>,
    /// How the axes lie; nothing where they are those of the anchors.
    pub(super) axes: Option<OtherAxes>,
    /// What its columns are to be named.
    names: [String; 3],
}

/// Another of the 48 ways to name axes that fits, where the one that is told does not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OtherAxes {
    /// From the truth as it was read to the truth, Earth frame.
    pub(super) turn_EE: Matrix3<f64>,
    /// Distance from the estimate, shifted and turned by no more than [`MOST_TURN_RAD`] about the vertical, rms, m: as the axes are named, and so.
    as_named_m: f64,
    pub(super) renamed_m: f64,
}

impl Misnamed {
    /// Of places, each beside its truth, Earth frame, m. Spreads by other factors than those of a unit are those of an estimate that
    /// is wrong; axes that fit no better than as they are named are those of a path that does not tell.
    pub fn of(
        pairs: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)>,
        names: &PositionNames,
    ) -> Option<Self> {
        let pairs: Vec<_> = pairs.collect();
        let pairs = pairs.iter().step_by(1 + pairs.len() / MOST_PAIRS).copied();
        let factor = Frames::between(pairs.clone())?.spread_factor;
        let unit = match factor {
            f if (300.0..3000.0).contains(&f) => Some(("millimetres", "mm", 1e-3)),
            f if (30.0..300.0).contains(&f) => Some(("centimetres", "cm", 1e-2)),
            _ => None,
        };
        let unit_m = unit.map_or(1.0, |(_, _, unit_m)| unit_m);
        let axes = OtherAxes::of(pairs.map(|(e, t)| (e, t * unit_m)));
        (unit.is_some() || axes.is_some()).then(|| {
            let turn_EE = axes.map_or_else(Matrix3::identity, |axes| axes.turn_EE);
            let names = names.renamed(&turn_EE, unit.map(|(_, suffix, _)| suffix));
            Self { unit: unit.map(|(unit, ..)| (factor, unit)), axes, names }
        })
    }
}

impl OtherAxes {
    fn of(pairs: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> + Clone) -> Option<Self> {
        let named = |turn_EE: Matrix3<f64>| {
            let frames = Frames::between(pairs.clone().map(|(e, t)| (e, turn_EE * t)))?;
            let yaw_rad = frames.yaw_rad.unwrap_or(0.0);
            (yaw_rad.abs() <= MOST_TURN_RAD).then_some((turn_EE, yaw_rad, frames.fitted_rms_m))
        };
        let (turn_EE, yaw_rad, renamed_m) =
            turns().filter_map(named).min_by(|a, b| a.2.total_cmp(&b.2))?;
        let own = Frames::between(pairs)?;
        let own_yaw_rad = own.yaw_rad.unwrap_or(0.0);
        let is_turn = turn_EE[(2, 2)] == 1.0 && turn_EE.determinant() > 0.0;
        let as_named_m = match own_yaw_rad.abs() <= MOST_TURN_RAD {
            true => own.fitted_rms_m,
            false => own.shifted_rms_m,
        };
        let is_other =
            turn_EE != Matrix3::identity() && (!is_turn || yaw_rad.abs() < NEAR_QUARTER_RAD);
        let fits = renamed_m * ALIKE < as_named_m && renamed_m < MOST_LEFT * own.spread_m;
        (is_other && fits).then_some(Self { turn_EE, as_named_m, renamed_m })
    }
}

impl fmt::Display for Misnamed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((factor, unit)) = self.unit {
            write!(
                f,
                "the truth spreads {factor:.0} times as far as the estimate: is it in {unit}? "
            )?;
        }
        if let Some(OtherAxes { turn_EE, as_named_m, renamed_m }) = self.axes {
            let hand =
                if turn_EE.determinant() < 0.0 { ", a mirror image of the room" } else { "" };
            write!(
                f,
                "the truth has other axes than the anchors{hand}: with those that its columns are named after it lies {as_named_m:.2} m \
                 rms beside the estimate, with these {renamed_m:.2} m: "
            )?;
        }
        write!(f, "name its columns {}", self.names.join(","))?;
        if self.names.iter().any(|name| name.starts_with('-')) {
            write!(f, " (one named with a minus holds its axis with the other sign)")?;
        }
        Ok(())
    }
}
