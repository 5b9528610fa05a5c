//! No crate that is built into the programs has a licence that was not agreed to (`deny.toml`). `packaging/licences` lists
//! them, for this and for the packages. Needs nothing but cargo and Python: no tool, no network.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
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

#[test]
fn prop_what_is_built_in_has_a_licence_that_is_allowed() {
    let output = Command::new(root().join("packaging/licences"))
        .env("CARGO", env!("CARGO"))
        .output()
        .expect("Python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let page = String::from_utf8(output.stdout).expect("UTF-8");
    let allowed = allowed();
    let rows = page.lines().filter(|line| line.starts_with("| ")).skip(1);
    let mut crates = 0;
    for row in rows {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        assert!(is_met(cells[3], &allowed), "{row}\nallowed in deny.toml are {allowed:?}");
        crates += 1;
    }
    assert!(crates > 50, "only {crates} crates");
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
