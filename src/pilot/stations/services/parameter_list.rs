//! The entries of the parameter table: what the rows of the keys tell, and what clients of PX4 ask for beside that.

use haltere_core::keys::{Key, Kind as Holds, Range, Row, Section, Told, When};

use super::parameter_table::{Kind, Parameter};
use crate::config::PilotConfig;

/// What every client sees, in the order of the indices.
pub fn common() -> Vec<Parameter> {
    indexed().into_iter().map(|(_, parameter)| parameter).collect()
}

fn indexed() -> Vec<(usize, Parameter)> {
    let mut found: Vec<(usize, Parameter)> = Vec::new();
    // Of a section whose parameters are told where it is named, those of the keys to come.
    let mut apart: &[Told] = &[];
    PilotConfig::rows("", &mut |at, row| match row {
        Row::Begins(_, told) => apart = told,
        Row::Key(key) => {
            let own = apart.split_off(..apart.len().min(1)).unwrap_or_default();
            let told = if own.is_empty() { key.parameters } else { own };
            found.extend(told.iter().enumerate().map(|(part, one)| {
                let ending = if told.len() > 1 { format!("[{part}]") } else { String::new() };
                (one.index, of_key(format!("{at}.{}{ending}", key.name), part, key, one))
            }));
        }
    });
    found.sort_by_key(|(index, _)| *index);
    found
}

fn of_key(name: String, part: usize, key: &Key, told: &Told) -> Parameter {
    let range =
        key.range.unwrap_or(Range { low: f64::MIN, high: f64::MAX, unit: "", checked: true });
    let Range { mut low, mut high, .. } = range;
    let kind = match (key.kind)() {
        Holds::Number | Holds::Other => Kind::Number,
        Holds::Whole => Kind::Whole,
        Holds::Choice(all) => {
            let first = all.iter().position(|(n, _)| f64::from(*n) >= low).unwrap_or(0);
            let ends = [&all[first], &all[all.len() - 1]].map(|(n, _)| f64::from(*n));
            [low, high] = ends;
            Kind::Choice(&all[first..])
        }
    };
    let doc = match told.text {
        "" => {
            let summary = key.text.iter().take_while(|line| !line.is_empty());
            summary.map(|line| line.trim()).collect::<Vec<_>>().join(" ")
        }
        text => text.to_owned(),
    };
    let unit = plain_unit(range.unit);
    Parameter { name: told.name, key: name, part, kind, when: told.when, low, high, unit, doc }
}

/// A unit in letters that every station shows, and without words.
fn plain_unit(unit: &str) -> String {
    let plain = [("²", "^2"), ("µ", "u"), ("√Hz", "sqrt(Hz)"), ("√s", "sqrt(s)"), ("sigma", "")]
        .into_iter()
        .fold(unit.to_owned(), |text, (from, to)| text.replace(from, to));
    match plain.split_once(" per ") {
        None => plain,
        Some((of, each)) if of == each => String::new(),
        Some((of, each)) => {
            let of = if of == "frac" { "1" } else { of };
            if each.contains('/') { format!("{of}/({each})") } else { format!("{of}/{each}") }
        }
    }
}

/// Two names that MAVSDK writes, and values that keep QGroundControl's set-up pages from calling parameters missing
/// (STATIONS.md, Which identity).
pub fn px4_only() -> Vec<Parameter> {
    let one = |name, kind, low, high, unit: &str, doc: &str| Parameter {
        name,
        key: String::new(),
        part: 0,
        kind,
        when: if matches!(kind, Kind::Fixed(_)) { When::Restart } else { When::AtOnce },
        low,
        high,
        unit: unit.to_owned(),
        doc: doc.to_owned(),
    };
    let alias = |name, of| {
        let doc = "Another name, for clients of PX4.";
        one(name, Kind::Alias(of), 0.0, 20.0, "m", doc)
    };
    let fixed = |name, doc| one(name, Kind::Fixed(1.0), 1.0, 1.0, "", doc);
    vec![
        alias("MIS_TAKEOFF_ALT", "FLT_TKO_HGT"),
        alias("RTL_RETURN_ALT", "FLT_RTN_HGT"),
        fixed("SYS_AUTOSTART", "Airframe number of PX4: it has none for flapping wings."),
        fixed("CAL_GYRO0_ID", "Tells clients of PX4 that the gyroscope needs no calibration."),
        fixed("CAL_ACC0_ID", "Tells clients of PX4 that the accelerometer needs no calibration."),
        fixed("CAL_MAG0_ID", "Tells clients of PX4 that no compass waits for calibration."),
        fixed("COM_RC_IN_MODE", "Tells clients of PX4 that a joystick is the only manual control."),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_indices_are_counted_without_a_gap() {
        for ((index, parameter), due) in indexed().iter().zip(0..) {
            assert_eq!(*index, due, "{}: {due} is due", parameter.name);
        }
    }
}
