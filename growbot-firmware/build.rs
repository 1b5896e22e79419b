//! Build script. It prepares the build of a board's firmware, and does nothing in a build for the desktop.

#[cfg(feature = "build-board")]
#[path = "build/board.rs"]
mod board;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=build");
    #[cfg(feature = "build-board")]
    board::prepare();
}
