//! The sample, the layers, and what bad files are told.

use super::*;

const SAMPLE: &str = include_str!("../../../config/haltere.toml");
const SAMPLE_ANCHORS: &str = include_str!("../../../config/anchors.toml");

#[test]
fn prop_the_sample_parses_to_the_defaults() {
    assert!(Config::from_toml("sample", SAMPLE).unwrap() == Config::default());
    parse_anchors("sample", SAMPLE_ANCHORS).unwrap();
}

fn lookup<'t>(table: &'t toml::Table, key: &str) -> Option<&'t toml::Value> {
    let mut parts = key.split('.');
    let first = table.get(parts.next()?)?;
    parts.try_fold(first, |value, part| value.get(part))
}

#[test]
fn prop_anchors_are_turned_once() {
    let enu = parse_anchors("a.toml", SAMPLE_ANCHORS).unwrap();
    let at = |id| enu.position_E_m(haltere_core::measure::AnchorId(id)).unwrap().to_array();
    // x east, y north, z up becomes north, east, down.
    assert_eq!(at(1), [0.0, 6.0, -2.8]);
    assert_eq!(at(3), [6.0, 0.0, -2.8]);
}

#[test]
fn prop_bad_anchor_files_are_told_why() {
    let check = |text: &str, says: &str| {
        let error = parse_anchors("anchors.toml", text).unwrap_err().to_string();
        assert!(error.contains(says), "{error}\n  should say: {says}");
        assert!(error.starts_with("anchors.toml: "), "{error}");
    };
    let with = |from: &str, to: &str| SAMPLE_ANCHORS.replacen(from, to, 1);
    check(
        &with("[0.0, 6.0, 2.8]", "[0.0, 6.0, 41.0]"),
        "anchors.toml: anchor 3: position_m.z = 41, allowed -2 to 40 m",
    );
    check(
        &with("[0.0, 6.0, 2.8]", "[0.0, 6000, 2.8]"),
        "anchor 3: position_m.y = 6000, allowed -100 to 100 m",
    );
    check(&with("\nframe = \"enu\"", "\nframe = \"ned\""), "write frame = \"enu\"");
    check(&with("\nframe = \"enu\"", "\n"), "missing key `frame`");
    check(
        &with("\nframe = \"enu\"", "\nframe = \"nwu\""),
        "unknown choice `nwu`, expected `enu` or `ned`",
    );
    check(
        &with("id = 3", "id = 300"),
        "anchor[3].id: found integer `300`, expected a whole number from 0 to 255",
    );
    check(&with("id = 3", "id = 2"), "anchor 2: listed twice");
    check(&with("[0.0, 6.0, 2.8]", "[0.0, 6.0]"), "anchor[3].position_m");
    check(&with("[0.0, 6.0, 2.8]", "[0.0, 6.0, nan]"), "anchor 3: position_m.z = NaN");
    check("frame = \"enu\"\n", "0 anchors, at least 5");
    check(&SAMPLE_ANCHORS.replace("0.2]", "2.8]"), "apart, at least");
    let flat: String = (0..6)
        .map(|i| format!("[[anchor]]\nid = {i}\nposition_m = [{}, {}, 2.0]\n", i % 3, i / 3))
        .collect();
    check(&format!("frame = \"enu\"\n{flat}"), "coplanar");
}

#[test]
fn prop_differences_name_what_is_not_the_default() {
    assert_eq!(Config::default().differences(), []);
    let text = "[flight]\nspool_s = 1.5\n[limits]\nheight_m = 2.5\n";
    let found = Config::from_toml("a.toml", text).unwrap().differences();
    let shown: Vec<_> =
        found.iter().map(|d| format!("{} {} {}", d.key, d.value, d.default)).collect();
    assert_eq!(shown, ["flight.spool_s 1.5 1.0", "limits.height_m 2.5 not set"]);
}

/// Three cells with the limits of two passed, and were flown to 2 V a cell.
#[test]
fn regress_limits_of_another_pack_are_refused() {
    let says = |cells: u8, low_v: f64, critical_v: f64| {
        let text = format!(
            "[control.voltage]\ncells = {cells}\nnominal_v = {:.1}\n[limits]\nbattery_low_v = {low_v:?}\n\
             battery_critical_v = {critical_v:?}\n",
            3.7 * f64::from(cells)
        );
        let mut problems = Problems::new();
        Config::from_toml("test", &text).unwrap().check_to_fly(&mut problems);
        problems.lines().join("; ")
    };
    for cells in 1..=6_u8 {
        for limits_of in 1..=cells {
            let [low_v, critical_v] = [3.2, 3.0].map(|cell_v| f64::from(limits_of) * cell_v);
            let said = says(cells, low_v, critical_v);
            let told = said.contains("V a cell with control.voltage.cells");
            assert_eq!(told, cells != limits_of, "{cells}, limits of {limits_of}: {said}");
        }
    }
}

#[test]
fn prop_a_log_is_read_with_the_keys_of_its_time() {
    let defaults = toml::Table::try_from(Config::default()).unwrap();
    for key in read::FORMER {
        let (section, name) = key.split_once('.').unwrap();
        assert!(lookup(&defaults, key).is_none(), "{key} is in force");
        let text = format!("[flight]\nspool_s = 1.5\n[{section}]\n{name} = 1\n");
        let recorded = Config::as_recorded("recorded configuration", &text).unwrap();
        assert_eq!(recorded.flight.spool_s, 1.5, "{key}");
        assert!(Config::from_toml("haltere.toml", &text).is_err(), "{key}");
    }
    let unknown = Config::as_recorded("recorded configuration", "[flight]\nhopp_m = 2.0\n");
    assert!(unknown.unwrap_err().to_string().contains("unknown key `hopp_m`"));
}
