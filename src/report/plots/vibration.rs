//! Vibration: spectra of force and rate in the air, with the line of the wing beat.

use super::{PLOT_PX, series};
use crate::report::flight::Flight;
use crate::report::spectrum::{BEAT_HZ, Spectrum};
use crate::report::svg::{Mark, Plot, Tone, Upright};
use haltere_core::measure::ImuSample;

/// Modes on the floor: motors do not turn.
const ON_FLOOR: [&str; 4] = ["disarmed", "arming", "idle", "disarming"];

fn spectrum(flight: &Flight) -> Option<Spectrum> {
    let flying: Vec<ImuSample> = airborne(flight);
    Spectrum::of(if flying.is_empty() { &flight.imu } else { &flying })
}

/// Samples in the air.
fn airborne(flight: &Flight) -> Vec<ImuSample> {
    let mut modes = flight.modes.iter().peekable();
    let mut flies = false;
    let mut out = Vec::new();
    for sample in &flight.imu {
        while let Some(mode) = modes.next_if(|mode| mode.at <= sample.received_at) {
            flies = !ON_FLOOR.contains(&mode.mode.as_str());
        }
        if flies {
            out.push(*sample);
        }
    }
    out
}

/// What was found, in words.
pub(super) fn note(flight: &Flight) -> String {
    let Some(spectrum) = spectrum(flight) else {
        return "Too few inertial measurements in a row for a spectrum.".to_owned();
    };
    let flown = if airborne(flight).is_empty() { "whole log" } else { "time in the air" };
    let mut text = format!(
        "Mean over the {flown}: {} segments of {:.1} s at {:.0} Hz. ",
        spectrum.segments,
        spectrum.segment_s(),
        spectrum.sampling_hz
    );
    match spectrum.beat_hz() {
        Some(hz) => {
            text += &format!("The wings beat at {hz:.2} Hz. ");
        }
        None => {
            text +=
                &format!("No wing beat stands out between {} and {} Hz. ", BEAT_HZ[0], BEAT_HZ[1]);
        }
    }
    let flapping: Vec<f64> = flight
        .truth
        .iter()
        .filter(|r| !r.on_ground)
        .map(|r| 0.5 * (r.flap_hz[0] + r.flap_hz[1]))
        .collect();
    if !flapping.is_empty() {
        let mean = flapping.iter().sum::<f64>() / flapping.len() as f64;
        text += &format!("Truth: {mean:.2} Hz on average. ");
    }
    text + "What lies above half the sampling rate is folded onto lower lines."
}

/// Force and rate.
pub(super) fn plots(flight: &Flight) -> Vec<String> {
    let spectrum = spectrum(flight);
    let [force, rate] = match &spectrum {
        Some(s) => [lines(s, &s.acc), lines(s, &s.rate)],
        None => [Vec::new(), Vec::new()],
    };
    let uprights: Vec<Upright> = spectrum
        .as_ref()
        .and_then(|s| Some((s.beat_hz()?, s.sampling_hz)))
        .map(|(beat_hz, sampling_hz)| {
            let lines = [(1.0, "beat"), (2.0, "2\u{d7}"), (3.0, "3\u{d7}")];
            lines
                .into_iter()
                .map(|(n, name)| Upright { name: name.to_owned(), x: n * beat_hz })
                .filter(|line| line.x < 0.5 * sampling_hz)
                .collect()
        })
        .unwrap_or_default();
    let plot = |title: &str, y_label: &str, series| Plot {
        title: title.to_owned(),
        x_label: "Hz".into(),
        y_label: y_label.to_owned(),
        series,
        size_px: PLOT_PX,
        decades: true,
        least_height: 1.0,
        uprights: uprights.clone(),
        ..Plot::default()
    };
    vec![
        plot("Specific force, body axes", "m/s\u{b2}/\u{221a}Hz", force).render(),
        plot("Angular rate, body axes", "rad/s/\u{221a}Hz", rate).render(),
    ]
}

fn lines(spectrum: &Spectrum, axes: &[Vec<f64>; 3]) -> Vec<crate::report::svg::Series> {
    let tones = [Tone::Command, Tone::Estimate, Tone::Family(2)];
    axes.iter()
        .zip(["x", "y", "z"])
        .zip(tones)
        .map(|((values, name), tone)| {
            // The mean was taken off: the first line says nothing.
            let points = spectrum.frequency_hz.iter().zip(values).skip(1);
            // An axis without any signal has no logarithm.
            let points = points.map(|(hz, v)| [*hz, v.max(1e-12).log10()]).collect();
            series(name, tone, Mark::Line, points)
        })
        .collect()
}
