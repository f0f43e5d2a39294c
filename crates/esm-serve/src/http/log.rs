//! A number for every request, and a line about each in the log.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use axum::extract::{MatchedPath, Request, State as Shared};
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::middleware::Next;
use axum::response::Response;

use super::routes;
use crate::state::State;

/// Names one request in the client's log and in ours; taken over from the request, or made.
pub(crate) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Longest number that is taken over, bytes.
const MAX_ID: usize = 128;

static NEXT: AtomicU64 = AtomicU64::new(0);

/// The request's own number where it can stand in a log line, else a new one.
fn id_of(headers: &HeaderMap) -> HeaderValue {
    let plain =
        |v: &&HeaderValue| (1..=MAX_ID).contains(&v.len()) && v.as_bytes().iter().all(u8::is_ascii_graphic);
    if let Some(given) = headers.get(&REQUEST_ID).filter(plain) {
        return given.clone();
    }
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let id = format!("{:x}-{:x}", since.as_millis(), NEXT.fetch_add(1, Ordering::Relaxed));
    HeaderValue::from_str(&id).unwrap_or_else(|_| HeaderValue::from_static("0"))
}

pub(super) async fn log(Shared(state): Shared<Arc<State>>, mut request: Request, next: Next) -> Response {
    let started = Instant::now();
    let id = id_of(request.headers());
    request.headers_mut().insert(REQUEST_ID, id.clone());
    let method = request.method().clone();
    let path = request.uri().path().to_owned();
    let matched = request.extensions().get::<MatchedPath>();
    let route = matched.and_then(|m| routes::route(m.as_str())).map(|r| r.path);
    let mut response = next.run(request).await;
    let (took, status) = (started.elapsed(), response.status().as_u16());
    state.metrics.requested(route, status, took);
    tracing::info!(
        request_id = id.to_str().unwrap_or_default(),
        method = method.as_str(),
        path = path.escape_debug().to_string(),
        status,
        ms = (took.as_secs_f64() * 1e6).round() / 1e3,
        "request"
    );
    response.headers_mut().insert(REQUEST_ID, id);
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn given_numbers_are_kept_where_they_are_plain() {
        let id = |v: &[u8]| {
            let mut headers = HeaderMap::new();
            headers.insert(REQUEST_ID, HeaderValue::from_bytes(v).unwrap());
            id_of(&headers).as_bytes().to_vec()
        };
        assert_eq!(id(b"abc-1"), b"abc-1");
        for bad in [&b"a b"[..], b"", "ä".as_bytes(), &[b'x'; 129]] {
            assert_ne!(id(bad), bad);
        }
        assert_ne!(id_of(&HeaderMap::new()), id_of(&HeaderMap::new()));
    }
}
