//! What goes out: bytes by link, texts, events, records, and what was thrown away.

pub(crate) mod events;
pub(crate) mod losses;
pub(crate) mod output;
pub(crate) mod passed_on;
pub(crate) mod recording;
pub(crate) mod shelf;
pub(crate) mod told;
pub(crate) mod voice;

use haltere_dialect::mav::haltere::MavMessage;

use haltere_core::drops::Drops;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;

use crate::config::PilotConfig;
use crate::input::LinkId;

use events::Events;
use output::{Address, Outbox, Sent};
use passed_on::PassedOn;
use shelf::Shelf;
use told::Told;
use voice::Echoes;

/// Our own component on ground links: an autopilot (INTERFACES.md section 3).
pub(crate) const OWN_COMPONENT: u8 = 1;

/// A link to stations, as far as what goes out must know of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Listener {
    link: LinkId,
    /// Its number in the configuration.
    endpoint_number: u8,
    /// Whether somebody is there. Nothing is sent to a link without a station.
    is_open: bool,
    /// Whether the station there knows events.
    wants_events: bool,
}

/// What goes out, and what people were told.
#[derive(Debug)]
pub(crate) struct Out {
    /// Who we are on ground links, from the start to the end.
    pub(crate) own: Address,
    pub(crate) outbox: Outbox,
    listeners: Vec<Listener>,
    topics: Vec<Topic>,
    pub(crate) with_topics: bool,
    /// Losses by link number; the last entry is the core itself.
    pub(crate) drops: Vec<Drops>,
    shelf: Shelf,
    text_id: u16,
    events: Events,
    pub(crate) told: Told,
    pub(crate) recording: recording::Told,
    pub(crate) passed_on: PassedOn,
    /// How much may still be said to people because of what clients and board say.
    echoes: Echoes,
    /// Whether a client is being answered.
    pub(crate) answering: bool,
    /// The first second, in which tag and board are being found.
    pub(crate) is_starting: bool,
}

impl Out {
    pub(crate) fn new(config: &PilotConfig, at: HostTime) -> Self {
        let listeners: Vec<Listener> = (0..)
            .zip(config.ground_links())
            .map(|(n, (endpoint_number, _))| Listener {
                link: LinkId::Ground(n),
                endpoint_number,
                is_open: false,
                wants_events: false,
            })
            .collect();
        Self {
            own: Address { system_id: config.system_id, component_id: OWN_COMPONENT },
            outbox: Outbox::of_shadow(config.flight.shadow),
            // Tag, board and the core itself.
            drops: vec![Drops::default(); 3 + listeners.len()],
            listeners,
            topics: Vec::new(),
            with_topics: true,
            shelf: Shelf::default(),
            text_id: 0,
            events: Events::default(),
            told: Told::new(at),
            recording: recording::Told::default(),
            passed_on: PassedOn::new(),
            echoes: Echoes::new(at),
            answering: false,
            is_starting: true,
        }
    }

    /// Queues a message of ours as a MAVLink 2 frame.
    pub(crate) fn message(&mut self, link: LinkId, message: &MavMessage) {
        self.outbox.message(link, self.own, message);
    }

    /// Queues bytes as they are.
    pub(crate) fn raw(&mut self, link: LinkId, bytes: &[u8]) {
        self.outbox.raw(link, bytes);
    }

    /// A message to every station.
    pub(crate) fn tell_all(&mut self, message: &MavMessage) {
        for n in 0..self.listeners.len() {
            if self.listeners[n].is_open {
                self.message(self.listeners[n].link, message);
            }
        }
    }

    /// Somebody speaks on a link to stations, whose streams begin anew.
    pub(crate) fn opens(&mut self, link: LinkId, wants_events: bool) {
        if let Some(listener) = self.listener(link) {
            (listener.is_open, listener.wants_events) = (true, wants_events);
        }
    }

    /// Nobody is left on a link to stations.
    pub(crate) fn closes(&mut self, link: LinkId) {
        if let Some(listener) = self.listener(link) {
            listener.is_open = false;
        }
    }

    /// Whether a link is sent events from now on.
    pub(crate) fn sends_events(&mut self, link: LinkId, wants_events: bool) {
        if let Some(listener) = self.listener(link) {
            listener.wants_events = wants_events;
        }
    }

    /// Whether a station is there.
    pub(crate) fn is_open(&self, link: LinkId) -> bool {
        self.listeners.iter().any(|listener| listener.link == link && listener.is_open)
    }

    /// Number of a link's endpoint in the configuration.
    fn endpoint_number(&self, link: LinkId) -> u8 {
        let listener = self.listeners.iter().find(|listener| listener.link == link);
        listener.map_or(0, |listener| listener.endpoint_number)
    }

    fn listener(&mut self, link: LinkId) -> Option<&mut Listener> {
        self.listeners.iter_mut().find(|listener| listener.link == link)
    }

    /// What was queued for a link since the last call.
    pub(crate) fn take_sent(&mut self, link: LinkId) -> Sent {
        self.outbox.take_sent(link)
    }

    /// Frames for a link that found no room since the last call.
    pub(crate) fn take_refused(&mut self, link: LinkId) -> u64 {
        self.outbox.take_refused(link)
    }

    /// Frames that a shadow kept from the board since the last call.
    pub(crate) fn take_withheld(&mut self) -> u64 {
        self.outbox.take_withheld()
    }

    /// Yields all bytes in order and forgets them.
    pub(crate) fn drain(&mut self, send: impl FnMut(LinkId, &[u8])) {
        self.outbox.drain(send);
    }

    /// `make` runs only when somebody reads the records.
    pub(crate) fn record(&mut self, make: impl FnOnce() -> Topic) {
        if self.with_topics {
            self.topics.push(make());
        }
    }

    /// Yields the records in order and forgets them.
    pub(crate) fn drain_topics(&mut self, take: impl FnMut(Topic)) {
        self.topics.drain(..).for_each(take);
    }

    /// From here on nothing is recorded.
    pub(crate) fn record_nothing(&mut self) {
        self.with_topics = false;
        self.topics.clear();
    }
}
