//! Reservations add up over maps, tenants and the server, and are released when dropped.

use std::collections::BTreeMap;

use super::{AccountLimits, Accounts, HeldEntities, Resource};
use crate::map::{MapLimits, Usage};
use crate::service::engine::EngineError;

fn keyframes(keyframes: u64) -> Usage {
    Usage { keyframes, ..Usage::default() }
}

fn at_most(maximum: u64) -> AccountLimits {
    let held = MapLimits { keyframes: Some(maximum), ..MapLimits::default() };
    AccountLimits::of_maps(held).with(Resource::Streams, maximum)
}

#[test]
fn what_maps_hold_adds_up_and_is_given_back() {
    let accounts = Accounts::new(at_most(12), at_most(10), AccountLimits::default());
    let mut a = HeldEntities::existing(&accounts.of_map("acme.a"), keyframes(4));
    let mut b = HeldEntities::existing(&accounts.of_map("acme.b"), keyframes(5));
    let mut house = HeldEntities::existing(&accounts.of_map("house"), keyframes(1));
    a.grow(keyframes(1)).unwrap();
    let limit = "tenant_max_keyframe_count";
    let full = EngineError::TenantLimit { limit, maximum: 10 };
    assert_eq!(b.grow(keyframes(1)), Err(full.clone()));
    let server = EngineError::ServerLimit { limit: "max_keyframe_count", maximum: 12 };
    assert_eq!(house.grow(keyframes(2)), Err(server));
    // A refused reservation changes no account.
    assert_eq!(accounts.tenant("").entities(), keyframes(1));
    assert_eq!(accounts.tenant("acme").entities(), keyframes(10));
    // The change failed, so that its growth is released.
    a.update(keyframes(4));
    b.grow(keyframes(1)).unwrap();
    drop((a, b, house));
    assert_eq!(accounts.server().entities(), Usage::default());
}

#[test]
fn a_reservation_counts_here_and_above_and_gives_itself_back() {
    let accounts = Accounts::new(at_most(3), AccountLimits::default(), at_most(2));
    let (a, b) = (accounts.of_map("acme.a"), accounts.of_map("rival.b"));
    let mut of_a = a.reserve(Resource::Streams, 2).unwrap();
    let limit = "max_stream_count";
    let full = EngineError::MapLimit { map: "acme.a".to_owned(), limit, maximum: 2 };
    assert_eq!(a.reserve(Resource::Streams, 1).unwrap_err(), full);
    let full = EngineError::ServerLimit { limit, maximum: 3 };
    assert_eq!(b.reserve(Resource::Streams, 2).unwrap_err(), full);
    assert_eq!((b.held(Resource::Streams), accounts.server().held(Resource::Streams)), (0, 2));
    of_a.resize(1).unwrap();
    let of_b = b.reserve(Resource::Streams, 2).unwrap();
    assert_eq!(of_a.resize(2), Err(full));
    assert_eq!(of_a.amount(), 1);
    drop((of_a, of_b));
    assert_eq!(accounts.server().held(Resource::Streams), 0);
    let huge = a.reserve(Resource::Exports, u64::MAX).unwrap();
    assert!(b.reserve(Resource::Exports, 1).is_err(), "sums do not wrap");
    drop(huge);
}

#[test]
fn limits_of_tenants_can_be_set_while_they_hold_something() {
    let accounts = Accounts::default();
    let tenant = accounts.tenant("acme");
    let many: Vec<_> = (0..9).map(|_| tenant.reserve(Resource::Streams, 1)).collect();
    assert!(many.iter().all(Result::is_ok), "without a limit there is none");
    accounts.set_tenants(BTreeMap::from([("acme".to_owned(), at_most(2))]));
    let full = EngineError::TenantLimit { limit: "tenant_max_stream_count", maximum: 2 };
    assert_eq!(tenant.reserve(Resource::Streams, 1).unwrap_err(), full);
    accounts.tenant("other").reserve(Resource::Streams, 9).unwrap();
}
