//! Only `infer` sees pictures: a marked one goes through the whole program, and its bytes are looked for wherever others can
//! read.

use std::fs;
use std::path::{Path, PathBuf};

use edgecap::capture::{self, Frame, InputSpec, OpenOptions};
use edgecap::message::BodyFrame;
use edgecap_client::Subscriber;

use crate::program::{Running, edgecap, eventually, signal};

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
/// So many neighbouring bytes of noise are nowhere by chance: 1 in 2^96.
const MARK: usize = 12;

/// Noise that no other program has: the same film again and again would be as good a mark, but this one is as good everywhere.
fn film() -> Vec<u8> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut noise = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    };
    let picture: Vec<u8> = (0..WIDTH * HEIGHT * 3 / 2).map(|_| noise()).collect();
    let mut film = format!("YUV4MPEG2 W{WIDTH} H{HEIGHT} F10:1 C420jpeg\n").into_bytes();
    for _ in 0..300 {
        film.extend_from_slice(b"FRAME\n");
        film.extend_from_slice(&picture);
    }
    film
}

/// Pieces of what the pictures look like at each step: planes of the film, rows of the decoded picture.
fn marks(path: &Path, film: &[u8]) -> Vec<Vec<u8>> {
    let mut frame = Frame::default();
    let input = InputSpec::Path(path.to_owned());
    let mut source = capture::open(&input, &OpenOptions::default()).unwrap();
    assert!(source.next_into(&mut frame).unwrap());
    let start = film.iter().position(|&b| b == b'\n').unwrap() + 1 + b"FRAME\n".len();
    let planes = &film[start..start + WIDTH * HEIGHT * 3 / 2];
    // Every third row: a copy in tiles or of a part is found as well.
    let pieces = |bytes: &[u8], row: usize| -> Vec<Vec<u8>> {
        let starts = (row / 3..bytes.len() - MARK).step_by(3 * row);
        starts.map(|at| bytes[at..at + MARK].to_vec()).collect()
    };
    [pieces(planes, WIDTH), pieces(&frame.rgb, 3 * WIDTH)].concat()
}

/// Which of the marks is in there.
fn found(bytes: &[u8], marks: &[Vec<u8>]) -> Option<usize> {
    let mut first = vec![Vec::new(); 1 << 16];
    for (i, mark) in marks.iter().enumerate() {
        first[usize::from(u16::from_ne_bytes([mark[0], mark[1]]))].push(i);
    }
    bytes.windows(MARK).find_map(|window| {
        let candidates = &first[usize::from(u16::from_ne_bytes([window[0], window[1]]))];
        candidates.iter().copied().find(|&i| marks[i] == window)
    })
}

/// All files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .flat_map(|e| match e.path() {
            p if p.is_dir() => files(&p),
            p if p.is_file() => vec![p],
            _ => Vec::new(),
        })
        .collect()
}

/// What a process has open besides its terminal: files, shared memory, sockets.
fn open_files(pid: u32) -> Vec<PathBuf> {
    let fds = fs::read_dir(format!("/proc/{pid}/fd"))
        .into_iter()
        .flatten();
    fds.flatten()
        .filter_map(|fd| fs::read_link(fd.path()).ok())
        .collect()
}

/// Sockets of a process that lead out of this machine, or could.
fn network_sockets(pid: u32) -> Vec<String> {
    let open: Vec<String> = open_files(pid)
        .iter()
        .filter_map(|f| {
            Some(
                f.to_str()?
                    .strip_prefix("socket:[")?
                    .strip_suffix(']')?
                    .to_owned(),
            )
        })
        .collect();
    let kinds = ["tcp", "tcp6", "udp", "udp6", "raw", "raw6", "packet"];
    kinds
        .iter()
        .filter_map(|kind| fs::read_to_string(format!("/proc/{pid}/net/{kind}")).ok())
        .flat_map(|table| table.lines().map(ToOwned::to_owned).collect::<Vec<_>>())
        .filter(|line| {
            line.split_whitespace()
                .any(|word| open.iter().any(|s| s == word))
        })
        .collect()
}

#[test]
fn no_byte_of_a_picture_leaves_infer() {
    let folder = tempfile::tempdir().unwrap();
    let (input, place) = (
        folder.path().join("marked.y4m"),
        folder.path().join("place"),
    );
    let film = film();
    fs::write(&input, &film).unwrap();
    let marks = marks(&input, &film);
    assert!(found(&film, &marks).is_some(), "the film itself is found");

    let result = folder.path().join("bodies.jsonl");
    let mut command = edgecap();
    command
        .args(["run", "--live", "--size", "256x160", "--input"])
        .arg(&input)
        .arg("--jsonl")
        .arg(&result)
        .env("EDGECAP_RUNTIME_DIR", &place)
        .env("EDGECAP_LOG", "debug")
        .stdout(fs::File::create(folder.path().join("stdout")).unwrap())
        .stderr(fs::File::create(folder.path().join("stderr")).unwrap());
    let run = Running(command.spawn().unwrap());
    let bodies = eventually("bodies", || {
        let bodies = Subscriber::<BodyFrame>::open_at(&place, "camera0").unwrap();
        bodies
            .next(std::time::Duration::from_millis(200))
            .unwrap()?;
        Some(bodies)
    });
    for _ in 0..5 {
        bodies.next(std::time::Duration::from_secs(20)).unwrap();
    }

    let children = [run.child("infer").unwrap(), run.child("fit").unwrap()];
    for pid in [run.pid(), children[0], children[1]] {
        assert_eq!(network_sockets(pid), Vec::<String>::new());
    }
    // Files without a name are shared by their descriptor.
    let mut looked = files(folder.path());
    for pid in children {
        let of = format!("/proc/{pid}/fd");
        let fds = fs::read_dir(of).unwrap().flatten().map(|fd| fd.path());
        looked.extend(fds.filter(|fd| fs::metadata(fd).is_ok_and(|m| m.is_file())));
    }
    looked.extend(files(Path::new("/dev/shm")));
    let name = |f: &PathBuf| fs::canonicalize(f).unwrap_or_default();
    looked.retain(|f| name(f) != name(&input));
    let of_iceoryx2 = looked
        .iter()
        .filter(|f| f.extension().is_some_and(|e| e == "data"));
    assert_eq!(of_iceoryx2.count(), 2, "observations and bodies");
    for file in &looked {
        // Others' files come and go.
        let Ok(bytes) = fs::read(file) else { continue };
        assert_eq!(found(&bytes, &marks), None, "{}", file.display());
    }

    signal(run.pid(), "TERM");
    let mut run = run;
    assert!(run.0.wait().unwrap().code().is_some());
    for file in files(folder.path()).iter().filter(|f| **f != input) {
        assert_eq!(
            found(&fs::read(file).unwrap(), &marks),
            None,
            "{}",
            file.display()
        );
    }
    assert!(result.exists());
}
