//! The CSV table of simulated growths, written while they are computed.

use std::io::{self, BufWriter, Write};
use std::path::Path;

use growbot_client::atomic_file::{AtomicFile, format_from_extension, refuse_inputs};
use growbot_core::pose::Pose;
use growbot_host::output::{OutputError, is_standard_output};
use growbot_pictures::figures::shortest;
use growbot_sim::simulation::obstacles::ObstacleReport;
use growbot_sim::simulation::{Simulation, SimulationResult};

use super::super::Failure;
use super::disturbances::DisturbanceReport;

/// Columns of every growth. The endings `_mm` and `_deg` are units.
const GROWTH: &str = "layers,length_mm,path_length_mm";
const ERRORS: &str =
    "position_error_mm,normalized_position_error,heading_error_deg,pitch_error_deg,direction_error_deg";
/// Columns of a body that hangs under its weight.
const SAG: &str = "sag_mm,root_stress_mpa,root_moment_n_mm";

/// Columns of a growth in a scene. The contact is empty if the body touches nothing, and the pause if it does not
/// pause.
const SCENE_COLUMNS: &str = "contact_at_mm,clearance_mm,detours,paused_at_mm";

/// The CSV table of simulated growths while it is written.
pub struct Samples<'a> {
    file: BufWriter<Box<dyn Write + 'a>>,
    path_length: f64,
    /// Start and goal, which are the same in every row.
    ends: String,
    /// The disturbances, which are the same in every row.
    disturbances: String,
}

impl Samples<'_> {
    /// Writes the table with the rows that `fill` adds, whole or not at all.
    pub fn write<T>(
        path: &Path,
        simulation: &Simulation,
        fill: impl FnOnce(&mut Samples) -> io::Result<T>,
    ) -> Result<T, Failure> {
        let written = |file, simulation| {
            let mut samples = Samples::new(file, simulation)?;
            let filled = fill(&mut samples)?;
            samples.file.flush()?;
            Ok(filled)
        };
        if is_standard_output(path) {
            return Ok(written(Box::new(io::stdout().lock()), simulation).map_err(OutputError::from)?);
        }
        let mut file = AtomicFile::begin(path)?;
        let written = written(Box::new(&mut file), simulation);
        let filled = written.map_err(|error| file.failed(error))?;
        file.finish()?;
        growbot_host::note!("samples written to {}, a row for each simulated growth", path.display());
        Ok(filled)
    }

    /// Checks the destination before anything is grown.
    pub fn check(path: &Path, json: bool) -> Result<(), Failure> {
        if is_standard_output(path) {
            return match json {
                true => Err(Failure::bad_input(
                    "--samples - and --json both go to standard output: remove one of them, or name a file",
                )),
                false => Ok(()),
            };
        }
        format_from_extension(path, &["csv"])?;
        Ok(refuse_inputs(path)?)
    }

    fn new<'a>(file: Box<dyn Write + 'a>, simulation: &Simulation) -> io::Result<Samples<'a>> {
        let (names, values): (Vec<_>, Vec<_>) = DisturbanceReport::of(simulation, 0).columns().into_iter().unzip();
        let mut samples = Samples {
            file: BufWriter::new(file),
            path_length: simulation.path_length(),
            ends: format!("{},{}", pose(&simulation.start()), pose(&simulation.goal())),
            disturbances: values.into_iter().map(shortest).collect::<Vec<_>>().join(","),
        };
        let poses = ["start", "goal", "final"].map(|end| {
            ["x_mm", "y_mm", "z_mm", "heading_deg", "pitch_deg"].map(|part| format!("{end}_{part}")).join(",")
        });
        let sag = if simulation.sag { format!(",{SAG}") } else { String::new() };
        let among = if simulation.scene.is_some() { format!(",{SCENE_COLUMNS}") } else { String::new() };
        writeln!(samples.file, "seed,{},{GROWTH},{ERRORS}{sag}{among},{}", poses.join(","), names.join(","))?;
        Ok(samples)
    }

    /// Adds the row of the growth with this seed.
    pub fn add(&mut self, seed: u64, outcome: &SimulationResult) -> io::Result<()> {
        let SimulationResult { grown, arrival, sag: hung, obstacles: among } = outcome;
        let errors = [
            Some(arrival.position_error_mm),
            Some(arrival.normalized_position_error),
            arrival.heading_error_deg,
            Some(arrival.pitch_error_deg),
            Some(arrival.direction_error_deg),
        ];
        let sag = hung.map(|hung| [hung.deflection, hung.root.stress, hung.root.moment].map(Some));
        let (layers, length, path_length) = (grown.layers, shortest(grown.length), shortest(self.path_length));
        write!(self.file, "{seed},{},{},{layers},{length},{path_length}", self.ends, pose(&arrival.final_pose))?;
        let among = among.map(|among| {
            let ObstacleReport { contact, clearance, detours, paused } = among;
            let contact = contact.map(|contact| contact.at);
            [contact, Some(clearance), Some(f64::from(detours)), paused.map(|paused| paused.at)]
        });
        for value in errors.into_iter().chain(sag.into_iter().flatten()).chain(among.into_iter().flatten()) {
            // A vertical pose has no heading.
            write!(self.file, ",{}", value.map(shortest).unwrap_or_default())?;
        }
        writeln!(self.file, ",{}", self.disturbances)
    }
}

/// Returns a pose as five fields, mm and degrees.
fn pose(pose: &Pose) -> String {
    pose.to_degrees().map(shortest).join(",")
}
