//! The configuration as pages: every key with its default and what its row says. From it are made `config/haltere.toml`,
//! `docs/CONFIGURATION.md` and the files of `haltere init`.

use std::fmt::Write as _;

use toml::{Table, Value};

use super::Config;
use crate::stations::services::{all_parameters, said_of_parameter};
use haltere_core::checks::schema::Schema;
use haltere_core::checks::shown;
use haltere_core::keys::{Key, Kind, Row, Section, When};

/// One key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DocumentedKey {
    /// Section, such as `control.gains`; empty: above every section.
    pub section: String,
    /// Name in it.
    pub name: String,
    /// Default; for a key that is absent by default an example.
    pub value: String,
    /// Whether the default is that the key is absent.
    pub absent: bool,
    /// What is said about it.
    pub text: String,
}

/// Every key, in the order of the sample.
pub fn reference() -> Vec<DocumentedKey> {
    let mut keys = vec![DocumentedKey {
        section: String::new(),
        name: Schema::KEY.to_owned(),
        value: Schema::CONFIGURATION.newest().to_string(),
        absent: true,
        text: "Version of this kind of file, in the file alone and above every section. A program that knows only \
               older ones refuses the file in words instead of half reading it. 1: the present one."
            .to_owned(),
    }];
    let defaults = Table::try_from(Config::default()).unwrap_or_default();
    Config::rows("", &mut |section, row| {
        let Row::Key(key) = row else { return };
        let mut parts = section.split('.');
        let table = parts.try_fold(&defaults, |table, part| table.get(part)?.as_table());
        let default = table.and_then(|table| table.get(key.name)).map(Value::to_string);
        keys.push(DocumentedKey {
            section: section.to_owned(),
            name: key.name.to_owned(),
            absent: default.is_none(),
            value: default.unwrap_or_else(|| key.example.to_owned()),
            text: text_of(key),
        });
    });
    keys
}

/// What the row says, and what is allowed.
fn text_of(key: &Key) -> String {
    let lines = key.text.iter().map(|line| line.trim()).filter(|line| !line.is_empty());
    let mut text = lines.collect::<Vec<_>>().join(" ");
    let low = key.range.map_or(f64::MIN, |range| range.low);
    match ((key.kind)(), key.range.filter(|range| range.checked)) {
        (Kind::Choice([.., (1, "on")]), _) => {}
        (Kind::Choice(all), _) => {
            let named = all.iter().filter(|(n, _)| f64::from(*n) >= low.max(0.0));
            let told = !key.parameters.is_empty();
            let number = |n: i8| if told { format!(" ({n})") } else { String::new() };
            let names: Vec<_> =
                named.map(|(n, s)| format!("\"{}\"{}", s.replace(' ', "_"), number(*n))).collect();
            let _ = write!(text, " One of {}.", names.join(", "));
        }
        (_, Some(range)) => {
            let [low, high] = [range.low, range.high].map(shown);
            let _ = write!(text, " {low} to {high} {}", range.unit);
            text.truncate(text.trim_end().len());
            text.push('.');
        }
        (_, None) => {}
    }
    text
}

/// Width of a line of comment, characters.
const WIDTH: usize = 98;

/// A text as lines of comment.
pub fn commented(text: &str) -> String {
    let mut out = String::new();
    let mut line = String::from("#");
    for word in text.split_whitespace() {
        if line.chars().count() + 1 + word.chars().count() > WIDTH && line.len() > 1 {
            out += &line;
            out.push('\n');
            line = String::from("#");
        }
        line.push(' ');
        line += word;
    }
    out + &line + "\n"
}

/// Parameters of stations that a key is known by, and when a new value of them acts.
fn parameters_of(key: &DocumentedKey) -> String {
    let full = format!("{}.{}", key.section, key.name);
    let of: Vec<_> = all_parameters().filter(|p| p.key_of_list() == full).collect();
    let Some(first) = of.first() else { return String::new() };
    let acts = match first.when {
        When::AtOnce => "at once",
        When::OnFloor => "floor",
        When::Restart => "restart",
    };
    let names: Vec<_> = of.iter().map(|p| format!("`{}`", p.name)).collect();
    format!(" ({}, {acts})", names.join(", "))
}

/// The page `docs/CONFIGURATION.md`.
pub fn configuration_page() -> String {
    let keys = reference();
    let mut page = format!(
        "# Configuration\n\n\
         Generated from the rows of the keys; do not edit. {} keys.\n\n\
         Layers, later ones win: defaults; files named by `--config` in their order, or `haltere.toml` \
         in the working directory; parameters that a station has set, kept in `store.directory`; environment \
         variables `HALTERE_SECTION__KEY`, with two underscores between sections too, such as \
         `HALTERE_CONTROL__LIMITS__TILT_DEG=25`; `--set section.key=value`. Unknown keys and values out of range are \
         refused with file, line, key, value and range; `haltere check` tells all that is wrong at once. Logs of older \
         builds are read with the keys of their time.\n\n\
         ## Parameters\n\n\
         A station knows a key by the parameter that is named beside it, with the same default, range and unit; all are \
         `MAV_PARAM_TYPE_REAL32`. A value that a station sets is checked by the same rules. A choice is sent as the number \
         behind its name, false as 0, true as 1, and what is left to the version as -1. `MAV_CMD_PREFLIGHT_STORAGE` with \
         param1 = 2 forgets all that were set. A new value acts *at once*, in flight too: outputs go on from where they \
         are and fade to the new law; or on the *floor*, and is refused in flight, where setpoints or limits would jump; or \
         after a *restart*.\n\n\
         Clients of PX4 are told these besides, which no key has:\n\n",
        keys.len()
    );
    for p in all_parameters().filter(|p| p.key.is_empty()) {
        let _ = writeln!(page, "* `{}`: {}", p.name, said_of_parameter(p));
    }
    let mut section = None;
    for key in &keys {
        if section != Some(&key.section) {
            section = Some(&key.section);
            let title = match key.section.as_str() {
                "" => "Above every section".to_owned(),
                name => format!("`[{name}]`"),
            };
            let _ = write!(page, "\n## {title}\n\n");
        }
        let absent = if key.absent { " none, as" } else { "" };
        let parameters = parameters_of(key);
        let _ =
            writeln!(page, "* `{}` ={absent} `{}`{parameters}: {}", key.name, key.value, key.text);
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sample `config/haltere.toml`.
    fn sample() -> String {
        let mut page = "# Configuration of the companion: every key with its default. Leave out what you do not change.\n\
             #\n\
             # Any key can also be set by an environment variable, HALTERE_SECTION__KEY=value, or on the command\n\
             # line, --set section.key=value; the command line wins. Unknown keys are refused. The number behind a choice\n\
             # is what a station's parameter sends for it.\n\n"
            .to_owned();
        let mut section = String::new();
        for key in reference() {
            if section != key.section {
                let _ = write!(page, "\n[{}]\n", key.section);
                section = key.section;
            }
            let off = if key.absent { "# " } else { "" };
            // Writing to a String cannot fail.
            let _ = writeln!(page, "{}{off}{} = {}", commented(&key.text), key.name, key.value);
        }
        page
    }

    #[test]
    fn golden_configuration_page_is_what_the_rows_say() {
        for (name, page) in
            [("docs/CONFIGURATION.md", configuration_page()), ("config/haltere.toml", sample())]
        {
            let path = format!("{}/../../{name}", env!("CARGO_MANIFEST_DIR"));
            if std::env::var_os("HALTERE_REWRITE_GOLDENS").is_some() {
                std::fs::write(&path, &page).expect("it can be written");
            }
            assert!(
                std::fs::read_to_string(path).unwrap_or_default() == page,
                "{name} is old: HALTERE_REWRITE_GOLDENS=1 cargo test --workspace --lib page_is"
            );
        }
    }

    /// Keys whose default is that they are absent stand in the sample as comments: those must be valid too.
    #[test]
    fn prop_examples_are_valid() {
        let keys = reference();
        for key in keys.iter().filter(|key| key.absent && !key.section.is_empty()) {
            let text = format!("[{}]\n{} = {}\n", key.section, key.name, key.value);
            let config = Config::from_toml("sample", &text).expect("it is read");
            let mut problems = haltere_core::checks::Problems::new();
            config.check_to_fly(&mut problems);
            assert!(problems.is_empty(), "{text}: {problems}");
        }
        assert!(keys.iter().all(|key| !key.text.is_empty()));
    }
}
