//! The CSV table of simulated growths, written while they are computed.

use std::io::{self, BufWriter, Write};
use std::path::Path;

use growbot_host::output::{OutputError, is_standard_output};
use growbot_plan::atomic_file::{AtomicFile, format_from_extension, refuse_inputs};
use growbot_plan::table::Table;
use growbot_sim::simulation::samples_table::{SampleRow, samples_table};
use growbot_sim::simulation::{Simulation, SimulationResult};

use crate::cli::failure::Failure;
use crate::cli::growth_monitor::ResultFormat;

/// The CSV table of simulated growths while it is written.
pub struct Samples<'a> {
    file: BufWriter<Box<dyn Write + 'a>>,
    table: Table<'static, SampleRow>,
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
        let mut samples = Samples { file: BufWriter::new(file), table: samples_table(simulation) };
        samples.file.write_all(samples.table.csv_header().as_bytes())?;
        Ok(samples)
    }

    /// Adds the row of the growth with this seed.
    pub fn add(&mut self, seed: u64, outcome: &SimulationResult) -> io::Result<()> {
        self.file.write_all(self.table.csv_row(&(seed, *outcome)).as_bytes())
    }
}
