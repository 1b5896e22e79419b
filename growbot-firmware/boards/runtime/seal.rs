//! The seal of this firmware image: written after linking, checked at each start (`growbot_firmware::image_seal`).

use growbot_core::link::message::ImageCheck;
use growbot_firmware::image_seal::{self, EMPTY, Seal};

/// The seal of this image. Its content in flash may differ from this initial value, because it is written after
/// linking.
#[used]
#[unsafe(no_mangle)]
static GROWBOT_IMAGE_SEAL: Seal = EMPTY;

unsafe extern "C" {
    /// Linker symbol at the beginning of the firmware's flash. `_image_end` is at its end. Only their addresses are
    /// used.
    static _image_start: u32;
    static _image_end: u32;
}

/// Returns the seal in flash.
fn read() -> Seal {
    // SAFETY: a static of that type, which is never written to while the firmware runs.
    unsafe { (&raw const GROWBOT_IMAGE_SEAL).read_volatile() }
}

/// Returns the CRC that the seal contains; 0 for an image without a seal.
pub fn stated() -> u32 {
    let [_, crc, ..] = read();
    crc
}

/// Checks the firmware image in flash against its seal.
pub fn check() -> ImageCheck {
    let flash = &raw const _image_start as u32..&raw const _image_end as u32;
    image_seal::check(&read(), |address| {
        // SAFETY: a byte of the firmware's flash, which is only read.
        flash.contains(&address).then(|| unsafe { (address as *const u8).read_volatile() })
    })
}
