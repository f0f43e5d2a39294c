//! HTTP by hand: what is sent is known to the byte.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use serde_json::Value;

/// A request.
#[derive(Clone)]
pub(super) struct Request {
    pub(super) method: &'static str,
    pub(super) path: String,
    pub(super) headers: Vec<(String, String)>,
    pub(super) body: Vec<u8>,
}

impl Request {
    pub(super) fn new(method: &'static str, path: impl Into<String>) -> Self {
        Self { method, path: path.into(), headers: Vec::new(), body: Vec::new() }
    }

    pub(super) fn get(path: impl Into<String>) -> Self {
        Self::new("GET", path)
    }

    pub(super) fn post(path: impl Into<String>, kind: &str, body: impl Into<Vec<u8>>) -> Self {
        Self::new("POST", path).header("content-type", kind).body(body)
    }

    /// `PUT /v1/maps/NAME`.
    pub(super) fn put_map(name: &str, file: &std::path::Path) -> Self {
        let order = serde_json::json!({ "file": file }).to_string();
        Self::new("PUT", format!("/v1/maps/{name}")).header("content-type", "application/json").body(order)
    }

    pub(super) fn header(mut self, name: &str, value: &str) -> Self {
        self.headers.push((name.to_owned(), value.to_owned()));
        self
    }

    pub(super) fn body(mut self, body: impl Into<Vec<u8>>) -> Self {
        self.body = body.into();
        self
    }

    /// As it goes over the wire.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let mut head = format!("{} {} HTTP/1.1\r\n", self.method, self.path);
        let has = |name: &str| self.headers.iter().any(|(n, _)| n == name);
        if !has("host") {
            head.push_str("host: localhost\r\n");
        }
        if !has("content-length") && !has("transfer-encoding") {
            head.push_str(&format!("content-length: {}\r\n", self.body.len()));
        }
        for (name, value) in &self.headers {
            head.push_str(&format!("{name}: {value}\r\n"));
        }
        head.push_str("connection: close\r\n\r\n");
        [head.as_bytes(), &self.body].concat()
    }

    pub(super) fn send(&self, to: SocketAddr) -> Reply {
        let bytes = self.bytes();
        raw(to, &bytes, false).unwrap_or_else(|| {
            panic!("no answer to {}", String::from_utf8_lossy(&bytes[..bytes.len().min(200)]))
        })
    }
}

/// An answer.
#[derive(Debug)]
pub(super) struct Reply {
    pub(super) status: u16,
    head: String,
    pub(super) body: Vec<u8>,
}

impl Reply {
    fn parse(bytes: &[u8]) -> Option<Self> {
        let end = bytes.windows(4).position(|w| w == b"\r\n\r\n")?;
        let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
        let status = head.split(' ').nth(1)?.parse().ok()?;
        Some(Self { status, head, body: bytes[end + 4..].to_vec() })
    }

    pub(super) fn header(&self, name: &str) -> Option<&str> {
        self.head.lines().find_map(|line| {
            let (n, value) = line.split_once(':')?;
            n.eq_ignore_ascii_case(name).then(|| value.trim())
        })
    }

    pub(super) fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub(super) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {self:?}"))
    }

    /// Asserts that it was answered well.
    pub(super) fn good(self) -> Self {
        assert!((200..300).contains(&self.status), "{}: {}", self.status, self.text());
        self
    }

    /// Asserts that it was refused, with a reason and a hint.
    pub(super) fn refused(&self, status: u16) {
        assert_eq!(self.status, status, "{}", self.text());
        assert_eq!(self.header("content-type"), Some("application/problem+json"), "{self:?}");
        let problem = self.json();
        assert_eq!(problem["status"], status);
        for key in ["title", "detail", "hint"] {
            assert!(problem[key].as_str().is_some_and(|t| !t.is_empty()), "{key}: {problem}");
        }
        assert!(self.header("x-request-id").is_some(), "{self:?}");
    }
}

/// Sends bytes and reads what comes until the other side ends; `None` where nothing comes. `cut` ends our side first.
pub(super) fn raw(to: SocketAddr, bytes: &[u8], cut: bool) -> Option<Reply> {
    let mut stream = TcpStream::connect(to).expect("the service takes connections");
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    // It may have refused and gone before all is sent.
    let _ = stream.write_all(bytes);
    if cut {
        let _ = stream.shutdown(std::net::Shutdown::Write);
    }
    read(&mut stream)
}

/// Reads an answer to its end.
pub(super) fn read(stream: &mut TcpStream) -> Option<Reply> {
    let mut bytes = Vec::new();
    let mut buffer = [0; 65536];
    // A connection that is reset has still told what it told.
    while let Ok(n @ 1..) = stream.read(&mut buffer) {
        bytes.extend_from_slice(&buffer[..n]);
        // A kept-alive connection ends no answer: its length does.
        if let Some(reply) = Reply::parse(&bytes)
            && let Some(length) = reply.header("content-length").and_then(|l| l.parse::<usize>().ok())
            && reply.body.len() >= length
        {
            return Some(reply);
        }
    }
    Reply::parse(&bytes)
}
