//! Setpoints of an offboard client, per axis position or velocity.

use haltere_dialect::mav::haltere::{
    MavFrame, PositionTargetTypemask as Mask, SET_POSITION_TARGET_GLOBAL_INT_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};

use haltere_dialect::mav::{known, name_of};

use haltere_core::control::{AxisCommand, Command, within_lead_rad};
use haltere_core::estimate::Estimate;
use haltere_core::frames::{B, E, Rot, Vec3, wrap_pi_rad};
use haltere_core::geo::{Geodetic, LocalOrigin};
use haltere_core::time::HostTime;

use super::mission::{LOWEST_M, Volume};
use super::place;
use super::place::{Above, Kind};
use crate::input::LinkId;

/// A velocity towards the edge of the volume is cut so that the vehicle can stop there with this
/// deceleration, m/s²: half of what a tilt of 15 degrees gives, since the loops lag.
const EDGE_BRAKE_MPS2: f64 = 0.7;
/// A point this far beyond a limit was rounded on its way, m.
const ROUNDED_M: f64 = 0.01;
/// Fastest turn that is passed on, rad/s: what the yaw servo of this class can follow.
const YAW_RATE_LIMIT_RADPS: f64 = 2.0;

/// Time constant with which the velocity loop stops, s: that of the closed loop (`control.switch_fade_s`).
const STOP_S: f64 = 0.3;

/// Where a vehicle that is told to stay comes to rest: a point behind that would be flown back to, and a climb that is
/// over would sink.
pub(crate) fn rests_at_E_m(estimate: &Estimate) -> Vec3<E> {
    estimate.pos_E_m + estimate.vel_E_mps() * STOP_S
}

/// One axis of a setpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Axis {
    Position(f64),
    Velocity(f64),
    /// Neither was given: stay at this coordinate.
    Stay(f64),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Yaw {
    Keep,
    Angle(f64),
    Rate(f64),
}

impl Yaw {
    /// A turn by rate that is over ends where the vehicle comes to rest, not where the heading asked for was ahead.
    fn stopped(self, last: Option<&Setpoint>, estimate: &Estimate) -> Self {
        match (self, last.map(|last| last.yaw)) {
            (Yaw::Keep | Yaw::Rate(0.0), Some(Yaw::Rate(before_radps))) if before_radps != 0.0 => {
                let turns_rad = estimate.rate_B_radps.z() * STOP_S;
                Yaw::Angle(wrap_pi_rad(estimate.R_EB.yaw_rad() + turns_rad))
            }
            (yaw, _) => yaw,
        }
    }
}

/// Link, system and component of a client.
pub(crate) type Owner = (LinkId, (u8, u8));

/// What a client wants, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Setpoint {
    /// When its bytes came.
    pub received_at: HostTime,
    /// Since when its sender has sent setpoints without a gap.
    pub since: HostTime,
    /// Who sent it, once it is known.
    pub owner: Option<Owner>,
    axes: [Axis; 3],
    /// Feed-forward where a position comes with a velocity, m/s; else zero.
    feed_mps: [f64; 3],
    /// Velocities turn with the vehicle's heading.
    body_velocity: bool,
    yaw: Yaw,
}

impl Setpoint {
    /// From the wire. Positions in a body frame are taken relative to `estimate`, once.
    ///
    /// `last` is the setpoint in force, if there is one: an axis of which nothing is said stays
    /// where that one held it, else where the vehicle is. Taking the estimate anew with every
    /// message would let it wander with the noise.
    pub fn from_wire(
        message: &SET_POSITION_TARGET_LOCAL_NED_DATA,
        estimate: &Estimate,
        last: Option<&Setpoint>,
        received_at: HostTime,
    ) -> Result<Self, String> {
        let heading = Rot::<E, B>::from_euler_rad(0.0, 0.0, estimate.R_EB.yaw_rad());
        let frame = known(message.coordinate_frame);
        let offset = match frame {
            Some(MavFrame::MAV_FRAME_LOCAL_NED) => None,
            Some(MavFrame::MAV_FRAME_LOCAL_OFFSET_NED) => Some(Rot::<E, B>::identity()),
            Some(
                MavFrame::MAV_FRAME_BODY_NED
                | MavFrame::MAV_FRAME_BODY_OFFSET_NED
                | MavFrame::MAV_FRAME_BODY_FRD,
            ) => Some(heading),
            _ => return Err(frame_refused(message.coordinate_frame)),
        };
        let body_velocity = offset.is_some() && frame != Some(MavFrame::MAV_FRAME_LOCAL_OFFSET_NED);
        let mask = message.type_mask;
        if mask.contains(Mask::POSITION_TARGET_TYPEMASK_FORCE_SET) {
            return Err("setpoint of force not supported".to_owned());
        }
        let wire_pos = [message.x, message.y, message.z].map(f64::from);
        let wire_vel = [message.vx, message.vy, message.vz].map(f64::from);
        let ignore_pos = [
            Mask::POSITION_TARGET_TYPEMASK_X_IGNORE,
            Mask::POSITION_TARGET_TYPEMASK_Y_IGNORE,
            Mask::POSITION_TARGET_TYPEMASK_Z_IGNORE,
        ];
        let ignore_vel = [
            Mask::POSITION_TARGET_TYPEMASK_VX_IGNORE,
            Mask::POSITION_TARGET_TYPEMASK_VY_IGNORE,
            Mask::POSITION_TARGET_TYPEMASK_VZ_IGNORE,
        ];
        let uses_pos = ignore_pos.map(|bit| !mask.contains(bit));
        let uses_vel = ignore_vel.map(|bit| !mask.contains(bit));
        if !uses_pos.iter().chain(&uses_vel).any(|used| *used) {
            return Err("setpoint without position and velocity not supported".to_owned());
        }
        // The body's horizontal axes are not the room's: a direction cannot be split between two
        // loops that work along room axes.
        let turned = uses_pos[0] || uses_pos[1];
        let pushed = (uses_vel[0] && !uses_pos[0]) || (uses_vel[1] && !uses_pos[1]);
        if body_velocity && turned && pushed {
            return Err("setpoint in the body frame: horizontal position and velocity cannot be \
                        mixed"
                .to_owned());
        }
        for axis in 0..3 {
            if (uses_pos[axis] && !wire_pos[axis].is_finite())
                || (uses_vel[axis] && !wire_vel[axis].is_finite())
            {
                return Err("setpoint holds a value that is not a number".to_owned());
            }
        }
        let target_E_m = match offset {
            None => Vec3::<E>::from_array(wire_pos),
            Some(turn) => {
                let zero_unused =
                    std::array::from_fn(|i| if uses_pos[i] { wire_pos[i] } else { 0.0 });
                estimate.pos_E_m + turn * Vec3::<B>::from_array(zero_unused)
            }
        };
        let axes = std::array::from_fn(|i| {
            if uses_pos[i] {
                Axis::Position(target_E_m[i])
            } else if uses_vel[i] && i == 2 && wire_vel[i] == 0.0 {
                // A height, not a climb rate of zero: at 2 m/s the vehicle sank by up to a metre meanwhile.
                Axis::Stay(match last.map(|last| last.axes[i]) {
                    Some(Axis::Stay(x)) => x,
                    _ => rests_at_E_m(estimate)[i],
                })
            } else if uses_vel[i] {
                Axis::Velocity(wire_vel[i])
            } else if body_velocity && i < 2 && turned {
                Axis::Position(target_E_m[i])
            } else if body_velocity && i < 2 && pushed {
                Axis::Velocity(0.0)
            } else {
                match last.map(|last| last.axes[i]) {
                    Some(Axis::Stay(x) | Axis::Position(x)) => Axis::Stay(x),
                    _ => Axis::Stay(rests_at_E_m(estimate)[i]),
                }
            }
        });
        let yaw_angle = f64::from(message.yaw);
        let yaw_rate = f64::from(message.yaw_rate);
        let yaw =
            if !mask.contains(Mask::POSITION_TARGET_TYPEMASK_YAW_IGNORE) && yaw_angle.is_finite() {
                let from_rad = if body_velocity { estimate.R_EB.yaw_rad() } else { 0.0 };
                Yaw::Angle(wrap_pi_rad(from_rad + yaw_angle))
            } else if !mask.contains(Mask::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE)
                && yaw_rate.is_finite()
            {
                Yaw::Rate(yaw_rate.clamp(-YAW_RATE_LIMIT_RADPS, YAW_RATE_LIMIT_RADPS))
            } else {
                Yaw::Keep
            }
            .stopped(last, estimate);
        let feed_mps =
            std::array::from_fn(|i| if uses_pos[i] && uses_vel[i] { wire_vel[i] } else { 0.0 });
        Ok(Self {
            received_at,
            since: received_at,
            owner: None,
            axes,
            feed_mps,
            body_velocity,
            yaw,
        })
    }

    /// From a joystick: velocities along the heading, m/s, and the rate of yaw, rad/s. What is let go
    /// stays where it is, or where `last` held it.
    pub fn from_sticks(
        forward_right_mps: [f64; 2],
        down_mps: f64,
        yaw_rate_radps: f64,
        estimate: &Estimate,
        last: Option<&Setpoint>,
        received_at: HostTime,
    ) -> Self {
        let moves = [forward_right_mps != [0.0; 2], forward_right_mps != [0.0; 2], down_mps != 0.0];
        let wanted_mps = [forward_right_mps[0], forward_right_mps[1], down_mps];
        let axes = std::array::from_fn(|i| {
            if moves[i] {
                Axis::Velocity(wanted_mps[i])
            } else {
                match last.map(|last| last.axes[i]) {
                    Some(Axis::Stay(x)) => Axis::Stay(x),
                    _ => Axis::Stay(rests_at_E_m(estimate)[i]),
                }
            }
        });
        let yaw = if yaw_rate_radps == 0.0 { Yaw::Keep } else { Yaw::Rate(yaw_rate_radps) };
        let yaw = yaw.stopped(last, estimate);
        Self {
            received_at,
            since: received_at,
            owner: None,
            axes,
            feed_mps: [0.0; 3],
            body_velocity: true,
            yaw,
        }
    }

    /// Whether the point that it names lies within the walls and under the ceiling. Below the floor's own
    /// margin it is not refused: many clients begin with a height of zero, and the floor is no wall.
    pub fn check(&self, volume: &Volume) -> Result<(), String> {
        let ranges = [
            ("N", volume.north_m, 1.0),
            ("E", volume.east_m, 1.0),
            ("height", [-f64::INFINITY, volume.height_m], -1.0),
        ];
        for (axis, (name, [low, high], sign)) in self.axes.iter().zip(ranges) {
            let Axis::Position(x) = axis else { continue };
            let x = sign * x;
            if !(low - ROUNDED_M..=high + ROUNDED_M).contains(&x) {
                let from =
                    if low.is_finite() { format!("{low:.2} to ") } else { "up to ".to_owned() };
                return Err(format!(
                    "setpoint refused: {name} {x:.2} m is outside the limits, allowed {from}{high:.2} m"
                ));
            }
        }
        Ok(())
    }

    /// How long ago it came, s.
    pub fn age_s(&self, at: HostTime) -> f64 {
        at.seconds_since(self.received_at)
    }

    /// How far away the point that it names is, seen from above, m.
    pub fn away_m(&self, pos_E_m: Vec3<E>) -> f64 {
        let away = |i: usize| match self.axes[i] {
            Axis::Position(x) => x - pos_E_m[i],
            Axis::Velocity(_) | Axis::Stay(_) => 0.0,
        };
        away(0).hypot(away(1))
    }

    /// The height that it leads to from the floor, m; `least_m` where it names none and wants to rise. `None`: it
    /// stays on the floor.
    pub fn climbs_to_m(&self, least_m: f64) -> Option<f64> {
        match self.axes[2] {
            Axis::Position(down_m) => (-down_m >= LOWEST_M).then_some(-down_m),
            Axis::Velocity(down_mps) => (down_mps < 0.0).then_some(least_m),
            Axis::Stay(_) => None,
        }
    }

    /// Climb rate that it asks for, m/s; zero where it asks for a height or sinks.
    pub fn climb_mps(&self) -> f64 {
        match self.axes[2] {
            Axis::Velocity(down_mps) => (-down_mps).max(0.0),
            Axis::Position(_) | Axis::Stay(_) => 0.0,
        }
    }

    /// A height that was to be kept while the vehicle still took off is that to which it took off, m.
    pub fn took_off(&mut self, height_m: f64) {
        if let Axis::Stay(down_m) = &mut self.axes[2] {
            *down_m = down_m.min(-height_m);
        }
    }

    /// Whether silence must end it: a velocity that nobody renews would fly on for ever, and one
    /// of zero would drift with the noise.
    pub fn needs_stream(&self) -> bool {
        self.axes.iter().any(|axis| matches!(axis, Axis::Velocity(_)))
            || self.feed_mps != [0.0; 3]
            || matches!(self.yaw, Yaw::Rate(r) if r != 0.0)
    }

    /// The command for the controller, kept inside the volume.
    pub fn command(
        &self,
        estimate: &Estimate,
        volume: &Volume,
        yaw_rad: &mut f64,
        dt_s: f64,
    ) -> Command {
        match self.yaw {
            Yaw::Keep => {}
            Yaw::Angle(angle_rad) => *yaw_rad = angle_rad,
            Yaw::Rate(rate_radps) => {
                let now_rad = estimate.R_EB.yaw_rad();
                *yaw_rad = within_lead_rad(*yaw_rad + rate_radps * dt_s, now_rad);
            }
        }
        let asked_vel = Vec3::<B>::from_array(self.axes.map(|axis| match axis {
            Axis::Velocity(v) => v,
            Axis::Position(_) | Axis::Stay(_) => 0.0,
        }));
        let vel_E_mps = if self.body_velocity {
            Rot::<E, B>::from_euler_rad(0.0, 0.0, estimate.R_EB.yaw_rad()) * asked_vel
        } else {
            Vec3::from_raw(asked_vel.raw())
        };
        let feed = if self.body_velocity {
            let heading = Rot::<E, B>::from_euler_rad(0.0, 0.0, estimate.R_EB.yaw_rad());
            heading * Vec3::<B>::from_array(self.feed_mps)
        } else {
            Vec3::from_array(self.feed_mps)
        };
        // A feed-forward may not push out of the volume either.
        let vel_ff_E_mps = Vec3::from_array(std::array::from_fn(|i| {
            let way_m = volume.way_to_edge_m(i, estimate.pos_E_m[i], feed[i]);
            let limit_mps = (2.0 * EDGE_BRAKE_MPS2 * way_m).sqrt();
            feed[i].clamp(-limit_mps, limit_mps)
        }));
        let inside = volume.clamp(estimate.pos_E_m);
        let axes = std::array::from_fn(|i| match self.axes[i] {
            Axis::Position(x) | Axis::Stay(x) => {
                let mut at = estimate.pos_E_m.to_array();
                at[i] = x;
                AxisCommand::Position_m(volume.clamp(Vec3::from_array(at))[i])
            }
            Axis::Velocity(_) => {
                let beyond = estimate.pos_E_m[i] - inside[i];
                if beyond != 0.0 && beyond.signum() == vel_E_mps[i].signum() {
                    AxisCommand::Position_m(inside[i])
                } else {
                    let way_m = volume.way_to_edge_m(i, estimate.pos_E_m[i], vel_E_mps[i]);
                    let limit_mps = (2.0 * EDGE_BRAKE_MPS2 * way_m).sqrt();
                    AxisCommand::Velocity_mps(vel_E_mps[i].clamp(-limit_mps, limit_mps))
                }
            }
        });
        Command { axes, vel_ff_E_mps, yaw_rad: *yaw_rad }
    }
}

fn frame_refused(frame: u8) -> String {
    format!("setpoint frame {} not supported", name_of::<MavFrame>(frame))
}

/// A setpoint in a global frame as one in the room, through the place of its origin.
pub(crate) fn setpoint_from_global(
    m: &SET_POSITION_TARGET_GLOBAL_INT_DATA,
    origin: &LocalOrigin,
) -> Result<SET_POSITION_TARGET_LOCAL_NED_DATA, String> {
    let above = match place::kind(m.coordinate_frame) {
        Some(Kind::Global(above)) => above,
        _ => return Err(frame_refused(m.coordinate_frame)),
    };
    let both = |a: Mask, b: Mask| m.type_mask.contains(a) == m.type_mask.contains(b);
    // Room axes are not north and east.
    if !both(Mask::POSITION_TARGET_TYPEMASK_X_IGNORE, Mask::POSITION_TARGET_TYPEMASK_Y_IGNORE)
        || !both(Mask::POSITION_TARGET_TYPEMASK_VX_IGNORE, Mask::POSITION_TARGET_TYPEMASK_VY_IGNORE)
    {
        return Err("setpoint in a global frame: give both horizontal axes or none".to_owned());
    }
    let alt_m = origin.place().alt_m;
    // Where the point is not used, its fields may hold anything.
    let [x, y] = match Geodetic::from_e7(m.lat_int, m.lon_int, alt_m) {
        Some(place) => {
            let pos = origin.to_local(&place);
            [pos.x(), pos.y()].map(|v| v as f32)
        }
        None => [f32::NAN; 2],
    };
    let height_m = match above {
        Above::Floor => f64::from(m.alt),
        Above::Sea => f64::from(m.alt) - alt_m,
    };
    let vel = origin.from_true_north([f64::from(m.vx), f64::from(m.vy), f64::from(m.vz)]);
    let [vx, vy] = [vel.x(), vel.y()].map(|v| v as f32);
    let yaw = f64::from(m.yaw);
    Ok(SET_POSITION_TARGET_LOCAL_NED_DATA {
        time_boot_ms: m.time_boot_ms,
        x,
        y,
        z: -height_m as f32,
        vx,
        vy,
        vz: m.vz,
        afx: m.afx,
        afy: m.afy,
        afz: m.afz,
        yaw: if yaw.is_finite() { origin.room_yaw_rad(yaw) as f32 } else { m.yaw },
        yaw_rate: m.yaw_rate,
        type_mask: m.type_mask,
        target_system: m.target_system,
        target_component: m.target_component,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::estimate::Health;
    use std::f64::consts::FRAC_PI_2;

    const VOLUME: Volume = Volume { north_m: [-5.0, 5.0], east_m: [-5.0, 5.0], height_m: 3.0 };

    fn estimate(pos_E_m: [f64; 3], yaw_rad: f64) -> Estimate {
        Estimate {
            at: HostTime::default(),
            pos_E_m: Vec3::from_array(pos_E_m),
            vel_B_mps: Vec3::zero(),
            R_EB: Rot::from_euler_rad(0.0, 0.0, yaw_rad),
            rate_B_radps: Vec3::zero(),
            std_pos_E_m: Vec3::zero(),
            std_vel_B_mps: Vec3::zero(),
            std_att_B_rad: Vec3::zero(),
            uwb_noise_factor: 1.0,
            health: Health::Good,
        }
    }

    fn wire(
        frame: MavFrame,
        mask: u16,
        pos: [f32; 3],
        vel: [f32; 3],
    ) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
        SET_POSITION_TARGET_LOCAL_NED_DATA {
            coordinate_frame: frame as u8,
            type_mask: Mask::from_bits_retain(mask),
            x: pos[0],
            y: pos[1],
            z: pos[2],
            vx: vel[0],
            vy: vel[1],
            vz: vel[2],
            ..Default::default()
        }
    }

    fn command(setpoint: &Setpoint, estimate: &Estimate) -> [AxisCommand; 3] {
        let mut yaw_rad = 0.0;
        setpoint.command(estimate, &VOLUME, &mut yaw_rad, 0.01).axes
    }

    fn near(got: AxisCommand, want: AxisCommand) -> bool {
        match (got, want) {
            (AxisCommand::Position_m(a), AxisCommand::Position_m(b))
            | (AxisCommand::Velocity_mps(a), AxisCommand::Velocity_mps(b)) => (a - b).abs() < 1e-6,
            _ => false,
        }
    }

    use AxisCommand::{Position_m as Pos, Velocity_mps as Vel};

    /// type_mask bits: 1 2 4 position, 8 16 32 velocity, 64.. acceleration, 1024 yaw, 2048 rate.
    #[test]
    fn prop_masks_choose_per_axis() {
        let here = estimate([1.0, 2.0, -1.5], 0.3);
        let check = |mask: u16, want: [AxisCommand; 3]| {
            let m = wire(
                MavFrame::MAV_FRAME_LOCAL_NED,
                mask | 0x1C0 | 0xC00,
                [0.5, -0.5, -1.0],
                [0.1, -0.2, 0.3],
            );
            let setpoint = Setpoint::from_wire(&m, &here, None, here.at).unwrap();
            let got = command(&setpoint, &here);
            assert!(got.iter().zip(want).all(|(g, w)| near(*g, w)), "{mask:#x}: {got:?} {want:?}");
        };
        check(0b111_000, [Pos(0.5), Pos(-0.5), Pos(-1.0)]);
        check(0b000_111, [Vel(0.1), Vel(-0.2), Vel(0.3)]);
        check(0b100_011, [Vel(0.1), Vel(-0.2), Pos(-1.0)]);
        check(0b010_101, [Vel(0.1), Pos(-0.5), Vel(0.3)]);
        check(0b011_100, [Pos(0.5), Pos(-0.5), Vel(0.3)]);
        // Position wins where both are given; where neither is, it stays.
        check(0b000_000, [Pos(0.5), Pos(-0.5), Pos(-1.0)]);
        check(0b110_110, [Pos(0.5), Pos(2.0), Pos(-1.5)]);
    }

    #[test]
    fn regress_an_axis_without_a_word_does_not_wander() {
        let m = wire(MavFrame::MAV_FRAME_LOCAL_NED, 0x1C0 | 0xC00 | 0b100_111, [0.0; 3], [0.2; 3]);
        let first =
            Setpoint::from_wire(&m, &estimate([0.0, 0.0, -1.0], 0.0), None, HostTime::default());
        let first = first.unwrap();
        let sunk = estimate([0.1, 0.1, -0.9], 0.0);
        let next = Setpoint::from_wire(&m, &sunk, Some(&first), HostTime::default()).unwrap();
        assert!(near(command(&next, &sunk)[2], Pos(-1.0)));
    }

    /// A client that asks for a level flight keeps its height: at 2 m/s it sank onto the floor.
    #[test]
    fn regress_a_climb_rate_of_zero_holds_the_height() {
        let level = wire(MavFrame::MAV_FRAME_LOCAL_NED, 0xDC7, [0.0; 3], [2.0, 0.0, 0.0]);
        let high = estimate([0.0, 0.0, -1.0], 0.0);
        let sunk = estimate([1.0, 0.0, -0.8], 0.0);
        let first = Setpoint::from_wire(&level, &high, None, high.at).unwrap();
        let next = Setpoint::from_wire(&level, &sunk, Some(&first), sunk.at).unwrap();
        assert!(near(command(&next, &sunk)[2], Pos(-1.0)) && next.needs_stream());
        // It is the height at which the climb ended.
        let up = wire(MavFrame::MAV_FRAME_LOCAL_NED, 0xDC7, [0.0; 3], [0.0, 0.0, -0.5]);
        let climbs = Setpoint::from_wire(&up, &high, Some(&next), high.at).unwrap();
        assert!(near(command(&climbs, &high)[2], Vel(-0.5)));
        let ended = Setpoint::from_wire(&level, &sunk, Some(&climbs), sunk.at).unwrap();
        assert!(near(command(&ended, &sunk)[2], Pos(-0.8)));
    }

    #[test]
    fn regress_forward_in_the_body_frame_is_not_cut_to_a_room_axis() {
        // Heading east: forward is room east, although only the body's x is given.
        let here = estimate([0.0, 0.0, -1.0], FRAC_PI_2);
        let mask = 0x1C0 | 0xC00 | 0b110_111;
        let m = wire(MavFrame::MAV_FRAME_BODY_NED, mask, [0.0; 3], [0.4, 0.0, 0.0]);
        let setpoint = Setpoint::from_wire(&m, &here, None, here.at).unwrap();
        let axes = command(&setpoint, &here);
        assert!(near(axes[0], Vel(0.0)) && near(axes[1], Vel(0.4)), "{axes:?}");
        assert!(near(axes[2], Pos(-1.0)), "{axes:?}");
        // The same with a position.
        let mask = 0x1C0 | 0xC00 | 0b111_110;
        let m = wire(MavFrame::MAV_FRAME_BODY_NED, mask, [0.4, 0.0, 0.0], [0.0; 3]);
        let axes = command(&Setpoint::from_wire(&m, &here, None, here.at).unwrap(), &here);
        assert!(near(axes[0], Pos(0.0)) && near(axes[1], Pos(0.4)), "{axes:?}");
        // A mixture cannot be said in room axes.
        let m = wire(MavFrame::MAV_FRAME_BODY_NED, 0x1C0 | 0xC00 | 0b101_110, [0.4; 3], [0.1; 3]);
        assert!(Setpoint::from_wire(&m, &here, None, here.at).is_err());
    }

    #[test]
    fn prop_the_edge_of_the_volume_stops_velocities() {
        let m = wire(
            MavFrame::MAV_FRAME_LOCAL_NED,
            0x1C0 | 0xC00 | 0b000_111,
            [0.0; 3],
            [1.5, 0.0, 1.0],
        );
        let setpoint = Setpoint::from_wire(&m, &estimate([0.0; 3], 0.0), None, HostTime::default());
        let setpoint = setpoint.unwrap();
        let north_mps = |x: f64| match command(&setpoint, &estimate([x, 0.0, -1.0], 0.0))[0] {
            Vel(v) => v,
            Pos(p) => panic!("{p}"),
        };
        assert_eq!(north_mps(0.0), 1.5);
        assert!(north_mps(4.9) < 0.4 && north_mps(4.99) < 0.15);
        let beyond = command(&setpoint, &estimate([5.1, 0.0, -0.1], 0.0));
        assert!(
            near(beyond[0], Pos(5.0)) && near(beyond[2], Pos(-super::super::mission::LOWEST_M))
        );
    }

    #[test]
    fn prop_nonsense_is_refused() {
        let here = estimate([0.0; 3], 0.0);
        let refused = |m: SET_POSITION_TARGET_LOCAL_NED_DATA| {
            Setpoint::from_wire(&m, &here, None, here.at).is_err()
        };
        let local = MavFrame::MAV_FRAME_LOCAL_NED;
        assert!(refused(wire(local, 0xC3F, [0.0; 3], [0.0; 3])), "acceleration only");
        assert!(refused(wire(local, 0xFC0 | 0b111_000, [f32::NAN; 3], [0.0; 3])));
        assert!(refused(wire(local, 0xFC0 | 0b000_111, [0.0; 3], [f32::INFINITY; 3])));
        assert!(refused(wire(local, 0xFC0 | 0x200, [0.0; 3], [0.0; 3])), "force");
        assert!(refused(wire(MavFrame::MAV_FRAME_GLOBAL_INT, 0xFF8, [0.0; 3], [0.0; 3])));
    }

    #[test]
    fn prop_every_mask_in_every_frame_is_followed_or_refused_by_rule() {
        use MavFrame as F;
        let here = estimate([1.0, 2.0, -1.0], 0.7);
        let frames = [
            F::MAV_FRAME_LOCAL_NED,
            F::MAV_FRAME_LOCAL_OFFSET_NED,
            F::MAV_FRAME_BODY_NED,
            F::MAV_FRAME_BODY_OFFSET_NED,
            F::MAV_FRAME_BODY_FRD,
            F::MAV_FRAME_LOCAL_ENU,
            F::MAV_FRAME_GLOBAL_INT,
        ];
        let (mut followed, mut refused) = (0, 0);
        for (number, frame) in frames.into_iter().enumerate() {
            for bits in 0..4096_u16 {
                let m = wire(frame, bits, [0.1; 3], [0.2; 3]);
                let used = |bit: u16| bits & bit == 0;
                let (pos, vel) = ([used(1), used(2), used(4)], [used(8), used(16), used(32)]);
                let body = (2..=4).contains(&number);
                let push = (vel[0] && !pos[0]) || (vel[1] && !pos[1]);
                let mixed = body && (pos[0] || pos[1]) && push;
                let none = !pos.iter().chain(&vel).any(|u| *u);
                let rule = number < 5 && bits & 0x200 == 0 && !none && !mixed;
                let setpoint = Setpoint::from_wire(&m, &here, None, here.at);
                assert_eq!(setpoint.is_ok(), rule, "{frame:?} {bits:#x}");
                let Ok(setpoint) = setpoint else {
                    refused += 1;
                    continue;
                };
                followed += 1;
                // Only positions outlive their sender.
                assert_eq!(setpoint.needs_stream(), vel.contains(&true), "{frame:?} {bits:#x}");
                let axes = command(&setpoint, &here);
                for (i, axis) in axes.into_iter().enumerate() {
                    let (Pos(value) | Vel(value)) = axis;
                    assert!(value.is_finite());
                    assert!(!pos[i] || body || matches!(axis, Pos(_)), "{frame:?} {bits:#x}");
                }
            }
        }
        println!("{followed} followed, {refused} refused");
    }

    #[test]
    fn prop_global_setpoints_are_those_of_the_room() {
        use haltere_core::geo::{Geodetic, LocalOrigin};
        let place = Geodetic::from_deg(51.99, 4.37, 2.0).unwrap();
        // Room north is east.
        let origin = LocalOrigin::new(place, FRAC_PI_2).unwrap();
        let there = origin.to_global(Vec3::new(3.0, -2.0, -1.5)).to_e7();
        let global = |frame: MavFrame, alt, mask| {
            let m = SET_POSITION_TARGET_GLOBAL_INT_DATA {
                coordinate_frame: frame as u8,
                type_mask: Mask::from_bits_truncate(mask),
                lat_int: there[0],
                lon_int: there[1],
                alt,
                vx: 1.0, // north
                yaw: 0.0,
                ..Default::default()
            };
            setpoint_from_global(&m, &origin)
        };
        for (frame, alt) in [
            (MavFrame::MAV_FRAME_GLOBAL_INT, 3.5),
            (MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 1.5),
            (MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT_INT, 1.5),
        ] {
            let local = global(frame, alt, 0xDC0).unwrap();
            assert!((local.x - 3.0).abs() < 0.02 && (local.y + 2.0).abs() < 0.02, "{local:?}");
            assert!((local.z + 1.5).abs() < 1e-5, "{local:?}");
            // True north is room west; facing it is a quarter turn to the left of room north.
            assert!((local.vy + 1.0).abs() < 1e-6 && local.vx.abs() < 1e-6, "{local:?}");
            assert!((f64::from(local.yaw) + FRAC_PI_2).abs() < 1e-6);
        }
        assert!(global(MavFrame::MAV_FRAME_LOCAL_NED, 1.0, 0xDF8).is_err());
        // One horizontal axis alone is none of the room's.
        assert!(global(MavFrame::MAV_FRAME_GLOBAL_INT, 1.0, 0xDF9).is_err());
    }
}
