//! Names of variables, `A12`: a letter for the robot or the kind of landmark, then a number.
//!
//! A name is an id too, as a graph needs one: the letter above the lower 48 bits, which are the number. So
//! names have the order of their letters and numbers, and the steps of a robot have consecutive ids.

use std::fmt;
use std::str::FromStr;

/// Bits of the number.
const NUMBER_BITS: u32 = 48;

/// The name of a pose or a landmark.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct PyfgName(i64);

/// A word that is no name: a letter, then a number below 2^48 without leading zeros.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a name is a letter and a number below 2^48")]
pub struct BadName;

impl PyfgName {
    /// The name of an ASCII letter and a number below 2^48; `None` for others.
    #[must_use]
    pub fn new(letter: char, number: u64) -> Option<Self> {
        let letter = u8::try_from(letter).ok().filter(u8::is_ascii_alphabetic)?;
        let number = i64::try_from(number).ok().filter(|number| number >> NUMBER_BITS == 0)?;
        Some(Self(i64::from(letter) << NUMBER_BITS | number))
    }

    /// The name that has this id.
    #[must_use]
    pub fn from_id(id: i64) -> Option<Self> {
        let name = Self(id);
        Self::new(char::from(u8::try_from(id >> NUMBER_BITS).ok()?), name.number())
    }

    /// Its id.
    #[must_use]
    pub fn id(self) -> i64 {
        self.0
    }

    /// Its letter.
    #[must_use]
    pub fn letter(self) -> char {
        // The shift leaves the letter alone.
        char::from((self.0 >> NUMBER_BITS) as u8)
    }

    /// Its number.
    #[must_use]
    pub fn number(self) -> u64 {
        (self.0 & ((1 << NUMBER_BITS) - 1)) as u64
    }
}

impl fmt::Display for PyfgName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.letter(), self.number())
    }
}

impl FromStr for PyfgName {
    type Err = BadName;

    fn from_str(text: &str) -> Result<Self, BadName> {
        let letter = text.chars().next().ok_or(BadName)?;
        let digits = text.get(letter.len_utf8()..).unwrap_or_default();
        // Another spelling of a number would not be written back.
        let is_plain = digits.bytes().all(|byte| byte.is_ascii_digit())
            && (digits == "0" || !digits.starts_with('0'));
        let number = digits.parse().ok().filter(|_| is_plain).ok_or(BadName)?;
        Self::new(letter, number).ok_or(BadName)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_ids_and_back() {
        for text in ["A0", "L12", "z281474976710655"] {
            let name: PyfgName = text.parse().unwrap();
            assert_eq!(name.to_string(), text);
            assert_eq!(PyfgName::from_id(name.id()), Some(name));
        }
        let id = |text: &str| text.parse::<PyfgName>().unwrap().id();
        assert_eq!(id("A8"), id("A7") + 1);
        assert!(id("B0") > id("A281474976710655") && id("A10") > id("A9"));
        for text in ["", "A", "7", "7A", "A-1", "A+1", "A01", "A281474976710656", "Ä1", "AB1"] {
            assert_eq!(text.parse::<PyfgName>(), Err(BadName), "{text}");
        }
        for id in [0, -1, 1 << 48, i64::MAX, i64::MIN] {
            assert_eq!(PyfgName::from_id(id), None, "{id}");
        }
    }
}
