//! The order a person expects of numbered names: `image2` before `image10`.
//!
//! Runs of ASCII digits compare by value at any length, everything else by bytes. Names that differ
//! in leading zeros only are ordered by bytes, so that the order is total. It compares names and
//! changes none.

use std::cmp::Ordering;

/// Compares two names in natural order.
#[must_use]
pub fn natural_cmp(a: &str, b: &str) -> Ordering {
    let (mut rest_a, mut rest_b) = (a.as_bytes(), b.as_bytes());
    while let (Some(&first_a), Some(&first_b)) = (rest_a.first(), rest_b.first()) {
        let order = if first_a.is_ascii_digit() && first_b.is_ascii_digit() {
            let (number_a, number_b) = (take_digits(&mut rest_a), take_digits(&mut rest_b));
            number_a.len().cmp(&number_b.len()).then_with(|| number_a.cmp(number_b))
        } else {
            (rest_a, rest_b) = (&rest_a[1..], &rest_b[1..]);
            first_a.cmp(&first_b)
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    rest_a.len().cmp(&rest_b.len()).then_with(|| a.cmp(b))
}

/// Cuts the leading digits off `text` and returns them without leading zeros.
fn take_digits<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let end = text.iter().position(|c| !c.is_ascii_digit()).unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    *text = rest;
    let zeros = digits.iter().take_while(|&&c| c == b'0').count();
    &digits[zeros..]
}

#[cfg(test)]
mod tests {
    use super::natural_cmp;

    #[test]
    fn numbers_compare_by_value() {
        let mut names =
            ["b1", "image10.png", "image2.png", "image02.png", "image", "9", "10", "a", ""];
        names.sort_by(|a, b| natural_cmp(a, b));
        let expected =
            ["", "9", "10", "a", "b1", "image", "image02.png", "image2.png", "image10.png"];
        assert_eq!(names, expected);
        let huge = "x99999999999999999999999999999999999999";
        assert!(natural_cmp("x100000000000000000000000000000000000000", huge).is_gt());
    }
}
