//! What a ground station waits for, on the wire and in flight: the answer to a command, and all parameters.
//!
//! The station is `haltere ctl`'s own, over UDP as any other, and reads as fast as messages come. Targets are those of
//! the project (docs/REALTIME.md); they are told, and not among the bounds that a soak fails on: it is the computer's
//! business as well, at no priority at all.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use haltere::ctl::GroundStation;
use haltere::rig::now_us;
use haltere_dialect::mav::haltere::{MavCmd, MavMessage, PARAM_REQUEST_LIST_DATA};

use super::stalls::Stalls;
use super::wire::Sorted;

/// Least parameters a second, and the time in which 99 % of commands are answered, ms.
pub const PARAMETERS_PER_S: f64 = 1000.0;
pub const ANSWER_MS: f64 = 50.0;
pub const ANSWER_SHARE: f64 = 0.99;

/// What the command asks for: AUTOPILOT_VERSION, one message.
const ASKED_FOR: f32 = 148.0;
/// Longest wait for the next parameter.
const PATIENCE: Duration = Duration::from_secs(2);

/// When something was asked and when it was answered, µs of the monotonic clock.
#[derive(Debug, Default)]
pub struct Asked {
    commands_us: Vec<[u64; 2]>,
    /// The same of lists of all parameters, and how many came.
    lists: Vec<([u64; 2], usize)>,
}

impl Asked {
    /// A command, until it is answered.
    pub fn command(&mut self, station: &mut GroundStation) -> Result<()> {
        let from_us = now_us();
        let params = [ASKED_FOR, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        station.command(MavCmd::MAV_CMD_REQUEST_MESSAGE, params).context("a question in flight")?;
        self.commands_us.push([from_us, now_us()]);
        Ok(())
    }

    /// All parameters, until the last has come.
    pub fn parameters(&mut self, station: &mut GroundStation) -> Result<()> {
        let (target_system, target_component) = station.target();
        let from_us = now_us();
        station.send(&MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
            target_system,
            target_component,
        }))?;
        let mut came = BTreeSet::new();
        let mut deadline = Instant::now() + PATIENCE;
        loop {
            match station.next_message(deadline)? {
                Some(MavMessage::PARAM_VALUE(value)) => {
                    came.insert(value.param_index);
                    deadline = Instant::now() + PATIENCE;
                    if came.len() >= usize::from(value.param_count) {
                        self.lists.push(([from_us, now_us()], came.len()));
                        return Ok(());
                    }
                }
                Some(_) => {}
                None => bail!("{} parameters came, then none for {PATIENCE:?}", came.len()),
            }
        }
    }

    pub fn join(&mut self, other: Self) {
        self.commands_us.extend(other.commands_us);
        self.lists.extend(other.lists);
    }

    /// Times to the answer, ms: as they were, and without the time that a processor stood still.
    pub fn answers_ms(&self, stalls: &Stalls) -> [Sorted; 2] {
        let ms = |us: u64| us as f64 * 1e-3;
        let all = self.commands_us.iter().map(|[from, to]| ms(to - from)).collect();
        let own = self
            .commands_us
            .iter()
            .map(|[from, to]| ms((to - from).saturating_sub(stalls.stood_us(*from, *to))));
        [Sorted::of(all), Sorted::of(own.collect())]
    }

    /// Parameters a second, of each list.
    pub fn parameters_per_s(&self) -> Sorted {
        let rate =
            |([from, to], n): &([u64; 2], usize)| *n as f64 / ((to - from).max(1) as f64 * 1e-6);
        Sorted::of(self.lists.iter().map(rate).collect())
    }

    /// How many parameters there are.
    pub fn parameters_count(&self) -> usize {
        self.lists.first().map_or(0, |(_, n)| *n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_answers_and_lists_become_times_and_rates() {
        let asked = Asked {
            commands_us: vec![[0, 4_000], [10_000, 70_000]],
            lists: vec![([0, 100_000], 250), ([0, 500_000], 250)],
        };
        let [all, own] = asked.answers_ms(&Stalls::of(vec![[20_000, 60_000]]));
        assert_eq!((all.at(0.0), all.at(1.0)), (4.0, 60.0));
        assert_eq!((own.at(0.0), own.at(1.0)), (4.0, 20.0));
        assert!((all.share_within(ANSWER_MS) - 0.5).abs() < 1e-12);
        let rates = asked.parameters_per_s();
        assert!((rates.at(0.0) - 500.0).abs() < 1e-9 && (rates.at(1.0) - 2500.0).abs() < 1e-9);
        assert_eq!(asked.parameters_count(), 250);
    }
}
