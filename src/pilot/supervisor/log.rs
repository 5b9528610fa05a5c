//! The log: whether what happens is recorded (`src/pilot/recording.rs`). No row of these changes a flight.

use haltere_dialect::mav::haltere::MavSysStatusSensor;

use super::super::Severity;
use super::super::recording::Recording;
use super::condition::{Condition, ROW, Watched};

/// Nothing is recorded.
pub(super) const STOPPED: Condition = Condition {
    name: "log_stopped",
    seen_by: "Recording has stopped, or never began: less than 200 MB are free where logs go (a twentieth of a disk of \
              less than 4 GB), or a write failed. The room is looked at and the write tried again every second, and the \
              log goes on, with a hole in it (`/hole`), which is told. What is lost is counted as `recording_stopped`. \
              Told to a station that comes later as well. With `flight.log_required` nothing arms meanwhile.",
    gone_s: 0.0,
    watched: Watched::Always,
    because: "nothing is recorded",
    health: MavSysStatusSensor::MAV_SYS_STATUS_LOGGING,
    severity: Severity::Warning,
    is_seen: |pilot, _| pilot.recording.state == Recording::Stopped,
    words: |pilot, _| pilot.recording.words().unwrap_or_default(),
    ..ROW
};

/// The rest of the disk is kept for flights.
pub(super) const WAITS: Condition = Condition {
    name: "log_waits",
    seen_by: "The vehicle is disarmed, and less than `record.reserve_gb` is free where logs go (a tenth of a disk of \
              less than ten times that): what is left is kept for flights. The log goes on when somebody arms, down to \
              the last 200 MB, or when there is room.",
    gone_s: 0.0,
    watched: Watched::Always,
    because: "the log waits for a flight",
    health: MavSysStatusSensor::MAV_SYS_STATUS_LOGGING,
    severity: Severity::Warning,
    is_seen: |pilot, _| pilot.recording.state == Recording::Waits,
    words: |pilot, _| pilot.recording.words().unwrap_or_default(),
    ..ROW
};
