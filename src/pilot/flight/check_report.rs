//! What is known at rest, reported as events: a station shows by them whether the vehicle can fly, and why not.

use super::Flight;
use super::at_rest::{AT_REST, Look, Quantity};
use super::event_list::{
    ARMING_SUMMARY, FIRST_CHECK, HEALTH_SUMMARY, all_modes, health_bit, health_index,
};
use super::modes::Mode;
use crate::out::Out;
use crate::out::events::Level;
use crate::out::voice::Severity;
use crate::view::Around;

/// Least time between two reports of the checks, s: states that flicker must not fill a link.
const REPORT_S: f64 = 1.0;

impl Flight {
    /// Once a control step: reports the checks when one of them has changed. In flight nobody arms.
    pub(crate) fn event_tick(&self, around: &Around<'_>, out: &mut Out) {
        let told = &out.told;
        if self.mode != Mode::Disarmed
            || told.checks.is_some() && around.at.seconds_since(told.checks_at) < REPORT_S
        {
            return;
        }
        self.report_checks(around, false, out);
    }

    /// The report of all checks; `anyway`: even if nothing has changed.
    pub(crate) fn report_checks(&self, around: &Around<'_>, anyway: bool, out: &mut Out) {
        let (mut failed, mut warned): (Vec<&Quantity>, Vec<&Quantity>) = Default::default();
        for row in &AT_REST {
            match (row.look)(&around.sight(self, out)) {
                Look::Refused(_) => failed.push(row),
                Look::Told(_) => warned.push(row),
                Look::Fits(_) => {}
            }
        }
        let of = |rows: &[&Quantity]| rows.iter().map(|row| health_bit(row)).sum::<u32>();
        let (errors, warnings) = (of(&failed), of(&warned));
        let at = around.at;
        let told = &mut out.told;
        told.checks_at = at;
        if told.checks.replace((errors, warnings)) == Some((errors, warnings)) && !anyway {
            return;
        }
        let all = AT_REST.iter().map(health_bit).sum::<u32>();
        let modes = all_modes();
        let can = if failed.is_empty() { modes } else { 0 };
        let [errors, all, warnings, modes, can] =
            [errors, all, warnings, modes, can].map(|word: u32| word.to_le_bytes());
        out.event(at, ARMING_SUMMARY, Level::PROTOCOL, &[&[0], &errors, &warnings, &can, &can]);
        let failed = failed.into_iter().map(|row| (row, Severity::Error));
        let warned = warned.into_iter().map(|row| (row, Severity::Warning));
        for (row, severity) in failed.chain(warned) {
            let index = health_index(row);
            let number = FIRST_CHECK + u32::from(index) - 1;
            out.event(at, number, severity.into(), &[&modes, &[index]]);
        }
        out.event(at, HEALTH_SUMMARY, Level::PROTOCOL, &[&[0], &all, &errors, &warnings]);
    }
}
