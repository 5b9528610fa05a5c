//! A one-way link: bytes in order, each delivery with its own delay.

use std::collections::VecDeque;

/// Bytes under way. In the steady state nothing is allocated.
#[derive(Debug, Default, Clone)]
pub struct Line {
    bytes: VecDeque<u8>,
    /// Arrival time (µs) and length of each delivery.
    deliveries: VecDeque<(u64, usize)>,
    last_us: u64,
}

impl Line {
    /// Sends `bytes` at `now_us`; they arrive after `delay_s`, never before what was sent earlier.
    pub fn send(&mut self, now_us: u64, delay_s: f64, bytes: &[u8]) {
        let due_us = (now_us + (delay_s.max(0.0) * 1e6) as u64).max(self.last_us);
        self.last_us = due_us;
        self.bytes.extend(bytes);
        self.deliveries.push_back((due_us, bytes.len()));
    }

    /// Moves what has arrived by `now_us` to the end of `out`.
    #[inline]
    pub fn receive(&mut self, now_us: u64, out: &mut Vec<u8>) {
        while let Some((due_us, len)) = self.deliveries.front().copied() {
            if due_us > now_us {
                break;
            }
            self.deliveries.pop_front();
            let (a, b) = self.bytes.as_slices();
            let from_a = len.min(a.len());
            out.extend_from_slice(&a[..from_a]);
            out.extend_from_slice(&b[..len - from_a]);
            self.bytes.drain(..len);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_keeps_order_and_time() {
        let mut line = Line::default();
        let mut out = Vec::new();
        line.send(1000, 0.005, b"ab");
        line.send(2000, 0.001, b"c");
        line.receive(5999, &mut out);
        assert_eq!(out, b"");
        line.receive(6000, &mut out);
        assert_eq!(out, b"abc");
    }
}
