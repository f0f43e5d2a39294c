//! Who may ask: bearer token, and no web page of somebody else's in the operator's browser.

use std::net::IpAddr;
use std::sync::Arc;

use axum::extract::{MatchedPath, Request, State as Shared};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::routes;
use crate::options::is_loopback;
use crate::problem::Problem;
use crate::state::State;

pub(super) async fn check(Shared(state): Shared<Arc<State>>, request: Request, next: Next) -> Response {
    let open = request
        .extensions()
        .get::<MatchedPath>()
        .and_then(|path| routes::route(path.as_str()))
        .is_some_and(|route| route.open);
    match may_ask(&state, request.headers(), open) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

fn may_ask(state: &State, headers: &HeaderMap, open: bool) -> Result<(), Problem> {
    same_origin(headers)?;
    let options = &state.options;
    match &options.token {
        _ if open => Ok(()),
        Some(token) => {
            let given = headers.get(header::AUTHORIZATION).map(|v| v.as_bytes()).unwrap_or_default();
            let (scheme, given) = given.split_at_checked(7).unwrap_or_default();
            if scheme.eq_ignore_ascii_case(b"bearer ") && token.is(given.trim_ascii()) {
                return Ok(());
            }
            let hint = "send the header Authorization: Bearer TOKEN";
            Err(Problem::new(StatusCode::UNAUTHORIZED, "the token is missing or wrong", hint))
        }
        // Nothing but the address keeps others out, so a name that leads here by somebody else's DNS must not.
        None if is_loopback(options.listen.ip()) => local_host(headers),
        None => Ok(()),
    }
}

/// Browsers say which page asks; only the service's own may.
fn same_origin(headers: &HeaderMap) -> Result<(), Problem> {
    let Some(origin) = headers.get(header::ORIGIN) else { return Ok(()) };
    let origin = origin.to_str().unwrap_or_default();
    let page = origin.split_once("://").map(|(_, authority)| authority);
    let host = headers.get(header::HOST).and_then(|h| h.to_str().ok());
    match page.is_some() && page == host {
        true => Ok(()),
        false => Err(Problem::new(
            StatusCode::FORBIDDEN,
            "this was asked by a web page from elsewhere",
            "open the service's own page, or ask from a program",
        )),
    }
}

fn local_host(headers: &HeaderMap) -> Result<(), Problem> {
    let Some(host) = headers.get(header::HOST) else { return Ok(()) };
    let host = host.to_str().unwrap_or_default();
    let name = match host.strip_prefix('[') {
        Some(v6) => v6.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    match name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok() {
        true => Ok(()),
        false => Err(Problem::new(
            StatusCode::FORBIDDEN,
            format!("the host '{}' is not this machine", host.escape_debug()),
            "ask http://127.0.0.1 or http://localhost, or start with --token-file",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(header::HeaderName, &str)]) -> HeaderMap {
        pairs.iter().map(|(n, v)| (n.clone(), v.parse().unwrap())).collect()
    }

    #[test]
    fn only_pages_of_the_service_itself_may_ask() {
        same_origin(&headers(&[(header::HOST, "127.0.0.1:8080")])).unwrap();
        let own = [(header::HOST, "127.0.0.1:8080"), (header::ORIGIN, "http://127.0.0.1:8080")];
        same_origin(&headers(&own)).unwrap();
        for origin in ["https://evil.example", "null", "", "http://127.0.0.1:8081"] {
            let other = [(header::HOST, "127.0.0.1:8080"), (header::ORIGIN, origin)];
            assert_eq!(same_origin(&headers(&other)).unwrap_err().status, 403, "{origin}");
        }
    }

    #[test]
    fn names_of_other_machines_do_not_lead_here() {
        for host in ["localhost:8080", "LOCALHOST", "127.0.0.1", "[::1]:80"] {
            local_host(&headers(&[(header::HOST, host)])).unwrap();
        }
        for host in ["evil.example", "localhost.evil.example:8080", "", "[", ":80"] {
            assert!(local_host(&headers(&[(header::HOST, host)])).is_err(), "{host}");
        }
    }
}
