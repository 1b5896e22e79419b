//! Streams of events: the lines of a job's run log, each once, and the state of all robots.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::ControlFlow::Continue;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use futures_util::stream::{Stream, unfold};
use growbot_client::recovery::RecoverySequence;
use growbot_client::status::RobotStatus;
use growbot_plan::sanitize::json_line;
use growbot_remote::api::JobState;
use schemars::JsonSchema;
use strum::IntoStaticStr;
use tokio::sync::watch;
use tokio::task::spawn_blocking;
use tokio::time::timeout;

use super::page_source::PageSource;
use super::service::Service;
use super::stream_event::{StreamEvent, state_events};
use crate::watch::heartbeat::Heartbeat;

/// Minimum time between two events about the robots.
const MIN_EVENT_INTERVAL: Duration = Duration::from_millis(100);
/// Interval at which a log is read even if no change was reported.
const LOG_POLL_INTERVAL: Duration = Duration::from_secs(1);
/// Maximum number of bytes that are read from a log at a time.
const CHUNK: u64 = 64 << 10;

/// Returns the lines of a job's run log after line `after`, then new lines as they are written, until the job ends. The
/// identifier of an event is the number of its line. A client that was disconnected resumes after the latest event that
/// it received.
pub fn job_events(service: Arc<Service>, id: String, after: u64) -> impl Stream<Item = StreamEvent> {
    let path = service.shared.jobs_to_read().log_path(&id);
    let changes = service.shared.changes.subscribe();
    let lines = LogTail { path, offset: 0, number: 0, after, rest: Vec::new(), found: Vec::new().into_iter() };
    unfold((service, id, changes, lines), |(service, id, mut changes, mut lines)| async move {
        loop {
            if let Some((number, line)) = lines.next() {
                let event = StreamEvent { event: "log", id: Some(number), data: line };
                return Some((event, (service, id, changes, lines)));
            }
            changes.mark_unchanged();
            let (context, job) = (Arc::clone(&service), id.clone());
            let read = spawn_blocking(move || {
                let is_active = context.job(&job).is_some_and(|job| job.state == JobState::Active);
                // The log contains all lines by now that were written before the job ended.
                let more = lines.read().unwrap_or(false);
                (lines, is_active, more)
            });
            let (back, is_active, more) = read.await.ok()?;
            lines = back;
            if !more && !is_active {
                return None;
            }
            if !more {
                wait(&mut changes).await;
            }
        }
    })
}

async fn wait(changes: &mut watch::Receiver<u64>) {
    // The log is read after a change and after the timeout.
    let _ = timeout(LOG_POLL_INTERVAL, changes.changed()).await;
}

/// Reader of a run log to which lines are still appended.
struct LogTail {
    path: PathBuf,
    offset: u64,
    /// Number of lines of the log that were read.
    number: u64,
    /// Number of lines of the log that the client already has and that are skipped.
    after: u64,
    /// Bytes of the last line that was read, which is not complete yet.
    rest: Vec<u8>,
    found: std::vec::IntoIter<(u64, String)>,
}

impl LogTail {
    fn next(&mut self) -> Option<(u64, String)> {
        self.found.next()
    }

    /// Reads more of the log. Returns whether any bytes were read.
    fn read(&mut self) -> io::Result<bool> {
        let mut file = File::open(&self.path)?;
        file.seek(SeekFrom::Start(self.offset))?;
        let before = self.rest.len();
        file.take(CHUNK).read_to_end(&mut self.rest)?;
        let read = self.rest.len() - before;
        self.offset += read as u64;
        let end = self.rest.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
        let whole: Vec<u8> = self.rest.drain(..end).collect();
        let mut found = Vec::new();
        for line in whole.split(|byte| *byte == b'\n').filter(|line| !line.is_empty()) {
            self.number += 1;
            if self.number > self.after {
                found.push((self.number, String::from_utf8_lossy(line).into_owned()));
            }
        }
        self.found = found.into_iter();
        Ok(read > 0)
    }
}

/// An event of the stream of all robots.
#[derive(JsonSchema, IntoStaticStr)]
#[serde(tag = "event", content = "data", rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum RobotEvent {
    /// The status of all robots, now and after each change.
    Robots(Vec<RobotStatus>),
    /// The sequence of recovery of each robot that needs a person, by the name of the robot, now and after each change.
    Recovery(BTreeMap<String, RecoverySequence>),
    /// Every 2 s, with the age of each status.
    Heartbeat(Heartbeat<BTreeMap<String, Option<f64>>>),
}

impl From<RobotEvent> for StreamEvent {
    fn from(event: RobotEvent) -> Self {
        let name = (&event).into();
        Self::new(
            name,
            &match event {
                RobotEvent::Robots(robots) => json_line(&robots),
                RobotEvent::Recovery(sequences) => json_line(&sequences),
                RobotEvent::Heartbeat(heartbeat) => json_line(&heartbeat),
            },
        )
    }
}

/// Returns the events of all robots.
pub fn robot_events<S: PageSource>(source: Arc<S>) -> impl Stream<Item = StreamEvent> {
    let (mut sent, mut sent_recovery) = (String::new(), None);
    state_events(source.changes(), MIN_EVENT_INTERVAL, move |is_heartbeat_due| {
        let robots = source.robots();
        // The robots come first, so that a page that has any data has them.
        let is_first = sent.is_empty();
        if is_heartbeat_due && !is_first {
            let ages = robots.into_iter().map(|robot| (robot.name.unwrap_or_default(), robot.status_age_s)).collect();
            return Continue(Some(RobotEvent::Heartbeat(Heartbeat::now(ages)).into()));
        }
        // Comes before the robots, because a status changes with each temperature.
        let recovery: BTreeMap<_, _> = robots.iter().filter_map(named_recovery).collect();
        if sent_recovery.as_ref() != Some(&recovery) && !is_first {
            sent_recovery = Some(recovery.clone());
            return Continue(Some(RobotEvent::Recovery(recovery).into()));
        }
        // The age of a status is not a change.
        let now = json_line(&robots.iter().map(RobotStatus::without_times).collect::<Vec<_>>());
        let is_new = now != sent;
        sent = now;
        Continue(is_new.then(|| RobotEvent::Robots(robots).into()))
    })
}

/// Returns the name and the sequence of recovery of a robot. `None` if the robot needs no person.
fn named_recovery(robot: &RobotStatus) -> Option<(String, RecoverySequence)> {
    Some((robot.name.clone().unwrap_or_default(), RecoverySequence::of(robot)?))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use futures_util::stream::StreamExt;

    use super::*;
    use crate::stop_model::service;

    #[test]
    fn a_new_stream_says_that_no_robot_needs_a_person() {
        let directory = tempfile::tempdir().unwrap();
        let service = Arc::new(service(&directory));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let events = robot_events(service).take(3).map(|event| (event.event, event.data));
        let events: Vec<_> = runtime.block_on(events.collect());
        assert_eq!(events[0], ("robots", "[]".to_owned()));
        assert_eq!((events[1].0, &events[2]), ("heartbeat", &("recovery", "{}".to_owned())));
    }

    #[test]
    fn each_line_is_sent_once_when_complete() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("log.jsonl");
        let mut file = File::create(&path).unwrap();
        let mut lines =
            LogTail { path, offset: 0, number: 0, after: 1, rest: Vec::new(), found: Vec::new().into_iter() };
        let all = |lines: &mut LogTail| {
            let _ = lines.read().unwrap();
            std::iter::from_fn(|| lines.next()).collect::<Vec<_>>()
        };
        file.write_all(b"one\ntwo\nthr").unwrap();
        assert_eq!(all(&mut lines), [(2, "two".to_owned())]);
        assert_eq!(all(&mut lines), []);
        file.write_all(b"ee\n\nfour\n").unwrap();
        assert_eq!(all(&mut lines), [(3, "three".to_owned()), (4, "four".to_owned())]);
    }
}
