//! The firmware cannot panic. The panic handler calls a function that no crate defines, so an image with a panic in it
//! does not link.
//!
//! The linker then says "undefined symbol: growbot_firmware_can_panic": as far as the compiler can tell, an index, a
//! slice, a division or an `expect` may fail. CONTRIBUTING.md shows how to find it.
//!
//! Free of panics are iterators, `zip`, `get`, `split_first`, slice patterns, `checked_` functions, constant indices
//! into arrays, and indices that a loop over a constant range counts. These are not: computed indices, `collect` into
//! a heapless vector and its `insert` and `into_iter`, heapless' `spsc`, division by what may be 0, nalgebra's
//! `column`, `lu` and `cholesky`, `cobs::decode`, the HAL's clocks, `defmt-rtt`.

use core::panic::PanicInfo;

unsafe extern "C" {
    safe fn growbot_firmware_can_panic() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    growbot_firmware_can_panic()
}
