//! Commands that move the vehicle: arming, take-off, points, modes, landing.

use haltere_dialect::mav::haltere::MavResult;

use haltere_core::checks::shown;
use haltere_core::estimate::Health;
use haltere_core::frames::Vec3;
use haltere_core::time::HostTime;

use super::act::Act;
use crate::flight::arming::SHADOW_WORDS;
use crate::flight::awaited::{Next, too_far};
use crate::flight::mission::LOWEST_M;
use crate::flight::modes::{Event, Mode};
use crate::flight::place::{Kind, Wanted, room_point};
use crate::flight::setpoint::Setpoint;
use crate::flight::shown_modes::SHOWN_MODES;
use crate::out::voice::Severity;
use crate::stations::commands::{Answer, Awaits, Refusal, Request, refuse};
use crate::view::around;

/// Magic number that forces a disarm in the air (common.xml, MAV_CMD_COMPONENT_ARM_DISARM).
const FORCE_DISARM: f32 = 21196.0;
/// A landing place this near is here, m: twice the radius at which a point counts as reached.
const LAND_HERE_M: f64 = 0.6;
/// Speeds that can be asked for, m/s: as in missions.
const SPEED_MPS: std::ops::RangeInclusive<f64> = 0.05..=20.0;
/// Largest angle of CONDITION_YAW, deg.
const MOST_TURN_DEG: f64 = 360.0;

impl Act<'_> {
    pub(crate) fn arm_disarm(&mut self, at: HostTime, request: &Request) -> Answer {
        use MavResult as R;
        let arm = match request.params[0] {
            1.0 => true,
            0.0 => false,
            other => {
                return refuse(
                    R::MAV_RESULT_DENIED,
                    format!("arm = {other}, allowed 1 to arm or 0 to disarm"),
                );
            }
        };
        if arm {
            if self.flight.mode == Mode::Arming {
                // Asked again before the board has answered.
                self.stations.wait_for_board(at, request, Awaits::Arm);
                return Ok(R::MAV_RESULT_IN_PROGRESS);
            }
            let ours = !matches!(self.flight.mode, Mode::Disarmed | Mode::Disarming);
            if self.board.link.is_armed() && ours {
                return Ok(R::MAV_RESULT_ACCEPTED);
            }
            // Forced arming (2989, QGroundControl and MAVProxy) skips no check: nobody can see from
            // a ground station whether they matter.
            if let Err(why) = self.sight(at).may_arm() {
                return refuse(
                    R::MAV_RESULT_TEMPORARILY_REJECTED,
                    format!("arming refused: {why}"),
                );
            }
            self.flight.tell_at_rest(&around!(self, at), self.out);
            self.board.link.command_arm(true, false, at);
            self.stations.wait_for_board(at, request, Awaits::Arm);
            self.fire(at, Event::ArmAsked);
            return Ok(R::MAV_RESULT_IN_PROGRESS);
        }
        self.disarm(at, request, request.params[1] == FORCE_DISARM)
    }

    /// MAV_CMD_DO_FLIGHTTERMINATION: motors off, wherever the vehicle is.
    pub(crate) fn terminate(&mut self, at: HostTime, request: &Request) -> Answer {
        if request.params[0] > 0.5 {
            self.disarm(at, request, true)
        } else {
            refuse(
                MavResult::MAV_RESULT_DENIED,
                format!("termination = {}, allowed 1", request.params[0]),
            )
        }
    }

    fn disarm(&mut self, at: HostTime, request: &Request, forced: bool) -> Answer {
        use MavResult as R;
        if self.flight.mode == Mode::Disarmed && !self.board.link.is_armed() {
            return Ok(R::MAV_RESULT_ACCEPTED);
        }
        if self.flight.mode == Mode::Disarming && !forced && self.board.link.is_commanding() {
            self.stations.wait_for_board(at, request, Awaits::Disarm);
            return Ok(R::MAV_RESULT_IN_PROGRESS);
        }
        // In the spool-up the floor still carries the vehicle.
        let flies = self.flight.mode.has_thrust() && self.flight.mode != Mode::Spool;
        if (flies || self.flight.mode == Mode::Yielded) && !forced {
            return refuse(
                R::MAV_RESULT_DENIED,
                "disarming in the air refused: land, or force it with 21196",
            );
        }
        self.stations.wait_for_board(at, request, Awaits::Disarm);
        if !self.fire(at, Event::DisarmAsked) || forced {
            self.board.link.command_arm(false, forced, at);
        }
        Ok(R::MAV_RESULT_IN_PROGRESS)
    }

    /// NAV_TAKEOFF: straight up, whatever place it names.
    pub(crate) fn command_takeoff(&mut self, at: HostTime, request: &Request) -> Answer {
        let kind = self.stations.kind_of(request)?;
        self.takeoff_to(at, kind, request)
    }

    pub(crate) fn takeoff_to(&mut self, at: HostTime, kind: Kind, request: &Request) -> Answer {
        let wanted = room_point(self.origin, kind, [f64::NAN, f64::NAN, request.location.z()]);
        self.ask_takeoff(at, wanted.height_m.unwrap_or(self.config.flight.takeoff_height_m))
    }

    /// NAV_LAND: where the vehicle is. Zeros and NaN are what clients send for "here".
    pub(crate) fn command_land(&mut self, at: HostTime, request: &Request) -> Answer {
        let [x, y] = request.location.plain();
        let here = x.is_nan() || y.is_nan() || (x == 0.0 && y == 0.0);
        if !here
            && let Some([north_m, east_m]) =
                self.stations.wanted(self.origin, request)?.horizontal_m
        {
            let pos = self.estimate.pos_E_m;
            let away_m = (north_m - pos.x()).hypot(east_m - pos.y());
            if away_m > LAND_HERE_M {
                return refuse(
                    MavResult::MAV_RESULT_DENIED,
                    format!(
                        "landing {away_m:.1} m away refused: fly there first, or land by a mission"
                    ),
                );
            }
        }
        self.land_here(at)
    }

    pub(crate) fn land_here(&mut self, at: HostTime) -> Answer {
        self.ask(at, Event::LandAsked, &[Mode::Land, Mode::Descend])
    }

    /// Asks for an event; modes in `already` count as granted.
    pub(crate) fn ask(&mut self, at: HostTime, event: Event, already: &[Mode]) -> Answer {
        if let Some(why) = self
            .flight
            .forbids(event, self.config, self.navigation)
            .filter(|_| !already.contains(&self.flight.mode))
        {
            let what = wish(event);
            return refuse(
                MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                format!("{what} refused: {why}"),
            );
        }
        if already.contains(&self.flight.mode) || self.fire(at, event) {
            return Ok(MavResult::MAV_RESULT_ACCEPTED);
        }
        let takes_back = matches!(event, Event::HoldAsked | Event::LandAsked | Event::ReturnAsked);
        if self.flight.mode == Mode::Yielded && takes_back {
            return self.ask_control_back(at, event);
        }
        if matches!(event, Event::HoldAsked | Event::LandAsked) && !self.flight.mode.has_thrust() {
            // On the floor it is granted: nothing moves, and a waiting take-off is called off.
            self.flight.call_off_lift_off();
            return Ok(MavResult::MAV_RESULT_ACCEPTED);
        }
        let what = wish(event);
        let mode = self.flight.mode.name();
        let hint = if self.flight.mode.has_thrust() { "" } else { ": take off first" };
        refuse(
            MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            format!("{what} refused while {mode}{hint}"),
        )
    }

    /// The board flies by itself: it is asked for its control mode, by order of a client only.
    fn ask_control_back(&mut self, at: HostTime, event: Event) -> Answer {
        if !matches!(self.estimate.health, Health::Good | Health::Degraded) {
            return refuse(
                MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                "taking control back refused: no usable estimate",
            );
        }
        self.flight.land_when_back = event == Event::LandAsked;
        self.board.link.retake(at);
        let text = format!("board is in {}, it is asked for control", self.board.link.mode_name());
        self.out.say(at, Severity::Info, text);
        Ok(MavResult::MAV_RESULT_ACCEPTED)
    }

    fn refuse_while_ending(&self, what: &str) -> Answer {
        match self.flight.ending_forbids(Mode::Takeoff) {
            None => Ok(MavResult::MAV_RESULT_ACCEPTED),
            Some(why) => {
                refuse(MavResult::MAV_RESULT_TEMPORARILY_REJECTED, format!("{what} refused: {why}"))
            }
        }
    }

    fn ask_takeoff(&mut self, at: HostTime, height_m: f64) -> Answer {
        let top_m = self.flight.guidance.volume().height_m;
        if !(0.3..=top_m).contains(&height_m) {
            return refuse(
                MavResult::MAV_RESULT_DENIED,
                format!("take-off height = {height_m:.2}, allowed 0.3 to {top_m:.1} m"),
            );
        }
        self.refuse_while_ending("take-off")?;
        match self.flight.mode {
            Mode::Disarmed | Mode::Arming | Mode::Idle => {
                self.flight.guidance.set_takeoff_height(height_m);
                self.flight.guidance.next = Next::Nothing;
                self.flight.lift_off_asked = true;
                self.stations.intended_mode = Mode::Takeoff.custom_mode();
                if self.flight.mode == Mode::Disarmed {
                    self.out.say(at, Severity::Info, "takes off when armed".to_owned());
                }
                Ok(MavResult::MAV_RESULT_ACCEPTED)
            }
            // Sent again, because the answer was lost.
            Mode::Spool | Mode::Takeoff if self.flight.guidance.takeoff_height_m() == height_m => {
                Ok(MavResult::MAV_RESULT_ACCEPTED)
            }
            _ => refuse(
                MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                format!("take-off refused while {}", self.flight.mode.name()),
            ),
        }
    }

    pub(crate) fn ask_mission(&mut self, at: HostTime) -> Answer {
        if self.flight.mission.items.is_empty() {
            return refuse(MavResult::MAV_RESULT_DENIED, "no mission: upload one first");
        }
        if let Some(why) = self.flight.plans.mission_is_barred.clone() {
            return refuse(MavResult::MAV_RESULT_DENIED, why);
        }
        if usize::from(self.flight.guidance.current_item) >= self.flight.mission.items.len() {
            self.flight.guidance.set_current_item(0);
        }
        self.refuse_while_ending("mission")?;
        if self.flight.mode != Mode::Mission
            && let Some(why) = self.flight.first_leg_is_barred(self.estimate)
        {
            return refuse(MavResult::MAV_RESULT_DENIED, why);
        }
        match self.flight.mode {
            Mode::Disarmed | Mode::Arming | Mode::Idle => {
                let height_m = self
                    .flight
                    .mission
                    .takeoff_height_m()
                    .unwrap_or(self.config.flight.takeoff_height_m);
                self.flight.guidance.set_takeoff_height(height_m);
                self.flight.guidance.next = Next::Mission;
                self.flight.lift_off_asked = true;
                Ok(MavResult::MAV_RESULT_ACCEPTED)
            }
            Mode::Spool | Mode::Takeoff => {
                self.flight.guidance.next = Next::Mission;
                Ok(MavResult::MAV_RESULT_ACCEPTED)
            }
            _ => self.ask(at, Event::MissionAsked, &[Mode::Mission]),
        }
    }

    pub(crate) fn set_current_item(&mut self, index: f64) -> Answer {
        let count = self.flight.mission.items.len();
        if !(index >= 0.0 && index < count as f64) {
            return refuse(
                MavResult::MAV_RESULT_DENIED,
                format!("mission item {index}: the mission has {count} items"),
            );
        }
        self.flight.guidance.set_current_item(index as u16);
        Ok(MavResult::MAV_RESULT_ACCEPTED)
    }

    /// The last item of MISSION_START, where it is not that of the mission: 0 names none, as most clients send it.
    pub(crate) fn last_item(&self, [first, last, ..]: [f64; 4]) -> Result<Option<u16>, Refusal> {
        let count = self.flight.mission.items.len();
        let first = if first.is_finite() { first.max(0.0) } else { 0.0 };
        if last.is_nan() || last == 0.0 || last == count as f64 - 1.0 {
            return Ok(None);
        }
        if !(last >= first && last < count as f64) {
            let why = format!("last item = {last}, allowed {first} to {}", count.saturating_sub(1));
            return Err((MavResult::MAV_RESULT_DENIED, why));
        }
        Ok(Some(last as u16))
    }

    /// A mode by PX4's number, from any of the ways to ask for one.
    pub(crate) fn set_custom_mode(&mut self, at: HostTime, custom_mode: u32) -> Answer {
        if self.config.flight.shadow {
            return refuse(MavResult::MAV_RESULT_DENIED, format!("refused: {SHADOW_WORDS}"));
        }
        let asked = SHOWN_MODES.iter().map(|m| m.mode).find(|m| m.custom_mode() == custom_mode);
        let answer = match asked {
            Some(Mode::Hold) => self.ask(at, Event::HoldAsked, &[Mode::Hold]),
            Some(Mode::Mission) => self.ask_mission(at),
            Some(Mode::Takeoff) => self.ask_takeoff(at, self.config.flight.takeoff_height_m),
            Some(Mode::Return) => self.ask(at, Event::ReturnAsked, &[Mode::Return]),
            Some(Mode::Land) => self.land_here(at),
            Some(Mode::Offboard) => {
                let setpoint = self.flight.guidance.setpoint;
                self.ask_followed(at, setpoint, Event::OffboardAsked, Mode::Offboard, "setpoints")
            }
            Some(Mode::Manual) => {
                let sticks = self.flight.guidance.sticks;
                self.ask_followed(at, sticks, Event::ManualAsked, Mode::Manual, "MANUAL_CONTROL")
            }
            _ => refuse(
                MavResult::MAV_RESULT_DENIED,
                format!(
                    "no mode with main {} sub {}: AVAILABLE_MODES lists them",
                    custom_mode >> 16 & 0xFF,
                    custom_mode >> 24
                ),
            ),
        };
        if answer.is_ok() {
            self.stations.intended_mode = custom_mode;
            // Within 1.3 s a heartbeat must show it, says one of them; here it is.
            self.tell_mode(at);
        }
        answer
    }

    /// A mode that follows what a client streams: the stream must run already.
    fn ask_followed(
        &mut self,
        at: HostTime,
        setpoint: Option<Setpoint>,
        event: Event,
        mode: Mode,
        what: &str,
    ) -> Answer {
        let limit_s = self.config.limits.offboard_loss_s;
        if setpoint.is_none_or(|s| at.seconds_since(s.received_at) >= limit_s) {
            return refuse(
                MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                format!("{} refused: send {what} first", mode.name()),
            );
        }
        self.out.told.refused_setpoint_at = None;
        let next = if mode == Mode::Offboard { Next::Offboard } else { Next::Manual };
        let on_floor = matches!(self.flight.mode, Mode::Disarmed | Mode::Arming | Mode::Idle);
        if mode == Mode::Offboard && on_floor {
            return self.ask_offboard_on_floor(setpoint);
        }
        self.ask_or_wait(at, event, mode, next)
    }

    /// Offboard before the take-off: the stream lifts off, when it runs and the board is armed.
    fn ask_offboard_on_floor(&mut self, setpoint: Option<Setpoint>) -> Answer {
        use MavResult as R;
        self.refuse_while_ending("offboard")?;
        if self.estimate.health == Health::NotAligned {
            return refuse(R::MAV_RESULT_TEMPORARILY_REJECTED, "estimator not aligned");
        }
        if let Some(why) = setpoint.and_then(|s| too_far(&s, self.estimate.pos_E_m)) {
            return refuse(R::MAV_RESULT_DENIED, why);
        }
        self.flight.lift_off_asked = false;
        self.flight.guidance.next = Next::Offboard;
        Ok(R::MAV_RESULT_ACCEPTED)
    }

    /// Asks for a mode. While the vehicle climbs off the floor it follows when that is done.
    fn ask_or_wait(&mut self, at: HostTime, event: Event, mode: Mode, next: Next) -> Answer {
        let climbs = matches!(self.flight.mode, Mode::Spool | Mode::Takeoff);
        if climbs && self.flight.forbids(event, self.config, self.navigation).is_none() {
            self.flight.guidance.next = next;
            return Ok(MavResult::MAV_RESULT_ACCEPTED);
        }
        self.ask(at, event, &[mode])
    }

    /// DO_CHANGE_SPEED.
    pub(crate) fn change_speed(&mut self, speed_mps: f64) -> Answer {
        if SPEED_MPS.contains(&speed_mps) {
            self.flight.guidance.set_leg_speed(Some(speed_mps));
        } else if speed_mps == -2.0 {
            self.flight.guidance.set_leg_speed(None);
        } else if speed_mps != -1.0 {
            // -1 is "no change".
            return refuse(
                MavResult::MAV_RESULT_DENIED,
                format!(
                    "speed = {} m/s, allowed {} to {} m/s, or -2 for default",
                    shown(speed_mps),
                    SPEED_MPS.start(),
                    SPEED_MPS.end()
                ),
            );
        }
        Ok(MavResult::MAV_RESULT_ACCEPTED)
    }

    /// CONDITION_YAW: angle (deg), speed, direction, relative. Absolute angles count from true north.
    pub(crate) fn turn(&mut self, [angle_deg, _, direction, relative]: [f64; 4]) -> Answer {
        if !(-MOST_TURN_DEG..=MOST_TURN_DEG).contains(&angle_deg) {
            return refuse(
                MavResult::MAV_RESULT_DENIED,
                format!("yaw = {angle_deg} deg, allowed -{MOST_TURN_DEG} to {MOST_TURN_DEG}"),
            );
        }
        if !self.flight.mode.is_flying() {
            return refuse(
                MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                format!("turning refused while {}: take off first", self.flight.mode.name()),
            );
        }
        let angle_rad = angle_deg.to_radians();
        self.flight.guidance.set_yaw(if relative == 1.0 {
            let sign = if direction < 0.0 { -1.0 } else { 1.0 };
            self.estimate.R_EB.yaw_rad() + sign * angle_rad
        } else {
            self.origin.room_yaw_rad(angle_rad)
        });
        Ok(MavResult::MAV_RESULT_ACCEPTED)
    }

    /// DO_REPOSITION: a point, a height alone, or nothing at all, which is a pause.
    pub(crate) fn reposition(&mut self, at: HostTime, request: &Request) -> Answer {
        let Wanted { horizontal_m, height_m, is_global } =
            self.stations.wanted(self.origin, request)?;
        if horizontal_m.is_none() && height_m.is_none() {
            return self.ask(at, Event::HoldAsked, &[Mode::Hold]);
        }
        let speed_mps = f64::from(request.params[0]);
        let yaw_rad = f64::from(request.params[3]);
        let yaw_rad = yaw_rad
            .is_finite()
            .then(|| if is_global { self.origin.room_yaw_rad(yaw_rad) } else { yaw_rad });
        self.go_to(at, horizontal_m, height_m, yaw_rad)?;
        if speed_mps > 0.0 {
            self.change_speed(speed_mps)?;
        }
        Ok(MavResult::MAV_RESULT_ACCEPTED)
    }

    /// Flies to a point, of which what is not given stays as it is.
    pub(crate) fn go_to(
        &mut self,
        at: HostTime,
        horizontal_m: Option<[f64; 2]>,
        height_m: Option<f64>,
        yaw_rad: Option<f64>,
    ) -> Answer {
        use MavResult as R;
        if self.estimate.health == Health::NotAligned {
            return refuse(R::MAV_RESULT_TEMPORARILY_REJECTED, "estimator not aligned");
        }
        // On a leg, what is kept is where the leg ends.
        let now = match self.flight.mode {
            Mode::Goto | Mode::Hold | Mode::Takeoff => self.flight.guidance.goal_E_m(),
            _ => self.estimate.pos_E_m,
        };
        let [north_m, east_m] = horizontal_m.unwrap_or([now.x(), now.y()]);
        let height_m = height_m.unwrap_or(-now.z());
        let point = Vec3::new(north_m, east_m, -height_m);
        let volume = *self.flight.guidance.volume();
        if !point.is_finite() || !volume.contains(point) {
            return refuse(
                R::MAV_RESULT_DENIED,
                format!(
                    "N {north_m:.2} E {east_m:.2} height {height_m:.2} m is outside the limits: \
                     N {:.2} to {:.2}, E {:.2} to {:.2}, height {LOWEST_M} to {:.2} m",
                    volume.north_m[0],
                    volume.north_m[1],
                    volume.east_m[0],
                    volume.east_m[1],
                    volume.height_m
                ),
            );
        }
        if horizontal_m.is_some()
            && let Some(why) = self.flight.fence_bars([north_m, east_m], self.estimate)
        {
            return refuse(R::MAV_RESULT_DENIED, why);
        }
        let next = Next::Point { pos_E_m: point, yaw_rad };
        let answer = self.ask_or_wait(at, Event::GotoAsked, Mode::Goto, next)?;
        if self.flight.mode == Mode::Goto {
            self.flight.guidance.fly_to(point, yaw_rad);
        }
        Ok(answer)
    }
}

/// What a client asks for, in words.
fn wish(event: Event) -> &'static str {
    match event {
        Event::GotoAsked => "flying to a point",
        Event::MissionAsked => "mission",
        Event::OffboardAsked => "offboard",
        Event::ManualAsked => "flying by joystick",
        Event::ReturnAsked => "return",
        Event::HoldAsked => "hold",
        Event::LandAsked => "landing",
        _ => "this",
    }
}
