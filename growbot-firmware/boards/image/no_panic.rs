//! The firmware cannot panic. The panic handler calls a function that no crate defines, so an image with a panic in it
//! does not link.
//!
//! The linker then says "undefined symbol: growbot_firmware_can_panic": as far as the compiler can tell, an index, a
//! slice, a division or an `expect` may fail. docs/decisions/0039-images-without-panics.md says how to find it.

use core::panic::PanicInfo;

unsafe extern "C" {
    safe fn growbot_firmware_can_panic() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    growbot_firmware_can_panic()
}
