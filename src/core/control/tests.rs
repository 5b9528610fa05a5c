//! Laws of one controller: signs, symmetry, limits, anti-windup, switching, bad input.

use std::f64::consts::FRAC_PI_2;

use proptest::prelude::*;

use super::config::{LimitsConfig, TrimConfig};
use super::*;
use crate::checks::Problems;
use crate::estimate::Health;
use crate::frames::wrap_pi_rad;

const DT_S: f64 = 0.01;

/// At this place, with this velocity over ground and this attitude.
pub(super) fn estimate(pos_E_m: [f64; 3], vel_E_mps: [f64; 3], euler_rad: [f64; 3]) -> Estimate {
    let [roll, pitch, yaw] = euler_rad;
    let R_EB = Rot::<E, B>::from_euler_rad(roll, pitch, yaw);
    Estimate {
        at: HostTime::default(),
        pos_E_m: Vec3::from_array(pos_E_m),
        vel_B_mps: R_EB.inverse() * Vec3::from_array(vel_E_mps),
        R_EB,
        rate_B_radps: Vec3::zero(),
        std_pos_E_m: Vec3::zero(),
        std_vel_B_mps: Vec3::zero(),
        std_att_B_rad: Vec3::zero(),
        uwb_noise_factor: 1.0,
        health: Health::Good,
    }
}

/// A flying input at nominal voltage and out of ground effect.
pub(super) fn input<'a>(estimate: &'a Estimate, command: &'a Command) -> ControlInput<'a> {
    ControlInput {
        at: estimate.at,
        estimate,
        command,
        supply_v: Some(7.4),
        height_above_ground_m: 5.0,
        dt_s: DT_S,
        integrators_frozen: false,
        thrust_ceiling_frac: 1.0,
        held: None,
    }
}

fn config(version: Version) -> ControlConfig {
    ControlConfig { version, ..Default::default() }
}

fn first_step(version: Version, estimate: &Estimate, command: &Command) -> ControlOutput {
    Controller::new(config(version)).step(&input(estimate, command))
}

fn velocity(v_E_mps: [f64; 3]) -> Command {
    Command {
        axes: v_E_mps.map(AxisCommand::Velocity_mps),
        vel_ff_E_mps: Vec3::zero(),
        yaw_rad: 0.0,
    }
}

#[test]
fn prop_hover_on_the_spot_asks_for_level_and_base_thrust() {
    let here = estimate([1.0, 2.0, -1.5], [0.0; 3], [0.0; 3]);
    let command = Command::hold(here.pos_E_m, 0.0);
    for version in [Version::Raw, Version::Modified] {
        let out = first_step(version, &here, &command);
        assert!(out.roll_rad.abs() + out.pitch_rad.abs() + out.yaw_rad.abs() < 1e-12);
        assert!((out.thrust_frac - 0.6392).abs() < 1e-3, "{}", out.thrust_frac);
        assert!(out.record.saturation == Default::default() && !out.blind);
    }
}

#[test]
fn prop_signs_of_every_axis() {
    let here = estimate([0.0, 0.0, -1.5], [0.0; 3], [0.0; 3]);
    for version in [Version::Raw, Version::Modified] {
        let toward = |v| first_step(version, &here, &velocity(v));
        // North is ahead: nose down. East is right: right wing down. Up is −z: more thrust.
        assert!(toward([0.5, 0.0, 0.0]).pitch_rad < -0.05);
        assert!(toward([0.5, 0.0, 0.0]).roll_rad.abs() < 1e-12);
        assert!(toward([0.0, 0.5, 0.0]).roll_rad > 0.05);
        assert!(toward([0.0, 0.5, 0.0]).pitch_rad.abs() < 1e-12);
        assert!(toward([0.0, 0.0, -0.5]).thrust_frac > 0.7);
        assert!(toward([0.0, 0.0, 0.5]).thrust_frac < 0.6);
        // The same through the position loop.
        let to = |p| first_step(version, &here, &Command::hold(Vec3::from_array(p), 0.0));
        assert!(to([0.5, 0.0, -1.5]).pitch_rad < -0.05);
        assert!(to([0.0, 0.5, -1.5]).roll_rad > 0.05);
        assert!(to([0.0, 0.0, -2.0]).thrust_frac > 0.7);
    }
    // The thrust axis itself points where the force is wanted.
    let R_EB = first_step(Version::Raw, &here, &velocity([0.4, 0.2, 0.0])).R_EB;
    let force = R_EB * Vec3::<B>::new(0.0, 0.0, -1.0);
    assert!(force.x() > 0.05 && force.y() > 0.02 && force.z() < 0.0);
}

#[test]
fn prop_heading_east_turns_the_axes() {
    let facing_east = estimate([0.0, 0.0, -1.5], [0.0; 3], [0.0, 0.0, FRAC_PI_2]);
    let command = |v| Command { yaw_rad: FRAC_PI_2, ..velocity(v) };
    // East is ahead, north is to the left.
    let east = first_step(Version::Raw, &facing_east, &command([0.0, 0.5, 0.0]));
    assert!(east.pitch_rad < -0.05 && east.roll_rad.abs() < 1e-9);
    let north = first_step(Version::Raw, &facing_east, &command([0.5, 0.0, 0.0]));
    assert!(north.roll_rad < -0.05 && north.pitch_rad.abs() < 1e-9);
}

#[test]
fn prop_thrust_axis_points_the_same_way_while_the_yaw_setpoint_is_elsewhere() {
    let here = estimate([0.0, 0.0, -1.5], [0.0; 3], [0.0; 3]);
    let command = velocity([0.3, 0.1, 0.0]);
    let from = Handover { roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.5, thrust_frac: 0.64 };
    let mut controller = Controller::new(config(Version::Raw));
    controller.reset(Some(&from));
    // The yaw setpoint is held ahead; no integrators, and time for the handover to fade.
    let command = Command { yaw_rad: 0.5, ..command };
    let still = ControlInput { integrators_frozen: true, ..input(&here, &command) };
    let mut out = controller.step(&still);
    for _ in 0..400 {
        out = controller.step(&still);
    }
    assert!((out.yaw_rad - 0.5).abs() < 1e-9);
    let straight = first_step(Version::Raw, &here, &Command { yaw_rad: 0.0, ..command }).R_EB;
    let down = Vec3::<B>::new(0.0, 0.0, -1.0);
    let (f, g) = (out.R_EB * down, straight * down);
    // Euler angles are not additive: agreement to second order of a lean of 0.1 rad.
    assert!((f - g).norm() < 2e-3, "{f:?} {g:?}");
}

#[test]
fn prop_yaw_follows_the_short_way_at_its_rate_and_ignores_nan() {
    let here = estimate([0.0; 3], [0.0; 3], [0.0, 0.0, 3.0]);
    let mut controller = Controller::new(config(Version::Modified));
    let mut command = Command::hold(here.pos_E_m, -3.0);
    let mut before = 3.0;
    for step in 0..100 {
        let yaw = controller.step(&input(&here, &command)).yaw_rad;
        let turn = wrap_pi_rad(yaw - before);
        assert!((-1e-12..=60f64.to_radians() * DT_S + 1e-12).contains(&turn), "step {step}");
        before = yaw;
    }
    assert!((before + 3.0).abs() < 1e-9, "{before}");
    command.yaw_rad = f64::NAN;
    assert!((controller.step(&input(&here, &command)).yaw_rad + 3.0).abs() < 1e-9);
}

#[test]
fn prop_feed_forward_is_the_law_of_the_setpoint_and_raw_has_none() {
    let here = estimate([0.0, 0.0, -1.5], [0.0; 3], [0.0; 3]);
    let command = velocity([1.0, 1.0, 0.0]);
    let mut modified = Controller::new(config(Version::Modified));
    let mut raw = Controller::new(config(Version::Raw));
    let mut m = modified.step(&input(&here, &command));
    let mut r = raw.step(&input(&here, &command));
    let mut before = m.record.pitch_ff_rad;
    let mut largest_step = before.abs();
    for _ in 0..200 {
        m = modified.step(&input(&here, &command));
        r = raw.step(&input(&here, &command));
        largest_step = largest_step.max((m.record.pitch_ff_rad - before).abs());
        before = m.record.pitch_ff_rad;
    }
    assert!((m.record.pitch_ff_rad.to_degrees() + 23.326).abs() < 0.01);
    assert!((m.record.roll_ff_rad.to_degrees() - 11.129).abs() < 0.01);
    assert_eq!((r.record.pitch_ff_rad, r.record.roll_ff_rad), (0.0, 0.0));
    // The low-pass: a step of 1 m/s must not throw 23° in one period.
    assert!(largest_step.to_degrees() < 3.0, "{}", largest_step.to_degrees());
}

#[test]
fn prop_voltage_and_ground_act_on_thrust_in_modified_only() {
    let here = estimate([0.0; 3], [0.0; 3], [0.0; 3]);
    let command = Command::hold(here.pos_E_m, 0.0);
    let thrust = |version, supply_v, height_above_ground_m| {
        let case = ControlInput { supply_v, height_above_ground_m, ..input(&here, &command) };
        Controller::new(config(version)).step(&case)
    };
    let full = thrust(Version::Modified, Some(8.2), 5.0);
    let low = thrust(Version::Modified, Some(6.6), 5.0);
    assert!((full.thrust_frac * 8.2 / (low.thrust_frac * 6.6) - 1.0).abs() < 0.002);
    let near = thrust(Version::Modified, Some(7.4), 0.33);
    let far = thrust(Version::Modified, Some(7.4), 5.0);
    assert!((near.thrust_frac / far.thrust_frac - 0.921).abs() < 1e-3);
    assert!((near.record.ground_factor - 0.921).abs() < 1e-3);
    let raw = [(Some(8.2), 5.0), (Some(6.6), 0.33), (None, f64::NAN)]
        .map(|(v, h)| thrust(Version::Raw, v, h).thrust_frac);
    assert_eq!(raw[0], raw[1]);
    assert_eq!(raw[0], raw[2]);
    assert_eq!(thrust(Version::Modified, None, 5.0).supply, SupplyQuality::Nominal);
    assert_eq!(thrust(Version::Modified, Some(f64::NAN), 5.0).thrust_frac, far.thrust_frac);
}

#[test]
fn val_tilt_compensation_is_the_vertical_balance() {
    // Standing still and tilted by 20°: 1/cos. In steady flight at the speed that the lean holds:
    // cos, from g·cos θ = thrust along the tilted axis with drag along body x.
    let pitch = -(20f64.to_radians());
    let speed_u = crate::frames::G_MPS2 * 20f64.to_radians().sin() / 4.2;
    let thrust = |tilt_compensation, vel_B_mps| {
        let mut here = estimate([0.0; 3], [0.0; 3], [0.0, pitch, 0.0]);
        here.vel_B_mps = vel_B_mps;
        let vel_E_mps = here.vel_E_mps().to_array();
        let c = ControlConfig { tilt_compensation, ..config(Version::Raw) };
        let out = Controller::new(c).step(&input(&here, &velocity(vel_E_mps)));
        out.thrust_frac / out.record.thrust_base_frac
    };
    let flying = Vec3::new(speed_u, 0.0, 0.0);
    let cos = 20f64.to_radians().cos();
    for (kind, at_rest, in_flight) in [
        (TiltCompensation::Off, 1.0, 1.0),
        (TiltCompensation::Geometric, 1.0 / cos, 1.0 / cos),
        (TiltCompensation::DragAware, 1.0 / cos, cos),
    ] {
        assert!((thrust(Some(kind), Vec3::zero()) - at_rest).abs() < 1e-9, "{kind:?}");
        assert!((thrust(Some(kind), flying) - in_flight).abs() < 0.005, "{kind:?}");
    }
}

#[test]
fn prop_trims_are_added_to_the_setpoint() {
    let here = estimate([0.0; 3], [0.0; 3], [0.0; 3]);
    let trims = TrimConfig { roll_deg: 2.0, pitch_deg: -3.0, yaw_deg: 5.0 };
    let mut controller = Controller::new(ControlConfig { trims, ..Default::default() });
    let out = controller.step(&input(&here, &Command::hold(here.pos_E_m, 0.0)));
    assert!((out.roll_rad.to_degrees() - 2.0).abs() < 1e-9);
    assert!((out.pitch_rad.to_degrees() + 3.0).abs() < 1e-9);
    assert!((out.yaw_rad.to_degrees() - 5.0).abs() < 1e-9);
}

#[test]
fn prop_tilt_limit_is_a_vector_and_integrators_come_back_at_once() {
    let here = estimate([0.0; 3], [0.0; 3], [0.0; 3]);
    let mut controller = Controller::new(config(Version::Modified));
    let blocked = velocity([2.0, 2.0, -1.0]);
    for _ in 0..1000 {
        // Ten seconds held fast: everything is cut.
        let out = controller.step(&input(&here, &blocked));
        let limit_deg = controller.config().limits.tilt_deg;
        assert!(out.roll_rad.hypot(out.pitch_rad) <= limit_deg.to_radians() + 1e-12);
    }
    let out = controller.step(&input(&here, &blocked));
    assert!(out.record.saturation.tilt && out.record.saturation.velocity);
    assert!(out.record.saturation.thrust_high);
    let [x, y] = controller.lean_integral_rad();
    assert!(x.abs() < 0.05 && y.abs() < 0.05, "wound up: {x} {y}");
    // Stop: within half a second nothing of the push is left beyond what the law asks for.
    let mut out = out;
    for _ in 0..50 {
        out = controller.step(&input(&here, &velocity([0.0; 3])));
    }
    assert!(out.pitch_rad.abs() < 0.06 && out.roll_rad.abs() < 0.06, "{out:?}");
    assert!(!out.record.saturation.thrust_high && out.thrust_frac < 0.92, "{out:?}");
}

#[test]
fn prop_switching_an_axis_between_position_and_velocity_is_bumpless() {
    // Flying at 0.6 m/s on x, 1 m from the commanded place, with every integrator in use.
    let moving = estimate([0.0, 0.0, -1.5], [0.6, -0.2, 0.1], [0.0; 3]);
    let position = Command::hold(Vec3::new(0.5, -0.2, -1.6), 0.0);
    for version in [Version::Raw, Version::Modified] {
        for axis in 0..3 {
            let gains = ControlGains { pos_z_i_per_s2: 0.3, ..Default::default() };
            let mut controller = Controller::new(ControlConfig { gains, ..config(version) });
            let mut before = controller.step(&input(&moving, &position));
            for _ in 0..20 {
                before = controller.step(&input(&moving, &position));
            }
            let mut switched = position;
            switched.axes[axis] = AxisCommand::Velocity_mps(-0.9);
            for command in [switched, position, switched] {
                let after = controller.step(&input(&moving, &command));
                let jump =
                    (after.record.vel_setpoint_E_mps - before.record.vel_setpoint_E_mps).norm();
                // One period of the fade of at most 2 m/s: 0.01/0.31 of it.
                assert!(jump < 0.065, "axis {axis}: {jump} m/s");
                assert!((after.pitch_rad - before.pitch_rad).abs() < 0.05);
                assert!((after.roll_rad - before.roll_rad).abs() < 0.05);
                assert!((after.thrust_frac - before.thrust_frac).abs() < 0.02);
                before = after;
            }
            // And the new command is obeyed in the end.
            for _ in 0..300 {
                before = controller.step(&input(&moving, &switched));
            }
            assert!((before.record.vel_setpoint_E_mps[axis] + 0.9).abs() < 1e-3);
            assert_eq!(before.record.pos_setpoint_E_m[axis], None);
        }
    }
}

#[test]
fn prop_handover_continues_from_the_old_output_and_fades() {
    let here = estimate([0.0, 0.0, -1.0], [0.3, 0.0, 0.0], [0.0, 0.0, 0.4]);
    let command = Command { yaw_rad: 0.4, ..Command::hold(Vec3::new(1.0, 0.0, -1.5), 0.4) };
    let from = Handover { roll_rad: 0.1, pitch_rad: 0.2, yaw_rad: 0.5, thrust_frac: 0.5 };
    let mut controller = Controller::new(config(Version::Modified));
    controller.reset(Some(&from));
    let first = controller.step(&input(&here, &command));
    assert!((first.roll_rad - 0.1).abs() < 1e-2 && (first.pitch_rad - 0.2).abs() < 1e-2);
    assert!((first.yaw_rad - 0.5).abs() < 0.02 && (first.thrust_frac - 0.5).abs() < 1e-9);
    let mut out = first;
    for _ in 0..60 {
        out = controller.step(&input(&here, &command));
    }
    assert!(out.pitch_rad < -0.1 && out.thrust_frac > 0.64);
    // A handover that is no number is none.
    controller.reset(Some(&Handover { roll_rad: f64::NAN, ..from }));
    assert!(controller.step(&input(&here, &command)).pitch_rad < 0.0);
}

#[test]
fn prop_ceiling_spools_up_and_frozen_integrators_stay() {
    let here = estimate([0.0; 3], [0.0; 3], [0.0; 3]);
    let command = Command::hold(Vec3::new(0.3, 0.0, -1.2), 0.0);
    let mut controller = Controller::new(config(Version::Modified));
    for step in 0..=100 {
        let ceiling = f64::from(step) * 0.01;
        let out = controller.step(&ControlInput {
            thrust_ceiling_frac: ceiling,
            integrators_frozen: true,
            ..input(&here, &command)
        });
        assert!(out.thrust_frac <= ceiling);
        assert!((out.thrust_frac - ceiling).abs() < 1e-12 || out.thrust_frac > 0.64);
    }
    assert_eq!(controller.lean_integral_rad(), [0.0; 2]);
    let nan = ControlInput { thrust_ceiling_frac: f64::NAN, ..input(&here, &command) };
    assert!(controller.step(&nan).thrust_frac > 0.64, "the last good ceiling holds");
    let mut fresh = Controller::new(config(Version::Modified));
    assert_eq!(fresh.step(&nan).thrust_frac, 0.0, "no ceiling known: motors stay off");
}

#[test]
fn prop_blind_steps_hold_the_integrators_and_recover() {
    let here = estimate([0.0; 3], [-0.2, 0.0, 0.0], [0.0; 3]);
    let command = velocity([0.0; 3]);
    let mut controller = Controller::new(config(Version::Modified));
    for _ in 0..100 {
        controller.step(&input(&here, &command));
    }
    let [held, _] = controller.lean_integral_rad();
    assert!(held > 0.05);
    let mut lost = here;
    lost.pos_E_m = Vec3::new(f64::NAN, 0.0, 0.0);
    let out = controller.step(&input(&lost, &command));
    assert!(out.blind && (out.pitch_rad + held).abs() < 1e-12);
    assert!((out.thrust_frac - 0.639).abs() < 0.01);
    assert!(!controller.step(&input(&here, &command)).blind);
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![prop::num::f64::ANY, -3.0..3.0f64]
}

fn any_estimate() -> impl Strategy<Value = Estimate> {
    (
        prop::array::uniform3(any_number()),
        prop::array::uniform3(any_number()),
        prop::array::uniform4(any_number()),
    )
        .prop_map(|(pos, vel, q)| {
            let raw = nalgebra::Quaternion::new(q[0], q[1], q[2], q[3]);
            Estimate {
                pos_E_m: Vec3::from_array(pos),
                vel_B_mps: Vec3::from_array(vel),
                // Not normalised on purpose: a broken filter may say so.
                R_EB: Rot::from_raw(nalgebra::UnitQuaternion::new_unchecked(raw)),
                ..estimate([0.0; 3], [0.0; 3], [0.0; 3])
            }
        })
}

fn any_command() -> impl Strategy<Value = Command> {
    let axis = (any_number(), any::<bool>()).prop_map(|(v, position)| {
        if position { AxisCommand::Position_m(v) } else { AxisCommand::Velocity_mps(v) }
    });
    (prop::array::uniform3(axis), prop::array::uniform3(any_number()), any_number()).prop_map(
        |(axes, ff, yaw_rad)| Command { axes, vel_ff_E_mps: Vec3::from_array(ff), yaw_rad },
    )
}

proptest! {
    #[test]
    fn prop_output_is_finite_and_limited_whatever_comes_in(
        steps in prop::collection::vec(
            (any_estimate(), any_command(), prop::option::of(any_number()), any_number(),
             any_number(), any_number(), any::<bool>()),
            1..30,
        ),
        raw in any::<bool>(),
        compensation in 0..3usize,
    ) {
        let kinds =
            [TiltCompensation::Off, TiltCompensation::Geometric, TiltCompensation::DragAware];
        let gains = ControlGains::from_vector(ControlGains::TUNABLES.map(|t| t.high));
        let config = ControlConfig {
            version: if raw { Version::Raw } else { Version::Modified },
            tilt_compensation: Some(kinds[compensation]),
            gains,
            trims: TrimConfig { roll_deg: 3.0, pitch_deg: 4.0, yaw_deg: 0.0 },
            ..Default::default()
        };
        let mut problems = Problems::new();
        config.check("control", &mut problems);
        prop_assert!(problems.is_empty(), "{}", problems);
        let limits = config.limits;
        let mut controller = Controller::new(config);
        for (estimate, command, supply_v, height, dt_s, ceiling, frozen) in &steps {
            let out = controller.step(&ControlInput {
                supply_v: *supply_v,
                height_above_ground_m: *height,
                dt_s: *dt_s,
                thrust_ceiling_frac: *ceiling,
                integrators_frozen: *frozen,
                ..input(estimate, command)
            });
            // Trims of 3° and 4° add 5° to the limit of the lean.
            let lean = out.roll_rad.hypot(out.pitch_rad);
            prop_assert!(lean <= (limits.tilt_deg + 5.0).to_radians() + 1e-9, "{:?}", out);
            prop_assert!(out.yaw_rad.abs() <= std::f64::consts::PI + 1e-9);
            prop_assert!((0.0..=limits.thrust_max_frac).contains(&out.thrust_frac));
            prop_assert!(out.R_EB.to_wxyz().iter().all(|c| c.is_finite()));
            let r = &out.record;
            let v = r.vel_setpoint_E_mps;
            prop_assert!(v.x().hypot(v.y()) <= limits.horizontal_mps + 1e-9);
            prop_assert!(v.z().abs() <= limits.vertical_mps);
            prop_assert!([r.pitch_ff_rad, r.roll_ff_rad, r.thrust_base_frac,
                r.thrust_feedback_frac, r.ground_factor].iter().all(|c| c.is_finite()));
            prop_assert!((0.9..=1.0).contains(&r.ground_factor));
        }
    }

    #[test]
    fn prop_mirror_image_flies_the_mirror_image(
        pos in prop::array::uniform3(-2.0..2.0f64),
        vel in prop::array::uniform3(-1.5..1.5f64),
        euler in prop::array::uniform3(-0.4..0.4f64),
        goal in prop::array::uniform3(-2.0..2.0f64),
        version in prop_oneof![Just(Version::Raw), Just(Version::Modified)],
    ) {
        // Left and right exchanged: y, roll and yaw change sign.
        let here = estimate(pos, vel, euler);
        let there = estimate(
            [pos[0], -pos[1], pos[2]],
            [vel[0], -vel[1], vel[2]],
            [-euler[0], euler[1], -euler[2]],
        );
        let command = Command::hold(Vec3::from_array(goal), 0.2);
        let mirrored = Command::hold(Vec3::new(goal[0], -goal[1], goal[2]), -0.2);
        let mut one = Controller::new(config(version));
        let mut other = Controller::new(config(version));
        for _ in 0..5 {
            let a = one.step(&input(&here, &command));
            let b = other.step(&input(&there, &mirrored));
            prop_assert!((a.roll_rad + b.roll_rad).abs() < 1e-9);
            prop_assert!((a.pitch_rad - b.pitch_rad).abs() < 1e-9);
            prop_assert!((a.yaw_rad + b.yaw_rad).abs() < 1e-9);
            prop_assert!((a.thrust_frac - b.thrust_frac).abs() < 1e-9);
        }
    }

    #[test]
    fn prop_turning_the_room_turns_nothing_but_yaw(
        vel in prop::array::uniform3(-1.0..1.0f64),
        goal in prop::array::uniform3(-1.0..1.0f64),
        yaw in -3.0..3.0f64,
        version in prop_oneof![Just(Version::Raw), Just(Version::Modified)],
    ) {
        let turn = Rot::<E, B>::from_euler_rad(0.0, 0.0, yaw);
        let turned = |v: [f64; 3]| (turn * Vec3::from_array(v)).to_array();
        let a = first_step(
            version,
            &estimate([0.0; 3], vel, [0.0; 3]),
            &Command::hold(Vec3::from_array(goal), 0.0),
        );
        let b = first_step(
            version,
            &estimate([0.0; 3], turned(vel), [0.0, 0.0, yaw]),
            &Command::hold(Vec3::from_array(turned(goal)), yaw),
        );
        prop_assert!((a.roll_rad - b.roll_rad).abs() < 1e-9);
        prop_assert!((a.pitch_rad - b.pitch_rad).abs() < 1e-9);
        prop_assert!((a.thrust_frac - b.thrust_frac).abs() < 1e-9);
        prop_assert!(wrap_pi_rad(b.yaw_rad - yaw).abs() < 1e-9);
    }
}

#[test]
fn prop_same_inputs_give_the_same_bits() {
    let here = estimate([0.1, 0.2, -1.0], [0.3, -0.2, 0.1], [0.05, -0.1, 0.3]);
    let command = Command::hold(Vec3::new(1.0, -1.0, -1.5), 0.0);
    let mut one = Controller::new(config(Version::Modified));
    let mut other = one.clone();
    for _ in 0..50 {
        assert_eq!(one.step(&input(&here, &command)), other.step(&input(&here, &command)));
    }
}

#[test]
fn prop_late_and_timeless_steps_do_no_harm() {
    let here = estimate([0.0; 3], [0.5, 0.0, 0.0], [0.0; 3]);
    let command = velocity([1.0, 0.0, 0.0]);
    let c = ControlConfig { limits: LimitsConfig::default(), ..config(Version::Modified) };
    let mut controller = Controller::new(c);
    let first = controller.step(&input(&here, &command));
    let still = ControlInput { dt_s: 0.0, ..input(&here, &command) };
    let a = controller.step(&still);
    let b = controller.step(&still);
    assert_eq!(a, b, "no time, no change");
    let late = controller.step(&ControlInput { dt_s: 30.0, ..input(&here, &command) });
    // Ten periods of integral and feed-forward at most: 0.03 and 0.41 rad.
    assert!((late.pitch_rad - first.pitch_rad).abs() < 0.45);
    assert!(controller.lean_integral_rad()[0] < 0.034);
}
