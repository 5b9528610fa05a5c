//! Who else on this computer has a port, speaks to a place, or has a device open: for words, and so that two users of
//! one computer do not fly each other's vehicles.
//!
//! Who sends datagrams takes no port where they arrive, and the kernel lets any number send there. So a vehicle lays a
//! [`Claim`] to each place that it speaks to: an abstract UNIX socket, which has no file, is of the network that the
//! ports are of, tells who made it, and goes with its process.

mod tables;

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use rustix::io::Errno;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, bind, connect, listen, socket_with,
    sockopt,
};
use rustix::process::getuid;

/// Users below are no people but services and root (login.defs).
const FIRST_PERSON: u32 = 1000;
/// Who is nobody: ids that a container does not know.
const NOBODY: u32 = 65_534;
/// Ports behind a default one that are looked at before any free one is taken.
const NEXT_PORTS: u16 = 9;
/// Times that a claim can tell who made it: nobody has to answer.
const MOST_ASKERS: i32 = 1024;
/// Free ports that are tried then.
const FREE_PORTS: usize = 3;

/// Somebody on this computer, as far as the system tells.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Neighbour {
    pid: Option<u32>,
    uid: Option<u32>,
    /// Name of the user.
    user: Option<String>,
    /// The program and its first argument.
    program: Option<String>,
}

impl Neighbour {
    fn new(pid: Option<u32>, uid: Option<u32>) -> Self {
        let read = |path: &str| std::fs::read(path).unwrap_or_default();
        let user = uid.and_then(|uid| tables::user(&lossy(&read("/etc/passwd")), uid));
        let program = pid.and_then(|pid| tables::program(&read(&format!("/proc/{pid}/cmdline"))));
        Self { pid, uid, user, program }
    }

    /// Whether it is somebody else than who runs this program, and a person: services work for people.
    pub fn is_another_person(&self) -> bool {
        let own = getuid().as_raw();
        let person = |uid: u32| uid >= FIRST_PERSON && uid != NOBODY;
        self.uid.is_some_and(|uid| uid != own && person(uid) && person(own))
    }
}

impl fmt::Display for Neighbour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.program {
            Some(program) => write!(f, "`{program}`")?,
            None => write!(f, "a program")?,
        }
        let pid = self.pid.map(|pid| format!("process {pid}"));
        let user = match (&self.user, self.uid) {
            (Some(name), _) => Some(format!("user {name}")),
            (None, uid) => uid.map(|uid| format!("user {uid}")),
        };
        let known: Vec<_> = [pid, user].into_iter().flatten().collect();
        if known.is_empty() { Ok(()) } else { write!(f, " ({})", known.join(", ")) }
    }
}

/// A place that we of this computer speak to, alone or as a vehicle of our number, until this is dropped.
#[derive(Debug)]
pub struct Claim {
    /// `None`: shared, or the system has no such sockets, and everybody speaks where he likes.
    _place: Option<OwnedFd>,
    /// As a vehicle of our number.
    _number: Option<OwnedFd>,
}

/// Lays claim to a place, or says who has done so.
pub fn claim(place: SocketAddr) -> Result<Claim, Neighbour> {
    Ok(Claim { _place: lay(&tables::claim_name(place))?, _number: None })
}

/// Lays claim to a place where a station listens, for the vehicle with a system id. Where it `shares` the place, others of
/// the same user that differ in it may speak there too. Else says who is there.
pub fn claim_as(place: SocketAddr, system_id: u8, shares: bool) -> Result<Claim, Neighbour> {
    let number = lay(&tables::claim_of(place, system_id))?;
    match claim(place) {
        Ok(alone) => Ok(Claim { _number: number, ..alone }),
        Err(who) if !shares || who.is_another_person() || listens(&who, place) => Err(who),
        Err(_) => Ok(Claim { _place: None, _number: number }),
    }
}

/// Whether who claims a place listens there himself: no station does.
fn listens(who: &Neighbour, place: SocketAddr) -> bool {
    let unknown = |has: &Neighbour| has.pid.is_none() && has.uid == who.uid;
    holder(Transport::Udp, place).is_some_and(|has| has.pid == who.pid || unknown(&has))
}

fn lay(name: &str) -> Result<Option<OwnedFd>, Neighbour> {
    let Some((socket, at)) = claim_socket(name) else { return Ok(None) };
    match bind(&socket, &at).and_then(|()| listen(&socket, MOST_ASKERS)) {
        Ok(()) => Ok(Some(socket)),
        Err(Errno::ADDRINUSE) => Err(who_laid(name).unwrap_or_default()),
        Err(_) => Ok(None),
    }
}

/// Who has laid claim to a place.
pub fn claimant(place: SocketAddr) -> Option<Neighbour> {
    who_laid(&tables::claim_name(place))
}

fn who_laid(name: &str) -> Option<Neighbour> {
    let (socket, name) = claim_socket(name)?;
    match connect(&socket, &name) {
        Ok(()) => {}
        // It does not answer, it is only there.
        Err(Errno::AGAIN) => return Some(Neighbour::default()),
        Err(_) => return None,
    }
    let made_by = sockopt::socket_peercred(&socket).ok()?;
    let pid = u32::try_from(made_by.pid.as_raw_nonzero().get()).ok();
    Some(Neighbour::new(pid, Some(made_by.uid.as_raw())))
}

fn claim_socket(name: &str) -> Option<(OwnedFd, SocketAddrUnix)> {
    let name = SocketAddrUnix::new_abstract_name(name.as_bytes()).ok()?;
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None).ok()?;
    Some((socket, name))
}

/// Kind of a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transport {
    /// Datagrams.
    Udp,
    /// Connections.
    Tcp,
}

/// Who has this port of this computer: of its sockets the one at the address, else one at all addresses.
pub fn holder(transport: Transport, at: SocketAddr) -> Option<Neighbour> {
    let listening: &[u8] = match transport {
        Transport::Udp => &[],
        Transport::Tcp => &[tables::LISTENS],
    };
    socket(transport, at, listening)
}

fn socket(transport: Transport, at: SocketAddr, states: &[u8]) -> Option<Neighbour> {
    let files = match transport {
        Transport::Udp => ["udp", "udp6"],
        Transport::Tcp => ["tcp", "tcp6"],
    };
    let text: String = files
        .iter()
        .filter_map(|name| std::fs::read_to_string(format!("/proc/self/net/{name}")).ok())
        .collect();
    let socket = tables::socket_at(&text, at, states)?;
    Some(Neighbour::new(process_with(socket.inode), Some(socket.uid)))
}

/// Why nothing of ours can listen at a place: who has the port, where that is known, else the system's word.
pub fn why_not(transport: Transport, host: &str, port: u16, error: &std::io::Error) -> String {
    let taken = error.kind() == std::io::ErrorKind::AddrInUse;
    let who = place(host, port).filter(|_| taken).and_then(|at| {
        let has = holder(transport, at)?;
        // Of another user's the claim tells more: which program it is.
        Some(claimant(at).filter(|claims| claims.uid == has.uid).unwrap_or(has))
    });
    who.map_or_else(|| error.to_string(), |who| format!("{who} has this port"))
}

/// The program of this computer that speaks to us from an address; `None`: another computer's, or it is gone.
pub fn sender(transport: Transport, from: SocketAddr) -> Option<Neighbour> {
    if from.ip().is_loopback() { socket(transport, from, &[]) } else { None }
}

/// Who has this file locked for himself.
pub fn locker(path: &Path) -> Option<Neighbour> {
    let file = std::fs::metadata(path).ok()?;
    let (dev, inode) = (file.dev(), file.ino());
    let device = (rustix::fs::major(dev), rustix::fs::minor(dev));
    let locks = std::fs::read_to_string("/proc/locks").ok()?;
    let pid = tables::lock_of(&locks, device, inode)?;
    let uid = std::fs::metadata(format!("/proc/{pid}")).ok().map(|process| process.uid());
    Some(Neighbour::new(Some(pid), uid))
}

/// The process that has this socket open, where that may be looked at.
fn process_with(inode: u64) -> Option<u32> {
    let wanted = format!("socket:[{inode}]");
    let number = |entry: std::fs::DirEntry| entry.file_name().to_str()?.parse::<u32>().ok();
    let processes = std::fs::read_dir("/proc").ok()?.flatten().filter_map(number);
    let has = |pid: &u32| {
        let open = std::fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
        open.filter_map(|fd| std::fs::read_link(fd.path()).ok()).any(|to| *to == *wanted)
    };
    processes.into_iter().find(has)
}

/// Ports of this computer to try where nobody asked for one: the usual one, those behind it, then any free ones.
pub fn candidates(first: u16) -> impl Iterator<Item = u16> {
    let next = first..=first.saturating_add(NEXT_PORTS);
    next.chain((0..FREE_PORTS).filter_map(|_| free_port()))
}

/// A UDP port that was free a moment ago.
fn free_port() -> Option<u16> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).ok()?;
    Some(socket.local_addr().ok()?.port())
}

/// A place as those who reach it by this computer's loopback write it, where the host is a number or `localhost`:
/// names are not looked up.
pub fn place(host: &str, port: u16) -> Option<SocketAddr> {
    let ip = match host {
        "localhost" => IpAddr::V4(Ipv4Addr::LOCALHOST),
        host => host.parse().ok()?,
    };
    Some(SocketAddr::new(ip, port))
}

fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn prop_a_place_is_claimed_once_and_free_again_when_that_is_dropped() {
        let at = place("127.0.0.1", free_port().unwrap()).unwrap();
        assert_eq!(claimant(at), None);
        let first = claim(at).unwrap();
        // Asked often, it says the same: it has not to answer.
        for _ in 0..20 {
            let other = claim(at).unwrap_err();
            assert_eq!(other.pid.or(Some(std::process::id())), Some(std::process::id()));
            assert!(!other.is_another_person());
        }
        // All addresses of this computer are its loopback too.
        assert!(claim(place("0.0.0.0", at.port()).unwrap()).is_err());
        assert!(claim(place("10.0.0.1", at.port()).unwrap()).is_ok());
        drop(first);
        assert!(claim(at).is_ok());
    }

    #[test]
    fn prop_vehicles_of_two_numbers_share_a_station_and_those_of_one_do_not() {
        let at = place("127.0.0.1", free_port().unwrap()).unwrap();
        let first = claim_as(at, 1, true).unwrap();
        assert!(claim_as(at, 1, true).is_err());
        let second = claim_as(at, 2, true).unwrap();
        assert!(claim_as(at, 2, true).is_err());
        // Whoever wants it for himself does not get it.
        assert!(claim(at).is_err() && claim_as(at, 3, false).is_err());
        drop(first);
        assert!(claim_as(at, 2, true).is_err(), "its number is taken, whoever came first");
        drop(second);
        // Where a companion itself listens there is no station.
        let listener = UdpSocket::bind(at).unwrap();
        let alone = claim(at).unwrap();
        assert!(claim_as(at, 3, true).is_err());
        drop((listener, alone));
        assert!(claim_as(at, 3, true).is_ok());
    }

    #[test]
    fn prop_who_has_a_port_is_told_by_name() {
        let udp = UdpSocket::bind("0.0.0.0:0").unwrap();
        let at = place("127.0.0.1", udp.local_addr().unwrap().port()).unwrap();
        let who = holder(Transport::Udp, at).unwrap();
        assert_eq!((who.pid, who.uid), (Some(std::process::id()), Some(getuid().as_raw())));
        let words = who.to_string();
        assert!(words.contains(&format!("process {}", std::process::id())), "{words}");
        assert_eq!(sender(Transport::Udp, at), Some(who));
        assert_eq!(sender(Transport::Udp, place("192.0.2.1", at.port()).unwrap()), None);
        let tcp = TcpListener::bind("127.0.0.1:0").unwrap();
        assert!(holder(Transport::Tcp, tcp.local_addr().unwrap()).is_some());
        drop(udp);
        assert_eq!(holder(Transport::Udp, at), None);
    }

    #[test]
    fn prop_who_has_a_file_locked_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("device");
        std::fs::write(&path, "").unwrap();
        assert_eq!(locker(&path), None);
        let held = std::fs::File::open(&path).unwrap();
        held.lock().unwrap();
        // A file system that counts its devices otherwise than its locks tells nothing.
        assert_eq!(
            locker(&path).map_or(Some(std::process::id()), |who| who.pid),
            Some(std::process::id())
        );
        drop(held);
        assert_eq!(locker(&path), None);
        assert_eq!(locker(&folder.path().join("none")), None);
    }

    #[test]
    fn prop_services_are_nobody_else() {
        let of = |uid| Neighbour { uid: Some(uid), ..Neighbour::default() };
        assert!(!of(0).is_another_person() && !of(999).is_another_person());
        assert!(!of(getuid().as_raw()).is_another_person());
        assert!(!Neighbour::default().is_another_person());
        assert_eq!(Neighbour::default().to_string(), "a program");
        assert_eq!(of(4711).to_string(), "a program (user 4711)");
    }
}
