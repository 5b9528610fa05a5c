//! The ground station itself: follows what the vehicle tells, sends commands until answered.

use std::io::ErrorKind;
use std::net::SocketAddr;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use haltere_dialect::mav::haltere::{
    HEARTBEAT_DATA, MavAutopilot, MavCmd, MavFrame, MavMessage, MavModeFlag, MavResult, MavState,
    MavType, PositionTargetTypemask as Mask, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use haltere_dialect::mav::{LOCAL_PER_M, command_int, command_long, known};
use haltere_dialect::mav_stream::{MavSplitter, encode};
use haltere_dialect::signing::SigningKey;

use haltere_pilot::guard::{KeyRing, Standing};
use haltere_pilot::settings::Address;

use super::CtlError;
use super::callers::{AUTOPILOT, Caller, Callers, OWN_SYSTEM, Wanted};
use super::guests::Guests;
use super::link::{Link, READ_BYTES};
use super::named;
use super::vehicle::{LandedState, Vehicle};

const OWN_COMPONENT: u8 = 190;
/// Components of guests, one of those that are anybody's (MAV_COMP_ID_USER1 on): the vehicle counts the frames of each.
const GUEST_COMPONENTS: std::ops::Range<u8> = 25..100;

/// Two vehicles at one address have both been heard by so long after the first heartbeat: each has one a second.
const LOOK_AROUND: Duration = Duration::from_millis(1500);
/// How often it is looked who was heard.
const LOOK: Duration = Duration::from_millis(20);
/// Senders whose streams are kept apart while it is not clear yet who is meant.
const MOST_STREAMS: usize = 16;
/// Wait for the first heartbeat, which comes once a second.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(10);
/// Wait for anything at all of who only wants to know: a vehicle on this computer has said a lot by then, and one behind a
/// radio its heartbeat.
const SILENCE: Duration = Duration::from_secs(2);
/// A vehicle that says nothing at all for so long is gone: it has a heartbeat a second, a radio loses some of them.
const GONE: Duration = Duration::from_secs(5);
/// A guest that hears nothing for so long looks whether the port has become free: streams come many times a second.
const PORT_LEFT: Duration = Duration::from_millis(300);
/// Our own heartbeat: several a second, because a vehicle that flies on simulated time faster than real counts
/// its own seconds without one.
const HEARTBEAT_PERIOD: Duration = Duration::from_millis(200);
/// Wait for the answer to a command, and times it is sent (STATIONS.md: QGroundControl's 3 times).
const ACK_TIMEOUT: Duration = Duration::from_millis(1200);
const ACK_TRIES: u32 = 3;
/// A command in progress may take this long in all.
const PROGRESS_TIMEOUT: Duration = Duration::from_secs(20);
/// Words about a refusal may come shortly after it.
const TEXT_DELAY: Duration = Duration::from_millis(300);
/// Texts kept.
const MOST_TEXTS: usize = 50;
/// Characters of a full STATUSTEXT.
const CHUNK: usize = 50;

/// Vehicle counts as having reached a height or a point, m.
const HEIGHT_REACHED_M: f64 = 0.25;
const POINT_REACHED_M: f64 = 0.30;
/// Slowest progress that is worth waiting for, m/s, and time on top, s.
const SLOWEST_MPS: f64 = 0.15;
const SLACK_S: f64 = 15.0;

/// Modes that a client can ask for, in PX4's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Take off.
    Takeoff,
    /// Stay.
    Hold,
    /// Fly the mission.
    Mission,
    /// Come back.
    Return,
    /// Land.
    Land,
    /// Follow setpoints.
    Offboard,
}

impl Mode {
    /// Main and sub mode.
    fn numbers(self) -> (u8, u8) {
        match self {
            Mode::Takeoff => (4, 2),
            Mode::Hold => (4, 3),
            Mode::Mission => (4, 4),
            Mode::Return => (4, 5),
            Mode::Land => (4, 6),
            Mode::Offboard => (6, 0),
        }
    }

    /// As it stands in HEARTBEAT.
    pub fn custom_mode(self) -> u32 {
        let (main, sub) = self.numbers();
        u32::from(main) << 16 | u32::from(sub) << 24
    }
}

/// What a client wants followed, local NED.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Setpoint {
    /// Position, m.
    Position([f64; 3]),
    /// Velocity, m/s.
    Velocity([f64; 3]),
}

/// A connection to one vehicle.
#[derive(Debug)]
pub struct GroundStation {
    address: String,
    link: Link,
    /// By sender: pieces of two streams would damage each other.
    streams: Vec<(Option<SocketAddr>, MavSplitter)>,
    callers: Callers,
    /// The vehicle that we speak to.
    chosen: Option<Caller>,
    /// When it was last heard.
    heard: Instant,
    guests: Guests,
    /// Ours.
    component: u8,
    sequence: u8,
    started: Instant,
    heartbeat_due: Instant,
    vehicle: Vehicle,
    texts: Vec<String>,
    text: String,
    buffer: Box<[u8; READ_BYTES]>,
    /// With a key: what we send is signed, and what is signed otherwise is not the vehicle's.
    ring: KeyRing,
}

impl GroundStation {
    /// Opens the link and waits for a vehicle's heartbeat. The first one is the vehicle: for those who know that
    /// there is one.
    pub fn connect(address: &str) -> Result<Self, CtlError> {
        Self::connect_within(address, HEARTBEAT_TIMEOUT)
    }

    /// As [`connect`](Self::connect), with a wait of its own.
    pub fn connect_within(address: &str, timeout: Duration) -> Result<Self, CtlError> {
        let mut station = Self::open(address, KeyRing::default())?;
        station.choose(&Wanted::default(), [timeout; 2], Duration::ZERO)?;
        Ok(station)
    }

    /// Opens the link, signing where there is a key, and finds the vehicle that is wanted; refuses to choose
    /// between two. Whoever is `brief` gives up soon where nothing at all is heard.
    pub fn find(
        address: &str,
        key: Option<SigningKey>,
        wanted: &Wanted,
        brief: bool,
    ) -> Result<Self, CtlError> {
        let mut station = Self::open(address, KeyRing::new(key, 0))?;
        let silence = if brief { SILENCE } else { HEARTBEAT_TIMEOUT };
        station.choose(wanted, [silence, HEARTBEAT_TIMEOUT], LOOK_AROUND)?;
        Ok(station)
    }

    fn open(address: &str, ring: KeyRing) -> Result<Self, CtlError> {
        let now = Instant::now();
        let link = Link::open(address)?;
        let guest =
            GUEST_COMPONENTS.start + std::process::id() as u8 % GUEST_COMPONENTS.len() as u8;
        Ok(Self {
            address: address.to_string(),
            component: if link.is_guest() { guest } else { OWN_COMPONENT },
            link,
            streams: Vec::new(),
            callers: Callers::default(),
            chosen: None,
            heard: now,
            guests: Guests::default(),
            sequence: 0,
            started: now,
            heartbeat_due: now,
            vehicle: Vehicle::default(),
            texts: Vec::new(),
            text: String::new(),
            buffer: Box::new([0; READ_BYTES]),
            ring,
        })
    }

    /// Until the vehicle that is wanted was heard, and for `look_around` whether there is another one. Waits for it, and
    /// before for anything at all, so long.
    fn choose(
        &mut self,
        wanted: &Wanted,
        [silence, timeout]: [Duration; 2],
        look_around: Duration,
    ) -> Result<(), CtlError> {
        let began = Instant::now();
        let (mut deadline, mut heard) = (began + timeout, false);
        loop {
            // Who has our port passes on at once, or never.
            let silence = if self.link.is_guest() { SILENCE.min(silence) } else { silence };
            let patience = if self.streams.is_empty() { silence } else { timeout };
            let fitting = self.callers.fitting(wanted);
            if let Some(first) = fitting.first() {
                if !std::mem::replace(&mut heard, true) {
                    deadline = Instant::now() + look_around;
                }
                if Instant::now() >= deadline {
                    if fitting.len() > 1 && !look_around.is_zero() {
                        let vehicles = fitting.iter().map(named).collect();
                        return Err(CtlError::Several { address: self.address.clone(), vehicles });
                    }
                    self.chosen = Some(*first);
                    self.heard = Instant::now();
                    self.vehicle = self.callers.vehicle(first);
                    if let Some(from) = first.from {
                        self.link.speak_to(from);
                    }
                    return Ok(());
                }
            } else if began.elapsed() >= patience {
                let unheard = self.link.is_guest() && self.streams.is_empty();
                if let (true, Ok(Address::UdpIn(at))) = (unheard, self.address.parse()) {
                    return Err(CtlError::Listen { at, why: ErrorKind::AddrInUse.into() });
                }
                let others = self.callers.fitting(&Wanted::default()).iter().map(named).collect();
                return Err(CtlError::NoHeartbeat {
                    address: self.address.clone(),
                    wanted: *wanted,
                    waited: patience,
                    others,
                });
            }
            self.next_message(deadline.min(Instant::now() + LOOK))?;
        }
    }

    /// The vehicle that we speak to.
    pub fn chosen(&self) -> Option<Caller> {
        self.chosen
    }

    /// Vehicles beside ours that were heard at this address; none of them is listened to.
    pub fn others(&self) -> Vec<Caller> {
        let mut all = self.callers.fitting(&Wanted::default());
        all.retain(|caller| self.chosen.is_some_and(|chosen| !chosen.is_same(caller)));
        all
    }

    /// What the vehicle has told so far.
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// Texts since the last call, oldest first.
    pub fn take_texts(&mut self) -> Vec<String> {
        std::mem::take(&mut self.texts)
    }

    /// System and component of the vehicle.
    pub fn target(&self) -> (u8, u8) {
        (self.chosen.map_or(0, |chosen| chosen.system), AUTOPILOT)
    }

    pub(super) fn forget_texts(&mut self) {
        self.texts.clear();
    }

    pub(super) fn texts_after_refusal(&mut self) -> Result<Vec<String>, CtlError> {
        self.listen(TEXT_DELAY)?;
        Ok(self.take_texts())
    }

    /// Sends one message.
    pub fn send(&mut self, message: &MavMessage) -> Result<(), CtlError> {
        let mut bytes = Vec::with_capacity(64);
        encode(&mut bytes, OWN_SYSTEM, self.component, self.sequence, message);
        self.sequence = self.sequence.wrapping_add(1);
        // Two of us at once are two streams.
        let stream = std::process::id() as u8;
        let signed = self.ring.sign(&bytes, stream, unix_us());
        self.link
            .send(signed.as_deref().unwrap_or(&bytes))
            .map_err(|error| CtlError::Io { address: self.address.clone(), error })
    }

    /// The next message of the vehicle, or `None` at the deadline.
    pub fn next_message(&mut self, deadline: Instant) -> Result<Option<MavMessage>, CtlError> {
        loop {
            if let Some(message) = self.next_waiting() {
                return Ok(Some(message));
            }
            let now = Instant::now();
            if now >= self.heartbeat_due {
                self.heartbeat_due = now + HEARTBEAT_PERIOD;
                self.send(&own_heartbeat())?;
            }
            if now >= deadline {
                return Ok(None);
            }
            let wait = deadline.min(self.heartbeat_due).saturating_duration_since(now);
            let (n, from) = self
                .link
                .receive(&mut self.buffer, wait)
                .map_err(|error| CtlError::Io { address: self.address.clone(), error })?;
            let knows_whom = self.chosen.is_some() || self.streams.is_empty();
            if n == 0 && knows_whom && self.heard.elapsed() >= PORT_LEFT && self.link.take_port() {
                self.streams.clear();
                self.callers = Callers::default();
            }
            if from.is_some_and(|from| self.passes(n, from)) {
                continue;
            }
            let known = self.streams.iter().position(|(sender, _)| *sender == from);
            if known.is_none() && n > 0 && self.streams.len() < MOST_STREAMS {
                self.streams.push((from, MavSplitter::new()));
            }
            if let Some((_, splitter)) = self.streams.iter_mut().find(|(s, _)| *s == from) {
                splitter.push(&self.buffer[..n]);
            }
        }
    }

    /// Passes what came on: the vehicle's to our guests, a guest's to the vehicle; only where there is no doubt whose
    /// vehicle that is. Whether it was a guest's.
    fn passes(&mut self, n: usize, from: SocketAddr) -> bool {
        let Some(chosen) = self.chosen else { return false };
        let bytes = self.buffer.get(..n).unwrap_or_default();
        if chosen.from == Some(from) {
            self.guests.places().for_each(|guest| self.link.pass_on(bytes, guest));
            return false;
        }
        let is_guests = chosen.from.is_some()
            && self.others().is_empty()
            && self.guests.hear(from, bytes, Instant::now());
        // What is lost is asked for again.
        if is_guests {
            let _ = self.link.send(bytes);
        }
        is_guests
    }

    /// The next message of the vehicle among the bytes that have come.
    fn next_waiting(&mut self) -> Option<MavMessage> {
        for (from, splitter) in &mut self.streams {
            while let Some(frame) = splitter.next() {
                let Ok(frame) = frame else { continue };
                if matches!(self.ring.admit(&frame, unix_us()), Standing::Refused(_)) {
                    continue;
                }
                let (system, component) = (frame.header.system_id, frame.header.component_id);
                let Ok(message) = frame.decode() else { continue };
                self.callers.hear(*from, system, component, &message);
                if component != AUTOPILOT {
                    continue;
                }
                // On a port that has become ours it speaks from an address of its own.
                if let (Some(chosen), Some(place), true) =
                    (&mut self.chosen, *from, self.link.lacks_peer())
                    && chosen.system == system
                {
                    chosen.from = *from;
                    self.link.speak_to(place);
                }
                let ours = |chosen: Caller| chosen.system == system && chosen.from == *from;
                if self.chosen.is_some_and(ours) {
                    self.heard = Instant::now();
                    follow(&mut self.vehicle, &mut self.text, &mut self.texts, &message);
                    return Some(message);
                }
            }
        }
        None
    }

    /// Follows the vehicle for a while.
    pub fn listen(&mut self, time: Duration) -> Result<(), CtlError> {
        let deadline = Instant::now() + time;
        while self.next_message(deadline)?.is_some() {}
        Ok(())
    }

    /// Follows the vehicle until `done` says so.
    pub fn wait<T>(
        &mut self,
        what: &str,
        timeout: Duration,
        mut done: impl FnMut(&Vehicle) -> Option<T>,
    ) -> Result<T, CtlError> {
        self.wait_hearing(what, timeout, |vehicle, _| done(vehicle))
    }

    /// The same for who wants the texts as they come.
    pub fn wait_hearing<T>(
        &mut self,
        what: &str,
        timeout: Duration,
        mut done: impl FnMut(&Vehicle, &mut Vec<String>) -> Option<T>,
    ) -> Result<T, CtlError> {
        let began = Instant::now();
        let deadline = began + timeout;
        loop {
            if let Some(result) = done(&self.vehicle, &mut self.texts) {
                return Ok(result);
            }
            // Who did something else meanwhile has not listened.
            let gone = self.heard.max(began) + GONE;
            if self.next_message(deadline.min(gone))?.is_some() {
                continue;
            }
            if Instant::now() >= gone {
                return Err(CtlError::Gone { silent: GONE, texts: self.take_texts() });
            }
            if Instant::now() >= deadline {
                return Err(CtlError::Timeout {
                    what: what.into(),
                    waited: timeout,
                    texts: self.take_texts(),
                });
            }
        }
    }

    /// Sends a command until it is answered.
    pub fn command(&mut self, command: MavCmd, params: [f32; 7]) -> Result<(), CtlError> {
        let to = self.target();
        self.until_answered(command, |confirmation| {
            command_long(to, command, &params, confirmation)
        })
    }

    fn until_answered(
        &mut self,
        command: MavCmd,
        message: impl Fn(u8) -> MavMessage,
    ) -> Result<(), CtlError> {
        self.forget_texts();
        for n in 0..ACK_TRIES {
            self.send(&message(n as u8))?;
            let mut deadline = Instant::now() + ACK_TIMEOUT;
            while let Some(answer) = self.next_message(deadline)? {
                let MavMessage::COMMAND_ACK(ack) = answer else { continue };
                if ack.command != command as u16 {
                    continue;
                }
                // A word that is not known is none of consent.
                match known(ack.result).unwrap_or(MavResult::MAV_RESULT_FAILED) {
                    MavResult::MAV_RESULT_ACCEPTED => return Ok(()),
                    MavResult::MAV_RESULT_IN_PROGRESS => {
                        deadline = Instant::now() + PROGRESS_TIMEOUT;
                    }
                    result => {
                        let texts = self.texts_after_refusal()?;
                        return Err(CtlError::Refused { command, result, texts });
                    }
                }
            }
        }
        Err(CtlError::NoAnswer { command, tries: ACK_TRIES, each: ACK_TIMEOUT })
    }

    /// Sets the interval of a stream on our link, µs; 0 is the default.
    pub fn set_interval(&mut self, msg_id: u32, interval_us: f64) -> Result<(), CtlError> {
        let params = [msg_id as f32, interval_us as f32, 0.0, 0.0, 0.0, 0.0, 0.0];
        self.command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, params)
    }

    /// Arms and waits until the vehicle says so.
    pub fn arm(&mut self) -> Result<(), CtlError> {
        self.arm_disarm(true)
    }

    /// Disarms and waits until the vehicle says so.
    pub fn disarm(&mut self) -> Result<(), CtlError> {
        self.arm_disarm(false)
    }

    fn arm_disarm(&mut self, arm: bool) -> Result<(), CtlError> {
        let nan = f32::NAN;
        let arm_param = if arm { 1.0 } else { 0.0 };
        let params = [arm_param, 0.0, nan, nan, nan, nan, nan];
        self.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, params)?;
        let what = if arm { "the vehicle to arm" } else { "the vehicle to disarm" };
        self.wait(what, Duration::from_secs(5), |v| (v.armed == arm).then_some(()))
    }

    /// Takes off and waits for the height.
    pub fn takeoff(&mut self, height_m: f64) -> Result<(), CtlError> {
        let nan = f32::NAN;
        let params = [nan, nan, nan, nan, nan, nan, height_m as f32];
        self.command(MavCmd::MAV_CMD_NAV_TAKEOFF, params)?;
        let timeout = Duration::from_secs_f64(height_m.max(0.0) / SLOWEST_MPS + SLACK_S);
        self.wait("the height of the take-off", timeout, |v| {
            // Near the height the vehicle still takes off, and refuses other wishes.
            let there = v.height_m().is_some_and(|h| (h - height_m).abs() < HEIGHT_REACHED_M);
            (there && v.custom_mode != Mode::Takeoff.custom_mode()).then_some(())
        })
    }

    /// Flies to a point, given as north, east and height, and waits until it is there.
    pub fn goto(&mut self, north_m: f64, east_m: f64, height_m: f64) -> Result<(), CtlError> {
        let to = self.target();
        let command = MavCmd::MAV_CMD_DO_REPOSITION;
        // Speed as configured; change to the mode that this needs.
        let params = [-1.0, 1.0, 0.0, f32::NAN];
        let [x, y] = [north_m, east_m].map(|m| (m * LOCAL_PER_M).round() as i32);
        let place = (x, y, -height_m as f32);
        self.until_answered(command, |_| command_int(to, command, params, place))?;
        let away_m = |v: &Vehicle| {
            v.position_m.map(|[n, e, d]| (n - north_m).hypot(e - east_m).hypot(d + height_m))
        };
        let timeout = away_m(&self.vehicle).unwrap_or(10.0) / SLOWEST_MPS + SLACK_S;
        self.wait("the point", Duration::from_secs_f64(timeout.min(600.0)), |v| {
            away_m(v).filter(|m| *m < POINT_REACHED_M).map(|_| ())
        })
    }

    /// Asks for a mode.
    pub fn set_mode(&mut self, mode: Mode) -> Result<(), CtlError> {
        let (main, sub) = mode.numbers();
        let nan = f32::NAN;
        // 1: the mode is custom.
        let params = [1.0, f32::from(main), f32::from(sub), nan, nan, nan, nan];
        self.command(MavCmd::MAV_CMD_DO_SET_MODE, params)
    }

    /// Lands and waits until the vehicle has landed and disarmed itself.
    pub fn land(&mut self) -> Result<(), CtlError> {
        self.command(MavCmd::MAV_CMD_NAV_LAND, [f32::NAN; 7])?;
        self.wait_down()
    }

    /// Waits for a landing that has begun, as long as one takes from this height.
    pub fn wait_down(&mut self) -> Result<(), CtlError> {
        let timeout = self.vehicle.height_m().unwrap_or(10.0).max(0.0) / SLOWEST_MPS + SLACK_S;
        self.wait_landed(Duration::from_secs_f64(timeout))
    }

    /// Waits until the vehicle stands on the floor, disarmed.
    pub fn wait_landed(&mut self, timeout: Duration) -> Result<(), CtlError> {
        self.wait("the landing", timeout, |v| {
            (v.landed == LandedState::MAV_LANDED_STATE_ON_GROUND && !v.armed).then_some(())
        })
    }

    /// Sends a setpoint once. The vehicle follows while they keep coming and its mode is offboard.
    pub fn setpoint(&mut self, setpoint: Setpoint, yaw_rad: Option<f64>) -> Result<(), CtlError> {
        let (target_system, target_component) = self.target();
        let ignore = |bits: &[Mask]| bits.iter().fold(Mask::empty(), |all, bit| all | *bit);
        let position = [
            Mask::POSITION_TARGET_TYPEMASK_X_IGNORE,
            Mask::POSITION_TARGET_TYPEMASK_Y_IGNORE,
            Mask::POSITION_TARGET_TYPEMASK_Z_IGNORE,
        ];
        let velocity = [
            Mask::POSITION_TARGET_TYPEMASK_VX_IGNORE,
            Mask::POSITION_TARGET_TYPEMASK_VY_IGNORE,
            Mask::POSITION_TARGET_TYPEMASK_VZ_IGNORE,
        ];
        let always = [
            Mask::POSITION_TARGET_TYPEMASK_AX_IGNORE,
            Mask::POSITION_TARGET_TYPEMASK_AY_IGNORE,
            Mask::POSITION_TARGET_TYPEMASK_AZ_IGNORE,
            Mask::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE,
        ];
        let mut message = SET_POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms: self.started.elapsed().as_millis() as u32,
            target_system,
            target_component,
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
            type_mask: ignore(&always),
            yaw: yaw_rad.unwrap_or_default() as f32,
            ..Default::default()
        };
        if yaw_rad.is_none() {
            message.type_mask |= Mask::POSITION_TARGET_TYPEMASK_YAW_IGNORE;
        }
        match setpoint {
            Setpoint::Position(p) => {
                [message.x, message.y, message.z] = p.map(|c| c as f32);
                message.type_mask |= ignore(&velocity);
            }
            Setpoint::Velocity(v) => {
                [message.vx, message.vy, message.vz] = v.map(|c| c as f32);
                message.type_mask |= ignore(&position);
            }
        }
        self.send(&MavMessage::SET_POSITION_TARGET_LOCAL_NED(message))
    }
}

/// Follows what the vehicle tells.
fn follow(
    vehicle: &mut Vehicle,
    unfinished: &mut String,
    texts: &mut Vec<String>,
    message: &MavMessage,
) {
    vehicle.take(message);
    if let MavMessage::STATUSTEXT(text) = message {
        let part = text.text.to_str().unwrap_or("(unreadable)");
        // A long text comes in chunks of 50 characters; a shorter chunk ends it.
        unfinished.push_str(part);
        if text.id == 0 || part.len() < CHUNK {
            if texts.len() >= MOST_TEXTS {
                texts.remove(0);
            }
            texts.push(std::mem::take(unfinished));
        }
    }
}

/// Wall clock, µs since 1970 UTC.
fn unix_us() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_micros()).unwrap_or(i64::MAX)
}

fn own_heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_GCS as u8,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID as u8,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE as u8,
        custom_mode: 0,
        mavlink_version: 3,
    })
}
