//! Which request goes where. The table is what the router, the metrics and the OpenAPI document are held against.

use std::sync::Arc;

use axum::Router;
use axum::extract::MatchedPath;
use axum::http::{Method, StatusCode, header};
use axum::middleware;
use axum::response::IntoResponse;
use axum::routing::{MethodFilter, MethodRouter, on};

use super::{events, guard, health, localize, log, maps, page, points};
use crate::problem::Problem;
use crate::session;
use crate::state::State;

/// A route: where it is, and what can be asked there.
pub(crate) struct Route {
    pub(crate) path: &'static str,
    /// The methods; `GET` answers `HEAD` too.
    pub(crate) methods: &'static [&'static str],
    /// Whether it is open to those who have no token: it tells nothing.
    pub(crate) open: bool,
    handlers: fn() -> MethodRouter<Arc<State>>,
}

/// All routes.
pub(crate) const TABLE: [Route; 12] = [
    Route {
        path: "/v1/localize",
        methods: &["POST"],
        open: false,
        handlers: || on(MethodFilter::POST, localize::post),
    },
    Route {
        path: "/v1/session",
        methods: &["GET"],
        open: false,
        handlers: || on(MethodFilter::GET, session::get),
    },
    Route {
        path: "/v1/maps",
        methods: &["GET"],
        open: false,
        handlers: || on(MethodFilter::GET, maps::list),
    },
    Route {
        path: "/v1/maps/{name}",
        methods: &["GET", "PUT", "DELETE"],
        open: false,
        handlers: || on(MethodFilter::GET, maps::get).put(maps::put).delete(maps::delete),
    },
    Route {
        path: "/v1/maps/{name}/points",
        methods: &["GET"],
        open: false,
        handlers: || on(MethodFilter::GET, points::get),
    },
    Route {
        path: "/v1/events",
        methods: &["GET"],
        open: false,
        handlers: || on(MethodFilter::GET, events::get),
    },
    Route { path: "/", methods: &["GET"], open: true, handlers: || on(MethodFilter::GET, page::html) },
    Route {
        path: "/page.js",
        methods: &["GET"],
        open: true,
        handlers: || on(MethodFilter::GET, page::script),
    },
    Route {
        path: "/healthz",
        methods: &["GET"],
        open: true,
        handlers: || on(MethodFilter::GET, health::alive),
    },
    Route {
        path: "/readyz",
        methods: &["GET"],
        open: true,
        handlers: || on(MethodFilter::GET, health::ready),
    },
    Route {
        path: "/metrics",
        methods: &["GET"],
        open: false,
        handlers: || on(MethodFilter::GET, health::metrics),
    },
    Route {
        path: "/openapi.json",
        methods: &["GET"],
        open: true,
        handlers: || on(MethodFilter::GET, health::openapi),
    },
];

/// The route a request was matched to.
pub(crate) fn route(path: &str) -> Option<&'static Route> {
    TABLE.iter().find(|r| r.path == path)
}

/// All of it, the guards outside.
pub(crate) fn router(state: Arc<State>) -> Router {
    let mut router = Router::new();
    for route in &TABLE {
        router = router.route(route.path, (route.handlers)());
    }
    router
        .fallback(nowhere)
        .method_not_allowed_fallback(another_method)
        .layer(middleware::from_fn_with_state(Arc::clone(&state), guard::check))
        .layer(middleware::from_fn_with_state(Arc::clone(&state), log::log))
        .with_state(state)
}

async fn nowhere() -> Problem {
    Problem::new(StatusCode::NOT_FOUND, "there is nothing here", "GET /openapi.json tells what there is")
}

async fn another_method(method: Method, matched: Option<MatchedPath>) -> impl IntoResponse {
    let methods = matched.and_then(|m| route(m.as_str())).map_or(&[][..], |r| r.methods).join(", ");
    let what = format!("{method} cannot be asked here");
    let problem = Problem::new(StatusCode::METHOD_NOT_ALLOWED, what, format!("here can be asked: {methods}"));
    ([(header::ALLOW, methods)], problem)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use serde_json::Value;

    use super::*;

    /// The document tells of these routes, all of them, and of no others.
    #[test]
    fn the_document_tells_of_these_routes() {
        let document: Value = serde_json::from_str(health::OPENAPI).unwrap();
        let mut told = BTreeSet::new();
        for (path, item) in document["paths"].as_object().unwrap() {
            for (method, operation) in item.as_object().unwrap().iter().filter(|(m, _)| *m != "parameters") {
                assert!(operation["summary"].is_string(), "{method} {path} says what it is");
                assert!(operation["responses"].as_object().is_some_and(|r| !r.is_empty()), "{method} {path}");
                let open = operation["security"].as_array().is_some_and(Vec::is_empty);
                told.insert((path.clone(), method.to_uppercase(), open));
            }
        }
        let routes: BTreeSet<_> = TABLE
            .iter()
            .flat_map(|r| r.methods.iter().map(|m| (r.path.to_owned(), (*m).to_owned(), r.open)))
            .collect();
        assert_eq!(told, routes);
        assert_eq!(document["info"]["version"], env!("CARGO_PKG_VERSION"));
    }
}
