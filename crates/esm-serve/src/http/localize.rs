//! `POST /v1/localize`: one cloud, taken by itself.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, Request, State as Shared};
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::response::IntoResponse;
use esm_core::{AccumulateConfig, Accumulator};
use serde::Deserialize;
use tokio::time::{Instant, timeout_at};

use crate::body::{Kind, Received, receive};
use crate::problem::Problem;
use crate::state::{Answer, Nothing, State, find, worked};

/// Tells which map an answer is about.
pub(crate) const MAP_HEADER: HeaderName = HeaderName::from_static("x-esm-map");

/// What can be asked of the cloud.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Asked {
    /// The map to search; all of them where it is missing.
    map: Option<String>,
    /// Seconds, for bodies that do not tell their time.
    stamp: Option<f64>,
}

pub(super) async fn post(
    Shared(state): Shared<Arc<State>>,
    asked: Result<Query<Asked>, QueryRejection>,
    request: Request<Body>,
) -> Result<impl IntoResponse, Problem> {
    let deadline = Instant::now() + state.options.request_timeout;
    let Query(Asked { map, stamp }) = asked.map_err(|e| bad_query(&e, "?map=NAME&stamp=SECONDS"))?;
    if stamp.is_some_and(|s| !s.is_finite()) {
        return Err(Problem::new(
            StatusCode::BAD_REQUEST,
            "the stamp is no number",
            "give seconds: ?stamp=1.5",
        ));
    }
    let maps = state.maps.pick(map.as_deref())?;
    let kind = Kind::of(request.headers())?;
    let (head, body) = request.into_parts();
    let limit = state.options.max_body_bytes;
    let seconds = state.options.request_timeout.as_secs_f64();
    let Ok(received) = timeout_at(deadline, receive(&head.headers, body, limit, &state.budget)).await else {
        let what = format!("the body did not come within {seconds} s");
        return Err(Problem::new(StatusCode::REQUEST_TIMEOUT, what, "send it faster, or thin the cloud"));
    };
    let Received { bytes, held } = received?;
    let Some(place) = state.pool.try_enter() else {
        return Err(Problem::busy(
            "as many clouds wait as may",
            "try again in a moment, or send fewer clouds",
        ));
    };
    // A cloud by itself, whatever is accumulated elsewhere.
    let config =
        AccumulateConfig { distance_m: 0.0, swathes: false, ..state.options.config.accumulate.clone() };
    let watched = state.is_watched();
    let work = place.run(move || {
        let (scan, told) = kind.parse(&bytes, limit)?;
        drop((bytes, held));
        let mut accumulator =
            Accumulator::new(config).map_err(|e| Problem::of(StatusCode::INTERNAL_SERVER_ERROR, &e))?;
        let live = accumulator.push(told.or(stamp).unwrap_or(0.0), &scan.cloud, None);
        let live = live.ok_or_else(|| crate::state::internal("a single sweep gave no cloud"))?;
        find(&live, &maps, watched, |map| map.localizer.localize(&live))
    });
    let Ok(done) = timeout_at(deadline, work).await else {
        return Err(Problem::busy(
            format!("there was no answer within {seconds} s"),
            "try again in a moment",
        ));
    };
    let (answer, waited): (Answer, _) = worked(done)?;
    state.take_note(&answer, waited, "");
    let name = HeaderValue::from_str(&answer.map.name).unwrap_or_else(|_| HeaderValue::from_static(""));
    let json = HeaderValue::from_static("application/json");
    Ok(([(header::CONTENT_TYPE, json), (MAP_HEADER, name)], answer.line(Nothing {})?))
}

/// A query that cannot be read.
pub(crate) fn bad_query(rejection: &QueryRejection, like: &str) -> Problem {
    Problem::new(StatusCode::BAD_REQUEST, rejection.body_text(), format!("it looks like this: {like}"))
}
