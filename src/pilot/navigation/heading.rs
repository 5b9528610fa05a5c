//! The angle from room north to the board's north.
//!
//! The board turns its attitude setpoints in its own frame, whose north comes from a compass or
//! from wherever it was switched on. We fly in the room. The angle between the two is followed
//! slowly from both attitudes, a jump that lasts at once, and applied at one place: when a setpoint is written.

use haltere_core::frames::{B, E, Rot, wrap_pi_rad};

use super::ATTITUDE_AGE_S;
use super::Navigation;
use crate::flight::modes::Mode;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::view::View;

/// Time constant of the follower, s. Slow against attitude loops, fast against compass drift.
const TIME_CONSTANT_S: f64 = 5.0;
/// The same while the vehicle stands, s: nothing turns by it, and the first setpoint must be the
/// heading that the board has (docs/BOARDS.md).
const STANDING_S: f64 = 1.0;
/// Fastest change that is passed on, rad/s: a jump of the board's compass must not turn the
/// vehicle's thrust by more than the velocity loop can follow.
const RATE_LIMIT_RADPS: f64 = 0.1;
/// A difference larger than this is told to people, rad.
const JUMP_RAD: f64 = 0.35;
/// If it lasts so long it is taken over whole, s. The board leans in its own frame: until the angle is right every lean is
/// turned by the jump, and beyond some 60 degrees that drives the vehicle away.
const JUMP_S: f64 = 0.1;

/// Follows the angle.
#[derive(Debug)]
pub(crate) struct BoardNorth {
    offset_rad: f64,
    jumped: bool,
    /// For how long the difference has been one that is told, s.
    jumped_s: f64,
}

impl BoardNorth {
    /// Starts from the configured angle, rad, positive clockwise seen from above.
    pub fn new(offset_rad: f64) -> Self {
        Self { offset_rad: wrap_pi_rad(offset_rad), jumped: false, jumped_s: 0.0 }
    }

    /// Angle from room north to the board's north, rad: room yaw = board yaw + angle.
    pub fn offset_rad(&self) -> f64 {
        self.offset_rad
    }

    /// Our yaw for a yaw that the board reports.
    pub fn room_yaw_rad(&self, board_attitude: Rot<E, B>) -> f64 {
        wrap_pi_rad(board_attitude.yaw_rad() + self.offset_rad)
    }

    /// Follows the difference between our attitude and the board's. `true`: it has just jumped.
    pub fn follow(&mut self, ours: Rot<E, B>, board: Rot<E, B>, dt_s: f64, standing: bool) -> bool {
        let error_rad = wrap_pi_rad(ours.yaw_rad() - board.yaw_rad() - self.offset_rad);
        let rate_radps = if standing {
            error_rad / STANDING_S
        } else {
            (error_rad / TIME_CONSTANT_S).clamp(-RATE_LIMIT_RADPS, RATE_LIMIT_RADPS)
        };
        let dt_s = dt_s.clamp(0.0, 0.1);
        self.offset_rad = wrap_pi_rad(self.offset_rad + rate_radps * dt_s);
        let jumped = error_rad.abs() > JUMP_RAD && !standing;
        self.jumped_s = if jumped { self.jumped_s + dt_s } else { 0.0 };
        if self.jumped_s > JUMP_S {
            self.offset_rad = wrap_pi_rad(ours.yaw_rad() - board.yaw_rad());
        }
        let news = jumped && !self.jumped;
        self.jumped = jumped;
        news
    }

    /// A setpoint in the room, turned into the board's frame.
    pub fn setpoint_for_board(&self, room: Rot<E, B>) -> Rot<E, B> {
        Rot::<E, E>::from_euler_rad(0.0, 0.0, -self.offset_rad) * room
    }
}

impl Navigation {
    /// Follows the board's heading where both are known.
    pub(crate) fn follow_north(&mut self, view: &View<'_>, dt_s: f64, out: &mut Out) {
        let Some(board) = view.board.attitude else { return };
        let usable = view.is_usable() && view.at.seconds_since(board.received_at) < ATTITUDE_AGE_S;
        // Before take-off the board's heading is the frame of the command, whatever ours says; the
        // generic board has always been followed slowly.
        let standing = view.board.is_real
            && matches!(view.mode, Mode::Disarmed | Mode::Arming | Mode::Idle)
            && view.stands;
        if usable && self.north.follow(view.estimate.R_EB, board.attitude, dt_s, standing) {
            let text = "board heading jumped against ours: setpoints follow";
            out.say(view.at, Severity::Warning, text.to_owned());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_setpoint_and_report_agree() {
        let north = BoardNorth::new(0.4);
        let room = Rot::<E, B>::from_euler_rad(0.1, -0.2, 1.0);
        let board = north.setpoint_for_board(room);
        assert!((north.room_yaw_rad(board) - 1.0).abs() < 1e-12);
        let [roll, pitch, _] = board.euler_rad();
        assert!((roll - 0.1).abs() < 1e-12 && (pitch + 0.2).abs() < 1e-12);
    }

    #[test]
    fn prop_follows_drift_and_limits_a_jump() {
        let mut north = BoardNorth::new(0.0);
        let ours = Rot::<E, B>::from_euler_rad(0.0, 0.0, 1.0);
        let board = Rot::<E, B>::from_euler_rad(0.0, 0.0, 0.9);
        for _ in 0..3000 {
            assert!(!north.follow(ours, board, 0.01, false));
        }
        assert!((north.offset_rad() - 0.1).abs() < 1e-3);
        let turned = Rot::<E, B>::from_euler_rad(0.0, 0.0, -0.5);
        assert!(north.follow(ours, turned, 0.01, false), "a jump is told once");
        assert!(!north.follow(ours, turned, 0.01, false));
        assert!((north.offset_rad() - 0.1).abs() < 2.1 * RATE_LIMIT_RADPS * 0.01);
        // What lasts is the board's new frame: it is leant in from now on.
        for _ in 0..15 {
            assert!(!north.follow(ours, turned, 0.01, false));
        }
        let next = north.setpoint_for_board(ours);
        assert!((wrap_pi_rad(next.yaw_rad() + 0.5)).abs() < 0.01, "{}", next.yaw_rad());
        let turned = Rot::<E, B>::from_euler_rad(0.0, 0.0, 0.5);
        // Standing it is followed in seconds, and the first setpoint is the board's own heading.
        for _ in 0..600 {
            north.follow(ours, turned, 0.01, true);
        }
        let first = north.setpoint_for_board(ours);
        assert!((wrap_pi_rad(first.yaw_rad() - 0.5)).abs() < 0.01, "{}", first.yaw_rad());
    }
}
