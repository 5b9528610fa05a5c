//! Faults that come in sizes: a family each, what is told wrongly and what is ordered among them.

use haltere::simulated::campaign::entry::{Entry, Reaction, Reaction::Exists};

use super::LATE;

const OLD_RANGING: Reaction = Exists("a tag clock that runs back is not fused; blind descent");
const SCALE: Reaction = Exists("scale judged apart from thrust; blind descent");
const DISARMED_ONCE: Reaction = Exists("setpoints go on until the board has said it twice");
const TWO_BOARDS: Reaction = Exists("bound to one board while it speaks");
const TWO_PACKS: Reaction = Exists("one pack is chosen and stays");
const ORDERED: Reaction = Exists("refused in flight");
const WRONG_ROOM: Reaction = Exists("UWB held against the lean; blind descent");
const FENCE: Reaction = Exists("round it, or held at the border and landed");
const OUTSIDE: Reaction = Exists("refused, or held inside");
const LIES: Reaction = Exists("thrust is cut where it lies");
const STOOD_STILL: Reaction =
    Exists("nothing above hover until position and height are heard anew");

/// Every member of every family.
pub(super) fn all() -> Vec<Entry> {
    let families: [fn(&mut Vec<Entry>); 12] = [
        replays,
        old_by_the_line,
        scales,
        boards,
        packs,
        late_both_ways,
        ordered_failures,
        surveys,
        headings,
        fences,
        pauses,
        gear,
    ];
    let mut list = Vec::new();
    families.iter().for_each(|family| family(&mut list));
    list
}

fn entry(name: String, group: &'static str, text: String, reaction: Reaction) -> Entry {
    Entry { name, group, text, reaction }
}

/// One `[[fault]]`.
fn fault(fields: &str) -> String {
    format!("[[fault]]\n{fields}\n")
}

fn replays(list: &mut Vec<Entry>) {
    for window_s in [1.0, 3.0, 8.0] {
        for (times_go_on, words) in [(false, "again"), (true, "again, times go on")] {
            list.push(entry(
                format!("ranging of the last {window_s:.0} s {words}"),
                "replayed ranging",
                fault(&format!(
                    "part = 'tag-replay'\nwindow_s = {window_s:?}\ntimes_go_on = {times_go_on}"
                )),
                OLD_RANGING,
            ));
        }
    }
}

/// Older than any delay of a line that is in order.
fn old_by_the_line(list: &mut Vec<Entry>) {
    for late_s in [1.0, 3.0] {
        let noise = format!("part = 'line'\nline = 'from-tag'\nlate = 1.0\nlate_s = {late_s:?}");
        let name = format!("tag to companion: all {late_s:.0} s late");
        list.push(entry(name, "replayed ranging", fault(&noise), OLD_RANGING));
    }
}

fn scales(list: &mut Vec<Entry>) {
    let all = [1.5, 2.0, 3.0, 4.0].map(|k| ("", [k; 3], k));
    let z = [1.5, 2.0, 4.0].map(|k| (" on z", [1.0, 1.0, k], k));
    let level = [
        (" on x", [2.0, 1.0, 1.0], 2.0),
        (" on x", [4.0, 1.0, 1.0], 4.0),
        (" on y", [1.0, 3.0, 1.0], 3.0),
    ];
    for (axis, scale, times) in all.into_iter().chain(z).chain(level) {
        list.push(entry(
            format!("accelerometer reads {times} times{axis}"),
            "accelerometer scale",
            fault(&format!("part = 'accelerometer-scale'\nscale = {scale:?}")),
            SCALE,
        ));
    }
}

fn boards(list: &mut Vec<Entry>) {
    list.push(entry(
        "one heartbeat says disarmed".to_owned(),
        "false heartbeat",
        fault("part = 'false-heartbeat'"),
        DISARMED_ONCE,
    ));
    for (voice, words) in [("heartbeat", "its heartbeat"), ("everything", "everything")] {
        list.push(entry(
            format!("second board on the line: {words}"),
            "second board",
            fault(&format!("part = 'second-board'\nvoice = '{voice}'")),
            TWO_BOARDS,
        ));
    }
}

fn packs(list: &mut Vec<Entry>) {
    let second = |pack_v: f64| fault(&format!("part = 'second-pack'\npack_v = {pack_v:?}"));
    for pack_v in [5.1, 8.4] {
        let name = format!("second pack of {pack_v} V");
        list.push(entry(name, "second pack", second(pack_v), TWO_PACKS));
    }
    let sag = fault("part = 'battery'\ndrop_v = 1.9");
    let hidden = "second pack of 8.4 V hides a sag by 1.9 V".to_owned();
    list.push(entry(hidden, "second pack", sag + &second(8.4), TWO_PACKS));
}

fn late_both_ways(list: &mut Vec<Entry>) {
    for late_ms in [100, 200, 300, 400] {
        let late_s = f64::from(late_ms) * 1e-3;
        let way = |line: &str| {
            fault(&format!("part = 'line'\nline = '{line}'\nlate = 1.0\nlate_s = {late_s:?}"))
        };
        list.push(entry(
            format!("board link: all {late_ms} ms late both ways"),
            "late link",
            way("from-board") + &way("to-board"),
            LATE,
        ));
    }
}

fn ordered_failures(list: &mut Vec<Entry>) {
    for (unit, state, words) in [
        ("motor", "off", "motors off"),
        ("servo", "off", "servos off"),
        ("battery", "off", "battery off"),
        ("position", "off", "positioning off"),
        ("accelerometer", "garbage", "accelerometer garbage"),
        ("gyroscope", "stuck", "gyroscope stuck"),
        ("link", "intermittent", "link intermittent"),
    ] {
        list.push(entry(
            format!("a station orders: {words}"),
            "ordered failure",
            fault(&format!("part = 'inject-failure'\nunit = '{unit}'\nstate = '{state}'")),
            ORDERED,
        ));
    }
}

fn surveys(list: &mut Vec<Entry>) {
    for (words, told) in [
        ("north and south exchanged", "mirror = 'north'"),
        ("east and west exchanged", "mirror = 'east'"),
        ("x and y exchanged", "mirror = 'diagonal'"),
        ("floor and ceiling exchanged", "mirror = 'height'"),
        ("turned by 45°", "turn_deg = 45.0"),
        ("turned by 90°", "turn_deg = 90.0"),
        ("turned by 180°", "turn_deg = 180.0"),
        ("scaled by 0.8", "scale = 0.8"),
        ("scaled by 1.25", "scale = 1.25"),
        ("in feet", "scale = 3.2808"),
        ("two anchors exchanged", "swapped = [0, 7]"),
    ] {
        let text = format!("[told]\n{told}\n");
        list.push(entry(format!("survey: {words}"), "survey", text, WRONG_ROOM));
    }
}

fn headings(list: &mut Vec<Entry>) {
    for angle_deg in [45, 90, -90, 135, 180] {
        let text = format!("[told]\nheading_deg = {angle_deg}.0\n");
        list.push(entry(format!("heading told {angle_deg}° off"), "heading", text, WRONG_ROOM));
    }
    for angle_deg in [45, 90, -90, 180] {
        list.push(entry(
            format!("board's heading jumps by {angle_deg}°"),
            "heading",
            fault(&format!("part = 'heading'\nangle_deg = {angle_deg}.0")),
            WRONG_ROOM,
        ));
    }
}

fn fences(list: &mut Vec<Entry>) {
    for way in ["goto", "return", "mission", "offboard"] {
        for shape in ["circle", "square"] {
            list.push(entry(
                format!("fence across the way: {way}, {shape}"),
                "fence",
                fault(&format!("part = 'fence'\nway = '{way}'\nshape = '{shape}'")),
                FENCE,
            ));
        }
    }
    for way in ["goto", "offboard"] {
        list.push(entry(
            format!("a place outside is asked for: {way}"),
            "outside",
            fault(&format!("part = 'outside'\nway = '{way}'")),
            OUTSIDE,
        ));
    }
    list.push(entry(
        "home where the fence forbids it".to_owned(),
        "fence",
        fault("part = 'home'"),
        FENCE,
    ));
}

fn pauses(list: &mut Vec<Entry>) {
    for length_s in [0.3, 0.6, 1.0, 2.0, 2.5, 3.0, 5.0, 10.0] {
        list.push(entry(
            format!("companion stands still for {length_s} s"),
            "pause",
            fault(&format!("part = 'pause'\nlength_s = {length_s:?}")),
            STOOD_STILL,
        ));
    }
}

fn gear(list: &mut Vec<Entry>) {
    let name = "a leg of the gear breaks".to_owned();
    list.push(entry(name, "gear", fault("part = 'gear'"), LIES));
}
