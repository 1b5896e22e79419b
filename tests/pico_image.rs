//! Requirements of the Pico's image: a small size, no panics, and interrupts that need nothing in flash.

use growbot_tests::pico_firmware;
use object::{Object, ObjectSection, ObjectSymbol};

/// Max size of the image in the flash chip, bytes.
const FLASH: u64 = 512 * 1024;
/// Max size of the image in memory with the stack, bytes.
const RAM: u64 = 200 * 1024;
/// Size of the stack, bytes.
const STACK: u64 = 64 * 1024;
/// Address range of the image in flash.
const MAPPED: std::ops::Range<u32> = 0x1000_0000..0x1008_0000;
/// Start address of the RAM.
const MEMORY: u64 = 0x2000_0000;

const FLASH_SECTIONS: [&str; 6] = [".boot2", ".vector_table", ".text", ".rodata", ".data", ".interrupts"];
const RAM_SECTIONS: [&str; 4] = [".data", ".interrupts", ".bss", ".uninit"];

/// Functions of the firmware that the linker places in memory, because an interrupt executes them. The processor
/// would read any other function from flash, which is impossible while the flash is written.
const FUNCTIONS_IN_RAM: [&str; 19] = [
    "growbot_firmware::stepping::axis_move::AxisMoveRun::tick",
    "growbot_firmware::stepping::engine::Engine::finish",
    "growbot_firmware::stepping::engine::Engine::release",
    "growbot_firmware::stepping::engine::Engine::start_sector",
    "growbot_firmware::stepping::index_monitor::read_index_sensor",
    "growbot_firmware::stepping::mailbox::Mailbox::can_accept_move",
    "growbot_firmware::stepping::mailbox::Mailbox::discard_move",
    "growbot_firmware::stepping::mailbox::Mailbox::pop_ended_move",
    "growbot_firmware::stepping::mailbox::Mailbox::submit",
    "growbot_firmware::stepping::mailbox::Mailbox::take_link_stop",
    "growbot_firmware::stepping::ramp::VirtualClock::can_brake",
    "growbot_firmware::stepping::stepper::Stepper::enable",
    "pico::pins::make_safe",
    "pico::reset::reset_on_clock_failure",
    "pico::reset::restart",
    "pico::uart::check_for_emergency_stop",
    "pico::usb::Device::configure",
    "pico::usb::Device::send_reply",
    "pico::usb::drop_queued",
];

/// Returns the path of a function of growbot's crates from its mangled name, without type parameters and hash.
fn function_path(mangled: &str) -> Option<String> {
    let mut rest = mangled.strip_prefix("_ZN")?;
    let mut path: Vec<&str> = Vec::new();
    while let Some(digits) = rest.find(|letter: char| !letter.is_ascii_digit()).filter(|digits| *digits > 0) {
        let (length, after) = rest.split_at(digits);
        let (segment, next) = after.split_at_checked(length.parse().ok()?)?;
        path.push(segment.split('$').next()?);
        rest = next;
    }
    path.pop();
    matches!(*path.first()?, "growbot_firmware" | "pico").then(|| path.join("::"))
}

fn size(file: &object::File, names: &[&str]) -> u64 {
    names.iter().map(|name| file.section_by_name(name).map_or(0, |section| section.size())).sum()
}

#[test]
fn an_image_for_any_robot_is_small_and_its_interrupts_run_from_ram() {
    check_image("none");
}

#[test]
fn images_with_a_robot_are_small_and_their_interrupts_run_from_ram() {
    for robot in ["growbot-a", "growbot-a2"] {
        check_image(robot);
    }
}

fn check_image(robot: &str) {
    let image = std::fs::read(pico_firmware(robot)).unwrap();
    let file = object::File::parse(&*image).unwrap();
    let (flash, ram) = (size(&file, &FLASH_SECTIONS), size(&file, &RAM_SECTIONS) + STACK);
    println!("pico for {robot}: {flash} B of flash (at most {FLASH}), {ram} B of RAM (at most {RAM})");
    assert!(flash < FLASH && ram < RAM, "{flash} B of flash, {ram} B of RAM");

    let symbols: Vec<_> = file.symbols().filter_map(|symbol| Some((symbol.name().ok()?, symbol.address()))).collect();
    for interrupt in ["PWM_IRQ_WRAP", "UART0_IRQ", "USBCTRL_IRQ"] {
        assert!(symbols.iter().any(|(name, address)| *name == interrupt && *address >= MEMORY), "{interrupt}");
    }
    let section = file.section_by_name(".interrupts").unwrap().index();
    let in_ram = file.symbols().filter(|symbol| symbol.section_index() == Some(section));
    let mut in_ram: Vec<_> = in_ram.filter_map(|symbol| function_path(symbol.name().ok()?)).collect();
    in_ram.sort();
    assert_eq!(in_ram, FUNCTIONS_IN_RAM, "functions in memory of the image for {robot}");
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
