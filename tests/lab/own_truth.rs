//! The filter on flights of one's own beside a truth, as a user has it: simulated flights, and their truth as a motion
//! capture system would export it, on a clock of its own.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use super::lab;
use super::support::{Ended, sim};

const LIMIT: Duration = Duration::from_secs(300);
/// What the other clock reads less at the simulator's zero, s, and its rate.
const BEHIND_S: f64 = 3.7;
const RATE: f64 = 0.999;

/// One row of the simulator's truth: host time, s; simulated time, s; position, north, east, down, m.
#[derive(Debug, Clone, Copy)]
struct Row {
    host_s: f64,
    t_s: f64,
    pos_E_m: [f64; 3],
}

fn rows(path: &Path) -> Vec<Row> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let at = |name: &str| names.iter().position(|n| *n == name).unwrap_or_else(|| panic!("{name}"));
    let columns = ["host_time_us", "t_s", "pos_E_x_m", "pos_E_y_m", "pos_E_z_m"].map(at);
    lines
        .map(|line| {
            let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            let [host_us, t_s, north, east, down] = columns.map(|column| cells[column]);
            Row { host_s: 1e-6 * host_us, t_s, pos_E_m: [north, east, down] }
        })
        .collect()
}

/// A table with x to the east, y to the north, z up, as surveys have them.
fn write(path: &Path, head: &str, rows: &[Row], row: impl Fn(&Row) -> (f64, f64)) {
    let mut text = format!("{head}\n");
    for one in rows {
        let (time, unit) = row(one);
        let [x, y, z] = [one.pos_E_m[1], one.pos_E_m[0], -one.pos_E_m[2]].map(|p| p * unit);
        writeln!(text, "{time},{x},{y},{z}").unwrap();
    }
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

fn replayed(folder: &Path, more: &[&str]) -> Ended {
    lab(&[&["flights"], more].concat(), folder, LIMIT)
}

/// The rows of the page as JSON.
fn page(folder: &Path, more: &[&str], code: i32) -> Vec<Value> {
    let ended = replayed(folder, &[more, &["--json"]].concat());
    assert_eq!(ended.code, Some(code), "{}", ended.text);
    let (begin, end) = (ended.text.find("[\n").unwrap(), ended.text.rfind(']').unwrap());
    serde_json::from_str(&ended.text[begin..=end]).unwrap_or_else(|e| panic!("{e}: {}", ended.text))
}

fn number(row: &Value, pointer: &str) -> f64 {
    row.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("{pointer}: {row:#}"))
}

#[test]
fn prop_the_filter_is_held_against_a_truth_on_any_clock_and_in_any_unit() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    let flown = sim(&["fly", "hexagon", "square", "--out", "logs"], folder, LIMIT);
    assert_eq!(flown.code, Some(0), "{}", flown.text);

    // By the companion's own clock: the errors are those by which the simulator knows the estimate to be off.
    let known = page(folder, &["logs", "--truth"], 0);
    assert_eq!(known.len(), 2, "{known:#?}");
    let rmse_m = number(&known[1], "/rmse_3d_airborne_m");
    assert!((0.01..0.12).contains(&rmse_m) && known[1]["diverged"] == false, "{:#}", known[1]);
    assert!(known[1]["truth"]["clock"].is_null(), "{:#}", known[1]);

    let truth = rows(&folder.join("logs/square-1.truth.csv"));
    let start_s = truth[0].host_s - truth[0].t_s;
    let other = |row: &Row| (row.t_s - BEHIND_S) * RATE;
    let offset_of = |truth: &str| {
        let page = page(folder, &["logs/square-1.mcap", "--truth", truth], 0);
        let (rmse, offset) =
            (number(&page[0], "/rmse_3d_airborne_m"), number(&page[0], "/truth/clock/offset_s"));
        let std = number(&page[0], "/truth/clock/std_offset_s");
        let middle = number(&page[0], "/truth/clock/middle_s");
        assert!((rmse - rmse_m).abs() < 0.005 && std < 0.03, "{truth}: {:#}", page[0]);
        (offset, std, middle)
    };
    // The same clock, its name withheld: what is found there is the lag of the estimate alone.
    write(&folder.join("same/square-1.csv"), "time_s,x,y,z", &truth, |row| (row.host_s, 1.0));
    let (same_s, ..) = offset_of("same");
    write(&folder.join("mm/square-1.csv"), "t_ms,X (mm),Y (mm),Z (mm)", &truth, |row| {
        (1e3 * other(row), 1e3)
    });
    let gap: Vec<Row> =
        truth.iter().filter(|row| !(18.0..22.0).contains(&row.t_s)).copied().collect();
    write(&folder.join("gap/square-1.csv"), "t,x_cm,y_cm,z_cm", &gap, |row| (other(row), 1e2));
    for place in ["mm", "gap/square-1.csv"] {
        let (offset_s, std_s, middle_s) = offset_of(place);
        // At the middle of the flight; the log begins where the simulator does, within a second or two.
        let true_s = same_s + start_s + middle_s - (middle_s - BEHIND_S) * RATE;
        assert!((offset_s - true_s).abs() < 3.0 * std_s, "{place}: {offset_s} {true_s} {std_s}");
    }

    // A folder in which one flight has no truth: the other one has its row, and the exit code tells.
    let some = page(folder, &["logs", "--truth", "mm"], 4);
    assert_eq!(some.len(), 1, "{some:#?}");
    // The nine states alone, told over what flew, are another filter on the same flight.
    let plain = ["logs/square-1.mcap", "--truth", "--set", "control.learned_uwb_errors=false"];
    let plain_m = number(&page(folder, &plain, 0)[0], "/rmse_3d_m");
    assert!(plain_m > 1.2 * number(&known[1], "/rmse_3d_m"), "{plain_m}");

    // What cannot be held against one another is refused by name.
    write(&folder.join("metres/square-1.csv"), "t,x,y,z", &truth, |row| (row.t_s, 1e3));
    for (more, says) in [
        (&["logs/square-1.mcap", "--truth", "metres"][..], "in millimetres? name its columns x_mm"),
        (&["logs/hexagon-1.mcap", "--truth", "gap/square-1.csv"], "is the truth of this flight?"),
        (&["logs", "--truth", "gap/square-1.csv"], "name the folder of their truths"),
        (&["logs", "--truth", "nowhere"], "--truth nowhere: no folder"),
        (&["logs", "--truth", "--set", "estimator.fuse_reference=true"], "fuse_reference=false"),
        (&["logs", "--truth", "--set", "estimator.unknown=1"], "unknown"),
        (&["same", "--truth"], "no log (*.mcap)"),
    ] {
        replayed(folder, more).refused(&[says]);
    }
}
