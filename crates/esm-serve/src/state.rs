//! [`State`]: what all requests share, and how a cloud gets its answer.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use axum::http::StatusCode;
use esm_core::{LiveCloud, Localization, Verdict};
use esm_io::LocalizationLine;
use serde::Serialize;
use tokio::sync::{Semaphore, watch};

use crate::body::Budget;
use crate::error::Error;
use crate::http::routes;
use crate::maps::{LoadedMap, Maps};
use crate::metrics::Metrics;
use crate::options::Options;
use crate::pool::{Done, Panicked, Pool};
use crate::problem::Problem;

/// Shared by all requests.
pub(crate) struct State {
    pub(crate) options: Options,
    pub(crate) maps: Maps,
    pub(crate) metrics: Metrics,
    pub(crate) pool: Pool,
    pub(crate) budget: Budget,
    /// One map is loaded at a time.
    pub(crate) loading: Arc<Semaphore>,
    pub(crate) sessions: Arc<Semaphore>,
    /// True once the service was told to stop.
    pub(crate) stopping: watch::Sender<bool>,
}

impl State {
    pub(crate) fn new(options: Options, maps: &[(String, PathBuf)]) -> Result<Arc<Self>, Error> {
        options.check()?;
        let state = Self {
            maps: Maps::load(&options, maps)?,
            metrics: Metrics::new(routes::TABLE.iter().map(|r| r.path)),
            pool: Pool::new(options.workers, options.queue),
            budget: Budget::new(options.max_held_bytes),
            loading: Arc::new(Semaphore::new(1)),
            sessions: Arc::new(Semaphore::new(options.max_sessions)),
            stopping: watch::channel(false).0,
            options,
        };
        state.metrics.maps(&state.maps.all());
        Ok(Arc::new(state))
    }

    /// Whether requests can be answered.
    pub(crate) fn is_ready(&self) -> bool {
        !*self.stopping.borrow() && !self.maps.all().is_empty()
    }

    /// Waits until the service is told to stop.
    pub(crate) async fn stopped(&self) {
        // The sender lives as long as the state.
        let _ = self.stopping.subscribe().wait_for(|stop| *stop).await;
    }

    /// Counts an answer.
    pub(crate) fn take_note(&self, answer: &Answer, waited: Duration) {
        self.metrics.localized(&answer.result, waited);
    }
}

/// The answer for one cloud.
pub(crate) struct Answer {
    /// The map it is about.
    pub(crate) map: Arc<LoadedMap>,
    pub(crate) result: Localization,
    /// Whether there were several maps to choose from.
    pub(crate) searched: bool,
}

/// The contract's object, with the map's name where it was searched for.
#[derive(Serialize)]
struct AnswerLine<'a, More: Serialize> {
    #[serde(flatten)]
    result: LocalizationLine<'a>,
    #[serde(skip_serializing_if = "Option::is_none")]
    map: Option<&'a str>,
    #[serde(flatten)]
    more: More,
}

/// Nothing more to say.
#[derive(Serialize)]
pub(crate) struct Nothing {}

impl Answer {
    /// The line of the contract, exactly as `localize --json` prints it where the map is given; with keys of `more` after.
    pub(crate) fn line(&self, more: impl Serialize) -> Result<String, Problem> {
        let map = self.searched.then_some(self.map.name.as_str());
        let line = AnswerLine { result: (&self.result).into(), map, more };
        serde_json::to_string(&line).map_err(|e| internal(&e.to_string()))
    }
}

/// Finds a cloud in each of the maps and keeps the best answer: the better verdict, then the higher score, then the
/// name that comes first. Not for threads that talk.
pub(crate) fn find(live: &LiveCloud, maps: &[Arc<LoadedMap>]) -> Result<Answer, Problem> {
    let rank = |a: &Answer| match a.result.verdict {
        Verdict::Located => 2,
        Verdict::Ambiguous => 1,
        Verdict::NotFound => 0,
    };
    let mut best: Option<Answer> = None;
    for map in maps {
        let result =
            map.localizer.localize(live).map_err(|e| Problem::of(StatusCode::INTERNAL_SERVER_ERROR, &e))?;
        let answer = Answer { map: Arc::clone(map), result, searched: maps.len() > 1 };
        let better = best.as_ref().is_none_or(|b| {
            let scores = answer.result.score.total_cmp(&b.result.score);
            rank(&answer).cmp(&rank(b)).then(scores).is_gt()
        });
        if better {
            best = Some(answer);
        }
    }
    best.ok_or_else(|| internal("no map was given"))
}

/// Unwraps work of the pool.
pub(crate) fn worked<T>(done: Result<Done<Result<T, Problem>>, Panicked>) -> Result<(T, Duration), Problem> {
    match done {
        Ok(Done { value, waited }) => Ok((value?, waited)),
        Err(Panicked) => Err(internal("the work on this cloud ended in a panic")),
    }
}

/// An error of the program itself.
pub(crate) fn internal(what: &str) -> Problem {
    tracing::error!("{what}");
    Problem::new(StatusCode::INTERNAL_SERVER_ERROR, what, "this is an error of the program: please report it")
}
