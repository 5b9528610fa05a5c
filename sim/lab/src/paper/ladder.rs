//! From the source's system as printed to ours as shipped: each extension alone, and one after the other.

use haltere_core::control::{ControlConfig, TiltCompensation, Version};
use haltere_pilot::PilotConfig;

use super::identify;

/// Takes an extension off the companion as shipped.
type Off = fn(&mut PilotConfig);

/// What ours has beyond the source, in the order in which the ladder adds it.
pub const EXTENSIONS: [(&str, Off); 7] = [
    ("our gains, tilt limit and form of the law of drag", |p| {
        p.control = printed(&p.control, p.control.version);
    }),
    ("UWB errors learned by anchor", |p| p.control.learned_uwb_errors = Some(false)),
    ("drag in the filter", |p| p.control.filter_drag = Some(false)),
    ("board's vertical and barometer in the filter", |p| {
        p.estimator.board_vertical.fuse = false;
        p.estimator.baro.fuse = false;
    }),
    ("drag-aware tilt compensation", |p| p.control.tilt_compensation = Some(TiltCompensation::Off)),
    ("low-pass of the feed-forward", |p| p.control.drag.filter_s = 0.0),
    ("integrators that expect the velocity", |p| p.control.drag.integral_reference_s = 0.0),
];

/// A step of the ladder: its name, and the extensions that are on, a bit each.
pub type Rung = (String, usize);
/// All extensions.
pub const SHIPPED: usize = (1 << EXTENSIONS.len()) - 1;
/// The first extension: `raw` has it too.
pub const GAINS: usize = 1;

/// With each extension alone, with the first two and so on, as shipped.
pub fn rungs() -> Vec<Rung> {
    let mut rungs = Vec::new();
    rungs.extend(EXTENSIONS.iter().enumerate().map(|(k, (name, _))| (format!("+ {name}"), 1 << k)));
    for (k, (name, _)) in EXTENSIONS.iter().enumerate().skip(1) {
        let all = (2 << k) - 1;
        let name =
            if all == SHIPPED { "all: as shipped".into() } else { format!("\u{2026} and {name}") };
        rungs.push((name, all));
    }
    rungs
}

/// The configuration of a rung.
pub fn build(shipped: &PilotConfig, on: usize) -> PilotConfig {
    let mut pilot = shipped.clone();
    for (k, (_, off)) in EXTENSIONS.iter().enumerate() {
        if on & (1 << k) == 0 {
            off(&mut pilot);
        }
    }
    pilot
}

/// The source's controller: a version with its own gains and its law v(θ).
pub fn printed(control: &ControlConfig, version: Version) -> ControlConfig {
    printed_with(identify::CHOSEN, control, version)
}

/// The same with the gains that another window gives.
pub fn printed_with(found: usize, control: &ControlConfig, version: Version) -> ControlConfig {
    identify::with(&identify::FOUND[found].1, control, version)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The ladder begins where the one switch of the configuration is, and ends at what ships.
    #[test]
    fn prop_the_first_rung_is_version_paper() {
        let shipped = PilotConfig::default();
        let [first, last] = [0, SHIPPED].map(|on| build(&shipped, on));
        let paper =
            PilotConfig { control: printed(&shipped.control, Version::Paper), ..shipped.clone() };
        assert_eq!(first.estimator_in_force(), paper.estimator_in_force());
        let of = |p: &PilotConfig| {
            let on = p.control.enhancements();
            (
                on.drag_feed_forward,
                on.tilt_compensation,
                p.control.feed_forward_s(),
                p.control.gains,
            )
        };
        assert_eq!(of(&first), of(&paper));
        assert_eq!(last.control, shipped.control);
        assert_eq!(rungs().len(), 2 * EXTENSIONS.len() - 1);
    }
}
