//! What goes out: bytes by link, texts, events, records, and what was thrown away.

pub(crate) mod event_list;
pub(crate) mod events;
pub(crate) mod losses;
pub(crate) mod output;
pub(crate) mod passed_on;
pub(crate) mod recording;
pub(crate) mod shelf;
pub(crate) mod told;
pub(crate) mod voice;

use haltere_core::drops::Drops;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;

use crate::config::PilotConfig;

use output::{Address, Outbox};
use passed_on::PassedOn;
use shelf::Shelf;
use told::Told;
use voice::Echoes;

/// Our own component on ground links: an autopilot (INTERFACES.md section 3).
pub(crate) const OWN_COMPONENT: u8 = 1;

/// What goes out, and what people were told.
#[derive(Debug)]
pub(crate) struct Out {
    /// Who we are on ground links, from the start to the end.
    pub(crate) own: Address,
    pub(crate) outbox: Outbox,
    pub(crate) topics: Vec<Topic>,
    pub(crate) with_topics: bool,
    /// Losses by link number; the last entry is the core itself.
    pub(crate) drops: Vec<Drops>,
    pub(crate) shelf: Shelf,
    pub(crate) text_id: u16,
    pub(crate) told: Told,
    pub(crate) recording: recording::Told,
    pub(crate) passed_on: PassedOn,
    /// How much may still be said to people because of what clients and board say.
    pub(crate) echoes: Echoes,
    /// Whether a client is being answered.
    pub(crate) answering: bool,
}

impl Out {
    /// Towards so many ground links, beside tag and board.
    pub(crate) fn new(config: &PilotConfig, ground_links: usize, at: HostTime) -> Self {
        Self {
            own: Address { system_id: config.system_id, component_id: OWN_COMPONENT },
            outbox: Outbox::of_shadow(config.flight.shadow),
            topics: Vec::new(),
            with_topics: true,
            drops: vec![Drops::default(); 3 + ground_links],
            shelf: Shelf::default(),
            text_id: 0,
            told: Told::new(at),
            recording: recording::Told::default(),
            passed_on: PassedOn::new(),
            echoes: Echoes::new(at),
            answering: false,
        }
    }
}
