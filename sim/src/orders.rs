//! Orders of a script: one JSON object a line on standard input, one answer a line on standard output.
//!
//! `{"fault": {"part": "anchor", "anchor": 3}}` breaks something now, in the words of a scenario's
//! `[[fault]]`; `{"truth": true}` asks what really is; `{"late": true}` how
//! late the simulator itself was; `{"run_s": 0.02}` lets simulated time pass where
//! the script keeps it. When standard input ends, so does the simulator: none outlives its script.

use std::io::{BufRead as _, Read as _, Write as _};
use std::sync::OnceLock;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::time::Duration;

use anyhow::{Context as _, Result, anyhow};
use haltere::report::truth::{HEADER, TruthRow};
use haltere_core::checks::Problems;
use haltere_model::{Fault, Plant};
use serde::Deserialize;
use serde_json::{Map, Value, json};

use haltere::simulated::faults::FaultAt;

/// Longest line, bytes.
const LINE_BYTES: u64 = 4096;
/// Orders, and answers, that may wait.
const WAITING: usize = 64;
/// Most simulated time in one order, s.
const MOST_RUN_S: f64 = 3600.0;

/// What a script can ask for.
#[derive(Debug, Clone, PartialEq)]
pub enum Order {
    /// Breaks or mends something.
    Fault(Fault),
    /// What really is?
    Truth,
    /// Time passes, µs.
    Run(u64),
    /// How late was the simulator itself?
    Late,
}

/// The form of a line.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
enum Line {
    Fault(Map<String, Value>),
    Truth(bool),
    Late(bool),
    RunS(f64),
}

/// Reads a line.
fn parse(line: &str) -> Result<Order> {
    Ok(match serde_json::from_str(line).context("an order is one JSON object a line")? {
        Line::Truth(true) => Order::Truth,
        Line::Late(true) => Order::Late,
        Line::Truth(false) => return Err(anyhow!("truth = false, allowed true")),
        Line::Late(false) => return Err(anyhow!("late = false, allowed true")),
        Line::RunS(s) if (0.0..=MOST_RUN_S).contains(&s) => Order::Run((s * 1e6).round() as u64),
        Line::RunS(s) => return Err(anyhow!("run_s = {s}, allowed 0 to {MOST_RUN_S} s")),
        Line::Fault(mut map) => {
            // The form of a scenario, where each failure has its time: here it is now.
            if map.insert("at_s".into(), json!(0.0)).is_some() {
                return Err(anyhow!("fault.at_s: an order is obeyed at once"));
            }
            if let Some(key) = ["phase", "for_s"].into_iter().find(|key| map.contains_key(*key)) {
                return Err(anyhow!(
                    "fault.{key}: an order is obeyed at once and holds until the next"
                ));
            }
            let at: FaultAt = serde_json::from_value(Value::Object(map)).context("fault")?;
            if at.for_s.is_some() || at.phase.is_some() {
                return Err(anyhow!(
                    "fault: an order has no for_s and no phase; mend it by another order"
                ));
            }
            let mut problems = Problems::new();
            let fault = at.to_fault("fault", &mut problems);
            match fault {
                Some(fault) if problems.is_empty() => Order::Fault(fault),
                _ => return Err(anyhow!("{problems}")),
            }
        }
    })
}

/// What came of looking for an order.
#[derive(Debug, PartialEq)]
pub enum Next {
    /// There is one.
    Order(Order),
    /// There is none now.
    None,
    /// There will be none: the script is gone.
    Ended,
}

/// Standard input, read by a thread of its own.
#[derive(Debug)]
pub struct Orders(Receiver<Result<Order>>);

impl Orders {
    /// Reads from now on.
    pub fn listen() -> Result<Self> {
        let (queue, orders) = sync_channel(WAITING);
        std::thread::Builder::new()
            .name("orders".into())
            .spawn(move || {
                let mut input = std::io::stdin().lock();
                loop {
                    let mut line = String::new();
                    match input.by_ref().take(LINE_BYTES).read_line(&mut line) {
                        Ok(0) => return,
                        Ok(_) if line.trim().is_empty() => continue,
                        Ok(_) if queue.send(parse(line.trim())).is_ok() => {}
                        // Bytes that are no text, or nobody to obey.
                        Ok(_) | Err(_) => return,
                    }
                }
            })
            .context("no thread for --orders")?;
        Ok(Self(orders))
    }

    /// The next order, if there is one. What is no order is answered here.
    pub fn next(&self) -> Next {
        loop {
            match self.0.try_recv() {
                Ok(Ok(order)) => return Next::Order(order),
                Ok(Err(error)) => refuse(&error),
                Err(TryRecvError::Empty) => return Next::None,
                Err(TryRecvError::Disconnected) => return Next::Ended,
            }
        }
    }

    /// The same; waits a while for one.
    pub fn wait(&self, patience: Duration) -> Next {
        match self.0.recv_timeout(patience) {
            Ok(Ok(order)) => Next::Order(order),
            Ok(Err(error)) => {
                refuse(&error);
                Next::None
            }
            Err(RecvTimeoutError::Timeout) => Next::None,
            Err(RecvTimeoutError::Disconnected) => Next::Ended,
        }
    }
}

/// Where answers go that no loop may wait for.
static QUEUE: OnceLock<SyncSender<String>> = OnceLock::new();

/// From now on answers are written by a thread: time passes, whether the script reads or not. What finds no
/// room is not answered.
pub fn answer_without_waiting() -> Result<()> {
    let (queue, lines) = sync_channel::<String>(WAITING);
    let write = move || lines.into_iter().for_each(|line| say(&line));
    let thread = std::thread::Builder::new().name("answers".into()).spawn(write);
    thread.context("no thread for --orders")?;
    let _ = QUEUE.set(queue);
    Ok(())
}

/// Answers an order.
pub fn answer(answer: &Value) {
    match QUEUE.get() {
        None => say(&answer.to_string()),
        Some(queue) => {
            if queue.try_send(answer.to_string()).is_err() {
                tracing::warn!("the script does not read: an order is not answered");
            }
        }
    }
}

fn say(line: &str) {
    let mut out = std::io::stdout().lock();
    // A script that does not read any more is about to end.
    let _ = writeln!(out, "{line}").and_then(|()| out.flush());
}

/// Answers that it cannot be obeyed.
pub fn refuse(error: &anyhow::Error) {
    answer(&json!({ "error": format!("{error:#}") }));
}

/// Breaks or mends something, and says whether that was possible.
pub fn inject(plant: &mut Plant, fault: Fault) {
    match plant.inject(fault) {
        Ok(()) => answer(&json!({ "ok": true })),
        Err(why) => refuse(&anyhow!("fault refused: {why}")),
    }
}

/// Tells the truth, by the columns of a truth file.
pub fn tell_truth(row: &TruthRow) {
    let mut line = Vec::new();
    let _ = row.write(&mut line);
    let line = String::from_utf8_lossy(&line);
    let values = line.trim_end().split(',').map(|v| v.parse::<f64>().unwrap_or(f64::NAN));
    let truth: Map<String, Value> =
        HEADER.split(',').map(str::to_owned).zip(values.map(|v| json!(v))).collect();
    answer(&json!({ "truth": truth }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_orders_are_understood_or_refused_in_words() {
        assert_eq!(parse(r#"{"truth": true}"#).unwrap(), Order::Truth);
        assert_eq!(parse(r#"{"run_s": 0.02}"#).unwrap(), Order::Run(20_000));
        let fault = Order::Fault(Fault::AnchorSilent { anchor: 3, silent: true });
        assert_eq!(parse(r#"{"fault": {"part": "anchor", "anchor": 3}}"#).unwrap(), fault);
        for (line, needed) in [
            ("go", "one JSON object"),
            (r#"{"fly": 1}"#, "unknown variant `fly`"),
            (r#"{"run_s": -1}"#, "run_s = -1, allowed 0 to 3600 s"),
            (r#"{"run_s": 1e9}"#, "allowed 0 to 3600 s"),
            (r#"{"fault": {"part": "anchor"}}"#, "fault.anchor is missing"),
            (r#"{"fault": {"part": "hat"}}"#, "unknown variant `hat`"),
            (r#"{"fault": {"part": "tag", "at_s": 3}}"#, "obeyed at once"),
            (r#"{"fault": {"part": "tag", "for_s": 3}}"#, "fault.for_s"),
        ] {
            let error = format!("{:#}", parse(line).unwrap_err());
            assert!(error.contains(needed), "{line}: {error}");
        }
    }
}
