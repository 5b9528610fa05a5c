//! `docs/LICENCES.md` names every crate that is built into the programs, with its licence, and none has a
//! licence that was not agreed to (`deny.toml`). Needs nothing but cargo: no tool, no network.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use serde_json::Value;

const PAGE: &str = "docs/LICENCES.md";
/// What the companion runs on, and what it is built on.
const PLATFORMS: [&str; 2] = ["x86_64-unknown-linux-gnu", "aarch64-unknown-linux-gnu"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn metadata(platform: &str) -> Value {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--filter-platform", platform])
        .current_dir(root())
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("cargo writes JSON")
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

/// Crates that end up in the programs: behind our own by plain dependencies, those for tests and for
/// building left out.
fn built_in(metadata: &Value) -> BTreeMap<(String, String), (String, String)> {
    let nodes = metadata["resolve"]["nodes"].as_array().expect("a resolved graph");
    let edges: BTreeMap<&str, Vec<&str>> = nodes
        .iter()
        .map(|node| {
            let plain = |dep: &&Value| {
                dep["dep_kinds"].as_array().into_iter().flatten().any(|kind| kind["kind"].is_null())
            };
            let deps = node["deps"].as_array().into_iter().flatten().filter(plain);
            (text(&node["id"]), deps.map(|dep| text(&dep["pkg"])).collect())
        })
        .collect();
    let members = metadata["workspace_members"].as_array().expect("our own crates");
    let mut waiting: Vec<&str> = members.iter().map(text).collect();
    let mut seen = BTreeSet::new();
    while let Some(id) = waiting.pop() {
        if seen.insert(id) {
            waiting.extend(edges.get(id).into_iter().flatten());
        }
    }
    let packages = metadata["packages"].as_array().expect("packages");
    packages
        .iter()
        .filter(|p| seen.contains(text(&p["id"])) && !p["source"].is_null())
        .map(|p| {
            let key = (text(&p["name"]).to_owned(), text(&p["version"]).to_owned());
            (key, (text(&p["license"]).to_owned(), text(&p["repository"]).to_owned()))
        })
        .collect()
}

/// Licences that `deny.toml` allows.
fn allowed() -> BTreeSet<String> {
    let deny: toml::Table = std::fs::read_to_string(root().join("deny.toml"))
        .expect("deny.toml")
        .parse()
        .expect("TOML");
    let list = deny["licenses"]["allow"].as_array().expect("licenses.allow");
    list.iter().filter_map(|name| name.as_str()).map(str::to_owned).collect()
}

/// Whether an SPDX expression can be met with these: `OR` (or the older `/`) of `AND`s of names.
/// Brackets stand only around an alternative that is joined by `AND`.
fn is_met(expression: &str, allowed: &BTreeSet<String>) -> bool {
    let expression = expression.replace('/', " OR ");
    if let Some((open, rest)) = expression.split_once('(') {
        let Some((inner, behind)) = rest.split_once(')') else { return false };
        let behind = behind.trim().trim_start_matches("AND ").trim();
        return open.trim().is_empty()
            && is_met(inner, allowed)
            && (behind.is_empty() || is_met(behind, allowed));
    }
    expression.split(" OR ").any(|all| {
        all.split(" AND ").all(|one| {
            let name = one.trim();
            allowed.contains(name)
                || name.split_once(" WITH ").is_some_and(|(plain, _)| allowed.contains(plain))
        })
    })
}

fn page() -> String {
    let mut all = BTreeMap::new();
    for platform in PLATFORMS {
        all.extend(built_in(&metadata(platform)));
    }
    assert!(all.len() > 50, "only {} crates", all.len());
    let allowed = allowed();
    let mut page = format!(
        "# Licences\n\nhaltere itself is under MIT or Apache-2.0, as you choose. The programs contain these \
         {} crates of others, each under its own licence. Crates for tests and for building alone are not \
         in the programs and not listed. `tests/licences.rs` writes this page and refuses a licence that \
         `deny.toml` does not allow; `cargo deny check` looks at all crates, those for tests too.\n\n\
         | crate | version | licence | source |\n|---|---|---|---|\n",
        all.len()
    );
    for ((name, version), (licence, source)) in &all {
        assert!(
            is_met(licence, &allowed),
            "{name} {version} is under {licence:?}; allowed in deny.toml are {allowed:?}"
        );
        page += &format!("| {name} | {version} | {licence} | {source} |\n");
    }
    page
}

#[test]
fn golden_the_page_lists_what_is_built_in() {
    let page = page();
    let path = root().join(PAGE);
    if std::env::var_os("HALTERE_REWRITE_GOLDENS").is_some() {
        std::fs::write(&path, &page).expect("the page can be written");
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        kept == page,
        "{PAGE} is old: HALTERE_REWRITE_GOLDENS=1 cargo test --test licences, and look at what changed"
    );
}

#[test]
fn prop_expressions_are_read_as_they_are_meant() {
    let allowed: BTreeSet<String> = ["MIT", "Unicode-3.0"].map(str::to_owned).into();
    for met in
        ["MIT", "MIT OR GPL-3.0-only", "Apache-2.0/MIT", "(MIT OR Apache-2.0) AND Unicode-3.0"]
    {
        assert!(is_met(met, &allowed), "{met}");
    }
    for not in
        ["", "GPL-3.0-only", "MIT AND GPL-3.0-only", "(MIT OR Zlib) AND GPL-3.0-only", "(MIT"]
    {
        assert!(!is_met(not, &allowed), "{not}");
    }
}

/// What people cite and what they install is of one version, and under the licences that lie beside it.
#[test]
fn prop_citation_and_helper_are_of_this_version() {
    let read = |name: &str| std::fs::read_to_string(root().join(name)).expect(name);
    let version = env!("CARGO_PKG_VERSION");
    let citation = read("CITATION.cff");
    assert!(citation.contains(&format!("\nversion: {version}\n")), "CITATION.cff: not {version}");
    let helper: toml::Table = read("examples/pyproject.toml").parse().expect("TOML");
    assert_eq!(helper["project"]["version"].as_str(), Some(version), "examples/pyproject.toml");
    for (file, begins, licence) in
        [("LICENSE-MIT", "MIT License", "MIT"), ("LICENSE-APACHE", "Apache License", "Apache-2.0")]
    {
        assert!(read(file).trim_start().starts_with(begins), "{file}");
        assert!(env!("CARGO_PKG_LICENSE").split(" OR ").any(|one| one == licence), "{licence}");
        assert!(citation.contains(&format!("\n  - {licence}\n")), "CITATION.cff: {licence}");
        assert_eq!(helper["project"]["license"].as_str(), Some(env!("CARGO_PKG_LICENSE")));
    }
}
