//! Programs in C and C++, compiled against the header and the library, read what we publish.

use std::io::{BufRead, BufReader};
use std::mem::{offset_of, size_of};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use edgecap_c::edgecap_world_body;
use edgecap_client::Publisher;
use edgecap_client::message::{Body, BodyFrame, FLAG_END_OF_STREAM, Intrinsics, StageTimes, World};

const HERE: &str = env!("CARGO_MANIFEST_DIR");
const C: [&str; 3] = ["cc", "-std=c99", "-xc"];
const CPP: [&str; 3] = ["c++", "-std=c++11", "-xc++"];

/// Compiles a source with all warnings as errors and links it with the library; `None` without the compiler.
fn compile([compiler, standard, language]: [&str; 3], source: &Path) -> Option<PathBuf> {
    // Cargo puts the library beside the tests.
    let test = std::env::current_exe().unwrap();
    let libraries = test.parent().unwrap();
    let program = source.with_extension(compiler);
    let out = Command::new(compiler)
        .args([
            standard,
            "-Wall",
            "-Wextra",
            "-Wpedantic",
            "-Werror",
            language,
        ])
        .arg(source)
        .arg("-o")
        .arg(&program)
        .args([&format!("-I{HERE}/include"), "-ledgecap_c"])
        .arg(format!("-L{}", libraries.display()))
        .arg(format!("-Wl,-rpath,{}", libraries.display()))
        .output();
    let Ok(out) = out else {
        eprintln!("skipped: no {compiler} on this machine");
        return None;
    };
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    Some(program)
}

/// Writes a source into `folder` and compiles it.
fn program(folder: &Path, name: &str, how: [&str; 3], text: &str) -> Option<PathBuf> {
    let source = folder.join(name);
    std::fs::write(&source, text).unwrap();
    compile(how, &source)
}

fn stdout(program: &Path) -> String {
    let out = Command::new(program).output().unwrap();
    assert!(out.status.success(), "{out:?}");
    String::from_utf8(out.stdout).unwrap()
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
    use edgecap_client::joints::{BODY_JOINTS, DOF, JOINT_NAMES};
    use edgecap_client::message::{HUMANOID_BONE_COUNT, HUMANOID_BONES, MAX_PEOPLE};
    let joints: String = JOINT_NAMES
        .iter()
        .map(|n| format!("printf(\"%d \", (int)EDGECAP_{});\n", n.to_uppercase()))
        .collect();
    let text = format!(
        "#include <edgecap.h>\n#include <stdio.h>\nint main(void) {{\nuint32_t i;\n{joints}\
         printf(\"%d %d %d %d\\n\", EDGECAP_BODY_JOINTS, EDGECAP_DOF, EDGECAP_BONES, EDGECAP_MAX_PEOPLE);\n\
         for (i = 0; edgecap_joint_name(i); i++) printf(\"%s\\n\", edgecap_joint_name(i));\n\
         for (i = 0; edgecap_bone_name(i); i++) printf(\"%s\\n\", edgecap_bone_name(i));\n\
         return 0;\n}}\n"
    );
    let folder = tempfile::tempdir().unwrap();
    let program = program(folder.path(), "names.c", C, &text).expect("a C compiler");
    let mut expected: String = (0..BODY_JOINTS).map(|i| format!("{i} ")).collect();
    expected += &format!("{BODY_JOINTS} {DOF} {HUMANOID_BONE_COUNT} {MAX_PEOPLE}\n");
    for name in JOINT_NAMES.iter().chain(&HUMANOID_BONES) {
        expected += &format!("{name}\n");
    }
    assert_eq!(stdout(&program), expected);
}

#[test]
fn the_example_reads_every_frame_to_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("bodies.c");
    std::fs::copy(Path::new(HERE).join("examples/bodies.c"), &source).unwrap();
    let camera = format!("test-c-{}", std::process::id());
    for how in [C, CPP] {
        let Some(program) = compile(how, &source) else {
            continue;
        };
        let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
        let reader = Command::new(&program)
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
        let mut expected = String::new();
        for sequence in 0..5 {
            frame.sequence = sequence;
            for (i, id) in [3, 7].into_iter().enumerate() {
                frame.bodies[i].id = id;
                let wrist = [0.25 * sequence as f32, -0.5, 2.0 + id as f32];
                frame.bodies[i].joints3d[4] = wrist;
                expected += &format!(
                    "{sequence} #{id} {:.2} {:.2} {:.2} m\n",
                    wrist[0], wrist[1], wrist[2]
                );
            }
            publisher.publish(&frame).unwrap();
        }
        frame.count = 0;
        frame.flags = FLAG_END_OF_STREAM;
        publisher.publish(&frame).unwrap();
        let out = reader.wait_with_output().unwrap();
        assert!(out.status.success(), "{out:?}");
        assert_eq!(String::from_utf8(out.stdout).unwrap(), expected);
    }
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
        for (life = 0; life < 2; life++) {\n\
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
    let reader = Command::new(program)
        .env("EDGECAP_RUNTIME_DIR", &place)
        .stdout(Stdio::piped())
        .spawn();
    let mut reader = reader.unwrap();
    let mut lines = BufReader::new(reader.stdout.take().unwrap()).lines();
    for _ in 0..2 {
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
        assert!(start.elapsed() < Duration::from_secs(2));
    }
    assert!(reader.wait().unwrap().success());
}
