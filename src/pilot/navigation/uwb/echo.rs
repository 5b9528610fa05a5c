//! What was heard before: a packet of the air never comes a second time.
//!
//! A packet carries the sender's time, its counter and what it heard of the others, all in clocks that run on. A
//! stream that is played again carries the same payloads once more, whatever receive times somebody gives them. So
//! payloads are remembered by a hash, for [`SETS`] times [`WAYS`] packets (a minute of TDoA2), the oldest of a set
//! forgotten first.
//!
//! In a world without noise and drift all of it does come round, after 128 frames of TDoA2. So a payload that is
//! known counts as an echo only where the clock of its anchor contradicts it as well.

/// Sets of the table: a power of two.
const SETS: usize = 8192;
/// Hashes of a set. In 10 s of TDoA2 some 0.6 come to a set, and five or more to 0.04 % of them (Poisson).
const WAYS: usize = 4;
/// So many payloads in a row that are not known end an echo: one in two hundred is forgotten.
const NEW: u32 = 16;

/// Payloads that were heard.
#[derive(Debug, Clone)]
pub struct Echo {
    /// Hashes of each set, the newest first; 0: none.
    sets: Box<[[u32; WAYS]]>,
    /// Whether what comes now is what came before.
    sounds: bool,
    /// Payloads in a row that were not known.
    new: u32,
}

impl Echo {
    /// Nothing heard yet.
    pub fn new() -> Self {
        Self { sets: vec![[0; WAYS]; SETS].into_boxed_slice(), sounds: false, new: 0 }
    }

    /// Whether a payload was heard before; from now on it was.
    pub fn hear(&mut self, payload: &[u8]) -> bool {
        let hash = hash(payload);
        let (set, check) = ((hash >> 32) as usize % SETS, hash as u32 | 1);
        let Some(set) = self.sets.get_mut(set) else { return false };
        let known = set.contains(&check);
        if !known {
            set.rotate_right(1);
            set[0] = check;
        }
        self.new = if known { 0 } else { self.new.saturating_add(1) };
        self.sounds &= self.new < NEW;
        known
    }

    /// Whether an echo sounds: what comes is then nothing but that.
    pub fn sounds(&self) -> bool {
        self.sounds
    }

    /// Whether what comes was certainly never heard before.
    pub fn is_over(&self) -> bool {
        self.new >= NEW
    }

    /// The clock of its anchor contradicts a payload that is known.
    pub fn begin(&mut self) {
        self.sounds = true;
    }

    /// The tag was connected anew.
    pub fn end(&mut self) {
        self.sounds = false;
    }
}

/// FNV-1a, 64 bits, and a last mix for its low bits (Fowler, Noll, Vo; splitmix64).
fn hash(bytes: &[u8]) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for byte in bytes {
        hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    }
    hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    hash ^ (hash >> 27)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_ten_seconds_are_remembered_and_nothing_else_is_known() {
        let mut echo = Echo::new();
        let payload = |n: u32| n.to_le_bytes().repeat(14);
        assert_eq!((0..4760).filter(|n| echo.hear(&payload(*n))).count(), 0);
        let known = (0..4760).filter(|n| echo.hear(&payload(*n))).count();
        assert!(known > 4700, "{known}");
    }
}
