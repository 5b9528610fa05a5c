//! The list of effects as a page of documentation: `docs/EFFECTS.md` is this, word for word.

use std::fmt::Write as _;

use super::{ALL, Deviation, EffectSpec, Role};

/// Where most sizes come from.
const USUAL_SOURCE: &str = "plausible sizes by judgement";

/// The page, in Markdown.
pub fn markdown() -> String {
    let mut page = String::from(
        "# Effects\n\nGenerated from the list in `src/model/effects` by `haltere-sim effects`; a \
         test compares.\n\n*Nominal* effects are on unless a scenario switches them off. *Deviations* are off unless it \
         switches them on; the diagnosis of the sim-to-real gap chooses from those with a star. An effect belongs to a block \
         of the chain. A parameter is shown with its default, then its range, the value that switches it off where \
         that is not 0, and its meaning. Ranges and defaults are the Flapper's; a size that goes with something is scaled by that for another \
         vehicle. Sizes of deviations are plausible by judgement where no source is named.\n",
    );
    for (nominal, title) in [(true, "Nominal"), (false, "Deviations")] {
        let _ = write!(page, "\n## {title}\n");
        for spec in ALL.iter().filter(|spec| (spec.role == Role::Nominal) == nominal) {
            page.push_str(&section(spec));
        }
    }
    page
}

/// What there is to say of one effect.
pub fn section(spec: &EffectSpec) -> String {
    let mut page = String::new();
    let of = spec.deviation();
    let star = if of.is_some_and(|of| of.standard) { "*" } else { "" };
    // Writing to a String cannot fail.
    let _ = write!(page, "\n### {}{star} {}\n\n", spec.id, spec.name);
    if let Some(of) = of {
        let taken_for = match of.looks_like {
            [] => "nothing else".to_owned(),
            ids => ids.join(", "),
        };
        let _ = write!(
            page,
            "{}\n\n* Causes: {}.\n* What to do: {}.\n* Shows as: {}.\n* Taken for: {taken_for}. {}\n",
            verdict(spec, of),
            of.causes,
            of.remedy,
            of.shows,
            of.apart,
        );
    }
    let _ = writeln!(page, "* Block `{}`: `{}`", spec.block.name(), spec.equation);
    if spec.source != USUAL_SOURCE {
        let _ = writeln!(page, "* Source: {}", spec.source);
    }
    if of.is_none() {
        let _ = writeln!(page, "* Off: {}", spec.off);
    }
    for p in spec.parameters {
        let off = if p.off == 0.0 { String::new() } else { format!(", off {}", p.off) };
        let unit = if p.unit.is_empty() { String::new() } else { format!(" {}", p.unit) };
        let _ = writeln!(
            page,
            "* `{}` = {}{unit} ({} to {}{off}): {}",
            p.name, p.default, p.low, p.high, p.doc
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
