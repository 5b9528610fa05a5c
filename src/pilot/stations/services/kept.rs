//! What was kept over a restart and could not be read back. A fence that a power cut has emptied must not be
//! taken for none: it is told to every station that comes, and nothing arms until somebody uploads it anew
//! or clears it.

use haltere_core::time::HostTime;

use super::Purpose;
use super::Services;
use super::files::{FileFault, Plan};
use super::plans::name_of;
use crate::input::LinkId;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::stations::Stations;
use crate::view;

/// Longest reason that is passed on, characters: what glue says is text of its own, but of any length.
const LONGEST_REASON: usize = 200;

/// What is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kept {
    Parameters,
    Plan(Plan),
}

impl Kept {
    fn name(self) -> &'static str {
        match self {
            Kept::Parameters => "parameters",
            Kept::Plan(plan) => name_of(plan),
        }
    }
}

/// What is missing, each with the reason.
#[derive(Debug, Default)]
pub(crate) struct Lost(Vec<(Kept, String)>);

impl Lost {
    fn texts(&self) -> impl Iterator<Item = String> + '_ {
        self.0.iter().map(|(kept, why)| format!("{} not restored: {why}", kept.name()))
    }

    /// Whether nothing is missing.
    pub(crate) fn is_nothing(&self) -> bool {
        self.0.is_empty()
    }

    /// Somebody has put another in its place, or wants none.
    pub(crate) fn settle(&mut self, settled: Kept) {
        self.0.retain(|(kept, _)| *kept != settled);
    }
}

impl Stations {
    pub(crate) fn note_lost(&mut self, at: HostTime, kept: Kept, why: &str, out: &mut Out) {
        let why: String = why.chars().take(LONGEST_REASON).collect();
        let lost = &mut self.services.lost;
        lost.settle(kept);
        lost.0.push((kept, why));
        if let Some(text) = lost.texts().last() {
            out.say(at, Severity::Warning, text);
        }
    }

    /// Glue has looked at the parameters before the core began.
    pub(crate) fn parameters_told(
        &mut self,
        at: HostTime,
        result: Result<(), FileFault>,
        bytes: &[u8],
        out: &mut Out,
    ) {
        if let Err(fault) = result {
            let why = String::from_utf8_lossy(bytes);
            let why = if why.is_empty() { fault.words().into() } else { why };
            self.note_lost(at, Kept::Parameters, &why, out);
        }
    }

    /// For a station that speaks for the first time: it was not there when it was told.
    pub(crate) fn tell_lost(&mut self, at: HostTime, link: LinkId, out: &mut Out) {
        let texts: Vec<String> = self.services.lost.texts().collect();
        for text in texts {
            if out.may_echo(at) {
                out.say_to(at, link, Severity::Warning, &text);
            }
        }
    }
}

impl view::Kept for Services {
    fn lost_forbids(&self) -> Option<String> {
        if self.desk.waits_for(|purpose| matches!(purpose, Purpose::LoadPlan(_))) {
            return Some("fence, rally points and mission are still being read".to_owned());
        }
        let text = self.lost.texts().next()?;
        let (kept, _) = self.lost.0.first()?;
        let way_out = match kept {
            Kept::Parameters => "set them, or reset them",
            Kept::Plan(_) => "upload it, or clear it",
        };
        Some(format!("{text}; {way_out}"))
    }
}
