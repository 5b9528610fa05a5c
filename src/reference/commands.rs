//! Commands in the blocks of a manual, as a shell would take them apart: tests hold manuals to the programs.

/// The arguments of every call of `program` in the `sh` blocks of a page, program name first.
pub fn commands_of(page: &str, program: &str) -> Vec<Vec<String>> {
    let mut commands = Vec::new();
    let mut block = false;
    let mut pending = String::new();
    for line in page.lines() {
        if let Some(kind) = line.trim_start().strip_prefix("```") {
            block = !block && kind == "sh";
            pending.clear();
            continue;
        }
        if !block {
            continue;
        }
        if let Some(begun) = line.trim_end().strip_suffix('\\') {
            pending += begun;
            continue;
        }
        let whole = std::mem::take(&mut pending) + line;
        let words = words(&whole);
        // `sudo haltere …` and `target/release/haltere …` are calls too.
        let at = words.iter().take(2).position(|word| word.rsplit('/').next() == Some(program));
        if let Some(at) = at {
            commands.push(words.into_iter().skip(at).collect());
        }
    }
    commands
}

/// Words of a line up to the end of its first command, without redirections.
fn words(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    for c in line.chars().chain([' ']) {
        match quote {
            Some(open) if c == open => quote = None,
            Some(_) => word.get_or_insert_default().push(c),
            None if c == '\'' || c == '"' => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            None if c.is_whitespace() => {
                let Some(word) = word.take() else { continue };
                // A comment, a pipe, the next command, or a redirection: what follows is none of ours.
                if word.starts_with(['#', '|', '&', ';', '>', '<']) || word.starts_with("2>") {
                    return words;
                }
                words.push(word);
            }
            None => word.get_or_insert_default().push(c),
        }
    }
    words
}

/// The manuals whose commands are checked, from the root of the repository.
pub const MANUALS: [&str; 7] = [
    "README.md",
    "docs/INSTALL.md",
    "docs/TUTORIAL_GAP.md",
    "docs/TUTORIAL_SQUARE.md",
    "docs/VEHICLE.md",
    "docs/WATCH.md",
    "examples/README.md",
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_commands_are_taken_out_of_blocks_as_a_shell_would() {
        let page = "haltere no\n```sh\nhaltere fly --set 'a=[\"b c\"]' # why\nsudo haltere init \\\n  --yes > x\n\
                    haltere-sim serve &\n```\n```text\nhaltere no\n```\n";
        let all = commands_of(page, "haltere");
        assert_eq!(
            all,
            [vec!["haltere", "fly", "--set", "a=[\"b c\"]"], vec!["haltere", "init", "--yes"]]
        );
        assert_eq!(commands_of(page, "haltere-sim"), [["haltere-sim", "serve"]]);
    }
}
