//! Losses of power while the Pico's firmware writes to its flash, in the emulator: while it stores a description, and
//! while it records a layer in the journal.
//!
//! The test tries a few places. `GROWBOT_CUTS=all cargo test -p growbot-tests --test it emulated_rp2040_power:: --
//! --nocapture` tries every programmed byte and every 256th byte of the erase. This takes 20 minutes on three cores.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, GrowthError, grow_job, resume_job};
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::{HostSilencePolicy, State, Status};
use growbot_core::robot::Robot;
use growbot_plan::growth_report::{GrowthReport, Outcome};
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::robot_file;
use growbot_sim::port::rp2040::Rp2040Emulator;
use growbot_tests::pico_firmware;
use growbot_tests::recovery::crash::{self, Interruption, Recovery};
use growbot_tests::recovery::{Body, ReferenceGrowth};

/// Number of emulators that run at a time.
const BOARDS: usize = 3;
/// Size of a description's slot, bytes. The whole slot is erased before it is written again.
const SLOT: u32 = 128 * 1024;
/// Distance between two points of an erase at which power is cut, bytes.
const ERASED: usize = 256;
/// Size of a page of flash, bytes.
const PAGE: u32 = 256;
/// Size of a record of the journal, bytes.
const RECORD: u32 = 32;

type Board = Rc<RefCell<Rp2040Emulator>>;

fn robot(name: &str) -> Robot {
    robot_file::load(name.as_ref()).unwrap()
}

/// Returns all points at which power is cut if `GROWBOT_CUTS` is `all`, otherwise `few` of them, evenly spread.
fn places(all: impl Iterator<Item = u32>, few: usize) -> Vec<u32> {
    let all: Vec<u32> = all.collect();
    if std::env::var("GROWBOT_CUTS").is_ok_and(|cuts| cuts == "all") {
        return all;
    }
    (0..few).map(|index| all[(2 * index + 1) * all.len() / (2 * few)]).collect()
}

/// Calls `work` for each point in `places`, on [`BOARDS`] threads. Each thread calls `begin` once, and passes the
/// result to all its calls of `work`.
fn each<B>(places: &[u32], begin: impl Fn() -> B + Sync, work: impl Fn(&mut B, u32) + Sync) {
    let next = AtomicUsize::new(0);
    thread::scope(|scope| {
        for _ in 0..BOARDS.min(places.len()) {
            scope.spawn(|| {
                let mut with = begin();
                while let Some(place) = places.get(next.fetch_add(1, Ordering::Relaxed)) {
                    work(&mut with, *place);
                }
            });
        }
    });
}

fn start(robot: &Robot, image: &str) -> Board {
    Rc::new(RefCell::new(Rp2040Emulator::start(robot, Some(&pico_firmware(image))).unwrap()))
}

fn client(board: &Board) -> Client {
    Client::new(Box::new(Rc::clone(board)), "the board under test")
}

/// Cuts the power after this many bytes of the flash operations that store a new description. Checks that the board
/// then has the old or the new description, and returns true if it is the new one.
fn cut_description(board: &Board, old: &Robot, new: &Robot, bytes: u32) -> bool {
    board.borrow_mut().restore_flash().unwrap();
    let mut before = client(board);
    assert_eq!(before.open_session().unwrap().robot_hash, old.hash());
    board.borrow_mut().lose_power_after(bytes).unwrap();
    before.configure(new).unwrap_err();
    assert!(board.borrow().has_lost_power(), "no power was lost after {bytes} bytes");
    before.drop_without_goodbye();
    board.borrow_mut().power_up().unwrap();
    let hello = client(board).open_session().unwrap();
    let (state, fault) = (hello.status.state, hello.status.fault);
    assert_eq!((state, fault), (State::Idle, None), "after {bytes} bytes");
    assert!([old.hash(), new.hash()].contains(&hello.robot_hash), "after {bytes} bytes it is {}", hello.robot_name);
    hello.robot_hash == new.hash()
}

#[test]
fn power_loss_while_storing_a_description_keeps_the_old_or_the_new_one() {
    let [first, old, new] = ["growbot-b", "growbot-a2", "growbot-a"].map(robot);
    // Both slots have a description, so one of them has to be erased.
    let begin = || {
        let board = start(&robot("growbot-a"), "growbot-a");
        for robot in [&first, &old] {
            let mut client = client(&board);
            client.open_session().unwrap();
            client.configure(robot).unwrap();
            client.drop_without_goodbye();
        }
        board.borrow_mut().keep_flash().unwrap();
        board
    };
    let whole = {
        let board = begin();
        let changed = board.borrow().flash_changed();
        let mut client = client(&board);
        client.open_session().unwrap();
        client.configure(&new).unwrap();
        board.borrow().flash_changed() - changed
    };
    let pages = whole - SLOT;
    assert!(whole > SLOT && pages.is_multiple_of(PAGE), "{whole} bytes of flash were changed");
    let erase = places((1..=SLOT).step_by(ERASED), 1);
    let program = places(SLOT + 1..=whole, 3);
    let became_new = AtomicUsize::new(0);
    each(&[&erase[..], &program].concat(), begin, |board, bytes| {
        let is_new = cut_description(board, &old, &new, bytes);
        // The header is written last.
        assert!(!is_new || bytes > whole - PAGE, "{bytes} of {whole} bytes, and it is the new one");
        became_new.fetch_add(usize::from(is_new), Ordering::Relaxed);
    });
    let (losses, became_new) = (erase.len() + program.len(), became_new.into_inner());
    println!("{losses} losses of power over a description, {pages} bytes of pages: {became_new} times the new one");
}

/// Length of the growth, in layers of 0.7 mm.
const LENGTH: u32 = 6;
/// Number of layers after which power is lost. The record of the next layer is the last of its page, because the
/// records of the sector, the job and its start come first.
const LAID: usize = 4;

/// Grows until power is lost, `bytes` bytes of flash after the last layer was reported.
fn grow(
    job: &Job,
    board: &Board,
    bytes: u32,
    known: &mut Vec<Option<LayerBytes>>,
) -> Result<GrowthReport, GrowthError> {
    let mut client = client(board);
    let grown = grow_job(&mut client, job, HostSilencePolicy::Pause, &CommandQueue::default(), &mut |event| {
        if let JobEvent::Laid { as_built, .. } = event {
            known.push(*as_built);
            if known.len() == LAID {
                board.borrow_mut().lose_power_after(bytes).unwrap();
            }
        }
    });
    client.drop_without_goodbye();
    grown
}

/// Switches the power on and resumes the growth. Returns the status that the host found, and the result.
fn resume(job: &Job, board: &Board, known: Vec<Option<LayerBytes>>) -> (Status, GrowthReport) {
    board.borrow_mut().power_up().unwrap();
    let mut client = client(board);
    let found = client.open_session().unwrap().status;
    let orders = CommandQueue::default();
    let grown = resume_job(&mut client, job, known, HostSilencePolicy::Pause, &orders, &mut |_| ()).unwrap();
    (found, grown)
}

#[test]
fn power_loss_during_a_journal_write_loses_at_most_the_open_layer() {
    // Robot A2, whose motors are fast, with faster homing.
    let mut description = robot("growbot-a2").description().clone();
    description.head.homing_turns_per_s = 1.0;
    let robot = Robot::new(description).unwrap();
    let body = Body::of(LENGTH);
    let job = body.job(&robot);
    let undisturbed = ReferenceGrowth::grow(&job);
    // Losses before, within and after the record.
    let cuts = places(PAGE - RECORD..=PAGE, 1);
    each(
        &cuts,
        || (),
        |(), bytes| {
            let board = start(&robot, "growbot-a2");
            let mut first = client(&board);
            first.open_session().unwrap();
            first.configure(&robot).unwrap();
            first.drop_without_goodbye();
            board.borrow_mut().simulated_tip().preheat_instantly(198.0);
            let mut known = Vec::new();
            let lost = grow(&job, &board, bytes, &mut known);
            assert!(lost.is_err() && board.borrow().has_lost_power(), "{bytes} bytes: {lost:?}");
            let told = known.len();
            let (found, grown) = resume(&job, &board, known);
            assert_eq!(grown.outcome, Outcome::Done, "{bytes} bytes");
            let laid = found.layers_laid as usize;
            assert_eq!(laid, told + usize::from(bytes == PAGE), "{bytes} bytes: {told} layers told");
            let feed_steps = board.borrow_mut().simulated_tip().feed_steps();
            let more_feed_steps = feed_steps as i64 - undisturbed.feed_steps as i64;
            println!(
                "{bytes} bytes: {told} layers told, {laid} found, cut {:?}, {more_feed_steps} feed steps more",
                found.interrupted
            );
            let recovered = Recovery { found, as_built: grown.as_built, more_feed_steps };
            crash::check(&job, &undisturbed, Interruption::Power, &recovered)
                .unwrap_or_else(|wrong| panic!("{bytes}: {wrong}"));
        },
    );
    println!("{} losses of power over the record of a layer: each layer was laid once", cuts.len());
}
