//! What a line carries beside what its speed says: the radio at its end tells how full its buffer is.
//!
//! RADIO_STATUS of a SiK radio, `txbuf`: the free share of its buffer in percent. Thresholds are those of PX4
//! (`Mavlink::update_radio_status` of its `mavlink_main.cpp`). Its steps are made larger, and down only
//! while the buffer does not empty: at 2 kB/s it holds two seconds, which is how late a step shows.

/// Below this the line carries less than it is sent, percent free.
const FULL_PERCENT: u8 = 25;
/// Above this there is room for more, percent free.
const HALF_PERCENT: u8 = 50;
/// Factors of a step down (chosen: PX4 has 0.8), and of one up (chosen: twice PX4's 2.5 %).
const DOWN: f64 = 0.7;
const UP: f64 = 1.05;
/// Least share of the line: 2 % of 57 600 baud still carry a heartbeat and an answer a second.
const LEAST_SHARE: f64 = 0.02;
/// What a radio behind a line of unknown speed is sent at first, bytes/s: 57 600 baud, as SiK radios are delivered.
pub(crate) const USUAL_BPS: f64 = 5760.0;

/// The share of a line that its radio carries on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Radio {
    /// 0 to 1.
    pub share: f64,
    free_percent: u8,
}

impl Default for Radio {
    fn default() -> Self {
        Self { share: 1.0, free_percent: 100 }
    }
}

impl Radio {
    /// The radio has told how much of its buffer is free, percent.
    pub fn told(&mut self, free_percent: u8) {
        let before = std::mem::replace(&mut self.free_percent, free_percent);
        if free_percent < FULL_PERCENT && free_percent <= before {
            self.share = (self.share * DOWN).max(LEAST_SHARE);
        } else if free_percent > HALF_PERCENT {
            self.share = (self.share * UP).min(1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use haltere_dialect::mav::haltere::{
        COMMAND_LONG_DATA, MavCmd, MavMessage, PARAM_REQUEST_LIST_DATA, RADIO_STATUS_DATA,
    };
    use haltere_dialect::mav_stream;

    use super::super::endpoint::Endpoint;
    use crate::bench::Bench;
    use crate::config::PilotConfig;

    /// A radio that carries 2 kB/s and holds 4 kB behind a line of 57 600 baud: it was sent 4.9 kB/s, 60 % were lost,
    /// and 21 of 183 parameters arrived.
    #[test]
    fn regress_a_slow_radio_is_sent_what_it_carries() {
        const CARRIES_BPS: f64 = 2000.0;
        const HOLDS_B: f64 = 4096.0;
        let endpoint = Endpoint { line_Bps: Some(5760.0), ..Endpoint::default() };
        let config = PilotConfig { endpoints: vec![endpoint], ..PilotConfig::default() };
        let mut bench = Bench::new(config);
        // What comes without a board, often: 6 kB/s.
        for msg_id in [1_u8, 2, 42, 245] {
            bench.says(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16,
                param1: f32::from(msg_id),
                param2: 2e4,
                ..Default::default()
            }));
        }
        let mut waits_B = 0.0_f64;
        let (mut sent_B, mut lost_B, mut beats) = (0.0, 0.0, 0);
        let mut parameters = std::collections::BTreeSet::new();
        let mut count = usize::MAX;
        for step in 0..6000 {
            let t_s = 0.01 * f64::from(step);
            waits_B = (waits_B - 0.01 * CARRIES_BPS).max(0.0);
            let mut heard = bench.run(0.01);
            if step % 50 == 0 {
                let txbuf = (100.0 * (1.0 - waits_B / HOLDS_B)) as u8;
                let status = RADIO_STATUS_DATA { txbuf, ..Default::default() };
                heard.extend(bench.says(&MavMessage::RADIO_STATUS(status)));
            }
            if step == 1000 {
                let ask = PARAM_REQUEST_LIST_DATA::default();
                heard.extend(bench.says(&MavMessage::PARAM_REQUEST_LIST(ask)));
            }
            for message in heard {
                let mut bytes = Vec::new();
                mav_stream::encode(&mut bytes, 1, 1, 0, &message);
                let size_B = bytes.len() as f64;
                let is_lost = waits_B + size_B > HOLDS_B;
                if t_s > 10.0 {
                    sent_B += size_B;
                    lost_B += if is_lost { size_B } else { 0.0 };
                }
                if is_lost {
                    continue;
                }
                waits_B += size_B;
                match message {
                    MavMessage::HEARTBEAT(_) if t_s > 10.0 => beats += 1,
                    MavMessage::PARAM_VALUE(m) => {
                        count = usize::from(m.param_count);
                        parameters.insert(m.param_index);
                    }
                    _ => {}
                }
            }
        }
        assert_eq!(parameters.len(), count, "parameters");
        assert!(beats >= 49, "{beats} heartbeats in 50 s");
        assert!(lost_B < 0.01 * sent_B, "{lost_B} of {sent_B} bytes lost");
        assert!(sent_B > 50.0 * 0.6 * CARRIES_BPS, "{sent_B} bytes in 50 s");
    }
}
