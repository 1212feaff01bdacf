//! The library's name at run time, which programs that are linked with it look for.

use std::os::unix::fs::symlink;
use std::path::PathBuf;
use std::{env, fs};

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let part = |name: &str| env::var(format!("CARGO_PKG_VERSION_{name}")).expect("set by cargo");
    // Before 1.0 every minor version is another interface.
    let interface = match part("MAJOR").as_str() {
        "0" => format!("0.{}", part("MINOR")),
        major => major.to_owned(),
    };
    let name = format!("libedgecap_c.so.{interface}");
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,{name}");
    // For programs that are linked where cargo builds: <profile>/build/edgecap-c-<digits>/out is this script's own.
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("set by cargo"));
    let Some(profile) = out.ancestors().nth(3) else {
        return;
    };
    for folder in [profile.to_owned(), profile.join("deps")] {
        let link = folder.join(&name);
        // Where none can be made, whoever links there is told by the loader.
        if fs::symlink_metadata(&link).is_err() {
            let _ = symlink("libedgecap_c.so", link);
        }
    }
}
