//! Who waits for a diagnosis at a terminal.

use std::sync::{Mutex, PoisonError};

use crate::progress::Progress;
use haltere_gap::door::Audience;

/// Shows the stage under way as a bar, and lines on standard error.
#[derive(Default)]
pub(super) struct Terminal {
    under_way: Mutex<Option<(&'static str, Progress)>>,
}

impl Audience for Terminal {
    fn at(&self, stage: &'static str, done: usize, of: usize) {
        let mut under_way = self.under_way.lock().unwrap_or_else(PoisonError::into_inner);
        if under_way.as_ref().is_none_or(|(name, _)| *name != stage) {
            // The bar before it goes first.
            *under_way = None;
            *under_way = Some((stage, Progress::new(stage)));
        }
        if let Some((_, progress)) = under_way.as_ref() {
            progress.at(done, of);
        }
    }

    fn say(&self, line: &str) {
        *self.under_way.lock().unwrap_or_else(PoisonError::into_inner) = None;
        eprintln!("{line}");
    }
}
