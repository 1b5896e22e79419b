//! Everything that a board reports about itself.

use growbot_client::client::{Client, ClientError};
use growbot_client::status::RobotStatus;
use growbot_core::link::message::BoardInfo;
use growbot_sim::crash::{CrashReport, FirmwareImage};

use super::failure::Failure;
use super::flash::built_images;
use super::port_arg::SelectedPort;
use super::status_text::status_text;

/// The status of a robot, with the image that names the functions of its latest crash.
pub struct BoardReport {
    pub status: RobotStatus,
    /// Image that names the functions and lines of a crash. `None` if no image is known.
    image: Option<FirmwareImage>,
}

impl BoardReport {
    /// Creates the report of a robot with this status.
    pub fn new(status: RobotStatus) -> Self {
        Self { status, image: None }
    }

    /// Requests the report from the board at this port.
    pub fn read(client: &mut Client, port: &SelectedPort) -> Result<Self, ClientError> {
        RobotStatus::read(client, port.text(), port.kind(), port.name().pace()).map(Self::new)
    }

    /// Sets the image of a crash: the given one, or the one that was built last if it is the one that crashed. Returns
    /// an error if the given image is not the one that crashed.
    pub fn look_up_in(&mut self, given: Option<FirmwareImage>) -> Result<(), Failure> {
        let Some(crashed) = self.crash().map(|crash| crash.record) else { return Ok(()) };
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
        self.status.crash = self.crash().map(|crash| crash.to_json());
        Ok(())
    }

    fn crash(&self) -> Option<CrashReport<'_>> {
        Some(CrashReport::new(self.status.crash.as_ref()?.record()?, self.image.as_ref()))
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
