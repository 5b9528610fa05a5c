//! `haltere vehicle`: vehicle files, what stands in them and what follows from it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::{Args, Subcommand};
use haltere_core::checks::Problems;
use haltere_model::Vehicle;
use haltere_model::left_out::LeftOut;
use haltere_model::vehicle::Battery as VehicleBattery;
use serde::Serialize;

use super::output::{print, print_json};
use crate::sources::VehicleKeys;
use crate::vehicles;

#[derive(Debug, Subcommand)]
pub(super) enum VehicleCommand {
    /// Prints a vehicle file with every key: that of a built-in vehicle or quadrotor (crazyflie-2.1, x-quadrotor) to begin from, or a
    /// file completed with the defaults.
    Print(Told),
    /// Examines a vehicle file, and says how the vehicle hovers by it and what the companion has to be told.
    Check(Check),
}

#[derive(Debug, Args)]
pub(super) struct Told {
    /// Vehicle file, or the name of a built-in vehicle.
    #[arg(default_value = "flapper")]
    vehicle: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct Check {
    #[command(flatten)]
    told: Told,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

/// What a vehicle says of the companion's configuration: the keys themselves, or what follows from a vehicle file.
pub fn keys(told: &Path) -> anyhow::Result<VehicleKeys> {
    let name = told.display().to_string();
    if told.is_file() {
        let text = haltere_log::intake::text(told, vehicles::MOST_BYTES).context(name.clone())?;
        let table = text.parse::<toml::Table>().ok();
        if table.is_some_and(|t| t.contains_key("estimator") || t.contains_key("flight")) {
            return Ok(VehicleKeys { name, text });
        }
    }
    let (vehicle, _) = Told { vehicle: told.to_owned() }.read()?;
    Ok(VehicleKeys { name, text: Meaning::of(&vehicle, &[]).for_companion(&vehicle) })
}

impl Told {
    /// The vehicle, and the keys of a vehicle of its own that its file leaves out.
    fn read(&self) -> anyhow::Result<(Vehicle, Vec<LeftOut>)> {
        let refused =
            |problems: Problems| anyhow::anyhow!("{}: {problems}", self.vehicle.display());
        let (vehicle, left) = Vehicle::read(&vehicles::read(&self.vehicle)?).map_err(refused)?;
        let mut problems = Problems::new();
        vehicle.check("vehicle", &mut problems);
        if problems.is_empty() { Ok((vehicle, left)) } else { Err(refused(problems)) }
    }
}

/// A cell of the pack: nominal, and the source's limits of two cells by the cell, V.
const NOMINAL_CELL_V: f64 = 3.7;
const LOW_CELL_V: f64 = 3.2;
const CRITICAL_CELL_V: f64 = 3.0;
/// A milliampere hour at one volt, J.
const J_PER_MAH_V: f64 = 3.6;

/// What follows from the numbers of a file.
#[derive(Debug, Serialize)]
struct Meaning {
    name: String,
    /// Flap rate in hover, Hz.
    hover_hz: f64,
    /// Command in hover with a full and with an empty pack, open circuit, of 1.
    hover_full_frac: f64,
    hover_empty_frac: f64,
    /// Drag over mass in hover along x, y and z of the body, 1/s.
    drag_per_s: [f64; 3],
    /// Time that the pack carries a hover, s.
    hover_s: f64,
    /// Keys that the file leaves out, with the law that they are from.
    left_out: Vec<[&'static str; 2]>,
}

impl Meaning {
    /// Hover of the model of docs/VEHICLE.md, whose keys are the symbols, out of ground effect:
    ///
    /// * flap rate f_h = (m·g - T_0)/(2k) of each wing, Hz; command u = (f_h - offset)/(flap_hz_per_v·U), of 1, at the open
    ///   circuit's voltage U, V: under load it is a few per cent more;
    /// * drag κ_i = 2·f_h·k_i/m along x, y, z of the body frame, 1/s;
    /// * time t = E/(hover_w + electronics_w), s, with E = 3.6 J/mAh · charge · capacity · cells · mean of `cell_v`, J: the
    ///   curve is given at equal steps of charge, so its mean is the voltage over a whole discharge.
    fn of(vehicle: &Vehicle, left: &[LeftOut]) -> Self {
        let (battery, hover_hz) = (&vehicle.battery, vehicle.hover_hz());
        let pack_v = |cell: f64| battery.cells * cell;
        let [empty, .., full] = battery.cell_v;
        let mean_v = battery.cell_v.iter().sum::<f64>() / battery.cell_v.len() as f64;
        let energy_j = J_PER_MAH_V * battery.capacity_mah * battery.charge_frac * pack_v(mean_v);
        Self {
            name: vehicle.name.clone(),
            hover_hz,
            hover_full_frac: vehicle.hover_command_v() / pack_v(full),
            hover_empty_frac: vehicle.hover_command_v() / pack_v(empty),
            drag_per_s: vehicle
                .drag
                .k_ns_per_m_hz
                .map(|k| 2.0 * hover_hz * k / vehicle.body.mass_kg),
            hover_s: energy_j / (battery.hover_w + battery.electronics_w),
            left_out: left.iter().map(|l| [l.key, l.law]).collect(),
        }
    }

    /// What the companion has to be told, as lines of its configuration.
    fn for_companion(&self, vehicle: &Vehicle) -> String {
        let [x, y, z] = self.drag_per_s;
        let [tag_x, tag_y, tag_z] = vehicle.body.tag_B_m;
        let cells = vehicle.battery.cells;
        let pack = match cells == VehicleBattery::default().cells {
            true => String::new(),
            false => format!(
                "\n[control.voltage]\ncells = {cells:.0}\nnominal_v = {:.1}\n\n\
                 [limits]\nbattery_low_v = {:.1}\nbattery_critical_v = {:.1}\n",
                NOMINAL_CELL_V * cells,
                LOW_CELL_V * cells,
                CRITICAL_CELL_V * cells
            ),
        };
        format!(
            "[flight]\ngear_height_m = {:?}\n\n\
             [estimator]\ndrag_per_s = [{x:.3}, {y:.3}, {z:.3}]\np_BT_B_m = [{tag_x:?}, {tag_y:?}, {tag_z:?}]\n{pack}",
            vehicle.body.gear_m
        )
    }

    /// What the file leaves out, in lines.
    fn left_out(&self) -> String {
        let lines: Vec<String> =
            self.left_out.iter().map(|[key, law]| format!("  {key}: {law}\n")).collect();
        match lines.is_empty() {
            true => String::new(),
            false => format!(
                "left out, and taken by law (docs/VEHICLE.md, section 2):\n{}\n",
                lines.concat()
            ),
        }
    }

    fn text(&self, vehicle: &Vehicle) -> String {
        let [x, y, z] = self.drag_per_s;
        format!(
            "{}: every value is allowed\n\
             hover    {:.1} Hz a wing; {:.2} of the full command with a full pack, {:.2} with an empty one\n\
             drag     {x:.2}, {y:.2}, {z:.2} 1/s along x, y, z\n\
             pack     {:.0} s of hover\n\n\
             {}# for the companion\n{}",
            self.name,
            self.hover_hz,
            self.hover_full_frac,
            self.hover_empty_frac,
            self.hover_s,
            self.left_out(),
            self.for_companion(vehicle)
        )
    }
}

impl VehicleCommand {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            VehicleCommand::Print(told) => match vehicles::rotorcraft_text(&told.vehicle) {
                // With its comments, which say where each number is from.
                Some(text) => print(&text)?,
                None => print(&toml::to_string(&told.read()?.0)?)?,
            },
            VehicleCommand::Check(Check { told, json }) => {
                if vehicles::rotorcraft_text(&told.vehicle).is_some() {
                    let vehicle = vehicles::rotorcraft(&told.vehicle)?;
                    match json {
                        true => print_json(&vehicle)?,
                        false => print(&vehicle.meaning())?,
                    }
                    return Ok(ExitCode::SUCCESS);
                }
                let (vehicle, left) = told.read()?;
                let meaning = Meaning::of(&vehicle, &left);
                if meaning.hover_full_frac >= 1.0 {
                    anyhow::bail!(
                        "{}: hover needs {:.2} of the full command with a full pack: it cannot take off; look at \
                         body.mass_kg, wings.thrust_n_per_hz, wings.flap_hz_per_v and battery.cells",
                        told.vehicle.display(),
                        meaning.hover_full_frac
                    );
                }
                match json {
                    true => print_json(&meaning)?,
                    false => print(&meaning.text(&vehicle))?,
                }
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(vehicle: &str) -> Told {
        Told { vehicle: vehicle.into() }
    }

    #[test]
    fn prop_what_is_printed_is_the_vehicle_and_what_cannot_fly_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("own.toml");
        let (vehicle, left) = told("delfly-nimble").read().unwrap();
        assert_eq!(left, [], "the built-in one says all that the laws would");
        std::fs::write(&file, toml::to_string(&vehicle).unwrap()).unwrap();
        assert_eq!(told(file.to_str().unwrap()).read().unwrap().0, vehicle);
        for (text, says) in [
            ("[body]\nmass_kg = 102.0", "vehicle.body.mass_kg = 102"),
            ("[body]\nmass = 0.1", "line 2"),
            ("base = \"flapper\"\n[body]\nmass_kg = 0.3", "it cannot take off"),
        ] {
            std::fs::write(&file, text).unwrap();
            let check = Check { told: told(file.to_str().unwrap()), json: false };
            let said = format!("{:#}", VehicleCommand::Check(check).run().unwrap_err());
            assert!(said.contains(says) && said.contains("own.toml"), "{text}: {said}");
        }
    }

    #[test]
    fn val_the_flapper_hovers_as_published() {
        let meaning = Meaning::of(&told("flapper").read().unwrap().0, &[]);
        // 12 to 13 Hz a wing and 4 to 6 minutes a pack, the source; drag of recorded flights, docs/VEHICLE.md.
        assert!((12.0..13.0).contains(&meaning.hover_hz), "{meaning:?}");
        assert!((240.0..360.0).contains(&meaning.hover_s), "{meaning:?}");
        assert!((3.4..4.3).contains(&meaning.drag_per_s[0]), "{meaning:?}");
    }
}
