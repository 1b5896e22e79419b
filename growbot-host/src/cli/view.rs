//! `growbot view`: shows a plan or a growth as a page, or as a picture.

use std::fs;
use std::path::{Path, PathBuf};
use std::slice;

use clap::Args;
use growbot_host::output::{is_standard_output, write_to};
use growbot_pictures::drawing::colours::Palette;
use growbot_pictures::view::picture::Viewpoint;
use growbot_pictures::view::plot::{PlotInput, PlotKind, XAxis};
use growbot_pictures::view::{Subject, page, picture, plot};
use growbot_plan::input::{display_name, is_standard_input};

use super::body_input::BodyInput;
use super::failure::Failure;
use super::output_format::{OutputFormat, print_file_report};
use super::units::mm;

/// Show a plan or the log of a growth: a page, a picture, or plots
///
/// The page is one HTML file that any browser opens, without a network. It shows the tube in three dimensions, with its
/// layers coloured by their height, and a slider that grows it. Start, goal, the tip's frame and the numbers are beside
/// it. For a growth, it compares the built body with the plan.
///
/// For a body among obstacles, it shows the obstacles, translucent, with the narrowest place and the clearance there.
/// The scene is that of the plan, or --scene. If the scene of a log is missing, the growth is shown without it.
///
/// With --compare it shows two bodies side by side, from the same side and at the same scale, with one slider that
/// grows both. Pictures and plots take any number.
///
/// With --svg, --png or --pdf the command draws a picture for a paper instead, without a browser. With --plot it draws
/// layers, error and temperature along the body or over time.
#[derive(Args)]
#[command(after_help = AFTER_HELP)]
pub struct ViewArgs {
    /// The plan from `growbot plan -o`, or the run log from `growbot grow --log` (- for standard input), or several of
    /// them with --compare
    #[arg(value_name = "PLAN|RUN", required = true, num_args = 1..)]
    files: Vec<PathBuf>,
    /// Show several plans or run logs side by side, or in the same plots (a page has two)
    #[arg(long)]
    compare: bool,
    /// Write an SVG picture instead of a page (-o sets its file)
    #[arg(long)]
    svg: bool,
    /// Write a PNG picture instead of a page (-o sets its file)
    #[arg(long, conflicts_with = "svg")]
    png: bool,
    /// Write a PDF picture instead of a page, with letters as outlines (-o sets its file)
    #[arg(long, conflicts_with_all = ["svg", "png"])]
    pdf: bool,
    /// Width of a PNG in pixels [default: 1600]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(100..=10_000))]
    width: Option<u32>,
    /// Direction from which a picture shows the body [default: corner]
    #[arg(long, value_enum)]
    viewpoint: Option<Viewpoint>,
    /// Draw a picture with axes: x, y and z in mm
    #[arg(long, conflicts_with = "plot")]
    axes: bool,
    /// Ends of the colour scale for heights in a picture, mm [default: percentiles 1 and 99]
    #[arg(long, value_name = "MIN,MAX", value_parser = range, conflicts_with = "plot")]
    range: Option<[f64; 2]>,
    /// Colour scale for heights in a picture [default: blue-orange]
    ///
    /// The colour-blind can distinguish the colours of all three. Those of the last two are also distinct in grey.
    #[arg(long, value_enum, conflicts_with = "plot")]
    palette: Option<Palette>,
    /// Omit names and captions over a picture or plots
    #[arg(long)]
    no_title: bool,
    /// Draw plots instead of the body, as SVG unless --png or --pdf is given: a list with commas
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',', conflicts_with = "viewpoint")]
    plot: Vec<PlotKind>,
    /// Horizontal axis of the plots
    #[arg(long, value_enum, default_value_t = XAxis::Path, requires = "plot")]
    x_axis: XAxis,
    /// Write to this file (- for standard output) [default: a file beside the first one with its name, or A-B for
    /// several, or with -plot, ending in .html, .svg, .png or .pdf]
    ///
    /// If no option sets the format, the extension of the file does.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// The robot: a built-in name or a TOML file [default: the one
    /// that the file describes]
    #[arg(long, value_name = "FILE|NAME")]
    robot: Option<PathBuf>,
    /// Show the body in this scene [default: the one that the plan leads through]
    ///
    /// A plan that leads through a scene is shown only in that scene, whose file may be elsewhere.
    #[arg(long, value_name = "FILE", conflicts_with = "plot")]
    scene: Option<PathBuf>,
    /// Print one line of JSON about the written file
    #[arg(long)]
    json: bool,
}

/// Parses two heights, mm.
fn range(text: &str) -> Result<[f64; 2], String> {
    let numbers: Vec<Option<f64>> = text.split(',').map(|length| mm(length).ok()).collect();
    match numbers[..] {
        [Some(min), Some(max)] if min < max && (max - min).is_finite() => Ok([min, max]),
        [Some(min), Some(max)] => {
            Err(format!("the range goes from {min} to {max} mm: give the smaller height first, such as 0.5,1"))
        }
        _ => Err("the value is not a range: give two heights in mm, such as 0.5,1".to_owned()),
    }
}

/// Formats of the output.
const FORMATS: [OutputFormat; 4] = [OutputFormat::Html, OutputFormat::Svg, OutputFormat::Png, OutputFormat::Pdf];

const AFTER_HELP: &str = "\
Examples:
  growbot view plan.json
  growbot view run.jsonl -o growth.html
  growbot view --compare two-plane.json shortest.json
  growbot view plan.json --scene room.toml
  growbot view plan.json --svg
  growbot view plan.json --png --width 2400 --viewpoint side -o side.png
  growbot view run.jsonl --plot heights,error,temperature --x-axis time
  growbot view --compare a.jsonl b.jsonl c.jsonl --plot error --pdf -o error.pdf
  growbot view plan.json --pdf --no-title --axes --palette viridis --range 0.6,1
  growbot plan --to 0,0,500,0,90 --json | growbot view - -o plan.html";

/// Runs the command.
pub fn run(args: &ViewArgs) -> Result<(), Failure> {
    let output = args.output()?;
    let opened = args.files.iter().map(|file| args.open(file)).collect::<Result<Vec<_>, _>>()?;
    let names = names(&args.files);
    let subjects: Vec<Subject> = opened.iter().zip(&names).map(|(opened, name)| opened.subject(name)).collect();
    let subjects: Vec<&Subject> = subjects.iter().collect();
    let format = args.format();
    let contents = match format {
        OutputFormat::Html => args.page(&subjects)?.into_bytes(),
        _ => format.drawn(args.picture(&subjects, &opened)?, args.width.unwrap_or(OutputFormat::PNG_WIDTH))?,
    };
    if !write_to(&output, &contents)? {
        return Ok(());
    }
    if args.json {
        return print_file_report(&output, format, contents.len(), opened.iter().any(BodyInput::is_simulated).into());
    }
    let hint = if format == OutputFormat::Html { ": open it in a browser" } else { "" };
    growbot_host::note!("view written to {}{hint}", output.display());
    Ok(())
}

impl ViewArgs {
    /// Returns the format that an option chooses. `None` without such an option.
    fn chosen_format(&self) -> Option<OutputFormat> {
        let chosen = [(self.svg, OutputFormat::Svg), (self.png, OutputFormat::Png), (self.pdf, OutputFormat::Pdf)];
        chosen.into_iter().find(|(is_given, _)| *is_given).map(|(_, format)| format)
    }

    /// Returns the formats that the output may have without an option.
    fn formats(&self) -> &'static [OutputFormat] {
        if self.plot.is_empty() { &FORMATS } else { &OutputFormat::DRAWINGS }
    }

    /// Returns the format that the options choose, or else the format of the output file's extension.
    fn format(&self) -> OutputFormat {
        let ending = self.output.as_deref().and_then(|output| OutputFormat::of(output, self.formats()).ok().flatten());
        let default = if self.plot.is_empty() { OutputFormat::Html } else { OutputFormat::Svg };
        self.chosen_format().or(ending).unwrap_or(default)
    }

    /// Reads a file, with its scene. Plots show no scene.
    fn open(&self, file: &Path) -> Result<BodyInput, Failure> {
        BodyInput::open(file, self.robot.as_deref(), self.scene.as_deref())
    }

    fn page(&self, subjects: &[&Subject]) -> Result<String, Failure> {
        let page = match subjects {
            [one, other] => page::render_pair([one, other]),
            [one, ..] => page::render(one),
            [] => return Err(Failure::bad_input("no file given: give a plan or a run log")),
        };
        Ok(page?)
    }

    fn picture(&self, subjects: &[&Subject], opened: &[BodyInput]) -> Result<String, Failure> {
        if !self.plot.is_empty() {
            let options = plot::PlotOptions { quantities: &self.plot, along: self.x_axis, title: !self.no_title };
            let log = |opened: &'_ BodyInput| opened.run.as_ref().map(|(_, log)| log.clone());
            let logs: Vec<Option<Vec<u8>>> = opened.iter().map(log).collect();
            let plotted: Vec<PlotInput> =
                subjects.iter().zip(&logs).map(|(subject, log)| PlotInput { subject, log: log.as_deref() }).collect();
            return Ok(plot::svg(&plotted, &options)?);
        }
        let options = picture::PictureOptions {
            look: self.viewpoint.unwrap_or(Viewpoint::Corner),
            palette: self.palette.unwrap_or_default(),
            range: self.range,
            title: !self.no_title,
            axes: self.axes,
            width: self.width,
        };
        Ok(picture::svg(subjects, &options)?)
    }

    /// Checks that the options are compatible.
    fn check_options(&self) -> Result<(), Failure> {
        match (self.files.len(), self.compare) {
            (1, true) => {
                return Err(Failure::bad_input(
                    "--compare shows two plans or run logs side by side: give a second file",
                ));
            }
            (2.., false) => return Err(self.several_files()),
            (3.., true) if self.format() == OutputFormat::Html => {
                return Err(Failure::bad_input(
                    "a page can show two bodies at most, but a picture can show any number: add --svg, --png or --pdf, \
                     or give two files",
                ));
            }
            _ => {}
        }
        if self.json && self.output.as_deref().is_some_and(is_standard_output) {
            return Err(Failure::bad_input(
                "--json reports a file, and the view goes to standard output: name a file with -o",
            ));
        }
        let of_pictures = [
            (self.range.is_some(), "--range"),
            (self.palette.is_some(), "--palette"),
            (self.axes, "--axes"),
            (self.no_title, "--no-title"),
        ];
        match self.format() {
            OutputFormat::Html if self.viewpoint.is_some() => Err(Failure::bad_input(
                "--viewpoint applies only to pictures, because the view on a page can be turned: add --svg or --png",
            )),
            OutputFormat::Html => match of_pictures.into_iter().find(|(given, _)| *given) {
                Some((_, option)) => {
                    Err(Failure::bad_input(format!("{option} applies only to pictures: add --svg, --png or --pdf")))
                }
                None if self.width.is_some() => Err(Failure::bad_input(
                    "--width is a number of pixels and applies only to PNG pictures: write one with --png",
                )),
                None => Ok(()),
            },
            OutputFormat::Svg | OutputFormat::Pdf if self.width.is_some() => Err(Failure::bad_input(
                "--width is a number of pixels and applies only to PNG pictures: write one with --png",
            )),
            _ => Ok(()),
        }
    }

    /// Returns the output file. Returns an error if the view would replace one of its inputs.
    fn output(&self) -> Result<PathBuf, Failure> {
        self.check_options()?;
        if let Some(output) = &self.output {
            let chosen = self.chosen_format();
            OutputFormat::of(output, chosen.as_ref().map_or(self.formats(), slice::from_ref))?;
            self.format().check_destination(Some(output))?;
        }
        if self.files.iter().filter(|file| is_standard_input(file)).count() > 1 {
            return Err(Failure::bad_input(
                "standard input can be only one of the plans or run logs: give the other one as a file",
            ));
        }
        let output = match &self.output {
            Some(output) => output.clone(),
            None => self.beside()?,
        };
        for file in &self.files {
            let same =
                fs::canonicalize(&output).is_ok_and(|output| fs::canonicalize(file).is_ok_and(|file| file == output));
            if same {
                let file = file.display();
                return Err(Failure::bad_input(format!(
                    "the view would overwrite its input {file}: choose another file with -o"
                )));
            }
        }
        Ok(output)
    }

    /// Returns the error for several files without `--compare`. It has its own advice if the name of a picture
    /// follows `--png` or `--svg`, where that name counts as an input file.
    fn several_files(&self) -> Failure {
        let is_picture = |file: &&PathBuf| OutputFormat::of(file, &OutputFormat::DRAWINGS).is_ok_and(|it| it.is_some());
        let picture = self.files.iter().find(is_picture);
        match picture {
            Some(file) => Failure::bad_input(format!(
                "{} is taken for a second plan or run log: to write a picture to this file, give -o {0}",
                file.display()
            )),
            None => Failure::bad_input("several files can be shown only side by side: add --compare, or give one file"),
        }
    }

    /// Returns the default output file: in the directory of the first input, with the names of all inputs.
    fn beside(&self) -> Result<PathBuf, Failure> {
        if self.files.iter().any(|file| is_standard_input(file)) {
            return Err(Failure::bad_input(
                "the output file cannot be named after standard input: choose the output file with -o",
            ));
        }
        let stems: Vec<_> = self.files.iter().filter_map(|file| file.file_stem()).collect();
        // A plan and its log may have the same name.
        let alike = (1..stems.len()).any(|index| stems[..index].contains(&stems[index]));
        let whole = self.files.iter().filter_map(|file| file.file_name());
        let mut name = if alike { whole.collect() } else { stems }.join("-".as_ref());
        name.push(if self.plot.is_empty() { "." } else { "-plot." });
        name.push(self.format().ending());
        Ok(self.files.first().map_or_else(PathBuf::new, |first| first.with_file_name(name)))
    }
}

/// Returns the names of files: their file names, or their whole paths if file names are the same.
fn names(files: &[PathBuf]) -> Vec<String> {
    let short = |file: &PathBuf| file.file_name().map(|name| name.to_string_lossy().into_owned());
    let alike = |one: &PathBuf| files.iter().filter(|other| short(other) == short(one)).count() > 1;
    files.iter().map(|file| short(file).filter(|_| !alike(file)).unwrap_or_else(|| display_name(file))).collect()
}
