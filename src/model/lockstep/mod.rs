//! Lockstep: plant and pilot core coupled in memory, on one simulated clock, as fast as they go.
//!
//! The same bytes cross the same borders as over real wires: the tag's stream, the board's MAVLink
//! and a ground endpoint. Nothing waits, nothing is drawn from a clock, so two runs with one seed
//! are equal to the last bit.

// The definitions call some messages superseded; today's clients still send and expect them.
#![allow(deprecated)]

mod flight;
mod ground;
mod world;

#[cfg(test)]
mod tests;

pub use flight::{
    Flight, FlightError, SAMPLE_US, Sample, fly, fly_unsampled, fly_watched, local_item,
    make_ready, start,
};
pub use ground::{Ground, VEHICLE};
pub use world::World;

use crate::{Plant, PlantConfig, Truth};
use haltere_core::checks::Problems;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_pilot::services::{FileFault, FileRequest, FileTask};
use haltere_pilot::{Input, LinkId, Pilot, PilotConfig};

/// Step of the plant, µs: its 500 Hz.
pub const STEP_US: u64 = 2_000;

/// Host time at which simulated time is zero: a computer is never freshly booted.
pub const HOST_START_US: u64 = 100_000_000;

/// Changes what arrives before the core gets it: simulated time in µs, link, bytes.
pub type Damage = Box<dyn FnMut(u64, LinkId, &mut Vec<u8>) + Send>;
/// Sees everything that the core sends: simulated time in µs, link, bytes.
pub type Tap = Box<dyn FnMut(u64, LinkId, &[u8]) + Send>;

/// Called before every step with the simulated time in µs: what happens to the world by itself.
pub type Happenings<W> = Box<dyn FnMut(u64, &mut W) + Send>;

/// Stands in for the disk: a task, and what came of it.
pub type Disk = Box<dyn FnMut(&FileTask) -> Result<Vec<u8>, FileFault> + Send>;

/// Sees everything that the core is given, in order: what a log needs to be replayed.
pub type Listener = Box<dyn FnMut(HostTime, Input<'_>) + Send>;

/// A world and the pilot core that flies in it.
pub struct Lockstep<W = Plant> {
    plant: W,
    pilot: Pilot,
    t_us: u64,
    ground_out: Vec<Vec<u8>>,
    damage: Option<Damage>,
    tap: Option<Tap>,
    listener: Option<Listener>,
    disk: Option<Disk>,
    happenings: Option<Happenings<W>>,
}

impl Lockstep {
    /// The nominal plant and the core at rest on the floor, links up.
    pub fn new(plant: PlantConfig, pilot: PilotConfig, survey: &Survey) -> Result<Self, Problems> {
        Ok(Self::in_world(Plant::new(plant)?, pilot, survey, None))
    }
}

impl<W: World> Lockstep<W> {
    /// The core at rest in any world, links up. The listener hears every input from the first.
    pub fn in_world(
        plant: W,
        pilot: PilotConfig,
        survey: &Survey,
        listener: Option<Listener>,
    ) -> Self {
        let mut all = Self::without_stations(plant, pilot, survey, listener);
        for n in 0..u8::try_from(all.ground_out.len()).unwrap_or(u8::MAX) {
            all.feed(all.host_now(), Input::LinkUp { link: LinkId::Ground(n) });
        }
        all
    }

    /// The same; links of stations are down until somebody tells the core otherwise.
    pub fn without_stations(
        plant: W,
        pilot: PilotConfig,
        survey: &Survey,
        listener: Option<Listener>,
    ) -> Self {
        let at = HostTime::from_us(HOST_START_US);
        let grounds = u8::try_from(pilot.ground_links().count()).unwrap_or(u8::MAX);
        let pilot = Pilot::new(pilot, survey.clone(), at);
        let ground_out = vec![Vec::new(); usize::from(grounds)];
        let mut all = Self {
            plant,
            pilot,
            t_us: 0,
            ground_out,
            damage: None,
            tap: None,
            listener,
            disk: None,
            happenings: None,
        };
        all.feed(at, Input::LinkUp { link: LinkId::Tag });
        all.feed(at, Input::LinkUp { link: LinkId::Board });
        all
    }

    /// The companion dies, and another one is there at once.
    #[cfg(test)]
    pub(crate) fn restart_companion(&mut self, pilot: PilotConfig, survey: &Survey) {
        let at = self.host_now();
        self.pilot = Pilot::new(pilot, survey.clone(), at);
        let grounds = 0..u8::try_from(self.ground_out.len()).unwrap_or(u8::MAX);
        for link in [LinkId::Tag, LinkId::Board].into_iter().chain(grounds.map(LinkId::Ground)) {
            self.feed(at, Input::LinkUp { link });
        }
    }

    fn feed(&mut self, at: HostTime, input: Input<'_>) {
        feed(&mut self.pilot, &mut self.listener, at, input);
    }

    /// Switches decoded records off; nobody then reads them with [`Lockstep::pilot_mut`].
    pub fn without_topics(mut self) -> Self {
        self.pilot = self.pilot.without_topics();
        self
    }

    /// Switches the streams to stations off: nothing flies by them.
    pub fn without_streams(mut self) -> Self {
        self.pilot = self.pilot.without_streams();
        self
    }

    /// Damages what arrives, or listens to it.
    pub fn with_damage(mut self, damage: Damage) -> Self {
        self.damage = Some(damage);
        self
    }

    /// Lets things happen to the world, whatever else is going on.
    pub fn with_happenings(mut self, happenings: Happenings<W>) -> Self {
        self.happenings = Some(happenings);
        self
    }

    /// Answers what the core asks of a disk; without one nobody does.
    pub fn with_disk(mut self, disk: Disk) -> Self {
        self.disk = Some(disk);
        self
    }

    /// Listens to all that the core sends.
    pub fn with_tap(mut self, tap: Tap) -> Self {
        self.tap = Some(tap);
        self
    }

    /// Simulated time since the start, µs.
    pub fn t_us(&self) -> u64 {
        self.t_us
    }

    /// Host time of the companion.
    pub fn host_now(&self) -> HostTime {
        HostTime::from_us(HOST_START_US + self.t_us)
    }

    /// Truth, for whoever scores.
    pub fn truth(&self) -> Truth {
        self.plant.truth()
    }

    /// The plant.
    pub fn plant_mut(&mut self) -> &mut W {
        &mut self.plant
    }

    /// The core.
    pub fn pilot(&self) -> &Pilot {
        &self.pilot
    }

    /// The core, to read its records.
    pub fn pilot_mut(&mut self) -> &mut Pilot {
        &mut self.pilot
    }

    /// Bytes to a ground endpoint.
    pub fn ground_in_at(&mut self, n: u8, bytes: &[u8]) {
        let link = LinkId::Ground(n);
        match &mut self.damage {
            None => self.input(Input::Bytes { link, bytes }),
            Some(damage) => {
                let mut bytes = bytes.to_vec();
                damage(self.t_us, link, &mut bytes);
                self.input(Input::Bytes { link, bytes: &bytes });
            }
        }
    }

    /// Anything else that glue could tell the core, now.
    pub fn input(&mut self, input: Input<'_>) {
        self.feed(self.host_now(), input);
        self.carry();
    }

    /// Bytes from a ground endpoint since the last call of [`Lockstep::clear_ground_out_of`].
    pub fn ground_out_of(&self, n: u8) -> &[u8] {
        self.ground_out.get(usize::from(n)).map_or(&[], Vec::as_slice)
    }

    /// Forgets what it sent.
    pub fn clear_ground_out_of(&mut self, n: u8) {
        if let Some(bytes) = self.ground_out.get_mut(usize::from(n)) {
            bytes.clear();
        }
    }

    /// One step of the plant, and all that follows from it.
    pub fn step(&mut self) {
        if let Some(happenings) = &mut self.happenings {
            happenings(self.t_us, &mut self.plant);
        }
        self.t_us += STEP_US;
        self.plant.advance_to(self.t_us);
        let at = self.host_now();
        let tag = self.plant.tag_output();
        if let Some(damage) = &mut self.damage {
            damage(self.t_us, LinkId::Tag, tag);
        }
        if !tag.is_empty() {
            let input = Input::Bytes { link: LinkId::Tag, bytes: tag };
            feed(&mut self.pilot, &mut self.listener, at, input);
            tag.clear();
        }
        let board = self.plant.board_output();
        if let Some(damage) = &mut self.damage {
            damage(self.t_us, LinkId::Board, board);
        }
        if !board.is_empty() {
            let input = Input::Bytes { link: LinkId::Board, bytes: board };
            feed(&mut self.pilot, &mut self.listener, at, input);
            board.clear();
        }
        if at >= self.pilot.next_deadline() {
            self.feed(at, Input::Wake);
        }
        self.carry();
    }

    /// The world goes on and the companion's computer stands still, until this simulated time, µs. What
    /// arrives meanwhile waits.
    pub fn stall_until(&mut self, t_us: u64) {
        while self.t_us < t_us {
            self.t_us += STEP_US;
            self.plant.advance_to(self.t_us);
        }
    }

    /// Steps until this simulated time, µs.
    pub fn run_until(&mut self, t_us: u64) {
        while self.t_us < t_us {
            self.step();
        }
    }

    /// Tasks for the disk are done at once.
    fn serve_files(&mut self) {
        // An answer may bring the next task; the depth of that is bounded by the patience of a test.
        for _ in 0..64 {
            let mut requests: Vec<FileRequest> = Vec::new();
            self.pilot.drain_file_requests(|request| requests.push(request));
            let Some(disk) = &mut self.disk else { return };
            if requests.is_empty() {
                return;
            }
            let answers: Vec<_> = requests.into_iter().map(|r| (r.ticket, disk(&r.task))).collect();
            let at = self.host_now();
            for (ticket, result) in answers {
                let bytes = result.clone().unwrap_or_default();
                self.feed(at, Input::File { ticket, result: result.map(|_| ()), bytes: &bytes });
            }
        }
    }

    fn carry(&mut self) {
        self.serve_files();
        let Self { plant, pilot, ground_out, tap, t_us, .. } = self;
        pilot.drain_output(|link, bytes| {
            if let Some(tap) = tap {
                tap(*t_us, link, bytes);
            }
            match link {
                LinkId::Tag => plant.tag_input(bytes),
                LinkId::Board => plant.board_input(bytes),
                LinkId::Ground(n) => {
                    if let Some(out) = ground_out.get_mut(usize::from(n)) {
                        out.extend_from_slice(bytes);
                    }
                }
            }
        });
    }
}

/// Apart from the struct, so that the world may still hold the bytes.
fn feed(pilot: &mut Pilot, listener: &mut Option<Listener>, at: HostTime, input: Input<'_>) {
    if let Some(listener) = listener {
        listener(at, input);
    }
    pilot.handle(at, input);
}
