//! The table in ARCHITECTURE.md is a rule: this checks every import in `src/` against it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// One row of the table, spread over its modules.
struct Layers {
    base: BTreeSet<String>,
    /// Module to what it may import; `None`: everything.
    may: BTreeMap<String, Option<BTreeSet<String>>>,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Words between backticks.
fn quoted(cell: &str) -> BTreeSet<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_string).collect()
}

fn layers() -> Layers {
    let text = read(&root().join("ARCHITECTURE.md"));
    let section = text.split("## Layers of `src/`").nth(1).expect("the section on layers");
    let rows = section.split("\n## ").next().unwrap_or_default().lines();
    let mut layers = Layers { base: BTreeSet::new(), may: BTreeMap::new() };
    let mut found = Vec::new();
    for row in rows.filter(|l| l.starts_with('|')).skip(2) {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let [layer, modules, may] = cells[..] else { panic!("not three columns: {row}") };
        if layer == "base" {
            layers.base = quoted(modules);
        }
        found.push((quoted(modules), may.to_string()));
    }
    assert!(!layers.base.is_empty() && found.len() > 5, "the table was not understood");
    for (modules, may) in found {
        let named = quoted(&may);
        let allowed = if may == "all" {
            None
        } else {
            let base = may.split_whitespace().any(|w| w == "base");
            let from_base = if base { layers.base.clone() } else { BTreeSet::new() };
            Some(named.into_iter().chain(from_base).collect())
        };
        for module in modules {
            layers.may.insert(module, allowed.clone());
        }
    }
    layers
}

fn rust_files(folder: &Path, into: &mut Vec<PathBuf>) {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    for entry in entries {
        let path = entry.expect("a readable folder").path();
        if path.is_dir() {
            rust_files(&path, into);
        } else if path.extension().is_some_and(|e| e == "rs") {
            into.push(path);
        }
    }
}

fn sources(folder: &str) -> Vec<(PathBuf, String)> {
    let mut files = Vec::new();
    rust_files(&root().join(folder), &mut files);
    files.sort();
    files.into_iter().map(|path| (path.clone(), read(&path))).collect()
}

/// Libraries below the program: folders of `src/` with a manifest.
fn libraries() -> Vec<String> {
    let entries = std::fs::read_dir(root().join("src")).expect("src/").flatten();
    let mut found: Vec<String> = entries
        .filter(|entry| entry.path().join("Cargo.toml").is_file())
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    found.sort();
    found
}

/// Row of the table that a path of modules leads to: the longest part of it that is one, by the name of its library where
/// it is an inner one.
fn row_of(
    library: &str,
    path: &[&str],
    rows: &BTreeMap<String, Option<BTreeSet<String>>>,
) -> Option<String> {
    (1..=path.len()).rev().find_map(|n| {
        let part = path[..n].join("::");
        let inner = format!("{library}::{part}");
        [inner, part].into_iter().find(|row| rows.contains_key(row))
    })
}

/// Library that a file belongs to, and its modules.
fn place_of(path: &Path) -> Option<(String, Vec<String>)> {
    let inside = path.strip_prefix(root().join("src")).ok()?.with_extension("");
    let parts = inside.components().filter_map(|part| part.as_os_str().to_str());
    let mut parts: Vec<String> = parts.map(str::to_string).collect();
    let is_library = parts.len() > 1 && libraries().contains(&parts[0]);
    let library = if is_library { parts.remove(0) } else { String::new() };
    Some((library, parts))
}

/// Row of the table that a file belongs to: module of the program or of a library; what of a library stands in no row of
/// its own is of the row with the library's name.
fn module_of(path: &Path) -> Option<String> {
    let (library, parts) = place_of(path)?;
    let words: Vec<&str> = parts.iter().map(String::as_str).collect();
    if library.is_empty() {
        return words.first().map(|first| (*first).to_string());
    }
    let rows = layers().may;
    let whole = Some(library.clone()).filter(|library| rows.contains_key(library));
    row_of(&library, &words, &rows).or(whole).or_else(|| words.first().map(|w| (*w).to_string()))
}

/// What leads a path to a module: of the own crate, or of a library, whose name stands beside it.
fn crate_roots() -> Vec<(String, String)> {
    let named = libraries().into_iter().map(|name| (format!("haltere_{name}::"), name));
    std::iter::once(("crate::".to_string(), String::new())).chain(named).collect()
}

/// Code without comments. Good enough for imports: no import stands in a string.
fn code_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().filter_map(|(i, line)| {
        let code = line.split("//").next().unwrap_or_default();
        (!code.trim().is_empty()).then_some((i + 1, code))
    })
}

/// Rows of the table that `crate::…` and `haltere_LIBRARY::…` lead to, in `use` trees with braces too. What of a library
/// stands in no row of its own is of the row with the library's name.
fn imports(text: &str, own: &str) -> Vec<(usize, String)> {
    let rows = layers().may;
    let row = |path: String, library: &str| {
        let words: Vec<&str> = path.split("::").collect();
        let library = if library.is_empty() { own } else { library };
        // A library may show a module from further inside at its root.
        let shown = |row: &&String| {
            row.starts_with(&format!("{library}::")) && row.ends_with(&format!("::{}", words[0]))
        };
        row_of(library, &words, &rows)
            .or_else(|| rows.keys().find(shown).cloned())
            .unwrap_or_else(|| if library.is_empty() { words[0] } else { library }.to_string())
    };
    let mut found = Vec::new();
    let lines: Vec<(usize, &str)> = code_lines(text).collect();
    let roots = crate_roots();
    for (at, (number, code)) in lines.iter().enumerate() {
        let starts = roots.iter().flat_map(|(root, library)| {
            let found = code.match_indices(root.as_str());
            found.map(move |(start, _)| (start, root.len(), library.as_str()))
        });
        for (start, long, library) in starts {
            let bounded = code[..start]
                .chars()
                .next_back()
                .is_none_or(|c| !c.is_alphanumeric() && c != '_' && c != '$');
            if !bounded {
                continue;
            }
            let mut rest = code[start + long..].to_string();
            if rest.starts_with('{') {
                // A tree over several lines ends at the semicolon.
                let mut next = at + 1;
                while !rest.contains(';') && next < lines.len() {
                    rest.push_str(lines[next].1);
                    next += 1;
                }
                let tree = rest.split(';').next().unwrap_or_default();
                let mut depth = 0;
                let mut item = String::new();
                for c in tree.chars() {
                    match c {
                        '{' => depth += 1,
                        '}' => depth -= 1,
                        _ => {}
                    }
                    let ends = (c == ',' && depth == 1) || (c == '}' && depth == 0);
                    if ends {
                        found.push((*number, row(path_in(&item), library)));
                        item.clear();
                    } else if depth >= 1 && !(c == '{' && depth == 1) {
                        item.push(c);
                    }
                }
            } else {
                found.push((*number, row(path_in(&rest), library)));
            }
        }
    }
    found.retain(|(_, word)| !word.is_empty());
    found
}

/// The path of modules that a text begins with.
fn path_in(text: &str) -> String {
    let words = |c: &char| c.is_alphanumeric() || matches!(c, '_' | ':');
    let path: String = text.trim().chars().take_while(words).collect();
    path.trim_end_matches(':').to_string()
}

#[test]
fn prop_imports_follow_the_table() {
    let layers = layers();
    let mut broken = Vec::new();
    let mut seen = 0;
    for (path, text) in sources("src") {
        let module = module_of(&path).unwrap_or_default();
        // The root of a crate names what its modules may use, which Cargo holds; build scripts are no part of it.
        let root_file = path.ends_with("lib.rs") || path.ends_with("main.rs");
        if root_file || module == "build" {
            continue;
        }
        let shown = path.strip_prefix(root()).unwrap_or(&path).display().to_string();
        let Some(may) = layers.may.get(&module) else {
            broken.push(format!("{shown}: module `{module}` is not in the table"));
            continue;
        };
        let own = place_of(&path).map_or(String::new(), |(library, _)| library);
        // Tests of a part may bring up the whole core.
        let is_part = module.contains("::");
        if is_part && path.ends_with("tests.rs") {
            continue;
        }
        let code =
            if is_part { text.split("#[cfg(test)]").next().unwrap_or_default() } else { &text };
        for (line, import) in imports(code, &own) {
            // Names that are no modules: macros at the crate root.
            if !layers.may.contains_key(&import) {
                continue;
            }
            seen += 1;
            let allowed = may.as_ref().is_none_or(|may| may.contains(&import));
            if import != module && !allowed {
                broken.push(format!("{shown}:{line}: `{module}` may not import `{import}`"));
            }
        }
    }
    assert!(seen > 10, "only {seen} imports were recognised");
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}

#[test]
fn prop_the_table_names_what_exists() {
    let missing: Vec<String> = layers()
        .may
        .into_keys()
        .filter(|m| {
            let src = root().join("src");
            let folders = libraries().into_iter().map(|name| src.join(name));
            !folders.chain([src.clone()]).any(|folder| {
                let inside = folder.join(m.replace("::", "/"));
                inside.with_extension("rs").is_file()
                    || inside.join("mod.rs").is_file()
                    || inside.join("lib.rs").is_file()
            })
        })
        .collect();
    assert!(missing.is_empty(), "in the table, not in src/: {missing:?}");
}

#[test]
fn prop_filter_and_controller_never_see_the_physics() {
    for (path, text) in sources("src") {
        if matches!(
            module_of(&path).as_deref(),
            Some("estimator" | "control" | "pilot::navigation::uwb")
        ) {
            let sees = imports(&text, "").iter().any(|(_, m)| m == "model");
            assert!(!sees, "{}: imports the simulator's physics", path.display());
        }
    }
}

#[test]
fn prop_cores_have_no_clock_no_files_no_threads() {
    const CORES: [&str; 3] = ["core", "model", "pilot"];
    const FORBIDDEN: [&str; 8] = [
        "Instant::now",
        "SystemTime",
        "std::fs",
        "std::net",
        "std::thread",
        "rand::rng()",
        "thread_rng",
        "std::env::",
    ];
    let mut broken = Vec::new();
    let files = CORES.iter().flat_map(|library| sources(&format!("src/{library}")));
    for (path, text) in files.filter(|(path, _)| !path.ends_with("tests.rs")) {
        // Tests at the end of a file may do as they like.
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        for (line, code) in code_lines(code) {
            for word in FORBIDDEN.iter().filter(|w| code.contains(**w)) {
                broken.push(format!("{}:{line}: {word}", path.display()));
            }
        }
    }
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}

#[test]
fn prop_every_file_says_what_it_owns() {
    let folders = ["src", "dialect/src", "sim/src", "sim/lab/src", "tests"];
    for (path, text) in folders.into_iter().flat_map(sources) {
        assert!(text.starts_with("//!"), "{}: must open with `//!`", path.display());
    }
}

/// Names of the dependencies that a manifest has for its library or program, and of those for tests and build scripts.
fn dependencies(manifest: &str) -> [BTreeSet<String>; 2] {
    let text = read(&root().join(manifest).join("Cargo.toml"));
    let mut found = [BTreeSet::new(), BTreeSet::new()];
    let mut into = None;
    for line in text.lines() {
        match line {
            "[dependencies]" => into = Some(0),
            "[dev-dependencies]" | "[build-dependencies]" => into = Some(1),
            _ if line.starts_with('[') => into = None,
            _ => {
                let name = line.split(['.', ' ', '=']).next().unwrap_or_default();
                if let Some(list) = into.filter(|_| !name.is_empty() && !name.starts_with('#')) {
                    found[list].insert(name.to_string());
                }
            }
        }
    }
    found
}

#[test]
fn prop_crates_depend_downward() {
    // From below: each may need those above it in this list, and no other of ours.
    const CRATES: [(&str, &str); 9] = [
        ("dialect", "haltere-dialect"),
        ("src/core", "haltere-core"),
        ("src/pilot", "haltere-pilot"),
        ("src/log", "haltere-log"),
        ("src/model", "haltere-model"),
        ("src/gap", "haltere-gap"),
        (".", "haltere"),
        ("sim", "haltere-sim"),
        ("sim/lab", "haltere-lab"),
    ];
    for (i, (folder, name)) in CRATES.iter().enumerate() {
        let [needs, _] = dependencies(folder);
        assert!(!needs.is_empty(), "{folder}/Cargo.toml was not understood");
        let below: Vec<&str> = CRATES[..i].iter().map(|(_, name)| *name).collect();
        for need in needs.iter().filter(|need| need.starts_with("haltere")) {
            assert!(below.contains(&need.as_str()), "{name} needs {need}");
        }
    }
    let found: BTreeSet<String> = CRATES
        .iter()
        .filter_map(|(folder, _)| folder.strip_prefix("src/").map(str::to_string))
        .collect();
    assert_eq!(found, libraries().into_iter().collect(), "every library is in the list");
}

#[test]
fn prop_libraries_carry_no_more_than_they_need() {
    let [core, _] = dependencies("src/core");
    assert_eq!(core, ["nalgebra".to_string(), "serde".to_string()].into(), "the filter alone");
    for library in libraries() {
        let [needs, _] = dependencies(&format!("src/{library}"));
        for heavy in ["tokio", "clap", "tracing-subscriber", "serialport"] {
            assert!(!needs.contains(heavy), "src/{library} needs {heavy}: that is the program's");
        }
        for format in ["mcap", "parquet", "prost"] {
            let may = library == "log" || !needs.contains(format);
            assert!(may, "src/{library} needs {format}: files are the log's");
        }
    }
}

#[test]
fn prop_the_reader_of_imports_reads() {
    let text = "use crate::{\n    frames::{B, E},\n    time::HostTime, // crate::model\n};\n\
                use haltere_core::drops::Drops;\nlet x: haltere_model::Plant = haltere_model::lockstep::f;\n\
                $crate::not::this;\n";
    let found: Vec<String> = imports(text, "").into_iter().map(|(_, m)| m).collect();
    assert_eq!(found, ["frames", "time", "drops", "model", "lockstep"]);
}
