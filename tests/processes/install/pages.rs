//! Manual pages and completions.

use super::install;
use crate::program::{edgecap, stdout};

/// What one process of ours says to another is no option for people.
fn assert_no_hidden_option(what: &str, text: &str) {
    let words = || text.split(|c: char| !c.is_ascii_alphanumeric() && c != '-');
    // Fish writes `-l job`.
    let long: Vec<&str> = words()
        .zip(words().skip(1))
        .filter_map(|(a, b)| match a {
            "-l" => Some(b),
            _ => b.strip_prefix("--"),
        })
        .collect();
    assert!(
        long.contains(&"help"),
        "{what}: what is looked at are options"
    );
    let hidden = ["job"];
    assert!(!long.iter().any(|o| hidden.contains(o)), "{what}: {long:?}");
}

#[test]
fn pages_and_completions_know_the_verbs() {
    for (shell, word) in [
        ("bash", "complete -F _edgecap"),
        ("zsh", "#compdef edgecap"),
        ("fish", "complete -c edgecap"),
    ] {
        let out = edgecap().args(["completions", shell]).output().unwrap();
        let script = String::from_utf8(out.stdout).unwrap();
        assert!(script.contains(word), "{shell}");
        for word in [
            "doctor",
            "list-controls",
            "capture-size",
            "dry-run",
            "version",
        ] {
            assert!(script.contains(word), "{shell}: {word}");
        }
        assert_no_hidden_option(shell, &script);
    }
    let root = tempfile::tempdir().unwrap();
    install(root.path(), &["--system"]);
    let pages = root.path().join("usr/local/share/man/man1");
    for page in std::fs::read_dir(pages).unwrap().flatten() {
        let text = std::fs::read_to_string(page.path()).unwrap();
        let bare = ["\\fB", "\\fI", "\\fR"]
            .iter()
            .fold(text, |t, font| t.replace(font, " "));
        let plain = bare.replace("\\-", "-");
        assert_no_hidden_option(&format!("{page:?}"), &plain);
    }
}

/// Another version had verbs that this one does not know; others may have pages of such names.
#[test]
fn pages_of_verbs_that_are_gone_go() {
    let root = tempfile::tempdir().unwrap();
    let pages = root.path().join("usr/local/share/man/man1");
    let at = |name: &str| pages.join(name);
    let title = |verb: &str, source: &str| format!(".ie x\n.TH edgecap-{verb} 1  {source}\n");
    std::fs::create_dir_all(&pages).unwrap();
    let theirs = title("theirs", "\"another 0.1.0\" another");
    std::fs::write(at("edgecap-theirs.1"), theirs).unwrap();
    for more in [&[][..], &["--uninstall"]] {
        let gone = title("gone", "\"edgecap 0.0.9\" edgecap");
        std::fs::write(at("edgecap-gone.1"), gone).unwrap();
        let said = stdout(&install(root.path(), &[&["--system"], more].concat()));
        let is_said = |name: &str| {
            let line = format!("remove    {}", at(name).display());
            said.lines().any(|l| l == line)
        };
        assert!(
            is_said("edgecap-gone.1") && !at("edgecap-gone.1").exists(),
            "{said}"
        );
        assert_eq!(at("edgecap-run.1").exists(), more.is_empty());
        assert!(at("edgecap-theirs.1").exists());
    }
}
