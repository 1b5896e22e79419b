//! Requests of a host, sorted by their effect: those after which a board may heat or move, and all others.

use super::{
    Amend, AppendLayers, BeginJob, Cancel, Configure, Empty, Hello, Maintain, MaintenanceTask, Message, PlanRequest,
    ReadLayers, Resume, Start, Tune,
};

/// A request after which the board may heat or move, or may accept another request to heat or move.
#[derive(Debug, Clone, PartialEq)]
pub enum EnergizingRequest {
    /// Starts or continues the job.
    Start(Start),
    /// Heats, and finds the heater's gains.
    Tune(Tune),
    /// Leaves the state `Fault` or `EmergencyStop`.
    ClearFault(Empty),
    /// Heats, feeds or turns without a job.
    Maintain(Maintain),
}

impl From<EnergizingRequest> for Message {
    fn from(request: EnergizingRequest) -> Self {
        match request {
            EnergizingRequest::Start(start) => Self::Start(start),
            EnergizingRequest::Tune(tune) => Self::Tune(tune),
            EnergizingRequest::ClearFault(empty) => Self::ClearFault(empty),
            EnergizingRequest::Maintain(maintain) => Self::Maintain(maintain),
        }
    }
}

macro_rules! passive_requests {
    ($($name:ident($body:ty),)*) => {
        /// A request that makes the board neither heat nor move. Requests that send layers belong here, because the
        /// board lays layers only after a `Start`. [`Message`] describes each request.
        #[derive(Debug, Clone, PartialEq)]
        #[expect(missing_docs, reason = "Message describes each variant")]
        pub enum PassiveRequest {
            $($name($body),)*
            CoolDown,
        }

        impl From<PassiveRequest> for Message {
            fn from(request: PassiveRequest) -> Self {
                match request {
                    $(PassiveRequest::$name(body) => Self::$name(body),)*
                    PassiveRequest::CoolDown => Self::Maintain(Maintain { task: MaintenanceTask::CoolDown }),
                }
            }
        }
    };
}

passive_requests! {
    Hello(Hello),
    GetStatus(Empty),
    BeginJob(BeginJob),
    AppendLayers(AppendLayers),
    Stop(Empty),
    Plan(PlanRequest),
    ReadLayers(ReadLayers),
    Pause(Empty),
    GetLatestFault(Empty),
    GetSensorReadings(Empty),
    Ack(Empty),
    Resume(Resume),
    Amend(Amend),
    Cancel(Cancel),
    GetBoardInfo(Empty),
    Goodbye(Empty),
    GetBootReport(Empty),
    Configure(Configure),
}

/// A message, sorted by its effect on the board.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "a message is as large")]
pub enum Effect {
    /// A request that makes the board neither heat nor move.
    Passive(PassiveRequest),
    /// A request after which the board may heat or move.
    Energizing(EnergizingRequest),
    /// A response or an event of the board.
    FromBoard,
}

impl Message {
    /// Returns the message, sorted by its effect. The match has no default, so a new message does not compile until it
    /// is sorted.
    pub fn effect(self) -> Effect {
        match self {
            Self::Start(start) => Effect::Energizing(EnergizingRequest::Start(start)),
            Self::Tune(tune) => Effect::Energizing(EnergizingRequest::Tune(tune)),
            Self::ClearFault(empty) => Effect::Energizing(EnergizingRequest::ClearFault(empty)),
            Self::Maintain(Maintain { task: MaintenanceTask::CoolDown }) => Effect::Passive(PassiveRequest::CoolDown),
            Self::Maintain(maintain) => Effect::Energizing(EnergizingRequest::Maintain(maintain)),
            Self::Hello(body) => Effect::Passive(PassiveRequest::Hello(body)),
            Self::GetStatus(body) => Effect::Passive(PassiveRequest::GetStatus(body)),
            Self::BeginJob(body) => Effect::Passive(PassiveRequest::BeginJob(body)),
            Self::AppendLayers(body) => Effect::Passive(PassiveRequest::AppendLayers(body)),
            Self::Stop(body) => Effect::Passive(PassiveRequest::Stop(body)),
            Self::Plan(body) => Effect::Passive(PassiveRequest::Plan(body)),
            Self::ReadLayers(body) => Effect::Passive(PassiveRequest::ReadLayers(body)),
            Self::Pause(body) => Effect::Passive(PassiveRequest::Pause(body)),
            Self::GetLatestFault(body) => Effect::Passive(PassiveRequest::GetLatestFault(body)),
            Self::GetSensorReadings(body) => Effect::Passive(PassiveRequest::GetSensorReadings(body)),
            Self::Ack(body) => Effect::Passive(PassiveRequest::Ack(body)),
            Self::Resume(body) => Effect::Passive(PassiveRequest::Resume(body)),
            Self::Amend(body) => Effect::Passive(PassiveRequest::Amend(body)),
            Self::Cancel(body) => Effect::Passive(PassiveRequest::Cancel(body)),
            Self::GetBoardInfo(body) => Effect::Passive(PassiveRequest::GetBoardInfo(body)),
            Self::Goodbye(body) => Effect::Passive(PassiveRequest::Goodbye(body)),
            Self::GetBootReport(body) => Effect::Passive(PassiveRequest::GetBootReport(body)),
            Self::Configure(body) => Effect::Passive(PassiveRequest::Configure(body)),
            Self::BoardInfo(_)
            | Self::Status(_)
            | Self::Accepted(_)
            | Self::Refused(_)
            | Self::Planned(_)
            | Self::StoredLayers(_)
            | Self::LatestFault(_)
            | Self::SensorReadings(_)
            | Self::BootReport(_)
            | Self::Configured(_)
            | Self::LayerLaid(_)
            | Self::StateChanged(_)
            | Self::Tuned(_)
            | Self::EmergencyStopAck(_) => Effect::FromBoard,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::HostSilencePolicy;
    use super::*;

    #[test]
    fn a_message_is_the_same_after_sorting() {
        let maintain = |task| Message::Maintain(Maintain { task });
        let energizing = [
            Message::Start(Start { plan_id: 1, on_host_silence: HostSilencePolicy::Pause, is_continuation: false }),
            Message::Tune(Tune { target_centi_c: 20_000 }),
            Message::ClearFault(Empty {}),
            maintain(MaintenanceTask::Preheat { target_centi_c: 20_000 }),
            maintain(MaintenanceTask::DryRun),
            maintain(MaintenanceTask::Home),
        ];
        for message in energizing {
            let Effect::Energizing(request) = message.clone().effect() else { panic!("{message:?}") };
            assert_eq!(Message::from(request), message);
        }
        let passive = [
            maintain(MaintenanceTask::CoolDown),
            Message::Stop(Empty {}),
            Message::Pause(Empty {}),
            Message::Cancel(Cancel { plan_id: 1 }),
        ];
        for message in passive {
            let Effect::Passive(request) = message.clone().effect() else { panic!("{message:?}") };
            assert_eq!(Message::from(request), message);
        }
        assert_eq!(Message::EmergencyStopAck(Empty {}).effect(), Effect::FromBoard);
    }
}
