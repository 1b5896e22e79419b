//! `growbot export`: a body in the format of another tool.

use std::path::PathBuf;
use std::slice;

use clap::{Args, ValueEnum};
use growbot_host::output::{is_standard_output, print_bytes};
use growbot_pictures::export::body::ExportedBody;
use growbot_pictures::export::mcap::Encoding;
use growbot_pictures::export::mesh::MeshResolution;
use growbot_pictures::export::obstacles::scene_view;
use growbot_pictures::export::{centreline_csv, glb, mcap, obj, stl, three_mf, tum};
use growbot_plan::atomic_file::write_atomic;
use growbot_plan::run_log::BodyKind;

use super::body_input::BodyInput;
use super::failure::Failure;
use super::output_format::{OutputFormat, print_file_report};

/// Write a body in the format of another tool: STL, OBJ, 3MF, GLB, CSV, TUM or MCAP
///
/// A plan is exported as planned. The log of a growth is exported as built, up to its last layer. On a robot, the body
/// follows from the steps that the board has made. On a simulated tip, the body is the plastic as it lies. It is called
/// laid (simulated), and the commanded body is beside it.
///
/// STL (binary), OBJ and 3MF (all mm, z up) and GLB (glTF 2.0: metres, z up turned into y up by the node's matrix) have
/// the printed wall as a closed surface: outer and inner side and both rims. Layers of less than a few micrometres
/// vanish between their neighbours there.
///
/// GLB also has the obstacles of a scene, translucent, and the narrowest place of the body among them. The scene is
/// that of the plan, or --scene.
///
/// CSV has a row for the start and one for each layer, in full precision. A row has the position (mm) and the direction
/// of the tip after the layer, and the layer (alpha_deg, height_mm, tilt_deg).
///
/// TUM is the tip's trajectory, for evo and other tools. It has a line after each layer: time (s), position (m),
/// quaternion.
///
/// MCAP, from a log only, is a recording for Foxglove: tip, layers, temperatures, states and faults over time. Time is
/// that of the board, as far as the log has it, from 0. With --ros2 the messages are those of ROS 2, in CDR:
/// PoseStamped, Path, TFMessage, Marker and DiagnosticArray.
#[derive(Args)]
#[command(after_help = AFTER_HELP)]
pub struct ExportArgs {
    /// The plan from `growbot plan -o`, or the run log from `growbot grow --log` (- for standard input)
    #[arg(value_name = "PLAN|RUN")]
    body: PathBuf,
    /// The format [default: by the extension of the file]
    #[arg(long, value_enum)]
    format: Option<OutputFormat>,
    /// Write to this file [default: standard output]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// STL, OBJ, 3MF and GLB: number of chords round the tube
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(8..=1024))]
    segments: u32,
    /// STL, OBJ, 3MF and GLB: a ring of vertices at every Nth layer, and more rings in bends
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// MCAP: messages of ROS 2 in CDR instead of JSON
    #[arg(long)]
    ros2: bool,
    /// All formats but MCAP: body of a growth to export
    #[arg(long = "body", value_enum, value_name = "BODY", default_value_t = BodyChoice::Laid)]
    which: BodyChoice,
    /// The robot: a built-in name or a TOML file [default: the one that the plan describes]
    #[arg(long, value_name = "FILE|NAME")]
    robot: Option<PathBuf>,
    /// GLB: scene file with the obstacles [default: the scene of the plan]
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Print one line of JSON about the written file
    #[arg(long, requires = "output")]
    json: bool,
}

const AFTER_HELP: &str = "\
Examples:
  growbot export plan.json -o body.stl
  growbot export plan.json -o body.3mf
  growbot export run.jsonl -o body.glb --segments 32 --every 4
  growbot export run.jsonl -o run.mcap
  growbot export run.jsonl -o bag.mcap --ros2
  growbot export run.jsonl -o tip.tum
  growbot plan --to 0,0,500,0,90 --json | growbot export - --format csv";

/// Body of a growth to export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum BodyChoice {
    /// The body as laid. On a simulated tip it is the plastic, with the commanded body beside it in CSV, and in GLB if
    /// the two differ. On a robot it follows from the board's steps
    Laid,
    /// The body that the board's steps alone would give, without the errors of a simulated tip
    Commanded,
}

/// Distance below which two bodies count as equal, so that only one of them is exported to GLB, mm.
const APART: f64 = 0.05;

/// Runs the command.
pub fn run(args: &ExportArgs) -> Result<(), Failure> {
    let to = args.output.as_deref().filter(|path| !is_standard_output(path));
    let format = args.format()?;
    format.check_destination(to)?;
    if args.ros2 && format != OutputFormat::Mcap {
        return Err(Failure::bad_input(format_args!(
            "--ros2 applies only to MCAP files, not to {}: remove --ros2, or name a file that ends in .mcap",
            format.ending()
        )));
    }
    if args.json && to.is_none() {
        return Err(Failure::bad_input(
            "--json reports a file, and the body goes to standard output: name a file with -o",
        ));
    }
    if args.scene.is_some() && format != OutputFormat::Glb {
        return Err(Failure::bad_input(format_args!(
            "--scene applies only to GLB files, and {} holds only the body: remove --scene, or name a file that ends \
             in .glb",
            format.ending()
        )));
    }
    let subject = BodyInput::open(&args.body, args.robot.as_deref(), args.scene.as_deref())?;
    let bytes = args.encode(format, &subject)?;
    // Some formats, and bodies without layers, cannot state that the body is simulated.
    let simulated = args.kind(&subject).filter(|kind| *kind != BodyKind::AsBuilt).map(BodyKind::name);
    let Some(path) = to else {
        if let Some(kind) = simulated {
            growbot_host::note!("the body is {kind}");
        }
        return Ok(print_bytes(&bytes)?);
    };
    write_atomic(path, &bytes)?;
    if args.json {
        return print_file_report(path, format, bytes.len(), subject.is_simulated().into());
    }
    let kind = simulated.map_or_else(String::new, |kind| format!(", {kind},"));
    growbot_host::note!("body{kind} written to {}, {} bytes", path.display(), bytes.len());
    Ok(())
}

impl ExportArgs {
    /// Returns the format of `--format`, or else that of the file's extension.
    fn format(&self) -> Result<OutputFormat, Failure> {
        let formats = self.format.as_ref().map_or(OutputFormat::value_variants(), slice::from_ref);
        let ending = self.output.as_deref().map(|output| OutputFormat::of(output, formats)).transpose()?.flatten();
        self.format.or(ending).ok_or_else(|| {
            Failure::bad_input(
                "the export's format is not given: name a file that ends in .stl, .obj, .3mf, .glb, .csv, .tum or \
                 .mcap with -o, or pass --format",
            )
        })
    }

    /// Returns the kind of the exported body. `None` for a plan.
    fn kind(&self, subject: &BodyInput) -> Option<BodyKind> {
        let record = subject.record()?;
        Some(match (self.which, record.body_kind()) {
            (BodyChoice::Commanded, BodyKind::Laid) => BodyKind::Commanded,
            (_, kind) => kind,
        })
    }

    fn encode(&self, format: OutputFormat, subject: &BodyInput) -> Result<Vec<u8>, Failure> {
        let BodyInput { robot, plan, run, .. } = subject;
        let record = subject.record();
        let kind = self.kind(subject);
        let laid = record.filter(|_| kind == Some(BodyKind::Laid));
        let laid = laid.and_then(|record| ExportedBody::simulated(robot, &plan.start, record));
        let commanded = record.map(|record| ExportedBody::as_built(robot, &plan.start, record));
        let name = kind.map_or("planned", BodyKind::name);
        // The exported body, and a second one beside it if it has layers.
        let (body, beside) = match (laid, commanded) {
            (Some(laid), commanded) => (laid, commanded.filter(|commanded| !commanded.layers.is_empty())),
            (None, Some(commanded)) => (commanded, None),
            (None, None) => (ExportedBody::planned(robot, plan), None),
        };
        let resolution = MeshResolution { segments: self.segments, layers_per_ring: self.every };
        match format {
            OutputFormat::Stl => Ok(stl::write(name, &body, resolution)?),
            OutputFormat::Obj => Ok(obj::write(name, &body, resolution)?.into_bytes()),
            OutputFormat::ThreeMf => three_mf::write(name, &body, resolution).map_err(Failure::bad_input),
            OutputFormat::Glb => {
                // Two walls in one place would only flicker.
                let beside = beside.as_ref().filter(|beside| body.parts_from(beside, APART));
                let beside = beside.map(|beside| ("commanded", beside));
                let name = if record.is_some() { name } else { robot.name() };
                let bodies: Vec<(&str, &ExportedBody)> = [(name, &body)].into_iter().chain(beside).collect();
                let around = scene_view(&subject.subject(name))?;
                Ok(glb::write(&bodies, around.as_ref(), resolution)?)
            }
            OutputFormat::Csv => Ok(centreline_csv::write(&body, beside.as_ref()).into_bytes()),
            OutputFormat::Tum => {
                let log = run.as_ref().map(|(_, log)| &log[..]);
                Ok(tum::write(name, &body, &tum::times(&body, plan, log)).into_bytes())
            }
            _ => match run {
                Some((record, log)) => {
                    let encoding = if self.ros2 { Encoding::Ros2 } else { Encoding::Json };
                    mcap::write(robot, plan, record, log, encoding).map_err(Failure::bad_input)
                }
                None => Err(Failure::bad_input(format!(
                    "{} is a plan, but MCAP holds the recording of a growth: give a run log, as `growbot grow --log` \
                     writes it",
                    growbot_plan::input::display_name(&self.body)
                ))),
            },
        }
    }
}
