//! Does nothing: build dependencies count only where there is a build script (Cargo.toml says what they are for).

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
}
