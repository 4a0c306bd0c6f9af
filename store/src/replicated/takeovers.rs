//! How soon a server takes the same map over again.
//!
//! Opening a map costs work: a server that has too much of it may lose the map at once, or fail to open it.
//! So each takeover of a map that follows another one soon waits twice as long, up to half a minute. The wait
//! varies with the server and the map, so that servers do not take maps from each other in step.

use std::collections::BTreeMap;
use std::time::Duration;

use tokio::time::Instant;

use crate::StoreError;
use crate::sync::Mutex;

/// The second takeover waits for one part in this many of a lease.
const FIRST_SHARE: u32 = 4;
/// The longest wait before it is varied.
const LONGEST: Duration = Duration::from_secs(30);
/// After so many leases without a takeover, the next one does not wait.
const STEADY: u32 = 8;

/// The takeovers of this server.
#[derive(Debug)]
pub(super) struct Takeovers {
    server: String,
    lease: Duration,
    maps: Mutex<BTreeMap<String, Attempts>>,
}

/// Takeovers of one map that followed each other soon.
#[derive(Clone, Copy, Debug)]
struct Attempts {
    count: u32,
    last: Instant,
}

impl Takeovers {
    pub(super) fn new(server: &str, lease: Duration) -> Self {
        Self { server: server.to_owned(), lease, maps: Mutex::default() }
    }

    /// Counts a takeover that begins `now`.
    ///
    /// # Errors
    /// [`StoreError::OwnedElsewhere`] while the map is left alone.
    pub(super) fn begin(&self, map: &str, now: Instant) -> Result<(), StoreError> {
        let mut maps = self.maps.lock();
        let count = match maps.get(map) {
            None => 0,
            Some(&Attempts { count, last }) => {
                let (wait, since) = (self.wait(map, count), now.saturating_duration_since(last));
                if since < wait {
                    return Err(StoreError::OwnedElsewhere { map: map.to_owned(), owner: None });
                }
                if since < wait + STEADY * self.lease { count } else { 0 }
            }
        };
        let count = count.saturating_add(1);
        if count > 1 {
            tracing::warn!(map, count, "the map is taken over again, soon after the last time");
        }
        maps.insert(map.to_owned(), Attempts { count, last: now });
        Ok(())
    }

    /// Forgets a map that was deleted.
    pub(super) fn forget(&self, map: &str) {
        self.maps.lock().remove(map);
    }

    /// The wait after so many takeovers: between a half and one and a half of what doubling gives.
    fn wait(&self, map: &str, count: u32) -> Duration {
        let doubled = 1_u32.checked_shl(count.saturating_sub(1)).unwrap_or(u32::MAX);
        let wait = (self.lease / FIRST_SHARE).saturating_mul(doubled).min(LONGEST);
        let key = format!("{} {map} {count}", self.server);
        let share = f64::from(crc32c::crc32c(key.as_bytes())) / f64::from(u32::MAX);
        wait.mul_f64(0.5 + share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEASE: Duration = Duration::from_secs(2);

    /// Milliseconds between the takeovers of a map by a server that takes it as often as it may.
    fn gaps(server: &str, map: &str, count: usize) -> Vec<u128> {
        let takeovers = Takeovers::new(server, LEASE);
        let (begin, step) = (Instant::now(), Duration::from_millis(10));
        let times = (0..).map(|k| begin + step * k);
        let taken: Vec<Instant> =
            times.filter(|&now| takeovers.begin(map, now).is_ok()).take(count).collect();
        taken.windows(2).map(|pair| (pair[1] - pair[0]).as_millis()).collect()
    }

    #[test]
    fn takeovers_in_a_row_wait_longer_each_time_and_other_servers_differently() {
        let gaps_a = gaps("a", "house", 10);
        for (k, &gap) in gaps_a.iter().enumerate() {
            let doubled = (500_u128 << k).min(30_000);
            assert!((doubled / 2..=doubled * 3 / 2 + 10).contains(&gap), "{k}: {gap} ms");
        }
        assert_eq!(gaps_a, gaps("a", "house", 10), "the waits depend on the ids alone");
        assert_ne!(gaps_a, gaps("b", "house", 10));
        assert_ne!(gaps_a, gaps("a", "hall", 10));
    }

    #[test]
    fn a_map_that_was_served_for_long_is_taken_at_once_and_so_is_another_one() {
        let (takeovers, begin) = (Takeovers::new("a", LEASE), Instant::now());
        takeovers.begin("house", begin).unwrap();
        let refused = takeovers.begin("house", begin).unwrap_err();
        assert!(matches!(refused, StoreError::OwnedElsewhere { owner: None, .. }), "{refused}");
        takeovers.begin("hall", begin).unwrap();
        let later = begin + 20 * LEASE;
        takeovers.begin("house", later).unwrap();
        // It counts anew from there.
        takeovers.begin("house", later + LEASE / 2).unwrap();
        takeovers.forget("house");
        takeovers.begin("house", later + LEASE / 2).unwrap();
    }
}
