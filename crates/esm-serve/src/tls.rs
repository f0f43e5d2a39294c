//! TLS by rustls: the service's identity, and whom a client trusts.

use std::path::Path;
use std::sync::Arc;

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ClientConfig, RootCertStore, ServerConfig};
use tokio_rustls::{TlsAcceptor, TlsConnector};

use crate::error::Error;
use crate::options::TlsFiles;

fn provider() -> Arc<rustls::crypto::CryptoProvider> {
    Arc::new(rustls::crypto::ring::default_provider())
}

fn bad(path: &Path, what: impl ToString, hint: &'static str) -> Error {
    Error::File { path: path.to_owned(), what: what.to_string(), hint }
}

fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, Error> {
    let hint = "give a PEM file with BEGIN CERTIFICATE, the service's own certificate first";
    let read = CertificateDer::pem_file_iter(path).map_err(|e| bad(path, e, hint))?;
    let chain = read.collect::<Result<Vec<_>, _>>().map_err(|e| bad(path, e, hint))?;
    match chain.is_empty() {
        true => Err(bad(path, "there is no certificate in this file", hint)),
        false => Ok(chain),
    }
}

/// The service's side.
pub(crate) fn acceptor(files: &TlsFiles) -> Result<TlsAcceptor, Error> {
    let chain = certificates(&files.certificate)?;
    let hint = "give a PEM file with BEGIN PRIVATE KEY, without a password, that belongs to the certificate";
    let key = PrivateKeyDer::from_pem_file(&files.key).map_err(|e| bad(&files.key, e, hint))?;
    let mut config = ServerConfig::builder_with_provider(provider())
        .with_safe_default_protocol_versions()
        .and_then(|builder| builder.with_no_client_auth().with_single_cert(chain, key))
        .map_err(|e| bad(&files.key, e, hint))?;
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok(TlsAcceptor::from(Arc::new(config)))
}

/// A client's side: it trusts the certificates in one file, and nobody else.
pub(crate) fn connector(authority: &Path) -> Result<TlsConnector, Error> {
    let mut roots = RootCertStore::empty();
    for certificate in certificates(authority)? {
        roots
            .add(certificate)
            .map_err(|e| bad(authority, e, "give the certificate that signed the service's"))?;
    }
    let config = ClientConfig::builder_with_provider(provider())
        .with_safe_default_protocol_versions()
        .map_err(|e| bad(authority, e, "this is an error of the program"))?
        .with_root_certificates(roots)
        .with_no_client_auth();
    Ok(TlsConnector::from(Arc::new(config)))
}
