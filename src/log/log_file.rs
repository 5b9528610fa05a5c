//! A log that is being written, for who does not write it: where it lies.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Whether a file's name is one of logs; a card or a program of another system may have written it large.
pub fn has_log_ending(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("mcap"))
}

/// A file's name as it stands in tables, on one line whatever it holds.
pub fn shown_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let shown = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.into() };
    name.chars().map(shown).collect()
}

/// A log that may be begun later, for who asks from elsewhere.
#[derive(Debug, Default)]
pub struct LogFile {
    path: OnceLock<PathBuf>,
}

impl LogFile {
    /// One that nobody writes any more.
    pub fn complete(path: PathBuf) -> Self {
        Self { path: path.into() }
    }

    /// Where it lies, once it is begun.
    pub fn path(&self) -> Option<&Path> {
        self.path.get().map(PathBuf::as_path)
    }

    pub(crate) fn begin(&self, path: &Path) {
        let _ = self.path.set(path.to_owned());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_log_is_one_however_it_is_written_and_its_name_is_one_line() {
        for (name, is_log) in
            [("a.mcap", true), ("A.MCAP", true), ("a.Mcap", true), ("mcap", false)]
        {
            assert_eq!(has_log_ending(Path::new(name)), is_log, "{name}");
        }
        assert_eq!(
            shown_name(Path::new("logs/two\nlines\t\u{85}ü.mcap")),
            "two\\nlines\\t\\u{85}ü.mcap"
        );
    }
}
