//! Other stations of this computer that found our port taken and speak to the vehicle through us. Pure.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use haltere_dialect::mav::haltere::{MavMessage, MavType};
use haltere_dialect::mav_stream::MavSplitter;

/// A guest that was silent for so long has left: ours says something every 0.2 s, others every second.
const LEFT: Duration = Duration::from_secs(3);
/// Most at once, as many as share a `udpin` endpoint of the companion.
const MOST: usize = 8;

/// Those who were heard lately.
#[derive(Debug, Default)]
pub(super) struct Guests(Vec<(SocketAddr, Instant)>);

impl Guests {
    /// Whether these bytes are a guest's. One begins with the heartbeat of a station, and is on this computer: to others
    /// the vehicle would not listen either.
    pub fn hear(&mut self, from: SocketAddr, bytes: &[u8], now: Instant) -> bool {
        self.0.retain(|(_, heard)| now.saturating_duration_since(*heard) < LEFT);
        if let Some((_, heard)) = self.0.iter_mut().find(|(guest, _)| *guest == from) {
            *heard = now;
            return true;
        }
        let welcome = self.0.len() < MOST && from.ip().is_loopback() && is_beat_of_station(bytes);
        if welcome {
            self.0.push((from, now));
        }
        welcome
    }

    /// Where they are.
    pub fn places(&self) -> impl Iterator<Item = SocketAddr> {
        self.0.iter().map(|(guest, _)| *guest)
    }
}

fn is_beat_of_station(bytes: &[u8]) -> bool {
    let mut splitter = MavSplitter::new();
    splitter.push(bytes);
    let first = splitter.next().and_then(Result::ok).map(|frame| frame.decode());
    matches!(first, Some(Ok(MavMessage::HEARTBEAT(beat))) if beat.mavtype == MavType::MAV_TYPE_GCS as u8)
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

    use haltere_dialect::mav::haltere::{COMMAND_ACK_DATA, HEARTBEAT_DATA, MavCmd, MavModeFlag};
    use haltere_dialect::mav_stream::encode;

    use super::super::GroundStation;
    use super::*;

    /// Flies until it is told to land; speaks to one port alone, as a `udpout` endpoint does.
    fn vehicle(to: SocketAddr, stop: &AtomicBool) {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        let (mut splitter, mut buffer, mut sequence) = (MavSplitter::new(), [0; 2048], 0_u8);
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        while !stop.load(Relaxed) {
            let mut says =
                vec![MavMessage::HEARTBEAT(HEARTBEAT_DATA { base_mode, ..Default::default() })];
            if let Ok((n, _)) = socket.recv_from(&mut buffer) {
                splitter.push(&buffer[..n]);
            }
            while let Some(Ok(frame)) = splitter.next() {
                if let Ok(MavMessage::COMMAND_LONG(asked)) = frame.decode() {
                    if asked.command == MavCmd::MAV_CMD_NAV_LAND as u16 {
                        base_mode = MavModeFlag::empty();
                    }
                    let ack = COMMAND_ACK_DATA { command: asked.command, ..Default::default() };
                    says.push(MavMessage::COMMAND_ACK(ack));
                }
            }
            for said in says {
                let mut bytes = Vec::new();
                encode(&mut bytes, 1, 1, sequence, &said);
                sequence = sequence.wrapping_add(1);
                socket.send_to(&bytes, to).unwrap();
            }
        }
    }

    /// `ctl land` beside a `ctl mission` that waited was refused, and a wait did not notice that the companion had gone.
    #[test]
    fn regress_a_second_station_lands_what_the_first_one_flies() {
        let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let flies = std::thread::spawn({
            let stop = stop.clone();
            move || vehicle(port, &stop)
        });
        let address = format!("udpin:{port}");
        let mut first = GroundStation::connect(&address).unwrap();
        let patience = Duration::from_secs(60);
        let waits = std::thread::spawn(move || {
            first.wait("the landing", patience, |v| (!v.armed).then_some(()))
        });
        let mut second = GroundStation::connect(&address).unwrap();
        assert!(second.vehicle().armed);
        second.command(MavCmd::MAV_CMD_NAV_LAND, [f32::NAN; 7]).unwrap();
        waits.join().unwrap().unwrap();
        // The first one is gone, and the port with it.
        second.listen(Duration::from_secs(1)).unwrap();
        let third = std::thread::spawn(move || GroundStation::connect(&address).map(drop));
        second.listen(Duration::from_secs(1)).unwrap();
        third.join().unwrap().unwrap();
        second.command(MavCmd::MAV_CMD_NAV_LAND, [f32::NAN; 7]).unwrap();
        stop.store(true, Relaxed);
        flies.join().unwrap();
        let began = Instant::now();
        let gone = second.wait("nothing", patience, |_| None::<()>).unwrap_err().to_string();
        assert!(gone.contains("no heartbeat for 5 s: the companion is gone"), "{gone}");
        assert!(began.elapsed() < patience / 2, "{:?}", began.elapsed());
    }

    #[test]
    fn prop_guests_are_stations_of_this_computer_and_leave_in_silence() {
        let now = Instant::now();
        let beat = |mavtype: MavType| {
            let mut bytes = Vec::new();
            let beat = HEARTBEAT_DATA { mavtype: mavtype as u8, ..Default::default() };
            encode(&mut bytes, 255, 190, 0, &MavMessage::HEARTBEAT(beat));
            bytes
        };
        let (station, other) = (beat(MavType::MAV_TYPE_GCS), beat(MavType::MAV_TYPE_QUADROTOR));
        let at = |port| SocketAddr::from(([127, 0, 0, 1], port));
        let mut guests = Guests::default();
        assert!(!guests.hear(at(1), &other, now));
        assert!(!guests.hear("192.0.2.1:1".parse().unwrap(), &station, now));
        assert!(guests.hear(at(1), &station, now));
        assert!(guests.hear(at(1), &other, now), "it is known");
        assert_eq!((2..20).filter(|port| guests.hear(at(*port), &station, now)).count(), MOST - 1);
        assert!(guests.hear(at(30), &station, now + LEFT));
        assert_eq!(guests.places().collect::<Vec<_>>(), [at(30)]);
    }
}
