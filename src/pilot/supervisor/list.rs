//! The list of conditions. Its order is the order of names where several want the same.

use super::condition::Condition;
use super::{battery, envelope, estimator, imu, links, slip, timing, uwb};

/// Every condition. What reacts walks this list, and `docs/SAFETY.md` is printed from it.
pub static CONDITIONS: [Condition; 36] = [
    links::CONTROL,
    imu::LOST,
    imu::FROZEN,
    imu::NOISE,
    imu::LIFT,
    slip::SLIP,
    estimator::LOST,
    estimator::ATTITUDE,
    estimator::CONTRADICTED,
    envelope::TILT,
    links::BOARD,
    uwb::LOST,
    uwb::ANCHORS,
    estimator::DIVERGED,
    estimator::UNHEALED,
    battery::CRITICAL,
    links::BOARD_GAP,
    timing::STUCK,
    timing::CLOCK,
    envelope::HARD,
    envelope::SPEED,
    envelope::COURSE,
    battery::HOME,
    links::GROUND,
    links::CLIENT,
    links::JOYSTICK,
    battery::LOW,
    links::STICKS,
    links::IGNORED,
    envelope::SOFT,
    uwb::STALE,
    uwb::ANCHOR,
    battery::SILENT,
    estimator::HEIGHT,
    timing::LATE,
    timing::BOARD_CLOCK,
];
