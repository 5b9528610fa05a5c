//! What was thrown away, by link and reason, those of the estimator included.

use std::sync::Arc;

use haltere_dialect::mav_stream::MavLoss;

use haltere_core::drops::{DropReason, Drops};
use haltere_core::estimator::Estimator;
use haltere_core::time::HostTime;

use super::Out;
use super::shelf::Table;
use super::voice::Severity;
use crate::input::{LinkId, MOST_STATIONS};

/// People are told again that a station found no place after this time, s.
const FULL_TELL_S: f64 = 10.0;
/// People are told again that frames are kept out after this time, s.
const KEPT_OUT_TELL_S: f64 = 10.0;
/// While setpoints are refused people are told why so often, s: a stream brings 20 a second.
const REFUSED_TOLD_S: f64 = 5.0;

impl Out {
    /// Counts a setpoint that is not followed, and says why, every few seconds as long as others come.
    pub(crate) fn refuse_setpoint(&mut self, at: HostTime, link: LinkId, why: String) {
        self.lose(link, DropReason::BadValue, 1);
        let told = self.told.refused_setpoint_at;
        if told.is_none_or(|told| at.seconds_since(told) >= REFUSED_TOLD_S) {
            self.told.refused_setpoint_at = Some(at);
            self.say(at, Severity::Warning, why);
        }
    }

    /// Something of a link was thrown away.
    pub(crate) fn lose(&mut self, link: LinkId, reason: DropReason, count: u64) {
        self.drops_of(link).add(reason, count);
    }

    pub(crate) fn drops_of(&mut self, link: LinkId) -> &mut Drops {
        let core = self.drops.len() - 1;
        let slot = usize::from(link.number()).min(core);
        &mut self.drops[slot]
    }

    /// How often something of a slot was thrown away, the estimator's losses included.
    pub(crate) fn lost(&self, estimator: &Estimator, slot: usize, reason: DropReason) -> u64 {
        let own = self.drops[slot].count(reason);
        if slot != slot_of_estimator(reason, self.drops.len()) {
            return own;
        }
        own.saturating_add(estimator.drops().count(reason))
    }

    /// Losses by link number; the last entry is the core itself. What the estimator threw away
    /// counts where it came from: UWB on the tag's link, the rest in the core.
    pub(crate) fn all_lost(&self, estimator: &Estimator) -> Vec<Drops> {
        let slots = 0..self.drops.len();
        slots.map(|slot| losses_of(&self.drops, estimator, slot)).collect()
    }

    /// The same for the log, by the number of the link.
    pub(crate) fn losses_for_log(&mut self, estimator: &Estimator) -> Arc<Table> {
        let Self { drops, shelf, .. } = self;
        let core = drops.len() - 1;
        let rows = (0..drops.len()).map(|slot| {
            let total = losses_of(drops, estimator, slot);
            (if slot == core { u8::MAX } else { slot as u8 }, total)
        });
        shelf.fill(rows.filter(|(_, d)| d.iter().next().is_some()))
    }

    /// Glue has thrown something away.
    pub(crate) fn glue_lost(&mut self, at: HostTime, link: LinkId, reason: DropReason, count: u64) {
        self.lose(link, reason, count);
        let told = self.told.full_at.is_some_and(|t| at.seconds_since(t) < FULL_TELL_S);
        if reason == DropReason::StationsFull && !told {
            self.told.full_at = Some(at);
            let number = self.endpoint_number(link);
            let text = format!(
                "a station found no place: ground.endpoints[{number}] holds {MOST_STATIONS}; end one, \
                 or add an endpoint"
            );
            self.say(at, Severity::Warning, text);
        }
        if reason == DropReason::OutputLineLost
            && !std::mem::replace(&mut self.told.output_lost, true)
        {
            let text = "nobody reads what haltere prints: lines are lost, the log has them";
            self.say(at, Severity::Warning, text.to_owned());
        }
        self.tell_kept_out(at, link, reason);
    }

    /// Somebody who means well would wait for ever otherwise.
    fn tell_kept_out(&mut self, at: HostTime, link: LinkId, reason: DropReason) {
        let what = match reason {
            DropReason::MavWrongPeer => return self.tell_other_address(at, link),
            DropReason::MavUnsigned => "unsigned frames are kept out: give the station the key",
            DropReason::MavBadSignature => "frames with another key are kept out",
            DropReason::MavReplayed => "signed frames that come twice or late are kept out",
            DropReason::MavStaleTime => {
                "frames signed over a minute ago are kept out: set the station's clock"
            }
            DropReason::SigningSetup => "a new signing key was refused: signing.setup",
            DropReason::RateLimited => "a station sends more than ground.most_frames_per_s allows",
            _ => return,
        };
        if self.told.kept_out_at.is_none_or(|t| at.seconds_since(t) > KEPT_OUT_TELL_S) {
            self.told.kept_out_at = Some(at);
            self.say(at, Severity::Warning, format!("link {}: {what}", link.number()));
        }
    }

    /// Somebody speaks from another address than the one that we send to. Told once: every datagram would say so.
    fn tell_other_address(&mut self, at: HostTime, link: LinkId) {
        let is_station = matches!(link, LinkId::Ground(_));
        let told = self.told.other_address.get_mut(usize::from(is_station));
        if told.is_none_or(|told| std::mem::replace(told, true)) {
            return;
        }
        let text = if is_station {
            let number = self.endpoint_number(link);
            format!(
                "a station is not heard: it answers from another address than ground.endpoints[{number}] \
                 sends to; write that one, or udpin"
            )
        } else {
            "a board is not heard: it answers from another address than board.address; write that one, or udpin"
                .to_owned()
        };
        self.say(at, Severity::Warning, text);
    }
}

/// Counts what a splitter lost.
pub(crate) fn count_frame<T>(drops: &mut Drops, next: &Result<T, MavLoss>) {
    if let Err(loss) = next {
        match loss {
            MavLoss::GarbageBytes(n) => drops.add(DropReason::MavGarbageByte, *n as u64),
            MavLoss::BadChecksum { .. } => drops.add(DropReason::MavBadChecksum, 1),
            MavLoss::UnknownId { .. } => drops.add(DropReason::MavUnknownId, 1),
            MavLoss::Undecodable { .. } => drops.add(DropReason::MavUndecodable, 1),
            MavLoss::Incompatible => drops.add(DropReason::MavIncompatible, 1),
        }
    }
}

/// Of which slot the estimator's losses of a kind are counted.
fn slot_of_estimator(reason: DropReason, slots: usize) -> usize {
    match reason {
        DropReason::UwbUnknownAnchor
        | DropReason::UwbImpossible
        | DropReason::UwbGated
        | DropReason::UwbTooOld => usize::from(LinkId::Tag.number()),
        _ => slots - 1,
    }
}

/// Losses of a slot, those of the estimator included.
fn losses_of(drops: &[Drops], estimator: &Estimator, slot: usize) -> Drops {
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
    use crate::Pilot;
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
        assert_eq!(pilot.out.lost(pilot.estimator(), core, DropReason::BadValue), 1);
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
