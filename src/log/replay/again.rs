//! A recorded flight with another filter: what went in goes in again, and nothing that comes out is compared.
//!
//! A core that flies by another estimate may act otherwise on the same inputs. What it sends goes nowhere; its filter
//! is told that the vehicle was in the air when it was, since its inputs are those of the flight that took place.

use super::airborne::Airborne;
use crate::record::{Entry, LogReader, RawInput};
use haltere_pilot::{Pilot, PilotConfig};

use haltere_core::time::HostTime;

/// Lives through a log with `config`. Before every input, and once behind the last, `show` is given the core and the
/// time up to which everything went in. Gives the number of inputs that the log lost.
pub fn live_again(
    log: &LogReader,
    config: PilotConfig,
    mut show: impl FnMut(HostTime, &mut Pilot),
) -> u64 {
    let session = log.session();
    let start = session.pilot_started_at;
    let mut pilot = Pilot::new(config, session.survey.clone(), start);
    let mut airborne = Airborne::flown(log);
    let (mut last, mut sequence, mut lost) = (start, 0u64, 0u64);
    for entry in log.entries() {
        match entry {
            Entry::Input { sequence: number, at, input } => {
                lost = lost.saturating_add(number.saturating_sub(sequence.saturating_add(1)));
                sequence = number;
                last = last.max(at);
                show(at, &mut pilot);
                if input == RawInput::Wake
                    && let Some(airborne) = airborne.told(at)
                {
                    pilot.set_airborne_as_flown(airborne);
                }
                pilot.handle(at, input.as_input());
                pilot.drain_output(|_, _| {});
            }
            Entry::Output { sequence: number, .. } => {
                lost = lost.saturating_add(number.saturating_sub(sequence.saturating_add(1)));
                sequence = number;
            }
            _ => {}
        }
    }
    show(last.offset_us(1), &mut pilot);
    lost
}
