//! The seal of this image: filled in after linking, checked at each start (`growbot_firmware::image_seal`).

use growbot_core::link::message::ImageCheck;
use growbot_firmware::image_seal::{self, EMPTY, Seal};

/// The place of the seal. What is in flash may differ from what the compiler has put here.
#[used]
#[unsafe(no_mangle)]
static GROWBOT_IMAGE_SEAL: Seal = EMPTY;

unsafe extern "C" {
    /// Where the firmware's flash begins and ends in the memory map. Addresses only.
    static _image_start: u32;
    static _image_end: u32;
}

/// The seal as it is in flash.
fn read() -> Seal {
    // SAFETY: a static of that type, which is never written to while this runs.
    unsafe { (&raw const GROWBOT_IMAGE_SEAL).read_volatile() }
}

/// The CRC that the seal states; 0 for an image without one.
pub fn stated() -> u32 {
    let [_, crc, ..] = read();
    crc
}

/// Checks the image.
pub fn check() -> ImageCheck {
    let flash = &raw const _image_start as u32..&raw const _image_end as u32;
    image_seal::check(&read(), |address| {
        // SAFETY: a byte of the firmware's flash, which is only read.
        flash.contains(&address).then(|| unsafe { (address as *const u8).read_volatile() })
    })
}
