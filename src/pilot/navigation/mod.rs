//! Where the vehicle is: the tag, the estimator, and what is found of floor, room and sensors beside it.

pub(crate) mod anchors;
pub(crate) mod before;
pub(crate) mod carried;
pub(crate) mod evidence;
pub(crate) mod floor;
pub(crate) mod heading;
pub(crate) mod ingest;
pub(crate) mod lift;
pub(crate) mod lying;
pub(crate) mod magnetics;
pub(crate) mod pairs;
pub(crate) mod reference;
pub(crate) mod repetition;
pub(crate) mod room;
pub(crate) mod rooms;
pub(crate) mod scale;
pub(crate) mod slip;
pub(crate) mod survey_check;
pub(crate) mod told;
pub mod uwb;

use haltere_dialect::mav_stream::MavSplitter;

use haltere_core::estimator::Estimator;
use haltere_core::measure::{ImuSample, Tdoa};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;

use crate::config::PilotConfig;

use anchors::Anchors;
use before::Before;
use carried::Carried;
use evidence::Evidence;
use floor::Touch;
use heading::BoardNorth;
use lift::Lift;
use lying::Lying;
use pairs::PairStats;
use repetition::Repetition;
use rooms::Rooms;
use scale::Scale;
use slip::Slip;
use survey_check::SurveyCheck;
use uwb::{MavTag, TdoaEngine};

/// The board's attitude is compared with ours while it is no older than this, s.
const ATTITUDE_AGE_S: f64 = 0.2;

/// What is read of the tag.
#[derive(Debug)]
pub(crate) struct Tag {
    /// For one that is a sniffer, and for one that computes time differences itself.
    pub(crate) engine: TdoaEngine,
    pub(crate) mavlink: MavTag,
    splitter: MavSplitter,
    /// Taken out while it is filled and emptied.
    tdoas: Vec<Tdoa>,
    is_up: bool,
    /// When a measurement last came, or the tag was last asked for its stream.
    asked_at: HostTime,
}

impl Tag {
    fn new(config: &PilotConfig, survey: &Survey, at: HostTime) -> Self {
        Self {
            engine: TdoaEngine::new(config.uwb.clone(), survey),
            mavlink: MavTag::new(),
            splitter: MavSplitter::new(),
            tdoas: Vec::new(),
            is_up: false,
            asked_at: at,
        }
    }
}

/// The tag, the estimator, and what is found beside it.
#[derive(Debug)]
pub(crate) struct Navigation {
    pub(crate) tag: Tag,
    pub(crate) last_fused: Option<HostTime>,
    pub(crate) last_imu: Option<HostTime>,
    /// The newest sample, for who asks for it.
    pub(crate) imu: Option<ImuSample>,
    pub(crate) baro_at: Option<HostTime>,
    pub(crate) pairs: Vec<PairStats>,
    pub(crate) estimator: Estimator,
    pub(crate) north: BoardNorth,
    pub(crate) survey_check: SurveyCheck,
    pub(crate) touch: Touch,
    pub(crate) carried: Carried,
    pub(crate) lying: Lying,
    pub(crate) anchors: Anchors,
    pub(crate) repetition: Repetition,
    pub(crate) evidence: Evidence,
    pub(crate) lift: Lift,
    pub(crate) slip: Slip,
    pub(crate) scale: Scale,
    pub(crate) before: Before,
    pub(crate) rooms: Rooms,
}

impl Navigation {
    pub(crate) fn new(config: &PilotConfig, survey: &Survey, at: HostTime) -> Self {
        Self {
            tag: Tag::new(config, survey, at),
            last_fused: None,
            last_imu: None,
            imu: None,
            baro_at: None,
            pairs: Vec::new(),
            estimator: Estimator::new(config.estimator_in_force(), survey.clone()),
            north: BoardNorth::new(config.board_north_offset_rad),
            survey_check: SurveyCheck::new(config, survey),
            touch: Touch::default(),
            carried: Carried::default(),
            lying: Lying::default(),
            anchors: Anchors::default(),
            repetition: Repetition::default(),
            evidence: Evidence::default(),
            lift: Lift::default(),
            slip: Slip::default(),
            scale: Scale::default(),
            before: Before::default(),
            rooms: Rooms::default(),
        }
    }
}
