//! The tree that MAVLink FTP shows, and nothing else.
//!
//! ```text
//! /general.json  /param.json     component metadata, made from the parameter table
//! /logs/NAME                     flight logs, read only
//! /missions/NAME                 mission files, read and written
//! ```

use super::files::{FileName, Folder};
use super::metadata::{GENERAL_PATH, PARAMETER_PATH};

/// A place in the tree.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// `/`
    Root,
    /// `/logs` or `/missions`.
    Folder(Folder),
    /// A file of the disk.
    File(FileName),
    /// `/general.json`
    General,
    /// `/param.json`
    Parameters,
}

/// Name of a folder.
pub const LOGS: &str = "logs";
/// Name of a folder.
pub const MISSIONS: &str = "missions";

/// Where a path leads. `None`: nowhere. There is no way up: `..` is no name of ours.
pub fn place(path: &str) -> Option<Place> {
    let mut parts = path.split('/').filter(|part| !part.is_empty() && *part != ".");
    let (first, second, third) = (parts.next(), parts.next(), parts.next());
    if third.is_some() {
        return None;
    }
    let folder = match first {
        None => return Some(Place::Root),
        Some(LOGS) => Folder::Logs,
        Some(MISSIONS) => Folder::Missions,
        Some(GENERAL_PATH) if second.is_none() => return Some(Place::General),
        Some(PARAMETER_PATH) if second.is_none() => return Some(Place::Parameters),
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
        assert_eq!(place("general.json"), Some(Place::General));
        assert!(matches!(place("/missions/a.toml"), Some(Place::File(_))));
        for bad in [
            "/..",
            "../logs",
            "/logs/../../etc/passwd",
            "/logs/..",
            "/etc",
            "@PARAM/param.pck",
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
