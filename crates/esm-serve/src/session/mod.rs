//! `GET /v1/session`: a robot streams clouds and odometry, poses come back. The newest cloud wins where the robot is
//! faster than the service.

pub(crate) mod frame;
mod inbox;
mod robot;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::extract::rejection::QueryRejection;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::extract::{Query, State as Shared};
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use esm_core::{AccumulateConfig, Accumulator};
use futures_util::{SinkExt, StreamExt};
use serde::{Deserialize, Serialize};
use serde_json::json;
use tokio::sync::{Notify, OwnedSemaphorePermit, mpsc};
use tokio::time::{Instant, timeout, timeout_at};

use crate::body::Held;
use crate::http::{REQUEST_ID, bad_query};
use crate::problem::Problem;
use crate::state::{State, worked};
use frame::{Incoming, look, read_text};
use inbox::Inbox;
use robot::Robot;

/// How long a cloud waits for the odometry at its time, where there is odometry.
const MOTION_WAIT: Duration = Duration::from_millis(200);
/// Answers that wait for a slow client; more make the session wait, and its clouds go.
const OUTBOX: usize = 4;
/// How often a silent client is asked whether it is still there.
const PING: Duration = Duration::from_secs(15);

/// How long a goodbye may take.
const LINGER: Duration = Duration::from_secs(2);

/// What a session is about.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Asked {
    /// The map to search; all of them where it is missing.
    map: Option<String>,
    /// Metres of travel a cloud holds; the service's setting where it is missing.
    accumulate: Option<f64>,
}

pub(crate) async fn get(
    Shared(state): Shared<Arc<State>>,
    asked: Result<Query<Asked>, QueryRejection>,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    let Query(asked) = asked.map_err(|e| bad_query(&e, "?map=NAME&accumulate=METRES"))?;
    let mut config = AccumulateConfig { swathes: false, ..state.options.config.accumulate.clone() };
    config.distance_m = asked.accumulate.unwrap_or(config.distance_m);
    let accumulator = Accumulator::new(config).map_err(|e| {
        Problem::new(
            StatusCode::BAD_REQUEST,
            e.to_string(),
            "it looks like this: ?map=NAME&accumulate=METRES",
        )
    })?;
    state.maps.pick(asked.map.as_deref())?;
    let upgrade = upgrade.map_err(|e| {
        Problem::new(
            StatusCode::UPGRADE_REQUIRED,
            e.body_text(),
            "sessions speak WebSocket: ws://HOST/v1/session",
        )
    })?;
    let Ok(permit) = Arc::clone(&state.sessions).try_acquire_owned() else {
        let what = format!("{} sessions are open, as many as may be", state.options.max_sessions);
        return Err(Problem::busy(what, "end one, or raise --max-sessions"));
    };
    let request_id = headers.get(&REQUEST_ID).and_then(|v| v.to_str().ok()).unwrap_or_default().to_owned();
    let limit = state.options.max_body_bytes;
    Ok(upgrade.max_message_size(limit).max_frame_size(limit).on_upgrade(move |socket| {
        Talk { state, map: asked.map, request_id, permit }.run(socket, accumulator)
    }))
}

/// A session.
struct Talk {
    state: Arc<State>,
    map: Option<String>,
    request_id: String,
    /// Counts it as open.
    permit: OwnedSemaphorePermit,
}

/// How a session ends.
struct End {
    code: u16,
    reason: &'static str,
    /// Told before, where there is one.
    problem: Option<Problem>,
}

impl End {
    fn new(code: u16, reason: &'static str) -> Self {
        Self { code, reason, problem: None }
    }

    fn of(problem: Problem) -> Self {
        let code = if problem.status.is_client_error() { close_code::INVALID } else { close_code::ERROR };
        Self { code, reason: "see the message before", problem: Some(problem) }
    }
}

/// What the one who reads leaves for the one who works.
struct Shelf {
    inbox: Mutex<Inbox>,
    /// Something has come.
    news: Notify,
}

impl Shelf {
    fn inbox(&self) -> MutexGuard<'_, Inbox> {
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What an answer of a session says besides.
#[derive(Serialize)]
struct More {
    /// Clouds so far that got no answer of their own.
    dropped: u64,
}

impl Talk {
    async fn run(self, socket: WebSocket, accumulator: Accumulator) {
        self.state.metrics.sessions.inc();
        tracing::info!(request_id = self.request_id, map = self.map, "session begins");
        let (mut to, mut from) = socket.split();
        let (out, mut outbox) = mpsc::channel::<Message>(OUTBOX);
        let shelf =
            Shelf { inbox: Mutex::new(Inbox::new(self.state.options.max_body_bytes)), news: Notify::new() };
        let talk = async {
            let end = tokio::select! {
                end = self.read(&mut from, &shelf) => end,
                end = self.work(Robot::new(accumulator), &shelf, &out) => end,
            };
            tracing::info!(
                request_id = self.request_id,
                code = end.code,
                reason = end.problem.as_ref().map_or(end.reason, |p| p.detail.as_str()),
                "session ends"
            );
            if let Some(problem) = &end.problem {
                let _ = out.send(Message::text(json!({ "error": problem.json() }).to_string())).await;
            }
            let close = CloseFrame { code: end.code, reason: end.reason.into() };
            let _ = out.send(Message::Close(Some(close))).await;
            drop(out);
            // Closing with bytes unread would reset the connection, and what was said last might be lost with it.
            let _ = timeout(LINGER, async { while let Some(Ok(_)) = from.next().await {} }).await;
        };
        let write = async {
            loop {
                let message = match timeout(PING, outbox.recv()).await {
                    Ok(Some(message)) => message,
                    Ok(None) => break,
                    Err(_) => Message::Ping(axum::body::Bytes::new()),
                };
                // A client that takes nothing is cut off by its connection, and then nobody reads either.
                if to.send(message).await.is_err() {
                    break;
                }
            }
            outbox.close();
            // Also sends the answer to the client's own goodbye.
            let _ = timeout(LINGER, to.close()).await;
        };
        tokio::join!(talk, write);
        self.state.metrics.sessions.dec();
        drop(self.permit);
    }

    /// Puts what comes on the shelf, until the client ends or errs.
    async fn read(
        &self,
        from: &mut (impl StreamExt<Item = Result<Message, axum::Error>> + Unpin),
        shelf: &Shelf,
    ) -> End {
        loop {
            let message = match timeout(self.state.options.session_idle, from.next()).await {
                Ok(Some(Ok(message))) => message,
                Ok(Some(Err(error))) => {
                    let too_large = error.to_string().contains("too long");
                    if too_large {
                        let what = "the message is larger than --max-body-mb allows";
                        let hint = "thin the cloud, or raise --max-body-mb";
                        return End::of(Problem::new(StatusCode::PAYLOAD_TOO_LARGE, what, hint));
                    }
                    return End::new(close_code::PROTOCOL, "the connection broke");
                }
                Ok(None) => return End::new(close_code::NORMAL, "the client went"),
                Err(_) => return End::new(close_code::POLICY, "nothing came for too long"),
            };
            let incoming = match &message {
                Message::Binary(bytes) => look(bytes),
                Message::Text(text) => read_text(text),
                Message::Ping(_) | Message::Pong(_) => continue,
                Message::Close(_) => return End::new(close_code::NORMAL, "as asked"),
            };
            match (incoming, message) {
                (Ok(Incoming::Odometry { stamp_ns, pose_odom_sensor }), _) => {
                    shelf.inbox().moved(stamp_ns, pose_odom_sensor);
                }
                (Ok(Incoming::Cloud { stamp_ns }), Message::Binary(bytes)) => {
                    let mut held = Held::default();
                    let room = self.state.budget.grow(&mut held, bytes.len()).then_some(held);
                    shelf.inbox().push(stamp_ns, bytes, room);
                }
                (Ok(_), _) => continue,
                (Err(what), _) => {
                    let hint = "crates/esm-serve/README.md tells what messages look like";
                    return End::of(Problem::new(StatusCode::BAD_REQUEST, what, hint));
                }
            }
            shelf.news.notify_one();
        }
    }

    /// Answers the newest cloud, again and again.
    async fn work(&self, mut robot: Robot, shelf: &Shelf, out: &mpsc::Sender<Message>) -> End {
        let mut answered = 0;
        let mut told = 0;
        loop {
            tokio::select! {
                biased;
                () = self.state.stopped() => return End::new(close_code::AWAY, "the service stops"),
                () = something(shelf) => {}
            }
            // The odometry at the time of the newest cloud may come a little later than the cloud.
            let patience = Instant::now() + MOTION_WAIT;
            while shelf.inbox().awaits_motion() {
                if timeout_at(patience, shelf.news.notified()).await.is_err() {
                    break;
                }
            }
            let clouds = shelf.inbox().take();
            let Some(before) = clouds.last().map(|(cloud, _)| cloud.before) else { continue };
            // Looked up for each cloud: a map that was swapped is used from the next one on.
            let maps = match self.state.maps.pick(self.map.as_deref()) {
                Ok(maps) => maps,
                Err(problem) => return End::of(problem),
            };
            let watched = self.state.is_watched();
            let done = self.state.pool.enter().run(move || Ok(robot.step(clouds, &maps, watched))).await;
            let (kept, result, waited) = match worked(done) {
                Ok(((kept, result), waited)) => (kept, result, waited),
                Err(problem) => return End::of(problem),
            };
            robot = kept;
            let answer = match result {
                Ok(answer) => answer,
                Err(problem) => return End::of(problem),
            };
            self.state.take_note(&answer, waited, &self.request_id);
            answered += 1;
            let dropped = before + 1 - answered;
            self.state.metrics.session_cloud("answered", 1);
            self.state.metrics.session_cloud("dropped", dropped - std::mem::replace(&mut told, dropped));
            let line = match answer.line(More { dropped }) {
                Ok(line) => line,
                Err(problem) => return End::of(problem),
            };
            if out.send(Message::text(line)).await.is_err() {
                return End::new(close_code::AWAY, "the client went");
            }
        }
    }
}

/// Waits until there is a cloud.
async fn something(shelf: &Shelf) {
    while shelf.inbox().is_empty() {
        shelf.news.notified().await;
    }
}
