//! Colours where somebody sees them: on a terminal, unless NO_COLOR is set.

use std::io::IsTerminal as _;

/// Colours for standard output.
#[derive(Debug, Clone, Copy)]
pub(super) struct Style {
    on: bool,
}

impl Style {
    /// By what standard output is. https://no-color.org: any value that is not empty switches off.
    pub(super) fn of_stdout() -> Self {
        let refused = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        let dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
        Self { on: std::io::stdout().is_terminal() && !refused && !dumb }
    }

    /// Green.
    pub(super) fn good(self, text: &str) -> String {
        self.paint("32", text)
    }

    /// Yellow.
    pub(super) fn warning(self, text: &str) -> String {
        self.paint("33", text)
    }

    /// Bold red.
    pub(super) fn bad(self, text: &str) -> String {
        self.paint("1;31", text)
    }

    /// Faint.
    pub(super) fn faint(self, text: &str) -> String {
        self.paint("2", text)
    }

    fn paint(self, code: &str, text: &str) -> String {
        if self.on { format!("\x1b[{code}m{text}\x1b[0m") } else { text.to_owned() }
    }
}
