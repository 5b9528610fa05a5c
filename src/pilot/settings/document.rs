//! The sample configuration as data: every key with its default and what is said about it. From it are
//! made the page `docs/CONFIGURATION.md` and the files of `haltere init`. Tests hold the sample to the
//! types: it shows every key, with its default.

use std::fmt::Write as _;

/// `config/haltere.toml`.
pub const SAMPLE: &str = include_str!("../../../config/haltere.toml");

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
    let mut keys = Vec::new();
    let (mut section, mut text) = (String::new(), String::new());
    for line in SAMPLE.lines() {
        let bare = line.strip_prefix("# ");
        let assigned = bare.unwrap_or(line).split_once(" = ").filter(|(name, _)| is_name(name));
        if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
            section = name.to_owned();
            text.clear();
        } else if let Some((name, value)) = assigned {
            keys.push(DocumentedKey {
                section: section.clone(),
                name: name.to_owned(),
                value: value.to_owned(),
                absent: bare.is_some(),
                text: std::mem::take(&mut text),
            });
        } else if let Some(words) = bare {
            if !text.is_empty() {
                text.push(' ');
            }
            text.push_str(words);
        } else {
            text.clear();
        }
    }
    keys
}

/// Names of keys, and of quantities in frames: `p_BT_B_m`.
fn is_name(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// The page `docs/CONFIGURATION.md`.
pub fn configuration_page() -> String {
    let keys = reference();
    let mut page = format!(
        "# Configuration\n\n\
         Generated from `config/haltere.toml`, which tests hold to the program; do not edit. {} keys.\n\n\
         Layers, later ones win: defaults; files named by `--config` in their order, or `haltere.toml` \
         in the working directory; environment variables `HALTERE_SECTION__KEY`, with two underscores \
         between sections too, such as `HALTERE_CONTROL__LIMITS__TILT_DEG=25`; `--set \
         section.key=value`. Parameters that a station has set (`docs/PARAMETERS.md`) lie over files and \
         under the last two. Unknown keys and values out of range are refused with file, line, key, value \
         and range; `haltere check` tells all that is wrong at once. Logs of older builds are read with the keys of \
         their time.\n",
        keys.len()
    );
    let mut section = None;
    for key in &keys {
        if section != Some(&key.section) {
            section = Some(&key.section);
            let title = match key.section.as_str() {
                "" => "Above every section".to_owned(),
                name => format!("`[{name}]`"),
            };
            let _ = write!(page, "\n## {title}\n\n| key | default | |\n|---|---|---|\n");
        }
        let value = key.value.replace('|', "\\|");
        let shown = if key.absent {
            format!("absent; for example `{value}`")
        } else {
            format!("`{value}`")
        };
        let _ = writeln!(page, "| `{}` | {shown} | {} |", key.name, key.text.replace('|', "\\|"));
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_configuration_page_is_the_sample() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/CONFIGURATION.md");
        if std::env::var_os("HALTERE_REWRITE_GOLDENS").is_some() {
            std::fs::write(path, configuration_page()).expect("docs/ can be written");
        }
        assert!(
            std::fs::read_to_string(path).unwrap_or_default() == configuration_page(),
            "docs/CONFIGURATION.md is old: HALTERE_REWRITE_GOLDENS=1 cargo test --workspace --lib page_is"
        );
    }

    #[test]
    fn prop_every_key_is_told_with_words() {
        let keys = reference();
        let set = SAMPLE.lines().filter(|l| !l.starts_with('#') && l.contains(" = ")).count();
        assert_eq!(keys.iter().filter(|k| !k.absent).count(), set);
        assert!(keys.iter().any(|k| k.name == "height_m" && k.absent));
        for key in &keys {
            let above = key.name == haltere_core::checks::schema::Schema::KEY;
            assert!(!key.text.is_empty() && key.section.is_empty() == above, "{key:?}");
        }
    }
}
