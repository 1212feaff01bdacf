//! The text that Prometheus reads: <https://prometheus.io/docs/instrumenting/exposition_formats/>, version 0.0.4.

use std::fmt::Write;
use std::sync::Arc;

use super::histogram::Histogram;
use super::meter::{Meter, STAGES, Snapshot};

/// Every figure of every camera.
pub fn exposition(build: &str, meters: &[Arc<Meter>]) -> String {
    // Each camera is asked once, so that its figures are of one moment.
    let snapshots: Vec<Snapshot> = meters.iter().map(|m| m.snapshot()).collect();
    let mut text = Text(String::new());
    text.family("edgecap_build_info", "gauge", "Which build this is.");
    text.sample("edgecap_build_info", &[("build", build)], 1.0);

    const STAGE: &str = "edgecap_stage_duration_seconds";
    text.family(
        STAGE,
        "histogram",
        "What a stage took for a picture that it looked at; only the fit takes all.",
    );
    for s in &snapshots {
        for (stage, durations) in STAGES.iter().zip(&s.stages) {
            text.histogram(STAGE, &[("camera", &s.name), ("stage", stage)], durations);
        }
    }
    const LATENCY: &str = "edgecap_latency_seconds";
    text.family(
        LATENCY,
        "histogram",
        "From capture to the publication of bodies.",
    );
    for s in &snapshots {
        text.histogram(LATENCY, &[("camera", &s.name)], &s.latency);
    }
    let mut each = |name: &str, kind: &str, help: &str, value: &dyn Fn(&Snapshot) -> f64| {
        text.family(name, kind, help);
        for s in &snapshots {
            text.sample(name, &[("camera", &s.name)], value(s));
        }
    };
    each(
        "edgecap_up",
        "gauge",
        "1 where bodies came within 3 s, or 2.5 intervals of --max-fps or of the camera where they are longer.",
        &|s| f64::from(u8::from(s.healthy)),
    );
    each(
        "edgecap_frames_total",
        "counter",
        "Pictures whose bodies were published.",
        &|s| s.frames as f64,
    );
    each(
        "edgecap_frames_dropped_total",
        "counter",
        "Pictures without bodies of their own: nobody looked at them, or --rate passed them by.",
        &|s| s.dropped as f64,
    );
    each(
        "edgecap_people",
        "gauge",
        "People in the newest frame.",
        &|s| f64::from(s.people),
    );
    each(
        "edgecap_reconnects_total",
        "counter",
        "How often the camera came back.",
        &|s| s.reconnects as f64,
    );
    each(
        "edgecap_start_time_seconds",
        "gauge",
        "Start of the run, seconds since 1970.",
        &|s| s.since as f64,
    );
    const RESTARTS: &str = "edgecap_restarts_total";
    text.family(
        RESTARTS,
        "counter",
        "How often a process was started again.",
    );
    for s in &snapshots {
        for (process, n) in &s.restarts {
            text.sample(
                RESTARTS,
                &[("camera", &s.name), ("process", process)],
                *n as f64,
            );
        }
    }
    text.0
}

/// A text in the making.
struct Text(String);

impl Text {
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        let _ = write!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}\n");
    }

    fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: f64) {
        self.0 += name;
        for (i, (key, value)) in labels.iter().enumerate() {
            self.0.push(if i == 0 { '{' } else { ',' });
            let _ = write!(self.0, "{key}=\"{}\"", escaped(value));
        }
        if !labels.is_empty() {
            self.0.push('}');
        }
        let _ = writeln!(self.0, " {value}");
    }

    fn histogram(&mut self, name: &str, labels: &[(&str, &str)], durations: &Histogram) {
        for (bound, count) in durations.cumulative() {
            let bound = if bound.is_finite() {
                bound.to_string()
            } else {
                "+Inf".to_owned()
            };
            let labels = [labels, &[("le", &bound)]].concat();
            self.sample(&format!("{name}_bucket"), &labels, count as f64);
        }
        self.sample(&format!("{name}_sum"), labels, durations.sum());
        self.sample(&format!("{name}_count"), labels, durations.count() as f64);
    }
}

fn escaped(value: &str) -> String {
    value
        .replace('\\', "\\\\")
        .replace('"', "\\\"")
        .replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;
    use crate::message::BodyFrame;

    fn figure(text: &str, series: &str) -> u64 {
        let line = text.lines().find_map(|l| l.strip_prefix(series));
        line.unwrap_or_else(|| panic!("{series} in {text}"))
            .trim()
            .parse()
            .unwrap()
    }

    #[test]
    fn when_a_camera_is_up_is_told_as_on_the_page() {
        let page = include_str!("../../docs/operate.md");
        let mut rows = page.lines();
        let told = rows.find_map(|row| row.strip_prefix("| `edgecap_up` | ")?.strip_suffix(" |"));
        let told = told.unwrap().replace('`', "");
        let text = exposition("test", &[]);
        let line = format!("# HELP edgecap_up {told}.\n");
        assert!(text.contains(&line), "{line}in {text}");
    }

    #[test]
    fn all_figures_of_a_camera_are_of_one_moment() {
        let meter = Arc::new(Meter::new("hall", "camera", &[]));
        let stop = AtomicBool::new(false);
        std::thread::scope(|threads| {
            threads.spawn(|| {
                for sequence in 0.. {
                    meter.published(&BodyFrame {
                        sequence,
                        ..BodyFrame::default()
                    });
                    if stop.load(Ordering::Relaxed) {
                        break;
                    }
                }
            });
            for _ in 0..300 {
                let text = exposition("test", std::slice::from_ref(&meter));
                let frames = figure(&text, "edgecap_frames_total{camera=\"hall\"}");
                let last = figure(
                    &text,
                    "edgecap_stage_duration_seconds_count{camera=\"hall\",stage=\"fit\"}",
                );
                let latency = figure(&text, "edgecap_latency_seconds_count{camera=\"hall\"}");
                assert_eq!((last, latency), (frames, frames));
            }
            stop.store(true, Ordering::Relaxed);
        });
    }
}
