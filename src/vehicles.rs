//! Vehicle files that come with the programs, by name, and those of the user.

use std::path::Path;

use anyhow::{Context as _, bail};
use haltere_model::Vehicle;
use haltere_pilot::settings::surplus;
use toml::Table;

/// The vehicle that is flown where none is named.
const NOMINAL: &str = "flapper";

/// Name, text of the vehicle file.
const FILES: [(&str, &str); 1] =
    [("delfly-nimble", include_str!("../sim/vehicles/delfly-nimble.toml"))];

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
            names().join(", ")
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
    fn prop_every_name_is_a_vehicle() {
        let of = |name: &str| Vehicle::from_toml(&read(Path::new(name)).unwrap()).unwrap();
        assert_eq!(of(NOMINAL), Vehicle::default());
        assert_ne!(of("delfly-nimble"), Vehicle::default());
        assert_eq!(names().len(), FILES.len() + 1);
        let error = format!("{:#}", read(Path::new("flaper")).unwrap_err());
        assert!(
            error.contains("vehicle flaper: ") && error.contains("flapper, delfly-nimble;"),
            "{error}"
        );
    }
}
