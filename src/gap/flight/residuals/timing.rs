//! TIM: rates, gaps and delays of the streams, and losses that the pilot counted.

use super::{Channel, Flight, Sheet};
use crate::flight::regress::{log, moments};
use haltere_model::effects::Block;

/// A pause of the IMU that is a gap, s: five samples of 250 Hz.
const GAP_S: f64 = 0.02;

/// What the recording computer adds to times of arrival, s, without being a gap of the vehicle: it wakes up to so much
/// later from one run to the next, and by so much more or less from one sample to the next. A spare computer has 0.1 ms
/// (median lateness in docs/REALTIME.md), one that shares its cores some milliseconds; the control period of 10 ms is late by
/// half of that on average already, so 2 ms matter to nobody.
const HOST_S: f64 = 2e-3;

/// Spread over what any computer has.
fn spread(std_s: f64) -> f64 {
    log(std_s.hypot(HOST_S))
}

/// Writes the statistics; `None` lists them.
pub fn put(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    let mut v = [f64::NAN; 10];
    if let Some(f) = f {
        let t = f.trace;
        // Of the flight alone: how long the vehicle stood before and after is nobody's effect.
        let span = |first: usize, last: usize| first.min(last)..last;
        let before = |at: haltere_core::time::HostTime| at < f.line.start;
        let end = f.line.start.offset_us((f.line.t_s[f.len() - 1] * 1e6) as i64);
        let imu_all = &t.imu[span(
            t.imu.partition_point(|s| before(s.received_at)),
            t.imu.partition_point(|s| s.received_at < end),
        )];
        let uwb_all = &t.uwb[span(
            t.uwb.partition_point(|r| before(r.tdoa.received_at)),
            t.uwb.partition_point(|r| r.tdoa.received_at < end),
        )];
        let attitudes = &t.attitudes[span(
            t.attitudes.partition_point(|a| before(a.received_at)),
            t.attitudes.partition_point(|a| a.received_at < end),
        )];
        let imu = imu_all.iter().map(|s| s.received_at.seconds_since(s.valid_at));
        let imu = moments(imu);
        let steps =
            moments(imu_all.windows(2).map(|w| w[1].received_at.seconds_since(w[0].received_at)));
        let gaps = imu_all
            .windows(2)
            .filter(|w| w[1].received_at.seconds_since(w[0].received_at) > GAP_S)
            .count();
        let late = uwb_all.iter().map(|r| r.tdoa.received_at.seconds_since(r.tdoa.valid_at));
        let late = moments(late.step_by(3));
        let attitude = moments(attitudes.iter().map(|a| a.received_at.seconds_since(a.valid_at)));
        let silence = uwb_all
            .windows(2)
            .map(|w| w[1].tdoa.received_at.seconds_since(w[0].tdoa.received_at))
            .fold(0.0, f64::max);
        let clock = t.health.iter().rev().find_map(|h| h.std_board_clock_s);
        let span_s = f.len() as f64 * crate::flight::timeline::STEP_S;
        v = [
            imu.mean,
            spread(imu.std),
            spread(steps.std),
            log(gaps as f64 + 0.5),
            late.mean,
            spread(late.std),
            attitude.mean,
            log(silence),
            clock.unwrap_or(f64::NAN),
            log(imu_all.len() as f64 / span_s),
        ];
    }
    // In logarithms a quarter: a spread of the computer's own that is a quarter larger is no news.
    let names = [
        ("imu_age", Block::Timing, "s", HOST_S, "IMU: arrival after validity"),
        ("imu_age_std", Block::Timing, "ln", 0.25, "its spread"),
        ("imu_step_std", Block::Timing, "ln", 0.25, "spread of the time between arrivals"),
        ("imu_gaps", Block::Timing, "ln", 0.0, "pauses of the IMU"),
        ("uwb_age", Block::Timing, "s", HOST_S, "UWB: arrival after validity"),
        ("uwb_age_std", Block::Timing, "ln", 0.25, "its spread"),
        ("attitude_age", Block::Timing, "s", HOST_S, "attitude: arrival after validity"),
        ("uwb_silence", Block::Timing, "ln", 0.0, "longest pause of UWB"),
        (
            "clock",
            Block::Link,
            "s",
            HOST_S,
            "uncertainty of the board's clock: half the round trip",
        ),
        ("imu_rate", Block::Timing, "ln", 1e-3, "IMU samples per second"),
    ];
    for ((name, block, unit, resolution, meaning), value) in names.into_iter().zip(v) {
        sheet.put((block, Channel::Timing), format!("timing.{name}"), unit, meaning, value);
        sheet.resolved_to(resolution);
    }
}
