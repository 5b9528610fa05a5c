//! The tables of names of a Crazyflie, kept over a restart in files named by their checksum.
//!
//! The link answers in the board's place where the core asks for the first name of a table that is known: all its names
//! at once, as the board would have told them, so that the core and its log know nothing of the files. Round trips for
//! 700 names take seconds. What is kept is the board's packets, behind a digest of them.

use std::path::{Path, PathBuf};

use haltere_dialect::crtp::packet::{Packet, Place};
use haltere_dialect::crtp::toc::{Table, TocAnswer, TocRequest};
use haltere_dialect::crtp::{FromBoard, ToBoard};

use crate::store::cache;

/// A table as the board tells it.
#[derive(Debug, Default)]
struct Known {
    count: u16,
    crc: u32,
    /// Its names so far, in their order, each behind its length.
    names: Vec<u8>,
    have: u16,
}

impl Known {
    fn is_whole(&self) -> bool {
        self.have == self.count && self.count > 0
    }

    /// The next name, if it is that.
    fn learn(&mut self, table: Table, packet: &Packet) -> bool {
        let is_next = match FromBoard::decode(packet) {
            Ok(FromBoard::Toc(of, TocAnswer::Item(item))) => of == table && item.id == self.have,
            _ => false,
        };
        if is_next && self.have < self.count {
            self.names.push(packet.bytes().len() as u8);
            self.names.extend_from_slice(packet.bytes());
            self.have += 1;
        }
        is_next
    }
}

/// What is known of both tables.
#[derive(Debug)]
pub(super) struct Names {
    /// `None`: nothing is kept.
    folder: Option<PathBuf>,
    tables: [Option<Known>; 2],
    /// Files that were broken or another's.
    pub bad_files: u64,
}

impl Names {
    /// In the cache of the service or the user.
    pub(super) fn usual() -> Self {
        Self::below(cache::folder().map(|folder| folder.join("crazyflie")))
    }

    /// In this folder.
    pub(super) fn below(folder: Option<PathBuf>) -> Self {
        Self { folder, tables: [None, None], bad_files: 0 }
    }

    /// What the board says: learned, and kept when it is whole.
    pub(super) fn heard(&mut self, packet: &[u8]) {
        let Some(packet) = told(packet) else { return };
        match FromBoard::decode(&packet) {
            Ok(FromBoard::Toc(table, TocAnswer::Info { count, crc, .. })) => {
                let known = &mut self.tables[table as usize];
                if known.as_ref().is_none_or(|known| (known.count, known.crc) != (count, crc)) {
                    *known = Some(Known { count, crc, ..Known::default() });
                }
            }
            Ok(FromBoard::Toc(table, TocAnswer::Item(_))) => {
                let Some(known) = &mut self.tables[table as usize] else { return };
                if !known.is_whole() && known.learn(table, &packet) && known.is_whole() {
                    keep(self.folder.as_deref(), table, known);
                }
            }
            _ => {}
        }
    }

    /// What the core asks: the answers in the board's place, where they are known.
    pub(super) fn asked(&mut self, packet: &[u8]) -> Option<&[u8]> {
        let packet = told(packet)?;
        let Ok(ToBoard::Toc(table, TocRequest::Item(0))) = ToBoard::decode(&packet) else {
            return None;
        };
        let known = self.tables[table as usize].as_mut()?;
        if !known.is_whole() {
            match kept(self.folder.as_deref()?, table, known) {
                Ok(Some(whole)) => *known = whole,
                Ok(None) => return None,
                Err(path) => {
                    self.bad_files += 1;
                    tracing::warn!("{}: broken, not used; the board is asked", path.display());
                    return None;
                }
            }
        }
        Some(&known.names)
    }
}

/// A packet of either table.
fn told(packet: &[u8]) -> Option<Packet> {
    let packet = Packet::read(packet).ok()?;
    matches!(packet.place(), Ok(Place::LogToc | Place::ParameterToc)).then_some(packet)
}

fn file(folder: &Path, table: Table, known: &Known) -> PathBuf {
    let of = if table == Table::Log { "log" } else { "parameters" };
    folder.join(format!("{of}-{:08x}-{}", known.crc, known.count))
}

fn keep(folder: Option<&Path>, table: Table, known: &Known) {
    let Some(folder) = folder else { return };
    if let Err(why) = cache::keep(&file(folder, table, known), &known.names) {
        tracing::debug!("names of the board are not kept: {why}");
    }
}

/// `Err`: the file is none of ours, or broken.
fn kept(folder: &Path, table: Table, asked: &Known) -> Result<Option<Known>, PathBuf> {
    let path = file(folder, table, asked);
    let Ok(names) = cache::kept(&path) else { return Err(path) };
    let Some(names) = names else { return Ok(None) };
    let mut known = Known { count: asked.count, crc: asked.crc, ..Known::default() };
    let mut packets = apart(&names);
    let all =
        packets.all(|name| Packet::read(name).is_ok_and(|packet| known.learn(table, &packet)));
    let is_whole = all && known.is_whole() && known.names.len() == names.len();
    if is_whole { Ok(Some(known)) } else { Err(path) }
}

/// Each packet of a piece that the core sends.
pub fn apart(mut bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    std::iter::from_fn(move || {
        let (len, rest) = bytes.split_first()?;
        let (packet, later) = rest.split_at_checked(usize::from(*len))?;
        bytes = later;
        Some(packet)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_dialect::crtp::toc::TocItem;

    const COUNT: u16 = 300;

    fn info(crc: u32) -> Packet {
        let answer = TocAnswer::Info { count: COUNT, crc, limits: Some([16, 128]) };
        FromBoard::Toc(Table::Log, answer).encode().unwrap()
    }

    fn item(id: u16) -> Packet {
        let name = format!("n{id}");
        let item = TocItem { id, code: 7, group: "acc", name: &name };
        FromBoard::Toc(Table::Log, TocAnswer::Item(item)).encode().unwrap()
    }

    fn first() -> Packet {
        ToBoard::Toc(Table::Log, TocRequest::Item(0)).encode().unwrap()
    }

    fn learned(folder: &Path) -> Vec<u8> {
        let mut names = Names::below(Some(folder.to_owned()));
        names.heard(info(5).bytes());
        assert_eq!(names.asked(first().bytes()), None);
        // A repeated answer is no second name.
        (0..COUNT).for_each(|id| {
            names.heard(item(id).bytes());
            names.heard(item(id).bytes());
        });
        names.asked(first().bytes()).unwrap().to_vec()
    }

    #[test]
    fn prop_a_table_is_known_after_a_restart_and_another_one_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let told = learned(folder.path());
        assert_eq!(apart(&told).count(), usize::from(COUNT));
        let mut names = Names::below(Some(folder.path().to_owned()));
        assert_eq!(names.asked(first().bytes()), None, "nobody has told which table it is");
        names.heard(info(5).bytes());
        assert_eq!(names.asked(first().bytes()), Some(&told[..]));
        names.heard(info(6).bytes());
        assert_eq!(names.asked(first().bytes()), None);
        assert_eq!(names.bad_files, 0);
    }

    #[test]
    fn prop_a_broken_or_foreign_file_is_not_used_and_counted() {
        let folder = tempfile::tempdir().unwrap();
        learned(folder.path());
        let path = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        let good = std::fs::read(&path).unwrap();
        let mut flipped = good.clone();
        flipped[1000] ^= 1;
        let short = &good[..good.len() - 1];
        // Whole, and no names.
        let other = folder.path().join("other");
        cache::keep(&other, b"\x02ab").unwrap();
        let other = std::fs::read(&other).unwrap();
        for bad in [&flipped[..], short, b"", b"something else", &other] {
            std::fs::write(&path, bad).unwrap();
            let mut names = Names::below(Some(folder.path().to_owned()));
            names.heard(info(5).bytes());
            assert_eq!(names.asked(first().bytes()), None);
            assert_eq!(names.bad_files, 1);
        }
        // It is written anew by who has asked the board.
        learned(folder.path());
        assert_eq!(std::fs::read(&path).unwrap(), good);
    }
}
