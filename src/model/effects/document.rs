//! The list of effects as a page of documentation: `docs/EFFECTS.md` is this, word for word.

use std::fmt::Write as _;

use super::{ALL, Block, Deviation, EffectSpec, Role};

/// The page, in Markdown.
pub fn markdown() -> String {
    let mut page = String::from(
        "# Effects\n\nGenerated from the list in `src/model/effects` by `haltere-sim effects`; a \
         test compares.\n\n*Nominal* effects are on unless a scenario switches them off. \
         *Deviations* are off unless it switches them on; the diagnosis of the sim-to-real gap chooses \
         from those with a star. Ranges and defaults are the \
         Flapper's; of a size that goes with something another vehicle's are as much larger or smaller.\n",
    );
    for (nominal, title) in [(true, "Nominal"), (false, "Deviations")] {
        let _ = write!(page, "\n## {title}\n");
        for spec in ALL.iter().filter(|spec| (spec.role == Role::Nominal) == nominal) {
            page.push_str(&section(spec));
        }
    }
    page.push_str(
        "\n## Where\n\nWhere each deviation has its place in the chain: what the diagnosis says of a flight when it \
         says where. Mission, controller and estimator are our own software and have none.\n\n\
         | block | deviations |\n|---|---|\n",
    );
    for block in Block::CHAIN.into_iter().filter(|block| !block.is_consequence()) {
        let own = ALL.iter().filter(|s| s.role != Role::Nominal && s.block == block);
        let ids: Vec<&str> = own.map(|spec| spec.id).collect();
        let _ = writeln!(page, "| `{}` | {} |", block.name(), ids.join(", "));
    }
    page
}

/// What there is to say of one effect.
pub fn section(spec: &EffectSpec) -> String {
    let mut page = String::new();
    let star = if spec.deviation().is_some_and(|of| of.standard) { "*" } else { "" };
    // Writing to a String cannot fail.
    let _ = write!(page, "\n### {}{star} {}\n\n", spec.id, spec.name);
    if let Some(of) = spec.deviation() {
        let taken_for = match of.looks_like {
            [] => "nothing else".to_owned(),
            ids => ids.join(", "),
        };
        let _ = write!(
            page,
            "{}\n\n* Usual causes: {}.\n* What to do: {}.\n* Shows as: {}.\n* Taken for: {taken_for}. {}\n\n",
            verdict(spec, of),
            of.causes,
            of.remedy,
            of.shows,
            of.apart,
        );
    }
    let _ = write!(
        page,
        "Block `{}`. {}\n\n{}\n\nOff: {}\n",
        spec.block.name(),
        spec.source,
        code(spec.equation),
        spec.off
    );
    if spec.parameters.is_empty() {
        return page;
    }
    page.push_str("\n| parameter | unit | default | range | off at | meaning |\n");
    page.push_str("|---|---|---|---|---|---|\n");
    for p in spec.parameters {
        let _ = writeln!(
            page,
            "| `{}` | {} | {} | {} to {} | {} | {} |",
            p.name, p.unit, p.default, p.low, p.high, p.off, p.doc
        );
    }
    page
}

/// The sentence of a verdict with the names of the parameters for their numbers.
fn verdict(spec: &EffectSpec, of: &Deviation) -> String {
    let sided = spec.parameters.iter().filter(|p| p.ways.is_some());
    let list: Vec<_> = sided.map(|p| format!("{{{}}}", p.name)).collect();
    of.verdict.replace("{}", &list.join(", ")).replace(['{', '}'], "`")
}

fn code(equation: &str) -> String {
    format!("```text\n{equation}\n```")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_page_is_the_list() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/EFFECTS.md");
        if std::env::var_os("HALTERE_REWRITE_GOLDENS").is_some() {
            std::fs::write(path, markdown()).unwrap();
        }
        assert!(
            std::fs::read_to_string(path).unwrap() == markdown(),
            "docs/EFFECTS.md is old: HALTERE_REWRITE_GOLDENS=1 cargo test --workspace --lib page_is"
        );
    }
}
