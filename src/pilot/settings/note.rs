//! What people should know about a configuration that is not refused.

use std::fmt::Display;

/// One thing to know.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// What it is about.
    pub subject: &'static str,
    /// As a sentence.
    pub text: String,
    /// What to do about it; empty: nothing.
    pub way_out: &'static str,
}

impl Note {
    /// About a variable that is not used.
    pub fn misspelt(text: String) -> Self {
        let way_out = "two underscores stand between section and key";
        Self { subject: "configuration", text, way_out }
    }

    /// About parameters of a station that are in force.
    pub fn in_force(text: String) -> Self {
        Self { subject: "parameters", text, way_out: "" }
    }

    /// About parameters of a station that are not.
    pub fn not_used(text: String) -> Self {
        let way_out = "see docs/SERVICES.md; remove the file to fly by the configuration alone";
        Self { subject: "parameters", text, way_out }
    }
}

impl Display for Note {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}
