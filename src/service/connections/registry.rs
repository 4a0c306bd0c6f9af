//! All connections of a server, and which one is closed when no slot is left. This module uses no
//! sockets: a connection is closed through its link.

use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use tokio::sync::Semaphore;

use super::limits::ConnectionLimits;
use super::link::Link;
use crate::meter::Counter;
use crate::service::error::ServiceError;
use crate::sync::Mutex;

/// The connections of a server.
#[derive(Debug)]
pub(in crate::service) struct Connections {
    limits: ConnectionLimits,
    table: Mutex<Table>,
    /// Memory budget of incomplete request messages, KiB.
    pub(super) unfinished: Arc<Semaphore>,
    /// Counts why connections ended.
    pub(in crate::service) ends: Ends,
    /// Connections that could not be accepted, for instance for lack of descriptors.
    pub(in crate::service) accept_failures: Counter,
}

/// Connections that the server ended, by reason.
#[derive(Debug, Default)]
pub(in crate::service) struct Ends {
    /// A stranger that made room for a newer one.
    pub(in crate::service) displaced: Counter,
    /// A stranger whose time was over.
    pub(in crate::service) stranger_time: Counter,
    /// Without a call for too long, or for the longest time when a slot was needed.
    pub(in crate::service) idle: Counter,
}

#[derive(Debug, Default)]
struct Table {
    next: u64,
    /// By age, the oldest first.
    strangers: BTreeMap<u64, Arc<Link>>,
    known: BTreeMap<u64, Arc<Link>>,
}

impl Table {
    /// The stranger that is closed next: the oldest of the network that has most of them.
    fn displaced(&self) -> Option<u64> {
        let mut networks: BTreeMap<IpAddr, (usize, u64)> = BTreeMap::new();
        for (&id, link) in &self.strangers {
            networks.entry(link.network()).or_insert((0, id)).0 += 1;
        }
        let most = networks.into_values().max_by_key(|&(count, oldest)| (count, u64::MAX - oldest));
        most.map(|(_, oldest)| oldest)
    }

    /// The connection that was without a call for longest.
    fn idlest(&self) -> Option<u64> {
        let idle = self.known.iter().filter_map(|(&id, link)| Some((link.idle_since()?, id)));
        idle.min().map(|(_, id)| id)
    }
}

impl Connections {
    pub(in crate::service) fn new(limits: ConnectionLimits, descriptors: Option<u64>) -> Arc<Self> {
        let room = (limits.max_unfinished_bytes >> 10).min(Semaphore::MAX_PERMITS);
        Arc::new(Self {
            limits: limits.within(descriptors),
            unfinished: Arc::new(Semaphore::new(room)),
            table: Mutex::default(),
            ends: Ends::default(),
            accept_failures: Counter::default(),
        })
    }

    /// The limits in force.
    pub(in crate::service) fn limits(&self) -> &ConnectionLimits {
        &self.limits
    }

    /// Strangers, and the other connections.
    pub(in crate::service) fn counts(&self) -> (usize, usize) {
        let table = self.table.lock();
        (table.strangers.len(), table.known.len())
    }

    /// A slot for a new connection; if none is free, another stranger loses its slot.
    pub(in crate::service) fn enter(self: &Arc<Self>, peer: SocketAddr) -> Slot {
        let mut table = self.table.lock();
        while table.strangers.len() >= self.limits.max_strangers {
            let Some(link) = table.displaced().and_then(|id| table.strangers.remove(&id)) else {
                break;
            };
            self.ends.displaced.increment();
            link.close();
        }
        let id = table.next;
        table.next += 1;
        let link = Link::new(id, peer, Arc::downgrade(self));
        table.strangers.insert(id, Arc::clone(&link));
        Slot { link, connections: Arc::clone(self) }
    }

    /// Moves a stranger to the known connections.
    pub(super) fn admit(&self, link: &Link) -> Result<(), ServiceError> {
        let mut table = self.table.lock();
        // Another call of the connection may have been faster, or a newer stranger.
        let Some(stranger) = table.strangers.remove(&link.id) else { return Ok(()) };
        if table.known.len() >= self.limits.max_known() {
            let Some(idle) = table.idlest().and_then(|id| table.known.remove(&id)) else {
                table.strangers.insert(link.id, stranger);
                return Err(ServiceError::ServerLimit {
                    limit: "max_connections",
                    maximum: i64::try_from(self.limits.max_connections).unwrap_or(i64::MAX),
                });
            };
            self.ends.idle.increment();
            // No call runs on it; its client opens another connection when it needs one.
            idle.close();
        }
        stranger.set_known();
        table.known.insert(link.id, stranger);
        Ok(())
    }

    fn leave(&self, id: u64) {
        let mut table = self.table.lock();
        table.strangers.remove(&id);
        table.known.remove(&id);
    }
}

/// The slot of a connection; dropping it ends the connection and releases the slot.
#[derive(Debug)]
pub(in crate::service) struct Slot {
    link: Arc<Link>,
    connections: Arc<Connections>,
}

impl Slot {
    pub(super) fn link(&self) -> &Arc<Link> {
        &self.link
    }

    /// Resolves when another connection needs the slot.
    pub(in crate::service) async fn closed(&self) {
        self.link.closed().await;
    }

    pub(super) fn connections(&self) -> &Connections {
        &self.connections
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.link.close();
        self.connections.leave(self.link.id);
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::super::link::Peer;
    use super::*;

    fn connections(max_connections: usize, max_strangers: usize) -> Arc<Connections> {
        let limits = ConnectionLimits { max_connections, max_strangers, ..Default::default() };
        Connections::new(limits, None)
    }

    fn address(text: &str) -> SocketAddr {
        text.parse().unwrap()
    }

    fn is_closed(slot: &Slot) -> bool {
        let mut cx = std::task::Context::from_waker(std::task::Waker::noop());
        slot.link().poll_closed(&mut cx).is_ready()
    }

    #[test]
    fn the_oldest_stranger_of_the_largest_network_makes_place() {
        let all = connections(8, 4);
        let quiet = all.enter(address("10.0.0.1:1"));
        // One household has 64 bits of addresses to itself.
        let loud: Vec<_> =
            (1..=3).map(|k| all.enter(address(&format!("[2001:db8::{k}]:1")))).collect();
        let next = all.enter(address("10.0.0.2:1"));
        assert!(is_closed(&loud[0]));
        assert!(![&quiet, &next, &loud[1], &loud[2]].into_iter().any(is_closed));
        assert_eq!((all.counts(), all.ends.displaced.get()), ((4, 0), 1));
        drop((quiet, next, loud));
        assert_eq!(all.counts(), (0, 0));
    }

    #[test]
    fn who_is_admitted_is_not_displaced_and_takes_the_place_of_an_idle_one_only() {
        let all = connections(3, 1);
        let first = all.enter(address("10.0.0.1:1"));
        Peer(Arc::clone(first.link())).admitted().unwrap();
        let second = all.enter(address("10.0.0.1:2"));
        Peer(Arc::clone(second.link())).admitted().unwrap();
        let first_call = Peer(Arc::clone(first.link())).call();
        let _second_call = Peer(Arc::clone(second.link())).call();
        let third = all.enter(address("10.0.0.1:3"));
        let refused = Peer(Arc::clone(third.link())).admitted().unwrap_err();
        let limit = ServiceError::ServerLimit { limit: "max_connections", maximum: 3 };
        assert_eq!(refused, limit);
        assert_eq!(all.counts(), (1, 2));
        drop(first_call);
        Peer(Arc::clone(third.link())).admitted().unwrap();
        assert!(is_closed(&first) && !is_closed(&second) && !is_closed(&third));
        assert_eq!((all.counts(), all.ends.idle.get()), ((0, 2), 1));
    }

    #[test]
    fn half_of_the_descriptors_stay_free() {
        let limits = ConnectionLimits::default();
        assert_eq!(limits.within(Some(20_000)), limits);
        let few = limits.within(Some(100));
        assert_eq!((few.max_connections, few.max_strangers, few.max_known()), (50, 25, 25));
        assert_eq!(few.stranger_time, Duration::from_secs(30));
    }
}
