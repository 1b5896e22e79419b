//! The CSV table of simulated growths, written while they are computed.

use std::io::{self, BufWriter, Write};
use std::path::Path;

use growbot_host::output::{OutputError, is_standard_output};
use growbot_plan::atomic_file::{AtomicFile, format_from_extension, refuse_inputs};
use growbot_plan::table::{NumberFormat, Table, pose_columns};
use growbot_sim::simulation::disturbance_report::DisturbanceReport;
use growbot_sim::simulation::{Simulation, SimulationResult};

use crate::cli::failure::Failure;
use crate::cli::growth_monitor::ResultFormat;

/// A row of the table: the seed, and the growth.
type Row = (u64, SimulationResult);

/// The CSV table of simulated growths while it is written.
pub struct Samples<'a> {
    file: BufWriter<Box<dyn Write + 'a>>,
    table: Table<'static, Row>,
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
    pub fn check(path: &Path, result: ResultFormat) -> Result<(), Failure> {
        if is_standard_output(path) {
            return match result {
                ResultFormat::Json => Err(Failure::bad_input(
                    "--samples - and --json both go to standard output: remove one of them, or name a file",
                )),
                ResultFormat::Table | ResultFormat::Nothing => Ok(()),
            };
        }
        format_from_extension(path, &["csv"])?;
        Ok(refuse_inputs(path)?)
    }

    fn new<'a>(file: Box<dyn Write + 'a>, simulation: &Simulation) -> io::Result<Samples<'a>> {
        let mut samples = Samples { file: BufWriter::new(file), table: table(simulation) };
        samples.file.write_all(samples.table.csv_header().as_bytes())?;
        Ok(samples)
    }

    /// Adds the row of the growth with this seed.
    pub fn add(&mut self, seed: u64, outcome: &SimulationResult) -> io::Result<()> {
        self.file.write_all(self.table.csv_row(&(seed, *outcome)).as_bytes())
    }
}

/// Returns the table of growths. The endings `_mm` and `_deg` are units.
fn table(simulation: &Simulation) -> Table<'static, Row> {
    let [start, goal] = [simulation.start(), simulation.goal()].map(|pose| pose.to_degrees());
    let path_length = simulation.path_length();
    let mut table = Table::new(NumberFormat::Shortest)
        .column("seed", |(seed, _): &Row| *seed)
        .columns(pose_columns("start"), move |_| start)
        .columns(pose_columns("goal"), move |_| goal)
        .columns(pose_columns("final"), |(_, outcome)| outcome.arrival.final_pose.to_degrees())
        .column("layers", |(_, outcome)| outcome.grown.layers)
        .column("length_mm", |(_, outcome)| outcome.grown.length)
        .column("path_length_mm", move |_| path_length)
        .column("position_error_mm", |(_, outcome)| outcome.arrival.position_error_mm)
        .column("normalized_position_error", |(_, outcome)| outcome.arrival.normalized_position_error)
        // A vertical pose has no heading.
        .column("heading_error_deg", |(_, outcome)| outcome.arrival.heading_error_deg)
        .column("pitch_error_deg", |(_, outcome)| outcome.arrival.pitch_error_deg)
        .column("direction_error_deg", |(_, outcome)| outcome.arrival.direction_error_deg);
    if simulation.sag {
        table = table
            .column("sag_mm", |(_, outcome)| outcome.sag.map(|sag| sag.deflection))
            .column("root_stress_mpa", |(_, outcome)| outcome.sag.map(|sag| sag.root.stress))
            .column("root_moment_n_mm", |(_, outcome)| outcome.sag.map(|sag| sag.root.moment));
    }
    if simulation.scene.is_some() {
        // The contact is empty if the body touches nothing, and the pause if it does not pause.
        table = table
            .column("contact_at_mm", |(_, outcome)| outcome.obstacles?.contact.map(|contact| contact.at))
            .column("clearance_mm", |(_, outcome)| outcome.obstacles.map(|report| report.clearance))
            .column("detours", |(_, outcome)| outcome.obstacles.map(|report| f64::from(report.detours)))
            .column("paused_at_mm", |(_, outcome)| outcome.obstacles?.paused.map(|paused| paused.at));
    }
    // The disturbances are the same in every row.
    let (names, values): (Vec<_>, Vec<_>) = DisturbanceReport::of(simulation, 0).columns().into_iter().unzip();
    table.columns(names, move |_| values.clone())
}
