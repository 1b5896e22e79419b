//! Compiles the C library behind the Python package `dubins`. `DUBINS_SOURCE` is its unpacked source package.

use std::env;
use std::path::PathBuf;

fn main() {
    println!("cargo::rerun-if-env-changed=DUBINS_SOURCE");
    let Some(source) = env::var_os("DUBINS_SOURCE").map(PathBuf::from) else {
        panic!("DUBINS_SOURCE is not set: build this by tests/peers/run, which fetches what it needs");
    };
    let library = source.join("dubins");
    let file = library.join("src/dubins.c");
    println!("cargo::rerun-if-changed={}", file.display());
    cc::Build::new().file(file).include(library.join("include")).opt_level(3).warnings(false).compile("dubins");
}
