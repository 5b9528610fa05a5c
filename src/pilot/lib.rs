//! The pilot core: one deterministic state machine, bytes and time in, bytes and next deadline out.
//!
//! It runs the schedule, the estimator, the controller and the modes, and knows no socket, no
//! clock and no thread. Glue calls [`Pilot::handle`] with whatever arrives and with a wake-up at
//! [`Pilot::next_deadline`], then sends what [`Pilot::drain_output`] yields.
//!
//! Begin with `flight/modes`, the table of transitions, `schedule`, the control step and what is due beside it, and
//! `flight/supervisor/list.rs`, what can go wrong and what is then done. Beside them are `input`, all that can
//! happen, `settings` and `config`, what can be configured, and five folders:
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
pub use input::{Input, LinkId};
pub use navigation::uwb;
pub use out::recording::Recording;
pub use stations::endpoint::{
    Endpoint, GpsClaim, Identity, MOST_GROUND_LINKS, MOST_STATIONS, OriginConfig, Routing,
};
pub use stations::permits::Commanders;
pub use stations::{guard, services};

use haltere_dialect::mav_stream::MavSplitter;

use crate::uwb::{MavTag, TdoaEngine};
use haltere_core::control::{Controller, margins};
use haltere_core::drops::Drops;
use haltere_core::estimate::{Estimate, Health};
use haltere_core::estimator::{Estimator, MOST_ANCHORS};
use haltere_core::geo::LocalOrigin;
use haltere_core::measure::{BatterySample, BoardAttitude, ImuSample, ServoOutput, Tdoa};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_core::topics::{ControlRecord, Topic};

use board::link::news::BoardNews;
use board::link::peers::Peers;
use board::link::{BoardLink, LinkConfig};
use clock::Calendar;
use flight::at_rest::BoardDown;
use flight::ending::Ending;
use flight::guidance::Guidance;
use flight::hover::HoverThrust;
use flight::resume::Resumption;
use flight::shadow::Shadow;
use flight::supervise::Touch;
use flight::supervisor::{SteadyClock, Supervisor};
use navigation::carried::Carried;
use navigation::heading::BoardNorth;
use navigation::survey_check::SurveyCheck;
use out::output::{Address, Outbox};
use out::passed_on::PassedOn;
use out::recording;
use out::shelf::Shelf;
use out::voice::{Echoes, Severity};
use stations::commands::Asker;
use stations::ground::GroundLink;
use stations::services::Services;
use stations::telemetry_counts::PairStats;
use stations::unheard;

/// Times beyond this, 73 000 years, are taken as this: sums with them stay in range.
const LATEST: HostTime = HostTime::from_us(u64::MAX / 8);

/// Our own component on ground links: an autopilot (INTERFACES.md section 3).
const OWN_COMPONENT: u8 = 1;

/// The state machine.
#[derive(Debug)]
pub struct Pilot {
    config: PilotConfig,
    /// Who we are on ground links, from the start to the end.
    own: Address,
    survey: Survey,
    now: HostTime,
    next_tick: HostTime,
    last_tick: Option<HostTime>,
    control_steps: u64,
    deadline_misses: u64,

    out: Outbox,
    topics: Vec<Topic>,
    with_topics: bool,
    /// Losses by link number; the last entry is the core itself.
    drops: Vec<Drops>,
    shelf: Shelf,

    uwb: TdoaEngine,
    mav_tag: MavTag,
    tag_splitter: MavSplitter,
    tdoas: Vec<Tdoa>,
    tag_is_up: bool,
    /// When a measurement last came, or the tag was last asked for its stream.
    tag_asked_at: HostTime,
    last_fused: Option<HostTime>,
    last_imu: Option<HostTime>,
    /// The newest sample, for who asks for it.
    imu: Option<ImuSample>,
    baro_at: Option<HostTime>,
    pairs: Vec<PairStats>,

    lines: Lines,
    board: BoardLink,
    board_splitter: MavSplitter,
    board_peers: Peers,
    board_bytes_at: HostTime,
    board_news: Vec<BoardNews>,
    board_attitude: Option<BoardAttitude>,
    board_down: BoardDown,
    /// The newest pressure that is one, Pa.
    pressure_pa: Option<(f64, HostTime)>,
    battery: Option<BatterySample>,
    /// What the board last told motors and servos.
    servos: Option<ServoOutput>,
    north: BoardNorth,

    estimator: Estimator,
    estimate: Estimate,
    /// What people were last told about it, and when.
    health_told: Health,
    health_told_at: HostTime,
    /// Anchors that people were told are left out, by their place in the survey.
    left_out_told: [bool; MOST_ANCHORS],
    /// Height above the floor while the estimate could be trusted, m.
    last_height_m: f64,
    /// Height at which the landing began, m.
    land_from_m: f64,
    /// Sinking speed at that time, m/s.
    last_sink_mps: f64,
    /// Since when the estimate is good again in a blind descent.
    good_since: Option<HostTime>,
    controller: Controller,
    shadow: Shadow,
    /// Why nothing may fly with the gains in force.
    gains_refusal: Option<String>,
    control: ControlRecord,
    hover: HoverThrust,
    guidance: Guidance,
    mission: Mission,

    mode: Mode,
    mode_since: HostTime,
    touch: Touch,
    carried: Carried,
    resumption: Resumption,
    supervisor: Supervisor,
    survey_check: SurveyCheck,
    clock: SteadyClock,
    lift_off_asked: bool,
    /// What was asked for while the board flew by itself: land as soon as control is back.
    land_when_back: bool,
    /// The program was asked to end.
    ending: Option<Ending>,
    askers: Vec<Asker>,
    /// When people were last told that the board does not disarm.
    insisted_at: Option<HostTime>,
    text_id: u16,
    /// Mode and arming that clients were last told at once.
    mode_told: Option<(u32, bool)>,
    /// When people were last told that a station found no place.
    full_told_at: Option<HostTime>,
    /// Whether people were told that nobody reads what the program prints.
    output_lost_told: bool,
    /// What a client last asked for, by number; 0: nothing yet.
    intended_mode: u32,
    /// When people were last told that a setpoint is not followed.
    refused_setpoint_told: Option<HostTime>,
    /// When people were last told that a system may not command.
    refused_told_at: Option<HostTime>,
    /// When people were last told that frames are kept out.
    kept_out_told_at: Option<HostTime>,
    /// Whether it was told that somebody answers from another address: on the board's link, on a station's.
    other_address_told: [bool; 2],
    /// Since when setpoints come that the mode does not follow, and when that was told.
    unobeyed_since: Option<HostTime>,
    unobeyed_told_at: Option<HostTime>,
    unheard_told: unheard::Told,
    passed_on: PassedOn,
    /// How much may still be said to people because of what clients and board say.
    echoes: Echoes,
    /// Whether a client is being answered.
    answering: bool,

    grounds: Vec<GroundLink>,
    origin: LocalOrigin,
    calendar: Option<Calendar>,
    recording: recording::Told,
    sent_a_mission: bool,
    next_health: HostTime,
    services: Services,
}

impl Pilot {
    /// A core that starts at `at`.
    pub fn new(mut config: PilotConfig, survey: Survey, at: HostTime) -> Self {
        // From here on the volume is a number: parameters show it, and change it.
        config.limits.resolve(&survey);
        let envelope = Envelope::of(&config, &survey);
        let estimator = Estimator::new(config.estimator_in_force(), survey.clone());
        let estimate = estimator.estimate();
        let velocity_limit_mps = config.control.limits.horizontal_mps;
        let grounds: Vec<GroundLink> = (0..)
            .zip(config.ground_links())
            .map(|(n, (number, endpoint))| GroundLink::new(LinkId::Ground(n), endpoint, number, at))
            .collect();
        let origin = config.origin.in_force();
        let mut pilot = Self {
            own: Address { system_id: config.system_id, component_id: OWN_COMPONENT },
            now: at,
            next_tick: at.offset_us(schedule::CONTROL_PERIOD_US),
            last_tick: None,
            control_steps: 0,
            deadline_misses: 0,
            out: Outbox::of_shadow(config.flight.shadow),
            topics: Vec::new(),
            with_topics: true,
            drops: vec![Drops::default(); 3 + grounds.len()],
            shelf: Shelf::default(),
            uwb: TdoaEngine::new(config.uwb.clone(), &survey),
            mav_tag: MavTag::new(),
            tag_splitter: MavSplitter::new(),
            tdoas: Vec::new(),
            tag_is_up: false,
            tag_asked_at: at,
            last_fused: None,
            last_imu: None,
            imu: None,
            baro_at: None,
            pairs: Vec::new(),
            lines: Lines::default(),
            board: BoardLink::new(
                LinkConfig {
                    profile: config.board_profile,
                    set_parameters: config.board_set_parameters && !config.flight.shadow,
                    shadow: config.flight.shadow,
                },
                at,
            ),
            board_splitter: MavSplitter::new(),
            board_peers: Peers::default(),
            board_bytes_at: at,
            board_news: Vec::new(),
            board_attitude: None,
            board_down: BoardDown::default(),
            pressure_pa: None,
            battery: None,
            servos: None,
            north: BoardNorth::new(config.board_north_offset_rad),
            estimator,
            estimate,
            health_told: Health::NotAligned,
            health_told_at: at,
            left_out_told: [false; MOST_ANCHORS],
            last_height_m: 0.0,
            land_from_m: 0.0,
            last_sink_mps: 0.0,
            good_since: None,
            controller: Controller::new(config.control.clone()),
            shadow: Shadow::default(),
            gains_refusal: margins::refusal(&config.control),
            control: ControlRecord::default(),
            hover: HoverThrust::default(),
            guidance: Guidance::new(config.flight.clone(), envelope, velocity_limit_mps, at),
            mission: Mission::default(),
            mode: Mode::Disarmed,
            mode_since: at,
            touch: Touch::default(),
            carried: Carried::default(),
            resumption: Resumption::default(),
            supervisor: Supervisor::default(),
            survey_check: SurveyCheck::new(&config, &survey),
            clock: SteadyClock::default(),
            lift_off_asked: false,
            land_when_back: false,
            ending: None,
            askers: Vec::new(),
            insisted_at: None,
            text_id: 0,
            mode_told: None,
            full_told_at: None,
            output_lost_told: false,
            intended_mode: 0,
            refused_setpoint_told: None,
            refused_told_at: None,
            kept_out_told_at: None,
            other_address_told: [false; 2],
            unheard_told: unheard::Told::new(),
            unobeyed_since: None,
            unobeyed_told_at: None,
            passed_on: PassedOn::new(),
            echoes: Echoes::new(at),
            answering: false,
            grounds,
            origin,
            calendar: None,
            recording: recording::Told::default(),
            sent_a_mission: false,
            next_health: at,
            services: Services::new(&config),
            config,
            survey,
        };
        pilot.say(at, Severity::Info, "haltere started, waiting for tag and board".to_owned());
        if pilot.config.flight.shadow {
            pilot.say(at, Severity::Warning, flight::arming::SHADOW_WORDS.to_owned());
        }
        pilot
    }

    /// Switches decoded records off: lockstep runs that nobody reads.
    pub fn without_topics(mut self) -> Self {
        self.with_topics = false;
        self.topics.clear();
        self
    }

    /// Streams to stations off until somebody asks for one: lockstep runs whose station reads answers alone.
    pub fn without_streams(mut self) -> Self {
        for ground in &mut self.grounds {
            ground.streams.silence();
        }
        self
    }

    /// Takes one event in. `at` never runs backwards; if it does, the core's own time goes on.
    pub fn handle(&mut self, at: HostTime, input: Input<'_>) {
        let wakes = matches!(input, Input::Wake);
        let (at, went_back_s) = self.clock.steady(at.min(LATEST), self.now, wakes);
        let at = at.min(LATEST);
        self.now = at;
        if let Some(by_s) = went_back_s {
            self.supervisor.punctuality.host_clock_went_back(by_s);
        }
        match input {
            Input::Bytes { link: link @ LinkId::Tag, bytes } => {
                self.tag_bytes(at, bytes);
                self.look_at_line(at, link, bytes);
            }
            Input::Bytes { link: link @ LinkId::Board, bytes } => {
                self.board_bytes(at, bytes);
                self.look_at_line(at, link, bytes);
            }
            Input::Bytes { link: LinkId::Ground(n), bytes } => self.ground_bytes(at, n, bytes),
            Input::Peer { link: LinkId::Board, address } => self.board_peers.sender(address),
            // Each station has a link of its own, and the tag a line.
            Input::Peer { .. } => {}
            Input::Calendar { unix_us } => {
                self.calendar = Some(Calendar { told_at: at, told_unix_us: unix_us });
            }
            Input::LinkUp { link } => self.link_up(at, link),
            Input::LinkDown { link } => self.link_down(at, link),
            Input::Backlog { link, is_full } => {
                if let Some(ground) = self.ground_mut(link) {
                    ground.is_full = is_full;
                }
            }
            Input::Lost { link, reason, count } => self.glue_lost(at, link, reason, count),
            Input::File { ticket, result, bytes } => self.file_answer(at, ticket, result, bytes),
            Input::Recording { state, why } => self.recording_told(at, state, why),
            Input::EndAsked => self.end_asked(at),
            Input::Wake => self.wake(at),
        }
    }

    /// Replay of a log of another build: the vehicle was in the air or on the floor whatever this core would have
    /// done, and its filter must know.
    pub fn set_airborne_as_flown(&mut self, airborne: bool) {
        self.estimator.set_airborne(airborne);
    }

    /// When the core wants to be woken next.
    pub fn next_deadline(&self) -> HostTime {
        self.clock.outside(self.next_tick)
    }

    /// Yields the bytes to send, in order, and forgets them.
    pub fn drain_output(&mut self, mut send: impl FnMut(LinkId, &[u8])) {
        let is_tag = self.board.system_id().is_none() && self.lines.board.is_tag();
        self.out.drain(|link, bytes| {
            if !(is_tag && link == LinkId::Board) {
                send(link, bytes);
            }
        });
    }

    /// Yields the decoded records, in order, and forgets them.
    pub fn drain_topics(&mut self, take: impl FnMut(Topic)) {
        self.topics.drain(..).for_each(take);
    }

    /// The newest estimate.
    pub fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    /// The filter, for who measures it on a recorded flight.
    pub fn estimator(&self) -> &Estimator {
        &self.estimator
    }

    /// The mission that is in force.
    pub fn mission(&self) -> &Mission {
        &self.mission
    }

    /// Items of the mission in force that are done, and how many it has.
    pub fn mission_progress(&self) -> [u16; 2] {
        let items = u16::try_from(self.mission.items.len()).unwrap_or(u16::MAX);
        [self.guidance.current_item.min(items), items]
    }

    /// Inside of the newest control step.
    pub fn control_record(&self) -> &ControlRecord {
        &self.control
    }

    /// How long after a tilt was asked for the board's attitude shows it, s, where that can be told.
    pub fn response_lag_s(&self) -> Option<f64> {
        self.board.response_lag_s()
    }

    /// The mode in force.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    fn ground_mut(&mut self, link: LinkId) -> Option<&mut GroundLink> {
        let LinkId::Ground(n) = link else { return None };
        self.grounds.get_mut(usize::from(n))
    }

    fn endpoint_on(&self, link: LinkId) -> Endpoint {
        let LinkId::Ground(n) = link else { return Endpoint::default() };
        self.grounds.get(usize::from(n)).map_or_else(Endpoint::default, |g| g.endpoint)
    }

    fn identity_on(&self, link: LinkId) -> Identity {
        self.endpoint_on(link).identity
    }

    /// `make` runs only when somebody reads the records.
    fn record(&mut self, make: impl FnOnce() -> Topic) {
        if self.with_topics {
            self.topics.push(make());
        }
    }
}
