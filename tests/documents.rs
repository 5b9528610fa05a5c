//! Documents that sources and documents name are in the repository, and so are the sections that they cite by number;
//! the map of the documents leads to each, and marks those that a program writes; a release has one version.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Where documents are named.
const FOLDERS: [&str; 12] = [
    "benches",
    "config",
    "dialect",
    "docs",
    "examples",
    "fuzz/src",
    "packaging",
    "python",
    "sim",
    "src",
    "stations",
    "tests",
];
/// What is read of them.
const KINDS: [&str; 6] = ["rs", "md", "py", "toml", "proto", "xml"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every file of these kinds, with its text; at the root itself documents alone.
fn files() -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = FOLDERS.iter().map(|folder| root().join(folder)).collect();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a readable folder").flatten() {
            let path = entry.path();
            let kind = path.extension().and_then(|kind| kind.to_str()).unwrap_or_default();
            if path.is_dir() {
                folders.push(path);
            } else if KINDS.contains(&kind) {
                found.push(path);
            }
        }
    }
    let at_root = std::fs::read_dir(root()).expect("the repository").flatten();
    found.extend(
        at_root.map(|entry| entry.path()).filter(|p| p.extension().is_some_and(|e| e == "md")),
    );
    found.sort();
    let read = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        (path, text)
    };
    found.into_iter().map(read).collect()
}

/// A document as it is named, and what follows its name.
struct Citation<'a> {
    named: &'a str,
    rest: &'a str,
}

impl Citation<'_> {
    fn file(&self) -> &str {
        self.named.rsplit('/').next().unwrap_or(self.named)
    }

    /// The section that is cited by number, as in `GAP.md 2.4` and `GAP.md, section 3`.
    fn section(&self) -> Option<&str> {
        let rest = self.rest.trim_start_matches(['`', '*', ',']).trim_start();
        let told = rest.strip_prefix("sections ").or(rest.strip_prefix("section "));
        let number = told.unwrap_or(rest);
        let end =
            number.find(|c: char| !c.is_ascii_alphanumeric() && c != '.').unwrap_or(number.len());
        let number = number[..end].trim_end_matches('.');
        let begins = number.starts_with(|c: char| c.is_ascii_digit());
        (begins && (told.is_some() || number.contains('.'))).then_some(number)
    }

    /// The effect that is cited, as in `EFFECTS.md U6`.
    fn effect(&self) -> Option<&str> {
        let word = self.rest.strip_prefix(' ')?;
        let end = word.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(word.len());
        let digits = word[..end].strip_prefix(|c: char| c.is_ascii_uppercase())?;
        (!digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())).then_some(&word[..end])
    }
}

/// Documents have names in capitals. Lines of a comment are one text.
fn citations(text: &str) -> Vec<Citation<'_>> {
    let part_of_a_path = |c: char| c.is_ascii_alphanumeric() || "_/.-".contains(c);
    let mut found = Vec::new();
    for (at, _) in text.match_indices(".md") {
        let end = at + ".md".len();
        if text[end..].starts_with(|c: char| c.is_ascii_alphanumeric() || c == '_') {
            continue;
        }
        let begin = text[..at]
            .rfind(|c| !part_of_a_path(c))
            .map_or(0, |k| k + text[k..].chars().next().map_or(1, char::len_utf8));
        let citation = Citation { named: &text[begin..end], rest: &text[end..] };
        let stem = citation.file().trim_end_matches(".md");
        let capitals =
            stem.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_');
        // Where a package puts one is no place in the repository.
        let installed = citation.named.starts_with("usr/");
        if stem.len() > 1 && capitals && !installed {
            found.push(citation);
        }
    }
    found
}

/// Lines one behind another, without what begins a line of a comment.
fn flowing(text: &str) -> String {
    let lines =
        text.lines().map(|line| line.trim_start().trim_start_matches(['/', '!', '#']).trim());
    lines.collect::<Vec<_>>().join(" ")
}

/// Numbers of the headings of a page: `2.4` of `### 2.4 Where`, `1` of `## 1. The tag`.
fn sections(page: &str) -> Vec<&str> {
    let headings = page.lines().filter(|line| line.starts_with("##"));
    let numbers =
        headings.filter_map(|line| line.trim_start_matches('#').split_whitespace().next());
    numbers.map(|number| number.trim_end_matches('.')).collect()
}

#[test]
fn prop_documents_that_are_named_exist_with_the_sections_that_are_cited() {
    let files = files();
    let pages: BTreeMap<&str, &str> = files
        .iter()
        .filter_map(|(path, text)| Some((path.file_name()?.to_str()?, text.as_str())))
        .filter(|(name, _)| name.ends_with(".md"))
        .collect();
    let (mut broken, mut checked) = (Vec::new(), 0);
    for (path, text) in files.iter().filter(|(path, _)| !path.ends_with(file!())) {
        let text = flowing(text);
        let shown = path.strip_prefix(root()).unwrap_or(path).display();
        for citation in citations(&text) {
            checked += 1;
            let named = citation.named;
            let beside = path.parent().unwrap_or(root());
            let there = if named.contains('/') {
                // A path that is put together begins with what leads up to the root.
                let from_root = named.trim_start_matches(['/', '.']);
                root().join(from_root).is_file() || beside.join(named).is_file()
            } else {
                pages.contains_key(named)
            };
            if !there {
                broken.push(format!("{shown}: {named} is not in the repository"));
                continue;
            }
            let page = pages.get(citation.file()).copied().unwrap_or_default();
            if let Some(section) = citation.section()
                && !sections(page).contains(&section)
            {
                broken.push(format!("{shown}: {named} has no section {section}"));
            }
            if let Some(effect) = citation.effect()
                && ![" ", "* "].iter().any(|end| page.contains(&format!("\n### {effect}{end}")))
            {
                broken.push(format!("{shown}: {named} has no {effect}"));
            }
        }
    }
    assert!(checked > 300, "only {checked} names of documents were found");
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}

#[test]
fn prop_the_map_leads_to_every_document() {
    let map = std::fs::read_to_string(root().join("docs/MAP.md")).expect("docs/MAP.md");
    let pages = std::fs::read_dir(root().join("docs")).expect("docs/").flatten();
    let names = pages.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let missing: Vec<String> = names
        .filter(|name| name.ends_with(".md") && name != "MAP.md")
        .filter(|name| !map.contains(&format!("]({name})")))
        .collect();
    assert!(missing.is_empty(), "docs/MAP.md does not lead to {missing:?}");
}

/// A page that a program writes says so in its first lines, before its text.
fn is_made(page: &str) -> bool {
    let head = page.lines().take(4).collect::<Vec<_>>().join(" ");
    ["Generated from", "Written by", "writes this page"].iter().any(|said| head.contains(said))
}

#[test]
fn prop_the_map_marks_pages_that_a_program_writes() {
    let map = std::fs::read_to_string(root().join("docs/MAP.md")).expect("docs/MAP.md");
    let (mut made, mut wrong) = (0, Vec::new());
    for entry in std::fs::read_dir(root().join("docs")).expect("docs/").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let page = std::fs::read_to_string(entry.path()).unwrap_or_default();
        if name.ends_with(".md") && map.contains(&format!("]({name})*")) != is_made(&page) {
            wrong.push(name.clone());
        }
        made += usize::from(is_made(&page));
    }
    assert!(made > 8, "only {made} pages say that a program writes them");
    assert!(wrong.is_empty(), "docs/MAP.md marks with a star what a program writes: {wrong:?}");
}

/// What follows this at the begin of a line.
fn after<'a>(text: &'a str, begin: &str) -> &'a str {
    let line = text.lines().find_map(|line| line.strip_prefix(begin));
    line.unwrap_or_default().trim_matches('"')
}

#[test]
fn prop_a_release_has_one_version() {
    let text =
        |name: &str| std::fs::read_to_string(root().join(name)).expect("a file of the repository");
    let version = text("Cargo.toml");
    let version = after(&version, "version = ");
    for package in ["examples", "python"] {
        assert_eq!(after(&text(&format!("{package}/pyproject.toml")), "version = "), version);
    }
    assert_eq!(after(&text("CITATION.cff"), "version: "), version);
    assert!(after(&text("CHANGELOG.md"), "## ").starts_with(version), "the newest of CHANGELOG.md");
}

#[test]
fn prop_the_reader_of_citations_reads() {
    let text = flowing(
        "/// See `docs/GAP.md`, section 2.5; GAP.md\n    /// 3.1. INTERFACES.md section 1a, \
         EFFECTS.md U6, x.md, README.mdx",
    );
    let cited = citations(&text);
    let found: Vec<_> = cited.iter().map(|c| (c.named, c.section(), c.effect())).collect();
    assert_eq!(
        found,
        [
            ("docs/GAP.md", Some("2.5"), None),
            ("GAP.md", Some("3.1"), None),
            ("INTERFACES.md", Some("1a"), None),
            ("EFFECTS.md", None, Some("U6")),
        ]
    );
    assert_eq!(sections("# A\n## 1. One\n### 1a. `b`\n### 2.4 Where\n"), ["1", "1a", "2.4"]);
}
