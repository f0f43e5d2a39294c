//! [`Session`]: a client's side of a streaming session.

use std::path::PathBuf;

use axum::http::{HeaderValue, Uri, header};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use rustls::pki_types::ServerName;
use serde::Deserialize;
use serde_json::Value;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{self, Message};
use tokio_tungstenite::{WebSocketStream, client_async};

use crate::error::Error;
use crate::maps::check_name;
use crate::options::Token;
use crate::session::frame::Frame;
use crate::tls;

/// Whom to ask, and for what.
#[derive(Clone, Debug, Default)]
pub struct SessionOptions {
    /// The map to search; all of them where it is `None`.
    pub map: Option<String>,
    /// Metres of travel a cloud holds; the service's setting where it is `None`.
    pub accumulate_m: Option<f64>,
    /// The token, where the service wants one.
    pub token: Option<Token>,
    /// The certificate to trust, PEM; needed for `https`.
    pub authority: Option<PathBuf>,
}

trait Stream: AsyncRead + AsyncWrite + Unpin + Send {}
impl<T: AsyncRead + AsyncWrite + Unpin + Send> Stream for T {}
type Socket = WebSocketStream<Box<dyn Stream>>;

/// An open session: frames go out, answers come in, each in a half of its own.
pub struct Session {
    /// Where frames are sent.
    pub to: Sender,
    /// Where answers come from.
    pub from: Answers,
}

/// The half that sends.
pub struct Sender {
    url: String,
    sink: SplitSink<Socket, Message>,
}

/// The half that receives.
pub struct Answers {
    url: String,
    stream: SplitStream<Socket>,
}

/// One answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The JSON object: the line of `localize --json`, `dropped` and, where it was searched for, `map`.
    pub line: String,
    /// Clouds so far that got no answer of their own.
    pub dropped: u64,
    /// Whether the verdict is `located`.
    pub located: bool,
}

impl Session {
    /// Opens a session with the service at `http://HOST:PORT`, or `https`.
    ///
    /// # Errors
    /// [`Error::Client`] where it cannot be reached or refuses, [`Error::File`] for the certificate.
    pub async fn connect(url: &str, options: &SessionOptions) -> Result<Self, Error> {
        let failed =
            |what: String, hint: &str| Error::Client { url: url.to_owned(), what, hint: hint.to_owned() };
        let hint = "name the service like this: --to http://127.0.0.1:8080";
        let uri: Uri = url.parse().map_err(|e| failed(format!("this is no URL: {e}"), hint))?;
        let secure = match uri.scheme_str() {
            Some("http" | "ws") => false,
            Some("https" | "wss") => true,
            _ => return Err(failed("the URL begins with neither http nor https".into(), hint)),
        };
        let host = uri.host().ok_or_else(|| failed("the URL names no host".into(), hint))?;
        let port = uri.port_u16().unwrap_or(if secure { 443 } else { 80 });
        let bare = host.trim_start_matches('[').trim_end_matches(']');
        let stream = TcpStream::connect((bare, port)).await.map_err(|e| {
            failed(e.to_string(), "is the service running there? esm-cli serve --map MAP.esm")
        })?;
        // Small messages must not wait for more to send.
        let _ = stream.set_nodelay(true);
        let stream: Box<dyn Stream> = match secure {
            false => Box::new(stream),
            true => {
                let hint =
                    "give the certificate that the service shows, or the one that signed it: --ca FILE.pem";
                let Some(authority) = &options.authority else {
                    return Err(failed("no certificate is trusted".into(), hint));
                };
                let name = ServerName::try_from(bare.to_owned()).map_err(|e| failed(e.to_string(), hint))?;
                let connector = tls::connector(authority)?;
                Box::new(connector.connect(name, stream).await.map_err(|e| failed(e.to_string(), hint))?)
            }
        };
        if let Some(name) = &options.map {
            check_name(name).map_err(|p| failed(p.detail, &p.hint))?;
        }
        let mut query = Vec::new();
        query.extend(options.map.as_ref().map(|map| format!("map={map}")));
        query.extend(options.accumulate_m.map(|metres| format!("accumulate={metres}")));
        let scheme = if secure { "wss" } else { "ws" };
        let place = format!("{scheme}://{host}:{port}/v1/session?{}", query.join("&"));
        let mut request = place.into_client_request().map_err(|e| failed(e.to_string(), hint))?;
        if let Some(token) = &options.token {
            let value = HeaderValue::from_str(&format!("Bearer {}", token.reveal()));
            let mut value = value.map_err(|e| failed(e.to_string(), hint))?;
            value.set_sensitive(true);
            request.headers_mut().insert(header::AUTHORIZATION, value);
        }
        let (socket, _) = client_async(request, stream).await.map_err(|e| refused(url, e))?;
        let (sink, stream) = socket.split();
        Ok(Self { to: Sender { url: url.to_owned(), sink }, from: Answers { url: url.to_owned(), stream } })
    }
}

impl Sender {
    /// Sends a frame.
    ///
    /// # Errors
    /// [`Error::Client`] where the connection is gone.
    pub async fn send(&mut self, frame: &Frame) -> Result<(), Error> {
        let sent = self.sink.send(Message::binary(frame.to_bytes())).await;
        sent.map_err(|e| refused(&self.url, e))
    }

    /// Ends the session.
    ///
    /// # Errors
    /// [`Error::Client`] where the connection is gone.
    pub async fn close(&mut self) -> Result<(), Error> {
        self.sink.send(Message::Close(None)).await.map_err(|e| refused(&self.url, e))
    }
}

#[derive(Deserialize)]
struct Read {
    dropped: u64,
    verdict: String,
}

impl Answers {
    /// The next answer; `None` at the end of the session.
    ///
    /// # Errors
    /// [`Error::Client`] with what the service says is wrong, or where the connection breaks.
    pub async fn next(&mut self) -> Result<Option<Answer>, Error> {
        while let Some(message) = self.stream.next().await {
            let text = match message.map_err(|e| refused(&self.url, e))? {
                Message::Text(text) => text.as_str().to_owned(),
                Message::Close(_) => return Ok(None),
                _ => continue,
            };
            if let Ok(Read { dropped, verdict }) = serde_json::from_str(&text) {
                return Ok(Some(Answer { line: text, dropped, located: verdict == "located" }));
            }
            let value: Value = serde_json::from_str(&text).unwrap_or_default();
            return Err(told(&self.url, &value["error"], &text));
        }
        Ok(None)
    }
}

/// A refusal as the service tells it.
fn told(url: &str, problem: &Value, otherwise: &str) -> Error {
    let word = |key: &str| problem[key].as_str().map(str::to_owned);
    Error::Client {
        url: url.to_owned(),
        what: word("detail").unwrap_or_else(|| otherwise.chars().take(200).collect()),
        hint: word("hint").unwrap_or_else(|| "is this an esm service?".to_owned()),
    }
}

fn refused(url: &str, error: tungstenite::Error) -> Error {
    match error {
        tungstenite::Error::Http(response) => {
            let body = response.body().as_deref().unwrap_or_default();
            let problem: Value = serde_json::from_slice(body).unwrap_or_default();
            told(url, &problem, &format!("it answered {}", response.status()))
        }
        error => Error::Client {
            url: url.to_owned(),
            what: error.to_string(),
            hint: "the service's log tells more".to_owned(),
        },
    }
}
