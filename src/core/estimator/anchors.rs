//! The survey as the filter reads it: nothing of it changes in flight.

use nalgebra::Vector3;

use super::{EstimatorConfig, aligning};
use crate::measure::AnchorId;
use crate::survey::Survey;

/// Anchors by number and by their place in the survey.
#[derive(Debug, Clone)]
pub(super) struct Anchors {
    pub survey: Survey,
    /// Place of each anchor number in the survey.
    ranks: [u8; 256],
    /// Corners of the box that holds the anchors, Earth frame, m.
    pub hull_E_m: (Vector3<f64>, Vector3<f64>),
    /// Heights in the order of the survey, m.
    pub heights_m: Vec<f64>,
    /// Known range bias of each anchor number, m.
    range_bias_m: Box<[f64; 256]>,
}

impl Anchors {
    /// Of a survey, with the range biases that are known.
    pub fn new(config: &EstimatorConfig, survey: Survey) -> Self {
        let mut ranks = [0; 256];
        for (rank, id) in survey.ids().iter().enumerate() {
            ranks[usize::from(id.0)] = rank as u8;
        }
        let heights_m =
            survey.ids().iter().filter_map(|id| survey.position_E_m(*id)).map(|p| -p.z()).collect();
        let mut range_bias_m = Box::new([0.0; 256]);
        for [anchor, bias_m] in &config.range_bias_m {
            // The check of the configuration keeps it within 0 to 255; a cast saturates besides.
            range_bias_m[usize::from(*anchor as u8)] = *bias_m;
        }
        Self { hull_E_m: aligning::hull_E_m(&survey), heights_m, range_bias_m, ranks, survey }
    }

    /// Place in the survey; 0 of an anchor that is not in it.
    pub fn rank(&self, id: AnchorId) -> usize {
        usize::from(self.ranks[usize::from(id.0)])
    }

    /// Known range bias, m.
    pub fn range_bias_m(&self, id: AnchorId) -> f64 {
        self.range_bias_m[usize::from(id.0)]
    }
}
