//! [`Service`]: connections in, requests to the router, and an end that finishes what is in flight.

use std::future::Future;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::{Sleep, sleep, timeout};
use tokio_rustls::TlsAcceptor;

use crate::error::Error;
use crate::http::router;
use crate::options::Options;
use crate::state::State;
use crate::tls;

/// Most bytes of a request's line and headers.
const MAX_HEAD: usize = 32 << 10;
/// Most headers of a request.
const MAX_HEADERS: usize = 64;
/// A client that takes nothing of its answer for this long is cut off.
const WRITE_TIMEOUT: Duration = Duration::from_secs(30);

/// A service that is ready to run: its maps are loaded, its address is taken.
pub struct Service {
    state: Arc<State>,
    listener: TcpListener,
    address: SocketAddr,
    tls: Option<TlsAcceptor>,
}

impl Service {
    /// Loads the maps, given by name, and takes the address. Connections wait until it [runs](Self::run).
    ///
    /// # Errors
    /// [`Error::Options`] for options that cannot be or are unsafe, [`Error::Core`] and [`Error::File`] for maps and
    /// files that cannot be used, [`Error::Listen`].
    pub async fn start(options: Options, maps: Vec<(String, PathBuf)>) -> Result<Self, Error> {
        let tls = options.tls.as_ref().map(tls::acceptor).transpose()?;
        let listen = options.listen;
        let state = State::new(options, &maps)?;
        let refused = |source| Error::Listen { listen, source };
        let listener = TcpListener::bind(listen).await.map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        Ok(Self { state, listener, address, tls })
    }

    /// Where it listens: the free port that was found, where 0 was asked for.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The same as a URL.
    pub fn url(&self) -> String {
        format!("{}://{}", if self.tls.is_some() { "https" } else { "http" }, self.address)
    }

    /// Answers until `stop` is ready; then takes no more connections, finishes what is in flight, and ends, after
    /// [`Options::grace`] at the latest.
    pub async fn run(self, stop: impl Future<Output = ()>) {
        let Self { state, listener, tls, .. } = self;
        let router = router(Arc::clone(&state));
        let open = Arc::new(Semaphore::new(state.options.max_connections.min(Semaphore::MAX_PERMITS)));
        tokio::pin!(stop);
        loop {
            let stream = tokio::select! {
                () = &mut stop => break,
                accepted = listener.accept() => match accepted {
                    Ok((stream, _)) => stream,
                    Err(error) => {
                        // Too many open files, most likely: others must end first.
                        tracing::warn!("a connection could not be taken: {error}");
                        sleep(Duration::from_millis(100)).await;
                        continue;
                    }
                },
            };
            let Ok(permit) = Arc::clone(&open).try_acquire_owned() else {
                state.metrics.connections_refused.inc();
                refuse(&stream, tls.is_none());
                continue;
            };
            let (state, router, tls) = (Arc::clone(&state), router.clone(), tls.clone());
            tokio::spawn(async move {
                state.metrics.connections.inc();
                // Small answers must not wait for more to send.
                let _ = stream.set_nodelay(true);
                let stream = Unstuck::new(stream);
                match tls {
                    None => serve(&state, stream, router).await,
                    Some(tls) => match timeout(state.options.header_timeout, tls.accept(stream)).await {
                        Ok(Ok(stream)) => serve(&state, stream, router).await,
                        Ok(Err(error)) => tracing::debug!("no TLS: {error}"),
                        Err(_) => tracing::debug!("the TLS handshake took too long"),
                    },
                }
                state.metrics.connections.dec();
                drop(permit);
            });
        }
        drop(listener);
        tracing::info!("stopping: what is in flight is finished");
        state.stopping.send_replace(true);
        // All permits are back once every connection and every session, which leaves its connection's care when it
        // begins, has ended.
        let finished = async {
            let _ = open.acquire_many(permits(state.options.max_connections)).await;
            let _ = state.sessions.acquire_many(permits(state.options.max_sessions)).await;
        };
        if timeout(state.options.grace, finished).await.is_err() {
            tracing::warn!("not all that was in flight could be finished");
        }
    }
}

/// As many as a semaphore of this size has.
fn permits(size: usize) -> u32 {
    u32::try_from(size).unwrap_or(u32::MAX)
}

/// Says, as far as that can be said in passing, that there are too many connections.
fn refuse(stream: &TcpStream, plain: bool) {
    if plain {
        let answer = b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 1\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
        // Whoever cannot be told is refused all the same.
        let _ = stream.try_write(answer);
    }
}

async fn serve(state: &State, stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static, router: Router) {
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(state.options.header_timeout)
        .max_buf_size(MAX_HEAD)
        .max_headers(MAX_HEADERS)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
        .with_upgrades();
    tokio::pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => ended,
        () = state.stopped() => {
            // The request that has begun is answered, and no other is taken.
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = ended {
        tracing::debug!("a connection ended: {error}");
    }
}

/// A stream whose writes fail where the other side takes nothing for [`WRITE_TIMEOUT`].
struct Unstuck {
    stream: TcpStream,
    /// Runs while a write waits.
    stuck: Option<Pin<Box<Sleep>>>,
}

impl Unstuck {
    fn new(stream: TcpStream) -> Self {
        Self { stream, stuck: None }
    }

    fn watch<T>(
        &mut self,
        written: Poll<std::io::Result<T>>,
        context: &mut Context<'_>,
    ) -> Poll<std::io::Result<T>> {
        if written.is_ready() {
            self.stuck = None;
            return written;
        }
        let stuck = self.stuck.get_or_insert_with(|| Box::pin(sleep(WRITE_TIMEOUT)));
        match stuck.as_mut().poll(context) {
            Poll::Ready(()) => Poll::Ready(Err(std::io::ErrorKind::TimedOut.into())),
            Poll::Pending => Poll::Pending,
        }
    }
}

impl AsyncRead for Unstuck {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Unstuck {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<std::io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.watch(written, context)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[std::io::IoSlice<'_>],
    ) -> Poll<std::io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, parts);
        self.watch(written, context)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
