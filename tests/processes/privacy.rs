//! Only `infer` sees pictures: marked ones go through the whole program, and their bytes are looked for wherever others
//! could read them. That they would be found is shown where they have to be: in `infer`'s own memory.

use std::fs::{self, File};
use std::io::{Cursor, Read};
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use edgecap::capture::{self, AviWriter, Frame, InputSpec, OpenOptions, RawPicture, demo};
use edgecap::message::BodyFrame;
use edgecap_client::{Publisher, Subscriber};

use crate::program::{Running, edgecap, eventually, signal};

/// So many neighbouring bytes of noise are nowhere by chance: 1 in 2^96.
const MARK: usize = 12;
/// Of them so many differ: none is a piece of one colour.
const DISTINCT: usize = 8;
const CAMERA: &str = "marked";

/// Noise that no other program has.
fn noise() -> impl FnMut() -> u8 {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    }
}

/// Uncompressed noise, in which nobody is.
fn noise_film() -> Vec<u8> {
    let (width, height, mut noise) = (320, 240, noise());
    let picture: Vec<u8> = (0..width * height * 3 / 2).map(|_| noise()).collect();
    let mut film = format!("YUV4MPEG2 W{width} H{height} F10:1 C420jpeg\n").into_bytes();
    for _ in 0..8 {
        film.extend_from_slice(b"FRAME\n");
        film.extend_from_slice(&picture);
    }
    film
}

/// JPEG pictures of people, with noise.
fn people_film() -> Vec<u8> {
    let mut clip = capture::open_bytes("demo", demo::CLIP).unwrap();
    let mut picture = Frame::default();
    for _ in 0..20 {
        assert!(clip.next_into(&mut picture).unwrap());
    }
    let mut noise = noise();
    for value in &mut picture.rgb {
        *value = value.saturating_add(noise() % 8);
    }
    let (width, height) = (picture.width, picture.height);
    let mut film = AviWriter::new(Cursor::new(Vec::new()), width, height, (10, 1)).unwrap();
    for _ in 0..8 {
        film.write_frame(&picture, 95).unwrap();
    }
    film.finish().unwrap().into_inner()
}

type Marks = Vec<[u8; MARK]>;

/// Some hundred pieces of these bytes, far from each other: a copy of a part, or in tiles, is found as well.
fn marks(bytes: &[u8]) -> Marks {
    let apart = bytes.len() / 600;
    let pieces = bytes.chunks_exact(apart.max(MARK)).filter_map(|chunk| {
        chunk
            .windows(MARK)
            .map(|w| <[u8; MARK]>::try_from(w).unwrap())
            .find(|mark| {
                let mut sorted = *mark;
                sorted.sort_unstable();
                1 + sorted.windows(2).filter(|w| w[0] != w[1]).count() >= DISTINCT
            })
    });
    let marks: Marks = pieces.collect();
    assert!(marks.len() > 100, "{} marks", marks.len());
    marks
}

/// What a film's first picture looks like as the file has it, and decoded.
fn pictures_of(path: &Path, film: &[u8]) -> [(&'static str, Marks); 2] {
    let open = || {
        let input = InputSpec::Path(path.to_owned());
        capture::open(&input, &OpenOptions::default()).unwrap()
    };
    let mut raw = RawPicture::default();
    assert!(open().next_raw(&mut raw).unwrap());
    let mut as_in_file = raw.bytes.as_slice();
    if !film.windows(as_in_file.len()).any(|w| w == as_in_file) {
        // Uncompressed pictures are converted as they are read: half as many bytes again as pixels.
        let pixels = raw.layout.width as usize * raw.layout.height as usize;
        as_in_file = &film[film.len() - pixels * 3 / 2..];
    }
    let mut frame = Frame::default();
    assert!(open().next_into(&mut frame).unwrap());
    [
        ("as in the file", marks(as_in_file)),
        ("decoded", marks(&frame.rgb)),
    ]
}

/// Looks for marks.
struct Search<'a> {
    marks: &'a Marks,
    by_start: Vec<Vec<usize>>,
}

impl<'a> Search<'a> {
    fn new(marks: &'a Marks) -> Self {
        let mut by_start = vec![Vec::new(); 1 << 16];
        for (i, mark) in marks.iter().enumerate() {
            by_start[usize::from(u16::from_ne_bytes([mark[0], mark[1]]))].push(i);
        }
        Self { marks, by_start }
    }

    fn finds_in(&self, bytes: &[u8]) -> bool {
        bytes.windows(MARK).any(|window| {
            let start = usize::from(u16::from_ne_bytes([window[0], window[1]]));
            self.by_start[start]
                .iter()
                .any(|&i| self.marks[i] == window)
        })
    }

    /// In the memory of a process that it can write and shares with nobody.
    fn finds_in_memory_of(&self, pid: u32) -> bool {
        let maps = fs::read_to_string(format!("/proc/{pid}/maps")).unwrap();
        let memory = File::open(format!("/proc/{pid}/mem")).expect("the memory of a child");
        let mut looked_at = 0;
        let found = maps.lines().any(|line| {
            let (range, rest) = line.split_once(' ').unwrap();
            let (from, to) = range.split_once('-').unwrap();
            let [from, to] = [from, to].map(|n| u64::from_str_radix(n, 16).unwrap());
            if !rest.starts_with("rw-p") {
                return false;
            }
            let mut bytes = vec![0; (to - from) as usize];
            // What is unmapped meanwhile is not there.
            let Ok(n) = memory.read_at(&mut bytes, from) else {
                return false;
            };
            looked_at += n;
            self.finds_in(&bytes[..n])
        });
        assert!(looked_at > 100_000, "{looked_at} bytes of memory were read");
        found
    }
}

/// All files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .flat_map(|e| match e.path() {
            p if p.is_symlink() => Vec::new(),
            p if p.is_dir() => files(&p),
            p if p.is_file() => vec![p],
            _ => Vec::new(),
        })
        .collect()
}

/// Whether a file of iceoryx2 has no byte, and is there to be locked by a process that lives.
fn is_lock(path: &Path) -> bool {
    // Also by a descriptor.
    let file = fs::read_link(path).unwrap_or_else(|_| path.to_owned());
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    name.contains(".node_monitor") && fs::metadata(path).is_ok_and(|m| m.len() == 0)
}

/// Opens a file that can be read. Locks are left alone: who has one loses it by closing the file, however often that is
/// open, and the readers of this process would be taken for dead.
fn open(path: &Path) -> Option<File> {
    if is_lock(path) {
        return None;
    }
    File::open(path).ok()
}

/// What a process has open, by its descriptors.
fn descriptors(pid: u32) -> Vec<PathBuf> {
    let folder = fs::read_dir(format!("/proc/{pid}/fd")).unwrap();
    folder.flatten().map(|fd| fd.path()).collect()
}

/// The sockets of a process: those that lead out of this machine, or could, and the names of the others.
fn sockets(pid: u32) -> (Vec<String>, Vec<PathBuf>) {
    let names = descriptors(pid);
    let inodes: Vec<String> = names
        .iter()
        .filter_map(|fd| fs::read_link(fd).ok())
        .filter_map(|name| {
            let inode = name.to_str()?.strip_prefix("socket:[")?;
            Some(inode.strip_suffix(']')?.to_owned())
        })
        .collect();
    let table = |kind: &str| {
        let text = fs::read_to_string(format!("/proc/{pid}/net/{kind}")).unwrap_or_default();
        text.lines().map(ToOwned::to_owned).collect::<Vec<_>>()
    };
    let ours = |line: &str, column: usize| {
        let inode = line.split_whitespace().nth(column);
        inode.is_some_and(|inode| inodes.iter().any(|own| own == inode))
    };
    let mut network = Vec::new();
    for (kinds, column) in [
        (&["tcp", "tcp6", "udp", "udp6", "raw", "raw6"][..], 9),
        (&["packet"], 8),
    ] {
        for kind in kinds {
            network.extend(table(kind).into_iter().filter(|l| ours(l, column)));
        }
    }
    let local = table("unix").into_iter().filter(|l| ours(l, 6));
    // One without a name nobody else can open.
    let named = local.filter_map(|l| l.split_whitespace().nth(7).map(PathBuf::from));
    (network, named.collect())
}

/// A film goes through `run` as a camera's pictures would, until bodies have come for a while.
fn nothing_leaves_infer(film_name: &str, film: &[u8], people: bool) {
    let folder = crate::program::short_folder();
    let (input, place) = (folder.path().join(film_name), folder.path().join("place"));
    fs::write(&input, film).unwrap();
    let pictures = pictures_of(&input, film);
    let searches = pictures
        .each_ref()
        .map(|(what, marks)| (*what, Search::new(marks)));
    let found = |bytes: &[u8]| {
        let hit = searches.iter().find(|(_, search)| search.finds_in(bytes));
        hit.map(|(what, _)| *what)
    };
    assert_eq!(found(film), Some("as in the file"));

    let result = folder.path().join("bodies.jsonl");
    let mut command = edgecap();
    command
        .args([
            "run", "--live", "--size", "256x160", "--name", CAMERA, "--input",
        ])
        .arg(&input)
        .arg("--jsonl")
        .arg(&result)
        .env("EDGECAP_RUNTIME_DIR", &place)
        .env("EDGECAP_LOG", "debug")
        .stdout(File::create(folder.path().join("stdout")).unwrap())
        .stderr(File::create(folder.path().join("stderr")).unwrap());
    let mut run = Running(command.spawn().unwrap());
    let bodies = eventually("bodies", || {
        let bodies = Subscriber::<BodyFrame>::open_at(&place, CAMERA).unwrap();
        bodies.next(Duration::from_millis(200)).unwrap()?;
        Some(bodies)
    });
    let mut seen = 0;
    eventually("several bodies, of people where there are some", || {
        let frame = bodies.next(Duration::from_millis(200)).unwrap()?;
        seen += usize::from(!people || frame.count > 0);
        (seen >= 5).then_some(())
    });

    let infer = eventually("infer", || run.child("infer"));
    let others = [run.pid(), eventually("fit", || run.child("fit"))];
    for (what, search) in &searches {
        assert!(
            search.finds_in_memory_of(infer),
            "{film_name}: a picture {what} is in the memory of infer, and is not found there"
        );
        for pid in others {
            assert!(
                !search.finds_in_memory_of(pid),
                "{film_name}: a picture {what} has reached another process"
            );
        }
    }

    let mut looked = files(folder.path());
    for pid in [infer, others[0], others[1]] {
        let (network, named) = sockets(pid);
        assert_eq!(network, Vec::<String>::new(), "{film_name}");
        // `run` has what this test has open, too; its children have not.
        assert!(
            pid == run.pid() || named.iter().all(|path| path.starts_with(&place)),
            "{film_name}: {named:?}"
        );
        // Files without a name are shared by their descriptor.
        let open = descriptors(pid).into_iter();
        looked.extend(open.filter(|fd| fs::metadata(fd).is_ok_and(|m| m.is_file())));
    }
    looked.extend(files(Path::new("/dev/shm")));
    let streams = looked.iter().filter(|f| {
        let name = f.file_name().unwrap_or_default().to_string_lossy();
        f.starts_with(&place) && name.starts_with(CAMERA) && !name.ends_with(".lock")
    });
    assert_eq!(
        streams.count(),
        4,
        "observations, bodies, events and health"
    );
    let of_iceoryx2 = looked
        .iter()
        .filter(|f| f.extension().is_some_and(|e| e == "data"));
    assert!(of_iceoryx2.count() >= 4, "the same in iceoryx2");
    let own = fs::metadata(&input).unwrap();
    for path in &looked {
        // Others' files come and go, and `infer` opens the film again at its end: what is told is what is read.
        let Some(mut file) = open(path) else {
            continue;
        };
        let metadata = file.metadata().unwrap();
        if !metadata.is_file() || (metadata.dev(), metadata.ino()) == (own.dev(), own.ino()) {
            continue;
        }
        let mut bytes = Vec::new();
        if file.read_to_end(&mut bytes).is_ok() {
            assert_eq!(found(&bytes), None, "{film_name}: {}", path.display());
        }
    }

    drop(bodies);
    signal(run.pid(), "TERM");
    eventually("the end", || run.has_ended().then_some(()));
    assert_eq!(run.0.wait().unwrap().code(), Some(0));
    assert!(result.exists());
    for file in files(folder.path()).iter().filter(|f| **f != input) {
        let bytes = fs::read(file).unwrap();
        assert_eq!(found(&bytes), None, "{film_name}: {}", file.display());
    }
}

#[test]
fn no_byte_of_an_uncompressed_picture_leaves_infer() {
    nothing_leaves_infer("noise.y4m", &noise_film(), false);
}

#[test]
fn no_byte_of_a_jpeg_picture_leaves_infer() {
    nothing_leaves_infer("people.avi", &people_film(), true);
}

#[test]
fn a_socket_to_the_network_would_be_seen() {
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("socket");
    let local = std::os::unix::net::UnixDatagram::bind(&path).unwrap();
    let (network, named) = sockets(std::process::id());
    let port = format!(":{:04X} ", socket.local_addr().unwrap().port());
    assert!(
        network.iter().any(|line| line.contains(&port)),
        "{network:?}"
    );
    assert!(named.contains(&path), "{named:?}");
    drop(local);
}

/// Publishers and readers of other tests run in this process.
#[test]
fn looking_into_files_takes_nobodys_lock() {
    let folder = crate::program::short_folder();
    let publisher = Publisher::<BodyFrame>::open_at(folder.path(), CAMERA).unwrap();
    let files = files(folder.path());
    let is_monitor = |f: &&PathBuf| f.extension().is_some_and(|e| e == "node_monitor");
    let monitors: Vec<_> = files.iter().filter(is_monitor).collect();
    assert!(!monitors.is_empty(), "{files:?}");
    let this = std::process::id().to_string();
    // Number, kind, two words, process, device and inode.
    let is_held = |inode: &str| {
        let locks = fs::read_to_string("/proc/locks").unwrap_or_default();
        locks.lines().any(|line| {
            let lock: Vec<_> = line.split_whitespace().collect();
            let of = lock.get(5).and_then(|of| of.rsplit(':').next());
            lock.get(1) == Some(&"POSIX") && lock[4] == this && of == Some(inode)
        })
    };
    let are_held = || {
        let mut inodes = monitors.iter().map(|f| fs::metadata(f).unwrap().ino());
        inodes.all(|inode| is_held(&inode.to_string()))
    };
    if !are_held() {
        println!("skipped: /proc/locks does not tell who has a lock here");
        return;
    }
    let read = files.iter().filter(|f| open(f).is_some());
    assert!(read.count() > 3, "{files:?}");
    assert!(are_held());
    drop(publisher);
}
