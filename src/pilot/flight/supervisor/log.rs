//! The log: whether what happens is recorded (`src/pilot/out/recording.rs`). No row of these changes a flight.

use haltere_dialect::mav::haltere::MavSysStatusSensor;

use super::condition::{Condition, ROW, Watched};
use crate::out::recording::Recording;
use crate::out::voice::Severity;

/// Nothing is recorded.
pub(super) const STOPPED: Condition = Condition {
    name: "log_stopped",
    seen_by: "Nothing is recorded: less than 200 MB are free where logs go (a twentieth of a disk below 4 GB), the \
              folder cannot be made, or a write failed or took longer than the buffer holds (80 s, 64 MB). It is tried \
              again each second; the log then goes on with a hole (`/hole`), which is told and counted \
              (`recording_stopped`, `recorder_queue_full`). With `flight.log_required` nothing arms meanwhile.",
    gone_s: 0.0,
    watched: Watched::Always,
    because: "nothing is recorded",
    health: MavSysStatusSensor::MAV_SYS_STATUS_LOGGING,
    severity: Severity::Warning,
    is_seen: |sight| sight.out.recording.state == Recording::Stopped,
    words: |sight| sight.out.recording.words().unwrap_or_default(),
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
    is_seen: |sight| sight.out.recording.state == Recording::Waits,
    words: |sight| sight.out.recording.words().unwrap_or_default(),
    ..ROW
};
