//! Tests with random messages and bytes on the link. The bench asserts the conditions that must always hold.

use std::vec::Vec;

use growbot_core::link::frame::{self, FrameHeader, MAX_BODY_LEN, next_seq};
use growbot_core::link::message::{
    Amend, AppendLayers, BeginJob, Cancel, Empty, HostSilencePolicy, MaintenanceTask, Message, PlanRequest, PoseFields,
    ReadLayers, Resume, SCHEMA_HASH, Start, State,
};
use growbot_core::plan::Planner;

use super::bench::{Bench, WARM};
use super::requests::{PLAN, bends, hello, maintain, pause, tune};
use super::tip::Wire;
use crate::testing::{fast_robot, number_from_environment};

/// Returns the number of messages in each of the long tests. The environment variable GROWBOT_MESSAGES sets it. The
/// default, 200,000, takes some seconds.
fn messages() -> u64 {
    number_from_environment("GROWBOT_MESSAGES", 200_000)
}

/// Number of random messages that one board receives.
const MESSAGES_OF_A_SEED: u64 = 10_000;

/// Source of random values and requests.
struct Random(growbot_core::random::Rng);

impl Random {
    fn new(seed: u64) -> Self {
        Self(growbot_core::random::Rng::new(&[seed]))
    }

    fn next(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Returns a number from 0 to `end`, without `end`.
    fn below(&mut self, end: u64) -> u64 {
        self.0.below(end)
    }

    fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len() as u64) as usize]
    }

    fn number(&mut self) -> f64 {
        let near = self.below(4000) as f64 - 2000.0;
        let any = f64::from_bits(self.next());
        self.one_of(&[near, near, near, near / 1000.0, any, f64::NAN, f64::INFINITY, 0.0])
    }

    /// Returns a random request. Plausible requests are more frequent than implausible ones.
    fn request(&mut self, bench: &mut Bench) -> Message {
        let next = bench.status().next_layer;
        let stored = bench.status().plan_id;
        let plan_id = self.one_of(&[stored, stored, stored, PLAN, PLAN, 0, PLAN + 1, u64::MAX]);
        match self.below(53) {
            44 if self.below(4) == 0 => Message::Cancel(Cancel { plan_id }),
            44..47 => Message::Resume(Resume {
                plan_id,
                start_layer: bench.status().layers_laid + self.one_of(&[0, 0, 1, 2]),
                reported_layers: self.one_of(&[0, u32::MAX]),
            }),
            47..50 => Message::Amend(Amend {
                plan_id,
                // `PLAN` is among the choices, so that the other requests still match.
                new_plan_id: self.one_of(&[PLAN + 1, PLAN, 0]),
                first_replaced: self.one_of(&[next, next.saturating_sub(2), 0, u32::MAX]),
                layers: self.one_of(&[30, 40, 0, u32::MAX]),
                first_layers: bends(self.below(17) as usize).into_iter().collect(),
            }),
            50..53 => maintain(self.one_of(&[
                MaintenanceTask::Preheat { target_centi_c: 20_000 },
                MaintenanceTask::Preheat { target_centi_c: i32::MAX },
                MaintenanceTask::CoolDown,
                MaintenanceTask::CoolDown,
                MaintenanceTask::Home,
                MaintenanceTask::DryRun,
                MaintenanceTask::Rotate { centi_deg: -9000 },
                MaintenanceTask::Rotate { centi_deg: i32::MIN },
                MaintenanceTask::Feed { um: 5000 },
                MaintenanceTask::Feed { um: -5000 },
                MaintenanceTask::Feed { um: i32::MIN },
            ])),
            40 => pause(),
            41 => tune(self.one_of(&[200.0, 200.0, 60.0, 20.0, 400.0, -1e6])),
            42 => Message::GetLatestFault(Empty {}),
            43 => Message::GetSensorReadings(Empty {}),
            0 => hello(self.one_of(&[SCHEMA_HASH, SCHEMA_HASH, 0])),
            1 if self.below(20) == 0 => Message::Stop(Empty {}),
            1 => Message::GetStatus(Empty {}),
            2..6 => Message::ClearFault(Empty {}),
            6..11 => {
                let robot = self.one_of(&[bench.robot.hash(), bench.robot.hash(), bench.robot.hash(), 0]);
                Message::BeginJob(BeginJob {
                    plan_id,
                    layers: self.one_of(&[30, 30, 30, 30, 0, 1, u32::MAX]),
                    robot_hash: robot,
                })
            }
            11..21 => {
                Message::Start(Start { plan_id, on_host_silence: HostSilencePolicy::Continue, is_continuation: false })
            }
            21 => {
                let pose = |random: &mut Self| PoseFields {
                    position: core::array::from_fn(|_| random.number()),
                    heading: random.number(),
                    pitch: random.number(),
                };
                let radius = self.one_of(&[100.0, 100.0, 98.2, 99.0, 1000.0, f64::NAN, -1.0, f64::MAX]);
                Message::Plan(PlanRequest { start: pose(self), goal: pose(self), radius, planner: Planner::TwoPlane })
            }
            22 => Message::ReadLayers(ReadLayers { first: self.one_of(&[0, next, u32::MAX, 4096]) }),
            _ => {
                let first =
                    self.one_of(&[next, next, next, next, next.saturating_sub(3), 0, next.saturating_add(1), u32::MAX]);
                let mut layers = bends(self.below(17) as usize);
                if self.below(10) == 0 && !layers.is_empty() {
                    layers[0] = core::array::from_fn(|_| self.next() as u8);
                }
                Message::AppendLayers(AppendLayers { plan_id, first, layers: layers.into_iter().collect() })
            }
        }
    }
}

#[test]
fn random_requests_never_break_invariants() {
    let mut seen = Vec::new();
    let mut laid = 0;
    for seed in 0..messages() / MESSAGES_OF_A_SEED {
        std::println!("seed {seed}");
        let mut random = Random::new(seed);
        let mut bench = Bench::greeted(fast_robot(), WARM);
        bench.poll_late(seed);
        for _ in 0..MESSAGES_OF_A_SEED {
            let request = random.request(&mut bench);
            let session = if random.below(8) == 0 { 0 } else { bench.session };
            bench.ask_in(session, &request);
            match random.below(400) {
                0..20 => bench.run(0.05),
                20..30 => bench.run(8.0),
                30 if random.below(4) == 0 => {
                    bench.world.wire.set(random.one_of(&[Wire::Open, Wire::Shorted, Wire::Silent]));
                }
                31..40 => bench.world.wire.set(Wire::Whole),
                40 if random.below(4) == 0 => bench.world.nozzle_c.set(260.0),
                41..51 => bench.world.nozzle_c.set(199.0),
                51 => bench.world.draught.set(20.0),
                52..60 => bench.world.draught.set(1.0),
                60 => bench.motors.index_dead = random.below(4) == 0,
                61 => bench.press_emergency_stop(true),
                62..80 => bench.press_emergency_stop(false),
                80 => bench.world.supply_v.set(random.one_of(&[Some(9.0), Some(15.0), None])),
                81..90 => bench.world.supply_v.set(Some(12.0)),
                90 => bench.run(random.one_of(&[70.0, 400.0])),
                _ => {}
            }
            let state = bench.controller.state();
            if !seen.contains(&state) {
                seen.push(state);
            }
        }
        laid += bench.laid().len();
    }
    assert_eq!(seen.len(), State::ALL.len() - 1, "only {seen:?} were reached");
    assert!(laid > 1000, "{laid} layers were laid");
}

#[test]
fn random_bytes_change_nothing() {
    for state in [State::Idle, State::Paused, State::Stopped, State::Fault] {
        let mut bench = Bench::in_state(state);
        let mut random = Random::new(state as u64);
        let laid = bench.status().layers_laid;
        for _ in 0..1000 {
            let noise: Vec<u8> = (0..random.below(200)).map(|_| random.next() as u8).collect();
            bench.send(&noise);
        }
        bench.run(0.1);
        bench.send(&[0]);
        let status = bench.status();
        assert_eq!((status.state, status.layers_laid), (state, laid));
    }
}

#[test]
fn valid_frames_with_random_bodies_change_nothing() {
    let mut random = Random::new(1);
    let mut bench = Bench::in_state(State::Paused);
    let mut seq = 1000;
    for count in 0..messages() {
        let body: Vec<u8> = (0..random.below(MAX_BODY_LEN as u64 + 1)).map(|_| random.next() as u8).collect();
        // The kind is any but a stop, because a stop would be carried out.
        let kind = random.one_of(&[1, 2, 3, 4, 5, 7, 9, 0x0b, 0x0c, 0x0d, 0x0e, 0x0f, 0x10, 0x12, 0x43, 0x50, 0xff]);
        // Each frame has the number of a new request.
        seq = next_seq(seq);
        let header = FrameHeader { kind, session: bench.session, seq, ack: random.next() as u16 };
        let bytes = frame::encode(&header, &body[..body.len() >> random.below(8)]).unwrap();
        bench.send(&bytes);
        bench.read(None);
        if count % 1000 == 0 {
            bench.run(0.01);
        }
    }
    assert_eq!(bench.controller.state(), State::Paused);
}
