//! The cameras of a run, each in a thread that looks after its own processes; what all of them have in common.

use std::sync::Arc;

use super::RunArgs;
use super::live::{self, Plan};
use super::pulse::Pulse;
use crate::bridge::websocket::Access;
use crate::commands::exit::{self, Failure, told_again};
use crate::commands::input::{self, NamedInput};
use crate::commands::say;
use crate::commands::settings::Loopback;
use crate::commands::status::StatusFile;
use crate::commands::stop::Stop;
use crate::commands::table::Table;
use crate::http::{Answer, Server};
use crate::metrics::{Meter, exposition};
use crate::supervise::ServiceManager;

/// The processes of a camera.
pub const PROCESSES: [&str; 2] = ["infer", "fit"];

/// Runs cameras until the user stops it or none of them goes on.
///
/// # Errors
/// As [`live::run`], the first; those of the other cameras are logged when they happen.
pub fn run(runs: &[RunArgs], stop: &Stop) -> anyhow::Result<()> {
    let chosen = runs
        .iter()
        .map(checked)
        .collect::<anyhow::Result<Vec<_>>>()?;
    if let [first, _, ..] = runs
        && first.bridges.vmc.is_some()
    {
        return Err(Failure::usage(
            "--vmc has a port for each person: expected one camera; 'edgecap bridge --vmc' takes one of several",
        )
        .into());
    }
    let meter = |(c, run): (&NamedInput, &RunArgs)| {
        let meter = Meter::new(&c.name, &c.spec.to_string(), &PROCESSES);
        Arc::new(meter.with_interval(run.pace.interval()))
    };
    let meters: Vec<Arc<Meter>> = chosen.iter().zip(runs).map(meter).collect();
    let _figures = figures(runs.first(), &meters)?;
    let page = match runs.first() {
        Some(first) => first.bridges.serve(first.show_picture)?,
        None => None,
    };
    if let Some(page) = &page {
        say::err(&format!("the page: {}", page.url()));
    }
    let hub = page.as_ref().map(|p| p.hub());
    let _status = StatusFile::keep(meters.clone());
    let manager = ServiceManager::from_env(chosen.iter().map(|c| c.name.as_str()));
    if let ([args], [chosen], [meter]) = (runs, &chosen[..], &meters[..]) {
        let (table, pulse) = (Table::new(args.table), Pulse::new(&manager, 0));
        let plan = Plan::of_camera(args, chosen);
        return live::run(args, plan, table, meter, &pulse, hub, stop);
    }
    std::thread::scope(|threads| {
        let started: Vec<_> = runs
            .iter()
            .zip(&chosen)
            .zip(&meters)
            .enumerate()
            .map(|(place, ((args, chosen), meter))| {
                let pulse = Pulse::new(&manager, place);
                threads.spawn(move || {
                    let table = Table::of_several(&chosen.name);
                    let plan = Plan::of_camera(args, chosen);
                    let ended = live::run(args, plan, table, meter, &pulse, hub, stop);
                    meter.ended();
                    if let Err(e) = &ended {
                        meter.failed(told_again(e));
                        tracing::error!(
                            "{}: ended, the others go on: {}",
                            chosen.name,
                            told_again(e)
                        );
                    }
                    // Without a sign of life of it the service manager starts everything anew.
                    if !ended.as_ref().is_err_and(|e| exit::may_pass(exit::code(e))) {
                        pulse.over();
                    }
                    ended
                })
            })
            .collect();
        let ended = started.into_iter().map(|thread| {
            thread
                .join()
                .unwrap_or_else(|_| Err(anyhow::anyhow!("a camera's thread ended unexpectedly")))
        });
        ended.fold(Ok(()), anyhow::Result::and)
    })
}

/// A run that is one of a camera.
pub fn checked(args: &RunArgs) -> anyhow::Result<NamedInput> {
    let chosen = input::choose(&args.input)?;
    if !chosen.is_live() {
        return Err(Failure::usage(format!(
            "{}: one of several cameras: expected a camera, or a film with live = true; a file is run alone",
            chosen.spec
        ))
        .into());
    }
    if args.overlay.is_some() {
        return Err(Failure::usage(
            "--overlay keeps pictures of people: expected a file; for a camera 'edgecap infer --overlay' does",
        )
        .into());
    }
    if !args.export.is_empty() {
        return Err(Failure::usage(
            "--export writes a whole take: expected a file; of a camera 'edgecap record' makes a take, and 'edgecap export' exports it",
        )
        .into());
    }
    Ok(chosen)
}

/// Serves figures where the run wants them.
///
/// # Errors
/// An address that is taken.
pub fn figures(run: Option<&RunArgs>, meters: &[Arc<Meter>]) -> anyhow::Result<Option<Server>> {
    let address = run.and_then(|r| r.metrics.address);
    address.map(|a| serve(a, meters)).transpose()
}

fn serve(address: Loopback, meters: &[Arc<Meter>]) -> anyhow::Result<Server> {
    let meters = meters.to_vec();
    let server = Server::start(address.0, move |request| {
        // A page of the internet could have its own name lead here, and read along.
        if let Some(refused) = Access::default().refuse(request) {
            return refused;
        }
        match &*request.path {
            "/metrics" => Answer::Body {
                status: "200 OK",
                kind: "text/plain; version=0.0.4; charset=utf-8",
                headers: &[],
                body: exposition(crate::BUILD, &meters).into_bytes().into(),
            },
            _ => Answer::refusal("404 Not Found", "figures are at /metrics"),
        }
    });
    let server = server.map_err(|e| {
        Failure::unavailable(format!(
            "--metrics {address}: {e}; choose another port, or stop who has it"
        ))
    })?;
    tracing::info!("figures at http://{}/metrics", server.address());
    Ok(server)
}
