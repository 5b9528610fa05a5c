//! Reads a vehicle file: refuses what it may not hold, and fills in what it leaves out.

use haltere_core::checks::Problems;
use haltere_core::checks::schema::Schema;
use serde::Deserialize as _;
use toml::de::DeTable;

use crate::left_out::{self, BASE, LeftOut};
use crate::vehicle::Vehicle;

/// What a file names as its base.
const FLAPPER: &str = "flapper";

impl Vehicle {
    /// From the text of a vehicle file; what it may not hold is refused, a newer one before anything in it. Keys that it
    /// leaves out: `crate::left_out`.
    pub fn from_toml(text: &str) -> Result<Self, Problems> {
        Self::read(text).map(|(vehicle, _)| vehicle)
    }

    /// The same, and the keys that were left out of the file of a vehicle of its own, with the law of each.
    pub fn read(text: &str) -> Result<(Self, Vec<LeftOut>), Problems> {
        let refused = |why: String| {
            let mut problems = Problems::new();
            problems.say(why);
            problems
        };
        let mut root = DeTable::parse(text).map_err(|e| refused(e.to_string()))?;
        if let Some(version) = root.get_mut().remove(Schema::KEY) {
            let shown = version.get_ref().as_integer().map_or("no whole number", |v| v.as_str());
            Schema::VEHICLE.check_text(shown).map_err(|e| refused(e.to_string()))?;
        }
        if let Some(base) = root.get_mut().remove(BASE)
            && base.get_ref().as_str() != Some(FLAPPER)
        {
            let found = base.get_ref().as_str().unwrap_or("no text");
            return Err(refused(format!(
                "base = {found:?}, allowed {FLAPPER:?}: the vehicle that what is left out is taken from; leave it out for \
                 a vehicle of its own"
            )));
        }
        // With its place in the text, which the table alone does not know.
        let told = |e: toml::de::Error| {
            let start = e.span().map_or(0, |span| span.start);
            let line = 1 + text.bytes().take(start).filter(|byte| *byte == b'\n').count();
            refused(format!("line {line}: {}", e.message()))
        };
        let mut vehicle = Self::deserialize(toml::Deserializer::from(root)).map_err(told)?;
        let said = text.parse().map_err(|e: toml::de::Error| refused(e.to_string()))?;
        let left = left_out::complete(&mut vehicle, &said);
        Ok((vehicle, left))
    }
}
