//! What was found, written back: changes of text files for the simulator and for the vehicle.
//!
//! An effect goes into a scenario as `[effects.on.ID]`; where it only changes numbers of the vehicle,
//! into a vehicle file as these numbers, by the effect's own edit. On the real vehicle there is a trim
//! in the companion's configuration, a corrected position in the anchor file, or a thing to do by hand.
//! Every edit keeps comments and order. Files are written by [`crate::accept::accepted`].

pub mod accepted;
pub mod trim;

use toml_edit::{DocumentMut, InlineTable, Item, Table, TableLike, Value};

use haltere_core::frames::{E, U, Vec3, survey_from_earth};
use haltere_core::measure::AnchorId;
use haltere_model::board::BoardSettings;
use haltere_model::effects::{EffectConfig, EffectSet, EffectSpec};
use haltere_model::vehicle::Vehicle;

/// Why a file is not edited.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EditError {
    /// The file is no TOML.
    #[error("not TOML: {0}")]
    Parse(String),
    /// The file has something else under the name of the table or key.
    #[error("`{key}` stands in the file in a form that is not edited; write yourself:\n{wanted}")]
    Form {
        /// What was to be set.
        key: String,
        /// The lines.
        wanted: String,
    },
    /// A value that the simulator refuses.
    #[error("{0}")]
    Value(String),
    /// The effect is no number of the vehicle.
    #[error("{id} {name} is not a number of the vehicle file; use --scenario")]
    NotOfTheVehicle {
        /// Effect.
        id: &'static str,
        /// Its name.
        name: &'static str,
    },
    /// No such anchor.
    #[error("anchor {id} is not in the file")]
    NoAnchor {
        /// Which.
        id: u8,
    },
}

/// A number as TOML: short, and a float.
pub fn number(value: f64) -> String {
    // Six digits are more than any of these is known to.
    let text = format!("{:.6}", value);
    let text = text.trim_end_matches('0');
    if text.ends_with('.') { format!("{text}0") } else { text.to_owned() }
}

fn parsed<T: std::str::FromStr<Err = toml_edit::TomlError>>(text: &str) -> Result<T, EditError> {
    text.parse().map_err(|e: T::Err| EditError::Parse(e.to_string()))
}

/// Puts a value in the place of another one, with its comment.
fn replace(old: &mut Value, mut new: Value) {
    *new.decor_mut() = old.decor().clone();
    *old = new;
}

/// Sets `key = value` in `[table]` of a TOML text. `value` is TOML.
pub fn set_key(text: &str, table: &str, key: &str, value: &str) -> Result<String, EditError> {
    let form = || EditError::Form {
        key: format!("{table}.{key}"),
        wanted: format!("[{table}]\n{key} = {value}"),
    };
    let mut file: DocumentMut = parsed(text)?;
    let new: Value = parsed(value)?;
    let mut at: &mut dyn TableLike = file.as_table_mut();
    let mut inline = false;
    for part in table.split('.') {
        let missing = || {
            // Within an inline table stands nothing else.
            if inline {
                return Item::Value(InlineTable::new().into());
            }
            let mut table = Table::new();
            table.set_implicit(true);
            Item::Table(table)
        };
        let entry = at.entry(part).or_insert_with(missing);
        inline = entry.is_inline_table();
        at = entry.as_table_like_mut().ok_or_else(form)?;
    }
    match at.get_mut(key) {
        None => drop(at.insert(key, Item::Value(new))),
        Some(old) => replace(old.as_value_mut().ok_or_else(form)?, new),
    }
    Ok(file.to_string())
}

/// Switches an effect on in a scenario, with all its parameters.
pub fn edit_scenario(text: &str, spec: &EffectSpec, theta: &[f64]) -> Result<String, EditError> {
    let table = format!("effects.on.{}", spec.id);
    let mut new = text.to_owned();
    for (p, value) in spec.parameters.iter().zip(theta) {
        new = set_key(&new, &table, p.name, &number(p.told(*value)))?;
    }
    // Read as the simulator reads it.
    let parsed: toml::Table = toml::from_str(&new).map_err(|e| EditError::Parse(e.to_string()))?;
    let effects = parsed.get("effects").cloned().unwrap_or(toml::Value::Table(toml::Table::new()));
    let config: EffectConfig =
        effects.try_into().map_err(|e: toml::de::Error| EditError::Value(e.to_string()))?;
    EffectSet::from_config(&config).map_err(|e| EditError::Value(e.to_string()))?;
    Ok(new)
}

/// Changes the numbers of a vehicle file that an effect changes.
pub fn edit_vehicle(text: &str, spec: &EffectSpec, theta: &[f64]) -> Result<String, EditError> {
    let before = Vehicle::from_toml(text).map_err(|e| EditError::Parse(e.to_string()))?;
    let mut after = before.clone();
    let set = crate::bank::library::with_effect(EffectSet::none(), spec, theta)
        .map_err(|e| EditError::Value(e.to_string()))?;
    // The bank of effects makes the edit, as it does at the start of a flight.
    let (mut board, mut sites) = (BoardSettings::default(), Vec::new());
    let room = haltere_model::room::Room::default();
    haltere_model::effects::Bank::new(&set, 1, &mut after, &mut board, &room, &mut sites);
    match rewrite_vehicle(text, &after)? {
        Some(new) => Ok(new),
        None => Err(EditError::NotOfTheVehicle { id: spec.id, name: spec.name }),
    }
}

/// The text of a vehicle file with the lines changed that make it this vehicle; `None`: it is already. What the file leaves out is left
/// out still, unless it would be another number by the laws of what is left out.
pub fn rewrite_vehicle(text: &str, vehicle: &Vehicle) -> Result<Option<String>, EditError> {
    let read = |text: &str| Vehicle::from_toml(text).map_err(|e| EditError::Parse(e.to_string()));
    let said: toml::Table =
        text.parse().map_err(|e: toml::de::Error| EditError::Parse(e.to_string()))?;
    let says_mass = said.get("body").is_some_and(|body| body.get("mass_kg").is_some());
    let mut new = text.to_owned();
    loop {
        let (found, wanted) = (numbers(&read(&new)?), numbers(vehicle));
        let off: Vec<_> = wanted.iter().filter(|row| !found.contains(row)).collect();
        if off.is_empty() {
            break;
        }
        // A servo that is said must be said whole.
        let begun = |table: &str| {
            table.ends_with("_servo")
                && !said.contains_key(table)
                && off.iter().any(|row| row.0 == table)
        };
        for (table, key, number) in wanted.iter().filter(|row| off.contains(row) || begun(&row.0)) {
            // A file that says no mass changes the usual vehicle, and still does when it says one.
            if key == "mass_kg" && !says_mass && !new.contains("base =") {
                new = format!("base = \"flapper\"\n{new}");
            }
            new = set_key(&new, table, key, number)?;
        }
    }
    let mut problems = haltere_core::checks::Problems::new();
    read(&new)?.check("vehicle", &mut problems);
    problems.into_result().map_err(|e| EditError::Value(e.to_string()))?;
    Ok((new != text).then_some(new))
}

/// Table, key and number of a vehicle as its file has them.
fn numbers(vehicle: &Vehicle) -> Vec<(String, String, String)> {
    let Ok(toml::Value::Table(tables)) = toml::Value::try_from(vehicle) else { return Vec::new() };
    let mut rows = Vec::new();
    for (table, value) in tables {
        if let toml::Value::Table(keys) = value {
            rows.extend(keys.iter().map(|(key, v)| (table.clone(), key.clone(), toml_text(v))));
        }
    }
    rows
}

fn toml_text(value: &toml::Value) -> String {
    match value {
        toml::Value::Float(v) => float(*v),
        toml::Value::Array(all) => {
            let parts: Vec<String> = all.iter().map(toml_text).collect();
            format!("[{}]", parts.join(", "))
        }
        other => other.to_string(),
    }
}

/// Six significant digits, whatever the size: inertias are small numbers.
fn float(v: f64) -> String {
    if v == 0.0 {
        return "0.0".to_owned();
    }
    let digits = (5 - v.abs().log10().floor() as i32).clamp(1, 15) as usize;
    let text = format!("{v:.digits$}");
    let text = text.trim_end_matches('0');
    if text.ends_with('.') { format!("{text}0") } else { text.to_owned() }
}

/// Moves an anchor in an anchor file by a vector of the Earth frame, m.
pub fn edit_anchor(text: &str, id: AnchorId, by_E_m: Vec3<E>) -> Result<String, EditError> {
    let mut file: DocumentMut = parsed(text)?;
    let by = match file.get("frame").and_then(Item::as_str) {
        Some("ned") => by_E_m.to_array(),
        _ => {
            let by_U: Vec3<U> = survey_from_earth(by_E_m);
            by_U.to_array()
        }
    };
    let anchors: Vec<&mut dyn TableLike> = match file.get_mut("anchor") {
        Some(Item::ArrayOfTables(all)) => all.iter_mut().map(|t| t as &mut dyn TableLike).collect(),
        Some(Item::Value(Value::Array(all))) => {
            all.iter_mut().filter_map(|v| Some(v.as_inline_table_mut()? as _)).collect()
        }
        _ => Vec::new(),
    };
    let is_it = |anchor: &&mut dyn TableLike| {
        anchor.get("id").and_then(Item::as_integer) == Some(i64::from(id.0))
    };
    let anchor = anchors.into_iter().find(is_it).ok_or(EditError::NoAnchor { id: id.0 })?;
    let position = anchor.get_mut("position_m").and_then(Item::as_array_mut);
    let Some(position) = position.filter(|position| position.len() == by.len()) else {
        let wanted = format!("[[anchor]]\nid = {}\nposition_m = [x, y, z]", id.0);
        return Err(EditError::Form { key: format!("anchor {}", id.0), wanted });
    };
    for (old, by) in position.iter_mut().zip(by) {
        let number_of = old.as_float().or_else(|| old.as_integer().map(|i| i as f64));
        let at = number_of.ok_or_else(|| EditError::Value(format!("anchor {}: {old}", id.0)))?;
        replace(old, parsed(&number((1e4 * (at + by)).round() / 1e4))?);
    }
    Ok(file.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::library::standard;
    use haltere_model::vehicle::Body;

    fn spec(id: &str) -> &'static EffectSpec {
        standard().into_iter().find(|s| s.id == id).unwrap()
    }

    #[test]
    fn prop_one_line_changes_and_comments_stay() {
        let text =
            "a = 1 # one\n\n[t] # table\nx = 2.0 # two\n# about z\nz = [1, 2]\n\n[[u]]\nx = 5\n";
        let new = set_key(text, "t", "x", "3.5").unwrap();
        assert_eq!(new, text.replace("x = 2.0 # two", "x = 3.5 # two"));
        let new = set_key(text, "t", "y", "1.0").unwrap();
        assert_eq!(new, text.replace("z = [1, 2]\n", "z = [1, 2]\ny = 1.0\n"));
        let new = set_key(text, "v.w", "y", "1.0").unwrap();
        assert_eq!(new, format!("{text}\n[v.w]\ny = 1.0\n"));
        assert!(matches!(set_key("x = ", "t", "x", "1.0"), Err(EditError::Parse(_))));
        for (form, new) in [
            ("t = { x = 1.0 }\n", "t = { x = 3.5 }\n"),
            ("t.x = 1.0 # one\n", "t.x = 3.5 # one\n"),
            ("[t]\nx = [1,\n2]\n", "[t]\nx = 3.5\n"),
        ] {
            assert_eq!(set_key(form, "t", "x", "3.5").unwrap(), new);
        }
        let new = set_key("t = { x = 1.0 }\n", "t.u.v", "y", "2.0").unwrap();
        let new: toml::Table = new.parse().unwrap();
        assert_eq!(new["t"]["u"]["v"]["y"].as_float(), Some(2.0));
        assert_eq!(new["t"]["x"].as_float(), Some(1.0));
        // Something else of that name is refused, with the lines to write.
        for odd in ["t = 3\n", "[t.x]\n"] {
            let said = set_key(odd, "t", "x", "3.5").unwrap_err();
            assert!(said.to_string().contains("[t]\nx = 3.5"), "{odd}: {said}");
        }
    }

    #[test]
    fn prop_a_scenario_takes_every_effect_and_refuses_senseless_values() {
        let text =
            "seed = 3\n\n[effects]\nnominal = true\n\n[[fault]]\nat_s = 1.0\npart = \"tag\"\n";
        for spec in standard() {
            let theta: Vec<f64> = spec.parameters.iter().map(|p| p.default).collect();
            let new = edit_scenario(text, spec, &theta).unwrap();
            let config: toml::Table = toml::from_str(&new).unwrap();
            assert!(config["effects"]["on"].get(spec.id).is_some(), "{new}");
            // Again with other values: replaced, not doubled.
            let again = edit_scenario(&new, spec, &theta).unwrap();
            assert_eq!(again, new);
        }
        assert!(matches!(edit_scenario(text, spec("P1"), &[40.0]), Err(EditError::Value(_))));
    }

    #[test]
    fn val_a_vehicle_file_gets_the_numbers_that_the_effect_makes() {
        let heavier = edit_vehicle("name = \"own\"\n", spec("I1"), &[6.0]).unwrap();
        let vehicle = Vehicle::from_toml(&heavier).unwrap();
        assert!((vehicle.body.mass_kg - Vehicle::default().body.mass_kg - 0.006).abs() < 1e-7);
        assert_eq!(vehicle.name, "own");
        let mass = vehicle.body.mass_kg;
        assert_eq!(
            vehicle,
            Vehicle {
                name: "own".into(),
                body: Body { mass_kg: mass, ..Body::default() },
                ..Vehicle::default()
            }
        );
        let rough = edit_vehicle("", spec("A1"), &[1.3, 1.0, 1.0]).unwrap();
        let vehicle = Vehicle::from_toml(&rough).unwrap();
        let (now, was) = (vehicle.drag.k_ns_per_m_hz[0], Vehicle::default().drag.k_ns_per_m_hz[0]);
        assert!((now / was - 1.3).abs() < 1e-4, "{rough}");
        let said = edit_vehicle("", spec("U2"), &[0.2, 3.0]).unwrap_err();
        assert!(said.to_string().contains("--scenario"), "{said}");
    }

    #[test]
    fn val_an_anchor_moves_in_the_frame_of_its_file() {
        let text = "frame = \"enu\" # z up\n\n[[anchor]]\nid = 4\nposition_m = [1.0, 2.0, 3.0] # shelf\n\n[[anchor]]\nid = 7\nposition_m = [0.0, 0.0, 1]\n";
        // North 0.2, east 0.1, down 0.3: in ENU x east 0.1, y north 0.2, z up -0.3.
        let new = edit_anchor(text, AnchorId(4), Vec3::new(0.2, 0.1, 0.3)).unwrap();
        let by = haltere_core::frames::survey_from_earth(Vec3::<E>::new(0.2, 0.1, 0.3)).to_array();
        let want = format!(
            "position_m = [{}, {}, {}] # shelf",
            number(1.0 + by[0]),
            number(2.0 + by[1]),
            number(3.0 + by[2])
        );
        assert_eq!(new, text.replace("position_m = [1.0, 2.0, 3.0] # shelf", &want));
        let said = edit_anchor(text, AnchorId(5), Vec3::new(0.0, 0.0, 0.0)).unwrap_err();
        assert_eq!(said, EditError::NoAnchor { id: 5 });
        let inline = "frame = \"ned\"\nanchor = [{ id = 4, position_m = [1.0, 2.0, 3.0] }]\n";
        let new = edit_anchor(inline, AnchorId(4), Vec3::new(0.1, 0.0, 0.0)).unwrap();
        assert_eq!(new, inline.replace("[1.0, 2.0, 3.0]", "[1.1, 2.0, 3.0]"));
        let short = inline.replace(", 3.0", "");
        assert!(matches!(
            edit_anchor(&short, AnchorId(4), Vec3::new(0.1, 0.0, 0.0)),
            Err(EditError::Form { .. })
        ));
    }
}
