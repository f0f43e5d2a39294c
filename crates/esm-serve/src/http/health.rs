//! For those who watch: alive, ready, metrics, and the document that describes the rest.

use std::sync::Arc;

use axum::extract::State as Shared;
use axum::http::header;
use axum::response::IntoResponse;

use crate::problem::Problem;
use crate::state::State;

/// Checked in beside the code; a test holds it against the routes.
pub(super) const OPENAPI: &str = include_str!("../openapi.json");

pub(super) async fn alive() -> &'static str {
    "ok\n"
}

pub(super) async fn ready(Shared(state): Shared<Arc<State>>) -> Result<&'static str, Problem> {
    match state.is_ready() {
        true => Ok("ready\n"),
        false => Err(Problem::busy(
            "no map is loaded, or the service is about to stop",
            "load a map: PUT /v1/maps/NAME",
        )),
    }
}

pub(super) async fn metrics(Shared(state): Shared<Arc<State>>) -> impl IntoResponse {
    state.metrics.queue_depth.set(state.pool.waiting());
    let kind = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    ([(header::CONTENT_TYPE, kind)], state.metrics.text())
}

pub(super) async fn openapi() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json")], OPENAPI)
}
