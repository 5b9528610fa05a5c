//! The page `docs/MESSAGES.md`: our own messages from the dialect's XML, and which messages the core reads
//! and sends from its source.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

/// The dialect.
pub const XML: &str = include_str!("../../dialect/xml/haltere.xml");

/// Where a message passes, by the file of the core that names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Party {
    Tag,
    Board,
    Stations,
}

/// Messages by name, and with whom each is exchanged.
type Found = BTreeMap<String, BTreeSet<Party>>;

/// The page. `sources`: name and content of each file of the core.
pub fn page(sources: &[(String, String)]) -> String {
    let (mut read, mut sent) = (Found::new(), Found::new());
    for (name, text) in sources {
        look(name, text, &mut read, &mut sent);
    }
    let mut page = String::from(
        "# Messages\n\n\
         Generated from `dialect/xml/haltere.xml` and from what the source of the pilot core names; do not \
         edit. Frames are MAVLink 2 (version 1 is read too). Rates, links and clients: \
         `docs/STATIONS.md`; parameters, plans, files and logs: `docs/SERVICES.md`.\n",
    );
    for (title, found) in [("Read", &read), ("Sent", &sent)] {
        let _ = write!(
            page,
            "\n## {title}\n\n| message | tag | board | stations |\n|---|---|---|---|\n"
        );
        for (name, parties) in found {
            let mark = |party| if parties.contains(&party) { "x" } else { "" };
            let _ = writeln!(
                page,
                "| {name} | {} | {} | {} |",
                mark(Party::Tag),
                mark(Party::Board),
                mark(Party::Stations)
            );
        }
    }
    page += "\n## Our own\n\nIds 54100 to 54149; one XML file for every generator. NaN is \"not known\".\n";
    page += &own_messages(XML);
    page
}

/// What a file names: in a pattern it is read, with a value it is sent.
fn look(name: &str, text: &str, read: &mut Found, sent: &mut Found) {
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    let file = name.rsplit('/').next().unwrap_or_default();
    let parties: &[Party] = match file {
        f if f.starts_with("board") => &[Party::Board],
        "ingest.rs" => &[Party::Tag],
        // Motion capture is taken from wherever it comes.
        "reference.rs" => &[Party::Board, Party::Stations],
        _ => &[Party::Stations],
    };
    if code.contains("heartbeat_of(") {
        read.entry("HEARTBEAT".to_owned()).or_default().extend(parties);
    }
    for piece in code.split("MavMessage::").skip(1) {
        let end = piece
            .find(|c: char| !(c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_'))
            .unwrap_or(piece.len());
        let (message, rest) = piece.split_at(end);
        let Some(inside) = rest.strip_prefix('(') else { continue };
        let inside = inside.trim_start();
        let binder: String =
            inside.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
        // What is bound to a short name or ignored is a pattern; what is built is a value.
        let is_pattern = binder == "_" || binder.chars().count() == 1 || binder == "wrong_frame";
        let into = if is_pattern { &mut *read } else { &mut *sent };
        if !message.is_empty() && !binder.is_empty() {
            into.entry(message.to_owned()).or_default().extend(parties);
        }
    }
}

fn own_messages(xml: &str) -> String {
    let mut page = String::new();
    for message in xml.split("<message ").skip(1) {
        let message = message.split("</message>").next().unwrap_or_default();
        let head = message.split('>').next().unwrap_or_default();
        let described = between(message, "<description>", "</description>").unwrap_or_default();
        let _ = write!(
            page,
            "\n### {} ({})\n\n{}\n\n| field | type | unit | |\n|---|---|---|---|\n",
            attribute(head, "name"),
            attribute(head, "id"),
            plain(described)
        );
        for field in message.split("<field ").skip(1) {
            let (head, rest) = field.split_once('>').unwrap_or((field, ""));
            let text = rest.split("</field>").next().unwrap_or_default();
            let _ = writeln!(
                page,
                "| {} | {} | {} | {} |",
                attribute(head, "name"),
                attribute(head, "type"),
                attribute(head, "units"),
                plain(text).replace('|', "\\|")
            );
        }
    }
    page
}

fn between<'t>(text: &'t str, begin: &str, end: &str) -> Option<&'t str> {
    text.split_once(begin)?.1.split_once(end).map(|(inside, _)| inside)
}

fn attribute<'t>(head: &'t str, name: &str) -> &'t str {
    // A blank before it, so that `name` is not found in `display_name`.
    let head_at = if head.starts_with(&format!("{name}=\"")) {
        Some(0)
    } else {
        head.find(&format!(" {name}=\"")).map(|at| at + 1)
    };
    head_at
        .and_then(|at| head.get(at..))
        .and_then(|rest| between(rest, "\"", "\""))
        .unwrap_or_default()
}

/// Entities of XML, and white space as one blank.
fn plain(text: &str) -> String {
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    words.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&amp;", "&")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sources(folder: &std::path::Path, into: &mut Vec<(String, String)>) {
        for entry in std::fs::read_dir(folder).expect("the source of the core") {
            let path = entry.expect("a readable folder").path();
            // The guard names messages that it turns away, the others speak to no station.
            let aside = ["guard", "settings", "uwb"].iter().any(|name| path.ends_with(name));
            if aside {
                continue;
            }
            if path.is_dir() {
                sources(&path, into);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = std::fs::read_to_string(&path).expect("a readable file");
                into.push((path.display().to_string().replace('\\', "/"), text));
            }
        }
    }

    #[test]
    fn golden_messages_page_is_the_dialect_and_the_core() {
        let mut all = Vec::new();
        sources(std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/src/pilot")), &mut all);
        super::super::check_page("MESSAGES.md", &page(&all));
    }

    #[test]
    fn prop_patterns_are_read_and_values_are_sent() {
        let text = "match m { MavMessage::PING(m) if x => {} MavMessage::SET_MODE(_) => {} }\n\
                    send(&MavMessage::HEARTBEAT(HEARTBEAT_DATA { a: 1 }));\n\
                    send(MavMessage::PING(echo));\n\
                    #[cfg(test)] MavMessage::LOG_ERASE(_)";
        let (mut read, mut sent) = (Found::new(), Found::new());
        look("src/pilot/board_x.rs", text, &mut read, &mut sent);
        let names = |found: &Found| found.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&read), ["PING", "SET_MODE"]);
        assert_eq!(names(&sent), ["HEARTBEAT", "PING"]);
        assert!(read["PING"].contains(&Party::Board));
    }

    #[test]
    fn prop_every_own_message_has_its_fields() {
        let page = own_messages(XML);
        assert_eq!(page.matches("\n### ").count(), XML.matches("<message ").count());
        assert_eq!(
            page.matches("\n| ").count(),
            XML.matches("<field ").count() + XML.matches("<message ").count()
        );
        assert!(
            page.contains("| distance_diff | float | m | Distance to anchor_b minus"),
            "{page}"
        );
    }
}
