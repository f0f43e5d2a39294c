//! Hostile and broken inputs over the network: each has its answer, and after each the next good request has its own.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use esm_tests::recording::point_cloud;
use serde_json::Value;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{self, Message, WebSocket};

use super::client::{Reply, Request, raw, read};
use super::{Service, floats, timeless};
use crate::common::{TOWN, esm, folder};

const TOKEN: &str = "correct-horse-battery-staple";
const LOCALIZE: &str = "/v1/localize";
const FLOATS: &str = "application/octet-stream";
const CDR: &str = "application/x-ros2-cdr";
const PCD: &str = "application/x-pcd";
const JSON: &str = "application/json";

/// What is expected.
enum Want {
    /// This status, with a reason and a hint where the service itself answers and not the HTTP library below it.
    Refused(u16),
    /// This status, from below.
    Status(u16),
    /// An answer: not found.
    NotFound,
    /// The connection is closed without a word, or refused with this status.
    ClosedOr(u16),
}
use Want::{ClosedOr, NotFound, Refused, Status};

struct Fault {
    what: &'static str,
    bytes: Vec<u8>,
    /// Whether our side of the connection ends after the bytes.
    cut: bool,
    want: Want,
}

fn asked(what: &'static str, request: Request, want: Want) -> Fault {
    let request = request.header("authorization", &format!("Bearer {TOKEN}"));
    Fault { what, bytes: request.bytes(), cut: false, want }
}

fn sent(what: &'static str, bytes: impl Into<Vec<u8>>, cut: bool, want: Want) -> Fault {
    Fault { what, bytes: bytes.into(), cut, want }
}

/// Its own head, up to where the body would begin.
fn head(headers: &str) -> String {
    format!(
        "POST {LOCALIZE} HTTP/1.1\r\nhost: localhost\r\nauthorization: Bearer {TOKEN}\r\ncontent-type: {FLOATS}\r\n{headers}\r\n"
    )
}

/// A PCD header that declares these points, and a body.
fn pcd(points: u64, data: &str, body: &[u8]) -> Vec<u8> {
    let head = format!("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nPOINTS {points}\nDATA {data}\n");
    [head.as_bytes(), body].concat()
}

/// A block that claims to unpack to 100 MB.
fn bomb() -> Vec<u8> {
    let block: Vec<u8> = [0u8, 0].into_iter().chain([0xe0, 0xff, 0].repeat(400_000)).collect();
    let sizes = [block.len() as u32, 100_000_000].map(u32::to_le_bytes).concat();
    pcd(8_000_000, "binary_compressed", &[sizes, block].concat())
}

fn clouds() -> Vec<Fault> {
    let good = point_cloud(1.0, TOWN.live_drive[0].cloud.points());
    let mut wide = good.clone();
    // `width` follows the stamp, the frame's name "lidar" with its padding and `height`.
    let at = 4 + 8 + 4 + 8 + 4;
    assert_eq!(wide[at..at + 4], (TOWN.live_drive[0].cloud.len() as u32).to_le_bytes());
    wide[at..at + 4].copy_from_slice(&50_000_000u32.to_le_bytes());
    let post = |kind: &str, body: Vec<u8>| Request::post(LOCALIZE, kind, body);
    let nan = floats(&[[f32::NAN; 3]; 1000]);
    vec![
        asked("no bytes", post(FLOATS, vec![]), Refused(400)),
        asked("half a point", post(FLOATS, vec![0; 24]), Refused(400)),
        asked("only NaN", post(FLOATS, nan), NotFound),
        asked("only zeros", post(FLOATS, vec![0; 16_000]), NotFound),
        asked("one point", post(FLOATS, floats(&[[3.0; 3]])), NotFound),
        asked("points at the end of the world", post(FLOATS, floats(&[[3e38, -3e38, 1e30]; 500])), NotFound),
        asked("random bytes as floats", post(FLOATS, noise(16 * 5000)), NotFound),
        asked("a message cut in two", post(CDR, good[..good.len() / 2].to_vec()), Refused(400)),
        asked("50 million points in a small message", post(CDR, wide), Refused(400)),
        asked("random bytes as a message", post(CDR, noise(5000)), Refused(400)),
        asked("a message of nothing", post(CDR, vec![]), Refused(400)),
        asked(
            "50 million points in a small file",
            post(PCD, pcd(50_000_000, "binary", &[0; 240])),
            Refused(400),
        ),
        asked("more points than can be counted", post(PCD, pcd(u64::MAX, "ascii", b"1 2 3\n")), Refused(400)),
        asked("a file that unpacks without end", post(PCD, bomb()), Refused(400)),
        asked("random bytes as a file", post(PCD, noise(5000)), Refused(400)),
        asked("JSON of another kind", post(JSON, b"{\"cloud\": []}".to_vec()), Refused(400)),
        asked("JSON cut off", post(JSON, b"{\"points\": [[1, 2, 3], [4".to_vec()), Refused(400)),
        asked("JSON a million deep", post(JSON, vec![b'['; 1_000_000]), Refused(400)),
        asked("numbers as words", post(JSON, b"{\"points\": [[\"1\", 2, 3]]}".to_vec()), Refused(400)),
        asked("an unknown content type", post("text/plain", vec![0; 16]), Refused(415)),
        asked("no content type", Request::new("POST", LOCALIZE).body(vec![0; 16]), Refused(415)),
        asked(
            "a compressed body",
            post(FLOATS, vec![0; 16]).header("content-encoding", "gzip"),
            Refused(415),
        ),
        asked("an unknown map", Request::post("/v1/localize?map=nowhere", FLOATS, vec![0; 16]), Refused(404)),
        asked(
            "a path as a map",
            Request::post("/v1/localize?map=../../etc/passwd", FLOATS, vec![0; 16]),
            Refused(404),
        ),
        asked("an unknown question", Request::post("/v1/localize?seed=1", FLOATS, vec![0; 16]), Refused(400)),
        asked("no time", Request::post("/v1/localize?stamp=NaN", FLOATS, vec![0; 16]), Refused(400)),
    ]
}

fn noise(n: usize) -> Vec<u8> {
    use rand::{RngExt, SeedableRng};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
    // Small exponents: most of it is finite, and some of it is near.
    (0..n).map(|i| if i % 4 == 3 { rng.random_range(0x3e..0x44) } else { rng.random() }).collect()
}

fn requests() -> Vec<Fault> {
    let huge = head(&format!("x-huge: {}\r\n", "x".repeat(100_000)));
    let many: String = (0..200).map(|i| format!("x-{i}: 1\r\n")).collect();
    let get = Request::get("/v1/maps");
    let bare = |header: &str| {
        format!("GET /v1/maps HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n{header}\r\n")
    };
    vec![
        sent("noise instead of HTTP", noise(300), true, ClosedOr(400)),
        sent("TLS to a service without", [22, 3, 1, 0, 200, 1, 0, 0, 196, 3, 3], true, ClosedOr(400)),
        sent("half a request line", "POST /v1/loc", true, ClosedOr(400)),
        sent(
            "half a head, and then nothing",
            "POST /v1/localize HTTP/1.1\r\nhost: a\r\n",
            false,
            ClosedOr(408),
        ),
        sent("a huge header", huge, false, Status(431)),
        sent("200 headers", head(&many), false, Status(431)),
        sent("a path of 80 kB", format!("GET /{} HTTP/1.1\r\n\r\n", "a".repeat(80_000)), false, Status(431)),
        sent("a body that does not come", head("content-length: 1600\r\n") + "few", false, Refused(408)),
        sent("a body cut off", head("content-length: 1600\r\n") + "few", true, ClosedOr(400)),
        sent("50 million points declared", head("content-length: 800000000\r\n"), false, Refused(413)),
        sent(
            "more bytes than can be counted",
            head("content-length: 99999999999999999999\r\n"),
            false,
            Status(400),
        ),
        sent("two lengths", head("content-length: 16\r\ncontent-length: 17\r\n"), false, Status(400)),
        sent("chunks without end", head("transfer-encoding: chunked\r\n") + &endless(), false, Refused(413)),
        sent(
            "a chunk of nonsense",
            head("transfer-encoding: chunked\r\n") + "zz\r\nabc",
            false,
            Refused(400),
        ),
        sent("no token", bare(""), false, Refused(401)),
        sent(
            "a wrong token",
            bare("authorization: Bearer correct-horse-battery-stapl\r\n"),
            false,
            Refused(401),
        ),
        sent("a token of another kind", bare("authorization: Basic Y29ycmVjdA==\r\n"), false, Refused(401)),
        sent("an empty token", bare("authorization: Bearer \r\n"), false, Refused(401)),
        asked("a page of somebody else's", get.header("origin", "https://evil.example"), Refused(403)),
        asked("an unknown place", Request::get("/v1/mops"), Refused(404)),
        asked("a name that is no text", Request::get("/v1/maps/%ff"), Refused(400)),
        asked("a place above", Request::get("/../../etc/passwd"), Refused(404)),
        asked("an unknown method", Request::new("BREW", LOCALIZE), Refused(405)),
        asked("another method", Request::get(LOCALIZE), Refused(405)),
        asked("a session without WebSocket", Request::get("/v1/session"), Refused(426)),
        asked("a session with an unknown map", Request::get("/v1/session?map=nowhere"), Refused(404)),
        asked("a session of no length", Request::get("/v1/session?accumulate=-1"), Refused(400)),
    ]
}

/// 6 MB in chunks, and no end.
fn endless() -> String {
    format!("10000\r\n{}\r\n", "x".repeat(0x10000)).repeat(96)
}

fn maps(folder: &Path, town: &Path) -> Vec<Fault> {
    let bytes = std::fs::read(town).unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let mut flipped = bytes.clone();
    let at = flipped.len() - 2000;
    flipped[at] ^= 4;
    let eigen = folder.join("eigen.esm");
    let built =
        esm!["map", "build", TOWN.path("map.mcap"), "--frames", "1-20", "--descriptor", "eigen", "-o", eigen];
    built.ended(0);
    let pipe = folder.join("pipe.esm");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let huge = folder.join("huge.esm");
    std::fs::File::create(&huge).unwrap().set_len(1 << 40).unwrap();
    let put = |file: &Path| Request::put_map("town", file);
    let order = |body: &str| Request::new("PUT", "/v1/maps/town").header("content-type", JSON).body(body);
    vec![
        asked("a map that is not there", put(&folder.join("missing.esm")), Refused(422)),
        asked("a map cut short", put(&file("short.esm", &bytes[..bytes.len() / 2])), Refused(422)),
        asked("a map with one wrong bit", put(&file("flipped.esm", &flipped)), Refused(422)),
        asked("noise as a map", put(&file("noise.esm", &noise(9000))), Refused(422)),
        asked("nothing as a map", put(&file("empty.esm", b"")), Refused(422)),
        asked("a folder as a map", put(folder), Refused(422)),
        asked("a pipe as a map", put(&pipe), Refused(422)),
        asked("a terabyte as a map", put(&huge), Refused(422)),
        asked("a map of another descriptor", put(&eigen), Refused(422)),
        asked("a file from elsewhere", put(Path::new("/etc/passwd")), Refused(403)),
        asked("a way out of the folder", put(&folder.join("../../../../../../etc/passwd")), Refused(403)),
        asked("a relative path", put(Path::new("town.esm")), Refused(400)),
        asked("no file", order("{}"), Refused(400)),
        asked("no JSON", order("town.esm"), Refused(400)),
        asked("an order of 100 kB", order(&" ".repeat(100_000)), Refused(413)),
        asked(
            "an order that is no JSON at all",
            Request::new("PUT", "/v1/maps/town").header("content-type", FLOATS).body("{}"),
            Refused(415),
        ),
        asked("a name with blanks", Request::put_map("a%20b", town), Refused(400)),
        asked("removing what is not there", Request::new("DELETE", "/v1/maps/nowhere"), Refused(404)),
    ]
}

/// What every good request gets in between.
struct Good {
    request: Request,
    want: Value,
}

impl Good {
    fn new() -> Self {
        let sweep = &TOWN.live_drive[20];
        let request = Request::post(LOCALIZE, CDR, point_cloud(sweep.stamp, sweep.cloud.points()))
            .header("authorization", &format!("Bearer {TOKEN}"));
        let want = super::told_by_localize(&TOWN.path("map.esm")).swap_remove(20);
        assert_eq!(want["verdict"], "located");
        Self { request, want }
    }

    fn is_answered(&self, service: &Service, after: &str) {
        let reply = service.send(&self.request);
        assert_eq!(reply.status, 200, "after {after}: {}", reply.text());
        assert_eq!(timeless(reply.json()), self.want, "after {after}");
    }
}

/// A service with a token, small limits, and a map of its own that may be harmed.
fn guarded(dir: &Path, more: &[&str]) -> (Service, PathBuf) {
    let town = dir.join("town.esm");
    std::fs::copy(TOWN.path("map.esm"), &town).unwrap();
    let token = dir.join("token");
    std::fs::write(&token, format!("{TOKEN}\n")).unwrap();
    let map = format!("town={}", town.display());
    let token = token.display().to_string();
    let flags = ["--map", &map, "--token-file", &token, "--descriptor", "esm-swift", "--max-body-mb", "4"];
    let limits = ["--max-held-mb", "64", "--timeout", "2"];
    (Service::start(flags.iter().chain(&limits).chain(more)), town)
}

#[test]
fn every_fault_has_its_answer_and_harms_nobody() {
    let dir = folder();
    let (service, town) = guarded(dir.path(), &[]);
    let good = Good::new();
    good.is_answered(&service, "nothing");
    let mut faults = requests();
    faults.extend(clouds());
    faults.extend(maps(dir.path(), &town));
    assert!(faults.len() >= 60, "{}", faults.len());
    let mut wrong = Vec::new();
    for Fault { what, bytes, cut, want } in faults {
        let started = Instant::now();
        let reply = raw(service.address, &bytes, cut);
        let took = started.elapsed();
        println!("{what}: {:?} after {took:?}", reply.as_ref().map(|r| r.status));
        assert!(took < Duration::from_secs(20), "{what}: {took:?}");
        let as_expected = match (&want, &reply) {
            (Refused(status), Some(reply)) => {
                let seemly =
                    reply.status != *status || std::panic::catch_unwind(|| reply.refused(*status)).is_ok();
                reply.status == *status && seemly
            }
            (Status(status) | ClosedOr(status), Some(reply)) => reply.status == *status,
            (NotFound, Some(reply)) => reply.status == 200 && reply.json()["verdict"] == "not_found",
            (ClosedOr(_), None) => true,
            (_, None) => false,
        };
        if !as_expected {
            wrong.push(format!("{what}: {:?}", reply.map(|r| (r.status, r.text()))));
        }
        good.is_answered(&service, what);
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    let metrics = Request::get("/metrics").header("authorization", &format!("Bearer {TOKEN}"));
    // The service learns a little later than we that a connection has ended.
    let patience = Instant::now();
    let metrics = loop {
        let metrics = service.send(&metrics).good().text();
        if metrics.contains("esm_connections 1\n") || patience.elapsed() > Duration::from_secs(10) {
            break metrics;
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(
        metrics.contains("status=\"5xx\"} 0\n") && !metrics.contains("route=\"other\",status=\"5xx\"} 1"),
        "{metrics}"
    );
    assert!(metrics.contains("esm_maps 1\n") && metrics.contains("esm_connections 1\n"), "{metrics}");
}

/// The file of a map in use is overwritten in place, cut to nothing, and removed: the map in service is a copy.
#[test]
fn a_map_file_may_change_under_the_service() {
    let dir = folder();
    let (service, town) = guarded(dir.path(), &[]);
    let good = Good::new();
    let len = std::fs::metadata(&town).unwrap().len() as usize;
    std::fs::write(&town, vec![0x5a; len]).unwrap();
    good.is_answered(&service, "overwriting the file in place");
    std::fs::File::create(&town).unwrap();
    good.is_answered(&service, "cutting the file to nothing");
    let again = Request::put_map("town", &town).header("authorization", &format!("Bearer {TOKEN}"));
    service.send(&again).refused(422);
    std::fs::remove_file(&town).unwrap();
    good.is_answered(&service, "removing the file");
    service.send(&again).refused(422);
    good.is_answered(&service, "asking for a file that is gone");
}

/// Connections that say nothing, or one byte at a time, hold their places for a short time only.
#[test]
fn slow_and_many_connections_do_not_keep_others_out() {
    let dir = folder();
    let (service, _) = guarded(dir.path(), &["--max-connections", "16"]);
    let good = Good::new();
    let started = Instant::now();
    let mut slow: Vec<TcpStream> = (0..16).map(|_| TcpStream::connect(service.address).unwrap()).collect();
    slow.iter_mut().for_each(|s| s.write_all(b"GET /healthz HTTP/1.1\r\n").unwrap());
    // All places are taken: the next one is told so at once, and no slow one ends the others.
    let mut one_more = TcpStream::connect(service.address).unwrap();
    let refused = read(&mut one_more).expect("it is told");
    assert_eq!((refused.status, refused.header("retry-after")), (503, Some("1")));
    // A byte now and then does not buy time.
    while started.elapsed() < Duration::from_secs(10) {
        slow.iter_mut().for_each(|s| drop(s.write_all(b"a")));
        std::thread::sleep(Duration::from_millis(200));
        let ended = raw(
            service.address,
            b"GET /healthz HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n",
            false,
        );
        if ended.is_some_and(|r| r.status == 200) {
            break;
        }
    }
    assert!(started.elapsed() < Duration::from_secs(8), "{:?}", started.elapsed());
    good.is_answered(&service, "slow connections");
}

/// More clouds than can be worked on: some are told to come again, the others get their answers.
#[test]
fn too_many_clouds_at_once_are_told_to_come_again() {
    let dir = folder();
    let (service, _) = guarded(dir.path(), &["--workers", "1", "--queue", "2"]);
    let good = Good::new();
    let replies: Vec<Reply> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..24).map(|_| scope.spawn(|| service.send(&good.request))).collect();
        threads.into_iter().map(|t| t.join().unwrap()).collect()
    });
    let busy: Vec<&Reply> = replies.iter().filter(|r| r.status != 200).collect();
    for reply in &busy {
        reply.refused(503);
        assert_eq!(reply.header("retry-after"), Some("1"));
    }
    assert!(!busy.is_empty() && busy.len() < 24, "{} of 24 were told to come again", busy.len());
    for reply in replies.iter().filter(|r| r.status == 200) {
        assert_eq!(timeless(reply.json()), good.want);
    }
    good.is_answered(&service, "a rush");
}

type Socket = WebSocket<TcpStream>;

fn session(to: SocketAddr, query: &str) -> Result<Socket, u16> {
    let stream = TcpStream::connect(to).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let mut request = format!("ws://{to}/v1/session{query}").into_client_request().unwrap();
    request.headers_mut().insert("authorization", format!("Bearer {TOKEN}").parse().unwrap());
    match tungstenite::client(request, stream) {
        Ok((socket, _)) => Ok(socket),
        Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(response))) => {
            Err(response.status().as_u16())
        }
        Err(error) => panic!("{error}"),
    }
}

/// Reads to the end: what was said, and the code it was closed with.
fn last_words(socket: &mut Socket) -> (Vec<Value>, Option<u16>) {
    let mut said = Vec::new();
    loop {
        match socket.read() {
            Ok(Message::Text(text)) => said.push(serde_json::from_str(text.as_str()).unwrap()),
            Ok(Message::Close(frame)) => return (said, frame.map(|f| f.code.into())),
            Ok(_) => {}
            Err(_) => return (said, None),
        }
    }
}

#[test]
fn faults_in_sessions_are_told_and_end_only_their_own() {
    let dir = folder();
    let (service, _) = guarded(dir.path(), &["--max-sessions", "3"]);
    let good = Good::new();
    let cloud = |n: u32, points: usize| {
        [&b"ESMC"[..], &n.to_le_bytes(), &7i64.to_le_bytes(), &vec![1; 16 * points]].concat()
    };
    let odometry = [&b"ESMO"[..], &[0; 12], &[0xff; 56]].concat();
    let mut bystander = session(service.address, "?accumulate=0").unwrap();
    for (what, message, words) in [
        ("noise", Message::binary(noise(100)), "begin with ESMC"),
        ("nothing", Message::binary(vec![]), "0 bytes"),
        ("50 million points declared", Message::binary(cloud(50_000_000, 2)), "50000000 points"),
        ("fewer bytes than declared", Message::binary(cloud(3, 2)), "3 points"),
        ("odometry of NaN", Message::binary(odometry), "no pose"),
        ("text that is no JSON", Message::text("hello"), "expected"),
        ("JSON of another kind", Message::text("{\"pose\": 1}"), "pose"),
        ("a message that is too large", Message::binary(vec![0; 5 << 20]), "larger"),
    ] {
        let mut socket = session(service.address, "").unwrap();
        // It may be closed before all of it is sent.
        let _ = socket.send(message);
        let (said, code) = last_words(&mut socket);
        let detail = said.last().and_then(|s| s["error"]["detail"].as_str()).unwrap_or_default().to_owned();
        println!("{what}: {detail} ({code:?})");
        assert!(detail.contains(words), "{what}: {said:?} {code:?}");
        good.is_answered(&service, what);
    }
    // Frames that break the protocol itself.
    let mut socket = session(service.address, "").unwrap();
    socket.get_mut().write_all(&[0x82, 0x7f, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff]).unwrap();
    let mut rest = Vec::new();
    let _ = socket.get_mut().read_to_end(&mut rest);
    good.is_answered(&service, "a frame of 2^63 bytes");
    // A client that is gone without a word, in the middle of a message.
    let mut socket = session(service.address, "").unwrap();
    socket.get_mut().write_all(&[0x82, 0xfe, 0x10, 0x00, 1, 2, 3, 4, 5]).unwrap();
    drop(socket);
    // Three are the most; places come free again.
    let first = session(service.address, "").unwrap();
    let second = session(service.address, "").unwrap();
    assert_eq!(session(service.address, "").err(), Some(503));
    drop((first, second));
    let again = Instant::now();
    while session(service.address, "").is_err() {
        assert!(again.elapsed() < Duration::from_secs(10));
        std::thread::sleep(Duration::from_millis(50));
    }
    // The one who did nothing wrong has noticed nothing.
    let sweep = &TOWN.live_drive[20];
    let stamp_ns = ((sweep.stamp * 1e9) as i64).to_le_bytes();
    let count = (sweep.cloud.len() as u32).to_le_bytes();
    let message = [&b"ESMC"[..], &count, &stamp_ns, &floats(sweep.cloud.points())].concat();
    bystander.send(Message::binary(message)).unwrap();
    let Ok(Message::Text(text)) = bystander.read() else { panic!("no answer") };
    let mut answer = timeless(serde_json::from_str(text.as_str()).unwrap());
    assert_eq!(answer.as_object_mut().unwrap().remove("dropped"), Some(Value::from(0)));
    assert_eq!(answer, good.want);
}
