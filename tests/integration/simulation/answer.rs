//! How a call of a simulated robot ended, and a promise that does not hold.
//!
//! Values only: nothing here calls the server.

use tonic::Code;

use covis::client::ClientError;

/// A promise that does not hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Broken(pub(crate) String);

pub(super) type Step<T> = Result<T, Broken>;

pub(super) fn broken<T>(text: impl Into<String>) -> Step<T> {
    Err(Broken(text.into()))
}

/// What became of a call.
#[derive(Debug)]
pub(super) enum Answer<T> {
    Some(T),
    /// The server answered with this.
    Refused(Code, String),
    /// No answer of the server: it may have done what was asked.
    None,
}

pub(super) fn answer<T>(outcome: Result<T, ClientError>) -> Answer<T> {
    match outcome {
        Ok(answer) => Answer::Some(answer),
        Err(error) => match error.code() {
            None
            | Some(
                Code::Unavailable
                | Code::DeadlineExceeded
                | Code::Cancelled
                | Code::Unknown
                | Code::Aborted,
            ) => Answer::None,
            Some(code) => Answer::Refused(code, error.to_string()),
        },
    }
}
