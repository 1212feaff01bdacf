//! What wins: a flag over the file, and of the file the camera or film that is named.

use super::config;
use crate::program::{self, edgecap, stdout};

#[test]
fn flags_win_over_the_file_and_everything_says_where_it_came_from() {
    let text = "[[camera]]\nname = \"hall\"\ninput = \"demo\"\nfps = 25.0\nlens = { fov_degrees = 75.3 }\n\
                [network]\nthreads = 2\nflip_test = true\n[fit.identity]\nmemory = 30.0\n";
    let out = config("print", text, &["--fps", "10", "--size", "384x240"]);
    let said = stdout(&out);
    let line = |start: &str| {
        let found = said.lines().find(|l| l.starts_with(start));
        let words: Vec<&str> = found
            .unwrap_or_else(|| panic!("{start}: {said}"))
            .split_whitespace()
            .collect();
        words.join(" ")
    };
    assert_eq!(line("name "), "name = \"hall\" # line 2");
    assert_eq!(line("fps "), "fps = 10.0 # typed");
    assert_eq!(line("lens "), "lens = { fov_degrees = 75.3 } # line 5");
    assert_eq!(line("size "), "size = \"384x240\" # typed");
    assert_eq!(line("threads "), "threads = 2 # line 7");
    assert_eq!(line("flip_test "), "flip_test = true # line 8");
    assert_eq!(line("memory "), "memory = 30.0 # line 10");
    assert_eq!(line("hold "), "hold = 2.5 # default");
    assert_eq!(line("#model "), "#model = # default");
    // What it prints is a file that means the same.
    let again = stdout(&config("print", &said, &[]));
    let values = |text: &str| -> Vec<String> {
        text.lines()
            .skip(1)
            .map(|l| l.split(" # ").next().unwrap().trim().to_owned())
            .collect()
    };
    assert_eq!(values(&again), values(&said));
}

#[test]
fn a_typed_size_or_quality_silences_the_other_one_of_the_file() {
    let line = |text: &str, more: &[&str], start: &str| {
        let said = stdout(&config("print", text, more));
        said.lines()
            .find(|l| l.starts_with(start))
            .map(str::to_owned)
    };
    let quality = "[network]\nquality = \"fast\"\n";
    let typed = ["--size", "384x240"];
    assert!(line(quality, &typed, "size = \"384x240\"").is_some());
    assert!(line(quality, &typed, "#quality =").is_some());
    let size = "[network]\nsize = \"384x240\"\n";
    let typed = ["--quality", "fast"];
    assert!(line(size, &typed, "quality = \"fast\"").is_some());
    assert!(line(size, &typed, "#size =").is_some());
    let looks = "[network]\nlooks = 10.0\n";
    assert!(line(looks, &["--quality", "best"], "#looks =").is_some());
    assert!(line(looks, &["--quality", "fast"], "looks = 10").is_some());
    let best = "[network]\nquality = \"best\"\n";
    assert!(line(best, &["--looks", "5"], "#quality =").is_some());
}

#[test]
fn a_run_takes_the_camera_that_is_named_and_a_film_takes_none() {
    let text =
        "[[camera]]\nname = \"hall\"\ninput = \"a.avi\"\n[[camera]]\nlens = { fov_degrees = 80 }\n";
    let cameras = |more: &[&str]| {
        stdout(&config("print", text, more))
            .matches("[[camera]]")
            .count()
    };
    assert_eq!(cameras(&[]), 2);
    let hall = stdout(&config("print", text, &["--name", "hall"]));
    assert!(
        hall.contains("/a.avi\""),
        "from the file's folder on: {hall}"
    );
    assert_eq!(cameras(&["--name", "hall"]), 1);
    let other = stdout(&config("print", text, &["--name", "camera1"]));
    assert!(other.contains("fov_degrees = 80"), "{other}");
    let film = stdout(&config("print", text, &["--input", "b.avi"]));
    assert!(film.contains("#lens ="), "another's lens: {film}");
    let out = config("print", text, &["--name", "yard"]);
    assert_eq!(out.status.code(), Some(64));
    assert!(program::stderr(&out).contains("one of hall, camera1"));
}

/// Its people are nobody in front of the cameras: a run hands them on nowhere that was not typed.
#[test]
fn bridges_of_the_settings_are_not_printed_for_another_film() {
    let text = "[bridges]\nosc = \"127.0.0.1:9000\"\ntoken = \"open-sesame\"\n\
        [[camera]]\ninput = \"hall.y4m\"\n";
    let printed = |more: &[&str]| stdout(&config("print", text, more));
    let film = printed(&["--input", "walk.y4m"]);
    assert!(film.contains("#osc ="), "{film}");
    let of_a_page = film.lines().find(|line| line.starts_with("token = "));
    assert!(of_a_page.unwrap().ends_with("# line 3"), "{film}");
    let told = printed(&["--input", "walk.y4m", "--osc", "127.0.0.1:9001"]);
    let typed = told.lines().find(|line| line.starts_with("osc = "));
    assert!(
        typed.is_some_and(|line| line.contains("9001") && line.ends_with("# typed")),
        "{told}"
    );
    for camera in [
        &[][..],
        &["--input", "walk.y4m", "--live"],
        &["--input", "/dev/video0"],
    ] {
        let said = printed(camera);
        assert!(said.contains("osc = \"127.0.0.1:9000\""), "{said}");
    }
}

#[test]
fn a_film_of_the_file_is_known_by_every_path() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("hall.avi"), "").unwrap();
    std::os::unix::fs::symlink(at("hall.avi"), at("link.avi")).unwrap();
    let text = "[[camera]]\nname = \"lobby\"\ninput = \"hall.avi\"\nrotate = 90\n";
    std::fs::write(at("edgecap.toml"), text).unwrap();
    let print = |more: &[&str]| {
        let mut command = edgecap();
        command.args(["config", "print", "--config", "edgecap.toml"]);
        stdout(
            &command
                .args(more)
                .current_dir(folder.path())
                .output()
                .unwrap(),
        )
    };
    let value = |said: &str, key: &str| {
        let line = said.lines().find(|l| l.starts_with(key));
        let words: Vec<&str> = line.unwrap_or_default().split_whitespace().collect();
        words.join(" ")
    };
    let whole = at("hall.avi");
    for input in [
        "hall.avi",
        "./hall.avi",
        "link.avi",
        whole.to_str().unwrap(),
    ] {
        let said = print(&["--input", input]);
        assert_eq!(value(&said, "name"), "name = \"lobby\" # line 2", "{input}");
        assert_eq!(value(&said, "rotate"), "rotate = 90 # line 4", "{input}");
    }
    // Another name for its bodies is no other camera.
    let named = print(&["--input", "hall.avi", "--name", "foyer"]);
    assert_eq!(value(&named, "name"), "name = \"foyer\" # typed");
    assert_eq!(value(&named, "rotate"), "rotate = 90 # line 4");
    let other = print(&["--input", "other.avi"]);
    assert_eq!(value(&other, "#rotate"), "#rotate = # default");
    let upright = print(&["--input", "hall.avi", "--rotate", "0"]);
    assert_eq!(value(&upright, "rotate"), "rotate = 0 # typed");
}
