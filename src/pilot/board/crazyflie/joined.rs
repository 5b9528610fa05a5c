//! Packets in a stream of bytes: each behind one byte that tells its length.

use haltere_dialect::crtp::packet::{MAX_PACKET, Packet};

/// Cuts the stream into packets again.
#[derive(Debug, Default)]
pub(crate) struct Joined {
    held: [u8; MAX_PACKET],
    /// Bytes of the packet under way, of those that it has; 0 of 0 between two.
    have: usize,
    len: usize,
}

impl Joined {
    /// Takes bytes in, `packet` hears of each whole packet; the number of length bytes that are none.
    pub fn push(&mut self, bytes: &[u8], mut packet: impl FnMut(&Packet)) -> u64 {
        let mut bad = 0;
        for byte in bytes {
            if self.len == 0 {
                let len = usize::from(*byte);
                if (1..=MAX_PACKET).contains(&len) {
                    self.len = len;
                } else {
                    bad += 1;
                }
                continue;
            }
            if let Some(slot) = self.held.get_mut(self.have) {
                *slot = *byte;
            }
            self.have += 1;
            if self.have == self.len {
                let whole = self.held.get(..self.len).map(Packet::read);
                (self.have, self.len) = (0, 0);
                if let Some(Ok(whole)) = whole {
                    packet(&whole);
                }
            }
        }
        bad
    }
}

/// A packet as it stands in the stream.
pub(crate) fn join(packet: &Packet, take: impl FnOnce(&[u8])) {
    let mut bytes = [0; 1 + MAX_PACKET];
    let whole = packet.bytes();
    bytes[0] = whole.len() as u8;
    if let Some(to) = bytes.get_mut(1..=whole.len()) {
        to.copy_from_slice(whole);
    }
    take(bytes.get(..=whole.len()).unwrap_or_default());
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn prop_packets_come_back_in_any_chunking(
            payloads in prop::collection::vec(prop::collection::vec(any::<u8>(), 1..=MAX_PACKET), 0..8),
            chunk in 1_usize..40,
        ) {
            let packets: Vec<Packet> = payloads.iter().map(|p| Packet::read(p).unwrap()).collect();
            let mut stream = Vec::new();
            packets.iter().for_each(|packet| join(packet, |bytes| stream.extend_from_slice(bytes)));
            let (mut joined, mut back, mut bad) = (Joined::default(), Vec::new(), 0);
            for bytes in stream.chunks(chunk) {
                bad += joined.push(bytes, |packet| back.push(*packet));
            }
            prop_assert_eq!((back, bad), (packets, 0));
        }

        #[test]
        fn prop_no_bytes_can_harm(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            Joined::default().push(&bytes, |packet| assert!(!packet.bytes().is_empty()));
        }
    }
}
