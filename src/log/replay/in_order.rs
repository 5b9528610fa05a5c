//! Byte for byte and in its order: what the same build on the same processor must send.

use std::collections::VecDeque;

use super::compare::{Agreement, compare, without_signatures};
use haltere_pilot::LinkId;

/// Pieces that wait to be compared; where so many do, the streams are long since apart.
const MOST_WAITING: usize = 50_000;

/// Replayed and recorded, first in, first out over all links.
#[derive(Debug, Default)]
pub(super) struct InOrder {
    /// Replayed, and not recorded yet.
    pending: VecDeque<(LinkId, Vec<u8>)>,
    /// Pieces and bytes that waited in vain.
    in_vain: (usize, usize),
    pub identical: u64,
    /// Largest difference of a number.
    pub worst: f64,
    pub rounding_flips: u64,
}

impl InOrder {
    pub fn replayed(&mut self, link: LinkId, bytes: &[u8]) {
        self.pending.push_back((link, bytes.to_vec()));
        if self.pending.len() > MOST_WAITING
            && let Some((_, oldest)) = self.pending.pop_front()
        {
            self.in_vain = (self.in_vain.0 + 1, self.in_vain.1 + oldest.len());
        }
    }

    /// `Some`: why it is not what the replay sent.
    pub fn recorded(&mut self, link: LinkId, recorded: &[u8]) -> Option<String> {
        let Some((replayed_link, replayed)) = self.pending.pop_front() else {
            return Some("recorded, but the replay sends nothing".to_owned());
        };
        if replayed_link != link {
            return Some(format!("the replay sends on link {} instead", replayed_link.number()));
        }
        let signed = link != LinkId::Tag;
        if replayed == recorded
            || (signed && without_signatures(recorded) == without_signatures(&replayed))
        {
            self.identical += 1;
            return None;
        }
        Some(match compare(recorded, &replayed) {
            Agreement::Numbers { worst, rounding_flips, what } => {
                self.worst = self.worst.max(worst);
                self.rounding_flips += rounding_flips;
                what
            }
            Agreement::None(what) => what,
        })
    }

    /// What the replay sent and nobody recorded.
    pub fn left(&self) -> Option<(LinkId, String)> {
        let (link, bytes) = self.pending.front()?;
        let what = format!(
            "the replay sends {} bytes more than were recorded, in {} pieces",
            self.in_vain.1 + bytes.len(),
            self.in_vain.0 + self.pending.len()
        );
        Some((*link, what))
    }
}
