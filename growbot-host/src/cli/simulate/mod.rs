//! `growbot simulate`: simulates growths with errors, without a robot, in open or closed loop, once or many times.

mod body_file;
mod samples;
mod table;

use std::path::PathBuf;
use std::thread;

use clap::{Args, ValueEnum};
use growbot_core::simulation::{DirectionSensor, Disturbance, DisturbedLayer, SimulatedSensors};
use growbot_core::slicing::Slicing;
use growbot_host::output::{is_standard_output, print, write_to};
use growbot_host::progress::{Progress, ResultTiming};
use growbot_pictures::view::{SimulatedBody, Subject};
use growbot_plan::atomic_file::refuse_inputs;
use growbot_plan::feedback::DEFAULT_SENSOR_NOISE;
use growbot_plan::plan_deviation::{PlanDeviation, centreline};
use growbot_plan::sanitize::json_line;
use growbot_plan::warning::Warning;
use growbot_sim::simulation::campaign::Campaign;
use growbot_sim::simulation::disturbance_report::DisturbanceReport;
use growbot_sim::simulation::json::{SimulatedCampaign, SimulatedGrowth};
use growbot_sim::simulation::{Simulation, SimulationResult};

use self::samples::Samples;
use super::body_input::BodyInput;
use super::disturbance::{DisturbanceArgs, signed_percent};
use super::failure::Failure;
use super::growth_monitor::ResultFormat;
use super::output_format::OutputFormat;
use super::plan_source::PlanSourceArgs;
use super::remedies;
use super::units::mm;

/// Simulate a growth with noise, with or without feedback, once or many times
///
/// The command lays the plan's layers one by one, each with the given errors, and prints how near the tip comes to its
/// goal. The simulation has no board and no clock, unlike `growbot grow`. With --feedback the growth of each layer
/// (odometry) and the tip's direction are measured. The rest of the path is planned again after each layer.
///
/// Errors are those of Del Dottore et al. 2019, Eqs 26 to 28. The normalized error is relative to the length of the
/// planned path.
///
/// Noise of layers is uniform, given by its half-width: 10 means anywhere from -10 to +10. Noise of sensors is normal,
/// given by its standard deviation (SD). All draws are independent, from layer to layer and of each other, with mean 0.
///
/// In a scene, of the plan or of --scene, the command prints whether the true body touches an obstacle, and the first
/// contact. With --repeat it prints how many bodies do. With --feedback each correction stays clear of the obstacles,
/// as in `growbot grow`.
///
/// --samples writes one row of CSV for each growth. -o writes the body as it was laid, or the result as JSON.
#[derive(Args)]
#[command(after_help = AFTER_HELP)]
pub struct SimulateArgs {
    #[command(flatten)]
    goal: PlanSourceArgs,
    /// Slicing of the path: into layers that end where it does, or into whole steps, rounded up, as in the paper
    #[arg(long, value_name = "HOW", value_enum, default_value = "exact")]
    slice: SliceArg,
    /// Height of the whole steps, mm [default: the robot's layer.height_mm]
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = step_mm)]
    step: Option<f64>,
    /// Let the body hang under its own weight (with material and tip of the robot's file, and z up)
    #[arg(long)]
    sag: bool,
    /// Close the loop: measure each layer, and plan the rest again after it
    ///
    /// --odometry-noise and --direction-noise set the accuracy of the sensors. The defaults are 1 percent and 0.5
    /// degrees.
    #[arg(long)]
    feedback: bool,
    /// Measure only the direction of gravity: the heading is dead reckoning
    #[arg(long, requires = "feedback")]
    gravity_only: bool,
    /// Excess of all lengths that the odometry shows: an error of its scale, which no loop can detect
    #[arg(long, value_name = "PERCENT", requires = "feedback", allow_hyphen_values = true, value_parser = signed_percent)]
    odometry_scale: Option<f64>,
    /// Grow this many times, with the seeds N, N + 1, ..., and print statistics
    #[arg(long, value_name = "TIMES", value_parser = clap::value_parser!(u64).range(1..))]
    repeat: Option<u64>,
    /// Threads of a repetition, which do not change the results [default: all cores]
    #[arg(long, value_name = "N", requires = "repeat", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Write every growth as a row of CSV to this file
    ///
    /// The columns are the seed, start, goal and final pose, layers, lengths, all errors, in a scene the contact,
    /// clearance, detours and pause, and the disturbances with their distributions. The names of the columns contain
    /// the units.
    #[arg(long, value_name = "FILE")]
    samples: Option<PathBuf>,
    /// Write the body as it was laid to this file, in the format of its extension: .csv, .stl, .obj, .3mf, .glb, .html,
    /// .svg, .png, .pdf. With .json, write the result
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
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
  growbot simulate plan.json --noise 10 --repeat 1000 --samples growths.csv
  growbot simulate plan.json --noise 10 --seed 7 -o body.stl
  growbot simulate --to 800,0,0,0,0 --from 0,0,0,0,0 --sag
  growbot simulate plan.json --noise 10 --repeat 1000 --scene room.toml
  growbot simulate plan.json --slice whole --step 3.096 --json";

/// Slicing of a path on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SliceArg {
    /// Equal layers that end where the path does
    Exact,
    /// Whole steps, rounded up (the paper's)
    Whole,
}

/// Greatest number of layers of a body that is compared with its plan.
const MAX_COMPARED_LAYERS: u64 = 1_000_000;

/// Range of the height of whole steps, mm.
const STEPS_MM: [f64; 2] = [0.01, 1e4];

fn step_mm(text: &str) -> Result<f64, String> {
    let [min, max] = STEPS_MM;
    let number = mm(text)?;
    if (min..=max).contains(&number) {
        Ok(number)
    } else {
        Err(format!("the value is {number} mm: give {min} to {max} mm"))
    }
}

/// Runs the command.
pub fn run(args: &SimulateArgs) -> Result<(), Failure> {
    let (opened, unclear) = args.goal.open(ResultFormat::of(args.json))?;
    let BodyInput { robot, plan, .. } = &opened;
    warn(&plan.warnings);
    let slicing = args.slicing(robot.description().layer.height_mm)?;
    let mut simulation = Simulation::new(plan, robot, slicing);
    simulation.disturbance = args.disturbance.disturbance();
    simulation.sensors = args.sensors();
    simulation.sag = args.sag;
    simulation.scene = opened.scene();
    if let Some(unclear) = unclear {
        growbot_host::warning!("{}", remedies::message(&unclear));
    }
    let body = args.body_format()?;
    args.samples.as_deref().map_or(Ok(()), |samples| Samples::check(samples, ResultFormat::of(args.json)))?;
    let seed = args.disturbance.seed;
    let (table, json) = match args.repeat {
        None => {
            let (outcome, laid) = args.grow_once(&simulation)?;
            warn(&outcome.sag.map(|hung| simulation.warnings(&hung)).unwrap_or_default());
            if let (Some(file), Some(format)) = (&args.output, body) {
                let name = args.goal.name("growbot simulate");
                let layers = simulation.layers_as_laid(&laid);
                let body = SimulatedBody { layers: &layers, tip: outcome.arrival.final_pose };
                body_file::write(file, format, &Subject { laid: Some(body), ..opened.subject(&name) })?;
            }
            let disturbances = DisturbanceReport::of(&simulation, seed);
            let deviation = (outcome.grown.layers <= MAX_COMPARED_LAYERS).then(|| {
                let layers = simulation.layers_as_laid(&laid);
                PlanDeviation::of(plan, robot, &centreline(&plan.start.frame(), layers))
            });
            let table = table::growth(&plan.goal, &outcome, deviation.as_ref(), &disturbances, seed);
            (table, json_line(&SimulatedGrowth::new(&outcome, deviation, &simulation, seed)))
        }
        Some(runs) => {
            let campaign = args.repeat(&simulation, runs)?;
            warn(&campaign.hung.map(|hung| simulation.warnings(&hung)).unwrap_or_default());
            let table = table::campaign(&campaign, robot.name(), &simulation, seed);
            (table, json_line(&SimulatedCampaign::new(&campaign, &simulation, seed)))
        }
    };
    if let Some(file) = args.output.as_ref().filter(|_| body.is_none()) {
        if !write_to(file, json.as_bytes())? {
            return Ok(());
        }
        growbot_host::note!("result written to {}", file.display());
    }
    if args.samples.as_deref().is_some_and(is_standard_output) {
        // The samples are the requested output.
        return Ok(());
    }
    Ok(print(if args.json { &json } else { &table })?)
}

fn warn(warnings: &[Warning]) {
    for warning in warnings {
        growbot_host::warning!("{}: {}", warning.code, remedies::warning_message(warning));
    }
}

impl SimulateArgs {
    /// Returns the slicing that the options choose. `height` is the height of the robot's full layer, mm.
    fn slicing(&self, height: f64) -> Result<Slicing, Failure> {
        match (self.slice, self.step) {
            (SliceArg::Whole, _) if self.feedback => Err(Failure::bad_input(
                "--feedback plans each layer separately, so --slice whole has no effect: remove one of them",
            )),
            (SliceArg::Whole, step) => Ok(Slicing::Whole { step: step.unwrap_or(height) }),
            (SliceArg::Exact, None) => Ok(Slicing::Exact),
            (SliceArg::Exact, Some(_)) => Err(Failure::bad_input(
                "--step is the height of whole steps, but --slice whole is not given: add --slice whole, or remove \
                 --step",
            )),
        }
    }

    /// Returns the sensors of the closed loop. `None` without feedback.
    fn sensors(&self) -> Option<SimulatedSensors> {
        self.feedback.then(|| SimulatedSensors {
            noise: self.disturbance.sensor_noise_or(DEFAULT_SENSOR_NOISE),
            odometry_scale: self.odometry_scale.unwrap_or(0.0) / 100.0,
            direction: if self.gravity_only { DirectionSensor::Gravity } else { DirectionSensor::Tip },
        })
    }

    /// Returns the format of the body in the output file. `None` if the output file is for the result, or without an
    /// output file.
    fn body_format(&self) -> Result<Option<OutputFormat>, Failure> {
        let Some(file) = &self.output else { return Ok(None) };
        let format = body_file::format_of(file)?;
        refuse_inputs(file)?;
        match format {
            Some(_) if self.repeat.is_some() => Err(Failure::bad_input(
                "--repeat simulates many growths, but the file of -o holds one body: remove --repeat and choose a \
                 growth with --seed, or give a file that ends in .json",
            )),
            format => Ok(format),
        }
    }

    /// Grows once, and returns the layers as laid. Without an output file, it returns only as many as are compared with
    /// the plan.
    fn grow_once(&self, simulation: &Simulation) -> Result<(SimulationResult, Vec<DisturbedLayer>), Failure> {
        let mut laid = Vec::new();
        let outcome = simulation.run_by_layer(self.disturbance.seed, |layer| {
            if self.output.is_some() || (laid.len() as u64) <= MAX_COMPARED_LAYERS {
                laid.push(*layer);
            }
        });
        if let Some(file) = &self.samples {
            let seed = self.disturbance.seed;
            Samples::write(file, simulation, |samples| samples.add(seed, &outcome))?;
        }
        Ok((outcome, laid))
    }

    /// Grows many times, shows the progress, and writes every growth if samples are requested.
    fn repeat(&self, simulation: &Simulation, runs: u64) -> Result<Campaign, Failure> {
        let Disturbance { growth_noise, tilt_noise, alpha_noise, twist_noise, .. } = simulation.disturbance;
        let even = [growth_noise, tilt_noise, alpha_noise, twist_noise].iter().all(|noise| *noise == 0.0);
        if even && !self.feedback && runs > 1 {
            growbot_host::note!("no noise is given, so all {runs} growths are the same");
        }
        let threads = self.threads.map_or_else(|| thread::available_parallelism().map_or(1, usize::from), usize::from);
        let mut progress = Progress::start(Some(runs), ResultTiming::AtEnd);
        let at = |done| progress.update(done, || format!("{done} growths"));
        let seed = self.disturbance.seed;
        let campaign = match &self.samples {
            None => Campaign::run(simulation, seed, runs, threads, at),
            Some(file) => Samples::write(file, simulation, |samples| {
                Campaign::run_each(simulation, seed, runs, threads, at, |seed, outcome| samples.add(seed, outcome))
            })?,
        };
        progress.finish();
        Ok(campaign)
    }
}
