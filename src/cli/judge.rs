//! Judges the flight of a program beside the companion: `gap diagnose` or `fit`, as a process of its
//! own at a low priority, so that nothing it does can delay or end a flight.

use std::ffi::OsString;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;

use serde_json::Value;

use haltere_log::log_file::has_log_ending;
use haltere_pilot::services::{Judgement, Told};
use haltere_pilot::settings::DiagnosisConfig;

/// Priority of the process, as `nice` has it when nothing is said. At the lowest (19) no verdict came within 90 s beside ten
/// busy programs; nothing flies while it works: arming ends it.
const NICE: &str = "10";
/// Most numbers of a verdict that go out as messages of their own.
const MOST_VALUES: usize = 8;
/// Longest name of such a number.
const NAME_BYTES: usize = 10;
/// Exit code of `fit` for a log that does not hold what was asked, and of `gap diagnose` for a fault.
const REFUSED: [i32; 2] = [3, 30];
/// First exit code of `gap diagnose` that says that there is no verdict.
const NO_VERDICT: i32 = 20;

/// Arguments of this process that stand before those of the companion: it may be a part of another
/// program (`haltere-sim companion …`).
static BEFORE_OURS: OnceLock<Vec<OsString>> = OnceLock::new();

/// Takes note of how the companion was started, for starting it again.
pub(super) fn started_with(ours: &[OsString]) {
    let all: Vec<OsString> = std::env::args_os().skip(1).collect();
    let before = all.len().saturating_sub(ours.len().saturating_sub(1));
    // Set once: a second call in one process says the same.
    let _ = BEFORE_OURS.set(all.into_iter().take(before).collect());
}

/// What judges a program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Judged {
    /// The diagnosis of the gap.
    Gap,
    /// The fit of this name.
    Fit(&'static str),
}

/// A process at work.
pub(super) struct Judging {
    child: Child,
    folder: tempfile::TempDir,
    judged: Judged,
}

impl Judging {
    /// Starts on a log that may still be written.
    pub(super) fn start(
        judged: Judged,
        log: &Path,
        options: &DiagnosisConfig,
    ) -> Result<Self, String> {
        let told = |error: std::io::Error| format!("the judgement does not start: {error}");
        let folder = tempfile::tempdir().map_err(told)?;
        let file = |name: &str| File::create(folder.path().join(name)).map_err(told);
        let page = |kind: &str| log.with_extension(format!("{kind}.html"));
        let mut command = Command::new(std::env::current_exe().map_err(told)?);
        command.args(BEFORE_OURS.get().into_iter().flatten()).args(["--nice", NICE]);
        match judged {
            Judged::Gap => {
                command.args(["gap", "diagnose", "--json", "--without-advice", "--size"]);
                command.arg(options.size.name());
                command.arg("--report").arg(page("gap"));
                if !options.banks.as_os_str().is_empty() {
                    command.arg("--banks").arg(&options.banks);
                }
                if !options.vehicle.as_os_str().is_empty() {
                    command.arg("--vehicle").arg(&options.vehicle);
                }
                command.arg(log);
                for reference in logs_in(&options.references)? {
                    command.arg("--reference").arg(reference);
                }
            }
            Judged::Fit(name) => {
                command.args(["fit", name, "--json"]);
                if name != "trim" {
                    command.arg("--report").arg(page(&format!("fit-{name}")));
                }
                command.arg(log);
            }
        }
        let child = command
            .stdin(Stdio::null())
            .stdout(file("out")?)
            .stderr(file("err")?)
            .spawn()
            .map_err(told)?;
        Ok(Self { child, folder, judged })
    }

    /// How far it is.
    pub(super) fn look(&mut self) -> Result<Judgement, String> {
        let code = match self.child.try_wait() {
            Ok(None) => return Ok(self.progress()),
            Ok(Some(status)) => status.code(),
            Err(error) => return Err(format!("the judgement is lost: {error}")),
        };
        let out: Value = match serde_json::from_str(&self.read("out")) {
            Ok(out) => out,
            Err(_) => return Err(self.refusal(code)),
        };
        match (self.judged, code) {
            (Judged::Gap, Some(code)) => Ok(Judgement::Done(of_diagnosis(&out, code))),
            (Judged::Fit(name), Some(0)) => Ok(Judgement::Done(of_fit(name, &out))),
            (_, code) => Err(self.refusal(code)),
        }
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.folder.path().join(name)).unwrap_or_default()
    }

    /// From the last line of its progress: `bank: 216 of 2160, 240 s left`.
    fn progress(&self) -> Judgement {
        let text = self.read("err");
        let of = |line: &str| {
            let (what, rest) = line.rsplit_once(": ")?;
            let (done, rest) = rest.split_once(" of ")?;
            let (of, _) = rest.split_once(',')?;
            let (done, of) = (done.parse::<u64>().ok()?, of.parse::<u64>().ok()?);
            Some((what.to_owned(), (100 * done / of.max(1)).min(100) as u8))
        };
        let (what, percent) =
            text.lines().rev().find_map(of).unwrap_or_else(|| ("reads the log".to_owned(), 0));
        Judgement::Running { percent, what }
    }

    /// Its own last words.
    fn refusal(&self, code: Option<i32>) -> String {
        let text = self.read("err");
        let line = text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or_default();
        let words = line.trim_start_matches("haltere: ");
        match code {
            Some(code) if REFUSED.contains(&code) || code == 1 => words.to_owned(),
            Some(code) => format!("exit code {code}: {words}"),
            None => "ended by a signal".to_owned(),
        }
    }
}

impl Drop for Judging {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Logs of a folder, by name. An empty path: none.
fn logs_in(folder: &Path) -> Result<Vec<PathBuf>, String> {
    if folder.as_os_str().is_empty() {
        return Ok(Vec::new());
    }
    let told =
        |error: std::io::Error| format!("diagnosis.references = {}: {error}", folder.display());
    let mut logs = Vec::new();
    for entry in fs::read_dir(folder).map_err(told)? {
        let path = entry.map_err(told)?.path();
        if has_log_ending(&path) {
            logs.push(path);
        }
    }
    logs.sort();
    Ok(logs)
}

/// A name that fits into its field.
fn short(parts: &[&str]) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_uppercase() } else { '_' };
    let all: String = parts.join("_").chars().map(plain).collect();
    all.chars().take(NAME_BYTES).collect()
}

fn number(value: &Value) -> Option<f64> {
    value.as_f64().filter(|v| v.is_finite())
}

/// The verdict of `gap diagnose --json`.
fn of_diagnosis(out: &Value, code: i32) -> Vec<Told> {
    let text = |v: &Value| v.as_str().unwrap_or_default().to_owned();
    let mut lines =
        vec![Told::Text(text(&out["verdict"])), Told::Value("VERDICT".into(), code as f32)];
    let empty = Vec::new();
    let list = |key: &str| out[key].as_array().unwrap_or(&empty).clone();
    if code >= NO_VERDICT {
        lines.extend(list("faults").iter().map(|fault| Told::Text(text(fault))));
        return lines;
    }
    for place in list("where").iter().take(2) {
        let anchor = place["anchor"].as_u64().map_or(String::new(), |a| format!(", anchor {a}"));
        let sigma = number(&place["score"]).unwrap_or(0.0);
        lines.push(Told::Text(format!(
            "where: {} ({}{anchor}), {sigma:.1} sigma above null flights",
            text(&place["block"]),
            text(&place["channel"]),
        )));
    }
    for effect in list("effects") {
        let id = text(&effect["id"]);
        let probability = number(&effect["probability"]).unwrap_or(0.0);
        let mut words = format!("{id} {} with {:.0} %", text(&effect["name"]), 100.0 * probability);
        lines.push(Told::Value(short(&["P", &id]), probability as f32));
        for parameter in effect["parameters"].as_array().unwrap_or(&empty) {
            let name = text(&parameter["name"]);
            let Some(value) = number(&parameter["value"]) else { continue };
            words += &format!(", {name} {value:.3}");
            if let [Some(low), Some(high)] = ["low", "high"].map(|key| number(&parameter[key])) {
                words += &format!(" ({low:.3} to {high:.3})");
            }
            if lines.len() < MOST_VALUES {
                lines.push(Told::Value(short(&[&id, &name]), value as f32));
            }
        }
        lines.push(Told::Text(words));
    }
    lines
}

/// The numbers of `fit NAME --json`.
fn of_fit(name: &str, out: &Value) -> Vec<Told> {
    let mut lines = Vec::new();
    let mut add = |what: &str, value: f64, std: f64, unit: &str| {
        lines.push(Told::Text(format!("{what} {value:.4} ± {std:.4} {unit}")));
        lines.push(Told::Value(short(&[what]), value as f32));
    };
    if name == "trim" {
        for axis in ["roll", "pitch", "yaw"] {
            let of = |key: &str| number(&out[axis][key]);
            if let (Some(value), Some(std)) = (of("value_deg"), of("std_deg")) {
                add(&format!("trim {axis}"), value, std, "deg");
            }
        }
        return lines;
    }
    for parameter in out["parameters"].as_array().into_iter().flatten().take(MOST_VALUES) {
        let word = |key: &str| parameter[key].as_str().unwrap_or_default();
        if let (Some(value), Some(std)) = (number(&parameter["value"]), number(&parameter["std"])) {
            add(word("name"), value, std, word("unit"));
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn prop_a_verdict_is_read_from_the_json_of_the_diagnosis() {
        let out = json!({
            "verdict": "drag is missing",
            "where": [{ "block": "aerodynamics", "channel": "force x", "anchor": null, "score": 9.25 }],
            "effects": [{ "id": "A1", "name": "drag", "probability": 0.93,
                "parameters": [{ "name": "forward", "value": 4.0, "low": 3.5, "high": null }] }],
        });
        let lines = of_diagnosis(&out, 10);
        assert_eq!(lines[0], Told::Text("drag is missing".into()));
        assert_eq!(lines[1], Told::Value("VERDICT".into(), 10.0));
        assert!(lines.contains(&Told::Value("A1_FORWARD".into(), 4.0)));
        assert!(
            lines.contains(&Told::Text("A1 drag with 93 %, forward 4.000".into())),
            "{lines:?}"
        );
        // Nothing of it there: still no panic, and no number that was not measured.
        assert_eq!(of_diagnosis(&Value::Null, 0).len(), 2);
        assert!(of_fit("drag", &Value::Null).is_empty());
    }
}
