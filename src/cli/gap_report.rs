//! The JSON of a gap report, read back: only what other commands need of it.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use serde::Deserialize;

use haltere_gap::advice::{Hypothesis, Remaining};
use haltere_gap::bank::library::find;
use haltere_gap::outcome::Ending;
use haltere_model::Vehicle;
use haltere_model::effects::EffectSpec;

/// A report.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Report {
    pub log: PathBuf,
    flight: Option<Flight>,
    pub outcome: Ending,
    #[serde(default)]
    pub verdict: String,
    #[serde(default)]
    effects: Vec<Effect>,
    #[serde(default)]
    set: Vec<String>,
    #[serde(default)]
    not_testable: Vec<String>,
    commissioned: Option<Commissioned>,
    attribution: Option<Attribution>,
}

#[derive(Debug, Clone, Deserialize)]
struct Flight {
    number: usize,
}

#[derive(Debug, Clone, Deserialize)]
struct Commissioned {
    vehicle: Vehicle,
}

#[derive(Debug, Clone, Deserialize)]
struct Effect {
    id: String,
    parameters: Vec<Parameter>,
}

#[derive(Debug, Clone, Deserialize)]
struct Parameter {
    name: String,
    value: Option<f64>,
}

#[derive(Debug, Clone, Deserialize)]
struct Attribution {
    candidates: Vec<Candidate>,
}

#[derive(Debug, Clone, Deserialize)]
struct Candidate {
    id: String,
    posterior: Option<f64>,
    theta: Vec<Option<f64>>,
    theta_90: Vec<[Option<f64>; 2]>,
}

impl Report {
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let text = haltere_log::intake::text(path, 1 << 30)
            .with_context(|| format!("{}", path.display()))?;
        serde_json::from_str(&text).with_context(|| {
            format!("{}: not the JSON of `haltere gap diagnose --report FILE.html`", path.display())
        })
    }

    /// The log: as the report names it, or by its name beside the report.
    pub fn log_beside(&self, report: &Path) -> anyhow::Result<PathBuf> {
        if self.log.exists() {
            return Ok(self.log.clone());
        }
        let name = self.log.file_name().unwrap_or_default();
        let beside = report.parent().unwrap_or(Path::new(".")).join(name);
        if beside.exists() {
            return Ok(beside);
        }
        anyhow::bail!(
            "{}: the log behind this report is neither there nor beside the report; name it with --log",
            self.log.display()
        )
    }

    /// Number of the flight in the log.
    pub fn flight(&self) -> Option<usize> {
        self.flight.as_ref().map(|flight| flight.number)
    }

    /// The vehicle that was flown in place of the file's.
    pub fn vehicle(&self) -> Option<&Vehicle> {
        self.commissioned.as_ref().map(|c| &c.vehicle)
    }

    /// What the diagnosis left open.
    pub fn remaining(&self) -> Remaining {
        // What is not in the library is not told apart by effects of the library.
        let candidates = self.attribution.as_ref().map_or(&[][..], |a| &a.candidates[..]);
        let hypotheses = candidates
            .iter()
            .filter(|_| self.outcome.is_explained())
            .filter_map(|c| {
                let theta: Option<Vec<f64>> = c.theta.iter().copied().collect();
                let ends = |e: &[Option<f64>; 2]| Some([e[0]?, e[1]?]);
                let theta_90: Option<Vec<[f64; 2]>> = c.theta_90.iter().map(ends).collect();
                Some(Hypothesis {
                    spec: find(&c.id)?,
                    probability: c.posterior?,
                    theta: theta?,
                    theta_90: theta_90?,
                })
            })
            .collect();
        let untested = self.not_testable.iter().filter_map(|id| find(id)).collect();
        Remaining::new(hypotheses, &self.set, untested)
    }

    /// Effects to accept: all that act together, or the one that is asked for with its fitted values.
    pub fn accepted(
        &self,
        asked: Option<&str>,
    ) -> anyhow::Result<Vec<(&'static EffectSpec, Vec<f64>)>> {
        let unknown =
            |id: &str| anyhow::anyhow!("{id}: no such effect; ids are those of docs/EFFECTS.md");
        if let Some(id) = asked {
            let own = find(id).ok_or_else(|| unknown(id))?;
            let named = self.effects.iter().find(|e| e.id == id).map(|e| values(own, e));
            let fitted = self.attribution.as_ref().and_then(|a| {
                let c = a.candidates.iter().find(|c| c.id == id)?;
                c.theta.iter().copied().collect::<Option<Vec<f64>>>()
            });
            let theta = match named {
                Some(values) => values?,
                None => fitted.filter(|t| t.len() == own.parameters.len()).ok_or_else(|| {
                    anyhow::anyhow!("{id}: this report holds no fitted parameters of it")
                })?,
            };
            return Ok(vec![(own, theta)]);
        }
        match (self.outcome, &self.effects[..]) {
            (outcome, [_, ..]) if outcome.acts() => self
                .effects
                .iter()
                .map(|e| {
                    let own = find(&e.id).ok_or_else(|| unknown(&e.id))?;
                    Ok((own, values(own, e)?))
                })
                .collect(),
            (Ending::OneOf, [_, ..]) => {
                let ids: Vec<&str> = self.effects.iter().map(|e| e.id.as_str()).collect();
                anyhow::bail!(
                    "the report could not tell {} apart: choose with --effect, or see `haltere gap advise`",
                    ids.join(", ")
                )
            }
            (outcome, _) => {
                anyhow::bail!(
                    "the report names no effect ({}): there is nothing to accept",
                    outcome.key()
                )
            }
        }
    }
}

fn values(spec: &EffectSpec, effect: &Effect) -> anyhow::Result<Vec<f64>> {
    spec.parameters
        .iter()
        .map(|p| {
            let found = effect.parameters.iter().find(|e| e.name == p.name).and_then(|e| e.value);
            found.ok_or_else(|| anyhow::anyhow!("{}.{}: not in the report", effect.id, p.name))
        })
        .collect()
}
