//! The list of effects as a page of documentation: `docs/EFFECTS.md` is this, word for word.

use std::fmt::Write as _;

use super::{ALL, EffectSpec, Role};

/// The page, in Markdown.
pub fn markdown() -> String {
    let mut page = String::from(
        "# Effects\n\nGenerated from the list in `src/model/effects` by `haltere-sim effects`; a \
         test compares.\n\n*Nominal* effects are on unless a scenario switches them off. \
         *Deviations* are off unless it switches them on: they are what the diagnosis of the \
         sim-to-real gap chooses from.\n",
    );
    for (role, title) in [(Role::Nominal, "Nominal"), (Role::Deviation, "Deviations")] {
        let _ = write!(page, "\n## {title}\n");
        for spec in ALL.iter().filter(|spec| spec.role == role) {
            describe(&mut page, spec);
        }
    }
    page
}

fn describe(page: &mut String, spec: &EffectSpec) {
    // Writing to a String cannot fail.
    let _ = write!(
        page,
        "\n### {} {}\n\nBlock `{}`. {}\n\n{}\n\nOff: {}\n",
        spec.id,
        spec.name,
        spec.block.name(),
        spec.source,
        code(spec.equation),
        spec.off
    );
    if spec.parameters.is_empty() {
        return;
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
}

fn code(equation: &str) -> String {
    format!("```text\n{equation}\n```")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_page_is_the_list() {
        let committed = include_str!("../../../docs/EFFECTS.md");
        assert!(
            committed == markdown(),
            "docs/EFFECTS.md is old: cargo run -p haltere-sim -- effects > docs/EFFECTS.md"
        );
    }
}
