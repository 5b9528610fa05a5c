//! All parameters as one packed file, `@PARAM/param.pck`, which MAVProxy and pymavlink ask for first.
//!
//! Source: the "ParamPack" section of the MAVLink FTP page of ArduPilot's developer guide, and the
//! reader in pymavlink's `mavftp.py`. Little-endian: magic, count in the file, count in all (u16
//! each); then for every parameter type and flags (four bits each), the length of what its name shares
//! with the one before and of the rest less one (four bits each), the rest of the name, the value,
//! and the default where it differs and was asked for. In the order of names, so that much is shared.

use super::parameter_table as table;
use crate::config::PilotConfig;

/// The path, without what may follow a question mark.
pub const PATH: &str = "@PARAM/param.pck";
/// First word of a file without and with defaults.
const MAGIC: u16 = 0x671B;
const MAGIC_WITH_DEFAULTS: u16 = 0x671C;
/// AP_PARAM_FLOAT.
const FLOAT: u8 = 4;
/// Flag: a default follows.
const HAS_DEFAULT: u8 = 1 << 4;
/// Most that four bits tell of a shared beginning.
const MOST_SHARED: usize = 15;

/// What is asked behind the question mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Query {
    /// Defaults too.
    pub with_defaults: bool,
    /// The first, and how many.
    start: u16,
    count: u16,
}

/// `@PARAM/param.pck?withdefaults=1&start=0&count=100`. `None`: another path. Keys that we do not
/// know are passed over, as the protocol wants it.
pub fn query(path: &str) -> Option<Query> {
    let rest = path.trim_start_matches('/').strip_prefix(PATH)?;
    let mut query = Query { with_defaults: false, start: 0, count: u16::MAX };
    let Some(keys) = rest.strip_prefix('?') else { return rest.is_empty().then_some(query) };
    for (key, value) in keys.split('&').filter_map(|pair| pair.split_once('=')) {
        let Ok(value) = value.parse::<u16>() else { continue };
        match key {
            "withdefaults" => query.with_defaults = value == 1,
            "start" => query.start = value,
            "count" => query.count = value,
            _ => {}
        }
    }
    Some(query)
}

/// The file.
pub fn pack(config: &PilotConfig, px4: bool, query: Query) -> Vec<u8> {
    let defaults = PilotConfig::default();
    let mut all: Vec<_> = table::all().take(table::count(px4)).collect();
    all.sort_by_key(|p| p.name);
    let total = all.len();
    let chosen = all.into_iter().skip(usize::from(query.start)).take(usize::from(query.count));
    let (mut body, mut count, mut before) = (Vec::new(), 0_u16, "");
    for p in chosen {
        let same = before.bytes().zip(p.name.bytes()).take_while(|(a, b)| a == b).count();
        // A rest of at least one letter.
        let shared = same.min(MOST_SHARED).min(p.name.len() - 1);
        let rest = &p.name.as_bytes()[shared..];
        let value = p.value(config);
        let default = (query.with_defaults && p.has_default())
            .then(|| p.value(&defaults))
            .filter(|default| *default != value);
        body.push(FLOAT | if default.is_some() { HAS_DEFAULT } else { 0 });
        body.push(shared as u8 | (rest.len() as u8 - 1) << 4);
        body.extend_from_slice(rest);
        body.extend_from_slice(&value.to_le_bytes());
        body.extend(default.iter().flat_map(|default| default.to_le_bytes()));
        before = p.name;
        count += 1;
    }
    let magic = if query.with_defaults { MAGIC_WITH_DEFAULTS } else { MAGIC };
    let mut file = Vec::with_capacity(6 + body.len());
    for word in [magic, count, total as u16] {
        file.extend_from_slice(&word.to_le_bytes());
    }
    file.extend(body);
    file
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads it as the guide says.
    fn unpack(file: &[u8]) -> Vec<(String, f32, Option<f32>)> {
        let mut at = 6;
        let mut take = |n: usize| {
            at += n;
            &file[at - n..at]
        };
        let mut names: Vec<(String, f32, Option<f32>)> = Vec::new();
        let float = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
        for _ in 0..u16::from_le_bytes([file[2], file[3]]) {
            let kind = take(1)[0];
            let lengths = take(1)[0];
            assert_eq!(kind & 15, FLOAT);
            let before = names.last().map_or("", |n| n.0.as_str());
            let shared = before[..usize::from(lengths & 15)].to_owned();
            let rest = String::from_utf8(take(usize::from(lengths >> 4) + 1).to_vec()).unwrap();
            let value = float(take(4));
            let default = (kind & HAS_DEFAULT != 0).then(|| float(take(4)));
            names.push((shared + &rest, value, default));
        }
        assert_eq!(at, file.len());
        names
    }

    #[test]
    fn prop_the_file_holds_every_parameter_once() {
        let mut config = PilotConfig::default();
        config.limits.battery_low_v += 0.1;
        let plain = unpack(&pack(&config, false, query(PATH).unwrap()));
        assert_eq!(plain.len(), table::count(false));
        assert!(plain.is_sorted_by(|a, b| a.0 < b.0));
        for (name, value, default) in &plain {
            let (_, p) = table::find(name).unwrap();
            assert_eq!((*value, *default), (p.value(&config), None), "{name}");
        }
        let asked = query("/@PARAM/param.pck?withdefaults=1&start=0").unwrap();
        let with = unpack(&pack(&config, false, asked));
        let moved: Vec<_> = with.iter().filter(|(.., default)| default.is_some()).collect();
        assert!(!moved.is_empty() && moved.len() < 5, "{moved:?}");
        let part = query("@PARAM/param.pck?start=2&count=3&new=thing").unwrap();
        assert_eq!(unpack(&pack(&config, false, part)).len(), 3);
        assert_eq!(query("@PARAM/param.pckx"), None);
        assert_eq!(query("@PARAM/other"), None);
    }
}
