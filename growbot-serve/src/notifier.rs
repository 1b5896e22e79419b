//! Sends notices to a webhook, with a signature, and to a command. Each of these two channels has its own thread and
//! queue, so they do not wait for each other, and the threads of the robots do not wait for them.

use std::io::Write;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, sleep};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use std::{fs, io};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ring::hmac;
use rustix::process::{Pid, Signal, kill_process_group};
use ureq::Agent;

use super::alert::Alert;
use super::config::NotifyEntry;
use super::job_store::{JobStore, JobStoreError};
use super::job_updates::JobUpdate;
use super::notification::{Notification, NotificationChannel, NotificationContext, NotificationEvent};
use super::notification_queue::QueuedNotification;
use super::paths::ServicePaths;
use super::secret_file::write_secret;
use super::web_address::WebAddress;

/// Timeout of a webhook's response.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(10);
/// Maximum running time of the command that receives a notice. The service kills the command afterwards.
const COMMAND: Duration = Duration::from_secs(60);
/// Delay before the first retry of a notice. The delay doubles with each further retry.
const FIRST_RETRY_DELAY: Duration = Duration::from_secs(1);
/// Maximum delay before a retry of a notice.
const MAX_RETRY_DELAY: Duration = Duration::from_secs(3600);
/// Age after which a notice is not retried any more.
const MAX_AGE: Duration = Duration::from_secs(24 * 3600);
/// Prefix of the webhook's secret in its file, which the Standard Webhooks specification requires.
const SECRET: &str = "whsec_";

/// Errors in the settings of notifications.
#[derive(Debug, thiserror::Error)]
pub enum NotifyError {
    /// The webhook's URL is invalid. The message does not repeat the URL, because it may contain a secret.
    #[error("the webhook of [serve.notify] cannot be used: give a URL with https:// or http:// and a host")]
    Address,
    /// The command that receives notices is empty.
    #[error("the command of [serve.notify] is empty: give a list of a program and its arguments, or remove the line")]
    Command,
    /// The webhook's secret cannot be used.
    #[error(
        "cannot use the webhook's secret in {path}: {reason}; make the file readable and correct it, or delete it \
         and give the receiver the secret that the service then generates"
    )]
    Secret {
        /// Path of the secret's file.
        path: String,
        /// Reason why the secret cannot be used.
        reason: SecretError,
    },
}

/// Reason why the webhook's secret cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SecretError {
    /// The file of the secret cannot be read or written.
    #[error("{0}")]
    File(#[from] io::Error),
    /// The system has no random numbers for a new secret.
    #[error("{0}")]
    Random(#[from] getrandom::Error),
    /// The prefix is missing.
    #[error("the secret does not begin with {SECRET}")]
    Prefix,
    /// The rest is not base64.
    #[error("the secret is not base64")]
    Base64,
    /// The secret has this number of bytes.
    #[error("the secret has {0} bytes, but must have 24 to 64")]
    Length(usize),
}

/// Reason why a receiver did not accept a notice.
#[derive(Debug, thiserror::Error)]
enum DeliveryError {
    #[error("the receiver responded {0}")]
    Status(u16),
    /// The message does not repeat the URL, because it may contain a secret.
    #[error("the URL is invalid")]
    Address,
    #[error("{0}")]
    Webhook(ureq::Error),
    #[error("{0}")]
    Notice(#[from] serde_json::Error),
    #[error("{0}")]
    Command(#[from] io::Error),
    #[error("the command ended with {0}")]
    Ended(ExitStatus),
    #[error("the command did not end within {} s", COMMAND.as_secs())]
    Late,
}

/// The configured channels, and the events that are sent on them.
#[derive(Default)]
pub struct Notifier {
    channels: Vec<(NotificationChannel, Mutex<Sender<()>>)>,
    events: Vec<NotificationEvent>,
}

/// A webhook that receives notices over HTTP.
struct Webhook {
    address: String,
    /// Scheme and host of the address, for messages. The other parts may be secret.
    host: String,
    key: hmac::Key,
    agent: Agent,
}

/// The channels and receivers of the threads that send notices, before the threads are started.
pub struct NotifierThreads(Vec<(NotificationChannel, Receiver<()>, NotificationSink)>);

enum NotificationSink {
    Webhook(Box<Webhook>),
    Command(Vec<String>),
}

impl Notifier {
    /// Creates the channels that the settings configure, and the threads that send notices on them.
    pub fn new(entry: &NotifyEntry, places: &ServicePaths) -> Result<(Self, NotifierThreads), NotifyError> {
        let mut sinks = Vec::new();
        if let Some(address) = &entry.webhook {
            sinks.push((
                NotificationChannel::Webhook,
                NotificationSink::Webhook(Box::new(Webhook::new(address, &places.webhook_secret())?)),
            ));
        }
        if let Some(command) = &entry.command {
            if command.first().is_none_or(String::is_empty) {
                return Err(NotifyError::Command);
            }
            sinks.push((NotificationChannel::Command, NotificationSink::Command(command.clone())));
        }
        let mut notify = Self {
            channels: Vec::new(),
            events: entry.events.clone().unwrap_or_else(|| NotificationEvent::ALL.to_vec()),
        };
        let start = |(channel, sink)| {
            let (wake, woken) = mpsc::channel();
            notify.channels.push((channel, Mutex::new(wake)));
            (channel, woken, sink)
        };
        let sinks = sinks.into_iter().map(start).collect();
        Ok((notify, NotifierThreads(sinks)))
    }

    /// Returns a sender for each thread that sends notices. A message on the sender wakes the thread.
    pub fn wakers(&self) -> Vec<Sender<()>> {
        self.channels.iter().map(|(_, waker)| waker.lock().unwrap_or_else(PoisonError::into_inner).clone()).collect()
    }

    fn channels(&self) -> Vec<NotificationChannel> {
        self.channels.iter().map(|(channel, _)| *channel).collect()
    }

    /// Returns the change that queues a notice about a robot. `None` if no channel is configured, or if this event is
    /// not sent.
    pub fn event_update(
        &self,
        about: &NotificationContext,
        event: NotificationEvent,
        why: Option<&str>,
    ) -> Option<JobUpdate> {
        let channels = self.channels();
        (!channels.is_empty() && self.events.contains(&event)).then(|| {
            let text = about.notice(event, None, why).to_text();
            JobUpdate::Notice { text, channels, created_ms: now_ms() }
        })
    }

    /// Returns the changes that record conditions of a robot, each with the notice that is queued if the condition is
    /// new. Empty if no channel is configured.
    pub fn alert_updates(
        &self,
        about: &NotificationContext,
        alerts: impl IntoIterator<Item = Alert>,
    ) -> impl Iterator<Item = JobUpdate> {
        let channels = self.channels();
        let alerts = (!channels.is_empty()).then_some(alerts).into_iter().flatten();
        alerts.map(move |alert| JobUpdate::Alert(alert.into_update(about.robot, &self.events, &channels, now_ms())))
    }
}

impl NotifierThreads {
    /// Starts the threads. They send queued notices until the process ends.
    pub fn start(self, jobs: &Arc<Mutex<JobStore>>) {
        for (channel, woken, sink) in self.0 {
            let jobs = Arc::clone(jobs);
            let spawned =
                thread::Builder::new().name(format!("{channel:?}")).spawn(move || run(&jobs, channel, &woken, &sink));
            if let Err(error) = spawned {
                log::warn!(
                    "notifications by {channel:?} are not sent, because the service cannot start a thread: {error}"
                );
            }
        }
    }
}

fn lock(jobs: &Mutex<JobStore>) -> MutexGuard<'_, JobStore> {
    jobs.lock().unwrap_or_else(PoisonError::into_inner)
}

fn run(jobs: &Mutex<JobStore>, channel: NotificationChannel, woken: &Receiver<()>, sink: &NotificationSink) {
    loop {
        let next = lock(jobs).next_notification(channel);
        let wait = match next {
            Ok(Some(next)) if next.due_ms <= now_ms() => {
                if let Err(error) = deliver(jobs, &next, sink) {
                    log::warn!("{error}");
                    sleep(FIRST_RETRY_DELAY);
                }
                continue;
            }
            Ok(Some(next)) => Duration::from_millis(u64::try_from(next.due_ms - now_ms()).unwrap_or(0)),
            Ok(None) => MAX_RETRY_DELAY,
            Err(error) => {
                log::warn!("{error}");
                MAX_RETRY_DELAY
            }
        };
        // The wait is limited because the system's clock may be set in the meantime.
        let _ = woken.recv_timeout(wait.min(MAX_RETRY_DELAY));
    }
}

/// Tries once to send a notice. If that fails, schedules a retry or gives the notice up.
fn deliver(jobs: &Mutex<JobStore>, next: &QueuedNotification, sink: &NotificationSink) -> Result<(), JobStoreError> {
    let sent = match sink {
        NotificationSink::Webhook(webhook) => webhook.post(next),
        NotificationSink::Command(command) => call(command, &next.notice),
    };
    let Err(why) = sent else { return lock(jobs).remove_notification(next.id) };
    let by = match sink {
        NotificationSink::Webhook(webhook) => &webhook.host,
        NotificationSink::Command(command) => &command[0],
    };
    let pause = FIRST_RETRY_DELAY.saturating_mul(1 << next.attempts.min(12)).min(MAX_RETRY_DELAY);
    let due_ms = now_ms() + as_ms(pause);
    if due_ms > next.created_ms + as_ms(MAX_AGE) {
        log::warn!(
            "{by} did not accept a notification ({why}): the service has given up sending it after {} h",
            MAX_AGE.as_secs() / 3600
        );
        return lock(jobs).remove_notification(next.id);
    }
    if next.attempts == 0 {
        log::warn!("{by} did not accept a notification ({why}): the service will send it again");
    }
    lock(jobs).reschedule_notification(next.id, due_ms)
}

impl Webhook {
    fn new(address: &str, secret: &Path) -> Result<Self, NotifyError> {
        let host = WebAddress::parse(address).ok_or(NotifyError::Address)?.origin();
        let agent = Agent::config_builder()
            .timeout_global(Some(RESPONSE_TIMEOUT))
            .max_redirects(0)
            .http_status_as_error(false)
            .user_agent(concat!("growbot/", env!("CARGO_PKG_VERSION")))
            .build();
        let error = |reason| NotifyError::Secret { path: secret.display().to_string(), reason };
        let key = hmac::Key::new(hmac::HMAC_SHA256, &secret_of(secret).map_err(error)?);
        Ok(Self { address: address.to_owned(), host, key, agent: agent.into() })
    }

    fn post(&self, next: &QueuedNotification) -> Result<(), DeliveryError> {
        let id = format!("{}-{}", next.created_ms, next.id);
        let time = (now_ms() / 1000).to_string();
        let answer = self
            .agent
            .post(&self.address)
            .header("content-type", "application/json")
            .header("webhook-id", &id)
            .header("webhook-timestamp", &time)
            .header("webhook-signature", signature(&self.key, &id, &time, &next.notice))
            .send(&next.notice);
        match answer {
            Ok(answer) if answer.status().is_success() => Ok(()),
            Ok(answer) => Err(DeliveryError::Status(answer.status().as_u16())),
            Err(ureq::Error::BadUri(_)) => Err(DeliveryError::Address),
            Err(error) => Err(DeliveryError::Webhook(error)),
        }
    }
}

/// Returns the signature of a notice and its time, with which the receiver checks that this service has sent it.
fn signature(key: &hmac::Key, id: &str, time: &str, notice: &str) -> String {
    format!("v1,{}", STANDARD.encode(hmac::sign(key, format!("{id}.{time}.{notice}").as_bytes())))
}

/// Returns the webhook's secret from its file. A missing file is created with a new secret.
fn secret_of(path: &Path) -> Result<Vec<u8>, SecretError> {
    let text = match fs::read_to_string(path) {
        Ok(text) => text,
        Err(missing) if missing.kind() == io::ErrorKind::NotFound => {
            let mut bytes = [0; 32];
            getrandom::fill(&mut bytes)?;
            let text = format!("{SECRET}{}\n", STANDARD.encode(bytes));
            write_secret(path, &text)?;
            text
        }
        Err(error) => return Err(error.into()),
    };
    let encoded = text.trim().strip_prefix(SECRET).ok_or(SecretError::Prefix)?;
    let bytes = STANDARD.decode(encoded).map_err(|_| SecretError::Base64)?;
    match bytes.len() {
        24..=64 => Ok(bytes),
        length => Err(SecretError::Length(length)),
    }
}

/// Runs the configured command with the notice on its standard input and in environment variables.
fn call(command: &[String], notice: &str) -> Result<(), DeliveryError> {
    let read: Notification = serde_json::from_str(notice)?;
    let mut child = Command::new(&command[0])
        .args(&command[1..])
        .env("GROWBOT_NOTIFICATION_EVENT", read.event.name())
        .env("GROWBOT_NOTIFICATION_ROBOT", &read.robot)
        .env("GROWBOT_NOTIFICATION_MESSAGE", &read.message)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .process_group(0)
        .spawn()?;
    if let Some(mut stdin) = child.stdin.take() {
        // The command may ignore its input. A pipe can buffer a whole notice, so the write does not block.
        let _ = stdin.write_all(notice.as_bytes());
    }
    let began = Instant::now();
    loop {
        match child.try_wait()? {
            Some(status) if status.success() => return Ok(()),
            Some(status) => return Err(DeliveryError::Ended(status)),
            None if began.elapsed() < COMMAND => sleep(Duration::from_millis(20)),
            None => {
                if let Some(group) = i32::try_from(child.id()).ok().and_then(Pid::from_raw) {
                    let _ = kill_process_group(group, Signal::KILL);
                }
                let _ = child.wait();
                return Err(DeliveryError::Late);
            }
        }
    }
}

fn as_ms(duration: Duration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX)
}

fn now_ms() -> i64 {
    as_ms(SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_secret_is_created_once_and_readable_only_by_its_user() {
        use std::os::unix::fs::PermissionsExt;
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("webhook-secret");
        let secret = secret_of(&path).unwrap();
        assert_eq!((secret.len(), secret_of(&path).unwrap() == secret), (32, true));
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        type IsExpected = fn(&SecretError) -> bool;
        let cases: [(&str, IsExpected); 5] = [
            ("", |error| matches!(error, SecretError::Prefix)),
            ("whsec_", |error| matches!(error, SecretError::Length(0))),
            ("whsec_????", |error| matches!(error, SecretError::Base64)),
            ("c2VjcmV0", |error| matches!(error, SecretError::Prefix)),
            ("whsec_c2hvcnQ=", |error| matches!(error, SecretError::Length(5))),
        ];
        for (wrong, is_expected) in cases {
            fs::write(&path, wrong).unwrap();
            let reason = secret_of(&path).unwrap_err();
            assert!(is_expected(&reason), "{wrong}: {reason}");
            let message = Webhook::new("https://hooks.example", &path).err().unwrap().to_string();
            assert!(
                message.contains("the secret that the service then generates")
                    && (wrong.is_empty() || !message.contains(wrong)),
                "{message}"
            );
        }
    }

    /// The expected signature was computed with hmac, hashlib and base64 of Python.
    #[test]
    fn the_signature_matches_another_implementation() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("webhook-secret");
        fs::write(&path, "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw").unwrap();
        let key = hmac::Key::new(hmac::HMAC_SHA256, &secret_of(&path).unwrap());
        let made = signature(&key, "1795398240123-7", "1795398241", r#"{"version":1}"#);
        assert_eq!(made, "v1,5zLlH7Gc03CBvyW2/4gfkxibdIrLf73U6qnOsMGtmT8=");
    }

    #[test]
    fn invalid_urls_are_refused_and_not_quoted() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("webhook-secret");
        for wrong in ["", "hooks.example/s3cret", "ftp://hooks.example/s3cret", "https:///s3cret", "http://a b/s3cret"]
        {
            let error = Webhook::new(wrong, &path).err().unwrap();
            assert!(!error.to_string().contains("s3cret"), "{error}");
        }
        assert_eq!(
            Webhook::new("https://me:pass@hooks.example/s3cret?key=1", &path).unwrap().host,
            "https://hooks.example"
        );
    }
}
