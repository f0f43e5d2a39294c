//! `/v1/maps`: what is loaded, loading, swapping, removing.

use std::path::PathBuf;
use std::sync::Arc;

use axum::Json;
use axum::body::Body;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, Request, State as Shared};
use axum::http::StatusCode;
use axum::response::IntoResponse;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::task::spawn_blocking;
use tokio::time::timeout;

use super::log::REQUEST_ID;
use crate::body::{Kind, receive};
use crate::problem::Problem;
use crate::state::{State, internal};

/// Largest body that names a file, bytes.
const MAX_ORDER: usize = 16 << 10;

/// The name in a request's path, which may be no text.
pub(super) type Named = Result<Path<String>, PathRejection>;

/// The name, where it is text.
pub(super) fn named(name: Named) -> Result<String, Problem> {
    let bad = |e: PathRejection| {
        Problem::new(StatusCode::BAD_REQUEST, e.body_text(), "GET /v1/maps lists the names")
    };
    name.map(|Path(name)| name).map_err(bad)
}

/// `GET /v1/maps`.
pub(super) async fn list(Shared(state): Shared<Arc<State>>) -> Json<Value> {
    Json(json!({ "maps": state.maps.all().iter().map(|m| m.json()).collect::<Vec<_>>() }))
}

/// `GET /v1/maps/NAME`.
pub(super) async fn get(Shared(state): Shared<Arc<State>>, name: Named) -> Result<Json<Value>, Problem> {
    let maps = state.maps.pick(Some(&named(name)?))?;
    Ok(Json(maps.first().map(|m| m.json()).unwrap_or_default()))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Order {
    file: PathBuf,
}

/// `PUT /v1/maps/NAME`. Once begun, a load is finished, even where nobody waits for its end any more.
pub(super) async fn put(
    Shared(state): Shared<Arc<State>>,
    name: Named,
    request: Request<Body>,
) -> Result<impl IntoResponse, Problem> {
    let name = named(name)?;
    let (head, body) = request.into_parts();
    if Kind::of(&head.headers) != Ok(Kind::Json) {
        let what = "a map is named in JSON";
        let hint = "Content-Type: application/json, body {\"file\": \"/maps/MAP.esm\"}";
        return Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, what, hint));
    }
    let received =
        timeout(state.options.request_timeout, receive(&head.headers, body, MAX_ORDER, &state.budget));
    let Ok(received) = received.await else {
        return Err(Problem::new(StatusCode::REQUEST_TIMEOUT, "the body did not come", "send it faster"));
    };
    let order: Order = serde_json::from_slice(&received?.bytes).map_err(|e| {
        let hint = "send {\"file\": \"/maps/MAP.esm\"}";
        Problem::new(StatusCode::BAD_REQUEST, format!("body: {e}"), hint)
    })?;
    let Ok(turn) = Arc::clone(&state.loading).try_acquire_owned() else {
        return Err(Problem::busy("another map is being loaded", "try again when it is done"));
    };
    let request_id =
        head.headers.get(&REQUEST_ID).and_then(|v| v.to_str().ok()).unwrap_or_default().to_owned();
    let shared = Arc::clone(&state);
    let loading = spawn_blocking(move || {
        let loaded = shared.maps.put(&name, &order.file);
        shared.metrics.map_load(loaded.is_ok());
        let file = order.file.display().to_string();
        match &loaded {
            Ok(map) => {
                shared.metrics.maps(&shared.maps.all());
                tracing::info!(request_id, map = name, file, segments = map.map.len(), "map loaded");
            }
            Err(problem) => {
                tracing::warn!(request_id, map = name, file, reason = problem.detail, "map refused");
            }
        }
        drop(turn);
        loaded
    });
    let loaded = loading.await.map_err(|_| internal("loading the map ended in a panic"))??;
    Ok(Json(loaded.json()))
}

/// `DELETE /v1/maps/NAME`.
pub(super) async fn delete(Shared(state): Shared<Arc<State>>, name: Named) -> Result<StatusCode, Problem> {
    let name = named(name)?;
    state.maps.remove(&name)?;
    state.metrics.maps(&state.maps.all());
    tracing::info!(map = name, "map removed");
    Ok(StatusCode::NO_CONTENT)
}
