//! `GET /v1/maps/NAME/points`: a map's points, thinned, to be drawn.

use std::sync::Arc;

use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State as Shared};
use axum::http::{HeaderName, StatusCode, header};
use axum::response::IntoResponse;
use esm_core::Map;
use serde::Deserialize;
use serde_json::json;

use super::localize::bad_query;
use super::maps::{Named, named};
use crate::problem::Problem;
use crate::state::{State, worked};

/// Tells where the coordinates are counted from, metres in the map frame.
const ORIGIN_HEADER: HeaderName = HeaderName::from_static("x-esm-origin");

/// Points where nothing else is asked for.
const POINTS: usize = 300_000;
/// Most points that are sent.
const MAX_POINTS: usize = 3_000_000;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Asked {
    /// Most points to send.
    max: Option<usize>,
}

pub(super) async fn get(
    Shared(state): Shared<Arc<State>>,
    name: Named,
    asked: Result<Query<Asked>, QueryRejection>,
) -> Result<impl IntoResponse, Problem> {
    let Query(Asked { max }) = asked.map_err(|e| bad_query(&e, "?max=300000"))?;
    let most = max.unwrap_or(POINTS).clamp(1, MAX_POINTS);
    let maps = state.maps.pick(Some(&named(name)?))?;
    let map = maps.first().map(|m| Arc::clone(&m.map)).ok_or_else(|| crate::state::internal("no map"))?;
    let Some(place) = state.pool.try_enter() else {
        return Err(Problem::busy("there is too much to do", "try again in a moment"));
    };
    let origin = json!(map.origin()).to_string();
    let work = place
        .run(move || thinned(&map, most).map_err(|e| Problem::of(StatusCode::INTERNAL_SERVER_ERROR, &e)));
    let (bytes, _) = worked(work.await)?;
    Ok(([(header::CONTENT_TYPE, "application/octet-stream".to_owned()), (ORIGIN_HEADER, origin)], bytes))
}

/// x, y, z and what it is (0: ground, n: the n-th segment) of every n-th point, as little-endian f32.
fn thinned(map: &Map, most: usize) -> Result<Vec<u8>, esm_core::Error> {
    let ground = map.ground_tiles().len();
    let count = |runs: &[esm_core::map::PointRun]| runs.iter().map(|r| r.len as usize).sum::<usize>();
    let all = count(map.ground_tiles()) + count(map.runs());
    let step = all.div_ceil(most).max(1);
    let mut bytes = Vec::with_capacity(16 * (all / step + 1));
    let (mut points, mut left) = (Vec::new(), 0);
    for i in 0..ground + map.len() {
        let kind = match i.checked_sub(ground) {
            None => {
                map.ground_tile_points_into(i, &mut points)?;
                0.0
            }
            Some(segment) => {
                map.segment_points_into(segment, &mut points)?;
                (segment + 1) as f32
            }
        };
        for [x, y, z] in points.iter().skip(left).step_by(step) {
            [*x, *y, *z, kind].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        }
        // The next run goes on counting where this one ended.
        let rest = points.len().saturating_sub(left) % step;
        left = match points.len() < left {
            true => left - points.len(),
            false if rest == 0 => 0,
            false => step - rest,
        };
    }
    Ok(bytes)
}
