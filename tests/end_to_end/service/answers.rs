//! What is answered, and that it is what `localize` says.

use esm_tests::recording::{point_cloud, write_pcd};
use serde_json::{Value, json};

use super::client::Request;
use super::{OTHER_MAP, Service, floats, timeless, told, told_by_localize};
use crate::common::{TOWN, esm, folder, run};

#[test]
fn the_same_cloud_in_four_bodies_gets_the_answer_of_localize() {
    let service = Service::town();
    let want = told_by_localize(&TOWN.path("map.esm"));
    let dir = folder();
    for i in [0, 20, 45] {
        let sweep = &TOWN.live_drive[i];
        let points = sweep.cloud.points();
        let pcd = dir.path().join(format!("{i}.pcd"));
        write_pcd(&pcd, points).unwrap();
        let json = json!({"stamp": sweep.stamp, "points": points}).to_string();
        let stamped = format!("/v1/localize?map=town&stamp={}", sweep.stamp);
        let requests = [
            Request::post(&stamped, "application/octet-stream", floats(points)),
            Request::post("/v1/localize", "application/x-ros2-cdr", point_cloud(sweep.stamp, points)),
            Request::post(&stamped, "application/x-pcd", std::fs::read(&pcd).unwrap()),
            Request::post("/v1/localize?map=town", "application/json; charset=utf-8", json),
        ];
        for request in requests {
            let reply = service.send(&request).good();
            assert_eq!(reply.header("content-type"), Some("application/json"));
            assert_eq!(reply.header("x-esm-map"), Some("town"));
            let keys: Vec<String> = reply.json().as_object().unwrap().keys().cloned().collect();
            assert_eq!(timeless(reply.json()), want[i], "sweep {i}, {:?}", request.headers);
            // In the contract's order too.
            assert_eq!(keys.first().map(String::as_str), Some("stamp"));
            assert_eq!(keys.last().map(String::as_str), Some("timings_ms"));
        }
    }
    assert!(want.iter().filter(|w| w["verdict"] == "located").count() > 50, "the comparison is about poses");
}

#[test]
fn a_replayed_recording_gets_the_answers_of_localize() {
    let service = Service::town();
    for accumulate in ["0", "20"] {
        let want = told(&TOWN.path("map.esm"), &["--accumulate", accumulate]);
        let live = TOWN.path("live.mcap");
        let flags = ["--to", &service.url, "--speed", "0", "--json", "--accumulate", accumulate];
        let mut got = run(["replay".into(), live.into_os_string()].into_iter().chain(flags.map(Into::into)))
            .ended(0)
            .json();
        let summary = got.pop().unwrap();
        let n = want.len();
        assert_eq!(summary["summary"]["clouds"], n);
        assert_eq!(summary["summary"]["dropped"], 0);
        for (i, (got, want)) in got.into_iter().zip(&want).enumerate() {
            let mut got = timeless(got);
            assert_eq!(got.as_object_mut().unwrap().remove("dropped"), Some(json!(0)));
            assert_eq!(got, *want, "sweep {i}, {accumulate} m");
        }
    }
    let metrics = service.send(&Request::get("/metrics")).good().text();
    let answered = format!("esm_session_clouds_total{{outcome=\"answered\"}} {}", 2 * TOWN.live_drive.len());
    assert!(metrics.contains(&answered), "{metrics}");
}

#[test]
fn the_newest_cloud_wins_where_the_robot_is_faster() {
    let service = Service::start([
        "--workers".into(),
        "1".into(),
        "--map".into(),
        TOWN.path("map.esm").display().to_string(),
    ]);
    let live = TOWN.path("live.mcap");
    let ran = esm!["replay", live, "--to", service.url, "--speed", "1000", "--json"].ended(0).json();
    let (last, answers) = ran.split_last().unwrap();
    let of = |key: &str| last["summary"][key].as_u64().unwrap();
    assert_eq!(of("clouds"), TOWN.live_drive.len() as u64);
    assert_eq!(of("answered") + of("dropped"), of("clouds"));
    assert!(of("dropped") > 0 && of("answered") > 1, "{last}");
    // The last sweep is the newest there is: it has its answer, and all the clouds before it are told of.
    assert_eq!(answers.last().unwrap()["stamp"], TOWN.live_drive.last().unwrap().stamp);
    assert_eq!(answers.last().unwrap()["dropped"], last["summary"]["dropped"]);
    let metrics = service.send(&Request::get("/metrics")).good().text();
    assert!(metrics.contains(&format!("{{outcome=\"dropped\"}} {}\n", of("dropped"))), "{metrics}");
}

#[test]
fn of_several_maps_the_named_one_is_searched_or_the_best_found() {
    let dir = folder();
    let far = dir.path().join("far.esm");
    esm!["map", "build", TOWN.path("map.mcap"), "--frames", "1-30", "-o", far].ended(0);
    let flag =
        |name: &str, path: &std::path::Path| ["--map".to_owned(), format!("{name}={}", path.display())];
    let maps = [flag("far", &far), flag("town", &TOWN.path("map.esm"))].concat();
    let service = Service::start(maps);
    let want = told_by_localize(&TOWN.path("map.esm"));
    // A place that the first 60 m of the map drive do not hold.
    let i = 65;
    let sweep = &TOWN.live_drive[i];
    let body = point_cloud(sweep.stamp, sweep.cloud.points());
    let ask = |query: &str| {
        service
            .send(&Request::post(format!("/v1/localize{query}"), "application/x-ros2-cdr", body.clone()))
            .good()
    };
    assert_eq!(ask("?map=far").json()["verdict"], "not_found");
    let named = timeless(ask("?map=town").json());
    assert_eq!(named, want[i]);
    let searched = ask("");
    assert_eq!(searched.header("x-esm-map"), Some("town"));
    let mut searched = timeless(searched.json());
    assert_eq!(searched.as_object_mut().unwrap().remove("map"), Some(json!("town")));
    assert_eq!(searched, want[i]);
}

#[test]
fn maps_are_listed_loaded_swapped_and_removed() {
    let service = Service::town();
    let other = &*OTHER_MAP;
    let listed = service.send(&Request::get("/v1/maps")).good().json();
    let info = &esm!["map", "info", "--json", TOWN.path("map.esm")].ended(0).json()[0];
    let town = &listed["maps"][0];
    assert_eq!(listed["maps"].as_array().unwrap().len(), 1);
    for (key, told) in [
        ("segments", &info["segments"]),
        ("points", &info["points"]),
        ("bytes", &info["bytes"]),
        ("descriptor", &info["descriptor"]),
        ("path_length_m", &info["path"]["length_m"]),
        ("bounds", &info["bounds"]),
        ("name", &json!("town")),
    ] {
        assert_eq!(town[key], *told, "{key}");
    }
    // Another folder than that of the maps given at the start is nobody's business.
    service.send(&Request::put_map("other", other)).refused(403);
    let inside = TOWN.path("other.esm");
    std::fs::copy(other, &inside).unwrap();
    let loaded = service.send(&Request::put_map("other", &inside)).good().json();
    assert_eq!(loaded["name"], "other");
    assert_ne!(loaded["segments"], town["segments"]);
    assert_eq!(service.send(&Request::get("/v1/maps/other")).good().json(), loaded);
    let metrics = service.send(&Request::get("/metrics")).good().text();
    assert!(
        metrics.contains(&format!("esm_map_segments{{map=\"other\"}} {}\n", loaded["segments"])),
        "{metrics}"
    );
    assert!(metrics.contains("esm_map_loads_total{outcome=\"loaded\"} 1\n"), "{metrics}");
    // In the place of the town's: the name stays, the map is the other.
    let swapped = service.send(&Request::put_map("town", &inside)).good().json();
    assert_eq!(swapped["segments"], loaded["segments"]);
    for name in ["other", "town"] {
        assert_eq!(service.send(&Request::new("DELETE", format!("/v1/maps/{name}"))).good().status, 204);
    }
    service.send(&Request::get("/readyz")).refused(503);
    service.send(&Request::get("/healthz")).good();
    let cloud = floats(TOWN.live_drive[0].cloud.points());
    service.send(&Request::post("/v1/localize", "application/octet-stream", cloud)).refused(503);
    service.send(&Request::put_map("town", &inside)).good();
    service.send(&Request::get("/readyz")).good();
}

#[test]
fn watchers_are_served_and_requests_have_numbers() {
    let service = Service::start([
        "--log".into(),
        "json".into(),
        "--map".into(),
        format!("town={}", TOWN.path("map.esm").display()),
    ]);
    assert_eq!(service.send(&Request::get("/healthz")).good().text(), "ok\n");
    let document = service.send(&Request::get("/openapi.json")).good().json();
    assert_eq!(document["openapi"], "3.1.0");
    let metrics = service.send(&Request::get("/metrics")).good().text();
    for series in [
        "esm_verdicts_total{verdict=\"located\"} 0",
        "esm_stage_seconds_count{stage=\"pose\"} 0",
        "esm_queue_depth 0",
        "esm_sessions 0",
        "esm_maps 1",
    ] {
        assert!(metrics.lines().any(|l| l == series), "{series} is missing in\n{metrics}");
    }
    let cloud = floats(TOWN.live_drive[20].cloud.points());
    let request = Request::post("/v1/localize", "application/octet-stream", cloud);
    let own = service.send(&request.clone().header("x-request-id", "robot-7/42")).good();
    assert_eq!(own.header("x-request-id"), Some("robot-7/42"));
    let verdict = own.json()["verdict"].as_str().unwrap().to_owned();
    let made = service.send(&request).good().header("x-request-id").unwrap().to_owned();
    assert!(made.len() > 8, "{made}");
    let metrics = service.send(&Request::get("/metrics")).good().text();
    assert!(metrics.contains(&format!("esm_verdicts_total{{verdict=\"{verdict}\"}} 2\n")), "{metrics}");
    assert!(metrics.contains("esm_stage_seconds_count{stage=\"pose\"} 2\n"), "{metrics}");
    assert!(metrics.contains("{route=\"/v1/localize\",status=\"2xx\"} 2\n"), "{metrics}");
    // Every line of the log is an object; those of the two requests carry their numbers.
    let log = service.log();
    let lines: Vec<Value> =
        log.lines().map(|l| serde_json::from_str(l).unwrap_or_else(|e| panic!("{e}: {l}"))).collect();
    for id in ["robot-7/42", &made] {
        let line = lines.iter().find(|l| l["request_id"] == id).unwrap_or_else(|| panic!("{id} in\n{log}"));
        assert_eq!((&line["path"], &line["status"]), (&json!("/v1/localize"), &json!(200)));
        assert!(line["timestamp"].is_string() && line["ms"].as_f64().is_some_and(|ms| ms > 0.0), "{line}");
    }
}

/// What the page is made of: itself, the map's points, and every answer as it is given.
#[test]
fn those_who_watch_see_the_map_and_every_answer() {
    use std::io::{BufRead, BufReader, Write};
    let service = Service::town();
    let page = service.send(&Request::get("/")).good();
    assert!(page.header("content-type").unwrap().starts_with("text/html"));
    let policy = page.header("content-security-policy").unwrap();
    assert!(policy.contains("default-src 'none'") && policy.contains("script-src 'self'"), "{policy}");
    let script = service.send(&Request::get("/page.js")).good().text();
    for text in [page.text(), script] {
        assert!(!text.contains("://"), "everything is embedded");
    }
    let points = service.send(&Request::get("/v1/maps/town/points?max=5000")).good();
    let origin: [f64; 3] = serde_json::from_str(points.header("x-esm-origin").unwrap()).unwrap();
    let rows: Vec<[f32; 4]> = points
        .body
        .chunks_exact(16)
        .map(|row| [0, 4, 8, 12].map(|i| f32::from_le_bytes(row[i..i + 4].try_into().unwrap())))
        .collect();
    assert!((4000..=5000).contains(&rows.len()) && points.body.len() == 16 * rows.len(), "{}", rows.len());
    let bounds = &service.send(&Request::get("/v1/maps/town")).good().json()["bounds"];
    for axis in 0..3 {
        let [min, max] = ["min", "max"].map(|k| bounds[k][axis].as_f64().unwrap());
        let inside =
            |row: &[f32; 4]| (min - 0.01..max + 0.01).contains(&(origin[axis] + f64::from(row[axis])));
        assert!(rows.iter().all(inside), "axis {axis}");
    }
    assert!(rows.iter().any(|r| r[3] == 0.0) && rows.iter().any(|r| r[3] > 10.0), "ground and segments");

    let mut watcher = std::net::TcpStream::connect(service.address).unwrap();
    watcher.write_all(b"GET /v1/events HTTP/1.1\r\nhost: localhost\r\n\r\n").unwrap();
    watcher.set_read_timeout(Some(std::time::Duration::from_secs(20))).unwrap();
    let mut lines = BufReader::new(watcher).lines().map(Result::unwrap);
    assert!(lines.next().unwrap().contains("200"));
    lines.find(|l| l.contains("welcome")).unwrap();
    let sweep = &TOWN.live_drive[20];
    let body = point_cloud(sweep.stamp, sweep.cloud.points());
    let answer = service.send(&Request::post("/v1/localize", "application/x-ros2-cdr", body)).good().json();
    let event = lines.find_map(|l| l.strip_prefix("data: ").map(str::to_owned)).unwrap();
    let event: Value = serde_json::from_str(&event).unwrap();
    for (key, value) in answer.as_object().unwrap() {
        assert_eq!(event[key], *value, "{key}");
    }
    assert_eq!((&event["map"], &event["session"]), (&json!("town"), &json!("")));
    assert_eq!(event["matches"].as_array().unwrap().len() as u64, answer["inliers"].as_u64().unwrap());
    let cloud = event["cloud_cm"].as_array().unwrap();
    assert!((500..=2000).contains(&cloud.len()), "{}", cloud.len());
}
