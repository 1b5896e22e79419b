//! Faults of the tip with the Pico's firmware, at its converter and its pins, compared with the simulated board. The
//! Pico must report the right codes about as soon and switch everything off.
//!
//! The test runs some faults. `GROWBOT_FAULTS=all cargo test -p growbot-tests --test it emulated_rp2040_faults:: --
//! --nocapture` runs every fault of the campaign and prints their table, which takes a quarter of an hour. Names of
//! faults, separated by commas, run these instead of `all`. Only the fault `step-interrupt-stopped` of the campaign
//! cannot come through pins, because it is a fault of the processor.

use std::cell::{RefCell, RefMut};
use std::rc::Rc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use growbot_client::client::{Client, ClientError};
use growbot_client::port::Port;
use growbot_client::stop_signal::Permit;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerEncoder;
use growbot_core::link::message::{
    AppendLayers, BeginJob, EnergizingRequest, Fault, HostSilencePolicy, PassiveRequest, Start, State, Status,
};
use growbot_core::robot::Robot;
use growbot_plan::robot_file;
use growbot_sim::port::rp2040::Rp2040Emulator;
use growbot_sim::port::sim::Sim;
use growbot_sim::tip::{TipFault, TipModel};
use growbot_tests::fault_campaign::cases::{Case, Expected, Onset};
use growbot_tests::pico_firmware;

/// Cases that run without `GROWBOT_FAULTS`.
const FEW: [Case; 8] = [
    Case { fault: TipFault::ThermistorOpen, onset: Onset::Heating },
    Case { fault: TipFault::ThermistorSilent, onset: Onset::FirstLayer },
    Case { fault: TipFault::SecondSwitchClosed, onset: Onset::Boot },
    Case { fault: TipFault::DriverFault, onset: Onset::FirstLayer },
    Case { fault: TipFault::FilamentJam, onset: Onset::FirstLayer },
    Case { fault: TipFault::SupplyLow { volts: 9.0 }, onset: Onset::FirstLayer },
    Case { fault: TipFault::EmergencyStop, onset: Onset::FirstLayer },
    Case { fault: TipFault::FilamentOut, onset: Onset::Boot },
];
/// Max delay of the Pico's detection of a fault after that of the simulated board, s. The delay may be longer by the
/// fraction [`LATER`], because readings of 0.1 s begin at other times, and the heater starts from other readings.
const LATER_S: f64 = 0.3;
/// Delay of the Pico's detection that is allowed in addition to [`LATER_S`], as a fraction of the time that the
/// simulated board takes to detect the fault.
const LATER: f64 = 0.02;
/// Time limit for a board to reach a state, ms of its own clock.
const PATIENCE_MS: u64 = 900_000;
/// Number of layers of the job.
const LAYERS: u32 = 4;
/// Identifier of the job.
const PLAN: u64 = 1;
/// Temperature of the nozzle when a growth begins, for faults during heating, degrees Celsius.
const HEATING_C: f64 = 60.0;
/// Temperature of the nozzle when a growth begins, for all faults that do not begin during heating, degrees Celsius.
const WARM_C: f64 = 197.0;

/// Returns a case for every fault that can come through the pins, during heating and in the first layer. Faults that
/// the board's tests at its start can notice have a case at the start, too.
fn all() -> Vec<Case> {
    let at_boot = |fault: &TipFault| matches!(fault, TipFault::SecondSwitchClosed | TipFault::FilamentOut);
    TipFault::ALL
        .into_iter()
        .filter(|fault| *fault != TipFault::StepInterruptStopped)
        .flat_map(|fault| {
            let onsets = [Onset::Boot, Onset::Heating, Onset::FirstLayer];
            onsets.into_iter().skip(usize::from(!at_boot(&fault))).map(move |onset| Case { fault, onset })
        })
        .collect()
}

fn robot() -> Robot {
    robot_file::load("growbot-a".as_ref()).unwrap()
}

/// A board under test.
trait BoardUnderTest: Port + 'static {
    fn tip(&mut self) -> RefMut<'_, TipModel>;
}

impl BoardUnderTest for Sim {
    fn tip(&mut self) -> RefMut<'_, TipModel> {
        self.simulated_tip()
    }
}

impl BoardUnderTest for Rp2040Emulator {
    fn tip(&mut self) -> RefMut<'_, TipModel> {
        self.simulated_tip()
    }
}

/// Reaction of a board to a fault.
#[derive(Debug, PartialEq)]
struct CaseResult {
    state: State,
    fault: Option<Fault>,
    /// Time until the board noticed the fault, s.
    after: f64,
}

impl CaseResult {
    fn is_right(&self, case: &Case) -> bool {
        let is_one_of =
            |codes: &[Fault]| self.state == State::Fault && self.fault.is_some_and(|fault| codes.contains(&fault));
        match case.expected() {
            Expected::Codes(codes) | Expected::AtNextStart(codes) => is_one_of(codes),
            Expected::CodesOrPause(codes) => self.state == State::Paused || is_one_of(codes),
            Expected::EmergencyStop => self.state == State::EmergencyStop,
            Expected::Continues => self.state == State::Done,
            Expected::Refused => self.state == State::Idle,
            Expected::StaysPaused => self.state == State::Paused,
        }
    }

    fn name(&self) -> &'static str {
        self.fault.map_or(self.state.name(), |fault| fault.code())
    }
}

/// A board under test with its client.
struct Bench<B> {
    board: Rc<RefCell<B>>,
    client: Client,
    what: String,
}

impl<B: BoardUnderTest> Bench<B> {
    /// Begins a growth and starts it.
    fn begin(&mut self, nozzle_c: f64) -> Result<(), ClientError> {
        let begin = BeginJob { plan_id: PLAN, layers: LAYERS, robot_hash: robot().hash() };
        self.client.request("to begin", &PassiveRequest::BeginJob(begin))?;
        // The nozzle is warmed only now, because the board erases its journal only with a cold nozzle.
        self.board.borrow_mut().tip().set_nozzle_c(nozzle_c);
        let mut encoder = LayerEncoder::default();
        let layers = (0..LAYERS).map(|_| encoder.encode(&Layer { alpha: 1.0, height: 0.7, tilt: 0.006 })).collect();
        self.client.request(
            "to store layers",
            &PassiveRequest::AppendLayers(AppendLayers { plan_id: PLAN, first: 0, layers }),
        )?;
        let start = Start { plan_id: PLAN, on_host_silence: HostSilencePolicy::Continue, is_continuation: false };
        self.client.energize("to start", &EnergizingRequest::Start(start), &Permit::standalone())?;
        Ok(())
    }

    fn wait_for(&mut self, states: &[State]) -> Status {
        loop {
            let status = self.client.status().unwrap();
            if states.contains(&status.state) {
                return status;
            }
            assert!(status.uptime_ms < PATIENCE_MS, "{}: still {}", self.what, status.state.name());
            let _ = self.client.event(Duration::from_millis(50));
        }
    }

    /// Injects a fault and returns the board's time, ms.
    fn inject(&mut self, fault: TipFault) -> u64 {
        self.board.borrow_mut().tip().inject(fault);
        self.client.status().unwrap().uptime_ms
    }

    /// Returns the result of a growth in which a fault began at `broken_ms`.
    fn end(&mut self, broken_ms: u64) -> CaseResult {
        let status = self.wait_for(&[State::Fault, State::EmergencyStop, State::Done, State::Paused]);
        let noticed_ms = match status.state {
            State::Fault | State::EmergencyStop => {
                self.client.latest_fault().unwrap().expect("a record of it").uptime_ms
            }
            _ => status.uptime_ms,
        };
        let _ = self.client.event(Duration::from_millis(50));
        if matches!(status.state, State::Fault | State::EmergencyStop) {
            let mut board = self.board.borrow_mut();
            let tip = board.tip();
            let off = !tip.heater_is_on() && !tip.steppers_are_on();
            assert!(off && tip.heater_duty() == 0.0, "{}: not all is off", self.what);
        }
        // The board may notice the fault before its time is requested.
        let after = noticed_ms.saturating_sub(broken_ms) as f64 / 1000.0;
        CaseResult { state: status.state, fault: status.fault, after }
    }
}

/// Grows until the onset, injects the fault, and waits for the board's reaction.
fn run_case(board: impl BoardUnderTest, case: Case) -> CaseResult {
    let what = format!("{}, {}", case.fault.name(), case.onset.name());
    let board = Rc::new(RefCell::new(board));
    let client = Client::new(Box::new(Rc::clone(&board)), "the board under test");
    let mut bench = Bench { board, client, what };
    if case.onset == Onset::Boot {
        bench.board.borrow_mut().tip().inject(case.fault);
    }
    bench.client.open_session_for(&robot()).unwrap();
    // The tests at the board's start take a while.
    bench.client.wait(Duration::from_secs(3)).unwrap();
    let begun = bench.begin(if case.onset == Onset::Heating { HEATING_C } else { WARM_C });
    if case.expected() == Expected::Refused {
        assert!(matches!(begun, Err(ClientError::Refused { .. })), "{}: {begun:?}", bench.what);
        let Status { state, fault, .. } = bench.client.status().unwrap();
        return CaseResult { state, fault, after: 0.0 };
    }
    begun.unwrap();
    if case.onset == Onset::Boot {
        let began_ms = bench.client.status().unwrap().uptime_ms;
        return bench.end(began_ms);
    }
    let during = if case.onset == Onset::Heating { State::Heating } else { State::Growing };
    let status = bench.wait_for(&[during, State::Fault]);
    assert_eq!((status.state, status.fault), (during, None), "{}: too early", bench.what);
    let broken_ms = bench.inject(case.fault);
    let met = bench.end(broken_ms);
    if !(matches!(case.expected(), Expected::AtNextStart(_)) && met.state == State::Done) {
        return met;
    }
    bench.begin(WARM_C).unwrap();
    let began_ms = bench.client.status().unwrap().uptime_ms;
    bench.end(began_ms)
}

/// Runs a fault on both boards. Returns a line of the table, or an error message.
fn check(case: Case) -> Result<String, String> {
    let simulated = run_case(Sim::new(robot()), case);
    let pico = run_case(Rp2040Emulator::start(&robot(), Some(&pico_firmware("growbot-a"))).unwrap(), case);
    let (fault, onset, met) = (case.fault.name(), case.onset.name(), [&pico, &simulated]);
    let [name, other] = met.map(CaseResult::name);
    let [after, others] = met.map(|met| met.after);
    let line = format!("| {fault} | {onset} | {name} | {after:.1} | {other} | {others:.1} |");
    if !met.iter().all(|met| met.is_right(&case)) {
        return Err(format!("{line}: right is {:?}", case.expected()));
    }
    if name == other && after > (1.0 + LATER) * others + LATER_S {
        return Err(format!("{line}: too late"));
    }
    Ok(line)
}

#[test]
fn the_pico_detects_faults_like_the_simulation() {
    let mut cases = FEW.to_vec();
    if let Ok(wanted) = std::env::var("GROWBOT_FAULTS") {
        let is_wanted = |case: &Case| wanted.split(',').any(|name| [case.fault.name(), "all"].contains(&name));
        cases = all().into_iter().filter(is_wanted).collect();
    }
    assert!(!cases.is_empty(), "GROWBOT_FAULTS names no fault: give `all`, or a name as in docs/safety-evidence.md");
    let (next, wrong) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    // Three emulators run at a time.
    thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    match check(*case) {
                        Ok(line) => println!("{line}"),
                        Err(why) => wrong.lock().unwrap().push(why),
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
