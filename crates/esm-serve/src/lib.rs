//! Localization as a service: the maps stay loaded, robots send clouds, poses come back.
//!
//! [`Service`] answers over HTTP (`POST /v1/localize`, one cloud by itself) and in streaming sessions over WebSocket
//! (`GET /v1/session`, clouds and odometry in, poses out); maps are loaded and swapped while it runs (`/v1/maps`);
//! `/healthz`, `/readyz`, `/metrics` and `/openapi.json` are for those who watch it. `esm-cli serve` is a thin layer on
//! this crate, [`Session`] the client of its sessions. The README beside this crate tells the wire formats.
//!
//! Everything that comes over the network is bounded: connections, sessions, headers and the time they take, bodies
//! alone and together, clouds that wait, time. The work on clouds runs on threads of its own, a few at a time. A map is
//! copied into memory and verified whole before it takes the place of another; requests that have begun finish on the
//! old one.
//!
//! ```no_run
//! # async fn run() -> Result<(), esm_serve::Error> {
//! use esm_serve::{Options, Service};
//!
//! let maps = vec![("site".to_owned(), "site.esm".into())];
//! let service = Service::start(Options::default(), maps).await?;
//! println!("listening on {}", service.url());
//! service.run(std::future::pending()).await;
//! # Ok(())
//! # }
//! ```

#![forbid(unsafe_code)]

mod body;
mod client;
mod error;
mod http;
mod maps;
mod metrics;
mod options;
mod pool;
mod problem;
mod server;
mod session;
mod state;
mod tls;

pub use client::{Answer, Session, SessionOptions};
pub use error::Error;
pub use maps::named_map;
pub use options::{Options, TlsFiles, Token};
pub use problem::Problem;
pub use server::Service;
pub use session::frame::Frame;
