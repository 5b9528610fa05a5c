//! What the system tells of sockets, locks, processes and users, as text: read without trust. Pure.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

/// State of a TCP socket that listens.
pub(super) const LISTENS: u8 = 0x0A;
/// Most that is shown of a program's name and argument, characters.
const MOST_SHOWN: usize = 40;

/// Of a socket.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Socket {
    pub uid: u32,
    pub inode: u64,
}

/// The socket at an address in `/proc/net/udp`, `tcp` and the like, else the one at all addresses with that port.
/// `states`: those that count; none: all.
pub(super) fn socket_at(text: &str, at: SocketAddr, states: &[u8]) -> Option<Socket> {
    let mut everywhere = None;
    for line in text.lines() {
        let Some((local, state, socket)) = socket_line(line) else { continue };
        if local.port() != at.port() || !(states.is_empty() || states.contains(&state)) {
            continue;
        }
        let ip = local.ip().to_canonical();
        if ip == at.ip().to_canonical() {
            return Some(socket);
        }
        if ip.is_unspecified() || at.ip().is_unspecified() {
            everywhere = everywhere.or(Some(socket));
        }
    }
    everywhere
}

/// Local address, state, socket: `12: 0100007F:38D6 00000000:0000 07 00000000:00000000 00:00000000 00000000 1000 0 42 …`.
fn socket_line(line: &str) -> Option<(SocketAddr, u8, Socket)> {
    let mut fields = line.split_ascii_whitespace().skip(1);
    let local = address(fields.next()?)?;
    let state = u8::from_str_radix(fields.nth(1)?, 16).ok()?;
    let uid = fields.nth(3)?.parse().ok()?;
    let inode = fields.nth(1)?.parse().ok()?;
    Some((local, state, Socket { uid, inode }))
}

/// `0100007F:38D6`: words of 32 bits as this computer stores them, then the port.
fn address(text: &str) -> Option<SocketAddr> {
    let (ip, port) = text.split_once(':')?;
    let port = u16::from_str_radix(port, 16).ok()?;
    let word = |n: usize| u32::from_str_radix(ip.get(8 * n..8 * n + 8)?, 16).ok();
    let ip = match ip.len() {
        8 => IpAddr::V4(Ipv4Addr::from(word(0)?.to_ne_bytes())),
        32 => {
            let words = [word(0)?, word(1)?, word(2)?, word(3)?].map(u32::to_ne_bytes);
            let bytes: [u8; 16] = words.as_flattened().try_into().ok()?;
            IpAddr::V6(Ipv6Addr::from(bytes))
        }
        _ => return None,
    };
    Some(SocketAddr::new(ip, port))
}

/// The process that has a file locked, in `/proc/locks`: `3: FLOCK  ADVISORY  WRITE 4711 00:17:42 0 EOF`.
pub(super) fn lock_of(text: &str, (major, minor): (u32, u32), inode: u64) -> Option<u32> {
    let wanted = format!("{major:02x}:{minor:02x}:{inode}");
    text.lines().find_map(|line| {
        let mut fields = line.split_ascii_whitespace().skip(1);
        // A line with an arrow waits for the lock.
        let held = fields.next()? == "FLOCK";
        let pid = fields.nth(2)?.parse().ok()?;
        (held && fields.next()? == wanted).then_some(pid)
    })
}

/// Name of a user in `/etc/passwd`.
pub(super) fn user(passwd: &str, uid: u32) -> Option<String> {
    passwd.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(uid)).then(|| shown(name))
    })
}

/// Program and first word behind it, of `/proc/PID/cmdline`.
pub(super) fn program(command_line: &[u8]) -> Option<String> {
    let mut words = command_line.split(|byte| *byte == 0).map(String::from_utf8_lossy);
    let program = words.next()?;
    let program = shown(program.rsplit('/').next()?);
    let argument = words.next().filter(|word| !word.is_empty() && !word.starts_with('-'));
    let words = argument.map_or(program.clone(), |argument| format!("{program} {argument}"));
    (!program.is_empty()).then(|| shown(&words))
}

/// Others chose it: it goes to a terminal as plain letters, and not many.
fn shown(text: &str) -> String {
    let plain = |c: char| if c.is_ascii_graphic() || c == ' ' { c } else { '?' };
    text.chars().take(MOST_SHOWN).map(plain).collect()
}

/// Name of a claim. What is reached at all addresses of this computer is reached at its loopback.
pub(super) fn claim_name(place: SocketAddr) -> String {
    let ip = match place.ip().to_canonical() {
        ip if !ip.is_unspecified() => ip,
        _ => IpAddr::V4(Ipv4Addr::LOCALHOST),
    };
    format!("haltere speaks to {}", SocketAddr::new(ip, place.port()))
}

/// The same for a vehicle that others speak beside.
pub(super) fn claim_of(place: SocketAddr, system_id: u8) -> String {
    format!("{} as system {system_id}", claim_name(place))
}

#[cfg(test)]
mod tests {
    use super::*;

    const UDP: &str = "\
   sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode ref pointer drops
 1106: 00000000:38D6 00000000:0000 07 00000000:00000000 00:00000000 00000000  1000        0 4021 2 0000000000000000 0
 1107: 0100007F:38D6 00000000:0000 07 00000000:00000000 00:00000000 00000000  1001        0 4022 2 0000000000000000 0
 1108: 0200007F:3908 00000000:0000 07 00000000:00000000 00:00000000 00000000  1002        0 4023 2 0000000000000000 0
  sl  local_address                         remote_address                        st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode
  12: 00000000000000000000000000000000:2328 00000000000000000000000000000000:0000 0A 00000000:00000000 00:00000000 00000000  1003        0 4024 1
  13: 00000000000000000000000001000000:2329 00000000000000000000000000000000:0000 01 00000000:00000000 00:00000000 00000000  1003        0 4025 1
 rubbish : ::: 99999999999999999999
  14: 0100007F";

    #[test]
    #[cfg(target_endian = "little")]
    fn val_sockets_are_found_as_linux_lists_them() {
        let uid = |at: &str, states: &[u8]| {
            socket_at(UDP, at.parse().unwrap(), states).map(|socket| socket.uid)
        };
        assert_eq!(uid("127.0.0.1:14550", &[]), Some(1001), "the nearer one");
        assert_eq!(uid("192.168.1.7:14550", &[]), Some(1000), "one at all addresses");
        assert_eq!(uid("127.0.0.1:14600", &[]), None, "at another address");
        assert_eq!(uid("0.0.0.0:14600", &[]), Some(1002), "in the way of all addresses");
        assert_eq!(uid("127.0.0.1:9000", &[LISTENS]), Some(1003));
        assert_eq!(uid("[::1]:9001", &[LISTENS]), None, "does not listen");
        assert_eq!(uid("[::1]:9001", &[]), Some(1003));
        let found = socket_at(UDP, "127.0.0.1:14550".parse().unwrap(), &[]);
        assert_eq!(found, Some(Socket { uid: 1001, inode: 4022 }));
    }

    #[test]
    fn prop_locks_users_and_programs_are_read_as_they_are_and_rubbish_is_nothing() {
        let locks = "1: POSIX  ADVISORY  WRITE 11 00:17:42 0 EOF\n\
                     2: FLOCK  ADVISORY  WRITE 12 00:17:42 0 EOF\n\
                     2: -> FLOCK  ADVISORY  WRITE 13 00:17:42 0 EOF\n3: FLOCK";
        assert_eq!(lock_of(locks, (0, 0x17), 42), Some(12));
        assert_eq!(lock_of(locks, (0, 0x17), 43), None);
        let passwd = "root:x:0:0::/root:/bin/sh\nanna:x:1001:1001:Anna,,,:/home/anna:/bin/sh\nx";
        assert_eq!(user(passwd, 1001).as_deref(), Some("anna"));
        assert_eq!(user(passwd, 7), None);
        let told = |line: &[u8]| program(line);
        assert_eq!(told(b"/opt/x/haltere-sim\0serve\0--seed\0"), Some("haltere-sim serve".into()));
        assert_eq!(told(b"qgroundcontrol\0"), Some("qgroundcontrol".into()));
        assert_eq!(told(b"haltere\0--nice\0"), Some("haltere".into()));
        assert_eq!(told(b"a\x1b[31m\0\xff"), Some("a?[31m ?".into()), "no colours of others");
        assert_eq!(told(&[b'y'; 4000]).map(|shown| shown.len()), Some(MOST_SHOWN));
        assert_eq!((told(b""), told(b"\0\0")), (None, None));
    }

    #[test]
    fn prop_claims_are_of_a_place_however_it_is_written() {
        let name = |at: &str| claim_name(at.parse().unwrap());
        assert_eq!(name("0.0.0.0:14550"), name("127.0.0.1:14550"));
        assert_eq!(name("[::]:14550"), name("127.0.0.1:14550"));
        assert_eq!(name("[::ffff:127.0.0.1]:14550"), name("127.0.0.1:14550"));
        assert_ne!(name("127.0.0.1:14551"), name("127.0.0.1:14550"));
        assert_ne!(name("10.0.0.1:14550"), name("127.0.0.1:14550"));
    }
}
