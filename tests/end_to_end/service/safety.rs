//! Who may reach the service, and how it ends.

use std::io::Write;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use esm_tests::recording::point_cloud;

use super::Service;
use super::client::{Request, read};
use crate::common::{TOWN, esm, folder, program};

#[test]
fn a_public_address_needs_token_and_tls_or_a_word() {
    let dir = folder();
    let map = TOWN.path("map.esm");
    let token = dir.path().join("token");
    std::fs::write(&token, "0123456789abcdef0123\n").unwrap();
    esm!["serve", "--map", map, "--listen", "0.0.0.0:0"].failed(&[
        "0.0.0.0:0 can be reached from outside: that needs a token and TLS",
        "hint: give --token-file",
        "--insecure-public",
    ]);
    esm!["serve", "--map", map, "--listen", "0.0.0.0:0", "--token-file", token].failed(&["that needs TLS"]);
    let map = map.display().to_string();
    let mut process = program()
        .args(["serve", "--map", &map, "--listen", "0.0.0.0:0", "--insecure-public", "--quiet"])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(process.stdout.take().unwrap()), &mut line)
        .unwrap();
    process.kill().unwrap();
    process.wait().unwrap();
    assert!(line.starts_with("listening on http://0.0.0.0:"), "{line}");
}

#[test]
fn what_cannot_be_started_is_refused_with_a_hint() {
    let dir = folder();
    let map = TOWN.path("map.esm");
    let short = dir.path().join("short");
    std::fs::write(&short, "secret").unwrap();
    esm!["serve", "--map", map, "--token-file", short].failed(&["a token has 16 to 512", "head -c 24"]);
    esm!["serve", "--map", map, "--token-file", dir.path().join("none")].failed(&["none"]);
    esm!["serve", "--map", dir.path().join("none.esm")].failed(&["there is no such file"]);
    esm!["serve", "--map", short].failed(&["this is not an esm map"]);
    esm!["serve", "--map", map, "--map", map].failed(&["two maps are called 'map'", "--map NAME=MAP.esm"]);
    esm!["serve", "--map", map, "--listen", "nowhere"].failed(&["--listen nowhere", "127.0.0.1:8080"]);
    esm!["serve", "--map", map, "--timeout", "0"].failed(&["--timeout 0"]);
    esm!["serve", "--map", map, "--workers", "0"].failed(&["cannot be 0"]);
    esm!["serve", "--map", map, "--descriptor", "eigen"].failed(&["'esm-swift", "asked for 'eigen"]);
    esm!["serve", "--map", map, "--tls-cert", short, "--tls-key", short].failed(&["BEGIN CERTIFICATE"]);
    esm!["serve", "--map", map, "--map-root", short.join("x")].failed(&["name an existing folder"]);
    let taken = Service::town();
    esm!["serve", "--map", map, "--listen", taken.address.to_string()].failed(&["choose another address"]);
    let live = TOWN.path("live.mcap");
    esm!["replay", live, "--to", "127.0.0.1:8080"].failed(&["--to http://127.0.0.1:8080"]);
    esm!["replay", live, "--to", "http://127.0.0.1:1"].failed(&["is the service running there?"]);
    esm!["replay", live, "--to", taken.url, "--map", "nowhere"]
        .failed(&["there is no map 'nowhere'", "there are: town"]);
    esm!["replay", live, "--to", taken.url, "--speed", "-1"].failed(&["--speed -1"]);
}

/// With a token and TLS, as on a public address; the client trusts that one certificate.
#[test]
fn token_and_tls_keep_others_out() {
    let dir = folder();
    let [token, cert, key, other] = ["token", "cert.pem", "key.pem", "other.pem"].map(|n| dir.path().join(n));
    std::fs::write(&token, "0123456789abcdef0123\n").unwrap();
    let made = |path: &std::path::Path| {
        let made = rcgen::generate_simple_self_signed(["127.0.0.1".to_owned()]).unwrap();
        std::fs::write(path, made.cert.pem()).unwrap();
        made
    };
    std::fs::write(&key, made(&cert).signing_key.serialize_pem()).unwrap();
    made(&other);
    let map = TOWN.path("map.esm");
    let flags = [("--map", &map), ("--token-file", &token), ("--tls-cert", &cert), ("--tls-key", &key)];
    let flags = flags.iter().flat_map(|(flag, path)| [(*flag).into(), path.as_os_str().to_owned()]);
    let service = Service::start(flags);
    assert!(service.url.starts_with("https://127.0.0.1:"), "{}", service.url);
    let live = TOWN.path("live.mcap");
    let wrong = dir.path().join("wrong");
    std::fs::write(&wrong, "0123456789abcdef0124\n").unwrap();
    let to = &service.url;
    let some = ["--frames", "1-3", "--speed", "0", "--json"];
    let ran = esm![
        "replay",
        live,
        "--to",
        to,
        "--ca",
        cert,
        "--token-file",
        token,
        some[0],
        some[1],
        some[2],
        some[3],
        some[4]
    ];
    assert_eq!(ran.ended(0).json()[3]["summary"]["answered"], 3);
    esm!["replay", live, "--to", to, "--ca", cert, "--token-file", wrong]
        .failed(&["the token is missing or wrong"]);
    esm!["replay", live, "--to", to, "--ca", cert].failed(&["the token is missing or wrong"]);
    esm!["replay", live, "--to", to, "--ca", other, "--token-file", token].failed(&["--ca FILE.pem"]);
    esm!["replay", live, "--to", to, "--token-file", token].failed(&["no certificate is trusted"]);
    let plain = to.replace("https", "http");
    esm!["replay", live, "--to", plain, "--token-file", token].failed(&["hint: "]);
}

#[test]
fn without_a_token_only_this_machine_may_ask() {
    let service = Service::town();
    let ask = |host: &str| service.send(&Request::get("/v1/maps").header("host", host));
    ask("localhost:80").good();
    ask("127.0.0.1").good();
    ask("rebound.evil.example").refused(403);
}

/// SIGTERM: a request that has begun gets its answer, a session is told, and the program ends well.
#[test]
fn being_told_to_stop_finishes_what_is_in_flight() {
    let mut service = Service::town();
    let sweep = &TOWN.live_drive[20];
    let body = point_cloud(sweep.stamp, sweep.cloud.points());
    let bytes = Request::post("/v1/localize", "application/x-ros2-cdr", body).bytes();
    let mut idle = TcpStream::connect(service.address).unwrap();
    idle.write_all(b"GET /healthz HTTP/1.1\r\nhost: localhost\r\n\r\n").unwrap();
    assert_eq!(read(&mut idle).unwrap().status, 200);
    let mut busy = TcpStream::connect(service.address).unwrap();
    // Half of it is there when the signal comes.
    busy.write_all(&bytes[..bytes.len() / 2]).unwrap();
    std::thread::sleep(Duration::from_millis(300));
    let started = Instant::now();
    service.signal("TERM");
    std::thread::sleep(Duration::from_millis(300));
    assert!(TcpStream::connect(service.address).is_err(), "nobody else is let in");
    busy.write_all(&bytes[bytes.len() / 2..]).unwrap();
    let reply = read(&mut busy).expect("an answer");
    assert_eq!((reply.status, &reply.json()["verdict"]), (200, &"located".into()));
    assert_eq!(service.process.wait().unwrap().code(), Some(0));
    assert!(started.elapsed() < Duration::from_secs(5), "{:?}", started.elapsed());
}
