//! What the balance says, in words.

use std::fmt::Write as _;

use super::causes::{Cause, Kind};
use super::report::{Report, Smallest};
use super::weigh::Weighed;
use crate::outcome::{Named, Outcome};

impl Report {
    /// The whole in words.
    pub fn text(&self) -> String {
        let mut out = String::new();
        let _ = writeln!(
            out,
            "{} ({:.1} s of hover) against {} references, vehicle {}",
            self.flight,
            self.hover_s,
            self.references.len(),
            self.vehicle
        );
        let _ = writeln!(out, "can show   {}", self.can_show_words());
        let _ = writeln!(out, "verdict    {}", self.verdict);
        for axis in &self.balance {
            let (share, sigma) = (100.0 * axis.share, 100.0 * axis.sigma);
            let _ = writeln!(out, "  {:<15} {share:+5.1} %, healthy ±{sigma:.1} %", axis.axis);
        }
        if let Some(times) = self.shaking {
            let _ = writeln!(out, "  shaking         {times:.1} times that of the references");
        }
        if let Some(mg) = marks(&self.accelerometer_g) {
            let _ = writeln!(out, "  accelerometer   {mg} mg from that of the references");
        }
        if let Some(told) = self.simulator_words() {
            let _ = writeln!(out, "simulator  {told}");
        }
        // Without an explanation there is nothing that could shrink.
        if let Some(held_out) =
            self.held_out.as_ref().filter(|held_out| held_out.after != held_out.before)
        {
            let _ = writeln!(
                out,
                "shrink     {:.2} of vertical force and moments on {}",
                held_out.shrink,
                held_out.flights.join(", ")
            );
        }
        for what in &self.not_checked {
            let _ = writeln!(out, "not checked: {what}");
        }
        out
    }

    /// How near a simulator comes to the references, and what it could not fly.
    pub fn simulator_words(&self) -> Option<String> {
        let simulator = self.simulator.as_ref()?;
        let axes = self.balance.iter().zip(simulator.apart);
        let told = axes.map(|(axis, apart)| {
            format!("{} {:+.1} % ({:+.1} sigma)", axis.axis, 100.0 * apart, apart / axis.sigma)
        });
        let told = told.collect::<Vec<_>>().join(", ");
        let lost: usize = simulator.lost.values().sum();
        let flown = simulator.flights - lost;
        let why = simulator.lost.iter().map(|(why, count)| format!("; {count} lost: {why}"));
        Some(format!(
            "flew {flown} of {} flights, and its healthy hover differs from the references by {told}{}",
            simulator.flights,
            why.collect::<String>()
        ))
    }

    /// What can be shown, before what was found.
    pub fn can_show_words(&self) -> String {
        let told = self.can_show.iter().map(|Smallest { kind, size }| {
            let from = |text: String| size.map_or("none that flies".to_owned(), |_| text);
            let size = size.unwrap_or(0.0);
            match kind {
                Kind::WeakMotor => format!(
                    "one motor's loss of thrust from {}",
                    from(format!("{:.0} % on", 100.0 * size))
                ),
                Kind::Load => {
                    format!("a load at one motor from {}", from(format!("{:.1} g on", 1e3 * size)))
                }
                _ => format!("shaking from {}", from(format!("{size:.1} times as much on"))),
            }
        });
        told.collect::<Vec<_>>().join(", ")
    }

    /// A cause with its size and 90 % of it, and what usually makes it, as a part of a sentence.
    pub fn cause_words(&self, named: &Named) -> String {
        let Some(Cause { kind, motors }) = Cause::find(&named.id) else { return named.id.clone() };
        let times = self.shaking.unwrap_or(1.0);
        let shakes = format!("the vehicle shakes {times:.1} times as much as the accepted flights");
        let each = || motors.iter().zip(&named.theta).zip(&named.theta_90);
        match kind {
            Kind::WeakMotor => {
                let told = each().map(|((motor, size), [low, high])| {
                    let [size, low, high] = [size, low, high].map(|share| 100.0 * share);
                    format!("motor {motor} gives {size:.0} % less thrust ({low:.0} to {high:.0} %)")
                });
                let all = told.collect::<Vec<_>>().join(" and ");
                format!("for the same command {all}: propeller cut, bent or worn, or a weak motor")
            }
            Kind::Load => {
                let told = each().map(|((motor, size), [low, high])| {
                    let [size, low, high] = [size, low, high].map(|kg| 1e3 * kg);
                    format!("{size:.1} g at motor {motor} ({low:.1} to {high:.1} g)")
                });
                format!("the vehicle carries a load of {}", told.collect::<Vec<_>>().join(" and "))
            }
            Kind::Unbalanced => {
                format!("a propeller is out of balance, and at which motor does not show: {shakes}")
            }
            Kind::Swinging => format!("a load swings: {shakes}"),
        }
    }
}

/// The outcome in sentences that anybody can read: what differs and by how much, how sure that is, what to look at.
pub fn verdict(report: &Report, weighed: &Weighed) -> String {
    let told: Vec<String> =
        report.outcome.effects().iter().map(|named| report.cause_words(named)).collect();
    let of_those: f64 = report.outcome.effects().iter().map(|named| named.probability).sum();
    match &report.outcome {
        Outcome::NoMaterialGap => format!(
            "Nothing differs from the accepted flights by more than these can show. {} Nothing to do.",
            sure(weighed.nothing)
        ),
        Outcome::NotInLibrary { remainder } => {
            let far: Vec<String> =
                remainder.statistics.iter().map(|(axis, z)| format!("{axis} {z:+.1}")).collect();
            let what = if weighed.another > weighed.something_else {
                format!(
                    "This is another vehicle than that of the accepted flights, and no fault: its motors share the weight \
                     otherwise{}. {} Next: give accepted flights of this vehicle.",
                    marks(&report.accelerometer_g).map_or_else(String::new, |mg| format!(
                        ", and its accelerometer is off by {mg} mg from theirs"
                    )),
                    sure(weighed.another)
                )
            } else {
                "Something differs that no cause known here makes. Usual: other propellers, another vehicle, \
                 another place of the battery."
                    .to_owned()
            };
            format!("{what} Farthest, in sigma: {}.", far.join(", "))
        }
        _ if told.len() > 1 => format!("Either {}. {}", told.join("; or "), sure(of_those)),
        _ => {
            let mut letters = told.concat();
            if let Some(first) = letters.get_mut(..1) {
                first.make_ascii_uppercase();
            }
            format!("{letters}. {}", sure(of_those))
        }
    }
}

/// How sure it is. No more is ever said than what a count of flights could show.
fn sure(probability: f64) -> String {
    let percent = 100.0 * probability.min(0.99);
    match percent < 50.0 {
        true => format!("Only {percent:.0} % sure: fly again before you act on it."),
        false => format!("Sure to {percent:.0} %."),
    }
}

/// How far the offsets of the accelerometer lie from those of the references; `None` where none was logged.
fn marks(offset_g: &[Option<f64>; 3]) -> Option<String> {
    let axes = ["forward", "left", "up"].iter().zip(offset_g);
    let told: Vec<String> =
        axes.filter_map(|(axis, g)| Some(format!("{:+.0} {axis}", 1e3 * (*g)?))).collect();
    (!told.is_empty()).then(|| told.join(", "))
}
