//! `esm-cli serve`.

use std::net::{SocketAddr, ToSocketAddrs};
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use esm_serve::{Options, Service, TlsFiles, Token, named_map};

use crate::args::{LiveArgs, ServeArgs};
use crate::inputs::read_text;
use crate::outcome::{Failure, Outcome};
use crate::output::data;
use crate::settings::{self, Settings};
use crate::signals;

/// Most bytes of a file that holds a token.
const MAX_TOKEN_BYTES: u64 = 4096;
/// Longest a request may be allowed to take, seconds.
const MAX_TIMEOUT_S: f64 = 3600.0;

pub(crate) fn run(args: &ServeArgs) -> anyhow::Result<Outcome> {
    let live = LiveArgs { accumulate: args.accumulate, swathes: false };
    let Settings { config, descriptor_given } =
        settings::configure(&args.tune, &live)?.within(args.budget_ms)?;
    let options = options(args, config, descriptor_given)?;
    let maps = args.map.iter().map(|text| named_map(text)).collect();
    let (tell, told) = tokio::sync::oneshot::channel::<()>();
    let runtime = runtime()?;
    let service = runtime.block_on(Service::start(options, maps))?;
    signals::on_first(move || {
        // Nobody waits any more where the service has ended by itself.
        let _ = tell.send(());
    });
    data(format!("listening on {}\n", service.url()).as_bytes())?;
    runtime.block_on(service.run(async {
        let _ = told.await;
    }));
    // What could not be finished in time is not waited for again.
    runtime.shutdown_background();
    Ok(Outcome::Done)
}

/// The threads that talk; the work on clouds has its own.
pub(crate) fn runtime() -> anyhow::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .context("starting the threads that talk to the network")
}

fn options(args: &ServeArgs, config: esm_core::Config, descriptor_given: bool) -> anyhow::Result<Options> {
    let (limits, safety) = (&args.limits, &args.safety);
    if !(limits.timeout > 0.0 && limits.timeout <= MAX_TIMEOUT_S) {
        let what = format!("--timeout {}: that is no time a request may take", limits.timeout);
        return Err(Failure::new(what, format!("give seconds, above 0 and at most {MAX_TIMEOUT_S}")).into());
    }
    let tls = safety.tls_cert.as_ref().zip(safety.tls_key.as_ref());
    let defaults = Options::default();
    Ok(Options {
        listen: address(&args.listen)?,
        config,
        descriptor_given,
        map_roots: args.map_root.clone(),
        max_map_bytes: limits.max_map_mb.saturating_mul(1 << 20),
        token: safety.token_file.as_deref().map(token).transpose()?,
        tls: tls.map(|(cert, key)| TlsFiles { certificate: cert.clone(), key: key.clone() }),
        insecure_public: safety.insecure_public,
        max_body_bytes: limits.max_body_mb.saturating_mul(1 << 20),
        max_held_bytes: limits.max_held_mb.saturating_mul(1 << 20),
        workers: limits.workers.unwrap_or(defaults.workers),
        queue: limits.queue,
        request_timeout: Duration::from_secs_f64(limits.timeout),
        header_timeout: defaults.header_timeout.min(Duration::from_secs_f64(limits.timeout)),
        max_connections: limits.max_connections,
        max_sessions: limits.max_sessions,
        ..defaults
    })
}

fn address(text: &str) -> anyhow::Result<SocketAddr> {
    let hint = "give an address and a port: --listen 127.0.0.1:8080";
    let mut found =
        text.to_socket_addrs().map_err(|e| Failure::new(format!("--listen {text}: {e}"), hint))?;
    Ok(found.next().ok_or_else(|| Failure::new(format!("--listen {text}: there is no such host"), hint))?)
}

/// Reads a token from its file.
pub(crate) fn token(path: &Path) -> anyhow::Result<Token> {
    let hint = "make one: head -c 24 /dev/urandom | base64 > FILE";
    let text = read_text(path, MAX_TOKEN_BYTES, "this is larger than a token can be", hint)?;
    Token::new(&text).with_context(|| path.display().to_string())
}
