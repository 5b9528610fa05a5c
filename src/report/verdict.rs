//! Verdicts: what was checked of a flight, what was found, what was allowed.

/// Outcome of one check.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Verdict {
    /// Inside the bound.
    Pass,
    /// Inside the bound, but worth a look.
    Warn,
    /// Bound broken.
    Fail,
    /// Could not be judged; never counts as passed.
    NotChecked {
        /// What was missing.
        why: String,
    },
}

/// One check.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Check {
    /// What was looked at.
    pub name: String,
    /// What was found, with unit.
    pub found: String,
    /// What is allowed, with unit.
    pub allowed: String,
    /// Outcome.
    pub verdict: Verdict,
}

impl Check {
    /// `value` may not exceed `most`.
    pub fn at_most(name: impl Into<String>, value: Option<f64>, most: f64, unit: &str) -> Self {
        let (found, verdict) = match value {
            Some(v) if v.is_finite() => {
                (format!("{v:.3} {unit}"), if v <= most { Verdict::Pass } else { Verdict::Fail })
            }
            _ => ("\u{2013}".into(), Verdict::NotChecked { why: "no samples".into() }),
        };
        Self { name: name.into(), found, allowed: format!("at most {most:.3} {unit}"), verdict }
    }

    /// A yes or no question.
    pub fn that(name: impl Into<String>, holds: bool, found: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            found: found.into(),
            allowed: "yes".into(),
            verdict: if holds { Verdict::Pass } else { Verdict::Fail },
        }
    }
}

/// Whether every check was made and none failed.
pub fn all_passed(checks: &[Check]) -> bool {
    checks.iter().all(|c| matches!(c.verdict, Verdict::Pass | Verdict::Warn))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_missing_data_never_passes() {
        assert_eq!(Check::at_most("a", Some(0.1), 0.1, "m").verdict, Verdict::Pass);
        assert_eq!(Check::at_most("a", Some(0.1001), 0.1, "m").verdict, Verdict::Fail);
        for value in [None, Some(f64::NAN)] {
            let check = Check::at_most("a", value, 0.1, "m");
            assert!(!all_passed(&[check]));
        }
    }
}
