//! Crashes of the firmware and damage to its image, in QEMU. The board retains and reports them, and it does not heat.

use std::path::{Path, PathBuf};

use growbot_client::client::{Client, ClientError};
use growbot_client::stop_signal::Permit;
use growbot_core::link::crash::CrashRecord;
use growbot_core::link::message::{
    BeginJob, Effect, Empty, Fault, HostSilencePolicy, ImageCheck, Message, Refusal, ResetCause, Start, State, Status,
    Tune,
};
use growbot_firmware::emulated_tip as table;
use growbot_plan::robot_file;
use growbot_sim::crash::{CrashReport, FirmwareImage};
use growbot_sim::image_seal::{SealError, is_sealed, seal, seal_in_place};
use growbot_sim::port::emulator::Emulator;
use growbot_tests::firmware;
use growbot_tests::tip_memory::TipMemoryView;
use object::{Object, ObjectSection, ObjectSymbol};

/// Returns a client of a board that runs this image, and a view of the memory that the board shares with its tip.
fn board(image: &Path) -> (Client, TipMemoryView) {
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let mut emulator = Emulator::start(&robot, Some(image)).unwrap();
    let words = TipMemoryView::of(&mut emulator);
    let mut client = Client::new(Box::new(emulator), "the emulated board");
    client.open_session_for(&robot).unwrap();
    (client, words)
}

/// Makes a board crash in the way `how`, and waits until it has restarted.
fn crash(words: &TipMemoryView, how: u32) {
    let boots = words.read(table::BOOTS);
    words.write(table::CRASH, how);
    words.wait("another boot", |words| words.read(table::BOOTS) != boots);
    words.write(table::CRASH, 0);
}

#[test]
fn a_crash_is_reported_after_the_reset_with_function_and_line() {
    let path = firmware("an386");
    let image = FirmwareImage::open(&path).unwrap();
    let (mut client, words) = board(&path);
    let report = client.boot_report().unwrap();
    assert_eq!((report.image, report.crash), (ImageCheck::Valid { crc: image.crc().unwrap() }, None));

    let nowhere = Some(format!("{:08x}", table::NOWHERE));
    for (how, cause, function, reason, address) in [
        (table::CRASH_BY_INSTRUCTION, ResetCause::ProcessorFault, "undefined_instruction", Some("UNDEFINSTR"), None),
        (table::CRASH_BY_ACCESS, ResetCause::ProcessorFault, "access_in_vain", Some("PRECISERR"), nowhere),
        (table::CRASH_BY_HANGING, ResetCause::Watchdog, "hang", None, None),
    ] {
        let boot_id = client.identify().unwrap().boot_id;
        crash(&words, how);
        let hello = client.open_session().unwrap();
        assert_eq!((hello.reset_cause, hello.status.state), (cause, State::Idle), "{function}");
        let words = client.boot_report().unwrap().crash.expect("the board knows of the crash");
        let crash = CrashReport::new(CrashRecord::from(&words), Some(&image));
        let text = crash.text();
        println!("{text}");
        assert_eq!((crash.record.cause, crash.record.boot_id), (cause, boot_id), "{function}");
        assert_eq!(crash.record.exception, if cause == ResetCause::Watchdog { 2 } else { 3 }, "{function}");
        assert_eq!(crash.record.image, image.crc(), "{function}");

        let json = serde_json::to_value(crash.to_json()).unwrap();
        let named = json["at"].as_array().unwrap().iter().find(|place| {
            place["function"].as_str().is_some_and(|name| name.ends_with(&format!("stack_monitor::{function}")))
        });
        let named = named.unwrap_or_else(|| panic!("{function} is not named: {json}"));
        assert!(named["file"].as_str().unwrap().ends_with("an386/stack_monitor.rs"), "{named}");
        let source = include_str!("../growbot-firmware/boards/an386/stack_monitor.rs");
        let lines: Vec<&str> = source.lines().collect();
        let line = named["line"].as_u64().unwrap() as usize;
        let begins = lines.iter().position(|line| line.contains(&format!("fn {function}("))).unwrap() + 1;
        assert!((begins..begins + 6).contains(&line), "line {line} of {function}, which begins at {begins}");
        assert!(text.contains(&format!("{function} (")), "{text}");
        let caller = json["called_from"].to_string();
        assert!(caller.contains("::run") || caller.contains("main"), "{caller}");

        let reasons: Vec<&str> = json["reasons"].as_array().unwrap().iter().filter_map(|it| it.as_str()).collect();
        assert_eq!(reasons, reason.into_iter().collect::<Vec<_>>(), "{function}");
        assert_eq!(json["address"].as_str(), address.as_deref(), "{function}");
    }

    // Overflow of the stack. The processor may be unable to save the registers here.
    let boots = words.read(table::BOOTS);
    words.write(table::OVERFLOW_STACK, 1);
    words.wait("another boot", |words| words.read(table::BOOTS) != boots);
    words.write(table::OVERFLOW_STACK, 0);
    assert_eq!(client.open_session().unwrap().reset_cause, ResetCause::StackOverflow);
    let words = client.boot_report().unwrap().crash.unwrap();
    let crash = CrashReport::new(CrashRecord::from(&words), Some(&image));
    println!("{}", crash.text());
    assert_eq!(crash.record.cause, ResetCause::StackOverflow);
    assert!(crash.text().contains("stack_monitor::overflow"), "{}", crash.text());
    // Another image is not mistaken for the one that crashed.
    let other = FirmwareImage::open(&firmware("stm32f405")).unwrap();
    let unknown = CrashReport::new(CrashRecord::from(&words), Some(&other));
    assert!(unknown.image.is_none(), "{}", unknown.text());
}

/// Returns the path of a sealed image with one flipped bit in a function. The function is not needed to start, respond
/// or switch off.
fn damaged(name: &str) -> PathBuf {
    let image = std::fs::read(firmware("an386")).unwrap();
    let file = object::File::parse(&*image).unwrap();
    let function = file
        .symbols()
        .filter(|symbol| symbol.name().is_ok_and(|name| name.contains("helicoids")) && symbol.size() > 64)
        .max_by_key(ObjectSymbol::size)
        .expect("the planner is in the image");
    let at = (function.address() & !1) + function.size() / 2;
    let mut bytes = seal(&image).unwrap().bytes;
    let text = file.section_by_name(".text").unwrap();
    let offset = text.file_range().unwrap().0 + at - text.address();
    bytes[offset as usize] ^= 0x04;
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn a_damaged_image_is_reported_and_never_heats() {
    let path = damaged("damaged");
    assert!(is_sealed(&std::fs::read(&path).unwrap()));
    let (mut client, words) = board(&path);
    let hello = client.identify().unwrap();
    assert_eq!((hello.status.state, hello.status.fault), (State::Fault, Some(Fault::ImageCorrupt)));
    let report = client.boot_report().unwrap();
    assert!(matches!(report.image, ImageCheck::Corrupt { sealed, found } if sealed != found), "{report:?}");

    let plan_id = 1;
    let requests = [
        Message::BeginJob(BeginJob { plan_id, layers: 8, robot_hash: hello.robot_hash }),
        Message::Start(Start { plan_id, on_host_silence: HostSilencePolicy::Continue, is_continuation: false }),
        Message::Tune(Tune { target_centi_c: 20_000 }),
        Message::ClearFault(Empty {}),
        Message::Start(Start { plan_id, on_host_silence: HostSilencePolicy::Continue, is_continuation: false }),
    ];
    for request in requests {
        let refused = match request.clone().effect() {
            Effect::Passive(request) => client.request("in vain", &request),
            Effect::Energizing(request) => client.energize("in vain", &request, &Permit::standalone()),
            Effect::FromBoard => panic!("a host sends no {request:?}"),
        };
        let refused = refused.unwrap_err();
        assert!(matches!(refused, ClientError::Refused { .. }), "{request:?}: {refused:?}");
        if request == Message::ClearFault(Empty {}) {
            let remains = Refusal::FaultRemains { fault: Fault::ImageCorrupt };
            assert!(matches!(refused, ClientError::Refused { refusal, .. } if refusal == remains), "{refused:?}");
        }
    }
    let Status { state, fault, .. } = client.status().unwrap();
    assert_eq!((state, fault), (State::Fault, Some(Fault::ImageCorrupt)));
    for output in [table::HEATER_DUTY, table::HEATER_ENABLE, table::HEAD_ENABLE, table::FEED_ENABLE] {
        assert_eq!(words.read(output), 0);
    }
}

#[test]
fn images_of_both_boards_are_sealed_over_every_byte() {
    for board in ["an386", "stm32f405"] {
        let image = std::fs::read(firmware(board)).unwrap();
        let sealed = seal(&image).unwrap();
        assert!(is_sealed(&sealed.bytes) && seal(&sealed.bytes).unwrap() == sealed, "{board}");
        // Any change of a byte that goes into flash changes the CRC.
        let file = object::File::parse(&*image).unwrap();
        let mut bytes = sealed.bytes.clone();
        for name in [".vector_table", ".text", ".rodata", ".data"] {
            let section = file.section_by_name(name).unwrap();
            let (offset, length) = section.file_range().unwrap();
            for at in (offset..offset + length).step_by(997).chain([offset + length - 1]) {
                if sealed.bytes[at as usize] == image[at as usize] {
                    bytes[at as usize] ^= 0x10;
                    let other = seal(&bytes).unwrap();
                    assert!(other.crc != sealed.crc, "{board}, byte {at} of the file");
                    bytes[at as usize] ^= 0x10;
                }
            }
        }
    }
    assert!(seal(b"no image").is_err());

    // Sealing in place works repeatedly, and never overwrites the seal of other bytes.
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("sealed");
    let image = std::fs::read(firmware("an386")).unwrap();
    let sealed = seal(&image).unwrap();
    std::fs::write(&path, &image).unwrap();
    for _ in 0..2 {
        assert_eq!(seal_in_place(&path).unwrap(), sealed.crc);
        assert_eq!(std::fs::read(&path).unwrap(), sealed.bytes);
    }
    let damaged = std::fs::read(damaged("damaged-by-hand")).unwrap();
    std::fs::write(&path, &damaged).unwrap();
    assert!(matches!(seal_in_place(&path), Err(SealError::Damaged { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), damaged);
}
