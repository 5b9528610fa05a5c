//! The tree that MAVLink FTP shows, and nothing else.
//!
//! ```text
//! /general.json  /param.json     component metadata, made from the parameter table
//! /events.json                   the same of events
//! @PARAM/param.pck               all parameters, packed; not listed, as ArduPilot does not list it
//! /logs/NAME                     flight logs, read only
//! /missions/NAME                 mission files, read and written
//! ```

use super::files::{FileName, Folder};
use super::metadata::{EVENTS_PATH, GENERAL_PATH, PARAMETER_PATH};
use super::param_pack::{Query, query};

/// A place in the tree.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// `/`
    Root,
    /// `/logs` or `/missions`.
    Folder(Folder),
    /// A file of the disk.
    File(FileName),
    /// Made in the core.
    Made(Made),
}

/// A file that lies on no disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Made {
    /// `/general.json`
    General,
    /// `/param.json`
    Parameters,
    /// `/events.json`
    Events,
    /// `@PARAM/param.pck`
    Packed(Query),
}

/// Name of a folder.
pub const LOGS: &str = "logs";
/// Name of a folder.
pub const MISSIONS: &str = "missions";

/// Where a path leads. `None`: nowhere. There is no way up: `..` is no name of ours.
pub fn place(path: &str) -> Option<Place> {
    if let Some(query) = query(path) {
        return Some(Place::Made(Made::Packed(query)));
    }
    let mut parts = path.split('/').filter(|part| !part.is_empty() && *part != ".");
    let (first, second, third) = (parts.next(), parts.next(), parts.next());
    if third.is_some() {
        return None;
    }
    let folder = match first {
        None => return Some(Place::Root),
        Some(LOGS) => Folder::Logs,
        Some(MISSIONS) => Folder::Missions,
        Some(GENERAL_PATH) if second.is_none() => return Some(Place::Made(Made::General)),
        Some(PARAMETER_PATH) if second.is_none() => return Some(Place::Made(Made::Parameters)),
        Some(EVENTS_PATH) if second.is_none() => return Some(Place::Made(Made::Events)),
        Some(_) => return None,
    };
    match second {
        None => Some(Place::Folder(folder)),
        Some(name) => FileName::new(folder, name).map(Place::File),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_paths_lead_into_the_tree_or_nowhere() {
        assert_eq!(place("/"), Some(Place::Root));
        assert_eq!(place(""), Some(Place::Root));
        assert_eq!(place("/logs/"), Some(Place::Folder(Folder::Logs)));
        assert_eq!(place("general.json"), Some(Place::Made(Made::General)));
        assert!(matches!(place("@PARAM/param.pck"), Some(Place::Made(Made::Packed(_)))));
        assert!(matches!(place("/missions/a.toml"), Some(Place::File(_))));
        for bad in [
            "/..",
            "../logs",
            "/logs/../../etc/passwd",
            "/logs/..",
            "/etc",
            "@PARAM/../logs",
            "/logs/a/b",
            "/general.json/x",
            "/logs/a\\b",
            "/missions/.hidden",
            "/logs/a b",
        ] {
            assert_eq!(place(bad), None, "{bad}");
        }
    }
}
