//! Programs in C and C++, compiled against the header and the library, read what we publish.

mod compile;
mod conformance;
mod examples;
mod numbers;
mod printed;
#[path = "../../../../tests/program/tools.rs"]
mod tools;

use std::io::{BufRead, BufReader};
use std::mem::{offset_of, size_of};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use edgecap_c::edgecap_world_body;
use edgecap_client::Publisher;
use edgecap_client::message::{
    Body, BodyFrame, Event, EventFrame, HealthFrame, Intrinsics, Observation, ObservationFrame,
    StageTimes, World,
};

use compile::{C, CPP, program, run};

fn stdout(program: &Path) -> String {
    run(&mut Command::new(program))
}

macro_rules! layout {
    ($($rust:ident $c:ident: $($field:ident)*;)*) => {{
        let (mut lines, mut expected) = (String::new(), Vec::new());
        $(
            lines += concat!("SIZE(", stringify!($c), ")\n");
            expected.push((stringify!($c).to_owned(), size_of::<$rust>()));
            $(
                lines += concat!("PLACE(", stringify!($c), ", ", stringify!($field), ")\n");
                expected.push((concat!(stringify!($c), ".", stringify!($field)).to_owned(), offset_of!($rust, $field)));
            )*
        )*
        (lines, expected)
    }};
}

#[test]
fn structures_have_the_same_layout() {
    let (lines, expected) = layout! {
        Intrinsics edgecap_intrinsics: fx fy cx cy;
        StageTimes edgecap_stage_times: preprocess_us stage1_us association_us stage2_us;
        Body edgecap_body: id state score position orientation velocity angles joints3d joints2d confidence height bone_lengths bone_rotations joint_states reserved;
        World edgecap_world: rotation translation state;
        BodyFrame edgecap_body_frame: sequence capture_ns pose_ns publish_ns width height intrinsics stage_times fit_us flags count frame_total world bodies;
        Event edgecap_event: kind person seconds hand zone;
        EventFrame edgecap_event_frame: sequence time_ns publish_ns first flags count present main_person events;
        HealthFrame edgecap_health_frame: publish_ns started_ns since_ns sequence capture_ns observed left_out state flags source_hz observed_hz look_hz latency_us pace people input_width input_height reconnects restarts cameras cameras_live;
        Observation edgecap_observation: score joints2d joints3d hue saturation;
        ObservationFrame edgecap_observation_frame: sequence capture_ns publish_ns width height intrinsics stage_times flags without_neck count frame_total people;
        edgecap_world_body edgecap_world_body: position orientation velocity joints3d;
    };
    let text = format!(
        "#include <edgecap.h>\n#include <stddef.h>\n#include <stdio.h>\n\
         #define SIZE(t) printf(\"%s %u\\n\", #t, (unsigned)sizeof(t));\n\
         #define PLACE(t, f) printf(\"%s.%s %u\\n\", #t, #f, (unsigned)offsetof(t, f));\n\
         int main(void) {{\n{lines}return 0;\n}}\n"
    );
    let folder = tempfile::tempdir().unwrap();
    for (name, how) in [("layout.c", C), ("layout.cpp", CPP)] {
        let Some(program) = program(folder.path(), name, how, &text) else {
            continue;
        };
        let found: Vec<(String, usize)> = stdout(&program)
            .lines()
            .map(|l| l.split_once(' ').unwrap())
            .map(|(what, n)| (what.to_owned(), n.parse().unwrap()))
            .collect();
        assert_eq!(found, expected);
    }
}

#[test]
fn names_and_numbers_agree() {
    use edgecap_client::joints::{
        ANGLE_NAMES, BODY_JOINTS, DOF, EVIDENCE_JOINTS, HUMANOID_BONE_COUNT, HUMANOID_BONES,
        JOINT_NAMES,
    };
    use edgecap_client::message::{
        APPEARANCE_BINS, EventKind, HealthPace, HealthState, MAX_EVENTS, MAX_PEOPLE, ZONE_NAME,
    };
    let joints: String = JOINT_NAMES
        .iter()
        .map(|n| format!("printf(\"%d \", (int)EDGECAP_{});\n", n.to_uppercase()))
        .collect();
    let events: Vec<&str> = (0..).map_while(|n| EventKind::from(n).name()).collect();
    let kinds: String = events
        .iter()
        .map(|n| {
            format!(
                "printf(\"%d \", (int)EDGECAP_EVENT_{});\n",
                n.to_uppercase()
            )
        })
        .collect();
    let numbers = |prefix: &str, names: &[String]| -> String {
        let print = |n: &String| format!("printf(\"%d \", (int)EDGECAP_{prefix}_{n});\n");
        names.iter().map(print).collect()
    };
    let states: Vec<&str> = (0..).map_while(|n| HealthState::from(n).name()).collect();
    let paces: Vec<&str> = (0..).map_while(|n| HealthPace::from(n).name()).collect();
    let in_health = |prefix, names: &[&str]| {
        let capitals: Vec<String> = names.iter().map(|n| n.to_uppercase()).collect();
        numbers(prefix, &capitals)
    };
    let health = in_health("HEALTH", &states) + &in_health("PACE", &paces);
    let angles = numbers("ANGLE", &ANGLE_NAMES.map(str::to_uppercase));
    let bones = numbers("BONE", &HUMANOID_BONES.map(in_capitals));
    let text = format!(
        "#include <edgecap.h>\n#include <stdio.h>\nint main(void) {{\nuint32_t i;\n{joints}{angles}{bones}\
         printf(\"%d %d %d %d \", EDGECAP_BODY_JOINTS, EDGECAP_DOF, EDGECAP_BONES, EDGECAP_MAX_PEOPLE);\n\
         printf(\"%d %d \", EDGECAP_MAX_EVENTS, EDGECAP_ZONE_NAME);\n\
         printf(\"%d %d\\n\", EDGECAP_EVIDENCE_JOINTS, EDGECAP_APPEARANCE_BINS);\n{kinds}{health}\
         for (i = 0; edgecap_joint_name(i); i++) printf(\"%s\\n\", edgecap_joint_name(i));\n\
         for (i = 0; edgecap_angle_name(i); i++) printf(\"%s\\n\", edgecap_angle_name(i));\n\
         for (i = 0; edgecap_bone_name(i); i++) printf(\"%s\\n\", edgecap_bone_name(i));\n\
         for (i = 0; edgecap_event_name(i); i++) printf(\"%s\\n\", edgecap_event_name(i));\n\
         for (i = 0; edgecap_health_state_name(i); i++) printf(\"%s\\n\", edgecap_health_state_name(i));\n\
         for (i = 0; edgecap_health_pace_name(i); i++) printf(\"%s\\n\", edgecap_health_pace_name(i));\n\
         return 0;\n}}\n"
    );
    let folder = tempfile::tempdir().unwrap();
    let Some(program) = program(folder.path(), "names.c", C, &text) else {
        return;
    };
    let mut expected: String = (0..BODY_JOINTS)
        .chain(0..DOF)
        .chain(0..HUMANOID_BONE_COUNT)
        .map(|i| format!("{i} "))
        .collect();
    expected += &format!("{BODY_JOINTS} {DOF} {HUMANOID_BONE_COUNT} {MAX_PEOPLE} ");
    expected += &format!("{MAX_EVENTS} {ZONE_NAME} {EVIDENCE_JOINTS} {APPEARANCE_BINS}\n");
    expected += &[&events, &states, &paces]
        .into_iter()
        .flat_map(|names| 0..names.len())
        .map(|i| format!("{i} "))
        .collect::<String>();
    for name in JOINT_NAMES
        .iter()
        .chain(&ANGLE_NAMES)
        .chain(&HUMANOID_BONES)
        .chain(&events)
        .chain(&states)
        .chain(&paces)
    {
        expected += &format!("{name}\n");
    }
    assert_eq!(stdout(&program), expected);
}

/// `rightLowerArm` as a constant has it: `RIGHT_LOWER_ARM`.
fn in_capitals(name: &str) -> String {
    let parts = name.chars().map(|c| match c.is_uppercase() {
        true => format!("_{c}"),
        false => c.to_uppercase().to_string(),
    });
    parts.collect()
}

const ROLE: &str = "EDGECAP_TEST_ROLE";

/// What another process of a test does; without a role this is no test.
#[test]
fn role() {
    if std::env::var_os(ROLE).is_none() {
        return;
    }
    let mut publisher = Publisher::<BodyFrame>::open("camera0").unwrap();
    for _ in 0..6000 {
        publisher.publish(&BodyFrame::default()).unwrap();
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_program_finds_out_that_the_publisher_is_gone_and_that_it_is_back() {
    let text = "#include <edgecap.h>\n#include <stdio.h>\nint main(void) {\n\
        const edgecap_body_frame *f;\nint life;\n\
        edgecap_bodies *r = edgecap_bodies_open(\"camera0\");\n\
        for (life = 0; life < 3; life++) {\n\
        while (edgecap_bodies_next(r, 100, &f) == 0) {}\n\
        if (edgecap_bodies_publishers(r) != 1) return 1;\n\
        puts(\"reads\"); fflush(stdout);\n\
        while (edgecap_bodies_publishers(r) == 1) edgecap_bodies_next(r, 20, &f);\n\
        puts(\"gone\"); fflush(stdout);\n\
        while (edgecap_bodies_next(r, 0, &f) == 1) {}\n\
        }\nedgecap_bodies_close(r);\nreturn 0;\n}\n";
    let folder = tempfile::tempdir().unwrap();
    let Some(program) = program(folder.path(), "gone.c", C, text) else {
        return;
    };
    let place = folder.path().join("edgecap");
    // One that finds nobody would wait for ever, and this test for it.
    let reader = Command::new("timeout")
        .arg("120")
        .arg(program)
        .env("EDGECAP_RUNTIME_DIR", &place)
        .stdout(Stdio::piped())
        .spawn();
    let mut reader = reader.unwrap();
    let mut lines = BufReader::new(reader.stdout.take().unwrap()).lines();
    let mut took = Vec::new();
    for _ in 0..3 {
        let publisher = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "role"])
            .env(ROLE, "publisher")
            .env("EDGECAP_RUNTIME_DIR", &place)
            .stdout(Stdio::null())
            .spawn();
        let mut publisher = publisher.unwrap();
        assert_eq!(lines.next().unwrap().unwrap(), "reads");
        publisher.kill().unwrap();
        publisher.wait().unwrap();
        let start = Instant::now();
        assert_eq!(lines.next().unwrap().unwrap(), "gone");
        took.push(start.elapsed());
    }
    // The shortest: either process may have waited for the processor.
    let shortest = took.into_iter().min().unwrap();
    assert!(shortest < Duration::from_secs(2), "{shortest:?}");
    assert!(reader.wait().unwrap().success());
}

/// A destructor has nobody to tell otherwise.
#[test]
fn a_reader_that_another_thread_lets_go_of_says_so() {
    let cpp = "#include <edgecap.hpp>\n#include <cstdio>\n#include <memory>\n#include <thread>\n\
        int main() {\n\
        std::unique_ptr<edgecap::Bodies> bodies(new edgecap::Bodies());\n\
        std::thread([&] { bodies.reset(); }).join();\n\
        { edgecap::Bodies own; }\n\
        std::puts(\"done\");\nreturn 0;\n}\n";
    let folder = tempfile::tempdir().unwrap();
    let Some(program) = program(folder.path(), "elsewhere.cpp", CPP, cpp) else {
        return;
    };
    let place = folder.path().join("edgecap");
    let mut command = Command::new(program);
    let out = command.env("EDGECAP_RUNTIME_DIR", &place).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert_eq!(
        (out.status.code(), &*text(&out.stdout)),
        (Some(0), "done\n")
    );
    let said = text(&out.stderr);
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(
        said.starts_with("edgecap: a reader was not closed: "),
        "{said}"
    );
    assert!(said.contains("thread that opened it"), "{said}");
}

/// Destructors of globals run when the values of the program's threads are gone.
#[test]
fn a_reader_that_is_a_global_is_closed_at_the_end_of_its_program() {
    let c = "#include <edgecap.h>\n#include <stdio.h>\n#include <stdlib.h>\n\
        static edgecap_bodies *reader;\n\
        static void read_and_close(void) {\n\
        const edgecap_body_frame *f;\n\
        if (edgecap_bodies_next(reader, 0, &f) < 0) puts(\"cannot read\");\n\
        edgecap_bodies_close(reader);\n\
        printf(\"closed%s\\n\", edgecap_error());\n}\n\
        int main(void) {\nconst edgecap_body_frame *f;\nint n;\n\
        reader = edgecap_bodies_open(\"camera0\");\n\
        if (!reader || atexit(read_and_close) != 0) return 1;\n\
        for (n = 0; n < 4; n++) while (edgecap_bodies_next(reader, 100, &f) == 0) {}\n\
        return 0;\n}\n";
    let cpp = "#include <edgecap.hpp>\n#include <cstdio>\n\
        struct Last { ~Last() { std::puts(\"closed\"); } };\n\
        static Last last;\nstatic edgecap::Bodies bodies;\n\
        int main() { for (int n = 0; n < 4; n++) while (!bodies.next()) {} return 0; }\n";
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("edgecap");
    let mut publisher = Publisher::<BodyFrame>::open_at(&place, "camera0").unwrap();
    let said = std::thread::scope(|threads| {
        let run = threads.spawn(|| -> Vec<_> {
            [("global.c", C, c), ("global.cpp", CPP, cpp)]
                .into_iter()
                .filter_map(|(name, how, text)| program(folder.path(), name, how, text))
                .map(|program| {
                    let mut command = Command::new(program);
                    let out = command.env("EDGECAP_RUNTIME_DIR", &place).output();
                    let out = out.unwrap();
                    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
                    (out.status.code(), text(&out.stdout), text(&out.stderr))
                })
                .collect()
        });
        while !run.is_finished() {
            publisher.publish(&BodyFrame::default()).unwrap();
            std::thread::sleep(Duration::from_millis(5));
        }
        run.join().unwrap()
    });
    for said in said {
        assert_eq!(said, (Some(0), "closed\n".to_owned(), String::new()));
    }
}
