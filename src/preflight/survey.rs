//! Whether the anchors fix positions well where it is to fly.

use super::Finding;
use crate::sources::Loaded;
use haltere_core::frames::Vec3;

/// Dilution in height or plane beyond which it is warned of: 0.1 m of wandering range error then is
/// half a metre of position.
const POOR_DILUTION: f64 = 5.0;
/// Nothing flies lower than this, m.
const LOWEST_M: f64 = 0.3;
/// Setpoints may lie this far outside the anchors' extent, m, before it is warned of: outside of them
/// errors grow fast.
const OUTSIDE_M: f64 = 0.5;

/// The flight volume, from 0.3 m above the floor.
pub fn examine(loaded: &Loaded) -> Vec<Finding> {
    let survey = &loaded.survey;
    let anchors = || survey.ids().iter().filter_map(|id| survey.position_E_m(*id));
    let extent = |axis: usize| {
        anchors().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| {
            [low.min(p[axis]), high.max(p[axis])]
        })
    };
    let size = |axis: usize| extent(axis)[1] - extent(axis)[0];
    let mut findings = vec![Finding::ok(
        "anchors",
        format!(
            "{} anchors over {:.1} m north, {:.1} m east, {:.1} m of height",
            survey.ids().len(),
            size(0),
            size(1),
            size(2)
        ),
    )];
    let mut limits = loaded.config.limits.clone();
    limits.resolve(survey);
    let north = limits.north_m.unwrap_or(extent(0));
    let east = limits.east_m.unwrap_or(extent(1));
    let top_m = limits.height_m.unwrap_or(-extent(2)[0]);
    for (key, wanted, there) in [
        ("limits.north_m", north, extent(0)),
        ("limits.east_m", east, extent(1)),
        ("limits.height_m", [0.0, top_m], [0.0, -extent(2)[0]]),
    ] {
        if wanted[0] < there[0] - OUTSIDE_M || wanted[1] > there[1] + OUTSIDE_M {
            findings.push(Finding::warning(
                key,
                format!(
                    "{:.1} to {:.1} m, the anchors span {:.1} to {:.1} m",
                    wanted[0], wanted[1], there[0], there[1]
                ),
                format!(
                    "narrow {key}, or hang anchors further out: outside of them errors grow fast"
                ),
            ));
        }
    }
    let low = Vec3::new(north[0], east[0], -top_m);
    let high = Vec3::new(north[1], east[1], -LOWEST_M.min(top_m));
    let found = survey.examine(low, high);
    let shown =
        |[plane, height]: [f64; 2]| format!("{plane:.1} in the plane, {height:.1} in height");
    let [n, e, d] = found.worst_at_E_m.to_array();
    let place = format!("north {n:.1}, east {e:.1}, height {:.1} m", -d);
    let poor = |[plane, height]: [f64; 2]| plane.max(height) > POOR_DILUTION;
    let text = format!(
        "{} in the middle of the volume; worst {} at {place}, at most {POOR_DILUTION} advised",
        shown(found.middle),
        shown(found.worst)
    );
    findings.push(if poor(found.worst) {
        Finding::warning(
            "dilution of precision",
            text,
            "hang anchors at both ends of every axis, or narrow limits.north_m, limits.east_m, \
             limits.height_m",
        )
    } else {
        Finding::ok("dilution of precision", text)
    });
    if let Some((id, without)) = found.needed
        && poor(without)
        && !poor(found.worst)
    {
        findings.push(Finding::warning(
            format!("without anchor {id}"),
            format!(
                "if something hides it: {} at the worst place, at most {POOR_DILUTION} advised",
                shown(without)
            ),
            format!("hang another anchor near anchor {id}"),
        ));
    }
    findings
}
