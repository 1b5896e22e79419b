//! The Pico's image as it is shipped, in the emulator: sealed and as a UF2 file. The board reports a damaged image and
//! does not heat. After a reset it reports a crash or a stopped crystal.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

use growbot_client::client::{Client, ClientError};
use growbot_client::port::Port;
use growbot_client::stop_signal::Permit;
use growbot_core::link::crash::CrashRecord;
use growbot_core::link::message::{
    BeginJob, Effect, Empty, EnergizingRequest, Fault, HostSilencePolicy, ImageCheck, Message, Refusal, ResetCause,
    Start, State, Tune,
};
use growbot_plan::robot_file;
use growbot_sim::crash::{CrashReport, FirmwareImage};
use growbot_sim::image_seal::seal;
use growbot_sim::port::rp2040::{self, Rp2040Emulator};
use growbot_sim::uf2;
use growbot_tests::pico_firmware;
use object::{Object, ObjectSection, ObjectSymbol};

/// Timeout of the board's watchdog, with a margin.
const WATCHDOG: Duration = Duration::from_millis(2500);

type Board = Rc<RefCell<Rp2040Emulator>>;

/// Returns a board that runs these bytes as its image, a client of it, and the path of the image.
fn board(name: &str, image: &[u8]) -> (Board, Client, PathBuf) {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, image).unwrap();
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let board = Rc::new(RefCell::new(Rp2040Emulator::start(&robot, Some(&path)).unwrap()));
    let mut client = Client::new(Box::new(Rc::clone(&board)), "the board under test");
    client.open_session_for(&robot).unwrap();
    (board, client, path)
}

fn sealed() -> Vec<u8> {
    seal(&std::fs::read(pico_firmware("growbot-a")).unwrap()).unwrap().bytes
}

fn assert_off(board: &Board) {
    let mut board = board.borrow_mut();
    let tip = board.simulated_tip();
    assert!(!tip.heater_is_on() && tip.heater_duty() == 0.0 && !tip.steppers_are_on());
}

#[test]
fn a_sealed_uf2_image_boots_and_reports_a_crash_after_the_reset() {
    let sealed = sealed();
    let (board, mut client, _) = board("pico.uf2", &uf2::of_image(&sealed).unwrap());
    let elf = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pico-sealed.elf");
    std::fs::write(&elf, &sealed).unwrap();
    let image = FirmwareImage::open(&elf).unwrap();
    let report = client.boot_report().unwrap();
    assert_eq!((report.image, report.crash), (ImageCheck::Valid { crc: image.crc().unwrap() }, None));

    let boot_id = client.identify().unwrap().boot_id;
    board.borrow_mut().crash(rp2040::CrashMode::Faults).unwrap();
    let hello = client.open_session().unwrap();
    assert_eq!((hello.reset_cause, hello.status.state), (ResetCause::ProcessorFault, State::Idle));
    let words = client.boot_report().unwrap().crash.expect("the board knows of the crash");
    let crash = CrashReport::new(CrashRecord::from(&words), Some(&image));
    println!("{}", crash.text());
    assert_eq!((crash.record.cause, crash.record.boot_id), (ResetCause::ProcessorFault, boot_id));
    assert_eq!((crash.record.exception, crash.record.image), (3, image.crc()));
    let json = serde_json::to_value(crash.to_json()).unwrap();
    assert!(json["at"].to_string().contains("pico::") || json["called_from"].to_string().contains("pico::"), "{json}");
    assert_off(&board);

    // The processor has no interrupt of the watchdog, so the board only knows of the reset after its main loop hangs.
    board.borrow_mut().crash(rp2040::CrashMode::Hangs).unwrap();
    board.borrow_mut().run_for(WATCHDOG).unwrap();
    let hello = client.open_session().unwrap();
    assert_eq!((hello.reset_cause, hello.status.state), (ResetCause::Watchdog, State::Idle));
    assert_eq!(board.borrow().resets(), 2);
    assert_off(&board);
}

#[test]
fn a_crystal_failure_while_heating_switches_off_and_is_reported() {
    let (board, mut client, _) = board("pico-crystal.elf", &sealed());
    client
        .energize("to tune", &EnergizingRequest::Tune(Tune { target_centi_c: 15_000 }), &Permit::standalone())
        .unwrap();
    let is_hot = |board: &Board| {
        let mut board = board.borrow_mut();
        board.simulated_tip().heater_is_on() && board.simulated_tip().heater_duty() > 0.5
    };
    for _ in 0..120 {
        if is_hot(&board) {
            break;
        }
        client.wait(Duration::from_millis(500)).unwrap();
    }
    assert!(is_hot(&board), "{:?}", client.status());

    board.borrow_mut().crash(rp2040::CrashMode::CrystalStops).unwrap();
    // Five step ticks take 1.25 ms. The watchdog would take 2 s, and its clock stands too.
    board.borrow_mut().run_for(Duration::from_millis(2)).unwrap();
    assert_eq!(board.borrow().resets(), 1);
    // The tip's heater duty is the mean over the last interval.
    board.borrow_mut().run_for(Duration::from_millis(1)).unwrap();
    assert_off(&board);
    // The board responds, so the crystal must have started again.
    let hello = client.open_session().unwrap();
    assert_eq!((hello.reset_cause, hello.status.state), (ResetCause::ClockFailed, State::Fault));
    assert_eq!(hello.status.fault, Some(Fault::ClockFailed));
    client.energize("to clear it", &EnergizingRequest::ClearFault(Empty {}), &Permit::standalone()).unwrap();
    assert_eq!(client.status().unwrap().state, State::Idle);
    assert_off(&board);
}

/// Returns a sealed image with one flipped bit in a function. The function is not needed to start, respond or switch
/// off.
fn damaged() -> Vec<u8> {
    let mut bytes = sealed();
    let image = bytes.clone();
    let file = object::File::parse(&*image).unwrap();
    let function = file
        .symbols()
        .filter(|symbol| symbol.name().is_ok_and(|name| name.contains("helicoids")) && symbol.size() > 64)
        .max_by_key(ObjectSymbol::size)
        .expect("the planner is in the image");
    let at = (function.address() & !1) + function.size() / 2;
    let text = file.section_by_name(".text").unwrap();
    let offset = text.file_range().unwrap().0 + at - text.address();
    bytes[offset as usize] ^= 0x04;
    bytes
}

#[test]
fn a_damaged_image_is_reported_and_never_heats() {
    let (board, mut client, _) = board("pico-damaged", &damaged());
    let hello = client.identify().unwrap();
    assert_eq!((hello.status.state, hello.status.fault), (State::Fault, Some(Fault::ImageCorrupt)));
    let report = client.boot_report().unwrap();
    assert!(matches!(report.image, ImageCheck::Corrupt { sealed, found } if sealed != found), "{report:?}");

    let plan_id = 1;
    for request in [
        Message::BeginJob(BeginJob { plan_id, layers: 8, robot_hash: hello.robot_hash }),
        Message::Start(Start { plan_id, on_host_silence: HostSilencePolicy::Continue, is_continuation: false }),
        Message::Tune(Tune { target_centi_c: 20_000 }),
        Message::ClearFault(Empty {}),
        Message::Start(Start { plan_id, on_host_silence: HostSilencePolicy::Continue, is_continuation: false }),
    ] {
        let refused = match request.clone().effect() {
            Effect::Passive(request) => client.request("in vain", &request),
            Effect::Energizing(request) => client.energize("in vain", &request, &Permit::standalone()),
            Effect::FromBoard => panic!("a host sends no {request:?}"),
        };
        let refused = refused.unwrap_err();
        let ClientError::Refused { refusal, .. } = refused else { panic!("{request:?}: {refused:?}") };
        if request == Message::ClearFault(Empty {}) {
            assert_eq!(refusal, Refusal::FaultRemains { fault: Fault::ImageCorrupt });
        }
        assert_off(&board);
    }
    board.borrow_mut().run_for(Duration::from_secs(2)).unwrap();
    assert_eq!(client.status().unwrap().fault, Some(Fault::ImageCorrupt));
    let ambient_c = growbot_sim::tip::Variation::default().ambient_c;
    let mut board = board.borrow_mut();
    assert!(board.now() > Duration::from_secs(2) && board.simulated_tip().nozzle_peak_c() < ambient_c + 0.5);
}
