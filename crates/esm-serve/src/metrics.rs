//! [`Metrics`]: what a fleet manager scrapes. Every series exists from the start, at zero.

use std::sync::atomic::AtomicU64;
use std::time::Duration;

use esm_core::{Localization, Timings, Verdict};
use prometheus_client::encoding::text::encode;
use prometheus_client::encoding::{EncodeLabelSet, LabelSetEncoder};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::Registry;

use crate::maps::LoadedMap;

/// One label.
type Label = [(&'static str, String); 1];
type Seconds = Family<Label, Histogram, fn() -> Histogram>;

/// Upper bounds of the buckets, seconds: from a stage of a small cloud to a request that times out.
const BUCKETS_S: [f64; 14] =
    [0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 30.0];

fn seconds() -> Histogram {
    Histogram::new(BUCKETS_S)
}

/// A route and how requests to it ended.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Ended {
    route: &'static str,
    status: &'static str,
}

impl EncodeLabelSet for Ended {
    fn encode(&self, encoder: &mut LabelSetEncoder<'_>) -> Result<(), std::fmt::Error> {
        [("route", self.route), ("status", self.status)].encode(encoder)
    }
}

/// Classes of status codes.
const CLASSES: [&str; 5] = ["1xx", "2xx", "3xx", "4xx", "5xx"];

/// All series.
pub(crate) struct Metrics {
    registry: Registry,
    stages: Seconds,
    queue_wait: Histogram,
    verdicts: Family<Label, Counter>,
    requests: Family<Ended, Counter>,
    request_seconds: Histogram,
    pub(crate) queue_depth: Gauge,
    pub(crate) connections: Gauge,
    pub(crate) connections_refused: Counter,
    pub(crate) sessions: Gauge,
    session_clouds: Family<Label, Counter>,
    map_loads: Family<Label, Counter>,
    maps: Gauge,
    map_segments: Family<Label, Gauge>,
    map_points: Family<Label, Gauge>,
    map_bytes: Family<Label, Gauge>,
    map_path: Family<Label, Gauge<f64, AtomicU64>>,
}

impl Metrics {
    /// All series, of these routes too.
    pub(crate) fn new(routes: impl IntoIterator<Item = &'static str>) -> Self {
        let mut registry = Registry::with_prefix("esm");
        let new_seconds: fn() -> Histogram = seconds;
        let m = Self {
            stages: Seconds::new_with_constructor(new_seconds),
            queue_wait: seconds(),
            verdicts: Family::default(),
            requests: Family::default(),
            request_seconds: seconds(),
            queue_depth: Gauge::default(),
            connections: Gauge::default(),
            connections_refused: Counter::default(),
            sessions: Gauge::default(),
            session_clouds: Family::default(),
            map_loads: Family::default(),
            maps: Gauge::default(),
            map_segments: Family::default(),
            map_points: Family::default(),
            map_bytes: Family::default(),
            map_path: Family::default(),
            registry: Registry::default(),
        };
        registry.register(
            "stage_seconds",
            "Time of one cloud in each stage, and in all (total)",
            m.stages.clone(),
        );
        registry.register("queue_wait_seconds", "Time clouds waited for a worker", m.queue_wait.clone());
        registry.register("verdicts", "Clouds by what was said about them", m.verdicts.clone());
        registry.register("http_requests", "Requests by route and class of status", m.requests.clone());
        registry.register("http_request_seconds", "Time of whole requests", m.request_seconds.clone());
        registry.register("queue_depth", "Clouds that wait for a worker now", m.queue_depth.clone());
        registry.register("connections", "Open connections", m.connections.clone());
        registry.register(
            "connections_refused",
            "Connections closed at once: there were too many",
            m.connections_refused.clone(),
        );
        registry.register("sessions", "Open streaming sessions", m.sessions.clone());
        registry.register(
            "session_clouds",
            "Clouds of sessions: answered or dropped",
            m.session_clouds.clone(),
        );
        registry.register("map_loads", "Maps asked to be loaded: loaded or refused", m.map_loads.clone());
        registry.register("maps", "Maps in service", m.maps.clone());
        registry.register("map_segments", "Segments of each map", m.map_segments.clone());
        registry.register("map_points", "Points of each map", m.map_points.clone());
        registry.register("map_bytes", "Size of each map in memory, bytes", m.map_bytes.clone());
        registry.register("map_path_meters", "Length of each map's path", m.map_path.clone());
        let build = Family::<Label, Gauge>::default();
        build.get_or_create(&label("version", env!("CARGO_PKG_VERSION"))).set(1);
        registry.register("build_info", "1, with the version of the program", build);
        for stage in Timings::default().stages().map(|s| s.0).into_iter().chain(["total"]) {
            drop(m.stages.get_or_create(&label("stage", stage)));
        }
        for verdict in [Verdict::Located, Verdict::Ambiguous, Verdict::NotFound] {
            drop(m.verdicts.get_or_create(&label("verdict", verdict.as_str())));
        }
        for (family, values) in
            [(&m.session_clouds, ["answered", "dropped"]), (&m.map_loads, ["loaded", "refused"])]
        {
            values.into_iter().for_each(|v| drop(family.get_or_create(&label("outcome", v))));
        }
        for route in routes.into_iter().chain([OTHER_ROUTE]) {
            CLASSES.into_iter().for_each(|status| drop(m.requests.get_or_create(&Ended { route, status })));
        }
        Self { registry, ..m }
    }

    /// Takes in one answer.
    pub(crate) fn localized(&self, result: &Localization, waited: Duration) {
        for (stage, time) in result.timings.stages().into_iter().chain([("total", result.timings.total())]) {
            self.stages.get_or_create(&label("stage", stage)).observe(time.as_secs_f64());
        }
        self.queue_wait.observe(waited.as_secs_f64());
        self.verdicts.get_or_create(&label("verdict", result.verdict.as_str())).inc();
    }

    /// Takes in one request; a route that does not exist is `None`.
    pub(crate) fn requested(&self, route: Option<&'static str>, status: u16, took: Duration) {
        let status = CLASSES[usize::from((status / 100).clamp(1, 5)) - 1];
        self.requests.get_or_create(&Ended { route: route.unwrap_or(OTHER_ROUTE), status }).inc();
        self.request_seconds.observe(took.as_secs_f64());
    }

    /// Takes in what became of a session's clouds.
    pub(crate) fn session_cloud(&self, outcome: &'static str, n: u64) {
        self.session_clouds.get_or_create(&label("outcome", outcome)).inc_by(n);
    }

    /// Takes in whether a map could be loaded.
    pub(crate) fn map_load(&self, loaded: bool) {
        let outcome = if loaded { "loaded" } else { "refused" };
        self.map_loads.get_or_create(&label("outcome", outcome)).inc();
    }

    /// Tells of the maps that are now in service, and of no others.
    pub(crate) fn maps(&self, maps: &[std::sync::Arc<LoadedMap>]) {
        self.maps.set(maps.len() as i64);
        self.map_segments.clear();
        self.map_points.clear();
        self.map_bytes.clear();
        self.map_path.clear();
        for map in maps {
            let of = label("map", &map.name);
            self.map_segments.get_or_create(&of).set(map.map.len() as i64);
            self.map_points.get_or_create(&of).set(map.map.point_count() as i64);
            self.map_bytes.get_or_create(&of).set(map.map.file_size() as i64);
            self.map_path.get_or_create(&of).set(map.map.path_length_m());
        }
    }

    /// All series as text (OpenMetrics, which Prometheus reads).
    pub(crate) fn text(&self) -> String {
        let mut text = String::new();
        // Writing into a string cannot fail.
        let _ = encode(&mut text, &self.registry);
        text
    }
}

/// What requests to no route are counted under.
const OTHER_ROUTE: &str = "other";

fn label(name: &'static str, value: &str) -> Label {
    [(name, value.to_owned())]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_series_is_there_from_the_start() {
        let text = Metrics::new(["/v1/localize"]).text();
        for line in [
            "esm_stage_seconds_count{stage=\"verification\"} 0",
            "esm_stage_seconds_count{stage=\"total\"} 0",
            "esm_queue_wait_seconds_count 0",
            "esm_verdicts_total{verdict=\"located\"} 0",
            "esm_verdicts_total{verdict=\"ambiguous\"} 0",
            "esm_verdicts_total{verdict=\"not_found\"} 0",
            "esm_http_requests_total{route=\"/v1/localize\",status=\"5xx\"} 0",
            "esm_http_requests_total{route=\"other\",status=\"4xx\"} 0",
            "esm_queue_depth 0",
            "esm_session_clouds_total{outcome=\"dropped\"} 0",
            "esm_map_loads_total{outcome=\"refused\"} 0",
            "esm_maps 0",
        ] {
            assert!(text.lines().any(|l| l == line), "{line} is missing in\n{text}");
        }
        assert!(text.ends_with("# EOF\n"));
    }

    #[test]
    fn requests_are_counted_by_route_and_class() {
        let metrics = Metrics::new(["/a"]);
        metrics.requested(Some("/a"), 204, Duration::from_millis(3));
        metrics.requested(None, 404, Duration::ZERO);
        let text = metrics.text();
        assert!(text.contains("esm_http_requests_total{route=\"/a\",status=\"2xx\"} 1\n"), "{text}");
        assert!(text.contains("esm_http_requests_total{route=\"other\",status=\"4xx\"} 1\n"), "{text}");
        assert!(text.contains("esm_http_request_seconds_count 2\n"), "{text}");
    }
}
