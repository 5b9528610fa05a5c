//! Parameters that a ground station has set: a file of names and values over the configuration.
//!
//! ```text
//! # haltere parameters, crc32 1a2b3c4d
//! FLT_TKO_HGT = 1.2
//! GAN_VEL_X_P = 0.3
//! ```
//!
//! The checksum is that of everything behind the first line. A file that does not fit it is not
//! used, and people are told; single lines that this build refuses are left out, and people are told.
//! Environment variables and `--set` win over it: whoever types a value means it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::Loaded;
use super::layers::Layers;
use haltere_core::checks::Problems;
use haltere_pilot::services::{crc32, find_parameter};
use haltere_pilot::settings::{Config, Note};

/// Name of the file in `store.directory`.
pub const FILE: &str = "parameters.txt";
const HEAD: &str = "# haltere parameters, crc32 ";

/// Values by name.
pub type Values = BTreeMap<String, f64>;

/// The file of these values.
pub fn to_text(values: &Values) -> String {
    let mut body = String::new();
    for (name, value) in values {
        // Writing to a String cannot fail.
        let _ = writeln!(body, "{name} = {value}");
    }
    format!("{HEAD}{:08x}\n{body}", crc32(body.as_bytes(), !0))
}

/// The values of a file. The error is for people.
pub fn from_text(text: &str) -> Result<Values, String> {
    let (head, body) = text.split_once('\n').ok_or("it has no first line")?;
    let crc = head.strip_prefix(HEAD).ok_or_else(|| format!("line 1: expected `{HEAD}…`"))?;
    let crc = u32::from_str_radix(crc.trim(), 16).map_err(|_| format!("line 1: crc32 {crc}"))?;
    let found = crc32(body.as_bytes(), !0);
    if crc != found {
        return Err(format!("crc32 is {found:08x}, line 1 says {crc:08x}"));
    }
    let mut values = Values::new();
    for (n, line) in body.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let parsed = line.split_once('=').and_then(|(name, value)| {
            Some((name.trim().to_owned(), value.trim().parse::<f64>().ok()?))
        });
        let (name, value) =
            parsed.ok_or_else(|| format!("line {}: expected NAME = VALUE", n + 2))?;
        values.insert(name, value);
    }
    Ok(values)
}

/// Where it lies.
pub fn path(directory: &Path) -> PathBuf {
    directory.join(FILE)
}

/// Puts what a station has set over a configuration.
pub(super) fn apply(loaded: &mut Loaded, layers: &Layers) {
    if !loaded.config.store.is_on() {
        return;
    }
    let path = path(&loaded.config.store.directory);
    let name = path.display().to_string();
    let text = match haltere_log::intake::text(&path, super::layers::MOST_BYTES) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return,
        Err(error) => {
            let why = format!("cannot be read: {error}");
            lose(loaded, format!("{name}: not used: {why}"), why);
            return;
        }
    };
    match from_text(&text) {
        Ok(values) => {
            for (parameter, value) in &values {
                match apply_one(loaded, layers, parameter, *value) {
                    Ok(()) => {}
                    Err(Unused::ByHand(key)) => loaded.notes.push(Note::not_used(format!(
                        "{name}: {parameter} = {value} not used: {key} is set by hand"
                    ))),
                    Err(Unused::Refused(why)) => {
                        let why = format!("{parameter} = {value} not used: {why}");
                        lose(loaded, format!("{name}: {why}"), why);
                    }
                }
            }
            if !values.is_empty() {
                let text = format!("{name}: {} parameters set by a ground station", values.len());
                loaded.notes.push(Note::in_force(text));
            }
            loaded.files.push(path);
        }
        Err(why) => lose(
            loaded,
            format!(
                "{name}: not used, the configuration files hold: {why}; remove it, or set the \
                 parameters again"
            ),
            why,
        ),
    }
}

/// Somebody has set what is not in force now: people at stations are told, not only who reads the output.
fn lose(loaded: &mut Loaded, note: String, why: String) {
    loaded.notes.push(Note::not_used(note));
    loaded.lost.get_or_insert(why);
}

/// Why a value is not in force.
enum Unused {
    /// Whoever types a value means it: the key.
    ByHand(String),
    /// This build does not take it.
    Refused(String),
}

impl From<String> for Unused {
    fn from(why: String) -> Self {
        Unused::Refused(why)
    }
}

fn apply_one(loaded: &mut Loaded, layers: &Layers, name: &str, value: f64) -> Result<(), Unused> {
    let Some((_, parameter)) = find_parameter(name) else {
        return Err(Unused::Refused("no such parameter".to_owned()));
    };
    let key = parameter.key_of_list();
    if layers.is_set_by_hand(key) {
        return Err(Unused::ByHand(key.to_owned()));
    }
    let mut pilot = loaded.config.pilot();
    if key.starts_with("limits.") {
        // One end of a range that is left to the anchors: the other end is theirs.
        pilot.limits.resolve(&loaded.survey);
    }
    parameter.put(&mut pilot, value as f32)?;
    let mut changed = loaded.config.clone();
    changed.take_over(pilot);
    let check = |config: &Config| {
        let mut problems = Problems::new();
        config.check_to_fly(&mut problems);
        problems
    };
    let before = check(&loaded.config);
    if let Some(line) = check(&changed).lines().iter().find(|line| !before.lines().contains(line)) {
        return Err(Unused::Refused(line.clone()));
    }
    loaded.config = changed;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values() -> Values {
        [("FLT_TKO_HGT", 1.2), ("GAN_VEL_X_P", 0.3)].map(|(n, v)| (n.to_owned(), v)).into()
    }

    /// A file that is damaged or empty was told in the output alone.
    #[test]
    fn regress_what_is_not_in_force_is_passed_on_to_stations() {
        let folder = tempfile::tempdir().unwrap();
        let here = |name: &str| folder.path().join(name);
        std::fs::write(here("anchors.toml"), include_str!("../../config/anchors.toml")).unwrap();
        let text = format!("[store]\ndirectory = {:?}\n", folder.path().to_str().unwrap());
        std::fs::write(here("haltere.toml"), text).unwrap();
        let lost = |stored: Option<&str>, by_hand: &[&str]| {
            let _ = std::fs::remove_file(here(FILE));
            if let Some(text) = stored {
                std::fs::write(here(FILE), text).unwrap();
            }
            let overrides = by_hand.iter().map(|text| (*text).to_owned()).collect();
            let files = vec![here("haltere.toml")];
            let sources = super::super::Sources { files, overrides, ..Default::default() };
            Loaded::load(&sources).unwrap().lost
        };
        assert_eq!(lost(None, &[]), None);
        assert_eq!(lost(Some(&to_text(&values())), &[]), None);
        assert_eq!(lost(Some(&to_text(&values())), &["flight.takeoff_height_m=2.0"]), None);
        assert!(lost(Some(""), &[]).unwrap().contains("no first line"));
        let cut = to_text(&values());
        assert!(lost(Some(&cut[..cut.len() - 3]), &[]).unwrap().contains("crc32"));
        let beyond = to_text(&[("FLT_TKO_HGT".to_owned(), 99.0)].into());
        assert!(lost(Some(&beyond), &[]).unwrap().contains("FLT_TKO_HGT = 99 not used"));
    }

    #[test]
    fn prop_there_and_back() {
        assert_eq!(from_text(&to_text(&values())), Ok(values()));
        assert_eq!(from_text(&to_text(&Values::new())), Ok(Values::new()));
    }

    #[test]
    fn prop_no_cut_and_no_changed_byte_passes() {
        let text = to_text(&values());
        for end in 0..text.len() {
            assert!(from_text(&text[..end]).is_err(), "cut at {end}");
        }
        for at in 0..text.len() {
            let mut bytes = text.clone().into_bytes();
            bytes[at] ^= 1;
            if let Ok(changed) = String::from_utf8(bytes) {
                assert!(from_text(&changed) != Ok(values()), "changed at {at}: {changed}");
            }
        }
    }
}
