//! Finds frames in a byte stream: one bounded buffer and one rule of resynchronisation for every
//! wire format.
//!
//! The rule: after a failed candidate the search goes on at the byte after its *marker*, never at
//! its end, so that a damaged length cannot swallow the good frames behind it. Every byte is
//! accounted for: bytes pushed = bytes of frames + garbage reported + [`Scanner::pending`].

use std::ops::Range;

/// Most bytes that wait unread. A link hands over at most a few kB at once; the oldest bytes are
/// dropped, and counted as garbage, only when a caller pushes more than this without reading.
pub const CAPACITY_DROP_OLDEST: usize = 64 * 1024;

/// What a candidate turns out to be. Must depend on nothing but the bytes from its marker on.
pub enum Verdict<M, L> {
    /// More bytes are needed.
    Incomplete,
    /// A frame of this many bytes, marker included.
    Frame(usize, M),
    /// Not a frame.
    Failed(L),
}

/// What the search met next.
pub enum Found<M, L> {
    /// A frame at this place of [`Scanner::bytes`], valid until the next push.
    Frame(Range<usize>, M),
    /// Bytes that belong to no frame, those of failed candidates included.
    Garbage(usize),
    /// A candidate failed; its bytes are searched again and reported as garbage or frames.
    Failed(L),
}

/// The buffer and the search.
#[derive(Debug, Default, Clone)]
pub struct Scanner {
    bytes: Vec<u8>,
    start: usize,
    garbage: usize,
    flushing: bool,
}

impl Scanner {
    pub fn push(&mut self, bytes: &[u8]) {
        self.flushing = false;
        if self.start > 0 {
            self.bytes.drain(..self.start);
            self.start = 0;
        }
        let surplus = (self.bytes.len() + bytes.len()).saturating_sub(CAPACITY_DROP_OLDEST);
        let old = surplus.min(self.bytes.len());
        self.bytes.drain(..old);
        self.garbage += surplus;
        self.bytes.extend_from_slice(bytes.get(surplus - old..).unwrap_or_default());
    }

    /// Gives the bytes that wait up for incomplete: no more will come to complete them.
    pub fn flush(&mut self) {
        self.flushing = true;
    }

    /// Bytes neither delivered nor reported yet.
    pub fn pending(&self) -> usize {
        self.bytes.len() - self.start + self.garbage
    }

    pub fn at(&self, range: Range<usize>) -> &[u8] {
        self.bytes.get(range).unwrap_or_default()
    }

    #[inline]
    pub fn next<M, L>(
        &mut self,
        is_marker: impl Fn(u8) -> bool,
        judge: impl Fn(&[u8]) -> Verdict<M, L>,
    ) -> Option<Found<M, L>> {
        loop {
            let unread = self.bytes.get(self.start..).unwrap_or_default();
            match unread.first() {
                Some(first) if is_marker(*first) => {}
                _ => {
                    let skip = unread.iter().position(|b| is_marker(*b)).unwrap_or(unread.len());
                    self.garbage += skip;
                    self.start += skip;
                }
            }
            if self.garbage > 0 {
                return Some(Found::Garbage(std::mem::take(&mut self.garbage)));
            }
            let candidate = self.bytes.get(self.start..).filter(|c| !c.is_empty())?;
            match judge(candidate) {
                Verdict::Frame(len, meta) => {
                    let range = self.start..self.start + len;
                    self.start += len;
                    return Some(Found::Frame(range, meta));
                }
                Verdict::Failed(loss) => {
                    self.start += 1;
                    self.garbage += 1;
                    return Some(Found::Failed(loss));
                }
                Verdict::Incomplete if self.flushing => {
                    self.start += 1;
                    self.garbage += 1;
                }
                Verdict::Incomplete => return None,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_overflow_drops_the_oldest_and_counts_them() {
        let mut scanner = Scanner::default();
        scanner.push(&[7; 10]);
        scanner.push(&vec![1; CAPACITY_DROP_OLDEST]);
        assert_eq!(scanner.pending(), CAPACITY_DROP_OLDEST + 10);
        let judge = |_: &[u8]| Verdict::<(), ()>::Frame(1, ());
        let mut frames = 0;
        let mut garbage = 0;
        while let Some(found) = scanner.next(|b| b == 1, judge) {
            match found {
                Found::Frame(range, ()) => frames += range.len(),
                Found::Garbage(n) => garbage += n,
                Found::Failed(()) => {}
            }
        }
        assert_eq!((frames, garbage, scanner.pending()), (CAPACITY_DROP_OLDEST, 10, 0));
    }
}
