use growbot_core::link::message::{DriverProblem, DriverReport, Motor};
use proptest::prelude::*;

use super::fake_bus::{DRV_STATUS, FakeWire, GSTAT, IFCNT, SG_RESULT, STANDING, TSTEP, TURNING};
use super::{DriverConfig, SingleWireUart, Tmc2209};
use crate::hal::StepperDrivers;

/// Address of the head's driver on the serial line. [`FEED`] is that of the feed's driver.
const HEAD: usize = 0;
const FEED: usize = 3;

/// The stepper drivers of a board on a simulated serial line, and the board's clock.
struct Bench {
    wire: FakeWire,
    drivers: Tmc2209<FakeWire>,
    now: u64,
    /// Time between two polls of the drivers, us.
    period: u64,
    in_use: bool,
}

impl Bench {
    /// Creates a bench whose board has just been switched on.
    fn new() -> Self {
        let wire = FakeWire::new();
        let head = DriverConfig {
            address: HEAD as u8,
            sense_ohm: 0.11,
            current_a: 0.8,
            microsteps: 16,
            spread_cycle: false,
            stall_threshold: Some(50),
        };
        let feed = DriverConfig { address: FEED as u8, spread_cycle: true, ..head };
        let drivers = Tmc2209::new(wire.clone(), [head, feed]);
        Self { wire, drivers, now: 0, period: 1000, in_use: false }
    }

    /// Creates a bench whose drivers are configured. `in_use` states whether the motors are in use from then on.
    fn configured(in_use: bool) -> Self {
        let mut bench = Self::new();
        bench.run(500);
        assert!(bench.drivers.are_configured());
        bench.in_use = in_use;
        bench
    }

    fn run(&mut self, ms: u64) {
        let until = self.now + 1000 * ms;
        while self.now < until {
            self.drivers.poll(self.now, self.in_use);
            self.now += self.period;
        }
    }

    fn set(&self, chip: usize, register: u8, value: u32) {
        self.wire.chip(chip, |chip| {
            chip.registers.insert(register, value);
        });
    }

    fn found(&self) -> Option<(Motor, DriverProblem)> {
        self.drivers.problem().map(|DriverReport { motor, problem }| (motor, problem))
    }

    /// Asserts that the drivers have not reported a problem yet, and that they report this one within a time, ms.
    fn finds(&mut self, motor: Motor, problem: DriverProblem, ms: u64) {
        assert_eq!(self.found(), None);
        self.run(ms);
        assert_eq!(self.found(), Some((motor, problem)));
    }
}

#[test]
fn exactly_both_drivers_are_configured() {
    for period in [20, 1000, 10_000, 20_000] {
        for echoes in [true, false] {
            let mut bench = Bench::new();
            bench.period = period;
            bench.wire.0.borrow_mut().echoes = echoes;
            assert!(!bench.drivers.are_configured());
            bench.run(600);
            assert!(bench.drivers.are_configured(), "{period} us between polls");
            assert_eq!(bench.found(), None);
            for chip in [HEAD, FEED] {
                assert_eq!((bench.wire.register(chip, IFCNT), bench.wire.register(chip, GSTAT)), (12, 0));
                assert_eq!(bench.wire.register(chip, 0x6C) >> 24 & 0xF, 4, "16 microsteps");
            }
            // SpreadCycle is set in the feed's driver only.
            assert_eq!((bench.wire.register(HEAD, 0x00) & 4, bench.wire.register(FEED, 0x00) & 4), (0, 4));
            assert_eq!((bench.wire.register(1, IFCNT), bench.wire.register(2, IFCNT)), (0, 0));
        }
    }
}

#[test]
fn a_silent_driver_is_a_problem_and_is_configured_once_it_responds() {
    for in_use in [false, true] {
        let mut bench = Bench::new();
        bench.in_use = in_use;
        bench.wire.chip(FEED, |chip| chip.silent = true);
        bench.finds(Motor::Feed, DriverProblem::Silent, 200);
        assert!(!bench.drivers.are_configured());
        bench.wire.chip(FEED, |chip| chip.silent = false);
        bench.run(200);
        assert_eq!((bench.found(), bench.drivers.are_configured()), (None, true));
    }
}

#[test]
fn a_driver_that_responds_again_keeps_its_configuration() {
    let mut bench = Bench::configured(true);
    bench.wire.chip(HEAD, |chip| chip.silent = true);
    bench.finds(Motor::Head, DriverProblem::Silent, 100);
    let writes = bench.wire.0.borrow().chips[HEAD].writes;
    bench.wire.chip(HEAD, |chip| chip.silent = false);
    bench.run(100);
    assert_eq!((bench.found(), bench.drivers.are_configured()), (None, true));
    assert_eq!(bench.wire.0.borrow().chips[HEAD].writes, writes, "it has kept its configuration");
}

#[test]
fn responses_with_a_wrong_crc_are_retried_and_then_discarded() {
    let mut bench = Bench::configured(true);
    for (corrupt, expected) in [(2, None), (3, Some((Motor::Head, DriverProblem::Silent)))] {
        bench.wire.chip(HEAD, |chip| chip.corrupt = corrupt);
        let mut found = None;
        for _ in 0..100 {
            bench.run(1);
            found = found.or(bench.found());
        }
        assert_eq!(found, expected, "{corrupt} wrong answers");
    }
}

#[test]
fn a_driver_that_does_not_count_writes_is_not_configured() {
    let mut bench = Bench::new();
    bench.wire.chip(HEAD, |chip| chip.deaf = true);
    bench.finds(Motor::Head, DriverProblem::NotConfigured, 500);
    assert!(!bench.drivers.are_configured());
    // One lost write is not a problem yet.
    let mut bench = Bench::new();
    bench.wire.chip(HEAD, |chip| chip.deaf = true);
    bench.run(30);
    bench.wire.chip(HEAD, |chip| chip.deaf = false);
    bench.run(300);
    assert_eq!((bench.found(), bench.drivers.are_configured()), (None, true));
}

#[test]
fn the_write_counter_may_wrap() {
    let mut bench = Bench::new();
    bench.set(HEAD, IFCNT, 250);
    bench.run(500);
    assert!(bench.drivers.are_configured());
    assert_eq!(bench.wire.register(HEAD, IFCNT), 6);
}

#[test]
fn each_flag_maps_to_its_problem() {
    for (register, value, problem) in [
        (DRV_STATUS, TURNING | 1, DriverProblem::Hot),
        (DRV_STATUS, TURNING | 0b11, DriverProblem::OverTemperature),
        (DRV_STATUS, STANDING | 1 << 2, DriverProblem::ShortToGround),
        (DRV_STATUS, STANDING | 1 << 3, DriverProblem::ShortToGround),
        (DRV_STATUS, STANDING | 1 << 4, DriverProblem::ShortToSupply),
        (DRV_STATUS, STANDING | 1 << 5, DriverProblem::ShortToSupply),
        (GSTAT, 0b001, DriverProblem::Reset),
        (GSTAT, 0b010, DriverProblem::ShutDown),
        (GSTAT, 0b100, DriverProblem::Undervoltage),
    ] {
        for (motor, chip) in [(Motor::Head, HEAD), (Motor::Feed, FEED)] {
            let mut bench = Bench::configured(true);
            bench.set(chip, register, value);
            bench.finds(motor, problem, 60);
            bench.set(chip, register, if register == GSTAT { 0 } else { STANDING });
            bench.run(60);
            assert_eq!(bench.found(), None);
        }
    }
}

#[test]
fn an_open_wire_counts_only_if_persistent_while_turning() {
    for phase in [1 << 6, 1 << 7] {
        let mut bench = Bench::configured(true);
        bench.set(HEAD, DRV_STATUS, STANDING | phase);
        bench.run(2000);
        assert_eq!(bench.found(), None, "it stands still");
        bench.set(HEAD, DRV_STATUS, TURNING | phase);
        bench.run(200);
        bench.finds(Motor::Head, DriverProblem::OpenLoad, 300);
    }
}

#[test]
fn a_stall_is_detected_in_stealth_chop_at_speed() {
    let stalls = |status, step_time, load| {
        let mut bench = Bench::configured(true);
        for (register, value) in [(DRV_STATUS, status), (TSTEP, step_time), (SG_RESULT, load)] {
            bench.set(HEAD, register, value);
            bench.set(FEED, register, value);
        }
        bench.run(200);
        bench.found()
    };
    // The feed's driver runs in SpreadCycle, in which it does not measure the load.
    assert_eq!(stalls(TURNING, 200, 100), Some((Motor::Head, DriverProblem::Stall)));
    for (status, step_time, load) in [
        (TURNING, 200, 102),
        (TURNING, 235, 0),
        (STANDING, 200, 0),
        // The driver has switched to SpreadCycle.
        (0, 200, 0),
    ] {
        assert_eq!(stalls(status, step_time, load), None);
    }
}

#[test]
fn a_restarted_driver_is_a_problem_in_use_and_reconfigured_at_rest() {
    let mut bench = Bench::configured(true);
    bench.wire.chip(HEAD, super::fake_bus::Chip::start_anew);
    bench.finds(Motor::Head, DriverProblem::Reset, 60);
    bench.run(1000);
    assert_eq!(bench.found(), Some((Motor::Head, DriverProblem::Reset)), "for as long as the motor is in use");
    assert_eq!(bench.wire.register(HEAD, IFCNT), 0);
    bench.in_use = false;
    bench.run(200);
    assert_eq!((bench.found(), bench.drivers.are_configured()), (None, true));
    assert_eq!((bench.wire.register(HEAD, IFCNT), bench.wire.register(HEAD, GSTAT)), (12, 0));
}

#[test]
fn flags_of_a_past_short_are_cleared_at_rest() {
    let mut bench = Bench::configured(true);
    bench.set(HEAD, GSTAT, 0b010);
    bench.set(HEAD, DRV_STATUS, STANDING | 1 << 2);
    bench.finds(Motor::Head, DriverProblem::ShortToGround, 60);
    // The pin EN clears the flag of the short.
    bench.in_use = false;
    bench.set(HEAD, DRV_STATUS, STANDING);
    bench.run(300);
    assert_eq!((bench.found(), bench.drivers.are_configured()), (None, true));
    assert_eq!(bench.wire.register(HEAD, GSTAT), 0);
}

#[test]
fn a_full_transmit_or_receive_buffer_does_not_block() {
    let mut bench = Bench::new();
    bench.wire.0.borrow_mut().full = true;
    bench.finds(Motor::Head, DriverProblem::Silent, 200);
    let mut bench = Bench::new();
    bench.wire.0.borrow_mut().babbles = Some(0x05);
    bench.run(1000);
    assert_eq!(bench.found(), None, "answers are found among other bytes");
    assert!(bench.drivers.are_configured());
}

/// Serial line that delivers arbitrary bytes, whatever is sent.
struct Noise<'a> {
    bytes: std::slice::Iter<'a, u8>,
    rooms: std::iter::Cycle<std::slice::Iter<'a, bool>>,
}

impl SingleWireUart for Noise<'_> {
    fn send(&mut self, bytes: &[u8]) -> bool {
        assert!((1..=8).contains(&bytes.len()));
        *self.rooms.next().unwrap()
    }

    fn receive(&mut self) -> Option<u8> {
        self.bytes.next().copied()
    }
}

proptest! {
    #[test]
    fn random_bytes_cause_no_panic_and_no_false_configuration(
        bytes in prop::collection::vec(prop_oneof![any::<u8>(), Just(0x05), Just(0xFF), Just(0x02)], 0..4000),
        rooms in prop::collection::vec(any::<bool>(), 1..20),
        uses in prop::collection::vec(any::<bool>(), 1..20),
        step_us in 1_u64..100_000,
    ) {
        let settings = DriverConfig {
            address: 0,
            sense_ohm: 0.11,
            current_a: 0.8,
            microsteps: 16,
            spread_cycle: false,
            stall_threshold: Some(50),
        };
        let noise = Noise { bytes: bytes.iter(), rooms: rooms.iter().cycle() };
        let mut drivers = Tmc2209::new(noise, [settings; 2]);
        for (poll, in_use) in (0..500).zip(uses.iter().cycle()) {
            drivers.poll(poll * step_us, *in_use);
        }
        prop_assert!(!drivers.are_configured());
    }
}
