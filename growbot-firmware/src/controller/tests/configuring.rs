//! Tests of the configuration of a board with a new robot description from the host.

use std::vec::Vec;

use growbot_core::hash::Hasher;
use growbot_core::link::message::{
    BoardInfo, Cancel, Configure, Configured, DescriptionError, Empty, MAX_DESCRIPTION_PART, Message, Refusal,
    ResetCause, State,
};
use growbot_core::random::splitmix64;
use growbot_core::robot::{
    BoardKind, DriverSettings, ENCODING_VERSION, MAX_VERSIONED_LEN, PinOverrides, Robot, RobotDescription,
};

use super::bench::{Bench, WARM};
use super::requests::{PLAN, begin, clear, start, stop};
use crate::description_store::DescriptionStore;
use crate::testing::{fast_robot, number_from_environment, on_skr_pico, robot_a};

/// Temperature of a nozzle that counts as cold, degrees Celsius.
const COLD: f64 = 25.0;

fn encoded(robot: &Robot) -> Vec<u8> {
    Vec::from(robot.encode_for_board(&mut [0; MAX_VERSIONED_LEN]).unwrap())
}

/// Returns the requests that send a description with this hash in parts.
fn parts(hash: u64, description: &[u8]) -> Vec<Message> {
    let part = |(at, bytes): (usize, &[u8])| {
        Message::Configure(Configure {
            robot: hash,
            length: description.len() as u16,
            offset: (at * MAX_DESCRIPTION_PART) as u16,
            bytes: bytes.iter().copied().collect(),
        })
    };
    description.chunks(MAX_DESCRIPTION_PART).enumerate().map(part).collect()
}

fn parts_of(robot: &Robot) -> Vec<Message> {
    parts(robot.hash(), &encoded(robot))
}

/// Sends these parts of a description, and stops after a refusal. Returns the last response.
fn configure(bench: &mut Bench, parts: &[Message]) -> Result<Configured, Refusal> {
    let mut last = None;
    for part in parts {
        match bench.ask(part) {
            Message::Configured(configured) => last = Some(configured),
            Message::Refused(refused) => return Err(refused.refusal),
            other => panic!("{other:?}"),
        }
    }
    Ok(last.expect("a part"))
}

fn stored(bench: &Bench) -> Option<Robot> {
    DescriptionStore::open(bench.world.descriptions.clone()).newest().robot()
}

fn hello(bench: &mut Bench) -> BoardInfo {
    match bench.ask(&Message::GetBoardInfo(Empty {})) {
        Message::BoardInfo(hello) => hello,
        other => panic!("{other:?}"),
    }
}

/// Creates a bench whose board has a description in its flash.
fn described() -> Bench {
    let bench = Bench::new(robot_a(), COLD);
    DescriptionStore::open(bench.world.descriptions.clone()).store(&robot_a()).unwrap();
    bench.reset(ResetCause::PowerOn)
}

/// Creates a bench whose board has no description.
fn unconfigured() -> Bench {
    let bench = Bench::new(robot_a(), COLD);
    bench.world.configured.set(false);
    bench.reset(ResetCause::PowerOn)
}

#[test]
fn a_description_is_stored_and_used_after_the_restart() {
    let mut bench = Bench::greeted(robot_a(), COLD);
    bench.stutters = true;
    let new = fast_robot();
    let configured = configure(&mut bench, &parts_of(&new));
    let length = encoded(&new).len() as u16;
    assert_eq!(configured, Ok(Configured { robot: new.hash(), received: length, stored: true }));
    assert_eq!(stored(&bench), Some(new.clone()));
    assert!(!bench.controller.needs_reset(), "the answer is on its way");
    assert_eq!(hello(&mut bench).robot_hash, robot_a().hash(), "not yet");
    assert_eq!(bench.ask(parts_of(&new).last().unwrap()), Message::Configured(configured.unwrap()), "a lost answer");
    assert_eq!(bench.refused(&begin(&new, PLAN, 2)), Refusal::NoSession);
    assert_eq!(bench.refused(&parts_of(&robot_a())[0]), Refusal::NoSession);
    bench.run(0.6);
    assert!(bench.controller.needs_reset());
    let mut bench = Bench::boot(new.clone(), bench.world, ResetCause::External);
    bench.run(0.7);
    bench.hello();
    assert_eq!((hello(&mut bench).robot_hash, bench.controller.state()), (new.hash(), State::Idle));
}

#[test]
fn only_an_inactive_board_can_be_configured() {
    for state in State::ALL {
        let mut bench = Bench::in_state(state);
        bench.world.nozzle_c.set(COLD);
        let refused = configure(&mut bench, &parts_of(&robot_a())).unwrap_err();
        let expected = match state {
            // The job that is in progress is not finished.
            State::Idle | State::Stopped | State::Fault | State::EmergencyStop => Refusal::JobNotDone { plan_id: PLAN },
            State::Done => Refusal::NozzleTooHot { below: 5000 },
            _ => Refusal::WrongState { state },
        };
        assert_eq!(refused, expected, "{state:?}");
        assert_eq!((stored(&bench), bench.world.descriptions.writes()), (None, 0), "{state:?}");
    }
}

#[test]
fn a_faulted_board_can_be_configured_after_its_job_is_cancelled() {
    for state in [State::Idle, State::Stopped, State::Fault, State::EmergencyStop] {
        let mut bench = Bench::in_state(state);
        bench.accepted(&Message::Cancel(Cancel { plan_id: PLAN }));
        bench.run(1200.0);
        assert_eq!(configure(&mut bench, &parts_of(&robot_a())).map(|done| done.stored), Ok(true), "{state:?}");
    }
}

/// Checks that only the time at rest shows that the nozzle is cold, if the description may have the wrong thermistor.
#[test]
fn configuring_needs_a_cold_nozzle_or_enough_time_at_rest() {
    let mut bench = Bench::greeted(robot_a(), WARM);
    assert_eq!(configure(&mut bench, &parts_of(&fast_robot())), Err(Refusal::NozzleTooHot { below: 5000 }));
    bench.run(1190.0);
    bench.world.nozzle_c.set(WARM);
    bench.run(2.0);
    assert_eq!(configure(&mut bench, &parts_of(&fast_robot())), Err(Refusal::NozzleTooHot { below: 5000 }));
    bench.world.nozzle_c.set(WARM);
    bench.run(10.0);
    assert_eq!(configure(&mut bench, &parts_of(&fast_robot())).map(|done| done.stored), Ok(true));
}

#[test]
fn parts_may_be_repeated_but_must_be_in_order() {
    let mut bench = Bench::greeted(robot_a(), COLD);
    let new = fast_robot();
    let parts = parts_of(&new);
    assert_eq!(bench.refused(&parts[1]), Refusal::OutOfOrder { expected: 0 });
    let part = MAX_DESCRIPTION_PART as u16;
    for _ in 0..2 {
        let received = Message::Configured(Configured { robot: new.hash(), received: part, stored: false });
        assert_eq!(bench.ask(&parts[0]), received);
    }
    assert_eq!(bench.refused(&parts[2]), Refusal::OutOfOrder { expected: part.into() });
    for _ in 0..2 {
        let received = Message::Configured(Configured { robot: new.hash(), received: 2 * part, stored: false });
        assert_eq!(bench.ask(&parts[1]), received);
    }
    // A description of another host arrives in between.
    bench.ask(&parts_of(&robot_a())[0]);
    assert_eq!(bench.refused(&parts[2]), Refusal::OutOfOrder { expected: 0 });
    assert_eq!(configure(&mut bench, &parts).map(|done| done.stored), Ok(true));
}

#[test]
fn parts_beyond_the_end_are_refused() {
    let mut bench = Bench::greeted(robot_a(), COLD);
    let part = |length, offset, bytes: &[u8]| {
        Message::Configure(Configure { robot: 1, length, offset, bytes: bytes.iter().copied().collect() })
    };
    let too_long = Refusal::InvalidDescription { error: DescriptionError::TooLong };
    assert_eq!(bench.refused(&part(MAX_VERSIONED_LEN as u16 + 1, 0, &[1])), too_long);
    assert_eq!(bench.refused(&part(u16::MAX, u16::MAX, &[1; MAX_DESCRIPTION_PART])), too_long);
    for (length, offset, bytes) in [(0, 0, &[][..]), (4, 0, &[]), (4, 0, &[1; 5]), (1, 0, &[1; MAX_DESCRIPTION_PART])] {
        assert_eq!(bench.refused(&part(length, offset, bytes)), Refusal::UnknownRequest, "{length} {offset}");
    }
    assert_eq!(bench.refused(&part(4, u16::MAX, &[1])), Refusal::OutOfOrder { expected: 0 });
}

/// Returns a robot whose description contains all optional parts.
fn wired_robot() -> Robot {
    let mut description = fast_robot().description().clone();
    let pins = PinOverrides { index: Some(20), supply: Some(26), driver_fault: Some(24), ..PinOverrides::default() };
    description.board = Some(growbot_core::robot::BoardDescription { kind: BoardKind::SkrPico, pins });
    let driver = DriverSettings { stall_threshold: Some(80), ..DriverSettings::with_current(0.8) };
    (description.head.driver, description.feed.driver) = (Some(driver), Some(driver));
    Robot::new(description).unwrap()
}

#[test]
fn an_invalid_description_is_refused_with_the_reason() {
    let mut bench = Bench::greeted(robot_a(), COLD);
    let (old, new) = (robot_a(), fast_robot());
    let other_hash = parts(old.hash(), &encoded(&new));
    let mut other_version = encoded(&new);
    other_version[0] += 1;
    let mut nameless = encoded(&new);
    nameless[2] = b'A';
    let mut negative = encoded(&new);
    // The planning radius follows the name.
    let at = 2 + new.name().len();
    negative[at..at + 8].copy_from_slice(&(-1.0_f64).to_le_bytes());
    for (bad, why) in [
        (other_hash, DescriptionError::HashMismatch { found: new.hash() }),
        (parts(new.hash(), &other_version), DescriptionError::VersionMismatch { board: ENCODING_VERSION }),
        (parts(new.hash(), &encoded(&new)[..300]), DescriptionError::Unreadable),
        (parts(new.hash(), &nameless), DescriptionError::Name),
        (parts(new.hash(), &negative), DescriptionError::Number),
    ] {
        assert_eq!(configure(&mut bench, &bad), Err(Refusal::InvalidDescription { error: why }));
        assert_eq!((stored(&bench), bench.controller.needs_reset()), (None, false), "{why:?}");
    }
    assert_eq!(configure(&mut bench, &parts_of(&new)).map(|done| done.stored), Ok(true), "and then a good one");
}

/// Returns the hash and the encoding of a description that no host would send, because it fails the checks.
fn unchecked(change: fn(&mut RobotDescription)) -> (u64, Vec<u8>) {
    let mut description = on_skr_pico().description().clone();
    change(&mut description);
    let bytes = encoded(&Robot::from_checked(description, 0));
    (Hasher::hash(&bytes[1..]), bytes)
}

fn with_pins(robot: &mut RobotDescription, change: fn(&mut PinOverrides)) {
    change(&mut robot.board.as_mut().unwrap().pins);
}

/// A change that makes a description unsuitable, and the reason of the board's refusal.
type Refusing = (fn(&mut RobotDescription), DescriptionError);

#[test]
fn unsuitable_pins_and_drivers_are_refused_and_the_old_one_is_kept() {
    let mut bench = described();
    let changes: [Refusing; 8] = [
        (|robot| with_pins(robot, |pins| pins.index = Some(30)), DescriptionError::Pins),
        (|robot| with_pins(robot, |pins| pins.index = Some(16)), DescriptionError::Pins),
        (|robot| with_pins(robot, |pins| pins.thermistor = Some(18)), DescriptionError::Pins),
        (|robot| with_pins(robot, |pins| pins.fan = Some(7)), DescriptionError::Pins),
        (|robot| robot.sensors.supply = true, DescriptionError::Pins),
        (|robot| robot.head.driver = None, DescriptionError::Drivers),
        (
            |robot| robot.feed.driver = Some(DriverSettings { microsteps: 3, ..DriverSettings::with_current(0.5) }),
            DescriptionError::Drivers,
        ),
        (|robot| robot.feed.driver = Some(DriverSettings::with_current(2.0)), DescriptionError::Number),
    ];
    for (change, why) in changes {
        let (hash, bytes) = unchecked(change);
        assert_eq!(configure(&mut bench, &parts(hash, &bytes)), Err(Refusal::InvalidDescription { error: why }));
        assert_eq!((stored(&bench), bench.controller.needs_reset()), (Some(robot_a()), false), "{why:?}");
    }
    let good = on_skr_pico();
    assert_eq!(configure(&mut bench, &parts_of(&good)).map(|done| done.stored), Ok(true), "and then a good one");
    assert_eq!(stored(&bench), Some(good));
}

/// Checks that a board of a single kind accepts the descriptions of that kind, and those without a kind. The simulated
/// board of the other tests is every kind of board.
#[test]
fn descriptions_for_another_board_kind_are_refused() {
    let of = |kind| {
        let mut description = fast_robot().description().clone();
        description.board = Some(growbot_core::robot::BoardDescription { kind, pins: PinOverrides::default() });
        Robot::new(description).unwrap()
    };
    let suits = |robot| super::super::configuration::check_board_kind(&[BoardKind::Pico], robot);
    let (asked, board) = (BoardKind::Stm32f405, BoardKind::Pico);
    assert_eq!(suits(of(asked)), Err(DescriptionError::BoardMismatch { asked, board }));
    assert_eq!(suits(of(BoardKind::Pico)), Ok(of(BoardKind::Pico)));
    assert_eq!(suits(fast_robot()), Ok(fast_robot()));
    let mut bench = Bench::greeted(robot_a(), COLD);
    let done = configure(&mut bench, &parts_of(&of(BoardKind::Stm32f405)));
    assert_eq!(done.map(|done| done.stored), Ok(true));
}

#[test]
fn corrupted_descriptions_are_refused_and_the_old_one_is_kept() {
    let mut bench = described();
    let old = robot_a();
    let writes = bench.world.descriptions.writes();
    let new = wired_robot();
    let changed = number_from_environment("GROWBOT_CHANGED_DESCRIPTIONS", 10_000);
    for seed in 0..changed {
        let mut count = seed << 8;
        let mut random = |below: usize| {
            count += 1;
            (splitmix64(count) >> 8) as usize % below
        };
        let mut bytes = encoded(&new);
        for _ in 0..=random(3) {
            let at = random(bytes.len());
            match random(4) {
                0 => bytes[at] ^= 1 << random(8),
                1 => bytes[at] = !bytes[at],
                2 => bytes.truncate(at.max(1)),
                _ => bytes.insert(at, random(256) as u8),
            }
        }
        if bytes == encoded(&new) {
            continue;
        }
        let refused = configure(&mut bench, &parts(new.hash(), &bytes)).unwrap_err();
        assert!(matches!(refused, Refusal::InvalidDescription { .. }), "seed {seed}: {refused:?}");
        assert!(!bench.controller.needs_reset(), "seed {seed}");
    }
    assert_eq!((stored(&bench), bench.world.descriptions.writes()), (Some(old), writes));
}

#[test]
fn a_failed_flash_write_is_refused_and_the_old_one_is_kept() {
    let mut bench = described();
    bench.world.descriptions.lose_power_after(1, 1);
    assert_eq!(configure(&mut bench, &parts_of(&fast_robot())), Err(Refusal::DescriptionNotStored));
    bench.world.descriptions.power_up();
    assert_eq!(stored(&bench), Some(robot_a()));
    assert_eq!(configure(&mut bench, &parts_of(&fast_robot())).map(|done| done.stored), Ok(true));
}

#[test]
fn an_unconfigured_board_only_communicates() {
    let mut bench = unconfigured();
    let BoardInfo { robot_hash: robot, robot_name, status, .. } = hello(&mut bench);
    assert_eq!((robot, robot_name.as_str(), status.state), (0, "", State::SelfTest));
    let quiet = [0x01, 0x02, 0x06, 0x0C, 0x0D, 0x0E, 0x12, 0x13, 0x14, 0x16];
    let bodies: [&[u8]; 6] = [&[], &[0; 1], &[0; 2], &[0; 3], &[0; 5], &[0; 89]];
    let mut refused = Vec::new();
    for kind in (1..0x17).filter(|kind| !quiet.contains(kind)) {
        for body in bodies.iter().filter(|body| Message::decode(kind, body).is_ok()) {
            let answer = bench.ask_raw(bench.session, kind, body);
            let Message::Refused(refusal) = answer else { panic!("{kind:#x}: {answer:?}") };
            assert_eq!(refusal.refusal, Refusal::NotConfigured, "{kind:#x}");
            refused.push(kind);
        }
    }
    let orders: Vec<u8> = (1..0x17).filter(|kind| !quiet.contains(kind)).collect();
    assert_eq!(refused, orders, "every order was tried");
    bench.accepted(&stop());
    bench.run(60.0);
    assert_eq!((bench.controller.state(), bench.controller.fault()), (State::SelfTest, None));
    assert!(bench.heater.off());
}

#[test]
fn an_unconfigured_board_keeps_running_and_can_be_configured() {
    let mut bench = unconfigured();
    let fed = *bench.fed.0.borrow();
    bench.run(10.0);
    assert!(*bench.fed.0.borrow() >= fed + 90, "its watchdog is fed");
    bench.call_emergency_stop();
    bench.run(0.1);
    assert_eq!((bench.controller.state(), bench.stops_acknowledged()), (State::EmergencyStop, 1));
    assert_eq!(bench.refused(&clear()), Refusal::NotConfigured);
    assert_eq!(bench.refused(&start()), Refusal::NotConfigured);
    let new = fast_robot();
    assert_eq!(configure(&mut bench, &parts_of(&new)).map(|done| done.stored), Ok(true));
    bench.run(0.6);
    assert!(bench.controller.needs_reset());
    bench.world.configured.set(true);
    let mut bench = Bench::boot(stored(&bench).unwrap(), bench.world, ResetCause::External);
    bench.run(0.7);
    bench.hello();
    bench.accepted(&clear());
    assert_eq!(hello(&mut bench).robot_hash, new.hash(), "{:?}", bench.controller.state());
}
