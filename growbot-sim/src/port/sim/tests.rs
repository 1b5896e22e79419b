use embedded_storage::nor_flash::NorFlash;
use growbot_client::client::Client;
use growbot_client::ground_truth::grow_with_ground_truth;
use growbot_client::growth::{CommandQueue, grow_job};
use growbot_core::link::message::HostSilencePolicy;
use growbot_core::path::{Segment, end};
use growbot_core::pose::Pose;
use growbot_firmware::safety::retained::RetainedStore;
use growbot_plan::growth_report::GrowthReport;
use growbot_plan::job::{Job, JobEvent};

use super::*;

fn robot() -> Robot {
    growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap()
}

/// Grows an upright body of this many layers.
fn grow(sim: Sim, layers: u32) -> GrowthReport {
    let robot = sim.robot.clone();
    let path = [Segment::Straight { length: 0.774 * f64::from(layers) }];
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_frame(&end(&path, &start.frame()));
    let job = Job::new(&robot, &start, &goal, &path);
    let mut simulation = sim.tip_handle();
    let mut client = Client::new(Box::new(sim), "a simulated board");
    let grow = |on_event: &mut dyn FnMut(&JobEvent)| {
        grow_job(&mut client, &job, HostSilencePolicy::Pause, &CommandQueue::default(), on_event)
    };
    grow_with_ground_truth(Some(simulation.as_mut()), &job, &mut |_| {}, grow).unwrap()
}

#[test]
fn every_run_is_identical() {
    let [first, second] = [(); 2].map(|()| grow(Sim::new(robot()), 3));
    assert_eq!(first.body, second.body);
    let other = grow(Sim::with(robot(), Variation { seed: 2, power: 0.9, ..Variation::default() }), 3);
    assert_eq!(first.body.len(), other.body.len());
}

#[test]
fn a_board_that_hangs_is_reset_by_its_watchdog() {
    let mut sim = Sim::new(robot());
    sim.run_for(Duration::from_secs(10));
    assert_eq!(sim.boots(), 1);
    sim.next_poll = u64::MAX;
    sim.run_for(Duration::from_millis(1100));
    assert_eq!(sim.boots(), 2);
    sim.run_for(Duration::from_secs(10));
    assert_eq!(sim.boots(), 2);
    assert!((sim.now_s() - 21.1).abs() < 1e-3);
}

#[test]
fn a_reset_switches_outputs_off_and_keeps_tip_and_retained_memory() {
    let mut sim = Sim::new(robot());
    sim.simulated_tip().set_heater(1.0, true);
    sim.simulated_tip().set_enabled(Motor::Head, true);
    sim.simulated_tip().set_nozzle_c(150.0);
    let before = RetainedStore::find(&mut sim.retained()).1;
    assert!(before.is_ok());
    sim.reset(ResetCause::External);
    assert_eq!(RetainedStore::find(&mut sim.retained()).1, before);
    assert_eq!((sim.state(), sim.fault()), (State::SelfTest, None));
    let mut tip = sim.simulated_tip();
    assert!(!tip.heater_is_on() && !tip.steppers_are_on() && tip.heater_power_w() == 0.0);
    assert!((tip.nozzle_c() - 150.0).abs() < 1e-9);
    drop(tip);
    sim.reset(ResetCause::PowerOn);
    assert_eq!(sim.state(), State::SelfTest);
}

#[test]
fn flash_is_kept_and_a_power_loss_during_a_write_restarts_the_board() {
    let mut sim = Sim::new(robot());
    let mut flash = sim.flash();
    flash.write(0, b"kept").unwrap();
    sim.reset(ResetCause::PowerOn);
    flash.lose_power_after(2, 1);
    flash.write(4, b"lost").unwrap_err();
    sim.run_for(Duration::from_secs(1));
    assert_eq!(sim.boots(), 3);
    assert_eq!(flash.bytes()[..6], *b"keptlo");
}

#[test]
fn with_the_step_interrupt_stopped_nothing_moves() {
    let mut sim = Sim::new(robot());
    sim.inject(TipFault::StepInterruptStopped);
    let before = sim.simulated_tip().head_position();
    sim.run_for(Duration::from_secs(3));
    assert!((sim.now_s() - 3.0).abs() < 1e-3);
    assert_eq!(sim.simulated_tip().head_position(), before);
    sim.clear_fault(TipFault::StepInterruptStopped);
    sim.run_for(Duration::from_secs(1));
}
