//! Where the values of a flight come from: distributions over keys, and their edits of a TOML tree.

use anyhow::{Context, Result, bail};
use haltere_core::checks::Problems;
use haltere_model::random::Stream;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

/// Where the value of a key comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Draw {
    /// Evenly between two ends.
    Uniform([f64; 2]),
    /// Normal, drawn again until it lies between `low` and `high`.
    Normal(Normal),
    /// Any of these, each as likely as the others.
    Choice(Vec<Value>),
    /// Every one of these, combined with every value of all other grids.
    Grid(Vec<Value>),
}

/// A truncated normal distribution.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Normal {
    /// Middle of the untruncated one.
    pub mean: f64,
    /// Its standard deviation.
    pub std: f64,
    /// Least value.
    pub low: f64,
    /// Greatest value.
    pub high: f64,
}

/// Tries before a truncated normal gives up and takes the nearer end; with a tenth of the mass inside
/// it is never reached.
const MOST_TRIES: usize = 1000;
/// Drawn numbers are rounded to this, so that what is printed is what was flown.
const GRAIN: f64 = 1e6;
/// Longest list that a key may extend.
const MOST_ELEMENTS: usize = 256;

impl Draw {
    /// Says what is wrong with it.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        match self {
            Draw::Uniform([low, high]) => {
                if !(low.is_finite() && high.is_finite() && low < high) {
                    problems.say(format!(
                        "{key}.uniform = [{low}, {high}]: two finite numbers, the first the smaller one"
                    ));
                }
            }
            Draw::Normal(n) => {
                let finite = [n.mean, n.std, n.low, n.high].iter().all(|v| v.is_finite());
                if !finite || n.std <= 0.0 || n.low >= n.high {
                    problems.say(format!(
                        "{key}.normal: std above 0, low below high, all finite; found std = {}, low = {}, \
                         high = {}",
                        n.std, n.low, n.high
                    ));
                } else if n.mean < n.low - 3.0 * n.std || n.mean > n.high + 3.0 * n.std {
                    problems.say(format!(
                        "{key}.normal: nothing of it lies between {} and {}: its mean {} is more than \
                         three std away",
                        n.low, n.high, n.mean
                    ));
                }
            }
            Draw::Choice(values) | Draw::Grid(values) => {
                if values.is_empty() {
                    problems.say(format!("{key}: an empty list has nothing to choose from"));
                }
            }
        }
    }

    /// Values of a grid; one otherwise.
    pub fn grid_size(&self) -> u64 {
        match self {
            Draw::Grid(values) => values.len() as u64,
            _ => 1,
        }
    }

    /// A value. `place`: which one of a grid.
    pub fn value(&self, rng: &mut Stream, place: u64) -> Option<Value> {
        match self {
            Draw::Uniform([low, high]) => Some(Value::Float(grain(rng.between(*low, *high)))),
            Draw::Normal(n) => {
                let draws = (0..MOST_TRIES).map(|_| n.mean + n.std * rng.normal());
                let inside = { draws }.find(|v| (n.low..=n.high).contains(v));
                let value = inside.unwrap_or_else(|| n.mean.clamp(n.low, n.high));
                Some(Value::Float(grain(value).clamp(n.low, n.high)))
            }
            Draw::Choice(values) => {
                values.get((rng.uniform() * values.len() as f64) as usize).cloned()
            }
            Draw::Grid(values) => values.get(usize::try_from(place).ok()?).cloned(),
        }
    }
}

/// Rounded, so that it survives being printed and read.
pub fn grain(value: f64) -> f64 {
    (value * GRAIN).round() / GRAIN
}

/// Sets a key such as `effects.on.A5.north` or `fault[0].at_s`; tables on the way are made, an element
/// one behind the end of a list is appended.
pub fn set(root: &mut Table, key: &str, value: Value) -> Result<()> {
    let steps = steps(key)?;
    let (last, way) = steps.split_last().with_context(|| format!("`{key}`: an empty key"))?;
    // The root is moved into a value, so that tables and lists are walked alike.
    let mut tree = Value::Table(std::mem::take(root));
    let result = walk(&mut tree, way, last, value);
    if let Value::Table(table) = tree {
        *root = table;
    }
    result.with_context(|| format!("`{key}`"))
}

fn walk(tree: &mut Value, way: &[Step], last: &Step, value: Value) -> Result<()> {
    let mut at = tree;
    for (i, step) in way.iter().enumerate() {
        let next = way.get(i + 1).unwrap_or(last);
        at = slot(at, step, || match next {
            Step::Name(_) => Value::Table(Table::new()),
            Step::Place(_) => Value::Array(Vec::new()),
        })?;
    }
    *slot(at, last, || Value::Boolean(false))? = value;
    Ok(())
}

#[derive(Debug, PartialEq)]
enum Step {
    Name(String),
    Place(usize),
}

fn steps(key: &str) -> Result<Vec<Step>> {
    let mut steps = Vec::new();
    for part in key.split('.') {
        let (name, places) = part.split_once('[').map_or((part, None), |(n, p)| (n, Some(p)));
        if name.is_empty() {
            bail!(
                "`{key}`: write names with dots between them and [n] for places, as in fault[0].at_s"
            );
        }
        steps.push(Step::Name(name.to_owned()));
        for place in places.into_iter().flat_map(|p| p.split('[')) {
            let number = place.strip_suffix(']').and_then(|n| n.parse().ok());
            let number = number.filter(|n| *n < MOST_ELEMENTS);
            steps.push(Step::Place(number.with_context(|| {
                format!("`{key}`: [{place} is no place, allowed [0] to [{}]", MOST_ELEMENTS - 1)
            })?));
        }
    }
    Ok(steps)
}

fn slot<'a>(at: &'a mut Value, step: &Step, make: impl Fn() -> Value) -> Result<&'a mut Value> {
    match (at, step) {
        (Value::Table(table), Step::Name(name)) => {
            Ok(table.entry(name.clone()).or_insert_with(make))
        }
        (Value::Array(list), Step::Place(place)) => {
            if *place == list.len() {
                list.push(make());
            }
            let len = list.len();
            list.get_mut(*place).with_context(|| format!("[{place}]: the list has {len} elements"))
        }
        (_, Step::Name(name)) => bail!("{name}: what holds it is no table"),
        (_, Step::Place(place)) => bail!("[{place}]: what holds it is no list"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edited(text: &str, key: &str, value: Value) -> Result<Table> {
        let mut table: Table = toml::from_str(text).unwrap();
        set(&mut table, key, value)?;
        Ok(table)
    }

    #[test]
    fn prop_keys_reach_any_place_of_the_tree() {
        let text = "[room]\nnorth_m = [0.0, 10.0]\n[[fault]]\nat_s = 1.0\n";
        let is = |key: &str, wanted: &str| {
            let table = edited(text, key, Value::Float(2.5)).unwrap();
            let found = toml::to_string(&table).unwrap();
            assert!(found.contains(wanted), "{key}: {found}");
        };
        is("room.north_m[1]", "north_m = [0.0, 2.5]");
        is("effects.on.A5.north", "[effects.on.A5]\nnorth = 2.5");
        is("fault[0].at_s", "at_s = 2.5");
        is("fault[1].at_s", "[[fault]]\nat_s = 2.5");
        for wrong in
            ["room.north_m[9]", "room.north_m.x", "", "a..b", "fault[x].at_s", "fault[0", "seed[0]"]
        {
            assert!(
                edited(&format!("seed = 1\n{text}"), wrong, Value::Float(1.0)).is_err(),
                "{wrong}"
            );
        }
    }

    #[test]
    fn prop_draws_stay_inside_and_repeat() {
        let normal = Draw::Normal(Normal { mean: 1.0, std: 0.5, low: 0.8, high: 1.1 });
        for draw in [Draw::Uniform([0.8, 1.1]), normal] {
            let all = |seed| {
                let mut rng = Stream::new(seed, "x");
                (0..2000).filter_map(|_| draw.value(&mut rng, 0)?.as_float()).collect::<Vec<_>>()
            };
            let values = all(1);
            assert!(values.len() == 2000 && values.iter().all(|v| (0.8..=1.1).contains(v)));
            assert_eq!(values, all(1));
            assert_ne!(values, all(2));
        }
    }

    #[test]
    fn prop_senseless_distributions_are_refused() {
        for text in [
            "uniform = [2.0, 1.0]",
            "uniform = [nan, 1.0]",
            "normal = { mean = 0.0, std = 0.0, low = -1.0, high = 1.0 }",
            "normal = { mean = 9.0, std = 0.1, low = -1.0, high = 1.0 }",
            "choice = []",
            "grid = []",
        ] {
            let draw: Draw = toml::from_str(text).unwrap();
            let mut problems = Problems::new();
            draw.check("vary.x", &mut problems);
            assert_eq!(problems.lines().len(), 1, "{text}");
        }
        assert!(toml::from_str::<Draw>("poisson = 3.0").is_err());
    }
}
