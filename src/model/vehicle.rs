//! Every number of the nominal vehicle, shared by simulator, fits and gap tool.
//!
//! Defaults are the Flapper of 102 g. Sources in brackets: \[P\] the paper, \[M\] the public dynamic
//! model of this vehicle (federicoangioni/flapper-dynamic-model), \[R\] recorded flights, \[F\] public
//! firmware, \[D\] derived here.

use serde::{Deserialize, Serialize};

use crate::instruments::{Imu, InnerLoop, Link, Uwb};
use haltere_core::checks::Problems;
use haltere_core::frames::G_MPS2;

/// Nominal voltage of a cell, V.
const CELL_V: f64 = 3.7;
/// Masses that a file may say, kg.
pub(crate) const MASS_KG: std::ops::RangeInclusive<f64> = 0.01..=2.0;
/// What a tangent in hover may show at zero, over its value in hover, for thrust over flap rate and flap rate over
/// command alike: a third power has -2. At 1 there would be no hover.
const AT_ZERO: [f64; 2] = [-3.0, 0.9];

/// Everything about the vehicle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Vehicle {
    /// Name in reports.
    pub name: String,
    /// Mass properties and fixed points.
    pub body: Body,
    /// Flapping wings.
    pub wings: Wings,
    /// Air drag.
    pub drag: Drag,
    /// Dihedral servo: pitch.
    pub pitch_servo: Servo,
    /// Wing-root servo: yaw.
    pub yaw_servo: Servo,
    /// Battery.
    pub battery: Battery,
    /// Ground effect.
    pub ground: Ground,
    /// Attitude loops of the board.
    pub inner_loop: InnerLoop,
    /// Inertial sensor.
    pub imu: Imu,
    /// UWB radio in its room.
    pub uwb: Uwb,
    /// Lines between tag, board and companion.
    pub link: Link,
    /// Whether these numbers are those of flights.
    pub commissioned: Commissioned,
}

/// What commissioning (`haltere gap commission`) has made of a file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Commissioned {
    /// Accepted flights that constants were found from; 0: none. A diagnosis commissions a file of none by itself.
    pub flights: u32,
}

/// Mass properties and fixed points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Body {
    /// Take-off mass, kg \[P\].
    pub mass_kg: f64,
    /// Moments of inertia about the body axes, kg·m² \[M, with wings\].
    pub inertia_kgm2: [f64; 3],
    /// Centre of mass from its drawn place, body frame, m.
    pub cg_B_m: [f64; 3],
    /// Centre of mass above the foot of the landing gear, m \[D: half the height of the vehicle\].
    pub gear_m: f64,
    /// UWB antenna from the drawn centre of mass, body frame, m.
    pub tag_B_m: [f64; 3],
}

/// Flapping wings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Wings {
    /// Thrust of both wings against the sum of their flap rates, N/Hz \[M, sign re-derived\].
    pub thrust_n_per_hz: f64,
    /// Thrust of both wings at no flapping, N \[M\].
    pub thrust_offset_n: f64,
    /// What thrust bends off that line by, over the weight: `m g c (f/f_h - 1)²` \[D: 0, the public model is linear\].
    pub thrust_curve: f64,
    /// Flap rate against command times voltage, Hz/V \[D: hover at command · V = 4.73 V, R\].
    pub flap_hz_per_v: f64,
    /// Flap rate at no command, Hz \[M\].
    pub flap_offset_hz: f64,
    /// Power of the voltage that the flap rate goes with, about the pack's nominal voltage \[R: 1.01\].
    pub voltage_exponent: f64,
    /// First-order lag of the flap rate, s \[M\].
    pub flap_lag_s: f64,
    /// Wing centre from the middle plane, m \[M\].
    pub centre_m: f64,
    /// Centre of pressure above the centre of mass, m \[M\].
    pub cop_m: f64,
    /// Arm of the dihedral hinge, m \[M\].
    pub hinge_m: f64,
    /// Half spacing of the wing roots, m \[M\].
    pub root_m: f64,
    /// Length of the link between wing root and hinge, m \[M\].
    pub link_m: f64,
    /// Wings bend back by this angle per airspeed forward, rad per m/s \[D from the Nimble's 0.175:
    /// chosen so that it cancels the lever of the drag, as the flights' clean v(θ) law demands\].
    pub passive_dihedral_rad_per_mps: f64,
}

/// Air drag: `F_i = -k_i (f_L + f_R) v_i`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Drag {
    /// Coefficients along the body axes, N·s/m per Hz \[x: M; y, z: R, M says 0.0109 and 0.0039\].
    pub k_ns_per_m_hz: [f64; 3],
    /// Inverse of the speed at which drag has fallen to half of its linear law, s/m. 0: linear.
    pub saturation_s_per_m: f64,
    /// Drag of the body itself: `F = -m c |v| v`, 1/m \[D: 0, the flights' law is linear to 2 m/s\].
    pub body_per_m: f64,
    /// Factor on the rotational damping that the moving wings give.
    pub damping_factor: f64,
}

/// A servo: second order with limits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Servo {
    /// Natural frequency, rad/s.
    pub frequency_radps: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Travel to either side, degrees.
    pub limit_deg: f64,
}

/// Battery.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Battery {
    /// Cells in series \[P\].
    pub cells: f64,
    /// Capacity, mAh \[P\].
    pub capacity_mah: f64,
    /// Inner resistance of the pack with leads, Ω \[GAP.md 3.0: 0.15 to 0.20\].
    pub resistance_ohm: f64,
    /// Further resistance that acts late: the pack's polarisation, Ω.
    pub slow_ohm: f64,
    /// Its time constant, s \[Chen and Rincón-Mora 2006: tens of seconds\].
    pub slow_s: f64,
    /// Charge at start, 0 to 1.
    pub charge_frac: f64,
    /// Open-circuit voltage of a cell at charge 0, 0.1 … 1, V \[usual LiPo curve\].
    pub cell_v: [f64; 11],
    /// Power of both motors in hover, W \[D: 300 mAh in 4 to 6 min\].
    pub hover_w: f64,
    /// Power of the electronics, W.
    pub electronics_w: f64,
}

/// Ground effect: `T = T_free (1 + gain e^(-h/length))`, h from foot to floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Ground {
    /// Gain at the floor.
    pub gain: f64,
    /// Length of decay, m.
    pub length_m: f64,
}

impl Default for Vehicle {
    fn default() -> Self {
        Self {
            name: "flapper-102g".into(),
            body: Body::default(),
            wings: Wings::default(),
            drag: Drag::default(),
            pitch_servo: Servo { frequency_radps: 40.0, damping: 0.634, limit_deg: 18.0 },
            yaw_servo: Servo { frequency_radps: 10.0, damping: 0.7, limit_deg: 45.0 },
            battery: Battery::default(),
            ground: Ground::default(),
            inner_loop: InnerLoop::default(),
            imu: Imu::default(),
            uwb: Uwb::default(),
            link: Link::default(),
            commissioned: Commissioned::default(),
        }
    }
}

impl Default for Body {
    fn default() -> Self {
        Self {
            mass_kg: 0.102,
            inertia_kgm2: [5.6e-4, 3.4e-4, 3.6e-4],
            cg_B_m: [0.0; 3],
            gear_m: 0.12,
            tag_B_m: [0.0; 3],
        }
    }
}

impl Default for Wings {
    fn default() -> Self {
        Self {
            thrust_n_per_hz: 0.040,
            thrust_offset_n: -0.02,
            thrust_curve: 0.0,
            flap_hz_per_v: 2.724,
            flap_offset_hz: -0.13,
            voltage_exponent: 1.0,
            flap_lag_s: 0.08,
            centre_m: 0.08,
            cop_m: 0.027,
            hinge_m: 0.035,
            root_m: 0.036,
            link_m: 0.1,
            passive_dihedral_rad_per_mps: 0.145,
        }
    }
}

impl Default for Drag {
    fn default() -> Self {
        Self {
            k_ns_per_m_hz: [0.0169, 0.0080, 0.0026],
            saturation_s_per_m: 0.0,
            body_per_m: 0.0,
            damping_factor: 1.0,
        }
    }
}

impl Default for Battery {
    fn default() -> Self {
        Self {
            cells: 2.0,
            capacity_mah: 300.0,
            resistance_ohm: 0.17,
            slow_ohm: 0.0,
            slow_s: 20.0,
            charge_frac: 1.0,
            cell_v: [3.27, 3.62, 3.70, 3.74, 3.77, 3.80, 3.84, 3.90, 3.97, 4.07, 4.20],
            hover_w: 24.5,
            electronics_w: 1.0,
        }
    }
}

impl Default for Ground {
    /// 1 / 1.087 = 0.92 of the free thrust command at 0.33 m, as the paper's text states.
    fn default() -> Self {
        Self { gain: 0.20, length_m: 0.40 }
    }
}

impl Vehicle {
    /// Flap rate of each wing at which thrust equals weight, out of ground effect, Hz.
    pub fn hover_hz(&self) -> f64 {
        (self.body.mass_kg * G_MPS2 - self.wings.thrust_offset_n)
            / (2.0 * self.wings.thrust_n_per_hz)
    }

    /// Command times voltage in hover, V.
    pub fn hover_command_v(&self) -> f64 {
        (self.hover_hz() - self.wings.flap_offset_hz) / self.wings.flap_hz_per_v
    }

    /// Nominal voltage of the pack, V.
    pub fn rated_v(&self) -> f64 {
        CELL_V * self.battery.cells
    }

    /// Voltage over current of the motors in hover, Ω: what a resistance of the pack has to be seen beside.
    pub fn hover_ohm(&self) -> f64 {
        self.rated_v().powi(2) / self.battery.hover_w
    }

    /// Refuses what cannot fly; every reason at once.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value: f64, low: f64, high: f64, unit: &str| {
            problems.range(format_args!("{key}.{name}"), value, low..=high, unit);
        };
        let Self { name: _, body, wings, drag, pitch_servo, yaw_servo, battery, ground, .. } = self;
        range("body.mass_kg", body.mass_kg, *MASS_KG.start(), *MASS_KG.end(), "kg");
        for (axis, inertia) in ["x", "y", "z"].into_iter().zip(body.inertia_kgm2) {
            range(&format!("body.inertia_kgm2.{axis}"), inertia, 1e-6, 1.0, "kg·m²");
        }
        for (axis, i) in ["x", "y", "z"].into_iter().zip(0..3) {
            range(&format!("body.cg_B_m.{axis}"), body.cg_B_m[i], -0.1, 0.1, "m");
            range(&format!("body.tag_B_m.{axis}"), body.tag_B_m[i], -0.5, 0.5, "m");
            let k = drag.k_ns_per_m_hz[i];
            range(&format!("drag.k_ns_per_m_hz.{axis}"), k, 0.0, 1.0, "N·s/m per Hz");
        }
        range("body.gear_m", body.gear_m, 0.0, 1.0, "m");
        range("wings.thrust_n_per_hz", wings.thrust_n_per_hz, 1e-3, 1.0, "N/Hz");
        range("wings.flap_hz_per_v", wings.flap_hz_per_v, 0.1, 50.0, "Hz/V");
        // A mass that is refused has no weight to hold the offsets against.
        if MASS_KG.contains(&body.mass_kg) {
            let [least, most] = AT_ZERO;
            let (weight_n, hover_hz) = (body.mass_kg * G_MPS2, self.hover_hz());
            let (thrust_n, flap_hz) = (wings.thrust_offset_n, wings.flap_offset_hz);
            range("wings.thrust_offset_n", thrust_n, least * weight_n, most * weight_n, "N");
            range("wings.flap_offset_hz", flap_hz, least * hover_hz, most * hover_hz, "Hz");
        }
        range("wings.thrust_curve", wings.thrust_curve, -1.0, 2.0, "");
        range("wings.voltage_exponent", wings.voltage_exponent, 0.0, 3.0, "");
        range("wings.flap_lag_s", wings.flap_lag_s, 0.001, 1.0, "s");
        range("wings.centre_m", wings.centre_m, 0.01, 1.0, "m");
        range("wings.cop_m", wings.cop_m, -0.2, 0.2, "m");
        range("wings.hinge_m", wings.hinge_m, 0.0, 0.5, "m");
        range("wings.root_m", wings.root_m, 1e-3, 0.5, "m");
        range("wings.link_m", wings.link_m, wings.hinge_m + wings.root_m, 1.0, "m");
        let bend = wings.passive_dihedral_rad_per_mps;
        range("wings.passive_dihedral_rad_per_mps", bend, -0.5, 0.5, "rad per m/s");
        range("drag.saturation_s_per_m", drag.saturation_s_per_m, 0.0, 10.0, "s/m");
        range("drag.body_per_m", drag.body_per_m, 0.0, 10.0, "1/m");
        range("drag.damping_factor", drag.damping_factor, 0.0, 10.0, "");
        for (name, servo) in [("pitch_servo", pitch_servo), ("yaw_servo", yaw_servo)] {
            range(&format!("{name}.frequency_radps"), servo.frequency_radps, 1.0, 500.0, "rad/s");
            range(&format!("{name}.damping"), servo.damping, 0.1, 5.0, "");
            range(&format!("{name}.limit_deg"), servo.limit_deg, 1.0, 60.0, "deg");
        }
        range("battery.cells", battery.cells, 1.0, 6.0, "");
        range("battery.capacity_mah", battery.capacity_mah, 10.0, 10_000.0, "mAh");
        range("battery.resistance_ohm", battery.resistance_ohm, 0.0, 1.0, "Ω");
        range("battery.slow_ohm", battery.slow_ohm, 0.0, 1.0, "Ω");
        range("battery.slow_s", battery.slow_s, 0.5, 300.0, "s");
        range("battery.charge_frac", battery.charge_frac, 0.05, 1.0, "");
        for (tenth, volt) in battery.cell_v.into_iter().enumerate() {
            range(&format!("battery.cell_v[{tenth}]"), volt, 2.0, 4.5, "V");
        }
        range("battery.hover_w", battery.hover_w, 0.1, 1000.0, "W");
        range("battery.electronics_w", battery.electronics_w, 0.0, 100.0, "W");
        range("ground.gain", ground.gain, -0.5, 1.0, "");
        range("ground.length_m", ground.length_m, 0.01, 2.0, "m");
        self.inner_loop.check(&format!("{key}.inner_loop"), problems);
        self.imu.check(&format!("{key}.imu"), problems);
        self.uwb.check(&format!("{key}.uwb"), problems);
        self.link.check(&format!("{key}.link"), problems);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_flapper_hovers_where_the_flights_say() {
        let v = Vehicle::default();
        // Recorded flights: command · voltage = 310 000 counts·V ± 1.5 % of 65535.
        let recorded_v = 310_000.0 / 65_535.0;
        assert!((v.hover_command_v() / recorded_v - 1.0).abs() < 0.005);
        // Paper: about 12 to 13 Hz.
        assert!((12.0..13.0).contains(&v.hover_hz()), "{}", v.hover_hz());
    }

    #[test]
    fn prop_default_is_accepted_and_survives_the_file() {
        let v = Vehicle::default();
        let mut problems = Problems::new();
        v.check("vehicle", &mut problems);
        assert_eq!(problems.lines(), [] as [&str; 0]);
        let text = toml::to_string(&v).unwrap();
        assert_eq!(Vehicle::from_toml(&text).unwrap(), v);
        assert_eq!(Vehicle::from_toml("").unwrap(), v);
        assert_eq!(Vehicle::from_toml("schema_version = 1").unwrap(), v);
    }

    #[test]
    fn prop_a_newer_file_is_refused_before_its_keys_are() {
        let refused = |text: &str| Vehicle::from_toml(text).unwrap_err().to_string();
        let newer = refused("schema_version = 2\n[tail]\narea_m2 = 0.01");
        assert!(newer.contains("schema version 2 of the vehicle file"), "{newer}");
        assert!(newer.contains("a newer haltere") && !newer.contains("tail"), "{newer}");
        assert!(refused("schema_version = \"one\"").contains("no whole number"));
        let slip = refused("schema_version = 1\n[body]\nmas_kg = 0.1");
        assert!(slip.contains("line 3: ") && slip.contains("mas_kg"), "{slip}");
    }

    #[test]
    fn prop_the_page_has_every_key_and_the_whole_default() {
        let page = include_str!("../../docs/VEHICLE.md");
        let block =
            page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
        assert_eq!(Vehicle::from_toml(block).unwrap(), Vehicle::default());
        let written: toml::Table = toml::from_str(block).unwrap();
        let default = toml::Value::try_from(Vehicle::default()).unwrap();
        for (table, value) in default.as_table().unwrap() {
            let keys = value.as_table().map_or(vec![table.clone()], |keys| {
                keys.keys().map(|key| format!("{table}.{key}")).collect()
            });
            for name in keys {
                assert!(
                    page.contains(&format!("\n| `{name}` | ")),
                    "{name} has no row in docs/VEHICLE.md"
                );
                let (table, key) = name.split_once('.').unwrap_or(("", &name));
                let there = written.get(table).map_or(written.get(key), |t| t.get(key));
                assert!(there.is_some(), "{name} is not in the whole file of docs/VEHICLE.md");
            }
        }
    }

    #[test]
    fn prop_tangents_of_bent_laws_are_allowed_and_what_cannot_hover_is_not() {
        // T = W (f/f_h)^2 at 40 g and 20 Hz: slope 2W/(2 f_h), offset -W. And one of 300 g whose offset is beyond 1 N.
        for (mass_kg, weights, ok) in [
            (0.04, -1.0, true),
            (0.3, -1.0, true),
            (0.3, -2.0, true),
            (0.3, -3.5, false),
            (0.04, 1.0, false),
        ] {
            let mut v = Vehicle::default();
            let weight_n = mass_kg * G_MPS2;
            (v.body.mass_kg, v.wings.thrust_offset_n) = (mass_kg, weights * weight_n);
            v.wings.thrust_n_per_hz = (1.0_f64 - weights).max(0.1) * weight_n / 40.0;
            let mut problems = Problems::new();
            v.check("vehicle", &mut problems);
            assert_eq!(problems.is_empty(), ok, "{mass_kg} {weights}: {problems}");
        }
    }

    #[test]
    fn prop_slips_are_named() {
        assert!(Vehicle::from_toml("[body]\nmas_kg = 0.1").is_err());
        let v = Vehicle::from_toml("[body]\nmass_kg = 102.0").unwrap();
        let mut problems = Problems::new();
        v.check("vehicle", &mut problems);
        assert_eq!(problems.lines(), ["vehicle.body.mass_kg = 102, allowed 0.01 to 2 kg"]);
    }
}
