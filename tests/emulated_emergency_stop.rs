//! Emergency stops of the firmware's own image in QEMU. A stop by the link works after noise and in the middle of a
//! frame. A stop by the button works while the main loop hangs. `cargo step-cost` measures the processor time of a stop
//! with a full queue.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::{Duration, Instant};

use growbot_client::client::Client;
use growbot_client::port::Port;
use growbot_client::stop_signal::Permit;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerEncoder;
use growbot_core::link::emergency_stop::EMERGENCY_STOP;
use growbot_core::link::frame::{FrameDecoder, FrameHeader, encode};
use growbot_core::link::message::{
    AppendLayers, BeginJob, Empty, EnergizingRequest, HostSilencePolicy, Message, PassiveRequest, Resume, Start, State,
};
use growbot_core::random::Rng;
use growbot_core::robot::Robot;
use growbot_firmware::emulated_tip as table;
use growbot_plan::robot_file;
use growbot_sim::port::emulator::Emulator;
use growbot_sim::tip::TipFault;
use growbot_tests::firmware;
use growbot_tests::tip_memory::{BoardLimit, TipMemoryView, wait_until_outputs_off};

const PLAN: u64 = 1;
/// Bytes of noise: three times the size of the board's queue.
const NOISE: usize = 3 * 4096;
/// Time limit for the board to grow or to switch everything off, s of its clock. It takes a minute to grow, for the
/// test of its heater's switches and for homing.
const LIMIT_S: u32 = 120;
/// Time limit for the board's confirmation of a stop. The board takes some milliseconds, but the desktop may pause the
/// emulator.
const PATIENCE: Duration = Duration::from_secs(120);

/// Returns robot A with faster homing and growth.
fn robot() -> Robot {
    let mut description = robot_file::load("growbot-a".as_ref()).unwrap().description().clone();
    description.layer.period_s = 6.0;
    description.head.homing_turns_per_s = 0.2;
    Robot::new(description).unwrap()
}

/// Returns noise: [`NOISE`] random bytes, then the first half of a valid frame.
fn noise() -> Vec<u8> {
    let mut random = Rng::new(&[1]);
    let mut bytes: Vec<u8> = (0..NOISE).map(|_| random.uniform_between(0.0, 256.0) as u8).collect();
    let whole = encode(&FrameHeader { kind: 4, session: 1, seq: 1, ack: 0 }, &[7; 200]).unwrap();
    bytes.extend(&whole[..whole.len() / 2]);
    bytes
}

fn start(client: &mut Client, words: &TipMemoryView) {
    client
        .energize(
            "to start",
            &EnergizingRequest::Start(Start {
                plan_id: PLAN,
                on_host_silence: HostSilencePolicy::Continue,
                is_continuation: false,
            }),
            &Permit::standalone(),
        )
        .unwrap();
    let mut limit = BoardLimit::new(words, LIMIT_S);
    loop {
        let _ = client.event(Duration::from_millis(50));
        let status = client.status().unwrap();
        assert_ne!(status.state, State::Fault, "{:?}", status.fault);
        if status.state == State::Growing {
            return;
        }
        limit.check(format_args!("to grow, still {}", status.state.name()));
    }
}

/// Outputs that an emergency stop switches off.
const OUTPUTS: [usize; 3] = [table::HEATER_ENABLE, table::HEAD_ENABLE, table::FEED_ENABLE];

/// Returns a board with a job of 8 layers and a warm nozzle.
fn with_a_job() -> (Rc<RefCell<Emulator>>, TipMemoryView, Client) {
    let robot = robot();
    let emulator = Rc::new(RefCell::new(Emulator::start(&robot, Some(&firmware("an386"))).unwrap()));
    let words = TipMemoryView::of(&mut emulator.borrow_mut());
    let mut client = Client::new(Box::new(Rc::clone(&emulator)), "the emulated board");
    client.open_session_for(&robot).unwrap();
    client
        .request("to begin", &PassiveRequest::BeginJob(BeginJob { plan_id: PLAN, layers: 8, robot_hash: robot.hash() }))
        .unwrap();
    // The nozzle is warmed only now, because the board erases its journal only with a cold nozzle.
    emulator.borrow_mut().simulated_tip(|tip| tip.set_nozzle_c(197.0));
    let mut encoder = LayerEncoder::default();
    let layers = (0..8).map(|_| encoder.encode(&Layer { alpha: 1.0, height: 0.7, tilt: 0.006 })).collect();
    client
        .request("to store layers", &PassiveRequest::AppendLayers(AppendLayers { plan_id: PLAN, first: 0, layers }))
        .unwrap();
    (emulator, words, client)
}

#[test]
fn the_button_switches_outputs_off_while_the_main_loop_hangs() {
    let (emulator, words, mut client) = with_a_job();
    start(&mut client, &words);
    words.wait("heater and motors", |words| OUTPUTS.iter().all(|output| words.read(*output) == 1));
    let boots = words.read(table::BOOTS);
    words.write(table::HANG, 1);
    // The main loop hangs once its feeds of the watchdog stop while ticks continue. The emulator feeds the watchdog
    // nevertheless, so only the stop ends this.
    let (mut feeds, mut since) = (words.read(table::WATCHDOG_FEEDS), words.read(table::TICKS_LO));
    words.wait("the main loop to hang", |words| {
        let now = words.read(table::TICKS_LO);
        if words.read(table::WATCHDOG_FEEDS) != feeds {
            (feeds, since) = (words.read(table::WATCHDOG_FEEDS), now);
        }
        // One second without a feed, by the board's clock. Before, the board fed ten times a second.
        now.wrapping_sub(since) > words.read(table::TICK_HZ)
    });
    assert_eq!(words.read(table::HEATER_ENABLE), 1, "nothing has switched the heater off yet");
    emulator.borrow_mut().inject(TipFault::EmergencyStop);
    let off = [table::HEATER_DUTY, table::FAN_DUTY].iter().chain(&OUTPUTS);
    words.wait("heater, fan and motors off", |words| off.clone().all(|output| words.read(*output) == 0));
    assert_eq!((words.read(table::BOOTS), words.read(table::WATCHDOG_FEEDS)), (boots, feeds));
    words.write(table::HANG, 0);
    let status = client.status().unwrap();
    assert_eq!((status.state, status.fault), (State::EmergencyStop, None));
}

#[test]
fn the_stop_works_after_noise_and_a_partial_frame() {
    let (emulator, words, mut client) = with_a_job();
    let outputs = OUTPUTS;

    for by_hand in [true, false] {
        start(&mut client, &words);
        words.wait("heater and motors", |words| outputs.iter().all(|output| words.read(*output) == 1));
        let lost = words.read(table::LINK_BYTES_LOST);
        let began = Instant::now();
        client.port().send(&noise()).unwrap();
        if by_hand {
            client.port().send(&EMERGENCY_STOP).unwrap();
            assert!(says_that_it_has_stopped(client.port()), "the board does not say that it has stopped");
        } else {
            assert!(
                client.emergency_stop_within(PATIENCE, &mut 0).unwrap(),
                "the board does not say that it has stopped"
            );
        }
        let after = began.elapsed();
        for output in outputs {
            assert_eq!(words.read(output), 0, "the word at {output:#x}");
        }
        assert_eq!(words.read(table::HEATER_DUTY), 0);
        wait_until_outputs_off(&mut emulator.borrow_mut(), "after the stop");
        let status = client.status().unwrap();
        assert_eq!((status.state, status.fault), (State::EmergencyStop, None));
        let lost = words.read(table::LINK_BYTES_LOST) - lost;
        println!(
            "told {:.0} ms after {NOISE} bytes of noise, {lost} of which found no room",
            after.as_secs_f64() * 1e3
        );
        client.energize("to clear it", &EnergizingRequest::ClearFault(Empty {}), &Permit::standalone()).unwrap();
        // The interrupted layer is laid again.
        let laid = status.layers_laid;
        client
            .request(
                "to resume",
                &PassiveRequest::Resume(Resume { plan_id: PLAN, start_layer: laid, reported_layers: laid }),
            )
            .unwrap();
    }
}

/// Returns true if the board sends `EmergencyStopAck`.
fn says_that_it_has_stopped(port: &mut dyn Port) -> bool {
    let (mut receiver, mut buffer, began) = (FrameDecoder::default(), [0; 64], Instant::now());
    while began.elapsed() < PATIENCE {
        let count = port.receive(&mut buffer, Duration::from_millis(50)).unwrap();
        for byte in &buffer[..count] {
            if let Some(Ok(frame)) = receiver.push(*byte)
                && let Ok(Message::EmergencyStopAck(_)) = Message::decode(frame.header.kind, &frame.body)
            {
                return true;
            }
        }
    }
    false
}
