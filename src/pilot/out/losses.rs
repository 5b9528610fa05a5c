//! What was thrown away, by link and reason, those of the estimator included.

use haltere_core::drops::{DropReason, Drops};
use haltere_core::estimator::Estimator;
use haltere_core::time::HostTime;

use super::voice::Severity;
use crate::Pilot;
use crate::input::LinkId;
use crate::stations::endpoint::MOST_STATIONS;

/// People are told again that a station found no place after this time, s.
const FULL_TELL_S: f64 = 10.0;

impl Pilot {
    /// Losses by link number; the last entry is the core itself. What the estimator threw away
    /// counts where it came from: UWB on the tag's link, the rest in the core.
    pub fn drops(&self) -> Vec<Drops> {
        let slots = 0..self.out.drops.len();
        slots.map(|slot| losses_of(&self.out.drops, &self.navigation.estimator, slot)).collect()
    }

    /// The same as one number.
    pub(crate) fn lost(&self, slot: usize, reason: DropReason) -> u64 {
        let own = self.out.drops[slot].count(reason);
        if slot != slot_of_estimator(reason, self.out.drops.len()) {
            return own;
        }
        own.saturating_add(self.navigation.estimator.drops().count(reason))
    }

    pub(crate) fn drops_of(&mut self, link: LinkId) -> &mut Drops {
        let core = self.out.drops.len() - 1;
        let slot = usize::from(link.number()).min(core);
        &mut self.out.drops[slot]
    }

    pub(crate) fn glue_lost(&mut self, at: HostTime, link: LinkId, reason: DropReason, count: u64) {
        self.drops_of(link).add(reason, count);
        let told = self.out.told.full_at.is_some_and(|t| at.seconds_since(t) < FULL_TELL_S);
        if reason == DropReason::StationsFull && !told {
            self.out.told.full_at = Some(at);
            let number = self.ground_mut(link).map_or(0, |g| g.endpoint_number);
            let text = format!(
                "a station found no place: ground.endpoints[{number}] holds {MOST_STATIONS}; end one, \
                 or add an endpoint"
            );
            self.say(at, Severity::Warning, text);
        }
        if reason == DropReason::OutputLineLost
            && !std::mem::replace(&mut self.out.told.output_lost, true)
        {
            let text = "nobody reads what haltere prints: lines are lost, the log has them";
            self.say(at, Severity::Warning, text.to_owned());
        }
        self.tell_kept_out(at, link, reason);
        self.tell_unheard(at, link, reason);
    }
}

/// Of which slot the estimator's losses of a kind are counted.
pub(crate) fn slot_of_estimator(reason: DropReason, slots: usize) -> usize {
    match reason {
        DropReason::UwbUnknownAnchor
        | DropReason::UwbImpossible
        | DropReason::UwbGated
        | DropReason::UwbTooOld => usize::from(LinkId::Tag.number()),
        _ => slots - 1,
    }
}

/// Losses of a slot, those of the estimator included.
pub(crate) fn losses_of(drops: &[Drops], estimator: &Estimator, slot: usize) -> Drops {
    let mut all = drops.get(slot).cloned().unwrap_or_default();
    for (reason, n) in estimator.drops().iter() {
        if slot_of_estimator(reason, drops.len()) == slot {
            all.add(reason, n);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::PilotConfig;
    use crate::input::Input;
    use haltere_core::frames::Vec3;
    use haltere_core::measure::AnchorId;
    use haltere_core::survey::Survey;
    use haltere_core::topics::Topic;

    #[test]
    fn regress_losses_of_the_estimator_are_reported() {
        let corner = |i: u8| {
            let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
        };
        let survey = Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        let at = HostTime::from_us(1_000_000);
        let mut pilot = Pilot::new(PilotConfig::default(), survey, at);
        pilot.navigation.estimator.set_initial_heading(f64::NAN, 0.1);
        let core = pilot.drops().len() - 1;
        assert_eq!(pilot.drops()[core].count(DropReason::BadValue), 1);
        assert_eq!(pilot.lost(core, DropReason::BadValue), 1);
        let mut told = None;
        pilot.handle(at.offset_us(20_000), Input::Wake);
        pilot.drain_topics(|topic| {
            if let Topic::Health(record) = topic {
                told = record.drops.iter().find(|(n, _)| *n == u8::MAX).map(|(_, d)| d.clone());
            }
        });
        assert_eq!(told.map(|d| d.count(DropReason::BadValue)), Some(1));
    }
}
