//! `growbot reproduce`: repeats the experiments of Del Dottore et al. 2019.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::thread;

use clap::Args;
use clap::builder::RangedI64ValueParser;
use growbot_host::output::print;
use growbot_host::progress::{Progress, ResultTiming};
use growbot_paper::tables::ReproductionJson;
use growbot_paper::{FIGURES, REPEATS, ReproduceRequest, Reproduction, SEED, TABLES, paper, summary};
use growbot_pictures::drawing::pdf::svg_to_pdf;
use growbot_plan::sanitize::json_line;

use super::failure::Failure;
use super::output_dir;

/// Repeat the experiments of the paper
///
/// The experiments are those of Tables 1 to 3 and Figures 4 to 8 of Del Dottore et al. 2019 (Front. Robot. AI 6:45).
/// They consist of growths between random poses, 50 in each group and 70 at each level of noise. The growths use both
/// values that the paper gives for its step, exact slicing, both planners, and open and closed loop. The command prints
/// its results beside those of the paper, with the significance tests that the paper quotes, or one line of JSON with
/// --json.
///
/// Noise of the growth is uniform, and its percentage is the half-width. Noise of the sensors is normal, with standard
/// deviations of 1 % of a layer and 0.5 degrees about either axis.
///
/// -o writes report.html, one page with everything, each figure as SVG, and every number as CSV. Existing files of the
/// same names are replaced.
///
/// --table and --figure, which can be repeated, select experiments.
#[derive(Args)]
#[command(after_help = AFTER_HELP)]
pub struct ReproduceArgs {
    /// Only this table, 1 to 3
    #[arg(long, value_name = "N", value_parser = one_of(&TABLES))]
    table: Vec<u8>,
    /// Only this figure, 4 to 8
    #[arg(long, value_name = "N", value_parser = one_of(&FIGURES))]
    figure: Vec<u8>,
    /// Growths in each group and at each level of noise [default: the paper's 50 and 70]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    repeat: Option<usize>,
    /// Seed of all random numbers: the same seed gives the same results
    #[arg(long, value_name = "S", default_value_t = SEED, allow_negative_numbers = true)]
    seed: u64,
    /// Also write the figures as PDF
    #[arg(long, requires = "output")]
    pdf: bool,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
    /// Write page, figures and numbers to this directory, which is created if it does not exist
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

const AFTER_HELP: &str = "\
Examples:
  growbot reproduce -o paper --pdf
  growbot reproduce --table 2
  growbot reproduce --figure 4 --figure 6 --repeat 200 -o more";

/// Extension of the figures' files.
const FIGURE_ENDING: &str = ".svg";

/// Returns a parser for a number within a range.
fn one_of(range: &RangeInclusive<u8>) -> RangedI64ValueParser<u8> {
    clap::value_parser!(u8).range(i64::from(*range.start())..=i64::from(*range.end()))
}

/// Returns the command line that gives the results of this request.
fn command_of(request: &ReproduceRequest) -> String {
    let usual = ReproduceRequest::default();
    let mut command = "growbot reproduce".to_owned();
    if (&request.tables, &request.figures) != (&usual.tables, &usual.figures) {
        request.tables.iter().for_each(|table| command += &format!(" --table {table}"));
        request.figures.iter().for_each(|figure| command += &format!(" --figure {figure}"));
    }
    if (request.repeat, request.repeat_noise) != (usual.repeat, usual.repeat_noise) {
        command += &format!(" --repeat {}", request.repeat);
    }
    if request.seed != usual.seed {
        command += &format!(" --seed {}", request.seed);
    }
    command + " -o DIR"
}

/// Runs the command.
pub fn run(args: &ReproduceArgs) -> Result<(), Failure> {
    let repeat = args.repeat.unwrap_or(paper::REPEAT);
    if !REPEATS.contains(&repeat) {
        let (min, max) = REPEATS.into_inner();
        return Err(Failure::bad_input(format!("--repeat is {repeat}: give a number from {min} to {max}")));
    }
    let all = args.table.is_empty() && args.figure.is_empty();
    let request = ReproduceRequest {
        tables: if all { TABLES.collect() } else { args.table.clone() },
        figures: if all { FIGURES.collect() } else { args.figure.clone() },
        seed: args.seed,
        repeat,
        repeat_noise: args.repeat.unwrap_or(paper::REPEAT_NOISE),
    };
    let command = command_of(&request);
    if let Some(directory) = &args.output {
        output_dir::check(directory)?;
    }
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let mut progress: Option<Progress> = None;
    let done = Reproduction::run(request, threads, |done, of| {
        let progress = progress.get_or_insert_with(|| Progress::start(Some(of), ResultTiming::AtEnd));
        progress.update(done, || format!("{done} of {of} pieces of work"));
    });
    if let Some(progress) = progress {
        progress.finish();
    }
    let done = done.map_err(Failure::bad_input)?;
    if let Some(directory) = &args.output {
        let files = done.files(&command);
        let mut written: Vec<(String, Vec<u8>)> =
            files.iter().map(|file| (file.name.clone(), file.contents.clone().into())).collect();
        for figure in files.iter().filter(|file| args.pdf && file.name.ends_with(FIGURE_ENDING)) {
            let name = Path::new(&figure.name).with_extension("pdf").to_string_lossy().into_owned();
            written.push((name, svg_to_pdf(&figure.contents).map_err(Failure::bad_input)?));
        }
        output_dir::fill(directory, written.iter().map(|(name, contents)| (&**name, &**contents)))?;
    }
    let text = if args.json { json_line(&ReproductionJson::from(&done)) } else { summary::summary(&done) };
    Ok(print(&text)?)
}
