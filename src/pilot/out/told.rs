//! The ledger: what people were told, and when, so that nothing is told twice that was to be told once.

use haltere_core::drops::DropReason;
use haltere_core::estimate::Health;
use haltere_core::estimator::MOST_ANCHORS;
use haltere_core::time::HostTime;

use crate::input::LinkId;

/// What people were told, and when.
#[derive(Debug)]
pub(crate) struct Told {
    /// What people were last told about the estimate, and when.
    pub health: Health,
    pub health_at: HostTime,
    /// Anchors that people were told are left out, by their place in the survey.
    pub left_out: [bool; MOST_ANCHORS],
    /// When people were last told that the board does not disarm.
    pub insisted_at: Option<HostTime>,
    /// Mode and arming that clients were last told at once.
    pub mode: Option<(u32, bool)>,
    /// When people were last told that a station found no place.
    pub full_at: Option<HostTime>,
    /// Whether people were told that nobody reads what the program prints.
    pub output_lost: bool,
    /// When people were last told that a setpoint is not followed.
    pub refused_setpoint_at: Option<HostTime>,
    /// When people were last told that a system may not command.
    pub refused_at: Option<HostTime>,
    /// When people were last told that frames are kept out.
    pub kept_out_at: Option<HostTime>,
    /// Whether it was told that somebody answers from another address: on the board's link, on a station's.
    pub other_address: [bool; 2],
    /// When people were last told that setpoints come which the mode does not follow.
    pub unobeyed_at: Option<HostTime>,
    /// What of a link is not heard: link and reason, each once.
    pub unheard: Vec<(LinkId, DropReason)>,
    /// Checks that failed, and that warned, when they were last reported, as bits of health, and when.
    pub checks: Option<(u32, u32)>,
    pub checks_at: HostTime,
}

impl Told {
    /// Nobody was told anything yet.
    pub fn new(at: HostTime) -> Self {
        Self {
            health: Health::NotAligned,
            health_at: at,
            left_out: [false; MOST_ANCHORS],
            insisted_at: None,
            mode: None,
            full_at: None,
            output_lost: false,
            refused_setpoint_at: None,
            refused_at: None,
            kept_out_at: None,
            other_address: [false; 2],
            unobeyed_at: None,
            unheard: Vec::new(),
            checks: None,
            checks_at: HostTime::default(),
        }
    }
}
