//! What the force balance says, as text and as JSON.

use std::fmt::Write as _;

use serde::Serialize;

use super::blocks::Interval;
use super::search::Verdict;
use super::terms::Part;
use haltere_log::import::Skipped;

/// First word of the verdict; names and exit codes of INTERFACES.md.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Nothing material is missing.
    NoGap,
    /// One effect.
    Named,
    /// One of a set that these flights cannot separate.
    Ambiguous,
    /// More than one effect.
    Several,
    /// A force is missing that no candidate explains.
    NotInLibrary,
    /// One effect, and a force beside it that no candidate explains.
    NamedWithRemainder,
}

impl Outcome {
    /// Exit code.
    pub fn exit_code(self) -> u8 {
        match self {
            Outcome::NoGap => 0,
            Outcome::Named => 10,
            Outcome::Ambiguous => 11,
            Outcome::Several => 12,
            Outcome::NotInLibrary => 13,
            Outcome::NamedWithRemainder => 14,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Outcome::NoGap => "no material gap",
            Outcome::Named => "named",
            Outcome::Ambiguous => "one of",
            Outcome::Several => "several",
            Outcome::NotInLibrary => "not in the library",
            Outcome::NamedWithRemainder => "named, with a remainder",
        }
    }
}

/// Name of a part on the command line.
pub fn part_name(part: Part) -> &'static str {
    match part {
        Part::Voltage => "voltage",
        Part::Drag => "drag",
    }
}

/// Slope of the nominal residual (real minus model) against something.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Where {
    /// Block of the chain.
    pub block: &'static str,
    /// Body axis.
    pub axis: &'static str,
    /// Against what.
    pub against: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Slope, m/s² per unit.
    pub slope: Interval,
    /// Change of the residual over the flown range, m/s².
    pub change_mps2: f64,
    /// Slope over its sigma.
    pub score: f64,
}

/// A parameter with its interval.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// Key.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Value and 95 % interval.
    #[serde(flatten)]
    pub interval: Interval,
}

/// A credited effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Effect {
    /// Id in the effect list.
    pub id: &'static str,
    /// Name in the effect list.
    pub name: &'static str,
    /// In words.
    pub what: &'static str,
    /// Block of the chain.
    pub block: &'static str,
    /// Parameters, all effects fitted together.
    pub parameters: Vec<Parameter>,
}

/// A candidate by itself against the nominal balance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Candidate {
    /// Id in the effect list.
    pub id: &'static str,
    /// Name in the effect list.
    pub name: &'static str,
    /// What became of it.
    pub verdict: Verdict,
    /// Share of the mean square in its axes that it removes where it was not fitted.
    pub gain: Option<Interval>,
}

/// Residual along one axis on the judged flights.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Axis {
    /// Body axis.
    pub axis: &'static str,
    /// Mean residual of the nominal model, m/s².
    pub mean_before_mps2: Interval,
    /// Mean residual with the effects, m/s².
    pub mean_after_mps2: Interval,
    /// Rms residual of the nominal model, m/s².
    pub rms_before_mps2: f64,
    /// Rms residual with the effects, m/s².
    pub rms_after_mps2: f64,
    /// Force that stays over 5 s and that no effect explains, rms, noise taken off, m/s².
    pub unexplained_mps2: f64,
    /// From where on it matters, m/s²: half a degree of tilt or a hundredth of the weight, and no less
    /// than what the attitude reference can feign.
    pub material_mps2: f64,
}

/// How far the gap shrinks on the unseen flights.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shrink {
    /// Share of the gap above the floor that is closed.
    #[serde(flatten)]
    pub closed: Interval,
    /// Axes that the effects act on.
    pub axes: Vec<&'static str>,
    /// Mean square before, by the variance on the fitted flights.
    pub before: f64,
    /// The same after.
    pub after: f64,
    /// The same when the whole library is fitted on the unseen flight itself, cross-validated.
    pub floor: f64,
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// First word.
    pub outcome: Outcome,
    /// Flights that the parameters come from.
    pub fitted_on: Vec<String>,
    /// Flights that judge.
    pub held_out: Vec<String>,
    /// Parts left out of the nominal model.
    pub without: Vec<&'static str>,
    /// Blocks of 5 s, fitted and held out.
    pub blocks: [usize; 2],
    /// Instants left out for bad motion capture.
    pub lost_samples: usize,
    /// Rows left out by the reader, per flight, fitted ones first.
    pub skipped_rows: Vec<Skipped>,
    /// Calibrated thrust over the vehicle file's.
    pub thrust_scale: f64,
    /// Where the nominal residual lies, largest change first.
    #[serde(rename = "where")]
    pub places: Vec<Where>,
    /// Credited effects.
    pub effects: Vec<Effect>,
    /// The first effect and what cannot be told from it.
    pub set: Vec<&'static str>,
    /// Every candidate by itself.
    pub candidates: Vec<Candidate>,
    /// Per axis.
    pub axes: Vec<Axis>,
    /// On unseen flights.
    pub shrink: Option<Shrink>,
    /// Wrong-effect control: median share that the other candidates remove.
    pub control: Option<f64>,
    /// What could not be tested, and why.
    pub not_testable: Vec<(&'static str, String)>,
}

impl Report {
    /// Readable in twenty seconds.
    pub fn text(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut out);
        out
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        let nominal = match self.without.join(", ") {
            all if all.is_empty() => "nominal model".to_string(),
            some => format!("nominal model without {some}"),
        };
        let judged = match self.held_out.join(", ") {
            none if none.is_empty() => "no unseen flight".to_string(),
            some => format!("judged on {some}"),
        };
        writeln!(
            out,
            "FORCE BALANCE  {nominal}, fitted on {}, {judged}",
            self.fitted_on.join(", ")
        )?;
        write!(out, "VERDICT        {}", self.outcome.words())?;
        for (i, effect) in self.effects.iter().enumerate() {
            let Effect { id, name, what, block, .. } = effect;
            let join = if i == 0 { ":" } else { "\n               and" };
            write!(out, "{join} {id} {name} ({what}; block {block})")?;
            for Parameter { name, unit, interval: Interval { value, low, high } } in
                &effect.parameters
            {
                write!(
                    out,
                    "\n               {name} {value:.2} {unit} (95 %: {low:.2}..{high:.2})"
                )?;
            }
        }
        writeln!(out)?;
        if self.held_out.is_empty() && !self.effects.is_empty() {
            writeln!(
                out,
                "               not confirmed: within one flight time and voltage fall together, so \
                 thermal droop (P7)\n               and the battery (N7, P8) cannot be told apart; \
                 give another flight with --held-out"
            )?;
        }
        for (i, place) in self.places.iter().take(3).enumerate() {
            let head = if i == 0 { "WHERE" } else { "" };
            writeln!(out, "{head:<14} {}", place.words())?;
        }
        for (i, a) in self.axes.iter().enumerate() {
            let head = if i == 0 { "RESIDUAL" } else { "" };
            let Interval { value, low, high } = a.mean_after_mps2;
            writeln!(
                out,
                "{head:<14} {:<8} mean {:+.3} -> {value:+.3} m/s2 (95 %: {low:+.3}..{high:+.3}), rms \
                 {:.2} -> {:.2}, over 5 s {:.2} (limit {:.2})",
                a.axis,
                a.mean_before_mps2.value,
                a.rms_before_mps2,
                a.rms_after_mps2,
                a.unexplained_mps2,
                a.material_mps2
            )?;
        }
        if let Some(Shrink { closed: Interval { value, low, high }, axes, .. }) = &self.shrink {
            writeln!(
                out,
                "SHRINK         unseen flight, {}: {value:.2} of the gap closed (95 %: {low:.2}..\
                 {high:.2}; 1 is the best that the library can do)",
                axes.join(" and ")
            )?;
        }
        if let Some(control) = self.control {
            writeln!(
                out,
                "CONTROL        the effects not taken: median {control:+.2} of the mean square"
            )?;
        }
        if self.set.len() > 1 {
            writeln!(out, "NOT RULED OUT  {}", self.set.get(1..).unwrap_or_default().join(", "))?;
        }
        let ids: Vec<&str> = self.not_testable.iter().map(|(id, _)| *id).collect();
        writeln!(out, "NOT TESTABLE   {}", ids.join(", "))?;
        writeln!(
            out,
            "\n{:<5} {:<34} {:>7} {:>16}  verdict",
            "id", "each by itself", "gain", "95 %"
        )?;
        for c in &self.candidates {
            let (gain, range) = c.gain.map_or(("-".into(), "-".into()), |g| {
                (format!("{:+.3}", g.value), format!("{:+.3}..{:+.3}", g.low, g.high))
            });
            let verdict = match c.verdict {
                Verdict::Credited => "credited",
                Verdict::NotTestable => "not testable",
                Verdict::WrongSign => "wrong sign",
                Verdict::DoesNotHelp => "does not help",
                Verdict::Immaterial => "immaterial",
            };
            writeln!(out, "{:<5} {:<34} {gain:>7} {range:>16}  {verdict}", c.id, c.name)?;
        }
        Ok(())
    }
}

impl Where {
    fn words(&self) -> String {
        let Where { block, axis, against, unit, slope, change_mps2, score } = self;
        let sense = match *against {
            "voltage" if slope.value < 0.0 => ", growing as the voltage falls",
            "voltage" => ", growing as the voltage rises",
            "speed" if slope.value < 0.0 => ", against the motion",
            "speed" => ", with the motion",
            _ => "",
        };
        format!(
            "{block}, {axis}: {:+.2} m/s2 per {unit} of {against}{sense}; {:.2} m/s2 over the range, \
             {score:.0} sigma",
            slope.value,
            change_mps2.abs()
        )
    }
}
