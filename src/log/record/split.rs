//! Takes logs apart that another program has put into one file.
//!
//! One behind the other, or in order of their time where they do not overlap, they are parted where the next head
//! stands. Woven into one another they can be told apart as long as each kept its own channels: the numbers of
//! inputs and outputs follow one another within a session. Decoded records have none, and are left out and counted.
//! What is there twice, since a log was put into a file twice, goes out once.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::McapError;

use super::channels;
use super::errors::LogError;
use super::messages::Message;
use super::reader::{LogReader, fault};
use super::recover::{Copy, hole_before};

/// One of the logs that were in the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// The new log.
    pub path: PathBuf,
    /// Messages in it.
    pub messages: u64,
}

/// What came of it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Parts {
    /// In the order in which they begin.
    pub logs: Vec<Part>,
    /// Messages that could not be told apart.
    pub left_out: u64,
}

/// Name of part `n`, from 1, beside `path`.
pub fn part_name(path: &Path, n: usize) -> PathBuf {
    path.with_extension(format!("{n}.mcap"))
}

/// Writes each session of `path` into a log of its own beside it; none of these may exist.
pub fn split(path: &Path) -> Result<Parts, LogError> {
    let file = LogReader::first(path)?;
    let found = look(&file);
    let logs = found
        .heads
        .iter()
        .map(|head| LogReader::headed(path, head.clone()))
        .collect::<Result<Vec<_>, _>>()?;
    let names: Vec<PathBuf> = (1..=logs.len()).map(|n| part_name(path, n)).collect();
    let mut outs = Vec::new();
    for (log, name) in logs.iter().zip(&names) {
        let mut out = Copy::create(name)?;
        out.head(log).map_err(|source| LogError::Copy { path: name.clone(), source })?;
        outs.push(out);
    }
    // Of one log that is there twice every message is, and goes out once.
    let left_out = if found.woven && logs.len() > 1 {
        let owners =
            found.owners().map_err(|why| LogError::Woven { path: path.to_owned(), why })?;
        unweave(&file, &owners, &mut outs)
    } else {
        cut(&file, &found.heads, &mut outs)
    }
    .map_err(|source| LogError::Copy { path: path.to_owned(), source })?;
    let mut parts = Parts { logs: Vec::new(), left_out };
    for (out, path) in outs.into_iter().zip(names) {
        let messages = out.finish(&path)?;
        parts.logs.push(Part { path, messages });
    }
    Ok(parts)
}

/// Numbers and times on one channel.
type Numbers = Vec<(u32, u64)>;

/// What is in a file.
#[derive(Default)]
struct Found {
    /// Heads that differ, in their order.
    heads: Vec<Vec<u8>>,
    /// Times and channels of them.
    begins: Vec<(u64, u16)>,
    woven: bool,
    raw: BTreeMap<u16, (Arc<str>, Numbers)>,
}

fn look(file: &LogReader) -> Found {
    let mut found = Found::default();
    let mut last = 0;
    let mut messages = file.messages();
    while let Some(message) = messages.next() {
        if *message.channel == *channels::CONFIG.0 {
            if !found.heads.iter().any(|head| head == message.data) {
                found.heads.push(message.data.to_vec());
                found.begins.push((message.log_time, message.channel_id));
                last = 0;
            }
        } else if message.sequence > 0 {
            found.woven |= message.sequence <= last;
            last = message.sequence;
            let (_, numbers) = found
                .raw
                .entry(message.channel_id)
                .or_insert_with(|| (message.channel.clone(), Vec::new()));
            numbers.push((message.sequence, message.log_time));
        }
    }
    found
}

impl Found {
    /// To which session each channel of inputs and outputs belongs.
    fn owners(mut self) -> Result<BTreeMap<u16, usize>, String> {
        let count = self.heads.len();
        let woven = format!("its {count} sessions lie within one another");
        for (_, numbers) in self.raw.values_mut() {
            numbers.sort_unstable();
            if numbers.windows(2).any(|pair| matches!(pair, [a, b] if a.0 == b.0)) {
                return Err(format!("{woven} on the same channels"));
            }
        }
        // Every session has wake-ups, and most of its numbers are theirs.
        let is_wake = |name: &str| *name == *channels::WAKE.0;
        let mut groups: Vec<(u64, u16, Numbers)> = self
            .raw
            .iter()
            .filter(|(_, (name, _))| is_wake(name))
            .map(|(id, (_, numbers))| (numbers.first().map_or(0, |n| n.1), *id, numbers.clone()))
            .collect();
        if groups.len() != count {
            return Err(format!("{woven}, and {} have wake-ups", groups.len()));
        }
        groups.sort_by_key(|(at, id, _)| (*at, *id));
        let mut begins: Vec<_> = (0..count).collect();
        begins.sort_by_key(|n| self.begins.get(*n));
        let mut owners: BTreeMap<u16, usize> =
            groups.iter().zip(&begins).map(|((_, id, _), n)| (*id, *n)).collect();
        let mut rest: Vec<_> = self.raw.iter().filter(|(_, (name, _))| !is_wake(name)).collect();
        rest.sort_by_key(|(_, (_, numbers))| std::cmp::Reverse(numbers.len()));
        let mut taken: BTreeSet<(usize, &str)> = BTreeSet::new();
        for (id, (name, numbers)) in rest {
            let fits = groups.iter().enumerate().find(|(n, (_, _, group))| {
                !taken.contains(&(*n, &**name)) && between(group, numbers)
            });
            let Some((n, _)) = fits else {
                return Err(format!("{woven}, and channel {name} fits into none of them"));
            };
            taken.insert((n, name));
            owners.insert(*id, *begins.get(n).unwrap_or(&n));
            if let Some((_, _, group)) = groups.get_mut(n) {
                group.extend_from_slice(numbers);
                group.sort_unstable();
            }
        }
        Ok(owners)
    }
}

/// Whether numbers are free in a session, and their times between those of their neighbours.
fn between(group: &Numbers, numbers: &Numbers) -> bool {
    numbers.iter().all(|(number, at)| {
        let next = group.partition_point(|(n, _)| n < number);
        let after = group.get(next);
        let before = next.checked_sub(1).and_then(|n| group.get(n));
        after.is_none_or(|(n, later)| n != number && at <= later)
            && before.is_none_or(|(_, earlier)| earlier <= at)
    })
}

fn cut(file: &LogReader, heads: &[Vec<u8>], outs: &mut [Copy]) -> Result<u64, McapError> {
    let mut messages = file.messages();
    let (mut n, mut gaps, mut seen) = (0, file.gaps(), BTreeSet::new());
    while let Some(message) = messages.next() {
        if *message.channel == *channels::CONFIG.0 {
            let known = heads.iter().position(|head| head == message.data);
            if known != Some(n) {
                n = known.unwrap_or(n);
                gaps = file.gaps();
            }
            continue;
        }
        if let Some(why) = fault(&message) {
            let offset = message.offset;
            messages.note(offset, why);
            continue;
        }
        let Message { channel, sequence, log_time, data, .. } = &message;
        let mut print = DefaultHasher::new();
        (n, channel, sequence, log_time, data).hash(&mut print);
        if !seen.insert(print.finish()) {
            continue;
        }
        let hole = hole_before(&mut gaps, &message);
        if let Some(out) = outs.get_mut(n) {
            if let Some(hole) = hole {
                out.hole(&hole)?;
            }
            out.put(&message)?;
        }
    }
    Ok(0)
}

fn unweave(
    file: &LogReader,
    owners: &BTreeMap<u16, usize>,
    outs: &mut [Copy],
) -> Result<u64, McapError> {
    let mut messages = file.messages();
    let mut left_out = 0;
    while let Some(message) = messages.next() {
        if fault(&message).is_some() {
            left_out += 1;
            continue;
        }
        match owners.get(&message.channel_id).and_then(|n| outs.get_mut(*n)) {
            Some(out) => out.put(&message)?,
            None => left_out += u64::from(*message.channel != *channels::CONFIG.0),
        }
    }
    Ok(left_out)
}
