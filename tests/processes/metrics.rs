//! Figures for Prometheus, `edgecap status`, and several cameras in one run.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::program::{self, Running, edgecap, eventually, signal, stream, tools};

const SCRAPE: &str = "GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n";

fn request(address: SocketAddr, request: &str) -> Option<String> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream
        .set_read_timeout(Some(Duration::from_secs(10)))
        .unwrap();
    stream.write_all(request.as_bytes()).ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    Some(answer)
}

fn scrape(address: SocketAddr) -> Option<Figures> {
    let answer = request(address, SCRAPE)?;
    let (head, body) = answer.split_once("\r\n\r\n").expect("a head and a body");
    assert!(head.starts_with("HTTP/1.1 200 OK"), "{head}");
    assert!(head.contains("text/plain; version=0.0.4"), "{head}");
    assert!(
        head.contains(&format!("Content-Length: {}", body.len())),
        "{head}"
    );
    Some(Figures::parse(body))
}

/// Samples by name and labels.
#[derive(Debug)]
struct Figures(BTreeMap<String, f64>);

impl Figures {
    /// Reads version 0.0.4 of the format and holds it against its rules.
    fn parse(text: &str) -> Self {
        assert!(text.ends_with('\n'));
        let mut types: BTreeMap<&str, &str> = BTreeMap::new();
        let mut helped = BTreeSet::new();
        let mut samples = BTreeMap::new();
        for line in text.lines() {
            if let Some(rest) = line.strip_prefix("# TYPE ") {
                let (name, kind) = rest.split_once(' ').unwrap();
                assert!(["counter", "gauge", "histogram"].contains(&kind), "{line}");
                assert!(types.insert(name, kind).is_none(), "twice: {line}");
                continue;
            }
            if let Some(rest) = line.strip_prefix("# HELP ") {
                assert!(
                    helped.insert(rest.split(' ').next().unwrap()),
                    "twice: {line}"
                );
                continue;
            }
            let (series, value) = line.rsplit_once(' ').unwrap_or_else(|| panic!("{line}"));
            let value: f64 = value.parse().unwrap_or_else(|_| panic!("{line}"));
            let (name, labels) = series
                .split_once('{')
                .map_or((series, ""), |(name, labels)| {
                    (
                        name,
                        labels.strip_suffix('}').unwrap_or_else(|| panic!("{line}")),
                    )
                });
            let family = ["_bucket", "_sum", "_count"]
                .iter()
                .find_map(|end| {
                    name.strip_suffix(end)
                        .filter(|f| types.get(f) == Some(&"histogram"))
                })
                .unwrap_or(name);
            assert!(
                types.contains_key(family) && helped.contains(family),
                "no family: {line}"
            );
            assert!(
                types[family] != "counter" || name.ends_with("_total"),
                "{line}"
            );
            let labels = labels.strip_suffix('"').unwrap_or(labels);
            for label in labels.split("\",").filter(|l| !l.is_empty()) {
                let (key, text) = label.split_once("=\"").unwrap_or_else(|| panic!("{line}"));
                assert!(
                    key.chars().all(|c| c.is_ascii_lowercase() || c == '_'),
                    "{line}"
                );
                assert!(!text.contains(['"', '\n']), "{line}");
            }
            assert!(value >= 0.0, "{line}");
            assert!(
                samples.insert(series.to_owned(), value).is_none(),
                "twice: {line}"
            );
        }
        let figures = Self(samples);
        figures.check_histograms();
        figures
    }

    /// Buckets never fall, and the last is the count.
    fn check_histograms(&self) {
        let mut last: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
        for (series, value) in &self.0 {
            let Some((rest, le)) = series.split_once("le=\"") else {
                continue;
            };
            let le = le.trim_end_matches("\"}");
            let le = if le == "+Inf" {
                f64::INFINITY
            } else {
                le.parse().unwrap()
            };
            last.entry(rest.trim_end_matches(',').replace("_bucket", "_count"))
                .or_default()
                .push((le, *value));
        }
        assert!(!last.is_empty());
        for (count, mut buckets) in last {
            buckets.sort_by(|a, b| a.0.total_cmp(&b.0));
            assert!(
                buckets.windows(2).all(|w| w[0].1 <= w[1].1),
                "{count}: {buckets:?}"
            );
            let (le, value) = buckets[buckets.len() - 1];
            assert!(le.is_infinite());
            assert_eq!(self.0[&format!("{count}}}")], value, "{count}");
        }
    }

    fn get(&self, series: &str) -> f64 {
        *self
            .0
            .get(series)
            .unwrap_or_else(|| panic!("{series} in {:?}", self.0.keys()))
    }
}

/// Two cameras from one file, in a place of their own, and where their figures are.
fn two_cameras(folder: &Path, names: [&str; 2]) -> (Running, SocketAddr) {
    let file = folder.join("edgecap.toml");
    let camera = |name| format!("[[camera]]\ninput = \"demo\"\nlive = true\nname = \"{name}\"\n");
    let text = format!(
        "{}{}[network]\nsize = \"256x160\"\nthreads = 1\n[metrics]\naddress = \"127.0.0.1:0\"\n",
        camera(names[0]),
        camera(names[1])
    );
    std::fs::write(&file, text).unwrap();
    let run = edgecap()
        .args(["run", "--config", file.to_str().unwrap()])
        .env("EDGECAP_RUNTIME_DIR", folder.join("run"))
        .env("EDGECAP_LOG", "warn,edgecap::commands::run::cameras=info")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let mut run = Running(run.unwrap());
    let line = run.says("figures at http://");
    let (_, url) = line.split_once("http://").unwrap();
    let address = url.split('/').next().unwrap().parse().unwrap();
    (run, address)
}

fn status(folder: &Path) -> (Option<i32>, serde_json::Value, String) {
    let ask = |more: &[&str]| {
        let mut command = edgecap();
        command
            .arg("status")
            .args(more)
            .env("EDGECAP_RUNTIME_DIR", folder.join("run"));
        command.output().unwrap()
    };
    let json = ask(&["--json"]);
    let said = String::from_utf8_lossy(&ask(&[]).stdout).into_owned();
    (
        json.status.code(),
        serde_json::from_slice(&json.stdout).expect("JSON"),
        said,
    )
}

#[test]
fn two_cameras_of_one_run_are_counted_and_a_restart_is_seen() {
    let folder = program::short_folder();
    let (code, nothing, _) = status(folder.path());
    assert_eq!((code, nothing.as_array().unwrap().len()), (Some(69), 0));

    let names = [stream("hall"), stream("yard")];
    let (run, address) = two_cameras(folder.path(), [&names[0], &names[1]]);
    let frames = |figures: &Figures, name: &str| {
        figures.get(&format!("edgecap_frames_total{{camera=\"{name}\"}}"))
    };
    let figures = eventually("bodies of both", || {
        let figures = scrape(address)?;
        names
            .iter()
            .all(|n| frames(&figures, n) >= 3.0)
            .then_some(figures)
    });
    for name in &names {
        for stage in ["preprocess", "stage1", "association", "stage2", "fit"] {
            let count = figures.get(&format!(
                "edgecap_stage_duration_seconds_count{{camera=\"{name}\",stage=\"{stage}\"}}"
            ));
            // Pictures that show what an empty one showed are for the fit alone.
            let all = frames(&figures, name);
            assert!(count > 0.0 && count <= all, "{stage}: {count} of {all}");
            assert!(stage != "fit" || count == all, "{count} of {all}");
        }
        assert!(
            figures.get(&format!(
                "edgecap_stage_duration_seconds_sum{{camera=\"{name}\",stage=\"stage1\"}}"
            )) > 0.0
        );
        for series in ["people", "up", "frames_dropped_total", "start_time_seconds"] {
            figures.get(&format!("edgecap_{series}{{camera=\"{name}\"}}"));
        }
    }
    // A name that somebody else may have lead here is none of this machine's.
    for (host, path, status) in [
        ("127.0.0.1", "/metrics", "200"),
        ("127.0.0.1", "/", "404"),
        ("evil.example", "/metrics", "403"),
    ] {
        let asked = format!(
            "GET {path} HTTP/1.1\r\nHost: {host}:{}\r\n\r\n",
            address.port()
        );
        let answer = request(address, &asked).unwrap();
        let begin = format!("HTTP/1.1 {status} ");
        assert!(answer.starts_with(&begin), "{host}{path}: {answer}");
    }
    // Who connect and say nothing take every place, and keep nobody else out for long.
    let silent: Vec<TcpStream> = (0..32)
        .map(|_| TcpStream::connect(address).unwrap())
        .collect();
    let connected = Instant::now();
    eventually("an answer behind silent clients", || {
        request(address, SCRAPE).filter(|answer| answer.starts_with("HTTP/1.1 200"))
    });
    // They have a second; this machine may have other work.
    assert!(connected.elapsed() < Duration::from_secs(10));
    drop(silent);

    let said = eventually("both cameras in the status", || {
        let (_, json, said) = status(folder.path());
        let cameras = json[0]["cameras"].as_array()?;
        (cameras.len() == 2).then_some(said)
    });
    assert!(names.iter().all(|n| said.contains(n)), "{said}");

    let fit = eventually("a fit", || run.child("fit"));
    signal(fit, "KILL");
    eventually("the restart among the figures", || {
        let figures = scrape(address)?;
        let restarts = |n: &String| {
            figures.get(&format!(
                "edgecap_restarts_total{{camera=\"{n}\",process=\"fit\"}}"
            ))
        };
        (names.iter().map(restarts).sum::<f64>() >= 1.0).then_some(())
    });
    let said = eventually("the restart in the status", || {
        let (_, _, said) = status(folder.path());
        (said.contains("fit restarted 1 time") && !said.contains("1 times")).then_some(said)
    });
    assert!(said.contains("signal 9"), "the last error: {said}");

    signal(run.pid(), "TERM");
    let out = run.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", program::stderr(&out));
    assert_eq!(status(folder.path()).0, Some(69));
    let left: Vec<_> = std::fs::read_dir(folder.path().join("run"))
        .unwrap()
        .flatten()
        .collect();
    assert!(
        left.iter()
            .all(|f| !f.file_name().to_string_lossy().starts_with("status")),
        "{left:?}"
    );
}

#[test]
fn an_address_that_others_reach_is_refused() {
    let out = program::output(&["run", "--input", "demo", "--live", "--metrics", "0.0.0.0:1"]);
    assert_eq!(out.status.code(), Some(64));
    assert!(program::stderr(&out).contains("this machine itself"));
}

#[test]
fn a_port_that_is_taken_is_said() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let args = [
        "run",
        "--input",
        "demo",
        "--live",
        "--name",
        &stream("taken"),
        "--metrics",
        &address,
    ];
    program::assert_fails(&args, 69, &["choose another port"]);
}

/// As containers are that share the folder of the shared memory: each has processes of the same numbers.
#[test]
fn runs_with_process_numbers_of_their_own_are_known() {
    let folder = program::short_folder();
    let alone = [
        "--user",
        "--map-root-user",
        "--pid",
        "--fork",
        "--kill-child",
        "--mount-proc",
    ];
    let tried = Command::new("unshare").args(alone).arg("true").output();
    if !tried.is_ok_and(|out| out.status.success()) {
        tools::skip("unshare", "no process numbers of their own for programs");
        return;
    }
    let names = [stream("contained"), stream("container")];
    let program = edgecap();
    let settings = program
        .get_envs()
        .filter_map(|(key, value)| Some((key, value?)));
    let settings: Vec<_> = settings.collect();
    let _runs = names.each_ref().map(|name| {
        let run = Command::new("unshare")
            .args(alone)
            .arg(program.get_program())
            .args(["run", "--input", "demo", "--live", "--name", name])
            .args(["--size", "256x160", "--threads", "1"])
            .envs(settings.iter().copied())
            .env("EDGECAP_RUNTIME_DIR", folder.path().join("run"))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn();
        Running(run.unwrap())
    });
    eventually("both runs in the status", || {
        let (_, json, _) = status(folder.path());
        let runs = json.as_array()?.iter();
        let cameras = runs.flat_map(|run| run["cameras"].as_array().unwrap());
        let known: BTreeSet<_> = cameras.filter_map(|c| c["name"].as_str()).collect();
        names.iter().all(|n| known.contains(&**n)).then_some(())
    });
}

/// As somebody who is in no group that may look.
#[test]
fn a_folder_that_is_closed_to_this_user_is_said_and_how_it_opens() {
    use std::os::unix::fs::PermissionsExt;
    if !rustix::process::geteuid().is_root() {
        eprintln!("skipped: only root becomes another user");
        return;
    }
    let folder = program::short_folder();
    // Whoever asks may pass to the program and to the folder, and is kept out by the folder itself.
    let place = folder.path().join("place");
    std::fs::create_dir(&place).unwrap();
    let ask = |mode: u32| {
        std::fs::set_permissions(&place, std::fs::Permissions::from_mode(mode)).unwrap();
        let out = program::as_stranger(folder.path())
            .arg("status")
            .env("EDGECAP_RUNTIME_DIR", &place)
            .output();
        let out = out.unwrap();
        (out.status.code(), program::stderr(&out))
    };
    let (code, said) = ask(0o750);
    assert_eq!(code, Some(77), "{said}");
    assert!(said.contains("usermod -aG root $USER"), "{said}");
    let (code, said) = ask(0o700);
    assert_eq!(code, Some(77), "{said}");
    assert!(
        !said.contains("usermod") && said.contains("owner"),
        "{said}"
    );
    // Who looks on waits, and is told the same.
    let view = program::as_stranger(folder.path())
        .args(["view", "--listen", "127.0.0.1:0"])
        .env("EDGECAP_RUNTIME_DIR", &place)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn();
    let told = Running(view.unwrap()).says("nobody publishes");
    assert!(told.contains("is closed to this user"), "{told}");
    assert_eq!(ask(0o755).0, Some(69));
}
