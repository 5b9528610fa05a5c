//! Versions of what is written to files that outlive a build: flight logs, configurations, vehicle files.
//!
//! A version is raised when what a build writes would be misread, or could not be read, by the build before
//! it: another input of the core in a log, another meaning of a key. A key or record more is no reason. What
//! says nothing is of version 1, from before versions were written. A newer one than this build knows is
//! refused in words, before anything in it is judged.

use std::fmt::{self, Display, Formatter};

/// One kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Schema {
    what: &'static str,
    newest: u32,
}

/// A file of a newer build.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NotReadable {
    what: &'static str,
    found: String,
    newest: u32,
}

impl Display for NotReadable {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { what, found, newest } = self;
        let build = env!("CARGO_PKG_VERSION");
        write!(
            f,
            "schema version {found} of the {what}, this build ({build}) reads 1 to {newest}: it was written for a \
             newer haltere; install that one"
        )
    }
}

impl std::error::Error for NotReadable {}

impl Schema {
    /// Flight logs: `Session.schema_version` in `haltere.proto`.
    pub const LOG: Self = Self { what: "log", newest: 3 };
    /// Configuration files.
    pub const CONFIGURATION: Self = Self { what: "configuration", newest: 1 };
    /// Vehicle files.
    pub const VEHICLE: Self = Self { what: "vehicle file", newest: 1 };

    /// Key of configuration and vehicle file, above every section.
    pub const KEY: &'static str = "schema_version";

    /// What this build writes.
    pub fn newest(self) -> u32 {
        self.newest
    }

    /// Refuses what this build does not know.
    pub fn check(self, found: u32) -> Result<(), NotReadable> {
        self.check_text(&found.to_string())
    }

    /// The same for a value as it stands in a file.
    pub fn check_text(self, found: &str) -> Result<(), NotReadable> {
        if found.parse::<u32>().is_ok_and(|v| (1..=self.newest).contains(&v)) {
            return Ok(());
        }
        Err(NotReadable { what: self.what, found: found.to_owned(), newest: self.newest })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_only_what_is_known_is_read() {
        assert!(Schema::LOG.check(1).is_ok() && Schema::LOG.check(Schema::LOG.newest()).is_ok());
        for found in ["0", "-1", "1.0", "\"1\"", "4294967296"] {
            assert!(Schema::VEHICLE.check_text(found).is_err(), "{found}");
        }
        let error = Schema::LOG.check(Schema::LOG.newest() + 1).unwrap_err().to_string();
        assert!(error.contains("of the log") && error.contains("a newer haltere"), "{error}");
    }
}
