//! What to do next about an error that a user can do something about.
//!
//! The errors themselves say what happened and to what; they know neither flags nor commands, so that the
//! advice is here. Where nothing is sure to help, nothing is said.

use std::io::ErrorKind;

use tonic::Code;

use crate::client::ClientError;
use crate::frontend::input::InputError;
use crate::store::StoreError;

/// The next step, where there is one; for the end of the error's line.
pub(super) fn next_step(error: &anyhow::Error) -> Option<String> {
    error.chain().find_map(|cause| {
        if let Some(error) = cause.downcast_ref::<ClientError>() {
            return of_client(error);
        }
        if let Some(InputError::WithoutDepth { has_truth: true, .. }) = cause.downcast_ref() {
            return Some("`covis eval` compares with the trajectory in it".to_owned());
        }
        if let Some(StoreError::InUse { .. }) = cause.downcast_ref::<StoreError>() {
            return Some("stop that server, or name another folder".to_owned());
        }
        of_system(cause.downcast_ref::<std::io::Error>()?.kind())
    })
}

fn of_system(kind: ErrorKind) -> Option<String> {
    if matches!(kind, ErrorKind::StorageFull | ErrorKind::QuotaExceeded) {
        return Some("make room, or write to another disk, and run it again".to_owned());
    }
    let port = "another program, perhaps another covis, uses this port: --listen sets another one";
    (kind == ErrorKind::AddrInUse).then(|| port.to_owned())
}

fn of_client(error: &ClientError) -> Option<String> {
    if let ClientError::Unreachable { url, source } = error {
        let text: String = anyhow::Chain::new(source.as_ref()).map(ToString::to_string).collect();
        let is_https = url.starts_with("https:");
        let step = if is_https && text.contains("InvalidContentType") {
            "the server does not use TLS: its URL begins with http://"
        } else if text.contains("certificate") {
            "--ca FILE names the authority that signed the server's certificate"
        } else {
            "`covis serve` starts one, --server URL names another"
        };
        return Some(step.to_owned());
    }
    let step = match (error.code()?, error.reason().as_deref()) {
        (Code::Unauthenticated, _) => "--token-file FILE, or COVIS_TOKEN, gives the server a token",
        (Code::NotFound, Some("MAP_NOT_FOUND")) => "`covis map list` lists the server's maps",
        (Code::NotFound, Some("JOB_NOT_FOUND")) => "`covis job list` lists the server's jobs",
        (_, Some("CLIENT_IN_BOTH")) => "--rename CLIENT=NEW gives the source's client another name",
        // No server of ours built this status: whoever is there did not understand the call.
        (Code::Unavailable | Code::Unknown | Code::Internal, None) => {
            "if the server has a certificate, its URL begins with https://"
        }
        _ => return None,
    };
    Some(step.to_owned())
}

#[cfg(test)]
mod tests {
    use anyhow::Context;

    use super::*;

    #[test]
    fn a_full_disk_is_distinguished_from_other_errors_of_the_system() {
        let error = |kind: ErrorKind| {
            Err::<(), _>(std::io::Error::from(kind)).context("model/images.bin").unwrap_err()
        };
        let full = next_step(&error(ErrorKind::StorageFull));
        assert_eq!(full.as_deref(), Some("make room, or write to another disk, and run it again"));
        assert_eq!(next_step(&error(ErrorKind::NotFound)), None);
        assert_eq!(next_step(&anyhow::anyhow!("a file")), None);
    }
}
