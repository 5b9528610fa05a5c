//! Pages that are made from the code itself: modes, supervision and messages. Tests hold the committed pages to it;
//! `HALTERE_REWRITE_GOLDENS=1 cargo test --workspace --lib page_is` writes them anew.

pub mod commands;
pub mod messages;
pub mod modes;
pub mod safety;

#[cfg(test)]
pub(crate) fn check_page(name: &str, page: &str) {
    let path = format!("{}/docs/{name}", env!("CARGO_MANIFEST_DIR"));
    if std::env::var_os("HALTERE_REWRITE_GOLDENS").is_some() {
        std::fs::write(&path, page).expect("docs/ can be written");
    }
    assert!(
        std::fs::read_to_string(&path).unwrap_or_default() == page,
        "docs/{name} is old: HALTERE_REWRITE_GOLDENS=1 cargo test --workspace --lib page_is"
    );
}
