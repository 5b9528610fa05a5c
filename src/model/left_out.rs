//! What a vehicle file leaves out, of a vehicle that is not the Flapper: neutral where nothing is known, else from
//! what the file says by the laws of docs/VEHICLE.md, section 2. Never a number that was measured on another vehicle.
//!
//! A file describes a vehicle of its own when it says its mass and does not say `base`.
//!
//! **Laws.** `s = m/m₀` and `r = b/b₀`, mass and wing (`wings.centre_m`) over the Flapper's, from which they are
//! anchored: every law gives back the Flapper for the Flapper. Without a length `r = s^⅓`, geometric similarity. Hover at
//! `m g ∝ f² r⁴` gives the flap rate, `f ∝ s^½ r⁻²` (Pennycuick 1990; `f ∝ m^-⅙` for similar animals); power
//! in hover is that of an actuator disk, `P ∝ m^1.5 r⁻¹`; drag of a wing that beats `k ∝ r³`.

use toml::Table;

use crate::vehicle::{MASS_KG, Vehicle};
use haltere_core::frames::G_MPS2;

/// A key that a file leaves out, and why it is what it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LeftOut {
    /// `table.key`.
    pub key: &'static str,
    /// Law in words.
    pub law: &'static str,
}

/// Fills in what the file, `said`, leaves out; the vehicle holds the Flapper's number there. Says what was filled in.
pub(crate) fn complete(vehicle: &mut Vehicle, said: &Table) -> Vec<LeftOut> {
    let says = |key: &str| {
        let (table, key) = key.split_once('.').unwrap_or(("", key));
        said.get(table).and_then(|t| t.get(key)).is_some()
    };
    // What follows from a mass that is none would hide the slip.
    let own = says("body.mass_kg") && MASS_KG.contains(&vehicle.body.mass_kg);
    if said.contains_key(BASE) || !own {
        return Vec::new();
    }
    let flapper = Vehicle::default();
    let v = vehicle;
    let s = v.body.mass_kg / flapper.body.mass_kg;
    let r = match says("wings.centre_m") {
        true => v.wings.centre_m / flapper.wings.centre_m,
        false => s.cbrt(),
    };
    let mut left = Vec::new();
    // In an order in which each law finds what it needs.
    let mut fill = |v: &mut Vehicle, key, law, set: &dyn Fn(&mut Vehicle)| {
        if !says(key) {
            set(v);
            left.push(LeftOut { key, law });
        }
    };
    let length = "as the Flapper's, by the length of the wing";
    fill(v, "body.inertia_kgm2", "mass times length squared", &|v| {
        v.body.inertia_kgm2 = v.body.inertia_kgm2.map(|i| i * s * r * r);
    });
    fill(v, "body.gear_m", length, &|v| v.body.gear_m *= r);
    fill(v, "wings.centre_m", "cube root of the mass", &|v| v.wings.centre_m *= r);
    fill(v, "wings.cop_m", length, &|v| v.wings.cop_m *= r);
    fill(v, "wings.hinge_m", length, &|v| v.wings.hinge_m *= r);
    fill(v, "wings.root_m", length, &|v| v.wings.root_m *= r);
    fill(v, "wings.link_m", length, &|v| {
        v.wings.link_m = (v.wings.link_m * r).max(v.wings.hinge_m + v.wings.root_m);
    });
    let neutral = "neutral: 0";
    fill(v, "wings.passive_dihedral_rad_per_mps", neutral, &|v| {
        v.wings.passive_dihedral_rad_per_mps = 0.0;
    });
    fill(v, "wings.thrust_offset_n", neutral, &|v| v.wings.thrust_offset_n = 0.0);
    fill(
        v,
        "wings.thrust_n_per_hz",
        "hovers at a flap rate as √mass over length squared",
        &|v| {
            let hover_hz = flapper.hover_hz() * s.sqrt() / (r * r);
            v.wings.thrust_n_per_hz =
                (v.body.mass_kg * G_MPS2 - v.wings.thrust_offset_n) / (2.0 * hover_hz);
        },
    );
    let hover_hz = v.hover_hz();
    fill(v, "battery.cells", "two, the companion's usual pack", &|_| ());
    fill(v, "wings.flap_offset_hz", neutral, &|v| v.wings.flap_offset_hz = 0.0);
    fill(
        v,
        "wings.flap_hz_per_v",
        "hovers at the Flapper's command with a pack of these cells",
        &|v| {
            let command_v = flapper.hover_command_v() * v.battery.cells / flapper.battery.cells;
            v.wings.flap_hz_per_v = (hover_hz - v.wings.flap_offset_hz) / command_v;
        },
    );
    let beats = flapper.hover_hz() / hover_hz;
    fill(v, "wings.flap_lag_s", "as many wing beats as the Flapper's", &|v| {
        v.wings.flap_lag_s *= beats;
    });
    fill(v, "drag.k_ns_per_m_hz", "length cubed", &|v| {
        v.drag.k_ns_per_m_hz = v.drag.k_ns_per_m_hz.map(|k| k * r.powi(3));
    });
    fill(v, "pitch_servo.frequency_radps", "as fast in wing beats as the Flapper's", &|v| {
        v.pitch_servo.frequency_radps /= beats;
    });
    fill(v, "yaw_servo.frequency_radps", "as fast in wing beats as the Flapper's", &|v| {
        v.yaw_servo.frequency_radps /= beats;
    });
    fill(v, "battery.hover_w", "mass to 1.5 over length", &|v| {
        v.battery.hover_w *= s.powf(1.5) / r;
    });
    let flapper_j = flapper.battery.capacity_mah * flapper.battery.cells;
    fill(v, "battery.capacity_mah", "carries as long a hover as the Flapper's", &|v| {
        v.battery.capacity_mah =
            flapper_j / v.battery.cells * v.battery.hover_w / flapper.battery.hover_w;
    });
    fill(
        v,
        "battery.resistance_ohm",
        "sags in hover by the Flapper's share of its voltage",
        &|v| {
            v.battery.resistance_ohm *= v.hover_ohm() / flapper.hover_ohm();
        },
    );
    fill(v, "battery.electronics_w", "by the power in hover", &|v| {
        v.battery.electronics_w *= v.battery.hover_w / flapper.battery.hover_w;
    });
    fill(v, "ground.gain", "the Flapper's at the same height in lengths", &|_| ());
    fill(v, "ground.length_m", length, &|v| v.ground.length_m *= r);
    left
}

/// Key of a file that changes a vehicle which is there.
pub(crate) const BASE: &str = "base";

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::checks::Problems;

    fn near(a: f64, b: f64) -> bool {
        (a / b - 1.0).abs() < 1e-9
    }

    #[test]
    fn prop_the_laws_give_back_the_flapper_but_for_what_is_neutral() {
        let flapper = Vehicle::default();
        let own = Vehicle::from_toml("[body]\nmass_kg = 0.102").unwrap();
        let numbers = |v: &Vehicle| -> Vec<f64> {
            let (b, w, p) = (&v.body, &v.wings, &v.battery);
            let mut all = vec![b.gear_m, w.centre_m, w.cop_m, w.hinge_m, w.link_m, w.flap_lag_s];
            all.extend([p.capacity_mah, p.resistance_ohm, p.hover_w, v.ground.length_m]);
            all.extend(b.inertia_kgm2.into_iter().chain(v.drag.k_ns_per_m_hz));
            all.extend([v.pitch_servo.frequency_radps, v.hover_hz(), v.hover_command_v()]);
            all
        };
        for (a, b) in numbers(&own).into_iter().zip(numbers(&flapper)) {
            assert!(near(a, b), "{a} {b}");
        }
        assert_eq!(own.wings.passive_dihedral_rad_per_mps, 0.0);
    }

    #[test]
    fn prop_no_number_of_the_flapper_is_left_where_a_law_or_neutral_stands() {
        // A light one with one cell and a heavy one with three: both hover, neither with the Flapper's bend.
        for (mass_kg, cells) in [(0.029, 1.0), (0.4, 3.0)] {
            let text = format!("[body]\nmass_kg = {mass_kg}\n[battery]\ncells = {cells}");
            let own = Vehicle::from_toml(&text).unwrap();
            let mut problems = Problems::new();
            own.check("vehicle", &mut problems);
            assert!(problems.is_empty(), "{problems}");
            let full_v = own.battery.cells * own.battery.cell_v[10];
            let full_frac = own.hover_command_v() / full_v;
            assert!((0.5..0.65).contains(&full_frac), "{mass_kg}: {full_frac}");
            assert_eq!(own.wings.passive_dihedral_rad_per_mps, 0.0);
            let flapper = Vehicle::default();
            assert!(!near(own.battery.resistance_ohm, flapper.battery.resistance_ohm));
            assert!(!near(own.drag.k_ns_per_m_hz[0], flapper.drag.k_ns_per_m_hz[0]));
        }
    }

    #[test]
    fn prop_a_file_without_mass_or_with_a_base_changes_the_flapper() {
        let bend =
            |text: &str| Vehicle::from_toml(text).unwrap().wings.passive_dihedral_rad_per_mps;
        let flapper = Vehicle::default().wings.passive_dihedral_rad_per_mps;
        assert_eq!(bend("[drag]\nk_ns_per_m_hz = [0.02, 0.01, 0.003]"), flapper);
        assert_eq!(bend("base = \"flapper\"\n[body]\nmass_kg = 0.11"), flapper);
        assert_eq!(bend("[body]\nmass_kg = 0.11"), 0.0);
        assert_eq!(
            bend("[body]\nmass_kg = 0.11\n[wings]\npassive_dihedral_rad_per_mps = 0.2"),
            0.2
        );
        let said = Vehicle::from_toml("base = \"bee\"").unwrap_err().to_string();
        assert!(said.contains("base = \"bee\", allowed \"flapper\""), "{said}");
    }
}
