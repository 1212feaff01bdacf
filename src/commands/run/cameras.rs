//! The cameras of a run, each in a thread that looks after its own processes; what all of them have in common.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::Builder;

use super::RunArgs;
use super::again::OneOfSeveral;
use super::live::{self, Plan};
use super::pulse::Pulse;
use crate::bridge::websocket::Access;
use crate::commands::exit::{self, Failure, told_again};
use crate::commands::input::NamedInput;
use crate::commands::say;
use crate::commands::settings::{Loopback, expect_camera, expect_each_its_own, expect_one_for_vmc};
use crate::commands::status::StatusFile;
use crate::commands::stop::Stop;
use crate::commands::table::Table;
use crate::commands::taken;
use crate::http::{Answer, Server};
use crate::metrics::{Meter, exposition};
use crate::supervise::ServiceManager;

/// The processes of a camera.
pub const PROCESSES: [&str; 2] = ["infer", "fit"];

/// Runs cameras until the user stops it or none of them goes on.
///
/// # Errors
/// As [`live::run`], of one camera; those of the others are logged when they happen.
pub fn run(runs: &[RunArgs], stop: &Stop) -> anyhow::Result<()> {
    let chosen = runs
        .iter()
        .map(expect_camera)
        .collect::<anyhow::Result<Vec<_>>>()?;
    expect_one_for_vmc(runs)?;
    expect_each_its_own(runs, &chosen)?;
    let mut free = taken::are_free(chosen.iter().map(|c| c.name.as_str()));
    if free.len() == 1 {
        free.remove(0)?;
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
        say::err(&format!("the page: {}", page.url_for_log()));
    }
    let hub = page.as_ref().map(|p| p.hub());
    let _status = StatusFile::keep(meters.clone());
    let manager = ServiceManager::from_env(chosen.iter().map(|c| c.name.as_str()));
    Stop::wake_when_children_end()?;
    if let ([args], [chosen], [meter]) = (runs, &chosen[..], &meters[..]) {
        let (table, pulse) = (Table::new(args.table), Pulse::new(&manager, 0));
        let plan = Plan::of_camera(args, chosen);
        return live::run(args, plan, table, meter, &pulse, hub, stop);
    }
    let (manager, running) = (&manager, &AtomicUsize::new(runs.len()));
    std::thread::scope(|threads| {
        let each = runs.iter().zip(&chosen).zip(&meters).zip(free).enumerate();
        let started = each.map(|(place, (((args, chosen), meter), free))| {
            let pulse = Pulse::new(manager, place);
            let over = move |ended| over(ended, meter, &Pulse::new(manager, place), running);
            let work = move || {
                let one = OneOfSeveral {
                    meter,
                    pulse: &pulse,
                    running,
                    stop,
                    no_wait: args.no_wait,
                };
                over(one.run_again(free, &mut |is_again| {
                    let table = Table::of_several(&chosen.name);
                    let plan = Plan {
                        is_again,
                        ..Plan::of_camera(args, chosen)
                    };
                    live::run(args, plan, table, meter, &pulse, hub, stop)
                }))
            };
            let thread = Builder::new().name("camera".into());
            thread.spawn_scoped(threads, work).map_err(|e| {
                running.fetch_sub(1, Ordering::AcqRel);
                over(Err(Failure::no_thread("for each camera", &e).into()))
            })
        });
        let started: Vec<_> = started.collect();
        let ended = started.into_iter().map(|thread| match thread {
            Ok(thread) => thread
                .join()
                .unwrap_or_else(|_| Err(anyhow::anyhow!("a camera's thread ended unexpectedly"))),
            Err(ended) => ended,
        });
        outcome(ended)
    })
}

/// Says how one of several cameras has ended, of which so many are still `running`, and has nobody miss it.
fn over(
    ended: anyhow::Result<()>,
    meter: &Meter,
    pulse: &Pulse<'_>,
    running: &AtomicUsize,
) -> anyhow::Result<()> {
    meter.ended();
    if let Err(e) = &ended {
        let (name, why) = (meter.name(), told_again(e));
        match running.load(Ordering::Acquire) {
            0 => tracing::error!("{name}: ended, and none of the others runs: {why}"),
            _ => tracing::error!("{name}: ended, the others go on: {why}"),
        }
        meter.failed(why);
    }
    // The service manager would end the others over a camera that gives no sign of life.
    pulse.over();
    ended
}

/// How a run of several cameras has ended: with the first failure, but of what may pass before what would come again,
/// since cameras that have failed so are to be started again with all others.
fn outcome(ended: impl Iterator<Item = anyhow::Result<()>>) -> anyhow::Result<()> {
    let rank = |ended: &anyhow::Result<()>| match ended {
        Err(e) if exit::may_pass(exit::code(e)) => 0,
        Err(_) => 1,
        Ok(()) => 2,
    };
    ended.min_by_key(rank).unwrap_or(Ok(()))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_ends_with_what_may_pass_before_what_would_come_again() {
        let failed = |code| Err(Failure::silent(code).into());
        let code = |ended: Vec<anyhow::Result<()>>| {
            let ended = outcome(ended.into_iter());
            ended.map_err(|e| exit::code(&e))
        };
        let all = vec![Ok(()), failed(exit::CONFIG), failed(exit::UNAVAILABLE)];
        assert_eq!(code(all), Err(exit::UNAVAILABLE));
        let all = vec![failed(exit::CONFIG), failed(exit::DATA), Ok(())];
        assert_eq!(code(all), Err(exit::CONFIG));
        assert_eq!(code(vec![Ok(()), Ok(())]), Ok(()));
    }
}
