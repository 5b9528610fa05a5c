//! The pilot core: one deterministic state machine, bytes and time in, bytes and next deadline out.
//!
//! It runs the schedule, the estimator, the controller and the modes, and knows no socket, no
//! clock and no thread. Glue calls [`Pilot::handle`] with whatever arrives and with a wake-up at
//! [`Pilot::next_deadline`], then sends what [`Pilot::drain_output`] yields.
//!
//! Begin with `flight/modes`, the table of transitions, `schedule`, the control step and what is due beside it, and
//! `flight/supervisor/list.rs`, what can go wrong and what is then done. In the folder of `schedule` the parts meet:
//! `said` has a row for every message of a station, `ordered` for every command. Beside them are `input`, all that can
//! happen, `settings` and `config`, what can be configured, `view`, what the parts may look at of one another, `wish`,
//! what they want changed in one another, and five folders:
//!
//! * `out`: bytes by link, texts and events for people, records, and what was thrown away and why;
//! * `navigation`: from packets of the tag to time differences, from all that is measured to an estimate, and what is
//!   found of floor, room and sensors beside it;
//! * `board`: the link to the board with what firmwares are like, and who else speaks there;
//! * `flight`: how a flight begins and ends, what the controller is asked for, what must hold before, the same beside
//!   somebody else who flies;
//! * `stations`: links, which frames come in at all, who may command, frames for others, what clients are answered
//!   and streamed, and in `services` what they fetch and store: parameters, plans, files, logs, programs. The core
//!   asks for files and has no disk.
//!
//! ```
//! use haltere_core::frames::Vec3;
//! use haltere_core::measure::AnchorId;
//! use haltere_core::survey::Survey;
//! use haltere_core::time::HostTime;
//! use haltere_pilot::{Input, LinkId, Mode, Pilot, PilotConfig};
//!
//! let corner = |i: u8, bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
//! let anchors: Vec<_> = (0..8)
//!     .map(|i| (AnchorId(i), Vec3::new(corner(i, 1, 8.0), corner(i, 2, 10.0), -corner(i, 4, 5.0))))
//!     .collect();
//! let survey = Survey::new(&anchors)?;
//!
//! let mut pilot = Pilot::new(PilotConfig::default(), survey, HostTime::from_us(0));
//! pilot.handle(HostTime::from_us(0), Input::LinkUp { link: LinkId::Board });
//! let mut sent = 0;
//! while pilot.next_deadline() < HostTime::from_us(2_500_000) {
//!     pilot.handle(pilot.next_deadline(), Input::Wake);
//!     pilot.drain_output(|link, bytes| sent += usize::from(link == LinkId::Board) * bytes.len());
//! }
//! // Nobody answers: it looks for a board, and flies nothing.
//! assert!(sent > 0 && pilot.mode() == Mode::Disarmed);
//! # Ok::<(), haltere_core::checks::Problems>(())
//! ```

// The definitions call some messages superseded; today's clients still send and expect them.
#![allow(deprecated)]

#[cfg(test)]
mod bench;
mod board;
mod clock;
mod config;
mod flight;
mod input;
mod navigation;
mod out;
mod schedule;
pub mod settings;
mod stations;
mod view;
mod wish;

pub use board::misplaced::{Ear, Lines, Speaker};
pub use config::{BoardProfile, FlightConfig, LimitsConfig, PilotConfig, TagProtocol};
pub use flight::at_rest::{AT_REST, Look, Quantity};
pub use flight::excitation::Doublet;
pub use flight::mission::{MOST_ITEMS, Mission, MissionItem, Volume};
pub use flight::mission_file;
pub use flight::modes::{Event, MISSION_LANDS, Mode, TABLE, Transition, transition};
pub use flight::supervisor::{
    Action, CONDITIONS, Condition, Number, Reaction, SupervisorConfig, Watched,
};
pub use flight::tilt_step::{Envelope, TiltStep, stopping_m};
pub use input::{Input, LinkId, MOST_STATIONS};
pub use navigation::uwb;
pub use out::recording::Recording;
pub use schedule::act::Permit;
pub use schedule::ordered::{ORDERS, Order, Steers};
pub use schedule::said::{SAID, Said};
pub use stations::endpoint::{
    Endpoint, GpsClaim, Identity, MOST_GROUND_LINKS, OriginConfig, Routing,
};
pub use stations::permits::Commanders;
pub use stations::streams::{STREAMS, Stream};
pub use stations::{guard, services};

use core::net::SocketAddr;

use haltere_core::drops::Drops;
use haltere_core::estimate::Estimate;
use haltere_core::estimator::Estimator;
use haltere_core::geo::LocalOrigin;
use haltere_core::measure::Tdoa;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_core::topics::{ControlRecord, Topic};

use board::Board;
use clock::{Calendar, Clock};
use flight::Flight;
use flight::arming::SHADOW_WORDS;
use navigation::Navigation;
use out::Out;
use out::voice::Severity;
use schedule::act::Act;
use schedule::anew;
use stations::Stations;
use view::{Sight, around, view};
use wish::Wish;

/// Times beyond this, 73 000 years, are taken as this: sums with them stay in range.
const LATEST: HostTime = HostTime::from_us(u64::MAX / 8);

/// The state machine.
#[derive(Debug)]
pub struct Pilot {
    config: PilotConfig,
    survey: Survey,
    origin: LocalOrigin,
    /// The estimate of this step, for all who read it.
    estimate: Estimate,
    clock: Clock,
    out: Out,
    navigation: Navigation,
    board: Board,
    flight: Flight,
    stations: Stations,
    /// What the parts want changed in one another; empty but for the moment in which it is granted.
    wishes: Vec<Wish>,
}

impl Pilot {
    /// A core that starts at `at`.
    pub fn new(mut config: PilotConfig, survey: Survey, at: HostTime) -> Self {
        // From here on the volume is a number: parameters show it, and change it.
        config.limits.resolve(&survey);
        let navigation = Navigation::new(&config, &survey, at);
        let stations = Stations::new(&config, at);
        let mut pilot = Self {
            origin: config.origin.in_force(),
            estimate: navigation.estimator.estimate(),
            clock: Clock::new(at),
            out: Out::new(&config, at),
            navigation,
            board: Board::new(&config, at),
            flight: Flight::new(&config, &survey, at),
            stations,
            wishes: Vec::new(),
            config,
            survey,
        };
        pilot.out.say(at, Severity::Info, "haltere started, waiting for tag and board".to_owned());
        if pilot.config.flight.shadow {
            pilot.out.say(at, Severity::Warning, SHADOW_WORDS.to_owned());
        }
        pilot
    }

    /// Switches decoded records off: lockstep runs that nobody reads.
    pub fn without_topics(mut self) -> Self {
        self.out.record_nothing();
        self
    }

    /// Streams to stations off until somebody asks for one: lockstep runs whose station reads answers alone.
    pub fn without_streams(mut self) -> Self {
        for ground in &mut self.stations.grounds {
            ground.streams.silence();
        }
        self
    }

    /// Takes one event in. `at` never runs backwards; if it does, the core's own time goes on.
    pub fn handle(&mut self, at: HostTime, input: Input<'_>) {
        let wakes = matches!(input, Input::Wake);
        let (at, went_back_s) = self.clock.steady.steady(at.min(LATEST), self.clock.now, wakes);
        let at = at.min(LATEST);
        self.clock.now = at;
        if let Some(by_s) = went_back_s {
            self.flight.supervisor.punctuality.host_clock_went_back(by_s);
        }
        match input {
            Input::Bytes { link: link @ LinkId::Tag, bytes } => {
                let view = view!(self, at);
                let resumption = &mut self.flight.resumption;
                let fused = |tdoa: &Tdoa| resumption.uwb(tdoa.valid_at);
                self.navigation.tag_bytes(&view, bytes, &mut self.out, fused);
                self.look_at_line(at, link, bytes);
            }
            Input::Bytes { link: link @ LinkId::Board, bytes } => {
                self.act().board_bytes(at, bytes);
                self.look_at_line(at, link, bytes);
            }
            Input::Bytes { link: LinkId::Ground(n), bytes } => {
                self.act().ground_bytes(at, n, bytes)
            }
            Input::Peer { link: LinkId::Board, address } => self.board.peers.sender(address),
            // Each station has a link of its own, and the tag a line.
            Input::Peer { .. } => {}
            Input::Calendar { unix_us } => {
                self.clock.calendar = Some(Calendar { told_at: at, told_unix_us: unix_us });
            }
            Input::LinkUp { link } => self.act().link_up(at, link),
            Input::LinkDown { link } => self.act().link_down(at, link),
            Input::Backlog { link, is_full } => {
                if let Some(ground) = self.stations.ground_mut(link) {
                    ground.is_full = is_full;
                }
            }
            Input::Lost { link, reason, count } => {
                self.out.glue_lost(at, link, reason, count);
                self.stations.tell_unheard(at, link, reason, &mut self.out);
            }
            Input::File { ticket, result, bytes } => {
                self.act().file_answer(at, ticket, result, bytes)
            }
            Input::Recording { state, why } => self.out.recording_told(at, state, why),
            Input::EndAsked => self.flight.end_asked(at, &mut self.out),
            Input::Wake => self.act().wake(at),
        }
    }

    /// Replay of a log of another build: the vehicle was in the air or on the floor whatever this core would have
    /// done, and its filter must know.
    pub fn set_airborne_as_flown(&mut self, airborne: bool) {
        self.navigation.estimator.set_airborne(airborne);
    }

    /// When the core wants to be woken next.
    pub fn next_deadline(&self) -> HostTime {
        self.clock.steady.outside(self.clock.next_tick)
    }

    /// Yields the bytes to send, in order, and forgets them.
    pub fn drain_output(&mut self, mut send: impl FnMut(LinkId, &[u8])) {
        let is_tag = self.board.link.system_id().is_none() && self.board.lines.board.is_tag();
        self.out.drain(|link, bytes| {
            if !(is_tag && link == LinkId::Board) {
                send(link, bytes);
            }
        });
    }

    /// Yields the decoded records, in order, and forgets them.
    pub fn drain_topics(&mut self, take: impl FnMut(Topic)) {
        self.out.drain_topics(take);
    }

    /// Yields the tasks for the disk, in order, and forgets them.
    pub fn drain_file_requests(&mut self, take: impl FnMut(services::FileRequest)) {
        self.stations.services.desk.drain().for_each(take);
    }

    /// Whether another core may take this one's place.
    pub fn may_begin_anew(&self) -> bool {
        anew::may_begin(&self.sight(self.clock.now), &self.stations)
    }

    /// The configuration as stations have set it, for the core that comes next.
    pub fn settings(&self) -> PilotConfig {
        anew::settings(&self.stations, &self.origin)
    }

    /// The newest estimate.
    pub fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    /// The filter, for who measures it on a recorded flight.
    pub fn estimator(&self) -> &Estimator {
        &self.navigation.estimator
    }

    /// The mission that is in force.
    pub fn mission(&self) -> &Mission {
        &self.flight.mission
    }

    /// Items of the mission in force that are done, and how many it has.
    pub fn mission_progress(&self) -> [u16; 2] {
        let items = u16::try_from(self.flight.mission.items.len()).unwrap_or(u16::MAX);
        [self.flight.guidance.current_item.min(items), items]
    }

    /// Inside of the newest control step.
    pub fn control_record(&self) -> &ControlRecord {
        &self.flight.control
    }

    /// How long after a tilt was asked for the board's attitude shows it, s, where that can be told.
    pub fn response_lag_s(&self) -> Option<f64> {
        self.board.link.response_lag_s()
    }

    /// The mode in force.
    pub fn mode(&self) -> Mode {
        self.flight.mode
    }

    /// What is known of the standing vehicle: each row with what a look at it comes to now.
    pub fn at_rest(&self, at: HostTime) -> impl Iterator<Item = (&'static Quantity, Look)> {
        AT_REST.iter().map(move |row| (row, (row.look)(&self.sight(at))))
    }

    /// Whether the program may end: it was asked to, and nothing flies by it any more.
    pub fn may_end(&self) -> bool {
        self.flight.may_end()
    }

    /// Losses by link number; the last entry is the core itself. What the estimator threw away
    /// counts where it came from: UWB on the tag's link, the rest in the core.
    pub fn drops(&self) -> Vec<Drops> {
        self.out.all_lost(&self.navigation.estimator)
    }

    /// Whether a station has sent a mission, or loaded a program, since the core began: what is recorded then may be
    /// meant for a fit, though nothing flies.
    pub fn was_sent_a_mission(&self) -> bool {
        self.stations.sent_a_mission
    }

    /// Where the board is, if its link has many ends and it was found: nothing is to be sent to others.
    pub fn board_address(&self) -> Option<SocketAddr> {
        self.board.peers.board()
    }

    /// The parts, borrowed for one call.
    fn act(&mut self) -> Act<'_> {
        Act {
            config: &mut self.config,
            survey: &self.survey,
            origin: &mut self.origin,
            estimate: &mut self.estimate,
            clock: &mut self.clock,
            out: &mut self.out,
            navigation: &mut self.navigation,
            board: &mut self.board,
            flight: &mut self.flight,
            stations: &mut self.stations,
            wishes: &mut self.wishes,
        }
    }

    /// All that conditions and the table at rest look at.
    fn sight(&self, at: HostTime) -> Sight<'_> {
        around!(self, at).sight(&self.flight, &self.out)
    }

    fn look_at_line(&mut self, at: HostTime, link: LinkId, bytes: &[u8]) {
        let (last_fused, protocol) = (self.navigation.last_fused, self.config.tag_protocol);
        self.board.look_at_line(at, (link, bytes), last_fused, protocol, &mut self.out);
    }
}
