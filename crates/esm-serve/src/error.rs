//! What keeps the service from starting, or a client from its answers.

use std::net::SocketAddr;
use std::path::PathBuf;

/// The errors of this crate. Each message says what is wrong, where, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An option cannot be, or would be unsafe.
    #[error("{what}\nhint: {hint}")]
    Options {
        /// What is wrong.
        what: String,
        /// What to do.
        hint: String,
    },
    /// A map or its settings.
    #[error(transparent)]
    Core(#[from] esm_core::Error),
    /// The address cannot be listened on.
    #[error(
        "{listen}: {source}\nhint: choose another address or port with --listen, or stop what listens there"
    )]
    Listen {
        /// The address.
        listen: SocketAddr,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file of the service's identity.
    #[error("{}: {what}\nhint: {hint}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
        /// What to do.
        hint: &'static str,
    },
    /// A service could not be reached, or did not answer as it should.
    #[error("{url}: {what}\nhint: {hint}")]
    Client {
        /// The service.
        url: String,
        /// What went wrong.
        what: String,
        /// What to do.
        hint: String,
    },
}
