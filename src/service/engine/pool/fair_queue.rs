//! Chooses the next solve, or the next job, fairly among tenants, so that no tenant starves another.
//!
//! Start-time fair queuing: each tenant has a virtual clock, and each of its solves advances the
//! clock by its running time. The waiting tenant with the earliest clock is next. An idle tenant
//! saves up no time: when it has work again, its clock starts at the clock of the last turn. The
//! solves of a tenant run in the order of their arrival; a map has a window, a solve of the
//! whole, a search and a background task at a time. Plain state without threads.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// The running time that is assumed for a tenant's first solve, nanoseconds. Because of it, slots
/// that are free at the same time do not all go to one tenant.
const FIRST_GUESS_NS: u64 = 1_000_000;

/// The waiting work of all tenants.
#[derive(Debug)]
pub struct FairQueue<T> {
    tenants: BTreeMap<Arc<str>, TenantQueue<T>>,
    /// The clock of the tenant that had the last turn.
    now_ns: u64,
    running: usize,
    slots: usize,
}

#[derive(Debug)]
struct TenantQueue<T> {
    waiting: VecDeque<T>,
    running: usize,
    clock_ns: u64,
    /// Running time of its last solve; assumed for the next one until it ends.
    guess_ns: u64,
}

/// The right to run one piece of work. It is passed to [`FairQueue::ended`] when the work has
/// ended.
#[derive(Clone, Debug)]
pub struct Turn {
    tenant: Arc<str>,
    guess_ns: u64,
}

impl Turn {
    /// Whose turn it is.
    pub fn tenant(&self) -> &Arc<str> {
        &self.tenant
    }
}

impl<T> FairQueue<T> {
    /// At most `slots` run at once.
    pub fn new(slots: usize) -> Self {
        Self { tenants: BTreeMap::new(), now_ns: 0, running: 0, slots: slots.max(1) }
    }

    /// How much work of a tenant waits.
    #[cfg(test)]
    pub(crate) fn waiting(&self, tenant: &str) -> usize {
        self.tenants.get(tenant).map_or(0, |tenant_queue| tenant_queue.waiting.len())
    }

    /// Appends work to the queue of a tenant.
    pub fn push(&mut self, tenant: &Arc<str>, work: T) {
        let now_ns = self.now_ns;
        let tenant_queue = self.tenants.entry(Arc::clone(tenant)).or_insert_with(|| TenantQueue {
            waiting: VecDeque::new(),
            running: 0,
            clock_ns: now_ns,
            guess_ns: FIRST_GUESS_NS,
        });
        if tenant_queue.waiting.is_empty() && tenant_queue.running == 0 {
            tenant_queue.clock_ns = tenant_queue.clock_ns.max(now_ns);
        }
        tenant_queue.waiting.push_back(work);
    }

    /// Takes the next work, if a slot is free. `may` gets a tenant and its number of running solves
    /// and says whether the tenant may start its next work; if not, another tenant is chosen.
    /// `fits` gets the total number of running solves and says whether the chosen work can start
    /// now; if not, nothing starts, so that small work does not overtake large work.
    pub fn next(
        &mut self,
        may: impl Fn(&str, u64, &T) -> bool,
        fits: impl Fn(usize, &T) -> bool,
    ) -> Option<(Turn, T)> {
        if self.running >= self.slots {
            return None;
        }
        let may_run = |name: &str, tenant_queue: &TenantQueue<T>| {
            tenant_queue
                .waiting
                .front()
                .is_some_and(|next| may(name, tenant_queue.running as u64, next))
        };
        let waiting =
            self.tenants.iter_mut().filter(|(name, tenant_queue)| may_run(name, tenant_queue));
        let (name, tenant_queue) = waiting.min_by_key(|(_, tenant_queue)| tenant_queue.clock_ns)?;
        let running = self.running;
        let work = tenant_queue.waiting.pop_front_if(|next| fits(running, next))?;
        self.now_ns = self.now_ns.max(tenant_queue.clock_ns);
        let turn = Turn { tenant: Arc::clone(name), guess_ns: tenant_queue.guess_ns };
        tenant_queue.clock_ns = tenant_queue.clock_ns.saturating_add(turn.guess_ns);
        tenant_queue.running += 1;
        self.running += 1;
        Some((turn, work))
    }

    /// Ends a turn that took `took_ns`.
    pub fn ended(&mut self, turn: &Turn, took_ns: u64) {
        self.running = self.running.saturating_sub(1);
        let Some(tenant_queue) = self.tenants.get_mut(&turn.tenant) else { return };
        tenant_queue.running = tenant_queue.running.saturating_sub(1);
        tenant_queue.clock_ns =
            tenant_queue.clock_ns.saturating_sub(turn.guess_ns).saturating_add(took_ns);
        tenant_queue.guess_ns = took_ns.max(1);
        // An idle tenant whose clock is not ahead is removed: a new entry would behave the same.
        if tenant_queue.running == 0
            && tenant_queue.waiting.is_empty()
            && tenant_queue.clock_ns <= self.now_ns
        {
            self.tenants.remove(&turn.tenant);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAY: fn(&str, u64, &&str) -> bool = |_, _, _| true;
    const FITS: fn(usize, &&str) -> bool = |_, _| true;

    fn name(text: &str) -> Arc<str> {
        Arc::from(text)
    }

    #[test]
    fn a_flood_of_one_tenant_leaves_every_second_turn_to_another() {
        let mut queue = FairQueue::new(1);
        let (flood, quiet) = (name("flood"), name("quiet"));
        (0..100).for_each(|_| queue.push(&flood, "flood"));
        let mut order = Vec::new();
        for step in 0..20 {
            if step >= 4 {
                queue.push(&quiet, "quiet");
            }
            let (turn, work) = queue.next(MAY, FITS).unwrap();
            assert!(queue.next(MAY, FITS).is_none(), "one slot");
            order.push(work);
            queue.ended(&turn, 5_000_000);
        }
        assert!(order[..4].iter().all(|&work| work == "flood"));
        let quiet = order[4..].iter().filter(|&&work| work == "quiet").count();
        assert_eq!(quiet, 8, "{order:?}");
    }

    #[test]
    fn time_is_shared_and_not_the_number_of_solves() {
        let mut queue = FairQueue::new(1);
        for (tenant, count) in [("long", 100), ("short", 1000)] {
            (0..count).for_each(|_| queue.push(&name(tenant), tenant));
        }
        let (mut long_ns, mut short_ns) = (0_u64, 0);
        for _ in 0..200 {
            let (turn, work) = queue.next(MAY, FITS).unwrap();
            let (sum, took) = if work == "long" {
                (&mut long_ns, 10_000_000)
            } else {
                (&mut short_ns, 1_000_000)
            };
            *sum += took;
            queue.ended(&turn, took);
        }
        assert!(long_ns.abs_diff(short_ns) <= 20_000_000, "{long_ns} and {short_ns}");
    }

    #[test]
    fn who_was_idle_has_saved_nothing_up() {
        let mut queue = FairQueue::new(1);
        let (a, b) = (name("a"), name("b"));
        queue.push(&b, "b");
        let (turn, _) = queue.next(MAY, FITS).unwrap();
        queue.ended(&turn, 1_000_000);
        for _ in 0..50 {
            queue.push(&a, "a");
            let (turn, _) = queue.next(MAY, FITS).unwrap();
            queue.ended(&turn, 1_000_000);
        }
        (0..10).for_each(|_| queue.push(&a, "a"));
        (0..10).for_each(|_| queue.push(&b, "b"));
        let mut order = Vec::new();
        for _ in 0..10 {
            let (turn, work) = queue.next(MAY, FITS).unwrap();
            order.push(work);
            queue.ended(&turn, 1_000_000);
        }
        let b = order.iter().filter(|&&work| work == "b").count();
        assert!((4..=6).contains(&b), "{order:?}");
    }

    #[test]
    fn a_tenant_runs_no_more_at_once_than_it_may() {
        let mut queue = FairQueue::new(4);
        (0..4).for_each(|_| queue.push(&name("a"), "a"));
        queue.push(&name("b"), "b");
        let may = |name: &str, running, _: &&str| name != "a" || running < 2;
        let mut begun: Vec<&str> = Vec::new();
        while let Some((_turn, work)) = queue.next(may, FITS) {
            begun.push(work);
        }
        begun.sort_unstable();
        assert_eq!(begun, ["a", "a", "b"]);
        assert_eq!(queue.waiting("a"), 2);
    }

    #[test]
    fn what_does_not_fit_is_not_passed_by_others() {
        let mut queue = FairQueue::new(4);
        let fits = |running, work: &&str| running == 0 || *work != "needs all";
        queue.push(&name("a"), "first");
        let (first, _) = queue.next(MAY, fits).unwrap();
        queue.push(&name("b"), "needs all");
        queue.push(&name("c"), "small");
        assert!(queue.next(MAY, fits).is_none(), "b is next and waits");
        queue.ended(&first, 1);
        assert_eq!(queue.next(MAY, fits).unwrap().1, "needs all");
        assert_eq!(queue.next(MAY, fits).unwrap().1, "small");
    }
}
