//! The cameras of a run, each in a thread that looks after its own processes; what all of them have in common.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use edgecap_client::LinkError;

use super::RunArgs;
use super::live::{self, Plan};
use super::own::expect_each_its_own;
use super::pulse::Pulse;
use super::taken;
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

/// So soon a camera is tried again that failed of what may pass; twice as late each time, …
const FIRST_PAUSE: Duration = Duration::from_millis(500);
/// … and no later than this.
const LONGEST_PAUSE: Duration = Duration::from_secs(10);
/// How often one that waits looks whether the others go on.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// The processes of a camera.
pub const PROCESSES: [&str; 2] = ["infer", "fit"];

/// Runs cameras until the user stops it or none of them goes on.
///
/// # Errors
/// As [`live::run`], of one camera; those of the others are logged when they happen.
pub fn run(runs: &[RunArgs], stop: &Stop) -> anyhow::Result<()> {
    let chosen = runs
        .iter()
        .map(checked)
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
        say::err(&format!("the page: {}", page.url()));
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
    let running = AtomicUsize::new(runs.len());
    std::thread::scope(|threads| {
        let started: Vec<_> = runs
            .iter()
            .zip(&chosen)
            .zip(&meters)
            .zip(free)
            .enumerate()
            .map(|(place, (((args, chosen), meter), free))| {
                let (pulse, running) = (Pulse::new(&manager, place), &running);
                threads.spawn(move || {
                    let ended = run_again(free, meter, running, stop, &mut || {
                        let table = Table::of_several(&chosen.name);
                        let plan = Plan::of_camera(args, chosen);
                        live::run(args, plan, table, meter, &pulse, hub, stop)
                    });
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
        outcome(ended)
    })
}

/// Counts a camera among those that run, from when it was counted to where this is dropped.
struct Runs<'a>(&'a AtomicUsize);

impl Drop for Runs<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Runs one of several cameras, which is counted as `running` and whose name is `free` or not, and again where it
/// failed of what may pass, such as a name that another process has still. Meanwhile it shows no sign of life.
///
/// # Errors
/// What it failed of, where that would come again, no other camera runs, or the user stops it.
fn run_again(
    mut free: Result<(), LinkError>,
    meter: &Meter,
    running: &AtomicUsize,
    stop: &Stop,
    run: &mut dyn FnMut() -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let name = meter.name();
    let (mut pause, mut said) = (FIRST_PAUSE, String::new());
    loop {
        let before = meter.snapshot().frames;
        let counted = Runs(running);
        let ended = free.map_err(anyhow::Error::from).and_then(|()| run());
        drop(counted);
        let Err(e) = ended else {
            return Ok(());
        };
        let others_run = || running.load(Ordering::Acquire) > 0;
        if stop.requested() || !exit::may_pass(exit::code(&e)) || !others_run() {
            return Err(e);
        }
        if meter.snapshot().frames > before {
            (pause, said) = (FIRST_PAUSE, String::new());
        }
        let why = told_again(&e);
        if said != why {
            tracing::warn!("{name}: ended, the others go on; starting it again: {why}");
            meter.failed(&why);
            said = why;
        }
        let failed = Instant::now();
        while failed.elapsed() < pause {
            if stop.requested() || !others_run() {
                return Err(e);
            }
            meter.looked();
            sleep(LOOK_EVERY);
        }
        pause = LONGEST_PAUSE.min(2 * pause);
        running.fetch_add(1, Ordering::AcqRel);
        free = taken::are_free([name]).into_iter().collect();
    }
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

/// Refuses VMC of several cameras that are no room: each numbers its people for itself.
///
/// # Errors
/// Exit code 64.
pub fn expect_one_for_vmc(runs: &[RunArgs]) -> Result<(), Failure> {
    match runs {
        [first, _, ..] if first.bridges.vmc.is_some() => Err(Failure::usage(
            "--vmc has a port for each person: expected one camera; 'edgecap bridge --vmc' takes one of several",
        )),
        _ => Ok(()),
    }
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

    fn unavailable() -> anyhow::Result<()> {
        Err(Failure::silent(exit::UNAVAILABLE).into())
    }

    #[test]
    fn one_of_several_that_fails_of_what_may_pass_is_tried_again() {
        let meter = Meter::new("nobody-publishes-this", "camera", &[]);
        let (running, mut times) = (AtomicUsize::new(2), 0);
        let taken = Err(LinkError::Busy {
            service: "hall".into(),
        });
        let ended = run_again(taken, &meter, &running, &Stop::never(), &mut || {
            times += 1;
            match times {
                1 => unavailable(),
                _ => Ok(()),
            }
        });
        assert!(ended.is_ok() && times == 2);
        assert_eq!(running.into_inner(), 1, "the other one");
        assert!(meter.snapshot().last_error.is_some());
    }

    #[test]
    fn one_that_would_fail_again_or_is_the_last_ends() {
        let meter = Meter::new("nobody-publishes-this", "camera", &[]);
        let stop = Stop::never();
        for (others, code) in [(1, exit::CONFIG), (0, exit::UNAVAILABLE)] {
            let (running, mut times) = (AtomicUsize::new(1 + others), 0);
            let ended = run_again(Ok(()), &meter, &running, &stop, &mut || {
                times += 1;
                Err(Failure::silent(code).into())
            });
            assert_eq!((ended.map_err(|e| exit::code(&e)), times), (Err(code), 1));
        }
        // The other one ends while it waits.
        let running = AtomicUsize::new(2);
        let ended = std::thread::scope(|threads| {
            let waits =
                threads.spawn(|| run_again(Ok(()), &meter, &running, &stop, &mut unavailable));
            while meter.snapshot().last_error.is_none() {
                std::thread::yield_now();
            }
            drop(Runs(&running));
            waits.join().unwrap()
        });
        assert!(ended.is_err());
    }
}
