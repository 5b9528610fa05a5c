//! The effects that are on, sorted by stage.

use nalgebra::Vector3;

use crate::board::BoardSettings;
use crate::effects::{
    AttitudeError, Build, Delivery, Effect, EffectSet, EffectSpec, ImuReading, STAGES, Setpoint,
    Source, Stage, State, Supply,
};
use crate::random::Stream;
use crate::room::Room;
use crate::tag::air::Packet;
use crate::vehicle::Vehicle;
use crate::wings::{Actuation, ActuatorCommand, Wrench};
use haltere_core::checks::Problems;

/// Active effects.
pub struct Bank {
    effects: Vec<(&'static EffectSpec, Box<dyn Effect>)>,
    /// For each stage the places in `effects` that act there, in order.
    stages: [Vec<u8>; STAGES],
    seed: u64,
}

macro_rules! run {
    ($(#[$doc:meta])* $name:ident, $stage:ident, $argument:ident: $kind:ty) => {
        $(#[$doc])*
        #[inline]
        pub fn $name(&mut self, s: &State, $argument: $kind) {
            for i in &self.stages[Stage::$stage as usize] {
                self.effects[usize::from(*i)].1.$name(s, $argument);
            }
        }
    };
}

impl Bank {
    /// Builds the set. Edits `vehicle`, `board` and `sites_E_m` as the deviations say.
    pub fn new(
        set: &EffectSet,
        seed: u64,
        vehicle: &mut Vehicle,
        board: &mut BoardSettings,
        room: &Room,
        sites_E_m: &mut [Vector3<f64>],
    ) -> Self {
        // Values given for numbers of the vehicle file stand there first: they are the file.
        for (spec, given) in set.iter() {
            for (parameter, value) in spec.parameters.iter().zip(given) {
                if let (Source::Vehicle(field), Some(value)) = (parameter.source, value) {
                    *field(vehicle) = *value;
                }
            }
        }
        let nominal = vehicle.clone();
        let surveyed = sites_E_m.to_vec();
        let mut bank = Self { effects: Vec::new(), stages: [const { Vec::new() }; STAGES], seed };
        // Deviations are built twice: first to edit the vehicle, then, with all edits in, to act.
        for (spec, given) in set.iter() {
            let mut effect = build(spec, given, seed, vehicle, &nominal, room, &surveyed);
            effect.vehicle(vehicle);
            effect.board(board);
            effect.sites(sites_E_m);
        }
        for (spec, given) in set.iter() {
            bank.push(spec, build(spec, given, seed, vehicle, &nominal, room, &surveyed));
        }
        bank
    }

    /// Switches an effect on in flight. Only effects that act at stages can be: an edit of the
    /// vehicle comes too late.
    pub fn switch_on(
        &mut self,
        id: &str,
        values: &[(&str, f64)],
        vehicle: &Vehicle,
        room: &Room,
        sites_E_m: &[Vector3<f64>],
    ) -> Result<(), Problems> {
        let set = EffectSet::none().with(id, values)?;
        self.switch_off(id);
        for (spec, given) in set.iter() {
            let effect = build(spec, given, self.seed, vehicle, vehicle, room, sites_E_m);
            if effect.stages().is_empty() {
                let mut problems = Problems::new();
                problems.say(format!(
                    "effect {id} changes the vehicle or the survey itself and can only be on from \
                     the start; put it into the effects of the scenario"
                ));
                return problems.into_result();
            }
            self.push(spec, effect);
        }
        Ok(())
    }

    /// Switches an effect off in flight. Nothing happens if it is not on.
    pub fn switch_off(&mut self, id: &str) {
        let Some(place) = self.effects.iter().position(|(spec, _)| spec.id == id) else { return };
        self.effects.remove(place);
        for stage in &mut self.stages {
            stage.retain(|i| usize::from(*i) != place);
            for i in stage.iter_mut().filter(|i| usize::from(**i) > place) {
                *i -= 1;
            }
        }
    }

    /// Ids that are on.
    pub fn ids(&self) -> impl Iterator<Item = &'static str> {
        self.effects.iter().map(|(spec, _)| spec.id)
    }

    fn push(&mut self, spec: &'static EffectSpec, effect: Box<dyn Effect>) {
        if effect.stages().is_empty() {
            return;
        }
        // The list has far fewer entries than 256.
        let place = self.effects.len() as u8;
        for stage in effect.stages() {
            self.stages[*stage as usize].push(place);
        }
        self.effects.push((spec, effect));
    }

    run!(/// Air velocity at the vehicle.
        wind, Wind, wind_E_mps: &mut Vector3<f64>);
    run!(/// Setpoint as the board obeys it.
        setpoint, Setpoint, setpoint: &mut Setpoint);
    run!(/// Command to the actuators.
        command, Command, command: &mut ActuatorCommand);
    run!(/// State of the actuators.
        actuate, Actuate, actuation: &mut Actuation);
    run!(/// Thrust of each wing.
        thrust, Thrust, thrust_n: &mut [f64; 2]);
    run!(/// Force and moment.
        wrench, Wrench, wrench: &mut Wrench);
    run!(/// Battery.
        battery, Battery, supply: &mut Supply);
    run!(/// Battery as reported.
        battery_report, BatteryReport, supply: &mut Supply);
    run!(/// IMU reading.
        imu, Imu, reading: &mut ImuReading);
    run!(/// Believed attitude.
        attitude, Attitude, error: &mut AttitudeError);
    run!(/// Anchor clocks.
        clocks, Clocks, skew: &mut [f64]);
    run!(/// A packet in the air.
        air, Air, packet: &mut Packet);
    run!(/// A delivery.
        link, Link, delivery: &mut Delivery);
}

fn build(
    spec: &'static EffectSpec,
    given: &[Option<f64>],
    seed: u64,
    vehicle: &Vehicle,
    nominal: &Vehicle,
    room: &Room,
    sites_E_m: &[Vector3<f64>],
) -> Box<dyn Effect> {
    let mut file = vehicle.clone();
    let value: Vec<f64> = spec
        .parameters
        .iter()
        .zip(given)
        .map(|(p, given)| match p.source {
            Source::Vehicle(field) => *field(&mut file),
            Source::List => given.unwrap_or(p.of(nominal).default),
        })
        .collect();
    let rng = Stream::new(seed, spec.id);
    (spec.build)(Build { vehicle, nominal, room, sites_E_m, value: &value, rng })
}
