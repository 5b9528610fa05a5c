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
             By who may send them; who is not among `ground.commanders` may look. What steers is not passed on to the \
             board while we steer it; of COMMAND_INT and COMMAND_LONG the next list says it.\n\n";
    grouped(
        &mut page,
        SAID.iter().map(|said| {
            let steers = if said.steers { ", steers" } else { "" };
            (format!("{}{steers}", who(&said.permit)), format!("{} ({})", said.name, said.id))
        }),
    );
    page += "\n## Commands of stations\n\n\
             All others are unsupported, for commanders alone, and steer; *unsupported* are some of these too.\n\n";
    grouped(
        &mut page,
        ORDERS.iter().map(|order| {
            let steers = match order.steers {
                Steers::No => "",
                Steers::Yes => ", steers",
                Steers::Rate => ", steers what we need ourselves",
            };
            let shadow = if order.refused_in_shadow { ", refused in a shadow" } else { "" };
            let done = if order.is_done() { "" } else { ", unsupported" };
            let of = format!("{}{steers}{shadow}{done}", who(&order.permit));
            (of, format!("{:?}", order.command))
        }),
    );
    page += "\n## Shown to stations\n\n\
             By rate where nobody asks for another; 0 Hz goes to who asks for it alone. In brackets id and group.\n\n";
    let mut streams: Vec<_> = STREAMS.iter().collect();
    streams.sort_by_key(|stream| {
        (stream.on_request, std::cmp::Reverse((stream.rate_hz * 1e3) as u64), stream.id)
    });
    grouped(
        &mut page,
        streams.into_iter().map(|stream| {
            let name = name_of_id(stream.id).unwrap_or_default();
            let rate = match stream.on_request {
                true => "on request".to_owned(),
                false => format!("{} Hz", stream.rate_hz),
            };
            let group = stream.group.map_or(String::new(), |group| format!("{group:?}"));
            let group = group.trim_start_matches("MAV_DATA_STREAM_");
            let comma = if group.is_empty() { "" } else { ", " };
            (rate, format!("{name} ({}{comma}{group})", stream.id))
        }),
    );
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

/// A line for each kind, in the order in which they come, with all that are of it.
fn grouped(page: &mut String, rows: impl Iterator<Item = (String, String)>) {
    let mut groups: Vec<(String, Vec<String>)> = Vec::new();
    for (of, row) in rows {
        match groups.iter_mut().find(|(known, _)| *known == of) {
            Some((_, all)) => all.push(row),
            None => groups.push((of, vec![row])),
        }
    }
    for (of, all) in groups {
        let _ = writeln!(page, "* **{of}**: {}.", all.join(", "));
    }
}

fn own_messages(xml: &str) -> String {
    let mut page = String::new();
    for message in xml.split("<message ").skip(1) {
        let message = message.split("</message>").next().unwrap_or_default();
        let head = message.split('>').next().unwrap_or_default();
        let described = between(message, "<description>", "</description>").unwrap_or_default();
        let (name, id) = (attribute(head, "name"), attribute(head, "id"));
        let _ = write!(page, "\n### {name} ({id})\n\n{}\n\n", plain(described));
        for field in message.split("<field ").skip(1) {
            let (head, rest) = field.split_once('>').unwrap_or((field, ""));
            let text = rest.split("</field>").next().unwrap_or_default();
            let (name, kind) = (attribute(head, "name"), attribute(head, "type"));
            let unit = attribute(head, "units");
            let comma = if unit.is_empty() { "" } else { ", " };
            let _ = writeln!(page, "* `{name}` ({kind}{comma}{unit}): {}", plain(text));
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
        assert_eq!(page.matches("\n* ").count(), XML.matches("<field ").count());
        assert!(
            page.contains("* `distance_diff` (float, m): Distance to anchor_b minus"),
            "{page}"
        );
    }
}
