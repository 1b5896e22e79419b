//! `growbot simulate`: a growth without a robot, with what goes wrong, in open or in closed loop, once or many times.

use std::thread;

use clap::{Args, ValueEnum};
use growbot_client::feedback::ASSUMED;
use growbot_client::plan_file::WrittenTip;
use growbot_client::printable::json_line;
use growbot_client::run_log::WrittenArrival;
use growbot_client::warning::Warning;
use growbot_core::angle::degrees;
use growbot_core::pose::Pose;
use growbot_core::simulation::{DirectionSensor, Disturbance, Sensors};
use growbot_core::slicing::Slicing;
use growbot_core::tracking::Estimate;
use growbot_host::output::print;
use growbot_host::progress::{Progress, Results};
use growbot_sim::simulation::campaign::Campaign;
use growbot_sim::simulation::statistics::Statistics;
use growbot_sim::simulation::{Hung, Outcome, Simulation};
use serde::Serialize;

use super::disturbance::{DisturbanceArgs, signed_percent};
use super::goal::GoalArgs;
use super::units::mm;
use super::{Failure, simulate_table};

/// Simulate a growth with noise, with or without feedback, once or many times
///
/// Lays the plan's layers one by one, each with the errors that are asked for, and tells how near the tip comes. There
/// is no board in it and no clock: `growbot grow` has those. With --feedback the growth of each layer (odometry) and
/// the tip's direction are measured, and the rest of the path is planned again after each layer.
///
/// Errors are those of Del Dottore et al. 2019, Eqs 26 to 28; the normalized one is over the length of the planned
/// path.
#[derive(Args)]
#[command(after_help = AFTER_HELP)]
pub struct SimulateArgs {
    #[command(flatten)]
    goal: GoalArgs,
    /// How the path is cut into layers: so that they end where it does, or into
    /// whole steps, rounded up, as in the paper
    #[arg(long, value_name = "HOW", value_enum, default_value = "exact")]
    slice: Slice,
    /// Height of the whole steps, mm [default: the robot's layer.height_mm]
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = step_mm)]
    step: Option<f64>,
    /// Let the body hang under its own weight (material and tip of the robot's
    /// file; z is up)
    #[arg(long)]
    sag: bool,
    /// Close the loop: measure each layer, and plan the rest again after it
    ///
    /// --odometry-noise and --direction-noise say how well: 1 percent and 0.5 degrees unless given.
    #[arg(long)]
    feedback: bool,
    /// Measure the direction of gravity only: the heading is dead reckoning
    #[arg(long, requires = "feedback")]
    gravity_only: bool,
    /// How much too long the odometry shows everything: its own scale, which no
    /// loop can see
    #[arg(long, value_name = "PERCENT", requires = "feedback", allow_hyphen_values = true, value_parser = signed_percent)]
    odometry_scale: Option<f64>,
    /// Grow this many times, with the seeds N, N + 1, ..., and print statistics
    #[arg(long, value_name = "TIMES", value_parser = clap::value_parser!(u64).range(1..))]
    repeat: Option<u64>,
    /// Threads of a repetition; the results are the same [default: all cores]
    #[arg(long, value_name = "N", requires = "repeat", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Print one line of JSON instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    disturbance: DisturbanceArgs,
}

const AFTER_HELP: &str = "\
Examples:
  growbot simulate plan.json --noise 10
  growbot simulate plan.json --noise 10 --feedback --repeat 1000
  growbot simulate --to 800,0,0,0,0 --from 0,0,0,0,0 --sag
  growbot simulate plan.json --slice whole --step 3.096 --json";

/// How a path is cut, as the command line says it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Slice {
    /// Equal layers that end where the path does
    Exact,
    /// Whole steps, rounded up (the paper's)
    Whole,
}

/// Heights of whole steps that are taken, mm.
const STEPS_MM: [f64; 2] = [0.01, 1e4];

fn step_mm(text: &str) -> Result<f64, String> {
    let [min, max] = STEPS_MM;
    let number = mm(text)?;
    if (min..=max).contains(&number) {
        Ok(number)
    } else {
        Err(format!("it is {number} mm, and may be {min} to {max}: give one within"))
    }
}

/// Runs the command.
pub fn run(args: &SimulateArgs) -> Result<(), Failure> {
    let (robot, plan) = args.goal.robot_and_plan()?;
    warn(&plan.warnings);
    let slicing = args.slicing(robot.description().layer.height_mm)?;
    let mut simulation = Simulation::new(&plan, &robot, slicing);
    simulation.disturbance = args.disturbance.disturbance();
    simulation.sensors = args.sensors();
    simulation.sag = args.sag;
    match args.repeat {
        None => {
            let outcome = simulation.run(args.disturbance.seed);
            warn(&outcome.hung.map(|hung| simulation.warnings(&hung)).unwrap_or_default());
            let seed = args.disturbance.seed;
            Ok(print(&if args.json {
                json_line(&SimulatedGrowth::new(&outcome, simulation.path_length(), seed))
            } else {
                simulate_table::growth(&plan.goal, &outcome, seed)
            })?)
        }
        Some(runs) => {
            let campaign = args.repeat(&simulation, runs);
            warn(&campaign.hung.map(|hung| simulation.warnings(&hung)).unwrap_or_default());
            let seed = args.disturbance.seed;
            Ok(print(&if args.json {
                json_line(&SimulatedCampaign::new(&campaign, simulation.path_length(), seed))
            } else {
                simulate_table::campaign(&campaign, robot.name(), simulation.path_length(), seed)
            })?)
        }
    }
}

fn warn(warnings: &[Warning]) {
    for warning in warnings {
        growbot_host::tell!("growbot: warning, {}: {}", warning.code, warning.message);
    }
}

impl SimulateArgs {
    /// `height`: the robot's full layer, mm.
    fn slicing(&self, height: f64) -> Result<Slicing, Failure> {
        match (self.slice, self.step) {
            (Slice::Whole, _) if self.feedback => Err(Failure::bad_input(
                "--feedback plans each layer by itself, and --slice whole would not be heeded: leave one of them out",
            )),
            (Slice::Whole, step) => Ok(Slicing::Whole { step: step.unwrap_or(height) }),
            (Slice::Exact, None) => Ok(Slicing::Exact),
            (Slice::Exact, Some(_)) => {
                Err(Failure::bad_input("--step is the height of whole steps: add --slice whole, or leave it out"))
            }
        }
    }

    /// What a loop measures.
    fn sensors(&self) -> Option<Sensors> {
        self.feedback.then(|| Sensors {
            noise: self.disturbance.sensor_noise_or(ASSUMED),
            odometry_scale: self.odometry_scale.unwrap_or(0.0) / 100.0,
            direction: if self.gravity_only { DirectionSensor::Gravity } else { DirectionSensor::Tip },
        })
    }

    /// Grows many times and shows how far it is.
    fn repeat(&self, simulation: &Simulation, runs: u64) -> Campaign {
        let Disturbance { growth_noise, tilt_noise, alpha_noise, twist_noise, .. } = simulation.disturbance;
        let even = [growth_noise, tilt_noise, alpha_noise, twist_noise].iter().all(|noise| *noise == 0.0);
        if even && !self.feedback && runs > 1 {
            growbot_host::tell!("growbot: nothing is drawn by chance, so all {runs} growths are the same");
        }
        let threads = self.threads.map_or_else(|| thread::available_parallelism().map_or(1, usize::from), usize::from);
        let mut progress = Progress::start(Some(runs), Results::AtEnd);
        let campaign = Campaign::run(simulation, self.disturbance.seed, runs, threads, |done| {
            progress.at(done, || format!("{done} growths"));
        });
        progress.finish();
        campaign
    }
}

/// A growth as scripts read it.
#[derive(Serialize)]
struct SimulatedGrowth {
    #[serde(flatten)]
    arrival: WrittenArrival,
    layers: u64,
    length_mm: f64,
    path_length_mm: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    feedback: Option<WrittenEstimate>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sag: Option<WrittenSag>,
    seed: u64,
}

impl SimulatedGrowth {
    fn new(outcome: &Outcome, path_length_mm: f64, seed: u64) -> Self {
        let Outcome { grown, arrival, hung } = outcome;
        Self {
            arrival: arrival.into(),
            layers: grown.layers,
            length_mm: grown.length,
            path_length_mm,
            seed,
            feedback: grown.estimate.as_ref().map(WrittenEstimate::from),
            sag: hung.as_ref().map(WrittenSag::from),
        }
    }
}

/// What feedback has found.
#[derive(Serialize)]
struct WrittenEstimate {
    estimate: WrittenTip,
    position_sd_mm: f64,
    direction_sd_deg: f64,
    growth_bias_percent: f64,
    tilt_bias_percent: f64,
    alpha_bias_deg: f64,
    twist_bias_deg: f64,
}

impl From<&Estimate> for WrittenEstimate {
    fn from(estimate: &Estimate) -> Self {
        let bias = &estimate.systematic_errors;
        Self {
            estimate: WrittenTip::from(&Pose::from_frame(&estimate.base_from_tip)),
            position_sd_mm: estimate.position_deviation,
            direction_sd_deg: degrees(estimate.direction_deviation),
            growth_bias_percent: 100.0 * bias.growth,
            tilt_bias_percent: 100.0 * bias.tilt,
            alpha_bias_deg: degrees(bias.alpha),
            twist_bias_deg: degrees(bias.twist),
        }
    }
}

/// Many growths as scripts read them.
#[derive(Serialize)]
struct SimulatedCampaign {
    repeat: u64,
    seed: u64,
    path_length_mm: f64,
    layers: WrittenStatistics,
    position_error_mm: WrittenStatistics,
    normalized_position_error: WrittenStatistics,
    /// Null where no growth has a heading error.
    heading_error_deg: Option<WrittenStatistics>,
    pitch_error_deg: WrittenStatistics,
    direction_error_deg: WrittenStatistics,
    worst_seed: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max_sag: Option<WrittenSag>,
}

impl SimulatedCampaign {
    fn new(campaign: &Campaign, path_length_mm: f64, seed: u64) -> Self {
        Self {
            repeat: campaign.runs,
            seed,
            path_length_mm,
            layers: (&campaign.layers).into(),
            position_error_mm: (&campaign.position_error_mm).into(),
            normalized_position_error: (&campaign.normalized_position_error).into(),
            heading_error_deg: Some(&campaign.heading_error_deg).filter(|errors| !errors.is_empty()).map(Into::into),
            pitch_error_deg: (&campaign.pitch_error_deg).into(),
            direction_error_deg: (&campaign.direction_error_deg).into(),
            worst_seed: campaign.farthest.map(|farthest| farthest.seed),
            max_sag: campaign.hung.as_ref().map(WrittenSag::from),
        }
    }
}

/// The distribution of an error.
#[derive(Serialize)]
struct WrittenStatistics {
    mean: f64,
    sd: f64,
    min: f64,
    p50: f64,
    p95: f64,
    max: f64,
}

impl From<&Statistics> for WrittenStatistics {
    fn from(statistics: &Statistics) -> Self {
        Self {
            mean: statistics.mean(),
            sd: statistics.deviation(),
            min: statistics.min(),
            p50: statistics.percentile(50.0),
            p95: statistics.percentile(95.0),
            max: statistics.max(),
        }
    }
}

/// How a body hangs under its weight.
#[derive(Serialize)]
struct WrittenSag {
    deflection_mm: f64,
    root_stress_mpa: f64,
    root_moment_n_mm: f64,
}

impl From<&Hung> for WrittenSag {
    fn from(hung: &Hung) -> Self {
        Self { deflection_mm: hung.deflection, root_stress_mpa: hung.root.stress, root_moment_n_mm: hung.root.moment }
    }
}
