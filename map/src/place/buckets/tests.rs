//! The table against a plain list of its entries.

use proptest::prelude::*;

use super::*;

/// Keys of a few bits that differ, so that buckets are shared; the rest is the number's own.
fn key(number: u32) -> u32 {
    (number % 97).wrapping_mul(0x9e37_79b9)
}

fn entry(number: u32) -> Entry {
    Entry { value: number, fingerprint: number }
}

fn near(table: &Buckets, key: u32) -> Vec<u32> {
    let mut values = Vec::new();
    table.near(key, 0, 32, &mut values);
    values.sort_unstable();
    values
}

proptest! {
    #[test]
    fn it_finds_every_key_that_differs_in_one_bit(
        steps in proptest::collection::vec((0..3_u8, 0..400_u32), 0..800),
    ) {
        let mut table = Buckets::new();
        let mut model = std::collections::BTreeSet::new();
        for (what, number) in steps {
            if what == 0 {
                table.remove(key(number), |held| held.value == number);
                model.remove(&number);
            } else if model.insert(number) {
                table.insert(key(number), entry(number), |held| key(held.value));
            }
            prop_assert_eq!(table.entries, model.len());
            prop_assert_eq!(table.buckets, model.len().div_ceil(LOAD).max(1));
        }
        for asked in (0..97).map(key) {
            for flipped in [asked, asked ^ 1, asked ^ (1 << 17), asked ^ (1 << 31)] {
                let found = near(&table, flipped);
                for &number in model.iter().filter(|&&number| key(number) == asked) {
                    prop_assert!(found.contains(&number));
                }
                prop_assert!(found.windows(2).all(|pair| pair[0] < pair[1]), "told once");
                prop_assert!(found.iter().all(|number| model.contains(number)));
            }
        }
        for number in model {
            table.remove(key(number), |held| held.value == number);
        }
        prop_assert_eq!(table.bytes(), Buckets::new().bytes());
    }
}

#[test]
fn equal_keys_beyond_the_limit_cost_nothing() {
    let mut table = Buckets::new();
    for number in 0..FULL as u32 {
        table.insert(5, entry(number), |_| 5);
    }
    let bytes = table.bytes();
    for number in 0..100_000 {
        table.insert(5, entry(number), |_| 5);
    }
    assert_eq!(table.bytes(), bytes);
    assert_eq!(near(&table, 5).len(), FULL, "the first ones stay");
    table.insert(!5, entry(7), |held| if held.value == 7 { !5 } else { 5 });
    assert_eq!(near(&table, !5), [7]);
}
