//! A vehicle that stands in the middle of the hall, motors off: its measurements as the companion
//! decodes them, and filters that live on nothing else.

use anyhow::{Context, Result};
use haltere_core::control::Version;
use haltere_core::estimate::Estimate;
use haltere_core::estimator::{Estimator, EstimatorConfig};
use haltere_core::frames::{E, Vec3};
use haltere_core::measure::{ImuSample, Tdoa};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_model::{PlantConfig, Truth};

use super::bench::Bench;

/// Clocks of the anchors and the start of the streams are left to settle for this long, s.
const WARM_UP_S: f64 = 4.0;

/// One measurement.
pub enum Measurement {
    /// Accelerometer and gyroscope.
    Imu(ImuSample),
    /// UWB.
    Tdoa(Tdoa),
}

/// What was measured while standing.
pub struct Standing {
    /// In the order in which they came.
    pub measurements: Vec<Measurement>,
    /// Truth: constant.
    pub truth: Truth,
    /// When the record starts.
    pub start: HostTime,
    survey: Survey,
}

impl Standing {
    /// Stands for so long, s.
    pub fn record(bench: &Bench, plant: PlantConfig, seconds: f64) -> Result<Self> {
        let survey = plant.survey.clone();
        let mut pilot = bench.pilot.clone();
        pilot.control = bench.version(Version::Raw);
        pilot.flight.gear_height_m = plant.vehicle.body.gear_m;
        let mut world = haltere_model::lockstep::Lockstep::new(plant, pilot, &survey)?;
        world.run_until((WARM_UP_S * 1e6) as u64);
        world.pilot_mut().drain_topics(|_| {});
        let start = world.host_now();
        let mut measurements = Vec::new();
        let end_us = ((WARM_UP_S + seconds) * 1e6) as u64;
        while world.t_us() < end_us {
            world.run_until((world.t_us() + 10_000).min(end_us));
            world.pilot_mut().drain_topics(|topic| match topic {
                Topic::Imu(sample) => measurements.push(Measurement::Imu(sample)),
                Topic::Uwb(record) => measurements.push(Measurement::Tdoa(record.tdoa)),
                _ => {}
            });
        }
        Ok(Self { measurements, truth: world.truth(), start, survey })
    }

    /// A filter that starts where the vehicle truly stands, knows nothing of its standing still, and
    /// sees every measurement; its state after each IMU sample.
    pub fn filter(&self, config: &EstimatorConfig) -> Result<Vec<Estimate>> {
        let mut filter = Estimator::new(config.clone(), self.survey.clone());
        filter.set_initial_heading(self.truth.R_EB.yaw_rad(), HEADING_STD_RAD);
        filter.set_airborne(true);
        filter.align_at(self.start, self.truth.pos_E_m, self.truth.R_EB);
        let mut states = Vec::new();
        for measurement in &self.measurements {
            match measurement {
                Measurement::Imu(sample) => {
                    filter.imu(sample);
                    states.push(filter.estimate());
                }
                Measurement::Tdoa(tdoa) => {
                    filter.tdoa(tdoa);
                }
            }
        }
        states.last().context("nothing was measured while standing")?;
        Ok(states)
    }

    /// Error of an estimate, Earth frame, m.
    pub fn error_E_m(&self, estimate: &Estimate) -> Vec3<E> {
        estimate.pos_E_m - self.truth.pos_E_m
    }

    /// Time since the start, s.
    pub fn since_s(&self, at: HostTime) -> f64 {
        at.seconds_since(self.start)
    }
}

/// One sigma of the heading at the start, rad: that of the pilot's alignment.
const HEADING_STD_RAD: f64 = 0.1;
