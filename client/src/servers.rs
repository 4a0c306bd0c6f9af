//! The servers of a deployment, and the one that a client talks to.
//!
//! Several servers may share maps (docs/cluster.md). A client is given the URLs of some, and goes to the
//! first that answers. A server that does not serve a map names the one that does (MAP_OWNED_ELSEWHERE):
//! the client then goes there. When a link breaks it goes back to the server that named the owner, and
//! from there to the next of the URLs that it was given. With one URL it stays there. What is sent to
//! them is not known here.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tonic::codegen::InterceptedService;
use tonic::transport::{Channel, Endpoint};

use super::credentials::Bearer;
use super::{ClientError, Credentials, Link, LinkOptions};

/// How often a call follows from server to server before it fails.
pub(super) const MOST_FOLLOWED: u32 = 4;

/// Where a client's calls go. Clones of a client share it.
#[derive(Debug)]
pub(super) struct Servers {
    /// The URLs that were given; empty for a channel that the caller made.
    given: Vec<String>,
    credentials: Credentials,
    options: LinkOptions,
    current: Mutex<Current>,
}

#[derive(Clone, Debug)]
struct Current {
    link: Link,
    url: Arc<str>,
    /// The index of the URL that was given and used last.
    index: usize,
}

impl Servers {
    /// Connects to the first of the URLs, separated by commas, that answers.
    ///
    /// # Errors
    /// What is wrong with a URL or the credentials; [`ClientError::Unreachable`] where nobody answers.
    pub(super) async fn connect(
        urls: &str,
        credentials: &Credentials,
        options: LinkOptions,
    ) -> Result<Arc<Self>, ClientError> {
        let given: Vec<String> = urls.split(',').map(|url| url.trim().to_owned()).collect();
        let mut unreachable = None;
        for (index, url) in given.iter().enumerate() {
            let (endpoint, bearer) = endpoint(url, credentials, options)?;
            match endpoint.connect().await {
                Ok(channel) => {
                    let link = InterceptedService::new(channel, bearer);
                    let current = Mutex::new(Current { link, url: url.as_str().into(), index });
                    let credentials = credentials.clone();
                    return Ok(Arc::new(Self { given, credentials, options, current }));
                }
                Err(source) => {
                    let (url, source) = (url.clone(), Arc::new(source));
                    unreachable.get_or_insert(ClientError::Unreachable { url, source });
                }
            }
        }
        Err(unreachable.unwrap_or_else(|| ClientError::InvalidUrl { url: urls.to_owned() }))
    }

    /// One that stays on a channel.
    pub(super) fn on_channel(channel: Channel, url: &str) -> Arc<Self> {
        let link = InterceptedService::new(channel, Bearer::default());
        let current = Mutex::new(Current { link, url: url.into(), index: 0 });
        let (given, credentials) = (Vec::new(), Credentials::default());
        Arc::new(Self { given, credentials, options: LinkOptions::default(), current })
    }

    /// One that goes its own ways from here on, for what follows one map.
    pub(super) fn apart(&self) -> Arc<Self> {
        let current = Mutex::new(self.current().clone());
        let (given, credentials) = (self.given.clone(), self.credentials.clone());
        Arc::new(Self { given, credentials, options: self.options, current })
    }

    pub(super) fn link(&self) -> Link {
        self.current().link.clone()
    }

    pub(super) fn url(&self) -> Arc<str> {
        Arc::clone(&self.current().url)
    }

    /// Goes to the server that an error names, or, where the link broke or nobody serves the map, to the
    /// next one. Whether the error named the owner of a map, so that nothing of the call was done.
    pub(super) fn follow(&self, error: &ClientError) -> bool {
        if let Some(owner) = error.owner() {
            return !self.given.is_empty() && self.go_to(&owner, None);
        }
        if error.is_transient() && !error.is_full() {
            let (index, is_given) = {
                let current = self.current();
                let given = self.given.get(current.index).map(String::as_str);
                (current.index, given == Some(&*current.url))
            };
            // Where an owner is gone, the server that named it may know the next one.
            let next = if is_given { (index + 1) % self.given.len() } else { index };
            if (!is_given || next != index)
                && let Some(url) = self.given.get(next)
            {
                self.go_to(url, Some(next));
            }
        }
        false
    }

    /// False where the URL or the credentials cannot be used there.
    fn go_to(&self, url: &str, index: Option<usize>) -> bool {
        let Ok((endpoint, bearer)) = endpoint(url, &self.credentials, self.options) else {
            return false;
        };
        let link = InterceptedService::new(endpoint.connect_lazy(), bearer);
        let mut current = self.current();
        let index = index.unwrap_or(current.index);
        *current = Current { link, url: url.into(), index };
        true
    }

    fn current(&self) -> MutexGuard<'_, Current> {
        self.current.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Connects to a server for calls of services that are not covis' own, such as its health. No call
/// carries the token.
///
/// # Errors
/// As [`Client::connect_with`](super::Client::connect_with).
pub async fn connect_channel(
    url: &str,
    credentials: &Credentials,
    options: LinkOptions,
) -> Result<Channel, ClientError> {
    let (endpoint, _) = endpoint(url, credentials, options)?;
    endpoint.connect().await.map_err(|source| {
        let (url, source) = (url.to_owned(), Arc::new(source));
        ClientError::Unreachable { url, source }
    })
}

/// The endpoint of a URL, and the token for it.
fn endpoint(
    url: &str,
    credentials: &Credentials,
    options: LinkOptions,
) -> Result<(Endpoint, Bearer), ClientError> {
    let invalid = || ClientError::InvalidUrl { url: url.to_owned() };
    let endpoint = Endpoint::from_shared(url.to_owned()).map_err(|_invalid| invalid())?;
    let is_http = matches!(endpoint.uri().scheme_str(), Some("http" | "https"));
    if !is_http || endpoint.uri().host().is_none() {
        return Err(invalid());
    }
    let bearer = credentials.bearer(&endpoint)?;
    Ok((options.set(credentials.secure(endpoint)?), bearer))
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use tonic::{Code, Status};
    use tonic_types::{ErrorDetails, StatusExt as _};

    use super::*;

    fn servers(urls: &[&str]) -> Servers {
        let given: Vec<String> = urls.iter().map(|url| (*url).to_owned()).collect();
        let (credentials, options) = (Credentials::default(), LinkOptions::default());
        let (endpoint, bearer) = endpoint(&given[0], &credentials, options).unwrap();
        let link = InterceptedService::new(endpoint.connect_lazy(), bearer);
        let current = Mutex::new(Current { link, url: given[0].as_str().into(), index: 0 });
        Servers { given, credentials, options, current }
    }

    fn elsewhere(owner: Option<&str>) -> ClientError {
        let mut metadata = HashMap::new();
        owner.map(|owner| metadata.insert("owner".to_owned(), owner.to_owned()));
        let mut details = ErrorDetails::new();
        details.set_error_info("MAP_OWNED_ELSEWHERE", "covis", metadata);
        ClientError::rpc("GetMap")(Status::with_error_details(Code::Unavailable, "", details))
    }

    #[tokio::test]
    async fn a_client_goes_to_the_owner_and_back_and_on_when_the_owner_is_gone() {
        let servers = servers(&["http://a:1", "http://b:1"]);
        let broken = ClientError::rpc("GetMap")(Status::unavailable("gone"));
        assert!(servers.follow(&elsewhere(Some("http://c:1"))));
        assert_eq!(&*servers.url(), "http://c:1");
        // Who named it may know the next owner.
        assert!(!servers.follow(&broken));
        assert_eq!(&*servers.url(), "http://a:1");
        assert!(!servers.follow(&broken));
        assert_eq!(&*servers.url(), "http://b:1");
        assert!(!servers.follow(&elsewhere(None)));
        assert_eq!(&*servers.url(), "http://a:1");
        let apart = servers.apart();
        assert!(apart.follow(&elsewhere(Some("http://c:1"))));
        assert_eq!((&*apart.url(), &*servers.url()), ("http://c:1", "http://a:1"));
    }

    #[tokio::test]
    async fn a_client_of_one_server_stays_there_unless_it_is_led_on() {
        let servers = servers(&["http://a:1"]);
        servers.follow(&ClientError::rpc("GetMap")(Status::unavailable("gone")));
        servers.follow(&ClientError::rpc("GetMap")(Status::not_found("no map")));
        assert_eq!(&*servers.url(), "http://a:1");
        // An address that is none is not followed.
        assert!(!servers.follow(&elsewhere(Some("nowhere"))));
        assert_eq!(&*servers.url(), "http://a:1");
    }
}
