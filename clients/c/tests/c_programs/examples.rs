//! The examples, built as their own comments say, and by users' build systems.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use edgecap_client::Publisher;
use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, MAX_PEOPLE};

use crate::compile::{HERE, libraries, run};
use crate::tools;

/// What an example says of frames that are published while it runs: five of two people, a camera's end, and one that
/// says it holds more people than there can be.
fn reads_every_frame_to_the_end(program: &Path, camera: &str) {
    let camera = format!("test-{camera}-{}", std::process::id());
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let reader = Command::new(program)
        .arg(&camera)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while publisher.subscriber_count() == 0 {
        assert!(start.elapsed() < Duration::from_secs(30), "it never came");
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut frame = BodyFrame {
        count: 2,
        ..BodyFrame::default()
    };
    let mut expected = Vec::new();
    for sequence in 0..5 {
        frame.sequence = sequence;
        for (i, id) in [3, 7].into_iter().enumerate() {
            frame.bodies[i].id = id;
            let wrist = [0.25 * sequence as f32, -0.5, 2.0 + id as f32];
            frame.bodies[i].joints3d[4] = wrist;
            expected.push((sequence, id, wrist));
        }
        publisher.publish(&frame).unwrap();
    }
    frame.count = 0;
    frame.flags = FLAG_END_OF_STREAM;
    publisher.publish(&frame).unwrap();
    (frame.sequence, frame.count, frame.flags) = (5, 1000, FLAG_FILE_TIME);
    for (i, body) in frame.bodies.iter_mut().enumerate() {
        body.id = i as u32;
        body.joints3d[4] = [1.0, 2.0, 3.0];
        expected.push((5, body.id, [1.0, 2.0, 3.0]));
    }
    assert_eq!(frame.bodies.len(), MAX_PEOPLE);
    publisher.publish(&frame).unwrap();
    frame.count = 0;
    frame.flags = FLAG_END_OF_STREAM | FLAG_FILE_TIME;
    publisher.publish(&frame).unwrap();
    let out = reader.wait_with_output().unwrap();
    assert!(out.status.success(), "{out:?}");
    let said = String::from_utf8(out.stdout).unwrap();
    let found: Vec<(u64, u32, [f32; 3])> = said
        .lines()
        .map(|line| {
            let words: Vec<&str> = line.split_whitespace().collect();
            let wrist = std::array::from_fn(|k| words[2 + k].parse().unwrap());
            assert_eq!(words[5..], ["m"], "{line}");
            (
                words[0].parse().unwrap(),
                words[1][1..].parse().unwrap(),
                wrist,
            )
        })
        .collect();
    assert_eq!(found, expected);
}

/// Builds an example by the command in its first lines, with warnings as errors.
fn by_its_own_comment(source: &str, compiler: &str, folder: &Path) -> Option<PathBuf> {
    if !tools::has(compiler) {
        return None;
    }
    let examples = Path::new(HERE).join("examples");
    let text = std::fs::read_to_string(examples.join(source)).unwrap();
    let (begin, program) = (format!("{compiler} "), folder.join(compiler));
    let command = text
        .lines()
        .take(4)
        .filter_map(|l| l.find(&begin).map(|at| l[at..].to_owned()))
        .find(|l| l.contains(source))
        .expect("a command");
    let built = libraries().display().to_string();
    let command = command
        .replace("$PWD/../../../target/release", &built)
        .replace("../../../target/release", &built)
        .replace("-o bodies", &format!("-o {}", program.display()));
    let command = format!("{command} -Wall -Wextra -Wpedantic -Werror");
    run(Command::new("sh")
        .args(["-c", &command])
        .current_dir(examples));
    Some(program)
}

#[test]
fn examples_are_built_by_their_own_comments() {
    let folder = tempfile::tempdir().unwrap();
    for (source, compiler) in [("bodies.c", "cc"), ("bodies.cpp", "c++")] {
        if let Some(program) = by_its_own_comment(source, compiler, folder.path()) {
            reads_every_frame_to_the_end(&program, compiler.trim_end_matches("++"));
        }
    }
}

/// Installs into a folder what this build made.
fn installed(prefix: &Path) {
    let said = run(Command::new(format!("{HERE}/install"))
        .arg(prefix)
        .env("EDGECAP_LIBRARIES", libraries()));
    assert!(said.contains(env!("CARGO_PKG_VERSION")), "{said}");
}

/// Below the folder for builds it is cargo's settings that say where, and an older build may lie elsewhere.
#[test]
fn what_is_installed_is_what_cargo_has_built_in_the_folder_for_builds() {
    let folder = tempfile::tempdir().unwrap();
    let older = folder.path().join("built/release");
    std::fs::create_dir_all(&older).unwrap();
    for library in ["libedgecap_c.so", "libedgecap_c.a"] {
        std::fs::write(older.join(library), "older").unwrap();
    }
    // In cargo's place: puts what is built already where cargo would that builds for a triple, and says so.
    let tools = folder.path().join("tools");
    std::fs::create_dir(&tools).unwrap();
    let cargo = tools.join("cargo");
    let built = libraries().display().to_string();
    let script = format!(
        r#"#!/bin/sh
to=$CARGO_TARGET_DIR/triple/release
mkdir -p "$to"
cp {built}/libedgecap_c.* "$to"
printf '{{"reason":"compiler-artifact","filenames":["%s/libedgecap_c.so","%s/libedgecap_c.a"]}}\n' "$to" "$to"
"#
    );
    // By a child: what this process has open for writing while a neighbour forks cannot be run for as long as the fork
    // has it open, too.
    run(Command::new("sh")
        .args(["-c", "printf %s \"$1\" > \"$0\" && chmod 755 \"$0\""])
        .arg(&cargo)
        .arg(script));
    let path = std::env::var("PATH").unwrap();
    run(Command::new(format!("{HERE}/install"))
        .arg("installed")
        .current_dir(folder.path())
        .env_remove("EDGECAP_LIBRARIES")
        .env("PATH", format!("{}:{path}", tools.display()))
        .env("CARGO_TARGET_DIR", "built"));
    for library in ["libedgecap_c.so", "libedgecap_c.a"] {
        let read = |folder: &Path| std::fs::read(folder.join(library)).unwrap();
        let installed = read(&folder.path().join("installed/lib"));
        assert!(installed == read(&libraries()), "{library}");
    }
    assert!(folder.path().join("built/triple").exists());
}

#[test]
fn pkg_config_finds_what_is_installed() {
    if !tools::has("pkg-config") || !tools::has("cc") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    installed(folder.path());
    // As the manual says it for systems that do not look there by themselves.
    let manual = include_str!("../../../../docs/clients.md");
    let mut lines = manual
        .lines()
        .map(|line| line.trim_start_matches(['#', ' ']));
    let place = lines.find_map(|l| l.strip_prefix("export PKG_CONFIG_PATH=/usr/local/"));
    let place = folder.path().join(place.expect("a line"));
    let ask = |what: &[&str]| {
        let mut command = Command::new("pkg-config");
        command.args(what).arg("edgecap");
        run(command.env("PKG_CONFIG_PATH", &place))
    };
    assert_eq!(ask(&["--modversion"]).trim(), env!("CARGO_PKG_VERSION"));
    let program = folder.path().join("program");
    let mut cc = Command::new("cc");
    cc.arg(Path::new(HERE).join("examples/bodies.c"));
    cc.args(ask(&["--cflags", "--libs"]).split_whitespace());
    cc.arg(format!(
        "-Wl,-rpath,{}",
        folder.path().join("lib").display()
    ));
    run(cc.arg("-o").arg(&program));
    // A program looks for the library of its interface: another's, whose link this may be by then, is none for it.
    std::fs::remove_file(folder.path().join("lib/libedgecap_c.so")).unwrap();
    reads_every_frame_to_the_end(&program, "pkg-config");
}

#[test]
fn cmake_finds_what_is_installed() {
    if !tools::has("cmake") || !tools::has("c++") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    installed(folder.path());
    let (source, build) = (folder.path().join("source"), folder.path().join("build"));
    std::fs::create_dir(&source).unwrap();
    let version = env!("CARGO_PKG_VERSION");
    // Who names the major version alone takes any minor one.
    let (major, _) = version.split_once('.').unwrap();
    let text = format!(
        "cmake_minimum_required(VERSION 3.13)\nproject(user C CXX)\nset(CMAKE_CXX_STANDARD 11)\n\
         find_package(edgecap {major}.0.0 QUIET)\nif(edgecap_FOUND)\nmessage(FATAL_ERROR another)\nendif()\n\
         find_package(edgecap {major} REQUIRED)\n\
         find_package(edgecap {version} REQUIRED)\n\
         add_executable(shared {HERE}/examples/bodies.cpp)\ntarget_link_libraries(shared PRIVATE edgecap::edgecap)\n\
         add_executable(alone {HERE}/examples/bodies.c)\ntarget_link_libraries(alone PRIVATE edgecap::static)\n"
    );
    std::fs::write(source.join("CMakeLists.txt"), text).unwrap();
    let prefix = format!("-DCMAKE_PREFIX_PATH={}", folder.path().display());
    let mut configure = Command::new("cmake");
    configure.arg("-S").arg(&source).arg("-B").arg(&build);
    run(configure.arg(prefix));
    run(Command::new("cmake").arg("--build").arg(&build));
    reads_every_frame_to_the_end(&build.join("shared"), "cmake");
    // It carries the library: what is installed may go.
    std::fs::remove_dir_all(folder.path().join("lib")).unwrap();
    reads_every_frame_to_the_end(&build.join("alone"), "cmake-static");
}
