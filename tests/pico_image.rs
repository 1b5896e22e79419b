//! Requirements of the Pico's image: a small size, no panics, and interrupts that need nothing in flash.

use growbot_tests::pico_firmware;
use object::{Object, ObjectSection, ObjectSymbol};

/// Max sizes of the image in the flash chip and in memory, the stack included, bytes.
const FLASH: u64 = 512 * 1024;
const RAM: u64 = 200 * 1024;
const STACK: u64 = 64 * 1024;
/// Address range of the image in flash.
const MAPPED: std::ops::Range<u32> = 0x1000_0000..0x1008_0000;
/// Start of memory.
const MEMORY: u64 = 0x2000_0000;

const FLASH_SECTIONS: [&str; 6] = [".boot2", ".vector_table", ".text", ".rodata", ".data", ".interrupts"];
const RAM_SECTIONS: [&str; 4] = [".data", ".interrupts", ".bss", ".uninit"];

fn size(file: &object::File, names: &[&str]) -> u64 {
    names.iter().map(|name| file.section_by_name(name).map_or(0, |section| section.size())).sum()
}

#[test]
fn the_picos_image_is_small_and_its_interrupts_run_from_ram() {
    for robot in ["growbot-a", "growbot-a2"] {
        let image = std::fs::read(pico_firmware(robot)).unwrap();
        let file = object::File::parse(&*image).unwrap();
        let (flash, ram) = (size(&file, &FLASH_SECTIONS), size(&file, &RAM_SECTIONS) + STACK);
        println!("pico for {robot}: {flash} B of flash (at most {FLASH}), {ram} B of RAM (at most {RAM})");
        assert!(flash < FLASH && ram < RAM, "{flash} B of flash, {ram} B of RAM");

        let symbols: Vec<_> =
            file.symbols().filter_map(|symbol| Some((symbol.name().ok()?, symbol.address()))).collect();
        for interrupt in ["PWM_IRQ_WRAP", "UART0_IRQ", "USBCTRL_IRQ"] {
            assert!(symbols.iter().any(|(name, address)| *name == interrupt && *address >= MEMORY), "{interrupt}");
        }
        // A call between flash and memory exceeds the range of a branch, so the linker puts a thunk beside the caller.
        let thunks = || symbols.iter().filter(|(name, _)| name.contains("LongThunk"));
        let from_memory: Vec<_> = thunks().filter(|(_, address)| *address >= MEMORY).collect();
        assert!(thunks().next().is_some(), "no thunk leads from flash to memory: does the linker name them otherwise?");
        assert!(from_memory.is_empty(), "calls from memory into flash: {from_memory:?}");
        // Interrupts read no constants or jump tables in flash either.
        let interrupts = file.section_by_name(".interrupts").unwrap();
        let (words, _) = interrupts.data().unwrap().as_chunks();
        let read: Vec<_> =
            words.iter().map(|word| u32::from_le_bytes(*word)).filter(|word| MAPPED.contains(word)).collect();
        assert!(read.is_empty(), "addresses of the flash in code in memory: {read:x?}");
        assert!(!symbols.iter().any(|(name, _)| name.contains("panicking") || name.contains("panic_fmt")));
    }
}
