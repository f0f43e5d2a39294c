//! [`Options`]: everything about the service that can be set, and what it refuses to start with.

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

use esm_core::Config;

use crate::error::Error;

/// How the service runs. [`Options::default`] is safe on a robot: loopback only, everything bounded.
#[derive(Clone, Debug)]
pub struct Options {
    /// Where to listen; port 0 takes any free one.
    pub listen: SocketAddr,
    /// The method's settings. Where `descriptor_given` is false each map's own descriptor is used.
    pub config: Config,
    /// Whether `config.descriptor` was asked for, and is not just the default.
    pub descriptor_given: bool,
    /// Folders whose files may be loaded over the network, besides those of the maps given at the start.
    pub map_roots: Vec<PathBuf>,
    /// Largest map file, bytes: a map is held in memory whole.
    pub max_map_bytes: u64,
    /// Most maps at once.
    pub max_maps: usize,
    /// The bearer token that requests must carry.
    pub token: Option<Token>,
    /// Certificate chain and private key, PEM files.
    pub tls: Option<TlsFiles>,
    /// Listen on a public address without token and TLS.
    pub insecure_public: bool,
    /// Largest request body, bytes.
    pub max_body_bytes: usize,
    /// Bytes that all request bodies and waiting clouds may take together.
    pub max_held_bytes: usize,
    /// Clouds localized at the same time.
    pub workers: usize,
    /// Requests that may wait for a worker.
    pub queue: usize,
    /// Time a request may take, its body's transfer included.
    pub request_timeout: Duration,
    /// Time until a request's headers must be there; also for how long an idle connection is kept.
    pub header_timeout: Duration,
    /// Connections at the same time.
    pub max_connections: usize,
    /// Streaming sessions at the same time.
    pub max_sessions: usize,
    /// A session from which nothing comes for this long is closed.
    pub session_idle: Duration,
    /// Time for what is in flight to finish after the service was told to stop.
    pub grace: Duration,
}

impl Default for Options {
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], 8080)),
            config: Config::default(),
            descriptor_given: false,
            map_roots: Vec::new(),
            max_map_bytes: 8 << 30,
            max_maps: 64,
            token: None,
            tls: None,
            insecure_public: false,
            max_body_bytes: 64 << 20,
            max_held_bytes: 512 << 20,
            workers: cores,
            queue: 64,
            request_timeout: Duration::from_secs(30),
            header_timeout: Duration::from_secs(10),
            max_connections: 256,
            max_sessions: 16,
            session_idle: Duration::from_secs(60),
            grace: Duration::from_secs(30),
        }
    }
}

/// The files of a TLS identity.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TlsFiles {
    /// Certificate chain, the service's own certificate first, PEM.
    pub certificate: PathBuf,
    /// Private key, PEM.
    pub key: PathBuf,
}

/// A bearer token. Never printed.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

/// Fewest characters of a token: 16 random ones of 64 kinds cannot be guessed.
const MIN_TOKEN: usize = 16;
/// Most characters of a token.
const MAX_TOKEN: usize = 512;

impl Token {
    /// A token from text, blanks around it left out.
    ///
    /// # Errors
    /// [`Error::Options`] where it is shorter than 16 or longer than 512 characters, or cannot stand in a header.
    pub fn new(text: &str) -> Result<Self, Error> {
        let text = text.trim();
        let fine =
            (MIN_TOKEN..=MAX_TOKEN).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_graphic());
        match fine {
            true => Ok(Self(text.to_owned())),
            false => Err(Error::Options {
                what: format!("a token has {MIN_TOKEN} to {MAX_TOKEN} printable ASCII characters, no blanks"),
                hint: "make one: head -c 24 /dev/urandom | base64".to_owned(),
            }),
        }
    }

    /// Whether this is it. Takes the same time wherever the first difference is.
    pub(crate) fn is(&self, given: &[u8]) -> bool {
        use subtle::ConstantTimeEq;
        self.0.as_bytes().ct_eq(given).into()
    }

    /// The token itself.
    pub(crate) fn reveal(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(..)")
    }
}

impl Options {
    /// Refuses what cannot be, and what would be open to everybody.
    ///
    /// # Errors
    /// [`Error::Options`], [`Error::Core`].
    pub fn check(&self) -> Result<(), Error> {
        self.config.check()?;
        let refuse = |what: String, hint: &str| Err(Error::Options { what, hint: hint.to_owned() });
        for (name, value) in [
            ("the largest body", self.max_body_bytes),
            ("the workers", self.workers),
            ("the connections", self.max_connections),
            ("the maps", self.max_maps),
        ] {
            if value == 0 {
                return refuse(format!("{name} cannot be 0"), "give 1 or more");
            }
        }
        if self.max_connections.max(self.max_sessions) > usize::from(u16::MAX) {
            return refuse(
                "more than 65,535 connections or sessions cannot be served".to_owned(),
                "give fewer",
            );
        }
        if self.max_held_bytes < self.max_body_bytes {
            let what = format!(
                "all bodies together may take {} bytes, one alone {}",
                self.max_held_bytes, self.max_body_bytes
            );
            return refuse(what, "allow smaller bodies, or more memory for all of them");
        }
        if is_loopback(self.listen.ip())
            || self.insecure_public
            || (self.token.is_some() && self.tls.is_some())
        {
            return Ok(());
        }
        let missing = match (&self.token, &self.tls) {
            (None, None) => "a token and TLS",
            (None, _) => "a token",
            _ => "TLS",
        };
        refuse(
            format!("{} can be reached from outside: that needs {missing}", self.listen),
            "give --token-file, --tls-cert and --tls-key, listen on 127.0.0.1, or say --insecure-public",
        )
    }
}

/// Whether only this machine can reach the address.
pub(crate) fn is_loopback(ip: IpAddr) -> bool {
    ip.to_canonical().is_loopback()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn on(listen: &str) -> Options {
        Options { listen: listen.parse().unwrap(), ..Options::default() }
    }

    #[test]
    fn public_addresses_need_token_and_tls() {
        let token = Some(Token::new("0123456789abcdef").unwrap());
        let tls = Some(TlsFiles { certificate: "c.pem".into(), key: "k.pem".into() });
        for local in ["127.0.0.1:1", "127.9.9.9:1", "[::1]:1", "[::ffff:127.0.0.1]:1"] {
            on(local).check().unwrap();
        }
        for public in ["0.0.0.0:1", "[::]:1", "192.168.1.5:1", "[2001:db8::1]:1"] {
            let refused = on(public).check().unwrap_err().to_string();
            assert!(refused.contains("a token and TLS\nhint: give --token-file"), "{refused}");
            assert!(Options { token: token.clone(), ..on(public) }.check().is_err());
            assert!(Options { tls: tls.clone(), ..on(public) }.check().is_err());
            Options { tls: tls.clone(), token: token.clone(), ..on(public) }.check().unwrap();
            Options { insecure_public: true, ..on(public) }.check().unwrap();
        }
    }

    #[test]
    fn what_cannot_work_is_refused() {
        assert!(Options { workers: 0, ..Options::default() }.check().is_err());
        assert!(Options { max_held_bytes: 1, ..Options::default() }.check().is_err());
        let mut options = Options::default();
        options.config.accumulate.distance_m = f64::NAN;
        assert!(matches!(options.check(), Err(Error::Core(_))));
    }

    #[test]
    fn tokens_are_long_and_never_printed() {
        for bad in ["", "short", "0123456789 abcdef", "0123456789abcdéf"] {
            assert!(Token::new(bad).is_err(), "{bad}");
        }
        let token = Token::new(" 0123456789abcdef\n").unwrap();
        assert!(token.is(b"0123456789abcdef") && !token.is(b"0123456789abcdeF") && !token.is(b""));
        assert_eq!(format!("{token:?}"), "Token(..)");
    }
}
