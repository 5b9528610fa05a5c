//! Rows as one Parquet table: what was drawn and what came of it, a column each.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context, Result};
use haltere_log::export::{Column, Table, Values, parquet};
use serde_json::Value;

use super::row::Row;
use super::store::{Identity, write_whole};

/// `DIR/results.parquet`.
pub fn write(path: &Path, identity: &Identity, rows: &[&Row]) -> Result<()> {
    let about = [
        ("haltere.campaign", identity.name.clone()),
        ("haltere.campaign_digest", identity.digest.clone()),
        ("haltere.flights", identity.flights.to_string()),
        ("haltere.shard", format!("{}/{}", identity.shard[0], identity.shard[1])),
        ("haltere.program_version", identity.program.version.clone()),
        ("haltere.git_commit", identity.program.commit.clone()),
        ("haltere.source", identity.program.source.clone()),
    ]
    .map(|(key, value)| (key.to_owned(), value));
    let mut bytes = Vec::new();
    parquet::write(&table(rows), &about, &mut bytes).context("Parquet")?;
    write_whole(path, &bytes)
}

fn table(rows: &[&Row]) -> Table {
    let mut columns = vec![whole("flight", rows, |r| r.index), whole("seed", rows, |r| r.seed)];
    let keys: BTreeSet<&String> = rows.iter().flat_map(|r| r.drawn.keys()).collect();
    columns.extend(keys.into_iter().map(|key| drawn(key, rows)));
    columns.extend([
        text("outcome", rows, |r| r.outcome.name().to_owned()),
        text("why", rows, |r| r.why.clone()),
        flag("left_volume", rows, Row::left),
        flag("crashed", rows, Row::crashed),
        flag("left_floor_again", rows, Row::left_floor_again),
        real("left_s", rows, |r| r.left_s),
        real("left_floor_again_s", rows, |r| r.again_s),
        real("crashed_s", rows, |r| r.crashed_s),
        real("outside_m", rows, |r| Some(r.outside_m)),
        real("fault_s", rows, |r| r.fault_s),
        text("fault_mode", rows, |r| r.fault_mode.clone()),
        real("reacted_after_s", rows, |r| r.reacted_after_s),
        whole("items", rows, |r| r.items),
        whole("items_flown", rows, |r| r.items_flown),
        real("flown_s", rows, |r| Some(r.flown_s)),
        real("airborne_s", rows, |r| Some(r.airborne_s)),
        real("estimate_error_mean_m", rows, |r| r.estimate_mean_m),
        real("estimate_error_worst_m", rows, |r| r.estimate_worst_m),
        real("tracking_error_mean_m", rows, |r| r.tracking_mean_m),
        real("tracking_error_worst_m", rows, |r| r.tracking_worst_m),
        real("tilt_worst_deg", rows, |r| Some(r.tilt_worst_deg)),
        real("contact_mps", rows, |r| Some(r.contact_mps)),
        whole("contacts", rows, |r| r.contacts),
        real("lowest_supply_v", rows, |r| Some(r.lowest_supply_v)),
        text("modes", rows, |r| r.modes.clone()),
        whole("drops", rows, |r| r.drops.values().sum()),
        text("drops_by_reason", rows, |r| {
            r.drops.iter().map(|(k, n)| format!("{k}={n}")).collect::<Vec<_>>().join(" ")
        }),
        text("said", rows, |r| r.said.join(" | ")),
    ]);
    Table { name: "flights".to_owned(), columns }
}

/// Numbers stay numbers where every flight has one.
fn drawn(key: &str, rows: &[&Row]) -> Column {
    let of = |r: &&Row| r.drawn.get(key).cloned().unwrap_or(Value::Null);
    let numbers = rows.iter().all(|r| matches!(of(r), Value::Number(_) | Value::Null));
    let values = if numbers {
        Values::Real(rows.iter().map(|r| of(r).as_f64()).collect())
    } else {
        Values::Text(rows.iter().map(|r| plain(&of(r))).collect())
    };
    Column { name: Cow::Owned(key.to_owned()), values }
}

/// A drawn value in words.
pub fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

fn column(name: &'static str, values: Values) -> Column {
    Column { name: Cow::Borrowed(name), values }
}

fn whole(name: &'static str, rows: &[&Row], pick: impl Fn(&Row) -> u64) -> Column {
    let of = |r: &&Row| i64::try_from(pick(r)).unwrap_or(i64::MAX);
    column(name, Values::Whole(rows.iter().map(of).collect()))
}

fn real(name: &'static str, rows: &[&Row], pick: impl Fn(&Row) -> Option<f64>) -> Column {
    let of = |r: &&Row| pick(r).filter(|x| x.is_finite());
    column(name, Values::Real(rows.iter().map(of).collect()))
}

fn flag(name: &'static str, rows: &[&Row], pick: impl Fn(&Row) -> bool) -> Column {
    column(name, Values::Flag(rows.iter().map(|r| pick(r)).collect()))
}

fn text(name: &'static str, rows: &[&Row], pick: impl Fn(&Row) -> String) -> Column {
    column(name, Values::Text(rows.iter().map(|r| pick(r)).collect()))
}
