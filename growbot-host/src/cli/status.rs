//! `growbot status`: shows the identity and the state of the board.

use std::path::PathBuf;

use clap::Args;
use growbot_client::client::{Client, ClientError};
use growbot_client::status::{ConnectionState, FaultStatus, ImageStatus, RobotStatus, SensorStatus};
use growbot_core::link::crash::{CrashRecord, CrashWords};
use growbot_core::link::message::{BoardInfo, Refusal};
use growbot_host::crash::{CrashReport, FirmwareImage};
use growbot_host::output::print;
use growbot_plan::forecast::Forecast;
use growbot_plan::robot_file;
use growbot_plan::sanitize::json_line;
use time::OffsetDateTime;

use super::failure::Failure;
use super::flash::built_images;
use super::port_arg::{RequiredPortArg, SelectedPort};
use super::robot_arg::RobotArg;
use super::service_robot::find_service_robot;
use super::status_text::status_text;

/// Show the identity, state and sensors of the robot's board
///
/// The latest fault is shown with its data at that time, until the next fault or until the board loses its power.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot status --port /dev/ttyACM0")]
pub struct StatusArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
    /// After a crash: firmware image that gives the names of functions and lines
    ///
    /// The default is the image that `growbot flash` built last, if it is the one that crashed.
    #[arg(long, value_name = "FILE")]
    elf: Option<PathBuf>,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &StatusArgs) -> Result<(), Failure> {
    let port = args.port.resolve()?;
    if let Some(owned) = find_service_robot(&port)? {
        return owned.print_status(args.json);
    }
    let robot = args.robot.load()?;
    let given = args.elf.as_deref().map(FirmwareImage::open).transpose()?;
    let mut client = port.client(&robot)?;
    let mut report = BoardReport::of(&mut client, &port)?;
    report.look_up_in(given)?;
    print(&if args.json { json_line(&report.status) } else { report.text() })?;
    Ok(())
}

/// Everything that a board reports.
pub struct BoardReport {
    status: RobotStatus,
    /// Latest crash. `None` if the board has recorded none.
    crash: Option<CrashWords>,
    /// Image that names the functions and lines of a crash. `None` if no image is known.
    image: Option<FirmwareImage>,
}

impl BoardReport {
    /// Requests the report from the board at this port.
    pub fn of(client: &mut Client, port: &SelectedPort) -> Result<Self, ClientError> {
        let board = client.identify()?;
        let mut status = RobotStatus {
            port: port.text().to_owned(),
            simulated: port.is_simulated(),
            pace: port.pace(None),
            connection: ConnectionState::Ready,
            status_age_s: Some(0.0),
            sensors: Some(SensorStatus::from(&client.sensors()?)),
            latest_fault: client.latest_fault()?.as_ref().map(FaultStatus::from),
            ..RobotStatus::default()
        };
        status.set_board(&board);
        let now = OffsetDateTime::now_utc();
        let robot = robot_file::load(board.robot_name.as_str().as_ref()).ok();
        let robot = robot.filter(|robot| robot.hash() == board.robot_hash);
        let forecast = robot.zip(status.pace);
        let forecast = forecast.map(|(robot, pace)| Forecast { period_s: robot.description().layer.period_s, pace });
        status.set_finish(forecast.and_then(|forecast| forecast.finish_of(now, &board.status)), now);
        let boot = match client.boot_report() {
            Ok(report) => Some(report),
            Err(ClientError::Refused { refusal: Refusal::UnknownRequest, .. }) => None,
            Err(error) => return Err(error),
        };
        status.image = boot.as_ref().map(|boot| ImageStatus::from(boot.image));
        let mut report = Self { status, crash: boot.and_then(|boot| boot.crash), image: None };
        report.set_crash();
        Ok(report)
    }

    /// Sets the image of a crash: the given one, or the one that was built last if it is the one that crashed. Returns
    /// an error if the given image is not the one that crashed.
    fn look_up_in(&mut self, given: Option<FirmwareImage>) -> Result<(), Failure> {
        let Some(crashed) = self.crash.as_ref().map(CrashRecord::from) else { return Ok(()) };
        if let (Some(image), Some(crc)) = (&given, crashed.image)
            && image.crc() != Some(crc)
        {
            let other = image.crc().map_or_else(|| "none".to_string(), |crc| format!("{crc:08x}"));
            return Err(Failure::bad_input(format!(
                "the image given with --elf is not the image that crashed: the CRC of the given image is {other}, but \
                 the crash record has CRC {crc:08x}; give the image that the board was flashed with"
            )));
        }
        let built = || {
            let images = built_images().into_iter().filter_map(|image| FirmwareImage::open(&image).ok());
            images.into_iter().find(|image| crashed.image.is_some() && image.crc() == crashed.image)
        };
        self.image = given.or_else(built);
        self.set_crash();
        Ok(())
    }

    fn crash(&self) -> Option<CrashReport<'_>> {
        self.crash.as_ref().map(|words| CrashReport::new(words, self.image.as_ref()))
    }

    fn set_crash(&mut self) {
        self.status.crash = self.crash().map(|crash| crash.to_json());
    }

    /// Returns the report as a few lines of text.
    pub fn text(&self) -> String {
        let mut text = status_text(&self.status);
        if let Some(crash) = self.crash() {
            text += &crash.text();
            text += &match (crash.image, crash.record.image) {
                (Some(_), _) => String::new(),
                (None, Some(crc)) => {
                    format!("             for functions and lines, give the image with CRC {crc:08x} with --elf FILE\n")
                }
                (None, None) => {
                    "             for functions and lines, give the flashed ELF image with --elf FILE\n".to_owned()
                }
            };
        }
        text
    }
}

/// Returns true if the board has a robot description.
pub fn is_configured(hello: &BoardInfo) -> bool {
    hello.robot_hash != 0
}

/// Returns the name and the hash of the board's description, or a remedy if the board has none.
pub fn described(hello: &BoardInfo) -> String {
    let hash = is_configured(hello).then(|| format!("{:016x}", hello.robot_hash));
    super::status_text::described(Some(&hello.robot_name), hash.as_deref())
}
