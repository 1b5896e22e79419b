//! Prepares the build of a board. It does nothing for the desktop.

#[cfg(feature = "build-board")]
#[path = "build/board.rs"]
mod board;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=build");
    #[cfg(feature = "build-board")]
    board::prepare();
}
