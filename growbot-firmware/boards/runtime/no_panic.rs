//! The guarantee that the firmware cannot panic. The panic handler calls a function that no crate defines, so that an
//! image with a panic in it does not link.
//!
//! In that case the linker prints "undefined symbol: growbot_firmware_can_panic". It means that, as far as the compiler
//! can prove, an index, a slice, a division or an `expect` may fail. CONTRIBUTING.md shows how to find it.
//!
//! Free of panics are iterators, `zip`, `get`, `split_first`, slice patterns, `checked_` functions, constant indices
//! into arrays, and indices that a loop over a constant range counts. Panics may come from computed indices, `collect`
//! into a heapless vector and its `insert` and `into_iter`, heapless' `spsc`, division by a number that may be 0,
//! nalgebra's `column`, `lu` and `cholesky`, `cobs::decode`, the HAL's clocks, and `defmt-rtt`.

use core::panic::PanicInfo;

unsafe extern "C" {
    safe fn growbot_firmware_can_panic() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    growbot_firmware_can_panic()
}
