//! Requests: the page, strangers who are refused, tokens.

use std::time::Duration;

use edgecap_client::Publisher;
use edgecap_client::message::BodyFrame;

use super::{View, heard};
use crate::program::{assert_fails, signal, stderr};

#[test]
fn the_page_is_in_the_program_and_strangers_are_refused() {
    let view = View::start("page", &[]);
    let (head, page) = view.get("/", "");
    assert!(head.starts_with("HTTP/1.1 200 OK"), "{head}");
    assert!(head.contains("default-src 'self'"), "{head}");
    let page = String::from_utf8(page).unwrap();
    assert!(page.contains("main.js") && !page.contains("//"), "{page}");
    let (head, packed) = view.get("/three.min.js", "");
    assert!(head.contains("Content-Encoding: gzip") && packed.starts_with(&[0x1f, 0x8b]));
    let (head, nothing) = view.ask("HEAD", "/", "");
    let length = format!("Content-Length: {}\r\n", page.len());
    assert!(head.starts_with("HTTP/1.1 200 OK") && head.contains(&length));
    assert_eq!(nothing, b"");
    let key = "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: c2hvcnQ=\r\n";
    for (method, path, headers, status, says) in [
        ("GET", "/nothing", "", "404", ""),
        ("GET", "/bodies", "", "426", "\r\nUpgrade: websocket\r\n"),
        (
            "GET",
            "/bodies",
            "",
            "426",
            "\r\nSec-WebSocket-Version: 13\r\n",
        ),
        ("GET", "/bodies", key, "400", ""),
        ("GET", "/bodies?format=xml", "", "400", ""),
        (
            "GET",
            "/bodies?format=binary&history=1&seconds=few",
            "",
            "400",
            "",
        ),
        (
            "GET",
            "/bodies",
            "Origin: http://evil.example\r\n",
            "403",
            "",
        ),
        ("POST", "/", "", "405", "\r\nAllow: GET, HEAD\r\n"),
    ] {
        let (head, line) = view.ask(method, path, headers);
        assert!(
            head.starts_with(&format!("HTTP/1.1 {status}")) && head.contains(says),
            "{method} {path}: {head}"
        );
        assert_eq!(line.iter().filter(|b| **b == b'\n').count(), 1, "{path}");
    }
    assert_fails(
        &["view", "--listen", view.host()],
        69,
        &["--listen", "choose another address"],
    );
    assert_fails(
        &["bridge", "--view", view.host()],
        69,
        &["--view", "choose another address"],
    );
    assert_fails(&["view", "--camera", "a/b"], 64, &["a/b"]);
    signal(view.run.pid(), "INT");
    let out = view.run.wait(Duration::from_secs(60));
    assert_eq!(out.status.code(), Some(0), "{}", stderr(&out));
}

#[test]
fn with_a_token_only_who_knows_it_reads() {
    let view = View::start("token", &["--token", "open-sesame"]);
    assert!(view.url.ends_with("/?token=open-sesame"), "{}", view.url);
    for path in ["/bodies", "/bodies?token=open-sesam", "/bodies?token="] {
        assert!(view.get(path, "").0.starts_with("HTTP/1.1 403"), "{path}");
    }
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let mut client = view.connect("?token=open-sesame");
    heard(&mut publisher, &mut client);
}
