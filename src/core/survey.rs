//! Anchor survey: where the UWB anchors stand, Earth frame, and whether that can be flown on.

use nalgebra::{Matrix3, Vector3};

use crate::checks::Problems;
use crate::frames::{E, Vec3};
use crate::measure::AnchorId;

/// Farthest an anchor may stand from the origin, m. The DWM1000 hears some 60 m indoors at most
/// (Decawave product brief), so a larger number is a slip of the unit.
const ANCHOR_LIMIT_M: f64 = 100.0;

/// Anchors closer than this are one anchor written twice, m.
const ANCHOR_SEPARATION_M: f64 = 0.05;

/// Least rms extent of the anchors along their thinnest direction, m. Below it every TDOA is
/// blind to the side of the plane on which the tag is.
const LEAST_THICKNESS_M: f64 = 0.15;

/// Positions of the anchors by their number.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    positions_E_m: Box<[Option<Vec3<E>>; 256]>,
    ids: Vec<AnchorId>,
}

impl Survey {
    /// From positions in the Earth frame. Refuses what cannot be flown on, all reasons at once.
    pub fn new(anchors: &[(AnchorId, Vec3<E>)]) -> Result<Self, Problems> {
        let mut problems = Problems::new();
        let mut positions_E_m = Box::new([None; 256]);
        for (id, pos_E_m) in anchors {
            for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
                problems.range(
                    format_args!("anchor {id}: position_m.{name}"),
                    pos_E_m[axis],
                    -ANCHOR_LIMIT_M..=ANCHOR_LIMIT_M,
                    "m",
                );
            }
            let slot = &mut positions_E_m[usize::from(id.0)];
            if slot.is_some() {
                problems.say(format!("anchor {id}: listed twice, keep one entry"));
            }
            *slot = Some(*pos_E_m);
        }
        for (i, (id, pos)) in anchors.iter().enumerate() {
            for (other_id, other) in &anchors[..i] {
                let distance_m = (*pos - *other).norm();
                if id != other_id && distance_m < ANCHOR_SEPARATION_M {
                    problems.say(format!(
                        "anchors {other_id} and {id}: {distance_m:.3} m apart, at least \
                         {ANCHOR_SEPARATION_M} m expected; measure them again"
                    ));
                }
            }
        }
        if anchors.len() < 5 {
            problems.say(format!(
                "{} anchors, at least 5 needed to find a position in space from differences of \
                 distance without ambiguity; add anchors to the survey",
                anchors.len()
            ));
        } else if problems.is_empty() {
            let thickness_m = thickness_m(anchors);
            if thickness_m < LEAST_THICKNESS_M {
                problems.say(format!(
                    "anchors are coplanar: {thickness_m:.3} m rms from their best plane, at least \
                     {LEAST_THICKNESS_M} m needed; the side of the plane cannot be told apart, \
                     move one anchor out of it"
                ));
            }
        }
        problems.into_result()?;
        let mut ids: Vec<_> = anchors.iter().map(|(id, _)| *id).collect();
        ids.sort();
        Ok(Self { positions_E_m, ids })
    }

    /// Position of an anchor, Earth frame, m.
    #[inline]
    pub fn position_E_m(&self, id: AnchorId) -> Option<Vec3<E>> {
        self.positions_E_m[usize::from(id.0)]
    }

    /// Anchors, ascending.
    pub fn ids(&self) -> &[AnchorId] {
        &self.ids
    }

    /// Centre of the anchors, Earth frame, m.
    pub fn centre_E_m(&self) -> Vec3<E> {
        let sum = self
            .ids
            .iter()
            .filter_map(|id| self.position_E_m(*id))
            .fold(Vec3::zero(), |sum, pos| sum + pos);
        sum * (1.0 / self.ids.len() as f64)
    }
}

impl Survey {
    /// Dilution of precision at a place: position error in the plane and in height, m, for each m of
    /// white error of the ranges; `None` where the differences do not fix a position.
    ///
    /// With u_j the directions from the anchors to the place, differences of all ranges carry the
    /// information `A = Σ (u_j − ū)(u_j − ū)ᵀ` about it, for errors of 1 m; the answer is the root of
    /// the diagonal of `A⁻¹`. `without` leaves an anchor out: one that an obstacle hides.
    pub fn dilution(&self, at_E_m: Vec3<E>, without: Option<AnchorId>) -> Option<[f64; 2]> {
        self.dilution_of(at_E_m, |id| Some(id) != without)
    }

    /// The same of the anchors that `with` names.
    pub fn dilution_of(
        &self,
        at_E_m: Vec3<E>,
        with: impl Fn(AnchorId) -> bool,
    ) -> Option<[f64; 2]> {
        let directions = || {
            self.ids.iter().filter(|id| with(**id)).filter_map(|id| {
                let from = at_E_m.raw() - self.position_E_m(*id)?.raw();
                from.try_normalize(1e-6)
            })
        };
        let n = directions().count();
        let mean = directions().sum::<Vector3<f64>>() / n.max(1) as f64;
        let information = directions().fold(Matrix3::zeros(), |sum: Matrix3<f64>, u| {
            let d = u - mean;
            sum + d * d.transpose()
        });
        let variance = information.try_inverse()?;
        let plane = (variance[(0, 0)] + variance[(1, 1)]).sqrt();
        let height = variance[(2, 2)].sqrt();
        (plane.is_finite() && height.is_finite()).then_some([plane, height])
    }

    /// Looks at a flight volume (lowest and highest corner, Earth frame, m) on a grid of
    /// [`GRID`] places along each axis.
    pub fn examine(&self, low_E_m: Vec3<E>, high_E_m: Vec3<E>) -> Geometry {
        let mut places = Vec::new();
        for i in 0..GRID * GRID * GRID {
            let share = |axis: u32| (i / GRID.pow(axis) % GRID) as f64 / (GRID - 1) as f64;
            let along = |k: usize| low_E_m[k] + (high_E_m[k] - low_E_m[k]) * share(k as u32);
            places.push(Vec3::new(along(0), along(1), along(2)));
        }
        let worst_of = |without: Option<AnchorId>| {
            let mut found: Vec<(f64, Vec3<E>, [f64; 2])> = places
                .iter()
                .map(|at| {
                    let dilution =
                        self.dilution(*at, without).unwrap_or([f64::INFINITY, f64::INFINITY]);
                    (dilution[0].hypot(dilution[1]), *at, dilution)
                })
                .collect();
            found.sort_by(|a, b| a.0.total_cmp(&b.0));
            found
        };
        let all = worst_of(None);
        let middle = all.get(all.len() / 2).map_or([f64::INFINITY; 2], |m| m.2);
        let (worst_at_E_m, worst) =
            all.last().map_or((low_E_m, [f64::INFINITY; 2]), |w| (w.1, w.2));
        let needed = self
            .ids
            .iter()
            .filter_map(|id| Some((*id, worst_of(Some(*id)).last()?.2)))
            .max_by(|a, b| a.1[0].hypot(a.1[1]).total_cmp(&b.1[0].hypot(b.1[1])));
        Geometry { middle, worst, worst_at_E_m, needed }
    }
}

/// Places along each axis of a volume.
pub const GRID: usize = 6;

/// How well a survey fixes positions in a volume: plane and height, m for each m of range error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// At the middle one of all places.
    pub middle: [f64; 2],
    /// At the worst place.
    pub worst: [f64; 2],
    /// Where that is.
    pub worst_at_E_m: Vec3<E>,
    /// The anchor that is needed most, and the worst place without it.
    pub needed: Option<(AnchorId, [f64; 2])>,
}

/// Rms distance of the anchors from the plane that fits them best, m.
fn thickness_m(anchors: &[(AnchorId, Vec3<E>)]) -> f64 {
    let n = anchors.len() as f64;
    let mean = anchors.iter().fold(Vector3::zeros(), |sum, (_, p)| sum + p.raw()) / n;
    let scatter = anchors.iter().fold(Matrix3::zeros(), |sum, (_, p)| {
        let d = p.raw() - mean;
        sum + d * d.transpose()
    }) / n;
    scatter.symmetric_eigenvalues().min().max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corners() -> Vec<(AnchorId, Vec3<E>)> {
        (0..8u8)
            .map(|i| {
                let at = |bit: u8, far: f64| if i & bit != 0 { far } else { 0.0 };
                (AnchorId(i), Vec3::new(at(1, 10.0), at(2, 10.0), -at(4, 7.0)))
            })
            .collect()
    }

    #[test]
    fn prop_a_hall_is_accepted() {
        let survey = Survey::new(&corners()).unwrap();
        assert_eq!(survey.ids().len(), 8);
        assert_eq!(survey.centre_E_m().to_array(), [5.0, 5.0, -3.5]);
        assert_eq!(survey.position_E_m(AnchorId(9)), None);
    }

    #[test]
    fn prop_dilution_is_the_scatter_of_a_linear_fix() {
        let survey = Survey::new(&corners()).unwrap();
        // At the centre of a cuboid the directions are (±a, ±b, ±c): A = 8 diag(a², b², c²).
        let centre = Vec3::new(5.0, 5.0, -3.5);
        let far_m = (25.0f64 + 25.0 + 12.25).sqrt();
        let [plane, height] = survey.dilution(centre, None).unwrap();
        assert!((plane - (2.0f64 / 8.0).sqrt() * far_m / 5.0).abs() < 1e-9, "{plane}");
        assert!((height - (1.0f64 / 8.0).sqrt() * far_m / 3.5).abs() < 1e-9, "{height}");
        // An anchor less, and a place outside, never help.
        let without = survey.dilution(centre, Some(AnchorId(3))).unwrap();
        assert!(without[0] > plane && without[1] > height);
        let outside = survey.dilution(Vec3::new(25.0, 5.0, -3.5), None).unwrap();
        assert!(outside[0] > 3.0 * plane);
        let geometry = survey.examine(Vec3::new(0.5, 0.5, -6.0), Vec3::new(9.5, 9.5, -0.3));
        assert!(geometry.worst[1] > geometry.middle[1]);
        assert!(geometry.needed.unwrap().1[0] > geometry.worst[0]);
    }

    #[test]
    fn prop_bad_surveys_say_why() {
        let check = |anchors: &[(AnchorId, Vec3<E>)], says: &str| {
            let problems = Survey::new(anchors).unwrap_err().to_string();
            assert!(problems.contains(says), "{problems}");
        };
        check(&corners()[..4], "4 anchors, at least 5");
        let mut flat = corners();
        for (_, p) in &mut flat {
            *p = Vec3::new(p.x(), p.y(), -2.0 - 0.5 * p.x());
        }
        flat.truncate(5);
        flat[4].1 = Vec3::new(5.0, 2.0, -4.5);
        check(&flat, "coplanar");
        let mut twice = corners();
        twice[1].0 = AnchorId(0);
        check(&twice, "anchor 0: listed twice");
        let mut far = corners();
        far[3].1 = Vec3::new(f64::NAN, 4100.0, 0.0);
        check(&far, "anchor 3: position_m.y = 4100, allowed -100 to 100 m");
    }
}
