//! The pilot core: one deterministic state machine, bytes and time in, bytes and next deadline out.
//!
//! It runs the schedule, the estimator, the controller and the modes, and knows no socket, no
//! clock and no thread. Glue calls [`Pilot::handle`] with whatever arrives and with a wake-up at
//! [`Pilot::next_deadline`], then sends what [`Pilot::drain_output`] yields.
//!
//! One idea per file: `schedule` the control step and what is due beside it, `supervisor` what
//! can go wrong and what is then done, `supervise` how a flight ends, `modes` the table of transitions, `guidance` what the controller is asked for,
//! `board` and `ground` the links, `commands` and `telemetry` what clients say and see, `services`
//! what they fetch and store: parameters, plans, files and logs.

// The definitions call some messages superseded; today's clients still send and expect them.
#![allow(deprecated)]

mod arming;
mod board;
mod calendar;
mod clients;
mod commands;
mod config;
mod endpoint;
mod excitation;
mod ground;
mod guidance;
mod heading;
mod home;
mod hover;
mod identity;
mod ingest;
mod magnetics;
mod manual;
mod mission;
mod mission_items;
mod mission_transfer;
mod modes;
mod orders;
mod output;
mod permits;
mod place;
mod reference;
mod routing;
mod schedule;
pub mod services;
mod setpoint;
mod shelf;
mod streams;
mod supervise;
mod supervisor;
mod survey_check;
mod telemetry;
mod telemetry_counts;
mod telemetry_estimator;
mod telemetry_global;
mod tilt_step;

pub use arming::Check as ArmingCheck;
pub use config::{BoardProfile, FlightConfig, LimitsConfig, PilotConfig, TagProtocol};
pub use endpoint::{
    Endpoint, GpsClaim, Identity, MOST_GROUND_LINKS, MOST_STATIONS, OriginConfig, Routing,
};
pub use excitation::Doublet;
pub use mission::{MOST_ITEMS, Mission, MissionItem, Volume};
pub use modes::{Event, MISSION_LANDS, Mode, TABLE, Transition, transition};
pub use permits::Commanders;
pub use supervisor::{Action, CONDITIONS, Condition, Number, Reaction, SupervisorConfig, Watched};
pub use tilt_step::{Envelope, TiltStep, stopping_m};

use haltere_dialect::mav_stream::MavSplitter;

use crate::control::Controller;
use crate::drops::{DropReason, Drops};
use crate::estimate::{Estimate, Health};
use crate::estimator::Estimator;
use crate::geo::LocalOrigin;
use crate::measure::{BatterySample, BoardAttitude, Tdoa};
use crate::survey::Survey;
use crate::time::HostTime;
use crate::topics::{ControlRecord, ModeRecord, TextRecord, Topic};
use crate::uwb::{MavTag, TdoaEngine};

use board::{BoardLink, BoardNews, LinkConfig};
use calendar::Calendar;
use commands::Asker;
use ground::GroundLink;
use guidance::Guidance;
use heading::BoardNorth;
use hover::HoverThrust;
use output::{Address, Outbox};
use services::{FileFault, Services};
use shelf::Shelf;
use supervise::Touch;
use supervisor::{Descent, SteadyClock, Supervisor};
use survey_check::SurveyCheck;
use telemetry_counts::PairStats;

/// Name of a link to the outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LinkId {
    /// The UWB tag.
    Tag,
    /// The inner-loop board.
    Board,
    /// A station, in the order of [`PilotConfig::ground_links`].
    Ground(u8),
}

impl LinkId {
    /// Number in logs and messages: 0 tag, 1 board, 2 and up stations.
    pub fn number(self) -> u8 {
        match self {
            LinkId::Tag => 0,
            LinkId::Board => 1,
            LinkId::Ground(n) => n.saturating_add(2),
        }
    }

    /// The link with this number.
    pub fn from_number(number: u8) -> Self {
        match number {
            0 => LinkId::Tag,
            1 => LinkId::Board,
            n => LinkId::Ground(n - 2),
        }
    }
}

/// What can happen to the core.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Input<'a> {
    /// Bytes came in. The time of the call is when they were read.
    Bytes {
        /// From where.
        link: LinkId,
        /// In any chunking.
        bytes: &'a [u8],
    },
    /// A link was opened, or opened again.
    LinkUp {
        /// Which.
        link: LinkId,
    },
    /// A link was lost.
    LinkDown {
        /// Which.
        link: LinkId,
    },
    /// The glue had to throw something away.
    Lost {
        /// On which link.
        link: LinkId,
        /// Why.
        reason: DropReason,
        /// How many bytes, frames or records.
        count: u64,
    },
    /// Glue has done, or failed to do, what a [`services::FileRequest`] asked for.
    File {
        /// The request's ticket.
        ticket: u32,
        /// Whether it was done.
        result: Result<(), FileFault>,
        /// What was asked for, or what is wrong.
        bytes: &'a [u8],
    },
    /// What the calendar says.
    Calendar {
        /// Since 1970-01-01 UTC, µs.
        unix_us: i64,
    },
    /// The deadline came, or something wants the core to look at the time.
    Wake,
}

/// Every check before a flight, in its order.
pub const ARMING_CHECKS: [ArmingCheck; 8] = ArmingCheck::ALL;

/// Times beyond this, 73 000 years, are taken as this: sums with them stay in range.
const LATEST: HostTime = HostTime::from_us(u64::MAX / 8);

/// People are told again that a station found no place after this time, s.
const FULL_TELL_S: f64 = 10.0;

/// People are told again that frames are kept out after this time, s.
const KEPT_OUT_TELL_S: f64 = 10.0;

/// Our own address on ground links (INTERFACES.md section 3).
const OWN: Address = Address { system_id: 1, component_id: 1 };

/// The state machine.
#[derive(Debug)]
pub struct Pilot {
    config: PilotConfig,
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
    baro_at: Option<HostTime>,
    pairs: Vec<PairStats>,

    board: BoardLink,
    board_splitter: MavSplitter,
    board_bytes_at: HostTime,
    board_news: Vec<BoardNews>,
    board_attitude: Option<BoardAttitude>,
    battery: Option<BatterySample>,
    north: BoardNorth,

    estimator: Estimator,
    estimate: Estimate,
    /// What people were last told about it, and when.
    health_told: Health,
    health_told_at: HostTime,
    /// Height above the floor while the estimate could be trusted, m.
    last_height_m: f64,
    /// Height at which the landing began, m.
    land_from_m: f64,
    /// Sinking speed at that time, m/s.
    last_sink_mps: f64,
    /// Since when the estimate is good again in a blind descent.
    good_since: Option<HostTime>,
    controller: Controller,
    control: ControlRecord,
    hover: HoverThrust,
    guidance: Guidance,
    mission: Mission,

    mode: Mode,
    mode_since: HostTime,
    touch: Touch,
    supervisor: Supervisor,
    survey_check: SurveyCheck,
    clock: SteadyClock,
    lift_off_asked: bool,
    /// What was asked for while the board flew by itself: land as soon as control is back.
    land_when_back: bool,
    arm_askers: Vec<Asker>,
    /// When people were last told that the board does not disarm.
    insisted_at: Option<HostTime>,
    text_id: u16,
    /// Mode and arming that clients were last told at once.
    mode_told: Option<(u32, bool)>,
    /// When people were last told that a station found no place.
    full_told_at: Option<HostTime>,
    /// What a client last asked for, by number; 0: nothing yet.
    intended_mode: u32,
    refused_setpoint_told: bool,
    /// When people were last told that a system may not command.
    refused_told_at: Option<HostTime>,
    /// When people were last told that frames are kept out.
    kept_out_told_at: Option<HostTime>,
    /// How much may still be said to people because of what clients and board say.
    echoes: Echoes,
    /// Whether a client is being answered.
    answering: bool,

    grounds: Vec<GroundLink>,
    origin: LocalOrigin,
    calendar: Option<Calendar>,
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
            now: at,
            next_tick: at.offset_us(schedule::CONTROL_PERIOD_US),
            last_tick: None,
            control_steps: 0,
            deadline_misses: 0,
            out: Outbox::default(),
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
            baro_at: None,
            pairs: Vec::new(),
            board: BoardLink::new(
                LinkConfig {
                    profile: config.board_profile,
                    set_parameters: config.board_set_parameters,
                },
                at,
            ),
            board_splitter: MavSplitter::new(),
            board_bytes_at: at,
            board_news: Vec::new(),
            board_attitude: None,
            battery: None,
            north: BoardNorth::new(config.board_north_offset_rad),
            estimator,
            estimate,
            health_told: Health::NotAligned,
            health_told_at: at,
            last_height_m: 0.0,
            land_from_m: 0.0,
            last_sink_mps: 0.0,
            good_since: None,
            controller: Controller::new(config.control.clone()),
            control: ControlRecord::default(),
            hover: HoverThrust::default(),
            guidance: Guidance::new(config.flight.clone(), envelope, velocity_limit_mps, at),
            mission: Mission::default(),
            mode: Mode::Disarmed,
            mode_since: at,
            touch: Touch::default(),
            supervisor: Supervisor::default(),
            survey_check: SurveyCheck::new(&config, &survey),
            clock: SteadyClock::default(),
            lift_off_asked: false,
            land_when_back: false,
            arm_askers: Vec::new(),
            insisted_at: None,
            text_id: 0,
            mode_told: None,
            full_told_at: None,
            intended_mode: 0,
            refused_setpoint_told: false,
            refused_told_at: None,
            kept_out_told_at: None,
            echoes: Echoes::new(at),
            answering: false,
            grounds,
            origin,
            calendar: None,
            next_health: at,
            services: Services::new(&config),
            config,
            survey,
        };
        pilot.say(at, Severity::Info, "haltere started, waiting for tag and board".to_owned());
        pilot
    }

    /// Switches decoded records off: lockstep runs that nobody reads.
    pub fn without_topics(mut self) -> Self {
        self.with_topics = false;
        self.topics.clear();
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
            Input::Bytes { link: LinkId::Tag, bytes } => self.tag_bytes(at, bytes),
            Input::Bytes { link: LinkId::Board, bytes } => self.board_bytes(at, bytes),
            Input::Bytes { link: LinkId::Ground(n), bytes } => self.ground_bytes(at, n, bytes),
            Input::Calendar { unix_us } => {
                self.calendar = Some(Calendar { told_at: at, told_unix_us: unix_us });
            }
            Input::LinkUp { link } => self.link_up(at, link),
            Input::LinkDown { link } => self.link_down(at, link),
            Input::Lost { link, reason, count } => self.glue_lost(at, link, reason, count),
            Input::File { ticket, result, bytes } => self.file_answer(at, ticket, result, bytes),
            Input::Wake => self.wake(at),
        }
    }

    /// When the core wants to be woken next.
    pub fn next_deadline(&self) -> HostTime {
        self.clock.outside(self.next_tick)
    }

    /// Yields the bytes to send, in order, and forgets them.
    pub fn drain_output(&mut self, send: impl FnMut(LinkId, &[u8])) {
        self.out.drain(send);
    }

    /// Yields the decoded records, in order, and forgets them.
    pub fn drain_topics(&mut self, take: impl FnMut(Topic)) {
        self.topics.drain(..).for_each(take);
    }

    /// The newest estimate.
    pub fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    /// The mission that is in force.
    pub fn mission(&self) -> &Mission {
        &self.mission
    }

    /// Inside of the newest control step.
    pub fn control_record(&self) -> &ControlRecord {
        &self.control
    }

    /// The mode in force.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Losses by link number; the last entry is the core itself. What the estimator threw away
    /// counts where it came from: UWB on the tag's link, the rest in the core.
    pub fn drops(&self) -> Vec<Drops> {
        let slots = 0..self.drops.len();
        slots.map(|slot| losses_of(&self.drops, &self.estimator, slot)).collect()
    }

    /// The same as one number.
    fn lost(&self, slot: usize, reason: DropReason) -> u64 {
        let own = self.drops[slot].count(reason);
        if slot != slot_of_estimator(reason, self.drops.len()) {
            return own;
        }
        own.saturating_add(self.estimator.drops().count(reason))
    }

    fn drops_of(&mut self, link: LinkId) -> &mut Drops {
        let core = self.drops.len() - 1;
        let slot = usize::from(link.number()).min(core);
        &mut self.drops[slot]
    }

    fn glue_lost(&mut self, at: HostTime, link: LinkId, reason: DropReason, count: u64) {
        self.drops_of(link).add(reason, count);
        let told = self.full_told_at.is_some_and(|t| at.seconds_since(t) < FULL_TELL_S);
        if reason == DropReason::StationsFull && !told {
            self.full_told_at = Some(at);
            let number = self.ground_mut(link).map_or(0, |g| g.endpoint_number);
            let text = format!(
                "a station found no place: ground.endpoints[{number}] holds {MOST_STATIONS}; end one, \
                 or add an endpoint"
            );
            self.say(at, Severity::Warning, text);
        }
        self.tell_kept_out(at, link, reason);
    }

    /// Somebody who means well would wait for ever otherwise.
    fn tell_kept_out(&mut self, at: HostTime, link: LinkId, reason: DropReason) {
        let what = match reason {
            DropReason::MavUnsigned => "unsigned frames are kept out: give the station the key",
            DropReason::MavBadSignature => "frames with another key are kept out",
            DropReason::MavReplayed => "signed frames that come twice or late are kept out",
            DropReason::MavStaleTime => {
                "frames signed over a minute ago are kept out: set the station's clock"
            }
            DropReason::SigningSetup => "a new signing key was refused: signing.setup",
            DropReason::RateLimited => "a station sends more than ground.most_frames_per_s allows",
            _ => return,
        };
        if self.kept_out_told_at.is_none_or(|t| at.seconds_since(t) > KEPT_OUT_TELL_S) {
            self.kept_out_told_at = Some(at);
            self.say(at, Severity::Warning, format!("link {}: {what}", link.number()));
        }
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

    /// Lets an event change the mode. `false`: there is no row for it.
    fn fire(&mut self, at: HostTime, event: Event) -> bool {
        self.fire_because(at, event, None)
    }

    /// The same for a reason that is not the row's.
    fn fire_because(&mut self, at: HostTime, event: Event, cause: Option<Cause>) -> bool {
        let Some(row) = transition(self.mode, event) else { return false };
        let from = self.mode;
        let cause = cause.unwrap_or_else(|| Cause::of_row(from, event, row.because));
        self.mode = row.to;
        self.mode_since = at;
        self.touch = self.touch.restarted();
        self.good_since = None;
        self.guidance.enter(row.to, &self.estimate, at);
        match row.to {
            Mode::Spool => {
                self.supervisor.begin_flight(at);
                self.controller.reset(None);
                self.estimator.set_airborne(true);
                self.lift_off_asked = false;
            }
            Mode::Disarming => {
                // With thrust on, a board may refuse the plain order even on the floor.
                let force = from.has_thrust() && event != Event::TouchDown;
                self.board.command_arm(false, force, at);
                self.insisted_at = None;
                self.call_off_lift_off();
            }
            Mode::Yielded => {
                self.land_when_back = false;
                // What the integrators learn while nobody listens is wrong.
                self.controller.reset(None);
            }
            Mode::Hold if from == Mode::Yielded => self.take_over_level(),
            Mode::Descend => {
                // Height and speed as they were while they could be trusted.
                let height_m = self.height_to_descend_from_m();
                let sink_mps = if self.imu_is_alive(at) { self.last_sink_mps } else { 0.0 };
                self.supervisor.descent = Descent::begin(height_m, sink_mps);
                self.supervisor.descents += 1;
            }
            Mode::Land => self.land_from_m = self.height_above_floor_m().max(0.0),
            Mode::Disarmed => {
                self.supervisor.end_flight();
                self.estimator.set_airborne(false);
                self.call_off_lift_off();
                if event == Event::ArmFailed {
                    // It may still arm on an order that is under way.
                    self.board.command_arm(false, false, at);
                }
            }
            _ => {}
        }
        let armed = self.board.is_armed();
        self.record(|| {
            Topic::Mode(ModeRecord {
                at,
                mode: row.to.name(),
                armed,
                cause: cause.because.to_owned(),
            })
        });
        self.tell_transition(at, from, row.to, cause);
        true
    }

    fn call_off_lift_off(&mut self) {
        self.lift_off_asked = false;
        self.guidance.mission_waits = false;
    }

    /// The mode that clients are shown. On the floor one that waits for arming is shown as if it
    /// were in force: clients that asked for it give up when it does not appear (GROUND.md).
    fn shown_mode(&self) -> Mode {
        match self.mode {
            Mode::Disarmed | Mode::Arming | Mode::Idle if self.guidance.mission_waits => {
                Mode::Mission
            }
            Mode::Disarmed | Mode::Arming | Mode::Idle if self.lift_off_asked => Mode::Takeoff,
            Mode::Spool | Mode::Takeoff if self.guidance.mission_waits => Mode::Mission,
            mode => mode,
        }
    }

    /// Tells the people at one station, and the log.
    fn say_to(&mut self, at: HostTime, link: LinkId, severity: Severity, text: &str) {
        self.text_id = self.text_id.wrapping_add(1).max(1);
        telemetry::send_text(&mut self.out, link, severity as u8, text, self.text_id);
        let text = text.to_owned();
        self.record(|| Topic::Text(TextRecord { at, severity: severity as u8, text }));
    }

    /// Whether one more text may be said that others have caused. If not, that is counted.
    fn may_echo(&mut self, at: HostTime) -> bool {
        let may = self.echoes.take(at);
        if !may {
            let core = self.drops.len() - 1;
            self.drops[core].add(DropReason::TextLimited, 1);
        }
        may
    }

    /// Tells people: to every station and into the log.
    fn say(&mut self, at: HostTime, severity: Severity, text: String) {
        if self.answering && severity == Severity::Warning && !self.may_echo(at) {
            return;
        }
        self.text_id = self.text_id.wrapping_add(1).max(1);
        for ground in self.grounds.iter().filter(|g| g.is_open) {
            telemetry::send_text(&mut self.out, ground.link, severity as u8, &text, self.text_id);
        }
        self.record(|| Topic::Text(TextRecord { at, severity: severity as u8, text }));
    }
}

/// Why a mode changed: the words, how grave it is, and the number for events.
#[derive(Debug, Clone, Copy)]
struct Cause {
    because: &'static str,
    severity: Severity,
    number: u8,
}

impl Cause {
    fn of_row(from: Mode, event: Event, because: &'static str) -> Self {
        let severity = match event {
            Event::NotLifted | Event::SetpointsIgnored => Severity::Error,
            _ => Severity::Info,
        };
        Self { because, severity, number: services::cause_number(from, event) }
    }
}

/// Words that others cause, such as those about a refusal: a client that asks a thousand times a second
/// must not fill every station's line and the log with them. What the vehicle says by itself is not held
/// back.
#[derive(Debug)]
struct Echoes {
    left: f64,
    at: HostTime,
}

impl Echoes {
    /// Texts at once, and in a second.
    const MOST: f64 = 30.0;
    const PER_S: f64 = 5.0;

    fn new(at: HostTime) -> Self {
        Self { left: Self::MOST, at }
    }

    fn take(&mut self, at: HostTime) -> bool {
        let filled = at.seconds_since(self.at).max(0.0) * Self::PER_S;
        self.left = (self.left + filled).min(Self::MOST);
        self.at = at;
        let some = self.left >= 1.0;
        if some {
            self.left -= 1.0;
        }
        some
    }
}

/// MAVLink severities in use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum Severity {
    Emergency = 0,
    Critical = 2,
    Error = 3,
    Warning = 4,
    Info = 6,
}

/// Of which slot the estimator's losses of a kind are counted.
fn slot_of_estimator(reason: DropReason, slots: usize) -> usize {
    match reason {
        DropReason::UwbUnknownAnchor
        | DropReason::UwbImpossible
        | DropReason::UwbGated
        | DropReason::UwbTooOld => usize::from(LinkId::Tag.number()),
        _ => slots - 1,
    }
}

/// Losses of a slot, those of the estimator included.
fn losses_of(drops: &[Drops], estimator: &Estimator, slot: usize) -> Drops {
    let mut all = drops.get(slot).cloned().unwrap_or_default();
    for (reason, n) in estimator.drops().iter() {
        if slot_of_estimator(reason, drops.len()) == slot {
            all.add(reason, n);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Vec3;
    use crate::measure::AnchorId;

    #[test]
    fn regress_losses_of_the_estimator_are_reported() {
        let corner = |i: u8| {
            let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
        };
        let survey = Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        let at = HostTime::from_us(1_000_000);
        let mut pilot = Pilot::new(PilotConfig::default(), survey, at);
        pilot.estimator.set_initial_heading(f64::NAN, 0.1);
        let core = pilot.drops().len() - 1;
        assert_eq!(pilot.drops()[core].count(DropReason::BadValue), 1);
        assert_eq!(pilot.lost(core, DropReason::BadValue), 1);
        let mut told = None;
        pilot.handle(at.offset_us(20_000), Input::Wake);
        pilot.drain_topics(|topic| {
            if let Topic::Health(record) = topic {
                told = record.drops.iter().find(|(n, _)| *n == u8::MAX).map(|(_, d)| d.clone());
            }
        });
        assert_eq!(told.map(|d| d.count(DropReason::BadValue)), Some(1));
    }
}
