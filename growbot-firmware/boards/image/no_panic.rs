//! The firmware cannot panic: the linker finds no such function, so that an image in which a panic is left is no image.
//!
//! "undefined symbol: growbot_firmware_can_panic" means that somewhere an index, a slice, a division, an `expect` or
//! the like may fail as far as the compiler can tell. docs/decisions/0039-images-without-panics.md says how to find the
//! place.

use core::panic::PanicInfo;

unsafe extern "C" {
    safe fn growbot_firmware_can_panic() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    growbot_firmware_can_panic()
}
