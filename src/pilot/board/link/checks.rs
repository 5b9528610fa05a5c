//! The board's parameters: read, compared with the rules, explained, and set with consent only.
//!
//! Nothing is believed that was not read back: echoes of PARAM_SET get lost (seen: 2 of 6), and both
//! firmwares take the value all the same. While the board is disarmed all are read again now and then,
//! because a ground station may have changed them.

use haltere_dialect::mav::haltere::{
    MavMessage, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA,
};

use haltere_core::time::HostTime;

use super::BOARD_COMPONENT;
use super::encoding::Encoding;
use super::news::BoardNews;
use super::profile::Firmware;
use super::rules::{Rule, Weight};

/// An unanswered request is sent again after this time, µs …
const RETRY_US: i64 = 500_000;
/// … this many times under each name.
const TRIES: u32 = 4;
/// A value is set this many times at most until it reads back right.
const SET_TRIES: u32 = 4;
/// Everything is read again after this time, µs.
const AGAIN_US: i64 = 10_000_000;
/// Parameters must have been read within this time to arm, s.
const FRESH_S: f64 = 25.0;
/// Least time between two requests, µs: a serial line carries them beside everything else.
const PACE_US: i64 = 20_000;

/// A rule and what is known of its parameter.
#[derive(Debug)]
struct Check {
    rule: &'static Rule,
    name: usize,
    tries: u32,
    next_try: HostTime,
    read: Option<(f64, u8)>,
    read_at: Option<HostTime>,
    sets: u32,
    /// Value that was last found wrong and told.
    told: Option<f64>,
    /// No name of it was answered.
    missing: bool,
}

impl Check {
    fn name(&self) -> &'static str {
        self.rule.names[self.name]
    }
}

/// All checks of a board.
#[derive(Debug)]
pub(crate) struct Checks {
    all: Vec<Check>,
    encoding: Encoding,
    next_request: HostTime,
    /// May wrong values be set?
    consent: bool,
    /// Our system id, which is the board's.
    system_id: u8,
}

impl Checks {
    /// Nothing is known yet.
    pub fn new(firmware: Firmware, system_id: u8, consent: bool, at: HostTime) -> Self {
        let all = firmware
            .rules()
            .iter()
            .map(|rule| Check {
                rule,
                name: 0,
                tries: 0,
                next_try: at,
                read: None,
                read_at: None,
                sets: 0,
                told: None,
                missing: false,
            })
            .collect();
        let encoding =
            if firmware == Firmware::Px4 { Encoding::Bytewise } else { Encoding::Numeric };
        Self { all, encoding, next_request: at, consent, system_id }
    }

    /// How the board writes integers; all is read again, with other eyes.
    pub fn set_encoding(&mut self, encoding: Encoding, at: HostTime) {
        if self.encoding != encoding {
            self.encoding = encoding;
            for check in &mut self.all {
                (check.read, check.tries, check.next_try) = (None, 0, at);
            }
        }
    }

    /// Value of a parameter, if it was read.
    pub fn value(&self, name: &str) -> Option<f64> {
        let check = self.all.iter().find(|c| c.rule.names.contains(&name))?;
        check.read.map(|(value, _)| value)
    }

    fn is_right(&self, check: &Check) -> bool {
        check.read.is_some_and(|(value, _)| {
            let own_id = !check.name().ends_with("GCS_SYSID") && check.name() != "SYSID_MYGCS";
            check.rule.demand.is_met(value) && (own_id || value == f64::from(self.system_id))
        })
    }

    fn explain(&self, check: &Check, value: f64) -> String {
        let needed = match check.rule.demand {
            super::rules::Demand::Known => self.system_id.to_string(),
            demand => demand.text(),
        };
        format!(
            "board parameter {} = {}, needed {needed}: {}",
            check.name(),
            value as f32,
            check.rule.why
        )
    }

    /// Why the board must not be armed, for people.
    pub fn refusal(&self, at: HostTime) -> Option<String> {
        // What is only advised is read too before the first flight: afterwards nobody listens.
        let unread = |c: &&Check| c.read.is_none() && !c.missing;
        if let Some(check) = self.all.iter().find(unread) {
            return Some(format!("board parameter {} is not read yet", check.name()));
        }
        for check in self.all.iter().filter(|c| c.rule.weight == Weight::Must) {
            let name = check.name();
            let Some((value, _)) = check.read else {
                let why = check.rule.why;
                return Some(format!("board does not tell its parameter {name}: {why}"));
            };
            if !self.is_right(check) {
                let way_out = match (self.consent, check.sets >= SET_TRIES) {
                    (true, true) => "; it does not take a new value, set it by hand",
                    (true, false) => "; it is being set",
                    _ => "; set it, or allow it by board.set_parameters = true",
                };
                return Some(format!("{}{way_out}", self.explain(check, value)));
            }
            if check.read_at.is_none_or(|t| at.seconds_since(t) > FRESH_S) {
                return Some(format!("board parameter {name} was not read for {FRESH_S} s"));
            }
        }
        None
    }

    /// A value that the board tells, asked for or not. `true`: it is one of ours.
    pub fn take(&mut self, at: HostTime, m: &PARAM_VALUE_DATA, news: &mut Vec<BoardNews>) -> bool {
        let end = m.param_id.iter().position(|c| *c == 0).unwrap_or(m.param_id.len());
        let id = &m.param_id[..end];
        let value = self.encoding.decode(m.param_value, m.param_type);
        let found =
            self.all.iter().position(|c| c.rule.names.iter().any(|name| name.as_bytes() == id));
        let Some(index) = found else { return false };
        if !value.is_finite() {
            return true;
        }
        let Some(check) = self.all.get_mut(index) else { return true };
        check.name = check.rule.names.iter().position(|n| n.as_bytes() == id).unwrap_or(check.name);
        let was_wrong = check.sets > 0;
        check.read = Some((value, m.param_type));
        check.read_at = Some(at);
        check.tries = 0;
        check.next_try = at.offset_us(AGAIN_US);
        let right = self.is_right(&self.all[index]);
        let text = self.explain(&self.all[index], value);
        let consent = self.consent;
        let check = &mut self.all[index];
        if right {
            if was_wrong {
                check.sets = 0;
                let text = format!("board parameter {} is now {}", check.name(), value as f32);
                news.push(BoardNews::Notice { warning: false, text });
            }
            check.told = None;
        } else if check.rule.weight != Weight::Note {
            if check.told != Some(value) {
                check.told = Some(value);
                news.push(BoardNews::Notice { warning: true, text });
            }
            let can = check.rule.demand.remedy(value).is_some();
            if consent && can && check.rule.weight == Weight::Must && check.sets < SET_TRIES {
                check.next_try = at;
            }
        }
        true
    }

    /// The next request, if one is due. Nothing is asked or set while the board is armed.
    pub fn ask(
        &mut self,
        at: HostTime,
        armed: bool,
        news: &mut Vec<BoardNews>,
    ) -> Option<MavMessage> {
        if armed || at < self.next_request {
            return None;
        }
        let index = self.all.iter().position(|c| at >= c.next_try)?;
        let set = self.remedy(index);
        let check = self.all.get_mut(index)?;
        if check.tries >= TRIES {
            check.tries = 0;
            if check.read.is_none() && check.name + 1 < check.rule.names.len() {
                check.name += 1;
            } else {
                // It may be told later, when the board has booted.
                check.next_try = at.offset_us(AGAIN_US / 4);
                if check.read.is_none() {
                    check.name = 0;
                    if check.rule.weight == Weight::Should && !check.missing {
                        let text = format!("board does not tell its parameter {}", check.name());
                        news.push(BoardNews::Notice { warning: true, text });
                    }
                    check.missing = true;
                }
                return None;
            }
        }
        check.tries += 1;
        check.next_try = at.offset_us(RETRY_US);
        self.next_request = at.offset_us(PACE_US);
        let param_id = check.name().into();
        let (target_system, target_component) = (self.system_id, BOARD_COMPONENT);
        if let Some((value, kind)) = set {
            check.sets += 1;
            // It is read back whether or not the echo comes.
            let from = check.read.map_or(f64::NAN, |(v, _)| v);
            if check.sets == 1 {
                let text = format!("board parameter {} set from {from} to {value}", check.name());
                news.push(BoardNews::Notice { warning: true, text });
            }
            return Some(MavMessage::PARAM_SET(PARAM_SET_DATA {
                param_value: self.encoding.encode(value, kind),
                target_system,
                target_component,
                param_id,
                param_type: kind,
            }));
        }
        Some(MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
            param_index: -1,
            target_system,
            target_component,
            param_id,
        }))
    }

    /// What a wrong value may be set to: every other try, so that it is read back in between.
    fn remedy(&self, index: usize) -> Option<(f64, u8)> {
        let check = self.all.get(index)?;
        let (value, kind) = check.read?;
        let may = self.consent
            && check.rule.weight == Weight::Must
            && check.sets < SET_TRIES
            && check.tries.is_multiple_of(2)
            && !self.is_right(check);
        let to = check.rule.demand.remedy(value)?;
        may.then_some((to, kind))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(1_000_000 + ms * 1000)
    }

    /// A board with parameters of one type; every `lossy`-th answer is lost.
    struct Board {
        values: Vec<(&'static str, f64)>,
        kind: u8,
        encoding: Encoding,
        lossy: u32,
        heard: u32,
        sets: Vec<(String, f64)>,
        deaf_to_sets: bool,
    }

    impl Board {
        fn new(values: &[(&'static str, f64)], encoding: Encoding) -> Self {
            Self {
                values: values.to_vec(),
                kind: haltere_dialect::mav::haltere::MavParamType::MAV_PARAM_TYPE_INT32 as u8,
                encoding,
                lossy: 0,
                heard: 0,
                sets: Vec::new(),
                deaf_to_sets: false,
            }
        }

        fn hear(&mut self, m: &MavMessage) -> Option<PARAM_VALUE_DATA> {
            let name = |id: &[u8; 16]| {
                let end = id.iter().position(|c| *c == 0).unwrap_or(16);
                String::from_utf8_lossy(&id[..end]).into_owned()
            };
            let id = match m {
                MavMessage::PARAM_REQUEST_READ(m) => name(&m.param_id),
                MavMessage::PARAM_SET(m) => {
                    let id = name(&m.param_id);
                    let value = self.encoding.decode(m.param_value, m.param_type);
                    self.sets.push((id.clone(), value));
                    if let Some(slot) = self.values.iter_mut().find(|v| v.0 == id)
                        && !self.deaf_to_sets
                    {
                        slot.1 = value;
                    }
                    id
                }
                _ => return None,
            };
            self.heard += 1;
            if self.lossy > 0 && self.heard.is_multiple_of(self.lossy) {
                return None;
            }
            let (id, value) = self.values.iter().find(|v| v.0 == id)?;
            Some(PARAM_VALUE_DATA {
                param_value: self.encoding.encode(*value, self.kind),
                param_type: self.kind,
                param_id: (*id).into(),
                ..PARAM_VALUE_DATA::DEFAULT
            })
        }
    }

    fn run(checks: &mut Checks, board: &mut Board, from_ms: u64, seconds: u64) -> Vec<String> {
        let mut news = Vec::new();
        for ms in (from_ms..from_ms + seconds * 1000).step_by(10) {
            if let Some(m) = checks.ask(at(ms), false, &mut news)
                && let Some(value) = board.hear(&m)
            {
                assert!(checks.take(at(ms), &value, &mut news));
            }
        }
        news.into_iter()
            .map(|n| match n {
                BoardNews::Notice { text, .. } => text,
                other => panic!("{other:?}"),
            })
            .collect()
    }

    const PX4_GOOD: &[(&str, f64)] = &[
        ("COM_OF_LOSS_T", 1.0),
        ("COM_OBL_RC_ACT", 4.0),
        ("COM_RCL_EXCEPT", 4.0),
        ("NAV_DLL_ACT", 0.0),
        ("COM_SPOOLUP_TIME", 1.0),
        ("MAV_TYPE", 2.0),
    ];
    const ARDU: &[(&str, f64)] = &[
        ("GUID_OPTIONS", 0.0),
        ("GUID_TIMEOUT", 1.0),
        ("FS_GCS_ENABLE", 5.0),
        ("FS_GCS_TIMEOUT", 2.0),
        ("SYSID_MYGCS", 1.0),
        ("FS_EKF_ACTION", 0.0),
        ("MOT_SPOOL_TIME", 1.0),
    ];

    #[test]
    fn prop_a_right_board_passes_with_lost_answers_too() {
        for lossy in [0, 2, 3] {
            let mut checks = Checks::new(Firmware::Px4, 1, false, at(0));
            assert!(checks.refusal(at(0)).is_some_and(|w| w.contains("not read yet")));
            let mut board = Board::new(PX4_GOOD, Encoding::Bytewise);
            board.lossy = lossy;
            let said = run(&mut checks, &mut board, 0, 15);
            assert_eq!(checks.refusal(at(15_000)), None, "lossy {lossy}: {said:?}");
            assert_eq!(checks.value("COM_SPOOLUP_TIME"), Some(1.0));
        }
    }

    #[test]
    fn prop_without_consent_a_wrong_value_is_explained_and_left_alone() {
        let mut checks = Checks::new(Firmware::ArduPilot, 1, false, at(0));
        let mut board = Board::new(ARDU, Encoding::Numeric);
        let said = run(&mut checks, &mut board, 0, 10);
        let why = checks.refusal(at(10_000)).unwrap();
        for word in ["GUID_OPTIONS = 0", "8", "climb rate", "board.set_parameters"] {
            assert!(why.contains(word), "{word}: {why}");
        }
        assert_eq!(board.sets, []);
        let told = said.iter().filter(|t| t.contains("GUID_OPTIONS")).count();
        assert_eq!(told, 1, "told once: {said:?}");
    }

    #[test]
    fn prop_with_consent_it_is_set_and_read_back() {
        for lossy in [0, 2, 3] {
            let mut checks = Checks::new(Firmware::ArduPilot, 1, true, at(0));
            let mut board = Board::new(ARDU, Encoding::Numeric);
            board.lossy = lossy;
            let said = run(&mut checks, &mut board, 0, 25);
            assert_eq!(checks.refusal(at(25_000)), None, "lossy {lossy}: {said:?}");
            assert!(board.sets.iter().all(|s| *s == ("GUID_OPTIONS".to_owned(), 8.0)));
            assert!(said.iter().any(|t| t.contains("set from 0 to 8")), "{said:?}");
        }
        // One that keeps its value is not tried for ever.
        let mut checks = Checks::new(Firmware::ArduPilot, 1, true, at(0));
        let mut board = Board::new(ARDU, Encoding::Numeric);
        board.deaf_to_sets = true;
        run(&mut checks, &mut board, 0, 60);
        assert_eq!(board.sets.len(), SET_TRIES as usize);
        assert!(checks.refusal(at(60_000)).is_some_and(|w| w.contains("by hand")));
    }

    #[test]
    fn prop_the_wrong_encoding_is_not_mistaken_for_a_value() {
        // Bits of 8 read as a number are 1e-44: not 8.
        let mut checks = Checks::new(Firmware::ArduPilot, 1, false, at(0));
        let mut values = ARDU.to_vec();
        values[0].1 = 8.0;
        let mut board = Board::new(&values, Encoding::Bytewise);
        run(&mut checks, &mut board, 0, 5);
        assert!(checks.refusal(at(5000)).is_some());
        checks.set_encoding(Encoding::Bytewise, at(5000));
        run(&mut checks, &mut board, 5000, 5);
        assert_eq!(checks.refusal(at(10_000)), None);
    }

    #[test]
    fn prop_a_missing_parameter_is_named_and_a_changed_one_is_noticed() {
        let mut checks = Checks::new(Firmware::Px4, 1, false, at(0));
        let mut board = Board::new(&PX4_GOOD[..5], Encoding::Bytewise);
        run(&mut checks, &mut board, 0, 30);
        let why = checks.refusal(at(30_000)).unwrap();
        assert!(why.contains("MAV_TYPE"), "{why}");
        board.values.push(("MAV_TYPE", 2.0));
        run(&mut checks, &mut board, 30_000, 15);
        assert_eq!(checks.refusal(at(45_000)), None);
        board.values[1].1 = 3.0;
        run(&mut checks, &mut board, 45_000, 15);
        assert!(checks.refusal(at(60_000)).is_some_and(|w| w.contains("COM_OBL_RC_ACT = 3")));
    }
}
