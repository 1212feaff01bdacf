//! The page that shows everyone in three dimensions: files that lie in the program, so that it needs no network and no
//! folder.

use std::borrow::Cow;

use crate::http::{Answer, Request};

/// A file of the page.
struct Asset {
    path: &'static str,
    kind: &'static str,
    body: &'static [u8],
}

const HTML: &str = "text/html; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Packed with gzip, which every browser unpacks.
const PACKED: &str = "/three.min.js";

const ASSETS: [Asset; 14] = [
    Asset {
        path: "/",
        kind: HTML,
        body: include_bytes!("assets/index.html"),
    },
    Asset {
        path: "/style.css",
        kind: STYLE,
        body: include_bytes!("assets/style.css"),
    },
    Asset {
        path: "/main.js",
        kind: SCRIPT,
        body: include_bytes!("assets/main.js"),
    },
    Asset {
        path: "/load.js",
        kind: SCRIPT,
        body: include_bytes!("assets/load.js"),
    },
    Asset {
        path: "/connections.js",
        kind: SCRIPT,
        body: include_bytes!("assets/connections.js"),
    },
    Asset {
        path: "/decode.js",
        kind: SCRIPT,
        body: include_bytes!("assets/decode.js"),
    },
    Asset {
        path: "/happened.js",
        kind: SCRIPT,
        body: include_bytes!("assets/happened.js"),
    },
    Asset {
        path: "/health.js",
        kind: SCRIPT,
        body: include_bytes!("assets/health.js"),
    },
    Asset {
        path: "/history.js",
        kind: SCRIPT,
        body: include_bytes!("assets/history.js"),
    },
    Asset {
        path: "/orbit.js",
        kind: SCRIPT,
        body: include_bytes!("assets/orbit.js"),
    },
    Asset {
        path: "/panel.js",
        kind: SCRIPT,
        body: include_bytes!("assets/panel.js"),
    },
    Asset {
        path: "/picture.js",
        kind: SCRIPT,
        body: include_bytes!("assets/picture.js"),
    },
    Asset {
        path: "/space.js",
        kind: SCRIPT,
        body: include_bytes!("assets/space.js"),
    },
    Asset {
        path: PACKED,
        kind: SCRIPT,
        body: include_bytes!("assets/three.min.js.gz"),
    },
];

/// Nothing that the page does leaves this server.
const POLICY: (&str, &str) = (
    "Content-Security-Policy",
    "default-src 'self'; img-src data:",
);
/// Another build may serve other files at the same address.
const FRESH: (&str, &str) = ("Cache-Control", "no-cache");

/// The file that a request asks for; `None` where the page has none of that name.
pub fn answer(request: &Request) -> Option<Answer> {
    let asset = ASSETS.iter().find(|a| a.path == request.path)?;
    Some(Answer::Body {
        status: "200 OK",
        kind: asset.kind,
        headers: match asset.path {
            PACKED => &[POLICY, FRESH, ("Content-Encoding", "gzip")],
            _ => &[POLICY, FRESH],
        },
        body: Cow::Borrowed(asset.body),
    })
}
