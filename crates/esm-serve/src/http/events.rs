//! `GET /v1/events`: every answer as it is given, for those who watch (server-sent events).

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::extract::State as Shared;
use axum::http::{HeaderValue, header};
use axum::response::Response;
use futures_util::stream::unfold;
use tokio::sync::broadcast::error::RecvError;
use tokio::time::timeout;

use crate::problem::Problem;
use crate::state::{MAX_WATCHERS, State};

/// How often something is sent where there is nothing to tell, so that a watcher who has gone is noticed.
const SIGN_OF_LIFE: Duration = Duration::from_secs(15);

pub(super) async fn get(Shared(state): Shared<Arc<State>>) -> Result<Response, Problem> {
    let Ok(permit) = Arc::clone(&state.watchers).try_acquire_owned() else {
        let what = format!("{MAX_WATCHERS} watch already, as many as may");
        return Err(Problem::busy(what, "close another page"));
    };
    let events = state.events.subscribe();
    let stream = unfold(Some((events, state, permit)), |watch| async {
        let (mut events, state, permit) = watch?;
        let next = tokio::select! {
            () = state.stopped() => return None,
            next = timeout(SIGN_OF_LIFE, events.recv()) => next,
        };
        let text = match next {
            Ok(Ok(event)) => format!("data: {event}\n\n"),
            // Too slow for some of them, which are old by now.
            Ok(Err(RecvError::Lagged(missed))) => format!(": {missed} missed\n\n"),
            Ok(Err(RecvError::Closed)) => return None,
            Err(_) => ": nothing new\n\n".to_owned(),
        };
        Some((Ok::<_, Infallible>(Bytes::from(text)), Some((events, state, permit))))
    });
    // The first bytes go out at once: whoever watches knows that it works.
    let hello = futures_util::stream::once(async { Ok(Bytes::from_static(b": welcome\n\n")) });
    let mut response = Response::new(Body::from_stream(futures_util::StreamExt::chain(hello, stream)));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/event-stream"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    Ok(response)
}
