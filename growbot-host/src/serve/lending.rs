//! Lending a robot's line: a command that talks to the board itself, as `growbot console` does, has it for as long as it
//! keeps its request open. Meanwhile the service looks after nothing but the emergency stop.

use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use growbot_client::client::Client;
use growbot_sim::port;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::task::spawn_blocking;

use super::api::{Access, Shared};
use super::audit::By;
use super::problem::Problem;
use super::robot::{Ask, Asked, Keeper};

/// A line is given up within this: its robot may be asked how it is.
const ANSWER: Duration = Duration::from_secs(10);
/// How often it is looked whether the line is back, and whether somebody is still there.
const LOOK: Duration = Duration::from_millis(50);
/// A board confirms an emergency stop on a line of its own within this.
const EMERGENCY: Duration = Duration::from_millis(500);
/// A board confirms an emergency stop within this, or never.
const CONFIRMED: Duration = Duration::from_secs(2);

/// Who wants a line.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Borrower {
    /// The command.
    pub to: String,
}

/// A line that is lent.
pub struct Loan {
    /// To whom.
    to: String,
    is_over: Arc<AtomicBool>,
}

/// While it is held, its holder has the line.
struct Held(Arc<AtomicBool>);

impl Drop for Held {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Lends the line of a robot without a job until the request is left.
pub async fn lend(
    State(service): Shared,
    Extension(access): Extension<Access>,
    Path(name): Path<String>,
    Json(Borrower { to }): Json<Borrower>,
) -> Result<Response, Problem> {
    if access != Access::Operate(By::Command) {
        return Err(Problem::forbidden("a line is lent to commands on the machine of the service alone"));
    }
    let keeper = Arc::clone(service.robot(&name).ok_or_else(|| Problem::not_found("robot", &name))?);
    let held = Held(Arc::default());
    let loan = Loan { to: to.clone(), is_over: Arc::clone(&held.0) };
    let asked = spawn_blocking(move || {
        let _begins = keeper.begins();
        let asked = keeper.has_no_job().and_then(|()| keeper.ask(Ask::Lend(loan), ANSWER));
        service.shared.audit.note(
            By::Command,
            &name,
            &format!("lend to {to}"),
            asked.as_ref().err().map(String::as_str),
        );
        asked
    });
    asked.await.map_err(Problem::internal)?.map_err(Problem::conflict)?;
    // Nothing is told. It ends when the borrower goes.
    let nothing = futures_util::stream::unfold(held, |held| async move {
        std::future::pending::<()>().await;
        Some((Ok::<_, Infallible>(Event::default()), held))
    });
    Ok(Sse::new(nothing).keep_alive(KeepAlive::new().interval(Duration::from_secs(1))).into_response())
}

impl Keeper {
    /// Waits until a line is back that is closed here. Who asks meanwhile is refused, but for an emergency stop.
    pub(super) fn wait_for_line(&self, loan: &Loan, asked: &Receiver<Asked>) {
        let lent = format!("its line is lent to {}, which has to end first", loan.to);
        self.know(|known| known.trouble = Some(lent.clone()));
        while !loan.is_over.load(Ordering::Acquire) {
            let Ok(asked) = asked.recv_timeout(LOOK) else { continue };
            let answer = match asked.ask {
                Ask::EmergencyStop => self.stop_beside(),
                _ => Err(format!("robot {}: {lent}", self.name)),
            };
            asked.answer(answer);
        }
    }

    /// Gives the emergency stop on a line of its own, beside the one that is lent or busy.
    pub(super) fn stop_beside(&self) -> Result<(), String> {
        let name = self.port()?;
        let port = port::open_for_emergency_stop(&name, EMERGENCY).map_err(|error| error.to_string())?;
        let mut client = Client::new(port, &self.entry.port);
        match client.emergency_stop_within(CONFIRMED, &mut 0) {
            Ok(true) => Ok(()),
            Ok(false) => Err(format!("no answer at {} within {} s", self.entry.port, CONFIRMED.as_secs())),
            Err(error) => Err(error.to_string()),
        }
    }
}
