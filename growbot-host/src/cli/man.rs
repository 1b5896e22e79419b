//! `growbot man`: prints the manual, a page for each command.

use std::io::{self, Write};
use std::path::PathBuf;

use clap::{Args, Command};
use clap_mangen::Man;
use growbot_host::output::print;
use growbot_plan::suggest::did_you_mean;

use super::failure::Failure;
use super::output_dir;

/// Print a page of the manual, or write all of them
#[derive(Args)]
#[command(after_help = "\
Examples:
  growbot man plan | man -l -
  mkdir -p ~/.local/share/man && growbot man -o ~/.local/share/man/man1")]
pub struct ManArgs {
    /// Command that the page describes [default: growbot itself]
    #[arg(value_name = "COMMAND", conflicts_with = "output")]
    command: Option<String>,
    /// Write all pages, growbot.1 and growbot-COMMAND.1, to this directory, which is created if it does not exist
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

/// Runs the command. `root` is the definition of the command line.
pub fn run(args: &ManArgs, root: Command) -> Result<(), Failure> {
    let mut root = root.disable_help_subcommand(true);
    root.build();
    // Writing to memory cannot fail.
    let text = |command: &Command| page(command, &root).map_err(Failure::bad_input);
    if let Some(directory) = &args.output {
        // All pages exist before the first is written.
        let mut pages = vec![("growbot.1".to_owned(), text(&root)?)];
        for command in root.get_subcommands() {
            pages.push((format!("growbot-{}.1", command.get_name()), text(command)?));
        }
        output_dir::check(directory)?;
        return output_dir::fill(directory, pages.iter().map(|(name, page)| (&**name, &**page)));
    }
    let command = match &args.command {
        None => &root,
        Some(name) => root.find_subcommand(name).ok_or_else(|| unknown(name, &root))?,
    };
    Ok(print(&String::from_utf8_lossy(&text(command)?))?)
}

fn unknown(name: &str, root: &Command) -> Failure {
    let suggestion = did_you_mean(name, root.get_subcommands().map(Command::get_name));
    Failure::bad_input(format!("unknown command {name:?}{suggestion}: `growbot help` lists the commands"))
}

/// Returns the page of a command as roff: the text of `--help`, with examples and exit codes in sections of their own.
fn page(command: &Command, root: &Command) -> io::Result<Vec<u8>> {
    let mut page = Vec::new();
    let source = format!("growbot {}", root.get_version().unwrap_or_default());
    let man = Man::new(command.clone()).source(source).manual("growbot");
    man.render_title(&mut page)?;
    man.render_name_section(&mut page)?;
    man.render_synopsis_section(&mut page)?;
    man.render_description_section(&mut page)?;
    man.render_options_section(&mut page)?;
    if command.has_subcommands() {
        man.render_subcommands_section(&mut page)?;
    }
    let sections = HelpSections::after_help_of(command);
    section(&mut page, "NOTES", &sections.notes)?;
    section(&mut page, "EXAMPLES", &sections.examples)?;
    let exit_codes =
        if sections.exit_codes.is_empty() { HelpSections::after_help_of(root).exit_codes } else { sections.exit_codes };
    section(&mut page, "EXIT STATUS", &exit_codes)?;
    if command.get_name() != root.get_name() {
        section(&mut page, "SEE ALSO", "growbot(1)\n")?;
    }
    Ok(page)
}

/// Text after a command's help, sorted into the sections of its page.
#[derive(Default)]
struct HelpSections {
    notes: String,
    examples: String,
    exit_codes: String,
}

impl HelpSections {
    fn after_help_of(command: &Command) -> Self {
        let help = command.get_after_long_help().or_else(|| command.get_after_help());
        let help = help.map(ToString::to_string).unwrap_or_default();
        let mut sections = Self::default();
        for paragraph in help.split("\n\n").map(str::trim_end).filter(|paragraph| !paragraph.is_empty()) {
            let (first, rest) = paragraph.split_once('\n').unwrap_or((paragraph, ""));
            let (to, text) = match (first, first.strip_prefix("Exit codes: ")) {
                ("Example:" | "Examples:", _) => (&mut sections.examples, rest.to_owned()),
                (_, Some(codes)) => (&mut sections.exit_codes, format!("{codes}\n{rest}")),
                _ => (&mut sections.notes, paragraph.to_owned()),
            };
            if !to.is_empty() {
                to.push('\n');
            }
            to.push_str(text.trim_end());
            to.push('\n');
        }
        sections
    }
}

/// Writes a section whose lines stay as they are. An empty section is not written.
fn section(page: &mut Vec<u8>, heading: &str, text: &str) -> io::Result<()> {
    if text.is_empty() {
        return Ok(());
    }
    writeln!(page, ".SH \"{heading}\"\n.nf")?;
    for line in text.lines() {
        // A line that begins with a dot or a quote would be a request. The escape \& prints nothing and prevents that.
        writeln!(page, "\\&{}", line.replace('\\', "\\e").replace('-', "\\-").replace('\'', "\\(aq"))?;
    }
    writeln!(page, ".fi")
}
