//! A serial line of finite speed, with a buffer before it.
//!
//! What does not fit into the buffer is not sent: streams get slower, and everything that is sent waits
//! until the buffer before it has left. At 115200 baud and 1 kB that is 90 ms (seen with ArduPilot).

/// Bits on the wire for a byte: start, eight, stop.
const BITS: f64 = 10.0;
/// Buffer before the line, bytes: round trips of 90 ms at 11.5 kB/s.
const BUFFER_B: f64 = 1024.0;

/// The line.
#[derive(Debug, Clone)]
pub struct SlowLine {
    bytes_per_s: f64,
    waiting_B: f64,
    last_s: f64,
}

impl SlowLine {
    /// `None` for 0 baud: no limit.
    pub fn new(baud: u32) -> Option<Self> {
        (baud > 0).then(|| Self {
            bytes_per_s: f64::from(baud) / BITS,
            waiting_B: 0.0,
            last_s: 0.0,
        })
    }

    fn drain(&mut self, t_s: f64) {
        let gone = (t_s - self.last_s).max(0.0) * self.bytes_per_s;
        self.waiting_B = (self.waiting_B - gone).max(0.0);
        self.last_s = t_s;
    }

    /// Whether so many bytes find room now; if so they are under way.
    pub fn takes(&mut self, t_s: f64, bytes: usize) -> bool {
        self.drain(t_s);
        let fits = self.waiting_B + bytes as f64 <= BUFFER_B;
        if fits {
            self.waiting_B += bytes as f64;
        }
        fits
    }

    /// Time until all that waits now has left, s.
    pub fn delay_s(&self) -> f64 {
        self.waiting_B / self.bytes_per_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_asked_for_too_much_it_carries_its_speed_and_answers_after_90_ms() {
        let mut line = SlowLine::new(115_200).unwrap();
        let (mut carried, mut worst_s) = (0, 0.0f64);
        for step in 0..5000 {
            // 20 kB/s are asked for.
            if line.takes(f64::from(step) * 0.002, 40) {
                carried += 40;
                worst_s = worst_s.max(line.delay_s());
            }
        }
        assert!((f64::from(carried) / 10.0 / 11_520.0 - 1.0).abs() < 0.02, "{carried}");
        assert!((0.080..0.090).contains(&worst_s), "{worst_s}");
        assert!(SlowLine::new(0).is_none());
    }
}
