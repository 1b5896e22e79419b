//! Commands during a growth on the simulated robot: it pauses, continues and stops, and lays each layer once.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::io;
use std::rc::Rc;
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::ground_truth::{GroundTruth, LaidBody, grow_with_ground_truth};
use growbot_client::growth::{CommandQueue, GrowthError, GrowthOptions, OnParked, grow_job};
use growbot_client::port::{Port, PortError};
use growbot_core::layer::Layer;
use growbot_core::link::emergency_stop::EMERGENCY_STOP;
use growbot_core::link::frame::FrameDecoder;
use growbot_core::link::message::{HostSilencePolicy, Message, PauseCause, State};
use growbot_core::path::{Segment, end};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_plan::growth_report::{GrowthReport, Outcome};
use growbot_plan::job::{Command, Job, JobEvent};
use growbot_sim::port::sim::Sim;

/// Grows 20 upright layers. `order` receives all events and can push commands to the queue. Returns the report and the
/// events.
fn grow(order: impl FnMut(&JobEvent, &CommandQueue)) -> (GrowthReport, Vec<JobEvent>) {
    grow_over(order, |sim| Box::new(sim))
}

/// Like [`grow`], over another connection.
fn grow_over(
    order: impl FnMut(&JobEvent, &CommandQueue),
    line: impl FnOnce(Sim) -> Box<dyn Port>,
) -> (GrowthReport, Vec<JobEvent>) {
    let (grown, events) = try_to_grow(order, line);
    (grown.unwrap(), events)
}

/// Like [`grow_over`], but the growth may fail.
fn try_to_grow(
    order: impl FnMut(&JobEvent, &CommandQueue),
    line: impl FnOnce(Sim) -> Box<dyn Port>,
) -> (Result<GrowthReport, GrowthError>, Vec<JobEvent>) {
    try_to_grow_in(HostSilencePolicy::Pause.into(), order, line)
}

/// Like [`try_to_grow`], with these options.
fn try_to_grow_in(
    manner: GrowthOptions,
    order: impl FnMut(&JobEvent, &CommandQueue),
    line: impl FnOnce(Sim) -> Box<dyn Port>,
) -> (Result<GrowthReport, GrowthError>, Vec<JobEvent>) {
    try_to_grow_with(&CommandQueue::default(), manner, order, line)
}

/// Like [`try_to_grow_in`], but with the caller's command queue, so that `line` can add commands to it as well.
fn try_to_grow_with(
    orders: &CommandQueue,
    manner: GrowthOptions,
    mut order: impl FnMut(&JobEvent, &CommandQueue),
    line: impl FnOnce(Sim) -> Box<dyn Port>,
) -> (Result<GrowthReport, GrowthError>, Vec<JobEvent>) {
    let robot: Robot = growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap();
    let path = [Segment::Straight { length: 20.0 * 0.774 }];
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_frame(&end(&path, &start.frame()));
    let job = Job::new(&robot, &start, &goal, &path);
    let mut client = Client::new(line(Sim::new(robot.clone())), "sim");
    let mut events = Vec::new();
    let grown = grow_job(&mut client, &job, manner, orders, &mut |event| {
        order(event, orders);
        events.push(event.clone());
    });
    (grown, events)
}

/// A tip that records where it is placed.
#[derive(Default)]
struct PlacedTip(Vec<Pose>);

impl GroundTruth for PlacedTip {
    fn laid(&mut self) -> Result<LaidBody, PortError> {
        Ok(LaidBody::default())
    }

    fn settled(&mut self, _: usize) -> Vec<Layer> {
        Vec::new()
    }

    fn start_at(&mut self, pose: &Pose) {
        self.0.push(*pose);
    }
}

/// The sensors of a paused or parked body must not change because another growth was refused.
#[test]
fn the_tip_is_placed_only_for_a_body_that_the_board_begins() {
    let robot: Robot = growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap();
    let path = [Segment::Straight { length: 20.0 * 0.774 }];
    let start = Pose::from_degrees([10.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_frame(&end(&path, &start.frame()));
    let job = Job::new(&robot, &start, &goal, &path);
    let mut client = Client::new(Box::new(Sim::new(robot.clone())), "sim");
    let mut tip = PlacedTip::default();
    let mut grow = |pauses: bool| {
        let orders = CommandQueue::default();
        grow_with_ground_truth(Some(&mut tip), &job, &mut |_| (), |on_event| {
            grow_job(&mut client, &job, HostSilencePolicy::Pause, &orders, &mut |event| {
                on_event(event);
                if pauses && matches!(event, JobEvent::Laid { index: 5, .. }) {
                    orders.push(Command::Pause);
                }
            })
        })
    };
    assert_eq!(grow(true).unwrap().outcome, Outcome::Parked);
    assert!(matches!(grow(false), Err(GrowthError::Unfinished { .. })));
    assert_eq!(tip.0, [start]);
}

fn count_events(events: &[JobEvent], expected: &JobEvent) -> usize {
    events.iter().filter(|event| *event == expected).count()
}

#[test]
fn a_growth_pauses_and_continues_on_command_without_repeated_layers() {
    let (grown, events) = grow(|event, orders| match event {
        JobEvent::Laid { index: 4, .. } => orders.push(Command::Pause),
        JobEvent::State(State::Paused) => orders.push(Command::Continue),
        _ => {}
    });
    assert_eq!(grown.outcome, Outcome::Done);
    assert_eq!((grown.body.len(), count_events(&events, &JobEvent::State(State::Paused))), (20, 1));
    assert_eq!(
        (
            count_events(&events, &JobEvent::Command(Command::Pause)),
            count_events(&events, &JobEvent::Command(Command::Continue))
        ),
        (1, 1)
    );
    assert_eq!(events.iter().filter(|event| matches!(event, JobEvent::Laid { .. })).count(), 20);
}

#[test]
fn a_parked_growth_waits_only_if_it_can_be_continued() {
    let park = |parked| {
        let manner = GrowthOptions { parked, ..HostSilencePolicy::Pause.into() };
        let (grown, events) = try_to_grow_in(
            manner,
            |event, orders| match event {
                JobEvent::Laid { index: 4, .. } => orders.push(Command::Pause),
                // Continues only after a status without other events has reported that the board waits.
                JobEvent::Status(status) if status.state == State::Parked => orders.push(Command::Continue),
                _ => {}
            },
            |sim| Box::new(sim),
        );
        (grown.unwrap(), events)
    };
    let (grown, events) = park(OnParked::Wait);
    assert_eq!((grown.outcome, grown.body.len()), (Outcome::Done, 20));
    assert_eq!(events.iter().filter(|event| matches!(event, JobEvent::Laid { .. })).count(), 20);
    assert_eq!(count_events(&events, &JobEvent::State(State::Homing)), 2, "it homes anew");

    let (grown, events) = park(OnParked::End);
    assert_eq!(grown.outcome, Outcome::Parked);
    assert_eq!(count_events(&events, &JobEvent::Command(Command::Continue)), 0);
}

#[test]
fn a_growth_stops_on_stop_and_emergency_stop() {
    for order in [Command::Stop, Command::EmergencyStop] {
        let (grown, events) = grow(|event, orders| {
            if let JobEvent::Laid { index: 4, .. } = event {
                orders.push(order);
            }
        });
        assert_eq!(grown.outcome, Outcome::Stopped);
        assert!((5..=6).contains(&grown.as_built.len()), "{order:?}: {}", grown.as_built.len());
        assert_eq!(count_events(&events, &JobEvent::Command(order)), 1);
    }
}

/// A connection that delivers the reports of the first four laid layers to the host, and no further ones.
struct Unreporting {
    sim: Sim,
    sent: FrameDecoder,
    /// Received bytes of a frame that is not complete yet.
    partial: Vec<u8>,
    to_host: VecDeque<u8>,
    stopped_at: Rc<Cell<Option<Duration>>>,
    /// Time of the latest reception.
    received_at: Rc<Cell<Duration>>,
}

impl Port for Unreporting {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        for frame in bytes.iter().filter_map(|byte| self.sent.push(*byte)).flatten() {
            if let Ok(Message::Stop(_)) = Message::decode(frame.header.kind, &frame.body) {
                self.stopped_at.set(self.stopped_at.get().or(Some(self.sim.now())));
            }
        }
        self.sim.send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        if self.to_host.is_empty() {
            let mut bytes = [0; 256];
            let count = self.sim.receive(&mut bytes, timeout)?;
            for byte in &bytes[..count] {
                self.partial.push(*byte);
                if *byte == 0 {
                    let bytes = std::mem::take(&mut self.partial);
                    let mut decoder = FrameDecoder::default();
                    let frame = bytes.iter().find_map(|byte| decoder.push(*byte)).and_then(Result::ok);
                    let message = frame.and_then(|frame| Message::decode(frame.header.kind, &frame.body).ok());
                    if !matches!(message, Some(Message::LayerLaid(laid)) if laid.index >= 4) {
                        self.to_host.extend(bytes);
                    }
                }
            }
        }
        self.received_at.set(self.sim.now());
        let count = buffer.len().min(self.to_host.len());
        for (slot, byte) in buffer.iter_mut().zip(self.to_host.drain(..count)) {
            *slot = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        self.sim.now()
    }
}

#[test]
fn a_stop_is_confirmed_in_time_although_the_last_reports_are_lost() {
    let (stopped_at, received_at) = (Rc::new(Cell::new(None)), Rc::new(Cell::new(Duration::ZERO)));
    let (grown, _) = grow_over(
        |event, orders| match event {
            JobEvent::Status(status) if status.layers_laid > 4 && stopped_at.get().is_none() => {
                orders.push(Command::Stop);
            }
            _ => {}
        },
        |sim| {
            Box::new(Unreporting {
                sim,
                sent: FrameDecoder::default(),
                partial: Vec::new(),
                to_host: VecDeque::new(),
                stopped_at: Rc::clone(&stopped_at),
                received_at: Rc::clone(&received_at),
            })
        },
    );
    assert_eq!(grown.outcome, Outcome::Stopped);
    assert!(grown.laid > 4 && grown.as_built.len() == 4, "{} laid, {} reported", grown.laid, grown.as_built.len());
    // The service answers that a stop is not confirmed after 10 s.
    let took = received_at.get() - stopped_at.get().unwrap();
    assert!(took < Duration::from_secs(9), "{took:?} on the robot's clock");
}

/// A connection on which all sends but the emergency stop fail while `is_stalled` is true.
struct Stalled {
    sim: Rc<RefCell<Sim>>,
    is_stalled: Rc<Cell<bool>>,
}

impl Port for Stalled {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        if self.is_stalled.get() {
            return Err(PortError::Lost("sim".to_string(), io::Error::other("it accepts no more bytes")));
        }
        self.sim.send(bytes)
    }

    fn send_emergency_stop(&mut self) -> Result<(), PortError> {
        self.sim.send(&EMERGENCY_STOP)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.sim.receive(buffer, timeout)
    }

    fn now(&self) -> Duration {
        self.sim.now()
    }
}

#[test]
fn an_undelivered_stop_becomes_an_emergency_stop() {
    let (is_stalled, board) = (Rc::new(Cell::new(false)), RefCell::new(None));
    let (grown, events) = grow_over(
        |event, orders| {
            if let JobEvent::Laid { index: 4, .. } = event {
                is_stalled.set(true);
                orders.push(Command::Stop);
            }
        },
        |sim| {
            let sim = Rc::new(RefCell::new(sim));
            board.replace(Some(Rc::clone(&sim)));
            Box::new(Stalled { sim, is_stalled: Rc::clone(&is_stalled) })
        },
    );
    assert_eq!(grown.outcome, Outcome::Stopped);
    assert_eq!(count_events(&events, &JobEvent::State(State::EmergencyStop)), 1);
    assert_eq!(board.take().map(|sim| sim.borrow().state()), Some(State::EmergencyStop));
}

/// A connection that loses the next `losses` sends to the board.
struct Disconnecting {
    sim: Sim,
    /// Number of further sends that are lost.
    losses: Rc<Cell<u32>>,
}

impl Port for Disconnecting {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        match self.losses.get() {
            0 => self.sim.send(bytes),
            left => {
                self.losses.set(left - 1);
                Ok(())
            }
        }
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.sim.receive(buffer, timeout)
    }

    fn now(&self) -> Duration {
        self.sim.now()
    }
}

#[test]
fn a_command_is_retried_after_a_link_loss() {
    // The losses exceed the retries of a command, but not those of all requests.
    for (order, losses) in [(Command::Pause, 150), (Command::Stop, 150), (Command::EmergencyStop, 50)] {
        let cut = Rc::new(Cell::new(0));
        let mut given = false;
        let (grown, events) = grow_over(
            |event, orders| match event {
                JobEvent::Laid { index: 4, .. } if !given => {
                    given = true;
                    cut.set(losses);
                    orders.push(order);
                }
                // The board holds by now, because of the command or because its host was silent.
                JobEvent::Status(status) if status.state == State::Paused => orders.push(Command::Continue),
                _ => {}
            },
            |sim| Box::new(Disconnecting { sim, losses: Rc::clone(&cut) }),
        );
        let expected = if order == Command::Pause { Outcome::Done } else { Outcome::Stopped };
        assert_eq!((grown.outcome, cut.get()), (expected, 0), "{order:?}");
        assert!(count_events(&events, &JobEvent::NoResponse) > 0, "{order:?} was not cut off");
        assert!(count_events(&events, &JobEvent::Command(order)) > 1, "{order:?} was not given again");
    }
}

/// A connection that counts the requests to start.
struct Overheard {
    sim: Sim,
    receiver: FrameDecoder,
    starts: Rc<Cell<u32>>,
    /// True if the connection delivers no bytes to the host after the first request to start.
    goes_deaf: bool,
}

impl Port for Overheard {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.count_starts(bytes);
        self.sim.send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        let count = self.sim.receive(buffer, timeout)?;
        Ok(if self.goes_deaf && self.starts.get() > 0 { 0 } else { count })
    }

    fn now(&self) -> Duration {
        self.sim.now()
    }
}

impl Overheard {
    fn new(sim: Sim, starts: &Rc<Cell<u32>>, goes_deaf: bool) -> Self {
        Self { sim, receiver: FrameDecoder::default(), starts: Rc::clone(starts), goes_deaf }
    }

    fn count_starts(&mut self, bytes: &[u8]) {
        for frame in bytes.iter().filter_map(|byte| self.receiver.push(*byte)).flatten() {
            let is_start = matches!(Message::decode(frame.header.kind, &frame.body), Ok(Message::Start(_)));
            self.starts.set(self.starts.get() + u32::from(is_start));
        }
    }
}

#[test]
fn a_start_with_a_lost_response_may_have_heated() {
    let starts = Rc::default();
    let outcome = try_to_grow(|_, _| {}, |sim| Box::new(Overheard::new(sim, &starts, true))).0;
    assert!(starts.get() > 0);
    let Err(error @ GrowthError::Interrupted(_)) = outcome else { panic!("{outcome:?}") };
    assert!(error.to_string().contains("the robot may still be growing"), "{error}");
}

/// A connection that loses 40 sends from the second request to start on. After two lost sends, it pushes a pause to the
/// command queue.
struct PausedInRepetitions {
    overheard: Overheard,
    orders: Rc<CommandQueue>,
    lost: u32,
}

impl Port for PausedInRepetitions {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.overheard.count_starts(bytes);
        if self.overheard.starts.get() < 2 || self.lost == 40 {
            return self.overheard.sim.send(bytes);
        }
        self.lost += 1;
        if self.lost == 2 {
            self.orders.push(Command::Pause);
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.overheard.receive(buffer, timeout)
    }

    fn now(&self) -> Duration {
        self.overheard.now()
    }
}

/// Tests a Continue followed by a Pause while no bytes reach the board, as when a person presses both buttons.
#[test]
fn a_pause_ends_the_repetitions_of_an_earlier_continue() {
    let (starts, orders) = (Rc::new(Cell::new(0)), Rc::new(CommandQueue::default()));
    let mut seen = Vec::new();
    let line = |sim| -> Box<dyn Port> {
        let overheard = Overheard::new(sim, &starts, false);
        Box::new(PausedInRepetitions { overheard, orders: Rc::clone(&orders), lost: 0 })
    };
    let mut pauses = 0;
    let manner = HostSilencePolicy::Pause.into();
    let (grown, events) = try_to_grow_with(
        &orders,
        manner,
        |event, orders| match event {
            JobEvent::Laid { index: 4, .. } => orders.push(Command::Pause),
            JobEvent::Status(status) if status.state == State::Paused => {
                pauses += 1;
                seen.push(starts.get());
                match pauses {
                    1 => orders.push(Command::Continue),
                    // The board has the second pause, and nothing starts it again without an order.
                    5 => orders.push(Command::Stop),
                    _ => {}
                }
            }
            _ => {}
        },
        line,
    );
    assert_eq!(grown.unwrap().outcome, Outcome::Stopped);
    assert_eq!(seen, [1, 3, 3, 3, 3], "one start, and two transmissions of the voided one");
    assert_eq!(count_events(&events, &JobEvent::Command(Command::Pause)), 2);
}

#[test]
fn a_stop_before_the_start_heats_nothing() {
    for stops in [false, true] {
        let starts = Rc::new(Cell::new(0));
        let (grown, _) = grow_over(
            |event, orders| {
                if stops && matches!(event, JobEvent::Board(_)) {
                    orders.push(Command::Stop);
                }
            },
            |sim| Box::new(Overheard::new(sim, &starts, false)),
        );
        assert_eq!(grown.outcome, if stops { Outcome::Stopped } else { Outcome::Done });
        assert_eq!(starts.get(), u32::from(!stops));
    }
}

#[test]
fn commands_in_any_state_keep_the_body_complete() {
    for (state, order) in
        [(State::Heating, Command::Pause), (State::Homing, Command::Pause), (State::Growing, Command::Continue)]
    {
        let (grown, events) = grow(|event, orders| match event {
            JobEvent::State(now) if *now == state => orders.push(order),
            JobEvent::State(State::Paused) | JobEvent::CommandFailed(_) => orders.push(Command::Continue),
            _ => {}
        });
        assert_eq!((grown.outcome, grown.body.len()), (Outcome::Done, 20), "{state:?}, {order:?}");
        assert_eq!(
            count_events(&events, &JobEvent::State(State::Paused)) > 0,
            order == Command::Pause,
            "{state:?}, {order:?}"
        );
    }
}

/// Tests that a new spool can be loaded only with commands, as the web page and the terminal send them.
#[test]
fn a_growth_without_filament_waits_and_continues_its_layer() {
    let board = Rc::new(RefCell::new(None::<Rc<RefCell<Sim>>>));
    let (sim_of, mut steps) =
        (Rc::clone(&board), vec![Command::Continue, Command::Purge, Command::Load, Command::Preheat]);
    let manner = GrowthOptions { ..HostSilencePolicy::Pause.into() };
    let mut refused = Vec::new();
    let (grown, events) = try_to_grow_in(
        manner,
        |event, orders| match event {
            JobEvent::CommandFailed(why) => {
                // The board is still moving, so the command is sent again with the next status.
                refused.push(why.clone());
                steps.push(orders_of(why));
            }
            JobEvent::Status(status)
                if status.state == State::Paused && status.pause_cause == PauseCause::FilamentOut =>
            {
                sim_of.borrow().as_ref().unwrap().borrow_mut().load_filament(100_000.0);
                if let Some(order) = steps.pop() {
                    orders.push(order);
                }
            }
            _ => {}
        },
        |mut sim| {
            sim.load_filament(600.0);
            let sim = Rc::new(RefCell::new(sim));
            *board.borrow_mut() = Some(Rc::clone(&sim));
            Box::new(sim)
        },
    );
    let grown = grown.unwrap();
    assert_eq!((grown.outcome, grown.body.len()), (Outcome::Done, 20), "{refused:?}");
    assert_eq!(count_events(&events, &JobEvent::State(State::Paused)), 1);
    assert!(events.iter().filter(|event| matches!(event, JobEvent::Laid { .. })).count() == 20);
    assert!(
        refused.iter().all(|why| why.contains("still moving")) && !refused.is_empty(),
        "one after the other: {refused:?}"
    );
}

/// Returns the command that was rejected for this reason.
fn orders_of(why: &str) -> Command {
    if why.contains("to start") { Command::Continue } else { Command::Load }
}
