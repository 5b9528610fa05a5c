//! Verdicts on a world counted, and the table of worlds.

use haltere_gap::attribute::Attribution;
use haltere_gap::bank::library::find;
use haltere_gap::outcome::Outcome;
use serde::Serialize;

use crate::score::{BINS, Share, Truth, alarmed, first_name, names_of_two, rank};

/// Hits, of how many.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Count {
    /// Hits.
    pub hits: usize,
    /// Of.
    pub of: usize,
}

impl Count {
    fn add(&mut self, hit: bool) {
        self.of += 1;
        self.hits += usize::from(hit);
    }

    fn join(&mut self, other: Self) {
        self.hits += other.hits;
        self.of += other.of;
    }

    fn share(self) -> Share {
        Share::new(self.hits, self.of)
    }
}

/// What is counted.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Tally {
    /// The first name that is said is right.
    pub named: Count,
    /// A wrong name is first.
    pub wrong: Count,
    /// The effect is ranked first, and among three, a gap seen.
    pub first: Count,
    /// See `first`.
    pub of_three: Count,
    /// The right block is first.
    pub block: Count,
    /// A known effect is refused, or called no gap.
    pub refused: Count,
    /// See `refused`.
    pub unseen: Count,
    /// An effect that no library holds is refused, or its block is said of what is left.
    pub stranger: Count,
    /// Of two effects one is named and none wrong.
    pub pair: Count,
    /// A healthy flight is called a gap.
    pub alarm: Count,
    /// Stated probability of the first name, sum, and how often it was right, by bin.
    pub bins: [(f64, Count); BINS],
}

impl Tally {
    /// Counts one verdict.
    pub fn add(&mut self, truth: &Truth, verdict: &Attribution) {
        let alarmed = alarmed(verdict);
        let refused = matches!(verdict.outcome, Outcome::NotInLibrary { .. });
        match truth {
            Truth::NoGap => self.alarm.add(alarmed),
            Truth::Unknown { name } => {
                let block = name.split(':').next().unwrap_or("");
                let left = matches!(verdict.outcome, Outcome::NamedWithRemainder { .. })
                    && verdict.remainder.block == block;
                self.stranger.add(refused || left);
            }
            Truth::Pair { ids } => {
                let [right, said] = names_of_two(verdict, ids);
                self.pair.add(right > 0 && right == said);
            }
            Truth::Single { id, block, .. } => {
                self.named.add(first_name(verdict) == Some(id.as_str()));
                self.wrong.add(first_name(verdict).is_some_and(|name| name != id));
                let rank = rank(verdict, id);
                self.first.add(rank == Some(0));
                self.of_three.add(rank.is_some_and(|r| r < 3));
                let own = first_name(verdict).and_then(find).map(|s| s.block.name());
                let loud = verdict.blocks.first().map(|b| b.block.as_str());
                self.block.add(alarmed && own.or(loud) == Some(block.as_str()));
                self.refused.add(refused);
                self.unseen.add(!alarmed);
                if let (true, Some(first)) = (alarmed, verdict.candidates.first()) {
                    let bin = ((first.posterior * BINS as f64) as usize).min(BINS - 1);
                    self.bins[bin].0 += first.posterior;
                    self.bins[bin].1.add(first.id == *id);
                }
            }
        }
    }

    /// Counts those of another world.
    pub fn join(&mut self, other: &Self) {
        self.counts_mut()
            .into_iter()
            .zip(other.counts())
            .for_each(|(own, (_, more))| own.join(more));
        for (own, more) in self.bins.iter_mut().zip(&other.bins) {
            own.0 += more.0;
            own.1.join(more.1);
        }
    }

    /// What is counted, by its column.
    pub fn counts(&self) -> [(&'static str, Count); 10] {
        [
            ("named", self.named),
            ("wrong", self.wrong),
            ("first", self.first),
            ("of three", self.of_three),
            ("block", self.block),
            ("refused", self.refused),
            ("unseen", self.unseen),
            ("stranger", self.stranger),
            ("pair", self.pair),
            ("alarm", self.alarm),
        ]
    }

    fn counts_mut(&mut self) -> [&mut Count; 10] {
        [
            &mut self.named,
            &mut self.wrong,
            &mut self.first,
            &mut self.of_three,
            &mut self.block,
            &mut self.refused,
            &mut self.unseen,
            &mut self.stranger,
            &mut self.pair,
            &mut self.alarm,
        ]
    }

    /// Largest difference of stated and true share over bins with at least ten flights, and the mean over all.
    pub fn calibration(&self) -> [f64; 2] {
        let filled = self.bins.iter().filter(|(_, c)| c.of > 0);
        let off = |(said, c): &(f64, Count)| (said - c.hits as f64).abs();
        let all: usize = self.bins.iter().map(|(_, c)| c.of).sum();
        let mean = filled.clone().map(off).sum::<f64>() / all.max(1) as f64;
        let large = filled.filter(|(_, c)| c.of >= 10);
        [large.map(|bin| off(bin) / bin.1.of as f64).fold(0.0, f64::max), mean]
    }

    /// A line of the table.
    pub fn line(&self, name: &str) -> String {
        let cells = self.counts().map(|(_, c)| format!("{} of {}", c.hits, c.of));
        format!("| {name} | {} |\n", cells.join(" | "))
    }

    /// Head of the table.
    pub fn head() -> String {
        let names = Self::default().counts().map(|(name, _)| name);
        format!("| world | {} |\n{}|\n", names.join(" | "), "|---".repeat(names.len() + 1))
    }

    /// Shares with their limits, and calibration.
    pub fn limits(&self) -> String {
        let mut out = String::new();
        for (name, count) in self.counts().into_iter().filter(|(_, c)| c.of > 0) {
            let s = count.share();
            let share = count.hits as f64 / count.of as f64;
            out += &format!("{name:<10} {share:.2} (95 %: {:.2} to {:.2})\n", s.low, s.high);
        }
        for (k, (said, c)) in self.bins.iter().enumerate().filter(|(_, (_, c))| c.of > 0) {
            let n = c.of as f64;
            out += &format!(
                "said {:.2} (bin {k}): right {:.2} of {}\n",
                said / n,
                c.hits as f64 / n,
                c.of
            );
        }
        let [most, mean] = self.calibration();
        out + &format!("calibration: mean {mean:.3}, most {most:.3} in a bin of ten and more\n")
    }
}
