//! Filters that fly along: they are given what the core recorded of a flight, and nothing else.

use haltere_core::estimator::{Estimator, EstimatorConfig};
use haltere_core::topics::Topic;
use haltere_model::Truth;
use haltere_model::lockstep::Lockstep;

/// A filter beside the one that flies.
pub struct Shadow {
    pub estimator: Estimator,
    /// Whether it hears the tag.
    pub with_uwb: bool,
}

impl Shadow {
    /// In the air, told nothing.
    pub fn new(
        config: EstimatorConfig,
        world: &Lockstep,
        survey: &haltere_core::survey::Survey,
    ) -> Self {
        let mut estimator = Estimator::new(config, survey.clone());
        estimator.set_airborne(!world.truth().on_ground);
        Self { estimator, with_uwb: true }
    }

    fn take(&mut self, topic: &Topic) {
        match topic {
            Topic::Imu(sample) => self.estimator.imu(sample),
            Topic::Uwb(record) if self.with_uwb => {
                self.estimator.tdoa(&record.tdoa);
            }
            Topic::Baro(sample) => self.estimator.baro(sample),
            Topic::Mag(sample) => self.estimator.mag(sample),
            _ => {}
        }
    }
}

/// Flies on; every 10 ms `watch` sees the shadows beside the truth. It ends the flight by `false`.
pub fn fly_along(
    world: &mut Lockstep,
    shadows: &mut [Shadow],
    seconds: f64,
    mut watch: impl FnMut(f64, &mut [Shadow], &Truth) -> bool,
) {
    let start_us = world.t_us();
    let mut topics = Vec::new();
    while ((world.t_us() - start_us) as f64) < seconds * 1e6 {
        world.run_until(world.t_us() + 10_000);
        world.pilot_mut().drain_topics(|topic| topics.push(topic));
        for topic in topics.drain(..) {
            for shadow in shadows.iter_mut() {
                shadow.take(&topic);
            }
        }
        let elapsed_s = (world.t_us() - start_us) as f64 * 1e-6;
        let truth = world.truth();
        if !watch(elapsed_s, shadows, &truth) {
            return;
        }
    }
}
