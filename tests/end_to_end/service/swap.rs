//! Maps that are swapped while clouds are localized, and processes that are killed meanwhile.

use std::path::Path;
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use esm_tests::recording::point_cloud;
use serde_json::Value;

use super::client::{Request, raw};
use super::{OTHER_MAP, Service, timeless, told_by_localize};
use crate::common::{TOWN, esm, folder, names, program};

const ROUNDS: usize = 8;

#[test]
fn maps_are_swapped_under_load_without_a_dropped_request() {
    let dir = folder();
    let [a, b, bad] = ["a.esm", "b.esm", "bad.esm"].map(|n| dir.path().join(n));
    std::fs::copy(TOWN.path("map.esm"), &a).unwrap();
    std::fs::copy(&*OTHER_MAP, &b).unwrap();
    let bytes = std::fs::read(&a).unwrap();
    std::fs::write(&bad, &bytes[..bytes.len() - 64]).unwrap();
    let service = Service::start(["--map".to_owned(), format!("town={}", a.display())]);
    let (by_a, by_b) = (told_by_localize(&a), told_by_localize(&b));
    let (done, answers) = (AtomicBool::new(false), [AtomicUsize::new(0), AtomicUsize::new(0)]);
    std::thread::scope(|scope| {
        for thread in 0..3 {
            let (service, done, answers, by_a, by_b) = (&service, &done, &answers, &by_a, &by_b);
            scope.spawn(move || {
                for i in (0..TOWN.live_drive.len()).cycle().skip(7 * thread) {
                    if done.load(Ordering::Relaxed) {
                        break;
                    }
                    let sweep = &TOWN.live_drive[i];
                    let body = point_cloud(sweep.stamp, sweep.cloud.points());
                    let reply =
                        service.send(&Request::post("/v1/localize?map=town", "application/x-ros2-cdr", body));
                    assert_eq!(reply.status, 200, "{}", reply.text());
                    let answer = timeless(reply.json());
                    // One map's answer or the other's, and nothing in between.
                    let which = [&by_a[i], &by_b[i]].iter().position(|want| **want == answer);
                    answers[which.unwrap_or_else(|| panic!("sweep {i}: {answer}"))]
                        .fetch_add(1, Ordering::Relaxed);
                }
            });
        }
        let swap = |file: &Path| service.send(&Request::put_map("town", file));
        // On a slow machine more swaps than asked for, until both maps have answered.
        let enough = || answers.iter().all(|n| n.load(Ordering::Relaxed) > 10);
        for round in 0.. {
            if round >= 2 * ROUNDS && (enough() || round >= 50 * ROUNDS) {
                break;
            }
            std::thread::sleep(Duration::from_millis(60));
            swap(if round % 2 == 0 { &b } else { &a }).good();
            swap(&bad).refused(422);
        }
        done.store(true, Ordering::Relaxed);
    });
    let [of_a, of_b] = answers.map(AtomicUsize::into_inner);
    assert!(of_a > 10 && of_b > 10, "both maps were in service: {of_a} and {of_b} answers");
}

/// Builds are killed while they write: what bears the map's name is whole, always.
#[test]
fn a_build_that_is_killed_leaves_the_old_map() {
    let dir = folder();
    let site = dir.path().join("site.esm");
    std::fs::copy(TOWN.path("map.esm"), &site).unwrap();
    let service = Service::start(["--map".to_owned(), format!("site={}", site.display())]);
    let mut caught = 0;
    for round in 0..ROUNDS {
        let mut build = program()
            .args(["map", "build", "--quiet"])
            .args([TOWN.path("map.mcap"), "-o".into(), site.clone()])
            .args(["--frames", "1-40"])
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let started = Instant::now();
        // The moment it begins to write, or a little later.
        let ended = loop {
            if names(dir.path()).iter().any(|n| n.ends_with(".tmp")) {
                caught += 1;
                std::thread::sleep(Duration::from_micros(400 * round as u64));
                break build.kill().is_ok();
            }
            if build.try_wait().unwrap().is_some() || started.elapsed() > Duration::from_secs(60) {
                break false;
            }
        };
        let _ = build.wait();
        let picked = service.send(&Request::put_map("site", &site)).good().json();
        assert!(
            picked["segments"].as_u64().is_some_and(|n| n > 10),
            "round {round}, killed {ended}: {picked}"
        );
        esm!["map", "info", "--check", site].ended(0);
        // What a killed build has left is never taken for a map.
        for left in names(dir.path()).iter().filter(|n| n.ends_with(".tmp")) {
            let left = dir.path().join(left);
            // Cut short, or whole but for its name.
            let reply = service.send(&Request::put_map("site", &left));
            match reply.status {
                200 => drop(esm!["map", "info", "--check", left].ended(0)),
                _ => reply.refused(422),
            }
            std::fs::remove_file(&left).unwrap();
        }
    }
    assert!(caught >= ROUNDS / 2, "the kills met {caught} writes");
    service.send(&Request::get("/v1/maps/site")).good();
}

/// Services are killed while they swap: the next one starts on a whole map and answers the same.
#[test]
fn a_service_that_is_killed_in_a_swap_starts_again() {
    let dir = folder();
    let site = dir.path().join("site.esm");
    std::fs::copy(TOWN.path("map.esm"), &site).unwrap();
    let sweep = &TOWN.live_drive[20];
    let cloud = Request::post(
        "/v1/localize",
        "application/x-ros2-cdr",
        point_cloud(sweep.stamp, sweep.cloud.points()),
    );
    let before = std::fs::read(&site).unwrap();
    let mut first: Option<Value> = None;
    for round in 0..ROUNDS {
        let service = Service::start(["--map".to_owned(), format!("site={}", site.display())]);
        let answer = timeless(service.send(&cloud).good().json());
        assert_eq!(*first.get_or_insert(answer.clone()), answer, "round {round}");
        let (address, put) = (service.address, Request::put_map("site", &site).bytes());
        let swap = std::thread::spawn(move || raw(address, &put, false));
        std::thread::sleep(Duration::from_millis(round as u64));
        service.signal("KILL");
        drop(service);
        let _ = swap.join();
        assert!(std::fs::read(&site).unwrap() == before, "a service never writes to a map");
    }
    assert_eq!(names(dir.path()), ["site.esm"]);
}
