//! [`Problem`]: why a request was refused, as `application/problem+json` (RFC 9457).

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

/// A refused request: the status, what is wrong, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The HTTP status.
    pub status: StatusCode,
    /// What is wrong, in one sentence.
    pub detail: String,
    /// What to do about it.
    pub hint: String,
    /// After how many seconds to try again, where that helps.
    pub retry_after_s: Option<u32>,
}

impl Problem {
    /// A problem with what to do about it.
    pub fn new(status: StatusCode, detail: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { status, detail: detail.into(), hint: hint.into(), retry_after_s: None }
    }

    /// One that passes by itself: 503 with `Retry-After`.
    pub fn busy(detail: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { retry_after_s: Some(1), ..Self::new(StatusCode::SERVICE_UNAVAILABLE, detail, hint) }
    }

    /// An error of the core or the readers, whose text ends in a `hint:` line.
    pub fn of(status: StatusCode, error: &dyn std::error::Error) -> Self {
        let text = error.to_string();
        let (detail, hint) = text.split_once("\nhint: ").unwrap_or((&text, "look at the service's log"));
        Self::new(status, detail, hint)
    }

    /// The object that is sent.
    pub fn json(&self) -> Value {
        json!({
            "type": "about:blank",
            "title": self.status.canonical_reason().unwrap_or("error"),
            "status": self.status.as_u16(),
            "detail": self.detail,
            "hint": self.hint,
        })
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let mut response = (self.status, self.json().to_string()).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        if let Some(seconds) = self.retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        if self.status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        response
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_told_with_its_hint() {
        let error = esm_core::Error::NonFinitePoint { index: 3 };
        let problem = Problem::of(StatusCode::BAD_REQUEST, &error);
        assert_eq!(problem.detail, "point 3 is not finite");
        assert!(problem.hint.starts_with("drop invalid returns first"), "{}", problem.hint);
        let response = problem.into_response();
        assert_eq!(response.status(), 400);
        assert_eq!(response.headers()[header::CONTENT_TYPE], "application/problem+json");
    }

    #[test]
    fn what_passes_says_when_to_come_again() {
        assert_eq!(Problem::busy("full", "wait").into_response().headers()[header::RETRY_AFTER], "1");
    }
}
