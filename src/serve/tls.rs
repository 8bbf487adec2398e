//! TLS: a certificate and its key, from PEM files.

use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::fault::{AtFault, Fault};

use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ServerConfig, ServerConnection, StreamOwned};

use super::stream::Stream;

/// What connections are encrypted with.
#[derive(Clone)]
pub struct Tls(Arc<ServerConfig>);

/// Why a certificate cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A file is not there, or holds nothing of the kind.
    #[error("{}: cannot be read as {what} in PEM: {reason}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// A certificate, or a key.
        what: &'static str,
        /// What went wrong.
        reason: String,
    },
    /// They do not belong together, or are of a kind that is not known.
    #[error("the certificate and the key cannot be used together: {0}")]
    Refused(#[from] rustls::Error),
}

impl AtFault for TlsError {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

impl Tls {
    /// Reads a certificate chain and its key.
    ///
    /// # Errors
    /// Where a file cannot be read, or the two do not belong together.
    pub fn read(certificate: &Path, key: &Path) -> Result<Self, TlsError> {
        let wrong = |path: &Path, what, reason: String| TlsError::File { path: path.to_owned(), what, reason };
        let read = CertificateDer::pem_file_iter(certificate).and_then(Iterator::collect::<Result<Vec<_>, _>>);
        let chain = read.map_err(|error| wrong(certificate, "a certificate", error.to_string()))?;
        if chain.is_empty() {
            return Err(wrong(certificate, "a certificate", "there is none in it".to_owned()));
        }
        let key = PrivateKeyDer::from_pem_file(key).map_err(|error| wrong(key, "a private key", error.to_string()))?;
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()?
            .with_no_client_auth()
            .with_single_cert(chain, key)?;
        Ok(Self(Arc::new(config)))
    }

    /// The encrypted side of a connection.
    pub(super) fn wrap(&self, stream: TcpStream) -> std::io::Result<Stream> {
        let connection = ServerConnection::new(Arc::clone(&self.0)).map_err(std::io::Error::other)?;
        Ok(Stream::Tls(Box::new(StreamOwned::new(connection, stream))))
    }
}
