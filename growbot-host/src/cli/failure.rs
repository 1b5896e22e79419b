//! The failure of a command: its exit code and its message.

use std::error::Error;
use std::fmt::Display;
use std::process::ExitCode;

use growbot_client::client::{ClientError, has_commanded_board};
use growbot_client::commissioning_report::ReportError;
use growbot_client::maintenance::MaintenanceError;
use growbot_client::port::PortError;
use growbot_host::messages::{self, Severity};
use growbot_host::output::OutputError;
use growbot_pictures::drawing::png::PngError;
use growbot_pictures::export::mesh::MeshError;
use growbot_pictures::view::ViewError;
use growbot_plan::atomic_file::FileError;
use growbot_plan::batch::BatchError;
use growbot_plan::input::InputError;
use growbot_plan::plan_file::PlanFileError;
use growbot_plan::robot_file::RobotFileError;
use growbot_plan::run_log::{ReadRunLogError, RunLogError};
use growbot_plan::scene_planning::SceneCheckError;
use growbot_scene::scene_file::SceneError;
use growbot_serve::settings::SettingsError;
use growbot_serve::watch::WatchError;
use growbot_sim::crash::ImageError;
use growbot_sim::port::OpenError;
use growbot_sim::sim_daemon::SimDaemonError;
use growbot_sim::sim_daemon::process::SimProcessError;

use super::remedies;

/// Failure of a command: its exit code and its message.
pub struct Failure {
    code: u8,
    kind: Severity,
    message: Option<String>,
}

impl Failure {
    /// Returns the failure for something that was wrong before the job started.
    pub fn bad_input(message: impl Display) -> Self {
        Self { code: 2, kind: Severity::Error, message: Some(message.to_string()) }
    }

    /// Returns the failure of a valid request.
    pub fn request_failed(message: impl Display) -> Self {
        Self { code: 1, kind: Severity::Error, message: Some(message.to_string()) }
    }

    /// Returns the failure for an error that occurred before the job started.
    pub fn before_start(error: &(dyn Error + 'static)) -> Self {
        Self::bad_input(remedies::message(error))
    }

    /// Returns the failure for an error of a valid request.
    pub fn during_request(error: &(dyn Error + 'static)) -> Self {
        Self::request_failed(remedies::message(error))
    }

    /// Returns the result of a command whose standard output was closed by its reader, for example `head`. Its exit
    /// code is 0.
    pub fn stdout_closed() -> Self {
        Self { code: 0, kind: Severity::Error, message: None }
    }

    /// Returns the failure as a warning, because its error was printed before.
    pub fn into_warning(self) -> Self {
        Self { kind: Severity::Warning, ..self }
    }

    /// Returns true if the command ended because the reader of its standard output closed it.
    pub fn is_stdout_closed(&self) -> bool {
        self.code == 0
    }

    /// Returns true if something was wrong before the job started.
    pub fn is_bad_input(&self) -> bool {
        self.code == 2
    }

    /// Returns the message. It is empty if nothing failed.
    pub fn message(&self) -> &str {
        self.message.as_deref().unwrap_or_default()
    }

    /// Prints the message, and returns the exit code.
    pub fn report(mut self) -> ExitCode {
        // Exit status 2 means that no board was given anything to do.
        if self.code == 2 && has_commanded_board() {
            self.code = 1;
        }
        self.print();
        ExitCode::from(self.code)
    }

    /// Prints the message, if any.
    pub fn print(&self) {
        if let Some(message) = &self.message {
            messages::print(self.kind, format_args!("{message}"));
        }
    }
}

impl From<OutputError> for Failure {
    fn from(error: OutputError) -> Self {
        match error {
            OutputError::Closed => Self::stdout_closed(),
            error => Self::before_start(&error),
        }
    }
}

/// Implements `From` for errors that occur before the job starts.
macro_rules! bad_input {
    ($($error:ty),*) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::before_start(&error)
            }
        })*
    };
}

bad_input!(
    BatchError,
    FileError,
    ImageError,
    InputError,
    MaintenanceError,
    MeshError,
    OpenError,
    PlanFileError,
    PngError,
    PortError,
    ReadRunLogError,
    ReportError,
    RunLogError,
    SceneCheckError,
    SceneError,
    SimDaemonError,
    RobotFileError,
    SettingsError,
    SimProcessError,
    ViewError,
    WatchError
);

impl From<ClientError> for Failure {
    fn from(error: ClientError) -> Self {
        match error {
            ClientError::Refused { .. } | ClientError::StopNotAcknowledged { .. } => Self::during_request(&error),
            error => Self::before_start(&error),
        }
    }
}
