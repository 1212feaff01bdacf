//! From a source in C or C++ to a program that is linked with the library.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::tools;

pub const HERE: &str = env!("CARGO_MANIFEST_DIR");
/// Compiler, standard, language.
pub const C: [&str; 3] = ["cc", "-std=c99", "-xc"];
pub const CPP: [&str; 3] = ["c++", "-std=c++11", "-xc++"];

/// The folder that cargo puts the library in: beside the tests.
pub fn libraries() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    test.parent().unwrap().to_owned()
}

/// Compiles a source with all warnings as errors and links it with the library; `None` without the compiler.
pub fn compile([compiler, standard, language]: [&str; 3], source: &Path) -> Option<PathBuf> {
    if !tools::has(compiler) {
        return None;
    }
    let (libraries, program) = (libraries(), source.with_extension(compiler));
    run(Command::new(compiler)
        .args([standard, "-Wall", "-Wextra", "-Wpedantic", "-Werror"])
        .arg(language)
        .arg(source)
        .arg("-o")
        .arg(&program)
        .args([&format!("-I{HERE}/include"), "-ledgecap_c"])
        .arg(format!("-L{}", libraries.display()))
        .arg(format!("-Wl,-rpath,{}", libraries.display())));
    Some(program)
}

/// Writes a source into `folder` and compiles it.
pub fn program(folder: &Path, name: &str, how: [&str; 3], text: &str) -> Option<PathBuf> {
    let source = folder.join(name);
    std::fs::write(&source, text).unwrap();
    compile(how, &source)
}

/// What a command that must succeed writes.
pub fn run(command: &mut Command) -> String {
    let out = command.output().unwrap();
    assert!(
        out.status.success(),
        "{command:?}\n{}{}",
        String::from_utf8_lossy(&out.stdout),
        String::from_utf8_lossy(&out.stderr)
    );
    String::from_utf8(out.stdout).unwrap()
}
