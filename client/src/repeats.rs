//! The attempts at one call: at the server that owns the map, and again after a pause.
//!
//! [`ClientError::may_repeat`] decides which calls are made again. What fails last is what the call ends
//! with. Sessions and watches, which continue where they were, do not come here.

use super::retry::{Retries, RetryPolicy};
use super::servers::MOST_FOLLOWED;
use super::{Client, ClientError};

/// The attempts so far.
#[derive(Debug)]
pub(super) struct Attempts<'a> {
    client: &'a Client,
    /// Servers in a row that named another one as the owner.
    followed: u32,
    retries: Retries,
}

impl<'a> Attempts<'a> {
    /// None yet.
    pub(super) fn of(client: &'a Client) -> Self {
        let Client { deadline, retry, .. } = client;
        let limit = retry.give_up_after.map_or(*deadline, |limit| limit.min(*deadline));
        let policy = RetryPolicy { give_up_after: Some(limit), ..*retry };
        Self { client, followed: 0, retries: Retries::new(policy) }
    }

    /// Goes to the owner of the map or waits, whichever the error of an attempt asks for.
    ///
    /// # Errors
    /// The error, where the call may not be made again or was made often enough.
    pub(super) async fn after(&mut self, error: ClientError) -> Result<(), ClientError> {
        if self.client.servers.follow(&error) && self.followed < MOST_FOLLOWED {
            self.followed += 1;
            return Ok(());
        }
        self.followed = 0;
        if !error.may_repeat() {
            return Err(error);
        }
        self.retries.wait(error).await.map_err(ClientError::into_cause)
    }
}
