//! Build stamp and, once weights are shipped, their digest check and embedding.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
}
