//! The page `docs/MESSAGES.md`: our own messages from the dialect's XML, and from the tables of the core what stations
//! say, command and are shown.

use std::fmt::Write as _;

use haltere_dialect::mav_stream::name_of_id;
use haltere_pilot::{ORDERS, Permit, SAID, STREAMS, Steers};

/// The dialect.
pub const XML: &str = include_str!("../../dialect/xml/haltere.xml");

/// The page.
pub fn page() -> String {
    let mut page = String::from(
        "# Messages\n\n\
         Generated from `dialect/xml/haltere.xml` and from the tables of the pilot core; do not edit. Frames are \
         MAVLink 2 (version 1 is read too). Links and clients: `docs/STATIONS.md`; parameters, plans, files and logs, \
         and how they are answered: `docs/SERVICES.md`; the link to the board: `docs/BOARDS.md`.\n",
    );
    page += "\n## Heard from stations\n\n\
             Who is not among `ground.commanders` may look. What steers is not passed on to the board while we \
             steer it; of COMMAND_INT and COMMAND_LONG the next table says it.\n\n\
             | message | id | may be sent by | steers |\n|---|---|---|---|\n";
    for said in SAID {
        let (name, id, who) = (said.name, said.id, who(&said.permit));
        let _ = writeln!(page, "| {name} | {id} | {who} | {} |", mark(said.steers));
    }
    page += "\n## Commands of stations\n\n\
             All others are unsupported, for commanders alone, and steer.\n\n\
             | command | may be sent by | steers | refused in a shadow | done |\n|---|---|---|---|---|\n";
    for order in ORDERS {
        let steers = match order.steers {
            Steers::No => "",
            Steers::Yes => "x",
            Steers::Rate => "what we need ourselves",
        };
        let _ = writeln!(
            page,
            "| {:?} | {} | {steers} | {} | {} |",
            order.command,
            who(&order.permit),
            mark(order.refused_in_shadow),
            mark(order.is_done())
        );
    }
    page += "\n## Shown to stations\n\n\
             Rates are those of a link where nobody asks for others; 0 goes to who asks for it alone.\n\n\
             | message | id | Hz | group |\n|---|---|---|---|\n";
    let mut streams: Vec<_> = STREAMS.iter().collect();
    streams.sort_by_key(|stream| stream.id);
    for stream in streams {
        let name = name_of_id(stream.id).unwrap_or_default();
        let rate =
            if stream.on_request { "on request".to_owned() } else { stream.rate_hz.to_string() };
        let group = stream.group.map_or(String::new(), |group| format!("{group:?}"));
        let group = group.trim_start_matches("MAV_DATA_STREAM_");
        let _ = writeln!(page, "| {name} | {} | {rate} | {group} |", stream.id);
    }
    page += "\n## Our own\n\nIds 54100 to 54149; one XML file for every generator. NaN is \"not known\".\n";
    page += &own_messages(XML);
    page
}

fn who<F>(permit: &Permit<F>) -> &'static str {
    match permit {
        Permit::Look => "all",
        Permit::Command => "commanders",
        Permit::Asks(_) => "all, as far as it only asks",
    }
}

fn mark(is_so: bool) -> &'static str {
    if is_so { "x" } else { "" }
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

    #[test]
    fn golden_messages_page_is_the_dialect_and_the_core() {
        super::super::check_page("MESSAGES.md", &page());
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
