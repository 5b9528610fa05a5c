//! Vehicle files that come with the programs, by name, and those of the user.

use std::path::Path;

use anyhow::{Context as _, bail};
use haltere_model::Vehicle;
use haltere_model::rotorcraft::Rotorcraft;
use haltere_pilot::settings::surplus;
use toml::Table;

/// The vehicle that is flown where none is named.
const NOMINAL: &str = "flapper";

/// Name, text of the vehicle file.
const FILES: [(&str, &str); 1] =
    [("delfly-nimble", include_str!("../sim/vehicles/delfly-nimble.toml"))];

/// Name, text of the vehicle file, of quadrotors: the diagnosis without a simulator balances them, a
/// Crazyflie's firmware flies them.
const ROTORCRAFT: [(&str, &str); 2] = [
    ("crazyflie-2.1", include_str!("../sim/rotorcraft/crazyflie-2.1.toml")),
    ("x-quadrotor", include_str!("../sim/rotorcraft/x-quadrotor.toml")),
];

/// Names of the quadrotors that are there.
pub fn rotorcraft_names() -> Vec<&'static str> {
    ROTORCRAFT.iter().map(|(name, _)| *name).collect()
}

/// Text of the file of a quadrotor, or of the one of that name; `None` where it is of wings, or nothing is there.
pub fn rotorcraft_text(told: &Path) -> Option<String> {
    if !told.is_file() {
        let name = told.to_str()?;
        return ROTORCRAFT.iter().find(|(of, _)| *of == name).map(|(_, text)| (*text).to_owned());
    }
    haltere_log::intake::text(told, MOST_BYTES).ok().filter(|text| Rotorcraft::is_meant(text))
}

/// The quadrotor of a file, or of that name.
pub fn rotorcraft(told: &Path) -> anyhow::Result<Rotorcraft> {
    let text = rotorcraft_text(told).with_context(|| {
        format!(
            "vehicle {}: no quadrotor; allowed are a file with four tables [[motor]], or by name {}; `haltere vehicle print \
             NAME > FILE` begins one of your own",
            told.display(),
            rotorcraft_names().join(", ")
        )
    })?;
    Rotorcraft::from_toml(&text).map_err(|why| anyhow::anyhow!("{}: {why}", told.display()))
}

/// Names of the vehicles that are there.
pub fn names() -> Vec<&'static str> {
    std::iter::once(NOMINAL).chain(FILES.iter().map(|(name, _)| *name)).collect()
}

/// The vehicle of a name as a file.
pub fn text(name: &str) -> Option<String> {
    if name == NOMINAL {
        return toml::to_string(&Vehicle::default()).ok();
    }
    FILES.iter().find(|(of, _)| *of == name).map(|(_, text)| (*text).to_owned())
}

/// Longest vehicle file that is read, bytes.
pub const MOST_BYTES: u64 = 1 << 20;

/// The text of a file, or of the vehicle of that name where there is no such file.
pub fn read(told: &Path) -> anyhow::Result<String> {
    let built_in = told.to_str().filter(|_| !told.is_file()).and_then(text);
    if let Some(text) = built_in {
        return Ok(text);
    }
    let text = haltere_log::intake::text(told, MOST_BYTES).with_context(|| match told.exists() {
        true => told.display().to_string(),
        false => format!(
            "vehicle {}: allowed are a file, or by name {}; `haltere vehicle print NAME > FILE` begins one of your own",
            told.display(),
            [names(), rotorcraft_names()].concat().join(", ")
        ),
    })?;
    // What cannot be read at all is told where it is read.
    if let (Ok(found), Ok(vehicle)) = (text.parse::<Table>(), Vehicle::from_toml(&text))
        && let Ok(understood) = Table::try_from(&vehicle)
        && let Some(why) = surplus(&found, &understood, "")
    {
        bail!("{}: {why}", told.display());
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_every_name_of_a_quadrotor_is_one() {
        for name in rotorcraft_names() {
            assert_eq!(rotorcraft(Path::new(name)).unwrap().name, name);
        }
        let error = format!("{:#}", rotorcraft(Path::new("flapper")).unwrap_err());
        assert!(error.contains("crazyflie-2.1, x-quadrotor"), "{error}");
    }

    #[test]
    fn prop_every_name_is_a_vehicle() {
        let of = |name: &str| Vehicle::from_toml(&read(Path::new(name)).unwrap()).unwrap();
        assert_eq!(of(NOMINAL), Vehicle::default());
        assert_ne!(of("delfly-nimble"), Vehicle::default());
        assert_eq!(names().len(), FILES.len() + 1);
        let error = format!("{:#}", read(Path::new("flaper")).unwrap_err());
        let all = "flapper, delfly-nimble, crazyflie-2.1, x-quadrotor;";
        assert!(error.contains("vehicle flaper: ") && error.contains(all), "{error}");
    }
}
