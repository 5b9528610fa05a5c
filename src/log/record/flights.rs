//! The flights in a log, and the part of it that belongs to one of them.
//!
//! A flight lasts from leaving [`Mode::Disarmed`] to coming back to it, if the vehicle left the floor meanwhile. A log
//! may hold several. Everything that takes one flight of a log takes the last, unless it is told which; so a page or a
//! diagnosis is of what was flown last, and holds no more of a long log than that.

use serde::Serialize;

use super::channels::Decoded;
use super::entry::Entry;
use super::errors::LogError;
use super::reader::LogReader;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_pilot::Mode;

/// Kept before a flight and behind it, s: alignment, arming and the battery at rest take less (judgement).
const BESIDE_S: f64 = 60.0;
/// Kept of a log without a flight, its end, s (judgement).
const WITHOUT_S: f64 = 600.0;
/// Flights that an error lists.
const MOST_TOLD: usize = 8;

/// A flight, as its log counts it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LogFlight {
    /// Its number in the log, from 1.
    pub number: usize,
    /// How many the log holds.
    pub of: usize,
    /// Begin, s since the companion started.
    pub from_s: f64,
    /// End, s since the companion started.
    pub to_s: f64,
}

impl LogFlight {
    /// For people, where the log holds others too.
    pub fn words(&self) -> Option<String> {
        (self.of > 1).then(|| format!("{self}; --flight N takes another"))
    }
}

impl std::fmt::Display for LogFlight {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { number, of, from_s, to_s } = self;
        write!(f, "flight {number} of {of} in this log, {from_s:.1} to {to_s:.1} s")
    }
}

/// Whether the vehicle stands on the floor in a mode; a mode of another build is one of the air.
pub fn is_on_floor(mode: &str) -> bool {
    let on_floor = [Mode::Disarmed, Mode::Arming, Mode::Idle, Mode::Disarming];
    Mode::from_name(mode).is_some_and(|mode| on_floor.contains(&mode))
}

/// Where a flight lies: times, and the numbers of the changes of mode that open and close it.
#[derive(Debug, Clone, Copy)]
struct Span {
    from: HostTime,
    to: HostTime,
    opens: u64,
    closes: Option<u64>,
}

/// The flights of a log, in their order.
#[derive(Debug, Default)]
pub struct Flights {
    flown: Vec<Span>,
    /// One that has not ended, and whether it has left the floor.
    open: Option<(Span, bool)>,
    changes: u64,
    newest: HostTime,
    /// Whether the changes of mode are those of a replay: the log holds none.
    replayed: bool,
}

impl Flights {
    /// As the log tells. Without decoded topics it tells none.
    pub fn recorded(log: &LogReader) -> Self {
        let mut flights = Self::default();
        let outline = log.outline();
        let modes = outline.as_ref().and_then(|outline| outline.entries("/mode"));
        if let (Some(modes), Some([_, last])) = (modes, outline.and_then(|outline| outline.span)) {
            modes.iter().for_each(|entry| flights.take(entry));
            flights.newest = last;
        } else {
            let entries = log.entries_with(|channel| channel == "/mode");
            entries.for_each(|entry| flights.take(&entry));
        }
        flights.end()
    }

    /// As the core tells that lives through the log again.
    pub fn replayed(modes: &[(HostTime, &str)], last: HostTime) -> Self {
        let mut flights = Self { replayed: true, ..Self::default() };
        for (at, mode) in modes {
            flights.change(*at, mode);
        }
        flights.newest = last;
        flights.end()
    }

    /// Whether the log told of any change of mode.
    pub fn any_change(&self) -> bool {
        self.changes > 0
    }

    fn take(&mut self, entry: &Entry) {
        match entry {
            Entry::Input { at, .. } => self.newest = *at,
            Entry::Decoded(Decoded::Mode(m)) => self.change(HostTime::from_us(m.at_us), &m.mode),
            _ => {}
        }
    }

    fn change(&mut self, at: HostTime, mode: &str) {
        self.changes += 1;
        if mode == Mode::Disarmed.name() {
            if let Some((span, true)) = self.open.take() {
                self.flown.push(Span { to: at, closes: Some(self.changes), ..span });
            }
            return;
        }
        let new = Span { from: at, to: at, opens: self.changes, closes: None };
        let (_, flown) = self.open.get_or_insert((new, false));
        *flown |= !is_on_floor(mode);
    }

    fn end(mut self) -> Self {
        if let Some((span, true)) = self.open.take() {
            self.flown.push(Span { to: self.newest.max(span.from), ..span });
        }
        self
    }

    /// The part of one flight, by its number; without one of the last. Of a log without a flight its end.
    pub fn part(&self, log: &LogReader, asked: Option<usize>) -> Result<FlightPart, LogError> {
        let start = log.session().pilot_started_at;
        let told = |n: usize, span: &Span| LogFlight {
            number: n,
            of: self.flown.len(),
            from_s: span.from.seconds_since(start),
            to_s: span.to.seconds_since(start),
        };
        let number = match asked {
            None => self.flown.len(),
            Some(asked) if (1..=self.flown.len()).contains(&asked) => asked,
            Some(asked) => {
                let all = (1..).zip(&self.flown).map(|(n, span)| told(n, span));
                let mut there: Vec<_> = all
                    .take(MOST_TOLD)
                    .map(|f| format!("{} from {:.1} to {:.1} s", f.number, f.from_s, f.to_s))
                    .collect();
                if self.flown.len() > MOST_TOLD {
                    there.push(format!("and so on to {}", self.flown.len()));
                }
                let there = if there.is_empty() { "none".to_owned() } else { there.join(", ") };
                return Err(LogError::NoSuchFlight { path: log.path().to_owned(), asked, there });
            }
        };
        let beside_us = (BESIDE_S * 1e6) as i64;
        let part = FlightPart {
            from: self.newest.offset_us(-(WITHOUT_S * 1e6) as i64),
            replayed: self.replayed,
            ..FlightPart::whole()
        };
        let Some(at) = number.checked_sub(1) else { return Ok(part) };
        let Some(span) = self.flown.get(at) else { return Ok(part) };
        let previous = at.checked_sub(1).and_then(|at| self.flown.get(at));
        Ok(FlightPart {
            flight: Some(told(number, span)),
            from: span.from.offset_us(-beside_us),
            until: span.to.offset_us(beside_us),
            after: previous.and_then(|span| span.closes).unwrap_or(0),
            closes: span.closes,
            before: self.flown.get(at + 1).map_or(u64::MAX, |span| span.opens),
            ..part
        })
    }
}

/// What of a log belongs to a flight: the flight, and a minute before it and behind it without what belongs to its
/// neighbours. To be shown every entry in its order.
#[derive(Debug, Clone)]
pub struct FlightPart {
    flight: Option<LogFlight>,
    from: HostTime,
    until: HostTime,
    /// Change of mode that ends the flight before, the one that ends this one, and the one that begins the next.
    after: u64,
    closes: Option<u64>,
    before: u64,
    replayed: bool,
    changes: u64,
    now: HostTime,
}

impl FlightPart {
    /// All of a log.
    pub fn whole() -> Self {
        Self {
            flight: None,
            from: HostTime::from_us(0),
            until: HostTime::from_us(u64::MAX),
            after: 0,
            closes: None,
            before: u64::MAX,
            replayed: false,
            changes: 0,
            now: HostTime::from_us(0),
        }
    }

    /// Which flight; `None`: the log holds none.
    pub fn flight(&self) -> Option<LogFlight> {
        self.flight
    }

    /// Whether an entry belongs to it.
    pub fn holds(&mut self, entry: &Entry) -> bool {
        match entry {
            Entry::Input { at, .. } | Entry::Output { at, .. } => self.now = *at,
            // The mode that was in force before is told too.
            Entry::Decoded(Decoded::Mode(_)) if !self.replayed => {
                self.changes += 1;
                return self.is_among();
            }
            _ => {}
        }
        self.is_open()
    }

    /// The same of what a replay tells behind an entry that it was shown.
    pub fn holds_topic(&mut self, topic: &Topic) -> bool {
        match topic {
            Topic::Mode(_) if self.replayed => {
                self.changes += 1;
                self.is_among()
            }
            // As recorded it comes behind the wake-up of which it is told here.
            Topic::Mode(_) => (self.after..self.before).contains(&(self.changes + 1)),
            _ => self.is_open(),
        }
    }

    /// Whether the flight is over.
    pub fn is_over(&self) -> bool {
        self.closes.is_some_and(|closes| self.changes >= closes)
    }

    fn is_among(&self) -> bool {
        (self.after..self.before).contains(&self.changes)
    }

    fn is_open(&self) -> bool {
        self.is_among() && (self.from..=self.until).contains(&self.now)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::in_memory;
    use super::super::{channels, pb};
    use super::*;

    /// Ten seconds of each mode, with a wake-up every second; `rounds`: as often, each at the times of the first.
    fn log(modes: &[&str], rounds: usize) -> Vec<u8> {
        let (memory, mut log) = in_memory();
        log.chunk_bytes = 2_000;
        let mut sequence = 0;
        for _ in 0..rounds {
            for (n, mode) in modes.iter().enumerate() {
                for s in 0..10 {
                    let at = HostTime::from_us((5 + 10 * n as u64 + s) * 1_000_000);
                    sequence += 1;
                    let wake = pb::Wake { sequence, host_time_us: at.as_us() };
                    log.put(channels::WAKE, at, sequence, &wake).unwrap();
                    if s == 0 {
                        let (at_us, mode) = (at.as_us(), (*mode).to_owned());
                        let mode = pb::Mode { at_us, mode, ..pb::Mode::default() };
                        log.decoded(&Decoded::Mode(mode)).unwrap();
                    }
                }
            }
        }
        log.finish().unwrap();
        memory.bytes()
    }

    fn open(bytes: Vec<u8>) -> LogReader {
        LogReader::from_bytes("several.mcap".into(), bytes).unwrap()
    }

    /// Wake-ups and modes of a part.
    fn held(log: &LogReader, mut part: FlightPart) -> (usize, Vec<String>) {
        let (mut wakes, mut modes) = (0, Vec::new());
        for entry in log.entries().filter(|entry| part.holds(entry)) {
            match entry {
                Entry::Decoded(Decoded::Mode(m)) => modes.push(m.mode),
                _ => wakes += 1,
            }
        }
        (wakes, modes)
    }

    const SEVERAL: [&str; 16] = [
        "disarmed", "arming", "takeoff", "land", "disarmed", "arming", "idle", "disarmed",
        "disarmed", "disarmed", "disarmed", "disarmed", "arming", "takeoff", "land", "disarmed",
    ];

    #[test]
    fn prop_a_flight_is_what_lies_between_two_disarmed_modes_and_has_left_the_floor() {
        let log = open(log(&SEVERAL, 1));
        let flights = Flights::recorded(&log);
        let spans = |n| {
            let flight = flights.part(&log, Some(n)).unwrap().flight().unwrap();
            (flight.number, flight.of, flight.from_s, flight.to_s)
        };
        assert_eq!(spans(1), (1, 2, 10.0, 40.0));
        assert_eq!(spans(2), (2, 2, 120.0, 150.0));
        let last = flights.part(&log, None).unwrap().flight().unwrap();
        assert_eq!(
            last.words().unwrap(),
            "flight 2 of 2 in this log, 120.0 to 150.0 s; --flight N takes another"
        );
        // A minute before it, all that follows.
        assert_eq!(held(&log, flights.part(&log, None).unwrap()).0, 60 + 30 + 10);
        let (wakes, modes) = held(&log, flights.part(&log, Some(1)).unwrap());
        assert_eq!((wakes, modes.len()), (10 + 30 + 61, 12), "{modes:?}");
        let error = flights.part(&log, Some(3)).unwrap_err().to_string();
        let there = "1 from 10.0 to 40.0 s, 2 from 120.0 to 150.0 s";
        assert_eq!(error, format!("several.mcap: no flight 3; the log holds {there}"));
    }

    #[test]
    fn prop_a_log_that_was_not_closed_holds_the_same_flights() {
        let whole = log(&SEVERAL, 1);
        for cut in (whole.len() / 2..whole.len()).step_by(997) {
            let Ok(log) = LogReader::from_bytes("cut.mcap".into(), whole[..cut].to_vec()) else {
                continue;
            };
            let flights = Flights::recorded(&log);
            let Ok(part) = flights.part(&log, Some(1)) else { continue };
            assert_eq!(part.flight().unwrap().from_s, 10.0, "cut at {cut}");
        }
    }

    #[test]
    fn regress_one_flight_of_a_log_of_many_is_held_and_no_more() {
        let one = ["disarmed", "arming", "takeoff", "land", "disarmed"];
        let log = open(log(&one, 40));
        let flights = Flights::recorded(&log);
        for n in [1, 7, 40] {
            let part = flights.part(&log, Some(n)).unwrap();
            assert_eq!(part.flight().unwrap().of, 40);
            assert!(held(&log, part).0 <= 70, "flight {n}");
        }
    }

    #[test]
    fn prop_of_a_log_without_a_flight_its_end_is_held() {
        let short = open(log(&["disarmed"; 20], 1));
        let flights = Flights::recorded(&short);
        let part = flights.part(&short, None).unwrap();
        assert_eq!((part.flight(), held(&short, part).0), (None, 200));
        let error = flights.part(&short, Some(1)).unwrap_err().to_string();
        assert_eq!(error, "several.mcap: no flight 1; the log holds none");
        let long = open(log(&["disarmed"; 100], 1));
        let part = Flights::recorded(&long).part(&long, None).unwrap();
        assert_eq!(held(&long, part).0, 601);
    }
}
