//! Cuts the stream of one TCP client at the ends of MAVLink frames, by length alone, so that the
//! streams of several clients can share a link without tearing each other's frames. Nothing is
//! checked and nothing is thrown away: that is the core's task.

use std::collections::VecDeque;

/// MAVLink 2: marker, head of 10 bytes, checksum of 2, signature of 13 if flagged.
const V2: u8 = 0xfd;
const V2_OVERHEAD_BYTES: usize = 12;
const V2_SIGNATURE_BYTES: usize = 13;
const V2_SIGNED: u8 = 0x01;
/// MAVLink 1: marker, head of 6 bytes, checksum of 2.
const V1: u8 = 0xfe;
const V1_OVERHEAD_BYTES: usize = 8;

/// Bytes of one client that are not passed on yet: less than one frame between calls.
#[derive(Debug, Default)]
pub(super) struct WholeFrames(VecDeque<u8>);

impl WholeFrames {
    pub(super) fn push(&mut self, bytes: &[u8]) {
        self.0.extend(bytes);
    }

    /// The next whole frame, or the garbage before it. `None`: more bytes are needed.
    pub(super) fn next(&mut self) -> Option<Vec<u8>> {
        let length = match *self.0.front()? {
            V2 => {
                let signed = self.0.get(2)? & V2_SIGNED != 0;
                let payload = usize::from(*self.0.get(1)?);
                V2_OVERHEAD_BYTES + payload + if signed { V2_SIGNATURE_BYTES } else { 0 }
            }
            V1 => V1_OVERHEAD_BYTES + usize::from(*self.0.get(1)?),
            _ => self.0.iter().take_while(|b| !matches!(**b, V1 | V2)).count(),
        };
        (self.0.len() >= length).then(|| self.0.drain(..length).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn v2(payload: u8, flags: u8) -> Vec<u8> {
        let mut frame = vec![V2, payload, flags, 0, 1, 1, 1, 0, 0, 0];
        let tail = 2 + if flags & 1 != 0 { 13 } else { 0 };
        frame.extend(vec![payload; usize::from(payload) + tail]);
        frame
    }

    #[test]
    fn prop_whatever_comes_less_than_a_frame_is_held() {
        // Markers only, with the longest length that can be claimed, and every byte that there is.
        for byte in 0..=255 {
            let mut cutter = WholeFrames::default();
            for _ in 0..1000 {
                cutter.push(&[byte; 97]);
                while cutter.next().is_some() {}
                assert!(cutter.0.len() < 12 + 255 + 13, "{byte}: {}", cutter.0.len());
            }
        }
    }

    #[test]
    fn prop_nothing_is_lost_and_frames_stay_whole_in_any_chunking() {
        let mut stream = vec![1, 2, 3];
        let frames = [v2(0, 0), v2(9, 1), vec![V1, 2, 0, 1, 1, 0, 7, 7, 8, 8], v2(250, 0)];
        stream.extend(frames.concat());
        for chunk in [1, 2, 3, 7, 64, 1000] {
            let mut cutter = WholeFrames::default();
            let mut got = Vec::new();
            for bytes in stream.chunks(chunk) {
                cutter.push(bytes);
                while let Some(piece) = cutter.next() {
                    got.push(piece);
                }
            }
            assert_eq!(got.concat(), stream);
            let garbage = got.iter().take_while(|p| p[0] < 4).count();
            assert_eq!(got[garbage..], frames);
        }
    }
}
