//! Walls of the house that the compiler does not hold: which room may name which, and that no two parts of a room need
//! each other.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// A room of `src` and the rooms that it may name. The messages (`message`, `joints`) are free to all.
///
/// Data goes one way: a room names only rooms before it. What is not listed here is a new room, which wants a line.
const ROOMS: &[(&str, &[&str])] = &[
    // Tools that know nothing of motion capture.
    ("assignment", &[]),
    ("board", &[]),
    ("bounded", &[]),
    ("config", &[]),
    ("counted", &[]),
    ("http", &[]),
    ("lru", &[]),
    ("machine", &[]),
    ("metrics", &[]),
    ("npz", &[]),
    ("output", &[]),
    ("solve", &[]),
    // What is known of cameras and of bodies.
    ("camera", &["bounded"]),
    ("body", &["npz"]),
    // Before shared memory: these see pictures.
    ("capture", &["camera", "counted"]),
    ("engine", &["bounded", "output"]),
    ("detect", &["assignment", "engine"]),
    ("flow", &["capture"]),
    ("lift", &["camera", "capture", "detect", "engine"]),
    ("schedule", &["capture"]),
    (
        "follow",
        &["capture", "detect", "engine", "flow", "lift", "schedule"],
    ),
    ("overlay", &["capture", "output"]),
    // After shared memory: these never do.
    ("fit", &["assignment", "body", "camera", "solve"]),
    (
        "multiview",
        &["assignment", "body", "camera", "fit", "npz", "solve"],
    ),
    (
        "calibrate",
        &["board", "body", "camera", "multiview", "solve"],
    ),
    ("record", &["camera", "output"]),
    (
        "sink",
        &[
            "camera", "capture", "counted", "events", "output", "overlay", "record",
        ],
    ),
    ("events", &["camera"]),
    ("export", &["body", "counted", "npz", "record"]),
    (
        "bridge",
        &["body", "camera", "events", "http", "record", "sink"],
    ),
    ("view", &["http"]),
    ("supervise", &["output"]),
];
/// Rooms that may name all others, the laboratory included for its own verbs.
const JOINERS: &[&str] = &["commands", "lab"];
/// The verbs that show the laboratory's instruments.
const INSTRUMENTS: &[&str] = &[
    "commands/bench.rs",
    "commands/eval.rs",
    "commands/synth/mod.rs",
    "commands/synth/strip.rs",
    "commands/synth/views.rs",
];

fn src() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// The Rust files of a file or folder.
fn files(path: &Path) -> Vec<PathBuf> {
    files_of(path, "rs")
}

/// Files under a path that end in `.extension`; what a tool made for itself is none of them.
fn files_of(path: &Path, extension: &str) -> Vec<PathBuf> {
    if path.is_file() {
        return vec![path.into()];
    }
    let entries = fs::read_dir(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let entries = entries.map(|e| e.unwrap().path());
    let is_own = |path: &PathBuf| !path.file_name().unwrap().to_str().unwrap().starts_with('.');
    let mut found: Vec<PathBuf> = entries
        .filter(is_own)
        .flat_map(|path| files_of(&path, extension))
        .collect();
    found.retain(|f| f.extension().is_some_and(|e| e == extension));
    found
}

/// The rooms that stand, by name.
fn rooms() -> Vec<(String, PathBuf)> {
    let entries = fs::read_dir(src()).unwrap().map(|e| e.unwrap().path());
    let named = entries.map(|p| (p.file_stem().unwrap().to_str().unwrap().to_owned(), p));
    named
        .filter(|(name, _)| name != "lib" && name != "main")
        .collect()
}

/// What a file says, comments left out, and how deep below the crate its module is.
fn code_of(file: &Path) -> (String, usize) {
    let text = fs::read_to_string(file).unwrap();
    let code = text.lines().filter(|l| !l.trim_start().starts_with("//"));
    let code: Vec<&str> = code.collect();
    let modules = file.strip_prefix(src()).unwrap().components().count();
    let depth = modules - usize::from(file.ends_with("mod.rs"));
    (code.join("\n"), depth)
}

/// Rooms that a file names.
fn named_in(file: &Path) -> BTreeSet<String> {
    let (code, depth) = code_of(file);
    named_by(&code, depth)
}

/// What code in a module so deep below the crate names after `crate::`, or after as many `super::` as lead there.
fn named_by(code: &str, depth: usize) -> BTreeSet<String> {
    let up = "super::".repeat(depth);
    let paths = ["crate::", &up].map(|root| paths_after(code, root));
    names(paths.into_iter().flatten())
}

/// The same of a room's parts, which the code of a module so deep below the crate names.
fn parts_named_by(code: &str, depth: usize, room: &str) -> BTreeSet<String> {
    let (down, up) = (format!("{room}::"), "super::".repeat(depth - 1));
    let from_crate = paths_after(code, "crate::");
    let from_room = from_crate.filter_map(|path| path.trim().strip_prefix(&*down));
    let from_room = from_room.flat_map(parts_of);
    names(from_room.chain(paths_after(code, &up)))
}

/// Paths that follow `root`, a list of them one by one.
fn paths_after<'a>(code: &'a str, root: &'a str) -> impl Iterator<Item = &'a str> {
    let found = code.match_indices(root);
    // A longer way up leads elsewhere.
    let found = found.filter(|(at, _)| !code[..*at].ends_with("super::"));
    let rests = found.map(|(at, root)| &code[at + root.len()..]);
    let rests = rests.filter(|rest| !rest.starts_with("super::"));
    rests.flat_map(parts_of)
}

/// What paths begin with.
fn names<'a>(paths: impl Iterator<Item = &'a str>) -> BTreeSet<String> {
    let name = |path: &str| -> String {
        let path = path.trim().trim_start_matches("r#");
        path.chars()
            .take_while(|c| c.is_alphanumeric() || *c == '_')
            .collect()
    };
    paths.map(name).filter(|name| !name.is_empty()).collect()
}

/// What stands between the braces that a text begins with, parted by the commas that no other braces hold; the text
/// itself where it begins with none.
fn parts_of(text: &str) -> Vec<&str> {
    let Some(list) = text.strip_prefix('{') else {
        return vec![text];
    };
    let mut open = 1;
    let ends_part = |c: char| {
        open += i32::from(c == '{') - i32::from(c == '}');
        open == 0 || (c == ',' && open == 1)
    };
    let mut parts = Vec::new();
    for part in list.split_inclusive(ends_part) {
        parts.push(part);
        if part.ends_with('}') && part.matches('{').count() < part.matches('}').count() {
            break;
        }
    }
    parts
}

#[test]
fn rooms_are_found_however_they_are_named() {
    let code = "use crate::{\n    camera::{Lens, View},\n    fit, r#npz,\n};\nuse super::super::{body::{A, B}, record};\n\
        fn f() { crate::solve::g(); super::output::h(); other(); }";
    let named = Vec::from_iter(named_by(code, 2));
    assert_eq!(named, ["body", "camera", "fit", "npz", "record", "solve"]);
}

#[test]
fn parts_of_a_room_are_found_however_they_are_named() {
    let code = "use crate::{\n    hall::{table, chair::Leg},\n    kitchen::oven,\n};\nuse super::{lamp, door::Handle};\n\
        use crate::hall::shelf;\nfn f() { super::clock::g(); super::super::cellar::h(); crate::hall::bell(); }";
    let named = Vec::from_iter(parts_named_by(code, 2, "hall"));
    let expected = ["bell", "chair", "clock", "door", "lamp", "shelf", "table"];
    assert_eq!(named, expected);
}

/// What the parts of a room need of each other, by name, each with a file that says so.
type Needs = BTreeMap<String, BTreeMap<String, PathBuf>>;

/// Those of a room in a folder.
fn needs(room: &str, folder: &Path) -> Needs {
    let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let name = |path: &PathBuf| path.file_stem().unwrap().to_str().unwrap().to_owned();
    let is_part = |path: &PathBuf| path.is_dir() || path.extension().is_some_and(|e| e == "rs");
    let entries = entries.filter(is_part);
    let parts: BTreeMap<String, PathBuf> = entries.map(|path| (name(&path), path)).collect();
    let mut needs = Needs::new();
    for (part, path) in parts.iter().filter(|(part, _)| *part != "mod") {
        let needed = needs.entry(part.clone()).or_default();
        for file in files(path) {
            let (code, depth) = code_of(&file);
            let named = parts_named_by(&code, depth, room).into_iter();
            let others = named.filter(|name| name != part && parts.contains_key(name));
            needed.extend(others.map(|name| (name, file.clone())));
        }
    }
    needs
}

/// Parts that need each other in a circle, if there are any: from one of them back to it.
fn circle(mut needs: Needs) -> Option<Vec<String>> {
    let is_free = |needs: &Needs, part: &String| {
        let mut needed = needs[part].keys();
        !needed.any(|other| needs.contains_key(other))
    };
    while let Some(free) = needs.keys().find(|part| is_free(&needs, part)).cloned() {
        needs.remove(&free);
    }
    let mut way = vec![needs.keys().next()?.clone()];
    loop {
        let mut needed = needs[way.last().unwrap()].keys();
        let next = needed.find(|other| needs.contains_key(*other)).unwrap();
        let met = way.iter().position(|part| part == next);
        way.push(next.clone());
        if let Some(met) = met {
            return Some(way.split_off(met));
        }
    }
}

#[test]
fn circles_are_found() {
    let needs = |all: &[(&str, &[&str])]| -> Needs {
        let each = all.iter().map(|(part, needed)| {
            let needed = needed
                .iter()
                .map(|other| (other.to_string(), PathBuf::new()));
            (part.to_string(), needed.collect())
        });
        each.collect()
    };
    let pile: &[(&str, &[&str])] = &[("a", &["b", "c"]), ("b", &["c"]), ("c", &[])];
    assert_eq!(circle(needs(pile)), None);
    let tangle: &[(&str, &[&str])] = &[
        ("a", &["b"]),
        ("b", &["e", "c"]),
        ("c", &["d"]),
        ("d", &["b"]),
        ("e", &[]),
    ];
    let found = circle(needs(tangle)).unwrap();
    assert_eq!(found, ["b", "c", "d", "b"]);
}

/// Of two parts that need each other neither can be read, tested or moved alone.
#[test]
fn no_two_parts_of_a_room_need_each_other() {
    let mut found = 0;
    for (room, path) in rooms().iter().filter(|(_, path)| path.is_dir()) {
        let needs = needs(room, path);
        found += needs.values().map(BTreeMap::len).sum::<usize>();
        let Some(circle) = circle(needs.clone()) else {
            continue;
        };
        let steps = circle.windows(2);
        let steps =
            steps.map(|two| format!("{} names {}", needs[&two[0]][&two[1]].display(), two[1]));
        panic!(
            "src/{room} has parts that need each other, {}: move what both need into a file below both. {}",
            circle.join(" → "),
            Vec::from_iter(steps).join("; ")
        );
    }
    assert!(found > 500, "{found} needs were found");
}

/// What is decided by times is tested with times that a test makes up.
#[test]
fn the_schedule_has_no_clock() {
    let all = files(&src().join("schedule"));
    assert!(all.len() > 8, "{all:?}");
    for file in all {
        let (code, _) = code_of(&file);
        for clock in ["Instant", "SystemTime", "monotonic_ns"] {
            assert!(
                !code.contains(clock),
                "{} holds {clock}: expected times from who calls",
                file.display()
            );
        }
    }
}

#[test]
fn every_room_names_only_rooms_before_it() {
    let standing = rooms();
    assert!(
        standing.len() > 10,
        "expected the sources in {}",
        src().display()
    );
    let is_room = |name: &str| standing.iter().any(|(room, _)| room == name);
    for (room, path) in &standing {
        if JOINERS.contains(&room.as_str()) {
            continue;
        }
        let Some((_, may)) = ROOMS.iter().find(|(r, _)| r == room) else {
            panic!(
                "src/{room} is a room that tests/architecture.rs does not know: say there which rooms it may name"
            );
        };
        for file in files(path) {
            for other in named_in(&file).iter().filter(|n| *n != room && is_room(n)) {
                assert!(
                    may.contains(&other.as_str()),
                    "{} names crate::{other}, but src/{room} may name only {may:?}: \
                     move the code, or change the table in tests/architecture.rs and ARCHITECTURE.md with it",
                    file.display()
                );
            }
        }
    }
}

#[test]
fn only_instruments_reach_into_the_laboratory() {
    let instruments: Vec<PathBuf> = INSTRUMENTS.iter().map(|f| src().join(f)).collect();
    for file in files(&src().join("commands"))
        .iter()
        .filter(|f| !instruments.contains(f))
    {
        assert!(
            !named_in(file).contains("lab"),
            "{} names crate::lab, but what runs on a kiosk does without instruments: only {INSTRUMENTS:?} may",
            file.display()
        );
    }
}

/// A room that reads or computes has no business with raw memory; those that do are named here and in
/// `ARCHITECTURE.md`.
#[test]
fn unsafe_code_stays_where_it_is_known() {
    const MAY: &[&str] = &["capture", "engine", "supervise"];
    for (room, path) in rooms() {
        for file in files(&path) {
            let text = fs::read_to_string(&file).unwrap();
            let unsafe_code = text.lines().any(|l| {
                let code = l.split("//").next().unwrap();
                ["unsafe {", "unsafe fn", "unsafe impl"]
                    .iter()
                    .any(|u| code.contains(u))
            });
            assert!(
                !unsafe_code || MAY.contains(&room.as_str()),
                "{} holds unsafe code, which only {MAY:?} may: use a safe library, or name the room here",
                file.display()
            );
        }
    }
}

/// A driver may write to a camera's buffer at any time, and so may who feeds v4l2loopback: bytes are copied out of it.
#[test]
fn no_slice_leads_into_a_cameras_buffer() {
    for file in files(&src().join("capture/camera/v4l2")) {
        let text = fs::read_to_string(&file).unwrap();
        assert!(
            !text.contains("from_raw_parts"),
            "{} makes a slice of raw memory, which others may change under it: copy its bytes out",
            file.display()
        );
    }
}

/// Lines of the log that hold no words of their own in the source, and words that they have.
const MADE_ELSEWHERE: &[(&str, &str)] = &[
    ("{SCALAR_ONLY}", "only scalar kernels are left"),
    ("{}", "a picture takes"),
    ("{}: {} ({}), {}x{} {}", "at 30 fps"),
];

/// The first words of a line of the log that are the same in every such line.
fn fixed_words(template: &str) -> String {
    if let Some((_, words)) = MADE_ELSEWHERE.iter().find(|(t, _)| *t == template) {
        return (*words).to_owned();
    }
    let pieces = template
        .split('{')
        .map(|piece| piece.split_once('}').map_or(piece, |(_, rest)| rest));
    let letters = |piece: &&str| piece.chars().filter(|c| c.is_alphabetic()).count() >= 6;
    let piece = pieces.filter(letters).map(ToOwned::to_owned).next();
    let piece =
        piece.unwrap_or_else(|| panic!("'{template}': no words; give some in MADE_ELSEWHERE"));
    let words = piece.trim_start_matches(|c: char| !c.is_alphabetic());
    words
        .split_whitespace()
        .take(5)
        .collect::<Vec<_>>()
        .join(" ")
}

#[test]
fn every_line_of_the_log_is_explained() {
    let manual = src().with_file_name("docs").join("operate.md");
    let manual = fs::read_to_string(manual).unwrap();
    let table = manual.split("## What the log says").nth(1).unwrap();
    let table = table.split("\n## ").next().unwrap();
    let mut lines = 0;
    for file in files(&src()) {
        let text = fs::read_to_string(&file).unwrap();
        for level in ["error!(", "warn!(", "info!("] {
            for call in text.split(level).skip(1) {
                let template = call.split('"').nth(1).expect("a line of words");
                let words = fixed_words(template);
                assert!(
                    table.contains(&words),
                    "{}: docs/operate.md does not explain '{words}'",
                    file.display()
                );
                lines += 1;
            }
        }
    }
    assert!(lines > 15, "{lines} lines of the log were found");
}

/// Tables are as wide as they are, and commands are typed as they stand.
#[test]
fn comments_fit_the_page() {
    const WIDTH: usize = 120;
    let root = src().with_file_name("");
    let mut comments = 0;
    for room in [
        "src", "kernels", "clients", "tests", "benches", "examples", "fuzz/src",
    ] {
        for file in files(&root.join(room)) {
            for line in fs::read_to_string(&file).unwrap().lines() {
                let Some(words) = line.trim_start().strip_prefix("//") else {
                    continue;
                };
                comments += 1;
                let words = words.trim_start_matches(['/', '!']).trim_start();
                let is_kept = words.starts_with('|') || words.starts_with("cargo ");
                assert!(
                    is_kept || line.chars().count() <= WIDTH,
                    "{}: a comment of more than {WIDTH} characters: {line}",
                    file.display()
                );
            }
        }
    }
    assert!(comments > 1000, "{comments} comments were found");
}

/// So are tables and commands of documents; the log of training runs is written for a table's reader.
#[test]
fn documents_fit_the_page() {
    const WIDTH: usize = 120;
    let mut documents = documents();
    documents.retain(|document| !document.ends_with("RUNS.md"));
    assert!(documents.len() > 15, "{documents:?}");
    for document in documents {
        let mut is_command = false;
        for line in fs::read_to_string(&document).unwrap().lines() {
            let is_fence = line.trim_start().starts_with("```");
            is_command ^= is_fence;
            assert!(
                is_command || line.starts_with('|') || line.chars().count() <= WIDTH,
                "{}: a line of more than {WIDTH} characters: {line}",
                document.display()
            );
        }
    }
}

/// Every document of ours: those that git has, and new ones.
fn documents() -> Vec<PathBuf> {
    let root = src().with_file_name("");
    let mut documents: Vec<PathBuf> = ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"]
        .map(|name| root.join(name))
        .into();
    for room in [
        "benches", "clients", "deploy", "docs", "fuzz", "kernels", "models", "src",
    ] {
        let found = files_of(&root.join(room), "md").into_iter();
        documents.extend(found.filter(|f| !f.starts_with(root.join("fuzz/target"))));
    }
    documents
}

/// Where a document's links lead: all but those of code.
fn links(text: &str) -> Vec<String> {
    let mut is_code = false;
    let mut prose = String::new();
    for line in text.lines() {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        if !is_code && !is_fence {
            prose = prose + line + "\n";
        }
    }
    // Every second piece of a paragraph stands between two backticks.
    let pieces = prose.split("\n\n").flat_map(|p| p.split('`').step_by(2));
    let words: String = pieces.collect();
    let ends = words.split("](").skip(1);
    ends.filter_map(|rest| Some(rest.split_once(')')?.0.to_owned()))
        .collect()
}

/// What a heading is called in links: as GitHub does it.
fn anchor(heading: &str) -> String {
    let kept = |c: char| c.is_alphanumeric() || " -_".contains(c);
    let name: String = heading.chars().filter(|c| kept(*c)).collect();
    name.trim().to_lowercase().replace(' ', "-")
}

/// Headings of a document as links call them.
fn anchors(document: &Path) -> Vec<String> {
    let text = fs::read_to_string(document).unwrap();
    let headings = text.lines().filter(|line| line.starts_with('#'));
    headings
        .map(|h| anchor(h.trim_start_matches('#')))
        .collect()
}

#[test]
fn links_lead_somewhere() {
    let mut followed = 0;
    for document in documents() {
        let text = fs::read_to_string(&document).unwrap();
        for link in links(&text) {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            let (file, part) = link.split_once('#').unwrap_or((&link, ""));
            let target = match file {
                "" => document.clone(),
                file => document.with_file_name("").join(file),
            };
            let leads =
                target.exists() && (part.is_empty() || anchors(&target).contains(&part.into()));
            assert!(leads, "{}: '{link}' leads nowhere", document.display());
            followed += 1;
        }
    }
    assert!(followed > 60, "{followed} links were found");
}

/// The Debian package has documents in the same folders as the clone, with everything that they link to.
#[test]
fn packed_documents_link_to_what_is_packed() {
    let manifest: toml::Table = include_str!("../Cargo.toml").parse().unwrap();
    let assets = manifest["package"]["metadata"]["deb"]["assets"].as_array();
    let mut packed = BTreeSet::new();
    for asset in assets.unwrap() {
        let (from, to) = (asset[0].as_str().unwrap(), asset[1].as_str().unwrap());
        // What `install` has made links nowhere.
        if from.starts_with("target/package/") {
            continue;
        }
        let Some(to) = to.strip_prefix("usr/share/doc/edgecap/") else {
            continue;
        };
        let (folder, name) = from.rsplit_once('/').unwrap_or(("", from));
        assert_eq!(to.trim_end_matches('/'), folder, "{from}");
        let folder = src().with_file_name(folder);
        match name {
            "*" => packed.extend(fs::read_dir(folder).unwrap().map(|e| e.unwrap().path())),
            name => _ = packed.insert(folder.join(name)),
        }
    }
    let is_document = |path: &&PathBuf| path.extension().is_some_and(|e| e == "md");
    let mut followed = 0;
    for document in packed.iter().filter(is_document) {
        for link in links(&fs::read_to_string(document).unwrap()) {
            let file = link.split('#').next().unwrap();
            if file.is_empty() || link.contains("://") {
                continue;
            }
            let target = document.with_file_name(file).canonicalize().unwrap();
            let is_packed = packed.iter().any(|p| p.canonicalize().unwrap() == target);
            assert!(is_packed, "{}: '{link}' is not packed", document.display());
            followed += 1;
        }
    }
    assert!(followed > 50, "{followed} links were found");
}

/// A placeholder that waits for its row is no row.
#[test]
fn no_row_waits_to_be_written() {
    for document in documents() {
        let text = fs::read_to_string(&document).unwrap();
        let waiting = text.lines().find(|line| {
            let word = line.trim_matches(|c: char| c == '|' || c.is_whitespace());
            word.ends_with("ROW") && word.chars().all(|c| c.is_ascii_uppercase())
        });
        assert_eq!(waiting, None, "{}", document.display());
    }
}

/// The cell of a table's row, by the row's first cell.
fn cell<'a>(text: &'a str, row: &str, column: usize) -> &'a str {
    let cells = |line: &'a str| line.split('|').map(str::trim).collect::<Vec<_>>();
    let mut rows = text.lines().map(cells);
    let found = rows.find(|cells| cells.get(1).is_some_and(|first| first.ends_with(row)));
    found.unwrap_or_else(|| panic!("no row '{row}'"))[column]
}

/// Shares of time on one page are those of the times that the other page names as their source.
#[test]
fn shares_of_time_are_those_of_the_table_they_name() {
    let docs = src().with_file_name("docs");
    let page = |name: &str| fs::read_to_string(docs.join(name)).unwrap();
    let (accuracy, performance) = (page("accuracy.md"), page("performance.md"));
    let time = |row: &str| -> f64 {
        let cell = cell(&performance, row, 4);
        cell.trim_end_matches(" ms").parse().unwrap()
    };
    let whole = time("`infer`, as it comes");
    for (row, timed) in [
        ("15 a second", "`infer --looks 15`"),
        (
            "`--quality fast`: 15 a second, from 384×240 on",
            "`infer --quality fast`",
        ),
    ] {
        let told: f64 = cell(&accuracy, row, 5).parse().unwrap();
        let is = time(timed) / whole;
        assert!(
            (told - is).abs() <= 0.006,
            "{row}: {told} is told, {is:.3} measured"
        );
    }
}

/// A line that tells to run tests tells it so that Cargo finds them.
#[test]
fn every_test_target_that_is_named_exists() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut told = documents();
    for folder in ["src", "tests", "benches", "kernels", "clients"] {
        told.extend(files(&root.join(folder)));
    }
    told.extend(files_of(&root.join("tests/reference"), "py"));
    told.extend([".ci/kernels", ".ci/run"].map(|script| root.join(script)));
    let here = [
        root.join("tests"),
        root.join("kernels/tests"),
        root.join("clients/rust/tests"),
    ];
    let mut found = 0;
    for path in told {
        let Ok(text) = fs::read_to_string(&path) else {
            continue;
        };
        // Its own words below would count.
        for rest in text.split(concat!("--te", "st ")).skip(1) {
            let name: String = rest
                .chars()
                .take_while(|c| c.is_ascii_alphanumeric() || *c == '_')
                .collect();
            let is_target = |tests: &PathBuf| {
                tests.join(&name).join("main.rs").exists()
                    || tests.join(format!("{name}.rs")).exists()
            };
            let absent = format!("{}: no test target '{name}'", path.display());
            assert!(name.is_empty() || here.iter().any(is_target), "{absent}");
            found += usize::from(!name.is_empty());
        }
    }
    assert!(found > 10, "{found}");
}
