//! What changes the mode, from wherever it comes, and what the flight looks at for it.

use haltere_core::time::HostTime;

use super::act::Act;
use crate::flight::modes::Event;
use crate::view::{Sight, around};

impl Act<'_> {
    /// All that conditions and the table at rest look at.
    pub(crate) fn sight(&self, at: HostTime) -> Sight<'_> {
        around!(self, at).sight(self.flight, self.out)
    }

    /// Lets an event change the mode. `false`: there is no row for it.
    pub(crate) fn fire(&mut self, at: HostTime, event: Event) -> bool {
        if let Some(seq) = self.flight.landed_item(event) {
            self.tell_reached(at, seq);
        }
        let changed = self.flight.happened(&around!(self, at), event, None, self.out, self.wishes);
        self.grant(at);
        changed
    }

    /// Walks the conditions once, and does what they ask for.
    pub(super) fn walk_conditions(&mut self, at: HostTime) {
        self.flight.walk_conditions(&around!(self, at), self.out, self.wishes);
        self.grant(at);
    }

    /// Lets what waits for the take-off follow it. `false`: nothing does, or what it follows has stopped.
    pub(super) fn begin_next(&mut self, at: HostTime) -> bool {
        let begins = self.flight.begin_next(&around!(self, at), self.out, self.wishes);
        self.grant(at);
        begins
    }

    /// The board may not have heard us for so long.
    pub(super) fn note_pause(&mut self, at: HostTime, pause_s: f64) {
        self.flight.note_pause(&around!(self, at), pause_s, self.wishes);
        self.grant(at);
    }
}
