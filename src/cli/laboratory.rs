//! Commands of the laboratory under the names that programs outside know: `haltere-lab` beside this program runs them.

use std::ffi::OsString;
use std::os::unix::process::CommandExt as _;
use std::process::{Command, ExitCode};

/// The first words of a command here, and those of the laboratory's; an option among them may stand anywhere.
const OURS: [(&[&str], &str); 8] = [
    (&["replay", "--util"], "util"),
    (&["replay", "--flights"], "flights"),
    (&["gap", "balance"], "balance"),
    (&["campaign", "faults"], "faults"),
    (&["paper"], "paper"),
    (&["soak"], "soak"),
    (&["flood"], "flood"),
    (&["kills"], "kills"),
];

/// The laboratory's arguments for a command of this program that is one of its own.
fn translated(args: &[OsString]) -> Option<Vec<OsString>> {
    let (words, name) = OURS.iter().find(|(words, _)| {
        words.iter().enumerate().all(|(place, word)| {
            let is_option = word.starts_with("--");
            if is_option {
                args.iter().any(|arg| arg == word)
            } else {
                args.get(place).is_some_and(|arg| arg == word)
            }
        })
    })?;
    let rest = args.iter().enumerate().filter(|(place, arg)| {
        words.get(*place).is_none_or(|word| word.starts_with("--") || arg != word)
            && !words.iter().any(|word| word.starts_with("--") && arg == word)
    });
    Some(std::iter::once(OsString::from(name)).chain(rest.map(|(_, arg)| arg.clone())).collect())
}

/// Runs such a command in place of this program. `None`: it is none.
pub fn run(args: impl IntoIterator<Item = OsString>) -> Option<ExitCode> {
    let args: Vec<OsString> = args.into_iter().skip(1).collect();
    let args = translated(&args)?;
    let beside = std::env::current_exe().map(|program| program.with_file_name("haltere-lab"));
    let failed = match beside {
        Ok(program) => Command::new(program).args(&args).exec(),
        Err(error) => error,
    };
    let command = args[0].to_string_lossy();
    eprintln!(
        "haltere: this is `haltere-lab {command}`, and that program does not run beside this one ({failed}): \
         `cargo build --release --workspace` builds it"
    );
    Some(ExitCode::from(super::output::FAILED))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_names_that_programs_outside_know_lead_to_the_laboratory() {
        let told = |line: &str| {
            let args: Vec<OsString> = line.split(' ').map(OsString::from).collect();
            translated(&args).map(|args| {
                args.iter()
                    .map(|arg| arg.to_string_lossy().into_owned())
                    .collect::<Vec<_>>()
                    .join(" ")
            })
        };
        for (line, want) in [
            ("replay --util data --json", Some("util data --json")),
            ("replay --json --util data", Some("util --json data")),
            ("replay --flights logs --truth", Some("flights logs --truth")),
            ("campaign faults --sample 6", Some("faults --sample 6")),
            ("paper --only steps", Some("paper --only steps")),
            ("replay log.mcap", None),
            ("campaign lab --out faults", None),
        ] {
            assert_eq!(told(line).as_deref(), want, "{line}");
        }
    }
}
