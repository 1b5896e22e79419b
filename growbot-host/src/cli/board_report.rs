//! Everything that a board reports about itself.

use growbot_client::client::{Client, ClientError};
use growbot_client::status::{ConnectionState, FaultStatus, ImageStatus, RobotStatus, SensorStatus};
use growbot_core::link::crash::{CrashRecord, CrashWords};
use growbot_core::link::message::{BoardInfo, Refusal};
use growbot_plan::forecast::Forecast;
use growbot_plan::robot_file;
use growbot_sim::crash::{CrashReport, FirmwareImage};
use time::OffsetDateTime;

use super::failure::Failure;
use super::flash::built_images;
use super::port_arg::SelectedPort;
use super::status_text::status_text;

/// Everything that a board reports.
pub struct BoardReport {
    pub status: RobotStatus,
    /// Latest crash. `None` if the board has recorded none.
    crash: Option<CrashWords>,
    /// Image that names the functions and lines of a crash. `None` if no image is known.
    image: Option<FirmwareImage>,
}

impl BoardReport {
    /// Creates the report of a robot of whose board this program has only the status.
    pub fn of_status(status: RobotStatus) -> Self {
        Self { status, crash: None, image: None }
    }

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
    pub fn look_up_in(&mut self, given: Option<FirmwareImage>) -> Result<(), Failure> {
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
