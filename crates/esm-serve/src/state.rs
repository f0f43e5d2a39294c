//! [`State`]: what all requests share, and how a cloud gets its answer.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use axum::http::StatusCode;
use esm_core::{LiveCloud, Localization, Verdict};
use esm_io::LocalizationLine;
use serde::Serialize;
use tokio::sync::{Semaphore, broadcast, watch};

use crate::body::Budget;
use crate::error::Error;
use crate::http::routes;
use crate::maps::{LoadedMap, Maps};
use crate::metrics::Metrics;
use crate::options::Options;
use crate::pool::{Done, Panicked, Pool};
use crate::problem::Problem;

/// Events kept for a watcher that is slow; older ones it misses.
const EVENTS: usize = 32;
/// Most who watch at a time.
pub(crate) const MAX_WATCHERS: usize = 16;
/// Most points of a cloud that watchers are shown.
const SKETCH: usize = 2000;

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
    /// What is found, for those who watch.
    pub(crate) events: broadcast::Sender<Arc<str>>,
    pub(crate) watchers: Arc<Semaphore>,
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
            events: broadcast::channel(EVENTS).0,
            watchers: Arc::new(Semaphore::new(MAX_WATCHERS)),
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

    /// Whether anybody watches.
    pub(crate) fn is_watched(&self) -> bool {
        self.events.receiver_count() > 0
    }

    /// Counts an answer, and tells those who watch; `session` is the number of the session's request, or empty.
    pub(crate) fn take_note(&self, answer: &Answer, waited: Duration, session: &str) {
        self.metrics.localized(&answer.result, waited);
        let Some(cloud_cm) = &answer.sketch else { return };
        let matches = answer.result.matches.iter().map(|m| m.map_centroid_map).collect();
        let event =
            Event { map: &answer.map.name, session, result: (&answer.result).into(), matches, cloud_cm };
        if let Ok(text) = serde_json::to_string(&event) {
            // All of them may have gone meanwhile.
            let _ = self.events.send(text.into());
        }
    }
}

/// What those who watch are told of an answer.
#[derive(Serialize)]
struct Event<'a> {
    map: &'a str,
    session: &'a str,
    #[serde(flatten)]
    result: LocalizationLine<'a>,
    /// Centroids of the matched map segments, map frame, metres.
    matches: Vec<[f64; 3]>,
    /// Some of the cloud's points, sensor frame, centimetres.
    cloud_cm: &'a [[i32; 3]],
}

/// The answer for one cloud.
pub(crate) struct Answer {
    /// The map it is about.
    pub(crate) map: Arc<LoadedMap>,
    pub(crate) result: Localization,
    /// Whether there were several maps to choose from.
    pub(crate) searched: bool,
    /// Some of the cloud's points, centimetres, where somebody watches.
    pub(crate) sketch: Option<Vec<[i32; 3]>>,
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

/// Finds a cloud in each of the maps by `localize` and keeps the best answer: the better verdict, then the higher score,
/// then the name that comes first. Not for threads that talk.
pub(crate) fn find(
    live: &LiveCloud,
    maps: &[Arc<LoadedMap>],
    watched: bool,
    mut localize: impl FnMut(&Arc<LoadedMap>) -> Result<Localization, esm_core::Error>,
) -> Result<Answer, Problem> {
    let rank = |a: &Answer| match a.result.verdict {
        Verdict::Located => 2,
        Verdict::Ambiguous => 1,
        Verdict::NotFound => 0,
    };
    let mut best: Option<Answer> = None;
    for map in maps {
        let result = localize(map).map_err(|e| Problem::of(StatusCode::INTERNAL_SERVER_ERROR, &e))?;
        let answer = Answer { map: Arc::clone(map), result, searched: maps.len() > 1, sketch: None };
        let better = best.as_ref().is_none_or(|b| {
            let scores = answer.result.score.total_cmp(&b.result.score);
            rank(&answer).cmp(&rank(b)).then(scores).is_gt()
        });
        if better {
            best = Some(answer);
        }
    }
    let mut best = best.ok_or_else(|| internal("no map was given"))?;
    best.sketch = watched.then(|| {
        let points = live.cloud.points();
        let step = points.len().div_ceil(SKETCH).max(1);
        points.iter().step_by(step).map(|p| p.map(|v| (v * 100.0).round() as i32)).collect()
    });
    Ok(best)
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
