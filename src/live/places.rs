//! The places that this vehicle speaks to, beside vehicles of others on the same computer.

use std::net::SocketAddr;

use super::LiveError;
use crate::neighbours::{self, Claim, Neighbour, Transport};
use crate::sources::Loaded;
use haltere_pilot::settings::{Address, GroundConfig, HostPort};

/// Lays claim to the places of stations, and to that of the board where we begin to speak. A place that is another
/// vehicle's is refused where somebody asked for it; where nobody did another one is taken, told, and written into
/// the configuration. Where stations listen that were asked for, vehicles of one user may differ in their number. The
/// claims hold until they are dropped.
pub fn settle(loaded: &mut Loaded) -> Result<Vec<Claim>, LiveError> {
    let config = &mut loaded.config;
    let mut claims = Vec::new();
    // Who only watches speaks beside somebody else, by the way that was set up for both.
    if let Address::UdpOut(to) = &config.board.address
        && !config.flight.shadow
        && let Some(place) = neighbours::place(&to.host, to.port)
    {
        claims.push(neighbours::claim(place).map_err(|who| LiveError::BoardShared {
            address: config.board.address.clone(),
            who: who.to_string(),
        })?);
    }
    claims.extend(stations(&mut config.ground, loaded.stations_unasked)?);
    Ok(claims)
}

/// The same for the places of stations alone; `free`: nobody asked for them. Says how a client writes each.
pub fn stations(ground: &mut GroundConfig, free: bool) -> Result<Vec<Claim>, LiveError> {
    let system_id = ground.system_id;
    let mut claims = Vec::new();
    for (i, endpoint) in ground.endpoints.iter_mut().enumerate() {
        let asked = endpoint.address.clone();
        let (Address::UdpIn(at) | Address::UdpOut(at)) = &mut endpoint.address else { continue };
        // A name is looked up later, and again until that works: it must not hold up the start.
        let Some(place) = neighbours::place(&at.host, at.port) else { continue };
        let key = format!("ground.endpoints[{i}]");
        let speaks = matches!(asked, Address::UdpOut(_));
        let claimed = match speaks {
            true => neighbours::claim_as(place, system_id, !free),
            false => neighbours::claim(place),
        };
        let listens = stranger(place).filter(|_| speaks);
        match (claimed, listens) {
            (Err(who), _) if !free => {
                let who = who.to_string();
                return Err(LiveError::StationsShared { key, address: asked, who });
            }
            (Err(who), _) => {
                claims.push(elsewhere(at, system_id, &key, &format!("{who} speaks there"))?)
            }
            (Ok(_), Some(who)) if free => {
                claims.push(elsewhere(at, system_id, &key, &format!("{who} listens there"))?);
            }
            (Ok(claim), listens) => {
                if let Some(who) = listens {
                    tracing::warn!(
                        "{key} = \"{asked}\": {who} listens there, sees this vehicle and may command it"
                    );
                }
                claims.push(claim);
            }
        }
    }
    for endpoint in &ground.endpoints {
        tracing::info!("stations: {}", endpoint.address.for_client());
    }
    Ok(claims)
}

/// Another person's program that listens there.
fn stranger(place: SocketAddr) -> Option<Neighbour> {
    if !place.ip().is_loopback() {
        return None;
    }
    neighbours::holder(Transport::Udp, place).filter(Neighbour::is_another_person)
}

/// The next port at which nobody is.
fn elsewhere(at: &mut HostPort, system_id: u8, key: &str, why: &str) -> Result<Claim, LiveError> {
    let usual = at.port;
    for port in neighbours::candidates(usual).skip(1) {
        at.port = port;
        let place = neighbours::place(&at.host, at.port);
        let Some(place) =
            place.filter(|place| neighbours::holder(Transport::Udp, *place).is_none())
        else {
            continue;
        };
        if let Ok(claim) = neighbours::claim_as(place, system_id, false) {
            tracing::warn!(
                "{key}: port {usual} is not ours, {why}; this vehicle speaks to udpout:{at}: \
                 `haltere ctl --to udpin:{at}`"
            );
            return Ok(claim);
        }
    }
    Err(LiveError::NoFreePort { key: key.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_pilot::settings::Config;

    fn loaded(endpoints: &[String], stations_unasked: bool) -> Loaded {
        let mut config = Config::default();
        config.ground.endpoints =
            endpoints.iter().map(|e| e.parse::<Address>().unwrap().into()).collect();
        let anchors = concat!(env!("CARGO_MANIFEST_DIR"), "/config/anchors.toml");
        Loaded {
            config,
            survey: crate::sources::read_anchors(anchors.as_ref()).unwrap(),
            files: Vec::new(),
            notes: Vec::new(),
            lost: None,
            stations_unasked,
        }
    }

    fn free() -> SocketAddr {
        std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
    }

    #[test]
    fn prop_a_place_of_another_vehicle_is_refused_where_asked_for_and_left_where_not() {
        let at = free();
        let address = format!("udpout:{at}");
        let first = settle(&mut loaded(std::slice::from_ref(&address), false)).unwrap();
        assert_eq!(first.len(), 1);
        let mut second = loaded(std::slice::from_ref(&address), false);
        let error = settle(&mut second).unwrap_err().to_string();
        for word in ["ground.endpoints[0]", &address, "speaks to stations there", "another port"] {
            assert!(error.contains(word), "{word}: {error}");
        }
        // Nor may one listen where the other speaks to.
        assert!(settle(&mut loaded(&[format!("udpin:0.0.0.0:{}", at.port())], false)).is_err());
        let mut third = loaded(std::slice::from_ref(&address), true);
        let claims = settle(&mut third).unwrap();
        let moved = third.config.ground.endpoints[0].address.to_string();
        assert!(claims.len() == 1 && moved.starts_with("udpout:127.0.0.1:"), "{moved}");
        assert_ne!(moved, address);
        assert!(settle(&mut loaded(&[moved], false)).is_err(), "its number speaks there");
        // With another number it is another vehicle to them.
        let mut numbered = loaded(std::slice::from_ref(&address), false);
        numbered.config.ground.system_id = 2;
        drop(settle(&mut numbered).unwrap());
        drop(first);
        let mut again = loaded(std::slice::from_ref(&address), true);
        assert!(settle(&mut again).is_ok());
        assert_eq!(again.config.ground.endpoints[0].address.to_string(), address, "free again");
    }

    #[test]
    fn prop_two_companions_do_not_command_one_board_but_one_may_watch() {
        let board: Address = format!("udpout:{}", free()).parse().unwrap();
        let with = |shadow| {
            let mut loaded = loaded(&[], false);
            loaded.config.board.address = board.clone();
            loaded.config.flight.shadow = shadow;
            settle(&mut loaded)
        };
        let first = with(false).unwrap();
        let error = with(false).unwrap_err().to_string();
        assert!(error.starts_with(&format!("board.address = \"{board}\": ")), "{error}");
        assert!(error.contains("commands the board there"), "{error}");
        assert!(with(true).is_ok());
        drop(first);
        assert!(with(false).is_ok());
    }
}
